//! The encoder–decoder with its weights, rest image and last frame.

use std::path::Path;
use std::sync::Arc;

use gripline_kernels::{InstructionSet, Region};

use super::graph::UNet;
use super::weights::UnetWeights;
use crate::constants::{IMAGE_PIXELS, IMAGE_SIDE};
use crate::error::NetworkError;
use crate::force_map::{Calibration, ForceMap, NO_FORCES};
use crate::image::Image88;
use crate::options::Evaluation;

/// The built-in weights.
static EMBEDDED: &[u8] = include_bytes!("../../weights/unet.safetensors");

/// The encoder–decoder: weights, rest image and buffers.
///
/// ```
/// let mut network = gripline_network::unet::UnetNetwork::embedded()?;
/// let (rest, now) = ([30; 7744], [30; 7744]);
/// let mut forces_n = [[0.0; 3]; 400];
/// network.set_rest(&rest);
/// network.infer(&now, &mut forces_n);
/// # Ok::<(), gripline_network::NetworkError>(())
/// ```
#[derive(Debug, Clone)]
pub struct UnetNetwork {
    weights: Arc<UnetWeights>,
    network: UNet,
    rest: Box<Image88>,
    evaluation: Evaluation,
    last: Box<Last>,
}

impl UnetNetwork {
    /// The network with the built-in weights.
    ///
    /// # Errors
    /// Never with the committed weights (a test loads them); the trainer may replace that file.
    pub fn embedded() -> Result<Self, NetworkError> {
        UnetWeights::parse(EMBEDDED)
            .map(Self::new)
            .map_err(|problem| problem.in_weights(&"built in"))
    }

    /// The network with weights from a file.
    ///
    /// # Errors
    /// When the file cannot be read or is not a complete, undamaged weights file of a known architecture.
    pub fn from_file(path: &Path) -> Result<Self, NetworkError> {
        UnetWeights::from_file(path).map(Self::new)
    }

    /// The network with these weights.
    ///
    /// # Errors
    /// When a tensor is missing, has another shape, or is not finite.
    pub fn from_weights(weights: &UnetWeights) -> Result<Self, NetworkError> {
        weights.check()?;
        Ok(Self::new(weights.clone()))
    }

    /// Builds the network from weights that [`UnetWeights::check`] passed.
    pub(crate) fn new(weights: UnetWeights) -> Self {
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

    /// Uses another instruction set than the widest available.
    ///
    /// # Errors
    /// When the processor does not have it.
    pub fn with_instructions(mut self, instructions: InstructionSet) -> Result<Self, NetworkError> {
        self.network = UNet::new(&self.weights, instructions.checked()?);
        let rest = self.rest.clone();
        self.set_rest(&rest);
        Ok(self)
    }

    /// Chooses how much of a frame is computed. The forces are the same, bit by bit.
    #[must_use]
    pub fn with_evaluation(mut self, evaluation: Evaluation) -> Self {
        self.evaluation = evaluation;
        self
    }

    /// Sets the 88×88 image of the untouched sensor. Forces mean nothing before the first call. The next frame takes about
    /// a tenth longer.
    pub fn set_rest(&mut self, rest: &Image88) {
        *self.rest = *rest;
        self.network.set_rest(rest);
        self.last.known = false;
    }

    /// Forces for the 88×88 image `now`, newtons per taxel. Writes every taxel of `out`; no allocation.
    pub fn infer(&mut self, now: &Image88, out: &mut ForceMap) {
        let dirty = if self.last.known && self.evaluation != Evaluation::Dense {
            dirty_region(&self.last.image, now)
        } else {
            Region::whole(IMAGE_SIDE, IMAGE_SIDE)
        };
        if !dirty.is_empty() {
            self.network
                .infer(&self.rest, now, &dirty, &mut self.last.forces_n);
            self.last.image = *now;
            self.last.known = true;
        }
        *out = self.last.forces_n;
    }

    /// Multiply-adds of a whole frame, without those of the rest image.
    #[must_use]
    pub fn multiply_adds(&self) -> usize {
        self.network.multiply_adds()
    }

    /// How the slip detector should read the maps.
    #[must_use]
    pub fn calibration(&self) -> Calibration {
        self.weights.calibration
    }

    /// How the weights were trained, one line.
    #[must_use]
    pub fn manifest(&self) -> &str {
        &self.weights.manifest
    }

    pub(crate) fn weights(&self) -> &UnetWeights {
        &self.weights
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
        forces_n: NO_FORCES,
    };
}

/// The bounding box of all pixels that differ.
fn dirty_region(before: &Image88, now: &Image88) -> Region {
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
        region = region.union(&Region {
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
        assert!(dirty_region(&before, &before).is_empty());
        for i in 0..IMAGE_PIXELS {
            let (mut now, row, column) = (before, i / IMAGE_SIDE, i % IMAGE_SIDE);
            now[i] ^= 1;
            let expected = Region {
                rows: row..row + 1,
                columns: column..column + 1,
            };
            assert_eq!(dirty_region(&before, &now), expected);
        }
    }

    #[test]
    fn the_dirty_region_is_the_bounding_box_of_all_changed_pixels() {
        let before = [7; IMAGE_PIXELS];
        let mut now = before;
        for (row, column) in [(10, 40), (30, 20), (12, 77)] {
            now[row * IMAGE_SIDE + column] = 8;
        }
        let expected = Region {
            rows: 10..31,
            columns: 20..78,
        };
        assert_eq!(dirty_region(&before, &now), expected);
    }
}
