//! Fine-tunes a marker network on recorded presses of the very gel: the force-torque sensor's totals and the area that the imprint shows
//! touched are the labels; simulated contacts keep the rest. A gel that is softer or thinner than described moves the markers
//! farther everywhere, which two gains explain; they are fitted first, and scale the last layer and the simulated forces alike. What is
//! left for the network is what no gain mends.

use std::collections::BTreeMap;

use gripline_evaluation::calibration::gel::Press;
use gripline_network::Tensor;
use gripline_network::constants::TAXELS;
use gripline_network::marker_forces::{FORCE_OUTPUTS, LEAK, MOTION_INPUTS, MarkerWeights, PULL, mirrored};

use super::dense::{Dense, Step};
use super::samples::Sample;
use super::{BATCH, DECAY, ERROR_MAX, FLOOR_N, FLOOR_N2, input_in, leak, map_in, schedule, slopes};
use crate::rng::Rng;

/// Peak of the learning rate: the network is good already.
const RATE: f32 = 2e-4;
/// Recorded samples of a step's 32; the others are simulated.
const RECORDED: usize = 8;
/// Weight of normal force where nothing touches, relative to the map's square, against that of the summed forces.
const AREA_WEIGHT: f32 = 0.1;
/// Parts that take turns at being left out, where there is one recording.
const PARTS: usize = 4;

/// Which presses are left out together: those of a recording, or of a part of the only one.
pub(super) fn folds(presses: &[Press]) -> Vec<usize> {
    let days = presses.iter().map(|press| press.day).max().unwrap_or(0) + 1;
    let fold = |(number, press): (usize, &Press)| if days > 1 { press.day } else { number % PARTS };
    presses.iter().enumerate().map(fold).collect()
}

/// A picture of a press.
#[derive(Debug, Clone)]
pub(super) struct Pressed {
    pub(super) input: Box<[f32; MOTION_INPUTS]>,
    pub(super) rms_mm: f32,
    /// Which taxels the imprint shows touched.
    pub(super) touched: [bool; TAXELS],
    pub(super) press: usize,
}

/// What a network is tuned with.
pub(super) struct Tuning<'a> {
    pub(super) simulated: &'a [Sample],
    pub(super) pressed: &'a [Pressed],
    /// Force of each press, N: x, y, normal.
    pub(super) truth_n: &'a [[f64; 3]],
    /// Whether shear was measured.
    pub(super) has_shear: bool,
    pub(super) steps: u32,
    pub(super) seed: u32,
}

/// The three layers at work.
pub(super) struct Tuned {
    layers: [Dense; 3],
    hidden: [Vec<f32>; 2],
    output: Vec<f32>,
}

impl Tuned {
    /// Trained layers whose output is scaled by gains of shear and normal force.
    pub(super) fn new(weights: &MarkerWeights, [shear, normal]: [f64; 2]) -> Self {
        let gain_of = |output: usize| if output % 3 == 2 { normal } else { shear } as f32;
        let layers = [0, 1, 2].map(|number| {
            let tensor = |part: &str| weights.tensors[&format!("dense{number}.{part}")].values.clone();
            let (mut values, mut bias) = (tensor("weight"), tensor("bias"));
            if number == 2 {
                let inputs = values.len() / bias.len();
                for (output, row) in values.chunks_exact_mut(inputs).enumerate() {
                    row.iter_mut().for_each(|value| *value *= gain_of(output));
                }
                for (output, value) in bias.iter_mut().enumerate() {
                    *value *= gain_of(output);
                }
            }
            Dense::of(values, bias)
        });
        Self {
            layers,
            hidden: weights.widths.map(|width| vec![0.0; width]),
            output: vec![0.0; FORCE_OUTPUTS],
        }
    }

    fn forward(&mut self, input: &[f32; MOTION_INPUTS]) {
        let [one, two] = &mut self.hidden;
        let [first, second, last] = &self.layers;
        first.forward(input, one, Some(LEAK));
        second.forward(one, two, Some(LEAK));
        last.forward(two, &mut self.output, None);
    }

    /// Adds the gradients of the input that was last taken forward.
    fn backward(&mut self, input: &[f32; MOTION_INPUTS], slope: &[f32]) {
        let [one, two] = &self.hidden;
        let (mut back_one, mut back_two) = (vec![0.0; one.len()], vec![0.0; two.len()]);
        let mut unused = vec![0.0; MOTION_INPUTS];
        let [first, second, last] = &mut self.layers;
        last.backward(two, slope, &mut back_two);
        leak(two, &mut back_two);
        second.backward(one, &back_two, &mut back_one);
        leak(one, &mut back_one);
        first.backward(input, &back_one, &mut unused);
    }

    /// Summed force, N: x, y, normal.
    pub(super) fn total_n(&mut self, input: &[f32; MOTION_INPUTS], rms_mm: f32) -> [f64; 3] {
        self.forward(input);
        let mut sums = [0.0; 3];
        for (at, out) in self.output.iter().enumerate() {
            let pull = if at % 3 == 2 && *out < 0.0 { PULL } else { 1.0 };
            sums[at % 3] += f64::from(out * pull * rms_mm);
        }
        sums
    }

    /// As a weights file holds them.
    pub(super) fn tensors(&self) -> BTreeMap<String, Tensor> {
        let layers = self.layers.iter().enumerate();
        layers.flat_map(|(number, layer)| layer.tensors(number)).collect()
    }
}

/// Tunes on the presses of which `is_wanted` says so. Simulated forces are scaled by `gains` too.
pub(super) fn tune(
    weights: &MarkerWeights,
    gains: [f64; 2],
    tuning: &Tuning,
    is_wanted: &dyn Fn(usize) -> bool,
) -> Tuned {
    let mut tuned = Tuned::new(weights, gains);
    let pressed: Vec<&Pressed> = tuning
        .pressed
        .iter()
        .filter(|pressed| is_wanted(pressed.press))
        .collect();
    let mut rng = Rng::new(u64::from(tuning.seed));
    let mut slope = vec![0.0; FORCE_OUTPUTS];
    for step in 1..=tuning.steps {
        for number in 0..BATCH {
            let mirror = [rng.below(2) == 1, rng.below(2) == 1];
            let input = if number < RECORDED || tuning.simulated.is_empty() {
                let sample = pressed[rng.below(pressed.len())];
                let input = input_in(&sample.input, mirror);
                tuned.forward(&input);
                let label = Label::of(sample, tuning, mirror);
                label.slopes(&mut tuned.output, sample.rms_mm, &mut slope);
                input
            } else {
                let sample = &tuning.simulated[rng.below(tuning.simulated.len())];
                let input = input_in(&sample.input, mirror);
                let mut truth = map_in(&sample.forces, mirror);
                for (at, force) in truth.iter_mut().enumerate() {
                    *force *= gains[usize::from(at % 3 == 2)] as f32;
                }
                tuned.forward(&input);
                slopes(&mut tuned.output, &truth, sample.rms_mm, &mut slope);
                input
            };
            tuned.backward(&input, &slope);
        }
        let update = Step {
            rate: RATE * schedule(step as f32 / tuning.steps as f32),
            decay: DECAY,
            number: step as i32,
            batch: BATCH as f32,
        };
        for layer in &mut tuned.layers {
            layer.step(&update);
        }
    }
    tuned
}

/// What is known of a recorded press: totals and where it touches.
struct Label {
    total_n: [f32; 3],
    has_shear: bool,
    touched: [bool; TAXELS],
}

impl Label {
    fn of(pressed: &Pressed, tuning: &Tuning, mirror: [bool; 2]) -> Self {
        let [x, y, z] = tuning.truth_n[pressed.press].map(|force| force as f32);
        let signs = mirror.map(|mirror| if mirror { -1.0 } else { 1.0 });
        Self {
            total_n: [signs[0] * x, signs[1] * y, z],
            has_shear: tuning.has_shear,
            touched: std::array::from_fn(|taxel| pressed.touched[mirrored(taxel, [20, 20], mirror)]),
        }
    }

    /// The loss's slope on every output: relative errors of the sums, and normal force where nothing touches. Returns the loss.
    fn slopes(&self, output: &mut [f32], rms_mm: f32, slope: &mut [f32]) -> f32 {
        let mut sums = [0.0_f32; 3];
        let mut square = FLOOR_N2;
        for (at, out) in output.iter_mut().enumerate() {
            let newtons = *out * rms_mm;
            *out = if at % 3 == 2 && newtons < 0.0 {
                PULL * newtons
            } else {
                newtons
            };
            sums[at % 3] += *out;
        }
        // Of the touched taxels: a constant for the slope, so that force does not grow there to hide what is beside.
        for (touched, force) in self.touched.iter().zip(output.as_chunks::<3>().0) {
            square += if *touched { force[2] * force[2] } else { 0.0 };
        }
        let load = self.total_n[2].abs() + FLOOR_N;
        let relative = [0, 1, 2].map(|axis| {
            let is_known = axis == 2 || self.has_shear;
            if is_known {
                (sums[axis] - self.total_n[axis]) / load
            } else {
                0.0
            }
        });
        let mut beside = 0.0;
        for (at, (out, slope)) in output.iter().zip(slope).enumerate() {
            let is_beside = at % 3 == 2 && !self.touched[at / 3];
            let error = if is_beside { *out } else { 0.0 };
            beside += error * error;
            let by_newton =
                AREA_WEIGHT * error / square + relative[at % 3].clamp(-ERROR_MAX, ERROR_MAX) / load;
            let pulls = at % 3 == 2 && *out < 0.0;
            *slope = by_newton * rms_mm * if pulls { PULL } else { 1.0 };
        }
        0.5 * (relative.iter().map(|error| error * error).sum::<f32>() + AREA_WEIGHT * beside / square)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights() -> MarkerWeights {
        let bytes = include_bytes!("../../../network/weights/gelsight-mini.safetensors");
        MarkerWeights::parse(bytes).unwrap()
    }

    /// Presses of one shape: markers pushed outwards from a place, by a gel that is so much softer.
    fn pressed(press: usize) -> Pressed {
        let mut input = Box::new([0.0; MOTION_INPUTS]);
        let at = [0.2 * press as f32 - 0.5, 0.1 * press as f32 - 0.4];
        for (node, values) in input.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let [x, y] = [(node % 12) as f32 - 5.5, (node / 12) as f32 - 4.0];
            let near = (-0.15 * ((x - at[0]).powi(2) + (y - at[1]).powi(2))).exp();
            *values = [near * (x - at[0]), near * (y - at[1]), 0.9];
        }
        Pressed {
            input,
            rms_mm: 0.02 + 0.004 * press as f32,
            touched: std::array::from_fn(|taxel| {
                (taxel % 20).abs_diff(10) < 4 && (taxel / 20).abs_diff(10) < 4
            }),
            press,
        }
    }

    #[test]
    fn gains_scale_sums_and_tuning_brings_them_to_the_log_s() {
        let (weights, all): (_, Vec<Pressed>) = (weights(), (0..6).map(pressed).collect());
        let total = |tuned: &mut Tuned, at: usize| tuned.total_n(&all[at].input, all[at].rms_mm)[2];
        let mut plain = Tuned::new(&weights, [1.0, 1.0]);
        let mut scaled = Tuned::new(&weights, [1.0, 0.5]);
        let shown: Vec<f64> = (0..6).map(|at| total(&mut plain, at)).collect();
        for (at, shown) in shown.iter().enumerate() {
            assert!((total(&mut scaled, at) / shown - 0.5).abs() < 1e-4);
        }
        // What no gain explains: the harder, the less.
        let truth_n: Vec<[f64; 3]> = (0..6)
            .map(|at| [0.0, 0.0, shown[at] * (1.2 - 0.1 * at as f64)])
            .collect();
        let tuning = Tuning {
            simulated: &[],
            pressed: &all,
            truth_n: &truth_n,
            has_shear: true,
            steps: 60,
            seed: 1,
        };
        let mut tuned = tune(&weights, [1.0, 1.0], &tuning, &|_| true);
        let error = |tuned: &mut Tuned| -> f64 {
            (0..6)
                .map(|at| (total(tuned, at) / truth_n[at][2] - 1.0).abs())
                .sum()
        };
        let (before, after) = (error(&mut plain), error(&mut tuned));
        assert!(after < 0.5 * before, "{before} {after}");
    }

    #[test]
    fn the_slope_is_that_of_the_loss() {
        let label = Label {
            total_n: [0.3, -0.2, 1.0],
            has_shear: true,
            touched: std::array::from_fn(|taxel| taxel % 3 == 0),
        };
        let start: Vec<f32> = (0..FORCE_OUTPUTS)
            .map(|at| 0.02 * ((at * 31 % 17) as f32 / 17.0 + 0.05))
            .collect();
        let loss = |values: &[f32]| {
            let (mut values, mut slope) = (values.to_vec(), vec![0.0; FORCE_OUTPUTS]);
            (label.slopes(&mut values, 1.5, &mut slope), slope)
        };
        let (_, slope) = loss(&start);
        // Taxels beside the contact: those in it count as a constant.
        for at in [3, 4, 5, 8] {
            let moved = |by: f32| {
                let mut there = start.clone();
                there[at] += by;
                loss(&there).0
            };
            let found = (moved(2e-3) - moved(-2e-3)) / 4e-3;
            // Sums are clamped where they are far off; here they are not.
            assert!(
                (found - slope[at]).abs() < 0.05 * slope[at].abs() + 5e-3,
                "{at}: {found} {}",
                slope[at]
            );
        }
    }

    #[test]
    fn days_are_left_out_whole_and_one_day_in_parts() {
        let press = |day| Press {
            span_s: [0.0, 1.0],
            frames: 9,
            raw_n: [0.0, 0.0, 1.0],
            place: [0.0; 2],
            creep: None,
            day,
        };
        assert_eq!(folds(&[press(0), press(0), press(1)]), [0, 0, 1]);
        assert_eq!(
            folds(&[press(0), press(0), press(0), press(0), press(0)]),
            [0, 1, 2, 3, 0]
        );
    }
}
