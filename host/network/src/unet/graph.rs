//! The paper's encoder–decoder as a list of steps over preallocated activations: two strided convolutions (88→44→22), an
//! unpadded one (→20), poolings to 10 and 5, transposed convolutions back to 10 and 20, each concatenated with the
//! encoder's activation of the same size.
//!
//! [`Scaling`] maps grey levels to the network's units and its outputs to newtons. What depends on the rest image alone is
//! computed once per rest image.

use gripline_kernels::simd::LANES_MAX;
use gripline_kernels::{Convolution, InstructionSet, Plan, PlaneId, Region, Shape};

use super::weights::{Scaling, UnetWeights, Widths};
use crate::constants::{IMAGE_SIDE, MAP_SIDE};
use crate::force_map::ForceMap;
use crate::image::Image88;
use crate::layer::{Folded, Layer, LayerKind};

/// The network with its buffers.
#[derive(Debug, Clone)]
pub(crate) struct UNet {
    scaling: Scaling,
    plan: Plan,
    rest: PlaneId,
    difference: PlaneId,
    output: PlaneId,
}

impl UNet {
    /// Builds the network. `weights` has been checked, so every tensor is there with its shape.
    pub(crate) fn new(weights: &UnetWeights, instructions: InstructionSet) -> Self {
        let Widths {
            encode44,
            encode20,
            middle10,
            decode20,
            ..
        } = weights.widths;
        let mut folded = weights.folded();
        let first = folded.next().expect("the network has layers");
        let [difference_part, rest_part] = per_channel(&first, instructions);

        let mut plan = Plan::default();
        let rest = plan.plane(IMAGE_SIDE, IMAGE_SIDE, 1);
        // The rest image's part of the first layer; recomputed only when that image changes.
        let rest_map = plan.plane(44, 44, encode44.next_multiple_of(LANES_MAX));
        let difference = plan.plane(IMAGE_SIDE, IMAGE_SIDE, 1);
        let at44 = plan.plane(44, 44, encode44);
        plan.convolve(rest_part, rest, rest_map, 0);
        plan.convolve_onto(difference_part, rest_map, difference, at44);

        // Concatenations: the decoder's channels, then the encoder's.
        let joined20 = plan.plane(20, 20, decode20 + encode20);
        let joined10 = plan.plane(10, 10, 2 * middle10);
        let mut next = || {
            let layer = folded.next().expect("one layer per convolution");
            layer.pack(instructions)
        };
        let at22 = plan.convolved(next(), at44);
        let at20 = plan.convolved(next(), at22);
        plan.convolve(next(), at20, joined20, decode20);
        let pooled10 = plan.pooled(joined20, decode20, encode20);
        let at10 = plan.convolved(next(), pooled10);
        plan.convolve(next(), at10, joined10, middle10);
        let pooled5 = plan.pooled(joined10, middle10, middle10);
        let at5 = plan.convolved(next(), pooled5);
        let at5 = plan.convolved(next(), at5);
        plan.convolve(next(), at5, joined10, 0);
        let at10 = plan.convolved(next(), joined10);
        let at10 = plan.convolved(next(), at10);
        plan.convolve(next(), at10, joined20, 0);
        let at20 = plan.convolved(next(), joined20);
        let at20 = plan.convolved(next(), at20);
        let output = plan.convolved(next(), at20);

        Self {
            scaling: weights.scaling,
            plan,
            rest,
            difference,
            output,
        }
    }

    /// Sets the rest image; the next frame recomputes what depends on it.
    pub(crate) fn set_rest(&mut self, rest: &Image88) {
        let Scaling {
            rest_level,
            rest_per_level,
            ..
        } = self.scaling;
        let input = self.plan.values_mut(self.rest);
        for (row, pixels) in rest.chunks_exact(IMAGE_SIDE).enumerate() {
            for (value, &pixel) in input.row_mut(row).iter_mut().zip(pixels) {
                *value = (f32::from(pixel) - rest_level) * rest_per_level;
            }
        }
        self.plan
            .mark_dirty(self.rest, &Region::whole(IMAGE_SIDE, IMAGE_SIDE));
    }

    /// Forces in newtons for the image `now`, given the rest image of [`Self::set_rest`]. Reads only the `dirty` region: the
    /// rest of the image has to be as in the last call.
    pub(crate) fn infer(&mut self, rest: &Image88, now: &Image88, dirty: &Region, out: &mut ForceMap) {
        let scale = self.scaling.difference_per_level;
        let difference = self.plan.values_mut(self.difference);
        for row in dirty.rows.clone() {
            let columns = row * IMAGE_SIDE + dirty.columns.start..row * IMAGE_SIDE + dirty.columns.end;
            let values = &mut difference.row_mut(row)[dirty.columns.clone()];
            for ((value, &now), &rest) in values.iter_mut().zip(&now[columns.clone()]).zip(&rest[columns]) {
                *value = f32::from(i16::from(now) - i16::from(rest)) * scale;
            }
        }
        self.plan.mark_dirty(self.difference, dirty);
        self.plan.run();

        let output = self.plan.values(self.output);
        let newtons = self.scaling.newtons_per_output;
        for (row, taxels) in out.chunks_exact_mut(MAP_SIDE).enumerate() {
            for (taxel, forces) in taxels.iter_mut().zip(output.row(row).as_chunks::<3>().0) {
                *taxel = forces.map(|force| force * newtons);
            }
        }
    }

    /// Multiply-adds of a frame.
    pub(crate) fn multiply_adds(&self) -> usize {
        self.plan.multiply_adds(self.difference)
    }
}

/// Cuts the first layer into one convolution per input channel: the difference image's, which ends in ReLU, and the rest
/// image's, which has the bias. Their sum is the layer.
fn per_channel(first: &Folded, instructions: InstructionSet) -> [Convolution; 2] {
    let Layer {
        kind,
        in_channels,
        out_channels,
        ..
    } = first.layer;
    let LayerKind::Convolution(kernel) = kind else {
        unreachable!("the first layer halves the image")
    };
    let one = |channel: usize, bias: &[f32], relu: bool| {
        let weights: Vec<f32> = first
            .weights
            .chunks_exact(kernel.size * kernel.size)
            .skip(channel)
            .step_by(in_channels)
            .flatten()
            .copied()
            .collect();
        let shape = Shape {
            in_channels: 1,
            ..first.shape(kernel)
        };
        Convolution::forward(instructions, shape, &weights, bias, relu)
    };
    [one(0, &vec![0.0; out_channels], true), one(1, &first.bias, false)]
}
