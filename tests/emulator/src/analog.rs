//! The analog line from the DAC's pin to the converter that reads it back: what arrives, whatever the wiring does to it.
//! Units: 12-bit codes, millivolts at the converter's pin, which sees the line divided by the op-amp's gain.
//! Limits: no time constant and no noise; whole millivolts.

use gripline_emulator_wire::LineWiring;

use crate::constants::DIVIDER_PER_MILLE;

const CODE_MAX: u32 = 4_095;

/// The voltage at the converter's pin.
pub(crate) fn line_millivolts(code: Option<u16>, wiring: LineWiring, supply_mv: u32) -> u32 {
    let divider = supply_mv * DIVIDER_PER_MILLE / 1_000;
    let shown = code.map_or(divider, |code| {
        (u32::from(code) * supply_mv + CODE_MAX / 2) / CODE_MAX
    });
    match wiring {
        LineWiring::Sound => shown,
        LineWiring::Shorted => 0,
        LineWiring::Broken => divider,
        LineWiring::Gain(per_mille) => shown * u32::from(per_mille) / 1_000,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_arrives_is_the_codes_share_of_the_supply_unless_the_wiring_fails() {
        let at = |code, wiring| line_millivolts(code, wiring, 3_300);
        assert_eq!(at(Some(4_095), LineWiring::Sound), 3_300);
        assert_eq!(at(Some(819), LineWiring::Sound), 660);
        assert_eq!(at(Some(819), LineWiring::Shorted), 0);
        assert_eq!(at(Some(819), LineWiring::Broken), 1_336);
        assert_eq!(at(None, LineWiring::Sound), 1_336);
        assert_eq!(at(Some(2_000), LineWiring::Gain(500)), 806);
    }
}
