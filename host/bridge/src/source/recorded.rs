//! The pictures of a recording as a source. Touches the world.

use std::path::{Path, PathBuf};

use gripline_capture::Counts;
use gripline_protocol::message::GripMode;
use gripline_recording::{Completeness, Image, Metadata, Reader};

use crate::error::Error;

/// The pictures of a recording.
pub(crate) struct RecordedFrames {
    reader: Reader,
    /// The fingertip whose pictures are played.
    fingertip: usize,
    path: PathBuf,
    counts: Counts,
}

/// A picture, and the mode requested with it.
pub(super) struct RecordedPicture {
    pub crop: Vec<u8>,
    pub requested_mode: Option<GripMode>,
}

impl RecordedFrames {
    /// Opens a recording with pictures of a fingertip; if it has only one, of that.
    ///
    /// # Errors
    /// [`Error`] when it cannot be read, or was recorded without pictures.
    pub(super) fn open(path: &Path, fingertip: usize) -> Result<Self, Error> {
        let reader = Reader::open(path)?;
        let is_there = reader.rest.get(fingertip).is_some_and(|rest| !rest.is_empty());
        let fingertip = if is_there { fingertip } else { 0 };
        // What stands for the rest of printed markers need not be a picture.
        if reader.rest[fingertip].is_empty() && reader.metadata.rest.is_empty() {
            return Err(Error::failed(format!(
                "{}: found no picture at rest, expected some at the beginning of the recording",
                path.display()
            )));
        }
        Ok(Self {
            reader,
            fingertip,
            path: path.to_owned(),
            counts: Counts::default(),
        })
    }

    /// Frames a second of the run that was recorded.
    pub(super) fn rate(&self) -> Option<f64> {
        self.reader.metadata.frames_per_second.parse().ok()
    }

    /// The file.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Its metadata.
    pub(crate) const fn metadata(&self) -> &Metadata {
        &self.reader.metadata
    }

    /// The untouched fingertip.
    pub(crate) fn rest(&self) -> &[Vec<u8>] {
        &self.reader.rest[self.fingertip]
    }

    /// The next picture, and the mode requested with it.
    ///
    /// # Errors
    /// [`Error`] when the file cannot be read.
    pub(super) fn next(&mut self) -> Result<Option<RecordedPicture>, Error> {
        while let Some(frame) = self.reader.next_frame()? {
            if frame.status.sensor.index() != self.fingertip {
                continue;
            }
            self.counts.received += 1;
            if let Some(picture) = frame.picture {
                return Ok(Some(RecordedPicture {
                    crop: Image::into_crop(picture),
                    requested_mode: frame.status.requested_mode,
                }));
            }
            self.counts.missed += 1;
        }
        if self.counts.missed == self.counts.received {
            return Err(Error::failed(format!(
                "{}: found {} frames and not one picture, expected a recording with pictures (--record-pictures full)",
                self.path.display(),
                self.counts.received
            )));
        }
        if let Completeness::Truncated(why) = self.reader.completeness() {
            tracing::warn!(
                "{}: cut short after {} frames ({why})",
                self.path.display(),
                self.counts.received
            );
        }
        Ok(None)
    }

    pub(super) const fn counts(&self) -> Counts {
        self.counts
    }
}
