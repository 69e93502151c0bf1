//! The scripted scene of `gripline run`: a sphere between gripper jaws, seen by one fingertip. The
//! gripper's force follows the commanded line with lag and a rate limit; weight, pull and twist act by the
//! clock. Units: mm, N, s. The loads slip away from the grip that the scene starts with, and hold when the
//! grip follows them in time. Limits: one finger's share of all loads, sliding with viscous drag instead of
//! the object's inertia.

use std::sync::Arc;

use crate::constants::{
    SCENE_CONTACT_OFFSET_MM, SCENE_DRAG_N_S_PER_MM, SCENE_DROP_MM, SCENE_GRIPPER_LAG_S, SCENE_GRIPPER_MAX_N,
    SCENE_GRIPPER_RATE_N_PER_S, SCENE_LOOP_S, SCENE_PULL_DIRECTION, SCENE_PULL_N, SCENE_TWIST_NMM,
    SCENE_WEIGHT_N,
};
use crate::contact::{ForceMap, Load, SphereContact, SphereParams};
use crate::error::{SimulationError, checked};
use crate::field::FieldKernels;
use crate::fingertip::{Fingertip, FingertipParams};
use crate::image::Image;
use crate::random::Random;

/// Purpose of the scene's random stream.
const PLACES: u64 = 4;
/// Largest step of gripper and contact, s.
const SUBSTEP_S: f64 = 0.01;
/// Under this the jaws are open, N.
const OPEN_N: f64 = 0.01;

/// What the script does from `from_s` on; loads grow or fall linearly to the ones given at the phase's end.
struct Phase {
    from_s: f64,
    name: &'static str,
    closed: bool,
    weight: f64,
    pull: f64,
    twist: f64,
}

const fn phase(from_s: f64, name: &'static str, closed: bool, [weight, pull, twist]: [f64; 3]) -> Phase {
    Phase {
        from_s,
        name,
        closed,
        weight,
        pull,
        twist,
    }
}

/// Shares of the constants' weight, pull and twist at the end of each phase.
const SCRIPT: [Phase; 12] = [
    phase(0.0, "approach", false, [0.0, 0.0, 0.0]),
    phase(1.0, "touch", true, [0.0, 0.0, 0.0]),
    phase(2.0, "lift", true, [1.0, 0.0, 0.0]),
    phase(2.5, "hold", true, [1.0, 0.0, 0.0]),
    phase(3.5, "pull", true, [1.0, 1.0, 0.0]),
    phase(6.0, "pull", true, [1.0, 1.0, 0.0]),
    phase(6.5, "recover", true, [1.0, 0.0, 0.0]),
    phase(7.5, "twist", true, [1.0, 0.0, 1.0]),
    phase(9.0, "twist", true, [1.0, 0.0, 1.0]),
    phase(9.4, "recover", true, [1.0, 0.0, 0.0]),
    phase(10.2, "set down", true, [0.0, 0.0, 0.0]),
    phase(10.8, "release", false, [0.0, 0.0, 0.0]),
];

/// One frame of the scene.
#[derive(Debug, Clone)]
pub struct SceneFrame {
    /// Time since the scene began, s.
    pub time_s: f64,
    /// What the script does now: approach, touch, lift, hold, pull, recover, twist, set down, release; or
    /// lost, when the object has slid out of the grip and the script waits for its next round.
    pub phase: &'static str,
    /// Whether the sphere touches the skin.
    pub touching: bool,
    /// The gripper's normal force, and what pulls and twists the object, before any friction limit.
    pub load: Load,
    /// True share of the contact area that sticks; none when nothing touches.
    pub true_stick_ratio: Option<f64>,
    /// Whether the object slides as a whole.
    pub gross_slip: bool,
    /// How far its skin contact slid since it was grasped, mm (spin counts at the contact's rim).
    pub slip_mm: f64,
    /// The true forces, N per taxel.
    pub forces: ForceMap,
    /// The camera's crop, 440 x 440.
    pub image: Image,
}

/// The scripted scene; it repeats every 12 s with the contact at another place.
#[derive(Debug, Clone)]
pub struct GripScene {
    fingertip: Fingertip,
    contact: SphereContact,
    places: Random,
    time_s: f64,
    round: u64,
    grip_n: f64,
    spun_mm: f64,
    lost: bool,
}

impl GripScene {
    /// The scene whose fingertip, noise and contact places follow from `seed`.
    ///
    /// # Panics
    /// Never: the crate's own constants are valid parameters.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let params = FingertipParams::default();
        let kernels = Arc::new(FieldKernels::new(&params.gel));
        let fingertip = Fingertip::with_kernels(seed, params, kernels).expect("default parameters are valid");
        let mut places = Random::new(seed, PLACES);
        let contact = next_contact(&mut places);
        Self {
            fingertip,
            contact,
            places,
            time_s: 0.0,
            round: 0,
            grip_n: 0.0,
            spun_mm: 0.0,
            lost: false,
        }
    }

    /// The camera's crop when nothing touches, 440 x 440.
    pub fn rest_image(&mut self) -> Image {
        self.fingertip.rest_image()
    }

    /// Advances by `dt_s` with the grip-force line at `line_n` newtons, and looks.
    ///
    /// # Errors
    /// A step outside 0 to 0.1 s, a line that is negative or not finite, a contact step that does not
    /// converge.
    pub fn step(&mut self, dt_s: f64, line_n: f64) -> Result<SceneFrame, SimulationError> {
        checked("dt_s", dt_s, "above 0, at most 0.1 s", |dt| dt > 0.0 && dt <= 0.1)?;
        checked("line_n", line_n, "a finite number, 0 or above", |line| {
            line >= 0.0
        })?;
        let substeps = (dt_s / SUBSTEP_S).ceil();
        let mut load = Load::default();
        for _ in 0..substeps as usize {
            load = self.advance(dt_s / substeps, line_n)?;
        }
        self.fingertip.set_time(self.time_s);
        let state = self.contact.state();
        let touching = state.in_contact();
        let mut image = Image::crop();
        self.fingertip.render(touching.then_some(state), &mut image);
        Ok(SceneFrame {
            time_s: self.time_s,
            phase: if self.lost { "lost" } else { at(self.time_s).0.name },
            touching,
            load,
            true_stick_ratio: touching.then(|| state.true_stick_ratio()),
            gross_slip: state.gross_slip(),
            slip_mm: state.slip_distance_mm() + self.spun_mm,
            forces: state.force_map(),
            image,
        })
    }

    fn advance(&mut self, dt_s: f64, line_n: f64) -> Result<Load, SimulationError> {
        self.time_s += dt_s;
        let round = (self.time_s / SCENE_LOOP_S) as u64;
        if round != self.round {
            self.round = round;
            self.lost = false;
            self.grip_n = 0.0;
            self.spun_mm = 0.0;
            self.contact = next_contact(&mut self.places);
        }
        let (phase, [weight, pull, twist]) = at(self.time_s);
        let wanted = if phase.closed && !self.lost {
            line_n.min(SCENE_GRIPPER_MAX_N)
        } else {
            0.0
        };
        let change = (wanted - self.grip_n) * (1.0 - libm::exp(-dt_s / SCENE_GRIPPER_LAG_S));
        let most = SCENE_GRIPPER_RATE_N_PER_S * dt_s;
        self.grip_n += change.clamp(-most, most);
        let normal_n = if self.grip_n < OPEN_N { 0.0 } else { self.grip_n };
        let load = Load {
            normal_n,
            shear_n: [
                pull * SCENE_PULL_N * SCENE_PULL_DIRECTION[0],
                pull * SCENE_PULL_N * SCENE_PULL_DIRECTION[1] - weight * SCENE_WEIGHT_N,
            ],
            torsion_nmm: twist * SCENE_TWIST_NMM,
        };
        let state = self.contact.step(load)?;
        if state.gross_slip() {
            let held = state.load();
            // v = excess / drag; the moment's excess acts as a force at the rim.
            let way = dt_s / SCENE_DRAG_N_S_PER_MM;
            let by = [0, 1].map(|k| (load.shear_n[k] - held.shear_n[k]) * way);
            self.spun_mm += (load.torsion_nmm - held.torsion_nmm).abs() / state.radius_mm() * way;
            self.contact.slide(by)?;
            if self.contact.state().slip_distance_mm() + self.spun_mm > SCENE_DROP_MM {
                self.lost = true;
            }
        }
        Ok(load)
    }
}

/// The phase at `time_s`, and the shares of weight, pull and twist.
fn at(time_s: f64) -> (&'static Phase, [f64; 3]) {
    let in_round = time_s % SCENE_LOOP_S;
    let now = SCRIPT
        .iter()
        .rposition(|phase| phase.from_s <= in_round)
        .unwrap_or(0);
    let phase = &SCRIPT[now];
    let end = SCRIPT.get(now + 1).map_or(SCENE_LOOP_S, |next| next.from_s);
    let way = (in_round - phase.from_s) / (end - phase.from_s);
    let before = now.checked_sub(1).map_or(phase, |last| &SCRIPT[last]);
    let between = |from: f64, to: f64| from + way * (to - from);
    let shares = [
        between(before.weight, phase.weight),
        between(before.pull, phase.pull),
        between(before.twist, phase.twist),
    ];
    (phase, shares)
}

fn next_contact(places: &mut Random) -> SphereContact {
    let offset = SCENE_CONTACT_OFFSET_MM;
    let centre_mm = [places.uniform(-offset, offset), places.uniform(-offset, offset)];
    SphereContact::new(SphereParams {
        centre_mm,
        ..SphereParams::default()
    })
    .expect("default parameters are valid")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constants::SCENE_INITIAL_GRIP_N;

    const FRAME_S: f64 = 1.0 / 60.0;

    /// One round of the scene, without looking through the camera, under a grip law; (time, load, state)
    /// per frame.
    fn round(mut law: impl FnMut(&SphereContact) -> f64) -> Vec<(f64, Load, f64, bool, bool)> {
        let mut scene = GripScene::new(3);
        let mut frames = Vec::new();
        while scene.time_s + FRAME_S < SCENE_LOOP_S {
            let line = law(&scene.contact);
            scene.advance(FRAME_S / 2.0, line).unwrap();
            let load = scene.advance(FRAME_S / 2.0, line).unwrap();
            let state = scene.contact.state();
            frames.push((
                scene.time_s,
                load,
                state.true_stick_ratio(),
                state.gross_slip(),
                state.in_contact(),
            ));
        }
        frames
    }

    #[test]
    fn held_at_the_first_grip_the_object_slips_in_the_pull_and_is_lost() {
        let frames = round(|_| SCENE_INITIAL_GRIP_N);
        let first = frames.iter().find(|f| f.3).expect("gross slip").0;
        assert!(first > 3.5 && first < 6.5, "slips at {first} s");
        assert!(frames.iter().rev().take(30).all(|f| !f.4));
    }

    #[test]
    fn held_at_the_first_grip_the_twist_alone_would_spin_the_object() {
        let mut contact = next_contact(&mut Random::new(1, PLACES));
        let load = Load {
            normal_n: SCENE_INITIAL_GRIP_N,
            shear_n: [0.0, -SCENE_WEIGHT_N],
            torsion_nmm: SCENE_TWIST_NMM,
        };
        assert!(contact.step(load).unwrap().gross_slip());
    }

    #[test]
    fn a_grip_that_rises_when_the_stick_ratio_falls_never_slips() {
        let mut line = SCENE_INITIAL_GRIP_N;
        let frames = round(|contact| {
            let state = contact.state();
            if !state.in_contact() {
                line = SCENE_INITIAL_GRIP_N;
            } else if state.true_stick_ratio() < 0.6 {
                line += 0.3;
            }
            line
        });
        assert!(frames.iter().all(|f| !f.3), "gross slip");
        let lowest = frames.iter().map(|f| f.2).fold(1.0, f64::min);
        let highest = frames.iter().map(|f| f.1.normal_n).fold(0.0, f64::max);
        assert!(lowest < 0.6 && lowest > 0.1, "lowest stick ratio {lowest}");
        assert!(
            highest > 1.3 * SCENE_INITIAL_GRIP_N && highest < 10.0,
            "highest grip {highest}"
        );
    }

    #[test]
    fn nothing_touches_in_the_first_second_and_the_gripper_then_follows_its_line_with_lag() {
        let frames = round(|_| 4.0);
        assert!(frames.iter().all(|f| f.0 > 0.99 || !f.4));
        let force = |time: f64| frames.iter().find(|f| f.0 > time).unwrap().1.normal_n;
        assert!(
            force(1.02) < 2.5 && (force(1.4) - 4.0).abs() < 0.01,
            "{} {}",
            force(1.02),
            force(1.4)
        );
        assert!(frames.last().unwrap().1.normal_n == 0.0);
    }

    #[test]
    fn frames_repeat_bit_for_bit_and_carry_the_truth() {
        let run = || {
            let mut scene = GripScene::new(9);
            let rest = scene.rest_image();
            let mut last = None;
            for _ in 0..20 {
                last = Some(scene.step(0.1, 3.0).unwrap());
            }
            (rest, last.unwrap())
        };
        let ((rest, frame), (rest_again, again)) = (run(), run());
        assert!(rest == rest_again && frame.image == again.image && frame.forces == again.forces);
        assert!(frame.touching && frame.image != rest && frame.true_stick_ratio.is_some());
        let normal: f32 = frame.forces.iter().map(|f| f[2]).sum();
        assert!((f64::from(normal) / frame.load.normal_n - 1.0).abs() < 0.005);
    }

    #[test]
    fn bad_steps_are_named() {
        let mut scene = GripScene::new(1);
        let error = scene.step(0.0, 1.0).unwrap_err().to_string();
        assert_eq!(error, "dt_s is 0, expected above 0, at most 0.1 s");
        assert!(scene.step(0.016, f64::NAN).is_err());
        assert!(scene.step(0.016, -1.0).is_err());
    }
}
