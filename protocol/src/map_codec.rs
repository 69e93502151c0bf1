//! A force map cut into self-contained packets that the receiver can work on as they land.
//!
//! Little-endian, no varints. The head packet is always 64 bytes: header, sequence u32, capture time u32 (µs),
//! contents u16 (number of taxels in bits 0–8, [`Health`] in bits 9–15), bitmap of 400 bits. Then full packets of ten
//! taxels, then the tail with the last 0–9 taxels and the CRC-32 of every byte before it, packet headers included.
//! A taxel is sent when any of its components is not zero, so every map survives the trip.

use crate::constants::{
    BITMAP_BYTES, CRC_BYTES, PACKET_HEADER, PACKET_MAX, TAXEL_BYTES, TAXELS, TAXELS_PER_PACKET,
};
use crate::force_map::{ActiveSet, ForceMap, TaxelForce};
use crate::packet::{Header, Kind, RunningCrc};

/// What the host knows about the picture behind a map; any flag set makes the map doubtful.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Health(u8);

impl Health {
    /// Nothing to report.
    pub const GOOD: Self = Self(0);
    /// The picture is darker than the network was trained for.
    pub const TOO_DARK: Self = Self(1);
    /// The picture is brighter than the network was trained for.
    pub const TOO_BRIGHT: Self = Self(1 << 1);
    /// The picture is unlike anything in training.
    pub const UNLIKE_TRAINING: Self = Self(1 << 2);
    /// Particles could not be found again.
    pub const PARTICLES_LOST: Self = Self(1 << 3);
    /// Some forces did not fit ±8 N.
    pub const SATURATED: Self = Self(1 << 4);
    const MASK: u8 = 0x7F;

    /// The lower seven bits of a byte.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits & Self::MASK)
    }

    /// The flags as bits.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Both sets of flags.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// These flags but those of `other`.
    #[must_use]
    pub const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Whether every flag of `other` is set.
    #[must_use]
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// No flag is set.
    #[must_use]
    pub const fn is_good(self) -> bool {
        self.0 == 0
    }
}

/// What travels with a map besides its forces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MapInfo {
    /// Which fingertip, 0 or 1.
    pub sensor: u8,
    /// Number of the map, one more than that of the map before; wraps.
    pub sequence: u32,
    /// When the picture was taken, microseconds of the host's clock; wraps after 71 minutes.
    pub capture_us: u32,
    /// What the host knows against this map.
    pub health: Health,
}

pub(crate) const HEAD_BYTES: usize = PACKET_HEADER + 4 + 4 + 2 + BITMAP_BYTES;
const _: () = assert!(HEAD_BYTES == PACKET_MAX);

/// Bytes on the wire of a map with so many active taxels, packet headers included.
#[must_use]
pub const fn map_bytes(active: usize) -> usize {
    let (full, rest) = (active / TAXELS_PER_PACKET, active % TAXELS_PER_PACKET);
    HEAD_BYTES
        + full * (PACKET_HEADER + TAXELS_PER_PACKET * TAXEL_BYTES)
        + PACKET_HEADER
        + rest * TAXEL_BYTES
        + CRC_BYTES
}

// The bounds of DESIGN.md, and the 42 packets behind "450 dense maps a second at 19 packets per millisecond".
const _: () = assert!(map_bytes(TAXELS) <= 2_720 && map_bytes(100) <= 740);
const _: () = assert!(map_bytes(TAXELS).div_ceil(PACKET_MAX) == 42);

/// Cuts a map into packets and hands each of them, at most 64 bytes, to `send` in order.
pub fn encode_map(info: &MapInfo, map: &ForceMap, mut send: impl FnMut(&[u8])) {
    let active = map.active();
    let count = active.count();
    let mut crc = RunningCrc::new();
    let mut packet = PacketBuffer::new(info, Kind::MapHead, 0);
    packet.put(&info.sequence.to_le_bytes());
    packet.put(&info.capture_us.to_le_bytes());
    packet.put(&(count | u16::from(info.health.bits()) << 9).to_le_bytes());
    packet.put(active.as_bytes());
    crc.update(packet.bytes());
    send(packet.bytes());

    let mut index = 1;
    packet = PacketBuffer::new(info, Kind::MapTaxels, index);
    for force in map.taxels.iter().filter(|force| **force != TaxelForce::ZERO) {
        for component in [force.x, force.y, force.z] {
            packet.put(&component.to_le_bytes());
        }
        if packet.length == PACKET_MAX {
            crc.update(packet.bytes());
            send(packet.bytes());
            index += 1;
            packet = PacketBuffer::new(info, Kind::MapTaxels, index);
        }
    }
    packet.set_kind(Kind::MapTail);
    crc.update(packet.bytes());
    packet.put(&crc.finish().to_le_bytes());
    send(packet.bytes());
}

struct PacketBuffer {
    bytes: [u8; PACKET_MAX],
    length: usize,
}

impl PacketBuffer {
    fn new(info: &MapInfo, kind: Kind, index: u8) -> Self {
        let header = Header {
            kind,
            owner: info.sensor,
            sequence: info.sequence as u8,
            index,
        };
        let mut buffer = Self {
            bytes: [0; PACKET_MAX],
            length: 0,
        };
        buffer.put(&header.to_bytes());
        buffer
    }

    fn put(&mut self, bytes: &[u8]) {
        // Every caller stays within 64 bytes by the constants above.
        self.bytes[self.length..self.length + bytes.len()].copy_from_slice(bytes);
        self.length += bytes.len();
    }

    fn set_kind(&mut self, kind: Kind) {
        self.bytes[0] = self.bytes[0] & 0xF0 | kind as u8;
    }

    fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

/// The head packet's contents after the header. The count is what it says, not yet compared with the set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Head {
    pub(crate) info: MapInfo,
    pub(crate) count: u16,
    pub(crate) active: ActiveSet,
}

impl Head {
    /// Reads the payload of a head packet.
    pub(crate) fn from_payload(sensor: u8, payload: &[u8; PACKET_MAX - PACKET_HEADER]) -> Option<Self> {
        let (sequence, rest) = payload.split_first_chunk::<4>()?;
        let (capture, rest) = rest.split_first_chunk::<4>()?;
        let (contents, rest) = rest.split_first_chunk::<2>()?;
        let bitmap: &[u8; BITMAP_BYTES] = rest.try_into().ok()?;
        let contents = u16::from_le_bytes(*contents);
        let active = ActiveSet::from_bytes(*bitmap);
        let count = contents & 0x1FF;
        let info = MapInfo {
            sensor,
            sequence: u32::from_le_bytes(*sequence),
            capture_us: u32::from_le_bytes(*capture),
            health: Health::from_bits((contents >> 9) as u8),
        };
        Some(Self { info, count, active })
    }
}
