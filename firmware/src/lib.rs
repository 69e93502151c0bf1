//! The microcontroller's whole program without hardware access: packets in, grip force out.
//!
//! Hosts run the same code: in tests, in the in-process device of `gripline run`, and as the shadow that checks every
//! answer of the real one.
//!
//! [`friction`] judges a taxel, [`sums`] a map, [`slip`] the contact; [`grip`] sets the force, [`safety`] handles [faults](fault);
//! [`program`] combines them. [`mod@line`] turns force into volts, [`readback`] compares them with the measured line; [`robotiq`]
//! speaks [`modbus`] to a gripper on a bus, through an [`rs485`] transceiver. [`storage`] keeps the settings over a power cycle.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

mod arithmetic;
pub mod clock;
pub mod clock_sync;
pub mod constants;
mod contact_geometry;
pub mod fault;
pub mod friction;
pub mod friction_estimator;
pub mod grip;
mod learning_settings;
pub mod line;
pub mod link;
mod load;
pub mod modbus;
pub mod program;
pub mod readback;
pub mod robotiq;
pub mod rs485;
pub mod safety;
pub mod slide_witness;
pub mod slip;
mod slip_evidence;
pub mod storage;
pub mod sums;
mod unrest;

pub use clock::{DeviceMicros, HostMicros};
pub use fault::{Fault, FaultSet};
pub use friction::Friction;
pub use grip::GripForce;
pub use link::LinkId;
pub use program::{Action, Device, Program, ResetCause, Start};
