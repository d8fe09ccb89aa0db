//! Probes, with forces and motions in closed form, and the conditions that end a run.

use std::f64::consts::PI;
use std::fs;
use std::process::Command;

use cd_formats::probe::{BodySelection, EndCondition, Probe, ProbeQuantity};
use cd_formats::region::SpaceRegion;

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
    // The resultant acts at x = 1.5 m, 3.5 m before the point and 7 m aside of it.
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

/// Condition that no free body is faster than `speed` (m/s) for `during` (s).
pub fn at_rest_below(speed: f64, during: f64) -> EndCondition {
    EndCondition::AtRest { speed: Some(speed), kinetic_over_potential: None, during }
}

/// Condition that the kinetic energy is at most `ratio` times the potential energy for `during` (s).
fn energy_below(ratio: f64, during: f64) -> EndCondition {
    EndCondition::AtRest { speed: None, kinetic_over_potential: Some(ratio), during }
}

/// A ball of radius 1/2 m that is thrown up with 4 m/s under 8 m/s² has m v²/2 <= m g R/16, its lowest point being its own,
/// while |v| <= √(1/2) m/s. v = 4 - k/8 after k steps of 1/64 s: from the step 27 on, which begins at 26/64 s.
#[test]
fn kinetic_energy_over_that_above_the_lowest_point_ends_a_run() {
    let last = |origin: f64, ratio: f64, steps: u64| {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        case.gravity = [0.0, 0.0, -8.0];
        let body = case.sphere(0.5, [0.0, 0.0, origin]);
        case.launch(body, [0.0, 0.0, 4.0], [0.0; 3]);
        (case.options.dt, case.options.steps) = (1.0 / 64.0, Some(steps));
        case.options.until = vec![energy_below(ratio, 0.125)];
        case.write();
        assert_eq!(case.solve(&[]), 0);
        case.last().meta.step
    };
    // Eight steps.
    assert_eq!([0.0, 1e3, -7.0].map(|origin| last(origin, 1.0 / 16.0, 60)), [34; 3]);
    // |v| <= 0.1 m/s for less than two steps.
    assert_eq!(last(0.0, 0.01 / 8.0, 60), 60);
}

/// On a circular orbit about each other the kinetic energy of two balls is half of G m²/d.
#[test]
fn kinetic_energy_over_that_of_self_gravity_ends_a_run() {
    let last = |ratio: f64| {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        let mass = 4.0 / 3.0 * PI;
        let speed = (mass / 8.0 / 2.0).sqrt();
        for side in [-1.0, 1.0] {
            let body = case.sphere(1.0, [2.0 * side * 2.0, 0.0, 0.0]);
            case.launch(body, [0.0, side * speed, 0.0], [0.0; 3]);
        }
        (case.options.self_gravity, case.options.gravity_constant) = (true, 1.0);
        (case.options.dt, case.options.steps) = (1.0 / 64.0, Some(100));
        case.options.until = vec![energy_below(ratio, 0.25)];
        case.write();
        assert_eq!(case.solve(&[]), 0);
        case.last().meta.step
    };
    // The scheme keeps it to (h ω)² = 1e-5.
    assert_eq!([0.501, 0.499].map(last), [16, 100]);
}

#[test]
fn conditions_that_never_hold_are_rejected() {
    let code = |until: EndCondition, gravity: f64, self_gravity: bool| {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        case.gravity = [0.0, 0.0, gravity];
        case.sphere(1.0, [0.0; 3]);
        if self_gravity {
            case.sphere(1.0, [4.0, 0.0, 0.0]);
        }
        (case.options.dt, case.options.steps) = (0.125, Some(1));
        case.options.self_gravity = self_gravity;
        case.options.until = vec![until];
        case.write();
        case.solve(&[])
    };
    let energy = || energy_below(0.1, 1.0);
    assert_eq!([code(energy(), 0.0, false), code(energy(), -1.0, false), code(energy(), 0.0, true)], [2, 0, 0]);
    for (speed, kinetic_over_potential) in [(None, None), (Some(1.0), Some(1.0)), (None, Some(0.0))] {
        assert_eq!(code(EndCondition::AtRest { speed, kinetic_over_potential, during: 1.0 }, -1.0, false), 2);
    }
    let separation = |a, b| EndCondition::Separation { between: (a, b), distance: 5.0 };
    let body = BodySelection::Body;
    assert_eq!(code(separation(body(1), body(2)), 0.0, true), 0);
    assert_eq!(code(separation(body(1), body(1)), 0.0, true), 2);
    assert_eq!(code(separation(BodySelection::Free, BodySelection::Colour("GRAIN".into())), 0.0, true), 2);
}

#[test]
fn bodies_at_rest_end_a_run_after_the_given_time() {
    let mut case = resting();
    case.options.steps = Some(1000);
    case.options.until = vec![at_rest_below(1e-3, 0.25)];
    case.write();
    assert_eq!(case.solve(&[]), 0);
    // 16 steps of 1/64 s.
    assert_eq!(case.last().meta.step, 16);
    // A run that has ended does not continue.
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
        case.options.until = vec![at_rest_below(1e-3, 0.25)];
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

/// Probe of the means over all free bodies in a region.
fn region_probe(inside: SpaceRegion, every: u64) -> Probe {
    probe(&format!("region{every}"), every, ProbeQuantity::Region { of: BodySelection::Free, inside })
}

/// Columns of the file of a probe by name, at its last row; empty fields are not a number.
fn last_row(case: &Case, name: &str) -> impl Fn(&str) -> f64 {
    let text = fs::read_to_string(case.path().join(format!("POSTPRO/probe-{name}.csv"))).unwrap();
    let split = |line: &str| line.split(',').map(String::from).collect::<Vec<_>>();
    let (names, fields) = (split(text.lines().next().unwrap()), split(text.lines().last().unwrap()));
    move |column| fields[names.iter().position(|name| name == column).unwrap()].parse().unwrap_or(f64::NAN)
}

/// Balls of radius 0.5 m and volume π/6 m³ on a cubic lattice of these counts, with the spacing `spacing` (m) from 0.5 m
/// above z = 0, and the velocity L x + u.
fn lattice(counts: [usize; 3], spacing: f64, gradient: [[f64; 3]; 3], u: [f64; 3]) -> Case {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.0]);
    for k in 0..counts.iter().product() {
        let index = [k % counts[0], k / counts[0] % counts[1], k / counts[0] / counts[1]];
        let x = index.map(|i| spacing * i as f64 + 0.5);
        let body = case.sphere(0.5, x);
        let v = [0, 1, 2].map(|i| u[i] + (0..3).map(|j| gradient[i][j] * x[j]).sum::<f64>());
        case.launch(body, v, [0.0; 3]);
    }
    case.options.dt = 1.0 / 64.0;
    case
}

#[test]
fn a_lattice_under_its_weight_has_its_solid_fraction_and_stress() {
    // Columns of six balls; g = 8 m/s². A ball weighs 8 π/6 N, and each column stands on one square metre.
    let mut case = lattice([4, 3, 6], 1.0, [[0.0; 3]; 3], [0.0; 3]);
    case.gravity = [0.0, 0.0, -8.0];
    case.floor();
    case.options.tol = Some(1e-10);
    let weight = 8.0 * PI / 6.0;
    // Faces of the box cut caps of equal height off the balls below and above.
    let inside = SpaceRegion::Box { lower: [0.0, 0.0, 1.25], upper: [4.0, 3.0, 4.25] };
    let all = SpaceRegion::Box { lower: [-1.0, -1.0, -1.0], upper: [5.0, 4.0, 7.0] };
    let wide = SpaceRegion::Cylinder { start: [2.0, 2.0, -1.0], end: [2.0, 2.0, 7.0], radius: 30.0 };
    let of = || BodySelection::Free;
    case.options.probes = vec![
        region_probe(inside, 1),
        probe("all", 1, ProbeQuantity::Region { of: of(), inside: all.clone() }),
        probe("wide", 1, ProbeQuantity::Region { of: of(), inside: wide }),
        probe("second", 1, ProbeQuantity::Region { of: BodySelection::Body(13), inside: all }),
    ];
    case.run(8);
    let part = last_row(&case, "region1");
    // A radius is that of the file, of eight digits, and the balls sink by some 1e-9 m.
    let bound = 1e-7;
    equal(part("nu"), PI / 6.0, bound);
    equal(part("density"), PI / 6.0, bound);
    equal(part("diameter"), 1.0, bound);
    equal(part("grains"), 36.0, 0.0);
    // Branches from 0.5 m up: 5 weights on a quarter of a metre, 4 and 3 on one, 2 on three quarters, over 3 m.
    let expected = 9.75 / 3.0 * weight;
    equal(part("sigma_zz"), expected, bound * weight);
    for column in ["sigma_xx", "sigma_yy", "sigma_xy", "sigma_xz", "sigma_yz", "pressure_kinetic", "temperature"] {
        equal(part(column), 0.0, bound * weight);
    }
    equal(part("pressure"), expected / 3.0, bound * weight);
    // √(s:s/2) of (0, 0, σ) is σ/√3.
    equal(part("mu"), 3f64.sqrt(), bound);
    // Stress of all grains: forces of 6 to 1 weights, that on the floor with half a branch.
    let whole = last_row(&case, "all");
    equal(whole("nu"), 72.0 * PI / 6.0 / 240.0, bound);
    equal(whole("sigma_zz"), 12.0 * (0.5 * 6.0 + 15.0) * weight / 240.0, bound * weight);
    let cylinder = last_row(&case, "wide");
    equal(cylinder("sigma_zz") * PI * 900.0 * 8.0, 12.0 * 18.0 * weight, bound * 12.0 * weight);
    equal(cylinder("nu") * PI * 900.0 * 8.0, 72.0 * PI / 6.0, 10.0 * bound);
    // Other bodies act on one selected body like walls: 5 weights from below, 4 from above, at half a metre each.
    equal(last_row(&case, "second")("sigma_zz"), (0.5 * 5.0 + 0.5 * 4.0) * weight / 240.0, bound * weight);
}

#[test]
fn a_sheared_lattice_has_its_gradient_and_no_temperature() {
    let gradient = [[0.125, 0.5, -2.0], [0.25, 0.0, 0.75], [1.0, -0.5, -0.125]];
    let mut case = lattice([5, 5, 5], 2.0, gradient, [3.0, -1.0, 2.0]);
    case.options.dt = 1e-6;
    // The region cuts many balls, each of which moves with the field at its centre.
    let inside = SpaceRegion::Ball { centre: [4.5, 4.5, 4.5], radius: 3.25 };
    case.options.probes = vec![region_probe(inside, 1)];
    case.run(1);
    let found = last_row(&case, "region1");
    let (axes, centre) = (["x", "y", "z"], [4.5; 3]);
    // The field changes by L² dt ~ 1e-5 in the step.
    let bound = 1e-4;
    for (i, row) in gradient.iter().enumerate() {
        for (j, expected) in row.iter().enumerate() {
            equal(found(&format!("gradient_{}{}", axes[i], axes[j])), *expected, bound);
        }
        let v = [3.0, -1.0, 2.0][i] + (0..3).map(|j| row[j] * centre[j]).sum::<f64>();
        equal(found(&format!("v_{}", axes[i])), v, bound);
    }
    equal(found("temperature"), 0.0, 1e-9);
    // Symmetric parts: 0.375 of xy, -0.5 of xz, 0.125 of yz, ±0.125 on the diagonal.
    let square: f64 = 2.0 * (0.375f64.powi(2) + 0.5f64.powi(2) + 0.125f64.powi(2)) + 2.0 * 0.125f64.powi(2);
    equal(found("shear_rate"), (2.0 * square).sqrt(), bound);
}

#[test]
fn a_lattice_that_turns_does_not_shear_and_one_that_shakes_is_hot() {
    let turning = [[0.0, -0.5, 0.25], [0.5, 0.0, -0.75], [-0.25, 0.75, 0.0]];
    let mut case = lattice([4, 4, 4], 2.0, turning, [0.0; 3]);
    // Every second ball moves along y, by turns up and down, at 0.5 m/s.
    let mut hot = lattice([4, 4, 4], 2.0, [[0.0; 3]; 3], [1.0, 0.0, 0.0]);
    for k in 0..64 {
        let sign = if (k + k / 4 + k / 16) % 2 == 0 { 0.5 } else { -0.5 };
        hot.launch(k, [1.0, sign, 0.0], [0.0; 3]);
    }
    let inside = SpaceRegion::Box { lower: [-1.0; 3], upper: [9.0; 3] };
    for case in [&mut case, &mut hot] {
        case.options.dt = 1e-6;
        case.options.probes = vec![region_probe(inside.clone(), 1)];
        case.run(1);
    }
    let found = last_row(&case, "region1");
    equal(found("shear_rate"), 0.0, 1e-5);
    equal(found("gradient_xy"), -0.5, 1e-5);
    equal(found("temperature"), 0.0, 1e-9);
    let found = last_row(&hot, "region1");
    let square = 0.25;
    equal(found("temperature"), square / 3.0, 1e-9);
    equal(found("kinetic_yy"), 64.0 * PI / 6.0 * square / 1000.0, 1e-7);
    equal(found("pressure_kinetic"), found("kinetic_yy") / 3.0, 1e-15);
    equal(found("mu"), 3f64.sqrt(), 1e-9);
    // The speeds of a checkerboard of an even number of rows have no gradient; the balls move by 5e-7 m in the step.
    equal(found("shear_rate"), 0.0, 1e-6);
}

#[test]
fn a_region_wider_than_the_period_has_the_images() {
    let mut case = lattice([4, 1, 1], 1.0, [[0.0; 3]; 3], [2.0, 0.0, 0.0]);
    (case.options.xperiode, case.options.yperiode) = (Some(4.0), None);
    let of = || BodySelection::Free;
    let inside = SpaceRegion::Box { lower: [-7.0, 0.0, 0.0], upper: [9.0, 1.0, 1.0] };
    case.options.probes = vec![
        region_probe(inside, 1),
        probe(
            "part",
            1,
            ProbeQuantity::Region {
                of: of(),
                inside: SpaceRegion::Box { lower: [5.25, 0.0, 0.0], upper: [6.25, 1.0, 1.0] },
            },
        ),
    ];
    // The balls travel over half a period.
    case.run(70);
    let found = last_row(&case, "region1");
    equal(found("grains"), 16.0, 0.0);
    equal(found("nu"), PI / 6.0, 1e-7);
    equal(last_row(&case, "part")("nu"), PI / 6.0, 1e-7);
}

#[test]
fn an_empty_region_has_empty_fields() {
    let mut case = resting();
    case.options.probes = vec![region_probe(SpaceRegion::Ball { centre: [0.0, 90.0, 0.0], radius: 1.0 }, 1)];
    case.options.until = vec![EndCondition::Above { probe: "region1".into(), column: "mu".into(), value: -1.0 }];
    case.run(2);
    let found = last_row(&case, "region1");
    for column in ["grains", "nu", "density", "sigma_zz", "kinetic_xx", "pressure"] {
        equal(found(column), 0.0, 0.0);
    }
    for column in ["diameter", "v_x", "temperature", "gradient_xx", "shear_rate", "mu", "inertial_number"] {
        assert!(found(column).is_nan(), "{column}");
    }
    let text = fs::read_to_string(case.path().join("POSTPRO/probe-region1.csv")).unwrap();
    assert!(!text.contains("NaN") && !text.contains("inf") && text.lines().count() == 3, "{text}");
}

#[test]
fn a_value_of_a_region_ends_a_run() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    let body = case.sphere(0.5, [0.0, 0.0, 8.0]);
    case.launch(body, [0.0, 0.0, -1.0], [0.0; 3]);
    (case.options.dt, case.options.steps) = (0.125, Some(100));
    let inside = SpaceRegion::Box { lower: [-1.0, -1.0, 0.0], upper: [1.0, 1.0, 2.0] };
    case.options.probes = vec![region_probe(inside, 9)];
    // Half of π/6 m³ is in the 8 m³ when the centre passes z = 2 m: after 48 steps it is not more than half.
    let value = PI / 96.0 * (1.0 + 1e-9);
    case.options.until = vec![EndCondition::Above { probe: "region9".into(), column: "nu".into(), value }];
    case.write();
    assert_eq!(case.solve(&[]), 0);
    assert_eq!(case.last().meta.step, 49);
}

#[test]
fn rows_of_regions_are_the_same_for_any_threads_and_after_resumes() {
    let files = |parts: &[u64], threads: usize| {
        let mut case = resting();
        case.launch(0, [1.0, 0.5, 0.0], [0.0, 3.0, 0.0]);
        (case.options.output_every, case.options.threads) = (10, threads);
        let inside = || SpaceRegion::Cylinder { start: [1.0, 0.0, 0.1], end: [2.5, 1.0, 3.0], radius: 1.75 };
        case.options.probes = vec![region_probe(inside(), 1), region_probe(inside(), 7)];
        case.write();
        for (k, steps) in parts.iter().enumerate() {
            let steps = format!("--steps={steps}");
            let flags: &[&str] = if k == 0 { &[&steps] } else { &[&steps, "--resume"] };
            assert_eq!(case.solve(flags), 0);
        }
        ["region1", "region7"]
            .map(|name| fs::read_to_string(case.path().join(format!("POSTPRO/probe-{name}.csv"))).unwrap())
    };
    let unbroken = files(&[60], 1);
    assert_eq!(unbroken, files(&[17, 18, 41, 60], 1));
    assert_eq!(unbroken, files(&[60], 3));
    // μ of a row follows from its mean stresses, not from the means of μ.
    let columns = |text: &str, name: &str| -> Vec<f64> {
        let position = text.lines().next().unwrap().split(',').position(|column| column == name).unwrap();
        let value = |line: &str| line.split(',').nth(position).unwrap().parse().unwrap_or(f64::NAN);
        text.lines().skip(1).map(value).collect()
    };
    let mean = columns(&unbroken[0], "sigma_zz")[..7].iter().sum::<f64>() / 7.0;
    equal(columns(&unbroken[1], "sigma_zz")[0], mean, 1e-12 * mean.abs());
}

#[test]
fn regions_without_a_volume_or_of_too_many_periods_are_rejected() {
    let message = |inside: SpaceRegion, of: BodySelection| {
        let mut case = lattice([2, 1, 1], 1.0, [[0.0; 3]; 3], [0.0; 3]);
        (case.options.xperiode, case.options.steps) = (Some(4.0), Some(1));
        case.options.probes = vec![probe("part", 1, ProbeQuantity::Region { of, inside })];
        case.write();
        let output = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).output().unwrap();
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8(output.stderr).unwrap()
    };
    let free = || BodySelection::Free;
    let below = SpaceRegion::Below { point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
    assert!(message(below, free()).contains("expected a Ball, Box or Cylinder"));
    let ball = |radius| SpaceRegion::Ball { centre: [0.0; 3], radius };
    assert!(message(ball(-1.0), free()).contains("expected a finite centre and a radius > 0 m"));
    assert!(message(ball(1e9), free()).contains("expected a region of at most 10000 periodic cells"));
    assert!(message(ball(1e9), BodySelection::Body(0)).contains("expected 1 to 2, a body of BODIES.DAT"));
}
