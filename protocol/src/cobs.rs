//! Packets in a byte stream (UART). Each packet is COBS-encoded and ends with a zero byte, so a receiver resynchronises at
//! the next zero after any disturbance. Limits: 64 bytes of packet, 66 bytes of frame with the zero.

use crate::constants::PACKET_MAX;

/// Longest frame in bytes: one byte of overhead up to 254 bytes of packet, and the zero.
pub const FRAME_MAX: usize = PACKET_MAX + 2;

/// Writes the frame of one packet. Returns the frame's length with the zero at its end. Packets have at most 64 bytes;
/// whatever follows them is cut off.
#[must_use]
pub fn encode_packet(packet: &[u8], frame: &mut [u8; FRAME_MAX]) -> usize {
    let packet = &packet[..packet.len().min(PACKET_MAX)];
    let length = ::cobs::encode(packet, &mut frame[..=PACKET_MAX]);
    frame[length] = 0;
    length + 1
}

/// What a byte of the stream completed.
#[derive(Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Frame<'a> {
    /// A packet, ready for [`crate::Parser::push`].
    Packet(&'a [u8]),
    /// A frame that is too long or not COBS. Tell the parser: [`crate::Parser::refuse`].
    Malformed,
}

/// Finds packets in a byte stream.
#[derive(Debug)]
pub struct CobsDecoder {
    frame: heapless::Vec<u8, { FRAME_MAX - 1 }>,
    /// The frame is longer than any valid one: drop everything up to the next zero.
    overlong: bool,
    /// The frame has ended; the next byte starts another one.
    is_complete: bool,
}

impl Default for CobsDecoder {
    fn default() -> Self {
        Self::new()
    }
}

impl CobsDecoder {
    /// An empty decoder.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            frame: heapless::Vec::new(),
            overlong: false,
            is_complete: false,
        }
    }

    /// Takes one byte. `None` inside a frame, and for the zeros between frames.
    pub fn push(&mut self, byte: u8) -> Option<Frame<'_>> {
        if self.is_complete {
            self.frame.clear();
            self.is_complete = false;
        }
        if byte != 0 {
            self.overlong |= self.frame.push(byte).is_err();
            return None;
        }
        self.is_complete = true;
        if core::mem::take(&mut self.overlong) {
            return Some(Frame::Malformed);
        }
        if self.frame.is_empty() {
            return None;
        }
        match ::cobs::decode_in_place(&mut self.frame) {
            Ok(decoded) => Some(Frame::Packet(&self.frame[..decoded])),
            Err(_) => Some(Frame::Malformed),
        }
    }
}
