//! What the microcontroller gets to see of a finger: the chain's map of a rendered picture, or a model of that map which
//! costs a hundredth. The model was fitted to 25,000 frames of `evaluate paper --data tuning`: true maps blurred by
//! [`BLUR_TAXELS`] and cut at the network's contact threshold have the chain's stick ratio to 0.05 and its decision
//! SR < 0.5 in 98 % of frames; total forces differ by a gain per run and a fluctuation per frame.

use gripline_firmware::sums::TaxelRule;
use gripline_network::Network;
use gripline_network::scene::GateKind;
use gripline_protocol::{ForceMap, Health, SIDE};
use gripline_simulation::constants::REST_PICTURES;
use gripline_simulation::grasp::GraspWorld;
use gripline_simulation::{Image, Random};

use gripline_pipeline::pipeline::Pipeline;
use gripline_pipeline::settings_for;

use super::distortion::{Distorted, Distortion};
use super::plan::FRAMES_PER_SECOND;
use crate::error::EvaluationError;

/// Purpose of the model's random numbers.
const MODEL: u64 = 73;
/// Standard deviation of the blur, taxels.
const BLUR_TAXELS: f32 = 0.65;
/// Reach of the blur, taxels.
const REACH: isize = 2;
/// Mean and spread of a run's gain on normal force and shear.
const NORMAL_GAIN: [f64; 2] = [0.96, 0.04];
const SHEAR_GAIN: [f64; 2] = [0.98, 0.03];
/// Fluctuation of the shear's gain from frame to frame, and how much of it stays to the next.
const FLUCTUATION: f64 = 0.04;
const STAYS: f64 = 0.8;

/// What looks at a finger.
pub(super) enum Sensor {
    /// The model.
    Model(Box<Model>),
    /// Pictures through the whole chain.
    Rendered(Box<Rendered>),
}

impl Sensor {
    /// The map of finger 0 now.
    ///
    /// # Errors
    /// Forces that are no numbers.
    pub(super) fn look(&mut self, world: &mut GraspWorld) -> Result<(ForceMap, Health), EvaluationError> {
        match self {
            Self::Model(model) => Ok((model.look(&world.frame().fingers[0].forces)?, Health::GOOD)),
            Self::Rendered(rendered) => rendered.look(world),
        }
    }
}

/// The model.
pub(super) struct Model {
    contact_min_n: f32,
    random: Random,
    normal_gain: f64,
    shear_gain: f64,
    fluctuation: f64,
    distorted: Option<Box<Distorted>>,
}

impl Model {
    /// The sensor number `unit` with this network behind it, and this distortion.
    pub(super) fn new(network: &Network, unit: u64, distortion: Option<Distortion>) -> Self {
        let mut random = Random::new(unit, MODEL);
        let [normal_gain, shear_gain] =
            [NORMAL_GAIN, SHEAR_GAIN].map(|[mean, spread]| mean + spread * normal(&mut random));
        Self {
            contact_min_n: network.calibration().contact_min_n,
            random,
            normal_gain,
            shear_gain,
            fluctuation: 0.0,
            distorted: distortion.map(|distortion| Box::new(Distorted::new(distortion))),
        }
    }

    fn look(&mut self, forces: &[[f32; 3]; SIDE * SIDE]) -> Result<ForceMap, EvaluationError> {
        let news = (1.0 - STAYS * STAYS).sqrt() * FLUCTUATION;
        self.fluctuation = STAYS * self.fluctuation + news * normal(&mut self.random);
        let shear = (self.shear_gain * self.normal_gain * (1.0 + self.fluctuation)) as f32;
        let gains = [shear, shear, self.normal_gain as f32];
        let mut seen = blurred(forces);
        if let Some(distorted) = &mut self.distorted {
            distorted.apply(&mut seen, 1.0 / FRAMES_PER_SECOND);
        }
        for force in &mut seen {
            *force = [0, 1, 2].map(|k| force[k] * gains[k]);
            if force[2] <= self.contact_min_n {
                *force = [0.0; 3];
            }
        }
        Ok(ForceMap::quantise(&seen)?.0)
    }
}

/// A number from the normal distribution: the sum of twelve even ones, less six.
pub(super) fn normal(random: &mut Random) -> f64 {
    (0..12).map(|_| random.unit()).sum::<f64>() - 6.0
}

/// The map blurred along rows and columns; what leaves the map is lost.
fn blurred(forces: &[[f32; 3]; SIDE * SIDE]) -> [[f32; 3]; SIDE * SIDE] {
    let weight = |way: isize| (-0.5 * (way as f32 / BLUR_TAXELS).powi(2)).exp();
    let whole: f32 = (-REACH..=REACH).map(weight).sum();
    let side = SIDE as isize;
    let along = |from: &[[f32; 3]; SIDE * SIDE], step: isize| {
        let mut to = [[0.0; 3]; SIDE * SIDE];
        for (taxel, out) in to.iter_mut().enumerate() {
            let place = if step == 1 {
                taxel as isize % side
            } else {
                taxel as isize / side
            };
            for way in -REACH..=REACH {
                if (0..side).contains(&(place + way)) {
                    let force = from[(taxel as isize + way * step) as usize];
                    for k in 0..3 {
                        out[k] += weight(way) / whole * force[k];
                    }
                }
            }
        }
        to
    };
    along(&along(forces, 1), side)
}

/// Pictures through the chain.
pub(super) struct Rendered {
    pipeline: Pipeline,
    crop: Image,
}

impl Rendered {
    /// Looks at finger 0 of `world` before anything touches.
    ///
    /// # Errors
    /// A fingertip that cannot be made.
    pub(super) fn new(network: &Network, world: &mut GraspWorld) -> Result<Self, EvaluationError> {
        let mut rest = Vec::with_capacity(REST_PICTURES.into());
        for _ in 0..REST_PICTURES {
            rest.push(world.rest_image(0)?.pixels);
        }
        let rule = TaxelRule::of(&settings_for(network));
        Ok(Self {
            pipeline: Pipeline::new(network.clone(), &rest, GateKind::default(), rule),
            crop: Image::crop(),
        })
    }

    fn look(&mut self, world: &mut GraspWorld) -> Result<(ForceMap, Health), EvaluationError> {
        world.render(0, &mut self.crop)?;
        let processed = self.pipeline.process(&self.crop.pixels)?;
        Ok((processed.map.clone(), processed.health))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_blur_keeps_forces_and_spreads_them_evenly() {
        let mut forces = [[0.0; 3]; SIDE * SIDE];
        forces[10 * SIDE + 10] = [0.3, -0.2, 1.0];
        let seen = blurred(&forces);
        let sum = |k: usize| seen.iter().map(|force| force[k]).sum::<f32>();
        assert!((sum(0) - 0.3).abs() < 1e-5 && (sum(1) + 0.2).abs() < 1e-5 && (sum(2) - 1.0).abs() < 1e-5);
        let at = |row: usize, column: usize| seen[row * SIDE + column][2];
        assert!((at(9, 10) - at(11, 10)).abs() < 1e-7 && (at(10, 9) - at(9, 10)).abs() < 1e-7);
        assert!(at(10, 10) > at(10, 11) && at(10, 11) > at(11, 11));
    }

    #[test]
    fn normal_numbers_have_mean_0_and_spread_1() {
        let mut random = Random::new(1, 1);
        let draws: Vec<f64> = (0..20_000).map(|_| normal(&mut random)).collect();
        let mean = draws.iter().sum::<f64>() / 20_000.0;
        let spread = (draws.iter().map(|draw| draw * draw).sum::<f64>() / 20_000.0).sqrt();
        assert!(
            mean.abs() < 0.03 && (spread - 1.0).abs() < 0.03,
            "{mean} {spread}"
        );
    }
}
