//! `cargo xtask test`: every check that has to pass, in order, each announced and timed, and a summary at the end.
//!
//! A check that cannot run has failed. Later checks still run when an earlier one fails, unless they need its product,
//! so that one run shows everything that is wrong.

use std::time::{Duration, Instant};

use crate::error::Error;
use crate::firmware::{self, Board};
use crate::programs::{CHROMIUM, FFMPEG};
use crate::{arm, emulator, foxglove, modules, physics, process, python, ros2, toolchain, vm};

/// What one check came to.
struct Outcome {
    name: String,
    took: Duration,
    result: Result<(), String>,
}

/// Runs checks and remembers what they came to.
#[derive(Default)]
struct Checks {
    outcomes: Vec<Outcome>,
}

impl Checks {
    /// Runs one check; `None` when it failed.
    fn check<T>(&mut self, name: &str, run: impl FnOnce() -> Result<T, Error>) -> Option<T> {
        eprintln!("\n== {}. {name}", self.outcomes.len() + 1);
        let started = Instant::now();
        let (value, result) = match run() {
            Ok(value) => (Some(value), Ok(())),
            Err(error) => (None, Err(error.to_string())),
        };
        let took = started.elapsed();
        match &result {
            Ok(()) => eprintln!("== ok in {:.1} s", took.as_secs_f64()),
            Err(why) => eprintln!("== FAILED after {:.1} s: {why}", took.as_secs_f64()),
        }
        self.outcomes.push(Outcome {
            name: name.to_owned(),
            took,
            result,
        });
        value
    }

    /// Prints the table; fails when one check failed.
    fn summary(&self) -> Result<(), Error> {
        eprintln!("\n== summary");
        for (number, Outcome { name, took, result }) in (1..).zip(&self.outcomes) {
            let word = if result.is_ok() { "ok" } else { "FAILED" };
            eprintln!("{number:>3}. {word:<6} {:>7.1} s  {name}", took.as_secs_f64());
        }
        for Outcome { name, result, .. } in &self.outcomes {
            if let Err(why) = result {
                eprintln!("FAILED {name}: {why}");
            }
        }
        let of = self.outcomes.len();
        let failed = self
            .outcomes
            .iter()
            .filter(|outcome| outcome.result.is_err())
            .count();
        let took: Duration = self.outcomes.iter().map(|outcome| outcome.took).sum();
        eprintln!(
            "{} of {of} checks passed in {:.0} s",
            of - failed,
            took.as_secs_f64()
        );
        if failed == 0 {
            Ok(())
        } else {
            Err(Error::Checks { failed, of })
        }
    }
}

/// How much is checked.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Tier {
    /// What every change has to pass: 15 minutes are wanted in a fresh clone on two cores.
    Quick,
    /// The same and all that is slow: 45 minutes are wanted.
    All,
}

/// Crates that only the slow tier builds: their dependencies take minutes.
const SLOW_CRATES: [&str; 3] = ["gripline-ros2", "gripline-training", "gripline-validation"];

/// Crates whose libraries have nothing that a feature of the bridge changes.
const TESTED_WITHOUT_FEATURES: [&str; 24] = [
    "gripline-browser",
    "gripline-capture",
    "gripline-chart",
    "gripline-control",
    "gripline-evaluation",
    "gripline-firmware",
    "gripline-fuzz-bodies",
    "gripline-gripper",
    "gripline-link",
    "gripline-live",
    "gripline-markers",
    "gripline-mcu",
    "gripline-network",
    "gripline-pipeline",
    "gripline-protocol",
    "gripline-python",
    "gripline-recording",
    "gripline-ros2",
    "gripline-sensor",
    "gripline-simulation",
    "gripline-stress",
    "gripline-test-board",
    "gripline-tests",
    "gripline-validation",
];

/// The checks of a tier. The order is that of cost, except for the tests, which need the image and the emulator.
pub(crate) fn run(tier: Tier) -> Result<(), Error> {
    let all = tier == Tier::All;
    let without: Vec<&str> = if all {
        Vec::new()
    } else {
        SLOW_CRATES.iter().flat_map(|name| ["--exclude", name]).collect()
    };
    let mut checks = Checks::default();
    checks.check("format", || {
        process::run(process::cargo().args(["fmt", "--all", "--check"]))?;
        emulator::format()
    });
    checks.check("imports between files", modules::run);
    checks.check("lints", || {
        process::run(
            process::cargo()
                .args(["clippy", "--workspace", "--all-targets", "--keep-going"])
                .args(&without)
                .args(["--", "-D", "warnings"]),
        )
    });
    checks.check("core library for the microcontroller", || {
        toolchain::ensure(&toolchain::MCU, false)
    });
    checks.check("ffmpeg for clips", || FFMPEG.ensure());
    let python = if all {
        checks.check("Chromium for the live page", || CHROMIUM.ensure());
        checks.check("Python with another DDS", ros2::ensure)
    } else {
        None
    };
    let mut image = None;
    for board in Board::ALL
        .into_iter()
        .filter(|board| all || *board == emulator::BOARD)
    {
        let built = checks.check(&format!("image and its size, {}", board.name()), || {
            let (elf, size) = firmware::build(board)?;
            println!("{}: {size}", board.name());
            size.check(board)?;
            Ok(elf)
        });
        if board == emulator::BOARD {
            image = built;
        }
    }
    let emulator = checks.check("emulator", emulator::build);
    let (Some(emulator), Some(image)) = (emulator, image) else {
        checks.check("tests", || {
            Err::<(), _>(Error::Product {
                what: "emulator and image".to_owned(),
                found: "not both (a build failed above)".to_owned(),
                expected: "both, for the tests that run on the emulated board".to_owned(),
            })
        });
        return checks.summary();
    };
    let short = ["--short".to_owned()];
    checks.check("tests of the emulator", || emulator::test(&image));
    checks.check("latency: static bound and measured worst case", || {
        emulator::latency(if all { &[] } else { &short })
    });
    checks.check("tests, the emulated board included", || {
        let mut tests = process::cargo();
        tests
            .args(["test", "--workspace", "--no-fail-fast"])
            .args(&without)
            // Ignored by plain `cargo test` are those that need the emulator and the image, or fetch a Python package.
            .args(["--", "--include-ignored"])
            .env("GRIPLINE_EMULATOR", &emulator)
            .env("GRIPLINE_IMAGE", &image);
        if let Some(python) = &python {
            tests.env(ros2::VARIABLE, python);
        }
        if !all {
            // Tests in modules of this name.
            tests.args(["--skip", "slow::"]);
        }
        process::run(&mut tests)
    });
    if all {
        slow(&mut checks);
    }
    checks.summary()
}

/// What only the slow tier checks.
fn slow(checks: &mut Checks) {
    checks.check("documentation", || {
        process::run(
            process::cargo()
                .args(["doc", "--workspace", "--no-deps", "--keep-going"])
                .env("RUSTDOCFLAGS", "-D warnings"),
        )
    });
    checks.check("lints of the firmware binary", || firmware::lint(emulator::BOARD));
    checks.check("lints of the emulator", emulator::lint);
    features_of_the_bridge(checks, &["foxglove", "ros2"]);
    python_package(checks);
    // Speed is for a quiet machine and a command of its own.
    checks.check("physics", || physics::run(&["--without".into(), "speed".into()]));
    checks.check("64-bit ARM: builds, tests, bits, instructions", arm::check);
    // With the programs that the tests were just built with.
    checks.check("virtual machine: camera, USB, disks", || vm::run("dev", None));
    checks.check("Debian package in the virtual machine", || {
        vm::package::run("dev")
    });
}

/// The Python package.
pub(crate) fn python() -> Result<(), Error> {
    let mut checks = Checks::default();
    python_package(&mut checks);
    checks.summary()
}

fn python_package(checks: &mut Checks) {
    checks.check("Python package", python::check);
}

/// The bridge's feature `zenoh`: its lints and its tests.
pub(crate) fn zenoh() -> Result<(), Error> {
    let bridge = ["--package", "gripline", "--features", "zenoh"];
    let mut checks = Checks::default();
    checks.check("lints with zenoh", || {
        process::run(
            process::cargo()
                .arg("clippy")
                .args(bridge)
                .args(["--lib", "--", "-D", "warnings"]),
        )
    });
    checks.check("tests with zenoh", || {
        process::run(
            process::cargo()
                .arg("test")
                .args(bridge)
                .args(["--lib", "live::fleet"]),
        )
    });
    checks.summary()
}

/// The bridge's feature `foxglove`: its lints and its tests.
pub(crate) fn foxglove() -> Result<(), Error> {
    let mut checks = Checks::default();
    features_of_the_bridge(&mut checks, &["foxglove"]);
    checks.summary()
}

/// The bridge's feature `ros2` and the crate behind it: lints and tests.
pub(crate) fn ros2() -> Result<(), Error> {
    let mut checks = Checks::default();
    checks.check("lints of gripline-ros2", || {
        process::run(process::cargo().args([
            "clippy",
            "--package",
            "gripline-ros2",
            "--all-targets",
            "--",
            "-D",
            "warnings",
        ]))
    });
    checks.check("tests of gripline-ros2, with another DDS", || {
        let python = ros2::ensure()?;
        process::run(
            process::cargo()
                .args(["test", "--package", "gripline-ros2", "--", "--include-ignored"])
                .env(ros2::VARIABLE, python),
        )
    });
    features_of_the_bridge(&mut checks, &["ros2"]);
    checks.summary()
}

/// Lints and tests of what these features add to the bridge, built once with all of them, and with the other features of
/// `cargo test --workspace`: most of what was built for that serves again.
fn features_of_the_bridge(checks: &mut Checks, features: &[&str]) {
    let names = features.join(", ");
    checks.check(&format!("lints with {names}"), || {
        process::run(
            process::cargo()
                .args([
                    "clippy",
                    "--package",
                    "gripline",
                    "--features",
                    &features.join(","),
                ])
                .args(["--lib", "--bins", "--test", "bridge", "--", "-D", "warnings"]),
        )
    });
    checks.check(&format!("tests with {names}"), || {
        let features_of_the_workspace: Vec<String> =
            features.iter().map(|name| format!("gripline/{name}")).collect();
        process::run(
            process::cargo()
                .args(["test", "--workspace", "--lib", "--test", "bridge"])
                .args(["--features", &features_of_the_workspace.join(",")])
                .args(
                    TESTED_WITHOUT_FEATURES
                        .iter()
                        .flat_map(|name| ["--exclude", name]),
                )
                .args(["--", "--include-ignored"])
                .args(features.iter().map(|name| format!("{name}::")))
                .env(foxglove::VARIABLE, foxglove::ensure()?)
                .env(ros2::VARIABLE, ros2::ensure()?),
        )
    });
}
