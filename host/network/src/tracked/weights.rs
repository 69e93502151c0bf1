//! The tracking network's weights: architecture, camera, scaling, calibration, and the file that holds them.

use std::collections::BTreeMap;
use std::path::Path;

use super::layers::{layers, tensors};
use super::lens::Lens;
use crate::error::NetworkError;
use crate::force_map::Calibration;
use crate::layer::Folded;
use crate::options::Architecture;
use crate::weights::{self, Tensor, WeightsFile, check_tensors};

/// Everything that a weights file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedWeights {
    /// Channels at 20×20, 10×10 and 5×5, each a multiple of 8.
    pub widths: [usize; 3],
    /// From pixels of the crop to positions in the elastic layer.
    pub lens: Lens,
    /// From the network's outputs to newtons.
    pub scaling: TrackedScaling,
    /// How the detector should read the maps.
    pub calibration: Calibration,
    /// How the weights were trained: free text, one line (the trainer writes a JSON object).
    pub manifest: String,
    /// The tensors by name, as [`super::tensors`] lists them.
    pub tensors: BTreeMap<String, Tensor>,
}

/// Scaling before and after the network. The elastic layer is linear, so motions are divided by their RMS before the
/// network and its outputs are multiplied by it: the network learns one shape for all loads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackedScaling {
    /// Smallest RMS motion to divide by, mm: about the noise.
    pub min_motion_mm: f32,
    /// RMS motion at which the log-magnitude input is 0, mm.
    pub reference_motion_mm: f32,
    /// Newtons per taxel, per unit of output and millimetre of RMS motion.
    pub newtons_per_mm: f32,
}

impl TrackedWeights {
    /// Reads and checks a weights file.
    ///
    /// # Errors
    /// When it cannot be read or is not a complete, undamaged weights file of this architecture.
    pub fn from_file(path: &Path) -> Result<Self, NetworkError> {
        weights::read(path)
            .and_then(|bytes| Self::parse(&bytes))
            .map_err(|problem| problem.in_weights(&path.display()))
    }

    /// Checks the bytes of a weights file.
    ///
    /// # Errors
    /// The first thing that is wrong: format, architecture, metadata, checksum, then tensors.
    pub fn parse(bytes: &[u8]) -> Result<Self, NetworkError> {
        let file = WeightsFile::parse(bytes, Architecture::Tracked)?;
        let metadata = file.metadata();
        let widths = metadata.widths()?;
        let weights = Self {
            widths,
            lens: Lens {
                focal_px_per_rad: metadata.number("focal_px_per_rad", 0.0, 1e5)?,
                centre_px: [
                    metadata.number("centre_column_px", -1e4, 1e4)?,
                    metadata.number("centre_row_px", -1e4, 1e4)?,
                ],
                base_mm: metadata.number("base_mm", 0.0, 1e3)?,
                thickness_mm: metadata.number("thickness_mm", 5.5, 1e3)?,
            },
            scaling: TrackedScaling {
                min_motion_mm: metadata.number("least_motion_mm", 0.0, 100.0)?,
                reference_motion_mm: metadata.number("usual_motion_mm", 0.0, 100.0)?,
                newtons_per_mm: metadata.number("newtons_per_mm", 0.0, 1e4)?,
            },
            calibration: metadata.calibration()?,
            manifest: metadata.text("manifest")?.to_owned(),
            tensors: file.tensors(&tensors(widths))?,
        };
        weights.check()?;
        Ok(weights)
    }

    /// Checks that every tensor of the architecture is there, with its shape and with usable values.
    ///
    /// # Errors
    /// The first one that is not.
    pub fn check(&self) -> Result<(), NetworkError> {
        check_tensors(&self.tensors, tensors(self.widths))
    }

    /// The layers in order, with batch norm folded in. Call [`Self::check`] first.
    pub fn folded(&self) -> impl Iterator<Item = Folded> {
        layers(self.widths)
            .into_iter()
            .map(|layer| Folded::new(layer, &self.tensors))
    }

    /// The bytes of a weights file that [`Self::parse`] reads back.
    ///
    /// # Panics
    /// When a tensor's values do not fill its shape.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let (lens, scaling) = (self.lens, self.scaling);
        weights::to_bytes(
            Architecture::Tracked.name(),
            None,
            &self.widths,
            &[
                ("focal_px_per_rad", lens.focal_px_per_rad),
                ("centre_column_px", lens.centre_px[0]),
                ("centre_row_px", lens.centre_px[1]),
                ("base_mm", lens.base_mm),
                ("thickness_mm", lens.thickness_mm),
                ("least_motion_mm", scaling.min_motion_mm),
                ("usual_motion_mm", scaling.reference_motion_mm),
                ("newtons_per_mm", scaling.newtons_per_mm),
            ],
            self.calibration,
            &self.manifest,
            &self.tensors,
        )
    }
}
