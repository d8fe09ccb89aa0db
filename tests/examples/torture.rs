//! Torture of the three programs at length, see `cd_tests::torture`; prints counts and failures.
//!
//!     cargo run --release --package cd-tests --example torture -- --kills 200 --faults 150
//!
//! Options: `--kills`, `--faults`, `--signals` and `--others` (of each further kind) are numbers of trials, `--seed` the seed of
//! all choices, `--programs FOLDER` the folder of cd-pre, cd-solve and cd-post; by default this program contains them.

use cd_tests::process::{Executables, run_requested_program};
use cd_tests::torture::scenes::SCENES;
use cd_tests::torture::shim::Shim;
use cd_tests::torture::{Torture, TorturePlan};

fn main() {
    run_requested_program();
    let mut plan = TorturePlan { seed: 1, kills: 200, faults: 150, signals: 60, others: 30 };
    let mut programs = Executables::Own(&[]);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().unwrap_or_else(|| panic!("{word}: no value"));
        let number = || value.parse().unwrap_or_else(|_| panic!("{word}: {value}; expected a number"));
        match word.as_str() {
            "--seed" => plan.seed = number(),
            "--kills" => plan.kills = number(),
            "--faults" => plan.faults = number(),
            "--signals" => plan.signals = number(),
            "--others" => plan.others = number(),
            "--programs" => programs = Executables::Folder(std::path::absolute(&value).expect("a folder")),
            _ => panic!("{word}: unknown; expected --seed, --kills, --faults, --signals, --others or --programs"),
        }
    }
    let shim = Shim::compile().unwrap_or_else(|reason| panic!("{reason}"));
    let mut torture = Torture::new(programs, shim, &SCENES).unwrap_or_else(|reason| panic!("{reason}"));
    torture.run(&plan);
    let failures = torture.tally.failures.len();
    // Removes the folder in which the programs ran.
    drop(torture);
    std::process::exit(i32::from(failures > 0));
}
