//! The per-taxel question "does it stick?", exact: fx² + fy² ≤ μ² fz² without a root, a division or a float.
//!
//! μ is a multiple of 1/10000 in 0..=2. μ² is held as the next multiple of 2⁻⁶² at or above the true square, so the
//! bound floor(fz² μ²) needs two 32×32→64 products (UMAAL on the Cortex-M4). It is not only exact for the rational
//! that is held but equal to the bound of the decimal μ itself: fz² < 2³⁰, so rounding μ² up lifts fz² μ² by less
//! than 2⁻³², while a product of integers over 10⁸ that is not whole lies at least 10⁻⁸ below the next whole number.

use gripline_protocol::PER_UNIT;

/// A friction coefficient, 0 to 2 in steps of 1/10000.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Friction {
    per_unit: u16,
    /// ceil(μ² 2⁶²) − 1, at least 0: one less, because 2² 2⁶² does not fit.
    square_less_one: u64,
}

/// A friction coefficient beyond 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrictionOutOfRange {
    /// What was found, 1/10000; at most 20000 was expected.
    pub found: u16,
}

impl Friction {
    /// Greatest coefficient, 1/10000.
    pub const MAX_PER_UNIT: u16 = 20_000;

    /// μ in 1/10000.
    ///
    /// # Errors
    /// [`FrictionOutOfRange`] above 2.
    pub const fn from_per_unit(per_unit: u16) -> Result<Self, FrictionOutOfRange> {
        if per_unit > Self::MAX_PER_UNIT {
            return Err(FrictionOutOfRange { found: per_unit });
        }
        Ok(Self::clamped(per_unit))
    }

    /// μ in 1/10000; above 2 it is 2.
    #[must_use]
    pub const fn clamped(per_unit: u16) -> Self {
        let per_unit = if per_unit > Self::MAX_PER_UNIT {
            Self::MAX_PER_UNIT
        } else {
            per_unit
        };
        // m² 2⁶² / 10⁸ in two steps of 31 bits, each of which fits u64; m = 20000 wraps to 0 and then to 2⁶⁴ − 1.
        let denominator = PER_UNIT as u64 * PER_UNIT as u64;
        let square = per_unit as u64 * per_unit as u64;
        let (high, rest) = ((square << 31) / denominator, (square << 31) % denominator);
        let (low, rest) = ((rest << 31) / denominator, (rest << 31) % denominator);
        let floor = (high << 31).wrapping_add(low);
        let square_less_one = if per_unit == 0 {
            0
        } else if rest == 0 {
            floor.wrapping_sub(1)
        } else {
            floor
        };
        Self {
            per_unit,
            square_less_one,
        }
    }

    /// The coefficient in 1/10000.
    #[must_use]
    pub const fn per_unit(self) -> u16 {
        self.per_unit
    }

    /// floor(μ² fz²) for fz ≥ 0: the largest fx² + fy² that sticks. Meaningless for negative fz.
    ///
    /// The 2 makes up for the one that the held square lacks and for what the low product drops, and lifts the result by
    /// less than 2⁻³⁰ of a whole number.
    #[inline]
    #[must_use]
    pub const fn shear_square_bound(self, normal: i16) -> u32 {
        let normal = normal as i32;
        let [low, high] = self.halves();
        // 4 fz² < 2³²; the four makes the wanted word the highest of a 96-bit product.
        let four_squares = ((normal * normal).cast_unsigned() << 2) as u64;
        ((four_squares * high as u64 + ((four_squares * low as u64) >> 32) + 2) >> 32) as u32
    }

    /// μ² as it is held, in two words, the lower one first: for a kernel that does the same in instructions of its own.
    #[must_use]
    pub const fn halves(self) -> [u32; 2] {
        [self.square_less_one as u32, (self.square_less_one >> 32) as u32]
    }

    /// Whether F_T > μ F_N: the Coulomb baseline on whole forces (any unit, both the same).
    #[must_use]
    pub fn exceeded_by(self, shear: [i32; 2], normal: i32) -> bool {
        let shear_square = square(shear[0]) + square(shear[1]);
        if normal < 0 {
            // Literally: F_T > μ F_N with a negative right side, or with 0 when μ is 0.
            return self.per_unit > 0 || shear_square > 0;
        }
        // One 64×64→128 product a side.
        let one = u64::from(PER_UNIT) * u64::from(PER_UNIT);
        let bound = u128::from(square(i32::from(self.per_unit))) * u128::from(square(normal));
        u128::from(shear_square) * u128::from(one) > bound
    }
}

/// value², exact.
fn square(value: i32) -> u64 {
    let magnitude = u64::from(value.unsigned_abs());
    magnitude * magnitude
}
