//! The receiving end of one link for maps: the map in progress, its sums, and which broken map has been counted.

use gripline_protocol::message::Configuration;
use gripline_protocol::packet::{Header, Kind};
use gripline_protocol::{MapInfo, MapParser, PacketError};

use crate::sums::{Accumulator, Kernel, TaxelRule};

/// What a refused packet means for the count of a CRC storm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Breakage {
    /// A map that is broken now.
    Map,
    /// A packet that belongs to no map.
    Packet,
    /// The rest of a map that was already counted.
    Counted,
}

/// The map whose packets are refused without being counted again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Broken {
    #[default]
    None,
    /// A frame without a readable header, when no map was under way: the first packet of the next map, perhaps.
    Unknown,
    /// Sensor and the lowest byte of the sequence number.
    Map(u8, u8),
}

/// The receiving end of one link for maps.
#[derive(Debug)]
pub(super) struct Receiver {
    maps: MapParser,
    /// Sums of the map in progress; void until its CRC is known to be right.
    partial: Accumulator,
    broken: Broken,
}

impl Receiver {
    pub(super) const fn new(settings: &Configuration) -> Self {
        Self {
            maps: MapParser::new(),
            partial: Accumulator::new(TaxelRule::of(settings)),
            broken: Broken::None,
        }
    }

    /// The sums of the map that just ended.
    pub(super) const fn partial(&self) -> &Accumulator {
        &self.partial
    }

    /// Takes the first packet of a map. `Ok` tells whether it cuts off a map that was not counted as broken yet.
    #[inline]
    pub(super) fn head(&mut self, packet: &[u8], rule: TaxelRule) -> Result<bool, Breakage> {
        let begun = self.maps.head(packet);
        self.begun(begun, packet, rule)
    }

    /// The same; [`Self::list_places`] completes the work.
    #[inline]
    pub(super) fn begin(&mut self, packet: &[u8], rule: TaxelRule) -> Result<bool, Breakage> {
        let begun = self.maps.begin(packet);
        self.begun(begun, packet, rule)
    }

    #[inline]
    pub(super) fn has_places_to_list(&self) -> bool {
        self.maps.has_places_to_list()
    }

    /// A part of the work that [`Self::begin`] left.
    #[inline(never)]
    pub(super) fn list_places(&mut self) {
        self.maps.list_places();
    }

    #[inline]
    fn begun(
        &mut self,
        begun: Result<bool, PacketError>,
        packet: &[u8],
        rule: TaxelRule,
    ) -> Result<bool, Breakage> {
        let Ok(abandoned) = begun else {
            return Err(self.breakage(packet));
        };
        self.partial = Accumulator::new(rule);
        self.broken = Broken::None;
        Ok(abandoned)
    }

    /// Takes a packet in the middle of a map.
    #[inline]
    pub(super) fn taxels<K: Kernel>(&mut self, packet: &[u8]) -> Result<(), Breakage> {
        match self.maps.taxels(packet) {
            Ok(forces) => {
                K::add(&mut self.partial, forces.places(), forces.bytes());
                Ok(())
            }
            Err(_) => Err(self.breakage(packet)),
        }
    }

    /// Takes the last packet of a map.
    #[inline]
    pub(super) fn tail<K: Kernel>(&mut self, packet: &[u8]) -> Result<MapInfo, Breakage> {
        match self.maps.tail(packet) {
            Ok((info, forces)) => {
                K::add(&mut self.partial, forces.places(), forces.bytes());
                Ok(info)
            }
            Err(_) => Err(self.breakage(packet)),
        }
    }

    /// Takes a packet without a readable header.
    pub(super) fn unknown(&mut self, packet: &[u8]) -> Breakage {
        self.maps.unknown(packet);
        self.unreadable()
    }

    /// Counts a frame or a fragment that was refused before it came here.
    pub(super) fn refuse(&mut self) -> Breakage {
        self.maps.refuse();
        self.unreadable()
    }

    /// What a refused packet without a readable header means: the end of the map that was under way, if one was.
    fn unreadable(&mut self) -> Breakage {
        if let Some((sensor, sequence)) = self.maps.ended() {
            self.broken = Broken::Map(sensor, sequence);
            return Breakage::Map;
        }
        if self.broken == Broken::None {
            self.broken = Broken::Unknown;
        }
        Breakage::Packet
    }

    /// Drops the map in progress without counting it as broken.
    pub(super) fn drop_map(&mut self) {
        self.maps.drop_map();
        if let Some((sensor, sequence)) = self.maps.ended() {
            self.broken = Broken::Map(sensor, sequence);
        }
    }

    /// Maps that did not arrive completely; wraps.
    pub(super) const fn maps_broken(&self) -> u32 {
        self.maps.refused().wrapping_add(self.maps.abandoned())
    }

    /// Packets refused; wraps.
    pub(super) const fn refused(&self) -> u32 {
        self.maps.refused()
    }

    /// What a refused packet of a map means. One lost packet makes all later ones of its map wrong: they count once, beside the frame in
    /// the place of its first packet, if that could not be read.
    #[cold]
    fn breakage(&mut self, packet: &[u8]) -> Breakage {
        let Ok((header, _)) = Header::split(packet) else {
            return self.unreadable();
        };
        let map = Broken::Map(header.owner, header.sequence);
        let was = core::mem::replace(&mut self.broken, map);
        if header.kind != Kind::MapHead && was == map {
            Breakage::Counted
        } else {
            Breakage::Map
        }
    }
}
