//! The operations that networks are made of, on channels-last activations, and [`Plan`], which strings them
//! together. Pure arithmetic: no files, no threads, no allocation after construction.
//!
//! NaN and infinity pass through every operation, so that a broken input cannot end as a force that looks
//! real.

mod block;
mod block_sums;
mod convolution;
#[cfg(feature = "bench")]
mod limit;
mod pairs;
mod plan;
mod plane;
mod pool;
mod region;
mod sixteen;
#[cfg(test)]
mod tests;
mod vector;

pub(crate) use block_sums::{BlockSums, Pattern, PerBlock};
pub(crate) use convolution::{Convolution, Kernel, Shape};
#[cfg(feature = "bench")]
pub use limit::spin;
pub(crate) use plan::{Plan, PlaneId};
pub(crate) use region::Region;
pub(crate) use sixteen::Sixteen;
pub(crate) use vector::LANES_MAX;
