//! The calibration of one fingertip and gripper: what `gripline calibrate` writes and `calibration.file` names. TOML with the
//! sections rest, friction, line, geometry, camera and gel, each with its date, its device and its residual. Units in the names. The file
//! names others (the rest pictures) relative to itself.

use std::fs;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use gripline_evaluation::calibration::gel::{ERROR_MAX, PRESSES_MIN};
use gripline_evaluation::calibration::line::Point;
use gripline_network::constants::{CROP_SIDE, GAINS};
use gripline_protocol::LSB_PER_NEWTON;
use gripline_protocol::line::{DAC_CODE_MAX, LINE_POINTS, LIVE_ZERO_MIN};
use gripline_protocol::message::{Configuration, FingertipGeometry, LinePoint};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use toml::Table;

use crate::error::Error;
use crate::value::nearest;

/// Most rest pictures in a file: 200 MB; a minute of them, 700 MB, is a mistake.
const PICTURES_MAX: u64 = 1_024;
/// A gel's gain is known when its interval reaches no further from it than this share.
const GAIN_KNOWN: f64 = 0.5;
const SECTIONS: [&str; 6] = ["rest", "friction", "line", "geometry", "camera", "gel"];

/// The skin when nothing touches it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Rest {
    pub date: String,
    pub device: String,
    /// The pictures, (N, 440, 440) uint8: their mean is what later ones are compared with, their differences the noise.
    pub pictures: PathBuf,
    /// The mean, for people and `gripline infer --rest`.
    pub mean: PathBuf,
    /// How many pictures there are.
    pub count: usize,
    pub mean_level: f64,
    pub saturated_share: f64,
    pub particles: usize,
    /// Fine over coarse detail.
    pub sharpness: f64,
    /// Standard deviation of a pixel from picture to picture, grey levels.
    pub noise_levels: f64,
    /// Maximum motion of a part of the skin while the pictures were taken, pixels.
    pub residual_px: f64,
}

/// Friction of the skin on the objects to hold.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Friction {
    pub date: String,
    pub device: String,
    /// F_T / F_N while everything slides.
    pub estimate: f64,
    pub low: f64,
    pub high: f64,
    /// Confidence of the interval from low to high.
    pub confidence: f64,
    pub slides: usize,
    /// Standard deviation from slide to slide.
    pub residual: f64,
    /// The detector's friction: below `low`, because slipping taxels are at the true one.
    pub detector: f64,
}

/// The gripper's forces for codes of the grip-force line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Line {
    pub date: String,
    pub device: String,
    pub measured: usize,
    pub residual_rms_n: f64,
    pub residual_max_n: f64,
    /// As the microcontroller's setting `line.points`.
    pub points: Vec<Point>,
}

/// The settings with these points of the line.
pub(crate) fn with_points(settings: &Configuration, points: &[Point]) -> Configuration {
    let mut settings = *settings;
    for (to, point) in settings.line.points.iter_mut().zip(points) {
        *to = LinePoint {
            force: (point.force_n * f64::from(LSB_PER_NEWTON)).round() as i32,
            code: point.code,
        };
    }
    settings
}

/// How the skin sits in the gripper.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Geometry {
    pub date: String,
    pub device: String,
    /// Distance between taxel centres.
    pub pitch_mm: f64,
    /// The map's centre from the gripper's axis.
    pub centre_mm: [f64; 2],
    /// As the microcontroller's setting of the fingertip.
    pub quarter_turns: u8,
    /// Number of presses used.
    pub presses: usize,
    /// Residual rotation beside the quarter turns.
    pub turned_deg: f64,
    pub residual_rms_mm: f64,
    pub residual_max_mm: f64,
}

impl Geometry {
    /// As the microcontroller's setting.
    pub(crate) fn setting(&self) -> FingertipGeometry {
        let um = |mm: f64| (mm * 1e3).round();
        FingertipGeometry {
            pitch_um: um(self.pitch_mm) as u16,
            centre_um: self.centre_mm.map(|mm| um(mm) as i16),
            quarter_turns: self.quarter_turns,
        }
    }
}

/// The camera's view of a gel with printed markers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Camera {
    pub date: String,
    pub device: String,
    /// Identity of the sensor whose description it corrects.
    pub sensor: String,
    /// Pixels of the crop per millimetre, in its middle.
    pub px_per_mm: f64,
    /// Standard error of it.
    pub px_per_mm_error: f64,
    /// Field of the whole crop.
    pub field_mm: [f64; 2],
    /// Distortion of the lens, per mm² from the middle.
    pub distortion_per_mm2: f64,
    /// Number of dots used, and their distance from a regular grid (root mean square).
    pub dots: usize,
    pub residual_px: f64,
}

/// Stiffness of the gel relative to its description.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Gel {
    pub date: String,
    pub device: String,
    /// Identity of the sensor, and the force model whose maps were calibrated: its name and fingerprint.
    pub sensor: String,
    pub model: String,
    /// Factor on normal force, and its interval.
    pub normal_gain: f64,
    pub normal_interval: [f64; 2],
    /// Factor on shear, and its interval; if shear was not measured, those of normal force.
    pub shear_gain: f64,
    pub shear_interval: [f64; 2],
    pub shear_was_measured: bool,
    /// Young's modulus that the normal gain means for a gel as thick as described, and its interval.
    pub young_mpa: f64,
    pub young_interval_mpa: [f64; 2],
    /// Confidence of the intervals.
    pub confidence: f64,
    pub presses: usize,
    /// Median error of presses that were left out, share of the force.
    pub held_out_share: f64,
}

/// A fingertip's calibration, with the sections made so far.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub(crate) struct Calibration {
    /// The file.
    #[serde(skip)]
    pub path: PathBuf,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rest: Option<Rest>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<Friction>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<Line>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub geometry: Option<Geometry>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gel: Option<Gel>,
}

impl Calibration {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// [`Error`] of kind usage that lists everything that is wrong with it.
    pub(crate) fn load(path: &Path) -> Result<Self, Error> {
        let text = fs::read_to_string(path).map_err(|error| {
            Error::usage(format!(
                "{}: {error}, expected a calibration that `gripline calibrate` wrote",
                path.display()
            ))
        })?;
        let mut read = Self::parse(&text)
            .map_err(|errors| Error::usage(format!("{}: {}", path.display(), errors.join("; "))))?;
        path.clone_into(&mut read.path);
        Ok(read)
    }

    /// The one in `path`, or an empty one for that path.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub(crate) fn load_or_new(path: &Path) -> Result<Self, Error> {
        if path.exists() {
            return Self::load(path);
        }
        Ok(Self {
            path: path.to_owned(),
            ..Self::default()
        })
    }

    fn parse(text: &str) -> Result<Self, Vec<String>> {
        let mut table: Table = text
            .parse()
            .map_err(|error: toml::de::Error| vec![format!("{}, expected TOML", error.message())])?;
        let mut errors = Vec::new();
        let read = Self {
            path: PathBuf::new(),
            rest: section(&mut table, "rest", &mut errors),
            friction: section(&mut table, "friction", &mut errors),
            line: section(&mut table, "line", &mut errors),
            geometry: section(&mut table, "geometry", &mut errors),
            camera: section(&mut table, "camera", &mut errors),
            gel: section(&mut table, "gel", &mut errors),
        };
        errors.extend(table.keys().map(|name| match nearest(name, SECTIONS) {
            Some(meant) => format!("{name}: no such section, did you mean {meant}?"),
            None => format!("{name}: no such section, expected one of {}", SECTIONS.join(", ")),
        }));
        errors.extend(read.out_of_range());
        if errors.is_empty() { Ok(read) } else { Err(errors) }
    }

    /// Checks for impossible numbers.
    fn out_of_range(&self) -> Vec<String> {
        let mut errors = Vec::new();
        let mut number = |name: &str, found: f64, min: f64, max: f64| {
            if !(min..=max).contains(&found) {
                errors.push(format!(
                    "{name}: found {found}, expected a number from {min} to {max}"
                ));
            }
        };
        if let Some(friction) = &self.friction {
            number("friction.detector", friction.detector, 0.01, 2.0);
            number("friction.low", friction.low, friction.detector, 10.0);
            number(
                "friction.estimate",
                friction.estimate,
                friction.low,
                friction.high,
            );
            number("friction.confidence", friction.confidence, 0.5, 0.999);
        }
        if let Some(rest) = &self.rest {
            number("rest.count", rest.count as f64, 2.0, PICTURES_MAX as f64);
            number("rest.noise_levels", rest.noise_levels, 0.0, 255.0);
            number("rest.sharpness", rest.sharpness, 0.0, 10.0);
        }
        if let Some(geometry) = &self.geometry {
            number("geometry.pitch_mm", geometry.pitch_mm, 0.1, 10.0);
            for (axis, centre_mm) in geometry.centre_mm.into_iter().enumerate() {
                number(&format!("geometry.centre_mm[{axis}]"), centre_mm, -32.0, 32.0);
            }
            number("geometry.quarter_turns", geometry.quarter_turns.into(), 0.0, 3.0);
        }
        if let Some(camera) = &self.camera {
            number("camera.px_per_mm", camera.px_per_mm, 0.1, 1e4);
            for (axis, field_mm) in camera.field_mm.into_iter().enumerate() {
                number(&format!("camera.field_mm[{axis}]"), field_mm, 1.0, 200.0);
            }
            number("camera.distortion_per_mm2", camera.distortion_per_mm2, -0.1, 0.1);
        }
        if let Some(gel) = &self.gel {
            number("gel.normal_gain", gel.normal_gain, *GAINS.start(), *GAINS.end());
            number("gel.shear_gain", gel.shear_gain, *GAINS.start(), *GAINS.end());
            number("gel.presses", gel.presses as f64, PRESSES_MIN as f64, 1e6);
            number(
                "gel.held_out_share (error of presses that were left out; calibrate the gel again, --out a new file)",
                gel.held_out_share,
                0.0,
                ERROR_MAX,
            );
            for (name, gain, [low, high]) in [
                ("gel.normal_interval", gel.normal_gain, gel.normal_interval),
                ("gel.shear_interval", gel.shear_gain, gel.shear_interval),
            ] {
                // The lower end is no more than the gain, and neither end so far that the gain says nothing.
                number(&format!("{name}[0]"), low, gain * (1.0 - GAIN_KNOWN), gain);
                number(&format!("{name}[1]"), high, gain, gain * (1.0 + GAIN_KNOWN));
            }
        }
        if let Some(line) = &self.line {
            number(
                "line.points (how many)",
                line.points.len() as f64,
                LINE_POINTS as f64,
                LINE_POINTS as f64,
            );
            let (mut force, mut code) = ([0.0, 0.0], LIVE_ZERO_MIN);
            for (place, point) in line.points.iter().enumerate() {
                number(
                    &format!("line.points[{place}].force_n"),
                    point.force_n,
                    force[0],
                    force[1],
                );
                number(
                    &format!("line.points[{place}].code"),
                    point.code.into(),
                    code.into(),
                    DAC_CODE_MAX.into(),
                );
                // The wire's steps are 1/4096 N.
                (force, code) = ([point.force_n + 0.001, 125.0], point.code.saturating_add(1));
            }
        }
        errors
    }

    /// Writes it to its path, completely or not at all.
    ///
    /// # Errors
    /// [`Error`] that names the file.
    pub(crate) fn save(&self) -> Result<(), Error> {
        let body = toml::to_string(self)?;
        let text = format!(
            "# Written by `gripline calibrate`; a configuration names it: calibration.file. Sections can be made again one by \
             one.\n\n{body}"
        );
        write(&self.path, text.as_bytes())
    }

    /// The path of a file that it names, relative to the working directory.
    pub(crate) fn beside(&self, name: &Path) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(name)
    }

    /// The rest pictures, 440×440 each, if there are any.
    ///
    /// # Errors
    /// [`Error`] when their file is missing, damaged or of another shape.
    pub(crate) fn rest_pictures(&self) -> Result<Option<Vec<Vec<u8>>>, Error> {
        let Some(rest) = &self.rest else {
            return Ok(None);
        };
        let path = self.beside(&rest.pictures);
        let wrong = |found: String| {
            Error::failed(format!(
                "{}: {found}, expected the {} rest pictures of {}: run `gripline calibrate rest` again",
                path.display(),
                rest.count,
                self.path.display()
            ))
        };
        let file = fs::File::open(&path).map_err(|error| wrong(error.to_string()))?;
        let npy = npyz::NpyFile::new(BufReader::new(file)).map_err(|error| wrong(error.to_string()))?;
        let side = CROP_SIDE as u64;
        let shape = npy.shape().to_vec();
        if shape != [rest.count as u64, side, side] || npy.order() != npyz::Order::C {
            return Err(wrong(format!("found an array of {shape:?}")));
        }
        let pixels: Vec<u8> = npy.into_vec().map_err(|error| wrong(error.to_string()))?;
        Ok(Some(
            pixels.chunks(CROP_SIDE * CROP_SIDE).map(<[u8]>::to_vec).collect(),
        ))
    }
}

/// Writes a file completely or not at all.
///
/// # Errors
/// [`Error`] that names it.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    fs::write(&part, bytes)
        .and_then(|()| fs::rename(&part, path))
        .map_err(|error| {
            Error::failed(format!(
                "{}: {error}, expected a file in a folder that exists and can be written",
                path.display()
            ))
        })
}

/// Reads a section of the file; its problems go to `errors`.
fn section<T: DeserializeOwned>(table: &mut Table, name: &str, errors: &mut Vec<String>) -> Option<T> {
    let value = table.remove(name)?;
    if !value.is_table() {
        errors.push(format!("{name}: found {value}, expected a section, [{name}]"));
        return None;
    }
    let wrong = |error: toml::de::Error| format!("{name}: {}", error.to_string().trim().replace('\n', ", "));
    value.try_into().map_err(|error| errors.push(wrong(error))).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whole() -> Calibration {
        let text = |text: &str| text.to_owned();
        Calibration {
            path: PathBuf::new(),
            rest: Some(Rest {
                date: text("2026-11-21T14:00:00Z"),
                device: text("finger 3"),
                pictures: "a-rest.npy".into(),
                mean: "a-rest.png".into(),
                count: 16,
                mean_level: 28.0,
                saturated_share: 0.0,
                particles: 2_332,
                sharpness: 0.23,
                noise_levels: 2.0,
                residual_px: 0.002,
            }),
            friction: Some(Friction {
                date: text("2026-11-21T14:00:00Z"),
                device: text("finger 3, box"),
                estimate: 0.65,
                low: 0.6,
                high: 0.7,
                confidence: 0.9,
                slides: 5,
                residual: 0.01,
                detector: 0.5,
            }),
            line: Some(Line {
                date: text("2026-11-21T14:00:00Z"),
                device: text("gripper"),
                measured: 11,
                residual_rms_n: 0.01,
                residual_max_n: 0.02,
                points: (0..5)
                    .map(|k| Point {
                        force_n: 10.0 * f64::from(k),
                        code: 819 * (1 + k),
                    })
                    .collect(),
            }),
            geometry: Some(Geometry {
                date: text("2026-11-21T14:00:00Z"),
                device: text("finger 3"),
                pitch_mm: 1.583,
                centre_mm: [-0.25, 2.0],
                quarter_turns: 3,
                presses: 5,
                turned_deg: 0.8,
                residual_rms_mm: 0.1,
                residual_max_mm: 0.2,
            }),
            camera: Some(Camera {
                date: text("2026-11-21T14:00:00Z"),
                device: text("finger 3"),
                sensor: text("gelsight-mini.1"),
                px_per_mm: 17.1,
                px_per_mm_error: 0.02,
                field_mm: [18.7, 14.0],
                distortion_per_mm2: 1e-4,
                dots: 70,
                residual_px: 0.1,
            }),
            gel: Some(Gel {
                date: text("2026-11-21T14:00:00Z"),
                device: text("finger 3"),
                sensor: text("gelsight-mini.1"),
                model: text("markers 1234abcd"),
                normal_gain: 0.9,
                normal_interval: [0.85, 0.95],
                shear_gain: 0.9,
                shear_interval: [0.85, 0.95],
                shear_was_measured: false,
                young_mpa: 0.39,
                young_interval_mpa: [0.36, 0.41],
                confidence: 0.9,
                presses: 12,
                held_out_share: 0.04,
            }),
        }
    }

    #[test]
    fn what_is_written_reads_back() {
        let text = toml::to_string(&whole()).unwrap();
        assert_eq!(Calibration::parse(&text), Ok(whole()), "{text}");
        let table: Table = text.parse().unwrap();
        assert!(SECTIONS.iter().all(|section| table.contains_key(*section)));
    }

    #[test]
    fn the_geometry_is_the_microcontrollers_setting() {
        let setting = whole().geometry.unwrap().setting();
        assert_eq!(
            (setting.pitch_um, setting.centre_um, setting.quarter_turns),
            (1_583, [-250, 2_000], 3)
        );
    }

    #[test]
    fn every_error_is_reported_with_what_was_found_and_expected() {
        let text = toml::to_string(&whole()).unwrap();
        let said = |from: &str, to: &str| {
            Calibration::parse(&text.replacen(from, to, 1))
                .unwrap_err()
                .join("; ")
        };
        for (from, to, expected) in [
            (
                "noise_levels",
                "noise_levles",
                "rest: unknown field `noise_levles`, expected one of `date`, ",
            ),
            (
                "[friction]",
                "[frcition]",
                "frcition: no such section, did you mean friction?",
            ),
            (
                "[friction]",
                "[xyz]",
                "xyz: no such section, expected one of rest, friction, line, geometry, camera, gel",
            ),
            (
                "detector = 0.5",
                "detector = 0.66",
                "friction.low: found 0.6, expected a number from 0.66 to 10",
            ),
            (
                "detector = 0.5",
                "detector = 0.0",
                "friction.detector: found 0, expected a number from 0.01 to 2",
            ),
            (
                "code = 1638",
                "code = 700",
                "line.points[1].code: found 700, expected a number from 820 to 4095",
            ),
            (
                "force_n = 0.0",
                "force_n = 1.0",
                "line.points[0].force_n: found 1, expected a number from 0 to 0",
            ),
            (
                "quarter_turns = 3",
                "quarter_turns = 4",
                "geometry.quarter_turns: found 4, expected a number from 0 to 3",
            ),
            (
                "slides = 5",
                "slides = \"five\"",
                "friction: invalid type: string \"five\", expected usize, in `slides`",
            ),
            ("slides = 5\n", "", "friction: missing field `slides`"),
            (
                "count = 16",
                "count = 1",
                "rest.count: found 1, expected a number from 2 to 1024",
            ),
        ] {
            let said = said(from, to);
            assert!(said.contains(expected), "{to}: {said}");
        }
        let two = text.replacen("count", "cuont", 1).replacen("slides", "slidse", 1);
        assert_eq!(Calibration::parse(&two).unwrap_err().len(), 2);
        assert!(Calibration::parse("rest = 1").unwrap_err()[0].contains("expected a section, [rest]"));
        assert!(Calibration::parse("[rest").unwrap_err()[0].contains("expected TOML"));
    }
}
