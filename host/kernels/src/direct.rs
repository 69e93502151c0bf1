//! Direct convolution (no im2col): the sums of up to twelve neighbouring output pixels and up to two vectors of output
//! channels stay in registers while all taps and input channels pass. The order in which an output's products are added
//! depends only on its channel. So its bits depend neither on the instruction set (AVX2, AVX-512 or NEON), nor on which
//! pixels are computed together, nor on the region that is asked for.
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

use super::convolution::{Convolution, Panel, Phase};
use super::plane::Plane;
use super::region::Region;
use crate::simd::{Accumulator, Dispatch, LANES_MAX, Number, Simd, Vector, accumulate};

/// Runs a convolution over the output pixels of `region`; writes the output's channels from `channel` on.
///
/// Adds the convolution's bias to the sums or, when there is one, `start`'s values of the same pixel.
///
/// # Panics
/// When sizes do not fit.
pub fn convolve(
    convolution: &Convolution,
    start: Option<&Plane>,
    input: &Plane,
    output: &mut Plane,
    channel: usize,
    region: &Region,
) {
    convolve_numbers(convolution, start, input, output, channel, region);
}

/// As [`convolve`], of any numbers. Not public, so that kernels are compiled with this crate only.
pub(super) fn convolve_numbers<T: Number>(
    convolution: &Convolution<T>,
    start: Option<&Plane>,
    input: &Plane<T>,
    output: &mut Plane,
    channel: usize,
    region: &Region,
) {
    let out_channels = convolution.out_channels;
    assert_eq!(input.channels(), convolution.in_channels, "channels of the input");
    assert!(
        channel + out_channels <= output.channels(),
        "channels of the output"
    );
    assert!(
        region.rows.end <= output.height() && region.columns.end <= output.width(),
        "region {region:?} in an output of {} x {}",
        output.height(),
        output.width()
    );
    let room = convolution.out_size(input.size());
    assert!(
        room.0 >= region.rows.end && room.1 >= region.columns.end,
        "size of the input: {:?} gives {room:?} pixels of {region:?}",
        input.size()
    );
    if let Some(start) = start {
        assert_eq!(
            [start.height(), start.width()],
            [output.height(), output.width()],
            "size of the start"
        );
        assert!(
            start.channels() >= convolution.bias.len(),
            "channels of the start"
        );
    }
    let task = Task {
        convolution,
        start,
        input,
        output,
        channel,
        region,
    };
    T::dispatch(convolution.instructions(), task);
}

/// The arguments of [`convolve`].
struct Task<'a, T> {
    convolution: &'a Convolution<T>,
    start: Option<&'a Plane>,
    input: &'a Plane<T>,
    output: &'a mut Plane,
    channel: usize,
    region: &'a Region,
}

/// Where a block's first pixel lies: output row and column, and its (row, column) within the phase.
#[derive(Clone, Copy)]
struct Place {
    out: (usize, usize),
    in_phase: (usize, usize),
}

impl<T: Number> Dispatch for Task<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self) {
        self.panels::<T::Accumulator<S>>();
    }
}

impl<T: Number> Task<'_, T> {
    /// Panel by panel, so that a panel's weights stay in the cache.
    #[inline(always)]
    fn panels<V: Accumulator<Number = T>>(&mut self) {
        let convolution = self.convolution;
        for &panel in &convolution.panels {
            match (panel.channels * panel.split / V::Out::LANES, panel.split) {
                (1, 1) => self.pixels::<V, 1, 1>(panel),
                (1, 4) if V::SPLITS && V::Out::LANES == LANES_MAX => self.pixels::<V, 1, 4>(panel),
                (2, 1) if V::VECTORS == 2 => self.pixels::<V, 2, 1>(panel),
                (2, 2) if V::SPLITS => self.pixels::<V, 2, 2>(panel),
                (2, 4) if V::SPLITS => self.pixels::<V, 2, 4>(panel),
                shape => unreachable!("{shape:?} is no panel's shape"),
            }
        }
    }

    /// All pixels of a panel, which has `N` vectors of sums for each, split `S` ways.
    #[inline(always)]
    fn pixels<V: Accumulator<Number = T>, const N: usize, const S: usize>(&mut self, panel: Panel) {
        let convolution = self.convolution;
        for phase in &convolution.phases {
            let columns = phase.columns_in(self.region);
            let groups = columns.len().div_ceil(V::PIXELS_MAX[N - 1]);
            for y in phase.rows_in(self.region) {
                let mut x = columns.start;
                for group in 0..groups {
                    // As even as can be: 22 pixels are two groups of 11 rather than 12 and 10.
                    let pixels = (columns.end - x).div_ceil(groups - group);
                    let at = Place {
                        out: (
                            phase.out_start.0 + y * phase.out_stride,
                            phase.out_start.1 + x * phase.out_stride,
                        ),
                        in_phase: (y, x),
                    };
                    macro_rules! block_of {
                        ($($count:literal)*) => {
                            match pixels {
                                $($count if $count <= V::PIXELS_MAX[N - 1] => {
                                    self.block::<V, N, S, $count>(phase, panel, at);
                                })*
                                _ => unreachable!("a group has 1 to 12 pixels"),
                            }
                        };
                    }
                    block_of!(1 2 3 4 5 6 7 8 9 10 11 12);
                    x += pixels;
                }
            }
        }
    }

    /// `P` neighbouring pixels of a phase.
    #[inline(always)]
    fn block<V: Accumulator<Number = T>, const N: usize, const S: usize, const P: usize>(
        &mut self,
        phase: &Phase<T>,
        panel: Panel,
        at: Place,
    ) {
        let &Convolution {
            in_channels,
            out_channels,
            relu,
            ..
        } = self.convolution;
        let first = panel.first;
        let lanes = N * V::Out::LANES;
        let per_output = phase.tap_count * in_channels;
        let mut weights = &phase.weights.numbers()[first * per_output..][..panel.channels * per_output];
        let step = phase.in_stride * in_channels;
        let mut sums = [[V::zero(); N]; P];
        for taps in &phase.rows {
            let run = taps.taps * in_channels;
            let row = taps.row + at.in_phase.0 * phase.in_stride;
            let column = taps.column + at.in_phase.1 * phase.in_stride;
            let from = row * self.input.stride() + column * in_channels;
            let inputs = &self.input.values()[from..][..(P - 1) * step + run];
            let (row_weights, rest) = weights.split_at(run / S * lanes);
            weights = rest;
            accumulate::<V, P, N, S>(&mut sums, row_weights, inputs, step, run);
        }

        // What is added to the sums, and how far apart that is for neighbouring pixels.
        let (start, start_step) = match self.start {
            None => (&self.convolution.bias[first..], 0),
            Some(map) => (
                &map.row(at.out.0)[at.out.1 * map.channels() + first..],
                phase.out_stride * map.channels(),
            ),
        };
        let channels = self.output.channels();
        // A copy, so that the sums themselves stay in registers.
        let mut done = [[V::zero(); N]; P];
        for p in 0..P {
            for n in 0..N {
                done[p][n] = sums[p][n];
            }
        }
        V::apart(Finish::<V, N, S> {
            sums: &done,
            scales: &self.convolution.scales[first..],
            start,
            start_step,
            relu,
            used: panel.channels.min(out_channels - first),
            out: &mut self.output.row_mut(at.out.0)[at.out.1 * channels + self.channel + first..],
            out_step: phase.out_stride * channels,
        });
    }
}

/// Writes a panel's channels of pixels: their lanes' sums, scaled, added to `start`.
pub(super) struct Finish<'a, V, const N: usize, const S: usize> {
    /// `N` vectors for each pixel, split `S` ways.
    pub(super) sums: &'a [[V; N]],
    /// A factor for each of the panel's channels.
    pub(super) scales: &'a [f32],
    /// From the first pixel's first channel on.
    pub(super) start: &'a [f32],
    /// Numbers between neighbouring pixels in `start`.
    pub(super) start_step: usize,
    /// Whether negative outputs become zero.
    pub(super) relu: bool,
    /// Channels that are written.
    pub(super) used: usize,
    /// From the first pixel's first channel on.
    pub(super) out: &'a mut [f32],
    /// Numbers between neighbouring pixels in `out`.
    pub(super) out_step: usize,
}

impl<V: Accumulator, const N: usize, const S: usize> Dispatch for Finish<'_, V, N, S> {
    type Output = ();

    #[inline(always)]
    fn run<I: Simd>(self) {
        // A sum for each of the panel's channels, `LANES` in a vector.
        let vectors = if S == 1 { N } else { 1 };
        for (p, &sums) in self.sums.iter().enumerate() {
            let mut sums = sums;
            if S > 1 {
                sums[0] = sums[0].pairwise_sums(sums[N - 1]);
            }
            if S > 2 {
                sums[0] = sums[0].pairwise_sums(sums[0]);
            }
            let start = &self.start[p * self.start_step..];
            let out = &mut self.out[p * self.out_step..][..self.used];
            for (n, sum) in sums.into_iter().take(vectors).enumerate() {
                let from = n * V::Out::LANES;
                let sum = sum.scale(&self.scales[from..]).add(V::Out::load(&start[from..]));
                let sum = if self.relu { sum.relu() } else { sum };
                sum.store(&mut out[from.min(self.used)..self.used.min(from + V::Out::LANES)]);
            }
        }
    }
}
