//! What three detectors say of a trial's maps: the paper's baseline (Coulomb on total forces), its stick ratio, both at its
//! settings, and ours as it runs on the microcontroller, state machine and all. Pure; the microcontroller's own code.

use gripline_firmware::Friction;
use gripline_firmware::slip::SlipDetector;
use gripline_firmware::sums::{TaxelRule, stick_ratio_below, sums_of};
use gripline_firmware::{DeviceMicros, HostMicros};
use gripline_protocol::message::{Configuration, SlipState};
use gripline_protocol::{ForceMap, PER_UNIT};
use serde::Serialize;

use super::chain::{Frame, Recorded};

/// The paper's friction of the detector.
pub const PAPER_FRICTION: f64 = 0.45;
/// The paper's threshold on the stick ratio.
pub const PAPER_THRESHOLD: f64 = 0.5;

/// Something for each of the detectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Each<T> {
    /// F_T > μ F_N over the whole map.
    pub baseline: T,
    /// Stick ratio below the threshold, frame for frame.
    pub stick_ratio: T,
    /// Ours: INCIPIENT or SLIP.
    pub gripline: T,
}

impl<T> Each<T> {
    /// The same for each, made again.
    pub fn map<R>(&self, mut f: impl FnMut(&T) -> R) -> Each<R> {
        Each {
            baseline: f(&self.baseline),
            stick_ratio: f(&self.stick_ratio),
            gripline: f(&self.gripline),
        }
    }

    /// With their names in tables.
    pub fn named(&self) -> [(&'static str, &T); 3] {
        [
            ("Coulomb baseline", &self.baseline),
            ("stick ratio", &self.stick_ratio),
            ("Gripline", &self.gripline),
        ]
    }
}

/// Which map the detectors look at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sight {
    /// What the chain made of the pictures.
    Seen,
    /// What a perfect sensor would have sent.
    Exact,
}

impl Sight {
    fn of(self, frame: &Frame) -> &ForceMap {
        match self {
            Self::Seen => &frame.seen,
            Self::Exact => &frame.exact,
        }
    }
}

/// How the paper's two detectors are set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperSettings {
    /// Friction of the detector.
    pub friction: f64,
    /// Stick ratio below which it slips.
    pub threshold: f64,
}

impl Default for PaperSettings {
    fn default() -> Self {
        Self {
            friction: PAPER_FRICTION,
            threshold: PAPER_THRESHOLD,
        }
    }
}

fn per_unit(value: f64) -> u16 {
    (value * f64::from(PER_UNIT)).round() as u16
}

/// What all three say of every frame.
#[must_use]
pub fn judge(
    recorded: &Recorded,
    sight: Sight,
    paper: PaperSettings,
    ours: &Configuration,
) -> Vec<Each<bool>> {
    let friction = Friction::clamped(per_unit(paper.friction));
    let rule = TaxelRule {
        friction,
        contact_min: 0,
    };
    let states = states(recorded, sight, ours);
    recorded
        .frames
        .iter()
        .zip(states)
        .map(|(frame, state)| {
            let sums = sums_of(sight.of(frame), rule);
            let [x, y, normal] = sums.force;
            Each {
                baseline: friction.exceeded_by([x, y], normal),
                stick_ratio: stick_ratio_below(&sums, per_unit(paper.threshold)),
                gripline: matches!(state, SlipState::Incipient | SlipState::Slip),
            }
        })
        .collect()
}

/// The states of the microcontroller's state machine, frame by frame.
#[must_use]
pub fn states(recorded: &Recorded, sight: Sight, settings: &Configuration) -> Vec<SlipState> {
    let rule = TaxelRule::of(settings);
    let mut detector = SlipDetector::new();
    let frames = recorded.frames.iter();
    frames
        .map(|frame| {
            let now_us = (frame.truth.time_s * 1e6).round() as u64;
            let sums = sums_of(sight.of(frame), rule);
            let judgement = detector.update(&sums, HostMicros(now_us as u32), DeviceMicros(now_us), settings);
            detector.observe(&sums);
            judgement.state
        })
        .collect()
}
