//! Motion between contacts: uniform gravity and self-gravity.

use std::f64::consts::PI;

use cd_formats::compute::{Event, EventAction};
use cd_formats::snapshot::Snapshot;

use crate::case::{Case, Figures, Vec3, equal, near, uniform};

#[test]
fn a_throw_is_a_parabola() {
    for theta in [0.5, 0.625, 1.0] {
        let mut case = Case::new();
        case.gravity = [0.5, 0.0, -8.0];
        case.options.theta = theta;
        case.options.dt = 1.0 / 64.0;
        let stone = case.sphere(0.5, [1.0, 2.0, 3.0]);
        case.launch(stone, [3.0, -1.0, 5.0], [0.0, 7.0, 0.0]);
        for state in case.states(256, 64) {
            let (t, g) = (state.meta.time, Vec3::new(0.5, 0.0, -8.0));
            // Exact for theta = 1/2; more puts it (theta - 1/2) h g t ahead. Sums of 256 terms of some 10 m.
            let v = Vec3::new(3.0, -1.0, 5.0);
            let x = Vec3::new(1.0, 2.0, 3.0) + v * t + g * (0.5 * t * t + (theta - 0.5) / 64.0 * t);
            near(state.x(stone), x, 1e-13);
            near(state.v(stone), v + g * t, 1e-13);
            assert_eq!(state.w(stone), Vec3::y() * 7.0);
        }
    }
}

#[test]
fn a_spin_turns_a_sphere_where_that_is_requested() {
    let mut case = Case::new();
    let top = case.sphere(0.5, [0.0; 3]);
    case.launch(top, [0.0; 3], [0.0, 0.0, 2.0]);
    assert_eq!(case.run(1000).bodies.body_q[top], [1.0, 0.0, 0.0, 0.0]);
    case.options.sphere_orientation = true;
    let [w, x, y, z] = case.run(1000).bodies.body_q[top];
    // After 1 s by 2 rad about the third axis.
    near([x, y, z], [0.0, 0.0, 1f64.sin()], 1e-13);
    equal(w, 1f64.cos(), 1e-13);
}

/// Two bodies in self-gravity with G = 1 on an orbit of eccentricity 1/2, which they start at its far end.
fn orbit(steps_per_period: u64) -> (Case, f64) {
    let mut case = Case::new();
    case.options.self_gravity = true;
    case.options.gravity_constant = 1.0;
    // Masses 3 and 1 kg, far smaller than their distance.
    let density = |mass: f64| mass / (4.0 / 3.0 * PI * 1e-9);
    let heavy = case.sphere_of(density(3.0), 1e-3, [-0.375, 0.0, 0.0]);
    let light = case.sphere_of(density(1.0), 1e-3, [1.125, 0.0, 0.0]);
    // a = 1, far end at 1.5: v^2 = G M (2/1.5 - 1) = 4/3.
    let v = (4.0f64 / 3.0).sqrt();
    case.launch(heavy, [0.0, -0.25 * v, 0.0], [0.0; 3]);
    case.launch(light, [0.0, 0.75 * v, 0.0], [0.0; 3]);
    let period = 2.0 * PI / 2.0; // sqrt(a^3 / G M), G M = 4
    case.options.dt = period / steps_per_period as f64;
    (case, period)
}

#[test]
fn an_orbit_keeps_momentum_and_its_energy_stays_near() {
    let worst = |steps: u64| {
        let (mut case, _) = orbit(steps);
        let states = case.states(100 * steps, steps * 5 / 4); // at every quarter of the orbit in turn
        let (first, energy) = (&states[0], states[0].kinetic() + states[0].potential());
        let mut worst: f64 = 0.0;
        for state in &states {
            // Round-off of up to 40 000 steps, as a random walk: 200 x 1e-16 of m |v|; ten times that allowed.
            near(state.momentum(), first.momentum(), 2e-13 * first.momentum_scale());
            near(state.angular_momentum(), first.angular_momentum(), 2e-13 * first.angular_momentum().norm());
            worst = worst.max((state.kinetic() + state.potential() - energy).abs() / energy.abs());
        }
        worst
    };
    let (coarse, fine) = (worst(100), worst(200));
    // Second order: a quarter at half the step, within a fifth for the next order; and no drift over 100 periods.
    assert!(coarse < 0.05, "{coarse}");
    assert!((3.2..4.8).contains(&(coarse / fine)), "{coarse} {fine}");
}

/// The row `step` of ERRORS.csv.
fn error_of_the_step(case: &Case) -> f64 {
    let text = std::fs::read_to_string(case.path().join("ERRORS.csv")).unwrap();
    assert!(!text.contains("-0e0"), "{text}");
    text.lines().find_map(|line| line.strip_prefix("step,dt,")?.split(',').next()?.parse().ok()).unwrap()
}

/// A factor of 3 is what estimates are measured by.
#[track_caller]
fn estimates(found: f64, error: f64) {
    assert!((error / 3.0..3.0 * error).contains(&found), "{found:e} for {error:e}");
}

#[test]
fn a_run_in_flight_reports_the_error_of_its_step() {
    let bodies = |dt: f64, speed: f64| {
        let mut case = Case::new();
        (case.options.self_gravity, case.options.gravity_constant, case.options.dt) = (true, 1.0, dt);
        for side in [-0.5, 0.5] {
            let body = case.sphere_of(0.75 / PI * 1e9, 1e-3, [side, 0.0, 0.0]); // 1 kg
            case.launch(body, [0.0, side * speed, 0.0], [0.0; 3]);
        }
        case
    };
    // On a circle of 1 m across, G m²/d = 1 J: what kinetic energy wavers by, as a share of it.
    for steps in [8, 16, 50] {
        let mut case = bodies(2.0 * PI / 2f64.sqrt() / steps as f64, 2f64.sqrt());
        case.run(10 * steps);
        let kinetic = case.column("kinetic_energy");
        let [least, most] = [f64::min, f64::max].map(|of| kinetic.iter().copied().reduce(of).unwrap());
        estimates(error_of_the_step(&case), most - least);
    }
    // Falling together from rest for nine tenths of the time that it takes: against the same in steps of a hundredth.
    for steps in [10, 30] {
        let fallen = |finer: u64| {
            let mut case = bodies(0.9 * PI / 4.0 / (steps * finer) as f64, 0.0);
            let end = case.run(steps * finer);
            let kinetic: Vec<f64> = case.column("kinetic_energy").into_iter().skip(finer as usize - 1).collect();
            let kinetic: Vec<f64> = kinetic.into_iter().step_by(finer as usize).skip(steps as usize / 2).collect();
            (kinetic, end.potential().abs(), error_of_the_step(&case))
        };
        let ((coarse, _, found), (fine, scale, _)) = (fallen(1), fallen(100));
        let away = coarse.iter().zip(&fine).map(|(a, b)| a - b).sum::<f64>() / coarse.len() as f64;
        estimates(found, away.abs() / scale);
    }
    // What is exact has none, but for rounding.
    let mut thrown = Case::new();
    thrown.gravity = [0.0, 0.0, -8.0];
    let stone = thrown.sphere(0.5, [0.0; 3]);
    thrown.launch(stone, [1.0, 0.0, 8.0], [0.0; 3]);
    thrown.run(1000);
    assert!(error_of_the_step(&thrown) < 1e-20);
}

#[test]
fn an_orbit_closes_to_second_order() {
    let miss = |steps: u64| {
        let (mut case, _) = orbit(steps);
        (case.run(steps).x(1) - Vec3::x() * 1.125).norm()
    };
    let misses = [500, 1000, 2000].map(miss);
    for pair in misses.windows(2) {
        let ratio = pair[0] / pair[1];
        assert!((3.8..4.2).contains(&ratio), "{misses:?}"); // 4, and the next order
    }
    assert!(misses[2] < 1e-4, "{misses:?}");
}

#[test]
fn a_cold_uniform_ball_falls_in_free_fall_time() {
    // Specks on a shaken lattice in a ball of radius 1: too small to meet.
    let mut case = Case::new();
    case.options.self_gravity = true;
    case.options.gravity_constant = 1.0;
    let mut random = uniform(5);
    let cell = (4.0 / 3.0 * PI / 300.0f64).cbrt();
    let mut count = 0;
    for k in 0..1000 {
        let at = [k % 10, k / 10 % 10, k / 100].map(|c| cell * (f64::from(c) - 4.5 + 0.02 * (random() - 0.5)));
        if Vec3::from(at).norm() < 1.0 {
            case.sphere_of(1e9, 1e-6, at);
            count += 1;
        }
    }
    let mass = f64::from(count) * 1e9 * 4.0 / 3.0 * PI * 1e-18;
    let density = mass / (f64::from(count) * cell.powi(3));
    let t_ff = (3.0 * PI / (32.0 * density)).sqrt();
    case.options.dt = t_ff / 500.0;
    let states = case.states(350, 50);
    let size = |state: &Snapshot| state.free().iter().map(|&i| state.x(i).norm_squared()).sum::<f64>().sqrt();
    for state in &states {
        // R = R0 cos^2 b, b + sin(2b)/2 = (pi/2) t/t_ff, by bisection.
        let target = 0.5 * PI * state.meta.time / t_ff;
        let (mut low, mut high) = (0.0, 0.5 * PI);
        for _ in 0..60 {
            let b: f64 = 0.5 * (low + high);
            if b + 0.5 * (2.0 * b).sin() < target { low = b } else { high = b }
        }
        // N points attract by about 1.5 N^(-2/3) less than a continuum, 3 % of the fall so far; 5 % allowed.
        let (found, expected) = (size(state) / size(&states[0]), low.cos().powi(2));
        equal(found, expected, 0.05 * (1.0 - expected) + 1e-12);
        assert!(found >= expected - 1e-12, "points attract by less than a continuum");
    }
}

#[test]
fn events_come_at_their_time() {
    let mut case = Case::new();
    case.options.dt = 0.1;
    for k in 0..3 {
        case.sphere(0.25, [f64::from(k), 0.0, 0.0]);
    }
    case.event(1.0, EventAction::AddVelocity([0.0, 2.0, 0.0]));
    case.event(2.0, EventAction::AddSpin([0.0, 0.0, 0.5]));
    case.event(2.0, EventAction::AddVelocity([0.0, -2.0, 0.0]));
    case.event(3.0, EventAction::SetGravity([0.0, 0.0, -1.0]));
    case.event(4.0, EventAction::SetGravity([0.0; 3]));
    case.event(4.0, EventAction::SetQuench(0.5));
    case.event(4.5, EventAction::SetQuench(0.0));
    let states = case.states(50, 1);
    // The step that begins at the event's time is the first that knows of it, and it moves by half a step at once.
    near(states[10].x(0), [0.0; 3], 0.0);
    near(states[10].v(0), [0.0; 3], 0.0);
    near(states[11].v(0), [0.0, 2.0, 0.0], 0.0);
    near(states[20].x(2), [2.0, 2.0, 0.0], 1e-14);
    // The velocities of a turn about the middle sphere.
    near(states[21].v(0), [0.0, -0.5, 0.0], 1e-15);
    near(states[21].v(1), [0.0; 3], 1e-15);
    near(states[21].v(2), [0.0, 0.5, 0.0], 1e-15);
    near(states[21].w(1), [0.0, 0.0, 0.5], 0.0);
    near(states[30].v(1), [0.0; 3], 1e-15);
    near(states[40].v(1), [0.0, 0.0, -1.0], 1e-14); // a second of it
    near(states[45].v(1), [0.0, 0.0, -1.0 / 32.0], 1e-15); // five halvings
    near(states[50].v(1), [0.0, 0.0, -1.0 / 32.0], 1e-15);
    equal(states[50].meta.parameters.events_done as f64, 7.0, 0.0);
}

#[test]
fn a_constant_torque_spins_the_whole_up_at_a_constant_rate() {
    let mut case = Case::new();
    case.options.dt = 0.1;
    for k in 0..3 {
        case.sphere(0.25, [f64::from(k), 0.0, 0.0]);
    }
    case.event(1.0, EventAction::SetTorque([0.0, 0.0, 2.0]));
    case.event(2.0, EventAction::SetTorque([0.0; 3]));
    let states = case.states(30, 1);
    // Two spheres at a distance of 1, and the moments of three; the ends move apart a little while they turn.
    let (mass, moment) = (states[0].mass(0), states[0].bodies.body_inertia[0][0]);
    let inertia = 2.0 * mass + 3.0 * moment;
    near(states[11].w(1), [0.0, 0.0, 0.2 / inertia], 1e-15);
    near(states[11].v(2), [0.0, 0.2 / inertia, 0.0], 1e-15);
    let momentum = |state: &Snapshot| -> Vec3 {
        (0..3).map(|k| state.x(k).cross(&(state.v(k) * mass)) + state.w(k) * moment).sum()
    };
    near(momentum(&states[10]), [0.0; 3], 0.0);
    near(momentum(&states[20]), [0.0, 0.0, 2.0], 1e-14); // a second of 2 N m
    near(momentum(&states[30]), [0.0, 0.0, 2.0], 1e-14);
}

#[test]
fn repeated_events_come_at_each_of_their_times() {
    let mut case = Case::new();
    case.options.dt = 0.1;
    let ball = case.sphere(0.25, [0.0; 3]);
    let action = EventAction::AddVelocity([1.0, 0.0, 0.0]);
    case.options.events.push(Event { time: 0.5, every: Some(0.3), until: Some(1.4), action });
    let states = case.states(30, 1);
    let speeds: Vec<f64> = [5, 6, 9, 12, 15, 30].iter().map(|k| states[*k].v(ball).x).collect();
    assert_eq!(speeds, [0.0, 1.0, 2.0, 3.0, 4.0, 4.0]);
}

#[test]
fn shaking_adds_energy_and_no_momentum() {
    let shaken = |seed, period: Option<f64>| {
        let mut case = Case::new();
        case.options.dt = 0.1;
        case.options.xperiode = period;
        for k in 0..1000 {
            let place = [k / 100, k / 10 % 10, k % 10].map(|step| 1.5 * f64::from(step));
            let body = case.sphere(if k % 2 == 0 { 0.5 } else { 0.25 }, place);
            case.launch(body, [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]);
        }
        let action = EventAction::Shake { speed: 1e-3, seed };
        case.options.events.push(Event { time: 0.0, every: Some(0.2), until: None, action });
        case.states(4, 1)
    };
    let states = shaken(0, None);
    let kick = |from: usize, states: &[Snapshot]| -> Vec<Vec3> {
        (0..1000).map(|k| states[from + 1].v(k) - states[from].v(k)).collect()
    };
    let first = kick(0, &states);
    let mean_square = |kick: &[Vec3]| kick.iter().map(|v| v.norm_squared()).sum::<f64>() / kick.len() as f64;
    // Of a ball, the squares of distances have a standard deviation of 0.44 of their mean; five standard errors of 1000.
    equal(mean_square(&first), 1e-6, 5.0 * 0.44e-6 / 1000f64.sqrt());
    assert!(
        first.iter().all(|v| v.norm() < 1.3e-3 * 1.1),
        "none is faster than the ball's radius, but for what is shared"
    );
    let momentum = |k: usize| states[k].momentum();
    near(momentum(1) - momentum(0), [0.0; 3], 1e-10); // round-off of 8e5 kg m/s
    let angular = |state: &Snapshot| -> Vec3 {
        (0..1000)
            .map(|k| {
                let moment = state.w(k) * state.bodies.body_inertia[k][0];
                state.x(k).cross(&(state.v(k) * state.mass(k))) + moment
            })
            .sum()
    };
    near(angular(&states[1]) - angular(&states[0]), [0.0; 3], 1e-8); // the same, some 10 m out
    // Between two no one moves another; each draws anew, and so does another seed.
    assert_eq!(mean_square(&kick(1, &states)), 0.0);
    let unlike = |a: &[Vec3], b: &[Vec3]| {
        let both: f64 = a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>() / 1e-3;
        assert!(both.abs() < 5.0 / 3000f64.sqrt(), "{both}"); // independent: five standard errors
    };
    unlike(&first, &kick(2, &states));
    unlike(&first, &kick(0, &shaken(1, None)));
    // Booked as energy from outside.
    equal(states[4].kinetic(), states[0].kinetic() + states[4].meta.ledger.outside_work, 1e-12 * states[0].kinetic());
    // Where the scene repeats, none is turned.
    let states = shaken(0, Some(15.0));
    near(states[1].momentum() - states[0].momentum(), [0.0; 3], 1e-10);
    assert!((0..1000).all(|k| states[1].w(k) == Vec3::zeros()));
}

#[test]
fn quench_takes_its_share_at_every_step() {
    let mut case = Case::new();
    case.options.quench = 0.25;
    let ball = case.sphere(0.5, [0.0; 3]);
    case.launch(ball, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
    let end = case.run(10);
    near(end.v(ball), [0.75f64.powi(10), 0.0, 0.0], 1e-16);
    near(end.w(ball), [0.0, 0.75f64.powi(10), 0.0], 1e-16);
    // What it took is booked: kinetic energy is what there was and what came from outside.
    let start = 0.5 * end.mass(0) + 0.5 * end.bodies.body_inertia[0][0];
    equal(end.kinetic(), start + end.meta.ledger.outside_work, 1e-15);
    near(end.momentum(), end.meta.ledger.momentum_expected, 1e-15);
}
