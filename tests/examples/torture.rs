//! Torture of the three programs at length, see `cd_tests::torture`; prints counts and failures.
//!
//!     cargo run --release --package cd-tests --example torture -- --kills 200 --faults 150

use std::path::PathBuf;

use cd_tests::process::{Executables, run_requested_program};
use cd_tests::torture::scenes::SCENES;
use cd_tests::torture::shim::Shim;
use cd_tests::torture::{Torture, TorturePlan};
use clap::Parser;

/// Kills the three programs, lets disks and clocks fail, and compares with unbroken runs; exit code 1 after failures.
#[derive(Parser)]
struct Options {
    /// Seed of all choices.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of kills.
    #[arg(long, default_value_t = 200)]
    kills: u64,
    /// Number of failing file operations.
    #[arg(long, default_value_t = 150)]
    faults: u64,
    /// Number of signals.
    #[arg(long, default_value_t = 60)]
    signals: u64,
    /// Number of trials of each further kind.
    #[arg(long, default_value_t = 30)]
    others: u64,
    /// Folder of cd-pre, cd-solve and cd-post; default: this program, which contains them.
    #[arg(long, value_name = "FOLDER")]
    programs: Option<PathBuf>,
}

fn main() {
    run_requested_program();
    let Options { seed, kills, faults, signals, others, programs } = Options::parse();
    let (plan, programs) = (TorturePlan { seed, kills, faults, signals, others }, Executables::in_folder(programs));
    let shim = Shim::compile().unwrap_or_else(|reason| panic!("{reason}"));
    let mut torture = Torture::new(programs, shim, &SCENES).unwrap_or_else(|reason| panic!("{reason}"));
    torture.run(&plan);
    let failures = torture.tally.failures.len();
    // Removes the folder in which the programs ran.
    drop(torture);
    std::process::exit(i32::from(failures > 0));
}
