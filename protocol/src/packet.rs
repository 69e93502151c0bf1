//! The four bytes in front of every packet, and the CRC-32 that ends every map and every message.
//!
//! | byte | map packets | message packets |
//! |---|---|---|
//! | 0 | version (upper half), kind (lower half) | the same |
//! | 1 | sensor | message id |
//! | 2 | lowest byte of the map's sequence number | number of fragments |
//! | 3 | index of the packet in the map | index of the fragment |

use crate::constants::{PACKET_HEADER, WIRE_VERSION};

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
        [
            WIRE_VERSION << 4 | self.kind as u8,
            self.owner,
            self.sequence,
            self.index,
        ]
    }

    /// Reads a header. `Err` holds the first byte: an unknown version or kind.
    pub(crate) const fn from_bytes(bytes: [u8; PACKET_HEADER]) -> Result<Self, u8> {
        let [first, owner, sequence, index] = bytes;
        if first >> 4 != WIRE_VERSION {
            return Err(first);
        }
        let kind = match first & 0xF {
            0 => Kind::MapHead,
            1 => Kind::MapTaxels,
            2 => Kind::MapTail,
            3 => Kind::Message,
            _ => return Err(first),
        };
        Ok(Self {
            kind,
            owner,
            sequence,
            index,
        })
    }
}

/// The reflected polynomial of CRC-32/ISO-HDLC.
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// What a byte makes of the CRC when 0 to 3 bytes follow it in the same word: four bytes a step, a quarter of the work
/// of the plain table, for 4 KiB. (The `crc` crate has one byte a step in 1 KiB or sixteen in 16 KiB.)
static CRC_TABLES: [[u32; 256]; 4] = {
    let mut tables = [[0; 256]; 4];
    let mut byte = 0;
    while byte < 256 {
        let (mut crc, mut bit) = (byte as u32, 0);
        while bit < 8 {
            crc = if crc & 1 == 1 {
                crc >> 1 ^ POLYNOMIAL
            } else {
                crc >> 1
            };
            bit += 1;
        }
        tables[0][byte] = crc;
        byte += 1;
    }
    let mut table = 1;
    while table < 4 {
        let mut byte = 0;
        while byte < 256 {
            let before = tables[table - 1][byte];
            tables[table][byte] = before >> 8 ^ tables[0][before as usize & 0xFF];
            byte += 1;
        }
        table += 1;
    }
    tables
};

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
        let [t0, t1, t2, t3] = &CRC_TABLES;
        let (start, rest) = bytes.split_at(bytes.len() & !3);
        let Ok(words) = bytemuck::try_cast_slice::<u8, u32>(start) else {
            return self.update_bytes(bytes);
        };
        let mut crc = self.0;
        for &word in words {
            let four = crc ^ u32::from_le(word);
            crc = t3[(four & 0xFF) as usize]
                ^ t2[(four >> 8 & 0xFF) as usize]
                ^ t1[(four >> 16 & 0xFF) as usize]
                ^ t0[(four >> 24) as usize];
        }
        self.0 = crc;
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
    fn update_byte(&mut self, byte: u8) {
        self.0 = CRC_TABLES[0][usize::from(self.0 as u8 ^ byte)] ^ self.0 >> 8;
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
