//! The choices of training, each with unit and source.

pub(crate) use gripline_network::constants::DETECTOR_FRICTION;
use gripline_network::tracked::{Lens, TrackedScaling};
use gripline_simulation::{Camera, Gel};

/// Channels of the encoder–decoder at 44×44, 22×22, 20×20, 10×10, 5×5, and of its last layers at 20×20: 19 M
/// multiply-adds (0.8 ms on one core with the portable kernel), 155 k weights. Twice the channels of the smallest
/// prototype in the first layers, where displacement is measured, and at the bottom, which sees the whole map.
pub(crate) const WIDTHS: [usize; 6] = [16, 24, 32, 32, 64, 16];

/// Input units per grey level of difference: 15 per full scale (prototype).
pub(crate) const DIFFERENCE_PER_LEVEL: f32 = 15.0 / 255.0;

/// Input units of one standard deviation of the rest images' grey levels. Their mean becomes 0.
pub(crate) const REST_DEVIATION: f32 = 0.5;

/// Newtons per taxel and unit of output (prototype; peak taxels carry 0.04–3 N).
pub(crate) const NEWTONS_PER_OUTPUT: f32 = 0.05;

/// Samples per gradient step.
pub(crate) const BATCH: usize = 32;

/// Peak learning rate of the one-cycle schedule (prototype).
pub(crate) const LEARNING_RATE: f64 = 3e-3;

/// Share of the steps in which the learning rate rises.
pub(crate) const WARM_UP: f64 = 0.15;

/// Decoupled weight decay (prototype).
pub(crate) const WEIGHT_DECAY: f32 = 1e-3;

/// Squared output added to a sample's mean square, so that empty samples weigh finitely: (0.14 units)², 7 mN.
pub(crate) const LOSS_FLOOR: f32 = 0.02;

/// Weight of x and y errors against z errors: the detector compares f_T with μ f_z, so an error of z counts
/// less than half for it, and shear is learned last.
pub(crate) const SHEAR_WEIGHT: f32 = 2.0;

/// Weight of the loss on (f_T − μ f_z) in loaded taxels (prototype: stick ratio error −20 %).
pub(crate) const CONE_WEIGHT: f32 = 0.5;

/// Normal force above which the cone loss counts a taxel, output units: 10 mN.
pub(crate) const CONE_LOADED: f32 = 0.2;

/// Weight of the loss on the summed force: with 0.2 F_N is off by 2.5 instead of 2.2 %.
pub(crate) const TOTAL_WEIGHT: f32 = 3.0;

/// Squared output added to the square of the summed force: (5.5 units)², 0.27 N.
pub(crate) const TOTAL_FLOOR: f32 = 30.0;

/// Largest share of pixels that augmentation turns black or white.
pub(crate) const SALT_AND_PEPPER: f32 = 0.004;

/// Largest relative change of brightness that both images share, on top of the world's own.
pub(crate) const BRIGHTNESS_SHARED: f32 = 0.1;

/// Largest relative change of brightness between rest and now, on top of the world's own.
pub(crate) const BRIGHTNESS_DRIFT: f32 = 0.01;

/// Pairs in the golden file.
pub(crate) const GOLDEN_SAMPLES: usize = 12;

/// Version of the shards' layout; others are refused.
pub(crate) const DATA_VERSION: u32 = 5;

/// Samples per shard, all from one random stream of the simulation: one second of work, 5 MB.
pub(crate) const SHARD_SAMPLES: usize = 250;

/// Steps of a stored grid per millimetre, and per share: a sixteenth of a micrometre.
pub(crate) const GRID_STEPS: f32 = 16_384.0;

/// Channels of the tracking network at 20×20, 10×10 and 5×5: 16 M multiply-adds. With 24 and 32 at 10×10 and 5×5 (7 M) F_T is off by 8.2
/// instead of 5.1 %.
pub(crate) const TRACKED_WIDTHS: [usize; 3] = [16, 48, 64];

/// Scaling of the tracking network: the tracker's noise at rest is 2 µm, a usual load moves particles by 30 µm.
pub(crate) const TRACKED_SCALING: TrackedScaling = TrackedScaling {
    min_motion_mm: 0.002,
    reference_motion_mm: 0.03,
    newtons_per_mm: 1.5,
};

/// The nominal camera. Every virtual sensor differs from it a little, as real ones do, and the network has to cope.
pub(crate) fn lens() -> Lens {
    let camera = Camera::default();
    let corner = gripline_simulation::constants::CROP_CORNER_PX;
    Lens {
        focal_px_per_rad: camera.focal_px_per_rad as f32,
        centre_px: [0, 1].map(|k| (camera.centre_px[k] - corner[k] as f64) as f32),
        base_mm: camera.to_base_mm as f32,
        thickness_mm: Gel::default().thickness_mm as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loss::SHEAR_FLOOR;

    #[test]
    fn training_with_pytorch_uses_the_same_numbers() {
        let program = include_str!("../pytorch/train.py");
        // From lines like `A, B = 1, 2`.
        let in_program = |name: &str| -> f64 {
            let value = program.lines().find_map(|line| {
                let (names, values) = line.split_once(" = ")?;
                let place = names.split(", ").position(|other| other == name)?;
                values.split(", ").nth(place)?.parse().ok()
            });
            value.unwrap_or_else(|| panic!("train.py sets no {name}"))
        };
        for (name, ours) in [
            ("WARM_UP", WARM_UP as f32),
            ("WEIGHT_DECAY", WEIGHT_DECAY),
            ("LOSS_FLOOR", LOSS_FLOOR),
            ("SHEAR_WEIGHT", SHEAR_WEIGHT),
            ("CONE_WEIGHT", CONE_WEIGHT),
            ("CONE_LOADED", CONE_LOADED),
            ("TOTAL_WEIGHT", TOTAL_WEIGHT),
            ("TOTAL_FLOOR", TOTAL_FLOOR),
            ("SHEAR_FLOOR", SHEAR_FLOOR),
            ("DETECTOR_FRICTION", DETECTOR_FRICTION),
            ("NEWTONS_PER_OUTPUT", NEWTONS_PER_OUTPUT),
            ("GRID_STEPS", GRID_STEPS),
            ("BATCH", 2.0 * BATCH as f32),
            ("RATE", (LEARNING_RATE * 4.0 / 3.0) as f32),
        ] {
            assert_eq!((in_program(name) as f32).to_bits(), ours.to_bits(), "{name}");
        }
        let widths = TRACKED_WIDTHS.map(|width| width.to_string()).join(",");
        assert!(
            program.contains(&format!("\"--widths\", default=\"{widths}\"")),
            "{widths}"
        );
    }
}
