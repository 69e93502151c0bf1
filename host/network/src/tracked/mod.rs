//! The tracking network: finds the particles of the sensor surface at full resolution, tracks them to a fraction of a
//! pixel, interpolates their motions onto a grid in millimetres, and turns the grid into forces with a small network.
//! 440×440 grey crops in, newtons per taxel out; no allocation per frame. One thread, or those of the caller's pool (rayon): they share
//! the particles and the nodes of the flow, with the same bits.
//!
//! A track depends only on the rest image and the image now. So [`Evaluation::Skip`](crate::Evaluation::Skip) tracks again
//! only what changed, with the same bits, and [`Evaluation::SkipNoise`](crate::Evaluation::SkipNoise) what changed by more than the camera's
//! noise: the rest of the picture stays as it was last looked at, for 20 pictures at most, and neither when a motion has just ended nor when the
//! caller asks for the whole picture ([`TrackedNetwork::refresh_next`]).

mod block_matching;
mod cells;
mod dirty_tiles;
mod flow;
mod grid;
mod grid_net;
mod layers;
mod lens;
mod level;
mod network;
mod particles;
mod patch;
mod pyramid;
mod search;
mod search_ray;
mod share;
mod tile_noise;
mod tracker;
mod weights;

pub use grid::{GRID_CHANNELS, GRID_NODES, GRID_PITCH_MM, GRID_SIDE, Grid, GridInterpolator, empty_grid};
pub use grid_net::input;
pub use layers::{INPUT_CHANNELS, layers, tensors};
pub use lens::Lens;
pub use network::TrackedNetwork;
pub use particles::Particle;
pub use search::Track;
pub use tracker::Tracker;
pub use weights::{TrackedScaling, TrackedWeights};
