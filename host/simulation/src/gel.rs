//! The soft material under the contact: linear, isotropic, one modulus. Units: mm, MPa.

use crate::constants::{GEL_POISSON, GEL_THICKNESS_MM, GEL_YOUNG_MPA};
use crate::error::{SimulationError, checked, positive};

/// A soft layer bonded to a rigid base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gel {
    /// Thickness of the soft layer, mm. The fields inside use it; the contact closed forms are half-space.
    pub thickness_mm: f64,
    /// Young's modulus, MPa.
    pub young_mpa: f64,
    /// Poisson's ratio, in (0, 0.5].
    pub poisson: f64,
}

impl Default for Gel {
    fn default() -> Self {
        Self {
            thickness_mm: GEL_THICKNESS_MM,
            young_mpa: GEL_YOUNG_MPA,
            poisson: GEL_POISSON,
        }
    }
}

impl Gel {
    /// Shear modulus G = E / 2(1+ν), MPa.
    #[must_use]
    pub fn shear_modulus_mpa(&self) -> f64 {
        0.5 * self.young_mpa / (1.0 + self.poisson)
    }

    /// Plane-strain modulus E* = E / (1−ν²) against a rigid sphere, MPa.
    #[must_use]
    pub fn contact_modulus_mpa(&self) -> f64 {
        self.young_mpa / (1.0 - self.poisson * self.poisson)
    }

    /// Mindlin's tangential modulus G* = 4G / (2−ν) against a rigid sphere, MPa.
    #[must_use]
    pub fn tangential_modulus_mpa(&self) -> f64 {
        4.0 * self.shear_modulus_mpa() / (2.0 - self.poisson)
    }

    /// Whether all constants are in their ranges.
    ///
    /// # Errors
    /// [`SimulationError::OutOfRange`] with the first that is not.
    pub fn check(&self) -> Result<(), SimulationError> {
        positive("gel thickness_mm", self.thickness_mm)?;
        positive("gel young_mpa", self.young_mpa)?;
        checked("gel poisson", self.poisson, "above 0, at most 0.5", |v| {
            v > 0.0 && v <= 0.5
        })?;
        Ok(())
    }
}
