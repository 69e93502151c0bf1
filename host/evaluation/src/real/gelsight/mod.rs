//! Recorded trials of a GelSight Mini on both fingers of a gripper: can slip be told from pictures alone? [`clips`] turns them
//! into series, [`judge`] into figures, [`tell`] into words.

mod clips;
mod judge;
mod tell;

use std::path::Path;

use crate::error::EvaluationError;

pub(super) use clips::FOLDER;
pub(super) use judge::Figures;
pub(super) use tell::markdown;

/// The figures of all trials in the folder.
///
/// # Errors
/// [`EvaluationError`] when a clip or the list of trials cannot be read.
pub(super) fn evaluate(folder: &Path) -> Result<Figures, EvaluationError> {
    Ok(judge::figures(&clips::read(folder)?))
}
