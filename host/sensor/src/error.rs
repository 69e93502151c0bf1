//! Why a description cannot be used: every problem with its line and key, what was found, what was expected, what to do.

use std::fmt;
use std::path::{Path, PathBuf};

/// What is wrong with one key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Line of the file, from 1; where a key is missing, its section's.
    pub line: usize,
    /// The key with its section, `markers.pitch_mm`.
    pub key: String,
    /// What stands there.
    pub found: String,
    /// What should stand there.
    pub expected: String,
    /// What to do.
    pub advice: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            line,
            key,
            found,
            expected,
            advice,
        } = self;
        write!(f, "{line}: {key}: found {found}, expected {expected}: {advice}")
    }
}

/// Why a description cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SensorError {
    /// The file cannot be read.
    #[error("{}: {error}, expected a sensor's description (TOML): {advice}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// The system's words.
        error: std::io::Error,
        /// What to do.
        advice: String,
    },
    /// The file is no TOML.
    #[error("{}:{line}: found no TOML ({said}), expected `key = value`: mend the line", file.display())]
    Syntax {
        /// The file.
        file: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The parser's words.
        said: String,
    },
    /// Keys are missing, unknown or implausible: at least one problem, in the order of lines.
    #[error("{}", first(file, problems))]
    Description {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        problems: Vec<Problem>,
    },
}

/// The first problem, and how many more there are.
fn first(file: &Path, problems: &[Problem]) -> String {
    let shown = problems
        .first()
        .map_or_else(String::new, |problem| format!("{}:{problem}", file.display()));
    match problems.len() {
        0 | 1 => shown,
        all => format!(
            "{shown} ({} more: gripline sensor check {})",
            all - 1,
            file.display()
        ),
    }
}
