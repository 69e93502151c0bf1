//! Dense layers with their gradients and Adam's moments, and the three of a marker network. Everything is f32, row-major, one sample
//! at a time.

use std::array;
use std::collections::BTreeMap;

use gripline_network::Tensor;
use gripline_network::marker_forces::{FORCE_OUTPUTS, LEAK, MOTION_INPUTS, MarkerWeights};

use crate::rng::Rng;

const MOMENTUM: f32 = 0.9;
const SECOND: f32 = 0.999;

/// A step of the optimiser.
pub(super) struct Step {
    pub(super) rate: f32,
    pub(super) decay: f32,
    /// From 1.
    pub(super) number: i32,
    /// Samples whose gradients were added.
    pub(super) batch: f32,
}

/// Numbers that are learned, with what Adam needs of them.
#[derive(Debug, Clone)]
struct Learned {
    values: Vec<f32>,
    gradient: Vec<f32>,
    moments: [Vec<f32>; 2],
}

impl Learned {
    fn new(values: Vec<f32>) -> Self {
        let zeros = vec![0.0; values.len()];
        Self {
            gradient: zeros.clone(),
            moments: array::from_fn(|_| zeros.clone()),
            values,
        }
    }

    fn step(&mut self, step: &Step, decay: f32) {
        let correct = [MOMENTUM, SECOND].map(|keep| 1.0 - keep.powi(step.number));
        let [first, second] = &mut self.moments;
        let moments = first.iter_mut().zip(second);
        for ((value, gradient), (first, second)) in
            self.values.iter_mut().zip(&mut self.gradient).zip(moments)
        {
            let slope = std::mem::take(gradient) / step.batch;
            *first = MOMENTUM * *first + (1.0 - MOMENTUM) * slope;
            *second = SECOND * *second + (1.0 - SECOND) * slope * slope;
            let way = *first / correct[0] / ((*second / correct[1]).sqrt() + 1e-8);
            *value -= step.rate * (way + decay * *value);
        }
    }
}

/// A layer.
#[derive(Debug, Clone)]
struct Dense {
    inputs: usize,
    weights: Learned,
    bias: Learned,
}

impl Dense {
    /// Random weights (He) times `scale`.
    fn random(inputs: usize, outputs: usize, scale: f32, rng: &mut Rng) -> Self {
        let sigma = scale * (2.0 / inputs as f32).sqrt();
        // The sum of twelve even numbers is nearly normal.
        let mut normal = || (0..12).map(|_| rng.between(0.0, 1.0)).sum::<f32>() - 6.0;
        Self {
            inputs,
            weights: Learned::new((0..inputs * outputs).map(|_| sigma * normal()).collect()),
            bias: Learned::new(vec![0.0; outputs]),
        }
    }

    /// Trained weights, row by row, and biases.
    fn trained(weights: Vec<f32>, bias: Vec<f32>) -> Self {
        Self {
            inputs: weights.len() / bias.len(),
            weights: Learned::new(weights),
            bias: Learned::new(bias),
        }
    }

    fn forward(&self, input: &[f32], output: &mut [f32], leak: Option<f32>) {
        let rows = self.weights.values.chunks_exact(self.inputs);
        for ((out, row), bias) in output.iter_mut().zip(rows).zip(&self.bias.values) {
            let sum = bias + dot(row, input);
            *out = match leak {
                Some(leak) if sum < 0.0 => leak * sum,
                _ => sum,
            };
        }
    }

    /// Adds the gradients of a sample; writes the slope on its input.
    fn backward(&mut self, input: &[f32], slope: &[f32], on_input: &mut [f32]) {
        on_input.fill(0.0);
        let rows = self.weights.values.chunks_exact(self.inputs);
        let gradients = self.weights.gradient.chunks_exact_mut(self.inputs);
        for (((row, gradient), slope), bias) in rows.zip(gradients).zip(slope).zip(&mut self.bias.gradient) {
            *bias += slope;
            for (((gradient, weight), input), back) in
                gradient.iter_mut().zip(row).zip(input).zip(&mut *on_input)
            {
                *gradient += slope * input;
                *back += slope * weight;
            }
        }
    }

    fn step(&mut self, step: &Step) {
        self.weights.step(step, step.decay);
        self.bias.step(step, 0.0);
    }

    /// As a weights file holds them.
    fn tensors(&self, number: usize) -> [(String, Tensor); 2] {
        let outputs = self.bias.values.len();
        [
            (
                format!("dense{number}.weight"),
                Tensor {
                    shape: vec![outputs, self.inputs],
                    values: self.weights.values.clone(),
                },
            ),
            (
                format!("dense{number}.bias"),
                Tensor {
                    shape: vec![outputs],
                    values: self.bias.values.clone(),
                },
            ),
        ]
    }
}

/// The three layers of a marker network in training.
#[derive(Debug, Clone)]
pub(super) struct Layers {
    dense: [Dense; 3],
    /// After the first and the second layer.
    hidden: [Vec<f32>; 2],
    /// Slope of the loss on the input and on the hidden values.
    back: [Vec<f32>; 3],
    /// Of the input that was last taken forward.
    pub(super) output: Vec<f32>,
}

impl Layers {
    /// Random ones; `widths` are the numbers of hidden values.
    pub(super) fn random(widths: [usize; 2], rng: &mut Rng) -> Self {
        let [first, second] = widths;
        Self::of([
            Dense::random(MOTION_INPUTS, first, 1.0, rng),
            Dense::random(first, second, 1.0, rng),
            Dense::random(second, FORCE_OUTPUTS, 0.1, rng),
        ])
    }

    /// Trained ones, whose outputs are scaled by the gains of shear and normal force.
    pub(super) fn trained(weights: &MarkerWeights, [shear, normal]: [f64; 2]) -> Self {
        let mut layers = [0, 1, 2].map(|number| {
            let values = |part: &str| weights.tensors[&format!("dense{number}.{part}")].values.clone();
            Dense::trained(values("weight"), values("bias"))
        });
        let Dense {
            inputs,
            weights,
            bias,
        } = &mut layers[2];
        let rows = weights.values.chunks_exact_mut(*inputs).zip(&mut bias.values);
        for (output, (row, bias)) in rows.enumerate() {
            let gain = if output % 3 == 2 { normal } else { shear } as f32;
            for weight in row.iter_mut() {
                *weight *= gain;
            }
            *bias *= gain;
        }
        Self::of(layers)
    }

    fn of(layers: [Dense; 3]) -> Self {
        let inputs = |layer: usize| vec![0.0; layers[layer].inputs];
        Self {
            hidden: [inputs(1), inputs(2)],
            back: [inputs(0), inputs(1), inputs(2)],
            output: vec![0.0; FORCE_OUTPUTS],
            dense: layers,
        }
    }

    /// Writes [`Self::output`].
    pub(super) fn forward(&mut self, input: &[f32; MOTION_INPUTS]) {
        let ([first, second, last], [one, two]) = (&self.dense, &mut self.hidden);
        first.forward(input, one, Some(LEAK));
        second.forward(one, two, Some(LEAK));
        last.forward(two, &mut self.output, None);
    }

    /// Adds the gradients of the input that was last taken forward; `slope` is the loss's on the output.
    pub(super) fn backward(&mut self, input: &[f32; MOTION_INPUTS], slope: &[f32]) {
        let ([first, second, last], [one, two]) = (&mut self.dense, &self.hidden);
        let [on_input, back_one, back_two] = &mut self.back;
        last.backward(two, slope, back_two);
        leak(two, back_two);
        second.backward(one, back_two, back_one);
        leak(one, back_one);
        first.backward(input, back_one, on_input);
    }

    /// Changes the weights by the gradients since the last step.
    pub(super) fn step(&mut self, step: &Step) {
        for layer in &mut self.dense {
            layer.step(step);
        }
    }

    /// As a weights file holds them.
    pub(super) fn tensors(&self) -> BTreeMap<String, Tensor> {
        let layers = self.dense.iter().enumerate();
        layers.flat_map(|(number, layer)| layer.tensors(number)).collect()
    }
}

/// Through the leak after a layer.
fn leak(output: &[f32], slope: &mut [f32]) {
    for (slope, output) in slope.iter_mut().zip(output) {
        if *output < 0.0 {
            *slope *= LEAK;
        }
    }
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0_f32; 8];
    let (a, b) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a.0.iter().zip(b.0) {
        for lane in 0..8 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    sums.iter().sum::<f32>() + a.1.iter().zip(b.1).map(|(a, b)| a * b).sum::<f32>()
}
