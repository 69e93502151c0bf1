//! The recording's file under way: messages in chunks that are written in one go and never touched again. A file that is cut
//! short therefore reads up to its last whole chunk.
//! The library keeps 0.3 kB of index per chunk until the end: 50 MB a day at two chunks a second.

use std::collections::BTreeMap;
use std::io::{Seek, Write};

use foxglove::Encode;
use foxglove::messages::{Grid, Log, RawImage};
use gripline_protocol::SENSORS;
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions, Writer};

use crate::event::{Event, events_between};
use crate::force_map::map_bytes;
use crate::image::{CROP_SIDE, Image, image_bytes};
use crate::metadata::Metadata;
use crate::status::{Frame, status_bytes, status_schema};
use crate::telemetry::FrameReport;
use crate::topics::{EVENTS, FORCE_MAP, PICTURE, REST, STATUS, topic_of};

/// A chunk is closed when it is larger: after ten full pictures. The writer keeps a buffer of this size.
const CHUNK_BYTES: u64 = 2 << 20;

/// Channels of a fingertip.
#[derive(Debug, Clone, Copy)]
struct FingertipChannels {
    rest: u16,
    picture: u16,
    force_map: u16,
}

/// Writes frames and events into an MCAP file.
pub(crate) struct RecordingWriter<W: Write> {
    writer: Writer<NoSeek<W>>,
    fingertips: Vec<FingertipChannels>,
    status: u16,
    events: u16,
    start_ns: u64,
    frames: u64,
    /// Frames that are in the file for certain: a chunk that could not be written is lost whole.
    pub kept: u64,
    /// The last frame, and the last one of each fingertip.
    last: Option<FrameReport>,
    last_of: [Option<FrameReport>; SENSORS],
}

impl<W: Write> RecordingWriter<W> {
    /// Begins a file for this number of fingertips in `out`; `start_ns` is the time of frame 0 since 1970.
    pub(crate) fn new(
        out: W,
        metadata: &Metadata,
        fingertips: usize,
        start_ns: u64,
    ) -> Result<Self, McapError> {
        // Without seeking chunks are put together in memory, and pipes can be written too.
        let mut writer = WriteOptions::new()
            .compression(None)
            .disable_seeking(true)
            .chunk_size(Some(CHUNK_BYTES))
            .calculate_data_section_crc(false)
            .library(concat!("gripline ", env!("CARGO_PKG_VERSION")))
            .create(NoSeek::new(out))?;
        let image = schema::<RawImage>(&mut writer)?;
        let grid = schema::<Grid>(&mut writer)?;
        let log = schema::<Log>(&mut writer)?;
        let report = writer.add_schema("gripline.Status", "jsonschema", &status_schema())?;
        let none = BTreeMap::new();
        let mut protobuf = |schema, topic: &str| writer.add_channel(schema, topic, "protobuf", &none);
        let fingertips = (0..fingertips).map(|sensor| {
            Ok(FingertipChannels {
                rest: protobuf(image, &topic_of(REST, sensor))?,
                picture: protobuf(image, &topic_of(PICTURE, sensor))?,
                force_map: protobuf(grid, &topic_of(FORCE_MAP, sensor))?,
            })
        });
        let fingertips = fingertips.collect::<Result<_, McapError>>()?;
        let events = protobuf(log, EVENTS)?;
        let status = writer.add_channel(report, STATUS, "json", &metadata.to_map())?;
        Ok(Self {
            writer,
            fingertips,
            status,
            events,
            start_ns,
            frames: 0,
            kept: 0,
            last: None,
            last_of: [None, None],
        })
    }

    /// A fingertip's pictures without contact.
    pub(crate) fn rest(&mut self, sensor: usize, crops: &[Vec<u8>]) -> Result<(), McapError> {
        for (number, crop) in crops.iter().enumerate() {
            let image = Image {
                side: CROP_SIDE,
                pixels: crop.clone(),
            };
            let bytes = image_bytes(&image, self.start_ns);
            self.put(self.fingertips[sensor].rest, number as u32, self.start_ns, &bytes)?;
        }
        Ok(())
    }

    fn time_ns(&self, t_s: f64) -> u64 {
        self.start_ns + (t_s * 1e9) as u64
    }

    /// Picture, map, events, and the status last: without it the frame does not count.
    pub(crate) fn frame(&mut self, frame: &Frame) -> Result<(), McapError> {
        let (ns, number) = (self.time_ns(frame.report.t_s), frame.sequence);
        let sensor = usize::from(frame.report.sensor);
        let channels = self.fingertips[sensor];
        if let Some(picture) = &frame.picture {
            self.put(channels.picture, number, ns, &image_bytes(picture, ns))?;
        }
        self.put(channels.force_map, number, ns, &map_bytes(&frame.map, ns))?;
        let last = (self.last.as_ref(), self.last_of[sensor].as_ref());
        for event in events_between(last, &frame.report) {
            self.event(frame.report.t_s, &event)?;
        }
        let status = status_bytes(frame).map_err(|error| McapError::Io(error.into()))?;
        self.put(self.status, number, ns, &status)?;
        self.last = Some(frame.report.clone());
        self.last_of[sensor] = Some(frame.report.clone());
        self.frames += 1;
        Ok(())
    }

    /// Something that a person wants to find again.
    pub(crate) fn event(&mut self, t_s: f64, event: &Event) -> Result<(), McapError> {
        let ns = self.time_ns(t_s);
        self.put(self.events, 0, ns, &event.bytes(ns))
    }

    fn put(&mut self, channel_id: u16, sequence: u32, ns: u64, bytes: &[u8]) -> Result<(), McapError> {
        let header = MessageHeader {
            channel_id,
            sequence,
            log_time: ns,
            publish_time: ns,
        };
        self.writer.write_to_known_channel(&header, bytes)
    }

    /// Closes the chunk and hands it to the system.
    pub(crate) fn flush(&mut self) -> Result<(), McapError> {
        self.writer.flush()?;
        self.kept = self.frames;
        Ok(())
    }

    /// Closes the file with its index.
    pub(crate) fn finish(&mut self) -> Result<(), McapError> {
        self.flush()?;
        self.writer.finish().map(|_| ())
    }
}

fn schema<T: Encode>(writer: &mut Writer<impl Write + Seek>) -> Result<u16, McapError> {
    match T::get_schema() {
        Some(schema) => writer.add_schema(&schema.name, &schema.encoding, &schema.data),
        None => Ok(0),
    }
}

#[cfg(test)]
mod tests {
    use mcap::Summary;
    use mcap::records::MessageIndexEntry;

    use super::*;

    #[test]
    fn the_index_finds_every_message_even_where_the_file_cannot_be_read_again() {
        let mut bytes = Vec::new();
        let mut writer = RecordingWriter::new(&mut bytes, &Metadata::default(), 1, 1_000).unwrap();
        writer.rest(0, &[vec![7; 440 * 440]]).unwrap();
        let mut events = 0;
        for chunk in 0..600 {
            for _ in 0..chunk % 3 {
                let event = Event::info(format!("event {events}"));
                writer.event(f64::from(chunk) / 4.0, &event).unwrap();
                events += 1;
            }
            writer.flush().unwrap();
        }
        writer.finish().unwrap();
        drop(writer);

        // In the order of the file, by the library's own reader.
        let linear: Vec<_> = mcap::MessageStream::new(&bytes)
            .unwrap()
            .map(Result::unwrap)
            .collect();
        assert_eq!(linear.len() as u64, 1 + events);

        let summary = Summary::read(&bytes).unwrap().expect("it has a summary");
        let statistics = summary.stats.as_ref().unwrap();
        assert_eq!(statistics.message_count, 1 + events);
        assert_eq!(statistics.chunk_count as usize, summary.chunk_indexes.len());
        let topics: Vec<_> = summary
            .channels
            .values()
            .map(|channel| channel.topic.as_str())
            .collect();
        for topic in [REST, PICTURE, FORCE_MAP, STATUS, EVENTS] {
            assert!(topics.contains(&topic), "{topic} is missing");
        }
        // By the index, chunk by chunk.
        let mut found = Vec::new();
        for chunk in &summary.chunk_indexes {
            let mut entries: Vec<MessageIndexEntry> = summary
                .read_message_indexes(&bytes, chunk)
                .unwrap()
                .into_values()
                .flatten()
                .collect();
            entries.sort_by_key(|entry| entry.offset);
            for entry in entries {
                found.push(summary.seek_message(&bytes, chunk, &entry).unwrap());
            }
        }
        assert_eq!(found.len(), linear.len());
        for (one, other) in found.iter().zip(&linear) {
            assert_eq!((one.log_time, &one.data), (other.log_time, &other.data));
            assert_eq!(one.channel.topic, other.channel.topic);
        }
    }
}
