//! Damaged files, read by each reader of input, see `cd_tests::fuzzing`; prints counts and failures.
//!
//!     cargo run --release --package cd-tests --example fuzz -- --inputs 1000000
//!
//! Options: `--inputs` and `--seconds` limit each reader, `--seed` is the seed of all damage, `--readers a,b` names readers,
//! `--found FOLDER` is the folder for inputs that fail, `--trace FILE` the file for each input before it is read.

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use cd_tests::fuzzing::memory::CountingAllocator;
use cd_tests::fuzzing::readers::READERS;
use cd_tests::fuzzing::trials::fuzz;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

fn main() {
    let (mut inputs, mut seconds, mut seed, mut names) = (100_000, f64::INFINITY, 1, String::new());
    let (mut found, mut trace): (PathBuf, Option<PathBuf>) = ("target/fuzz-found".into(), None);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().unwrap_or_else(|| panic!("{word}: no value"));
        let number = || value.parse().unwrap_or_else(|_| panic!("{word}: {value}; expected a number"));
        match word.as_str() {
            "--inputs" => inputs = number(),
            "--seconds" => seconds = value.parse().unwrap_or_else(|_| panic!("{word}: {value}; expected a number")),
            "--seed" => seed = number(),
            "--readers" => names = value,
            "--found" => found = value.into(),
            "--trace" => trace = Some(value.into()),
            _ => panic!("{word}: unknown; expected --inputs, --seconds, --seed, --readers, --found or --trace"),
        }
    }
    let time = Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX);
    let (mut total, mut failures) = (0, 0);
    for reader in READERS.iter().filter(|reader| names.is_empty() || names.split(',').any(|name| name == reader.name)) {
        let report = fuzz(reader, inputs, time, seed, trace.as_deref());
        println!("{}", report.text());
        for (k, (fault, input)) in report.failures.iter().enumerate() {
            let path = found.join(format!("{}-{seed}-{k}", reader.name));
            fs::create_dir_all(&found).expect("a folder for the inputs that fail");
            fs::write(&path, input).expect("a file in it");
            println!("failed: {}: {fault}", path.display());
        }
        total += report.inputs;
        failures += report.failures.len();
    }
    println!("{total} inputs, {failures} failures");
    std::process::exit(i32::from(failures > 0));
}
