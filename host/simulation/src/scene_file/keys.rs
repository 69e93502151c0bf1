//! Every key of a scene file: where it stands, what it takes, what holds without it, what it means. The reader
//! takes ranges and defaults from here, and a test keeps `scenes/README.md` equal to this list.

use crate::constants::{
    BRIGHTNESS_DRIFT, BRIGHTNESS_DRIFT_PERIOD_S, BRIGHTNESS_FLICKER, HALF_SURFACE_MM, MAINS_HZ,
    SCENE_FRICTION,
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
    /// A number in `unit` (empty: a plain number) from least to most.
    Number(&'static str, f64, f64),
    /// An array of that many such numbers.
    Numbers(usize, &'static str, f64, f64),
    /// A whole number from least to most.
    Whole(u64, u64),
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
use Kind::{Choice, Number, Numbers, Text, Whole};

keys! {
    KIND = "" "kind", Choice(&["press"]), Required,
        "press: one indenter on one fingertip";
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
        "a built-in shape, or file: a height map";
    FRICTION = "indenter" "friction", Number("", 0.05, 3.0), Absent::Number(SCENE_FRICTION),
        "Coulomb's coefficient between indenter and skin; keep it above the detector's 0.45";
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
        "for shape = \"file\": a grey PNG or a 2-D float .npy of heights away from the skin in mm, relative to the scene file; \
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
        "depth of the indenter's lowest plane under the skin at rest, instead of a force; below 0 it hovers";
    AT = "path" "at_mm", Numbers(2, "mm", -HALF_SURFACE_MM, HALF_SURFACE_MM), Optional,
        "where the indenter's origin goes, x and y from the middle of the skin; without it it stays; the first step starts there";
    TURN = "path" "turn_deg", Number("degrees", -720.0, 720.0), Optional,
        "turn of the indenter about z, from x to y; without it it stays; the first step starts there";
    TILT = "path" "tilt_deg", Numbers(2, "degrees", -15.0, 15.0), Optional,
        "slope of the indenter along x and y; above 0 the +x (+y) side presses deeper; without it it stays; the first step starts there";
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
            Number(unit, least, most) => format!("a number{} from {least} to {most}", in_unit(unit)),
            Numbers(count, unit, least, most) => {
                format!("{count} numbers{} from {least} to {most}", in_unit(unit))
            }
            Whole(least, WHOLE_MAX) => format!("a whole number from {least} to 2⁶³−1"),
            Whole(least, most) => format!("a whole number from {least} to {most}"),
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
