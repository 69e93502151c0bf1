//! Packets in, events out. Sans-IO: no allocation, no panic on any input, constant work per packet.
//!
//! [`Parser`] reads all of a link. A board that reads messages outside its interrupt uses the two halves instead:
//! [`MapParser`] and [`MessageParser`]. Limits: one map and one message at a time per link.

mod event;
mod link;
mod map;
mod message;

pub use event::{Event, Forces};
pub use link::{Counters, Parser};
pub use map::MapParser;
pub use message::MessageParser;
