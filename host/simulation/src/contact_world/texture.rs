//! Friction that changes from place to place of an indenter's surface: hills and hollows of one wavelength. Units: mm.

use std::f64::consts::TAU;

use crate::error::{SimulationError, checked, finite, positive};

/// Share of the friction at a place: `1 + depth·sin(2πx/λ + φ_x)·sin(2πy/λ + φ_y)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Texture {
    /// Largest difference from 1, 0 to below 1.
    pub depth: f64,
    /// Wavelength λ, mm.
    pub wavelength_mm: f64,
    /// Phases along x and y, rad.
    pub phase_rad: [f64; 2],
}

impl Texture {
    /// Share at a place of the indenter, mm from its origin.
    #[must_use]
    pub fn at(&self, [x, y]: [f64; 2]) -> f64 {
        let wave = |place: f64, phase: f64| libm::sin(TAU * place / self.wavelength_mm + phase);
        1.0 + self.depth * wave(x, self.phase_rad[0]) * wave(y, self.phase_rad[1])
    }

    pub(crate) fn check(&self) -> Result<(), SimulationError> {
        checked("texture depth", self.depth, "0 or above, below 1", |depth| {
            (0.0..1.0).contains(&depth)
        })?;
        positive("texture wavelength_mm", self.wavelength_mm)?;
        finite("texture phase_rad[0]", self.phase_rad[0])?;
        finite("texture phase_rad[1]", self.phase_rad[1])?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_texture_averages_to_one_over_a_wavelength_and_reaches_its_depth() {
        let texture = Texture {
            depth: 0.2,
            wavelength_mm: 4.0,
            phase_rad: [0.3, 1.0],
        };
        texture.check().unwrap();
        let steps = 64;
        let places =
            (0..steps * steps).map(|i| [i % steps, i / steps].map(|k| 4.0 * f64::from(k) / f64::from(steps)));
        let shares: Vec<f64> = places.map(|place| texture.at(place)).collect();
        let mean = shares.iter().sum::<f64>() / f64::from(steps * steps);
        let max = shares.iter().copied().fold(0.0, f64::max);
        assert!(
            (mean - 1.0).abs() < 1e-12 && (max - 1.2).abs() < 1e-3,
            "{mean} {max}"
        );
    }
}
