//! From an open camera to one that streams what was asked for: format, rate, exposure and gain. Pure but for the driver
//! behind its trait.

use super::constants::{EXPOSURE_UNIT_MS, FRAME_HEIGHT, FRAME_WIDTH};
use super::device::{Control, Driver, EXPOSURE_MANUAL, Port};
use super::error::CameraError;
use super::format::{PixelFormat, Wanted, shown};

/// What a camera is to be set to.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CameraSettings {
    /// Format and rate.
    pub mode: Wanted,
    /// Exposure time; `None`: as the camera has it.
    pub exposure_ms: Option<f64>,
    /// Gain in the camera's units; `None`: as the camera has it.
    pub gain: Option<i64>,
}

/// A camera that streams.
#[derive(Debug)]
pub(crate) struct Negotiated<S> {
    pub stream: S,
    pub format: PixelFormat,
    pub stride: usize,
    /// Frames a second; `None` when the driver does not say.
    pub rate: Option<f64>,
    /// What came out, for people.
    pub told: String,
}

/// Opens the camera and sets it.
///
/// # Errors
/// [`CameraError`] that names what it found and what to do.
pub(crate) fn open<P: Port>(
    port: &P,
    wanted: &CameraSettings,
) -> Result<Negotiated<<P::Driver as Driver>::Stream>, CameraError> {
    let camera = port.path();
    let driver = port.open()?;
    let gone = |error: std::io::Error| match error.kind() {
        std::io::ErrorKind::ResourceBusy => CameraError::Busy {
            camera: camera.clone(),
        },
        _ => CameraError::Gone {
            camera: camera.clone(),
            found: error.to_string(),
        },
    };
    let mode = wanted.mode.choose(&camera, &driver.offers())?;
    let size = [FRAME_WIDTH, FRAME_HEIGHT];
    let set = driver.set_mode(mode.code, size, mode.rate).map_err(gone)?;
    if (set.code, set.size) != (mode.code, size) {
        let [width, height] = set.size;
        return Err(CameraError::Negotiation {
            camera,
            found: format!("{} {width}×{height}", String::from_utf8_lossy(&set.code)),
            expected: format!("{} 640×480, which it offers", String::from_utf8_lossy(&mode.code)),
        });
    }
    let exposure = set_exposure(&camera, &driver, wanted.exposure_ms)?;
    let gain = set_gain(&camera, &driver, wanted.gain)?;
    let rate = set.rate.or(mode.rate);
    let told = told(
        &camera,
        &driver.card(),
        mode.format,
        (rate, wanted.mode.rate),
        &[exposure, gain],
    );
    Ok(Negotiated {
        stream: driver.stream().map_err(gone)?,
        format: mode.format,
        stride: set.stride,
        rate,
        told,
    })
}

fn told(
    camera: &str,
    card: &str,
    format: PixelFormat,
    (rate, wanted): (Option<f64>, f64),
    controls: &[String],
) -> String {
    let rate = match rate {
        None => "a rate that it does not tell".to_owned(),
        Some(rate) if (rate - wanted).abs() < 0.05 * wanted => format!("{} frames/s", shown(rate)),
        Some(rate) => format!("{} frames/s (asked for {})", shown(rate), shown(wanted)),
    };
    format!(
        "camera {camera} ({card}): 640×480 {format} at {rate}, {}",
        controls.join(", ")
    )
}

/// Fixes the exposure time. Says what holds.
fn set_exposure(camera: &str, driver: &impl Driver, wanted: Option<f64>) -> Result<String, CameraError> {
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
        return Err(CameraError::NoControl {
            camera: camera.to_owned(),
            control: "the exposure time",
            key,
        });
    }
    // A camera without the mode has no other than the manual one.
    if driver.control(Control::ExposureMode).is_some() {
        set(
            camera,
            driver,
            (key, &shown(ms)),
            Control::ExposureMode,
            EXPOSURE_MANUAL,
        )?;
    }
    set(camera, driver, (key, &shown(ms)), Control::ExposureTime, units)?;
    Ok(format!("exposure {} ms", shown(units as f64 * EXPOSURE_UNIT_MS)))
}

/// Fixes the gain. Says what holds.
fn set_gain(camera: &str, driver: &impl Driver, wanted: Option<i64>) -> Result<String, CameraError> {
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
        return Err(CameraError::NoControl {
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

/// Sets a control and looks whether the camera took the value.
fn set(
    camera: &str,
    driver: &impl Driver,
    (key, found): (&'static str, &str),
    control: Control,
    value: i64,
) -> Result<(), CameraError> {
    let taken = match driver.set_control(control, value) {
        Ok(()) => match driver.control(control) {
            Some(taken) if taken == value => return Ok(()),
            Some(taken) if control == Control::ExposureTime => {
                format!("{} ms instead", shown(taken as f64 * EXPOSURE_UNIT_MS))
            }
            Some(taken) => format!("{taken} instead"),
            None => "none".to_owned(),
        },
        Err(error) => format!("no such value ({error})"),
    };
    Err(CameraError::Control {
        camera: camera.to_owned(),
        key,
        found: found.to_owned(),
        taken,
    })
}
