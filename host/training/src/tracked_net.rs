//! The network after the tracker in the training framework: the same in the eight mirrors of the square. In the network's units:
//! `[batch, 10, 40, 40]` to `[batch, 3, 20, 20]`.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use gripline_network::tracked;

use crate::mirrored::{Field, MirroredOutput, MirroredStage};
use crate::weights::Tensors;

/// The input's channels: motion and confidence of near and far particles, the node's position and squared distance from
/// the centre, and the log of the motion's magnitude.
const INPUT: [Field; 7] = [
    Field::Vector,
    Field::Scalar,
    Field::Vector,
    Field::Scalar,
    Field::Vector,
    Field::Scalar,
    Field::Scalar,
];

/// The network after the tracker.
#[derive(Module, Debug)]
pub(crate) struct TrackedNet {
    encode20a: MirroredStage,
    encode20b: MirroredStage,
    encode10a: MirroredStage,
    encode10b: MirroredStage,
    bottom5a: MirroredStage,
    bottom5b: MirroredStage,
    up10: MirroredStage,
    decode10: MirroredStage,
    up20: MirroredStage,
    decode20: MirroredStage,
    output: MirroredOutput,
}

impl TrackedNet {
    pub(crate) fn new(widths: [usize; 3], device: &Device) -> Self {
        let [
            encode20a,
            encode20b,
            encode10a,
            encode10b,
            bottom5a,
            bottom5b,
            up10,
            decode10,
            up20,
            decode20,
            output,
        ] = tracked::layers(widths);
        let stage = |layer: gripline_network::Layer| {
            MirroredStage::new(layer, &Field::regular(layer.in_channels), device)
        };
        Self {
            encode20a: MirroredStage::new(encode20a, &INPUT, device),
            encode20b: stage(encode20b),
            encode10a: stage(encode10a),
            encode10b: stage(encode10b),
            bottom5a: stage(bottom5a),
            bottom5b: stage(bottom5b),
            up10: stage(up10),
            decode10: stage(decode10),
            up20: stage(up20),
            decode20: stage(decode20),
            output: MirroredOutput::new(output, device),
        }
    }

    pub(crate) fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        let join = |decoder, encoder| Tensor::cat(vec![decoder, encoder], 1);
        let at20 = self.encode20b.forward(self.encode20a.forward(input));
        let at10 = self.encode10b.forward(self.encode10a.forward(at20.clone()));
        let at5 = self.bottom5b.forward(self.bottom5a.forward(at10.clone()));
        let at10 = self.decode10.forward(join(self.up10.forward(at5), at10));
        let at20 = self.decode20.forward(join(self.up20.forward(at10), at20));
        self.output.forward(at20)
    }

    /// Exports all tensors under their names in the weights file.
    pub(crate) fn tensors(&self) -> Tensors {
        let mut tensors = Tensors::new();
        for stage in [
            &self.encode20a,
            &self.encode20b,
            &self.encode10a,
            &self.encode10b,
            &self.bottom5a,
            &self.bottom5b,
            &self.up10,
            &self.decode10,
            &self.up20,
            &self.decode20,
        ] {
            stage.export(&mut tensors);
        }
        self.output.export(&mut tensors);
        tensors
    }

    /// Imports all tensors of a checked weights file of the same widths.
    pub(crate) fn set_tensors(&mut self, tensors: &Tensors, device: &Device) {
        for stage in [
            &mut self.encode20a,
            &mut self.encode20b,
            &mut self.encode10a,
            &mut self.encode10b,
            &mut self.bottom5a,
            &mut self.bottom5b,
            &mut self.up10,
            &mut self.decode10,
            &mut self.up20,
            &mut self.decode20,
        ] {
            stage.import(tensors, device);
        }
        self.output.import(tensors, device);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Dataset;
    use crate::golden::forces_n;
    use crate::initial::fresh_weights;
    use crate::symmetry::Symmetry;
    use gripline_network::{Architecture, ForceMap};

    #[test]
    fn what_is_moved_has_forces_that_are_moved_and_mirrors_differ() {
        let device = Device::flex();
        device.seed(5);
        let set = Dataset::noise(1);
        let weights = fresh_weights(Architecture::Tracked, &[16, 16, 16], &set, &device).unwrap();
        let map = |set: &Dataset| -> ForceMap {
            let forces = forces_n(&weights, set, &[0]);
            std::array::from_fn(|taxel| [0, 1, 2].map(|part| forces[part * 400 + taxel]))
        };
        let plain = map(&set);
        let largest = plain
            .as_flattened()
            .iter()
            .fold(0.0, |max: f32, force| max.max(force.abs()));
        assert!(largest > 0.0);
        for symmetry in Symmetry::ALL {
            let mut moved_set = set.clone();
            let grid = symmetry.grid(&set.grid(0));
            let steps: Vec<i16> = crate::shard::stored_grid(&grid)
                .collect::<Vec<u8>>()
                .as_chunks()
                .0
                .iter()
                .map(|bytes| i16::from_le_bytes(*bytes))
                .collect();
            moved_set.grids[0] = steps.try_into().unwrap();
            let off = |expected: &ForceMap| {
                let found = map(&moved_set);
                let pairs = found.as_flattened().iter().zip(expected.as_flattened());
                pairs.fold(0.0, |max: f32, (found, expected)| {
                    max.max((found - expected).abs())
                })
            };
            assert!(off(&symmetry.map(&plain)) < 1e-4 * largest, "{symmetry:?}");
            let is_moved = symmetry != Symmetry::ALL[0];
            assert_eq!(off(&plain) > 0.1 * largest, is_moved, "{symmetry:?}");
        }
    }
}
