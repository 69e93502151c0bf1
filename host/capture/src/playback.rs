//! Pictures that were taken before, one after the other: of a folder or a clip. Touches the world.

use std::path::{Path, PathBuf};
use std::time::Instant;

use gripline_sensor::Capture;
use tracing::warn;

use crate::camera::Counts;
use crate::clip::{ClipReader, ColourClip};
use crate::error::CaptureError;
use crate::picture;

/// Names of the picture of the untouched fingertip; `simulate` writes it beside the frames.
const REST: [&str; 2] = ["rest.png", "rest.jpg"];
/// The same of the second fingertip.
const SECOND_REST: [&str; 2] = ["rest_1.png", "rest_1.jpg"];

/// Reads the pictures of a folder, a file or a clip in their order.
#[derive(Debug)]
pub struct PictureReader {
    path: PathBuf,
    kind: Kind,
    /// Whether they may be 88×88.
    small: bool,
    number: usize,
}

#[derive(Debug)]
enum Kind {
    Files(std::vec::IntoIter<PathBuf>),
    Clip(ClipReader),
    Finished,
}

impl PictureReader {
    /// Opens a folder, a picture, or else a clip; there is at least one picture.
    ///
    /// # Errors
    /// [`CaptureError`] that names what cannot be read.
    pub fn open(path: &Path, small: bool) -> Result<Self, CaptureError> {
        let kind = if path.is_dir() || picture::is_picture(path) {
            Kind::Files(picture::list(path)?.into_iter())
        } else {
            Kind::Clip(ClipReader::open(path)?)
        };
        Ok(Self {
            path: path.to_owned(),
            kind,
            small,
            number: 0,
        })
    }

    /// Name and 440×440 crop of the next picture; `None` at the end.
    ///
    /// # Errors
    /// [`CaptureError`] of the next picture; what follows it can still be read. The last is
    /// [`CaptureError::ClipDamaged`] when pictures of a clip are missing.
    pub fn next_picture(&mut self) -> Result<Option<(String, Vec<u8>)>, CaptureError> {
        match &mut self.kind {
            Kind::Files(files) => files
                .next()
                .map(|file| Ok((file.display().to_string(), picture::crop(&file, self.small)?)))
                .transpose(),
            Kind::Clip(clip) => {
                if let Some(crop) = clip.next_picture() {
                    let name = format!("{}: picture {}", self.path.display(), self.number);
                    self.number += 1;
                    Ok(Some((name, crop)))
                } else {
                    let finished = clip.finish();
                    self.kind = Kind::Finished;
                    finished.map(|()| None)
                }
            }
            Kind::Finished => Ok(None),
        }
    }
}

/// Plays the pictures of a folder or a clip. A picture that cannot be read is skipped, logged and counted.
#[derive(Debug)]
pub struct Playback {
    path: PathBuf,
    pictures: PictureReader,
    /// The picture at rest that lies with them.
    rest: Option<PathBuf>,
    counts: Counts,
}

impl Playback {
    /// The pictures of the folder `path`, or of its folder `frames` (of the second fingertip `frames_1`) where there is one,
    /// as `gripline simulate --out` makes them.
    ///
    /// # Errors
    /// [`CaptureError`] when there is no picture.
    pub fn folder(path: &Path, fingertip: usize) -> Result<Self, CaptureError> {
        let frames = path.join(if fingertip == 0 { "frames" } else { "frames_1" });
        let folder = if frames.is_dir() { frames } else { path.to_owned() };
        let rest = find_rest(&[&folder, &folder.join("..")], &folder);
        let mut files = picture::list(&folder)?;
        files.retain(|file| Some(file) != rest.as_ref());
        let pictures = PictureReader {
            path: folder.clone(),
            kind: Kind::Files(files.into_iter()),
            small: false,
            number: 0,
        };
        Ok(Self::new(folder, pictures, rest))
    }

    /// The pictures of a clip.
    ///
    /// # Errors
    /// [`CaptureError`] when ffmpeg is missing or the clip cannot be read.
    pub fn clip(path: &Path) -> Result<Self, CaptureError> {
        let rest = find_rest(&[path.parent().unwrap_or(Path::new(""))], path);
        let pictures = PictureReader {
            path: path.to_owned(),
            kind: Kind::Clip(ClipReader::open(path)?),
            small: false,
            number: 0,
        };
        Ok(Self::new(path.to_owned(), pictures, rest))
    }

    fn new(path: PathBuf, pictures: PictureReader, rest: Option<PathBuf>) -> Self {
        Self {
            path,
            pictures,
            rest,
            counts: Counts::default(),
        }
    }

    /// Frames a second of a clip.
    #[must_use]
    pub const fn rate(&self) -> Option<f64> {
        match &self.pictures.kind {
            Kind::Clip(clip) => Some(clip.rate()),
            Kind::Files(_) | Kind::Finished => None,
        }
    }

    /// The picture of the untouched fingertip that lies with the others.
    ///
    /// # Errors
    /// [`CaptureError`] when there is none, or it cannot be read.
    pub fn rest(&self) -> Result<Vec<u8>, CaptureError> {
        match &self.rest {
            Some(file) => picture::crop(file, false),
            None => Err(CaptureError::NoRest {
                path: self.path.clone(),
            }),
        }
    }

    /// The next picture that can be read, and how long that took, µs.
    pub fn next_picture(&mut self) -> Option<(Vec<u8>, f64)> {
        loop {
            let started = Instant::now();
            match self.pictures.next_picture() {
                Ok(None) => return None,
                Ok(Some((_, crop))) => {
                    self.counts.received += 1;
                    return Some((crop, started.elapsed().as_secs_f64() * 1e6));
                }
                Err(error) => {
                    warn!("{error}");
                    let damaged = damaged_by(&error);
                    self.counts.received += damaged;
                    self.counts.damaged += damaged;
                }
            }
        }
    }

    /// What became of the pictures so far.
    #[must_use]
    pub const fn counts(&self) -> Counts {
        self.counts
    }
}

/// Plays the pictures of a described sensor in colour: of a clip, a folder or a file. One that cannot be read is skipped, logged and
/// counted.
#[derive(Debug)]
pub struct ColourPlayback {
    path: PathBuf,
    capture: Capture,
    /// Files that are not opened yet.
    files: std::vec::IntoIter<PathBuf>,
    clip: Option<ColourClip>,
    /// The picture at rest that lies with them.
    rest: Option<PathBuf>,
    rate: f64,
    counts: Counts,
}

impl ColourPlayback {
    /// The pictures of a clip, of a file, or of a folder (of its folder `frames`, of the second fingertip `frames_1`, where there is one)
    /// as the sensor's description says.
    ///
    /// # Errors
    /// [`CaptureError`] when there is no picture, the first cannot be read, or ffmpeg is missing.
    pub fn open(path: &Path, capture: &Capture, fingertip: usize) -> Result<Self, CaptureError> {
        let (folder, rest, files) = if path.is_dir() {
            let frames = path.join(if fingertip == 0 { "frames" } else { "frames_1" });
            let folder = if frames.is_dir() { frames } else { path.to_owned() };
            let rest = find_rest(&[&folder, &folder.join("..")], &folder);
            let mut files = picture::list(&folder)?;
            if files.len() > 1 {
                files.retain(|file| Some(file) != rest.as_ref());
            }
            (folder, rest, files)
        } else {
            let rest = find_rest(&[path.parent().unwrap_or(Path::new(""))], path);
            (path.to_owned(), rest, vec![path.to_owned()])
        };
        let mut files = files.into_iter();
        let clip = files
            .next()
            .map(|file| ColourClip::open(&file, capture))
            .transpose()?;
        let rate = match &clip {
            Some(clip) if !path.is_dir() && !picture::is_picture(path) => clip.rate(),
            _ => capture.rate_hz,
        };
        Ok(Self {
            path: folder,
            capture: *capture,
            files,
            clip,
            rest,
            rate,
            counts: Counts::default(),
        })
    }

    /// Where they come from.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Pictures a second: the clip's, else the sensor's.
    #[must_use]
    pub const fn rate(&self) -> f64 {
        self.rate
    }

    /// Columns and rows of the next pictures before they are scaled; `None` at the end.
    #[must_use]
    pub fn size_px(&self) -> Option<[usize; 2]> {
        let size = self.clip.as_ref()?.size();
        Some([size.width, size.height])
    }

    /// The picture of the untouched fingertip that lies with them.
    #[must_use]
    pub fn rest(&self) -> Option<&Path> {
        self.rest.as_deref()
    }

    /// Number of pictures that are left in a folder; `None` of a clip, whose length shows at its end.
    #[must_use]
    pub fn left(&self) -> Option<usize> {
        self.path
            .is_dir()
            .then(|| usize::from(self.clip.is_some()) + self.files.len())
    }

    /// Passes over a picture, without reading it where it is a file of a folder. `false` at the end.
    pub fn pass(&mut self) -> bool {
        if self.path.is_dir() {
            return self.clip.take().is_some() || self.files.next().is_some();
        }
        self.next_picture().is_some()
    }

    /// The next picture that can be read (red, green, blue of the sensor's crop), and how long that took, µs.
    pub fn next_picture(&mut self) -> Option<(Vec<u8>, f64)> {
        let started = Instant::now();
        loop {
            if let Some(picture) = self.clip.as_mut().and_then(ColourClip::next_picture) {
                self.counts.received += 1;
                return Some((picture, started.elapsed().as_secs_f64() * 1e6));
            }
            if let Some(Err(error)) = self.clip.take().map(|mut clip| clip.finish()) {
                self.note(&error);
            }
            let file = self.files.next()?;
            match ColourClip::open(&file, &self.capture) {
                Ok(clip) => self.clip = Some(clip),
                Err(error) => self.note(&error),
            }
        }
    }

    fn note(&mut self, error: &CaptureError) {
        warn!("{error}");
        let damaged = damaged_by(error);
        self.counts.received += damaged;
        self.counts.damaged += damaged;
    }

    /// What became of the pictures so far.
    #[must_use]
    pub const fn counts(&self) -> Counts {
        self.counts
    }
}

/// Pictures that are missing for an error.
const fn damaged_by(error: &CaptureError) -> u64 {
    match error {
        CaptureError::ClipDamaged {
            found,
            expected: Some(expected),
            ..
        } => *expected - *found,
        _ => 1,
    }
}

/// The picture at rest that lies in one of the folders; what is named as of the second fingertip has its own.
fn find_rest(folders: &[&Path], of: &Path) -> Option<PathBuf> {
    let is_second = of
        .file_stem()
        .is_some_and(|name| name.to_string_lossy().ends_with("_1"));
    let second = SECOND_REST.iter().filter(|_| is_second);
    let places = second
        .chain(&REST)
        .flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
    places.into_iter().find(|rest| rest.is_file())
}
