//! What stands for the untouched gel of printed markers: frames of the clip itself, other pictures, those of a recording, or the
//! regular grid. Touches files.

use std::ffi::OsStr;
use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use gripline_capture::ColourPlayback;
use gripline_markers::RestKind;
use gripline_pipeline::markers::MarkerRest;
use gripline_sensor::Sensor;
use gripline_simulation::constants::REST_PICTURES;

use crate::error::Error;
use crate::source::{Frames, Source};

/// Pictures at rest that are enough, the last of a span and the first of a folder: more make the start slow and the median no
/// better. ffmpeg opens each file of a folder that is no PNG.
const SPAN_PICTURES_MAX: usize = 64;
const FOLDER_PICTURES_MAX: usize = 24;
/// Pictures of a clip or a folder that are looked at for an imprint that is gone, and how far into a clip they reach: every picture
/// before the last of them is decoded at the start.
const CLIP_PICTURES: usize = 16;
const CLIP_REACH: usize = 500;
/// What the regular grid costs (docs/evidence.md, imprint without a rest picture).
const GRID_COST: &str = "on recorded grasps that costs evidence of slip 0.13 of its area under the ROC curve, and forces count from the grid";

/// What `--rest` names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RestSource {
    /// These frames of the pictures themselves, the last not among them.
    Span(Range<usize>),
    /// A picture, a clip, or a folder of pictures.
    Path(PathBuf),
}

impl FromStr for RestSource {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let Some((from, to)) = text.split_once("..").filter(|(from, to)| {
            let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
            !Path::new(text).exists() && (is_number(from) || is_number(to))
        }) else {
            return Ok(Self::Path(text.into()));
        };
        match (from.parse(), to.parse()) {
            (Ok(from), Ok(to)) if from < to => Ok(Self::Span(from..to)),
            _ => Err(format!(
                "found {text}, expected frames of the clip such as 12..20, a picture, or a folder of pictures"
            )),
        }
    }
}

impl fmt::Display for RestSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Span(span) => write!(f, "{}..{}", span.start, span.end),
            Self::Path(path) => write!(f, "{}", path.display()),
        }
    }
}

/// The rest of a source's fingertip. `wanted` is what was asked for; `opened` the source at work.
///
/// # Errors
/// [`Error`] when it cannot be read, or a span is longer than what it is of.
pub(crate) fn of(
    wanted: Option<&RestSource>,
    source: &Source,
    opened: &Frames,
    (sensor, fingertip): (&Sensor, usize),
) -> Result<MarkerRest, Error> {
    match (wanted, source, opened) {
        (Some(RestSource::Span(span)), Source::Clip(path) | Source::Folder(path), _) => {
            span_of(span, path, sensor, fingertip)
        }
        (Some(RestSource::Span(span)), other, _) => Err(Error::usage(format!(
            "sensor.rest (--rest): found {}..{} with camera.source {other}, expected file:CLIP or dir:FOLDER beside frames: name a \
             picture or a folder",
            span.start, span.end
        ))),
        (Some(RestSource::Path(path)), ..) => pictures_beside(path, source, sensor, fingertip),
        (None, _, Frames::Recording(recorded)) => Ok(MarkerRest::recorded(
            recorded.metadata().rest.as_str(),
            recorded.rest(),
        )?),
        (None, _, Frames::Colour(playback)) => {
            if let Some(file) = playback.rest() {
                return pictures_beside(file, source, sensor, fingertip);
            }
            tracing::warn!(
                "no --rest: the regular grid of markers and an even light stand for it; {GRID_COST}"
            );
            Ok(MarkerRest::grid())
        }
        (None, _, Frames::Camera(camera)) => Ok(MarkerRest {
            pictures: camera
                .take_frames(REST_PICTURES.into())?
                .into_iter()
                .map(|frame| frame.crop)
                .collect(),
            kind: RestKind::Own,
            named: "the pictures of the start".to_owned(),
            first: 0,
            clip: Vec::new(),
        }),
        (None, ..) => Ok(MarkerRest::grid()),
    }
}

/// Pictures with their numbers.
type Numbered = Vec<(usize, Vec<u8>)>;

/// The pictures of a span, some pictures of all of a clip or a folder, and the number of pictures that were passed.
fn look_through(
    path: &Path,
    sensor: &Sensor,
    fingertip: usize,
    span: &Range<usize>,
) -> Result<(Vec<Vec<u8>>, Numbered, usize), Error> {
    let mut frames = ColourPlayback::open(path, &sensor.capture, fingertip)?;
    let (mut pictures, mut clip, mut read) = (Vec::new(), Vec::new(), 0);
    let (reach, mut every) = match frames.left() {
        Some(left) => (left, left.div_ceil(CLIP_PICTURES).max(1)),
        None => (CLIP_REACH, 1),
    };
    while read < span.end.max(reach) {
        let is_sample = read < reach && read % every == 0;
        if is_sample || span.contains(&read) {
            let Some((picture, _)) = frames.next_picture() else {
                break;
            };
            if is_sample {
                clip.push((read, picture.clone()));
            }
            if span.contains(&read) {
                pictures.push(picture);
            }
        } else if !frames.pass() {
            break;
        }
        // A clip's length shows at its end: every other one goes whenever there are too many.
        if clip.len() > 2 * CLIP_PICTURES {
            every *= 2;
            clip.retain(|(number, _)| number % every == 0);
        }
        read += 1;
    }
    Ok((pictures, clip, read))
}

fn span_of(span: &Range<usize>, path: &Path, sensor: &Sensor, fingertip: usize) -> Result<MarkerRest, Error> {
    let (mut pictures, clip, read) = look_through(path, sensor, fingertip, span)?;
    let named = format!("--rest {}..{}", span.start, span.end);
    if read < span.end {
        return Err(Error::failed(format!(
            "{named}: found {read} frames in {}, expected at least {}: choose a span inside it",
            path.display(),
            span.end
        )));
    }
    let surplus = pictures.len().saturating_sub(SPAN_PICTURES_MAX);
    pictures.drain(..surplus);
    Ok(MarkerRest {
        pictures,
        kind: RestKind::Own,
        named: format!("{named} of {}", path.display()),
        first: span.start + surplus,
        clip,
    })
}

/// The pictures of a path, and some of the source that they are at rest for.
fn pictures_beside(
    path: &Path,
    source: &Source,
    sensor: &Sensor,
    fingertip: usize,
) -> Result<MarkerRest, Error> {
    let mut rest = pictures_of(path, sensor)?;
    if let Source::Clip(played) | Source::Folder(played) = source {
        (_, rest.clip, _) = look_through(played, sensor, fingertip, &(0..0))?;
    }
    Ok(rest)
}

fn pictures_of(path: &Path, sensor: &Sensor) -> Result<MarkerRest, Error> {
    // What is named rest.png in a folder of rest pictures is one of them.
    let files = if path.is_dir() {
        gripline_capture::picture::list(path)?
    } else {
        vec![path.to_owned()]
    };
    let mut pictures = Vec::new();
    for file in files {
        if pictures.len() == FOLDER_PICTURES_MAX {
            break;
        }
        let mut frames = ColourPlayback::open(&file, &sensor.capture, 0)?;
        while pictures.len() < FOLDER_PICTURES_MAX
            && let Some((picture, _)) = frames.next_picture()
        {
            pictures.push(picture);
        }
    }
    let name = path.file_name().unwrap_or_else(|| OsStr::new("rest"));
    if pictures.is_empty() {
        return Err(Error::failed(format!(
            "--rest {}: found no pictures, expected some of the untouched gel",
            path.display()
        )));
    }
    tracing::info!("at rest: {} pictures of {}", pictures.len(), name.display());
    Ok(MarkerRest {
        pictures,
        kind: RestKind::Other,
        named: format!("--rest {}", path.display()),
        first: 0,
        clip: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rest_is_a_span_of_frames_or_a_path() {
        assert_eq!("12..20".parse(), Ok(RestSource::Span(12..20)));
        assert_eq!("rest.png".parse(), Ok(RestSource::Path("rest.png".into())));
        assert_eq!("../rest".parse(), Ok(RestSource::Path("../rest".into())));
        for wrong in ["20..12", "12..", "..7"] {
            let error = wrong.parse::<RestSource>().unwrap_err();
            assert!(error.contains(wrong) && error.contains("12..20"), "{error}");
        }
    }

    #[test]
    fn a_folder_is_looked_at_evenly_and_only_what_is_wanted_of_it_is_read() {
        let folder = tempfile::tempdir().unwrap();
        for number in 0..40_u8 {
            let name = folder.path().join(format!("{number:04}.png"));
            // The others are no pictures: reading one would be reported, and shift what comes after it.
            if number % 3 != 0 && !(12..14).contains(&number) {
                std::fs::write(name, "none").unwrap();
                continue;
            }
            let mut encoder = png::Encoder::new(std::fs::File::create(name).unwrap(), 320, 240);
            encoder.set_color(png::ColorType::Rgb);
            let mut writer = encoder.write_header().unwrap();
            writer.write_image_data(&vec![5 * number; 3 * 320 * 240]).unwrap();
        }
        let sensor = Sensor::named(Path::new("gelsight-mini")).unwrap();
        let (pictures, clip, read) = look_through(folder.path(), &sensor, 0, &(12..14)).unwrap();
        assert_eq!(read, 40);
        let level = |picture: &[u8]| usize::from(picture[0]) / 5;
        assert_eq!(
            pictures.iter().map(|picture| level(picture)).collect::<Vec<_>>(),
            [12, 13]
        );
        let numbers: Vec<usize> = clip.iter().map(|(number, _)| *number).collect();
        assert_eq!(numbers, (0..40).step_by(3).collect::<Vec<_>>());
        assert!(clip.iter().all(|(number, picture)| level(picture) == *number));
    }
}
