//! Scenes that are periodic along x, y and z.

use cd_formats::compute::{Compute, EventAction};
use cd_formats::snapshot::Snapshot;

use crate::case::{Case, Figures, Vec3, equal, near, shaken_lattice, uniform};

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];

/// A heap on the floor of a cell of 4 by 4, all of it moved by `to`: spheres, or blocks and a sphere.
fn heap(blocks: bool, to: [f64; 2]) -> Case {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -8.0];
    case.floor();
    let mut random = uniform(3);
    for k in 0..18 {
        let place = [f64::from(k % 3) - 1.0, f64::from(k / 3 % 3) - 1.0];
        let x = [1.25 * place[0] + to[0], 1.25 * place[1] + to[1], 0.625 + 1.125 * f64::from(k / 9)];
        let size = 0.375 + 0.125 * (random() * 8.0).floor() / 8.0;
        let body = if blocks && k > 0 { case.block([size, 0.375, 0.3125], x, [X, Y, Z]) } else { case.sphere(size, x) };
        case.launch(body, [8.0 * random() - 4.0, 4.0 - 8.0 * random(), 0.0], [0.0; 3]);
    }
    (case.options.dt, case.options.tol) = (0.0078125, Some(1e-11));
    (case.options.xperiode, case.options.yperiode) = (Some(4.0), Some(4.0));
    case
}

/// Positions less those of the start.
fn displacements(states: &[Snapshot]) -> Vec<Vec3> {
    let last = states.last().unwrap();
    last.free().iter().map(|&i| last.x(i) - states[0].x(i)).collect()
}

/// A contact through the border is as one within: a scene moved by half a cell has the same motion.
#[test]
fn a_contact_through_the_border_is_one_within() {
    let mut within = heap(false, [0.0; 2]);
    let expected = within.states(64, 64);
    for to in [[2.0, 0.0], [0.0, -2.0], [2.0, 2.0], [-64.0, 30.0]] {
        let found = heap(false, to).states(64, 64);
        // Digits of positions up to 64 and solutions to 1e-11, which every impact magnifies.
        for (a, b) in displacements(&found).into_iter().zip(displacements(&expected)) {
            near(a, b, 1e-6);
        }
    }
    // And there are some: without the periods displacements differ.
    (within.options.xperiode, within.options.yperiode) = (None, None);
    let open = displacements(&within.states(64, 64));
    assert!(open.iter().zip(displacements(&expected)).any(|(a, b)| (a - b).norm() > 1e-2));
}

/// A gas in a cube that is periodic along x, y and z, all of it moved by `to`.
fn gas(to: [f64; 3]) -> Case {
    let mut case = Case::new();
    case.law("RST_CLB", &[0.75, 0.0, 0.25]);
    let mut random = uniform(11);
    for (radius, x) in shaken_lattice(3, 9) {
        let (radius, x) = ((radius * 64.0).floor() / 64.0, x.map(|c| (c * 1024.0).round() / 1024.0));
        let body = case.sphere(radius, [0, 1, 2].map(|k| x[k] + to[k]));
        case.launch(body, [0; 3].map(|_| 4.0 * random() - 2.0), [0; 3].map(|_| random()));
    }
    let side = Some(3.75);
    (case.options.xperiode, case.options.yperiode, case.options.zperiode) = (side, side, side);
    (case.options.dt, case.options.tol) = (0.0078125, Some(1e-11));
    case
}

/// Along z, too: a cube is the same wherever its border is, and its momentum is kept.
#[test]
fn a_cube_is_the_same_wherever_its_border_is() {
    let expected = gas([0.0; 3]).states(64, 64);
    for to in [[0.0, 0.0, 1.875], [1.0, -1.5, 2.0], [0.0, 0.0, -30.0]] {
        let found = gas(to).states(64, 64);
        // Digits of positions up to 32 and solutions to 1e-11, which every impact magnifies.
        for (a, b) in displacements(&found).into_iter().zip(displacements(&expected)) {
            near(a, b, 1e-6);
        }
    }
    let mut open = gas([0.0; 3]);
    open.options.zperiode = None;
    let open = displacements(&open.states(64, 64));
    assert!(open.iter().zip(displacements(&expected)).any(|(a, b)| (a - b).norm() > 1e-2));
    let (start, end) = (&expected[0], &expected[1]);
    let scale = end.meta.ledger.momentum_scale;
    // Rounding of 64 steps.
    assert!((end.momentum() - start.momentum()).norm() < 1e-13 * scale);
    let angular_momentum = Vec3::from(end.meta.ledger.angular_momentum_expected);
    assert!((end.angular_momentum() - angular_momentum).norm() < 1e-11 * scale); // arms of less than 10 m
    equal(end.kinetic(), start.kinetic() + end.meta.ledger.contact_work, 1e-12 * start.kinetic());
}

/// A block that leaves through the upper border strikes the one that rests on the other side of it.
#[test]
fn blocks_meet_through_the_upper_border() {
    let run = |to: f64, period: Option<f64>| {
        let mut case = Case::new();
        case.law_of_all("RST_CLB", &[0.5, 0.0, 0.3]);
        let turned = [X, [0.0, 0.6, 0.8], [0.0, -0.8, 0.6]];
        let a = case.block([0.375, 0.25, 0.5], [0.0, 0.0, 1.25 + to], turned);
        let b = case.block([0.25, 0.375, 0.3125], [0.0625, 0.125, -1.25 + to], [X, Y, Z]);
        case.launch(a, [0.0, 0.0, 2.0], [0.5, -0.25, 1.0]);
        case.launch(b, [0.0, 0.0, -2.0], [0.0; 3]);
        (case.options.dt, case.options.zperiode) = (0.0078125, period);
        case.run(40)
    };
    let (border, within, apart) = (run(0.0, Some(4.0)), run(2.0, Some(4.0)), run(0.0, None));
    for body in 0..2 {
        // Roundings of positions up to 4.
        near(border.v(body), within.v(body), 1e-12);
        near(border.w(body), within.w(body), 1e-12);
        assert!((border.w(body) - apart.w(body)).norm() > 0.1);
    }
}

/// The same for two blocks that meet with an edge, turn and part.
#[test]
fn blocks_meet_through_the_border() {
    let run = |to: f64, period: Option<f64>| {
        let mut case = Case::new();
        case.law_of_all("RST_CLB", &[0.5, 0.0, 0.3]);
        let turned = [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], Z];
        let a = case.block([0.375, 0.25, 0.5], [1.25 + to, 0.0, 0.0], turned);
        let b = case.block([0.25, 0.375, 0.3125], [-1.25 + to, 0.125, 0.0625], [X, Y, Z]);
        case.launch(a, [2.0, 0.0, 0.0], [0.5, -0.25, 1.0]);
        case.launch(b, [-2.0, 0.0, 0.0], [0.0; 3]);
        (case.options.dt, case.options.yperiode, case.options.xperiode) = (0.0078125, None, period);
        case.run(40)
    };
    let (border, within, apart) = (run(0.0, Some(4.0)), run(2.0, Some(4.0)), run(0.0, None));
    for body in 0..2 {
        // Roundings of positions up to 4.
        near(border.v(body), within.v(body), 1e-12);
        near(border.w(body), within.w(body), 1e-12);
        near(border.x(body) + Vec3::x() * 2.0, within.x(body), 1e-12);
        assert!((border.w(body) - apart.w(body)).norm() > 0.1);
    }
    near(border.momentum(), apart.momentum(), 1e-14);
}

/// The nearest image of a pair half a cell apart changes, and with it their known separation: a ball that comes to a tilted
/// plate from the other side strikes it, in any scene.
#[test]
fn what_comes_round_from_the_other_side_is_met() {
    let run = |blocks: bool| {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.0]);
        let tilted = [[0.6, 0.0, 0.8], Y, [-0.8, 0.0, 0.6]];
        case.plate([3.0, 1.0, 0.125], [0.0; 3], tilted);
        let ball = case.sphere(0.25, [4.75, 0.0, -2.0]);
        case.launch(ball, [1.0, 0.0, 0.0], [0.0; 3]);
        if blocks {
            case.block([0.5; 3], [0.0, 0.0, 50.0], [X, Y, Z]);
        }
        (case.options.dt, case.options.xperiode) = (0.03125, Some(10.0));
        case.run(160)
    };
    let (spheres, any) = (run(false), run(true));
    assert!((spheres.v(1) - Vec3::x()).norm() > 0.5, "{}", spheres.v(1));
    near(any.v(1), spheres.v(1), 1e-12);
    near(any.x(1), spheres.x(1), 1e-12);
}

/// Without walls momentum is kept, and the ledger of angular momentum knows of what goes through the border.
#[test]
fn momentum_is_kept() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    let mut random = uniform(8);
    for (radius, x) in shaken_lattice(4, 5) {
        let body = case.sphere(radius, x);
        case.launch(body, [0; 3].map(|_| 2.0 * random() - 1.0), [0; 3].map(|_| random()));
    }
    (case.options.dt, case.options.tol) = (0.01, Some(1e-6));
    (case.options.xperiode, case.options.yperiode) = (Some(4.4), Some(4.4));
    let states = case.states(200, 200);
    let (start, end) = (&states[0], &states[1]);
    let scale = end.meta.ledger.momentum_scale;
    // Rounding of 200 steps.
    assert!((end.momentum() - start.momentum()).norm() < 1e-13 * scale);
    let expected = Vec3::from(end.meta.ledger.angular_momentum_expected);
    assert!((expected - start.angular_momentum()).norm() > 1e-3 * scale, "something went through the border");
    assert!((end.angular_momentum() - expected).norm() < 1e-11 * scale); // arms of less than 10 m
    let energy = (end.kinetic(), start.kinetic() + end.meta.ledger.contact_work);
    equal(energy.0, energy.1, 1e-12 * start.kinetic());
}

/// A sphere that slides far beyond the plate's edge is on the floor of the cell.
#[test]
fn the_floor_of_a_cell_is_endless() {
    for general in [false, true] {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.0]);
        case.gravity = [0.0, 0.0, -10.0];
        case.plate([2.0, 8.0, 0.5], [0.0, 0.0, -0.5], [X, Y, Z]);
        let sphere = case.sphere(0.5, [0.0, 0.0, 0.5]);
        if general {
            case.block([0.5; 3], [0.0, 3.0, 0.5], [X, Y, Z]);
        }
        case.launch(sphere, [8.0, 0.0, 0.0], [0.0; 3]);
        (case.options.dt, case.options.xperiode) = (0.0625, Some(4.0));
        let state = case.run(64);
        near(state.x(sphere), [32.0, 0.0, 0.5], 1e-12);
    }
}

/// The same bytes on any number of threads, and after a resume.
#[test]
fn threads_and_resume_change_nothing() {
    for (blocks, zperiode) in [(false, None), (true, None), (false, Some(4.0))] {
        let run = |flags: &[&[&str]]| {
            let mut case = if zperiode.is_some() { gas([1.0, -1.0, 1.5]) } else { heap(blocks, [2.0, 2.0]) };
            (case.options.steps, case.options.output_every) = (Some(40), 20);
            case.options.tol = zperiode.map(|_| 1e-6).or(case.options.tol);
            case.write();
            flags.iter().for_each(|flags| assert_eq!(case.solve(flags), 0));
            case.last().to_bytes()
        };
        let first = run(&[&["--threads", "1"]]);
        assert!(first == run(&[&["--threads", "3"]]));
        assert!(first == run(&[&["--threads", "2", "--steps", "20"], &["--resume", "--steps", "40"]]));
    }
}

/// Bodies that do not repeat with the period, or are too long for it, are rejected.
#[test]
fn what_cannot_repeat_is_rejected() {
    let refused = |change: &dyn Fn(&mut Compute)| {
        let mut case = heap(true, [0.0; 2]);
        change(&mut case.options);
        case.write();
        case.solve(&[])
    };
    assert_eq!(refused(&|options| options.self_gravity = true), 2);
    assert_eq!(refused(&|options| options.xperiode = Some(0.0)), 2);
    // The longest block measures 1.4 m.
    assert_eq!(refused(&|options| options.yperiode = Some(2.0)), 2);
    assert_eq!(refused(&|options| options.zperiode = Some(2.0)), 2);
    assert_eq!(refused(&|options| options.zperiode = Some(-8.0)), 2);
    assert_eq!(refused(&|options| (options.steps, options.yperiode) = (Some(1), Some(4.0))), 0);
}

#[test]
fn a_torque_turns_a_cell_about_its_period_whichever_images_its_bodies_are() {
    let turned = |image: f64| {
        let mut case = Case::new();
        case.law("IQS_CLB", &[0.25]);
        for x in [[1.5, 1.0, 0.0], [-1.5, -1.0, 0.0], [image, 0.0, 0.0]] {
            case.sphere(0.25, x);
        }
        case.options.xperiode = Some(4.0);
        case.event(0.0, EventAction::SetTorque([1.0, 0.0, 0.0]));
        (case.options.dt, case.run(1))
    };
    let (h, end) = turned(1.75);
    // I = 2 m + 3 (2/5) m/16.
    let w = h / (end.mass(0) * (2.0 + 3.0 * 0.4 / 16.0));
    for body in 0..3 {
        near(end.w(body), [w, 0.0, 0.0], 1e-14 * w);
    }
    near(end.v(0), [0.0, 0.0, w], 1e-14 * w);
    near(end.v(2), [0.0; 3], 1e-14 * w);
    let other = turned(-2.25).1;
    assert_eq!((end.bodies.body_v, end.bodies.body_w), (other.bodies.body_v, other.bodies.body_w));
}

/// A granular gas in a cube that is periodic along x, y and z cools as T(t) = T_0/(1 + t/τ)² (Haff, J. Fluid Mech. 134
/// (1983) 401), 1/τ = (1-e²) ω/6 with the collision frequency ω = 4 √π n d² g √(T_0/m) and g = (1-ν/2)/(1-ν)³ (Carnahan and
/// Starling).
#[test]
fn a_granular_gas_cools_by_haffs_law() {
    let (side, nu, e) = (6, 0.1, 0.7);
    let count = f64::from(side * side * side);
    let length = (count * std::f64::consts::PI / 6.0 / nu).cbrt();
    let mut case = Case::new();
    case.law("RST_CLB", &[e, 0.0, 0.0]);
    let mut random = uniform(5);
    for k in 0..side * side * side {
        let cell = [k % side, k / side % side, k / side / side].map(|c| f64::from(c) + 0.5);
        let body = case.sphere(0.5, cell.map(|c| length * (c / f64::from(side) - 0.5)));
        case.launch(body, [0; 3].map(|_| 2.0 * random() - 1.0), [0.0; 3]);
    }
    let period = Some(length);
    (case.options.xperiode, case.options.yperiode, case.options.zperiode) = (period, period, period);
    (case.options.dt, case.options.tol) = (0.02, Some(1e-6));
    // T/m, m²/s²
    let temperature = |state: &Snapshot| {
        let mean = state.momentum() / state.free().iter().map(|&i| state.mass(i)).sum::<f64>();
        state.free().iter().map(|&i| (state.v(i) - mean).norm_squared()).sum::<f64>() / (3.0 * count)
    };
    let states = case.states(1750, 350);
    let start = temperature(&states[0]);
    let g = (1.0 - 0.5 * nu) / (1.0 - nu).powi(3);
    let frequency = 4.0 * std::f64::consts::PI.sqrt() * count / length.powi(3) * g * start.sqrt();
    let rate = (1.0 - e * e) * frequency / 6.0;
    for state in &states[1..] {
        // 1800 collisions make 2.5 % of standard deviation, displacements of a fiftieth of d in a step 2 %.
        let found = ((start / temperature(state)).sqrt() - 1.0) / state.meta.time;
        assert!((found / rate - 1.0).abs() < 0.1, "t = {}: 1/τ {found}, not {rate}", state.meta.time);
    }
    assert!(temperature(&states[5]) < 0.1 * start);
}
