//! Displacements inside the gel under surface tractions: a linear layer bonded to a rigid base, solved per
//! wave vector on a periodic grid. Units: mm, N, MPa; depth grows from the surface (0) to the base
//! (thickness). Limits: small strain; the grid's period (64 mm) stands for an endless layer, whose fields
//! fall to a tenth in 16 mm.

use std::f64::consts::TAU;
use std::sync::Arc;

use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlannerScalar};

use crate::constants::{FIELD_CELLS, FIELD_LEVELS, FIELD_PITCH_MM, PARTICLE_DEPTH_MM};
use crate::contact_world::Truth;
use crate::gel::Gel;

type Spectrum = Complex<f32>;

const CELLS: usize = FIELD_CELLS * FIELD_CELLS;
/// Distance of the second level from a plane of markers, mm: fields come in pairs of levels.
const PLANE_MM: f64 = 0.1;
const ZERO: Spectrum = Complex { re: 0.0, im: 0.0 };

/// What a layer answers to one wave length of traction at one depth, mm per MPa. With k̂ along the wave
/// vector, L along and T across it, z into the gel: u_T = transverse·t_T, u_L = along_shear·t_L + i
/// along_pressure·p, u_z = −i down_shear·t_L + down_pressure·p.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Response {
    transverse: f64,
    along_shear: f64,
    along_pressure: f64,
    down_shear: f64,
    down_pressure: f64,
}

/// The layer's answers for one wave number, at every depth in `depths_mm`.
///
/// Papkovich form: the scaled dilatation div u/(1−2ν) is A e^(−kz) + B e^(−ks) with s = h − z, so
/// U = (C + Az/2) e^(−kz) + (E + Bs/2) e^(−ks), W = −(C + A(m + z/2)) e^(−kz) + (E + B(m + s/2)) e^(−ks),
/// m = (3−4ν)/2k, u_L = iU, u_z = W. Only falling exponentials appear, and nothing divides by 1−2ν.
fn responses(wave_per_mm: f64, gel: &Gel, depths_mm: &[f64]) -> Vec<Response> {
    let (h, g, nu) = (gel.thickness_mm, gel.shear_modulus_mpa(), gel.poisson);
    if wave_per_mm == 0.0 {
        // Even load: plain shear (G) and confined compression (M = 2G(1−ν)/(1−2ν), rigid at ν = ½).
        return depths_mm
            .iter()
            .map(|z| Response {
                transverse: (h - z) / g,
                along_shear: (h - z) / g,
                along_pressure: 0.0,
                down_shear: 0.0,
                down_pressure: (h - z) * (1.0 - 2.0 * nu) / (2.0 * g * (1.0 - nu)),
            })
            .collect();
    }
    let k = wave_per_mm;
    let m = (3.0 - 4.0 * nu) / (2.0 * k);
    let e = libm::exp(-k * h);
    // Unknowns A, C, B, E. Rows: U(h) = 0, W(h) = 0, U'(0) + kW(0) = −τ/G, 2ν q(0) + 2W'(0) = −p/G.
    let mut system = [
        [0.5 * h * e, e, 0.0, 1.0, 0.0, 0.0],
        [-(m + 0.5 * h) * e, -e, m, 1.0, 0.0, 0.0],
        [
            0.5 - k * m,
            -2.0 * k,
            (k * (h + m) - 0.5) * e,
            2.0 * k * e,
            -1.0 / g,
            0.0,
        ],
        [
            2.0 * nu - 1.0 + 2.0 * k * m,
            2.0 * k,
            (2.0 * nu - 1.0 + 2.0 * k * (m + 0.5 * h)) * e,
            2.0 * k * e,
            0.0,
            -1.0 / g,
        ],
    ];
    let [shear, pressure] = solve_4x4(&mut system);
    depths_mm
        .iter()
        .map(|&z| {
            let s = h - z;
            let (ez, es) = (libm::exp(-k * z), libm::exp(-k * s));
            let along = |[a, c, b, d]: [f64; 4]| (c + 0.5 * a * z) * ez + (d + 0.5 * b * s) * es;
            let down = |[a, c, b, d]: [f64; 4]| (d + b * (m + 0.5 * s)) * es - (c + a * (m + 0.5 * z)) * ez;
            Response {
                transverse: (ez - e * es) / (1.0 + e * e) / (g * k),
                along_shear: along(shear),
                along_pressure: along(pressure),
                down_shear: down(shear),
                down_pressure: down(pressure),
            }
        })
        .collect()
}

/// Gaussian elimination with pivoting; the last two columns are right-hand sides.
fn solve_4x4(m: &mut [[f64; 6]; 4]) -> [[f64; 4]; 2] {
    for column in 0..4 {
        let pivot = (column..4).max_by(|&a, &b| m[a][column].abs().total_cmp(&m[b][column].abs()));
        m.swap(column, pivot.unwrap_or(column));
        for row in 0..4 {
            if row != column {
                let factor = m[row][column] / m[column][column];
                let upper = m[column];
                for (value, above) in m[row].iter_mut().zip(upper).skip(column) {
                    *value -= factor * above;
                }
            }
        }
    }
    [4, 5].map(|right| std::array::from_fn(|row| m[row][right] / m[row][row]))
}

/// The layer's answers on the grid: one table per depth, made once per gel.
#[derive(Debug)]
pub struct LayerKernels {
    levels: Vec<LevelKernels>,
    /// k̂ as cos + i sin; zero for k = 0 and where the grid's sampling leaves the sign of k open.
    direction: Vec<Spectrum>,
}

#[derive(Debug)]
struct LevelKernels {
    transverse: Vec<f32>,
    along_shear: Vec<f32>,
    along_pressure: Vec<f32>,
    down_shear: Vec<f32>,
    down_pressure: Vec<f32>,
}

/// So many depths from the first to the second, evenly, mm.
fn depths_mm([top, bottom]: [f64; 2], levels: usize) -> Vec<f64> {
    (0..levels)
        .map(|level| top + (bottom - top) * level as f64 / (levels - 1) as f64)
        .collect()
}

/// Undoes, along one axis, what a sum over a cell and the quadratic spline between nodes blur at
/// `wave_per_mm`.
fn sharpening(wave_per_mm: f64) -> f64 {
    let x = 0.5 * wave_per_mm * FIELD_PITCH_MM;
    let cell = if x == 0.0 { 1.0 } else { libm::sin(x) / x };
    1.0 / (cell * (0.75 + 0.25 * libm::cos(2.0 * x)))
}

impl LayerKernels {
    /// The tables of `gel` at the depths that hold particles; tens of milliseconds.
    #[must_use]
    pub fn new(gel: &Gel) -> Self {
        Self::at(gel, &depths_mm(PARTICLE_DEPTH_MM, FIELD_LEVELS))
    }

    /// The tables of `gel` around one depth, for markers that lie in a plane.
    #[must_use]
    pub(crate) fn of_plane(gel: &Gel, depth_mm: f64) -> Self {
        Self::at(gel, &[depth_mm, depth_mm + PLANE_MM])
    }

    fn at(gel: &Gel, depths: &[f64]) -> Self {
        let n = FIELD_CELLS;
        let table = || vec![0.0; CELLS];
        let mut levels: Vec<LevelKernels> = depths
            .iter()
            .map(|_| LevelKernels {
                transverse: table(),
                along_shear: table(),
                along_pressure: table(),
                down_shear: table(),
                down_pressure: table(),
            })
            .collect();
        let mut direction = vec![ZERO; CELLS];
        // Undoes the transforms' factor and turns forces per cell into tractions.
        let scale = 1.0 / (CELLS as f64 * FIELD_PITCH_MM * FIELD_PITCH_MM);
        let wave = |i: usize| {
            let signed = if i > n / 2 { i as f64 - n as f64 } else { i as f64 };
            TAU * signed / (n as f64 * FIELD_PITCH_MM)
        };
        for row in 0..n {
            for column in 0..n {
                let (kx, ky) = (wave(column), wave(row));
                let k = (kx * kx + ky * ky).sqrt();
                let cell = row * n + column;
                let open = row == n / 2 || column == n / 2;
                if k > 0.0 && !open {
                    direction[cell] = Complex::new((kx / k) as f32, (ky / k) as f32);
                }
                let sharpen = scale * sharpening(kx) * sharpening(ky);
                for (level, answer) in levels.iter_mut().zip(responses(k, gel, depths)) {
                    let at = |value: f64| if open { 0.0 } else { (value * sharpen) as f32 };
                    level.transverse[cell] = at(answer.transverse);
                    level.along_shear[cell] = at(answer.along_shear);
                    level.along_pressure[cell] = at(answer.along_pressure);
                    level.down_shear[cell] = at(answer.down_shear);
                    level.down_pressure[cell] = at(answer.down_pressure);
                }
            }
        }
        Self { levels, direction }
    }
}

/// Displacements on the grid under the last contact, and what is needed to make them.
#[derive(Clone)]
pub struct DisplacementField {
    kernels: Arc<LayerKernels>,
    transform: SquareTransform,
    cells: Vec<[f32; 3]>,
    shear: Vec<Spectrum>,
    pressure: Vec<Spectrum>,
    along: Vec<Spectrum>,
    across: Vec<Spectrum>,
    /// u_x + i u_y, one grid per level.
    tangential: Vec<Vec<Spectrum>>,
    /// u_z of two levels, one in each part, one grid per pair of levels.
    normal: Vec<Vec<Spectrum>>,
}

impl DisplacementField {
    /// No displacement yet, over the layer of `kernels`.
    #[must_use]
    pub fn new(kernels: Arc<LayerKernels>) -> Self {
        let grid = || vec![ZERO; CELLS];
        let levels = kernels.levels.len();
        Self {
            kernels,
            transform: SquareTransform::new(FIELD_CELLS),
            cells: vec![[0.0; 3]; CELLS],
            shear: grid(),
            pressure: grid(),
            along: grid(),
            across: grid(),
            tangential: (0..levels).map(|_| grid()).collect(),
            normal: (0..levels.div_ceil(2)).map(|_| grid()).collect(),
        }
    }

    /// Computes the displacements under a solved contact.
    pub fn load(&mut self, truth: &Truth) {
        self.cells.fill([0.0; 3]);
        truth.add_field_forces(&mut self.cells);
        self.solve();
    }

    fn solve(&mut self) {
        let n = FIELD_CELLS;
        for ((shear, pressure), force) in self.shear.iter_mut().zip(&mut self.pressure).zip(&self.cells) {
            *shear = Complex::new(force[0], force[1]);
            *pressure = Complex::new(force[2], 0.0);
        }
        self.transform.forward(&mut self.shear);
        self.transform.forward(&mut self.pressure);
        // Z = FFT(q_x + i q_y)·conj(k̂) = L + iT; the partner at −k, with k̂ reversed, gives −(L − iT)
        // conjugated.
        let direction = &self.kernels.direction;
        for row in 0..n {
            for column in 0..n {
                let cell = row * n + column;
                let mirror = (n - row) % n * n + (n - column) % n;
                let here = self.shear[cell] * direction[cell].conj();
                let there = (self.shear[mirror] * direction[mirror].conj()).conj();
                self.along[cell] = (here - there).scale(0.5);
                self.across[cell] = (here + there).scale(0.5);
            }
        }
        let even = self.shear[0];
        for (level, kernels) in self.kernels.levels.iter().enumerate() {
            let out = &mut self.tangential[level];
            for cell in 0..CELLS {
                let pressure = self.pressure[cell];
                let turned = Complex::new(-pressure.im, pressure.re);
                let sum = self.along[cell].scale(kernels.along_shear[cell])
                    + turned.scale(kernels.along_pressure[cell])
                    + self.across[cell].scale(kernels.transverse[cell]);
                out[cell] = sum * direction[cell];
            }
            out[0] = even.scale(kernels.transverse[0]);
            self.transform.inverse(out);
        }
        for (pair, out) in self.normal.iter_mut().enumerate() {
            let down = |level: usize, cell: usize| match self.kernels.levels.get(level) {
                Some(kernels) => {
                    let along = self.along[cell];
                    Complex::new(along.im, -along.re).scale(kernels.down_shear[cell])
                        + self.pressure[cell].scale(kernels.down_pressure[cell])
                }
                None => ZERO,
            };
            for (cell, value) in out.iter_mut().enumerate() {
                let (first, second) = (down(2 * pair, cell), down(2 * pair + 1, cell));
                *value = Complex::new(first.re - second.im, first.im + second.re);
            }
            self.transform.inverse(out);
        }
    }

    /// Displacement (x, y, into the gel) of the material point that `place` stands for, mm.
    #[must_use]
    pub fn at(&self, place: &MaterialPoint) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for (step, weight_z) in [1.0 - place.below, place.below].into_iter().enumerate() {
            let level = usize::from(place.level) + step;
            let tangential = &self.tangential[level];
            let normal = &self.normal[level / 2];
            for (row, weight_y) in place.weights[1].into_iter().enumerate() {
                let cell = usize::from(place.cell) + row * FIELD_CELLS;
                let tangential = &tangential[cell..cell + 3];
                let normal = &normal[cell..cell + 3];
                for (column, weight_x) in place.weights[0].into_iter().enumerate() {
                    let weight = weight_x * weight_y * weight_z;
                    let down = if level % 2 == 0 {
                        normal[column].re
                    } else {
                        normal[column].im
                    };
                    sum[0] += weight * tangential[column].re;
                    sum[1] += weight * tangential[column].im;
                    sum[2] += weight * down;
                }
            }
        }
        sum
    }
}

impl std::fmt::Debug for DisplacementField {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DisplacementField")
            .field("cells", &FIELD_CELLS)
            .field("levels", &self.tangential.len())
            .finish_non_exhaustive()
    }
}

/// Where a material point lies between the grid's nodes; fixed for good, since the field is given at rest
/// positions. In the plane a quadratic spline over three nodes, in depth a line between two levels.
#[derive(Debug, Clone, Copy)]
pub struct MaterialPoint {
    /// First of the three by three nodes.
    cell: u16,
    level: u16,
    /// Weight of the deeper level.
    below: f32,
    weights: [[f32; 3]; 2],
}

impl MaterialPoint {
    /// The place of the point at (x, y) mm and `depth_mm`, for the fields of [`LayerKernels::new`]; clamped into the grid.
    #[must_use]
    pub fn new(at_mm: [f64; 2], depth_mm: f64) -> Self {
        Self::within(at_mm, depth_mm, PARTICLE_DEPTH_MM, FIELD_LEVELS)
    }

    /// A point in the plane of [`LayerKernels::of_plane`].
    #[must_use]
    pub(crate) fn in_plane(at_mm: [f64; 2]) -> Self {
        Self::within(at_mm, 0.0, [0.0, PLANE_MM], 2)
    }

    fn within(at_mm: [f64; 2], depth_mm: f64, [top, bottom]: [f64; 2], levels: usize) -> Self {
        // Nodes are the middles of cells.
        let nearest = |x: f64| {
            let place = x / FIELD_PITCH_MM + 0.5 * FIELD_CELLS as f64 - 0.5;
            let node = place.round().clamp(1.0, (FIELD_CELLS - 2) as f64);
            let t = (place - node).clamp(-0.5, 0.5) as f32;
            (
                node as u16 - 1,
                [
                    0.5 * (0.5 - t) * (0.5 - t),
                    0.75 - t * t,
                    0.5 * (0.5 + t) * (0.5 + t),
                ],
            )
        };
        let last = (levels - 1) as f64;
        let height = ((depth_mm - top) / (bottom - top) * last).clamp(0.0, last - 1e-6);
        let (column, weights_x) = nearest(at_mm[0]);
        let (row, weights_y) = nearest(at_mm[1]);
        Self {
            cell: row * FIELD_CELLS as u16 + column,
            level: height as u16,
            below: (height - height.floor()) as f32,
            weights: [weights_x, weights_y],
        }
    }
}

/// Two-dimensional complex transforms of a square grid. The plain plan, not the SIMD one that is picked at run
/// time: results must not depend on the processor's features.
#[derive(Clone)]
struct SquareTransform {
    n: usize,
    forward: Arc<dyn Fft<f32>>,
    inverse: Arc<dyn Fft<f32>>,
    turned: Vec<Spectrum>,
    scratch: Vec<Spectrum>,
}

impl SquareTransform {
    fn new(n: usize) -> Self {
        let mut planner = FftPlannerScalar::new();
        let forward = planner.plan_fft_forward(n);
        let inverse = planner.plan_fft_inverse(n);
        let scratch = forward
            .get_inplace_scratch_len()
            .max(inverse.get_inplace_scratch_len());
        Self {
            n,
            forward,
            inverse,
            turned: vec![ZERO; n * n],
            scratch: vec![ZERO; scratch],
        }
    }

    fn forward(&mut self, grid: &mut [Spectrum]) {
        self.run(&Arc::clone(&self.forward), grid);
    }

    /// Without the factor 1/n².
    fn inverse(&mut self, grid: &mut [Spectrum]) {
        self.run(&Arc::clone(&self.inverse), grid);
    }

    fn run(&mut self, transform: &Arc<dyn Fft<f32>>, grid: &mut [Spectrum]) {
        transform.process_with_scratch(grid, &mut self.scratch);
        transpose(self.n, grid, &mut self.turned);
        transform.process_with_scratch(&mut self.turned, &mut self.scratch);
        transpose(self.n, &self.turned, grid);
    }
}

fn transpose(n: usize, from: &[Spectrum], to: &mut [Spectrum]) {
    const TILE: usize = 8;
    for top in (0..n).step_by(TILE) {
        for left in (0..n).step_by(TILE) {
            for row in top..(top + TILE).min(n) {
                for column in left..(left + TILE).min(n) {
                    to[column * n + row] = from[row * n + column];
                }
            }
        }
    }
}

#[cfg(test)]
impl DisplacementField {
    /// The displacements under a traction (x, y, pressure) at points of the surface, MPa.
    pub(crate) fn load_traction(&mut self, traction_mpa: impl Fn([f64; 2]) -> [f64; 3]) {
        self.cells = crate::closed_form::cell_sums(FIELD_PITCH_MM, FIELD_CELLS, 8, traction_mpa);
        self.solve();
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::closed_form::{CattaneoMindlin, Hertz, simpson};

    /// Bessel function of the first kind of order 0 or 1 by its integral.
    fn bessel(order: u32, x: f64) -> f64 {
        let n = 24 + x as usize;
        let turn = |i: usize| PI * (i as f64 + 0.5) / n as f64;
        (0..n)
            .map(|i| (f64::from(order) * turn(i) - x * turn(i).sin()).cos())
            .sum::<f64>()
            / n as f64
    }

    /// A layer so thick that it is a half-space.
    fn half_space() -> Gel {
        Gel {
            thickness_mm: 1e9,
            ..Gel::default()
        }
    }

    #[test]
    fn a_thick_layer_has_the_half_spaces_kernels() {
        let gel = half_space();
        let (g, nu) = (gel.shear_modulus_mpa(), gel.poisson);
        for k in [0.05, 0.4, 2.0] {
            for (z, answer) in [0.0, 1.0, 4.0]
                .into_iter()
                .zip(responses(k, &gel, &[0.0, 1.0, 4.0]))
            {
                let fall = (-k * z).exp() / (2.0 * g * k);
                let same =
                    |a: f64, b: f64| assert!((a - b).abs() < 1e-9 / (g * k), "{a} {b} at k {k}, z {z}");
                same(answer.transverse, 2.0 * fall);
                same(answer.down_pressure, fall * (2.0 * (1.0 - nu) + k * z));
                same(answer.along_shear, fall * (2.0 * (1.0 - nu) - k * z));
                same(answer.along_pressure, fall * (1.0 - 2.0 * nu - k * z));
                same(answer.down_shear, fall * (1.0 - 2.0 * nu + k * z));
            }
        }
    }

    #[test]
    fn the_layers_surface_has_the_closed_kernels_and_its_base_stays_put() {
        for poisson in [0.3, 0.49, 0.5] {
            let gel = Gel {
                poisson,
                ..Gel::default()
            };
            let (g, h) = (gel.shear_modulus_mpa(), gel.thickness_mm);
            for k in [0.02, 0.1, 0.5, 3.0] {
                let answers = responses(k, &gel, &[0.0, h]);
                let (x, kolosov) = (k * h, 3.0 - 4.0 * poisson);
                let d = 2.0 * kolosov * (2.0 * x).cosh() + 4.0 * x * x + 1.0 + kolosov * kolosov;
                let scale = (1.0 - poisson) / (g * k);
                let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-9 * scale, "{a} {b} at k {k}");
                close(answers[0].transverse, x.tanh() / (g * k));
                close(
                    answers[0].down_pressure,
                    scale * (2.0 * kolosov * (2.0 * x).sinh() - 4.0 * x) / d,
                );
                close(
                    answers[0].along_shear,
                    scale * (2.0 * kolosov * (2.0 * x).sinh() + 4.0 * x) / d,
                );
                let coupling =
                    (kolosov * (1.0 - 2.0 * poisson) * ((2.0 * x).cosh() - 1.0) - 2.0 * x * x) / (g * k * d);
                close(answers[0].along_pressure, coupling);
                close(answers[0].down_shear, coupling);
                let base = answers[1];
                for value in [
                    base.transverse,
                    base.along_shear,
                    base.along_pressure,
                    base.down_shear,
                    base.down_pressure,
                ] {
                    close(value, 0.0);
                }
            }
        }
    }

    /// Displacement at distance r from a point load, from the kernels: (1/2π) ∫ f(k) J(kr) k dk.
    fn point_load(order: u32, r: f64, z: f64, pick: impl Fn(&Response) -> f64) -> f64 {
        let gel = half_space();
        simpson(1e-6, 24.0 / z, 4000, |k| {
            pick(&responses(k, &gel, &[z])[0]) * bessel(order, k * r) * k
        }) / TAU
    }

    #[test]
    fn the_kernels_give_boussinesqs_point_load_at_depth() {
        let gel = half_space();
        let (g, nu) = (gel.shear_modulus_mpa(), gel.poisson);
        for (r, z) in [(0.5, 1.0), (2.0, 1.5), (3.0, 4.0)] {
            let distance = f64::hypot(r, z);
            let down = (2.0 * (1.0 - nu) / distance + z * z / distance.powi(3)) / (4.0 * PI * g);
            let out = (r * z / distance.powi(3) - (1.0 - 2.0 * nu) * r / (distance * (distance + z)))
                / (4.0 * PI * g);
            let found = point_load(0, r, z, |a| a.down_pressure);
            assert!((found / down - 1.0).abs() < 1e-3, "{found} {down}");
            // u_L = i b p with e^{ikx}: outward displacement is −(1/2π) ∫ b J1 k dk.
            let found = -point_load(1, r, z, |a| a.along_pressure);
            assert!((found / out - 1.0).abs() < 2e-3, "{found} {out}");
        }
    }

    #[test]
    fn the_kernels_give_cerrutis_point_load_at_depth() {
        let gel = half_space();
        let (g, nu) = (gel.shear_modulus_mpa(), gel.poisson);
        for (x, z) in [(0.5_f64, 1.0), (2.0, 1.5)] {
            let distance = x.hypot(z);
            let wide = distance + z;
            // Johnson 3.75, load along x, point on the x axis.
            let along = (1.0 / distance
                + x * x / distance.powi(3)
                + (1.0 - 2.0 * nu) * (1.0 / wide - x * x / (distance * wide * wide)))
                / (4.0 * PI * g);
            let down = (x * z / distance.powi(3) + (1.0 - 2.0 * nu) * x / (distance * wide)) / (4.0 * PI * g);
            // u_x on the axis: (1/4π) ∫ [(L + T) J0 + (T − L) J2] k dk with J2 = 2 J1/x − J0.
            let mean = point_load(0, x, z, |a| a.along_shear + a.transverse);
            let difference = simpson(1e-6, 24.0 / z, 4000, |k| {
                let answer = responses(k, &gel, &[z])[0];
                let second = 2.0 * bessel(1, k * x) / (k * x) - bessel(0, k * x);
                (answer.transverse - answer.along_shear) * second * k
            }) / TAU;
            let found = 0.5 * (mean + difference);
            assert!((found / along - 1.0).abs() < 1e-3, "{found} {along}");
            let found = point_load(1, x, z, |a| a.down_shear);
            assert!((found / down - 1.0).abs() < 2e-3, "{found} {down}");
        }
    }

    #[test]
    fn hertz_pressure_pushes_the_half_space_into_the_closed_forms_shape() {
        let gel = half_space();
        let hertz = Hertz::new(2.0, 12.0, &gel).unwrap();
        let a = hertz.radius_mm();
        // Hankel transform of the pressure: 2π p0 a² (sin x − x cos x)/x³ at x = ka.
        let spectrum = |k: f64| {
            let x = k * a;
            let bell = if x < 1e-2 {
                1.0 / 3.0
            } else {
                (x.sin() - x * x.cos()) / x.powi(3)
            };
            TAU * hertz.peak_pressure_mpa() * a * a * bell
        };
        for r in [0.0, 0.5 * a, 0.9 * a, 1.5 * a, 2.5 * a] {
            let found = simpson(1e-6, 300.0 / a, 6000, |k| {
                responses(k, &gel, &[0.0])[0].down_pressure * spectrum(k) * bessel(0, k * r) * k
            }) / TAU;
            let exact = hertz.normal_displacement_mm(r);
            assert!((found / exact - 1.0).abs() < 0.005, "{found} {exact} at {r} mm");
        }
    }

    #[test]
    fn a_solved_contact_moves_the_inside_as_the_closed_form_does() {
        use crate::contact_world::{Contact, Drive, GelSurface, Mount, Press, Shape};
        // Tractions from a half-space without coupling, on both ways; the inside is the layer's.
        let gel = Gel {
            poisson: 0.5,
            ..half_space()
        };
        let (normal_n, pull_n, radius_mm, friction) = (2.0, 0.6, 20.0, 0.65);
        let hertz = Hertz::new(normal_n, radius_mm, &gel).unwrap();
        let closed = CattaneoMindlin::new(hertz, friction, &gel).unwrap();
        let surface = Arc::new(GelSurface::new(&gel, 80).unwrap());
        let sphere = Arc::new(Shape::Sphere { radius_mm });
        let mut solved = Contact::new(surface, sphere, friction, Mount::default()).unwrap();
        for shift in [0.0, closed.displacement_mm(pull_n).unwrap()] {
            let drive = Drive {
                press: Press::Force(normal_n),
                at_mm: [0.4 + shift, -0.2],
                turn_rad: 0.0,
                tilt_rad: [0.0; 2],
            };
            solved.step(drive).unwrap();
        }
        let kernels = Arc::new(LayerKernels::new(&Gel::default()));
        let [mut one, mut other] = [0, 1].map(|_| DisplacementField::new(Arc::clone(&kernels)));
        one.load_traction(|[x, y]| {
            let r = f64::hypot(x - 0.4, y + 0.2);
            if r >= hertz.radius_mm() {
                return [0.0; 3];
            }
            [
                closed.traction_mpa(pull_n, r).unwrap(),
                0.0,
                hertz.pressure_mpa(r),
            ]
        });
        other.load(solved.truth());
        let (mut largest, mut worst) = (0.0_f32, 0.0_f32);
        for x in [-6.0, -2.0, 0.4, 1.0, 3.0] {
            for depth in [1.0, 2.5, 4.0] {
                let place = MaterialPoint::new([x, 0.5], depth);
                for (a, b) in one.at(&place).into_iter().zip(other.at(&place)) {
                    largest = largest.max(a.abs());
                    worst = worst.max((a - b).abs());
                }
            }
        }
        assert!(worst < 0.02 * largest, "{worst} of {largest} mm");
    }

    #[test]
    fn the_grid_and_its_interpolation_give_the_endless_layers_field() {
        // Reference: Hankel integrals of the same kernels under the exact Hertz pressure and a gross-slip
        // shear μp.
        let gel = Gel::default();
        let friction = 0.65;
        let hertz = Hertz::new(3.0, 12.0, &gel).unwrap();
        let (a, p0) = (hertz.radius_mm(), hertz.peak_pressure_mpa());
        let mut field = DisplacementField::new(Arc::new(LayerKernels::new(&gel)));
        field.load_traction(|[x, y]| {
            let p = hertz.pressure_mpa(f64::hypot(x - 0.37, y + 0.21));
            [friction * p, 0.0, p]
        });
        let mut largest = [0.0_f64; 3];
        let mut worst = [0.0_f64; 3];
        for depth in [1.0, 1.2, 2.25, 3.9] {
            let steps = 1500_u32;
            let spectrum: Vec<(f64, Response, f64)> = (0..steps)
                .map(|i| (f64::from(i) + 0.5) / f64::from(steps) * 9.0)
                .map(|k| {
                    let x = k * a;
                    let bell = if x < 1e-2 {
                        1.0 / 3.0
                    } else {
                        (x.sin() - x * x.cos()) / x.powi(3)
                    };
                    (
                        k,
                        responses(k, &gel, &[depth])[0],
                        TAU * p0 * a * a * bell * k * 9.0 / f64::from(steps) / TAU,
                    )
                })
                .collect();
            for (x, y) in [
                (0.0, 0.0),
                (1.3, 0.4),
                (-2.0, 2.0),
                (0.3, 4.0),
                (6.0, 1.0),
                (-9.0, 3.0),
            ] {
                let r = f64::hypot(x, y);
                let (cos, sin) = if r > 0.0 { (x / r, y / r) } else { (1.0, 0.0) };
                let mut exact = [0.0; 3];
                for (k, answer, weight) in &spectrum {
                    let (j0, j1) = (bessel(0, k * r), bessel(1, k * r));
                    let j2 = if r > 0.0 { 2.0 * j1 / (k * r) - j0 } else { 0.0 };
                    let mean = 0.5 * (answer.along_shear + answer.transverse) * j0;
                    let turn = 0.5 * (answer.transverse - answer.along_shear) * j2;
                    let q = friction * weight;
                    exact[0] += q * (mean + turn * (cos * cos - sin * sin))
                        - weight * answer.along_pressure * j1 * cos;
                    exact[1] += q * turn * 2.0 * cos * sin - weight * answer.along_pressure * j1 * sin;
                    exact[2] += weight * answer.down_pressure * j0 + q * answer.down_shear * j1 * cos;
                }
                let found = field.at(&MaterialPoint::new([x + 0.37, y - 0.21], depth));
                for k in 0..3 {
                    largest[k] = largest[k].max(exact[k].abs());
                    worst[k] = worst[k].max((f64::from(found[k]) - exact[k]).abs());
                }
            }
        }
        for k in 0..3 {
            assert!(worst[k] < 0.01 * largest[0], "{worst:?} of {largest:?} mm");
        }
    }
}
