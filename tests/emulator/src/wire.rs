//! The pipe between `gripline-emulator` and its parent process: little-endian, over standard input and output.
//! Units: virtual nanoseconds since power-on, 12-bit DAC codes. The parent speaks first after the greeting, and every
//! request has one reply. The layout stands as a table in the crate's README, and in the golden bytes below.
//! What a reply lists is what came since the reply before. End of file in place of a request ends the run.
//! Limits: [`MAX_ADVANCE_NS`], [`MAX_UART_BYTES`] and [`MAX_USB_ITEMS`] a request.

use std::io::{self, Read, Write};

use crate::constants::{MAX_ADVANCE_NS, MAX_UART_BYTES, MAX_USB_ITEMS, USB_PACKET_MAX};
use crate::mishap::Mishap;
use crate::usb::{Cable, ControlOutcome, ControlTransfer, Setup, UsbPacket, UsbState};

/// What the greeting starts with.
pub const MAGIC: [u8; 8] = *b"GRIPEMU\0";
/// The version of this layout.
pub const VERSION: u32 = 4;
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
    /// A request with more packets or control transfers than one may carry.
    #[error("request: USB packets or transfers expected at most {MAX_USB_ITEMS}, found {0}; split them")]
    UsbItems(u32),
    /// A packet that full-speed USB cannot carry.
    #[error("request: USB packet expected to have at most {USB_PACKET_MAX} bytes, found {0}")]
    UsbPacket(u8),
    /// A number that means nothing.
    #[error("{field}: expected a number below {below}, found {found}")]
    Number {
        /// Which field.
        field: &'static str,
        /// One more than the largest number that means something.
        below: usize,
        /// What was there.
        found: u8,
    },
}

const CABLES: [Cable; 3] = [Cable::Out, Cable::In, Cable::Asleep];
const STATES: [UsbState; 5] = [
    UsbState::Detached,
    UsbState::Enumerating,
    UsbState::Configured,
    UsbState::Suspended,
    UsbState::Failed,
];
const OUTCOMES: [ControlOutcome; 5] = [
    ControlOutcome::Done,
    ControlOutcome::Stalled,
    ControlOutcome::TimedOut,
    ControlOutcome::NoAnswer,
    ControlOutcome::Abandoned,
];

/// Let time pass, with bytes on the firmware's UART line from now.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Request {
    /// Nanoseconds to run for.
    pub advance_ns: u64,
    /// The USB cable from now on.
    pub cable: Cable,
    /// The bytes, oldest first.
    pub uart_bytes: Vec<u8>,
    /// Bulk packets for the firmware, oldest first.
    pub usb_packets: Vec<Vec<u8>>,
    /// Control transfers for the USB host to make: what is asked, and what is written if it writes.
    pub usb_controls: Vec<(Setup, Vec<u8>)>,
    /// What becomes of the program at the next touch of an address; 0 for none.
    pub mishap: (Mishap, u32),
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
    /// How far the USB host has come.
    pub usb_state: UsbState,
    /// How often the device was made ready since power-on.
    pub usb_enumerations: u32,
    /// Bulk packets that the firmware has not taken yet.
    pub usb_waiting: u32,
    /// Bulk packets from the firmware since the last reply.
    pub usb_packets: Vec<UsbPacket>,
    /// Control transfers that ended since the last reply.
    pub usb_transfers: Vec<ControlTransfer>,
    /// When the restarts since the last reply happened, virtual nanoseconds.
    pub resets_ns: Vec<u64>,
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
        to.write_all(&[number(&CABLES, &self.cable)])?;
        write_bytes(to, &self.uart_bytes)?;
        to.write_all(&(self.usb_packets.len() as u32).to_le_bytes())?;
        for packet in &self.usb_packets {
            to.write_all(&[packet.len() as u8])?;
            to.write_all(packet)?;
        }
        to.write_all(&(self.usb_controls.len() as u32).to_le_bytes())?;
        for (setup, data) in &self.usb_controls {
            to.write_all(setup)?;
            to.write_all(&(data.len() as u16).to_le_bytes())?;
            to.write_all(data)?;
        }
        let (mishap, address) = self.mishap;
        to.write_all(&[number(&Mishap::ALL, &mishap)])?;
        to.write_all(&address.to_le_bytes())?;
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
        let cable = named("cable", &CABLES, from)?;
        let length = read_u32(from)?;
        if length > MAX_UART_BYTES {
            return Err(WireError::UartBytes(length));
        }
        let uart_bytes = read_bytes(from, length as usize)?;
        let mut usb_packets = Vec::new();
        for _ in 0..read_count(from)? {
            let [length] = read_array(from)?;
            if usize::from(length) > USB_PACKET_MAX {
                return Err(WireError::UsbPacket(length));
            }
            usb_packets.push(read_bytes(from, length.into())?);
        }
        let mut usb_controls = Vec::new();
        for _ in 0..read_count(from)? {
            let setup = read_array(from)?;
            let length = u16::from_le_bytes(read_array(from)?);
            usb_controls.push((setup, read_bytes(from, length.into())?));
        }
        let mishap = named("mishap", &Mishap::ALL, from)?;
        let mishap = (mishap, read_u32(from)?);
        Ok(Some(Self {
            advance_ns,
            cable,
            uart_bytes,
            usb_packets,
            usb_controls,
            mishap,
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
        to.write_all(&[number(&STATES, &self.usb_state)])?;
        to.write_all(&self.usb_enumerations.to_le_bytes())?;
        to.write_all(&self.usb_waiting.to_le_bytes())?;
        to.write_all(&(self.usb_packets.len() as u32).to_le_bytes())?;
        for packet in &self.usb_packets {
            to.write_all(&packet.at_ns.to_le_bytes())?;
            to.write_all(&[packet.bytes.len() as u8])?;
            to.write_all(&packet.bytes)?;
        }
        to.write_all(&(self.usb_transfers.len() as u32).to_le_bytes())?;
        for transfer in &self.usb_transfers {
            to.write_all(&transfer.at_ns.to_le_bytes())?;
            to.write_all(&transfer.setup)?;
            to.write_all(&[number(&OUTCOMES, &transfer.outcome)])?;
            to.write_all(&(transfer.data.len() as u16).to_le_bytes())?;
            to.write_all(&transfer.data)?;
        }
        to.write_all(&(self.resets_ns.len() as u32).to_le_bytes())?;
        for at_ns in &self.resets_ns {
            to.write_all(&at_ns.to_le_bytes())?;
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
        let length = read_u32(from)? as usize;
        let uart_bytes = read_bytes(from, length)?;
        let line_writes = (0..read_u32(from)?)
            .map(|_| {
                Ok(LineWrite {
                    at_ns: u64::from_le_bytes(read_array(from)?),
                    code: u16::from_le_bytes(read_array(from)?),
                })
            })
            .collect::<Result<_, WireError>>()?;
        let usb_state = named("USB state", &STATES, from)?;
        let usb_enumerations = read_u32(from)?;
        let usb_waiting = read_u32(from)?;
        let usb_packets = (0..read_u32(from)?)
            .map(|_| {
                let at_ns = u64::from_le_bytes(read_array(from)?);
                let [length] = read_array(from)?;
                let bytes = read_bytes(from, length.into())?;
                Ok(UsbPacket { at_ns, bytes })
            })
            .collect::<Result<_, WireError>>()?;
        let usb_transfers = (0..read_u32(from)?)
            .map(|_| {
                let at_ns = u64::from_le_bytes(read_array(from)?);
                let setup = read_array(from)?;
                let outcome = named("outcome", &OUTCOMES, from)?;
                let length = u16::from_le_bytes(read_array(from)?);
                let data = read_bytes(from, length.into())?;
                Ok(ControlTransfer {
                    at_ns,
                    setup,
                    data,
                    outcome,
                })
            })
            .collect::<Result<_, WireError>>()?;
        let resets_ns = (0..read_u32(from)?)
            .map(|_| Ok(u64::from_le_bytes(read_array(from)?)))
            .collect::<Result<_, WireError>>()?;
        Ok(Self {
            now_ns,
            instructions,
            resets,
            dac_code,
            uart_bytes,
            line_writes,
            usb_state,
            usb_enumerations,
            usb_waiting,
            usb_packets,
            usb_transfers,
            resets_ns,
        })
    }
}

fn write_bytes(to: &mut impl Write, bytes: &[u8]) -> io::Result<()> {
    to.write_all(&(bytes.len() as u32).to_le_bytes())?;
    to.write_all(bytes)
}

/// A thing's number on the wire: its place among `all`.
fn number<T: PartialEq>(all: &[T], thing: &T) -> u8 {
    let place = all.iter().position(|other| other == thing);
    place.expect("every variant is listed") as u8
}

/// The thing whose number comes next.
fn named<T: Copy>(field: &'static str, all: &[T], from: &mut impl Read) -> Result<T, WireError> {
    let [found] = read_array(from)?;
    all.get(usize::from(found)).copied().ok_or(WireError::Number {
        field,
        below: all.len(),
        found,
    })
}

fn read_count(from: &mut impl Read) -> Result<u32, WireError> {
    let count = read_u32(from)?;
    if count > MAX_USB_ITEMS {
        return Err(WireError::UsbItems(count));
    }
    Ok(count)
}

fn read_bytes(from: &mut impl Read, length: usize) -> io::Result<Vec<u8>> {
    let mut bytes = vec![0; length];
    from.read_exact(&mut bytes)?;
    Ok(bytes)
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
            usb_state: UsbState::Configured,
            usb_enumerations: 3,
            usb_waiting: 4,
            usb_packets: vec![UsbPacket {
                at_ns: 7,
                bytes: vec![0xCC],
            }],
            usb_transfers: vec![ControlTransfer {
                at_ns: 8,
                setup: [1, 2, 3, 4, 5, 6, 7, 8],
                data: vec![0xDD],
                outcome: ControlOutcome::Stalled,
            }],
            resets_ns: vec![9],
        }
    }

    #[test]
    fn a_request_is_laid_out_as_documented() {
        let mut bytes = Vec::new();
        Request {
            advance_ns: 0x0102,
            cable: Cable::Asleep,
            uart_bytes: vec![7, 8, 9],
            usb_packets: vec![vec![4, 5]],
            usb_controls: vec![([8, 7, 6, 5, 4, 3, 2, 1], vec![0xEE])],
            mishap: (Mishap::Panic, 0x4000_7408),
        }
        .write(&mut bytes)
        .unwrap();
        let expected: &[&[u8]] = &[
            &[1, 2, 1, 0, 0, 0, 0, 0, 0, 2],
            &[3, 0, 0, 0, 7, 8, 9],
            &[1, 0, 0, 0, 2, 4, 5],
            &[1, 0, 0, 0, 8, 7, 6, 5, 4, 3, 2, 1, 1, 0, 0xEE],
            &[2, 0x08, 0x74, 0, 0x40],
        ];
        assert_eq!(bytes, expected.concat());
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
            &[2, 3, 0, 0, 0, 4, 0, 0, 0],
            &[1, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0, 1, 0xCC],
            &[1, 0, 0, 0, 8, 0, 0, 0, 0, 0, 0, 0],
            &[1, 2, 3, 4, 5, 6, 7, 8, 1, 1, 0, 0xDD],
            &[1, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 0],
        ];
        assert_eq!(bytes, expected.concat());
    }

    #[test]
    fn every_message_survives_the_round_trip() {
        let request = Request {
            advance_ns: MAX_ADVANCE_NS,
            cable: Cable::In,
            uart_bytes: vec![1; MAX_UART_BYTES as usize],
            usb_packets: vec![vec![2; USB_PACKET_MAX], vec![]],
            usb_controls: vec![([3; 8], vec![4; 70]), ([5; 8], vec![])],
            mishap: (Mishap::Fault, 5),
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
            ..Request::default()
        }
        .write(&mut long)
        .unwrap();
        let mut wide = Vec::new();
        Request {
            uart_bytes: vec![0; MAX_UART_BYTES as usize + 1],
            ..Request::default()
        }
        .write(&mut wide)
        .unwrap();
        let mut big = Vec::new();
        Request {
            usb_packets: vec![vec![0; 65]],
            ..Request::default()
        }
        .write(&mut big)
        .unwrap();
        let mut cable = vec![1, 0, 0, 0, 0, 0, 0, 0, 0];
        cable.push(3);
        for (bytes, words) in [
            (long, ["advance_ns", "60000000000", "60000000001"]),
            (wide, ["UART bytes", "65536", "65537"]),
            (big, ["USB packet", "64 bytes", "found 65"]),
            (cable, ["cable", "below 3", "found 3"]),
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
        let newer = read_greeting(&mut b"GRIPEMU\0\x05\0\0\0".as_slice());
        assert!(matches!(newer, Err(WireError::Version(5))), "{newer:?}");
    }
}
