//! Errors of recordings and files of force maps, and the outcome of completed commands.

use std::io;
use std::path::PathBuf;

/// A recording, an export or a file of force maps that cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// A file cannot be read.
    #[error("{}: {error}, expected {expected}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What it should be.
        expected: &'static str,
        /// The system's error.
        error: io::Error,
    },
    /// A file of an export cannot be written.
    #[error("{}: {error}, expected a folder that can be written", path.display())]
    Export {
        /// The file.
        path: PathBuf,
        /// The system's or the library's error.
        error: io::Error,
    },
    /// The file of the recording exists already.
    #[error(
        "{}: found a file, expected a name that is free; move it away or choose another --record",
        .0.display()
    )]
    Exists(PathBuf),
    /// A recording cannot be started or continued.
    #[error("{}: recording failed: {}; {advice}", path.display(), cause(error))]
    Record {
        /// The recording.
        path: PathBuf,
        /// The system's or the library's error.
        error: mcap::McapError,
        /// What to do.
        advice: &'static str,
    },
    /// A file is not a recording of this program.
    #[error("{}: found {found}, expected {expected}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What was found.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// The fingertips' calibration in a recording cannot be read.
    #[error(
        "the recording's calibration: {found}, expected gains and views of both fingertips: record it again"
    )]
    Calibration {
        /// What is wrong with it.
        found: String,
    },
    /// A file of force maps cannot be used.
    #[error("{}: {problem}", path.display())]
    Maps {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: MapsProblem,
    },
}

/// What is wrong with a file of force maps: what was found, what was expected, what to do.
#[derive(Debug, thiserror::Error)]
pub enum MapsProblem {
    /// Nothing has that name.
    #[error("no such file, expected a NumPy file of force maps: check the path")]
    Missing,
    /// Reading is not permitted.
    #[error("cannot be read ({0}), expected a readable NumPy file: check its rights and its disk")]
    Unreadable(#[from] io::Error),
    /// A directory, a pipe or a device.
    #[error("not a regular file, expected a NumPy file of force maps: give the path of the .npy file itself")]
    NotAFile,
    /// No byte at all.
    #[error("empty file (0 bytes), expected a NumPy file of force maps: record or copy it again")]
    Empty,
    /// Other bytes than those that begin a NumPy file: the first ones in hexadecimal, and what to do.
    #[error("starts with {0}, expected the NumPy signature 93 4e 55 4d 50 59: {1}")]
    NotNumpy(String, &'static str),
    /// The file ends before its data begin.
    #[error(
        "ends inside the NumPy header after {found} bytes, expected at least {expected}: record or copy it again"
    )]
    HeaderTruncated {
        /// Bytes in the file.
        found: usize,
        /// Bytes that signature and header need.
        expected: usize,
    },
    /// The version, the length or the text of a header that is not one of a plain array.
    #[error("NumPy header {0}, expected that of a plain float array: save it again with numpy.save")]
    Header(String),
    /// NumPy's description of a type that is not float32 or float64.
    #[error("dtype {0}, expected float32 or float64 ('<f4' or '<f8'): save maps.astype(numpy.float32)")]
    Dtype(String),
    /// Not (T, 3, R, C): the shape as NumPy writes it, and which axis is wrong.
    #[error("shape {0}, expected (T, 3, R, C) with frames, x y z, rows and columns: {1}")]
    Shape(String, String),
    /// Fewer data than the header promises.
    #[error(
        "truncated: found {found} bytes of data, expected {expected} ({frames} frames of {frame_bytes} bytes): record or copy \
         it again"
    )]
    Truncated {
        /// Bytes behind the header.
        found: u64,
        /// Bytes that the shape needs.
        expected: u128,
        /// Frames by the header.
        frames: u64,
        /// Bytes of one frame.
        frame_bytes: u64,
    },
    /// More data than the header promises.
    #[error(
        "found {found} bytes of data, expected {expected} by the shape in the header: save one array per file with numpy.save"
    )]
    TooLong {
        /// Bytes behind the header.
        found: u64,
        /// Bytes that the shape needs.
        expected: u64,
    },
    /// NaN or an infinity.
    #[error(
        "frame {frame}, row {row}, column {column}, axis {axis}: found {found}, expected a finite number: leave the frame out \
         or repair it (numpy.isfinite finds them)"
    )]
    NotFinite {
        /// Frame, from 0.
        frame: u64,
        /// Row of the file's grid.
        row: usize,
        /// Column of the file's grid.
        column: usize,
        /// `x`, `y` or `z`.
        axis: char,
        /// What was found.
        found: f64,
    },
}

/// Outcome of a completed command.
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

/// The system's message where the library only says that reading or writing failed.
fn cause(error: &mcap::McapError) -> String {
    match error {
        mcap::McapError::Io(error) => error.to_string(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_named_in_the_systems_words() {
        let full = std::io::Error::from(std::io::ErrorKind::StorageFull);
        let error = RecordingError::Record {
            path: PathBuf::from("today.mcap"),
            error: mcap::McapError::Io(full),
            advice: "make room or record elsewhere",
        };
        let text = error.to_string();
        assert!(
            text.contains("no storage space") && text.contains("make room"),
            "{text}"
        );
    }
}
