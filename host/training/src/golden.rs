//! The golden file: image pairs with the training framework's own forces, which the inference engine's tests
//! are held to. Safetensors: `rest` and `now` `[n, 88, 88]` u8, `forces_n` `[n, 3, 20, 20]` f32 in newtons.

use burn::module::Module;
use burn::tensor::Device;
use gripline_network::constants::{IMAGE_SIDE, MAP_SIDE};
use gripline_network::weights::Weights;
use safetensors::serialize;
use safetensors::tensor::{Dtype, TensorView};

use crate::batch;
use crate::constants::GOLDEN_SAMPLES;
use crate::dataset::Dataset;
use crate::model::UNet;

/// The framework's forces in newtons for the set's first samples, `[n, 3, 20, 20]` flattened.
pub(crate) fn forces_n(weights: &Weights, set: &Dataset, samples: &[usize]) -> Vec<f32> {
    let device = Device::flex();
    let mut network = UNet::new(weights.widths, &device);
    network.set_tensors(&weights.tensors, &device);
    let [input, _] = batch::plain(set, samples, weights.scaling, &device);
    let output = network
        .valid()
        .forward(input)
        .mul_scalar(weights.scaling.newtons_per_output);
    output.into_data().try_to_vec().expect("outputs are f32")
}

/// The bytes of the golden file for these weights, over samples spread through the set.
pub(crate) fn to_bytes(weights: &Weights, set: &Dataset) -> Vec<u8> {
    let count = GOLDEN_SAMPLES.min(set.len());
    let samples: Vec<usize> = (0..count).map(|i| i * set.len() / count).collect();
    let rest: Vec<u8> = samples.iter().flat_map(|&sample| *set.rest(sample)).collect();
    let now: Vec<u8> = samples.iter().flat_map(|&sample| *set.now(sample)).collect();
    let forces: Vec<u8> = forces_n(weights, set, &samples)
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    let images = vec![count, IMAGE_SIDE, IMAGE_SIDE];
    let views = [
        ("rest", TensorView::new(Dtype::U8, images.clone(), &rest)),
        ("now", TensorView::new(Dtype::U8, images, &now)),
        (
            "forces_n",
            TensorView::new(Dtype::F32, vec![count, 3, MAP_SIDE, MAP_SIDE], &forces),
        ),
    ]
    .map(|(name, view)| (name, view.expect("the lengths follow from the shapes")));
    serialize(views, None).expect("every view was checked")
}

#[cfg(test)]
mod tests {
    use gripline_network::weights::{Scaling, Weights};
    use gripline_network::{Calibration, ForceNetwork};

    use super::*;
    use crate::constants::WIDTHS;
    use crate::dice::Dice;

    /// Weights as no training leaves them: running statistics far from their start.
    fn weights() -> Weights {
        let device = Device::flex();
        device.seed(3);
        let mut tensors = UNet::new(WIDTHS, &device).tensors();
        let mut dice = Dice::new(3);
        for (name, tensor) in &mut tensors {
            let range = match name.rsplit('.').next() {
                Some("gamma" | "variance") => 0.5..1.5,
                Some("beta" | "mean") => -0.3..0.3,
                _ => continue,
            };
            tensor.values.fill_with(|| dice.between(range.start, range.end));
        }
        Weights {
            widths: WIDTHS,
            scaling: Scaling {
                difference_per_level: 0.06,
                rest_level: 60.0,
                rest_per_level: 0.01,
                newtons_per_output: 0.05,
            },
            calibration: Calibration {
                contact_min_n: 0.02,
                friction: 0.43,
            },
            manifest: "test".to_owned(),
            tensors,
        }
    }

    #[test]
    fn an_exported_file_loads_in_the_engine_and_agrees_with_the_framework() {
        let weights = weights();
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("unet.safetensors");
        std::fs::write(&path, weights.to_bytes()).unwrap();
        let mut engine = ForceNetwork::from_file(&path).unwrap();

        let set = Dataset::noise(4);
        let samples = [0, 1, 2, 3];
        let framework = forces_n(&weights, &set, &samples);
        for (sample, framework) in samples.into_iter().zip(framework.chunks_exact(1200)) {
            let mut out = [[0.0; 3]; 400];
            engine.set_rest(set.rest(sample));
            engine.infer(set.now(sample), &mut out);
            let largest = framework
                .iter()
                .fold(0.0, |largest: f32, force| largest.max(force.abs()));
            for (i, &force) in framework.iter().enumerate() {
                let difference = (out[i % 400][i / 400] - force).abs();
                assert!(
                    difference <= 1e-4 * largest,
                    "sample {sample}: {difference} of {largest}"
                );
            }
        }
    }

    #[test]
    fn tensors_survive_the_way_through_the_framework() {
        let weights = weights();
        let device = Device::flex();
        let mut network = UNet::new(WIDTHS, &device);
        network.set_tensors(&weights.tensors, &device);
        assert_eq!(network.tensors(), weights.tensors);
    }
}
