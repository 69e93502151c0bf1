//! The force network's inference engine: camera images (at rest, now) in, a 20×20 map of contact forces out, in one of
//! two ways: an encoder–decoder on 88×88 images, or particles tracked at 440×440 ([`tracked`]). Forces are newtons per taxel, components x, y (shear) and z (pressing into the skin is
//! positive), taxels row-major; images have the same orientation. One thread, no allocation per frame.
//!
//! [`Network`] is all that a program needs, [`ForceNetwork`] the encoder–decoder; [`weights`] is the file format,
//! [`layers`] and [`tensors`] the architecture as the trainer builds it.
// Only the kernels' loads, stores and vector instructions are unsafe.
#![deny(unsafe_code)]

pub mod constants;
pub mod image;
mod instruction_set;
mod kernel;
#[cfg(feature = "metrics")]
pub mod metrics;
mod network;
pub mod scene;
pub mod tracked;
mod unet;
pub mod weights;

use std::path::Path;
use std::sync::Arc;

use constants::{IMAGE_PIXELS, IMAGE_SIDE, TAXELS};
use image::Image88;
pub use image::downsample_440_to_88;
pub use instruction_set::{InstructionSet, InstructionSetError};
use kernel::Region;
#[cfg(feature = "bench")]
pub use kernel::spin;
pub use network::{Architecture, Network};
use unet::UNet;
pub use unet::{Folded, Layer, LayerKind, OUTPUT, folded, layers, tensors};
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
    weights: Arc<Weights>,
    network: UNet,
    rest: Box<Image88>,
    evaluation: Evaluation,
    last: Box<Last>,
}

/// What of a frame is computed. Forces are the same, bit by bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Evaluation {
    /// Everything, always.
    Dense,
    /// What can differ from the frame before: nothing when the image is the same, otherwise the pixels of each
    /// layer that see a pixel that changed.
    #[default]
    Skip,
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
        Ok(Self::new(weights))
    }

    /// The network with weights from a file.
    ///
    /// # Errors
    /// When the file cannot be read or is not a complete, undamaged weights file of a known architecture.
    pub fn from_file(path: &Path) -> Result<Self, WeightsError> {
        Weights::from_file(path).map(Self::new)
    }

    /// The network with weights fresh from the trainer.
    ///
    /// # Errors
    /// When a tensor is missing, has another shape, or holds a number one cannot compute with.
    pub fn from_weights(weights: &Weights) -> Result<Self, WeightsProblem> {
        weights.check()?;
        Ok(Self::new(weights.clone()))
    }

    /// Builds the network from weights that [`Weights::check`] passed.
    fn new(weights: Weights) -> Self {
        let mut network = Self {
            network: UNet::new(&weights, InstructionSet::widest()),
            weights: Arc::new(weights),
            rest: Box::new([0; IMAGE_PIXELS]),
            evaluation: Evaluation::default(),
            last: Box::new(Last::NONE),
        };
        network.set_rest(&[0; IMAGE_PIXELS]);
        network
    }

    /// The same network on another instruction set than the widest that the processor has.
    ///
    /// # Errors
    /// When the processor does not have it.
    pub fn with_instructions(mut self, instructions: InstructionSet) -> Result<Self, InstructionSetError> {
        self.network = UNet::new(&self.weights, instructions.checked()?);
        let rest = self.rest.clone();
        self.set_rest(&rest);
        Ok(self)
    }

    /// The same network with another rule for what is computed. Forces stay the same, bit by bit.
    #[must_use]
    pub fn with_evaluation(mut self, evaluation: Evaluation) -> Self {
        self.evaluation = evaluation;
        self
    }

    /// Takes the image of the untouched sensor. Forces mean nothing before the first call: until then the
    /// rest image is black. The next frame costs about a tenth more.
    pub fn set_rest(&mut self, rest: &Image88) {
        *self.rest = *rest;
        self.network.set_rest(rest);
        self.last.known = false;
    }

    /// Forces for the image now, newtons per taxel. Every taxel of `out` is written; no allocation.
    pub fn infer(&mut self, now: &Image88, out: &mut ForceMap) {
        let changed = if self.last.known && self.evaluation == Evaluation::Skip {
            changed(&self.last.image, now)
        } else {
            Region::whole(IMAGE_SIDE, IMAGE_SIDE)
        };
        if !changed.is_empty() {
            self.network
                .infer(&self.rest, now, &changed, &mut self.last.forces_n);
            self.last.image = *now;
            self.last.known = true;
        }
        *out = self.last.forces_n;
    }

    /// Multiply-adds of a whole frame (what the rest image alone decides is not among them).
    #[must_use]
    pub fn multiply_adds(&self) -> usize {
        self.network.multiply_adds()
    }

    /// How the slip detector should read these maps.
    #[must_use]
    pub fn calibration(&self) -> Calibration {
        self.weights.calibration
    }

    /// How the weights came to be, one line.
    #[must_use]
    pub fn manifest(&self) -> &str {
        &self.weights.manifest
    }
}

/// The last frame and its forces.
#[derive(Debug, Clone)]
struct Last {
    /// Whether there was one since the rest image was taken.
    known: bool,
    image: Image88,
    forces_n: ForceMap,
}

impl Last {
    const NONE: Self = Self {
        known: false,
        image: [0; IMAGE_PIXELS],
        forces_n: [[0.0; 3]; TAXELS],
    };
}

/// The rectangle around all pixels that differ.
fn changed(before: &Image88, now: &Image88) -> Region {
    let mut region = Region::EMPTY;
    let rows = before
        .as_chunks::<IMAGE_SIDE>()
        .0
        .iter()
        .zip(now.as_chunks::<IMAGE_SIDE>().0);
    for (row, (before, now)) in rows.enumerate() {
        if before == now {
            continue;
        }
        let differs = |&column: &usize| before[column] != now[column];
        let first = (0..IMAGE_SIDE).find(differs).unwrap_or(0);
        let last = (0..IMAGE_SIDE).rfind(differs).unwrap_or(IMAGE_SIDE - 1);
        region = region.hull(&Region {
            rows: row..row + 1,
            columns: first..last + 1,
        });
    }
    region
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_images_have_no_changed_pixels_and_one_pixel_anywhere_is_noticed() {
        let before: Image88 = std::array::from_fn(|i| (i % 251) as u8);
        assert!(changed(&before, &before).is_empty());
        for i in 0..IMAGE_PIXELS {
            let (mut now, row, column) = (before, i / IMAGE_SIDE, i % IMAGE_SIDE);
            now[i] ^= 1;
            let expected = Region {
                rows: row..row + 1,
                columns: column..column + 1,
            };
            assert_eq!(changed(&before, &now), expected);
        }
    }

    #[test]
    fn the_changed_region_is_the_rectangle_around_all_changed_pixels() {
        let before = [7; IMAGE_PIXELS];
        let mut now = before;
        for (row, column) in [(10, 40), (30, 20), (12, 77)] {
            now[row * IMAGE_SIDE + column] = 8;
        }
        let expected = Region {
            rows: 10..31,
            columns: 20..78,
        };
        assert_eq!(changed(&before, &now), expected);
    }
}
