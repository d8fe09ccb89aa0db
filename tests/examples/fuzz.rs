//! Damaged files, read by each reader of input, see `cd_tests::fuzzing`; prints counts and failures.
//!
//!     cargo run --release --package cd-tests --example fuzz -- --inputs 1000000

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use cd_tests::fuzzing::memory::CountingAllocator;
use cd_tests::fuzzing::readers::READERS;
use cd_tests::fuzzing::trials::{FuzzOptions, fuzz};
use clap::Parser;
use clap::builder::PossibleValuesParser;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Gives damaged files to each reader of input and prints counts and failures; exit code 1 after failures.
#[derive(Parser)]
struct Options {
    /// Largest number of inputs of each reader.
    #[arg(long, default_value_t = 100_000)]
    inputs: u64,
    /// Longest time for each reader, s.
    #[arg(long)]
    seconds: Option<f64>,
    /// Seed of all damage.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Length to which a piece that repeats brings each input, bytes; 0: they stay as damage leaves them.
    #[arg(long, default_value_t = 0)]
    length: usize,
    /// Readers, separated by commas; default: all.
    #[arg(long, value_delimiter = ',', value_parser = PossibleValuesParser::new(READERS.iter().map(|reader| reader.name)))]
    readers: Vec<String>,
    /// Folder for the inputs that fail.
    #[arg(long, default_value = "target/fuzz-found")]
    found: PathBuf,
    /// File for each input before it is read.
    #[arg(long)]
    trace: Option<PathBuf>,
}

fn main() {
    let Options { inputs, seconds, seed, length, readers, found, trace } = Options::parse();
    let seconds = seconds.unwrap_or(f64::INFINITY);
    let time = Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX);
    let options = FuzzOptions { inputs, time, seed, length, trace };
    let (mut total, mut failures) = (0, 0);
    for reader in READERS.iter().filter(|reader| readers.is_empty() || readers.iter().any(|name| name == reader.name)) {
        let report = fuzz(reader, &options);
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
