//! The way into the chip's own bootloader, for a firmware update over USB. Its layout is frozen like that of the handshake, so
//! that a host can update firmware of any schema.

/// A request for the bootloader, or its answer. Frozen layout after the class byte: `BOOT`, then a code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Bootloader {
    /// Host to microcontroller: restart in the bootloader. Needs a released gripper with the line at 0 N, and no handshake.
    Enter,
    /// The microcontroller restarts in the bootloader now.
    Entering,
    /// Refused: something may be in the gripper. `Release` first, and wait until the line is at 0 N.
    Holding,
}

/// So that noise in the code of another message is no request.
const MARK: [u8; 4] = *b"BOOT";
const BYTES: usize = MARK.len() + 1;

impl Bootloader {
    /// Writes it into at least 5 bytes and returns its length.
    pub(super) fn write(self, bytes: &mut [u8]) -> usize {
        bytes[..MARK.len()].copy_from_slice(&MARK);
        bytes[MARK.len()] = match self {
            Self::Enter => 0,
            Self::Entering => 1,
            Self::Holding => 2,
        };
        BYTES
    }

    /// Reads it; `None` when it is not one.
    pub(super) fn read(body: &[u8]) -> Option<Self> {
        let code = *body.strip_prefix(&MARK)?.first()?;
        match code {
            0 => Some(Self::Enter),
            1 => Some(Self::Entering),
            2 => Some(Self::Holding),
            _ => None,
        }
    }
}
