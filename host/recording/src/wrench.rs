//! A force-torque sensor's log: CSV, or an MCAP file as rosbag2 and others record it, with `geometry_msgs/WrenchStamped` or `Wrench` in
//! CDR or JSON. Reads the forces; torques are passed over. Newtons, seconds.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::ErrorKind;
use std::path::Path;

use mcap::McapError;
use serde_json::Value;

use crate::error::RecordingError;
use crate::reader::messages_of;

/// What a file should be.
const EXPECTED: &str = "messages of geometry_msgs/WrenchStamped or Wrench, in CDR or JSON: record the force-torque sensor's topic";

/// Forces of one topic in order of time.
#[derive(Debug, Clone, PartialEq)]
pub struct WrenchLog {
    /// The topic.
    pub topic: String,
    /// Frame of the forces, as the messages name it; empty where they do not.
    pub frame: String,
    /// Nanoseconds since 1970 (the message's stamp, else when it was logged) and force along x, y, z, N.
    pub forces: Vec<(u64, [f64; 3])>,
}

/// A message.
#[derive(Debug, PartialEq)]
struct Sample {
    stamp_ns: Option<u64>,
    frame: String,
    force_n: [f64; 3],
}

impl WrenchLog {
    /// Reads a file; `topic` names one of several.
    ///
    /// # Errors
    /// [`RecordingError`] when the file cannot be read, has no forces, or has several topics of them and none is named.
    pub fn open(path: &Path, topic: Option<&str>) -> Result<Self, RecordingError> {
        let read_error = |error| RecordingError::Read {
            path: path.to_owned(),
            expected: "an MCAP file with a force-torque sensor's messages",
            error,
        };
        let content = |found: String, expected: &'static str| RecordingError::Content {
            path: path.to_owned(),
            found,
            expected,
        };
        let (mut topics, mut others) = (BTreeSet::new(), BTreeSet::new());
        let mut log = Self {
            topic: String::new(),
            frame: String::new(),
            forces: Vec::new(),
        };
        for message in messages_of(File::open(path).map_err(read_error)?) {
            let message = match message {
                Ok(message) => message,
                Err(McapError::Io(error)) if error.kind() != ErrorKind::UnexpectedEof => {
                    return Err(read_error(error));
                }
                Err(McapError::UnsupportedCompression(how)) => {
                    return Err(content(
                        format!("chunks compressed with {how}"),
                        "uncompressed ones: `mcap compress --compression none FILE -o OUT` makes them",
                    ));
                }
                // Cut short: what is there counts.
                Err(_) if !log.forces.is_empty() => break,
                Err(error) => return Err(content(error.to_string(), EXPECTED)),
            };
            let channel = &message.channel;
            let schema = channel.schema.as_ref().map_or("", |schema| schema.name.as_str());
            if !is_wrench(schema) {
                others.insert(format!("{} ({schema})", channel.topic));
                continue;
            }
            topics.insert(channel.topic.clone());
            if topic.is_some_and(|topic| topic != channel.topic) {
                continue;
            }
            let sample = match channel.message_encoding.as_str() {
                "cdr" => from_cdr(&message.data, schema.ends_with("Stamped")),
                "json" => from_json(&message.data),
                other => {
                    return Err(content(
                        format!("{} in {other}", channel.topic),
                        "CDR or JSON: convert the log",
                    ));
                }
            };
            let sample = sample.ok_or_else(|| {
                content(
                    format!("a message on {} that cannot be read", channel.topic),
                    EXPECTED,
                )
            })?;
            log.topic.clone_from(&channel.topic);
            log.frame = sample.frame;
            // A driver without a clock stamps zero.
            let ns = sample.stamp_ns.filter(|ns| *ns > 0).unwrap_or(message.log_time);
            log.forces.push((ns, sample.force_n));
        }
        let list = |names: BTreeSet<String>| names.into_iter().collect::<Vec<_>>().join(", ");
        if log.forces.is_empty() {
            let found = match (topic, topics.is_empty()) {
                (Some(topic), false) => format!("no forces on {topic}, but on {}", list(topics)),
                _ if others.is_empty() => "no messages".to_owned(),
                _ => format!("only {}", list(others)),
            };
            return Err(content(found, EXPECTED));
        }
        if topic.is_none() && topics.len() > 1 {
            return Err(content(
                format!("forces on several topics: {}", list(topics)),
                "one: name it with --forces-topic",
            ));
        }
        log.forces.sort_by_key(|(ns, _)| *ns);
        Ok(log)
    }
}

impl WrenchLog {
    /// The forces with their times from `start_ns` on, else from the first of them on, s.
    #[must_use]
    pub fn since(&self, start_ns: Option<u64>) -> Forces {
        let start_ns = start_ns.or_else(|| self.forces.first().map(|(ns, _)| *ns));
        let start_ns = i128::from(start_ns.unwrap_or_default());
        let seconds = |ns: u64| (i128::from(ns) - start_ns) as f64 * 1e-9;
        self.forces
            .iter()
            .map(|(ns, force)| (seconds(*ns), *force))
            .collect()
    }
}

/// Times, s, and forces along x, y, z, N.
pub type Forces = Vec<(f64, [f64; 3])>;

/// Columns of a CSV log.
const COLUMNS: [&str; 4] = ["time_s", "fx_n", "fy_n", "fz_n"];

/// A log of forces, s and N along x, y, z, in order of time: an MCAP file by its ending (`topic` names one of several), else a CSV file
/// with a line of names. Times of an MCAP file count from `start_ns` (since 1970) on, where it is known; those of a CSV file stand as
/// they are.
///
/// # Errors
/// [`RecordingError`] that names the file, and the line of a CSV file.
pub fn force_log(path: &Path, topic: Option<&str>, start_ns: Option<u64>) -> Result<Forces, RecordingError> {
    if path.extension().is_some_and(|extension| extension == "mcap") {
        return Ok(WrenchLog::open(path, topic)?.since(start_ns));
    }
    let text = std::fs::read_to_string(path).map_err(|error| RecordingError::Read {
        path: path.to_owned(),
        expected: "a CSV file with time_s, fx_n, fy_n, fz_n",
        error,
    })?;
    from_csv(&text).map_err(|(line, found)| RecordingError::Content {
        path: path.to_owned(),
        found: format!("{found} in line {line}"),
        expected: "numbers in the columns time_s, fx_n, fy_n, fz_n (seconds, newtons): rename or convert them",
    })
}

/// The lines of a CSV file; else the number of the wrong one, and what it has.
fn from_csv(text: &str) -> Result<Forces, (usize, String)> {
    let mut lines = text.lines().zip(1..).filter(|(line, _)| !line.trim().is_empty());
    let (head, number) = lines.next().unwrap_or(("", 1));
    let names: Vec<&str> = head.split(',').map(str::trim).collect();
    let mut places = [0; 4];
    for (place, name) in places.iter_mut().zip(COLUMNS) {
        *place = names
            .iter()
            .position(|found| *found == name)
            .ok_or_else(|| (number, format!("the columns {}", names.join(", "))))?;
    }
    let read = |(line, number): (&str, usize)| {
        let words: Vec<&str> = line.split(',').collect();
        let value = |at: usize| words.get(places[at])?.trim().parse::<f64>().ok();
        match [0, 1, 2, 3].map(value) {
            [Some(t), Some(x), Some(y), Some(z)] => Ok((t, [x, y, z])),
            _ => Err((number, line.to_owned())),
        }
    };
    lines.map(read).collect()
}

/// ROS 2 calls it geometry_msgs/msg/WrenchStamped, ROS 1 geometry_msgs/WrenchStamped.
fn is_wrench(schema: &str) -> bool {
    matches!(schema.rsplit(['/', '.']).next(), Some("WrenchStamped" | "Wrench"))
}

/// Reads the bytes of CDR one after the other.
struct Cdr<'a> {
    body: &'a [u8],
    at: usize,
    is_big: bool,
}

impl<'a> Cdr<'a> {
    fn new(bytes: &'a [u8]) -> Option<Self> {
        let (header, body) = bytes.split_at_checked(4)?;
        // Plain CDR: 0 big-endian, 1 little-endian.
        let is_big = match header[..2] {
            [0, 0] => true,
            [0, 1] => false,
            _ => return None,
        };
        Some(Self { body, at: 0, is_big })
    }

    /// A number, at a multiple of its size.
    fn number<const SIZE: usize>(&mut self) -> Option<[u8; SIZE]> {
        let from = self.at.next_multiple_of(SIZE);
        let mut bytes: [u8; SIZE] = self.body.get(from..from.checked_add(SIZE)?)?.try_into().ok()?;
        self.at = from + SIZE;
        if self.is_big {
            bytes.reverse();
        }
        Some(bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    fn f64(&mut self) -> Option<f64> {
        self.number()
            .map(f64::from_le_bytes)
            .filter(|value| value.is_finite())
    }

    /// Behind its length, with a zero at its end.
    fn text(&mut self) -> Option<&'a str> {
        let length = self.u32()? as usize;
        let bytes = self.body.get(self.at..self.at.checked_add(length)?)?;
        self.at += length;
        std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes)).ok()
    }
}

fn from_cdr(bytes: &[u8], is_stamped: bool) -> Option<Sample> {
    let mut cdr = Cdr::new(bytes)?;
    let (mut stamp_ns, mut frame) = (None, String::new());
    if is_stamped {
        let (seconds, nanoseconds) = (cdr.u32()?, cdr.u32()?);
        stamp_ns = Some(u64::from(seconds) * 1_000_000_000 + u64::from(nanoseconds));
        cdr.text()?.clone_into(&mut frame);
    }
    let force_n = [cdr.f64()?, cdr.f64()?, cdr.f64()?];
    Some(Sample {
        stamp_ns,
        frame,
        force_n,
    })
}

fn from_json(bytes: &[u8]) -> Option<Sample> {
    let message: Value = serde_json::from_slice(bytes).ok()?;
    let wrench = message.get("wrench").unwrap_or(&message);
    let force = wrench.get("force")?;
    let along = |axis: &str| force.get(axis)?.as_f64();
    let header = message.get("header");
    let stamp = header.and_then(|header| header.get("stamp"));
    let part = |names: [&str; 2]| {
        let found = names.iter().find_map(|name| stamp?.get(name));
        found.and_then(Value::as_u64)
    };
    let stamp_ns = part(["sec", "secs"])
        .zip(part(["nanosec", "nsecs"]))
        .map(|(seconds, nanoseconds)| seconds.saturating_mul(1_000_000_000).saturating_add(nanoseconds));
    let frame = header.and_then(|header| header.get("frame_id")?.as_str());
    Some(Sample {
        stamp_ns,
        frame: frame.unwrap_or_default().to_owned(),
        force_n: [along("x")?, along("y")?, along("z")?],
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::ros2::{Header, Time, Vector3, Wrench, WrenchStamped, to_cdr};

    /// A file of messages: topic, schema, encoding, bytes, logged at so many nanoseconds.
    fn file(messages: &[(&str, &str, &str, Vec<u8>, u64)]) -> tempfile::NamedTempFile {
        let to = tempfile::NamedTempFile::new().unwrap();
        let mut writer = mcap::WriteOptions::new()
            .compression(None)
            .create(std::io::BufWriter::new(to.reopen().unwrap()))
            .unwrap();
        for (sequence, (topic, schema, encoding, data, ns)) in messages.iter().enumerate() {
            let schema = writer.add_schema(schema, "ros2msg", b"").unwrap();
            let channel = writer
                .add_channel(schema, topic, encoding, &BTreeMap::new())
                .unwrap();
            let header = mcap::records::MessageHeader {
                channel_id: channel,
                sequence: sequence as u32,
                log_time: *ns,
                publish_time: *ns,
            };
            writer.write_to_known_channel(&header, data).unwrap();
        }
        writer.finish().unwrap();
        drop(writer);
        to
    }

    const STAMPED: &str = "geometry_msgs/msg/WrenchStamped";

    fn stamped(ns: u64, [x, y, z]: [f64; 3]) -> Vec<u8> {
        to_cdr(&WrenchStamped {
            header: Header {
                stamp: Time::from_ns(ns),
                frame_id: "scale".to_owned(),
            },
            wrench: Wrench {
                force: Vector3 { x, y, z },
                torque: Vector3::default(),
            },
        })
        .unwrap()
    }

    #[test]
    fn a_bag_s_forces_come_with_their_stamps_in_order_of_time() {
        let log = file(&[
            ("/clock", "rosgraph_msgs/msg/Clock", "cdr", vec![0, 1, 0, 0], 1),
            ("/ft", STAMPED, "cdr", stamped(2_000_000_005, [1.0, -2.0, 3.5]), 9),
            ("/ft", STAMPED, "cdr", stamped(1_500_000_000, [0.0, 0.0, 1.0]), 10),
            // Not stamped: the time of logging.
            ("/ft", STAMPED, "cdr", stamped(0, [0.0, 0.0, 2.0]), 1_700_000_000),
        ]);
        let read = WrenchLog::open(log.path(), None).unwrap();
        assert_eq!((read.topic.as_str(), read.frame.as_str()), ("/ft", "scale"));
        assert_eq!(
            read.forces,
            [
                (1_500_000_000, [0.0, 0.0, 1.0]),
                (1_700_000_000, [0.0, 0.0, 2.0]),
                (2_000_000_005, [1.0, -2.0, 3.5])
            ]
        );
    }

    #[test]
    fn wrenches_without_a_header_in_big_endian_and_in_json_are_read() {
        let mut big = vec![0, 0, 0, 0];
        for value in [1.5f64, 2.5, -3.5, 0.0, 0.0, 0.0] {
            big.extend(value.to_be_bytes());
        }
        let json = br#"{"header":{"stamp":{"sec":3,"nanosec":7},"frame_id":"f"},"wrench":{"force":{"x":1,"y":2,"z":3}}}"#;
        let log = file(&[
            ("/ft", "geometry_msgs/msg/Wrench", "cdr", big, 5),
            ("/ft", STAMPED, "json", json.to_vec(), 6),
        ]);
        let read = WrenchLog::open(log.path(), None).unwrap();
        assert_eq!(
            read.forces,
            [(5, [1.5, 2.5, -3.5]), (3_000_000_007, [1.0, 2.0, 3.0])]
        );
    }

    #[test]
    fn a_csv_is_read_by_its_names_and_a_wrong_line_is_reported_by_its_number() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let read = |text: &str| {
            std::fs::write(file.path(), text).unwrap();
            force_log(file.path(), None, Some(7))
        };
        let log = read("fz_n,time_s, fx_n,fy_n\n3,0.5,1,-2\n\n4,0.6,0,0\n").unwrap();
        assert_eq!(log, [(0.5, [1.0, -2.0, 3.0]), (0.6, [0.0, 0.0, 4.0])]);
        let said = |text: &str| read(text).unwrap_err().to_string();
        assert!(said("t,fx\n").contains("the columns t, fx in line 1"));
        assert!(said("time_s,fx_n,fy_n,fz_n\n0,0,0,0\n1,0,x,0\n").contains("1,0,x,0 in line 3"));
    }

    #[test]
    fn what_is_no_log_of_forces_is_refused_with_what_was_found() {
        let said = |file: &tempfile::NamedTempFile, topic| {
            WrenchLog::open(file.path(), topic).unwrap_err().to_string()
        };
        let none = file(&[("/imu", "sensor_msgs/msg/Imu", "cdr", vec![0, 1, 0, 0], 1)]);
        assert!(said(&none, None).contains("only /imu (sensor_msgs/msg/Imu)"));
        let two = file(&[
            ("/left", STAMPED, "cdr", stamped(1, [0.0; 3]), 1),
            ("/right", STAMPED, "cdr", stamped(1, [0.0; 3]), 1),
        ]);
        assert!(said(&two, None).contains("several topics: /left, /right"));
        assert!(said(&two, Some("/up")).contains("no forces on /up, but on /left, /right"));
        assert_eq!(WrenchLog::open(two.path(), Some("/left")).unwrap().topic, "/left");
        let short = file(&[("/ft", STAMPED, "cdr", stamped(1, [0.0; 3])[..40].to_vec(), 1)]);
        assert!(said(&short, None).contains("a message on /ft that cannot be read"));
        let proto = file(&[("/ft", "x.Wrench", "protobuf", vec![1], 1)]);
        assert!(said(&proto, None).contains("/ft in protobuf"));
        let text = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(text.path(), "time_s,fx_n\n").unwrap();
        assert!(!said(&text, None).is_empty());
    }
}
