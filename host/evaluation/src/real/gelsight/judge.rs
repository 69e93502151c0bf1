//! Figures over trials: areas under the ROC curve, thresholds that are chosen without the object they are judged on, early
//! warning. Pure arithmetic on scores where more means slip.

use serde::Serialize;

use super::clips::{Scores, Session, Trial, median};
use crate::metrics::roc_area;

/// Frames a second of the recordings (37 s in 250 to 325 frames).
const FRAMES_PER_SECOND: f64 = 7.0;
/// Alarms a minute of hold that are allowed.
const ALARMS_PER_MINUTE: f64 = 0.3;
/// Frames below the threshold that end an alarm: a second.
const QUIET_FRAMES: usize = 7;
/// Early warning looks at frames up to this many before the imprint is gone.
const WARNING_FRAMES: usize = 8;
/// An imprint is gone when less than this share of its energy is left ...
const GONE: f32 = 0.3;
/// ... of a trial that began with at least this energy, squared grey levels per pixel of both fingers.
const HELD_ENERGY: f32 = 16.0;

/// What is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(in crate::real) enum Witness {
    /// The imprint in the gel's frame.
    Imprint,
    /// The same without a rest picture.
    ImprintWithoutRest,
    /// The smallest energy of the imprint.
    Energy,
    /// The largest step of the markers.
    MarkerStep,
}

impl Witness {
    pub(super) const ALL: [Self; 4] = [
        Self::Imprint,
        Self::ImprintWithoutRest,
        Self::Energy,
        Self::MarkerStep,
    ];

    fn score(self, scores: &Scores) -> f64 {
        f64::from(match self {
            Self::Imprint => scores.slip,
            Self::ImprintWithoutRest => scores.slip_without_rest,
            Self::Energy => -scores.energy,
            Self::MarkerStep => scores.step_px,
        })
    }

    /// The largest score among frames.
    fn max(self, frames: &[Scores]) -> f64 {
        let scores = frames.iter().map(|frame| self.score(frame));
        scores.fold(f64::NEG_INFINITY, f64::max)
    }
}

/// The figures of one witness.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(in crate::real) struct WitnessFigures {
    /// Which.
    pub(super) witness: Witness,
    /// Area under the ROC curve over trials.
    pub(super) pooled: Option<f64>,
    /// Within sessions, weighted by pairs.
    pub(super) stratified: Option<f64>,
    /// Pooled, without the trial that is known to be labelled wrongly.
    pub(super) pooled_without_wrong_label: Option<f64>,
    /// Stratified, without it.
    pub(super) stratified_without_wrong_label: Option<f64>,
    /// The threshold that tells most trials right, none left out.
    pub(super) threshold: f64,
    /// Share of trials judged right at the threshold that was best for other objects.
    pub(super) accuracy: Option<f64>,
    /// Share of slip trials with an alarm at the lowest threshold that gives all holds at most 0.3 alarms a minute.
    pub(super) sensitivity: Option<f64>,
    /// The same with the thresholds that other objects' holds allow.
    pub(super) sensitivity_left_out: Option<f64>,
    /// Alarms a minute of hold at those.
    pub(super) alarms_per_minute_left_out: Option<f64>,
    /// Area under the ROC curve, frames up to eight before the imprint is gone against as many of holds.
    pub(super) early_warning: Option<f64>,
    /// Median number of frames from the first alarm to the imprint's end; of those trials.
    pub(super) lead_frames: Option<f64>,
}

/// All figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(in crate::real) struct Figures {
    /// Trials, and those that slip.
    pub(super) trials: [usize; 2],
    /// Objects.
    pub(super) objects: usize,
    /// Minutes of trials that do not slip, judged frames only.
    pub(super) hold_minutes: f64,
    /// Slip trials that were held at first and whose imprint goes.
    pub(super) warned_trials: usize,
    /// One a witness.
    pub(super) witnesses: Vec<WitnessFigures>,
    /// Fewest and most markers that were followed on a gel.
    pub(super) markers: [usize; 2],
    /// Deviation of markers at rest, median and largest over gels, pixels.
    pub(super) still_px: [Option<f64>; 2],
    /// Distance from rest after release, median and largest over gels, pixels.
    pub(super) return_px: [Option<f64>; 2],
}

/// The trial whose label says that it never slips, and whose pictures show the object leave.
const WRONG_LABEL: [&str; 2] = ["pattern_cotton_cloth__exp_num_11_", "0"];

fn has_wrong_label(trial: &Trial) -> bool {
    trial.name.starts_with(WRONG_LABEL[0]) && !trial.slip
}

/// The figures of trials.
pub(super) fn figures(trials: &[Trial]) -> Figures {
    let mut objects: Vec<&str> = trials.iter().map(|trial| trial.object.as_str()).collect();
    objects.sort_unstable();
    objects.dedup();
    let gels = || trials.iter().flat_map(|trial| &trial.gels);
    let spread = |mut values: Vec<f32>| {
        let largest = values.iter().copied().reduce(f32::max);
        let middle = (!values.is_empty()).then(|| median(&mut values));
        [middle, largest].map(|value| value.map(f64::from))
    };
    Figures {
        trials: [trials.len(), trials.iter().filter(|trial| trial.slip).count()],
        objects: objects.len(),
        hold_minutes: minutes(trials.iter().filter(|trial| !trial.slip)),
        warned_trials: trials.iter().filter_map(gone).count(),
        witnesses: Witness::ALL
            .into_iter()
            .map(|witness| witness_figures(witness, trials, &objects))
            .collect(),
        markers: [
            gels().map(|gel| gel.markers).min().unwrap_or_default(),
            gels().map(|gel| gel.markers).max().unwrap_or_default(),
        ],
        still_px: spread(gels().filter_map(|gel| gel.still_px).collect()),
        return_px: spread(gels().filter_map(|gel| gel.return_px).collect()),
    }
}

fn minutes<'a>(trials: impl Iterator<Item = &'a Trial>) -> f64 {
    let frames: usize = trials.map(|trial| trial.frames.len()).sum();
    frames as f64 / FRAMES_PER_SECOND / 60.0
}

fn witness_figures(witness: Witness, trials: &[Trial], objects: &[&str]) -> WitnessFigures {
    let right: Vec<Trial> = trials
        .iter()
        .filter(|trial| !has_wrong_label(trial))
        .cloned()
        .collect();
    let (mut correct, mut noticed, mut alarms, mut leads) = (0, 0, 0, Vec::new());
    for object in objects {
        let (own, others): (Vec<&Trial>, Vec<&Trial>) =
            trials.iter().partition(|trial| trial.object == *object);
        let best = most_accurate(witness, &others);
        let quiet = quiet_enough(witness, &others);
        for trial in own {
            let max = witness.max(&trial.frames);
            correct += usize::from((max > best) == trial.slip);
            if trial.slip {
                noticed += usize::from(max > quiet);
                let first = trial.frames.iter().position(|frame| witness.score(frame) > quiet);
                if let (Some(end), Some(first)) = (gone(trial), first) {
                    leads.push(end as f32 - first as f32);
                }
            } else {
                alarms += onsets(witness, trial, quiet);
            }
        }
    }
    let slips = trials.iter().filter(|trial| trial.slip).count();
    let share = |count: usize, of: usize| (of > 0).then(|| count as f64 / of as f64);
    let held = minutes(trials.iter().filter(|trial| !trial.slip));
    let quiet = quiet_enough(witness, &trials.iter().collect::<Vec<_>>());
    let at_once = trials
        .iter()
        .filter(|trial| trial.slip && witness.max(&trial.frames) > quiet);
    WitnessFigures {
        witness,
        pooled: pooled(witness, trials),
        stratified: stratified(witness, trials),
        pooled_without_wrong_label: pooled(witness, &right),
        stratified_without_wrong_label: stratified(witness, &right),
        threshold: most_accurate(witness, &trials.iter().collect::<Vec<_>>()),
        accuracy: share(correct, trials.len()),
        sensitivity: share(at_once.count(), slips),
        sensitivity_left_out: share(noticed, slips),
        alarms_per_minute_left_out: (held > 0.0).then(|| alarms as f64 / held),
        early_warning: early_warning(witness, trials),
        lead_frames: (!leads.is_empty()).then(|| f64::from(median(&mut leads))),
    }
}

fn pooled(witness: Witness, trials: &[Trial]) -> Option<f64> {
    let scored: Vec<(f64, bool)> = trials
        .iter()
        .map(|trial| (witness.max(&trial.frames), trial.slip))
        .collect();
    roc_area(&scored)
}

fn stratified(witness: Witness, trials: &[Trial]) -> Option<f64> {
    let (mut sum, mut pairs) = (0.0, 0.0);
    for session in [Session::Long, Session::Short] {
        let of: Vec<Trial> = trials
            .iter()
            .filter(|trial| trial.session == session)
            .cloned()
            .collect();
        let slips = of.iter().filter(|trial| trial.slip).count();
        let weight = (slips * (of.len() - slips)) as f64;
        if let Some(area) = pooled(witness, &of) {
            sum += weight * area;
            pairs += weight;
        }
    }
    (pairs > 0.0).then(|| sum / pairs)
}

/// Thresholds between the trials' scores, from the lowest on.
fn thresholds(witness: Witness, trials: &[&Trial]) -> Vec<f64> {
    let mut scores: Vec<f64> = trials.iter().map(|trial| witness.max(&trial.frames)).collect();
    scores.retain(|score| score.is_finite());
    scores.sort_by(f64::total_cmp);
    scores.dedup();
    scores.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect()
}

/// The threshold that tells most trials right; of equal ones the middle.
fn most_accurate(witness: Witness, trials: &[&Trial]) -> f64 {
    let scored: Vec<(f64, usize)> = thresholds(witness, trials)
        .into_iter()
        .map(|threshold| {
            let right = trials
                .iter()
                .filter(|trial| (witness.max(&trial.frames) > threshold) == trial.slip);
            (threshold, right.count())
        })
        .collect();
    let max = scored.iter().map(|(_, right)| *right).max();
    let best: Vec<f64> = scored
        .iter()
        .filter(|(_, right)| Some(*right) == max)
        .map(|(threshold, _)| *threshold)
        .collect();
    best.get(best.len() / 2).copied().unwrap_or(f64::INFINITY)
}

/// The lowest threshold at which holds give no more alarms a minute than allowed.
fn quiet_enough(witness: Witness, trials: &[&Trial]) -> f64 {
    let holds: Vec<&Trial> = trials.iter().filter(|trial| !trial.slip).copied().collect();
    let allowed = ALARMS_PER_MINUTE * minutes(holds.iter().copied());
    let is_quiet = |threshold: &f64| {
        let alarms: usize = holds.iter().map(|trial| onsets(witness, trial, *threshold)).sum();
        alarms as f64 <= allowed
    };
    // A lower threshold may merge two alarms into one; only above the highest noisy one is it quiet throughout.
    let all = thresholds(witness, trials);
    let first = all
        .iter()
        .rposition(|threshold| !is_quiet(threshold))
        .map_or(0, |noisy| noisy + 1);
    all.get(first).copied().unwrap_or(f64::INFINITY)
}

/// How often the score rises above the threshold after a second below it.
fn onsets(witness: Witness, trial: &Trial, threshold: f64) -> usize {
    let (mut count, mut quiet) = (0, QUIET_FRAMES);
    for frame in &trial.frames {
        if witness.score(frame) > threshold {
            count += usize::from(quiet >= QUIET_FRAMES);
            quiet = 0;
        } else {
            quiet += 1;
        }
    }
    count
}

/// The frame at which a slip trial that was held at first has lost its imprint.
fn gone(trial: &Trial) -> Option<usize> {
    let start = trial.frames.first()?.energy;
    if !trial.slip || start < HELD_ENERGY {
        return None;
    }
    let mut strongest = 0.0f32;
    let end = trial.frames.iter().position(|frame| {
        strongest = strongest.max(frame.energy);
        frame.energy < GONE * strongest
    })?;
    (end > WARNING_FRAMES).then_some(end)
}

/// Every such slip trial's frames up to [`WARNING_FRAMES`] before the end, against as many first frames of every hold.
fn early_warning(witness: Witness, trials: &[Trial]) -> Option<f64> {
    let (mut better, mut pairs) = (0.0, 0.0);
    for (trial, end) in trials.iter().filter_map(|trial| Some((trial, gone(trial)?))) {
        let frames = end - WARNING_FRAMES;
        let score = witness.max(&trial.frames[..frames]);
        for hold in trials.iter().filter(|trial| !trial.slip) {
            let other = witness.max(&hold.frames[..frames.min(hold.frames.len())]);
            pairs += 1.0;
            better += if score > other {
                1.0
            } else {
                f64::from(u8::from(score >= other)) * 0.5
            };
        }
    }
    (pairs > 0.0).then(|| better / pairs)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trial(object: &str, slip: bool, session: Session, slips: &[f32]) -> Trial {
        let frame = |score: &f32| Scores {
            slip: *score,
            slip_without_rest: *score,
            energy: 100.0 * (1.0 - score),
            step_px: 0.0,
        };
        Trial {
            name: object.to_owned(),
            object: object.to_owned(),
            slip,
            session,
            frames: slips.iter().map(frame).collect(),
            gels: Vec::new(),
        }
    }

    #[test]
    fn sessions_that_differ_as_a_whole_do_not_help_the_stratified_area() {
        // Everything in the short session scores higher, and nothing within a session tells.
        let trials = [
            trial("a", false, Session::Long, &[0.1]),
            trial("b", true, Session::Long, &[0.1]),
            trial("c", false, Session::Long, &[0.1]),
            trial("d", true, Session::Short, &[0.6]),
            trial("e", true, Session::Short, &[0.6]),
            trial("f", false, Session::Short, &[0.6]),
        ];
        assert!(pooled(Witness::Imprint, &trials).unwrap() > 0.6);
        assert_eq!(stratified(Witness::Imprint, &trials), Some(0.5));
    }

    #[test]
    fn the_threshold_is_chosen_without_the_object_it_is_judged_on() {
        let trials = [
            trial("a", false, Session::Long, &[0.1]),
            trial("b", true, Session::Long, &[0.9]),
            trial("c", false, Session::Long, &[0.2]),
            trial("d", true, Session::Long, &[0.8]),
            // Odd: slips, and scores below others' thresholds.
            trial("e", true, Session::Long, &[0.3]),
        ];
        let found = figures(&trials);
        let imprint = &found.witnesses[0];
        assert_eq!(imprint.accuracy, Some(0.8));
        assert_eq!(imprint.pooled, Some(1.0));
        assert_eq!(found.trials, [5, 3]);
    }

    #[test]
    fn alarms_are_onsets_and_the_quiet_threshold_lies_above_all_noisy_ones() {
        let mut scores = [0.1f32; 20];
        for frame in [3, 5, 6, 15] {
            scores[frame] = 0.6;
        }
        let noisy = trial("a", false, Session::Long, &scores);
        assert_eq!(onsets(Witness::Imprint, &noisy, 0.5), 2);
        let slips = trial("b", true, Session::Long, &[0.2, 0.9]);
        let threshold = quiet_enough(Witness::Imprint, &[&noisy, &slips]);
        assert!((0.6..0.9).contains(&threshold), "{threshold}");
    }

    #[test]
    fn early_warning_looks_only_at_frames_before_the_end_and_at_as_many_of_holds() {
        // Gone at frame 12; the warning at frame 3 counts, what comes at frame 10 does not.
        let mut slips = vec![0.1f32; 20];
        slips[3] = 0.3;
        slips[10] = 0.6;
        slips[12..].fill(0.95);
        // A hold whose only high score lies later.
        let mut hold = vec![0.1f32; 20];
        hold[8] = 0.6;
        let trials = [
            trial("a", true, Session::Long, &slips),
            trial("b", false, Session::Long, &hold),
        ];
        assert_eq!(gone(&trials[0]), Some(12));
        assert_eq!(gone(&trials[1]), None);
        assert_eq!(early_warning(Witness::Imprint, &trials), Some(1.0));
    }
}
