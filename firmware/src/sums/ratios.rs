//! Stick ratio and total shear of a map's sums.

use gripline_protocol::PER_UNIT;
use gripline_protocol::message::MapSums;

use crate::arithmetic::square_root;

/// Stick ratio in 1/10000, rounded down; `None` when nothing is in contact.
///
/// For people and trends. [`stick_ratio_below`] compares thresholds exactly.
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
