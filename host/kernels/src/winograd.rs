//! 3×3 convolutions of planes of even width in int16, two neighbouring output pixels at once: with Winograd's F(2, 3) along the
//! rows, four products a row of taps and channel give what takes six one by one. All in integers: the sums are those of the
//! direct convolution, bit by bit. On the way they may wrap; wrapping comes out in the end, because the results fit.
//!
//! Of inputs d0 to d3 and weights g0 to g2, whose sum has to be even:
//! m0 = (d0 − d2)·g0, m1 = (d1 + d2)·(g0 + g1 + g2)/2, m2 = (d2 − d1)·(g0 − g1 + g2)/2, m3 = (d1 − d3)·g2;
//! the pixels are m0 + m1 + m2 and m1 − m2 − m3.
//! Limit: inputs are below 2¹⁴, so that their sums and differences fit int16.
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

use super::convolution::{Convolution, Panel, pack};
use super::direct::Finish;
use super::plane::Plane;
use crate::simd::{Dispatch, Int16Pair, IntegerSums, LANES_MAX, Lines, Number, Simd, Vector, accumulate};

/// Products of a row of taps, and its taps.
const PRODUCTS: usize = 4;
const TAPS: usize = 3;
/// Pairs of channels that [`combine`] takes at once: a vector of 128 bits.
const FOUR: usize = 4;

/// The weights of the four products, and room for what they are multiplied with.
#[derive(Debug, Clone)]
pub(super) struct Winograd {
    /// Of each product: ordered as a convolution's with the taps of one column.
    weights: [Lines<Int16Pair>; PRODUCTS],
    /// Of each product: by pair of columns, row (with the border's), channel. So what a pair of pixels needs is one run.
    inputs: [Vec<Int16Pair>; PRODUCTS],
    /// Rows with the border's, and pairs of columns.
    rows: usize,
    pairs: usize,
    in_channels: usize,
}

/// The four weights of a row of taps.
fn transformed([a, b, c]: [i16; TAPS]) -> [i16; PRODUCTS] {
    let [first, second, third] = [a, b, c].map(i32::from);
    debug_assert!((first + second + third) % 2 == 0, "{first} + {second} + {third}");
    let half = |sum: i32| i16::try_from(sum / 2).expect("weights leave room for half the sum of a row");
    [a, half(first + second + third), half(first - second + third), c]
}

/// What the weights of each product are multiplied with, for the first `K` pairs of channels.
#[inline(always)]
fn combine<const K: usize>(
    [d0, d1, d2, d3]: [&[Int16Pair]; PRODUCTS],
    [m0, m1, m2, m3]: [&mut [Int16Pair]; PRODUCTS],
) {
    // Copies, which nothing that is written can change: so the compiler makes vectors of them.
    let mut out = [[Int16Pair::default(); K]; PRODUCTS];
    let (d0, d1, d2, d3) = (&d0[..K], &d1[..K], &d2[..K], &d3[..K]);
    for k in 0..K {
        out[0][k] = d0[k].minus(d2[k]);
        out[1][k] = d1[k].plus(d2[k]);
        out[2][k] = d2[k].minus(d1[k]);
        out[3][k] = d1[k].minus(d3[k]);
    }
    m0[..K].copy_from_slice(&out[0]);
    m1[..K].copy_from_slice(&out[1]);
    m2[..K].copy_from_slice(&out[2]);
    m3[..K].copy_from_slice(&out[3]);
}

impl Winograd {
    /// For a convolution of planes of this height and width; weights are a function of output channel, pair of input channels,
    /// tap row, tap column.
    pub(super) fn new(
        convolution: &Convolution<Int16Pair>,
        (height, width): (usize, usize),
        weight: impl Fn(usize, usize, usize, usize) -> Int16Pair,
    ) -> Self {
        assert!(width.is_multiple_of(2), "{width} columns in pairs");
        let (in_channels, rows, pairs) = (convolution.in_channels, height + 2, width / 2);
        let channels = [convolution.out_channels, in_channels];
        let taps: [(usize, usize); TAPS] = std::array::from_fn(|row| (row, 0));
        let weights = std::array::from_fn(|product| {
            pack(
                convolution.instructions(),
                channels,
                &taps,
                |out, pair, row, _| {
                    let of_row: [Int16Pair; TAPS] =
                        std::array::from_fn(|column| weight(out, pair, row, column));
                    Int16Pair([0, 1].map(|k| transformed(of_row.map(|pair| pair.0[k]))[product]))
                },
            )
        });
        Self {
            weights,
            inputs: std::array::from_fn(|_| vec![Int16Pair::default(); pairs * rows * in_channels]),
            rows,
            pairs,
            in_channels,
        }
    }

    /// Takes a plane of the convolution's height and width.
    #[inline(always)]
    pub(super) fn take(&mut self, plane: &Plane<Int16Pair>) {
        let channels = self.in_channels;
        let [m0, m1, m2, m3] = &mut self.inputs;
        // The border's rows stay zero.
        for row in 1..self.rows - 1 {
            let pixels = &plane.values()[row * plane.stride()..][..plane.stride()];
            for pair in 0..self.pairs {
                let pixels = &pixels[2 * pair * channels..][..4 * channels];
                let (left, right) = pixels.split_at(2 * channels);
                let ((d0, d1), (d2, d3)) = (left.split_at(channels), right.split_at(channels));
                let at = (pair * self.rows + row) * channels;
                let (m0, m1) = (&mut m0[at..][..channels], &mut m1[at..][..channels]);
                let (m2, m3) = (&mut m2[at..][..channels], &mut m3[at..][..channels]);
                let mut k = 0;
                while k + FOUR <= channels {
                    combine::<FOUR>(
                        [&d0[k..], &d1[k..], &d2[k..], &d3[k..]],
                        [&mut m0[k..], &mut m1[k..], &mut m2[k..], &mut m3[k..]],
                    );
                    k += FOUR;
                }
                while k < channels {
                    combine::<1>(
                        [&d0[k..], &d1[k..], &d2[k..], &d3[k..]],
                        [&mut m0[k..], &mut m1[k..], &mut m2[k..], &mut m3[k..]],
                    );
                    k += 1;
                }
            }
        }
    }

    /// Convolves what was taken; writes the output's channels from `channel` on.
    pub(super) fn convolve(&self, convolution: &Convolution<Int16Pair>, output: &mut Plane, channel: usize) {
        assert!(
            output.size() == (self.rows - 2, 2 * self.pairs)
                && channel + convolution.out_channels <= output.channels(),
            "an output of {:?}",
            output.size()
        );
        let task = Task {
            convolution,
            winograd: self,
            output,
            channel,
        };
        Int16Pair::dispatch(convolution.instructions(), task);
    }
}

/// The arguments of [`Winograd::convolve`].
struct Task<'a> {
    convolution: &'a Convolution<Int16Pair>,
    winograd: &'a Winograd,
    output: &'a mut Plane,
    channel: usize,
}

impl Dispatch for Task<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self) {
        self.panels::<S::Int16>();
    }
}

impl Task<'_> {
    #[inline(always)]
    fn panels<V: IntegerSums>(&mut self) {
        let convolution = self.convolution;
        for &panel in &convolution.panels {
            match (panel.channels * panel.split / V::Out::LANES, panel.split) {
                (1, 1) => self.pairs::<V, 1, 1>(panel),
                (1, 4) if V::SPLITS && V::Out::LANES == LANES_MAX => self.pairs::<V, 1, 4>(panel),
                (2, 1) if V::VECTORS == 2 => self.pairs::<V, 2, 1>(panel),
                (2, 2) if V::SPLITS => self.pairs::<V, 2, 2>(panel),
                (2, 4) if V::SPLITS => self.pairs::<V, 2, 4>(panel),
                shape => unreachable!("{shape:?} is no panel's shape"),
            }
        }
    }

    /// All pixels of a panel, which has `N` vectors of sums for each, split `S` ways.
    #[inline(always)]
    fn pairs<V: IntegerSums, const N: usize, const S: usize>(&mut self, panel: Panel) {
        let (pairs, height) = (self.winograd.pairs, self.winograd.rows - 2);
        let groups = pairs.div_ceil(V::PIXELS_MAX[N - 1]);
        let mut first = 0;
        for group in 0..groups {
            // As even as can be.
            let count = (pairs - first).div_ceil(groups - group);
            for row in 0..height {
                macro_rules! block_of {
                    ($($count:literal)*) => {
                        match count {
                            $($count if $count <= V::PIXELS_MAX[N - 1] => {
                                self.block::<V, N, S, $count>(panel, row, first);
                            })*
                            _ => unreachable!("a group has 1 to 12 pairs"),
                        }
                    };
                }
                block_of!(1 2 3 4 5 6 7 8 9 10 11 12);
            }
            first += count;
        }
    }

    /// `P` neighbouring pairs of pixels of a row.
    #[inline(always)]
    fn block<V: IntegerSums, const N: usize, const S: usize, const P: usize>(
        &mut self,
        panel: Panel,
        row: usize,
        pair: usize,
    ) {
        let Winograd {
            weights,
            inputs,
            rows,
            in_channels,
            ..
        } = self.winograd;
        let (run, step) = (TAPS * in_channels, rows * in_channels);
        let mut products = [[[V::zero(); N]; P]; PRODUCTS];
        for (sums, (weights, inputs)) in products.iter_mut().zip(weights.iter().zip(inputs)) {
            let weights = &weights.numbers()[panel.first * run..][..panel.channels * run];
            let inputs = &inputs[(pair * rows + row) * in_channels..][..(P - 1) * step + run];
            accumulate::<V, P, N, S>(sums, weights, inputs, step, run);
        }
        let Convolution {
            out_channels, relu, ..
        } = *self.convolution;
        let [m0, m1, m2, m3] = products;
        let (mut left, mut right) = (m1, m1);
        for p in 0..P {
            for n in 0..N {
                left[p][n] = left[p][n].plus(m0[p][n]).plus(m2[p][n]);
                right[p][n] = right[p][n].minus(m2[p][n]).minus(m3[p][n]);
            }
        }
        let channels = self.output.channels();
        for (parity, sums) in [&left, &right].into_iter().enumerate() {
            let at = (2 * pair + parity) * channels + self.channel + panel.first;
            V::apart(Finish::<V, N, S> {
                sums,
                scales: &self.convolution.scales[panel.first..],
                start: &self.convolution.bias[panel.first..],
                start_step: 0,
                relu,
                used: panel.channels.min(out_channels - panel.first),
                out: &mut self.output.row_mut(row)[at..],
                out_step: 2 * channels,
            });
        }
    }
}
