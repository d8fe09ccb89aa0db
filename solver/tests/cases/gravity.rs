//! Fields from outside, self-gravity between its evaluations, and what long runs keep.

use std::f64::consts::{PI, TAU};

use cd_formats::compute::{Compute, EventAction, ExternalField, GravityMethod};
use cd_formats::orbit::OrbitSpec;
use cd_formats::snapshot::Snapshot;
use cd_solve::limits;
use nalgebra::{Quaternion, Rotation3, UnitQuaternion};

use crate::case::{Case, Envelope, Figures, SearchEffort, Vec3, equal, is_long, near, shaken_lattice, uniform};
use crate::same_bits::{files, same};

/// A speck about a primary at `centre` with G M = 1, at distance 1 with a velocity.
fn body_about(field: ExternalField, centre: Vec3, x: Vec3, v: Vec3, dt: f64) -> Case {
    let mut case = Case::new();
    case.options.gravity_constant = 0.5;
    case.options.dt = dt;
    case.options.fields = vec![field];
    let speck = case.sphere(0.01, (centre + x).into());
    case.launch(speck, v.into(), [0.0; 3]);
    case
}

#[test]
fn an_orbit_about_a_primary_closes_and_its_energy_is_booked() {
    let centre = Vec3::new(2.0, -1.0, 0.5);
    // From the far end of an orbit of eccentricity 1/2: a = 2/3, v^2 = 2/1 - 1/a.
    let (x, v, period) = (Vec3::x(), Vec3::y() * 0.5f64.sqrt(), 2.0 * PI * (2.0f64 / 3.0).powf(1.5));
    let miss = |steps: u64| {
        let field = ExternalField::PointMass { mass: 2.0, position: Some(centre.into()), orbit: None, response: false };
        let states = body_about(field, centre, x, v, period / steps as f64).states(steps, steps);
        let (first, last) = (&states[0], &states[1]);
        let energy = |state: &Snapshot| state.kinetic() - state.mass(0) / (state.x(0) - centre).norm();
        // Kinetic and potential energy at the start, and momentum with what the primary gave: to round-off.
        equal(last.meta.ledger.energy_start, energy(first), 1e-14 * last.mass(0));
        near(last.meta.ledger.momentum_expected, last.momentum(), 1e-12 * last.mass(0));
        near(last.meta.ledger.angular_momentum_expected, last.angular_momentum(), 1e-12 * last.mass(0));
        // It is back where it was, but for an error of second order.
        equal(energy(last), last.meta.ledger.energy_start, 1e-4 * last.mass(0));
        (last.x(0) - centre - x).norm()
    };
    let misses = [500, 1000, 2000].map(miss);
    for pair in misses.windows(2) {
        assert!((3.8..4.2).contains(&(pair[0] / pair[1])), "{misses:?}"); // 4, and the next order
    }
    assert!(misses[2] < 1e-3, "{misses:?}");
}

#[test]
fn an_oblate_primary_turns_the_node() {
    let (tilt, steps) = (PI / 4.0, 200);
    let (j2, radius) = (0.01f64, 0.3f64);
    let field = ExternalField::Oblate {
        mass: 2.0,
        position: Some([0.0; 3]),
        orbit: None,
        response: false,
        radius,
        j2,
        axis: [0.0, 0.0, 3.0],
    };
    let v = Vec3::new(0.0, tilt.cos(), tilt.sin());
    let orbits = 20;
    let steps_made = steps * orbits;
    let states = body_about(field, Vec3::zeros(), Vec3::x(), v, 2.0 * PI / steps as f64).states(steps_made, steps_made);
    let plane = states[1].angular_momentum();
    let node = plane.x.atan2(-plane.y);
    // dOmega/dt = -3/2 n J2 (R/a)^2 cos i to first order in J2 (R/a)^2 = 9e-4; and the step's phase, (2 pi/200)^2/24.
    let expected = -1.5 * j2 * radius * radius * tilt.cos() * 2.0 * PI * orbits as f64;
    equal(node, expected, 0.01 * expected.abs());
    // The field is even about its axis: that component of angular momentum stays.
    equal(plane.z, states[0].angular_momentum().z, 1e-12 * plane.norm());
}

/// Elements of an orbit in a tilted plane.
fn tilted_orbit(periapsis: f64, eccentricity: f64, periapsis_time: f64) -> OrbitSpec {
    OrbitSpec::Elements {
        periapsis: Some(periapsis),
        semi_major_axis: None,
        eccentricity: Some(eccentricity),
        v_infinity: None,
        inclination: 0.4,
        node: 1.0,
        argument: -0.7,
        periapsis_time,
    }
}

/// In axes that fall on an orbit at 1e8 m, two specks at some 100 m move as the differences of the Kepler orbits.
#[test]
fn specks_beside_an_orbit_move_on_orbits_of_their_own() {
    let (mass, constant) = (6e24, 6.67e-11);
    let mu = mass * constant;
    for eccentricity in [0.2, 1.0, 3.0] {
        let orbit = tilted_orbit(1e8, eccentricity, 2e4);
        let origin = orbit.to_orbit(mu);
        let places = [Vec3::new(90.0, -40.0, 20.0), Vec3::zeros()];
        let speeds = [Vec3::new(0.001, 0.002, -0.003), Vec3::zeros()];
        let end = 4e4;
        let run = |steps: u64| {
            let mut case = Case::new();
            case.options.gravity_constant = constant;
            case.options.dt = end / steps as f64;
            case.options.fields =
                vec![ExternalField::PointMass { mass, position: None, orbit: Some(orbit.clone()), response: false }];
            for (x, v) in places.into_iter().zip(speeds) {
                let speck = case.sphere(0.01, x.into());
                case.launch(speck, v.into(), [0.0; 3]);
            }
            case.run(steps)
        };
        let miss = |steps: u64| {
            let after = run(steps);
            // Work of the tide, and momentum with what it gave: to rounding.
            equal(
                after.meta.ledger.outside_work + after.meta.ledger.energy_start,
                after.kinetic(),
                1e-12 * after.kinetic(),
            );
            near(after.meta.ledger.momentum_expected, after.momentum(), 1e-12 * after.momentum_scale());
            // The origin itself falls, to the last bit.
            assert_eq!(after.x(1), Vec3::zeros());
            let (at, speed) = origin.position_and_velocity(0.0);
            let own =
                OrbitSpec::State { position: (at + places[0]).into(), velocity: (speed + speeds[0]).into(), time: 0.0 };
            let own = own.to_orbit(mu).position_and_velocity(end).0;
            (after.x(0) - (own - origin.position_and_velocity(end).0)).norm()
        };
        let misses = [200, 400, 800].map(miss);
        // Second order, down to the rounding of the orbits, 1e-15 of 1e8 m.
        for pair in misses.windows(2) {
            assert!((3.5..4.5).contains(&(pair[0] / pair[1])), "{eccentricity}: {misses:?}");
        }
        assert!(misses[2] < 0.01, "{eccentricity}: {misses:?}");
    }
}

/// A primary that responds: the two bodies are on their Kepler orbit about each other, for any ratio of their masses, with
/// second order of the step, and what the body gains of momentum the primary loses.
#[test]
fn a_primary_responds_to_the_body() {
    let (mass, orbit) = (1.0, tilted_orbit(1.0, 0.3, 0.5));
    for ratio in [0.01, 1.0, 3.0] {
        let radius = 0.01f64;
        // The density has eight digits in BULK_BEHAV.DAT.
        let density = f64::trunc(ratio * mass / (4.0 / 3.0 * PI * radius.powi(3)));
        let bodies_mass = density * (4.0 / 3.0 * PI * radius.powi(3));
        let mu = mass + bodies_mass;
        let (offset, speed) = (Vec3::new(0.02, 0.01, -0.01), Vec3::new(0.03, -0.02, 0.01));
        let at = |time: f64| orbit.to_orbit(mu).position_and_velocity(time);
        // The body relative to the primary: the origin is at `at` from it.
        let start =
            OrbitSpec::State { position: (at(0.0).0 + offset).into(), velocity: (at(0.0).1 + speed).into(), time: 0.0 };
        let exact = start.to_orbit(mu);
        let end = 5.0;
        let run = |steps: u64| {
            let mut case = Case::new();
            (case.options.gravity_constant, case.options.dt) = (1.0, end / steps as f64);
            let field = ExternalField::PointMass { mass, position: None, orbit: Some(orbit.clone()), response: true };
            case.options.fields = vec![field];
            let speck = case.sphere_of(density, radius, offset.into());
            case.launch(speck, speed.into(), [0.0; 3]);
            case.run(steps)
        };
        let miss = |steps: u64| {
            let after = run(steps);
            let response = after.meta.primary_response.unwrap();
            equal(response.bodies_mass, bodies_mass, 1e-12 * bodies_mass);
            let given = after.v(0) * after.mass(0) + Vec3::from(response.velocity) * mass;
            near(given, speed * after.mass(0), 1e-12 * bodies_mass);
            let relative = after.x(0) - (Vec3::from(response.displacement) - at(end).0);
            (relative - exact.position_and_velocity(end).0).norm()
        };
        let misses = [500, 1000, 2000].map(miss);
        for pair in misses.windows(2) {
            assert!((3.5..4.5).contains(&(pair[0] / pair[1])), "{ratio}: {misses:?}");
        }
        assert!(misses[2] < 4e-4, "{ratio}: {misses:?}");
    }
}

#[test]
fn a_response_resumes_bit_for_bit() {
    let case = || {
        let mut case = Case::new();
        (case.options.gravity_constant, case.options.dt) = (1.0, 0.01);
        let orbit = Some(tilted_orbit(1.0, 0.3, 0.5));
        let field = ExternalField::PointMass { mass: 2.0, position: None, orbit, response: true };
        case.options.fields = vec![field];
        for x in [-0.03, 0.03] {
            case.sphere_of(1e4, 0.02, [x, 0.01, 0.0]);
        }
        (case.options.steps, case.options.output_every) = (Some(40), 10);
        case
    };
    let unbroken = files(&case(), &[&["--threads", "1"]]);
    same(&unbroken, &files(&case(), &[&["--threads", "2", "--steps", "10"], &["--resume", "--threads", "3"]]));
}

/// A satellite of a planet that is on an orbit about a star.
#[test]
fn a_chain_of_orbits_agrees_with_the_motion_in_axes_at_rest() {
    let (planet, star, end, steps) = (1.0, 100.0, 6.0, 4000);
    let about_star = tilted_orbit(40.0, 0.1, 1.0);
    let about_planet = tilted_orbit(1.0, 0.3, 0.5);
    let (r_planet, v_planet) = about_star.to_orbit(star).position_and_velocity(0.0);
    let (r, v) = about_planet.to_orbit(planet).position_and_velocity(0.0);
    let offset = Vec3::new(0.02, 0.01, -0.01);
    let run = |fields: Vec<ExternalField>, x: Vec3, v: Vec3| {
        let mut case = Case::new();
        (case.options.gravity_constant, case.options.dt) = (1.0, end / steps as f64);
        case.options.fields = fields;
        let speck = case.sphere(0.001, x.into());
        case.launch(speck, v.into(), [0.0; 3]);
        case.run(steps).x(0)
    };
    let field = |mass: f64, orbit: &OrbitSpec| ExternalField::PointMass {
        mass,
        position: None,
        orbit: Some(orbit.clone()),
        response: false,
    };
    let chain = run(vec![field(planet, &about_planet), field(star, &about_star)], offset, Vec3::zeros());
    // Newton's equations about the star at rest, with the planet on its orbit.
    let pull = |x: Vec3, time: f64| {
        let to_planet = about_star.to_orbit(star).position_and_velocity(time).0;
        let attraction = |d: Vec3, mass: f64| -d * (mass / d.norm().powi(3));
        attraction(x, star) + attraction(x - to_planet, planet)
    };
    let (mut x, mut u) = (r_planet + r + offset, v_planet + v);
    let h = end / 40_000.0;
    for k in 0..40_000 {
        // Runge-Kutta of fourth order.
        let t = f64::from(k) * h;
        let (a1, u1) = (pull(x, t), u);
        let (a2, u2) = (pull(x + u1 * (0.5 * h), t + 0.5 * h), u + a1 * (0.5 * h));
        let (a3, u3) = (pull(x + u2 * (0.5 * h), t + 0.5 * h), u + a2 * (0.5 * h));
        let (a4, u4) = (pull(x + u3 * h, t + h), u + a3 * h);
        x += (u1 + u2 * 2.0 + u3 * 2.0 + u4) * (h / 6.0);
        u += (a1 + a2 * 2.0 + a3 * 2.0 + a4) * (h / 6.0);
    }
    let origin = about_star.to_orbit(star).position_and_velocity(end).0
        + about_planet.to_orbit(planet).position_and_velocity(end).0;
    // Second order of the step: (2 pi 6/4000)^2 of a distance of 1.
    assert!((chain - (x - origin)).norm() < 1e-4, "{chain} {}", x - origin);
    // The star's tide and the offset together moved it far more than that.
    assert!((chain - offset).norm() > 0.05, "{chain}");
}

#[test]
fn orbits_beside_masses_at_rest_and_turning_axes_are_rejected() {
    let orbiting = ExternalField::PointMass {
        mass: 1.0,
        position: None,
        orbit: Some(tilted_orbit(1.0, 0.5, 0.0)),
        response: false,
    };
    let rest = ExternalField::PointMass { mass: 1.0, position: Some([5.0; 3]), orbit: None, response: false };
    let turning = ExternalField::RotatingFrame { rate: [0.0, 0.0, 1.0], centre: [0.0; 3] };
    let both = ExternalField::PointMass {
        mass: 1.0,
        position: Some([5.0; 3]),
        orbit: Some(tilted_orbit(1.0, 0.5, 0.0)),
        response: false,
    };
    let bare = ExternalField::PointMass { mass: 1.0, position: None, orbit: None, response: false };
    let faults = |fields: Vec<ExternalField>| {
        let options = Compute { fields, ..Compute::default() };
        options.check(std::path::Path::new("options")).map_or_else(|faults| faults.to_string(), |()| String::new())
    };
    assert_eq!(faults(vec![orbiting.clone(), orbiting.clone()]), "");
    for other in [rest, turning] {
        let text = faults(vec![orbiting.clone(), other]);
        assert!(text.contains("fields that all have an orbit, or none"), "{text}");
    }
    for field in [both, bare] {
        let text = faults(vec![field]);
        assert!(text.contains("either position or orbit"), "{text}");
    }
    let responding =
        |position: Option<[f64; 3]>, orbit| ExternalField::PointMass { mass: 1.0, position, orbit, response: true };
    let on_orbit = responding(None, Some(tilted_orbit(1.0, 0.5, 0.0)));
    assert_eq!(faults(vec![on_orbit.clone()]), "");
    for fields in [vec![responding(Some([5.0; 3]), None)], vec![on_orbit, orbiting]] {
        let text = faults(fields);
        assert!(text.contains("a response of a single field with an orbit"), "{text}");
    }
}

#[test]
fn turning_axes_show_the_same_motion() {
    let (rate, centre) = (Vec3::new(0.3, -0.2, 0.5), Vec3::new(0.5, 0.2, -0.1));
    let (end, specks) = (2.0, [Vec3::new(1.0, 0.0, 0.3), Vec3::new(-0.5, 0.4, 0.0)]);
    let speeds = [Vec3::new(0.1, 0.9, 0.0), Vec3::new(0.0, -0.6, 0.3)];
    let spin = Vec3::new(0.7, 0.0, -0.4);
    let run = |steps: u64, turning: bool| {
        let mut case = Case::new();
        (case.options.self_gravity, case.options.gravity_constant) = (true, 1e5);
        case.options.dt = end / steps as f64;
        if turning {
            case.options.fields = vec![ExternalField::RotatingFrame { rate: rate.into(), centre: centre.into() }];
        }
        let rate = if turning { rate } else { Vec3::zeros() };
        for (x, v) in specks.into_iter().zip(speeds) {
            let speck = case.sphere(0.01, x.into());
            case.launch(speck, (v - rate.cross(&(x - centre))).into(), (spin - rate).into());
        }
        case.run(steps)
    };
    let away = |steps: u64| {
        let (fixed, seen) = (run(steps, false), run(steps, true));
        let back = Rotation3::new(rate * end);
        for i in 0..2 {
            // Kinetic energy and the potential of the centrifugal force: nothing else does work.
            near(seen.meta.ledger.momentum_expected, seen.momentum(), 1e-12 * seen.momentum_scale());
            // A spin turns against the axes: by the scheme's tangent of half the angle, second order.
            near(back * seen.w(i) + rate, spin, 0.1 * (end / steps as f64).powi(2));
        }
        (0..2).map(|i| (back * (seen.x(i) - centre) + centre - fixed.x(i)).norm()).fold(0.0, f64::max)
    };
    let errors = [100, 200, 400].map(away);
    for pair in errors.windows(2) {
        assert!((3.6..4.4).contains(&(pair[0] / pair[1])), "{errors:?}"); // second order
    }
    assert!(errors[2] < 1e-4, "{errors:?}");
}

#[test]
fn turning_axes_show_the_same_tumbling() {
    let (rate, spin) = (Vec3::new(0.3, -0.2, 0.5), Vec3::new(0.02, 2.0, 0.01)); // nearly about the middle axis
    let run = |turning: bool| {
        let mut case = Case::new();
        case.options.dt = 0.05;
        let seen = if turning { rate } else { Vec3::zeros() };
        if turning {
            case.options.fields = vec![ExternalField::RotatingFrame { rate: rate.into(), centre: [0.0; 3] }];
        }
        let block = case.block([0.5, 0.3, 0.2], [0.0; 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        case.launch(block, [0.0; 3], (spin - seen).into());
        case.states(400, 100)
    };
    let (fixed, seen) = (run(false), run(true));
    let orientation = |state: &Snapshot| {
        let [w, x, y, z] = state.bodies.body_q[0];
        UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
    };
    let momentum_of = |state: &Snapshot, w: &Vec3| {
        let (q, inertia) = (orientation(state), Vec3::from(state.bodies.body_inertia[0]));
        q * (q.inverse() * w).component_mul(&inertia)
    };
    let energy = |state: &Snapshot| {
        0.5 * (state.w(0).dot(&momentum_of(state, &state.w(0))) - rate.dot(&momentum_of(state, &rate)))
    };
    for (fixed, seen) in fixed.iter().zip(&seen) {
        let back = UnitQuaternion::from_scaled_axis(rate * fixed.meta.time);
        // The same turns but for rounding, which tumbling doubles some ten times in 20 s.
        assert!((back * orientation(seen)).angle_to(&orientation(fixed)) < 1e-10);
        near(back * seen.w(0) + rate, fixed.w(0), 1e-10);
        equal(energy(seen), energy(&run(true)[0]), 1e-13);
        near(seen.meta.ledger.angular_momentum_expected, seen.angular_momentum(), 1e-13);
    }
    assert!(fixed.iter().any(|state| state.bodies.body_w[0][1] < 0.0), "it does not tumble");
}

#[test]
fn blocks_press_on_each_other_in_turning_axes_less_what_the_spin_takes() {
    let (mass, share): (f64, f64) = (8.0 * 0.5 * 0.3 * 0.2, 0.75);
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    (case.options.self_gravity, case.options.gravity_constant, case.options.dt) = (true, 1.0, 1e-3);
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for side in [-0.5, 0.5] {
        case.block([0.5, 0.3, 0.2], [side, 0.0, 0.0], axes);
    }
    // m W²/2 against G m²/d², d = 1 m.
    let rate = (2.0 * mass * share).sqrt();
    case.options.fields = vec![ExternalField::RotatingFrame { rate: [0.0, 0.0, rate], centre: [0.0; 3] }];
    let end = case.run(1000);
    let press: f64 = end.contacts.contact_force.iter().map(|force| force[0]).sum();
    equal(press / (mass * mass), 1.0 - share, (1e-3 * rate).powi(2)); // Coriolis' force makes an error of (h W)²
    near(end.x(1) - end.x(0), [1.0, 0.0, 0.0], (1e-3 * rate).powi(2));
    near(end.w(0), [0.0; 3], (1e-3 * rate).powi(2));
}

#[test]
fn coriolis_force_does_no_work() {
    let mut case = Case::new();
    case.options.dt = 0.05;
    case.options.fields = vec![ExternalField::RotatingFrame { rate: [0.0, 0.0, 1.0], centre: [0.0; 3] }];
    let stone = case.sphere(0.1, [1.0, 0.0, 0.0]);
    case.launch(stone, [0.3, 0.2, 0.1], [0.0; 3]);
    for state in case.states(400, 50) {
        // v^2 - |W x r|^2 wavers with h^2, and does not drift.
        let (x, v) = (state.x(stone), state.v(stone));
        equal(v.norm_squared() - x.xy().norm_squared(), 0.14 - 1.0, 1e-3 * (1.0 + x.norm_squared()));
        near(state.meta.ledger.momentum_expected, state.momentum(), 1e-12 * (1.0 + x.norm()));
    }
}

/// A ball on a plate without friction, laid or let fall on it, in a frame that rotates about a horizontal line.
#[test]
fn coriolis_force_leaves_alone_what_lies() {
    for (height, h) in [(0.0, 1e-2), (0.0, 1e-3), (0.2, 1e-2)] {
        let (rate, g) = (1e-3, 9.81);
        let mut case = Case::new();
        case.law("IQS_CLB", &[0.0]);
        case.gravity = [0.0, 0.0, -g];
        case.options.dt = h;
        case.options.fields = vec![ExternalField::RotatingFrame { rate: [0.0, rate, 0.0], centre: [0.0; 3] }];
        case.floor();
        let ball = case.sphere(0.5, [0.0, 0.0, 0.5 + height]);
        let end = case.run((1.0 / h) as u64);
        // 2 W x the way down; the contact's part of the last step, 2 W h g h/2, is what is missing. The centrifugal force
        // does W² x 1 s, a millionth of the speed.
        equal(end.v(ball).x, 2.0 * rate * height, 1.001 * rate * g * h * h);
        near(end.meta.ledger.momentum_expected, end.momentum(), 1e-12 * end.mass(ball) * g);
    }
}

/// Two balls of radius 1/2 and mass m that pass through each other along x, at rest at ±1; G = 1.
fn swinging_balls(steps_of_a_fall: f64) -> (Case, f64) {
    let mut case = Case::new();
    (case.options.self_gravity, case.options.gravity_constant) = (true, 1.0);
    case.sphere(0.5, [-1.0, 0.0, 0.0]);
    case.sphere(0.5, [1.0, 0.0, 0.0]);
    let mass = PI / 6.0;
    // Time of the fall of two points from rest at the distance 2 to each other: π/2 √(d³/(2 G 2m)).
    case.options.dt = PI / 2.0 * (8.0 / (4.0 * mass)).sqrt() / steps_of_a_fall;
    (case, mass)
}

#[test]
fn balls_without_contacts_swing_through_each_other_and_keep_their_energy() {
    let error = |steps: f64| {
        let (mut case, mass) = swinging_balls(steps);
        // A hundred states a fall: they move apart by 0.06 between two at most.
        let states = case.states(20 * steps as u64, steps as u64 / 100);
        let energy = |state: &Snapshot| {
            let x = (state.x(1) - state.x(0)).norm();
            // U of two equal balls in units of G m²/R, with r/R; points apart.
            let u =
                |y: f64| if y < 2.0 { -1.2 + 0.5 * y * y - 0.1875 * y.powi(3) + y.powi(5) / 160.0 } else { -1.0 / y };
            state.kinetic() + mass * mass / 0.5 * u(x / 0.5)
        };
        // The program's own energy at the start is the same.
        equal(states[0].meta.ledger.energy_start, energy(&states[0]), 1e-12);
        let scale = mass * mass / 2.0;
        let widest = states.iter().map(|state| (state.x(1) - state.x(0)).norm()).fold(0.0, f64::max);
        assert!(widest < 2.01, "{widest}");
        assert!(states.iter().any(|state| (state.x(1) - state.x(0)).norm() < 0.05));
        states.iter().map(|state| (energy(state) - energy(&states[0])).abs()).fold(0.0, f64::max) / scale
    };
    let [coarse, fine] = [error(200.0), error(400.0)];
    // The error of the energy over some ten swings is of second order in the step.
    assert!(coarse < 1e-2 && fine < 0.35 * coarse, "{coarse} {fine}");
}

#[test]
fn softened_bodies_attract_as_balls_of_that_radius() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    (case.options.self_gravity, case.options.gravity_constant) = (true, 1.0);
    case.options.gravity_softening = Some(5.0);
    case.sphere(0.5, [0.0; 3]);
    case.sphere(0.5, [3.0, 0.0, 0.0]);
    case.sphere(0.5, [50.0, 0.0, 0.0]);
    case.options.dt = 1e-3;
    let end = case.run(1);
    let mass = PI / 6.0;
    // F = G m²/R² (y - 9 y²/16 + y⁴/32) for y = r/R < 2; the third ball is far away.
    let y: f64 = 0.6;
    let near_by = mass / 25.0 * (y - 9.0 / 16.0 * y * y + y.powi(4) / 32.0);
    equal(end.v(0).x, 1e-3 * (near_by + mass / 2500.0), 1e-12);
    equal(end.v(1).x, 1e-3 * (mass / (47.0 * 47.0) - near_by), 1e-12);
    case.options.gravity = GravityMethod::Fmm;
    assert!(case.attempt(1).is_none());
}

#[test]
fn rods_turn_each_other_and_keep_angular_momentum() {
    let run = |quadrupole: bool| {
        let mut case = Case::new();
        (case.options.self_gravity, case.options.gravity_constant) = (true, 1.0);
        case.options.gravity_quadrupole = quadrupole;
        case.options.dt = 0.01;
        case.block([1.0, 0.25, 0.25], [0.0; 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        case.block([1.0, 0.5, 0.25], [1.8, 1.5, 0.4], [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]);
        case.run(100)
    };
    let (points, rods) = (run(false), run(true));
    for i in 0..2 {
        near(points.w(i), [0.0; 3], 0.0);
        // G m/d^3 times a second at m = 1 and d = 2.4 is 0.07; the moments differ by about half of themselves.
        assert!(rods.w(i).norm() > 0.01, "{}", rods.w(i));
    }
    near(rods.momentum(), [0.0; 3], 1e-14 * rods.momentum_scale());
    // Lengths are some 2 m; spins and orbit turn against each other.
    near(rods.angular_momentum(), [0.0; 3], 1e-13 * rods.momentum_scale());
}

/// Two rods in line with each other pull each other by Σ(2a² - b² - c²)/2d² more than points do, however far apart, unless by expansions.
#[test]
fn satellites_feel_quadrupoles() {
    for (method, share) in [(GravityMethod::Direct, 1.0), (GravityMethod::Fmm, 0.0)] {
        let mut case = Case::new();
        let options = &mut case.options;
        (options.self_gravity, options.gravity, options.gravity_constant) = (true, method, 1.0);
        (options.gravity_quadrupole, options.dt) = (true, 1e-3);
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        case.block([1.0, 0.25, 0.25], [0.0; 3], axes);
        case.block([1.0, 0.5, 0.25], [20.0, 0.0, 0.0], axes);
        let end = case.run(1);
        let more = end.v(0).x / (end.mass(1) / 400.0 * end.meta.h) - 1.0;
        // 4.5e-3 of the force; expansions err by less than the required thousandth.
        equal(more, share * (1.875 + 1.6875) / 800.0, 1e-4);
    }
}

/// A lattice of spheres that falls together, summed by expansions and evaluated every `refresh` steps.
fn falling(side: i64, refresh: u64, dt: f64) -> Case {
    let mut case = Case::new();
    let options = &mut case.options;
    (options.self_gravity, options.gravity, options.gravity_constant) = (true, GravityMethod::Fmm, 1.0);
    (options.gravity_error, options.gravity_refresh, options.dt) = (Some(1e-4), Some(refresh), dt);
    for (radius, x) in shaken_lattice(side, 3) {
        case.sphere(radius, x);
    }
    case
}

#[test]
fn extrapolated_gravity_errs_to_second_order_and_keeps_momentum() {
    let worst = |dt: f64| {
        let mut case = falling(6, 8, dt);
        // An error that no stretch here passes, of sums that are far better.
        let options = &mut case.options;
        (options.gravity_error, options.gravity_order, options.gravity_opening) = (Some(0.1), Some(8), Some(0.4));
        let last = case.run((0.4 / dt).round() as u64);
        near(last.momentum(), [0.0; 3], 1e-14 * last.momentum_scale());
        // About the origin, with bodies some 3 m out.
        near(last.angular_momentum(), [0.0; 3], 1e-13 * last.momentum_scale());
        case.column("gravity_extrapolation").into_iter().fold(0.0, f64::max)
    };
    let (coarse, fine) = (worst(0.004), worst(0.002));
    // A quarter at half the step, but for the first evaluation that falls late.
    assert!(coarse < 0.02 && (2.5..6.0).contains(&(coarse / fine)), "{coarse} {fine}");
}

#[test]
fn self_gravity_is_evaluated_as_often_as_its_error_asks() {
    let evaluations = |error: f64| {
        let mut case = falling(6, 64, 0.004);
        case.options.gravity_error = Some(error);
        case.run(120);
        let errors = case.column("gravity_extrapolation");
        // What an evaluation finds is of the first step that was not extrapolated any more.
        assert!(errors.iter().all(|&missed| missed < error), "{errors:?}");
        errors.windows(2).filter(|pair| pair[0] != pair[1]).count()
    };
    let (rough, fine) = (evaluations(1e-2), evaluations(1e-3));
    // The error goes as the square of the time: three times as many, when stretches are long.
    assert!(2 * rough < fine && 2 * fine < 120, "{rough} {fine}");
}

#[test]
fn self_gravity_is_evaluated_anew_where_an_event_throws_bodies() {
    for action in [EventAction::Shake { speed: 3.0, seed: 1 }, EventAction::AddSpin([0.0, 0.0, 2.0])] {
        let mut case = falling(6, 64, 0.004);
        (case.options.gravity_error, case.options.gravity_moved) = (Some(1e-2), 1e3);
        case.event(0.2, action.clone());
        case.run(75);
        let errors = case.column("gravity_extrapolation");
        assert!(errors.iter().all(|&missed| missed < 1e-2), "{action:?}: {errors:?}");
    }
}

#[test]
fn many_bodies_are_evaluated_now_and_then_and_few_or_by_direct_always() {
    // Extrapolation shows in the column where it is tried at all.
    let extrapolated = |side: i64, method: GravityMethod| {
        let mut case = falling(side, 1, 0.004);
        (case.options.gravity, case.options.gravity_error, case.options.gravity_refresh) = (method, None, None);
        case.run(20);
        case.column("gravity_extrapolation").iter().any(|missed| *missed > 0.0)
    };
    assert!(extrapolated(5, GravityMethod::Auto) && extrapolated(9, GravityMethod::Auto)); // 125 and 729
    assert!(!extrapolated(4, GravityMethod::Auto) && !extrapolated(5, GravityMethod::Direct));
}

#[test]
fn a_run_reports_the_error_of_its_gravity() {
    let mut case = falling(10, 1, 1e-3);
    case.run(2);
    let sampled = case.column("gravity_sampled");
    assert!(sampled[0] > 1e-6 && sampled[0] < 1e-4 && sampled[1].is_nan(), "{sampled:?}");
    assert!(case.column("gravity_sampled_largest")[0] < 1e-2);
}

#[test]
fn a_cold_ball_of_many_collapses_in_free_fall_time() {
    // Specks on a shaken lattice in a ball of radius 1: too small to meet.
    let mut case = Case::new();
    (case.options.self_gravity, case.options.gravity_constant) = (true, 1.0);
    let mut random = uniform(5);
    let cell = (4.0 / 3.0 * PI / 3000.0f64).cbrt();
    let mut count = 0;
    for k in 0..22 * 22 * 22 {
        let at = [k % 22, k / 22 % 22, k / 484].map(|c| cell * (f64::from(c) - 10.5 + 0.02 * (random() - 0.5)));
        if Vec3::from(at).norm() < 1.0 {
            case.sphere_of(1e9, 1e-6, at);
            count += 1;
        }
    }
    let mass = f64::from(count) * 1e9 * 4.0 / 3.0 * PI * 1e-18;
    let t_ff = (3.0 * PI * f64::from(count) * cell.powi(3) / (32.0 * mass)).sqrt();
    case.options.dt = t_ff / 250.0;
    let states = case.states(240, 5);
    let size = |state: &Snapshot| state.free().iter().map(|&i| state.x(i).norm_squared()).sum::<f64>().sqrt();
    let ratio: Vec<f64> = states.iter().map(|state| size(state) / size(&states[0])).collect();
    // R = R0/4 is reached at b = 60 degrees of b + sin(2b)/2 = (pi/2) t/t_ff.
    let k = ratio.iter().position(|r| *r < 0.25).expect("it falls as far as that");
    let part = (ratio[k - 1] - 0.25) / (ratio[k - 1] - ratio[k]);
    let time = states[k - 1].meta.time + part * (states[k].meta.time - states[k - 1].meta.time);
    let expected = (PI / 3.0 + 0.25 * 3f64.sqrt()) * 2.0 / PI;
    // 3000 points attract by about 0.7 % less than a continuum: 0.4 % of time; the step and the interpolation 0.2 %.
    equal(time / t_ff, expected, 0.01);
}

#[test]
fn an_orbit_of_a_thousand_periods_keeps_its_size() {
    let inside = if is_long() { vec![50.0, 100.0, 200.0] } else { Vec::new() };
    // The next order of the swing.
    Envelope::search(SearchEffort::NONE, &limits::ORBIT_STEPS, &inside, 1.1, swing_of_orbit).print();
}

/// Largest change of the distance of two bodies on a circular orbit of a thousand periods, over (2 pi/steps)²/4.
fn swing_of_orbit(steps: f64) -> f64 {
    let mut case = Case::new();
    (case.options.self_gravity, case.options.gravity_constant) = (true, 1.0);
    let density = |mass: f64| mass / (4.0 / 3.0 * PI * 1e-9);
    let heavy = case.sphere_of(density(3.0), 1e-3, [-0.25, 0.0, 0.0]);
    let light = case.sphere_of(density(1.0), 1e-3, [0.75, 0.0, 0.0]);
    // On a circle: v^2 = G M / d = 4.
    case.launch(heavy, [0.0, -0.5, 0.0], [0.0; 3]);
    case.launch(light, [0.0, 1.5, 0.0], [0.0; 3]);
    case.options.dt = PI / steps;
    let [count, every] = [1000.0, 100.0].map(|periods| (periods * steps).round() as u64);
    let Some(states) = case.attempt_states(count, every) else { return f64::INFINITY };
    // The scheme sees (h n)²/8 less attraction: the start is no more on a circle, and the distance swings by twice that.
    let swing = (TAU / steps).powi(2) / 4.0;
    let error = |state: &Snapshot| {
        // Round-off of 200 000 steps as a random walk: 450 x 1e-16 of some 3 kg m/s.
        let keeps_momentum = (state.momentum() - states[0].momentum()).norm() <= 2e-13;
        let away = ((state.x(light) - state.x(heavy)).norm() - 1.0).abs();
        if keeps_momentum { away / swing } else { f64::INFINITY }
    };
    states.iter().map(error).fold(0.0, f64::max)
}

#[test]
fn a_contact_binary_stays_where_it_is() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    (case.options.self_gravity, case.options.gravity_constant) = (true, 1.0);
    (case.options.dt, case.options.max_sweeps) = (0.01, Some(100));
    case.sphere(1.0, [-1.0, 0.0, 0.0]);
    case.sphere(0.5, [0.5, 0.0, 0.0]);
    let states = case.states(100_000, 50_000);
    let centre =
        |state: &Snapshot| (state.x(0) * state.mass(0) + state.x(1) * state.mass(1)) / (state.mass(0) + state.mass(1));
    for state in &states {
        // Round-off of 1e-16 m/s at most a step, all of one sign for 1000 s, would be 1e-13 x 1000 / 2.
        near(centre(state), centre(&states[0]), 5e-11);
        near(state.momentum(), [0.0; 3], 1e-13 * state.mass(0));
        equal((state.x(1) - state.x(0)).norm(), 1.5, 1e-9);
    }
}
