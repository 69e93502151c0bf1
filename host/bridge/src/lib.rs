//! The command line and the daemon of Gripline: camera frames in, force maps out to the microcontroller, and everything
//! visible on the way.
//!
//! [`run`] joins a [`source`] of pictures, the pipeline, the link and the [`view`]; [`commands`] holds the command line and
//! the other commands. What a run is to do stands in one file, which [`config`] reads and checks. Networks, links,
//! cameras, recordings and experiments are crates of their own.
#![deny(unsafe_code)]

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
