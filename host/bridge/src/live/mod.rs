//! Live values for other programs: over HTTP (the crate `gripline-live`, which also serves the page and takes requests), and of
//! many grippers in one place over zenoh. The loop waits for neither.

pub(crate) mod fleet;
pub(crate) mod ros2;

pub(crate) use gripline_live::{Live, Look, QUANTILES, Values};
