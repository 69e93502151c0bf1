//! The learned gate: a small int8 network, run by microflow. Its input is the motion energy of each block since rest and
//! since the last processed picture. `gripline-training gate` trains it and shifts its outputs so that 0 is the threshold.
//! Units: energy over that of noise. Limit: it does not see a change of a block's brightness alone.

use nalgebra::SMatrix;

use super::block_sums::PerBlock;
use super::reference::{Comparison, Reference};
use crate::constants::{BLOCKS, BLOCKS_PER_SIDE};

mod model {
    #![allow(
        clippy::all,
        clippy::pedantic,
        missing_docs,
        reason = "microflow's macro wrote it, constants and all"
    )]
    include!(concat!(env!("OUT_DIR"), "/gate_model.rs"));
}

/// Quantisation steps of an input per unit of motion energy over noise. Noise alone has 2 units on average.
pub const STEPS_PER_UNIT: f32 = 4.0;
/// The quantised value of no motion; the highest is 63.75 units above.
pub const NO_MOTION: i8 = -128;

/// The network's input: for every block, row-major, its motion energy since rest and since the processed picture.
pub type GateInputs = [[i8; 2]; BLOCKS];

/// The gate, scaled to the noise of one sensor.
#[derive(Debug, Clone)]
pub(super) struct LearnedGate {
    /// Quantisation steps per motion energy, since rest and since the processed picture.
    steps: [f32; 2],
}

impl LearnedGate {
    /// From mean motion energies that are noise.
    pub(super) fn new(from_rest: f32, of_pairs: f32) -> Self {
        Self {
            steps: [from_rest, of_pairs].map(|mean| 2.0 * STEPS_PER_UNIT / mean),
        }
    }

    pub(super) fn inputs(&self, comparison: &Comparison) -> GateInputs {
        let mut inputs = [[0; 2]; BLOCKS];
        let references = [&comparison.rest, &comparison.processed];
        for (channel, reference) in references.into_iter().enumerate() {
            let motions = motions(&comparison.sums.products[channel], reference);
            for block in 0..BLOCKS {
                let step = (motions[block] * self.steps[channel] + 0.5).clamp(0.0, 255.0) as i32;
                inputs[block][channel] = (step + i32::from(NO_MOTION)) as i8;
            }
        }
        inputs
    }

    /// Whether something touches, and whether anything changed since the processed picture.
    pub(super) fn decide(&self, comparison: &Comparison) -> [bool; 2] {
        run(&self.inputs(comparison)).map(|output| output > 0.0)
    }
}

/// The network's outputs, "touched" and "changed": above 0 is yes.
pub(super) fn run(inputs: &GateInputs) -> [f32; 2] {
    let grid = SMatrix::<[i8; 2], BLOCKS_PER_SIDE, BLOCKS_PER_SIDE>::from_fn(|row, column| {
        inputs[row * BLOCKS_PER_SIDE + column]
    });
    let output = model::Model::predict_quantized([grid]);
    output[0][(0, 0)]
}

/// Motion energy of each block: the part of its change that the best translation explains (Lucas and Kanade 1981).
///
/// With d the picture less the reference times the best-fitting brightness factor, and b = Σ d·gradients, this is bᵀA⁻¹b,
/// A the structure tensor. Noise has the energy of two of the 64 pixels.
pub(super) fn motions(products: &[PerBlock<i32>; 3], reference: &Reference) -> PerBlock<f32> {
    let mut motions = [0.0; BLOCKS];
    let [image, gradient_x, gradient_y] = products;
    let ([projection_x, projection_y], [xx, xy, yy]) = (&reference.projection, &reference.inverse);
    for block in 0..BLOCKS {
        let x = gradient_x[block] as f32 - image[block] as f32 * projection_x[block];
        let y = gradient_y[block] as f32 - image[block] as f32 * projection_y[block];
        motions[block] = x * x * xx[block] + 2.0 * x * y * xy[block] + y * y * yy[block];
    }
    motions
}
