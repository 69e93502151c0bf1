//! Live values for other programs: over HTTP (the crate `gripline-live`, which also serves the page and takes requests), and of
//! many grippers in one place over zenoh, in ROS 2, and in Foxglove. The loop waits for none of them.

pub(crate) mod fleet;
pub(crate) mod foxglove;
pub(crate) mod ros2;

pub(crate) use gripline_live::{FrameView, Live, QUANTILES, Values};
