//! From the camera's crop to each network's input tensor, for other engines.

use gripline_network::image::Image88;
use gripline_network::tracked::{self, GridInterpolator, Lens, TrackedScaling, TrackedWeights, Tracker};
use gripline_network::unet::{Scaling, UnetWeights};
use gripline_network::{ForceMap, downsample_440_to_88};

use crate::onnx;

/// A network's input, channel by channel, and what its outputs are to be multiplied with.
#[derive(Clone)]
pub(crate) struct NetworkInput {
    pub(crate) values: Vec<f32>,
    newtons_per_output: f32,
}

impl NetworkInput {
    /// The network's outputs, 3×400, as forces.
    pub(crate) fn forces_n(&self, outputs: &[f32]) -> ForceMap {
        std::array::from_fn(|taxel| {
            std::array::from_fn(|component| outputs[component * 400 + taxel] * self.newtons_per_output)
        })
    }
}

/// The steps before a network.
#[derive(Clone)]
pub(crate) enum Preprocessor {
    Unet {
        scaling: Scaling,
        rest: Box<Image88>,
    },
    Tracked {
        lens: Lens,
        scaling: TrackedScaling,
        tracker: Box<Tracker>,
        interpolator: Box<GridInterpolator>,
    },
}

/// The small image of a crop.
pub(crate) fn small(crop: &[u8]) -> Image88 {
    let mut out = [0; 7744];
    downsample_440_to_88(crop, &mut out);
    out
}

impl Preprocessor {
    pub(crate) fn unet(weights: &UnetWeights) -> Self {
        Self::Unet {
            scaling: weights.scaling,
            rest: Box::new([0; 7744]),
        }
    }

    pub(crate) fn tracked(weights: &TrackedWeights) -> Self {
        Self::Tracked {
            lens: weights.lens,
            scaling: weights.scaling,
            tracker: Box::default(),
            interpolator: Box::default(),
        }
    }

    /// Shape of the input.
    pub(crate) const fn shape(&self) -> [usize; 4] {
        match self {
            Self::Unet { .. } => onnx::UNET_INPUT,
            Self::Tracked { .. } => onnx::TRACKED_INPUT,
        }
    }

    /// Sets the crop of the untouched sensor.
    pub(crate) fn set_rest(&mut self, crop: &[u8]) {
        match self {
            Self::Unet { rest, .. } => **rest = small(crop),
            Self::Tracked {
                lens,
                tracker,
                interpolator,
                ..
            } => {
                tracker.set_rest(crop);
                **interpolator = GridInterpolator::new(lens, tracker.particles());
            }
        }
    }

    pub(crate) fn prepare(&mut self, crop: &[u8]) -> NetworkInput {
        match self {
            Self::Unet { scaling, rest } => {
                let now = small(crop);
                let difference = now
                    .iter()
                    .zip(&**rest)
                    .map(|(&now, &rest)| (f32::from(now) - f32::from(rest)) * scaling.difference_per_level);
                let level = rest
                    .iter()
                    .map(|&rest| (f32::from(rest) - scaling.rest_level) * scaling.rest_per_level);
                NetworkInput {
                    values: difference.chain(level).collect(),
                    newtons_per_output: scaling.newtons_per_output,
                }
            }
            Self::Tracked {
                scaling,
                tracker,
                interpolator,
                ..
            } => {
                tracker.track(crop);
                let grid = interpolator.update(tracker.particles(), tracker.tracks());
                let (nodes, rms_mm) = tracked::input(grid, scaling);
                NetworkInput {
                    values: (0..tracked::INPUT_CHANNELS)
                        .flat_map(|channel| nodes.iter().map(move |node| node[channel]))
                        .collect(),
                    newtons_per_output: rms_mm * scaling.newtons_per_mm,
                }
            }
        }
    }
}
