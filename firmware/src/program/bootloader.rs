//! The restart into the chip's own bootloader, for a firmware update: the board restarts when the program says so. Units: µs.

use gripline_protocol::message::Bootloader;

use super::dispatch::Program;
use crate::sums::Kernel;

/// How long the answer may take to the host before the restart.
const ANSWER_US: u64 = 100_000;

impl<K: Kernel> Program<K> {
    /// The host asks for the bootloader, where nothing drives the line.
    pub(super) fn ask_for_bootloader(&mut self) {
        if self.is_empty_handed() {
            self.bootloader.due_us = Some(self.now_us + ANSWER_US);
            self.answer_bootloader(Bootloader::Entering);
        } else {
            self.answer_bootloader(Bootloader::Holding);
        }
    }

    /// Whether to restart in the bootloader now: once per request, when its answer was sent and the gripper is still empty. Call it
    /// between two ticks, outside the map-to-line path.
    pub fn take_bootloader(&mut self) -> bool {
        let Some(due_us) = self.bootloader.due_us else {
            return false;
        };
        if !self.is_empty_handed() {
            self.bootloader.due_us = None;
            self.answer_bootloader(Bootloader::Holding);
            return false;
        }
        if self.now_us < due_us {
            return false;
        }
        self.bootloader.due_us = None;
        true
    }

    fn answer_bootloader(&mut self, answer: Bootloader) {
        self.bootloader.answer = Some(answer);
        // A status goes out behind it, so that there is something to say.
        self.send_status();
    }
}
