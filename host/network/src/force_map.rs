//! The output of every network, and how to read it.

use crate::constants::TAXELS;

/// Contact forces, newtons per taxel, `[x, y, z]`; index = row · 20 + column. x and y are shear, positive z presses into
/// the sensor surface.
pub type ForceMap = [[f32; 3]; TAXELS];

/// A map without forces.
pub const NO_FORCES: ForceMap = [[0.0; 3]; TAXELS];

/// How the slip detector should read a network's maps; measured on data that serves nothing else.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// A taxel is in contact above this normal force, newtons.
    pub contact_min_n: f32,
    /// Friction coefficient for the detector. Below the sensor's own (0.45), because predicted maps are smooth.
    pub friction: f32,
}

/// Multiplies every taxel by factors on shear (x and y) and normal force (z), a calibration's. 1 and 1 change no bit.
pub fn scale_forces(map: &mut ForceMap, [shear, normal]: [f32; 2]) {
    for force in map {
        *force = [force[0] * shear, force[1] * shear, force[2] * normal];
    }
}
