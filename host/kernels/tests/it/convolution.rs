//! The kernels against the definitions in f64, on every instruction set of this processor, over sizes and
//! channels that fit no vector.

use gripline_kernels::simd::LANES_MAX;
use gripline_kernels::{
    Convolution, InstructionSet, Kernel, Plan, Plane, PlaneId, Region, Shape, convolve, max_pool,
};

use super::sets;

/// Numbers without a pattern that a convolution could hide behind (xorshift).
struct Noise(u32);

impl Noise {
    fn new(seed: usize) -> Self {
        Self((seed as u32).wrapping_mul(2_654_435_761) | 1)
    }

    fn bits(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0
    }

    /// In ±1.
    fn value(&mut self) -> f32 {
        self.bits() as f32 / u32::MAX as f32 * 2.0 - 1.0
    }

    fn values(&mut self, count: usize) -> Vec<f32> {
        (0..count).map(|_| self.value()).collect()
    }

    /// In `from..=to`.
    fn pick(&mut self, from: usize, to: usize) -> usize {
        from + (self.bits() >> 8) as usize % (to - from + 1)
    }

    fn plane(&mut self, height: usize, width: usize, channels: usize) -> Plane {
        let mut plane = Plane::new(height, width, channels);
        for row in 0..height {
            plane.row_mut(row).fill_with(|| self.value());
        }
        plane
    }

    fn region(&mut self, (height, width): (usize, usize)) -> Region {
        let mut range = |size: usize| {
            let start = self.pick(0, size - 1);
            start..self.pick(start + 1, size)
        };
        Region {
            rows: range(height),
            columns: range(width),
        }
    }
}

fn whole(plane: &Plane) -> Region {
    Region::whole(plane.height(), plane.width())
}

/// The pixel's channel in f64, zero outside the image.
fn pixel(plane: &Plane, row: isize, column: isize, channel: usize) -> f64 {
    let inside = (0..plane.height() as isize).contains(&row) && (0..plane.width() as isize).contains(&column);
    if inside {
        f64::from(plane.row(row as usize)[column as usize * plane.channels() + channel])
    } else {
        0.0
    }
}

fn border_is_zero(plane: &Plane) -> bool {
    let (height, width, channels) = (plane.height(), plane.width(), plane.channels());
    plane
        .values()
        .chunks_exact(plane.stride())
        .enumerate()
        .all(|(row, line)| {
            let outside = row == 0 || row == height + 1;
            let zero = |values: &[f32]| values.iter().all(|&value| value == 0.0);
            (!outside || zero(line)) && zero(&line[..channels]) && zero(&line[(width + 1) * channels..])
        })
}

/// A convolution and everything that it needs.
#[derive(Debug, Clone)]
struct Case {
    /// `None`: an up-convolution that doubles the size, with 9 or 16 taps.
    kernel: Option<Kernel>,
    size: (usize, usize),
    in_channels: usize,
    out_channels: usize,
    relu: bool,
    /// Channels of the output that are another layer's, before and after.
    others: [usize; 2],
    weights: Vec<f32>,
    bias: Vec<f32>,
}

impl Case {
    fn random(noise: &mut Noise) -> Self {
        let kernel = |size, stride, padding| {
            Some(Kernel {
                size,
                stride,
                padding,
            })
        };
        let kernels = [
            kernel(3, 1, 1),
            kernel(3, 1, 0),
            kernel(3, 2, 1),
            kernel(3, 2, 0),
            kernel(1, 1, 0),
            kernel(5, 1, 1),
            kernel(3, 3, 1),
            kernel(4, 2, 1),
            None,
        ];
        let kernel = kernels[noise.pick(0, kernels.len() - 1)];
        let up = noise.pick(3, 4);
        let taps = kernel.map_or(up * up, |kernel| kernel.size * kernel.size);
        let (in_channels, out_channels) = (noise.pick(1, 19), noise.pick(1, 41));
        Self {
            kernel,
            size: (noise.pick(3, 14), noise.pick(3, 31)),
            in_channels,
            out_channels,
            relu: kernel.is_none() || noise.pick(0, 1) == 1,
            others: [noise.pick(0, 5), noise.pick(0, 3)],
            weights: noise.values(in_channels * out_channels * taps),
            bias: noise.values(out_channels),
        }
    }

    fn packed(&self, set: InstructionSet) -> Convolution {
        match self.kernel {
            Some(kernel) => {
                let shape = Shape {
                    out_channels: self.out_channels,
                    in_channels: self.in_channels,
                    kernel,
                };
                Convolution::forward(set, shape, &self.weights, &self.bias, self.relu)
            }
            None => Convolution::transposed(
                set,
                self.in_channels,
                self.out_channels,
                &self.weights,
                &self.bias,
            ),
        }
    }

    /// An output whose every number is the same recognisable one.
    fn untouched(&self, set: InstructionSet) -> Plane {
        let (height, width) = self.packed(set).out_size(self.size);
        let mut output = Plane::new(height, width, self.others[0] + self.out_channels + self.others[1]);
        for row in 0..height {
            output.row_mut(row).fill(UNTOUCHED);
        }
        output
    }

    fn run(&self, set: InstructionSet, input: &Plane) -> Plane {
        let mut output = self.untouched(set);
        let region = whole(&output);
        convolve(
            &self.packed(set),
            None,
            input,
            &mut output,
            self.others[0],
            &region,
        );
        output
    }

    /// Sum and sum of absolute values of one output, in f64, before ReLU.
    fn expected(&self, input: &Plane, (row, column): (usize, usize), out: usize) -> (f64, f64) {
        let mut sums = (f64::from(self.bias[out]), f64::from(self.bias[out]).abs());
        let mut add = |weight: f32, value: f64| {
            sums.0 += f64::from(weight) * value;
            sums.1 += (f64::from(weight) * value).abs();
        };
        let (row, column) = (row as isize, column as isize);
        for channel in 0..self.in_channels {
            if let Some(Kernel {
                size,
                stride,
                padding,
            }) = self.kernel
            {
                for tap in 0..size * size {
                    let y = row * stride as isize + (tap / size) as isize - padding as isize;
                    let x = column * stride as isize + (tap % size) as isize - padding as isize;
                    let weight = self.weights[(out * self.in_channels + channel) * size * size + tap];
                    add(weight, pixel(input, y, x, channel));
                }
            } else {
                // Input (y, x) adds to output (2y − 1 + ky, 2x − 1 + kx).
                let taps = self.weights.len() / (self.in_channels * self.out_channels);
                for tap in 0..taps {
                    let [ky, kx] = [tap / taps.isqrt(), tap % taps.isqrt()].map(|tap| tap as isize);
                    let (y, x) = (row + 1 - ky, column + 1 - kx);
                    if y % 2 == 0 && x % 2 == 0 {
                        let weight = self.weights[(channel * self.out_channels + out) * taps + tap];
                        add(weight, pixel(input, y / 2, x / 2, channel));
                    }
                }
            }
        }
        sums
    }
}

/// What stands where a kernel must not write.
const UNTOUCHED: f32 = 777.0;

fn bits(plane: &Plane) -> Vec<u32> {
    plane.values().iter().map(|value| value.to_bits()).collect()
}

#[test]
fn random_convolutions_agree_with_the_definition_in_f64_and_touch_nothing_else() {
    let mut noise = Noise::new(1);
    for _ in 0..150 {
        let case = Case::random(&mut noise);
        let input = noise.plane(case.size.0, case.size.1, case.in_channels);
        for set in sets() {
            let output = case.run(set, &input);
            assert!(border_is_zero(&output), "{set}: {case:?}");
            for row in 0..output.height() {
                for column in 0..output.width() {
                    let pixel = &output.row(row)[column * output.channels()..][..output.channels()];
                    let (before, rest) = pixel.split_at(case.others[0]);
                    let (ours, after) = rest.split_at(case.out_channels);
                    let others = before.iter().chain(after);
                    assert!(
                        others.into_iter().all(|&value| value == UNTOUCHED),
                        "{set}: {case:?}"
                    );
                    for (out, &got) in ours.iter().enumerate() {
                        let (sum, size) = case.expected(&input, (row, column), out);
                        let expected = if case.relu { sum.max(0.0) } else { sum };
                        assert!(
                            (f64::from(got) - expected).abs() <= 3e-6 * size,
                            "{set}: {got} for {expected} at ({row}, {column}), channel {out}: {case:?}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn wide_vectors_agree_bit_by_bit_and_portable_to_1e_5() {
    let mut noise = Noise::new(2);
    for _ in 0..60 {
        let mut case = Case::random(&mut noise);
        case.others = [0, 0];
        let input = noise.plane(case.size.0, case.size.1, case.in_channels);
        let portable = case.run(InstructionSet::Portable, &input);
        let largest = portable
            .values()
            .iter()
            .fold(0f32, |largest, value| largest.max(value.abs()));
        let wide: Vec<Plane> = sets().skip(1).map(|set| case.run(set, &input)).collect();
        for output in &wide {
            for (&a, &b) in output.values().iter().zip(portable.values()) {
                assert!(
                    (a - b).abs() <= 1e-5 * largest,
                    "{a} and {b} of {largest}: {case:?}"
                );
            }
            assert!(bits(output) == bits(&wide[0]), "{case:?}");
        }
    }
}

#[test]
fn a_regions_bits_are_those_of_the_whole_and_outside_it_nothing_is_written() {
    let mut noise = Noise::new(3);
    for _ in 0..100 {
        let case = Case::random(&mut noise);
        let input = noise.plane(case.size.0, case.size.1, case.in_channels);
        for set in sets() {
            let all = case.run(set, &input);
            let mut part = case.untouched(set);
            let region = noise.region(part.size());
            convolve(
                &case.packed(set),
                None,
                &input,
                &mut part,
                case.others[0],
                &region,
            );
            for row in 0..all.height() {
                for column in 0..all.width() {
                    let at = |plane: &Plane, channel: usize| {
                        plane.row(row)[column * plane.channels() + case.others[0] + channel]
                    };
                    let inside = region.rows.contains(&row) && region.columns.contains(&column);
                    for channel in 0..case.out_channels {
                        let expected = if inside { at(&all, channel) } else { UNTOUCHED };
                        assert_eq!(
                            at(&part, channel).to_bits(),
                            expected.to_bits(),
                            "{set}: {case:?}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn what_a_changed_region_affects_is_no_smaller_than_what_changes() {
    let mut noise = Noise::new(4);
    for _ in 0..100 {
        let case = Case::random(&mut noise);
        let before = noise.plane(case.size.0, case.size.1, case.in_channels);
        let region = noise.region(case.size);
        let mut after = before.clone();
        for row in region.rows.clone() {
            let columns = region.columns.start * case.in_channels..region.columns.end * case.in_channels;
            after.row_mut(row)[columns].fill_with(|| noise.value());
        }
        let set = InstructionSet::widest();
        let (old, new) = (case.run(set, &before), case.run(set, &after));
        let affected = case.packed(set).affected(&region, old.size());
        for row in 0..old.height() {
            for column in 0..old.width() {
                let at =
                    |plane: &Plane| plane.row(row)[column * plane.channels()..][..plane.channels()].to_vec();
                let inside = affected.rows.contains(&row) && affected.columns.contains(&column);
                assert!(
                    inside || at(&old) == at(&new),
                    "({row}, {column}) of {region:?}: {case:?}"
                );
            }
        }
    }
}

#[test]
fn a_start_plane_gives_every_output_its_own_bias() {
    let mut noise = Noise::new(5);
    for set in sets() {
        for out_channels in [1, 8, 15, 16, 17, 24, 40] {
            let mut case = Case::random(&mut noise);
            (case.out_channels, case.others, case.relu) = (out_channels, [0, 0], false);
            case.kernel = Some(Kernel {
                size: 3,
                stride: 2,
                padding: 1,
            });
            case.weights = noise.values(out_channels * case.in_channels * 9);
            case.bias = vec![0.0; out_channels];
            let input = noise.plane(case.size.0, case.size.1, case.in_channels);
            let plain = case.run(set, &input);
            let start = noise.plane(
                plain.height(),
                plain.width(),
                out_channels.next_multiple_of(LANES_MAX),
            );
            let mut started = plain.clone();
            let region = whole(&plain);
            convolve(&case.packed(set), Some(&start), &input, &mut started, 0, &region);
            for row in 0..plain.height() {
                for (i, (&sum, &plain)) in started.row(row).iter().zip(plain.row(row)).enumerate() {
                    let (column, channel) = (i / out_channels, i % out_channels);
                    let bias = start.row(row)[column * start.channels() + channel];
                    assert!(
                        (sum - plain - bias).abs() < 2e-5,
                        "{set}: {sum} = {plain} + {bias}"
                    );
                }
            }
        }
    }
}

#[test]
fn denormals_are_computed_with_and_not_flushed() {
    let mut noise = Noise::new(6);
    for set in sets() {
        for _ in 0..20 {
            let mut case = Case::random(&mut noise);
            case.relu = false;
            case.bias.fill(0.0);
            if case.kernel.is_none() {
                continue;
            }
            let mut input = noise.plane(case.size.0, case.size.1, case.in_channels);
            for row in 0..input.height() {
                input.row_mut(row).iter_mut().for_each(|value| *value *= 1e-39);
            }
            let output = case.run(set, &input);
            // Each product is rounded to a multiple of the smallest denormal, at most.
            let taps = case.weights.len() / case.out_channels;
            let bound = f64::from(f32::from_bits(1)) * (taps + 1) as f64;
            let mut largest = 0f64;
            for row in 0..output.height() {
                for column in 0..output.width() {
                    let got = f64::from(output.row(row)[column * output.channels() + case.others[0]]);
                    let (expected, size) = case.expected(&input, (row, column), 0);
                    assert!(
                        (got - expected).abs() <= bound + 3e-6 * size,
                        "{set}: {got:e} for {expected:e}"
                    );
                    largest = largest.max(got.abs());
                }
            }
            assert!(largest > 0.0, "{set}: all flushed to zero");
        }
    }
}

#[test]
fn nan_and_infinity_reach_exactly_the_outputs_that_see_them() {
    let mut noise = Noise::new(7);
    for _ in 0..60 {
        let case = Case::random(&mut noise);
        let mut input = noise.plane(case.size.0, case.size.1, case.in_channels);
        let (row, column) = (noise.pick(0, case.size.0 - 1), noise.pick(0, case.size.1 - 1));
        let channel = noise.pick(0, case.in_channels - 1);
        let mut positive = case.clone();
        positive
            .weights
            .iter_mut()
            .for_each(|weight| *weight = weight.abs() + 0.1);
        for (bad, case) in [(f32::NAN, &case), (f32::INFINITY, &positive)] {
            input.row_mut(row)[column * case.in_channels + channel] = bad;
            for set in sets() {
                let output = case.run(set, &input);
                for y in 0..output.height() {
                    for x in 0..output.width() {
                        for out in 0..case.out_channels {
                            let got = output.row(y)[x * output.channels() + case.others[0] + out];
                            let expected = case.expected(&input, (y, x), out).0;
                            assert_eq!(got.is_nan(), expected.is_nan(), "{set} ({y}, {x}): {case:?}");
                            assert_eq!(
                                got.is_finite(),
                                expected.is_finite(),
                                "{set} ({y}, {x}): {case:?}"
                            );
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn relu_keeps_nan_and_gives_the_same_zeros_on_every_set() {
    let values = [f32::NAN, -0.0, 0.0, -1.0, 1.0, f32::NEG_INFINITY, -1e-42];
    let mut input = Plane::new(1, values.len(), 1);
    input.row_mut(0).copy_from_slice(&values);
    let shape = Shape {
        out_channels: 1,
        in_channels: 1,
        kernel: Kernel {
            size: 1,
            stride: 1,
            padding: 0,
        },
    };
    for set in sets() {
        let mut output = Plane::new(1, values.len(), 1);
        let region = whole(&output);
        convolve(
            &Convolution::forward(set, shape, &[1.0], &[-0.0], true),
            None,
            &input,
            &mut output,
            0,
            &region,
        );
        let got = output.row(0);
        assert!(got[0].is_nan(), "{set}");
        let expected = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0].map(f32::to_bits);
        assert_eq!(
            got[1..].iter().map(|value| value.to_bits()).collect::<Vec<_>>(),
            expected,
            "{set}"
        );
    }
}

#[test]
fn nothing_in_is_nothing_out() {
    let kernel = Kernel {
        size: 3,
        stride: 1,
        padding: 1,
    };
    for set in sets() {
        for (height, width) in [(0, 0), (0, 5), (5, 0), (2, 2)] {
            for (in_channels, out_channels) in [(0, 3), (3, 0), (0, 0), (1, 17)] {
                let shape = Shape {
                    out_channels,
                    in_channels,
                    kernel,
                };
                let weights = vec![1.0; out_channels * in_channels * 9];
                let convolution = Convolution::forward(set, shape, &weights, &vec![0.5; out_channels], false);
                let (height_out, width_out) = convolution.out_size((height, width));
                let mut output = Plane::new(height_out, width_out, out_channels);
                let input = Plane::new(height, width, in_channels);
                let region = whole(&output);
                convolve(&convolution, None, &input, &mut output, 0, &region);
                // Inputs are zero or absent, so what is left is the bias.
                assert!((0..height_out).all(|row| {
                    output
                        .row(row)
                        .iter()
                        .all(|value| value.to_bits() == 0.5f32.to_bits())
                }));
                convolve(&convolution, None, &input, &mut output, 0, &Region::EMPTY);
            }
        }
    }
}

/// A 3×3 convolution from 4 channels to 8.
fn plain() -> Convolution {
    let shape = Shape {
        out_channels: 8,
        in_channels: 4,
        kernel: Kernel {
            size: 3,
            stride: 1,
            padding: 1,
        },
    };
    Convolution::forward(InstructionSet::widest(), shape, &[0.0; 288], &[0.0; 8], true)
}

#[test]
#[should_panic(expected = "channels of the input")]
fn an_input_with_other_channels_is_refused() {
    let region = Region::whole(5, 5);
    convolve(
        &plain(),
        None,
        &Plane::new(5, 5, 3),
        &mut Plane::new(5, 5, 8),
        0,
        &region,
    );
}

#[test]
#[should_panic(expected = "channels of the output")]
fn an_output_without_room_for_the_channels_is_refused() {
    let region = Region::whole(5, 5);
    convolve(
        &plain(),
        None,
        &Plane::new(5, 5, 4),
        &mut Plane::new(5, 5, 15),
        8,
        &region,
    );
}

#[test]
#[should_panic(expected = "in an output of 5 x 5")]
fn a_region_outside_the_output_is_refused() {
    let region = Region::whole(5, 6);
    convolve(
        &plain(),
        None,
        &Plane::new(5, 5, 4),
        &mut Plane::new(5, 5, 8),
        0,
        &region,
    );
}

#[test]
#[should_panic(expected = "size of the input")]
fn an_output_that_needs_a_larger_input_is_refused() {
    let region = Region::whole(6, 6);
    convolve(
        &plain(),
        None,
        &Plane::new(5, 5, 4),
        &mut Plane::new(6, 6, 8),
        0,
        &region,
    );
}

#[test]
#[should_panic(expected = "channels of the start")]
fn a_start_without_whole_vectors_is_refused() {
    let (start, region) = (Plane::new(5, 5, 7), Region::whole(5, 5));
    convolve(
        &plain(),
        Some(&start),
        &Plane::new(5, 5, 4),
        &mut Plane::new(5, 5, 8),
        0,
        &region,
    );
}

#[test]
#[should_panic(expected = "channels of the input")]
fn a_step_that_reads_what_it_writes_is_refused() {
    let mut plan = Plan::default();
    let plane = plan.plane(5, 5, 8);
    let convolution = {
        let shape = Shape {
            out_channels: 8,
            in_channels: 8,
            kernel: Kernel {
                size: 3,
                stride: 1,
                padding: 1,
            },
        };
        Convolution::forward(InstructionSet::widest(), shape, &[0.0; 576], &[0.0; 8], true)
    };
    plan.convolve(convolution, plane, plane, 0);
    plan.run();
}

#[test]
fn pooling_takes_the_largest_of_four_and_leaves_an_odd_edge_out() {
    for (height, width) in [(2, 2), (5, 7), (20, 20), (11, 4), (1, 1)] {
        let input = Noise::new(height + width).plane(height, width, 12);
        let mut output = Plane::new(height / 2, width / 2, 7);
        let region = whole(&output);
        max_pool(&input, 5, &mut output, &region);
        for row in 0..height / 2 {
            for column in 0..width / 2 {
                for channel in 0..7 {
                    let corner = |i: usize| {
                        let (y, x) = (2 * row + i / 2, 2 * column + i % 2);
                        pixel(&input, y as isize, x as isize, channel + 5)
                    };
                    let expected = (0..4).map(corner).fold(f64::NEG_INFINITY, f64::max);
                    let got = output.row(row)[column * 7 + channel];
                    assert_eq!(got.to_bits(), (expected as f32).to_bits());
                }
            }
        }
        assert!(border_is_zero(&output));
    }
}

#[test]
fn pooling_passes_nan_on_from_every_corner() {
    for corner in 0..4 {
        let mut input = Noise::new(corner).plane(2, 2, 3);
        input.row_mut(corner / 2)[corner % 2 * 3 + 1] = f32::NAN;
        let mut output = Plane::new(1, 1, 3);
        max_pool(&input, 0, &mut output, &Region::whole(1, 1));
        assert_eq!(
            output
                .row(0)
                .iter()
                .map(|value| value.is_nan())
                .collect::<Vec<_>>(),
            [false, true, false]
        );
    }
}

/// A small encoder–decoder with every kind of step.
fn network(set: InstructionSet, (height, width): (usize, usize)) -> (Plan, PlaneId, PlaneId) {
    let mut noise = Noise::new(8);
    let mut forward = |in_channels: usize, out_channels: usize, stride, padding| {
        let shape = Shape {
            out_channels,
            in_channels,
            kernel: Kernel {
                size: 3,
                stride,
                padding,
            },
        };
        let weights = noise.values(out_channels * in_channels * 9);
        Convolution::forward(set, shape, &weights, &noise.values(out_channels), true)
    };
    let mut plan = Plan::default();
    let input = plan.plane(2 * height, 2 * width, 2);
    let joined = plan.plane(height, width, 5 + 11);
    let a = plan.convolved(forward(2, 7, 2, 1), input);
    plan.convolve(forward(7, 11, 1, 1), a, joined, 5);
    let b = plan.pooled(joined, 5, 11);
    let b = plan.convolved(forward(11, 18, 1, 1), b);
    let mut noise = Noise::new(9);
    let up = Convolution::transposed(set, 18, 5, &noise.values(18 * 5 * 9), &noise.values(5));
    plan.convolve(up, b, joined, 0);
    let output = plan.convolved(forward(16, 3, 1, 0), joined);
    (plan, input, output)
}

#[test]
fn a_plan_that_skips_has_the_bits_of_one_that_computes_everything() {
    let mut noise = Noise::new(10);
    for set in sets() {
        let (mut skipping, input, output) = network(set, (8, 12));
        let (fresh, ..) = network(set, (8, 12));
        for _ in 0..40 {
            let region = noise.region((16, 24));
            for row in region.rows.clone() {
                let columns = region.columns.start * 2..region.columns.end * 2;
                skipping.values_mut(input).row_mut(row)[columns].fill_with(|| noise.value());
            }
            skipping.mark_dirty(input, &region);
            skipping.run();
            let mut dense = fresh.clone();
            *dense.values_mut(input) = skipping.values(input).clone();
            dense.run();
            assert!(
                bits(skipping.values(output)) == bits(dense.values(output)),
                "{set}: {region:?}"
            );
        }
        let before = bits(skipping.values(output));
        skipping.run();
        assert!(bits(skipping.values(output)) == before);
    }
}

#[test]
fn a_plan_computes_only_what_a_change_reaches() {
    let (mut plan, input, output) = network(InstructionSet::widest(), (8, 12));
    plan.run();
    // A value that no step would write shows what is recomputed.
    plan.values_mut(output).row_mut(0).fill(UNTOUCHED);
    plan.run();
    assert!(plan.values(output).row(0).iter().all(|&value| value == UNTOUCHED));
    plan.mark_dirty(
        input,
        &Region {
            rows: 0..1,
            columns: 0..1,
        },
    );
    plan.run();
    let row = plan.values(output).row(0);
    assert!(row[0] != UNTOUCHED && row[row.len() - 1] == UNTOUCHED);
}

#[test]
fn multiply_adds_are_counted_as_the_definition_counts_them() {
    let (plan, input, _) = network(InstructionSet::widest(), (8, 12));
    let expected = 96 * 9 * 2 * 7 + 96 * 9 * 7 * 11 + 24 * 9 * 11 * 18 + 24 * 9 * 18 * 5 + 60 * 9 * 16 * 3;
    assert_eq!(plan.multiply_adds(input), expected);
}
