//! Random grasps as a fair day brings them: an object on a table is gripped, lifted, disturbed, put down. Every number of a grasp follows from the
//! seed and the grasp's number. Units: s, mm, N, N·mm, g. Limits: both fingers alike; the grip axis is level.

use gripline_simulation::grasp::{ArmMotion, Course, GraspScene, Gripper, Object, Patch, Pull, Stroke};
use gripline_simulation::{FingertipParams, Random};

use super::plan::{
    CELLS, DEAD_TIME_S, FIRST_SENSOR, GraspPlan, LIFT_S, LOADING_MM, LOADING_S, NEEDS_N, NEWTONS_PER_GRAM,
    Times, shape,
};

/// Purpose of a grasp's random numbers.
const GRASP: u64 = 72;
/// True friction: above the detector's, as the design asks for.
const FRICTION: [f64; 2] = [0.5, 1.0];
/// When the grasp is disturbed, and when the arm puts the object down.
const DISTURB_S: f64 = 1.6;
const PUT_DOWN_S: f64 = 2.5;
/// When the object stands again, and the end.
const DOWN_S: f64 = 3.1;
const END_S: f64 = 3.2;

/// Grasp number `number`.
#[must_use]
pub fn grasp(seed: u64, number: u64) -> GraspPlan {
    let own = seed * 1_000_000 + number;
    let mut random = Random::new(own, GRASP);
    let object = object(&mut random);
    let weight_n = object.weight_n();
    let sensor = FIRST_SENSOR + own;
    let mut scene = GraspScene {
        gripper: Gripper {
            dead_time_s: DEAD_TIME_S,
            ..Gripper::default()
        },
        grip_point_mm: [random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0)],
        cells: CELLS,
        fingertips: [FingertipParams::of_sensor(sensor); 2],
        seed: sensor,
        ..GraspScene::new(object)
    };
    let lift_mm = random.uniform(20.0, 60.0);
    let lift_s = random.uniform(0.6, 0.8);
    let along = |from_s: f64, duration_s: f64, by_mm: [f64; 2]| Stroke::Move {
        from_s,
        duration_s,
        by_mm,
    };
    let mut strokes = vec![
        along(LIFT_S, LOADING_S, [0.0, LOADING_MM]),
        along(LIFT_S + LOADING_S, lift_s, [0.0, lift_mm]),
        along(PUT_DOWN_S, DOWN_S - PUT_DOWN_S, [0.0, -lift_mm - LOADING_MM]),
    ];
    let rise_s = random.uniform(0.15, 0.4);
    let bump = |share: f64| {
        Course::smooth(vec![
            [DISTURB_S, 0.0],
            [DISTURB_S + rise_s, share],
            [DISTURB_S + rise_s + 0.2, share],
            [DISTURB_S + 2.0 * rise_s + 0.2, 0.0],
        ])
    };
    let [x, y] = random.direction();
    let disturbance = match random.below(5) {
        0 => "none",
        1 => {
            let frequency_hz = random.uniform(2.0, 4.0);
            let amplitude = random.uniform(2.0, 5.0);
            strokes.push(Stroke::Shake {
                from_s: DISTURB_S,
                duration_s: 1.0_f64.max(2.0 / frequency_hz),
                amplitude_mm: [amplitude * x, amplitude * y],
                frequency_hz,
            });
            "shake"
        }
        2 => {
            let way_mm = random.uniform(30.0, 100.0);
            let side = if x < 0.0 { -1.0 } else { 1.0 };
            strokes.push(Stroke::Dash {
                from_s: DISTURB_S,
                duration_s: 0.6,
                by_mm: [side * way_mm, 0.0],
                stop_s: random.uniform(0.08, 0.2),
            });
            "dash"
        }
        3 => {
            let force_n = random.uniform(0.3, 1.0) * weight_n;
            scene
                .pulls
                .push(Pull::force([force_n * x, force_n * y], bump(1.0)));
            "pull"
        }
        _ => {
            let torsional_moment_nmm = random.uniform(0.5, 2.0) * weight_n * x.signum();
            scene.pulls.push(Pull::torsion(torsional_moment_nmm, bump(1.0)));
            "twist"
        }
    };
    scene.arm = ArmMotion { strokes };
    GraspPlan {
        number,
        scene,
        times: Times {
            up_s: DISTURB_S,
            put_down_s: PUT_DOWN_S,
            down_s: DOWN_S,
            end_s: END_S,
        },
        disturbance: disturbance.to_owned(),
        sensor,
        distortion: None,
        picture_faults: Vec::new(),
    }
}

/// What is grasped.
fn object(random: &mut Random) -> Object {
    let friction = random.uniform(FRICTION[0], FRICTION[1]);
    let mass_g = 2.0 * friction * random.log_uniform(NEEDS_N[0], NEEDS_N[1]) / NEWTONS_PER_GRAM;
    let size_mm = [30.0, 60.0, 30.0].map(|side| side * random.uniform(0.7, 1.4));
    Object {
        name: "random".into(),
        mass_g,
        inertia_g_mm2: mass_g * (size_mm[0].powi(2) + size_mm[1].powi(2)) / 12.0,
        centre_of_mass_mm: [random.uniform(-2.0, 2.0), random.uniform(-12.0, 0.0)],
        size_mm,
        patch: Patch::Shape(shape(random)),
        patch_turn_rad: random.uniform(0.0, std::f64::consts::PI),
        friction: [friction; 2],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grasp_repeats_by_its_number_and_its_weight_needs_a_force_within_the_range() {
        for number in 0..200 {
            let (one, again) = (grasp(1, number), grasp(1, number));
            assert_eq!(
                one.scene.object.mass_g.to_bits(),
                again.scene.object.mass_g.to_bits()
            );
            let needs_n = one.scene.object.min_grip_n(one.scene.object.weight_n());
            assert!(
                needs_n > NEEDS_N[0] - 1e-3 && needs_n < NEEDS_N[1] + 1e-3,
                "{needs_n} N"
            );
        }
        let mut kinds: Vec<String> = (0..50).map(|number| grasp(1, number).disturbance).collect();
        kinds.sort_unstable();
        kinds.dedup();
        assert_eq!(kinds, ["dash", "none", "pull", "shake", "twist"]);
    }
}
