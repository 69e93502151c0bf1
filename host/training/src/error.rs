//! What can go wrong outside the arithmetic, with what was found and what to do.

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
    /// A shard that is not what its name says.
    #[error("{path}: {problem}; delete its folder, it will be generated anew")]
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
    Weights(#[from] gripline_network::WeightsError),
    /// Weights whose values the engine refuses.
    #[error("the trained weights are not usable: {0}; train again with another --seed")]
    Trained(#[from] gripline_network::weights::WeightsProblem),
    /// Arguments that contradict each other.
    #[error("{0}")]
    Usage(String),
}

/// Names the path in an input or output error.
pub(crate) fn at(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> TrainingError {
    let path = path.to_owned();
    move |source| TrainingError::File { path, source }
}
