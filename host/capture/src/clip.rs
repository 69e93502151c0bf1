//! Clips through the program ffmpeg, in any format that it knows: one picture at a time, never the whole clip in memory.
//! Touches the world. Limits: 640×480 or 440×440 pixels in grey, any size in colour; pictures follow each other at the clip's mean rate.

use std::fs;
use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::thread::{self, JoinHandle};

use gripline_sensor::Flip;

use crate::error::{CaptureError, PictureError};
use crate::geometry::{Cropping, Size};
use crate::picture;

const FFMPEG: &str = "ffmpeg";
const FFPROBE: &str = "ffprobe";

/// A started program that is killed when it is dropped.
#[derive(Debug)]
struct Running {
    child: Child,
    /// Reads standard error to its end; gives its last line.
    errors: Option<JoinHandle<String>>,
}

impl Running {
    fn start(command: &mut Command) -> Result<Self, CaptureError> {
        let mut child = command.stderr(Stdio::piped()).spawn().map_err(not_started)?;
        let errors = child.stderr.take().map(|stderr| {
            // A pipe that nobody reads would stop the program.
            thread::spawn(move || last_line(BufReader::new(stderr).split(b'\n').map_while(Result::ok)))
        });
        Ok(Self { child, errors })
    }

    /// Waits for the end; returns whether it went well, and the last line that the program printed.
    fn finish(&mut self) -> (bool, String) {
        let succeeded = self.child.wait().is_ok_and(|status| status.success());
        let said = self.errors.take().and_then(|errors| errors.join().ok());
        (succeeded, said.unwrap_or_default())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // Fails where it has ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn not_started(_: io::Error) -> CaptureError {
    CaptureError::NoFfmpeg { program: FFMPEG }
}

/// The last line that is not empty, without ffmpeg's name of the part that printed it.
fn last_line(lines: impl Iterator<Item = Vec<u8>>) -> String {
    let mut last = String::new();
    for line in lines {
        let line = String::from_utf8_lossy(&line);
        let line = line.trim();
        if !line.is_empty() && !line.starts_with("Last message repeated") {
            line.clone_into(&mut last);
        }
    }
    match last.split_once("] ") {
        Some((part, said)) if part.starts_with('[') => said.to_owned(),
        _ => last,
    }
}

/// The version of ffmpeg, as it names itself.
///
/// # Errors
/// [`CaptureError::NoFfmpeg`] when ffmpeg or ffprobe is missing.
pub fn ffmpeg_version() -> Result<String, CaptureError> {
    let version = |program| {
        let output = Command::new(program)
            .arg("-version")
            .stdin(Stdio::null())
            .output();
        output.map_err(|_| CaptureError::NoFfmpeg { program })
    };
    version(FFPROBE)?;
    let text = String::from_utf8_lossy(&version(FFMPEG)?.stdout).into_owned();
    Ok(text.split_whitespace().take(3).collect::<Vec<_>>().join(" "))
}

/// What ffprobe says of a clip.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Description {
    size: Size,
    rate: f64,
    /// Pictures that the file announces. Only an AVI's number is that of the pictures that are shown.
    pictures: Option<u64>,
}

fn describe(path: &Path) -> Result<Description, CaptureError> {
    // ffprobe's own word on a missing file does not say what to do.
    fs::File::open(path).map_err(|source| CaptureError::File {
        path: path.to_owned(),
        source,
        expected: "a clip that can be read",
    })?;
    let output = Command::new(FFPROBE)
        .args([
            "-v",
            "error",
            "-select_streams",
            "v:0",
            "-of",
            "default=noprint_wrappers=1",
            "-show_entries",
        ])
        .arg("stream=width,height,avg_frame_rate,nb_frames:format=format_name")
        .arg(file_url(path))
        .stdin(Stdio::null())
        .output()
        .map_err(|_| CaptureError::NoFfmpeg { program: FFPROBE })?;
    let text = String::from_utf8_lossy(&output.stdout);
    parse_description(&text).ok_or_else(|| CaptureError::Clip {
        clip: path.to_owned(),
        program: FFPROBE,
        said: last_line(output.stderr.split(|byte| *byte == b'\n').map(<[u8]>::to_vec)),
        expected: "a clip with pictures and a frame rate",
    })
}

fn parse_description(text: &str) -> Option<Description> {
    let value = |key: &str| {
        let mut pairs = text.lines().filter_map(|line| line.split_once('='));
        pairs.find(|(name, _)| *name == key).map(|(_, value)| value)
    };
    let (pictures, seconds) = value("avg_frame_rate")?.split_once('/')?;
    let rate = pictures.parse::<f64>().ok()? / seconds.parse::<f64>().ok()?;
    (0.1..=10_000.0).contains(&rate).then_some(Description {
        size: Size::new(value("width")?.parse().ok()?, value("height")?.parse().ok()?),
        rate,
        pictures: (value("format_name")? == "avi")
            .then(|| value("nb_frames")?.parse().ok())
            .flatten(),
    })
}

/// A path that cannot be taken for an option or another protocol.
fn file_url(path: &Path) -> std::ffi::OsString {
    let mut url = std::ffi::OsString::from("file:");
    url.push(path);
    url
}

/// A clip's pictures as ffmpeg hands them over, one after the other.
#[derive(Debug)]
struct Pictures {
    path: PathBuf,
    running: Running,
    output: ChildStdout,
    /// Pictures that the file announces.
    announced: Option<u64>,
    /// Bytes of one.
    bytes: usize,
    /// The next picture, read ahead.
    next: Option<Vec<u8>>,
    read: u64,
}

impl Pictures {
    /// Starts ffmpeg with `filters` on its pictures, and reads the first, of this many `bytes`.
    fn start(
        path: &Path,
        announced: Option<u64>,
        filters: &[&str],
        format: &str,
        bytes: usize,
    ) -> Result<Self, CaptureError> {
        let mut running = Running::start(
            Command::new(FFMPEG)
                .args(["-v", "error", "-nostdin", "-noautorotate", "-threads", "1"])
                // A damaged picture is left out; by default its holes are filled with guesses.
                .args(["-err_detect", "explode", "-i"])
                .arg(file_url(path))
                // Every picture once, whatever its time.
                .args(["-map", "0:v:0", "-vsync", "passthrough"])
                .args(filters)
                .args(["-f", "rawvideo", "-pix_fmt", format, "-"])
                .stdin(Stdio::null())
                .stdout(Stdio::piped()),
        )?;
        let output = running
            .child
            .stdout
            .take()
            .ok_or(CaptureError::NoFfmpeg { program: FFMPEG })?;
        let mut pictures = Self {
            path: path.to_owned(),
            running,
            output,
            announced,
            bytes,
            next: None,
            read: 0,
        };
        pictures.next = pictures.read_picture();
        if pictures.next.is_none() {
            return Err(CaptureError::Clip {
                clip: path.to_owned(),
                program: FFMPEG,
                said: pictures.running.finish().1,
                expected: "a clip with pictures",
            });
        }
        Ok(pictures)
    }

    fn next_picture(&mut self) -> Option<Vec<u8>> {
        let picture = self.next.take()?;
        self.next = self.read_picture();
        self.read += 1;
        Some(picture)
    }

    fn finish(&mut self) -> Result<(), CaptureError> {
        let (succeeded, said) = self.running.finish();
        let expected = self.announced;
        let is_whole = expected.map_or(succeeded && said.is_empty(), |expected| self.read >= expected);
        if is_whole {
            return Ok(());
        }
        Err(CaptureError::ClipDamaged {
            clip: self.path.clone(),
            found: self.read,
            expected,
            said,
        })
    }

    fn read_picture(&mut self) -> Option<Vec<u8>> {
        let mut picture = vec![0; self.bytes];
        self.output.read_exact(&mut picture).ok().map(|()| picture)
    }
}

/// A clip that is being read.
#[derive(Debug)]
pub struct ClipReader {
    pictures: Pictures,
    rate: f64,
    cropping: Cropping,
}

impl ClipReader {
    /// Opens a clip and reads its first picture.
    ///
    /// # Errors
    /// [`CaptureError`] when ffmpeg is missing or the clip cannot be read.
    pub fn open(path: &Path) -> Result<Self, CaptureError> {
        let description = describe(path)?;
        let cropping = Cropping::of(description.size, false).map_err(|source| CaptureError::Picture {
            picture: path.display().to_string(),
            source: PictureError {
                expected: format!(
                    "{}: convert it, ffmpeg -i IN -vf scale=640:480 OUT",
                    source.expected
                ),
                ..source
            },
        })?;
        let bytes = description.size.pixels();
        Ok(Self {
            pictures: Pictures::start(path, description.pictures, &[], "gray", bytes)?,
            rate: description.rate,
            cropping,
        })
    }

    /// Frames a second.
    #[must_use]
    pub const fn rate(&self) -> f64 {
        self.rate
    }

    /// The 440×440 crop of the next picture; `None` at the end.
    pub fn next_picture(&mut self) -> Option<Vec<u8>> {
        let grey = self.pictures.next_picture()?;
        let mut crop = Vec::new();
        self.cropping.apply(&grey, &mut crop);
        Some(crop)
    }

    /// What is missing, once [`Self::next_picture`] has returned `None`.
    ///
    /// # Errors
    /// [`CaptureError::ClipDamaged`] when ffmpeg left pictures out, or the file ends early.
    pub fn finish(&mut self) -> Result<(), CaptureError> {
        self.pictures.finish()
    }
}

/// A clip, or a single picture, of a described sensor: scaled, cropped and turned as its description says, in colour.
#[derive(Debug)]
pub struct ColourClip {
    pictures: ColourPictures,
    rate: f64,
    size: Size,
}

#[derive(Debug)]
enum ColourPictures {
    Clip(Pictures),
    /// Of a PNG file, until it is taken.
    File(Option<Vec<u8>>),
}

impl ColourClip {
    /// Opens a clip or a picture of any size and reads its first picture. A PNG needs no ffmpeg.
    ///
    /// # Errors
    /// [`CaptureError`] when ffmpeg is missing or the clip cannot be read.
    pub fn open(path: &Path, capture: &gripline_sensor::Capture) -> Result<Self, CaptureError> {
        if picture::is_picture(path)
            && let Some((size, picture)) = picture::colour_png(path, capture)?
        {
            return Ok(Self {
                pictures: ColourPictures::File(Some(picture)),
                rate: capture.rate_hz,
                size,
            });
        }
        let description = describe(path)?;
        let [columns, rows] = capture.size_px;
        let [left, top, width, height] = capture.crop_px;
        let mut filter = format!("scale={columns}:{rows}:flags=area,crop={width}:{height}:{left}:{top}");
        filter += match capture.flip {
            Flip::None => "",
            Flip::Horizontal => ",hflip",
            Flip::Vertical => ",vflip",
            Flip::Both => ",hflip,vflip",
        };
        let bytes = 3 * width * height;
        let pictures = Pictures::start(path, description.pictures, &["-vf", &filter], "rgb24", bytes)?;
        Ok(Self {
            pictures: ColourPictures::Clip(pictures),
            rate: description.rate,
            size: description.size,
        })
    }

    /// Frames a second; of a single picture the sensor's.
    #[must_use]
    pub const fn rate(&self) -> f64 {
        self.rate
    }

    /// Columns and rows of the pictures before they are scaled.
    #[must_use]
    pub const fn size(&self) -> Size {
        self.size
    }

    /// The next picture: red, green, blue of every pixel of the sensor's crop, rows from the top; `None` at the end.
    pub fn next_picture(&mut self) -> Option<Vec<u8>> {
        match &mut self.pictures {
            ColourPictures::Clip(pictures) => pictures.next_picture(),
            ColourPictures::File(picture) => picture.take(),
        }
    }

    /// What is missing, once [`Self::next_picture`] has returned `None`.
    ///
    /// # Errors
    /// [`CaptureError::ClipDamaged`] when ffmpeg left pictures out, or the file ends early.
    pub fn finish(&mut self) -> Result<(), CaptureError> {
        match &mut self.pictures {
            ColourPictures::Clip(pictures) => pictures.finish(),
            ColourPictures::File(_) => Ok(()),
        }
    }
}

/// A clip that is being written: MJPEG in an AVI file.
#[derive(Debug)]
pub struct ClipWriter {
    path: PathBuf,
    partial: PathBuf,
    running: Running,
    pictures: Option<ChildStdin>,
}

impl ClipWriter {
    /// Starts a clip of pictures of `size`, `rate` a second. The file appears when it is finished.
    ///
    /// # Errors
    /// [`CaptureError::NoFfmpeg`].
    pub fn create(path: &Path, size: Size, rate: f64) -> Result<Self, CaptureError> {
        let partial = path.with_added_extension("partial");
        let mut running = Running::start(
            Command::new(FFMPEG)
                .args(["-v", "error", "-f", "rawvideo", "-pix_fmt", "gray", "-video_size"])
                .arg(format!("{}x{}", size.width, size.height))
                .args(["-framerate", &rate.to_string(), "-i", "-"])
                // The best quality, and the same bytes on every machine.
                .args(["-c:v", "mjpeg", "-qmin", "1", "-q:v", "1", "-pix_fmt", "yuvj420p"])
                .args([
                    "-threads",
                    "1",
                    "-fflags",
                    "+bitexact",
                    "-flags:v",
                    "+bitexact",
                    "-f",
                    "avi",
                    "-y",
                ])
                .arg(file_url(&partial))
                .stdin(Stdio::piped())
                .stdout(Stdio::null()),
        )?;
        let pictures = running.child.stdin.take();
        Ok(Self {
            path: path.to_owned(),
            partial,
            running,
            pictures,
        })
    }

    /// Adds a picture of the clip's size.
    ///
    /// # Errors
    /// [`CaptureError::Clip`] when ffmpeg has stopped.
    pub fn push(&mut self, grey: &[u8]) -> Result<(), CaptureError> {
        match self.pictures.as_mut().map(|pictures| pictures.write_all(grey)) {
            Some(Ok(())) => Ok(()),
            _ => Err(self.failed()),
        }
    }

    /// Writes the end of the file, and gives it its name.
    ///
    /// # Errors
    /// [`CaptureError`] when ffmpeg fails or the file cannot be renamed.
    pub fn finish(mut self) -> Result<(), CaptureError> {
        drop(self.pictures.take());
        let (succeeded, said) = self.running.finish();
        if !succeeded {
            return Err(self.error(said));
        }
        fs::rename(&self.partial, &self.path).map_err(|source| CaptureError::File {
            path: self.path.clone(),
            source,
            expected: "a file that can be written",
        })
    }

    fn failed(&mut self) -> CaptureError {
        drop(self.pictures.take());
        let said = self.running.finish().1;
        self.error(said)
    }

    fn error(&self, said: String) -> CaptureError {
        CaptureError::Clip {
            clip: self.path.clone(),
            program: FFMPEG,
            said,
            expected: "a file that can be written, on a disk with room",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_a_fraction_and_only_an_avi_announces_its_pictures() {
        let text = |format: &str, rate: &str| {
            format!("width=640\nheight=480\navg_frame_rate={rate}\nnb_frames=60\nformat_name={format}\n")
        };
        let found = parse_description(&text("avi", "30000/1001")).unwrap();
        assert_eq!((found.size, found.pictures), (Size::new(640, 480), Some(60)));
        assert!((found.rate - 29.97).abs() < 0.001);
        assert_eq!(
            parse_description(&text("mov,mp4", "30/1")).unwrap().pictures,
            None
        );
        for wrong in ["0/0", "30", "1/100", ""] {
            assert_eq!(parse_description(&text("avi", wrong)), None, "{wrong}");
        }
    }
}
