//! A sphere under constant normal force pulled tangentially: partial slip (Cattaneo 1938, Mindlin 1949),
//! unloading and reversal along the same line (Mindlin and Deresiewicz 1953; Johnson, ch. 7.2). Units: mm,
//! N, MPa. Limits: half-space, constant P, one direction of pull; slip is taken along the pull everywhere.

use super::Hertz;
use crate::error::{SimulationError, checked, positive};
use crate::gel::Gel;

/// A Hertz contact with friction under a tangential pull.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CattaneoMindlin {
    hertz: Hertz,
    friction: f64,
    tangential_modulus_mpa: f64,
}

impl CattaneoMindlin {
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
            tangential_modulus_mpa: gel.tangential_modulus_mpa(),
        })
    }

    /// Pull at which the whole contact slides, μP, N.
    #[must_use]
    pub fn limit_n(&self) -> f64 {
        self.friction * self.hertz.normal_n()
    }

    fn checked_pull(&self, name: &'static str, pull_n: f64) -> Result<f64, SimulationError> {
        checked(name, pull_n, "between 0 and the friction limit μP", |q| {
            (0.0..=self.limit_n() * (1.0 + 1e-12)).contains(&q)
        })
    }

    /// Share of the limit that is left, (1 − Q/μP), never below 0.
    fn reserve(&self, pull_n: f64) -> f64 {
        (1.0 - pull_n / self.limit_n()).max(0.0)
    }

    /// Stick radius under the first pull to `pull_n`, c = a (1 − Q/μP)^(1/3), mm.
    ///
    /// # Errors
    /// A pull outside 0 to μP.
    pub fn stick_radius_mm(&self, pull_n: f64) -> Result<f64, SimulationError> {
        self.checked_pull("pull_n", pull_n)?;
        Ok(self.hertz.radius_mm() * libm::cbrt(self.reserve(pull_n)))
    }

    /// Share of the contact area that sticks under the first pull, (1 − Q/μP)^(2/3).
    ///
    /// # Errors
    /// A pull outside 0 to μP.
    pub fn stick_ratio(&self, pull_n: f64) -> Result<f64, SimulationError> {
        let c = self.stick_radius_mm(pull_n)? / self.hertz.radius_mm();
        Ok(c * c)
    }

    /// Tangential traction at `r_mm` under the first pull, MPa: μp less μ times the Hertz pressure of the
    /// stick zone.
    ///
    /// # Errors
    /// A pull outside 0 to μP.
    pub fn traction_mpa(&self, pull_n: f64, r_mm: f64) -> Result<f64, SimulationError> {
        let c = self.stick_radius_mm(pull_n)?;
        let a = self.hertz.radius_mm();
        let slope = self.friction * self.hertz.peak_pressure_mpa() / a;
        let bell = |radius: f64| (radius * radius - r_mm * r_mm).max(0.0).sqrt();
        Ok(slope * (bell(a) - bell(c)))
    }

    /// Shift of the sphere under the first pull, (3μP / 4G*a) (1 − (1 − Q/μP)^(2/3)), mm, before any sliding.
    ///
    /// # Errors
    /// A pull outside 0 to μP.
    pub fn displacement_mm(&self, pull_n: f64) -> Result<f64, SimulationError> {
        let scale = 0.75 * self.limit_n() / (self.tangential_modulus_mpa * self.hertz.radius_mm());
        Ok(scale * (1.0 - self.stick_ratio(pull_n)?))
    }

    /// Tangential traction after a pull to `peak_n` taken back to `pull_n`, MPa: the first pull less twice
    /// that of half the way back.
    ///
    /// # Errors
    /// A peak outside 0 to μP, or a pull outside −peak to +peak.
    pub fn unloading_traction_mpa(
        &self,
        peak_n: f64,
        pull_n: f64,
        r_mm: f64,
    ) -> Result<f64, SimulationError> {
        let back = self.taken_back(peak_n, pull_n)?;
        Ok(self.traction_mpa(peak_n, r_mm)? - 2.0 * self.traction_mpa(back, r_mm)?)
    }

    /// Shift of the sphere after a pull to `peak_n` taken back to `pull_n`, mm.
    ///
    /// # Errors
    /// A peak outside 0 to μP, or a pull outside −peak to +peak.
    pub fn unloading_displacement_mm(&self, peak_n: f64, pull_n: f64) -> Result<f64, SimulationError> {
        let back = self.taken_back(peak_n, pull_n)?;
        Ok(self.displacement_mm(peak_n)? - 2.0 * self.displacement_mm(back)?)
    }

    /// Energy lost in one cycle between +`peak_n` and −`peak_n`, N·mm (Johnson 7.58):
    /// (18 μ²P² / 5G*a) (1 − s^(5/3) − (5Q*/6μP)(1 + s^(2/3))), s = 1 − Q*/μP.
    ///
    /// # Errors
    /// A peak outside 0 to μP.
    pub fn cycle_loss_nmm(&self, peak_n: f64) -> Result<f64, SimulationError> {
        self.checked_pull("peak_n", peak_n)?;
        let reserve = self.reserve(peak_n);
        let two_thirds = libm::cbrt(reserve * reserve);
        let scale =
            3.6 * self.limit_n() * self.limit_n() / (self.tangential_modulus_mpa * self.hertz.radius_mm());
        Ok(scale * (1.0 - reserve * two_thirds - 5.0 / 6.0 * (1.0 - reserve) * (1.0 + two_thirds)))
    }

    /// Half the way back from the peak, (Q* − Q)/2, N.
    fn taken_back(&self, peak_n: f64, pull_n: f64) -> Result<f64, SimulationError> {
        self.checked_pull("peak_n", peak_n)?;
        checked("pull_n", pull_n, "between -peak_n and +peak_n", |q| {
            q.abs() <= peak_n.abs() * (1.0 + 1e-12)
        })?;
        Ok((0.5 * (peak_n - pull_n)).clamp(0.0, peak_n))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contact() -> CattaneoMindlin {
        let gel = Gel::default();
        CattaneoMindlin::new(Hertz::new(3.0, 12.0, &gel).unwrap(), 0.65, &gel).unwrap()
    }

    /// Plain midpoint sum over the contact disc in Cartesian cells, which knows nothing of the closed forms.
    fn over_contact(a: f64, mut f: impl FnMut(f64, f64)) {
        let cells = 800;
        let side = 2.0 * a / f64::from(cells);
        for i in 0..cells {
            for j in 0..cells {
                let x = (f64::from(i) + 0.5) * side - a;
                let y = (f64::from(j) + 0.5) * side - a;
                let r = x.hypot(y);
                if r < a {
                    f(r, side * side);
                }
            }
        }
    }

    #[test]
    fn the_stick_ratio_is_the_counted_area_below_the_friction_bound_and_the_tractions_carry_the_pull() {
        let contact = contact();
        let a = contact.hertz.radius_mm();
        for share in [0.1, 0.3, 0.646, 0.9, 0.95] {
            let pull = share * contact.limit_n();
            let (mut stick, mut area, mut force) = (0.0, 0.0, 0.0);
            over_contact(a, |r, cell| {
                let traction = contact.traction_mpa(pull, r).unwrap();
                let bound = contact.friction * contact.hertz.pressure_mpa(r);
                assert!(traction <= bound * (1.0 + 1e-9));
                area += cell;
                force += traction * cell;
                if traction < bound * (1.0 - 1e-9) {
                    stick += cell;
                }
            });
            assert!((stick / area - (1.0 - share).powf(2.0 / 3.0)).abs() < 0.003);
            assert!((force / pull - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn unloading_and_reversal_stay_in_balance_and_inside_the_friction_bound() {
        let contact = contact();
        let a = contact.hertz.radius_mm();
        let peak = 0.8 * contact.limit_n();
        for pull in [0.6 * peak, 0.0, -0.5 * peak, -peak] {
            let mut force = 0.0;
            over_contact(a, |r, cell| {
                let traction = contact.unloading_traction_mpa(peak, pull, r).unwrap();
                assert!(traction.abs() <= contact.friction * contact.hertz.pressure_mpa(r) * (1.0 + 1e-9));
                force += traction * cell;
            });
            assert!(
                (force - pull).abs() < 1e-3 * contact.limit_n(),
                "{force} N of {pull} N"
            );
        }
        // After full reversal nothing but the sign is left of the first pull.
        for r in [0.0, 0.4 * a, 0.9 * a] {
            let forth = contact.traction_mpa(peak, r).unwrap();
            let back = contact.unloading_traction_mpa(peak, -peak, r).unwrap();
            assert!((forth + back).abs() < 1e-12);
        }
    }

    #[test]
    fn the_loss_of_a_cycle_is_the_area_of_the_force_displacement_loop() {
        let contact = contact();
        for share in [0.2, 0.6, 0.95] {
            let peak = share * contact.limit_n();
            let steps = 4000;
            let mut area = 0.0;
            let mut last = contact.unloading_displacement_mm(peak, -peak).unwrap();
            for i in 1..=steps {
                let pull = -peak + 2.0 * peak * f64::from(i) / f64::from(steps);
                // Reloading mirrors unloading: δ_up(Q) = −δ_down(−Q).
                let up = -contact.unloading_displacement_mm(peak, -pull).unwrap();
                let up_last = last;
                last = up;
                let mid = pull - peak / f64::from(steps);
                area += 2.0 * mid * (up - up_last);
            }
            let loss = contact.cycle_loss_nmm(peak).unwrap();
            assert!(
                (area / loss - 1.0).abs() < 1e-3,
                "share {share}: {area} against {loss}"
            );
        }
    }

    #[test]
    fn a_small_pull_meets_mindlins_stiffness_and_the_limit_slides() {
        let contact = contact();
        let pull = 1e-6 * contact.limit_n();
        let stiffness = 2.0 * contact.tangential_modulus_mpa * contact.hertz.radius_mm();
        assert!((contact.displacement_mm(pull).unwrap() * stiffness / pull - 1.0).abs() < 1e-5);
        assert!(contact.stick_radius_mm(contact.limit_n()).unwrap() < 1e-3);
        assert!(contact.stick_radius_mm(1.01 * contact.limit_n()).is_err());
        assert!(CattaneoMindlin::new(contact.hertz, 0.0, &Gel::default()).is_err());
    }
}
