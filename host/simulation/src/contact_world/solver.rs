//! A rigid indenter pressed, dragged, turned and tilted on the gel, step by step along its load history:
//! pressure and shear in turn until neither moves the other (`normal`, `tangential`). Units: mm, N, MPa, rad.
//! Limits: small strain and small rotations; contact must stay inside the sensing surface.

use std::sync::Arc;

use super::convolution::{Convolution, Pair};
use super::normal::{NormalSolver, Press};
use super::shapes::{HeightMap, WALL_MM};
use super::stiffness::{Stiffness, Triple, add, dot, sub};
use super::surface::GelSurface;
use super::tangential::{TangentialProblem, TangentialSolver};
use super::texture::Texture;
use super::truth::{Pose, Residuals, Truth};
use super::window::{Bounds, Window};
use crate::error::{SimulationError, finite, not_negative, positive};
use crate::gel::Gel;

/// Largest gap residual of a step that is handed out, share of the deepest indentation.
const GAP_TOLERANCE: f64 = 1e-4;
/// Residual at which the inner solvers stop; both stay under [`GAP_TOLERANCE`] after the alternation.
const INNER_TOLERANCE: f64 = 3e-5;
/// Rounds between pressure and shear at most; two or three are usual.
const ROUNDS: usize = 20;
/// Free cells kept around the contact in its box.
const MARGIN: usize = 2;
/// Corrections of where a step ends on the gel at most; one is usual while it slides, none otherwise.
const CORRECTIONS: usize = 6;
/// How far off a step's place on the gel may be, share of a cell.
const PLACE_TOLERANCE: f64 = 0.02;
/// Unbalanced load at which a pull counts as balanced, share of what friction holds.
const BALANCE_TOLERANCE: f64 = 1e-4;
/// Growth of shear from which the stiffness is updated, share of what friction holds: less is noise.
const MIN_GROWTH: f64 = 1e-4;
/// Trials for one balance at most, and rounds between pressure and balance.
const TRIALS: usize = 60;
const BALANCE_ROUNDS: usize = 40;
/// Steeper than this, rise over run, a surface counts as a wall, whose pressure is not turned.
const STEEPEST: f64 = 1.0;
/// Loads under this count as no contact, N.
const TOUCH_N: f64 = 1e-6;
/// An indenter that moves less than this in a step stands still: whether the gel follows cannot be told, mm.
const STILL_MM: f64 = 1e-5;

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

/// An indenter on the gel, with its load history.
#[derive(Debug)]
pub struct Contact {
    surface: Arc<GelSurface>,
    indenter: Arc<dyn HeightMap>,
    friction: f64,
    texture: Option<Texture>,
    mean_share: f64,
    mount: Mount,
    /// Whether pressure acts along the indenter's normal.
    along_normal: bool,
    /// Whether the gel ends with the grid.
    ends: bool,
    drive: Drive,
    footprint_turn_rad: f64,
    /// Part of the last step's motion that slid.
    sliding: f64,
    slip_mm: Triple,
    stiffness: Stiffness,
    truth: Truth,
    convolution: Option<Convolution>,
    normal: NormalSolver,
    tangential: TangentialSolver,
}

/// A step in progress: its problem in a box of cells and the tractions found so far. Nothing of it counts before
/// [`Contact::accept`], so that a step may be tried under several motions of the indenter.
#[derive(Debug)]
pub(crate) struct Step {
    press: Press,
    tilt_rad: [f64; 2],
    /// Where the indenter stands on the gel at the step's end.
    footprint_mm: [f64; 2],
    footprint_turn_rad: f64,
    corrections: usize,
    /// Height of the indenter over every cell of the surface.
    heights: Vec<f64>,
    lowest: usize,
    bounds: Bounds,
    window: Window,
    places: Vec<usize>,
    gap: Vec<f64>,
    /// Slope of the indenter over the gel.
    slope: Vec<Pair>,
    pressure: Vec<f64>,
    shear: Vec<Pair>,
    /// Tangential share of the pressure.
    slope_traction: Vec<Pair>,
    arm: Vec<Pair>,
    /// Tangential displacement of the gel before the step.
    before: Vec<Pair>,
    /// The same after the step, once it has settled.
    after: Vec<Pair>,
    /// Tangential displacement under the pressure alone.
    spread: Vec<Pair>,
    base: Vec<f64>,
    limit: Vec<f64>,
    /// Friction of every cell over the contact's; empty when it is even.
    texture: Vec<f64>,
    target: Vec<Pair>,
    depth_mm: f64,
    residuals: Residuals,
}

impl Contact {
    /// `indenter` over `surface`, not touching yet.
    ///
    /// # Errors
    /// A friction that is not above 0, or a compliance below 0.
    pub fn new(
        surface: Arc<GelSurface>,
        indenter: Arc<dyn HeightMap>,
        friction: f64,
        mount: Mount,
    ) -> Result<Self, SimulationError> {
        positive("friction", friction)?;
        not_negative("mount shift_mm_per_n", mount.shift_mm_per_n)?;
        not_negative("mount turn_rad_per_nmm", mount.turn_rad_per_nmm)?;
        let truth = Truth::free(surface.cells(), Pose::default());
        Ok(Self {
            surface,
            indenter,
            friction,
            texture: None,
            mean_share: 1.0,
            mount,
            along_normal: true,
            ends: false,
            drive: Drive {
                press: Press::Force(0.0),
                at_mm: [0.0; 2],
                turn_rad: 0.0,
                tilt_rad: [0.0; 2],
            },
            footprint_turn_rad: 0.0,
            sliding: 0.0,
            slip_mm: [0.0; 3],
            stiffness: Stiffness::default(),
            truth,
            convolution: None,
            normal: NormalSolver::default(),
            tangential: TangentialSolver::default(),
        })
    }

    /// The same with forces of a pressure straight down whatever the indenter's slope, as Hertz, Cattaneo and most
    /// programs have it. By default it acts along the indenter's normal, so that p∇h of it is a tangential force.
    /// That shears nothing: under the pressure of a nearly incompressible gel the stress is the same in all
    /// directions, turned surface or not. Gel and friction are therefore the same either way.
    #[must_use]
    pub fn vertical_pressure(mut self) -> Self {
        self.along_normal = false;
        self
    }

    /// The same with friction that changes over the indenter's surface.
    pub(crate) fn textured(mut self, texture: Option<Texture>) -> Self {
        self.texture = texture;
        self
    }

    /// The same on a gel that ends with the grid: what lies beyond its edge touches nothing, instead of an error. Its stiffness there
    /// is still that of an endless layer.
    pub(crate) fn ending_with_the_grid(mut self) -> Self {
        self.ends = true;
        self
    }

    /// Friction from the next step on, before the texture.
    pub(crate) fn set_friction(&mut self, friction: f64) {
        self.friction = friction;
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
        if let Some(step) = self.begin(drive.press, drive.tilt_rad, drive.at_mm, drive.turn_rad) {
            self.solve(step, &drive)?;
        }
        Ok(&self.truth)
    }

    /// Goes to `drive` in `steps` equal steps from where the contact is now; straight down if nothing touches.
    /// Pressing needs it: gel that comes under the indenter late has moved before. On the default layer the
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

    /// One quasi-static step to a load along the gel instead of a place: forces along x and y, N, and the moment about
    /// where the indenter stands, N·mm, that act on the indenter. It goes where the gel carries them, the mount
    /// aside.
    ///
    /// # Errors
    /// Those of [`Self::step`], and a load that friction cannot hold; on an error the contact stays as it was.
    pub fn pull(
        &mut self,
        press: Press,
        tilt_rad: [f64; 2],
        load: [f64; 3],
    ) -> Result<&Truth, SimulationError> {
        let pose = self.truth.pose;
        let mut drive = Drive {
            press,
            at_mm: pose.at_mm,
            turn_rad: pose.turn_rad,
            tilt_rad,
        };
        check(&drive)?;
        for (field, value) in ["pull load x, N", "pull load y, N", "pull moment, N·mm"]
            .into_iter()
            .zip(load)
        {
            finite(field, value)?;
        }
        let slides = |max_n: f64| Err(SimulationError::Slides { load, max_n });
        let Some(mut step) = self.begin(press, tilt_rad, pose.at_mm, pose.turn_rad) else {
            self.stiffness.reset();
            return if load.iter().all(|part| part.abs() < TOUCH_N) {
                Ok(&self.truth)
            } else {
                slides(0.0)
            };
        };
        let mut motion = [0.0; 3];
        for _ in 0..BALANCE_ROUNDS {
            if self.press(&mut step)? {
                drive.at_mm = [0, 1].map(|k| pose.at_mm[k] + motion[k]);
                drive.turn_rad = pose.turn_rad + motion[2];
                if self.fits(&mut step, drive.at_mm, drive.turn_rad)? {
                    self.accept(&step, drive.at_mm, drive.turn_rad);
                    return Ok(&self.truth);
                }
                continue;
            }
            if !self.balance(&mut step, load, &mut motion) {
                let cell_mm2 = self.surface.pitch_mm() * self.surface.pitch_mm();
                return slides(self.friction * step.pressure.iter().sum::<f64>() * cell_mm2);
            }
        }
        Err(SimulationError::NoConvergence {
            found: step.residuals.friction,
            expected: GAP_TOLERANCE,
            iterations: BALANCE_ROUNDS,
        })
    }

    /// Moves the indenter until the shear carries `load`, the pressure as it is; false if it slides away.
    fn balance(&mut self, step: &mut Step, load: Triple, motion: &mut Triple) -> bool {
        let area = self.touched_mm2(step);
        self.stiffness.measure(area, self.surface.gel(), 1.0);
        let radius = self.stiffness.radius_mm();
        let weigh = |v: Triple| libm::hypot(v[0], v[1]).max(v[2].abs() / radius);
        let cell_mm2 = self.surface.pitch_mm() * self.surface.pitch_mm();
        let max_n = self.friction * step.pressure.iter().sum::<f64>() * cell_mm2;
        let carried = |contact: &mut Self, step: &mut Step, there: Triple| {
            contact.shear(step, there, 0.1 * INNER_TOLERANCE);
            sub(contact.carried(step), load)
        };
        let mut unbalanced = carried(self, step, *motion);
        for _ in 0..TRIALS {
            if weigh(unbalanced) <= BALANCE_TOLERANCE * max_n {
                return true;
            }
            let direction = self.stiffness.newton_step(&[[0.0; 3]; 3], unbalanced);
            let slope = dot(unbalanced, direction);
            let mut share = 1.0;
            loop {
                let part = direction.map(|v| v * share);
                let there = add(*motion, part);
                let found = carried(self, step, there);
                if weigh(self.stiffness.growth(part)) > MIN_GROWTH * max_n {
                    self.stiffness.update(part, sub(found, unbalanced));
                }
                let slope_there = dot(found, direction);
                // Convex: beyond the minimum along the direction the slope has changed its sign.
                if slope_there <= -0.9 * slope || share < 1e-3 {
                    (*motion, unbalanced) = (there, found);
                    break;
                }
                share *= (slope / (slope - slope_there)).clamp(0.05, 0.6);
            }
            if weigh([motion[0], motion[1], motion[2] * radius * radius]) > self.surface.gel().thickness_mm {
                return false;
            }
        }
        false
    }

    fn lift_off(&mut self, drive: &Drive) {
        let depth_mm = match drive.press {
            Press::Force(_) => 0.0,
            Press::Depth(depth) => depth,
        };
        self.truth = Truth::free(
            self.surface.cells(),
            Pose {
                at_mm: drive.at_mm,
                depth_mm,
                turn_rad: drive.turn_rad,
                tilt_rad: drive.tilt_rad,
            },
        );
        self.footprint_turn_rad = drive.turn_rad;
        self.sliding = 0.0;
        self.slip_mm = [0.0; 3];
        self.drive = *drive;
    }

    /// Height over the gel at rest of the indenter that stands at `footprint_mm` when its lowest plane is at depth
    /// 0, at a place of the gel, mm.
    fn height_mm(&self, tilt: [f64; 2], [x0, y0]: [f64; 2], (sin, cos): (f64, f64), [x, y]: [f64; 2]) -> f64 {
        let (x, y) = (x - x0, y - y0);
        let height = self.indenter.height_mm([cos * x + sin * y, cos * y - sin * x]);
        height - tilt[0] * x - tilt[1] * y
    }

    /// That height over every cell.
    fn gap_mm(&self, tilt: [f64; 2], footprint_mm: [f64; 2], turn_rad: f64) -> Vec<f64> {
        let cells = self.surface.cells();
        let turn = libm::sincos(turn_rad);
        let mut gap = Vec::with_capacity(cells * cells);
        for row in 0..cells {
            for column in 0..cells {
                let at = [self.surface.place_mm(column), self.surface.place_mm(row)];
                gap.push(self.height_mm(tilt, footprint_mm, turn, at));
            }
        }
        gap
    }

    /// Mean rise per way along x and y of the step's indenter over a cell: from edge to edge, walls left out.
    fn slope(&self, step: &Step, place: usize) -> Pair {
        let cells = self.surface.cells();
        let turn = libm::sincos(step.footprint_turn_rad);
        let half = 0.5 * self.surface.pitch_mm();
        let at = [
            self.surface.place_mm(place % cells),
            self.surface.place_mm(place / cells),
        ];
        let here = step.heights[place];
        let along = |axis: usize| {
            let [back, on] = [-half, half].map(|offset| {
                let mut there = at;
                there[axis] += offset;
                let rise = (self.height_mm(step.tilt_rad, step.footprint_mm, turn, there) - here) / offset;
                (rise.abs() <= STEEPEST).then_some(rise)
            });
            match (back, on) {
                (Some(a), Some(b)) => 0.5 * (a + b),
                (Some(rise), None) | (None, Some(rise)) => rise,
                (None, None) => 0.0,
            }
        };
        Pair::new(along(0), along(1))
    }

    /// Friction of the step's cells over the contact's; empty when it is even.
    fn texture_of(&self, step: &Step) -> Vec<f64> {
        let Some(texture) = self.texture else {
            return Vec::new();
        };
        let cells = self.surface.cells();
        let (sin, cos) = libm::sincos(step.footprint_turn_rad);
        let [x0, y0] = step.footprint_mm;
        let share = |&place: &usize| {
            let x = self.surface.place_mm(place % cells) - x0;
            let y = self.surface.place_mm(place / cells) - y0;
            texture.at([cos * x + sin * y, cos * y - sin * x])
        };
        step.places.iter().map(share).collect()
    }

    /// Depth that `force_n` needs on a half-space, by overlap: p of the order E* × overlap / width.
    fn depth_guess_mm(&self, force_n: f64, gap: &[f64]) -> f64 {
        let lowest = gap.iter().copied().fold(f64::INFINITY, f64::min);
        let cell = self.surface.pitch_mm() * self.surface.pitch_mm();
        let modulus = self.surface.gel().contact_modulus_mpa();
        let (mut low, mut high) = (lowest, lowest + self.surface.gel().thickness_mm.min(20.0));
        let near: Vec<f64> = gap.iter().copied().filter(|g| *g < high).collect();
        let carried = |depth: f64| {
            let (mut volume, mut area) = (0.0, 0.0);
            for g in &near {
                if *g < depth {
                    volume += (depth - g) * cell;
                    area += cell;
                }
            }
            modulus * volume / area.max(cell).sqrt()
        };
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

    /// One quasi-static step where the indenter's motion is known except for what the mount gives.
    fn solve(&mut self, mut step: Step, drive: &Drive) -> Result<(), SimulationError> {
        let pose = self.truth.pose;
        let shift = [0, 1].map(|k| drive.at_mm[k] - pose.at_mm[k]);
        let turn = drive.turn_rad - pose.turn_rad;
        loop {
            while !self.press(&mut step)? {
                self.shear(&mut step, [shift[0], shift[1], turn], INNER_TOLERANCE);
            }
            let [fx, fy, moment] = self.carried(&step);
            let mount = self.mount;
            let at_mm = [
                drive.at_mm[0] - mount.shift_mm_per_n * fx,
                drive.at_mm[1] - mount.shift_mm_per_n * fy,
            ];
            let turn_rad = drive.turn_rad - mount.turn_rad_per_nmm * moment;
            if self.fits(&mut step, at_mm, turn_rad)? {
                self.accept(&step, at_mm, turn_rad);
                self.drive = *drive;
                return Ok(());
            }
        }
    }

    /// Begins a step; none when nothing would touch. What did not touch before is free to go to `at_mm` first.
    pub(crate) fn begin(
        &mut self,
        press: Press,
        tilt_rad: [f64; 2],
        at_mm: [f64; 2],
        turn_rad: f64,
    ) -> Option<Step> {
        let drive = Drive {
            press,
            at_mm,
            turn_rad,
            tilt_rad,
        };
        if !self.truth.in_contact() {
            // Free to go there: nothing to pull at.
            self.lift_off(&drive);
        }
        // It will slide as it slid before.
        let pose = self.truth.pose;
        let footprint_mm =
            [0, 1].map(|k| self.truth.footprint_mm[k] + self.sliding * (at_mm[k] - pose.at_mm[k]));
        let footprint_turn_rad = self.footprint_turn_rad + self.sliding * (turn_rad - pose.turn_rad);
        let heights = self.gap_mm(tilt_rad, footprint_mm, footprint_turn_rad);
        let lowest = lowest(&heights);
        let touches = match press {
            Press::Force(force) => force >= TOUCH_N,
            Press::Depth(depth) => depth > heights[lowest],
        };
        if !touches {
            self.lift_off(&drive);
            return None;
        }
        let cells = self.surface.cells();
        let depth = match (press, self.drive.press) {
            (Press::Depth(depth), _) => depth,
            // The force hardly grew: neither will the depth.
            (Press::Force(now), Press::Force(before)) if self.truth.in_contact() && now <= before * 1.05 => {
                self.truth.pose.depth_mm
            }
            (Press::Force(force), _) => self.depth_guess_mm(force, &heights),
        };
        let under = (0..cells * cells).filter(|&place| heights[place] < depth);
        // What was in contact moves the gel: it has to be in the box too.
        let held = (0..cells * cells).filter(|&place| self.truth.pressure[place] > 0.0);
        let bounds = Bounds::at(lowest, cells).with(under, cells).with(held, cells);
        let mut step = Step {
            press,
            tilt_rad,
            footprint_mm,
            footprint_turn_rad,
            corrections: 0,
            heights,
            lowest,
            bounds,
            window: bounds.window(&self.surface),
            places: Vec::new(),
            gap: Vec::new(),
            slope: Vec::new(),
            pressure: Vec::new(),
            shear: Vec::new(),
            slope_traction: Vec::new(),
            arm: Vec::new(),
            before: Vec::new(),
            after: Vec::new(),
            spread: Vec::new(),
            base: Vec::new(),
            limit: Vec::new(),
            texture: Vec::new(),
            target: Vec::new(),
            depth_mm: depth,
            residuals: Residuals::default(),
        };
        self.open(&mut step);
        Some(step)
    }

    /// Lays the step's box around its bounds and starts from the tractions of the step before.
    fn open(&mut self, step: &mut Step) {
        let cells = self.surface.cells();
        step.window = step.bounds.widened(MARGIN, cells).window(&self.surface);
        step.places = step.window.places(cells).collect();
        let of = |values: &[f64]| -> Vec<f64> { step.places.iter().map(|&place| values[place]).collect() };
        step.gap = of(&step.heights);
        step.pressure = of(&self.truth.pressure);
        step.shear = step.places.iter().map(|&place| self.truth.shear[place]).collect();
        step.slope_traction = step
            .places
            .iter()
            .map(|&place| self.truth.slope_traction[place])
            .collect();
        step.slope = if self.along_normal {
            step.places.iter().map(|&place| self.slope(step, place)).collect()
        } else {
            vec![Pair::default(); step.places.len()]
        };
        step.texture = self.texture_of(step);
        let [x0, y0] = step.footprint_mm;
        step.arm = step
            .places
            .iter()
            .map(|&place| {
                let x = self.surface.place_mm(place % cells) - x0;
                let y = self.surface.place_mm(place / cells) - y0;
                Pair::new(-y, x)
            })
            .collect();
        let count = step.places.len();
        step.before = vec![Pair::default(); count];
        step.after = vec![Pair::default(); count];
        step.spread = vec![Pair::default(); count];
        step.target = vec![Pair::default(); count];
        step.base = vec![0.0; count];
        step.limit = vec![0.0; count];
        step.residuals = Residuals::default();
        let (convolution, ..) = self.tools(step.window);
        // The old tractions in this box: a box that grew has to know what they did outside the last one.
        convolution.tangential(&step.shear, &mut step.before);
        convolution.tangential_of_pressure(&step.pressure, &mut step.spread);
        for (u, more) in step.before.iter_mut().zip(&step.spread) {
            *u += more;
        }
    }

    fn tools(&mut self, window: Window) -> (&mut Convolution, &mut NormalSolver, &mut TangentialSolver) {
        let size = [window.rows, window.columns];
        if self
            .convolution
            .as_ref()
            .is_some_and(|known| known.size() != size)
        {
            self.convolution = None;
        }
        let convolution = self
            .convolution
            .get_or_insert_with(|| Convolution::new(self.surface.spectra(window.rows, window.columns)));
        (convolution, &mut self.normal, &mut self.tangential)
    }

    /// Brings the pressure to equilibrium with the shear as it is. Whether both had settled already; if not, the
    /// shear's turn is next.
    ///
    /// # Errors
    /// Residuals that stay too large.
    pub(crate) fn press(&mut self, step: &mut Step) -> Result<bool, SimulationError> {
        let cell_mm2 = self.surface.pitch_mm() * self.surface.pitch_mm();
        let friction = self.friction;
        let (convolution, normal, _) = self.tools(step.window);
        convolution.normal_of_shear(&step.shear, &mut step.base);
        for (base, gap) in step.base.iter_mut().zip(&step.gap) {
            *base += gap;
        }
        let first = step.residuals.rounds == 0;
        let accept = if first { INNER_TOLERANCE } else { GAP_TOLERANCE };
        let outcome = normal.solve(
            convolution,
            &step.base,
            step.press,
            cell_mm2,
            [accept, INNER_TOLERANCE],
            &mut step.pressure,
        );
        step.depth_mm = outcome.depth_mm;
        step.residuals.gap = outcome.residual;
        step.residuals.normal_iterations += outcome.iterations;
        let settled = !first && outcome.iterations == 0;
        if settled || step.residuals.rounds == ROUNDS {
            let worst = step.residuals.gap.max(step.residuals.friction);
            if worst > GAP_TOLERANCE {
                return Err(SimulationError::ContactUnsolved {
                    found: worst,
                    expected: GAP_TOLERANCE,
                    rounds: step.residuals.rounds,
                });
            }
            return Ok(true);
        }
        step.residuals.rounds += 1;
        for (slope_traction, (slope, p)) in step
            .slope_traction
            .iter_mut()
            .zip(step.slope.iter().zip(&step.pressure))
        {
            *slope_traction = slope.scale(*p);
        }
        convolution.tangential_of_pressure(&step.pressure, &mut step.spread);
        for (limit, pressure) in step.limit.iter_mut().zip(&step.pressure) {
            *limit = friction * pressure;
        }
        for (limit, share) in step.limit.iter_mut().zip(&step.texture) {
            *limit *= share;
        }
        Ok(false)
    }

    /// Brings the shear to equilibrium under the pressure as it is when the indenter moves by `[x, y, turn]` in
    /// this step (mm, mm, rad; less what the mount gives). May be called again with another motion.
    pub(crate) fn shear(&mut self, step: &mut Step, [x, y, turn]: [f64; 3], tolerance: f64) {
        let cell_mm2 = self.surface.pitch_mm() * self.surface.pitch_mm();
        let mount = self.mount;
        let (convolution, _, tangential) = self.tools(step.window);
        // The mount gives way to the pressure's share too.
        let (sum, moment) = sum_and_moment(&step.slope_traction, &step.arm);
        let shift = Pair::new(x, y) - sum.scale(mount.shift_mm_per_n * cell_mm2);
        let turn = turn - moment * mount.turn_rad_per_nmm * cell_mm2;
        for cell in 0..step.target.len() {
            step.target[cell] = step.before[cell] + shift + step.arm[cell].scale(turn) - step.spread[cell];
        }
        let outcome = tangential.solve(
            convolution,
            &TangentialProblem {
                target_mm: &step.target,
                limit_mpa: &step.limit,
                arm_mm: &step.arm,
                mount_shift: mount.shift_mm_per_n * cell_mm2,
                mount_turn: mount.turn_rad_per_nmm * cell_mm2,
            },
            tolerance,
            &mut step.shear,
        );
        step.residuals.friction = outcome.residual;
        step.residuals.tangential_iterations += outcome.iterations;
    }

    /// Force along x and y, N, and moment about the indenter's origin, N·mm, of the step's tangential tractions.
    pub(crate) fn carried(&self, step: &Step) -> [f64; 3] {
        let cell_mm2 = self.surface.pitch_mm() * self.surface.pitch_mm();
        let (friction, by_friction) = sum_and_moment(&step.shear, &step.arm);
        let (slope_traction, by_slope) = sum_and_moment(&step.slope_traction, &step.arm);
        let sum = (friction + slope_traction).scale(cell_mm2);
        [sum.re, sum.im, (by_friction + by_slope) * cell_mm2]
    }

    /// Contact area of the step, mm².
    pub(crate) fn touched_mm2(&self, step: &Step) -> f64 {
        let cells = step.pressure.iter().filter(|p| **p > 0.0).count();
        cells as f64 * self.surface.pitch_mm() * self.surface.pitch_mm()
    }

    /// Whether the settled step's box holds all that may touch, and the indenter stands on the gel where the step
    /// took it to be when it ends at `at_mm` and `turn_rad`. If not the step has been laid again and must be solved
    /// again.
    ///
    /// # Errors
    /// Contact at the edge of the sensing surface; on a gel that ends there, none.
    pub(crate) fn fits(
        &mut self,
        step: &mut Step,
        at_mm: [f64; 2],
        turn_rad: f64,
    ) -> Result<bool, SimulationError> {
        let cells = self.surface.cells();
        let touching = step.places.iter().zip(&step.pressure);
        let contact = Bounds::at(step.lowest, cells).with(
            touching.filter_map(|(place, p)| (*p > 0.0).then_some(*place)),
            cells,
        );
        let refused = if self.ends {
            step.heights[step.lowest] >= WALL_MM
        } else {
            contact.at_edge(cells)
        };
        if refused {
            return Err(SimulationError::OffSurface {
                x_mm: step.footprint_mm[0],
                y_mm: step.footprint_mm[1],
            });
        }
        let under = (0..cells * cells).filter(|&place| step.heights[place] < step.depth_mm);
        let wanted = contact.widened(1, cells).with(under, cells);
        if !step.window.holds(wanted) {
            step.bounds = step.bounds.union(wanted);
            self.open(step);
            return Ok(false);
        }
        let (convolution, ..) = self.tools(step.window);
        convolution.tangential(&step.shear, &mut step.after);
        for (u, more) in step.after.iter_mut().zip(&step.spread) {
            *u += more;
        }
        // The gel under the indenter went along by so much: what it stands on now lay that far back at rest.
        let carried = Motion::of(&step.pressure, &step.arm, |cell| step.after[cell]);
        let footprint_mm = [at_mm[0] - carried.shift.re, at_mm[1] - carried.shift.im];
        let footprint_turn_rad = turn_rad - carried.turn_rad;
        let off_mm = libm::hypot(
            footprint_mm[0] - step.footprint_mm[0],
            footprint_mm[1] - step.footprint_mm[1],
        )
        .max((footprint_turn_rad - step.footprint_turn_rad).abs() * carried.radius_mm);
        if off_mm <= PLACE_TOLERANCE * self.surface.pitch_mm() || step.corrections == CORRECTIONS {
            return Ok(true);
        }
        step.corrections += 1;
        step.footprint_mm = footprint_mm;
        step.footprint_turn_rad = footprint_turn_rad;
        step.heights = self.gap_mm(step.tilt_rad, footprint_mm, footprint_turn_rad);
        step.lowest = lowest(&step.heights);
        let under = (0..cells * cells).filter(|&place| step.heights[place] < step.depth_mm);
        step.bounds = step.bounds.with(under, cells);
        self.open(step);
        Ok(false)
    }

    /// Takes over a settled step that ended with the indenter at `at_mm` and `turn_rad`: tractions, motion and
    /// how far it slid over the gel.
    pub(crate) fn accept(&mut self, step: &Step, at_mm: [f64; 2], turn_rad: f64) {
        let truth = &mut self.truth;
        truth.pressure.fill(0.0);
        truth.shear.fill(Pair::default());
        truth.slope_traction.fill(Pair::default());
        for (cell, &place) in step.places.iter().enumerate() {
            truth.pressure[place] = step.pressure[cell];
            truth.shear[place] = step.shear[cell];
            truth.slope_traction[place] = step.slope_traction[cell];
        }
        // Share of the friction at every place of the gel; empty when it is even.
        let mut shares = Vec::new();
        if !step.texture.is_empty() {
            shares.resize(truth.pressure.len(), 1.0);
            for (&place, share) in step.places.iter().zip(&step.texture) {
                shares[place] = *share;
            }
        }
        let weighed = |(p, share): (&f64, &f64)| p * share;
        let touched = step.pressure.iter().sum::<f64>();
        self.mean_share = if step.texture.is_empty() || touched <= 0.0 {
            1.0
        } else {
            step.pressure.iter().zip(&step.texture).map(weighed).sum::<f64>() / touched
        };
        let old = truth.pose;
        truth.pose = Pose {
            at_mm,
            depth_mm: step.depth_mm,
            turn_rad,
            tilt_rad: step.tilt_rad,
        };
        let shift = Pair::new(at_mm[0] - old.at_mm[0], at_mm[1] - old.at_mm[1]);
        let turn = turn_rad - old.turn_rad;
        let asked = |cell: usize| shift + step.arm[cell].scale(turn);
        let made = |cell: usize| step.after[cell] - step.before[cell];
        let (mut followed, mut moved) = (0.0, 0.0);
        for (cell, p) in step.pressure.iter().enumerate() {
            followed += p * (asked(cell).conj() * made(cell)).re;
            moved += p * asked(cell).norm_sqr();
        }
        let slip = Motion::of(&step.pressure, &step.arm, |cell| asked(cell) - made(cell));
        self.slip_mm = [slip.shift.re, slip.shift.im, slip.turn_rad * slip.radius_mm];
        truth.footprint_mm = step.footprint_mm;
        self.footprint_turn_rad = step.footprint_turn_rad;
        truth.slip_distance_mm += slip.shift.norm();
        truth.residuals = step.residuals;
        let still = STILL_MM * STILL_MM * step.pressure.iter().sum::<f64>();
        let follows = (moved > still).then(|| followed / moved);
        self.sliding = follows.map_or(0.0, |share| (1.0 - share).clamp(0.0, 1.0));
        let friction = self.friction;
        truth.classify(
            |place| friction * shares.get(place).copied().unwrap_or(1.0),
            follows,
        );
        self.drive = Drive {
            press: step.press,
            at_mm,
            turn_rad,
            tilt_rad: step.tilt_rad,
        };
    }

    /// By how much the indenter slid over the gel in the last step, mm: pressure-weighted mean along x and y, and the spin at the
    /// contact's radius of gyration.
    pub(crate) fn slip_mm(&self) -> Triple {
        self.slip_mm
    }

    /// Mean of the texture over the contact, weighted with the pressure; 1 when friction is even.
    pub(crate) fn mean_share(&self) -> f64 {
        self.mean_share
    }

    /// The gel under it.
    pub(crate) fn gel(&self) -> &Gel {
        self.surface.gel()
    }

    /// True friction.
    pub(crate) fn friction(&self) -> f64 {
        self.friction
    }
}

/// The rigid motion nearest to a field on the contact, weighted with the pressure.
struct Motion {
    /// Mean, mm.
    shift: Pair,
    turn_rad: f64,
    /// The contact's radius of gyration, mm.
    radius_mm: f64,
}

impl Motion {
    fn of(pressure: &[f64], arm: &[Pair], field: impl Fn(usize) -> Pair) -> Self {
        let (mut weight, mut shift, mut mean_arm) = (0.0, Pair::default(), Pair::default());
        for (cell, p) in pressure.iter().enumerate() {
            weight += p;
            shift += field(cell).scale(*p);
            mean_arm += arm[cell].scale(*p);
        }
        shift /= weight;
        mean_arm /= weight;
        let (mut spin, mut inertia) = (0.0, 0.0);
        for (cell, p) in pressure.iter().enumerate() {
            let arm = arm[cell] - mean_arm;
            spin += p * (arm.conj() * (field(cell) - shift)).re;
            inertia += p * arm.norm_sqr();
        }
        Self {
            shift,
            turn_rad: if inertia > 0.0 { spin / inertia } else { 0.0 },
            radius_mm: (inertia / weight).sqrt(),
        }
    }
}

fn lowest(heights: &[f64]) -> usize {
    (0..heights.len()).fold(
        0,
        |low, place| {
            if heights[place] < heights[low] { place } else { low }
        },
    )
}

/// Sum of tractions and of their moments, per area of a cell.
fn sum_and_moment(tractions: &[Pair], arm: &[Pair]) -> (Pair, f64) {
    let each = tractions.iter().zip(arm);
    each.fold((Pair::default(), 0.0), |(sum, moment), (q, arm)| {
        (sum + q, moment + (arm.conj() * q).re)
    })
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
