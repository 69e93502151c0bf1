//! Recordings of runs: MCAP files with Foxglove's messages, written beside the loop, read back by `replay` and `export`.
//!
//! Topics: `/rest` and `/picture` (foxglove.RawImage), `/force_map` (foxglove.Grid, newtons per taxel), `/status` (JSON:
//! the frame's report and the microcontroller's status in the wire's units), `/events` (foxglove.Log). What holds for the
//! whole recording is the metadata of the channel `/status`. What the second fingertip saw lies under `/second/picture` and so on.
#![forbid(unsafe_code)]

pub mod error;
mod export;
mod index;
pub mod maps_file;
mod messages;
mod reader;
mod recorder;
mod tape;
pub mod telemetry;
pub mod units;

use std::fmt;
use std::str::FromStr;

pub use self::export::{ExportArgs, run as export};
pub use self::messages::{About, Frame, Image, Stored};
pub use self::reader::{Ending, Reader, RecordedFrame};
pub use self::recorder::{Pace, Recorded, Recorder};

/// Pixels a side of a whole crop.
pub const CROP_SIDE: usize = 440;
/// Pixels a side of the picture that `unet` looks at.
pub const IMAGE_SIDE: usize = 88;

/// What of the pictures is recorded: the value of `record.pictures`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pictures {
    /// The 440×440 crop: 190 kB a picture.
    #[default]
    Full,
    /// The 88×88 image, all that `unet` looks at: 8 kB a picture.
    Small,
    /// None: `replay` then starts from the maps.
    Off,
}

impl Pictures {
    const ALL: [(&'static str, Self); 3] = [("full", Self::Full), ("small", Self::Small), ("off", Self::Off)];
}

impl FromStr for Pictures {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let known = Self::ALL.iter().find(|(name, _)| *name == text);
        known
            .map(|(_, pictures)| *pictures)
            .ok_or_else(|| format!("found {text}, expected full, small or off"))
    }
}

impl fmt::Display for Pictures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = Self::ALL.iter().find(|(_, pictures)| pictures == self);
        f.write_str(name.map_or("", |(name, _)| name))
    }
}
