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

use super::cells::{Cell, CellSearch};
use super::dirty_tiles::{self, DirtyTiles, TILES};
use super::flow::Flow;
use super::level::Level;
use super::particles::{self, Particle};
use super::patch::PatchWeights;
use super::pyramid::Pyramid;
use super::search::Track;
use super::tile_noise::TileNoise;
use crate::constants::CROP_SIDE;
use crate::error::NetworkError;
use crate::image::check_crop;

/// Below the noise a motion of up to a tenth of a pixel can hide. It stays hidden no longer than this many pictures, a third of a second
/// at 60 a second: then everything is tracked again.
const REFRESH: u32 = 20;
/// The same when a motion has ended, which leaves the most: in the first picture in which no more than these tiles changed.
const MOVING_TILES: u16 = (TILES * TILES / 32) as u16;
/// What counts as a change of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Changes {
    /// Every difference.
    Any,
    /// What the camera's noise does not explain, as far as the noise is known.
    BeyondNoise,
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
        self.cells = Cell::all(image, &self.particles, &self.weights);
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
    fn track_with(&mut self, now: &[u8], changes: Changes) -> bool {
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
                if self.learns_noise && differences != [[0; TILES]; TILES] {
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
        self.flow.update(&self.rest, &self.now, dirty, self.instructions);
        let search = CellSearch {
            flow: &self.flow,
            now: &self.now.full,
            weights: &self.weights,
            dirty,
            instructions: self.instructions,
        };
        search.update(&mut self.cells);
        for (index, track) in self.cells.iter().flat_map(Cell::changed_tracks) {
            self.tracks[index] = track;
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
        self.tracker.track_with(self.now, self.changes)
    }
}

#[cfg(test)]
mod tests {
    use super::super::search_ray::length;
    use super::*;

    const SIDE: usize = CROP_SIDE;

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

    #[test]
    fn a_camera_that_stops_for_a_while_leaves_the_noise_as_it_was() {
        let mut state = 1;
        let still = spots(0.0);
        let mut tracker = Tracker::new();
        tracker.set_rest(&taken(&still, &mut state));
        let mut tiles = [0; 2];
        for changed in &mut tiles {
            for frame in 0..40 {
                let now = taken(&still, &mut state);
                let before = tracker.now.full.pixels.clone();
                tracker.track_beyond_noise(&now);
                if frame >= 18 && tracker.since_refresh > 0 {
                    let pixels = before.iter().zip(&tracker.now.full.pixels);
                    *changed += pixels.filter(|(a, b)| a != b).count() / 64;
                }
            }
            let stopped = taken(&still, &mut state);
            for _ in 0..2 * REFRESH + 16 {
                tracker.track_beyond_noise(&stopped);
            }
        }
        assert!(
            tiles.iter().all(|tiles| *tiles < 400),
            "{tiles:?} in 22 frames each"
        );
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
