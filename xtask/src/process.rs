//! Running other programs: announced on standard error before they start, failed with their own words.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::error::Error;

/// The repository: the folder above this crate.
pub(crate) fn root() -> PathBuf {
    let crate_dir = std::env::var_os("CARGO_MANIFEST_DIR")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    crate_dir
        .parent()
        .map_or_else(|| PathBuf::from("."), Path::to_path_buf)
}

/// Where finished products go: the place `gripline run --mcu emulator` looks in.
pub(crate) fn products() -> PathBuf {
    root().join("target").join("gripline")
}

/// A product that an earlier step made.
pub(crate) fn product(path: PathBuf, what: &str) -> Result<PathBuf, Error> {
    if path.is_file() {
        return Ok(path);
    }
    Err(Error::Product {
        what: what.to_owned(),
        found: format!("no {}", path.display()),
        expected: "the one that an earlier check builds (it failed above)".to_owned(),
    })
}

/// Cargo's own build folder.
pub(crate) fn build_dir() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR")
        .filter(|dir| !dir.is_empty())
        .map_or_else(|| root().join("target"), |dir| root().join(dir))
}

/// Cargo's folder of the profiles that it brings along.
pub(crate) fn profile_folder(profile: &str) -> &str {
    if ["dev", "test"].contains(&profile) {
        "debug"
    } else {
        profile
    }
}

/// The cargo that runs this program, started in the repository. Without what makes the next build of a changed crate faster:
/// that makes the first one take half as long again, and the build folder twice as large.
pub(crate) fn cargo() -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| OsString::from("cargo")));
    command.current_dir(root()).env("CARGO_INCREMENTAL", "0");
    command
}

/// The workspace without this program. It parses Rust, and what a program shares with procedural macros cargo compiles with other
/// flags than for them alone: with it, lints, tests and ARM would each compile those macros, and all that uses them, again.
pub(crate) const WORKSPACE: [&str; 3] = ["--workspace", "--exclude", "xtask"];

/// Cargo that builds with the features and flags that the tests are built with, so that after them nothing is compiled again. (A
/// test among the targets makes cargo count the features that tests ask for.) Its profile is `dev`, and targets are to be added.
pub(crate) fn as_tests(command: &str) -> Command {
    let mut cargo = cargo();
    cargo.arg(command).args(WORKSPACE).args(["--test", "bridge"]);
    cargo
}

/// Builds programs of the workspace; returns their folder. With the profile `dev` they are built as the tests are.
pub(crate) fn build(profile: &str, programs: &[(&str, &str)]) -> Result<PathBuf, Error> {
    let mut command;
    if profile == "dev" {
        command = as_tests("build");
        command.args(programs.iter().flat_map(|(_, program)| ["--bin", program]));
    } else {
        command = cargo();
        command.args(["build", "--profile", profile]);
        command.args(programs.iter().flat_map(|(package, _)| ["--package", package]));
    }
    run(&mut command)?;
    Ok(build_dir().join(profile_folder(profile)))
}

/// Builds an example as the tests are built; returns its path.
pub(crate) fn example(name: &str) -> Result<PathBuf, Error> {
    run(as_tests("build").args(["--example", name]))?;
    Ok(build_dir()
        .join(profile_folder("dev"))
        .join("examples")
        .join(name))
}

/// The compiler that cargo uses, started in the repository.
pub(crate) fn rustc() -> Command {
    let mut command = Command::new(std::env::var_os("RUSTC").unwrap_or_else(|| OsString::from("rustc")));
    command.current_dir(root());
    command
}

/// A command as a person would type it.
pub(crate) fn shown(command: &Command) -> String {
    let name = |text: &std::ffi::OsStr| {
        Path::new(text)
            .file_name()
            .unwrap_or(text)
            .to_string_lossy()
            .into_owned()
    };
    let mut line: Vec<String> = command
        .get_envs()
        .filter_map(|(key, value)| {
            value.map(|value| format!("{}={}", key.to_string_lossy(), value.to_string_lossy()))
        })
        .collect();
    line.push(name(command.get_program()));
    line.extend(command.get_args().map(|argument| {
        let argument = argument.to_string_lossy();
        if argument.contains([' ', '"']) {
            format!("'{argument}'")
        } else {
            argument.into_owned()
        }
    }));
    line.join(" ")
}

/// Announces and runs a command; its output goes where this program's goes.
pub(crate) fn run(command: &mut Command) -> Result<(), Error> {
    let line = shown(command);
    eprintln!("$ {line}");
    let status = command
        .stdin(Stdio::null())
        .status()
        .map_err(|source| Error::Start {
            program: command.get_program().to_string_lossy().into(),
            source,
        })?;
    if status.success() {
        return Ok(());
    }
    Err(Error::Failed {
        command: line,
        status: status.to_string(),
        said: String::new(),
    })
}

/// Runs a command in silence and returns its standard output; when it fails, the last line it said is in the error.
pub(crate) fn output(command: &mut Command) -> Result<String, Error> {
    let line = shown(command);
    let output = command
        .stdin(Stdio::null())
        .output()
        .map_err(|source| Error::Start {
            program: command.get_program().to_string_lossy().into(),
            source,
        })?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let heard = String::from_utf8_lossy(&output.stderr);
    let said = heard
        .lines()
        .rfind(|said| !said.trim().is_empty())
        .unwrap_or_default()
        .trim()
        .to_owned();
    Err(Error::Failed {
        command: line,
        status: output.status.to_string(),
        said,
    })
}

/// What a command printed on standard output, trimmed.
pub(crate) fn word_of(command: &mut Command) -> Result<String, Error> {
    output(command).map(|text| text.trim().to_owned())
}

/// Copies a product into place as one step, so that a reader never sees half a file.
pub(crate) fn install(from: &Path, to: &Path) -> Result<(), Error> {
    if let Some(folder) = to.parent() {
        std::fs::create_dir_all(folder).map_err(|source| Error::file(folder, source))?;
    }
    let mut partial = to.as_os_str().to_owned();
    partial.push(format!(".{}", std::process::id()));
    let partial = PathBuf::from(partial);
    std::fs::copy(from, &partial).map_err(|source| Error::file(from, source))?;
    std::fs::rename(&partial, to).map_err(|source| Error::file(to, source))
}
