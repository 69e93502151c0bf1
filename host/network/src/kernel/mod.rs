//! The layers of networks on channels-last activations, and [`Plan`], which chains them. Pure arithmetic: no files, no
//! threads, no allocation after construction.
//!
//! NaN and infinity pass through every operation, so a broken input never becomes a force that looks real.

mod convolution;
mod direct;
mod int16;
mod peak;
mod plan;
mod plane;
mod pool;
mod region;
#[cfg(test)]
mod tests;
mod winograd;

pub(crate) use convolution::{Convolution, Kernel, Shape};
pub(crate) use int16::Int16Convolution;
pub use peak::peak_multiply_adds;
pub(crate) use plan::{Plan, PlaneId};
pub(crate) use region::Region;
