//! One grasp under one policy: the loop, and what came of it. Pure except for the world and the session.

use gripline_network::Network;
use gripline_simulation::grasp::{GraspFrame, GraspParts, GraspWorld};
use serde::{Deserialize, Serialize};

use super::super::metrics::quantile;
use super::hold::Hold;
use super::motion::MotionCamera;
use super::oracle::Truth;
use super::pictures::Delivery;
use super::plan::{DEAD_TIME_S, FRAMES_PER_SECOND, GraspPlan, LIFT_S, Times};
use super::policy::{FLOOR_N, Policy, Worker};
use super::sensor::{Model, Rendered, Sensor};
use super::slides::{Moment, slides};
use crate::error::EvaluationError;

/// Lever of a contact's torsion over its radius, even pressure: M = μ N · 2/3 a.
const LEVER: f64 = 2.0 / 3.0;

/// What came of a grasp.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Who gripped.
    pub policy: Policy,
    /// Number of the grasp.
    pub grasp: u64,
    /// What disturbed it.
    pub disturbance: String,
    /// The object left the grip.
    pub dropped: bool,
    /// The contact world found no solution: no evidence.
    pub unsolved: bool,
    /// Distance slid over either skin from the lift to where it stands again, mm; what the table pushes it back into the grip says
    /// nothing of the grip.
    pub micro_slip_mm: f64,
    /// Mean and largest force of a finger from the lift to where it stands again, N.
    pub mean_force_n: f64,
    /// See there.
    pub peak_force_n: f64,
    /// Mean and largest force that friction needs for the load, N: sticking friction of the moment, mean of both fingers.
    pub mean_need_n: f64,
    /// See there.
    pub peak_need_n: f64,
    /// Median over that time of force over need, less one.
    pub margin: Option<f64>,
    /// Slides of the whole contact from the lift to where the table takes it again.
    pub slides: u32,
    /// Maps at which the line fell later than 42 ms after the beginning of a slide that still went on.
    pub late_falls: u32,
    /// From the beginning of a slide to a line that rises, ms; 9,900 when it never did.
    pub rises_ms: Vec<f64>,
    /// Those of slides that began while the object was up.
    pub rises_in_hold_ms: Vec<f64>,
    /// What came of the hold, if the object was held to its end.
    #[serde(default)]
    pub hold: Option<Hold>,
}

/// Plays `plan` under `policy`; `rendered` with pictures instead of the model of the chain.
///
/// # Errors
/// A plan that the world refuses, or a broken session.
pub fn play(
    plan: &GraspPlan,
    policy: Policy,
    fixed_n: f64,
    network: &Network,
    parts: &GraspParts,
    rendered: bool,
) -> Result<Outcome, EvaluationError> {
    let mut world = GraspWorld::with_parts(&plan.scene, parts)?;
    let mut sensor = if rendered {
        Sensor::Rendered(Box::new(Rendered::new(network, plan.distortion, &mut world)?))
    } else {
        Sensor::Model(Box::new(Model::new(network, plan.sensor, plan.distortion)))
    };
    let mut camera = MotionCamera::new(plan.sensor);
    let mut delivery = Delivery::new(&plan.picture_faults);
    let mut worker = Worker::new(policy, network, fixed_n, plan.sensor)?;
    let looks = !matches!(worker, Worker::Fixed(_) | Worker::Oracle(_));
    let frame_s = 1.0 / FRAMES_PER_SECOND;
    let mut tally = Tally::default();
    let mut moments = Vec::new();
    let mut unsolved = false;
    for number in 0..(plan.times.end_s * FRAMES_PER_SECOND) as u32 {
        let came = if looks {
            let (map, health) = sensor.look(&mut world)?;
            let [finger, _] = &world.frame().fingers;
            let touches = finger.forces.iter().any(|force| force[2] > 0.0);
            delivery.deliver(number, (map, health, camera.look(finger.slip_mm, touches)))
        } else {
            None
        };
        let truth = truth(world.frame(), world.truth(0).area_mm2());
        let line_n = worker.line_n(came.as_ref(), truth, frame_s)?;
        let time_s = world.frame().time_s;
        if world.step(frame_s, line_n).is_err() {
            unsolved = true;
            break;
        }
        let area_mm2 = world.truth(0).area_mm2();
        let needed_n = needed_n(world.frame().load, friction(world.frame(), false), area_mm2);
        tally.add(world.frame(), needed_n, plan.times);
        moments.push(Moment {
            time_s,
            line_n,
            slid_s: tally.slid_s(world.frame()),
            slip_mm: tally.slip_mm,
            needed_n,
        });
        if world.frame().dropped {
            break;
        }
    }
    let frames = tally.margins.len().max(1) as f64;
    let slides = slides(
        &moments,
        DEAD_TIME_S,
        [LIFT_S, plan.times.down_s],
        plan.times.up_s,
    );
    Ok(Outcome {
        policy,
        grasp: plan.number,
        disturbance: plan.disturbance.clone(),
        dropped: world.frame().dropped,
        unsolved,
        micro_slip_mm: tally.slip_mm,
        mean_force_n: tally.force_n / frames,
        peak_force_n: tally.peak_force_n,
        mean_need_n: tally.need_n / frames,
        peak_need_n: tally.peak_need_n,
        margin: quantile(&tally.margins, 0.5),
        slides: slides.count,
        late_falls: slides.late_falls,
        rises_ms: slides.rises_ms,
        rises_in_hold_ms: slides.rises_in_hold_ms,
        hold: Hold::of(&moments, [plan.times.up_s, plan.times.put_down_s]),
    })
}

/// Sticking or sliding friction of a frame, mean of both fingers.
fn friction(frame: &GraspFrame, sliding: bool) -> f64 {
    let which = usize::from(sliding);
    0.5 * (frame.fingers[0].friction[which] + frame.fingers[1].friction[which])
}

/// What an oracle knows.
fn truth(frame: &GraspFrame, area_mm2: f64) -> Truth {
    Truth {
        load_n: needed_n(frame.load, 1.0, area_mm2),
        sliding: friction(frame, true),
        slides: frame.slid_s.is_some(),
    }
}

/// What adds up from the lift to where it stands again.
#[derive(Debug, Default)]
struct Tally {
    /// The world's distance slid at the last frame, of each finger.
    before_mm: [f64; 2],
    /// That of the grip, of each finger and the larger.
    fingers_slip_mm: [f64; 2],
    slip_mm: f64,
    /// The table has taken it again.
    stands: bool,
    force_n: f64,
    peak_force_n: f64,
    need_n: f64,
    peak_need_n: f64,
    margins: Vec<f64>,
}

impl Tally {
    /// When it slid in the grip in the frame that was added last; not once the table has taken it again.
    fn slid_s(&self, frame: &GraspFrame) -> Option<[f64; 2]> {
        frame.slid_s.filter(|_| !self.stands)
    }

    fn add(&mut self, frame: &GraspFrame, needed_n: f64, times: Times) {
        let pushed = frame.on_table && frame.time_s >= times.put_down_s;
        self.stands |= pushed;
        for (finger, truth) in frame.fingers.iter().enumerate() {
            // Let go and touched again, it counts from nothing.
            let again = truth.slip_mm < self.before_mm[finger];
            let more_mm = truth.slip_mm - if again { 0.0 } else { self.before_mm[finger] };
            self.before_mm[finger] = truth.slip_mm;
            if frame.time_s >= LIFT_S && !pushed {
                self.fingers_slip_mm[finger] += more_mm;
                self.slip_mm = self.slip_mm.max(self.fingers_slip_mm[finger]);
            }
        }
        if frame.time_s < LIFT_S {
            return;
        }
        // What has left the grip needs no force.
        if frame.on_table || frame.dropped || frame.time_s > times.down_s {
            return;
        }
        self.force_n += frame.grip_n;
        self.peak_force_n = self.peak_force_n.max(frame.grip_n);
        self.need_n += needed_n;
        self.peak_need_n = self.peak_need_n.max(needed_n);
        // Less than the gripper's least force cannot be asked for.
        self.margins.push(frame.grip_n / needed_n.max(FLOOR_N) - 1.0);
    }
}

/// Force of each finger that friction needs for a load on the object at the grip point (N, N, N·mm): where
/// (Q/μN)² + (M/(μN·2/3 a))² = 1 for one finger's half of it, with the contact's present area.
#[must_use]
pub fn needed_n(load: [f64; 3], friction: f64, area_mm2: f64) -> f64 {
    let radius_mm = (area_mm2 / std::f64::consts::PI).sqrt().max(0.5);
    let [x, y, moment] = load.map(|part| 0.5 * part);
    x.hypot(y).hypot(moment / (LEVER * radius_mm)) / friction
}

#[cfg(test)]
mod tests {
    use gripline_network::Architecture;

    use super::super::{GelModel, adverse, nominal};
    use super::*;

    #[test]
    fn the_needed_force_is_half_the_pull_over_friction_and_grows_with_torsion() {
        assert!((needed_n([3.0, -4.0, 0.0], 0.5, 10.0) - 5.0).abs() < 1e-12);
        // A disc of 3 mm: half of 8 N·mm at a lever of 2 mm is 2 N.
        let area = std::f64::consts::PI * 9.0;
        assert!((needed_n([0.0, 0.0, 8.0], 0.5, area) - 4.0).abs() < 1e-12);
        assert!((needed_n([3.0, 0.0, 8.0], 0.5, area) - 5.0).abs() < 1e-12);
    }

    #[test]
    fn gripline_holds_what_half_of_the_needed_force_drops() {
        let network = Network::embedded(Architecture::Unet).unwrap();
        let plan = nominal::grasp(1, 0);
        let parts = GraspParts::new(&plan.scene).unwrap();
        let held = play(&plan, Policy::Gripline, 0.0, &network, &parts, false).unwrap();
        assert!(!held.dropped && !held.unsolved, "{held:?}");
        assert!(
            held.mean_force_n > held.mean_need_n && held.margin.unwrap() > 0.0,
            "{held:?}"
        );
        let half_n = 0.5 * plan.scene.object.min_grip_n(plan.scene.object.weight_n());
        let lost = play(&plan, Policy::Fixed, half_n, &network, &parts, false).unwrap();
        assert!(lost.dropped || lost.peak_need_n < 1e-9, "{lost:?}");
        let again = play(&plan, Policy::Gripline, 0.0, &network, &parts, false).unwrap();
        assert_eq!(held, again);
    }

    #[test]
    fn what_a_table_pushes_an_object_back_into_the_grip_is_no_slip_of_the_grip() {
        let plan = adverse::grasp(1, 0);
        let mut frame = GraspWorld::new(&plan.scene).unwrap().frame().clone();
        let mut tally = Tally::default();
        let mut see = |time_s: f64, on_table: bool, slip_mm: f64| {
            (frame.time_s, frame.on_table) = (time_s, on_table);
            frame.slid_s = Some([time_s - 0.01, time_s]);
            frame.fingers[1].slip_mm = slip_mm;
            tally.add(&frame, 1.0, plan.times);
            let slides = tally.slid_s(&frame).is_some();
            assert_eq!(slides, time_s < plan.times.put_down_s + 0.15, "{time_s} s");
            tally.slip_mm
        };
        let put_down_s = plan.times.put_down_s;
        let slid_mm = [
            see(LIFT_S - 0.1, true, 0.5),
            see(LIFT_S + 0.1, true, 0.75),
            see(put_down_s + 0.1, false, 1.5),
            see(put_down_s + 0.2, true, 4.0),
            // It bounces off and slides on.
            see(put_down_s + 0.3, false, 4.0),
            see(put_down_s + 0.4, false, 4.5),
        ];
        for (slid_mm, expected_mm) in slid_mm.into_iter().zip([0.0, 0.25, 1.0, 1.0, 1.0, 1.5]) {
            assert!((slid_mm - expected_mm).abs() < 1e-12, "{slid_mm} {expected_mm}");
        }
    }

    #[test]
    fn what_has_left_the_grip_needs_no_force() {
        let plan = adverse::grasp(1, 0);
        let mut frame = GraspWorld::new(&plan.scene).unwrap().frame().clone();
        (frame.time_s, frame.on_table, frame.grip_n) = (plan.times.up_s, false, 5.0);
        let mut tally = Tally::default();
        tally.add(&frame, 2.0, plan.times);
        frame.dropped = true;
        tally.add(&frame, 90.0, plan.times);
        assert!(
            (tally.peak_need_n - 2.0).abs() < 1e-12 && tally.margins.len() == 1,
            "{tally:?}"
        );
    }

    /// Outcome of a grasp of the adverse world on springs, under Gripline.
    fn on_springs(seed: u64, number: u64) -> Outcome {
        let network = Network::embedded(Architecture::Tracked).unwrap();
        let mut plan = adverse::grasp(seed, number);
        plan.scene.contact = GelModel::Brush.model();
        let parts = GraspParts::new(&plan.scene).unwrap();
        play(&plan, Policy::Gripline, 0.0, &network, &parts, false).unwrap()
    }

    #[test]
    fn a_large_contact_near_the_edge_is_dropped_no_sooner_than_a_small_one_in_the_middle() {
        let outcome = on_springs(1, 146);
        assert!(
            !outcome.unsolved && (!outcome.dropped || outcome.micro_slip_mm > 9.9),
            "{outcome:?}"
        );
    }

    #[test]
    fn what_slides_out_of_the_grip_slides_although_fresh_gel_sticks() {
        for (seed, number) in [(1, 81), (2, 471)] {
            let outcome = on_springs(seed, number);
            assert!(!outcome.dropped || outcome.slides > 0, "{outcome:?}");
        }
    }

    /// Grasps whose sliding friction falls to between 0.08 and 0.12 in the hold.
    #[test]
    fn the_secure_grip_holds_when_friction_halves_below_the_detectors() {
        let network = Network::embedded(Architecture::Tracked).unwrap();
        for (seed, number) in [(1, 293), (2, 57), (3, 345)] {
            let mut plan = adverse::grasp(seed, number);
            plan.scene.contact = GelModel::Brush.model();
            let parts = GraspParts::new(&plan.scene).unwrap();
            let secure = play(&plan, Policy::GriplineSecure, 0.0, &network, &parts, false).unwrap();
            assert!(!secure.dropped && !secure.unsolved, "{secure:?}");
            assert!(secure.micro_slip_mm < 1.0 && secure.late_falls == 0, "{secure:?}");
        }
    }

    /// Friction falls to two thirds in twenty seconds, while sliding takes a fifth of it: a slide that shows it is hard to stop.
    #[test]
    fn friction_that_fades_slowly_drops_nothing() {
        let network = Network::embedded(Architecture::Tracked).unwrap();
        let parts = GraspParts::new(&nominal::grasp(77, 0).scene).unwrap();
        for number in 0..10 {
            let mut plan = nominal::grasp(77, number).held_longer(20.0).fading(20.0, 0.65);
            plan.scene.contact = GelModel::Brush.model();
            for law in &mut plan.scene.friction_laws {
                law.sliding_share = 0.8;
            }
            let held = play(&plan, Policy::Gripline, 0.0, &network, &parts, false).unwrap();
            assert!(!held.dropped && !held.unsolved, "{held:?}");
            let slid_mm = held.hold.unwrap().slip_mm;
            // Below the detector's friction, which the grip always counts on, only a slide shows it.
            let ends_below = 0.65 * plan.scene.object.friction[0] < 0.45;
            let max_mm = if ends_below { 4.0 } else { 1.0 };
            assert!(slid_mm < max_mm, "grasp {number} slid {slid_mm} mm");
        }
    }

    #[test]
    fn in_the_adverse_world_the_oracle_holds_and_half_its_force_does_not() {
        let network = Network::embedded(Architecture::Unet).unwrap();
        let parts = GraspParts::new(&adverse::grasp(1, 0).scene).unwrap();
        let mut lost = 0;
        for number in 0..4 {
            let plan = adverse::grasp(1, number);
            let oracle = play(&plan, Policy::Oracle, 0.0, &network, &parts, false).unwrap();
            assert!(!oracle.unsolved, "{oracle:?}");
            let half_n = 0.5 * oracle.mean_need_n;
            let half = play(&plan, Policy::Fixed, half_n, &network, &parts, false).unwrap();
            assert!(half.dropped || half.unsolved, "{number}: {half:?}");
            lost += u32::from(oracle.dropped);
        }
        assert!(lost <= 1, "{lost} of 4");
    }
}
