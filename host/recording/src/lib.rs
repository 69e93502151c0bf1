//! Recordings of runs: MCAP files with Foxglove's messages, written in parallel to the control loop, read back by `replay` and
//! `export`; and files of force maps (npy).
//!
//! Topics: `/rest` and `/picture` (foxglove.RawImage), `/force_map` (foxglove.Grid, newtons per taxel), `/status` (JSON: the
//! frame's report and the device's status in the wire's units), `/events` (foxglove.Log). The metadata of `/status` apply to the
//! whole recording. Topics of the second fingertip begin with `/second`.
#![forbid(unsafe_code)]

mod channels;
pub mod error;
mod event;
mod export;
mod force_map;
mod image;
pub mod maps_file;
mod metadata;
mod reader;
mod recorder;
pub mod ros2;
mod status;
pub mod telemetry;
mod topics;
pub mod units;
mod wrench;
mod writer;

pub use self::channels::{Channel, Channels, Message};
pub use self::export::{Exported, copy_whole, export_arrays};
pub use self::image::{CROP_SIDE, IMAGE_SIDE, Image, Pictures};
pub use self::metadata::{CalibratedView, FingertipCalibration, Metadata};
pub use self::reader::{Completeness, Reader, RecordedFrame};
pub use self::recorder::{Pace, Recorder, RecordingSummary};
pub use self::status::{Frame, RecordedStatus, RecordedTruth};
pub use self::wrench::{Forces, WrenchLog, force_log};
