//! Live values for other programs: over HTTP (the crate `gripline-live`, which also serves the page and takes requests), and over
//! zenoh (many grippers in one place), ROS 2, and Foxglove. The loop waits for none of them.

pub(crate) mod fleet;
pub(crate) mod foxglove;
pub(crate) mod ros2;

pub(crate) use gripline_live::{FrameView, Live, QUANTILES, Values};
