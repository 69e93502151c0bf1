//! Finds every particle of the rest image again in the image now: where its surroundings went (block matching, coarse
//! to fine), the best whole pixel along that way for its depth, then least squares of its own 7×7 pixels, then whether
//! its neighbours agree. The tracks follow from (rest, now) alone; what did not change since the last image is kept.
//! Pixels of the crop. No allocation after [`Tracker::set_rest`].

use super::changed::{Changed, Tiles, same};
#[cfg(target_arch = "x86_64")]
use super::compare::Avx2;
use super::compare::{Compare, Plain, difference};
use super::flow::Flow;
use super::particles::{self, Particle};
use super::pyramid::{Level, Pyramid};
use crate::constants::CROP_SIDE;
use crate::instruction_set::{InstructionSet, InstructionSetError};

/// Half of a particle's patch, pixels.
const HALF: i32 = 3;
/// Side of the patch.
const PATCH: usize = 7;
/// Sigma of the patch's weights, pixels: about a particle's radius with the lens's blur.
const PATCH_SIGMA: f32 = 1.6;
/// Most Gauss–Newton steps, and the step that is small enough, pixels.
const STEPS: usize = 5;
const SMALL_STEP: f32 = 0.01;
/// Farthest that least squares may go from the whole pixel it started at.
const FARTHEST_STEP: f32 = 2.0;
/// Least share of the smaller curvature in both, squared: less is an edge, not a spot.
const LEAST_CORNER: f32 = 0.02;
/// Cost of a pixel off the expected place along the way and, squared, across it; sums of absolute grey levels.
const PRIOR: [f32; 2] = [10.0, 10.0];
/// Share of its contrast that a patch must explain: at rest or nearly, and on a long way, where others look alike.
const LEAST_CONFIDENCE: [f32; 2] = [0.6, 0.85];
/// From this motion of the surface on a way is long, pixels.
const LONG: f32 = 4.0;
/// Thickness of the skin's soft part, mm: the base does not move.
const THICKNESS_MM: f32 = 6.0;
/// Depth of a particle that moves as its surroundings do on the mean, mm.
const MEAN_DEPTH_MM: f32 = 3.2;
/// Pixels a side of the cells within which tracks must agree, and cells a side.
const CELL: usize = 40;
const CELLS: usize = CROP_SIDE / CELL;
/// Fewest tracks of a cell that can outvote one, and most that are heard.
const VOTES: [usize; 2] = [5, 32];

/// Where a particle went.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Track {
    /// Motion since rest, pixels.
    pub motion_px: [f32; 2],
    /// Share of the patch's contrast that the match explains; 0 for the lost and the doubtful.
    pub confidence: f32,
}

/// A particle's patch, ready for least squares. Rows have eight places for the sake of vectors; the last weighs nothing.
#[derive(Debug, Clone)]
struct Template {
    pixels: [[u8; 8]; PATCH],
    /// Weighted slopes along x and y, without their mean: a change of the light around does not count.
    slopes: [[[f32; 8]; PATCH]; 2],
    /// Inverse of the slopes' products: xx, xy, yy.
    inverse: [f32; 3],
    /// Weighted square of the patch without its mean.
    contrast: f32,
}

/// What a particle's track was made from.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Asked {
    /// Motion of the surface there, by the surroundings, and the tiles that it makes the search look at.
    surface_px: [f32; 2],
    surface_tiles: Tiles,
    /// Before the neighbours had their say.
    first: Track,
    /// What the neighbours said the surface's motion is; NaN when they said nothing. The tiles of that search.
    voted_px: [f32; 2],
    voted_tiles: Tiles,
}

/// The tracker with its images, particles and tracks.
#[derive(Debug, Clone)]
pub struct Tracker {
    rest: Pyramid,
    now: Pyramid,
    flow: Flow,
    particles: Vec<Particle>,
    templates: Vec<Option<Template>>,
    asked: Vec<Asked>,
    tracks: Vec<Track>,
    weights: Weights,
    votes: Votes,
    /// Whether `now` holds an image since the rest image was taken.
    known: bool,
    instructions: InstructionSet,
}

/// Weights of a patch's pixels, and their sum.
#[derive(Debug, Clone)]
struct Weights {
    of_pixel: [[f32; 8]; PATCH],
    sum: f32,
}

impl Weights {
    fn new() -> Self {
        let of_pixel: [[f32; 8]; PATCH] = std::array::from_fn(|row| {
            std::array::from_fn(|column| {
                let [x, y] = [column as f32 - HALF as f32, row as f32 - HALF as f32];
                if column < PATCH {
                    (-(x * x + y * y) / (2.0 * PATCH_SIGMA * PATCH_SIGMA)).exp()
                } else {
                    0.0
                }
            })
        });
        Self {
            sum: of_pixel.as_flattened().iter().sum(),
            of_pixel,
        }
    }
}

impl Weights {
    /// Weighted square of differences, without their mean.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn residual(&self, off: &[[f32; 8]; PATCH]) -> f32 {
        let [mut error, mut square] = [[0.0; 8]; 2];
        for (weights, off) in self.of_pixel.iter().zip(off) {
            let mut weighted = [0.0; 8];
            for k in 0..8 {
                weighted[k] = weights[k] * off[k];
            }
            add(&mut error, weights, off);
            add(&mut square, &weighted, off);
        }
        let [error, square] = [sum(&error), sum(&square)];
        square - error * error / self.sum
    }
}

impl Default for Tracker {
    fn default() -> Self {
        Self::new()
    }
}

impl Tracker {
    /// A tracker without a rest image: it has no particles.
    #[must_use]
    pub fn new() -> Self {
        Self {
            rest: Pyramid::new(),
            now: Pyramid::new(),
            flow: Flow::new(),
            particles: Vec::new(),
            templates: Vec::new(),
            asked: Vec::new(),
            tracks: Vec::new(),
            weights: Weights::new(),
            votes: Votes::new(),
            known: false,
            instructions: InstructionSet::widest(),
        }
    }

    /// The same tracker on another instruction set than the widest that the processor has. Tracks are the same, bit by
    /// bit.
    ///
    /// # Errors
    /// When the processor does not have it.
    pub fn with_instructions(mut self, instructions: InstructionSet) -> Result<Self, InstructionSetError> {
        self.instructions = instructions.checked()?;
        Ok(self)
    }

    /// Finds the particles of the untouched skin in a 440×440 image.
    pub fn set_rest(&mut self, rest: &[u8]) {
        self.rest.take(rest);
        let image = &self.rest.full;
        self.particles = particles::find(image);
        self.templates = self
            .particles
            .iter()
            .map(|particle| Template::new(image, particle, &self.weights))
            .collect();
        let nothing = |particle: &Particle| Asked {
            surface_px: [f32::NAN; 2],
            surface_tiles: tiles(particle, [f32::NAN; 2]),
            first: Track::default(),
            voted_px: [f32::NAN; 2],
            voted_tiles: tiles(particle, [f32::NAN; 2]),
        };
        self.asked = self.particles.iter().map(nothing).collect();
        self.tracks = vec![Track::default(); self.particles.len()];
        self.known = false;
    }

    /// The particles at rest.
    #[must_use]
    pub fn particles(&self) -> &[Particle] {
        &self.particles
    }

    /// Where they went, in the same order.
    #[must_use]
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// Forgets the last image, so that the next one is looked at as a whole.
    pub fn forget(&mut self) {
        self.known = false;
    }

    /// Follows the particles into a 440×440 image; whether any track can have changed.
    pub fn track(&mut self, now: &[u8]) -> bool {
        let changed = if self.known {
            Changed::between(&self.now.full, now)
        } else {
            Changed::everything()
        };
        if changed.nothing() {
            return false;
        }
        self.known = true;
        match self.instructions {
            InstructionSet::Portable => self.follow::<Plain>(now, &changed),
            // Most vectors here are eight numbers wide: wider ones gain nothing.
            #[cfg(target_arch = "x86_64")]
            #[expect(unsafe_code, reason = "compiled for an instruction set that was checked for")]
            // SAFETY: the processor has it, or it would not have been taken; AVX-512F implies AVX2.
            InstructionSet::Avx2 | InstructionSet::Avx512 => unsafe { self.follow_avx2(now, &changed) },
            #[cfg(not(target_arch = "x86_64"))]
            InstructionSet::Avx2 | InstructionSet::Avx512 => self.follow::<Plain>(now, &changed),
        }
        true
    }

    /// The same operations in the same order, so the same bits.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn follow_avx2(&mut self, now: &[u8], changed: &Changed) {
        self.follow::<Avx2>(now, changed);
    }

    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn follow<C: Compare>(&mut self, now: &[u8], changed: &Changed) {
        self.now.take(now);
        self.flow.find::<C>(&self.rest, &self.now, changed);
        let search = Search {
            weights: &self.weights,
            now: &self.now.full,
        };
        self.votes.clear();
        for (i, particle) in self.particles.iter().enumerate() {
            let asked = &mut self.asked[i];
            let Some(template) = &self.templates[i] else {
                continue;
            };
            let mean_share = share(MEAN_DEPTH_MM);
            let surface_px = self.flow.at(particle.at_px).map(|v| v / mean_share);
            let moved = !same(surface_px, asked.surface_px);
            if moved {
                asked.surface_px = surface_px;
                asked.surface_tiles = tiles(particle, surface_px);
            }
            if moved || changed.any(asked.surface_tiles) {
                asked.first = search.find(template, particle, surface_px);
                // Decided anew below.
                asked.voted_px = [f32::INFINITY; 2];
            }
            self.votes.cast(particle, &asked.first);
        }
        self.votes.count();
        for (i, particle) in self.particles.iter().enumerate() {
            let asked = &mut self.asked[i];
            let Some(template) = &self.templates[i] else {
                continue;
            };
            let voted_px = self.votes.at(particle);
            if !same(voted_px, asked.voted_px) {
                asked.voted_px = voted_px;
                asked.voted_tiles = tiles(particle, voted_px);
            } else if !changed.any(asked.voted_tiles) {
                continue;
            }
            let mut track = asked.first;
            if contradicts(&track, voted_px) {
                track = search.find(template, particle, voted_px);
                if contradicts(&track, voted_px) {
                    track.confidence = 0.0;
                }
            }
            self.tracks[i] = track;
        }
    }
}

/// The tiles that [`Search::find`] can look at for this particle.
#[inline]
fn tiles(particle: &Particle, surface_px: [f32; 2]) -> Tiles {
    // To 1.15 of the way and 2.5 beyond, 4 aside, half a patch, a step of least squares, and two pixels after.
    let reach = if surface_px[0].is_nan() {
        0
    } else {
        (1.15 * length(surface_px) + 15.0) as usize
    };
    Tiles::around(particle.pixel.map(usize::from), reach)
}

/// Share of the surface's motion that a particle at this depth takes part in: a line to the base.
fn share(depth_mm: f32) -> f32 {
    1.0 - depth_mm / THICKNESS_MM
}

/// Whether a track is lost or not one of a surface that moves like this, at any depth. No vote, no contradiction.
fn contradicts(track: &Track, [x, y]: [f32; 2]) -> bool {
    if x.is_nan() {
        return false;
    }
    let length = length([x, y]).max(1e-3);
    let [u, v] = track.motion_px;
    let along = (u * x + v * y) / length;
    let across = (u * y - v * x) / length;
    track.confidence == 0.0
        || along < -0.4 * length - 1.0
        || along > 1.5 * length + 1.0
        || across.abs() > 0.35 * length + 1.0
}

/// Slope in the middle of five pixels, from the outer four: exact for polynomials of the fourth degree.
fn slope(beside: [u8; 4]) -> f32 {
    let [far_below, below, above, far_above] = beside.map(f32::from);
    (8.0 * (above - below) - (far_above - far_below)) / 12.0
}

/// Weights of four pixels in a row for the place `t` from the second to the third: exact for polynomials of the third
/// degree. Fewer pixels, and splines through the same four, place a spot up to 0.03 pixels wrong between pixels.
fn between(t: f32) -> [f32; 4] {
    let [before, after, far] = [t + 1.0, t - 1.0, t - 2.0];
    [
        -t * after * far / 6.0,
        before * after * far / 2.0,
        -before * t * far / 2.0,
        before * t * after / 6.0,
    ]
}

impl Template {
    /// None when the spot cannot be placed in both directions.
    fn new(image: &Level<CROP_SIDE>, particle: &Particle, weights: &Weights) -> Option<Self> {
        let [x0, y0] = particle.corner();
        let pixels: [[u8; 8]; PATCH] = std::array::from_fn(|row| *image.run(x0, y0 + row as i32));
        let mut slopes = [[[0.0_f32; 8]; PATCH]; 2];
        let (mut mean, mut means) = (0.0, [0.0_f32; 2]);
        for row in 0..PATCH {
            let y = y0 + row as i32;
            let beside: &[u8; 12] = image.run(x0 - 2, y);
            let rows: [&[u8; 8]; 4] = [-2, -1, 1, 2].map(|down| image.run(x0, y + down));
            for column in 0..PATCH {
                slopes[0][row][column] = slope([0, 1, 3, 4].map(|right| beside[column + right]));
                slopes[1][row][column] = slope(rows.map(|row| row[column]));
                let weight = weights.of_pixel[row][column] / weights.sum;
                mean += weight * f32::from(pixels[row][column]);
                for k in 0..2 {
                    means[k] += weight * slopes[k][row][column];
                }
            }
        }
        let (mut xx, mut xy, mut yy, mut contrast) = (0.0, 0.0, 0.0, 0.0);
        for row in 0..PATCH {
            for column in 0..PATCH {
                let weight = weights.of_pixel[row][column];
                let [x, y] = [0, 1].map(|k| slopes[k][row][column] - means[k]);
                let level = f32::from(pixels[row][column]) - mean;
                xx += weight * x * x;
                xy += weight * x * y;
                yy += weight * y * y;
                contrast += weight * level * level;
                [slopes[0][row][column], slopes[1][row][column]] = [weight * x, weight * y];
            }
        }
        let determinant = xx * yy - xy * xy;
        (determinant > LEAST_CORNER * (xx + yy) * (xx + yy)).then(|| Self {
            pixels,
            slopes,
            inverse: [yy / determinant, -xy / determinant, xx / determinant],
            contrast,
        })
    }
}

/// Looks for patches in an image.
struct Search<'a> {
    weights: &'a Weights,
    now: &'a Level<CROP_SIDE>,
}

impl Search<'_> {
    /// Where the particle went if the surface above it moved by `surface_px`, about.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn find(&self, template: &Template, particle: &Particle, surface_px: [f32; 2]) -> Track {
        let start = self.whole_pixel(template, particle, surface_px);
        let long = length(surface_px) > LONG;
        match start {
            Some(start) => self.refine(template, particle, start, LEAST_CONFIDENCE[usize::from(long)]),
            None => Track::default(),
        }
    }

    /// The whole-pixel motion with the least difference: anywhere between none and the surface's motion, and a little
    /// to the sides, rather where the particle's depth suggests.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    fn whole_pixel(
        &self,
        template: &Template,
        particle: &Particle,
        surface_px: [f32; 2],
    ) -> Option<[i32; 2]> {
        let length = length(surface_px);
        let [x, y] = if length > 0.0 {
            surface_px.map(|v| v / length)
        } else {
            [1.0, 0.0]
        };
        let expected = share(particle.depth_mm) * length;
        let (from, to) = ((-0.15 * length - 1.5).floor(), (1.15 * length + 1.5).ceil());
        let aside = (1.0 + 0.2 * length).min(4.0).floor();
        let width = 2.0 * aside + 1.0;
        let places = ((to - from + 1.0) * width) as usize;
        let [column, row] = particle.pixel.map(i32::from);
        let [x0, y0] = particle.corner();
        let inside = 2..CROP_SIDE as i32 - 2;
        let mut best = (f32::INFINITY, None);
        for first in (0..places).step_by(8) {
            // Eight places at a time, in the order along, then across; one simple loop for each number of theirs.
            let [mut along, mut across, mut off_along, mut off_across] = [[0.0_f32; 8]; 4];
            let [mut dx, mut dy] = [[0_i32; 8]; 2];
            for k in 0..8 {
                let place = (first + k) as f32;
                let whole = ((place + 0.5) / width).floor();
                along[k] = from + whole;
                across[k] = place - whole * width - aside;
            }
            for k in 0..8 {
                off_along[k] = PRIOR[0] * (along[k] - expected).abs();
                off_across[k] = PRIOR[1] * across[k] * across[k];
            }
            for k in 0..8 {
                dx[k] = nearest(along[k] * x - across[k] * y);
                dy[k] = nearest(along[k] * y + across[k] * x);
            }
            for k in 0..8.min(places - first) {
                let motion = [dx[k], dy[k]];
                if !inside.contains(&(column + motion[0])) || !inside.contains(&(row + motion[1])) {
                    continue;
                }
                let other = self.now.rows(x0 + motion[0], y0 + motion[1]);
                let cost = difference(&template.pixels, &other) as f32 + off_along[k] + off_across[k];
                if cost < best.0 {
                    best = (cost, Some(motion));
                }
            }
        }
        best.1
    }

    /// Least squares from a whole pixel on: inverse compositional, the image interpolated by cubic polynomials.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    fn refine(&self, template: &Template, particle: &Particle, start: [i32; 2], least: f32) -> Track {
        let mut patch = Patch::new(template, self.now, particle.corner());
        let start_px = start.map(|v| v as f32);
        let mut at = start_px;
        let mut residual = f32::INFINITY;
        for round in 0..=STEPS {
            if round == 0 {
                patch.look_at_whole(start);
            } else {
                patch.look_at(at);
            }
            let [xx, xy, yy] = template.inverse;
            let along_x = product(&template.slopes[0], &patch.off);
            let along_y = product(&template.slopes[1], &patch.off);
            let step = [xx * along_x + xy * along_y, xy * along_x + yy * along_y];
            let done = step[0].abs() < SMALL_STEP && step[1].abs() < SMALL_STEP;
            if done || round == STEPS {
                residual = self.weights.residual(&patch.off);
            }
            if done {
                break;
            }
            at = [at[0] - step[0], at[1] - step[1]];
            // Written so that NaN ends here too.
            let near =
                (at[0] - start_px[0]).abs() < FARTHEST_STEP && (at[1] - start_px[1]).abs() < FARTHEST_STEP;
            if !near {
                return Track::default();
            }
        }
        let confidence = 1.0 - residual / template.contrast;
        Track {
            motion_px: at,
            confidence: if confidence > least { confidence } else { 0.0 },
        }
    }
}

/// The nearest whole number, of two as near the one farther from 0.
#[expect(
    clippy::inline_always,
    reason = "compiled for the instruction set of its caller"
)]
#[inline(always)]
fn nearest(value: f32) -> i32 {
    // The greatest number below a half, so that what is below does not become a whole by rounding.
    (value + 0.499_999_97_f32.copysign(value)) as i32
}

/// A template against the image at a place between pixels.
struct Patch<'a> {
    now: &'a Level<CROP_SIDE>,
    corner: [i32; 2],
    template: [[f32; 8]; PATCH],
    /// The whole pixel that the next was read at.
    whole: Option<[i32; 2]>,
    /// The image from one pixel left and above of the patch to two right and below.
    wide: [[f32; 16]; PATCH + 3],
    /// The image less the template.
    off: [[f32; 8]; PATCH],
}

// Plain loops over whole arrays, each of one operation, become vectors; closures are compiled for another instruction set.
#[expect(
    clippy::inline_always,
    clippy::needless_range_loop,
    reason = "compiled for the instruction set of its caller, into vectors"
)]
impl<'a> Patch<'a> {
    #[inline(always)]
    fn new(template: &Template, now: &'a Level<CROP_SIDE>, corner: [i32; 2]) -> Self {
        let mut pixels = [[0.0; 8]; PATCH];
        for row in 0..PATCH {
            for k in 0..8 {
                pixels[row][k] = f32::from(template.pixels[row][k]);
            }
        }
        Self {
            now,
            corner,
            template: pixels,
            whole: None,
            wide: [[0.0; 16]; PATCH + 3],
            off: [[0.0; 8]; PATCH],
        }
    }

    /// A motion of whole pixels: nothing to interpolate.
    #[inline(always)]
    fn look_at_whole(&mut self, motion: [i32; 2]) {
        let rows = self
            .now
            .rows::<PATCH>(self.corner[0] + motion[0], self.corner[1] + motion[1]);
        for row in 0..PATCH {
            let now: &[u8; 8] = rows.at(row, 0);
            for k in 0..8 {
                self.off[row][k] = f32::from(now[k]) - self.template[row][k];
            }
        }
    }

    #[inline(always)]
    fn look_at(&mut self, motion_px: [f32; 2]) {
        let whole = [motion_px[0].floor(), motion_px[1].floor()];
        let [fx, fy] = [motion_px[0] - whole[0], motion_px[1] - whole[1]];
        self.read([whole[0] as i32, whole[1] as i32]);
        let [across, down] = [between(fx), between(fy)];
        let mut lines = [[0.0; 8]; PATCH + 3];
        for row in 0..PATCH + 3 {
            let wide = &self.wide[row];
            for k in 0..8 {
                lines[row][k] = (across[0] * wide[k] + across[1] * wide[k + 1])
                    + (across[2] * wide[k + 2] + across[3] * wide[k + 3]);
            }
        }
        for row in 0..PATCH {
            for k in 0..8 {
                self.off[row][k] = (down[0] * lines[row][k] + down[1] * lines[row + 1][k])
                    + (down[2] * lines[row + 2][k] + down[3] * lines[row + 3][k])
                    - self.template[row][k];
            }
        }
    }

    #[inline(always)]
    fn read(&mut self, whole: [i32; 2]) {
        if self.whole == Some(whole) {
            return;
        }
        self.whole = Some(whole);
        let rows = self
            .now
            .rows::<{ PATCH + 3 }>(self.corner[0] + whole[0] - 1, self.corner[1] + whole[1] - 1);
        for row in 0..PATCH + 3 {
            let now: &[u8; 16] = rows.at(row, 0);
            for k in 0..16 {
                self.wide[row][k] = f32::from(now[k]);
            }
        }
    }
}

/// Sum of the products.
#[expect(
    clippy::inline_always,
    reason = "compiled for the instruction set of its caller"
)]
#[inline(always)]
fn product(a: &[[f32; 8]; PATCH], b: &[[f32; 8]; PATCH]) -> f32 {
    let mut lanes = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        add(&mut lanes, a, b);
    }
    sum(&lanes)
}

/// Root of the sum of squares, rounded once.
#[inline]
fn length([x, y]: [f32; 2]) -> f32 {
    let [x, y] = [f64::from(x), f64::from(y)];
    (x * x + y * y).sqrt() as f32
}

/// Adds products lane by lane.
#[expect(
    clippy::inline_always,
    reason = "compiled for the instruction set of its caller"
)]
#[inline(always)]
fn add(sums: &mut [f32; 8], a: &[f32; 8], b: &[f32; 8]) {
    for k in 0..8 {
        sums[k] += a[k] * b[k];
    }
}

/// The lanes' sum, in pairs.
#[expect(
    clippy::inline_always,
    reason = "compiled for the instruction set of its caller"
)]
#[inline(always)]
fn sum(lanes: &[f32; 8]) -> f32 {
    let mut four = [0.0; 4];
    for k in 0..4 {
        four[k] = lanes[k] + lanes[k + 4];
    }
    (four[0] + four[2]) + (four[1] + four[3])
}

/// What the tracks of each cell say about the surface's motion.
#[derive(Debug, Clone)]
struct Votes {
    cast: Vec<[[f32; VOTES[1]]; 2]>,
    counts: Vec<usize>,
    medians: Vec<[f32; 2]>,
}

impl Votes {
    fn new() -> Self {
        Self {
            cast: vec![[[0.0; VOTES[1]]; 2]; CELLS * CELLS],
            counts: vec![0; CELLS * CELLS],
            medians: vec![[f32::NAN; 2]; CELLS * CELLS],
        }
    }

    fn clear(&mut self) {
        self.counts.fill(0);
    }

    fn cell(particle: &Particle) -> usize {
        let [column, row] = particle.pixel.map(|v| usize::from(v) / CELL);
        row * CELLS + column
    }

    fn cast(&mut self, particle: &Particle, track: &Track) {
        let cell = Self::cell(particle);
        let count = self.counts[cell];
        if track.confidence > 0.0 && count < VOTES[1] {
            let share = share(particle.depth_mm).max(0.3);
            for k in 0..2 {
                self.cast[cell][k][count] = track.motion_px[k] / share;
            }
            self.counts[cell] += 1;
        }
    }

    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn count(&mut self) {
        for ((median, cast), &count) in self.medians.iter_mut().zip(&mut self.cast).zip(&self.counts) {
            *median = [f32::NAN; 2];
            if count >= VOTES[0] {
                for (median, cast) in median.iter_mut().zip(cast) {
                    *median = middle(cast, count);
                }
            }
        }
    }

    /// NaN where too few voted.
    fn at(&self, particle: &Particle) -> [f32; 2] {
        self.medians[Self::cell(particle)]
    }
}

/// The middle one of the first `count` votes, of an even number the upper: the one with as many below it.
#[expect(
    clippy::inline_always,
    reason = "compiled for the instruction set of its caller"
)]
#[inline(always)]
fn middle(votes: &mut [f32; VOTES[1]], count: usize) -> f32 {
    votes[count..].fill(f32::INFINITY);
    let wanted = (count / 2) as u32;
    for &candidate in &votes[..count] {
        let (mut below, mut up_to) = (0, 0);
        for &vote in &*votes {
            below += u32::from(vote < candidate);
            up_to += u32::from(vote <= candidate);
        }
        if below <= wanted && wanted < up_to {
            return candidate;
        }
    }
    f32::NAN
}
