//! The sweeps, each a question with a table, its judgement and what may be seen in a picture.

mod border;
mod bounds;
mod cancellation;
mod drift;
mod judge;
mod one_step;
mod one_step_in_time;
mod order;
mod saturation;
mod scale;
mod settings;
mod size;
mod trend;
mod wraps;

use crate::{Effort, Sweep};

/// A sweep and its name.
type Named = (&'static str, fn(Effort) -> Sweep);

/// All of them.
pub(crate) const ALL: &[Named] = &[
    ("one step", one_step::sweep),
    ("one step, over time", one_step_in_time::sweep),
    ("scale", scale::sweep),
    ("size of the contact", size::sweep),
    ("saturation", saturation::sweep),
    ("settings at their ends", settings::sweep),
    ("cancellation", cancellation::sweep),
    ("bounds of every sum", bounds::sweep),
    ("the host's border", border::sweep),
    ("a million frames", drift::sweep),
    ("the trend", trend::sweep),
    ("clocks and numbers that wrap", wraps::sweep),
    ("order of packets", order::sweep),
];
