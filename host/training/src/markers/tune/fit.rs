//! Fine-tunes a marker network on pressed pictures of the very gel. Pure. Newtons, mm.
//!
//! A gel that is softer or thinner than described moves the markers farther everywhere, which two gains explain; they are fitted
//! first, and scale the last layer and the simulated forces alike. Training then mends what no gain does. Of a press the sums and
//! the touched area are known, of a simulated contact the whole map. Limits: presses of one ball teach little of flat faces and
//! edges, which the simulated contacts keep as they were.

use std::collections::BTreeSet;

use gripline_evaluation::calibration::gel::{self, GelFit, HeldOut, Press};
use gripline_network::constants::{MAP_SIDE, TAXELS};
use gripline_network::marker_forces::{FORCE_OUTPUTS, MOTION_INPUTS, MarkerWeights, PULL, mirrored};

use super::super::dense::{Layers, Step};
use super::super::descent::{BATCH, DECAY, ERROR_MAX, FLOOR_N, FLOOR_N2, input_in, map_in, schedule, slopes};
use super::super::samples::Sample;
use crate::rng::Rng;

/// Peak of the learning rate: the network is good already.
const RATE: f32 = 2e-4;
/// Pressed samples of a step's 32; the others are simulated.
const PRESSED: usize = 8;
/// Weight of normal force where nothing touches, relative to the map's square, against that of the summed forces.
const AREA_WEIGHT: f32 = 0.1;
/// Parts that take turns at being left out, where there is one recording.
const PARTS: usize = 4;
/// Of the gains' intervals, which are not used.
const CONFIDENCE: f64 = 0.9;

/// A picture of a press.
#[derive(Debug, Clone)]
pub(super) struct PressedPicture {
    pub(super) input: Box<[f32; MOTION_INPUTS]>,
    /// What the network's outputs are multiplied by, mm.
    pub(super) rms_mm: f32,
    /// Which taxels the imprint shows touched.
    pub(super) touched: [bool; TAXELS],
    /// Number of the press.
    pub(super) press: usize,
}

/// What a network is tuned with.
#[derive(Clone, Copy)]
pub(super) struct Tuning<'a> {
    /// To begin with.
    pub(super) weights: &'a MarkerWeights,
    pub(super) simulated: &'a [Sample],
    pub(super) presses: &'a [Press],
    pub(super) pictures: &'a [PressedPicture],
    /// Force of each press, N: x, y, normal.
    pub(super) truth_n: &'a [[f64; 3]],
    pub(super) steps: u32,
    pub(super) seed: u32,
}

/// Error of each press, N.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Errors {
    pub(super) normal_n: Vec<f64>,
    pub(super) shear_n: Vec<f64>,
}

impl Errors {
    fn none(presses: usize) -> Self {
        Self {
            normal_n: vec![0.0; presses],
            shear_n: vec![0.0; presses],
        }
    }

    /// Mean length of the errors over the normal forces: what training makes small. A median of a few presses is mostly chance.
    pub(super) fn mean_share(&self, truth_n: &[[f64; 3]]) -> f64 {
        let lengths = self.normal_n.iter().zip(&self.shear_n).zip(truth_n);
        let sum: f64 = lengths
            .map(|((normal, shear), truth)| normal.hypot(*shear) / truth[2])
            .sum();
        sum / truth_n.len() as f64
    }

    /// Median of the normal forces' errors over the normal forces, as a gel's calibration tells it.
    pub(super) fn median_share(&self, truth_n: &[[f64; 3]]) -> f64 {
        let every: Vec<usize> = (0..truth_n.len()).collect();
        HeldOut::of(&self.normal_n, truth_n, &every).median_share
    }
}

/// Errors of presses that were left out.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LeftOut {
    /// Of the weights as they were.
    pub(super) described: Errors,
    /// Of gains that were fitted to the other presses.
    pub(super) gains: Errors,
    /// Of weights that were tuned on the other presses.
    pub(super) tuned: Errors,
}

/// Which presses are left out together: those of a recording, or of a part of the only one.
fn folds(presses: &[Press]) -> Vec<usize> {
    let days: BTreeSet<usize> = presses.iter().map(|press| press.day).collect();
    let fold = |(number, press): (usize, &Press)| {
        if days.len() > 1 { press.day } else { number % PARTS }
    };
    presses.iter().enumerate().map(fold).collect()
}

/// Tunes with each part of the presses left out in turn.
///
/// # Errors
/// Says why no gains fit the presses.
pub(super) fn leave_out(tuning: &Tuning) -> Result<LeftOut, String> {
    let folds = folds(tuning.presses);
    let none = Errors::none(folds.len());
    let mut left_out = LeftOut {
        described: none.clone(),
        gains: none.clone(),
        tuned: none,
    };
    for fold in folds.iter().collect::<BTreeSet<_>>() {
        let is_kept = |press: usize| folds[press] != *fold;
        let (tuned, gains) = tune(tuning, &is_kept)?;
        let models = [
            (Layers::trained(tuning.weights, [1.0; 2]), &mut left_out.described),
            (Layers::trained(tuning.weights, gains), &mut left_out.gains),
            (tuned, &mut left_out.tuned),
        ];
        for (mut model, errors) in models {
            for press in (0..folds.len()).filter(|press| !is_kept(*press)) {
                let shown = shown_n(&mut model, tuning, press);
                let [x, y, z] = [0, 1, 2].map(|axis| shown[axis] - tuning.truth_n[press][axis]);
                errors.normal_n[press] = z.abs();
                errors.shear_n[press] = x.hypot(y);
            }
        }
    }
    Ok(left_out)
}

/// Mean summed force over a press's pictures, N.
fn shown_n(model: &mut Layers, tuning: &Tuning, press: usize) -> [f64; 3] {
    let (mut sums, mut count) = ([0.0; 3], 0.0_f64);
    for picture in tuning.pictures.iter().filter(|picture| picture.press == press) {
        let total = total_n(model, picture);
        sums = [0, 1, 2].map(|axis| sums[axis] + total[axis]);
        count += 1.0;
    }
    sums.map(|sum| sum / count.max(1.0))
}

/// Summed force of a picture, N: x, y, normal.
fn total_n(model: &mut Layers, picture: &PressedPicture) -> [f64; 3] {
    model.forward(&picture.input);
    let mut sums = [0.0; 3];
    for (at, out) in model.output.iter().enumerate() {
        let pull = if at % 3 == 2 && *out < 0.0 { PULL } else { 1.0 };
        sums[at % 3] += f64::from(out * pull * picture.rms_mm);
    }
    sums
}

/// Tunes on the presses that `is_kept` names. Returns the layers and the gains of shear and normal force that they began with.
///
/// # Errors
/// Says why no gains fit these presses.
pub(super) fn tune(tuning: &Tuning, is_kept: &dyn Fn(usize) -> bool) -> Result<(Layers, [f64; 2]), String> {
    let kept: Vec<usize> = (0..tuning.presses.len()).filter(|at| is_kept(*at)).collect();
    let presses: Vec<Press> = kept.iter().map(|at| tuning.presses[*at].clone()).collect();
    let truth: Vec<[f64; 3]> = kept.iter().map(|at| tuning.truth_n[*at]).collect();
    let fit = gel::fit(&presses, &truth, true, CONFIDENCE)?;
    Ok((descend(tuning, &fit, is_kept), fit.gains()))
}

/// The gradient steps.
fn descend(tuning: &Tuning, fit: &GelFit, is_kept: &dyn Fn(usize) -> bool) -> Layers {
    let gains = fit.gains();
    let mut layers = Layers::trained(tuning.weights, gains);
    let pictures: Vec<&PressedPicture> = tuning
        .pictures
        .iter()
        .filter(|picture| is_kept(picture.press))
        .collect();
    let mut rng = Rng::new(u64::from(tuning.seed));
    let mut slope = vec![0.0; FORCE_OUTPUTS];
    for step in 1..=tuning.steps {
        for number in 0..BATCH {
            let mirror = [rng.below(2) == 1, rng.below(2) == 1];
            let input = if number < PRESSED {
                let picture = pictures[rng.below(pictures.len())];
                let input = input_in(&picture.input, mirror);
                let label = Label::of(picture, tuning.truth_n, fit.shear.is_some(), mirror);
                layers.forward(&input);
                label.slopes(&layers.output, picture.rms_mm, &mut slope);
                input
            } else {
                let sample = &tuning.simulated[rng.below(tuning.simulated.len())];
                let input = input_in(&sample.input, mirror);
                let mut truth = map_in(&sample.forces, mirror);
                for (at, force) in truth.iter_mut().enumerate() {
                    *force *= gains[usize::from(at % 3 == 2)] as f32;
                }
                layers.forward(&input);
                slopes(&mut layers.output, &truth, sample.rms_mm, &mut slope);
                input
            };
            layers.backward(&input, &slope);
        }
        layers.step(&Step {
            rate: RATE * schedule(step as f32 / tuning.steps as f32),
            decay: DECAY,
            number: step as i32,
            batch: BATCH as f32,
        });
    }
    layers
}

/// What is known of a pressed picture: totals and where it touches.
struct Label {
    total_n: [f32; 3],
    has_shear: bool,
    touched: [bool; TAXELS],
}

impl Label {
    /// In the mirrored world.
    fn of(picture: &PressedPicture, truth_n: &[[f64; 3]], has_shear: bool, mirror: [bool; 2]) -> Self {
        let [x, y, z] = truth_n[picture.press].map(|force| force as f32);
        let signs = mirror.map(|mirror| if mirror { -1.0 } else { 1.0 });
        Self {
            total_n: [signs[0] * x, signs[1] * y, z],
            has_shear,
            touched: std::array::from_fn(|taxel| picture.touched[mirrored(taxel, [MAP_SIDE; 2], mirror)]),
        }
    }

    /// The loss's slope on every output: relative errors of the sums, and normal force where nothing touches. Returns the loss. It is
    /// Huber's for the sums, as that of simulated contacts, and relative to what the label says, so that no force grows to hide
    /// another one.
    fn slopes(&self, output: &[f32], rms_mm: f32, slope: &mut [f32]) -> f32 {
        let factor = |at: usize| {
            rms_mm
                * if at % 3 == 2 && output[at] < 0.0 {
                    PULL
                } else {
                    1.0
                }
        };
        let mut sums = [0.0_f32; 3];
        for (at, out) in output.iter().enumerate() {
            sums[at % 3] += out * factor(at);
        }
        let touched = self.touched.iter().filter(|touched| **touched).count().max(1) as f32;
        let normal_n = self.total_n[2];
        // The map's square, were the force even over what is touched.
        let square = normal_n * normal_n / touched + FLOOR_N2;
        let load = normal_n.abs() + FLOOR_N;
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
            let error = if is_beside { out * factor(at) } else { 0.0 };
            beside += error * error;
            let by_newton =
                AREA_WEIGHT * error / square + relative[at % 3].clamp(-ERROR_MAX, ERROR_MAX) / load;
            *slope = by_newton * factor(at);
        }
        relative.into_iter().map(huber).sum::<f32>() + 0.5 * AREA_WEIGHT * beside / square
    }
}

/// Half the square, and a straight line beyond [`ERROR_MAX`].
fn huber(error: f32) -> f32 {
    let within = error.abs().min(ERROR_MAX);
    within * (error.abs() - 0.5 * within)
}

#[cfg(test)]
mod tests {
    use gripline_network::NO_FORCES;
    use gripline_network::marker_forces::{MarkerMotion, MarkerNetwork, MotionGrid};

    use super::*;

    /// Distance of a made-up unit's markers, mm.
    const PITCH_MM: f32 = 1.9;

    fn weights() -> MarkerWeights {
        let bytes = include_bytes!("../../../../network/weights/gelsight-mini.safetensors");
        MarkerWeights::parse(bytes).unwrap()
    }

    fn places_mm() -> Vec<[f32; 2]> {
        let place = |marker: u8| [f32::from(marker % 9) - 4.0, f32::from(marker / 9) - 3.0];
        (0..63)
            .map(|marker| place(marker).map(|at| at * PITCH_MM))
            .collect()
    }

    /// A ball's print: markers pushed outwards from where it presses, so far.
    fn motions(at_mm: [f32; 2], far_mm: f32) -> Vec<MarkerMotion> {
        let moved = |[x, y]: [f32; 2]| {
            let [dx, dy] = [x - at_mm[0], y - at_mm[1]];
            let near = far_mm * (-0.08 * (dx * dx + dy * dy)).exp();
            [near * dx, near * dy]
        };
        places_mm()
            .into_iter()
            .map(|place| MarkerMotion {
                moved_mm: moved(place),
                is_seen: true,
            })
            .collect()
    }

    fn input_of(motions: &[MarkerMotion]) -> (Box<[f32; MOTION_INPUTS]>, f32) {
        let mut input = Box::new([0.0; MOTION_INPUTS]);
        let rms_mm = MotionGrid::new(weights().node_mm, &places_mm()).fill(motions, &mut input);
        (input, rms_mm)
    }

    fn picture(press: usize) -> PressedPicture {
        let at = [1.2 * press as f32 - 3.0, 0.8 * press as f32 - 2.0];
        let (input, rms_mm) = input_of(&motions(at, 0.02 + 0.01 * press as f32));
        PressedPicture {
            input,
            rms_mm,
            touched: [true; TAXELS],
            press,
        }
    }

    /// What the weights make of a pressed and sheared contact: a simulated one that they are right about.
    fn simulated(at_mm: [f32; 2]) -> Sample {
        let mut network = MarkerNetwork::new(&weights()).unwrap();
        network.set_rest(&places_mm());
        let mut motions = motions(at_mm, 0.05);
        for (motion, [x, y]) in motions.iter_mut().zip(places_mm()) {
            let near = (-0.08 * ((x - at_mm[0]).powi(2) + (y - at_mm[1]).powi(2))).exp();
            motion.moved_mm[0] += 0.15 * near;
        }
        let mut forces = NO_FORCES;
        network.infer(&motions, &mut forces);
        let (input, rms_mm) = input_of(&motions);
        Sample {
            places_mm: places_mm(),
            motions,
            forces,
            shape: "print".to_owned(),
            zoom: 1.0,
            input,
            rms_mm,
        }
    }

    fn press(number: usize, day: usize, raw_n: [f64; 3]) -> Press {
        Press {
            span_s: [number as f64, number as f64 + 0.8],
            frames: 9,
            raw_n,
            place: [0.0; 2],
            creep: None,
            day,
        }
    }

    fn total_of(forces: &[[f32; 3]]) -> [f64; 3] {
        [0, 1, 2].map(|axis| forces.iter().map(|force| f64::from(force[axis])).sum())
    }

    #[test]
    fn trained_layers_sum_up_as_the_engine_does_and_gains_scale_their_sums() {
        let weights = weights();
        let contact = simulated([1.0, -0.5]);
        let pressed = PressedPicture {
            input: contact.input,
            rms_mm: contact.rms_mm,
            touched: [true; TAXELS],
            press: 0,
        };
        let plain = total_n(&mut Layers::trained(&weights, [1.0; 2]), &pressed);
        let scaled = total_n(&mut Layers::trained(&weights, [0.8, 0.5]), &pressed);
        for (axis, engine) in total_of(&contact.forces).into_iter().enumerate() {
            let gain = if axis == 2 { 0.5 } else { 0.8 };
            assert!(
                (plain[axis] - engine).abs() < 1e-4 * plain[2],
                "{plain:?} {engine}"
            );
            assert!(
                (scaled[axis] - gain * plain[axis]).abs() < 1e-4 * plain[2],
                "{scaled:?} {plain:?}"
            );
        }
    }

    #[test]
    fn tuning_brings_presses_to_the_log_and_keeps_what_they_do_not_show() {
        let weights = weights();
        let pictures: Vec<PressedPicture> = (0..6).map(picture).collect();
        let mut plain = Layers::trained(&weights, [1.0; 2]);
        let shown: Vec<[f64; 3]> = pictures
            .iter()
            .map(|picture| total_n(&mut plain, picture))
            .collect();
        // What no gain explains: the harder, the less.
        let truth_n: Vec<[f64; 3]> = shown
            .iter()
            .enumerate()
            .map(|(at, [x, y, z])| [*x, *y, z * (1.2 - 0.08 * at as f64)])
            .collect();
        let presses: Vec<Press> = shown
            .iter()
            .enumerate()
            .map(|(at, shown)| press(at, 0, *shown))
            .collect();
        let contacts: Vec<Sample> = [[0.0, 0.0], [3.0, 2.0], [-3.0, 0.0], [0.0, -2.0]]
            .map(simulated)
            .into();
        let tuning = Tuning {
            weights: &weights,
            simulated: &contacts,
            presses: &presses,
            pictures: &pictures,
            truth_n: &truth_n,
            steps: 600,
            seed: 1,
        };
        let (mut tuned, gains) = tune(&tuning, &|_| true).unwrap();
        let off = |layers: &mut Layers| -> f64 {
            (0..6)
                .map(|at| (total_n(layers, &pictures[at])[2] / truth_n[at][2] - 1.0).abs())
                .sum()
        };
        let [before, after] = [off(&mut Layers::trained(&weights, gains)), off(&mut tuned)];
        assert!(after < 0.5 * before, "{before} {after}");

        // A contact of the simulated kind, at a place that no sample has.
        let kept = simulated([-1.5, 1.0]);
        let mut network = MarkerNetwork::new(&MarkerWeights {
            tensors: tuned.tensors(),
            ..weights
        })
        .unwrap();
        network.set_rest(&places_mm());
        let mut found = NO_FORCES;
        network.infer(&kept.motions, &mut found);
        let (mut error, mut square) = (0.0, 0.0);
        let pairs = found.as_flattened().iter().zip(kept.forces.as_flattened());
        for (at, (found, force)) in pairs.enumerate() {
            let expected = force * gains[usize::from(at % 3 == 2)] as f32;
            error += (found - expected).powi(2);
            square += expected * expected;
        }
        assert!(error < 0.05 * square, "{error} of {square}");
    }

    #[test]
    fn the_slope_is_that_of_the_loss_near_the_label_and_far_from_it() {
        let (touched, rms_mm) = (std::array::from_fn(|taxel| taxel % 3 == 0), 0.05);
        // Outputs of either sign, touched or not.
        let output: Vec<f32> = (0..FORCE_OUTPUTS)
            .map(|at| 0.2 * ((at * 31 % 17) as f32 / 17.0 - 0.185))
            .collect();
        let mut sums = [0.0_f32; 3];
        for (at, out) in output.iter().enumerate() {
            sums[at % 3] += out * rms_mm * if at % 3 == 2 && *out < 0.0 { PULL } else { 1.0 };
        }
        for share in [0.9, 0.3, 4.0] {
            let label = Label {
                total_n: sums.map(|sum| share * sum),
                has_shear: true,
                touched,
            };
            let mut slope = vec![0.0; FORCE_OUTPUTS];
            label.slopes(&output, rms_mm, &mut slope);
            for at in [0, 1, 2, 5, 8, 11, 14, 600, 601, 602] {
                let mut unused = vec![0.0; FORCE_OUTPUTS];
                let mut moved = |by: f32| {
                    let mut there = output.clone();
                    there[at] += by;
                    label.slopes(&there, rms_mm, &mut unused)
                };
                // A step that crosses nothing, where a pull begins to count otherwise.
                let step = 0.5 * output[at].abs().min(0.02);
                let found = (moved(step) - moved(-step)) / (2.0 * step);
                assert!(
                    (found - slope[at]).abs() < 0.02 * slope[at].abs() + 2e-4,
                    "{share}, {at}: {found} {}",
                    slope[at]
                );
            }
        }
    }

    #[test]
    fn days_are_left_out_whole_and_one_day_in_parts() {
        let of = |days: &[usize]| {
            let presses: Vec<Press> = days.iter().map(|day| press(0, *day, [0.0, 0.0, 1.0])).collect();
            folds(&presses)
        };
        assert_eq!(of(&[0, 0, 1]), [0, 0, 1]);
        assert_eq!(of(&[1; 5]), [0, 1, 2, 3, 0]);
    }
}
