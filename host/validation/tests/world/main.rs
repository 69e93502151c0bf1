//! The contact world and the grasp world against closed forms, statics, dynamics and their own promises;
//! `cargo test -p gripline-validation -- --nocapture` prints the figures.

mod contact;
mod friction;
mod grasp;

use gripline_simulation::ForceMap;

/// Root of the sum of squares of the difference over that of the second, over all components of all taxels.
fn difference(a: &ForceMap, b: &ForceMap) -> f64 {
    let (mut off, mut size) = (0.0, 0.0);
    for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
        off += f64::from(a - b).powi(2);
        size += f64::from(*b).powi(2);
    }
    (off / size).sqrt()
}
