//! Programs of Debian packages that tests start: installed with apt where they are missing and this is root's.

use std::process::Command;

use crate::debian;
use crate::error::Error;
use crate::process;

/// Programs, and the packages that have them.
pub(crate) struct Programs {
    packages: &'static [&'static str],
    names: &'static [&'static str],
    /// What makes them say their version and end.
    version: &'static str,
}

/// What clips are read and written with.
pub(crate) const FFMPEG: Programs = Programs {
    packages: &["ffmpeg"],
    names: &["ffmpeg", "ffprobe"],
    version: "-version",
};

/// What the live page is looked at with.
pub(crate) const CHROMIUM: Programs = Programs {
    packages: &["chromium", "chromium-driver"],
    names: &["chromium", "chromedriver"],
    version: "--version",
};

/// Programs for 64-bit ARM are linked and run with these.
pub(crate) const ARM: Programs = Programs {
    packages: &["gcc-aarch64-linux-gnu", "libc6-dev-arm64-cross", "qemu-user"],
    names: &["aarch64-linux-gnu-gcc", "qemu-aarch64"],
    version: "--version",
};

impl Programs {
    /// Makes sure that they can be started.
    pub(crate) fn ensure(&self) -> Result<(), Error> {
        let Some(program) = self.missing() else {
            return Ok(());
        };
        let packages = self.packages.join(" ");
        if debian::is_root() {
            eprintln!("no {program} here; installing with apt: {packages}");
            debian::install(self.packages)?;
        }
        self.missing().map_or(Ok(()), |program| {
            Err(Error::Product {
                what: program.to_owned(),
                found: "no such program on the search path".to_owned(),
                expected: format!("the one of Debian: run `apt-get install {packages}` as root"),
            })
        })
    }

    fn missing(&self) -> Option<&'static str> {
        let mut programs = self.names.iter().copied();
        programs.find(|program| process::output(Command::new(program).arg(self.version)).is_err())
    }
}
