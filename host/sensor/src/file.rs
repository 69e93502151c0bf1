//! Reads a description: the shipped ones by name, others by path. Touches files.

use std::cell::RefCell;
use std::fs;
use std::path::Path;

use toml::de::DeTable;

use crate::description::{
    Capture, Colour, Flip, Forces, Gel, Health, Lens, MarkerKind, Markers, Polarity, Sensor, Taxels, View,
};
use crate::error::{Problem, SensorError};
use crate::plausible;
use crate::table::{Section, line_of};

/// The descriptions that are built in: name and file's text. The first is the default.
pub const SHIPPED: [(&str, &str); 2] = [
    (
        "particle-fingertip",
        include_str!("../../sensors/particle-fingertip.toml"),
    ),
    ("gelsight-mini", include_str!("../../sensors/gelsight-mini.toml")),
];
/// What is read of a file at most, bytes: bounds the cost of a wrong path.
const FILE_MAX_BYTES: u64 = 1 << 20;
/// The only schema so far.
const SCHEMA: usize = 1;
/// Largest side of a picture, pixels.
const SIDE_MAX: usize = 10_000;

impl Sensor {
    /// The shipped sensor of this name, or the one that the file of this path describes.
    ///
    /// # Errors
    /// [`SensorError`] that names the file, and every problem with its line and key.
    pub fn named(name_or_path: &Path) -> Result<Self, SensorError> {
        Self::from_toml(name_or_path, &Self::text_of(name_or_path)?)
    }

    /// The text of the shipped description of this name, or of the file of this path.
    ///
    /// # Errors
    /// [`SensorError::Read`] that names the file.
    pub fn text_of(name_or_path: &Path) -> Result<String, SensorError> {
        let shipped = SHIPPED.iter().find(|(name, _)| Path::new(name) == name_or_path);
        if let Some((_, text)) = shipped {
            return Ok((*text).to_owned());
        }
        let read = fs::metadata(name_or_path).and_then(|metadata| {
            if metadata.len() > FILE_MAX_BYTES {
                return Err(std::io::Error::other(format!("has {} bytes", metadata.len())));
            }
            fs::read_to_string(name_or_path)
        });
        read.map_err(|error| {
            let names: Vec<_> = SHIPPED.iter().map(|(name, _)| *name).collect();
            SensorError::Read {
                file: name_or_path.to_owned(),
                error,
                advice: format!("name a file, or one of {}", names.join(", ")),
            }
        })
    }

    /// The default sensor.
    ///
    /// # Errors
    /// Never, as long as the shipped description is whole: a test reads it.
    pub fn default_one() -> Result<Self, SensorError> {
        Self::named(Path::new(SHIPPED[0].0))
    }

    /// The sensor that this text describes; `file` is what messages call it.
    ///
    /// # Errors
    /// As [`Self::named`].
    pub fn from_toml(file: &Path, text: &str) -> Result<Self, SensorError> {
        let table = DeTable::parse(text).map_err(|error| SensorError::Syntax {
            file: file.to_owned(),
            line: line_of(text, error.span().map_or(0, |span| span.start)),
            said: error.message().to_owned(),
        })?;
        let problems = RefCell::new(Vec::new());
        let head = Section::head(text, table.get_ref(), &problems);
        let sensor = read(&head);
        let mut problems: Vec<Problem> = problems.take();
        if problems.is_empty() {
            return Ok(sensor);
        }
        problems.sort_by_key(|problem| problem.line);
        Err(SensorError::Description {
            file: file.to_owned(),
            problems,
        })
    }
}

fn read(head: &Section<'_>) -> Sensor {
    head.whole("schema", SCHEMA..=SCHEMA);
    let is_name = |text: &str| {
        let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        !text.is_empty() && text.len() <= 40 && text.chars().all(plain)
    };
    let sections = ["capture", "view", "gel", "markers", "taxels", "health"].map(|name| head.section(name));
    let [capture, view, gel, markers, taxels, health] = &sections;
    let forces = head.section("forces");
    let sensor = Sensor {
        name: head.text(
            "name",
            "at most 40 lower-case letters, digits and hyphens",
            is_name,
        ),
        revision: head.whole("revision", 1..=1_000_000) as u32,
        summary: head.text("summary", "one line of text", |text| {
            !text.is_empty() && !text.contains('\n')
        }),
        capture: read_capture(capture),
        view: View {
            field_mm: view.numbers("field_mm", 1.0..=200.0),
            zoom: view.span("zoom", 1.0..=10.0),
            lens: view.choice("lens", &[("flat", Lens::Flat), ("fisheye", Lens::Fisheye)]),
            distortion_per_mm2: 0.0,
        },
        gel: Gel {
            pad_mm: gel.numbers("pad_mm", 1.0..=200.0),
            thickness_mm: gel.number("thickness_mm", 0.1..=50.0),
            young_mpa: gel.number("young_mpa", 0.005..=10.0),
            poisson: gel.number("poisson", 0.0..=0.499),
        },
        markers: read_markers(markers),
        taxels: Taxels {
            grid: taxels.wholes("grid", 1..=20),
            pitch_mm: taxels.number("pitch_mm", 0.1..=20.0),
        },
        health: Health {
            brightness: health.span("brightness", 0.05..=20.0),
            rest_level: health.span("rest_level", 0.0..=255.0),
            overexposed_level: health.number("overexposed_level", 1.0..=255.0),
            overexposed_share: health.number("overexposed_share", 0.0..=1.0),
            lost_share: health.number("lost_share", 0.0..=1.0),
        },
        forces: Forces {
            weights: forces.text(
                "weights",
                "the name of a model (tracked, elastic-layer) or of a weights file (*.safetensors)",
                |text| !text.is_empty() && !text.contains('\n'),
            ),
        },
    };
    // Values that are missing or out of range have been replaced; whether they fit each other says nothing then.
    if !head.has_problems() {
        plausible::check(&sensor, &sections);
    }
    head.finish();
    for section in sections.iter().chain([&forces]) {
        section.finish();
    }
    sensor
}

fn read_capture(capture: &Section<'_>) -> Capture {
    let crop_px = capture.wholes("crop_px", 0..=SIDE_MAX);
    Capture {
        camera_px: capture.wholes("camera_px", 16..=SIDE_MAX),
        size_px: capture.wholes("size_px", 16..=SIDE_MAX),
        rate_hz: capture.number("rate_hz", 0.1..=10_000.0),
        colour: capture.choice("colour", &[("rgb", Colour::Rgb), ("grey", Colour::Grey)]),
        crop_px,
        flip: capture.choice(
            "flip",
            &[
                ("none", Flip::None),
                ("horizontal", Flip::Horizontal),
                ("vertical", Flip::Vertical),
                ("both", Flip::Both),
            ],
        ),
    }
}

fn read_markers(markers: &Section<'_>) -> Markers {
    let kind = markers.choice(
        "kind",
        &[("plane", MarkerKind::Plane), ("volume", MarkerKind::Volume)],
    );
    Markers {
        kind,
        polarity: markers.choice(
            "polarity",
            &[("dark", Polarity::Dark), ("bright", Polarity::Bright)],
        ),
        pitch_mm: (kind == MarkerKind::Plane).then(|| markers.span("pitch_mm", 0.05..=50.0)),
        diameter_mm: markers.span("diameter_mm", 0.005..=20.0),
        depth_mm: markers.span("depth_mm", 0.0..=50.0),
        count: {
            let [fewest, max] = markers.wholes("count", 1..=1_000_000);
            if fewest > max {
                markers.note(
                    "count",
                    &format!("[{fewest}, {max}]"),
                    "fewest and most",
                    "swap the two",
                );
            }
            [fewest, max]
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shipped(name: &str) -> &'static str {
        SHIPPED.iter().find(|(shipped, _)| *shipped == name).unwrap().1
    }

    /// The problems of a text, one a line.
    fn problems(text: &str) -> String {
        match Sensor::from_toml(Path::new("my.toml"), text) {
            Err(SensorError::Description { problems, .. }) => problems
                .iter()
                .map(ToString::to_string)
                .collect::<Vec<_>>()
                .join("\n"),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn the_shipped_descriptions_are_complete_plausible_and_carry_their_files_names() {
        for (name, _) in SHIPPED {
            let sensor = Sensor::named(Path::new(name)).unwrap();
            assert_eq!(sensor.identity(), format!("{name}.1"));
        }
        let mini = Sensor::named(Path::new("gelsight-mini")).unwrap();
        // Recordings of this sensor have markers 31.7 and 44 pixels apart.
        let [min, max] = mini.pitch_px().unwrap();
        assert!(min < 31.7 && max > 44.0, "{min} {max}");
    }

    #[test]
    fn a_missing_key_an_unknown_one_and_a_wrong_value_are_all_named_with_their_lines() {
        let text = shipped("gelsight-mini")
            .replace("rate_hz = 25.0\n", "")
            .replace("polarity = \"dark\"", "polarity = \"black\"")
            .replace("poisson = 0.49", "poisson = 0.49\npoison = 0.4")
            .replace("thickness_mm = 4.25", "thickness_mm = 425");
        let found = problems(&text);
        let lines: Vec<_> = found.lines().collect();
        assert_eq!(lines.len(), 4, "{found}");
        assert!(lines[0].contains("capture.rate_hz: found no such key"), "{found}");
        assert!(
            lines[1].contains("gel.thickness_mm: found 425, expected a number from 0.1 to 50"),
            "{found}"
        );
        assert!(
            lines[2].contains("gel.poison: found an unknown key")
                && lines[2].ends_with("did you mean poisson?"),
            "{found}"
        );
        assert!(
            lines[3].contains("markers.polarity: found \"black\", expected \"dark\" or \"bright\""),
            "{found}"
        );
        let at = text
            .lines()
            .position(|line| line.starts_with("polarity"))
            .unwrap()
            + 1;
        assert!(lines[3].starts_with(&format!("{at}: ")), "{found}");
    }

    #[test]
    fn a_missing_section_is_one_problem_and_printed_markers_need_a_pitch_that_particles_have_not() {
        let text = shipped("gelsight-mini");
        let [health, forces] = ["[health]", "[forces]"].map(|section| text.find(section).unwrap());
        let without = format!("{}{}", &text[..health], &text[forces..]);
        assert_eq!(
            problems(&without),
            "1: health: found no such section, expected [health]: add it"
        );
        assert!(
            problems(&text.replace("pitch_mm = [1.8, 2.0]\n", ""))
                .contains("markers.pitch_mm: found no such key")
        );
        let particles = shipped("particle-fingertip").replace(
            "polarity = \"bright\"",
            "polarity = \"bright\"\npitch_mm = [1, 2]",
        );
        assert!(problems(&particles).contains("markers.pitch_mm: found an unknown key"));
    }

    #[test]
    fn values_that_do_not_fit_each_other_are_named() {
        for (from, to, named) in [
            (
                "crop_px = [0, 0, 320, 240]",
                "crop_px = [10, 0, 320, 240]",
                "capture.crop_px",
            ),
            ("size_px = [320, 240]", "size_px = [320, 200]", "capture.crop_px"),
            (
                "field_mm = [18.6, 14.3]",
                "field_mm = [14.3, 18.6]",
                "view.field_mm",
            ),
            (
                "diameter_mm = [0.6, 1.0]",
                "diameter_mm = [0.6, 1.9]",
                "markers.diameter_mm",
            ),
            (
                "depth_mm = [0.0, 0.3]",
                "depth_mm = [0.0, 5.0]",
                "markers.depth_mm",
            ),
            ("count = [24, 84]", "count = [300, 840]", "markers.count"),
            ("pitch_mm = 0.93", "pitch_mm = 9.3", "taxels.pitch_mm"),
            ("zoom = [1.0, 1.45]", "zoom = [1.45, 1.0]", "view.zoom"),
        ] {
            let text = shipped("gelsight-mini").replace(from, to);
            let found = problems(&text);
            assert!(found.contains(&format!("{named}: ")), "{named}: {found}");
            assert_eq!(found.lines().count(), 1, "{found}");
        }
    }

    #[test]
    fn a_file_that_is_not_there_and_one_that_is_no_toml_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        let missing = Sensor::named(&path).unwrap_err().to_string();
        assert!(
            missing.contains("mine.toml") && missing.contains("particle-fingertip, gelsight-mini"),
            "{missing}"
        );
        fs::write(&path, "schema = 1\nname =\n").unwrap();
        let broken = Sensor::named(&path).unwrap_err().to_string();
        assert!(broken.contains("mine.toml:2"), "{broken}");
        fs::write(
            &path,
            shipped("gelsight-mini").replace("revision = 1", "revision = 3"),
        )
        .unwrap();
        assert_eq!(Sensor::named(&path).unwrap().identity(), "gelsight-mini.3");
    }

    #[test]
    fn a_description_with_several_problems_tells_the_first_and_how_many_more() {
        let text = shipped("gelsight-mini")
            .replace("rate_hz = 25.0\n", "")
            .replace("poisson = 0.49\n", "");
        let error = Sensor::from_toml(Path::new("my.toml"), &text)
            .unwrap_err()
            .to_string();
        assert!(
            error.starts_with("my.toml:") && error.ends_with("(1 more: gripline sensor check my.toml)"),
            "{error}"
        );
    }
}
