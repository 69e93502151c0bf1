//! A picture's way through the host: scene gate and network give newtons ([`pipeline`]), quantised they go to the device,
//! whose answer comes back ([`control_loop`]). The same for a run, for the replay of a recording and for the evaluation.
#![forbid(unsafe_code)]

mod acknowledgement;
pub mod control_loop;
mod error;
pub mod markers;
mod mode_request;
pub mod pipeline;
mod settings;

pub use acknowledgement::{Acknowledgement, Acknowledging};
pub use error::{MarkerProblem, PipelineError};
pub use mode_request::Unconfirmed;
pub use settings::{GripSetting, SCENE_INITIAL_GRIP_N, settings_for, settings_of};
