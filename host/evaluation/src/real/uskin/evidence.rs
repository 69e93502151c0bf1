//! The whole detector's evidence of slip on the recordings, beside scores that need one frame or three: on the trials that slip by the
//! label and by the object's pose, on those that never slip by its alarms. Settings as shipped; nothing is chosen here.
//!
//! Units: counts, mm, alarms a minute. Limits: the zero of the trials without slip is not known. They are read as if their grip began as
//! that of the other day.

use std::fs;
use std::io::BufReader;
use std::path::Path;

use gripline_firmware::Friction;
use gripline_protocol::message::Configuration;
use gripline_protocol::{ForceMap, PER_UNIT, TAXELS};
use gripline_recording::maps_file::{FrameForces, MapsFile};
use serde::Serialize;

use super::{FINGERS, FRAMES_PER_SECOND, SCALE, TRIALS, coulomb_of, labels};
use crate::detect::judge::{Settings, judge, quantise, sums};
use crate::detect::replay::Replay;
use crate::document::{number, table};
use crate::error::EvaluationError;
use crate::metrics::roc_area;
use gripline_firmware::sums::TaxelRule;
use gripline_recording::units::{ratio, stick_ratio};

/// The folder with the trials that never slip and with all poses.
pub(in crate::real) const FOLDER: &str = "uskin-noslip";
const QUIET_TRIALS: [usize; 4] = [4, 5, 6, 7];
/// The object moves when it has gone this far in this many frames.
const MOVES_MM: f64 = 0.5;
const MOVES_FRAMES: usize = 6;
/// The map is compared with that of this many frames ago.
const CHANGE_FRAMES: usize = 3;
/// The first frames of a trial, whose mean is its grip.
const GRIP_FRAMES: usize = 15;
/// Evidence that is an alarm, and how long there must have been none for it to be a new one.
const ALARM: f64 = 0.5;
const ALARM_APART_S: f64 = 1.0;

/// Names of the scores, in their order.
const SCORES: [&str; 4] = [
    "slip_evidence",
    "change of map / F_N",
    "F_T / F_N",
    "1 − stick ratio",
];

/// Areas under the ROC curve of [`SCORES`] over the three trials with slip.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(in crate::real) struct Evidence {
    finger: usize,
    /// Against the label.
    label: [Option<f64>; SCORES.len()],
    /// Against the object's motion.
    moves: Option<[Option<f64>; SCORES.len()]>,
    /// Of the trials without slip.
    quiet: Vec<Quiet>,
}

/// A trial that never slips by its label.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Quiet {
    trial: usize,
    seconds: f64,
    alarms: usize,
    /// Of these, the ones at which the object moves by its pose.
    alarms_moving: usize,
    /// How far the object went from where it was at first, at most.
    moved_mm: Option<f64>,
}

/// What the scores say of a trial's frames.
struct Scored {
    scores: Vec<[f64; SCORES.len()]>,
    slips: Vec<bool>,
    moves: Option<Vec<bool>>,
}

/// The figures of both fingers. `quiet` is the folder of poses and of trials without slip, where it is there.
///
/// # Errors
/// [`EvaluationError`] when a recording is damaged.
pub(in crate::real) fn evaluate(
    slips: &Path,
    quiet: Option<&Path>,
) -> Result<Vec<Evidence>, EvaluationError> {
    FINGERS
        .iter()
        .map(|&finger| of_finger(finger, slips, quiet))
        .collect()
}

fn of_finger(finger: usize, slips: &Path, quiet: Option<&Path>) -> Result<Evidence, EvaluationError> {
    let mut trials = Vec::new();
    let mut grip = vec![[0.0; 3]; TAXELS];
    for trial in TRIALS {
        let frames = frames(&slips.join(format!("trial{trial}_finger{finger}.npy")))?;
        add_mean(&mut grip, &frames, 1.0 / TRIALS.len() as f64);
        let labels = labels(&slips.join(format!("trial{trial}_labels.npy")))?;
        let held = labels
            .iter()
            .position(|label| label[1] > 0)
            .unwrap_or(labels.len())
            .min(frames.len());
        let mut scores = scores(&frames)?;
        scores.truncate(held);
        let positions = quiet.map(|folder| positions_mm(folder, trial)).transpose()?;
        trials.push(Scored {
            scores,
            slips: labels[..held].iter().map(|label| label[0] > 0).collect(),
            moves: positions.map(|positions| moves(&positions, held)),
        });
    }
    let mut found = Evidence {
        finger,
        label: areas(&trials, |trial| Some(&trial.slips)).unwrap_or_default(),
        moves: areas(&trials, |trial| trial.moves.as_ref()),
        quiet: Vec::new(),
    };
    for trial in quiet.into_iter().flat_map(|_| QUIET_TRIALS) {
        let folder = quiet.unwrap_or(slips);
        let mut frames = frames(&folder.join(format!("trial{trial}_finger{finger}_raw.npy")))?;
        let mut first = vec![[0.0; 3]; TAXELS];
        add_mean(&mut first, &frames, 1.0);
        for frame in &mut frames {
            for ((force, first), grip) in frame.iter_mut().zip(&first).zip(&grip) {
                *force = [0, 1, 2].map(|axis| force[axis] - first[axis] + grip[axis]);
            }
        }
        let evidence: Vec<f64> = scores(&frames)?.iter().map(|scores| scores[0]).collect();
        let positions = positions_mm(folder, trial)?;
        let from = positions.first().copied();
        let moved_mm = positions
            .iter()
            .filter_map(|to| Some(distance(from?, *to)))
            .reduce(f64::max);
        let alarms = alarms(&evidence);
        let moves = moves(&positions, evidence.len());
        found.quiet.push(Quiet {
            trial,
            seconds: frames.len() as f64 / FRAMES_PER_SECOND,
            alarms: alarms.len(),
            alarms_moving: alarms.iter().filter(|&&frame| moves[frame]).count(),
            moved_mm,
        });
    }
    Ok(found)
}

/// All frames of a recording, counts.
fn frames(path: &Path) -> Result<Vec<Box<FrameForces>>, EvaluationError> {
    let mut file = MapsFile::open(path)?;
    let mut frames = Vec::new();
    let mut frame = Box::new([[0.0; 3]; TAXELS]);
    while file.read_frame(&mut frame)? {
        frames.push(frame.clone());
    }
    Ok(frames)
}

/// Adds a share of the mean of the first frames.
fn add_mean(sum: &mut [[f64; 3]], frames: &[Box<FrameForces>], share: f64) {
    let count = frames.len().clamp(1, GRIP_FRAMES) as f64;
    for frame in frames.iter().take(GRIP_FRAMES) {
        for (sum, force) in sum.iter_mut().zip(frame.iter()) {
            for (sum, force) in sum.iter_mut().zip(force) {
                *sum += share * force / count;
            }
        }
    }
}

/// [`SCORES`] of every frame.
fn scores(frames: &[Box<FrameForces>]) -> Result<Vec<[f64; SCORES.len()]>, EvaluationError> {
    let shipped = Configuration::DEFAULT;
    let settings = Settings {
        friction: Friction::clamped(shipped.friction),
        threshold: shipped.slip_threshold,
        contact_min: shipped.contact_min,
        scale: SCALE,
    };
    let rule = TaxelRule::of(&shipped);
    let mut replay = Replay::new(&settings, FRAMES_PER_SECOND)?;
    let maps: Vec<ForceMap> = frames.iter().map(|frame| quantise(frame, SCALE).map).collect();
    let mut all = Vec::with_capacity(maps.len());
    for (number, map) in maps.iter().enumerate() {
        let verdict = judge(map, &settings);
        let answer = replay.show(number as u64, map, false, &verdict)?;
        let before = &maps[number.saturating_sub(CHANGE_FRAMES)];
        let found = sums(map, rule);
        all.push([
            ratio(answer.slip_evidence),
            change(map, before) / f64::from(found.force[2].max(1)),
            coulomb_of(&found),
            stick_ratio(&found).map_or(0.0, |ratio| 1.0 - ratio),
        ]);
    }
    Ok(all)
}

/// Σ|Δ| over all taxels and axes, 1/4096 N.
fn change(map: &ForceMap, before: &ForceMap) -> f64 {
    let of = |now: i16, then: i16| f64::from((i32::from(now) - i32::from(then)).abs());
    let pairs = map.taxels.iter().zip(&before.taxels);
    pairs
        .map(|(now, then)| of(now.x, then.x) + of(now.y, then.y) + of(now.z, then.z))
        .sum()
}

/// The object's positions in the gripper's camera while its marker was seen; what was not seen stays where it was.
fn positions_mm(folder: &Path, trial: usize) -> Result<Vec<[f64; 3]>, EvaluationError> {
    let path = folder.join(format!("trial{trial}_marker.npy"));
    let damaged = |found: String| EvaluationError::File {
        file: path.display().to_string(),
        found: format!("found {found}"),
        expected: "an array of numbers of shape (frames, 7): copy it again",
    };
    let file = fs::File::open(&path).map_err(|error| damaged(error.to_string()))?;
    let array = npyz::NpyFile::new(BufReader::new(file)).map_err(|error| damaged(error.to_string()))?;
    let shape = array.shape().to_vec();
    if shape.len() != 2 || shape[1] != 7 {
        return Err(damaged(format!("shape {shape:?}")));
    }
    let values = array
        .into_vec::<f64>()
        .map_err(|error| damaged(error.to_string()))?;
    let mut last = None;
    let poses = values.as_chunks::<7>().0.iter().filter_map(|&[x, y, z, ..]| {
        // A marker that was not seen is 10 m away.
        if [x, y, z].iter().all(|side| side.abs() < 5.0) {
            last = Some([x, y, z].map(|side| 1e3 * side));
        }
        last
    });
    Ok(poses.collect())
}

fn distance(from: [f64; 3], to: [f64; 3]) -> f64 {
    [0, 1, 2]
        .map(|axis| (to[axis] - from[axis]).powi(2))
        .iter()
        .sum::<f64>()
        .sqrt()
}

/// Whether the object has just moved, for every frame up to `held`.
fn moves(positions_mm: &[[f64; 3]], held: usize) -> Vec<bool> {
    let at = |frame: usize| {
        positions_mm
            .get(frame)
            .or(positions_mm.last())
            .copied()
            .unwrap_or_default()
    };
    (0..held)
        .map(|frame| distance(at(frame.saturating_sub(MOVES_FRAMES)), at(frame)) > MOVES_MM)
        .collect()
}

/// The first frames of new alarms in a course of evidence.
fn alarms(evidence: &[f64]) -> Vec<usize> {
    let apart = (ALARM_APART_S * FRAMES_PER_SECOND) as usize;
    let mut quiet = apart;
    let mut found = Vec::new();
    for (frame, value) in evidence.iter().enumerate() {
        if *value > ALARM {
            if quiet >= apart {
                found.push(frame);
            }
            quiet = 0;
        } else {
            quiet += 1;
        }
    }
    found
}

/// The trials without slip of both fingers together.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(in crate::real) struct QuietTotals {
    seconds: f64,
    alarms: usize,
    /// Of these, the ones at which the object moves by its pose.
    alarms_moving: usize,
    alarms_per_minute: f64,
    /// Of alarms at which the object rests by its pose.
    alarms_at_rest_per_minute: f64,
}

impl QuietTotals {
    /// `None` without such trials.
    pub(in crate::real) fn of(found: &[Evidence]) -> Option<Self> {
        let trials = || found.iter().flat_map(|finger| &finger.quiet);
        let seconds: f64 = trials().map(|trial| trial.seconds).sum();
        let alarms: usize = trials().map(|trial| trial.alarms).sum();
        let alarms_moving: usize = trials().map(|trial| trial.alarms_moving).sum();
        let per_minute = |alarms: usize| 60.0 * alarms as f64 / seconds;
        (seconds > 0.0).then(|| Self {
            seconds,
            alarms,
            alarms_moving,
            alarms_per_minute: per_minute(alarms),
            alarms_at_rest_per_minute: per_minute(alarms - alarms_moving),
        })
    }
}

/// The area of every score over all trials; `None` when a trial has no truth.
fn areas(
    trials: &[Scored],
    truth: impl Fn(&Scored) -> Option<&Vec<bool>>,
) -> Option<[Option<f64>; SCORES.len()]> {
    let truths: Vec<&Vec<bool>> = trials.iter().map(truth).collect::<Option<_>>()?;
    Some(std::array::from_fn(|score| {
        let frames: Vec<(f64, bool)> = trials
            .iter()
            .zip(&truths)
            .flat_map(|(trial, truth)| {
                trial
                    .scores
                    .iter()
                    .map(move |scores| scores[score])
                    .zip(truth.iter().copied())
            })
            .collect();
        roc_area(&frames)
    }))
}

/// The figures as tables in words.
pub(in crate::real) fn markdown(found: &[Evidence]) -> String {
    let mut rows = Vec::new();
    let mut quiet = Vec::new();
    for finger in found {
        let row = |truth: &str, areas: &[Option<f64>]| {
            let cells = areas.iter().map(|area| number(*area, 3));
            [finger.finger.to_string(), truth.to_owned()]
                .into_iter()
                .chain(cells)
                .collect()
        };
        rows.push(row("label", &finger.label));
        if let Some(moves) = &finger.moves {
            rows.push(row("object moves", moves));
        }
        quiet.extend(finger.quiet.iter().map(|trial| {
            vec![
                finger.finger.to_string(),
                trial.trial.to_string(),
                format!("{:.1}", trial.seconds),
                number(trial.moved_mm, 1),
                trial.alarms.to_string(),
                trial.alarms_moving.to_string(),
            ]
        }));
    }
    let columns: Vec<&str> = ["finger", "truth"].into_iter().chain(SCORES).collect();
    let totals = QuietTotals::of(found).map_or_else(String::new, |totals| {
        format!(
            "{} in {:.0} s of both fingers together, {} of them as the object moves by its pose",
            totals.alarms, totals.seconds, totals.alarms_moving
        )
    });
    format!(
        "### uSkin, the whole detector\n\nArea under the ROC curve over the three trials with slip, as `gripline detect --scale 1e-3 \
         --state` gives it: shipped settings, friction {:.2}. The weights of the witnesses and three time constants of one of them were \
         chosen on these trials, so the first column is no proof for other sensors. By the object's pose it moves when it has gone {MOVES_MM} \
         mm in {MOVES_FRAMES} frames; the label comes 100 to 200 ms later.\n\n{}\nTrials that never slip by their label, read as if the grip \
         began as on the other day, because their zero is not known. An alarm is evidence above {ALARM}, {ALARM_APART_S} s after the one \
         before: {totals}.\n\n{}",
        f64::from(Configuration::DEFAULT.friction) / f64::from(PER_UNIT),
        table(&columns, &rows),
        table(
            &[
                "finger",
                "trial",
                "seconds",
                "object moved, mm",
                "alarms",
                "of these, as it moves",
            ],
            &quiet
        )
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alarms_that_flicker_count_once() {
        let mut evidence = vec![0.0; 10];
        evidence.extend([0.9, 0.1, 0.9, 0.1, 0.9]);
        evidence.extend(vec![0.1; 60]);
        evidence.push(0.6);
        assert_eq!(alarms(&evidence), [10, 75]);
        assert!(alarms(&[0.5; 100]).is_empty());
    }

    #[test]
    fn an_object_that_goes_a_millimetre_moves_then_and_rests_after() {
        let mut positions = vec![[0.0; 3]; 20];
        positions.extend(vec![[0.0, 1.0, 0.0]; 20]);
        let moves = moves(&positions, 40);
        let moving: Vec<usize> = (0..40).filter(|&frame| moves[frame]).collect();
        assert_eq!(moving, (20..26).collect::<Vec<_>>());
    }

    #[test]
    fn the_change_of_a_map_counts_every_taxel_and_axis() {
        let mut map = ForceMap::EMPTY;
        map.taxels[3].x = -7;
        map.taxels[9].z = 5;
        assert!((change(&map, &ForceMap::EMPTY) - 12.0).abs() < 1e-12);
    }
}
