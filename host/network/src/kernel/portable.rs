//! The kernels in portable Rust, written so that the compiler keeps [`PIXELS`] × [`BLOCK`] sums in vector
//! registers on any target (SSE2 is the floor on x86-64; no fused multiply-add, so that every machine
//! computes the same bits).

use super::{BLOCK, Convolution, Lanes, Phase, Plane};

/// Output pixels computed together. Five, because the rows that cost most have 20, 10 or 5 pixels, and
/// five pixels × two SSE registers leave room in sixteen for the weights and one product.
pub(crate) const PIXELS: usize = 5;

/// Runs a convolution; writes the output's channels from `out_channel` on.
pub(crate) fn convolve(convolution: &Convolution, input: &Plane, output: &mut Plane, out_channel: usize) {
    convolve_from(convolution, input, output, out_channel, |block, _| {
        convolution.bias[block]
    });
}

/// Like [`convolve`], with a bias of its own for every output pixel: `bias[pixel * blocks + block]`, pixels
/// row-major.
pub(crate) fn convolve_with_bias_map(
    convolution: &Convolution,
    bias: &[Lanes],
    input: &Plane,
    output: &mut Plane,
) {
    let blocks = convolution.bias.len();
    convolve_from(convolution, input, output, 0, |block, pixel| {
        bias[pixel * blocks + block]
    });
}

#[inline]
fn convolve_from(
    convolution: &Convolution,
    input: &Plane,
    output: &mut Plane,
    out_channel: usize,
    bias: impl Fn(usize, usize) -> Lanes + Copy,
) {
    debug_assert_eq!(input.channels(), convolution.in_channels);
    for phase in &convolution.phases {
        let height = (output.height() - phase.out_start.0).div_ceil(phase.out_step);
        for block in 0..convolution.bias.len() {
            for y in 0..height {
                row(convolution, phase, (block, y), input, output, out_channel, bias);
            }
        }
    }
}

/// One row of output pixels of one phase and one block of channels.
#[inline]
fn row(
    convolution: &Convolution,
    phase: &Phase,
    (block, y): (usize, usize),
    input: &Plane,
    output: &mut Plane,
    out_channel: usize,
    bias: impl Fn(usize, usize) -> Lanes,
) {
    let width = (output.width() - phase.out_start.1).div_ceil(phase.out_step);
    let out_row = phase.out_start.0 + y * phase.out_step;
    let out_pixels = output.width();
    let out_channels = output.channels();
    let first_channel = out_channel + block * BLOCK;
    let line = output.row_mut(out_row);
    let per_block = phase.weights.len() / convolution.bias.len();
    let weights = &phase.weights[block * per_block..(block + 1) * per_block];

    let out_column = |x: usize| phase.out_start.1 + x * phase.out_step;
    let mut store = |x: usize, mut sums: Lanes| {
        if convolution.relu {
            sums = sums.map(|sum| if sum > 0.0 { sum } else { 0.0 });
        }
        let start = out_column(x) * out_channels + first_channel;
        line[start..start + BLOCK].copy_from_slice(&sums);
    };
    let start = |x: usize| bias(block, out_row * out_pixels + out_column(x));

    if width >= PIXELS {
        let mut x = 0;
        loop {
            let sums = pixels::<PIXELS>(phase, weights, convolution.in_channels, input, y, x, &start);
            for (p, sums) in sums.into_iter().enumerate() {
                store(x + p, sums);
            }
            if x + PIXELS == width {
                break;
            }
            // The last group overlaps the one before it rather than running one pixel at a time.
            x = (x + PIXELS).min(width - PIXELS);
        }
    } else {
        for x in 0..width {
            let [sums] = pixels::<1>(phase, weights, convolution.in_channels, input, y, x, &start);
            store(x, sums);
        }
    }
}

/// The sums of `P` neighbouring output pixels.
#[inline]
fn pixels<const P: usize>(
    phase: &Phase,
    weights: &[Lanes],
    in_channels: usize,
    input: &Plane,
    y: usize,
    x: usize,
    start: &impl Fn(usize) -> Lanes,
) -> [Lanes; P] {
    let mut sums: [Lanes; P] = std::array::from_fn(|p| start(x + p));
    let mut weights = weights;
    for taps in &phase.rows {
        let run = taps.taps * in_channels;
        let (these, rest) = weights.split_at(run);
        weights = rest;
        let first =
            (taps.row + y * phase.in_step) * input.stride() + (taps.column + x * phase.in_step) * in_channels;
        let step = phase.in_step * in_channels;
        let inputs: [&[f32]; P] = std::array::from_fn(|p| &input.values()[first + p * step..][..run]);
        for (i, weight) in these.iter().enumerate() {
            for p in 0..P {
                let value = inputs[p][i];
                for lane in 0..BLOCK {
                    sums[p][lane] += value * weight[lane];
                }
            }
        }
    }
    sums
}

/// 2×2 maximum with stride 2 over the input's channels from `in_channel` on; the output's channels say how
/// many. A last odd row or column of the input is left out.
pub(crate) fn max_pool(input: &Plane, in_channel: usize, output: &mut Plane) {
    let (wide, channels) = (input.channels(), output.channels());
    for y in 0..output.height() {
        let (top, bottom) = (input.row(2 * y), input.row(2 * y + 1));
        let line = output.row_mut(y);
        for (x, out) in line.chunks_exact_mut(channels).enumerate() {
            let left = 2 * x * wide + in_channel;
            let right = left + wide;
            let corners = [
                &top[left..left + channels],
                &top[right..right + channels],
                &bottom[left..left + channels],
                &bottom[right..right + channels],
            ];
            for (channel, out) in out.iter_mut().enumerate() {
                let larger = |a: f32, b: f32| if a > b { a } else { b };
                *out = larger(
                    larger(corners[0][channel], corners[1][channel]),
                    larger(corners[2][channel], corners[3][channel]),
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::{Kernel, Shape};

    /// Numbers in ±1 that repeat in no pattern a convolution could hide behind.
    fn noise(seed: usize) -> impl FnMut() -> f32 {
        let mut state = (seed as u32).wrapping_mul(2_654_435_761).wrapping_add(1);
        move || {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            state as f32 / u32::MAX as f32 * 2.0 - 1.0
        }
    }

    fn filled(height: usize, width: usize, channels: usize, value: &mut impl FnMut() -> f32) -> Plane {
        let mut plane = Plane::new(height, width, channels);
        for row in 0..height {
            plane.row_mut(row).fill_with(&mut *value);
        }
        plane
    }

    /// The pixel's channel in f64, zero outside the image.
    fn pixel(plane: &Plane, row: isize, column: isize, channel: usize) -> f64 {
        let inside =
            (0..plane.height() as isize).contains(&row) && (0..plane.width() as isize).contains(&column);
        if inside {
            f64::from(plane.row(row as usize)[column as usize * plane.channels() + channel])
        } else {
            0.0
        }
    }

    fn border_is_zero(plane: &Plane) -> bool {
        let inside: f64 = (0..plane.height())
            .flat_map(|row| plane.row(row))
            .map(|&value| f64::from(value).abs())
            .sum();
        let all: f64 = plane.values().iter().map(|&value| f64::from(value).abs()).sum();
        (all - inside).abs() < 1e-9
    }

    fn assert_close(got: f32, expected: f64, what: &str) {
        assert!(
            (f64::from(got) - expected).abs() < 1e-5 * (1.0 + expected.abs()),
            "{what}: {got} for {expected}"
        );
    }

    #[test]
    fn convolutions_of_any_size_stride_and_padding_agree_with_the_definition_in_f64() {
        for (case, (kernel, stride, padding)) in [
            (3, 1, 1),
            (3, 1, 0),
            (3, 2, 1),
            (3, 2, 0),
            (1, 1, 0),
            (5, 1, 1),
            (3, 3, 1),
        ]
        .into_iter()
        .enumerate()
        {
            for (height, width) in [(5, 5), (7, 6), (9, 13), (20, 11), (6, 22)] {
                for (in_channels, out_channels, relu) in [(1, 8, true), (2, 3, false), (5, 19, true)] {
                    let mut value = noise(case * 100 + height * width + in_channels);
                    let input = filled(height, width, in_channels, &mut value);
                    let weights: Vec<f32> = (0..out_channels * in_channels * kernel * kernel)
                        .map(|_| value())
                        .collect();
                    let bias: Vec<f32> = (0..out_channels).map(|_| value()).collect();
                    let shape = Shape {
                        out_channels,
                        in_channels,
                        kernel: Kernel {
                            size: kernel,
                            stride,
                            padding,
                        },
                    };
                    let convolution = Convolution::forward(shape, &weights, &bias, relu);
                    let size = |side: usize| (side + 2 * padding - kernel) / stride + 1;
                    let before = BLOCK;
                    let mut output = Plane::new(
                        size(height),
                        size(width),
                        before + out_channels.next_multiple_of(BLOCK),
                    );
                    convolve(&convolution, &input, &mut output, before);

                    assert!(border_is_zero(&output));
                    for row in 0..output.height() {
                        for column in 0..output.width() {
                            for (out, &bias) in bias.iter().enumerate() {
                                let mut expected = f64::from(bias);
                                for (i, &weight) in weights.iter().enumerate() {
                                    let (ky, kx) = (i / kernel % kernel, i % kernel);
                                    let channel = i / (kernel * kernel) % in_channels;
                                    if i / (kernel * kernel * in_channels) == out {
                                        let y = (row * stride + ky) as isize - padding as isize;
                                        let x = (column * stride + kx) as isize - padding as isize;
                                        expected += f64::from(weight) * pixel(&input, y, x, channel);
                                    }
                                }
                                let expected = if relu { expected.max(0.0) } else { expected };
                                let got = output.row(row)[column * output.channels() + before + out];
                                assert_close(
                                    got,
                                    expected,
                                    &format!("{shape:?} {height}x{width} ({row}, {column})"),
                                );
                            }
                            let others = &output.row(row)[column * output.channels()..][..before];
                            assert!(
                                others.iter().all(|&value| value == 0.0),
                                "wrote another layer's channels"
                            );
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn doubling_agrees_with_scattering_every_input_in_f64() {
        for (height, width) in [(1, 1), (2, 3), (5, 5), (7, 4), (10, 11)] {
            for (in_channels, out_channels) in [(1, 8), (3, 5), (8, 16)] {
                let mut value = noise(height * 31 + width + in_channels);
                let input = filled(height, width, in_channels, &mut value);
                let weights: Vec<f32> = (0..in_channels * out_channels * 9).map(|_| value()).collect();
                let bias: Vec<f32> = (0..out_channels).map(|_| value()).collect();
                let convolution = Convolution::doubling(in_channels, out_channels, &weights, &bias);
                let mut output = Plane::new(2 * height, 2 * width, out_channels.next_multiple_of(BLOCK));
                convolve(&convolution, &input, &mut output, 0);

                // Transposed convolution by its definition: input (y, x) adds to output (2y − 1 + ky, …).
                let mut expected = vec![0.0; 4 * height * width * out_channels];
                for y in 0..height {
                    for x in 0..width {
                        for (i, &weight) in weights.iter().enumerate() {
                            let (ky, kx) = (i / 3 % 3, i % 3);
                            let (channel, out) = (i / 9 / out_channels, i / 9 % out_channels);
                            let (Some(row), Some(column)) =
                                ((2 * y + ky).checked_sub(1), (2 * x + kx).checked_sub(1))
                            else {
                                continue;
                            };
                            if row < 2 * height && column < 2 * width {
                                expected[(row * 2 * width + column) * out_channels + out] +=
                                    f64::from(weight) * pixel(&input, y as isize, x as isize, channel);
                            }
                        }
                    }
                }
                for row in 0..2 * height {
                    for column in 0..2 * width {
                        for (out, &bias) in bias.iter().enumerate() {
                            let sum = expected[(row * 2 * width + column) * out_channels + out];
                            let got = output.row(row)[column * output.channels() + out];
                            assert_close(
                                got,
                                (sum + f64::from(bias)).max(0.0),
                                &format!("({row}, {column})"),
                            );
                        }
                    }
                }
                assert!(border_is_zero(&output));
            }
        }
    }

    #[test]
    fn a_bias_map_adds_its_own_entry_to_every_output() {
        let mut value = noise(5);
        let input = filled(9, 7, 2, &mut value);
        let shape = Shape {
            out_channels: 16,
            in_channels: 2,
            kernel: Kernel {
                size: 3,
                stride: 2,
                padding: 1,
            },
        };
        let weights: Vec<f32> = (0..16 * 2 * 9).map(|_| value()).collect();
        let convolution = Convolution::forward(shape, &weights, &[0.0; 16], false);
        let map: Vec<Lanes> = (0..5 * 4 * 2).map(|_| std::array::from_fn(|_| value())).collect();
        let (mut plain, mut mapped) = (Plane::new(5, 4, 16), Plane::new(5, 4, 16));
        convolve(&convolution, &input, &mut plain, 0);
        convolve_with_bias_map(&convolution, &map, &input, &mut mapped);
        for (i, bias) in map.as_flattened().iter().enumerate() {
            let (row, place) = (i / 64, i % 64);
            assert_close(
                mapped.row(row)[place],
                f64::from(plain.row(row)[place]) + f64::from(*bias),
                "entry",
            );
        }
    }

    #[test]
    fn pooling_takes_the_largest_of_four_and_leaves_an_odd_edge_out() {
        for (height, width) in [(2, 2), (5, 7), (20, 20), (11, 4)] {
            let mut value = noise(height + width);
            let input = filled(height, width, 12, &mut value);
            let mut output = Plane::new(height / 2, width / 2, 8);
            max_pool(&input, 4, &mut output);
            for row in 0..height / 2 {
                for column in 0..width / 2 {
                    for channel in 0..8 {
                        let corner = |i: usize| {
                            pixel(
                                &input,
                                (2 * row + i / 2) as isize,
                                (2 * column + i % 2) as isize,
                                channel + 4,
                            )
                        };
                        let expected = (0..4).map(corner).fold(f64::NEG_INFINITY, f64::max);
                        let got = output.row(row)[column * 8 + channel];
                        assert_eq!(got.to_bits(), (expected as f32).to_bits());
                    }
                }
            }
            assert!(border_is_zero(&output));
        }
    }
}
