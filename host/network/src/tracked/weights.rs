//! The weights file of the tracking network: as the encoder–decoder's, with the camera's intrinsics instead of grey
//! levels.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::net;
use crate::weights::{
    Calibration, FORMAT, Opened, Tensor, WeightsError, WeightsProblem, check_tensors, read, to_bytes,
};

/// What stands in the metadata under `architecture`: particles tracked at full resolution, a small network behind.
pub const ARCHITECTURE: &str = "tracked";

/// Everything that a weights file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedWeights {
    /// Channels at 20×20, 10×10 and 5×5, each a multiple of 8.
    pub widths: [usize; 3],
    /// How places in the crop become places in the skin.
    pub lens: Lens,
    /// How the network's outputs become newtons.
    pub scaling: TrackedScaling,
    /// How the detector should read this network's maps.
    pub calibration: Calibration,
    /// How these weights came to be: free text, one line (the trainer writes a JSON object).
    pub manifest: String,
    /// The tensors by name, as [`super::tensors`] lists them.
    pub tensors: BTreeMap<String, Tensor>,
}

/// The camera under the skin: an equidistant fisheye, and the skin over it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Pixels per radian from the axis.
    pub focal_px_per_rad: f32,
    /// Where the axis meets the 440×440 crop, pixels; pixel (0, 0) is centred on (0.5, 0.5).
    pub centre_px: [f32; 2],
    /// From the centre of projection to the skin's rigid base, mm.
    pub base_mm: f32,
    /// From the base to the surface, mm.
    pub thickness_mm: f32,
}

/// The elastic layer is linear: motions are divided by their root mean square before the network, and its outputs
/// multiplied by it, so that it learns one shape for all loads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackedScaling {
    /// Least root mean square motion that is divided by, mm: about the noise.
    pub least_motion_mm: f32,
    /// Root mean square motion whose logarithm, an input, is 0, mm.
    pub usual_motion_mm: f32,
    /// Newtons per taxel, unit of output and millimetre of root mean square motion.
    pub newtons_per_mm: f32,
}

impl TrackedWeights {
    /// Reads and checks a weights file.
    ///
    /// # Errors
    /// When it cannot be read or is not a complete, undamaged weights file of this architecture.
    pub fn from_file(path: &Path) -> Result<Self, WeightsError> {
        read(path)
            .and_then(|bytes| Self::parse(&bytes))
            .map_err(|problem| WeightsError {
                origin: path.display().to_string(),
                problem,
            })
    }

    /// Checks the bytes of a weights file.
    ///
    /// # Errors
    /// The first thing that is wrong: format, architecture, metadata, checksum, then tensors.
    pub fn parse(bytes: &[u8]) -> Result<Self, WeightsProblem> {
        let opened = Opened::parse(bytes, ARCHITECTURE)?;
        let metadata = opened.metadata();
        let widths = metadata.widths_of::<3>()?;
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
                least_motion_mm: metadata.number("least_motion_mm", 0.0, 100.0)?,
                usual_motion_mm: metadata.number("usual_motion_mm", 0.0, 100.0)?,
                newtons_per_mm: metadata.number("newtons_per_mm", 0.0, 1e4)?,
            },
            calibration: Calibration {
                contact_min_n: metadata.number("contact_min_n", 0.0, 1.0)?,
                friction: metadata.number("friction", 0.0, 2.0)?,
            },
            manifest: metadata.text("manifest")?.to_owned(),
            tensors: opened.tensors(&net::tensors(widths))?,
        };
        weights.check()?;
        Ok(weights)
    }

    /// Checks that every tensor of the architecture is there, with its shape and with usable values.
    ///
    /// # Errors
    /// The first one that is not.
    pub fn check(&self) -> Result<(), WeightsProblem> {
        check_tensors(&self.tensors, net::tensors(self.widths))
    }

    /// The bytes of a weights file that [`Self::parse`] reads back.
    ///
    /// # Panics
    /// When a tensor's values do not fill its shape, which is the trainer's own mistake.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let Lens {
            focal_px_per_rad,
            centre_px,
            base_mm,
            thickness_mm,
        } = self.lens;
        let TrackedScaling {
            least_motion_mm,
            usual_motion_mm,
            newtons_per_mm,
        } = self.scaling;
        let numbers = [
            ("focal_px_per_rad", focal_px_per_rad),
            ("centre_column_px", centre_px[0]),
            ("centre_row_px", centre_px[1]),
            ("base_mm", base_mm),
            ("thickness_mm", thickness_mm),
            ("least_motion_mm", least_motion_mm),
            ("usual_motion_mm", usual_motion_mm),
            ("newtons_per_mm", newtons_per_mm),
            ("contact_min_n", self.calibration.contact_min_n),
            ("friction", self.calibration.friction),
        ];
        let mut metadata: HashMap<String, String> = numbers
            .map(|(key, value)| (key.to_owned(), value.to_string()))
            .into();
        let widths = self.widths.map(|width| width.to_string()).join(",");
        for (key, value) in [
            ("format", FORMAT),
            ("architecture", ARCHITECTURE),
            ("widths", &widths),
            ("manifest", &self.manifest),
        ] {
            metadata.insert(key.to_owned(), value.to_owned());
        }
        to_bytes(&self.tensors, metadata)
    }
}
