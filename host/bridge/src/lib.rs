//! The command line and the daemon of Gripline: camera frames in, force maps out to the microcontroller, with everything visible to
//! the user.
//!
//! [`run`] connects a [`source`] of pictures, the pipeline, the link and the [`view`]; [`commands`] holds the command line and the
//! other commands. One file configures a run; [`config`] reads and checks it. Networks, links, cameras, recordings and experiments
//! are crates of their own.
#![forbid(unsafe_code)]

mod calibration;
pub mod commands;
pub mod config;
pub mod error;
mod live;
pub mod log;
mod marker_rest;
mod model;
mod realtime;
mod rest;
pub mod run;
pub mod source;
mod token;
mod value;
pub mod view;
mod writer;
