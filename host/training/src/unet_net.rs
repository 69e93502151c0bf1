//! The encoder–decoder on two images in the training framework. In the network's units: `[batch, 2, 88, 88]` to
//! `[batch, 3, 20, 20]`.

use burn::module::{Module, Param, RunningState};
use burn::nn::conv::{Conv2d, Conv2dConfig, ConvTranspose2d, ConvTranspose2dConfig};
use burn::nn::pool::{MaxPool2d, MaxPool2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig, PaddingConfig2d};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use gripline_network::constants::NORM_EPSILON;
use gripline_network::unet::{self, Widths};
use gripline_network::{self as engine, Layer, LayerKind, OUTPUT};

use crate::weights::Tensors;

#[derive(Module, Debug)]
struct Stage {
    convolution: Conv2d,
    norm: BatchNorm,
}

#[derive(Module, Debug)]
struct TransposedStage {
    convolution: ConvTranspose2d,
    norm: BatchNorm,
}

/// The encoder–decoder.
#[derive(Module, Debug)]
pub(crate) struct UNet {
    encode44: Stage,
    encode22: Stage,
    encode20a: Stage,
    encode20b: Stage,
    encode10a: Stage,
    encode10b: Stage,
    bottom5a: Stage,
    bottom5b: Stage,
    up10: TransposedStage,
    decode10a: Stage,
    decode10b: Stage,
    up20: TransposedStage,
    decode20a: Stage,
    decode20b: Stage,
    output: Conv2d,
    pool: MaxPool2d,
}

impl Stage {
    fn new(layer: Layer, device: &Device) -> Self {
        Self {
            convolution: convolution(layer, device),
            norm: norm(layer, device),
        }
    }

    fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        relu(self.norm.forward(self.convolution.forward(input)))
    }
}

impl TransposedStage {
    fn new(layer: Layer, device: &Device) -> Self {
        let convolution = ConvTranspose2dConfig::new([layer.in_channels, layer.out_channels], [3, 3])
            .with_stride([2, 2])
            .with_padding([1, 1])
            .with_padding_out([1, 1])
            .with_bias(false)
            .init(device);
        Self {
            convolution,
            norm: norm(layer, device),
        }
    }

    fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        relu(self.norm.forward(self.convolution.forward(input)))
    }
}

fn convolution(layer: Layer, device: &Device) -> Conv2d {
    let LayerKind::Convolution(kernel) = layer.kind else {
        unreachable!("{} is transposed", layer.name)
    };
    let (stride, padding) = (kernel.stride, kernel.padding);
    Conv2dConfig::new([layer.in_channels, layer.out_channels], [kernel.size; 2])
        .with_stride([stride, stride])
        .with_padding(PaddingConfig2d::Explicit(padding, padding, padding, padding))
        .with_bias(layer.name == OUTPUT)
        .init(device)
}

fn norm(layer: Layer, device: &Device) -> BatchNorm {
    BatchNormConfig::new(layer.out_channels)
        .with_epsilon(NORM_EPSILON)
        .init(device)
}

impl UNet {
    pub(crate) fn new(widths: Widths, device: &Device) -> Self {
        let [
            encode44,
            encode22,
            encode20a,
            encode20b,
            encode10a,
            encode10b,
            bottom5a,
            bottom5b,
            up10,
            decode10a,
            decode10b,
            up20,
            decode20a,
            decode20b,
            output,
        ] = unet::layers(widths);
        let stage = |layer| Stage::new(layer, device);
        Self {
            encode44: stage(encode44),
            encode22: stage(encode22),
            encode20a: stage(encode20a),
            encode20b: stage(encode20b),
            encode10a: stage(encode10a),
            encode10b: stage(encode10b),
            bottom5a: stage(bottom5a),
            bottom5b: stage(bottom5b),
            up10: TransposedStage::new(up10, device),
            decode10a: stage(decode10a),
            decode10b: stage(decode10b),
            up20: TransposedStage::new(up20, device),
            decode20a: stage(decode20a),
            decode20b: stage(decode20b),
            output: convolution(output, device),
            pool: MaxPool2dConfig::new([2, 2]).init(),
        }
    }

    pub(crate) fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        let join = |decoder, encoder| Tensor::cat(vec![decoder, encoder], 1);
        let at22 = self.encode22.forward(self.encode44.forward(input));
        let at20 = self.encode20b.forward(self.encode20a.forward(at22));
        let at10 = self
            .encode10b
            .forward(self.encode10a.forward(self.pool.forward(at20.clone())));
        let at5 = self
            .bottom5b
            .forward(self.bottom5a.forward(self.pool.forward(at10.clone())));
        let up10 = self.decode10a.forward(join(self.up10.forward(at5), at10));
        let up20 = self.up20.forward(self.decode10b.forward(up10));
        let out20 = self.decode20b.forward(self.decode20a.forward(join(up20, at20)));
        self.output.forward(out20)
    }

    fn parts(&self) -> Parts<'_> {
        Parts {
            stages: vec![
                ("encode44", &self.encode44),
                ("encode22", &self.encode22),
                ("encode20a", &self.encode20a),
                ("encode20b", &self.encode20b),
                ("encode10a", &self.encode10a),
                ("encode10b", &self.encode10b),
                ("bottom5a", &self.bottom5a),
                ("bottom5b", &self.bottom5b),
                ("decode10a", &self.decode10a),
                ("decode10b", &self.decode10b),
                ("decode20a", &self.decode20a),
                ("decode20b", &self.decode20b),
            ],
            transposed: vec![("up10", &self.up10), ("up20", &self.up20)],
            output: &self.output,
        }
    }

    fn parts_mut(&mut self) -> PartsMut<'_> {
        PartsMut {
            stages: vec![
                ("encode44", &mut self.encode44),
                ("encode22", &mut self.encode22),
                ("encode20a", &mut self.encode20a),
                ("encode20b", &mut self.encode20b),
                ("encode10a", &mut self.encode10a),
                ("encode10b", &mut self.encode10b),
                ("bottom5a", &mut self.bottom5a),
                ("bottom5b", &mut self.bottom5b),
                ("decode10a", &mut self.decode10a),
                ("decode10b", &mut self.decode10b),
                ("decode20a", &mut self.decode20a),
                ("decode20b", &mut self.decode20b),
            ],
            transposed: vec![("up10", &mut self.up10), ("up20", &mut self.up20)],
            output: &mut self.output,
        }
    }

    /// Exports all tensors under their names in the weights file.
    pub(crate) fn tensors(&self) -> Tensors {
        let mut tensors = Tensors::new();
        let mut put = |name: String, data: TensorData| {
            let shape = data.shape().iter().copied().collect();
            let values = data.try_to_vec::<f32>().expect("weights are f32");
            tensors.insert(name, engine::Tensor { shape, values });
        };
        let mut put_normed = |name: &str, weight: &Param<Tensor<4>>, norm: &BatchNorm| {
            put(format!("{name}.weight"), weight.val().into_data());
            put(format!("{name}.norm.gamma"), norm.gamma.val().into_data());
            put(format!("{name}.norm.beta"), norm.beta.val().into_data());
            put(
                format!("{name}.norm.mean"),
                norm.running_mean.value_sync().into_data(),
            );
            put(
                format!("{name}.norm.variance"),
                norm.running_var.value_sync().into_data(),
            );
        };
        let parts = self.parts();
        for (name, stage) in parts.stages {
            put_normed(name, &stage.convolution.weight, &stage.norm);
        }
        for (name, stage) in parts.transposed {
            put_normed(name, &stage.convolution.weight, &stage.norm);
        }
        put(format!("{OUTPUT}.weight"), parts.output.weight.val().into_data());
        let bias = parts.output.bias.as_ref().expect("the output layer has a bias");
        put(format!("{OUTPUT}.bias"), bias.val().into_data());
        tensors
    }

    /// Imports all tensors of a checked weights file of the same widths.
    pub(crate) fn set_tensors(&mut self, tensors: &Tensors, device: &Device) {
        let data = |name: &str, part: &str| {
            let tensor = &tensors[&format!("{name}.{part}")];
            TensorData::new(tensor.values.clone(), tensor.shape.clone())
        };
        let set_norm = |name: &str, norm: &mut BatchNorm| {
            norm.gamma = Param::from_data(data(name, "norm.gamma"), device);
            norm.beta = Param::from_data(data(name, "norm.beta"), device);
            norm.running_mean = RunningState::new(Tensor::from_data(data(name, "norm.mean"), device));
            norm.running_var = RunningState::new(Tensor::from_data(data(name, "norm.variance"), device));
        };
        let parts = self.parts_mut();
        for (name, stage) in parts.stages {
            stage.convolution.weight = Param::from_data(data(name, "weight"), device);
            set_norm(name, &mut stage.norm);
        }
        for (name, stage) in parts.transposed {
            stage.convolution.weight = Param::from_data(data(name, "weight"), device);
            set_norm(name, &mut stage.norm);
        }
        parts.output.weight = Param::from_data(data(OUTPUT, "weight"), device);
        parts.output.bias = Some(Param::from_data(data(OUTPUT, "bias"), device));
    }
}

/// A network's layers under their names in the weights file.
struct Parts<'a> {
    stages: Vec<(&'static str, &'a Stage)>,
    transposed: Vec<(&'static str, &'a TransposedStage)>,
    output: &'a Conv2d,
}

/// The same, mutable.
struct PartsMut<'a> {
    stages: Vec<(&'static str, &'a mut Stage)>,
    transposed: Vec<(&'static str, &'a mut TransposedStage)>,
    output: &'a mut Conv2d,
}
