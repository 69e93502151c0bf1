//! Why a scene cannot be played.

use gripline_link::LinkError;
use gripline_network::NetworkError;
use gripline_pipeline::PipelineError;
use gripline_protocol::NotFinite;
use gripline_simulation::scene_file::SceneError;
use gripline_simulation::{PressProblem, SimulationError};

/// Why a scene cannot be played, or not any further.
#[derive(Debug, thiserror::Error)]
pub enum PlayError {
    /// The scene asks for what cannot be.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The world refuses a number.
    #[error(transparent)]
    World(#[from] SimulationError),
    /// A number that the world refuses on the way.
    #[error("at {time_s:.3} s: {error}")]
    Step {
        /// Time since the scene began.
        time_s: f64,
        /// What it refuses.
        error: SimulationError,
    },
    /// A press that the world refuses on the way.
    #[error(transparent)]
    Press(#[from] PressProblem),
    /// The force network of a grasp under Gripline.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// A force of its that is no number.
    #[error(transparent)]
    NotFinite(#[from] NotFinite),
    /// A picture that the pipeline refuses.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// Its microcontroller.
    #[error(transparent)]
    Link(#[from] LinkError),
}
