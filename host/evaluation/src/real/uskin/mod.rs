//! Three recorded trials of another sensor (uSkin 4×4 on both fingers of a gripper
//! that picks a box up) as they are. Raw counts, not newtons: gains per axis and taxel are unknown, so friction here is a
//! number that fits counts. It is chosen on two trials and judged on the third, three times. Touches files.

pub(super) mod evidence;

use std::fs;
use std::io::BufReader;
use std::path::Path;

use gripline_firmware::Friction;
use gripline_firmware::slip::{SlipDetector, severity};
use gripline_firmware::sums::{TaxelRule, stick_ratio, sums_of};
use gripline_firmware::{DeviceMicros, HostMicros};
use gripline_protocol::message::{Configuration, MapSums};
use gripline_protocol::{ForceMap, PER_UNIT, TAXELS};
use serde::Serialize;

use crate::detect::judge::quantise;
use crate::document::{number, table};
use crate::error::EvaluationError;
use crate::metrics::roc_area;
use gripline_recording::maps_file::MapsFile;
use gripline_recording::units::{force_n, shear_n};

/// The folder's name.
pub(in crate::real) const FOLDER: &str = "uskin-slip";
const TRIALS: [usize; 3] = [1, 2, 3];
const FINGERS: [usize; 2] = [1, 2];
/// Newtons that a count is taken for, so that the largest fits the wire; friction does not depend on it.
const SCALE: f64 = 1e-3;
/// A taxel is in contact above this many counts: the zero drifts by about as much.
const CONTACT_COUNTS: f64 = 30.0;
/// Frames a second of the recordings.
const FRAMES_PER_SECOND: f64 = 60.0;
/// Friction values that are tried, 1/10000.
const FRICTIONS: std::ops::RangeInclusive<u16> = 1..=40;
const FRICTION_STEP: u16 = 500;

/// A finger's frames in one trial, up to where the box was lost, and whether it slipped.
#[derive(Debug, Clone)]
struct Trial {
    maps: Vec<ForceMap>,
    slips: Vec<bool>,
}

/// Area under the ROC curve, of the trial that friction was not chosen on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct Left {
    trial: usize,
    frames: usize,
    slip_frames: usize,
    /// Chosen on the other two trials, for the stick ratio.
    friction: f64,
    coulomb: Option<f64>,
    stick_ratio: Option<f64>,
    gripline: Option<f64>,
}

/// A finger's figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(in crate::real) struct Finger {
    #[serde(rename = "finger")]
    number: usize,
    trials: Vec<Left>,
    /// All trials together, with the friction that fits them best: nothing was left out.
    best_friction: f64,
    coulomb_all: Option<f64>,
    stick_ratio_all: Option<f64>,
}

/// The figures of both fingers.
///
/// # Errors
/// [`EvaluationError`] when a recording is damaged.
pub(in crate::real) fn evaluate(folder: &Path) -> Result<Vec<Finger>, EvaluationError> {
    let mut fingers = Vec::new();
    for finger in FINGERS {
        let mut trials = Vec::new();
        for trial in TRIALS {
            trials.push(read(folder, trial, finger)?);
        }
        fingers.push(judge(finger, &trials));
    }
    Ok(fingers)
}

fn read(folder: &Path, trial: usize, finger: usize) -> Result<Trial, EvaluationError> {
    let path = folder.join(format!("trial{trial}_labels.npy"));
    let labels = labels(&path)?;
    let lost = labels.iter().position(|label| label[1] > 0);
    let mut file = MapsFile::open(&folder.join(format!("trial{trial}_finger{finger}.npy")))?;
    if file.frames() != labels.len() as u64 {
        return Err(EvaluationError::Labels {
            path,
            found: labels.len(),
            expected: file.frames(),
        });
    }
    let frames = lost.unwrap_or(labels.len());
    let mut forces = Box::new([[0.0; 3]; TAXELS]);
    let mut maps = Vec::with_capacity(frames);
    while maps.len() < frames && file.read_frame(&mut forces)? {
        maps.push(quantise(&forces, SCALE).map);
    }
    Ok(Trial {
        maps,
        slips: labels[..frames].iter().map(|label| label[0] > 0).collect(),
    })
}

fn labels(path: &Path) -> Result<Vec<[u8; 2]>, EvaluationError> {
    let damaged = |found: String| EvaluationError::File {
        file: path.display().to_string(),
        found: format!("found {found}"),
        expected: "an array of unsigned bytes of shape (frames, 2): copy it again",
    };
    let file = fs::File::open(path).map_err(|error| damaged(error.to_string()))?;
    let array = npyz::NpyFile::new(BufReader::new(file)).map_err(|error| damaged(error.to_string()))?;
    let shape = array.shape().to_vec();
    if shape.len() != 2 || shape[1] != 2 {
        return Err(damaged(format!("shape {shape:?}")));
    }
    let bytes = array
        .into_vec::<u8>()
        .map_err(|error| damaged(error.to_string()))?;
    Ok(bytes.as_chunks::<2>().0.to_vec())
}

fn rule(friction: u16) -> TaxelRule {
    TaxelRule {
        friction: Friction::clamped(friction),
        contact_min: (CONTACT_COUNTS * SCALE * f64::from(gripline_protocol::LSB_PER_NEWTON)) as i16,
    }
}

/// F_T / F_N of every frame, over the taxels that are pressed.
fn coulomb(trial: &Trial) -> Vec<f64> {
    let pressed = |map: &ForceMap| {
        let mut map = map.clone();
        let rule = rule(0);
        for taxel in &mut map.taxels {
            if taxel.z <= rule.contact_min {
                *taxel = gripline_protocol::TaxelForce::default();
            }
        }
        sums_of(&map, rule)
    };
    trial.maps.iter().map(|map| coulomb_of(&pressed(map))).collect()
}

/// F_T / F_N; 0 without normal force.
fn coulomb_of(sums: &MapSums) -> f64 {
    let [_, _, normal] = force_n(sums);
    if normal > 0.0 { shear_n(sums) / normal } else { 0.0 }
}

/// One less the stick ratio of every frame; 0 without contact.
fn slipping(trial: &Trial, friction: u16) -> Vec<f64> {
    let ratios = trial
        .maps
        .iter()
        .map(|map| stick_ratio(&sums_of(map, rule(friction))));
    ratios
        .map(|ratio| ratio.map_or(0.0, |ratio| 1.0 - f64::from(ratio) / f64::from(PER_UNIT)))
        .collect()
}

/// Our state machine: the state, and within a state one less the stick ratio.
fn states(trial: &Trial, friction: u16) -> Vec<f64> {
    let settings = Configuration {
        friction,
        contact_min: rule(friction).contact_min,
        ..Configuration::DEFAULT
    };
    let mut detector = SlipDetector::new();
    let frames = trial.maps.iter().zip(slipping(trial, friction)).enumerate();
    frames
        .map(|(frame, (map, slipping))| {
            let now_us = (frame as f64 * 1e6 / FRAMES_PER_SECOND) as u64;
            let sums = sums_of(map, rule(friction));
            let judgement =
                detector.update(&sums, HostMicros(now_us as u32), DeviceMicros(now_us), &settings);
            detector.observe(&sums);
            f64::from(severity(judgement.state)) + slipping
        })
        .collect()
}

fn area(trials: &[&Trial], score: impl Fn(&Trial) -> Vec<f64>) -> Option<f64> {
    let frames: Vec<(f64, bool)> = trials
        .iter()
        .flat_map(|trial| score(trial).into_iter().zip(trial.slips.iter().copied()))
        .collect();
    roc_area(&frames)
}

/// The friction whose stick ratio tells slip best on these trials; of equal ones the middle.
fn best_friction(trials: &[&Trial]) -> u16 {
    let areas: Vec<(u16, f64)> = FRICTIONS
        .map(|step| step * FRICTION_STEP)
        .filter_map(|friction| Some((friction, area(trials, |trial| slipping(trial, friction))?)))
        .collect();
    let max = areas.iter().map(|(_, area)| *area).fold(0.0, f64::max);
    let best: Vec<u16> = areas
        .iter()
        .filter(|(_, area)| *area >= max - 1e-9)
        .map(|(friction, _)| *friction)
        .collect();
    best.get(best.len() / 2).copied().unwrap_or_default()
}

fn judge(number: usize, trials: &[Trial]) -> Finger {
    let all: Vec<&Trial> = trials.iter().collect();
    let left = TRIALS.iter().zip(trials).map(|(&left_out, trial)| {
        let others: Vec<&Trial> = all
            .iter()
            .zip(TRIALS)
            .filter(|(_, other)| *other != left_out)
            .map(|(trial, _)| *trial)
            .collect();
        let friction = best_friction(&others);
        Left {
            trial: left_out,
            frames: trial.maps.len(),
            slip_frames: trial.slips.iter().filter(|slips| **slips).count(),
            friction: f64::from(friction) / f64::from(PER_UNIT),
            coulomb: area(&[trial], coulomb),
            stick_ratio: area(&[trial], |trial| slipping(trial, friction)),
            gripline: area(&[trial], |trial| states(trial, friction)),
        }
    });
    let best = best_friction(&all);
    Finger {
        number,
        trials: left.collect(),
        best_friction: f64::from(best) / f64::from(PER_UNIT),
        coulomb_all: area(&all, coulomb),
        stick_ratio_all: area(&all, |trial| slipping(trial, best)),
    }
}

/// The figures as a table in words.
pub(in crate::real) fn markdown(fingers: &[Finger]) -> String {
    let mut rows = Vec::new();
    for finger in fingers {
        for left in &finger.trials {
            rows.push(vec![
                finger.number.to_string(),
                left.trial.to_string(),
                format!("{} of {}", left.slip_frames, left.frames),
                format!("{:.2}", left.friction),
                number(left.coulomb, 3),
                number(left.stick_ratio, 3),
                number(left.gripline, 3),
            ]);
        }
        rows.push(vec![
            finger.number.to_string(),
            "all, nothing left out".to_owned(),
            String::new(),
            format!("{:.2}", finger.best_friction),
            number(finger.coulomb_all, 3),
            number(finger.stick_ratio_all, 3),
            String::new(),
        ]);
    }
    let columns = [
        "finger",
        "trial",
        "slipping frames",
        "friction (in counts)",
        "Coulomb",
        "stick ratio",
        "Gripline",
    ];
    format!(
        "### uSkin, three trials of one box\n\nThree pick-and-move trials of a \
         two-finger gripper with a uSkin 4×4 on each finger (imanlab/proactive-slip-control, MIT), as they are. Area \
         under the ROC curve, frame by frame until the box is lost; 0.5 is guessing. The friction of stick ratio and \
         Gripline was chosen on the other two trials of the same finger; Coulomb's score F_T / F_N needs none.\n\n{}\n\
         What this is not: evidence of a rate. Three trials of one box are three trials; the counts are not newtons, \
         their gains are unknown, the zero drifts by tens of counts, sixteen taxels of 4 mm make a coarse stick ratio, \
         and the frames of a trial are not independent. It shows that the way from file to decision works on real \
         signals, and how far results swing from trial to trial.\n",
        table(&columns, &rows)
    )
}

#[cfg(test)]
mod tests {
    use gripline_protocol::TaxelForce;

    use super::*;

    /// Frames of one taxel each with shear over normal of these shares.
    fn trial(shares: &[f64], slips: &[bool]) -> Trial {
        let map = |share: &f64| {
            let mut map = ForceMap::EMPTY;
            map.taxels[0] = TaxelForce {
                x: (4_000.0 * share) as i16,
                y: 0,
                z: 4_000,
            };
            map
        };
        Trial {
            maps: shares.iter().map(map).collect(),
            slips: slips.to_vec(),
        }
    }

    #[test]
    fn a_friction_between_what_sticks_and_what_slips_is_found_and_tells_them_apart() {
        let both = trial(&[0.2, 0.3, 0.6, 0.7], &[false, false, true, true]);
        let friction = best_friction(&[&both]);
        assert!((3_000..6_000).contains(&friction), "{friction}");
        let finger = judge(1, &[both.clone(), both.clone(), both]);
        for left in &finger.trials {
            assert_eq!([left.coulomb, left.stick_ratio, left.gripline], [Some(1.0); 3]);
        }
    }

    #[test]
    fn friction_is_chosen_without_the_trial_it_is_judged_on() {
        let ordinary = trial(&[0.2, 0.6], &[false, true]);
        // Slips at so little shear that the others' friction calls it sticking.
        let odd = trial(&[0.05, 0.15], &[false, true]);
        let finger = judge(1, &[ordinary.clone(), ordinary, odd]);
        assert_eq!(finger.trials[2].stick_ratio, Some(0.5));
        assert_eq!(finger.trials[2].coulomb, Some(1.0));
    }

    #[test]
    fn labels_of_another_shape_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trial1_labels.npy");
        fs::write(&path, b"nothing").unwrap();
        let error = labels(&path).unwrap_err().to_string();
        assert!(
            error.contains("trial1_labels.npy") && error.contains("(frames, 2)"),
            "{error}"
        );
    }
}
