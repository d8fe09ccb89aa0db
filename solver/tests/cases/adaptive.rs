//! Steps of several times dt: what they keep exact, and what they save.

use cd_formats::compute::{Adaptive, EventAction};
use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot::Snapshot;

use crate::case::{Case, Figures, equal, near, shaken_lattice};
use crate::same_bits::{files, same};

const UP_TO_16: Adaptive = Adaptive { max_multiple: 16, travel: 0.3, penetration: 1e-2 };

/// A cloud that falls together under its own attraction, with spins: at rest at first.
fn cloud(adaptive: Adaptive) -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    for (radius, x) in shaken_lattice(4, 11) {
        case.sphere(radius, x.map(|c| 1.5 * c));
    }
    let options = &mut case.options;
    (options.self_gravity, options.gravity_constant) = (true, 1.0);
    (options.dt, options.tol, options.adaptive) = (1.0 / 256.0, Some(1e-4), Some(adaptive));
    (options.steps, options.output_every) = (Some(2048), 512);
    case
}

#[test]
fn free_fall_is_exact_in_few_steps() {
    // θ = ½ is exact in uniform gravity, whatever the steps.
    let mut case = Case::new();
    case.gravity = [0.0, 0.0, -8.0];
    (case.options.dt, case.options.adaptive) = (1.0 / 128.0, Some(UP_TO_16));
    let ball = case.sphere(0.5, [0.0, 0.0, 100.0]);
    case.launch(ball, [1.0, 0.0, 0.0], [0.0; 3]);
    case.event(0.5, EventAction::AddVelocity([0.0, 2.0, 0.0]));
    let end = case.run(256);
    near(end.x(ball), [2.0, 3.0, 84.0], 1e-12);
    near(end.v(ball), [1.0, 2.0, -16.0], 1e-12);
    assert_eq!((end.meta.step, end.meta.time), (256, 2.0));
    let steps = case.column("step");
    // Doubling at both starts, a step of one unit after the event at 0.5 s, 16 units elsewhere.
    assert!(steps.len() < 32 && steps.contains(&64.0) && steps.contains(&65.0), "{steps:?}");
    let lengths: f64 = case.column("h").iter().sum();
    equal(lengths, 2.0, 1e-12);
}

#[test]
fn an_orbit_in_long_steps_keeps_its_energy() {
    let mut case = Case::new();
    (case.options.self_gravity, case.options.gravity_constant) = (true, 1.0);
    (case.options.dt, case.options.adaptive) = (1e-3, Some(Adaptive { max_multiple: 1000, ..UP_TO_16 }));
    for side in [-1.0, 1.0] {
        let ball = case.sphere_of(1.0, 0.5, [side, 0.0, 0.0]);
        case.launch(ball, [0.0, side * (0.25 * std::f64::consts::PI / 6.0).sqrt(), 0.0], [0.0; 3]);
    }
    let states = case.states(100_000, 10_000);
    // The circle of both: 8.7 s around; steps of a fiftieth of the period at contact, an error of (h w)² / 24 or so.
    for state in &states {
        equal(state.x(0).norm(), 1.0, 2e-3);
    }
    assert!(case.column("h").len() < 5000, "{}", case.column("h").len());
}

#[test]
fn a_collapse_takes_fewer_steps_and_penetrates_no_deeper() {
    let of = |adaptive| {
        let mut case = cloud(adaptive);
        case.write();
        assert_eq!(case.solve(&[]), 0);
        let steps = case.column("step").len();
        case.options.adaptive = None;
        (case.last(), steps, case.column("time"))
    };
    let (fixed, all, _) = of(Adaptive::default());
    let (long, few, _) = of(UP_TO_16);
    assert_eq!(all, 2048);
    assert!(3 * few < all, "{few} of {all}");
    let deepest = |state: &Snapshot| state.meta.ledger.penetration_largest;
    // One step may cause UP_TO_16.penetration.
    assert!(deepest(&long) <= deepest(&fixed).max(UP_TO_16.penetration), "{} {}", deepest(&long), deepest(&fixed));
    for state in [&fixed, &long] {
        let drift = state.momentum().norm() / state.meta.ledger.momentum_scale;
        assert!(drift < 1e-14, "{drift}");
    }
    // The heaps differ as two heaps do: by a few percent of the energy.
    equal(long.potential() / fixed.potential(), 1.0, 0.05);
}

#[test]
fn longer_steps_are_solved_further() {
    let mut case = cloud(UP_TO_16);
    case.options.tol = Some(1e-2);
    case.write();
    assert_eq!(case.solve(&[]), 0);
    let column = |name| case.column(name).into_iter();
    let of_contacts = column("residual").zip(column("h")).zip(column("sweeps")).zip(column("contacts_active"));
    let of_contacts = of_contacts.filter(|(_, active)| *active > 0.0);
    let steps: Vec<[f64; 3]> = of_contacts.map(|(((residual, h), sweeps), _)| [residual, h * 256.0, sweeps]).collect();
    assert!(steps.iter().any(|[_, units, _]| *units > 3.0));
    // Each to tol over its length; what the criterion of a sweep rounds is of the order of 1e-12 of it. Beyond tol a thousand sweeps
    // are all that is spent on it.
    let [solved, given_up] = [true, false].map(|within| steps.iter().filter(move |step| (step[2] < 1000.0) == within));
    assert!(solved.clone().all(|[residual, units, _]| residual * units <= 1e-2 * (1.0 + 1e-9)), "{steps:?}");
    assert!(
        solved.count() > 20 * given_up.clone().count() && given_up.clone().all(|step| step[0] <= 1e-2),
        "{steps:?}"
    );
}

#[test]
fn threads_and_restarts_change_nothing() {
    let scene = || {
        let mut case = cloud(UP_TO_16);
        case.options.gravity_refresh = Some(5);
        case.event(2.0, EventAction::AddSpin([0.0, 0.0, 0.1]));
        case
    };
    let unbroken = files(&scene(), &[&["--threads", "1"]]);
    same(&unbroken, &files(&scene(), &[&["--threads", "3"]]));
    // At outputs of the unbroken run, where its steps end.
    same(&unbroken, &files(&scene(), &[&["--steps", "512"], &["--resume", "--steps", "1536"], &["--resume"]]));
}

#[test]
fn a_cube_turns_by_no_more_than_its_share_in_a_step() {
    let mut case = Case::new();
    let adaptive = Adaptive { max_multiple: 1000, ..UP_TO_16 };
    (case.options.dt, case.options.adaptive) = (1.0 / 1024.0, Some(adaptive));
    let cube = case.block([0.5; 3], [0.0; 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    case.launch(cube, [0.0; 3], [0.0, 0.0, 8.0]);
    case.run(1024);
    let longest = case.column("h").into_iter().fold(0.0, f64::max);
    // Whole steps of dt, the run in equal parts: less than the share by up to a half.
    let share = 8.0 * longest / adaptive.travel;
    assert!((0.5..=1.0).contains(&share), "{share}");
}

#[test]
fn motion_imposed_in_time_is_followed_step_by_step() {
    let mut case = Case::new();
    let plate = case.plate([1.0, 1.0, 0.1], [0.0; 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let shaken =
        Evolution::Harmonic { constant: 0.0, amplitude: 1.0, omega: 8.0, phase: 0.0, ramp_start: 1.0, ramp_rate: 0.0 };
    case.drive_along(plate, 2, shaken);
    case.sphere(0.5, [0.0, 0.0, 5.0]);
    case.options.adaptive = Some(UP_TO_16);
    case.run(100);
    assert_eq!(case.column("step").len(), 100);
    case.drive_along(plate, 2, Evolution::constant(0.5));
    case.run(100);
    assert!(case.column("step").len() < 20);
}

#[test]
fn a_draft_is_a_draft_but_for_what_is_set_alone() {
    let mut case = Case::new();
    case.sphere(0.5, [0.0; 3]);
    case.options.self_gravity = true;
    (case.options.tol, case.options.max_sweeps) = (None, Some(77));
    case.write();
    assert_eq!(case.solve(&["--accuracy", "draft", "--gravity-refresh", "3", "--steps", "4"]), 0);
    let parameters = case.last().meta.parameters;
    assert_eq!((parameters.tol, parameters.max_sweeps, parameters.gravity_refresh), (0.02, 77, Some(3)));
    assert_eq!(parameters.adaptive.map(|adaptive| adaptive.max_multiple), Some(16));
}

#[test]
fn what_comes_from_elsewhere_is_met_after_the_longest_steps() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.0]);
    case.sphere(0.5, [0.0; 3]);
    (case.options.dt, case.options.adaptive) = (0.0078125, Some(UP_TO_16));
    case.run(256);
    let before = case.path().join("OUTBOX/snapshot-000256.npz");
    assert!(Snapshot::read(&before).unwrap().meta.h >= 15.0 * 0.0078125);
    // START.npz knows the first ball alone.
    let start = case.path().join("start.npz");
    std::fs::rename(before, &start).unwrap();
    let impactor = case.sphere(0.5, [0.0, 0.0, 1.0625]);
    case.launch(impactor, [0.0, 0.0, -4.0], [0.0; 3]);
    (case.options.steps, case.options.output_every) = (Some(64), 64);
    case.write();
    std::fs::rename(start, case.path().join("DATBOX/START.npz")).unwrap();
    assert_eq!(case.solve(&["--force"]), 0);
    let end = case.last();
    // They meet and continue together: rounding.
    assert!(end.meta.ledger.penetration_largest <= 1e-12, "{}", end.meta.ledger.penetration_largest);
    near(end.v(0), [0.0, 0.0, -2.0], 1e-12);
}
