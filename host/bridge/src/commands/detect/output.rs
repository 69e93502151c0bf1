//! Where the CSV goes: a file that appears whole or not at all, or standard output. Touches the world.
//! A regular file is written beside its place and renamed; what is not one (a device, a pipe) is written directly.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// The CSV under way. Dropped before [`Output::finish`], it leaves nothing behind.
pub(super) struct Output {
    writer: BufWriter<Box<dyn Write>>,
    pending: Option<Pending>,
}

/// A file that waits to take its place.
struct Pending {
    temporary: PathBuf,
    target: PathBuf,
}

impl Drop for Pending {
    fn drop(&mut self) {
        // After the rename there is nothing to remove; before it, a failed removal cannot be helped.
        let _ = fs::remove_file(&self.temporary);
    }
}

impl Output {
    /// Standard output.
    pub(super) fn stdout() -> Self {
        Self {
            writer: BufWriter::new(Box::new(io::stdout())),
            pending: None,
        }
    }

    /// A file, which replaces one that is there when it is finished.
    pub(super) fn file(path: &Path) -> io::Result<Self> {
        // Links are followed, so that the file they lead to is replaced and not the link.
        let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let special = fs::metadata(&target).is_ok_and(|metadata| !metadata.is_file());
        let (writer, pending) = if special {
            (File::create(&target)?, None)
        } else {
            let name = target.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
            let mut temporary_name = std::ffi::OsString::from(".");
            temporary_name.push(name);
            temporary_name.push(format!(".{}.partial", std::process::id()));
            let temporary = target.with_file_name(temporary_name);
            let file = File::create(&temporary)?;
            (file, Some(Pending { temporary, target }))
        };
        Ok(Self {
            writer: BufWriter::new(Box::new(writer)),
            pending,
        })
    }

    /// Writes what is left and puts the file in its place.
    pub(super) fn finish(mut self) -> io::Result<()> {
        self.writer.flush()?;
        match self.pending.take() {
            Some(pending) => fs::rename(&pending.temporary, &pending.target),
            None => Ok(()),
        }
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.writer.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }
}
