//! Commands, configuration, status and handshake: everything on the wire that is not a force map.
//!
//! A message is: schema version u16 (little-endian), class u8, then a postcard body. Only the handshake ([`Hello`]) is read
//! whatever the schema version; all else needs equal versions. Units: forces 1/4096 N, ratios and friction 1/10000.

mod command;
mod envelope;
mod handshake;
mod packets;
mod report;

pub use crate::configuration::{Configuration, FingertipGeometry, OutOfRange};
pub use crate::line::{LineKind, LinePoint, LineSettings};
pub use command::Command;
pub use envelope::{Message, MessageError};
pub use handshake::{BOARDS, Hello, Revision, SCHEMA_HASH, SCHEMA_VERSION, SchemaMismatch};
pub use packets::MessagePackets;
pub use report::{GripMode, MapSums, Refusal, Report, STAGES, SlipState, Stage, Status, Witnesses};
