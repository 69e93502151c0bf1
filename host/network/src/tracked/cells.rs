//! The particles in squares of the image, and their search: each with the motion of its surroundings, then a vote of the square,
//! then those that contradict it once more. No square depends on another, so the threads of a pool can share them.
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

use gripline_kernels::InstructionSet;
use gripline_kernels::simd::{Dispatch, Simd, dispatch_256};

use super::dirty_tiles::{DirtyTiles, TileRect};
use super::flow::{Flow, NodePosition, NodeRect};
use super::level::Level;
use super::particles::Particle;
use super::patch::{PatchWeights, Template};
use super::search::{Match, Search, Track, motion_ratio};
use super::search_ray::length;
use super::share::share;
use crate::constants::CROP_SIDE;

/// Depth of a particle that moves like the mean of its surroundings, mm.
const MEAN_DEPTH_MM: f32 = 3.2;
/// Side of the cells in which tracks must agree, pixels, and cells per side.
const CELL: usize = 40;
const CELLS: usize = CROP_SIDE / CELL;
/// Smallest number of votes that counts in a cell, and the largest that are collected.
const VOTES_MIN: usize = 5;
const VOTES_MAX: usize = 32;
/// What a thread takes at a time: about 50 µs of work, so that none waits long for the last one.
const CELLS_AT_ONCE: usize = 8;

/// A particle that can be tracked. Its template, which is large, lies apart: it is read only when the particle is searched.
#[derive(Debug, Clone)]
struct TrackedParticle {
    /// Its index among all particles.
    index: usize,
    particle: Particle,
    /// Where the coarse flow gives the motion of its surroundings.
    flow_position: NodePosition,
    /// Searched with the motion of its surroundings.
    first: Match,
    /// Searched with the motion that its cell voted for, when the first match contradicts it.
    second: Match,
    /// What both come to.
    track: Track,
}

/// The particles of a square of the image, which have to agree.
#[derive(Debug, Clone)]
pub(super) struct Cell {
    particles: Vec<TrackedParticle>,
    /// Theirs, in the same order.
    templates: Vec<Template>,
    /// The tiles and the flow nodes that the matches depend on.
    tiles: TileRect,
    nodes: NodeRect,
    /// Whether a track can have changed in the last search.
    changed: bool,
}

impl Cell {
    /// The cells of an image at rest that have particles.
    pub(super) fn all(image: &Level<CROP_SIDE>, particles: &[Particle], weights: &PatchWeights) -> Vec<Self> {
        let mut cells: Vec<_> = (0..CELLS * CELLS)
            .map(|cell| {
                let corner = [cell % CELLS, cell / CELLS].map(|at| (at * CELL) as f32);
                Self {
                    particles: Vec::new(),
                    templates: Vec::new(),
                    tiles: TileRect::ALL,
                    nodes: Flow::nodes_between(corner, corner.map(|at| at + CELL as f32)),
                    changed: false,
                }
            })
            .collect();
        for (index, particle) in particles.iter().enumerate() {
            let [column, row] = particle.pixel.map(|at| usize::from(at) / CELL);
            if let Some(template) = Template::new(image, particle, weights) {
                let cell = &mut cells[row * CELLS + column];
                cell.templates.push(template);
                cell.particles.push(TrackedParticle {
                    index,
                    particle: *particle,
                    flow_position: Flow::position(particle.at_px),
                    first: Match::none(),
                    second: Match::none(),
                    track: Track::default(),
                });
            }
        }
        cells.retain(|cell| !cell.particles.is_empty());
        cells
    }

    /// The tracks that can have changed in the last search, by the particle's index.
    pub(super) fn changed_tracks(&self) -> impl Iterator<Item = (usize, Track)> {
        let particles = if self.changed { &*self.particles } else { &[] };
        particles.iter().map(|tracked| (tracked.index, tracked.track))
    }
}

/// What the search of all cells shares.
#[derive(Clone, Copy)]
pub(super) struct CellSearch<'a> {
    pub(super) flow: &'a Flow,
    pub(super) now: &'a Level<CROP_SIDE>,
    pub(super) weights: &'a PatchWeights,
    pub(super) dirty: &'a DirtyTiles,
    pub(super) instructions: InstructionSet,
}

impl CellSearch<'_> {
    /// Searches what changed in the cells. The threads of the caller's pool help; the tracks are the same.
    pub(super) fn update(self, cells: &mut [Cell]) {
        share(cells, CELLS_AT_ONCE, self.dirty, &|cells| {
            let task = UpdateCells { search: self, cells };
            dispatch_256(self.instructions, task);
        });
    }

    #[inline(always)]
    fn update_with<S: Simd>(self, cells: &mut [Cell]) {
        let Self { flow, dirty, .. } = self;
        let mut search = Search::new(self.weights, self.now);
        let mean_ratio = motion_ratio(MEAN_DEPTH_MM);
        for cell in cells {
            cell.changed = false;
            let moved = flow.changed_in(cell.nodes);
            if !moved && !dirty.any_in(cell.tiles) {
                continue;
            }
            let mut changed = false;
            for (tracked, template) in cell.particles.iter_mut().zip(&cell.templates) {
                let surface_px = flow.at(tracked.flow_position).map(|v| v / mean_ratio);
                changed |=
                    search.update::<S>(&mut tracked.first, template, &tracked.particle, surface_px, dirty);
                changed |= tracked.second.is_searched() && dirty.any_in(tracked.second.tiles());
            }
            if !changed {
                // All that the vote and the second matches depend on is as it was.
                continue;
            }
            cell.changed = true;
            let mut votes = Votes::new();
            for tracked in &cell.particles {
                votes.cast(&tracked.particle, &tracked.first.track);
            }
            let voted_px = votes.median();
            cell.tiles = TileRect::NONE;
            for (tracked, template) in cell.particles.iter_mut().zip(&cell.templates) {
                let mut track = tracked.first.track;
                cell.tiles = cell.tiles.union(tracked.first.tiles());
                if contradicts(&track, tracked.particle.depth_mm, voted_px) {
                    search.update::<S>(&mut tracked.second, template, &tracked.particle, voted_px, dirty);
                    cell.tiles = cell.tiles.union(tracked.second.tiles());
                    track = tracked.second.track;
                    if contradicts(&track, tracked.particle.depth_mm, voted_px) {
                        track.confidence = 0.0;
                    }
                } else {
                    // It misses what changes now.
                    tracked.second.invalidate();
                }
                tracked.track = track;
            }
        }
    }
}

/// Runs [`CellSearch::update_with`].
struct UpdateCells<'a> {
    search: CellSearch<'a>,
    cells: &'a mut [Cell],
}

impl Dispatch for UpdateCells<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        self.search.update_with::<S>(self.cells);
    }
}

/// Whether a track is lost, or too far from what the particle's depth suggests below a surface that moves like this: by more than
/// 4½ times the error of a depth from brightness, or to the sides. NaN (no vote) contradicts nothing.
fn contradicts(track: &Track, depth_mm: f32, [x, y]: [f32; 2]) -> bool {
    if x.is_nan() {
        return false;
    }
    let length = length([x, y]).max(1e-3);
    let [u, v] = track.motion_px;
    let along = (u * x + v * y) / length;
    let across = (u * y - v * x) / length;
    track.confidence == 0.0
        || (along - motion_ratio(depth_mm) * length).abs() > 0.6 * length + 1.0
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
        // A closure would compile for another instruction set.
        let [x, y] = &mut self.motions_px;
        [median_of(x, self.count), median_of(y, self.count)]
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_track_contradicts_its_neighbours_when_it_is_far_from_what_its_depth_suggests() {
        let track = |x: f32, y: f32| Track {
            motion_px: [x, y],
            confidence: 0.9,
        };
        // The surface has moved by 20 pixels, a particle in the middle by half of that.
        let contradicts_at = |x, y, depth_mm| contradicts(&track(x, y), depth_mm, [20.0, 0.0]);
        assert!(!contradicts_at(10.0, 0.0, 3.0));
        assert!(!contradicts_at(22.5, 7.5, 3.0));
        assert!(contradicts_at(23.5, 0.0, 3.0));
        assert!(contradicts_at(-3.5, 0.0, 3.0));
        assert!(contradicts_at(10.0, 8.5, 3.0));
        assert!(contradicts_at(0.0, 0.0, 0.3), "near the surface it moves with it");
        assert!(contradicts_at(15.0, 0.0, 5.7), "near the base it stays");
        assert!(contradicts(&Track::default(), 3.0, [0.0; 2]), "lost");
        assert!(!contradicts(&Track::default(), 3.0, [f32::NAN; 2]), "no vote");
    }
}
