//! The sums of a whole map at once, for hosts.

use gripline_protocol::message::MapSums;
use gripline_protocol::{ForceMap, SIDE};

use super::accumulator::{Accumulator, TaxelRule};
use crate::friction::UNIT_SQUARE;

/// Rows that [`sums_of`] adds together: their taxels fill vectors of every width.
const ROWS: usize = 4;
const TOGETHER: usize = ROWS * SIDE;

/// The sums of a whole map, for hosts. It skips rows without force.
#[expect(
    clippy::inline_always,
    reason = "a caller compiled for wide vectors compiles this for them too"
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
            // No contact: `contact_min` is at least 0.
            sums.idle += TOGETHER as u32;
            continue;
        }
        // In local words, which vectors can hold.
        let (mut x_sum, mut y_sum, mut z_sum, mut moment) = (0, 0, 0, 0);
        let (mut across, mut down, mut second_moment) = (0, 0, 0);
        let (mut contact, mut slipping) = (0, 0);
        for (&[column, row], force) in PLACES.iter().zip(forces) {
            let (x, y, z) = (i32::from(force.x), i32::from(force.y), i32::from(force.z));
            x_sum += x;
            y_sum += y;
            z_sum += z;
            moment += column * y - row * x;
            across += column * z;
            down += row * z;
            second_moment += (column * column + row * row) * z;
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
        sums.first_moment[0] += across;
        sums.first_moment[1] += down + first_row * z_sum;
        // (row + first)² = row² + 2 first row + first².
        second_moment += first_row * (2 * down + first_row * z_sum);
        sums.second_moment = sums.second_moment.wrapping_add(second_moment);
        sums.slips += slipping;
        sums.idle += TOGETHER as u32 - contact;
    }
    sums.finish()
}

/// Columns and rows of those taxels, from the first.
const PLACES: [[i32; 2]; TOGETHER] = {
    let mut places = [[0; 2]; TOGETHER];
    let mut taxel = 0;
    while taxel < places.len() {
        places[taxel] = [(taxel % SIDE) as i32, (taxel / SIDE) as i32];
        taxel += 1;
    }
    places
};
