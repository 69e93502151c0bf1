//! Textbook solutions of a rigid sphere on an elastic half-space with Coulomb friction, free of history.
//! They are the checks of every contact solver in this crate. Units: mm, N, MPa, N·mm.
//! Limits: small strain, contact small against sphere and layer, no coupling of pressure and shear.

mod cattaneo_mindlin;
mod elliptic;
mod hertz;
mod torsion;

pub use cattaneo_mindlin::CattaneoMindlin;
pub use hertz::Hertz;
pub use torsion::Torsion;

pub(crate) use elliptic::k_minus_e_complement;

/// Composite Simpson rule with `2 * pairs` equal steps.
pub(crate) fn simpson(from: f64, to: f64, pairs: usize, f: impl Fn(f64) -> f64) -> f64 {
    let step = (to - from) / (2 * pairs) as f64;
    let mut sum = f(from) + f(to);
    for i in 1..2 * pairs {
        let weight = if i % 2 == 1 { 4.0 } else { 2.0 };
        sum += weight * f(from + i as f64 * step);
    }
    sum * step / 3.0
}
