//! The encoder–decoder against the training framework: the golden file holds image pairs and the framework's forces for the
//! built-in weights.

use gripline_network::unet::{UnetNetwork, UnetWeights, layers};
use gripline_network::{NO_FORCES, OUTPUT};

use crate::{UNET, UNET_GOLDEN, golden_forces, golden_tensor, relative_difference};

/// Largest difference allowed, relative to the sample's largest force.
const BOUND: f32 = 1e-4;

struct Sample {
    rest: [u8; 7744],
    now: [u8; 7744],
    /// Newtons, x then y then z, 400 each.
    forces_n: [f32; 1200],
}

fn golden() -> Vec<Sample> {
    let images = |name| golden_tensor(UNET_GOLDEN, name).as_chunks::<7744>().0;
    images("rest")
        .iter()
        .zip(images("now"))
        .zip(golden_forces(UNET_GOLDEN))
        .map(|((rest, now), forces_n)| Sample {
            rest: *rest,
            now: *now,
            forces_n,
        })
        .collect()
}

/// Per sample: largest difference over largest force.
fn differences(weights: &UnetWeights, samples: &[Sample]) -> Vec<f32> {
    let mut network = UnetNetwork::from_weights(weights).unwrap();
    let mut out = NO_FORCES;
    samples
        .iter()
        .map(|sample| {
            network.set_rest(&sample.rest);
            network.infer(&sample.now, &mut out);
            relative_difference(&out, &sample.forces_n)
        })
        .collect()
}

/// The largest of them.
fn worst(weights: &UnetWeights, samples: &[Sample]) -> f32 {
    differences(weights, samples).into_iter().fold(0.0, f32::max)
}

#[test]
fn forces_agree_with_the_training_frameworks_to_1e_4() {
    let samples = golden();
    assert!(samples.len() >= 8);
    for (i, difference) in differences(&UnetWeights::parse(UNET).unwrap(), &samples)
        .into_iter()
        .enumerate()
    {
        assert!(
            difference <= BOUND,
            "sample {i} differs by {difference:e} of its largest force"
        );
    }
}

#[test]
fn one_weight_wrong_by_one_percent_breaks_that_bound() {
    let samples = golden();
    let right = UnetWeights::parse(UNET).unwrap();
    for name in ["encode44.weight", "up20.weight", "output.weight"] {
        let mut wrong = right.clone();
        let values = &mut wrong.tensors.get_mut(name).unwrap().values;
        let largest = values
            .iter_mut()
            .max_by(|a, b| a.abs().total_cmp(&b.abs()))
            .unwrap();
        *largest *= 1.01;
        assert!(worst(&wrong, &samples) > BOUND, "{name}");
    }
}

#[test]
fn one_kernel_transposed_in_any_layer_breaks_that_bound() {
    let samples = golden();
    let right = UnetWeights::parse(UNET).unwrap();
    for layer in layers(right.widths) {
        let mut wrong = right.clone();
        let values = &mut wrong
            .tensors
            .get_mut(&format!("{}.weight", layer.name))
            .unwrap()
            .values;
        let size = |kernel: &[f32; 9]| kernel.iter().map(|weight| weight * weight).sum::<f32>();
        let kernels = values.as_chunks_mut::<9>().0;
        let kernel = kernels
            .iter_mut()
            .max_by(|a, b| size(a).total_cmp(&size(b)))
            .unwrap();
        *kernel = std::array::from_fn(|i| kernel[i % 3 * 3 + i / 3]);
        assert!(worst(&wrong, &samples) > BOUND, "{}", layer.name);
    }
}

#[test]
fn running_statistics_and_output_bias_are_not_ignored() {
    let samples = golden();
    let right = UnetWeights::parse(UNET).unwrap();
    for name in [
        "decode20a.norm.mean",
        "decode20a.norm.variance",
        "decode20a.norm.beta",
        "decode20a.norm.gamma",
    ] {
        let mut wrong = right.clone();
        wrong
            .tensors
            .get_mut(name)
            .unwrap()
            .values
            .iter_mut()
            .for_each(|value| *value *= 1.01);
        assert!(
            differences(&wrong, &samples).into_iter().fold(0.0, f32::max) > BOUND,
            "{name}"
        );
    }
    let mut wrong = right.clone();
    wrong.tensors.get_mut(&format!("{OUTPUT}.bias")).unwrap().values[2] += 0.01;
    assert!(worst(&wrong, &samples) > BOUND);
}

#[test]
fn a_frame_does_not_depend_on_the_frames_before_it() {
    let samples = golden();
    let mut used = UnetNetwork::embedded().unwrap();
    let mut out = NO_FORCES;
    for sample in &samples {
        used.set_rest(&sample.rest);
        used.infer(&sample.now, &mut out);
    }
    let (mut first, mut again) = (NO_FORCES, [[9.0; 3]; 400]);
    let mut fresh = UnetNetwork::embedded().unwrap();
    fresh.set_rest(&samples[0].rest);
    fresh.infer(&samples[0].now, &mut first);
    used.set_rest(&samples[0].rest);
    used.infer(&samples[0].now, &mut again);
    assert_eq!(first, again);
}
