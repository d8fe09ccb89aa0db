//! Target for the reader `tact_behav` of `cd_tests::fuzzing::readers`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    cd_tests::fuzzing::readers::read("tact_behav", bytes);
});
