//! Walls that turn freely about an axis away from their centre, under their weight, moments and contacts.

use cd_formats::bodies::{Contactor, LocalFrame, ShapeRecord};
use cd_formats::drv_dof::{DrivenComponent, DrivenKind, Evolution};

use crate::case::{Case, Figures, Vec3, equal, near};

/// Distance of the centre of a flap from its hinge, m.
const ARM: f64 = 0.75;

/// Half lengths of a flap along x, y and z, m.
const HALF_LENGTHS: [f64; 3] = [0.5, 0.25, 0.125];

/// Mass of a flap, kg.
const MASS: f64 = 8.0 * HALF_LENGTHS[0] * HALF_LENGTHS[1] * HALF_LENGTHS[2];

/// Moment of inertia of a flap about its hinge, kg m².
const INERTIA: f64 = MASS * ((HALF_LENGTHS[0] * HALF_LENGTHS[0] + HALF_LENGTHS[2] * HALF_LENGTHS[2]) / 3.0 + ARM * ARM);

/// A plate about (0.75, 0, 0) that turns freely about the y-axis under a moment, N m. The axes of its body are z, x and y.
fn flap(case: &mut Case, moment: f64) -> usize {
    let flap = case.plate(HALF_LENGTHS, [0.0; 3], [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let body = &mut case.bodies[flap];
    let axes = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]];
    body.contactors[0].local_frame = Some(LocalFrame { axes, offset: [0.0, ARM, 0.0] }.into());
    let shape = ShapeRecord::Point { offset: [0.0; 3] };
    body.contactors.push(Contactor { colour: "WALLx".into(), shape, local_frame: None });
    let [a, b, c] = HALF_LENGTHS.map(|h| h * h / 3.0);
    body.inertia = Some([MASS * (a + b + ARM * ARM), MASS * (b + c), INERTIA]);
    body.equivalent_radius = (0.75 * MASS / std::f64::consts::PI).cbrt();
    case.press(flap, 5, moment);
    for component in 0..3 {
        let (kind, evolution) = (DrivenKind::Pivot, Evolution::constant(0.0));
        case.driven.push(DrivenComponent { line: 0, body: flap, component, kind, evolution });
    }
    flap
}

/// Relative error of mass and inertia in BODIES.DAT, which has eight digits.
const FILE_ROUNDING: f64 = 1e-7;

#[test]
fn a_flap_falls_as_a_compound_pendulum() {
    let g = 8.0;
    // From rest at a right angle a pendulum is at its lowest point after K(sin 45°) sqrt(I/(m g l)).
    let quarter_period = 1.854_074_677_301_372 * (INERTIA / (MASS * g * ARM)).sqrt();
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -g];
    case.options.dt = quarter_period / 1024.0;
    case.sphere(0.5, [50.0, 0.0, 50.0]);
    let flap = flap(&mut case, 0.0);
    let end = case.run(1024);
    let speed = (2.0 * MASS * g * ARM / INERTIA).sqrt();
    // The scheme has an error of the order (h ω)²/24, 4e-7, over the quarter.
    near(end.w(flap), [0.0, speed, 0.0], 1e-5);
    let [w, x, y, z] = end.bodies.body_q[flap];
    let q = nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
    near(q * Vec3::y(), [0.0, 0.0, -1.0], 1e-5);
    near(end.x(flap), [0.0; 3], 0.0);
}

#[test]
fn a_moment_turns_a_flap() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.options.dt = 1.0 / 64.0;
    case.sphere(0.5, [50.0, 0.0, 50.0]);
    let flap = flap(&mut case, 0.25);
    for state in &case.states(128, 32)[1..] {
        equal(state.w(flap).y * INERTIA, 0.25 * state.meta.time, FILE_ROUNDING);
    }
}

/// A ball that falls onto a flap one metre from its hinge: the angular momentum about the hinge is kept.
#[test]
fn a_ball_bounces_off_a_flap() {
    let (restitution, density, arm, speed) = (0.5, 2.0, 1.0, 3.0);
    let mut case = Case::new();
    case.law("RST_CLB", &[restitution, 0.0, 0.0]);
    case.options.dt = 1.0 / 1024.0;
    let ball = case.sphere_of(density, 0.25, [arm, 0.0, 0.25 + HALF_LENGTHS[2]]);
    case.launch(ball, [0.0, 0.0, -speed], [0.0; 3]);
    let flap = flap(&mut case, 0.0);
    let end = case.run(1);
    let mass = density * 4.0 / 3.0 * std::f64::consts::PI * 0.25f64.powi(3);
    let total = mass * arm * arm + INERTIA;
    equal(end.w(flap).y, (1.0 + restitution) * speed * mass * arm / total, FILE_ROUNDING);
    equal(-end.v(ball).z, speed * (mass * arm * arm - restitution * INERTIA) / total, 10.0 * FILE_ROUNDING);
}

/// Balls that rain on a flap over a floor.
fn flap_in_rain() -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.4]);
    (case.gravity, case.options.dt, case.options.tol) = ([0.0, 0.0, -8.0], 1.0 / 256.0, Some(1e-6));
    for k in 0..24u32 {
        let [i, j, l] = [k % 4, k / 4 % 2, k / 8].map(f64::from);
        case.sphere(0.125, [0.3 * i + 0.02 * l, 0.3 * j - 0.15, 0.3 * l + 0.26]);
    }
    flap(&mut case, -1.5);
    case.plate([8.0, 8.0, 0.5], [0.0, 0.0, -1.5], crate::case::AXES);
    case
}

#[test]
fn threads_and_resume_change_nothing_with_a_hinge() {
    let run = |flags: &[&[&str]]| {
        let mut case = flap_in_rain();
        (case.options.steps, case.options.output_every) = (Some(120), 60);
        case.write();
        flags.iter().for_each(|flags| assert_eq!(case.solve(flags), 0));
        case.last()
    };
    let first = run(&[&["--threads", "1"]]);
    assert!(first.contacts.contact_impulse.iter().filter(|impulse| impulse[0] > 0.0).count() > 10);
    assert!(first.w(24).y.abs() > 0.1);
    let first = first.to_bytes();
    assert!(first == run(&[&["--threads", "3"]]).to_bytes());
    assert!(first == run(&[&["--threads", "2", "--steps", "60"], &["--resume", "--steps", "120"]]).to_bytes());
}

#[test]
fn hinges_of_other_bodies_are_rejected() {
    let message = |edit: &dyn Fn(&mut Case, usize)| {
        let mut case = Case::new();
        case.law("IQS_CLB", &[0.5]);
        case.sphere(0.5, [50.0, 0.0, 0.5]);
        let flap = flap(&mut case, 0.0);
        edit(&mut case, flap);
        case.write();
        let program = env!("CARGO_BIN_EXE_cd-solve");
        let output = std::process::Command::new(program).arg(case.path()).args(["--steps", "2"]).output().unwrap();
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8(output.stderr).unwrap()
    };
    let found = message(&|case, flap| case.bodies[flap].position = [0.5, 0.0, 0.0]);
    assert!(found.contains("a pivot away from the position of a wall that turns freely"), "{found}");
    let found = message(&|case, flap| {
        let second = case.bodies[flap].contactors[0].clone();
        case.bodies[flap].contactors.push(second);
    });
    assert!(found.contains("a hinge of a body of several contactors"), "{found}");
}

#[test]
fn the_summary_names_hinges() {
    let case = flap_in_rain();
    case.write();
    let program = env!("CARGO_BIN_EXE_cd-solve");
    let output = std::process::Command::new(program).arg(case.path()).arg("--plan").output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("1 hinge; "), "{text}");
}
