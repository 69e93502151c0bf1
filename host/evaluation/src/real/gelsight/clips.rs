//! From clips to series of scores, a frame each: reads the list of trials and decodes. Touches files.
//!
//! Two kinds of session, told apart by length. Long clips are in contact from the first picture, so their rest is the median of
//! other objects' first pictures, those of the most similar gels. Short ones show the open hand before.

use std::collections::{BTreeMap, VecDeque};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use gripline_capture::clip::ColourClip;
use gripline_markers::{Comparison, Filled, Finger, Hold, MarkerError, Rest, RestKind};
use gripline_sensor::Sensor;
use serde::Serialize;

use crate::error::EvaluationError;

/// The recordings' folder.
pub(in crate::real) const FOLDER: &str = "gelsight-mini";
/// The list of trials in it.
const LIST: &str = "trials.csv";
const CAMERAS: [&str; 2] = ["camera_0.avi", "camera_2.avi"];
/// Clips of this many frames are in contact throughout.
const LONG_FRAMES: usize = 450;
/// Exposure settles in the frames before this one.
const FIRST_FRAME: usize = 3;
/// Frames at rest of a short clip: the hand is open.
const REST_FRAMES: std::ops::Range<usize> = 12..20;
/// First judged frame of a long and of a short clip.
const ARMED: [usize; 2] = [11, 45];
/// End of what is judged; later the hand opens.
const END_FRAME: usize = 188;
/// Energy of a finger's imprint that was certainly there and of one that is gone, squared grey levels per pixel.
const HELD_ENERGY: f32 = 16.0;
const GONE_ENERGY: f32 = 8.0;
/// Frames at the end of a short clip whose mean place is compared with that at rest.
const RETURN_FRAMES: usize = 5;
/// First pictures of other objects that make a long clip's rest, and how many of one object at most.
const REST_PICTURES: usize = 15;
const REST_PICTURES_OF_ONE_OBJECT: usize = 3;

/// A kind of session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Session {
    /// In contact from the first frame.
    Long,
    /// Open hand, grasp, open hand.
    Short,
}

/// Scores of one frame; more means slip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scores {
    /// Evidence of slip.
    pub(super) slip: f32,
    /// The same without a rest picture.
    pub(super) slip_without_rest: f32,
    /// Energy of the imprint alone.
    pub(super) energy: f32,
    /// How far markers moved since the frame before, mean, pixels.
    pub(super) step_px: f32,
}

/// A trial.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Trial {
    pub(super) name: String,
    pub(super) object: String,
    /// The object was lost at some time; neither when nor on which finger is known.
    pub(super) slip: bool,
    pub(super) session: Session,
    /// The judged frames.
    pub(super) frames: Vec<Scores>,
    /// Of both fingers.
    pub(super) gels: Vec<Gel>,
}

/// A gel in a trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gel {
    /// Markers that were followed.
    pub(super) markers: usize,
    /// Median over markers of the deviation from frame to frame at rest, pixels along one axis; of short clips.
    pub(super) still_px: Option<f32>,
    /// Median distance from rest at the end, pixels; of short clips whose imprint was there and is gone in the last frames.
    pub(super) return_px: Option<f32>,
}

/// A line of the list.
#[derive(Debug, Clone)]
struct Entry {
    name: String,
    object: String,
    slip: bool,
    session: Session,
}

/// The first picture of a long clip, one for each camera.
#[derive(Debug, Clone)]
struct First {
    places: Vec<[f32; 2]>,
    filled: Filled,
}

/// All trials in the folder.
///
/// # Errors
/// [`EvaluationError`] that names the file.
pub(super) fn read(folder: &Path) -> Result<Vec<Trial>, EvaluationError> {
    let sensor = Sensor::named(Path::new("gelsight-mini"))?;
    let entries = entries(&folder.join(LIST))?;
    let firsts: BTreeMap<String, Vec<First>> = in_parallel(&entries, |entry| {
        let wanted = entry.session == Session::Long;
        let firsts = wanted
            .then(|| first_pictures(folder, entry, &sensor))
            .transpose()?;
        Ok((entry.name.clone(), firsts.unwrap_or_default()))
    })?
    .into_iter()
    .collect();
    in_parallel(&entries, |entry| trial(folder, entry, &entries, &firsts, &sensor))
}

/// Does the same with everything, on all cores; the results keep the order.
fn in_parallel<T: Sync, R: Send>(
    items: &[T],
    work: impl Fn(&T) -> Result<R, EvaluationError> + Sync,
) -> Result<Vec<R>, EvaluationError> {
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::new());
    let threads = thread::available_parallelism().map_or(1, usize::from);
    thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    let Some(item) = items.get(index) else { break };
                    let result = work(item);
                    if let Ok(mut results) = results.lock() {
                        results.push((index, result));
                    }
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap_or_default();
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

fn entries(path: &Path) -> Result<Vec<Entry>, EvaluationError> {
    let text = fs::read_to_string(path).map_err(|error| EvaluationError::File {
        file: path.display().to_string(),
        found: error.to_string(),
        expected: "a list of trials: copy it again",
    })?;
    let mut entries = Vec::new();
    for (line, row) in text.lines().enumerate().skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        let parsed = || {
            let [name, object, slip, frames, ..] = cells[..] else {
                return None;
            };
            let frames: usize = frames.parse().ok()?;
            Some(Entry {
                name: name.to_owned(),
                object: object.to_owned(),
                slip: match slip {
                    "0" => false,
                    "1" => true,
                    _ => return None,
                },
                session: if frames >= LONG_FRAMES {
                    Session::Long
                } else {
                    Session::Short
                },
            })
        };
        entries.push(parsed().ok_or_else(|| EvaluationError::File {
            file: format!("{}:{}", path.display(), line + 1),
            found: format!("found {row:?}"),
            expected: "trial,object,slip (0 or 1),frames: copy the list again",
        })?);
    }
    Ok(entries)
}

fn clip(
    folder: &Path,
    entry: &Entry,
    camera: &str,
    sensor: &Sensor,
) -> Result<(PathBuf, ColourClip), EvaluationError> {
    let path = folder.join(&entry.name).join(camera);
    let clip = ColourClip::open(&path, &sensor.capture)?;
    Ok((path, clip))
}

fn first_pictures(folder: &Path, entry: &Entry, sensor: &Sensor) -> Result<Vec<First>, EvaluationError> {
    let mut firsts = Vec::new();
    for camera in CAMERAS {
        let (path, mut clip) = clip(folder, entry, camera, sensor)?;
        let picture = std::iter::from_fn(|| clip.next_picture()).nth(FIRST_FRAME);
        let picture = picture.ok_or_else(|| short(&path, FIRST_FRAME))?;
        let mut finger = Finger::new(sensor)?;
        let seen = finger
            .see(&picture)
            .map_err(|error| named(&path, FIRST_FRAME, error))?;
        firsts.push(First {
            places: finger
                .tracker()
                .markers()
                .iter()
                .map(|marker| marker.at_px)
                .collect(),
            filled: seen.filled,
        });
    }
    Ok(firsts)
}

fn short(path: &Path, frames: usize) -> EvaluationError {
    EvaluationError::File {
        file: path.display().to_string(),
        found: format!("ends before frame {frames}"),
        expected: "the whole clip: copy it again",
    }
}

fn named(path: &Path, frame: usize, error: MarkerError) -> EvaluationError {
    EvaluationError::Frame {
        path: path.to_owned(),
        frame,
        error,
    }
}

/// How far apart two gels' markers are, pixels: the median distance to the other's nearest, both ways.
fn apart(a: &First, b: &First) -> f32 {
    let nearest = |[x, y]: &[f32; 2], others: &First| {
        let far = others
            .places
            .iter()
            .map(|[u, v]| (x - u).powi(2) + (y - v).powi(2));
        far.fold(f32::INFINITY, f32::min).sqrt()
    };
    let mut far: Vec<f32> = a
        .places
        .iter()
        .map(|place| nearest(place, b))
        .chain(b.places.iter().map(|place| nearest(place, a)))
        .collect();
    median(&mut far)
}

pub(super) fn median(values: &mut [f32]) -> f32 {
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or_default()
}

/// The rest of a long clip, one for each camera: other objects' first pictures, those of the most similar gels.
fn foreign_rest(entry: &Entry, entries: &[Entry], firsts: &BTreeMap<String, Vec<First>>) -> Vec<Rest> {
    let own = &firsts[&entry.name];
    let mut others: Vec<(f32, &Entry)> = entries
        .iter()
        .filter(|other| other.session == Session::Long && other.object != entry.object)
        .map(|other| {
            let cameras = own.iter().zip(&firsts[&other.name]);
            (cameras.map(|(own, other)| apart(own, other)).sum(), other)
        })
        .collect();
    others.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut taken: BTreeMap<&str, usize> = BTreeMap::new();
    let chosen: Vec<&Entry> = others
        .into_iter()
        .map(|(_, other)| other)
        .filter(|other| {
            let count = taken.entry(&other.object).or_default();
            *count += 1;
            *count <= REST_PICTURES_OF_ONE_OBJECT
        })
        .take(REST_PICTURES)
        .collect();
    let of_camera = |camera: usize| {
        let pictures: Vec<Filled> = chosen
            .iter()
            .map(|other| firsts[&other.name][camera].filled.clone())
            .collect();
        Rest::of(&pictures, RestKind::Other)
    };
    (0..CAMERAS.len()).map(of_camera).collect()
}

/// What one finger gives in each frame.
#[derive(Debug, Clone, Copy)]
struct FingerFrame {
    with_rest: Comparison,
    without_rest: Comparison,
    step_px: f32,
}

fn trial(
    folder: &Path,
    entry: &Entry,
    entries: &[Entry],
    firsts: &BTreeMap<String, Vec<First>>,
    sensor: &Sensor,
) -> Result<Trial, EvaluationError> {
    let rests = match entry.session {
        Session::Long => foreign_rest(entry, entries, firsts),
        Session::Short => Vec::new(),
    };
    let mut fingers = Vec::new();
    let mut gels = Vec::new();
    for (index, camera) in CAMERAS.into_iter().enumerate() {
        let (frames, gel) = finger(folder, entry, camera, rests.get(index), sensor)?;
        fingers.push(frames);
        gels.push(gel);
    }
    let armed = ARMED[usize::from(entry.session == Session::Short)];
    let (mut hold, mut bare) = (Hold::default(), Hold::default());
    let mut frames = Vec::new();
    for frame in armed..END_FRAME {
        let now: Vec<FingerFrame> = fingers
            .iter()
            .filter_map(|finger| finger.get(&frame).copied())
            .collect();
        if now.len() < CAMERAS.len() {
            break;
        }
        let with: Vec<Comparison> = now.iter().map(|finger| finger.with_rest).collect();
        let without: Vec<Comparison> = now.iter().map(|finger| finger.without_rest).collect();
        if let (Some(evidence), Some(bare)) = (hold.step(&with), bare.step(&without)) {
            frames.push(Scores {
                slip: evidence.slip,
                slip_without_rest: bare.slip,
                energy: evidence.energy,
                step_px: now.iter().map(|finger| finger.step_px).sum::<f32>() / now.len() as f32,
            });
        }
    }
    Ok(Trial {
        name: entry.name.clone(),
        object: entry.object.clone(),
        slip: entry.slip,
        session: entry.session,
        frames,
        gels,
    })
}

/// A finger's frames from the first one with a comparison on, and its gel.
fn finger(
    folder: &Path,
    entry: &Entry,
    camera: &str,
    rest: Option<&Rest>,
    sensor: &Sensor,
) -> Result<(BTreeMap<usize, FingerFrame>, Gel), EvaluationError> {
    let (path, mut clip) = clip(folder, entry, camera, sensor)?;
    let mut finger = Finger::new(sensor)?;
    let mut bare = Finger::new(sensor)?;
    bare.set_rest(Rest::GRID);
    if let Some(rest) = rest {
        finger.set_rest(rest.clone());
    }
    let mut at_rest = Vec::new();
    let mut still: Vec<Vec<[f32; 2]>> = Vec::new();
    let mut last: VecDeque<Vec<Option<[f32; 2]>>> = VecDeque::new();
    let mut before: Vec<[f32; 2]> = Vec::new();
    let mut energies: Vec<f32> = Vec::new();
    let mut frames = BTreeMap::new();
    let mut frame = 0;
    loop {
        let Some(picture) = clip.next_picture() else {
            clip.finish()?;
            break;
        };
        let now = frame;
        frame += 1;
        let first = match entry.session {
            Session::Long => FIRST_FRAME,
            // The fingers touch each other before.
            Session::Short => REST_FRAMES.start,
        };
        if now < first {
            continue;
        }
        if entry.session == Session::Long && now >= END_FRAME {
            break;
        }
        let seen = finger.see(&picture).map_err(|error| named(&path, now, error))?;
        let markers = finger.tracker().markers();
        let places: Vec<[f32; 2]> = markers.iter().map(|marker| marker.at_px).collect();
        if entry.session == Session::Short {
            if REST_FRAMES.contains(&now) {
                at_rest.push(seen.filled.clone());
                still.push(places.clone());
            }
            if now + 1 == REST_FRAMES.end {
                // Some hands close before that.
                let untouched = finger.untouched(&at_rest);
                let mut keep = untouched.iter();
                at_rest.retain(|_| keep.next() == Some(&true));
                let mut keep = untouched.iter();
                still.retain(|_| keep.next() == Some(&true));
                finger.set_rest(Rest::of(&at_rest, RestKind::Own));
            }
            if last.len() == RETURN_FRAMES {
                last.pop_front();
            }
            last.push_back(markers_seen(finger.tracker().markers()));
        }
        let without = bare.see(&picture).map_err(|error| named(&path, now, error))?;
        energies.extend(seen.comparison.map(|comparison| comparison.energy));
        if let (Some(with_rest), Some(without_rest)) = (seen.comparison, without.comparison) {
            let steps = places.iter().zip(&before);
            let far: f32 = steps
                .map(|(now, before)| ((now[0] - before[0]).powi(2) + (now[1] - before[1]).powi(2)).sqrt())
                .sum();
            frames.insert(
                now,
                FingerFrame {
                    with_rest,
                    without_rest,
                    step_px: far / places.len().max(1) as f32,
                },
            );
        }
        before = places;
    }
    let held = energies.iter().copied().fold(0.0, f32::max) > HELD_ENERGY;
    let end = energies.iter().rev().take(RETURN_FRAMES);
    let is_released =
        held && entry.session == Session::Short && end.copied().fold(0.0, f32::max) < GONE_ENERGY;
    let gel = Gel {
        markers: before.len(),
        still_px: deviation(&still),
        return_px: is_released.then(|| returned(&still, &last)).flatten(),
    };
    Ok((frames, gel))
}

fn markers_seen(markers: &[gripline_markers::Marker]) -> Vec<Option<[f32; 2]>> {
    markers
        .iter()
        .map(|marker| marker.seen.then_some(marker.at_px))
        .collect()
}

/// Median over markers and axes of the deviation of still ones.
fn deviation(still: &[Vec<[f32; 2]>]) -> Option<f32> {
    let count = still.len() as f32;
    let mut deviations = Vec::new();
    for marker in 0..still.first()?.len() {
        for axis in 0..2 {
            let mean = still.iter().map(|places| places[marker][axis]).sum::<f32>() / count;
            let squares = still.iter().map(|places| (places[marker][axis] - mean).powi(2));
            deviations.push((squares.sum::<f32>() / (count - 1.0).max(1.0)).sqrt());
        }
    }
    Some(median(&mut deviations))
}

/// Median over markers of the distance between their mean places at rest and at the end.
fn returned(still: &[Vec<[f32; 2]>], last: &VecDeque<Vec<Option<[f32; 2]>>>) -> Option<f32> {
    let mean = |places: &[[f32; 2]]| {
        let count = places.len() as f32;
        [0, 1].map(|axis| places.iter().map(|place| place[axis]).sum::<f32>() / count)
    };
    let mut distances = Vec::new();
    for marker in 0..still.first()?.len() {
        let rest: Vec<_> = still.iter().map(|places| places[marker]).collect();
        let end: Vec<_> = last.iter().filter_map(|places| places[marker]).collect();
        if end.len() == last.len() {
            let ([x, y], [u, v]) = (mean(&rest), mean(&end));
            distances.push(((x - u).powi(2) + (y - v).powi(2)).sqrt());
        }
    }
    (!distances.is_empty()).then(|| median(&mut distances))
}
