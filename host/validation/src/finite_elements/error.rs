//! What can go wrong in a finite-element solve.

use gripline_simulation::SimulationError;

/// Forces out of balance that are accepted, share of the reactions at the held nodes.
pub(super) const BALANCE: f64 = 1e-7;

/// The error of every fallible call in this module.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FiniteElementError {
    /// A parameter outside its range, or a solve of the contact world that failed.
    #[error(transparent)]
    World(#[from] SimulationError),
    /// A solve did not settle.
    #[error(
        "finite elements: forces are {found} out of balance after {steps} Newton steps, expected at most {BALANCE}: \
         press less deep or use a finer mesh"
    )]
    OutOfBalance {
        /// Forces left over, as a share of the reactions.
        found: f64,
        /// Newton steps taken.
        steps: usize,
    },
}

/// `value`, if `ok` holds for it.
pub(super) fn checked(
    field: &'static str,
    value: f64,
    expected: &'static str,
    ok: bool,
) -> Result<f64, FiniteElementError> {
    if ok {
        return Ok(value);
    }
    Err(FiniteElementError::World(SimulationError::OutOfRange {
        field,
        found: value,
        expected,
    }))
}
