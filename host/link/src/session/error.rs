//! Why a session cannot begin or go on, and what to do.

use gripline_protocol::message::{BOARDS, Hello, MessageError, Refusal, SchemaMismatch};

use crate::LinkError;
use crate::handshake::HANDSHAKE_US;

/// Why a session cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The link is gone.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// Nobody answers.
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
}

impl SessionError {
    /// Whether a packet was lost on a link that mends itself.
    pub(super) const fn is_passing(&self) -> bool {
        matches!(self, Self::Link(LinkError::NotTaken { .. }))
    }
}

/// The command that flashes this host's firmware to the board that answered.
pub(super) fn flashing(firmware: &Hello) -> String {
    match BOARDS.get(usize::from(firmware.board)) {
        Some(board) if firmware.board > 0 => format!("cargo xtask flash --board {board}"),
        _ => "cargo xtask flash --board BOARD".to_owned(),
    }
}

/// Why settings, or the order to store them, were refused.
pub(super) fn reason(refusal: Refusal) -> String {
    match refusal {
        Refusal::OutOfRange(error) => error.to_string(),
        Refusal::Holding => "the gripper holds or is not open yet, expected it released; storing stops the \
                             microcontroller for a moment"
            .to_owned(),
        Refusal::FlashFailed => "the flash did not take them; those stored before are still there".to_owned(),
        other => format!("{other:?}"),
    }
}
