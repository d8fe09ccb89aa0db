//! Input at the edge of what makes sense: every answer is finite or an error.

use cd_formats::snapshot::Snapshot;
use cd_solve::limits;
use proptest::prelude::*;

use crate::case::{Case, Envelope, Figures, SearchEffort, Vec3, equal, near, shown};

fn is_finite(state: &Snapshot) -> bool {
    let bodies = &state.bodies;
    let vectors = [&bodies.body_x, &bodies.body_v, &bodies.body_w_world, &bodies.body_w];
    let contacts = &state.contacts;
    vectors.into_iter().flatten().flatten().all(|x| x.is_finite())
        && bodies.body_q.iter().flatten().all(|x| x.is_finite())
        && [&contacts.contact_force, &contacts.contact_impulse, &contacts.contact_velocity, &contacts.contact_point]
            .into_iter()
            .flatten()
            .flatten()
            .all(|x| x.is_finite())
        && contacts.contact_gap.iter().all(|x| x.is_finite())
}

#[test]
fn nothing_moves_where_nothing_pulls() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.floor();
    for k in 0..5 {
        case.sphere(0.5, [0.9 * f64::from(k), 0.1, 0.5]); // overlapping, too
    }
    let states = case.states(100, 100);
    assert_eq!(states[0].bodies, states[1].bodies);
    assert_eq!(states[1].meta.ledger.momentum_scale, 0.0);
}

/// A body at rest from the start has no momentum; its drift is the rounding of its weight.
#[test]
fn what_rests_has_a_scale_of_momentum() {
    let mut case = Case::new();
    case.gravity = [0.0, 0.0, -8.0];
    case.law("IQS_CLB", &[0.5]);
    case.floor();
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
    let states = case.states(100, 100);
    let weight = states[1].mass(ball) * 8.0;
    equal(states[1].meta.ledger.momentum_scale, weight * case.options.dt, 1e-12);
    assert!(case.column("momentum_drift").iter().all(|drift| *drift < 1e-12));
}

#[test]
fn one_sphere_alone() {
    let mut case = Case::new();
    case.options.self_gravity = true;
    case.sphere(0.5, [1.0, 2.0, 3.0]);
    let states = case.states(10, 10);
    assert_eq!(states[0].bodies, states[1].bodies);
}

#[test]
fn coincident_spheres_part_or_stay_but_are_sound() {
    let mut farthest = 0f64;
    for (law, parts) in [("IQS_CLB", false), ("GAP_SGR_CLB", true)] {
        for (gravity, h) in [(false, 1e-3), (true, 1e-3), (true, 1e-2), (true, 1e-4)] {
            let mut case = Case::new();
            case.law(law, &[0.5]);
            (case.options.self_gravity, case.options.dt) = (gravity, h);
            case.options.gravity_constant = 1.0;
            for _ in 0..2 {
                case.sphere(0.5, [1.0, 1.0, 1.0]);
            }
            let states = case.states(10, 1);
            assert!(states.iter().all(is_finite));
            let apart = (states[10].x(0) - states[10].x(1)).norm();
            assert_eq!(apart > 0.5, parts, "{apart}");
            farthest = farthest.max(apart / 0.5);
        }
    }
    shown(
        "distance of two centres over the radius, at the start",
        "0",
        "they part or stay by their law; distance in ten steps",
        farthest,
    );
}

#[test]
fn overlaps_do_not_explode() {
    // A dozen spheres in the place of one: the law keeps overlaps, and gravity pulls them no deeper.
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.options.self_gravity = true;
    case.options.gravity_constant = 1.0;
    case.options.tol = Some(1e-8);
    for k in 0..12 {
        let angle = f64::from(k);
        case.sphere(0.5, [0.2 * angle.cos(), 0.2 * angle.sin(), 0.02 * angle]);
    }
    let states = case.states(200, 50);
    // Softly bound: sqrt(G M / r) is about 3 m/s, never reached from rest in a jam.
    assert!(states.iter().all(|state| is_finite(state) && state.free().iter().all(|&i| state.v(i).norm() < 1.0)));
}

#[test]
fn far_out_only_the_digits_suffer() {
    // A coordinate of 1e9 is rounded to 6e-8 in each of 1024 steps, always to the same side: the blow is aside by as much.
    let found = Envelope::search(SearchEffort::SMALL, &limits::ORIGIN_DISTANCE, &[1e3], 1e-4, |distance| {
        let out = 0.5 * distance;
        let away = |steps: u32| {
            let mut case = Case::new();
            case.law("RST_CLB", &[1.0, 0.0, 0.0]);
            case.options.dt = 2.0 / f64::from(steps);
            let (place, along) = (Vec3::new(out, -out, out), Vec3::new(1.0, 2.0, 2.0) / 3.0);
            case.sphere(0.5, place.into());
            let ball = case.sphere(0.5, (place + 2.0 * along).into());
            case.launch(ball, (-along).into(), [0.0; 3]);
            case.sphere(0.5, [-out, -out, out]);
            let Some(end) = case.attempt(steps.into()) else { return f64::INFINITY };
            end.v(1).norm().max((end.v(0) + along).norm())
        };
        [16, 128, 1024].map(away).into_iter().fold(0.0, f64::max)
    });
    found.print();
}

#[test]
fn sizes_may_differ_ten_thousandfold() {
    // A pebble of 1e-4 on a ball of 1, under its attraction: it stays, carried by its weight.
    let found = Envelope::search(SearchEffort::SMALL, &limits::ATTRACTING_SIZES, &[], 1e-9, |ratio| {
        let away = |h: f64| {
            let mut case = Case::new();
            case.law("IQS_CLB", &[0.5]);
            case.options.self_gravity = true;
            case.options.gravity_constant = 1.0;
            case.options.dt = h;
            case.sphere(1.0, [0.0; 3]);
            let apart = 1.0 + 1.0 / ratio;
            let pebble = case.sphere(1.0 / ratio, [0.0, apart, 0.0]);
            let Some(end) = case.attempt(1000) else { return f64::INFINITY };
            let weight = end.mass(0) * end.mass(pebble) / apart.powi(2);
            let force = end.force(0, pebble).map_or(f64::INFINITY, |force| (force / weight - Vec3::x()).norm());
            // Positions to a thousandth of that.
            force.max((end.x(pebble) - Vec3::new(0.0, apart, 0.0)).norm() * 1e3)
        };
        [1e-4, 1e-3, 1e-2].map(away).into_iter().fold(0.0, f64::max)
    });
    found.print();
}

#[test]
fn masses_may_differ_by_many_powers_of_ten() {
    for power in [9, 15] {
        let heavy = 10f64.powi(power);
        let mut case = Case::new();
        case.law("RST_CLB", &[0.5, 0.0, 0.3]);
        let ram = case.sphere_of(heavy, 0.5, [0.0; 3]);
        case.launch(ram, [1.0, 0.0, 0.0], [0.0; 3]);
        let ball = case.sphere(0.5, [1.05, 0.0, 0.0]);
        let end = case.run(100);
        // As off a wall, but for the ratio of the masses.
        near(end.v(ball), [1.5, 0.0, 0.0], 2.0 / heavy + 1e-14);
        near(end.v(ram), [1.0, 0.0, 0.0], 2.0 / heavy + 1e-14);
    }
}

#[test]
fn any_theta_and_step_give_bounded_motion() {
    for theta in [0.5, 0.7, 1.0] {
        for h in [1e-6, 1e-3, 0.1, 10.0] {
            let mut case = Case::new();
            case.law("IQS_CLB", &[0.5]);
            case.gravity = [0.0, 0.0, -1.0];
            case.options.theta = theta;
            case.options.dt = h;
            case.options.tol = Some(1e-8);
            case.tub(2.0);
            for k in 0..8 {
                let at = |bit: i32| f64::from(k >> bit & 1) - 0.5;
                case.sphere(0.4, [at(0), at(1), at(2) + 1.5]);
            }
            let states = case.states(30, 30);
            assert!(is_finite(&states[1]));
            for i in states[1].free() {
                // Falls from 2 m at most, 2 m/s, and a gap that the first step leaves closes in the next. (Of steps
                // of 1000 s the solver's 1e-8 of h g, held for h, would be the size of the tub.)
                assert!(states[1].x(i).norm() < 10.0, "theta {theta}, h {h}: {:?}", states[1].x(i));
                assert!(states[1].v(i).norm() <= (30.1 * h).min(2.5), "theta {theta}, h {h}: {:?}", states[1].v(i));
            }
        }
    }
}

#[test]
fn bodies_that_leave_for_good_are_no_fault() {
    let mut case = Case::new();
    case.options.self_gravity = true;
    case.law("IQS_CLB", &[0.5]);
    case.options.dt = 1e6;
    for k in 0..3 {
        let body = case.sphere(0.5, [f64::from(k), 0.0, 0.0]);
        case.launch(body, [f64::from(k) * 1e6, 1e6, 0.0], [0.0; 3]);
    }
    let end = case.run(100);
    assert!(is_finite(&end));
    near(end.x(2), [2.0 + 2e14, 1e14, 0.0], 1.0);
}

/// Two bodies at 1 m, with a gravity constant of 1e39 m³/(kg s²).
fn attracting_pair(density: f64, radius: f64, dt: f64) -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    (case.options.self_gravity, case.options.gravity_constant, case.options.dt) = (true, 1e39, dt);
    case.sphere_of(density, radius, [0.0; 3]);
    case.sphere_of(density, radius, [1.0, 0.0, 0.0]);
    case.write();
    case
}

#[test]
fn a_run_that_overflows_stops_and_its_snapshots_are_sound() {
    // It overflows in the first step.
    let case = attracting_pair(1e-3, 1e39, 1e20);
    assert_eq!(case.solve(&["--steps", "1000", "--output-every", "1"]), 3);
    let states = case.written();
    assert!(!states.is_empty() && states.iter().all(is_finite));
}

#[test]
fn snapshots_with_numbers_beyond_those_of_input_are_no_start_of_a_run() {
    // Speeds exceed 1e40 m/s, and are finite.
    let case = attracting_pair(1e39, 1e-3, 1.0);
    assert_eq!(case.solve(&["--steps", "2", "--output-every", "1"]), 0);
    assert!(case.written().iter().all(is_finite));
    assert_eq!(case.solve(&["--steps", "1000", "--resume"]), 2);
}

#[test]
fn fast_bodies_leave_readable_snapshots() {
    let launched = || {
        let mut case = Case::new();
        let ball = case.sphere(0.5, [0.0; 3]);
        case.sphere(0.5, [0.0, 5.0, 0.0]);
        case.launch(ball, [0.0, 0.0, 1e39], [0.0; 3]);
        case
    };
    let case = launched();
    case.write();
    let code = case.solve(&["--steps", "3", "--output-every", "1"]);
    assert!(code == 0 || code == 3, "{code}");
    assert!(case.written().iter().all(is_finite)); // reads each of them
    assert_eq!(case.solve(&["--steps", "5", "--resume"]), code);
    // Speeds whose squares overflow are rejected, also of an event.
    let mut case = launched();
    case.event(0.0, cd_formats::compute::EventAction::AddVelocity([0.0, 0.0, 1e160]));
    case.write();
    assert_eq!(case.solve(&["--steps", "3"]), 2);
}

#[test]
fn a_spin_beyond_a_turn_a_step_is_sound() {
    let mut case = Case::new();
    let top = case.sphere(0.5, [0.0; 3]);
    case.launch(top, [0.0; 3], [1e20, -1e20, 3e19]);
    case.options.sphere_orientation = true;
    let end = case.run(10);
    assert!(is_finite(&end));
    equal(Vec3::from_row_slice(&end.bodies.body_q[0][1..]).norm().hypot(end.bodies.body_q[0][0]), 1.0, 1e-15);
}

#[test]
fn a_scene_without_laws_has_no_contacts() {
    let mut case = Case::new();
    case.gravity = [0.0, 0.0, -8.0];
    case.options.dt = 1.0 / 128.0;
    case.floor();
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
    let end = case.run(128);
    near(end.x(ball), [0.0, 0.0, -3.5], 1e-14); // falls through
    assert!(end.contacts.contact_gap.is_empty());
}

#[test]
fn no_steps_leave_the_start() {
    let mut case = Case::new();
    case.sphere(0.5, [0.1, 0.2, 0.3]);
    let end = case.run(0);
    assert_eq!((end.meta.step, end.bodies.body_x[0]), (0, [0.1, 0.2, 0.3]));
}

/// Numbers of any size that the files can hold, often equal ones and zeros.
fn number() -> impl Strategy<Value = f64> {
    let size = prop_oneof![(-90.0..40.0f64).prop_map(|p| 10f64.powf(p)), (-2.0..2.0f64).prop_map(|p| 10f64.powf(p))];
    (size, 0..3i32).prop_map(|(size, sign)| size * f64::from(sign - 1))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, failure_persistence: None, ..ProptestConfig::default() })]

    /// A run ends, is rejected or stops before it writes a number that is not finite, whatever its input.
    #[test]
    fn any_numbers_end_in_an_answer(
        spheres in prop::collection::vec((number(), number(), prop::array::uniform3(number()), prop::array::uniform3(number())), 1..8),
        gravity in prop::array::uniform3(number()),
        h in number(),
        floor: bool,
        law in 0..5usize,
        own: bool,
        theta in 0.5..1.0f64,
    ) {
        let mut case = Case::new();
        match law {
            0 => case.law("IQS_CLB", &[0.5]),
            1 => case.law("RST_CLB", &[0.5, 0.5, 0.5]),
            2 => case.law("GAP_SGR_CLB", &[0.5]),
            3 => case.law("IQS_WET_DS_CLB", &[1e3, 0.0, 1.0, 0.5, 0.5]),
            _ => case.law("VEL_SGR_CLB", &[0.0]),
        }
        if floor {
            case.floor();
        }
        for (radius, density, x, v) in spheres {
            let body = case.sphere_of(density.abs().max(1e-9), radius.abs().max(1e-9), x);
            case.launch(body, v, v);
        }
        case.gravity = gravity;
        let options = &mut case.options;
        (options.dt, options.theta, options.self_gravity) = (h.abs().max(1e-30), theta, own);
        (options.tol, options.max_sweeps) = (Some(1e-6), Some(50));
        case.write();
        let code = case.solve(&["--steps", "5", "--output-every", "1"]);
        prop_assert!([0, 2, 3].contains(&code));
        prop_assert!(case.written().iter().all(is_finite));
    }
}
