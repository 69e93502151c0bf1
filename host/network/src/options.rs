//! What a user can choose about a network.

use std::fmt;
use std::str::FromStr;

use crate::error::NetworkError;

/// The network's architecture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum Architecture {
    /// The encoder–decoder on two 88×88 images.
    Unet,
    /// Particles tracked at 440×440 and a small network: the default. More accurate; skips what does not move.
    #[default]
    Tracked,
}

impl Architecture {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Unet, Self::Tracked];

    /// Its name in settings, on the command line and in weights files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unet => "unet",
            Self::Tracked => "tracked",
        }
    }
}

impl fmt::Display for Architecture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Architecture {
    type Err = NetworkError;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|architecture| architecture.name() == name)
            .ok_or_else(|| NetworkError::UnknownNetwork {
                found: name.to_owned(),
            })
    }
}

/// How much of a frame is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Evaluation {
    /// Everything, always.
    Dense,
    /// Only what can differ from the frame before: the pixels of each layer that see a changed pixel. The forces are the same, bit by
    /// bit.
    #[default]
    Skip,
    /// Of `tracked`, only what differs by more than the camera's noise from when it was last looked at; `unet` works as with
    /// [`Self::Skip`]. Parts that are not computed keep the noise of the picture that they were last computed from; decisions can differ.
    SkipNoise,
}

/// The numbers that the `tracked` network computes with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum Precision {
    /// f32 throughout.
    F32,
    /// Weights and activations of all layers but the last in int16, sums in int32. Takes half the time; no taxel differs
    /// from f32 by more than 1 ‰ of the map's largest force (a test checks that).
    #[default]
    Int16,
}
