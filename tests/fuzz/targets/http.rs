//! The fuzzer's way into a body that the ordinary tests run over the corpus too.
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| gripline_fuzz_bodies::http::check(input));
