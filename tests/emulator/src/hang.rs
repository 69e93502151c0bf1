//! A program that hangs: the instruction that touches a given address becomes a branch to itself, until the next reset.
//! Which task that is follows from the address: the DAC's is the map-to-line path's, the watchdog's the idle loop's.

use rigless::emulator::{Access, Host};
use rigless::soc::Width;

/// `b .` in Thumb (ARM DDI 0403, A7.7.12, encoding T2).
const BRANCH_TO_ITSELF: u64 = 0xE7FE;

/// A hang that was asked for, or that lasts.
#[derive(Debug, Default)]
pub(crate) struct Hang {
    asked: Option<u32>,
    /// The instruction's address and its first half-word, and the restarts before the hang.
    overwritten: Option<(u64, u64)>,
    resets: usize,
}

impl Hang {
    /// Hangs at the next touch of `address`.
    pub(crate) fn ask(&mut self, address: u32) {
        self.asked = Some(address);
    }

    /// After every access that the core made.
    pub(crate) fn settled(&mut self, access: &Access, host: &mut dyn Host) {
        let is_asked = self
            .asked
            .is_some_and(|address| u64::from(address) == access.address);
        if let (true, Some(at)) = (is_asked, access.program_counter)
            && let Ok(before) = host.read(at, Width::W16)
        {
            self.asked = None;
            self.overwritten = Some((at, before));
            put(host, at, BRANCH_TO_ITSELF);
        }
    }

    /// At every stop, with the restarts so far: the first one after the hang heals it.
    pub(crate) fn restarted(&mut self, resets: usize, host: &mut dyn Host) {
        if resets != self.resets {
            self.resets = resets;
            if let Some((at, before)) = self.overwritten.take() {
                put(host, at, before);
            }
        }
    }
}

/// Code lies in flash or in RAM.
fn put(host: &mut dyn Host, at: u64, half_word: u64) {
    let programmed = host.program(at, Width::W16, half_word);
    if programmed.is_err() {
        // RAM: the start-up code brings the right code back by itself as well.
        let _ = host.write(at, Width::W16, half_word);
    }
}
