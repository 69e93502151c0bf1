//! The camera under the gel: an equidistant fisheye, r = f·θ, looking up at the gel. Units: mm, pixels of the 640 x
//! 480 frame, rad. Image axes follow the surface's x and y (the mirror of a view from below is taken as undone).
//! Limits: one centre of projection, no refraction at the gel's base; spheres look round (off the axis a real one is
//! θ/sin θ longer across the radius: 11 % at 45°).

use std::fmt::Write as _;
use std::sync::LazyLock;

use toml::de::{DeTable, DeValue};

use crate::error::SimulationError;

/// The committed intrinsics.
const DEFAULT_TOML: &str = include_str!("../cameras/default.toml");

static DEFAULT: LazyLock<Camera> =
    LazyLock::new(|| Camera::from_toml(DEFAULT_TOML).expect("the committed camera file is valid"));

/// Intrinsics of the camera, and where it sits. Its file, `cameras/default.toml`, has the fields' names as keys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Pixels per radian from the axis.
    pub focal_px_per_rad: f64,
    /// Where the axis meets the 640 x 480 frame, pixels (x, y); pixel (0, 0) is centred on (0.5, 0.5).
    pub centre_px: [f64; 2],
    /// Largest angle from the axis that the lens sees, rad; dark beyond.
    pub half_field_rad: f64,
    /// Light that the lens loses, times the square of the angle from the axis.
    pub vignette_per_rad2: f64,
    /// From the centre of projection to the gel's rigid base, mm.
    pub to_base_mm: f64,
}

impl Default for Camera {
    /// The committed `cameras/default.toml`.
    fn default() -> Self {
        *DEFAULT
    }
}

/// Keys of the camera file, in their order there, with what each accepts.
const KEYS: [(&str, &str); 5] = [
    ("focal_px_per_rad", "a finite number above 0"),
    ("centre_px", "two finite numbers, [x, y]"),
    ("half_field_rad", "a number above 0, at most 1.5708 (π/2)"),
    ("vignette_per_rad2", "a number from 0 to 1"),
    ("to_base_mm", "a finite number above 0"),
];
/// π/2, and a little for rounding up.
const HALF_FIELD_MAX_RAD: f64 = std::f64::consts::FRAC_PI_2 + 1e-5;

impl Camera {
    /// The camera of a file's text: every key once, no other.
    ///
    /// # Errors
    /// The line and key of what is no TOML, missing, unknown, of another type or out of range.
    pub fn from_toml(text: &str) -> Result<Self, SimulationError> {
        let file = CameraFile::parse(text)?;
        let [focal] = file.numbers(0)?;
        let centre_px = file.numbers(1)?;
        let [half_field] = file.numbers(2)?;
        let [vignette] = file.numbers(3)?;
        let [to_base] = file.numbers(4)?;
        let camera = Self {
            focal_px_per_rad: focal,
            centre_px,
            half_field_rad: half_field,
            vignette_per_rad2: vignette,
            to_base_mm: to_base,
        };
        match camera.first_bad() {
            Some(key) => Err(file.wrong(key)),
            None => Ok(camera),
        }
    }

    /// The file's text of this camera; [`Self::from_toml`] gives it back to the last bit.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let [x, y] = self.centre_px;
        let values = [
            format!("{:?}", self.focal_px_per_rad),
            format!("[{x:?}, {y:?}]"),
            format!("{:?}", self.half_field_rad),
            format!("{:?}", self.vignette_per_rad2),
            format!("{:?}", self.to_base_mm),
        ];
        let mut text = String::new();
        for ((key, _), value) in KEYS.iter().zip(values) {
            // Writing to a text does not fail.
            let _ = writeln!(text, "{key} = {value}");
        }
        text
    }

    /// Place in [`KEYS`] of the first field out of range.
    fn first_bad(&self) -> Option<usize> {
        let good = [
            self.focal_px_per_rad.is_finite() && self.focal_px_per_rad > 0.0,
            self.centre_px.iter().all(|c| c.is_finite()),
            self.half_field_rad > 0.0 && self.half_field_rad <= HALF_FIELD_MAX_RAD,
            (0.0..=1.0).contains(&self.vignette_per_rad2),
            self.to_base_mm.is_finite() && self.to_base_mm > 0.0,
        ];
        good.iter().position(|good| !good)
    }

    pub(crate) fn check(&self) -> Result<(), SimulationError> {
        let Some(key) = self.first_bad() else {
            return Ok(());
        };
        let not_finite = |c: &&f64| !c.is_finite();
        let (field, found) = [
            ("camera focal_px_per_rad", self.focal_px_per_rad),
            (
                "camera centre_px",
                *self.centre_px.iter().find(not_finite).unwrap_or(&0.0),
            ),
            ("camera half_field_rad", self.half_field_rad),
            ("camera vignette_per_rad2", self.vignette_per_rad2),
            ("camera to_base_mm", self.to_base_mm),
        ][key];
        let expected = KEYS[key].1;
        Err(SimulationError::OutOfRange {
            field,
            found,
            expected,
        })
    }

    /// Image of the point at (x, y) mm, `over_base_mm` above the gel's base: its place in the 640 x 480 frame and the
    /// pixels that one millimetre across the ray covers there.
    #[must_use]
    pub fn project(&self, at_mm: [f64; 2], over_base_mm: f64) -> ([f64; 2], f64) {
        let [u, v, scale] = self.lens().project(
            [at_mm[0] as f32, at_mm[1] as f32],
            (self.to_base_mm + over_base_mm) as f32,
        );
        ([f64::from(u), f64::from(v)], f64::from(scale))
    }

    pub(crate) fn lens(&self) -> Lens {
        Lens {
            focal: self.focal_px_per_rad as f32,
            centre: self.centre_px.map(|c| c as f32),
        }
    }
}

/// A camera file under reading.
struct CameraFile<'a> {
    text: &'a str,
    table: DeTable<'a>,
}

impl<'a> CameraFile<'a> {
    fn parse(text: &'a str) -> Result<Self, SimulationError> {
        let table = DeTable::parse(text).map_err(|error| {
            let line = line_of(text, error.span().map_or(0, |span| span.start));
            let written = text.lines().nth(line - 1).unwrap_or_default();
            SimulationError::CameraFile {
                line,
                key: written.split('=').next().unwrap_or_default().trim().to_owned(),
                found: "no TOML".to_owned(),
                expected: error.message().to_owned(),
            }
        })?;
        let table = table.into_inner();
        let unknown = table
            .keys()
            .filter(|name| !KEYS.iter().any(|(key, _)| key == name.get_ref()))
            .min_by_key(|name| name.span().start);
        if let Some(name) = unknown {
            return Err(SimulationError::CameraFile {
                line: line_of(text, name.span().start),
                key: name.get_ref().to_string(),
                found: "no key of a camera".to_owned(),
                expected: format!("one of {}", KEYS.map(|(key, _)| key).join(", ")),
            });
        }
        Ok(Self { text, table })
    }

    /// The numbers of key `key`: one, or as many in an array.
    fn numbers<const N: usize>(&self, key: usize) -> Result<[f64; N], SimulationError> {
        let value = self.table.get(KEYS[key].0).map(toml::Spanned::get_ref);
        let numbers: Option<Vec<f64>> = match value {
            Some(DeValue::Array(array)) if N > 1 => {
                array.iter().map(|element| number(element.get_ref())).collect()
            }
            Some(value) if N == 1 => number(value).map(|number| vec![number]),
            _ => None,
        };
        numbers
            .and_then(|numbers| numbers.try_into().ok())
            .ok_or_else(|| self.wrong(key))
    }

    /// The error of key `key`: where it stands and what stands there, or that nothing does.
    fn wrong(&self, key: usize) -> SimulationError {
        let (name, expected) = KEYS[key];
        let (line, found) = match self.table.get_key_value(name) {
            Some((key, value)) => (
                line_of(self.text, key.span().start),
                self.text.get(value.span()).unwrap_or_default().to_owned(),
            ),
            None => (self.text.lines().count().max(1), "missing".to_owned()),
        };
        SimulationError::CameraFile {
            line,
            key: name.to_owned(),
            found,
            expected: expected.to_owned(),
        }
    }
}

/// A number, written with a point or without.
fn number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(float) => float.as_str().parse().ok(),
        DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str().parse().ok(),
        _ => None,
    }
}

/// Line of a byte, from 1.
fn line_of(text: &str, byte: usize) -> usize {
    let before = text.get(..byte).unwrap_or(text);
    1 + before.matches('\n').count()
}

/// The camera in single precision, for the inner loop.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lens {
    focal: f32,
    centre: [f32; 2],
}

impl Lens {
    /// Column, row and pixels per millimetre of a point `height_mm` above the centre of projection.
    pub(crate) fn project(&self, at_mm: [f32; 2], height_mm: f32) -> [f32; 3] {
        let [x, y] = at_mm;
        let aside = (x * x + y * y).sqrt();
        let distance = (aside * aside + height_mm * height_mm).sqrt();
        // θ/ρ stays finite on the axis.
        let turn = if aside > 1e-3 {
            libm::atan2f(aside, height_mm) / aside
        } else {
            1.0 / height_mm
        };
        let scale = self.focal * turn;
        [
            self.centre[0] + x * scale,
            self.centre[1] + y * scale,
            self.focal / distance,
        ]
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::constants::{CROP_CORNER_PX, CROP_PX, HALF_SURFACE_MM};

    #[test]
    fn points_at_known_angles_land_where_an_equidistant_lens_puts_them() {
        let camera = Camera::default();
        // The middle, and the surface's edge at the crop's edge.
        let (at, scale) = camera.project([0.0, 0.0], 6.0);
        assert!((at[0] - 320.0).abs() < 1e-9 && (at[1] - 240.0).abs() < 1e-9);
        assert!((scale - camera.focal_px_per_rad / 18.0).abs() < 1e-4);
        let (at, _) = camera.project([HALF_SURFACE_MM, 0.0], 6.0);
        let edge = (CROP_CORNER_PX[0] + CROP_PX) as f64;
        assert!((at[0] - edge).abs() < 1e-3 && (at[1] - 240.0).abs() < 1e-3);
        // 45° along a diagonal, from any height.
        for height in [0.5, 6.0] {
            let aside = (camera.to_base_mm + height) / 2.0_f64.sqrt();
            let (at, _) = camera.project([aside, -aside], height);
            let along = camera.focal_px_per_rad * PI / 4.0 / 2.0_f64.sqrt();
            assert!((at[0] - 320.0 - along).abs() < 1e-3 && (at[1] - 240.0 + along).abs() < 1e-3);
        }
        // r = f θ: three times the angle, three times the way.
        let radius = |angle: f64| camera.project([18.0 * angle.tan(), 0.0], 6.0).0[0] - 320.0;
        assert!((radius(0.6) - 3.0 * radius(0.2)).abs() < 1e-3);
    }

    #[test]
    fn a_camera_comes_back_from_its_file_to_the_last_bit() {
        let odd = Camera {
            focal_px_per_rad: 1000.0 / 3.0,
            centre_px: [-0.1, 1e-9],
            half_field_rad: 1.0,
            vignette_per_rad2: 0.0,
            to_base_mm: 1e22,
        };
        for camera in [Camera::default(), odd] {
            assert_eq!(Camera::from_toml(&camera.to_toml()).unwrap(), camera);
        }
        // Whole numbers may stand without a point.
        let text = odd
            .to_toml()
            .replace("half_field_rad = 1.0", "half_field_rad = 1");
        assert_eq!(Camera::from_toml(&text).unwrap(), odd);
    }

    #[test]
    fn a_bad_camera_file_names_line_and_key() {
        let good = Camera::default().to_toml();
        let error = |from: &str, to: &str| {
            assert!(good.contains(from), "{from}");
            Camera::from_toml(&good.replace(from, to))
                .unwrap_err()
                .to_string()
        };
        for (from, to, expected) in [
            (
                "focal_px_per_rad = 302.7624",
                "focal_px_per_rad = -3",
                "line 1: focal_px_per_rad is -3, expected a finite number above 0",
            ),
            (
                "302.7624",
                "\"300 px\"",
                "line 1: focal_px_per_rad is \"300 px\", expected a finite number above 0",
            ),
            (
                "[320.0, 240.0]",
                "[320.0]",
                "line 2: centre_px is [320.0], expected two finite numbers, [x, y]",
            ),
            (
                "[320.0, 240.0]",
                "[320.0, nan]",
                "line 2: centre_px is [320.0, nan], expected two finite numbers, [x, y]",
            ),
            (
                "[320.0, 240.0]",
                "320.0",
                "line 2: centre_px is 320.0, expected two finite numbers, [x, y]",
            ),
            (
                "1.5708",
                "3.1",
                "line 3: half_field_rad is 3.1, expected a number above 0, at most 1.5708 (π/2)",
            ),
            (
                "_per_rad2 = 0.1",
                "_per_rad2 = 1.5",
                "line 4: vignette_per_rad2 is 1.5, expected a number from 0 to 1",
            ),
            (
                "to_base_mm = 12.0",
                "to_base_mm = inf",
                "line 5: to_base_mm is inf, expected a finite number above 0",
            ),
            (
                "to_base_mm = 12.0\n",
                "",
                "line 4: to_base_mm is missing, expected a finite number above 0",
            ),
            (
                "to_base_mm = 12.0",
                "to_base_cm = 1.2",
                "line 5: to_base_cm is no key of a camera, expected one of focal_px_per_rad, centre_px, half_field_rad, \
                 vignette_per_rad2, to_base_mm",
            ),
        ] {
            assert_eq!(error(from, to), format!("camera file, {expected}"));
        }
        let no_toml = error("half_field_rad = 1.5708", "half_field_rad = = 2");
        assert!(
            no_toml.starts_with("camera file, line 3: half_field_rad is no TOML, expected "),
            "{no_toml}"
        );
        let twice = error("to_base_mm = 12.0", "to_base_mm = 12.0\nfocal_px_per_rad = 3.0");
        assert!(
            twice.starts_with("camera file, line 6: focal_px_per_rad is no TOML"),
            "{twice}"
        );
        assert!(
            Camera::from_toml("")
                .unwrap_err()
                .to_string()
                .contains("focal_px_per_rad is missing")
        );
    }
}
