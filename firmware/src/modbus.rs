//! The three pieces of Modbus RTU that a gripper needs: write registers (function 16), read input registers (function 4), and
//! checking answers. Bytes in, bytes out, no clock.
//!
//! Sources: Modbus application protocol V1.1b3 (sections 6.4, 6.12, 7), Modbus over serial line V1.02 (section 2.5.1).
//! Limits: three registers a request. Length and CRC delimit frames, not silences: a task that shares its processor cannot
//! measure those.

use crc::{CRC_16_MODBUS, Crc, NoTable};

/// Registers in every request.
pub const REGISTERS: usize = 3;
/// Longest request, bytes: function 16 with three registers.
pub const REQUEST_MAX: usize = 9 + 2 * REGISTERS;
/// Longest answer, bytes: function 4 with three registers.
pub const ANSWER_MAX: usize = 5 + 2 * REGISTERS;

/// The bytes of a request.
pub type RequestFrame = heapless::Vec<u8, REQUEST_MAX>;

const READ_INPUTS: u8 = 4;
const WRITE_MULTIPLE: u8 = 16;
/// Set in the function code of a refusal (section 7).
const EXCEPTION: u8 = 0x80;
const CRC_BYTES: usize = 2;

/// Bit by bit: the frames are short, and a table takes half a KiB of flash.
const CRC: Crc<u16, NoTable> = Crc::<u16, NoTable>::new(&CRC_16_MODBUS);

/// A request to the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Request {
    /// Function 16: write these values from `address` on.
    Write {
        /// First register.
        address: u16,
        /// Their values.
        values: [u16; REGISTERS],
    },
    /// Function 4: read the same number from `address` on.
    Read {
        /// First register.
        address: u16,
    },
}

/// A good answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Answer {
    /// The registers were written.
    Written,
    /// The registers that were read.
    Registers([u16; REGISTERS]),
}

/// Why an answer is bad.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum AnswerError {
    /// The CRC is wrong: noise, or a byte was lost.
    Crc,
    /// The device refuses, with this exception code (1 function, 2 address, 3 value, 4 failure, 6 busy).
    Exception(u8),
    /// The CRC is right but it answers another request: another unit, function, address or length.
    Other,
}

impl Request {
    /// The frame for `unit`.
    #[must_use]
    pub fn frame(&self, unit: u8) -> RequestFrame {
        let (function, address, values) = match self {
            Self::Write { address, values } => (WRITE_MULTIPLE, address, Some(values)),
            Self::Read { address } => (READ_INPUTS, address, None),
        };
        let mut frame = RequestFrame::new();
        // The longest frame fits, by the definition of `REQUEST_MAX`.
        let mut put = |bytes: &[u8]| {
            let fits = frame.extend_from_slice(bytes);
            debug_assert!(fits.is_ok());
        };
        put(&[unit, function]);
        put(&address.to_be_bytes());
        put(&(REGISTERS as u16).to_be_bytes());
        if let Some(values) = values {
            put(&[2 * REGISTERS as u8]);
            for value in values {
                put(&value.to_be_bytes());
            }
        }
        let crc = CRC.checksum(&frame);
        let _ = frame.extend_from_slice(&crc.to_le_bytes());
        frame
    }

    /// Reads `bytes` as the answer of `unit`; `None` while bytes are missing.
    #[must_use]
    pub fn answer(&self, unit: u8, bytes: &[u8]) -> Option<Result<Answer, AnswerError>> {
        let (function, whole) = match self {
            Self::Write { .. } => (WRITE_MULTIPLE, 8),
            Self::Read { .. } => (READ_INPUTS, ANSWER_MAX),
        };
        let found = *bytes.get(1)?;
        // An unknown function has an unknown length: read it as the answer to this request.
        let length = if found == function | EXCEPTION { 5 } else { whole };
        let (body, crc) = bytes.get(..length)?.split_at(length - CRC_BYTES);
        Some(if crc != CRC.checksum(body).to_le_bytes() {
            Err(AnswerError::Crc)
        } else if body[0] != unit {
            Err(AnswerError::Other)
        } else if found == function | EXCEPTION {
            Err(AnswerError::Exception(body[2]))
        } else {
            self.body(function, body).ok_or(AnswerError::Other)
        })
    }

    /// The body of a whole answer.
    fn body(&self, function: u8, body: &[u8]) -> Option<Answer> {
        if body[1] != function {
            return None;
        }
        match self {
            Self::Write { address, .. } => {
                let [high, low] = address.to_be_bytes();
                (body[2..] == [high, low, 0, REGISTERS as u8]).then_some(Answer::Written)
            }
            Self::Read { .. } => {
                let (&count, values) = body[2..].split_first()?;
                if usize::from(count) != values.len() {
                    return None;
                }
                let mut registers = [0; REGISTERS];
                for (register, value) in registers.iter_mut().zip(values.chunks_exact(2)) {
                    *register = u16::from_be_bytes([value[0], value[1]]);
                }
                Some(Answer::Registers(registers))
            }
        }
    }
}
