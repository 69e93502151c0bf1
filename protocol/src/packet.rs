//! The four bytes in front of every packet, and the CRC-32 that ends every map and every message.
//!
//! | byte | map packets | message packets |
//! |---|---|---|
//! | 0 | version (upper half), kind (lower half) | the same |
//! | 1 | sensor | message id |
//! | 2 | lowest byte of the map's sequence number | number of fragments |
//! | 3 | index of the packet in the map | index of the fragment |

use crc::{CRC_32_ISO_HDLC, Crc, Digest};

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

static CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// A CRC-32 under way, over every byte of a map or message in order, headers included.
#[derive(Clone)]
pub(crate) struct RunningCrc(Digest<'static, u32>);

impl RunningCrc {
    pub(crate) fn new() -> Self {
        Self(CRC.digest())
    }

    #[inline]
    pub(crate) fn update(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    #[inline]
    pub(crate) fn finish(self) -> u32 {
        self.0.finalize()
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

impl core::fmt::Debug for RunningCrc {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("RunningCrc")
    }
}
