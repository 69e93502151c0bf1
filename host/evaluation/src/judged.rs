//! From played runs to figures: what is a slip, and how each detector did. Pure.
//!
//! A frame slips when less than half of the contact sticks in the world (the paper's threshold, on the truth), or the
//! contact slides as a whole: what a stick-ratio detector is to notice, incipient slip included. The stricter reading, gross
//! slip alone, is what a person sees in a video; both are reported.

use gripline_protocol::message::Configuration;
use serde::Serialize;

use super::chain::Recorded;
use super::detectors::{Each, PaperSettings, Sight, judge};
use super::metrics::{Confusion, alarms, lead_s, quantile};
use super::plan::Planned;
use super::trial::{FRAMES_PER_SECOND, Kind, Part, Script, TruthFrame};

/// True stick ratio below which a frame slips.
pub const TRUE_THRESHOLD: f64 = 0.5;

/// What counts as slip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meaning {
    /// Less than half of the contact sticks, or all of it slides.
    Incipient,
    /// All of it slides.
    Gross,
}

impl Meaning {
    /// Whether a frame slips.
    #[must_use]
    pub fn slips(self, truth: &TruthFrame) -> bool {
        let incipient = truth.stick_ratio.is_some_and(|ratio| ratio < TRUE_THRESHOLD);
        truth.gross_slip || (self == Self::Incipient && incipient)
    }
}

/// A run with what the detectors said of it.
#[derive(Debug)]
pub struct Judged<'a> {
    /// What was planned.
    pub planned: &'a Planned,
    /// What was played.
    pub recorded: &'a Recorded,
    /// What was said, frame by frame.
    pub said: Vec<Each<bool>>,
}

impl<'a> Judged<'a> {
    /// The run as all three detectors see it.
    #[must_use]
    pub fn new(
        planned: &'a Planned,
        recorded: &'a Recorded,
        sight: Sight,
        paper: PaperSettings,
        ours: &Configuration,
    ) -> Self {
        Self {
            planned,
            recorded,
            said: judge(recorded, sight, paper, ours),
        }
    }

    /// Frames in contact that `wanted` keeps.
    fn frames(
        &self,
        wanted: impl Fn(&super::chain::Frame) -> bool,
    ) -> impl Iterator<Item = (&super::chain::Frame, Each<bool>)> {
        let frames = self.recorded.frames.iter().zip(&self.said);
        frames
            .filter(move |(frame, _)| wanted(frame))
            .map(|(frame, said)| (frame, *said))
    }

    /// What the run does at slip number `slip`.
    #[must_use]
    pub fn kind(&self, slip: usize) -> Option<Kind> {
        match &self.planned.trial.script {
            Script::Slips(kinds) => kinds.get(slip).copied(),
            Script::Hold(_) => None,
        }
    }
}

/// Confusion tables over all frames of these runs that `wanted` keeps.
pub fn confusion<'a>(
    runs: impl IntoIterator<Item = &'a Judged<'a>>,
    meaning: Meaning,
    wanted: impl Fn(&super::chain::Frame) -> bool,
) -> Each<Confusion> {
    let mut tables = Each::<Confusion>::default();
    for run in runs {
        for (frame, said) in run.frames(&wanted) {
            let slips = meaning.slips(&frame.truth);
            tables.baseline.add(said.baseline, slips);
            tables.stick_ratio.add(said.stick_ratio, slips);
            tables.gripline.add(said.gripline, slips);
        }
    }
    tables
}

/// How slips were noticed.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Notice {
    /// Slips that became gross.
    pub slips: usize,
    /// Of them, those noticed before they ended.
    pub noticed: usize,
    /// Of them, those noticed before they became gross.
    pub before: usize,
    /// Lead before gross slip, ms; a slip that was not noticed counts as the worst. None if more than half were not.
    pub lead_ms_median: Option<f64>,
    /// The lead that a twentieth falls short of, ms.
    pub lead_ms_p5: Option<f64>,
}

impl Notice {
    /// Of these leads, s.
    #[must_use]
    pub fn of(leads: &[Option<f64>]) -> Self {
        let worst_first: Vec<f64> = leads
            .iter()
            .map(|lead| lead.map_or(f64::NEG_INFINITY, |lead| 1e3 * lead))
            .collect();
        let at = |q: f64| quantile(&worst_first, q).filter(|lead| lead.is_finite());
        Self {
            slips: leads.len(),
            noticed: leads.iter().flatten().count(),
            before: leads.iter().flatten().filter(|lead| **lead > 0.0).count(),
            lead_ms_median: at(0.5),
            lead_ms_p5: at(0.05),
        }
    }
}

/// How slips of `kind`, or of any kind, were noticed.
pub fn notice<'a>(runs: impl IntoIterator<Item = &'a Judged<'a>>, kind: Option<Kind>) -> Each<Notice> {
    let mut leads = Each::<Vec<Option<f64>>>::default();
    for run in runs {
        let Script::Slips(kinds) = &run.planned.trial.script else {
            continue;
        };
        for slip in 0..kinds.len() {
            if kind.is_some_and(|kind| run.kind(slip) != Some(kind)) {
                continue;
            }
            let pull: Vec<(&TruthFrame, Each<bool>)> = run
                .frames(|frame| frame.truth.part == Part::Pull(slip))
                .map(|(frame, said)| (&frame.truth, said))
                .collect();
            let Some((gross, _)) = pull.iter().find(|(truth, _)| truth.gross_slip) else {
                continue;
            };
            let lead = |of: fn(&Each<bool>) -> bool| {
                lead_s(
                    pull.iter().map(|(truth, said)| (truth.time_s, of(said))),
                    gross.time_s,
                )
            };
            leads.baseline.push(lead(|said| said.baseline));
            leads.stick_ratio.push(lead(|said| said.stick_ratio));
            leads.gripline.push(lead(|said| said.gripline));
        }
    }
    leads.map(|leads| Notice::of(leads))
}

/// Minutes of steady hold in these runs, and alarms a minute.
pub fn hold_alarms<'a>(runs: impl IntoIterator<Item = &'a Judged<'a>>) -> (f64, Each<f64>) {
    let (mut frames, mut counts) = (0, Each::<u64>::default());
    for run in runs {
        let steady: Vec<Each<bool>> = run
            .frames(|frame| frame.truth.part == Part::Rest)
            .map(|(_, said)| said)
            .collect();
        frames += steady.len();
        counts.baseline += alarms(steady.iter().map(|said| said.baseline));
        counts.stick_ratio += alarms(steady.iter().map(|said| said.stick_ratio));
        counts.gripline += alarms(steady.iter().map(|said| said.gripline));
    }
    let minutes = frames as f64 / FRAMES_PER_SECOND / 60.0;
    (minutes, counts.map(|count| *count as f64 / minutes.max(1e-9)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(stick_ratio: f64, gross_slip: bool) -> TruthFrame {
        TruthFrame {
            time_s: 0.0,
            part: Part::Rest,
            stick_ratio: Some(stick_ratio),
            gross_slip,
            force_n: [0.0; 3],
            torsional_moment_nmm: 0.0,
        }
    }

    #[test]
    fn incipient_slip_is_a_slip_and_gross_slip_is_one_either_way() {
        let says = |ratio: f64, gross: bool| {
            [Meaning::Incipient, Meaning::Gross].map(|meaning| meaning.slips(&frame(ratio, gross)))
        };
        assert_eq!(says(0.6, false), [false, false]);
        assert_eq!(says(0.4, false), [true, false]);
        assert_eq!(says(0.0, true), [true, true]);
        let free = TruthFrame {
            stick_ratio: None,
            ..frame(0.0, false)
        };
        assert!(!Meaning::Incipient.slips(&free));
    }

    #[test]
    fn a_slip_that_nobody_noticed_counts_as_the_worst_lead() {
        let notice = Notice::of(&[Some(0.1), None, Some(0.2), Some(-0.05), Some(0.3)]);
        assert_eq!((notice.slips, notice.noticed, notice.before), (5, 4, 3));
        assert!((notice.lead_ms_median.unwrap() - 100.0).abs() < 1e-9);
        assert_eq!(notice.lead_ms_p5, None);
        assert_eq!(Notice::of(&[None, None, Some(0.1)]).lead_ms_median, None);
        assert_eq!(Notice::of(&[]), Notice::default());
    }
}
