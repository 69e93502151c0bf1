//! Every instruction set of this processor against plain loops.
#![expect(
    clippy::inline_always,
    reason = "an operation compiles for the instruction set of the function that it is inlined into"
)]

use gripline_kernels::InstructionSet;
use gripline_kernels::simd::{
    Accumulator, Dispatch, F32x8, Int16Pair, LANES_MAX, Number, Simd, TABLE, Vector, accumulate, dispatch,
    round,
};

use super::sets;

const NUMBERS: [f32; 8] = [-2.5, 1.75, 0.5, -0.5, 3.0, 0.499_999_97, -1e3, 2.499_999_8];

/// Every operation on eight f32, in one list.
struct Everything;

impl Dispatch for Everything {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run<S: Simd>(self) -> Vec<f32> {
        let mut table = [0; TABLE + 2];
        for (k, entry) in table.iter_mut().enumerate() {
            *entry = (k * k + 30_000) as u16;
        }
        let a = S::F32x8::load(&NUMBERS);
        let b = S::F32x8::load(&[7.0, 0.1, 255.0, 256.0, 1.0, -1.0, 300.0, 99.0]);
        let grey = S::F32x8::from_u8([0, 1, 127, 128, 200, 254, 255, 3]);
        let results = [
            a.add(b),
            a.subtract(b),
            a.multiply(b),
            a.abs(),
            a.round(),
            b.gather(&table),
            a.select_less(b, grey, S::F32x8::splat(-9.0)),
            grey,
        ];
        let mut numbers = vec![a.sum(), b.sum(), grey.multiply(a).sum()];
        for result in results {
            let mut eight = [0.0; 8];
            result.store(&mut eight);
            // −0 and 0 are equal.
            numbers.extend(eight.map(|number| number + 0.0));
        }
        numbers
    }
}

#[test]
fn eight_at_a_time_give_the_same_as_one_at_a_time() {
    let plain = dispatch(InstructionSet::Portable, Everything);
    let sum = (-2.5 + 3.0) + (0.5 - 1e3) + ((1.75 + 0.499_999_97) + (-0.5 + 2.499_999_8));
    assert_eq!(plain[..1], [sum]);
    assert_eq!(
        plain[35..43],
        [-3.0, 2.0, 1.0, -1.0, 3.0, 0.0, -1e3, 2.0],
        "round"
    );
    // 7 in the table, 0 for a tenth, 255, and 0 again for 256.
    assert_eq!(plain[43..47], [30_049.0, 30_000.0, 29_489.0, 30_000.0]);
    assert_eq!(plain[51..55], [0.0, -9.0, 127.0, 128.0], "select_less");
    for set in sets() {
        assert_eq!(dispatch(set, Everything), plain, "{set}");
    }
}

/// The smallest of eight numbers, with the smallest in each place.
struct Smallest;

impl Dispatch for Smallest {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run<S: Simd>(self) -> Vec<f32> {
        let mut smallest = Vec::new();
        for place in 0..8 {
            let mut numbers = [7.0, f32::INFINITY, -1.5, 3.0, 1e9, 0.0, -1.25, 2.0];
            numbers[place] = -2.0 - place as f32;
            smallest.push(S::F32x8::load(&numbers).min());
        }
        smallest.push(S::F32x8::splat(f32::INFINITY).min());
        smallest
    }
}

#[test]
fn the_smallest_lane_is_found_in_every_place() {
    for set in sets() {
        let expected = [-2.0, -3.0, -4.0, -5.0, -6.0, -7.0, -8.0, -9.0, f32::INFINITY];
        assert_eq!(dispatch(set, Smallest), expected, "{set}");
    }
}

#[test]
fn rounding_is_that_of_the_standard_library() {
    for sixteenth in -2_000_i16..=2_000 {
        let value = f32::from(sixteenth) / 16.0;
        for value in [value.next_down(), value, value.next_up()] {
            assert_eq!(round(value), value.round() as i32, "{value}");
        }
    }
}

struct Sad<'a> {
    template: [[u8; 8]; 7],
    pixels: &'a [u8],
    stride: usize,
}

impl Dispatch for Sad<'_> {
    type Output = [u16; 8];

    #[inline(always)]
    fn run<S: Simd>(self) -> [u16; 8] {
        S::sad_x8(&self.template, self.pixels, self.stride)
    }
}

#[test]
fn sums_of_absolute_differences_are_those_of_a_plain_loop_up_to_the_largest() {
    const STRIDE: usize = 440;
    let mut image: Vec<u8> = (0..STRIDE * 440)
        .map(|i| (i * i % 251 + i / 7 % 5) as u8)
        .collect();
    image[..100 * STRIDE].fill(255);
    for place in [0, 5 * STRIDE + 3, 110 * STRIDE + 200, 97 * STRIDE + 430] {
        for template in [
            [[0; 8]; 7],
            std::array::from_fn(|row| std::array::from_fn(|k| (row * 37 + k * k * 5) as u8)),
        ] {
            let pixels = &image[place..];
            let expected: [u16; 8] = std::array::from_fn(|right| {
                (0..56)
                    .map(|i| {
                        let pixel = pixels[i / 8 * STRIDE + i % 8 + right];
                        u16::from(template[i / 8][i % 8].abs_diff(pixel))
                    })
                    .sum()
            });
            for set in sets() {
                let sad = Sad {
                    template,
                    pixels,
                    stride: STRIDE,
                };
                assert_eq!(dispatch(set, sad), expected, "{set}");
            }
        }
    }
    let black_on_white = Sad {
        template: [[0; 8]; 7],
        pixels: &image,
        stride: STRIDE,
    };
    assert_eq!(dispatch(InstructionSet::Portable, black_on_white), [255 * 56; 8]);
}

struct MinSum([u16; 8], [u16; 8]);

impl Dispatch for MinSum {
    type Output = (u16, usize);

    #[inline(always)]
    fn run<S: Simd>(self) -> (u16, usize) {
        S::min_sum(&self.0, &self.1)
    }
}

#[test]
fn the_smallest_sum_is_the_first_of_equal_ones_and_saturates() {
    let of = |set, a, b| dispatch(set, MinSum(a, b));
    for set in sets() {
        assert_eq!(
            of(set, [9, 5, 7, 4, 4, 8, 9, 9], [0, 0, 0, 1, 1, 0, 0, 0]),
            (5, 1),
            "{set}"
        );
        assert_eq!(of(set, [u16::MAX; 8], [9; 8]).0, u16::MAX, "{set}");
    }
}

/// Three pixels' sums of sixteen inputs each, two vectors of them.
struct Products<'a> {
    weights: &'a [Int16Pair],
    inputs: &'a [Int16Pair],
}

impl Dispatch for Products<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run<S: Simd>(self) -> Vec<f32> {
        let lanes = <<S::Int16 as Accumulator>::Out as Vector>::LANES;
        let mut sums = [[S::Int16::zero(); 2]; 3];
        accumulate::<S::Int16, 3, 2, 1>(&mut sums, &self.weights[..2 * lanes * 16], self.inputs, 16, 16);
        let mut out = vec![0.0; 6 * lanes];
        for (out, sum) in out.chunks_exact_mut(lanes).zip(sums.as_flattened()) {
            sum.scale(&[1.0; LANES_MAX]).store(out);
        }
        out
    }
}

#[test]
fn products_of_int16_are_exact_with_one_instruction_and_with_two() {
    let mut state = 1_u64;
    let mut pair = || {
        Int16Pair([0; 2].map(|_| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            // Sums stay below 2²⁴, which f32 holds exactly, but for a few large products.
            (state >> 56) as i16 - 128
        }))
    };
    let weights: Vec<Int16Pair> = (0..2 * LANES_MAX * 16).map(|_| pair()).collect();
    let mut inputs: Vec<Int16Pair> = (0..3 * 16).map(|_| pair()).collect();
    inputs[0] = Int16Pair([i16::MAX, i16::MIN]);
    let products = || Products {
        weights: &weights,
        inputs: &inputs,
    };
    let expected = |lanes: usize| -> Vec<f32> {
        (0..3)
            .flat_map(|pixel| (0..2 * lanes).map(move |lane| (pixel, lane)))
            .map(|(pixel, lane)| {
                let sum: i32 = (0..16)
                    .map(|k| {
                        let ([a, b], [c, d]) = (inputs[16 * pixel + k].0, weights[2 * lanes * k + lane].0);
                        i32::from(a) * i32::from(c) + i32::from(b) * i32::from(d)
                    })
                    .sum();
                sum as f32
            })
            .collect()
    };
    for set in sets() {
        let with_two = dispatch(set, products());
        assert_eq!(with_two, expected(with_two.len() / 6), "{set}");
        if set != InstructionSet::Avx512 || Int16Pair::has_avx512() {
            let as_layers_do = Int16Pair::dispatch(set, products());
            assert_eq!(as_layers_do, expected(as_layers_do.len() / 6), "{set}");
        }
    }
}

struct Blocks<'a>([&'a [u8; 40]; 5]);

impl Dispatch for Blocks<'_> {
    type Output = [u16; 8];

    #[inline(always)]
    fn run<S: Simd>(self) -> [u16; 8] {
        S::sums_5x5_x8(self.0)
    }
}

#[test]
fn every_pixel_counts_once_and_in_its_own_block() {
    for set in sets() {
        let white = [255; 40];
        assert_eq!(dispatch(set, Blocks([&white; 5])), [25 * 255; 8], "{set}");
        for (row, column) in (0..5).flat_map(|row| (0..40).map(move |column| (row, column))) {
            let mut pixels = [[0; 40]; 5];
            pixels[row][column] = 201;
            let mut expected = [0; 8];
            expected[column / 5] = 201;
            assert_eq!(
                dispatch(set, Blocks(pixels.each_ref())),
                expected,
                "{set}, pixel ({row}, {column})"
            );
        }
    }
}
