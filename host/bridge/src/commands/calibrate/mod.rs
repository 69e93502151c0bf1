//! `gripline calibrate rest|geometry|friction|line`: says what to do, measures, and writes it into one TOML file that the
//! configuration names (`calibration.file`). Each part writes its own section and leaves the others. Without a terminal, or
//! with `--yes`, nothing is asked.

mod friction;
mod geometry;
mod guide;
pub(crate) mod line;
mod maps;
mod rest;

use std::path::PathBuf;
use std::time::SystemTime;

use clap::{Args, Subcommand};

use self::friction::FrictionArgs;
use self::geometry::GeometryArgs;
use self::line::LineArgs;
use self::rest::RestArgs;
use crate::error::Failure;

/// Arguments of `gripline calibrate`.
#[derive(Debug, Clone, Args)]
pub struct CalibrateArgs {
    #[command(subcommand)]
    of: Of,
}

#[derive(Debug, Clone, Subcommand)]
enum Of {
    /// The untouched skin: pictures that later ones are compared with, and their noise.
    Rest(RestArgs),
    /// How the skin sits in the gripper: its place, its turn and its scale, from a recording of presses at marks.
    Geometry(GeometryArgs),
    /// Friction between skin and object, from a recording in which the object was made to slide.
    Friction(FrictionArgs),
    /// What the codes of the grip-force line make the gripper do, from forces that you measure.
    Line(LineArgs),
}

/// What every calibration takes.
#[derive(Debug, Clone, Args)]
struct Common {
    /// Calibration file; sections that are there already stay.
    #[arg(long, value_name = "FILE.toml", default_value = "calibration.toml")]
    out: PathBuf,
    /// What was calibrated, for the file: a name or serial number.
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
    /// Do not ask for anything.
    #[arg(long)]
    yes: bool,
    /// Print what was found as one JSON object; asks for nothing.
    #[arg(long)]
    json: bool,
}

impl Common {
    /// Whether somebody is there who can be asked.
    fn asks(&self) -> bool {
        use std::io::IsTerminal as _;
        !self.yes && !self.json && std::io::stdin().is_terminal()
    }
}

/// Calibrates.
///
/// # Errors
/// [`Failure`] that says what was found, what was expected, and what to do; nothing is written then.
pub fn run(args: &CalibrateArgs) -> Result<(), Failure> {
    match &args.of {
        Of::Rest(args) => rest::run(args),
        Of::Geometry(args) => geometry::run(args),
        Of::Friction(args) => friction::run(args),
        Of::Line(args) => line::run(args),
    }
}

/// Now, as the file says it.
fn date() -> String {
    humantime::format_rfc3339_seconds(SystemTime::now()).to_string()
}

/// Says what was written, and how it is used the first time.
fn wrote(common: &Common) {
    if !common.json {
        println!(
            "wrote {}; `gripline run --calibration {}` uses it, or the key calibration.file",
            common.out.display(),
            common.out.display()
        );
    }
}
