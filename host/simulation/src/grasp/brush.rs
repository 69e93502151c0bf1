//! Both contacts as brushes: every cell of the gel is a spring of its own, which sticks or slips by Coulomb's law (Winkler's
//! foundation; Johnson 1985, section 4.3, and Kalker 1973 for rolling). It has what a layer has, partial slip, torsion, load history,
//! texture, but no influence of cell on cell, and takes a few percent of the time. Units: mm, rad, N, N·mm, MPa, in finger 0's frame.
//! Limits: pressure straight down; the springs' stiffness is that of a half-space under a disc as large as the contact, so a contact's
//! size and partial slip differ from the layer's by some percent, what friction holds as a whole does not.

use std::sync::Arc;

use super::rigid_body::{Actions, RigidBody};
use super::solver::{Ending, Outcome, free, seen};
use crate::contact_world::{
    HeightMap, Matrix, Pair, Pose, Texture, Triple, Truth, WALL_MM, add, dot, solved, sub,
};
use crate::error::SimulationError;
use crate::gel::Gel;

/// Unbalanced force at which a step counts as balanced, share of what friction holds.
const BALANCE_TOLERANCE: f64 = 1e-5;
/// Trials for one balance at most.
const TRIALS: usize = 80;
/// Share of a spring's stiffness that a slipping cell counts with, so that the balance is always solvable.
const SLIPPING_STIFFNESS: f64 = 1e-3;
/// Longest shift and turn from one trial to the next, mm and rad.
const TRIAL_REACH: [f64; 2] = [0.5, 0.15];
/// Radius of the contact that the normal stiffness is chosen for, mm.
const TYPICAL_RADIUS_MM: f64 = 3.5;
/// Steps of the search for a depth at most; it ends when no cell comes or goes.
const DEPTH_STEPS: usize = 60;
/// An object that moves less than this in a step stands still, mm.
const STILL_MM: f64 = 1e-5;

/// One finger's brush.
#[derive(Debug)]
struct Brush {
    indenter: Arc<dyn HeightMap>,
    texture: Option<Texture>,
    friction: f64,
    mean_share: f64,
    turn_rad: f64,
    slip_mm: Triple,
    truth: Truth,
}

/// A step of a brush: what is pressed, and the shear found so far.
#[derive(Debug, Clone)]
struct BrushStep {
    depth_mm: f64,
    stiffness: f64,
    cells: Vec<BrushCell>,
}

#[derive(Debug, Clone, Copy)]
struct BrushCell {
    place: usize,
    arm: Pair,
    pressure: f64,
    limit: f64,
    before: Pair,
    shear: Pair,
    slips: bool,
}

impl Brush {
    fn place_mm(&self, place: usize) -> [f64; 2] {
        let cells = self.truth.cells();
        let half = 0.5 * cells as f64;
        [place % cells, place / cells].map(|k| (k as f64 + 0.5 - half) * self.truth.pitch_mm())
    }

    /// Presses where it stands. The pad ends with the grid: what lies beyond its edge touches nothing.
    ///
    /// # Errors
    /// None of the object lies over the pad.
    fn begin(&self, grip_n: f64, gel: &Gel) -> Result<BrushStep, SimulationError> {
        let cells = self.truth.cells();
        let cell_mm2 = self.truth.pitch_mm() * self.truth.pitch_mm();
        let (sin, cos) = libm::sincos(self.turn_rad);
        let [x0, y0] = self.truth.footprint_mm;
        let of_indenter = |place: usize| {
            let [x, y] = self.place_mm(place);
            let (x, y) = (x - x0, y - y0);
            ([cos * x + sin * y, cos * y - sin * x], Pair::new(-y, x))
        };
        let heights: Vec<f64> = (0..cells * cells)
            .map(|place| self.indenter.height_mm(of_indenter(place).0))
            .collect();
        let normal = 16.0 * gel.contact_modulus_mpa() / (3.0 * std::f64::consts::PI * TYPICAL_RADIUS_MM);
        let depth_mm = depth_of(grip_n / (normal * cell_mm2), &heights);
        if depth_mm >= WALL_MM {
            return Err(SimulationError::OffSurface { x_mm: x0, y_mm: y0 });
        }
        let places = (0..cells * cells).filter(|&place| heights[place] < depth_mm);
        let mut step = BrushStep {
            depth_mm,
            stiffness: 0.0,
            cells: Vec::new(),
        };
        for place in places {
            let (at, arm) = of_indenter(place);
            let pressure = normal * (depth_mm - heights[place]);
            let share = self.texture.map_or(1.0, |texture| texture.at(at));
            let before = self.truth.shear[place];
            step.cells.push(BrushCell {
                place,
                arm,
                pressure,
                limit: self.friction * share * pressure,
                before,
                shear: before,
                slips: false,
            });
        }
        let radius_mm = (step.cells.len() as f64 * cell_mm2 / std::f64::consts::PI).sqrt();
        step.stiffness = 2.0 * gel.tangential_modulus_mpa() / (std::f64::consts::PI * radius_mm.max(0.5));
        Ok(step)
    }

    /// Brings the shear to a motion from where the step began.
    fn shear(step: &mut BrushStep, [x, y, turn]: Triple) {
        let stiffness = step.stiffness;
        for cell in &mut step.cells {
            let trial = cell.before + (Pair::new(x, y) + cell.arm.scale(turn)).scale(stiffness);
            let size = trial.norm();
            cell.slips = size > cell.limit;
            cell.shear = if cell.slips {
                trial.scale(cell.limit / size)
            } else {
                trial
            };
        }
    }

    /// Force and moment about the footprint that the shear carries, and how they grow with the motion.
    fn carried(&self, step: &BrushStep) -> (Triple, Matrix) {
        let cell_mm2 = self.truth.pitch_mm() * self.truth.pitch_mm();
        let (mut sum, mut growth) = ([0.0; 3], [[0.0; 3]; 3]);
        for cell in &step.cells {
            let (arm, q) = (cell.arm, cell.shear);
            sum = add(sum, [q.re, q.im, (arm.conj() * q).re].map(|v| v * cell_mm2));
            let share = if cell.slips { SLIPPING_STIFFNESS } else { 1.0 };
            let k = step.stiffness * cell_mm2 * share;
            growth[0][0] += k;
            growth[1][1] += k;
            growth[0][2] += k * arm.re;
            growth[1][2] += k * arm.im;
            growth[2][2] += k * arm.norm_sqr();
        }
        growth[2][0] = growth[0][2];
        growth[2][1] = growth[1][2];
        (sum, growth)
    }

    fn lift_off(&mut self, [x, y, turn_rad]: Triple) {
        let pose = Pose {
            at_mm: [x, y],
            turn_rad,
            ..Pose::default()
        };
        self.truth = Truth::free(self.truth.cells(), pose);
        self.turn_rad = turn_rad;
        self.slip_mm = [0.0; 3];
    }

    /// Takes a step over that ended at a pose after this motion.
    fn accept(&mut self, step: &BrushStep, pose: Triple, motion: Triple) {
        if step.cells.is_empty() {
            self.lift_off(pose);
            return;
        }
        let truth = &mut self.truth;
        truth.pressure.fill(0.0);
        truth.shear.fill(Pair::default());
        let mut shares = vec![1.0; truth.pressure.len()];
        let (mut weight, mut slip, mut mean_arm, mut touched) = (0.0, Pair::default(), Pair::default(), 0.0);
        let asked = |cell: &BrushCell| Pair::new(motion[0], motion[1]) + cell.arm.scale(motion[2]);
        let slid = |cell: &BrushCell| asked(cell) - (cell.shear - cell.before).unscale(step.stiffness);
        let (mut followed, mut moved) = (0.0, 0.0);
        for cell in &step.cells {
            truth.pressure[cell.place] = cell.pressure;
            truth.shear[cell.place] = cell.shear;
            shares[cell.place] = cell.limit / (self.friction * cell.pressure).max(1e-12);
            weight += cell.pressure;
            touched += cell.pressure * shares[cell.place];
            slip += slid(cell).scale(cell.pressure);
            mean_arm += cell.arm.scale(cell.pressure);
            let wanted = asked(cell);
            followed += cell.pressure * (wanted.conj() * (wanted - slid(cell))).re;
            moved += cell.pressure * wanted.norm_sqr();
        }
        slip = slip.unscale(weight);
        mean_arm = mean_arm.unscale(weight);
        let (mut spin, mut inertia) = (0.0, 0.0);
        for cell in &step.cells {
            let arm = cell.arm - mean_arm;
            spin += cell.pressure * (arm.conj() * (slid(cell) - slip)).re;
            inertia += cell.pressure * arm.norm_sqr();
        }
        let turned = if inertia > 0.0 { spin / inertia } else { 0.0 };
        self.slip_mm = [slip.re, slip.im, turned * (inertia / weight).sqrt()];
        self.mean_share = touched / weight;
        // The footprint's origin is the middle of the turn.
        let shift = slip - mean_arm.scale(turned);
        truth.footprint_mm[0] += shift.re;
        truth.footprint_mm[1] += shift.im;
        self.turn_rad += turned;
        truth.slip_distance_mm += slip.norm();
        truth.pose = Pose {
            at_mm: [pose[0], pose[1]],
            depth_mm: step.depth_mm,
            turn_rad: pose[2],
            ..Pose::default()
        };
        let follows = (moved > STILL_MM * STILL_MM * weight).then(|| followed / moved);
        let friction = self.friction;
        truth.classify(|place| friction * shares[place], follows);
    }
}

/// Depth at which springs of stiffness 1 over these heights carry `volume`.
fn depth_of(volume: f64, heights: &[f64]) -> f64 {
    let mut depth = heights.iter().copied().fold(f64::INFINITY, f64::min) + volume;
    for _ in 0..DEPTH_STEPS {
        let (mut sum, mut count) = (0.0, 0.0);
        for height in heights.iter().filter(|height| **height < depth) {
            sum += height;
            count += 1.0;
        }
        // From above: fewer cells carry more each.
        let next = (volume + sum) / count;
        if (next - depth).abs() < 1e-12 {
            break;
        }
        depth = next;
    }
    depth
}

/// Both fingers' brushes.
#[derive(Debug)]
pub(crate) struct BrushSolver {
    brushes: [Brush; 2],
    gel: Gel,
    patch_turn_rad: f64,
}

impl BrushSolver {
    /// Fingers with these patches, frictions and textures, on a gel of `cells` by `cells`.
    pub(crate) fn new(
        gel: Gel,
        cells: usize,
        fingers: [(Arc<dyn HeightMap>, f64, Option<Texture>); 2],
        patch_turn_rad: f64,
    ) -> Self {
        let brushes = fingers.map(|(indenter, friction, texture)| Brush {
            indenter,
            texture,
            friction,
            mean_share: 1.0,
            turn_rad: 0.0,
            slip_mm: [0.0; 3],
            truth: Truth::free(cells, Pose::default()),
        });
        Self {
            brushes,
            gel,
            patch_turn_rad,
        }
    }

    pub(crate) fn truth(&self, finger: usize) -> &Truth {
        &self.brushes[finger].truth
    }

    pub(crate) fn slip_mm(&self, finger: usize) -> Triple {
        self.brushes[finger].slip_mm
    }

    pub(crate) fn mean_share(&self, finger: usize) -> f64 {
        self.brushes[finger].mean_share
    }

    pub(crate) fn set_friction(&mut self, friction: [f64; 2]) {
        for (brush, friction) in self.brushes.iter_mut().zip(friction) {
            brush.friction = friction;
        }
    }

    pub(crate) fn friction_n(&self, grip_n: f64) -> f64 {
        self.brushes.iter().map(|brush| brush.friction * grip_n).sum()
    }

    fn of_finger(&self, finger: usize, [x, y, turn]: Triple) -> Triple {
        seen(finger, [x, y, turn + self.patch_turn_rad])
    }

    /// Takes the fingers away; the object is at `pose`.
    pub(crate) fn open(&mut self, pose: Triple) {
        for finger in 0..2 {
            let at = self.of_finger(finger, pose);
            self.brushes[finger].lift_off(at);
        }
    }

    fn begin(&mut self, grip_n: f64, pose: Triple) -> Result<Option<[BrushStep; 2]>, SimulationError> {
        if grip_n < 1e-6 {
            return Ok(None);
        }
        if !self.brushes[0].truth.in_contact() {
            self.open(pose);
        }
        let [one, other] = &self.brushes;
        Ok(Some([
            one.begin(grip_n, &self.gel)?,
            other.begin(grip_n, &self.gel)?,
        ]))
    }

    /// Shear of both on the object's motion, and its growth, as the object feels them.
    fn carried(&self, steps: &mut [BrushStep; 2], motion: Triple) -> (Triple, Matrix) {
        let (mut total, mut growth) = ([0.0; 3], [[0.0; 3]; 3]);
        for (finger, (brush, step)) in self.brushes.iter().zip(steps).enumerate() {
            Brush::shear(step, seen(finger, motion));
            let (sum, grown) = brush.carried(step);
            total = add(total, seen(finger, sum));
            let mirror = seen(finger, [1.0; 3]);
            for (i, row) in growth.iter_mut().enumerate() {
                for (j, value) in row.iter_mut().enumerate() {
                    *value += grown[i][j] * mirror[i] * mirror[j];
                }
            }
        }
        (total, growth)
    }

    fn accept(&mut self, steps: &[BrushStep; 2], pose: Triple, motion: Triple) {
        for (finger, step) in steps.iter().enumerate() {
            let at = self.of_finger(finger, pose);
            self.brushes[finger].accept(step, at, seen(finger, motion));
        }
    }

    /// The object stays at `pose` while the fingers press with `grip_n`.
    ///
    /// # Errors
    /// None of the object lies over the pad.
    pub(crate) fn press(&mut self, grip_n: f64, pose: Triple) -> Result<Outcome, SimulationError> {
        let steps = self.begin(grip_n, pose)?;
        let touching = steps.is_some();
        match steps {
            Some(mut steps) => {
                let _ = self.carried(&mut steps, [0.0; 3]);
                self.accept(&steps, pose, [0.0; 3]);
            }
            None => self.open(pose),
        }
        Ok(Outcome {
            pose,
            balance: 0.0,
            solves: 2,
            touching,
        })
    }

    /// As [`GraspSolver::advance`](super::solver::GraspSolver::advance).
    ///
    /// # Errors
    /// None of the object lies over the pad, or no balance; nothing has changed then.
    pub(crate) fn advance(
        &mut self,
        grip_n: f64,
        body: &RigidBody,
        actions: &Actions,
        reach_mm: f64,
    ) -> Result<Ending, SimulationError> {
        let from = body.pose;
        let Some(mut steps) = self.begin(grip_n, from)? else {
            let outcome = free(body, actions);
            self.open(outcome.pose);
            return Ok(Ending::Balanced(outcome));
        };
        let cell_mm2 = self.brushes[0].truth.pitch_mm().powi(2);
        let radius = (steps[0].cells.len() as f64 * cell_mm2 / std::f64::consts::PI).sqrt();
        let weigh = |v: Triple| libm::hypot(v[0], v[1]).max(v[2].abs() / radius);
        let scale = self.friction_n(grip_n);
        let mut pose = from;
        let mut carried = self.carried(&mut steps, [0.0; 3]);
        let mut found = f64::INFINITY;
        let mut solves = 2;
        for _ in 0..TRIALS {
            let (inertia, growth) = body.resistance(actions, pose);
            let unbalanced = add(inertia, carried.0);
            found = weigh(unbalanced) / scale;
            if found <= BALANCE_TOLERANCE {
                break;
            }
            let both: Matrix = std::array::from_fn(|i| add(growth[i], carried.1[i]));
            let direction = limited(solved(&both, unbalanced.map(|v| -v)));
            let slope = dot(unbalanced, direction);
            let mut share = 1.0;
            loop {
                let there = add(pose, direction.map(|v| v * share));
                let next = self.carried(&mut steps, sub(there, from));
                solves += 2;
                let slope_there = dot(add(body.resistance(actions, there).0, next.0), direction);
                // Convex: beyond the minimum along the direction the slope has changed its sign.
                if slope_there <= -0.5 * slope || share < 1e-3 {
                    (pose, carried) = (there, next);
                    break;
                }
                share *= (slope / (slope - slope_there)).clamp(0.05, 0.6);
            }
            let travel =
                libm::hypot(pose[0] - from[0], pose[1] - from[1]).max((pose[2] - from[2]).abs() * radius);
            if travel > 2.0 * reach_mm {
                return Ok(Ending::TooFar);
            }
        }
        if found > 100.0 * BALANCE_TOLERANCE {
            return Err(SimulationError::NoConvergence {
                found,
                expected: BALANCE_TOLERANCE,
                iterations: TRIALS,
            });
        }
        let motion = sub(pose, from);
        if libm::hypot(motion[0], motion[1]).max(motion[2].abs() * radius) > reach_mm {
            return Ok(Ending::TooFar);
        }
        self.accept(&steps, pose, motion);
        Ok(Ending::Balanced(Outcome {
            pose,
            balance: found,
            solves,
            touching: true,
        }))
    }
}

/// A step cut to one trial's reach.
fn limited(step: Triple) -> Triple {
    let far = (libm::hypot(step[0], step[1]) / TRIAL_REACH[0]).max(step[2].abs() / TRIAL_REACH[1]);
    if far > 1.0 { step.map(|v| v / far) } else { step }
}
