//! The receiving end of one link: maps and messages, and a count of what was refused.

use super::event::Event;
use super::map::MapParser;
use super::message::MessageParser;
use crate::packet::{Kind, PacketError};

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
    maps: MapParser,
    messages: MessageParser,
    whole_maps: u32,
    whole_messages: u32,
}

impl Default for Parser {
    fn default() -> Self {
        Self::new()
    }
}

impl Parser {
    /// A parser before its first packet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            maps: MapParser::new(),
            messages: MessageParser::new(),
            whole_maps: 0,
            whole_messages: 0,
        }
    }

    /// What was seen so far.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        Counters {
            maps: self.whole_maps,
            messages: self.whole_messages,
            refused: self.maps.refused(),
            abandoned: self.maps.abandoned().wrapping_add(self.messages.abandoned()),
        }
    }

    /// Counts a packet that the transport refused (overlong or malformed COBS frame). Drops the map and the message in
    /// progress.
    pub fn refuse(&mut self) {
        self.maps.refuse();
        self.messages.drop_message();
    }

    /// Takes one packet as it arrived.
    ///
    /// # Errors
    /// [`PacketError`] when this is not the packet expected next. The map and the message in progress are dropped; the
    /// next head or first fragment starts afresh.
    pub fn push<'a>(&'a mut self, packet: &'a [u8]) -> Result<Event<'a>, PacketError> {
        let event = match Kind::of(packet) {
            Some(Kind::MapHead) => self.maps.head(packet).map(|abandoned| {
                let (info, active) = self.maps.in_progress();
                Event::MapStart {
                    info,
                    active,
                    abandoned,
                }
            }),
            Some(Kind::MapTaxels) => self.maps.taxels(packet).map(Event::MapForces),
            Some(Kind::MapTail) => self.maps.tail(packet).map(|(info, forces)| {
                self.whole_maps = self.whole_maps.wrapping_add(1);
                Event::MapEnd { info, forces }
            }),
            Some(Kind::Message) => return self.message(packet),
            None => Err(self.maps.unknown(packet)),
        };
        event.inspect_err(|_| self.messages.drop_message())
    }

    fn message(&mut self, packet: &[u8]) -> Result<Event<'_>, PacketError> {
        let message = self.messages.push(packet).inspect_err(|_| self.maps.refuse())?;
        self.whole_messages = self.whole_messages.wrapping_add(message.is_some().into());
        Ok(message.map_or(Event::Fragment, Event::Message))
    }
}
