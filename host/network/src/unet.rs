//! The paper's encoder–decoder as a list of steps over preallocated activations: two strided convolutions
//! (88→44→22), an unpadded one (→20), poolings to 10 and 5, up-convolutions back to 10 and 20, each
//! concatenated with the encoder's activation of the same size. Batch norm is folded in at load.
//!
//! Units inside are the network's own; [`Scaling`](crate::weights::Scaling) maps them to grey levels and
//! newtons. What depends on the rest image alone is computed once per rest image.

use std::collections::BTreeMap;

use crate::ForceMap;
use crate::constants::{IMAGE_SIDE, MAP_SIDE, NORM_EPSILON};
use crate::image::Image88;
use crate::instruction_set::InstructionSet;
use crate::kernel::{Convolution, Kernel, LANES_MAX, Plan, PlaneId, Region, Shape, Sixteen};
use crate::weights::{Scaling, Tensor, Weights, Widths};

/// Last part of the name of a batch norm's running variance.
pub(crate) const VARIANCE: &str = "norm.variance";

/// Components of a force.
const COMPONENTS: usize = 3;

/// What a layer does to the size of its image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayerKind {
    /// 3×3 convolution.
    Convolution {
        /// Pixels between taps' centres of neighbouring outputs.
        stride: usize,
        /// Zeros around the input: 0 or 1.
        padding: usize,
    },
    /// Transposed 3×3 convolution that doubles the size: stride 2, padding 1, output padding 1.
    Doubling,
}

/// One layer with weights. Batch norm and ReLU follow every one but the last, which has a bias instead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layer {
    /// Name in the weights file.
    pub name: &'static str,
    /// What it does.
    pub kind: LayerKind,
    /// Channels it reads.
    pub in_channels: usize,
    /// Channels it writes.
    pub out_channels: usize,
}

/// The name of the layer without batch norm and ReLU.
pub const OUTPUT: &str = "output";

/// The layers in the order in which they run. Concatenations put the decoder's channels first.
#[must_use]
pub fn layers(widths: Widths) -> [Layer; 15] {
    const PLAIN: LayerKind = LayerKind::Convolution {
        stride: 1,
        padding: 1,
    };
    const STRIDED: LayerKind = LayerKind::Convolution {
        stride: 2,
        padding: 1,
    };
    const UNPADDED: LayerKind = LayerKind::Convolution {
        stride: 1,
        padding: 0,
    };
    let Widths {
        encode44,
        encode22,
        encode20,
        middle10,
        bottom5,
        decode20,
    } = widths;
    let layer = |name, kind, in_channels, out_channels| Layer {
        name,
        kind,
        in_channels,
        out_channels,
    };
    [
        layer("encode44", STRIDED, 2, encode44),
        layer("encode22", STRIDED, encode44, encode22),
        layer("encode20a", UNPADDED, encode22, encode20),
        layer("encode20b", PLAIN, encode20, encode20),
        layer("encode10a", PLAIN, encode20, middle10),
        layer("encode10b", PLAIN, middle10, middle10),
        layer("bottom5a", PLAIN, middle10, bottom5),
        layer("bottom5b", PLAIN, bottom5, bottom5),
        layer("up10", LayerKind::Doubling, bottom5, middle10),
        layer("decode10a", PLAIN, 2 * middle10, middle10),
        layer("decode10b", PLAIN, middle10, middle10),
        layer("up20", LayerKind::Doubling, middle10, decode20),
        layer("decode20a", PLAIN, decode20 + encode20, decode20),
        layer("decode20b", PLAIN, decode20, decode20),
        layer(OUTPUT, PLAIN, decode20, COMPONENTS),
    ]
}

/// Name and shape of every tensor of a weights file.
///
/// A layer has `NAME.weight`, `[out, in, 3, 3]` (doubling layers: `[in, out, 3, 3]`), and either `NAME.bias`
/// or `NAME.norm.{gamma, beta, mean, variance}`, `[out]`.
#[must_use]
pub fn tensors(widths: Widths) -> Vec<(String, Vec<usize>)> {
    tensors_of(&layers(widths))
}

/// Name and shape of every tensor of these layers.
pub(crate) fn tensors_of(layers: &[Layer]) -> Vec<(String, Vec<usize>)> {
    let mut tensors = Vec::new();
    for &Layer {
        name,
        kind,
        in_channels,
        out_channels,
    } in layers
    {
        let channels = match kind {
            LayerKind::Convolution { .. } => [out_channels, in_channels],
            LayerKind::Doubling => [in_channels, out_channels],
        };
        tensors.push((
            format!("{name}.weight"),
            [channels[0], channels[1], 3, 3].to_vec(),
        ));
        let vectors: &[&str] = if name == OUTPUT {
            &["bias"]
        } else {
            &["norm.gamma", "norm.beta", "norm.mean", VARIANCE]
        };
        tensors.extend(
            vectors
                .iter()
                .map(|vector| (format!("{name}.{vector}"), vec![out_channels])),
        );
    }
    tensors
}

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
    pub(crate) fn new(weights: &Weights, instructions: InstructionSet) -> Self {
        let Widths {
            encode44,
            encode20,
            middle10,
            decode20,
            ..
        } = weights.widths;
        let mut folded = folded(weights);
        let first = folded.next().expect("the network has layers");
        let [difference_part, rest_part] = first.per_channel(instructions);

        let mut plan = Plan::default();
        let rest = plan.plane(IMAGE_SIDE, IMAGE_SIDE, 1);
        // What the rest image alone puts into the first layer; recomputed only when that image changes.
        let rest_map = plan.plane(44, 44, encode44.next_multiple_of(LANES_MAX));
        let difference = plan.plane(IMAGE_SIDE, IMAGE_SIDE, 1);
        let at44 = plan.plane(44, 44, encode44);
        plan.convolve(rest_part, rest, rest_map, 0);
        plan.convolve_onto(difference_part, rest_map, difference, at44);

        // Joined planes hold the decoder's channels, then the encoder's.
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

    /// Takes a new rest image; the next frame pays for what it alone decides.
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
        self.plan.touch(self.rest, &Region::whole(IMAGE_SIDE, IMAGE_SIDE));
    }

    /// Forces in newtons for the image now, given the rest image that [`Self::set_rest`] took. Only `changed`
    /// of the image is looked at: the rest of it has to be as it was in the last call.
    pub(crate) fn infer(&mut self, rest: &Image88, now: &Image88, changed: &Region, out: &mut ForceMap) {
        let scale = self.scaling.difference_per_level;
        let difference = self.plan.values_mut(self.difference);
        for row in changed.rows.clone() {
            let columns = row * IMAGE_SIDE + changed.columns.start..row * IMAGE_SIDE + changed.columns.end;
            let values = &mut difference.row_mut(row)[changed.columns.clone()];
            for ((value, &now), &rest) in values.iter_mut().zip(&now[columns.clone()]).zip(&rest[columns]) {
                *value = f32::from(i16::from(now) - i16::from(rest)) * scale;
            }
        }
        self.plan.touch(self.difference, changed);
        self.plan.run();

        let output = self.plan.values(self.output);
        let newtons = self.scaling.newtons_per_output;
        for (row, taxels) in out.chunks_exact_mut(MAP_SIDE).enumerate() {
            for (taxel, forces) in taxels.iter_mut().zip(output.row(row).as_chunks::<COMPONENTS>().0) {
                *taxel = forces.map(|force| force * newtons);
            }
        }
    }

    /// Multiply-adds of a frame.
    pub(crate) fn multiply_adds(&self) -> usize {
        self.plan.multiply_adds(self.difference)
    }
}

/// A layer with batch norm folded into its weights and bias (in f64, once).
#[derive(Debug, Clone)]
pub struct Folded {
    /// The layer.
    pub layer: Layer,
    /// `[out, in, 3, 3]`; doubling layers: `[in, out, 3, 3]`.
    pub weights: Vec<f32>,
    /// `[out]`.
    pub bias: Vec<f32>,
}

/// The layers in the order in which they run, folded. `weights` has to have passed [`Weights::check`].
pub fn folded(weights: &Weights) -> impl Iterator<Item = Folded> {
    layers(weights.widths)
        .into_iter()
        .map(|layer| Folded::new(layer, &weights.tensors))
}

impl Folded {
    pub(crate) fn new(layer: Layer, tensors: &BTreeMap<String, Tensor>) -> Self {
        let part = |part: &str| &tensors[&format!("{}.{part}", layer.name)].values;
        let weights = part("weight");
        if layer.name == OUTPUT {
            return Self {
                layer,
                weights: weights.clone(),
                bias: part("bias").clone(),
            };
        }
        let (gamma, beta, mean, variance) = (
            part("norm.gamma"),
            part("norm.beta"),
            part("norm.mean"),
            part(VARIANCE),
        );
        let factor: Vec<f64> = gamma
            .iter()
            .zip(variance)
            .map(|(&gamma, &variance)| f64::from(gamma) / (f64::from(variance) + NORM_EPSILON).sqrt())
            .collect();
        let out_channel = |index: usize| match layer.kind {
            LayerKind::Convolution { .. } => index / (9 * layer.in_channels),
            LayerKind::Doubling => index / 9 % layer.out_channels,
        };
        let weights = weights
            .iter()
            .enumerate()
            .map(|(index, &weight)| (f64::from(weight) * factor[out_channel(index)]) as f32)
            .collect();
        let bias = (0..layer.out_channels)
            .map(|out| (f64::from(beta[out]) - f64::from(mean[out]) * factor[out]) as f32)
            .collect();
        Self { layer, weights, bias }
    }

    fn shape(&self, stride: usize, padding: usize) -> Shape {
        Shape {
            out_channels: self.layer.out_channels,
            in_channels: self.layer.in_channels,
            kernel: Kernel {
                size: 3,
                stride,
                padding,
            },
        }
    }

    pub(crate) fn pack(&self, instructions: InstructionSet) -> Convolution {
        let Layer {
            name,
            kind,
            in_channels,
            out_channels,
        } = self.layer;
        match kind {
            LayerKind::Convolution { stride, padding } => {
                let shape = self.shape(stride, padding);
                Convolution::forward(instructions, shape, &self.weights, &self.bias, name != OUTPUT)
            }
            LayerKind::Doubling => {
                Convolution::doubling(instructions, in_channels, out_channels, &self.weights, &self.bias)
            }
        }
    }

    /// The layer in 16 bits, for inputs of this height and width; it has to end in ReLU.
    pub(crate) fn sixteen(&self, instructions: InstructionSet, size: (usize, usize)) -> Sixteen {
        let Layer {
            kind,
            in_channels,
            out_channels,
            ..
        } = self.layer;
        let (weights, bias) = (&self.weights, &self.bias);
        match kind {
            LayerKind::Convolution { stride, padding } => {
                Sixteen::forward(instructions, self.shape(stride, padding), size, weights, bias)
            }
            LayerKind::Doubling => {
                let channels = [out_channels, in_channels];
                Sixteen::doubling(instructions, channels, size, weights, bias)
            }
        }
    }

    /// The first layer, cut into one convolution per input channel: the difference image's, which ends in
    /// ReLU, and the rest image's, which has the bias. Their sum is the layer.
    fn per_channel(&self, instructions: InstructionSet) -> [Convolution; 2] {
        let Layer {
            in_channels,
            out_channels,
            ..
        } = self.layer;
        let one = |channel: usize, bias: &[f32], relu: bool| {
            let weights: Vec<f32> = self
                .weights
                .chunks_exact(9)
                .skip(channel)
                .step_by(in_channels)
                .flatten()
                .copied()
                .collect();
            let shape = Shape {
                out_channels,
                in_channels: 1,
                kernel: Kernel {
                    size: 3,
                    stride: 2,
                    padding: 1,
                },
            };
            Convolution::forward(instructions, shape, &weights, bias, relu)
        };
        [one(0, &vec![0.0; out_channels], true), one(1, &self.bias, false)]
    }
}
