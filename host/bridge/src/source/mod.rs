//! Sources of pictures: the simulated fingertip in a simulated gripper, which also knows the truth; a camera; or earlier pictures.
//! Frames are 440×440 grey crops, or the colour crops of a sensor with printed markers.

mod recorded;

use std::cell::RefCell;
use std::fmt;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::str::FromStr;
use std::time::{Duration, Instant};

use gripline_protocol::SENSORS;
use gripline_protocol::message::GripMode;
use gripline_simulation::{GripScene, SimulationError};

use self::recorded::{RecordedFrames, RecordedPicture};
use crate::error::Error;
#[cfg(target_os = "linux")]
use crate::realtime;
#[cfg(not(target_os = "linux"))]
use gripline_capture::CaptureError;
use gripline_capture::{Camera, ColourPlayback, Counts, DEFAULT_RATE, PixelFormat, Playback};
#[cfg(target_os = "linux")]
use gripline_capture::{CameraSettings, RequestedMode};
use gripline_recording::telemetry::Truth;

/// Which source: the value of `camera.source`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Source {
    /// The scripted scene of the simulated world.
    #[default]
    Simulated,
    /// A camera: a Video4Linux device.
    Camera(PathBuf),
    /// The pictures of a folder.
    Folder(PathBuf),
    /// The pictures of a clip, in any format that ffmpeg reads.
    Clip(PathBuf),
    /// The pictures of a recording.
    Recording(PathBuf),
}

impl FromStr for Source {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let path = |path: &str| Some(PathBuf::from(path)).filter(|path| !path.as_os_str().is_empty());
        let read = match text.split_once(':') {
            None if text == "sim" => Some(Self::Simulated),
            _ if text.starts_with("/dev/") => path(text).map(Self::Camera),
            Some(("v4l2", device)) => path(device).map(Self::Camera),
            Some(("dir", folder)) => path(folder).map(Self::Folder),
            Some(("file", clip)) => path(clip).map(Self::Clip),
            Some(("mcap", recording)) => path(recording).map(Self::Recording),
            _ => None,
        };
        read.ok_or_else(|| {
            format!(
                "found {text}, expected sim, /dev/videoN (or v4l2:DEVICE), dir:FOLDER, file:CLIP or mcap:RECORDING"
            )
        })
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Simulated => f.write_str("sim"),
            Self::Camera(device) => write!(f, "v4l2:{}", device.display()),
            Self::Folder(folder) => write!(f, "dir:{}", folder.display()),
            Self::Clip(clip) => write!(f, "file:{}", clip.display()),
            Self::Recording(recording) => write!(f, "mcap:{}", recording.display()),
        }
    }
}

/// The settings of a source.
#[derive(Debug, Clone, Default)]
pub struct SourceSettings {
    /// The camera's pixel format; `None`: the one with the least decoding time at the wanted rate.
    pub format: Option<PixelFormat>,
    /// Frames a second; `None`: 60, or those of the recording.
    pub frames_per_second: Option<f64>,
    /// Exposure time of the camera.
    pub exposure_ms: Option<f64>,
    /// Gain of the camera, in its own units.
    pub gain: Option<i64>,
    /// Seed of the simulated world.
    pub seed: u64,
    /// Which fingertip, from 0, if the source has both: the simulated world, a recording.
    pub fingertip: usize,
    /// The format of pictures of printed markers; `None`: grey ones of particles.
    pub colour: Option<gripline_sensor::Capture>,
    /// Whether a camera's thread requests real-time priority.
    pub realtime: bool,
}

/// A picture and what is known about it.
#[derive(Debug)]
pub struct Picture {
    /// The sensor's crop, row-major: 440×440 grey levels of particles; red, green, blue of printed markers.
    pub crop: Vec<u8>,
    /// When its bytes arrived.
    pub came: Instant,
    /// When it was taken: a camera's by the driver's time stamp, others when they were requested.
    pub taken: Instant,
    /// Time to make the crop, µs.
    pub decode_us: f64,
    /// The simulated world's truth.
    pub truth: Option<Truth>,
    /// The requested mode of the gripper.
    pub requested_mode: Option<GripMode>,
}

/// The result of polling a source.
#[derive(Debug)]
pub(crate) enum Taken {
    /// A picture.
    Picture(Picture),
    /// None yet; others may work now.
    NotYet,
    /// There are no more.
    End,
}

/// An open source of pictures.
pub(crate) enum Frames {
    Simulated(SimulatedSource),
    Camera(Camera),
    Files(Box<Playback>),
    Colour(Box<ColourPlayback>),
    Recording(Box<RecordedFrames>),
}

/// A source that was opened.
pub(crate) struct Opened {
    pub pictures: Frames,
    /// Frames a second.
    pub frames_per_second: f64,
    /// What it is, for people.
    pub description: String,
}

/// The untouched fingertip, in the order of capture.
#[derive(Debug)]
pub(crate) struct AtRest {
    /// 440×440 grey levels each.
    pub crops: Vec<Vec<u8>>,
    /// When each of them came, s.
    pub at_s: Vec<f64>,
}

impl Source {
    /// Opens the source.
    ///
    /// # Errors
    /// [`Error`] that says what was found and what to do.
    pub(crate) fn open(&self, wanted: &SourceSettings) -> Result<Opened, Error> {
        let rate = wanted.frames_per_second.unwrap_or(DEFAULT_RATE);
        if let Some(capture) = &wanted.colour {
            return self.open_colour(wanted, capture);
        }
        let (pictures, frames_per_second, description) = match self {
            Self::Simulated => (
                Frames::Simulated(SimulatedSource::of(wanted.fingertip, wanted.seed, rate)),
                rate,
                "the simulated fingertip".to_owned(),
            ),
            Self::Camera(device) => {
                let camera = open_camera(device, wanted, rate)?;
                let (rate, description) = (camera.rate(), camera.description().to_owned());
                (Frames::Camera(camera), rate, description)
            }
            Self::Folder(folder) => (
                Frames::Files(Box::new(Playback::folder(folder, wanted.fingertip)?)),
                rate,
                format!("pictures of {}", folder.display()),
            ),
            Self::Clip(file) => {
                let frames = Playback::clip(file)?;
                let rate = wanted.frames_per_second.or(frames.rate()).unwrap_or(DEFAULT_RATE);
                let description = format!("pictures of {}, {rate:.1} a second", file.display());
                (Frames::Files(Box::new(frames)), rate, description)
            }
            Self::Recording(file) => {
                let frames = RecordedFrames::open(file, wanted.fingertip)?;
                let rate = wanted.frames_per_second.or(frames.rate()).unwrap_or(DEFAULT_RATE);
                let description = format!("pictures of {}", file.display());
                (Frames::Recording(Box::new(frames)), rate, description)
            }
        };
        Ok(Opened {
            pictures,
            frames_per_second,
            description,
        })
    }

    /// The same in colour.
    fn open_colour(
        &self,
        wanted: &SourceSettings,
        capture: &gripline_sensor::Capture,
    ) -> Result<Opened, Error> {
        let (pictures, rate, description) = match self {
            Self::Folder(path) | Self::Clip(path) => {
                let frames = ColourPlayback::open(path, capture, wanted.fingertip)?;
                let (rate, description) = (frames.rate(), format!("pictures of {}", frames.path().display()));
                (Frames::Colour(Box::new(frames)), rate, description)
            }
            Self::Recording(file) => {
                let frames = RecordedFrames::open(file, wanted.fingertip)?;
                let rate = frames.rate().unwrap_or(capture.rate_hz);
                (
                    Frames::Recording(Box::new(frames)),
                    rate,
                    format!("pictures of {}", file.display()),
                )
            }
            Self::Camera(device) => {
                let rate = wanted.frames_per_second.unwrap_or(capture.rate_hz);
                let camera = open_camera(device, wanted, rate)?;
                let (rate, description) = (camera.rate(), camera.description().to_owned());
                (Frames::Camera(camera), rate, description)
            }
            Self::Simulated => {
                return Err(Error::usage(format!(
                    "camera.source (--source): found {self} with a sensor that has printed markers, expected a camera, file:CLIP, \
                     dir:FOLDER or mcap:RECORDING: there is no simulated gripper with this gel"
                )));
            }
        };
        Ok(Opened {
            pictures,
            frames_per_second: wanted.frames_per_second.unwrap_or(rate),
            description,
        })
    }
}

/// Opens the sources of two fingertips of one gripper: two cameras, files of both, or the simulated world, whose fingertips see it
/// in turn.
///
/// # Errors
/// [`Error`] of kind usage when they are of different kinds, else as [`Source::open`].
pub(crate) fn open_both(
    sources: [&Source; SENSORS],
    wanted: &SourceSettings,
) -> Result<[Opened; SENSORS], Error> {
    let kind = |source: &Source| match source {
        Source::Simulated => "the simulated world",
        Source::Camera(_) => "a camera",
        Source::Folder(_) | Source::Clip(_) | Source::Recording(_) => "files",
    };
    let [first, second] = sources;
    if kind(first) != kind(second) {
        return Err(Error::usage(format!(
            "camera.second_source (--second-source): found {second} beside camera.source {first}, expected {} for both \
             fingertips: they share one clock",
            kind(first)
        )));
    }
    if let Source::Simulated = first {
        let rate = wanted.frames_per_second.unwrap_or(DEFAULT_RATE);
        return Ok(SimulatedSource::pair(wanted.seed, rate).map(|source| Opened {
            pictures: Frames::Simulated(source),
            frames_per_second: rate,
            description: "the simulated fingertips".to_owned(),
        }));
    }
    let open = |source: &Source, fingertip| {
        source.open(&SourceSettings {
            fingertip,
            ..wanted.clone()
        })
    };
    Ok([open(first, 0)?, open(second, 1)?])
}

impl Opened {
    /// Takes `count` pictures of the untouched fingertip; files return what they have.
    ///
    /// # Errors
    /// [`Error`] when the camera sends no good picture, or no file shows the fingertip at rest.
    pub(crate) fn rest(&mut self, count: usize) -> Result<AtRest, Error> {
        let crops = match &mut self.pictures {
            Frames::Simulated(source) => source.rest(count),
            Frames::Camera(camera) => {
                let frames = camera.take_frames(count)?;
                let first = frames.first().map(|frame| frame.received_at);
                let since = |at: Instant| first.map_or(0.0, |first| (at - first).as_secs_f64());
                return Ok(AtRest {
                    at_s: frames.iter().map(|frame| since(frame.received_at)).collect(),
                    crops: frames.into_iter().map(|frame| frame.crop).collect(),
                });
            }
            Frames::Files(frames) => vec![frames.rest()?],
            // Printed markers have a rest of their own (`marker_rest`).
            Frames::Colour(_) => Vec::new(),
            Frames::Recording(frames) => frames.rest().to_vec(),
        };
        let at_s = (0..crops.len()).map(|number| number as f64 / self.frames_per_second);
        Ok(AtRest {
            at_s: at_s.collect(),
            crops,
        })
    }
}

#[cfg(target_os = "linux")]
fn open_camera(device: &Path, wanted: &SourceSettings, rate: f64) -> Result<Camera, Error> {
    let settings = CameraSettings {
        mode: RequestedMode {
            format: wanted.format,
            rate,
            colour: None,
        },
        exposure_ms: wanted.exposure_ms,
        gain: wanted.gain,
        colour: wanted.colour,
    };
    let port = gripline_capture::v4l2::DevicePort(device.to_owned());
    let realtime = wanted.realtime;
    let begin = move || {
        if let Some(lack) = realtime.then(realtime::enter_capture).flatten() {
            tracing::warn!("{lack}");
        }
    };
    Ok(Camera::start_with(port, settings, begin)?)
}

#[cfg(not(target_os = "linux"))]
fn open_camera(device: &Path, _: &SourceSettings, _: f64) -> Result<Camera, Error> {
    Err(CaptureError::NoVideo4Linux {
        camera: device.display().to_string(),
    }
    .into())
}

impl Frames {
    /// Whether it delivers in real time and must be polled.
    pub(crate) const fn is_live(&self) -> bool {
        matches!(self, Self::Camera(_))
    }

    /// Whether it is the simulated world, which reacts to the gripper and never ends.
    pub(crate) const fn is_simulated(&self) -> bool {
        matches!(self, Self::Simulated(_))
    }

    /// The next picture, with the gripper at this grip-force line. Waits for a camera at most this long.
    ///
    /// # Errors
    /// [`Error`] when there can be no more.
    pub(crate) fn next(&mut self, line_n: f64, patience: Duration) -> Result<Taken, Error> {
        let taken = |crop, [came, taken]: [Instant; 2], decode_us, requested_mode| {
            Taken::Picture(Picture {
                crop,
                came,
                taken,
                decode_us,
                truth: None,
                requested_mode,
            })
        };
        Ok(match self {
            Self::Simulated(source) => Taken::Picture(source.next(line_n)?),
            Self::Camera(camera) => camera.next(patience)?.map_or(Taken::NotYet, |frame| {
                let times = [frame.received_at, frame.taken_at];
                taken(frame.crop, times, frame.decode_us, None)
            }),
            Self::Files(frames) => {
                let came = Instant::now();
                frames.next_picture().map_or(Taken::End, |(crop, decode_us)| {
                    taken(crop, [came; 2], decode_us, None)
                })
            }
            Self::Colour(frames) => {
                let came = Instant::now();
                frames.next_picture().map_or(Taken::End, |(crop, decode_us)| {
                    taken(crop, [came; 2], decode_us, None)
                })
            }
            Self::Recording(frames) => match frames.next()? {
                Some(RecordedPicture { crop, requested_mode }) => {
                    taken(crop, [Instant::now(); 2], 0.0, requested_mode)
                }
                None => Taken::End,
            },
        })
    }

    /// Counts of the pictures so far; `None` if none can be lost.
    pub(crate) fn counts(&self) -> Option<Counts> {
        match self {
            Self::Simulated(_) => None,
            Self::Camera(camera) => Some(camera.counts()),
            Self::Files(frames) => Some(frames.counts()),
            Self::Colour(frames) => Some(frames.counts()),
            Self::Recording(frames) => Some(frames.counts()),
        }
    }
}

/// A simulated fingertip of a simulated gripper.
#[derive(Debug)]
pub struct SimulatedSource {
    /// The world, which two fingertips share.
    scene: Rc<RefCell<GripScene>>,
    finger: usize,
    /// Time from a picture of either fingertip to the next one.
    step_s: f64,
}

impl SimulatedSource {
    /// A scene whose gel, particles and noise follow from `seed`, at this frame rate.
    #[must_use]
    pub fn new(seed: u64, frames_per_second: f64) -> Self {
        Self::of(0, seed, frames_per_second)
    }

    /// The same seen by fingertip `finger`, 0 or 1, alone.
    #[must_use]
    pub fn of(finger: usize, seed: u64, frames_per_second: f64) -> Self {
        Self {
            scene: Rc::new(RefCell::new(GripScene::new(seed))),
            finger,
            step_s: 1.0 / frames_per_second,
        }
    }

    /// Both fingertips of one gripper, each at this frame rate. They alternate, half a frame apart, beginning with the first.
    #[must_use]
    pub fn pair(seed: u64, frames_per_second: f64) -> [Self; SENSORS] {
        let scene = Rc::new(RefCell::new(GripScene::new(seed)));
        [0, 1].map(|finger| Self {
            scene: Rc::clone(&scene),
            finger,
            step_s: 0.5 / frames_per_second,
        })
    }

    /// Frames at rest, each with its own noise.
    pub fn rest(&mut self, count: usize) -> Vec<Vec<u8>> {
        let mut scene = self.scene.borrow_mut();
        (0..count)
            .map(|_| scene.rest_image_of(self.finger).pixels)
            .collect()
    }

    /// The next picture, with the gripper at this grip-force line.
    ///
    /// # Errors
    /// [`SimulationError`] when the line is not a force.
    pub fn next(&mut self, line_n: f64) -> Result<Picture, SimulationError> {
        let mut scene = self.scene.borrow_mut();
        let frame = scene.step_seen_by(self.finger, self.step_s, line_n)?;
        let [pull_x, pull_y] = frame.load.shear_n;
        let now = Instant::now();
        Ok(Picture {
            crop: frame.image.pixels,
            came: now,
            taken: now,
            decode_us: 0.0,
            truth: Some(Truth {
                phase: frame.phase.into(),
                normal_n: if frame.touching { frame.load.normal_n } else { 0.0 },
                shear_n: pull_x.hypot(pull_y),
                stick_ratio: frame.true_stick_ratio,
                gross_slip: frame.gross_slip,
                slip_mm: frame.slip_mm,
            }),
            requested_mode: Some(if frame.phase == "release" {
                GripMode::Released
            } else {
                GripMode::Hold
            }),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_source_is_read_as_it_is_written() {
        for text in [
            "sim",
            "v4l2:/dev/video0",
            "dir:frames",
            "dir:a:b",
            "file:clip.avi",
            "mcap:run.mcap",
        ] {
            assert_eq!(text.parse::<Source>().unwrap().to_string(), text);
        }
        assert_eq!("/dev/video2".parse(), Ok(Source::Camera("/dev/video2".into())));
        for text in ["", "dir:", "v4l2:", "mcap", "video0", "clip.gif"] {
            assert!(
                text.parse::<Source>()
                    .unwrap_err()
                    .contains("expected sim, /dev/videoN"),
                "{text}"
            );
        }
    }
}
