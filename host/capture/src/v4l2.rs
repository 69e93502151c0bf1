//! Cameras of Video4Linux. Limits: single-planar devices that stream into mapped buffers.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use std::{fs, io};

use moq_v4l::buffer::{Flags as BufferFlags, Metadata, Type};
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
use nix::time::{ClockId, clock_gettime};

use crate::constants::BUFFERS;
use crate::driver::{ActualMode, Buffer, Control, Driver, Port, Ready, Stream};
use crate::error::CaptureError;
use crate::geometry::{FRAME, Size};
use crate::mode::Offer;

/// `poll(2)`: there is something to read.
const POLLIN: i16 = 1;
/// `EINVAL`: there is no such buffer.
const INVALID: i32 = 22;
/// VIDEO_MAX_FRAME: the most buffers that a driver has.
const BUFFERS_MAX: usize = 32;
/// A camera that has every rate in a range offers these of them.
const COMMON_RATES: [f64; 9] = [5.0, 10.0, 15.0, 25.0, 30.0, 50.0, 60.0, 90.0, 120.0];

/// A device file.
#[derive(Debug, Clone)]
pub struct DevicePort(pub PathBuf);

impl Port for DevicePort {
    type Driver = OpenDevice;

    fn path(&self) -> String {
        self.0.display().to_string()
    }

    fn open(&self) -> Result<OpenDevice, CaptureError> {
        let camera = self.path();
        let device = Device::with_path(&self.0).map_err(|error| match error.kind() {
            // ENXIO, ENODEV: the file is there, the device behind it is not.
            io::ErrorKind::NotFound => missing(&camera),
            _ if [Some(6), Some(19)].contains(&error.raw_os_error()) => missing(&camera),
            io::ErrorKind::PermissionDenied => CaptureError::Permission {
                camera: camera.clone(),
            },
            io::ErrorKind::ResourceBusy => CaptureError::Busy {
                camera: camera.clone(),
            },
            _ => CaptureError::NoCamera {
                camera: camera.clone(),
                found: error.to_string(),
            },
        })?;
        let capabilities = device.query_caps().map_err(|error| CaptureError::NoCamera {
            camera: camera.clone(),
            found: format!("no video device ({error})"),
        })?;
        if !capabilities
            .capabilities
            .contains(Flags::VIDEO_CAPTURE | Flags::STREAMING)
        {
            return Err(CaptureError::NoCamera {
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

fn missing(camera: &str) -> CaptureError {
    let mut present: Vec<String> = fs::read_dir("/dev")
        .into_iter()
        .flatten()
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.starts_with("video"))
        .map(|name| format!("/dev/{name}"))
        .collect();
    present.sort();
    CaptureError::Missing {
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
    fn rates(&self, fourcc: FourCC, size: Size) -> Vec<f64> {
        let per_second =
            |interval: &Fraction| f64::from(interval.denominator) / f64::from(interval.numerator.max(1));
        let intervals = self
            .device
            .enum_frameintervals(fourcc, size.width as u32, size.height as u32)
            .unwrap_or_default();
        intervals
            .iter()
            .flat_map(|interval| match &interval.interval {
                FrameIntervalEnum::Discrete(interval) => vec![per_second(interval)],
                FrameIntervalEnum::Stepwise(steps) => {
                    let [min, max] = [&steps.max, &steps.min].map(per_second);
                    let between = COMMON_RATES.into_iter().filter(|rate| (min..max).contains(rate));
                    between.chain([max]).collect()
                }
            })
            .collect()
    }
}

const fn size_of(width: u32, height: u32) -> Size {
    Size::new(width as usize, height as usize)
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
                    FrameSizeEnum::Discrete(size) => size_of(size.width, size.height),
                    FrameSizeEnum::Stepwise(steps)
                        if (steps.min_width..=steps.max_width).contains(&(FRAME.width as u32))
                            && (steps.min_height..=steps.max_height).contains(&(FRAME.height as u32)) =>
                    {
                        FRAME
                    }
                    FrameSizeEnum::Stepwise(steps) => size_of(steps.max_width, steps.max_height),
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

    fn set_mode(&self, code: [u8; 4], size: Size, rate: Option<f64>) -> io::Result<ActualMode> {
        let format = self.device.set_format(&Format::new(
            size.width as u32,
            size.height as u32,
            FourCC::new(&code),
        ))?;
        if let Some(rate) = rate {
            // In millionths: fine enough for 60000/1001.
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
        Ok(ActualMode {
            code: format.fourcc.repr,
            size: size_of(format.width, format.height),
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
        let granted = queue_granted(|index| CaptureStream::queue(&mut stream, index))?;
        stream.start()?;
        Ok(DeviceStream { stream, granted })
    }
}

/// Queues all buffers but the first, which follows with the first `take`. Returns how many the driver granted, which may be
/// fewer or more than were asked for: the first buffer that cannot be queued is not there.
fn queue_granted(mut queue: impl FnMut(usize) -> io::Result<()>) -> io::Result<usize> {
    for index in 1..BUFFERS_MAX {
        match queue(index) {
            Err(error) if error.raw_os_error() == Some(INVALID) => return Ok(index),
            queued => queued?,
        }
    }
    Ok(BUFFERS_MAX)
}

/// When the buffer was filled, where the driver's time stamp is of the monotonic clock. `clock` is that clock now.
fn taken_at(meta: &Metadata, (clock, now): (Duration, Instant)) -> Option<Instant> {
    if meta.flags & BufferFlags::TIMESTAMP_MASK != BufferFlags::TIMESTAMP_MONOTONIC {
        return None;
    }
    let seconds = u64::try_from(meta.timestamp.sec).ok()?;
    let microseconds = u64::try_from(meta.timestamp.usec).ok()?;
    let stamp = Duration::from_secs(seconds) + Duration::from_micros(microseconds);
    // Some drivers leave it at 0.
    if stamp.is_zero() {
        return None;
    }
    now.checked_sub(clock.saturating_sub(stamp))
}

/// A device file whose driver fills buffers.
pub struct DeviceStream {
    stream: MappedStream<'static>,
    granted: usize,
}

/// Polls the device file.
pub struct DeviceReady(Arc<Handle>);

impl Stream for DeviceStream {
    type Ready = DeviceReady;

    fn buffers(&self) -> usize {
        self.granted
    }

    fn ready(&self) -> DeviceReady {
        DeviceReady(self.stream.handle())
    }

    fn take(&mut self) -> io::Result<Buffer<'_>> {
        let (bytes, meta) = self.stream.next()?;
        let clock = clock_gettime(ClockId::CLOCK_MONOTONIC).map(Duration::from);
        let now = Instant::now();
        let used = (meta.bytesused as usize).min(bytes.len());
        Ok(Buffer {
            bytes: &bytes[..used],
            sequence: meta.sequence,
            taken_at: clock.ok().and_then(|clock| taken_at(meta, (clock, now))),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fewer_and_more_buffers_than_were_asked_for_are_queued_and_counted() {
        for granted in [1, 2, 3, 4, 6, 32] {
            let mut queued = Vec::new();
            let found = queue_granted(|index| {
                if index >= granted {
                    return Err(io::Error::from_raw_os_error(INVALID));
                }
                queued.push(index);
                Ok(())
            });
            assert_eq!(found.unwrap(), granted);
            assert_eq!(queued, (1..granted).collect::<Vec<_>>());
        }
        let gone = queue_granted(|_| Err(io::Error::from_raw_os_error(19)));
        assert_eq!(gone.unwrap_err().raw_os_error(), Some(19));
    }

    #[test]
    fn only_a_time_stamp_of_the_monotonic_clock_counts() {
        let now = Instant::now();
        let clock = Duration::from_secs(1_000);
        let stamped = |flags, sec, usec| {
            let meta = Metadata {
                flags,
                timestamp: moq_v4l::timestamp::Timestamp::new(sec, usec),
                ..Metadata::default()
            };
            taken_at(&meta, (clock, now))
        };
        let monotonic = BufferFlags::TIMESTAMP_MONOTONIC | BufferFlags::TSTAMP_SRC_SOE | BufferFlags::MAPPED;
        let before = now.checked_sub(Duration::from_micros(16_700)).unwrap();
        assert_eq!(stamped(monotonic, 999, 983_300), Some(before));
        // A stamp ahead of the clock is of now.
        assert_eq!(stamped(monotonic, 1_000, 5), Some(now));
        assert_eq!(stamped(BufferFlags::TIMESTAMP_COPY, 999, 983_300), None);
        assert_eq!(stamped(BufferFlags::TIMESTAMP_UNKNOWN, 999, 983_300), None);
        assert_eq!(stamped(monotonic, 0, 0), None);
        assert_eq!(stamped(monotonic, -1, 0), None);
    }

    #[test]
    fn a_path_that_is_no_camera_is_refused_with_what_there_is() {
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
