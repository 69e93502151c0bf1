//! The receiving end of one link for maps: constant work per packet, nothing but bounds that hold for any input.

use super::event::Forces;
use crate::constants::{
    BITMAP_BYTES, CRC_BYTES, PACKET_HEADER, PACKET_MAX, TAXEL_BYTES, TAXELS, TAXELS_PER_PACKET,
};
use crate::crc::RunningCrc;
use crate::force_map::{ActiveSet, Listed, Place};
use crate::map_codec::{Head, MapInfo};
use crate::packet::{Header, PacketError, wrong_length};
use crate::sensor_id::SensorId;

/// The receiving end of one link for maps alone.
#[derive(Debug)]
pub struct MapParser {
    map: Option<MapInProgress>,
    /// Sensor and the lowest byte of the sequence number of the map that the last refused packet ended.
    ended: Option<(u8, u8)>,
    /// Places of the active taxels of the map in progress, ascending.
    places: [Place; TAXELS],
    refused: u32,
    abandoned: u32,
}

#[derive(Debug, Clone)]
struct MapInProgress {
    info: MapInfo,
    next_index: u8,
    /// Taxels received so far, and in the whole map.
    received: u16,
    count: u16,
    crc: RunningCrc,
    active: ActiveSet,
    /// The taxels' places are written so far.
    listed: Listed,
}

/// Bytes of a map's bitmap that [`MapParser::list_places`] works on: nine calls for all, as many as bytes come between a head and the end of the
/// shortest last packet.
const BYTES_AT_ONCE: usize = 6;

impl Default for MapParser {
    fn default() -> Self {
        Self::new()
    }
}

impl MapParser {
    /// A parser before its first packet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            map: None,
            ended: None,
            places: [Place::new(0, 0); TAXELS],
            refused: 0,
            abandoned: 0,
        }
    }

    /// Packets refused since the start, whatever the reason; wraps.
    #[must_use]
    pub const fn refused(&self) -> u32 {
        self.refused
    }

    /// Maps that began but never ended; wraps.
    #[must_use]
    pub const fn abandoned(&self) -> u32 {
        self.abandoned
    }

    /// Counts a packet that another receiver refused, and drops the map in progress.
    pub fn refuse(&mut self) {
        self.refused = self.refused.wrapping_add(1);
        self.drop_map();
    }

    /// Drops the map in progress: its remaining packets will be refused.
    pub fn drop_map(&mut self) {
        let map = self.map.as_ref();
        self.ended = map.map(|map| (map.info.sensor.number(), map.info.sequence as u8));
        self.map = None;
    }

    /// The map that [`Self::drop_map`] or the last refused packet ended, if one was in progress: its sensor and the lowest byte of its
    /// sequence number.
    #[must_use]
    pub const fn ended(&self) -> Option<(u8, u8)> {
        self.ended
    }

    /// The map in progress and the number of its taxels.
    pub(super) fn in_progress(&self) -> (MapInfo, u16) {
        self.map
            .as_ref()
            .map_or_else(Default::default, |map| (map.info, map.count))
    }

    /// Refuses a packet of no [`Kind`](crate::packet::Kind), and says why.
    pub fn unknown(&mut self, packet: &[u8]) -> PacketError {
        self.refuse();
        match packet.first() {
            Some(&found) if packet.len() >= PACKET_HEADER => PacketError::Version { found },
            _ => wrong_length(packet, PACKET_HEADER),
        }
    }

    /// Takes the first packet of a map. Returns whether it cuts another map off.
    ///
    /// # Errors
    /// [`PacketError`] when this is not a head; the map in progress is dropped, as with every error here.
    #[inline]
    pub fn head(&mut self, packet: &[u8]) -> Result<bool, PacketError> {
        let accepted = self.map_head(packet).and_then(|abandoned| {
            self.list::<BITMAP_BYTES>()?;
            Ok(abandoned)
        });
        self.accepted(accepted)
    }

    /// The same; the places of its taxels are left to [`Self::list_places`], which has to be done with them before the next packet ends. For
    /// a link that brings byte by byte, and must not wait as long as they take.
    ///
    /// # Errors
    /// As [`Self::head`]; a bitmap of another number of taxels than the head says is refused with the next packet.
    #[inline]
    pub fn begin(&mut self, packet: &[u8]) -> Result<bool, PacketError> {
        let accepted = self.map_head(packet);
        self.accepted(accepted)
    }

    /// Whether [`Self::list_places`] has something to do.
    #[inline]
    #[must_use]
    pub fn has_places_to_list(&self) -> bool {
        self.map.as_ref().is_some_and(|map| !map.listed.is_done())
    }

    /// A ninth of what [`Self::begin`] has left.
    #[inline]
    pub fn list_places(&mut self) {
        if self.list::<BYTES_AT_ONCE>().is_err() {
            self.refuse();
        }
    }

    /// Goes on with the list of places. Checks their number when it is done.
    #[inline]
    fn list<const BYTES: usize>(&mut self) -> Result<(), PacketError> {
        let Some(map) = &mut self.map else { return Ok(()) };
        map.active.list::<BYTES>(&mut map.listed, &mut self.places);
        if map.listed.is_done() && map.listed.count != usize::from(map.count) {
            self.map = None;
            return Err(PacketError::Contents);
        }
        Ok(())
    }

    #[inline]
    fn accepted(&mut self, accepted: Result<bool, PacketError>) -> Result<bool, PacketError> {
        match accepted {
            Ok(abandoned) => self.abandoned = self.abandoned.wrapping_add(u32::from(abandoned)),
            Err(_) => self.refuse(),
        }
        accepted
    }

    /// Takes a full packet in the middle of a map.
    ///
    /// # Errors
    /// [`PacketError`] when it is not the packet expected next.
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

    /// Takes the last packet of a map. `Ok` means that the whole map is right.
    ///
    /// # Errors
    /// [`PacketError`] when it is not the packet expected next, or when the CRC is wrong.
    #[inline]
    pub fn tail<'a>(&'a mut self, packet: &'a [u8]) -> Result<(MapInfo, Forces<'a>), PacketError> {
        match self.map_tail(packet) {
            Ok((info, first, bytes)) => Ok((info, self.forces(first, bytes))),
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
        let sensor = SensorId::try_from(header.owner).map_err(PacketError::Sensor)?;
        if header.index != 0 {
            return Err(PacketError::Order {
                found: header.index,
                expected: 0,
            });
        }
        let head = Head::from_payload((header, sensor), payload).ok_or(PacketError::Contents)?;
        let mut crc = RunningCrc::new();
        crc.update(packet);
        self.map = Some(MapInProgress {
            info: head.info,
            next_index: 1,
            received: 0,
            count: head.count,
            crc,
            active: head.active,
            listed: Listed::default(),
        });
        Ok(abandoned)
    }

    /// The map in progress, if this packet is its next and brings no more taxels than are left.
    #[inline]
    fn continued(&mut self, header: Header, taxels: usize) -> Result<&mut MapInProgress, PacketError> {
        let found = header.index;
        let Some(map) = &mut self.map else {
            return Err(PacketError::Order { found, expected: 0 });
        };
        let expected = map.next_index;
        let same_map = header.owner == map.info.sensor.number() && header.sequence == map.info.sequence as u8;
        if !same_map
            || found != expected
            || !map.listed.is_done()
            || usize::from(map.count - map.received) < taxels
        {
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
        const MIN: usize = PACKET_HEADER + CRC_BYTES;
        let (covered, crc) = packet
            .split_last_chunk::<CRC_BYTES>()
            .ok_or_else(|| wrong_length(packet, MIN))?;
        let (header, payload) = Header::split(covered)?;
        let (bytes, rest) = payload.as_chunks();
        if bytes.len() >= TAXELS_PER_PACKET || !rest.is_empty() {
            return Err(wrong_length(packet, MIN));
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
