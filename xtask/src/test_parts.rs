//! The tests in two parts: those that only compute run beside the board's checks, those that wait for a clock or need the emulated
//! board run alone, after them. Cargo builds the same for both, and gives every test program to `cargo xtask test-part PART`, which
//! runs it or leaves it to the other part.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::Error;

/// A part of the tests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    /// Tests that neither wait for a clock nor need the emulated board.
    Computing,
    /// All others.
    Waiting,
}

/// Crates all of whose tests compute.
const COMPUTING: [&str; 9] = [
    "gripline-chart",
    "gripline-evaluation",
    "gripline-firmware",
    "gripline-kernels",
    "gripline-markers",
    "gripline-network",
    "gripline-protocol",
    "gripline-sensor",
    "gripline-simulation",
];

impl Part {
    const ALL: [Self; 2] = [Self::Computing, Self::Waiting];

    const fn name(self) -> &'static str {
        match self {
            Self::Computing => "computing",
            Self::Waiting => "waiting",
        }
    }

    /// Whether a crate's tests belong to it. A program whose crate cargo does not name waits.
    fn has(self, package: Option<&str>) -> bool {
        let computes = package.is_some_and(|package| COMPUTING.contains(&package));
        computes == (self == Self::Computing)
    }

    /// The option with which cargo runs only this part; `xtask` is this program's path.
    pub(crate) fn option(self, xtask: &Path) -> [String; 2] {
        let program = xtask.display().to_string();
        let runner = ["test-part", self.name()]
            .map(|word| format!("'{word}'"))
            .join(", ");
        [
            "--config".to_owned(),
            format!("target.'cfg(all())'.runner = ['{program}', {runner}]"),
        ]
    }
}

/// This program's path. The build of the tests replaces the file, so it is asked for before.
pub(crate) fn this_program() -> Result<PathBuf, Error> {
    std::env::current_exe().map_err(|source| Error::file(Path::new("xtask"), source))
}

/// `cargo xtask test-part PART PROGRAM ARGUMENTS`: what cargo calls for every test program.
pub(crate) fn command(arguments: &[String]) -> Result<(), Error> {
    let [part, program, arguments @ ..] = arguments else {
        return Err(Error::usage(
            "test-part",
            "too little",
            "computing or waiting, then a test program",
        ));
    };
    let known = Part::ALL.into_iter().find(|known| known.name() == part);
    let part = known.ok_or_else(|| Error::usage("test-part", part, "computing or waiting"))?;
    if !part.has(std::env::var("CARGO_PKG_NAME").ok().as_deref()) {
        return Ok(());
    }
    let status = Command::new(program).args(arguments).status();
    let status = status.map_err(|source| Error::Start {
        program: program.clone(),
        source,
    })?;
    if status.success() {
        Ok(())
    } else {
        Err(Error::Product {
            what: program.clone(),
            found: status.to_string(),
            expected: "success".to_owned(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_program_belongs_to_exactly_one_part() {
        for package in [
            None,
            Some("gripline"),
            Some("gripline-tests"),
            Some("gripline-firmware"),
        ] {
            let parts: Vec<Part> = Part::ALL.into_iter().filter(|part| part.has(package)).collect();
            assert_eq!(parts.len(), 1, "{package:?}");
        }
        assert!(Part::Computing.has(Some("gripline-simulation")) && Part::Waiting.has(None));
    }

    #[test]
    fn the_crates_that_compute_are_there() {
        let manifest = std::fs::read_to_string(crate::process::root().join("Cargo.toml")).unwrap();
        for name in COMPUTING {
            assert!(manifest.contains(&format!("{name} = {{ path = ")), "{name}");
        }
    }

    #[test]
    fn cargo_reads_the_option_as_toml() {
        let [_, option] = Part::Waiting.option(Path::new("/a/xtask"));
        assert_eq!(
            option,
            "target.'cfg(all())'.runner = ['/a/xtask', 'test-part', 'waiting']"
        );
    }

    #[test]
    fn a_test_that_fails_fails() {
        let words = |program: &str| ["waiting", program].map(str::to_owned).to_vec();
        // Cargo says this crate's name, which waits.
        assert!(command(&words("true")).is_ok());
        assert!(command(&words("false")).is_err());
        assert!(command(&["sometimes".to_owned(), "true".to_owned()]).is_err());
    }
}
