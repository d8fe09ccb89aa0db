//! The same bytes on any number of ranks of MPI.
//!
//! Needs `mpirun`, or the launcher named by CD_MPIRUN, and a build with the feature `mpi`. Where it is missing the tests only
//! say so; with CD_REQUIRE_MPI=1 that is an error. Blocks are as small as the scenes, so that there are many; the messages of
//! the ranks are counted. With CD_TESTS_LONG=1 there are more numbers of ranks, and more ranks are killed.

use std::ffi::OsString;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use cd_formats::compute::{Adaptive, ContactSolver};
use cd_formats::tact_behav::TactBehav;

use crate::case::{AXES, Case, uniform};
use crate::same_bits::{collapse, outbox, poured, same, scene, slab};
use crate::sinks_and_sources::mixed;

/// Smallest number of bodies in a block in these tests.
const BLOCK_BODIES: &str = "4";

/// Launcher of the MPI library with which the programs are built.
fn launcher() -> OsString {
    std::env::var_os("CD_MPIRUN").unwrap_or_else(|| "mpirun".into())
}

/// Whether ranks can be started.
fn has_mpirun() -> bool {
    let found = Command::new(launcher()).arg("--version").output().is_ok_and(|output| output.status.success());
    let required = std::env::var("CD_REQUIRE_MPI").is_ok_and(|value| value == "1");
    assert!(found || !required, "no {}", launcher().display());
    if !found {
        println!("skipped: no {}", launcher().display());
    }
    found
}

fn is_long() -> bool {
    std::env::var_os("CD_TESTS_LONG").is_some()
}

/// cd-solve on `ranks` ranks, or alone for 0.
fn command(case: &Path, ranks: usize, flags: &[&str]) -> Command {
    let solver = env!("CARGO_BIN_EXE_cd-solve");
    let mut command = Command::new(if ranks == 0 { solver.into() } else { launcher() });
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
    let all = [1, 2, 3, 4, 8].into_iter().flat_map(|ranks| ["1", "2"].map(|threads| (ranks, threads)));
    let layouts = if is_long() { all.collect() } else { vec![(1, "2"), (2, "2"), (3, "1"), (4, "2")] };
    for (ranks, threads) in layouts {
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

/// [`expect_same_bytes`] of a case whose contacts are divided; no rank has more than `share` of the contacts of one rank.
fn expect_divided_contacts(case: &Case, share: f64) {
    if !has_mpirun() {
        return;
    }
    expect_same_bytes(case);
    let most = case.column("contacts_listed").into_iter().fold(0.0, f64::max);
    let summary = run(&case.path(), 3, &["--force", "--threads", "1"]);
    let line = summary.lines().find(|line| line.contains("contacts by rank")).expect("a line about contacts");
    let held = line.split_once("at most ").and_then(|(_, held)| held.split(' ').next()?.parse().ok());
    let held: f64 = held.unwrap_or_else(|| panic!("{line}"));
    println!("{line}; {most} contacts");
    assert!(held > 0.0 && held < share * most, "{held} of {most}");
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
fn ranks_change_no_byte_while_bodies_leave_and_enter() {
    for polyhedra in [false, true] {
        expect_same_bytes(&mixed(polyhedra));
    }
}

#[test]
fn ranks_change_no_byte_of_a_periodic_bed() {
    expect_divided_contacts(&bed(), 1.0);
}

/// Spheres in a shaken tub whose contacts ranks divide, with steps of several `dt` and walls that move.
fn divided_tub(law: &str, parameters: &[f64]) -> Case {
    let mut case = scene(4);
    case.tact = TactBehav::default();
    case.law_of_all(law, parameters);
    case.options.adaptive = Some(Adaptive { max_multiple: 4, ..case.options.adaptive() });
    case
}

#[test]
fn ranks_change_no_byte_of_divided_contacts_in_a_tub() {
    for (law, parameters) in [("IQS_CLB", &[0.3][..]), ("RST_CLB", &[0.5, 0.2, 0.3])] {
        expect_divided_contacts(&divided_tub(law, parameters), 0.9);
    }
}

/// Steps that do not converge, in which a conflict is sought, and a tolerance for which `auto` continues with other solvers.
#[test]
fn ranks_change_no_byte_of_steps_that_do_not_converge() {
    for max_sweeps in [1100, 5] {
        let mut case = bed();
        (case.options.steps, case.options.tol, case.options.max_sweeps) = (Some(8), Some(1e-14), Some(max_sweeps));
        expect_divided_contacts(&case, 1.0);
        assert!(!has_mpirun() || max_sweeps > 5 || case.last().meta.ledger.steps_unconverged > 0);
    }
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

/// Blocks that fall on each other, with so many pairs that ranks divide their narrow phase.
#[test]
fn ranks_change_no_byte_of_a_stack_of_blocks() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.4]);
    case.gravity = [0.15, 0.05, -4.0];
    case.floor();
    let mut random = uniform(4);
    for (i, j, k) in (0..6).flat_map(|i| (0..6).flat_map(move |j| (0..6).map(move |k| (i, j, k)))) {
        let body = case.block([0.4995; 3], [f64::from(i), f64::from(j), 0.5 + f64::from(k)], AXES);
        case.launch(body, [0; 3].map(|_| 0.2 * random() - 0.1), [0; 3].map(|_| 0.2 * random() - 0.1));
    }
    let options = &mut case.options;
    (options.solver, options.max_sweeps) = (ContactSolver::Nlgs, Some(5)); // the comparison needs no converged steps
    (options.dt, options.steps, options.output_every) = (0.01, Some(2), 1);
    expect_same_bytes(&case);
    // Two blocks touch at up to eight points; ranks divide 256 pairs and more.
    assert!(!has_mpirun() || case.column("contacts_listed").iter().all(|listed| *listed > 8.0 * 256.0));
}

/// Waits for a file, for at most a minute.
fn wait_for(file: &Path) {
    let start = Instant::now();
    while !file.exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "{} is missing", file.display());
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Sends a signal to a rank of three, number `which` of the processes of a launcher.
fn signal_rank(launched: &Child, signal: &str, which: usize) {
    let children = |parent: &str| {
        let listed = Command::new("pgrep").args(["-P", parent]).output().unwrap().stdout;
        String::from_utf8(listed).unwrap().split_whitespace().map(String::from).collect::<Vec<_>>()
    };
    let mut ranks = children(&launched.id().to_string());
    // MPICH has a process between the launcher and the ranks.
    while let [proxy] = &ranks[..] {
        ranks = children(proxy);
    }
    assert_eq!(ranks.len(), 3);
    assert!(Command::new("kill").args([signal, &ranks[which]]).status().unwrap().success());
}

/// Scene of runs that are broken off.
#[derive(Debug, Clone, Copy)]
enum BrokenScene {
    /// Each rank has all contacts of a shaken tub.
    Undivided,
    /// Ranks divide them.
    Divided,
}

impl BrokenScene {
    fn case(self) -> Case {
        match self {
            BrokenScene::Undivided => scene(4),
            BrokenScene::Divided => divided_tub("RST_CLB", &[0.5, 0.2, 0.3]),
        }
    }
}

/// Starts a scene on three ranks, sends a signal to rank `which` after snapshot 15 and `delay`, and compares the run that
/// resumes on `ranks` ranks with an unbroken one. Snapshots are in parts of 20 bodies.
#[cfg(unix)]
fn expect_resumed(scene: BrokenScene, signal: &str, which: usize, delay: Duration, ranks: usize) {
    let case = scene.case();
    case.write();
    let long = ["--steps", "1000000", "--output-every", "15", "--threads", "1", "--part-bodies", "20"];
    let mut broken = command(&case.path(), 3, &long).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
    wait_for(&case.path().join("OUTBOX/snapshot-000015.npz"));
    std::thread::sleep(delay);
    signal_rank(&broken, signal, which);
    let code = broken.wait().unwrap().code();
    // The launcher of MPICH reports its own code.
    let own = launcher() == "mpirun";
    assert!(code != Some(0) && (signal == "-KILL" || !own || code == Some(4)), "{signal}: {code:?}");
    let stopped = case.last().meta.step;
    assert!((15..1_000_000).contains(&stopped), "{stopped}");
    let steps = (stopped + 20).to_string();
    let summary = run(&case.path(), ranks, &["--resume", "--steps", &steps, "--threads", "2", "--part-bodies", "20"]);
    let is_divided = matches!(scene, BrokenScene::Divided) && ranks > 1;
    let says_divided = |line: &str| line.contains("contacts by rank") && line.contains("divided;");
    assert_eq!(summary.lines().any(says_divided), is_divided, "{summary}");
    let whole = scene.case();
    whole.write();
    run(&whole.path(), 0, &["--steps", &steps, "--part-bodies", "20"]);
    let [mut resumed, mut whole] = [&case, &whole].map(|case| outbox(&case.path()));
    // Both may have stopped between two outputs, which texts count, and a killed rank leaves an unfinished file.
    for files in [&mut resumed, &mut whole] {
        let at_stop = format!("snapshot-{stopped:06}");
        files.retain(|name, _| !name.contains(".OUT.") && !name.ends_with(".part") && !name.starts_with(&at_stop));
    }
    same(&whole, &resumed);
}

/// A rank that is killed ends all, and a request to one stops all; the run resumes on another number of ranks.
#[test]
#[cfg(unix)]
fn a_run_resumes_on_another_number_of_ranks() {
    for scene in [BrokenScene::Undivided, BrokenScene::Divided].into_iter().filter(|_| has_mpirun()) {
        ["-KILL", "-TERM"].into_iter().for_each(|signal| expect_resumed(scene, signal, 0, Duration::ZERO, 2));
    }
}

#[test]
#[cfg(unix)]
fn ranks_killed_at_random_instants_lose_nothing() {
    let mut random = uniform(11);
    let mut below = |count: f64| count * random();
    for attempt in 0..if is_long() && has_mpirun() { 20 } else { 0 } {
        for scene in [BrokenScene::Undivided, BrokenScene::Divided] {
            let (which, delay, ranks) =
                (below(3.0) as usize, Duration::from_secs_f64(below(2.0)), 1 + below(4.0) as usize);
            println!("{attempt}, {scene:?}: rank {which} after {delay:?}, then {ranks} ranks");
            expect_resumed(scene, "-KILL", which, delay, ranks);
        }
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
    of_one(failed(&["--step-loop"]), "--step-loop: runs on 3 ranks");
    std::fs::create_dir_all(case.path().join("OUTBOX/steps.csv")).unwrap();
    of_one(failed(&["--steps", "2"]), "steps.csv");
}
