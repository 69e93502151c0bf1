//! What samples are for.

use crate::random::Random;

/// What samples are for. No two splits share a virtual sensor or a random surface, and the built-in shapes of
/// [`Split::Test`] are [`crate::contact_world::UNSEEN_SHAPES`], which no other split sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Split {
    /// Gradient steps.
    Train = 1,
    /// Early stopping.
    Validation = 2,
    /// The detector's thresholds.
    Calibration = 3,
    /// What is reported.
    Test = 4,
}

impl Split {
    /// All four.
    pub const ALL: [Self; 4] = [Self::Train, Self::Validation, Self::Calibration, Self::Test];

    /// The split's name, in lower case.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Validation => "validation",
            Self::Calibration => "calibration",
            Self::Test => "test",
        }
    }

    /// A number of a sensor or surface that is this split's own: its upper four bits. 0 there is left to scenes.
    pub(crate) fn own_number(self, random: &mut Random) -> u64 {
        ((self as u64) << 60) | (random.bits() >> 4)
    }
}
