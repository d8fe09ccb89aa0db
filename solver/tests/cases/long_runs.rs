//! Runs of very many steps: exact times, bounded memory, logs with a row for many steps.

use std::fs;
use std::time::Duration;

use cd_formats::compute::{Adaptive, Event, EventAction};
use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot;

use crate::case::{Case, Figures, Vec3, equal, shaken_lattice};

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];

/// Steps that lie behind.
const FAR: u64 = 999_999_990;

/// Writes the last snapshot of a case as that of step [`FAR`], as if it had run so far without a change.
fn carry_far(case: &Case, dt: f64) {
    let outbox = case.path().join("OUTBOX");
    let mut state = case.last();
    (state.meta.step, state.meta.time) = (FAR, FAR as f64 * dt);
    state.meta.interval_start = Some(FAR as f64 * dt);
    for (_, path) in snapshot::list_snapshots(&outbox).unwrap() {
        fs::remove_file(path).unwrap();
    }
    state.write(&snapshot::snapshot_path(&outbox, FAR)).unwrap();
}

#[test]
fn times_and_events_are_right_after_a_thousand_million_steps() {
    for dt in [1e-3, 0.1, 1.0 / 3.0, 0.7] {
        let mut case = Case::new();
        let ball = case.sphere(0.5, [0.0; 3]);
        let wall = case.plate([2.0, 2.0, 0.5], [0.0, 0.0, -9.0], [X, Y, Z]);
        case.law("IQS_CLB", &[0.0]);
        // The wall's velocity is its time, over the time of the whole run.
        let end = 1e9 * dt;
        let ramp = Evolution::Table { name: "ramp.dat".into(), points: vec![[0.0, 0.0], [2.0 * end, 2.0]] };
        case.drive_along(wall, 0, ramp);
        // Each event is at a time step's start; the velocity changes within the step that follows.
        for k in [3, 4, 5, 12] {
            case.options.events.push(Event::at_time((FAR + k) as f64 * dt, EventAction::AddVelocity([0.0, 1.0, 0.0])));
        }
        case.options.events.push(Event {
            every: Some(dt),
            until: Some((FAR + 9) as f64 * dt),
            ..Event::at_time((FAR + 7) as f64 * dt, EventAction::AddVelocity([0.0, 0.0, 1.0]))
        });
        (case.options.dt, case.options.output_every) = (dt, 1);
        case.run(1);
        carry_far(&case, dt);
        let steps = (FAR + 20).to_string();
        assert_eq!(case.solve(&["--resume", "--steps", &steps]), 0);
        let states = case.written();
        assert_eq!(states.len(), 21);
        for state in &states[1..] {
            let (step, time) = (state.meta.step, state.meta.time);
            assert_eq!(time, step as f64 * dt, "dt {dt}, step {step}");
            let begun = |event: u64| f64::from(u8::from(step > FAR + event));
            let expected = [0.0, [3, 4, 5, 12].map(begun).iter().sum(), [7, 8, 9].map(begun).iter().sum()];
            assert_eq!(state.v(ball), Vec3::from(expected), "dt {dt}, step {step}");
            // A time of 10 digits in the table.
            equal(state.v(wall).x, time / end, 1e-12);
            equal(time - state.meta.interval_start.unwrap(), dt, 4.0 * f64::EPSILON * time);
        }
        // The first row is that of the one step before.
        assert_eq!(case.column("time")[1..], states[1..].iter().map(|state| state.meta.time).collect::<Vec<_>>());
    }
}

#[test]
fn steps_of_another_length_are_counted_from_their_first() {
    let mut case = Case::new();
    case.sphere(0.5, [0.0; 3]);
    (case.options.dt, case.options.output_every) = (0.1, 7);
    case.run(10);
    for (step, dt) in [(20, "0.3"), (33, "0.3"), (40, "0.7")] {
        assert_eq!(case.solve(&["--resume", "--steps", &step.to_string(), "--dt", dt]), 0);
    }
    let first = 10.0 * 0.1;
    let second = first + 23.0 * 0.3;
    assert_eq!(case.last().meta.time, second + 7.0 * 0.7);
    assert_eq!(case.last().meta.counted_from, Some((33, second)));
    // Broken at step 20 and not, the same bits.
    assert!(case.written().iter().any(|state| state.meta.step == 28 && state.meta.time == first + 18.0 * 0.3));
}

/// A box of grains that come to rest.
fn heap() -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -9.81];
    case.tub(2.0);
    for (radius, x) in shaken_lattice(3, 4) {
        case.sphere(radius, [x[0], x[1], x[2] + 2.0]);
    }
    (case.options.dt, case.options.tol) = (0.005, Some(1e-3));
    case
}

/// The rows of steps.csv by their steps.
fn rows(case: &Case, columns: &[&str]) -> Vec<Vec<f64>> {
    let columns: Vec<Vec<f64>> = columns.iter().map(|name| case.column(name)).collect();
    (0..columns[0].len()).map(|k| columns.iter().map(|column| column[k]).collect()).collect()
}

#[test]
fn a_thinned_log_loses_no_sum_and_no_maximum() {
    const NAMES: [&str; 8] =
        ["step", "time", "sweeps", "converged", "flight_error", "residual", "penetration_largest", "kinetic_energy"];
    for adaptive in [None, Some(Adaptive { max_multiple: 4, ..Adaptive::default() })] {
        let (mut all, mut thinned) = (heap(), heap());
        for case in [&mut all, &mut thinned] {
            (case.options.output_every, case.options.adaptive) = (100, adaptive);
        }
        thinned.options.log_every = 30;
        assert_eq!(all.run(250).bodies, thinned.run(250).bodies);
        let (all_rows, rows) = (rows(&all, &NAMES), rows(&thinned, &NAMES));
        assert!(rows.len() <= 13 && all_rows.len() >= 60, "{} {}", rows.len(), all_rows.len());
        let steps = thinned.column("steps");
        let mut rest = all_rows.iter();
        for (row, number) in rows.iter().zip(&steps) {
            let group: Vec<&Vec<f64>> = rest.by_ref().take(*number as usize).collect();
            let last = group.last().unwrap();
            assert_eq!([row[0], row[1], row[7]], [last[0], last[1], last[7]]);
            for k in [2, 3] {
                assert_eq!(row[k], group.iter().map(|figures| figures[k]).sum::<f64>(), "{}", NAMES[k]);
            }
            let sum = group.iter().map(|figures| figures[4]).sum::<f64>();
            equal(row[4], sum, 1e-14 * sum); // another order
            for k in [5, 6] {
                assert_eq!(row[k], group.iter().map(|figures| figures[k]).fold(0.0, f64::max), "{}", NAMES[k]);
            }
        }
        assert!(rest.next().is_none());
        assert!(adaptive.is_some() || rows.iter().any(|row| row[0] == 200.0) && rows.last().unwrap()[0] == 250.0);
    }
}

#[test]
fn a_thinned_log_is_the_same_after_a_resume() {
    let text = |case: &Case, name: &str| fs::read_to_string(case.path().join(name)).unwrap();
    let mut unbroken = heap();
    (unbroken.options.output_every, unbroken.options.log_every) = (50, 40);
    unbroken.run(130);
    for broken in [1, 39, 40, 41, 50, 99, 120, 129] {
        let mut resumed = heap();
        (resumed.options.output_every, resumed.options.log_every) = (50, 40);
        resumed.run(broken);
        assert_eq!(resumed.solve(&["--resume", "--steps", "130"]), 0);
        assert_eq!(text(&resumed, "OUTBOX/steps.csv"), text(&unbroken, "OUTBOX/steps.csv"), "after step {broken}");
        let estimates = |case: &Case| -> Vec<String> {
            text(case, "ERRORS.csv").lines().map(|line| line.rsplit_once(',').unwrap().0.to_string()).collect()
        };
        assert_eq!(estimates(&resumed), estimates(&unbroken), "after step {broken}");
    }
}

/// Resident memory of this process, bytes.
#[cfg(target_os = "linux")]
fn resident(process: u32) -> f64 {
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    1024.0 * line.trim().strip_suffix(" kB").unwrap().parse::<f64>().unwrap()
}

/// Growth of the resident memory (bytes) of a run between two of its steps, and the number of steps between them.
#[cfg(target_os = "linux")]
fn growth(from: u64, count: u64) -> (f64, u64) {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -9.81];
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.5]);
    case.options.log_every = 10_000;
    case.write();
    let flags = ["--steps", "1000000000"];
    let mut run =
        std::process::Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).args(flags).spawn().unwrap();
    let steps = |least: u64| loop {
        std::thread::sleep(Duration::from_millis(20));
        let log = fs::read_to_string(case.path().join("OUTBOX/steps.csv")).unwrap_or_default();
        let last = log.lines().last().and_then(|row| row.split(',').next()?.parse::<u64>().ok()).unwrap_or(0);
        if last >= least || run_ended(run.id()) {
            return last;
        }
    };
    // Rows reach the file by blocks of 8 KiB.
    let first = steps(from);
    let before = resident(run.id());
    let last = steps(first + count);
    let grown = resident(run.id()) - before;
    run.kill().unwrap();
    run.wait().unwrap();
    assert!(last > first, "{first} {last}");
    (grown, last - first)
}

/// Some ten seconds: 57 bytes a step would be 57 MB.
#[test]
#[cfg(target_os = "linux")]
fn memory_does_not_grow_in_a_million_steps() {
    let (grown, steps) = growth(100_000, 1_000_000);
    println!("{grown} bytes in {steps} steps");
    // Less than a byte a step.
    assert!(grown < 1e6, "{grown} bytes in {steps} steps");
}

#[cfg(target_os = "linux")]
fn run_ended(process: u32) -> bool {
    fs::read_to_string(format!("/proc/{process}/status")).map_or(true, |status| status.contains("State:\tZ"))
}

/// A signal ends a step that takes for ever, and leaves the state of the step before it.
#[test]
#[cfg(unix)]
fn a_request_to_stop_ends_a_long_step() {
    let mut case = heap();
    // A residual that no sweep reaches.
    (case.options.tol, case.options.max_sweeps) = (Some(1e-300), Some(u64::MAX));
    case.options.solver = cd_formats::compute::ContactSolver::Nlgs;
    case.options.output_every = 1;
    case.event(0.1, EventAction::SetGravity([3.0, 0.0, -9.81]));
    case.write();
    let run = |flags: &[&str]| {
        let mut run = std::process::Command::new(env!("CARGO_BIN_EXE_cd-solve"));
        run.arg(case.path()).args(flags).spawn().unwrap()
    };
    // Steps in flight end at once; one with contacts does not.
    let mut process = run(&["--steps", "1000"]);
    let mut steps = 0;
    loop {
        std::thread::sleep(Duration::from_secs(2));
        let now = snapshot::list_snapshots(&case.path().join("OUTBOX")).unwrap().len();
        if now > 1 && now == steps {
            break;
        }
        steps = now;
        assert!(process.try_wait().unwrap().is_none());
    }
    assert!(std::process::Command::new("kill").arg(process.id().to_string()).status().unwrap().success());
    assert_eq!(process.wait().unwrap().code(), Some(4));
    let stopped = case.last();
    assert_eq!(stopped.meta.step as usize + 1, steps);
    assert!(stopped.meta.step < 1000);
    // Steps before the long one end after few sweeps, so fewer sweeps change nothing in them.
    let end = (stopped.meta.step + 15).to_string();
    let reached = |flags: &[&str]| {
        let flags = [&["--steps", &end, "--max-sweeps", "2000"], flags].concat();
        assert_eq!(run(&flags).wait().unwrap().code(), Some(0));
        let written = snapshot::list_snapshots(&case.path().join("OUTBOX")).unwrap();
        let from = written.into_iter().filter(|(step, _)| *step > stopped.meta.step);
        from.map(|(step, path)| (step, fs::read(path).unwrap())).collect::<Vec<_>>()
    };
    let resumed = reached(&["--resume"]);
    let unbroken = reached(&["--force"]);
    assert_eq!(resumed.len(), 15);
    for ((step, resumed), (_, unbroken)) in resumed.iter().zip(&unbroken) {
        assert!(resumed == unbroken, "step {step}");
    }
}
