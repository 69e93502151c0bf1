//! Division whose time does not depend on the numbers: the chip divides 32 bits by 32 in at most 12 cycles, and the
//! compiler's own 64-bit division takes as many rounds as the numbers want.

/// `number / divisor`, exact; 0 for a divisor of 0. Four divisions of 32 bits. Not inlined: there is little room in SRAM.
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_is_the_division_of_the_language(number in any::<u64>(), divisor in 1_u16.., shift in 0_u32..64) {
            prop_assert_eq!(divide(number >> shift, divisor), (number >> shift) / u64::from(divisor));
            prop_assert_eq!(divide(u64::from(divisor), divisor), 1);
        }
    }

    #[test]
    fn by_zero_it_is_zero() {
        assert_eq!(divide(7, 0), 0);
    }
}
