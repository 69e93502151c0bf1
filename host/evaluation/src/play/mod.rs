//! The world of a scene, frame by frame, the same way for every kind of scene, for `gripline simulate` and the Python
//! package. Touches nothing.

mod grasp;
mod moment;
mod press;
pub mod truth;

use gripline_simulation::scene_file::{Scene, SceneFile};

use crate::error::EvaluationError;

pub use self::moment::{FingerMoment, Moment, Play, PlayError};

/// The scene at its start.
///
/// # Errors
/// [`EvaluationError`] when there can be no such scene.
pub fn open(file: &SceneFile, seed: u64) -> Result<Box<dyn Play>, EvaluationError> {
    match &file.scene {
        Scene::Press(scene) => Ok(Box::new(press::PressPlay::new(file, scene, seed)?)),
        Scene::Grasp(scene) => Ok(Box::new(grasp::GraspPlay::new(file, scene, seed)?)),
    }
}

/// At most this many of a scene's highlights, the last one among them.
#[must_use]
pub fn highlights(play: &dyn Play, max: usize) -> Vec<usize> {
    let ends = play.highlights();
    let take = ends.len().min(max);
    let mut chosen: Vec<usize> = (0..take)
        .map(|k| ends[((k + 1) * ends.len()).div_ceil(take) - 1])
        .collect();
    chosen.dedup();
    chosen
}
