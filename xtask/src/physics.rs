//! `cargo xtask physics`: the test world against closed forms, other programs and a finer grid.

use std::process::Command;

use crate::error::Error;
use crate::process;

/// The same with the profile of the tests, which built it: nothing is compiled again. It prints the same
/// figures in 200 s instead of 120. Speed is for a quiet machine and a command of its own.
pub(crate) fn check() -> Result<(), Error> {
    let built = process::build("dev", &[("gripline-validation", "physics")])?;
    process::run(
        Command::new(built.join("physics"))
            .args(["--without", "speed"])
            .current_dir(process::root()),
    )
}

/// The test world's figures against their bounds.
pub(crate) fn run(arguments: &[String]) -> Result<(), Error> {
    process::run(
        process::cargo()
            .args(["run", "--release", "--package", "gripline-validation"])
            .args(["--bin", "physics", "--"])
            .args(arguments),
    )
}
