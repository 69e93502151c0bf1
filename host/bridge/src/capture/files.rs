//! Pictures that were taken before, one after the other: of a folder, of a clip, or of a recording. A picture that cannot be read is
//! passed over and counted, as a camera's is. Touches the world.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::Instant;

use gripline_protocol::message::GripMode;

use super::avi::{ClipReader, Next};
use super::camera::Counts;
use super::jpeg::JpegCrop;
use super::picture;
use crate::error::Failure;
use crate::recording::{Ending, Image, Reader};

/// Names under which the picture of the untouched fingertip is looked for; `simulate` writes it beside the frames.
const REST: [&str; 2] = ["rest.png", "rest.jpg"];
/// The same of the second fingertip.
const SECOND_REST: [&str; 2] = ["rest_1.png", "rest_1.jpg"];

/// The picture at rest that lies in one of the folders; what is named as of the second fingertip has its own.
fn rest_in(folders: &[&Path], of: &Path) -> Option<PathBuf> {
    let is_second = of
        .file_stem()
        .is_some_and(|name| name.to_string_lossy().ends_with("_1"));
    let second = SECOND_REST.iter().filter(|_| is_second);
    let places = second
        .chain(&REST)
        .flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
    places.into_iter().find(|rest| rest.is_file())
}

fn rest_of(rest: Option<&PathBuf>, of: &Path) -> Result<Vec<u8>, Failure> {
    match rest {
        Some(file) => picture::crop(file, false),
        None => Err(Failure::failed(format!(
            "{}: found no rest.png in it or beside it, expected a picture of the untouched fingertip: put one there, or take the \
             ones of `gripline calibrate rest` (calibration.file)",
            of.display()
        ))),
    }
}

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
    /// The pictures of `path`, or of its folder `frames` (of the second fingertip `frames_1`) where there is one, as
    /// `gripline simulate --out` makes them.
    ///
    /// # Errors
    /// [`Failure`] when there is no picture.
    pub(crate) fn open(path: &Path, fingertip: usize) -> Result<Self, Failure> {
        let frames = path.join(if fingertip == 0 { "frames" } else { "frames_1" });
        let folder = if frames.is_dir() { frames } else { path.to_owned() };
        let rest = rest_in(&[&folder, &folder.join("..")], &folder);
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
        rest_of(self.rest.as_ref(), &self.folder)
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

/// The pictures of a clip.
#[derive(Debug)]
pub(crate) struct ClipFrames {
    file: PathBuf,
    reader: ClipReader<BufReader<File>>,
    jpeg: JpegCrop,
    /// The picture at rest that lies beside it.
    rest: Option<PathBuf>,
    counts: Counts,
    news: Vec<String>,
}

impl ClipFrames {
    /// Opens a clip.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read or is none.
    pub(crate) fn open(path: &Path) -> Result<Self, Failure> {
        Ok(Self {
            file: path.to_owned(),
            reader: picture::open_clip(path)?,
            jpeg: JpegCrop::default(),
            rest: rest_in(&[path.parent().unwrap_or(Path::new(""))], path),
            counts: Counts::default(),
            news: Vec::new(),
        })
    }

    /// Frames a second.
    pub(crate) const fn rate(&self) -> f64 {
        self.reader.rate
    }

    /// The picture of the untouched fingertip that lies beside it.
    ///
    /// # Errors
    /// [`Failure`] when there is none, or it cannot be read.
    pub(crate) fn rest(&self) -> Result<Vec<u8>, Failure> {
        rest_of(self.rest.as_ref(), &self.file)
    }

    /// The next picture that can be read, and how long that took, µs.
    pub(crate) fn next(&mut self) -> Option<(Vec<u8>, f64)> {
        loop {
            match self.reader.next() {
                Next::Picture(jpeg) => {
                    let started = Instant::now();
                    let mut crop = Vec::new();
                    let decoded = self.jpeg.decode(&jpeg, &mut crop);
                    let place = self.counts.came;
                    self.counts.came += 1;
                    match decoded {
                        Ok(()) => return Some((crop, started.elapsed().as_secs_f64() * 1e6)),
                        Err(wrong) => {
                            self.counts.damaged += 1;
                            self.news
                                .push(format!("{}: picture {place}: {wrong}", self.file.display()));
                        }
                    }
                }
                Next::End => return None,
                Next::Cut(why) => {
                    self.counts.damaged += 1;
                    self.news
                        .push(format!("{}: cut short: {why}", self.file.display()));
                    return None;
                }
            }
        }
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
    /// Whose pictures are played.
    fingertip: usize,
    path: PathBuf,
    counts: Counts,
    news: Vec<String>,
}

impl RecordedFrames {
    /// Opens a recording that has pictures, for those of a fingertip; those of its only one where it has one.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read, or was recorded without pictures.
    pub(crate) fn open(path: &Path, fingertip: usize) -> Result<Self, Failure> {
        let reader = Reader::open(path)?;
        let is_there = reader.rest.get(fingertip).is_some_and(|rest| !rest.is_empty());
        let fingertip = if is_there { fingertip } else { 0 };
        if reader.rest[fingertip].is_empty() {
            return Err(Failure::failed(format!(
                "{}: found no picture at rest, expected some at the beginning of the recording",
                path.display()
            )));
        }
        Ok(Self {
            reader,
            fingertip,
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
        &self.reader.rest[self.fingertip]
    }

    /// The next picture, and what the gripper was told with it.
    ///
    /// # Errors
    /// [`Failure`] when the file cannot be read.
    pub(crate) fn next(&mut self) -> Result<Option<(Vec<u8>, GripMode)>, Failure> {
        while let Some(frame) = self.reader.next_frame()? {
            if usize::from(frame.status.sensor) != self.fingertip {
                continue;
            }
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
