//! What can go wrong.

use std::fmt;

/// Something that ROS 2 or the system refused.
#[derive(Debug, thiserror::Error)]
#[error(
    "ROS 2, {what}: {why}, expected a DDS domain and a network that this machine can use: see ros2.domain and ros2.range"
)]
pub struct Ros2Error {
    what: String,
    why: String,
}

impl Ros2Error {
    pub(crate) fn of<E: fmt::Display>(kind: &str, name: &str) -> impl Fn(E) -> Self {
        let what = format!("{kind} {name}");
        move |error| Self {
            what: what.clone(),
            why: error.to_string(),
        }
    }
}
