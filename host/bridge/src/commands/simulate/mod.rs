//! `gripline simulate`: plays a scene of the simulated world and writes what a camera would see and what is true.
//!
//! [`command`] joins the parts: `gripline_evaluation::play` is the world frame by frame and the table truth.csv, `folder` the
//! files (written whole or not at all, resumed after an interruption), `sheet` preview.png and `clip` the animation, both
//! drawn on a `canvas`. Units: newtons, N·mm, mm, s.

mod canvas;
mod clip;
pub mod command;
mod folder;
mod sheet;

pub use command::{SimulateArgs, run};
