//! The trait of every link, and the state of its device.

pub(crate) use crate::error::LinkError;

/// A connection to a microcontroller.
pub trait Link {
    /// Sends one packet of at most 64 bytes.
    ///
    /// # Errors
    /// [`LinkError::NotTaken`] when the packet is lost and the link recovers by itself; another when the other end is gone for
    /// good.
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError>;

    /// Works until `until_us` and passes every received packet to `received`. A link that owns the microcontroller's clock moves it
    /// there at once; a real one waits for the wall clock.
    ///
    /// # Errors
    /// [`LinkError`] when the other end is gone.
    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError>;

    /// Time of the microcontroller's clock on this link: virtual for one in this process or emulated.
    fn now_us(&self) -> u64;

    /// Whether time passes without [`Link::run_until`], as for a real device: the caller need not wait in it.
    fn is_real_time(&self) -> bool {
        false
    }

    /// What it is, for people.
    fn name(&self) -> String;

    /// The grip-force line at this moment, 1/4096 N, if the link knows it (the microcontroller in this process): it moves every
    /// millisecond, and a status has only its value when a map was answered.
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

/// Whether a link's device is connected.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Presence {
    /// Why it is away; `None` while it is there.
    pub away: Option<String>,
    /// How often it went away.
    pub losses: u32,
    /// Packets that it did not take, away or busy.
    pub packets_lost: u64,
}
