//! The per-taxel question "does it stick?", exact: fx² + fy² ≤ μ² fz² without a root, a division or a float.
//!
//! μ = m/10000 with m in 0..=20000, so the question is 10⁸ (fx² + fy²) ≤ m² fz²: integers on both sides, the left below
//! 2⁵⁸, the right below 2⁵⁹, one 32×32→64 product each (UMULL and UMLAL on the Cortex-M4). Nothing is rounded anywhere.

use gripline_protocol::PER_UNIT;

/// The square of [`PER_UNIT`].
pub const UNIT_SQUARE: u32 = PER_UNIT * PER_UNIT;

/// A friction coefficient, 0 to 2 in steps of 1/10000.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Friction {
    per_unit: u16,
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
        Self { per_unit }
    }

    /// The coefficient in 1/10000.
    #[must_use]
    pub const fn per_unit(self) -> u16 {
        self.per_unit
    }

    /// m², below 2²⁹: for kernels in machine instructions.
    #[must_use]
    pub const fn square(self) -> u32 {
        self.per_unit as u32 * self.per_unit as u32
    }

    /// Whether fx² + fy² ≤ μ² fz², exactly; for fz ≥ 0.
    #[inline]
    #[must_use]
    pub const fn holds(self, shear_square: u32, normal: i16) -> bool {
        let normal_square = (normal as i32 * normal as i32) as u32;
        shear_square as u64 * UNIT_SQUARE as u64 <= normal_square as u64 * self.square() as u64
    }

    /// Whether F_T > μ F_N: the Coulomb baseline on total forces (both in the same unit).
    #[must_use]
    pub fn exceeded_by(self, shear: [i32; 2], normal: i32) -> bool {
        let shear_square = square(shear[0]) + square(shear[1]);
        if normal < 0 {
            // Literally: F_T > μ F_N with a negative right side, or with 0 when μ is 0.
            return self.per_unit > 0 || shear_square > 0;
        }
        // One 64×64→128 product a side.
        let bound = u128::from(self.square()) * u128::from(square(normal));
        u128::from(shear_square) * u128::from(UNIT_SQUARE) > bound
    }
}

/// value², exact.
fn square(value: i32) -> u64 {
    let magnitude = u64::from(value.unsigned_abs());
    magnitude * magnitude
}
