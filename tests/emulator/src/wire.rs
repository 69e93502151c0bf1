//! The pipe between `gripline-emulator` and its parent process: little-endian, over standard input and output.
//! Units: virtual nanoseconds since power-on, 12-bit DAC codes. The parent speaks first after the greeting, and every
//! request has one reply. Limits: [`MAX_ADVANCE_NS`] and [`MAX_UART_BYTES`] a request.
//!
//! | message | layout |
//! |---|---|
//! | greeting, board to parent, once | `GRIPEMU\0`, `u32` version |
//! | RUN, parent to board | `u8` 1, `u64` advance_ns, `u32` n, n bytes to put on the UART line now |
//! | reply, board to parent | `u64` now_ns, `u64` instructions, `u32` resets, `u16` DAC code of channel 1 (0 while its pin is not driven), `u32` n, n UART bytes from the firmware, `u32` m, m × (`u64` at_ns, `u16` code) of channel 1 |
//!
//! Bytes and DAC writes of a reply are those since the reply before. End of file in place of a request ends the run.

use std::io::{self, Read, Write};

use crate::constants::{MAX_ADVANCE_NS, MAX_UART_BYTES};

/// What the greeting starts with.
pub const MAGIC: [u8; 8] = *b"GRIPEMU\0";
/// The version of this layout.
pub const VERSION: u32 = 1;
/// The first byte of a RUN request.
const RUN: u8 = 1;

/// Why the pipe's talk ended.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WireError {
    /// The pipe itself failed, or ended inside a message.
    #[error("pipe: {0}")]
    Pipe(#[from] io::Error),
    /// The greeting is not this program's.
    #[error("greeting: expected {MAGIC:02x?}, found {0:02x?}; is the other side gripline-emulator?")]
    Magic([u8; 8]),
    /// The greeting is of another version.
    #[error(
        "greeting: expected version {VERSION}, found {0}; rebuild the emulator with `cargo xtask emulator`"
    )]
    Version(u32),
    /// A request of no known kind.
    #[error("request: expected kind {RUN} (RUN), found {0}")]
    Kind(u8),
    /// A request for more time than one may ask for.
    #[error("request: advance_ns expected at most {MAX_ADVANCE_NS}, found {0}; split the run")]
    Advance(u64),
    /// A request with more bytes than one may carry.
    #[error("request: UART bytes expected at most {MAX_UART_BYTES}, found {0}; split them")]
    UartBytes(u32),
}

/// Let time pass, with bytes on the firmware's UART line from now.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Request {
    /// Nanoseconds to run for.
    pub advance_ns: u64,
    /// The bytes, oldest first.
    pub uart_bytes: Vec<u8>,
}

/// A code on the grip-force line (channel 1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LineWrite {
    /// Virtual time since power-on, nanoseconds.
    pub at_ns: u64,
    /// The code, 0..=4095.
    pub code: u16,
}

/// What the run came to.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Reply {
    /// Virtual time since power-on, nanoseconds.
    pub now_ns: u64,
    /// Instructions since power-on.
    pub instructions: u64,
    /// Restarts since power-on.
    pub resets: u32,
    /// The code on channel 1's pin now, 0 while it is not driven.
    pub dac_code: u16,
    /// The bytes the firmware sent since the last reply.
    pub uart_bytes: Vec<u8>,
    /// The codes that appeared on channel 1's pin since the last reply.
    pub line_writes: Vec<LineWrite>,
}

/// Greets the parent.
///
/// # Errors
/// The pipe's.
pub fn write_greeting(to: &mut impl Write) -> Result<(), WireError> {
    to.write_all(&MAGIC)?;
    to.write_all(&VERSION.to_le_bytes())?;
    Ok(to.flush()?)
}

/// Reads the board's greeting.
///
/// # Errors
/// The pipe's, and a greeting of another program or version.
pub fn read_greeting(from: &mut impl Read) -> Result<(), WireError> {
    let magic = read_array(from)?;
    if magic != MAGIC {
        return Err(WireError::Magic(magic));
    }
    match read_u32(from)? {
        VERSION => Ok(()),
        other => Err(WireError::Version(other)),
    }
}

impl Request {
    /// Writes the request.
    ///
    /// # Errors
    /// The pipe's.
    pub fn write(&self, to: &mut impl Write) -> Result<(), WireError> {
        to.write_all(&[RUN])?;
        to.write_all(&self.advance_ns.to_le_bytes())?;
        write_bytes(to, &self.uart_bytes)?;
        Ok(to.flush()?)
    }

    /// Reads a request; `None` when the parent has closed the pipe between two.
    ///
    /// # Errors
    /// The pipe's, and a request of an unknown kind or past its limits.
    pub fn read(from: &mut impl Read) -> Result<Option<Self>, WireError> {
        let mut kind = [0];
        if from.read(&mut kind)? == 0 {
            return Ok(None);
        }
        if kind != [RUN] {
            return Err(WireError::Kind(kind[0]));
        }
        let advance_ns = u64::from_le_bytes(read_array(from)?);
        if advance_ns > MAX_ADVANCE_NS {
            return Err(WireError::Advance(advance_ns));
        }
        let length = read_u32(from)?;
        if length > MAX_UART_BYTES {
            return Err(WireError::UartBytes(length));
        }
        let mut uart_bytes = vec![0; length as usize];
        from.read_exact(&mut uart_bytes)?;
        Ok(Some(Self {
            advance_ns,
            uart_bytes,
        }))
    }
}

impl Reply {
    /// Writes the reply.
    ///
    /// # Errors
    /// The pipe's.
    pub fn write(&self, to: &mut impl Write) -> Result<(), WireError> {
        to.write_all(&self.now_ns.to_le_bytes())?;
        to.write_all(&self.instructions.to_le_bytes())?;
        to.write_all(&self.resets.to_le_bytes())?;
        to.write_all(&self.dac_code.to_le_bytes())?;
        write_bytes(to, &self.uart_bytes)?;
        to.write_all(&(self.line_writes.len() as u32).to_le_bytes())?;
        for write in &self.line_writes {
            to.write_all(&write.at_ns.to_le_bytes())?;
            to.write_all(&write.code.to_le_bytes())?;
        }
        Ok(to.flush()?)
    }

    /// Reads a reply.
    ///
    /// # Errors
    /// The pipe's.
    pub fn read(from: &mut impl Read) -> Result<Self, WireError> {
        let now_ns = u64::from_le_bytes(read_array(from)?);
        let instructions = u64::from_le_bytes(read_array(from)?);
        let resets = read_u32(from)?;
        let dac_code = u16::from_le_bytes(read_array(from)?);
        let mut uart_bytes = vec![0; read_u32(from)? as usize];
        from.read_exact(&mut uart_bytes)?;
        let line_writes = (0..read_u32(from)?)
            .map(|_| {
                Ok(LineWrite {
                    at_ns: u64::from_le_bytes(read_array(from)?),
                    code: u16::from_le_bytes(read_array(from)?),
                })
            })
            .collect::<Result<_, WireError>>()?;
        Ok(Self {
            now_ns,
            instructions,
            resets,
            dac_code,
            uart_bytes,
            line_writes,
        })
    }
}

fn write_bytes(to: &mut impl Write, bytes: &[u8]) -> io::Result<()> {
    to.write_all(&(bytes.len() as u32).to_le_bytes())?;
    to.write_all(bytes)
}

fn read_u32(from: &mut impl Read) -> io::Result<u32> {
    read_array(from).map(u32::from_le_bytes)
}

fn read_array<const N: usize>(from: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    from.read_exact(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reply() -> Reply {
        Reply {
            now_ns: 0x0102_0304_0506_0708,
            instructions: 9,
            resets: 2,
            dac_code: 0x0FED,
            uart_bytes: vec![0xAA, 0xBB],
            line_writes: vec![
                LineWrite {
                    at_ns: 5,
                    code: 0x0123,
                },
                LineWrite {
                    at_ns: 6,
                    code: 0x0FED,
                },
            ],
        }
    }

    #[test]
    fn a_request_is_laid_out_as_documented() {
        let mut bytes = Vec::new();
        Request {
            advance_ns: 0x0102,
            uart_bytes: vec![7, 8, 9],
        }
        .write(&mut bytes)
        .unwrap();
        assert_eq!(bytes, [1, 2, 1, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0, 7, 8, 9]);
    }

    #[test]
    fn a_reply_is_laid_out_as_documented() {
        let mut bytes = Vec::new();
        reply().write(&mut bytes).unwrap();
        let expected: &[&[u8]] = &[
            &[8, 7, 6, 5, 4, 3, 2, 1],
            &[9, 0, 0, 0, 0, 0, 0, 0],
            &[2, 0, 0, 0],
            &[0xED, 0x0F],
            &[2, 0, 0, 0, 0xAA, 0xBB],
            &[2, 0, 0, 0],
            &[5, 0, 0, 0, 0, 0, 0, 0, 0x23, 0x01],
            &[6, 0, 0, 0, 0, 0, 0, 0, 0xED, 0x0F],
        ];
        assert_eq!(bytes, expected.concat());
    }

    #[test]
    fn every_message_survives_the_round_trip() {
        let request = Request {
            advance_ns: MAX_ADVANCE_NS,
            uart_bytes: vec![1; MAX_UART_BYTES as usize],
        };
        let mut pipe = Vec::new();
        write_greeting(&mut pipe).unwrap();
        request.write(&mut pipe).unwrap();
        reply().write(&mut pipe).unwrap();
        let mut from = pipe.as_slice();
        read_greeting(&mut from).unwrap();
        assert_eq!(Request::read(&mut from).unwrap(), Some(request));
        assert_eq!(Reply::read(&mut from).unwrap(), reply());
        assert_eq!(from, [0_u8; 0]);
    }

    #[test]
    fn the_end_of_the_pipe_is_a_goodbye_between_requests_and_an_error_inside_one() {
        assert_eq!(Request::read(&mut [].as_slice()).unwrap(), None);
        let inside = Request::read(&mut [1, 2].as_slice());
        assert!(matches!(inside, Err(WireError::Pipe(_))), "{inside:?}");
    }

    #[test]
    fn a_request_past_its_limits_names_the_limit_and_what_was_found() {
        let mut long = Vec::new();
        Request {
            advance_ns: MAX_ADVANCE_NS + 1,
            uart_bytes: vec![],
        }
        .write(&mut long)
        .unwrap();
        let mut wide = Vec::new();
        Request {
            advance_ns: 0,
            uart_bytes: vec![0; MAX_UART_BYTES as usize + 1],
        }
        .write(&mut wide)
        .unwrap();
        for (bytes, words) in [
            (long, ["advance_ns", "60000000000", "60000000001"]),
            (wide, ["UART bytes", "65536", "65537"]),
            (vec![9], ["kind", "1 (RUN)", "found 9"]),
        ] {
            let text = Request::read(&mut bytes.as_slice()).unwrap_err().to_string();
            assert!(words.iter().all(|word| text.contains(word)), "{text}");
        }
    }

    #[test]
    fn a_greeting_of_another_program_or_version_is_refused() {
        let other = read_greeting(&mut b"GRIPLINE\x01\0\0\0".as_slice());
        assert!(matches!(other, Err(WireError::Magic(_))), "{other:?}");
        let newer = read_greeting(&mut b"GRIPEMU\0\x02\0\0\0".as_slice());
        assert!(matches!(newer, Err(WireError::Version(2))), "{newer:?}");
    }
}
