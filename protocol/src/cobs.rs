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

/// Finds packets in a byte stream. Every byte is decoded as it comes, with constant work, so that a packet is there as soon as its frame ends.
#[derive(Debug)]
#[repr(C, align(4))]
pub struct CobsDecoder {
    /// The packet, first in the struct: aligned to words, as the fast ways of CRC and sums want it.
    packet: [u8; PACKET_MAX],
    /// Bytes of the packet so far.
    length: u8,
    /// Bytes of the block that are still to come.
    rest: u8,
    /// A zero follows the block, if another block does.
    owes_zero: bool,
    /// A byte came since the last end of a frame.
    has_begun: bool,
    /// The packet is longer than any valid one: drop everything up to the next zero.
    is_overlong: bool,
}

impl Default for CobsDecoder {
    fn default() -> Self {
        Self::new()
    }
}

impl CobsDecoder {
    /// The code of a block of 254 bytes, behind which no zero was left out.
    const LONGEST: u8 = 0xFF;

    /// An empty decoder.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            packet: [0; PACKET_MAX],
            length: 0,
            rest: 0,
            owes_zero: false,
            has_begun: false,
            is_overlong: false,
        }
    }

    /// Takes one byte. `None` inside a frame, and for the zeros between frames.
    #[inline]
    pub fn push(&mut self, byte: u8) -> Option<Frame<'_>> {
        if byte == 0 {
            return self.end();
        }
        if !self.has_begun {
            self.has_begun = true;
            self.length = 0;
        } else if self.rest > 0 {
            self.rest -= 1;
            self.put(byte);
            return None;
        } else if self.owes_zero {
            self.put(0);
        }
        // The byte begins a block.
        self.rest = byte - 1;
        self.owes_zero = byte != Self::LONGEST;
        None
    }

    /// The packet that ended with the last zero, until the next byte is taken.
    #[inline]
    #[must_use]
    pub fn packet(&self) -> &[u8] {
        self.packet.get(..usize::from(self.length)).unwrap_or_default()
    }

    /// Drops the frame under way up to its end, because a byte of it was lost.
    #[inline]
    pub fn spoil(&mut self) {
        self.has_begun = true;
        self.is_overlong = true;
    }

    #[inline]
    fn put(&mut self, byte: u8) {
        match self.packet.get_mut(usize::from(self.length)) {
            Some(place) => {
                *place = byte;
                self.length += 1;
            }
            None => self.is_overlong = true,
        }
    }

    #[inline]
    fn end(&mut self) -> Option<Frame<'_>> {
        let is_empty = !core::mem::take(&mut self.has_begun);
        let is_whole = core::mem::take(&mut self.rest) == 0;
        let is_overlong = core::mem::take(&mut self.is_overlong);
        if is_empty {
            None
        } else if is_whole && !is_overlong {
            Some(Frame::Packet(self.packet()))
        } else {
            Some(Frame::Malformed)
        }
    }
}
