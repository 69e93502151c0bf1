//! Weights of either network, and the inference engine with either network.

use std::collections::BTreeMap;
use std::path::Path;

use gripline_network::tracked::{TrackedNetwork, TrackedWeights};
use gripline_network::unet::{UnetNetwork, UnetWeights};
use gripline_network::{Architecture, Calibration, ForceMap, NO_FORCES, NetworkError, Tensor};

use crate::dataset::Dataset;

/// The tensors of a weights file, by name.
pub(crate) type Tensors = BTreeMap<String, Tensor>;

/// The contents of a weights file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum AnyWeights {
    Unet(UnetWeights),
    Tracked(TrackedWeights),
}

impl AnyWeights {
    pub(crate) fn from_file(architecture: Architecture, path: &Path) -> Result<Self, NetworkError> {
        Ok(match architecture {
            Architecture::Unet => Self::Unet(UnetWeights::from_file(path)?),
            Architecture::Tracked => Self::Tracked(TrackedWeights::from_file(path)?),
        })
    }

    pub(crate) fn tensors(&self) -> &Tensors {
        match self {
            Self::Unet(weights) => &weights.tensors,
            Self::Tracked(weights) => &weights.tensors,
        }
    }

    pub(crate) fn set_tensors(&mut self, tensors: Tensors) {
        match self {
            Self::Unet(weights) => weights.tensors = tensors,
            Self::Tracked(weights) => weights.tensors = tensors,
        }
    }

    pub(crate) fn set_calibration(&mut self, calibration: Calibration) {
        match self {
            Self::Unet(weights) => weights.calibration = calibration,
            Self::Tracked(weights) => weights.calibration = calibration,
        }
    }

    pub(crate) fn manifest(&self) -> &str {
        match self {
            Self::Unet(weights) => &weights.manifest,
            Self::Tracked(weights) => &weights.manifest,
        }
    }

    pub(crate) fn set_manifest(&mut self, manifest: String) {
        match self {
            Self::Unet(weights) => weights.manifest = manifest,
            Self::Tracked(weights) => weights.manifest = manifest,
        }
    }

    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        match self {
            Self::Unet(weights) => weights.to_bytes(),
            Self::Tracked(weights) => weights.to_bytes(),
        }
    }

    pub(crate) fn engine(&self) -> Result<Engine, NetworkError> {
        Ok(match self {
            Self::Unet(weights) => Engine::Unet(Box::new(UnetNetwork::from_weights(weights)?)),
            Self::Tracked(weights) => Engine::Tracked(Box::new(TrackedNetwork::from_weights(weights)?)),
        })
    }
}

/// The inference engine.
pub(crate) enum Engine {
    Unet(Box<UnetNetwork>),
    Tracked(Box<TrackedNetwork>),
}

impl Engine {
    /// With the weights of a file, or the built-in ones.
    pub(crate) fn open(architecture: Architecture, weights: Option<&Path>) -> Result<Self, NetworkError> {
        Ok(match (architecture, weights) {
            (Architecture::Unet, Some(path)) => Self::Unet(Box::new(UnetNetwork::from_file(path)?)),
            (Architecture::Unet, None) => Self::Unet(Box::new(UnetNetwork::embedded()?)),
            (Architecture::Tracked, Some(path)) => Self::Tracked(Box::new(TrackedNetwork::from_file(path)?)),
            (Architecture::Tracked, None) => Self::Tracked(Box::new(TrackedNetwork::embedded()?)),
        })
    }

    /// Forces for a sample, newtons per taxel.
    pub(crate) fn infer(&mut self, set: &Dataset, sample: usize) -> ForceMap {
        let mut forces_n = NO_FORCES;
        match self {
            Self::Unet(network) => {
                network.set_rest(set.rest(sample));
                network.infer(set.now(sample), &mut forces_n);
            }
            Self::Tracked(network) => network.infer_grid(&set.grid(sample), &mut forces_n),
        }
        forces_n
    }

    pub(crate) fn calibration(&self) -> Calibration {
        match self {
            Self::Unet(network) => network.calibration(),
            Self::Tracked(network) => network.calibration(),
        }
    }

    pub(crate) fn manifest(&self) -> &str {
        match self {
            Self::Unet(network) => network.manifest(),
            Self::Tracked(network) => network.manifest(),
        }
    }
}
