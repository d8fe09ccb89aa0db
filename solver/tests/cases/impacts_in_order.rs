//! Impacts of touching balls one after the other, against closed forms.

use cd_formats::compute::ImpactOrder;

use crate::case::{Case, Figures, Vec3, equal, expect_same_bytes, near};

/// Touching balls of radius 1/2 along x with these velocities, and one law for all pairs.
fn chain(e: f64, velocities: &[f64]) -> Case {
    let mut case = Case::new();
    case.law_of_all("RST_CLB", &[e, 0.0, 0.0]);
    (case.options.dt, case.options.impacts) = (1.0 / 1024.0, ImpactOrder::InOrder);
    for (k, v) in velocities.iter().enumerate() {
        let ball = case.sphere(0.5, [k as f64, 0.0, 0.0]);
        case.launch(ball, [*v, 0.0, 0.0], [0.0; 3]);
    }
    case
}

/// Velocities along x after 64 steps.
fn outcome(case: &mut Case, balls: usize) -> Vec<f64> {
    let end = case.run(64);
    (0..balls).map(|ball| end.v(ball).x).collect()
}

/// Tolerance of the contact problem of a chain at 1 m/s.
const TOLERANCE: f64 = 1e-9;

#[test]
fn the_last_ball_of_a_cradle_leaves() {
    for (before, after) in [
        (vec![1.0, 0.0, 0.0, 0.0, 0.0], vec![0.0, 0.0, 0.0, 0.0, 1.0]),
        (vec![1.0, 1.0, 0.0, 0.0, 0.0], vec![0.0, 0.0, 0.0, 1.0, 1.0]),
        // From both ends.
        (vec![1.0, 0.0, 0.0, -0.5], vec![-0.5, 0.0, 0.0, 1.0]),
        (vec![1.0, 0.0, 0.0, -1.0], vec![-1.0, 0.0, 0.0, 1.0]),
    ] {
        let mut case = chain(1.0, &before);
        let found = outcome(&mut case, before.len());
        found.iter().zip(&after).for_each(|(found, expected)| equal(*found, *expected, TOLERANCE));
        // Without the option all balls part at one instant.
        case.options.impacts = ImpactOrder::Simultaneous;
        let together = outcome(&mut case, before.len());
        equal(together.iter().sum(), after.iter().sum(), TOLERANCE);
    }
    let mut case = chain(1.0, &[1.0, 0.0, 0.0, 0.0, 0.0]);
    case.options.impacts = ImpactOrder::Simultaneous;
    let together = outcome(&mut case, 5);
    together.iter().zip([-0.6, 0.4, 0.4, 0.4, 0.4]).for_each(|(found, expected)| equal(*found, expected, TOLERANCE));
}

#[test]
fn restitution_falls_with_each_ball() {
    for (e, balls) in [(0.9, 5), (0.5, 4), (0.8, 2)] {
        let mut velocities = vec![0.0; balls];
        velocities[0] = 1.0;
        let found = outcome(&mut chain(e, &velocities), balls);
        // The last ball is struck once, at the speed that binary impacts pass on.
        equal(found[balls - 1], ((1.0 + e) / 2.0).powi(balls as i32 - 1), TOLERANCE);
        equal(found.iter().sum(), 1.0, TOLERANCE);
        // They have come apart in order.
        assert!(found.windows(2).all(|pair| pair[0] <= pair[1] + TOLERANCE), "{found:?}");
    }
}

#[test]
fn unequal_balls_keep_momentum_and_energy() {
    let mut case = chain(1.0, &[]);
    let radii = [0.5, 0.25, 0.75, 0.5, 0.375];
    let mut x = 0.0;
    for (k, radius) in radii.into_iter().enumerate() {
        x += radius;
        let ball = case.sphere(radius, [x, 0.0, 0.0]);
        x += radius;
        case.launch(ball, [if k == 0 { 1.0 } else { 0.0 }, 0.0, 0.0], [0.0; 3]);
    }
    let states = case.states(64, 64);
    near(states[1].momentum(), states[0].momentum(), TOLERANCE * states[0].momentum_scale());
    equal(states[1].kinetic() / states[0].kinetic(), 1.0, TOLERANCE);
    // They have come apart in order.
    assert!((1..radii.len()).all(|ball| states[1].v(ball - 1).x < states[1].v(ball).x + TOLERANCE));
}

#[test]
fn a_ball_that_strikes_two_is_symmetric() {
    // Its impact with both is one: sin 30° of each, as in a break of billiards.
    let mut case = chain(1.0, &[]);
    let striker = case.sphere(0.5, [0.0; 3]);
    case.launch(striker, [1.0, 0.0, 0.0], [0.0; 3]);
    let pair = [0.5, -0.5].map(|y| case.sphere(0.5, [0.75f64.sqrt(), y, 0.0]));
    let end = case.run(64);
    let [above, below] = pair.map(|ball| end.v(ball));
    // Impulse P along each normal: the striker's 1 - 2 P cos 30° and the others' P, with the energy kept: P = 2√3/5. The
    // positions have eight digits.
    equal(end.v(striker).x, -0.2, 1e-6);
    near(above, Vec3::new(0.6, 0.2 * 3f64.sqrt(), 0.0), 1e-6);
    near(below, Vec3::new(0.6, -0.2 * 3f64.sqrt(), 0.0), 1e-6);
}

#[test]
fn a_chain_against_a_wall_comes_back() {
    let mut case = chain(1.0, &[1.0, 0.0, 0.0]);
    case.plate([0.5; 3], [3.0, 0.0, 0.0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let found = outcome(&mut case, 3);
    // The approach that a cluster at a wall may keep, 3e-8 of the speed.
    found.iter().zip([-1.0, 0.0, 0.0]).for_each(|(found, expected)| equal(*found, expected, 1e-7));
    // A ball between two walls that it touches never stops: Newton's law applies.
    let mut case = chain(1.0, &[1.0]);
    for x in [-1.0, 1.0] {
        case.plate([0.5; 3], [x, 0.0, 0.0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    }
    let end = case.run(8);
    assert!(end.x(0).x.abs() < 0.01 && (end.v(0).x.abs() - 1.0).abs() < TOLERANCE, "{} {}", end.x(0), end.v(0));
}

#[test]
fn threads_and_resumed_runs_give_the_same_bytes() {
    let case = || {
        let mut case = chain(0.75, &[1.0, 0.0, 0.0, -0.25, 0.0, 0.0]);
        case.gravity = [0.0, 0.0, -8.0];
        case.plate([8.0, 8.0, 0.5], [0.0, 0.0, -1.0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        case
    };
    expect_same_bytes(case);
}

#[test]
fn other_bodies_are_rejected() {
    let mut case = chain(1.0, &[1.0, 0.0]);
    case.block([0.5; 3], [4.0, 0.0, 0.0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    case.options.steps = Some(1);
    case.write();
    assert_eq!(case.solve(&[]), 2);
    case.options.impacts = ImpactOrder::Simultaneous;
    case.write();
    assert_eq!(case.solve(&["--force"]), 0);
}
