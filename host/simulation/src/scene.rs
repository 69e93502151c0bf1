//! The scripted scene of `gripline run`: an object on a table, gripped, lifted, pulled, twisted and set down, as
//! one fingertip sees it. A script on the grasp world; weight, pull and torsion act by the clock. Units: mm, N, s.
//! The loads slip away from the grip that the scene starts with, and hold when the grip follows them in time.

use crate::constants::{
    SCENE_CONTACT_OFFSET_MM, SCENE_FRICTION, SCENE_INERTIA_G_MM2, SCENE_LIFT_MM, SCENE_LOOP_S, SCENE_MASS_G,
    SCENE_PULL_DIRECTION, SCENE_PULL_N, SCENE_SPHERE_RADIUS_MM, SCENE_TORSIONAL_MOMENT_NMM,
};
use crate::contact_world::Shape;
use crate::error::{SimulationError, checked};
use crate::fingertip::{Fingertip, FingertipParams};
use crate::force_map::{ForceMap, Load};
use crate::grasp::{Course, GraspParts, GraspScene, GraspWorld, Object, Patch, Pull, Stroke};
use crate::image::Image;
use crate::random::Random;

/// Purpose of the scene's random stream.
const PLACES: u64 = 4;

/// What the script does from a time on, s, and whether the jaws follow the line then.
const SCRIPT: [(f64, &str, bool); 10] = [
    (0.0, "approach", false),
    (1.0, "touch", true),
    (2.0, "lift", true),
    (2.5, "hold", true),
    (3.5, "pull", true),
    (6.5, "recover", true),
    (7.5, "twist", true),
    (9.4, "recover", true),
    (10.2, "set down", true),
    (10.8, "release", false),
];

/// One frame of the scene.
#[derive(Debug, Clone)]
pub struct SceneFrame {
    /// Time since the scene began, s.
    pub time_s: f64,
    /// What the script does now: approach, touch, lift, hold, pull, recover, twist, set down, release; or
    /// lost, when the object has slid out of the grip and the script waits for its next round.
    pub phase: &'static str,
    /// Whether the object touches the gel.
    pub touching: bool,
    /// The gripper's normal force, and this finger's half of what pulls and twists the object, before any
    /// friction limit.
    pub load: Load,
    /// True share of the contact area that sticks; none when nothing touches.
    pub true_stick_ratio: Option<f64>,
    /// Whether the object slides as a whole.
    pub gross_slip: bool,
    /// How far its gel contact slid since it was grasped, mm (spin counts at the contact's radius of gyration).
    pub slip_mm: f64,
    /// The true forces, N per taxel.
    pub forces: ForceMap,
    /// The camera's crop, 440 x 440.
    pub image: Image,
}

/// The scripted scene; it repeats every 12 s with the object gripped at another place.
#[derive(Debug)]
pub struct GripScene {
    seed: u64,
    /// The second finger's is made when it is first looked through.
    fingertips: [Option<Box<Fingertip>>; 2],
    parts: GraspParts,
    world: GraspWorld,
    places: Random,
    time_s: f64,
}

impl GripScene {
    /// The scene whose fingertip, noise and grip points follow from `seed`.
    ///
    /// # Panics
    /// Never: the crate's own constants are valid parameters.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut places = Random::new(seed, PLACES);
        let scene = next_grasp(&mut places);
        let parts = GraspParts::new(&scene).expect("the script's constants are valid");
        let world = GraspWorld::with_parts(&scene, &parts).expect("the script's constants are valid");
        Self {
            seed,
            fingertips: [None, None],
            parts,
            world,
            places,
            time_s: 0.0,
        }
    }

    /// The first finger's crop when nothing touches, 440 x 440.
    pub fn rest_image(&mut self) -> Image {
        self.rest_image_of(0)
    }

    /// The same of either finger.
    ///
    /// # Panics
    /// When `finger` is not 0 or 1.
    pub fn rest_image_of(&mut self, finger: usize) -> Image {
        self.fingertip(finger).rest_image()
    }

    /// Advances by `dt_s` with the grip-force line at `line_n` newtons, and looks through the first finger.
    ///
    /// # Errors
    /// A step outside 0 to 0.1 s, a line that is negative or not finite, a contact step that does not
    /// converge.
    pub fn step(&mut self, dt_s: f64, line_n: f64) -> Result<SceneFrame, SimulationError> {
        self.step_seen_by(0, dt_s, line_n)
    }

    /// The same seen by either finger, loads and forces in its own frame: the second one faces the first, so its x points
    /// the other way.
    ///
    /// # Errors
    /// As [`Self::step`].
    ///
    /// # Panics
    /// When `finger` is not 0 or 1.
    pub fn step_seen_by(
        &mut self,
        finger: usize,
        dt_s: f64,
        line_n: f64,
    ) -> Result<SceneFrame, SimulationError> {
        let phase = self.advance(dt_s, line_n)?;
        let time_s = self.time_s;
        let mut image = Image::crop();
        let fingertip = fingertip(&mut self.fingertips[finger], self.seed, &self.parts, finger);
        fingertip.set_time(time_s);
        fingertip.render(self.world.truth(finger), &mut image);
        let frame = self.world.frame();
        let half = if finger == 0 { 0.5 } else { -0.5 };
        let [pull_x, pull_y, torsion] = frame.load;
        let [pull_x, pull_y, torsion] = [half * pull_x, 0.5 * pull_y, half * torsion];
        let finger = &frame.fingers[finger];
        Ok(SceneFrame {
            time_s: self.time_s,
            phase,
            touching: finger.touching,
            load: Load {
                normal_n: frame.grip_n,
                shear_n: [pull_x, pull_y],
                torsional_moment_nmm: torsion,
            },
            true_stick_ratio: finger.stick_ratio,
            gross_slip: finger.gross_slip,
            slip_mm: finger.slip_mm,
            forces: finger.forces,
            image,
        })
    }

    fn fingertip(&mut self, finger: usize) -> &mut Fingertip {
        fingertip(&mut self.fingertips[finger], self.seed, &self.parts, finger)
    }

    /// Advances without looking; what the script does then.
    fn advance(&mut self, dt_s: f64, line_n: f64) -> Result<&'static str, SimulationError> {
        checked("line_n", line_n, "a finite number, 0 or above", |line| {
            line >= 0.0
        })?;
        if self.world.frame().time_s + 0.5 * dt_s > SCENE_LOOP_S {
            self.world = GraspWorld::with_parts(&next_grasp(&mut self.places), &self.parts)?;
        }
        let closed = at(self.world.frame().time_s + dt_s).1 && !self.world.frame().dropped;
        let frame = self.world.step(dt_s, if closed { line_n } else { 0.0 })?;
        self.time_s += dt_s;
        Ok(if frame.dropped { "lost" } else { at(frame.time_s).0 })
    }
}

/// A finger's gel; that of the second is another one of the same make.
fn fingertip<'a>(
    known: &'a mut Option<Box<Fingertip>>,
    seed: u64,
    parts: &GraspParts,
    finger: usize,
) -> &'a mut Fingertip {
    known.get_or_insert_with(|| {
        let seed = seed ^ (finger as u64) << 32;
        let made = parts.fingertip(seed, FingertipParams::default());
        Box::new(made.expect("default parameters are valid"))
    })
}

/// The phase at `time_s` of a round, and whether the jaws follow the line.
fn at(time_s: f64) -> (&'static str, bool) {
    let now = SCRIPT
        .iter()
        .rposition(|phase| phase.0 <= time_s + 1e-9)
        .unwrap_or(0);
    (SCRIPT[now].1, SCRIPT[now].2)
}

/// The script's loads on its object, gripped at the next place.
fn next_grasp(places: &mut Random) -> GraspScene {
    let object = Object {
        name: "knob".into(),
        mass_g: SCENE_MASS_G,
        inertia_g_mm2: SCENE_INERTIA_G_MM2,
        centre_of_mass_mm: [0.0; 2],
        size_mm: [40.0, 40.0, 40.0],
        patch: Patch::Shape(Shape::Sphere {
            radius_mm: SCENE_SPHERE_RADIUS_MM,
        }),
        patch_turn_rad: 0.0,
        friction: [SCENE_FRICTION; 2],
    };
    let offset = SCENE_CONTACT_OFFSET_MM;
    let mut scene = GraspScene::new(object);
    scene.grip_point_mm = [places.uniform(-offset, offset), places.uniform(-offset, offset)];
    scene.arm.strokes = [(2.0, 0.5, 1.0), (10.2, 0.6, -1.0)]
        .map(|(from_s, duration_s, way)| Stroke::Move {
            from_s,
            duration_s,
            by_mm: [0.0, way * SCENE_LIFT_MM],
        })
        .to_vec();
    let course = |times: [f64; 4]| {
        let [from, full, until, gone] = times;
        Course::linear(vec![[from, 0.0], [full, 1.0], [until, 1.0], [gone, 0.0]])
    };
    scene.pulls = vec![
        Pull::force(
            SCENE_PULL_DIRECTION.map(|part| part * 2.0 * SCENE_PULL_N),
            course([3.5, 6.0, 6.5, 7.5]),
        ),
        Pull::torsion(2.0 * SCENE_TORSIONAL_MOMENT_NMM, course([7.5, 9.0, 9.4, 10.2])),
    ];
    scene
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constants::SCENE_INITIAL_GRIP_N;
    use crate::grasp::GraspFrame;

    const FRAME_S: f64 = 1.0 / 60.0;

    /// One round of the scene, without looking through the camera, under a grip law.
    fn round(mut law: impl FnMut(&GraspFrame) -> f64) -> Vec<(&'static str, GraspFrame)> {
        let mut scene = GripScene::new(3);
        (0..720)
            .map(|_| {
                let line = law(scene.world.frame());
                let phase = scene.advance(FRAME_S, line).unwrap();
                (phase, scene.world.frame().clone())
            })
            .collect()
    }

    #[test]
    fn held_at_the_first_grip_the_twist_alone_would_spin_the_object() {
        let mut scene = next_grasp(&mut Random::new(1, PLACES));
        scene.pulls.remove(0);
        let mut world = GraspWorld::new(&scene).unwrap();
        let mut slipped = 0.0;
        while world.frame().time_s < 9.3 && slipped == 0.0 {
            if world.step(FRAME_S, SCENE_INITIAL_GRIP_N).unwrap().slip {
                slipped = world.frame().time_s;
            }
        }
        assert!(slipped > 7.5, "{slipped}");
    }

    #[test]
    fn nothing_touches_in_the_first_second_and_the_gripper_then_follows_its_line_with_lag() {
        let frames = round(|_| 6.0);
        let touching = |frame: &GraspFrame| frame.fingers[0].touching;
        assert!(
            frames
                .iter()
                .all(|(_, frame)| frame.time_s > 0.99 || !touching(frame))
        );
        // Three frames at the largest rate, 60 N/s.
        let force = |time: f64| frames.iter().find(|(_, f)| f.time_s > time).unwrap().1.grip_n;
        assert!(
            (force(1.02) - 3.0).abs() < 0.01 && (force(1.4) - 6.0).abs() < 0.01,
            "{} {}",
            force(1.02),
            force(1.4)
        );
        let (phase, last) = frames.last().unwrap();
        assert!(*phase == "release" && last.grip_n == 0.0 && last.on_table && !last.dropped);
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
    fn the_second_finger_feels_the_first_ones_load_from_the_other_side() {
        let mut scene = GripScene::new(3);
        let rest = [0, 1].map(|finger| scene.rest_image_of(finger));
        assert!(rest[0] != rest[1], "two gels");
        let mut seen = None;
        for _ in 0..270 {
            // Into the pull.
            seen = Some([0, 1].map(|finger| scene.step_seen_by(finger, 0.5 * FRAME_S, 8.0).unwrap()));
        }
        let [first, second] = seen.unwrap();
        assert_eq!(first.phase, "pull");
        let sum = |frame: &SceneFrame, axis: usize| frame.forces.iter().map(|f| f[axis]).sum::<f32>();
        let (x, other_x) = (sum(&first, 0), sum(&second, 0));
        let (y, other_y) = (sum(&first, 1), sum(&second, 1));
        assert!(x.abs() > 0.1 && (x + other_x).abs() < 0.05, "{x} and {other_x}");
        assert!(y.abs() > 0.1 && (y - other_y).abs() < 0.05, "{y} and {other_y}");
        assert!((first.load.shear_n[0] + second.load.shear_n[0]).abs() < 0.05);
        assert!(second.image != rest[1] && second.image != first.image);
    }

    #[test]
    fn bad_steps_are_named() {
        let mut scene = GripScene::new(1);
        let error = scene.step(0.0, 1.0).unwrap_err().to_string();
        assert_eq!(error, "dt_s is 0, expected above 0, at most 0.1 s");
        assert!(scene.step(0.016, f64::NAN).is_err());
        assert!(scene.step(0.016, -1.0).is_err());
    }

    /// Only `cargo xtask test --all` runs these.
    mod slow {
        use super::*;

        #[test]
        fn held_at_the_first_grip_the_object_slips_in_the_pull_and_is_lost() {
            let frames = round(|_| SCENE_INITIAL_GRIP_N);
            let (phase, first) = frames.iter().find(|(_, frame)| frame.slip).expect("gross slip");
            assert_eq!(*phase, "pull", "{} s", first.time_s);
            let (phase, last) = frames.last().unwrap();
            assert!(*phase == "lost" && !last.fingers[0].touching);
        }

        #[test]
        fn a_grip_that_rises_when_the_stick_ratio_falls_never_slips() {
            let mut line = SCENE_INITIAL_GRIP_N;
            let frames = round(|frame| {
                match frame.fingers[0].stick_ratio {
                    None => line = SCENE_INITIAL_GRIP_N,
                    Some(ratio) if ratio < 0.6 => line += 0.3,
                    Some(_) => {}
                }
                line
            });
            assert!(frames.iter().all(|(_, frame)| !frame.slip), "gross slip");
            // Letting go, the last hundredths of a newton may slide: the object stands on the table.
            let ratios = frames
                .iter()
                .filter(|(phase, _)| *phase != "release")
                .filter_map(|(_, frame)| frame.fingers[0].stick_ratio);
            let lowest = ratios.fold(1.0, f64::min);
            let highest = frames.iter().map(|(_, frame)| frame.grip_n).fold(0.0, f64::max);
            assert!(lowest < 0.6 && lowest > 0.1, "lowest stick ratio {lowest}");
            assert!(
                highest > 1.3 * SCENE_INITIAL_GRIP_N && highest < 10.0,
                "highest grip {highest}"
            );
        }
    }
}
