//! Layers that compute the same in the eight mirrors of the square: what they see moves, and what they compute moves with it. The
//! contact world is the same in these mirrors, so a network of such layers need not learn one contact eight times over. Weights
//! that a symmetry moves onto each other are equal (but for a shear's sign), so a layer has an eighth of the free weights. In the
//! weights file and in the engine they are those of an ordinary convolution.
//!
//! Source: Cohen and Welling, "Group Equivariant Convolutional Networks", 2016.

use burn::module::{Module, Param, RunningState};
use burn::nn::{BatchNorm, BatchNormConfig, Initializer};
use burn::tensor::activation::relu;
use burn::tensor::module::{conv_transpose2d, conv2d};
use burn::tensor::ops::{ConvOptions, ConvTransposeOptions};
use burn::tensor::{Device, Int, Tensor, TensorData};
use gripline_network::constants::NORM_EPSILON;
use gripline_network::{self as engine, Layer, LayerKind};

use crate::symmetry::Symmetry;
use crate::weights::Tensors;

/// How channels move with the square.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Field {
    /// One channel that stays as it is.
    Scalar,
    /// Two channels that turn as x and y of a force do.
    Vector,
    /// Eight channels, one for each symmetry, which change places.
    Regular,
}

impl Field {
    fn channels(self) -> usize {
        match self {
            Self::Scalar => 1,
            Self::Vector => 2,
            Self::Regular => Symmetry::ALL.len(),
        }
    }

    /// The fields of a layer's hidden channels.
    pub(crate) fn regular(channels: usize) -> Vec<Self> {
        vec![Self::Regular; channels / Self::Regular.channels()]
    }

    /// Where `symmetry` moves a channel, and the sign that it gets.
    fn moved(self, symmetry: Symmetry, channel: usize) -> (usize, f32) {
        match self {
            Self::Scalar => (channel, 1.0),
            Self::Vector => {
                let mut unit = [0.0; 3];
                unit[channel] = 1.0;
                let [x, y, _] = symmetry.force(unit);
                if x == 0.0 { (1, y) } else { (0, x) }
            }
            Self::Regular => (symmetry.after(channel), 1.0),
        }
    }
}

/// Where `symmetry` moves each channel of these fields, and the sign that it gets.
fn moved_channels(fields: &[Field], symmetry: Symmetry) -> Vec<(usize, f32)> {
    let mut moved = Vec::new();
    for field in fields {
        let first = moved.len();
        moved.extend((0..field.channels()).map(|channel| {
            let (to, sign) = field.moved(symmetry, channel);
            (first + to, sign)
        }));
    }
    moved
}

/// The weights of a layer that are equal, but for their signs.
#[derive(Debug, Clone)]
struct Orbits {
    /// Of every symmetry and every weight: the weight that it is moved to.
    moved_to: Vec<i32>,
    /// And the sign that it has there.
    signs: Vec<f32>,
    shape: [usize; 4],
}

impl Orbits {
    fn new(layer: Layer, input: &[Field], output: &[Field]) -> Self {
        let size = layer.kind.size();
        let centre = (size - 1) as f32 / 2.0;
        let is_transposed = matches!(layer.kind, LayerKind::Transposed { .. });
        let [first, second] = if is_transposed {
            [input, output]
        } else {
            [output, input]
        };
        let (mut moved_to, mut signs) = (Vec::new(), Vec::new());
        for symmetry in Symmetry::ALL {
            let [first, second] = [first, second].map(|fields| moved_channels(fields, symmetry));
            for &(a, sign_a) in &first {
                for &(b, sign_b) in &second {
                    for tap in 0..size * size {
                        let [row, column] = [tap / size, tap % size].map(|k| k as f32 - centre);
                        let [column, row, _] = symmetry.force([column, row, 0.0]);
                        let [row, column] = [row, column].map(|k| (k + centre).round() as usize);
                        moved_to.push((((a * second.len() + b) * size + row) * size + column) as i32);
                        signs.push(sign_a * sign_b);
                    }
                }
            }
        }
        let channels = |fields: &[Field]| fields.iter().map(|field| field.channels()).sum();
        Self {
            moved_to,
            signs,
            shape: [channels(first), channels(second), size, size],
        }
    }

    /// The mean of what the symmetries make of these weights: the nearest ones that all symmetries leave as they are.
    fn mean(&self, free: Tensor<4>) -> Tensor<4> {
        let device = free.device();
        let count: usize = self.shape.iter().product();
        let symmetries = Symmetry::ALL.len();
        let moved_to = TensorData::new(self.moved_to.clone(), [symmetries * count]);
        let signs = TensorData::new(self.signs.clone(), [symmetries * count]);
        let moved = free
            .reshape([count])
            .select(0, Tensor::<1, Int>::from_data(moved_to, &device));
        (moved * Tensor::<1>::from_data(signs, &device))
            .reshape([symmetries, count])
            .mean_dim(0)
            .reshape(self.shape)
    }
}

/// Weights of which those are equal that a symmetry moves onto each other.
#[derive(Module, Debug)]
struct MirroredWeights {
    /// Their mean over the symmetries is what counts.
    free: Param<Tensor<4>>,
    #[module(skip)]
    orbits: Orbits,
}

impl MirroredWeights {
    fn new(layer: Layer, input: &[Field], output: &[Field], device: &Device) -> Self {
        let orbits = Orbits::new(layer, input, output);
        let [_, _, height, width] = orbits.shape;
        // The usual bound; the mean of eight weights is smaller by the root of eight.
        let bound = (8.0 / (layer.in_channels * height * width) as f64).sqrt();
        let initial = Initializer::Uniform {
            min: -bound,
            max: bound,
        };
        Self {
            free: initial.init(orbits.shape, device),
            orbits,
        }
    }

    fn values(&self) -> Tensor<4> {
        self.orbits.mean(self.free.val())
    }
}

/// A convolution, batch norm and ReLU.
#[derive(Module, Debug)]
pub(crate) struct MirroredStage {
    weights: MirroredWeights,
    /// Over a field's channels together.
    norm: BatchNorm,
    #[module(skip)]
    layer: Layer,
}

impl MirroredStage {
    /// To regular fields.
    pub(crate) fn new(layer: Layer, input: &[Field], device: &Device) -> Self {
        let output = Field::regular(layer.out_channels);
        Self {
            weights: MirroredWeights::new(layer, input, &output, device),
            norm: BatchNormConfig::new(output.len())
                .with_epsilon(NORM_EPSILON)
                .init(device),
            layer,
        }
    }

    pub(crate) fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        let sums = convolved(self.layer, input, self.weights.values(), None);
        let [batch, channels, height, width] = sums.dims();
        let fields = self.norm.gamma.dims()[0];
        let joined = sums.reshape([batch, fields, channels / fields * height, width]);
        relu(self.norm.forward(joined)).reshape([batch, channels, height, width])
    }

    /// Adds the tensors of an ordinary convolution with batch norm.
    pub(crate) fn export(&self, tensors: &mut Tensors) {
        let mut put = |part: &str, data: TensorData, repeat: usize| {
            let values = values_of(&data).into_iter();
            let values: Vec<f32> = values
                .flat_map(|value| std::iter::repeat_n(value, repeat))
                .collect();
            let shape = if part == "weight" {
                self.weights.orbits.shape.to_vec()
            } else {
                vec![values.len()]
            };
            tensors.insert(
                format!("{}.{part}", self.layer.name),
                engine::Tensor { shape, values },
            );
        };
        let channels = Field::Regular.channels();
        put("weight", self.weights.values().into_data(), 1);
        put("norm.gamma", self.norm.gamma.val().into_data(), channels);
        put("norm.beta", self.norm.beta.val().into_data(), channels);
        put(
            "norm.mean",
            self.norm.running_mean.value_sync().into_data(),
            channels,
        );
        put(
            "norm.variance",
            self.norm.running_var.value_sync().into_data(),
            channels,
        );
    }

    /// Takes the tensors of an ordinary convolution; of weights that are not equal where they should be, the mean.
    pub(crate) fn import(&mut self, tensors: &Tensors, device: &Device) {
        let values = |part: &str| &tensors[&format!("{}.{part}", self.layer.name)].values;
        self.weights.free = Param::from_data(
            TensorData::new(values("weight").clone(), self.weights.orbits.shape),
            device,
        );
        let of_fields = |part: &str| {
            let fields = values(part).chunks_exact(Field::Regular.channels());
            let values: Vec<f32> = fields
                .map(|field| field.iter().sum::<f32>() / field.len() as f32)
                .collect();
            let count = values.len();
            TensorData::new(values, [count])
        };
        self.norm.gamma = Param::from_data(of_fields("norm.gamma"), device);
        self.norm.beta = Param::from_data(of_fields("norm.beta"), device);
        self.norm.running_mean = RunningState::new(Tensor::from_data(of_fields("norm.mean"), device));
        self.norm.running_var = RunningState::new(Tensor::from_data(of_fields("norm.variance"), device));
    }
}

/// The last layer, to a vector and a scalar: a convolution with a bias for the scalar alone, because no vector stays as it is in
/// every mirror.
#[derive(Module, Debug)]
pub(crate) struct MirroredOutput {
    weights: MirroredWeights,
    bias: Param<Tensor<1>>,
    #[module(skip)]
    layer: Layer,
}

impl MirroredOutput {
    pub(crate) fn new(layer: Layer, device: &Device) -> Self {
        let input = Field::regular(layer.in_channels);
        Self {
            weights: MirroredWeights::new(layer, &input, &[Field::Vector, Field::Scalar], device),
            bias: Initializer::Zeros.init([1], device),
            layer,
        }
    }

    pub(crate) fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        let shear = Tensor::zeros([2], &input.device());
        let bias = Tensor::cat(vec![shear, self.bias.val()], 0);
        convolved(self.layer, input, self.weights.values(), Some(bias))
    }

    /// Adds the tensors of an ordinary convolution with a bias.
    pub(crate) fn export(&self, tensors: &mut Tensors) {
        let weight = engine::Tensor {
            shape: self.weights.orbits.shape.to_vec(),
            values: values_of(&self.weights.values().into_data()),
        };
        let bias = engine::Tensor {
            shape: vec![3],
            values: vec![0.0, 0.0, values_of(&self.bias.val().into_data())[0]],
        };
        tensors.insert(format!("{}.weight", self.layer.name), weight);
        tensors.insert(format!("{}.bias", self.layer.name), bias);
    }

    /// Takes the tensors of an ordinary convolution.
    pub(crate) fn import(&mut self, tensors: &Tensors, device: &Device) {
        let values = |part: &str| &tensors[&format!("{}.{part}", self.layer.name)].values;
        let weights = TensorData::new(values("weight").clone(), self.weights.orbits.shape);
        self.weights.free = Param::from_data(weights, device);
        self.bias = Param::from_data(TensorData::new(vec![values("bias")[2]], [1]), device);
    }
}

fn convolved(layer: Layer, input: Tensor<4>, weights: Tensor<4>, bias: Option<Tensor<1>>) -> Tensor<4> {
    match layer.kind {
        LayerKind::Convolution(kernel) => {
            let (stride, padding) = ([kernel.stride; 2], [kernel.padding; 2]);
            conv2d(input, weights, bias, ConvOptions::new(stride, padding, [1, 1], 1))
        }
        LayerKind::Transposed { size } => {
            let added = [4 - size; 2];
            conv_transpose2d(
                input,
                weights,
                bias,
                ConvTransposeOptions::new([2, 2], [1, 1], added, [1, 1], 1),
            )
        }
    }
}

fn values_of(data: &TensorData) -> Vec<f32> {
    data.try_to_vec::<f32>().expect("weights are f32")
}
