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

/// Sums of a traction over a centred grid of `cells` × `cells` squares of side `pitch_mm`, N, row-major.
/// `traction_mpa` gives (x, y, pressure) at a point of the surface, mm; the midpoint rule takes `parts` × `parts`
/// points a cell.
pub fn cell_sums(
    pitch_mm: f64,
    cells: usize,
    parts: usize,
    traction_mpa: impl Fn([f64; 2]) -> [f64; 3],
) -> Vec<[f32; 3]> {
    let side = pitch_mm / parts as f64;
    let place = |i: usize| (i as f64 + 0.5) * side - 0.5 * cells as f64 * pitch_mm;
    let mut sums = vec![[0.0_f64; 3]; cells * cells];
    for row in 0..cells * parts {
        for column in 0..cells * parts {
            let traction = traction_mpa([place(column), place(row)]);
            let sum = &mut sums[row / parts * cells + column / parts];
            for (sum, traction) in sum.iter_mut().zip(traction) {
                *sum += traction * side * side;
            }
        }
    }
    sums.into_iter().map(|sum| sum.map(|v| v as f32)).collect()
}
