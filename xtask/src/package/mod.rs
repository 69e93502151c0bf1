//! `cargo xtask package`: a Debian package of the bridge: program, man pages, completions, udev rule, systemd unit, default
//! configuration. Staged under `target/gripline/package` and packed by Debian's dpkg-deb; what people and systemd are told
//! stands in `docs` and `xtask/package`. The same commit gives the same bytes.
//! Limit: the licences of the crates are listed by name, their texts are not collected.

mod contents;
mod needs;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use self::contents::{Control, Place, Stage};
use crate::arm;
use crate::error::{Error, value_of};
use crate::process::{self, profile_folder};
use crate::toolchain::ARM;

/// Debian's revision of this version.
const REVISION: u32 = 1;
/// Who answers for the package; the project has no address of its own yet.
const MAINTAINER: &str = "The Gripline developers <maintainers@gripline.invalid>";

/// What is built, and for which machine.
struct Wanted<'a> {
    /// Rust's name of the machine; `None`: this one.
    target: Option<&'a str>,
    /// Cargo's profile.
    profile: &'a str,
}

/// `cargo xtask package`.
pub(crate) fn command(arguments: &[String]) -> Result<(), Error> {
    let mut wanted = Wanted {
        target: None,
        profile: "release",
    };
    let mut rest = arguments.iter();
    while let Some(option) = rest.next() {
        match option.as_str() {
            "--target" => wanted.target = Some(value_of(option, &mut rest)?),
            "--profile" => wanted.profile = value_of(option, &mut rest)?,
            _ => {
                return Err(Error::usage(
                    "argument",
                    option,
                    "--target TARGET, --profile PROFILE or none",
                ));
            }
        }
    }
    let package = build(&wanted)?;
    println!("{}", package.display());
    Ok(())
}

/// How a machine's programs are built, run here and freed of what only debuggers want.
struct Machine {
    /// Rust's name of it.
    triple: String,
    /// Debian's name of it.
    architecture: &'static str,
    /// Whether it is this one.
    is_this: bool,
    strip: &'static str,
}

impl Machine {
    fn of(target: Option<&str>) -> Result<Self, Error> {
        let output = process::output(process::rustc().arg("-vV"))?;
        let here = output.lines().find_map(|line| line.strip_prefix("host: "));
        let here = here.unwrap_or_default().to_owned();
        let triple = match target {
            // As people and Debian say it.
            Some("aarch64" | "arm64") => "aarch64-unknown-linux-gnu".to_owned(),
            Some("x86_64" | "amd64") => "x86_64-unknown-linux-gnu".to_owned(),
            Some(triple) => triple.to_owned(),
            None => here.clone(),
        };
        let (architecture, cross_strip) = match triple.as_str() {
            "x86_64-unknown-linux-gnu" => ("amd64", "x86_64-linux-gnu-strip"),
            "aarch64-unknown-linux-gnu" => ("arm64", "aarch64-linux-gnu-strip"),
            other => {
                return Err(Error::usage(
                    "--target",
                    other,
                    "x86_64-unknown-linux-gnu or aarch64-unknown-linux-gnu",
                ));
            }
        };
        let is_this = triple == here;
        Ok(Self {
            triple,
            architecture,
            is_this,
            strip: if is_this { "strip" } else { cross_strip },
        })
    }

    /// Whether its programs come from a cross compiler and start under emulation.
    fn is_emulated(&self) -> bool {
        !self.is_this && self.triple == ARM.triple
    }

    /// Builds the bridge; returns its program.
    fn build(&self, profile: &str) -> Result<PathBuf, Error> {
        if self.is_emulated() {
            return arm::build_bridge(profile);
        }
        if self.is_this {
            return Ok(process::build(profile, &[("gripline", "gripline")])?.join("gripline"));
        }
        process::run(process::cargo().args(["build", "--profile", profile]).args([
            "--package",
            "gripline",
            "--target",
            &self.triple,
        ]))?;
        let folder = process::build_dir().join(&self.triple);
        Ok(folder.join(profile_folder(profile)).join("gripline"))
    }
}

/// Builds the program and the package; returns the package.
fn build(wanted: &Wanted) -> Result<PathBuf, Error> {
    let machine = Machine::of(wanted.target)?;
    let program = machine.build(wanted.profile)?;
    // Pages, completions and configuration are the same for all machines, and made by a program that runs here.
    let speaker = if machine.is_this {
        program.clone()
    } else {
        Machine::of(None)?.build("dev")?
    };
    packed(&machine, &program, &speaker)
}

/// The package of a program that was built for this machine.
pub(crate) fn of_program(program: &Path) -> Result<PathBuf, Error> {
    packed(&Machine::of(None)?, program, program)
}

fn packed(machine: &Machine, program: &Path, speaker: &Path) -> Result<PathBuf, Error> {
    if let Err(error) = process::output(Command::new("dpkg-deb").arg("--version")) {
        return Err(Error::Product {
            what: "dpkg-deb".to_owned(),
            found: error.to_string(),
            expected:
                "Debian's packer of packages: install the package dpkg, which other distributions have too"
                    .to_owned(),
        });
    }
    let home = process::products().join("package");
    let stage = Stage::new(&home.join(machine.architecture))?;
    let bytes = |path: &Path| fs::read(path).map_err(|source| Error::file(path, source));

    let stripped = home.join(format!("gripline.{}", machine.architecture));
    process::output(
        Command::new(machine.strip)
            .args([
                "--strip-unneeded",
                "--remove-section=.comment",
                "--remove-section=.note",
                "-o",
            ])
            .arg(&stripped)
            .arg(program),
    )?;
    if machine.is_emulated() {
        // What is packed, not only what was built.
        arm::start(&stripped)?;
    }
    let program = bytes(&stripped)?;
    stage.write("usr/bin/gripline", Place::Program, &program)?;
    spoken(&stage, speaker)?;
    let docs = process::root().join("docs");
    stage.write(
        "usr/lib/udev/rules.d/70-gripline.rules",
        Place::File,
        &bytes(&docs.join("70-gripline.rules"))?,
    )?;
    stage.write(
        "usr/lib/systemd/system/gripline.service",
        Place::File,
        &bytes(&docs.join("gripline.service"))?,
    )?;
    stage.write(
        "usr/lib/sysusers.d/gripline.conf",
        Place::File,
        include_bytes!("../../package/sysusers.conf"),
    )?;
    for page in ["manual.md", "safety.md", "wiring.md", "limits.md"] {
        stage.compressed(
            &format!("usr/share/doc/gripline/{page}"),
            &bytes(&docs.join(page))?,
        )?;
    }
    let epoch = commit_time()?;
    let date = process::word_of(
        Command::new("date")
            .env("LC_ALL", "C")
            .args(["-R", "-u", "-d"])
            .arg(format!("@{epoch}")),
    )?;
    let version = version();
    let history = contents::changelog(&version, MAINTAINER, &date);
    stage.compressed("usr/share/doc/gripline/changelog.Debian", history.as_bytes())?;
    let mit = bytes(&process::root().join("LICENSE-MIT"))?;
    let copyright = contents::copyright(&String::from_utf8_lossy(&mit), &crates(&machine.triple)?);
    stage.write(
        "usr/share/doc/gripline/copyright",
        Place::File,
        copyright.as_bytes(),
    )?;

    let wrong = |found| Error::Product {
        what: stripped.display().to_string(),
        found,
        expected: format!(
            "a program for {} whose libraries are Debian's libc6 and libgcc-s1",
            machine.architecture
        ),
    };
    let libraries = needs::depends(&program).map_err(wrong)?;
    let found = needs::architecture(&program).map_err(wrong)?;
    if found != machine.architecture {
        return Err(wrong(format!("a program for {found}")));
    }
    let control = Control {
        version: &version,
        architecture: machine.architecture,
        maintainer: MAINTAINER,
        libraries: &libraries,
    };
    let name = format!("gripline_{version}_{}.deb", machine.architecture);
    let package = process::products().join(name);
    stage.pack(&control, &package, &epoch)?;
    Ok(package)
}

/// What the program says of itself: man pages, completions, configuration.
fn spoken(stage: &Stage, speaker: &Path) -> Result<(), Error> {
    let says = |arguments: &[&str]| process::output(Command::new(speaker).args(arguments));
    let pages = stage.beside("man")?;
    process::output(Command::new(speaker).args(["man", "--out"]).arg(&pages))?;
    let listed = fs::read_dir(&pages).map_err(|source| Error::file(&pages, source))?;
    let mut listed: Vec<PathBuf> = listed.flatten().map(|entry| entry.path()).collect();
    listed.sort();
    for page in listed {
        let name = page.file_name().unwrap_or_default().to_string_lossy();
        let text = fs::read(&page).map_err(|source| Error::file(&page, source))?;
        stage.compressed(&format!("usr/share/man/man1/{name}"), &text)?;
    }
    for (shell, place) in [
        ("bash", "usr/share/bash-completion/completions/gripline"),
        ("zsh", "usr/share/zsh/vendor-completions/_gripline"),
        ("fish", "usr/share/fish/vendor_completions.d/gripline.fish"),
    ] {
        stage.write(place, Place::File, says(&["completions", shell])?.as_bytes())?;
    }
    stage.write(
        contents::CONFIGURATION,
        Place::File,
        says(&["config", "default"])?.as_bytes(),
    )
}

/// The version with Debian's revision.
fn version() -> String {
    // Of the workspace, as the bridge's.
    format!("{}-{REVISION}", env!("CARGO_PKG_VERSION"))
}

/// When the newest commit was made, seconds since 1970; a tree without history is of now.
fn commit_time() -> Result<String, Error> {
    let committed = process::word_of(Command::new("git").current_dir(process::root()).args([
        "log",
        "-1",
        "--format=%ct",
    ]));
    committed.or_else(|_| process::word_of(Command::new("date").arg("+%s")))
}

/// The crates that are linked into the program, a line each: name, version, licence.
fn crates(triple: &str) -> Result<Vec<String>, Error> {
    let output = process::output(process::cargo().args([
        "tree",
        "--package",
        "gripline",
        "--edges",
        "normal",
        "--target",
        triple,
        "--prefix",
        "none",
        "--format",
        "{p} | {l}",
    ]))?;
    Ok(contents::foreign_crates(&output))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The default build had 219 crates of others before control, page, Python and ROS 2 came: 5 % more are allowed.
    const CRATES_MAX: usize = 229;

    #[test]
    fn the_default_build_has_few_crates_of_others() {
        let crates = crates("x86_64-unknown-linux-gnu").expect("cargo lists them");
        assert!(
            crates.len() <= CRATES_MAX,
            "found {} crates, expected at most {CRATES_MAX}: put the new ones behind a feature or into a crate of their own\n{}",
            crates.len(),
            crates.join("\n")
        );
        assert!(crates.len() > 100, "{crates:?}");
    }
}
