//! The networks in the training framework, built from `gripline_network`'s layers, with weights exported to and imported
//! from weights files. In the networks' units: `[batch, 2, 88, 88]` or `[batch, 10, 40, 40]` to `[batch, 3, 20, 20]`.

use burn::module::Module;
use burn::tensor::{Device, Tensor};

use crate::tracked_net::TrackedNet;
use crate::unet_net::UNet;
use crate::weights::{AnyWeights, Tensors};

/// One of the two networks.
#[expect(clippy::large_enum_variant, reason = "there is one of it")]
#[derive(Module, Debug)]
pub(crate) enum Model {
    Unet(UNet),
    Tracked(TrackedNet),
}

impl Model {
    /// A network of the same architecture and widths with random weights; seed the device first.
    pub(crate) fn new(weights: &AnyWeights, device: &Device) -> Self {
        match weights {
            AnyWeights::Unet(weights) => Self::Unet(UNet::new(weights.widths, device)),
            AnyWeights::Tracked(weights) => Self::Tracked(TrackedNet::new(weights.widths, device)),
        }
    }

    /// The network with these weights.
    pub(crate) fn loaded(weights: &AnyWeights, device: &Device) -> Self {
        let mut model = Self::new(weights, device);
        model.set_tensors(weights.tensors(), device);
        model
    }

    /// Input to `[batch, 3, 20, 20]`.
    pub(crate) fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        match self {
            Self::Unet(network) => network.forward(input),
            Self::Tracked(network) => network.forward(input),
        }
    }

    /// Exports all tensors under their names in the weights file.
    pub(crate) fn tensors(&self) -> Tensors {
        match self {
            Self::Unet(network) => network.tensors(),
            Self::Tracked(network) => network.tensors(),
        }
    }

    /// Imports all tensors of a checked weights file of the same widths.
    pub(crate) fn set_tensors(&mut self, tensors: &Tensors, device: &Device) {
        match self {
            Self::Unet(network) => network.set_tensors(tensors, device),
            Self::Tracked(network) => network.set_tensors(tensors, device),
        }
    }
}
