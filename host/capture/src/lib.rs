//! Pictures from the world: a camera (Video4Linux), or what stands in for one: a folder of pictures, a clip, a recording.
//!
//! Pure parts, each with its tests: which mode of a camera is used (`format`, `negotiate`), from its bytes to the crop
//! (`convert`, of a JPEG `jpeg`), what its sequence numbers say (`sequence`), the file of a clip (`avi`). `camera` keeps a camera open and its newest picture in a
//! mailbox of one; only `device` and `picture` touch the world. What a run makes of them is the source's matter.
#![forbid(unsafe_code)]

pub mod avi;
pub mod camera;
pub mod constants;
mod convert;
pub mod device;
mod error;
mod files;
mod format;
mod jpeg;
pub mod mailbox;
mod negotiate;
pub mod picture;
mod sequence;
#[cfg(test)]
mod tests;

pub use self::camera::Counts;
pub use self::constants::{POLL, RATE};
pub use self::error::CameraError;
pub use self::files::{ClipFrames, FolderFrames};
pub use self::format::PixelFormat;
pub use self::format::Wanted;
pub use self::jpeg::JpegCrop;
pub use self::negotiate::CameraSettings;
