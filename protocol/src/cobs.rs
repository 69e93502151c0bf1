//! Packets in a byte stream (UART): each is COBS-encoded and ended by a zero byte, so that a receiver finds its
//! place again after any disturbance at the next zero. Limits: 64 bytes of packet, 66 of frame including the zero.

use crate::constants::PACKET_MAX;

/// Longest frame in bytes: one byte of overhead up to 254 bytes of packet, and the zero.
pub const FRAME_MAX: usize = PACKET_MAX + 2;

/// Writes the frame of one packet and returns its length, the zero at the end included.
///
/// # Panics
/// Never for packets of at most 64 bytes; longer ones are cut off to 64, which no encoder of this crate produces.
#[must_use]
pub fn encode_packet(packet: &[u8], frame: &mut [u8; FRAME_MAX]) -> usize {
    let packet = &packet[..packet.len().min(PACKET_MAX)];
    let length = ::cobs::encode(packet, &mut frame[..=PACKET_MAX]);
    frame[length] = 0;
    length + 1
}

/// What a byte of the stream completed.
#[derive(Debug, PartialEq, Eq)]
pub enum Frame<'a> {
    /// A packet, ready for [`crate::Parser::push`].
    Packet(&'a [u8]),
    /// A frame that was too long or not COBS: tell the parser with [`crate::Parser::refuse`].
    Malformed,
}

/// Finds packets in a byte stream.
#[derive(Debug)]
pub struct CobsDecoder {
    frame: [u8; FRAME_MAX - 1],
    length: usize,
    /// More bytes came than any frame has; everything up to the next zero is dropped.
    overlong: bool,
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
            frame: [0; FRAME_MAX - 1],
            length: 0,
            overlong: false,
        }
    }

    /// Takes one byte. `None` while a frame is under way, and for the zeros between frames.
    pub fn push(&mut self, byte: u8) -> Option<Frame<'_>> {
        if byte != 0 {
            match self.frame.get_mut(self.length) {
                Some(place) => {
                    *place = byte;
                    self.length += 1;
                }
                None => self.overlong = true,
            }
            return None;
        }
        let length = core::mem::take(&mut self.length);
        let overlong = core::mem::take(&mut self.overlong);
        if overlong {
            return Some(Frame::Malformed);
        }
        if length == 0 {
            return None;
        }
        match ::cobs::decode_in_place(&mut self.frame[..length]) {
            Ok(decoded) => Some(Frame::Packet(&self.frame[..decoded])),
            Err(_) => Some(Frame::Malformed),
        }
    }
}
