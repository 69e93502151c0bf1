//! Commands, configuration, status and handshake: everything on the wire that is not a force map.
//!
//! A message is: schema version u16 (little-endian), class u8, then a postcard body. The handshake ([`Hello`]) and the way
//! into the bootloader ([`Bootloader`]) are read whatever the schema version; all else needs equal versions. Units: forces 1/4096 N, ratios and friction 1/10000.

mod bootloader;
mod command;
mod envelope;
mod handshake;
mod packets;
mod report;

pub use crate::configuration::{Configuration, FingertipGeometry, OutOfRange};
pub use crate::line::{LineKind, LinePoint, LineSettings};
pub use bootloader::Bootloader;
pub use command::Command;
pub use envelope::{Message, MessageError};
pub use handshake::{
    BOARDS, Hello, IMAGE_IDENTITY_AT, IMAGE_IDENTITY_BYTES, IMAGE_MARK, Revision, SCHEMA_HASH,
    SCHEMA_VERSION, SchemaMismatch,
};
pub use packets::MessagePackets;
pub use report::{GripMode, MapSums, Refusal, Report, STAGES, SlipState, Stage, Status, Witnesses};
