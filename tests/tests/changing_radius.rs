//! Hollow cylinders whose radius follows a pressure or a rate.

use std::f64::consts::TAU;
use std::fs;

use cd_tests::case::{Case, assert_same_results, from_outbox};
use cd_tests::columns::csv;

/// A hundred soft balls between two plates in a hollow cylinder (body 101) with this control of its radius.
fn packing(control: &str, compute: &str) -> Case {
    Case::from_scene(&format!(
        r#"(
        seed: 1,
        materials: [(name: "ROCKx", density: 2500.0)],
        laws: [(name: "sprng", kind: ELASTIC_REPELL_CLB(stiffness: 1.0e4, friction: 0.3)),
            (name: "smoth", kind: ELASTIC_REPELL_CLB(stiffness: 1.0e4, friction: 0.0))],
        contacts: [(between: ("GRAIN", "GRAIN"), law: "sprng"), (between: ("GRAIN", "WALLx"), law: "smoth"),
            (between: ("GRAIN", "ENDxx"), law: "smoth")],
        grains: [(material: "ROCKx", colour: "GRAIN", shape: Sphere, number: 100, sizes: Uniform(min: 0.04, max: 0.06),
            placement: JitteredLattice(envelope: Cylinder(radius: 0.3, half_height: 0.4)))],
        walls: [
            Cylinder(material: "ROCKx", colour: "WALLx", centre: (0.0, 0.0, 0.0), half_height: 0.5, radius: 0.31,
                hollow: true, radial: {control}),
            Plate(material: "ROCKx", colour: "ENDxx", centre: (0.0, 0.0, 0.45), half_lengths: (0.4, 0.4, 0.05)),
            Plate(material: "ROCKx", colour: "ENDxx", centre: (0.0, 0.0, -0.45), half_lengths: (0.4, 0.4, 0.05)),
        ],
        compute: (dt: 1.0e-3, quench: 0.01, {compute}),
    )"#
    ))
}

const SERVO: &str = "Stress(value: 1.0e3, gain: 3.0)";

#[test]
fn a_pressure_on_the_inside_is_held() {
    let probe = r#"probes: [(name: "side", quantity: Pressure(on: Body(101)))]"#;
    let case = packing(SERVO, &format!("steps: 900, output_every: 300, {probe}")).solved(&[]);
    let columns = csv(&case.path().join("POSTPRO/probe-side.csv")).unwrap();
    let (areas, pressures) = (&columns["area"], &columns["wall_pressure"]);
    for pressure in &pressures[pressures.len() - 200..] {
        assert!((pressure / 1e3 - 1.0).abs() < 0.01, "{pressure} Pa"); // the servo has settled
    }
    let (end, last) = (case.last_snapshot(), case.steps());
    let radius = end.meta.radii[0];
    // The inside is 1 m high; the radius of the contact configuration.
    let area = TAU * (radius.radius - 0.5e-3 * radius.speed);
    assert!((areas.last().unwrap() / area - 1.0).abs() < 1e-9, "{areas:?}");
    let on_side = (0..end.contacts.contact_body.len()).filter(|&k| end.contacts.contact_body[k][1] == 100);
    let force: f64 = on_side.map(|k| end.contacts.contact_impulse[k][0] / 1e-3).sum();
    assert!((force / (area * pressures.last().unwrap()) - 1.0).abs() < 1e-6, "{force} N");
    assert!(radius.radius < 0.24 && last["rms_penetration"].len() > 1);
}

#[test]
fn a_rate_changes_the_radius_exponentially() {
    let case = packing("Rate(-0.1)", "steps: 200, output_every: 200").solved(&[]);
    let radius = case.last_snapshot().meta.radii[0];
    // From one contact configuration to the next by exp(rate h); both ends of the run are on chords.
    let expected = 0.31 * (-0.1f64 * 0.2).exp();
    assert!((radius.radius / expected - 1.0).abs() < 1e-8, "{radius:?}");
}

#[test]
fn threads_resume_and_continuation_change_nothing() {
    let run = |flags: &[&[&str]]| {
        let case = packing(SERVO, "steps: 240, output_every: 120");
        flags.iter().for_each(|flags| assert_eq!(case.solve(flags), 0, "{flags:?}"));
        case
    };
    let first = run(&[&["--threads", "1"]]);
    let two = run(&[&["--threads", "2"]]);
    let resumed = run(&[&["--threads", "1", "--steps", "120"], &["--threads", "2", "--resume", "--steps", "240"]]);
    let end = |case: &Case| case.last_snapshot();
    for other in [&two, &resumed] {
        assert!(end(&first).bodies == end(other).bodies && end(&first).meta.radii == end(other).meta.radii);
    }
    assert_same_results(&first, &two);
    let half = run(&[&["--steps", "120"]]);
    let next = Case::empty();
    assert_eq!(from_outbox(half.path(), next.path(), "(keep_time: true)"), 0);
    assert_eq!(next.solve(&["--steps", "120"]), 0);
    let (expected, found) = (end(&first), end(&next));
    assert_eq!(expected.meta.radii, found.meta.radii);
    assert!(expected.bodies.body_x == found.bodies.body_x);
    let text = fs::read_to_string(next.datbox("COMPUTE.RON")).unwrap();
    assert!(text.contains("radii"), "{text}");
}
