//! The layers of networks on channels-last activations, and [`Plan`], which chains them; below them [`simd`], the vector
//! instructions behind safe types. Pure arithmetic: no files, no threads, no allocation after construction.
//!
//! NaN and infinity pass through every operation, so a broken input never becomes a force that looks real.
// All `unsafe` code is in `simd`.
#![deny(unsafe_code)]

mod convolution;
mod direct;
mod error;
mod instruction_set;
mod int16;
mod peak;
mod plan;
mod plane;
mod pool;
mod region;
pub mod simd;
mod winograd;

pub use convolution::{Convolution, Kernel, Shape};
pub use direct::convolve;
pub use error::KernelError;
pub use instruction_set::InstructionSet;
pub use int16::{InputSign, Int16Convolution, rounded_even};
pub use peak::peak_multiply_adds;
pub use plan::{Plan, PlaneId};
pub use plane::Plane;
pub use pool::max_pool;
pub use region::Region;
