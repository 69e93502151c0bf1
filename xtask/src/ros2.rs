//! The other end of the tests of ROS 2: a Python of its own with another implementation of DDS, and with a reader of bags.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::Error;
use crate::process;

/// What is installed: Eclipse Cyclone DDS, and a reader of bags that needs no ROS.
const PACKAGES: [&str; 2] = ["cyclonedds==11.0.1", "rosbags==0.11.9"];
/// Where tests find it.
pub(crate) const VARIABLE: &str = "ROS2_TEST_PYTHON";

/// Makes that Python where it is not there yet; returns its path.
pub(crate) fn ensure() -> Result<PathBuf, Error> {
    let folder = process::products().join("ros2-python");
    let python = folder.join("bin").join("python");
    if is_there(&python) {
        return Ok(python);
    }
    eprintln!(
        "making a Python with {} in {}",
        PACKAGES.join(", "),
        folder.display()
    );
    process::run(
        Command::new("python3")
            .args(["-m", "venv", "--clear"])
            .arg(&folder),
    )?;
    process::run(
        Command::new(&python)
            .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"])
            .args(PACKAGES),
    )?;
    if is_there(&python) {
        return Ok(python);
    }
    Err(Error::Product {
        what: python.display().to_string(),
        found: "a Python that cannot import cyclonedds and rosbags".to_owned(),
        expected: "one that can: Python 3.10 or newer with venv, and the package index".to_owned(),
    })
}

fn is_there(python: &Path) -> bool {
    python.exists()
        && process::output(Command::new(python).args(["-c", "import cyclonedds.domain, rosbags.highlevel"]))
            .is_ok()
}
