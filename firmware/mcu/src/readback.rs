//! The analog line, read back: ADC1 measures channel 6 (PA6) and the internal reference (channel 17) once a tick.
//!
//! The two conversions take 27 µs at 21 MHz, started by one tick and read by the next, so nothing waits for them. No HAL
//! driver, because its conversions block or need DMA.
//! Limits: the tick must come more than 27 µs after the one before, which it does.

use core::ptr;

use embassy_stm32::gpio::Flex;
use embassy_stm32::pac::adc::regs::Sr;
use embassy_stm32::pac::adc::vals::SampleTime;
use embassy_stm32::pac::adccommon::vals::Adcpre;
use embassy_stm32::pac::{ADC1, ADC123_COMMON, DAC1, RCC};
use embassy_stm32::{Peri, peripherals};
use gripline_firmware::line::DacCode;
use gripline_firmware::readback::{LineMonitor, LineSample};

/// The line on PA6, and the reference (reference manual, section 13.3.3).
const CHANNELS: [u8; 2] = [6, 17];
/// Where the factory keeps the reference at 3.3 V and 30 °C, 16 bits (data sheet, "Internal reference voltage calibration
/// values").
const CALIBRATION: usize = 0x1FFF_7A2A;

/// The converter and what it is compared with.
pub(crate) struct ReadBack(LineMonitor);

impl ReadBack {
    /// Switches the converter on; the first measurement begins with the first tick, long after its 3 µs of settling.
    pub(crate) fn start(pin: Peri<'static, peripherals::PA6>) -> Self {
        Flex::new(pin).set_as_analog();
        RCC.apb2enr().modify(|enable| enable.set_adc1en(true));
        // The clock takes two cycles to arrive.
        let _ = RCC.apb2enr().read();
        ADC123_COMMON.ccr().modify(|control| {
            control.set_adcpre(Adcpre::DIV4);
            control.set_tsvrefe(true);
        });
        // An injected group: a data register for each channel.
        ADC1.cr1().modify(|control| control.set_scan(true));
        ADC1.smpr2()
            .modify(|times| times.set_smp(CHANNELS[0].into(), SampleTime::CYCLES56));
        // The reference needs 10 µs.
        ADC1.smpr1()
            .modify(|times| times.set_smp(usize::from(CHANNELS[1]) - 10, SampleTime::CYCLES480));
        ADC1.jsqr().modify(|sequence| {
            // Two conversions take the last two places.
            sequence.set_jl(1);
            sequence.set_jsq(2, CHANNELS[0]);
            sequence.set_jsq(3, CHANNELS[1]);
        });
        ADC1.cr2().modify(|control| control.set_adon(true));
        // SAFETY: the chip's system memory, aligned; any bits are a `u16`.
        let calibrated = unsafe { ptr::with_exposed_provenance::<u16>(CALIBRATION).read_volatile() };
        Self(LineMonitor::new(calibrated, code()))
    }

    /// Takes the measurement of the tick before and starts the next one. Whether the line is not what was written.
    pub(crate) fn is_wrong(&mut self) -> bool {
        let sample = ADC1.sr().read().jeoc().then(|| LineSample {
            line: ADC1.jdr(0).read().jdata(),
            reference: ADC1.jdr(1).read().jdata(),
        });
        // Writing zeros clears.
        ADC1.sr().write_value(Sr(0));
        ADC1.cr2().modify(|control| control.set_jswstart(true));
        self.0.observe(code(), sample)
    }
}

/// What the DAC shows.
fn code() -> DacCode {
    DacCode(DAC1.dor(0).read().dor())
}
