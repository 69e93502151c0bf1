//! The receiving end of one link for messages: fragments in, whole messages out.

use crate::constants::{CRC_BYTES, MESSAGE_FRAGMENTS_MAX, MESSAGE_MAX, PACKET_HEADER, PACKET_MAX};
use crate::crc::RunningCrc;
use crate::packet::{Header, PacketError, wrong_length};

/// The receiving end of one link for messages alone, for a board that works on maps elsewhere.
#[derive(Debug)]
pub struct MessageParser {
    message: Option<MessageInProgress>,
    /// Payload of the message in progress, or of the last one.
    payload: heapless::Vec<u8, MESSAGE_MAX>,
    abandoned: u32,
}

#[derive(Debug)]
struct MessageInProgress {
    id: u8,
    fragments: u8,
    next_index: u8,
    crc: RunningCrc,
}

impl Default for MessageParser {
    fn default() -> Self {
        Self::new()
    }
}

impl MessageParser {
    /// A parser before its first packet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            message: None,
            payload: heapless::Vec::new(),
            abandoned: 0,
        }
    }

    /// Messages that began but never ended; wraps.
    #[must_use]
    pub const fn abandoned(&self) -> u32 {
        self.abandoned
    }

    /// Drops the message in progress: its remaining fragments will be refused.
    pub fn drop_message(&mut self) {
        self.message = None;
    }

    /// Takes a packet of [`Kind::Message`](crate::packet::Kind::Message). Returns the message once it is whole.
    ///
    /// # Errors
    /// [`PacketError`] when this is not the fragment expected next, or when the CRC is wrong. The message in progress is
    /// dropped.
    pub fn push(&mut self, packet: &[u8]) -> Result<Option<&[u8]>, PacketError> {
        // Put back below, where the fragment is right and another one must follow.
        let in_progress = self.message.take();
        if packet.len() > PACKET_MAX {
            return Err(wrong_length(packet, PACKET_MAX));
        }
        let (header, payload) = Header::split(packet)?;
        if payload.is_empty() {
            return Err(wrong_length(packet, PACKET_HEADER + 1));
        }
        let (id, fragments, found) = (header.owner, header.sequence, header.index);
        let mut message = match in_progress {
            // A first fragment always starts afresh, so that a lost last fragment costs one message only.
            unfinished if found == 0 => {
                self.abandoned = self.abandoned.wrapping_add(unfinished.is_some().into());
                self.payload.clear();
                MessageInProgress {
                    id,
                    fragments,
                    next_index: 0,
                    crc: RunningCrc::new(),
                }
            }
            Some(message) => message,
            None => return Err(PacketError::Order { found, expected: 0 }),
        };
        let expected = message.next_index;
        let last = found.checked_add(1) == Some(fragments);
        let full = payload.len() == PACKET_MAX - PACKET_HEADER;
        if message.id != id
            || message.fragments != fragments
            || found != expected
            || found >= fragments
            || usize::from(fragments) > MESSAGE_FRAGMENTS_MAX
            || !(last || full)
            // Never true: every fragment but the last is full, and there are at most four.
            || self.payload.extend_from_slice(payload).is_err()
        {
            return Err(PacketError::Order { found, expected });
        }
        message.next_index += 1;
        if !last {
            message.crc.update(packet);
            self.message = Some(message);
            return Ok(None);
        }
        // The CRC is the message's last four bytes and lies whole in the last fragment.
        let (covered, crc) = packet.split_last_chunk::<CRC_BYTES>().ok_or(PacketError::Crc)?;
        if payload.len() < CRC_BYTES {
            return Err(wrong_length(packet, PACKET_HEADER + CRC_BYTES));
        }
        message.crc.update(covered);
        if message.crc.finish() != u32::from_le_bytes(*crc) {
            return Err(PacketError::Crc);
        }
        Ok(self.payload.get(..self.payload.len() - CRC_BYTES))
    }
}
