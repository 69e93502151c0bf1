//! The fuzzer's way into the body that the ordinary tests run over the corpus too.
#![no_main]

#[path = "../bodies/commands.rs"]
mod commands;

libfuzzer_sys::fuzz_target!(|input: &[u8]| commands::check(input));
