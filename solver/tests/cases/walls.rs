//! Bodies whose motion is imposed, and what they do to others.

use cd_formats::drv_dof::Evolution;

use crate::case::{Case, Figures, Vec3, equal, near};

const STEP: f64 = 1.0 / 128.0;

fn harmonic(amplitude: f64, omega: f64, phase: f64) -> Evolution {
    Evolution::Harmonic { constant: 0.0, amplitude, omega, phase, ramp_start: 1.0, ramp_rate: 0.0 }
}

/// A floor that moves with `vertical` velocity under a sphere of radius 1/2 in 8 m/s^2.
fn lift(vertical: Evolution) -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -8.0];
    case.options.dt = STEP;
    let floor = case.floor();
    case.drive_along(floor, 2, vertical);
    case.sphere(0.5, [0.0, 0.0, 0.5]);
    case
}

#[test]
fn imposed_motion_is_that_of_the_scheme() {
    for theta in [0.5, 0.75, 1.0] {
        let mut case = Case::new();
        case.options.theta = theta;
        case.options.dt = STEP;
        case.sphere(0.5, [9.0, 9.0, 9.0]); // somebody must be free
        let ramp = Evolution::Harmonic {
            constant: 3.0,
            amplitude: 0.0,
            omega: 0.0,
            phase: 0.0,
            ramp_start: 0.0,
            ramp_rate: 2.0,
        };
        let points = vec![[0.0, 0.0], [0.25, 1.0], [0.75, -1.0], [1.0, 0.0]];
        let walls = [
            Evolution::constant(0.25),
            harmonic(0.5, 4.0, 0.0),
            ramp,
            Evolution::Table { name: "v.dat".into(), points },
        ];
        for (k, evolution) in walls.into_iter().enumerate() {
            let wall =
                case.plate([1.0; 3], [0.0, 10.0 * k as f64, 0.0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
            case.drive_along(wall, 0, evolution);
        }
        for state in case.states(256, 32) {
            let (t, h) = (state.meta.time, STEP);
            // x = sum of h ((1-theta) v_k + theta v_k+1): the trapezium plus (theta - 1/2) h (v(t) - v(0)).
            let ahead = (theta - 0.5) * h;
            // Sums of 256 terms.
            near(state.x(1), [0.25 * t, 0.0, 0.0], 1e-14);
            let trapezium = 0.5 * 0.5 * h / (2.0 * h).tan() * (4.0 * t).sin();
            near(state.x(2), [trapezium + ahead * 0.5 * ((4.0 * t).cos() - 1.0), 10.0, 0.0], 1e-14);
            // 6 t up to 1/2 s, then 3.
            let ramped = if t < 0.5 { 3.0 * t * t } else { 0.75 + 3.0 * (t - 0.5) };
            near(state.x(3), [ramped + ahead * (6.0 * t).min(3.0), 20.0, 0.0], 1e-13);
            // Lines between the points and beyond the last: v = 4 t, 1 - 4 (t - 1/4), -1 + 4 (t - 3/4).
            let tabled = match t {
                t if t < 0.25 => 2.0 * t * t,
                t if t < 0.75 => 0.125 + (t - 0.25) - 2.0 * (t - 0.25).powi(2),
                t => 0.125 - (t - 0.75) + 2.0 * (t - 0.75).powi(2),
            };
            near(state.x(4), [tabled + ahead * state.v(4).x, 30.0, 0.0], 1e-13);
        }
    }
}

#[test]
fn a_sphere_rides_on_a_lift() {
    // From rest at 2 m/s^2, and down again at the same.
    let points = vec![[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]];
    let mut case = lift(Evolution::Table { name: "lift.dat".into(), points });
    for state in &case.states(256, 16)[1..] {
        let a = if state.meta.time <= 1.0 { 2.0 } else { -2.0 };
        near(state.x(1) - state.x(0), [0.0, 0.0, 1.0], 1e-13); // sums of 256 terms
        equal(state.force(1, 0).unwrap().x, (8.0 + a) * state.mass(1), 1e-11);
    }
}

#[test]
fn a_shaken_sphere_leaves_the_plate_when_that_falls_away_faster() {
    let shaken = |omega: f64| {
        let mut case = lift(harmonic(1.0, omega, 0.0));
        case.launch(1, [0.0, 0.0, 1.0], [0.0; 3]); // as the plate
        case
    };
    let riding = shaken(7.5).states(256, 8); // 7.5 m/s^2 at most
    riding.iter().for_each(|state| near(state.x(1) - state.x(0), [0.0, 0.0, 1.0], 1e-13));
    // 16 m/s^2: off at sin(omega t) = 1/2, at t = pi / 6 / 16 to a step.
    let thrown = shaken(16.0).states(64, 1);
    let off = thrown.iter().position(|state| (state.x(1) - state.x(0)).z > 1.0 + 1e-12).unwrap();
    equal(thrown[off].meta.time, std::f64::consts::PI / 96.0, 1.5 * STEP);
}

#[test]
fn a_falling_floor_carries_nothing() {
    let mut case = lift(Evolution::Table { name: "fall.dat".into(), points: vec![[0.0, 0.0], [1.0, -10.0]] });
    for state in case.states(64, 32) {
        near(state.x(1), [0.0, 0.0, 0.5 - 4.0 * state.meta.time.powi(2)], 1e-13);
    }
}

/// A plate that turns about its third axis at 2 rad/s with a rolling sphere on it, launched at 1/2 m/s.
fn turntable() -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[10.0]);
    case.gravity = [0.0, 0.0, -8.0];
    case.options.dt = STEP;
    let floor = case.floor();
    case.drive_along(floor, 5, Evolution::constant(2.0));
    let ball = case.sphere(0.5, [1.0, 0.0, 0.5]);
    // At (1, 0) the table moves at 2 along y: v + w x (-r z) = (0, 2, 0), w = (w_x, w_y, 0).
    // v = (0, 1/2, 0): (-r w_y, 1/2 + r w_x) = (0, 2).
    case.launch(ball, [0.0, 0.5, 0.0], [3.0, 0.0, 0.0]);
    case
}

#[test]
fn a_ball_on_a_turntable_circles_at_two_sevenths_of_its_rate() {
    let states = turntable().states(512, 64);
    for (k, state) in states.iter().enumerate() {
        // dv/dt = 2/7 omega x v: in circles, turned by a in a step. The first step, which does not know yet what it will carry, and the
        // second, which makes up for it, are off by some a^2, and what further steps add is of higher order.
        let a = 4.0 / 7.0 * STEP;
        let angle = 64.0 * k as f64 * a;
        near(state.v(1), [-0.5 * angle.sin(), 0.5 * angle.cos(), 0.0], 0.5 * 15.0 * a * a);
        // The circle's radius is v / (2/7 omega) = 7/8 about (1/8, 0), to first order in h.
        let from_centre = (state.x(1) - Vec3::new(0.125, 0.0, 0.5)).norm();
        equal(from_centre, 0.875, 0.875 * 2.0 * STEP);
    }
}

#[test]
fn a_turning_plate_turns_as_imposed() {
    for theta in [0.5, 1.0] {
        let mut case = turntable();
        case.options.theta = theta;
        let state = case.run(128);
        let [w, x, y, z] = state.bodies.body_q[0];
        // 2 rad/s for 1 s, half angles in the quaternion; 256 rotations' rounding.
        near([x, y, z], [0.0, 0.0, 1f64.sin()], 1e-13);
        equal(w, 1f64.cos(), 1e-13);
        assert_eq!((state.x(0), state.w(0)), (-0.5 * Vec3::z(), 2.0 * Vec3::z()));
    }
}

#[test]
fn a_swung_plate_throws_what_lies_on_it() {
    // A plate of half length 4 about its y axis at 1/2 rad/s; the sphere lies 2 m off the axis, on the rising side.
    let mut case = Case::new();
    case.law("RST_CLB", &[0.0, 0.0, 0.0]);
    case.options.dt = 1e-4;
    let plate = case.plate([4.0, 4.0, 0.5], [0.0, 0.0, -0.5], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    case.drive_along(plate, 4, Evolution::constant(-0.5));
    let ball = case.sphere(0.5, [2.0, 0.0, 0.5]);
    let end = case.run(2);
    // It leaves with the plate's velocity along the normal, omega x 2 m; the plate has turned by 1e-4 rad.
    near(end.v(ball), [0.0, 0.0, 1.0], 3e-4);
}

#[test]
fn a_driven_sphere_strikes_as_a_wall() {
    for e in [0.0, 0.5, 1.0] {
        let mut case = Case::new();
        case.law("RST_CLB", &[e, 0.0, 0.5]);
        let ram = case.sphere(0.5, [0.0; 3]);
        case.drive_along(ram, 0, Evolution::constant(2.0));
        let ball = case.sphere(0.25, [0.76, 0.0, 0.0]);
        let end = case.run(20);
        near(end.v(ball), [2.0 * (1.0 + e), 0.0, 0.0], 1e-14);
        near(end.v(ram), [2.0, 0.0, 0.0], 0.0);
        // What the wall gave is what the ledger expects.
        near(end.momentum(), end.meta.ledger.momentum_expected, 1e-14);
        equal(end.kinetic(), end.meta.ledger.contact_work + end.meta.ledger.outside_work, 1e-14);
    }
}

#[test]
fn a_sphere_meets_a_plate_on_both_faces_and_its_rim() {
    for (x, v) in
        [([0.0, 0.0, 1.1], [0.0, 0.0, -1.0]), ([0.0, 0.0, -1.1], [0.0, 0.0, 1.0]), ([2.6, 0.0, 0.0], [-1.0, 0.0, 0.0])]
    {
        let mut case = Case::new();
        case.law("RST_CLB", &[1.0, 0.0, 0.0]);
        case.plate([2.0, 2.0, 0.5], [0.0; 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        let ball = case.sphere(0.5, x);
        case.launch(ball, v, [0.0; 3]);
        near(case.run(200).v(ball), v.map(|c| -c), 1e-14);
    }
}

#[test]
fn forces_and_moments_accelerate() {
    let mut case = Case::new();
    case.options.theta = 0.75;
    let ball = case.sphere(0.5, [0.0; 3]);
    case.pull(ball, 1, 0.5);
    case.pull(ball, 5, 0.25);
    let end = case.run(1000);
    near(end.v(ball), [0.0, 0.5 / end.mass(ball), 0.0], 1e-12);
    near(end.w(ball), [0.0, 0.0, 0.25 / end.bodies.body_inertia[ball][0]], 1e-11);
}

/// A moment about a body's own axis while it turns about another, L = T/ω (sin ωt, 1 - cos ωt): of second order, and the
/// same for a sphere, whether or not its orientation is requested.
#[test]
fn a_moment_turns_with_its_body() {
    let run = |sphere: bool, orientation: bool, steps: u64| {
        let mut case = Case::new();
        case.options.sphere_orientation = orientation;
        let body = match sphere {
            true => case.sphere(0.5, [0.0; 3]),
            false => case.block([0.5; 3], [0.0; 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        };
        case.launch(body, [0.0; 3], [0.0, 0.0, 2.0]);
        case.pull(body, 3, 1e-7);
        case.options.dt = 1.0 / steps as f64;
        let w = case.run(steps).w(body);
        let inertia = if sphere { 0.4 * std::f64::consts::PI / 6.0 * 0.25 } else { 1.0 / 6.0 };
        let expected = Vec3::new(2f64.sin(), 1.0 - 2f64.cos(), 0.0) * (1e-7 / 2.0 / inertia);
        (w.xy() - expected.xy()).norm() / expected.norm()
    };
    for (sphere, orientation) in [(false, false), (true, true), (true, false)] {
        let errors = [10, 20, 40].map(|steps| run(sphere, orientation, steps));
        for pair in errors.windows(2) {
            assert!((3.6..4.4).contains(&(pair[0] / pair[1])), "{errors:?}"); // second order
        }
        assert!(errors[2] < 1e-3, "{errors:?}");
    }
}

/// A plate of 4 x 4 x 1 m and 16 kg at a height, pressed down with 32 N in 8 m/s^2, that moves along x at 1/4 m/s.
fn press(case: &mut Case, height: f64) -> usize {
    case.gravity = [0.0, 0.0, -8.0];
    case.options.dt = STEP;
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let plate = case.plate([2.0, 2.0, 0.5], [0.0, 0.0, height + 0.5], axes);
    case.drive_along(plate, 0, Evolution::constant(0.25));
    case.press(plate, 2, -32.0);
    plate
}

#[test]
fn a_plate_driven_in_part_falls_by_its_weight_and_force() {
    let mut case = Case::new();
    let plate = press(&mut case, 0.0);
    case.sphere(0.5, [9.0, 9.0, 9.0]); // somebody must be free
    for state in case.states(256, 32) {
        let t = state.meta.time;
        // 8 + 32/16 m/s^2; sums of 256 terms.
        near(state.x(plate), [0.25 * t, 0.0, 0.5 - 5.0 * t * t], 1e-12);
        near(state.v(plate), [0.25, 0.0, -10.0 * t], 1e-12);
        assert_eq!(state.bodies.body_driven[plate], 0b11_1011);
    }
}

#[test]
fn a_press_gives_its_load_to_the_floor() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    let floor = case.floor();
    case.drive_along(floor, 0, Evolution::constant(0.25));
    let plate = press(&mut case, 1.0);
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
    case.launch(ball, [0.25, 0.0, 0.0], [0.0; 3]); // as both
    for state in &case.states(256, 32)[1..] {
        let load = 16.0 * 8.0 + 32.0;
        equal(state.force(ball, plate).unwrap().x, load, 1e-10); // of some hundred newtons, to the solver's tolerance
        equal(state.force(ball, floor).unwrap().x, load + 8.0 * state.mass(ball), 1e-10);
        near(state.x(plate) - state.x(ball), [0.0, 0.0, 1.0], 1e-12); // sums of 256 terms
    }
    // The floor takes what press and weight bring.
    assert!(case.column("momentum_drift").iter().all(|drift| *drift < 1e-12));
}

#[test]
fn a_guided_sphere_is_struck() {
    let mut case = Case::new();
    case.law("RST_CLB", &[1.0, 0.0, 0.0]);
    case.options.dt = STEP.powi(4); // the way of half a step turns the normal
    let guided = case.sphere(0.5, [0.0; 3]);
    case.drive(guided, [0.0; 6].map(Evolution::constant));
    case.press(guided, 0, 0.0);
    let ball = case.sphere(0.5, [0.6, 0.8, 0.0]);
    case.launch(ball, [-1.0, 0.0, 0.0], [0.0; 3]);
    let state = case.run(1);
    // Along n = (0.6, 0.8) each kilogram of the ball has 1/m, of the guided sphere 0.6^2/m:
    // r/m = 2 * 0.6 / (1 + 0.36), and all energy is kept.
    let r = 1.2 / 1.36;
    near(state.v(ball), [-1.0 + 0.6 * r, 0.8 * r, 0.0], 1e-8); // h
    near(state.v(guided), [-0.6 * r, 0.0, 0.0], 1e-8);
    let energy = state.v(ball).norm_squared() + state.v(guided).norm_squared();
    equal(energy, 1.0, 1e-12); // the law's, to rounding
}

#[test]
fn a_plate_that_begins_to_turn_meets_what_lies_far_out() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.0]);
    case.options.dt = 0.0078125;
    let plate = case.plate([5.0, 1.0, 0.5], [0.0, 0.0, -0.5], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let ball = case.sphere(0.5, [4.5, 0.0, 0.5078125]);
    // At rest before: the gap is far beyond the alert distance, and what 4.5 m/s closes in a step.
    let points = vec![[0.0, 0.0], [0.0078125, -1.0], [1.0, -1.0]];
    case.drive_along(plate, 4, Evolution::Table { name: "turn.dat".into(), points });
    let end = case.run(1);
    // In the step the rim rises by 4.5 h where the gap is 1 h: (1 - 4.5) h is made good by the ball's velocity.
    near(end.v(ball), [0.0, 0.0, 3.5], 1e-9);
}

/// An imposed velocity holds from the start, whatever DOF.INI has.
#[test]
fn an_imposed_velocity_is_that_of_drv_dof_at_the_start_too() {
    let mut case = lift(Evolution::constant(0.5));
    case.launch(0, [0.0; 3], [0.0, 0.0, 3.0]);
    let states = case.states(128, 128);
    near(states[0].v(0), [0.0, 0.0, 0.5], 0.0);
    near(states[0].w(0), [0.0; 3], 0.0);
    near(states[1].x(0), [0.0, 0.0, 0.0], 1e-14); // from -1/2 in a second
}

/// A plate that a force pushes weighs what avrd says, as in LMGC90; what is left of its volume by seven digits, its volume.
#[test]
fn a_plate_weighs_what_the_file_says() {
    let pushed = |radius: f64| {
        let mut case = Case::new();
        let plate = press(&mut case, 0.0);
        case.bodies[plate].equivalent_radius = radius;
        case.sphere(0.5, [9.0, 9.0, 9.0]); // somebody must be free
        case.run(1).mass(plate)
    };
    let own = pushed(0.0);
    assert_eq!(pushed(2.0), 4.0 / 3.0 * std::f64::consts::PI * 8.0);
    let radius: f64 = format!("{:.7e}", (own * 0.75 / std::f64::consts::PI).cbrt()).parse().unwrap();
    assert_eq!(pushed(radius), own);
}
