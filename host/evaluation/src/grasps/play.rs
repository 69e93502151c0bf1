//! One grasp under one policy: the loop, and what came of it. Pure but for the world and the session.

use gripline_network::Network;
use gripline_simulation::grasp::{GraspFrame, GraspParts, GraspWorld};
use serde::{Deserialize, Serialize};

use super::super::metrics::quantile;
use super::plan::{DOWN_S, END_S, GraspPlan, LIFT_S};
use super::policy::{FLOOR_N, Policy, Worker};
use super::sensor::{Model, Rendered, Sensor};
use gripline_recording::error::Failure;

/// Frames a second.
const FRAMES_PER_SECOND: f64 = 60.0;
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
    /// Way slid over either skin from the lift on, mm.
    pub micro_slip_mm: f64,
    /// Mean and largest force of a finger from the lift to where it stands again, N.
    pub mean_force_n: f64,
    /// See there.
    pub peak_force_n: f64,
    /// Mean and largest force that friction needs for the load, N.
    pub mean_need_n: f64,
    /// See there.
    pub peak_need_n: f64,
    /// Median over that time of force over need, less one.
    pub margin: Option<f64>,
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
) -> Result<Outcome, Failure> {
    let mut world = GraspWorld::with_parts(&plan.scene, parts).map_err(Failure::failed)?;
    let mut sensor = if rendered {
        Sensor::Rendered(Box::new(Rendered::new(network, &mut world)?))
    } else {
        Sensor::Model(Box::new(Model::new(network, plan.sensor)))
    };
    let friction = plan.scene.object.friction[0];
    let mut worker = Worker::new(policy, network, fixed_n)?;
    let frame_s = 1.0 / FRAMES_PER_SECOND;
    let mut tally = Tally::default();
    let mut unsolved = false;
    for _ in 0..(END_S * FRAMES_PER_SECOND) as usize {
        // A fixed force looks at nothing.
        let line_n = if let Worker::Fixed(force_n) = worker {
            force_n
        } else {
            let (map, health) = sensor.look(&mut world)?;
            worker.line_n(&map, health, frame_s)?
        };
        if world.step(frame_s, line_n).is_err() {
            unsolved = true;
            break;
        }
        let area_mm2 = world.truth(0).area_mm2();
        tally.add(world.frame(), friction, area_mm2);
        if world.frame().dropped {
            break;
        }
    }
    let frames = tally.margins.len().max(1) as f64;
    Ok(Outcome {
        policy,
        grasp: plan.number,
        disturbance: plan.disturbance.to_owned(),
        dropped: world.frame().dropped,
        unsolved,
        micro_slip_mm: tally.slip_mm,
        mean_force_n: tally.force_n / frames,
        peak_force_n: tally.peak_force_n,
        mean_need_n: tally.need_n / frames,
        peak_need_n: tally.peak_need_n,
        margin: quantile(&tally.margins, 0.5),
    })
}

/// What adds up from the lift to where it stands again.
#[derive(Debug, Default)]
struct Tally {
    slip_before_mm: [f64; 2],
    slip_mm: f64,
    force_n: f64,
    peak_force_n: f64,
    need_n: f64,
    peak_need_n: f64,
    margins: Vec<f64>,
}

impl Tally {
    fn add(&mut self, frame: &GraspFrame, friction: f64, area_mm2: f64) {
        let slid = frame.fingers.each_ref().map(|finger| finger.slip_mm);
        if frame.time_s < LIFT_S {
            self.slip_before_mm = slid;
            return;
        }
        for (slid, before) in slid.iter().zip(self.slip_before_mm) {
            self.slip_mm = self.slip_mm.max(slid - before);
        }
        if frame.on_table || frame.time_s > DOWN_S {
            return;
        }
        let need_n = needed_n(frame.load, friction, area_mm2);
        self.force_n += frame.grip_n;
        self.peak_force_n = self.peak_force_n.max(frame.grip_n);
        self.need_n += need_n;
        self.peak_need_n = self.peak_need_n.max(need_n);
        // Less than the gripper's least force cannot be asked for.
        self.margins.push(frame.grip_n / need_n.max(FLOOR_N) - 1.0);
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

    use super::super::plan::grasp;
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
        let plan = grasp(1, 0);
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
}
