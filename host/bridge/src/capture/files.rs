//! Pictures that were taken before, one after the other: of a folder, or of a recording. A picture that cannot be read is
//! passed over and counted, as a camera's is. Touches the world.

use std::path::{Path, PathBuf};
use std::time::Instant;

use gripline_protocol::message::GripMode;

use super::camera::Counts;
use super::picture;
use crate::error::Failure;
use crate::recording::{Ending, Image, Reader};

/// Names under which the picture of the untouched fingertip is looked for; `simulate` writes it beside the frames.
const REST: [&str; 4] = ["rest.png", "rest.jpg", "../rest.png", "../rest.jpg"];

/// The pictures of a folder in the order of their names.
#[derive(Debug)]
pub(crate) struct FolderFrames {
    folder: PathBuf,
    files: std::vec::IntoIter<PathBuf>,
    /// The picture at rest that lies with them.
    rest: Option<PathBuf>,
    counts: Counts,
    news: Vec<String>,
}

impl FolderFrames {
    /// The pictures of `path`, or of its folder `frames` where there is one (`gripline simulate --out`).
    ///
    /// # Errors
    /// [`Failure`] when there is no picture.
    pub(crate) fn open(path: &Path) -> Result<Self, Failure> {
        let frames = path.join("frames");
        let folder = if frames.is_dir() { frames } else { path.to_owned() };
        let rest = REST
            .iter()
            .map(|name| folder.join(name))
            .find(|rest| rest.is_file());
        let mut files = picture::listed(&folder)?;
        files.retain(|file| Some(file) != rest.as_ref());
        Ok(Self {
            folder,
            files: files.into_iter(),
            rest,
            counts: Counts::default(),
            news: Vec::new(),
        })
    }

    /// The picture of the untouched fingertip that lies with the others.
    ///
    /// # Errors
    /// [`Failure`] when there is none, or it cannot be read.
    pub(crate) fn rest(&self) -> Result<Vec<u8>, Failure> {
        match &self.rest {
            Some(file) => picture::crop(file, false),
            None => Err(Failure::failed(format!(
                "{}: found no rest.png in or beside the folder, expected a picture of the untouched fingertip: put one there, \
                 or take the ones of `gripline calibrate rest` (calibration.file)",
                self.folder.display()
            ))),
        }
    }

    /// The next picture that can be read, and how long that took, µs.
    pub(crate) fn next(&mut self) -> Option<(Vec<u8>, f64)> {
        for file in self.files.by_ref() {
            let started = Instant::now();
            self.counts.came += 1;
            match picture::crop(&file, false) {
                Ok(crop) => return Some((crop, started.elapsed().as_secs_f64() * 1e6)),
                Err(failure) => {
                    self.counts.damaged += 1;
                    self.news.push(failure.message);
                }
            }
        }
        None
    }

    pub(crate) const fn counts(&self) -> Counts {
        self.counts
    }

    pub(crate) fn take_news(&mut self) -> Vec<String> {
        std::mem::take(&mut self.news)
    }
}

/// The pictures of a recording.
pub(crate) struct RecordedFrames {
    reader: Reader,
    path: PathBuf,
    counts: Counts,
    news: Vec<String>,
}

impl RecordedFrames {
    /// Opens a recording that has pictures.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read, or was recorded without pictures.
    pub(crate) fn open(path: &Path) -> Result<Self, Failure> {
        let reader = Reader::open(path)?;
        if reader.rest.is_empty() {
            return Err(Failure::failed(format!(
                "{}: found no picture at rest, expected some at the beginning of the recording",
                path.display()
            )));
        }
        Ok(Self {
            reader,
            path: path.to_owned(),
            counts: Counts::default(),
            news: Vec::new(),
        })
    }

    /// Frames a second of the run that was recorded.
    pub(crate) fn rate(&self) -> Option<f64> {
        self.reader.about.frames_per_second.parse().ok()
    }

    /// The untouched fingertip.
    pub(crate) fn rest(&self) -> &[Vec<u8>] {
        &self.reader.rest
    }

    /// The next picture, and what the gripper was told with it.
    ///
    /// # Errors
    /// [`Failure`] when the file cannot be read.
    pub(crate) fn next(&mut self) -> Result<Option<(Vec<u8>, GripMode)>, Failure> {
        while let Some(frame) = self.reader.next_frame()? {
            self.counts.came += 1;
            if let Some(picture) = frame.picture {
                return Ok(Some((Image::into_crop(picture), frame.status.wish)));
            }
            self.counts.missed += 1;
        }
        if self.counts.missed == self.counts.came {
            return Err(Failure::failed(format!(
                "{}: found {} frames and not one picture, expected a recording with pictures (--record-pictures full)",
                self.path.display(),
                self.counts.came
            )));
        }
        if let Ending::Cut(why) = self.reader.ending() {
            self.news.push(format!(
                "{}: cut short after {} frames ({why})",
                self.path.display(),
                self.counts.came
            ));
        }
        Ok(None)
    }

    pub(crate) const fn counts(&self) -> Counts {
        self.counts
    }

    pub(crate) fn take_news(&mut self) -> Vec<String> {
        std::mem::take(&mut self.news)
    }
}
