//! Every integration test of the program and its library, in one binary: linking the whole bridge takes seconds.

mod calibrate;
mod config;
#[cfg(unix)]
mod control;
mod detect;
mod doctor;
mod evaluate;
mod faults;
mod foxglove;
mod gate;
mod health;
mod infer;
mod link;
mod own_sensor;
mod page;
mod program;
mod recording;
mod ros2;
mod run;
mod run_loop;
mod sensor;
#[cfg(unix)]
mod serial_board;
mod session;
mod setup;
mod simulate;
mod source;
#[cfg(target_os = "linux")]
mod terminal;
mod two_fingertips;
