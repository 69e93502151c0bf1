//! What a recording holds, as messages and back. Pure.
//! Forces travel as newtons in f32, which holds the wire's 1/4096 N exactly, so that maps read back bit by bit.

use std::borrow::Cow;
use std::collections::BTreeMap;

use foxglove::bytes::Bytes;
use foxglove::messages::log::Level;
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    Grid, Log, PackedElementField, Pose, Quaternion, RawImage, Timestamp, Vector2, Vector3,
};
use foxglove::{Decode, Encode};
use gripline_protocol::constants::TAXEL_PITCH_MM;
use gripline_protocol::message::{GripMode, Status};
use gripline_protocol::{ForceMap, LSB_PER_NEWTON, TAXELS, TaxelForce};
use serde::{Deserialize, Serialize};

use crate::telemetry::FrameReport;
use crate::{CROP_SIDE, IMAGE_SIDE};

/// Topic of the pictures without contact, before anything else.
pub(crate) const REST: &str = "/rest";
/// Topic of the camera's pictures.
pub(crate) const PICTURE: &str = "/picture";
/// Topic of the force maps.
pub(crate) const FORCE_MAP: &str = "/force_map";
/// Topic of the frames' reports; a frame is whole when its status is there.
pub(crate) const STATUS: &str = "/status";
/// Topic of what a person wants to find again.
pub(crate) const EVENTS: &str = "/events";

/// Before a topic of the second fingertip.
const SECOND: &str = "/second";

/// A fingertip's topic of this name.
pub(crate) fn topic_of(topic: &'static str, sensor: usize) -> Cow<'static, str> {
    match sensor {
        0 => topic.into(),
        _ => format!("{SECOND}{topic}").into(),
    }
}

/// A topic's name without the fingertip, and which one it is of.
pub(crate) fn fingertip_of(topic: &str) -> (&str, usize) {
    match topic.strip_prefix(SECOND) {
        Some(name) => (name, 1),
        None => (topic, 0),
    }
}

/// Columns and rows of a force map.
const SIDE: usize = 20;
/// Three f32 a taxel.
const CELL_BYTES: usize = 12;
/// The coordinate frame of pictures and maps.
const FRAME: &str = "fingertip";

/// What holds for a whole recording.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct About {
    /// Version of this program.
    pub gripline: String,
    /// The link and what answered on it.
    pub mcu: String,
    /// The firmware.
    pub firmware: String,
    /// The network's architecture.
    pub network: String,
    /// How its weights came to be.
    pub weights: String,
    /// What it makes of a test picture, as a number: other weights make something else.
    pub fingerprint: String,
    /// Weights file, empty for the built-in ones.
    pub weights_file: String,
    /// Vector instructions that the network used.
    pub instructions: String,
    /// Scene gate.
    pub gate: String,
    /// Frames a second.
    pub frames_per_second: String,
    /// The microcontroller's settings, as `gripline config mcu` prints them.
    pub settings: String,
}

impl About {
    /// As a channel's metadata.
    pub fn to_metadata(&self) -> BTreeMap<String, String> {
        let value = serde_json::to_value(self).and_then(serde_json::from_value);
        value.unwrap_or_default()
    }

    /// From a channel's metadata; `None` when it is not from this program.
    pub fn from_metadata(metadata: &BTreeMap<String, String>) -> Option<Self> {
        serde_json::to_value(metadata)
            .and_then(serde_json::from_value)
            .ok()
    }
}

/// One frame, as it is handed to the recorder.
#[derive(Debug, Clone)]
pub struct Frame {
    /// What the view and `--json` got.
    pub report: FrameReport,
    /// Number of the map.
    pub sequence: u32,
    /// Capture time that travelled with the map.
    pub capture_us: u32,
    /// When the turn began, on the link's clock.
    pub begun_us: u32,
    /// The link worked until then, after frame 0.
    pub until_us: u64,
    /// What the gripper was told.
    pub wish: GripMode,
    /// [`gripline_protocol::Health`] of the map.
    pub health_bits: u8,
    /// The microcontroller's newest status.
    pub wire: Status,
    /// The map as it travelled.
    pub map: Box<ForceMap>,
    /// The picture, as much of it as is to be recorded.
    pub picture: Option<Image>,
}

/// A square grey picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Columns and rows.
    pub side: usize,
    /// Grey levels, row-major.
    pub pixels: Vec<u8>,
}

impl Image {
    /// The crop that the pipeline takes: a small picture is enlarged, whose block means are itself again.
    pub fn into_crop(self) -> Vec<u8> {
        if self.side == CROP_SIDE {
            return self.pixels;
        }
        let block = CROP_SIDE / IMAGE_SIDE;
        (0..CROP_SIDE * CROP_SIDE)
            .map(|i| self.pixels[i / CROP_SIDE / block * IMAGE_SIDE + i % CROP_SIDE / block])
            .collect()
    }
}

#[derive(Serialize)]
struct StatusOut<'a> {
    #[serde(flatten)]
    report: &'a FrameReport,
    sequence: u32,
    capture_us: u32,
    begun_us: u32,
    until_us: u64,
    wish: GripMode,
    health_bits: u8,
    wire: &'a Status,
}

/// A frame's status as it is read back.
#[derive(Debug, Clone, Deserialize)]
pub struct Stored {
    /// Number of the frame, from 0.
    pub frame: u64,
    /// Recordings of before there could be two do not say.
    #[serde(default)]
    pub sensor: u8,
    /// Time of the picture since start.
    pub t_s: f64,
    /// What the scene gate decided.
    pub gate: String,
    /// What is known against the picture.
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
    /// Recordings of before nothing could be late do not say.
    #[serde(default)]
    pub late: Option<String>,
    /// What the simulated world knew.
    pub truth: Option<StoredTruth>,
    /// Number of the map.
    pub sequence: u32,
    /// When the picture was taken, on the link's clock.
    pub capture_us: u32,
    /// In older recordings pictures count as taken when the turn began.
    #[serde(default)]
    pub begun_us: Option<u32>,
    /// Time up to which the link worked for this frame, after frame 0.
    pub until_us: u64,
    /// What was wanted of the gripper.
    pub wish: GripMode,
    /// [`gripline_protocol::Health`] of the map, as bits.
    pub health_bits: u8,
    /// The device's status in the wire's units.
    pub wire: Status,
}

/// What the simulated world knew about a frame.
#[derive(Debug, Clone, Deserialize)]
pub struct StoredTruth {
    pub phase: String,
    pub normal_n: f64,
    pub shear_n: f64,
    pub stick_ratio: Option<f64>,
    pub gross_slip: bool,
    pub slip_mm: f64,
}

/// The keys of `/status` and their JSON types, for programs that plot them.
const STATUS_KEYS: [(&str, &str); 32] = [
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
    ("time_to_slip_ms", "integer"),
    ("line_n", "number"),
    ("latency_us", "number"),
    ("stages_us", "array"),
    ("faults", "array"),
    ("late", "string"),
    ("wire_bytes", "integer"),
    ("truth", "object"),
    ("sequence", "integer"),
    ("capture_us", "integer"),
    ("begun_us", "integer"),
    ("until_us", "integer"),
    ("wish", "string"),
    ("health_bits", "integer"),
    ("wire", "object"),
];

/// The schema of `/status`.
pub(crate) fn status_schema() -> Vec<u8> {
    let properties: serde_json::Map<_, _> = STATUS_KEYS
        .iter()
        .map(|(key, kind)| match *kind {
            "array" if *key == "health" || *key == "faults" => (
                (*key).to_owned(),
                serde_json::json!({"type": "array", "items": {"type": "string"}}),
            ),
            "array" => (
                (*key).to_owned(),
                serde_json::json!({"type": "array", "items": {"type": "number"}}),
            ),
            _ => ((*key).to_owned(), serde_json::json!({"type": kind})),
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
        wish: frame.wish,
        health_bits: frame.health_bits,
        wire: &frame.wire,
    })
}

/// A time after 1970 as Foxglove's messages have it.
fn timestamp(ns: u64) -> Timestamp {
    Timestamp::new((ns / 1_000_000_000) as u32, (ns % 1_000_000_000) as u32)
}

/// The body of a picture's message.
pub(crate) fn image_bytes(image: &Image, ns: u64) -> Vec<u8> {
    encoded(&RawImage {
        timestamp: Some(timestamp(ns)),
        frame_id: FRAME.to_owned(),
        width: image.side as u32,
        height: image.side as u32,
        encoding: "mono8".to_owned(),
        step: image.side as u32,
        data: Bytes::copy_from_slice(&image.pixels),
    })
}

/// The picture of a message, when it is one of ours.
pub(crate) fn image_of(bytes: &[u8]) -> Option<Image> {
    let image = RawImage::decode(bytes).ok()?;
    let side = image.width as usize;
    let known = [CROP_SIDE, IMAGE_SIDE].contains(&side) && image.height == image.width;
    (known && image.data.len() == side * side).then(|| Image {
        side,
        pixels: image.data.to_vec(),
    })
}

/// The body of a map's message.
pub(crate) fn map_bytes(map: &ForceMap, ns: u64) -> Vec<u8> {
    let field = |(name, offset): (&str, u32)| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: NumericType::Float32 as i32,
    };
    let pitch_m = TAXEL_PITCH_MM / 1e3;
    let corner_m = -pitch_m * SIDE as f64 / 2.0;
    let newtons = map.dequantise();
    encoded(&Grid {
        timestamp: Some(timestamp(ns)),
        frame_id: FRAME.to_owned(),
        pose: Some(Pose {
            position: Some(Vector3 {
                x: corner_m,
                y: corner_m,
                z: 0.0,
            }),
            orientation: Some(Quaternion {
                x: 0.0,
                y: 0.0,
                z: 0.0,
                w: 1.0,
            }),
        }),
        column_count: SIDE as u32,
        cell_size: Some(Vector2 {
            x: pitch_m,
            y: pitch_m,
        }),
        row_stride: (SIDE * CELL_BYTES) as u32,
        cell_stride: CELL_BYTES as u32,
        fields: [("fx", 0), ("fy", 4), ("fz", 8)].map(field).to_vec(),
        data: newtons
            .iter()
            .flatten()
            .flat_map(|force| force.to_le_bytes())
            .collect(),
    })
}

/// The map of a message, when it is one of ours.
pub(crate) fn map_of(bytes: &[u8]) -> Option<Box<ForceMap>> {
    let grid = Grid::decode(bytes).ok()?;
    if grid.data.len() != TAXELS * CELL_BYTES {
        return None;
    }
    let mut map = Box::new(ForceMap::EMPTY);
    for (taxel, cell) in map.taxels.iter_mut().zip(grid.data.chunks_exact(CELL_BYTES)) {
        let component = |place: usize| {
            let bytes = cell.get(4 * place..4 * place + 4)?.try_into().ok()?;
            Some((f32::from_le_bytes(bytes) * LSB_PER_NEWTON as f32).round() as i16)
        };
        *taxel = TaxelForce {
            x: component(0)?,
            y: component(1)?,
            z: component(2)?,
        };
    }
    Some(map)
}

/// An event worth finding again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Event {
    /// How bad it is.
    pub level: Level,
    /// What happened.
    pub message: String,
}

impl Event {
    /// Something to know.
    pub(crate) fn info(message: impl Into<String>) -> Self {
        Self {
            level: Level::Info,
            message: message.into(),
        }
    }

    /// Something to look at.
    pub(crate) fn warning(message: impl Into<String>) -> Self {
        Self {
            level: Level::Warning,
            message: message.into(),
        }
    }

    /// The body of its message.
    pub(crate) fn bytes(&self, ns: u64) -> Vec<u8> {
        encoded(&Log {
            timestamp: Some(timestamp(ns)),
            level: self.level as i32,
            message: self.message.clone(),
            name: "gripline".to_owned(),
            file: String::new(),
            line: 0,
        })
    }
}

/// What changed from one frame to the next: of the gripper since the last one, of the picture since the fingertip's last.
pub(crate) fn events_between(
    (last, last_of_it): (Option<&FrameReport>, Option<&FrameReport>),
    now: &FrameReport,
) -> Vec<Event> {
    let none = Vec::new();
    let (faults, state) = last.map_or((&none, "NO_CONTACT"), |last| (&last.faults, last.state));
    let health = last_of_it.map_or(&none, |last| &last.health);
    let mut events = Vec::new();
    if now.state != state {
        let text = format!("{state} to {}", now.state);
        events.push(if now.state == "SLIP" {
            Event::warning(text)
        } else {
            Event::info(text)
        });
    }
    let appeared = |now: &[&'static str], before: &[&'static str], what: &str| -> Vec<Event> {
        let new = now.iter().filter(|name| !before.contains(name));
        new.map(|name| Event::warning(format!("{what} {name}"))).collect()
    };
    events.extend(appeared(&now.faults, faults, "fault"));
    let picture = if now.sensor == 0 {
        "picture"
    } else {
        "second fingertip's picture"
    };
    events.extend(appeared(&now.health, health, picture));
    let gone = faults.iter().filter(|name| !now.faults.contains(name));
    events.extend(gone.map(|name| Event::info(format!("fault {name} is gone"))));
    events
}

/// Protocol buffers; a vector always has room.
fn encoded(message: &impl Encode) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(message.encoded_len().unwrap_or_default());
    // The only error is a buffer that is full, and a vector grows.
    let _ = message.encode(&mut bytes);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_map_reads_back_bit_by_bit(values in proptest::collection::vec(any::<i16>(), 3 * TAXELS)) {
            let mut map = ForceMap::EMPTY;
            for (taxel, value) in map.taxels.iter_mut().zip(values.chunks(3)) {
                *taxel = TaxelForce { x: value[0], y: value[1], z: value[2] };
            }
            prop_assert_eq!(*map_of(&map_bytes(&map, 5)).unwrap(), map);
        }
    }

    #[test]
    fn a_picture_reads_back_and_another_size_is_none_of_ours() {
        let image = Image {
            side: IMAGE_SIDE,
            pixels: (0..IMAGE_SIDE * IMAGE_SIDE).map(|i| i as u8).collect(),
        };
        assert_eq!(image_of(&image_bytes(&image, 7)), Some(image.clone()));
        let odd = Image {
            side: 100,
            pixels: vec![0; 10_000],
        };
        assert_eq!(image_of(&image_bytes(&odd, 7)), None);
        let crop = image.clone().into_crop();
        // Every pixel has become a block of 5×5.
        for (place, pixel) in crop.iter().enumerate() {
            let (row, column) = (place / CROP_SIDE / 5, place % CROP_SIDE / 5);
            assert_eq!(*pixel, image.pixels[row * IMAGE_SIDE + column]);
        }
    }

    #[test]
    fn what_holds_for_a_recording_reads_back_from_its_metadata() {
        let about = About {
            gate: "network".to_owned(),
            settings: "friction = 0.4\n".to_owned(),
            ..About::default()
        };
        assert_eq!(About::from_metadata(&about.to_metadata()), Some(about));
        assert_eq!(About::from_metadata(&BTreeMap::new()), None);
    }
}
