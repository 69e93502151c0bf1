//! Tests that cross crates stand in this package's `tests` folder; there is nothing to use here.
#![forbid(unsafe_code)]
