//! Builds the emulated board: the emulator (its own workspace, because it asks for a newer compiler than it needs)
//! and the image that it runs unmodified.

use std::path::{Path, PathBuf};

use crate::error::Error;
use crate::firmware::{self, Board};
use crate::process;

/// The board whose chip the emulator models.
pub(crate) const BOARD: Board = Board::Stm32f427vi;

const MANIFEST: &str = "tests/emulator/Cargo.toml";

/// `cargo xtask emulator`.
pub(crate) fn command() -> Result<(), Error> {
    let emulator = build()?;
    let (image, _) = firmware::build(BOARD)?;
    println!("emulator {}", emulator.display());
    println!("image {}", image.display());
    Ok(())
}

/// Where the instruction counts lie that the latency crate's test holds.
const SNAPSHOT: &str = "tests/emulator/latency/tests/counts.txt";

/// `cargo xtask latency`: the unmodified image, every instruction priced; fails when a number of the design does not hold.
/// With `--short` it runs less, as every test run does. With `--bless`, writes the snapshot of instruction counts again.
pub(crate) fn latency(arguments: &[String]) -> Result<(), Error> {
    if let Some(found) = arguments
        .iter()
        .find(|argument| !["--json", "--bless", "--short"].contains(&argument.as_str()))
    {
        return Err(Error::usage(
            "argument",
            found,
            "--json, --short or --bless, or none",
        ));
    }
    let (image, _) = firmware::build(BOARD)?;
    let mut command = cargo();
    command
        .args(["run", "--quiet", "--release", "--package", "gripline-latency"])
        .args(OPTIONS)
        .args(["--", "--image"])
        .arg(image);
    if arguments.iter().any(|argument| argument == "--bless") {
        return process::run(command.args(["--bless", SNAPSHOT]));
    }
    process::run(
        command
            .arg("--twin")
            .arg(firmware::build_twin(BOARD)?)
            .args(arguments),
    )
}

/// Builds the emulator and keeps it with the other products.
pub(crate) fn build() -> Result<PathBuf, Error> {
    process::run(cargo().args(["build", "--release"]).args(OPTIONS))?;
    let built = build_dir()
        .join("release")
        .join(format!("gripline-emulator{}", std::env::consts::EXE_SUFFIX));
    let kept = kept();
    process::install(&built, &kept)?;
    Ok(kept)
}

/// The emulator that [`build`] kept.
pub(crate) fn product() -> Result<PathBuf, Error> {
    process::product(kept(), "the emulator")
}

/// Forgets the emulator that an earlier run kept.
pub(crate) fn discard() {
    let _ = std::fs::remove_file(kept());
}

fn kept() -> PathBuf {
    process::products().join(format!("gripline-emulator{}", std::env::consts::EXE_SUFFIX))
}

/// The emulator's formatting.
pub(crate) fn format() -> Result<(), Error> {
    process::run(cargo().args(["fmt", "--all", "--check", "--manifest-path", MANIFEST]))
}

/// The emulator's lints.
pub(crate) fn lint() -> Result<(), Error> {
    process::run(
        cargo()
            .args(["clippy", "--release", "--workspace", "--all-targets"])
            .args(OPTIONS)
            .args(["--", "-D", "warnings"]),
    )
}

/// The emulator's own tests and those of what it measures, those that want a real image included.
pub(crate) fn test(image: &Path) -> Result<(), Error> {
    process::run(
        cargo()
            .args(["test", "--release", "--workspace"])
            .args(OPTIONS)
            .args(["--", "--include-ignored"])
            .env("GRIPLINE_IMAGE", image),
    )
}

const OPTIONS: [&str; 3] = ["--ignore-rust-version", "--manifest-path", MANIFEST];

fn cargo() -> std::process::Command {
    let mut command = process::cargo();
    command.env("CARGO_TARGET_DIR", build_dir());
    command
}

/// Another lock file than the workspace's, so another folder.
fn build_dir() -> PathBuf {
    process::build_dir().join("emulator")
}
