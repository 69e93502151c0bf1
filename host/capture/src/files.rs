//! Pictures that were taken before, one after the other: of a folder or of a clip. A picture that cannot be read is
//! passed over and counted, as a camera's is. Touches the world.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::avi::{ClipReader, Next};
use super::camera::Counts;
use super::jpeg::JpegCrop;
use super::picture;
use gripline_recording::error::Failure;

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
pub struct FolderFrames {
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
    pub fn open(path: &Path, fingertip: usize) -> Result<Self, Failure> {
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
    pub fn rest(&self) -> Result<Vec<u8>, Failure> {
        rest_of(self.rest.as_ref(), &self.folder)
    }

    /// The next picture that can be read, and how long that took, µs.
    pub fn next(&mut self) -> Option<(Vec<u8>, f64)> {
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

    /// What became of the pictures so far.
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    /// What happened since it was last asked, for people.
    pub fn take_news(&mut self) -> Vec<String> {
        std::mem::take(&mut self.news)
    }
}

/// The pictures of a clip.
#[derive(Debug)]
pub struct ClipFrames {
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
    pub fn open(path: &Path) -> Result<Self, Failure> {
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
    pub const fn rate(&self) -> f64 {
        self.reader.rate
    }

    /// The picture of the untouched fingertip that lies beside it.
    ///
    /// # Errors
    /// [`Failure`] when there is none, or it cannot be read.
    pub fn rest(&self) -> Result<Vec<u8>, Failure> {
        rest_of(self.rest.as_ref(), &self.file)
    }

    /// The next picture that can be read, and how long that took, µs.
    pub fn next(&mut self) -> Option<(Vec<u8>, f64)> {
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

    /// What became of the pictures so far.
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    /// What happened since it was last asked, for people.
    pub fn take_news(&mut self) -> Vec<String> {
        std::mem::take(&mut self.news)
    }
}
