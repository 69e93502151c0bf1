//! A message cut into packets of at most 64 bytes.

use super::envelope::{Message, MessageError};
use crate::constants::{CRC_BYTES, MESSAGE_FRAGMENTS_MAX, MESSAGE_MAX, PACKET_HEADER, PACKET_MAX};
use crate::crc::RunningCrc;
use crate::packet::{Header, Kind, Packet};

/// Payload of a full packet, bytes.
const PAYLOAD: usize = PACKET_MAX - PACKET_HEADER;

/// The packets of a message, in order.
#[derive(Debug, Clone)]
pub struct MessagePackets {
    bytes: heapless::Vec<u8, MESSAGE_MAX>,
    id: u8,
    next: u8,
}

impl MessagePackets {
    /// Encodes a message. `id` must differ from the previous message's on the same link.
    ///
    /// # Errors
    /// [`MessageError::TooLong`] when it does not fit [`MESSAGE_MAX`]. No message of this crate is that long.
    pub fn new(message: &Message, id: u8) -> Result<Self, MessageError> {
        let mut body = [0; MESSAGE_MAX - CRC_BYTES];
        let mut length = message.write(&mut body)?;
        // The CRC lies whole in the last packet: up to three zeros fill the packet before it.
        let room = PAYLOAD - length % PAYLOAD;
        if room < CRC_BYTES {
            length += room;
        }
        let body = body.get(..length).ok_or(MessageError::TooLong)?;
        let mut crc = RunningCrc::new();
        let fragments = fragments(length + CRC_BYTES);
        for (index, payload) in (0..).zip(body.chunks(PAYLOAD)) {
            crc.update(&header(id, fragments, index));
            crc.update(payload);
        }
        // The CRC alone in a packet of its own.
        if length.is_multiple_of(PAYLOAD) {
            crc.update(&header(id, fragments, fragments - 1));
        }
        let mut bytes = heapless::Vec::new();
        let fits = bytes.extend_from_slice(body).is_ok()
            && bytes.extend_from_slice(&crc.finish().to_le_bytes()).is_ok();
        if !fits {
            return Err(MessageError::TooLong);
        }
        Ok(Self { bytes, id, next: 0 })
    }
}

/// Packets that so many bytes take.
const fn fragments(length: usize) -> u8 {
    length.div_ceil(PAYLOAD) as u8
}

const _: () = assert!(MESSAGE_MAX / PAYLOAD == MESSAGE_FRAGMENTS_MAX && MESSAGE_FRAGMENTS_MAX < 256);

const fn header(id: u8, fragments: u8, index: u8) -> [u8; PACKET_HEADER] {
    Header {
        kind: Kind::Message,
        owner: id,
        sequence: fragments,
        index,
    }
    .to_bytes()
}

impl Iterator for MessagePackets {
    type Item = Packet;

    fn next(&mut self) -> Option<Packet> {
        let payload = self.bytes.chunks(PAYLOAD).nth(self.next.into())?;
        let mut packet = Packet::new();
        packet
            .extend_from_slice(&header(self.id, fragments(self.bytes.len()), self.next))
            .ok()?;
        packet.extend_from_slice(payload).ok()?;
        self.next += 1;
        Some(packet)
    }
}
