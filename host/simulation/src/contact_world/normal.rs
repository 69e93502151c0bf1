//! Pressure between gel and a rigid surface: gap and pressure never negative, one of them zero everywhere.
//! Conjugate gradients with projection (Polonsky and Keer 1999). Units: mm, N, MPa. Limits: what shear does to
//! the gap is given, not solved for here; see `solver`.

use super::convolution::Convolution;

/// Steps of the conjugate gradients at most.
const ITERATIONS: usize = 300;

/// How the indenter is pressed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Press {
    /// With a normal force, N.
    Force(f64),
    /// To a depth of its lowest plane under the gel at rest, mm.
    Depth(f64),
}

/// How far a solve came.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct NormalOutcome {
    /// Depth of the indenter's lowest plane under the gel at rest, mm.
    pub(crate) depth_mm: f64,
    /// Root mean square of the gap in contact, or the deepest penetration outside it if that is more, as a
    /// share of the deepest indentation.
    pub(crate) residual: f64,
    pub(crate) iterations: usize,
}

/// Working space of the solver for one size of box.
#[derive(Debug, Default)]
pub(crate) struct NormalSolver {
    /// Displacement under the pressure.
    displacement: Vec<f64>,
    gap: Vec<f64>,
    direction: Vec<f64>,
    answer: Vec<f64>,
}

impl NormalSolver {
    /// Brings `pressure` (its start too) to equilibrium over a surface `base_mm` above the gel as displaced by
    /// all but the pressure. A start whose residual is at most `accept` stays as it is; otherwise it stops at
    /// `tolerance`.
    pub(crate) fn solve(
        &mut self,
        convolution: &mut Convolution,
        base_mm: &[f64],
        press: Press,
        cell_mm2: f64,
        [accept, tolerance]: [f64; 2],
        pressure: &mut [f64],
    ) -> NormalOutcome {
        let cells = base_mm.len();
        for buffer in [
            &mut self.displacement,
            &mut self.gap,
            &mut self.direction,
            &mut self.answer,
        ] {
            buffer.clear();
            buffer.resize(cells, 0.0);
        }
        start(base_mm, press, cell_mm2, pressure);
        let (mut before, mut conjugate, mut known) = (1.0, false, false);
        let mut iterations = 0;
        loop {
            if !known {
                convolution.normal(pressure, &mut self.displacement);
            }
            let (mut outcome, square) = self.measure(base_mm, press, pressure);
            outcome.iterations = iterations;
            let enough = if iterations == 0 { accept } else { tolerance };
            if outcome.residual <= enough || iterations == ITERATIONS {
                return outcome;
            }
            iterations += 1;
            let memory = if conjugate { square / before } else { 0.0 };
            for ((direction, gap), p) in self.direction.iter_mut().zip(&self.gap).zip(&*pressure) {
                *direction = if *p > 0.0 { gap + memory * *direction } else { 0.0 };
            }
            before = square.max(1e-300);
            convolution.normal(&self.direction, &mut self.answer);
            [known, conjugate] = self.advance(press, cell_mm2, 1.0 / convolution.own_normal(), pressure);
        }
    }

    /// Depth, gaps, residual and the sum of squares of the gaps in contact.
    fn measure(&mut self, base_mm: &[f64], press: Press, pressure: &[f64]) -> (NormalOutcome, f64) {
        let depth_mm = match press {
            Press::Depth(depth) => depth,
            Press::Force(_) => mean_in_contact(pressure, |cell| base_mm[cell] + self.displacement[cell]),
        };
        let (mut square, mut count, mut penetration) = (0.0, 0_u32, 0.0_f64);
        let mut lowest = f64::INFINITY;
        for (((gap, displacement), base), p) in self
            .gap
            .iter_mut()
            .zip(&self.displacement)
            .zip(base_mm)
            .zip(pressure)
        {
            *gap = base + displacement - depth_mm;
            lowest = lowest.min(*base);
            if *p > 0.0 {
                square += *gap * *gap;
                count += 1;
            } else {
                penetration = penetration.max(-*gap);
            }
        }
        let deepest = (depth_mm - lowest).max(1e-12);
        let outcome = NormalOutcome {
            depth_mm,
            residual: (square / f64::from(count.max(1))).sqrt().max(penetration) / deepest,
            iterations: 0,
        };
        (outcome, square)
    }

    /// One step along the direction. Whether the displacement is still known without another convolution (no
    /// pressure was cut off or begun), and whether the next direction may be conjugate to this one (none begun).
    fn advance(
        &mut self,
        press: Press,
        cell_mm2: f64,
        own_stiffness: f64,
        pressure: &mut [f64],
    ) -> [bool; 2] {
        let shift = match press {
            Press::Depth(_) => 0.0,
            Press::Force(_) => mean_in_contact(pressure, |cell| self.answer[cell]),
        };
        let (mut along, mut curve) = (0.0, 0.0);
        for (((p, gap), direction), answer) in pressure
            .iter()
            .zip(&self.gap)
            .zip(&self.direction)
            .zip(&self.answer)
        {
            if *p > 0.0 {
                along += gap * direction;
                curve += (answer - shift) * direction;
            }
        }
        // A single cell under a given force has nowhere to go, but its neighbours may have to begin.
        let length = if curve > 0.0 { along / curve } else { own_stiffness };
        let (mut cut, mut begun) = (false, false);
        for ((p, gap), direction) in pressure.iter_mut().zip(&self.gap).zip(&self.direction) {
            if *p > 0.0 {
                *p -= length * direction;
                if *p <= 0.0 {
                    *p = 0.0;
                    cut = true;
                }
            }
            if *p == 0.0 && *gap < 0.0 {
                *p = -length * gap;
                begun = true;
            }
        }
        let mut scale = 1.0;
        if let Press::Force(force) = press {
            scale = force / (pressure.iter().sum::<f64>() * cell_mm2);
            for p in pressure.iter_mut() {
                *p *= scale;
            }
        }
        for (displacement, answer) in self.displacement.iter_mut().zip(&self.answer) {
            *displacement = (*displacement - length * answer) * scale;
        }
        [!cut && !begun, !begun]
    }
}

fn mean_in_contact(pressure: &[f64], value: impl Fn(usize) -> f64) -> f64 {
    let (mut sum, mut count) = (0.0, 0_u32);
    for (cell, p) in pressure.iter().enumerate() {
        if *p > 0.0 {
            sum += value(cell);
            count += 1;
        }
    }
    sum / f64::from(count.max(1))
}

/// A pressure to start from: the given one scaled to the new force (without it the gradients stop early), or
/// a push where the surface lies lowest.
fn start(base_mm: &[f64], press: Press, cell_mm2: f64, pressure: &mut [f64]) {
    if pressure.iter().all(|p| *p <= 0.0) {
        let depth = match press {
            Press::Depth(depth) => depth,
            Press::Force(_) => {
                let mut sorted = base_mm.to_vec();
                sorted.sort_unstable_by(f64::total_cmp);
                sorted[(sorted.len() / 10).clamp(1, sorted.len() - 1)].min(sorted[0] + 1.0) + 1e-6
            }
        };
        for (p, base) in pressure.iter_mut().zip(base_mm) {
            *p = 0.05 * (depth - base).max(0.0);
        }
    }
    if let Press::Force(force) = press {
        let scale = force / (pressure.iter().sum::<f64>() * cell_mm2);
        for p in pressure.iter_mut() {
            *p *= scale;
        }
    }
}
