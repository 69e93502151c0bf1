//! Division and square root whose time does not depend on the numbers. The chip divides 32 bits by 32 in at most 12 cycles;
//! the compiler's own 64-bit division takes as many rounds as its numbers need.

use gripline_protocol::PER_UNIT;

/// The whole of which [`part`] and [`change`] count shares.
pub(crate) const WHOLE: i32 = 1_024;

/// `number / divisor`, exact; 0 for a divisor of 0. Four divisions of 32 bits. Not inlined, to save SRAM.
#[must_use]
#[inline(never)]
pub(crate) const fn divide(number: u64, divisor: u16) -> u64 {
    let divisor = divisor as u32;
    if divisor == 0 {
        return 0;
    }
    let (mut quotient, mut rest, mut place) = (0, 0, 0);
    while place < 4 {
        // The rest is less than the divisor, so it fits 16 bits.
        let part = rest << 16 | (number >> (48 - 16 * place)) as u32 & 0xFFFF;
        quotient = quotient << 16 | (part / divisor) as u64;
        rest = part % divisor;
        place += 1;
    }
    quotient
}

/// `number / divisor` of a number below 2⁴⁸, in half the time; 0 when the divisor is 0.
#[must_use]
#[inline]
pub(crate) const fn divide_48(number: u64, divisor: u16) -> u64 {
    debug_assert!(number < 1 << 48);
    let divisor = divisor as u32;
    if divisor == 0 {
        return 0;
    }
    let upper = (number >> 16) as u32;
    // The rest is less than the divisor, so it fits 16 bits.
    let lower = ((upper % divisor) << 16) | (number as u32 & 0xFFFF);
    (((upper / divisor) as u64) << 16) + (lower / divisor) as u64
}

/// `share`/[`WHOLE`] of a force.
pub(crate) const fn part(force: i32, share: i32) -> i32 {
    // At most 2²⁶ / 16 · 1024 / 64.
    force / 64 * share / 16
}

/// By how much `now` lies above `before`, share of `before` in 1/[`WHOLE`], at most two wholes. To 20 bits, so that 32 bits do.
pub(crate) fn change(now: i32, before: i32) -> i32 {
    let (now, before) = (now.max(0), before.max(1));
    let shift = 12_u32.saturating_sub((now | before).leading_zeros());
    let (now, before) = (now >> shift, (before >> shift).max(1));
    ((now - before) * WHOLE / before).min(2 * WHOLE)
}

/// A normal force as a 16-bit divisor, at least 1, and the right shift that made it so. Quotients are exact to 2⁻¹⁵.
pub(crate) fn narrowed(normal: i32) -> (u16, u32) {
    let normal = normal.max(1).cast_unsigned();
    let shift = 16_u32.saturating_sub(normal.leading_zeros());
    // Never 0, but the compiler does not see that.
    (((normal >> shift) as u16).max(1), shift)
}

/// floor(√square) for squares below 2⁵²: the upper half of the root by Newton's steps from a straight line, the lower by one
/// division (Zimmermann, "Karatsuba square root"). Three divisions of 32 bits, none of 64 bits, no loop. Not inlined, to save SRAM.
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
    // At least 2¹³, but the compiler does not see that.
    let divisor = (root << 1).max(1);
    let quotient = numerator / divisor;
    let left = numerator - quotient * divisor;
    let root = (root << HALF) + quotient;
    let rest = i64::from(left) << HALF | i64::from(scaled as u32 & MASK);
    let missing = rest < i64::from(quotient) * i64::from(quotient);
    (root - u32::from(missing)) >> (shift / 2)
}

/// Shear over normal force, 1/10000, at most 65535.
pub(crate) fn ratio(shear: i32, normal: i32) -> u16 {
    let (normal, shift) = narrowed(normal);
    let share = divide(
        (u64::from(shear.max(0).cast_unsigned()) * u64::from(PER_UNIT)) >> shift,
        normal,
    );
    share.min(u16::MAX.into()) as u16
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

        #[test]
        fn it_is_the_division_of_the_language(number in any::<u64>(), divisor in 1_u16.., shift in 0_u32..64) {
            prop_assert_eq!(divide(number >> shift, divisor), (number >> shift) / u64::from(divisor));
            prop_assert_eq!(divide(u64::from(divisor), divisor), 1);
            let short = number >> 16 >> shift;
            prop_assert_eq!(divide_48(short, divisor), short / u64::from(divisor));
        }
    }

    #[test]
    fn by_zero_it_is_zero() {
        assert_eq!(divide(7, 0), 0);
        assert_eq!(divide_48(7, 0), 0);
    }

    #[test]
    fn the_square_roots_of_small_and_of_the_largest_squares_are_right() {
        for square in (0..100_000).chain((1 << 52) - 1_000..1 << 52) {
            assert_eq!(u64::from(square_root(square)), square.isqrt(), "{square}");
        }
    }

    #[test]
    fn newtons_steps_are_right_wherever_they_start() {
        // Every upper half that there is, except for the stride.
        for upper in (1_u64 << 24..1 << 26).step_by(3) {
            let square = upper << 26;
            assert_eq!(u64::from(square_root(square)), square.isqrt(), "{square}");
        }
    }
}
