#![no_main]

#[path = "../../crates/farsight-methods/tests/laws/mod.rs"]
mod laws;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| laws::model(bytes));
