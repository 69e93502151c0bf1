//! How the shear that a contact carries grows with the indenter's motion (x, y, turn): an estimate that every trial
//! improves, so that a motion that balances given loads is found in two or three. Units: mm, rad, N, N·mm.

use crate::gel::Gel;

/// A motion (x, y, turn) or a load (x, y, moment).
pub(crate) type Triple = [f64; 3];
/// Growth of a load with a motion.
pub(crate) type Matrix = [[f64; 3]; 3];

/// Share of the stiffness along a motion that one update keeps at least.
const MIN_STIFFNESS: f64 = 1e-3;
/// Longest shift and turn from one trial to the next, mm and rad.
const TRIAL_REACH: [f64; 2] = [0.5, 0.15];

/// An estimate of the tangential stiffness.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stiffness {
    matrix: Matrix,
    /// Radius of a disc as large as the contact, mm; 0 without contact.
    radius_mm: f64,
}

impl Stiffness {
    pub(crate) fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// Drops the estimate: nothing touches any more.
    pub(crate) fn reset(&mut self) {
        self.radius_mm = 0.0;
    }

    /// Growth of the shear that it expects on a motion.
    pub(crate) fn growth(&self, motion: Triple) -> Triple {
        product(&self.matrix, motion)
    }

    /// The motion, cut to one trial's reach, after which it expects `unbalanced` to vanish; `more` is what else resists.
    pub(crate) fn newton_step(&self, more: &Matrix, unbalanced: Triple) -> Triple {
        let both: Matrix = std::array::from_fn(|i| add(more[i], self.matrix[i]));
        clamped(solved(&both, unbalanced.map(|v| -v)))
    }

    /// Follows the contact's size: a new contact has Mindlin's stiffness (8Ga/(2−ν), and 16Ga³/3 about the
    /// normal, on a half-space) on each of `surfaces`, and it grows with the radius.
    pub(crate) fn measure(&mut self, area_mm2: f64, gel: &Gel, surfaces: f64) {
        let radius = (area_mm2 / std::f64::consts::PI).sqrt();
        if self.radius_mm > 0.0 {
            let grown = radius / self.radius_mm;
            for (i, row) in self.matrix.iter_mut().enumerate() {
                for (j, value) in row.iter_mut().enumerate() {
                    *value *= match (i == 2, j == 2) {
                        (false, false) => grown,
                        (true, true) => grown.powi(3),
                        _ => grown * grown,
                    };
                }
            }
        } else {
            let along = surfaces * 2.0 * gel.tangential_modulus_mpa() * radius;
            let about = surfaces * 16.0 / 3.0 * gel.shear_modulus_mpa() * radius.powi(3);
            self.matrix = [[along, 0.0, 0.0], [0.0, along, 0.0], [0.0, 0.0, about]];
        }
        self.radius_mm = radius;
    }

    /// BFGS update: the shear grew by `growth` on `motion`. Where it hardly grew (all slips) a little is kept, so that the matrix
    /// stays positive definite (Powell's damping).
    pub(crate) fn update(&mut self, motion: Triple, growth: Triple) {
        let expected = product(&self.matrix, motion);
        let known = dot(motion, expected);
        if known <= 0.0 {
            return;
        }
        let mut growth = growth;
        let mut found = dot(motion, growth);
        if found < MIN_STIFFNESS * known {
            let part = (1.0 - MIN_STIFFNESS) * known / (known - found);
            for (g, e) in growth.iter_mut().zip(expected) {
                *g = part * *g + (1.0 - part) * e;
            }
            found = dot(motion, growth);
        }
        for i in 0..3 {
            for j in 0..3 {
                self.matrix[i][j] += growth[i] * growth[j] / found - expected[i] * expected[j] / known;
            }
        }
    }
}

fn product(m: &Matrix, v: Triple) -> Triple {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

pub(crate) fn dot(a: Triple, b: Triple) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Solution of m x = v for a symmetric positive definite matrix, by Cholesky's factors.
pub(crate) fn solved(m: &Matrix, v: Triple) -> Triple {
    let mut low = [[0.0_f64; 3]; 3];
    for i in 0..3 {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| low[i][k] * low[j][k]).sum();
            low[i][j] = if i == j {
                (m[i][i] - sum).max(1e-9 * m[i][i].abs() + 1e-300).sqrt()
            } else {
                (m[i][j] - sum) / low[j][j]
            };
        }
    }
    let mut x = v;
    for i in 0..3 {
        let sum: f64 = (0..i).map(|k| low[i][k] * x[k]).sum();
        x[i] = (x[i] - sum) / low[i][i];
    }
    for i in (0..3).rev() {
        let sum: f64 = (i + 1..3).map(|k| low[k][i] * x[k]).sum();
        x[i] = (x[i] - sum) / low[i][i];
    }
    x
}

pub(crate) fn add(a: Triple, b: Triple) -> Triple {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn sub(a: Triple, b: Triple) -> Triple {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// As much of a motion as one trial may make.
fn clamped(motion: Triple) -> Triple {
    let long = libm::hypot(motion[0], motion[1]) / TRIAL_REACH[0];
    let excess = long.max(motion[2].abs() / TRIAL_REACH[1]);
    if excess > 1.0 {
        motion.map(|v| v / excess)
    } else {
        motion
    }
}
