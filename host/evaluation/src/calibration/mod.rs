//! The fits behind calibrations: friction from slides, geometry from presses, the line table from measured forces; and the
//! quality of pictures of the untouched sensor surface. Pure.

pub mod camera;
pub mod friction;
pub mod gel;
pub mod geometry;
pub mod line;
pub mod surface;
