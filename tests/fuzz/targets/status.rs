//! The fuzzer's way into the body that the ordinary tests run over the corpus too.
#![no_main]

#[path = "../bodies/status.rs"]
mod status;

libfuzzer_sys::fuzz_target!(|input: &[u8]| status::check(input));
