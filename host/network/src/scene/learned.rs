//! The learned gate: a small int8 network, run by microflow, looks at how far each block has moved against noise, since
//! rest and since the last processed picture. It is trained by `gripline-training gate`, which also shifts its outputs
//! so that 0 decides.
//! Units: energy over that of noise. Limits: what changes nothing but a block's brightness is not seen.

use nalgebra::SMatrix;

use super::{Coarse, Reference};
use crate::constants::{BLOCKS, BLOCKS_PER_SIDE};
use crate::kernel::PerBlock;

mod model {
    #![allow(
        clippy::all,
        clippy::pedantic,
        missing_docs,
        reason = "microflow's macro wrote it, constants and all"
    )]
    include!(concat!(env!("OUT_DIR"), "/gate_model.rs"));
}

/// Steps of an input per unit of motion energy over noise, of which noise alone has 2 on average.
pub const STEPS_PER_UNIT: f32 = 4.0;
/// The step that stands for no motion at all; the highest is 63.75 units above.
pub const NO_MOTION: i8 = -128;

/// What the network sees: for every block, row-major, the energy of its motion against rest and against the processed
/// picture.
pub type Inputs = [[i8; 2]; BLOCKS];

/// Noise of this sensor.
#[derive(Debug, Clone)]
pub(super) struct Learned {
    /// Steps per motion energy, against rest and processed.
    steps: [f32; 2],
}

impl Learned {
    /// From mean motion energies that are noise.
    pub(super) fn new(from_rest: f32, of_pairs: f32) -> Self {
        Self {
            steps: [from_rest, of_pairs].map(|mean| 2.0 * STEPS_PER_UNIT / mean),
        }
    }

    pub(super) fn inputs(&self, coarse: &Coarse) -> Inputs {
        let mut inputs = [[0; 2]; BLOCKS];
        let references = [&coarse.rest, &coarse.processed];
        for (channel, reference) in references.into_iter().enumerate() {
            let motions = motions(&coarse.sums.products[channel], reference);
            for block in 0..BLOCKS {
                let step = (motions[block] * self.steps[channel] + 0.5).clamp(0.0, 255.0) as i32;
                inputs[block][channel] = (step + i32::from(NO_MOTION)) as i8;
            }
        }
        inputs
    }

    /// Whether something touches, and whether anything changed since the processed picture.
    pub(super) fn decide(&self, coarse: &Coarse) -> [bool; 2] {
        run(&self.inputs(coarse)).map(|output| output > 0.0)
    }
}

/// The network's outputs, "touched" and "changed": above 0 is yes.
pub(super) fn run(inputs: &Inputs) -> [f32; 2] {
    let grid = SMatrix::<[i8; 2], BLOCKS_PER_SIDE, BLOCKS_PER_SIDE>::from_fn(|row, column| {
        inputs[row * BLOCKS_PER_SIDE + column]
    });
    let output = model::Model::predict_quantized([grid]);
    output[0][(0, 0)]
}

/// How much of each block's change is explained by a motion: with d the picture less the reference times the factor that
/// fits best (a change of brightness leaves nothing) and b = Σ d·slopes, this is bᵀA⁻¹b, A the slopes' products. It is the
/// energy that the best motion takes away (Lucas and Kanade 1981); of noise it takes two pixels' worth of 64.
pub(super) fn motions(products: &[PerBlock<i32>; 3], reference: &Reference) -> PerBlock<f32> {
    let mut motions = [0.0; BLOCKS];
    let [image, across, down] = products;
    let ([share_x, share_y], [xx, xy, yy]) = (&reference.share, &reference.inverse);
    for block in 0..BLOCKS {
        let x = across[block] as f32 - image[block] as f32 * share_x[block];
        let y = down[block] as f32 - image[block] as f32 * share_y[block];
        motions[block] = x * x * xx[block] + 2.0 * x * y * xy[block] + y * y * yy[block];
    }
    motions
}
