//! Readers on damaged files: a small part of what `make fuzz` reads at length.

use std::time::Duration;

use cd_tests::fuzzing::memory::CountingAllocator;
use cd_tests::fuzzing::readers::READERS;
use cd_tests::fuzzing::trials::{FuzzOptions, fuzz, seed_folder, seeds};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// One test: the count of allocated bytes is that of the whole process.
#[test]
fn damaged_files_are_read_or_rejected_within_limits() {
    let mut failures = Vec::new();
    for reader in &READERS {
        let number = seeds(reader).len() as u64;
        let time = Duration::from_secs(20);
        let report = fuzz(reader, &FuzzOptions { inputs: number + 1000, time, seed: 1, length: 0, trace: None });
        println!("{}", report.text());
        let inputs =
            report.failures.iter().map(|(fault, input)| format!("{}: {fault}\n{}", reader.name, input.escape_ascii()));
        failures.extend(inputs);
        assert!(report.accepted > 0, "{}: none of the seeds is accepted", reader.name);
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn each_reader_has_seeds_and_a_target() {
    let names = |folder: &str| -> Vec<String> {
        let entries = std::fs::read_dir(seed_folder().join("..").join(folder)).unwrap().flatten();
        let mut names: Vec<String> = entries.map(|entry| entry.file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    let mut readers: Vec<String> = READERS.iter().map(|reader| reader.name.to_string()).collect();
    readers.sort();
    assert_eq!(names("seeds"), readers);
    assert_eq!(names("fuzz_targets"), readers.iter().map(|name| format!("{name}.rs")).collect::<Vec<_>>());
}
