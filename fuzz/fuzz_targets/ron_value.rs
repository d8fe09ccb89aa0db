//! Target for the reader `ron_value` of `cd_tests::fuzzing::readers`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    cd_tests::fuzzing::readers::read("ron_value", bytes);
});
