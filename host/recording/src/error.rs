//! The one error of the bridge: a line for people and an exit code for programs.
//! Printed once, in `main`.

use std::fmt;

/// What kind of end it was.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The arguments make no sense: exit code 2.
    Usage,
    /// What was asked for could not be done: exit code 1.
    Failed,
}

impl Kind {
    /// The process's exit code.
    #[must_use]
    pub const fn exit_code(self) -> u8 {
        match self {
            Self::Failed => 1,
            Self::Usage => 2,
        }
    }
}

/// How a command that was done ended.
#[derive(Debug, Clone, PartialEq, Eq)]
#[must_use]
pub enum Completion {
    /// Nothing is missing.
    Whole,
    /// Frames, maps or runs were lost: the line says which and how many. Exit code 3.
    WithLoss(String),
}

impl Completion {
    /// The process's exit code.
    #[must_use]
    pub const fn exit_code(&self) -> u8 {
        match self {
            Self::Whole => 0,
            Self::WithLoss(_) => 3,
        }
    }
}

/// Why a command did not end well: one line that names what was found, what was expected and what to do.
#[derive(Debug, Clone)]
pub struct Failure {
    /// The line.
    pub message: String,
    /// The kind, which decides the exit code.
    pub kind: Kind,
}

impl Failure {
    /// The arguments make no sense.
    pub fn usage(message: impl fmt::Display) -> Self {
        Self {
            message: message.to_string(),
            kind: Kind::Usage,
        }
    }

    /// What was asked for could not be done.
    pub fn failed(message: impl fmt::Display) -> Self {
        Self {
            message: message.to_string(),
            kind: Kind::Failed,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Failure {}
