//! Tracks every particle of the rest image into the image now: coarse-to-fine block matching of its surroundings, a
//! whole-pixel search along the resulting ray, Lucas–Kanade on its own 7×7 pixels, and a vote with its neighbours. The
//! tracks depend on (rest, now) alone; what did not change since the last frame is kept, tiles that differ by no more than noise
//! among it, when these are to count as unchanged.
//! Pixels of the crop. No allocation after [`Tracker::set_rest`].
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

use gripline_kernels::InstructionSet;
use gripline_kernels::simd::{Dispatch, Simd, dispatch_256};

use super::dirty_tiles::{self, DirtyTiles, TILES, TileRect};
use super::flow::{Flow, NodePosition, NodeRect};
use super::level::Level;
use super::particles::{self, Particle};
use super::patch::{PatchWeights, Template};
use super::pyramid::Pyramid;
use super::search::{Match, Search, Track, motion_ratio};
use super::search_ray::length;
use super::tile_noise::TileNoise;
use crate::constants::CROP_SIDE;
use crate::error::NetworkError;
use crate::image::check_crop;

/// Depth of a particle that moves like the mean of its surroundings, mm.
const MEAN_DEPTH_MM: f32 = 3.2;
/// Side of the cells in which tracks must agree, pixels, and cells per side.
const CELL: usize = 40;
const CELLS: usize = CROP_SIDE / CELL;
/// Below the noise a motion of up to a tenth of a pixel can hide. It stays hidden no longer than this many pictures, a third of a second
/// at 60 a second: then everything is tracked again.
const REFRESH: u32 = 20;
/// The same when a motion has ended, which leaves the most: in the first picture in which no more than these tiles changed.
const MOVING_TILES: u16 = (TILES * TILES / 32) as u16;
/// Smallest number of votes that counts in a cell, and the largest that are collected.
const VOTES_MIN: usize = 5;
const VOTES_MAX: usize = 32;

/// What counts as a change of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Changes {
    /// Every difference.
    Any,
    /// What the camera's noise does not explain, as far as the noise is known.
    BeyondNoise,
}

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
}

/// The particles of a square of the image, which have to agree.
#[derive(Debug, Clone)]
struct Cell {
    particles: Vec<TrackedParticle>,
    /// Theirs, in the same order.
    templates: Vec<Template>,
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
    noise: TileNoise,
    /// Whether noise is learnt from the frames.
    learns_noise: bool,
    /// Whether `now` and the matches are those of the last frame.
    valid: bool,
    /// Pictures since everything was tracked, and whether in the last one more than [`MOVING_TILES`] changed.
    since_refresh: u32,
    moving: bool,
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
            noise: TileNoise::unknown(),
            learns_noise: true,
            valid: false,
            since_refresh: 0,
            moving: false,
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
                    templates: Vec::new(),
                    tiles: TileRect::ALL,
                    nodes: Flow::nodes_between(corner, corner.map(|at| at + CELL as f32)),
                }
            })
            .collect();
        for (index, particle) in self.particles.iter().enumerate() {
            let [column, row] = particle.pixel.map(|at| usize::from(at) / CELL);
            if let Some(template) = Template::new(image, particle, &self.weights) {
                let cell = &mut self.cells[row * CELLS + column];
                cell.templates.push(template);
                cell.particles.push(TrackedParticle {
                    index,
                    particle: *particle,
                    flow_position: Flow::position(particle.at_px),
                    first: Match::none(),
                    second: Match::none(),
                });
            }
        }
        self.cells.retain(|cell| !cell.particles.is_empty());
        self.tracks = vec![Track::default(); self.particles.len()];
        self.noise = TileNoise::unknown();
        self.learns_noise = true;
        self.valid = false;
    }

    /// Learns the camera's noise from pictures at rest, in the order of capture. Without it, or with fewer than two, the noise is
    /// learnt from the frames that are tracked.
    ///
    /// # Panics
    /// When one is not 440×440 bytes.
    pub fn learn_noise(&mut self, rest: &[Vec<u8>]) {
        let mut noise = TileNoise::unknown();
        let mut level = Level::new();
        for pair in rest.windows(2) {
            for picture in pair {
                check_crop(picture);
            }
            for row in 0..CROP_SIDE {
                level
                    .row_mut(row)
                    .copy_from_slice(&pair[0][row * CROP_SIDE..][..CROP_SIDE]);
            }
            noise.learn(&dirty_tiles::differences(&level, &pair[1]));
        }
        noise.close_window();
        self.learns_noise = !noise.is_known();
        self.noise = noise;
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

    /// [`Self::track_beyond_noise`] takes nothing for noise in the next picture.
    pub fn refresh_next(&mut self) {
        self.since_refresh = REFRESH;
    }

    /// Tracks the particles into a 440×440 image. Returns whether any track can have changed.
    ///
    /// # Panics
    /// When `now` is not 440×440 bytes.
    pub fn track(&mut self, now: &[u8]) -> bool {
        self.track_changes(now, Changes::Any)
    }

    /// The same, but what differs from the frame before by no more than the camera's noise counts as unchanged: there the tracks are
    /// those of the picture that was tracked last.
    ///
    /// # Panics
    /// When `now` is not 440×440 bytes.
    pub fn track_beyond_noise(&mut self, now: &[u8]) -> bool {
        self.track_changes(now, Changes::BeyondNoise)
    }

    fn track_changes(&mut self, now: &[u8], changes: Changes) -> bool {
        check_crop(now);
        let task = TrackFrame {
            tracker: self,
            now,
            changes,
        };
        dispatch_256(task.tracker.instructions, task)
    }

    #[inline(always)]
    fn track_with<S: Simd>(&mut self, now: &[u8], changes: Changes) -> bool {
        let dirty = match changes {
            _ if !self.valid => {
                (self.since_refresh, self.moving) = (0, false);
                DirtyTiles::all()
            }
            Changes::Any => DirtyTiles::between(&self.now.full, now),
            Changes::BeyondNoise => {
                let differences = dirty_tiles::differences(&self.now.full, now);
                let dirty = DirtyTiles::of(&self.noise.changed(&differences));
                // A picture that is shown twice says nothing.
                if self.learns_noise && (!dirty.is_empty() || self.noise.is_known()) {
                    self.noise.learn(&differences);
                }
                self.since_refresh += 1;
                let moves = dirty.count() > MOVING_TILES;
                let ended = std::mem::replace(&mut self.moving, moves) && !moves;
                if ended || self.since_refresh >= REFRESH {
                    self.since_refresh = 0;
                    DirtyTiles::of(&differences.map(|row| row.map(|difference| difference > 0)))
                } else {
                    dirty
                }
            }
        };
        if dirty.is_empty() {
            return false;
        }
        self.valid = true;
        let dirty = &dirty;
        self.now.update(now, dirty);
        self.flow.update::<S>(&self.rest, &self.now, dirty);
        let mut search = Search::new(&self.weights, &self.now.full);
        let mean_ratio = motion_ratio(MEAN_DEPTH_MM);
        for cell in &mut self.cells {
            let moved = self.flow.changed_in(cell.nodes);
            if !moved && !dirty.any_in(cell.tiles) {
                continue;
            }
            let mut changed = false;
            for (tracked, template) in cell.particles.iter_mut().zip(&cell.templates) {
                let surface_px = self.flow.at(tracked.flow_position).map(|v| v / mean_ratio);
                changed |=
                    search.update::<S>(&mut tracked.first, template, &tracked.particle, surface_px, dirty);
                changed |= tracked.second.is_searched() && dirty.any_in(tracked.second.tiles());
            }
            if !changed {
                // All that the vote and the second matches depend on is as it was.
                continue;
            }
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
    changes: Changes,
}

impl Dispatch for TrackFrame<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd>(self) -> bool {
        self.tracker.track_with::<S>(self.now, self.changes)
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

    const SIDE: usize = CROP_SIDE;

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

    /// Numbers below 1 without a pattern.
    fn unit(state: &mut u64) -> f32 {
        *state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (*state >> 40) as f32 / (1 << 24) as f32
    }

    /// Spots on a dark ground; those in a square of 120 pixels are moved by this many.
    fn spots(moved_px: f32) -> Vec<f32> {
        let mut levels = vec![20.0; SIDE * SIDE];
        let mut state = 5;
        for _ in 0..2_500 {
            let [mut x, y] = [0, 1].map(|_| 8.0 + unit(&mut state) * (SIDE as f32 - 16.0));
            let level = 90.0 + 80.0 * unit(&mut state);
            if [x, y].iter().all(|at| (160.0..280.0).contains(at)) {
                x += moved_px;
            }
            for row in y as usize - 5..y as usize + 6 {
                for column in x as usize - 5..x as usize + 6 {
                    let [dx, dy] = [column as f32 + 0.5 - x, row as f32 + 0.5 - y];
                    let cover = (-(dx * dx + dy * dy) / (2.0 * 1.2 * 1.2)).exp();
                    let pixel = &mut levels[row * SIDE + column];
                    *pixel += cover * (level - *pixel).max(0.0);
                }
            }
        }
        levels
    }

    /// With noise of two levels.
    fn taken(levels: &[f32], state: &mut u64) -> Vec<u8> {
        let noise = |state: &mut u64| (0..12).map(|_| unit(state)).sum::<f32>() - 6.0;
        levels
            .iter()
            .map(|level| (level + 2.0 * noise(state)).round() as u8)
            .collect()
    }

    fn bits(tracker: &Tracker) -> Vec<[u32; 3]> {
        let [x, y] = [0, 1].map(|k| {
            tracker
                .tracks()
                .iter()
                .map(move |track| track.motion_px[k].to_bits())
        });
        let confidence = tracker.tracks().iter().map(|track| track.confidence.to_bits());
        x.zip(y)
            .zip(confidence)
            .map(|((x, y), confidence)| [x, y, confidence])
            .collect()
    }

    #[test]
    fn beyond_noise_tracks_are_those_of_the_picture_that_is_kept_and_keep_up_with_what_moves() {
        let mut state = 1;
        let still = spots(0.0);
        let rest: Vec<Vec<u8>> = (0..16).map(|_| taken(&still, &mut state)).collect();
        for pictures_at_rest in [16, 1] {
            let [mut skip, mut dense] = [0, 1].map(|_| {
                let mut tracker = Tracker::new();
                tracker.set_rest(&rest[0]);
                tracker
            });
            skip.learn_noise(&rest[..pictures_at_rest]);
            let (mut changed_tiles, mut frames) = (0, 0);
            for frame in 0..40 {
                // Still for 24 frames, so that noise can be found in them; then a square moves by a tenth of a pixel a frame.
                let moved_px = 0.1 * (frame as f32 - 23.0).max(0.0);
                let now = taken(&spots(moved_px), &mut state);
                let before = skip.now.full.pixels.clone();
                skip.track_beyond_noise(&now);
                let kept: Vec<u8> = (0..SIDE).flat_map(|row| *skip.now.full.row(row)).collect();
                dense.invalidate();
                dense.track(&kept);
                assert!(bits(&skip) == bits(&dense), "frame {frame}");
                if (18..24).contains(&frame) && skip.since_refresh > 0 {
                    let changed = before
                        .iter()
                        .zip(&skip.now.full.pixels)
                        .filter(|(a, b)| a != b)
                        .count();
                    (changed_tiles, frames) = (changed_tiles + changed / 64, frames + 1);
                }
            }
            assert!(
                frames >= 5 && changed_tiles < 10 * frames,
                "{changed_tiles} of {frames} frames"
            );
            dense.invalidate();
            dense.track(&taken(&spots(1.6), &mut state));
            let off: Vec<f32> = skip
                .tracks()
                .iter()
                .zip(dense.tracks())
                .filter(|(a, b)| a.confidence > 0.0 && b.confidence > 0.0)
                .map(|(a, b)| length([0, 1].map(|k| a.motion_px[k] - b.motion_px[k])))
                .collect();
            let mean = off.iter().sum::<f32>() / off.len() as f32;
            assert!(
                off.len() > 1_500 && mean < 0.1,
                "{} tracks, {mean} pixels",
                off.len()
            );
        }
    }

    /// Follows a square that moves by this many pixels in each picture; true for every picture that is tracked as a whole.
    fn tracked_as_a_whole(moves_px: impl IntoIterator<Item = f32>) -> Vec<bool> {
        let mut state = 1;
        let still = spots(0.0);
        let rest: Vec<Vec<u8>> = (0..16).map(|_| taken(&still, &mut state)).collect();
        let mut tracker = Tracker::new();
        tracker.set_rest(&rest[0]);
        tracker.learn_noise(&rest);
        let mut moved_px = 0.0;
        moves_px
            .into_iter()
            .map(|move_px| {
                moved_px += move_px;
                let now = taken(&spots(moved_px), &mut state);
                tracker.track_beyond_noise(&now);
                (0..SIDE).all(|row| tracker.now.full.row(row)[..] == now[row * SIDE..][..SIDE])
            })
            .collect()
    }

    #[test]
    fn a_motion_below_the_noise_stays_hidden_for_a_third_of_a_second_at_most() {
        // The first picture is tracked whatever it shows.
        let moves = (0..50).map(|picture| if picture == 3 { 0.02 } else { 0.0 });
        let whole = tracked_as_a_whole(moves);
        let found: Vec<usize> = (0..whole.len()).filter(|&picture| whole[picture]).collect();
        assert_eq!(found, [0, REFRESH as usize, 2 * REFRESH as usize]);
    }

    #[test]
    fn the_picture_after_a_motion_is_tracked_as_a_whole() {
        let moves = (0..12).map(|picture| if (4..8).contains(&picture) { 0.8 } else { 0.0 });
        let whole = tracked_as_a_whole(moves);
        assert!(whole[8] && !whole[9..].contains(&true), "{whole:?}");
    }
}
