//! The network behind the tracker: a small encoder–decoder from the 40×40 grid of motions to 20×20 forces, deep enough
//! that every taxel sees the whole fingertip, because the layer couples that far.

use super::grid::{GRID_CHANNELS, GRID_NODES, GRID_SIDE, Grid};
use super::weights::{TrackedScaling, TrackedWeights};
use crate::ForceMap;
use crate::constants::MAP_SIDE;
use crate::instruction_set::InstructionSet;
use crate::kernel::{Plan, PlaneId, Region};
use crate::unet::{Folded, Layer, LayerKind, OUTPUT, tensors_of};

/// Channels of the input: the grid's, the node's place (x, y, and the square of the distance from the middle), and the
/// logarithm of the motion's size.
pub const INPUT_CHANNELS: usize = GRID_CHANNELS + 4;

/// The layers in the order in which they run. Concatenations put the decoder's channels first.
#[must_use]
pub fn layers([w20, w10, w5]: [usize; 3]) -> [Layer; 11] {
    const PLAIN: LayerKind = LayerKind::Convolution {
        stride: 1,
        padding: 1,
    };
    const STRIDED: LayerKind = LayerKind::Convolution {
        stride: 2,
        padding: 1,
    };
    let layer = |name, kind, in_channels, out_channels| Layer {
        name,
        kind,
        in_channels,
        out_channels,
    };
    [
        layer("encode20a", STRIDED, INPUT_CHANNELS, w20),
        layer("encode20b", PLAIN, w20, w20),
        layer("encode10a", STRIDED, w20, w10),
        layer("encode10b", PLAIN, w10, w10),
        layer("bottom5a", STRIDED, w10, w5),
        layer("bottom5b", PLAIN, w5, w5),
        layer("up10", LayerKind::Doubling, w5, w10),
        layer("decode10", PLAIN, 2 * w10, w10),
        layer("up20", LayerKind::Doubling, w10, w20),
        layer("decode20", PLAIN, 2 * w20, w20),
        layer(OUTPUT, PLAIN, w20, 3),
    ]
}

/// Name and shape of every tensor of a weights file; as for the encoder–decoder on images.
#[must_use]
pub fn tensors(widths: [usize; 3]) -> Vec<(String, Vec<usize>)> {
    tensors_of(&layers(widths))
}

/// The layers in the order in which they run, batch norm folded in. `weights` has to have passed
/// [`TrackedWeights::check`].
pub fn folded(weights: &TrackedWeights) -> impl Iterator<Item = Folded> {
    layers(weights.widths)
        .into_iter()
        .map(|layer| Folded::new(layer, &weights.tensors))
}

/// The network's input and the size of the motion in it, mm, which its outputs are to be multiplied with.
#[must_use]
pub fn input(grid: &Grid, scaling: &TrackedScaling) -> (Vec<[f32; INPUT_CHANNELS]>, f32) {
    let mut nodes = vec![[0.0; INPUT_CHANNELS]; GRID_NODES];
    let size_mm = motion_mm(grid, scaling);
    for (node, values) in nodes.iter_mut().enumerate() {
        *values = input_of(grid, scaling, size_mm, node);
    }
    (nodes, size_mm)
}

/// Root mean square of the motions, weighted by how much is known of them, mm; at least the noise.
fn motion_mm(grid: &Grid, scaling: &TrackedScaling) -> f32 {
    let (mut squares, mut known) = (0.0_f32, 0.0_f32);
    for [x, y, weight] in grid.as_chunks::<3>().0 {
        for ((x, y), weight) in x.iter().zip(y).zip(weight) {
            squares += weight * (x * x + y * y);
            known += weight;
        }
    }
    (squares / known.max(1.0)).sqrt().max(scaling.least_motion_mm)
}

fn input_of(grid: &Grid, scaling: &TrackedScaling, size_mm: f32, node: usize) -> [f32; INPUT_CHANNELS] {
    let place = |index: usize| (index as f32 - (GRID_SIDE - 1) as f32 / 2.0) / (GRID_SIDE / 2) as f32;
    let [x, y] = [place(node % GRID_SIDE), place(node / GRID_SIDE)];
    let value = |channel: usize| grid[channel][node];
    [
        value(0) / size_mm,
        value(1) / size_mm,
        value(2),
        value(3) / size_mm,
        value(4) / size_mm,
        value(5),
        x,
        y,
        x * x + y * y,
        (size_mm / scaling.usual_motion_mm).ln(),
    ]
}

/// What the network computes with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum Precision {
    /// f32 throughout.
    Single,
    /// Weights and activations of all layers but the last in 16 bits, sums in 32: no taxel's force is further
    /// from that in f32 than 1 ‰ of the map's largest (a test holds it to that), in half the time.
    #[default]
    Sixteen,
}

/// The network with its buffers.
#[derive(Debug, Clone)]
pub(super) struct Net {
    scaling: TrackedScaling,
    plan: Plan,
    input: PlaneId,
    output: PlaneId,
}

/// The layers in the making.
struct Layers<I> {
    plan: Plan,
    folded: I,
    instructions: InstructionSet,
}

impl<I: Iterator<Item = Folded>> Layers<I> {
    fn folded(&mut self) -> Folded {
        self.folded.next().expect("one layer per convolution")
    }

    /// The next layer to a plane of its own, in f32.
    fn plain(&mut self, from: PlaneId) -> PlaneId {
        let layer = self.folded().pack(self.instructions);
        self.plan.convolved(layer, from)
    }

    /// The next layer to a plane of its own.
    fn next(&mut self, from: PlaneId, precision: Precision) -> PlaneId {
        let Precision::Sixteen = precision else {
            return self.plain(from);
        };
        let size = self.plan.values(from).size();
        let layer = self.folded().sixteen(self.instructions, size);
        self.plan.sixteened(layer, from)
    }

    /// The next layer to the first channels of a plane.
    fn next_to(&mut self, from: PlaneId, to: PlaneId, precision: Precision) {
        let folded = self.folded();
        match precision {
            Precision::Single => self.plan.convolve(folded.pack(self.instructions), from, to, 0),
            Precision::Sixteen => {
                let size = self.plan.values(from).size();
                let layer = folded.sixteen(self.instructions, size);
                self.plan.sixteen(layer, from, to, 0);
            }
        }
    }
}

impl Net {
    /// Builds the network. `weights` has been checked, so every tensor is there with its shape.
    pub(super) fn new(weights: &TrackedWeights, instructions: InstructionSet, precision: Precision) -> Self {
        let [w20, w10, _] = weights.widths;
        let mut plan = Plan::default();
        let input = plan.plane(GRID_SIDE, GRID_SIDE, INPUT_CHANNELS);
        let joined20 = plan.plane(20, 20, 2 * w20);
        let joined10 = plan.plane(10, 10, 2 * w10);
        let mut layers = Layers {
            plan,
            folded: folded(weights),
            instructions,
        };
        let at20 = layers.next(input, precision);
        let encoded20 = layers.next(at20, precision);
        let at10 = layers.next(encoded20, precision);
        let encoded10 = layers.next(at10, precision);
        let at5 = layers.next(encoded10, precision);
        let at5 = layers.next(at5, precision);
        layers.next_to(at5, joined10, precision);
        layers.plan.copy(encoded10, joined10, w10);
        let at10 = layers.next(joined10, precision);
        layers.next_to(at10, joined20, precision);
        layers.plan.copy(encoded20, joined20, w20);
        let at20 = layers.next(joined20, precision);
        let output = layers.plain(at20);
        Self {
            scaling: weights.scaling,
            plan: layers.plan,
            input,
            output,
        }
    }

    /// Forces in newtons for the grid. No allocation.
    pub(super) fn infer(&mut self, grid: &Grid, out: &mut ForceMap) {
        let size_mm = motion_mm(grid, &self.scaling);
        let input = self.plan.values_mut(self.input);
        for row in 0..GRID_SIDE {
            let nodes = input.row_mut(row).as_chunks_mut::<INPUT_CHANNELS>().0;
            for (column, values) in nodes.iter_mut().enumerate() {
                *values = input_of(grid, &self.scaling, size_mm, row * GRID_SIDE + column);
            }
        }
        self.plan.touch(self.input, &Region::whole(GRID_SIDE, GRID_SIDE));
        self.plan.run();
        let newtons = size_mm * self.scaling.newtons_per_mm;
        let output = self.plan.values(self.output);
        for (row, taxels) in out.chunks_exact_mut(MAP_SIDE).enumerate() {
            for (taxel, forces) in taxels.iter_mut().zip(output.row(row).as_chunks::<3>().0) {
                *taxel = forces.map(|force| force * newtons);
            }
        }
    }

    /// Multiply-adds of a frame.
    pub(super) fn multiply_adds(&self) -> usize {
        self.plan.multiply_adds(self.input)
    }
}
