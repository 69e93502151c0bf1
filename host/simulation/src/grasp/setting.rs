//! What happens in a grasp, given beforehand: object, gripper, arm, gravity, pulls, table, fingertips. Units:
//! mm, N, N·mm, s, rad; x to the right and y up in the plane of finger 0's gel. Limits: the grip axis is level.

use std::borrow::Cow;

use super::arm::ArmMotion;
use super::course::Course;
use super::friction::FrictionLaw;
use super::gripper::Gripper;
use super::object::Object;
use crate::constants::{GRASP_DROP_MM, TABLE_FRICTION, TABLE_STIFFNESS_N_PER_MM};
use crate::contact_world::production_cells;
use crate::error::{SimulationError, finite, not_negative, positive};
use crate::fingertip::FingertipParams;

/// A grasp presses with at least this much, N, for the choice of the grid.
const GRIPPED_N: f64 = 1.5;

/// A force and a moment on the object over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Pull {
    /// Force at share 1, N, in the plane of finger 0.
    pub force_n: [f64; 2],
    /// Moment at share 1, N·mm, from x to y.
    pub torsional_moment_nmm: f64,
    /// Where the force acts on the object, mm from the grip point; it turns with the object.
    pub at_mm: [f64; 2],
    /// Share over time.
    pub course: Course,
}

impl Pull {
    /// A force at the grip point.
    #[must_use]
    pub fn force(force_n: [f64; 2], course: Course) -> Self {
        Self {
            force_n,
            torsional_moment_nmm: 0.0,
            at_mm: [0.0; 2],
            course,
        }
    }

    /// A pure moment.
    #[must_use]
    pub fn torsion(torsional_moment_nmm: f64, course: Course) -> Self {
        Self {
            force_n: [0.0; 2],
            torsional_moment_nmm,
            at_mm: [0.0; 2],
            course,
        }
    }
}

/// The table that the object stands on when the scene begins; it lies under the object as gravity points then.
/// It holds against sliding and turning as far as its share of the weight allows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Table {
    /// Force per way of giving, N/mm.
    pub stiffness_n_per_mm: f64,
    /// Coulomb friction against the object.
    pub friction: f64,
}

impl Default for Table {
    fn default() -> Self {
        Self {
            stiffness_n_per_mm: TABLE_STIFFNESS_N_PER_MM,
            friction: TABLE_FRICTION,
        }
    }
}

/// What a part of the scene is called from a time on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Phase {
    /// Its name.
    pub name: Cow<'static, str>,
    /// Its start, microseconds.
    pub from_us: u64,
}

/// How the gels are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ContactModel {
    /// As an elastic layer: every cell moves every other.
    #[default]
    Layer,
    /// As springs, one a cell: rough, and much faster.
    Brush,
}

/// A grasp, as it is set up.
#[derive(Debug, Clone)]
pub struct GraspScene {
    /// What is grasped.
    pub object: Object,
    /// How friction differs from the object's, finger by finger.
    pub friction_laws: [FrictionLaw; 2],
    /// The object's mass over time, share of what it is: something is poured in. It spreads as the object's own mass.
    pub mass_share: Course,
    /// What grasps it.
    pub gripper: Gripper,
    /// How the arm moves.
    pub arm: ArmMotion,
    /// Turn of gravity from −y towards +x over time, rad: a gripper that turns about its grip axis, slowly.
    pub gravity_turn_rad: Course,
    /// What else pulls at the object.
    pub pulls: Vec<Pull>,
    /// What the object stands on at first.
    pub table: Option<Table>,
    /// Until then a hand holds the object where it is between the fingers, s.
    pub held_until_s: f64,
    /// Where on finger 0 the grip point lies at first, mm from the middle; on finger 1 opposite.
    pub grip_point_mm: [f64; 2],
    /// Turn of the object at first, rad.
    pub turn_rad: f64,
    /// Longest way that the object may go against the gripper in a step of the solver, mm; none is as far as the grid
    /// allows. Short ways tell the moment when it begins to slide.
    pub reach_mm: Option<f64>,
    /// An object that has slid this far from where a gel took it has left the grip, mm; what slid back has not.
    pub drop_mm: f64,
    /// Names over time, in order.
    pub phases: Vec<Phase>,
    /// The two fingertips; the first one's gel is that of both.
    pub fingertips: [FingertipParams; 2],
    /// How the gels are computed.
    pub contact: ContactModel,
    /// Cells along one side of the contact solver's grid; see `contact_world::production_cells`.
    pub cells: usize,
    /// Particles, light and noise of both fingertips follow from it.
    pub seed: u64,
}

impl GraspScene {
    /// `object` on a table, gripped in the middle of two default fingertips by the default gripper; nothing
    /// moves yet.
    #[must_use]
    pub fn new(object: Object) -> Self {
        Self {
            object,
            friction_laws: [FrictionLaw::default(), FrictionLaw::default()],
            mass_share: Course::constant(1.0),
            gripper: Gripper::default(),
            arm: ArmMotion::default(),
            gravity_turn_rad: Course::default(),
            pulls: Vec::new(),
            table: Some(Table::default()),
            held_until_s: 0.0,
            grip_point_mm: [0.0; 2],
            turn_rad: 0.0,
            reach_mm: None,
            drop_mm: GRASP_DROP_MM,
            phases: Vec::new(),
            fingertips: [FingertipParams::default(); 2],
            contact: ContactModel::default(),
            cells: production_cells(GRIPPED_N),
            seed: 1,
        }
    }

    /// What the scene is doing at `time_s`; empty before the first name.
    #[must_use]
    pub fn phase(&self, time_s: f64) -> Cow<'static, str> {
        let now_us = (time_s * 1e6).round() as u64;
        let after = self.phases.partition_point(|phase| phase.from_us <= now_us);
        after
            .checked_sub(1)
            .map_or(Cow::Borrowed(""), |now| self.phases[now].name.clone())
    }

    pub(crate) fn check(&self) -> Result<(), SimulationError> {
        self.object.check()?;
        self.friction_laws.iter().try_for_each(FrictionLaw::check)?;
        self.mass_share.check("mass_share")?;
        self.mass_share
            .values()
            .try_for_each(|share| positive("mass_share", share).map(drop))?;
        self.gripper.check()?;
        self.arm.check()?;
        self.gravity_turn_rad.check("gravity_turn_rad")?;
        for pull in &self.pulls {
            finite("pull force_n[0]", pull.force_n[0])?;
            finite("pull force_n[1]", pull.force_n[1])?;
            finite("pull torsional_moment_nmm", pull.torsional_moment_nmm)?;
            finite("pull at_mm[0]", pull.at_mm[0])?;
            finite("pull at_mm[1]", pull.at_mm[1])?;
            pull.course.check("pull course")?;
        }
        if let Some(table) = &self.table {
            positive("table stiffness_n_per_mm", table.stiffness_n_per_mm)?;
            not_negative("table friction", table.friction)?;
        }
        finite("grip_point_mm[0]", self.grip_point_mm[0])?;
        finite("grip_point_mm[1]", self.grip_point_mm[1])?;
        finite("turn_rad", self.turn_rad)?;
        not_negative("held_until_s", self.held_until_s)?;
        if let Some(reach_mm) = self.reach_mm {
            positive("reach_mm", reach_mm)?;
        }
        positive("drop_mm", self.drop_mm)?;
        Ok(())
    }
}
