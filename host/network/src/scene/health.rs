//! Can the picture be trusted? Compares it, block by block, with the sensor's picture at rest: brightness, contrast of the
//! particles, how much of the sensor surface looks unchanged, and whether the illumination is still even.
//! Units: shares and ratios. Limits: calibrated on the simulated sensor (`gripline-training gate` prints the metrics of
//! clean and faulty pictures). A touch changes part of the surface, so a smaller fault goes unnoticed.

use std::fmt;

use super::reference::{Comparison, Reference};
use crate::constants::{BLOCK_PIXELS, BLOCKS, IMAGE_PIXELS};

/// A block matches its picture at rest from this correlation on.
const MATCHING: f32 = 0.6;
/// From this correlation on nothing has moved in the block, so its brightness shows the illumination.
const STILL: f32 = 0.9;
/// Below this ratio of variance to that at rest, a block's particles are invisible.
const FADED: f32 = 0.3;
/// Mean square level from which a block is overexposed, grey levels squared.
const OVEREXPOSED: f32 = 190.0 * 190.0;

/// Problems of a picture; any flag makes the map doubtful.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Health(u8);

impl Health {
    /// No problem.
    pub const GOOD: Self = Self(0);
    /// Darker than the network was trained for.
    pub const TOO_DARK: Self = Self(1);
    /// Brighter than the network was trained for.
    pub const TOO_BRIGHT: Self = Self(1 << 1);
    /// Unlike the training data: another sensor's picture, or uneven illumination.
    pub const UNLIKE_TRAINING: Self = Self(1 << 2);
    /// Particles of the picture at rest are invisible.
    pub const PARTICLES_LOST: Self = Self(1 << 3);
    const NAMES: [(Self, &'static str); 4] = [
        (Self::TOO_DARK, "too dark"),
        (Self::TOO_BRIGHT, "too bright"),
        (Self::UNLIKE_TRAINING, "unlike training"),
        (Self::PARTICLES_LOST, "particles lost"),
    ];

    /// The flags as bits; the first constant is the lowest bit.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Whether no flag is set.
    #[must_use]
    pub const fn is_good(self) -> bool {
        self.0 == 0
    }

    /// Whether all of `flags` are set.
    #[must_use]
    pub const fn has(self, flags: Self) -> bool {
        self.0 & flags.0 == flags.0
    }

    /// With these flags too, if `set`.
    pub(crate) const fn with(self, flags: Self, set: bool) -> Self {
        if set { Self(self.0 | flags.0) } else { self }
    }
}

impl fmt::Display for Health {
    /// The flags' names, comma-separated, or "good".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_good() {
            return f.write_str("good");
        }
        let set = Self::NAMES.into_iter().filter(|(flag, _)| self.has(*flag));
        for (number, (_, name)) in set.enumerate() {
            f.write_str(if number == 0 { "" } else { ", " })?;
            f.write_str(name)?;
        }
        Ok(())
    }
}

/// The metrics that decide a picture's health.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HealthMetrics {
    /// Mean level over that at rest.
    pub brightness: f32,
    /// Share of overexposed blocks.
    pub overexposed: f32,
    /// Share of blocks whose particles are invisible, of those that have some at rest.
    pub faded: f32,
    /// Share of blocks that match the picture at rest.
    pub matching: f32,
    /// Relative standard deviation of the brightness ratio over the blocks in which nothing has moved.
    pub unevenness: f32,
}

/// Limits that clean pictures stay within.
mod limit {
    /// Minimum and maximum mean level over that at rest.
    pub(super) const BRIGHTNESS: [f32; 2] = [0.75, 1.35];
    /// Largest share of overexposed blocks.
    pub(super) const OVEREXPOSED: f32 = 0.2;
    /// Largest share of faded blocks.
    pub(super) const FADED: f32 = 0.2;
    /// Smallest share of matching blocks.
    pub(super) const MATCHING: f32 = 0.3;
    /// Largest unevenness.
    pub(super) const UNEVENNESS: f32 = 0.035;
    /// Minimum and maximum mean level of a picture at rest, grey levels.
    pub(super) const REST_LEVEL: [f32; 2] = [15.0, 120.0];
    /// Smallest standard deviation within the blocks of a picture at rest, grey levels.
    pub(super) const REST_CONTRAST: f32 = 4.0;
}

/// Checks the pictures of one sensor.
#[derive(Debug, Clone)]
pub(super) struct HealthMonitor {
    /// A problem of the picture at rest is a problem of every picture.
    rest: Health,
}

impl HealthMonitor {
    pub(super) fn new(rest: &Reference) -> Self {
        let level = rest.levels.iter().sum::<i32>() as f32 / IMAGE_PIXELS as f32;
        let contrast: f32 = (0..BLOCKS)
            .map(|block| squared_deviation(rest.squares[block], rest.levels[block]))
            .sum();
        let deviation = (contrast / IMAGE_PIXELS as f32).max(0.0).sqrt();
        Self {
            rest: Health::GOOD
                .with(Health::TOO_DARK, level < limit::REST_LEVEL[0])
                .with(Health::TOO_BRIGHT, level > limit::REST_LEVEL[1])
                .with(Health::PARTICLES_LOST, deviation < limit::REST_CONTRAST),
        }
    }

    pub(super) fn check(&self, comparison: &Comparison) -> Health {
        let metrics = metrics(comparison);
        self.rest
            .with(Health::TOO_DARK, metrics.brightness < limit::BRIGHTNESS[0])
            .with(
                Health::TOO_BRIGHT,
                metrics.brightness > limit::BRIGHTNESS[1] || metrics.overexposed > limit::OVEREXPOSED,
            )
            .with(Health::PARTICLES_LOST, metrics.faded > limit::FADED)
            .with(
                Health::UNLIKE_TRAINING,
                metrics.matching < limit::MATCHING || metrics.unevenness > limit::UNEVENNESS,
            )
    }
}

/// Sum of squared differences from a block's mean level.
fn squared_deviation(squares: i32, levels: i32) -> f32 {
    squares as f32 - levels as f32 * levels as f32 / BLOCK_PIXELS as f32
}

pub(super) fn metrics(comparison: &Comparison) -> HealthMetrics {
    let (sums, rest) = (&comparison.sums, &comparison.rest);
    let (mut level, mut rest_level) = (0, 0);
    let [
        mut overexposed,
        mut with_texture,
        mut faded,
        mut matching,
        mut still,
    ] = [0.0_f32; 5];
    let [mut gain_sum, mut gain_squares] = [0.0_f32; 2];
    let pixels = BLOCK_PIXELS as f32;
    for block in 0..BLOCKS {
        level += sums.levels[block];
        rest_level += rest.levels[block];
        let now = squared_deviation(sums.squares[block], sums.levels[block]);
        let before = squared_deviation(rest.squares[block], rest.levels[block]).max(1.0);
        let products = sums.products[0][0][block] as f32;
        let covariance = products - sums.levels[block] as f32 * rest.levels[block] as f32 / pixels;
        // Compares squares to save the root; negative correlations count as zero.
        let correlation_squared = covariance.max(0.0) * covariance.max(0.0) / (now.max(1.0) * before);
        let gain = products / rest.squares[block].max(1) as f32;
        let flag = |set: bool| f32::from(u8::from(set));
        let textured = flag(before > pixels * limit::REST_CONTRAST * limit::REST_CONTRAST);
        overexposed += flag(sums.squares[block] as f32 > pixels * OVEREXPOSED);
        with_texture += textured;
        faded += textured * flag(now < FADED * before);
        matching += flag(correlation_squared > MATCHING * MATCHING);
        let unmoved = flag(correlation_squared > STILL * STILL);
        still += unmoved;
        gain_sum += unmoved * gain;
        gain_squares += unmoved * gain * gain;
    }
    let blocks = BLOCKS as f32;
    let mean = gain_sum / still.max(1.0);
    let variance = (gain_squares / still.max(1.0) - mean * mean).max(0.0);
    HealthMetrics {
        brightness: level as f32 / rest_level.max(1) as f32,
        overexposed: overexposed / blocks,
        faded: faded / with_texture.max(1.0),
        matching: matching / blocks,
        unevenness: if still > 4.0 {
            variance.sqrt() / mean.max(0.1)
        } else {
            0.0
        },
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use gripline_sensor::Sensor;

    use super::{OVEREXPOSED, limit};
    use crate::constants::{CROP_SIDE, LOST_MAX};

    #[test]
    fn the_particle_fingertips_description_says_these_limits() {
        let sensor = Sensor::named(Path::new("particle-fingertip")).unwrap();
        let health = sensor.health;
        let same = |described: f64, ours: f32| {
            assert!((described - f64::from(ours)).abs() < 1e-6, "{described} {ours}");
        };
        for (described, ours) in health.brightness.into_iter().zip(limit::BRIGHTNESS) {
            same(described, ours);
        }
        for (described, ours) in health.rest_level.into_iter().zip(limit::REST_LEVEL) {
            same(described, ours);
        }
        same(health.overexposed_level, OVEREXPOSED.sqrt());
        same(health.overexposed_share, limit::OVEREXPOSED);
        same(health.lost_share, LOST_MAX);
        assert_eq!(sensor.capture.crop_px[2..], [CROP_SIDE; 2]);
    }
}
