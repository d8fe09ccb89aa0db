//! Bodies whose motion is imposed in some components: they meet whatever they or the other can be moved against.

use std::f64::consts::PI;

use cd_formats::compute::{Adaptive, ContactSolver};
use cd_formats::drv_dof::{DrivenComponent, DrivenKind, Evolution};

use crate::case::{Case, Figures, equal, near};
use crate::solvers::message;

const AXES: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

const G: f64 = 8.0;

/// Imposes the velocities 0 of a body in all components but those along the `free` axes.
fn hold(case: &mut Case, body: usize, free: &[usize]) {
    for component in (0..6).filter(|component| !free.contains(component)) {
        let evolution = Evolution::constant(0.0);
        case.driven.push(DrivenComponent { line: 0, body, component, kind: DrivenKind::Velocity, evolution });
    }
}

/// Far away there is one that moves freely, as a run needs one.
fn case_of(kind: &str, parameters: &[f64]) -> Case {
    let mut case = Case::new();
    case.law_of_all(kind, parameters);
    case.sphere(0.5, [500.0, 0.0, 500.0]);
    case
}

/// On a floor whose upper face is z = 0, in gravity.
fn on_floor(kind: &str, parameters: &[f64]) -> Case {
    let mut case = case_of(kind, parameters);
    case.gravity = [0.0, 0.0, -G];
    case.floor();
    case
}

#[test]
fn what_does_not_turn_rests_on_a_floor() {
    for free in [&[0, 1, 2][..], &[2], &[1, 2]] {
        for block in [false, true] {
            let mut case = on_floor("IQS_CLB", &[0.5]);
            let body = match block {
                true => case.block([0.5; 3], [0.0, 0.0, 0.5], AXES),
                false => case.sphere(0.5, [0.0, 0.0, 0.5]),
            };
            hold(&mut case, body, free);
            let end = case.run(200);
            near(end.x(body), [0.0, 0.0, 0.5], 1e-10);
            let weight = end.mass(body) * G;
            let carried: f64 = end.contacts.contact_force.iter().map(|f| f[0]).sum();
            equal(carried / weight, 1.0, 1e-9);
            assert!(case.column("converged").iter().all(|converged| *converged == 1.0), "{free:?} {block}");
        }
    }
}

/// Falls onto the floor by steps of the lengths of a free ball, whose travel and penetration limit them.
#[test]
fn adaptive_steps_are_as_short_as_those_of_a_free_body() {
    let [free, held] = [false, true].map(|is_held| {
        let mut case = on_floor("IQS_CLB", &[0.5]);
        case.options.adaptive = Some(Adaptive { max_multiple: 64, ..Adaptive::default() });
        case.options.dt = 1.0 / 1024.0;
        let ball = case.sphere(0.5, [0.0, 0.0, 1.0]);
        case.launch(ball, [0.0, 0.0, -2.0], [0.0; 3]);
        if is_held {
            hold(&mut case, ball, &[2]);
        }
        case.run(512);
        case.column("h")
    });
    assert!(free.iter().any(|h| *h < 32.0 / 1024.0), "{free:?}");
    assert_eq!(held, free);
}

#[test]
fn two_bodies_that_are_free_along_one_axis_lie_on_each_other() {
    for block in [false, true] {
        let mut case = on_floor("IQS_CLB", &[0.0]);
        for z in [0.5, 1.5] {
            let body = match block {
                true => case.block([0.5; 3], [0.0, 0.0, z], AXES),
                false => case.sphere(0.5, [0.0, 0.0, z]),
            };
            hold(&mut case, body, &[2]);
        }
        // One that is held in all components carries a third.
        let held = case.sphere(0.5, [4.0, 0.0, 1.0]);
        case.drive(held, [0.0; 6].map(Evolution::constant));
        let above = case.sphere(0.5, [4.0, 0.0, 2.0]);
        hold(&mut case, above, &[2]);
        let end = case.run(100);
        for (body, z) in [(2, 0.5), (3, 1.5), (above, 2.0)] {
            equal(end.x(body).z, z, 1e-10);
        }
    }
}

/// A ball on a vertical rail next to the middle of another: along the normal it moves with the cosine of 60°, and stops where it is.
#[test]
fn a_rail_that_leans_on_a_ball_takes_what_its_axis_does_not() {
    let mut case = case_of("IQS_CLB", &[0.0]);
    case.gravity = [0.0, 0.0, -G];
    let held = case.sphere(0.5, [0.0; 3]);
    case.drive(held, [0.0; 6].map(Evolution::constant));
    let (sin, cos) = (0.75f64.sqrt(), 0.5);
    let ball = case.sphere(0.5, [sin, 0.0, cos]);
    hold(&mut case, ball, &[2]);
    let end = case.run(50);
    near(end.v(ball), [0.0; 3], 1e-12);
    let force = end.contacts.contact_force[0][0];
    equal(force * cos / (end.mass(ball) * G), 1.0, 1e-7); // eight digits of the position
}

#[test]
fn friction_on_a_driven_floor_slows_what_may_move_along_it() {
    // The floor moves along x at 1 m/s. What is free along x follows it, what is held along x takes the force and rests.
    for (free, follows) in [(&[0, 2][..], true), (&[2], false), (&[1, 2], false)] {
        let mut case = on_floor("IQS_CLB", &[0.25]);
        case.drive_along(1, 0, Evolution::constant(1.0));
        let body = case.sphere(0.5, [0.0, 0.0, 0.5]);
        hold(&mut case, body, free);
        let end = case.run(100);
        let weight = end.mass(body) * G;
        let [normal, t, s] = end.contacts.contact_force[0];
        equal(normal / weight, 1.0, 1e-9);
        equal(t.hypot(s) / weight, 0.25, 1e-9);
        let v = if follows { 0.25 * G * 100.0 * case.options.dt } else { 0.0 };
        near(end.v(body), [v, 0.0, 0.0], 1e-9);
    }
}

#[test]
fn restitution_throws_back_what_falls_on_a_held_ball() {
    let mut case = case_of("RST_CLB", &[0.5, 0.0, 0.0]);
    let held = case.sphere(0.5, [0.0; 3]);
    case.drive(held, [0.0; 6].map(Evolution::constant));
    let ball = case.sphere(0.5, [0.0, 0.0, 1.0 - 1e-4]);
    case.launch(ball, [0.0, 0.0, -1.0], [0.0; 3]);
    hold(&mut case, ball, &[2]);
    near(case.run(10).v(ball), [0.0, 0.0, 0.5], 1e-12);
}

/// Nothing can move along the normal: the contact is inert, and no number is lost.
#[test]
fn what_is_held_along_the_normal_does_not_push() {
    for law in ["IQS_CLB", "GAP_SGR_CLB", "IQS_DS_ROLL_CLB", "IQS_MOHR_DS_CLB"] {
        let parameters = [32.0, 16.0, 0.125, 0.25];
        let parameters = match law {
            "IQS_MOHR_DS_CLB" => &parameters[..],
            "IQS_DS_ROLL_CLB" => &[0.3, 0.3, 0.1, 0.1],
            _ => &[0.3],
        };
        let mut case = case_of(law, parameters);
        case.gravity = [0.0, 0.0, -G];
        // Next to each other along x, one of them on a rail along z, and driven into the other along x.
        let held = case.sphere(0.5, [0.0; 3]);
        case.drive(held, [0.0; 6].map(Evolution::constant));
        let ball = case.sphere(0.5, [0.99, 0.0, 0.0]);
        hold(&mut case, ball, &[2]);
        // It falls by 0.4 mm, which turns the normal by less than what counts as held.
        let end = case.run(10);
        near(end.v(ball), [0.0, 0.0, -G * 10.0 * case.options.dt], 1e-12);
        assert!(end.contacts.contact_force.iter().flatten().all(|f| *f == 0.0), "{law}");
        assert!(case.column("residual").iter().all(|residual| residual.is_finite()), "{law}");
    }
}

/// A bond between two bodies of which neither can move along the normal is reported at a touch, a law without cohesion only at
/// an overlap.
#[test]
fn a_bond_that_cannot_act_is_reported() {
    for (law, parameters, is_reported) in
        [("IQS_MOHR_DS_CLB", &[32.0, 16.0, 0.125, 0.25][..], true), ("IQS_CLB", &[0.3], false)]
    {
        let mut case = case_of(law, parameters);
        let held = case.sphere(0.5, [0.0; 3]);
        case.drive(held, [0.0; 6].map(Evolution::constant));
        let ball = case.sphere(0.5, [1.0, 0.0, 0.0]);
        hold(&mut case, ball, &[2]);
        let [summary, warnings] = message(&case);
        let touch = "bodies 2-3 touch: along the normal of their contact the motion of both is imposed";
        assert_eq!([&summary, &warnings].map(|text| text.contains(touch)), [is_reported; 2], "{law}: {warnings}");
    }
}

/// The ball below a press carries its weight and load besides its own weight.
#[test]
fn a_press_meets_held_and_guided_grains() {
    let mut case = on_floor("IQS_CLB", &[0.3]);
    let guided = case.sphere(0.5, [0.0, 0.0, 0.5]);
    hold(&mut case, guided, &[2]);
    let press = case.plate([2.0, 2.0, 0.25], [0.0, 0.0, 1.25], AXES);
    case.press(press, 2, -5.0);
    let end = case.run(100);
    near(end.x(press), [0.0, 0.0, 1.25], 1e-10);
    let [ball, plate] = [guided, press].map(|body| end.mass(body) * G);
    equal(ball, PI / 6.0 * G, 1e-9);
    let forces: Vec<f64> = end.contacts.contact_force.iter().map(|f| f[0]).collect();
    let sum: f64 = forces.iter().sum();
    // The floor carries all three, the ball the press.
    equal(sum, ball + 2.0 * (plate + 5.0), 1e-8 * sum);
}

#[test]
fn rows_between_a_press_and_other_walls_are_rejected() {
    let mut case = on_floor("IQS_CLB", &[0.3]);
    case.sphere(0.5, [0.0, 0.0, 0.5]);
    let press = case.plate([2.0, 2.0, 0.25], [0.0, 0.0, 1.25], AXES);
    case.law_between("PLANx", "PLANx", "IQS_CLB", &[0.3]);
    // Walls whose motion is all imposed do not meet whatever a row says.
    case.options.steps = Some(1);
    case.write();
    assert_eq!(case.solve(&[]), 0);
    case.press(press, 2, -5.0);
    case.write();
    assert_eq!(case.solve(&["--force"]), 2);
}

/// Steps without a solution: cubes that turn freely and whose imposed translation presses them flat into a floor, since
/// turning opens one edge and closes the other, and free cubes between walls that close.
#[test]
fn a_step_without_a_solution_names_the_imposed_motion() {
    let pressed = |case: &mut Case, z: f64| {
        let cube = case.block([0.5; 3], [0.0, 0.0, z], AXES);
        hold(case, cube, &[2, 3, 4, 5]);
        let evolution = Evolution::constant(-0.1);
        case.driven.push(DrivenComponent { line: 0, body: cube, component: 2, kind: DrivenKind::Velocity, evolution });
        cube
    };
    for (solver, free) in [ContactSolver::Auto, ContactSolver::Nlgs].into_iter().flat_map(|s| [0, 1, 2].map(|f| (s, f)))
    {
        let mut case = on_floor("IQS_CLB", &[0.3]);
        for k in 0..free {
            case.block([0.5; 3], [0.0, 0.0, 0.5 + f64::from(k)], AXES);
        }
        pressed(&mut case, 0.5 + f64::from(free));
        (case.options.solver, case.options.tol, case.options.max_sweeps) = (solver, Some(1e-6), Some(100));
        let [_, warnings] = message(&case);
        assert!(warnings.contains("imposed motion closes contacts of bodies "), "{solver} {free}: {warnings}");
    }
    // Free cubes between walls that close.
    let mut case = case_of("IQS_CLB", &[0.3]);
    for x in [-1.0, 0.0, 1.0] {
        case.block([0.5; 3], [x, 0.0, 0.0], AXES);
    }
    for side in [-1.0, 1.0] {
        let wall = case.plate([0.5, 2.0, 2.0], [2.0 * side, 0.0, 0.0], AXES);
        case.drive_along(wall, 0, Evolution::constant(-0.1 * side));
    }
    (case.options.tol, case.options.max_sweeps) = (Some(1e-6), Some(100));
    let [_, warnings] = message(&case);
    assert!(warnings.contains("imposed motion closes contacts of bodies "), "{warnings}");
    // With a corner below its centre the cube turns.
    let mut case = case_of("IQS_CLB", &[0.0]);
    case.floor();
    let [s, t] = [0.5f64.sqrt(), 1.0 / 3f64.sqrt()];
    let axes = [[s, -s, 0.0], [t * s, t * s, -2.0 * t * s], [t, t, t]];
    let cube = case.block([0.5; 3], [0.0, 0.0, 0.84], axes);
    hold(&mut case, cube, &[2, 3, 4, 5]);
    let evolution = Evolution::constant(-0.1);
    case.driven.push(DrivenComponent { line: 0, body: cube, component: 2, kind: DrivenKind::Velocity, evolution });
    let [_, warnings] = message(&case);
    assert!(!warnings.contains("continuing"), "{warnings}");
}
