//! Normal contact of a rigid sphere on an elastic half-space (Hertz; Johnson, Contact Mechanics, ch. 3 and
//! 4). Units: mm, N, MPa.

use std::f64::consts::PI;

use crate::error::{SimulationError, not_negative, positive};
use crate::gel::Gel;

/// A sphere pressed with a given force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hertz {
    normal_n: f64,
    sphere_radius_mm: f64,
    modulus_mpa: f64,
    radius_mm: f64,
}

impl Hertz {
    /// Contact of a sphere of `sphere_radius_mm` pressed with `normal_n`; a³ = 3PR / 4E*.
    ///
    /// # Errors
    /// A force below 0, a radius not above 0, a gel constant outside its range, or a number that is not
    /// finite.
    pub fn new(normal_n: f64, sphere_radius_mm: f64, gel: &Gel) -> Result<Self, SimulationError> {
        gel.check()?;
        not_negative("normal_n", normal_n)?;
        positive("sphere radius_mm", sphere_radius_mm)?;
        Ok(Self::of(normal_n, sphere_radius_mm, gel.contact_modulus_mpa()))
    }

    pub(crate) fn of(normal_n: f64, sphere_radius_mm: f64, modulus_mpa: f64) -> Self {
        let radius_mm = libm::cbrt(0.75 * normal_n * sphere_radius_mm / modulus_mpa);
        Self {
            normal_n,
            sphere_radius_mm,
            modulus_mpa,
            radius_mm,
        }
    }

    /// Normal force P, N.
    #[must_use]
    pub fn normal_n(&self) -> f64 {
        self.normal_n
    }

    /// Contact radius a, mm.
    #[must_use]
    pub fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// Peak pressure p0 = 2E*a / πR, MPa.
    #[must_use]
    pub fn peak_pressure_mpa(&self) -> f64 {
        2.0 * self.modulus_mpa * self.radius_mm / (PI * self.sphere_radius_mm)
    }

    /// Approach of the sphere δ = a²/R, mm.
    #[must_use]
    pub fn approach_mm(&self) -> f64 {
        self.radius_mm * self.radius_mm / self.sphere_radius_mm
    }

    /// Pressure p = p0 √(1 − r²/a²) at distance `r_mm` from the centre, MPa.
    #[must_use]
    pub fn pressure_mpa(&self, r_mm: f64) -> f64 {
        if r_mm >= self.radius_mm {
            return 0.0;
        }
        let t = r_mm / self.radius_mm;
        self.peak_pressure_mpa() * (1.0 - t * t).sqrt()
    }

    /// Normal displacement of the surface (into the gel) at `r_mm`, mm (Johnson 3.41, 3.42).
    #[must_use]
    pub fn normal_displacement_mm(&self, r_mm: f64) -> f64 {
        let a = self.radius_mm;
        if a <= 0.0 {
            return 0.0;
        }
        let scale = self.peak_pressure_mpa() / (self.modulus_mpa * 2.0 * a);
        let fall = 2.0 * a * a - r_mm * r_mm;
        if r_mm <= a {
            scale * 0.5 * PI * fall
        } else {
            scale * (fall * libm::asin(a / r_mm) + a * (r_mm * r_mm - a * a).sqrt())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed_form::simpson;

    #[test]
    fn the_pressure_carries_the_load_and_pushes_the_surface_onto_the_sphere() {
        for (force, radius) in [(0.1, 4.0), (2.5, 12.0), (15.0, 25.0)] {
            let hertz = Hertz::new(force, radius, &Gel::default()).unwrap();
            let a = hertz.radius_mm();
            // r = a sin x takes the square root's edge out of the quadrature.
            let total = simpson(0.0, 0.5 * PI, 200, |x| {
                let r = a * x.sin();
                2.0 * PI * r * hertz.pressure_mpa(r) * a * x.cos()
            });
            assert!((total / force - 1.0).abs() < 1e-9, "{total} N of {force} N");
            // Displacement at the centre by superposing point loads: u = ∫ p/(πE* r) dA.
            let centre = simpson(0.0, 0.5 * PI, 200, |x| {
                2.0 * hertz.pressure_mpa(a * x.sin()) * a * x.cos() / hertz.modulus_mpa
            });
            assert!((centre / hertz.approach_mm() - 1.0).abs() < 1e-9);
            // Inside, the surface takes the sphere's shape.
            for r in [0.0, 0.3 * a, 0.99 * a] {
                let gap = r * r / (2.0 * radius) - hertz.approach_mm() + hertz.normal_displacement_mm(r);
                assert!(gap.abs() < 1e-12);
            }
            let inside = hertz.normal_displacement_mm(a * (1.0 - 1e-9));
            let outside = hertz.normal_displacement_mm(a * (1.0 + 1e-9));
            assert!((inside - outside).abs() < 1e-7);
        }
    }

    #[test]
    fn bad_parameters_are_named() {
        let gel = Gel::default();
        let error = Hertz::new(-1.0, 12.0, &gel).unwrap_err().to_string();
        assert_eq!(error, "normal_n is -1, expected a finite number, 0 or above");
        assert!(Hertz::new(1.0, 0.0, &gel).is_err());
        assert!(Hertz::new(f64::NAN, 12.0, &gel).is_err());
        let error = Hertz::new(1.0, 12.0, &Gel { poisson: 0.6, ..gel })
            .unwrap_err()
            .to_string();
        assert!(error.contains("poisson is 0.6"), "{error}");
    }
}
