//! The layers that networks consist of: names, shapes and tensors as in the weights files, and batch norm folded into the
//! weights as the kernels take them.

use std::collections::BTreeMap;

use gripline_kernels::{Convolution, InputSign, InstructionSet, Int16Convolution, Kernel, Shape};

use crate::constants::NORM_EPSILON;
use crate::weights::Tensor;

/// End of the tensor name of a batch norm's running variance.
pub(crate) const VARIANCE: &str = "norm.variance";

/// What a layer does to the size of its image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayerKind {
    /// Square convolution.
    Convolution(Kernel),
    /// Transposed convolution that doubles the size: stride 2, padding 1.
    Transposed {
        /// Taps along a side: 4, or 3 with an output padding of 1.
        size: usize,
    },
}

impl LayerKind {
    /// Taps along a side.
    #[must_use]
    pub fn size(self) -> usize {
        match self {
            Self::Convolution(kernel) => kernel.size,
            Self::Transposed { size } => size,
        }
    }
}

/// One layer with weights. Batch norm and ReLU follow every layer but the last, which has a bias instead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layer {
    /// Name in the weights file.
    pub name: &'static str,
    /// What it computes.
    pub kind: LayerKind,
    /// Channels it reads.
    pub in_channels: usize,
    /// Channels it writes.
    pub out_channels: usize,
}

/// The name of the last layer.
pub const OUTPUT: &str = "output";

/// Name and shape of every tensor of these layers.
///
/// A layer has `NAME.weight`, `[out, in, size, size]` (transposed layers: `[in, out, size, size]`), and either `NAME.bias` or
/// `NAME.norm.{gamma, beta, mean, variance}`, `[out]`.
pub(crate) fn tensors_of(layers: &[Layer]) -> Vec<(String, Vec<usize>)> {
    let mut tensors = Vec::new();
    for &Layer {
        name,
        kind,
        in_channels,
        out_channels,
    } in layers
    {
        let [first, second] = match kind {
            LayerKind::Convolution(_) => [out_channels, in_channels],
            LayerKind::Transposed { .. } => [in_channels, out_channels],
        };
        tensors.push((
            format!("{name}.weight"),
            vec![first, second, kind.size(), kind.size()],
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

/// A layer with batch norm folded into its weights and bias (in f64, once).
#[derive(Debug, Clone)]
pub struct Folded {
    /// The layer.
    pub layer: Layer,
    /// `[out, in, size, size]`; transposed layers: `[in, out, size, size]`.
    pub weights: Vec<f32>,
    /// `[out]`.
    pub bias: Vec<f32>,
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
        let taps = layer.kind.size() * layer.kind.size();
        let out_channel = |index: usize| match layer.kind {
            LayerKind::Convolution(_) => index / (taps * layer.in_channels),
            LayerKind::Transposed { .. } => index / taps % layer.out_channels,
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

    pub(crate) fn shape(&self, kernel: Kernel) -> Shape {
        Shape {
            out_channels: self.layer.out_channels,
            in_channels: self.layer.in_channels,
            kernel,
        }
    }

    /// The layer with its weights packed for an instruction set.
    pub(crate) fn pack(&self, instructions: InstructionSet) -> Convolution {
        let Layer {
            name,
            kind,
            in_channels,
            out_channels,
        } = self.layer;
        match kind {
            LayerKind::Convolution(kernel) => {
                let shape = self.shape(kernel);
                Convolution::forward(instructions, shape, &self.weights, &self.bias, name != OUTPUT)
            }
            LayerKind::Transposed { .. } => {
                Convolution::transposed(instructions, in_channels, out_channels, &self.weights, &self.bias)
            }
        }
    }

    /// The same in int16, for inputs of this height and width, and these signs. The layer has to end in ReLU.
    pub(crate) fn pack_int16(
        &self,
        instructions: InstructionSet,
        size: (usize, usize),
        sign: InputSign,
    ) -> Int16Convolution {
        let Layer {
            kind,
            in_channels,
            out_channels,
            ..
        } = self.layer;
        let (weights, bias) = (&self.weights, &self.bias);
        match kind {
            LayerKind::Convolution(kernel) => {
                Int16Convolution::forward(instructions, self.shape(kernel), size, sign, weights, bias)
            }
            LayerKind::Transposed { .. } => {
                let channels = [out_channels, in_channels];
                Int16Convolution::transposed(instructions, channels, size, sign, weights, bias)
            }
        }
    }
}
