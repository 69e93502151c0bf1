//! The fuzzer's way into the body that the ordinary tests run over the corpus too.
#![no_main]

#[path = "../bodies/jpeg.rs"]
mod jpeg;

libfuzzer_sys::fuzz_target!(|input: &[u8]| jpeg::check(input));
