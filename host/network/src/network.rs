//! A network of either architecture behind one interface: the camera's 440×440 crop in, forces out.

use std::path::Path;

use gripline_kernels::InstructionSet;

use crate::constants::IMAGE_PIXELS;
use crate::error::NetworkError;
use crate::force_map::{Calibration, ForceMap, scale_forces};
use crate::image::{Frame, Image88, downsample_440_to_88};
use crate::options::{Architecture, Evaluation};
use crate::scene::Health;
use crate::tracked::{TrackedNetwork, TrackedWeights};
use crate::unet::{UnetNetwork, UnetWeights};
use crate::weights;

/// A force network of either architecture.
#[derive(Debug, Clone)]
pub struct Network {
    kind: Kind,
    /// Factors on shear and normal force, from a calibration of the very fingertip.
    gain: [f32; 2],
}

#[derive(Debug, Clone)]
enum Kind {
    Unet {
        network: Box<UnetNetwork>,
        small: Box<Image88>,
    },
    Tracked(Box<TrackedNetwork>),
}

impl From<UnetNetwork> for Network {
    fn from(network: UnetNetwork) -> Self {
        Self::of(Kind::Unet {
            network: Box::new(network),
            small: Box::new([0; IMAGE_PIXELS]),
        })
    }
}

impl From<TrackedNetwork> for Network {
    fn from(network: TrackedNetwork) -> Self {
        Self::of(Kind::Tracked(Box::new(network)))
    }
}

impl Network {
    const fn of(kind: Kind) -> Self {
        Self { kind, gain: [1.0; 2] }
    }

    /// The network with the built-in weights.
    ///
    /// # Errors
    /// Never with the committed weights (a test loads them); the trainer may replace those files.
    pub fn embedded(architecture: Architecture) -> Result<Self, NetworkError> {
        Ok(match architecture {
            Architecture::Unet => UnetNetwork::embedded()?.into(),
            Architecture::Tracked => TrackedNetwork::embedded()?.into(),
        })
    }

    /// The network with weights from a file. With `expected`, files of the other architecture are refused.
    ///
    /// # Errors
    /// When the file cannot be read or is not a complete, undamaged weights file of a known architecture.
    pub fn from_file(path: &Path, expected: Option<Architecture>) -> Result<Self, NetworkError> {
        let open = || -> Result<Self, NetworkError> {
            let bytes = weights::read(path)?;
            let architecture = match expected {
                Some(expected) => expected,
                None => weights::architecture(&bytes)?,
            };
            Ok(match architecture {
                Architecture::Unet => UnetNetwork::new(UnetWeights::parse(&bytes)?).into(),
                Architecture::Tracked => TrackedNetwork::new(TrackedWeights::parse(&bytes)?).into(),
            })
        };
        open().map_err(|problem| problem.in_weights(&path.display()))
    }

    /// The network's architecture.
    #[must_use]
    pub fn architecture(&self) -> Architecture {
        match self.kind {
            Kind::Unet { .. } => Architecture::Unet,
            Kind::Tracked(_) => Architecture::Tracked,
        }
    }

    /// Uses another instruction set than the widest available.
    ///
    /// # Errors
    /// When the processor does not have it.
    pub fn with_instructions(self, instructions: InstructionSet) -> Result<Self, NetworkError> {
        let changed: Self = match self.kind {
            Kind::Unet { network, .. } => network.with_instructions(instructions)?.into(),
            Kind::Tracked(network) => network.with_instructions(instructions)?.into(),
        };
        Ok(changed.with_gain(self.gain))
    }

    /// Chooses how much of a frame is computed.
    #[must_use]
    pub fn with_evaluation(self, evaluation: Evaluation) -> Self {
        let changed: Self = match self.kind {
            Kind::Unet { network, .. } => network.with_evaluation(evaluation).into(),
            Kind::Tracked(network) => network.with_evaluation(evaluation).into(),
        };
        changed.with_gain(self.gain)
    }

    /// Multiplies the forces by these factors on shear and normal force: a calibration's. 1 and 1 change no bit.
    #[must_use]
    pub fn with_gain(self, gain: [f32; 2]) -> Self {
        Self { gain, ..self }
    }

    /// Sets the 440×440 image of the untouched sensor.
    ///
    /// # Panics
    /// When `rest` is not 440×440 bytes.
    pub fn set_rest(&mut self, rest: &[u8]) {
        match &mut self.kind {
            Kind::Unet { network, small } => {
                downsample_440_to_88(rest, small);
                network.set_rest(small);
            }
            Kind::Tracked(network) => network.set_rest(rest),
        }
    }

    /// Learns the camera's noise from 440×440 pictures at rest, in the order of capture; call it after [`Self::set_rest`]. With fewer
    /// than two it is learnt from the frames. `unet` does not need it.
    ///
    /// # Panics
    /// When one is not 440×440 bytes.
    pub fn learn_noise(&mut self, rest: &[Vec<u8>]) {
        match &mut self.kind {
            Kind::Unet { .. } => {}
            Kind::Tracked(network) => network.learn_noise(rest),
        }
    }

    /// Takes nothing for noise in the next picture, whatever the [`Evaluation`]: the decision is close to its threshold.
    /// `unet` never takes anything for noise.
    pub fn refresh_next(&mut self) {
        match &mut self.kind {
            Kind::Unet { .. } => {}
            Kind::Tracked(network) => network.refresh_next(),
        }
    }

    /// Forces for the 440×440 image `now`, newtons per taxel. Writes every taxel of `out`; no allocation.
    ///
    /// # Panics
    /// When `now` is not 440×440 bytes.
    pub fn infer(&mut self, now: &[u8], out: &mut ForceMap) {
        match &mut self.kind {
            Kind::Unet { network, small } => network.infer(Frame::new(now, small).small(), out),
            Kind::Tracked(network) => network.infer(now, out),
        }
        scale_forces(out, self.gain);
    }

    /// The same for a frame that is downsampled already.
    pub fn infer_frame(&mut self, frame: Frame<'_>, out: &mut ForceMap) {
        match &mut self.kind {
            Kind::Unet { network, .. } => network.infer(frame.small(), out),
            Kind::Tracked(network) => network.infer(frame.crop(), out),
        }
        scale_forces(out, self.gain);
    }

    /// How the slip detector should read the maps.
    #[must_use]
    pub fn calibration(&self) -> Calibration {
        match &self.kind {
            Kind::Unet { network, .. } => network.calibration(),
            Kind::Tracked(network) => network.calibration(),
        }
    }

    /// How the weights were trained, one line.
    #[must_use]
    pub fn manifest(&self) -> &str {
        match &self.kind {
            Kind::Unet { network, .. } => network.manifest(),
            Kind::Tracked(network) => network.manifest(),
        }
    }

    /// The checksum of the weights file, in hexadecimal digits: what names the weights, whatever the instructions and the gain.
    #[must_use]
    pub fn checksum(&self) -> String {
        let bytes = match &self.kind {
            Kind::Unet { network, .. } => network.weights().to_bytes(),
            Kind::Tracked(network) => network.weights().to_bytes(),
        };
        weights::checksum_of(&bytes)
    }

    /// Problems that the network found in the last image, beside those that [`Scene`](crate::scene::Scene) finds: too many
    /// particles lost. Only `tracked` checks particles.
    #[must_use]
    pub fn health(&self) -> Health {
        match &self.kind {
            Kind::Unet { .. } => Health::GOOD,
            Kind::Tracked(network) => network.health(),
        }
    }

    /// Number of particles in the rest image, and how many of them were lost or doubtful in the last image. `None` for
    /// `unet`, which has no particles.
    #[must_use]
    pub fn particles(&self) -> Option<(usize, usize)> {
        match &self.kind {
            Kind::Unet { .. } => None,
            Kind::Tracked(network) => Some(network.particles()),
        }
    }
}
