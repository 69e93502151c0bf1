//! The channels of a run, and the messages of a frame: the same in a recording and for live viewers. Pure.

use std::borrow::Cow;
use std::collections::BTreeMap;

use foxglove::messages::{Grid, Log, RawImage};
use foxglove::{Encode, Schema};
use gripline_protocol::SENSORS;

use crate::event::{Event, events_between};
use crate::force_map::map_bytes;
use crate::image::{Image, image_bytes};
use crate::metadata::Metadata;
use crate::status::{Frame, status_bytes, status_schema};
use crate::telemetry::FrameReport;
use crate::topics::{EVENTS, FORCE_MAP, PICTURE, REST, STATUS, topic_of};

/// Channels of each fingertip; those of the gripper come after them.
const OF_A_FINGERTIP: [&str; 3] = [REST, PICTURE, FORCE_MAP];

/// A channel's topic, encoding and schema.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Its topic.
    pub topic: Cow<'static, str>,
    /// Encoding of its messages.
    pub message_encoding: &'static str,
    /// Their schema.
    pub schema: Option<Schema>,
    /// Metadata of the whole run.
    pub metadata: BTreeMap<String, String>,
}

/// A message of one of the channels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// Place of its channel in [`Channels::list`].
    pub channel: usize,
    /// Number of the map; 0 for events.
    pub sequence: u32,
    /// Its time since 1970, ns.
    pub time_ns: u64,
    /// Its body.
    pub bytes: Vec<u8>,
}

/// Converts the frames of a run to messages.
#[derive(Debug)]
pub struct Channels {
    list: Vec<Channel>,
    start_ns: u64,
    /// The last frame, and the last one of each fingertip.
    last: Option<FrameReport>,
    last_of: [Option<FrameReport>; SENSORS],
}

impl Channels {
    /// For a run with this number of fingertips; `start_ns` is the time of frame 0 since 1970.
    #[must_use]
    pub fn new(fingertips: usize, metadata: &Metadata, start_ns: u64) -> Self {
        let mut list = Vec::new();
        for sensor in 0..fingertips {
            let topics = OF_A_FINGERTIP.map(|topic| topic_of(topic, sensor));
            let schemas = [RawImage::get_schema(), RawImage::get_schema(), Grid::get_schema()];
            list.extend(
                topics
                    .into_iter()
                    .zip(schemas)
                    .map(|(topic, schema)| protobuf(topic, schema)),
            );
        }
        list.push(protobuf(EVENTS.into(), Log::get_schema()));
        list.push(Channel {
            topic: STATUS.into(),
            message_encoding: "json",
            schema: Some(Schema::new("gripline.Status", "jsonschema", status_schema())),
            metadata: metadata.to_map(),
        });
        Self {
            list,
            start_ns,
            last: None,
            last_of: [None, None],
        }
    }

    /// All of them.
    #[must_use]
    pub fn list(&self) -> &[Channel] {
        &self.list
    }

    /// Place of a fingertip's pictures in the list.
    #[must_use]
    pub const fn picture(sensor: usize) -> usize {
        sensor * OF_A_FINGERTIP.len() + 1
    }

    const fn events(&self) -> usize {
        self.list.len() - 2
    }

    const fn status(&self) -> usize {
        self.list.len() - 1
    }

    fn time_ns(&self, t_s: f64) -> u64 {
        self.start_ns + (t_s * 1e9) as u64
    }

    /// A fingertip's pictures without contact.
    pub fn rest<'a>(&self, sensor: usize, pictures: &'a [Image]) -> impl Iterator<Item = Message> + use<'a> {
        let time_ns = self.start_ns;
        pictures.iter().zip(0..).map(move |(image, sequence)| Message {
            channel: sensor * OF_A_FINGERTIP.len(),
            sequence,
            time_ns,
            bytes: image_bytes(image, time_ns),
        })
    }

    /// Picture, map, events, and the status last: without it the frame does not count.
    ///
    /// # Errors
    /// serde_json's error, which cannot occur without infinities.
    pub fn frame(&mut self, frame: &Frame) -> Result<Vec<Message>, serde_json::Error> {
        let time_ns = self.time_ns(frame.report.t_s);
        let sensor = frame.report.sensor.index();
        let message = |channel, bytes| Message {
            channel,
            sequence: frame.sequence,
            time_ns,
            bytes,
        };
        let picture = Self::picture(sensor);
        let mut messages = Vec::with_capacity(4);
        if let Some(image) = &frame.picture {
            messages.push(message(picture, image_bytes(image, time_ns)));
        }
        messages.push(message(
            picture + 1,
            map_bytes(&frame.map, frame.pitch_um, time_ns),
        ));
        let last = (self.last.as_ref(), self.last_of[sensor].as_ref());
        let events = events_between(last, &frame.report);
        messages.extend(events.iter().map(|event| self.event(frame.report.t_s, event)));
        messages.push(message(self.status(), status_bytes(frame)?));
        self.last = Some(frame.report.clone());
        self.last_of[sensor] = Some(frame.report.clone());
        Ok(messages)
    }

    /// Something that a person wants to find again.
    pub(crate) fn event(&self, t_s: f64, event: &Event) -> Message {
        let time_ns = self.time_ns(t_s);
        Message {
            channel: self.events(),
            sequence: 0,
            time_ns,
            bytes: event.bytes(time_ns),
        }
    }

    /// A log line between the frames.
    #[must_use]
    pub fn note(&self, t_s: f64, text: &str) -> Message {
        self.event(t_s, &Event::warning(text))
    }
}

fn protobuf(topic: Cow<'static, str>, schema: Option<Schema>) -> Channel {
    Channel {
        topic,
        message_encoding: "protobuf",
        schema,
        metadata: BTreeMap::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_fingertip_has_its_channels_and_pictures_stand_where_they_are_said_to() {
        let channels = Channels::new(2, &Metadata::default(), 0);
        let topics: Vec<_> = channels.list().iter().map(|channel| &*channel.topic).collect();
        assert_eq!(
            topics,
            [
                "/rest",
                "/picture",
                "/force_map",
                "/second/rest",
                "/second/picture",
                "/second/force_map",
                "/events",
                "/status"
            ]
        );
        for (sensor, topic) in [(0, "/picture"), (1, "/second/picture")] {
            assert_eq!(topics[Channels::picture(sensor)], topic);
        }
        assert_eq!(
            (topics[channels.events()], topics[channels.status()]),
            (EVENTS, STATUS)
        );
        assert!(channels.list().iter().all(|channel| channel.schema.is_some()));
    }
}
