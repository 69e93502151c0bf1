//! Everything that can go wrong in this crate. Each message names what was found, what was expected and what to do.

use std::fmt;

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// A weights file cannot be used.
    #[error("weights {origin}: {problem}")]
    Weights {
        /// The file's path, or "built in".
        origin: String,
        /// What is wrong with it.
        problem: Box<Self>,
    },
    /// The file could not be read.
    #[error("cannot be read: {0}")]
    Read(#[from] std::io::Error),
    /// The file is larger than any weights file can be.
    #[error("{found} bytes long, expected at most {max}; is this the right file?")]
    TooLong {
        /// Its length.
        found: u64,
        /// The limit.
        max: u64,
    },
    /// The bytes are not safetensors.
    #[error("not a safetensors file ({found}); train one with `gripline-training train`")]
    NotSafetensors {
        /// What the reader met.
        found: String,
    },
    /// A metadata entry is missing.
    #[error("metadata has no entry `{key}`; expected a file written by `gripline-training train`")]
    NoMetadata {
        /// The entry.
        key: &'static str,
    },
    /// A metadata entry has an invalid value.
    #[error("metadata `{key}` is `{found}`, expected {expected}")]
    Metadata {
        /// The entry.
        key: &'static str,
        /// Its value.
        found: String,
        /// What it may be.
        expected: String,
    },
    /// Tensors or metadata do not match the file's checksum.
    #[error("checksum is {found:08x}, expected {expected:08x}; the file is damaged, copy it again")]
    Checksum {
        /// Computed from the file.
        found: u32,
        /// Stated in the file.
        expected: u32,
    },
    /// A tensor that the architecture needs is not there.
    #[error("tensor `{name}` is missing, expected shape {expected:?}")]
    MissingTensor {
        /// Its name.
        name: String,
        /// Its shape.
        expected: Vec<usize>,
    },
    /// A tensor that the architecture does not know.
    #[error("unknown tensor `{name}`; the architecture has no such part")]
    UnknownTensor {
        /// Its name.
        name: String,
    },
    /// A tensor of another shape.
    #[error("tensor `{name}` has shape {found:?}, expected {expected:?}")]
    Shape {
        /// Its name.
        name: String,
        /// Its shape.
        found: Vec<usize>,
        /// The architecture's.
        expected: Vec<usize>,
    },
    /// A tensor of another type.
    #[error("tensor `{name}` has type {found}, expected F32")]
    Type {
        /// Its name.
        name: String,
        /// Its type.
        found: String,
    },
    /// A weight that is not finite, or a negative variance.
    #[error("tensor `{name}` has {found} at index {index}, expected {expected}")]
    Value {
        /// The tensor.
        name: String,
        /// Position in the flattened tensor.
        index: usize,
        /// The value.
        found: f32,
        /// What it may be.
        expected: &'static str,
    },
    /// An instruction set that is not there or has no such name.
    #[error(transparent)]
    Kernel(#[from] gripline_kernels::KernelError),
    /// No network has this name.
    #[error("network `{found}` is unknown, expected `unet` or `tracked`")]
    UnknownNetwork {
        /// The name.
        found: String,
    },
    /// No model of forces from markers has this name.
    #[error(
        "sensor {sensor}: forces.weights is `{found}`, expected `elastic-layer` or a weights file (*.safetensors) of `gripline-training markers train`"
    )]
    UnknownForces {
        /// The sensor's identity.
        sensor: String,
        /// The name.
        found: String,
    },
    /// Weights of another sensor.
    #[error(
        "are of sensor {found}, expected {expected}; name that one's weights, or the other description with --sensor"
    )]
    OtherSensor {
        /// Whose they are.
        found: String,
        /// Whose they should be.
        expected: String,
    },
    /// No gate has this name.
    #[error("found {found}, expected network, difference or off")]
    UnknownGate {
        /// The name.
        found: String,
    },
}

impl NetworkError {
    /// This error about the weights from `origin`.
    pub(crate) fn in_weights(self, origin: &impl fmt::Display) -> Self {
        Self::Weights {
            origin: origin.to_string(),
            problem: Box::new(self),
        }
    }

    pub(crate) fn metadata(key: &'static str, found: &str, expected: impl fmt::Display) -> Self {
        Self::Metadata {
            key,
            found: found.to_owned(),
            expected: expected.to_string(),
        }
    }
}
