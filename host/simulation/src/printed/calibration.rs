//! A ball pressed on a unit with known forces, as one calibrates a real sensor on a kitchen scale or a force-torque sensor.

use std::sync::Arc;

use gripline_sensor::Sensor;

use super::contacts::PrintedSample;
use super::picture::PrintedPicture;
use super::unit::{PrintedUnit, UnitRange};
use crate::contact_world::{Contact, Drive, Mount, Press, Shape};
use crate::error::SimulationError;
use crate::field::DisplacementField;
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
    field: Option<DisplacementField>,
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
            field: None,
        }
    }

    /// A picture of the unit as it was pressed last.
    #[must_use]
    pub fn picture(&mut self, picture: &PrintedPicture) -> Vec<u8> {
        picture.draw(&self.unit, self.field.as_ref(), &mut self.random)
    }

    /// Lifts the ball.
    pub fn lift(&mut self) {
        self.field = None;
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
        if press.shear_n.iter().any(|shear| shear.abs() > 0.0) {
            for step in 1..=PULLS {
                let part = f64::from(step) / f64::from(PULLS) * newtons;
                let [x, y] = press.shear_n.map(|shear| shear * part);
                // A pull is given with the moment that a ball pressed straight down has: none.
                let held = contact
                    .truth()
                    .torsional_moment_nmm(contact.truth().footprint_mm());
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
        self.field = Some(field);
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

/// A bench: pictures of a unit at rest and under presses, and what a force-torque sensor under it logs.
#[derive(Debug)]
pub struct PrintedBench {
    /// The unit untouched.
    pub rest: Vec<Vec<u8>>,
    /// The presses, picture by picture.
    pub pictures: Vec<Vec<u8>>,
    /// Time of every picture by the logger's clock, s, and the force on the gel, N.
    pub log: Vec<(f64, [f64; 3])>,
}

/// Pictures at rest.
const AT_REST: usize = 16;
/// Pictures of each press, and between presses.
const HELD: usize = 14;
const BETWEEN: usize = 4;
/// How much later the logger's clock is, s.
const LATE_S: f64 = 0.4;

impl PrintedBench {
    /// Unit number `unit` of `sensor`, drawn from `range`, pressed `presses` times by a ball of 6 mm at other places and loads up to
    /// `max_n`; `seed` decides noise and the first place, so that another day differs.
    ///
    /// # Errors
    /// A gel constant outside its range, or a contact that does not converge.
    pub fn play(
        sensor: &Sensor,
        range: &UnitRange,
        presses: u32,
        max_n: f64,
        [unit, seed]: [u64; 2],
    ) -> Result<Self, SimulationError> {
        let unit = Arc::new(PrintedUnit::draw(sensor, range, &mut Random::new(unit, 53))?);
        let drawing = PrintedPicture::new(sensor);
        let mut ball = PressedBall::new(unit, 6.0, 0.9, seed);
        let mut bench = Self {
            rest: (0..AT_REST).map(|_| ball.picture(&drawing)).collect(),
            pictures: Vec::new(),
            log: Vec::new(),
        };
        let mut show = |ball: &mut PressedBall, pictures: usize, force: [f64; 3]| {
            for _ in 0..pictures {
                let t = bench.pictures.len() as f64 / sensor.capture.rate_hz;
                bench.log.push((t + LATE_S, force));
                bench.pictures.push(ball.picture(&drawing));
            }
        };
        show(&mut ball, BETWEEN, [0.0; 3]);
        for number in 0..presses {
            let number = f64::from(number);
            // Round and round, farther and farther out; loads in another order than places.
            let (angle, far) = (2.4 * number + seed as f64, (number / f64::from(presses)).sqrt());
            let [half_x, half_y] = sensor.view.field_mm.map(|side| 0.28 * side);
            let share = (0.618 * (number + 1.0)).fract();
            let normal_n = max_n * (0.3 + 0.7 * share);
            let (sin, cos) = libm::sincos(2.0 * angle);
            let press = BallPress {
                at_mm: [half_x * far * libm::cos(angle), half_y * far * libm::sin(angle)],
                normal_n,
                shear_n: [0.3 * normal_n * cos, 0.3 * normal_n * sin],
                creep: 0.0,
            };
            let sample = ball.press(&press)?;
            let total = |axis: usize| {
                sample
                    .forces
                    .iter()
                    .map(|force| f64::from(force[axis]))
                    .sum::<f64>()
            };
            show(&mut ball, HELD, [total(0), total(1), total(2)]);
            ball.lift();
            show(&mut ball, BETWEEN, [0.0; 3]);
        }
        Ok(bench)
    }

    /// The log as a CSV file.
    #[must_use]
    pub fn csv(&self) -> String {
        let lines = self
            .log
            .iter()
            .map(|(t, [x, y, z])| format!("{t:.3},{x:.4},{y:.4},{z:.4}\n"));
        std::iter::once("time_s,fx_n,fy_n,fz_n\n".to_owned())
            .chain(lines)
            .collect()
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
            assert!(
                (total(0) - 0.3).abs() < 0.03 && (total(1) - 0.1).abs() < 0.03,
                "{} {}",
                total(0),
                total(1)
            );
            let moves = sample.rest_mm.iter().zip(&sample.now_mm);
            moves
                .map(|(rest, (now, _))| libm::hypot(now[0] - rest[0], now[1] - rest[1]))
                .fold(0.0, f64::max)
        };
        assert!(moved(0.5) > 1.5 * moved(1.0));
    }
}
