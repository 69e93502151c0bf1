//! What can go wrong in this crate. Written out, without a derive: this crate takes a minute to compile, begins without waiting for
//! another one, and is never compiled again because a dependency was asked for other features.

use std::fmt;

/// An error of this crate.
#[derive(Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum KernelError {
    /// The processor lacks an instruction set.
    MissingInstructionSet {
        /// The one asked for.
        wanted: String,
        /// Those it has, comma-separated.
        available: String,
    },
    /// No instruction set has this name.
    UnknownInstructionSet {
        /// The name.
        found: String,
    },
}

impl fmt::Display for KernelError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::MissingInstructionSet { wanted, available } => write!(
                f,
                "instruction set `{wanted}` was asked for, but this processor has only {available}; choose one of these"
            ),
            Self::UnknownInstructionSet { found } => write!(
                f,
                "instruction set `{found}` is unknown, expected `portable`, `avx2`, `avx512` or `neon`"
            ),
        }
    }
}

impl std::error::Error for KernelError {}
