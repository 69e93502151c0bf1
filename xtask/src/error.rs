//! Everything that can stop an xtask command, each with what was found and what to do.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Why a command stopped.
#[derive(Debug)]
pub(crate) enum Error {
    /// The command line is wrong: what was named, what stood there, what belongs there.
    Usage {
        field: String,
        found: String,
        expected: String,
    },
    /// A program could not be started.
    Start { program: String, source: std::io::Error },
    /// A program ran and failed.
    Failed {
        command: String,
        status: String,
        said: String,
    },
    /// A file or folder could not be read or written.
    File { path: PathBuf, source: std::io::Error },
    /// Something that was built is not what it has to be.
    Product {
        what: String,
        found: String,
        expected: String,
    },
    /// This machine cannot get the libraries of a target: every way that was tried, and its end.
    NoTarget {
        target: &'static str,
        tried: Vec<(String, String)>,
        rustc: String,
    },
    /// Some of the checks failed; the summary has named them.
    Checks { failed: usize, of: usize },
}

impl Error {
    pub(crate) fn usage(field: &str, found: &str, expected: &str) -> Self {
        Self::Usage {
            field: field.to_owned(),
            found: found.to_owned(),
            expected: expected.to_owned(),
        }
    }

    /// What was built, what it is, and what it has to be.
    pub(crate) fn product(what: &str, found: &dyn fmt::Display, expected: &str) -> Self {
        Self::Product {
            what: what.to_owned(),
            found: found.to_string(),
            expected: expected.to_owned(),
        }
    }

    pub(crate) fn file(path: &Path, source: std::io::Error) -> Self {
        Self::File {
            path: path.to_owned(),
            source,
        }
    }

    pub(crate) fn exit_code(&self) -> ExitCode {
        ExitCode::from(if matches!(self, Self::Usage { .. }) { 2 } else { 1 })
    }
}

/// The value of an option, or what is missing.
pub(crate) fn value_of<'a>(
    option: &str,
    rest: &mut impl Iterator<Item = &'a String>,
) -> Result<&'a str, Error> {
    rest.next()
        .map(String::as_str)
        .ok_or_else(|| Error::usage(option, "nothing", "a value after it"))
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Usage {
                field,
                found,
                expected,
            } => {
                write!(
                    f,
                    "{field}: found `{found}`, expected {expected}; `cargo xtask` shows the commands"
                )
            }
            Self::Start { program, source } => write!(f, "`{program}` cannot be started: {source}"),
            Self::Failed {
                command,
                status,
                said,
            } => {
                write!(f, "`{command}` failed ({status})")?;
                if said.is_empty() {
                    Ok(())
                } else {
                    write!(f, ": {said}")
                }
            }
            Self::File { path, source } => write!(f, "{}: {source}", path.display()),
            Self::Product {
                what,
                found,
                expected,
            } => write!(f, "{what}: found {found}, expected {expected}"),
            Self::NoTarget { target, tried, rustc } => {
                writeln!(f, "no libraries for {target} are to be had here. Tried:")?;
                for (way, end) in tried {
                    writeln!(f, "  - {way}: {end}")?;
                }
                write!(
                    f,
                    "Do one of these, then run the command again:\n  \
                     - rustup target add {target}   (needs rustup and its download server)\n  \
                     - rustup component add rust-src   (the libraries are then built from it)\n  \
                     - unpack the library sources of exactly rustc {rustc} to /usr/src/rustc-{rustc}/library"
                )
            }
            Self::Checks { failed, of } => write!(f, "{failed} of {of} checks failed"),
        }
    }
}
