//! ROS 2 without ROS: the messages of a fingertip, how they are written (CDR), and a recording as a bag. The live side is the crate
//! `gripline-ros2`; both use these messages.
//!
//! The frame of a fingertip: origin at the centre of the map on the skin, x to the right and y up as seen from outside, z out of
//! the skin, so that it is right-handed. A contact that presses has a negative z force.

mod bag;
mod cdr;
mod definitions;
mod messages;
mod names;
mod options;
mod sample;

pub use self::bag::Bag;
pub use self::cdr::{CdrError, to_cdr};
pub use self::messages::{
    DiagnosticArray, DiagnosticStatus, Header, Image, KeyValue, Level, SLIP_STATES, Slip, Time, Vector3,
    Wrench, WrenchStamped,
};
pub use self::names::{BadName, Namespace};
pub use self::options::{Range, Rmw};
pub use self::sample::{Sample, faults_status};
