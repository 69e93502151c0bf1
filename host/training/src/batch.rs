//! Samples to tensors: scaling to the networks' units and, for training, augmentation of images (a random symmetry of the
//! square, salt and pepper, brightness).

use burn::tensor::{Device, Tensor, TensorData};
use gripline_network::constants::{IMAGE_PIXELS, IMAGE_SIDE, MAP_SIDE, TAXELS};
use gripline_network::tracked::{self, GRID_SIDE, INPUT_CHANNELS, TrackedScaling};
use gripline_network::unet::Scaling;

use crate::ablation::{Ablation, Part};
use crate::constants::{BRIGHTNESS_DRIFT, BRIGHTNESS_SHARED, NEWTONS_PER_OUTPUT, SALT_AND_PEPPER};
use crate::dataset::Dataset;
use crate::rng::Rng;
use crate::symmetry::Symmetry;
use crate::weights::AnyWeights;

/// Samples as the training framework takes them.
pub(crate) struct Batch {
    /// `[batch, 2, 88, 88]` or `[batch, 10, 40, 40]`.
    pub(crate) input: Tensor<4>,
    /// What a network's output is multiplied with to be in the loss's units, `[batch, 1, 1, 1]`.
    pub(crate) scale: Tensor<4>,
    /// True forces in the loss's units, `[batch, 3, 20, 20]`.
    pub(crate) truth: Tensor<4>,
}

/// The named samples as they are.
pub(crate) fn plain(set: &Dataset, samples: &[usize], weights: &AnyWeights, device: &Device) -> Batch {
    assemble(set, samples, weights, device, None)
}

/// The same, augmented.
pub(crate) fn augmented(
    set: &Dataset,
    samples: &[usize],
    weights: &AnyWeights,
    device: &Device,
    augmentation: (&Ablation, &mut Rng),
) -> Batch {
    assemble(set, samples, weights, device, Some(augmentation))
}

fn assemble(
    set: &Dataset,
    samples: &[usize],
    weights: &AnyWeights,
    device: &Device,
    mut augmentation: Option<(&Ablation, &mut Rng)>,
) -> Batch {
    let count = samples.len();
    let (mut inputs, mut scales) = (Vec::new(), Vec::with_capacity(count));
    let mut outputs = vec![0.0; count * 3 * TAXELS];
    for (&sample, outputs) in samples.iter().zip(outputs.chunks_exact_mut(3 * TAXELS)) {
        let augmentation = augmentation
            .as_mut()
            .map(|(ablation, rng)| (*ablation, &mut **rng));
        let (symmetry, scale) = match weights {
            AnyWeights::Unet(weights) => {
                let symmetry = images(set, sample, weights.scaling, augmentation, &mut inputs);
                (symmetry, weights.scaling.newtons_per_output / NEWTONS_PER_OUTPUT)
            }
            AnyWeights::Tracked(weights) => {
                let rms_mm = grid(set, sample, &weights.scaling, &mut inputs);
                let scale = rms_mm * weights.scaling.newtons_per_mm / NEWTONS_PER_OUTPUT;
                (Symmetry::ALL[0], scale)
            }
        };
        scales.push(scale);
        for (taxel, force) in symmetry.map(set.forces_n(sample)).iter().enumerate() {
            for (component, force_n) in force.iter().enumerate() {
                outputs[component * TAXELS + taxel] = force_n / NEWTONS_PER_OUTPUT;
            }
        }
    }
    let shape = match weights {
        AnyWeights::Unet(_) => [count, 2, IMAGE_SIDE, IMAGE_SIDE],
        AnyWeights::Tracked(_) => [count, INPUT_CHANNELS, GRID_SIDE, GRID_SIDE],
    };
    Batch {
        input: Tensor::from_data(TensorData::new(inputs, shape), device),
        scale: Tensor::from_data(TensorData::new(scales, [count, 1, 1, 1]), device),
        truth: Tensor::from_data(TensorData::new(outputs, [count, 3, MAP_SIDE, MAP_SIDE]), device),
    }
}

/// Adds a sample's two input images, moved by the symmetry that is returned.
fn images(
    set: &Dataset,
    sample: usize,
    scaling: Scaling,
    augmentation: Option<(&Ablation, &mut Rng)>,
    inputs: &mut Vec<f32>,
) -> Symmetry {
    let mut rest = set.rest(sample).map(f32::from);
    let mut now = set.now(sample).map(f32::from);
    let symmetry = augmentation.map_or(Symmetry::ALL[0], |(ablation, rng)| {
        let mut between = |part, low, high| {
            if ablation.uses(part) {
                rng.between(low, high)
            } else {
                0.0
            }
        };
        let shared = 1.0 + between(Part::Brightness, -BRIGHTNESS_SHARED, BRIGHTNESS_SHARED);
        let drift = 1.0 + between(Part::Brightness, -BRIGHTNESS_DRIFT, BRIGHTNESS_DRIFT);
        let share = between(Part::SaltAndPepper, 0.0, SALT_AND_PEPPER);
        for (image, gain) in [(&mut rest, shared), (&mut now, shared * drift)] {
            for level in image.iter_mut() {
                *level = (*level * gain).round().min(255.0);
            }
            for _ in 0..(share * IMAGE_PIXELS as f32) as usize {
                image[rng.below(IMAGE_PIXELS)] = if rng.below(2) == 0 { 0.0 } else { 255.0 };
            }
        }
        any_symmetry(ablation, rng)
    });
    let Scaling {
        difference_per_level,
        rest_level,
        rest_per_level,
        ..
    } = scaling;
    let difference =
        std::array::from_fn::<f32, IMAGE_PIXELS, _>(|i| (now[i] - rest[i]) * difference_per_level);
    let rest = rest.map(|level| (level - rest_level) * rest_per_level);
    inputs.extend(symmetry.image(&difference));
    inputs.extend(symmetry.image(&rest));
    symmetry
}

/// Adds a sample's grid; returns the RMS of its motions, mm. Nothing is augmented: the network computes the same in every mirror.
fn grid(set: &Dataset, sample: usize, scaling: &TrackedScaling, inputs: &mut Vec<f32>) -> f32 {
    let (nodes, rms_mm) = tracked::input(&set.grid(sample), scaling);
    for channel in 0..INPUT_CHANNELS {
        inputs.extend(nodes.iter().map(|values| values[channel]));
    }
    rms_mm
}

/// One of the eight, or the first alone where training does without them.
fn any_symmetry(ablation: &Ablation, rng: &mut Rng) -> Symmetry {
    let count = if ablation.uses(Part::Symmetries) { 8 } else { 1 };
    Symmetry::ALL[rng.below(count)]
}
