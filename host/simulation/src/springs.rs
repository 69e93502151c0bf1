//! Tangential memory of an axisymmetric contact: a row of independent springs over x² (Jäger; Popov's
//! method of dimensionality reduction). For a pull along one line it is Mindlin and Deresiewicz's
//! superposition for any history of P and Q; for a twist it is Jäger's superposition. Units: mm, N, MPa,
//! N·mm, rad. Limits: pull and twist share each spring's friction bound as an ellipse (Goyal's limit
//! surface), pulls that turn return radially; neither is exact.

use std::f64::consts::PI;

use crate::closed_form::{Hertz, k_minus_e_complement};
use crate::error::SimulationError;

/// Springs over the largest contact so far; at least half of them lie in it after each doubling of the span.
const SPRINGS: usize = 256;
/// A spring above this share of its bound counts as slipping: a grip that rises by a hair does not undo slip.
const SLIP_SHARE: f64 = 0.995;
/// Loads count as reached within this share of the friction limits.
const TOLERANCE: f64 = 1e-7;
/// Bound on Newton steps (a handful is usual).
const ITERATIONS: usize = 400;

/// Pull along x, pull along y, twist.
pub(crate) type Triple = [f64; 3];

/// Elastic constants and friction that the springs need.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stiffness {
    /// G* = 4G/(2−ν): line stiffness of pull, MPa.
    pub(crate) pull_mpa: f64,
    /// 4G/π: line stiffness of twist, MPa.
    pub(crate) twist_mpa: f64,
    pub(crate) friction: f64,
}

impl Stiffness {
    fn of_each(&self) -> Triple {
        [self.pull_mpa, self.pull_mpa, self.twist_mpa]
    }
}

/// The springs and their load.
#[derive(Debug, Clone)]
pub(crate) struct Springs {
    stiffness: Stiffness,
    /// Distance of springs in x², mm²; 0 before the first contact.
    spacing_mm2: f64,
    /// Line densities: pull N/mm, twist MPa (a stack of twisted punches).
    line: Vec<Triple>,
    /// Springs inside the contact, and what the last step knows of them.
    active: usize,
    bound: Vec<[f64; 2]>,
    /// Share of the step's motion that each spring sees: those that touch only during the step see the rest
    /// of it.
    seen: Vec<f64>,
    /// Total load per unit of line density: pull, twist.
    weight: Vec<[f64; 2]>,
    /// Share of the bound that the last step's trial asked for.
    used: Vec<f64>,
    area_mm2: f64,
}

/// Force and moment of the bell Σ (s − x²)₊ with unit slope: 4/3 s^(3/2) and 8π/15 s^(5/2).
fn bell_totals(s: f64) -> [f64; 2] {
    let root = s.sqrt();
    [4.0 / 3.0 * s * root, 8.0 * PI / 15.0 * s * s * root]
}

impl Springs {
    pub(crate) fn new(stiffness: Stiffness) -> Self {
        Self {
            stiffness,
            spacing_mm2: 0.0,
            line: vec![[0.0; 3]; SPRINGS],
            active: 0,
            bound: vec![[0.0; 2]; SPRINGS],
            seen: vec![1.0; SPRINGS],
            weight: vec![[0.0; 2]; SPRINGS],
            used: vec![0.0; SPRINGS],
            area_mm2: 0.0,
        }
    }

    /// Nothing touches: the history is gone.
    pub(crate) fn release(&mut self) {
        self.line.fill([0.0; 3]);
        self.used.fill(0.0);
        self.active = 0;
        self.spacing_mm2 = 0.0;
        self.area_mm2 = 0.0;
    }

    /// Sets the normal load: who is in contact, how much each spring can hold. Lost springs let go. The
    /// motion that follows is taken to run evenly with the sphere's approach (∝ a²) from the last load to
    /// this one.
    pub(crate) fn press(&mut self, hertz: &Hertz) {
        let a = hertz.radius_mm();
        let area_before = self.area_mm2;
        self.area_mm2 = a * a;
        if self.spacing_mm2 == 0.0 {
            self.spacing_mm2 = self.area_mm2 / SPRINGS as f64;
        }
        while self.area_mm2 > self.spacing_mm2 * SPRINGS as f64 * (1.0 + 1e-9) {
            for i in 0..SPRINGS {
                self.line[i] = self.line.get(2 * i).copied().unwrap_or_default();
            }
            self.spacing_mm2 *= 2.0;
        }
        self.active = ((self.area_mm2 / self.spacing_mm2 - 1e-9).ceil() as usize).clamp(1, SPRINGS);
        self.line[self.active..].fill([0.0; 3]);

        let friction = self.stiffness.friction;
        // q_z = E*(a² − x²)/R with E*/R = πp0/2a.
        let pull = friction * PI * hertz.peak_pressure_mpa() / (2.0 * a);
        let twist = 2.0 / PI * friction * hertz.peak_pressure_mpa();
        let mut held = [0.0; 2];
        for i in 0..self.active {
            let s = i as f64 * self.spacing_mm2;
            self.seen[i] = if s <= area_before {
                1.0
            } else {
                (self.area_mm2 - s) / (self.area_mm2 - area_before)
            };
            // The twist bound has a logarithmic pole in the centre that carries no moment.
            let from_centre = s.max(self.spacing_mm2.min(self.area_mm2) / 16.0);
            self.bound[i] = [
                pull * (self.area_mm2 - s),
                twist * k_minus_e_complement(from_centre.sqrt() / a),
            ];
            // Line densities are linear in x² between springs and end at x = a.
            let knots = [s - self.spacing_mm2, s, self.knot(i + 1)];
            let totals = knots.map(|s| bell_totals(s.max(0.0)));
            for kind in 0..2 {
                let inner = (totals[1][kind] - totals[0][kind]) / self.spacing_mm2;
                let outer = (totals[2][kind] - totals[1][kind]) / (knots[2] - knots[1]);
                self.weight[i][kind] = outer - inner;
                held[kind] += self.weight[i][kind] * self.bound[i][kind];
            }
        }
        // Linear pieces miss the twist bound's curvature by about 1e-4: make its total exact.
        let limit = 3.0 * PI / 16.0 * friction * hertz.normal_n() * a;
        for bound in &mut self.bound[..self.active] {
            bound[1] *= limit / held[1];
        }
        for i in 0..self.active {
            let share = self.share(i, self.line[i]);
            if share > 1.0 {
                self.line[i] = self.line[i].map(|q| q / share);
            }
        }
    }

    /// Position of spring `i` in x², mm²; the last knot is the contact's edge.
    fn knot(&self, i: usize) -> f64 {
        (i as f64 * self.spacing_mm2).min(self.area_mm2)
    }

    /// Share of its bound that spring `i` would need to hold `line`.
    fn share(&self, i: usize, line: Triple) -> f64 {
        let [pull, twist] = self.bound[i];
        let (x, y, t) = (line[0] / pull, line[1] / pull, line[2] / twist);
        (x * x + y * y + t * t).sqrt()
    }

    /// Line densities of spring `i` after a further rigid motion, were there no friction bound.
    fn trial(&self, i: usize, motion: Triple) -> Triple {
        let stiffness = self.stiffness.of_each();
        std::array::from_fn(|k| self.line[i][k] + self.seen[i] * stiffness[k] * motion[k])
    }

    /// Loads that the springs hold after a further rigid motion, and their derivative.
    fn totals(&self, motion: Triple) -> (Triple, [Triple; 3]) {
        let stiffness = self.stiffness.of_each();
        let mut load = [0.0; 3];
        let mut slope = [[0.0; 3]; 3];
        for i in 0..self.active {
            let trial = self.trial(i, motion);
            let [pull, twist] = self.bound[i];
            let weight = [self.weight[i][0], self.weight[i][0], self.weight[i][1]];
            let share = self.share(i, trial);
            if share <= 1.0 + 1e-12 {
                for k in 0..3 {
                    load[k] += weight[k] * trial[k];
                    slope[k][k] += weight[k] * stiffness[k] * self.seen[i];
                }
            } else {
                // y = t/U, dy = dt/U − t (tᵀD dt)/U³ with D = diag(1/bound²).
                let scale = 1.0 / share;
                let pulled: Triple = std::array::from_fn(|k| {
                    let bound = if k < 2 { pull } else { twist };
                    trial[k] / (bound * bound) * scale * scale
                });
                for k in 0..3 {
                    load[k] += weight[k] * trial[k] * scale;
                    for l in 0..3 {
                        let unit = if k == l { 1.0 } else { 0.0 };
                        slope[k][l] +=
                            weight[k] * scale * (unit - trial[k] * pulled[l]) * stiffness[l] * self.seen[i];
                    }
                }
            }
        }
        (load, slope)
    }

    fn commit(&mut self, motion: Triple) {
        for i in 0..self.active {
            let trial = self.trial(i, motion);
            let share = self.share(i, trial);
            self.used[i] = share;
            self.line[i] = if share > 1.0 {
                trial.map(|q| q / share)
            } else {
                trial
            };
        }
    }

    /// The rigid motion (mm, mm, rad) after which the springs hold `target` (N, N, N·mm); `limit` is what
    /// they can hold at most of pull and twist.
    pub(crate) fn pull_and_twist(
        &mut self,
        target: Triple,
        limit: [f64; 2],
    ) -> Result<Triple, SimulationError> {
        let limits = [limit[0], limit[0], limit[1]];
        let off = |load: Triple| -> Triple { std::array::from_fn(|k| (target[k] - load[k]) / limits[k]) };
        let size = |r: Triple| r.iter().map(|v| v * v).sum::<f64>().sqrt();
        let elastic: Triple = {
            let pull: f64 = self.weight[..self.active].iter().map(|w| w[0]).sum();
            let twist: f64 = self.weight[..self.active].iter().map(|w| w[1]).sum();
            let [x, y, turn] = self.stiffness.of_each();
            [pull * x, pull * y, twist * turn]
        };
        let mut motion = [0.0; 3];
        let (mut load, mut slope) = self.totals(motion);
        let mut error = size(off(load));
        let mut iterations = 0;
        while error > TOLERANCE && iterations < ITERATIONS {
            iterations += 1;
            let missing: Triple = std::array::from_fn(|k| target[k] - load[k]);
            let mut better = None;
            if let Some(step) = solve_3x3(&slope, missing) {
                let mut scale = 1.0;
                while better.is_none() && scale > 0.05 {
                    let next: Triple = std::array::from_fn(|k| motion[k] + scale * step[k]);
                    let found = self.totals(next);
                    if size(off(found.0)) < (1.0 - 0.1 * scale) * error {
                        better = Some((next, found));
                    }
                    scale *= 0.5;
                }
            }
            // The elastic step never overshoots, whatever slips.
            let (next, found) = better.unwrap_or_else(|| {
                let next = std::array::from_fn(|k| motion[k] + missing[k] / elastic[k]);
                (next, self.totals(next))
            });
            motion = next;
            (load, slope) = found;
            error = size(off(load));
        }
        if error > TOLERANCE {
            return Err(SimulationError::NoConvergence {
                found: error,
                expected: TOLERANCE,
                iterations,
            });
        }
        self.commit(motion);
        Ok(motion)
    }

    /// Everything slides: each spring at its bound, along `share` of the two limits (pull x, pull y, twist;
    /// a unit vector).
    pub(crate) fn slide(&mut self, share: Triple) {
        for i in 0..self.active {
            let [pull, twist] = self.bound[i];
            self.line[i] = [share[0] * pull, share[1] * pull, share[2] * twist];
            self.used[i] = 1.0;
        }
    }

    /// Share of the contact area whose springs hold.
    pub(crate) fn stick_ratio(&self) -> f64 {
        let mut stuck = 0.0;
        for i in 0..self.active {
            let here = self.used[i];
            let next = if i + 1 < self.active {
                self.used[i + 1]
            } else {
                here
            };
            let width = self.knot(i + 1) - self.knot(i);
            stuck += width
                * match (here < SLIP_SHARE, next < SLIP_SHARE) {
                    (true, true) => 1.0,
                    (false, false) => 0.0,
                    (true, false) => (SLIP_SHARE - here) / (next - here),
                    (false, true) => (SLIP_SHARE - next) / (here - next),
                };
        }
        stuck / self.area_mm2
    }

    /// Tractions of pull x, pull y and twist at the radii whose squares are `squares_mm2`, MPa.
    pub(crate) fn tractions_mpa(&self, squares_mm2: &[f64], out: &mut Vec<Triple>) {
        // A line density with slope change w at s is the bell w(s − x²)₊: traction (2/π) w √(s − r²) for a
        // pull, 2 w r √(s − r²) for a twist.
        let mut bends = [(0.0, [0.0; 3]); SPRINGS + 1];
        let mut slope_in = [0.0; 3];
        let mut count = 0;
        for i in (1..=self.active).rev() {
            let s = self.knot(i);
            let outer = if i < self.active { self.line[i] } else { [0.0; 3] };
            let width = s - self.knot(i - 1);
            let slope: Triple = std::array::from_fn(|k| (self.line[i - 1][k] - outer[k]) / width);
            let bend: Triple = std::array::from_fn(|k| slope[k] - slope_in[k]);
            slope_in = slope;
            if bend.iter().any(|&b| b != 0.0) {
                bends[count] = (s, bend);
                count += 1;
            }
        }
        out.clear();
        for &square in squares_mm2 {
            let mut sum = [0.0; 3];
            for (s, bend) in bends[..count].iter().take_while(|(s, _)| *s > square) {
                let root = (s - square).sqrt();
                for k in 0..3 {
                    sum[k] += bend[k] * root;
                }
            }
            let twist = 2.0 * square.sqrt() * sum[2];
            out.push([2.0 / PI * sum[0], 2.0 / PI * sum[1], twist]);
        }
    }
}

/// Gaussian elimination with pivoting; none when the matrix is singular.
fn solve_3x3(matrix: &[Triple; 3], right: Triple) -> Option<Triple> {
    let mut m: [[f64; 4]; 3] = std::array::from_fn(|r| [matrix[r][0], matrix[r][1], matrix[r][2], right[r]]);
    for column in 0..3 {
        let pivot = (column..3).max_by(|&a, &b| m[a][column].abs().total_cmp(&m[b][column].abs()))?;
        m.swap(column, pivot);
        if m[column][column].abs() < 1e-12 * matrix[column][column].abs().max(1e-30) {
            return None;
        }
        for row in column + 1..3 {
            let factor = m[row][column] / m[column][column];
            let upper = m[column];
            for (value, above) in m[row].iter_mut().zip(upper).skip(column) {
                *value -= factor * above;
            }
        }
    }
    let mut x = [0.0; 3];
    for row in (0..3).rev() {
        let known: f64 = (row + 1..3).map(|k| m[row][k] * x[k]).sum();
        x[row] = (m[row][3] - known) / m[row][row];
    }
    Some(x)
}
