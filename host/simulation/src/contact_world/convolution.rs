//! Surface displacements of a box of cells under its own tractions: transforms of the influence on a grid
//! padded to twice the box, so the sum is exact and free of images. Units: mm, MPa. Arrays are row-major over
//! the box, rows along y; spectra are stored column by column. Limits: sources outside the box are not seen.

use std::sync::Arc;

use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlannerScalar};

use super::influence::{CellInfluence, Influence};

pub(crate) type Pair = Complex<f64>;
const ZERO: Pair = Complex { re: 0.0, im: 0.0 };

/// Transforms of one padded size. The plain plans: results must not depend on the processor's features.
struct Plans {
    along_row: [Arc<dyn Fft<f64>>; 2],
    along_column: [Arc<dyn Fft<f64>>; 2],
}

/// The influence's spectra for boxes of one size, with the transforms' factor taken in.
pub(crate) struct Spectra {
    rows: usize,
    columns: usize,
    plans: Plans,
    /// z under pressure; real, as the influence is even.
    down: Vec<f64>,
    /// ½(xx + yy).
    mean: Vec<f64>,
    /// ½(xx − yy) + i xy, both parts spectra of their own (each real).
    turn: Vec<Pair>,
    /// x and y under pressure, imaginary parts (the influence is odd): x in the real place, y in the other.
    coupling: Vec<Pair>,
    /// Largest stretch that the tangential influence gives to any field, mm per MPa.
    tangential_bound: f64,
    /// What pressure on a cell does to the cell itself, mm per MPa.
    own_normal: f64,
}

impl std::fmt::Debug for Spectra {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Spectra")
            .field("rows", &self.rows)
            .field("columns", &self.columns)
            .finish_non_exhaustive()
    }
}

impl Spectra {
    /// For boxes of `rows` by `columns` cells.
    pub(crate) fn new(influence: &Influence, rows: usize, columns: usize) -> Self {
        let (width, height) = (2 * columns, 2 * rows);
        let mut planner = FftPlannerScalar::new();
        let plans = Plans {
            along_row: [planner.plan_fft_forward(width), planner.plan_fft_inverse(width)],
            along_column: [planner.plan_fft_forward(height), planner.plan_fft_inverse(height)],
        };
        let signed = |i: usize, n: usize| {
            if i < n / 2 {
                i as isize
            } else {
                i as isize - n as isize
            }
        };
        let mut cells = Vec::with_capacity(width * height);
        for column in 0..width {
            for row in 0..height {
                // The lag of minus one half is never used; without it odd components stay odd.
                cells.push(if column == columns || row == rows {
                    CellInfluence::default()
                } else {
                    influence.at(signed(column, width), signed(row, height))
                });
            }
        }
        let factor = 1.0 / (width * height) as f64;
        let spectrum = |pick: &dyn Fn(&CellInfluence) -> f64| -> Vec<Pair> {
            let mut grid: Vec<Pair> = cells.iter().map(|c| Pair::new(pick(c) * factor, 0.0)).collect();
            plans.along_column[0].process(&mut grid);
            let mut turned = vec![ZERO; grid.len()];
            transpose(&grid, height, &mut turned, width, width, height);
            plans.along_row[0].process(&mut turned);
            transpose(&turned, width, &mut grid, height, height, width);
            grid
        };
        let real = |v: Vec<Pair>| v.into_iter().map(|c| c.re).collect::<Vec<f64>>();
        let mean = real(spectrum(&|c| 0.5 * (c.xx + c.yy)));
        let difference = spectrum(&|c| 0.5 * (c.xx - c.yy));
        let across = spectrum(&|c| c.xy);
        let turn: Vec<Pair> = difference
            .iter()
            .zip(&across)
            .map(|(a, b)| Pair::new(a.re, b.re))
            .collect();
        let (out_x, out_y) = (spectrum(&|c| c.xz), spectrum(&|c| c.yz));
        let largest = mean
            .iter()
            .zip(&turn)
            .map(|(m, t)| m + t.norm())
            .fold(0.0, f64::max);
        Self {
            rows,
            columns,
            down: real(spectrum(&|c| c.zz)),
            tangential_bound: largest / factor,
            own_normal: influence.at(0, 0).zz,
            mean,
            turn,
            coupling: out_x
                .iter()
                .zip(&out_y)
                .map(|(x, y)| Pair::new(x.im, y.im))
                .collect(),
            plans,
        }
    }

    /// Rows and columns of the box.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.rows, self.columns]
    }
}

/// `to[i][j] = from[j][i]` for i below `rows` and j below `columns`, with the given lengths of a line.
fn transpose(from: &[Pair], from_line: usize, to: &mut [Pair], to_line: usize, columns: usize, rows: usize) {
    const TILE: usize = 8;
    for top in (0..rows).step_by(TILE) {
        for left in (0..columns).step_by(TILE) {
            for i in top..(top + TILE).min(rows) {
                for j in left..(left + TILE).min(columns) {
                    to[i * to_line + j] = from[j * from_line + i];
                }
            }
        }
    }
}

/// Convolutions over one box, with their working space.
#[derive(Debug)]
pub(crate) struct Convolution {
    spectra: Arc<Spectra>,
    lines: Vec<Pair>,
    spectrum: Vec<Pair>,
    product: Vec<Pair>,
    scratch: Vec<Pair>,
}

impl Convolution {
    pub(crate) fn new(spectra: Arc<Spectra>) -> Self {
        let (width, height) = (2 * spectra.columns, 2 * spectra.rows);
        let plans = &spectra.plans;
        let scratch = plans
            .along_row
            .iter()
            .chain(&plans.along_column)
            .map(|plan| plan.get_inplace_scratch_len())
            .max();
        Self {
            lines: vec![ZERO; width * spectra.rows],
            spectrum: vec![ZERO; width * height],
            product: vec![ZERO; width * height],
            scratch: vec![ZERO; scratch.unwrap_or(0)],
            spectra,
        }
    }

    /// Rows and columns of the box.
    pub(crate) fn size(&self) -> [usize; 2] {
        self.spectra.size()
    }

    /// Largest stretch that [`Self::tangential`] gives to any field, mm per MPa.
    pub(crate) fn tangential_bound(&self) -> f64 {
        self.spectra.tangential_bound
    }

    /// What pressure on a cell does to the cell itself, mm per MPa.
    pub(crate) fn own_normal(&self) -> f64 {
        self.spectra.own_normal
    }

    /// Spectrum of a field given cell by cell; the rows of zeros under the box are not transformed.
    fn forward(&mut self, field: impl Fn(usize) -> Pair) {
        let [rows, columns] = self.size();
        let (width, height) = (2 * columns, 2 * rows);
        for (row, line) in self.lines.chunks_exact_mut(width).enumerate() {
            for (column, value) in line[..columns].iter_mut().enumerate() {
                *value = field(row * columns + column);
            }
            line[columns..].fill(ZERO);
        }
        self.spectra.plans.along_row[0].process_with_scratch(&mut self.lines, &mut self.scratch);
        for line in self.spectrum.chunks_exact_mut(height) {
            line[rows..].fill(ZERO);
        }
        transpose(&self.lines, width, &mut self.spectrum, height, rows, width);
        self.spectra.plans.along_column[0].process_with_scratch(&mut self.spectrum, &mut self.scratch);
    }

    /// Hands the field of `self.product` to `take`, cell by cell of the box.
    fn inverse(&mut self, mut take: impl FnMut(usize, Pair)) {
        let [rows, columns] = self.size();
        let (width, height) = (2 * columns, 2 * rows);
        self.spectra.plans.along_column[1].process_with_scratch(&mut self.product, &mut self.scratch);
        transpose(&self.product, height, &mut self.lines, width, width, rows);
        self.spectra.plans.along_row[1].process_with_scratch(&mut self.lines, &mut self.scratch);
        for (row, line) in self.lines.chunks_exact(width).enumerate() {
            for (column, value) in line[..columns].iter().enumerate() {
                take(row * columns + column, *value);
            }
        }
    }

    /// Calls `f` with the place in the spectrum and the value there and at the opposite wave vector.
    fn with_mirror(&mut self, f: impl Fn(&Spectra, usize, Pair, Pair) -> Pair) {
        let [rows, columns] = self.size();
        let (width, height) = (2 * columns, 2 * rows);
        for column in 0..width {
            let mirrored = (width - column) % width * height;
            for row in 0..height {
                let place = column * height + row;
                let mirror = mirrored + (height - row) % height;
                self.product[place] = f(
                    &self.spectra,
                    place,
                    self.spectrum[place],
                    self.spectrum[mirror].conj(),
                );
            }
        }
    }

    /// Normal displacement under `pressure`.
    pub(crate) fn normal(&mut self, pressure: &[f64], out: &mut [f64]) {
        self.forward(|cell| Pair::new(pressure[cell], 0.0));
        for ((product, value), down) in self
            .product
            .iter_mut()
            .zip(&self.spectrum)
            .zip(&self.spectra.down)
        {
            *product = value.scale(*down);
        }
        self.inverse(|cell, value| out[cell] = value.re);
    }

    /// Tangential displacement x + iy under the tangential traction x + iy.
    pub(crate) fn tangential(&mut self, shear: &[Pair], out: &mut [Pair]) {
        self.forward(|cell| shear[cell]);
        self.with_mirror(|spectra, place, value, mirrored| {
            value.scale(spectra.mean[place]) + spectra.turn[place] * mirrored
        });
        self.inverse(|cell, value| out[cell] = value);
    }

    /// Tangential displacement x + iy under `pressure`.
    pub(crate) fn tangential_of_pressure(&mut self, pressure: &[f64], out: &mut [Pair]) {
        self.forward(|cell| Pair::new(pressure[cell], 0.0));
        for ((product, value), coupling) in self
            .product
            .iter_mut()
            .zip(&self.spectrum)
            .zip(&self.spectra.coupling)
        {
            // (i x) + i (i y).
            *product = value * Pair::new(-coupling.im, coupling.re);
        }
        self.inverse(|cell, value| out[cell] = value);
    }

    /// Normal displacement under the tangential traction x + iy.
    pub(crate) fn normal_of_shear(&mut self, shear: &[Pair], out: &mut [f64]) {
        self.forward(|cell| shear[cell]);
        self.with_mirror(|spectra, place, value, mirrored| {
            let x = (value + mirrored).scale(0.5);
            let y = (value - mirrored) * Pair::new(0.0, -0.5);
            let coupling = spectra.coupling[place];
            let sum = x.scale(coupling.re) + y.scale(coupling.im);
            Pair::new(sum.im, -sum.re)
        });
        self.inverse(|cell, value| out[cell] = value.re);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gel::Gel;
    use crate::random::Random;

    #[test]
    fn transforms_give_the_plain_sum_over_cells_for_every_component() {
        let influence = Influence::new(&Gel::default(), 0.8, 45.0).unwrap();
        let (rows, columns) = (6, 10);
        let mut convolution = Convolution::new(Arc::new(Spectra::new(&influence, rows, columns)));
        let mut random = Random::new(1, 90);
        let mut draw = || random.uniform(-1.0, 1.0);
        let pressure: Vec<f64> = (0..rows * columns).map(|_| draw()).collect();
        let shear: Vec<Pair> = (0..rows * columns).map(|_| Pair::new(draw(), draw())).collect();
        let (mut down, mut lift) = (vec![0.0; 60], vec![0.0; 60]);
        let (mut along, mut out) = (vec![ZERO; 60], vec![ZERO; 60]);
        convolution.normal(&pressure, &mut down);
        convolution.normal_of_shear(&shear, &mut lift);
        convolution.tangential(&shear, &mut along);
        convolution.tangential_of_pressure(&pressure, &mut out);
        for target in 0..60 {
            let mut sums = [0.0; 6];
            for source in 0..60 {
                let lag = |a: usize, b: usize| a as isize - b as isize;
                let cell = influence.at(
                    lag(target % columns, source % columns),
                    lag(target / columns, source / columns),
                );
                let (p, q) = (pressure[source], shear[source]);
                sums[0] += cell.zz * p;
                sums[1] -= cell.xz * q.re + cell.yz * q.im;
                sums[2] += cell.xx * q.re + cell.xy * q.im;
                sums[3] += cell.xy * q.re + cell.yy * q.im;
                sums[4] += cell.xz * p;
                sums[5] += cell.yz * p;
            }
            let found = [
                down[target],
                lift[target],
                along[target].re,
                along[target].im,
                out[target].re,
                out[target].im,
            ];
            for (a, b) in found.into_iter().zip(sums) {
                assert!((a - b).abs() < 1e-12, "{found:?} {sums:?}");
            }
        }
    }

    #[test]
    fn no_field_is_stretched_beyond_the_bound_and_some_come_close() {
        let influence = Influence::new(&Gel::default(), 0.8, 45.0).unwrap();
        let mut convolution = Convolution::new(Arc::new(Spectra::new(&influence, 12, 12)));
        let mut field = vec![Pair::new(1.0, 0.3); 144];
        let mut out = field.clone();
        let mut stretch = 0.0;
        for _ in 0..50 {
            convolution.tangential(&field, &mut out);
            let norm = |v: &[Pair]| v.iter().map(Complex::norm_sqr).sum::<f64>().sqrt();
            stretch = norm(&out) / norm(&field);
            let scale = 1.0 / norm(&out);
            field.clone_from(&out.iter().map(|v| v.scale(scale)).collect());
        }
        assert!(stretch <= convolution.tangential_bound() && stretch > 0.3 * convolution.tangential_bound());
    }
}
