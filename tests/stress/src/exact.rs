//! The judge: the detector's definitions in integers of any length, on the forces of the wire and on binary fractions.
//! Slow, plain, and written after the definitions, not after the code that it judges. Units: forces 1/4096 N, friction and
//! thresholds 1/10000, places in half taxel pitches from the centre.

use gripline_protocol::{PER_UNIT, SIDE, TAXELS, TaxelForce};
use num_bigint::BigInt;

/// What a map says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sums {
    /// Taxels in contact.
    pub contact: u16,
    /// Taxels in contact that stick.
    pub stick: u16,
    /// Σ fx, Σ fy, Σ fz.
    pub force: [BigInt; 3],
    /// Σ(x fy − y fx).
    pub moment: BigInt,
    /// Σ x fz, Σ y fz.
    pub first_moment: [BigInt; 2],
    /// Σ (x² + y²)/2 fz.
    pub second_moment: BigInt,
}

fn square(value: impl Into<BigInt>) -> BigInt {
    value.into().pow(2)
}

/// Whether a taxel is in contact, and whether it sticks: fz > least; fx² + fy² ≤ (m/10000)² fz².
#[must_use]
pub fn taxel(force: TaxelForce, friction: u16, contact_min: i16) -> (bool, bool) {
    let contact = force.z > contact_min;
    let shear = square(force.x) + square(force.y);
    (
        contact,
        contact && shear * square(PER_UNIT) <= square(friction) * square(force.z),
    )
}

/// Whether f_T is exactly μ f_z.
#[must_use]
pub fn is_on_cone(force: TaxelForce, friction: u16) -> bool {
    (square(force.x) + square(force.y)) * square(PER_UNIT) == square(friction) * square(force.z)
}

/// A whole map.
#[must_use]
pub fn map(taxels: &[TaxelForce; TAXELS], friction: u16, contact_min: i16) -> Sums {
    let mut sums = Sums {
        contact: 0,
        stick: 0,
        force: [0, 0, 0].map(BigInt::from),
        moment: BigInt::from(0),
        first_moment: [0, 0].map(BigInt::from),
        second_moment: BigInt::from(0),
    };
    for (number, force) in taxels.iter().enumerate() {
        let (contact, stick) = taxel(*force, friction, contact_min);
        sums.contact += u16::from(contact);
        sums.stick += u16::from(stick);
        let [px, py] = place(number).map(BigInt::from);
        let [x, y, z] = [force.x, force.y, force.z].map(BigInt::from);
        sums.moment += &px * &y - &py * &x;
        sums.first_moment[0] += &px * &z;
        sums.first_moment[1] += &py * &z;
        sums.second_moment += (square(px) + square(py)) / 2 * &z;
        for (sum, part) in sums.force.iter_mut().zip([x, y, z]) {
            *sum += part;
        }
    }
    sums
}

/// Where a taxel is, half pitches from the centre.
#[must_use]
pub const fn place(taxel: usize) -> [i32; 2] {
    let last = SIDE as i32 - 1;
    [2 * (taxel % SIDE) as i32 - last, 2 * (taxel / SIDE) as i32 - last]
}

/// stick / contact < threshold; never without contact.
#[must_use]
pub fn slips(stick: u16, contact: u16, threshold: u16) -> bool {
    BigInt::from(stick) * PER_UNIT < BigInt::from(threshold) * contact
}

/// F_T > μ F_N of whole forces.
#[must_use]
pub fn coulomb(force: &[BigInt; 3], friction: u16) -> bool {
    let [x, y, z] = force;
    let right = z * friction;
    right < BigInt::from(0) || (square(x.clone()) + square(y.clone())) * square(PER_UNIT) > square(right)
}

/// A finite number as mantissa and power of two, exactly.
fn parts(value: f64) -> (i64, i32) {
    let bits = value.to_bits();
    let exponent = (bits >> 52 & 0x7FF) as i32;
    let fraction = (bits & ((1 << 52) - 1)) as i64;
    let magnitude = if exponent == 0 {
        fraction
    } else {
        fraction | 1 << 52
    };
    let sign = if bits >> 63 == 0 { 1 } else { -1 };
    (sign * magnitude, exponent.max(1) - 1075)
}

/// Finite numbers as integers over one common power of two.
fn aligned(values: [f64; 3]) -> [BigInt; 3] {
    let parts = values.map(parts);
    let min = parts.iter().map(|(_, power)| *power).min().unwrap_or(0);
    parts.map(|(mantissa, power)| BigInt::from(mantissa) << (power - min) as usize)
}

/// Whether a force of any binary fractions sticks; for fz > 0.
#[must_use]
pub fn sticks(newtons: [f64; 3], friction: u16) -> bool {
    let [x, y, z] = aligned(newtons);
    (square(x) + square(y)) * square(PER_UNIT) <= square(friction) * square(z)
}

/// Newtons to the nearest step of 1/4096 N, ties away from zero: (step within i16, whether it had to be clipped).
#[must_use]
pub fn quantised(newton: f64) -> (i16, bool) {
    let (mantissa, power) = parts(newton);
    // |mantissa| · 2^(power + 12) + 1/2, rounded down, with the sign put back.
    let magnitude = BigInt::from(mantissa.unsigned_abs());
    let shift = power + 13;
    let doubled = if shift >= 0 {
        magnitude << shift as usize
    } else {
        magnitude >> (-shift) as usize
    };
    // What the shift cut off lies below half a step and cannot carry it over.
    let nearest: BigInt = (doubled + 1) >> 1_usize;
    let signed = if mantissa < 0 { -nearest } else { nearest };
    let found = i16::try_from(signed.clone()).unwrap_or(if mantissa < 0 { i16::MIN } else { i16::MAX });
    (found, BigInt::from(found) != signed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_taxel_on_the_cone_sticks_and_the_least_step_further_slips() {
        let at = |x, z| TaxelForce { x, y: 0, z };
        assert_eq!(taxel(at(9, 20), 4_500, 0), (true, true));
        assert_eq!(taxel(at(10, 20), 4_500, 0), (true, false));
        assert_eq!(taxel(at(0, 20), 4_500, 20), (false, false));
        // 0.45 is no binary fraction: 9/20 of the next number above 1 is not reached.
        assert!(sticks([0.449_999_999_999_999_95, 0.0, 1.0], 4_500));
        assert!(
            !sticks([0.45, 0.0, 1.0], 4_500),
            "the double 0.45 lies above 9/20"
        );
    }

    #[test]
    fn numbers_are_rounded_to_the_nearest_step_with_ties_away_from_zero() {
        let step = 1.0 / 4096.0;
        let below_half = 0.5_f64.next_down();
        for (steps, expected) in [
            (0.5, (1, false)),
            (below_half, (0, false)),
            (-0.5, (-1, false)),
            (-below_half, (0, false)),
            (1.5, (2, false)),
            (32_767.499, (32_767, false)),
            (32_767.5, (32_767, true)),
            (-32_768.5, (-32_768, true)),
            (-32_768.499, (-32_768, false)),
            (1e300, (32_767, true)),
            (5e-324, (0, false)),
        ] {
            assert_eq!(quantised(steps * step), expected, "{steps}");
        }
    }
}
