//! The other end of the test of Foxglove's WebSocket: a Python of its own with a client that knows nothing of Foxglove's SDK.

use std::path::PathBuf;

use crate::error::Error;
use crate::venv;

/// What is installed: WebSockets, and messages read by the schemas that are advertised.
const PACKAGES: [&str; 2] = ["websockets==15.0.1", "protobuf==6.33.0"];
/// Where tests find it.
pub(crate) const VARIABLE: &str = "FOXGLOVE_TEST_PYTHON";

/// Makes that Python where it is not there yet; returns its path.
pub(crate) fn ensure() -> Result<PathBuf, Error> {
    Ok(venv::ensure("foxglove-python", &PACKAGES)?
        .join("bin")
        .join("python"))
}
