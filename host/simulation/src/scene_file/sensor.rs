//! The section `[sensor]`: which virtual fingertip looks, through which camera, in which light.

use std::str;

use super::error::SceneError;
use super::keys;
use super::named_file::{Load, load_named};
use super::section::Section;
use crate::camera::Camera;
use crate::error::SimulationError;
use crate::fingertip::FingertipParams;
use crate::lighting::BrightnessMotion;

/// The fingertip of a scene.
#[derive(Debug, Clone)]
pub struct Sensor {
    /// Its number; none is the nominal sensor.
    pub unit: Option<u64>,
    /// Its parameters.
    pub params: FingertipParams,
}

/// Reads the section, which may be missing.
pub(super) fn read(head: &Section, load: &mut Load) -> Result<Sensor, SceneError> {
    let Some(section) = head.section("sensor")? else {
        return Ok(Sensor {
            unit: None,
            params: FingertipParams::default(),
        });
    };
    let unit = section.whole_if(&keys::UNIT)?;
    let mut params = unit.map_or_else(FingertipParams::default, FingertipParams::of_sensor);
    if let Some(particles) = section.whole_if(&keys::PARTICLES)? {
        params.particles = particles as usize;
    }
    if let Some(levels) = section.number_if(&keys::NOISE)? {
        params.noise_levels = levels;
    }
    params.jpeg_quality = section
        .whole_if(&keys::JPEG_QUALITY)?
        .map(|quality| quality as u8);
    if let Some(name) = section.text_if(&keys::CAMERA)? {
        params.camera = camera(&section, name, load)?;
    }
    params.brightness *= section.number(&keys::BRIGHTNESS)?;
    params.brightness_motion = BrightnessMotion {
        drift: section.number(&keys::DRIFT)?,
        drift_period_s: section.number(&keys::DRIFT_PERIOD)?,
        flicker: section.number(&keys::FLICKER)?,
        mains_hz: section.number(&keys::MAINS)?,
    };
    section.finish("this section")?;
    Ok(Sensor { unit, params })
}

fn camera(section: &Section, name: &str, load: &mut Load) -> Result<Camera, SceneError> {
    let bytes = load_named(section, &keys::CAMERA, name, load)?;
    let problem = |found: &str, expected: &str| {
        section.problem(
            keys::CAMERA.name,
            found,
            expected,
            "correct that file, or leave the key out",
        )
    };
    let text =
        str::from_utf8(&bytes).map_err(|_| problem(&format!("{name} that is no text"), "a TOML file"))?;
    Camera::from_toml(text).map_err(|error| match error {
        SimulationError::CameraFile {
            line,
            key,
            found,
            expected,
        } => problem(&format!("{found} at {name}:{line}: {key}"), &expected),
        other => problem(&other.to_string(), "a camera file"),
    })
}
