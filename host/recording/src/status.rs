//! A frame's report and the device's status, as the JSON messages of `/status` and back. Pure.

use gripline_protocol::message::{GripMode, Status};
use gripline_protocol::{ForceMap, SensorId};
use serde::{Deserialize, Serialize};

use crate::image::Image;
use crate::telemetry::FrameReport;

/// One frame for the recorder.
#[derive(Debug, Clone)]
pub struct Frame {
    /// The report of the view and `--json`.
    pub report: FrameReport,
    /// Number of the map.
    pub sequence: u32,
    /// Capture time sent with the map.
    pub capture_us: u32,
    /// When the frame began, on the link's clock.
    pub begun_us: u32,
    /// The link worked until then, after frame 0.
    pub until_us: u64,
    /// The requested mode of the gripper; `None`: nothing was requested.
    pub requested_mode: Option<GripMode>,
    /// Minimum force while holding, 1/4096 N.
    pub floor_lsb: i32,
    /// [`gripline_protocol::Health`] of the map.
    pub health_bits: u8,
    /// [`gripline_protocol::Motion`] of the map.
    pub motion_bits: u8,
    /// The microcontroller's newest status.
    pub wire: Status,
    /// The map in the wire's units.
    pub map: Box<ForceMap>,
    /// Distance of the taxels, µm.
    pub pitch_um: u16,
    /// The picture in the recorded size.
    pub picture: Option<Image>,
}

#[derive(Serialize)]
struct StatusOut<'a> {
    #[serde(flatten)]
    report: &'a FrameReport,
    sequence: u32,
    capture_us: u32,
    begun_us: u32,
    until_us: u64,
    requested_mode: Option<GripMode>,
    floor_lsb: i32,
    health_bits: u8,
    motion_bits: u8,
    wire: &'a Status,
}

/// A frame's status as it is read back; [`FrameReport`] says more about its fields.
#[derive(Debug, Clone, Deserialize)]
pub struct RecordedStatus {
    /// Number of the frame, from 0.
    pub frame: u64,
    /// Fingertip; recordings older than the second fingertip have none.
    #[serde(default)]
    pub sensor: SensorId,
    /// Time of the picture since start.
    pub t_s: f64,
    /// What the scene gate decided.
    pub gate: String,
    /// Doubts about the picture.
    pub health: Vec<String>,
    /// F_N.
    #[serde(rename = "fn")]
    pub normal_n: f64,
    /// F_x.
    #[serde(rename = "fx")]
    pub shear_x_n: f64,
    /// F_y.
    #[serde(rename = "fy")]
    pub shear_y_n: f64,
    /// F_T.
    #[serde(rename = "ft")]
    pub shear_n: f64,
    /// Moment about z.
    #[serde(rename = "mz")]
    pub moment_nmm: f64,
    /// Taxels in contact.
    pub contact: u16,
    /// Taxels in contact that stick.
    pub stick: u16,
    /// stick / contact.
    pub stick_ratio: Option<f64>,
    /// Coulomb baseline F_T > μ F_N.
    pub coulomb_slip: bool,
    /// Slip state.
    pub state: String,
    /// Grip-force line.
    pub line_n: f64,
    /// Frame bytes in to bytes for the device out.
    pub latency_us: f64,
    /// Names of the device's faults and the host's own.
    pub faults: Vec<String>,
    /// Time of each stage.
    #[serde(default)]
    pub stages_us: Vec<f64>,
    /// Bytes on the wire for this map.
    #[serde(default)]
    pub wire_bytes: usize,
    /// Where the frame was dropped as late; older recordings have none.
    #[serde(default)]
    pub late: Option<String>,
    /// The simulated world's truth.
    pub truth: Option<RecordedTruth>,
    /// Number of the map.
    pub sequence: u32,
    /// When the picture was taken, on the link's clock.
    pub capture_us: u32,
    /// When the frame began; older recordings have none, and their pictures count as captured then.
    #[serde(default)]
    pub begun_us: Option<u32>,
    /// Time up to which the link worked for this frame, after frame 0.
    pub until_us: u64,
    /// The requested mode of the gripper; `None`: nothing was requested.
    #[serde(alias = "wish")] // recordings made before
    pub requested_mode: Option<GripMode>,
    /// Minimum force while holding, 1/4096 N; older recordings have none, theirs never changes.
    #[serde(default)]
    pub floor_lsb: Option<i32>,
    /// [`gripline_protocol::Health`] of the map, as bits.
    pub health_bits: u8,
    /// [`gripline_protocol::Motion`] of the map, as bits; older recordings have none.
    #[serde(default)]
    pub motion_bits: u8,
    /// The device's status in the wire's units.
    pub wire: Status,
}

/// What the simulated world knew about a frame.
#[derive(Debug, Clone, Deserialize)]
pub struct RecordedTruth {
    /// What the scene was doing.
    pub phase: String,
    /// Normal force, newtons.
    pub normal_n: f64,
    /// Shear force, newtons.
    pub shear_n: f64,
    /// Share of the contact that sticks; `None` without contact.
    pub stick_ratio: Option<f64>,
    /// The whole contact slides.
    pub gross_slip: bool,
    /// Distance slid since the contact began, mm.
    pub slip_mm: f64,
}

/// The keys of `/status` and their JSON types, for programs that plot them.
const STATUS_KEYS: [(&str, &str); 37] = [
    ("frame", "integer"),
    ("sensor", "integer"),
    ("t_s", "number"),
    ("gate", "string"),
    ("health", "array"),
    ("fn", "number"),
    ("fx", "number"),
    ("fy", "number"),
    ("ft", "number"),
    ("mz", "number"),
    ("cop_mm", "array"),
    ("load", "object"),
    ("contact", "integer"),
    ("stick", "integer"),
    ("stick_ratio", "number"),
    ("coulomb_slip", "boolean"),
    ("state", "string"),
    ("slip_evidence", "number"),
    ("witnesses", "object"),
    ("time_to_slip_ms", "integer"),
    ("line_n", "number"),
    ("latency_us", "number"),
    ("stages_us", "array"),
    ("faults", "array"),
    ("late", "string"),
    ("wire_bytes", "integer"),
    ("markers", "object"),
    ("truth", "object"),
    ("sequence", "integer"),
    ("capture_us", "integer"),
    ("begun_us", "integer"),
    ("until_us", "integer"),
    ("requested_mode", "string"),
    ("floor_lsb", "integer"),
    ("health_bits", "integer"),
    ("motion_bits", "integer"),
    ("wire", "object"),
];

/// The schema of `/status`.
pub(crate) fn status_schema() -> Vec<u8> {
    let properties: serde_json::Map<_, _> = STATUS_KEYS
        .iter()
        .map(|(key, kind)| {
            let items = if ["health", "faults"].contains(key) {
                "string"
            } else {
                "number"
            };
            let property = match *kind {
                "array" => serde_json::json!({"type": "array", "items": {"type": items}}),
                kind => serde_json::json!({"type": kind}),
            };
            ((*key).to_owned(), property)
        })
        .collect();
    serde_json::json!({"title": "gripline.Status", "type": "object", "properties": properties})
        .to_string()
        .into_bytes()
}

/// The body of a `/status` message.
///
/// # Errors
/// serde_json's, which a report without infinities does not meet.
pub(crate) fn status_bytes(frame: &Frame) -> Result<Vec<u8>, serde_json::Error> {
    serde_json::to_vec(&StatusOut {
        report: &frame.report,
        sequence: frame.sequence,
        capture_us: frame.capture_us,
        begun_us: frame.begun_us,
        until_us: frame.until_us,
        requested_mode: frame.requested_mode,
        floor_lsb: frame.floor_lsb,
        health_bits: frame.health_bits,
        motion_bits: frame.motion_bits,
        wire: &frame.wire,
    })
}
