//! The rule that every contestant decides by, and what a decision is.

use gripline_firmware::Friction;
use gripline_firmware::sums::{TaxelRule, stick_ratio_below};
use gripline_protocol::LSB_PER_NEWTON;
use gripline_protocol::message::MapSums;

/// The paper's friction and threshold, 1/10000, and a contact threshold of 0.02 N, 1/4096 N.
pub(crate) const FRICTION: u16 = 4_500;
pub(crate) const THRESHOLD: u16 = 5_000;
pub(crate) const CONTACT_MIN: i16 = 80;

/// The detector's rule.
pub(crate) const RULE: TaxelRule = TaxelRule {
    friction: Friction::clamped(FRICTION),
    contact_min: CONTACT_MIN,
};

/// Maps that are timed together: less than a slice of time that the system gives away.
pub(crate) const BLOCK: usize = 30;

/// What is decided about a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Decision {
    pub(crate) contact: u16,
    pub(crate) stick: u16,
    pub(crate) slips: bool,
    /// Σ fx, Σ fy, Σ fz, newtons.
    pub(crate) force_n: [f64; 3],
}

impl Decision {
    pub(crate) fn of(sums: &MapSums) -> Self {
        Self {
            contact: sums.contact,
            stick: sums.stick,
            slips: stick_ratio_below(sums, THRESHOLD),
            force_n: sums.force.map(|sum| f64::from(sum) / f64::from(LSB_PER_NEWTON)),
        }
    }

    pub(crate) fn ratio(&self) -> Option<f64> {
        (self.contact > 0).then(|| f64::from(self.stick) / f64::from(self.contact))
    }
}
