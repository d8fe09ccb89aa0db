//! Target for the reader `fc3d` of `cd_tests::fuzzing::readers`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    cd_tests::fuzzing::readers::read("fc3d", bytes);
});
