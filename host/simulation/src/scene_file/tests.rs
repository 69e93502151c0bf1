//! Scene files as people write them: what is read, and the exact line that tells of every mistake.

use std::collections::BTreeSet;
use std::path::Path;
use std::{fs, io};

use super::keys::{self, Absent};
use super::{FrameSize, Policy, Scene, SceneFile};
use crate::contact_world::{HeightMap, Press, Shape, TRAINING_SHAPES, UNSEEN_SHAPES};
use crate::grasp::Gripper;
use crate::{BrightnessMotion, FingertipParams};

const GOOD: &str = r#"kind = "press"
seed = 7
frames_per_second = 30

[sensor]
unit = 3
brightness_drift = 0.02

[indenter]
shape = "cylinder"
radius_mm = 6
friction = 0.7

[[path]]
name = "press"
seconds = 0.5
press_n = 2.5
at_mm = [1.0, -2]

[[path]]
seconds = 1.5
at_mm = [2.0, -2.0]
turn_deg = 90.0
tilt_deg = [0.0, 3.0]
"#;

fn nothing(_: &Path) -> io::Result<Vec<u8>> {
    Err(io::ErrorKind::NotFound.into())
}

fn parse(text: &str) -> Result<SceneFile, String> {
    SceneFile::parse(Path::new("scene.toml"), text, &mut nothing).map_err(|error| error.to_string())
}

#[test]
fn a_scene_is_read_with_its_defaults() {
    let scene = parse(GOOD).unwrap();
    assert_eq!((scene.seed, scene.frames), (7, FrameSize::Full));
    assert!((scene.frames_per_second - 30.0).abs() < 1e-12);
    assert_eq!(scene.sensor.unit, Some(3));
    let sensor = FingertipParams::of_sensor(3);
    let motion = BrightnessMotion {
        drift: 0.02,
        ..BrightnessMotion::default()
    };
    assert_eq!(
        scene.sensor.params,
        FingertipParams {
            brightness_motion: motion,
            ..sensor
        }
    );
    let Scene::Press(press) = scene.scene else {
        panic!("{:?}", scene.scene)
    };
    let expected = Shape::Cylinder {
        radius_mm: 6.0,
        length_mm: 12.0,
        edge_mm: 2.0,
    };
    for at in [[0.0, 3.0], [6.5, 1.0], [-2.0, 0.0]] {
        assert!((press.indenter.shape.height_mm(at) - expected.height_mm(at)).abs() < 1e-12);
    }
    assert!((press.indenter.friction - 0.7).abs() < 1e-12 && (press.seconds() - 2.0).abs() < 1e-12);
    let [first, second] = &press.path[..] else {
        panic!("{:?}", press.path);
    };
    assert_eq!((&*first.name, first.line), ("press", 14));
    assert_eq!(
        (first.press, first.at_mm),
        (Some(Press::Force(2.5)), Some([1.0, -2.0]))
    );
    assert_eq!((&*second.name, second.line, second.press), ("step 2", 20, None));
    assert!((second.turn_rad.unwrap() - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    assert!((second.tilt_rad.unwrap()[1] - 3.0_f64.to_radians()).abs() < 1e-12);
}

/// Changes to the good scene, and the line that each gives.
const MISTAKES: &[(&str, &str, &str)] = &[
    (
        "kind = \"press\"",
        "kind = \"pull\"",
        "scene.toml:1: kind: found \"pull\", expected \"press\" or \"grasp\": choose one of these",
    ),
    (
        "kind = \"press\"\n",
        "",
        "scene.toml:1: kind: found nothing, expected \"press\" or \"grasp\": add kind to the head of the file",
    ),
    (
        "seed = 7",
        "sed = 7",
        "scene.toml:2: sed: found a key that is not known here, expected one of kind, seed, \
             frames_per_second, frames, sensor, indenter, path, grasp, object, gripper, arm, pull, phase, policy: did \
             you mean seed?",
    ),
    (
        "seed = 7",
        "seed = -7",
        "scene.toml:2: seed: found -7, expected a whole number from 0 to 2⁶³−1: change it",
    ),
    (
        "frames_per_second = 30",
        "frames_per_second = \"30 Hz\"",
        "scene.toml:3: frames_per_second: found \"30 Hz\", expected a number in Hz from 1 to 1000: write the \
             number without quotes and unit",
    ),
    (
        "frames_per_second = 30",
        "frames_per_second = 30 Hz",
        "scene.toml:3: found what TOML does not allow (string values must be quoted, expected \
             literal string), expected key = value, [section] or [[section]]: correct this line",
    ),
    (
        "unit = 3",
        "friction = 3",
        "scene.toml:6: sensor.friction: found a key that is not known here, expected one of unit, particles, \
             noise_levels, jpeg_quality, camera, brightness, brightness_drift, brightness_drift_period_s, flicker, \
             mains_hz: move friction to [indenter]",
    ),
    (
        "unit = 3",
        "unit = 3.5",
        "scene.toml:6: sensor.unit: found 3.5, expected a whole number from 0 to 2⁶³−1: change it",
    ),
    (
        "brightness_drift = 0.02",
        "brightness_drift = nan",
        "scene.toml:7: sensor.brightness_drift: found nan, expected a number from 0 to 0.4: change it",
    ),
    (
        "shape = \"cylinder\"",
        "shape = \"cylindre\"",
        "scene.toml:10: indenter.shape: found \"cylindre\", expected \"sphere\", \"cylinder\", \"disc\", \
             \"cone\", \"block\", \"ellipsoid\", \"ring\", \"two_spheres\", \"triangle\", \"corner\", \"cross\", \
             \"wavy\" or \"file\": choose one of these",
    ),
    (
        "radius_mm = 6",
        "radius_cm = 0.6",
        "scene.toml:11: indenter.radius_cm: found a key that is not known here, expected a key of this \
             section: did you mean radius_mm?",
    ),
    (
        "radius_mm = 6",
        "radius_mm = 0",
        "scene.toml:11: indenter.radius_mm: found 0, expected a number in mm from 0.2 to 1000: change it",
    ),
    (
        "radius_mm = 6",
        "tip_mm = 2",
        "scene.toml:11: indenter.tip_mm: found a key that shape = \"cylinder\" does not use, expected one of \
             edge_mm, friction, length_mm, radius_mm, shape: remove it",
    ),
    (
        "shape = \"cylinder\"\nradius_mm = 6",
        "shape = \"file\"\nfile = \"stamp.png\"\nmm_per_pixel = 0.1\nmm_per_level = 0.01",
        "scene.toml:11: indenter.file: found no file stamp.png, expected a file that can be read, relative to \
             the scene file: check the name",
    ),
    (
        "shape = \"cylinder\"\nradius_mm = 6",
        "shape = \"file\"\nfile = \"stamp.png\"",
        "scene.toml:9: indenter.mm_per_pixel: found nothing with shape = \"file\", expected a number in mm \
             from 0.005 to 5: add mm_per_pixel to this section",
    ),
    (
        "[indenter]\nshape = \"cylinder\"\nradius_mm = 6\nfriction = 0.7\n",
        "",
        "scene.toml:1: indenter: found nothing, expected a section [indenter]: begin it with a line [indenter]",
    ),
    (
        "name = \"press\"",
        "name = \"press, hard\"",
        "scene.toml:15: path[1].name: found \"press, hard\", expected 1 to 40 letters, digits, spaces, - or _: \
             it becomes a cell of truth.csv: choose another name",
    ),
    (
        "seconds = 0.5\n",
        "",
        "scene.toml:14: path[1].seconds: found nothing, expected a number in s from 0.001 to 600: add seconds \
             to this section",
    ),
    (
        "press_n = 2.5",
        "press_n = 2.5\nmoment_nmm = 2",
        "scene.toml:19: path[1].at_mm: found a place beside a pull or moment, expected a step that goes by place or \
             by load: remove one of them",
    ),
    (
        "press_n = 2.5",
        "press_n = 2.5\ndepth_mm = 0.5",
        "scene.toml:18: path[1].depth_mm: found a depth beside press_n, expected one of press_n and depth_mm: \
             remove one of them",
    ),
    (
        "at_mm = [1.0, -2]",
        "at_mm = [1.0, -2, 0.5]",
        "scene.toml:18: path[1].at_mm: found [1.0, -2, 0.5], expected 2 numbers in mm from -16 to 16: write \
             at_mm = [0.0, 0.0]",
    ),
    (
        "at_mm = [1.0, -2]",
        "at_mm = [1.0, -20]",
        "scene.toml:18: path[1].at_mm: found [1.0, -20], expected 2 numbers in mm from -16 to 16: write at_mm \
             = [0.0, 0.0]",
    ),
    (
        "at_mm = [1.0, -2]",
        "at_mm = [10.0, -2]",
        "scene.toml:18: path[1].at_mm: found an indenter that touches at (15.6, -2.0) mm, expected contact \
             inside ±16 mm, the sensing surface: move the indenter inwards or take a smaller one",
    ),
    (
        "seconds = 1.5",
        "seconds = 500\n[[path]]\nseconds = 600\n[[path]]\nseconds = 600\n[[path]]\nseconds = 600\n[[path]]\n\
             seconds = 600\n[[path]]\nseconds = 600",
        "scene.toml:31: path[7].seconds: found 105015 frames up to here, expected at most 100000 in a scene: \
             shorten it or lower frames_per_second",
    ),
    (
        "seconds = 1.5",
        "path = 3\nseconds = 1.5",
        "scene.toml:21: path[2].path: found a key that is not known here, expected one of name, seconds, \
             press_n, depth_mm, at_mm, turn_deg, pull_n, moment_nmm, tilt_deg: remove it",
    ),
    (
        "[[path]]\nname = \"press\"",
        "[path]\nname = \"press\"",
        "scene.toml:20: found what TOML does not allow (duplicate key), expected key = value, [section] or \
             [[section]]: correct this line",
    ),
];

#[test]
fn every_mistake_gives_one_line_with_key_line_found_expected_and_what_to_do() {
    let mut wrong = 0;
    for &(from, to, expected) in MISTAKES {
        assert!(GOOD.contains(from), "{from}");
        let found = parse(&GOOD.replacen(from, to, 1)).map(|_| ()).unwrap_err();
        if found != expected {
            println!("FOUND {found}\nWANTS {expected}\n");
            wrong += 1;
        }
    }
    assert_eq!(wrong, 0, "see above");
    assert_eq!(
        parse("").map(|_| ()).unwrap_err(),
        "scene.toml:1: kind: found nothing, expected \"press\" or \"grasp\": add kind to the head of the file"
    );
}

#[test]
fn a_height_map_is_loaded_from_beside_the_scene_and_its_faults_carry_the_line() {
    let scene = GOOD.replace(
        "shape = \"cylinder\"\nradius_mm = 6",
        "shape = \"file\"\nfile = \"stamps/a.npy\"\nmm_per_pixel = 0.5",
    );
    let file = |descr: &str| {
        let mut header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (2, 2), }}");
        while (10 + header.len() + 1) % 64 != 0 {
            header.push(' ');
        }
        header.push('\n');
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend([1.0_f64, 2.0, 3.0, 4.0].iter().flat_map(|v| v.to_le_bytes()));
        bytes
    };
    let read = |bytes: Vec<u8>, text: &str| {
        let mut asked = Vec::new();
        let mut load = |path: &Path| {
            asked.push(path.to_owned());
            Ok(bytes.clone())
        };
        let scene = SceneFile::parse(Path::new("there/scene.toml"), text, &mut load);
        assert_eq!(asked, [Path::new("there/stamps/a.npy")]);
        scene.map_err(|error| error.to_string())
    };
    let Scene::Press(press) = read(file("<f8"), &scene).unwrap().scene else {
        panic!("no press")
    };
    assert!((press.indenter.shape.height_mm([0.25, 0.25]) - 3.0).abs() < 1e-12);
    let error = read(file("<i8"), &scene).map(|_| ()).unwrap_err();
    assert_eq!(
        error,
        "there/scene.toml:11: indenter.file: found dtype '<i8' in stamps/a.npy, expected a NumPy array (rows, \
         columns) of float32 or float64: save it with numpy.save(name, heights.astype(numpy.float32))"
    );
    let scaled = scene.replace("mm_per_pixel", "mm_per_level = 0.1\nmm_per_pixel");
    let error = read(file("<f8"), &scaled).map(|_| ()).unwrap_err();
    assert_eq!(
        error,
        "there/scene.toml:12: indenter.mm_per_level: found a scale beside an array, expected heights in mm in the \
         array itself: remove it"
    );
}

#[test]
fn a_camera_file_is_taken_and_its_faults_carry_both_places() {
    let text = GOOD.replace("unit = 3", "camera = \"lens.toml\"");
    let default = crate::Camera::default().to_toml();
    let read = |camera: String| {
        let load = &mut |_: &Path| Ok(camera.clone().into_bytes());
        SceneFile::parse(Path::new("scene.toml"), &text, load).map_err(|error| error.to_string())
    };
    let scene = read(default.replace("to_base_mm = 12.0", "to_base_mm = 13.0")).unwrap();
    assert!((scene.sensor.params.camera.to_base_mm - 13.0).abs() < 1e-12);
    let error = read(default.replace("to_base_mm = 12.0", "to_base_mm = -1"))
        .map(|_| ())
        .unwrap_err();
    assert_eq!(
        error,
        "scene.toml:6: sensor.camera: found -1 at lens.toml:5: to_base_mm, expected a finite number above 0: \
         correct that file, or leave the key out"
    );
}

const GRASP: &str = r#"kind = "grasp"
[grasp]
seconds = 2.0
start = "hand"
held_until_s = 0.5
gravity_deg = [[0.0, 0.0], [1.0, 90.0]]
[object]
name = "marker pen"
mass_g = 20.0
[gripper]
max_n = 20
[[arm]]
stroke = "dash"
from_s = 0.2
seconds = 0.5
by_mm = [0.0, 50.0]
stop_s = 0.05
[[pull]]
force_n = [0.5, 0.0]
course = [[1.0, 0.0], [1.2, 1.0]]
[[phase]]
name = "all"
from_s = 0
[policy]
kind = "schedule"
course = [[0, 2.0], [1, 4.0]]
"#;

#[test]
fn a_grasp_is_read_with_its_defaults() {
    let file = parse(GRASP).unwrap();
    let Scene::Grasp(grasp) = file.scene else {
        panic!("{:?}", file.scene)
    };
    let scene = &grasp.scene;
    assert!(
        (grasp.seconds - 2.0).abs() < 1e-12
            && scene.table.is_none()
            && (scene.held_until_s - 0.5).abs() < 1e-12
    );
    assert!((scene.object.mass_g - 20.0).abs() < 1e-12 && scene.object.name == "marker pen, 17.82 g");
    // With another mass the built-in moment of inertia does not hold.
    assert!((scene.object.inertia_g_mm2 - 20.0 * (130.0 * 130.0 + 256.0) / 12.0).abs() < 1e-6);
    assert!((scene.gripper.max_n - 20.0).abs() < 1e-12);
    assert_eq!(scene.gripper.lag_s.to_bits(), Gripper::default().lag_s.to_bits());
    assert!((scene.gravity_turn_rad.at(2.0) - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    assert!(
        (scene.arm.place_mm(1.0)[1] - 50.0).abs() < 1e-9
            && (scene.pulls[0].course.at(1.1) - 0.5).abs() < 1e-12
    );
    assert_eq!(scene.phase(1.0), "all");
    let Policy::Schedule(course) = &grasp.policy else {
        panic!("{:?}", grasp.policy)
    };
    assert!((course.at(0.5) - 3.0).abs() < 1e-12);
}

#[test]
fn the_former_name_of_a_moment_is_still_read() {
    let former = GRASP.replace("force_n = [0.5, 0.0]", "twist_nmm = 12.0");
    let Scene::Grasp(grasp) = parse(&former).unwrap().scene else {
        panic!("no grasp")
    };
    assert!((grasp.scene.pulls[0].torsional_moment_nmm - 12.0).abs() < 1e-12);
}

/// Changes to the good grasp, and the line that each gives.
const GRASP_MISTAKES: &[(&str, &str, &str)] = &[
    (
        "seconds = 2.0\n",
        "",
        "scene.toml:2: grasp.seconds: found nothing, expected a number in s from 0.01 to 600: add seconds to this \
         section",
    ),
    (
        "name = \"marker pen\"",
        "name = \"own\"",
        "scene.toml:1: indenter: found nothing with name = \"own\", expected a section [indenter] with the patch that \
         the fingers touch: begin it with a line [indenter]",
    ),
    (
        "course = [[1.0, 0.0], [1.2, 1.0]]",
        "course = [[1.0, 0.0], [0.8, 1.0]]",
        "scene.toml:20: pull[1].course: found [[1.0, 0.0], [0.8, 1.0]], expected pairs [time in s, number] like \
         [[0.0, -10], [1.0, 10]], times not falling, numbers from -10 to 10: change it",
    ),
    (
        "stop_s = 0.05",
        "stop_s = 0.5",
        "scene.toml:17: arm[1].stop_s: found 0.5, expected less than seconds, 0.5: stop faster",
    ),
    (
        "stop_s = 0.05\n",
        "",
        "scene.toml:12: arm[1].stop_s: found nothing with stroke = \"dash\", expected a number in s from 0.001 to 10: \
         add stop_s to this section",
    ),
    (
        "stroke = \"dash\"",
        "stroke = \"move\"",
        "scene.toml:17: arm[1].stop_s: found a key that stroke = \"move\" does not use, expected one of by_mm, from_s, \
         seconds, stroke: remove it",
    ),
    (
        "max_n = 20",
        "max_n = 20\nmin_n = 20",
        "scene.toml:11: gripper.max_n: found 20, expected more than min_n, 20: raise it",
    ),
    (
        "kind = \"schedule\"\ncourse = [[0, 2.0], [1, 4.0]]",
        "kind = \"gripline\"",
        "scene.toml:24: policy.force_n: found nothing with kind = \"gripline\", expected a number in N from 0 to 40: \
         add force_n to this section",
    ),
    (
        "[policy]\nkind = \"schedule\"\ncourse = [[0, 2.0], [1, 4.0]]\n",
        "",
        "scene.toml:1: policy: found nothing, expected a section [policy]: begin it with a line [policy]",
    ),
    (
        "[policy]",
        "[[path]]\nseconds = 1\n[policy]",
        "scene.toml:24: path: found a key that kind = \"grasp\" does not use, expected one of arm, frames, \
         frames_per_second, grasp, gripper, indenter, kind, object, phase, policy, pull, seed, sensor: remove it",
    ),
];

#[test]
fn every_mistake_in_a_grasp_gives_one_line_too() {
    let mut wrong = 0;
    for &(from, to, expected) in GRASP_MISTAKES {
        assert!(GRASP.contains(from), "{from}");
        let found = parse(&GRASP.replacen(from, to, 1)).map(|_| ()).unwrap_err();
        if found != expected {
            println!("FOUND {found}\nWANTS {expected}\n");
            wrong += 1;
        }
    }
    assert_eq!(wrong, 0, "see above");
}

/// The folder of the examples and their reference.
fn scenes() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes")
}

#[test]
fn the_examples_are_read_and_every_line_of_them_that_sets_something_first_is_explained() {
    for name in [
        "press_and_drag.toml",
        "slides.toml",
        "twist_stamp.toml",
        "grasp_lift_pull.toml",
    ] {
        let text = fs::read_to_string(scenes().join(name)).unwrap();
        let load = &mut |path: &Path| fs::read(path);
        SceneFile::parse(&scenes().join(name), &text, load).unwrap();
        let mut explained = BTreeSet::new();
        for line in text
            .lines()
            .filter(|line| line.contains(" = ") && !line.starts_with('#'))
        {
            let key = line.split(" = ").next().unwrap();
            if explained.insert(key.to_owned()) && !["name", "shape", "seconds", "tilt_deg"].contains(&key) {
                assert!(line.contains("# "), "{name}: {line}");
            }
        }
    }
}

/// The reference of one section as it stands in the README.
fn reference(section: &str) -> String {
    let mut table = String::from("| key | takes | without it | meaning |\n|---|---|---|---|\n");
    for key in keys::KEYS.iter().filter(|key| key.section == section) {
        let absent = match key.absent {
            Absent::Required => "an error".to_owned(),
            Absent::Optional => "see meaning".to_owned(),
            Absent::Number(number) => number.to_string(),
            Absent::Whole(number) => number.to_string(),
            Absent::Text(text) => format!("\"{text}\""),
        };
        let (name, takes, meaning) = (key.name, key.kind.expected(), key.meaning);
        let row = format!("| `{name}` | {takes} | {absent} | {meaning} |\n");
        table.push_str(&row);
    }
    table
}

#[test]
fn the_reference_has_every_key_with_range_and_default_of_the_code() {
    let text = fs::read_to_string(scenes().join("README.md")).unwrap();
    let mut missing = String::new();
    for (section, heading) in std::iter::once(&("", "the head of the file")).chain(keys::SECTIONS) {
        let table = format!("### {heading}\n\n{}", reference(section));
        if !text.contains(&table) {
            missing += &(table + "\n");
        }
    }
    for shape in TRAINING_SHAPES.iter().chain(&UNSEEN_SHAPES) {
        let row = format!("| `{}` | {} |\n", super::indenter::file_name(shape), usual(shape));
        if !text.contains(&row) {
            missing += &row;
        }
    }
    assert!(missing.is_empty(), "not in scenes/README.md:\n{missing}");
}

/// A built-in shape's usual size, as keys.
fn usual(shape: &Shape) -> String {
    let text = format!("{shape:?}");
    let inside = text.split_once("{ ").unwrap().1.trim_end_matches(" }");
    let keys = inside
        .replace(": ", " = ")
        .replace(", ", "`, `")
        .replace("`, `4.0]", ", 4.0]");
    format!("`{}`", keys.replace("`, `7.0`, `8.0]", ", 7.0, 8.0]"))
}
