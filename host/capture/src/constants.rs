//! Numbers of the capture, each with its unit and source.

use std::time::Duration;

/// Frames a second that are requested by default: the simulated world's.
pub const DEFAULT_RATE: f64 = 60.0;
/// How long a source waits for a picture before it lets the link work.
pub const POLL: Duration = Duration::from_millis(2);
/// A rate that is lower than the requested one by this factor still counts as it: 60000/1001 stands for 60.
pub(crate) const RATE_TOLERANCE: f64 = 1.01;
/// Buffers that the driver is asked to fill: one is read, one is filled, two are spare.
pub(crate) const BUFFERS: u32 = 4;
/// Minimum number of buffers: one is read while one is filled.
pub(crate) const BUFFERS_MIN: usize = 2;
/// A connected camera that sends nothing for this long is opened again.
pub(crate) const SILENCE: Duration = Duration::from_secs(1);
/// The same until its first picture: some cameras need seconds to begin, and each new opening begins anew.
pub(crate) const SILENCE_AT_START: Duration = Duration::from_secs(5);
/// Below this mean level a picture may be black, which is 16 in YUYV.
pub(crate) const BLACK_LEVEL: f64 = 20.0;
/// Pictures whose mean levels differ by at most this factor have a steady light.
pub(crate) const STEADY_LIGHT: f64 = 1.05;
/// Time that a camera has from its first picture to a steady light: lamps go on, the exposure finds its level.
pub(crate) const SETTLING: Duration = Duration::from_secs(2);
/// Time between two attempts to open a camera that is gone: a camera that returns is back within a second.
pub(crate) const REOPEN_EVERY: Duration = Duration::from_millis(100);
/// The longest that the camera's thread waits before it checks whether it has to stop.
pub(crate) const STOP_CHECK: Duration = Duration::from_millis(100);
/// Unit of the driver's absolute exposure time (V4L2_CID_EXPOSURE_ABSOLUTE): 100 µs.
pub(crate) const EXPOSURE_UNIT_MS: f64 = 0.1;
