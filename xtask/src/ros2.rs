//! The other end of the tests of ROS 2: a Python of its own with another implementation of DDS, and with a reader of bags.

use std::path::PathBuf;

use crate::error::Error;
use crate::venv;

/// What is installed: Eclipse Cyclone DDS, and a reader of bags that needs no ROS.
const PACKAGES: [&str; 2] = ["cyclonedds==11.0.1", "rosbags==0.11.9"];
/// Where tests find it.
pub(crate) const VARIABLE: &str = "ROS2_TEST_PYTHON";

/// Makes that Python where it is not there yet; returns its path.
pub(crate) fn ensure() -> Result<PathBuf, Error> {
    Ok(venv::ensure("ros2-python", &PACKAGES)?.join("bin").join("python"))
}
