//! A force map cut into self-contained packets, which the receiver can process as they arrive.
//!
//! Little-endian, no varints. The head packet is always 64 bytes: header with the sequence number's lowest byte, its other
//! three bytes, [`Motion`], capture time u32 (µs), contents u16 (number of taxels in bits 0–8, [`Health`] in bits 9–15), bitmap of 400 bits. Then full packets of ten
//! taxels, then the tail with the last 0–9 taxels and the CRC-32 of every byte before it, packet headers included.
//! A taxel is sent when any of its components is not zero, so every map survives the trip.

use crate::constants::{
    BITMAP_BYTES, CRC_BYTES, PACKET_HEADER, PACKET_MAX, TAXEL_BYTES, TAXELS, TAXELS_PER_PACKET,
};
use crate::crc::RunningCrc;
use crate::force_map::{ActiveSet, ForceMap, TaxelForce};
use crate::motion::Motion;
use crate::packet::{Header, Kind, Packet};
use crate::sensor_id::SensorId;

/// Health of the picture behind a map. Any flag makes the map doubtful.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Health(u8);

impl Health {
    /// No flag.
    pub const GOOD: Self = Self(0);
    /// The picture is darker than the network was trained for.
    pub const TOO_DARK: Self = Self(1);
    /// The picture is brighter than the network was trained for.
    pub const TOO_BRIGHT: Self = Self(1 << 1);
    /// The picture is unlike anything in training.
    pub const UNLIKE_TRAINING: Self = Self(1 << 2);
    /// Tracked particles were lost.
    pub const PARTICLES_LOST: Self = Self(1 << 3);
    /// Some forces exceeded ±8 N.
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

    /// These flags without those of `other`.
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

/// What a map carries besides its forces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MapInfo {
    /// Which fingertip.
    pub sensor: SensorId,
    /// Sequence number: one more than the previous map's; wraps.
    pub sequence: u32,
    /// When the picture was taken, microseconds of the host's clock; wraps after 71 minutes.
    pub capture_us: u32,
    /// Health of the picture.
    pub health: Health,
    /// Whether the object moves, as the picture shows it.
    pub motion: Motion,
}

pub(crate) const HEAD_BYTES: usize = PACKET_HEADER + 3 + 1 + 4 + 2 + BITMAP_BYTES;
const _: () = assert!(HEAD_BYTES == PACKET_MAX);

/// Bytes on the wire of a map with this number of active taxels, packet headers included.
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

/// Cuts a map into packets of at most 64 bytes and hands them to `send` in order.
pub fn encode_map(info: &MapInfo, map: &ForceMap, mut send: impl FnMut(&[u8])) {
    let active = map.active();
    let count = active.count();
    let mut crc = RunningCrc::new();
    let mut packet = packet_of(info, Kind::MapHead, 0);
    let [_, above_header @ ..] = info.sequence.to_le_bytes();
    put(&mut packet, &above_header);
    put(&mut packet, &[info.motion.bits()]);
    put(&mut packet, &info.capture_us.to_le_bytes());
    put(
        &mut packet,
        &(count | u16::from(info.health.bits()) << 9).to_le_bytes(),
    );
    put(&mut packet, active.as_bytes());
    crc.update(&packet);
    send(&packet);

    let mut index = 1;
    packet = packet_of(info, Kind::MapTaxels, index);
    for force in map.taxels.iter().filter(|force| **force != TaxelForce::ZERO) {
        put(&mut packet, &force.to_le_bytes());
        if packet.is_full() {
            crc.update(&packet);
            send(&packet);
            index += 1;
            packet = packet_of(info, Kind::MapTaxels, index);
        }
    }
    // The last packet is a tail: its kind is in the lower half of its first byte.
    packet[0] = packet[0] & 0xF0 | Kind::MapTail as u8;
    crc.update(&packet);
    put(&mut packet, &crc.finish().to_le_bytes());
    send(&packet);
}

/// A packet of a map with its header and nothing else.
fn packet_of(info: &MapInfo, kind: Kind, index: u8) -> Packet {
    let header = Header {
        kind,
        owner: info.sensor.number(),
        sequence: info.sequence as u8,
        index,
    };
    let mut packet = Packet::new();
    put(&mut packet, &header.to_bytes());
    packet
}

/// Appends bytes. By the constants above no packet of a map outgrows 64 bytes.
fn put(packet: &mut Packet, bytes: &[u8]) {
    let fits = packet.extend_from_slice(bytes);
    debug_assert!(fits.is_ok());
}

/// The head packet's contents after the header. `count` is not yet compared with `active`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Head {
    pub(crate) info: MapInfo,
    pub(crate) count: u16,
    pub(crate) active: ActiveSet,
}

impl Head {
    /// Reads the payload of a head packet after its header.
    // A call of its own hands the head over by copies of a length that the static bound cannot see: 5,243 instead of 3,157 cycles until the UART's
    // next byte is read, where 3,530 are allowed. Inlined it takes 387 instructions more a map.
    #[inline]
    pub(crate) fn from_payload(
        (header, sensor): (Header, SensorId),
        payload: &[u8; PACKET_MAX - PACKET_HEADER],
    ) -> Option<Self> {
        let (&[low, high, highest, motion], rest) = payload.split_first_chunk::<4>()?;
        let (capture, rest) = rest.split_first_chunk::<4>()?;
        let (contents, rest) = rest.split_first_chunk::<2>()?;
        let bitmap: &[u8; BITMAP_BYTES] = rest.try_into().ok()?;
        let contents = u16::from_le_bytes(*contents);
        let active = ActiveSet::from_bytes(*bitmap);
        let count = contents & 0x1FF;
        let info = MapInfo {
            sensor,
            sequence: u32::from_le_bytes([header.sequence, low, high, highest]),
            capture_us: u32::from_le_bytes(*capture),
            health: Health::from_bits((contents >> 9) as u8),
            motion: Motion::from_bits(motion),
        };
        Some(Self { info, count, active })
    }
}
