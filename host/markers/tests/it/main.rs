//! Every integration test of the markers, in one binary.

mod recordings;
mod synthetic;
