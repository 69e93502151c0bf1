//! `cargo xtask fuzz`: the parsers and the microcontroller's program against a coverage-guided fuzzer
//! (libFuzzer), on the stable toolchain: the compiler's coverage passes are plain code generation flags, and the code under
//! test is free of `unsafe`, so no sanitizer is missed. Overflow checks are on.
//!
//! Needs a C++ compiler for libFuzzer's runtime. What is found goes to `target/gripline/fuzz/TARGET`.

use std::path::PathBuf;

use crate::error::{Error, value_of};
use crate::process;

/// What is fuzzed: a binary of `tests/fuzz`, a corpus of the same name; and its longest input and the longest that is kept,
/// bytes. A dense map and some commands for what reads bytes; some dozen steps for what makes maps and commands of them,
/// because short inputs are tried many times as often.
const TARGETS: [(&str, u32, u32); 7] = [
    ("wire", 4_096, 400),
    ("stream", 4_096, 400),
    ("commands", 400, 400),
    ("settings", 4_096, 400),
    ("status", 4_096, 400),
    ("modbus", 4_096, 400),
    ("http", 4_096, 400),
];

const MANIFEST: &str = "tests/fuzz/Cargo.toml";

/// What cargo-fuzz passes too, less the sanitizers: edge counters, a table of places, compared values.
const COVERAGE: &str = "-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
                        -Cllvm-args=-sanitizer-coverage-inline-8bit-counters \
                        -Cllvm-args=-sanitizer-coverage-pc-table \
                        -Cllvm-args=-sanitizer-coverage-trace-compares -Ccodegen-units=1 --cfg fuzzing";

/// `cargo xtask fuzz`.
pub(crate) fn command(arguments: &[String]) -> Result<(), Error> {
    let (mut minutes, mut save, mut targets) = (10.0, false, Vec::new());
    let mut rest = arguments.iter();
    while let Some(argument) = rest.next() {
        match argument.as_str() {
            "--minutes" => {
                let found = value_of("--minutes", &mut rest)?;
                minutes = found
                    .parse()
                    .ok()
                    .filter(|minutes: &f64| *minutes > 0.0)
                    .ok_or_else(|| Error::usage("--minutes", found, "a number above 0"))?;
            }
            "--save" => save = true,
            found => {
                let Some(target) = TARGETS.iter().find(|(target, ..)| *target == found) else {
                    let names = TARGETS.map(|(target, ..)| target).join(", ");
                    return Err(Error::usage("target", found, &names));
                };
                targets.push(*target);
            }
        }
    }
    if targets.is_empty() {
        targets.extend(TARGETS);
    }
    let programs = build()?;
    for (target, input_max, kept_max) in targets {
        let program = programs.join(format!("{target}{}", std::env::consts::EXE_SUFFIX));
        let found = process::products().join("fuzz").join(target);
        let corpus = process::root().join("tests/fuzz/corpus").join(target);
        for folder in [&found, &corpus] {
            std::fs::create_dir_all(folder).map_err(|source| Error::file(folder, source))?;
        }
        let mut fuzzer = std::process::Command::new(&program);
        // The first folder is where new inputs go.
        fuzzer.args([&found, &corpus]).args([
            format!("-max_total_time={}", (minutes * 60.0).ceil()),
            format!("-max_len={input_max}"),
            "-timeout=10".to_owned(),
            "-rss_limit_mb=2048".to_owned(),
            "-print_final_stats=1".to_owned(),
            format!("-artifact_prefix={}/finding-", found.display()),
        ]);
        process::run(&mut fuzzer)?;
        if save {
            let mut merge = std::process::Command::new(&program);
            // The fewest short inputs that reach everything.
            process::run(
                merge
                    .args(["-set_cover_merge=1".to_owned(), format!("-max_len={kept_max}")])
                    .args([&corpus, &found]),
            )?;
        }
        println!("{target}: no finding in {minutes} min");
    }
    Ok(())
}

/// Builds all fuzzers; returns the folder they lie in.
fn build() -> Result<PathBuf, Error> {
    let host = host()?;
    let folder = process::build_dir().join("fuzz");
    // With a target named, the flags do not reach build scripts and macros.
    process::run(
        process::cargo()
            .args([
                "build",
                "--release",
                "--manifest-path",
                MANIFEST,
                "--target",
                &host,
            ])
            .env("RUSTFLAGS", COVERAGE)
            .env_remove("CARGO_ENCODED_RUSTFLAGS")
            .env("CARGO_TARGET_DIR", &folder),
    )?;
    Ok(folder.join(host).join("release"))
}

/// The machine's own target.
fn host() -> Result<String, Error> {
    let version = process::output(process::rustc().arg("-vV"))?;
    let host = version.lines().find_map(|line| line.strip_prefix("host: "));
    host.map(str::to_owned).ok_or_else(|| Error::Product {
        what: "`rustc -vV`".to_owned(),
        found: version.clone(),
        expected: "a line `host: TARGET`".to_owned(),
    })
}
