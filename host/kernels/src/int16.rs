//! Convolutions in int16 with int32 sums, for planes that change as a whole. Weights are quantised once per output
//! channel; activations are quantised in every run, relative to the largest one. Nothing needs calibration and no layer's
//! sum can overflow; a layer's error is about 0.05 % of its outputs. Sums are integers, so every instruction set gives the
//! same bits, and so does [`Winograd`], which computes most 3×3 layers. NaN or infinity anywhere in the input makes every output NaN.

use super::convolution::{Convolution, Kernel, Shape, transposed_size};
use super::direct::convolve_numbers;
use super::plane::Plane;
use super::region::Region;
use super::winograd::Winograd;
use crate::instruction_set::InstructionSet;
use crate::simd::{Dispatch, Int16Pair, Simd, dispatch_256};

/// Largest quantised activation times the root of the number of products in a sum. It splits the 32 bits of a sum so that
/// weights and activations have about the same error where the largest activation is eight times the usual one.
const ACTIVATION_MAX: f64 = 1.5e5;
/// An input without larger magnitudes counts as zero.
const INPUT_MIN: f32 = 1e-30;
/// Adding this to a magnitude up to 2²² rounds it to the nearest integer (ties to even), which the lowest bits then hold.
const ROUNDING: f32 = 12_582_912.0;

/// The signs that the values of a layer's input can have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputSign {
    /// Both.
    Any,
    /// None is below zero, as behind ReLU. Then no sum exceeds that of the weights of one sign, so that their steps are finer.
    NotNegative,
}

/// An int16 convolution with its quantised input.
#[derive(Debug, Clone)]
pub struct Int16Convolution {
    convolution: Convolution<Int16Pair>,
    /// Value of one step of the weights, per output channel.
    weight_scales: Vec<f32>,
    /// Largest quantised activation.
    activation_max: f32,
    sign: InputSign,
    input: Plane<Int16Pair>,
    /// How it is computed, unless directly.
    winograd: Option<Box<Winograd>>,
}

impl Int16Convolution {
    /// As [`Convolution::forward`], for inputs of this height and width, and these signs.
    ///
    /// # Panics
    /// As there, and when the number of input channels is odd.
    #[must_use]
    pub fn forward(
        instructions: InstructionSet,
        shape: Shape,
        size: (usize, usize),
        sign: InputSign,
        weights: &[f32],
        bias: &[f32],
    ) -> Self {
        let (channels, taps) = (
            [shape.out_channels, shape.in_channels],
            shape.kernel.size * shape.kernel.size,
        );
        assert_eq!(weights.len(), channels[0] * channels[1] * taps, "weights");
        let three_by_three = Kernel {
            size: 3,
            stride: 1,
            padding: 1,
        };
        let in_pairs = shape.kernel == three_by_three && size.1.is_multiple_of(2);
        let sums = Sums {
            of_tap: vec![0; taps],
            sign,
        };
        let quantised = QuantisedWeights::new(channels, &sums, in_pairs, |out, channel, tap| {
            weights[(out * channels[1] + channel) * taps + tap]
        });
        let shape = Shape {
            in_channels: channels[1] / 2,
            ..shape
        };
        let weight = |out, pair, ky, kx| quantised.pair(out, pair, ky * shape.kernel.size + kx);
        let convolution = Convolution::forward_with(available(instructions), shape, bias, true, weight);
        let winograd = in_pairs.then(|| Box::new(Winograd::new(&convolution, size, weight)));
        Self {
            winograd,
            ..Self::new(convolution, quantised, size, sign)
        }
    }

    /// As [`Convolution::transposed`], for inputs of this height and width, and these signs.
    ///
    /// # Panics
    /// As there, and when the number of input channels is odd.
    #[must_use]
    pub fn transposed(
        instructions: InstructionSet,
        channels: [usize; 2],
        size: (usize, usize),
        sign: InputSign,
        weights: &[f32],
        bias: &[f32],
    ) -> Self {
        let side = transposed_size(weights, channels);
        let taps = side * side;
        // An output pixel sees every second tap, even or odd by its row and its column.
        let sums = Sums {
            of_tap: (0..taps).map(|tap| tap / side % 2 * 2 + tap % side % 2).collect(),
            sign,
        };
        let quantised = QuantisedWeights::new(channels, &sums, false, |out, channel, tap| {
            weights[(channel * channels[0] + out) * taps + tap]
        });
        let weight = |out, pair, ky, kx| quantised.pair(out, pair, side * ky + kx);
        let pairs = [channels[0], channels[1] / 2];
        let convolution = Convolution::transposed_with(available(instructions), pairs, side, bias, weight);
        Self::new(convolution, quantised, size, sign)
    }

    fn new(
        convolution: Convolution<Int16Pair>,
        quantised: QuantisedWeights,
        (height, width): (usize, usize),
        sign: InputSign,
    ) -> Self {
        Self {
            sign,
            input: Plane::new(height, width, convolution.in_channels),
            convolution,
            weight_scales: quantised.scales,
            activation_max: quantised.activation_max,
            winograd: None,
        }
    }

    /// Its shape and packed weights.
    #[must_use]
    pub fn convolution(&self) -> &Convolution<Int16Pair> {
        &self.convolution
    }

    /// How far it rounds: steps from 0 to the largest activation, whatever that is, and the size of the largest step of a weight.
    #[must_use]
    pub fn rounding(&self) -> (f32, f32) {
        let weights = self.weight_scales.iter().copied().fold(0.0, f32::max);
        (self.activation_max, weights)
    }

    /// Whether it computes two neighbouring output pixels at once.
    #[must_use]
    pub fn is_in_pairs(&self) -> bool {
        self.winograd.is_some()
    }

    /// The same, computing output pixels one by one: slower, the same bits.
    #[must_use]
    pub fn one_by_one(self) -> Self {
        Self {
            winograd: None,
            ..self
        }
    }

    /// Runs it over the whole input; writes the output's channels from `channel` on. No allocation.
    ///
    /// # Panics
    /// When sizes do not fit; with debug assertions also when values are below zero that must not be.
    pub fn run(&mut self, input: &Plane, output: &mut Plane, channel: usize) {
        assert_eq!(input.size(), self.input.size(), "size of the input");
        assert_eq!(
            input.channels(),
            2 * self.input.channels(),
            "channels of the input"
        );
        debug_assert!(
            self.sign == InputSign::Any || !has_negative(input),
            "an input below zero"
        );
        dispatch_256(self.convolution.instructions(), Quantise(self, input));
        if let Some(winograd) = &self.winograd {
            winograd.convolve(&self.convolution, output, channel);
            return;
        }
        let all = Region::whole(output.height(), output.width());
        convolve_numbers(&self.convolution, None, &self.input, output, channel, &all);
    }
}

/// Whether a value is below zero, those that count as zero and infinity left out.
fn has_negative(input: &Plane) -> bool {
    let negative = f32::MIN..-INPUT_MIN;
    (0..input.height()).any(|row| input.row(row).iter().any(|value| negative.contains(value)))
}

/// Quantises the input of a convolution.
struct Quantise<'a>(&'a mut Int16Convolution, &'a Plane);

impl Dispatch for Quantise<'_> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "compiles for the instruction set of its caller"
    )]
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self(convolution, input) = self;
        // Bits compare as the magnitudes do; infinity and NaN are above all.
        let mut largest = 0;
        for row in 0..input.height() {
            for value in input.row(row) {
                largest = largest.max(value.to_bits() & 0x7FFF_FFFF);
            }
        }
        let largest = f32::from_bits(largest);
        let max = convolution.activation_max;
        let (scale, per_scale) = if largest.is_finite() && largest < INPUT_MIN {
            (0.0, 0.0)
        } else {
            (largest / max, max / largest)
        };
        let scale = if largest.is_finite() { scale } else { f32::NAN };
        let scales = convolution.convolution.scales.iter_mut();
        for (product, of_weights) in scales.zip(&convolution.weight_scales) {
            *product = of_weights * scale;
        }
        for row in 0..input.height() {
            let pairs = convolution.input.row_mut(row).iter_mut();
            for (pair, &[a, b]) in pairs.zip(input.row(row).as_chunks::<2>().0) {
                *pair = Int16Pair([rounded(a * per_scale), rounded(b * per_scale)]);
            }
        }
        if let Some(winograd) = &mut convolution.winograd {
            winograd.take(&convolution.input);
        }
    }
}

/// The widest instruction set up to this one that has int16 products.
fn available(instructions: InstructionSet) -> InstructionSet {
    match instructions {
        InstructionSet::Avx512 if !Int16Pair::has_avx512() && InstructionSet::Avx2.is_available() => {
            InstructionSet::Avx2
        }
        other => other,
    }
}

/// Rounds to the nearest integer, ties to even.
#[expect(
    clippy::inline_always,
    reason = "compiles for the instruction set of its caller"
)]
#[inline(always)]
fn rounded(value: f32) -> i16 {
    (value + ROUNDING).to_bits() as i16
}

/// Rounds three numbers, in magnitude below 32,766, to integers with an even sum, which takes at most 1.5 in all.
#[must_use]
pub fn rounded_even(row: [f64; 3]) -> [i16; 3] {
    let mut rounded = row.map(|weight| weight.round() as i16);
    if rounded.iter().map(|weight| i32::from(*weight)).sum::<i32>() % 2 != 0 {
        let off = |k: usize| row[k] - f64::from(rounded[k]);
        let farthest = (1..3).fold(0, |far, k| if off(k).abs() > off(far).abs() { k } else { far });
        rounded[farthest] += if off(farthest) < 0.0 { -1 } else { 1 };
    }
    rounded
}

/// What is summed for an output.
struct Sums {
    /// Of every tap, which of the sums it is in: below four.
    of_tap: Vec<usize>,
    sign: InputSign,
}

impl Sums {
    /// Products in the longest sum, of this many input channels.
    fn longest(&self, in_channels: usize) -> usize {
        let taps = |sum| self.of_tap.iter().filter(|of| **of == sum).count();
        in_channels * (0..4).map(taps).max().unwrap_or(0)
    }

    /// Largest magnitude of a sum where no activation exceeds 1, given an output channel's weights by input channel and tap.
    fn largest(&self, weights: &[f64]) -> f64 {
        let mut sums = [[0.0; 2]; 4];
        for (weight, &sum) in weights.iter().zip(self.of_tap.iter().cycle()) {
            sums[sum][usize::from(*weight < 0.0)] += weight.abs();
        }
        let bounds = sums.map(|[positive, negative]| match self.sign {
            InputSign::Any => positive + negative,
            InputSign::NotNegative => f64::max(positive, negative),
        });
        bounds.into_iter().fold(0.0, f64::max)
    }
}

struct QuantisedWeights {
    /// Ordered by output channel, input channel, tap.
    weights: Vec<i16>,
    /// Value of one step, per output channel.
    scales: Vec<f32>,
    /// Largest quantised activation.
    activation_max: f32,
    in_channels: usize,
    taps: usize,
}

impl QuantisedWeights {
    /// `in_pairs`: for [`Winograd`], which needs rows of three weights with an even sum and some room.
    fn new(
        [out_channels, in_channels]: [usize; 2],
        sums: &Sums,
        in_pairs: bool,
        weight: impl Fn(usize, usize, usize) -> f32,
    ) -> Self {
        assert!(in_channels % 2 == 0, "{in_channels} channels in pairs");
        let (mut weights, mut scales) = (Vec::new(), Vec::new());
        let taps = sums.of_tap.len();
        let summed = sums.longest(in_channels) as f64;
        let activation_max = f64::from(if in_pairs { i16::MAX / 2 } else { i16::MAX });
        let max = (ACTIVATION_MAX / summed.sqrt()).min(activation_max).floor();
        for out in 0..out_channels {
            let of_channel = (0..in_channels).flat_map(|channel| (0..taps).map(move |tap| (channel, tap)));
            let of_channel: Vec<f64> = of_channel
                .map(|(channel, tap)| f64::from(weight(out, channel, tap)))
                .collect();
            let sum = sums.largest(&of_channel);
            let largest = of_channel
                .iter()
                .fold(0.0_f64, |largest, weight| largest.max(weight.abs()));
            // Half the sum of a row of weights has to fit too.
            let of_row = |row: &[f64]| 0.5 * row.iter().map(|weight| weight.abs()).sum::<f64>();
            let margin = if in_pairs { 2.0 } else { 0.0 };
            let rows = of_channel.chunks_exact(3).filter(|_| in_pairs).map(of_row);
            let largest = rows.fold(largest, f64::max);
            // The sum of all products with the largest activations, each weight quantised up, fits 32 bits.
            let room = f64::from(i32::MAX) / max - 0.5 * summed;
            let per_step = (room / sum).min((f64::from(i16::MAX) - margin) / largest);
            let per_step = if per_step.is_finite() { per_step } else { 1.0 };
            let steps: Vec<f64> = of_channel.iter().map(|weight| weight * per_step).collect();
            if in_pairs {
                weights.extend(steps.as_chunks::<3>().0.iter().flat_map(|row| rounded_even(*row)));
            } else {
                weights.extend(steps.iter().map(|weight| weight.round() as i16));
            }
            scales.push((1.0 / per_step) as f32);
        }
        Self {
            weights,
            scales,
            activation_max: max as f32,
            in_channels,
            taps,
        }
    }

    fn pair(&self, out: usize, pair: usize, tap: usize) -> Int16Pair {
        let at = |channel: usize| self.weights[(out * self.in_channels + channel) * self.taps + tap];
        Int16Pair([at(2 * pair), at(2 * pair + 1)])
    }
}
