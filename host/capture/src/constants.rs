//! Numbers of the capture, each with its unit and source.

use std::time::Duration;

/// Columns of the camera's picture (the paper's camera).
pub const FRAME_WIDTH: u32 = 640;
/// Rows of the camera's picture.
pub const FRAME_HEIGHT: u32 = 480;
/// Pixels a side of the crop.
pub const CROP_SIDE: usize = 440;
/// Pixels a side of the picture that `unet` looks at.
pub const IMAGE_SIDE: usize = 88;
/// First column of the crop: (640 − 440) / 2.
pub const CROP_LEFT: usize = 100;
/// First row of the crop: (480 − 440) / 2.
pub const CROP_TOP: usize = 20;
/// A rate this little below the wanted one counts as it: 60000/1001 stands for 60.
pub const RATE_TOLERANCE: f64 = 1.01;
/// Frames a second that are asked for when nobody says anything: the simulated world's.
pub const RATE: f64 = 60.0;
/// Buffers that the driver fills: one that is looked at, one that is filled, two to spare.
pub const BUFFERS: u32 = 4;
/// A camera that is there and sends nothing for so long is opened anew.
pub const SILENCE: Duration = Duration::from_secs(1);
/// Between two tries to open a camera that is gone: a camera that returns is back within a second.
pub const REOPEN_EVERY: Duration = Duration::from_millis(100);
/// The longest that a thread waits before it looks whether it is still wanted.
pub const PATIENCE: Duration = Duration::from_millis(100);
/// How long the source waits for a picture before it lets the link work.
pub const POLL: Duration = Duration::from_millis(2);
/// Unit of the driver's absolute exposure time (V4L2_CID_EXPOSURE_ABSOLUTE): 100 µs.
pub const EXPOSURE_UNIT_MS: f64 = 0.1;
