//! How much the sweeps try, and their random numbers.

use rand_pcg::Pcg64Mcg;

/// How much is tried, and from which seed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effort {
    /// Of every random number.
    pub seed: u64,
    /// A small part of everything: for tests.
    pub is_quick: bool,
}

impl Effort {
    /// How many of something.
    pub(crate) const fn of(self, full: usize, quick: usize) -> usize {
        if self.is_quick { quick } else { full }
    }

    /// Random numbers of their own for each sweep.
    pub(crate) fn random(self, stream: u64) -> Pcg64Mcg {
        Pcg64Mcg::new(u128::from(self.seed) << 64 | 0x6772_6970 << 16 | u128::from(stream))
    }
}
