//! The last ten seconds of a run: the data of the traces, the scales and the latencies.
//!
//! Times in seconds of the pictures' clock. At most [`SAMPLES_MAX`] frames are kept, so above 1,000 frames a second the
//! traces reach less far back.

use std::collections::VecDeque;

use gripline_recording::telemetry::{FrameReport, STAGES};

/// How far back the traces reach.
pub(super) const SPAN_S: f64 = 10.0;
/// Bound on memory: 10 s at 1,000 frames a second.
const SAMPLES_MAX: usize = 10_000;
/// A stage that took less was skipped; the table shows whole microseconds.
const RAN_MIN_US: f64 = 0.5;
/// The frame rate is the mean over this time.
const RATE_SPAN_S: f64 = 2.0;

/// The stored values of one frame.
#[derive(Debug, Clone)]
pub(super) struct Sample {
    pub(super) t_s: f64,
    pub(super) stick_ratio: Option<f64>,
    pub(super) true_stick_ratio: Option<f64>,
    /// `None` without contact.
    pub(super) slip_evidence: Option<f64>,
    pub(super) line_n: f64,
    pub(super) normal_n: f64,
    /// Maximum normal force of a taxel.
    pub(super) peak_n: f64,
    latency_us: f64,
    stages_us: [f64; STAGES.len()],
}

/// Median and 99th percentile of one stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Quantiles {
    pub(super) median_us: f64,
    pub(super) p99_us: f64,
}

/// The samples, oldest first.
#[derive(Debug, Default)]
pub(super) struct History {
    samples: VecDeque<Sample>,
}

impl History {
    /// Adds a frame. A clock that jumps back (a replay that starts again) starts the history again.
    pub(super) fn push(&mut self, report: &FrameReport, peak_n: f32) {
        if !report.t_s.is_finite() {
            return;
        }
        if self.samples.back().is_some_and(|last| report.t_s < last.t_s) {
            self.samples.clear();
        }
        self.samples.push_back(Sample {
            t_s: report.t_s,
            stick_ratio: report.stick_ratio,
            true_stick_ratio: report.truth.as_ref().and_then(|truth| truth.stick_ratio),
            slip_evidence: report.stick_ratio.map(|_| report.slip_evidence),
            line_n: report.line_n,
            normal_n: report.normal_n,
            peak_n: f64::from(peak_n),
            latency_us: report.latency_us,
            stages_us: report.stages_us,
        });
        while self.samples.len() > SAMPLES_MAX
            || self
                .samples
                .front()
                .is_some_and(|first| first.t_s < report.t_s - SPAN_S)
        {
            self.samples.pop_front();
        }
    }

    pub(super) fn samples(&self) -> impl Iterator<Item = &Sample> {
        self.samples.iter()
    }

    /// Time of the newest frame; 0 before the first.
    pub(super) fn now_s(&self) -> f64 {
        self.samples.back().map_or(0.0, |sample| sample.t_s)
    }

    /// Maximum finite value of a quantity that is never negative.
    pub(super) fn greatest(&self, value: impl Fn(&Sample) -> f64) -> f64 {
        self.samples()
            .map(value)
            .filter(|value| value.is_finite())
            .fold(0.0, f64::max)
    }

    /// Pictures per second of the pictures' clock.
    pub(super) fn frames_per_s(&self) -> Option<f64> {
        let from_s = self.now_s() - RATE_SPAN_S;
        let recent = self
            .samples
            .iter()
            .rev()
            .take_while(|sample| sample.t_s >= from_s);
        let (oldest, count) = recent.fold((None, 0_u32), |(_, count), sample| (Some(sample.t_s), count + 1));
        let span_s = self.now_s() - oldest?;
        (span_s > 0.0).then(|| f64::from(count - 1) / span_s)
    }

    /// Of each stage over the frames that did not skip it, then of the whole way.
    pub(super) fn latencies(&self) -> [Option<Quantiles>; STAGES.len() + 1] {
        std::array::from_fn(|column| {
            let stage = |sample: &Sample| sample.stages_us.get(column).copied().unwrap_or(sample.latency_us);
            quantiles(
                self.samples()
                    .map(stage)
                    .filter(|&us| us.is_finite() && us >= RAN_MIN_US)
                    .collect(),
            )
        })
    }
}

/// Nearest-rank quantiles.
fn quantiles(mut values_us: Vec<f64>) -> Option<Quantiles> {
    values_us.sort_unstable_by(f64::total_cmp);
    let rank = |share: f64| {
        let place = (share * values_us.len() as f64).ceil() as usize;
        values_us.get(place.saturating_sub(1)).copied()
    };
    Some(Quantiles {
        median_us: rank(0.5)?,
        p99_us: rank(0.99)?,
    })
}

/// The smallest of 1, 1.5, 2, 3, 5, 7 times a power of ten that is not below `value`, for scales that seldom change.
pub(super) fn round_up(value: f64, min: f64) -> f64 {
    let value = value.max(min);
    let decade = 10_f64.powf(value.log10().floor());
    [1.0, 1.5, 2.0, 3.0, 5.0, 7.0]
        .into_iter()
        .map(|step| step * decade)
        .find(|&step| step >= value * (1.0 - 1e-9))
        .unwrap_or(10.0 * decade)
}

#[cfg(test)]
mod tests {
    use super::super::tests::report;
    use super::*;

    #[test]
    fn quantiles_are_the_nearest_ranks_of_the_frames_that_ran_the_stage() {
        let mut history = History::default();
        for frame in 1..=200_u32 {
            let mut frame_report = report(u64::from(frame));
            frame_report.stages_us = [0.0, 0.04, 1.0, f64::from(frame), 0.0, 0.0];
            if frame % 2 == 0 {
                frame_report.stages_us[3] = 0.0;
            }
            history.push(&frame_report, 0.0);
        }
        let latencies = history.latencies();
        assert_eq!((latencies[0], latencies[1]), (None, None));
        // 1, 3, .. 199: the 50th is 99 and the 99th is 197.
        let network = latencies[3].unwrap();
        assert_eq!((network.median_us, network.p99_us), (99.0, 197.0));
        assert!(latencies[6].is_some());
    }

    #[test]
    fn only_the_span_is_kept_and_a_clock_that_jumps_back_starts_again() {
        let mut history = History::default();
        for frame in 0..2_000 {
            let mut frame_report = report(frame);
            frame_report.t_s = frame as f64 / 100.0;
            history.push(&frame_report, 0.0);
        }
        assert_eq!(history.samples().count(), 1_001);
        assert!((history.frames_per_s().unwrap() - 100.0).abs() < 1e-6);
        history.push(&report(0), 0.0);
        assert_eq!(history.samples().count(), 1);
        assert_eq!(history.frames_per_s(), None);
    }

    #[test]
    fn however_fast_frames_come_memory_is_bounded() {
        let mut history = History::default();
        for frame in 0..3 * SAMPLES_MAX {
            let mut frame_report = report(0);
            frame_report.t_s = frame as f64 * 1e-6;
            history.push(&frame_report, 0.0);
        }
        assert_eq!(history.samples().count(), SAMPLES_MAX);
    }

    #[test]
    fn a_rounded_scale_is_never_below_its_value_and_at_most_half_above() {
        for value in [0.05, 0.1, 0.101, 0.15, 0.7, 0.71, 1.0, 4.9, 9.9, 10.0, 30.0] {
            let rounded = round_up(value, 0.05);
            assert!(
                rounded >= value * (1.0 - 1e-9) && rounded < value * 1.67,
                "{value} gave {rounded}"
            );
        }
        assert!((round_up(0.0, 0.05) - 0.05).abs() < 1e-12);
        assert!((round_up(-3.0, 0.05) - 0.05).abs() < 1e-12);
    }
}
