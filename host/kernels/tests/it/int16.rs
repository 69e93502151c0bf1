//! Layers in int16 against those in f32.

use gripline_kernels::{
    Convolution, InputSign, InstructionSet, Int16Convolution, Kernel, Plane, Region, Shape, convolve,
    rounded_even,
};

use super::sets;

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

/// `None`: an up-convolution that doubles the size.
type Stride = Option<usize>;

/// A layer in int16 and the same one in f32, with as many taps as there are weights for.
fn layers(
    set: InstructionSet,
    stride: Stride,
    channels: [usize; 2],
    (size, sign): ((usize, usize), InputSign),
    [weights, bias]: [&[f32]; 2],
) -> (Int16Convolution, Convolution) {
    let Some(stride) = stride else {
        return (
            Int16Convolution::transposed(set, channels, size, sign, weights, bias),
            Convolution::transposed(set, channels[1], channels[0], weights, bias),
        );
    };
    let shape = Shape {
        out_channels: channels[0],
        in_channels: channels[1],
        kernel: Kernel {
            size: (weights.len() / (channels[0] * channels[1])).isqrt(),
            stride,
            padding: 1,
        },
    };
    (
        Int16Convolution::forward(set, shape, size, sign, weights, bias),
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

/// A value of such an input.
fn with_sign(sign: InputSign, value: f32) -> f32 {
    match sign {
        InputSign::Any => value,
        InputSign::NotNegative => value.max(0.0),
    }
}

const SIGNS: [InputSign; 2] = [InputSign::Any, InputSign::NotNegative];

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
    for case in 0..100 {
        let (stride, taps) = [(Some(1), 9), (Some(2), 9), (None, 9), (Some(2), 16), (None, 16)][case % 5];
        let channels = [1 + noise.below(50), 2 * (1 + noise.below(50))];
        let sign = SIGNS[case / 5 % 2];
        // Four taps with a border of one need two pixels.
        let least = 1 + usize::from(taps == 16 && stride.is_some());
        let size = (least + noise.below(12), least + noise.below(22));
        // Anywhere between small and large.
        let scale = 10.0_f32.powi(noise.below(13) as i32 - 6);
        let weights = noise.values(channels[0] * channels[1] * taps);
        let bias: Vec<f32> = noise.values(channels[0]).iter().map(|b| b * scale).collect();
        let input = plane(size, channels[1], || {
            with_sign(sign, scale * noise.value().powi(3))
        });
        let mut first: Option<Vec<f32>> = None;
        for set in sets() {
            let of = layers(set, stride, channels, (size, sign), [&weights, &bias]);
            let (activation_max, weight_unit) = of.0.rounding();
            let unit = scale * 0.5 / activation_max;
            // Every activation and every weight may be off by half a unit, and all of them the same way.
            let taps = (taps * channels[1]) as f32;
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
            let bits = |outputs: &[f32]| -> Vec<u32> { outputs.iter().map(|out| out.to_bits()).collect() };
            let first = first.get_or_insert_with(|| ours.clone());
            assert!(bits(&ours) == bits(first), "{set}, case {case}");
        }
    }
}

#[test]
fn two_pixels_at_once_have_the_bits_of_one_by_one() {
    let mut noise = Noise(7);
    for case in 0..80 {
        let sign = SIGNS[usize::from(case >= 40)];
        let channels = [1 + noise.below(50), 2 * (1 + noise.below(50))];
        let size = (1 + noise.below(9), 2 * (1 + noise.below(14)));
        // Some rows of weights have nothing but one large weight.
        let weights: Vec<f32> = noise.values(channels[0] * channels[1] * 9);
        let weights: Vec<f32> = weights.iter().map(|weight| weight.powi(1 + case % 5)).collect();
        let bias = noise.values(channels[0]);
        let input = plane(size, channels[1], || with_sign(sign, noise.value()));
        for set in sets() {
            let (at_once, single) = layers(set, Some(1), channels, (size, sign), [&weights, &bias]);
            assert!(at_once.is_in_pairs());
            let one_by_one = at_once.clone().one_by_one();
            let [ours, _] = run((at_once, single.clone()), &input);
            let [expected, _] = run((one_by_one, single), &input);
            let bits = |outputs: &[f32]| -> Vec<u32> { outputs.iter().map(|out| out.to_bits()).collect() };
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
                let of = layers(set, Some(1), channels, (size, InputSign::Any), [&weights, &bias]);
                let [ours, single] = run(of, &input);
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
fn the_largest_sums_of_inputs_that_are_not_negative_do_not_wrap() {
    for (stride, taps) in [(Some(1), 9), (Some(2), 16), (None, 9), (None, 16)] {
        for channels in [[24, 10], [48, 96], [3, 2]] {
            // Half of the weights are below zero, so that the bound is half of the sum of their sizes.
            let of_channel = |channel: usize| if channel.is_multiple_of(2) { 0.7 } else { -0.7 };
            let weight = |k: usize| match stride {
                Some(_) => of_channel(k / taps % channels[1]),
                None => of_channel(k / (taps * channels[0])),
            };
            let weights: Vec<f32> = (0..channels[0] * channels[1] * taps).map(weight).collect();
            let bias = vec![0.0; channels[0]];
            // Either only what counts up is there, or only what counts down.
            for up in [true, false] {
                let mut k = 0;
                let input = plane((4, 6), channels[1], || {
                    k += 1;
                    if ((k - 1) % channels[1]).is_multiple_of(2) == up {
                        3.0
                    } else {
                        0.0
                    }
                });
                for set in sets() {
                    let input_is = ((4, 6), InputSign::NotNegative);
                    let of = layers(set, stride, channels, input_is, [&weights, &bias]);
                    let [ours, single] = run(of, &input);
                    assert!(single.iter().all(|&sum| (sum > 0.0) == up), "{stride:?}");
                    for (ours, single) in ours.iter().zip(&single) {
                        assert!(
                            (ours - single).abs() <= 1e-3 * single,
                            "{ours} for {single}, {set}, {stride:?}, {taps}"
                        );
                    }
                }
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
        let of = || {
            layers(
                set,
                Some(1),
                [24, 10],
                ((5, 5), InputSign::Any),
                [&weights, &bias],
            )
        };
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
        ((4, 4), InputSign::Any),
        [&[0.0; 648], &[0.0; 8]],
    );
}

#[test]
#[cfg(debug_assertions)]
#[should_panic(expected = "an input below zero")]
fn a_value_below_zero_that_must_not_be_is_noticed() {
    let input_is = ((4, 4), InputSign::NotNegative);
    let of = layers(
        InstructionSet::Portable,
        Some(1),
        [8, 2],
        input_is,
        [&[0.1; 144], &[0.0; 8]],
    );
    run(of, &plane((4, 4), 2, || -1.0));
}
