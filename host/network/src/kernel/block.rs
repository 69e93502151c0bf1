//! Direct convolution: sums of up to twelve neighbouring output pixels and up to two vectors of output
//! channels stay in registers while all taps and input channels pass. The order in which an output's products
//! are added depends only on its channel, so its bits depend neither on the vectors' width (AVX2 or AVX-512) nor
//! on which pixels are computed together, nor on the region that is asked for.
#![expect(
    unsafe_code,
    reason = "vector loads in the innermost loop, inside slices cut to size before it"
)]
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{__m256, __m512};

use super::convolution::{Convolution, Panel, Phase};
use super::pairs::{EightPairs, Pair};
#[cfg(target_arch = "x86_64")]
use super::pairs::{Pairs256, Pairs512};
use super::plane::Plane;
use super::region::Region;
use super::vector::{Eight, Sums, Vector};
use crate::instruction_set::InstructionSet;

/// Runs a convolution over the output pixels of `region`; writes the output's channels from `channel` on.
///
/// To the sums come the convolution's bias or, when there is one, `start`'s values of the same pixel.
///
/// # Panics
/// When sizes do not fit.
pub(crate) fn convolve<T: Number>(
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
    let mut task = Task {
        convolution,
        start,
        input,
        output,
        channel,
        region,
    };
    T::run(&mut task);
}

/// What convolutions multiply.
pub(crate) trait Number: Copy + Default {
    /// Runs a convolution of such numbers on its instruction set.
    #[expect(private_interfaces, reason = "for this module only")]
    fn run(task: &mut Task<'_, Self>);
}

impl Number for f32 {
    #[expect(private_interfaces, reason = "for this module only")]
    fn run(task: &mut Task<'_, Self>) {
        match task.convolution.instructions() {
            InstructionSet::Portable => task.run::<Eight>(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `Convolution` takes only an instruction set that this processor has.
            InstructionSet::Avx2 => unsafe { run_avx2(task) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `Convolution` takes only an instruction set that this processor has.
            InstructionSet::Avx512 => unsafe { run_avx512(task) },
            #[cfg(not(target_arch = "x86_64"))]
            InstructionSet::Avx2 | InstructionSet::Avx512 => task.run::<Eight>(),
        }
    }
}

impl Number for Pair {
    #[expect(private_interfaces, reason = "for this module only")]
    fn run(task: &mut Task<'_, Self>) {
        match task.convolution.instructions() {
            InstructionSet::Portable => task.run::<EightPairs>(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `Convolution` takes only an instruction set that this processor has.
            InstructionSet::Avx2 => unsafe { run_pairs_avx2(task) },
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => {
                assert!(
                    Pair::has_wide(),
                    "packed for instructions that this processor lacks"
                );
                // SAFETY: it has them.
                unsafe { run_pairs_avx512(task) }
            }
            #[cfg(not(target_arch = "x86_64"))]
            InstructionSet::Avx2 | InstructionSet::Avx512 => task.run::<EightPairs>(),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_avx2(task: &mut Task<'_, f32>) {
    task.run::<__m256>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn run_avx512(task: &mut Task<'_, f32>) {
    task.run::<__m512>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_pairs_avx2(task: &mut Task<'_, Pair>) {
    task.run::<Pairs256>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vnni")]
fn run_pairs_avx512(task: &mut Task<'_, Pair>) {
    task.run::<Pairs512>();
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

impl<T: Copy + Default> Task<'_, T> {
    /// Panel by panel, so that a panel's weights stay in the cache.
    #[inline(always)]
    fn run<V: Sums<Number = T>>(&mut self) {
        let convolution = self.convolution;
        for &panel in &convolution.panels {
            match (panel.channels * panel.split / V::Out::LANES, panel.split) {
                (2, 1) => self.pixels::<V, 2, 1>(panel),
                (2, 2) => self.pixels::<V, 2, 2>(panel),
                (2, 4) => self.pixels::<V, 2, 4>(panel),
                (1, 1) => self.pixels::<V, 1, 1>(panel),
                (1, 4) => self.pixels::<V, 1, 4>(panel),
                shape => unreachable!("{shape:?} is no panel's shape"),
            }
        }
    }

    /// All pixels of a panel, which has `N` vectors of sums for each, split `S` ways.
    #[inline(always)]
    fn pixels<V: Sums<Number = T>, const N: usize, const S: usize>(&mut self, panel: Panel) {
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
                            phase.out_start.0 + y * phase.out_step,
                            phase.out_start.1 + x * phase.out_step,
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
    fn block<V: Sums<Number = T>, const N: usize, const S: usize, const P: usize>(
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
        let per_output = phase.run * in_channels;
        let mut weights = &phase.weights[first * per_output..][..panel.channels * per_output];
        let step = phase.in_step * in_channels;
        let mut sums = [[V::zero(); N]; P];
        for taps in &phase.rows {
            let run = taps.taps * in_channels;
            let row = taps.row + at.in_phase.0 * phase.in_step;
            let column = taps.column + at.in_phase.1 * phase.in_step;
            let from = row * self.input.stride() + column * in_channels;
            let inputs = self.input.values()[from..][..(P - 1) * step + run].as_ptr();
            let (these, rest) = weights.split_at(run / S * lanes);
            let these = these.as_ptr();
            weights = rest;
            for i in 0..run / S {
                // SAFETY: i < run / S, so the last pixel's inputs are inside `inputs` and the last vector inside
                // `these`: both slices were cut to just this.
                unsafe {
                    let mut weight = [V::zero(); N];
                    for (n, weight) in weight.iter_mut().enumerate() {
                        *weight = V::load(these.add(i * lanes + n * V::Out::LANES));
                    }
                    for (p, sums) in sums.iter_mut().enumerate() {
                        let values = V::repeat::<S>(inputs.add(p * step + i * S));
                        for (sum, weight) in sums.iter_mut().zip(weight) {
                            *sum = values.times_plus(weight, *sum);
                        }
                    }
                }
            }
        }

        // A sum for each of the panel's channels, `LANES` in a vector.
        let vectors = if S == 1 { N } else { 1 };
        let (start, start_step) = match self.start {
            None => (&self.convolution.bias[first..], 0),
            Some(map) => (
                &map.row(at.out.0)[at.out.1 * map.channels() + first..],
                phase.out_step * map.channels(),
            ),
        };
        let start = &start[..(P - 1) * start_step + vectors * V::Out::LANES];
        let factors = &self.convolution.factors[first..][..vectors * V::Out::LANES];
        let channels = self.output.channels();
        let used = panel.channels.min(out_channels - first);
        let line = self.output.row_mut(at.out.0);
        for (p, mut sums) in sums.into_iter().enumerate() {
            if S > 1 {
                sums[0] = sums[0].pair_sums(sums[N - 1]);
            }
            if S > 2 {
                sums[0] = sums[0].pair_sums(sums[0]);
            }
            let pixel = (at.out.1 + p * phase.out_step) * channels + self.channel + first;
            for (n, sum) in sums.into_iter().take(vectors).enumerate() {
                let from = n * V::Out::LANES;
                // SAFETY: `start` and `factors` reach to the last lane of the last pixel.
                let (sum, start) = unsafe {
                    (
                        sum.out(factors.as_ptr().add(from)),
                        V::Out::load(start.as_ptr().add(p * start_step + from)),
                    )
                };
                let sum = sum.plus(start);
                let sum = if relu { sum.negative_to_zero() } else { sum };
                sum.store(&mut line[pixel + from.min(used)..pixel + used.min(from + V::Out::LANES)]);
            }
        }
    }
}
