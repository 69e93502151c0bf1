//! A rigid indenter pressed, dragged, twisted and tilted on the skin, step by step along its load history:
//! pressure and shear in turn until neither moves the other (`normal`, `tangential`). Units: mm, N, MPa, rad.
//! Limits: small strain and small rotations; the footprint follows the sliding of the step before, so slide
//! less than a cell per step; contact must stay inside the sensing surface.

use std::sync::Arc;

use super::convolution::{Convolution, Pair};
use super::normal::{NormalSolver, Press};
use super::shapes::HeightMap;
use super::skin::Skin;
use super::tangential::{TangentialProblem, TangentialSolver};
use super::truth::{Pose, Residuals, Truth};
use super::window::{Bounds, Window};
use crate::error::{SimulationError, finite, not_negative, positive};

/// Largest gap residual of a step that is handed out, share of the deepest indentation.
const GAP_TOLERANCE: f64 = 1e-4;
/// Residual at which the inner solvers stop; both stay under [`GAP_TOLERANCE`] after the alternation.
const INNER_TOLERANCE: f64 = 3e-5;
/// Rounds between pressure and shear at most; two or three are usual.
const ROUNDS: usize = 20;
/// Free cells kept around the contact in its box.
const MARGIN: usize = 2;
/// Loads under this count as no contact, N.
const TOUCH_N: f64 = 1e-6;

/// What holds the indenter: it gives way in the plane by its compliance times the force. Rigid by default.
/// With a compliant mount pulled far enough the contact slides, where a given force would have no solution.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Mount {
    /// Shift per force, mm/N.
    pub shift_mm_per_n: f64,
    /// Turn per moment about the indenter's origin, rad/(N·mm).
    pub turn_rad_per_nmm: f64,
}

/// Where a step takes the mount, all measured from the start of the path and not from the last step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// How the indenter is pressed.
    pub press: Press,
    /// Place of the indenter's origin if the mount were rigid, mm.
    pub at_mm: [f64; 2],
    /// Turn about z if the mount were rigid, from x to y, rad.
    pub turn_rad: f64,
    /// Slope of the indenter's lowest plane along x and y; positive presses the +x (+y) side deeper.
    pub tilt_rad: [f64; 2],
}

/// An indenter on the skin, with its load history.
#[derive(Debug)]
pub struct Contact {
    skin: Arc<Skin>,
    indenter: Arc<dyn HeightMap>,
    friction: f64,
    mount: Mount,
    drive: Drive,
    footprint_turn_rad: f64,
    truth: Truth,
    convolution: Option<Convolution>,
    normal: NormalSolver,
    tangential: TangentialSolver,
}

/// A step's solution in its box.
struct Solution {
    window: Window,
    pressure: Vec<f64>,
    shear: Vec<Pair>,
    /// Tangential displacement of the skin before and after.
    moved: [Vec<Pair>; 2],
    arm: Vec<Pair>,
    depth_mm: f64,
    residuals: Residuals,
}

impl Contact {
    /// `indenter` over `skin`, not touching yet.
    ///
    /// # Errors
    /// A friction that is not above 0, or a compliance below 0.
    pub fn new(
        skin: Arc<Skin>,
        indenter: Arc<dyn HeightMap>,
        friction: f64,
        mount: Mount,
    ) -> Result<Self, SimulationError> {
        positive("friction", friction)?;
        not_negative("mount shift_mm_per_n", mount.shift_mm_per_n)?;
        not_negative("mount turn_rad_per_nmm", mount.turn_rad_per_nmm)?;
        let truth = Truth::free(skin.cells(), Pose::default());
        Ok(Self {
            skin,
            indenter,
            friction,
            mount,
            drive: Drive {
                press: Press::Force(0.0),
                at_mm: [0.0; 2],
                turn_rad: 0.0,
                tilt_rad: [0.0; 2],
            },
            footprint_turn_rad: 0.0,
            truth,
            convolution: None,
            normal: NormalSolver::default(),
            tangential: TangentialSolver::default(),
        })
    }

    /// The contact after the last step.
    #[must_use]
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// One quasi-static step; on an error the contact stays as it was, and what did not touch does not touch.
    ///
    /// # Errors
    /// A number that is not finite, a force below 0, contact at the edge of the sensing surface, or residuals
    /// that stay too large.
    pub fn step(&mut self, drive: Drive) -> Result<&Truth, SimulationError> {
        check(&drive)?;
        if !self.truth.in_contact() {
            // Free to go there: nothing to pull at.
            self.lift_off(&drive);
        }
        let gap = self.gap_mm(drive.tilt_rad);
        let lowest = gap.iter().copied().fold(f64::INFINITY, f64::min);
        let touches = match drive.press {
            Press::Force(force) => force >= TOUCH_N,
            Press::Depth(depth) => depth > lowest,
        };
        if touches {
            let solution = self.solve(&drive, &gap)?;
            self.accept(&drive, &solution);
        } else {
            self.lift_off(&drive);
        }
        Ok(&self.truth)
    }

    /// Goes to `drive` in `steps` equal steps from where the contact is now; straight down if nothing touches.
    /// Pressing needs it: skin that comes under the indenter late has moved before. On the default layer the
    /// map of a press in one step is 2 to 7 % off, in eight steps below 1 %.
    ///
    /// # Errors
    /// Those of [`Self::step`]; the contact then stays at the last step that was solved.
    pub fn go_to(&mut self, drive: Drive, steps: u32) -> Result<&Truth, SimulationError> {
        let from = if self.truth.in_contact() {
            self.drive
        } else {
            drive
        };
        let now = match drive.press {
            Press::Force(_) => self.truth.force_n()[2],
            Press::Depth(_) => self.truth.pose.depth_mm.max(0.0),
        };
        for step in 1..steps {
            let part = f64::from(step) / f64::from(steps);
            let between = |a: f64, b: f64| a + (b - a) * part;
            self.step(Drive {
                press: match drive.press {
                    Press::Force(force) => Press::Force(between(now, force)),
                    Press::Depth(depth) => Press::Depth(between(now, depth)),
                },
                at_mm: [0, 1].map(|k| between(from.at_mm[k], drive.at_mm[k])),
                turn_rad: between(from.turn_rad, drive.turn_rad),
                tilt_rad: [0, 1].map(|k| between(from.tilt_rad[k], drive.tilt_rad[k])),
            })?;
        }
        self.step(drive)
    }

    fn lift_off(&mut self, drive: &Drive) {
        let depth_mm = match drive.press {
            Press::Force(_) => 0.0,
            Press::Depth(depth) => depth,
        };
        self.truth = Truth::free(
            self.skin.cells(),
            Pose {
                at_mm: drive.at_mm,
                depth_mm,
                turn_rad: drive.turn_rad,
                tilt_rad: drive.tilt_rad,
            },
        );
        self.footprint_turn_rad = drive.turn_rad;
        self.drive = *drive;
    }

    /// Height of the indenter over the skin at rest when its lowest plane is at depth 0.
    fn gap_mm(&self, tilt: [f64; 2]) -> Vec<f64> {
        let cells = self.skin.cells();
        let [x0, y0] = self.truth.footprint_mm;
        let (sin, cos) = libm::sincos(self.footprint_turn_rad);
        let mut gap = Vec::with_capacity(cells * cells);
        for row in 0..cells {
            let y = self.skin.place_mm(row) - y0;
            for column in 0..cells {
                let x = self.skin.place_mm(column) - x0;
                let height = self.indenter.height_mm([cos * x + sin * y, cos * y - sin * x]);
                gap.push(height - tilt[0] * x - tilt[1] * y);
            }
        }
        gap
    }

    /// Depth that `force_n` needs on a half-space, by overlap: p of the order E* × overlap / width.
    fn depth_guess_mm(&self, force_n: f64, gap: &[f64]) -> f64 {
        let lowest = gap.iter().copied().fold(f64::INFINITY, f64::min);
        let cell = self.skin.pitch_mm() * self.skin.pitch_mm();
        let modulus = self.skin.gel().contact_modulus_mpa();
        let carried = |depth: f64| {
            let (mut volume, mut area) = (0.0, 0.0);
            for g in gap {
                if *g < depth {
                    volume += (depth - g) * cell;
                    area += cell;
                }
            }
            modulus * volume / area.max(cell).sqrt()
        };
        let (mut low, mut high) = (lowest, lowest + self.skin.gel().thickness_mm.min(20.0));
        for _ in 0..12 {
            let middle = 0.5 * (low + high);
            if carried(middle) < force_n {
                low = middle;
            } else {
                high = middle;
            }
        }
        high
    }

    fn solve(&mut self, drive: &Drive, gap: &[f64]) -> Result<Solution, SimulationError> {
        let cells = self.skin.cells();
        let depth = match (drive.press, self.drive.press) {
            (Press::Depth(depth), _) => depth,
            // The force hardly grew: neither will the depth.
            (Press::Force(now), Press::Force(before)) if self.truth.in_contact() && now <= before * 1.05 => {
                self.truth.pose.depth_mm
            }
            (Press::Force(force), _) => self.depth_guess_mm(force, gap),
        };
        let under = |depth: f64| (0..cells * cells).filter(move |&place| gap[place] < depth);
        let lowest = (0..cells * cells).fold(0, |low, place| if gap[place] < gap[low] { place } else { low });
        // What was in contact moves the skin: it has to be in the box too.
        let held = (0..cells * cells).filter(|&place| self.truth.pressure[place] > 0.0);
        let mut bounds = Bounds::at(lowest, cells)
            .with(under(depth), cells)
            .with(held, cells);
        loop {
            let window = bounds.widened(MARGIN, cells).window(&self.skin);
            let solution = self.solve_in(drive, gap, window)?;
            let touching = window.places(cells).zip(&solution.pressure);
            let contact = Bounds::at(lowest, cells).with(
                touching.filter_map(|(place, p)| (*p > 0.0).then_some(place)),
                cells,
            );
            if contact.at_edge(cells) {
                return Err(SimulationError::OffSurface {
                    x_mm: self.truth.footprint_mm[0],
                    y_mm: self.truth.footprint_mm[1],
                });
            }
            let wanted = contact.widened(1, cells).with(under(solution.depth_mm), cells);
            if window.holds(wanted) {
                return Ok(solution);
            }
            bounds = bounds.union(wanted);
        }
    }

    fn solve_in(&mut self, drive: &Drive, gap: &[f64], window: Window) -> Result<Solution, SimulationError> {
        let cells = self.skin.cells();
        let cell_mm2 = self.skin.pitch_mm() * self.skin.pitch_mm();
        let places: Vec<usize> = window.places(cells).collect();
        let gap: Vec<f64> = places.iter().map(|&place| gap[place]).collect();
        let mut pressure: Vec<f64> = places.iter().map(|&place| self.truth.pressure[place]).collect();
        let mut shear: Vec<Pair> = places.iter().map(|&place| self.truth.shear[place]).collect();
        let [x0, y0] = self.truth.footprint_mm;
        let arm: Vec<Pair> = places
            .iter()
            .map(|&place| {
                let x = self.skin.place_mm(place % cells) - x0;
                let y = self.skin.place_mm(place / cells) - y0;
                Pair::new(-y, x)
            })
            .collect();
        let convolution = match &mut self.convolution {
            Some(known) if known.size() == [window.rows, window.columns] => known,
            other => other.insert(Convolution::new(self.skin.spectra(window.rows, window.columns))),
        };
        // The old tractions in this box: a box that grew has to know what they did outside the last one.
        let mut before = vec![Pair::default(); places.len()];
        let mut spread = before.clone();
        convolution.tangential(&shear, &mut before);
        convolution.tangential_of_pressure(&pressure, &mut spread);
        for (u, more) in before.iter_mut().zip(&spread) {
            *u += more;
        }
        let pose = self.truth.pose;
        let shift = Pair::new(drive.at_mm[0] - pose.at_mm[0], drive.at_mm[1] - pose.at_mm[1]);
        let turn = drive.turn_rad - pose.turn_rad;

        let mut residuals = Residuals::default();
        let mut base = vec![0.0; places.len()];
        let mut limit = base.clone();
        let mut target = before.clone();
        loop {
            convolution.normal_of_shear(&shear, &mut base);
            for (base, gap) in base.iter_mut().zip(&gap) {
                *base += gap;
            }
            let first = residuals.rounds == 0;
            let accept = if first { INNER_TOLERANCE } else { GAP_TOLERANCE };
            let outcome = self.normal.solve(
                convolution,
                &base,
                drive.press,
                cell_mm2,
                [accept, INNER_TOLERANCE],
                &mut pressure,
            );
            residuals.gap = outcome.residual;
            residuals.normal_iterations += outcome.iterations;
            let settled = !first && outcome.iterations == 0;
            if settled || residuals.rounds == ROUNDS {
                let worst = residuals.gap.max(residuals.friction);
                if worst > GAP_TOLERANCE {
                    return Err(SimulationError::ContactUnsolved {
                        found: worst,
                        expected: GAP_TOLERANCE,
                        rounds: residuals.rounds,
                    });
                }
                let mut after = vec![Pair::default(); places.len()];
                convolution.tangential(&shear, &mut after);
                for (u, more) in after.iter_mut().zip(&spread) {
                    *u += more;
                }
                return Ok(Solution {
                    window,
                    pressure,
                    shear,
                    moved: [before, after],
                    arm,
                    depth_mm: outcome.depth_mm,
                    residuals,
                });
            }
            residuals.rounds += 1;
            convolution.tangential_of_pressure(&pressure, &mut spread);
            for cell in 0..places.len() {
                target[cell] = before[cell] + shift + arm[cell].scale(turn) - spread[cell];
                limit[cell] = self.friction * pressure[cell];
            }
            let outcome = self.tangential.solve(
                convolution,
                &TangentialProblem {
                    target_mm: &target,
                    limit_mpa: &limit,
                    arm_mm: &arm,
                    mount_shift: self.mount.shift_mm_per_n * cell_mm2,
                    mount_turn: self.mount.turn_rad_per_nmm * cell_mm2,
                },
                INNER_TOLERANCE,
                &mut shear,
            );
            residuals.friction = outcome.residual;
            residuals.tangential_iterations += outcome.iterations;
        }
    }

    /// Takes over a solution: tractions, the indenter's motion and how far it slid over the skin.
    fn accept(&mut self, drive: &Drive, solution: &Solution) {
        let cells = self.skin.cells();
        let truth = &mut self.truth;
        truth.pressure.fill(0.0);
        truth.shear.fill(Pair::default());
        for (cell, place) in solution.window.places(cells).enumerate() {
            truth.pressure[place] = solution.pressure[cell];
            truth.shear[place] = solution.shear[cell];
        }
        let [fx, fy, _] = truth.force_n();
        let moment = truth.torsion_nmm(truth.footprint_mm);
        let old = truth.pose;
        truth.pose = Pose {
            at_mm: [
                drive.at_mm[0] - self.mount.shift_mm_per_n * fx,
                drive.at_mm[1] - self.mount.shift_mm_per_n * fy,
            ],
            depth_mm: solution.depth_mm,
            turn_rad: drive.turn_rad - self.mount.turn_rad_per_nmm * moment,
            tilt_rad: drive.tilt_rad,
        };
        let shift = Pair::new(
            truth.pose.at_mm[0] - old.at_mm[0],
            truth.pose.at_mm[1] - old.at_mm[1],
        );
        let turn = truth.pose.turn_rad - old.turn_rad;

        // Means over the contact, weighted with the pressure.
        let (mut weight, mut mean_slip, mut mean_arm) = (0.0, Pair::default(), Pair::default());
        let (mut followed, mut asked) = (0.0, 0.0);
        let motion = |cell: usize| {
            let asked = shift + solution.arm[cell].scale(turn);
            (asked, solution.moved[1][cell] - solution.moved[0][cell])
        };
        for (cell, p) in solution.pressure.iter().enumerate() {
            let (wanted, made) = motion(cell);
            weight += p;
            mean_slip += (wanted - made).scale(*p);
            mean_arm += solution.arm[cell].scale(*p);
            followed += p * (wanted.conj() * made).re;
            asked += p * wanted.norm_sqr();
        }
        mean_slip /= weight;
        mean_arm /= weight;
        let (mut spin, mut inertia) = (0.0, 0.0);
        for (cell, p) in solution.pressure.iter().enumerate() {
            let (wanted, made) = motion(cell);
            let arm = solution.arm[cell] - mean_arm;
            spin += p * (arm.conj() * (wanted - made - mean_slip)).re;
            inertia += p * arm.norm_sqr();
        }
        if inertia > 0.0 {
            self.footprint_turn_rad += spin / inertia;
        }
        truth.footprint_mm[0] += mean_slip.re;
        truth.footprint_mm[1] += mean_slip.im;
        truth.slip_distance_mm += mean_slip.norm();
        truth.residuals = solution.residuals;
        truth.classify(self.friction, (asked > 0.0).then(|| followed / asked));
        self.drive = *drive;
    }
}

fn check(drive: &Drive) -> Result<(), SimulationError> {
    match drive.press {
        Press::Force(force) => not_negative("drive press force, N", force)?,
        Press::Depth(depth) => finite("drive press depth, mm", depth)?,
    };
    finite("drive at_mm[0]", drive.at_mm[0])?;
    finite("drive at_mm[1]", drive.at_mm[1])?;
    finite("drive turn_rad", drive.turn_rad)?;
    finite("drive tilt_rad[0]", drive.tilt_rad[0])?;
    finite("drive tilt_rad[1]", drive.tilt_rad[1])?;
    Ok(())
}
