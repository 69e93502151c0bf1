//! What the board itself monitors, besides maps and messages: its supply, its line, the inputs and outputs for the robot.

use gripline_protocol::message::GripMode;

use super::dispatch::Program;
use crate::fault::{Fault, FaultSet, Severity};
use crate::grip::GripForce;
use crate::sums::Kernel;

/// The faults that set the fault output: those of severity warning and error.
const TOLD: u32 = {
    let (mut faults, mut place) = (0, 0);
    while place < Fault::ALL.len() {
        let fault = Fault::ALL[place];
        if !matches!(fault.severity(), Severity::Info) {
            faults |= fault.bit();
        }
        place += 1;
    }
    faults
};

impl<K: Kernel> Program<K> {
    /// Takes the board's present faults; other faults in the set are ignored.
    pub fn note_board(&mut self, present: FaultSet) {
        // No loop: this blocks the map-to-line path.
        let mut set = |fault| self.safety.set(fault, present.has(fault));
        set(Fault::Undervoltage);
        set(Fault::BrownOutLevel);
        set(Fault::LineMismatch);
    }

    /// Takes the release-inhibit input. While it is active, `Release` is refused; a release under way stops and holds what is
    /// left of the grip.
    pub fn inhibit_release(&mut self, is_inhibited: bool) {
        self.is_release_inhibited = is_inhibited;
        let holds_something = self.line() > GripForce::ZERO;
        if is_inhibited && holds_something && self.controller.mode() == GripMode::Released {
            self.controller.set_mode(GripMode::Hold);
        }
    }

    /// Whether the fault output must be low: the grip no longer follows its load, or a person must look.
    #[must_use]
    pub const fn is_at_fault(&self) -> bool {
        (self.safety.active().bits() | self.safety.latched().bits()) & TOLD != 0
    }
}
