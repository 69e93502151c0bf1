//! From the coefficients of a block to its grey levels: the inverse cosine transform (ITU-T T.81, A.3.3), pure.
//!
//! The two passes are the factored one of Arai, Agui and Nakajima (1988), five products for eight numbers, eight at a time; what
//! it leaves out is in the steps of quantisation. In floating point: nothing is lost before the one rounding at the end.

use std::f32::consts::SQRT_2;

use super::header::COEFFICIENTS;

/// Side of a block, pixels.
pub(super) const BLOCK: usize = 8;
/// Eight numbers that are worked on at once.
type Lanes = [f32; BLOCK];
/// A block.
pub(super) type Pixels = [[u8; BLOCK]; BLOCK];

/// What one axis is scaled by: 1, then cos(kπ/16)·√2.
const SCALE: Lanes = [
    1.0,
    1.387_039_8,
    1.306_563,
    1.175_875_6,
    1.0,
    0.785_694_96,
    0.541_196_1,
    0.275_899_38,
];
/// The middle of the grey levels.
const MIDDLE: f32 = 128.0;
/// Added to a small number, it leaves the nearest whole number in the lowest bits: 1.5 · 2²³.
const WHOLE: f32 = 12_582_912.0;

/// Coefficients of a block, column after column of the picture's frequencies: entry 8·u + v is u waves across and v down.
pub(super) type Block = [f32; COEFFICIENTS];

/// Where the coefficients of the zigzag stand in a [`Block`] (figure A.6, transposed); beyond the last, the last.
#[rustfmt::skip]
pub(super) const PLACES: [u8; 2 * COEFFICIENTS] = {
    const DOWN_FIRST: [u8; COEFFICIENTS] = [
         0,  8,  1,  2,  9, 16, 24, 17, 10,  3,  4, 11, 18, 25, 32, 40,
        33, 26, 19, 12,  5,  6, 13, 20, 27, 34, 41, 48, 56, 49, 42, 35,
        28, 21, 14,  7, 15, 22, 29, 36, 43, 50, 57, 58, 51, 44, 37, 30,
        23, 31, 38, 45, 52, 59, 60, 53, 46, 39, 47, 54, 61, 62, 55, 63,
    ];
    let mut places = [63; 2 * COEFFICIENTS];
    let mut at = 0;
    while at < COEFFICIENTS {
        places[at] = DOWN_FIRST[at];
        at += 1;
    }
    places
};

/// What a coefficient of the zigzag is multiplied by: its step, and the scales of both axes.
pub(super) fn factors(steps: &[u16; COEFFICIENTS]) -> [f32; 2 * COEFFICIENTS] {
    let mut factors = [0.0; 2 * COEFFICIENTS];
    for ((factor, step), place) in factors.iter_mut().zip(steps).zip(PLACES) {
        let place = usize::from(place);
        *factor = f32::from(*step) * SCALE[place / BLOCK] * SCALE[place % BLOCK] / 8.0;
    }
    factors
}

/// A block of one grey level.
pub(super) fn flat(first: f32) -> Pixels {
    [[level(first); BLOCK]; BLOCK]
}

/// Grey levels of a block, row after row.
pub(super) fn pixels(block: &Block) -> Pixels {
    let (rows, _) = block.as_chunks::<BLOCK>();
    let mut across = [[0.0; BLOCK]; BLOCK];
    across.copy_from_slice(rows);
    let across = pass(&across);
    let mut turned = [[0.0; BLOCK]; BLOCK];
    for (x, lanes) in across.iter().enumerate() {
        for (v, number) in lanes.iter().enumerate() {
            turned[v][x] = *number;
        }
    }
    let mut pixels = [[0; BLOCK]; BLOCK];
    for (row, numbers) in pixels.iter_mut().zip(pass(&turned)) {
        for (pixel, number) in row.iter_mut().zip(numbers) {
            *pixel = level(number);
        }
    }
    pixels
}

fn level(number: f32) -> u8 {
    let level = number + MIDDLE;
    let level = if level > 0.0 { level } else { 0.0 };
    let level = if level < 255.0 { level } else { 255.0 };
    (level + WHOLE).to_bits() as u8
}

fn plus(a: &Lanes, b: &Lanes) -> Lanes {
    std::array::from_fn(|i| a[i] + b[i])
}

fn minus(a: &Lanes, b: &Lanes) -> Lanes {
    std::array::from_fn(|i| a[i] - b[i])
}

fn times(a: &Lanes, factor: f32) -> Lanes {
    std::array::from_fn(|i| a[i] * factor)
}

/// Eight transforms of eight numbers: `input[k]` has the k-th number of each.
#[inline]
fn pass(input: &[Lanes; BLOCK]) -> [Lanes; BLOCK] {
    let [i0, i1, i2, i3, i4, i5, i6, i7] = input;
    // Even numbers of waves.
    let (sum, difference) = (plus(i0, i4), minus(i0, i4));
    let outer = plus(i2, i6);
    let inner = minus(&times(&minus(i2, i6), SQRT_2), &outer);
    let even = [
        plus(&sum, &outer),
        plus(&difference, &inner),
        minus(&difference, &inner),
        minus(&sum, &outer),
    ];
    // Odd ones.
    let (z13, z10) = (plus(i5, i3), minus(i5, i3));
    let (z11, z12) = (plus(i1, i7), minus(i1, i7));
    let o0 = plus(&z11, &z13);
    let turned = times(&minus(&z11, &z13), SQRT_2);
    // 2·cos(π/8), 2·(cos(π/8) − cos(3π/8)), 2·(cos(π/8) + cos(3π/8)).
    let z5 = times(&plus(&z10, &z12), 1.847_759);
    let o1 = minus(&minus(&z5, &times(&z10, 2.613_126)), &o0);
    let o2 = minus(&turned, &o1);
    let o3 = minus(&minus(&z5, &times(&z12, 1.082_392_2)), &o2);
    [
        plus(&even[0], &o0),
        plus(&even[1], &o1),
        plus(&even[2], &o2),
        plus(&even[3], &o3),
        minus(&even[3], &o3),
        minus(&even[2], &o2),
        minus(&even[1], &o1),
        minus(&even[0], &o0),
    ]
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use proptest::prelude::*;

    use super::*;

    /// The definition, A.3.3.
    fn defined(coefficients: &[f64; COEFFICIENTS]) -> [[f64; BLOCK]; BLOCK] {
        let wave = |x: usize, u: usize| {
            let scale = if u == 0 { 0.5_f64.sqrt() } else { 1.0 };
            scale * ((2 * x + 1) as f64 * u as f64 * PI / 16.0).cos() / 2.0
        };
        std::array::from_fn(|y| {
            std::array::from_fn(|x| {
                let terms = coefficients.iter().enumerate();
                terms
                    .map(|(i, c)| c * wave(x, i / 8) * wave(y, i % 8))
                    .sum::<f64>()
            })
        })
    }

    #[test]
    fn the_zigzag_passes_every_place_once_and_goes_from_one_to_the_next() {
        let mut places = PLACES[..COEFFICIENTS].to_vec();
        for pair in places.windows(2) {
            let [a, b] = [pair[0], pair[1]].map(|p| [i32::from(p / 8), i32::from(p % 8)]);
            assert!((a[0] - b[0]).abs() <= 1 && (a[1] - b[1]).abs() <= 1);
        }
        places.sort_unstable();
        assert!(places.into_iter().eq(0..64));
    }

    proptest! {
        #[test]
        fn a_block_is_what_the_definition_says(
            numbers in prop::collection::vec(-60_i16..=60, COEFFICIENTS), kept in 0_usize..=COEFFICIENTS,
        ) {
            let steps: [u16; COEFFICIENTS] = std::array::from_fn(|k| 2 + (k as u16 * 7) % 5);
            let factors = factors(&steps);
            let (mut block, mut exact) = ([0.0; COEFFICIENTS], [0.0; COEFFICIENTS]);
            for (k, number) in numbers.into_iter().enumerate().take(kept) {
                let place = usize::from(PLACES[k]);
                block[place] = f32::from(number) * factors[k];
                exact[place] = f64::from(number) * f64::from(steps[k]);
            }
            let exact = defined(&exact);
            for (row, exact) in pixels(&block).iter().flatten().zip(exact.iter().flatten()) {
                let level = (exact + 128.0).clamp(0.0, 255.0);
                prop_assert!((f64::from(*row) - level).abs() < 0.501, "{row} for {level}");
            }
            if kept <= 1 {
                prop_assert_eq!(flat(block[0]), pixels(&block));
            }
        }
    }
}
