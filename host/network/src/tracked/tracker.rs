//! Finds every particle of the rest image again in the image now: where its surroundings went (block matching, coarse
//! to fine), the best whole pixel along that way for its depth, then least squares of its own 7×7 pixels, then whether
//! its neighbours agree. The tracks follow from (rest, now) alone; what did not change since the last image is kept.
//! Pixels of the crop. No allocation after [`Tracker::set_rest`].

use super::changed::{Changed, Tiles};
#[cfg(target_arch = "x86_64")]
use super::compare::Avx2;
use super::compare::{Compare, Plain};
use super::flow::{Between, Flow, NodeRange};
use super::particles::{self, Particle};
use super::patch::{Template, Weights};
use super::pyramid::Pyramid;
use super::search::{Found, Search, Track, share};
use super::way::length;
use crate::constants::CROP_SIDE;
use crate::instruction_set::{InstructionSet, InstructionSetError};

/// Depth of a particle that moves as its surroundings do on the mean, mm.
const MEAN_DEPTH_MM: f32 = 3.2;
/// Pixels a side of the cells within which tracks must agree, and cells a side.
const CELL: usize = 40;
const CELLS: usize = CROP_SIDE / CELL;
/// Fewest tracks of a cell that can outvote one, and most that are heard.
const VOTES: [usize; 2] = [5, 32];

/// A particle that can be followed, and the searches for it.
#[derive(Debug, Clone)]
struct Sought {
    /// Its place among all particles.
    index: usize,
    particle: Particle,
    /// The nodes of the flow that tell how its surroundings move.
    between: Between,
    template: Template,
    /// By the motion of the surroundings.
    first: Found,
    /// By what the cell said the surface's motion is, if the first track contradicts that.
    again: Found,
}

/// The particles of a square of the image, which have to agree.
#[derive(Debug, Clone)]
struct Cell {
    sought: Vec<Sought>,
    /// What the searches looked at, and the nodes of the flow that they went by.
    tiles: Tiles,
    nodes: NodeRange,
}

/// The tracker with its images, particles and tracks.
#[derive(Debug, Clone)]
pub struct Tracker {
    rest: Pyramid,
    now: Pyramid,
    flow: Flow,
    particles: Vec<Particle>,
    cells: Vec<Cell>,
    tracks: Vec<Track>,
    weights: Weights,
    /// Whether `now` holds an image since the rest image was taken.
    known: bool,
    instructions: InstructionSet,
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
            cells: Vec::new(),
            tracks: Vec::new(),
            weights: Weights::new(),
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
        self.rest.take(rest, &Changed::everything());
        let image = &self.rest.full;
        self.particles = particles::find(image);
        self.cells = (0..CELLS * CELLS)
            .map(|cell| {
                let corner = [cell % CELLS, cell / CELLS].map(|at| (at * CELL) as f32);
                Cell {
                    sought: Vec::new(),
                    tiles: Tiles::ALL,
                    nodes: Flow::nodes(corner, corner.map(|at| at + CELL as f32)),
                }
            })
            .collect();
        for (index, particle) in self.particles.iter().enumerate() {
            let [column, row] = particle.pixel.map(|at| usize::from(at) / CELL);
            if let Some(template) = Template::new(image, particle, &self.weights) {
                self.cells[row * CELLS + column].sought.push(Sought {
                    index,
                    particle: *particle,
                    between: Flow::between(particle.at_px),
                    template,
                    first: Found::nothing(),
                    again: Found::nothing(),
                });
            }
        }
        self.cells.retain(|cell| !cell.sought.is_empty());
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
        match self.instructions {
            InstructionSet::Portable => self.follow::<Plain>(now),
            // Most vectors here are eight numbers wide: wider ones gain nothing.
            #[cfg(target_arch = "x86_64")]
            #[expect(unsafe_code, reason = "compiled for an instruction set that was checked for")]
            // SAFETY: the processor has it, or it would not have been taken; AVX-512F implies AVX2.
            InstructionSet::Avx2 | InstructionSet::Avx512 => unsafe { self.follow_avx2(now) },
            #[cfg(not(target_arch = "x86_64"))]
            InstructionSet::Avx2 | InstructionSet::Avx512 => self.follow::<Plain>(now),
        }
    }

    /// The same operations in the same order, so the same bits.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn follow_avx2(&mut self, now: &[u8]) -> bool {
        self.follow::<Avx2>(now)
    }

    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn follow<C: Compare>(&mut self, now: &[u8]) -> bool {
        let changed = if self.known {
            Changed::between(&self.now.full, now)
        } else {
            Changed::everything()
        };
        if changed.nothing() {
            return false;
        }
        self.known = true;
        let changed = &changed;
        self.now.take(now, changed);
        self.flow.find::<C>(&self.rest, &self.now, changed);
        let search = Search {
            weights: &self.weights,
            now: &self.now.full,
        };
        let mean_share = share(MEAN_DEPTH_MM);
        for cell in &mut self.cells {
            if !self.flow.moved(cell.nodes) && !changed.any(cell.tiles) {
                continue;
            }
            let mut votes = Votes::new();
            for sought in &mut cell.sought {
                let surface_px = self.flow.at(sought.between).map(|v| v / mean_share);
                search.update::<C>(
                    &mut sought.first,
                    &sought.template,
                    &sought.particle,
                    surface_px,
                    changed,
                );
                votes.cast(&sought.particle, &sought.first.track);
            }
            let voted_px = votes.median();
            cell.tiles = Tiles::NONE;
            for sought in &mut cell.sought {
                let mut track = sought.first.track;
                cell.tiles = cell.tiles.hull(sought.first.seen());
                if contradicts(&track, voted_px) {
                    search.update::<C>(
                        &mut sought.again,
                        &sought.template,
                        &sought.particle,
                        voted_px,
                        changed,
                    );
                    cell.tiles = cell.tiles.hull(sought.again.seen());
                    track = sought.again.track;
                    if contradicts(&track, voted_px) {
                        track.confidence = 0.0;
                    }
                } else {
                    // What changes now it does not see.
                    sought.again.forget();
                }
                self.tracks[sought.index] = track;
            }
        }
        true
    }
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

/// What the tracks of a cell say about the surface's motion.
struct Votes {
    cast: [[f32; VOTES[1]]; 2],
    count: usize,
}

impl Votes {
    fn new() -> Self {
        Self {
            cast: [[0.0; VOTES[1]]; 2],
            count: 0,
        }
    }

    fn cast(&mut self, particle: &Particle, track: &Track) {
        if track.confidence > 0.0 && self.count < VOTES[1] {
            let share = share(particle.depth_mm).max(0.3);
            for k in 0..2 {
                self.cast[k][self.count] = track.motion_px[k] / share;
            }
            self.count += 1;
        }
    }

    /// The median; NaN where too few voted.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn median(&mut self) -> [f32; 2] {
        if self.count < VOTES[0] {
            return [f32::NAN; 2];
        }
        [0, 1].map(|k| middle(&mut self.cast[k], self.count))
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
