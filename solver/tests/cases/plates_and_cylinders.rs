//! Plates and solid cylinders that move freely.

use cd_formats::bodies::ShapeRecord;
use cd_formats::drv_dof::Evolution;

use crate::case::{Case, Figures, Vec3, equal, expect_same_bytes, near};

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];
const UPRIGHT: [[f64; 3]; 3] = [X, Y, Z];
/// Third axis along y, or along x.
const ALONG_Y: [[f64; 3]; 3] = [X, [0.0, 0.0, -1.0], Y];
const ALONG_X: [[f64; 3]; 3] = [[0.0, 0.0, -1.0], Y, X];
const G: f64 = 8.0;

/// In gravity, with one law for all pairs that have contacts.
fn scene(friction: f64) -> Case {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[friction]);
    case.law_between("CYLND", "CYLND", "IQS_CLB", &[friction]);
    case.law_between("CYLND", "PLANx", "IQS_CLB", &[friction]);
    case.gravity = [0.0, 0.0, -G];
    case
}

fn plate(case: &mut Case, half_lengths: [f64; 3], x: [f64; 3], axes: [[f64; 3]; 3]) -> usize {
    let plate = case.plate(half_lengths, x, axes);
    case.driven.retain(|driven| driven.body != plate);
    plate
}

fn cylinder(case: &mut Case, [half_height, radius]: [f64; 2], x: [f64; 3], axes: [[f64; 3]; 3]) -> usize {
    let body = plate(case, [1.0; 3], x, axes);
    case.bodies[body].contactors[0].shape = ShapeRecord::Cylinder { half_height, radius, hollow: false };
    body
}

fn fix(case: &mut Case, body: usize) {
    case.drive(body, [0.0; 6].map(Evolution::constant));
}

/// Sum of the normal forces of all contacts of two bodies.
fn load(state: &cd_formats::snapshot::Snapshot, pair: [usize; 2]) -> f64 {
    let contacts = state.contacts.contact_body.iter().zip(&state.contacts.contact_force);
    contacts.filter(|(bodies, _)| bodies.map(|body| body as usize) == pair).map(|(_, force)| force[0]).sum()
}

#[test]
fn a_cylinder_rolls_down_a_slope() {
    let mut case = scene(0.5);
    case.gravity = [3.0, 0.0, -G];
    case.floor();
    let roller = cylinder(&mut case, [1.0, 0.5], [0.0, 0.0, 0.5], ALONG_Y);
    let end = case.run(500);
    let t = 500.0 * case.options.dt;
    let a = 2.0 / 3.0 * 3.0;
    // The sum of 500 solutions with a residual of 1e-12, and of rounded axes.
    near(end.v(roller), [a * t, 0.0, 0.0], 1e-8);
    near(end.w(roller), [0.0, a * t / 0.5, 0.0], 1e-8);
    near(end.x(roller), [0.5 * a * t * t, 0.0, 0.5], 1e-8);
    let forces: Vec<Vec3> = end.contacts.contact_force.iter().map(|force| Vec3::from(*force)).collect();
    let weight = end.mass(roller) * G;
    // It lies on the ends of a line, with half of its weight on each.
    assert_eq!(forces.len(), 2);
    forces.iter().for_each(|force| equal(force.x / weight, 0.5, 1e-8));
    // Friction along the line may balance itself; across it is a third of the pull of 3 m/s².
    equal(forces.iter().sum::<Vec3>().yz().norm() / end.mass(roller), 1.0, 1e-8);
    equal(end.mass(roller), std::f64::consts::PI * 0.25 * 2.0, 1e-14);
}

#[test]
fn a_cylinder_slides_where_friction_is_low() {
    let mut case = scene(0.0625);
    case.gravity = [3.0, 0.0, -G];
    case.floor();
    let roller = cylinder(&mut case, [1.0, 0.5], [0.0, 0.0, 0.5], ALONG_Y);
    let end = case.run(200);
    let t = 200.0 * case.options.dt;
    near(end.v(roller), [(3.0 - 0.0625 * G) * t, 0.0, 0.0], 1e-8);
    // I = m R²/2.
    near(end.w(roller), [0.0, 2.0 * 0.0625 * G / 0.5 * t, 0.0], 1e-8);
}

#[test]
fn a_rolling_cylinder_keeps_its_speed() {
    // Friction does not act on a cylinder that rolls at ω R = v, however far it turns in a step.
    let mut case = scene(0.5);
    case.floor();
    let roller = cylinder(&mut case, [1.0, 0.5], [0.0, 0.0, 0.5], ALONG_Y);
    case.options.dt = 1.0 / 128.0;
    case.launch(roller, [8.0, 0.0, 0.0], [0.0, 0.0, 16.0]); // about its own third axis
    let end = case.run(512);
    near(end.v(roller), [8.0, 0.0, 0.0], 1e-9);
    near(end.w(roller), [0.0, 16.0, 0.0], 1e-9);
    equal(end.x(roller).x, 32.0, 1e-9);
}

#[test]
fn a_standing_cylinder_carries_what_is_on_it() {
    let mut case = scene(0.3);
    case.floor();
    let lower = cylinder(&mut case, [0.5, 0.5], [0.0, 0.0, 0.5], UPRIGHT);
    let upper = cylinder(&mut case, [0.25, 0.375], [0.0625, 0.0, 1.25], UPRIGHT);
    let block = case.block([0.25; 3], [0.0, 0.0, 1.75], UPRIGHT);
    let ball = case.sphere(0.25, [0.0, 0.0, 2.25]);
    let end = case.run(200);
    let weights = [lower, upper, block, ball].map(|body| end.mass(body) * G);
    for (body, z) in [(lower, 0.5), (upper, 1.25), (block, 1.75), (ball, 2.25)] {
        equal(end.x(body).z, z, 1e-9);
    }
    let above = |k: usize| weights[k..].iter().sum::<f64>();
    equal(load(&end, [lower, 0]) / above(0), 1.0, 1e-8);
    equal(load(&end, [lower, upper]) / above(1), 1.0, 1e-8);
    equal(load(&end, [block, upper]) / above(2), 1.0, 1e-8);
    equal(load(&end, [ball, block]) / above(3), 1.0, 1e-8);
}

#[test]
fn a_cylinder_lies_in_the_groove_of_two() {
    let mut case = scene(0.0);
    for x in [-0.5, 0.5] {
        let held = cylinder(&mut case, [2.0, 0.5], [x, 0.0, 0.0], ALONG_Y);
        fix(&mut case, held);
    }
    let top = cylinder(&mut case, [1.0, 0.5], [0.0, 0.0, 0.75f64.sqrt()], ALONG_Y);
    let end = case.run(100);
    near(end.x(top), [0.0, 0.0, 0.75f64.sqrt()], 1e-9);
    for held in [0, 1] {
        // Two forces at 30° to the vertical; the positions have eight digits.
        equal(load(&end, [top, held]) / (end.mass(top) * G), 1.0 / 3f64.sqrt(), 1e-6);
    }
    assert_eq!(end.contacts.contact_force.len(), 4);
}

#[test]
fn a_cylinder_lies_across_two() {
    let mut case = scene(0.3);
    for y in [-0.5, 1.0] {
        let held = cylinder(&mut case, [2.0, 0.25], [0.0, y, 0.0], ALONG_X);
        fix(&mut case, held);
    }
    let top = cylinder(&mut case, [2.0, 0.5], [0.0, 0.0, 0.75], ALONG_Y);
    let end = case.run(100);
    near(end.x(top), [0.0, 0.0, 0.75], 1e-9);
    for (held, share) in [(0, 2.0 / 3.0), (1, 1.0 / 3.0)] {
        equal(load(&end, [top, held]) / (end.mass(top) * G), share, 1e-8);
    }
    assert_eq!(end.contacts.contact_force.len(), 2);
}

#[test]
fn a_free_plate_rests_on_a_floor_and_carries_a_ball() {
    let mut case = scene(0.3);
    // Two plates have no contacts: the floor is a block.
    let floor = case.block([4.0, 4.0, 0.5], [0.0, 0.0, -0.5], UPRIGHT);
    fix(&mut case, floor);
    let board = plate(&mut case, [2.0, 1.0, 0.0625], [0.0, 0.0, 0.0625], UPRIGHT);
    let ball = case.sphere(0.25, [1.0, 0.5, 0.375]);
    let end = case.run(100);
    near(end.x(board), [0.0, 0.0, 0.0625], 1e-9);
    near(end.x(ball), [1.0, 0.5, 0.375], 1e-9);
    let weights = [board, ball].map(|body| end.mass(body) * G);
    equal(weights[0], 8.0 * 2.0 * 0.0625 * G, 1e-12);
    equal(load(&end, [ball, board]) / weights[1], 1.0, 1e-8);
    // The floor is the candidate: polyhedra come before plates. Its forces balance those of the two about the centre.
    let points = end.contacts.contact_body.iter().zip(&end.contacts.contact_point).zip(&end.contacts.contact_force);
    let of_floor: Vec<(Vec3, f64)> = points
        .filter(|((bodies, _), _)| bodies.map(|body| body as usize) == [floor, board])
        .map(|((_, point), force)| (Vec3::from(*point), force[0]))
        .collect();
    let total: f64 = of_floor.iter().map(|(_, force)| force).sum();
    equal(total / (weights[0] + weights[1]), 1.0, 1e-8);
    let moment: Vec3 = of_floor.iter().map(|(point, force)| point * *force).sum();
    near([moment.x, moment.y, 0.0], [weights[1], 0.5 * weights[1], 0.0], 1e-7);
}

#[test]
fn a_plate_falls_onto_a_ball_and_stays() {
    let mut case = scene(0.3);
    case.floor();
    let board = plate(&mut case, [0.5, 0.5, 0.0625], [0.0, 0.0, 1.25], UPRIGHT);
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
    let end = case.run(1000);
    near(end.x(board), [0.0, 0.0, 1.0625], 1e-9);
    equal(load(&end, [ball, board]) / (end.mass(board) * G), 1.0, 1e-8);
    equal(load(&end, [ball, 0]) / ((end.mass(board) + end.mass(ball)) * G), 1.0, 1e-8);
}

#[test]
fn collisions_keep_momentum() {
    let mut case = scene(0.5);
    case.gravity = [0.0; 3];
    let axes = [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], Z];
    let bodies = [
        plate(&mut case, [1.0, 0.75, 0.25], [0.0; 3], axes),
        cylinder(&mut case, [0.75, 0.25], [0.25, 0.0, 1.5], ALONG_Y),
        cylinder(&mut case, [0.5, 0.5], [1.75, 0.25, 0.25], axes),
        cylinder(&mut case, [0.5, 0.375], [3.0, 0.5, 0.0], ALONG_X),
        case.sphere(0.5, [-2.0, 0.25, 0.0]),
        case.block([0.5; 3], [0.0, -1.75, 0.0], UPRIGHT),
    ];
    let mass = 1.0;
    for (k, &body) in bodies.iter().enumerate().skip(1) {
        // Towards the plate, with a rotation.
        let v = Vec3::from(case.bodies[body].position) * (-2.0 * mass);
        case.launch(body, v.into(), [0.5, 0.25 * k as f64, -0.5]);
    }
    let states = case.states(1500, 1500);
    let (start, end) = (&states[0], states.last().unwrap());
    let scale = start.momentum_scale();
    // Rounding of 1500 steps.
    near(end.momentum(), start.momentum(), 1e-12 * scale);
    near(end.angular_momentum(), start.angular_momentum(), 1e-11 * scale);
    assert!(end.kinetic() < start.kinetic());
    // They have met.
    assert!((end.v(bodies[0]) - start.v(bodies[0])).norm() > 0.1);
}

#[test]
fn fast_cylinders_do_not_pass_a_thin_plate() {
    for axes in [UPRIGHT, ALONG_Y, [[0.6, 0.0, 0.8], Y, [-0.8, 0.0, 0.6]]] {
        for fixed in [true, false] {
            let mut case = scene(0.3);
            let board = plate(&mut case, [8.0, 8.0, 1e-2], [0.0; 3], UPRIGHT);
            if fixed {
                fix(&mut case, board);
            }
            let body = cylinder(&mut case, [0.5, 0.5], [0.0, 0.0, 20.0], axes);
            case.launch(body, [0.0, 0.0, -1000.0], [0.0; 3]);
            case.options.dt = 1e-2;
            let end = case.run(6);
            assert!(end.x(body).z > end.x(board).z + 0.4, "{} {}", end.x(body), end.x(board));
        }
    }
}

#[test]
fn a_resumed_run_is_the_unbroken_one() {
    let case = || {
        let mut case = scene(0.4);
        (case.options.dt, case.options.text) = (1.0 / 256.0, true);
        case.floor();
        let roller = cylinder(&mut case, [0.5, 0.5], [0.0, 0.0, 0.5], ALONG_Y);
        case.launch(roller, [1.0, 0.0, 0.0], [0.0; 3]);
        cylinder(&mut case, [0.5, 0.5], [0.2, 0.1, 1.6], ALONG_X);
        plate(&mut case, [0.5, 0.25, 0.125], [0.0, 0.0, 2.5], UPRIGHT);
        case.sphere(0.25, [0.0, 0.0, 3.0]);
        case
    };
    expect_same_bytes(case);
}

#[test]
fn pairs_without_contacts_are_rejected() {
    // Two plates, of which one moves.
    let mut case = scene(0.3);
    case.floor();
    plate(&mut case, [0.5, 0.5, 0.125], [0.0, 0.0, 0.5], UPRIGHT);
    case.options.steps = Some(1);
    case.write();
    assert_eq!(case.solve(&[]), 0);
    case.law_between("PLANx", "PLANx", "IQS_CLB", &[0.3]);
    case.write();
    assert_eq!(case.solve(&["--force"]), 2);
    // A hollow cylinder that moves.
    let mut case = scene(0.3);
    let drum = plate(&mut case, [1.0; 3], [0.0; 3], UPRIGHT);
    case.bodies[drum].contactors[0].shape = ShapeRecord::Cylinder { half_height: 1.0, radius: 1.0, hollow: true };
    case.options.steps = Some(1);
    case.write();
    assert_eq!(case.solve(&[]), 2);
}
