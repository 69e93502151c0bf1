//! The network after the tracker: a small encoder–decoder from the 40×40 grid of motions to 20×20 forces. It is deep
//! enough for every taxel to see the whole fingertip, because the elastic layer couples that far.

use gripline_kernels::{InputSign, InstructionSet, Int16Convolution, Plan, PlaneId, Region};

use super::grid::{GRID_NODES, GRID_SIDE, Grid};
use super::layers::INPUT_CHANNELS;
use super::weights::{TrackedScaling, TrackedWeights};
use crate::constants::MAP_SIDE;
use crate::force_map::ForceMap;
use crate::layer::Folded;
use crate::options::Precision;

/// The network's input, and the RMS motion, mm, by which its outputs are multiplied.
#[must_use]
pub fn input(grid: &Grid, scaling: &TrackedScaling) -> (Vec<[f32; INPUT_CHANNELS]>, f32) {
    let mut nodes = vec![[0.0; INPUT_CHANNELS]; GRID_NODES];
    let rms_mm = rms_motion_mm(grid, scaling);
    for (node, values) in nodes.iter_mut().enumerate() {
        *values = input_of(grid, scaling, rms_mm, node);
    }
    (nodes, rms_mm)
}

/// Root mean square of the motions, weighted by confidence, mm; at least the noise.
fn rms_motion_mm(grid: &Grid, scaling: &TrackedScaling) -> f32 {
    let (mut squares, mut weights) = (0.0_f32, 0.0_f32);
    for [x, y, weight] in grid.as_chunks::<3>().0 {
        for ((x, y), weight) in x.iter().zip(y).zip(weight) {
            squares += weight * (x * x + y * y);
            weights += weight;
        }
    }
    (squares / weights.max(1.0)).sqrt().max(scaling.min_motion_mm)
}

fn input_of(grid: &Grid, scaling: &TrackedScaling, rms_mm: f32, node: usize) -> [f32; INPUT_CHANNELS] {
    let position = |index: usize| (index as f32 - (GRID_SIDE - 1) as f32 / 2.0) / (GRID_SIDE / 2) as f32;
    let [x, y] = [position(node % GRID_SIDE), position(node / GRID_SIDE)];
    let value = |channel: usize| grid[channel][node];
    [
        value(0) / rms_mm,
        value(1) / rms_mm,
        value(2),
        value(3) / rms_mm,
        value(4) / rms_mm,
        value(5),
        x,
        y,
        x * x + y * y,
        (rms_mm / scaling.reference_motion_mm).ln(),
    ]
}

/// The network with its buffers.
#[derive(Debug, Clone)]
pub(super) struct GridNet {
    scaling: TrackedScaling,
    plan: Plan,
    input: PlaneId,
    output: PlaneId,
}

/// Builds the plan layer by layer.
struct Layers<I> {
    plan: Plan,
    folded: I,
    instructions: InstructionSet,
    /// The plane of the network's input, the only one that is not behind a ReLU.
    input: PlaneId,
}

impl<I: Iterator<Item = Folded>> Layers<I> {
    fn folded(&mut self) -> Folded {
        self.folded.next().expect("one layer per convolution")
    }

    /// A layer in int16 on that plane.
    fn int16(&self, folded: &Folded, from: PlaneId) -> Int16Convolution {
        let sign = if from == self.input {
            InputSign::Any
        } else {
            InputSign::NotNegative
        };
        folded.pack_int16(self.instructions, self.plan.values(from).size(), sign)
    }

    /// Adds the next layer in f32, with a new plane.
    fn plain(&mut self, from: PlaneId) -> PlaneId {
        let layer = self.folded().pack(self.instructions);
        self.plan.convolved(layer, from)
    }

    /// Adds the next layer, with a new plane.
    fn next(&mut self, from: PlaneId, precision: Precision) -> PlaneId {
        let Precision::Int16 = precision else {
            return self.plain(from);
        };
        let folded = self.folded();
        let layer = self.int16(&folded, from);
        self.plan.convolved_int16(layer, from)
    }

    /// Adds the next layer, which writes the first channels of `to`.
    fn next_to(&mut self, from: PlaneId, to: PlaneId, precision: Precision) {
        let folded = self.folded();
        match precision {
            Precision::F32 => self.plan.convolve(folded.pack(self.instructions), from, to, 0),
            Precision::Int16 => {
                let layer = self.int16(&folded, from);
                self.plan.convolve_int16(layer, from, to, 0);
            }
        }
    }
}

impl GridNet {
    /// Builds the network. `weights` has been checked, so every tensor is there with its shape.
    pub(super) fn new(weights: &TrackedWeights, instructions: InstructionSet, precision: Precision) -> Self {
        let [w20, w10, _] = weights.widths;
        let mut plan = Plan::default();
        let input = plan.plane(GRID_SIDE, GRID_SIDE, INPUT_CHANNELS);
        let joined20 = plan.plane(20, 20, 2 * w20);
        let joined10 = plan.plane(10, 10, 2 * w10);
        let mut layers = Layers {
            plan,
            folded: weights.folded(),
            instructions,
            input,
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
        let rms_mm = rms_motion_mm(grid, &self.scaling);
        let input = self.plan.values_mut(self.input);
        for row in 0..GRID_SIDE {
            let nodes = input.row_mut(row).as_chunks_mut::<INPUT_CHANNELS>().0;
            for (column, values) in nodes.iter_mut().enumerate() {
                *values = input_of(grid, &self.scaling, rms_mm, row * GRID_SIDE + column);
            }
        }
        self.plan
            .mark_dirty(self.input, &Region::whole(GRID_SIDE, GRID_SIDE));
        self.plan.run();
        let newtons = rms_mm * self.scaling.newtons_per_mm;
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
