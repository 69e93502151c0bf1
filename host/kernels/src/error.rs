//! What can go wrong in this crate.

/// An error of this crate.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum KernelError {
    /// The processor lacks an instruction set.
    #[error(
        "instruction set `{wanted}` was asked for, but this processor has only {available}; choose one of these"
    )]
    MissingInstructionSet {
        /// The one asked for.
        wanted: String,
        /// Those it has, comma-separated.
        available: String,
    },
    /// No instruction set has this name.
    #[error("instruction set `{found}` is unknown, expected `portable`, `avx2`, `avx512` or `neon`")]
    UnknownInstructionSet {
        /// The name.
        found: String,
    },
}
