//! `gripline evaluate`: how well slip is noticed and objects are held, in figures that anyone can make again.
//!
//! The paper's experiment ([`paper`]): [`plan`] says which runs, [`trial`] is one of them in the contact world, [`chain`]
//! takes it from picture to map, [`detectors`] judge the maps, [`judged`] and [`metrics`] count, [`report`] tells.
//! [`play`] plays a scene file frame by frame; [`grasps`] closes the loop; [`real`] does it with recorded trials;
//! [`skip`] says what skipping saves and changes. [`document`] keeps the sections of docs/evidence.md,
//! [`requirement`] says what must hold.
#![deny(unsafe_code)]

mod arguments;
pub mod calibration;
pub mod chain;
pub mod detect;
pub mod detectors;
pub mod document;
pub mod error;
pub mod grasps;
pub mod judged;
pub mod metrics;
pub mod paper;
pub mod plan;
pub mod play;
mod progress;
pub mod real;
pub mod report;
pub mod requirement;
pub mod skip;
pub mod trial;
