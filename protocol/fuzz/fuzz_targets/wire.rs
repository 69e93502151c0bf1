//! The fuzzer's way into the body that the ordinary tests run over the corpus too.
#![no_main]

#[path = "../body.rs"]
mod body;

libfuzzer_sys::fuzz_target!(|input: &[u8]| body::check(input));
