//! The crate from outside: both networks against the training framework's outputs, skipping against computing everything,
//! weights files, allocations.

mod golden;
mod skipping;
mod tracked;
mod weights_file;

use gripline_network::{ForceMap, InstructionSet};
use safetensors::SafeTensors;

const UNET: &[u8] = include_bytes!("../../weights/unet.safetensors");
const TRACKED: &[u8] = include_bytes!("../../weights/tracked.safetensors");
const UNET_GOLDEN: &[u8] = include_bytes!("../../golden/unet.safetensors");
const TRACKED_GOLDEN: &[u8] = include_bytes!("../../golden/tracked.safetensors");

/// Pseudo-random numbers (an LCG's upper bits).
struct Rng(u64);

impl Rng {
    fn below(&mut self, below: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % below
    }

    /// In [0, 1).
    fn unit(&mut self) -> f32 {
        self.below(1 << 20) as f32 / (1 << 20) as f32
    }
}

/// Bytes of a golden tensor.
fn golden_tensor<'a>(golden: &'a [u8], name: &str) -> &'a [u8] {
    SafeTensors::deserialize(golden)
        .unwrap()
        .tensor(name)
        .unwrap()
        .data()
}

/// The training framework's forces, newtons: per sample 400 x, 400 y, 400 z.
fn golden_forces(golden: &[u8]) -> Vec<[f32; 1200]> {
    let bytes = golden_tensor(golden, "forces_n").as_chunks::<4>().0;
    let forces: Vec<f32> = bytes.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    forces.as_chunks().0.to_vec()
}

/// Largest difference of a map to the framework's forces, relative to the largest force.
fn relative_difference(map: &ForceMap, expected: &[f32; 1200]) -> f32 {
    let max = |values: &mut dyn Iterator<Item = f32>| values.map(f32::abs).fold(0.0, f32::max);
    let difference = max(&mut (0..1200).map(|i| map[i % 400][i / 400] - expected[i]));
    difference / max(&mut expected.iter().copied())
}

fn bits(forces_n: &ForceMap) -> Vec<u32> {
    forces_n
        .as_flattened()
        .iter()
        .map(|force| force.to_bits())
        .collect()
}

/// The instruction sets of this processor.
fn sets() -> impl Iterator<Item = InstructionSet> {
    InstructionSet::ALL.into_iter().filter(|set| set.is_available())
}
