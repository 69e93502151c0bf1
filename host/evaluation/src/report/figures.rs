//! The figures of the paper's experiment, as programs get them.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::detectors::Each;
use crate::judged::Notice;
use crate::metrics::Scores;
use crate::requirement::Requirement;

/// Figures of one object.
#[derive(Debug, Serialize)]
pub struct ObjectScores {
    pub(super) name: String,
    pub(super) mass_g: f64,
    /// Over its runs.
    pub(super) friction: [f64; 2],
    pub(super) grip_n: [f64; 2],
    #[serde(flatten)]
    pub(super) scores: Each<Scores>,
}

/// Tables of one meaning of slip.
#[derive(Debug, Serialize)]
pub struct Tables {
    pub(super) objects: Vec<ObjectScores>,
    pub(super) all: Each<Scores>,
    pub(super) translation: Each<Scores>,
    pub(super) rotation: Each<Scores>,
}

/// A figure of the sensitivity: at this value, these scores.
#[derive(Debug, Serialize)]
pub struct At {
    pub(super) value: f64,
    pub(super) frames: u64,
    pub(super) stick_ratio: Scores,
    pub(super) gripline: Scores,
}

/// What depends on what.
#[derive(Debug, Serialize)]
pub struct Sensitivity {
    /// Detector's friction over the true one, run by run.
    pub(super) friction_assumed_over_true: Vec<At>,
    pub(super) threshold: Vec<At>,
    pub(super) camera_noise_levels: Vec<At>,
    /// Least number of loaded taxels of each size.
    pub(super) contact_taxels_from: Vec<At>,
}

/// Everything.
#[derive(Debug, Serialize)]
pub struct Report {
    pub(super) network: String,
    pub(super) data: &'static str,
    pub(super) quick: bool,
    /// How many of the five were played.
    pub(super) objects_played: u8,
    pub(super) seed: u64,
    pub(super) runs: u64,
    pub(super) sensors: [u64; 2],
    pub(super) frames: usize,
    pub(super) doubtful_frames: usize,
    /// What must hold.
    pub(super) bounds: Vec<Requirement>,
    /// Beginnings and ends of slips in the sequences, percent of their frames.
    pub(super) edge_percent: f64,
    /// Our detector's settings.
    pub(super) settings: BTreeMap<&'static str, f64>,
    #[serde(flatten)]
    pub(super) tables: Tables,
    pub(super) gross_slip_only: Tables,
    pub(super) perfect_sensor: Each<Scores>,
    pub(super) lead_time_ms_median: Option<f64>,
    pub(super) slips: BTreeMap<&'static str, Each<Notice>>,
    pub(super) hold_minutes: f64,
    pub(super) alarms_per_minute: f64,
    pub(super) alarms_per_minute_of: Each<f64>,
    pub(super) sensitivity: Sensitivity,
    /// Runs that ended early, and why.
    pub unsolved: Vec<String>,
}
