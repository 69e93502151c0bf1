//! The command `gripline evaluate`: arguments and which part runs.

use clap::{Args, Subcommand};

use super::paper::{self, PaperArgs};
use crate::error::Failure;

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
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] of the part that runs.
pub fn run(args: &EvaluateArgs) -> Result<(), Failure> {
    match &args.what {
        What::Paper(args) => paper::run(args),
    }
}
