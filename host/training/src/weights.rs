//! Weights of either network, and the engine that runs them: what training, evaluation and the golden files share.

use std::path::Path;

use gripline_network::tracked::{TrackedNetwork, TrackedWeights};
use gripline_network::weights::{Weights, WeightsProblem};
use gripline_network::{Calibration, ForceMap, ForceNetwork};

use crate::dataset::Dataset;
use crate::error::TrainingError;
use crate::model::Tensors;

/// Which network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Architecture {
    /// The encoder–decoder on two 88×88 images.
    Unet,
    /// Particles tracked at 440×440, a small network behind.
    Tracked,
}

impl Architecture {
    /// Its name, and that of its files.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Unet => "unet",
            Self::Tracked => "tracked",
        }
    }
}

/// The contents of a weights file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum AnyWeights {
    UNet(Weights),
    Tracked(TrackedWeights),
}

impl AnyWeights {
    pub(crate) fn from_file(architecture: Architecture, path: &Path) -> Result<Self, TrainingError> {
        Ok(match architecture {
            Architecture::Unet => Self::UNet(Weights::from_file(path)?),
            Architecture::Tracked => Self::Tracked(TrackedWeights::from_file(path)?),
        })
    }

    pub(crate) fn tensors(&self) -> &Tensors {
        match self {
            Self::UNet(weights) => &weights.tensors,
            Self::Tracked(weights) => &weights.tensors,
        }
    }

    pub(crate) fn set_tensors(&mut self, tensors: Tensors) {
        match self {
            Self::UNet(weights) => weights.tensors = tensors,
            Self::Tracked(weights) => weights.tensors = tensors,
        }
    }

    pub(crate) fn set_calibration(&mut self, calibration: Calibration) {
        match self {
            Self::UNet(weights) => weights.calibration = calibration,
            Self::Tracked(weights) => weights.calibration = calibration,
        }
    }

    pub(crate) fn manifest(&self) -> &str {
        match self {
            Self::UNet(weights) => &weights.manifest,
            Self::Tracked(weights) => &weights.manifest,
        }
    }

    pub(crate) fn set_manifest(&mut self, manifest: String) {
        match self {
            Self::UNet(weights) => weights.manifest = manifest,
            Self::Tracked(weights) => weights.manifest = manifest,
        }
    }

    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        match self {
            Self::UNet(weights) => weights.to_bytes(),
            Self::Tracked(weights) => weights.to_bytes(),
        }
    }

    pub(crate) fn engine(&self) -> Result<Engine, WeightsProblem> {
        Ok(match self {
            Self::UNet(weights) => Engine::UNet(Box::new(ForceNetwork::from_weights(weights)?)),
            Self::Tracked(weights) => Engine::Tracked(Box::new(TrackedNetwork::from_weights(weights)?)),
        })
    }
}

/// The inference engine with either network.
pub(crate) enum Engine {
    UNet(Box<ForceNetwork>),
    Tracked(Box<TrackedNetwork>),
}

impl Engine {
    /// With the weights of a file, or those that the engine carries.
    pub(crate) fn open(architecture: Architecture, weights: Option<&Path>) -> Result<Self, TrainingError> {
        Ok(match (architecture, weights) {
            (Architecture::Unet, Some(path)) => Self::UNet(Box::new(ForceNetwork::from_file(path)?)),
            (Architecture::Unet, None) => Self::UNet(Box::new(ForceNetwork::embedded()?)),
            (Architecture::Tracked, Some(path)) => Self::Tracked(Box::new(TrackedNetwork::from_file(path)?)),
            (Architecture::Tracked, None) => Self::Tracked(Box::new(TrackedNetwork::embedded()?)),
        })
    }

    /// Forces for a sample, newtons per taxel.
    pub(crate) fn infer(&mut self, set: &Dataset, sample: usize) -> ForceMap {
        let mut forces_n = [[0.0; 3]; 400];
        match self {
            Self::UNet(network) => {
                network.set_rest(set.rest(sample));
                network.infer(set.now(sample), &mut forces_n);
            }
            Self::Tracked(network) => network.infer_grid(&set.grid(sample), &mut forces_n),
        }
        forces_n
    }

    pub(crate) fn calibration(&self) -> Calibration {
        match self {
            Self::UNet(network) => network.calibration(),
            Self::Tracked(network) => network.calibration(),
        }
    }

    pub(crate) fn manifest(&self) -> &str {
        match self {
            Self::UNet(network) => network.manifest(),
            Self::Tracked(network) => network.manifest(),
        }
    }
}
