//! The token of HTTP requests: a line in a file that only its owner can read.

use std::fmt::Write as _;
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Read as _, Write as _};
use std::path::{Path, PathBuf};

use crate::error::Error;
use crate::rest::state_folder;

/// Random bytes of a new token.
const RANDOM_BYTES: usize = 32;
/// Minimum length of a token in a file.
const LENGTH_MIN: usize = 16;

/// Default path of the token; `None` if this system has no state folder.
pub(crate) fn default_file() -> Option<PathBuf> {
    Some(state_folder()?.join("token"))
}

/// The token of this file, which is created if it does not exist.
///
/// # Errors
/// [`Error`] that names the file, when others can read it too, or it holds no token.
pub(crate) fn of(file: &Path) -> Result<String, Error> {
    let failed = |what: String| {
        Error::failed(format!(
            "serve.token_file {}: {what}, expected a file that only its owner can read, with a token of at least {LENGTH_MIN} \
             characters in one line; delete it and one is made",
            file.display()
        ))
    };
    if let Some(folder) = file.parent() {
        fs::create_dir_all(folder).map_err(|error| failed(error.to_string()))?;
    }
    match create(file) {
        Ok(mut made) => {
            let token = random().map_err(|error| failed(error.to_string()))?;
            writeln!(made, "{token}").map_err(|error| failed(error.to_string()))?;
            return Ok(token);
        }
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
        Err(error) => return Err(failed(error.to_string())),
    }
    if let Some(mode) = readable_by_others(file).map_err(|error| failed(error.to_string()))? {
        return Err(failed(format!("found mode {mode:o}")));
    }
    let text = fs::read_to_string(file).map_err(|error| failed(error.to_string()))?;
    let token = text.trim();
    if token.len() < LENGTH_MIN || !token.bytes().all(|byte| byte.is_ascii_graphic()) {
        return Err(failed(format!("found {} characters", token.len())));
    }
    Ok(token.to_owned())
}

/// A new file for its owner only.
fn create(file: &Path) -> std::io::Result<File> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt as _;
        options.mode(0o600);
    }
    options.open(file)
}

/// The file's mode, if others than its owner may read it.
#[cfg(unix)]
fn readable_by_others(file: &Path) -> std::io::Result<Option<u32>> {
    use std::os::unix::fs::PermissionsExt as _;
    let mode = fs::metadata(file)?.permissions().mode() & 0o777;
    Ok((mode & 0o077 != 0).then_some(mode))
}

#[cfg(not(unix))]
fn readable_by_others(file: &Path) -> std::io::Result<Option<u32>> {
    fs::metadata(file).map(|_| None)
}

/// Random bytes of the system, in hexadecimal digits.
fn random() -> std::io::Result<String> {
    let mut bytes = [0; RANDOM_BYTES];
    File::open("/dev/urandom")?.read_exact(&mut bytes)?;
    let mut text = String::with_capacity(2 * RANDOM_BYTES);
    for byte in bytes {
        // Writing to a String cannot fail.
        let _ = write!(text, "{byte:02x}");
    }
    Ok(text)
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn a_token_is_made_once_for_its_owner_only_and_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("state/gripline/token");
        let made = of(&file).unwrap();
        assert_eq!((made.len(), of(&file).unwrap()), (64, made.clone()));
        assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);
        let other = folder.path().join("other");
        assert_ne!(of(&other).unwrap(), made);
    }

    #[test]
    fn a_file_that_others_can_read_or_without_a_token_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("token");
        of(&file).unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(0o644)).unwrap();
        let error = of(&file).unwrap_err().to_string();
        assert!(
            error.contains("found mode 644") && error.contains("only its owner"),
            "{error}"
        );
        fs::set_permissions(&file, fs::Permissions::from_mode(0o600)).unwrap();
        fs::write(&file, "short\n").unwrap();
        let error = of(&file).unwrap_err().to_string();
        assert!(error.contains("found 5 characters"), "{error}");
    }
}
