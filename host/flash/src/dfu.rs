//! ST's extension of DFU 1.1 (AN3156, UM0424): requests, states, and what one operation on the memory takes.
//!
//! A command goes out as a download of block 0. It begins with the next question for the status, and the device says how long it takes.
//! Data of block n lies at the address that was set, plus (n − 2) transfers.

use crate::dfu_status::{OPERATION_MS, State};
use crate::error::FlashError;

/// Requests (USB DFU 1.1, table 3.2).
mod request {
    pub(super) const DOWNLOAD: u8 = 1;
    pub(super) const UPLOAD: u8 = 2;
    pub(super) const GET_STATUS: u8 = 3;
    pub(super) const CLEAR_STATUS: u8 = 4;
    pub(super) const ABORT: u8 = 6;
}

/// Commands of ST's extension (AN3156, section 5).
mod command {
    pub(super) const SET_ADDRESS: u8 = 0x21;
    pub(super) const ERASE: u8 = 0x41;
}

/// Block number of a command, and of the first block of data.
const COMMAND_BLOCK: u16 = 0;
const DATA_BLOCK: u16 = 2;
/// The least between two questions for the status.
const POLL_MS: u32 = 1;
/// Steps to the idle state at most: an error, an upload or a download to end.
const STEPS: u32 = 8;
const STATUS_BYTES: u16 = 6;

/// Why a request did not get through.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum WireError {
    /// The device refused it.
    Stalled,
    /// The device is gone, or does not answer.
    Gone(String),
}

/// The control endpoint of a device in its bootloader, class requests to the interface.
pub trait Wire {
    /// Sends `data`.
    ///
    /// # Errors
    /// [`WireError`] when the device refuses it or is gone.
    fn send(&mut self, request: u8, value: u16, data: &[u8]) -> Result<(), WireError>;

    /// Asks for at most `length` bytes.
    ///
    /// # Errors
    /// [`WireError`] when the device refuses it or is gone.
    fn ask(&mut self, request: u8, value: u16, length: u16) -> Result<Vec<u8>, WireError>;

    /// Lets so many milliseconds pass.
    fn wait(&mut self, ms: u32);
}

#[derive(Debug, Clone, Copy)]
struct Status {
    code: u8,
    poll_ms: u32,
    state: State,
}

/// A device in its bootloader.
#[derive(Debug)]
pub struct Dfu<W> {
    wire: W,
    transfer_bytes: usize,
}

impl<W: Wire> Dfu<W> {
    /// `transfer_bytes` is what the device's functional descriptor says of the longest block.
    #[must_use]
    pub fn new(wire: W, transfer_bytes: u16) -> Self {
        Self {
            wire,
            transfer_bytes: usize::from(transfer_bytes.max(8)) & !0b111,
        }
    }

    /// The longest block.
    #[must_use]
    pub const fn transfer_bytes(&self) -> usize {
        self.transfer_bytes
    }

    /// The wire, when the device is done with.
    pub fn into_wire(self) -> W {
        self.wire
    }

    /// Erases the sector that begins at `address`.
    ///
    /// # Errors
    /// [`FlashError`].
    pub fn erase(&mut self, address: u32) -> Result<(), FlashError> {
        self.command(
            command::ERASE,
            address,
            &format!("erasing the sector at {address:#010x}"),
        )
    }

    /// Writes at most one transfer to erased memory.
    ///
    /// # Errors
    /// [`FlashError`].
    pub fn write(&mut self, address: u32, data: &[u8]) -> Result<(), FlashError> {
        let operation = format!("writing {} bytes at {address:#010x}", data.len());
        self.command(command::SET_ADDRESS, address, &operation)?;
        self.wire
            .send(request::DOWNLOAD, DATA_BLOCK, data)
            .or_else(|error| self.refused(error, &operation))?;
        self.finish(&operation)
    }

    /// Reads memory.
    ///
    /// # Errors
    /// [`FlashError`].
    pub fn read(&mut self, address: u32, bytes: usize) -> Result<Vec<u8>, FlashError> {
        let operation = format!("reading {bytes} bytes at {address:#010x}");
        self.command(command::SET_ADDRESS, address, &operation)?;
        self.make_idle(&operation)?;
        let mut read = Vec::with_capacity(bytes);
        let mut block = DATA_BLOCK;
        while read.len() < bytes {
            let length = self.transfer_bytes.min(bytes - read.len());
            let asked = self.wire.ask(request::UPLOAD, block, length as u16);
            let data = match asked {
                Ok(data) => data,
                Err(error) => {
                    self.refused(error, &operation)?;
                    Vec::new()
                }
            };
            if data.is_empty() {
                break;
            }
            read.extend_from_slice(&data);
            block += 1;
        }
        self.make_idle(&operation)?;
        Ok(read)
    }

    /// Ends the bootloader and starts what lies at `address`. The device leaves the bus, so what it answers last does not count.
    ///
    /// # Errors
    /// [`FlashError`] when it does not take the request.
    pub fn start(&mut self, address: u32) -> Result<(), FlashError> {
        let operation = format!("starting the image at {address:#010x}");
        self.command(command::SET_ADDRESS, address, &operation)?;
        self.wire
            .send(request::DOWNLOAD, COMMAND_BLOCK, &[])
            .or_else(|error| self.refused(error, &operation))?;
        // This question makes it leave.
        let _ = self.wire.ask(request::GET_STATUS, 0, STATUS_BYTES);
        Ok(())
    }

    fn command(&mut self, command: u8, address: u32, operation: &str) -> Result<(), FlashError> {
        self.make_idle(operation)?;
        let [a0, a1, a2, a3] = address.to_le_bytes();
        self.wire
            .send(request::DOWNLOAD, COMMAND_BLOCK, &[command, a0, a1, a2, a3])
            .or_else(|error| self.refused(error, operation))?;
        self.finish(operation)
    }

    /// Waits for the end of what was sent.
    fn finish(&mut self, operation: &str) -> Result<(), FlashError> {
        let mut waited_ms = 0;
        loop {
            let status = self.status(operation)?;
            match status.state {
                State::DownloadIdle => return Ok(()),
                State::DownloadSync | State::DownloadBusy if waited_ms <= OPERATION_MS => {
                    let poll_ms = status.poll_ms.clamp(POLL_MS, OPERATION_MS);
                    self.wire.wait(poll_ms);
                    waited_ms += poll_ms;
                }
                State::Error => return self.fail(operation, status.code),
                state => {
                    return Err(FlashError::Stuck {
                        operation: operation.to_owned(),
                        state,
                    });
                }
            }
        }
    }

    /// Ends whatever the device has begun.
    fn make_idle(&mut self, operation: &str) -> Result<(), FlashError> {
        let mut state = State::Idle;
        for _ in 0..STEPS {
            let status = self.status(operation)?;
            state = status.state;
            let end = match state {
                // Blocks of data may follow commands without an end of the download.
                State::Idle => return Ok(()),
                State::Error => request::CLEAR_STATUS,
                State::DownloadSync | State::DownloadBusy => {
                    self.wire.wait(status.poll_ms.clamp(POLL_MS, OPERATION_MS));
                    continue;
                }
                _ => request::ABORT,
            };
            self.wire
                .send(end, 0, &[])
                .or_else(|error| self.refused(error, operation))?;
        }
        Err(FlashError::Stuck {
            operation: operation.to_owned(),
            state,
        })
    }

    fn status(&mut self, operation: &str) -> Result<Status, FlashError> {
        let gone = |found: String| FlashError::Gone {
            operation: operation.to_owned(),
            found,
        };
        let bytes = self
            .wire
            .ask(request::GET_STATUS, 0, STATUS_BYTES)
            .map_err(|error| match error {
                WireError::Gone(found) => gone(found),
                WireError::Stalled => gone("it does not tell its status".to_owned()),
            })?;
        let [code, p0, p1, p2, state, _] = *bytes
            .first_chunk::<6>()
            .ok_or_else(|| gone(format!("a status of {} bytes", bytes.len())))?;
        Ok(Status {
            code,
            poll_ms: u32::from_le_bytes([p0, p1, p2, 0]),
            state: State::of(state),
        })
    }

    /// A request was refused: the device's status says why.
    fn refused(&mut self, error: WireError, operation: &str) -> Result<(), FlashError> {
        match error {
            WireError::Gone(found) => Err(FlashError::Gone {
                operation: operation.to_owned(),
                found,
            }),
            WireError::Stalled => {
                let code = self.status(operation)?.code;
                self.fail(operation, code)
            }
        }
    }

    fn fail(&mut self, operation: &str, code: u8) -> Result<(), FlashError> {
        // Best effort: the next one that asks finds it ready.
        let _ = self.wire.send(request::CLEAR_STATUS, 0, &[]);
        Err(FlashError::Failed {
            operation: operation.to_owned(),
            code,
        })
    }
}
