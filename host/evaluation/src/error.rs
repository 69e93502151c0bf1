//! Why an experiment, a replay or a scene ends early: what was found, what was expected and what to do.

use std::io;
use std::path::PathBuf;

use gripline_capture::CaptureError;
use gripline_chart::ChartError;
use gripline_link::LinkError;
use gripline_markers::MarkerError;
use gripline_network::NetworkError;
use gripline_pipeline::PipelineError;
use gripline_protocol::NotFinite;
use gripline_recording::error::RecordingError;
use gripline_sensor::SensorError;
use gripline_simulation::scene_file::SceneError;
use gripline_simulation::{PressProblem, SimulationError};

/// The one error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum EvaluationError {
    /// A file that cannot be read or written, or whose content is not what it should be.
    #[error("{file}: {found}, expected {expected}")]
    File {
        /// The file, and the line in it where there is one.
        file: String,
        /// What was found.
        found: String,
        /// What was expected, and what to do.
        expected: &'static str,
    },
    /// Labels and maps of a trial that do not belong together.
    #[error(
        "{}: found labels of {found} frames, expected {expected} as in the finger's recording: copy both again",
        path.display()
    )]
    Labels {
        /// The file of labels.
        path: PathBuf,
        /// Frames with a label.
        found: usize,
        /// Frames with a map.
        expected: u64,
    },
    /// A clip's frame whose markers cannot be followed.
    #[error("{}, frame {frame}: {error}", path.display())]
    Frame {
        /// The clip.
        path: PathBuf,
        /// Frame, from 0.
        frame: usize,
        /// What is wrong with it.
        error: MarkerError,
    },
    /// The controller's answer to a map is missing or is not what the detector says of that map.
    #[error(
        "frame {frame}: the controller did not confirm the detector's sums, expected the same: report this defect"
    )]
    Disagrees {
        /// Frame, from 0.
        frame: u64,
    },
    /// A fixed force without the policies that it is chosen by: wrong usage.
    #[error(
        "--policies: found fixed without gripline and oracle, expected both: the fixed force is the lowest that drops no more than \
         Gripline, of the grasps that are hardest for the oracle"
    )]
    Policies,
    /// A number that the simulated world refuses while a scene plays.
    #[error("at {time_s:.3} s: {error}")]
    Step {
        /// Time since the scene began.
        time_s: f64,
        /// What it refuses.
        error: SimulationError,
    },
    /// Instructions were asked for that this processor lacks: wrong usage.
    #[error(transparent)]
    Instructions(NetworkError),
    /// The scene asks for what cannot be.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The simulated world refuses a number.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// A press that the simulated world refuses.
    #[error(transparent)]
    Press(#[from] PressProblem),
    /// The force network.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// A force that is no number.
    #[error(transparent)]
    NotFinite(#[from] NotFinite),
    /// A picture that the pipeline refuses.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// The microcontroller.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// A sensor's description.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// A clip.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// Printed markers.
    #[error(transparent)]
    Markers(#[from] MarkerError),
    /// A recording or a file of force maps.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A figure.
    #[error(transparent)]
    Chart(#[from] ChartError),
    /// JSON for programs.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// Standard output, or a file that was open.
    #[error(transparent)]
    Io(#[from] io::Error),
}
