//! `cargo xtask arm`: 64-bit ARM. Cross-builds with Debian's gcc and runs the tests under qemu-user; compares the networks'
//! forces with this processor's, bit by bit; counts the instructions of a frame, NEON against portable.
//!
//! Limits: instructions are no times; this machine is an x86-64 with AVX2.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::Error;
use crate::process;
use crate::programs;
use crate::toolchain::{self, ARM, Libraries};

/// Where Debian's cross libraries lie.
const LIBRARIES: &str = "/usr/aarch64-linux-gnu";
const LINKER: &str = "aarch64-linux-gnu-gcc";
const EMULATOR: &str = "qemu-aarch64";

/// The case whose instructions are bounded: the shipped network without the tracker, and the most that NEON may take of
/// the portable set's.
const BOUNDED: &str = "tracked-network-int16";
const RATIO_MAX: f64 = 0.35;

/// The crate that has code of its own for ARM. All its tests are in `tests/it`.
const KERNELS: &str = "gripline-kernels";

/// Crates whose library tests and `tests/it` run under emulation, beside the kernels'.
const CRATES: [&str; 3] = ["gripline-network", "gripline-firmware", "gripline"];

/// Crates that compute, which the checks compile as a release does. Everything else they compile as all other tests do, so that
/// procedural macros and build scripts are there.
const AS_RELEASED: [&str; 3] = [KERNELS, "gripline-network", "gripline-firmware"];

/// Tests that do not. Emulation is twenty times as slow, and these take minutes there: they simulate fingertips or draw
/// every size of screen. What they check does not depend on the processor, and the kernels under it are tested here.
const SLOW: [&str; 3] = [
    "rest::tests::",
    "view::tests::no_size_and_no_number_makes_it_panic",
    "commands::doctor::judge::tests::a_rest_picture_that_is_missing_moved_dented_dimmed_or_anothers_is_reported",
];

/// A test that starts ffmpeg from a program with threads, which qemu-user does not always survive.
const STARTS_PROGRAMS: [&str; 1] = [
    "commands::simulate::command::tests::a_frame_without_solution_is_missing_everywhere_alike_counted_and_ends_with_loss",
];

/// `cargo xtask arm`.
pub(crate) fn command(arguments: &[String]) -> Result<(), Error> {
    match arguments {
        [] => check(),
        [what] if what == "build" => {
            println!("{}", build_bridge("release")?.display());
            Ok(())
        }
        [what, rest @ ..] if what == "instructions" && (rest.is_empty() || rest == ["--json"]) => {
            let counts = Cross::ensure()?.compare("release")?;
            if rest.is_empty() {
                print!("{}", table(&counts));
            } else {
                println!("{}", json(&counts));
            }
            judge(&counts)
        }
        [found, ..] => Err(Error::usage(
            "argument",
            found,
            "build, instructions [--json] or none",
        )),
    }
}

/// The bridge for ARM, started under emulation.
pub(crate) fn build_bridge(profile: &str) -> Result<PathBuf, Error> {
    Cross::ensure()?.build_bridge(profile)
}

/// Starts a program for ARM under emulation: it says its version.
pub(crate) fn start(program: &Path) -> Result<(), Error> {
    process::run(
        Command::new(EMULATOR)
            .args(["-L", LIBRARIES])
            .arg(program)
            .arg("--version"),
    )
}

/// Every check.
pub(crate) fn check() -> Result<(), Error> {
    let cross = Cross::ensure()?;
    let counts = cross.compare("dev")?;
    print!("{}", table(&counts));
    judge(&counts)?;
    cross.lint()?;
    cross.test()
}

/// All that a build for ARM needs.
struct Cross {
    libraries: Libraries,
}

impl Cross {
    fn ensure() -> Result<Self, Error> {
        programs::ARM.ensure()?;
        let libraries = toolchain::ensure(&ARM, false)?;
        Ok(Self { libraries })
    }

    /// Cargo for ARM. Linker and emulator stand here and not in `.cargo/config.toml`, which a native ARM machine reads too.
    fn cargo(&self, command: &str) -> Command {
        let mut cargo = process::cargo();
        cargo
            .args([command, "--target", ARM.triple])
            .args(self.libraries.cargo_arguments())
            .env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER", LINKER)
            .env(
                "CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER",
                format!("{EMULATOR} -L {LIBRARIES}"),
            )
            // These would replace the flag that names the libraries.
            .env_remove("RUSTFLAGS")
            .env_remove("CARGO_ENCODED_RUSTFLAGS");
        cargo
    }

    fn build_bridge(&self, profile: &str) -> Result<PathBuf, Error> {
        process::run(
            self.cargo("build")
                .args(["--profile", profile, "--package", "gripline"]),
        )?;
        let folder = process::build_dir().join(ARM.triple);
        let built = folder.join(process::profile_folder(profile)).join("gripline");
        start(&built)?;
        Ok(built)
    }

    /// Cargo for the checks, which compile everything with the same features and flags.
    fn checks(&self, command: &str) -> Command {
        let mut cargo = self.cargo(command);
        for name in AS_RELEASED {
            for setting in ["opt-level=3", "overflow-checks=false", "debug-assertions=false"] {
                cargo.args(["--config", &format!("profile.dev.package.{name}.{setting}")]);
            }
        }
        cargo
    }

    /// Lints of what is compiled for ARM alone.
    fn lint(&self) -> Result<(), Error> {
        process::run(
            self.checks("clippy")
                .args(["--package", KERNELS, "--", "-D", "warnings"]),
        )
    }

    /// Tests under emulation. The bridge's program is built with its tests.
    fn test(&self) -> Result<(), Error> {
        let left_out = SLOW
            .iter()
            .chain(&STARTS_PROGRAMS)
            .flat_map(|name| ["--skip", name]);
        process::run(self.checks("test").args(["--package", KERNELS, "--test", "it"]))?;
        process::run(
            self.checks("test")
                .args(packages())
                .args(["--lib", "--bin", "gripline", "--test", "it", "--"])
                .args(left_out),
        )
    }

    /// The networks' forces on this processor and, built with a profile, on ARM; fails when a bit differs. The instructions of each
    /// case. With `dev` it is built as the checks are.
    fn compare(&self, profile: &str) -> Result<Vec<Case>, Error> {
        let example = "instruction_set";
        // Bits do not depend on the profile: this one is there from the other tests.
        let native = process::example(example)?;
        let mut build = if profile == "dev" {
            self.checks("build")
        } else {
            self.cargo("build")
        };
        process::run(
            build
                .args(["--profile", profile])
                .args(packages())
                .args(["--example", example]),
        )?;
        let arm = process::build_dir()
            .join(ARM.triple)
            .join(process::profile_folder(profile))
            .join("examples")
            .join(example);
        let counter = counter()?;
        let run = |set: &str| -> Result<Vec<Frame>, Error> { counted(&counter, &arm, set) };
        let (portable, neon) = (run("portable")?, run("neon")?);
        for (here, there, arm) in [("avx2", "neon", &neon), ("portable", "portable", &portable)] {
            let expected = process::output(Command::new(&native).arg(here))?;
            let found: Vec<&str> = arm.iter().map(|frame| frame.line.as_str()).collect();
            if let Some((expected, found)) = expected.lines().zip(&found).find(|(a, b)| a != *b) {
                return Err(Error::Product {
                    what: format!("forces of `{there}` on ARM"),
                    found: (*found).to_owned(),
                    expected: format!("{expected} as `{here}` gives here, bit by bit"),
                });
            }
            if expected.lines().count() != found.len() {
                return Err(Error::Product {
                    what: format!("frames of `{there}` on ARM"),
                    found: found.len().to_string(),
                    expected: expected.lines().count().to_string(),
                });
            }
        }
        Ok(cases(&portable, &neon))
    }
}

/// The options that choose [`CRATES`].
fn packages() -> impl Iterator<Item = &'static str> {
    CRATES.into_iter().flat_map(|name| ["--package", name])
}

/// The plugin that counts, built with the machine's own compiler.
fn counter() -> Result<PathBuf, Error> {
    let version = process::word_of(Command::new(EMULATOR).arg("--version"))?;
    let api = plugin_api(&version).ok_or_else(|| Error::Product {
        what: format!("`{EMULATOR} --version`"),
        found: version.lines().next().unwrap_or_default().to_owned(),
        expected: "a version".to_owned(),
    })?;
    let folder = process::products();
    fs::create_dir_all(&folder).map_err(|source| Error::file(&folder, source))?;
    let plugin = folder.join("libinstructions.so");
    process::run(
        Command::new("cc")
            .current_dir(process::root())
            .args([
                "-O2",
                "-Wall",
                "-Wextra",
                "-Werror",
                "-fPIC",
                "-shared",
                "-fvisibility=hidden",
            ])
            .arg(format!("-DAPI_VERSION={api}"))
            .arg("-o")
            .arg(&plugin)
            .arg("xtask/arm/instructions.c"),
    )?;
    Ok(plugin)
}

/// The version of the plugin interface that a qemu offers: 2 is the oldest from qemu 9 on, the latest before.
fn plugin_api(version: &str) -> Option<u32> {
    let number = version.split("version ").nth(1)?;
    let major: u32 = number.split('.').next()?.parse().ok()?;
    Some(if major < 9 { 1 } else { 2 })
}

/// A line that the program printed, and the instructions until then.
#[derive(Debug, PartialEq, Eq)]
struct Frame {
    line: String,
    instructions: u64,
}

/// Runs the program under emulation and counts.
fn counted(counter: &Path, program: &Path, set: &str) -> Result<Vec<Frame>, Error> {
    let log = process::products().join(format!("instructions-{set}.txt"));
    let printed = process::output(
        Command::new(EMULATOR)
            .args(["-L", LIBRARIES, "-d", "plugin", "-D"])
            .arg(&log)
            .arg("-plugin")
            .arg(counter)
            .arg(program)
            .arg(set),
    )?;
    let counts = fs::read_to_string(&log).map_err(|source| Error::file(&log, source))?;
    frames(&printed, &counts)
}

/// A count for every line.
fn frames(printed: &str, counts: &str) -> Result<Vec<Frame>, Error> {
    let numbers: Vec<u64> = counts
        .lines()
        .filter_map(|line| line.trim().parse().ok())
        .collect();
    if numbers.len() != printed.lines().count() || numbers.is_empty() {
        return Err(Error::Product {
            what: "counts of instructions".to_owned(),
            found: numbers.len().to_string(),
            expected: format!("{}, one for every line", printed.lines().count()),
        });
    }
    let lines = printed.lines().zip(numbers);
    Ok(lines
        .map(|(line, instructions)| Frame {
            line: line.to_owned(),
            instructions,
        })
        .collect())
}

/// The instructions of a case's last frame.
#[derive(Debug, PartialEq)]
struct Case {
    name: String,
    portable: u64,
    neon: u64,
}

impl Case {
    fn ratio(&self) -> f64 {
        self.neon as f64 / self.portable as f64
    }
}

/// Both hold the same lines. A case's last frame is the last line with its name.
fn cases(portable: &[Frame], neon: &[Frame]) -> Vec<Case> {
    let name = |frame: &Frame| frame.line.split(' ').next().unwrap_or_default().to_owned();
    (1..portable.len())
        .filter(|&at| {
            portable
                .get(at + 1)
                .is_none_or(|next| name(next) != name(&portable[at]))
        })
        .map(|at| {
            let of = |frames: &[Frame]| frames[at].instructions - frames[at - 1].instructions;
            Case {
                name: name(&portable[at]),
                portable: of(portable),
                neon: of(neon),
            }
        })
        .collect()
}

fn table(cases: &[Case]) -> String {
    use std::fmt::Write as _;
    let mut text = "instructions of a frame      portable        neon  ratio\n".to_owned();
    for case in cases {
        let bound = if case.name == BOUNDED {
            format!("  (at most {RATIO_MAX})")
        } else {
            String::new()
        };
        let _ = writeln!(
            text,
            "{:<26} {:>10}  {:>10}  {:.3}{bound}",
            case.name,
            case.portable,
            case.neon,
            case.ratio()
        );
    }
    text
}

/// One object, `NAME_portable`, `NAME_neon` and `NAME_neon_vs_portable` for each case.
fn json(cases: &[Case]) -> String {
    let fields: Vec<String> = cases
        .iter()
        .map(|case| {
            let name = case.name.replace('-', "_");
            format!(
                "\"{name}_portable\": {}, \"{name}_neon\": {}, \"{name}_neon_vs_portable\": {:.4}",
                case.portable,
                case.neon,
                case.ratio()
            )
        })
        .collect();
    format!("{{{}}}", fields.join(", "))
}

/// Fails when the bound does not hold.
fn judge(cases: &[Case]) -> Result<(), Error> {
    let found = cases.iter().find(|case| case.name == BOUNDED).map(Case::ratio);
    match found {
        Some(ratio) if ratio <= RATIO_MAX => Ok(()),
        found => Err(Error::Product {
            what: format!("instructions of `{BOUNDED}`, NEON against portable"),
            found: found.map_or_else(|| "none".to_owned(), |ratio| format!("{ratio:.3}")),
            expected: format!("at most {RATIO_MAX}"),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRINTED: &str = "a 0 -\na 1 12\na 2 12\ntracked-network-int16 0 -\ntracked-network-int16 1 7\n";

    fn of(counts: &str) -> Vec<Frame> {
        frames(PRINTED, counts).unwrap()
    }

    #[test]
    fn a_frames_instructions_are_those_since_the_line_before() {
        let found = cases(
            &of("100\n1000\n1500\n2000\n3000\n"),
            &of("90\n300\n400\n500\n800\n"),
        );
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].portable, found[0].neon), (500, 100));
        assert_eq!((found[1].portable, found[1].neon), (1000, 300));
        assert!(judge(&found).is_ok());
        assert_eq!(
            json(&found[..1]),
            r#"{"a_portable": 500, "a_neon": 100, "a_neon_vs_portable": 0.2000}"#
        );
    }

    #[test]
    fn a_ratio_above_the_bound_fails_and_so_does_a_missing_case() {
        let above = cases(&of("1\n2\n3\n4\n1004\n"), &of("1\n2\n3\n4\n360\n"));
        let text = judge(&above).unwrap_err().to_string();
        assert!(text.contains("0.356") && text.contains("0.35"), "{text}");
        assert!(judge(&above[..1]).is_err());
    }

    #[test]
    fn every_line_needs_a_count() {
        assert!(frames(PRINTED, "1\n2\n").is_err());
        assert!(frames("", "").is_err());
    }

    #[test]
    fn the_plugin_interface_is_that_of_the_emulators_version() {
        assert_eq!(plugin_api("qemu-aarch64 version 7.2.22 (Debian 1:7.2)"), Some(1));
        assert_eq!(plugin_api("qemu-aarch64 version 10.0.2\n"), Some(2));
        assert_eq!(plugin_api("something else"), None);
    }
}
