//! What goes wrong with a browser.

/// What went wrong, with what was found and expected.
#[derive(Debug, thiserror::Error)]
#[error("browser: {0}")]
pub struct BrowserError(pub(crate) String);
