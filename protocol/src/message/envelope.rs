//! A message as bytes: schema version, class, body.

use core::fmt;

use serde::Deserialize;

use super::bootloader::Bootloader;
use super::command::Command;
use super::handshake::{Hello, SCHEMA_VERSION};
use super::report::Report;
use crate::constants::{CRC_BYTES, MESSAGE_MAX};

/// A message in either direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Message {
    /// Handshake, either way.
    Hello(Hello),
    /// Host to microcontroller.
    Command(Command),
    /// Microcontroller to host.
    Report(Report),
    /// The way into the chip's bootloader, either way.
    Bootloader(Bootloader),
}

/// Why a message that arrived whole could not be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MessageError {
    /// Its schema version is not ours.
    Schema {
        /// The version found; [`SCHEMA_VERSION`] was expected.
        found: u16,
    },
    /// Not a class of this schema.
    Class {
        /// The class byte found; 0 to 3 were expected.
        found: u8,
    },
    /// The body is not what its class demands.
    Body,
    /// Longer than [`MESSAGE_MAX`].
    TooLong,
}

impl fmt::Display for MessageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Schema { found } => write!(
                f,
                "message of schema {found}, expected schema {SCHEMA_VERSION}: flash the firmware of this host's version"
            ),
            Self::Class { found } => write!(f, "message class {found}, expected 0 to 3"),
            Self::Body => f.write_str("message body cannot be read"),
            Self::TooLong => write!(f, "message longer than {MESSAGE_MAX} bytes"),
        }
    }
}

impl core::error::Error for MessageError {}

const CLASS_HELLO: u8 = 0;
const CLASS_COMMAND: u8 = 1;
const CLASS_REPORT: u8 = 2;
const CLASS_BOOTLOADER: u8 = 3;
const ENVELOPE: usize = 3;

impl Message {
    /// Reads the bytes of [`crate::Event::Message`].
    ///
    /// # Errors
    /// [`MessageError`] when another schema wrote it or its body is damaged at its source.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, MessageError> {
        let Some((&[v0, v1, class], body)) = bytes.split_first_chunk::<ENVELOPE>() else {
            return Err(MessageError::Body);
        };
        match class {
            CLASS_HELLO => return Hello::read(body).map(Self::Hello).ok_or(MessageError::Body),
            CLASS_BOOTLOADER => {
                let read = Bootloader::read(body).map(Self::Bootloader);
                return read.ok_or(MessageError::Body);
            }
            _ => {}
        }
        let found = u16::from_le_bytes([v0, v1]);
        if found != SCHEMA_VERSION {
            return Err(MessageError::Schema { found });
        }
        match class {
            CLASS_COMMAND => exactly(body).map(Self::Command),
            CLASS_REPORT => exactly(body).map(Self::Report),
            found => Err(MessageError::Class { found }),
        }
    }

    /// Writes the message without its CRC and returns its length.
    pub(super) fn write(&self, buffer: &mut [u8; MESSAGE_MAX - CRC_BYTES]) -> Result<usize, MessageError> {
        let (envelope, body) = buffer.split_at_mut(ENVELOPE);
        envelope[..2].copy_from_slice(&SCHEMA_VERSION.to_le_bytes());
        let (class, length) = match self {
            Self::Hello(hello) => (CLASS_HELLO, Ok(hello.write(body))),
            Self::Bootloader(bootloader) => (CLASS_BOOTLOADER, Ok(bootloader.write(body))),
            Self::Command(command) => (
                CLASS_COMMAND,
                postcard::to_slice(command, body).map(|used| used.len()),
            ),
            Self::Report(report) => (
                CLASS_REPORT,
                postcard::to_slice(report, body).map(|used| used.len()),
            ),
        };
        envelope[2] = class;
        length
            .map(|length| length + ENVELOPE)
            .map_err(|_| MessageError::TooLong)
    }
}

/// A postcard body with nothing behind it but the zeros that keep the CRC in one packet.
fn exactly<'a, T: Deserialize<'a>>(body: &'a [u8]) -> Result<T, MessageError> {
    match postcard::take_from_bytes(body) {
        Ok((value, rest)) if rest.len() < CRC_BYTES && rest.iter().all(|&byte| byte == 0) => Ok(value),
        _ => Err(MessageError::Body),
    }
}
