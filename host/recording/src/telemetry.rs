//! The pipeline's report of every frame, for the view, for `--json` and for the summary. Units in the names; forces in newtons,
//! moments in newton-millimetres about the map's centre, both in the map's frame except for `load`.

use std::borrow::Cow;

use gripline_protocol::message::{Configuration, Witnesses};
use gripline_protocol::{Health, SensorId};
use serde::Serialize;

use crate::units::{Load, newtons, ratio};

/// Names of the stages in the order in which a frame passes them.
pub const STAGES: [&str; 6] = ["decode", "downsample", "gate", "network", "encode", "link"];

/// Deadline of each of [`STAGES`], µs; a stage that takes longer is counted as late. Decoding is that of a noisy MJPEG frame of
/// quality 95, in the camera's own thread. The others are the loop's: together 3.1 ms of the 4 ms that it has.
pub const DEADLINES_US: [f64; STAGES.len()] = [2_000.0, 150.0, 150.0, 2_400.0, 100.0, 300.0];

/// The host's own fault that this frame was late and dropped.
pub const LATE: &str = "LATE FRAME";

/// The host's own faults, besides those of the microcontroller: the device is not connected.
pub const NO_DEVICE: &str = "NO DEVICE";
/// The last status is old: state and line are unknown.
pub const NO_STATUS: &str = "NO STATUS";
/// Older than this, µs: ten statuses a second come, whatever happens.
pub const STATUS_OLD_US: u64 = 250_000;

/// One frame, with the microcontroller's newest answer.
#[derive(Debug, Clone, Serialize)]
pub struct FrameReport {
    /// Number of the frame, from 0; with two fingertips a frame is a picture of either.
    pub frame: u64,
    /// The fingertip that the picture is of. State, line and faults are the gripper's.
    pub sensor: SensorId,
    /// Time of the picture since start.
    pub t_s: f64,
    /// What the scene gate decided, in snake case.
    pub gate: &'static str,
    /// Doubts about the picture; empty if there are none.
    pub health: Vec<&'static str>,
    /// Total normal force, as summed by the microcontroller.
    #[serde(rename = "fn")]
    pub normal_n: f64,
    /// Total shear along the map's rows.
    #[serde(rename = "fx")]
    pub shear_x_n: f64,
    /// Total shear along the map's columns.
    #[serde(rename = "fy")]
    pub shear_y_n: f64,
    /// Length of the total shear.
    #[serde(rename = "ft")]
    pub shear_n: f64,
    /// Moment about z.
    #[serde(rename = "mz")]
    pub moment_nmm: f64,
    /// Centre of pressure from the map's centre, x and y; `None` when nothing presses.
    #[serde(rename = "cop_mm")]
    pub centre_of_pressure_mm: Option<[f64; 2]>,
    /// The same load in the gripper's frame, by the fingertip's stored geometry.
    pub load: Load,
    /// Taxels in contact.
    pub contact: u16,
    /// Taxels in contact that stick.
    pub stick: u16,
    /// stick / contact; `None` when nothing touches.
    pub stick_ratio: Option<f64>,
    /// Coulomb baseline F_T > μ F_N.
    pub coulomb_slip: bool,
    /// Slip state: `NO_CONTACT`, `STICK`, `INCIPIENT`, `SLIP`.
    pub state: &'static str,
    /// How sure the whole detector is that something slips, 0 to 1.
    pub slip_evidence: f64,
    /// What each witness says by itself.
    pub witnesses: WitnessReport,
    /// Estimated time to slip.
    pub time_to_slip_ms: Option<u16>,
    /// Grip-force line.
    pub line_n: f64,
    /// Frame bytes in to bytes for the microcontroller out.
    pub latency_us: f64,
    /// Time of each of [`STAGES`], in their order; 0 where the gate skipped it.
    pub stages_us: [f64; STAGES.len()],
    /// Names of the microcontroller's faults that are there or latched, and of the host's own.
    pub faults: Vec<&'static str>,
    /// Where the frame was dropped because it was too old: `picture`, before anybody looked at it (the gate then says
    /// nothing), or `map`, before it was sent.
    pub late: Option<&'static str>,
    /// Bytes on the wire for this map.
    pub wire_bytes: usize,
    /// What the markers of a sensor that has them show; `None` of others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub markers: Option<MarkersReport>,
    /// What the simulated world knows; `None` for real cameras.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<Truth>,
}

/// Printed markers of one picture, and the imprint between them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MarkersReport {
    /// Markers that are followed.
    pub followed: usize,
    /// Those of them that this picture does not show.
    pub hidden: usize,
    /// How little of the earlier imprint has come back, 0 to 1; `None` until there is one.
    pub imprint_slip: Option<f32>,
    /// What that is worth, 0 to 1.
    pub imprint_quality: Option<f32>,
    /// Share of the strongest imprint of this hold that is gone, 0 to 1.
    pub imprint_lost: Option<f32>,
}

/// What each witness of slip says by itself, 0 to 1: [`Witnesses`] for programs and people.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct WitnessReport {
    /// The stick ratio and the load on the contact.
    pub stick_ratio: f64,
    /// The map changes although the load does not.
    pub unrest: f64,
    /// The shear follows the grip.
    pub shear_follows: f64,
    /// The picture shows the object move.
    pub motion: f64,
}

impl WitnessReport {
    /// Of the microcontroller's numbers.
    #[must_use]
    pub fn of(witnesses: &Witnesses) -> Self {
        Self {
            stick_ratio: ratio(witnesses.stick_ratio),
            unrest: ratio(witnesses.unrest),
            shear_follows: ratio(witnesses.shear_follows),
            motion: ratio(witnesses.motion),
        }
    }
}

/// What the simulated world knows about a frame.
#[derive(Debug, Clone, Serialize)]
pub struct Truth {
    /// Part of the scene's script.
    pub phase: Cow<'static, str>,
    /// Normal force of the object on the skin.
    pub normal_n: f64,
    /// Shear force of the object on the skin.
    pub shear_n: f64,
    /// True share of the contact area that sticks.
    pub stick_ratio: Option<f64>,
    /// The whole contact slides.
    pub gross_slip: bool,
    /// How far the object has slid since the scene began.
    pub slip_mm: f64,
}

/// What stays the same over a run and the view needs to know.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Detector's friction coefficient.
    pub friction: f64,
    /// Stick ratio below which the state is SLIP.
    pub slip_threshold: f64,
    /// A taxel is in contact above this normal force.
    pub contact_min_n: f64,
    /// Minimum grip force.
    pub floor_n: f64,
    /// Maximum grip force.
    pub ceiling_n: f64,
}

impl Limits {
    /// Those of the microcontroller's settings.
    #[must_use]
    pub fn of(settings: &Configuration) -> Self {
        Self {
            friction: ratio(settings.friction),
            slip_threshold: ratio(settings.slip_threshold),
            contact_min_n: newtons(settings.contact_min.into()),
            floor_n: newtons(settings.floor),
            ceiling_n: newtons(settings.ceiling),
        }
    }
}

/// Names of the flags of a map's health.
#[must_use]
pub fn health_names(health: Health) -> Vec<&'static str> {
    let names = [
        (Health::TOO_DARK, "too_dark"),
        (Health::TOO_BRIGHT, "too_bright"),
        (Health::UNLIKE_TRAINING, "unlike_training"),
        (Health::PARTICLES_LOST, "particles_lost"),
        (Health::SATURATED, "saturated"),
    ];
    let set = names.into_iter().filter(|(flag, _)| health.has(*flag));
    set.map(|(_, name)| name).collect()
}
