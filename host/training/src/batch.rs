//! Samples to tensors: scaling to the network's units and, for training, augmentation (a random symmetry
//! of the square, salt and pepper, brightness).

use burn::tensor::{Device, Tensor, TensorData};
use gripline_network::constants::{IMAGE_PIXELS, IMAGE_SIDE, MAP_SIDE, TAXELS};
use gripline_network::weights::Scaling;

use crate::constants::{BRIGHTNESS_DRIFT, BRIGHTNESS_SHARED, SALT_AND_PEPPER};
use crate::dataset::Dataset;
use crate::dice::Dice;
use crate::symmetry::Symmetry;

/// Inputs `[batch, 2, 88, 88]` and true outputs `[batch, 3, 20, 20]` of the named samples, as they are.
pub(crate) fn plain(set: &Dataset, samples: &[usize], scaling: Scaling, device: &Device) -> [Tensor<4>; 2] {
    assemble(set, samples, scaling, device, |_, _| Symmetry::ALL[0])
}

/// The same, augmented.
pub(crate) fn augmented(
    set: &Dataset,
    samples: &[usize],
    scaling: Scaling,
    device: &Device,
    dice: &mut Dice,
) -> [Tensor<4>; 2] {
    assemble(set, samples, scaling, device, |rest, now| {
        let shared = 1.0 + dice.between(-BRIGHTNESS_SHARED, BRIGHTNESS_SHARED);
        let drift = 1.0 + dice.between(-BRIGHTNESS_DRIFT, BRIGHTNESS_DRIFT);
        let share = dice.between(0.0, SALT_AND_PEPPER);
        for (image, gain) in [(rest, shared), (now, shared * drift)] {
            for level in image.iter_mut() {
                *level = (*level * gain).round().min(255.0);
            }
            for _ in 0..(share * IMAGE_PIXELS as f32) as usize {
                image[dice.below(IMAGE_PIXELS)] = if dice.below(2) == 0 { 0.0 } else { 255.0 };
            }
        }
        Symmetry::ALL[dice.below(8)]
    })
}

/// Calls `change` on each sample's grey levels (rest, now) before they are moved by the symmetry it returns.
fn assemble(
    set: &Dataset,
    samples: &[usize],
    scaling: Scaling,
    device: &Device,
    mut change: impl FnMut(&mut [f32], &mut [f32]) -> Symmetry,
) -> [Tensor<4>; 2] {
    let mut inputs = Vec::with_capacity(samples.len() * 2 * IMAGE_PIXELS);
    let mut outputs = vec![0.0; samples.len() * 3 * TAXELS];
    for (&sample, outputs) in samples.iter().zip(outputs.chunks_exact_mut(3 * TAXELS)) {
        let mut rest = set.rest(sample).map(f32::from);
        let mut now = set.now(sample).map(f32::from);
        let symmetry = change(&mut rest, &mut now);

        let Scaling {
            difference_per_level,
            rest_level,
            rest_per_level,
            newtons_per_output,
        } = scaling;
        let difference =
            std::array::from_fn::<f32, IMAGE_PIXELS, _>(|i| (now[i] - rest[i]) * difference_per_level);
        let rest = rest.map(|level| (level - rest_level) * rest_per_level);
        inputs.extend(symmetry.image(&difference));
        inputs.extend(symmetry.image(&rest));
        for (taxel, force) in symmetry.map(set.forces_n(sample)).iter().enumerate() {
            for (component, force_n) in force.iter().enumerate() {
                outputs[component * TAXELS + taxel] = force_n / newtons_per_output;
            }
        }
    }
    let count = samples.len();
    [
        Tensor::from_data(
            TensorData::new(inputs, [count, 2, IMAGE_SIDE, IMAGE_SIDE]),
            device,
        ),
        Tensor::from_data(TensorData::new(outputs, [count, 3, MAP_SIDE, MAP_SIDE]), device),
    ]
}
