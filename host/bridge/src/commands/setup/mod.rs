//! `gripline setup`: asks which sensor, camera and board, takes rest pictures, writes the configuration, and ends with `gripline
//! doctor`. Each answer can be a flag; without a terminal nothing is asked. It moves nothing. This file acts; `interview` asks,
//! `file` makes the configuration's text, `hardware` lists the attached devices.

mod file;
mod hardware;
mod interview;
mod question;

use std::env;
use std::fs;
use std::io::{self, IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};

use clap::Args;
use gripline_link::Target;

use self::interview::{Chosen, Person, Rest, Said, interview};
use crate::calibration::{Calibration, write};
use crate::commands::calibrate::{date, rest};
use crate::commands::doctor;
use crate::config::{Overrides, Settings, default_file};
use crate::error::{Completion, Error};
use crate::source::Source;

/// Number of rest pictures taken.
const PICTURES: usize = 16;

/// Arguments of `gripline setup`.
#[derive(Debug, Clone, Args)]
pub struct SetupArgs {
    /// The fingertip: a shipped description (particle-fingertip) or a file.
    #[arg(long, value_name = "NAME|FILE.toml")]
    sensor: Option<PathBuf>,
    /// Source of its pictures, as for `gripline run --source`.
    #[arg(long, value_name = "SOURCE", visible_alias = "source")]
    camera: Option<Source>,
    /// Which microcontroller: usb, usb:SERIAL, serial:PORT or embedded.
    #[arg(long, value_name = "MCU")]
    mcu: Option<Target>,
    /// Pictures of the untouched fingertip: taken now, taken by each run at its start (later), or those of a calibration.
    #[arg(long, value_name = "now|later|FILE.toml")]
    rest: Option<Rest>,
    /// The configuration to write. By default /etc/gripline/gripline.toml as root, else the user's own.
    #[arg(long, value_name = "FILE.toml")]
    out: Option<PathBuf>,
    /// Ask nothing: use the default of every answer that no flag gives, if there is only one choice.
    #[arg(long)]
    yes: bool,
    /// Replace an existing configuration.
    #[arg(long)]
    force: bool,
}

/// Asks, calibrates, writes, checks.
///
/// # Errors
/// [`Error`] that says what was found, what was expected and what to do; those of `gripline doctor` at the end.
pub fn run(args: &SetupArgs) -> Result<Completion, Error> {
    let out = args.out.clone().unwrap_or_else(default_place);
    let out = std::path::absolute(&out)?;
    let mut terminal = Terminal;
    let asks = !args.yes && io::stdin().is_terminal();
    let replaces = may_write(&out, args.force, asks)?;
    let said = Said {
        sensor: args.sensor.clone(),
        camera: args.camera.clone(),
        mcu: args.mcu.clone(),
        rest: args.rest.clone(),
        yes: args.yes,
    };
    let person = asks.then_some(&mut terminal as &mut dyn Person);
    let chosen = interview(&said, &mut hardware::detect, person)?;
    let draft = draft(&chosen, &out)?;
    let calibration = calibrated(&chosen, &draft, &out, asks, replaces)?;
    write(
        &out,
        file::text(&chosen, calibration.as_deref(), &date()).as_bytes(),
    )?;
    println!("wrote {}", out.display());
    println!("\nWhat `gripline doctor` says of it:");
    let judged = doctor::check(&Settings::load(&Overrides::of_file(Some(&out)))?, false);
    println!("\n{}", next_step(&out, judged.is_ok()));
    judged
}

/// Where `gripline run` of this user finds its configuration.
fn default_place() -> PathBuf {
    let variable = |name: &str| {
        env::var_os(name)
            .filter(|value| !value.is_empty())
            .map(PathBuf::from)
    };
    let config_home = variable("XDG_CONFIG_HOME").or_else(|| Some(variable("HOME")?.join(".config")));
    file::place(is_root(), config_home)
}

#[cfg(target_os = "linux")]
fn is_root() -> bool {
    use std::os::unix::fs::MetadataExt as _;
    // The process's own folder belongs to its user.
    fs::metadata("/proc/self").is_ok_and(|about| about.uid() == 0)
}

#[cfg(not(target_os = "linux"))]
const fn is_root() -> bool {
    false
}

/// Makes sure that `out` can be written, before anything is asked. Returns whether it replaces an earlier file.
fn may_write(out: &Path, force: bool, asks: bool) -> Result<bool, Error> {
    let folder = out.parent().unwrap_or(Path::new("/"));
    let probe = out.with_extension("toml.part");
    fs::create_dir_all(folder)
        .and_then(|()| fs::write(&probe, ""))
        .and_then(|()| fs::remove_file(&probe))
        .map_err(|error| {
            Error::failed(format!(
                "{}: {error}, expected a folder that can be written: start it with sudo, or name another file with --out",
                folder.display()
            ))
        })?;
    let Ok(before) = fs::read_to_string(out) else {
        return Ok(false);
    };
    if before == default_file() {
        // As the package brings it: it says nothing.
        return Ok(false);
    }
    let shown = out.display();
    if force {
        return Ok(true);
    }
    if !asks {
        return Err(Error::usage(format!(
            "{shown}: found a configuration, expected none: --force replaces it, --out names another file"
        )));
    }
    let answer = Terminal.ask(&format!("{shown} is there already. Replace it? y or n: "))?;
    match answer.trim() {
        "y" | "yes" => Ok(true),
        _ => Err(Error::failed(format!(
            "{shown} was left as it is; --out names another file"
        ))),
    }
}

/// The settings from the answers, before anything depends on them.
fn draft(chosen: &Chosen, out: &Path) -> Result<Settings, Error> {
    let path = out.with_extension("toml.draft");
    write(&path, file::text(chosen, None, &date()).as_bytes())?;
    let settings = Settings::load(&Overrides::of_file(Some(&path)));
    fs::remove_file(&path)?;
    settings
}

/// The calibration that the configuration names; created beside it when it is wanted now.
fn calibrated(
    chosen: &Chosen,
    draft: &Settings,
    out: &Path,
    asks: bool,
    anew: bool,
) -> Result<Option<PathBuf>, Error> {
    match &chosen.rest {
        Rest::Later => Ok(None),
        Rest::In(file) => {
            Calibration::load(file)?;
            Ok(Some(std::path::absolute(file)?))
        }
        Rest::Now => {
            let file = out.with_file_name("calibration.toml");
            let pictures = rest::take(&chosen.camera, &draft.source_settings(0), PICTURES, asks)?;
            let written = rest::keep(&file, &pictures, chosen.camera.to_string(), anew)?;
            println!("{}", rest::summary(&written));
            Ok(Some(file))
        }
    }
}

/// What to do now.
fn next_step(out: &Path, is_fit: bool) -> String {
    let shown = out.display();
    if !is_fit {
        return format!("Do what it says, then: gripline doctor --config {shown}");
    }
    if file::is_of_the_service(out) {
        return "Start the service: sudo systemctl enable --now gripline".to_owned();
    }
    format!("Start it: gripline run --config {shown}")
}

/// The person at standard input; screens go to standard error, results to standard output.
struct Terminal;

impl Person for Terminal {
    fn ask(&mut self, screen: &str) -> Result<String, Error> {
        eprint!("{screen}");
        let _ = io::stderr().flush();
        let mut line = String::new();
        match io::stdin().read_line(&mut line) {
            Ok(0) => Err(Error::failed(
                "standard input ended, expected an answer; no configuration was written",
            )),
            Ok(_) => Ok(line),
            Err(error) => Err(Error::failed(format!("standard input: {error}"))),
        }
    }

    fn tell(&mut self, line: &str) {
        eprintln!("{line}");
    }
}
