//! Scenes that tempt to skip too much, picture by picture, on sensors and shapes of no training set.
//! Units: N, mm, s. Limits: the simulated camera, 60 pictures a second.

use std::sync::Arc;

use gripline_simulation::constants::REST_PICTURES;
use gripline_simulation::contact_world::{Contact, Drive, GelSurface, Mount, Press, UNSEEN_SHAPES};
use gripline_simulation::{BrightnessMotion, Fingertip, FingertipParams, Gel, GripScene, Image};

use crate::error::EvaluationError;

/// Camera pictures a second.
pub(super) const FRAMES_PER_SECOND: f64 = 60.0;
/// Sensors of this evaluation: numbers that nothing else uses.
const SENSOR: u64 = 10 << 60;
/// The skin's friction; the detector's is below it.
const FRICTION: f64 = 0.7;

/// What happens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Nothing,
    /// Touches of 0.05, 0.1, 0.2 and 0.4 N.
    LightTouches,
    Touches,
    /// The same while the brightness drifts and flickers.
    Brightness,
    /// The same with 8 % more noise than at rest.
    MoreNoise,
    /// A load of 3 N with some shear, and nothing else: far from slip.
    QuietHold,
    /// A pull of 0.075 mm a second, which a gate may take for nothing.
    SlowCreep,
    Slide,
    /// The scripted grasp of the demo.
    Grasp,
}

impl Kind {
    pub(super) const ALL: [Self; 9] = [
        Self::Nothing,
        Self::LightTouches,
        Self::Touches,
        Self::Brightness,
        Self::MoreNoise,
        Self::QuietHold,
        Self::SlowCreep,
        Self::Slide,
        Self::Grasp,
    ];

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Nothing => "nothing",
            Self::LightTouches => "light touches",
            Self::Touches => "touches",
            Self::Brightness => "brightness",
            Self::MoreNoise => "more noise",
            Self::QuietHold => "quiet hold",
            Self::SlowCreep => "slow creep",
            Self::Slide => "slide",
            Self::Grasp => "grasp",
        }
    }

    /// Normal force, N, and pull, mm a second, at a time of the round in which the scene repeats, s; and that round's length.
    fn load(self, time_s: f64, round: usize) -> (f64, f64) {
        let peak_n = |peaks: [f64; 4]| peaks[round % peaks.len()];
        // Half a second each: nothing, press, hold, let go.
        let touch = |peak_n: f64| peak_n * ((time_s - 0.5) / 0.5).min((2.0 - time_s) / 0.5).clamp(0.0, 1.0);
        // Pressed in half a second and then held.
        let held = |load_n: f64| load_n * (time_s / 0.5).min(1.0);
        match self {
            Self::Nothing | Self::Grasp => (0.0, 0.0),
            Self::LightTouches => (touch(peak_n([0.05, 0.1, 0.2, 0.4])), 0.0),
            Self::Touches | Self::Brightness | Self::MoreNoise => (touch(peak_n([1.0, 3.0, 0.5, 6.0])), 0.0),
            Self::QuietHold => (held(3.0), if (0.5..1.0).contains(&time_s) { 0.2 } else { 0.0 }),
            Self::SlowCreep => (held(2.0), if time_s > 0.5 { 0.075 } else { 0.0 }),
            Self::Slide => (held(3.0), if time_s > 1.0 { 1.2 } else { 0.0 }),
        }
    }

    /// After this time the contact ends and the next one begins, s.
    const fn round_s(self) -> f64 {
        match self {
            Self::QuietHold => f64::INFINITY,
            Self::SlowCreep => 15.0,
            Self::Slide => 4.0,
            _ => 2.0,
        }
    }
}

/// A scene as it is played.
pub(super) struct Scene {
    pub(super) rest: Vec<Vec<u8>>,
    world: World,
    frame: usize,
}

enum World {
    Grasp(Box<GripScene>),
    Contact(Box<Touching>),
}

struct Touching {
    kind: Kind,
    number: u64,
    skin: Arc<GelSurface>,
    fingertip: Fingertip,
    contact: Contact,
    drive: Drive,
    round: usize,
}

/// A picture and the normal force that is true in it.
pub(super) struct Frame {
    pub(super) crop: Vec<u8>,
    pub(super) normal_n: f32,
}

impl Scene {
    pub(super) fn new(kind: Kind, skin: &Arc<GelSurface>, seed: u64) -> Result<Self, EvaluationError> {
        let number = seed << 8 | kind as u64;
        let scene = |rest, world| Self {
            rest,
            world,
            frame: 0,
        };
        if kind == Kind::Grasp {
            let mut grasp = GripScene::new(70 + seed);
            let rest = (0..REST_PICTURES).map(|_| grasp.rest_image().pixels).collect();
            return Ok(scene(rest, World::Grasp(Box::new(grasp))));
        }
        let unit = SENSOR | number;
        let mut params = FingertipParams::of_sensor(unit);
        let rest_params = params;
        match kind {
            Kind::MoreNoise => params.noise_levels *= 1.08,
            Kind::Brightness => {
                params.brightness_motion = BrightnessMotion {
                    drift: 0.05,
                    flicker: 0.01,
                    ..BrightnessMotion::default()
                }
            }
            _ => {}
        }
        let mut at_rest = Fingertip::new(unit, rest_params)?;
        let rest = (0..REST_PICTURES).map(|_| at_rest.rest_image().pixels).collect();
        let touching = Touching {
            kind,
            number,
            skin: Arc::clone(skin),
            fingertip: Fingertip::new(unit, params)?,
            contact: contact(skin, number, 0)?,
            drive: start(0),
            round: 0,
        };
        Ok(scene(rest, World::Contact(Box::new(touching))))
    }

    pub(super) fn next(&mut self) -> Result<Frame, EvaluationError> {
        self.frame += 1;
        match &mut self.world {
            World::Grasp(grasp) => {
                // As the demo's gripper holds it, roughly.
                let frame = grasp.step(1.0 / FRAMES_PER_SECOND, 5.0)?;
                Ok(Frame {
                    normal_n: frame.forces.iter().map(|force| force[2]).sum(),
                    crop: frame.image.pixels,
                })
            }
            World::Contact(touching) => touching.next(self.frame as f64 / FRAMES_PER_SECOND),
        }
    }
}

impl Touching {
    fn next(&mut self, time_s: f64) -> Result<Frame, EvaluationError> {
        let round = (time_s / self.kind.round_s()) as usize;
        if round != self.round {
            self.round = round;
            self.contact = contact(&self.skin, self.number, round)?;
            self.drive = start(round);
        }
        let in_round_s = if round == 0 {
            time_s
        } else {
            time_s - round as f64 * self.kind.round_s()
        };
        let (load_n, pull_mm_per_s) = self.kind.load(in_round_s, round);
        self.drive.press = Press::Force(load_n);
        self.drive.at_mm[0] += pull_mm_per_s / FRAMES_PER_SECOND;
        self.contact.go_to(self.drive, 1)?;
        self.fingertip.set_time(time_s);
        let mut crop = Image::crop();
        self.fingertip.render(self.contact.truth(), &mut crop);
        Ok(Frame {
            crop: crop.pixels,
            normal_n: self.contact.truth().force_n()[2] as f32,
        })
    }
}

fn contact(skin: &Arc<GelSurface>, number: u64, round: usize) -> Result<Contact, EvaluationError> {
    let shape = UNSEEN_SHAPES[(number as usize + round) % UNSEEN_SHAPES.len()];
    Ok(Contact::new(
        Arc::clone(skin),
        Arc::new(shape),
        FRICTION,
        Mount::default(),
    )?)
}

fn start(round: usize) -> Drive {
    Drive {
        press: Press::Force(0.0),
        at_mm: [3.0 * (round % 4) as f64 - 4.0, 2.0],
        turn_rad: 0.4,
        tilt_rad: [0.0; 2],
    }
}

/// The gel that all scenes press.
pub(super) fn skin() -> Result<Arc<GelSurface>, EvaluationError> {
    Ok(Arc::new(GelSurface::new(&Gel::default(), 80)?))
}
