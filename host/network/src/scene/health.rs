//! Can the picture be believed? It is compared, block by block, with the same sensor's picture at rest: light, contrast
//! of the particles, how much of the skin looks as it did, and whether the light still falls as it did. Pure function
//! of the two pictures.
//! Units: shares and ratios. Limits: calibrated on the simulated sensor (`gripline-training gate` prints the figures of
//! clean and faulty pictures); a touch hides part of the skin, so what is wrong with less than that goes unnoticed.

use std::fmt;

use super::{Coarse, Reference};
use crate::constants::{BLOCK_PIXELS, BLOCKS, IMAGE_PIXELS};

/// Correlation with the block at rest from which a block looks as it did.
const FAMILIAR: f32 = 0.6;
/// Correlation from which nothing has moved there, so that its brightness is the light's.
const STILL: f32 = 0.9;
/// Contrast over that at rest below which a block's particles are not to be seen.
const FADED: f32 = 0.3;
/// Mean square level from which a block is taken for over-exposed, grey levels squared.
const GLARING: f32 = 190.0 * 190.0;

/// What is known against a picture; any flag makes the map doubtful.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Health(u8);

impl Health {
    /// Nothing to report.
    pub const GOOD: Self = Self(0);
    /// Darker than the network was trained for.
    pub const TOO_DARK: Self = Self(1);
    /// Brighter than the network was trained for.
    pub const TOO_BRIGHT: Self = Self(1 << 1);
    /// Unlike anything in training: another sensor's picture, or light that falls otherwise than at rest.
    pub const UNLIKE_TRAINING: Self = Self(1 << 2);
    /// Particles are not to be seen where there were some at rest.
    pub const PARTICLES_LOST: Self = Self(1 << 3);
    const NAMES: [(Self, &'static str); 4] = [
        (Self::TOO_DARK, "too dark"),
        (Self::TOO_BRIGHT, "too bright"),
        (Self::UNLIKE_TRAINING, "unlike training"),
        (Self::PARTICLES_LOST, "particles lost"),
    ];

    /// The flags as bits, in the order of the constants, from the lowest.
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

/// What the health is judged by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Mean level over that at rest.
    pub light: f32,
    /// Share of blocks that glare.
    pub glaring: f32,
    /// Share of blocks whose particles are not to be seen, of those that had some.
    pub faded: f32,
    /// Share of blocks that look as at rest.
    pub familiar: f32,
    /// Standard deviation of the brightness over that at rest, where nothing has moved, over its mean.
    pub uneven: f32,
}

/// Limits that clean pictures keep.
mod limit {
    /// Least and greatest mean level over that at rest.
    pub(super) const LIGHT: [f32; 2] = [0.75, 1.35];
    /// Most glaring blocks.
    pub(super) const GLARING: f32 = 0.2;
    /// Most faded blocks.
    pub(super) const FADED: f32 = 0.2;
    /// Fewest familiar blocks.
    pub(super) const FAMILIAR: f32 = 0.3;
    /// Most uneven light.
    pub(super) const UNEVEN: f32 = 0.035;
    /// Least and greatest mean level of a picture at rest, grey levels.
    pub(super) const REST_LEVEL: [f32; 2] = [15.0, 120.0];
    /// Least standard deviation within the blocks of a picture at rest, grey levels.
    pub(super) const REST_CONTRAST: f32 = 4.0;
}

/// The health of one sensor's pictures.
#[derive(Debug, Clone)]
pub(super) struct Judge {
    /// What is wrong with the picture at rest is wrong with all.
    rest: Health,
}

impl Judge {
    pub(super) fn new(rest: &Reference) -> Self {
        let level = rest.levels.iter().sum::<i32>() as f32 / IMAGE_PIXELS as f32;
        let contrast: f32 = (0..BLOCKS)
            .map(|block| spread(rest.squares[block], rest.levels[block]))
            .sum();
        let deviation = (contrast / IMAGE_PIXELS as f32).max(0.0).sqrt();
        Self {
            rest: Health::GOOD
                .with(Health::TOO_DARK, level < limit::REST_LEVEL[0])
                .with(Health::TOO_BRIGHT, level > limit::REST_LEVEL[1])
                .with(Health::PARTICLES_LOST, deviation < limit::REST_CONTRAST),
        }
    }

    pub(super) fn judge(&self, coarse: &Coarse) -> Health {
        let figures = figures(coarse);
        self.rest
            .with(Health::TOO_DARK, figures.light < limit::LIGHT[0])
            .with(
                Health::TOO_BRIGHT,
                figures.light > limit::LIGHT[1] || figures.glaring > limit::GLARING,
            )
            .with(Health::PARTICLES_LOST, figures.faded > limit::FADED)
            .with(
                Health::UNLIKE_TRAINING,
                figures.familiar < limit::FAMILIAR || figures.uneven > limit::UNEVEN,
            )
    }
}

/// Sum of squared differences from a block's mean level.
fn spread(squares: i32, levels: i32) -> f32 {
    squares as f32 - levels as f32 * levels as f32 / BLOCK_PIXELS as f32
}

pub(super) fn figures(coarse: &Coarse) -> Figures {
    let (sums, rest) = (&coarse.sums, &coarse.rest);
    let (mut level, mut rest_level) = (0, 0);
    let [mut glaring, mut had, mut faded, mut familiar, mut still] = [0.0_f32; 5];
    let [mut gain_sum, mut gain_squares] = [0.0_f32; 2];
    let pixels = BLOCK_PIXELS as f32;
    for block in 0..BLOCKS {
        level += sums.levels[block];
        rest_level += rest.levels[block];
        let now = spread(sums.squares[block], sums.levels[block]);
        let before = spread(rest.squares[block], rest.levels[block]).max(1.0);
        let products = sums.products[0][0][block] as f32;
        let both = products - sums.levels[block] as f32 * rest.levels[block] as f32 / pixels;
        // Comparing squares saves the root; a negative correlation is none.
        let like = both.max(0.0) * both.max(0.0) / (now.max(1.0) * before);
        let gain = products / rest.squares[block].max(1) as f32;
        let flag = |set: bool| f32::from(u8::from(set));
        let textured = flag(before > pixels * limit::REST_CONTRAST * limit::REST_CONTRAST);
        glaring += flag(sums.squares[block] as f32 > pixels * GLARING);
        had += textured;
        faded += textured * flag(now < FADED * before);
        familiar += flag(like > FAMILIAR * FAMILIAR);
        let holds = flag(like > STILL * STILL);
        still += holds;
        gain_sum += holds * gain;
        gain_squares += holds * gain * gain;
    }
    let blocks = BLOCKS as f32;
    let mean = gain_sum / still.max(1.0);
    let variance = (gain_squares / still.max(1.0) - mean * mean).max(0.0);
    Figures {
        light: level as f32 / rest_level.max(1) as f32,
        glaring: glaring / blocks,
        faded: faded / had.max(1.0),
        familiar: familiar / blocks,
        uneven: if still > 4.0 {
            variance.sqrt() / mean.max(0.1)
        } else {
            0.0
        },
    }
}
