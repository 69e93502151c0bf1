//! Inference of contact forces: camera images (at rest, now) in, a 20×20 map of forces in newtons per taxel out. Two
//! architectures: [`unet`] (an encoder–decoder on 88×88 images) and [`tracked`] (particles tracked at 440×440 pixels).
//! [`scene`] decides which frames need inference and which pictures can be trusted. One thread, or those of the caller's pool; no
//! allocation per frame.
//!
//! [`Network`] is all that a program needs. Taxels and images are row-major with the same orientation.
// All `unsafe` code is in `gripline_kernels::simd`, which wraps the vector instructions.
#![forbid(unsafe_code)]

pub mod constants;
mod error;
mod force_map;
pub mod image;
mod inference;
mod layer;
pub mod marker_forces;
pub mod metrics;
mod network;
mod options;
pub mod scene;
pub mod tracked;
pub mod unet;
mod weights;

pub use error::NetworkError;
pub use force_map::{Calibration, ForceMap, NO_FORCES, scale_forces};
pub use gripline_kernels::{InstructionSet, peak_multiply_adds};
pub use image::{Frame, downsample_440_to_88};
pub use inference::Inference;
pub use layer::{Folded, Layer, LayerKind, OUTPUT};
pub use network::Network;
pub use options::{Architecture, Evaluation, Precision};
pub use weights::Tensor;
