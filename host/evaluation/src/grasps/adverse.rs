//! Random grasps as a bad day brings them: friction that is less while the object slides, unlike from place to place and
//! lower all at once; a wet finger beside a dry one; load that is poured in, knocked and swung; forces that are off;
//! pictures that are black, late, missing or repeated; a gripper that is slow or sticks. Every number of a grasp follows
//! from the seed and the grasp's number. Units: s, mm, N, N·mm, g. Limits: the grip axis is level.

use gripline_simulation::contact_world::Texture;
use gripline_simulation::grasp::{
    ArmMotion, Course, FrictionLaw, GraspScene, Gripper, Object, Patch, Pull, Stroke,
};
use gripline_simulation::{FingertipParams, Random};

use super::distortion::Distortion;
use super::pictures::{Kind, PictureFault};
use super::plan::{
    CELLS, DEAD_TIME_S, FIRST_SENSOR, FRAMES_PER_SECOND, GraspPlan, LIFT_S, LOADING_MM, LOADING_S,
    NEWTONS_PER_GRAM, Times, shape,
};

/// Purpose of a grasp's random numbers.
const GRASP: u64 = 74;
/// Grip that the object's weight needs while it slides, before friction drops, N. A wide range: one force cannot suit all,
/// and the hardest need more than the ceiling.
const NEEDS_N: [f64; 2] = [0.6, 10.0];
/// True sticking friction: from below the detector's.
const FRICTION: [f64; 2] = [0.2, 1.2];
/// A wet finger has this share of the dry one's friction, but not less than the least.
const WET: [f64; 2] = [0.4, 0.8];
/// Sliding over sticking friction, and the speed at which most of the difference is gone, mm/s.
const SLIDING: [f64; 2] = [0.6, 1.0];
const SLIDING_MM_PER_S: [f64; 2] = [0.5, 5.0];
/// Friction's difference from place to place, and over what distance.
const TEXTURE: [f64; 2] = [0.0, 0.15];
const TEXTURE_MM: [f64; 2] = [4.0, 12.0];
/// What is left of friction after a drop.
const DROP: [f64; 2] = [0.5, 0.9];
/// What is poured in, share of what was there.
const POURED: [f64; 2] = [0.2, 0.8];
/// Speed that a knock gives the free object, m/s, and how long it takes.
const KNOCK_M_PER_S: [f64; 2] = [0.02, 0.1];
const KNOCK_S: [f64; 2] = [0.02, 0.04];
/// Acceleration of the swing, mm/s², and its frequency.
const SWING_MM_PER_S2: [f64; 2] = [1_000.0, 3_000.0];
const SWING_HZ: [f64; 2] = [2.0, 4.0];
/// What a newton reads.
const GAIN: [f64; 2] = [0.75, 1.25];
const CREEP: [f64; 2] = [0.0, 0.15];
const CREEP_S: [f64; 2] = [0.3, 2.0];
const HYSTERESIS: [f64; 2] = [0.0, 0.05];
/// Time constant of the slow gripper, and how far the sticking one stays behind, N.
const SLOW_S: f64 = 0.1;
const STICK_N: [f64; 2] = [0.1, 0.5];
/// Maximum pictures of a picture fault, and maximum number of faults per grasp.
const FAULT_PICTURES_MAX: usize = 6;
const PICTURE_FAULTS_MAX: usize = 4;
/// An object that slid this far from where it was gripped has left the grip (assumed: five eighths of the way from a pad's middle to
/// its edge). A large contact hangs over the edge by then.
const LOST_MM: f64 = 10.0;
/// Longest distance in a step of the solver, so that sliding is noticed within some milliseconds.
const REACH_MM: f64 = 0.1;
/// When the hold begins, and when the arm puts the object down.
const UP_S: f64 = 1.7;
const PUT_DOWN_S: f64 = 4.1;
const DOWN_S: f64 = 4.7;
const END_S: f64 = 4.8;

/// Grasp number `number`.
#[must_use]
pub fn grasp(seed: u64, number: u64) -> GraspPlan {
    let own = seed * 1_000_000 + number;
    let mut random = Random::new(own, GRASP);
    let within = |random: &mut Random, [from, to]: [f64; 2]| random.uniform(from, to);
    let mut happens = Vec::new();
    let friction = frictions(&mut random, &mut happens);
    let sliding_share = within(&mut random, SLIDING);
    let law = FrictionLaw {
        sliding_share,
        speed_mm_per_s: random.log_uniform(SLIDING_MM_PER_S[0], SLIDING_MM_PER_S[1]),
        course: Course::constant(1.0),
        texture: Some(Texture {
            depth: within(&mut random, TEXTURE),
            wavelength_mm: within(&mut random, TEXTURE_MM),
            phase_rad: [0, 1].map(|_| random.uniform(0.0, std::f64::consts::TAU)),
        }),
    };
    // What is poured in is part of it.
    let holds = sliding_share * (friction[0] + friction[1]);
    let mass_g = holds * random.log_uniform(NEEDS_N[0], NEEDS_N[1]) / NEWTONS_PER_GRAM;
    let size_mm = [30.0, 60.0, 30.0].map(|side| side * random.uniform(0.7, 1.4));
    let sensor = FIRST_SENSOR + own;
    let mut scene = GraspScene {
        grip_point_mm: [random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0)],
        cells: CELLS,
        fingertips: [FingertipParams::of_sensor(sensor); 2],
        seed: sensor,
        drop_mm: LOST_MM,
        reach_mm: Some(REACH_MM),
        ..GraspScene::new(Object {
            name: "random".into(),
            mass_g,
            inertia_g_mm2: mass_g * (size_mm[0].powi(2) + size_mm[1].powi(2)) / 12.0,
            centre_of_mass_mm: [random.uniform(-2.0, 2.0), random.uniform(-12.0, 0.0)],
            size_mm,
            patch: Patch::Shape(shape(&mut random)),
            patch_turn_rad: random.uniform(0.0, std::f64::consts::PI),
            friction,
        })
    };
    scene.friction_laws = [law.clone(), law];
    scene.gripper = gripper(&mut random, &mut happens);
    drop_friction(&mut scene, &mut random, &mut happens);
    load(&mut scene, &mut random, &mut happens);
    let distortion = Distortion {
        gain: [0; 3].map(|_| within(&mut random, GAIN)),
        creep: within(&mut random, CREEP),
        creep_s: within(&mut random, CREEP_S),
        hysteresis: within(&mut random, HYSTERESIS),
    };
    GraspPlan {
        number,
        scene,
        times: Times {
            up_s: UP_S,
            put_down_s: PUT_DOWN_S,
            down_s: DOWN_S,
            end_s: END_S,
        },
        disturbance: happens.join(", "),
        sensor,
        distortion: Some(distortion),
        picture_faults: picture_faults(&mut random),
    }
}

/// Sticking friction of both fingers.
fn frictions(random: &mut Random, happens: &mut Vec<&'static str>) -> [f64; 2] {
    let dry = random.uniform(FRICTION[0], FRICTION[1]);
    let wet = (dry * random.uniform(WET[0], WET[1])).max(FRICTION[0]);
    match random.below(6) {
        0 => {
            happens.push("finger 0 wet");
            [wet, dry]
        }
        1 => {
            happens.push("finger 1 wet");
            [dry, wet]
        }
        _ => [dry; 2],
    }
}

fn gripper(random: &mut Random, happens: &mut Vec<&'static str>) -> Gripper {
    let common = Gripper {
        dead_time_s: DEAD_TIME_S,
        ..Gripper::default()
    };
    let stick_n = random.uniform(STICK_N[0], STICK_N[1]);
    if random.below(2) == 0 {
        happens.push("slow gripper");
        Gripper {
            lag_s: SLOW_S,
            ..common
        }
    } else {
        happens.push("sticking gripper");
        Gripper { stick_n, ..common }
    }
}

/// Friction drops in the middle of half of the holds.
fn drop_friction(scene: &mut GraspScene, random: &mut Random, happens: &mut Vec<&'static str>) {
    let (at_s, left) = (random.uniform(UP_S + 0.1, 3.6), random.uniform(DROP[0], DROP[1]));
    if random.below(2) == 0 {
        happens.push("friction drops");
        for law in &mut scene.friction_laws {
            law.course = Course::linear(vec![[0.0, 1.0], [at_s, 1.0], [at_s, left]]);
        }
    }
}

/// Lifting and putting down, and what is poured, knocked and swung.
fn load(scene: &mut GraspScene, random: &mut Random, happens: &mut Vec<&'static str>) {
    let lift_mm = random.uniform(20.0, 60.0);
    let along = |from_s: f64, duration_s: f64, by_mm: f64| Stroke::Move {
        from_s,
        duration_s,
        by_mm: [0.0, by_mm],
    };
    let mut strokes = vec![
        along(LIFT_S, LOADING_S, LOADING_MM),
        along(LIFT_S + LOADING_S, random.uniform(0.6, 0.8), lift_mm),
        along(PUT_DOWN_S, DOWN_S - PUT_DOWN_S, -lift_mm - LOADING_MM),
    ];
    let (poured, from_s) = (random.uniform(POURED[0], POURED[1]), random.uniform(UP_S, 2.6));
    if random.unit() < 0.3 {
        happens.push("pour");
        // What was poured in belongs to the mass that the need was chosen for.
        let before = 1.0 / (1.0 + poured);
        scene.mass_share = Course::linear(vec![[from_s, before], [from_s + 1.2, 1.0]]);
    }
    let (accelerates, frequency_hz) = (
        random.uniform(SWING_MM_PER_S2[0], SWING_MM_PER_S2[1]),
        random.uniform(SWING_HZ[0], SWING_HZ[1]),
    );
    let (from_s, [x, y]) = (random.uniform(UP_S, 3.0), random.direction());
    if random.unit() < 0.4 {
        happens.push("swing");
        let amplitude = accelerates / (std::f64::consts::TAU * frequency_hz).powi(2);
        strokes.push(Stroke::Shake {
            from_s,
            duration_s: 1.1,
            amplitude_mm: [amplitude * x, amplitude * y],
            frequency_hz,
        });
    }
    let (speed, lasts_s) = (
        random.uniform(KNOCK_M_PER_S[0], KNOCK_M_PER_S[1]),
        random.uniform(KNOCK_S[0], KNOCK_S[1]),
    );
    let (from_s, [x, y]) = (random.uniform(UP_S, 3.9), random.direction());
    if random.unit() < 0.4 {
        happens.push("knock");
        // N·s: the course is an impulse of 1.
        let impulse = 1e-3 * scene.object.mass_g * speed;
        let pull = Pull::force([impulse * x, impulse * y], Course::impulse(from_s, lasts_s));
        scene.pulls.push(pull);
    }
    scene.arm = ArmMotion { strokes };
}

/// Faults of pictures while something is held.
fn picture_faults(random: &mut Random) -> Vec<PictureFault> {
    let kinds = [
        Kind::Black,
        Kind::Missing,
        Kind::Late,
        Kind::Repeated,
        Kind::Frozen,
    ];
    let mut all: Vec<PictureFault> = (0..random.below(PICTURE_FAULTS_MAX + 1))
        .map(|_| PictureFault {
            kind: kinds[random.below(kinds.len())],
            from: (random.uniform(LIFT_S, DOWN_S) * FRAMES_PER_SECOND) as u32,
            count: 1 + random.below(FAULT_PICTURES_MAX) as u32,
        })
        .collect();
    // One at a time.
    all.sort_by_key(|fault| fault.from);
    all.dedup_by(|next, before| next.from < before.from + before.count);
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grasp_repeats_by_its_number_and_adversities_cover_their_ranges() {
        let plans: Vec<GraspPlan> = (0..400).map(|number| grasp(1, number)).collect();
        for plan in &plans {
            let again = grasp(1, plan.number);
            assert_eq!(
                plan.scene.object.mass_g.to_bits(),
                again.scene.object.mass_g.to_bits()
            );
            assert_eq!(plan.picture_faults, again.picture_faults);
            assert_eq!(plan.disturbance, again.disturbance);
            let scene = &plan.scene;
            for friction in scene.object.friction {
                assert!((FRICTION[0]..=FRICTION[1]).contains(&friction));
            }
            let sliding = scene.friction_laws[0].sliding_share * scene.object.friction.iter().sum::<f64>();
            let needs_n = scene.object.weight_n() / sliding;
            assert!(
                needs_n > NEEDS_N[0] - 1e-3 && needs_n < NEEDS_N[1] + 1e-3,
                "{needs_n} N"
            );
        }
        let share = |what: &str| {
            plans
                .iter()
                .filter(|plan| plan.disturbance.contains(what))
                .count() as f64
                / plans.len() as f64
        };
        for (what, expected) in [
            ("wet", 1.0 / 3.0),
            ("slow", 0.5),
            ("sticking", 0.5),
            ("drops", 0.5),
            ("pour", 0.3),
            ("swing", 0.4),
            ("knock", 0.4),
        ] {
            assert!((share(what) - expected).abs() < 0.08, "{what}: {}", share(what));
        }
        for kind in [
            Kind::Black,
            Kind::Missing,
            Kind::Late,
            Kind::Repeated,
            Kind::Frozen,
        ] {
            assert!(
                plans
                    .iter()
                    .any(|plan| plan.picture_faults.iter().any(|fault| fault.kind == kind))
            );
        }
        let below = plans
            .iter()
            .filter(|plan| plan.scene.object.friction[0] < 0.45)
            .count();
        assert!(below > 60, "{below} of 400 below the detector's friction");
    }
}
