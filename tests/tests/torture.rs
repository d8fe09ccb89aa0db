//! A small part of the torture that `make torture` makes at length.

use cd_tests::process::{Executables, run_requested_program};
use cd_tests::torture::scenes::SCENES;
use cd_tests::torture::shim::Shim;
use cd_tests::torture::{Torture, TorturePlan};

/// Not a test of its own: a program as a process.
#[test]
fn program_process() {
    run_requested_program();
}

#[test]
fn broken_runs_lose_nothing_and_continue_to_the_same_bytes() {
    let shim = match Shim::compile() {
        Ok(shim) => shim,
        Err(reason) if std::env::var_os("CD_REQUIRE_TORTURE").is_some_and(|value| !value.is_empty()) => {
            panic!("{reason}")
        }
        Err(reason) => return println!("not tested: {reason}"),
    };
    let mut torture = Torture::new(Executables::of_test(), shim, &SCENES).unwrap();
    torture.run(&TorturePlan { seed: 1, kills: 12, faults: 16, signals: 6, others: 3 });
    assert!(torture.tally.failures.is_empty(), "{}", torture.tally.failures.join("\n"));
}
