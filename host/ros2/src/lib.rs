//! A running bridge in ROS 2, over DDS in Rust: no ROS installation, no C. Per fingertip the topics `wrench`, `force_map` and `slip`;
//! `/diagnostics`; services that ask the gripper for something. docs/ros2.md has names, types, QoS and frames; the interface
//! package for ROS is `gripline_msgs` in this folder.
//!
//! The control loop never waits: it leaves its newest frame in a place of one, and threads of this crate do the rest.
#![forbid(unsafe_code)]

mod diagnostics;
mod error;
mod mailbox;
mod node;
mod publisher;
mod services;
mod types;

pub use self::error::Ros2Error;
pub use self::node::{Ros2Node, Settings};
