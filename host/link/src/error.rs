//! Why a link or its session cannot begin or continue, and what to do.

use gripline_protocol::message::{BOARDS, Hello, MessageError, SchemaMismatch};

use crate::patience::HANDSHAKE_US;
use crate::patience::READY_WITHIN;

/// Why a link cannot be opened or has ended, or a session cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// No such port or device.
    #[error("{link}: not found ({found}); {advice}")]
    Missing {
        /// Which link.
        link: String,
        /// What was found instead.
        found: String,
        /// What to do.
        advice: String,
    },
    /// Several could be meant.
    #[error("{link}: found {count}: {found}; expected one, name it with --mcu usb:SERIAL")]
    Several {
        /// Which link.
        link: String,
        /// How many.
        count: usize,
        /// What is there.
        found: String,
    },
    /// Two devices that cannot be told apart.
    #[error(
        "{link}: found two devices with the serial number {serial}, at {} and {}, expected one; unplug one of them, or speak to it \
         over its UART (--mcu serial:PORT)", places[0], places[1]
    )]
    Twins {
        /// Which link.
        link: String,
        /// Their serial number.
        serial: String,
        /// Where they are.
        places: [String; 2],
    },
    /// A packet is lost; the link recovers by itself.
    #[error("{link}: a packet was not taken: {found}")]
    NotTaken {
        /// Which link.
        link: String,
        /// What happened.
        found: String,
    },
    /// Another program has it.
    #[error(
        "{link}: busy, expected a port that no other program has open; close the other program ({found})"
    )]
    Busy {
        /// Which link.
        link: String,
        /// What the system said.
        found: String,
    },
    /// It is attached, but not usable: it was just plugged in, or the system refused its power.
    #[error(
        "{link}: attached, but not ready ({found}), expected its interface within {} s; plug it in again, at another port or hub",
        READY_WITHIN.as_secs()
    )]
    NotReady {
        /// Which link.
        link: String,
        /// What the system said.
        found: String,
    },
    /// It worked and then failed.
    #[error("{link}: {found}")]
    Broken {
        /// Which link.
        link: String,
        /// What happened.
        found: String,
    },
    /// The device does not answer.
    #[error("{link}: no answer to {question} within {} s, expected one; check power, wiring and that the firmware is flashed", HANDSHAKE_US / 1_000_000)]
    NoAnswer {
        /// Which link.
        link: String,
        /// What was asked.
        question: &'static str,
    },
    /// The other side speaks another schema.
    #[error("{link}, {firmware}: {mismatch} ({})", flashing(firmware))]
    Schema {
        /// Which link.
        link: String,
        /// Who answered.
        firmware: Hello,
        /// Both versions.
        mismatch: SchemaMismatch,
    },
    /// The settings were not taken.
    #[error("{link}: settings refused: {reason}")]
    Refused {
        /// Which link.
        link: String,
        /// Why.
        reason: String,
    },
    /// A message of ours does not fit the wire.
    #[error(transparent)]
    Message(#[from] MessageError),
    /// Something may be in the gripper.
    #[error(
        "{link}: refused, because the gripper holds or is not open yet; expected it released with the line at 0 N: release it \
         (`gripline faults --acknowledge --release`) and try again"
    )]
    BootloaderHolding {
        /// Which link.
        link: String,
    },
    /// Its firmware is older than this command.
    #[error(
        "{link}: its firmware does not know the way into the bootloader; flash it once with a probe (cargo xtask flash --board {board}), \
         or set BOOT0 high, reset it, and try again"
    )]
    BootloaderUnknown {
        /// Which link.
        link: String,
        /// Its board.
        board: String,
    },
}

impl LinkError {
    /// Whether a packet was lost on a link that recovers by itself.
    pub(crate) const fn is_passing(&self) -> bool {
        matches!(self, Self::NotTaken { .. })
    }
}

/// The command that flashes this host's firmware to the board that answered.
pub(crate) fn flashing(firmware: &Hello) -> String {
    match BOARDS.get(usize::from(firmware.board)) {
        Some(board) if firmware.board > 0 => format!("cargo xtask flash --board {board}"),
        _ => "cargo xtask flash --board BOARD".to_owned(),
    }
}
