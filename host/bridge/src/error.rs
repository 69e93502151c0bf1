//! The one error of the bridge: a line for people and an exit code for programs. Printed once, in `main`.
//! Exit codes: 0 done, 1 failed, 2 wrong usage, 3 done with loss ([`Completion`]).

use std::fmt::Display;
use std::io;

use gripline_evaluation::error::EvaluationError;
pub use gripline_recording::error::Completion;

/// Why a command failed: a line with what was found, what was expected and what to do.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The arguments make no sense.
    #[error("{0}")]
    Usage(String),
    /// The command failed.
    #[error("{0}")]
    Failed(String),
    /// Experiments, fits of calibrations, detectors over maps and scenes.
    #[error(transparent)]
    Evaluation(#[from] Box<EvaluationError>),
    /// The camera, or files of pictures.
    #[error(transparent)]
    Camera(#[from] gripline_capture::CaptureError),
    /// The link to the device, and the session over it.
    #[error(transparent)]
    Link(#[from] gripline_link::LinkError),
    /// A firmware image, a chip in its bootloader, an update.
    #[error(transparent)]
    Flash(#[from] gripline_flash::error::FlashError),
    /// The server of live values.
    #[error(transparent)]
    Live(#[from] gripline_live::LiveError),
    /// The pipeline.
    #[error(transparent)]
    Pipeline(#[from] gripline_pipeline::PipelineError),
    /// The network's weights, or instructions that the processor lacks.
    #[error(transparent)]
    Network(#[from] gripline_network::NetworkError),
    /// The simulated world.
    #[error(transparent)]
    Simulation(#[from] gripline_simulation::SimulationError),
    /// A sensor's description.
    #[error(transparent)]
    Sensor(#[from] gripline_sensor::SensorError),
    /// A force that is no number.
    #[error(transparent)]
    NotFinite(#[from] gripline_protocol::NotFinite),
    /// A figure.
    #[error(transparent)]
    Chart(#[from] gripline_chart::ChartError),
    /// A recording or a file of force maps.
    #[error(transparent)]
    Recording(#[from] gripline_recording::error::RecordingError),
    /// A scene of the simulated world.
    #[error(transparent)]
    Scene(#[from] gripline_simulation::scene_file::SceneError),
    /// Printed markers.
    #[error(transparent)]
    Markers(#[from] gripline_markers::MarkerError),
    /// The name of a client.
    #[error(transparent)]
    Client(#[from] gripline_control::BadClient),
    /// A node of ROS 2.
    #[cfg(feature = "ros2")]
    #[error(transparent)]
    Ros2(#[from] gripline_ros2::Ros2Error),
    /// A PNG that is to be written.
    #[error(transparent)]
    Png(#[from] png::EncodingError),
    /// A GIF that is to be written.
    #[error(transparent)]
    Gif(#[from] gif::EncodingError),
    /// Signals that end the program.
    #[error(transparent)]
    Signal(#[from] ctrlc::Error),
    /// TOML that was read.
    #[error(transparent)]
    TomlRead(#[from] toml::de::Error),
    /// TOML that is to be written.
    #[error(transparent)]
    TomlWrite(#[from] toml::ser::Error),
    /// JSON for programs.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// A file or a stream of this process.
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl From<EvaluationError> for Error {
    fn from(error: EvaluationError) -> Self {
        Self::Evaluation(Box::new(error))
    }
}

impl Error {
    /// Exit code of wrong usage.
    pub const USAGE: u8 = 2;

    /// The arguments make no sense.
    pub fn usage(message: impl Display) -> Self {
        Self::Usage(message.to_string())
    }

    /// What was asked for could not be done.
    pub fn failed(message: impl Display) -> Self {
        Self::Failed(message.to_string())
    }

    /// The process's exit code.
    #[must_use]
    pub const fn exit_code(&self) -> u8 {
        match self {
            Self::Usage(_) => Self::USAGE,
            Self::Evaluation(error)
                if matches!(
                    **error,
                    EvaluationError::Instructions(_) | EvaluationError::Policies
                ) =>
            {
                Self::USAGE
            }
            _ => 1,
        }
    }
}
