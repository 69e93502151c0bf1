//! Played scenes of six kinds in the contact world, on sensors and shapes of no training set: pictures as the camera gives them,
//! and the true forces. Units: N, mm, s. Limits: one fingertip, 60 frames a second.

use std::sync::Arc;

use gripline_simulation::constants::REST_PICTURES;
use gripline_simulation::contact_world::{Contact, Drive, GelSurface, Mount, Press, UNSEEN_SHAPES};
use gripline_simulation::{Fingertip, FingertipParams, Gel, Image};

use crate::failure::Failure;

/// Camera frames a second.
pub(crate) const FRAMES_PER_SECOND: f64 = 60.0;
/// Sensors of this program: numbers that nothing else uses.
const SENSOR: u64 = 11 << 60;
/// The skin's friction; the detector's is below it.
const FRICTION: f64 = 0.7;

/// What happens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Idle,
    LightTouch,
    FullContact,
    StaticHold,
    Slide,
    SlowCreep,
}

impl Kind {
    pub(crate) const ALL: [Self; 6] = [
        Self::Idle,
        Self::LightTouch,
        Self::FullContact,
        Self::StaticHold,
        Self::Slide,
        Self::SlowCreep,
    ];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::LightTouch => "light touch",
            Self::FullContact => "full contact",
            Self::StaticHold => "static hold",
            Self::Slide => "slide",
            Self::SlowCreep => "slow creep",
        }
    }

    /// Normal force and pull per frame at a part of the scene, 0 to 1: (N, mm).
    fn load(self, at: f64) -> (f64, f64) {
        let ramp = |peak_n: f64| peak_n * (at / 0.15).min((1.0 - at) / 0.15).clamp(0.0, 1.0);
        match self {
            Self::Idle => (0.0, 0.0),
            Self::LightTouch => (ramp(0.3), 0.0),
            Self::FullContact => (ramp(8.0), if (0.3..0.7).contains(&at) { 0.004 } else { 0.0 }),
            Self::StaticHold => (
                3.0 * (at / 0.1).min(1.0),
                if (0.1..0.2).contains(&at) { 0.01 } else { 0.0 },
            ),
            Self::Slide => (3.0 * (at / 0.1).min(1.0), if at > 0.2 { 0.02 } else { 0.0 }),
            // A pull so slow that a gate may take its pictures for unchanged.
            Self::SlowCreep => (
                2.0 * (at / 0.1).min(1.0),
                if at > 0.1 { 0.3 / 240.0 } else { 0.0 },
            ),
        }
    }
}

/// A picture and what is true in it.
pub(crate) struct Frame {
    pub(crate) crop: Vec<u8>,
    /// As the sensor should report it, newtons per taxel.
    pub(crate) forces: [[f32; 3]; 400],
    /// The object slides as a whole.
    pub(crate) slides: bool,
}

/// A played scene.
pub(crate) struct Scene {
    pub(crate) kind: Kind,
    pub(crate) rest: Vec<Vec<u8>>,
    pub(crate) frames: Vec<Frame>,
}

/// Plays each kind once, `frames` long.
pub(crate) fn play(frames: usize, seed: u64) -> Result<Vec<Scene>, Failure> {
    let skin = Arc::new(GelSurface::new(&Gel::default(), 80)?);
    Kind::ALL
        .into_iter()
        .zip(0..)
        .map(|(kind, number)| one(kind, &skin, frames, SENSOR | seed << 8 | number))
        .collect()
}

fn one(kind: Kind, skin: &Arc<GelSurface>, frames: usize, unit: u64) -> Result<Scene, Failure> {
    let params = FingertipParams::of_sensor(unit);
    let mut fingertip = Fingertip::new(unit, params)?;
    let rest = (0..REST_PICTURES)
        .map(|_| fingertip.rest_image().pixels)
        .collect();
    let shape = Arc::new(UNSEEN_SHAPES[unit as usize % UNSEEN_SHAPES.len()]);
    let mut contact = Contact::new(Arc::clone(skin), shape, FRICTION, Mount::default())?;
    let mut drive = Drive {
        press: Press::Force(0.0),
        at_mm: [-1.0, 1.0],
        turn_rad: 0.4,
        tilt_rad: [0.0; 2],
    };
    let mut played = Vec::with_capacity(frames);
    for frame in 0..frames {
        let (load_n, pull_mm) = kind.load(frame as f64 / frames as f64);
        drive.press = Press::Force(load_n);
        drive.at_mm[0] += pull_mm;
        contact.go_to(drive, 1)?;
        fingertip.set_time(frame as f64 / FRAMES_PER_SECOND);
        let mut crop = Image::crop();
        let truth = contact.truth();
        fingertip.render(truth, &mut crop);
        played.push(Frame {
            crop: crop.pixels,
            forces: truth.force_map(),
            slides: truth.gross_slip(),
        });
    }
    Ok(Scene {
        kind,
        rest,
        frames: played,
    })
}
