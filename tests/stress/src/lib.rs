//! Numerical stability of the detector and the controller: [`run`] sweeps them from one end of their range to the other,
//! beside detectors in [`floating`] point, with exact arithmetic as the judge ([`exact`]). `cargo xtask stress` prints what
//! came of it, `tests/quick.rs` holds a smaller run of the same sweeps. Units: forces in 1/4096 N or newtons as named.
//! Limits: closed-form contacts (`contacts`), no network; deterministic for a seed.
#![forbid(unsafe_code)]

mod board;
mod contacts;
pub mod exact;
pub mod floating;
pub mod picture;
pub mod report;
mod sweeps;

pub use report::Sweep;

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
    const fn of(self, full: usize, quick: usize) -> usize {
        if self.is_quick { quick } else { full }
    }

    /// Random numbers of their own for each sweep.
    fn random(self, stream: u64) -> Pcg64Mcg {
        Pcg64Mcg::new(u128::from(self.seed) << 64 | 0x6772_6970 << 16 | u128::from(stream))
    }
}

/// Every sweep, in order. `begun` is told the name of each before it starts.
#[must_use]
pub fn run(effort: Effort, mut begun: impl FnMut(&str)) -> Vec<Sweep> {
    sweeps::ALL
        .iter()
        .map(|(name, sweep)| {
            begun(name);
            sweep(effort)
        })
        .collect()
}
