//! Detects the particles in the rest image: bright spots, with centre (to a fraction of a pixel) and depth estimated from
//! brightness. Runs once per rest image.

use super::level::Level;
use crate::constants::CROP_SIDE;

/// No particles are detected this close to the image's edge, pixels.
const MARGIN: usize = 4;
/// Smallest height of a spot above its surroundings, smoothed grey levels.
const HEIGHT_MIN: f32 = 10.0;

/// A bright spot at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Particle {
    /// Its brightest pixel: column, row.
    pub(super) pixel: [u16; 2],
    /// Its centre, pixels; pixel (0, 0) is centred on (0.5, 0.5).
    pub at_px: [f32; 2],
    /// Height above the surroundings, grey levels.
    pub height: f32,
    /// Estimated depth below the surface, mm: nearer particles look larger and brighter.
    pub depth_mm: f32,
}

impl Particle {
    /// First pixel of its patch.
    pub(super) fn corner(&self) -> [i32; 2] {
        self.pixel.map(|v| i32::from(v) - 3)
    }
}

/// Depth at mean brightness, mm, and change of depth per unit of log brightness, mm: a fit to simulated particles of known
/// depth, which explains half of the variance.
const DEPTH_MM: [f32; 2] = [3.19, 3.47];
/// Range of depths, mm.
const DEPTHS_MM: [f32; 2] = [1.0, 5.5];
/// Terms of the polynomial that models the illumination.
const TERMS: usize = 7;
/// Iterations of the robust fit, and the log residual above which a particle is an outlier.
const ROUNDS: usize = 3;
const OUTLIER: f64 = 0.2;

/// Estimates depths from brightness: fits log height by a smooth function of position (illumination and lens) and reads
/// the depth from the residual. Iteratively reweighted least squares.
fn estimate_depths(particles: &mut [Particle], side: f32) {
    let terms = |particle: &Particle| -> [f64; TERMS] {
        let [x, y] = particle.at_px.map(|v| f64::from(2.0 * v / side - 1.0));
        let square = x * x + y * y;
        [1.0, x, y, x * x, y * y, x * y, square * square]
    };
    let mut residuals = vec![0.0_f64; particles.len()];
    for round in 0..ROUNDS {
        let mut system = [[0.0; TERMS + 1]; TERMS];
        for (particle, residual) in particles.iter().zip(&residuals) {
            // 1/|residual| for outliers (Huber).
            let weight = if round == 0 {
                1.0
            } else {
                1.0 / (residual.abs() / OUTLIER).max(1.0)
            };
            let terms = terms(particle);
            let value = f64::from(particle.height.ln());
            for (row, a) in system.iter_mut().zip(terms) {
                for (sum, b) in row.iter_mut().zip(terms) {
                    *sum += weight * a * b;
                }
                row[TERMS] += weight * a * value;
            }
        }
        // Regularises the fit when there are few particles.
        for (i, row) in system.iter_mut().enumerate() {
            row[i] += 1e-6;
        }
        let light = solve(system);
        for (particle, residual) in particles.iter().zip(&mut residuals) {
            let expected: f64 = terms(particle).iter().zip(light).map(|(a, b)| a * b).sum();
            *residual = f64::from(particle.height.ln()) - expected;
        }
    }
    for (particle, residual) in particles.iter_mut().zip(residuals) {
        particle.depth_mm = (DEPTH_MM[0] + DEPTH_MM[1] * residual as f32).clamp(DEPTHS_MM[0], DEPTHS_MM[1]);
    }
}

/// Gauss–Jordan elimination with pivoting; the last column is the right-hand side.
fn solve(mut m: [[f64; TERMS + 1]; TERMS]) -> [f64; TERMS] {
    for column in 0..TERMS {
        let pivot = (column..TERMS).max_by(|&a, &b| m[a][column].abs().total_cmp(&m[b][column].abs()));
        m.swap(column, pivot.unwrap_or(column));
        let upper = m[column];
        for (row, values) in m.iter_mut().enumerate() {
            if row != column {
                let factor = values[column] / upper[column];
                for (value, above) in values.iter_mut().zip(upper).skip(column) {
                    *value -= factor * above;
                }
            }
        }
    }
    std::array::from_fn(|row| m[row][TERMS] / m[row][row])
}

/// All particles of `image`, row by row.
pub(super) fn detect(image: &Level<CROP_SIDE>) -> Vec<Particle> {
    let side = CROP_SIDE;
    // 3×3 binomial filter, so that noise makes no spots.
    let smooth: Vec<f32> = (0..side * side)
        .map(|i| {
            let (column, row) = ((i % side) as i32, (i / side) as i32);
            let line = |row: i32| {
                let &[a, b, c] = image.run::<3>(column - 1, row);
                f32::from(a) + 2.0 * f32::from(b) + f32::from(c)
            };
            (line(row - 1) + 2.0 * line(row) + line(row + 1)) / 16.0
        })
        .collect();
    let mut found = Vec::new();
    for row in MARGIN..side - MARGIN {
        for column in MARGIN..side - MARGIN {
            let at =
                |dx: i32, dy: i32| smooth[(row as i32 + dy) as usize * side + (column as i32 + dx) as usize];
            let here = at(0, 0);
            // The first of equal neighbours wins.
            let before = [(-1, -1), (0, -1), (1, -1), (-1, 0)];
            let peak = before
                .iter()
                .all(|&(dx, dy)| here > at(dx, dy) && here >= at(-dx, -dy));
            if !peak {
                continue;
            }
            let mut background = f32::MAX;
            for dy in -4..=4 {
                for dx in -4..=4 {
                    background = background.min(at(dx, dy));
                }
            }
            if here - background < HEIGHT_MIN {
                continue;
            }
            let parabola_peak = |low: f32, high: f32| {
                let bend = low - 2.0 * here + high;
                if bend < 0.0 {
                    (0.5 * (low - high) / bend).clamp(-0.5, 0.5)
                } else {
                    0.0
                }
            };
            found.push(Particle {
                pixel: [column as u16, row as u16],
                at_px: [
                    column as f32 + 0.5 + parabola_peak(at(-1, 0), at(1, 0)),
                    row as f32 + 0.5 + parabola_peak(at(0, -1), at(0, 1)),
                ],
                height: here - background,
                depth_mm: 0.0,
            });
        }
    }
    estimate_depths(&mut found, side as f32);
    found
}
