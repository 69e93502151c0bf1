//! The paper's encoder–decoder: two 88×88 images in (at rest, now), forces out.

mod graph;
mod network;
mod weights;

pub use network::UnetNetwork;
pub use weights::{Scaling, UnetWeights, Widths, layers, tensors};
