//! Tracks every particle of the rest image into the image now: coarse-to-fine block matching of its surroundings, a
//! whole-pixel search along the resulting ray, Lucas–Kanade on its own 7×7 pixels, and a vote with its neighbours. The
//! tracks depend on (rest, now) alone; what did not change since the last frame is kept.
//! Pixels of the crop. No allocation after [`Tracker::set_rest`].
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

use super::dirty_tiles::{DirtyTiles, TileRect};
use super::flow::{Flow, NodePosition, NodeRect};
use super::particles::{self, Particle};
use super::patch::{PatchWeights, Template};
use super::pyramid::Pyramid;
use super::search::{Match, Search, Track, motion_ratio};
use super::search_ray::length;
use crate::constants::CROP_SIDE;
use crate::error::NetworkError;
use crate::image::check_crop;
use crate::instruction_set::InstructionSet;
use crate::simd::{Dispatch, Simd, dispatch_256};

/// Depth of a particle that moves like the mean of its surroundings, mm.
const MEAN_DEPTH_MM: f32 = 3.2;
/// Side of the cells in which tracks must agree, pixels, and cells per side.
const CELL: usize = 40;
const CELLS: usize = CROP_SIDE / CELL;
/// Smallest number of votes that counts in a cell, and the largest that are collected.
const VOTES_MIN: usize = 5;
const VOTES_MAX: usize = 32;

/// A particle that can be tracked.
#[derive(Debug, Clone)]
struct TrackedParticle {
    /// Its index among all particles.
    index: usize,
    particle: Particle,
    /// Where the coarse flow gives the motion of its surroundings.
    flow_position: NodePosition,
    template: Template,
    /// Searched with the motion of its surroundings.
    first: Match,
    /// Searched with the motion that its cell voted for, when the first match contradicts it.
    second: Match,
}

/// The particles of a square of the image, which have to agree.
#[derive(Debug, Clone)]
struct Cell {
    particles: Vec<TrackedParticle>,
    /// The tiles and the flow nodes that the matches depend on.
    tiles: TileRect,
    nodes: NodeRect,
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
    weights: PatchWeights,
    /// Whether `now` and the matches are those of the last frame.
    valid: bool,
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
            weights: PatchWeights::new(),
            valid: false,
            instructions: InstructionSet::widest(),
        }
    }

    /// Uses another instruction set than the widest available. Tracks are the same, bit by bit.
    ///
    /// # Errors
    /// When the processor does not have it.
    pub fn with_instructions(mut self, instructions: InstructionSet) -> Result<Self, NetworkError> {
        self.instructions = instructions.checked()?;
        Ok(self)
    }

    /// Detects the particles of the untouched sensor in a 440×440 image.
    ///
    /// # Panics
    /// When `rest` is not 440×440 bytes.
    pub fn set_rest(&mut self, rest: &[u8]) {
        check_crop(rest);
        self.rest.update(rest, &DirtyTiles::all());
        let image = &self.rest.full;
        self.particles = particles::detect(image);
        self.cells = (0..CELLS * CELLS)
            .map(|cell| {
                let corner = [cell % CELLS, cell / CELLS].map(|at| (at * CELL) as f32);
                Cell {
                    particles: Vec::new(),
                    tiles: TileRect::ALL,
                    nodes: Flow::nodes_between(corner, corner.map(|at| at + CELL as f32)),
                }
            })
            .collect();
        for (index, particle) in self.particles.iter().enumerate() {
            let [column, row] = particle.pixel.map(|at| usize::from(at) / CELL);
            if let Some(template) = Template::new(image, particle, &self.weights) {
                self.cells[row * CELLS + column].particles.push(TrackedParticle {
                    index,
                    particle: *particle,
                    flow_position: Flow::position(particle.at_px),
                    template,
                    first: Match::none(),
                    second: Match::none(),
                });
            }
        }
        self.cells.retain(|cell| !cell.particles.is_empty());
        self.tracks = vec![Track::default(); self.particles.len()];
        self.valid = false;
    }

    /// The particles at rest.
    #[must_use]
    pub fn particles(&self) -> &[Particle] {
        &self.particles
    }

    /// Their tracks, in the same order.
    #[must_use]
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// Discards the last frame, so that the next one is tracked as a whole.
    pub fn invalidate(&mut self) {
        self.valid = false;
    }

    /// Tracks the particles into a 440×440 image. Returns whether any track can have changed.
    ///
    /// # Panics
    /// When `now` is not 440×440 bytes.
    pub fn track(&mut self, now: &[u8]) -> bool {
        check_crop(now);
        dispatch_256(self.instructions, TrackFrame { tracker: self, now })
    }

    #[inline(always)]
    fn track_with<S: Simd>(&mut self, now: &[u8]) -> bool {
        let dirty = if self.valid {
            DirtyTiles::between(&self.now.full, now)
        } else {
            DirtyTiles::all()
        };
        if dirty.is_empty() {
            return false;
        }
        self.valid = true;
        let dirty = &dirty;
        self.now.update(now, dirty);
        self.flow.update::<S>(&self.rest, &self.now, dirty);
        let search = Search {
            weights: &self.weights,
            now: &self.now.full,
        };
        let mean_ratio = motion_ratio(MEAN_DEPTH_MM);
        for cell in &mut self.cells {
            if !self.flow.changed_in(cell.nodes) && !dirty.any_in(cell.tiles) {
                continue;
            }
            let mut votes = Votes::new();
            for tracked in &mut cell.particles {
                let surface_px = self.flow.at(tracked.flow_position).map(|v| v / mean_ratio);
                search.update::<S>(
                    &mut tracked.first,
                    &tracked.template,
                    &tracked.particle,
                    surface_px,
                    dirty,
                );
                votes.cast(&tracked.particle, &tracked.first.track);
            }
            let voted_px = votes.median();
            cell.tiles = TileRect::NONE;
            for tracked in &mut cell.particles {
                let mut track = tracked.first.track;
                cell.tiles = cell.tiles.union(tracked.first.tiles());
                if contradicts(&track, voted_px) {
                    search.update::<S>(
                        &mut tracked.second,
                        &tracked.template,
                        &tracked.particle,
                        voted_px,
                        dirty,
                    );
                    cell.tiles = cell.tiles.union(tracked.second.tiles());
                    track = tracked.second.track;
                    if contradicts(&track, voted_px) {
                        track.confidence = 0.0;
                    }
                } else {
                    // It misses what changes now.
                    tracked.second.invalidate();
                }
                self.tracks[tracked.index] = track;
            }
        }
        true
    }
}

/// Runs [`Tracker::track_with`].
struct TrackFrame<'a> {
    tracker: &'a mut Tracker,
    now: &'a [u8],
}

impl Dispatch for TrackFrame<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd>(self) -> bool {
        self.tracker.track_with::<S>(self.now)
    }
}

/// Whether a track is lost, or impossible at any depth below a surface that moves like this. NaN (no vote) contradicts
/// nothing.
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

/// The motions of the surface that the tracks of a cell suggest.
struct Votes {
    motions_px: [[f32; VOTES_MAX]; 2],
    count: usize,
}

impl Votes {
    fn new() -> Self {
        Self {
            motions_px: [[0.0; VOTES_MAX]; 2],
            count: 0,
        }
    }

    fn cast(&mut self, particle: &Particle, track: &Track) {
        if track.confidence > 0.0 && self.count < VOTES_MAX {
            let ratio = motion_ratio(particle.depth_mm).max(0.3);
            for k in 0..2 {
                self.motions_px[k][self.count] = track.motion_px[k] / ratio;
            }
            self.count += 1;
        }
    }

    /// The median; NaN if too few voted.
    #[inline(always)]
    fn median(&mut self) -> [f32; 2] {
        if self.count < VOTES_MIN {
            return [f32::NAN; 2];
        }
        [0, 1].map(|k| median_of(&mut self.motions_px[k], self.count))
    }
}

/// The (upper) median of the first `count` votes.
#[inline(always)]
fn median_of(votes: &mut [f32; VOTES_MAX], count: usize) -> f32 {
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
