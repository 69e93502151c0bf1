//! Either network behind one face: the camera's 440×440 crop in, forces out. Which one is the caller's choice, or the
//! weights file's.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use crate::constants::IMAGE_PIXELS;
use crate::image::{Image88, downsample_440_to_88};
use crate::scene::Health;
use crate::tracked::{TrackedNetwork, TrackedWeights};
use crate::weights::{self, Calibration, Weights, WeightsError, WeightsProblem};
use crate::{Evaluation, ForceMap, ForceNetwork, InstructionSet, InstructionSetError, tracked};

/// Which way from images to forces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum Architecture {
    /// The encoder–decoder on two 88×88 images.
    Unet,
    /// Particles tracked at 440×440, and a small network behind: the default, more accurate, and idle where nothing moves.
    #[default]
    Tracked,
}

impl Architecture {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Unet, Self::Tracked];

    /// Its name, in weights files too.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unet => weights::ARCHITECTURE,
            Self::Tracked => tracked::weights::ARCHITECTURE,
        }
    }
}

impl fmt::Display for Architecture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Architecture {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|architecture| architecture.name() == name)
            .ok_or_else(|| format!("network `{name}` is unknown, expected `unet` or `tracked`"))
    }
}

/// A force network of either architecture.
#[derive(Debug, Clone)]
pub struct Network(Kind);

#[derive(Debug, Clone)]
enum Kind {
    Unet {
        network: Box<ForceNetwork>,
        small: Box<Image88>,
    },
    Tracked(Box<TrackedNetwork>),
}

impl From<ForceNetwork> for Network {
    fn from(network: ForceNetwork) -> Self {
        Self(Kind::Unet {
            network: Box::new(network),
            small: Box::new([0; IMAGE_PIXELS]),
        })
    }
}

impl From<TrackedNetwork> for Network {
    fn from(network: TrackedNetwork) -> Self {
        Self(Kind::Tracked(Box::new(network)))
    }
}

impl Network {
    /// The network with the weights that the crate carries.
    ///
    /// # Errors
    /// Never with the committed weights (a test loads them); the trainer replaces those files.
    pub fn embedded(architecture: Architecture) -> Result<Self, WeightsError> {
        Ok(match architecture {
            Architecture::Unet => ForceNetwork::embedded()?.into(),
            Architecture::Tracked => TrackedNetwork::embedded()?.into(),
        })
    }

    /// The network with weights from a file; of the architecture that the file is for, or of none but `wanted`.
    ///
    /// # Errors
    /// When the file cannot be read or is not a complete, undamaged weights file of a known architecture.
    pub fn from_file(path: &Path, wanted: Option<Architecture>) -> Result<Self, WeightsError> {
        let open = || -> Result<Self, WeightsProblem> {
            let bytes = weights::read(path)?;
            let architecture = match wanted {
                Some(wanted) => wanted,
                None => weights::architecture(&bytes)?,
            };
            Ok(match architecture {
                Architecture::Unet => ForceNetwork::from_weights(&Weights::parse(&bytes)?)?.into(),
                Architecture::Tracked => {
                    TrackedNetwork::from_weights(&TrackedWeights::parse(&bytes)?)?.into()
                }
            })
        };
        open().map_err(|problem| WeightsError {
            origin: path.display().to_string(),
            problem,
        })
    }

    /// Which one it is.
    #[must_use]
    pub fn architecture(&self) -> Architecture {
        match self.0 {
            Kind::Unet { .. } => Architecture::Unet,
            Kind::Tracked(_) => Architecture::Tracked,
        }
    }

    /// The same network on another instruction set than the widest that the processor has.
    ///
    /// # Errors
    /// When the processor does not have it.
    pub fn with_instructions(self, instructions: InstructionSet) -> Result<Self, InstructionSetError> {
        Ok(match self.0 {
            Kind::Unet { network, .. } => network.with_instructions(instructions)?.into(),
            Kind::Tracked(network) => network.with_instructions(instructions)?.into(),
        })
    }

    /// The same network with another rule for what is computed. Forces stay the same, bit by bit.
    #[must_use]
    pub fn with_evaluation(self, evaluation: Evaluation) -> Self {
        match self.0 {
            Kind::Unet { network, .. } => network.with_evaluation(evaluation).into(),
            Kind::Tracked(network) => network.with_evaluation(evaluation).into(),
        }
    }

    /// Takes the 440×440 image of the untouched sensor.
    ///
    /// # Panics
    /// When it is not 440×440 bytes.
    pub fn set_rest(&mut self, rest: &[u8]) {
        match &mut self.0 {
            Kind::Unet { network, small } => {
                downsample_440_to_88(rest, small);
                network.set_rest(small);
            }
            Kind::Tracked(network) => network.set_rest(rest),
        }
    }

    /// Forces for the 440×440 image now, newtons per taxel. Every taxel of `out` is written; no allocation.
    ///
    /// # Panics
    /// When it is not 440×440 bytes.
    pub fn infer(&mut self, now: &[u8], out: &mut ForceMap) {
        match &mut self.0 {
            Kind::Unet { network, small } => {
                downsample_440_to_88(now, small);
                network.infer(small, out);
            }
            Kind::Tracked(network) => network.infer(now, out),
        }
    }

    /// The same for an image that was downsampled already: `small` is `now` at 88×88.
    ///
    /// # Panics
    /// When `now` is not 440×440 bytes.
    pub fn infer_with(&mut self, now: &[u8], small: &Image88, out: &mut ForceMap) {
        match &mut self.0 {
            Kind::Unet { network, .. } => network.infer(small, out),
            Kind::Tracked(network) => network.infer(now, out),
        }
    }

    /// How the slip detector should read these maps.
    #[must_use]
    pub fn calibration(&self) -> Calibration {
        match &self.0 {
            Kind::Unet { network, .. } => network.calibration(),
            Kind::Tracked(network) => network.calibration(),
        }
    }

    /// How the weights came to be, one line.
    #[must_use]
    pub fn manifest(&self) -> &str {
        match &self.0 {
            Kind::Unet { network, .. } => network.manifest(),
            Kind::Tracked(network) => network.manifest(),
        }
    }

    /// What the network itself has against the map of the last image, beside what [`Scene`](crate::scene::Scene) has
    /// against the picture: too many particles lost. Only `tracked` looks at particles.
    #[must_use]
    pub fn health(&self) -> Health {
        match &self.0 {
            Kind::Unet { .. } => Health::GOOD,
            Kind::Tracked(network) => network.health(),
        }
    }

    /// Particles of the rest image, and how many of them were lost or doubtful in the last image; none where the
    /// network does not look at particles.
    #[must_use]
    pub fn particles(&self) -> Option<(usize, usize)> {
        match &self.0 {
            Kind::Unet { .. } => None,
            Kind::Tracked(network) => Some(network.particles()),
        }
    }
}
