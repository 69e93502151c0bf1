//! `gripline run --sensor` with printed markers: a clip, picture by picture, to health, markers and evidence of slip. No forces are
//! known of such a sensor yet, so no microcontroller is asked and no line is driven.

use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use gripline_capture::clip::ColourClip;
use gripline_markers::{Filled, Finger, Hold, Observation, Rest, RestKind};
use gripline_sensor::Sensor;
use serde::Serialize;

use crate::error::{Completion, Failure};

/// Pictures of a rest span that differ from their median by more energy show a touch, squared grey levels per pixel.
const REST_ENERGY_MAX: f32 = 8.0;
/// Why there is no line.
const NO_LINE: &str = "none: this sensor's forces are not trained yet, so no line is driven";

/// What `--rest` names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum RestSource {
    /// These frames of the clip itself, the last not among them.
    Span(std::ops::Range<usize>),
    /// A picture, a clip, or a folder of pictures.
    Path(PathBuf),
}

impl std::str::FromStr for RestSource {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let Some((from, to)) = text.split_once("..").filter(|_| !Path::new(text).exists()) else {
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

/// A frame for programs.
#[derive(Debug, Serialize)]
struct FrameLine<'a> {
    frame: usize,
    /// By the clip's rate.
    time_s: f64,
    health: &'a str,
    markers: usize,
    markers_lost: usize,
    /// Missing before there is a rest, and until there is an earlier imprint.
    slip_evidence: Option<f32>,
    quality: Option<f32>,
    imprint_lost: Option<f32>,
    rest: Option<String>,
    line: &'static str,
}

/// The end for programs.
#[derive(Debug, Serialize)]
struct Summary<'a> {
    sensor: String,
    frames: usize,
    doubtful_frames: usize,
    rest: String,
    slip_evidence_most: Option<f32>,
    pitch_px: Option<f32>,
    line: &'a str,
}

/// Plays the clip to its end.
///
/// # Errors
/// [`Failure`] when clip or rest cannot be read, or show no gel with markers at rest.
pub(super) fn run(
    sensor: &Sensor,
    clip: &Path,
    rest: Option<&RestSource>,
    unpaced: bool,
    json: bool,
) -> Result<Completion, Failure> {
    let mut finger = Finger::new(sensor).map_err(Failure::failed)?;
    let span = match rest {
        Some(RestSource::Span(span)) => Some(span.clone()),
        Some(RestSource::Path(path)) => {
            finger.set_rest(rest_of(sensor, path)?);
            None
        }
        None => {
            tracing::warn!(
                "no --rest: the regular grid of markers and an even light stand for it; on recorded grasps that costs evidence of slip 0.13 of \
                 its area under the ROC curve"
            );
            finger.set_rest(Rest::GRID);
            None
        }
    };
    tracing::warn!("grip-force line: {NO_LINE}");
    let mut reader = ColourClip::open(clip, &sensor.capture)?;
    let (rate, start) = (reader.rate(), Instant::now());
    // Pictures before the rest span may show anything, such as fingers that touch each other.
    let first = span.as_ref().map_or(0, |span| span.start);
    let mut at_rest = Vec::new();
    let mut hold = Hold::default();
    let (mut frame, mut doubtful, mut most) = (0, 0, None);
    while let Some(picture) = reader.next_picture() {
        let now = frame;
        frame += 1;
        if now < first {
            continue;
        }
        if !unpaced {
            let due = Duration::from_secs_f64(now as f64 / rate);
            std::thread::sleep(due.saturating_sub(start.elapsed()));
        }
        let seen = finger
            .see(&picture)
            .map_err(|error| Failure::failed(format!("{}, frame {now}: {error}", clip.display())))?;
        if let Some(span) = span.as_ref().filter(|span| span.contains(&now)) {
            at_rest.push(seen.filled.clone());
            if now + 1 == span.end {
                finger.set_rest(rest_from(
                    &finger,
                    &at_rest,
                    RestKind::Own,
                    &format!("--rest {}..{}", span.start, span.end),
                )?);
            }
        }
        let evidence = seen.comparison.and_then(|comparison| hold.step(&[comparison]));
        doubtful += usize::from(seen.doubt.is_some());
        if let Some(evidence) = evidence {
            most = Some(most.map_or(evidence.slip, |most: f32| most.max(evidence.slip)));
        }
        let line = FrameLine {
            frame: now,
            time_s: now as f64 / rate,
            health: seen.doubt.unwrap_or("good"),
            markers: finger.tracker().markers().len(),
            markers_lost: lost(&finger),
            slip_evidence: evidence.map(|evidence| evidence.slip),
            quality: evidence.map(|evidence| evidence.quality),
            imprint_lost: evidence.map(|evidence| evidence.loss),
            rest: finger.rest().map(|kind| kind.to_string()),
            line: NO_LINE,
        };
        if !print(&line, json, &seen)? {
            return Ok(Completion::Whole);
        }
    }
    reader.finish()?;
    if let Some(span) = span.filter(|span| frame < span.end) {
        return Err(Failure::failed(format!(
            "--rest {}..{}: found {frame} frames in {}, expected at least {}: choose a span inside the clip",
            span.start,
            span.end,
            clip.display(),
            span.end
        )));
    }
    let summary = Summary {
        sensor: sensor.identity(),
        frames: frame,
        doubtful_frames: doubtful,
        rest: finger.rest().map_or_else(String::new, |kind| kind.to_string()),
        slip_evidence_most: most,
        pitch_px: finger.tracker().pitch_px(),
        line: NO_LINE,
    };
    if json {
        println!("{}", serde_json::to_string(&summary)?);
    }
    Ok(Completion::Whole)
}

fn lost(finger: &Finger) -> usize {
    let markers = finger.tracker().markers();
    markers.iter().filter(|marker| !marker.seen).count()
}

/// Prints a frame; whether somebody still reads.
fn print(line: &FrameLine<'_>, json: bool, seen: &Observation) -> Result<bool, Failure> {
    let text = if json {
        serde_json::to_string(line)?
    } else {
        let number = |value: Option<f32>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.2}"));
        format!(
            "frame {}: {}, markers {} ({:.0} % lost), slip evidence {} (quality {}), imprint lost {}",
            line.frame,
            line.health,
            line.markers,
            100.0 * seen.lost_share,
            number(line.slip_evidence),
            number(line.quality),
            number(line.imprint_lost),
        )
    };
    match writeln!(io::stdout(), "{text}") {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(error.into()),
    }
}

/// The rest of pictures, if they show the same.
fn rest_from(finger: &Finger, pictures: &[Filled], kind: RestKind, named: &str) -> Result<Rest, Failure> {
    let rest = Rest::of(pictures, kind);
    let most = pictures
        .iter()
        .filter_map(|picture| finger.energy(picture, &rest))
        .fold(0.0, f32::max);
    if most > REST_ENERGY_MAX {
        return Err(Failure::failed(format!(
            "{named}: found pictures that differ (energy {most:.0}), expected an untouched gel (at most {REST_ENERGY_MAX}): choose frames in which \
             nothing touches it"
        )));
    }
    Ok(rest)
}

/// The rest that a picture, a clip or a folder of pictures shows.
fn rest_of(sensor: &Sensor, path: &Path) -> Result<Rest, Failure> {
    let mut files = if path.is_dir() {
        let entries: Result<Vec<_>, _> = std::fs::read_dir(path)?
            .map(|entry| entry.map(|entry| entry.path()))
            .collect();
        entries?
    } else {
        vec![path.to_owned()]
    };
    files.sort();
    let mut pictures = Vec::new();
    for file in &files {
        let mut clip = ColourClip::open(file, &sensor.capture)?;
        while let Some(picture) = clip.next_picture() {
            // Each for itself: pictures of a folder need not follow each other.
            let mut finger = Finger::new(sensor).map_err(Failure::failed)?;
            let seen = finger
                .see(&picture)
                .map_err(|error| Failure::failed(format!("{}: {error}", file.display())))?;
            pictures.push(seen.filled);
        }
        clip.finish()?;
    }
    if pictures.is_empty() {
        return Err(Failure::failed(format!(
            "--rest {}: found no pictures, expected some of the untouched gel",
            path.display()
        )));
    }
    Ok(Rest::of(&pictures, RestKind::Other))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rest_is_a_span_of_frames_or_a_path() {
        assert_eq!("12..20".parse(), Ok(RestSource::Span(12..20)));
        assert_eq!("rest.png".parse(), Ok(RestSource::Path("rest.png".into())));
        for wrong in ["20..12", "12..", "a..b"] {
            let told = wrong.parse::<RestSource>().unwrap_err();
            assert!(told.contains(wrong) && told.contains("12..20"), "{told}");
        }
    }
}
