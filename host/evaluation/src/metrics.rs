//! How good a detector is: confusion tables, lead time, alarms, area under the ROC curve. Pure arithmetic.

use serde::Serialize;

/// Frames by what was said and what is true.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Confusion {
    /// Said slip, and it slips.
    pub hits: u64,
    /// Said slip, and it does not.
    pub false_alarms: u64,
    /// Said nothing, and it slips.
    pub misses: u64,
    /// Said nothing, and it does not.
    pub quiet: u64,
}

impl Confusion {
    /// Counts a frame.
    pub fn add(&mut self, said: bool, slips: bool) {
        *match (said, slips) {
            (true, true) => &mut self.hits,
            (true, false) => &mut self.false_alarms,
            (false, true) => &mut self.misses,
            (false, false) => &mut self.quiet,
        } += 1;
    }

    /// Both tables together.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self {
            hits: self.hits + other.hits,
            false_alarms: self.false_alarms + other.false_alarms,
            misses: self.misses + other.misses,
            quiet: self.quiet + other.quiet,
        }
    }

    /// Shares in percent; a share of nothing is not there.
    #[must_use]
    pub fn scores(&self) -> Scores {
        let percent = |part: u64, whole: u64| (whole > 0).then(|| 100.0 * part as f64 / whole as f64);
        let Self {
            hits,
            false_alarms,
            misses,
            quiet,
        } = *self;
        Scores {
            accuracy: percent(hits + quiet, hits + false_alarms + misses + quiet),
            precision: percent(hits, hits + false_alarms),
            recall: percent(hits, hits + misses),
        }
    }
}

/// A confusion table in percent.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Scores {
    /// Frames judged rightly.
    pub accuracy: Option<f64>,
    /// Of the frames said to slip, those that do.
    pub precision: Option<f64>,
    /// Of the frames that slip, those said to.
    pub recall: Option<f64>,
}

/// How often the value went from no to yes, the first frame included.
#[must_use]
pub fn alarms(said: impl IntoIterator<Item = bool>) -> u64 {
    let mut before = false;
    let mut count = 0;
    for now in said {
        count += u64::from(now && !before);
        before = now;
    }
    count
}

/// Time from the alarm to the slip, s: above 0 it came before. `said` are time and word of the frames from the pull's
/// beginning to its end, `slip_s` is when it slides. None when nothing was said.
#[must_use]
pub fn lead_s(said: impl IntoIterator<Item = (f64, bool)>, slip_s: f64) -> Option<f64> {
    said.into_iter()
        .find(|(_, said)| *said)
        .map(|(time_s, _)| slip_s - time_s)
}

/// The value below which the share `q` lies, nearest rank; none of nothing.
#[must_use]
pub fn quantile(values: &[f64], q: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = ((sorted.len().checked_sub(1)?) as f64 * q).round() as usize;
    sorted.get(rank).copied()
}

/// Area under the ROC curve of a score that is high where `positive`: the share of pairs that it orders rightly, ties
/// half. None when there is only one kind.
#[must_use]
pub fn roc_area(frames: &[(f64, bool)]) -> Option<f64> {
    let mut sorted = frames.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut below, mut pairs, mut at) = (0_u64, 0.0, 0);
    while at < sorted.len() {
        let tied = sorted[at..]
            .iter()
            .take_while(|frame| frame.0.total_cmp(&sorted[at].0).is_eq())
            .count();
        let positive = sorted[at..at + tied].iter().filter(|frame| frame.1).count() as u64;
        let negative = tied as u64 - positive;
        pairs += positive as f64 * (below as f64 + 0.5 * negative as f64);
        below += negative;
        at += tied;
    }
    let positive = sorted.iter().filter(|frame| frame.1).count() as u64;
    (positive > 0 && below > 0).then(|| pairs / (positive as f64 * below as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(hits: u64, false_alarms: u64, misses: u64, quiet: u64) -> Confusion {
        Confusion {
            hits,
            false_alarms,
            misses,
            quiet,
        }
    }

    #[test]
    fn the_scores_of_a_table_are_its_shares_in_percent() {
        let scores = table(30, 10, 20, 40).scores();
        assert_eq!(
            [scores.accuracy, scores.precision, scores.recall],
            [Some(70.0), Some(75.0), Some(60.0)]
        );
    }

    #[test]
    fn a_share_of_nothing_is_not_there() {
        let silent = table(0, 0, 0, 5).scores();
        assert_eq!(
            [silent.accuracy, silent.precision, silent.recall],
            [Some(100.0), None, None]
        );
        assert_eq!(Confusion::default().scores(), Scores::default());
    }

    #[test]
    fn counting_frames_one_by_one_gives_the_sum_of_the_tables() {
        let mut all = Confusion::default();
        for (said, slips, count) in [
            (true, true, 3),
            (true, false, 1),
            (false, true, 2),
            (false, false, 4),
        ] {
            for _ in 0..count {
                all.add(said, slips);
            }
        }
        assert_eq!(all, table(1, 1, 1, 1).with(table(2, 0, 1, 3)));
    }

    #[test]
    fn an_alarm_is_a_change_from_no_to_yes() {
        let said = |text: &str| alarms(text.chars().map(|letter| letter == 'x'));
        assert_eq!(
            [
                said("....."),
                said("x...."),
                said(".xx.x"),
                said("xxxxx"),
                said("")
            ],
            [0, 1, 2, 1, 0]
        );
    }

    #[test]
    fn lead_is_from_the_first_alarm_to_the_slip_and_negative_when_it_comes_late() {
        let frames = [(0.1, false), (0.2, true), (0.3, false), (0.4, true)];
        assert!((lead_s(frames, 0.35).unwrap() - 0.15).abs() < 1e-12);
        assert!((lead_s(frames, 0.15).unwrap() + 0.05).abs() < 1e-12);
        assert_eq!(lead_s(frames.map(|(time_s, _)| (time_s, false)), 0.3), None);
    }

    #[test]
    fn quantiles_are_values_of_the_list() {
        let values = [4.0, 1.0, 3.0, 2.0, 5.0];
        assert_eq!(
            [0.0, 0.5, 0.99, 1.0].map(|q| quantile(&values, q)),
            [Some(1.0), Some(3.0), Some(5.0), Some(5.0)]
        );
        assert_eq!(quantile(&[], 0.5), None);
    }

    #[test]
    fn the_roc_area_is_the_share_of_pairs_in_order() {
        let area = |scores: &[(f64, bool)]| roc_area(scores).unwrap();
        assert!((area(&[(0.1, false), (0.2, false), (0.8, true)]) - 1.0).abs() < 1e-12);
        assert!((area(&[(0.9, false), (0.2, true)]) - 0.0).abs() < 1e-12);
        assert!((area(&[(0.5, false), (0.5, true), (0.5, true)]) - 0.5).abs() < 1e-12);
        // Positives 2, 4; negatives 1, 2, 3: pairs in order 1 + ½ + 3 of 6.
        let mixed = [(2.0, true), (4.0, true), (1.0, false), (2.0, false), (3.0, false)];
        assert!((area(&mixed) - 4.5 / 6.0).abs() < 1e-12);
        assert_eq!(roc_area(&[(1.0, true)]), None);
    }
}
