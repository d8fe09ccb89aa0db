//! A sphere that rolls and slides.

use cd_formats::compute::ExternalField;
use cd_formats::drv_dof::Evolution;

use crate::case::{Case, Figures, Vec3, equal, near};

/// A sphere of radius 1/2 on a floor that slopes by a 3-4-5 triangle, tan = 3/4, under 10 m/s^2.
fn on_slope(friction: f64, theta: f64) -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[friction]);
    case.gravity = [6.0, 0.0, -8.0];
    case.options.theta = theta;
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.5]);
    case
}

#[test]
fn a_sphere_rolls_down_a_gentle_slope_at_five_sevenths() {
    // Rolling needs 2/7 of the pull, m g sin / (m g cos) <= 7/2 mu: here from mu = 3/14 = 0.21429 on.
    for (friction, theta) in [(0.2143, 0.5), (0.5, 0.5), (5.0, 0.5), (0.5, 0.75), (0.5, 1.0)] {
        let mut case = on_slope(friction, theta);
        let h = case.options.dt;
        let states = case.states(1000, 500);
        for (state, t) in states.iter().zip([0.0, 0.5, 1.0]) {
            let a = 5.0 / 7.0 * 6.0;
            // Sums of up to 1000 equal terms; the scheme's own position is h (theta - 1/2) v ahead.
            near(state.v(1), [a * t, 0.0, 0.0], 1e-12);
            near(state.w(1), [0.0, a * t / 0.5, 0.0], 1e-12);
            near(state.x(1), [0.5 * a * t * t + (theta - 0.5) * h * a * t, 0.0, 0.5], 1e-12);
        }
        equal(states[2].force(1, 0).unwrap().yz().norm(), 2.0 / 7.0 * 6.0 * states[2].mass(1), 1e-11);
    }
}

#[test]
fn a_sphere_slides_down_a_steep_slope() {
    for friction in [0.0, 0.1, 0.2142] {
        let state = on_slope(friction, 0.5).run(1000);
        // Sums of 1000 equal terms.
        near(state.v(1), [6.0 - friction * 8.0, 0.0, 0.0], 1e-12);
        near(state.w(1), [0.0, 2.5 * friction * 8.0 / 0.5, 0.0], 1e-11);
    }
}

#[test]
fn a_sphere_that_spins_as_it_rolls_keeps_its_way() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -8.0];
    case.options.dt = 0.01;
    case.floor();
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
    case.launch(ball, [1.0, 0.0, 0.0], [0.0, 2.0, 5.0]);
    let end = case.run(1000);
    // Sums of 1000 terms.
    near(end.v(ball), [1.0, 0.0, 0.0], 1e-12);
    near(end.w(ball), [0.0, 2.0, 5.0], 1e-12);
    near(end.x(ball), [10.0, 0.0, 0.5], 1e-11);
}

/// An octahedron of balls that attract each other: friction holds what turns as one body, and takes nothing from it.
#[test]
fn what_friction_holds_together_turns_for_ever() {
    let spin = Vec3::new(0.3, 0.2, 0.4);
    for friction in [0.0, 0.5] {
        let mut case = Case::new();
        case.law("IQS_CLB", &[friction]);
        case.options.self_gravity = true;
        (case.options.gravity_constant, case.options.dt) = (10.0, 0.02);
        for (axis, side) in (0..3).flat_map(|axis| [(axis, 0.5f64.sqrt()), (axis, -(0.5f64.sqrt()))]) {
            let mut x = [0.0; 3];
            x[axis] = side;
            let ball = case.sphere(0.5, x);
            case.launch(ball, spin.cross(&Vec3::from(x)).into(), spin.into());
        }
        // Ten turns. With what sticks at rest half a step before its end it would lose (h omega) (omega t), 0.6 of its energy.
        let states = case.states(5800, 5800);
        let loss = 1.0 - states[1].kinetic() / states[0].kinetic();
        // What it opens by until the contacts hold it at gaps of ½ (h omega)² of a diameter, 6e-5.
        assert!(loss.abs() < 2e-4, "{loss}");
        near(states[1].w(0) - spin, [0.0; 3], 2e-4);
    }
}

/// A sphere of radius 1/2 on a level floor, mu = 1/4, g = 8 m/s^2, 2 s in steps of 1 ms.
fn launched(v: f64, w: f64) -> Vec<cd_formats::snapshot::Snapshot> {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.25]);
    case.gravity = [0.0, 0.0, -8.0];
    case.floor();
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
    case.launch(ball, [v, 0.0, 0.0], [0.0, w, 0.0]);
    case.states(2000, 40)
}

#[test]
fn a_bowled_sphere_ends_rolling_at_five_sevenths_of_its_speed() {
    let states = launched(3.5, 0.0);
    let time = 2.0 * 3.5 / (7.0 * 0.25 * 8.0); // 1/2 s
    for state in &states {
        let t = state.meta.time;
        let v = (3.5 - 0.25 * 8.0 * t).max(2.5);
        // Sums of up to 2000 terms. Angular momentum about the line of contact is kept: 5/7 exactly.
        near(state.v(1), [v, 0.0, 0.0], 1e-12);
        let w = 2.5 * 0.25 * 8.0 / 0.5 * t.min(time);
        near(state.w(1), [0.0, w, 0.0], 1e-11);
    }
    // Slides for 2 v0 / (7 mu g), then rolls without any friction.
    let end = states.last().unwrap();
    near(end.force(1, 0).unwrap(), [8.0 * end.mass(1), 0.0, 0.0], 1e-11);
    // Braked at 2 m/s^2 for 1/2 s, then free for 3/2 s at 5/2 m/s.
    near(end.x(1), [3.5 * 0.5 - 0.25 + 2.5 * 1.5, 0.0, 0.5], 1e-11);
}

#[test]
fn a_spinning_sphere_set_down_rolls_off_at_two_sevenths_of_its_rim() {
    let end = launched(0.0, 14.0).pop().unwrap();
    near(end.v(1), [2.0 / 7.0 * 14.0 * 0.5, 0.0, 0.0], 1e-12);
    near(end.w(1), [0.0, 2.0 / 7.0 * 14.0, 0.0], 1e-12);
    // Backspin: bowled forwards at 1 m/s, it comes back.
    let end = launched(1.0, -21.0).pop().unwrap();
    near(end.v(1), [5.0 / 7.0 - 2.0 / 7.0 * 21.0 * 0.5, 0.0, 0.0], 1e-12);
}

#[test]
fn a_spin_about_the_normal_continues() {
    let mut case = on_slope(0.5, 0.5);
    case.gravity = [0.0, 0.0, -8.0];
    case.launch(1, [0.0; 3], [0.0, 0.0, 3.0]);
    // A point of contact holds no moment.
    near(case.run(100).w(1), [0.0, 0.0, 3.0], 0.0);
}

/// A sphere in a groove of two plates whose normals are (0, +-0.6, 0.8), gravity along and across.
fn in_groove(friction: f64, along: f64) -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[friction]);
    case.gravity = [along, 0.0, -8.0];
    for side in [1.0, -1.0] {
        let n = [0.0, 0.6 * side, 0.8];
        case.plate([64.0, 64.0, 0.5], n.map(|c| -c * 1.0), [[1.0, 0.0, 0.0], [0.0, 0.8, -0.6 * side], n]);
    }
    case.sphere(0.5, [0.0, 0.0, 0.0]);
    case
}

#[test]
fn a_sphere_in_a_groove_rolls_on_a_smaller_circle() {
    // It turns on a circle of 0.8 r: a = g / (1 + (2/5) / 0.64). How much the sides squeeze it is not determined.
    let mut case = in_groove(0.4, 2.0);
    let end = case.run(500);
    let a = 2.0 / (1.0 + 0.4 / 0.64);
    // The contacts are coupled: iterated to 1e-12, 500 times.
    near(end.v(2), [a * 0.5, 0.0, 0.0], 1e-10);
    near(end.w(2), [0.0, a * 0.5 / (0.8 * 0.5), 0.0], 1e-10);
    // Slides when its friction, 2 - a along the groove, is more than mu times 8 / 1.6 on each side.
    let mut case = in_groove(0.05, 2.0);
    let end = case.run(500);
    near(end.v(2), [0.5 * (2.0 - 2.0 * 0.05 * 5.0), 0.0, 0.0], 1e-10);
    for plate in [0, 1] {
        let force = end.force(2, plate).unwrap() / end.mass(2);
        equal(force.x, 5.0, 1e-9);
        equal(force.yz().norm(), 0.05 * 5.0, 1e-9);
    }
}

/// A ball of radius 1/2 on a plane, 8 m/s^2 across it and `along` along x; friction 1/2, rolling and spinning as given.
fn resisting(along: f64, rolling: f64, spinning: f64) -> Case {
    let mut case = Case::new();
    case.law("IQS_DS_ROLL_CLB", &[0.5, 0.5, rolling, spinning]);
    case.gravity = [along, 0.0, -8.0];
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.5]);
    case
}

#[test]
fn rolling_friction_stops_a_ball_at_five_sevenths_of_its_share_of_gravity() {
    // m v' = -f and I w' = f R - mu_r R m g without slipping: v' = -5/7 mu_r g.
    let mut case = resisting(0.0, 0.0625, 0.0);
    case.launch(1, [0.5, 0.0, 0.0], [0.0, 1.0, 0.0]);
    let a = 5.0 / 7.0 * 0.0625 * 8.0;
    for state in case.states(2000, 100) {
        let v = (0.5 - a * state.meta.time).max(0.0); // at rest after 1.4 s
        // Sums of 2000 terms.
        near(state.v(1), [v, 0.0, 0.0], 1e-12);
        near(state.w(1), [0.0, 2.0 * v, 0.0], 1e-12);
    }
    // What it loses is the work of the moment.
    let work = case.column("contact_work");
    let m = std::f64::consts::PI / 6.0;
    equal(*work.last().unwrap(), -0.5 * m * 0.25 * 1.4, 1e-12);
    assert!(case.column("momentum_drift").iter().all(|drift| *drift < 1e-13));
}

#[test]
fn a_ball_stays_on_a_slope_up_to_its_rolling_friction() {
    // tan of the slope against mu_r.
    let end = resisting(0.124 * 8.0, 0.125, 0.0).run(500);
    // Each step is solved to 1e-12 of the velocity that gravity gives, 8e-3 m/s.
    near(end.v(1), [0.0; 3], 8e-15);
    near(end.w(1), [0.0; 3], 2.0 * 8e-15);
    near(end.x(1), [0.0, 0.0, 0.5], 0.5 * 8e-15);
    let end = resisting(0.25 * 8.0, 0.125, 0.0).run(500);
    near(end.v(1), [5.0 / 7.0 * (0.25 - 0.125) * 8.0 * 0.5, 0.0, 0.0], 1e-12);
}

#[test]
fn a_spin_about_the_normal_decays_linearly() {
    let mut case = resisting(0.0, 0.0, 0.125);
    case.launch(1, [0.0; 3], [0.0, 0.0, 3.0]);
    let rate = 0.125 * 8.0 / (0.4 * 0.5);
    for state in case.states(1000, 100) {
        near(state.w(1), [0.0, 0.0, (3.0 - rate * state.meta.time).max(0.0)], 1e-12);
        near(state.v(1), [0.0; 3], 0.0);
    }
}

/// The tests above of balls on a plate, in a scene that a block far away makes one of polyhedra.
#[test]
fn balls_among_polyhedra_resist_as_among_balls() {
    let with_block = |along: f64, rolling: f64, spinning: f64| {
        let mut case = resisting(along, rolling, spinning);
        case.law_of_all("IQS_DS_ROLL_CLB", &[0.5, 0.5, rolling, spinning]);
        case.block([0.5; 3], [8.0, 0.0, 0.5], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        case
    };
    let mut case = with_block(0.0, 0.0625, 0.0);
    case.launch(1, [0.5, 0.0, 0.0], [0.0, 1.0, 0.0]);
    for state in case.states(2000, 500) {
        let v = (0.5 - 5.0 / 7.0 * 0.0625 * 8.0 * state.meta.time).max(0.0);
        // Sums of 2000 terms.
        near(state.v(1), [v, 0.0, 0.0], 1e-12);
        near(state.w(1), [0.0, 2.0 * v, 0.0], 1e-12);
    }
    let end = with_block(0.124 * 8.0, 0.125, 0.0).run(500);
    near(end.v(1), [0.0; 3], 8e-15);
    let mut case = with_block(0.0, 0.0, 0.125);
    case.launch(1, [0.0; 3], [0.0, 0.0, 3.0]);
    for state in case.states(1000, 250) {
        near(state.w(1), [0.0, 0.0, (3.0 - 0.125 * 8.0 / 0.2 * state.meta.time).max(0.0)], 1e-12);
    }
}

/// A slab of 2 x 3 x 1 m without sliding friction spins on its face: R is that of the sphere of 6 m³, and the weight is shared
/// by four corners.
#[test]
fn a_slab_stops_spinning_at_the_rate_of_its_corners_moments() {
    let mut case = Case::new();
    case.law_of_all("IQS_DS_ROLL_CLB", &[0.0, 0.0, 0.0, 0.125]);
    case.gravity = [0.0, 0.0, -8.0];
    case.floor();
    let slab = case.block([1.0, 1.5, 0.5], [0.0, 0.0, 0.5], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    case.launch(slab, [0.0; 3], [0.0, 0.0, 2.0]);
    let radius = (6.0 * 0.75 / std::f64::consts::PI).cbrt();
    let rate = 0.125 * radius * 8.0 / ((4.0 + 9.0) / 12.0);
    for state in case.states(2500, 500) {
        // Each step is solved to 1e-12 of its own change; sums of 2500.
        near(state.w(slab), [0.0, 0.0, (2.0 - rate * state.meta.time).max(0.0)], 1e-10);
        near(state.x(slab), [0.0, 0.0, 0.5], 1e-10);
    }
}

#[test]
fn rolling_friction_counts_the_effective_radius_and_the_cohesion() {
    // Two balls of radii 1/2 and 1/4 pressed together by 3 N; 1/R = 2 + 4. Cohesion 2 N on top in the second.
    for (law, parameters, force) in [
        ("IQS_DS_ROLL_CLB", &[0.5, 0.5, 0.25, 0.125][..], 3.0),
        ("IQS_WET_DS_ROLL_CLB", &[2.0, 0.0, 0.01, 0.5, 0.5, 0.25, 0.125], 5.0),
    ] {
        let mut case = Case::new();
        case.law(law, parameters);
        let (a, b) = (case.sphere(0.5, [0.0; 3]), case.sphere(0.25, [0.75, 0.0, 0.0]));
        case.pull(a, 0, 3.0);
        case.pull(b, 0, -3.0);
        case.launch(a, [0.0; 3], [20.0, 0.0, 0.0]);
        let states = case.states(10, 10);
        let t = 10.0 * case.options.dt;
        let moment = 0.125 / 6.0 * force;
        let inertia = |body: usize| states[0].bodies.body_inertia[body][0];
        // 8 digits of the forces in the files.
        near(states[1].w(a), [20.0 - moment / inertia(a) * t, 0.0, 0.0], 1e-7);
        near(states[1].w(b), [moment / inertia(b) * t, 0.0, 0.0], 1e-7);
        let memory = states[1].memory.as_ref().unwrap();
        near(memory.contact_moment[0].map(f64::abs), [moment * case.options.dt, 0.0, 0.0], 1e-9 * moment);
    }
}

#[test]
fn angular_momentum_is_kept_with_rolling_friction() {
    // A heap of spinning balls that attract each other; and with a block that falls on them. Sweeps stall in some steps of 300
    // between 1e-6 and 1e-5 in the heap, and at the block's edges in one of them at 1e-4.
    for (block, tol) in [(false, 1e-5), (true, 1e-4)] {
        angular_momentum_is_kept_in_a_heap(block, tol);
    }
}

fn angular_momentum_is_kept_in_a_heap(block: bool, tol: f64) {
    let mut case = Case::new();
    case.law_of_all("IQS_WET_DS_ROLL_CLB", &[0.01, 0.0, 0.01, 0.3, 0.5, 0.1, 0.05]);
    if block {
        let block = case.block([0.5; 3], [0.3, 0.2, 2.8], [[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [0.0, -0.8, 0.6]]);
        case.launch(block, [0.0, 0.0, -1.0], [0.0; 3]);
    }
    case.options.self_gravity = true;
    (case.options.gravity_constant, case.options.tol, case.options.dt) = (1.0, Some(tol), 0.01);
    for (k, (radius, x)) in crate::case::shaken_lattice(3, 7).into_iter().enumerate() {
        let body = case.sphere(radius, x);
        case.launch(body, [0.0; 3], [f64::from(k as u8 % 5), 1.0, -2.0]);
    }
    let states = case.states(300, 300);
    let scale = states[1].momentum_scale();
    near(states[1].angular_momentum(), states[0].angular_momentum(), 1e-12 * scale);
    assert!(states[1].memory.as_ref().unwrap().contact_moment.iter().flatten().any(|m| *m != 0.0));
    assert!(case.column("residual").iter().all(|e| *e <= tol), "every step converges");
}

/// Round a ball that stays another rolls without sliding, whichever of the two is numbered first: to the square of the angle of a step.
#[test]
fn which_of_two_balls_comes_first_changes_nothing() {
    let run = |fixed_first: bool| {
        let mut case = Case::new();
        case.law("IQS_CLB", &[1.0]);
        let places = if fixed_first { [0.0, 1.0] } else { [1.0, 0.0] };
        let balls = places.map(|x| case.sphere(0.5, [x, 0.0, 0.0]));
        let [fixed, free] = if fixed_first { balls } else { [balls[1], balls[0]] };
        case.drive(fixed, [0.0; 6].map(Evolution::constant));
        case.launch(free, [0.0, 8.0, 0.0], [0.0, 0.0, 16.0]);
        case.options.fields =
            vec![ExternalField::PointMass { mass: 1e14, position: Some([0.0; 3]), orbit: None, response: false }];
        (case.options.dt, case.options.tol) = (0.0078125, Some(1e-13));
        let end = case.run(50);
        (end.v(free), end.w(free), end.x(free))
    };
    let ((v, w, x), other) = (run(true), run(false));
    // Solved to 1e-13, fifty times.
    near(v, other.0, 1e-10);
    near(w, other.1, 1e-10);
    // It has gone round by 3 rad, and what touches moves by less than the square of hω = 1/8 of its speed.
    assert!((x - Vec3::x()).norm() > 0.1 && (v.norm() - 0.5 * w.norm()).abs() < 8.0 / 64.0, "{v} {w} {x}");
}

/// Held together by a liquid, without anything that presses or pulls from outside, a ball that spins takes the other along: their net
/// force is nothing, but not the work of what resists spinning.
#[test]
fn spinning_is_resisted_and_booked_where_no_net_force_is() {
    let mut case = Case::new();
    case.law("IQS_WET_DS_ROLL_CLB", &[16.0, 0.0, 0.125, 0.3, 0.3, 0.1, 0.1]);
    let spins = case.sphere(0.5, [0.0; 3]);
    case.sphere(0.5, [0.0, 0.0, 1.0]);
    case.launch(spins, [0.0; 3], [0.0, 0.0, 1.0]);
    (case.options.dt, case.options.tol) = (0.0078125, Some(1e-12));
    let states = case.states(400, 400);
    let end = &states[1];
    for body in 0..2 {
        near(end.w(body), [0.0, 0.0, 0.5], 1e-12);
    }
    // Half of it is lost to friction; roundings of 400 steps.
    let (start, ledger) = (states[0].kinetic(), &end.meta.ledger);
    equal(end.kinetic(), 0.5 * start, 1e-12 * start);
    equal(ledger.contact_work, -0.5 * start, 1e-12 * start);
    equal(ledger.friction_work, ledger.contact_work, 1e-14 * start);
}
