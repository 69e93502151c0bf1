//! The rule per taxel, and the sums of a map in progress.

use gripline_protocol::message::{Configuration, MapSums};
use gripline_protocol::{SIDE, TaxelForce};

use crate::friction::Friction;

/// The rule per taxel: contact, stick or slip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TaxelRule {
    /// The detector's friction coefficient.
    pub friction: Friction,
    /// A taxel is in contact when its normal force exceeds this, 1/4096 N; at least 0.
    pub contact_min: i16,
}

impl TaxelRule {
    /// The rule of settings that [`Configuration::check`] passed. Friction above 2 counts as 2.
    #[must_use]
    pub const fn of(settings: &Configuration) -> Self {
        Self {
            friction: Friction::clamped(settings.friction),
            contact_min: settings.contact_min,
        }
    }

    /// Whether a taxel is in contact, and whether it sticks.
    #[inline]
    #[must_use]
    pub fn decide(self, force: TaxelForce) -> (bool, bool) {
        let (x, y) = (i32::from(force.x), i32::from(force.y));
        // Each square is at most 2³⁰, so the sum fits u32.
        let shear_square = (x * x).cast_unsigned() + (y * y).cast_unsigned();
        let contact = force.z > self.contact_min;
        (contact, contact & self.friction.holds(shear_square, force.z))
    }
}

/// Sums of a map in progress. Places are columns and rows from 0; [`Accumulator::finish`] converts to half pitches from the
/// centre. No sum can overflow: |Σ(column fy − row fx)| ≤ 400·38·2¹⁵.
///
/// A [`Kernel`](super::Kernel) in machine instructions relies on the order of the fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub struct Accumulator {
    /// Σ fx, Σ fy, Σ fz.
    pub force: [i32; 3],
    /// Σ(column fy − row fx).
    pub moment: i32,
    /// First moment of pressure: Σ column fz, Σ row fz.
    pub first_moment: [i32; 2],
    /// Second moment of pressure: Σ(column² + row²) fz. It wraps; the result of [`Accumulator::finish`] does not.
    pub second_moment: i32,
    /// Taxels that are not in contact.
    pub idle: u32,
    /// Taxels in contact that do not stick.
    pub slips: u32,
    /// μ² as [`Friction::square`] gives it.
    pub square: u32,
    /// −1 − `contact_min`: plus fz it is negative without contact.
    pub below: i32,
    /// Taxels added.
    pub taxels: u32,
}

impl Accumulator {
    /// Sums before the first taxel.
    #[must_use]
    pub const fn new(rule: TaxelRule) -> Self {
        Self {
            force: [0; 3],
            moment: 0,
            first_moment: [0; 2],
            second_moment: 0,
            idle: 0,
            slips: 0,
            square: rule.friction.square(),
            below: -1 - rule.contact_min as i32,
            taxels: 0,
        }
    }

    /// The sums of all taxels added.
    #[must_use]
    pub const fn finish(&self) -> MapSums {
        // 2 column − 19 half pitches.
        const LAST: i32 = SIDE as i32 - 1;
        let [x, y, z] = self.force;
        let contact = self.taxels.wrapping_sub(self.idle);
        MapSums {
            contact: contact as u16,
            stick: contact.wrapping_sub(self.slips) as u16,
            force: self.force,
            moment: 2 * self.moment - LAST * y + LAST * x,
            first_moment: [
                2 * self.first_moment[0] - LAST * z,
                2 * self.first_moment[1] - LAST * z,
            ],
            // ((2 column − 19)² + (2 row − 19)²)/2.
            second_moment: (self.second_moment)
                .wrapping_sub((self.first_moment[0] + self.first_moment[1]).wrapping_mul(LAST))
                .wrapping_mul(2)
                .wrapping_add(z.wrapping_mul(LAST * LAST)),
        }
    }
}
