//! Capsules against closed forms, and solid cylinders in hollow ones.

use std::f64::consts::PI;

use cd_formats::bodies::ShapeRecord;
use cd_formats::drv_dof::Evolution;

use crate::case::{Case, Figures, Vec3, equal, expect_same_bytes, near};

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];
pub const UPRIGHT: [[f64; 3]; 3] = [X, Y, Z];
/// Third axis along y, or along x.
pub const ALONG_Y: [[f64; 3]; 3] = [X, [0.0, 0.0, -1.0], Y];
pub const ALONG_X: [[f64; 3]; 3] = [[0.0, 0.0, -1.0], Y, X];
const G: f64 = 8.0;
const CONTACTORS: [&str; 6] = ["SPHER", "CAPSx", "POLYR", "CYLND", "PLANx", "DNLYC"];

/// In gravity, with one law for all pairs that have contacts.
pub fn scene(friction: f64) -> Case {
    let mut case = Case::new();
    for (k, one) in CONTACTORS.into_iter().enumerate() {
        for other in &CONTACTORS[k..] {
            let walls = [one, other].iter().all(|name| ["PLANx", "DNLYC"].contains(name));
            if !walls {
                case.law_between(one, other, "IQS_CLB", &[friction]);
            }
        }
    }
    case.gravity = [0.0, 0.0, -G];
    case
}

/// A free body of one contactor.
pub fn body(case: &mut Case, shape: ShapeRecord, x: [f64; 3], axes: [[f64; 3]; 3]) -> usize {
    let body = case.plate([1.0; 3], x, axes);
    case.driven.retain(|driven| driven.body != body);
    case.bodies[body].contactors[0].shape = shape;
    body
}

pub fn capsule(case: &mut Case, half_length: f64, radius: f64, x: [f64; 3], axes: [[f64; 3]; 3]) -> usize {
    body(case, ShapeRecord::Capsule { half_length, radius }, x, axes)
}

pub fn cylinder(case: &mut Case, half_height: f64, radius: f64, x: [f64; 3], axes: [[f64; 3]; 3]) -> usize {
    body(case, ShapeRecord::Cylinder { half_height, radius, hollow: false }, x, axes)
}

fn fix(case: &mut Case, body: usize) {
    case.drive(body, [0.0; 6].map(Evolution::constant));
}

/// A drum at rest with its axis along y.
fn drum(case: &mut Case, half_height: f64, radius: f64) -> usize {
    let drum = body(case, ShapeRecord::Cylinder { half_height, radius, hollow: true }, [0.0; 3], ALONG_Y);
    fix(case, drum);
    drum
}

/// Sum of the normal forces of all contacts of two bodies.
fn load(state: &cd_formats::snapshot::Snapshot, pair: [usize; 2]) -> f64 {
    let contacts = state.contacts.contact_body.iter().zip(&state.contacts.contact_force);
    contacts.filter(|(bodies, _)| bodies.map(|body| body as usize) == pair).map(|(_, force)| force[0]).sum()
}

#[test]
fn a_capsule_rolls_down_a_slope() {
    // h = r: I/m r² = (barrel/2 + 2/5 ball)/(barrel + ball) with the volumes 2 π r³ and 4/3 π r³.
    let inertia_ratio = (1.0 + 8.0 / 15.0) / (2.0 + 4.0 / 3.0);
    for on_block in [false, true] {
        let mut case = scene(0.5);
        case.gravity = [3.0, 0.0, -G];
        if on_block {
            let floor = case.block([8.0, 8.0, 0.5], [0.0, 0.0, -0.5], UPRIGHT);
            fix(&mut case, floor);
        } else {
            case.floor();
        }
        let roller = capsule(&mut case, 0.5, 0.5, [0.0, 0.0, 0.5], ALONG_Y);
        let end = case.run(500);
        let t = 500.0 * case.options.dt;
        let a = 3.0 / (1.0 + inertia_ratio);
        equal(end.mass(roller), PI * 0.125 * (2.0 + 4.0 / 3.0), 1e-14);
        // The sum of 500 solutions with a residual of 1e-12, and of rounded axes.
        near(end.v(roller), [a * t, 0.0, 0.0], 1e-8);
        near(end.w(roller), [0.0, a * t / 0.5, 0.0], 1e-8);
        near(end.x(roller), [0.5 * a * t * t, 0.0, 0.5], 1e-8);
        // It lies on the ends of a line, with half of its weight on each.
        let weight = end.mass(roller) * G;
        assert_eq!(end.contacts.contact_force.len(), 2);
        end.contacts.contact_force.iter().for_each(|force| equal(force[0] / weight, 0.5, 1e-8));
    }
}

#[test]
fn a_capsule_lies_on_two_balls() {
    let mut case = scene(0.3);
    let balls = [-0.5, 1.0].map(|x| {
        let ball = case.sphere(0.5, [x, 0.0, 0.0]);
        fix(&mut case, ball);
        ball
    });
    let top = capsule(&mut case, 2.0, 0.25, [0.0, 0.0, 0.75], ALONG_X);
    let end = case.run(100);
    near(end.x(top), [0.0, 0.0, 0.75], 1e-9);
    for (ball, share) in balls.into_iter().zip([2.0 / 3.0, 1.0 / 3.0]) {
        equal(load(&end, [ball, top]) / (end.mass(top) * G), share, 1e-8);
    }
}

#[test]
fn a_capsule_carries_what_is_on_it() {
    // A ball on its end, upright between two others that do not touch it.
    let mut case = scene(0.0);
    case.floor();
    let post = capsule(&mut case, 0.5, 0.25, [0.0, 0.0, 0.75], UPRIGHT);
    let ball = case.sphere(0.25, [0.0, 0.0, 1.75]);
    let end = case.run(20);
    let weights = [post, ball].map(|body| end.mass(body) * G);
    equal(load(&end, [ball, post]) / weights[1], 1.0, 1e-8);
    equal(load(&end, [post, 0]) / (weights[0] + weights[1]), 1.0, 1e-8);
}

#[test]
fn a_capsule_lies_on_all_its_partners() {
    // On two held bodies of each shape, whose upper sides are at z = 0.
    type Support = fn(&mut Case, f64) -> usize;
    let supports: [(&str, Support); 5] = [
        ("block", |case, x| case.block([0.25, 1.0, 0.5], [x, 0.0, -0.5], UPRIGHT)),
        ("plate", |case, x| body(case, ShapeRecord::Plane { half_lengths: [0.25, 1.0, 0.5] }, [x, 0.0, -0.5], UPRIGHT)),
        ("cylinder", |case, x| cylinder(case, 0.5, 0.25, [x, 0.0, -0.5], UPRIGHT)),
        ("lying cylinder", |case, x| cylinder(case, 1.0, 0.5, [x, 0.0, -0.5], ALONG_Y)),
        ("capsule", |case, x| capsule(case, 1.0, 0.5, [x, 0.0, -0.5], ALONG_Y)),
    ];
    for (name, support) in supports {
        let mut case = scene(0.3);
        let held = [-1.0, 1.0].map(|x| {
            let held = support(&mut case, x);
            fix(&mut case, held);
            held
        });
        let top = capsule(&mut case, 2.0, 0.25, [0.0, 0.0, 0.25], ALONG_X);
        let end = case.run(50);
        near(end.x(top), [0.0, 0.0, 0.25], 1e-9);
        // Two points on each support share the load in many ways; the sum and the moment about the middle are determined.
        let loads = held.map(|held| load(&end, [top, held]) + load(&end, [held, top]));
        equal(loads.iter().sum::<f64>() / (end.mass(top) * G), 1.0, 1e-8);
        let points = end.contacts.contact_point.iter().zip(&end.contacts.contact_force);
        let moment: f64 = points.map(|(point, force)| point[0] * force[0]).sum();
        assert!(moment.abs() < 1e-8 * end.mass(top) * G, "{name}: {moment}");
    }
}

#[test]
fn a_capsule_lies_in_the_groove_of_two() {
    let mut case = scene(0.0);
    for x in [-0.5, 0.5] {
        let held = capsule(&mut case, 2.0, 0.5, [x, 0.0, 0.0], ALONG_Y);
        fix(&mut case, held);
    }
    let top = capsule(&mut case, 1.0, 0.5, [0.0, 0.0, 0.75f64.sqrt()], ALONG_Y);
    let end = case.run(100);
    near(end.x(top), [0.0, 0.0, 0.75f64.sqrt()], 1e-9);
    for held in [0, 1] {
        // Two forces at 30° to the vertical; the positions have eight digits.
        equal((load(&end, [top, held]) + load(&end, [held, top])) / (end.mass(top) * G), 1.0 / 3f64.sqrt(), 1e-6);
    }
    assert_eq!(end.contacts.contact_force.len(), 4);
}

/// Time of the second zero of the angle about the drum's axis of a body released at a small angle, in periods of
/// √((D/g)(1 + I/m r²)) 2π with the distance D of its centre from the axis of the drum.
fn rocking_period(round: impl Fn(&mut Case, [f64; 3]) -> usize, inertia_ratio: f64) -> f64 {
    let (distance, angle) = (1.5, 0.05f64);
    let mut case = scene(0.9);
    drum(&mut case, 4.0, 2.0);
    let roller = round(&mut case, [distance * angle.sin(), 0.0, -distance * angle.cos()]);
    case.options.dt = 1.0 / 256.0;
    let period = 2.0 * PI * (distance / G * (1.0 + inertia_ratio)).sqrt();
    let steps = (1.1 * period / case.options.dt) as u64;
    let states = case.states(steps, 1);
    let x: Vec<f64> = states.iter().map(|state| state.x(roller).x).collect();
    let zeros: Vec<f64> = (1..x.len())
        .filter(|&k| x[k - 1] * x[k] < 0.0)
        .map(|k| (k as f64 - x[k] / (x[k] - x[k - 1])) * case.options.dt)
        .collect();
    (zeros[1] - zeros[0]) * 2.0 / period
}

#[test]
fn round_bodies_rock_in_a_drum() {
    // The period grows by 1 + θ²/16 = 1.00016 with the amplitude; gaps of eight digits.
    let of_cylinder = rocking_period(|case, x| cylinder(case, 1.0, 0.5, x, ALONG_Y), 0.5);
    equal(of_cylinder, 1.0, 1e-3);
    let inertia_ratio = (1.0 + 8.0 / 15.0) / (2.0 + 4.0 / 3.0);
    let of_capsule = rocking_period(|case, x| capsule(case, 0.5, 0.5, x, ALONG_Y), inertia_ratio);
    equal(of_capsule, 1.0, 1e-3);
}

#[test]
fn bodies_stand_on_the_end_of_a_drum() {
    let mut case = scene(0.3);
    let drum =
        body(&mut case, ShapeRecord::Cylinder { half_height: 2.0, radius: 2.0, hollow: true }, [0.0; 3], UPRIGHT);
    fix(&mut case, drum);
    let pillar = cylinder(&mut case, 0.5, 0.5, [-1.0, 0.0, -1.5], UPRIGHT);
    let post = capsule(&mut case, 0.5, 0.25, [1.0, 0.0, -1.25], UPRIGHT);
    let end = case.run(20);
    near(end.x(pillar), [-1.0, 0.0, -1.5], 1e-9);
    for body in [pillar, post] {
        equal(load(&end, [body, drum]) / (end.mass(body) * G), 1.0, 1e-8);
    }
}

#[test]
fn collisions_keep_momentum() {
    let mut case = scene(0.5);
    case.gravity = [0.0; 3];
    let axes = [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], Z];
    let bodies = [
        capsule(&mut case, 1.0, 0.25, [0.0; 3], axes),
        capsule(&mut case, 0.75, 0.25, [0.25, 0.0, 1.5], ALONG_Y),
        cylinder(&mut case, 0.5, 0.5, [1.75, 0.25, 0.25], axes),
        capsule(&mut case, 0.5, 0.375, [3.5, 0.5, 0.0], ALONG_X),
        case.sphere(0.5, [-2.0, 0.25, 0.0]),
        case.block([0.5; 3], [0.0, -1.75, 0.0], UPRIGHT),
    ];
    for (k, &body) in bodies.iter().enumerate().skip(1) {
        // Towards the first, with a rotation.
        let v = Vec3::from(case.bodies[body].position) * -2.0;
        case.launch(body, v.into(), [0.5, 0.25 * k as f64, -0.5]);
    }
    let states = case.states(1500, 1500);
    let (start, end) = (&states[0], states.last().unwrap());
    let scale = start.momentum_scale();
    // Rounding of 1500 steps.
    near(end.momentum(), start.momentum(), 1e-12 * scale);
    near(end.angular_momentum(), start.angular_momentum(), 1e-11 * scale);
    assert!(end.kinetic() < start.kinetic());
    assert!((end.v(bodies[0]) - start.v(bodies[0])).norm() > 0.1);
}

#[test]
fn fast_capsules_do_not_pass_a_thin_plate() {
    for axes in [UPRIGHT, ALONG_Y, [[0.6, 0.0, 0.8], Y, [-0.8, 0.0, 0.6]]] {
        let mut case = scene(0.3);
        case.plate([8.0, 8.0, 1e-2], [0.0; 3], UPRIGHT);
        let body = capsule(&mut case, 0.5, 0.25, [0.0, 0.0, 20.0], axes);
        case.launch(body, [0.0, 0.0, -1000.0], [0.0; 3]);
        case.options.dt = 1e-2;
        let end = case.run(6);
        assert!(end.x(body).z > 0.2, "{}", end.x(body));
    }
}

#[test]
fn a_resumed_run_is_the_unbroken_one() {
    let case = || {
        let mut case = scene(0.4);
        case.options.dt = 1.0 / 256.0;
        drum(&mut case, 2.0, 2.0);
        let roller = capsule(&mut case, 0.5, 0.25, [0.0, 0.0, -1.5], ALONG_Y);
        case.launch(roller, [1.0, 0.0, 0.0], [0.0; 3]);
        capsule(&mut case, 0.5, 0.25, [0.2, 0.1, -0.75], ALONG_X);
        cylinder(&mut case, 0.25, 0.25, [0.0, -0.5, 0.0], ALONG_X);
        case.block([0.25; 3], [0.0, 0.5, 0.25], UPRIGHT);
        case.sphere(0.25, [0.0, 0.0, 0.5]);
        case
    };
    expect_same_bytes(case);
}

#[test]
fn a_cylinder_in_a_drum_restarts_from_text() {
    let mut case = scene(0.3);
    drum(&mut case, 2.0, 2.0);
    let roller = cylinder(&mut case, 0.5, 0.5, [0.0, 0.0, -1.5], ALONG_Y);
    (case.options.text, case.options.output_every) = (true, 10);
    case.run(10);
    let restarted = case.run_from_text(&case.first_text_states(), 10);
    near(restarted.x(roller), [0.0, 0.0, -1.5], 1e-9);
}

#[test]
fn what_is_not_computed_is_rejected() {
    let mut case = scene(0.3);
    case.mesh(&[[0.0; 3], X, Y], &[[0, 1, 2]], [0.0; 3], UPRIGHT);
    capsule(&mut case, 0.5, 0.25, [0.0, 0.0, 2.0], UPRIGHT);
    case.options.steps = Some(1);
    case.write();
    assert_eq!(case.solve(&[]), 0);
    case.options.text = true;
    case.write();
    assert_eq!(case.solve(&["--force"]), 2);
}
