//! The golden file: inputs and the training framework's forces for them. The inference engine's tests compare with it. Safetensors: `rest` and `now` `[n, 88, 88]` u8, or `grid` `[n, 6, 40, 40]` i16 in steps of 1/16384 mm;
//! `forces_n` `[n, 3, 20, 20]` f32 in newtons.

use burn::module::Module;
use burn::tensor::Device;
use gripline_network::constants::{IMAGE_SIDE, MAP_SIDE};
use gripline_network::tracked::{GRID_CHANNELS, GRID_SIDE};
use safetensors::serialize;
use safetensors::tensor::{Dtype, TensorView};

use crate::batch::{self, Batch};
use crate::constants::{GOLDEN_SAMPLES, NEWTONS_PER_OUTPUT};
use crate::dataset::Dataset;
use crate::model::Model;
use crate::weights::AnyWeights;

/// The framework's forces in newtons for the set's first samples, `[n, 3, 20, 20]` flattened.
pub(crate) fn forces_n(weights: &AnyWeights, set: &Dataset, samples: &[usize]) -> Vec<f32> {
    let device = Device::flex();
    let network = Model::loaded(weights, &device);
    let Batch { input, scale, .. } = batch::plain(set, samples, weights, &device);
    let output = network.valid().forward(input) * scale.mul_scalar(NEWTONS_PER_OUTPUT);
    output.into_data().try_to_vec().expect("outputs are f32")
}

/// The bytes of the golden file for these weights, over samples spread through the set.
pub(crate) fn to_bytes(weights: &AnyWeights, set: &Dataset) -> Vec<u8> {
    // A grid is as large as three pairs of images.
    let max = match weights {
        AnyWeights::Unet(_) => GOLDEN_SAMPLES,
        AnyWeights::Tracked(_) => GOLDEN_SAMPLES / 2,
    };
    let count = max.min(set.len());
    let samples: Vec<usize> = (0..count).map(|i| i * set.len() / count).collect();
    let forces: Vec<u8> = forces_n(weights, set, &samples)
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    let images = vec![count, IMAGE_SIDE, IMAGE_SIDE];
    let inputs: Vec<(&str, Dtype, Vec<usize>, Vec<u8>)> = match weights {
        AnyWeights::Unet(_) => {
            let rest = samples.iter().flat_map(|&sample| *set.rest(sample)).collect();
            let now = samples.iter().flat_map(|&sample| *set.now(sample)).collect();
            vec![
                ("rest", Dtype::U8, images.clone(), rest),
                ("now", Dtype::U8, images, now),
            ]
        }
        AnyWeights::Tracked(_) => {
            let grids = samples.iter().flat_map(|&sample| set.stored_grid(sample));
            let bytes = grids.flat_map(|step| step.to_le_bytes()).collect();
            let shape = vec![count, GRID_CHANNELS, GRID_SIDE, GRID_SIDE];
            vec![("grid", Dtype::I16, shape, bytes)]
        }
    };
    let forces = ("forces_n", Dtype::F32, vec![count, 3, MAP_SIDE, MAP_SIDE], forces);
    let views = inputs.iter().chain([&forces]).map(|(name, dtype, shape, bytes)| {
        let view = TensorView::new(*dtype, shape.clone(), bytes);
        (*name, view.expect("the lengths follow from the shapes"))
    });
    serialize(views, None).expect("every view was checked")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::initial::fresh_weights;
    use crate::rng::Rng;
    use crate::weights::Engine;
    use gripline_network::{Architecture, Precision};

    /// Weights as no training leaves them: running statistics far from their start.
    fn weights(architecture: Architecture) -> AnyWeights {
        let device = Device::flex();
        device.seed(3);
        let mut weights = fresh_weights(architecture, &[], &Dataset::noise(2), &device).unwrap();
        let mut tensors = weights.tensors().clone();
        let mut rng = Rng::new(3);
        for (name, tensor) in &mut tensors {
            let range = match name.rsplit('.').next() {
                Some("gamma" | "variance") => 0.5..1.5,
                // So that no layer's outputs are all negative.
                Some("beta") => 0.0..0.3,
                Some("mean") => -0.3..0.0,
                _ => continue,
            };
            // The same for the eight channels of a field, as `tracked` has them.
            for field in tensor.values.chunks_mut(8) {
                field.fill(rng.between(range.start, range.end));
            }
        }
        weights.set_tensors(tensors);
        weights
    }

    #[test]
    fn an_exported_file_loads_in_the_engine_and_agrees_with_the_framework() {
        for architecture in [Architecture::Unet, Architecture::Tracked] {
            let weights = weights(architecture);
            let directory = tempfile::tempdir().unwrap();
            let path = directory.path().join("weights.safetensors");
            std::fs::write(&path, weights.to_bytes()).unwrap();
            let loaded = AnyWeights::from_file(architecture, &path).unwrap();
            assert_eq!(loaded, weights);
            // In f32; the engine's own tests bound the error of int16.
            let mut engine = match loaded.engine().unwrap() {
                Engine::Tracked(network) => Engine::Tracked(Box::new(network.with_precision(Precision::F32))),
                unet @ Engine::Unet(_) => unet,
            };

            let set = Dataset::noise(4);
            let samples = [0, 1, 2, 3];
            let framework = forces_n(&weights, &set, &samples);
            for (sample, framework) in samples.into_iter().zip(framework.chunks_exact(1200)) {
                let out = engine.infer(&set, sample);
                let largest = framework
                    .iter()
                    .fold(0.0, |largest: f32, force| largest.max(force.abs()));
                assert!(largest > 0.0);
                for (i, &force) in framework.iter().enumerate() {
                    let difference = (out[i % 400][i / 400] - force).abs();
                    assert!(
                        difference <= 1e-4 * largest,
                        "{architecture:?}, sample {sample}: {difference} of {largest}"
                    );
                }
            }
        }
    }

    #[test]
    fn tensors_survive_import_and_export() {
        for architecture in [Architecture::Unet, Architecture::Tracked] {
            let weights = weights(architecture);
            let tensors = Model::loaded(&weights, &Device::flex()).tensors();
            assert!(tensors.keys().eq(weights.tensors().keys()));
            for (name, tensor) in weights.tensors() {
                assert_eq!(tensors[name].shape, tensor.shape, "{name}");
                // Of `tracked` means of eight numbers that are equal, but for their signs, may round.
                let largest = tensor
                    .values
                    .iter()
                    .fold(0.0, |largest: f32, value| largest.max(value.abs()));
                let rounding = match architecture {
                    Architecture::Unet => 0.0,
                    Architecture::Tracked => 1e-6 * largest,
                };
                for (found, value) in tensors[name].values.iter().zip(&tensor.values) {
                    assert!((found - value).abs() <= rounding, "{name}: {found}, {value}");
                }
            }
        }
    }
}
