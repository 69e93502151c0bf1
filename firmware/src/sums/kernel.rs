//! The work per taxel: the trait, and the kernel of every host.

use gripline_protocol::constants::TAXEL_BYTES;
use gripline_protocol::{Place, TaxelForce};

use super::accumulator::Accumulator;
use crate::friction::UNIT_SQUARE;

/// Adds taxels to sums: the work per taxel. A board may have a faster kernel with the same sums.
pub trait Kernel {
    /// Adds one taxel for each item of `bytes` (x, y, z, little-endian). `places` has at least as many items.
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
            sums.first_moment[0] += column * z;
            sums.first_moment[1] += row * z;
            sums.second_moment = sums.second_moment.wrapping_add((column * column + row * row) * z);
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
