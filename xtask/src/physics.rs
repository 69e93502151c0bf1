//! `cargo xtask physics`: the test world against closed forms, other programs and a finer grid.

use crate::error::Error;
use crate::process;

/// The test world's figures against their bounds.
pub(crate) fn run(arguments: &[String]) -> Result<(), Error> {
    process::run(
        process::cargo()
            .args(["run", "--release", "--package", "gripline-validation"])
            .args(["--bin", "physics", "--"])
            .args(arguments),
    )
}
