//! Every key of a scene file: where it stands, what it takes, what holds without it, what it means. The reader
//! takes ranges and defaults from here, and a test keeps `scenes/README.md` equal to this list.

use crate::constants::{
    BRIGHTNESS_DRIFT, BRIGHTNESS_DRIFT_PERIOD_S, BRIGHTNESS_FLICKER, GRASP_DROP_MM, HALF_SURFACE_MM,
    MAINS_HZ, SCENE_FRICTION, SCENE_GRIPPER_LAG_S, SCENE_GRIPPER_MAX_N, SCENE_GRIPPER_OPEN_N,
    SCENE_GRIPPER_RATE_N_PER_S,
};

/// A key.
#[derive(Debug, PartialEq)]
pub struct Key {
    /// Its section: empty for the head of the file.
    pub section: &'static str,
    /// Its name.
    pub name: &'static str,
    /// What it takes.
    pub kind: Kind,
    /// What holds without it.
    pub absent: Absent,
    /// What it means.
    pub meaning: &'static str,
}

/// What a key takes.
#[derive(Debug, PartialEq)]
pub enum Kind {
    /// A number in `unit` (empty: a plain number) from min to max.
    Number(&'static str, f64, f64),
    /// An array of that many such numbers.
    Numbers(usize, &'static str, f64, f64),
    /// A whole number from min to max.
    Whole(u64, u64),
    /// A course: an array of [time in s, value in the unit], the values from min to max, times not falling.
    Course(&'static str, f64, f64),
    /// A text.
    Text,
    /// One of these texts.
    Choice(&'static [&'static str]),
}

/// What holds when a key is not given.
#[derive(Debug, PartialEq)]
pub enum Absent {
    /// It has to be given.
    Required,
    /// What the meaning says.
    Optional,
    /// This number.
    Number(f64),
    /// This whole number.
    Whole(u64),
    /// This text.
    Text(&'static str),
}

const fn key(
    section: &'static str,
    name: &'static str,
    kind: Kind,
    absent: Absent,
    meaning: &'static str,
) -> Key {
    Key {
        section,
        name,
        kind,
        absent,
        meaning,
    }
}

/// Largest whole number that every TOML reader keeps.
const WHOLE_MAX: u64 = i64::MAX as u64;

macro_rules! keys {
    ($($id:ident = $section:literal $name:literal, $kind:expr, $absent:expr, $meaning:literal;)*) => {
        $(pub(super) static $id: Key = key($section, $name, $kind, $absent, $meaning);)*
        /// All keys, section by section.
        pub static KEYS: &[&Key] = &[$(&$id),*];
    };
}

use Absent::{Optional, Required};
use Kind::{Choice, Course, Number, Numbers, Text, Whole};

keys! {
    KIND = "" "kind", Choice(&["press", "grasp"]), Required,
        "press: one indenter on one fingertip; grasp: an object between two";
    SEED = "" "seed", Whole(0, WHOLE_MAX), Absent::Whole(1),
        "what is random follows from it: sensor noise, and the pattern of a sensor without a number; `--seed` overrides it";
    FRAMES_PER_SECOND = "" "frames_per_second", Number("Hz", 1.0, 1000.0), Absent::Number(60.0),
        "frames a second; frame 0 is one interval after the start";
    FRAMES = "" "frames", Choice(&["full", "crop"]), Absent::Text("full"),
        "full: 640×480 as the camera gives them; crop: the middle 440×440; `--frames` overrides it";

    UNIT = "sensor" "unit", Whole(0, WHOLE_MAX), Optional,
        "number of the virtual sensor: its particles, LEDs, lens and noise; without it the nominal sensor with particles by `seed`";
    PARTICLES = "sensor" "particles", Whole(1, 100_000), Optional,
        "particles in the gel; without it the sensor's";
    NOISE = "sensor" "noise_levels", Number("grey levels", 0.0, 50.0), Optional,
        "standard deviation of the pixel noise; without it the sensor's";
    JPEG_QUALITY = "sensor" "jpeg_quality", Whole(1, 100), Optional,
        "pictures go through JPEG of this quality first; without it they do not";
    CAMERA = "sensor" "camera", Text, Optional,
        "file with the camera's intrinsics (as `host/simulation/cameras/default.toml`), relative to the scene file; without it the sensor's";
    BRIGHTNESS = "sensor" "brightness", Number("", 0.1, 3.0), Absent::Number(1.0),
        "mean light, share of the sensor's";
    DRIFT = "sensor" "brightness_drift", Number("", 0.0, 0.4), Absent::Number(BRIGHTNESS_DRIFT),
        "largest slow change of the light, share of the mean";
    DRIFT_PERIOD = "sensor" "brightness_drift_period_s", Number("s", 0.1, 1000.0), Absent::Number(BRIGHTNESS_DRIFT_PERIOD_S),
        "longest period of the slow change";
    FLICKER = "sensor" "flicker", Number("", 0.0, 0.4), Absent::Number(BRIGHTNESS_FLICKER),
        "largest change by mains flicker, share of the mean";
    MAINS = "sensor" "mains_hz", Number("Hz", 1.0, 1000.0), Absent::Number(MAINS_HZ),
        "mains frequency; the light flickers at twice this";

    SHAPE = "indenter" "shape", Choice(SHAPE_NAMES), Required,
        "a built-in shape, or file: a height map; in a grasp the patch that the fingers touch";
    FRICTION = "indenter" "friction", Number("", 0.05, 3.0), Absent::Number(SCENE_FRICTION),
        "Coulomb's coefficient between indenter and gel; keep it above the detector's 0.45";
    RADIUS = "indenter" "radius_mm", Number("mm", 0.2, 1000.0), Optional,
        "radius of the ball, the rod, the flat part or the rim's middle line";
    LENGTH = "indenter" "length_mm", Number("mm", 0.1, 40.0), Optional,
        "length between a cylinder's rounded ends, or of either bar of a cross";
    WIDTH = "indenter" "width_mm", Number("mm", 0.1, 40.0), Optional,
        "width of the flat part of a cross's bars";
    EDGE = "indenter" "edge_mm", Number("mm", 0.1, 40.0), Optional,
        "radius of the edges, or of a ring's cross-section";
    TIP = "indenter" "tip_mm", Number("mm", 0.1, 40.0), Optional,
        "radius of a cone's or a corner's point";
    SLOPE = "indenter" "slope", Number("", 0.01, 10.0), Optional,
        "a cone's height over distance from its axis";
    SIDES = "indenter" "sides_mm", Numbers(2, "mm", 0.1, 40.0), Optional,
        "sides of a block's flat face along x and y";
    AXES = "indenter" "axes_mm", Numbers(3, "mm", 0.2, 1000.0), Optional,
        "semi-axes of an ellipsoid along x, y and z";
    DISTANCE = "indenter" "distance_mm", Number("mm", 0.1, 40.0), Optional,
        "distance between the centres of two spheres";
    INNER = "indenter" "inner_mm", Number("mm", 0.1, 40.0), Optional,
        "radius of the circle inside a triangle";
    WAVE_HEIGHT = "indenter" "height_mm", Number("mm", 0.0, 5.0), Optional,
        "from valley to crest of a wavy ball";
    WAVE = "indenter" "wave_mm", Number("mm", 0.5, 40.0), Optional,
        "distance between crests of a wavy ball";
    FILE = "indenter" "file", Text, Optional,
        "for shape = \"file\": a grey PNG or a 2-D float .npy of heights away from the gel in mm, relative to the scene file; \
         columns along +x, rows along +y, centred on the indenter's origin";
    MM_PER_PIXEL = "indenter" "mm_per_pixel", Number("mm", 0.005, 5.0), Optional,
        "distance between neighbours of the height map; required with `file`";
    MM_PER_LEVEL = "indenter" "mm_per_level", Number("mm", -1.0, 1.0), Optional,
        "height of one grey level of a PNG; required with one; above 0 black touches first, as ink does; below 0 white does";
    INTERPOLATION = "indenter" "interpolation", Choice(&["bilinear", "bicubic"]), Absent::Text("bilinear"),
        "between the pixels of a height map; bicubic is Catmull and Rom's, cut off at the lowest height";

    PATH_NAME = "path" "name", Text, Optional,
        "the phase in truth.csv: letters, digits, spaces, `-` and `_`; without it \"step 1\" and so on";
    SECONDS = "path" "seconds", Number("s", 0.001, 600.0), Required,
        "time to go from the end of the step before to what is given here, at constant speed";
    PRESS = "path" "press_n", Number("N", 0.0, 40.0), Optional,
        "normal force at the end of the step; 0 lifts off; without it and `depth_mm` the pressing stays";
    DEPTH = "path" "depth_mm", Number("mm", -5.0, 3.0), Optional,
        "depth of the indenter's lowest plane under the gel at rest, instead of a force; below 0 it hovers";
    AT = "path" "at_mm", Numbers(2, "mm", -HALF_SURFACE_MM, HALF_SURFACE_MM), Optional,
        "where the indenter's origin goes, x and y from the middle of the gel; without it it stays; the first step starts there";
    TURN = "path" "turn_deg", Number("degrees", -720.0, 720.0), Optional,
        "turn of the indenter about z, from x to y; without it it stays; the first step starts there";
    PULL = "path" "pull_n", Numbers(2, "N", -20.0, 20.0), Optional,
        "force along x and y that pulls the indenter at the end of the step, instead of `at_mm` and `turn_deg`: it goes where the gel carries it; without it and `moment_nmm` it goes by place";
    MOMENT = "path" "moment_nmm", Number("N·mm", -200.0, 200.0), Optional,
        "moment about z that turns the indenter at the end of the step, like `pull_n`; of the two, the one that is left out is 0";
    TILT = "path" "tilt_deg", Numbers(2, "degrees", -15.0, 15.0), Optional,
        "slope of the indenter along x and y; above 0 the +x (+y) side presses deeper; without it it stays; the first step starts there";

    GRASP_SECONDS = "grasp" "seconds", Number("s", 0.01, 600.0), Required,
        "how long the scene is";
    START = "grasp" "start", Choice(&["table", "hand"]), Absent::Text("table"),
        "what holds the object at first: a table under it, or a hand until `held_until_s`";
    HELD_UNTIL = "grasp" "held_until_s", Number("s", 0.0, 600.0), Absent::Number(0.0),
        "when the hand lets go";
    GRIP_POINT = "grasp" "grip_point_mm", Numbers(2, "mm", -HALF_SURFACE_MM, HALF_SURFACE_MM), Optional,
        "where on the first finger the grip point lies at first; without it in the middle";
    GRASP_TURN = "grasp" "turn_deg", Number("degrees", -180.0, 180.0), Absent::Number(0.0),
        "turn of the object at first, from x to y";
    DROP = "grasp" "drop_mm", Number("mm", 0.5, 16.0), Absent::Number(GRASP_DROP_MM),
        "an object that has slid this far from where it was gripped has left the grip";
    GRAVITY = "grasp" "gravity_deg", Course("degrees", -360.0, 360.0), Optional,
        "turn of gravity from −y towards +x over time, as a gripper that turns feels it; without it none";

    OBJECT_NAME = "object" "name", Choice(OBJECT_NAMES), Required,
        "a built-in object, or own: described by the keys below, with its patch and friction in [indenter]";
    MASS = "object" "mass_g", Number("g", 0.1, 5000.0), Optional,
        "mass; required with own";
    SIZE = "object" "size_mm", Numbers(3, "mm", 1.0, 1000.0), Optional,
        "width and height in the plane of the fingers, and thickness between them; required with own";
    INERTIA = "object" "inertia_g_mm2", Number("g·mm²", 0.0, 1e9), Optional,
        "moment of inertia about the grip axis through the centre of mass; without it that of a box of this size";
    CENTRE = "object" "centre_of_mass_mm", Numbers(2, "mm", -500.0, 500.0), Optional,
        "centre of mass from the grip point; without it the built-in object's, or the grip point";
    PATCH_TURN = "object" "patch_turn_deg", Number("degrees", -180.0, 180.0), Optional,
        "turn of the patch against the object; without it the built-in object's, or 0";

    DEAD_TIME = "gripper" "dead_time_s", Number("s", 0.0, 1.0), Absent::Number(0.0),
        "time until the gripper hears its line";
    LAG = "gripper" "lag_s", Number("s", 0.0, 2.0), Absent::Number(SCENE_GRIPPER_LAG_S),
        "time constant of its force behind the line";
    RATE = "gripper" "rate_n_per_s", Number("N/s", 1.0, 10_000.0), Absent::Number(SCENE_GRIPPER_RATE_N_PER_S),
        "fastest change of its force";
    MIN_FORCE = "gripper" "min_n", Number("N", 0.0, 20.0), Absent::Number(SCENE_GRIPPER_OPEN_N),
        "minimum force; below it the jaws are open";
    MAX_FORCE = "gripper" "max_n", Number("N", 0.1, 40.0), Absent::Number(SCENE_GRIPPER_MAX_N),
        "maximum force";

    STROKE = "arm" "stroke", Choice(&["move", "dash", "shake"]), Required,
        "move: from rest to rest; dash: gathers speed and stops hard; shake: to and fro; strokes add up";
    ARM_FROM = "arm" "from_s", Number("s", 0.0, 600.0), Required,
        "when it begins";
    ARM_SECONDS = "arm" "seconds", Number("s", 0.01, 600.0), Required,
        "how long it takes; of a shake at least two periods";
    ARM_BY = "arm" "by_mm", Numbers(2, "mm", -2000.0, 2000.0), Required,
        "how far a move or dash goes, or a shake from its middle";
    STOP = "arm" "stop_s", Number("s", 0.001, 10.0), Optional,
        "how long a dash takes to stop; required with one";
    FREQUENCY = "arm" "frequency_hz", Number("Hz", 0.05, 50.0), Optional,
        "periods a second of a shake; required with one";

    PULL_FORCE = "pull" "force_n", Numbers(2, "N", -40.0, 40.0), Optional,
        "force on the object, in the plane of the first finger; without it none";
    PULL_MOMENT = "pull" "moment_nmm", Number("N·mm", -1000.0, 1000.0), Absent::Number(0.0),
        "moment on the object, from x to y";
    PULL_AT = "pull" "at_mm", Numbers(2, "mm", -500.0, 500.0), Optional,
        "where the force acts, from the grip point; without it there";
    PULL_COURSE = "pull" "course", Course("", -10.0, 10.0), Required,
        "share of force and moment over time; smooth between the pairs";

    PHASE_NAME = "phase" "name", Text, Required,
        "what truth.csv calls the scene from here on: letters, digits, spaces, `-` and `_`";
    PHASE_FROM = "phase" "from_s", Number("s", 0.0, 600.0), Required,
        "from when on";

    POLICY = "policy" "kind", Choice(&["fixed", "schedule", "gripline"]), Required,
        "who sets the grip-force line: one force, forces over time, or Gripline itself: force network on the first finger's \
         pictures, detector and controller of the microcontroller";
    POLICY_FORCE = "policy" "force_n", Number("N", 0.0, 40.0), Optional,
        "the line of a fixed policy, or the minimum grip of gripline; required with either";
    POLICY_COURSE = "policy" "course", Course("N", 0.0, 40.0), Optional,
        "the line over time of a schedule, straight between the pairs; required with one";

}

/// The built-in shapes' names in a scene file, and `file`.
const SHAPE_NAMES: &[&str] = &[
    "sphere",
    "cylinder",
    "disc",
    "cone",
    "block",
    "ellipsoid",
    "ring",
    "two_spheres",
    "triangle",
    "corner",
    "cross",
    "wavy",
    "file",
];

/// The head's section names, with what they hold.
pub(super) const SECTIONS: &[(&str, &str)] = &[
    ("sensor", "[sensor]"),
    ("indenter", "[indenter]"),
    ("path", "[[path]]"),
    ("grasp", "[grasp]"),
    ("object", "[object]"),
    ("gripper", "[gripper]"),
    ("arm", "[[arm]]"),
    ("pull", "[[pull]]"),
    ("phase", "[[phase]]"),
    ("policy", "[policy]"),
];

/// The built-in objects' names in a scene file, without their masses, and `own`.
const OBJECT_NAMES: &[&str] = &[
    "hollow plastic ball",
    "marker pen",
    "small tin",
    "wooden block",
    "glass bottle",
    "golf ball",
    "table tennis ball",
    "AA cell",
    "hen's egg",
    "tennis ball",
    "glue stick",
    "marker cap",
    "domino",
    "eraser",
    "drawer knob",
    "pebble",
    "ball knob",
    "own",
];

impl Kind {
    /// What is expected, for messages and the reference.
    #[must_use]
    pub fn expected(&self) -> String {
        let in_unit = |unit: &str| {
            if unit.is_empty() {
                String::new()
            } else {
                format!(" in {unit}")
            }
        };
        match self {
            Number(unit, min, max) => format!("a number{} from {min} to {max}", in_unit(unit)),
            Numbers(count, unit, min, max) => {
                format!("{count} numbers{} from {min} to {max}", in_unit(unit))
            }
            Course(unit, min, max) => format!(
                "pairs [time in s, number{}] like [[0.0, {min}], [1.0, {max}]], times not falling, numbers from \
                 {min} to {max}",
                in_unit(unit)
            ),
            Whole(min, WHOLE_MAX) => format!("a whole number from {min} to 2⁶³−1"),
            Whole(min, max) => format!("a whole number from {min} to {max}"),
            Text => "a text".to_owned(),
            Choice(names) => {
                let quoted: Vec<_> = names.iter().map(|name| format!("\"{name}\"")).collect();
                match quoted.as_slice() {
                    [one] => one.clone(),
                    [start @ .., last] => format!("{} or {last}", start.join(", ")),
                    [] => String::new(),
                }
            }
        }
    }
}
