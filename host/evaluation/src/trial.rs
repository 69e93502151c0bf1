//! One run of the paper's experiment in the contact world: an object is gripped with a constant force, and a hand makes
//! it slip by translation and rotation, one after the other, with rests between. Quasi-static; one finger of the two,
//! which carries half of weight and hand. Units: s, mm, rad, N, N·mm.
//! Limits: the grip does not react; nothing is assumed of the paper's hands but that they pull until it slides.

use std::sync::Arc;

use gripline_simulation::contact_world::{Contact, Drive, GelSurface, HeightMap, Mount, Press, Truth};
use gripline_simulation::grasp::{Object, Patch};
use gripline_simulation::{Gel, Random, SimulationError};

/// Frames a second of the camera.
pub const FRAMES_PER_SECOND: f64 = 60.0;
/// Purpose of a trial's random numbers.
const TRIAL: u64 = 71;
/// Grip, N: what people take for such objects, more where the weight needs it.
const GRIP_N: [f64; 2] = [1.5, 4.0];
/// Share of what friction holds that weight alone may use.
const WEIGHT_SHARE: f64 = 0.4;
/// Spring of hand and arm, one finger's half: mm/N and rad/(N·mm).
const HAND: Mount = Mount {
    shift_mm_per_n: 1.0,
    turn_rad_per_nmm: 0.01,
};
/// Time to close, to lift.
const PRESS_S: f64 = 0.5;
const LIFT_S: f64 = 0.3;
/// Time from the first pull to sliding, as planned from a plain estimate of what friction holds.
const RAMP_S: [f64; 2] = [0.4, 1.0];
/// Time that it slides.
const SLIDE_S: [f64; 2] = [0.4, 0.8];
/// Speeds while it slides, mm/s and rad/s.
const SLIDE_MM_PER_S: [f64; 2] = [4.0, 10.0];
const SLIDE_RAD_PER_S: [f64; 2] = [0.4, 1.2];
/// From breakaway to that speed.
const GATHER_S: f64 = 0.1;
/// Time in which the hand lets go.
const RELEASE_S: [f64; 2] = [0.10, 0.15];
/// Rest between slips; the hand's spring has settled after the first part of it.
const REST_S: [f64; 2] = [0.6, 1.0];
const SETTLE_S: f64 = 0.2;
/// A pull that has not made it slide after this many planned ramps is over.
const PATIENCE: f64 = 4.0;
/// No hand pulls straight: turn in a translation, rad, and shift in a rotation, mm, at breakaway.
const STRAY_RAD: f64 = 0.02;
const STRAY_MM: f64 = 0.2;
/// The contact's middle stays this close to the sensor's, mm.
const REACH_MM: f64 = 5.0;
/// Friction differs from run to run by this share: dust, humidity.
const FRICTION_SPREAD: f64 = 0.05;
/// Radius of a usual contact, for plans only, mm.
const RADIUS_MM: f64 = 3.0;
/// A hold's shear over its normal force: up to what the controller itself keeps (0.45 less a margin of 40 %).
const HOLD_RATIO: [f64; 2] = [0.10, 0.32];
/// Tremor of a hold: share of its load, and frequencies, Hz.
const TREMOR: f64 = 0.05;
const TREMOR_HZ: [f64; 2] = [0.7, 2.3];
/// Longest way of the hand in a step of the solver, cells.
const STEP_CELLS: f64 = 0.5;

/// How a contact slips.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Along the skin.
    Translation,
    /// About the normal.
    Rotation,
}

/// What a run does.
#[derive(Debug, Clone, PartialEq)]
pub enum Script {
    /// Slips, one after the other.
    Slips(Vec<Kind>),
    /// Holds still for this many seconds.
    Hold(f64),
}

/// One run.
#[derive(Debug, Clone)]
pub struct Trial {
    /// What is gripped.
    pub object: Object,
    /// What happens.
    pub script: Script,
    /// What is random about it follows from this number.
    pub seed: u64,
    /// The virtual sensor that looks.
    pub sensor: u64,
}

/// Part of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Closing and lifting.
    Grip,
    /// Only weight pulls.
    Rest,
    /// The hand pulls: slip number, from 0.
    Pull(usize),
    /// The hand lets go.
    Release(usize),
}

/// What is true of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthFrame {
    /// Time since the start.
    pub time_s: f64,
    /// Part of the run.
    pub part: Part,
    /// Share of the contact that sticks; none when nothing touches.
    pub stick_ratio: Option<f64>,
    /// The contact slides as a whole.
    pub gross_slip: bool,
    /// Force of the object on the skin.
    pub force_n: [f64; 3],
    /// Moment about where the object stands.
    pub torsional_moment_nmm: f64,
}

/// A run under way.
#[derive(Debug)]
pub struct Experiment {
    script: Script,
    random: Random,
    contact: Contact,
    pitch_mm: f64,
    friction: f64,
    grip_n: f64,
    /// What weight does to one finger: N, N, N·mm.
    weight: [f64; 3],
    drive: Drive,
    time_s: f64,
    stage: Stage,
    began_s: f64,
    slip: usize,
}

#[derive(Debug, Clone, Copy)]
enum Stage {
    Press,
    Lift,
    /// Until when; how much of the hand is left.
    Rest {
        until_s: f64,
    },
    Pull(Pull),
    Release {
        over_s: f64,
        hand: [f64; 3],
    },
    Hold {
        load_n: f64,
        direction: [f64; 2],
        until_s: f64,
    },
    Done,
}

#[derive(Debug, Clone, Copy)]
struct Pull {
    from: Drive,
    /// Way of the hand so far and its speed: mm, mm, rad a second.
    way: [f64; 3],
    ramp_per_s: [f64; 3],
    slide_per_s: [f64; 3],
    ramp_s: f64,
    slide_s: f64,
    /// When it began to slide.
    broke_s: Option<f64>,
}

impl Experiment {
    /// At its start: nothing touches. `skin` is that of the sensor.
    ///
    /// # Errors
    /// Those of the contact world.
    pub fn new(trial: &Trial, skin: &Arc<GelSurface>) -> Result<Self, SimulationError> {
        let mut random = Random::new(trial.seed, TRIAL);
        let object = &trial.object;
        let friction = object.friction[0] * random.uniform(1.0 - FRICTION_SPREAD, 1.0 + FRICTION_SPREAD);
        let half_n = 0.5 * object.weight_n();
        let weight = [0.0, -half_n, -half_n * object.centre_of_mass_mm[0]];
        // Plain estimates of what a grip of 1 N holds: pull, and twist of an even pressure.
        let needs_n = half_n.hypot(weight[2] / (2.0 / 3.0 * RADIUS_MM)) / friction / WEIGHT_SHARE;
        let grip_n = random.uniform(GRIP_N[0], GRIP_N[1]).max(needs_n);
        let indenter: Arc<dyn HeightMap> = match &object.patch {
            Patch::Shape(shape) => Arc::new(*shape),
            Patch::Any(surface) => Arc::clone(surface),
        };
        let contact = Contact::new(Arc::clone(skin), indenter, friction, HAND)?;
        let at_mm = [random.uniform(-2.0, 2.0), random.uniform(-2.0, 2.0)];
        let drive = Drive {
            press: Press::Force(0.0),
            at_mm,
            turn_rad: object.patch_turn_rad + random.uniform(-0.2, 0.2),
            tilt_rad: [0.0; 2],
        };
        Ok(Self {
            script: trial.script.clone(),
            random,
            contact,
            pitch_mm: skin.pitch_mm(),
            friction,
            grip_n,
            weight,
            drive,
            time_s: 0.0,
            stage: Stage::Press,
            began_s: 0.0,
            slip: 0,
        })
    }

    /// Friction of this run.
    #[must_use]
    pub fn friction(&self) -> f64 {
        self.friction
    }

    /// Grip of this run, N.
    #[must_use]
    pub fn grip_n(&self) -> f64 {
        self.grip_n
    }

    /// The contact now.
    #[must_use]
    pub fn contact(&self) -> &Truth {
        self.contact.truth()
    }

    /// Goes to the next frame; none after the last.
    ///
    /// # Errors
    /// Those of the contact world: the run is no evidence from there on.
    pub fn advance(&mut self) -> Result<Option<TruthFrame>, SimulationError> {
        self.next_stage();
        let frame_s = 1.0 / FRAMES_PER_SECOND;
        let since_s = self.time_s - self.began_s + frame_s;
        let mut moving = true;
        let (part, target) = match &mut self.stage {
            Stage::Done => return Ok(None),
            Stage::Press => {
                let share = (since_s / PRESS_S).min(1.0);
                let press = Press::Force(self.grip_n * share.powf(1.5));
                (Part::Grip, Drive { press, ..self.drive })
            }
            Stage::Lift => {
                let share = (since_s / LIFT_S).min(1.0);
                (Part::Grip, self.loaded(self.weight.map(|part| part * share)))
            }
            Stage::Rest { .. } => {
                moving = since_s <= SETTLE_S;
                (Part::Rest, self.loaded(self.weight))
            }
            Stage::Hold {
                load_n, direction, ..
            } => {
                let turns = TREMOR_HZ.map(|hz| (std::f64::consts::TAU * hz * since_s).sin());
                let settle = (since_s / LIFT_S).min(1.0);
                let load_n = *load_n * settle * (1.0 + 0.5 * TREMOR * (turns[0] + turns[1]));
                let [x, y] = direction.map(|part| part * load_n);
                let part = if since_s < LIFT_S + SETTLE_S {
                    Part::Grip
                } else {
                    Part::Rest
                };
                (part, self.loaded([x, y, 0.0]))
            }
            Stage::Release { over_s, hand } => {
                let left = 1.0 - smooth(since_s / *over_s);
                let load = [0, 1, 2].map(|k| self.weight[k] + left * hand[k]);
                (Part::Release(self.slip), self.loaded(load))
            }
            Stage::Pull(pull) => {
                let gathered = pull
                    .broke_s
                    .map_or(0.0, |at| smooth((self.time_s + frame_s - at) / GATHER_S));
                for k in 0..3 {
                    let speed = pull.ramp_per_s[k] * (1.0 - gathered) + pull.slide_per_s[k] * gathered;
                    pull.way[k] += speed * frame_s;
                }
                let [x, y, turn] = pull.way;
                let target = Drive {
                    at_mm: [pull.from.at_mm[0] + x, pull.from.at_mm[1] + y],
                    turn_rad: pull.from.turn_rad + turn,
                    ..pull.from
                };
                (Part::Pull(self.slip), target)
            }
        };
        if moving {
            self.go_to(target)?;
        }
        self.time_s += frame_s;
        let truth = self.contact.truth();
        if let Stage::Pull(pull) = &mut self.stage
            && pull.broke_s.is_none()
            && truth.gross_slip()
        {
            pull.broke_s = Some(self.time_s);
        }
        Ok(Some(TruthFrame {
            time_s: self.time_s,
            part,
            stick_ratio: truth.stick_ratio(),
            gross_slip: truth.gross_slip(),
            force_n: truth.force_n(),
            torsional_moment_nmm: truth.torsional_moment_nmm(truth.footprint_mm()),
        }))
    }

    fn go_to(&mut self, target: Drive) -> Result<(), SimulationError> {
        let way = (target.at_mm[0] - self.drive.at_mm[0])
            .hypot(target.at_mm[1] - self.drive.at_mm[1])
            .max(RADIUS_MM * (target.turn_rad - self.drive.turn_rad).abs());
        let steps = (way / (STEP_CELLS * self.pitch_mm)).ceil().max(1.0) as u32;
        self.contact.go_to(target, steps)?;
        self.drive = target;
        Ok(())
    }

    /// Where the hand must be so that this load acts, from where the object is: exact once the object rests.
    fn loaded(&self, [x, y, moment]: [f64; 3]) -> Drive {
        let pose = self.contact.truth().pose();
        Drive {
            press: Press::Force(self.grip_n),
            at_mm: [
                pose.at_mm[0] + HAND.shift_mm_per_n * x,
                pose.at_mm[1] + HAND.shift_mm_per_n * y,
            ],
            turn_rad: pose.turn_rad + HAND.turn_rad_per_nmm * moment,
            tilt_rad: self.drive.tilt_rad,
        }
    }

    /// Begins what comes next if what was is over.
    fn next_stage(&mut self) {
        let now_s = self.time_s + 1e-9;
        let since_s = now_s - self.began_s;
        let next = match self.stage {
            Stage::Press if since_s >= PRESS_S => match self.script {
                Script::Slips(_) => Stage::Lift,
                Script::Hold(seconds) => self.hold(seconds),
            },
            Stage::Lift if since_s >= LIFT_S => self.rest(),
            Stage::Rest { until_s } if now_s >= until_s => self.pull(),
            Stage::Hold { until_s, .. } if now_s >= until_s => Stage::Done,
            Stage::Release { over_s, .. } if since_s >= over_s => {
                self.slip += 1;
                self.rest()
            }
            Stage::Pull(pull) => {
                let over = match pull.broke_s {
                    Some(broke_s) => now_s - broke_s >= pull.slide_s,
                    None => since_s >= PATIENCE * pull.ramp_s,
                };
                if !over {
                    return;
                }
                let [x, y, _] = self.contact.truth().force_n();
                let torsion = self.torsional_moment_nmm();
                Stage::Release {
                    over_s: self.random.uniform(RELEASE_S[0], RELEASE_S[1]),
                    hand: [x - self.weight[0], y - self.weight[1], torsion - self.weight[2]],
                }
            }
            _ => return,
        };
        self.stage = next;
        self.began_s = self.time_s;
    }

    fn torsional_moment_nmm(&self) -> f64 {
        let truth = self.contact.truth();
        truth.torsional_moment_nmm(truth.footprint_mm())
    }

    fn rest(&mut self) -> Stage {
        Stage::Rest {
            until_s: self.time_s + self.random.uniform(REST_S[0], REST_S[1]),
        }
    }

    fn hold(&mut self, seconds: f64) -> Stage {
        Stage::Hold {
            load_n: self.grip_n * self.random.uniform(HOLD_RATIO[0], HOLD_RATIO[1]),
            direction: self.random.direction(),
            until_s: self.time_s + seconds,
        }
    }

    /// Plans the next pull; the end if there is none.
    fn pull(&mut self) -> Stage {
        let Script::Slips(kinds) = &self.script else {
            return Stage::Done;
        };
        let Some(&kind) = kinds.get(self.slip) else {
            return Stage::Done;
        };
        let truth = self.contact.truth();
        let radius_mm = (truth.area_mm2() / std::f64::consts::PI).sqrt();
        let limit_n = self.friction * self.grip_n;
        let [shift_mm, turn_rad] = breakaway(limit_n, radius_mm);
        let at = truth.pose().at_mm;
        let ramp_s = self.random.uniform(RAMP_S[0], RAMP_S[1]);
        let slide_s = self.random.uniform(SLIDE_S[0], SLIDE_S[1]);
        let mut direction = self.random.direction();
        let sign = if self.random.unit() < 0.5 { -1.0 } else { 1.0 };
        let stray = self.random.uniform(-1.0, 1.0);
        let (ramp, slide) = match kind {
            Kind::Translation => {
                let speed = self.random.uniform(SLIDE_MM_PER_S[0], SLIDE_MM_PER_S[1]);
                // Towards the middle if it would leave it too far behind.
                let end = [0, 1].map(|k| at[k] + direction[k] * speed * slide_s);
                if end[0].hypot(end[1]) > REACH_MM && at[0] * direction[0] + at[1] * direction[1] > 0.0 {
                    direction = direction.map(|part| -part);
                }
                let [x, y] = direction;
                let turn = stray * STRAY_RAD;
                (
                    [x * shift_mm, y * shift_mm, turn],
                    [x * speed, y * speed, turn / ramp_s],
                )
            }
            Kind::Rotation => {
                let speed = sign * self.random.uniform(SLIDE_RAD_PER_S[0], SLIDE_RAD_PER_S[1]);
                let [x, y] = direction.map(|part| part * stray * STRAY_MM);
                ([x, y, sign * turn_rad], [x / ramp_s, y / ramp_s, speed])
            }
        };
        Stage::Pull(Pull {
            from: self.drive,
            way: [0.0; 3],
            ramp_per_s: ramp.map(|way| way / ramp_s),
            slide_per_s: slide,
            ramp_s,
            slide_s,
            broke_s: None,
        })
    }
}

/// Way and turn of the hand until a contact of radius `radius_mm` slides under the friction bound `limit_n`: the hand's
/// spring and the skin's (half-space and plain layer side by side, as in Mindlin 1949).
fn breakaway(limit_n: f64, radius_mm: f64) -> [f64; 2] {
    let gel = Gel::default();
    let (g, a) = (gel.shear_modulus_mpa(), radius_mm.max(0.3));
    let column = g * std::f64::consts::PI * a * a / gel.thickness_mm;
    let moment_nmm = 3.0 * std::f64::consts::PI / 16.0 * limit_n * a;
    let shift = limit_n / (16.0 * g * a / (3.0 * (2.0 - gel.poisson)) + column);
    let turn = moment_nmm / (16.0 * g * a * a * a / 3.0 + 0.5 * column * a * a);
    [
        shift + HAND.shift_mm_per_n * limit_n,
        2.0 * turn + HAND.turn_rad_per_nmm * moment_nmm,
    ]
}

/// From 0 to 1 with rest at both ends.
fn smooth(share: f64) -> f64 {
    let share = share.clamp(0.0, 1.0);
    share.powi(3) * (10.0 + share * (6.0 * share - 15.0))
}

#[cfg(test)]
mod tests;
