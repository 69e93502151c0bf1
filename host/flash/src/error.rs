//! Why an image is not on the chip: what was found, what was expected and what to do.

use gripline_protocol::message::{IMAGE_IDENTITY_AT, SchemaMismatch};

use crate::dfu_status::{OPERATION_MS, State, meaning};
use crate::layout::FLASH;

/// The one error of this crate.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FlashError {
    /// The devices cannot be listed.
    #[error("USB: found {found}, expected a list of devices; check that this system has USB")]
    List {
        /// What the system said.
        found: String,
    },
    /// It is not allowed.
    #[error(
        "bootloader at {place}: found {found}, expected to be allowed to open it: install the udev rule (docs/70-gripline.rules), or \
         join the group gripline"
    )]
    Forbidden {
        /// Where it is.
        place: String,
        /// What the system said.
        found: String,
    },
    /// It does not work.
    #[error("bootloader at {place}: found {found}, expected {expected}; plug it in again")]
    Broken {
        /// Where it is.
        place: String,
        /// What happened.
        found: String,
        /// What should be.
        expected: &'static str,
    },
    /// The ELF file is broken.
    #[error(
        "found an ELF file that cannot be read ({found}), expected one of `cargo xtask firmware`; build it again"
    )]
    Elf {
        /// What is wrong.
        found: String,
    },
    /// Nothing lies where the chip looks for its interrupt vectors.
    #[error(
        "found {found}, expected an image that begins at {FLASH:#010x}; build it with `cargo xtask firmware`"
    )]
    NoVectors {
        /// What is there.
        found: String,
    },
    /// There is no identity block.
    #[error(
        "found no identity at {:#010x}, expected one of Gripline's firmware; build it with `cargo xtask firmware`, or flash older \
         firmware with a probe",
        FLASH + IMAGE_IDENTITY_AT as u32
    )]
    NoIdentity,
    /// The file ends too early.
    #[error(
        "found {found} bytes, expected at least the {expected} that the image was linked with; copy the file again"
    )]
    CutOff {
        /// Bytes of the file's image.
        found: u32,
        /// Bytes of the linked image.
        expected: u32,
    },
    /// It lies where the settings are, or outside of the flash, or on itself.
    #[error("found bytes from {from:#010x} to {to:#010x}, expected none there: {why}")]
    Place {
        /// First address.
        from: u32,
        /// The address behind the last byte.
        to: u32,
        /// Why not.
        why: &'static str,
    },
    /// It is for another board.
    #[error(
        "found an image for {found}, expected one for {expected}; build it with `cargo xtask firmware --board {expected}`"
    )]
    Board {
        /// The image's board.
        found: String,
        /// The board that is to be flashed.
        expected: String,
    },
    /// It speaks another schema than this host.
    #[error("found an image of another schema: {0}")]
    Schema(SchemaMismatch),
    /// The device is gone.
    #[error("{operation}: found the bootloader gone ({found}), expected it until the end; check the cable")]
    Gone {
        /// What was under way.
        operation: String,
        /// What the system said.
        found: String,
    },
    /// The device refused, or failed.
    #[error("{operation}: found status {code:#04x} ({}), expected success", meaning(*code))]
    Failed {
        /// What was under way.
        operation: String,
        /// The device's status code.
        code: u8,
    },
    /// The device does not come to an end.
    #[error("{operation}: found the bootloader in state {state:?}, expected it done within {} s", OPERATION_MS / 1_000)]
    Stuck {
        /// What was under way.
        operation: String,
        /// The state that it stays in.
        state: State,
    },
    /// The image does not fit the chip. Nothing was erased.
    #[error(
        "found {bytes} bytes of the image at {address:#010x}, expected flash there that may be written: is it the right board?"
    )]
    NoRoom {
        /// Where.
        address: u32,
        /// How many.
        bytes: u32,
    },
    /// The bootloader failed.
    #[error("{error}; {}", state(*.has_begun))]
    Dfu {
        /// Its error.
        error: Box<Self>,
        /// Something was erased already.
        has_begun: bool,
    },
    /// What was written reads otherwise.
    #[error(
        "reading back at {address:#010x}: found {found:#04x}, expected {expected:#04x}; {}",
        state(true)
    )]
    Differs {
        /// The first such address.
        address: u32,
        /// The byte that was read.
        found: u8,
        /// The byte that was written.
        expected: u8,
    },
    /// Less came back than was asked for.
    #[error(
        "reading back at {address:#010x}: found {found} bytes, expected {expected}; {}",
        state(true)
    )]
    Short {
        /// Where.
        address: u32,
        /// How many came.
        found: usize,
        /// How many were asked for.
        expected: usize,
    },
}

const fn state(has_begun: bool) -> &'static str {
    if has_begun {
        "the board has no image that starts until the update is repeated (its settings are kept)"
    } else {
        "the board's image is as it was"
    }
}
