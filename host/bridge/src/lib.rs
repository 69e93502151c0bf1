//! The host daemon and command line of Gripline: camera frames in, force maps out to the microcontroller, and
//! everything visible on the way.
//!
//! [`pipeline`] turns a picture into a force map (scene gate and health, network, quantisation with [`rounding`]); [`link`] carries packets to a
//! microcontroller; [`session`] speaks the protocol over a link, meets a restarted one anew and checks every answer
//! ([`shadow`]); [`run`] joins
//! them with a [`source`] of pictures (simulated, or of a camera or files: [`capture`]) and the [`view`]; [`infer`] and [`detect`] run the network over recorded
//! pictures and the detector over recorded maps;
//! [`simulate`] plays a scene of the simulated world into files. What a run is to do stands in one file, which
//! [`config`] reads and checks; [`shell`] makes manual pages and completions.
//! [`faults`] shows what the microcontroller has against going on, and acknowledges it.
//! [`recording`] keeps what a run saw and decided, and replays it;
//! [`plot`] draws it; [`evaluate`] measures how well all of it works.
#![deny(unsafe_code)]

// Tests in here share a made-up world with those that see only the public side.
#[cfg(test)]
extern crate self as gripline;

mod acquaintance;
pub mod calibrate;
mod calibration;
pub mod capture;
pub mod cli;
mod clock_watch;
pub mod config;
mod cycle;
pub mod detect;
pub mod doctor;
pub mod error;
pub mod evaluate;
pub mod faults;
pub mod infer;
pub mod link;
mod live;
pub mod mailbox;
pub mod maps_file;
pub mod pipeline;
pub mod plot;
mod realtime;
pub mod recording;
pub mod rounding;
pub mod run;
pub mod session;
pub mod shadow;
pub mod shell;
pub mod simulate;
mod skin;
pub mod source;
pub mod stats;
pub mod telemetry;
pub mod units;
pub mod view;
