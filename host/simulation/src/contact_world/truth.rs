//! What is true of a contact at one instant: tractions, which cells stick and slip, the taxel sums that a
//! sensor should report, and the indenter's motion. Units: mm, N, MPa, N·mm, rad. Forces are what the object
//! exerts on the gel, given at the gel's rest positions.

use super::convolution::Pair;
use crate::constants::{FIELD_CELLS, FIELD_PITCH_MM, HALF_SURFACE_MM, TAXEL_COUNT, TAXELS};
use crate::force_map::ForceMap;
use crate::gel::Gel;

/// A cell within this share of its friction bound is at it.
const BOUND_SHARE: f64 = 1.0 - 1e-6;
/// Fewer sticking cells than this share of the contact: it slides as a whole.
const GROSS_STICK_RATIO: f64 = 0.01;
/// The gel follows less than this share of the indenter's motion where hardly a cell sticks: it slides as a whole,
/// about a point that stands still.
const GROSS_FOLLOW: f64 = 0.05;
/// Share of sticking cells under which hardly one does. Gel that gives back while the load goes does not follow
/// either, and sticks.
const HARDLY_STICKS: f64 = 0.1;
/// Share of sticking cells that ends a slide of the whole contact. Fewer do not: gel that comes in at the leading edge, without
/// shear, sticks until it has been drawn along as far as friction's limit.
const END_STICK_RATIO: f64 = 0.5;
/// A contact in which less sticks and the gel follows less than this share of the indenter's motion holds no longer, or not yet: it may
/// slide as a whole, with fresh gel at its leading edge, or creep while the grip opens.
const HOLDS_FOLLOW: f64 = 0.5;
/// Creep goes less far than this over gel, mm: what does not hold and goes further slides as a whole.
const CREEP_MM: f64 = 0.5;

/// What one cell of the gel does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CellState {
    /// Nothing touches it.
    #[default]
    Free,
    /// It carries less shear than friction allows and moves with the indenter.
    Stick,
    /// It carries all the shear that friction allows.
    Slip,
}

/// Where the indenter is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose {
    /// Its origin over the gel at rest, mm.
    pub at_mm: [f64; 2],
    /// Depth of its lowest plane under the gel at rest, mm; 0 if it was lifted off by force.
    pub depth_mm: f64,
    /// Its turn about z, from x to y, rad.
    pub turn_rad: f64,
    /// Slope of its lowest plane along x and y; positive presses the +x (+y) side deeper.
    pub tilt_rad: [f64; 2],
}

/// How well a step's equations are met, each a share of its natural size.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Residuals {
    /// Gap in contact, or penetration outside, over the deepest indentation.
    pub gap: f64,
    /// Change of the shear by a further gradient step, over the friction bound.
    pub friction: f64,
    /// Rounds between the normal and the tangential problem.
    pub rounds: usize,
    /// Steps of the normal solver, all rounds together.
    pub normal_iterations: usize,
    /// Steps of the tangential solver, all rounds together.
    pub tangential_iterations: usize,
}

/// A contact at one instant.
#[derive(Debug, Clone)]
pub struct Truth {
    pub(crate) cells: usize,
    pub(crate) pitch_mm: f64,
    pub(crate) pressure: Vec<f64>,
    /// Friction's share of the tangential traction.
    pub(crate) shear: Vec<Pair>,
    /// The pressure's: it acts along the indenter's normal.
    pub(crate) slope_traction: Vec<Pair>,
    pub(crate) states: Vec<CellState>,
    pub(crate) pose: Pose,
    pub(crate) footprint_mm: [f64; 2],
    pub(crate) slip_distance_mm: f64,
    /// The slip distance until which the contact last held.
    held_mm: f64,
    pub(crate) gross_slip: bool,
    pub(crate) residuals: Residuals,
}

impl Truth {
    /// Nothing touches a gel of `cells` by `cells`.
    pub(crate) fn free(cells: usize, pose: Pose) -> Self {
        Self {
            cells,
            pitch_mm: 2.0 * HALF_SURFACE_MM / cells as f64,
            pressure: vec![0.0; cells * cells],
            shear: vec![Pair::default(); cells * cells],
            slope_traction: vec![Pair::default(); cells * cells],
            states: vec![CellState::Free; cells * cells],
            pose,
            footprint_mm: pose.at_mm,
            slip_distance_mm: 0.0,
            held_mm: 0.0,
            gross_slip: false,
            residuals: Residuals::default(),
        }
    }

    /// The same contact seen in a mirror that turns x around.
    pub(crate) fn mirrored(&self) -> Self {
        let mut other = self.clone();
        for row in 0..self.cells {
            for column in 0..self.cells {
                let (here, there) = (row * self.cells + column, (row + 1) * self.cells - 1 - column);
                other.pressure[here] = self.pressure[there];
                other.states[here] = self.states[there];
                other.shear[here] = Pair::new(-self.shear[there].re, self.shear[there].im);
                other.slope_traction[here] =
                    Pair::new(-self.slope_traction[there].re, self.slope_traction[there].im);
            }
        }
        other.pose.at_mm[0] *= -1.0;
        other.pose.tilt_rad[0] *= -1.0;
        other.pose.turn_rad *= -1.0;
        other.footprint_mm[0] *= -1.0;
        other
    }

    /// Sorts the cells by what they do under the friction of each, and says whether they slide as a whole, which depends on whether they
    /// did in the step before and on how far it has gone since it held; `follow` is the share of the indenter's motion in this step that
    /// the gel made too, none without motion.
    pub(crate) fn classify(&mut self, friction: impl Fn(usize) -> f64, follow: Option<f64>) {
        let cells = self.states.iter_mut().zip(&self.pressure).zip(&self.shear);
        for (place, ((state, p), q)) in cells.enumerate() {
            let bound = friction(place) * p * BOUND_SHARE;
            *state = if *p <= 0.0 {
                CellState::Free
            } else if q.norm_sqr() < bound * bound {
                CellState::Stick
            } else {
                CellState::Slip
            };
        }
        let stick_ratio = self.stick_ratio();
        let sticks_less = |share: f64| stick_ratio.is_some_and(|ratio| ratio < share);
        let runs_ahead = follow.is_some_and(|share| share < GROSS_FOLLOW);
        let holds = !sticks_less(END_STICK_RATIO) || follow.is_none_or(|share| share > HOLDS_FOLLOW);
        if holds {
            self.held_mm = self.slip_distance_mm;
        }
        let begins = sticks_less(GROSS_STICK_RATIO)
            || (runs_ahead && sticks_less(HARDLY_STICKS))
            || self.slip_distance_mm - self.held_mm > CREEP_MM;
        let goes_on = self.gross_slip && follow.is_some() && sticks_less(END_STICK_RATIO);
        self.gross_slip = begins || goes_on;
    }

    /// Whether anything touches.
    #[must_use]
    pub fn in_contact(&self) -> bool {
        self.pressure.iter().any(|p| *p > 0.0)
    }

    /// Cells along one side of the grid; the grids here are row-major, rows along y.
    #[must_use]
    pub fn cells(&self) -> usize {
        self.cells
    }

    /// Side of a cell, mm.
    #[must_use]
    pub fn pitch_mm(&self) -> f64 {
        self.pitch_mm
    }

    /// Pressure on every cell, MPa.
    #[must_use]
    pub fn pressure_mpa(&self) -> &[f64] {
        &self.pressure
    }

    /// Tangential traction on cell `cell`, MPa: friction and the pressure's share along the indenter's slope.
    #[must_use]
    pub fn shear_mpa(&self, cell: usize) -> [f64; 2] {
        let all = self.shear[cell] + self.slope_traction[cell];
        [all.re, all.im]
    }

    /// Friction on cell `cell`, MPa: at most the friction coefficient times the pressure.
    #[must_use]
    pub fn friction_mpa(&self, cell: usize) -> [f64; 2] {
        [self.shear[cell].re, self.shear[cell].im]
    }

    /// What every cell does.
    #[must_use]
    pub fn states(&self) -> &[CellState] {
        &self.states
    }

    /// Share of the contact's cells that stick, 0 to 1; none when nothing touches.
    #[must_use]
    pub fn stick_ratio(&self) -> Option<f64> {
        let count = |wanted: CellState| self.states.iter().filter(|s| **s == wanted).count();
        let (stick, slip) = (count(CellState::Stick), count(CellState::Slip));
        (stick + slip > 0).then(|| stick as f64 / (stick + slip) as f64)
    }

    /// Whether the contact slides as a whole: no cell sticks, or the gel does not follow the indenter, or the contact has gone further
    /// than creep goes, or it has slid since and half of it does not stick yet.
    #[must_use]
    pub fn gross_slip(&self) -> bool {
        self.gross_slip
    }

    /// Contact area, mm².
    #[must_use]
    pub fn area_mm2(&self) -> f64 {
        self.pressure.iter().filter(|p| **p > 0.0).count() as f64 * self.pitch_mm * self.pitch_mm
    }

    /// Sum of forces, N: x, y, z into the gel.
    #[must_use]
    pub fn force_n(&self) -> [f64; 3] {
        let shear: Pair = self.shear.iter().chain(&self.slope_traction).sum();
        let area = self.pitch_mm * self.pitch_mm;
        [
            shear.re * area,
            shear.im * area,
            self.pressure.iter().sum::<f64>() * area,
        ]
    }

    /// Moment about the normal through `about_mm`, M = Σ(x f_y − y f_x), N·mm.
    #[must_use]
    pub fn torsional_moment_nmm(&self, about_mm: [f64; 2]) -> f64 {
        let mut sum = 0.0;
        for cell in 0..self.shear.len() {
            let ([x, y], [qx, qy]) = (self.place_mm(cell), self.shear_mpa(cell));
            sum += (x - about_mm[0]) * qy - (y - about_mm[1]) * qx;
        }
        sum * self.pitch_mm * self.pitch_mm
    }

    /// Where the normal force acts, mm; none when nothing touches.
    #[must_use]
    pub fn pressure_centre_mm(&self) -> Option<[f64; 2]> {
        let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
        for (cell, p) in self.pressure.iter().enumerate() {
            let [at_x, at_y] = self.place_mm(cell);
            sum += p;
            x += p * at_x;
            y += p * at_y;
        }
        (sum > 0.0).then(|| [x / sum, y / sum])
    }

    /// Middle of a cell, mm.
    #[must_use]
    pub fn place_mm(&self, cell: usize) -> [f64; 2] {
        [cell % self.cells, cell / self.cells].map(|i| (i as f64 + 0.5) * self.pitch_mm - HALF_SURFACE_MM)
    }

    /// Where the indenter is.
    #[must_use]
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// Depth of the indenter over the thickness of `gel`: beyond [`LARGEST_INDENTATION`] the linear layer is not
    /// the gel any more.
    ///
    /// [`LARGEST_INDENTATION`]: crate::constants::LARGEST_INDENTATION
    #[must_use]
    pub fn indentation_share(&self, gel: &Gel) -> f64 {
        self.pose.depth_mm.max(0.0) / gel.thickness_mm
    }

    /// Where the indenter's origin stands on the gel at rest, mm: its place less the gel's mean shift.
    #[must_use]
    pub fn footprint_mm(&self) -> [f64; 2] {
        self.footprint_mm
    }

    /// Distance slid over the gel since the indenter touched, mm (mean over the contact).
    #[must_use]
    pub fn slip_distance_mm(&self) -> f64 {
        self.slip_distance_mm
    }

    /// How well the step's equations are met.
    #[must_use]
    pub fn residuals(&self) -> Residuals {
        self.residuals
    }

    /// Taxel sums of the tractions, N.
    #[must_use]
    pub fn force_map(&self) -> ForceMap {
        let per_taxel = self.cells / TAXELS;
        let mut sums = [[0.0_f64; 3]; TAXEL_COUNT];
        self.each_force(Self::shear_mpa, |row, column, force| {
            let taxel = &mut sums[row / per_taxel * TAXELS + column / per_taxel];
            for (sum, more) in taxel.iter_mut().zip(force) {
                *sum += more;
            }
        });
        sums.map(|taxel| taxel.map(|v| v as f32))
    }

    /// Adds the forces that strain the gel to the grid of the field inside it, whose cells this grid divides, N:
    /// all but the pressure's share along the slope.
    pub(crate) fn add_field_forces(&self, out: &mut [[f32; 3]]) {
        let per_cell = (FIELD_PITCH_MM / self.pitch_mm).round() as usize;
        let margin = (FIELD_CELLS - self.cells / per_cell) / 2;
        self.each_force(Self::friction_mpa, |row, column, force| {
            let cell = &mut out[(margin + row / per_cell) * FIELD_CELLS + margin + column / per_cell];
            for (sum, more) in cell.iter_mut().zip(force) {
                *sum += more as f32;
            }
        });
    }

    /// Calls `f` with row, column and force of every cell that something touches.
    fn each_force(
        &self,
        tangential_mpa: impl Fn(&Self, usize) -> [f64; 2],
        mut f: impl FnMut(usize, usize, [f64; 3]),
    ) {
        let area = self.pitch_mm * self.pitch_mm;
        for (cell, p) in self.pressure.iter().enumerate() {
            if *p > 0.0 {
                let [x, y] = tangential_mpa(self, cell);
                f(
                    cell / self.cells,
                    cell % self.cells,
                    [x * area, y * area, p * area],
                );
            }
        }
    }
}
