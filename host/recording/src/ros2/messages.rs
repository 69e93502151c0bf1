//! The messages, field by field in the order in which they are written. Units as in ROS: metres, newtons, seconds.

use serde::Serialize;

/// `builtin_interfaces/Time`: since 1970.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Time {
    /// Whole seconds.
    pub sec: i32,
    /// The rest, nanoseconds.
    pub nanosec: u32,
}

impl Time {
    /// From nanoseconds since 1970; ROS 2 has no time after 2038; the last possible one is used.
    #[must_use]
    pub fn from_ns(ns: u64) -> Self {
        Self {
            sec: i32::try_from(ns / 1_000_000_000).unwrap_or(i32::MAX),
            nanosec: (ns % 1_000_000_000) as u32,
        }
    }
}

/// `std_msgs/Header`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct Header {
    /// When the picture was taken.
    pub stamp: Time,
    /// The coordinate frame.
    pub frame_id: String,
}

/// `geometry_msgs/Vector3`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Vector3 {
    /// To the right.
    pub x: f64,
    /// Up.
    pub y: f64,
    /// Out of the skin.
    pub z: f64,
}

/// `geometry_msgs/Wrench`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Wrench {
    /// Force of the object on the fingertip, newtons.
    pub force: Vector3,
    /// Its torque about the frame's origin, newton-metres.
    pub torque: Vector3,
}

/// `geometry_msgs/WrenchStamped`.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct WrenchStamped {
    /// Capture time and fingertip.
    pub header: Header,
    /// Force and torque of the object on the fingertip.
    pub wrench: Wrench,
}

/// `sensor_msgs/Image`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct Image {
    /// Capture time and fingertip.
    pub header: Header,
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// Encoding of a pixel.
    pub encoding: &'static str,
    /// Byte order of its numbers: 0 is little-endian.
    pub is_bigendian: u8,
    /// Bytes in a row.
    pub step: u32,
    /// Row after row.
    pub data: Vec<u8>,
}

/// Slip states, in the order of their numbers in `gripline_msgs/Slip`.
pub const SLIP_STATES: [&str; 4] = ["NO_CONTACT", "STICK", "INCIPIENT", "SLIP"];

/// `gripline_msgs/Slip`: `msg/Slip.msg` says what its fields are.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[expect(missing_docs, reason = "host/ros2/gripline_msgs/msg/Slip.msg has them")]
pub struct Slip {
    pub header: Header,
    pub fingertip: u8,
    pub frame: u64,
    pub state: u8,
    pub slip_evidence: f64,
    pub stick_ratio: f64,
    pub contact: u16,
    pub stick: u16,
    pub witness_stick_ratio: f64,
    pub witness_unrest: f64,
    pub witness_shear_follows: f64,
    pub witness_motion: f64,
    pub time_to_slip: f64,
    pub line: f64,
    pub health: Vec<String>,
    pub faults: Vec<String>,
}

/// `diagnostic_msgs/KeyValue`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct KeyValue {
    /// What.
    pub key: String,
    /// Its value as text.
    pub value: String,
}

/// How bad a status is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, PartialOrd, Ord)]
pub enum Level {
    /// All is well.
    #[default]
    Ok,
    /// A person should look at it.
    Warning,
    /// It does not work.
    Error,
    /// No recent news of it.
    Stale,
}

impl Serialize for Level {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u8(*self as u8)
    }
}

/// `diagnostic_msgs/DiagnosticStatus`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct DiagnosticStatus {
    /// How bad it is.
    pub level: Level,
    /// Gripper and part.
    pub name: String,
    /// How it is.
    pub message: String,
    /// Which device.
    pub hardware_id: String,
    /// Details.
    pub values: Vec<KeyValue>,
}

impl DiagnosticStatus {
    /// A status with its details.
    pub fn new<'a>(
        name: String,
        (level, message): (Level, impl Into<String>),
        hardware_id: &str,
        values: impl IntoIterator<Item = (&'a str, String)>,
    ) -> Self {
        let pair = |(key, value): (&str, String)| KeyValue {
            key: key.to_owned(),
            value,
        };
        Self {
            level,
            name,
            message: message.into(),
            hardware_id: hardware_id.to_owned(),
            values: values.into_iter().map(pair).collect(),
        }
    }
}

/// `diagnostic_msgs/DiagnosticArray`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct DiagnosticArray {
    /// When it was said; no frame.
    pub header: Header,
    /// Part by part.
    pub status: Vec<DiagnosticStatus>,
}
