//! Processing of a picture on the host: scene gate and network give newtons ([`pipeline`]), which are quantised and sent to the
//! device, whose answer comes back ([`control_loop`]). Runs, replays and the evaluation share this code.
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
