//! Why pictures cannot be had: each error names the device or file, what was found, what was expected and what to do.

use std::io;
use std::path::PathBuf;

/// Why one picture cannot be used. Decoders do not know its name; [`CaptureError::Picture`] adds it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("found {found}, expected {expected}")]
pub struct PictureError {
    /// What it is.
    pub found: String,
    /// What it has to be.
    pub expected: String,
}

/// Why pictures cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// No such camera.
    #[error(
        "camera {camera}: not found; expected a video device such as /dev/video0: plug it in, or choose one of {present}"
    )]
    Missing {
        /// Path of the device.
        camera: String,
        /// Video devices that are present.
        present: String,
    },
    /// Not allowed.
    #[error(
        "camera {camera}: permission denied; expected to be allowed to read and write it: add the user to the group video, \
         or install the udev rule, and log in again"
    )]
    Permission {
        /// Path of the device.
        camera: String,
    },
    /// Another program uses it.
    #[error(
        "camera {camera}: busy; expected a camera that no other program has open: close the other program"
    )]
    Busy {
        /// Path of the device.
        camera: String,
    },
    /// The device is something else.
    #[error("camera {camera}: found {found}, expected a camera that streams pictures; choose another device")]
    NoCamera {
        /// Path of the device.
        camera: String,
        /// What it is.
        found: String,
    },
    /// No format of the camera can be used.
    #[error(
        "camera {camera}: no usable format: found {found}; expected {expected}: use another camera or another \
         camera.format"
    )]
    NoFormat {
        /// Path of the device.
        camera: String,
        /// The formats and sizes that can be used.
        expected: String,
        /// What it offers.
        found: String,
    },
    /// The driver set another mode than the camera offers.
    #[error("camera {camera}: found {found}, expected {expected}; unplug it and plug it in again")]
    Negotiation {
        /// Path of the device.
        camera: String,
        /// What the driver set.
        found: String,
        /// What was requested.
        expected: String,
    },
    /// The driver granted too few buffers.
    #[error(
        "camera {camera}: found {found} buffer for pictures, expected at least {expected}, one to read while one is filled: \
         close other programs that use it, or use another camera"
    )]
    Buffers {
        /// Path of the device.
        camera: String,
        /// Buffers that the driver granted.
        found: usize,
        /// Buffers that are needed.
        expected: usize,
    },
    /// The camera's thread ended by a defect.
    #[error(
        "{camera}: its thread panicked ({said}); expected it to deliver pictures until the end: start again and report this \
         defect"
    )]
    ThreadPanicked {
        /// The camera and its mode.
        camera: String,
        /// What the panic said.
        said: String,
    },
    /// The camera lacks a control that the configuration sets.
    #[error(
        "camera {camera}: has no control for {control}, expected one because {key} is set: take {key} out of the \
         configuration, or use a camera that has it"
    )]
    NoControl {
        /// Path of the device.
        camera: String,
        /// What is to be controlled.
        control: &'static str,
        /// Configuration key.
        key: &'static str,
    },
    /// A control does not accept the value.
    #[error("camera {camera}: {key}: found {found}, the camera takes {taken}; choose a value that it has")]
    Control {
        /// Path of the device.
        camera: String,
        /// Configuration key.
        key: &'static str,
        /// The requested value.
        found: String,
        /// What the camera did with it.
        taken: String,
    },
    /// The camera went away.
    #[error("camera {camera}: gone ({found}); expected it to stay connected, check cable and power")]
    Gone {
        /// Path of the device.
        camera: String,
        /// What the system said.
        found: String,
    },
    /// The camera is open and sends too few good pictures.
    #[error(
        "{camera}: found {found} good pictures in {seconds} s ({damaged} damaged), expected {expected} of the untouched \
         fingertip; {advice}"
    )]
    NoPictures {
        /// The camera and its mode.
        camera: String,
        /// Good pictures.
        found: usize,
        /// Seconds that they took.
        seconds: u64,
        /// Damaged pictures.
        damaged: u64,
        /// Pictures that were wanted.
        expected: usize,
        /// The last thing that went wrong, or what to check.
        advice: String,
    },
    /// This system has no Video4Linux.
    #[error(
        "camera {camera}: found another system than Linux, expected Video4Linux: use sim, dir:, file: or mcap:"
    )]
    NoVideo4Linux {
        /// Path of the device.
        camera: String,
    },
    /// A file or folder cannot be read or written.
    #[error("{}: {source}, expected {expected}; check the path", path.display())]
    File {
        /// Path of the file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
        /// What it has to be.
        expected: &'static str,
    },
    /// A folder holds no pictures.
    #[error("{}: found no *.png and no *.jpg, expected a folder of pictures", path.display())]
    NoPictureFiles {
        /// Path of the folder.
        path: PathBuf,
    },
    /// No picture of the untouched fingertip lies with the others.
    #[error(
        "{}: found no rest.png in it or beside it, expected a picture of the untouched fingertip: put one there, or take the \
         ones of `gripline calibrate rest` (calibration.file)",
        path.display()
    )]
    NoRest {
        /// Path of the folder or clip.
        path: PathBuf,
    },
    /// A picture cannot be used.
    #[error("{picture}: {source}")]
    Picture {
        /// The file, or the clip.
        picture: String,
        /// What is wrong with it.
        source: PictureError,
    },
    /// The program that reads and writes clips is missing.
    #[error(
        "{program}: found no such program on the search path, expected it to read and write clips: install it (Debian and \
         Ubuntu: apt-get install ffmpeg)"
    )]
    NoFfmpeg {
        /// ffmpeg or ffprobe.
        program: &'static str,
    },
    /// ffmpeg cannot read or write the clip.
    #[error("{}: {program} says {said:?}, expected {expected}", clip.display())]
    Clip {
        /// Path of the clip.
        clip: PathBuf,
        /// ffmpeg or ffprobe.
        program: &'static str,
        /// Its last line.
        said: String,
        /// What should have been.
        expected: &'static str,
    },
    /// Pictures of the clip are missing or damaged.
    #[error("{}: damaged or cut short: found {found} pictures{}; ffmpeg says {said:?}", clip.display(), of(*expected))]
    ClipDamaged {
        /// Path of the clip.
        clip: PathBuf,
        /// Good pictures.
        found: u64,
        /// Pictures that the file announces; `None` when it does not say.
        expected: Option<u64>,
        /// The last line of ffmpeg.
        said: String,
    },
}

fn of(expected: Option<u64>) -> String {
    expected.map_or(String::new(), |expected| format!(", expected {expected}"))
}
