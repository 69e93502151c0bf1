//! Ways to a microcontroller, behind one trait: in this process, emulated, over a serial line, over USB.
//! Packets of at most 64 bytes each way; what is in them is [`session`]'s matter. Times in µs since the link
//! was opened. A real device may go away and come back ([`hot_plug`]).
#![forbid(unsafe_code)]

mod clock_sync;
mod embedded;
pub mod emulator;
mod handshake;
pub mod hot_plug;
mod serial;
pub mod session;
pub mod shadow;
pub mod usb;

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

pub use embedded::EmbeddedLink;
pub use emulator::{EmulatorLink, Transport};
pub use hot_plug::HotPlug;

use self::serial::SerialFinder;
use self::usb::{System, UsbFinder};

/// A real device that takes nothing for so long is stuck, and the next picture is due: a dense map takes 3 ms on full-speed
/// USB.
const SEND_WAIT: Duration = Duration::from_millis(10);

/// A device that was just plugged in is usable within this time: a few hundred milliseconds, and more on a busy system.
const READY_WITHIN: Duration = Duration::from_secs(2);

/// One way to a microcontroller.
pub trait Link {
    /// Hands over one packet of at most 64 bytes.
    ///
    /// # Errors
    /// [`LinkError::NotTaken`] when the packet is lost and the link mends itself; another when the other end is gone for
    /// good.
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError>;

    /// Works until `until_us` and hands every packet that comes in to `received`. A link that owns the
    /// microcontroller's clock moves it there at once; a real one waits for the wall clock.
    ///
    /// # Errors
    /// [`LinkError`] when the other end is gone.
    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError>;

    /// Time of the clock that the microcontroller on this link lives by: virtual for one in this process or emulated.
    fn now_us(&self) -> u64;

    /// What it is, for people.
    fn name(&self) -> String;

    /// The grip-force line at this moment, 1/4096 N, where the link can see it (the microcontroller in this process): it
    /// moves every millisecond, and a status tells only where it was when a map was answered.
    fn line(&self) -> Option<i32> {
        None
    }

    /// The code on the DAC of the grip-force line, where the link can see it (the emulator).
    fn line_code(&self) -> Option<u16> {
        None
    }

    /// Whether the device is there, and what was lost; a microcontroller in this process or emulated is never away.
    fn presence(&self) -> Presence {
        Presence::default()
    }
}

/// What a link has to say of its device's being there.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Presence {
    /// Why it is away; `None` while it is there.
    pub away: Option<String>,
    /// How often it went away.
    pub losses: u32,
    /// Packets that it did not take, away or busy.
    pub packets_lost: u64,
}

/// Why a link cannot be opened or has ended.
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
    /// A packet is lost; the link mends itself.
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
    /// It is attached, and the system has not made it usable: it was plugged in this moment, or it was refused its power.
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
    /// It worked and then did not any more.
    #[error("{link}: {found}")]
    Broken {
        /// Which link.
        link: String,
        /// What happened.
        found: String,
    },
}

/// Which microcontroller to use: the value of `--mcu`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Target {
    /// The firmware library in this process.
    #[default]
    Embedded,
    /// The unmodified firmware image in the emulator, over this transport.
    Emulator(Transport),
    /// A serial port.
    Serial(String),
    /// A USB device, by serial number when there are several.
    Usb(Option<String>),
}

impl FromStr for Target {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.split_once(':') {
            None if text == "embedded" => Ok(Self::Embedded),
            None if text == "emulator" => Ok(Self::Emulator(Transport::Usb)),
            Some(("emulator", "uart")) => Ok(Self::Emulator(Transport::Uart)),
            None if text == "usb" => Ok(Self::Usb(None)),
            Some(("usb", serial)) if !serial.is_empty() => Ok(Self::Usb(Some(serial.to_owned()))),
            Some(("serial", port)) if !port.is_empty() => Ok(Self::Serial(port.to_owned())),
            _ => Err(format!(
                "found {text}, expected embedded, emulator, emulator:uart, usb, usb:SERIAL or serial:PORT"
            )),
        }
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Embedded => f.write_str("embedded"),
            Self::Emulator(Transport::Usb) => f.write_str("emulator"),
            Self::Emulator(Transport::Uart) => f.write_str("emulator:uart"),
            Self::Serial(port) => write!(f, "serial:{port}"),
            Self::Usb(None) => f.write_str("usb"),
            Self::Usb(Some(serial)) => write!(f, "usb:{serial}"),
        }
    }
}

impl Target {
    /// Opens the link.
    ///
    /// # Errors
    /// [`LinkError`] when there is no such port or device, or another program has it.
    pub fn open(&self) -> Result<Box<dyn Link>, LinkError> {
        Ok(match self {
            Self::Embedded => Box::new(EmbeddedLink::new()),
            Self::Emulator(transport) => Box::new(EmulatorLink::spawn(*transport)?),
            Self::Serial(port) => Box::new(HotPlug::open(Box::new(SerialFinder(port.clone())))?),
            Self::Usb(serial) => {
                let finder = UsbFinder::new(System::default(), serial.clone());
                Box::new(HotPlug::open(Box::new(finder))?)
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_target_is_read_as_it_is_written() {
        for text in [
            "embedded",
            "emulator",
            "emulator:uart",
            "usb",
            "usb:A1",
            "serial:/dev/ttyUSB0",
            "serial:COM3",
        ] {
            assert_eq!(text.parse::<Target>().unwrap().to_string(), text);
        }
        for text in ["", "usb:", "serial", "serial:", "embedded:1", "emulator:", "can"] {
            assert!(
                text.parse::<Target>().unwrap_err().contains("expected embedded"),
                "{text}"
            );
        }
    }
}
