//! The scene gate's network in floating point: three convolutions without padding on the 11×11×2 coarse difference
//! image (3×3 stride 2, 5×5, 1×1), trained by Adam on the logistic loss. So small that it needs no framework.

use crate::rng::Rng;

/// Rows and columns of the input.
pub(crate) const SIDE: usize = 11;
/// Against rest, against the processed picture.
pub(crate) const INPUTS: usize = 2;
/// Touched, changed.
pub(crate) const OUTPUTS: usize = 2;
/// The layers' shapes; each but the last is rectified.
pub(crate) const LAYERS: [Shape; 3] = [
    Shape::new(SIDE, INPUTS, 3, 2, 4),
    Shape::new(5, 4, 5, 1, 8),
    Shape::new(1, 8, 1, 1, OUTPUTS),
];

const LEARNING_RATE: f32 = 3e-3;

/// A convolution without padding on a square.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shape {
    /// Of the input, pixels.
    pub(crate) in_side: usize,
    pub(crate) in_channels: usize,
    /// Of the filters.
    pub(crate) side: usize,
    pub(crate) stride: usize,
    pub(crate) out_channels: usize,
}

impl Shape {
    const fn new(
        in_side: usize,
        in_channels: usize,
        side: usize,
        stride: usize,
        out_channels: usize,
    ) -> Self {
        Self {
            in_side,
            in_channels,
            side,
            stride,
            out_channels,
        }
    }

    pub(crate) const fn out_side(&self) -> usize {
        (self.in_side - self.side) / self.stride + 1
    }

    /// Weights of one output channel.
    pub(crate) const fn taps(&self) -> usize {
        self.side * self.side * self.in_channels
    }

    /// Calls `with` for every product: place of the output, its channel, the weight, the input.
    pub(crate) fn products(&self, mut with: impl FnMut(usize, usize, usize, usize)) {
        for row in 0..self.out_side() {
            for column in 0..self.out_side() {
                for channel in 0..self.out_channels {
                    let output = (row * self.out_side() + column) * self.out_channels + channel;
                    for y in 0..self.side {
                        for x in 0..self.side {
                            let pixel = (row * self.stride + y) * self.in_side + column * self.stride + x;
                            let tap = (channel * self.side + y) * self.side + x;
                            for input in 0..self.in_channels {
                                with(
                                    output,
                                    channel,
                                    tap * self.in_channels + input,
                                    pixel * self.in_channels + input,
                                );
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Weights and biases of a layer, with Adam's moments.
#[derive(Debug, Clone)]
pub(crate) struct Layer {
    pub(crate) shape: Shape,
    pub(crate) weights: Vec<f32>,
    pub(crate) biases: Vec<f32>,
    gradient: Vec<f32>,
    moments: Vec<[f32; 2]>,
}

/// The network.
#[derive(Debug, Clone)]
pub(crate) struct Net {
    pub(crate) layers: Vec<Layer>,
    steps: i32,
}

impl Net {
    pub(crate) fn new(rng: &mut Rng) -> Self {
        let layers = LAYERS.map(|shape| {
            let size = (3.0 / shape.taps() as f32).sqrt();
            let weights: Vec<f32> = (0..shape.taps() * shape.out_channels)
                .map(|_| rng.between(-size, size))
                .collect();
            let numbers = weights.len() + shape.out_channels;
            Layer {
                shape,
                weights,
                biases: vec![0.1; shape.out_channels],
                gradient: vec![0.0; numbers],
                moments: vec![[0.0; 2]; numbers],
            }
        });
        Self {
            layers: layers.to_vec(),
            steps: 0,
        }
    }

    /// Every layer's output, the last one's last.
    pub(crate) fn forward(&self, input: &[f32]) -> Vec<Vec<f32>> {
        let mut outputs: Vec<Vec<f32>> = Vec::with_capacity(self.layers.len());
        for (number, layer) in self.layers.iter().enumerate() {
            let input = outputs.last().map_or(input, Vec::as_slice);
            let pixels = layer.shape.out_side().pow(2);
            let mut out = layer.biases.repeat(pixels);
            layer
                .shape
                .products(|output, _, weight, from| out[output] += layer.weights[weight] * input[from]);
            if number + 1 < self.layers.len() {
                for value in &mut out {
                    *value = value.max(0.0);
                }
            }
            outputs.push(out);
        }
        outputs
    }

    /// Adds the gradient of Σ weight·log(1 + exp(∓output)) of one sample; returns that loss.
    pub(crate) fn learn(&mut self, input: &[f32], wanted: [f32; OUTPUTS], weight: [f32; OUTPUTS]) -> f32 {
        let outputs = self.forward(input);
        let last = &outputs[outputs.len() - 1];
        let mut loss = 0.0;
        let mut slope: Vec<f32> = (0..OUTPUTS)
            .map(|k| {
                let signed = if wanted[k] > 0.5 { last[k] } else { -last[k] };
                loss += weight[k] * (-signed).exp().ln_1p();
                let share = 1.0 / (1.0 + (-last[k]).exp());
                weight[k] * (share - wanted[k])
            })
            .collect();
        for number in (0..self.layers.len()).rev() {
            let input = if number == 0 { input } else { &outputs[number - 1] };
            let layer = &mut self.layers[number];
            let weights = layer.weights.len();
            let mut before = vec![0.0; input.len()];
            let (gradient, values) = (&mut layer.gradient, &layer.weights);
            layer.shape.products(|output, _, weight, from| {
                gradient[weight] += slope[output] * input[from];
                before[from] += slope[output] * values[weight];
            });
            for (output, slope) in slope.iter().enumerate() {
                gradient[weights + output % layer.shape.out_channels] += slope;
            }
            if number > 0 {
                for (slope, value) in before.iter_mut().zip(input) {
                    if *value <= 0.0 {
                        *slope = 0.0;
                    }
                }
            }
            slope = before;
        }
        loss
    }

    /// One step of Adam along the mean gradient of `samples` samples; `rate` of the peak rate.
    pub(crate) fn step(&mut self, samples: usize, rate: f32) {
        self.steps += 1;
        let unbias = [0.9_f32, 0.999].map(|decay| 1.0 - decay.powi(self.steps));
        for layer in &mut self.layers {
            let values = layer.weights.iter_mut().chain(&mut layer.biases);
            for ((value, gradient), moments) in values.zip(&mut layer.gradient).zip(&mut layer.moments) {
                let slope = *gradient / samples as f32;
                *gradient = 0.0;
                moments[0] = 0.9 * moments[0] + 0.1 * slope;
                moments[1] = 0.999 * moments[1] + 0.001 * slope * slope;
                let step = moments[0] / unbias[0] / ((moments[1] / unbias[1]).sqrt() + 1e-8);
                *value -= LEARNING_RATE * rate * step;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_are_difference_quotients() {
        let mut rng = Rng::new(5);
        let input: Vec<f32> = (0..SIDE * SIDE * INPUTS)
            .map(|_| rng.between(-1.0, 1.0))
            .collect();
        let net = Net::new(&mut rng);
        let (wanted, weight) = ([1.0, 0.0], [1.0, 0.7]);
        let loss = |net: &Net| net.clone().learn(&input, wanted, weight);
        let mut learnt = net.clone();
        learnt.learn(&input, wanted, weight);
        for (layer, weight) in [(0, 3), (0, 40), (1, 7), (1, 200), (2, 5)] {
            let moved = |by: f32| {
                let mut net = net.clone();
                net.layers[layer].weights[weight] += by;
                loss(&net)
            };
            // Small, so that no rectifier switches within the step.
            let quotient = (moved(1e-3) - moved(-1e-3)) / 2e-3;
            let gradient = learnt.layers[layer].gradient[weight];
            assert!(
                (gradient - quotient).abs() < 1e-3 * (1.0 + gradient.abs()),
                "layer {layer}, weight {weight}: {gradient}, not {quotient}"
            );
        }
    }
}
