//! What a traction on one square cell of the gel does to the surface elsewhere, in mm per MPa: the exact
//! half-space cell (Love 1929, Cerruti) plus the layer's difference from it, a smooth function of distance
//! from one-dimensional Hankel integrals. No period, no singular wave number, no ringing; ν = ½ included.
//! Limits: small strain, flat surface, an endless layer bonded to a rigid base.

use std::f64::consts::{FRAC_1_PI, PI};

use crate::error::SimulationError;
use crate::gel::Gel;

/// Wave numbers, in 1/thickness, beyond which layer and half-space agree to 1e-13.
const WAVE_END: f64 = 18.0;
/// Distances, in thicknesses, beyond which the layer's surface is at rest to 1e-7 of the centre: the slowest
/// field falls as exp(−0.75 r/h).
const REACH: f64 = 24.0;
/// Steps of the radial table per thickness.
const STEPS_PER_THICKNESS: f64 = 24.0;
/// Gauss points of the Hankel integrals; the Bessel functions turn at most 70 times over the range.
const GAUSS_POINTS: usize = 320;

/// Displacements of the centre of one cell under unit tractions on another, mm per MPa. Two letters: which
/// displacement, under which traction; z is pressure and points into the gel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct CellInfluence {
    pub(crate) xx: f64,
    pub(crate) yy: f64,
    /// Also y under x.
    pub(crate) xy: f64,
    pub(crate) zz: f64,
    /// x under pressure; z under x traction has the opposite sign.
    pub(crate) xz: f64,
    /// y under pressure; z under y traction has the opposite sign.
    pub(crate) yz: f64,
}

/// The influence of cells of one size on each other, for one gel.
#[derive(Debug, Clone)]
pub(crate) struct Influence {
    pitch_mm: f64,
    shear_mpa: f64,
    poisson: f64,
    thickness_mm: f64,
    correction: Vec<Correction>,
}

/// The layer's point load less the half-space's, times 2πGh, at one distance.
#[derive(Debug, Clone, Copy, Default)]
struct Correction {
    /// ½ ∫ (F_U + F_T) J0.
    mean: f64,
    /// ½ ∫ (F_U − F_T) J2.
    turn: f64,
    /// ∫ F_W J0.
    down: f64,
    /// ∫ F_C J1.
    coupling: f64,
}

impl Influence {
    /// Cells of side `pitch_mm` on `gel`, at most `reach_mm` from each other.
    pub(crate) fn new(gel: &Gel, pitch_mm: f64, reach_mm: f64) -> Result<Self, SimulationError> {
        gel.check()?;
        let h = gel.thickness_mm;
        let steps = ((reach_mm / h).min(REACH) * STEPS_PER_THICKNESS).ceil() as usize;
        Ok(Self {
            pitch_mm,
            shear_mpa: gel.shear_modulus_mpa(),
            poisson: gel.poisson,
            thickness_mm: h,
            // One step before the centre and two past the end, for the interpolation.
            correction: hankel_table(gel.poisson, steps + 3),
        })
    }

    /// Influence over `columns` cells along x and `rows` along y (target less source).
    pub(crate) fn at(&self, columns: isize, rows: isize) -> CellInfluence {
        let (x, y) = (columns as f64 * self.pitch_mm, rows as f64 * self.pitch_mm);
        let r = libm::hypot(x, y);
        let h = self.thickness_mm;
        if r >= REACH * h {
            return CellInfluence::default();
        }
        let exact = self.half_space_cell(x, y);
        let scale = self.pitch_mm * self.pitch_mm / (2.0 * PI * self.shear_mpa * h);
        let add = self.correction_at(r / h);
        let (cos, sin) = if r > 0.0 { (x / r, y / r) } else { (1.0, 0.0) };
        CellInfluence {
            xx: exact.xx + scale * (add.mean - add.turn * (cos * cos - sin * sin)),
            yy: exact.yy + scale * (add.mean + add.turn * (cos * cos - sin * sin)),
            xy: exact.xy - scale * add.turn * 2.0 * cos * sin,
            zz: exact.zz + scale * add.down,
            xz: exact.xz - scale * add.coupling * cos,
            yz: exact.yz - scale * add.coupling * sin,
        }
    }

    /// Uniform traction on a square cell of an elastic half-space (Johnson, Contact Mechanics, 3.2.2 and 3.6).
    fn half_space_cell(&self, x: f64, y: f64) -> CellInfluence {
        let half = 0.5 * self.pitch_mm;
        // ∫∫ over the cell from its second antiderivative at the corners, which never lie on an axis.
        let over_cell = |f: fn(f64, f64) -> f64| {
            f(x + half, y + half) - f(x - half, y + half) - f(x + half, y - half) + f(x - half, y - half)
        };
        // x²/r³, y²/r³, xy/r³, x/r², y/r².
        let along_x = over_cell(|x, y| y * libm::asinh(x / y.abs()));
        let along_y = over_cell(|x, y| x * libm::asinh(y / x.abs()));
        let across = over_cell(|x, y| -libm::hypot(x, y));
        let out_x = over_cell(|x, y| 0.5 * y * libm::log(x * x + y * y) + x * libm::atan(y / x));
        let out_y = over_cell(|x, y| 0.5 * x * libm::log(x * x + y * y) + y * libm::atan(x / y));
        let nu = self.poisson;
        let unit = 0.5 * FRAC_1_PI / self.shear_mpa;
        let inverse_distance = along_x + along_y;
        let coupling = -0.5 * unit * (1.0 - 2.0 * nu);
        CellInfluence {
            xx: unit * ((1.0 - nu) * inverse_distance + nu * along_x),
            yy: unit * ((1.0 - nu) * inverse_distance + nu * along_y),
            xy: unit * nu * across,
            zz: unit * (1.0 - nu) * inverse_distance,
            xz: coupling * out_x,
            yz: coupling * out_y,
        }
    }

    /// Cubic interpolation of the table at `distance` thicknesses.
    fn correction_at(&self, distance: f64) -> Correction {
        let place = distance * STEPS_PER_THICKNESS;
        let node = (place as usize).min(self.correction.len() - 4);
        let t = place - node as f64;
        let weights = [
            -t * (t - 1.0) * (t - 2.0) / 6.0,
            (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
            -(t + 1.0) * t * (t - 2.0) / 2.0,
            (t + 1.0) * t * (t - 1.0) / 6.0,
        ];
        let mut sum = Correction::default();
        for (weight, value) in weights.into_iter().zip(&self.correction[node..node + 4]) {
            sum.mean += weight * value.mean;
            sum.turn += weight * value.turn;
            sum.down += weight * value.down;
            sum.coupling += weight * value.coupling;
        }
        sum
    }
}

/// Gk times (layer − half-space) at x = kh: transverse, along under along, down under pressure, coupling. From
/// the closed kernels of the bonded layer with the half-space taken off by hand, so nothing cancels.
fn differences(x: f64, poisson: f64) -> [f64; 4] {
    let nu = poisson;
    let kolosov = 3.0 - 4.0 * nu;
    let fall = libm::exp(-2.0 * x);
    let divisor = 2.0 * kolosov * libm::cosh(2.0 * x) + 4.0 * x * x + 1.0 + kolosov * kolosov;
    let common = 2.0 * kolosov * fall + 4.0 * x * x + 1.0 + kolosov * kolosov;
    [
        -2.0 * fall / (1.0 + fall),
        -(1.0 - nu) * (common - 4.0 * x) / divisor,
        -(1.0 - nu) * (common + 4.0 * x) / divisor,
        -((1.0 - 2.0 * nu) * (0.5 * (1.0 + kolosov).powi(2) + 2.0 * x * x) + 2.0 * x * x) / divisor,
    ]
}

/// The correction at distances −1, 0, 1, … `STEPS_PER_THICKNESS`ths of a thickness.
fn hankel_table(poisson: f64, count: usize) -> Vec<Correction> {
    let nodes: Vec<(f64, [f64; 4])> = gauss_legendre(GAUSS_POINTS)
        .into_iter()
        .map(|(at, weight)| {
            let x = 0.5 * WAVE_END * (at + 1.0);
            let weight = 0.5 * WAVE_END * weight;
            (x, differences(x, poisson).map(|f| f * weight))
        })
        .collect();
    let at = |distance: f64| {
        let mut sum = Correction::default();
        for (x, [transverse, along, down, coupling]) in &nodes {
            let argument = x * distance;
            let (j0, j1) = (libm::j0(argument), libm::j1(argument));
            let j2 = if argument < 1e-4 {
                argument * argument / 8.0
            } else {
                2.0 * j1 / argument - j0
            };
            sum.mean += 0.5 * (along + transverse) * j0;
            sum.turn += 0.5 * (along - transverse) * j2;
            sum.down += down * j0;
            sum.coupling += coupling * j1;
        }
        sum
    };
    let mut table: Vec<Correction> = (0..count)
        .map(|step| at(step as f64 / STEPS_PER_THICKNESS))
        .collect();
    // Mirror at the centre: J1 is odd, the others even.
    let mirrored = Correction {
        coupling: -table[1].coupling,
        ..table[1]
    };
    table.insert(0, mirrored);
    table
}

/// Nodes and weights of the Gauss–Legendre rule on −1 to 1 (Newton on the recurrence).
fn gauss_legendre(points: usize) -> Vec<(f64, f64)> {
    let n = points as f64;
    (0..points)
        .map(|i| {
            let mut x = libm::cos(PI * (i as f64 + 0.75) / (n + 0.5));
            let mut slope = 1.0;
            for _ in 0..8 {
                let (mut value, mut before) = (x, 1.0);
                for k in 2..=points {
                    let k = k as f64;
                    (value, before) = (((2.0 * k - 1.0) * x * value - (k - 1.0) * before) / k, value);
                }
                slope = n * (x * value - before) / (x * x - 1.0);
                x -= value / slope;
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gel(thickness_mm: f64, poisson: f64) -> Gel {
        Gel {
            thickness_mm,
            poisson,
            ..Gel::default()
        }
    }

    #[test]
    fn a_distant_cell_of_a_half_space_acts_as_a_point_load() {
        let influence = Influence::new(&gel(1e9, 0.3), 0.4, 60.0).unwrap();
        let (g, nu) = (influence.shear_mpa, 0.3);
        let (x, y) = (12.0_f64, -16.0_f64);
        let r = x.hypot(y);
        let found = influence.at(30, -40);
        let unit = 0.16 / (2.0 * PI * g);
        let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-3, "{a} {b}");
        close(found.xx, unit * ((1.0 - nu) / r + nu * x * x / r.powi(3)));
        close(found.yy, unit * ((1.0 - nu) / r + nu * y * y / r.powi(3)));
        close(found.xy, unit * nu * x * y / r.powi(3));
        close(found.zz, unit * (1.0 - nu) / r);
        close(found.xz, -unit * (0.5 - nu) * x / (r * r));
        close(found.yz, -unit * (0.5 - nu) * y / (r * r));
    }

    #[test]
    fn a_cell_moves_itself_by_loves_value() {
        let influence = Influence::new(&gel(1e9, 0.49), 0.8, 60.0).unwrap();
        // 4 a ln(1 + √2) (1−ν²) / πE for a square of side a (Johnson 3.26 at the centre).
        let modulus = Gel::default().contact_modulus_mpa();
        let exact = 4.0 * 0.8 * (1.0 + 2.0_f64.sqrt()).ln() / (PI * modulus);
        assert!((influence.at(0, 0).zz / exact - 1.0).abs() < 1e-8);
        assert!(influence.at(0, 0).xz.abs() < 1e-12);
    }

    /// Closed surface kernels of the layer, Gk times (transverse, along, down, coupling) at x = kh.
    fn closed(x: f64, nu: f64) -> [f64; 4] {
        let kolosov = 3.0 - 4.0 * nu;
        let d = 2.0 * kolosov * (2.0 * x).cosh() + 4.0 * x * x + 1.0 + kolosov * kolosov;
        [
            x.tanh(),
            (1.0 - nu) * (2.0 * kolosov * (2.0 * x).sinh() + 4.0 * x) / d,
            (1.0 - nu) * (2.0 * kolosov * (2.0 * x).sinh() - 4.0 * x) / d,
            (kolosov * (1.0 - 2.0 * nu) * ((2.0 * x).cosh() - 1.0) - 2.0 * x * x) / d,
        ]
    }

    #[test]
    fn the_differences_are_the_closed_layer_kernels_less_the_half_space() {
        for nu in [0.3, 0.49, 0.5] {
            for x in [0.01, 0.3, 1.0, 4.0] {
                let layer = closed(x, nu);
                let half_space = [1.0, 1.0 - nu, 1.0 - nu, 0.5 - nu];
                for (k, found) in differences(x, nu).into_iter().enumerate() {
                    assert!((found - (layer[k] - half_space[k])).abs() < 1e-12, "{k} at {x}");
                }
            }
        }
    }

    #[test]
    fn a_wave_of_tractions_on_the_cells_gives_the_closed_layer_kernels() {
        // Summing the cells over a plane wave undoes the Hankel integrals: an independent way to the kernels.
        for nu in [0.45, 0.5] {
            let gel = gel(3.0, nu);
            let (pitch, h) = (0.25, gel.thickness_mm);
            let influence = Influence::new(&gel, pitch, 80.0).unwrap();
            let reach = (REACH * h / pitch) as isize;
            let k = 0.8 / h;
            let mut sums = [0.0; 4];
            for row in -reach..=reach {
                for column in -reach..=reach {
                    let cell = influence.at(column, row);
                    let phase = k * column as f64 * pitch;
                    sums[0] += cell.yy * phase.cos();
                    sums[1] += cell.xx * phase.cos();
                    sums[2] += cell.zz * phase.cos();
                    // u_L = i b p e^(ikx): the sum of xz e^(−ikx) is i b, so b = −Σ xz sin.
                    sums[3] -= cell.xz * phase.sin();
                }
            }
            // The mean over a cell of the wave.
            let cell = (0.5 * k * pitch).sin() / (0.5 * k * pitch);
            for (found, exact) in sums.into_iter().zip(closed(k * h, nu)) {
                let exact = exact * cell / (gel.shear_modulus_mpa() * k);
                let scale = 1.0 / (gel.shear_modulus_mpa() * k);
                assert!((found - exact).abs() < 2e-3 * scale, "{found} {exact} at ν {nu}");
            }
        }
    }

    #[test]
    fn a_thick_layer_is_a_half_space_and_a_thin_one_is_stiffer() {
        let half = Influence::new(&gel(1e9, 0.49), 0.8, 45.0).unwrap();
        let thick = Influence::new(&gel(3000.0, 0.49), 0.8, 45.0).unwrap();
        let thin = Influence::new(&gel(3.0, 0.49), 0.8, 45.0).unwrap();
        for (column, row) in [(0, 0), (3, 1), (-10, 25)] {
            let (a, b) = (half.at(column, row), thick.at(column, row));
            let own = half.at(0, 0).zz;
            for (a, b) in [(a.xx, b.xx), (a.zz, b.zz), (a.xy, b.xy), (a.xz, b.xz)] {
                assert!((a - b).abs() < 1e-3 * own, "{a} {b}");
            }
            assert!(thin.at(column, row).zz < a.zz);
        }
    }
}
