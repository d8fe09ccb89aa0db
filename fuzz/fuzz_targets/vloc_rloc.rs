//! Target for the reader `vloc_rloc` of `cd_tests::fuzzing::readers`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    cd_tests::fuzzing::readers::read("vloc_rloc", bytes);
});
