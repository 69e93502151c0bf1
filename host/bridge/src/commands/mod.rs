//! The commands, one module each, and the command line that chooses between them.

pub mod calibrate;
pub mod cli;
pub mod config;
pub mod detect;
mod device;
pub mod doctor;
pub mod evaluate;
pub mod export;
pub mod faults;
pub(crate) mod files;
pub mod flash;
pub mod infer;
pub mod plot;
pub mod replay;
pub mod sensor;
pub mod setup;
pub mod shell;
pub mod simulate;
