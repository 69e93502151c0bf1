//! What can go wrong in this crate: a parameter outside its range, or a contact solve that did not converge.
//! Every message names the field, what was found and what was expected.

/// The error of every fallible call in this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimulationError {
    /// A number outside its range, or not a number.
    #[error("{field} is {found}, expected {expected}")]
    OutOfRange {
        /// Name of the field, unit included.
        field: &'static str,
        /// The value that was given.
        found: f64,
        /// The range that is accepted.
        expected: &'static str,
    },
    /// A camera file that cannot be used.
    #[error("camera file, line {line}: {key} is {found}, expected {expected}")]
    CameraFile {
        /// Line in the file, from 1; of a missing key, the last.
        line: usize,
        /// The key.
        key: String,
        /// What stands there.
        found: String,
        /// What should.
        expected: String,
    },
    /// The loads of this step were not reached; the state before the step is kept.
    #[error(
        "contact loads are off by {found} of the friction limit after {iterations} iterations, expected at most \
         {expected}: use smaller load steps"
    )]
    NoConvergence {
        /// Residual, as a share of the friction limit.
        found: f64,
        /// The bound on it.
        expected: f64,
        /// Newton steps taken.
        iterations: usize,
    },
    /// Gap or friction of a solved contact are not met; the state before the step is kept.
    #[error(
        "contact residual is {found} after {rounds} rounds, expected at most {expected}: use smaller steps"
    )]
    ContactUnsolved {
        /// The larger of the gap and friction residuals.
        found: f64,
        /// The bound on it.
        expected: f64,
        /// Rounds between pressure and shear.
        rounds: usize,
    },
    /// Friction cannot hold the load along the gel; the state before the step is kept.
    #[error(
        "a load along the gel of ({}, {}) N and {} N·mm slides the indenter away, expected one that friction holds \
         (at most {max_n:.3} N): pull less, press more, or drag by place",
        load[0], load[1], load[2]
    )]
    Slides {
        /// What was to be held, N, N, N·mm.
        load: [f64; 3],
        /// What friction holds of a pull alone, N.
        max_n: f64,
    },
    /// The contact reaches the edge of the sensing surface; the state before the step is kept.
    #[error(
        "the contact of the indenter at ({x_mm}, {y_mm}) mm reaches the edge of the sensing surface, expected \
         contact inside ±16 mm: move the indenter inwards or press less"
    )]
    OffSurface {
        /// Where the indenter stands on the gel, x.
        x_mm: f64,
        /// Where the indenter stands on the gel, y.
        y_mm: f64,
    },
}

/// `value`, if it is finite and `ok` holds for it.
pub(crate) fn checked(
    field: &'static str,
    value: f64,
    expected: &'static str,
    ok: impl Fn(f64) -> bool,
) -> Result<f64, SimulationError> {
    if value.is_finite() && ok(value) {
        Ok(value)
    } else {
        Err(SimulationError::OutOfRange {
            field,
            found: value,
            expected,
        })
    }
}

/// A finite value above zero.
pub(crate) fn positive(field: &'static str, value: f64) -> Result<f64, SimulationError> {
    checked(field, value, "a finite number above 0", |v| v > 0.0)
}

/// A finite value, zero or above.
pub(crate) fn not_negative(field: &'static str, value: f64) -> Result<f64, SimulationError> {
    checked(field, value, "a finite number, 0 or above", |v| v >= 0.0)
}

/// Any finite value.
pub(crate) fn finite(field: &'static str, value: f64) -> Result<f64, SimulationError> {
    checked(field, value, "a finite number", |_| true)
}
