//! Whole scenes: the press scenes of the example files frame by frame, and every object lifted, shaken, pulled and
//! twisted between two fingertips; their maps are held to what gripper, weight, arm and pulls apply.

use std::path::Path;

use gripline_simulation::grasp::{Course, GraspScene, GraspWorld, OBJECTS, Pull, Stroke};
use gripline_simulation::scene_file::{Scene, SceneFile};
use gripline_simulation::{ForceMap, PressWorld};

use crate::failure::Failure;
use crate::report::{Bound, Report, Worst};
use crate::world::World;

/// The example scenes.
const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../simulation/scenes");
const FRAME_S: f64 = 1.0 / 60.0;
const SECONDS: f64 = 2.5;
/// Loads below this count as none, N.
const TOUCH_N: f64 = 1e-3;
/// Grip against what the object's weight needs with friction on both sides.
const GRIP_OF_NEED: f64 = 1.6;

fn sums(map: &ForceMap) -> [f64; 3] {
    map.iter().fold([0.0; 3], |sum, taxel| {
        std::array::from_fn(|axis| sum[axis] + f64::from(taxel[axis]))
    })
}

/// Frames and worst figures.
#[derive(Default)]
struct SceneLedger {
    frames: usize,
    left_out: usize,
    normal: Worst,
    tangential: Worst,
}

/// Plays the example files that press. Frames that do not converge are counted.
fn pressed(found: &mut SceneLedger) -> Result<(), Failure> {
    for entry in std::fs::read_dir(FOLDER)? {
        let path = entry?.path();
        if path.extension().is_none_or(|end| end != "toml") {
            continue;
        }
        let text = std::fs::read_to_string(&path)?;
        let load = &mut |name: &Path| std::fs::read(Path::new(FOLDER).join(name));
        let file = SceneFile::parse(&path, &text, load)?;
        let Scene::Press(scene) = &file.scene else {
            continue;
        };
        let mut world = PressWorld::new(scene, &file.sensor.params.gel, file.frames_per_second)?;
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        loop {
            let frame = match world.advance() {
                Ok(Some(frame)) => frame,
                Ok(None) => break,
                Err(_) => {
                    found.left_out += 1;
                    continue;
                }
            };
            found.frames += 1;
            let Some(asked) = frame.load_n.filter(|asked| *asked > TOUCH_N) else {
                continue;
            };
            let off = 100.0 * (sums(&frame.truth.force_map())[2] / asked - 1.0).abs();
            found
                .normal
                .see(off, || format!("{name} at {:.2} s", frame.time_s));
        }
    }
    Ok(())
}

/// Plays a grasp of each of the first `objects` objects.
fn grasped(found: &mut SceneLedger, objects: usize) -> Result<(), Failure> {
    for object in &OBJECTS[..objects] {
        let grip_n = GRIP_OF_NEED * object.weight_n() / (object.friction[0] + object.friction[1]);
        let mut scene = GraspScene::new(object.clone());
        scene.arm.strokes = vec![Stroke::Move {
            from_s: 0.7,
            duration_s: 0.5,
            by_mm: [5.0, 20.0],
        }];
        let swell = |from: f64| Course::linear(vec![[from, 0.0], [from + 0.4, 1.0], [from + 0.5, 0.0]]);
        scene.pulls = vec![
            Pull::force([0.3 * object.weight_n(), -0.2 * object.weight_n()], swell(1.3)),
            Pull::torsion(2.0 * object.weight_n(), swell(1.9)),
        ];
        let mut world = GraspWorld::new(&scene)?;
        while world.frame().time_s < SECONDS {
            let frame = world.step(FRAME_S, grip_n)?;
            found.frames += 1;
            let at = || format!("{}, {:.2} s", object.name, frame.time_s);
            found.tangential.see(100.0 * frame.balance, at);
            for finger in frame.fingers.iter().filter(|finger| finger.touching) {
                let off = 100.0 * (sums(&finger.forces)[2] / frame.grip_n - 1.0).abs();
                found.normal.see(off, at);
            }
        }
    }
    Ok(())
}

pub(crate) fn run(world: &World, report: &mut Report) -> Result<(), Failure> {
    let mut found = SceneLedger::default();
    pressed(&mut found)?;
    let objects = if world.quick { 3 } else { 10 };
    grasped(&mut found, objects)?;
    report.row(
        "scenes_normal",
        &format!(
            "sum of the map's normal forces, every frame of the example presses and of {objects} grasps"
        ),
        "pressing or gripping force",
        Bound::AtMost(0.1),
        (found.normal.value, "%"),
        &format!("{} frames; {}", found.frames, found.normal.at),
    );
    report.row(
        "scenes_tangential",
        &format!("forces and moment of both fingertips, every step of {objects} grasps"),
        "weight, arm, pulls, table and inertia",
        Bound::AtMost(0.1),
        (found.tangential.value, "%"),
        &found.tangential.at,
    );
    report.row(
        "scenes_left_out",
        "frames of them that did not converge (left out of data)",
        "count",
        Bound::Reported,
        (found.left_out as f64, ""),
        "",
    );
    Ok(())
}
