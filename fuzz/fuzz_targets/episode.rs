#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| hksl_tests::untrusted::episode(bytes));
