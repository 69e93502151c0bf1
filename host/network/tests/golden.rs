//! The engine against the training framework: the golden file holds image pairs and the framework's own
//! forces for the embedded weights.

use gripline_network::weights::Weights;
use gripline_network::{ForceNetwork, OUTPUT, layers};
use safetensors::SafeTensors;

const WEIGHTS: &[u8] = include_bytes!("../weights/unet.safetensors");
const GOLDEN: &[u8] = include_bytes!("../golden/unet.safetensors");

/// Largest difference allowed, in shares of the sample's largest force (issue 2).
const BOUND: f32 = 1e-4;

struct Sample {
    rest: [u8; 7744],
    now: [u8; 7744],
    /// Newtons, x then y then z, 400 each.
    forces_n: [f32; 1200],
}

fn golden() -> Vec<Sample> {
    let file = SafeTensors::deserialize(GOLDEN).unwrap();
    let data = |name: &str| file.tensor(name).unwrap().data();
    let forces: Vec<f32> = data("forces_n")
        .as_chunks()
        .0
        .iter()
        .map(|bytes| f32::from_le_bytes(*bytes))
        .collect();
    let images = |name| data(name).as_chunks::<7744>().0;
    images("rest")
        .iter()
        .zip(images("now"))
        .zip(forces.as_chunks::<1200>().0)
        .map(|((rest, now), forces_n)| Sample {
            rest: *rest,
            now: *now,
            forces_n: *forces_n,
        })
        .collect()
}

/// Per sample: largest difference over largest force.
fn differences(weights: &Weights, samples: &[Sample]) -> Vec<f32> {
    let mut network = ForceNetwork::from_weights(weights).unwrap();
    let mut out = [[0.0; 3]; 400];
    samples
        .iter()
        .map(|sample| {
            network.set_rest(&sample.rest);
            network.infer(&sample.now, &mut out);
            let largest = |values: &mut dyn Iterator<Item = f32>| values.map(f32::abs).fold(0.0, f32::max);
            let difference = largest(&mut (0..1200).map(|i| out[i % 400][i / 400] - sample.forces_n[i]));
            difference / largest(&mut sample.forces_n.iter().copied())
        })
        .collect()
}

/// The largest of them.
fn worst(weights: &Weights, samples: &[Sample]) -> f32 {
    differences(weights, samples).into_iter().fold(0.0, f32::max)
}

#[test]
fn forces_agree_with_the_training_frameworks_to_1e_4() {
    let samples = golden();
    assert!(samples.len() >= 8);
    for (i, difference) in differences(&Weights::parse(WEIGHTS).unwrap(), &samples)
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
    let right = Weights::parse(WEIGHTS).unwrap();
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
    let right = Weights::parse(WEIGHTS).unwrap();
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
    let right = Weights::parse(WEIGHTS).unwrap();
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
    let mut seasoned = ForceNetwork::embedded().unwrap();
    let mut out = [[0.0; 3]; 400];
    for sample in &samples {
        seasoned.set_rest(&sample.rest);
        seasoned.infer(&sample.now, &mut out);
    }
    let (mut first, mut again) = ([[0.0; 3]; 400], [[9.0; 3]; 400]);
    let mut fresh = ForceNetwork::embedded().unwrap();
    fresh.set_rest(&samples[0].rest);
    fresh.infer(&samples[0].now, &mut first);
    seasoned.set_rest(&samples[0].rest);
    seasoned.infer(&samples[0].now, &mut again);
    assert_eq!(first, again);
}
