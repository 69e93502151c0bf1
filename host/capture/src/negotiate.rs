//! Opens a camera and sets format, rate, exposure and gain. Pure: the driver is behind a trait.

use crate::constants::{BUFFERS, BUFFERS_MIN, EXPOSURE_UNIT_MS};
use crate::driver::{ActualMode, Control, Driver, EXPOSURE_MANUAL, Port, Stream as _};
use crate::error::CaptureError;
use crate::geometry::Size;
use crate::mode::{PixelFormat, RequestedMode, trimmed};

/// What the configuration asks of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CameraSettings {
    /// Format and rate.
    pub mode: RequestedMode,
    /// Exposure time; `None` leaves the camera's.
    pub exposure_ms: Option<f64>,
    /// Gain in the camera's units; `None` leaves the camera's.
    pub gain: Option<i64>,
    /// How colour pictures become crops; `None`: grey ones of 640×480.
    pub colour: Option<gripline_sensor::Capture>,
}

/// A camera that streams.
#[derive(Debug)]
pub struct Negotiated<S> {
    /// Delivers the frames.
    pub stream: S,
    /// Format of the pixels.
    pub format: PixelFormat,
    /// Columns and rows.
    pub size: Size,
    /// Bytes from row to row; 0 when the driver does not say.
    pub stride: usize,
    /// Frames a second; `None` when the driver does not say.
    pub rate: Option<f64>,
    /// The camera without its settings: its place and what it calls itself.
    pub name: String,
    /// The camera and all its settings, for people.
    pub description: String,
}

/// Opens the camera and sets it.
///
/// # Errors
/// [`CaptureError`] that names what it found and what to do.
pub fn open<P: Port>(
    port: &P,
    settings: &CameraSettings,
) -> Result<Negotiated<<P::Driver as Driver>::Stream>, CaptureError> {
    let camera = port.path();
    let driver = port.open()?;
    let gone = |error: std::io::Error| match error.kind() {
        std::io::ErrorKind::ResourceBusy => CaptureError::Busy {
            camera: camera.clone(),
        },
        _ => CaptureError::Gone {
            camera: camera.clone(),
            found: error.to_string(),
        },
    };
    let colour = settings.colour.map(|capture| {
        let [columns, rows] = capture.size_px;
        Size::new(columns, rows)
    });
    let requested = RequestedMode {
        colour,
        ..settings.mode
    };
    let mode = requested.choose(&camera, &driver.offers())?;
    let actual = driver.set_mode(mode.code, mode.size, mode.rate).map_err(gone)?;
    let ActualMode { code, size, .. } = actual;
    if (code, size) != (mode.code, mode.size) {
        return Err(CaptureError::Negotiation {
            camera,
            found: format!("{} {size}", String::from_utf8_lossy(&code)),
            expected: format!(
                "{} {}, which it offers",
                String::from_utf8_lossy(&mode.code),
                mode.size
            ),
        });
    }
    let exposure = set_exposure(&camera, &driver, settings.exposure_ms)?;
    let gain = set_gain(&camera, &driver, settings.gain)?;
    let rate = actual.rate.or(mode.rate);
    let card = driver.card();
    let stream = driver.stream().map_err(gone)?;
    let granted = stream.buffers();
    if granted < BUFFERS_MIN {
        return Err(CaptureError::Buffers {
            camera,
            found: granted,
            expected: BUFFERS_MIN,
        });
    }
    let mut controls = vec![exposure, gain];
    if granted < BUFFERS as usize {
        controls.push(format!(
            "{granted} buffers (asked for {BUFFERS}): a busy machine misses pictures sooner"
        ));
    }
    let name = format!("camera {camera} ({card})");
    let description = describe(&name, (mode.format, size), (rate, settings.mode.rate), &controls);
    Ok(Negotiated {
        stream,
        format: mode.format,
        size,
        stride: actual.stride,
        rate,
        name,
        description,
    })
}

fn describe(
    name: &str,
    (format, size): (PixelFormat, Size),
    (rate, wanted): (Option<f64>, f64),
    controls: &[String],
) -> String {
    let rate = match rate {
        None => "a rate that it does not tell".to_owned(),
        Some(rate) if (rate - wanted).abs() < 0.05 * wanted => format!("{} frames/s", trimmed(rate)),
        Some(rate) => format!("{} frames/s (asked for {})", trimmed(rate), trimmed(wanted)),
    };
    format!("{name}: {size} {format} at {rate}, {}", controls.join(", "))
}

/// Fixes the exposure time. Returns what is in force, for people.
fn set_exposure(camera: &str, driver: &impl Driver, wanted: Option<f64>) -> Result<String, CaptureError> {
    let Some(ms) = wanted else {
        return Ok(match driver.control(Control::ExposureMode) {
            Some(EXPOSURE_MANUAL) => "exposure as it is set in the camera".to_owned(),
            Some(_) => {
                "exposure automatic (its changes look like touches: set camera.exposure_ms)".to_owned()
            }
            None => "exposure not settable".to_owned(),
        });
    };
    let key = "camera.exposure_ms";
    let units = (ms / EXPOSURE_UNIT_MS).round() as i64;
    if driver.control(Control::ExposureTime).is_none() {
        return Err(CaptureError::NoControl {
            camera: camera.to_owned(),
            control: "the exposure time",
            key,
        });
    }
    // A camera without the mode knows the manual one only.
    if driver.control(Control::ExposureMode).is_some() {
        set(
            camera,
            driver,
            (key, &trimmed(ms)),
            Control::ExposureMode,
            EXPOSURE_MANUAL,
        )?;
    }
    set(camera, driver, (key, &trimmed(ms)), Control::ExposureTime, units)?;
    Ok(format!(
        "exposure {} ms",
        trimmed(units as f64 * EXPOSURE_UNIT_MS)
    ))
}

/// Fixes the gain. Returns what is in force, for people.
fn set_gain(camera: &str, driver: &impl Driver, wanted: Option<i64>) -> Result<String, CaptureError> {
    let Some(gain) = wanted else {
        return Ok(
            match (driver.control(Control::GainMode), driver.control(Control::Gain)) {
                (Some(1), _) => "gain automatic (its changes look like touches: set camera.gain)".to_owned(),
                (_, Some(gain)) => format!("gain {gain}"),
                (_, None) => "gain not settable".to_owned(),
            },
        );
    };
    let key = "camera.gain";
    if driver.control(Control::Gain).is_none() {
        return Err(CaptureError::NoControl {
            camera: camera.to_owned(),
            control: "the gain",
            key,
        });
    }
    if driver.control(Control::GainMode).is_some() {
        set(camera, driver, (key, &gain.to_string()), Control::GainMode, 0)?;
    }
    set(camera, driver, (key, &gain.to_string()), Control::Gain, gain)?;
    Ok(format!("gain {gain}"))
}

/// Sets a control and checks that the camera accepted the value.
fn set(
    camera: &str,
    driver: &impl Driver,
    (key, found): (&'static str, &str),
    control: Control,
    value: i64,
) -> Result<(), CaptureError> {
    let taken = match driver.set_control(control, value) {
        Ok(()) => match driver.control(control) {
            Some(taken) if taken == value => return Ok(()),
            Some(taken) if control == Control::ExposureTime => {
                format!("{} ms instead", trimmed(taken as f64 * EXPOSURE_UNIT_MS))
            }
            Some(taken) => format!("{taken} instead"),
            None => "none".to_owned(),
        },
        Err(error) => format!("no such value ({error})"),
    };
    Err(CaptureError::Control {
        camera: camera.to_owned(),
        key,
        found: found.to_owned(),
        taken,
    })
}
