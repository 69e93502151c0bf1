//! The grasp at work: gripper, arm, pulls and gravity act on the object between two fingertips, step by step. Units:
//! mm, N, N·mm, s, rad. Limits: a frame is at most 0.1 s; it is cut into shorter steps while the grip closes,
//! loads jump or the object slides, and is one step while it holds.

use std::sync::Arc;

use super::fingers::Fingers;
use super::frame::{FingerTruth, GraspFrame, ObjectState};
use super::gripper::GripperState;
use super::rigid_body::{Actions, RigidBody};
use super::setting::GraspScene;
use super::solver::Ending;
use crate::constants::{GRAVITY_MM_PER_S2, SLIP_SPEED_MM_PER_S, TAXEL_COUNT};
use crate::contact_world::{GelSurface, Triple, Truth, add};
use crate::error::{SimulationError, checked};
use crate::field::LayerKernels;
use crate::fingertip::{Fingertip, FingertipParams};
use crate::image::Image;

/// Shares of a frame that a step may take.
const CUTS: [f64; 8] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0];
/// Largest change of the grip in a step: share of the grip, or newtons if that is more. A press in eight steps is
/// within 1 % of one in many.
const GRIP_STEP: [f64; 2] = [0.2, 0.25];
/// Largest change of the load in a step, share of what friction holds.
const LOAD_STEP: f64 = 0.25;
/// Longest travel of the object in a step, cells.
const REACH_CELLS: f64 = 0.6;

/// What worlds of the same gel and grid may share: it takes longer to make than a world.
#[derive(Debug, Clone)]
pub struct GraspParts {
    surface: Arc<GelSurface>,
    kernels: Arc<LayerKernels>,
}

impl GraspParts {
    /// Parts for scenes with this scene's gel and grid.
    ///
    /// # Errors
    /// A gel constant outside its range, or a grid that the gel refuses.
    pub fn new(scene: &GraspScene) -> Result<Self, SimulationError> {
        let gel = scene.fingertips[0].gel;
        gel.check()?;
        Ok(Self {
            surface: Arc::new(GelSurface::new(&gel, scene.cells)?),
            kernels: Arc::new(LayerKernels::new(&gel)),
        })
    }

    /// A fingertip with this gel.
    pub(crate) fn fingertip(&self, seed: u64, params: FingertipParams) -> Result<Fingertip, SimulationError> {
        Fingertip::with_kernels(seed, params, Arc::clone(&self.kernels))
    }
}

/// A grasp at work. The same scene and the same lines give the same frames, bit for bit.
#[derive(Debug)]
pub struct GraspWorld {
    scene: GraspScene,
    parts: GraspParts,
    /// Made when first looked at.
    fingertips: [Option<Box<Fingertip>>; 2],
    gripper: GripperState,
    solver: Fingers,
    body: RigidBody,
    /// Load of the last step, to tell jumps.
    load: Triple,
    time_s: f64,
    touching: bool,
    /// Speed of the object over each gel in the last step.
    slide_mm_per_s: [f64; 2],
    /// Distance that the object slid over each gel since it was touched.
    slip_mm: [f64; 2],
    /// How far it is from where it was touched: along x and y of each gel, and the spin at the contact's radius of gyration.
    away_mm: [Triple; 2],
    dropped: bool,
    truths: [Truth; 2],
    frame: GraspFrame,
}

impl GraspWorld {
    /// The scene at its start, nothing gripped.
    ///
    /// # Errors
    /// A number outside its range, named.
    pub fn new(scene: &GraspScene) -> Result<Self, SimulationError> {
        Self::with_parts(scene, &GraspParts::new(scene)?)
    }

    /// As [`Self::new`], with parts that were made for a scene of the same gel and grid.
    ///
    /// # Errors
    /// A number outside its range, named.
    pub fn with_parts(scene: &GraspScene, parts: &GraspParts) -> Result<Self, SimulationError> {
        scene.check()?;
        checked(
            "cells of the parts' gel surface",
            parts.surface.cells() as f64,
            "the scene's cells",
            |_| parts.surface.cells() == scene.cells,
        )?;
        let mut solver = Fingers::new(scene, &parts.surface)?;
        let [x, y] = scene.grip_point_mm;
        let pose = [x, y, scene.turn_rad];
        solver.open(pose);
        let mut body = RigidBody::new(
            &scene.object,
            pose,
            scene.table,
            down(scene.gravity_turn_rad.at(0.0)),
        );
        body.set_mass(&scene.object, scene.mass_share.at(0.0));
        let truths = [solver.truth(0), solver.truth(1)];
        let fingers =
            [0, 1].map(|finger| finger_truth(&truths[finger], 0.0, 0.0, friction_of(scene, finger, 0.0)));
        let frame = GraspFrame {
            time_s: 0.0,
            phase: scene.phase(0.0),
            line_n: 0.0,
            grip_n: 0.0,
            fingers,
            object: ObjectState {
                at_mm: [x, y],
                turn_rad: scene.turn_rad,
                ..ObjectState::default()
            },
            load: [0.0; 3],
            slip: false,
            slid_s: None,
            on_table: body.on_table(),
            dropped: false,
            balance: 0.0,
            steps: 0,
            solves: 0,
        };
        Ok(Self {
            scene: scene.clone(),
            parts: parts.clone(),
            fingertips: [None, None],
            gripper: GripperState::new(scene.gripper),
            solver,
            body,
            load: [0.0; 3],
            time_s: 0.0,
            touching: false,
            slide_mm_per_s: [0.0; 2],
            slip_mm: [0.0; 2],
            away_mm: [[0.0; 3]; 2],
            dropped: false,
            truths,
            frame,
        })
    }

    /// The same with pressure straight down whatever the patch's slope, as closed forms have it:
    /// `Contact::vertical_pressure`.
    #[must_use]
    pub fn vertical_pressure(mut self) -> Self {
        self.solver = self.solver.vertical_pressure();
        self
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &GraspScene {
        &self.scene
    }

    /// The last frame.
    #[must_use]
    pub fn frame(&self) -> &GraspFrame {
        &self.frame
    }

    /// The contact of a finger: tractions, stick and slip cell by cell, residuals.
    ///
    /// # Panics
    /// When `finger` is not 0 or 1.
    #[must_use]
    pub fn truth(&self, finger: usize) -> &Truth {
        &self.truths[finger]
    }

    /// Advances by `dt_s` with the grip-force line at `line_n`; takes no picture.
    ///
    /// # Errors
    /// A step outside 0 to 0.1 s, a line that is negative or not finite, a contact that does not converge: the
    /// grasp is then no evidence.
    pub fn step(&mut self, dt_s: f64, line_n: f64) -> Result<&GraspFrame, SimulationError> {
        checked("dt_s", dt_s, "above 0, at most 0.1 s", |dt| dt > 0.0 && dt <= 0.1)?;
        checked("line_n", line_n, "a finite number, 0 or above", |line| {
            line >= 0.0
        })?;
        self.gripper.set_line(self.time_s, line_n);
        let end_s = self.time_s + dt_s;
        let mut tally = Tally::default();
        let mut done = 0.0;
        while done < 1.0 {
            done += self.part(dt_s, done, &mut tally)?;
        }
        self.time_s = end_s;
        self.make_frame(dt_s, line_n, &tally);
        Ok(&self.frame)
    }

    /// The camera's crop of a finger now, 440 x 440, with fresh noise.
    ///
    /// # Errors
    /// Parameters that a fingertip refuses; only the first picture of a finger may find any.
    ///
    /// # Panics
    /// When `finger` is not 0 or 1.
    pub fn render(&mut self, finger: usize, out: &mut Image) -> Result<(), SimulationError> {
        let tip = fingertip(&mut self.fingertips[finger], &self.scene, &self.parts, finger)?;
        tip.set_time(self.time_s);
        tip.render(&self.truths[finger], out);
        Ok(())
    }

    /// As [`Self::render`], the whole 640 x 480 frame.
    ///
    /// # Errors
    /// As [`Self::render`].
    ///
    /// # Panics
    /// When `finger` is not 0 or 1.
    pub fn render_frame(&mut self, finger: usize, out: &mut Image) -> Result<(), SimulationError> {
        let tip = fingertip(&mut self.fingertips[finger], &self.scene, &self.parts, finger)?;
        tip.set_time(self.time_s);
        tip.render_frame(&self.truths[finger], out);
        Ok(())
    }

    /// The camera's crop of a finger that nothing touches, with fresh noise.
    ///
    /// # Errors
    /// As [`Self::render`].
    ///
    /// # Panics
    /// When `finger` is not 0 or 1.
    pub fn rest_image(&mut self, finger: usize) -> Result<Image, SimulationError> {
        let tip = fingertip(&mut self.fingertips[finger], &self.scene, &self.parts, finger)?;
        Ok(tip.rest_image())
    }

    /// The fingertip of a finger, for its light and its other pictures.
    ///
    /// # Errors
    /// As [`Self::render`].
    ///
    /// # Panics
    /// When `finger` is not 0 or 1.
    pub fn fingertip(&mut self, finger: usize) -> Result<&mut Fingertip, SimulationError> {
        fingertip(&mut self.fingertips[finger], &self.scene, &self.parts, finger)
    }

    /// What acts from `from_s` for `step_s`: means over the step, so that no impulse is lost.
    fn actions(&self, from_s: f64, step_s: f64) -> Actions {
        let to_s = from_s + step_s;
        let scene = &self.scene;
        let gravity = down(scene.gravity_turn_rad.mean(from_s, to_s));
        let [before, after] = [from_s, to_s].map(|time| scene.arm.velocity_mm_per_s(time));
        let mut torsional_moment_nmm = 0.0;
        let mut forces = Vec::with_capacity(scene.pulls.len());
        for pull in &scene.pulls {
            let share = pull.course.mean(from_s, to_s);
            torsional_moment_nmm += pull.torsional_moment_nmm * share;
            forces.push((pull.at_mm, pull.force_n.map(|f| f * share)));
        }
        Actions {
            step_s,
            field_mm_per_s2: [0, 1].map(|k| gravity[k] * GRAVITY_MM_PER_S2 - (after[k] - before[k]) / step_s),
            forces,
            torsional_moment_nmm,
            gripper_mm: scene.arm.place_mm(to_s),
        }
    }

    /// One step: as long a part of the frame as the changes allow. Returns that part.
    fn part(&mut self, dt_s: f64, done: f64, tally: &mut Tally) -> Result<f64, SimulationError> {
        let from_s = self.time_s + done * dt_s;
        let mut failure = None;
        for cut in CUTS {
            // Parts are multiples of 1/cut, so that a frame ends where it should.
            let share = 1.0 / cut;
            if (done * cut).fract() > 1e-9 {
                continue;
            }
            let share = share.min(1.0 - done);
            let step_s = share * dt_s;
            let mut gripper = self.gripper.clone();
            gripper.advance(from_s, step_s);
            let actions = self.actions(from_s, step_s);
            let last = cut >= CUTS[CUTS.len() - 1];
            if !last && !self.is_gentle(&gripper, &actions) {
                continue;
            }
            match self.advance(from_s, &gripper, &actions, last) {
                Ok(Some(solves)) => {
                    self.gripper = gripper;
                    tally.steps += 1;
                    tally.solves += solves;
                    tally.balance = tally.balance.max(self.frame.balance);
                    let mut slides = self.touching;
                    for finger in 0..2 {
                        let (slip_mm, gross) = (self.solver.slip_mm(finger), self.solver.gross_slip(finger));
                        self.slide_mm_per_s[finger] = 0.0;
                        if self.touching {
                            let slid_mm = size(slip_mm);
                            tally.slid_mm[finger] += slid_mm;
                            self.away_mm[finger] = add(self.away_mm[finger], slip_mm);
                            tally.gross[finger] |= gross;
                            self.slide_mm_per_s[finger] = slid_mm / step_s;
                            slides &= gross && self.slide_mm_per_s[finger] > SLIP_SPEED_MM_PER_S;
                        }
                    }
                    if slides {
                        let began_s = tally.slid_s.map_or(from_s, |[began, _]| began);
                        tally.slid_s = Some([began_s, from_s + step_s]);
                    }
                    return Ok(share);
                }
                Ok(None) => {}
                Err(SimulationError::OffSurface { .. }) if last => {
                    // None of it lies over the finger.
                    self.lose();
                    self.gripper = gripper;
                    return Ok(share);
                }
                Err(error) => failure = Some(error),
            }
        }
        Err(failure.unwrap_or(SimulationError::OutOfRange {
            field: "way of the object in a step, mm",
            found: self.body.grip_point_speed()[0] * dt_s,
            expected: "less than a cell",
        }))
    }

    /// Whether grip and load change little enough for one step.
    fn is_gentle(&self, gripper: &GripperState, actions: &Actions) -> bool {
        let (before, after) = (self.gripper.force_n(), gripper.force_n());
        if (after - before).abs() > (GRIP_STEP[0] * before).max(GRIP_STEP[1]) {
            return false;
        }
        if after <= 0.0 || before <= 0.0 || !self.touching {
            return true;
        }
        let load = self.body.load(actions, self.body.pose);
        let jump = libm::hypot(load[0] - self.load[0], load[1] - self.load[1]);
        let [vx, vy, spin] = self.body.grip_point_speed();
        let travel = (libm::hypot(vx, vy) + spin.abs() * 3.0) * actions.step_s;
        jump <= LOAD_STEP * self.solver.friction_n(after) && travel <= self.reach_mm()
    }

    /// Whether a hand holds the object still.
    fn is_held(&self, time_s: f64) -> bool {
        time_s + 1e-9 < self.scene.held_until_s
    }

    fn reach_mm(&self) -> f64 {
        let cells_mm = REACH_CELLS * self.parts.surface.pitch_mm();
        self.scene.reach_mm.map_or(cells_mm, |reach| reach.min(cells_mm))
    }

    /// One step of gripper and object; none if the object would go too far in it.
    fn advance(
        &mut self,
        from_s: f64,
        gripper: &GripperState,
        actions: &Actions,
        last: bool,
    ) -> Result<Option<usize>, SimulationError> {
        if self.dropped {
            return Ok(Some(0));
        }
        let grip_n = gripper.force_n();
        let to_s = from_s + actions.step_s;
        self.body
            .set_mass(&self.scene.object, self.scene.mass_share.at(to_s));
        self.solver.set_friction([0, 1].map(|finger| {
            let law = &self.scene.friction_laws[finger];
            self.scene.object.friction[finger] * law.mean_share([from_s, to_s], self.slide_mm_per_s[finger])
        }));
        let outcome = if self.is_held(from_s) {
            self.solver.press(grip_n, self.body.pose)?
        } else {
            let reach = if last { f64::INFINITY } else { self.reach_mm() };
            match self.solver.advance(grip_n, &self.body, actions, reach)? {
                Ending::Balanced(outcome) => outcome,
                Ending::TooFar => return Ok(None),
            }
        };
        if self.touching && !outcome.touching {
            self.slip_mm = [0.0; 2];
            self.away_mm = [[0.0; 3]; 2];
        }
        self.touching = outcome.touching;
        self.body.go(actions, outcome.pose);
        self.load = self.body.load(actions, outcome.pose);
        self.frame.balance = outcome.balance;
        Ok(Some(outcome.solves))
    }

    /// The object has left the fingers.
    fn lose(&mut self) {
        self.dropped = true;
        self.touching = false;
        self.body.stay();
        self.solver.open(self.body.pose);
    }

    /// Makes the frame.
    fn make_frame(&mut self, dt_s: f64, line_n: f64, tally: &Tally) {
        for (slip, slid) in self.slip_mm.iter_mut().zip(tally.slid_mm) {
            *slip += slid;
        }
        let slid_out = self.away_mm.iter().any(|away| size(*away) > self.scene.drop_mm);
        let let_go = !self.touching && !self.body.on_table() && !self.is_held(self.time_s);
        if !self.dropped && (slid_out || let_go) {
            self.lose();
        }
        for finger in 0..2 {
            self.truths[finger] = self.solver.truth(finger);
        }
        let fingers = [0, 1].map(|finger| {
            let mut truth = finger_truth(
                &self.truths[finger],
                self.slip_mm[finger],
                tally.slid_mm[finger] / dt_s,
                friction_of(&self.scene, finger, self.time_s).map(|all| all * self.solver.mean_share(finger)),
            );
            truth.gross_slip = tally.gross[finger] && truth.slip_speed_mm_per_s > SLIP_SPEED_MM_PER_S;
            truth
        });
        let [x, y, turn_rad] = self.body.pose;
        let [vx, vy, spin] = self.body.grip_point_speed();
        self.frame = GraspFrame {
            time_s: self.time_s,
            phase: self.scene.phase(self.time_s),
            line_n,
            grip_n: self.gripper.force_n(),
            slip: fingers.iter().all(|finger| finger.gross_slip),
            slid_s: tally.slid_s,
            fingers,
            object: ObjectState {
                at_mm: [x, y],
                turn_rad,
                velocity_mm_per_s: [vx, vy],
                spin_rad_per_s: spin,
            },
            load: self.load,
            on_table: self.body.on_table(),
            dropped: self.dropped,
            balance: tally.balance,
            steps: tally.steps,
            solves: tally.solves,
        };
    }
}

/// What a frame's steps add up to.
#[derive(Debug, Default)]
struct Tally {
    steps: usize,
    solves: usize,
    balance: f64,
    slid_mm: [f64; 2],
    gross: [bool; 2],
    slid_s: Option<[f64; 2]>,
}

/// Length of a slip whose spin is in mm.
fn size([x, y, spin]: Triple) -> f64 {
    libm::hypot(libm::hypot(x, y), spin)
}

/// Where things fall when gravity is turned by `turn_rad` from −y towards +x.
fn down(turn_rad: f64) -> [f64; 2] {
    let (sin, cos) = libm::sincos(turn_rad);
    [sin, -cos]
}

/// Sticking and sliding friction of a finger, the texture aside.
fn friction_of(scene: &GraspScene, finger: usize, time_s: f64) -> [f64; 2] {
    let law = &scene.friction_laws[finger];
    [0.0, f64::INFINITY].map(|speed| scene.object.friction[finger] * law.share(time_s, speed))
}

fn finger_truth(truth: &Truth, slip_mm: f64, slip_speed_mm_per_s: f64, friction: [f64; 2]) -> FingerTruth {
    let touching = truth.in_contact();
    FingerTruth {
        touching,
        forces: if touching {
            truth.force_map()
        } else {
            [[0.0; 3]; TAXEL_COUNT]
        },
        force_n: truth.force_n(),
        torsional_moment_nmm: truth.torsional_moment_nmm(truth.footprint_mm()),
        stick_ratio: truth.stick_ratio(),
        gross_slip: false,
        friction,
        slip_speed_mm_per_s,
        slip_mm,
        footprint_mm: truth.footprint_mm(),
    }
}

fn fingertip<'a>(
    known: &'a mut Option<Box<Fingertip>>,
    scene: &GraspScene,
    parts: &GraspParts,
    finger: usize,
) -> Result<&'a mut Fingertip, SimulationError> {
    if known.is_none() {
        let seed = scene.seed.wrapping_mul(2).wrapping_add(finger as u64);
        let params = scene.fingertips[finger];
        *known = Some(Box::new(parts.fingertip(seed, params)?));
    }
    Ok(known.as_mut().expect("made above"))
}
