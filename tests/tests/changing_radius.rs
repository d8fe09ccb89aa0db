//! Hollow cylinders whose radius follows a pressure or a rate.

use std::f64::consts::{PI, TAU};
use std::fs;
use std::path::Path;

use cd_formats::bodies::{Bodies, ShapeRecord};
use cd_formats::compute::ComputeFlags;
use cd_tests::case::{Case, assert_same_results, from_outbox, post, pre};
use cd_tests::columns::{csv, vtp};
use cd_tests::process::{Executables, run_requested_program};

/// Twenty soft balls between two plates in a hollow cylinder (body 21) with this control of its radius; `wall` and `compute`
/// are further keys of the cylinder and of the options.
fn packing_text(control: &str, wall: &str, compute: &str) -> String {
    format!(
        r#"(
        seed: 1,
        materials: [(name: "ROCKx", density: 2500.0)],
        laws: [(name: "sprng", kind: ELASTIC_REPELL_CLB(stiffness: 1.0e4, friction: 0.3)),
            (name: "smoth", kind: ELASTIC_REPELL_CLB(stiffness: 1.0e4, friction: 0.0))],
        contacts: [(between: ("GRAIN", "GRAIN"), law: "sprng"), (between: ("GRAIN", "WALLx"), law: "smoth"),
            (between: ("GRAIN", "ENDxx"), law: "smoth")],
        grains: [(material: "ROCKx", colour: "GRAIN", shape: Sphere, number: 20, sizes: Uniform(min: 0.04, max: 0.06),
            placement: DensePacking(envelope: Cylinder(radius: 0.16, half_height: 0.14)))],
        walls: [
            Cylinder(material: "ROCKx", colour: "WALLx", centre: (0.0, 0.0, 0.0), half_height: 0.24, radius: 0.17,
                hollow: true, radial: {control}, {wall}),
            Plate(material: "ROCKx", colour: "ENDxx", centre: (0.0, 0.0, 0.19), half_lengths: (0.4, 0.4, 0.05)),
            Plate(material: "ROCKx", colour: "ENDxx", centre: (0.0, 0.0, -0.19), half_lengths: (0.4, 0.4, 0.05)),
        ],
        compute: (dt: 1.0e-3, {compute}),
    )"#
    )
}

/// The case of [`packing_text`] without further keys of the cylinder.
fn packing(control: &str, compute: &str) -> Case {
    Case::from_scene(&packing_text(control, "", compute))
}

const SERVO: &str = "Stress(value: 1.0e3, gain: 10.0, average: 0.01)";
/// Height of the inside between the plates, m.
const HEIGHT: f64 = 0.28;
const PROBE: &str = r#"probes: [(name: "side", quantity: Pressure(on: Body(21)))]"#;

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

#[test]
fn a_pressure_on_the_inside_is_held() {
    let case = packing(SERVO, &format!("quench: 0.02, steps: 300, output_every: 25, {PROBE}")).solved(&[]);
    let probe = csv(&case.path().join("POSTPRO/probe-side.csv")).unwrap();
    let series = case.series();
    let ends: Vec<_> = (8..=12).map(|k| case.snapshot(25 * k)).collect();
    // Normal forces of the snapshots on the side over 2π R_c H, with R_c = R - h Ṙ/2; normals of the ends are along z.
    let measured: Vec<f64> = ends
        .iter()
        .map(|end| {
            let (radius, contacts) = (end.meta.radii[0], &end.contacts);
            let is_on_side =
                |k: &usize| contacts.contact_body[*k][1] == 20 && contacts.contact_frame[*k][0][2].abs() < 0.5;
            let on_side = (0..contacts.contact_body.len()).filter(is_on_side);
            let force: f64 = on_side.map(|k| contacts.contact_force[k][0]).sum();
            force / (TAU * (radius.radius - 0.5 * end.meta.h * radius.speed) * HEIGHT)
        })
        .collect();
    // The packing still settles, and the servo follows: snapshots are within 0.5 %, and their means within 0.2 %.
    let is_held = |pressure: f64| (pressure / 1e3 - 1.0).abs() < 0.01;
    let servo = mean(ends.iter().map(|end| end.meta.radii[0].mean_stress));
    assert!(is_held(servo), "{servo} Pa by the servo");
    let forces = mean(measured.iter().copied());
    assert!(is_held(forces), "{forces} Pa by the forces");
    let steps = mean(probe["wall_pressure"][200..].iter().copied());
    assert!(is_held(steps), "{steps} Pa by the probe");
    for ((end, pressure), k) in ends.iter().zip(&measured).zip(8..) {
        let is_equal = |found: f64, expected: f64| (found / expected - 1.0).abs() < 1e-9; // the sums have other orders
        assert!(is_equal(series["cylinder_pressure"][k], *pressure), "{:?}", series["cylinder_pressure"]);
        assert!(is_equal(probe["wall_pressure"][25 * k - 1], *pressure), "step {}", 25 * k);
        assert_eq!(series["cylinder_radius"][k], end.meta.radii[0].radius);
        // The region of the means is the space between the plates in the present cylinder.
        let volume = PI * end.meta.radii[0].radius.powi(2) * HEIGHT;
        assert!(is_equal(series["region_volume"][k], volume), "{} {volume} m3", series["region_volume"][k]);
    }
    assert!(ends[4].meta.radii[0].radius < 0.165, "{:?}", ends[4].meta.radii);
}

#[test]
fn a_rate_changes_the_radius_exponentially_and_its_work_is_external() {
    let case = packing("Rate(-2.0)", &format!("steps: 120, output_every: 60, {PROBE}")).solved(&[]);
    let end = case.last_snapshot();
    // From one contact configuration to the next by exp(rate h); both ends of the run are on chords.
    let expected = 0.17 * (-2.0f64 * 0.12).exp();
    assert!((end.meta.radii[0].radius / expected - 1.0).abs() < 1e-5, "{:?}", end.meta.radii);
    let probe = csv(&case.path().join("POSTPRO/probe-side.csv")).unwrap();
    let (areas, pressures) = (&probe["area"], &probe["wall_pressure"]);
    // Radial speed of each step's end, h Ṙ = (exp(rate h) - 1) R_c; forces act through the mean of both ends.
    let speeds = areas.iter().map(|area| (-2e-3f64).exp_m1() / 1e-3 * area / (TAU * HEIGHT));
    let speeds: Vec<f64> = std::iter::once(-2.0 * 0.17).chain(speeds).collect();
    let work = |k: usize| -pressures[k] * areas[k] * 1e-3 * 0.5 * (speeds[k] + speeds[k + 1]);
    let work: f64 = (0..areas.len()).map(work).sum();
    let ledger = &end.meta.ledger;
    assert!((ledger.outside_work / work - 1.0).abs() < 1e-9 && work > 1.0, "{} {work} J", ledger.outside_work);
    let steps = case.steps();
    let last = |name: &str| *steps[name].last().unwrap();
    let unaccounted = last("kinetic_energy") + last("rotational_energy")
        - ledger.energy_start
        - last("contact_work")
        - last("outside_work");
    assert!(unaccounted.abs() < 1e-9 * work, "{unaccounted} J of {work} J");
}

#[test]
fn a_shrinking_cylinder_pushes_a_ball_with_its_radial_speed() {
    let ball = |wall: &str| {
        let case = Case::from_scene(&format!(
            r#"(
            materials: [(name: "ROCKx", density: 2500.0)],
            laws: [(name: "smoth", kind: IQS_CLB(friction: 0.0))],
            contacts: [(between: ("GRAIN", "WALLx"), law: "smoth")],
            grains: [(material: "ROCKx", colour: "GRAIN", shape: Sphere, number: 1, sizes: Single(0.1),
                placement: List(positions: [(0.2, 0.0, 0.0)]))],
            walls: [Cylinder(material: "ROCKx", colour: "WALLx", centre: (0.0, 0.0, 0.0), half_height: 1.0, radius: 0.3,
                hollow: true, radial: Rate(-0.5), {wall})],
            compute: (dt: 1.0e-3, steps: 20, output_every: 20, tol: 1e-12),
        )"#
        ));
        case.solved(&[]).last_snapshot().bodies.body_v[0]
    };
    // The wall slows down as it shrinks: the ball leaves it with the speed of the first step's end. This step is implicit, as
    // the wall closes the gap: its contact configuration has the initial radius.
    let speed = (-0.5e-3f64).exp_m1() / 1e-3 * 0.3;
    for (wall, shift) in [
        ("", 0.0),
        ("velocity: (Constant(-1.0), Constant(0.0), Constant(0.0))", -1.0),
        ("spin: Constant(3.0)", 0.0),
        ("surface_spin: Constant(3.0)", 0.0),
        ("revolution: (axis: (0.0, 0.0, 1.0), rate: Constant(3.0))", 0.0),
    ] {
        let v = ball(wall);
        assert!((v[0] - speed - shift).abs() < 1e-9 && v[1].abs() < 1e-9, "{wall}: {v:?}, expected {speed}");
    }
}

#[test]
fn paraview_files_have_the_present_radius() {
    let case = packing("Rate(-2.0)", "steps: 100, output_every: 50").solved(&[]);
    assert_eq!(post(case.path(), &["--no-plots"]), 0);
    for step in [0, 50, 100] {
        let points = vtp(&case.path().join(format!("DISPLAY/walls-{step:06}.vtp"))).unwrap()["points"].clone();
        // The cylinder is the first wall, a prism of 64 sides with its corners on the circle.
        let corners: Vec<f64> = points.chunks(3).take(128).map(|x| x[0].hypot(x[1])).collect();
        let radius = case.snapshot(step).meta.radii[0].radius;
        assert!(corners.iter().all(|corner| (corner / radius - 1.0).abs() < 1e-6), "{radius} m: {corners:?}");
        assert!(step == 0 || radius < 0.16);
    }
}

#[test]
fn threads_resume_and_continuation_change_nothing() {
    let run = |flags: &[&[&str]]| {
        let case = packing(SERVO, "quench: 0.02, steps: 120, output_every: 60");
        flags.iter().for_each(|flags| assert_eq!(case.solve(flags), 0, "{flags:?}"));
        case
    };
    let first = run(&[&["--threads", "1"]]);
    let three = run(&[&["--threads", "3"]]);
    let resumed = run(&[&["--threads", "1", "--steps", "60"], &["--threads", "3", "--resume", "--steps", "120"]]);
    let end = |case: &Case| case.last_snapshot();
    for other in [&three, &resumed] {
        assert!(end(&first).bodies == end(other).bodies && end(&first).meta.radii == end(other).meta.radii);
    }
    assert_same_results(&first, &three);
    let half = run(&[&["--steps", "60"]]);
    let next = Case::empty();
    assert_eq!(from_outbox(half.path(), next.path(), "(keep_time: true)"), 0);
    assert_eq!(next.solve(&["--threads", "3", "--steps", "60"]), 0);
    let (expected, found) = (end(&first), end(&next));
    assert_eq!(expected.meta.radii, found.meta.radii);
    assert!(expected.bodies.body_x == found.bodies.body_x && expected.bodies.body_v == found.bodies.body_v);
    assert!(expected.bodies.body_mass[..20] == found.bodies.body_mass[..20]);
    // The continuation counts its energies from its start.
    let [before, whole, after] = [end(&half), expected, found].map(|end| end.meta.ledger);
    let sum = before.outside_work + after.outside_work;
    assert!((sum / whole.outside_work - 1.0).abs() < 1e-9, "{sum} {} J", whole.outside_work);
    let text = fs::read_to_string(next.datbox("COMPUTE.RON")).unwrap();
    assert!(text.contains("radii"), "{text}");
    // Without radii the radius stays as it is.
    let fixed = Case::empty();
    assert_eq!(from_outbox(half.path(), fixed.path(), "(compute: (dt: 1.0e-3, steps: 2))"), 0);
    assert_eq!(fixed.solve(&[]), 0);
    assert!(end(&fixed).meta.radii.is_empty());
    let bodies = Bodies::read(&fixed.datbox("BODIES.DAT")).unwrap().0;
    let ShapeRecord::Cylinder { radius, hollow: true, .. } = bodies[20].contactors[0].shape else { panic!() };
    let expected = end(&half).meta.radii[0].radius;
    assert!((radius / expected - 1.0).abs() < 1e-10, "{radius} {expected} m"); // the digits of the file
}

#[test]
fn a_run_ends_when_the_bodies_inside_have_no_space() {
    // The springs are too soft for this pressure.
    let text = packing_text("Stress(value: 1.0e9, gain: 9.0)", "", "steps: 2000, output_every: 2500");
    let case = Case::from_scene(&text);
    assert_eq!(case.solve(&[]), 0);
    let end = case.last_snapshot();
    assert!(end.meta.step < 2000, "{:?}", end.meta.radii);
    let radii = end.bodies.body_radius[..20].iter();
    let volume: f64 = radii.map(|r| 4.0 / 3.0 * PI * r.powi(3)).sum();
    // The last step has passed the least radius by at most its own travel of 0.9 %.
    let least = (volume / (PI * 0.48)).sqrt(); // in the whole height of the cylinder
    let ratio = end.meta.radii[0].radius / least;
    assert!((0.991..=1.0).contains(&ratio), "{ratio}");
}

/// The fault with which cd-pre rejects a scene.
fn rejection(scene: &str) -> String {
    let case = Case::empty();
    let file = case.path().join("scene.ron");
    fs::write(&file, scene).unwrap();
    assert_eq!(pre(&file, case.path()), 2, "{scene}");
    assert!(!case.path().join("DATBOX").exists());
    cd_pre::datbox::read_scene(Path::new("scene.ron"), scene, &[]).unwrap_err().to_string()
}

#[test]
fn cd_pre_rejects_radii_that_cannot_change() {
    let rejected = |control: &str, wall: &str, compute: &str| {
        let found = rejection(&packing_text(control, wall, compute));
        assert!(found.starts_with("scene.ron:"), "{found}");
        found
    };
    for (control, wall, compute, expected) in [
        ("Stress(value: 1.0e3, gain: -1.0)", "", "", "expected a finite gain > 0 (1/s)"),
        ("Stress(value: -1.0e3, gain: 1.0)", "", "", "expected a compressive stress > 0 Pa"),
        ("Stress(value: 1.0e3, gain: 1.0, average: -1.0)", "", "", "expected a finite time >= 0 s"),
        ("Rate(-11.0)", "", "", "expected a rate times dt of at most 0.01"),
        (
            "Rate(-1.0)",
            "ends: (material: \"ROCKx\", colour: \"ENDxx\")",
            "",
            "given with ends, whose size is constant; expected no ends: add two plates",
        ),
        ("Rate(-1.0)", "force: (None, None, Some(Constant(1.0)))", "", "given with a force or moment"),
        ("Rate(-1.0)", "moment: Some(Constant(1.0))", "", "given with a force or moment"),
        ("Rate(-1.0)", "revolution: (axis: (0, 0, 1), moment: Constant(0.0))", "", "expected"),
        ("Rate(-1.0)", "", "text: true", "given with text: true; expected text: false"),
        ("Rate(-1.0)", "", "impacts: in_order", "given with impacts: in_order; expected impacts: simultaneous"),
        ("Rate(-1.0)", "", "zperiode: 1.0", "given with a period; expected no period"),
        ("Rate(-1.0)", "", "radii: [(body: 21, control: Rate(1.0))]", "given in a scene; expected radial"),
        ("Rate(-9.0)", "", "end_time: 1.0", "shrinks the radius from 0.17 m to"),
    ] {
        let found = rejected(control, wall, compute);
        assert!(found.contains(expected), "{control} {wall} {compute}: {found}");
    }
    let text = packing_text("Rate(-1.0)", "", "steps: 100");
    let found = rejection(&text.replace("hollow: true", "hollow: false"));
    assert!(found.contains("of a solid cylinder; expected a hollow one"), "{found}");
    let found = rejection(&text.replace(r#"("GRAIN", "WALLx"), law: "smoth""#, r#"("GRAIN", "WALLx"), law: None"#));
    assert!(found.contains("without a law for grains that move"), "{found}");
}

#[test]
fn cd_solve_rejects_radii_that_cannot_change() {
    let case = packing("Rate(-1.0)", "steps: 100");
    let sound = fs::read_to_string(case.datbox("COMPUTE.RON")).unwrap();
    let row = "(body: 21, control: Rate(-1.0))";
    let replaced = |from: &str, to: &str| {
        assert!(sound.contains(from), "{sound}");
        fs::write(case.datbox("COMPUTE.RON"), sound.replace(from, to)).unwrap();
        assert_eq!(case.solve(&[]), 2, "{to}");
        assert!(!case.outbox().exists(), "{to}");
        let Err(faults) = cd_solve::read::read_case(case.path(), &ComputeFlags::default()) else { panic!("{to}") };
        faults.to_string()
    };
    for (from, to, expected) in [
        ("body: 21", "body: 0", "expected the number, from 1, of a hollow cylinder"),
        ("body: 21", "body: 1", "no hollow cylinder; expected the number of a body with one contactor DNLYC"),
        ("body: 21", "body: 22", "no hollow cylinder"),
        ("body: 21", "body: 99", "no hollow cylinder"),
        (row, "(body: 21, control: Rate(-1.0)), (body: 21, control: Rate(-2.0))", "each at most once"),
        (row, "(body: 21, control: Stress(value: 1.0, gain: -1.0))", "expected a finite gain > 0 (1/s)"),
        ("text: false", "text: true", "given with text: true; expected text: false"),
        ("xperiode: None", "xperiode: Some(9.0)", "given with a period; expected no period"),
        ("theta: 0.5", "theta: 0.5, impacts: in_order", "given with impacts: in_order"),
        ("steps: Some(100)", "steps: Some(3000)", "shrinks the radius from 0.17 m to"),
    ] {
        let found = replaced(from, to);
        assert!(found.contains(expected), "{to}: {found}");
    }
}

/// Runs the command of [`Executables::of_test`].
#[test]
fn program_process() {
    run_requested_program();
}

#[test]
fn steps_are_planned_for_the_radial_speed() {
    let plan = |control: &str| {
        let case = packing(control, "steps: 100");
        let words = ["cd-solve".as_ref(), case.path().as_os_str(), "--plan".as_ref()];
        let output = Executables::of_test().command(&words).output().unwrap();
        String::from_utf8(output.stdout).unwrap()
    };
    // Grains and plates are at rest.
    assert!(!plan("Rate(0.0)").contains("largest speed"), "{}", plan("Rate(0.0)"));
    let [rate, servo] = ["Rate(-2.0)", "Stress(value: 1.0e3, gain: 8.0)"].map(plan);
    assert!(rate.contains("largest speed 0.340 m/s"), "{rate}");
    assert!(servo.contains("largest speed 1.36 m/s"), "{servo}");
}
