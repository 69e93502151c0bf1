//! Virtual environments of Python, each with the packages of one purpose, in a folder of ours.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use crate::debian;
use crate::error::Error;
use crate::process;

/// The folder of the environment with this name, made where it is missing or holds other versions.
pub(crate) fn ensure(name: &str, packages: &[&str]) -> Result<PathBuf, Error> {
    let folder = process::products().join(name);
    let marker = folder.join("packages.txt");
    let wanted = packages.join("\n");
    if fs::read_to_string(&marker).is_ok_and(|found| found == wanted) {
        return Ok(folder);
    }
    eprintln!(
        "making a Python with {} in {}",
        packages.join(", "),
        folder.display()
    );
    let make = || {
        process::run(
            Command::new("python3")
                .args(["-m", "venv", "--clear"])
                .arg(&folder),
        )
    };
    if make().is_err() {
        // Debian's python3 comes without it.
        if debian::is_root() {
            debian::install(&["python3-venv"])?;
        }
        make()?;
    }
    process::run(
        Command::new(folder.join("bin").join("python"))
            .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"])
            .args(packages),
    )?;
    fs::write(&marker, wanted).map_err(|source| Error::file(&marker, source))?;
    Ok(folder)
}
