//! What can end a picture's way.

use gripline_link::LinkError;
use gripline_markers::MarkerError;
use gripline_protocol::NotFinite;

/// Why a picture did not get through.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// The network's output is no number.
    #[error(transparent)]
    NotFinite(#[from] NotFinite),
    /// Printed markers, or their rest, cannot be used.
    #[error(transparent)]
    Markers(#[from] MarkerProblem),
    /// The device cannot be spoken to any more.
    #[error(transparent)]
    Link(#[from] LinkError),
}

/// Why printed markers cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum MarkerProblem {
    /// A picture.
    #[error(transparent)]
    Markers(#[from] MarkerError),
    /// A picture at rest.
    #[error("{rest}: {problem}")]
    Rest {
        /// What it is called.
        rest: String,
        /// What is wrong with it.
        problem: MarkerError,
    },
    /// Pictures at rest that differ.
    #[error(
        "{rest}: found pictures that differ (energy {found:.0}), expected an untouched gel (at most {expected}): choose pictures in \
         which nothing touches it"
    )]
    RestMoves {
        /// What they are called.
        rest: String,
        /// Largest energy of the difference, squared grey levels per pixel.
        found: f32,
        /// The limit.
        expected: f32,
    },
}
