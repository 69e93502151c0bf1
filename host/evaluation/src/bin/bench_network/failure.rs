//! How a measurement fails.

/// Whatever stops the measurement; it is printed and nothing else.
pub(crate) type Failure = Box<dyn std::error::Error>;
