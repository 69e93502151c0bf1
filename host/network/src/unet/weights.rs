//! The encoder–decoder's weights: architecture, scaling, calibration, and the file that holds them.

use std::collections::BTreeMap;
use std::path::Path;

use gripline_kernels::Kernel;

use crate::error::NetworkError;
use crate::force_map::Calibration;
use crate::layer::{Folded, Layer, LayerKind, OUTPUT, tensors_of};
use crate::options::Architecture;
use crate::weights::{self, Tensor, WeightsFile, check_tensors};

/// Everything that a weights file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct UnetWeights {
    /// Channels of the network's stages.
    pub widths: Widths,
    /// How images become inputs and outputs become newtons.
    pub scaling: Scaling,
    /// How the detector should read this network's maps.
    pub calibration: Calibration,
    /// How these weights came to be: free text, one line (the trainer writes a JSON object).
    pub manifest: String,
    /// The tensors by name, as [`tensors`] lists them.
    pub tensors: BTreeMap<String, Tensor>,
}

/// Channels of the stages, named by the side of their images. Each is a multiple of 8.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Widths {
    /// After the first strided convolution, 44×44.
    pub encode44: usize,
    /// After the second strided convolution, 22×22.
    pub encode22: usize,
    /// Encoder at 20×20.
    pub encode20: usize,
    /// Encoder and decoder at 10×10.
    pub middle10: usize,
    /// Bottom of the network, 5×5.
    pub bottom5: usize,
    /// Decoder at 20×20.
    pub decode20: usize,
}

/// Fixed linear maps before and after the network.
///
/// Inputs: channel 0 is `(now − rest) · difference_per_level`, channel 1 is
/// `(rest − rest_level) · rest_per_level`, with images in grey levels 0–255. This recombines the paper's two
/// images without loss. Outputs: force in newtons is `output · newtons_per_output`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scaling {
    /// Input units per grey level of difference between now and rest.
    pub difference_per_level: f32,
    /// Grey level of the rest image that becomes 0.
    pub rest_level: f32,
    /// Input units per grey level of the rest image.
    pub rest_per_level: f32,
    /// Newtons per taxel and unit of output.
    pub newtons_per_output: f32,
}

/// The layers in the order in which they run. Concatenations put the decoder's channels first.
#[must_use]
pub fn layers(widths: Widths) -> [Layer; 15] {
    const PLAIN: LayerKind = three_by_three(1, 1);
    const STRIDED: LayerKind = three_by_three(2, 1);
    const UNPADDED: LayerKind = three_by_three(1, 0);
    const DOUBLING: LayerKind = LayerKind::Transposed { size: 3 };
    let Widths {
        encode44,
        encode22,
        encode20,
        middle10,
        bottom5,
        decode20,
    } = widths;
    let layer = |name, kind, in_channels, out_channels| Layer {
        name,
        kind,
        in_channels,
        out_channels,
    };
    [
        layer("encode44", STRIDED, 2, encode44),
        layer("encode22", STRIDED, encode44, encode22),
        layer("encode20a", UNPADDED, encode22, encode20),
        layer("encode20b", PLAIN, encode20, encode20),
        layer("encode10a", PLAIN, encode20, middle10),
        layer("encode10b", PLAIN, middle10, middle10),
        layer("bottom5a", PLAIN, middle10, bottom5),
        layer("bottom5b", PLAIN, bottom5, bottom5),
        layer("up10", DOUBLING, bottom5, middle10),
        layer("decode10a", PLAIN, 2 * middle10, middle10),
        layer("decode10b", PLAIN, middle10, middle10),
        layer("up20", DOUBLING, middle10, decode20),
        layer("decode20a", PLAIN, decode20 + encode20, decode20),
        layer("decode20b", PLAIN, decode20, decode20),
        layer(OUTPUT, PLAIN, decode20, 3),
    ]
}

const fn three_by_three(stride: usize, padding: usize) -> LayerKind {
    LayerKind::Convolution(Kernel {
        size: 3,
        stride,
        padding,
    })
}

/// Name and shape of every tensor of a weights file.
#[must_use]
pub fn tensors(widths: Widths) -> Vec<(String, Vec<usize>)> {
    tensors_of(&layers(widths))
}

impl UnetWeights {
    /// Reads and checks a weights file.
    ///
    /// # Errors
    /// When it cannot be read or is not a complete, undamaged weights file of a known architecture.
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
        let file = WeightsFile::parse(bytes, Architecture::Unet)?;
        let metadata = file.metadata();
        let [encode44, encode22, encode20, middle10, bottom5, decode20] = metadata.widths()?;
        let widths = Widths {
            encode44,
            encode22,
            encode20,
            middle10,
            bottom5,
            decode20,
        };
        let weights = Self {
            widths,
            scaling: Scaling {
                difference_per_level: metadata.number("difference_per_level", 0.0, 100.0)?,
                rest_level: metadata.number("rest_level", -1.0, 255.0)?,
                rest_per_level: metadata.number("rest_per_level", 0.0, 100.0)?,
                newtons_per_output: metadata.number("newtons_per_output", 0.0, 100.0)?,
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
        let Widths {
            encode44,
            encode22,
            encode20,
            middle10,
            bottom5,
            decode20,
        } = self.widths;
        weights::to_bytes(
            Architecture::Unet.name(),
            None,
            &[encode44, encode22, encode20, middle10, bottom5, decode20],
            &[
                ("difference_per_level", self.scaling.difference_per_level),
                ("rest_level", self.scaling.rest_level),
                ("rest_per_level", self.scaling.rest_per_level),
                ("newtons_per_output", self.scaling.newtons_per_output),
            ],
            self.calibration,
            &self.manifest,
            &self.tensors,
        )
    }
}
