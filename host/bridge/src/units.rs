//! From the wire's units to people's: newtons, newton-millimetres, ratios. Exact where f64 is.

use gripline_protocol::constants::TAXEL_PITCH_MM;
use gripline_protocol::message::MapSums;
use gripline_protocol::{LSB_PER_NEWTON, PER_UNIT};

/// 1/4096 N to newtons, exact.
#[must_use]
pub fn newtons(lsb: i32) -> f64 {
    f64::from(lsb) / f64::from(LSB_PER_NEWTON)
}

/// 1/10000 to a ratio.
#[must_use]
pub fn ratio(per_unit: u16) -> f64 {
    f64::from(per_unit) / f64::from(PER_UNIT)
}

/// F_x, F_y and F_N over the whole map, newtons.
#[must_use]
pub fn force_n(sums: &MapSums) -> [f64; 3] {
    sums.force.map(newtons)
}

/// F_T over the whole map, newtons.
#[must_use]
pub fn shear_n(sums: &MapSums) -> f64 {
    let [x, y, _] = force_n(sums);
    x.hypot(y)
}

/// Moment about z at the centre of the 20×20 map, N·mm.
#[must_use]
pub fn moment_nmm(sums: &MapSums) -> f64 {
    newtons(sums.moment) * (TAXEL_PITCH_MM / 2.0)
}

/// stick / contact; `None` when nothing is in contact.
#[must_use]
pub fn stick_ratio(sums: &MapSums) -> Option<f64> {
    (sums.contact > 0).then(|| f64::from(sums.stick) / f64::from(sums.contact))
}
