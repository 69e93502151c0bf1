//! What goes wrong with a camera, done to its 440 x 440 crops: for tests and calibration of the checks that must notice.
//! Units: gray levels, pixels, mm. Limits: every fault is whole and steady; nothing comes and goes.

use crate::camera::Camera;
use crate::constants::{
    CROP_CORNER_PX, CROP_PX, LED_COUNT, LED_HEIGHT_MM, LED_RING_RADIUS_MM, PARTICLE_DEPTH_MM,
    SENSOR_NOISE_LEVELS,
};
use crate::gel::Gel;
use crate::image::Image;
use crate::random::Random;

/// Purpose of the noise's random stream.
const FAULTS: u64 = 40;
/// Share of the light that reaches a camera under a cover.
const COVERED: f32 = 0.03;
/// Light of an over-exposed picture over nominal.
const OVER_EXPOSED: f32 = 4.0;
/// Half of the side of the square that a defocused lens smears a point over, crop pixels; twice, so nearly round.
const DEFOCUS_PX: usize = 4;
/// Gray level of the pictures that a driver delivers for a camera that is gone.
const UNPLUGGED_LEVEL: u8 = 128;

/// A fault of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum CameraFault {
    /// No light at all, or the lens covered: noise around black.
    Black,
    /// Every pixel at its highest level.
    White,
    /// Four times the light.
    OverExposed,
    /// The lens lost its focus.
    Defocused,
    /// The left half is covered.
    HalfCovered,
    /// The one gray that a driver delivers when no camera answers.
    Unplugged,
    /// One of the LEDs went out.
    LedOut,
}

impl CameraFault {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Black,
        Self::White,
        Self::OverExposed,
        Self::Defocused,
        Self::HalfCovered,
        Self::Unplugged,
        Self::LedOut,
    ];

    /// The fault's name, in lower case.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Black => "black",
            Self::White => "white",
            Self::OverExposed => "over-exposed",
            Self::Defocused => "defocused",
            Self::HalfCovered => "half covered",
            Self::Unplugged => "unplugged",
            Self::LedOut => "LED out",
        }
    }

    /// The crop as the faulty camera would have delivered it; its noise follows from `seed`.
    ///
    /// # Panics
    /// When `crop` is not 440 x 440.
    #[must_use]
    pub fn of(self, crop: &Image, seed: u64) -> Image {
        assert_eq!(
            [crop.width, crop.height],
            [CROP_PX; 2],
            "the crop's width and height"
        );
        let light = |factor: &dyn Fn(usize, usize) -> f32| {
            let mut random = Random::new(seed, FAULTS);
            let mut out = Image::crop();
            for (at, (to, &from)) in out.pixels.iter_mut().zip(&crop.pixels).enumerate() {
                let factor = factor(at % CROP_PX, at / CROP_PX);
                // What loses its light keeps the sensor's noise.
                let noise = if factor < 0.5 { normal(&mut random) } else { 0.0 };
                *to = (factor * f32::from(from) + noise + 0.5).clamp(0.0, 255.0) as u8;
            }
            out
        };
        match self {
            Self::Black => light(&|_, _| 0.0),
            Self::White => flat(255),
            Self::OverExposed => light(&|_, _| OVER_EXPOSED),
            Self::Defocused => smeared(&smeared(crop)),
            Self::HalfCovered => light(&|x, _| if x < CROP_PX / 2 { COVERED } else { 1.0 }),
            Self::Unplugged => flat(UNPLUGGED_LEVEL),
            Self::LedOut => {
                let led = Random::new(seed, FAULTS + 1).below(LED_COUNT);
                let left = light_without(led);
                light(&|x, y| left[y / LED_STEP_PX * (CROP_PX / LED_STEP_PX) + x / LED_STEP_PX])
            }
        }
    }
}

fn flat(level: u8) -> Image {
    let mut out = Image::crop();
    out.pixels.fill(level);
    out
}

fn normal(random: &mut Random) -> f32 {
    // The sum of four uniform numbers is close to normal, sigma 1/√3.
    let sum: f64 = (0..4).map(|_| random.unit() - 0.5).sum();
    (sum * 3.0_f64.sqrt() * SENSOR_NOISE_LEVELS) as f32
}

/// Means of squares around every pixel; outside repeats the border.
fn smeared(crop: &Image) -> Image {
    let mut across = vec![0_u32; CROP_PX * CROP_PX];
    let mut out = Image::crop();
    let sides = 2 * DEFOCUS_PX as u32 + 1;
    let inside = |at: usize, by: usize| (at + by).saturating_sub(DEFOCUS_PX).min(CROP_PX - 1);
    for (row, across) in across.chunks_exact_mut(CROP_PX).enumerate() {
        for (x, sum) in across.iter_mut().enumerate() {
            *sum = (0..=2 * DEFOCUS_PX)
                .map(|by| u32::from(crop.pixels[row * CROP_PX + inside(x, by)]))
                .sum();
        }
    }
    for (y, row) in out.pixels.chunks_exact_mut(CROP_PX).enumerate() {
        for (x, to) in row.iter_mut().enumerate() {
            let sum: u32 = (0..=2 * DEFOCUS_PX)
                .map(|by| across[inside(y, by) * CROP_PX + x])
                .sum();
            *to = ((sum + sides * sides / 2) / (sides * sides)) as u8;
        }
    }
    out
}

/// Side of the squares in which the light of an LED is taken for constant, crop pixels.
const LED_STEP_PX: usize = 8;

/// The share of the light that is left without LED number `led`, squares row-major: cos θ / d² of each on a particle in
/// the middle of the layer.
fn light_without(led: usize) -> Vec<f32> {
    let camera = Camera::default();
    let [left, top] = CROP_CORNER_PX;
    let over_base_mm = Gel::default().thickness_mm - 0.5 * (PARTICLE_DEPTH_MM[0] + PARTICLE_DEPTH_MM[1]);
    let height_mm = camera.to_base_mm + over_base_mm;
    let squares = CROP_PX / LED_STEP_PX;
    let mut shares = Vec::with_capacity(squares * squares);
    for square in 0..squares * squares {
        let middle = |at: usize, corner: usize| (at * LED_STEP_PX + LED_STEP_PX / 2 + corner) as f64;
        let dx = middle(square % squares, left) - camera.centre_px[0];
        let dy = middle(square / squares, top) - camera.centre_px[1];
        let r = libm::hypot(dx, dy).max(1e-9);
        let distance_mm = height_mm * libm::tan((r / camera.focal_px_per_rad).min(1.5));
        let [x, y] = [distance_mm * dx / r, distance_mm * dy / r];
        let of = |led: usize| {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * led as f64 / LED_COUNT as f64);
            let h = height_mm - LED_HEIGHT_MM;
            let d2 = (x - LED_RING_RADIUS_MM * cos).powi(2) + (y - LED_RING_RADIUS_MM * sin).powi(2) + h * h;
            h / (d2 * d2.sqrt())
        };
        let all: f64 = (0..LED_COUNT).map(of).sum();
        shares.push((1.0 - of(led) / all) as f32);
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Fingertip, FingertipParams};

    fn mean(image: &Image, columns: std::ops::Range<usize>) -> f64 {
        let rows = image.pixels.chunks_exact(CROP_PX);
        let sum: f64 = rows
            .map(|row| row[columns.clone()].iter().map(|&p| f64::from(p)).sum::<f64>())
            .sum();
        sum / (columns.len() * CROP_PX) as f64
    }

    #[test]
    fn every_fault_does_to_the_light_what_it_says() {
        let crop = Fingertip::new(3, FingertipParams::default())
            .unwrap()
            .rest_image();
        let plain = mean(&crop, 0..440);
        let level = |fault: CameraFault| mean(&fault.of(&crop, 1), 0..440);
        assert!(level(CameraFault::Black) < 2.0);
        assert!((level(CameraFault::White) - 255.0).abs() < 1e-9);
        assert!((level(CameraFault::Unplugged) - 128.0).abs() < 1e-9);
        assert!(level(CameraFault::OverExposed) > 2.0 * plain);
        // Smearing moves light and loses none.
        assert!((level(CameraFault::Defocused) / plain - 1.0).abs() < 0.02);
        // One LED of eight is an eighth of the light on average.
        let left = level(CameraFault::LedOut) / plain;
        assert!((left - 0.875).abs() < 0.04, "{left}");
        let half = CameraFault::HalfCovered.of(&crop, 1);
        assert!(mean(&half, 0..220) < 0.2 * plain);
        assert!((mean(&half, 220..440) - mean(&crop, 220..440)).abs() < 1e-9);
    }

    #[test]
    fn a_defocused_picture_keeps_its_level_and_loses_its_particles() {
        let crop = Fingertip::new(3, FingertipParams::default())
            .unwrap()
            .rest_image();
        let blurred = CameraFault::Defocused.of(&crop, 1);
        let roughness = |image: &Image| -> f64 {
            let pairs = image.pixels.windows(2);
            pairs.map(|p| (f64::from(p[0]) - f64::from(p[1])).powi(2)).sum()
        };
        assert!(roughness(&blurred) < 0.05 * roughness(&crop));
    }
}
