//! A dense layer with its gradients and Adam's moments. Everything is f32, row-major, one sample at a time.

use std::array;

use gripline_network::Tensor;

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
pub(super) struct Dense {
    inputs: usize,
    weights: Learned,
    bias: Learned,
}

impl Dense {
    /// Random weights (He) times `scale`.
    pub(super) fn new(inputs: usize, outputs: usize, scale: f32, rng: &mut Rng) -> Self {
        let sigma = scale * (2.0 / inputs as f32).sqrt();
        // The sum of twelve even numbers is nearly normal.
        let mut normal = || (0..12).map(|_| rng.between(0.0, 1.0)).sum::<f32>() - 6.0;
        Self {
            inputs,
            weights: Learned::new((0..inputs * outputs).map(|_| sigma * normal()).collect()),
            bias: Learned::new(vec![0.0; outputs]),
        }
    }

    pub(super) fn forward(&self, input: &[f32], output: &mut [f32], leak: Option<f32>) {
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
    pub(super) fn backward(&mut self, input: &[f32], slope: &[f32], on_input: &mut [f32]) {
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

    pub(super) fn step(&mut self, step: &Step) {
        self.weights.step(step, step.decay);
        self.bias.step(step, 0.0);
    }

    /// As a weights file holds them.
    pub(super) fn tensors(&self, number: usize) -> [(String, Tensor); 2] {
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
