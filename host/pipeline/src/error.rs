//! Errors of the pipeline.

use gripline_link::LinkError;
use gripline_markers::MarkerError;
use gripline_protocol::NotFinite;

/// Why a picture could not be processed.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// The network's output is no number.
    #[error(transparent)]
    NotFinite(#[from] NotFinite),
    /// Printed markers, or their rest pictures, cannot be used.
    #[error(transparent)]
    Markers(#[from] MarkerProblem),
    /// The connection to the device is lost.
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
    /// A recording does not say what stood for rest.
    #[error(
        "the recording's rest: found {found:?}, expected own pictures, other pictures or regular grid: record it again"
    )]
    RecordedRest {
        /// What it says.
        found: String,
    },
    /// More than a few pictures at rest show a contact.
    #[error(
        "{rest}: found a contact or a motion in pictures {touched}, expected an untouched gel: nothing touches it in {untouched}, choose \
         from these"
    )]
    RestTouched {
        /// What they are called.
        rest: String,
        /// Which show it.
        touched: String,
        /// Which do not.
        untouched: String,
    },
    /// An imprint at rest that is gone in other pictures of the clip.
    #[error(
        "{rest}: found an imprint (energy {found:.0}) that is gone in picture {picture} of the clip (energy {there:.0}), expected an \
         untouched gel: something touches it at rest, choose pictures such as that one, or leave --rest out"
    )]
    RestGone {
        /// What they are called.
        rest: String,
        /// Energy of what an even light does not explain, squared grey levels per pixel.
        found: f32,
        /// A picture without it.
        picture: usize,
        /// Energy there.
        there: f32,
    },
}
