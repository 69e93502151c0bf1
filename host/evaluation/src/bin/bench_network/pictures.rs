//! Pictures to time with: dots drawn here, pushed as a touch pushes them, and squares of them that change.

use gripline_network::constants::{CROP_SIDE, DOWNSAMPLING};
use gripline_simulation::constants::SENSOR_NOISE_LEVELS;

/// Particles in the middle of what sensors have.
const DOTS: usize = 5_000;
/// Share of the dots' square, 36 of 32 mm, that the picture shows, along a side.
const SHOWN: f32 = 36.0 / 32.0;
/// Positions of the changed square that take turns.
const POSITIONS: usize = 9;

/// Whole numbers below 2²⁰ as shares, without a pattern (an LCG's upper bits).
fn unit(state: &mut u64) -> f32 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 44) as f32 / (1 << 20) as f32
}

/// Dots on a dark ground, pushed most in the middle by this many pixels.
pub(crate) fn picture(push_px: f32) -> Vec<u8> {
    const SIDE: usize = CROP_SIDE;
    let mut levels = vec![14.0_f32; SIDE * SIDE];
    let mut state = 5;
    for _ in 0..DOTS {
        let [x, y] = [0, 1].map(|_| ((unit(&mut state) - 0.5) * SHOWN + 0.5) * SIDE as f32);
        let (share, level) = (0.2 + 0.6 * unit(&mut state), 70.0 + 80.0 * unit(&mut state));
        let far = ((x - 220.0).powi(2) + (y - 220.0).powi(2)) / (2.0 * 60.0 * 60.0);
        let x = x + push_px * share * (-far).exp();
        let span = |at: f32| (at - 4.0).max(0.0) as usize..((at + 5.0).max(0.0) as usize).min(SIDE);
        for row in span(y) {
            for column in span(x) {
                let [dx, dy] = [column as f32 + 0.5 - x, row as f32 + 0.5 - y];
                let cover = (-(dx * dx + dy * dy) / (2.0 * 1.1 * 1.1)).exp();
                let pixel = &mut levels[row * SIDE + column];
                *pixel += cover * (level - *pixel).max(0.0);
            }
        }
    }
    levels.into_iter().map(|level| level as u8).collect()
}

/// The same picture with a camera's noise, another with every number.
pub(crate) fn noisy(picture: &[u8], number: u64) -> Vec<u8> {
    let mut state = number;
    picture
        .iter()
        .map(|&level| {
            // Nearly normal: twelve shares have the variance 1.
            let normal = (0..12).map(|_| unit(&mut state)).sum::<f32>() - 6.0;
            (f32::from(level) + SENSOR_NOISE_LEVELS as f32 * normal).round() as u8
        })
        .collect()
}

/// A film in which each picture differs from the one before in a square that covers a share of it, at the nine
/// positions of a 3×3 raster in turn.
pub(crate) struct Film {
    shown: Vec<u8>,
    pictures: [Vec<u8>; 2],
    second: [bool; POSITIONS],
    side: usize,
    frame: usize,
}

impl Film {
    pub(crate) fn new(share: f64) -> Self {
        // Whole pixels of the small image too.
        let side = (share.sqrt() * (CROP_SIDE / DOWNSAMPLING) as f64).round() as usize * DOWNSAMPLING;
        let pictures = [6.0, 7.0].map(picture);
        Self {
            shown: pictures[0].clone(),
            pictures,
            second: [false; POSITIONS],
            side,
            frame: 0,
        }
    }

    pub(crate) fn next(&mut self) -> &[u8] {
        let position = self.frame % POSITIONS;
        self.frame += 1;
        self.second[position] = !self.second[position];
        let from = &self.pictures[usize::from(self.second[position])];
        let offset = |index: usize| index * (CROP_SIDE - self.side) / 2 / DOWNSAMPLING * DOWNSAMPLING;
        let (top, left) = (offset(position / 3), offset(position % 3));
        for row in top..top + self.side {
            let pixels = row * CROP_SIDE + left..row * CROP_SIDE + left + self.side;
            self.shown[pixels.clone()].copy_from_slice(&from[pixels]);
        }
        &self.shown
    }
}
