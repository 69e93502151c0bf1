//! The 3.3 V supply: the voltage detector and the brown-out level.
//!
//! Two thresholds, so that a falling supply is noticed before it resets the chip. The detector (PVD, level 6) trips at 2.93 V
//! and clears at 3.03 V (data sheet, "Embedded reset and power control block characteristics"). Brown-out level 3 holds the chip
//! in reset below 2.83 V, where the flash may be read at 168 MHz and the DAC and USB still work.
//! The level lies in the option bytes. This program never writes them, because a supply that fails in the middle may lock the
//! chip; `cargo xtask flash` does. It checks them.
//! Limits: the detector is asked once a tick, so a dip of less than a millisecond that stays above 2.83 V goes unseen.

use embassy_stm32::pac::{FLASH, PWR, RCC};
use gripline_firmware::{Fault, FaultSet};

/// The detector's level (reference manual, section 5.5.1, PLS).
const DETECTOR_LEVEL: u8 = 6;
/// Brown-out level 3 as the option bytes count it (section 3.9.10, `BOR_LEV`).
const LEVEL_3: u8 = 0;

/// Starts the voltage detector.
pub(crate) fn watch() {
    RCC.apb1enr().modify(|enable| enable.set_pwren(true));
    // The clock takes two cycles to arrive.
    let _ = RCC.apb1enr().read();
    PWR.cr1().modify(|control| {
        control.set_pls(DETECTOR_LEVEL);
        control.set_pvde(true);
    });
}

/// Adds what is wrong with the supply now.
pub(crate) fn check(faults: &mut FaultSet) {
    faults.set(Fault::Undervoltage, PWR.csr1().read().pvdo());
    faults.set(Fault::BrownOutLevel, FLASH.optcr().read().bor_lev() != LEVEL_3);
}
