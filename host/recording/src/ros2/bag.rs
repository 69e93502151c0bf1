//! A bag as rosbag2 has it: a folder with one MCAP file of profile ros2 and `metadata.yaml`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use gripline_protocol::SENSORS;
use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions, Writer};
use serde::Serialize;

use super::cdr::to_cdr;
use super::definitions::{DIAGNOSTIC_ARRAY, Definition, IMAGE, SLIP, WRENCH_STAMPED};
use super::messages::{DiagnosticArray, DiagnosticStatus, Header, Image, Time};
use super::names::Namespace;
use super::sample::{Sample, faults_status};
use crate::error::RecordingError;
use crate::image;

/// Where diagnostics of all programs go.
const DIAGNOSTICS: &str = "/diagnostics";
/// Interval of unchanged diagnostics, nanoseconds.
const DIAGNOSTICS_EVERY_NS: u64 = 1_000_000_000;
/// The QoS that a player offers: reliable.
const QOS: &str = "- history: 1\n  depth: 10\n  reliability: 1\n  durability: 2\n  deadline:\n    sec: 2147483647\n    nsec: \
                   4294967295\n  lifespan:\n    sec: 2147483647\n    nsec: 4294967295\n  liveliness: 1\n  \
                   liveliness_lease_duration:\n    sec: 2147483647\n    nsec: 4294967295\n  \
                   avoid_ros_namespace_conventions: false";

/// A topic of the bag.
struct Topic {
    channel: u16,
    name: String,
    definition: &'static str,
    messages: u64,
}

/// A bag being written.
pub struct Bag {
    folder: PathBuf,
    file_name: String,
    namespace: Namespace,
    writer: Writer<BufWriter<File>>,
    topics: Vec<Topic>,
    /// Time of the first message and of the last one, nanoseconds since 1970.
    span_ns: Option<(u64, u64)>,
    /// The last diagnostics, and when they were written.
    said: Option<(u64, Vec<DiagnosticStatus>)>,
    /// The newest of each fingertip.
    health: [Option<DiagnosticStatus>; SENSORS],
}

impl Bag {
    /// Begins a bag in a folder, which must not be there yet.
    ///
    /// # Errors
    /// [`RecordingError`] that names what cannot be written.
    pub fn create(folder: &Path, namespace: &Namespace) -> Result<Self, RecordingError> {
        fs::create_dir(folder).map_err(failed(folder))?;
        // As rosbag2 names it.
        let stem = folder
            .file_name()
            .map_or_else(|| "bag".to_owned(), |name| name.to_string_lossy().into_owned());
        let file_name = format!("{stem}_0.mcap");
        let path = folder.join(&file_name);
        let file = File::create_new(&path).map_err(failed(&path))?;
        let writer = WriteOptions::new()
            .compression(None)
            .profile("ros2")
            .library(concat!("gripline ", env!("CARGO_PKG_VERSION")))
            .create(BufWriter::new(file))
            .map_err(|error| failed(&path)(io::Error::other(error)))?;
        Ok(Self {
            folder: folder.to_owned(),
            file_name,
            namespace: namespace.clone(),
            writer,
            topics: Vec::new(),
            span_ns: None,
            said: None,
            health: [None, None],
        })
    }

    /// A frame, and its picture if there is one.
    ///
    /// # Errors
    /// [`RecordingError`] when it cannot be written.
    pub fn frame(&mut self, sample: &Sample, picture: Option<image::Image>) -> Result<(), RecordingError> {
        let namespace = self.namespace.clone();
        let (ns, fingertip) = (sample.captured_ns, sample.report.sensor);
        let topic = |name: &str| namespace.fingertip_topic(fingertip, name);
        if let Some(wrench) = sample.wrench(&namespace) {
            self.put(&topic("wrench"), &WRENCH_STAMPED, ns, &wrench)?;
        }
        if let Some(map) = sample.force_map(&namespace) {
            self.put(&topic("force_map"), &IMAGE, ns, &map)?;
        }
        self.put(&topic("slip"), &SLIP, ns, &sample.slip(&namespace))?;
        if let Some(picture) = picture {
            let (encoding, channels) = if picture.is_colour() {
                ("rgb8", 3)
            } else {
                ("mono8", 1)
            };
            let message = Image {
                header: sample.header(&namespace),
                height: picture.height as u32,
                width: picture.width as u32,
                encoding,
                is_bigendian: 0,
                step: channels * picture.width as u32,
                data: picture.pixels,
            };
            self.put(&topic("picture"), &IMAGE, ns, &message)?;
        }
        self.diagnostics(sample)
    }

    /// The gripper's diagnostics, on change and once a second.
    fn diagnostics(&mut self, sample: &Sample) -> Result<(), RecordingError> {
        let ns = sample.captured_ns;
        self.health[sample.report.sensor.index()] = Some(sample.health(&self.namespace));
        let faults: Vec<_> = sample
            .report
            .faults
            .iter()
            .map(|name| (*name, String::new()))
            .collect();
        let mut status = vec![faults_status(&self.namespace, &faults)];
        status.extend(self.health.iter().flatten().cloned());
        let is_news = self.said.as_ref().is_none_or(|(at_ns, said)| {
            ns.saturating_sub(*at_ns) >= DIAGNOSTICS_EVERY_NS || !is_the_same(said, &status)
        });
        if is_news {
            let message = DiagnosticArray {
                header: Header {
                    stamp: Time::from_ns(ns),
                    frame_id: String::new(),
                },
                status: status.clone(),
            };
            self.put(DIAGNOSTICS, &DIAGNOSTIC_ARRAY, ns, &message)?;
            self.said = Some((ns, status));
        }
        Ok(())
    }

    fn put(
        &mut self,
        name: &str,
        definition: &Definition,
        ns: u64,
        message: &impl Serialize,
    ) -> Result<(), RecordingError> {
        let path = self.folder.join(&self.file_name);
        let failed = |error| failed(&path)(io::Error::other(error));
        let place = self.topics.iter().position(|topic| topic.name == name);
        let place = match place {
            Some(place) => place,
            None => self.add_topic(name, definition).map_err(failed)?,
        };
        let topic = &mut self.topics[place];
        let bytes = to_cdr(message).map_err(|error| self::failed(&path)(io::Error::other(error)))?;
        let header = MessageHeader {
            channel_id: topic.channel,
            sequence: topic.messages as u32,
            log_time: ns,
            publish_time: ns,
        };
        self.writer
            .write_to_known_channel(&header, &bytes)
            .map_err(failed)?;
        topic.messages += 1;
        let (first, last) = self.span_ns.unwrap_or((ns, ns));
        self.span_ns = Some((first.min(ns), last.max(ns)));
        Ok(())
    }

    /// Adds a topic; returns its place.
    fn add_topic(&mut self, name: &str, definition: &Definition) -> Result<usize, McapError> {
        let schema = self
            .writer
            .add_schema(definition.name, "ros2msg", definition.text().as_bytes())?;
        let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), QOS.to_owned())]);
        self.topics.push(Topic {
            channel: self.writer.add_channel(schema, name, "cdr", &metadata)?,
            name: name.to_owned(),
            definition: definition.name,
            messages: 0,
        });
        Ok(self.topics.len() - 1)
    }

    /// Closes the file and writes rosbag2's metadata; returns the number of messages.
    ///
    /// # Errors
    /// [`RecordingError`] that names the file which cannot be written.
    pub fn finish(mut self) -> Result<u64, RecordingError> {
        let path = self.folder.join(&self.file_name);
        self.writer
            .finish()
            .map_err(|error| failed(&path)(io::Error::other(error)))?;
        let metadata = self.folder.join("metadata.yaml");
        fs::write(&metadata, self.metadata()).map_err(failed(&metadata))?;
        Ok(self.messages())
    }

    fn messages(&self) -> u64 {
        self.topics.iter().map(|topic| topic.messages).sum()
    }

    /// `metadata.yaml`, version 5, which every ROS 2 since Humble reads.
    fn metadata(&self) -> String {
        let (first, last) = self.span_ns.unwrap_or_default();
        let (messages, duration, file) = (self.messages(), last - first, &self.file_name);
        let mut text = format!(
            "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  duration:\n    nanoseconds: {duration}\n  \
             starting_time:\n    nanoseconds_since_epoch: {first}\n  message_count: {messages}\n  topics_with_message_count:\n"
        );
        let qos = QOS.replace('\n', "\\n");
        for Topic {
            name,
            definition,
            messages,
            ..
        } in &self.topics
        {
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "    - topic_metadata:\n        name: {name}\n        type: {definition}\n        serialization_format: cdr\n        \
                 offered_qos_profiles: \"{qos}\"\n      message_count: {messages}"
            );
        }
        let file = file.replace('\'', "''");
        let _ = writeln!(
            text,
            "  compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n    - '{file}'\n  files:\n    - path: \
             '{file}'\n      starting_time:\n        nanoseconds_since_epoch: {first}\n      duration:\n        nanoseconds: \
             {duration}\n      message_count: {messages}"
        );
        text
    }
}

/// Whether they are equal except for numbers that always change.
fn is_the_same(one: &[DiagnosticStatus], other: &[DiagnosticStatus]) -> bool {
    let says = |status: &DiagnosticStatus| (status.level, status.name.clone(), status.message.clone());
    one.iter().map(says).eq(other.iter().map(says))
}

fn failed(path: &Path) -> impl Fn(io::Error) -> RecordingError {
    move |error| RecordingError::Export {
        path: path.to_owned(),
        error,
    }
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::sample;
    use super::*;

    #[test]
    fn a_bag_says_its_topics_their_counts_and_its_span() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("it's a bag");
        let namespace = "cell_3/left".parse().unwrap();
        let mut bag = Bag::create(&path, &namespace).unwrap();
        let mut sample = sample();
        for frame in 0..4 {
            sample.report.frame = frame;
            sample.captured_ns += 16_000_000;
            // The third one shows a change.
            if frame == 2 {
                sample.report.faults.clear();
            }
            bag.frame(&sample, None).unwrap();
        }
        // Three messages a frame, and diagnostics at the first frame and at the change.
        assert_eq!(bag.finish().unwrap(), 4 * 3 + 2);
        let text = fs::read_to_string(path.join("metadata.yaml")).unwrap();
        for words in [
            "message_count: 14\n",
            "    nanoseconds: 48000000\n",
            "nanoseconds_since_epoch: 1700000000266000000\n",
            "name: /cell_3/left/fingertip_1/slip\n        type: gripline_msgs/msg/Slip\n",
            "- 'it''s a bag_0.mcap'",
        ] {
            assert!(text.contains(words), "{words} is missing in {text}");
        }
        let bytes = fs::read(path.join("it's a bag_0.mcap")).unwrap();
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        assert_eq!(summary.stats.unwrap().message_count, 14);
        assert!(Bag::create(&path, &namespace).is_err());
    }
}
