//! What the capture needs of a camera's driver: traits, which `v4l2` and the tests implement.

use std::io;
use std::time::{Duration, Instant};

use crate::error::CaptureError;
use crate::geometry::Size;
use crate::mode::Offer;

/// A setting that has to stay constant from picture to picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Control {
    /// Who chooses the exposure: [`EXPOSURE_MANUAL`], else the camera.
    ExposureMode,
    /// Exposure time, in units of 100 µs.
    ExposureTime,
    /// Whether the camera chooses the gain: 0 or 1.
    GainMode,
    /// Gain, in the camera's own units.
    Gain,
}

/// V4L2_EXPOSURE_MANUAL.
pub const EXPOSURE_MANUAL: i64 = 1;

/// The mode that the driver set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActualMode {
    /// The driver's name of the format.
    pub code: [u8; 4],
    /// Columns and rows.
    pub size: Size,
    /// Bytes from row to row.
    pub stride: usize,
    /// Frames a second; `None` when the driver does not say.
    pub rate: Option<f64>,
}

/// Where a camera is plugged in; can be opened again and again.
pub trait Port: Send + 'static {
    /// An open camera.
    type Driver: Driver;

    /// Path of the device.
    fn path(&self) -> String;

    /// Opens it.
    ///
    /// # Errors
    /// [`CaptureError`] when it is missing, not allowed, or no camera.
    fn open(&self) -> Result<Self::Driver, CaptureError>;
}

/// An open camera.
pub trait Driver {
    /// Delivers the frames.
    type Stream: Stream;

    /// What the camera calls itself.
    fn card(&self) -> String;

    /// Formats, sizes and rates that it offers.
    fn offers(&self) -> Vec<Offer>;

    /// Requests a format and a rate.
    ///
    /// # Errors
    /// What the driver says.
    fn set_mode(&self, code: [u8; 4], size: Size, rate: Option<f64>) -> io::Result<ActualMode>;

    /// The value of a control; `None` when the camera lacks it.
    fn control(&self, control: Control) -> Option<i64>;

    /// Sets a control.
    ///
    /// # Errors
    /// What the driver says.
    fn set_control(&self, control: Control, value: i64) -> io::Result<()>;

    /// Starts filling buffers.
    ///
    /// # Errors
    /// What the driver says.
    fn stream(self) -> io::Result<Self::Stream>;
}

/// A filled buffer; valid until the next one is taken.
#[derive(Debug)]
pub struct Buffer<'a> {
    /// The frame.
    pub bytes: &'a [u8],
    /// The driver's number of the frame.
    pub sequence: u32,
    /// The driver's time stamp, where it has one of the monotonic clock. Of the first or the last byte of the frame.
    pub taken_at: Option<Instant>,
    /// The driver flags an error in the frame.
    pub is_damaged: bool,
}

/// A camera that fills buffers.
pub trait Stream {
    /// Waits for buffers.
    type Ready: Ready;

    /// How many buffers the driver granted.
    fn buffers(&self) -> usize;

    /// Waits for buffers independently of [`Stream::take`], whose buffer is still borrowed.
    fn ready(&self) -> Self::Ready;

    /// Returns the buffer before and takes the oldest filled one.
    ///
    /// # Errors
    /// What the driver says; the camera is then gone.
    fn take(&mut self) -> io::Result<Buffer<'_>>;
}

/// Waits for buffers.
pub trait Ready {
    /// Whether there is a buffer to take within `wait`. Of a camera that is gone it says yes, and taking fails.
    ///
    /// # Errors
    /// What the system says.
    fn within(&self, wait: Duration) -> io::Result<bool>;
}
