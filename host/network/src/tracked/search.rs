//! Where a particle went if the surface above it moved like this: the best whole pixel along that way for its depth, then
//! least squares between pixels. What of it follows from parts of the image that did not change is kept.

use super::changed::{Changed, Tiles, same};
use super::compare::difference;
use super::particles::Particle;
use super::patch::{HALF, Patch, Template, Weights, product};
use super::pyramid::Level;
use crate::constants::CROP_SIDE;

/// Most Gauss–Newton steps, and the step that is small enough, pixels.
const STEPS: usize = 5;
const SMALL_STEP: f32 = 0.01;
/// Farthest that least squares may go from the whole pixel it started at.
const FARTHEST_STEP: f32 = 2.0;
/// Cost of a pixel off the expected place along the way and, squared, across it; sums of absolute grey levels.
const PRIOR: [f32; 2] = [10.0, 10.0];
/// Share of its contrast that a patch must explain: at rest or nearly, and on a long way, where others look alike.
const LEAST_CONFIDENCE: [f32; 2] = [0.6, 0.85];
/// From this motion of the surface on a way is long, pixels.
const LONG: f32 = 4.0;
/// Thickness of the skin's soft part, mm: the base does not move.
const THICKNESS_MM: f32 = 6.0;

/// Where a particle went.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Track {
    /// Motion since rest, pixels.
    pub motion_px: [f32; 2],
    /// Share of the patch's contrast that the match explains; 0 for the lost and the doubtful.
    pub confidence: f32,
}

/// A search's result, the motion of the surface that it was made for, and the tiles that its two parts looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Found {
    surface_px: [f32; 2],
    tiles: Tiles,
    start: Option<Start>,
    refined_tiles: Tiles,
    pub(super) track: Track,
}

/// The best whole pixel, and whether the way there is [`LONG`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Start {
    motion: [i32; 2],
    long: bool,
}

impl Found {
    /// Nothing is known of this particle.
    pub(super) fn nothing() -> Self {
        Self {
            surface_px: [f32::NAN; 2],
            tiles: Tiles::ALL,
            start: None,
            refined_tiles: Tiles::ALL,
            track: Track::default(),
        }
    }

    /// Has the next search begin anew.
    pub(super) fn forget(&mut self) {
        self.surface_px = [f32::NAN; 2];
        self.refined_tiles = Tiles::ALL;
    }

    /// The tiles that it looked at.
    pub(super) fn seen(&self) -> Tiles {
        self.tiles.hull(self.refined_tiles)
    }
}

/// Pixels that least squares can read beyond the patch at the whole pixel where it starts: two steps, and two for the
/// parts of a pixel.
const REFINED_PX: i32 = 4;

/// Where a patch of the particle can be read when it moves by something between these two.
#[inline]
fn patch_tiles(particle: &Particle, least: [i32; 2], most: [i32; 2]) -> Tiles {
    let at = particle.pixel.map(i32::from);
    // The eighth place of a patch's rows is read too.
    Tiles::between(
        [0, 1].map(|k| at[k] + least[k] - HALF),
        [0, 1].map(|k| at[k] + most[k] + HALF + 1),
    )
}

/// The places at which a particle is looked for when the surface above it moved: between none and the whole motion, a
/// little more, and a little to the sides.
struct Way {
    /// Direction of the surface's motion.
    along: [f32; 2],
    length: f32,
    /// From here to there along it, whole pixels.
    ends: [f32; 2],
    /// So far to both sides.
    aside: f32,
}

impl Way {
    #[inline]
    fn new(surface_px: [f32; 2]) -> Self {
        let length = length(surface_px);
        Self {
            along: if length > 0.0 {
                surface_px.map(|v| v / length)
            } else {
                [1.0, 0.0]
            },
            length,
            ends: [(-0.15 * length - 1.5).floor(), (1.15 * length + 1.5).ceil()],
            aside: (1.0 + 0.2 * length).min(4.0).floor(),
        }
    }

    /// The tiles that the whole pixels along it look at.
    #[inline]
    fn tiles(&self, particle: &Particle) -> Tiles {
        let [x, y] = self.along;
        let [mut least, mut most] = [[0; 2]; 2];
        for (k, (forth, sideways)) in [(x, y), (y, x)].into_iter().enumerate() {
            let [a, b] = self.ends.map(|end| end * forth);
            let aside = self.aside * sideways.abs();
            (least[k], most[k]) = (nearest(a.min(b) - aside), nearest(a.max(b) + aside));
        }
        patch_tiles(particle, least, most)
    }
}

/// Looks for patches in an image.
pub(super) struct Search<'a> {
    pub(super) weights: &'a Weights,
    pub(super) now: &'a Level<CROP_SIDE>,
}

impl Search<'_> {
    /// Brings a search up to date: where the particle went if the surface above it moved by `surface_px`, about. Each of
    /// its two parts is done again only if what it was made from changed.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    pub(super) fn update(
        &self,
        found: &mut Found,
        template: &Template,
        particle: &Particle,
        surface_px: [f32; 2],
        changed: &Changed,
    ) {
        let moved = !same(surface_px, found.surface_px);
        let mut start = found.start;
        if moved || changed.any(found.tiles) {
            let way = Way::new(surface_px);
            if moved {
                found.surface_px = surface_px;
                found.tiles = way.tiles(particle);
            }
            start = self.whole_pixel(template, particle, &way).map(|motion| Start {
                motion,
                long: way.length > LONG,
            });
        }
        if start == found.start && !changed.any(found.refined_tiles) {
            return;
        }
        found.start = start;
        let motion = start.map_or([0; 2], |start| start.motion);
        found.refined_tiles = patch_tiles(
            particle,
            motion.map(|v| v - REFINED_PX),
            motion.map(|v| v + REFINED_PX),
        );
        found.track = start.map_or_else(Track::default, |Start { motion, long }| {
            self.refine(template, particle, motion, LEAST_CONFIDENCE[usize::from(long)])
        });
    }

    /// The whole-pixel motion with the least difference: anywhere between none and the surface's motion, and a little
    /// to the sides, rather where the particle's depth suggests.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    fn whole_pixel(&self, template: &Template, particle: &Particle, way: &Way) -> Option<[i32; 2]> {
        let Way {
            along: [x, y],
            length,
            ends: [from, to],
            aside,
        } = *way;
        let expected = share(particle.depth_mm) * length;
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

/// Share of the surface's motion that a particle at this depth takes part in: a line to the base.
pub(super) fn share(depth_mm: f32) -> f32 {
    1.0 - depth_mm / THICKNESS_MM
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

/// Root of the sum of squares, rounded once.
#[inline]
pub(super) fn length([x, y]: [f32; 2]) -> f32 {
    let [x, y] = [f64::from(x), f64::from(y)];
    (x * x + y * y).sqrt() as f32
}
