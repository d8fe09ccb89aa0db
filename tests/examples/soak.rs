//! A long run of a small scene: memory and processor time per step must not grow. Linux only.
//!
//!     cargo run --release --package cd-tests --example soak -- --steps 10000000
//!
//! Prints memory and time per step of each tenth of the run; the exit code is 1 if they have grown.

use std::fs::{self, File};
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::Duration;

use cd_tests::process::{Executables, run_requested_program};
use clap::Parser;

/// Three balls on a plate that moves to and fro.
const SCENE: &str = r#"(
    gravity: (0.0, 0.0, -9.81),
    materials: [(name: "ROCKx", density: 2700.0)],
    laws: [(name: "iqs00", kind: IQS_CLB(friction: 0.5))],
    contacts: [(between: ("BLUEx", "BLUEx"), law: "iqs00"), (between: ("BLUEx", "FLOOR"), law: "iqs00")],
    grains: [(
        material: "ROCKx",
        colour: "BLUEx",
        sizes: Single(0.1),
        placement: List(positions: [(0.0, 0.0, 0.1), (0.15, 0.0, 0.3), (0.3, 0.0, 0.1)]),
    )],
    walls: [Plate(
        material: "ROCKx",
        colour: "FLOOR",
        centre: (0.0, 0.0, -0.1),
        half_lengths: (5.0, 5.0, 0.1),
        velocity: (Harmonic(amplitude: 0.05, omega: 20.0), Constant(0.0), Constant(0.0)),
    )],
    compute: (dt: 1.0e-3, steps: 1000, output_every: 1000),
)"#;

/// Number of parts of the run that are compared.
const PARTS: u64 = 10;

/// Largest memory of the last part beyond that of the first: 1 MB, for the sums of the error estimator and buffers of files.
const MAX_GROWTH: u64 = 1 << 20;

/// Largest processor time per step of a part over that of the fastest part. Other programs change it by a half at most.
const MAX_SLOWDOWN: f64 = 1.5;

/// Run at one moment.
struct RunSample {
    step: u64,
    /// Resident memory, bytes.
    memory: u64,
    /// Processor time, s.
    seconds: f64,
}

/// Step of the last row of a log, which may be long.
fn last_step(log: &Path) -> Option<u64> {
    let mut file = File::open(log).ok()?;
    let start = file.metadata().ok()?.len().saturating_sub(4096);
    file.seek(SeekFrom::Start(start)).ok()?;
    let mut end = String::new();
    file.read_to_string(&mut end).ok()?;
    end[..end.rfind('\n')?].lines().last()?.split(',').next()?.parse().ok()
}

/// Memory and processor time of a process; `None` if it has ended.
fn sample(process: &Child, log: &Path) -> Option<RunSample> {
    let folder = Path::new("/proc").join(process.id().to_string());
    let status = fs::read_to_string(folder.join("status")).ok()?;
    let kilobytes = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?.split_whitespace().next()?;
    let stat = fs::read_to_string(folder.join("stat")).ok()?;
    let ticks =
        stat.rsplit_once(')')?.1.split_whitespace().skip(11).take(2).map(|ticks| ticks.parse::<f64>().unwrap_or(0.0));
    Some(RunSample {
        step: last_step(log)?,
        memory: kilobytes.parse::<u64>().ok()? << 10,
        seconds: ticks.sum::<f64>() / 100.0,
    })
}

/// Runs a small scene for long; exit code 1 if memory or processor time per step have grown.
#[derive(Parser)]
struct Options {
    /// Number of steps.
    #[arg(long, default_value_t = 10_000_000)]
    steps: u64,
    /// Number of snapshots.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..))]
    snapshots: u64,
    /// Folder of cd-pre and cd-solve; default: this program, which contains them.
    #[arg(long, value_name = "FOLDER")]
    programs: Option<PathBuf>,
}

fn main() {
    run_requested_program();
    let Options { steps, snapshots, programs } = Options::parse();
    let programs = Executables::in_folder(programs);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = folder.path().join("scene.ron");
    fs::write(&scene, SCENE).expect("a file in it");
    let case = folder.path().to_str().expect("a path in UTF-8");
    let pre = programs.command(&["cd-pre", scene.to_str().expect("a path in UTF-8")]).stdout(Stdio::null()).status();
    assert!(pre.is_ok_and(|status| status.success()), "cd-pre");
    let flags = [
        format!("--steps={steps}"),
        format!("--output-every={}", (steps / snapshots).max(1)),
        format!("--log-every={}", (steps / 1000).max(1)),
    ];
    let words = [&["cd-solve".to_string(), case.to_string(), "--threads=1".to_string()], &flags[..]].concat();
    let mut run = programs.command(&words).stdout(Stdio::null()).spawn().expect("cd-solve");
    let mut samples: Vec<RunSample> = Vec::new();
    let status = loop {
        let part = samples.last().map_or(0, |last| last.step * PARTS / steps);
        samples.extend(
            sample(&run, &folder.path().join("OUTBOX/steps.csv")).filter(|new| new.step * PARTS / steps > part),
        );
        if let Some(status) = run.try_wait().expect("a process") {
            break status;
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    assert!(status.success(), "cd-solve: {status}");
    let is_flat = report(&samples, folder.path(), snapshots);
    drop(folder);
    std::process::exit(i32::from(!is_flat));
}

/// Prints the parts of a run; returns whether memory and time per step have not grown.
fn report(samples: &[RunSample], case: &Path, snapshots: u64) -> bool {
    let rates =
        samples.windows(2).map(|pair| (pair[1].seconds - pair[0].seconds) / (pair[1].step - pair[0].step) as f64);
    let rates: Vec<f64> = rates.collect();
    for (sample, rate) in samples[1..].iter().zip(&rates) {
        println!("step {:>9}: {:>8.2} us per step, {} kB", sample.step, 1e6 * rate, sample.memory >> 10);
    }
    let files = fs::read_dir(case.join("OUTBOX")).map_or(0, Iterator::count);
    println!("{files} files in OUTBOX");
    let fastest = rates.iter().copied().fold(f64::INFINITY, f64::min);
    let slowest = rates.iter().copied().fold(0.0, f64::max);
    let growth =
        samples.last().map_or(0, |last| last.memory).saturating_sub(samples.first().map_or(0, |first| first.memory));
    println!("slowest part over fastest: {:.2}; memory grew by {} kB", slowest / fastest, growth >> 10);
    slowest <= MAX_SLOWDOWN * fastest && growth <= MAX_GROWTH && files as u64 >= snapshots && rates.len() >= 5
}
