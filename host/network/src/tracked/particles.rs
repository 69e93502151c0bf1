//! Particles in the picture at rest: bright spots against what surrounds them, with their centres to a part of a
//! pixel and how bright they are for their place. Found once per rest image.

use super::pyramid::Level;
use crate::constants::CROP_SIDE;

/// Pixels at the image's edge in which no particle is looked for.
pub(super) const MARGIN: usize = 4;
/// Least height of a spot over its surroundings, smoothed grey levels.
const LEAST_HEIGHT: f32 = 10.0;

/// A bright spot at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Particle {
    /// Its brightest pixel: column, row.
    pub(super) pixel: [u16; 2],
    /// Its centre, pixels; pixel (0, 0) is centred on (0.5, 0.5).
    pub at_px: [f32; 2],
    /// Height over the surroundings, grey levels.
    pub height: f32,
    /// About how deep it lies under the surface, mm: nearer particles look larger and brighter.
    pub depth_mm: f32,
}

impl Particle {
    /// First pixel of its patch.
    pub(super) fn corner(&self) -> [i32; 2] {
        self.pixel.map(|v| i32::from(v) - 3)
    }
}

/// Depth of a particle of mean brightness for its place, mm, and mm per unit of the logarithm of brightness: a fit to
/// particles of known depth in the simulated world, where it explains half of the variance.
const DEPTH_MM: [f32; 2] = [3.19, 3.47];
/// Depths that particles can have, mm.
const DEPTHS_MM: [f32; 2] = [1.0, 5.5];
/// Terms of the light's fall over the image.
const TERMS: usize = 7;
/// Rounds of the robust fit, and the logarithmic residual from which on a particle counts less.
const ROUNDS: usize = 3;
const OUTLIER: f64 = 0.2;

/// Fits the logarithm of height by a smooth function of place, which takes out light and lens; what is left over
/// tells the depth.
fn estimate_depths(particles: &mut [Particle], side: f32) {
    let terms = |particle: &Particle| -> [f64; TERMS] {
        let [x, y] = particle.at_px.map(|v| f64::from(2.0 * v / side - 1.0));
        let square = x * x + y * y;
        [1.0, x, y, x * x, y * y, x * y, square * square]
    };
    let mut light = [0.0; TERMS];
    let mut left = vec![0.0_f64; particles.len()];
    for round in 0..ROUNDS {
        let mut system = [[0.0; TERMS + 1]; TERMS];
        for (particle, left) in particles.iter().zip(&left) {
            // Twice the same weight as in a least-squares row: 1/|residual| for outliers.
            let weight = if round == 0 {
                1.0
            } else {
                1.0 / (left.abs() / OUTLIER).max(1.0)
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
        // Too few particles to tell: a little towards zero.
        for (i, row) in system.iter_mut().enumerate() {
            row[i] += 1e-6;
        }
        light = solve(system);
        for (particle, left) in particles.iter().zip(&mut left) {
            let expected: f64 = terms(particle).iter().zip(light).map(|(a, b)| a * b).sum();
            *left = f64::from(particle.height.ln()) - expected;
        }
    }
    let _ = light;
    for (particle, left) in particles.iter_mut().zip(left) {
        particle.depth_mm = (DEPTH_MM[0] + DEPTH_MM[1] * left as f32).clamp(DEPTHS_MM[0], DEPTHS_MM[1]);
    }
}

/// Gauss–Jordan with pivoting; the last column is the right-hand side.
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
pub(super) fn find(image: &Level<CROP_SIDE>) -> Vec<Particle> {
    let side = CROP_SIDE;
    // 3×3 binomial, so that noise makes no spots.
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
            // Of equal neighbours the first one wins.
            let before = [(-1, -1), (0, -1), (1, -1), (-1, 0)];
            let peak = before
                .iter()
                .all(|&(dx, dy)| here > at(dx, dy) && here >= at(-dx, -dy));
            if !peak {
                continue;
            }
            let mut ground = f32::MAX;
            for dy in -4..=4 {
                for dx in -4..=4 {
                    ground = ground.min(at(dx, dy));
                }
            }
            if here - ground < LEAST_HEIGHT {
                continue;
            }
            let vertex = |low: f32, high: f32| {
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
                    column as f32 + 0.5 + vertex(at(-1, 0), at(1, 0)),
                    row as f32 + 0.5 + vertex(at(0, -1), at(0, 1)),
                ],
                height: here - ground,
                depth_mm: 0.0,
            });
        }
    }
    estimate_depths(&mut found, side as f32);
    found
}
