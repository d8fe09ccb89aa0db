//! Clumps: bodies of balls that may overlap, with the volume and the inertia lines of their union, as cd-pre writes them.

use std::f64::consts::PI;

use cd_formats::bodies::{Contactor, ShapeRecord};
use cd_formats::snapshot::Snapshot;

use crate::case::{AXES, Case, Figures, Vec3, equal, near, uniform};
use crate::same_bits::{files, same};

/// Centre and radius of a ball, m.
pub type Ball = ([f64; 3], f64);

/// Volume and principal moments at density 1.
pub struct Solid {
    volume: f64,
    moments: [f64; 3],
}

/// Balls that do not overlap, about their common centre, in their principal axes.
fn separate_balls(balls: &[Ball]) -> Solid {
    let volume = |r: f64| 4.0 / 3.0 * PI * r.powi(3);
    let moment = |axis: usize| {
        let part = |(x, r): &Ball| {
            let square: f64 = (0..3).filter(|k| *k != axis).map(|k| x[k] * x[k]).sum();
            volume(*r) * (0.4 * r * r + square)
        };
        balls.iter().map(part).sum()
    };
    Solid { volume: balls.iter().map(|(_, r)| volume(*r)).sum(), moments: [moment(0), moment(1), moment(2)] }
}

/// Union of two balls of radius r at a distance 2 a along y: integrals of discs from the middle plane to the tip.
pub fn dumbbell(a: f64, r: f64) -> ([Ball; 2], Solid) {
    let integral = |f: &dyn Fn(f64) -> f64| 2.0 * PI * (f(r) - f(-a));
    let volume = integral(&|u| r * r * u - u.powi(3) / 3.0);
    let fourth = integral(&|u| r.powi(4) * u - 2.0 / 3.0 * r * r * u.powi(3) + u.powi(5) / 5.0);
    let second = integral(&|u| {
        let [zeroth, first] = [r * r * u - u.powi(3) / 3.0, r * r * u * u / 2.0 - u.powi(4) / 4.0];
        a * a * zeroth + 2.0 * a * first + r * r * u.powi(3) / 3.0 - u.powi(5) / 5.0
    });
    let across = 0.25 * fourth + second;
    ([([0.0, -a, 0.0], r), ([0.0, a, 0.0], r)], Solid { volume, moments: [across, 0.5 * fourth, across] })
}

/// Adds a clump at rest.
pub fn clump(case: &mut Case, balls: &[Ball], solid: &Solid, x: [f64; 3], axes: [[f64; 3]; 3]) -> usize {
    let body = case.sphere((0.75 * solid.volume / PI).cbrt(), x);
    let record = &mut case.bodies[body];
    record.equivalent_radius = (0.75 * solid.volume / PI).cbrt();
    record.inertia = Some(solid.moments);
    let contactor = |&(offset, radius): &Ball| {
        let shape = ShapeRecord::OffsetSphere { radius, offset };
        Contactor { colour: "GRAIN".into(), shape, local_frame: None }
    };
    record.contactors = balls.iter().map(contactor).collect();
    case.dof[body].axes = axes;
    body
}

/// Third axis of a body, world frame.
fn third_axis(state: &Snapshot, body: usize) -> Vec3 {
    let [w, x, y, z] = state.bodies.body_q[body];
    nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z)) * Vec3::z()
}

#[test]
fn a_dumbbell_rolls_down_a_slope() {
    let (balls, solid) = dumbbell(0.3, 0.5);
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.gravity = [2.0, 0.0, -8.0];
    case.floor();
    let body = clump(&mut case, &balls, &solid, [0.0, 0.0, 0.5], AXES);
    case.options.dt = 1.0 / 256.0;
    let state = case.run(256);
    // x'' = g_x/(1 + I/(m r²)) with the moment about the axis of the union.
    let acceleration = 2.0 / (1.0 + solid.moments[1] / (solid.volume * 0.25));
    // Seven digits of mass and inertia in the files.
    near(state.x(body), [0.5 * acceleration, 0.0, 0.5], 1e-6);
    near(state.w(body), [0.0, acceleration / 0.5, 0.0], 1e-6);
    // It rests on both balls.
    assert_eq!(state.contacts.contact_body.len(), 2);
}

/// Two balls with a third one below their axis roll to and fro like a pendulum: with the angle θ, the radius R and the
/// distance e of the centre of mass from the axis, (I + m (R² + e² - 2 R e cos θ)) θ'²/2 = m g e (cos θ - cos θ_0).
#[test]
fn a_clump_rocks_as_a_rolling_pendulum() {
    let (radius, gravity, start) = (0.5, 32.0, 0.25f64);
    // Volumes 8 : 8 : 1.
    let e = 0.2 / 17.0;
    let balls = [([0.0, -0.75, e], 0.5), ([0.0, 0.75, e], 0.5), ([0.0, 0.0, e - 0.2], 0.25)];
    let solid = separate_balls(&balls);
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.9]);
    case.gravity = [0.0, 0.0, -gravity];
    case.floor();
    let (sin, cos) = start.sin_cos();
    let axes = [[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]];
    let body = clump(&mut case, &balls, &solid, [e * sin, 0.0, radius - e * cos], axes);
    case.options.dt = 1.0 / 128.0;
    let specific = solid.moments[1] / solid.volume;
    let squared_rate = |angle: f64| {
        let lever = radius * radius + e * e - 2.0 * radius * e * angle.cos();
        2.0 * gravity * e * (angle.cos() - start.cos()) / (specific + lever)
    };
    let states = case.states(600, 8);
    let mut crossings = Vec::new();
    let mut before: Option<(f64, f64)> = None;
    for state in &states {
        let angle = (-third_axis(state, body).x).asin();
        // The step is of second order: (ω h)² = 7e-5. Contacts keep the gap that each step of rolling leaves.
        equal(state.w(body).y.powi(2), squared_rate(angle), 1e-4 * squared_rate(0.0));
        assert!((state.x(body).z - (radius - e * angle.cos())).abs() < 2e-5);
        let time = state.meta.time;
        if let Some((_, last)) = before.filter(|(_, last)| last * angle < 0.0) {
            let (earlier, _) = before.unwrap();
            crossings.push(earlier + (time - earlier) * last / (last - angle));
        }
        before = Some((time, angle));
    }
    // A quarter of the period by the midpoint rule over φ, θ = θ_0 sin φ.
    let quarter = |n: u32| {
        let step = 0.5 * PI / f64::from(n);
        let value = |k: u32| {
            let phi = step * (f64::from(k) + 0.5);
            start * phi.cos() / squared_rate(start * phi.sin()).sqrt()
        };
        step * (0..n).map(value).sum::<f64>()
    };
    assert!(crossings.len() >= 2, "{crossings:?}");
    equal(crossings[0], quarter(4000), 1e-3 * quarter(4000));
    equal(crossings[1] - crossings[0], 2.0 * quarter(4000), 1e-3 * quarter(4000));
}

/// A dumbbell that hits the floor with one ball: P = m v/(1 + m d²/I), with the horizontal distance d of that ball from the
/// centre of mass and the inertia line of the file.
#[test]
fn a_falling_dumbbell_turns_by_its_inertia_lines() {
    let (balls, solid) = dumbbell(0.3, 0.5);
    let c = 0.5f64.sqrt();
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.0]);
    case.floor();
    // The second axis, along the dumbbell, rises at 45° along y.
    let body =
        clump(&mut case, &balls, &solid, [0.0, 0.0, 0.5 + 0.3 * c], [[1.0, 0.0, 0.0], [0.0, c, c], [0.0, -c, c]]);
    case.launch(body, [0.0, 0.0, -1.0], [0.0; 3]);
    case.options.dt = 1.0 / 65536.0;
    let state = case.run(1);
    let (mass, inertia, distance) = (solid.volume, solid.moments[0], 0.3 * c);
    let impulse = mass / (1.0 + mass * distance * distance / inertia);
    // Seven digits of mass and inertia in the files, and the turn within the step.
    near(state.v(body), [0.0, 0.0, impulse / mass - 1.0], 1e-5);
    near(state.w(body), [-distance * impulse / inertia, 0.0, 0.0], 1e-5);
    equal(state.mass(body), solid.volume, 1e-6);
    assert_eq!(state.contacts.contact_body.len(), 1);
}

/// Law in which two bodies attract each other with c π R², c = 100 Pa, up to a gap of 1/64 m.
const COHESION: (&str, &[f64]) = ("IQS_COH_DS_CLB", &[100.0, 0.015625, 0.0625, 0.3, 0.4]);

/// Two clumps one on top of the other, pulled apart by `pull` (N), after some steps, and at the start.
fn pulled_clumps(balls: &[Ball], height: f64, pull: f64, steps: u64) -> [Snapshot; 2] {
    let solid = separate_balls(balls);
    let mut case = Case::new();
    case.law(COHESION.0, COHESION.1);
    let lower = clump(&mut case, balls, &solid, [0.0; 3], AXES);
    let upper = clump(&mut case, balls, &solid, [0.0, 0.0, height], AXES);
    case.pull(lower, 2, -pull);
    case.pull(upper, 2, pull);
    case.options.dt = 1.0 / 1024.0;
    case.options.tol = Some(1e-10);
    let states = case.states(steps, steps - 1);
    [states[0].clone(), states.last().unwrap().clone()]
}

/// Two clumps have the cohesion of one pair, however many of their balls touch: here five.
#[test]
fn clumps_have_the_cohesion_of_one_pair() {
    let square = |x: f64, y: f64| ([x, y, 0.0], 0.25);
    let balls = [square(0.5, 0.5), square(0.5, -0.5), square(-0.5, 0.5), square(-0.5, -0.5), square(0.0, 0.0)];
    // 1/R = 1/r + 1/r.
    let force = 100.0 * PI * 0.125f64.powi(2);
    for (share, holds) in [(0.999, true), (1.001, false)] {
        let [_, end] = pulled_clumps(&balls, 0.5, share * force, 50);
        assert_eq!(end.contacts.contact_body.len(), 5);
        let attractions = end.attractions.as_ref().unwrap();
        equal(attractions.contact_attraction.iter().sum(), force, 1e-6 * force);
        let stretch = end.x(1).z - end.x(0).z - 0.5;
        // Beyond the force they part by some 1e-3 F/m (50/1024 s)² = 1e-5 m.
        assert_eq!(stretch < 1e-7, holds, "{share}: {stretch}");
    }
}

/// Balls of different radii that touch: each contact has its share of the force of its own balls.
#[test]
fn contacts_of_unequal_balls_share_the_cohesion() {
    let balls = [([0.0, 0.0, 0.0], 0.5), ([0.0, 1.0, 0.0], 0.25), ([0.0, -1.0, 0.0], 0.25)];
    let [_, end] = pulled_clumps(&balls, 1.0, 1.0, 2);
    let force = |r: f64| 100.0 * PI * (0.5 * r).powi(2);
    // One on top of the other, the large balls touch. The small ones are 1/2 m apart, beyond the range.
    let attractions = end.attractions.unwrap();
    equal(attractions.contact_attraction.iter().sum(), force(0.5), 1e-6 * force(0.5));
    // On a floor all three touch: the centres of the small balls are 1/4 lower. Volumes 8 : 1 : 1.
    let balls = [([0.0, 0.0, 0.05], 0.5), ([0.0, 1.0, -0.2], 0.25), ([0.0, -1.0, -0.2], 0.25)];
    let solid = separate_balls(&balls);
    let mut case = Case::new();
    case.law(COHESION.0, COHESION.1);
    case.floor();
    let body = clump(&mut case, &balls, &solid, [0.0, 0.0, 0.45], AXES);
    case.options.dt = 1.0 / 1024.0;
    let state = case.run(2);
    // Next to a plate R is the radius of the ball; three contacts, each with a third of its own force.
    let force = |r: f64| 100.0 * PI * r * r;
    let attractions = state.attractions.as_ref().unwrap();
    equal(attractions.contact_attraction.iter().sum(), (force(0.5) + 2.0 * force(0.25)) / 3.0, 1e-6 * force(0.5));
    near(state.x(body), [0.0, 0.0, 0.45], 1e-12);
}

/// A tripod of three balls rests on plates, triangles, polyhedra and spheres with its weight, on each foot a third.
#[test]
fn a_tripod_rests_on_every_kind_of_body() {
    let s = 0.75f64.sqrt();
    let balls = [([1.0, 0.0, 0.0], 0.5), ([-0.5, s, 0.0], 0.5), ([-0.5, -s, 0.0], 0.5)];
    let solid = separate_balls(&balls);
    for kind in ["PLANx", "MESHx", "POLYR", "SPHER"] {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        case.law_with("MESHx", "IQS_CLB", &[0.5]);
        case.gravity = [0.0, 0.0, -8.0];
        let body = clump(&mut case, &balls, &solid, [0.0, 0.0, 0.5], AXES);
        let square = [[-4.0, -4.0, 0.0], [4.0, -4.0, 0.0], [4.0, 4.0, 0.0], [-4.0, 4.0, 0.0]];
        let mut supports = Vec::new();
        match kind {
            "PLANx" => drop(case.floor()),
            "MESHx" => drop(case.mesh(&square, &[[0, 1, 2], [0, 2, 3]], [0.0; 3], AXES)),
            "POLYR" => supports.push(case.block([4.0, 4.0, 0.5], [0.0, 0.0, -0.5], AXES)),
            _ => supports.extend(balls.map(|([x, y, _], _)| case.sphere(0.25, [x, y, -0.25]))),
        }
        for support in supports {
            case.drive(support, [0.0; 6].map(cd_formats::drv_dof::Evolution::constant));
        }
        case.options.dt = 0.01;
        let state = case.run(50);
        near(state.x(body), [0.0, 0.0, 0.5], 1e-9);
        let weight = 8.0 * state.mass(body);
        let forces: Vec<f64> = state.contacts.contact_force.iter().map(|force| force[0]).collect();
        assert_eq!(forces.len(), 3, "{kind}");
        assert!(forces.iter().all(|force| (force - weight / 3.0).abs() < 1e-6 * weight), "{kind}: {forces:?}");
    }
}

/// Clumps that fall in a tub, with rolling friction.
fn falling_clumps() -> Case {
    let mut case = Case::new();
    case.law_with("SPHER", "IQS_DS_ROLL_CLB", &[0.3, 0.4, 0.1, 0.1]);
    case.law_with("PLANx", "RST_DS_CLB", &[0.4, 0.2, 0.3, 0.4]);
    case.gravity = [0.1, 0.0, -4.0];
    let (balls, solid) = dumbbell(0.3, 0.5);
    let mut random = uniform(7);
    for k in 0..18 {
        let [x, y, z] = [k % 3, k / 3 % 3, k / 9].map(|n| 1.7 * f64::from(n));
        let turn = nalgebra::Rotation3::from_scaled_axis(Vec3::from_fn(|_, _| 3.0 * random()));
        let axes = [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| (turn * axis).into());
        let body = clump(&mut case, &balls, &solid, [x - 1.7, y - 1.7, z + 1.0], axes);
        case.launch(body, [0; 3].map(|_| random() - 0.5), [0; 3].map(|_| 3.0 * random()));
    }
    case.tub(2.6);
    let options = &mut case.options;
    (options.dt, options.tol, options.max_sweeps) = (0.01, Some(1e-5), Some(500));
    (options.steps, options.output_every) = (Some(80), 20);
    case
}

#[test]
fn threads_and_resume_change_nothing_among_clumps() {
    let one = files(&falling_clumps(), &[&["--threads", "1"]]);
    same(&one, &files(&falling_clumps(), &[&["--threads", "4"]]));
    same(&one, &files(&falling_clumps(), &[&["--steps", "40"], &["--resume", "--steps", "80"]]));
}
