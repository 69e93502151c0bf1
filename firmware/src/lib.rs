//! The microcontroller's whole program without the silicon: packets in, grip force out.
//!
//! The host runs the very same code: in tests, in the in-process controller of `gripline run`, and as the shadow that
//! checks every answer of the real one.
//!
//! [`friction`] decides about a taxel, [`sums`] about a map, [`slip`] about the contact, [`grip`] about the force,
//! [`safety`] about faults; [`mcu`] joins them. [`mod@line`] turns force into volts; [`robotiq`] speaks [`modbus`] to
//! a gripper that has a bus instead of a voltage input. [`storage`] keeps the settings over a power cycle.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod carry;
pub mod clock;
pub mod constants;
mod divide;
mod form;
pub mod friction;
pub mod grip;
pub mod line;
mod load;
pub mod mcu;
pub mod modbus;
pub mod robotiq;
pub mod safety;
pub mod slip;
pub mod storage;
pub mod sums;

pub use friction::Friction;
pub use grip::GripForce;
pub use mcu::{Action, Mcu, ResetCause, Start};
pub use safety::Fault;
