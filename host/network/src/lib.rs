//! The force network's inference engine: two 88×88 camera images (at rest, now) in, a 20×20 map of contact
//! forces out. Forces are newtons per taxel, components x, y (shear) and z (pressing into the skin is
//! positive), taxels row-major; images have the same orientation. One thread, no allocation per frame.
//!
//! [`ForceNetwork`] is all that a program needs; [`weights`] is the file format, [`layers`] and [`tensors`]
//! the architecture as the trainer builds it.
#![forbid(unsafe_code)]

pub mod constants;
pub mod image;
mod kernel;
mod unet;
pub mod weights;

use std::path::Path;

use constants::{IMAGE_PIXELS, TAXELS};
use image::Image88;
pub use image::downsample_440_to_88;
use unet::UNet;
pub use unet::{Layer, LayerKind, OUTPUT, layers, tensors};
pub use weights::{Calibration, WeightsError};
use weights::{Weights, WeightsProblem};

/// Contact forces, newtons per taxel, `[x, y, z]`, index = row · 20 + column.
pub type ForceMap = [[f32; 3]; TAXELS];

/// The weights that the crate carries.
static EMBEDDED: &[u8] = include_bytes!("../weights/unet.safetensors");

/// The force network: weights, the rest image, and buffers.
///
/// ```
/// let mut network = gripline_network::ForceNetwork::embedded()?;
/// let (rest, now) = ([30; 7744], [30; 7744]);
/// let mut forces_n = [[0.0; 3]; 400];
/// network.set_rest(&rest);
/// network.infer(&now, &mut forces_n);
/// # Ok::<(), gripline_network::WeightsError>(())
/// ```
#[derive(Debug, Clone)]
pub struct ForceNetwork {
    network: UNet,
    rest: Box<Image88>,
    calibration: Calibration,
    manifest: String,
}

impl ForceNetwork {
    /// The network with the weights that the crate carries.
    ///
    /// # Errors
    /// Never with the committed weights (a test loads them); the trainer replaces that file.
    pub fn embedded() -> Result<Self, WeightsError> {
        let weights = Weights::parse(EMBEDDED).map_err(|problem| WeightsError {
            origin: "built in".to_owned(),
            problem,
        })?;
        Ok(Self::new(&weights))
    }

    /// The network with weights from a file.
    ///
    /// # Errors
    /// When the file cannot be read or is not a complete, undamaged weights file of a known architecture.
    pub fn from_file(path: &Path) -> Result<Self, WeightsError> {
        Weights::from_file(path).map(|weights| Self::new(&weights))
    }

    /// The network with weights fresh from the trainer.
    ///
    /// # Errors
    /// When a tensor is missing, has another shape, or holds a number one cannot compute with.
    pub fn from_weights(weights: &Weights) -> Result<Self, WeightsProblem> {
        weights.check()?;
        Ok(Self::new(weights))
    }

    /// Builds the network from weights that [`Weights::check`] passed.
    fn new(weights: &Weights) -> Self {
        let mut network = Self {
            network: UNet::new(weights),
            rest: Box::new([0; IMAGE_PIXELS]),
            calibration: weights.calibration,
            manifest: weights.manifest.clone(),
        };
        network.set_rest(&[0; IMAGE_PIXELS]);
        network
    }

    /// Takes the image of the untouched sensor. Forces mean nothing before the first call: until then the
    /// rest image is black. Costs about a tenth of a frame, and allocates.
    pub fn set_rest(&mut self, rest: &Image88) {
        *self.rest = *rest;
        self.network.set_rest(rest);
    }

    /// Forces for the image now, newtons per taxel. Every taxel of `out` is written; no allocation.
    pub fn infer(&mut self, now: &Image88, out: &mut ForceMap) {
        self.network.infer(&self.rest, now, out);
    }

    /// How the slip detector should read these maps.
    #[must_use]
    pub fn calibration(&self) -> Calibration {
        self.calibration
    }

    /// How the weights came to be, one line.
    #[must_use]
    pub fn manifest(&self) -> &str {
        &self.manifest
    }
}
