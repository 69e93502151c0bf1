//! `gripline calibrate rest|geometry|friction|line`: says what to do, measures, and writes it into one TOML file that the
//! configuration names (`calibration.file`). Each part writes its own section and leaves the others. Without a terminal, or
//! with `--yes`, nothing is asked.

mod common;
mod friction;
mod geometry;
mod guide;
mod line;
mod maps;
mod rest;

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
