//! A ball pressed on a unit with known forces, as one calibrates a real sensor on a kitchen scale or a force-torque sensor.

use std::sync::Arc;

use super::contacts::PrintedSample;
use super::unit::PrintedUnit;
use crate::contact_world::{Contact, Drive, Mount, Press, Shape};
use crate::error::SimulationError;
use crate::random::Random;

/// Steps of a press, as training has them.
const STEPS: u32 = 8;
/// Steps of a pull.
const PULLS: u32 = 4;

/// A press: where, how hard, and what then pulls along the gel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallPress {
    /// Where the ball stands, mm.
    pub at_mm: [f64; 2],
    /// Normal force, N.
    pub normal_n: f64,
    /// Force along x and y, N: less than friction holds.
    pub shear_n: [f64; 2],
    /// How much farther the gel has gone than when it was pressed, share: creep.
    pub creep: f64,
}

/// A ball over a unit.
#[derive(Debug)]
pub struct PressedBall {
    unit: Arc<PrintedUnit>,
    radius_mm: f64,
    friction: f64,
    random: Random,
}

impl PressedBall {
    /// A ball of this radius; `seed` decides the tracker's noise.
    #[must_use]
    pub fn new(unit: Arc<PrintedUnit>, radius_mm: f64, friction: f64, seed: u64) -> Self {
        Self {
            unit,
            radius_mm,
            friction,
            random: Random::new(seed, 52),
        }
    }

    /// The unit under one press, from an untouched gel.
    ///
    /// # Errors
    /// A force that friction does not hold, a contact that leaves the surface, or one that does not converge.
    pub fn press(&mut self, press: &BallPress) -> Result<PrintedSample, SimulationError> {
        let gel = self.unit.gel().clone();
        let (scale, modulus) = (gel.scale, self.unit.modulus());
        // The contact world's forces are those of the gel that it was made with, in its own scale.
        let newtons = scale * scale / modulus;
        let ball = Shape::Sphere {
            radius_mm: self.radius_mm * scale,
        };
        let normal = press.normal_n * newtons;
        let mut contact = Contact::new(
            gel.surfaces.finest(),
            Arc::new(ball),
            self.friction,
            Mount::default(),
        )?;
        let drive = Drive {
            press: Press::Force(normal),
            at_mm: press.at_mm.map(|mm| mm * scale),
            turn_rad: 0.0,
            tilt_rad: [0.0; 2],
        };
        contact.go_to(drive, STEPS)?;
        if press.shear_n != [0.0; 2] {
            for step in 1..=PULLS {
                let part = f64::from(step) / f64::from(PULLS) * newtons;
                let [x, y] = press.shear_n.map(|shear| shear * part);
                // A pull is given with the moment that a ball pressed straight down has: none.
                let held = contact.truth().torsional_moment_nmm(contact.truth().footprint_mm());
                contact.pull(Press::Force(normal), [0.0; 2], [x, y, held])?;
            }
        }
        let mut field = self.unit.new_field();
        field.load(contact.truth());
        let rest_mm = self.unit.rest_mm();
        let mut now_mm = self.unit.track(&field, &mut self.random);
        for ((now, _), rest) in now_mm.iter_mut().zip(&rest_mm) {
            for axis in 0..2 {
                now[axis] += press.creep * (now[axis] - rest[axis]);
            }
        }
        let forces = gel.forces_n(contact.truth());
        Ok(PrintedSample {
            unit: Arc::clone(&self.unit),
            rest_mm,
            now_mm,
            forces: forces.map(|taxel| taxel.map(|force| force * modulus as f32)),
            shape: "sphere",
        })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use gripline_sensor::Sensor;

    use super::super::UnitRange;
    use super::*;

    #[test]
    fn a_press_carries_the_force_that_was_asked_for_and_a_softer_gel_moves_farther() {
        let sensor = Sensor::named(Path::new("gelsight-mini")).unwrap();
        let moved = |modulus: f64| {
            let range = UnitRange {
                modulus: [modulus; 2],
                ..UnitRange::of(&sensor)
            };
            let unit = PrintedUnit::draw(&sensor, &range, &mut Random::new(3, 1)).unwrap();
            let mut ball = PressedBall::new(Arc::new(unit), 6.0, 0.8, 1);
            let press = BallPress {
                at_mm: [1.0, -0.5],
                normal_n: 1.0,
                shear_n: [0.3, 0.1],
                creep: 0.0,
            };
            let sample = ball.press(&press).unwrap();
            let total = |component: usize| sample.forces.iter().map(|force| force[component]).sum::<f32>();
            assert!((total(2) - 1.0).abs() < 0.01, "{} N", total(2));
            assert!((total(0) - 0.3).abs() < 0.03 && (total(1) - 0.1).abs() < 0.03, "{} {}", total(0), total(1));
            let moves = sample.rest_mm.iter().zip(&sample.now_mm);
            moves
                .map(|(rest, (now, _))| libm::hypot(now[0] - rest[0], now[1] - rest[1]))
                .fold(0.0, f64::max)
        };
        assert!(moved(0.5) > 1.5 * moved(1.0));
    }
}
