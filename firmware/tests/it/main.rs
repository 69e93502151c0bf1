//! Every integration test of the firmware library, in one binary.

mod bad_moments;
mod bench;
mod calibration;
mod common;
mod evidence;
mod exactness;
mod grasp_world;
mod lines;
mod loss;
mod modbus;
mod program;
mod rs485;
mod sliding;
mod slipping_grasp;
mod storage;
