//! What can end a picture's way.

use gripline_link::session::SessionError;
use gripline_protocol::NotFinite;

/// Why a picture did not get through.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// The network's output is no number.
    #[error(transparent)]
    NotFinite(#[from] NotFinite),
    /// The device cannot be spoken to any more.
    #[error(transparent)]
    Session(#[from] SessionError),
}

impl From<PipelineError> for gripline_recording::error::Failure {
    fn from(error: PipelineError) -> Self {
        Self::failed(error)
    }
}
