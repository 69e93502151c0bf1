//! What crosses the wire between host and microcontroller, and nothing else.
//!
//! - [`force_map`]: the 20×20×3 map in 1/4096 N and its conversion from newtons.
//! - [`packet`]: packets of at most 64 bytes, which every transport carries; [`crc`]: the check at the end.
//! - [`map_codec`]: a map cut into packets, each of which can be processed as it arrives.
//! - [`message`]: commands, status, handshake. [`SensorId`]: the number of a fingertip.
//! - [`configuration`]: all settings and their ranges; [`mod@line`]: those of the grip-force line.
//! - [`parser`]: bytes in, events out; one parser for USB, UART and the in-process link.
//! - [`cobs`]: packets in a byte stream. [`rounds`]: loops that say how often they run at most.
//!
//! No allocation, no IO, and no input makes it panic.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod cobs;
pub mod configuration;
pub mod constants;
pub mod crc;
pub mod force_map;
pub mod line;
pub mod map_codec;
pub mod message;
pub mod motion;
pub mod packet;
pub mod parser;
pub mod rounds;
mod schema_names;
pub mod sensor_id;
pub mod sequence;

pub use constants::{LSB_PER_NEWTON, PACKET_MAX, PER_UNIT, SENSORS, SIDE, TAXELS};
pub use force_map::{ForceMap, NotFinite, Place, Saturated, TaxelForce};
pub use map_codec::{Health, MapInfo, encode_map, map_bytes};
pub use motion::Motion;
pub use packet::{Packet, PacketError};
pub use parser::{Event, MapParser, MessageParser, Parser};
pub use sensor_id::SensorId;
