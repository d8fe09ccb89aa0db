//! The same bytes on any number of ranks of MPI.
//!
//! Needs `mpirun`, and a build with the feature `mpi`. Where `mpirun` is missing the tests only say so; with CD_REQUIRE_MPI=1
//! that is an error. Blocks are as small as the scenes, so that there are many; what ranks send each other is counted.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::case::Case;
use crate::same_bits::{collapse, outbox, poured, same, scene, slab};

/// Smallest number of bodies in a block in these tests.
const BLOCK_BODIES: &str = "4";

/// Whether ranks can be started.
fn has_mpirun() -> bool {
    let found = Command::new("mpirun").arg("--version").output().is_ok_and(|output| output.status.success());
    let required = std::env::var("CD_REQUIRE_MPI").is_ok_and(|value| value == "1");
    assert!(found || !required, "no mpirun");
    if !found {
        println!("skipped: no mpirun");
    }
    found
}

/// cd-solve on `ranks` ranks, or alone for 0.
fn command(case: &Path, ranks: usize, flags: &[&str]) -> Command {
    let solver = env!("CARGO_BIN_EXE_cd-solve");
    let mut command = Command::new(if ranks == 0 { solver } else { "mpirun" });
    if ranks > 0 {
        // With one MPI or the other, as root, and with more ranks than processors.
        command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
        command.env("OMPI_MCA_rmaps_base_oversubscribe", "1").env("OMPI_MCA_mpi_yield_when_idle", "1");
        command.env("OMPI_MCA_hwloc_base_binding_policy", "none");
        command.args(["-n", &ranks.to_string(), solver]);
    }
    command.arg(case).args(flags).env("CD_TESTS_BLOCK", BLOCK_BODIES).stdin(Stdio::null());
    command
}

/// Text on stdout of a run that must end well.
fn run(case: &Path, ranks: usize, flags: &[&str]) -> String {
    let output = command(case, ranks, flags).output().unwrap();
    let (text, errors) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{ranks} ranks, {flags:?}: {text}\n{errors}");
    text
}

/// Numbers in the line `ranks` of a summary: ranks, divided sweeps, messages and kB to others, kB to all.
fn traffic(summary: &str) -> Vec<f64> {
    let line = summary.lines().find(|line| line.trim_start().starts_with("ranks ")).expect("a line about ranks");
    line.split(|c: char| !(c.is_ascii_digit() || c == '.')).filter_map(|word| word.parse().ok()).collect()
}

/// Spheres that fall on a floor which is periodic along both axes.
fn bed() -> Case {
    let mut case = collapse(5, false);
    let options = &mut case.options;
    (options.xperiode, options.yperiode, options.self_gravity) = (Some(6.0), Some(6.0), false);
    (options.steps, options.output_every, options.max_sweeps) = (Some(20), 10, Some(200));
    case
}

/// Blocks or spheres that fall into a tub.
fn heap(blocks: bool, law: &str, parameters: &[f64]) -> Case {
    let mut case = poured(blocks, law, parameters);
    (case.options.dt, case.options.steps, case.options.output_every) = (0.01, Some(90), 45);
    case
}

/// Compares OUTBOX on several ranks and threads with that of a run without MPI.
fn expect_same_bytes(case: &Case) {
    if !has_mpirun() {
        return;
    }
    case.write();
    let path = case.path();
    run(&path, 0, &["--threads", "1"]);
    let alone = outbox(&path);
    for (ranks, threads) in [(1, "2"), (2, "2"), (3, "1"), (4, "2")] {
        let summary = run(&path, ranks, &["--force", "--threads", threads]);
        println!("{ranks} ranks, {threads} threads");
        same(&alone, &outbox(&path));
        if ranks > 1 {
            let [of, sweeps, messages, ..] = traffic(&summary)[..] else { panic!("{summary}") };
            assert!(of == ranks as f64 && sweeps > 0.0, "{summary}");
            // At most one for each colour and neighbour; few bodies may touch those of another rank.
            assert!(messages <= 18.0 * (ranks - 1) as f64, "{summary}");
        }
    }
}

#[test]
fn ranks_change_no_byte_of_a_shaken_tub() {
    expect_same_bytes(&scene(4));
}

#[test]
fn ranks_change_no_byte_of_a_bonded_slab() {
    expect_same_bytes(&slab());
}

#[test]
fn ranks_change_no_byte_of_a_periodic_bed() {
    expect_same_bytes(&bed());
}

#[test]
fn ranks_change_no_byte_of_rocks() {
    expect_same_bytes(&heap(true, "IQS_CLB", &[0.4]));
}

#[test]
fn ranks_change_no_byte_of_rocks_with_restitution() {
    expect_same_bytes(&heap(true, "RST_DS_CLB", &[0.6, 0.2, 0.3, 0.4]));
}

#[test]
fn ranks_change_no_byte_of_rolling_spheres() {
    expect_same_bytes(&heap(false, "IQS_DS_ROLL_CLB", &[0.4, 0.5, 0.1, 0.1]));
}

/// Waits for a file, for at most a minute.
fn wait_for(file: &Path) {
    let start = Instant::now();
    while !file.exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "{} is missing", file.display());
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Ends the children of a process, the ranks of `mpirun`, by a signal.
fn signal_ranks(mpirun: &Child, signal: &str, count: usize) {
    let listed = Command::new("pgrep").args(["-P", &mpirun.id().to_string()]).output().unwrap().stdout;
    let ranks = String::from_utf8(listed).unwrap();
    let ranks: Vec<&str> = ranks.split_whitespace().take(count).collect();
    assert_eq!(ranks.len(), count);
    assert!(Command::new("kill").arg(signal).args(ranks).status().unwrap().success());
}

/// A rank that is killed ends all, and a request to one stops all; the run resumes on another number of ranks.
#[test]
#[cfg(unix)]
fn a_run_resumes_on_another_number_of_ranks() {
    if !has_mpirun() {
        return;
    }
    for signal in ["-KILL", "-TERM"] {
        let case = scene(4);
        case.write();
        let long = ["--steps", "1000000", "--output-every", "15", "--threads", "1"];
        let mut broken = command(&case.path(), 3, &long).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
        wait_for(&case.path().join("OUTBOX/snapshot-000015.npz"));
        signal_ranks(&broken, signal, 1);
        let code = broken.wait().unwrap().code();
        assert!(code != Some(0) && (signal == "-KILL" || code == Some(4)), "{signal}: {code:?}");
        let stopped = case.last().meta.step;
        assert!((15..1_000_000).contains(&stopped), "{stopped}");
        let steps = (stopped + 20).to_string();
        run(&case.path(), 2, &["--resume", "--steps", &steps, "--threads", "2"]);
        let whole = scene(4);
        whole.write();
        run(&whole.path(), 0, &["--steps", &steps]);
        let [mut resumed, mut whole] = [&case, &whole].map(|case| outbox(&case.path()));
        // Both may have stopped between two outputs, which texts count, and a killed rank leaves an unfinished file.
        for files in [&mut resumed, &mut whole] {
            files.retain(|name, _| !name.contains(".OUT.") && !name.ends_with(".part"));
            files.remove(&format!("snapshot-{stopped:06}.npz"));
        }
        same(&whole, &resumed);
    }
}

/// Input that all ranks reject is reported once, and what rank 0 alone finds ends all.
#[test]
fn ranks_report_faults_once() {
    if !has_mpirun() {
        return;
    }
    let case = scene(3);
    case.write();
    let failed = |flags: &[&str]| {
        let output = command(&case.path(), 3, flags).output().unwrap();
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), errors.lines().filter(|line| line.starts_with("cd-solve: ")).count(), errors)
    };
    let of_one = |(code, lines, errors): (Option<i32>, usize, String), expected: &str| {
        assert!(code == Some(2) && lines == 1 && errors.contains(expected), "{code:?} {lines} {errors}");
    };
    of_one(failed(&["--theta", "2"]), "theta: 2; expected 0.5 to 1");
    of_one(failed(&["--step-loop"]), "step-loop: runs on 3 ranks");
    std::fs::create_dir_all(case.path().join("OUTBOX/steps.csv")).unwrap();
    of_one(failed(&["--steps", "2"]), "steps.csv");
}
