//! Pictures from the world: a camera (Video4Linux), or files that stand in for one: a folder of pictures or a clip.
//!
//! Every picture becomes the same 440×440 crop of 8-bit grey levels ([`geometry`]), or the colour crop of a described sensor with printed
//! markers ([`colour`], [`clip::ColourClip`]). [`camera`] keeps a camera open and its
//! newest picture in a mailbox of one; [`playback`] reads files one after the other. Only `v4l2`, `picture` and `clip` touch the
//! world.
#![forbid(unsafe_code)]

pub mod camera;
pub mod clip;
pub mod colour;
mod constants;
pub mod convert;
pub mod driver;
mod error;
pub mod geometry;
pub mod jpeg;
pub mod mailbox;
pub mod mode;
pub mod negotiate;
pub mod picture;
pub mod playback;
mod sequence;
#[cfg(target_os = "linux")]
pub mod v4l2;

pub use self::camera::{Camera, Counts};
pub use self::constants::{DEFAULT_RATE, POLL};
pub use self::error::{CaptureError, PictureError};
pub use self::jpeg::JpegCrop;
pub use self::mode::{PixelFormat, RequestedMode};
pub use self::negotiate::CameraSettings;
pub use self::playback::{ColourPlayback, Playback};
