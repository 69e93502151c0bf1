//! Random weights to start training from.

use burn::tensor::Device;
use gripline_network::tracked::TrackedWeights;
use gripline_network::unet::{Scaling, UnetWeights, Widths};
use gripline_network::{Architecture, Calibration};

use crate::constants::{
    DETECTOR_FRICTION, DIFFERENCE_PER_LEVEL, NEWTONS_PER_OUTPUT, REST_DEVIATION, TRACKED_SCALING,
    TRACKED_WIDTHS, WIDTHS, lens,
};
use crate::dataset::Dataset;
use crate::error::TrainingError;
use crate::model::Model;
use crate::weights::{AnyWeights, Tensors};

/// Random weights of these widths (none: the usual ones), with the scaling that a data set asks for.
pub(crate) fn fresh_weights(
    architecture: Architecture,
    widths: &[usize],
    train: &Dataset,
    device: &Device,
) -> Result<AnyWeights, TrainingError> {
    let calibration = Calibration {
        contact_min_n: 0.02,
        friction: DETECTOR_FRICTION,
    };
    let manifest = "in training".to_owned();
    let mut weights = match architecture {
        Architecture::Unet => {
            let (mean, deviation) = train.rest_levels();
            let [encode44, encode22, encode20, middle10, bottom5, decode20] = channels(widths, WIDTHS)?;
            AnyWeights::Unet(UnetWeights {
                widths: Widths {
                    encode44,
                    encode22,
                    encode20,
                    middle10,
                    bottom5,
                    decode20,
                },
                scaling: Scaling {
                    difference_per_level: DIFFERENCE_PER_LEVEL,
                    rest_level: mean as f32,
                    rest_per_level: REST_DEVIATION / deviation.max(1.0) as f32,
                    newtons_per_output: NEWTONS_PER_OUTPUT,
                },
                calibration,
                manifest,
                tensors: Tensors::new(),
            })
        }
        Architecture::Tracked => AnyWeights::Tracked(TrackedWeights {
            widths: channels(widths, TRACKED_WIDTHS)?,
            lens: lens(),
            scaling: TRACKED_SCALING,
            calibration,
            manifest,
            tensors: Tensors::new(),
        }),
    };
    let tensors = Model::new(&weights, device).tensors();
    weights.set_tensors(tensors);
    Ok(weights)
}

/// The requested channels, or the usual ones. The kernels need multiples of eight.
fn channels<const N: usize>(requested: &[usize], usual: [usize; N]) -> Result<[usize; N], TrainingError> {
    if requested.is_empty() {
        return Ok(usual);
    }
    requested
        .try_into()
        .ok()
        .filter(|widths: &[usize; N]| {
            widths
                .iter()
                .all(|width| width.is_multiple_of(8) && (8..=256).contains(width))
        })
        .ok_or_else(|| {
            TrainingError::Usage(format!(
                "--widths is {requested:?}, expected {N} multiples of 8 from 8 to 256, such as {usual:?}"
            ))
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_are_as_many_as_there_are_sizes_and_multiples_of_eight() {
        assert_eq!(channels(&[], [16, 24, 32]).unwrap(), [16, 24, 32]);
        assert_eq!(channels(&[8, 16, 256], [16, 24, 32]).unwrap(), [8, 16, 256]);
        for wrong in [&[8, 16][..], &[8, 16, 0], &[8, 16, 20], &[8, 16, 264]] {
            let error = channels(wrong, [16, 24, 32]).unwrap_err().to_string();
            assert!(error.contains("3 multiples of 8"), "{error}");
        }
    }
}
