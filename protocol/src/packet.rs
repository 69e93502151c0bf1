//! The four bytes in front of every packet, and why a packet is refused.
//!
//! | byte | map packets | message packets |
//! |---|---|---|
//! | 0 | version (upper half), kind (lower half) | the same |
//! | 1 | sensor | message id |
//! | 2 | lowest byte of the map's sequence number | number of fragments |
//! | 3 | index of the packet in the map | index of the fragment |

use core::fmt;

use crate::constants::{PACKET_HEADER, PACKET_MAX, WIRE_VERSION};
use crate::sensor_id::UnknownSensor;

/// One packet as it crosses the wire, at most 64 bytes.
pub type Packet = heapless::Vec<u8, PACKET_MAX>;

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

/// Version in the upper half, kind in the lower.
const fn first_byte(kind: Kind) -> u8 {
    WIRE_VERSION << 4 | kind as u8
}

/// A packet's first four bytes, decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
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
    ///
    /// # Errors
    /// [`PacketError::Length`] when it is too short for a header, [`PacketError::Version`] when its first byte is none of ours.
    #[inline]
    pub fn split(packet: &[u8]) -> Result<(Self, &[u8]), PacketError> {
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

/// Why a packet was refused. The map or message it belonged to is void.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PacketError {
    /// Shorter than its kind allows, or longer than 64 bytes.
    Length {
        /// Bytes found.
        found: u16,
        /// Bytes expected; the smallest allowed where there is a range.
        expected: u16,
    },
    /// Another packet layout, or no packet of ours.
    Version {
        /// The packet's first byte.
        found: u8,
    },
    /// A sensor that does not exist.
    Sensor(UnknownSensor),
    /// A head whose number of taxels and bitmap disagree.
    Contents,
    /// Not the packet that had to come next: lost, doubled or reordered.
    Order {
        /// Index found.
        found: u8,
        /// Index expected; 0 when nothing was under way.
        expected: u8,
    },
    /// The CRC at the end of a map or message is wrong.
    Crc,
}

impl fmt::Display for PacketError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Length { found, expected } => write!(f, "packet of {found} bytes, expected {expected}"),
            Self::Version { found } => write!(
                f,
                "packet starts with {found:#04x}: expected wire version {WIRE_VERSION} and a known kind; \
                 flash the firmware that belongs to this host"
            ),
            Self::Sensor(unknown) => unknown.fmt(f),
            Self::Contents => f.write_str("map head whose taxel count and bitmap disagree"),
            Self::Order { found, expected } => {
                write!(f, "packet {found} of a map or message, expected {expected}")
            }
            Self::Crc => f.write_str("CRC-32 does not match"),
        }
    }
}

impl core::error::Error for PacketError {}

/// The error of a packet whose length does not fit its kind.
pub(crate) const fn wrong_length(packet: &[u8], expected: usize) -> PacketError {
    PacketError::Length {
        found: packet.len() as u16,
        expected: expected as u16,
    }
}
