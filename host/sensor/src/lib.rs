//! What is particular to a fingertip, as one TOML file says it: pictures, view, gel, markers, taxels, health limits.
//!
//! [`Sensor::named`] reads a shipped description or a file; a file that lacks a key, has an unknown one or an implausible value is
//! refused with every problem named ([`SensorError`]). Units stand in the names. Limits: one camera, one gel, a rectangular crop.
#![forbid(unsafe_code)]

mod description;
mod error;
mod file;
mod plausible;
mod table;

pub use description::{
    Capture, Colour, Flip, Forces, Gel, Health, Lens, MarkerKind, Markers, Polarity, Sensor, Taxels, View,
};
pub use error::{Problem, SensorError};
pub use file::SHIPPED;
