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
use crate::kernel::{BLOCK, Convolution, Kernel, Lanes, Plane, Shape, portable};
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
    let mut tensors = Vec::new();
    for Layer {
        name,
        kind,
        in_channels,
        out_channels,
    } in layers(widths)
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

/// Activations, in the order in which they are filled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
enum At {
    Difference,
    Encode44,
    Encode22,
    Encode20a,
    /// Decoder's channels, then the encoder's.
    Joined20,
    Pooled10,
    Encode10a,
    /// Decoder's channels, then the encoder's.
    Joined10,
    Pooled5,
    Bottom5a,
    Bottom5b,
    Decode10a,
    Decode10b,
    Decode20a,
    Decode20b,
    Output,
}

#[derive(Debug, Clone)]
enum Step {
    Convolve {
        convolution: Convolution,
        from: At,
        to: At,
        channel: usize,
    },
    Pool {
        from: At,
        channel: usize,
        to: At,
    },
}

/// The network with its buffers.
#[derive(Debug, Clone)]
pub(crate) struct UNet {
    scaling: Scaling,
    /// The part of the first layer that sees the rest image; its bias is the first layer's.
    rest_part: Convolution,
    /// The part of the first layer that sees the difference image.
    difference_part: Convolution,
    /// What the rest image puts into each output of the first layer.
    rest_map: Vec<Lanes>,
    steps: Vec<Step>,
    planes: Vec<Plane>,
}

impl UNet {
    /// Builds the network. `weights` has been checked, so every tensor is there with its shape.
    pub(crate) fn new(weights: &Weights) -> Self {
        let Widths {
            encode44,
            encode22,
            encode20,
            middle10,
            bottom5,
            decode20,
        } = weights.widths;
        let plane = |side, channels| Plane::new(side, side, channels);
        // In the order of `At`.
        let planes = vec![
            plane(88, 1),
            plane(44, encode44),
            plane(22, encode22),
            plane(20, encode20),
            plane(20, decode20 + encode20),
            plane(10, encode20),
            plane(10, middle10),
            plane(10, 2 * middle10),
            plane(5, middle10),
            plane(5, bottom5),
            plane(5, bottom5),
            plane(10, middle10),
            plane(10, middle10),
            plane(20, decode20),
            plane(20, decode20),
            plane(20, BLOCK),
        ];

        let mut folded = layers(weights.widths)
            .into_iter()
            .map(|layer| Folded::new(layer, &weights.tensors));
        let first = folded.next().expect("the network has layers");
        let [difference_part, rest_part] = first.per_channel();

        let mut steps = Vec::new();
        let mut convolve = |from, to, channel| {
            let convolution = folded.next().expect("one layer per convolution").pack();
            Step::Convolve {
                convolution,
                from,
                to,
                channel,
            }
        };
        steps.push(convolve(At::Encode44, At::Encode22, 0));
        steps.push(convolve(At::Encode22, At::Encode20a, 0));
        steps.push(convolve(At::Encode20a, At::Joined20, decode20));
        steps.push(Step::Pool {
            from: At::Joined20,
            channel: decode20,
            to: At::Pooled10,
        });
        steps.push(convolve(At::Pooled10, At::Encode10a, 0));
        steps.push(convolve(At::Encode10a, At::Joined10, middle10));
        steps.push(Step::Pool {
            from: At::Joined10,
            channel: middle10,
            to: At::Pooled5,
        });
        steps.push(convolve(At::Pooled5, At::Bottom5a, 0));
        steps.push(convolve(At::Bottom5a, At::Bottom5b, 0));
        steps.push(convolve(At::Bottom5b, At::Joined10, 0));
        steps.push(convolve(At::Joined10, At::Decode10a, 0));
        steps.push(convolve(At::Decode10a, At::Decode10b, 0));
        steps.push(convolve(At::Decode10b, At::Joined20, 0));
        steps.push(convolve(At::Joined20, At::Decode20a, 0));
        steps.push(convolve(At::Decode20a, At::Decode20b, 0));
        steps.push(convolve(At::Decode20b, At::Output, 0));

        Self {
            scaling: weights.scaling,
            rest_part,
            difference_part,
            rest_map: vec![[0.0; BLOCK]; 44 * 44 * encode44 / BLOCK],
            steps,
            planes,
        }
    }

    /// Takes a new rest image: the part of the first layer that it alone decides is computed here.
    pub(crate) fn set_rest(&mut self, rest: &Image88) {
        let Scaling {
            rest_level,
            rest_per_level,
            ..
        } = self.scaling;
        let mut input = Plane::new(IMAGE_SIDE, IMAGE_SIDE, 1);
        for (row, pixels) in rest.chunks_exact(IMAGE_SIDE).enumerate() {
            for (value, &pixel) in input.row_mut(row).iter_mut().zip(pixels) {
                *value = (f32::from(pixel) - rest_level) * rest_per_level;
            }
        }
        let mut output = self.planes[At::Encode44 as usize].clone();
        portable::convolve(&self.rest_part, &input, &mut output, 0);
        let rows = (0..output.height()).flat_map(|row| output.row(row).as_chunks::<BLOCK>().0);
        for (entry, lanes) in self.rest_map.iter_mut().zip(rows) {
            *entry = *lanes;
        }
    }

    /// Forces in newtons for the image now, given the rest image that [`Self::set_rest`] took.
    pub(crate) fn infer(&mut self, rest: &Image88, now: &Image88, out: &mut ForceMap) {
        let scale = self.scaling.difference_per_level;
        let difference = &mut self.planes[At::Difference as usize];
        let pairs = now.chunks_exact(IMAGE_SIDE).zip(rest.chunks_exact(IMAGE_SIDE));
        for (row, (now, rest)) in pairs.enumerate() {
            for ((value, &now), &rest) in difference.row_mut(row).iter_mut().zip(now).zip(rest) {
                *value = f32::from(i16::from(now) - i16::from(rest)) * scale;
            }
        }

        let [from, to] = pair(&mut self.planes, At::Difference, At::Encode44);
        portable::convolve_with_bias_map(&self.difference_part, &self.rest_map, from, to);
        for step in &self.steps {
            match *step {
                Step::Convolve {
                    ref convolution,
                    from,
                    to,
                    channel,
                } => {
                    let [from, to] = pair(&mut self.planes, from, to);
                    portable::convolve(convolution, from, to, channel);
                }
                Step::Pool { from, channel, to } => {
                    let [from, to] = pair(&mut self.planes, from, to);
                    portable::max_pool(from, channel, to);
                }
            }
        }

        let output = &self.planes[At::Output as usize];
        let newtons = self.scaling.newtons_per_output;
        for (row, taxels) in out.chunks_exact_mut(MAP_SIDE).enumerate() {
            for (taxel, lanes) in taxels.iter_mut().zip(output.row(row).as_chunks::<BLOCK>().0) {
                *taxel = std::array::from_fn(|component| lanes[component] * newtons);
            }
        }
    }
}

fn pair(planes: &mut [Plane], from: At, to: At) -> [&mut Plane; 2] {
    planes
        .get_disjoint_mut([from as usize, to as usize])
        .expect("no step reads what it writes")
}

/// A layer's weights and bias with batch norm folded in (in f64, once).
struct Folded {
    layer: Layer,
    weights: Vec<f32>,
    bias: Vec<f32>,
}

impl Folded {
    fn new(layer: Layer, tensors: &BTreeMap<String, Tensor>) -> Self {
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

    fn pack(&self) -> Convolution {
        let Layer {
            name,
            kind,
            in_channels,
            out_channels,
        } = self.layer;
        match kind {
            LayerKind::Convolution { stride, padding } => {
                let kernel = Kernel {
                    size: 3,
                    stride,
                    padding,
                };
                let shape = Shape {
                    out_channels,
                    in_channels,
                    kernel,
                };
                Convolution::forward(shape, &self.weights, &self.bias, name != OUTPUT)
            }
            LayerKind::Doubling => {
                Convolution::doubling(in_channels, out_channels, &self.weights, &self.bias)
            }
        }
    }

    /// The first layer, cut into one convolution per input channel: the difference image's, which ends in
    /// ReLU, and the rest image's, which has the bias. Their sum is the layer.
    fn per_channel(&self) -> [Convolution; 2] {
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
            Convolution::forward(shape, &weights, bias, relu)
        };
        [one(0, &vec![0.0; out_channels], true), one(1, &self.bias, false)]
    }
}
