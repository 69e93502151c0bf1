//! The fuzzer's way into the body that the ordinary tests run over the corpus too.
#![no_main]

#[path = "../bodies/settings.rs"]
mod settings;

libfuzzer_sys::fuzz_target!(|input: &[u8]| settings::check(input));
