//! What one force map says: contact, stick, total force, moment, centre of pressure; all at once or packet by packet.
//!
//! Units: forces 1/4096 N; places in half taxel pitches, odd numbers from −19 to 19 from the map's centre.
//! No branch on the forces, so the work depends on the number of taxels only. No sum can overflow: 400 taxels of 2¹⁵
//! at a distance of at most 19 give |Σ(x fy − y fx)| ≤ 400·38·2¹⁵ < 2³¹, and (x² + y²)/2 is 133 on average: 400·133·2¹⁵ < 2³¹.

use gripline_protocol::constants::TAXEL_BYTES;
use gripline_protocol::message::{Configuration, MapSums};
use gripline_protocol::{ForceMap, PER_UNIT, Place, SIDE, TaxelForce};

use crate::friction::{Friction, UNIT_SQUARE};

/// What decides about a taxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TaxelRule {
    /// The detector's friction coefficient.
    pub friction: Friction,
    /// A taxel is in contact when its normal force exceeds this, 1/4096 N; at least 0.
    pub contact_min: i16,
}

impl TaxelRule {
    /// The rule of settings that [`Configuration::check`] passed; friction beyond its range counts as 2.
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

/// Sums of a map under way. The places count in columns and rows from 0, which [`Accumulator::finish`] turns into half
/// pitches from the centre; with them no sum can overflow either (|Σ(column fy − row fx)| ≤ 400·38·2¹⁵).
///
/// The order of the fields is what a [`Kernel`] in machine instructions goes by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub struct Accumulator {
    /// Σ fx, Σ fy, Σ fz.
    pub force: [i32; 3],
    /// Σ(column fy − row fx).
    pub moment: i32,
    /// Σ column fz, Σ row fz.
    pub pressure: [i32; 2],
    /// Σ(column² + row²) fz; wraps, and [`Accumulator::finish`] makes of it what does not.
    pub spread: i32,
    /// Taxels that are not in contact.
    pub idle: u32,
    /// Taxels in contact that do not stick.
    pub slips: u32,
    /// μ² as [`Friction::square`] gives it.
    pub square: u32,
    /// −1 − `contact_min`: with fz it is negative without contact.
    pub below: i32,
    /// Taxels added.
    pub taxels: u32,
}

impl Accumulator {
    /// No taxel yet.
    #[must_use]
    pub const fn new(rule: TaxelRule) -> Self {
        Self {
            force: [0; 3],
            moment: 0,
            pressure: [0; 2],
            spread: 0,
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
            pressure: [2 * self.pressure[0] - LAST * z, 2 * self.pressure[1] - LAST * z],
            // ((2 column − 19)² + (2 row − 19)²)/2.
            spread: (self.spread)
                .wrapping_sub((self.pressure[0] + self.pressure[1]).wrapping_mul(LAST))
                .wrapping_mul(2)
                .wrapping_add(z.wrapping_mul(LAST * LAST)),
        }
    }
}

/// Adds taxels to sums: the work per taxel, of which a board may have a faster form that gives the same sums.
pub trait Kernel {
    /// Adds one taxel for each of `bytes` (x, y, z, little-endian); `places` are at least as many.
    fn add(sums: &mut Accumulator, places: &[Place], bytes: &[[u8; TAXEL_BYTES]]);
}

/// The kernel of every host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Portable;

impl Kernel for Portable {
    #[inline]
    fn add(sums: &mut Accumulator, places: &[Place], bytes: &[[u8; TAXEL_BYTES]]) {
        let square = u64::from(sums.square);
        for (place, &bytes) in places.iter().zip(bytes) {
            let force = TaxelForce::from_le_bytes(bytes);
            let (column, row) = (i32::from(place.column()), i32::from(place.row()));
            let (x, y, z) = (i32::from(force.x), i32::from(force.y), i32::from(force.z));
            sums.force[0] += x;
            sums.force[1] += y;
            sums.force[2] += z;
            sums.moment += column * y - row * x;
            sums.pressure[0] += column * z;
            sums.pressure[1] += row * z;
            sums.spread = sums.spread.wrapping_add((column * column + row * row) * z);
            // As `TaxelRule::decide`, word by word.
            let shear_square = (x * x).cast_unsigned() + (y * y).cast_unsigned();
            let normal_square = (z * z).cast_unsigned();
            let slips = u64::from(shear_square) * u64::from(UNIT_SQUARE) > u64::from(normal_square) * square;
            let is_idle = z + sums.below < 0;
            sums.idle += u32::from(is_idle);
            sums.slips += u32::from(!is_idle) & u32::from(slips);
            sums.taxels += 1;
        }
    }
}

/// Rows that [`sums_of`] looks at together, and their taxels: as many as fill the vectors of every width.
const ROWS: usize = 4;
const TOGETHER: usize = ROWS * SIDE;

/// The sums of a whole map, for hosts: rows without any force are passed over.
#[expect(
    clippy::inline_always,
    reason = "a caller that is compiled for wide vectors makes it so too"
)]
#[inline(always)]
#[must_use]
pub fn sums_of(map: &ForceMap, rule: TaxelRule) -> MapSums {
    let mut sums = Accumulator::new(rule);
    let square = u64::from(sums.square);
    for (first_row, forces) in (0..).step_by(ROWS).zip(map.taxels.as_chunks::<TOGETHER>().0) {
        sums.taxels += TOGETHER as u32;
        if forces
            .iter()
            .fold(0, |any, force| any | force.x | force.y | force.z)
            == 0
        {
            // No contact: the least normal force of one is at least 0.
            sums.idle += TOGETHER as u32;
            continue;
        }
        // In words of their own, which vectors can hold.
        let (mut x_sum, mut y_sum, mut z_sum, mut moment) = (0, 0, 0, 0);
        let (mut across, mut down, mut spread) = (0, 0, 0);
        let (mut contact, mut slipping) = (0, 0);
        for (&[column, row], force) in PLACES.iter().zip(forces) {
            let (x, y, z) = (i32::from(force.x), i32::from(force.y), i32::from(force.z));
            x_sum += x;
            y_sum += y;
            z_sum += z;
            moment += column * y - row * x;
            across += column * z;
            down += row * z;
            spread += (column * column + row * row) * z;
            // As `TaxelRule::decide`, word by word.
            let shear_square = (x * x).cast_unsigned() + (y * y).cast_unsigned();
            let normal_square = (z * z).cast_unsigned();
            let slips = u64::from(shear_square) * u64::from(UNIT_SQUARE) > u64::from(normal_square) * square;
            let is_contact = u32::from(z + sums.below >= 0);
            contact += is_contact;
            slipping += is_contact & u32::from(slips);
        }
        for (sum, of_rows) in sums.force.iter_mut().zip([x_sum, y_sum, z_sum]) {
            *sum += of_rows;
        }
        sums.moment += moment - first_row * x_sum;
        sums.pressure[0] += across;
        sums.pressure[1] += down + first_row * z_sum;
        // (row + first)² = row² + 2 first row + first².
        spread += first_row * (2 * down + first_row * z_sum);
        sums.spread = sums.spread.wrapping_add(spread);
        sums.slips += slipping;
        sums.idle += TOGETHER as u32 - contact;
    }
    sums.finish()
}

/// Columns and rows of the taxels that are looked at together, from the first of them.
const PLACES: [[i32; 2]; TOGETHER] = {
    let mut places = [[0; 2]; TOGETHER];
    let mut taxel = 0;
    while taxel < places.len() {
        places[taxel] = [(taxel % SIDE) as i32, (taxel / SIDE) as i32];
        taxel += 1;
    }
    places
};

/// Stick ratio in 1/10000, rounded down; `None` when nothing is in contact.
///
/// For people and trends. Thresholds are compared exactly by [`stick_ratio_below`].
#[must_use]
pub fn stick_ratio(sums: &MapSums) -> Option<u16> {
    (u32::from(sums.stick) * PER_UNIT)
        .checked_div(u32::from(sums.contact))
        .map(|ratio| ratio as u16)
}

/// Whether stick / contact < threshold (1/10000), exactly; false when nothing is in contact.
#[must_use]
pub const fn stick_ratio_below(sums: &MapSums, threshold: u16) -> bool {
    (sums.stick as u32) * PER_UNIT < threshold as u32 * sums.contact as u32
}

/// F_T of the whole map, 1/4096 N, rounded down.
#[must_use]
pub fn total_shear(sums: &MapSums) -> i32 {
    let [x, y, _] = sums.force;
    let square = u64::from(x.unsigned_abs()).pow(2) + u64::from(y.unsigned_abs()).pow(2);
    // At most √2 · 400 · 2¹⁵ < 2²⁵.
    square_root(square) as i32
}

/// floor(√square) for squares below 2⁵²: the upper half of the root by Newton's steps from a straight line, the lower by
/// one division (Zimmermann, "Karatsuba square root"). Three divisions of 32 bits, no loop, none of 64 bits. Not inlined:
/// there is little room in SRAM.
#[inline(never)]
pub(crate) fn square_root(square: u64) -> u32 {
    const HALF: u32 = 13;
    const MASK: u32 = (1 << HALF) - 1;
    if square == 0 {
        return 0;
    }
    // An even number of places, so that the highest quarter of 52 bits is not zero.
    let shift = (square.leading_zeros() - 12) & !1;
    let scaled = square << shift;
    let upper = (scaled >> (2 * HALF)) as u32 & ((1 << (2 * HALF)) - 1);
    // The line is off by 5 % at most, one step's result by 0.13 %, two steps' by less than 1; never too small.
    let line = (upper >> 14) + (upper >> 16) + 3_020;
    let near = (line + upper / line) >> 1;
    let above = (near + upper / near) >> 1;
    let root = above - u32::from(above * above > upper);
    let rest = upper - root * root;
    let low = (scaled as u32 >> HALF) & MASK;
    let numerator = rest << HALF | low;
    // At least 2¹³, which the compiler does not see by itself.
    let divisor = (root << 1).max(1);
    let quotient = numerator / divisor;
    let left = numerator - quotient * divisor;
    let root = (root << HALF) + quotient;
    let rest = i64::from(left) << HALF | i64::from(scaled as u32 & MASK);
    let missing = rest < i64::from(quotient) * i64::from(quotient);
    (root - u32::from(missing)) >> (shift / 2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_square_root_is_that_of_the_standard_library(square in 0_u64..1 << 52, root in 0_u64..1 << 26) {
            for square in [square, square >> 20, square >> 40, root * root, (root * root).saturating_sub(1)] {
                prop_assert_eq!(u64::from(square_root(square)), square.isqrt());
            }
        }
    }

    #[test]
    fn the_square_roots_of_small_and_of_the_largest_squares_are_right() {
        for square in (0..100_000).chain((1 << 52) - 1_000..1 << 52) {
            assert_eq!(u64::from(square_root(square)), square.isqrt(), "{square}");
        }
    }

    #[test]
    fn newtons_steps_are_right_wherever_they_start() {
        // Every upper half that there is, but for the stride.
        for upper in (1_u64 << 24..1 << 26).step_by(3) {
            let square = upper << 26;
            assert_eq!(u64::from(square_root(square)), square.isqrt(), "{square}");
        }
    }
}
