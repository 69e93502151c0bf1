//! Storing settings: the board writes them to flash when the program says so.

use gripline_protocol::message::{Configuration, GripMode, Refusal};

use super::dispatch::Program;
use crate::grip::GripForce;
use crate::sums::Kernel;

impl<K: Kernel> Program<K> {
    /// Whether the gripper is surely empty: writing the flash stops the processor, and the bootloader does not drive the line.
    pub(super) fn is_empty_handed(&self) -> bool {
        self.controller.mode() == GripMode::Released && self.line() == GripForce::ZERO
    }

    /// The settings to write to flash now, once per `Store`. Call it between two ticks, outside the map-to-line path, and report
    /// the outcome with [`Self::stored`].
    pub fn take_store(&mut self) -> Option<Configuration> {
        if !core::mem::take(&mut self.store) {
            return None;
        }
        if !self.is_empty_handed() {
            self.refuse(Refusal::Holding);
            return None;
        }
        Some(self.settings)
    }

    /// Reports the outcome of a store: the number of writes since the chip was new, or `None` if it failed.
    pub fn stored(&mut self, writes: Option<u32>) {
        match writes {
            Some(writes) => self.outbox.stored = Some(writes),
            None => self.refuse(Refusal::FlashFailed),
        }
    }
}
