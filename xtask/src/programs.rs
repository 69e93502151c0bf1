//! Programs of Debian packages that checks start: installed with apt where one is missing and this is root's.

use std::process::Command;

use crate::error::Error;
use crate::process;

/// Programs, the option with which each says its version, and the packages that hold them.
pub(crate) struct Programs {
    names: &'static [&'static str],
    version: &'static str,
    packages: &'static [&'static str],
}

/// Clips are read and written with these.
pub(crate) const FFMPEG: Programs = Programs {
    names: &["ffmpeg", "ffprobe"],
    version: "-version",
    packages: &["ffmpeg"],
};

/// Programs for 64-bit ARM are linked and run with these.
pub(crate) const ARM: Programs = Programs {
    names: &["aarch64-linux-gnu-gcc", "qemu-aarch64"],
    version: "--version",
    packages: &["gcc-aarch64-linux-gnu", "libc6-dev-arm64-cross", "qemu-user"],
};

impl Programs {
    /// Makes sure that the programs can be started.
    pub(crate) fn ensure(&self) -> Result<(), Error> {
        let missing = || {
            let mut programs = self.names.iter();
            programs.find(|program| process::output(Command::new(program).arg(self.version)).is_err())
        };
        let Some(program) = missing() else {
            return Ok(());
        };
        let packages = self.packages.join(" ");
        let is_root = process::output(Command::new("id").arg("-u")).is_ok_and(|id| id.trim() == "0");
        if is_root {
            eprintln!("no {program} here; installing {packages}");
            let install = || {
                process::run(
                    Command::new("apt-get")
                        .env("DEBIAN_FRONTEND", "noninteractive")
                        .args(["install", "--yes", "-qq", "--no-install-recommends"])
                        .args(self.packages),
                )
            };
            if install().is_err() {
                process::run(Command::new("apt-get").args(["update", "-qq"]))?;
                install()?;
            }
        }
        missing().map_or(Ok(()), |program| {
            Err(Error::Product {
                what: (*program).to_owned(),
                found: "no such program on the search path".to_owned(),
                expected: format!("the one of Debian's packages: run `apt-get install {packages}` as root"),
            })
        })
    }
}
