//! Bodies that leave by sinks and enter from sources: steps, counts and ledgers in closed form, and the same bytes again.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::fs;
use std::process::Command;

use cd_formats::bodies::{Contactor, ShapeRecord};
use cd_formats::compute::{Adaptive, ExternalField};
use cd_formats::probe::{BodySelection, CountingSurface, EndCondition, Probe, ProbeQuantity};
use cd_formats::region::SpaceRegion;
use cd_formats::sinks_and_sources::{EntryOrder, Sink, Source};
use cd_formats::snapshot::{PRESENCE_GONE, PRESENCE_PRESENT, PRESENCE_WAITING, Snapshot};

use crate::case::{AXES, Case, Figures, Vec3, equal, near, uniform};
use crate::probes::at_rest_below;
use crate::same_bits::{outbox, same};

/// Columns of the file of a probe, by rows.
fn rows(case: &Case, name: &str) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(case.path().join(format!("POSTPRO/probe-{name}.csv"))).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(|field| field.parse().unwrap()).collect()).collect()
}

fn probe(name: &str, every: u64, quantity: ProbeQuantity) -> Probe {
    Probe { name: name.into(), every, quantity }
}

fn removed(every: u64) -> Probe {
    probe("removed", every, ProbeQuantity::Removed { by: "lost".into() })
}

fn sink(region: SpaceRegion) -> Sink {
    Sink { name: "lost".into(), region }
}

fn sink_below(z: f64) -> Sink {
    sink(SpaceRegion::Below { point: [0.0, 0.0, z], normal: [0.0, 0.0, 1.0] })
}

fn presence(state: &Snapshot) -> &[u8] {
    &state.presence.as_ref().expect("a run with sinks or sources").body_presence
}

/// Momentum of the bodies that are in the run.
fn present_momentum(state: &Snapshot) -> Vec3 {
    let present = state.free().into_iter().filter(|&i| state.is_present(i));
    present.map(|i| state.v(i) * state.mass(i)).sum()
}

/// Two balls of 4/3 π kg that move along z.
fn falling() -> Case {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    for (x, v) in [(0.0, -1.0), (4.0, 2.0)] {
        let body = case.sphere(1.0, [x, 0.0, 0.75]);
        case.launch(body, [0.5, 0.0, v], [0.0, 2.0, 0.0]);
    }
    case.options.dt = 0.125;
    case
}

#[test]
fn a_body_leaves_after_the_step_in_which_its_centre_passes_the_plane() {
    let mut case = falling();
    case.options.sinks = vec![sink_below(0.0)];
    case.options.probes = vec![removed(1), probe("left", 1, ProbeQuantity::Energy { of: BodySelection::Free })];
    let states = case.states(10, 1);
    let mass = 4.0 / 3.0 * PI;
    // z = 0.75 - step/8 is 0 after six steps, which is not below.
    for state in &states {
        let gone = if state.meta.step > 6 { PRESENCE_GONE } else { PRESENCE_PRESENT };
        assert_eq!(presence(state), [gone, PRESENCE_PRESENT], "{}", state.meta.step);
    }
    let counted = rows(&case, "removed");
    let kinetic = 0.5 * mass * 1.25 + 0.5 * 0.4 * mass * 4.0;
    for row in &counted {
        let expected = if row[0] == 7.0 { [1.0, mass, 0.5 * mass, 0.0, -mass, kinetic] } else { [0.0; 6] };
        // Radii and masses have eight digits in the files, and the sums some roundings.
        row[3..].iter().zip(expected).for_each(|(found, expected)| equal(*found, expected, 1e-12 * mass));
    }
    let masses: Vec<f64> = rows(&case, "left").iter().map(|row| row[6] / mass).collect();
    masses.iter().zip(1..).for_each(|(found, step)| equal(*found, if step > 6 { 1.0 } else { 2.0 }, 1e-12));
    // It stays at its last position, as no file has other numbers than those of a run.
    let last = states.last().unwrap();
    near(last.x(0), states[7].x(0), 0.0);
    near(last.v(0), [0.0; 3], 0.0);
    assert_eq!(last.bodies.body_driven, [0, 0]);
    near(Vec3::from(last.meta.ledger.momentum_expected), present_momentum(last), 1e-12 * mass);
}

#[test]
fn rows_of_several_steps_have_the_sums() {
    let mut case = falling();
    case.options.sinks = vec![sink_below(0.0)];
    case.options.probes = vec![removed(4)];
    case.run(10);
    let counted: Vec<[f64; 2]> = rows(&case, "removed").iter().map(|row| [row[0], row[3]]).collect();
    assert_eq!(counted, [[4.0, 0.0], [8.0, 1.0], [10.0, 0.0]]);
}

#[test]
fn bodies_count_as_positive_along_the_normal_and_outwards() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    // One ball crosses z = 0 downwards and leaves the sphere; one enters and leaves it; one stays.
    for (x, v) in
        [([0.0, 0.0, 0.5], [0.0, 0.0, -2.0]), ([0.0, -8.0, 1.5], [0.0, 8.0, 0.0]), ([40.0, 0.0, 9.0], [0.0; 3])]
    {
        let body = case.sphere(0.25, x);
        case.launch(body, v, [0.0; 3]);
    }
    let through = |through| ProbeQuantity::Crossing { of: BodySelection::Free, through };
    let plane = CountingSurface::Plane { point: [0.0; 3], normal: [0.0, 0.0, 3.0] };
    let sphere = CountingSurface::Sphere { centre: [0.0; 3], radius: 3.0 };
    case.options.probes = vec![
        probe("plane", 64, through(plane)),
        probe("sphere", 1, through(sphere)),
        probe("sum", 64, through(sphere_of(3.0))),
    ];
    case.options.dt = 1.0 / 32.0;
    case.run(64);
    let mass = 4.0 / 3.0 * PI / 64.0;
    let plane = &rows(&case, "plane")[0];
    near([plane[3], plane[4] / mass, plane[7] / mass], [-1.0, -1.0, 2.0], 1e-12);
    let numbers: Vec<[f64; 2]> =
        rows(&case, "sphere").iter().map(|row| [row[0], row[3]]).filter(|row| row[1] != 0.0).collect();
    // y = -8 + step/4 is within √(9 - 1.5²) = 2.598 from step 22 to 42; z = 0.5 - step/16 is beyond -3 from step 56.
    assert_eq!(numbers, [[22.0, -1.0], [43.0, 1.0], [56.0, 1.0]]);
    let sum = &rows(&case, "sum")[0];
    // Bodies that enter and leave with the same velocity cancel.
    near([sum[3], sum[6] / mass, sum[7] / mass], [1.0, 0.0, -2.0], 1e-12);
}

fn sphere_of(radius: f64) -> CountingSurface {
    CountingSurface::Sphere { centre: [0.0; 3], radius }
}

#[test]
fn energy_and_momenta_of_an_aggregate_close_when_ejecta_leave() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    case.sphere(1.0, [0.0; 3]);
    for (x, v) in [(3.0, 1.0), (-2.5, -0.7), (2.2, 0.0)] {
        let body = case.sphere(0.5, [x, 0.1 * x, 0.2]);
        case.launch(body, [v, 0.1, 0.0], [0.0, 0.0, 1.0]);
    }
    case.options.sinks = vec![sink(SpaceRegion::Beyond { centre: [0.0; 3], radius: 5.0 })];
    (case.options.self_gravity, case.options.gravity_constant) = (true, 0.01);
    case.gravity = [0.0, 0.0, 0.01];
    case.options.dt = 1.0 / 256.0;
    let last = case.run(2048);
    assert_eq!(presence(&last), [PRESENCE_PRESENT, PRESENCE_GONE, PRESENCE_GONE, PRESENCE_PRESENT]);
    let present: Vec<usize> = last.free().into_iter().filter(|&i| last.is_present(i)).collect();
    let scale = last.meta.ledger.momentum_scale;
    near(Vec3::from(last.meta.ledger.momentum_expected), present_momentum(&last), 1e-12 * scale);
    let angular: Vec3 =
        present.iter().map(|&i| last.x(i).cross(&last.v(i)) * last.mass(i) + last.own_angular_momentum(i)).sum();
    near(Vec3::from(last.meta.ledger.angular_momentum_expected), angular, 1e-12 * scale * 5.0);
    // Kinetic and potential energy of the rest.
    let kinetic: f64 = present
        .iter()
        .map(|&i| 0.5 * (last.mass(i) * last.v(i).norm_squared() + last.own_angular_momentum(i).dot(&last.w(i))))
        .sum();
    let pair = -0.01 * last.mass(0) * last.mass(3) / (last.x(0) - last.x(3)).norm();
    let uniform: f64 = present.iter().map(|&i| -last.mass(i) * 0.01 * last.x(i).z).sum();
    let ledger = &last.meta.ledger;
    let expected = ledger.energy_start + ledger.contact_work + ledger.outside_work;
    // The scheme conserves energy to second order in h; the bodies that left had 0.26 J each.
    equal(kinetic + pair + uniform, expected, 1e-4);
    assert!(ledger.outside_work < -0.2, "{}", ledger.outside_work);
}

/// Balls that enter at the same position one after the other, with 1 m/s downwards, above a sink.
fn rain(number: usize, speed: f64) -> Case {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    for _ in 0..number {
        let body = case.sphere(0.5, [0.0, 0.0, 4.0]);
        case.launch(body, [0.0, 0.0, -speed], [0.0, 3.0, 0.0]);
    }
    let (name, bodies) = ("rain".into(), BodySelection::Colour("GRAIN".into()));
    case.options.sources = vec![Source { name, bodies, order: None, from: 1.0, rate: 0.5 }];
    case.options.sinks = vec![sink_below(0.0)];
    case.options.probes = vec![removed(1), probe("entered", 1, ProbeQuantity::Entered { from: "rain".into() })];
    case.options.dt = 0.125;
    case
}

/// Steps after which a probe has counted bodies, with their number.
fn counts(case: &Case, name: &str) -> Vec<[u64; 2]> {
    let rows = rows(case, name).into_iter().filter(|row| row[3] != 0.0);
    rows.map(|row| [row[0] as u64, row[3] as u64]).collect()
}

#[test]
fn bodies_enter_at_their_times_with_their_velocities() {
    let mut case = rain(3, 1.0);
    let states = case.states(80, 1);
    // At 1, 3 and 5 s; 4 m at 1 m/s take 32 steps, and one more brings them below.
    assert_eq!(counts(&case, "entered"), [[8, 1], [24, 1], [40, 1]]);
    assert_eq!(counts(&case, "removed"), [[41, 1], [57, 1], [73, 1]]);
    assert_eq!(presence(&states[0]), [PRESENCE_WAITING; 3]);
    assert_eq!(presence(&states[30]), [PRESENCE_PRESENT, PRESENCE_PRESENT, PRESENCE_WAITING]);
    assert_eq!(presence(&states[80]), [PRESENCE_GONE; 3]);
    near(states[24].x(0), [0.0, 0.0, 2.0], 1e-12);
    near(states[24].v(1), [0.0, 0.0, -1.0], 1e-12);
    near(states[24].w(1), [0.0, 3.0, 0.0], 1e-12);
    for state in &states {
        near(Vec3::from(state.meta.ledger.momentum_expected), present_momentum(state), 1e-12);
    }
}

#[test]
fn a_body_waits_until_its_position_is_free() {
    let mut case = rain(3, 0.25);
    case.options.sources[0].rate = 8.0;
    case.run(200);
    // After 1 s, then when the one before is 1 m away, and farther by what the next step may close, which is nothing.
    let entered = counts(&case, "entered");
    assert_eq!(entered.iter().map(|row| row[0]).collect::<Vec<_>>(), [8, 40, 72]);
}

#[test]
fn bodies_that_enter_touch_and_pile_up() {
    let mut case = rain(6, 2.0);
    case.floor();
    case.options.sinks.clear();
    case.options.probes.clear();
    (case.gravity, case.options.dt) = ([0.0, 0.0, -8.0], 1.0 / 64.0);
    let last = case.run(64 * 16);
    assert_eq!(presence(&last), [PRESENCE_PRESENT; 7]);
    for i in last.free() {
        // They roll on the floor or lie on each other, and none is below it by more than the tolerance allows.
        assert!(last.x(i).z > 0.5 - 1e-3, "{}", last.x(i));
    }
    near(
        Vec3::from(last.meta.ledger.momentum_expected),
        present_momentum(&last),
        1e-9 * last.meta.ledger.momentum_scale,
    );
}

/// Bodies that fall by 0.5 m onto a floor under 8 m/s² take √(1/8) s. A run until they are at rest waits for those of sources.
#[test]
fn a_run_until_rest_waits_for_the_bodies_of_sources() {
    let fallen = |from: &[f64]| {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        case.gravity = [0.0, 0.0, -8.0];
        for k in 0..3 {
            case.sphere(0.5, [3.0 * f64::from(k), 0.0, 1.0]);
        }
        case.floor();
        let source = |(k, from): (usize, &f64)| Source {
            name: format!("source{k}"),
            bodies: BodySelection::Body(2 + k),
            order: None,
            from: *from,
            rate: 1.0,
        };
        case.options.sources = from.iter().enumerate().map(source).collect();
        case.options.until = vec![at_rest_below(1e-3, 0.25)];
        (case.options.dt, case.options.steps) = (1.0 / 64.0, Some(640));
        case
    };
    let fall = (1.0f64 / 8.0).sqrt();
    for from in [&[][..], &[1.0], &[1.0, 3.0], &[0.125, 0.25]] {
        let case = fallen(from);
        case.write();
        assert_eq!(case.solve(&[]), 0);
        let last = case.last();
        // The ball touches within a step after its fall, and rests from the beginning of the step that stops it.
        let rests = from.last().unwrap_or(&0.0) + fall + 0.25;
        let end = last.meta.time - rests;
        assert!((-1.0 / 64.0..=2.0 / 64.0).contains(&end), "{from:?}: {end}");
        for i in last.free() {
            near(last.x(i), [3.0 * i as f64, 0.0, 0.5], 1e-3);
            assert!(last.v(i).norm() <= 1e-3, "{from:?}: {}", last.v(i));
        }
        // Interrupted where all bodies of the run are at rest and others wait, it continues to the same end.
        let resumed = fallen(from);
        resumed.write();
        for flags in [&["--steps", "60"][..], &["--steps", "640", "--resume"]] {
            assert_eq!(resumed.solve(flags), 0);
        }
        let state = |case: &Case| fs::read(case.path().join(format!("OUTBOX/snapshot-{:06}.npz", last.meta.step)));
        assert!(state(&case).unwrap() == state(&resumed).unwrap(), "{from:?}");
    }
    // A body that never finds its position: the run does not end by rest, although all others are at rest.
    let mut blocked = fallen(&[1.0]);
    blocked.dof[1].displacement[0] = -3.0;
    blocked.write();
    assert_eq!(blocked.solve(&[]), 0);
    assert_eq!(blocked.last().meta.step, 640);
    assert_eq!(presence(&blocked.last())[1], PRESENCE_WAITING);
}

/// Grains of any shape that rain into an open tub with a drain, with their own gravity and bonds.
pub fn mixed(polyhedra: bool) -> Case {
    let mut case = Case::new();
    case.law_of_all("IQS_WET_DS_CLB", &[0.05, 0.0, 0.02, 0.3, 0.5]);
    case.gravity = [0.0, 0.0, -4.0];
    let mut random = uniform(5);
    for k in 0..40 {
        let x = [0; 2].map(|_| 3.0 * (random() - 0.5));
        let z = if k < 20 { 1.0 + 0.35 * f64::from(k) } else { 5.0 };
        let body = if polyhedra && k % 2 == 0 {
            case.block([0.25, 0.35, 0.45], [x[0], x[1], z], AXES)
        } else {
            case.sphere(0.3 + 0.1 * random(), [x[0], x[1], z])
        };
        case.launch(body, [random() - 0.5, random() - 0.5, -1.0], [0; 3].map(|_| 2.0 * random()));
        if k >= 20 {
            let [Contactor { colour, .. }] = &mut case.bodies[body].contactors[..] else { unreachable!() };
            *colour = "RAINx".into();
        }
    }
    for law in case.tact.visibility.clone() {
        for side in 1..4 {
            let mut row = law.clone();
            row.candidate.colour = if side & 1 > 0 { "RAINx".into() } else { row.candidate.colour };
            if row.antagonist.colour == "GRAIN" {
                row.antagonist.colour = if side & 2 > 0 { "RAINx".into() } else { row.antagonist.colour };
            } else if side > 1 {
                continue;
            }
            if row.candidate.contactor == row.antagonist.contactor && side == 2 {
                continue;
            }
            case.tact.visibility.push(row);
        }
    }
    case.floor();
    let drain = SpaceRegion::Cylinder { start: [0.0; 3], end: [0.0, 0.0, 0.5], radius: 0.7 };
    let far = SpaceRegion::Beyond { centre: [0.0; 3], radius: 6.0 };
    case.options.sinks = vec![sink(drain), Sink { name: "far".into(), region: far }];
    let bodies = BodySelection::Colour("RAINx".into());
    let order = Some(EntryOrder::Random(3));
    case.options.sources = vec![Source { name: "rain".into(), bodies, order, from: 0.2, rate: 20.0 }];
    case.options.probes =
        vec![removed(7), probe("force", 3, ProbeQuantity::Force { on: BodySelection::Body(41), about: None })];
    let options = &mut case.options;
    (options.self_gravity, options.gravity_constant) = (true, 0.01);
    (options.dt, options.tol, options.max_sweeps) = (0.01, Some(1e-4), Some(500));
    (options.steps, options.output_every) = (Some(160), 40);
    if !polyhedra {
        options.adaptive = Some(Adaptive { max_multiple: 4, ..Adaptive::default() });
    }
    case
}

/// Files of OUTBOX and of the probes.
fn all_files(case: &Case) -> BTreeMap<String, Vec<u8>> {
    let mut files = outbox(&case.path());
    for name in ["probe-removed.csv", "probe-force.csv"] {
        files.insert(name.into(), fs::read(case.path().join("POSTPRO").join(name)).unwrap());
    }
    files
}

#[test]
fn resumed_runs_and_any_number_of_threads_give_the_same_bytes() {
    for polyhedra in [false, true] {
        let run = |parts: &[&[&str]]| {
            let case = mixed(polyhedra);
            case.write();
            parts.iter().for_each(|flags| assert_eq!(case.solve(flags), 0));
            (all_files(&case), case.last())
        };
        let (unbroken, last) = run(&[&[]]);
        let count = |value: u8| presence(&last).iter().filter(|of_body| **of_body == value).count();
        // A check of the check: some have left, some have entered.
        assert!(count(PRESENCE_GONE) > 3 && count(PRESENCE_WAITING) < 18, "{:?}", presence(&last));
        let (threads, _) = run(&[&["--threads", "3"]]);
        same(&unbroken, &threads);
        let (resumed, _) = run(&[&["--steps", "40"], &["--steps", "120", "--resume"], &["--steps", "160", "--resume"]]);
        same(&unbroken, &resumed);
    }
}

#[test]
fn the_energy_of_what_is_left_is_that_of_a_run_without_the_others() {
    // A run from which a far ball leaves continues as if it had never been there.
    let run = |sinks: Vec<Sink>, number: usize| {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        case.gravity = [0.0, 0.0, -8.0];
        case.sphere(0.5, [0.0, 0.0, 1.0]);
        case.sphere(0.5, [0.2, 0.1, 2.5]);
        if number > 2 {
            case.sphere(0.5, [30.0, 0.0, 9.0]);
        }
        case.floor();
        (case.options.dt, case.options.sinks) = (1.0 / 64.0, sinks);
        case.run(100)
    };
    let far = sink(SpaceRegion::Box { lower: [20.0, -1.0, 0.0], upper: [40.0, 1.0, 20.0] });
    let (with, without) = (run(vec![far], 3), run(Vec::new(), 2));
    assert_eq!(presence(&with), [PRESENCE_PRESENT, PRESENCE_PRESENT, PRESENCE_GONE, PRESENCE_PRESENT]);
    for i in 0..2 {
        // Before it leaves, its motion enters the tolerance of the first step.
        near(with.x(i), without.x(i), 1e-9);
        near(with.v(i), without.v(i), 1e-8);
    }
}

/// A point mass with G M = 1000 m³/s², whose surface is a sink of radius 10 m, and a sink beyond 250 m.
fn planet() -> Case {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    case.options.gravity_constant = 1.0;
    case.options.fields =
        vec![ExternalField::PointMass { mass: 1000.0, position: Some([0.0; 3]), orbit: None, response: false }];
    let surface = SpaceRegion::Ball { centre: [0.0; 3], radius: 10.0 };
    let space = SpaceRegion::Beyond { centre: [0.0; 3], radius: 250.0 };
    case.options.sinks = vec![sink(surface), Sink { name: "space".into(), region: space }];
    let escaped = ProbeQuantity::Removed { by: "space".into() };
    case.options.probes = vec![removed(1), probe("escaped", 1, escaped)];
    case.options.dt = 1.0 / 64.0;
    case
}

#[test]
fn infall_is_accreted_up_to_the_impact_parameter_of_gravitational_focusing() {
    let mut case = planet();
    let (start, speed) = (-200.0, 5.0);
    // v² at the surface from rest at infinity is 200 m²/s².
    let limit = |b: f64| 10.0 * (1.0 + (200.0 - 2000.0 / f64::hypot(start, b)) / (speed * speed)).sqrt();
    let impact_parameters = [0.0, 10.0, 20.0, 28.5, 30.0, 40.0];
    for b in impact_parameters {
        let body = case.sphere(0.01, [start, b, 0.0]);
        case.launch(body, [speed, 0.0, 0.0], [0.0; 3]);
    }
    let (name, bodies) = ("stream".into(), BodySelection::Free);
    case.options.sources = vec![Source { name, bodies, order: None, from: 0.0, rate: 1.0 }];
    let last = case.run(64 * 120);
    // The limit is 29.3 m.
    assert!(limit(28.5) > 29.2 && limit(30.0) < 29.4);
    let hits = impact_parameters.iter().filter(|b| **b < limit(**b)).count() as u64;
    let sum = |name: &str| counts(&case, name).iter().map(|row| row[1]).sum::<u64>();
    assert_eq!([sum("removed"), sum("escaped")], [hits, 6 - hits]);
    assert_eq!(presence(&last), [PRESENCE_GONE; 6]);
    // They are removed within a step below the surface: v² = v_start² + 2 G M (1/r - 1/r_start).
    let rows = rows(&case, "removed");
    for (row, b) in rows.iter().filter(|row| row[3] > 0.0).zip(impact_parameters) {
        let squared_speed = |r: f64| speed * speed + 2000.0 * (1.0 / r - 1.0 / f64::hypot(start, b));
        let found = 2.0 * row[8] / row[4];
        let [above, below] = [10.0, 10.0 - squared_speed(10.0).sqrt() / 64.0].map(squared_speed);
        // The scheme keeps the energy to (h ω)², ω = 1 rad/s at the surface.
        assert!(above * (1.0 - 1e-3) < found && found < below * (1.0 + 1e-3), "{found}: {above} to {below}");
    }
}

#[test]
fn ejecta_are_lost_from_the_escape_speed_on() {
    let mut case = planet();
    let escape_speed = 200f64.sqrt();
    for (k, factor) in [0.8, 0.9, 1.1, 1.5].into_iter().enumerate() {
        let (sin, cos) = (k as f64).sin_cos();
        let body = case.sphere(0.01, [10.0 * cos, 10.0 * sin, 0.0]);
        case.launch(body, [factor * escape_speed * cos, factor * escape_speed * sin, 0.0], [0.0; 3]);
    }
    let last = case.run(64 * 100);
    assert_eq!(presence(&last), [PRESENCE_GONE; 4]);
    // The two slower ones turn at R / (1 - 0.8²) = 28 m and 53 m and fall back; the faster ones leave first.
    let [fallen, escaped] = ["removed", "escaped"].map(|name| counts(&case, name));
    assert_eq!([fallen.len(), escaped.len()], [2, 2]);
    let mass = last.mass(0);
    for (row, factor) in rows(&case, "escaped").iter().filter(|row| row[3] > 0.0).zip([1.5f64, 1.1]) {
        let residual = row[8] / mass - 1000.0 / 250.0;
        let expected = 100.0 * (factor * factor - 1.0);
        // The first step is not resolved to the last digit: h ω = 1/64 at the surface.
        equal(residual, expected, 2e-2 * expected + 0.1);
    }
    near(Vec3::from(last.meta.ledger.momentum_expected), [0.0; 3], 1e-12 * last.meta.ledger.momentum_scale);
}

#[test]
fn conditions_count_bodies_that_leave_and_enter() {
    let mut case = rain(3, 1.0);
    let (probe, column) = ("removed".into(), "number".into());
    case.options.until = vec![EndCondition::Above { probe, column, value: 0.5 }];
    case.options.steps = Some(200);
    case.write();
    assert_eq!(case.solve(&[]), 0);
    assert_eq!(case.last().meta.step, 41);
}

#[test]
fn combinations_that_are_not_computed_are_rejected() {
    let refused = |change: &dyn Fn(&mut Case), expected: &[&str]| {
        let mut case = rain(2, 1.0);
        case.floor();
        change(&mut case);
        case.options.steps = Some(1);
        case.write();
        let output = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).output().unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{text}");
        for part in expected {
            assert!(text.contains(part), "{text}\n{part}");
        }
        assert!(!case.path().join("OUTBOX").exists());
    };
    refused(&|case| case.options.text = true, &["COMPUTE.RON:", ": sinks: with text; expected no text"]);
    let imposed = &["source 1, bodies: body 3 with imposed motion; expected bodies that move freely"];
    refused(&|case| case.options.sources[0].bodies = BodySelection::Body(3), imposed);
    let unknown = &["source 1, bodies: 9; expected 1 to 3, a body of BODIES.DAT"];
    refused(&|case| case.options.sources[0].bodies = BodySelection::Body(9), unknown);
    let inside = &["body 1 enters in the region of the sink 'lost'; expected positions outside of all sinks"];
    refused(&|case| case.options.sinks = vec![sink_below(5.0)], inside);
    let unnamed = &["probe 1, quantity, by: 'lost' is no sink"];
    refused(&|case| case.options.sinks.clear(), unnamed);
    let twice = &["source 1, name: 'lost'; expected a name of its own"];
    refused(&|case| case.options.sources[0].name = "lost".into(), twice);
    let rate = &["source 1, rate: 0.0; expected a finite number > 0 of bodies per second"];
    refused(&|case| case.options.sources[0].rate = 0.0, rate);
    let flat = SpaceRegion::Below { point: [0.0; 3], normal: [0.0; 3] };
    let normal = &["sink 1, region: ", "; expected a finite point and a normal other than 0"];
    refused(&|case| case.options.sinks = vec![sink(flat.clone())], normal);
}

#[test]
fn an_empty_run_begins_and_ends() {
    // Before the first body enters there is nothing, not even of its own gravity, and after the last has left.
    for polyhedra in [false, true] {
        let mut case = rain(2, 1.0);
        if polyhedra {
            let vertices: Vec<[f64; 3]> =
                (0..8u32).map(|k| [0, 1, 2].map(|i| if k >> i & 1 == 1 { 0.25 } else { -0.25 })).collect();
            for body in &mut case.bodies {
                body.contactors[0].shape =
                    ShapeRecord::Polyhedron { vertices: vertices.clone(), triangles: crate::case::BOX.to_vec() };
            }
        }
        case.options.self_gravity = true;
        case.options.probes.push(probe("motion", 1, ProbeQuantity::Motion { of: BodySelection::Free }));
        case.options.steps = Some(100);
        case.write();
        assert_eq!(case.solve(&["--plan"]), 0);
        assert_eq!(case.solve(&[]), 0);
        assert_eq!(presence(&case.last()), [PRESENCE_GONE; 2]);
        let motion = fs::read_to_string(case.path().join("POSTPRO/probe-motion.csv")).unwrap();
        // Without a body there is no value, and no NaN.
        assert!(motion.lines().nth(1).unwrap().ends_with(",,,,,,,,,") && !motion.contains("NaN"), "{motion}");
        assert_eq!(case.solve(&["--resume", "--steps", "120"]), 0);
    }
}
