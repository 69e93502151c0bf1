//! The section [sensor]: which virtual fingertip looks, and how its light moves.

use std::f64::consts::TAU;

use super::Load;
use super::error::SceneError;
use super::keys;
use super::section::Section;
use crate::FingertipParams;

/// The fingertip of a scene.
#[derive(Debug, Clone)]
pub struct Sensor {
    /// Its number; none is the nominal sensor.
    pub unit: Option<u64>,
    /// Its parameters, brightness at the start included.
    pub params: FingertipParams,
    /// How far the light swings, share of the brightness.
    pub brightness_motion: f64,
    /// Time of one swing, s.
    pub brightness_period_s: f64,
}

impl Sensor {
    /// Brightness at a time, relative to nominal.
    #[must_use]
    pub fn brightness(&self, time_s: f64) -> f64 {
        let swing = libm::sin(TAU * time_s / self.brightness_period_s);
        self.params.brightness * (1.0 + self.brightness_motion * swing)
    }
}

/// Reads the section, which may be missing.
pub(super) fn read(head: &Section, load: &mut Load) -> Result<Sensor, SceneError> {
    let _ = load;
    let Some(section) = head.section("sensor")? else {
        return Ok(Sensor {
            unit: None,
            params: FingertipParams::default(),
            brightness_motion: 0.0,
            brightness_period_s: 1.0,
        });
    };
    let unit = section.whole_if(&keys::UNIT)?;
    let mut params = FingertipParams::default();
    if let Some(particles) = section.whole_if(&keys::PARTICLES)? {
        params.particles = particles as usize;
    }
    if let Some(levels) = section.number_if(&keys::NOISE)? {
        params.noise_levels = levels;
    }
    params.brightness *= section.number(&keys::BRIGHTNESS)?;
    let sensor = Sensor {
        unit,
        params,
        brightness_motion: section.number(&keys::BRIGHTNESS_MOTION)?,
        brightness_period_s: section.number(&keys::BRIGHTNESS_PERIOD)?,
    };
    section.finish("this section")?;
    Ok(sensor)
}
