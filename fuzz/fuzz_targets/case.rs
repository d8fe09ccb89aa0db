//! Target for the reader `case` of `cd_tests::fuzzing::readers`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    cd_tests::fuzzing::readers::read("case", bytes);
});
