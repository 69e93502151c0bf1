//! The end of a recording: index and summary, made from the file itself when it is closed, so that nothing of them lies in
//! memory while it grows. MCAP's layout: <https://mcap.dev/spec>. Sizes and offsets in bytes.
//! Limits: files of this program only, whose chunks are not compressed; what cannot be read again (a pipe) has no index.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Cursor, Read, Write};

use binrw::{BinRead, BinWrite};
use mcap::records::{ChunkHeader, ChunkIndex, DataEnd, Footer, Statistics, SummaryOffset, op};
use mcap::{MAGIC, McapError};

/// Opcode and length before every record.
const RECORD_HEADER: u64 = 9;
/// A chunk's header without compression.
const CHUNK_HEADER: usize = 40;
/// A message index: channel and length of the list, then an entry a message.
const INDEX_HEADER: u64 = 6;
const INDEX_ENTRY: u64 = 16;

/// Ends a file that cannot be read again: whole, but without index.
pub(super) fn end_without<W: Write>(out: &mut W) -> Result<(), McapError> {
    put(out, op::DATA_END, &DataEnd::default())?;
    end(out, 0, 0)
}

/// Ends a file with index and summary. `written` is the file, all of it, from its beginning; `out` stands at its end.
pub(super) fn end_with<W: Write>(out: &mut W, written: &File) -> Result<(), McapError> {
    let length = written.metadata()?.len();
    let mut position = length + put(out, op::DATA_END, &DataEnd::default())?;
    let start = position;
    let mut offsets = Vec::new();
    let mut end_group = |group_opcode, group_start: u64, group_end: u64| {
        offsets.push(SummaryOffset {
            group_opcode,
            group_start,
            group_length: group_end - group_start,
        });
    };

    let mut file = Scan::new(written)?;
    let mut all = Totals::default();
    while file.position < length {
        let index = file.chunk(&mut all)?;
        position += put(out, op::CHUNK_INDEX, &index)?;
    }
    end_group(op::CHUNK_INDEX, start, position);
    for (group, records) in [(op::SCHEMA, &all.schemas), (op::CHANNEL, &all.channels)] {
        let group_start = position;
        for record in records.values() {
            position += put_bytes(out, group, record)?;
        }
        end_group(group, group_start, position);
    }
    let statistics_start = position;
    position += put(out, op::STATISTICS, &all.statistics())?;
    end_group(op::STATISTICS, statistics_start, position);
    for offset in offsets {
        put(out, op::SUMMARY_OFFSET, &offset)?;
    }
    end(out, start, position)
}

fn end<W: Write>(out: &mut W, summary_start: u64, summary_offset_start: u64) -> Result<(), McapError> {
    let footer = Footer {
        summary_start,
        summary_offset_start,
        summary_crc: 0, // not told
    };
    put(out, op::FOOTER, &footer)?;
    out.write_all(MAGIC)?;
    Ok(out.flush()?)
}

/// Writes a record and returns how long it is.
fn put<W: Write>(
    out: &mut W,
    opcode: u8,
    record: &impl for<'a> BinWrite<Args<'a> = ()>,
) -> Result<u64, McapError> {
    let mut body = Cursor::new(Vec::new());
    record.write_le(&mut body)?;
    put_bytes(out, opcode, body.get_ref())
}

fn put_bytes<W: Write>(out: &mut W, opcode: u8, body: &[u8]) -> Result<u64, McapError> {
    out.write_all(&[opcode])?;
    out.write_all(&(body.len() as u64).to_le_bytes())?;
    out.write_all(body)?;
    Ok(RECORD_HEADER + body.len() as u64)
}

/// What the summary says of the file as a whole.
#[derive(Default)]
struct Totals {
    schemas: BTreeMap<u16, Vec<u8>>,
    channels: BTreeMap<u16, Vec<u8>>,
    messages: BTreeMap<u16, u64>,
    chunks: u32,
    /// Times of the first and last message.
    bounds: Option<(u64, u64)>,
}

impl Totals {
    fn statistics(&self) -> Statistics {
        let (message_start_time, message_end_time) = self.bounds.unwrap_or_default();
        Statistics {
            message_count: self.messages.values().sum(),
            schema_count: self.schemas.len() as u16,
            channel_count: self.channels.len() as u32,
            attachment_count: 0,
            metadata_count: 0,
            chunk_count: self.chunks,
            message_start_time,
            message_end_time,
            channel_message_counts: self.messages.clone(),
        }
    }
}

/// A file that is gone through from chunk to chunk.
struct Scan<'a> {
    file: BufReader<&'a File>,
    position: u64,
    /// Opcode and length of the record that stands there.
    next: Option<(u8, u64)>,
}

impl<'a> Scan<'a> {
    /// Stands behind the header.
    fn new(file: &'a File) -> Result<Self, McapError> {
        let mut scan = Self {
            file: BufReader::new(file),
            position: 0,
            next: None,
        };
        scan.skip(MAGIC.len() as u64)?;
        let (_, header) = scan.record()?;
        scan.skip(header)?;
        Ok(scan)
    }

    /// The next chunk's index; the indexes of its messages stand behind it.
    fn chunk(&mut self, all: &mut Totals) -> Result<ChunkIndex, McapError> {
        let chunk_start_offset = self.next.map_or(self.position, |_| self.position - RECORD_HEADER);
        let (opcode, length) = self.record()?;
        if opcode != op::CHUNK {
            let found =
                format!("found a record {opcode:#04x} at byte {chunk_start_offset}, expected a chunk");
            return Err(io::Error::new(io::ErrorKind::InvalidData, found).into());
        }
        let mut header = [0; CHUNK_HEADER];
        self.read(&mut header)?;
        let header = ChunkHeader::read_le(&mut Cursor::new(header))?;
        self.declarations(length - CHUNK_HEADER as u64, all)?;
        let chunk_end = self.position;
        let mut message_index_offsets = BTreeMap::new();
        let mut message_index_length = 0;
        while let Some((op::MESSAGE_INDEX, length)) = self.peek()? {
            let mut channel = [0; 2];
            self.read(&mut channel)?;
            self.skip(length - 2)?;
            self.next = None;
            let channel = u16::from_le_bytes(channel);
            message_index_offsets.insert(channel, self.position - length - RECORD_HEADER);
            message_index_length += RECORD_HEADER + length;
            *all.messages.entry(channel).or_default() += (length - INDEX_HEADER) / INDEX_ENTRY;
        }
        all.chunks += 1;
        let (start, end) = (header.message_start_time, header.message_end_time);
        let (first, last) = all.bounds.unwrap_or((start, end));
        all.bounds = Some((first.min(start), last.max(end)));
        Ok(ChunkIndex {
            message_start_time: start,
            message_end_time: end,
            chunk_start_offset,
            chunk_length: chunk_end - chunk_start_offset,
            message_index_offsets,
            message_index_length,
            compression: header.compression,
            compressed_size: header.compressed_size,
            uncompressed_size: header.uncompressed_size,
        })
    }

    /// Schemas and channels stand at a chunk's beginning, before its first message; the rest is passed over.
    fn declarations(&mut self, mut left: u64, all: &mut Totals) -> Result<(), McapError> {
        while left > 0 {
            let (opcode, length) = self.record()?;
            left -= RECORD_HEADER;
            let declared = match opcode {
                op::SCHEMA => &mut all.schemas,
                op::CHANNEL => &mut all.channels,
                _ => break,
            };
            let mut body = vec![0; length as usize];
            self.read(&mut body)?;
            left -= length;
            if let Some(id) = body.first_chunk() {
                declared.insert(u16::from_le_bytes(*id), body);
            }
        }
        self.skip(left)
    }

    /// Opcode and length of the next record, behind whose header it then stands.
    fn record(&mut self) -> Result<(u8, u64), McapError> {
        if let Some(next) = self.next.take() {
            return Ok(next);
        }
        let mut header = [0; RECORD_HEADER as usize];
        self.read(&mut header)?;
        let [opcode, length @ ..] = header;
        Ok((opcode, u64::from_le_bytes(length)))
    }

    /// The same without taking it; `None` at the end of the file.
    fn peek(&mut self) -> Result<Option<(u8, u64)>, McapError> {
        if self.next.is_none() {
            let mut first = [0];
            if self.file.read(&mut first)? == 0 {
                return Ok(None);
            }
            self.position += 1;
            let mut length = [0; 8];
            self.read(&mut length)?;
            self.next = Some((first[0], u64::from_le_bytes(length)));
        }
        Ok(self.next)
    }

    fn read(&mut self, bytes: &mut [u8]) -> Result<(), McapError> {
        self.file.read_exact(bytes)?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    fn skip(&mut self, bytes: u64) -> Result<(), McapError> {
        self.file.seek_relative(bytes as i64)?;
        self.position += bytes;
        Ok(())
    }
}
