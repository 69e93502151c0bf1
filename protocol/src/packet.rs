//! The four bytes in front of every packet, and the CRC-32 that ends every map and every message.
//!
//! | byte | map packets | message packets |
//! |---|---|---|
//! | 0 | version (upper half), kind (lower half) | the same |
//! | 1 | sensor | message id |
//! | 2 | lowest byte of the map's sequence number | number of fragments |
//! | 3 | index of the packet in the map | index of the fragment |

use crate::constants::{PACKET_HEADER, WIRE_VERSION};
use crate::parser::PacketError;

/// What a packet is part of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Kind {
    /// The first packet of a map: sequence, time, health, which taxels follow.
    MapHead = 0,
    /// Ten taxels in the middle of a map.
    MapTaxels = 1,
    /// The last packet of a map: up to nine taxels and the CRC.
    MapTail = 2,
    /// A fragment of a message.
    Message = 3,
}

impl Kind {
    /// What kind a packet says it is; `None` for one that is too short for a header or of another version.
    #[inline]
    #[must_use]
    pub const fn of(packet: &[u8]) -> Option<Self> {
        if packet.len() < PACKET_HEADER {
            return None;
        }
        Self::of_byte(packet[0])
    }

    const fn of_byte(first: u8) -> Option<Self> {
        const MAP_HEAD: u8 = first_byte(Kind::MapHead);
        const MAP_TAXELS: u8 = first_byte(Kind::MapTaxels);
        const MAP_TAIL: u8 = first_byte(Kind::MapTail);
        const MESSAGE: u8 = first_byte(Kind::Message);
        match first {
            MAP_HEAD => Some(Self::MapHead),
            MAP_TAXELS => Some(Self::MapTaxels),
            MAP_TAIL => Some(Self::MapTail),
            MESSAGE => Some(Self::Message),
            _ => None,
        }
    }
}

/// The version and the kind.
const fn first_byte(kind: Kind) -> u8 {
    WIRE_VERSION << 4 | kind as u8
}

/// A packet's first four bytes, decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// What the packet is part of.
    pub kind: Kind,
    /// Sensor of a map, or id of a message.
    pub owner: u8,
    /// Lowest byte of a map's sequence number, or number of fragments of a message.
    pub sequence: u8,
    /// Place of this packet in its map or message, from 0.
    pub index: u8,
}

impl Header {
    /// The header as it stands on the wire.
    #[must_use]
    pub const fn to_bytes(self) -> [u8; PACKET_HEADER] {
        [first_byte(self.kind), self.owner, self.sequence, self.index]
    }

    /// Reads the header of a packet; the payload is what follows it.
    #[inline]
    pub(crate) fn split(packet: &[u8]) -> Result<(Self, &[u8]), PacketError> {
        let Some((&[first, owner, sequence, index], payload)) = packet.split_first_chunk() else {
            return Err(PacketError::Length {
                found: packet.len() as u16,
                expected: PACKET_HEADER as u16,
            });
        };
        let kind = Kind::of_byte(first).ok_or(PacketError::Version { found: first })?;
        let header = Self {
            kind,
            owner,
            sequence,
            index,
        };
        Ok((header, payload))
    }
}

/// The reflected polynomial of CRC-32/ISO-HDLC.
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// What a byte makes of the CRC when 0 to 3 bytes follow it in the same word: four bytes a step, a quarter of the work
/// of the plain table, for 4 KiB. (The `crc` crate has one byte a step in 1 KiB or sixteen in 16 KiB.)
/// Four tables and not one of four rows, so that each has its address in a register.
static CRC_0: [u32; 256] = crc_table(0);
static CRC_1: [u32; 256] = crc_table(1);
static CRC_2: [u32; 256] = crc_table(2);
static CRC_3: [u32; 256] = crc_table(3);

const fn crc_table(following: usize) -> [u32; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut crc, mut bit) = (byte as u32, 0);
        while bit < 8 * (1 + following) {
            crc = if crc & 1 == 1 {
                crc >> 1 ^ POLYNOMIAL
            } else {
                crc >> 1
            };
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
}

/// Words a round.
const WORDS_AT_ONCE: usize = 4;

/// A CRC-32 (ISO-HDLC) under way, over every byte of a map or message in order, headers included.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RunningCrc(u32);

impl RunningCrc {
    pub(crate) const fn new() -> Self {
        Self(u32::MAX)
    }

    /// Takes bytes in; by words when they lie at an address that words may have.
    #[inline]
    pub(crate) fn update(&mut self, bytes: &[u8]) {
        let (start, rest) = bytes.split_at(bytes.len() & !3);
        let Ok(words) = bytemuck::try_cast_slice::<u8, u32>(start) else {
            return self.update_bytes(bytes);
        };
        let (blocks, words) = words.as_chunks::<WORDS_AT_ONCE>();
        // One after the other by hand: the compiler would count to four.
        for &[first, second, third, fourth] in blocks {
            self.update_word(first);
            self.update_word(second);
            self.update_word(third);
            self.update_word(fourth);
        }
        for &word in words {
            self.update_word(word);
        }
        for &byte in rest {
            self.update_byte(byte);
        }
    }

    #[cold]
    #[inline(never)]
    fn update_bytes(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.update_byte(byte);
        }
    }

    #[inline]
    fn update_word(&mut self, word: u32) {
        let four = self.0 ^ u32::from_le(word);
        self.0 = CRC_3[(four & 0xFF) as usize]
            ^ CRC_2[(four >> 8 & 0xFF) as usize]
            ^ CRC_1[(four >> 16 & 0xFF) as usize]
            ^ CRC_0[(four >> 24) as usize];
    }

    #[inline]
    fn update_byte(&mut self, byte: u8) {
        self.0 = CRC_0[usize::from(self.0 as u8 ^ byte)] ^ self.0 >> 8;
    }

    #[inline]
    pub(crate) const fn finish(self) -> u32 {
        !self.0
    }
}

/// The CRC-32 (ISO-HDLC) of some bytes: the one on the wire, for what is kept elsewhere too.
pub fn crc32(bytes: impl IntoIterator<Item = u8>) -> u32 {
    let mut crc = RunningCrc::new();
    for byte in bytes {
        crc.update(&[byte]);
    }
    crc.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_crc_is_that_of_another_implementation_however_the_bytes_are_cut(
            bytes in proptest::collection::vec(any::<u8>(), 0..300),
            cut in 0_usize..300,
        ) {
            // From any address.
            let bytes = &bytes[(cut & 3).min(bytes.len())..];
            let cut = cut.min(bytes.len());
            let mut crc = RunningCrc::new();
            crc.update(&bytes[..cut]);
            crc.update(&bytes[cut..]);
            prop_assert_eq!(crc.finish(), crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(bytes));
        }
    }
}
