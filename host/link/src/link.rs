//! The trait of every link, what it says of its device, and its errors.

use std::time::Duration;

/// A real device that takes nothing for so long is stuck, and the next picture is due: a dense map takes 3 ms on full-speed
/// USB.
pub(crate) const SEND_WAIT: Duration = Duration::from_millis(10);

/// A device that was just plugged in is usable within this time: a few hundred milliseconds, and more on a busy system.
pub(crate) const READY_WITHIN: Duration = Duration::from_secs(2);

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

    /// Whether time passes without [`Link::run_until`], as for a real device: nobody needs to wait in it.
    fn is_real_time(&self) -> bool {
        false
    }

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
