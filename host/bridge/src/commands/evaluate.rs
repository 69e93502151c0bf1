//! The command `gripline evaluate`: arguments and which part runs.

use clap::{Args, Subcommand};

use crate::error::{Completion, Error};
use gripline_evaluation::grasps::{self, GraspsArgs};
use gripline_evaluation::paper::{self, PaperArgs};
use gripline_evaluation::real::{self, RealArgs};
use gripline_evaluation::skip::{self, SkipArgs};

/// The arguments of `gripline evaluate`.
#[derive(Debug, Clone, Args)]
pub struct EvaluateArgs {
    /// What to evaluate.
    #[command(subcommand)]
    pub what: What,
}

/// What to evaluate.
#[derive(Debug, Clone, Subcommand)]
pub enum What {
    /// The paper's experiment in the simulated world, through the whole chain from picture to detector.
    Paper(PaperArgs),
    /// Random grasps in closed loop, against three simpler rules.
    Grasps(GraspsArgs),
    /// Recorded trials of real sensors (GelSight Mini, uSkin); the environment variable GRIPLINE_RECORDINGS names their folder.
    Real(RealArgs),
    /// The cost of inferring only what changed, and every decision that it changes.
    Skip(SkipArgs),
}

/// Runs the command.
///
/// # Errors
/// [`Error`] of the part that runs.
pub fn run(args: &EvaluateArgs) -> Result<Completion, Error> {
    match &args.what {
        What::Paper(args) => Ok(paper::run(args)?),
        What::Grasps(args) => Ok(grasps::run(args)?),
        What::Real(args) => {
            real::run(args)?;
            Ok(Completion::Whole)
        }
        What::Skip(args) => Ok(skip::run(args)?),
    }
}
