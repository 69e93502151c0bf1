//! What a contact does to the gel as numbers: the taxel sums, and the load that asks for them. Units: N, N·mm.

use crate::constants::TAXEL_COUNT;

/// Newtons per taxel that the object exerts on the gel, (x, y, z), z into the gel; index = row * 20 + column.
pub type ForceMap = [[f32; 3]; TAXEL_COUNT];

/// What presses, pulls and turns the object on the gel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Load {
    /// Normal force into the gel, N, 0 or above.
    pub normal_n: f64,
    /// Tangential force on the gel, N.
    pub shear_n: [f64; 2],
    /// Moment on the gel about z through the contact's centre, M = Σ(x f_y − y f_x), N·mm.
    pub torsional_moment_nmm: f64,
}
