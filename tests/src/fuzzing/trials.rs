//! Readers on damaged files, with limits of time and memory.

use std::fmt::Write;
use std::fs;
use std::panic::{self, AssertUnwindSafe};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use super::memory::{begin_count, largest_since};
use super::mutation::{damage, lengthen};
use super::readers::{Reader, remove_files};
use crate::draws::Draws;

/// Longest time for one input.
pub const MAX_TIME: Duration = Duration::from_secs(1);

/// Largest number of bytes allocated at once for an input of up to 1 MB; for longer ones in proportion.
pub const MAX_ALLOCATION: usize = 64 << 20;

/// Number of damaged inputs that were accepted and are damaged further.
const MAX_POOL: usize = 64;

/// Results of a reader.
#[derive(Debug, Clone)]
pub struct FuzzReport {
    pub name: &'static str,
    pub inputs: u64,
    /// Number of inputs that the reader accepted.
    pub accepted: u64,
    pub slowest: Duration,
    /// Largest number of bytes allocated at once.
    pub largest: usize,
    /// Faults, each with its input.
    pub failures: Vec<(String, Vec<u8>)>,
}

impl FuzzReport {
    /// Counts in words.
    pub fn text(&self) -> String {
        format!(
            "{:16} {:>10} inputs, {:>9} accepted, slowest {:>6.1} ms, largest allocation {:>6.2} MB, {} failures",
            self.name,
            self.inputs,
            self.accepted,
            1e3 * self.slowest.as_secs_f64(),
            self.largest as f64 / (1 << 20) as f64,
            self.failures.len()
        )
    }
}

/// Message of the last panic.
static PANIC: Mutex<String> = Mutex::new(String::new());

/// Folder of the seeds.
pub fn seed_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds")
}

/// Seeds of a reader: whole files, most of which it accepts.
pub fn seeds(reader: &Reader) -> Vec<Vec<u8>> {
    let entries = fs::read_dir(seed_folder().join(reader.name)).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    paths.iter().map(|path| fs::read(path).expect("a seed")).collect()
}

/// How many inputs are read, and what is done with them.
#[derive(Debug, Clone)]
pub struct FuzzOptions {
    /// Largest number of inputs.
    pub inputs: u64,
    /// Longest time.
    pub time: Duration,
    /// Seed of all damage.
    pub seed: u64,
    /// Length to which inputs are brought after the damage, by a piece that repeats, bytes; 0: they stay as they are.
    pub length: usize,
    /// File to which each input is written before it is read, to find one that ends the whole program.
    pub trace: Option<PathBuf>,
}

/// Reads damaged inputs. Panics if there are no seeds.
pub fn fuzz(reader: &Reader, options: &FuzzOptions) -> FuzzReport {
    let hook = panic::take_hook();
    panic::set_hook(Box::new(|info| *PANIC.lock().expect("no panic holds it") = info.to_string()));
    let seeds = seeds(reader);
    assert!(!seeds.is_empty(), "{}: no seeds", reader.name);
    let (mut pool, start) = (seeds.clone(), Instant::now());
    let (slowest, failures) = (Duration::ZERO, Vec::new());
    let mut report = FuzzReport { name: reader.name, inputs: 0, accepted: 0, slowest, largest: 0, failures };
    while report.inputs < options.inputs && start.elapsed() < options.time {
        let mut draws = Draws::new(options.seed, report.inputs);
        // Seeds first, unchanged.
        let mut input = match seeds.get(report.inputs as usize) {
            Some(seed) => seed.clone(),
            None => pool[draws.below(pool.len() as u64) as usize].clone(),
        };
        if report.inputs >= seeds.len() as u64 {
            (0..=draws.below(4)).for_each(|_| damage(&mut input, &seeds, &mut draws));
        }
        // Not added to the pool: the next damage would cut it.
        let is_long = options.length > input.len();
        if is_long {
            lengthen(&mut input, options.length, &mut draws);
        }
        if let Some(trace) = &options.trace {
            fs::write(trace, &input).expect("a file for inputs");
        }
        if read_input(reader, &input, &mut report) && !is_long {
            let slot = seeds.len() + draws.below(MAX_POOL as u64) as usize;
            if slot < pool.len() { pool[slot] = input } else { pool.push(input) }
        }
    }
    panic::set_hook(hook);
    remove_files();
    report
}

/// Time that processors have spent on this process, to 10 ms; `None` if the system does not report it as Linux does.
fn processor_time() -> Option<Duration> {
    let text = fs::read_to_string("/proc/self/stat").ok()?;
    // Behind the name, which may have blanks: the state, ten other figures, ticks in the program and in the system.
    let mut figures = text.rsplit_once(')')?.1.split_whitespace().skip(11);
    let mut ticks = || figures.next()?.parse::<u64>().ok();
    Some(Duration::from_millis(10 * (ticks()? + ticks()?)))
}

/// Reads an input within the limits; returns whether it was accepted.
fn read_input(reader: &Reader, input: &[u8], report: &mut FuzzReport) -> bool {
    let beginning = begin_count();
    let mut start = Instant::now();
    let mut result = panic::catch_unwind(AssertUnwindSafe(|| (reader.read)(input)));
    let (mut time, largest) = (start.elapsed(), largest_since(beginning));
    if result.is_ok() && time > MAX_TIME {
        // On a busy machine the time of the processor counts.
        let before = processor_time();
        start = Instant::now();
        result = panic::catch_unwind(AssertUnwindSafe(|| (reader.read)(input)));
        time = processor_time().zip(before).map_or(start.elapsed(), |(after, before)| after - before);
    }
    report.inputs += 1;
    report.slowest = report.slowest.max(time);
    report.largest = report.largest.max(largest);
    let mut fault = String::new();
    if result.is_err() {
        fault = PANIC.lock().expect("no panic holds it").replace('\n', " ");
    }
    if time > MAX_TIME {
        let _ = write!(fault, "{} s", time.as_secs_f64());
    }
    if largest > MAX_ALLOCATION.max(input.len() * 64) {
        let _ = write!(fault, "{largest} bytes allocated for {}", input.len());
    }
    // One input for each place of a panic.
    if !fault.is_empty() && !report.failures.iter().any(|(known, _)| known.split(':').nth(1) == fault.split(':').nth(1))
    {
        report.failures.push((fault, input.to_vec()));
    }
    let is_accepted = result.unwrap_or(false);
    report.accepted += u64::from(is_accepted);
    is_accepted
}
