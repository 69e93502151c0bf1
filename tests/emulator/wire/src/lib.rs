//! The pipe between `gripline-emulator` and its parent process, over standard input and output: the types of both ends.
//!
//! The board greets first. Then every [`Request`] has one [`Reply`]; end of file in place of a request ends the run. A message is
//! its length in bytes (`u32`, little-endian) and the value in postcard. Units: virtual nanoseconds since power-on, 12-bit DAC
//! codes. A reply lists what came since the reply before.
#![forbid(unsafe_code)]

use std::io::{self, Read, Write};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// What the greeting starts with; the version follows as a little-endian `u32`.
pub const MAGIC: [u8; 8] = *b"GRIPEMU\0";
/// The version of these types.
pub const VERSION: u32 = 8;
/// The longest advance that one request may ask for, nanoseconds: a minute, seconds of real time when busy.
pub const MAX_ADVANCE_NS: u64 = 60_000_000_000;
/// The most USB packets, and the most control transfers, that one request may carry.
pub const MAX_USB_ITEMS: usize = 65_536;
/// The largest bulk packet of full-speed USB, bytes.
pub const USB_PACKET_MAX: usize = 64;
/// The most disturbances that one request may carry.
pub const MAX_DISTURBANCES: usize = 64;
/// The most UART bytes that one request may carry.
pub const MAX_UART_BYTES: usize = 65_536;
/// The longest message, bytes: far above what the limits allow, so that a broken length cannot ask for all memory.
const MAX_MESSAGE_BYTES: u32 = 64 << 20;

/// Why the conversation ended.
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
    /// A message longer than any can be.
    #[error("message: length expected at most {MAX_MESSAGE_BYTES} bytes, found {0}")]
    Length(u32),
    /// A message that is none of ours.
    #[error("message: expected {expected}, found other bytes ({source})")]
    Message {
        /// What had to come.
        expected: &'static str,
        /// Where reading it failed.
        source: postcard::Error,
    },
    /// A request past one of its limits.
    #[error("request: {field} expected at most {max}, found {found}; split it")]
    Limit {
        /// Which field.
        field: &'static str,
        /// The most it may be.
        max: u64,
        /// What it is.
        found: u64,
    },
}

/// The eight bytes of a control transfer's SETUP packet (USB 2.0 section 9.3).
pub type Setup = [u8; 8];

/// What a person does with the USB cable, or the host with the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub enum Cable {
    /// Not plugged in: packets under way are lost.
    #[default]
    Out,
    /// Plugged in, the host awake.
    In,
    /// Plugged in, the host asleep: once the device is configured, the bus is suspended.
    Asleep,
}

/// A fault that is injected into the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum FaultInjection {
    /// It loops for ever.
    #[default]
    Hang,
    /// It runs into an undefined instruction.
    UndefinedInstruction,
    /// It goes where its panics go: the image's symbol `gripline_panic`.
    Panic,
    /// It pushes registers without end, so that the stack overflows.
    StackOverflow,
}

/// Where the analog line fails between the DAC's pin and the gripper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum LineWiring {
    /// Nowhere: what the DAC shows arrives.
    #[default]
    Sound,
    /// The gripper's wire lies on ground.
    Shorted,
    /// The wire from the DAC to the op-amp is open: the divider at the op-amp's input decides.
    Broken,
    /// The op-amp's gain is off: so many thousandths of what it should be.
    Gain(u16),
}

/// What happens to the board from outside.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Disturbance {
    /// The 3.3 V supply has this voltage from now on, millivolts.
    Supply(u32),
    /// The supply dips below the brown-out level, for a moment too short to measure.
    BrownOut {
        /// RAM holds noise afterwards.
        forgets: bool,
    },
    /// The analog line's wiring from now on.
    Line(LineWiring),
    /// The level on the release-inhibit input from now on; a board comes up with the input unwired.
    ReleaseInhibit(bool),
    /// The brown-out level in the option bytes, 0 (the highest, level 3) to 3 (off), as the register counts.
    BrownOutLevel(u8),
    /// The clock of the gripper's UART stops: nothing is sent and no interrupt comes.
    BusClockStops,
    /// Every access to the DAC keeps the core waiting so much longer from now on, nanoseconds, as one behind a busy bus does.
    SlowDac(u32),
    /// The wire to the UART's input is open (true) or whole from now on. What is sent into an open one is lost.
    UartOpen(bool),
}

/// How far the USB host has come with the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub enum UsbState {
    /// No device on the bus.
    #[default]
    Detached,
    /// Being reset, addressed, read.
    Enumerating,
    /// Its configuration is set: bulk packets flow.
    Configured,
    /// Configured, on a suspended bus.
    Suspended,
    /// The host gave it up.
    Failed,
}

/// How a control transfer ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum ControlOutcome {
    /// Through its status stage.
    Done,
    /// The device refused it.
    Stalled,
    /// The device put the host off until the host gave up.
    TimedOut,
    /// The device did not answer at all, or left.
    NoAnswer,
    /// This host broke it off, as it was asked to.
    Abandoned,
}

/// A control transfer that is over.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ControlTransfer {
    /// When it was over, virtual nanoseconds since power-on.
    pub at_ns: u64,
    /// What was asked.
    pub setup: Setup,
    /// What the device sent, or was sent.
    pub data: Vec<u8>,
    /// How it ended.
    pub outcome: ControlOutcome,
}

/// A packet from the device's bulk IN endpoint.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct UsbPacket {
    /// When its acknowledgement was over, virtual nanoseconds since power-on.
    pub at_ns: u64,
    /// What is in it.
    pub bytes: Vec<u8>,
}

/// A code on the grip-force line (DAC channel 1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct LineWrite {
    /// Virtual time since power-on, nanoseconds.
    pub at_ns: u64,
    /// The code, 0..=4095.
    pub code: u16,
}

/// Let time pass, with bytes and packets for the firmware from now on.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Request {
    /// Nanoseconds to run for.
    pub advance_ns: u64,
    /// The USB cable from now on.
    pub cable: Cable,
    /// Bytes for the UART line, oldest first.
    pub uart_bytes: Vec<u8>,
    /// Bulk packets for the firmware, oldest first.
    pub usb_packets: Vec<Vec<u8>>,
    /// Control transfers for the USB host to make: what is asked, and what is written if it writes.
    pub usb_controls: Vec<(Setup, Vec<u8>)>,
    /// A fault at the next touch of an address.
    pub fault: Option<(FaultInjection, u32)>,
    /// What happens to the board, in this order, before time goes on.
    pub disturbances: Vec<Disturbance>,
}

/// What the run came to.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
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
    /// The fault output's pin is high: no fault.
    pub fault_output: bool,
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
    let mut magic = MAGIC;
    from.read_exact(&mut magic)?;
    if magic != MAGIC {
        return Err(WireError::Magic(magic));
    }
    let mut version = [0; 4];
    from.read_exact(&mut version)?;
    match u32::from_le_bytes(version) {
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
        write(to, self, "a request")
    }

    /// Reads a request; `None` when the parent has closed the pipe between two.
    ///
    /// # Errors
    /// The pipe's, bytes that are no request, and a request past its limits.
    pub fn read(from: &mut impl Read) -> Result<Option<Self>, WireError> {
        let Some(request) = read::<Self>(from, "a request")? else {
            return Ok(None);
        };
        let longest_packet = request.usb_packets.iter().map(Vec::len).max().unwrap_or(0);
        for (field, max, found) in [
            ("advance_ns", MAX_ADVANCE_NS, request.advance_ns),
            (
                "UART bytes",
                MAX_UART_BYTES as u64,
                request.uart_bytes.len() as u64,
            ),
            (
                "USB packets",
                MAX_USB_ITEMS as u64,
                request.usb_packets.len() as u64,
            ),
            (
                "control transfers",
                MAX_USB_ITEMS as u64,
                request.usb_controls.len() as u64,
            ),
            (
                "disturbances",
                MAX_DISTURBANCES as u64,
                request.disturbances.len() as u64,
            ),
            (
                "bytes of a USB packet",
                USB_PACKET_MAX as u64,
                longest_packet as u64,
            ),
        ] {
            if found > max {
                return Err(WireError::Limit { field, max, found });
            }
        }
        Ok(Some(request))
    }
}

impl Reply {
    /// Writes the reply.
    ///
    /// # Errors
    /// The pipe's.
    pub fn write(&self, to: &mut impl Write) -> Result<(), WireError> {
        write(to, self, "a reply")
    }

    /// Reads a reply.
    ///
    /// # Errors
    /// The pipe's, its end, and bytes that are no reply.
    pub fn read(from: &mut impl Read) -> Result<Self, WireError> {
        read(from, "a reply")?.ok_or_else(|| io::Error::from(io::ErrorKind::UnexpectedEof).into())
    }
}

fn write(to: &mut impl Write, message: &impl Serialize, expected: &'static str) -> Result<(), WireError> {
    let bytes = postcard::to_stdvec(message).map_err(|source| WireError::Message { expected, source })?;
    to.write_all(&(bytes.len() as u32).to_le_bytes())?;
    to.write_all(&bytes)?;
    Ok(to.flush()?)
}

/// `None` at the end of the pipe between two messages.
fn read<T: DeserializeOwned>(from: &mut impl Read, expected: &'static str) -> Result<Option<T>, WireError> {
    let mut length = [0; 4];
    if from.read(&mut length[..1])? == 0 {
        return Ok(None);
    }
    from.read_exact(&mut length[1..])?;
    let length = u32::from_le_bytes(length);
    if length > MAX_MESSAGE_BYTES {
        return Err(WireError::Length(length));
    }
    let mut bytes = vec![0; length as usize];
    from.read_exact(&mut bytes)?;
    postcard::from_bytes(&bytes)
        .map(Some)
        .map_err(|source| WireError::Message { expected, source })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request() -> Request {
        Request {
            advance_ns: 0x0102,
            cable: Cable::Asleep,
            uart_bytes: vec![7, 8, 9],
            usb_packets: vec![vec![4, 5], vec![]],
            usb_controls: vec![([8, 7, 6, 5, 4, 3, 2, 1], vec![0xEE])],
            fault: Some((FaultInjection::Panic, 0x4000_7408)),
            disturbances: vec![
                Disturbance::Line(LineWiring::Gain(3)),
                Disturbance::BrownOut { forgets: true },
                Disturbance::SlowDac(300),
                Disturbance::UartOpen(true),
            ],
        }
    }

    fn reply() -> Reply {
        Reply {
            now_ns: 0x0102_0304_0506_0708,
            instructions: 9,
            resets: 2,
            dac_code: 0x0FED,
            uart_bytes: vec![0xAA, 0xBB],
            line_writes: vec![LineWrite {
                at_ns: 5,
                code: 0x0123,
            }],
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
            fault_output: true,
        }
    }

    #[test]
    fn every_message_survives_the_round_trip() {
        let mut pipe = Vec::new();
        write_greeting(&mut pipe).unwrap();
        request().write(&mut pipe).unwrap();
        reply().write(&mut pipe).unwrap();
        let mut from = pipe.as_slice();
        read_greeting(&mut from).unwrap();
        assert_eq!(Request::read(&mut from).unwrap(), Some(request()));
        assert_eq!(Reply::read(&mut from).unwrap(), reply());
        assert_eq!(from, [0_u8; 0]);
    }

    /// Another layout needs another [`VERSION`].
    #[test]
    fn the_bytes_of_this_version_stay() {
        let mut bytes = Vec::new();
        request().write(&mut bytes).unwrap();
        let expected: &[&[u8]] = &[
            &[44, 0, 0, 0],
            &[0x82, 0x02, 2],
            &[3, 7, 8, 9],
            &[2, 2, 4, 5, 0],
            &[1, 8, 7, 6, 5, 4, 3, 2, 1, 1, 0xEE],
            &[1, 2, 0x88, 0xE8, 0x81, 0x80, 0x04],
            &[4, 2, 3, 3, 1, 1, 6, 0xAC, 0x02, 7, 1],
        ];
        assert_eq!(bytes[4..], expected[1..].concat());
        assert_eq!(bytes[..4], ((bytes.len() - 4) as u32).to_le_bytes());
    }

    #[test]
    fn the_end_of_the_pipe_is_a_goodbye_between_requests_and_an_error_inside_one() {
        assert_eq!(Request::read(&mut [].as_slice()).unwrap(), None);
        let inside = Request::read(&mut [1, 2].as_slice());
        assert!(matches!(inside, Err(WireError::Pipe(_))), "{inside:?}");
        assert!(matches!(Reply::read(&mut [].as_slice()), Err(WireError::Pipe(_))));
    }

    #[test]
    fn a_request_past_its_limits_names_the_limit_and_what_was_found() {
        let asked = |change: fn(&mut Request)| {
            let mut request = Request::default();
            change(&mut request);
            let mut bytes = Vec::new();
            request.write(&mut bytes).unwrap();
            Request::read(&mut bytes.as_slice()).unwrap_err().to_string()
        };
        for (text, words) in [
            (
                asked(|r| r.advance_ns = MAX_ADVANCE_NS + 1),
                ["advance_ns", "60000000000", "60000000001"],
            ),
            (
                asked(|r| r.uart_bytes = vec![0; MAX_UART_BYTES + 1]),
                ["UART bytes", "65536", "65537"],
            ),
            (
                asked(|r| r.usb_packets = vec![vec![0; 65]]),
                ["USB packet", "64", "found 65"],
            ),
            (
                asked(|r| r.usb_packets = vec![vec![]; MAX_USB_ITEMS + 1]),
                ["USB packets", "65536", "65537"],
            ),
        ] {
            assert!(words.iter().all(|word| text.contains(word)), "{text}");
        }
    }

    #[test]
    fn bytes_that_are_no_message_are_refused_by_name() {
        let text = |bytes: &[u8]| Request::read(&mut &*bytes).unwrap_err().to_string();
        assert!(text(&[0xFF, 0xFF, 0xFF, 0xFF]).contains("at most 67108864 bytes, found 4294967295"));
        let unknown_cable = text(&[3, 0, 0, 0, 0, 9, 0]);
        assert!(unknown_cable.contains("a request"), "{unknown_cable}");
    }

    #[test]
    fn a_greeting_of_another_program_or_version_is_refused() {
        let other = read_greeting(&mut b"GRIPLINE\x01\0\0\0".as_slice());
        assert!(matches!(other, Err(WireError::Magic(_))), "{other:?}");
        let newer = read_greeting(&mut b"GRIPEMU\0\x09\0\0\0".as_slice());
        assert!(matches!(newer, Err(WireError::Version(9))), "{newer:?}");
    }
}
