//! What calibrations are fitted by: friction from slides, geometry from presses, the line's table from measured forces, and
//! what pictures of the untouched sensor surface are worth. Pure.

pub mod friction;
pub mod geometry;
pub mod line;
pub mod surface;
