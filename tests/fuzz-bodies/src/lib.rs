//! What must hold for any bytes, a module for each fuzz target. The fuzzers (`cargo xtask fuzz`) call these functions, and
//! so do the ordinary tests, over the corpus and its mutations (`tests/tests/it/fuzz_corpus.rs`).
#![forbid(unsafe_code)]
#![allow(
    clippy::missing_panics_doc,
    reason = "these are checks: they panic when one does not hold"
)]

pub mod commands;
pub mod http;
pub mod modbus;
pub mod settings;
pub mod status;
pub mod stream;
pub mod wire;
