//! Two fingertips that hold an object: contact with friction on both, the object's mass, a gripper that follows
//! a grip-force line, an arm that moves, pulls and twists, a table; closed loop against any detector and
//! controller. Units: mm, N, N·mm, s, rad; masses in g. Limits: the object moves in the plane of the fingers
//! (x, y and turn about the grip axis), the gels are quasi-static, both fingers press alike, a pad ends with its
//! sensing surface: what hangs over its edge touches nothing. A frame takes about 0.4 ms on a grid of 40 cells and
//! 1.7 ms on 80 (one core at 3.6 GHz).
//!
//! `setting` is what happens, `object`, `gripper`, `friction`, `arm` and `course` its parts; `world` runs it, with `rigid_body` (the
//! object's dynamics) and `fingers` (both contacts and the object in one solve: `solver` with the layer, `brush` with springs); `frame` is what comes out, `policy`
//! who decides.

mod arm;
mod brush;
mod course;
mod fingers;
mod frame;
mod friction;
mod gripper;
mod object;
mod policy;
mod rigid_body;
mod setting;
mod solver;
mod world;

pub use arm::{ArmMotion, Stroke};
pub use course::Course;
pub use frame::{FingerTruth, GraspFrame, ObjectState};
pub use friction::FrictionLaw;
pub use gripper::Gripper;
pub use object::{OBJECTS, Object, Patch};
pub use policy::{FixedForce, GraspView, GripPolicy, Oracle};
pub use setting::{ContactModel, GraspScene, Phase, Pull, Table};
pub use world::{GraspParts, GraspWorld};
