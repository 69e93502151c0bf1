//! The network's operations on channels-last activations. Pure arithmetic: no files, no threads, no
//! allocation after construction. Today there is one kernel, in portable Rust; kernels for wider
//! instruction sets take the same [`Convolution`] (weights packed for blocks of [`BLOCK`] output channels).

mod plane;
pub(crate) mod portable;

pub(crate) use plane::Plane;

/// Output channels that a kernel computes together; every width in the network is a multiple of it.
pub(crate) const BLOCK: usize = 8;

/// One block of output channels of one pixel.
pub(crate) type Lanes = [f32; BLOCK];

/// A convolution with its weights packed for the kernels, batch norm already folded in.
#[derive(Debug, Clone)]
pub(crate) struct Convolution {
    /// One for a convolution, four for an up-convolution (one per parity of the output pixel).
    pub(crate) phases: Vec<Phase>,
    /// Where every output starts, one entry per block of output channels.
    pub(crate) bias: Vec<Lanes>,
    /// Whether negative outputs become zero.
    pub(crate) relu: bool,
    /// Channels read from the input plane: all that it has.
    pub(crate) in_channels: usize,
}

/// The output pixels of a convolution that see the same taps.
#[derive(Debug, Clone)]
pub(crate) struct Phase {
    /// Rows of taps; the taps of a row are neighbours, so a row is one run of inputs.
    pub(crate) rows: Vec<TapRow>,
    /// Input pixels from one output pixel of the phase to the next.
    pub(crate) in_step: usize,
    /// Output pixels from one output pixel of the phase to the next.
    pub(crate) out_step: usize,
    /// First output pixel, (row, column).
    pub(crate) out_start: (usize, usize),
    /// `weights[(block * rows + row) * run + tap * in_channels + channel]`.
    pub(crate) weights: Vec<Lanes>,
}

/// Where a row of taps starts, relative to the phase's first output pixel, in pixels of the input with its
/// border of one pixel (so 0 is the border).
#[derive(Debug, Clone, Copy)]
pub(crate) struct TapRow {
    pub(crate) row: usize,
    pub(crate) column: usize,
    pub(crate) taps: usize,
}

impl Convolution {
    /// A square convolution, `weights[out][in][ky][kx]` flattened, `padding` 0 or 1.
    ///
    /// `out_channels` is rounded up to whole blocks; the added channels are zero.
    pub(crate) fn forward(shape: Shape, weights: &[f32], bias: &[f32], relu: bool) -> Self {
        let Shape {
            out_channels,
            in_channels,
            kernel,
        } = shape;
        debug_assert_eq!(
            weights.len(),
            out_channels * in_channels * kernel.size * kernel.size
        );
        let rows: Vec<TapRow> = (0..kernel.size)
            .map(|ky| TapRow {
                row: ky + 1 - kernel.padding,
                column: 1 - kernel.padding,
                taps: kernel.size,
            })
            .collect();
        let taps: Vec<Vec<(usize, usize)>> = (0..kernel.size)
            .map(|ky| (0..kernel.size).map(|kx| (ky, kx)).collect())
            .collect();
        let weight = |out: usize, channel: usize, ky: usize, kx: usize| {
            weights[((out * in_channels + channel) * kernel.size + ky) * kernel.size + kx]
        };
        let phase = Phase {
            rows,
            in_step: kernel.stride,
            out_step: 1,
            out_start: (0, 0),
            weights: pack(out_channels, in_channels, &taps, weight),
        };
        Self {
            phases: vec![phase],
            bias: pack_bias(out_channels, bias),
            relu,
            in_channels,
        }
    }

    /// An up-convolution that doubles the size (transposed 3×3, stride 2, padding 1, output padding 1),
    /// `weights[in][out][ky][kx]` flattened.
    ///
    /// Output pixel 2i takes tap 1 of input i; output pixel 2i+1 takes tap 2 of input i and tap 0 of i+1.
    pub(crate) fn doubling(in_channels: usize, out_channels: usize, weights: &[f32], bias: &[f32]) -> Self {
        debug_assert_eq!(weights.len(), out_channels * in_channels * 9);
        let weight = |out: usize, channel: usize, ky: usize, kx: usize| {
            weights[((channel * out_channels + out) * 3 + ky) * 3 + kx]
        };
        let along = |parity: usize| if parity == 0 { vec![1] } else { vec![2, 0] };
        let mut phases = Vec::with_capacity(4);
        for (py, px) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let (kys, kxs) = (along(py), along(px));
            let rows = (0..kys.len())
                .map(|dy| TapRow {
                    row: 1 + dy,
                    column: 1,
                    taps: kxs.len(),
                })
                .collect();
            let taps: Vec<Vec<(usize, usize)>> = kys
                .iter()
                .map(|&ky| kxs.iter().map(|&kx| (ky, kx)).collect())
                .collect();
            phases.push(Phase {
                rows,
                in_step: 1,
                out_step: 2,
                out_start: (py, px),
                weights: pack(out_channels, in_channels, &taps, weight),
            });
        }
        Self {
            phases,
            bias: pack_bias(out_channels, bias),
            relu: true,
            in_channels,
        }
    }
}

/// Channels and kernel of a convolution.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shape {
    pub(crate) out_channels: usize,
    pub(crate) in_channels: usize,
    pub(crate) kernel: Kernel,
}

/// A square kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Kernel {
    pub(crate) size: usize,
    pub(crate) stride: usize,
    /// Pixels of zeros around the input: 0 or 1, which is the border that every plane has.
    pub(crate) padding: usize,
}

fn pack(
    out_channels: usize,
    in_channels: usize,
    taps: &[Vec<(usize, usize)>],
    weight: impl Fn(usize, usize, usize, usize) -> f32,
) -> Vec<Lanes> {
    let mut packed = Vec::new();
    for block in 0..out_channels.div_ceil(BLOCK) {
        for &(ky, kx) in taps.iter().flatten() {
            for channel in 0..in_channels {
                packed.push(std::array::from_fn(|lane| {
                    let out = block * BLOCK + lane;
                    if out < out_channels {
                        weight(out, channel, ky, kx)
                    } else {
                        0.0
                    }
                }));
            }
        }
    }
    packed
}

fn pack_bias(out_channels: usize, bias: &[f32]) -> Vec<Lanes> {
    debug_assert_eq!(bias.len(), out_channels);
    (0..out_channels.div_ceil(BLOCK))
        .map(|block| std::array::from_fn(|lane| bias.get(block * BLOCK + lane).copied().unwrap_or(0.0)))
        .collect()
}
