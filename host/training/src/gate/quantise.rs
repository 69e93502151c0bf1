//! Quantisation to int8 as in TensorFlow Lite: one scale per layer output, one per filter, biases in the product of both.
//! [`run`] evaluates the quantised network to choose its thresholds.

use gripline_network::scene::{GateInputs, NO_MOTION, STEPS_PER_UNIT};

use super::net::{LAYERS, Net, OUTPUTS};
use super::tflite::{Convolution, Scale};

/// Of the network's input: energy over that of noise.
pub(crate) const INPUT: Scale = Scale {
    scale: 1.0 / STEPS_PER_UNIT,
    zero: NO_MOTION,
};
/// Of its outputs: logits, ±12.7 around the threshold.
const OUTPUT: Scale = Scale { scale: 0.1, zero: 0 };

/// The network's input as energies.
pub(crate) fn energies(inputs: &GateInputs) -> Vec<f32> {
    inputs
        .as_flattened()
        .iter()
        .map(|&step| INPUT.scale * (f32::from(step) - f32::from(INPUT.zero)))
        .collect()
}

/// Share of the examples whose largest value in a layer does not saturate. The heaviest touches are detected anyway; a
/// larger range would make light ones coarse.
const UNSATURATED: f64 = 0.9;

/// The quantised layers. The range of each layer's output comes from `examples`.
pub(crate) fn quantise(net: &Net, examples: &[Vec<f32>]) -> Vec<Convolution> {
    let mut largest: [Vec<f32>; LAYERS.len()] = Default::default();
    for example in examples {
        for (largest, output) in largest.iter_mut().zip(net.forward(example)) {
            largest.push(output.into_iter().fold(0.0, f32::max));
        }
    }
    let max = largest.map(|mut of_examples| {
        of_examples.sort_unstable_by(f32::total_cmp);
        let index = (of_examples.len() as f64 * UNSATURATED) as usize;
        of_examples.get(index).copied().unwrap_or(0.0)
    });
    let mut input = INPUT.scale;
    let mut chain = Vec::new();
    for (number, (layer, max)) in net.layers.iter().zip(max).enumerate() {
        let filters: Vec<&[f32]> = layer.weights.chunks_exact(layer.shape.taps()).collect();
        let scales: Vec<f32> = filters
            .iter()
            .map(|filter| filter.iter().fold(1e-6_f32, |max, weight| max.max(weight.abs())) / 127.0)
            .collect();
        let rectified = number + 1 < net.layers.len();
        let output = if rectified {
            Scale {
                scale: max.max(1e-3) / 255.0,
                zero: i8::MIN,
            }
        } else {
            OUTPUT
        };
        chain.push(Convolution {
            in_channels: layer.shape.in_channels,
            side: layer.shape.side,
            stride: layer.shape.stride as i32,
            filters: filters
                .iter()
                .zip(&scales)
                .flat_map(|(filter, scale)| filter.iter().map(move |weight| (weight / scale).round() as i8))
                .collect(),
            biases: layer
                .biases
                .iter()
                .zip(&scales)
                .map(|(bias, scale)| (bias / (input * scale)).round() as i32)
                .collect(),
            filter_scales: scales,
            rectified,
            output,
        });
        input = output.scale;
    }
    chain
}

/// The outputs of the quantised layers.
pub(crate) fn run(chain: &[Convolution], inputs: &GateInputs) -> [f32; OUTPUTS] {
    let mut values: Vec<i32> = inputs.as_flattened().iter().map(|&step| step.into()).collect();
    let mut from = INPUT;
    for (shape, layer) in LAYERS.iter().zip(chain) {
        let mut sums = layer.biases.repeat(shape.out_side().pow(2));
        shape.products(|output, _, weight, input| {
            sums[output] += (values[input] - i32::from(from.zero)) * i32::from(layer.filters[weight]);
        });
        let min = if layer.rectified {
            layer.output.zero
        } else {
            i8::MIN
        };
        values = sums
            .iter()
            .enumerate()
            .map(|(at, &sum)| {
                let factor = from.scale * layer.filter_scales[at % shape.out_channels] / layer.output.scale;
                let value = f32::from(layer.output.zero) + factor * sum as f32;
                (value.round() as i32).clamp(min.into(), i8::MAX.into())
            })
            .collect();
        from = layer.output;
    }
    [0, 1].map(|k| from.scale * (values[k] - i32::from(from.zero)) as f32)
}

/// Shifts the outputs down, so that 0 becomes the threshold. In logits.
pub(crate) fn shift(chain: &mut [Convolution], by: [f32; OUTPUTS]) {
    let input = chain[chain.len() - 2].output.scale;
    let Some(last) = chain.last_mut() else {
        return;
    };
    for ((bias, scale), by) in last.biases.iter_mut().zip(&last.filter_scales).zip(by) {
        *bias -= (by / (input * scale)).round() as i32;
    }
}
