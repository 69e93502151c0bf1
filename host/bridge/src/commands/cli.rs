//! The command line: which commands there are, and the arguments of each.

use std::ffi::OsString;

use clap::{Parser, Subcommand};
use tracing::level_filters::LevelFilter;

use super::export::ExportArgs;
use crate::commands::calibrate::CalibrateArgs;
use crate::commands::config::ConfigArgs;
use crate::commands::detect::DetectArgs;
use crate::commands::doctor::DoctorArgs;
use crate::commands::evaluate::EvaluateArgs;
use crate::commands::faults::FaultsArgs;
use crate::commands::flash::FlashArgs;
use crate::commands::infer::InferArgs;
use crate::commands::plot::PlotArgs;
use crate::commands::replay::ReplayArgs;
use crate::commands::sensor::SensorArgs;
use crate::commands::setup::SetupArgs;
use crate::commands::shell::{CompletionsArgs, ManArgs};
use crate::commands::simulate::SimulateArgs;
use crate::run::RunArgs;

/// Holds objects with as little force as is safe: force maps from a camera-based fingertip, slip detection and grip control
/// on a microcontroller.
#[derive(Debug, Parser)]
#[command(name = "gripline", version, about, max_term_width = 100)]
pub struct Cli {
    /// Log more: every detail.
    #[arg(short, long, global = true)]
    verbose: bool,
    /// Log errors only.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the control loop, from the camera to the grip-force line. Without arguments: a simulated fingertip and gripper, live
    /// in the terminal.
    Run(RunArgs),
    /// Run the force network over recorded camera pictures.
    Infer(InferArgs),
    /// Run the microcontroller's detector over recorded force maps.
    Detect(DetectArgs),
    /// Show the configuration in force and its origin, print a documented default file, read and set the microcontroller's
    /// settings.
    Config(ConfigArgs),
    /// Simulate a scene: write its frames, true force maps and slip labels.
    Simulate(SimulateArgs),
    /// Measure slip detection and grip control in the simulated world: the paper's experiment and more.
    Evaluate(EvaluateArgs),
    /// Run the pictures of a recording through the same loop again and compare every decision.
    Replay(ReplayArgs),
    /// Write the maps, pictures and decisions of a recording as npy and CSV.
    Export(ExportArgs),
    /// Draw a recording: stick ratio with predictions and truth, forces and line, force maps. PNG or SVG.
    Plot(PlotArgs),
    /// Calibrate a fingertip and its gripper, step by step.
    Calibrate(CalibrateArgs),
    /// Ask for sensor, camera and board, take rest pictures, write the configuration, and check everything.
    Setup(SetupArgs),
    /// Check everything that a run needs, and say how to fix what is wrong.
    Doctor(DoctorArgs),
    /// Check the description of a fingertip.
    Sensor(SensorArgs),
    /// Show the microcontroller's faults and what to do about each; acknowledge the latched ones.
    Faults(FaultsArgs),
    /// Flash a firmware image over USB, without a debug probe.
    Flash(FlashArgs),
    /// Print completions for a shell.
    Completions(CompletionsArgs),
    /// Write the manual pages.
    Man(ManArgs),
}

impl Cli {
    /// The level that the flags ask for.
    #[must_use]
    pub const fn log_level(&self) -> Option<LevelFilter> {
        match (self.verbose, self.quiet) {
            (true, _) => Some(LevelFilter::DEBUG),
            (_, true) => Some(LevelFilter::ERROR),
            _ => None,
        }
    }

    /// Reads the program's arguments; none at all mean `run`.
    ///
    /// # Errors
    /// clap's, for `--help` and `--version` too.
    pub fn from_arguments(arguments: impl IntoIterator<Item = OsString>) -> Result<Self, clap::Error> {
        let mut arguments: Vec<_> = arguments.into_iter().collect();
        if arguments.len() <= 1 {
            arguments = vec!["gripline".into(), "run".into()];
        }
        Self::try_parse_from(arguments)
    }
}
