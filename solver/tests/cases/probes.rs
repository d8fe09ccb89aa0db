//! Probes, with forces and motions in closed form, and the conditions that end a run.

use std::f64::consts::PI;
use std::fs;

use cd_formats::probe::{BodySelection, EndCondition, Probe, ProbeQuantity};

use crate::case::{Case, equal, near};

/// Columns of the file of a probe, by rows.
fn rows(case: &Case, name: &str) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(case.path().join(format!("POSTPRO/probe-{name}.csv"))).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(|field| field.parse().unwrap()).collect()).collect()
}

fn probe(name: &str, every: u64, quantity: ProbeQuantity) -> Probe {
    Probe { name: name.into(), every, quantity }
}

/// Probe `forceN` of the force on bodies, with a row every N steps.
fn force_probe(on: BodySelection, every: u64) -> Probe {
    probe(&format!("force{every}"), every, ProbeQuantity::Force { on, about: None })
}

fn vector(row: &[f64], first: usize) -> [f64; 3] {
    [row[first], row[first + 1], row[first + 2]]
}

/// Two balls of 4/3 π kg at rest on the floor, 3 m apart; g = 8 m/s².
fn resting() -> Case {
    let mut case = Case::new();
    case.gravity = [0.0, 0.0, -8.0];
    case.law_of_all("IQS_CLB", &[0.5]);
    case.sphere(1.0, [0.0, 0.0, 1.0]);
    case.sphere(1.0, [3.0, 0.0, 1.0]);
    case.floor();
    (case.options.dt, case.options.tol) = (1.0 / 64.0, Some(1e-10));
    case
}

#[test]
fn a_floor_bears_the_weight_and_its_torque() {
    let mut case = resting();
    let on = |number: usize| BodySelection::Body(number);
    let force = |on: BodySelection, about: Option<[f64; 3]>| ProbeQuantity::Force { on, about };
    case.options.probes = vec![
        probe("floor", 1, force(on(3), Some([0.0; 3]))),
        probe("ball", 1, force(on(2), None)),
        probe("both", 1, force(BodySelection::Free, None)),
        probe("all", 1, force(BodySelection::Free, Some([5.0, 7.0, 0.0]))),
    ];
    case.run(8);
    let weight = 8.0 * 4.0 / 3.0 * PI;
    // The tolerance of the contacts is 1e-10 of their impulses.
    let bound = 1e-8 * weight;
    let last = |name: &str| rows(&case, name).pop().unwrap();
    near(vector(&last("floor"), 3), [0.0, 0.0, -2.0 * weight], bound);
    // x × F of the second ball, at x = 3 m.
    near(vector(&last("floor"), 6), [0.0, 3.0 * weight, 0.0], bound);
    near(vector(&last("ball"), 3), [0.0, 0.0, weight], bound);
    near(vector(&last("ball"), 6), [0.0; 3], bound);
    near(vector(&last("both"), 3), [0.0, 0.0, 2.0 * weight], bound);
    near(vector(&last("both"), 6), [0.0; 3], bound);
    // The resultant acts at x = 1.5 m, 3.5 m before and 7 m beside the point.
    near(vector(&last("all"), 6), [-7.0 * 2.0 * weight, 3.5 * 2.0 * weight, 0.0], bound);
}

#[test]
fn rows_of_several_steps_have_the_mean_force() {
    // A ball falls onto the floor within the row: its momentum is the impulse of the floor less its weight.
    let mut case = Case::new();
    case.gravity = [0.0, 0.0, -8.0];
    case.law_of_all("IQS_CLB", &[0.5]);
    case.sphere(1.0, [0.0, 0.0, 1.25]);
    case.floor();
    (case.options.dt, case.options.output_every) = (1.0 / 64.0, 1000);
    let force = |every| force_probe(BodySelection::Body(1), every);
    case.options.probes = vec![force(1), force(32)];
    case.run(64);
    let (each, mean) = (rows(&case, "force1"), rows(&case, "force32"));
    assert_eq!((each.len(), mean.len()), (64, 2));
    let impulse: f64 = each.iter().map(|row| row[2] * row[5]).sum();
    let weight = 8.0 * 4.0 / 3.0 * PI;
    // At rest again, it has received the impulse of its weight.
    equal(impulse, weight, 1e-6 * weight);
    for (half, mean) in each.chunks(32).zip(&mean) {
        equal(mean[2], 0.5, 1e-15);
        equal(mean[5], half.iter().map(|row| row[5]).sum::<f64>() / 32.0, 1e-12 * weight);
    }
}

#[test]
fn a_pair_that_turns_as_one_body_has_its_angular_velocity() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    // Velocity of the centre of mass (1, 2, 3) m/s and 0.5 rad/s about z through it.
    let (u, w) = ([1.0, 2.0, 3.0], 0.5);
    for x in [-4.0, 4.0] {
        let body = case.sphere(1.0, [x, 0.0, 0.0]);
        case.launch(body, [u[0], u[1] + w * x, u[2]], [0.0, 0.0, w]);
    }
    let of = || BodySelection::Free;
    case.options.dt = 1.0 / 1024.0;
    case.options.probes = vec![
        probe("pair", 1, ProbeQuantity::Motion { of: of() }),
        probe("one", 1, ProbeQuantity::Motion { of: BodySelection::Body(2) }),
        probe("energy", 1, ProbeQuantity::Energy { of: of() }),
    ];
    case.run(1);
    let (pair, one, energy) = (rows(&case, "pair"), rows(&case, "one"), rows(&case, "energy"));
    near(vector(&pair[0], 3), u.map(|u| u / 1024.0), 1e-12);
    near(vector(&pair[0], 6), u, 1e-12);
    // The balls move on straight lines: their line turns by 5e-4 rad in the step.
    near(vector(&pair[0], 9), [0.0, 0.0, w], 1e-6);
    near(vector(&one[0], 6), [u[0], u[1] + 4.0 * w, u[2]], 1e-12);
    let mass = 4.0 / 3.0 * PI;
    let kinetic = 0.5 * mass * (2.0 * 14.0 + 2.0 * 4.0);
    // Σ m v²/2 with v = (1, 2 ± 2, 3) m/s, Σ 2/5 m R² w²/2, |v| + w R of the faster ball, and the mass.
    near(vector(&energy[0], 3), [kinetic, 0.4 * mass * w * w, 26.0f64.sqrt() + w], 1e-12 * kinetic);
    equal(energy[0][6], 2.0 * mass, 1e-12);
}

#[test]
fn bodies_at_rest_end_a_run_after_the_given_time() {
    let mut case = resting();
    case.options.steps = Some(1000);
    case.options.until = vec![EndCondition::AtRest { speed: 1e-3, during: 0.25 }];
    case.write();
    assert_eq!(case.solve(&[]), 0);
    // 16 steps of 1/64 s.
    assert_eq!(case.last().meta.step, 16);
    // A run that has ended does not go on.
    assert_eq!(case.solve(&["--resume"]), 0);
    assert_eq!(case.last().meta.step, 16);
}

#[test]
fn distances_and_values_end_a_run() {
    let end = |until: EndCondition| {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        let body = case.sphere(1.0, [0.0; 3]);
        case.sphere(1.0, [4.0, 0.0, 0.0]);
        case.launch(body, [-1.0, 0.0, 0.0], [0.0; 3]);
        (case.options.dt, case.options.steps) = (0.125, Some(100));
        case.options.probes = vec![probe("first", 7, ProbeQuantity::Motion { of: BodySelection::Body(1) })];
        case.options.until = vec![until];
        case.write();
        assert_eq!(case.solve(&[]), 0);
        case.last().meta.step
    };
    let (body, column) = (BodySelection::Body, |value: f64| ("first".to_string(), "x".to_string(), value));
    assert_eq!(end(EndCondition::Separation { between: (body(1), body(2)), distance: 5.0 }), 9);
    let (probe, name, value) = column(-2.0);
    assert_eq!(end(EndCondition::Below { probe, column: name, value }), 17);
    let (probe, name, value) = column(1.0);
    assert_eq!(end(EndCondition::Above { probe, column: name, value }), 100);
}

#[test]
fn resumed_probes_have_the_bytes_of_the_unbroken_run() {
    let files = |parts: &[u64]| {
        let mut case = resting();
        case.launch(0, [1.0, 0.5, 0.0], [0.0, 3.0, 0.0]);
        case.options.output_every = 10;
        case.options.until = vec![EndCondition::AtRest { speed: 1e-3, during: 0.25 }];
        let force = |every| force_probe(BodySelection::Free, every);
        case.options.probes =
            vec![force(1), force(7), probe("m", 3, ProbeQuantity::Motion { of: BodySelection::Free })];
        case.write();
        for (k, steps) in parts.iter().enumerate() {
            let steps = format!("--steps={steps}");
            let flags: &[&str] = if k == 0 { &[&steps] } else { &[&steps, "--resume"] };
            assert_eq!(case.solve(flags), 0);
        }
        ["force1", "force7", "m"].map(|name| fs::read(case.path().join(format!("POSTPRO/probe-{name}.csv"))).unwrap())
    };
    assert!(files(&[60]) == files(&[17, 18, 41, 60]));
}
