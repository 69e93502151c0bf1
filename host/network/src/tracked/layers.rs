//! The architecture of the network after the tracker.

use gripline_kernels::Kernel;

use super::grid::GRID_CHANNELS;
use crate::layer::{Layer, LayerKind, OUTPUT, tensors_of};

/// Channels of the input: the grid's, the node's position (x, y, squared distance from the centre), and the log of the
/// motion's magnitude.
pub const INPUT_CHANNELS: usize = GRID_CHANNELS + 4;

/// The layers in the order in which they run. Concatenations put the decoder's channels first.
#[must_use]
pub fn layers([w20, w10, w5]: [usize; 3]) -> [Layer; 11] {
    const PLAIN: LayerKind = LayerKind::Convolution(Kernel {
        size: 3,
        stride: 1,
        padding: 1,
    });
    // Four taps along a side see as far to the left as to the right; three, of an even number of pixels, do not.
    const HALVING: LayerKind = LayerKind::Convolution(Kernel {
        size: 4,
        stride: 2,
        padding: 1,
    });
    const DOUBLING: LayerKind = LayerKind::Transposed { size: 4 };
    let layer = |name, kind, in_channels, out_channels| Layer {
        name,
        kind,
        in_channels,
        out_channels,
    };
    [
        layer("encode20a", HALVING, INPUT_CHANNELS, w20),
        layer("encode20b", PLAIN, w20, w20),
        layer("encode10a", HALVING, w20, w10),
        layer("encode10b", PLAIN, w10, w10),
        layer("bottom5a", HALVING, w10, w5),
        layer("bottom5b", PLAIN, w5, w5),
        layer("up10", DOUBLING, w5, w10),
        layer("decode10", PLAIN, 2 * w10, w10),
        layer("up20", DOUBLING, w10, w20),
        layer("decode20", PLAIN, 2 * w20, w20),
        layer(OUTPUT, PLAIN, w20, 3),
    ]
}

/// Name and shape of every tensor of a weights file.
#[must_use]
pub fn tensors(widths: [usize; 3]) -> Vec<(String, Vec<usize>)> {
    tensors_of(&layers(widths))
}
