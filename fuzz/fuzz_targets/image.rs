#![no_main]

#[path = "../../crates/farsight-data/tests/laws/mod.rs"]
mod laws;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| laws::image(bytes));
