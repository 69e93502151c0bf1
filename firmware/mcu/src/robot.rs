//! Two wires for the robot: the release-inhibit input on PB1 and the fault output on PB0.
//!
//! The input is active high, with a weak pull-down: unwired, it inhibits nothing. The output is high while all is well. It is
//! low at a fault of severity warning or error, and whenever the chip does not drive it: a resistor to ground on the board says
//! fault for a dead or restarting chip.
//! Limits: both are looked at and set once a tick.

use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::{Peri, peripherals};

/// The two wires.
pub(crate) struct Robot {
    inhibit: Input<'static>,
    fault: Output<'static>,
}

impl Robot {
    /// Says fault until the program has looked.
    pub(crate) fn new(
        inhibit: Peri<'static, peripherals::PB1>,
        fault: Peri<'static, peripherals::PB0>,
    ) -> Self {
        Self {
            inhibit: Input::new(inhibit, Pull::Down),
            fault: Output::new(fault, Level::Low, Speed::Low),
        }
    }

    /// Whether the robot forbids a release.
    pub(crate) fn is_release_inhibited(&self) -> bool {
        self.inhibit.is_high()
    }

    /// Says whether there is a fault.
    pub(crate) fn tell(&mut self, is_at_fault: bool) {
        self.fault
            .set_level(if is_at_fault { Level::Low } else { Level::High });
    }
}
