//! Files that a scene names.

use std::io;
use std::path::Path;

use super::error::SceneError;
use super::keys;
use super::section::Section;

/// Largest file that a scene may name, bytes.
const FILE_MAX: usize = 64 << 20;

/// How a scene gets at the files that it names: path in, bytes out.
pub type Load<'a> = dyn FnMut(&Path) -> io::Result<Vec<u8>> + 'a;

/// Loads the file that `key` names, relative to the scene.
pub(super) fn load_named(
    section: &Section,
    key: &keys::Key,
    name: &str,
    load: &mut Load,
) -> Result<Vec<u8>, SceneError> {
    let path = section.directory().join(name);
    let problem = |found: &str, advice: &str| {
        Err(section.problem(
            key.name,
            found,
            "a file that can be read, relative to the scene file",
            advice,
        ))
    };
    match load(&path) {
        Ok(bytes) if bytes.len() <= FILE_MAX => Ok(bytes),
        Ok(bytes) => problem(
            &format!("{name} of {} MiB", bytes.len() >> 20),
            "take a file of at most 64 MiB",
        ),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            problem(&format!("no file {}", path.display()), "check the name")
        }
        Err(error) => problem(
            &format!("{} that cannot be read ({error})", path.display()),
            "check its rights and its disk",
        ),
    }
}
