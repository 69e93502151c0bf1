//! The analog line, read back: whether what is measured is what was written.
//!
//! A converter measures the line at the gripper's end, divided by the op-amp's gain, and the chip's own reference voltage. So the
//! result is the line in volts, whatever the supply, which both converters take for their full scale.
//! Units: DAC codes of 12 bits at a supply of 3.3 V, 0.806 mV each at the pin. Limits: a line that changes all the time is
//! checked against the lowest and the highest code of the last `SETTLING_TICKS` ticks.

use crate::line::DacCode;

/// The reference voltage over a supply of 3.3 V in codes when the chip does not tell its own: 1.21 V (data sheet, "Embedded
/// internal reference voltage").
pub const REFERENCE_TYPICAL: u16 = 1_502;
/// The chip's own value may differ from that by this much: 1.18 to 1.24 V, and the error of the converter.
const REFERENCE_SPREAD: u16 = 60;
/// Allowed deviation of the line: 2 % of full scale and 4 % of the written value. Resistors of 1 % at gain and divider, and a
/// supply within 2 %, stay below it.
const TOLERANCE: u16 = 82;
/// See [`TOLERANCE`]: one part in this of the written value.
const TOLERANCE_PART: u16 = 25;
/// Ticks in which the line settles: 3 ms, twenty time constants of the filter at the DAC's pin.
const SETTLING_TICKS: usize = 4;
/// Measurements in a row, one a tick, that raise or clear the fault.
const ALIKE: u8 = 5;

/// The line and the reference, measured by the converter together, 12 bits each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LineSample {
    /// The line.
    pub line: u16,
    /// The reference voltage.
    pub reference: u16,
}

/// Compares the line with the written value, once per tick.
#[derive(Debug, Clone, Copy)]
pub struct LineMonitor {
    /// The reference at a supply of 3.3 V.
    reference: u16,
    /// The codes of the last ticks.
    written: [DacCode; SETTLING_TICKS],
    place: usize,
    /// Measurements in a row that contradict `is_wrong`.
    other: u8,
    is_wrong: bool,
}

impl LineMonitor {
    /// `calibrated` is the reference that the factory measured at 3.3 V and stored in the chip; an impossible value, like an erased
    /// one, is replaced by the typical one. `code` is the DAC's present code.
    #[must_use]
    pub const fn new(calibrated: u16, code: DacCode) -> Self {
        let reference = if calibrated.abs_diff(REFERENCE_TYPICAL) <= REFERENCE_SPREAD {
            calibrated
        } else {
            REFERENCE_TYPICAL
        };
        Self {
            reference,
            written: [code; SETTLING_TICKS],
            place: 0,
            other: 0,
            is_wrong: false,
        }
    }

    /// Takes the DAC's present code and the newest measurement; a missing measurement counts as a wrong one. Returns whether the
    /// line differs from the written value.
    pub fn observe(&mut self, code: DacCode, sample: Option<LineSample>) -> bool {
        self.written[self.place] = code;
        self.place = (self.place + 1) % SETTLING_TICKS;
        let is_right = sample.is_some_and(|sample| self.agrees(sample));
        self.other = if is_right == self.is_wrong {
            self.other + 1
        } else {
            0
        };
        if self.other >= ALIKE {
            self.is_wrong = !self.is_wrong;
            self.other = 0;
        }
        self.is_wrong
    }

    /// The line in codes at 3.3 V; full scale without a reference.
    fn measured(&self, sample: LineSample) -> u16 {
        let product = u32::from(sample.line) * u32::from(self.reference);
        let codes = product.checked_div(sample.reference.into()).unwrap_or(u32::MAX);
        codes.min(u16::MAX.into()) as u16
    }

    fn agrees(&self, sample: LineSample) -> bool {
        let measured = self.measured(sample);
        let tolerance = |code: u16| TOLERANCE + code / TOLERANCE_PART;
        let (low, high) = self
            .written
            .iter()
            .fold((u16::MAX, 0), |(low, high), &DacCode(code)| {
                (code.min(low), code.max(high))
            });
        measured.saturating_add(tolerance(low)) >= low && measured <= high.saturating_add(tolerance(high))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a converter measures of a line at these millivolts, at this supply.
    fn sample(millivolts: u32, supply_mv: u32) -> LineSample {
        let measured = |millivolts: u32| (millivolts * 4_095 / supply_mv).min(4_095) as u16;
        LineSample {
            line: measured(millivolts),
            reference: measured(1_210),
        }
    }

    /// The millivolts of a code at 3.3 V.
    fn millivolts(code: u16) -> u32 {
        u32::from(code) * 3_300 / 4_095
    }

    /// After this many alike measurements.
    fn after(ticks: usize, code: u16, sample: impl Into<Option<LineSample>>) -> bool {
        let sample = sample.into();
        let mut monitor = LineMonitor::new(0xFFFF, DacCode(code));
        (0..ticks).fold(false, |_, _| monitor.observe(DacCode(code), sample))
    }

    #[test]
    fn a_line_within_its_tolerance_is_right_at_every_code_and_supply() {
        for code in (819..=4_095).step_by(7) {
            for supply in [3_234, 3_300, 3_366] {
                // The DAC's full scale is the supply: so much less or more arrives.
                let shown = millivolts(code) * supply / 3_300;
                assert!(!after(20, code, sample(shown, supply)), "{code} at {supply} mV");
            }
        }
    }

    #[test]
    fn a_line_that_is_shorted_broken_or_off_by_its_gain_is_wrong_after_five_ticks() {
        for (what, code, millivolts) in [
            ("shorted", 819, 0),
            ("shorted", 4_095, 0),
            ("broken", 819, 1_336),
            ("broken", 2_500, 1_336),
            ("gain 0.8", 1_500, millivolts(1_200)),
            ("gain 0.9", 4_095, millivolts(3_685)),
            ("gain 1.2", 1_500, millivolts(1_800)),
        ] {
            assert!(!after(4, code, sample(millivolts, 3_300)), "{what} at {code}");
            assert!(after(5, code, sample(millivolts, 3_300)), "{what} at {code}");
        }
    }

    #[test]
    fn a_supply_that_is_off_is_seen_through_the_reference() {
        // The ratio to the supply is right, the volts are not.
        assert!(after(5, 3_000, sample(millivolts(3_000) * 2_900 / 3_300, 2_900)));
    }

    #[test]
    fn a_line_that_moves_is_right_while_it_follows_within_its_settling_time() {
        let mut monitor = LineMonitor::new(1_490, DacCode(819));
        let mut lagging = 819;
        for tick in 0..600_u16 {
            let code = if tick < 300 {
                819 + tick * 10
            } else {
                3_819 - (tick - 300) * 10
            };
            // What was measured is what was written two ticks ago.
            let of_then = sample(millivolts(lagging) * 1_502 / 1_490, 3_300);
            assert!(!monitor.observe(DacCode(code), Some(of_then)), "at tick {tick}");
            lagging = code.saturating_sub(if tick < 300 { 20 } else { 0 }).max(819);
        }
    }

    #[test]
    fn one_wrong_measurement_is_no_fault_and_a_right_line_clears_it() {
        let mut monitor = LineMonitor::new(0, DacCode(2_000));
        let (right, wrong) = (sample(millivolts(2_000), 3_300), sample(0, 3_300));
        for _ in 0..20 {
            assert!(!monitor.observe(DacCode(2_000), Some(right)));
            assert!(!monitor.observe(DacCode(2_000), Some(wrong)));
        }
        for _ in 0..5 {
            monitor.observe(DacCode(2_000), Some(wrong));
        }
        assert!(monitor.observe(DacCode(2_000), Some(wrong)));
        for _ in 0..4 {
            assert!(monitor.observe(DacCode(2_000), Some(right)));
        }
        assert!(!monitor.observe(DacCode(2_000), Some(right)));
    }

    #[test]
    fn a_converter_that_gives_nothing_or_no_reference_is_wrong() {
        assert!(after(5, 2_000, None));
        let dead = LineSample {
            line: 2_000,
            reference: 0,
        };
        assert!(after(5, 2_000, dead));
    }
}
