//! How a section of the program fails.

pub(crate) type Failure = Box<dyn std::error::Error + Send + Sync>;
