//! The recording's file under way: messages in chunks that are written in one go and never touched again. A file that is cut
//! short therefore reads up to its last whole chunk.
//! The library keeps 0.3 kB of index per chunk until the end: 50 MB a day at two chunks a second.

use std::io::Write;

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions, Writer};

use crate::channels::{Channels, Message};
use crate::event::Event;
use crate::image::Image;
use crate::metadata::Metadata;
use crate::status::Frame;

/// A chunk is closed when it is larger: after ten full pictures. The writer keeps a buffer of this size.
const CHUNK_BYTES: u64 = 2 << 20;

/// Writes frames and events into an MCAP file.
pub(crate) struct RecordingWriter<W: Write> {
    writer: Writer<NoSeek<W>>,
    channels: Channels,
    /// The file's numbers for them.
    ids: Vec<u16>,
    frames: u64,
    /// Frames that are in the file for certain: a chunk that could not be written is lost whole.
    pub kept: u64,
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
        let channels = Channels::new(fingertips, metadata, start_ns);
        let ids = channels.list().iter().map(|channel| {
            // Equal schemas get one number.
            let schema = match &channel.schema {
                Some(schema) => writer.add_schema(&schema.name, &schema.encoding, &schema.data)?,
                None => 0,
            };
            writer.add_channel(
                schema,
                &channel.topic,
                channel.message_encoding,
                &channel.metadata,
            )
        });
        let ids = ids.collect::<Result<_, McapError>>()?;
        Ok(Self {
            writer,
            channels,
            ids,
            frames: 0,
            kept: 0,
        })
    }

    /// A fingertip's pictures without contact.
    pub(crate) fn rest(&mut self, sensor: usize, pictures: &[Image]) -> Result<(), McapError> {
        let mut messages = self.channels.rest(sensor, pictures);
        messages.try_for_each(|message| self.put(&message))
    }

    /// A frame's messages.
    pub(crate) fn frame(&mut self, frame: &Frame) -> Result<(), McapError> {
        let messages = self.channels.frame(frame);
        let messages = messages.map_err(|error| McapError::Io(error.into()))?;
        messages.iter().try_for_each(|message| self.put(message))?;
        self.frames += 1;
        Ok(())
    }

    /// Something that a person wants to find again.
    pub(crate) fn event(&mut self, t_s: f64, event: &Event) -> Result<(), McapError> {
        let message = self.channels.event(t_s, event);
        self.put(&message)
    }

    fn put(&mut self, message: &Message) -> Result<(), McapError> {
        let header = MessageHeader {
            channel_id: self.ids[message.channel],
            sequence: message.sequence,
            log_time: message.time_ns,
            publish_time: message.time_ns,
        };
        self.writer.write_to_known_channel(&header, &message.bytes)
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

#[cfg(test)]
mod tests {
    use mcap::Summary;
    use mcap::records::MessageIndexEntry;

    use super::*;
    use crate::topics::{EVENTS, FORCE_MAP, PICTURE, REST, STATUS};

    #[test]
    fn the_index_finds_every_message_even_where_the_file_cannot_be_read_again() {
        let mut bytes = Vec::new();
        let mut writer = RecordingWriter::new(&mut bytes, &Metadata::default(), 1, 1_000).unwrap();
        writer.rest(0, &[Image::grey(440, vec![7; 440 * 440])]).unwrap();
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
