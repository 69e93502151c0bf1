//! The camera as the rest of the capture sees it, and the real one behind it: Video4Linux.
//! Touches the world. Limits: single-planar devices that stream into mapped buffers.

use std::io;
use std::time::Duration;

use super::error::CameraError;
use super::format::Offer;

/// What of a picture is held constant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Control {
    /// Who chooses the exposure: [`EXPOSURE_MANUAL`], or the camera.
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

/// What the driver made of a wish.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Set {
    /// Its pixel format, as the driver calls it.
    pub code: [u8; 4],
    /// Columns and rows.
    pub size: [u32; 2],
    /// Bytes from row to row.
    pub stride: usize,
    /// Frames a second; `None` when the driver does not say.
    pub rate: Option<f64>,
}

/// Where a camera is plugged in: can be opened again and again.
pub trait Port: Send + 'static {
    /// The camera once it is open.
    type Driver: Driver;

    /// Its path, for people.
    fn path(&self) -> String;

    /// Opens it.
    ///
    /// # Errors
    /// [`CameraError`] when it is not there, not allowed, or no camera.
    fn open(&self) -> Result<Self::Driver, CameraError>;
}

/// An open camera.
pub trait Driver {
    /// The camera once it streams.
    type Stream: Stream;

    /// What the camera calls itself.
    fn card(&self) -> String;

    /// What it offers.
    fn offers(&self) -> Vec<Offer>;

    /// Asks for a format and a rate.
    ///
    /// # Errors
    /// What the driver says.
    fn set_mode(&self, code: [u8; 4], size: [u32; 2], rate: Option<f64>) -> io::Result<Set>;

    /// A control's value; `None` when the camera does not have it.
    fn control(&self, control: Control) -> Option<i64>;

    /// Sets a control.
    ///
    /// # Errors
    /// What the driver says.
    fn set_control(&self, control: Control, value: i64) -> io::Result<()>;

    /// Begins to fill buffers.
    ///
    /// # Errors
    /// What the driver says.
    fn stream(self) -> io::Result<Self::Stream>;
}

/// A filled buffer, until the next one is taken.
#[derive(Debug)]
pub struct Buffer<'a> {
    /// The picture as the camera sent it.
    pub bytes: &'a [u8],
    /// The driver's number of it.
    pub sequence: u32,
    /// The driver says that something in it is wrong.
    pub is_damaged: bool,
}

/// A camera that fills buffers.
pub trait Stream {
    /// What tells of filled buffers.
    type Ready: Ready;

    /// Tells when there is a buffer to take, also while one is looked at.
    fn ready(&self) -> Self::Ready;

    /// Gives back the buffer before and takes the oldest filled one.
    ///
    /// # Errors
    /// What the driver says; the camera is then gone.
    fn take(&mut self) -> io::Result<Buffer<'_>>;
}

/// Waits for buffers.
pub trait Ready {
    /// Whether there is one to take within `wait`. Of a camera that is gone it says yes, and taking fails.
    ///
    /// # Errors
    /// What the system says.
    fn within(&self, wait: Duration) -> io::Result<bool>;
}

#[cfg(target_os = "linux")]
pub use self::v4l2::DevicePort;

#[cfg(target_os = "linux")]
mod v4l2 {
    use std::fs;
    use std::path::PathBuf;
    use std::sync::Arc;

    use moq_v4l::buffer::{Flags as BufferFlags, Type};
    use moq_v4l::capability::Flags;
    use moq_v4l::control::{Control as RawControl, Value};
    use moq_v4l::device::{Device, Handle};
    use moq_v4l::frameinterval::FrameIntervalEnum;
    use moq_v4l::framesize::FrameSizeEnum;
    use moq_v4l::io::mmap::Stream as MappedStream;
    use moq_v4l::io::traits::{CaptureStream, Stream as _};
    use moq_v4l::sys;
    use moq_v4l::video::Capture;
    use moq_v4l::video::capture::Parameters;
    use moq_v4l::{Format, FourCC, Fraction};

    use super::{Buffer, CameraError, Control, Driver, Duration, Offer, Port, Ready, Set, Stream, io};
    use crate::constants::{BUFFERS, FRAME_HEIGHT, FRAME_WIDTH};

    /// `poll(2)`: there is something to read.
    const POLLIN: i16 = 1;
    /// Of a camera that has every rate between two, these are offered.
    const COMMON_RATES: [f64; 9] = [5.0, 10.0, 15.0, 25.0, 30.0, 50.0, 60.0, 90.0, 120.0];
    /// Sizes of a camera that offers every size are not listed one by one.
    const WHOLE_RANGE: [u32; 2] = [FRAME_WIDTH, FRAME_HEIGHT];

    /// A device file.
    #[derive(Debug, Clone)]
    pub struct DevicePort(pub PathBuf);

    impl Port for DevicePort {
        type Driver = OpenDevice;

        fn path(&self) -> String {
            self.0.display().to_string()
        }

        fn open(&self) -> Result<OpenDevice, CameraError> {
            let camera = self.path();
            let device = Device::with_path(&self.0).map_err(|error| match error.kind() {
                // ENXIO, ENODEV: the file is there, the device behind it is not.
                io::ErrorKind::NotFound => missing(&camera),
                _ if [Some(6), Some(19)].contains(&error.raw_os_error()) => missing(&camera),
                io::ErrorKind::PermissionDenied => CameraError::Permission {
                    camera: camera.clone(),
                },
                io::ErrorKind::ResourceBusy => CameraError::Busy {
                    camera: camera.clone(),
                },
                _ => CameraError::NoCamera {
                    camera: camera.clone(),
                    found: error.to_string(),
                },
            })?;
            let capabilities = device.query_caps().map_err(|error| CameraError::NoCamera {
                camera: camera.clone(),
                found: format!("no video device ({error})"),
            })?;
            if !capabilities
                .capabilities
                .contains(Flags::VIDEO_CAPTURE | Flags::STREAMING)
            {
                return Err(CameraError::NoCamera {
                    camera,
                    found: format!("{}, which takes no pictures", capabilities.card),
                });
            }
            Ok(OpenDevice {
                card: capabilities.card,
                device,
            })
        }
    }

    fn missing(camera: &str) -> CameraError {
        let mut present: Vec<String> = fs::read_dir("/dev")
            .into_iter()
            .flatten()
            .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
            .filter(|name| name.starts_with("video"))
            .map(|name| format!("/dev/{name}"))
            .collect();
        present.sort();
        CameraError::Missing {
            camera: camera.to_owned(),
            present: if present.is_empty() {
                "none that are there: this system shows no video device".to_owned()
            } else {
                present.join(", ")
            },
        }
    }

    /// A device file that is open.
    pub struct OpenDevice {
        device: Device,
        card: String,
    }

    impl OpenDevice {
        fn rates(&self, fourcc: FourCC, [width, height]: [u32; 2]) -> Vec<f64> {
            let per_second =
                |interval: &Fraction| f64::from(interval.denominator) / f64::from(interval.numerator.max(1));
            let intervals = self
                .device
                .enum_frameintervals(fourcc, width, height)
                .unwrap_or_default();
            intervals
                .iter()
                .flat_map(|interval| match &interval.interval {
                    FrameIntervalEnum::Discrete(interval) => vec![per_second(interval)],
                    FrameIntervalEnum::Stepwise(steps) => {
                        let [least, most] = [&steps.max, &steps.min].map(per_second);
                        let between = COMMON_RATES
                            .into_iter()
                            .filter(|rate| (least..most).contains(rate));
                        between.chain([most]).collect()
                    }
                })
                .collect()
        }
    }

    const fn id(control: Control) -> u32 {
        match control {
            Control::ExposureMode => sys::V4L2_CID_EXPOSURE_AUTO,
            Control::ExposureTime => sys::V4L2_CID_EXPOSURE_ABSOLUTE,
            Control::GainMode => sys::V4L2_CID_AUTOGAIN,
            Control::Gain => sys::V4L2_CID_GAIN,
        }
    }

    impl Driver for OpenDevice {
        type Stream = DeviceStream;

        fn card(&self) -> String {
            self.card.clone()
        }

        fn offers(&self) -> Vec<Offer> {
            let mut offers = Vec::new();
            for format in self.device.enum_formats().unwrap_or_default() {
                for size in self.device.enum_framesizes(format.fourcc).unwrap_or_default() {
                    let size = match size.size {
                        FrameSizeEnum::Discrete(size) => [size.width, size.height],
                        FrameSizeEnum::Stepwise(steps)
                            if (steps.min_width..=steps.max_width).contains(&FRAME_WIDTH)
                                && (steps.min_height..=steps.max_height).contains(&FRAME_HEIGHT) =>
                        {
                            WHOLE_RANGE
                        }
                        FrameSizeEnum::Stepwise(steps) => [steps.max_width, steps.max_height],
                    };
                    offers.push(Offer {
                        code: format.fourcc.repr,
                        size,
                        rates: self.rates(format.fourcc, size),
                    });
                }
            }
            offers
        }

        fn set_mode(&self, code: [u8; 4], size: [u32; 2], rate: Option<f64>) -> io::Result<Set> {
            let format = self
                .device
                .set_format(&Format::new(size[0], size[1], FourCC::new(&code)))?;
            if let Some(rate) = rate {
                // Milliseconds and a thousandth: fine enough for 60000/1001.
                let interval = Fraction::new(1_000_000, (rate * 1e6).round() as u32);
                self.device.set_params(&Parameters::new(interval))?;
            }
            let rate = self.device.params().ok().and_then(|set| {
                let Fraction {
                    numerator,
                    denominator,
                } = set.interval;
                (numerator > 0 && denominator > 0).then(|| f64::from(denominator) / f64::from(numerator))
            });
            Ok(Set {
                code: format.fourcc.repr,
                size: [format.width, format.height],
                stride: format.stride as usize,
                rate,
            })
        }

        fn control(&self, control: Control) -> Option<i64> {
            match self.device.control(id(control)).ok()?.value {
                Value::Integer(value) => Some(value),
                Value::Boolean(value) => Some(value.into()),
                _ => None,
            }
        }

        fn set_control(&self, control: Control, value: i64) -> io::Result<()> {
            self.device.set_control(RawControl {
                id: id(control),
                value: Value::Integer(value),
            })
        }

        fn stream(self) -> io::Result<DeviceStream> {
            let mut stream = MappedStream::with_buffers(&self.device, Type::VideoCapture, BUFFERS)?;
            // The first is handed over when the first picture is taken, as every buffer is that was looked at.
            for index in 1..BUFFERS as usize {
                CaptureStream::queue(&mut stream, index)?;
            }
            stream.start()?;
            Ok(DeviceStream(stream))
        }
    }

    /// A device file whose driver fills buffers.
    pub struct DeviceStream(MappedStream<'static>);

    /// Polls the device file.
    pub struct DeviceReady(Arc<Handle>);

    impl Stream for DeviceStream {
        type Ready = DeviceReady;

        fn ready(&self) -> DeviceReady {
            DeviceReady(self.0.handle())
        }

        fn take(&mut self) -> io::Result<Buffer<'_>> {
            let (bytes, meta) = self.0.next()?;
            let used = (meta.bytesused as usize).min(bytes.len());
            Ok(Buffer {
                bytes: &bytes[..used],
                sequence: meta.sequence,
                is_damaged: meta.flags.contains(BufferFlags::ERROR),
            })
        }
    }

    impl Ready for DeviceReady {
        fn within(&self, wait: Duration) -> io::Result<bool> {
            match self.0.poll(POLLIN, wait.as_millis() as i32) {
                Ok(ready) => Ok(ready > 0),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(false),
                Err(error) => Err(error),
            }
        }
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_camera_is_told_with_what_there_is() {
        let open = |path: &str| DevicePort(path.into()).open().map(drop).unwrap_err().to_string();
        let error = open("/dev/video-that-is-not-there");
        assert!(
            error.contains("not found") && error.contains("such as /dev/video0"),
            "{error}"
        );
        let error = open("/dev/null");
        assert!(
            error.contains("found no video device") && error.contains("expected a camera"),
            "{error}"
        );
    }
}
