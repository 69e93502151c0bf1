//! What the microcontroller gets to see of a finger: the chain's map of a rendered picture, or a model of that map which
//! costs a small part of it. The model was fitted to the maps of 250 grasps with rendered pictures (seed 5 of both worlds) beside the true
//! ones: the network's error belongs to the state of the contact and changes as that changes, and pictures of the same state
//! differ by half a percent. A test compares both. Limits: above 12 N of normal force, where the network was not trained, its shear
//! fluctuates more than the model's; its stick ratio lies 0.06 to 0.09 below the model's.

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
const BLUR_TAXELS: f32 = 0.35;
/// Reach of the blur, taxels.
const REACH: isize = 2;
/// Mean and spread of a fingertip's gain on all forces.
const GAIN: [f64; 2] = [0.985, 0.025];
/// Normal force that the edge of a contact loses, N.
const LOST_N: f64 = 0.1;
/// How much more shear there is over the normal force with each doubling of the normal force; at 1 N it is right.
const SHEAR_PER_OCTAVE: f64 = 0.017;
/// Spread of a taxel's errors, which belong to the state of the contact: of each shear over the taxel's normal force, and of that.
const SHEAR_ERROR: f64 = 0.06;
const NORMAL_ERROR: f64 = 0.12;
/// Way between states whose errors have little in common: in total shear over total normal force and in the latter's logarithm.
const WAY: f64 = 1.0;
/// Noise of each picture of the same state, common to all taxels; in the same units.
const SHEAR_NOISE: f64 = 0.001_8;
const NORMAL_NOISE: f64 = 0.004_7;

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
    gain: f64,
    /// Errors of the taxels in the present state, in units of their spread.
    errors: Vec<[f64; 3]>,
    /// Total shear over total normal force, and the logarithm of that.
    state: [f64; 3],
    distorted: Option<Box<Distorted>>,
}

impl Model {
    /// The sensor number `unit` with this network behind it, and this distortion.
    pub(super) fn new(network: &Network, unit: u64, distortion: Option<Distortion>) -> Self {
        let mut random = Random::new(unit, MODEL);
        let mut three = || [0; 3].map(|_| normal(&mut random));
        let errors = (0..SIDE * SIDE).map(|_| three()).collect();
        Self {
            contact_min_n: network.calibration().contact_min_n,
            gain: GAIN[0] + GAIN[1] * normal(&mut random),
            errors,
            random,
            state: [0.0; 3],
            distorted: distortion.map(|distortion| Box::new(Distorted::new(distortion))),
        }
    }

    fn look(&mut self, forces: &[[f32; 3]; SIDE * SIDE]) -> Result<ForceMap, EvaluationError> {
        let total =
            |forces: &[[f32; 3]], k: usize| -> f64 { forces.iter().map(|force| f64::from(force[k])).sum() };
        let normal_n = total(forces, 2).max(1e-3);
        self.go([
            total(forces, 0) / normal_n,
            total(forces, 1) / normal_n,
            normal_n.ln(),
        ]);
        let mut seen = blurred(forces);
        if let Some(distorted) = &mut self.distorted {
            distorted.apply(&mut seen, 1.0 / FRAMES_PER_SECOND);
        }
        let whole_n = total(&seen, 2).max(1e-3);
        for force in &mut seen {
            if force[2] <= self.contact_min_n {
                *force = [0.0; 3];
            }
        }
        let kept_n = total(&seen, 2).max(1e-3);
        let gain = self.gain * (whole_n - LOST_N).max(0.5 * whole_n) / kept_n;
        let shear = 1.0 + SHEAR_PER_OCTAVE * whole_n.max(0.1).log2();
        let noise = [SHEAR_NOISE, SHEAR_NOISE, NORMAL_NOISE].map(|spread| spread * normal(&mut self.random));
        for (force, errors) in seen.iter_mut().zip(&self.errors) {
            let of = |k: usize, spread: f64| noise[k] + spread * errors[k];
            let [x, y, z] = force.map(f64::from);
            let z = z * gain * of(2, NORMAL_ERROR).exp();
            let x = x * gain * shear + of(0, SHEAR_ERROR) * z;
            let y = y * gain * shear + of(1, SHEAR_ERROR) * z;
            *force = [x, y, z].map(|part| part as f32);
        }
        Ok(ForceMap::quantise(&seen)?.0)
    }

    /// The contact is in another state: the longer the way there, the less its errors have in common with those before.
    fn go(&mut self, state: [f64; 3]) {
        let [x, y, normal_n] = [0, 1, 2].map(|k| state[k] - self.state[k]);
        let stays = (-(x.hypot(y) + normal_n.abs()) / WAY).exp();
        let news = (1.0 - stays * stays).sqrt();
        for error in self.errors.iter_mut().flatten() {
            *error = stays * *error + news * normal(&mut self.random);
        }
        self.state = state;
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
    distorted: Option<Box<Distorted>>,
}

impl Rendered {
    /// Looks at finger 0 of `world` before anything touches; its forces are then off by `distortion`.
    ///
    /// # Errors
    /// A fingertip that cannot be made.
    pub(super) fn new(
        network: &Network,
        distortion: Option<Distortion>,
        world: &mut GraspWorld,
    ) -> Result<Self, EvaluationError> {
        let mut rest = Vec::with_capacity(REST_PICTURES.into());
        for _ in 0..REST_PICTURES {
            rest.push(world.rest_image(0)?.pixels);
        }
        let rule = TaxelRule::of(&settings_for(network));
        Ok(Self {
            pipeline: Pipeline::new(network.clone(), &rest, GateKind::default(), rule),
            crop: Image::crop(),
            distorted: distortion.map(|distortion| Box::new(Distorted::new(distortion))),
        })
    }

    fn look(&mut self, world: &mut GraspWorld) -> Result<(ForceMap, Health), EvaluationError> {
        world.render(0, &mut self.crop)?;
        let processed = self.pipeline.process(&self.crop.pixels)?;
        let Some(distorted) = &mut self.distorted else {
            return Ok((processed.map.clone(), processed.health));
        };
        let mut seen = processed.map.dequantise();
        distorted.apply(&mut seen, 1.0 / FRAMES_PER_SECOND);
        Ok((ForceMap::quantise(&seen)?.0, processed.health))
    }
}

#[cfg(test)]
mod tests {
    use gripline_network::Architecture;
    use gripline_simulation::grasp::GraspParts;

    use super::super::nominal;
    use super::*;
    use crate::grasps::GelModel;

    /// Errors of a map's totals: both shears over the normal force, and the logarithm of the normal force.
    fn errors(seen: &ForceMap, truth: &[[f32; 3]; SIDE * SIDE]) -> [f64; 3] {
        let totals = |forces: &[[f32; 3]; SIDE * SIDE]| -> [f64; 3] {
            [0, 1, 2].map(|k| forces.iter().map(|force| f64::from(force[k])).sum())
        };
        let ([x, y, z], [true_x, true_y, true_z]) = (totals(&seen.dequantise()), totals(truth));
        [
            x / z - true_x / true_z,
            y / z - true_y / true_z,
            (z / true_z).ln(),
        ]
    }

    fn rms(values: &[f64]) -> f64 {
        (values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64).sqrt()
    }

    /// Grasps with rendered pictures and the model beside them: how the errors of shear and normal force change from one picture to the
    /// next and over a quarter of a second, and how many taxels are in contact.
    #[test]
    fn the_model_errs_as_the_chain_does() {
        let network = Network::embedded(Architecture::Tracked).unwrap();
        // [of pictures, of the model], [shear, normal force].
        let mut next = [[Vec::new(), Vec::new()], [Vec::new(), Vec::new()]];
        let mut later = next.clone();
        let mut contact = [0.0; 2];
        for number in 0..6 {
            let mut plan = nominal::grasp(11, number);
            plan.scene.contact = GelModel::Brush.model();
            let parts = GraspParts::new(&plan.scene).unwrap();
            let mut world = GraspWorld::with_parts(&plan.scene, &parts).unwrap();
            let mut pictures = Rendered::new(&network, None, &mut world).unwrap();
            let mut model = Model::new(&network, plan.sensor, None);
            let force_n = 1.6 * plan.scene.object.min_grip_n(plan.scene.object.weight_n());
            let mut course = Vec::new();
            for _ in 0..150 {
                let (seen, _) = pictures.look(&mut world).unwrap();
                let truth = world.frame().fingers[0].forces;
                let modelled = model.look(&truth).unwrap();
                let normal_n: f32 = truth.iter().map(|force| force[2]).sum();
                if (0.8..12.0).contains(&normal_n) && seen.active().count() > 0 {
                    course.push([errors(&seen, &truth), errors(&modelled, &truth)]);
                    contact[0] += f64::from(seen.active().count());
                    contact[1] += f64::from(modelled.active().count());
                }
                world.step(1.0 / FRAMES_PER_SECOND, force_n).unwrap();
            }
            for (lag, found) in [(1, &mut next), (16, &mut later)] {
                for (now, before) in course.iter().skip(lag).zip(&course) {
                    for (found, (now, before)) in found.iter_mut().zip(now.iter().zip(before)) {
                        found[0].push(now[0] - before[0]);
                        found[0].push(now[1] - before[1]);
                        found[1].push(now[2] - before[2]);
                    }
                }
            }
        }
        for (what, found) in [("next", &next), ("later", &later)] {
            for axis in 0..2 {
                let [chain, model] = [0, 1].map(|which| rms(&found[which][axis]));
                assert!(
                    (0.5..2.0).contains(&(model / chain)),
                    "{what} picture, {}: {model} of the model, {chain} of the chain",
                    ["shear over normal force", "normal force"][axis]
                );
            }
        }
        assert!((0.85..1.15).contains(&(contact[1] / contact[0])), "{contact:?}");
    }

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
