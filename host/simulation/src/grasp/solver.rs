//! Both contacts and the object between them in one implicit step: the object goes where its resistance and the
//! gels' shear balance. That is the minimum of a convex function of three unknowns (x, y, turn) whose slope
//! is the unbalanced force; a quasi-Newton method (BFGS for the contacts' stiffness, the body's is known) finds it,
//! each trial a shear solve that starts from the last. Units: mm, rad, N, N·mm, in finger 0's frame.

use super::rigid_body::{Actions, RigidBody};
use crate::contact_world::{Contact, Press, Step, Stiffness, Triple, Truth, add, dot, solved, sub};
use crate::error::SimulationError;

/// Unbalanced force at which a step counts as balanced, share of [`Outcome::balance`]'s scale; a tenth of a
/// percent is promised.
const BALANCE_TOLERANCE: f64 = 5e-4;
/// Smallest load that residuals are compared with, share of what friction can hold.
const MIN_LOAD: f64 = 0.05;
/// What is accepted where shear solves are too coarse for better.
const BALANCE_BOUND: f64 = 1e-3;
/// Residual at which shear solves stop when the load is half of what friction holds or more; a smaller load needs
/// a better one, down to a twentieth.
const SHEAR_TOLERANCE: f64 = 3e-5;
/// Growth of shear from which the stiffness is updated, in shear residuals: less is noise.
const MIN_GROWTH: f64 = 40.0;
/// Trials for one balance at most; two or three are usual.
const TRIALS: usize = 60;
/// Trials after which the bound is enough.
const PATIENCE: usize = 10;
/// Rounds between pressures and balance at most.
const ROUNDS: usize = 40;

/// The fingers' contacts.
#[derive(Debug)]
pub(crate) struct GraspSolver {
    /// One per finger; one alone if both are mirror images of each other for good.
    contacts: Vec<Contact>,
    patch_turn_rad: f64,
    /// How the gels' shear grows with the object's motion, all fingers together.
    stiffness: Stiffness,
}

/// A balanced step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outcome {
    pub(crate) pose: Triple,
    /// Largest unbalanced force, or moment over the contact's radius, against the largest load or a twentieth of
    /// what friction holds.
    pub(crate) balance: f64,
    pub(crate) solves: usize,
    pub(crate) touching: bool,
}

/// How a step ended.
#[derive(Debug)]
pub(crate) enum Ending {
    Balanced(Outcome),
    /// The object would go farther in this step than was allowed; nothing has changed.
    TooFar,
}

/// Finger 1 looks at finger 0: its x points the other way and it turns the other way.
const MIRROR: Triple = [-1.0, 1.0, -1.0];

pub(super) fn seen(finger: usize, v: Triple) -> Triple {
    if finger == 0 {
        v
    } else {
        [v[0] * MIRROR[0], v[1] * MIRROR[1], v[2] * MIRROR[2]]
    }
}

impl GraspSolver {
    pub(crate) fn new(contacts: Vec<Contact>, patch_turn_rad: f64) -> Self {
        Self {
            contacts,
            patch_turn_rad,
            stiffness: Stiffness::default(),
        }
    }

    pub(crate) fn vertical_pressure(mut self) -> Self {
        self.contacts = self
            .contacts
            .into_iter()
            .map(Contact::vertical_pressure)
            .collect();
        self
    }

    /// The contact that stands for `finger`, and whether it is its mirror image.
    pub(crate) fn contact(&self, finger: usize) -> (&Contact, bool) {
        self.contacts
            .get(finger)
            .map_or((&self.contacts[0], true), |contact| (contact, false))
    }

    pub(crate) fn truth(&self, finger: usize) -> Truth {
        let (contact, mirrored) = self.contact(finger);
        if mirrored {
            contact.truth().mirrored()
        } else {
            contact.truth().clone()
        }
    }

    /// Friction of every finger from the next step on.
    pub(crate) fn set_friction(&mut self, friction: [f64; 2]) {
        for (contact, friction) in self.contacts.iter_mut().zip(friction) {
            contact.set_friction(friction);
        }
    }

    /// How many fingers each contact stands for.
    fn share(&self) -> f64 {
        2.0 / self.contacts.len() as f64
    }

    /// What all fingers' friction can hold, N.
    pub(crate) fn friction_n(&self, grip_n: f64) -> f64 {
        self.contacts.iter().map(Contact::friction).sum::<f64>() * grip_n * self.share()
    }

    /// Takes the fingers away; the object is at `pose`.
    pub(crate) fn open(&mut self, pose: Triple) {
        self.begin(0.0, pose);
        self.stiffness.reset();
    }

    fn begin(&mut self, grip_n: f64, pose: Triple) -> Vec<Step> {
        let turn = pose[2] + self.patch_turn_rad;
        let mut steps = Vec::with_capacity(self.contacts.len());
        for (finger, contact) in self.contacts.iter_mut().enumerate() {
            let [x, y, turn] = seen(finger, [pose[0], pose[1], turn]);
            steps.extend(contact.begin(Press::Force(grip_n), [0.0; 2], [x, y], turn));
        }
        steps
    }

    /// The object stays at `pose` while the fingers press with `grip_n`.
    ///
    /// # Errors
    /// Those of the contacts.
    pub(crate) fn press(&mut self, grip_n: f64, pose: Triple) -> Result<Outcome, SimulationError> {
        let mut steps = self.begin(grip_n, pose);
        let mut solves = 0;
        let turn = pose[2] + self.patch_turn_rad;
        for (finger, (contact, step)) in self.contacts.iter_mut().zip(&mut steps).enumerate() {
            let [x, y, turn] = seen(finger, [pose[0], pose[1], turn]);
            loop {
                while !contact.press(step)? {
                    contact.shear(step, [0.0; 3], SHEAR_TOLERANCE);
                    solves += 1;
                }
                if contact.fits(step, [x, y], turn)? {
                    break;
                }
            }
        }
        let touching = !steps.is_empty();
        if touching {
            self.measure(&steps);
        } else {
            self.stiffness.reset();
        }
        self.accept(&steps, pose);
        Ok(Outcome {
            pose,
            balance: 0.0,
            solves,
            touching,
        })
    }

    /// One step of `rigid_body` under `actions` with the fingers pressing with `grip_n`. `reach_mm` limits how far the
    /// object may move. On an error nothing has changed.
    ///
    /// # Errors
    /// Those of the contacts, or no balance.
    pub(crate) fn advance(
        &mut self,
        grip_n: f64,
        body: &RigidBody,
        actions: &Actions,
        reach_mm: f64,
    ) -> Result<Ending, SimulationError> {
        let from = body.pose;
        let mut steps = self.begin(grip_n, from);
        if steps.is_empty() {
            self.stiffness.reset();
            return Ok(Ending::Balanced(free(body, actions)));
        }
        let mut pose = from;
        let mut solves = 0;
        let mut balance = f64::INFINITY;
        let mut first = true;
        for _ in 0..ROUNDS {
            let mut settled = true;
            for (contact, step) in self.contacts.iter_mut().zip(&mut steps) {
                settled &= contact.press(step)?;
            }
            if settled {
                let mut fits = true;
                let turn = pose[2] + self.patch_turn_rad;
                for (finger, (contact, step)) in self.contacts.iter_mut().zip(&mut steps).enumerate() {
                    let [x, y, turn] = seen(finger, [pose[0], pose[1], turn]);
                    fits &= contact.fits(step, [x, y], turn)?;
                }
                if fits {
                    self.accept(&steps, pose);
                    return Ok(Ending::Balanced(Outcome {
                        pose,
                        balance,
                        solves,
                        touching: true,
                    }));
                }
                continue;
            }
            if first {
                self.measure(&steps);
                // Where the stiffness known so far expects the balance.
                let (unbalanced, growth) = body.resistance(actions, pose);
                let unbalanced = add(unbalanced, self.carried(&steps));
                pose = add(pose, self.stiffness.newton_step(&growth, unbalanced));
                first = false;
            }
            balance = self.balance(&mut steps, body, actions, grip_n, &mut pose, &mut solves)?;
            let travel = libm::hypot(pose[0] - from[0], pose[1] - from[1])
                .max((pose[2] - from[2]).abs() * self.stiffness.radius_mm());
            if travel > reach_mm {
                return Ok(Ending::TooFar);
            }
        }
        Err(SimulationError::NoConvergence {
            found: balance,
            expected: BALANCE_TOLERANCE,
            iterations: ROUNDS,
        })
    }

    /// Moves `pose` until the object is in balance, the pressures as they are.
    fn balance(
        &mut self,
        steps: &mut [Step],
        body: &RigidBody,
        actions: &Actions,
        grip_n: f64,
        pose: &mut Triple,
        solves: &mut usize,
    ) -> Result<f64, SimulationError> {
        let from = body.pose;
        let radius = self.stiffness.radius_mm();
        let weigh = |v: Triple| libm::hypot(v[0], v[1]).max(v[2].abs() / radius);
        let friction_n = self.friction_n(grip_n);
        let load = weigh(body.load(actions, *pose)).max(MIN_LOAD * friction_n);
        let tolerance = SHEAR_TOLERANCE * (2.0 * load / friction_n).clamp(MIN_LOAD, 1.0);
        let mut surfaces = self.shear(steps, from, *pose, tolerance);
        *solves += steps.len();
        let mut found = f64::INFINITY;
        for trial in 0..TRIALS {
            let (inertia, growth) = body.resistance(actions, *pose);
            let unbalanced = add(inertia, surfaces);
            found = weigh(unbalanced) / load;
            if found <= BALANCE_TOLERANCE || (trial > PATIENCE && found <= BALANCE_BOUND) {
                return Ok(found);
            }
            let direction = self.stiffness.newton_step(&growth, unbalanced);
            let slope = dot(unbalanced, direction);
            let mut share = 1.0;
            loop {
                let step = direction.map(|v| v * share);
                let there = add(*pose, step);
                let carried = self.shear(steps, from, there, tolerance);
                *solves += steps.len();
                if weigh(self.stiffness.growth(step)) > MIN_GROWTH * tolerance * friction_n {
                    self.stiffness.update(step, sub(carried, surfaces));
                }
                let slope_there = dot(add(body.resistance(actions, there).0, carried), direction);
                // Convex: beyond the minimum along the direction the slope has changed its sign.
                if slope_there <= -0.9 * slope || share < 1e-3 {
                    (*pose, surfaces) = (there, carried);
                    break;
                }
                share *= (slope / (slope - slope_there)).clamp(0.05, 0.6);
            }
        }
        Err(SimulationError::NoConvergence {
            found,
            expected: BALANCE_TOLERANCE,
            iterations: TRIALS,
        })
    }

    /// Shear of all gels on the object's way from `from` to `to`.
    fn shear(&mut self, steps: &mut [Step], from: Triple, to: Triple, tolerance: f64) -> Triple {
        for (finger, (contact, step)) in self.contacts.iter_mut().zip(steps.iter_mut()).enumerate() {
            contact.shear(step, seen(finger, sub(to, from)), tolerance);
        }
        self.carried(steps)
    }

    fn carried(&self, steps: &[Step]) -> Triple {
        let mut total = [0.0; 3];
        for (finger, (contact, step)) in self.contacts.iter().zip(steps).enumerate() {
            total = add(total, seen(finger, contact.carried(step)));
        }
        if self.contacts.len() == 1 {
            // Seen from finger 0 its mirror image carries the same.
            total = total.map(|v| 2.0 * v);
        }
        total
    }

    fn accept(&mut self, steps: &[Step], pose: Triple) {
        let turn = pose[2] + self.patch_turn_rad;
        for (finger, (contact, step)) in self.contacts.iter_mut().zip(steps).enumerate() {
            let [x, y, turn] = seen(finger, [pose[0], pose[1], turn]);
            contact.accept(step, [x, y], turn);
        }
    }

    /// Keeps the stiffness in step with the contact's size.
    fn measure(&mut self, steps: &[Step]) {
        let contact = &self.contacts[0];
        let area = contact.touched_mm2(&steps[0]);
        self.stiffness.measure(area, contact.gel(), 2.0);
    }
}

/// The object where nothing touches it.
pub(super) fn free(body: &RigidBody, actions: &Actions) -> Outcome {
    let mut pose = body.pose;
    for _ in 0..20 {
        let (unbalanced, growth) = body.resistance(actions, pose);
        let step = solved(&growth, unbalanced.map(|v| -v));
        pose = add(pose, step);
        if step.iter().all(|v| v.abs() < 1e-9) {
            break;
        }
    }
    Outcome {
        pose,
        balance: 0.0,
        solves: 0,
        touching: false,
    }
}
