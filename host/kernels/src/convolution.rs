//! A convolution as the kernels take it: which taps each output pixel sees, and the weights packed in the order in which
//! they are used.

use std::marker::PhantomData;
use std::ops::Range;

use super::region::Region;
use crate::instruction_set::InstructionSet;
use crate::simd::{Accumulator, Dispatch, LANES_MAX, Lines, Number, Simd, Vector};

/// A convolution with its weights packed for one instruction set. `T` is the number that is multiplied.
#[derive(Debug, Clone)]
pub struct Convolution<T = f32> {
    instructions: InstructionSet,
    kind: Kind,
    /// One for a convolution, four for a transposed one (one per parity of the output pixel).
    pub(super) phases: Vec<Phase<T>>,
    /// Output channels that a kernel computes together, in order; the last panel may reach past the channels.
    pub(super) panels: Vec<Panel>,
    /// Added to every output; padded with zeros to a multiple of [`LANES_MAX`].
    pub(super) bias: Vec<f32>,
    /// Sums are multiplied by these, one per bias. All 1 for f32, whose kernels skip the product.
    pub(super) scales: Vec<f32>,
    /// Whether negative outputs become zero.
    pub(super) relu: bool,
    /// Channels of the input plane, counted in `T`.
    pub(super) in_channels: usize,
    pub(super) out_channels: usize,
}

/// The output pixels of a convolution that see the same taps.
#[derive(Debug, Clone)]
pub(super) struct Phase<T> {
    /// Rows of taps; the taps of a row are neighbours, so a row is one run of inputs.
    pub(super) rows: Vec<TapRow>,
    /// Taps of all rows together.
    pub(super) tap_count: usize,
    /// Input pixels between neighbouring output pixels of the phase.
    pub(super) in_stride: usize,
    /// Output pixels between neighbouring output pixels of the phase.
    pub(super) out_stride: usize,
    /// First output pixel, (row, column).
    pub(super) out_start: (usize, usize),
    /// Ordered by panel, tap, group of `split` input channels, output channel of the panel, input channel of the group.
    /// Output channels that pad the last panel have zero weights.
    pub(super) weights: Lines<T>,
}

/// Output channels that a kernel computes together.
///
/// Where there are few, each has `split` lanes. A lane takes every `split`-th input channel; the lanes are summed at the
/// end. So a panel fills two vectors, and each input that is read serves two multiply-adds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Panel {
    pub(super) first: usize,
    pub(super) channels: usize,
    pub(super) split: usize,
}

impl<T> Phase<T> {
    /// The phase's rows in a region of the output.
    pub(super) fn rows_in(&self, region: &Region) -> Range<usize> {
        self.within(&region.rows, self.out_start.0)
    }

    /// The phase's columns in a region of the output.
    pub(super) fn columns_in(&self, region: &Region) -> Range<usize> {
        self.within(&region.columns, self.out_start.1)
    }

    fn within(&self, range: &Range<usize>, first: usize) -> Range<usize> {
        let index = |pixel: usize| pixel.saturating_sub(first).div_ceil(self.out_stride);
        index(range.start)..index(range.end)
    }
}

/// Where a row of taps starts, relative to the phase's first output pixel, in pixels of the input with its
/// border of one pixel (so 0 is the border).
#[derive(Debug, Clone, Copy)]
pub(super) struct TapRow {
    pub(super) row: usize,
    pub(super) column: usize,
    pub(super) taps: usize,
}

/// What the convolution does to the size of its image.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Forward(Kernel),
    /// With this many taps along a side.
    Transposed(usize),
}

/// Channels and kernel of a convolution.
#[derive(Debug, Clone, Copy)]
pub struct Shape {
    /// Channels it writes.
    pub out_channels: usize,
    /// Channels it reads.
    pub in_channels: usize,
    /// Taps, stride and padding.
    pub kernel: Kernel,
}

/// A square kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kernel {
    /// Taps along a side.
    pub size: usize,
    /// Input pixels between neighbouring output pixels.
    pub stride: usize,
    /// Pixels of zeros around the input: 0 or 1, which is the border that every plane has.
    pub padding: usize,
}

impl Convolution {
    /// A square convolution, `weights[out][in][ky][kx]` flattened, `padding` 0 or 1.
    ///
    /// # Panics
    /// When the number of weights or biases does not fit the shape.
    #[must_use]
    pub fn forward(
        instructions: InstructionSet,
        shape: Shape,
        weights: &[f32],
        bias: &[f32],
        relu: bool,
    ) -> Self {
        let Shape {
            out_channels,
            in_channels,
            kernel,
        } = shape;
        let size = kernel.size;
        assert_eq!(weights.len(), out_channels * in_channels * size * size, "weights");
        Self::forward_with(instructions, shape, bias, relu, |out, channel, ky, kx| {
            weights[((out * in_channels + channel) * size + ky) * size + kx]
        })
    }

    /// A transposed convolution that doubles the size (stride 2, padding 1; 4×4, or 3×3 with an output padding of 1),
    /// followed by ReLU; `weights[in][out][ky][kx]` flattened.
    ///
    /// # Panics
    /// When the number of weights or biases does not fit the channels.
    #[must_use]
    pub fn transposed(
        instructions: InstructionSet,
        in_channels: usize,
        out_channels: usize,
        weights: &[f32],
        bias: &[f32],
    ) -> Self {
        let channels = [out_channels, in_channels];
        let size = transposed_size(weights, channels);
        Self::transposed_with(instructions, channels, size, bias, |out, channel, ky, kx| {
            weights[((channel * out_channels + out) * size + ky) * size + kx]
        })
    }
}

impl<T: Number> Convolution<T> {
    /// As [`Convolution::forward`], with the weight as a function of output channel, input channel, tap row, tap column.
    ///
    /// # Panics
    /// When the number of biases does not fit the shape.
    pub(super) fn forward_with(
        instructions: InstructionSet,
        shape: Shape,
        bias: &[f32],
        relu: bool,
        weight: impl Fn(usize, usize, usize, usize) -> T,
    ) -> Self {
        let Shape {
            out_channels,
            in_channels,
            kernel,
        } = shape;
        let size = kernel.size;
        assert!(kernel.padding <= 1 && kernel.stride > 0 && size > 0, "{kernel:?}");
        let rows = (0..size)
            .map(|ky| TapRow {
                row: ky + 1 - kernel.padding,
                column: 1 - kernel.padding,
                taps: size,
            })
            .collect();
        let taps: Vec<(usize, usize)> = (0..size * size).map(|tap| (tap / size, tap % size)).collect();
        let channels = [out_channels, in_channels];
        let phase = Phase {
            rows,
            tap_count: taps.len(),
            in_stride: kernel.stride,
            out_stride: 1,
            out_start: (0, 0),
            weights: pack(instructions, channels, &taps, weight),
        };
        Self::new(
            instructions,
            Kind::Forward(kernel),
            vec![phase],
            channels,
            bias,
            relu,
        )
    }

    /// As [`Convolution::transposed`], with `size` taps along a side (3 or 4) and the weight as a function of output
    /// channel, input channel, tap row, tap column.
    ///
    /// Output pixel 2i takes tap 1 of input i, and tap 3 of i−1 if there is one; output pixel 2i+1 takes tap 2 of input i
    /// and tap 0 of i+1.
    ///
    /// # Panics
    /// When the number of biases does not fit the channels.
    pub(super) fn transposed_with(
        instructions: InstructionSet,
        channels: [usize; 2],
        size: usize,
        bias: &[f32],
        weight: impl Fn(usize, usize, usize, usize) -> T,
    ) -> Self {
        // The first pixel of the bordered input, and the taps from there on.
        let along = |parity: usize| match (parity, size) {
            (0, 3) => (1, vec![1]),
            (0, _) => (0, vec![3, 1]),
            _ => (1, vec![2, 0]),
        };
        let phase = |(py, px): (usize, usize)| {
            let ((row, kys), (column, kxs)) = (along(py), along(px));
            let rows = (0..kys.len())
                .map(|dy| TapRow {
                    row: row + dy,
                    column,
                    taps: kxs.len(),
                })
                .collect();
            let taps: Vec<(usize, usize)> = kys
                .iter()
                .flat_map(|&ky| kxs.iter().map(move |&kx| (ky, kx)))
                .collect();
            Phase {
                rows,
                tap_count: taps.len(),
                in_stride: 1,
                out_stride: 2,
                out_start: (py, px),
                weights: pack(instructions, channels, &taps, &weight),
            }
        };
        let phases = [(0, 0), (0, 1), (1, 0), (1, 1)].map(phase).into();
        Self::new(instructions, Kind::Transposed(size), phases, channels, bias, true)
    }

    fn new(
        instructions: InstructionSet,
        kind: Kind,
        phases: Vec<Phase<T>>,
        [out_channels, in_channels]: [usize; 2],
        bias: &[f32],
        relu: bool,
    ) -> Self {
        assert_eq!(bias.len(), out_channels, "biases");
        let mut padded_bias = bias.to_vec();
        padded_bias.resize(out_channels.next_multiple_of(LANES_MAX), 0.0);
        Self {
            instructions,
            kind,
            phases,
            panels: panels::<T>(instructions, [out_channels, in_channels]),
            scales: vec![1.0; padded_bias.len()],
            bias: padded_bias,
            relu,
            in_channels,
            out_channels,
        }
    }

    pub(crate) fn instructions(&self) -> InstructionSet {
        self.instructions
    }

    /// Channels of the output.
    #[must_use]
    pub fn out_channels(&self) -> usize {
        self.out_channels
    }

    /// Height and width of the output for an input of this height and width.
    #[must_use]
    pub fn out_size(&self, (height, width): (usize, usize)) -> (usize, usize) {
        let side = |side: usize| match self.kind {
            Kind::Forward(Kernel {
                size,
                stride,
                padding,
            }) => (side + 2 * padding + stride).saturating_sub(size) / stride,
            Kind::Transposed(_) => 2 * side,
        };
        (side(height), side(width))
    }

    /// The output pixels that see one of the input's `changed` pixels.
    #[must_use]
    pub fn affected(&self, changed: &Region, out_size: (usize, usize)) -> Region {
        changed.mapped(out_size, |first, last| match self.kind {
            Kind::Forward(Kernel {
                size,
                stride,
                padding,
            }) => (
                (first + padding + 1).saturating_sub(size).div_ceil(stride),
                (last + padding) / stride,
            ),
            Kind::Transposed(size) => ((2 * first).saturating_sub(1), 2 * last + size - 2),
        })
    }

    /// Multiply-adds for an output of this size, padded channels not counted.
    #[must_use]
    pub fn multiply_adds(&self, (height, width): (usize, usize)) -> usize {
        let whole = Region::whole(height, width);
        let pixels =
            |phase: &Phase<T>| phase.rows_in(&whole).len() * phase.columns_in(&whole).len() * phase.tap_count;
        self.phases.iter().map(pixels).sum::<usize>() * self.in_channels * self.out_channels
    }
}

/// Taps along a side of a transposed convolution with these weights.
///
/// # Panics
/// When they are neither 3 nor 4.
pub(super) fn transposed_size(weights: &[f32], [out_channels, in_channels]: [usize; 2]) -> usize {
    let size = [3, 4]
        .into_iter()
        .find(|size| out_channels * in_channels * size * size == weights.len());
    size.unwrap_or_else(|| {
        panic!(
            "{} weights, expected 9 or 16 for each of {out_channels} x {in_channels}",
            weights.len()
        )
    })
}

/// What panels are made of in an instruction set.
struct Vectors {
    lanes: usize,
    /// Of a full panel.
    count: usize,
    splits: bool,
}

/// Asks for the [`Vectors`] of `T`.
struct VectorsOf<T>(PhantomData<T>);

impl<T: Number> Dispatch for VectorsOf<T> {
    type Output = Vectors;

    #[expect(
        clippy::inline_always,
        reason = "compiles for the instruction set of its caller"
    )]
    #[inline(always)]
    fn run<S: Simd>(self) -> Vectors {
        Vectors {
            lanes: <T::Accumulator<S> as Accumulator>::Out::LANES,
            count: T::Accumulator::<S>::VECTORS,
            splits: T::Accumulator::<S>::SPLITS,
        }
    }
}

fn panels<T: Number>(instructions: InstructionSet, [out_channels, in_channels]: [usize; 2]) -> Vec<Panel> {
    let Vectors { lanes, count, splits } = T::dispatch(instructions, VectorsOf::<T>(PhantomData));
    let mut panels = Vec::new();
    let mut first = 0;
    while first < out_channels {
        let left = out_channels - first;
        let (segment, split): (usize, usize) = match left {
            32.. => (32, 1),
            9..32 => (16, 2),
            5..9 => (8, 4),
            _ => (4, 4),
        };
        let (segment, split) = if splits && in_channels.is_multiple_of(split) {
            (segment, split)
        } else {
            (segment.next_multiple_of(lanes), 1)
        };
        let channels = segment.min(lanes * count / split);
        for part in 0..segment / channels {
            panels.push(Panel {
                first: first + part * channels,
                channels,
                split,
            });
        }
        first += segment;
    }
    panels
}

/// Packs weights, a function of output channel, input channel, tap row, tap column, in the order in which they are used.
pub(super) fn pack<T: Number>(
    instructions: InstructionSet,
    channels: [usize; 2],
    taps: &[(usize, usize)],
    weight: impl Fn(usize, usize, usize, usize) -> T,
) -> Lines<T> {
    let [out_channels, in_channels] = channels;
    let mut packed = Vec::new();
    for panel in panels::<T>(instructions, channels) {
        for &(ky, kx) in taps {
            for group in (0..in_channels).step_by(panel.split) {
                for out in panel.first..panel.first + panel.channels {
                    packed.extend((group..group + panel.split).map(|channel| {
                        if out < out_channels {
                            weight(out, channel, ky, kx)
                        } else {
                            T::default()
                        }
                    }));
                }
            }
        }
    }
    Lines::new(&packed)
}
