//! A pressed sphere twisted about its normal: partial slip outside a stick circle (Lubkin 1951), written as
//! Jäger's (1995) superposition of twisted flat punches, q(r) = ∫ g(x) r/√(x²−r²) dx with g = (2μp0/π)
//! E(k')/x and k' = √(1−x²/a²) on c ≤ x ≤ a. Units: mm, N, MPa, N·mm, rad. Limits: half-space, constant P,
//! no pull.

use std::f64::consts::PI;

use super::elliptic::{e_complement, k_minus_e_complement};
use super::{Hertz, simpson};
use crate::error::{SimulationError, checked, positive};
use crate::gel::Gel;

/// Simpson pairs of the one-dimensional integrals here: 1e-7 relative or better.
const PAIRS: usize = 400;

/// A Hertz contact with friction under a moment about its normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Torsion {
    hertz: Hertz,
    friction: f64,
    shear_modulus_mpa: f64,
}

impl Torsion {
    /// The contact `hertz` with Coulomb `friction` on `gel`.
    ///
    /// # Errors
    /// A friction that is not above 0, or a gel constant outside its range.
    pub fn new(hertz: Hertz, friction: f64, gel: &Gel) -> Result<Self, SimulationError> {
        gel.check()?;
        positive("friction", friction)?;
        Ok(Self {
            hertz,
            friction,
            shear_modulus_mpa: gel.shear_modulus_mpa(),
        })
    }

    /// Moment at which the whole contact spins, (3π/16) μPa, N·mm.
    #[must_use]
    pub fn limit_nmm(&self) -> f64 {
        3.0 * PI / 16.0 * self.friction * self.hertz.normal_n() * self.hertz.radius_mm()
    }

    /// Moment under which the circle of radius `stick_radius_mm` still sticks, N·mm:
    /// (8/3) μ p0 a³ ∫ t² E(√(1−t²)) dt from c/a to 1.
    #[must_use]
    pub fn moment_nmm(&self, stick_radius_mm: f64) -> f64 {
        let a = self.hertz.radius_mm();
        let from = (stick_radius_mm / a).clamp(0.0, 1.0);
        let bound = self.friction * self.hertz.peak_pressure_mpa();
        8.0 / 3.0 * bound * a * a * a * simpson(from, 1.0, PAIRS, |t| t * t * e_complement(t))
    }

    /// Stick radius under the first rotation to `moment_nmm`, mm.
    ///
    /// # Errors
    /// A moment outside 0 to the limit.
    pub fn stick_radius_mm(&self, moment_nmm: f64) -> Result<f64, SimulationError> {
        checked(
            "moment_nmm",
            moment_nmm,
            "between 0 and the limit 3π/16 μPa",
            |m| (0.0..=self.limit_nmm() * (1.0 + 1e-12)).contains(&m),
        )?;
        let (mut inner, mut outer) = (0.0, self.hertz.radius_mm());
        for _ in 0..60 {
            let middle = 0.5 * (inner + outer);
            if self.moment_nmm(middle) > moment_nmm {
                inner = middle;
            } else {
                outer = middle;
            }
        }
        Ok(0.5 * (inner + outer))
    }

    /// Rotation of the sphere while the circle of radius `stick_radius_mm` sticks, φ = (μp0 / 2G) (K(k') −
    /// E(k')) with k' = √(1−c²/a²), rad (Lubkin's relation). It grows without bound as the circle vanishes.
    #[must_use]
    pub fn rotation_rad(&self, stick_radius_mm: f64) -> f64 {
        let bound = self.friction * self.hertz.peak_pressure_mpa();
        bound / (2.0 * self.shear_modulus_mpa)
            * k_minus_e_complement((stick_radius_mm / self.hertz.radius_mm()).max(1e-12))
    }

    /// Circumferential traction at `r_mm` while the circle of radius `stick_radius_mm` sticks, MPa; μp
    /// outside it.
    #[must_use]
    pub fn traction_mpa(&self, stick_radius_mm: f64, r_mm: f64) -> f64 {
        let a = self.hertz.radius_mm();
        if r_mm >= stick_radius_mm {
            return self.friction * self.hertz.pressure_mpa(r_mm);
        }
        let bound = self.friction * self.hertz.peak_pressure_mpa();
        // w = √(x² − r²) takes the root out of the integrand: dx/√(x²−r²) = dw/x.
        let from = (stick_radius_mm * stick_radius_mm - r_mm * r_mm).sqrt();
        let to = (a * a - r_mm * r_mm).sqrt();
        2.0 / PI
            * bound
            * r_mm
            * simpson(from, to, PAIRS, |w| {
                let x_squared = w * w + r_mm * r_mm;
                e_complement(x_squared.sqrt() / a) / x_squared
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contact() -> Torsion {
        let gel = Gel::default();
        Torsion::new(Hertz::new(3.0, 12.0, &gel).unwrap(), 0.65, &gel).unwrap()
    }

    #[test]
    fn the_tractions_carry_the_moment_and_stay_inside_the_friction_bound() {
        let torsion = contact();
        let a = torsion.hertz.radius_mm();
        for stick in [0.15, 0.5, 0.8, 0.95] {
            let c = stick * a;
            // Rings with r = a sin x on either side of the kink at c.
            let ring = |x: f64| {
                let r = a * x.sin();
                let q = torsion.traction_mpa(c, r);
                assert!(q <= torsion.friction * torsion.hertz.pressure_mpa(r) * (1.0 + 1e-6));
                2.0 * PI * r * r * q * a * x.cos()
            };
            let edge = stick.asin();
            let moment = simpson(0.0, edge, 400, ring) + simpson(edge, 0.5 * PI, 400, ring);
            assert!(
                (moment / torsion.moment_nmm(c) - 1.0).abs() < 2e-3,
                "{stick}: {moment}"
            );
        }
    }

    #[test]
    fn the_limits_are_full_spin_and_reissner_sagocis_stiffness() {
        let torsion = contact();
        let a = torsion.hertz.radius_mm();
        assert!((torsion.moment_nmm(0.0) / torsion.limit_nmm() - 1.0).abs() < 1e-6);
        // (16/3) G a³ φ, the twist of a bonded disc, as slip begins.
        let c = a * (1.0 - 1e-4);
        let stiffness = 16.0 / 3.0 * torsion.shear_modulus_mpa * a * a * a;
        assert!((torsion.moment_nmm(c) / (stiffness * torsion.rotation_rad(c)) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn the_stick_radius_falls_as_the_moment_grows() {
        let torsion = contact();
        let mut last = torsion.hertz.radius_mm() * 1.000_001;
        for i in 0..=20 {
            let moment = torsion.limit_nmm() * f64::from(i) / 20.0;
            let c = torsion.stick_radius_mm(moment).unwrap();
            assert!(c < last, "{c} after {last}");
            assert!((torsion.moment_nmm(c) - moment).abs() < 1e-6 * torsion.limit_nmm());
            last = c;
        }
        assert!(torsion.stick_radius_mm(1.01 * torsion.limit_nmm()).is_err());
        assert!(torsion.stick_radius_mm(f64::NAN).is_err());
    }

    /// Bessel function of the first kind of order 1 by its integral (the integrand is periodic: fast
    /// convergence).
    fn j1(x: f64) -> f64 {
        let n = 24 + x as usize;
        (0..n)
            .map(|i| PI * (i as f64 + 0.5) / n as f64)
            .map(|t| (t - x * t.sin()).cos())
            .sum::<f64>()
            / n as f64
    }

    #[test]
    fn the_stick_circle_turns_as_a_rigid_disc_by_the_stated_angle() {
        // u(r) = (1/G) ∫ J1(kr) q̂(k) dk with q̂ the Hankel transform of the traction: no closed form in it.
        let torsion = contact();
        let a = torsion.hertz.radius_mm();
        let c = 0.6 * a;
        let edge = 0.6_f64.asin();
        let transform = |k: f64| {
            let ring = |x: f64| {
                let r = a * x.sin();
                torsion.traction_mpa(c, r) * j1(k * r) * r * a * x.cos()
            };
            simpson(0.0, edge, 60, ring) + simpson(edge, 0.5 * PI, 60, ring)
        };
        let steps = 600;
        let k_max = 120.0 / a;
        let spectrum: Vec<(f64, f64)> = (0..steps)
            .map(|i| (f64::from(i) + 0.5) / f64::from(steps) * k_max)
            .map(|k| (k, transform(k)))
            .collect();
        for r in [0.1 * a, 0.3 * a, 0.5 * a] {
            let displacement: f64 = spectrum.iter().map(|&(k, q)| j1(k * r) * q).sum::<f64>() * k_max
                / f64::from(steps)
                / torsion.shear_modulus_mpa;
            let angle = displacement / r;
            assert!(
                (angle / torsion.rotation_rad(c) - 1.0).abs() < 0.01,
                "{angle} rad at {r} mm"
            );
        }
    }
}
