//! What a contact does to the skin as numbers: the taxel sums, and the load that asks for them. Units: N, N·mm.

use crate::constants::TAXEL_COUNT;

/// Newtons per taxel that the object exerts on the skin, (x, y, z), z into the skin; index = row * 20 + column.
pub type ForceMap = [[f32; 3]; TAXEL_COUNT];

/// What presses, pulls and turns the object on the skin.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Load {
    /// Normal force into the skin, N, 0 or above.
    pub normal_n: f64,
    /// Tangential force on the skin, N.
    pub shear_n: [f64; 2],
    /// Moment on the skin about z through the contact's centre, M = Σ(x f_y − y f_x), N·mm.
    pub torsion_nmm: f64,
}
