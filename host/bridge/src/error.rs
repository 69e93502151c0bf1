//! The one error of the bridge: a line for people and an exit code for programs. Printed once, in `main`.
//! Exit codes: 0 done, 1 failed, 2 wrong usage, 3 done with loss ([`Completion`]).

use std::fmt::Display;
use std::io;

pub use gripline_recording::error::Completion;
use gripline_recording::error::Kind;

/// Why a command did not end well: a line with what was found, what was expected and what to do.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The arguments make no sense.
    #[error("{0}")]
    Usage(String),
    /// What was asked for could not be done.
    #[error("{0}")]
    Failed(String),
    /// Pictures, recordings or experiments.
    #[error(transparent)]
    Part(#[from] gripline_recording::error::Failure),
    /// The camera, or files of pictures.
    #[error(transparent)]
    Camera(#[from] gripline_capture::CaptureError),
    /// The link to the device, and the session over it.
    #[error(transparent)]
    Link(#[from] gripline_link::LinkError),
    /// A chip in its bootloader.
    #[error(transparent)]
    Chip(#[from] gripline_flash::usb::UsbError),
    /// The server of live values.
    #[error(transparent)]
    Live(#[from] gripline_live::LiveError),
    /// A picture's way.
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
    /// Detectors over maps.
    #[error(transparent)]
    Detection(#[from] gripline_evaluation::detect::replay::ReplayError),
    /// A recording or a file of force maps.
    #[error(transparent)]
    Recording(#[from] gripline_recording::error::RecordingError),
    /// A scene of the simulated world.
    #[error(transparent)]
    Scene(#[from] gripline_simulation::scene_file::SceneError),
    /// A scene that is being played.
    #[error(transparent)]
    Play(Box<gripline_evaluation::play::PlayError>),
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

impl From<gripline_evaluation::play::PlayError> for Error {
    fn from(error: gripline_evaluation::play::PlayError) -> Self {
        Self::Play(Box::new(error))
    }
}

/// The short name in signatures.
pub use self::Error as Failure;

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
            Self::Part(failure) if matches!(failure.kind, Kind::Usage) => Self::USAGE,
            _ => 1,
        }
    }
}
