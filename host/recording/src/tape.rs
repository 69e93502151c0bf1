//! The inside of a recording's file: messages in chunks, written one after the other and never touched again.
//!
//! The library's writer keeps an index of every chunk until its end. It is therefore replaced by a fresh one every
//! [`SEGMENT`] flushes, whose file header is left out, and the index is made from the file when it is closed
//! ([`super::index`]): memory does not grow with the recording.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Seek, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use foxglove::Encode;
use foxglove::messages::{Grid, Log, RawImage};
use gripline_protocol::SENSORS;
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions, Writer};

use super::index;
use super::messages::{
    About, EVENTS, Event, FORCE_MAP, Frame, Image, PICTURE, REST, STATUS, events_between, image_bytes,
    map_bytes, status_bytes, status_schema, topic_of,
};
use crate::telemetry::FrameReport;

/// A chunk is closed when it is larger, with full pictures after five frames. Every writer of the library has room for one, which
/// it takes up as it fills: memory goes up and down by no more.
const CHUNK_BYTES: u64 = 1 << 20;
/// Flushes by one writer of the library, which keeps 0.3 kB of every chunk: a minute, a thousand chunks at most.
const SEGMENT: u32 = 250;

/// Where chunks go; what a writer says at its start goes nowhere when it is not the first.
struct Sink<W> {
    out: W,
    is_muted: Arc<AtomicBool>,
}

impl<W: Write> Write for Sink<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.is_muted.load(Ordering::Relaxed) {
            Ok(bytes.len())
        } else {
            self.out.write(bytes)
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

type ChunkWriter<W> = Writer<NoSeek<Sink<W>>>;

/// Channels, by topic.
#[derive(Debug, Clone)]
struct Channels {
    /// Of each fingertip.
    fingertips: Vec<FingertipChannels>,
    status: u16,
    events: u16,
}

#[derive(Debug, Clone, Copy)]
struct FingertipChannels {
    rest: u16,
    picture: u16,
    force_map: u16,
}

/// The file under way.
pub(super) struct Tape<W: Write> {
    /// `None` only after an error.
    writer: Option<ChunkWriter<W>>,
    channels: Channels,
    /// The same file, to be read when it is whole.
    written: Option<File>,
    about: BTreeMap<String, String>,
    chunks: u32,
    start_ns: u64,
    frames: u64,
    /// Frames that lie in the file for certain: a chunk that could not be written is lost whole.
    pub(super) kept: u64,
    /// The last frame, and the last one of each fingertip.
    before: Option<FrameReport>,
    before_of: [Option<FrameReport>; SENSORS],
}

impl<W: Write> Tape<W> {
    /// Begins a file of so many fingertips in `out`; `written` is the same file where it can be read, for the index.
    pub(super) fn new(
        out: W,
        written: Option<File>,
        about: &About,
        fingertips: usize,
        start_ns: u64,
    ) -> Result<Self, McapError> {
        let about = about.to_metadata();
        let (writer, channels) = segment(out, &about, fingertips, true)?;
        Ok(Self {
            writer: Some(writer),
            channels,
            written,
            about,
            chunks: 0,
            start_ns,
            frames: 0,
            kept: 0,
            before: None,
            before_of: [None, None],
        })
    }

    /// A fingertip's pictures without contact.
    pub(super) fn rest(&mut self, sensor: usize, crops: &[Vec<u8>]) -> Result<(), McapError> {
        for (number, crop) in crops.iter().enumerate() {
            let image = Image {
                side: crate::CROP_SIDE,
                pixels: crop.clone(),
            };
            self.put(
                self.channels.fingertips[sensor].rest,
                number as u32,
                self.start_ns,
                &image_bytes(&image, self.start_ns),
            )?;
        }
        Ok(())
    }

    fn time_ns(&self, t_s: f64) -> u64 {
        self.start_ns + (t_s * 1e9) as u64
    }

    /// Picture, map, events, and the status last: without it the frame does not count.
    pub(super) fn frame(&mut self, frame: &Frame) -> Result<(), McapError> {
        let (ns, number) = (self.time_ns(frame.report.t_s), frame.sequence);
        let sensor = usize::from(frame.report.sensor);
        let channels = self.channels.fingertips[sensor];
        if let Some(picture) = &frame.picture {
            self.put(channels.picture, number, ns, &image_bytes(picture, ns))?;
        }
        self.put(channels.force_map, number, ns, &map_bytes(&frame.map, ns))?;
        let before = (self.before.as_ref(), self.before_of[sensor].as_ref());
        for event in events_between(before, &frame.report) {
            self.event(frame.report.t_s, &event)?;
        }
        let status = status_bytes(frame).map_err(|error| McapError::Io(error.into()))?;
        self.put(self.channels.status, number, ns, &status)?;
        self.before = Some(frame.report.clone());
        self.before_of[sensor] = Some(frame.report.clone());
        self.frames += 1;
        Ok(())
    }

    /// Something that a person wants to find again.
    pub(super) fn event(&mut self, t_s: f64, event: &Event) -> Result<(), McapError> {
        let ns = self.time_ns(t_s);
        self.put(self.channels.events, 0, ns, &event.bytes(ns))
    }

    fn put(&mut self, channel_id: u16, sequence: u32, ns: u64, bytes: &[u8]) -> Result<(), McapError> {
        let header = MessageHeader {
            channel_id,
            sequence,
            log_time: ns,
            publish_time: ns,
        };
        self.writer()?.write_to_known_channel(&header, bytes)
    }

    fn writer(&mut self) -> Result<&mut ChunkWriter<W>, McapError> {
        self.writer.as_mut().ok_or(McapError::AttemptedWriteAfterFailure)
    }

    /// Closes the chunk and hands it to the system.
    pub(super) fn flush(&mut self) -> Result<(), McapError> {
        self.writer()?.flush()?;
        self.kept = self.frames;
        self.chunks += 1;
        if self.chunks.is_multiple_of(SEGMENT) {
            let out = self.out()?;
            let fingertips = self.channels.fingertips.len();
            let (writer, channels) = segment(out, &self.about, fingertips, false)?;
            (self.writer, self.channels) = (Some(writer), channels);
        }
        Ok(())
    }

    /// Closes the file, with an index where it can be read again.
    pub(super) fn finish(&mut self) -> Result<(), McapError> {
        self.writer()?.flush()?;
        self.kept = self.frames;
        let mut out = self.out()?;
        match &self.written {
            Some(written) => index::end_with(&mut out, written),
            None => index::end_without(&mut out),
        }
    }

    /// What lies below the library's writer, which has nothing left in it.
    fn out(&mut self) -> Result<W, McapError> {
        let writer = self.writer.take().ok_or(McapError::AttemptedWriteAfterFailure)?;
        Ok(writer.into_inner().into_inner().out)
    }
}

/// A writer of the library that goes on where the last one was.
fn segment<W: Write>(
    out: W,
    about: &BTreeMap<String, String>,
    fingertips: usize,
    is_first: bool,
) -> Result<(ChunkWriter<W>, Channels), McapError> {
    let is_muted = Arc::new(AtomicBool::new(!is_first));
    let sink = Sink {
        out,
        is_muted: Arc::clone(&is_muted),
    };
    // Chunks are put together in memory and written in one go: a cut file then ends in the middle of the last one.
    let mut writer = WriteOptions::new()
        .compression(None)
        .disable_seeking(true)
        .chunk_size(Some(CHUNK_BYTES))
        .calculate_data_section_crc(false)
        .library(concat!("gripline ", env!("CARGO_PKG_VERSION")))
        .create(NoSeek::new(sink))?;
    is_muted.store(false, Ordering::Relaxed);
    let image = schema::<RawImage>(&mut writer)?;
    let grid = schema::<Grid>(&mut writer)?;
    let log = schema::<Log>(&mut writer)?;
    let report = writer.add_schema("gripline.Status", "jsonschema", &status_schema())?;
    let nothing = BTreeMap::new();
    let mut protobuf = |schema, topic: &str| writer.add_channel(schema, topic, "protobuf", &nothing);
    let fingertips = (0..fingertips).map(|sensor| {
        Ok(FingertipChannels {
            rest: protobuf(image, &topic_of(REST, sensor))?,
            picture: protobuf(image, &topic_of(PICTURE, sensor))?,
            force_map: protobuf(grid, &topic_of(FORCE_MAP, sensor))?,
        })
    });
    let fingertips = fingertips.collect::<Result<_, McapError>>()?;
    let events = protobuf(log, EVENTS)?;
    let channels = Channels {
        fingertips,
        status: writer.add_channel(report, STATUS, "json", about)?,
        events,
    };
    Ok((writer, channels))
}

fn schema<T: Encode>(writer: &mut Writer<impl Write + Seek>) -> Result<u16, McapError> {
    match T::get_schema() {
        Some(schema) => writer.add_schema(&schema.name, &schema.encoding, &schema.data),
        None => Ok(0),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use mcap::Summary;
    use mcap::records::MessageIndexEntry;

    use super::*;

    /// Two and a half segments of a chunk each quarter second, in which something happens now and then.
    fn long_recording(path: &std::path::Path) -> u64 {
        let file = File::create(path).unwrap();
        let to_read = File::open(path).unwrap();
        let mut tape = Tape::new(
            io::BufWriter::new(file),
            Some(to_read),
            &About::default(),
            1,
            1_000,
        )
        .unwrap();
        tape.rest(0, &[vec![7; 440 * 440]]).unwrap();
        let mut events = 0;
        for chunk in 0..u64::from(SEGMENT) * 5 / 2 {
            for _ in 0..chunk % 3 {
                tape.event(chunk as f64 / 4.0, &Event::info(format!("event {events}")))
                    .unwrap();
                events += 1;
            }
            tape.flush().unwrap();
        }
        tape.finish().unwrap();
        events
    }

    #[test]
    fn a_long_recording_is_one_file_whose_index_finds_every_message() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long.mcap");
        let events = long_recording(&path);
        let bytes = fs::read(&path).unwrap();

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
        assert_eq!((statistics.schema_count, statistics.channel_count), (4, 5));
        assert_eq!(statistics.message_start_time, 1_000);
        assert_eq!(
            Some(statistics.message_end_time),
            linear.iter().map(|message| message.log_time).max()
        );
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

    #[test]
    fn where_nothing_can_be_read_again_the_file_is_whole_without_an_index() {
        let mut bytes = Vec::new();
        let mut tape = Tape::new(&mut bytes, None, &About::default(), 1, 0).unwrap();
        tape.event(0.0, &Event::info("one".to_owned())).unwrap();
        tape.finish().unwrap();
        drop(tape);
        assert_eq!(mcap::MessageStream::new(&bytes).unwrap().count(), 1);
        assert!(Summary::read(&bytes).unwrap().is_none());
    }
}
