//! `gripline calibrate rest|geometry|friction|line|camera|gel`: explains the steps, measures, and writes one TOML file that the
//! configuration names (`calibration.file`). Each command writes its own section and leaves the others. Without a terminal,
//! or with `--yes`, it asks nothing.

mod camera;
mod common;
mod friction;
mod gel;
mod geometry;
mod guide;
mod line;
mod maps;
pub(super) mod rest;

use clap::{Args, Subcommand};

use self::camera::CameraArgs;
pub(super) use self::common::date;
use self::friction::FrictionArgs;
use self::gel::GelArgs;
use self::geometry::GeometryArgs;
pub(super) use self::guide::wrapped;
use self::line::LineArgs;
use self::rest::RestArgs;
use crate::error::Error;

/// Arguments of `gripline calibrate`.
#[derive(Debug, Clone, Args)]
pub struct CalibrateArgs {
    #[command(subcommand)]
    part: Part,
}

#[derive(Debug, Clone, Subcommand)]
enum Part {
    /// Take reference pictures of the untouched sensor surface, and measure their noise.
    Rest(RestArgs),
    /// Find how the sensor surface sits in the gripper (position, rotation, scale), from a recording of presses at marks.
    Geometry(GeometryArgs),
    /// Estimate the friction between sensor surface and object, from a recording in which the object slides.
    Friction(FrictionArgs),
    /// Fit the table of the grip-force line (DAC code to force), from forces that you measure.
    Line(LineArgs),
    /// Find scale, distortion and field of the camera of a gel with printed markers, from its own dots or a plate of dots.
    Camera(CameraArgs),
    /// Calibrate a gel's maps in newtons (modulus, gains of normal force and shear), from a ball pressed with known forces.
    Gel(GelArgs),
}

/// Calibrates.
///
/// # Errors
/// [`Error`] that says what was found, what was expected, and what to do; nothing is written then.
pub fn run(args: &CalibrateArgs) -> Result<(), Error> {
    match &args.part {
        Part::Rest(args) => rest::run(args),
        Part::Geometry(args) => geometry::run(args),
        Part::Friction(args) => friction::run(args),
        Part::Line(args) => line::run(args),
        Part::Camera(args) => camera::run(args),
        Part::Gel(args) => gel::run(args),
    }
}
