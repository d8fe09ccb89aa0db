//! Bodies whose rotation is imposed in some components, or whose translation is imposed and whose rotation is free.

use std::collections::BTreeMap;

use cd_formats::drv_dof::{DrivenComponent, DrivenKind, Evolution};
use cd_formats::snapshot::Snapshot;

use crate::case::{AXES, Case, Figures, Vec3, equal, near};

/// Velocity along y, rotation about x and z: the others are those of a plane problem.
pub const OUT_OF_PLANE: [usize; 3] = [1, 3, 5];
const TRANSLATION: [usize; 3] = [0, 1, 2];
const G: f64 = 8.0;

/// Imposes one component of a body.
pub fn impose(case: &mut Case, body: usize, component: usize, evolution: Evolution) {
    case.dof[body].velocity[component] = evolution.value_at(0.0);
    case.driven.push(DrivenComponent { line: 0, body, component, kind: DrivenKind::Velocity, evolution });
}

/// Holds a body in these components.
pub fn hold(case: &mut Case, body: usize, components: &[usize]) {
    components.iter().for_each(|&component| impose(case, body, component, Evolution::constant(0.0)));
}

/// A plate with its axes along the fixed ones, held in these components.
fn plate(case: &mut Case, half_lengths: [f64; 3], x: [f64; 3], held: &[usize]) -> usize {
    let plate = case.plate(half_lengths, x, AXES);
    case.driven.retain(|driven| driven.body != plate);
    hold(case, plate, held);
    plate
}

fn scene(kind: &str, parameters: &[f64]) -> Case {
    let mut case = Case::new();
    case.law_of_all(kind, parameters);
    case.gravity = [0.0, 0.0, -G];
    case
}

/// Angular velocity along the body's own axes.
fn own_rates(state: &Snapshot, body: usize) -> Vec3 {
    state.bodies.body_w[body].into()
}

fn steps_are_numbers(case: &Case) {
    let text = std::fs::read_to_string(case.path().join("OUTBOX/steps.csv")).unwrap();
    assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
}

#[test]
fn a_sphere_in_a_plane_rolls_down_a_slope() {
    // There is no other body that moves.
    let mut case = scene("IQS_CLB", &[0.5]);
    case.gravity = [3.0, 0.0, -G];
    case.floor();
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
    hold(&mut case, ball, &OUT_OF_PLANE);
    let end = case.run(200);
    let t = 200.0 * case.options.dt;
    let a = 5.0 / 7.0 * 3.0;
    // The sum of 200 solutions with a residual of 1e-12.
    near(end.v(ball), [a * t, 0.0, 0.0], 1e-9);
    near(end.w(ball), [0.0, a * t / 0.5, 0.0], 1e-9);
    near(end.x(ball), [0.5 * a * t * t, 0.0, 0.5], 1e-9);
    let weight = end.mass(ball) * G;
    equal(end.contacts.contact_force[0][0] / weight, 1.0, 1e-9);
    steps_are_numbers(&case);
}

#[test]
fn bodies_in_a_plane_do_not_leave_it() {
    // A heap of blocks and balls whose centres are not in one plane.
    let mut case = scene("IQS_CLB", &[0.3]);
    case.options.dt = 1.0 / 256.0;
    case.floor();
    for k in 0..8 {
        let (x, y, z) = (0.4 * f64::from(k % 3), 0.25 * f64::from(k % 2), 0.75 + 1.1 * f64::from(k));
        let body = match k % 2 {
            0 => case.sphere(0.5, [x, y, z]),
            _ => case.block([0.5, 0.25, 0.375], [x, y, z], AXES),
        };
        hold(&mut case, body, &OUT_OF_PLANE);
    }
    let end = case.run(400);
    for body in 1..9 {
        assert_eq!(end.v(body).y, 0.0);
        equal(end.x(body).y, case.bodies[body].position[1], 0.0);
        let own = own_rates(&end, body);
        // Rates in the body's frame are rounded when turned to the world and back.
        equal(own.x.abs().max(own.z.abs()), 0.0, 1e-14);
        assert!(end.x(body).z > 0.2, "body {body} rests on the floor or on others");
    }
}

#[test]
fn moments_turn_a_body_about_its_free_axes_alone() {
    for held in [vec![3], vec![4], vec![5], vec![3, 4], vec![4, 5], vec![3, 5], vec![0, 1, 2]] {
        let mut case = scene("IQS_CLB", &[0.0]);
        case.gravity = [0.0; 3];
        let body = case.block([0.5, 0.25, 0.375], [0.0; 3], AXES);
        hold(&mut case, body, &held);
        let free = (3..6).find(|component| !held.contains(component)).unwrap();
        case.pull(body, free, 0.125);
        let end = case.run(100);
        let moment = end.bodies.body_inertia[body][free - 3];
        let mut expected = [0.0; 3];
        expected[free - 3] = 0.125 / moment * 100.0 * case.options.dt;
        near(own_rates(&end, body), expected, 1e-12);
    }
}

/// Euler's equations with the rate c about the axis of the smallest moment imposed are those of an oscillator.
#[test]
fn a_guided_gyroscope_swings() {
    let error = |dt: f64| {
        let mut case = scene("IQS_CLB", &[0.0]);
        case.gravity = [0.0; 3];
        case.options.dt = dt;
        let body = case.block([0.5, 0.25, 0.375], [0.0; 3], AXES);
        case.launch(body, [0.0; 3], [0.0, 0.25, 0.0]);
        impose(&mut case, body, 3, Evolution::constant(2.0));
        let end = case.run((4.0 / dt) as u64);
        let [a, b, c] = end.bodies.body_inertia[body];
        let (p, s) = ((c - a) / b, (a - b) / c);
        let angle = 2.0 * (-p * s).sqrt() * 4.0;
        let expected = [2.0, 0.25 * angle.cos(), -0.25 * (-s / p).sqrt() * angle.sin()];
        equal(own_rates(&end, body).x, 2.0, 1e-14);
        (own_rates(&end, body) - Vec3::from(expected)).norm()
    };
    let (long, short) = (error(1.0 / 128.0), error(1.0 / 256.0));
    // The error of the time step is of second order.
    assert!(long < 1e-4 && short < 0.3 * long, "{long} {short}");
}

#[test]
fn imposed_rates_follow_their_functions() {
    let mut case = scene("IQS_CLB", &[0.5]);
    case.options.dt = 1.0 / 256.0;
    case.floor();
    let harmonic =
        Evolution::Harmonic { constant: 0.5, amplitude: 1.0, omega: 5.0, phase: 0.0, ramp_start: 1.0, ramp_rate: 0.0 };
    let points = vec![[0.0, 0.0], [0.5, 1.0], [1.0, -1.0]];
    let table = Evolution::Table { name: "w.dat".into(), points };
    // Driven about one axis and along another, both with contacts.
    let bodies = [case.sphere(0.5, [0.0, 0.0, 0.5]), case.block([0.5, 0.25, 0.375], [5.0, 0.0, 0.4], AXES)];
    for body in bodies {
        impose(&mut case, body, 5, harmonic.clone());
        impose(&mut case, body, 0, table.clone());
    }
    for state in case.states(128, 16).iter().skip(1) {
        for body in bodies {
            equal(state.v(body).x, table.value_at(state.meta.time), 0.0);
            equal(own_rates(state, body).z, harmonic.value_at(state.meta.time), 1e-14);
        }
    }
}

/// A seesaw of moment of inertia J that carries a ball of mass m at d, and one on the other side or none.
#[test]
fn a_plate_that_turns_about_its_centre_gives_way_to_its_load() {
    for balanced in [false, true] {
        let mut case = scene("IQS_CLB", &[0.5]);
        case.options.dt = 1e-4;
        let held = [0, 1, 2, 3, 5];
        let board = plate(&mut case, [2.0, 1.0, 0.0625], [0.0; 3], &held);
        let ball = case.sphere(0.25, [1.0, 0.0, 0.3125]);
        if balanced {
            case.sphere(0.25, [-1.0, 0.0, 0.3125]);
        }
        let steps = 200;
        let end = case.run(steps);
        let (m, j) = (end.mass(ball), end.bodies.body_inertia[board][1]);
        let rate = if balanced { 0.0 } else { m * G / (j + m) };
        let t = steps as f64 * case.options.dt;
        // The angle of 1e-3 rad and friction half a thickness above the axis change the moment by as much.
        near(end.w(board), [0.0, rate * t, 0.0], 2e-3 * rate * t + 1e-9);
        let force = end.force(ball, board).unwrap().x;
        equal(force / (m * G * if balanced { 1.0 } else { j / (j + m) }), 1.0, 2e-3);
        near(end.x(board), [0.0; 3], 0.0);
    }
}

/// Balls that are held and turn freely take up a sliding board until it does not slide any more.
#[test]
fn rollers_are_turned_by_what_slides_over_them() {
    for block in [false, true] {
        let mut case = scene("IQS_CLB", &[0.25]);
        case.options.dt = 1e-3;
        let mut rollers = Vec::new();
        for (x, y) in [(-1.0, -0.5), (-1.0, 0.5), (1.0, 0.0)] {
            let roller = case.sphere(0.5, [x, y, 0.0]);
            hold(&mut case, roller, &TRANSLATION);
            rollers.push(roller);
        }
        let board = match block {
            true => case.block([2.0, 1.0, 0.125], [0.0, 0.0, 0.625], AXES),
            false => plate(&mut case, [2.0, 1.0, 0.125], [0.0, 0.0, 0.625], &[]),
        };
        case.launch(board, [1.0, 0.0, 0.0], [0.0; 3]);
        let end = case.run(300);
        let (mass, moment) = (end.mass(board), end.bodies.body_inertia[rollers[0]][0]);
        let v = mass / (mass + 3.0 * moment / 0.25);
        // Residuals of 300 steps.
        near(end.v(board), [v, 0.0, 0.0], 1e-6);
        for roller in rollers {
            near(end.w(roller), [0.0, v / 0.5, 0.0], 1e-6);
            near(end.x(roller), case.bodies[roller].position, 0.0);
        }
    }
}

#[test]
fn fast_guided_bodies_do_not_pass_a_thin_floor() {
    for held in [&OUT_OF_PLANE[..], &[3, 4, 5], &[0, 1, 4]] {
        for block in [false, true] {
            let mut case = scene("IQS_CLB", &[0.3]);
            plate(&mut case, [64.0, 64.0, 1e-3], [0.0, 0.0, -1e-3], &[0, 1, 2, 3, 4, 5]);
            let body = match block {
                true => case.block([0.5; 3], [0.0, 0.0, 20.0], AXES),
                false => case.sphere(0.5, [0.0, 0.0, 20.0]),
            };
            case.launch(body, [0.0, 0.0, -1000.0], [0.0; 3]);
            hold(&mut case, body, held);
            case.options.dt = 1e-2;
            let end = case.run(10);
            // It stops at the floor, up to one step of free fall.
            equal(end.x(body).z, 0.5, 1e-2);
        }
    }
}

/// Nothing moves along the normal, whatever turns.
#[test]
fn balls_that_are_held_and_turn_do_not_push_each_other() {
    let mut case = scene("IQS_CLB", &[0.3]);
    let balls = [case.sphere(0.5, [0.0; 3]), case.sphere(0.5, [0.99, 0.0, 0.0])];
    balls.into_iter().for_each(|ball| hold(&mut case, ball, &TRANSLATION));
    case.pull(balls[0], 5, 0.125);
    let end = case.run(20);
    assert!(end.contacts.contact_force.iter().flatten().all(|force| *force == 0.0));
    let expected = 0.125 / end.bodies.body_inertia[balls[0]][2] * 20.0 * case.options.dt;
    near(end.w(balls[0]), [0.0, 0.0, expected], 1e-12);
    near(end.w(balls[1]), [0.0; 3], 0.0);
    steps_are_numbers(&case);
}

/// Guided bodies of all kinds that touch each other.
fn machine() -> Case {
    let mut case = scene("IQS_CLB", &[0.4]);
    (case.options.dt, case.options.output_every, case.options.text) = (1.0 / 256.0, 20, true);
    case.floor();
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
    hold(&mut case, ball, &OUT_OF_PLANE);
    let block = case.block([0.5, 0.25, 0.375], [0.25, 0.0, 1.4], AXES);
    hold(&mut case, block, &[4]);
    let spun = case.block([0.5, 0.25, 0.375], [3.0, 0.0, 0.4], AXES);
    impose(&mut case, spun, 5, Evolution::constant(3.0));
    let wheel = case.block([0.5, 0.25, 0.375], [3.0, 0.0, 1.3], AXES);
    case.launch(wheel, [0.0; 3], [1.0, 2.0, 3.0]);
    hold(&mut case, wheel, &TRANSLATION);
    let free = case.sphere(0.25, [0.25, 0.0, 2.25]);
    case.launch(free, [0.5, 0.25, -1.0], [0.0; 3]);
    case
}

fn outbox(case: &Case, runs: &[&[&str]]) -> BTreeMap<String, Vec<u8>> {
    case.write();
    runs.iter().for_each(|flags| assert_eq!(case.solve(flags), 0, "{flags:?}"));
    let files = std::fs::read_dir(case.path().join("OUTBOX")).unwrap().map(|entry| entry.unwrap().path());
    files.map(|path| (path.file_name().unwrap().to_string_lossy().into(), std::fs::read(path).unwrap())).collect()
}

#[test]
fn a_resumed_run_of_guided_bodies_is_the_unbroken_one() {
    let unbroken = outbox(&machine(), &[&["--steps", "60"]]);
    assert!(unbroken.len() > 6);
    let resumed = outbox(&machine(), &[&["--steps", "20"], &["--resume", "--steps", "60"]]);
    assert!(unbroken == resumed);
    let threads = outbox(&machine(), &[&["--steps", "60", "--threads", "3"]]);
    assert!(unbroken == threads);
}
