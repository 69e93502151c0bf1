//! `cargo xtask test`: every check that has to pass, in order, each announced and timed, and a summary at the end.
//!
//! A check that cannot run has failed. Later checks still run when an earlier one fails, unless they need its product,
//! so that one run shows everything that is wrong. What computes on one core for minutes runs beside what compiles, and tests that
//! only compute beside the board's checks; tests that wait for a clock run alone.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crate::error::Error;
use crate::firmware::{self, Board};
use crate::programs::{CHROMIUM, FFMPEG};
use crate::test_parts::{self, Part};
use crate::{emulator, foxglove, modules, physics, process, python, ros2, toolchain, vm};

/// What one check came to.
struct Outcome {
    name: String,
    took: Duration,
    result: Result<(), String>,
}

/// Runs checks and remembers what they came to.
struct Checks {
    started: Instant,
    outcomes: Vec<Outcome>,
}

/// A command of this program that runs beside the checks, as a process of its own.
struct Beside {
    name: String,
    /// What it printed.
    log: PathBuf,
    ended: JoinHandle<(Duration, Result<(), String>)>,
}

impl Beside {
    fn start(name: &str, arguments: &[&str]) -> Result<Self, Error> {
        let program = std::env::current_exe().map_err(|source| Error::file(Path::new("xtask"), source))?;
        let mut command = Command::new(program);
        let line = format!("cargo xtask {}", arguments.join(" "));
        let folder = process::products();
        let log = folder.join(format!("{}.log", arguments.join("")));
        let file = |source| Error::file(&log, source);
        fs::create_dir_all(&folder).map_err(file)?;
        let output = File::create(&log).map_err(file)?;
        command
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(output.try_clone().map_err(file)?)
            .stderr(output);
        eprintln!("\n== beside what follows: {name} ({line})");
        let started = Instant::now();
        let mut child = command.spawn().map_err(|source| Error::Start {
            program: line.clone(),
            source,
        })?;
        let ended = thread::spawn(move || {
            let result = match child.wait() {
                Ok(status) if status.success() => Ok(()),
                Ok(status) => Err(format!("`{line}`: {status}; what it said stands above")),
                Err(error) => Err(format!("`{line}`: {error}")),
            };
            (started.elapsed(), result)
        });
        Ok(Self {
            name: name.to_owned(),
            log,
            ended,
        })
    }
}

impl Checks {
    fn new() -> Self {
        Self {
            started: Instant::now(),
            outcomes: Vec::new(),
        }
    }

    /// Starts a command of this program beside the checks that follow.
    fn beside(&mut self, name: &str, arguments: &[&str]) -> Option<Beside> {
        Beside::start(name, arguments)
            .map_err(|error| self.note(name, Duration::ZERO, Err(error.to_string())))
            .ok()
    }

    /// Waits for such a command and shows what it said. One that could not start has been noted.
    fn join(&mut self, beside: Option<Beside>) {
        let Some(Beside { name, log, ended }) = beside else {
            return;
        };
        eprintln!("\n== {}. {name}, which ran beside", self.outcomes.len() + 1);
        let (took, result) = ended.join().unwrap_or_else(|_| {
            let died = "the thread that waits for it ended early".to_owned();
            (Duration::ZERO, Err(died))
        });
        match fs::read(&log) {
            Ok(said) => eprint!("{}", String::from_utf8_lossy(&said)),
            Err(error) => eprintln!("{}: {error}", log.display()),
        }
        self.note(&name, took, result);
    }

    /// Runs one check; `None` when it failed.
    fn check<T>(&mut self, name: &str, run: impl FnOnce() -> Result<T, Error>) -> Option<T> {
        eprintln!("\n== {}. {name}", self.outcomes.len() + 1);
        let started = Instant::now();
        let (value, result) = match run() {
            Ok(value) => (Some(value), Ok(())),
            Err(error) => (None, Err(error.to_string())),
        };
        self.note(name, started.elapsed(), result);
        value
    }

    /// Says and remembers what a check came to.
    fn note(&mut self, name: &str, took: Duration, result: Result<(), String>) {
        match &result {
            Ok(()) => eprintln!("== ok in {:.1} s", took.as_secs_f64()),
            Err(why) => eprintln!("== FAILED after {:.1} s: {why}", took.as_secs_f64()),
        }
        self.outcomes.push(Outcome {
            name: name.to_owned(),
            took,
            result,
        });
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
        eprintln!(
            "{} of {of} checks passed in {:.0} s",
            of - failed,
            self.started.elapsed().as_secs_f64()
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
    /// What every change has to pass beside the lints: 15 minutes are wanted in a fresh clone on two cores.
    Quick,
    /// The same and all that is slow: 45 minutes are wanted.
    All,
}

/// Crates that only the slow tier builds: their dependencies take minutes.
const SLOW_CRATES: [&str; 3] = ["gripline-ros2", "gripline-training", "gripline-validation"];

/// The checks of a tier.
pub(crate) fn run(tier: Tier) -> Result<(), Error> {
    let all = tier == Tier::All;
    let without: Vec<&str> = if all {
        Vec::new()
    } else {
        SLOW_CRATES.iter().flat_map(|name| ["--exclude", name]).collect()
    };
    let mut checks = Checks::new();
    let xtask = test_parts::this_program()?;
    style(&mut checks);
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
    // So that no test takes those of an earlier run for what could not be built.
    emulator::discard();
    firmware::discard(emulator::BOARD);
    let board: &[&str] = if all {
        &["test", "--board", "--all"]
    } else {
        &["test", "--board"]
    };
    let board = checks.beside("images, emulator and its tests, latency", board);
    if all {
        lints_of_the_workspace(&mut checks);
    }
    let tests = || {
        let mut tests = process::cargo();
        tests
            .arg("test")
            .args(process::WORKSPACE)
            .arg("--no-fail-fast")
            .args(&without);
        tests
    };
    checks.check("tests of xtask", || {
        process::run(process::cargo().args(["test", "--package", "xtask"]))
    });
    checks.check("build of the tests", || process::run(tests().arg("--no-run")));
    if all {
        checks.check("documentation", || {
            process::run(
                process::cargo()
                    .args(["doc", "--workspace", "--no-deps", "--keep-going"])
                    .env("RUSTDOCFLAGS", "-D warnings"),
            )
        });
        lints_of_features(&mut checks, &FEATURES);
        checks.check("build of the tests of features", || {
            process::run(bridge_with("test", &FEATURES).arg("--no-run"))
        });
    }
    let part = |part: Part| {
        let mut tests = tests();
        tests
            .args(part.option(&xtask))
            // Ignored by plain `cargo test` are those that need the emulator and the image, or fetch a Python package.
            .args(["--", "--include-ignored"]);
        if !all {
            // Tests in modules of this name.
            tests.args(["--skip", "slow::"]);
        }
        tests
    };
    checks.check("tests that only compute", || {
        process::run(&mut part(Part::Computing))
    });
    checks.join(board);
    checks.check("tests, the emulated board included", || {
        let (emulator, image) = (emulator::product()?, firmware::product(emulator::BOARD)?);
        let mut tests = part(Part::Waiting);
        tests
            .env("GRIPLINE_EMULATOR", emulator)
            .env("GRIPLINE_IMAGE", image);
        if let Some(python) = &python {
            tests.env(ros2::VARIABLE, python);
        }
        process::run(&mut tests)
    });
    if all {
        slow(&mut checks);
    }
    checks.summary()
}

/// What is checked without running anything: format, imports, lints of the workspace.
pub(crate) fn lint() -> Result<(), Error> {
    let mut checks = Checks::new();
    style(&mut checks);
    lints_of_the_workspace(&mut checks);
    checks.summary()
}

/// What takes seconds.
fn style(checks: &mut Checks) {
    checks.check("format", || {
        process::run(process::cargo().args(["fmt", "--all", "--check"]))?;
        emulator::format()
    });
    checks.check("imports between files", modules::run);
}

fn lints_of_the_workspace(checks: &mut Checks) {
    let mut lints = |name: &str, packages: &[&str]| {
        checks.check(name, || {
            process::run(process::cargo().arg("clippy").args(packages).args([
                "--all-targets",
                "--keep-going",
                "--",
                "-D",
                "warnings",
            ]))
        });
    };
    lints("lints of xtask", &["--package", "xtask"]);
    lints("lints", &process::WORKSPACE);
}

/// What is checked of the images and on the emulated board without the bridge.
pub(crate) fn board(tier: Tier) -> Result<(), Error> {
    let all = tier == Tier::All;
    let mut checks = Checks::new();
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
    checks.check("emulator", emulator::build);
    checks.check("tests of the emulator", || {
        let image = image.as_ref().ok_or_else(|| Error::Product {
            what: "image".to_owned(),
            found: "none (its build failed above)".to_owned(),
            expected: "one, for the tests that run it".to_owned(),
        })?;
        emulator::test(image)
    });
    let short = ["--short".to_owned()];
    checks.check("latency: static bound and measured worst case", || {
        emulator::latency(if all { &[] } else { &short })
    });
    if all {
        checks.check("lints of the firmware binary", || firmware::lint(emulator::BOARD));
        checks.check("lints of the emulator", emulator::lint);
    }
    checks.summary()
}

/// What only the slow tier checks, after the tests.
fn slow(checks: &mut Checks) {
    checks.check(&format!("tests with {}", FEATURES.join(", ")), || {
        run_tests_of_features(&FEATURES)
    });
    let arm = checks.beside("64-bit ARM: builds, tests, bits, instructions", &["arm"]);
    python_package(checks);
    checks.join(arm);
    // It computes on one core, the virtual machine on the other.
    let physics = checks.beside("physics", &["test", "--physics"]);
    // With the programs that the tests were just built with.
    checks.check("virtual machine: camera, USB, disks", || vm::run("dev", None));
    checks.check("Debian package in the virtual machine", || {
        vm::package::run("dev")
    });
    checks.join(physics);
}

/// The Python package.
pub(crate) fn python() -> Result<(), Error> {
    let mut checks = Checks::new();
    python_package(&mut checks);
    checks.summary()
}

fn python_package(checks: &mut Checks) {
    checks.check("Python package", python::check);
}

/// The test world against closed forms and other programs.
pub(crate) fn physics() -> Result<(), Error> {
    let mut checks = Checks::new();
    checks.check("physics", physics::check);
    checks.summary()
}

/// The bridge's feature `zenoh`: its lints and its tests.
pub(crate) fn zenoh() -> Result<(), Error> {
    let bridge = ["--package", "gripline", "--features", "zenoh"];
    let mut checks = Checks::new();
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
    let mut checks = Checks::new();
    features_of_the_bridge(&mut checks, &["foxglove"]);
    checks.summary()
}

/// The bridge's feature `ros2` and the crate behind it: lints and tests.
pub(crate) fn ros2() -> Result<(), Error> {
    let mut checks = Checks::new();
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

/// Features of the bridge that the slow tier checks.
const FEATURES: [&str; 2] = ["foxglove", "ros2"];

/// Lints and tests of what these features add to the bridge.
fn features_of_the_bridge(checks: &mut Checks, features: &[&str]) {
    lints_of_features(checks, features);
    checks.check(&format!("tests with {}", features.join(", ")), || {
        run_tests_of_features(features)
    });
}

/// The bridge with these features, in the workspace: cargo then gives its dependencies the features that they had for all other
/// checks, and most of what was compiled for those serves again.
fn bridge_with(command: &str, features: &[&str]) -> Command {
    let features: Vec<String> = features.iter().map(|name| format!("gripline/{name}")).collect();
    let mut cargo = process::as_tests(command);
    cargo.args(["--features", &features.join(",")]);
    cargo
}

fn lints_of_features(checks: &mut Checks, features: &[&str]) {
    checks.check(&format!("lints with {}", features.join(", ")), || {
        process::run(bridge_with("clippy", features).args(["--bin", "gripline", "--", "-D", "warnings"]))
    });
}

fn run_tests_of_features(features: &[&str]) -> Result<(), Error> {
    process::run(
        bridge_with("test", features)
            .args(["--", "--include-ignored"])
            .args(features.iter().map(|name| format!("{name}::")))
            .env(foxglove::VARIABLE, foxglove::ensure()?)
            .env(ros2::VARIABLE, ros2::ensure()?),
    )
}
