//! What is true of a grasp at one instant. Units: mm, N, N·mm, s, rad. Forces are what the object exerts on a
//! gel, in that finger's own frame: finger 1 looks at finger 0, so its x points the other way.

use std::borrow::Cow;

use crate::force_map::ForceMap;

/// What is true of one finger.
#[derive(Debug, Clone, PartialEq)]
pub struct FingerTruth {
    /// Whether anything touches it.
    pub touching: bool,
    /// Newtons per taxel.
    pub forces: ForceMap,
    /// Their sum, N: x, y, z into the gel.
    pub force_n: [f64; 3],
    /// Moment about the normal through the grip point, N·mm.
    pub torsional_moment_nmm: f64,
    /// Share of the contact that sticks; none when nothing touches.
    pub stick_ratio: Option<f64>,
    /// Whether the contact slides as a whole now.
    pub gross_slip: bool,
    /// Friction of the contact now, if it sticks and if it slides fast: the object's under the finger's law.
    pub friction: [f64; 2],
    /// Speed of the object over the gel: pressure-weighted mean of sliding with the spin at the contact's
    /// radius of gyration, over the last frame, mm/s.
    pub slip_speed_mm_per_s: f64,
    /// Distance slid over the gel since it was touched, spin included in the same way, mm.
    pub slip_mm: f64,
    /// Where the grip point stands on the gel at rest, mm.
    pub footprint_mm: [f64; 2],
}

/// Where the object is and how it moves, seen from the gripper (finger 0's frame).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ObjectState {
    /// Its grip point, mm.
    pub at_mm: [f64; 2],
    /// Its turn from x to y, rad.
    pub turn_rad: f64,
    /// Velocity of the grip point, mm/s.
    pub velocity_mm_per_s: [f64; 2],
    /// Spin, rad/s.
    pub spin_rad_per_s: f64,
}

/// One frame of a grasp.
#[derive(Debug, Clone, PartialEq)]
pub struct GraspFrame {
    /// Time since the scene began, s.
    pub time_s: f64,
    /// What the scene is doing.
    pub phase: Cow<'static, str>,
    /// The grip-force line that was set for this frame, N.
    pub line_n: f64,
    /// What every finger presses with, N.
    pub grip_n: f64,
    /// Both fingers.
    pub fingers: [FingerTruth; 2],
    /// The object against the gripper.
    pub object: ObjectState,
    /// What weight, the arm's acceleration, pulls and table do to the object at the grip point: N, N, N·mm. The
    /// fingers hold it less what accelerates the object against them.
    pub load: [f64; 3],
    /// The label SLIP: in this frame the object slid in the grip, over both gels as a whole and faster
    /// than `constants::SLIP_SPEED_MM_PER_S`. While one finger still holds, the other's slip is in its `gross_slip`.
    pub slip: bool,
    /// When in this frame the object first began and last ceased to slide over both gels as a whole, faster
    /// than `constants::SLIP_SPEED_MM_PER_S` in a step, s; none when it did not.
    pub slid_s: Option<[f64; 2]>,
    /// Whether the table carries any of it.
    pub on_table: bool,
    /// Whether it has left the grip: slid too far from where it was gripped, or let go with nothing under it. It stays so.
    pub dropped: bool,
    /// Largest error of the balance of forces in this frame's steps, as a share of the largest load or of a
    /// twentieth of what friction can hold, whichever is more.
    pub balance: f64,
    /// Steps into which the frame was cut.
    pub steps: usize,
    /// Solves of a finger's shear in them.
    pub solves: usize,
}
