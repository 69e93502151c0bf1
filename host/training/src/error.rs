//! Errors of the trainer: what was found and what to do.

use std::path::PathBuf;

/// A failure of a training command.
#[derive(Debug, thiserror::Error)]
pub(crate) enum TrainingError {
    /// A file could not be read or written.
    #[error("{path}: {source}")]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A shard of another world, seed or layout.
    #[error("{path}: {problem}; delete its folder, it will be generated again")]
    Data {
        /// Which.
        path: PathBuf,
        /// What was found and expected.
        problem: String,
    },
    /// The simulated world refused what samples are drawn from.
    #[error(transparent)]
    World(#[from] gripline_simulation::SimulationError),
    /// A weights file that cannot be used.
    #[error(transparent)]
    Weights(#[from] gripline_network::NetworkError),
    /// Trained weights that the engine refuses.
    #[error("the trained weights are not usable: {0}; train again with another --seed")]
    Trained(gripline_network::NetworkError),
    /// Arguments that contradict each other.
    #[error("{0}")]
    Usage(String),
}

/// Adds the path to an I/O error.
pub(crate) fn at(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> TrainingError {
    let path = path.to_owned();
    move |source| TrainingError::File { path, source }
}

/// Wrong arguments.
pub(crate) fn usage(error: impl std::fmt::Display) -> TrainingError {
    TrainingError::Usage(error.to_string())
}
