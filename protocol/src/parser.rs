//! Packets in, events out. Sans-IO: no allocation, no panic on any input, constant work per packet.
//!
//! The forces of a map are handed on packet by packet, before the CRC is known: a receiver must treat them as
//! provisional until [`Event::MapEnd`] says that the map arrived whole, and drop them on any error.
//! Limits: maps and messages do not interleave with a second map on the same link (they never do; see `encode_map`).

use core::fmt;

use crate::constants::{
    CRC_BYTES, MESSAGE_FRAGMENTS_MAX, MESSAGE_MAX, PACKET_HEADER, PACKET_MAX, SENSORS, TAXEL_BYTES, TAXELS,
    TAXELS_PER_PACKET, WIRE_VERSION,
};
use crate::force_map::{Place, TaxelForce};
use crate::map_codec::{Head, MapInfo};
use crate::packet::{Header, Kind, RunningCrc};

/// What a packet meant.
#[derive(Debug)]
pub enum Event<'a> {
    /// A map begins. Anything provisional of an earlier map is void.
    MapStart {
        /// Sensor, sequence, time, health.
        info: MapInfo,
        /// Taxels that will follow.
        active: u16,
        /// The map before this one never ended: a packet was lost or a head was doubled.
        abandoned: bool,
    },
    /// Forces in the middle of a map: provisional.
    MapForces(Forces<'a>),
    /// The last forces of a map, and the CRC over all of it is right.
    MapEnd {
        /// Sensor, sequence, time, health.
        info: MapInfo,
        /// Up to nine taxels.
        forces: Forces<'a>,
    },
    /// A fragment of a message that is not complete yet.
    Fragment,
    /// A message whose CRC is right; see [`crate::message`].
    Message(&'a [u8]),
}

/// Forces of consecutive active taxels, as they stand in a packet.
#[derive(Debug, Clone, Copy)]
pub struct Forces<'a> {
    places: &'a [Place],
    bytes: &'a [[u8; TAXEL_BYTES]],
}

impl<'a> Forces<'a> {
    /// Where the taxels are, at least as many as [`Forces::bytes`] has.
    #[inline]
    #[must_use]
    pub fn places(&self) -> &'a [Place] {
        self.places
    }

    /// The taxels' forces as they stand in the packet: x, y, z, little-endian.
    #[inline]
    #[must_use]
    pub fn bytes(&self) -> &'a [[u8; TAXEL_BYTES]] {
        self.bytes
    }

    /// (taxel number `row * 20 + column`, force), in ascending order.
    #[inline]
    #[must_use]
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (u16, TaxelForce)> {
        self.places
            .iter()
            .zip(self.bytes)
            .map(|(place, bytes)| (place.taxel(), TaxelForce::from_le_bytes(*bytes)))
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
    Sensor {
        /// The sensor's number; 0 and 1 exist.
        found: u8,
    },
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
            Self::Sensor { found } => write!(f, "sensor {found}, expected 0 to {}", SENSORS - 1),
            Self::Contents => f.write_str("map head whose taxel count and bitmap disagree"),
            Self::Order { found, expected } => {
                write!(f, "packet {found} of a map or message, expected {expected}")
            }
            Self::Crc => f.write_str("CRC-32 does not match"),
        }
    }
}

impl core::error::Error for PacketError {}

/// What the parser has seen since it was made; every counter wraps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counters {
    /// Maps whose CRC was right.
    pub maps: u32,
    /// Messages whose CRC was right.
    pub messages: u32,
    /// Packets refused, whatever the reason.
    pub refused: u32,
    /// Maps and messages that began but never ended.
    pub abandoned: u32,
}

/// The receiving end of one link.
#[derive(Debug)]
pub struct Parser {
    map: Option<MapUnderWay>,
    /// Places of the active taxels of the map under way, ascending.
    places: [Place; TAXELS],
    messages: MessageParser,
    counters: Counters,
}

/// The receiving end of one link for messages alone, of a board that works on maps elsewhere.
#[derive(Debug)]
pub struct MessageParser {
    message: Option<MessageUnderWay>,
    buffer: [u8; MESSAGE_MAX],
    abandoned: u32,
}

#[derive(Debug, Clone)]
struct MapUnderWay {
    info: MapInfo,
    next_index: u8,
    /// Taxels received so far, and in all.
    received: u16,
    count: u16,
    crc: RunningCrc,
}

#[derive(Debug, Clone)]
struct MessageUnderWay {
    id: u8,
    fragments: u8,
    next_index: u8,
    length: u16,
    crc: RunningCrc,
}

impl Default for Parser {
    fn default() -> Self {
        Self::new()
    }
}

impl Parser {
    /// Nothing under way.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            map: None,
            places: [Place::new(0, 0); TAXELS],
            messages: MessageParser::new(),
            counters: Counters {
                maps: 0,
                messages: 0,
                refused: 0,
                abandoned: 0,
            },
        }
    }

    /// What was seen so far.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        Counters {
            abandoned: self.counters.abandoned.wrapping_add(self.messages.abandoned),
            ..self.counters
        }
    }

    /// Counts a packet that the transport itself had to refuse (overlong or malformed COBS frame) and drops the map
    /// and message under way.
    pub fn refuse(&mut self) {
        self.counters.refused = self.counters.refused.wrapping_add(1);
        self.map = None;
        self.messages.message = None;
    }

    /// Drops the map under way: its remaining packets will be refused.
    pub fn drop_map(&mut self) {
        self.map = None;
    }

    /// Takes one packet as it landed: [`Parser::head`], [`Parser::taxels`], [`Parser::tail`] or [`Parser::fragment`].
    ///
    /// # Errors
    /// [`PacketError`] when the packet is not what had to come next. The map or message under way is dropped, and the
    /// next head or first fragment starts afresh.
    pub fn push<'a>(&'a mut self, packet: &'a [u8]) -> Result<Event<'a>, PacketError> {
        match Kind::of(packet) {
            Some(Kind::MapHead) => {
                let abandoned = self.head(packet)?;
                let (info, active) = self
                    .map
                    .as_ref()
                    .map_or_else(Default::default, |map| (map.info, map.count));
                Ok(Event::MapStart {
                    info,
                    active,
                    abandoned,
                })
            }
            Some(Kind::MapTaxels) => self.taxels(packet).map(Event::MapForces),
            Some(Kind::MapTail) => {
                let (info, forces) = self.tail(packet)?;
                Ok(Event::MapEnd { info, forces })
            }
            Some(Kind::Message) => Ok(self.fragment(packet)?.map_or(Event::Fragment, Event::Message)),
            None => Err(self.unknown(packet)),
        }
    }

    /// Refuses a packet of no [`Kind`], and says why.
    pub fn unknown(&mut self, packet: &[u8]) -> PacketError {
        self.refuse();
        match packet.first() {
            Some(_) if packet.len() < PACKET_HEADER => wrong_length(packet, PACKET_HEADER),
            Some(&found) => PacketError::Version { found },
            None => wrong_length(packet, PACKET_HEADER),
        }
    }

    /// Takes the first packet of a map; whether it cuts another one off.
    ///
    /// # Errors
    /// As [`Parser::push`].
    #[inline]
    pub fn head(&mut self, packet: &[u8]) -> Result<bool, PacketError> {
        let accepted = self.map_head(packet);
        match accepted {
            Ok(abandoned) => {
                self.counters.abandoned = self.counters.abandoned.wrapping_add(u32::from(abandoned));
            }
            Err(_) => self.refuse(),
        }
        accepted
    }

    /// Takes a full packet in the middle of a map.
    ///
    /// # Errors
    /// As [`Parser::push`].
    #[inline]
    pub fn taxels<'a>(&'a mut self, packet: &'a [u8]) -> Result<Forces<'a>, PacketError> {
        match self.map_taxels(packet) {
            Ok((first, bytes)) => Ok(self.forces(first, bytes)),
            Err(error) => {
                self.refuse();
                Err(error)
            }
        }
    }

    /// Takes the last packet of a map, which is right as a whole when this is `Ok`.
    ///
    /// # Errors
    /// As [`Parser::push`].
    #[inline]
    pub fn tail<'a>(&'a mut self, packet: &'a [u8]) -> Result<(MapInfo, Forces<'a>), PacketError> {
        match self.map_tail(packet) {
            Ok((info, first, bytes)) => {
                self.counters.maps = self.counters.maps.wrapping_add(1);
                Ok((info, self.forces(first, bytes)))
            }
            Err(error) => {
                self.refuse();
                Err(error)
            }
        }
    }

    /// Takes a fragment of a message; the message once it is whole.
    ///
    /// # Errors
    /// As [`Parser::push`].
    pub fn fragment(&mut self, packet: &[u8]) -> Result<Option<&[u8]>, PacketError> {
        match self.messages.take(packet) {
            Ok(None) => Ok(None),
            Ok(Some(length)) => {
                self.counters.messages = self.counters.messages.wrapping_add(1);
                Ok(Some(self.messages.whole(length)))
            }
            Err(error) => {
                self.refuse();
                Err(error)
            }
        }
    }

    #[inline]
    fn forces<'a>(&'a self, first: usize, bytes: &'a [[u8; TAXEL_BYTES]]) -> Forces<'a> {
        Forces {
            places: self.places.get(first..).unwrap_or_default(),
            bytes,
        }
    }

    #[inline]
    fn map_head(&mut self, packet: &[u8]) -> Result<bool, PacketError> {
        let packet: &[u8; PACKET_MAX] = packet.try_into().map_err(|_| wrong_length(packet, PACKET_MAX))?;
        let (header, payload) = Header::split(packet)?;
        let payload = payload.try_into().map_err(|_| wrong_length(packet, PACKET_MAX))?;
        let abandoned = self.map.take().is_some();
        if usize::from(header.owner) >= SENSORS {
            return Err(PacketError::Sensor { found: header.owner });
        }
        if header.index != 0 {
            return Err(PacketError::Order {
                found: header.index,
                expected: 0,
            });
        }
        let head = Head::from_payload(header.owner, payload).ok_or(PacketError::Contents)?;
        if head.info.sequence as u8 != header.sequence {
            return Err(PacketError::Contents);
        }
        if head.active.places(&mut self.places) != head.count {
            return Err(PacketError::Contents);
        }
        let mut crc = RunningCrc::new();
        crc.update(packet);
        self.map = Some(MapUnderWay {
            info: head.info,
            next_index: 1,
            received: 0,
            count: head.count,
            crc,
        });
        Ok(abandoned)
    }

    /// The map under way, when this packet is the next of it and brings no more taxels than are left.
    #[inline]
    fn continued(&mut self, header: Header, taxels: usize) -> Result<&mut MapUnderWay, PacketError> {
        let found = header.index;
        let Some(map) = &mut self.map else {
            return Err(PacketError::Order { found, expected: 0 });
        };
        let expected = map.next_index;
        let same_map = header.owner == map.info.sensor && header.sequence == map.info.sequence as u8;
        if !same_map || found != expected || usize::from(map.count - map.received) < taxels {
            return Err(PacketError::Order { found, expected });
        }
        Ok(map)
    }

    #[inline]
    fn map_taxels<'p>(&mut self, packet: &'p [u8]) -> Result<(usize, &'p [[u8; TAXEL_BYTES]]), PacketError> {
        let whole: &[u8; PACKET_MAX] = packet.try_into().map_err(|_| wrong_length(packet, PACKET_MAX))?;
        let (header, payload) = Header::split(whole)?;
        let (bytes, _) = payload.as_chunks();
        let map = self.continued(header, bytes.len())?;
        map.crc.update(whole);
        map.next_index = map.next_index.wrapping_add(1);
        let first = usize::from(map.received);
        map.received += bytes.len() as u16;
        Ok((first, bytes))
    }

    #[inline]
    fn map_tail<'p>(
        &mut self,
        packet: &'p [u8],
    ) -> Result<(MapInfo, usize, &'p [[u8; TAXEL_BYTES]]), PacketError> {
        const LEAST: usize = PACKET_HEADER + CRC_BYTES;
        let (covered, crc) = packet
            .split_last_chunk::<CRC_BYTES>()
            .ok_or_else(|| wrong_length(packet, LEAST))?;
        let (header, payload) = Header::split(covered)?;
        let (bytes, rest) = payload.as_chunks();
        if bytes.len() >= TAXELS_PER_PACKET || !rest.is_empty() {
            return Err(wrong_length(packet, LEAST));
        }
        let map = self.continued(header, bytes.len())?;
        let first = usize::from(map.received);
        if first + bytes.len() != usize::from(map.count) {
            return Err(PacketError::Order {
                found: header.index,
                expected: map.next_index,
            });
        }
        map.crc.update(covered);
        let (info, found) = (map.info, map.crc.finish());
        self.map = None;
        if found != u32::from_le_bytes(*crc) {
            return Err(PacketError::Crc);
        }
        Ok((info, first, bytes))
    }
}

impl Default for MessageParser {
    fn default() -> Self {
        Self::new()
    }
}

impl MessageParser {
    /// Nothing under way.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            message: None,
            buffer: [0; MESSAGE_MAX],
            abandoned: 0,
        }
    }

    /// Takes a packet of [`Kind::Message`]; the message once it is whole.
    ///
    /// # Errors
    /// As [`Parser::push`]; the message under way is dropped.
    pub fn push(&mut self, packet: &[u8]) -> Result<Option<&[u8]>, PacketError> {
        Ok(self.take(packet)?.map(|length| self.whole(length)))
    }

    fn whole(&self, length: usize) -> &[u8] {
        self.buffer.get(..length).unwrap_or_default()
    }

    /// The length of the message, once it is whole.
    fn take(&mut self, packet: &[u8]) -> Result<Option<usize>, PacketError> {
        if packet.len() > PACKET_MAX {
            return Err(wrong_length(packet, PACKET_MAX));
        }
        let (header, payload) = Header::split(packet)?;
        if payload.is_empty() {
            return Err(wrong_length(packet, PACKET_HEADER + 1));
        }
        let (id, fragments, found) = (header.owner, header.sequence, header.index);
        let mut message = match self.message.take() {
            // A first fragment always starts afresh, so that a lost last one costs one message only.
            unfinished if found == 0 => {
                self.abandoned = self.abandoned.wrapping_add(unfinished.is_some().into());
                MessageUnderWay {
                    id,
                    fragments,
                    next_index: 0,
                    length: 0,
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
        {
            return Err(PacketError::Order { found, expected });
        }
        let start = usize::from(message.length);
        let end = start + payload.len();
        // Every fragment but the last is full and there are four at most: it always fits.
        let Some(place) = self.buffer.get_mut(start..end) else {
            return Err(PacketError::Order { found, expected });
        };
        place.copy_from_slice(payload);
        message.length = end as u16;
        message.next_index += 1;
        if !last {
            message.crc.update(packet);
            self.message = Some(message);
            return Ok(None);
        }
        // The CRC is the message's last four bytes and lies whole in the last fragment.
        let (covered, crc) = packet.split_last_chunk::<CRC_BYTES>().ok_or(PacketError::Crc)?;
        if payload.len() < CRC_BYTES {
            return Err(PacketError::Length {
                found: packet.len() as u16,
                expected: (PACKET_HEADER + CRC_BYTES) as u16,
            });
        }
        message.crc.update(covered);
        if message.crc.finish() != u32::from_le_bytes(*crc) {
            return Err(PacketError::Crc);
        }
        Ok(Some(end - CRC_BYTES))
    }
}

/// The packet has another length than its kind wants.
const fn wrong_length(packet: &[u8], expected: usize) -> PacketError {
    PacketError::Length {
        found: packet.len() as u16,
        expected: expected as u16,
    }
}
