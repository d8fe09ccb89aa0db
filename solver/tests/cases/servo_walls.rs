//! Walls with servos: pressure on the current area, strain rate, rotation about a point, moving surfaces.

use std::f64::consts::PI;

use cd_formats::bodies::{Contactor, ShapeRecord};
use cd_formats::compute::EventAction;
use cd_formats::drv_dof::{DrivenComponent, DrivenKind, Evolution};
use cd_formats::probe::{BodySelection, Probe, ProbeQuantity};
use cd_formats::snapshot::Snapshot;

use crate::case::{AXES, Case, Figures, Vec3, equal, near};

/// Adds a row to DRV_DOF.DAT; a pressure or strain rate replaces the velocity along its axis.
fn add_servo(case: &mut Case, body: usize, component: usize, kind: DrivenKind, value: f64) {
    if matches!(kind, DrivenKind::Pressure | DrivenKind::StrainRate) {
        let is_replaced = |row: &DrivenComponent| row.kind == DrivenKind::Velocity && row.component == component;
        case.driven.retain(|row| row.body != body || !is_replaced(row));
    }
    let evolution = Evolution::constant(value);
    case.driven.push(DrivenComponent { line: 0, body, component, kind, evolution });
}

/// Turns a wall about the point, with these angular velocities about its own axes, rad/s.
fn add_pivot(case: &mut Case, wall: usize, point: [f64; 3], spin: [f64; 3]) {
    let [a, b, c] = spin;
    case.drive(wall, [0.0, 0.0, 0.0, a, b, c].map(Evolution::constant));
    (0..3).for_each(|k| add_servo(case, wall, k, DrivenKind::Pivot, point[k]));
}

/// A drum about z, at rest.
fn drum(case: &mut Case, radius: f64, half_height: f64) -> usize {
    let wall = case.plate([1.0; 3], [0.0; 3], AXES);
    let shape = ShapeRecord::Cylinder { half_height, radius, hollow: true };
    case.bodies[wall].contactors = vec![Contactor { colour: "WALLx".into(), shape, local_frame: None }];
    wall
}

/// Time from the contact configuration to the end of a step, s.
fn time_after(case: &Case) -> f64 {
    case.options.theta * case.options.dt
}

/// The force of the last step on the only sphere from a lid that is pressed with 10 Pa onto it.
fn lid_force(case: &mut Case, half_lengths: [f64; 3], steps: u64) -> (Snapshot, f64) {
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
    let lid = case.plate(half_lengths, [0.0, 0.0, 1.0 + half_lengths[2]], AXES);
    add_servo(case, lid, 2, DrivenKind::Pressure, -10.0);
    let end = case.run(steps);
    let force = end.force(ball, lid).unwrap()[0];
    (end, force)
}

#[test]
fn a_pressure_acts_on_the_area_between_the_neighbours() {
    // Own edges along y, then the neighbours of a tub of 2 m along both axes.
    for (half_width, area) in [(0.5, 2.0), (3.0, 4.0)] {
        let mut case = Case::new();
        case.law("IQS_CLB", &[0.5]);
        case.tub(1.0);
        let (_, force) = lid_force(&mut case, [3.0, half_width, 0.25], 4);
        equal(force, 10.0 * area, 1e-9); // the tolerance of the solution
    }
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.floor();
    let (_, force) = lid_force(&mut case, [3.0, 0.5, 0.25], 4);
    equal(force, 60.0, 1e-9);
}

#[test]
fn the_area_follows_the_neighbours() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.options.dt = 1.0 / 64.0;
    case.tub(1.0);
    case.drive_along(2, 0, Evolution::constant(0.5)); // the side at x = 1
    let (end, force) = lid_force(&mut case, [2.5, 3.0, 0.25], 96);
    let side = end.x(2).x - 0.5 - 0.5 * time_after(&case);
    equal(side, 1.0 + 0.5 * (1.5 - time_after(&case)), 1e-12);
    equal(force, 10.0 * 2.0 * (1.0 + side), 1e-8);
}

#[test]
fn a_pressure_in_a_drum_acts_on_its_circle() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    case.floor();
    drum(&mut case, 2.0, 4.0);
    let (_, force) = lid_force(&mut case, [2.0, 2.0, 0.25], 4);
    equal(force, 10.0 * 4.0 * PI, 1e-8);
}

#[test]
fn a_pressure_on_a_piston_acts_on_its_end() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    case.floor();
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
    let piston = case.plate([1.0; 3], [0.0, 0.0, 1.25], AXES);
    let shape = ShapeRecord::Cylinder { half_height: 0.25, radius: 0.75, hollow: false };
    case.bodies[piston].contactors = vec![Contactor { colour: "WALLx".into(), shape, local_frame: None }];
    add_servo(&mut case, piston, 2, DrivenKind::Pressure, -10.0);
    let end = case.run(4);
    equal(end.force(ball, piston).unwrap()[0], 10.0 * PI * 0.75 * 0.75, 1e-9);
}

#[test]
fn a_strain_rate_moves_a_wall_exponentially() {
    for (opposite_speed, theta, is_piston) in
        [(0.0, 0.5, false), (0.25, 0.5, false), (0.0, 1.0, false), (0.25, 0.5, true)]
    {
        let mut case = Case::new();
        case.law("IQS_CLB", &[0.5]);
        (case.options.dt, case.options.theta) = (1.0 / 64.0, theta);
        case.sphere(0.25, [100.0, 0.0, 50.0]);
        let floor = case.floor();
        case.drive_along(floor, 2, Evolution::constant(opposite_speed));
        let lid = case.plate([1.0, 1.0, 0.25], [0.0, 0.0, 2.25], AXES);
        if is_piston {
            let shape = ShapeRecord::Cylinder { half_height: 0.25, radius: 0.75, hollow: false };
            case.bodies[lid].contactors = vec![Contactor { colour: "WALLx".into(), shape, local_frame: None }];
        }
        add_servo(&mut case, lid, 2, DrivenKind::StrainRate, -0.5);
        for state in &case.states(128, 16)[1..] {
            let (t, distance) = (state.meta.time, state.x(lid).z - 0.25 - (state.x(floor).z + 0.5));
            // Ends of steps are on the chord between two contact configurations, 2 (h rate)²/8 from the curve at most.
            equal(distance, 2.0 * libm::exp(-0.5 * t), if theta == 1.0 { 1e-12 } else { 1.6e-5 });
            let speed = state.v(lid).z - opposite_speed;
            // The velocity is that of the middle of a step.
            equal(speed / (-0.5 * distance), 1.0, 0.51 * 0.5 / 64.0);
        }
    }
}

#[test]
fn a_wall_turns_about_a_point_on_an_exact_circle() {
    for (theta, has_events) in [(0.5, false), (0.5, true), (1.0, false)] {
        let mut case = Case::new();
        case.law("IQS_CLB", &[0.5]);
        (case.options.dt, case.options.theta) = (1.0 / 64.0, theta);
        let balls = [0.0, 1.5].map(|z| case.sphere(0.5, [50.0, 0.0, z]));
        let paddle = case.plate([0.5, 0.5, 0.125], [3.0, 0.0, 1.0], AXES);
        // About the axis (0, 0.6, 0.8) through the point.
        let (point, axis) = ([1.0, 0.0, 0.0], Vec3::new(0.0, 0.6, 0.8));
        add_pivot(&mut case, paddle, point, [0.0, 1.2, 1.6]);
        if has_events {
            // Velocities that change are followed by a step with θ = 1.
            case.launch(balls[1], [0.0, 0.0, -1.0], [0.0; 3]);
            (1..8).for_each(|k| case.event(f64::from(k), EventAction::AddVelocity([0.0, 0.0, 0.25])));
        }
        for state in &case.states(4096, 512)[1..] {
            let turn =
                nalgebra::Rotation3::from_axis_angle(&nalgebra::Unit::new_normalize(axis), 2.0 * state.meta.time);
            let start = Vec3::new(2.0, 0.0, 1.0);
            // Chords are r (h ω)²/8 from the arc at most, a step with θ = 1 between others 4 times as far.
            let bound = if theta == 1.0 { 1e-11 } else { 4.0 * 2.3 * (2.0f64 / 64.0).powi(2) / 8.0 };
            near(state.x(paddle), Vec3::from(point) + turn * start, bound);
            near(state.w(paddle), axis * 2.0, 1e-12);
            let [w, x, y, z] = state.bodies.body_q[paddle];
            let q = nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
            near(q * Vec3::x(), turn * Vec3::x(), 1e-11);
        }
    }
}

/// A wheel of four blades that turns about its axis moves a ball as one plate that turns about its own centre does.
#[test]
fn a_blade_about_a_point_pushes_as_a_long_blade_about_its_centre() {
    let path = |half_length: f64, centre: f64| {
        let mut case = Case::new();
        case.law("IQS_CLB", &[0.0]);
        case.options.dt = 1.0 / 256.0;
        let ball = case.sphere(0.25, [2.0, 0.5, 0.0]);
        let axes = [AXES[2], AXES[0], AXES[1]];
        let blade = case.plate([1.0, half_length, 0.125], [centre, 0.0, 0.0], axes);
        add_pivot(&mut case, blade, [0.0; 3], [1.0, 0.0, 0.0]);
        let end = case.run(256);
        (end.x(ball), end.v(ball))
    };
    let (one, other) = (path(1.0, 3.0), path(4.0, 0.0));
    near(one.0, other.0, 2e-5); // the mean velocity of a chord differs by 3 m/s (h ω)²/6, 7.6e-6 m/s, over a second
    assert!(one.1.norm() > 1.0 && (one.1 - other.1).norm() < 1e-2 * one.1.norm(), "{one:?} {other:?}");
}

#[test]
fn a_belt_takes_a_block_and_a_ball_along() {
    let (g, friction, speed) = (8.0, 0.5, 2.0);
    for is_ball in [false, true] {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[friction]);
        case.gravity = [0.0, 0.0, -g];
        case.options.dt = 1.0 / 1024.0;
        let belt = case.floor();
        add_servo(&mut case, belt, 0, DrivenKind::SurfaceVelocity, speed);
        // The part across the surface has no effect.
        add_servo(&mut case, belt, 2, DrivenKind::SurfaceVelocity, 7.0);
        let body = match is_ball {
            true => case.sphere(0.5, [0.0, 0.0, 0.5]),
            false => case.block([0.5, 0.5, 0.25], [0.0, 0.0, 0.25], AXES),
        };
        let states = case.states(1024, 128);
        let start = &states[0];
        for state in &states[1..] {
            let t = state.meta.time;
            // A ball rolls at 2/7 of the speed of the belt, with the rest from its spin.
            let last_speed = if is_ball { 2.0 / 7.0 * speed } else { speed };
            equal(state.v(body).x, (friction * g * t).min(last_speed), 1e-8);
            near(state.x(belt), [0.0, 0.0, -0.5], 0.0);
            near(state.v(belt), [0.0; 3], 0.0);
            if is_ball {
                let slip = state.v(body).x - state.w(body).y * 0.5 - speed;
                equal(slip, -speed + 3.5 * state.v(body).x, 1e-8);
            }
            // The belt works.
            let ledger = &state.meta.ledger;
            let energy = |state: &Snapshot| state.kinetic() + state.potential();
            equal(energy(state), energy(start) + ledger.contact_work + ledger.outside_work, 1e-9 * energy(state));
            assert!(ledger.outside_work > 0.9 * state.kinetic());
        }
    }
}

/// A ball in a drum that turns, and in one of which only the surface turns.
#[test]
fn a_surface_that_turns_moves_bodies_as_a_drum_that_turns() {
    let [turning, surface] = [DrivenKind::Velocity, DrivenKind::SurfaceVelocity].map(|kind| {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        case.gravity = [8.0, 0.0, 0.0];
        case.options.dt = 1.0 / 256.0;
        let wall = drum(&mut case, 2.0, 1.0);
        if kind == DrivenKind::Velocity {
            case.drive_along(wall, 5, Evolution::constant(1.0));
        } else {
            add_servo(&mut case, wall, 5, kind, 1.0);
        }
        let ball = case.sphere(0.5, [1.5, 0.0, 0.0]);
        let end = case.run(256);
        (end.x(ball), end.v(ball), end.w(ball))
    });
    // Terms of the order h² = 1.5e-5 for the curvature of the path depend on the rotation of a wall.
    near(turning.0, surface.0, 1.5e-5);
    near(turning.1, surface.1, 1e-4);
    near(turning.2, surface.2, 1e-4);
    assert!(turning.1.norm() > 0.1, "{turning:?}");
}

/// Balls in a tub whose floor is a belt, pressed by a lid, strained along x, and stirred by a blade about a point.
fn tub_with_servos() -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.4]);
    (case.gravity, case.options.dt, case.options.tol) = ([0.0, 0.0, -8.0], 1.0 / 256.0, Some(1e-6));
    case.tub(2.0);
    add_servo(&mut case, 0, 1, DrivenKind::SurfaceVelocity, 1.0);
    add_servo(&mut case, 2, 0, DrivenKind::StrainRate, -0.125);
    for k in 0..48u32 {
        let [i, j, l] = [k % 4, k / 4 % 4, k / 16].map(f64::from);
        case.sphere(0.375, [i - 1.5 + 0.05 * j, j - 1.5 - 0.05 * l, l + 0.5]);
    }
    let lid = case.plate([3.0, 3.0, 0.25], [0.0, 0.0, 4.25], AXES);
    add_servo(&mut case, lid, 2, DrivenKind::Pressure, -20.0);
    let blade = case.plate([0.25, 0.25, 0.0625], [1.0, 0.0, 3.6], AXES);
    add_pivot(&mut case, blade, [0.0, 0.0, 3.6], [0.0, 0.0, 1.0]);
    case
}

#[test]
fn threads_and_resume_change_nothing_with_servos() {
    let run = |flags: &[&[&str]]| {
        let mut case = tub_with_servos();
        (case.options.steps, case.options.output_every) = (Some(120), 60);
        case.write();
        flags.iter().for_each(|flags| assert_eq!(case.solve(flags), 0));
        case.last()
    };
    let first = run(&[&["--threads", "1"]]);
    assert!(first.contacts.contact_impulse.iter().filter(|impulse| impulse[0] > 0.0).count() > 30);
    let first = first.to_bytes();
    assert!(first == run(&[&["--threads", "3"]]).to_bytes());
    assert!(first == run(&[&["--threads", "2", "--steps", "60"], &["--resume", "--steps", "120"]]).to_bytes());
}

#[test]
fn the_summary_names_servos() {
    let case = tub_with_servos();
    case.write();
    let program = env!("CARGO_BIN_EXE_cd-solve");
    let output = std::process::Command::new(program).arg(case.path()).arg("--plan").output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("; 1 pressure; 1 strain rate; 1 revolution; 1 moving surface; "), "{text}");
}

/// Standard error of a run that is rejected.
fn refusal(case: &Case) -> String {
    case.write();
    let program = env!("CARGO_BIN_EXE_cd-solve");
    let output = std::process::Command::new(program).arg(case.path()).args(["--steps", "2"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn servos_that_a_wall_cannot_have_are_rejected() {
    use DrivenKind::{Pivot, Pressure, StrainRate, SurfaceVelocity};
    let slope = [[1.0, 0.0, 0.0], [0.0, 0.8, 0.6], [0.0, -0.6, 0.8]];
    // Body 1 is a ball, 2 a plate high above a floor, or a ball whose rotation alone is imposed.
    let message = |axes: [[f64; 3]; 3], is_plate: bool, rows: &[(usize, DrivenKind, f64)]| {
        let mut case = Case::new();
        case.law("IQS_CLB", &[0.5]);
        case.sphere(0.5, [0.0, 0.0, 0.5]);
        let wall = match is_plate {
            true => case.plate([1.0; 3], [0.0, 0.0, 5.0], axes),
            false => case.sphere(0.5, [0.0, 0.0, 5.0]),
        };
        if !is_plate {
            let evolution = Evolution::constant(0.0);
            case.driven.push(DrivenComponent {
                line: 0,
                body: wall,
                component: 3,
                kind: DrivenKind::Velocity,
                evolution,
            });
        }
        rows.iter().for_each(|(component, kind, value)| add_servo(&mut case, wall, *component, *kind, *value));
        refusal(&case)
    };
    for (axes, is_plate, rows, expected) in [
        (slope, true, &[(2, Pressure, 1.0)][..], "a servo along an axis that is not that of the wall"),
        (AXES, false, &[(2, Pressure, 1.0)], "a pressure on a body other than a plate or a solid cylinder"),
        (AXES, false, &[(2, SurfaceVelocity, 1.0)], "a surface velocity of a grain"),
        (AXES, true, &[(2, StrainRate, 1.0)], "a strain rate without a plate opposite to the wall"),
        (AXES, true, &[(0, Pivot, 1.0), (2, Pivot, 1.0)], "a pivot without all coordinates"),
        (
            AXES,
            true,
            &[(0, Pivot, 1.0), (1, Pivot, 0.0), (2, Pivot, 1.0), (2, Pressure, 1.0)],
            "a pivot of a wall that also moves along an axis",
        ),
    ] {
        let found = message(axes, is_plate, rows);
        assert!(found.contains(expected) && found.contains("DRV_DOF.DAT:"), "{found}");
    }
}

#[test]
fn a_probe_has_area_and_pressure() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.options.dt = 1.0 / 64.0;
    case.tub(1.0);
    case.drive_along(2, 0, Evolution::constant(-0.25));
    let quantity = ProbeQuantity::Pressure { on: BodySelection::Body(7) };
    case.options.probes = vec![Probe { name: "lid".into(), every: 4, quantity }];
    lid_force(&mut case, [3.0, 3.0, 0.25], 64);
    let text = std::fs::read_to_string(case.path().join("POSTPRO/probe-lid.csv")).unwrap();
    assert!(text.starts_with("step,time,h,area,wall_pressure\n"), "{text}");
    let rows: Vec<Vec<f64>> =
        text.lines().skip(1).map(|row| row.split(',').map(|x| x.parse().unwrap()).collect()).collect();
    for row in &rows[1..] {
        // Mean over four steps, in the contact configurations half a step before their ends.
        let mean_time = row[1] - 2.0 * case.options.dt;
        equal(row[3], 2.0 * (2.0 - 0.25 * mean_time), 1e-12);
        equal(row[4], 10.0, 1e-9);
    }
    assert_eq!(rows.len(), 16);
}
