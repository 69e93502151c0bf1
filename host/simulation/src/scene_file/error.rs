//! Why a scene file cannot be used: always one line that names file, line and key, what was found, what was
//! expected and what to do.

use std::path::Path;

/// What is wrong with a scene file, or with what happens when it is played.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}:{line}: {key}found {found}, expected {expected}: {advice}", file.display())]
pub struct SceneError {
    /// The scene file.
    pub file: Box<Path>,
    /// Line in it, from 1.
    pub line: usize,
    /// The key with its section and a colon, `indenter.radius_mm: `; empty where no key is to blame.
    pub key: Box<str>,
    /// What stands there.
    pub found: Box<str>,
    /// What should stand there.
    pub expected: Box<str>,
    /// What to do.
    pub advice: Box<str>,
}
