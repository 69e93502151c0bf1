//! Shear between gel and indenter under Coulomb's law, one step of the load history: the shear q minimises
//! ½ qᵀAq − bᵀq on the discs |q| ≤ μp, so points inside the disc stick and points on its rim slip against q's
//! direction. Accelerated projected gradients with restart (Beck and Teboulle 2009; O'Donoghue and Candès
//! 2015). Units: mm, MPa. x + iy stands for a vector in the plane. Limits: the residual counts against μp, so
//! shear that stays far below it (friction far above 1) is met less well.

use super::convolution::{Convolution, Pair};

/// Steps of the gradients at most.
const ITERATIONS: usize = 2_000;

/// One step's problem on the cells of a box.
pub(crate) struct TangentialProblem<'a> {
    /// Displacement that the shear has to give where nothing slips, mm.
    pub(crate) target_mm: &'a [Pair],
    /// Friction bound μp; 0 outside the contact.
    pub(crate) limit_mpa: &'a [f64],
    /// Displacement by a rotation of the indenter, mm per rad.
    pub(crate) arm_mm: &'a [Pair],
    /// How far the mount gives, mm per MPa of summed shear.
    pub(crate) mount_shift: f64,
    /// How far the mount turns, rad per MPa·mm of summed shear times arm.
    pub(crate) mount_turn: f64,
}

/// How far a solve came.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TangentialOutcome {
    /// Change that another projected gradient step would make, root mean square over the contact, as a share
    /// of the root mean square bound.
    pub(crate) residual: f64,
    pub(crate) iterations: usize,
}

/// Working space of the solver for one size of box.
#[derive(Debug, Default)]
pub(crate) struct TangentialSolver {
    ahead: Vec<Pair>,
    slope: Vec<Pair>,
    contact: Vec<usize>,
}

/// The nearest point of the disc.
pub(crate) fn projected(shear: Pair, limit: f64) -> Pair {
    let square = shear.norm_sqr();
    if square <= limit * limit {
        shear
    } else {
        shear.scale(limit / square.sqrt())
    }
}

impl TangentialSolver {
    /// Brings `shear` (its start too) to the minimum. Stops at `tolerance` of the residual.
    pub(crate) fn solve(
        &mut self,
        convolution: &mut Convolution,
        problem: &TangentialProblem,
        tolerance: f64,
        shear: &mut [Pair],
    ) -> TangentialOutcome {
        let mut outcome = TangentialOutcome {
            residual: 0.0,
            iterations: 0,
        };
        let limit = problem.limit_mpa;
        self.contact.clear();
        self.contact
            .extend((0..limit.len()).filter(|&cell| limit[cell] > 0.0));
        for (q, limit) in shear.iter_mut().zip(limit) {
            *q = projected(*q, *limit);
        }
        if self.contact.is_empty() {
            return outcome;
        }
        let bound = self.contact.iter().map(|&c| limit[c] * limit[c]).sum::<f64>();
        let turned = self
            .contact
            .iter()
            .map(|&c| problem.arm_mm[c].norm_sqr())
            .sum::<f64>();
        let stretch = convolution.tangential_bound()
            + problem.mount_shift * self.contact.len() as f64
            + problem.mount_turn * turned;
        let step = 1.0 / stretch;
        self.ahead.clear();
        self.ahead.extend_from_slice(shear);
        self.slope.resize(shear.len(), Pair::default());
        let mut momentum = 1.0_f64;
        loop {
            convolution.tangential(&self.ahead, &mut self.slope);
            let (mut sum, mut moment) = (Pair::default(), 0.0);
            if problem.mount_shift > 0.0 || problem.mount_turn > 0.0 {
                for &cell in &self.contact {
                    sum += self.ahead[cell];
                    moment += (problem.arm_mm[cell].conj() * self.ahead[cell]).re;
                }
                sum *= problem.mount_shift;
                moment *= problem.mount_turn;
            }
            let next = 0.5 * (1.0 + (1.0 + 4.0 * momentum * momentum).sqrt());
            let carry = (momentum - 1.0) / next;
            let (mut uphill, mut change) = (0.0, 0.0);
            for &cell in &self.contact {
                let given = self.slope[cell] + sum + problem.arm_mm[cell].scale(moment);
                let ahead = self.ahead[cell];
                let q = projected(ahead - (given - problem.target_mm[cell]).scale(step), limit[cell]);
                let (back, on) = (ahead - q, q - shear[cell]);
                uphill += back.re * on.re + back.im * on.im;
                change += back.norm_sqr();
                self.ahead[cell] = q + on.scale(carry);
                shear[cell] = q;
            }
            outcome.iterations += 1;
            outcome.residual = (change / bound).sqrt();
            if outcome.residual <= tolerance || outcome.iterations == ITERATIONS {
                return outcome;
            }
            momentum = next;
            if uphill > 0.0 {
                momentum = 1.0;
                for &cell in &self.contact {
                    self.ahead[cell] = shear[cell];
                }
            }
        }
    }
}
