//! Types by name and definition, as a bag stores them: each message with the types that it contains. Pure.

/// A message's type.
pub(super) struct Definition {
    /// Its name.
    pub name: &'static str,
    /// Its fields.
    fields: &'static str,
    /// The types that it contains.
    parts: &'static [Part],
}

/// A type inside of another: name and fields.
type Part = (&'static str, &'static str);

const TIME: Part = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");
const HEADER: Part = (
    "std_msgs/Header",
    "builtin_interfaces/Time stamp\nstring frame_id\n",
);
const VECTOR3: Part = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n");
const WRENCH: Part = (
    "geometry_msgs/Wrench",
    "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
);
const KEY_VALUE: Part = ("diagnostic_msgs/KeyValue", "string key\nstring value\n");
const DIAGNOSTIC_STATUS: Part = (
    "diagnostic_msgs/DiagnosticStatus",
    "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\nstring message\nstring hardware_id\n\
     diagnostic_msgs/KeyValue[] values\n",
);

/// Force and torque of a fingertip.
pub(super) const WRENCH_STAMPED: Definition = Definition {
    name: "geometry_msgs/msg/WrenchStamped",
    fields: "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n",
    parts: &[HEADER, TIME, WRENCH, VECTOR3],
};
/// A force map or a picture.
pub(super) const IMAGE: Definition = Definition {
    name: "sensor_msgs/msg/Image",
    fields: "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n",
    parts: &[HEADER, TIME],
};
/// Slip state of a fingertip.
pub(super) const SLIP: Definition = Definition {
    name: "gripline_msgs/msg/Slip",
    fields: include_str!("../../../ros2/gripline_msgs/msg/Slip.msg"),
    parts: &[HEADER, TIME],
};
/// State of the gripper.
pub(super) const DIAGNOSTIC_ARRAY: Definition = Definition {
    name: "diagnostic_msgs/msg/DiagnosticArray",
    fields: "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n",
    parts: &[HEADER, TIME, DIAGNOSTIC_STATUS, KEY_VALUE],
};

impl Definition {
    /// As text: its fields, then each part behind a line that names it.
    pub(super) fn text(&self) -> String {
        let line = "=".repeat(80);
        self.parts
            .iter()
            .fold(self.fields.to_owned(), |text, (name, fields)| {
                format!("{text}{line}\nMSG: {name}\n{fields}")
            })
    }
}
