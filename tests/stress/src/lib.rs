//! Numerical stability of the detector and the controller: [`run`] sweeps them from one end of their range to the other,
//! beside detectors in [`floating`] point, with exact arithmetic as the judge ([`exact`]). `cargo xtask stress` prints what
//! came of it, `tests/quick.rs` holds a smaller run of the same sweeps. Units: forces in 1/4096 N or newtons as named.
//! Limits: closed-form contacts (`contacts`), no network; deterministic for a seed.
#![forbid(unsafe_code)]

mod board;
mod contacts;
mod effort;
pub mod exact;
pub mod floating;
pub mod picture;
pub mod report;
mod sweeps;

pub use effort::Effort;
pub use report::Sweep;

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
