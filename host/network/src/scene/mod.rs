//! What a picture needs before the force network: the scene gate (does the network have to run at all?) and the health
//! check (can the picture be trusted?).

mod block_sums;
mod difference;
mod gate;
mod health;
mod learned;
mod noise;
mod reference;
#[cfg(test)]
mod tests;

pub use gate::{GateDecision, GateKind, Scene, mean_of};
pub use health::{Health, HealthMetrics};
pub use learned::{GateInputs, NO_MOTION, STEPS_PER_UNIT};
