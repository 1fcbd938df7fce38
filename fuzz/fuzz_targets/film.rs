#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farsight_fuzz::law("film", bytes));
