//! Recorded force maps: NumPy files of shape (T, 3, R, C), float32 or float64, channels x, y, z, R and C up to 20.
//! A smaller grid sits in the corner (row 0, column 0) of an empty 20×20 map. Numbers come out as they stand in the
//! file. C order is read frame by frame; Fortran order needs the whole file in memory, because its frames interleave.

mod layout;

use std::fmt;
use std::fs::{self, File};
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

pub use layout::{FrameForces, Problem};
use layout::{Layout, START_MAX};

/// A file of force maps that cannot be used, and why.
#[derive(Debug)]
pub struct MapsFileError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: Problem,
}

impl fmt::Display for MapsFileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.path.display(), self.problem)
    }
}

impl std::error::Error for MapsFileError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        Some(&self.problem)
    }
}

/// An open file of force maps, whose header and length have been checked.
#[derive(Debug)]
pub struct MapsFile {
    path: PathBuf,
    layout: Layout,
    reader: BufReader<File>,
    /// One frame, or all of them when they lie interleaved.
    data: Vec<u8>,
    next: u64,
}

impl MapsFile {
    /// Opens a file and checks everything but the numbers themselves.
    ///
    /// # Errors
    /// [`MapsFileError`] when the file is missing, is not a NumPy file of (T, 3, R, C) floats, or is too short.
    pub fn open(path: &Path) -> Result<Self, MapsFileError> {
        let open = || -> Result<Self, Problem> {
            // Asked before opening, because opening a pipe would wait for its other end.
            let metadata = fs::metadata(path).map_err(|error| match error.kind() {
                io::ErrorKind::NotFound => Problem::Missing,
                _ => error.into(),
            })?;
            if !metadata.is_file() {
                return Err(Problem::NotAFile);
            }
            let mut file = File::open(path)?;
            let mut start = Vec::new();
            (&mut file).take(START_MAX as u64).read_to_end(&mut start)?;
            let layout = Layout::parse(&start)?;
            layout.check_length(metadata.len())?;
            file.seek(SeekFrom::Start(layout.data_start as u64))?;
            let mut reader = BufReader::with_capacity(1 << 16, file);
            let data = if layout.interleaved {
                let mut data = Vec::new();
                reader.read_to_end(&mut data)?;
                // Should the file have shrunk in the meantime.
                layout.check_length((layout.data_start + data.len()) as u64)?;
                data
            } else {
                vec![0; layout.frame_bytes()]
            };
            Ok(Self {
                path: path.to_owned(),
                layout,
                reader,
                data,
                next: 0,
            })
        };
        open().map_err(|problem| MapsFileError {
            path: path.to_owned(),
            problem,
        })
    }

    /// Frames in the file, at least 1.
    #[must_use]
    pub const fn frames(&self) -> u64 {
        self.layout.frames
    }

    /// Rows and columns of the file's grid, 1 to 20 each.
    #[must_use]
    pub const fn grid(&self) -> (usize, usize) {
        (self.layout.rows, self.layout.columns)
    }

    /// Reads the next frame; `false` when there is none left.
    ///
    /// # Errors
    /// [`MapsFileError`] when a number is NaN or infinite, or the file cannot be read any more.
    pub fn read_frame(&mut self, forces: &mut FrameForces) -> Result<bool, MapsFileError> {
        if self.next >= self.layout.frames {
            return Ok(false);
        }
        let read = if self.layout.interleaved {
            Ok(())
        } else {
            self.reader.read_exact(&mut self.data).map_err(Problem::from)
        };
        read.and_then(|()| self.layout.decode(&self.data, self.next, forces))
            .map_err(|problem| MapsFileError {
                path: self.path.clone(),
                problem,
            })?;
        self.next += 1;
        Ok(true)
    }
}
