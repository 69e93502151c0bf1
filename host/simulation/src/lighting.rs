//! Light on the gel: a ring of LEDs around the lens, by inverse square and cosines, and how its brightness moves over
//! time. Units: mm over the camera's centre of projection, s; light 1 is that of a nominal ring on the axis.
//! Limits: no shadows, no light scattered by other particles; the cover keeps its light when the gel is pressed.

use std::f64::consts::TAU;

use crate::constants::{
    BRIGHTNESS_DRIFT, BRIGHTNESS_DRIFT_PERIOD_S, BRIGHTNESS_FLICKER, LED_COUNT, LED_HEIGHT_MM,
    LED_RING_RADIUS_MM, LED_SPREAD, MAINS_HZ,
};
use crate::error::{SimulationError, checked, finite, not_negative, positive};
use crate::random::Random;

/// Purpose of the random stream of the brightness.
const MOTION: u64 = 6;
/// Sines in the drift, and how much shorter each one's period is than the last one's.
const DRIFT_SINES: usize = 3;
const DRIFT_STEP: f64 = 0.618;
/// More LEDs than this are no ring around a lens.
const MAX_LEDS: usize = 64;

/// A ring of LEDs around the lens; they shine along the axis, with Lambert's cosine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lighting {
    /// LEDs, evenly around the ring, 1 to 64.
    pub leds: usize,
    /// Radius of the ring, mm.
    pub ring_radius_mm: f64,
    /// The ring over the camera's centre of projection, mm; it must lie under the gel's base.
    pub height_mm: f64,
    /// Largest difference of one LED's brightness from the ring's mean, share; which, by the fingertip's seed.
    pub spread: f64,
}

impl Default for Lighting {
    fn default() -> Self {
        Self {
            leds: LED_COUNT,
            ring_radius_mm: LED_RING_RADIUS_MM,
            height_mm: LED_HEIGHT_MM,
            spread: LED_SPREAD,
        }
    }
}

impl Lighting {
    pub(crate) fn check(&self, base_mm: f64) -> Result<(), SimulationError> {
        checked("lighting leds", self.leds as f64, "between 1 and 64", |n| {
            (1.0..=MAX_LEDS as f64).contains(&n)
        })?;
        not_negative("lighting ring_radius_mm", self.ring_radius_mm)?;
        finite("lighting height_mm", self.height_mm)?;
        checked(
            "lighting height_mm",
            self.height_mm,
            "under the gel's base, camera to_base_mm",
            |h| h < base_mm,
        )?;
        checked("lighting spread", self.spread, "from 0 to below 1", |s| {
            (0.0..1.0).contains(&s)
        })?;
        Ok(())
    }
}

/// The LEDs of one fingertip.
#[derive(Debug, Clone)]
pub(crate) struct Lamps {
    at_mm: Vec<[f64; 2]>,
    brightness: Vec<f64>,
    height_mm: f64,
}

impl Lamps {
    /// The ring, with every LED's brightness drawn; their mean is 1.
    pub(crate) fn new(ring: &Lighting, random: &mut Random) -> Self {
        let drawn: Vec<f64> = (0..ring.leds)
            .map(|_| random.uniform(1.0 - ring.spread, 1.0 + ring.spread))
            .collect();
        let mean = drawn.iter().sum::<f64>() / ring.leds as f64;
        Self {
            at_mm: (0..ring.leds)
                .map(|led| {
                    let (sin, cos) = libm::sincos(TAU * led as f64 / ring.leds as f64);
                    [ring.ring_radius_mm * cos, ring.ring_radius_mm * sin]
                })
                .collect(),
            brightness: drawn.into_iter().map(|b| b / mean).collect(),
            height_mm: ring.height_mm,
        }
    }

    /// What a small sphere at (x, y, z) mm catches, cos θ / d² of every LED, and its slope per millimetre.
    fn on_sphere(&self, [x, y, z]: [f64; 3]) -> (f64, [f64; 3]) {
        let h = z - self.height_mm;
        let (mut sum, mut slope) = (0.0, [0.0; 3]);
        for ([led_x, led_y], brightness) in self.at_mm.iter().zip(&self.brightness) {
            let (dx, dy) = (x - led_x, y - led_y);
            let square = dx * dx + dy * dy + h * h;
            let cube = brightness / (square * square.sqrt());
            sum += h * cube;
            let fall = -3.0 * h * cube / square;
            slope[0] += fall * dx;
            slope[1] += fall * dy;
            slope[2] += cube + fall * h;
        }
        (sum, slope)
    }

    /// Light on a small sphere at (x, y, z) mm over that on the axis at height `reference_mm`, and its slope per
    /// millimetre.
    pub(crate) fn sphere(&self, at_mm: [f64; 3], reference_mm: f64) -> (f64, [f64; 3]) {
        let (light, slope) = self.on_sphere(at_mm);
        let on_axis = self.even_on_axis(reference_mm).0;
        (light / on_axis, slope.map(|s| s / on_axis))
    }

    /// Light on a plane across the axis at (x, y, z) mm, over that on the axis at the same height: cos² θ / d².
    pub(crate) fn plane(&self, [x, y, z]: [f64; 3]) -> f64 {
        let h = z - self.height_mm;
        let sum: f64 = self
            .at_mm
            .iter()
            .zip(&self.brightness)
            .map(|([led_x, led_y], brightness)| {
                let square = (x - led_x).powi(2) + (y - led_y).powi(2) + h * h;
                brightness * h * h / (square * square)
            })
            .sum();
        sum / self.even_on_axis(z).1
    }

    /// Light of even LEDs on a small sphere and on a plane, on the axis at height `z`.
    fn even_on_axis(&self, z: f64) -> (f64, f64) {
        let h = z - self.height_mm;
        self.at_mm.iter().fold((0.0, 0.0), |(sphere, plane), [x, y]| {
            let square = x * x + y * y + h * h;
            (
                sphere + h / (square * square.sqrt()),
                plane + h * h / (square * square),
            )
        })
    }
}

/// How the brightness moves around its mean: slow drift and mains flicker. Limits: the whole picture at once, no bands
/// of a rolling shutter; the flicker's share is what one exposure leaves of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrightnessMotion {
    /// Largest slow change, share of the mean.
    pub drift: f64,
    /// Longest period of the slow change, s.
    pub drift_period_s: f64,
    /// Largest change by flicker, share of the mean.
    pub flicker: f64,
    /// Mains frequency, Hz; the light flickers at twice this, which the frame rate folds to a slow beat.
    pub mains_hz: f64,
}

impl Default for BrightnessMotion {
    fn default() -> Self {
        Self {
            drift: BRIGHTNESS_DRIFT,
            drift_period_s: BRIGHTNESS_DRIFT_PERIOD_S,
            flicker: BRIGHTNESS_FLICKER,
            mains_hz: MAINS_HZ,
        }
    }
}

impl BrightnessMotion {
    /// No motion.
    pub const STILL: Self = Self {
        drift: 0.0,
        drift_period_s: BRIGHTNESS_DRIFT_PERIOD_S,
        flicker: 0.0,
        mains_hz: MAINS_HZ,
    };

    pub(crate) fn check(&self) -> Result<(), SimulationError> {
        not_negative("brightness_motion drift", self.drift)?;
        positive("brightness_motion drift_period_s", self.drift_period_s)?;
        not_negative("brightness_motion flicker", self.flicker)?;
        positive("brightness_motion mains_hz", self.mains_hz)?;
        checked(
            "brightness_motion drift + flicker",
            self.drift + self.flicker,
            "below 1",
            |s| s < 1.0,
        )?;
        Ok(())
    }

    /// Brightness at `time_s` over its mean, within 1 ± (drift + flicker); the phases follow from `seed`.
    #[must_use]
    pub fn at(&self, seed: u64, time_s: f64) -> f64 {
        let mut random = Random::new(seed, MOTION);
        let mut sine = |frequency_hz: f64| libm::sin(TAU * (frequency_hz * time_s + random.unit()));
        let mut frequency_hz = 1.0 / self.drift_period_s;
        let mut drift = 0.0;
        for _ in 0..DRIFT_SINES {
            drift += sine(frequency_hz) / DRIFT_SINES as f64;
            frequency_hz /= DRIFT_STEP;
        }
        1.0 + self.drift * drift + self.flicker * sine(2.0 * self.mains_hz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_led_lights_by_inverse_square_and_cosine() {
        let single = Lighting {
            leds: 1,
            ring_radius_mm: 3.0,
            height_mm: -1.0,
            spread: 0.0,
        };
        let lamps = Lamps::new(&single, &mut Random::new(1, 1));
        // Straight above the LED: inverse square alone.
        let sphere = |at: [f64; 3]| lamps.sphere(at, 14.0).0;
        let ratio = sphere([3.0, 0.0, 11.0]) / sphere([3.0, 0.0, 17.0]);
        assert!((ratio - (18.0_f64 / 12.0).powi(2)).abs() < 1e-12);
        // Aside by 45°: distance √2 times, cosine 1/√2, for a plane twice.
        let ratio = sphere([3.0 + 12.0, 0.0, 11.0]) / sphere([3.0, 0.0, 11.0]);
        assert!((ratio - 0.5 / 2.0_f64.sqrt()).abs() < 1e-12);
        let ratio = lamps.plane([3.0, -12.0, 11.0]) / lamps.plane([3.0, 0.0, 11.0]);
        assert!((ratio - 0.25).abs() < 1e-12);
    }

    #[test]
    fn a_nominal_ring_gives_light_one_on_the_axis_and_its_slope_is_the_difference_quotient() {
        let even = Lighting {
            spread: 0.0,
            ..Lighting::default()
        };
        let lamps = Lamps::new(&even, &mut Random::new(1, 1));
        assert!((lamps.sphere([0.0, 0.0, 14.0], 14.0).0 - 1.0).abs() < 1e-12);
        assert!((lamps.plane([0.0, 0.0, 17.0]) - 1.0).abs() < 1e-12);
        let lamps = Lamps::new(&Lighting::default(), &mut Random::new(4, 1));
        let at = [7.0, -11.0, 13.0];
        let (_, slope) = lamps.sphere(at, 14.0);
        for axis in 0..3 {
            let moved = |by: f64| {
                let mut there = at;
                there[axis] += by;
                lamps.sphere(there, 14.0).0
            };
            let quotient = (moved(1e-4) - moved(-1e-4)) / 2e-4;
            assert!((slope[axis] - quotient).abs() < 1e-8, "{slope:?} {quotient}");
        }
    }

    #[test]
    fn unequal_leds_keep_their_mean_and_differ_by_seed() {
        let draw = |seed: u64| Lamps::new(&Lighting::default(), &mut Random::new(seed, 3)).brightness;
        let first = draw(1);
        assert!((first.iter().sum::<f64>() / first.len() as f64 - 1.0).abs() < 1e-12);
        let range = first
            .iter()
            .fold([f64::MAX, f64::MIN], |[low, high], &b| [low.min(b), high.max(b)]);
        assert!(
            range[1] - range[0] > 0.05 && range[1] - range[0] < 0.4,
            "{range:?}"
        );
        assert!(first != draw(2) && first == draw(1));
    }

    #[test]
    fn the_brightness_moves_within_its_bound_around_one_and_repeats_by_seed() {
        let motion = BrightnessMotion {
            drift: 0.05,
            flicker: 0.02,
            ..BrightnessMotion::default()
        };
        let samples = 40_000;
        // 60 frames a second fold the flicker of 100 Hz to 20 Hz.
        let at = |seed: u64, i: usize| motion.at(seed, i as f64 / 60.0);
        let (mut sum, mut max, mut step) = (0.0, 0.0_f64, 0.0_f64);
        for i in 0..samples {
            sum += at(7, i);
            max = max.max((at(7, i) - 1.0).abs());
            step = step.max((at(7, i + 1) - at(7, i)).abs());
        }
        assert!(
            (sum / f64::from(samples as u32) - 1.0).abs() < 1e-3,
            "mean {}",
            sum / samples as f64
        );
        assert!(max <= 0.07 && max > 0.05, "{max}");
        assert!(step > 0.02, "no flicker: {step}");
        let bits = |seed: u64| at(seed, 100).to_bits();
        assert!(bits(7) == bits(7) && bits(7) != bits(8));
        assert!((BrightnessMotion::STILL.at(7, 3.3) - 1.0).abs() < f64::EPSILON);
    }
}
