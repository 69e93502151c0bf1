//! Convolutions in int16 with int32 sums, for planes that change as a whole. Weights are quantised once per output
//! channel; activations are quantised in every run, relative to the largest one. Nothing needs calibration and no layer's
//! sum can overflow; a layer's error is about 0.05 % of its outputs. Sums are integers, so every instruction set gives the
//! same bits, and so does [`Winograd`], which computes most 3×3 layers. NaN or infinity anywhere in the input makes every output NaN.

use super::convolution::{Convolution, Kernel, Shape};
use super::direct::convolve;
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

/// An int16 convolution with its quantised input.
#[derive(Debug, Clone)]
pub(crate) struct Int16Convolution {
    convolution: Convolution<Int16Pair>,
    /// Value of one step of the weights, per output channel.
    weight_scales: Vec<f32>,
    /// Largest quantised activation.
    activation_max: f32,
    input: Plane<Int16Pair>,
    /// How it is computed, unless directly.
    winograd: Option<Box<Winograd>>,
}

impl Int16Convolution {
    /// As [`Convolution::forward`], for inputs of this height and width.
    ///
    /// # Panics
    /// As there, and when the number of input channels is odd.
    pub(crate) fn forward(
        instructions: InstructionSet,
        shape: Shape,
        size: (usize, usize),
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
        let quantised = QuantisedWeights::new(channels, taps, in_pairs, |out, channel, tap| {
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
            ..Self::new(convolution, quantised, size)
        }
    }

    /// As [`Convolution::transposed`], for inputs of this height and width.
    ///
    /// # Panics
    /// As there, and when the number of input channels is odd.
    pub(crate) fn transposed(
        instructions: InstructionSet,
        channels: [usize; 2],
        size: (usize, usize),
        weights: &[f32],
        bias: &[f32],
    ) -> Self {
        assert_eq!(weights.len(), channels[0] * channels[1] * 9, "weights");
        let quantised = QuantisedWeights::new(channels, 9, false, |out, channel, tap| {
            weights[(channel * channels[0] + out) * 9 + tap]
        });
        let weight = |out, pair, ky, kx| quantised.pair(out, pair, 3 * ky + kx);
        let pairs = [channels[0], channels[1] / 2];
        let convolution = Convolution::transposed_with(available(instructions), pairs, bias, weight);
        Self::new(convolution, quantised, size)
    }

    fn new(
        convolution: Convolution<Int16Pair>,
        quantised: QuantisedWeights,
        (height, width): (usize, usize),
    ) -> Self {
        Self {
            input: Plane::new(height, width, convolution.in_channels),
            convolution,
            weight_scales: quantised.scales,
            activation_max: quantised.activation_max,
            winograd: None,
        }
    }

    pub(crate) fn convolution(&self) -> &Convolution<Int16Pair> {
        &self.convolution
    }

    /// Runs it over the whole input; writes the output's channels from `channel` on. No allocation.
    ///
    /// # Panics
    /// When sizes do not fit.
    pub(super) fn run(&mut self, input: &Plane, output: &mut Plane, channel: usize) {
        assert_eq!(input.size(), self.input.size(), "size of the input");
        assert_eq!(
            input.channels(),
            2 * self.input.channels(),
            "channels of the input"
        );
        dispatch_256(self.convolution.instructions(), Quantise(self, input));
        if let Some(winograd) = &self.winograd {
            winograd.convolve(&self.convolution, output, channel);
            return;
        }
        let all = Region::whole(output.height(), output.width());
        convolve(&self.convolution, None, &self.input, output, channel, &all);
    }
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

/// Rounds three numbers to integers with an even sum, which takes at most 1.5 in all.
fn rounded_even(row: [f64; 3]) -> [i16; 3] {
    let mut rounded = row.map(|weight| weight.round() as i16);
    if rounded.iter().map(|weight| i32::from(*weight)).sum::<i32>() % 2 != 0 {
        let off = |k: usize| row[k] - f64::from(rounded[k]);
        let farthest = (1..3).fold(0, |far, k| if off(k).abs() > off(far).abs() { k } else { far });
        rounded[farthest] += if off(farthest) < 0.0 { -1 } else { 1 };
    }
    rounded
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
        taps: usize,
        in_pairs: bool,
        weight: impl Fn(usize, usize, usize) -> f32,
    ) -> Self {
        assert!(in_channels % 2 == 0, "{in_channels} channels in pairs");
        let (mut weights, mut scales) = (Vec::new(), Vec::new());
        let summed = (in_channels * taps) as f64;
        let activation_max = f64::from(if in_pairs { i16::MAX / 2 } else { i16::MAX });
        let max = (ACTIVATION_MAX / summed.sqrt()).min(activation_max).floor();
        for out in 0..out_channels {
            let of_channel = (0..in_channels).flat_map(|channel| (0..taps).map(move |tap| (channel, tap)));
            let of_channel: Vec<f64> = of_channel
                .map(|(channel, tap)| f64::from(weight(out, channel, tap)))
                .collect();
            let (sum, largest) = of_channel.iter().fold((0.0, 0.0_f64), |(sum, largest), weight| {
                (sum + weight.abs(), largest.max(weight.abs()))
            });
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers in ±1 without a pattern (an LCG's upper bits).
    struct Noise(u64);

    impl Noise {
        fn value(&mut self) -> f32 {
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 40) as f32 / (1 << 23) as f32 - 1.0
        }

        fn values(&mut self, count: usize) -> Vec<f32> {
            (0..count).map(|_| self.value()).collect()
        }

        fn below(&mut self, below: usize) -> usize {
            (self.value().abs() * below as f32) as usize % below
        }
    }

    fn sets() -> impl Iterator<Item = InstructionSet> {
        InstructionSet::ALL.into_iter().filter(|set| set.is_available())
    }

    /// `None`: an up-convolution that doubles the size.
    type Stride = Option<usize>;

    /// A layer in int16 and the same one in f32.
    fn layers(
        set: InstructionSet,
        stride: Stride,
        channels: [usize; 2],
        size: (usize, usize),
        [weights, bias]: [&[f32]; 2],
    ) -> (Int16Convolution, Convolution) {
        let Some(stride) = stride else {
            return (
                Int16Convolution::transposed(set, channels, size, weights, bias),
                Convolution::transposed(set, channels[1], channels[0], weights, bias),
            );
        };
        let shape = Shape {
            out_channels: channels[0],
            in_channels: channels[1],
            kernel: Kernel {
                size: 3,
                stride,
                padding: 1,
            },
        };
        (
            Int16Convolution::forward(set, shape, size, weights, bias),
            Convolution::forward(set, shape, weights, bias, true),
        )
    }

    fn plane((height, width): (usize, usize), channels: usize, mut value: impl FnMut() -> f32) -> Plane {
        let mut plane = Plane::new(height, width, channels);
        for row in 0..height {
            plane.row_mut(row).fill_with(&mut value);
        }
        plane
    }

    /// The outputs in int16 and in f32.
    fn run((mut int16, single): (Int16Convolution, Convolution), input: &Plane) -> [Vec<f32>; 2] {
        let (height, width) = single.out_size(input.size());
        let mut outputs = [0, 1].map(|_| Plane::new(height, width, single.out_channels()));
        int16.run(input, &mut outputs[0], 0);
        let all = Region::whole(height, width);
        convolve(&single, None, input, &mut outputs[1], 0, &all);
        outputs.map(|output| (0..height).flat_map(|row| output.row(row).to_vec()).collect())
    }

    #[test]
    fn layers_keep_to_those_in_f32_as_far_as_they_round_and_every_set_gives_the_same_bits() {
        let mut noise = Noise(1);
        for case in 0..60 {
            let stride = [Some(1), Some(2), None][case % 3];
            let channels = [1 + noise.below(50), 2 * (1 + noise.below(50))];
            let size = (1 + noise.below(12), 1 + noise.below(22));
            // Anywhere between small and large.
            let scale = 10.0_f32.powi(noise.below(13) as i32 - 6);
            let weights = noise.values(channels[0] * channels[1] * 9);
            let bias: Vec<f32> = noise.values(channels[0]).iter().map(|b| b * scale).collect();
            let input = plane(size, channels[1], || scale * noise.value().powi(3));
            let mut first: Option<Vec<f32>> = None;
            for set in sets() {
                let of = layers(set, stride, channels, size, [&weights, &bias]);
                let unit = scale * 0.5 / of.0.activation_max;
                let weight_unit =
                    of.0.weight_scales
                        .iter()
                        .fold(0.0_f32, |max, scale| max.max(*scale));
                // Every activation and every weight may be off by half a unit, and all of them the same way.
                let taps = (9 * channels[1]) as f32;
                let bound = taps * (unit + 0.5 * weight_unit * scale) * 1.01 + 1e-5 * taps * scale;
                let [ours, single] = run(of, &input);
                let mut squares = [0.0_f64; 2];
                for (ours, single) in ours.iter().zip(&single) {
                    assert!(
                        (ours - single).abs() <= bound,
                        "{ours} for {single}, {set}, case {case}"
                    );
                    squares[0] += f64::from(ours - single).powi(2);
                    squares[1] += f64::from(*single).powi(2);
                }
                // Errors are as good as random: a thousandth of the outputs.
                assert!(
                    squares[0] <= 1e-6 * squares[1],
                    "{squares:?}, {set}, case {case}: {channels:?}"
                );
                let bits =
                    |outputs: &[f32]| -> Vec<u32> { outputs.iter().map(|out| out.to_bits()).collect() };
                let first = first.get_or_insert_with(|| ours.clone());
                assert!(bits(&ours) == bits(first), "{set}, case {case}");
            }
        }
    }

    #[test]
    fn two_pixels_at_once_have_the_bits_of_one_by_one() {
        let mut noise = Noise(7);
        for case in 0..40 {
            let channels = [1 + noise.below(50), 2 * (1 + noise.below(50))];
            let size = (1 + noise.below(9), 2 * (1 + noise.below(14)));
            // Some rows of weights have nothing but one large weight.
            let weights: Vec<f32> = noise.values(channels[0] * channels[1] * 9);
            let weights: Vec<f32> = weights.iter().map(|weight| weight.powi(1 + case % 5)).collect();
            let bias = noise.values(channels[0]);
            let input = plane(size, channels[1], || noise.value());
            for set in sets() {
                let (at_once, single) = layers(set, Some(1), channels, size, [&weights, &bias]);
                assert!(at_once.winograd.is_some());
                let one_by_one = Int16Convolution {
                    winograd: None,
                    ..at_once.clone()
                };
                let [ours, _] = run((at_once, single.clone()), &input);
                let [expected, _] = run((one_by_one, single), &input);
                let bits =
                    |outputs: &[f32]| -> Vec<u32> { outputs.iter().map(|out| out.to_bits()).collect() };
                assert!(
                    bits(&ours) == bits(&expected),
                    "{set}, case {case}: {channels:?}, {size:?}"
                );
            }
        }
    }

    #[test]
    fn three_weights_round_to_an_even_sum() {
        for row in [
            [0.4, 0.4, 0.3],
            [1.0, -2.0, 4.0],
            [-0.6, 0.1, 0.0],
            [7.5, -7.5, 2.49],
        ] {
            let rounded = rounded_even(row);
            let sum: i32 = rounded.iter().map(|weight| i32::from(*weight)).sum();
            let off: f64 = row
                .iter()
                .zip(rounded)
                .map(|(row, rounded)| (row - f64::from(rounded)).abs())
                .sum();
            assert!(sum % 2 == 0 && off <= 1.5, "{row:?} to {rounded:?}");
        }
        assert_eq!(rounded_even([0.4, 0.45, 0.3]), [0, 0, 0]);
        assert_eq!(rounded_even([0.4, -0.45, 1.0]), [0, -1, 1]);
    }

    #[test]
    fn the_largest_sums_there_can_be_do_not_wrap() {
        for (channels, sign) in [([24, 10], 1.0), ([48, 96], 1.0), ([64, 64], -1.0), ([3, 2], 1.0)] {
            let weights = vec![sign * 0.7; channels[0] * channels[1] * 9];
            let bias = vec![0.0; channels[0]];
            // One by one, and two pixels at once.
            for size in [(4, 5), (4, 6)] {
                let input = plane(size, channels[1], || sign * 3.0);
                for set in sets() {
                    let [ours, single] = run(layers(set, Some(1), channels, size, [&weights, &bias]), &input);
                    for (ours, single) in ours.iter().zip(&single) {
                        assert!(
                            (ours - single).abs() <= 1e-3 * single,
                            "{ours} for {single}, {set}"
                        );
                    }
                    assert!(single.iter().all(|&sum| sum > 0.0));
                }
            }
        }
    }

    #[test]
    fn nothing_in_is_the_bias_out_and_what_is_no_number_makes_everything_so() {
        let mut noise = Noise(3);
        let weights = noise.values(24 * 10 * 9);
        let bias = noise.values(24);
        for set in sets() {
            let of = || layers(set, Some(1), [24, 10], (5, 5), [&weights, &bias]);
            for nothing in [0.0, 1e-40, -1e-31] {
                let [ours, _] = run(of(), &plane((5, 5), 10, || nothing));
                for (k, out) in ours.iter().enumerate() {
                    assert_eq!(out.to_bits(), bias[k % 24].max(0.0).to_bits(), "{set}, {nothing}");
                }
            }
            for broken in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                let mut input = plane((5, 5), 10, || 1.0);
                input.row_mut(2)[23] = broken;
                let [ours, _] = run(of(), &input);
                assert!(ours.iter().all(|out| out.is_nan()), "{set}, {broken}");
            }
        }
    }

    #[test]
    #[should_panic(expected = "9 channels in pairs")]
    fn an_odd_number_of_channels_is_refused() {
        layers(
            InstructionSet::Portable,
            Some(1),
            [8, 9],
            (4, 4),
            [&[0.0; 648], &[0.0; 8]],
        );
    }
}
