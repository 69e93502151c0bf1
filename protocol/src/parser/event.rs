//! What a packet of a link means to its receiver.
//!
//! The forces of a map come packet by packet, before the CRC is known. Treat them as provisional until
//! [`Event::MapEnd`], and drop them on any error.

use crate::constants::TAXEL_BYTES;
use crate::force_map::{Place, TaxelForce};
use crate::map_codec::MapInfo;

/// What a packet meant.
#[derive(Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
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
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Forces<'a> {
    pub(super) places: &'a [Place],
    pub(super) bytes: &'a [[u8; TAXEL_BYTES]],
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
