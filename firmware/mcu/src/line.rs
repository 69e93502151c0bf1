//! The grip-force line as a voltage: DAC channel 1 on PA4, with a live zero, so that a broken wire shows.
//!
//! Units: force in 1/4096 N, DAC codes of 12 bits. Why not the HAL's DAC driver: it resets the DAC when it opens it, which
//! would drop the line that was restored after a watchdog reset; embedded-hal 1.0 has no trait for a DAC.
//! Limits: the DAC's buffer is off, because it ends 0.2 V below the supply; the op-amp behind the pin must draw no current
//! (source resistance 15 kΩ).

use embassy_stm32::gpio::Flex;
use embassy_stm32::pac;
use embassy_stm32::{Peri, peripherals};
use gripline_firmware::GripForce;
use gripline_firmware::line::{DacCode, DacLine, DacOutput, LineCalibration};

use crate::reset;

/// The line of this board; remembers what it shows in memory that survives a reset.
pub(crate) type AnalogLine = DacLine<Dac>;

/// Channel 1.
pub(crate) struct Dac(());

/// Drives the line to `force`, whatever state a reset left. Needs only the internal clock.
pub(crate) fn start(force: GripForce, calibration: LineCalibration) -> AnalogLine {
    pac::RCC.apb1enr().modify(|enable| enable.set_dacen(true));
    // The clock takes two cycles to arrive (errata, "Delay after an RCC peripheral clock enabling").
    let _ = pac::RCC.apb1enr().read();
    // The value before the output: the output must never show zero volts.
    let line = DacLine::start(Dac(()), calibration, force);
    pac::DAC1.cr().modify(|control| {
        control.set_boff(0, true);
        control.set_en(0, true);
    });
    // Once more: a write to a disabled channel may be ignored.
    write_code(calibration.code(force));
    line
}

impl DacOutput for Dac {
    #[inline]
    fn show(&mut self, code: DacCode) {
        write_code(code);
    }

    #[inline]
    fn keep(&mut self, force: GripForce) {
        reset::keep_line(force);
    }
}

fn write_code(code: DacCode) {
    pac::DAC1.dhr12r(0).write(|value| value.set_dhr(code.0));
}

/// Waits until the DAC shows what was written: reading its output comes after the write on the same bus, and without a trigger the
/// value moves there one of that bus's clocks later (RM0090, section 14.3.4).
#[inline]
pub(crate) fn wait_until_shown() {
    let _ = pac::DAC1.dor(0).read();
}

/// Makes the pin analog, so that its digital input no longer loads the DAC, which drives it since [`start`].
pub(crate) fn route(pin: Peri<'static, peripherals::PA4>) {
    Flex::new(pin).set_as_analog();
}
