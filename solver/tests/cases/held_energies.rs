//! Energies and works of grains driven in part: the balance closes with the work of the reactions that impose components.

use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot::Snapshot;

use crate::case::{AXES, Case, Figures, Vec3, equal};
use crate::constrained_rotation::{OUT_OF_PLANE, hold, impose};

const G: f64 = 8.0;

fn scene(friction: f64) -> Case {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[friction]);
    case.gravity = [0.0, 0.0, -G];
    case.options.dt = 1.0 / 256.0;
    case
}

/// A rate that grows from 0.5 to 1.5 in 1 s.
fn growing() -> Evolution {
    Evolution::Table { name: "growing.dat".into(), points: vec![[0.0, 0.5], [1.0, 1.5]] }
}

/// Kinetic and potential energy of a body.
fn energy(state: &Snapshot, body: usize) -> f64 {
    let kinetic =
        state.mass(body) * state.v(body).norm_squared() + state.own_angular_momentum(body).dot(&state.w(body));
    0.5 * kinetic - state.mass(body) * Vec3::from(state.meta.parameters.uniform_gravity).dot(&state.x(body))
}

/// The energy of `bodies` is that of the ledger, to `bound` of the largest of the energies.
#[track_caller]
fn closes(state: &Snapshot, bodies: &[usize], bound: f64) {
    let ledger = &state.meta.ledger;
    let now: f64 = bodies.iter().map(|&body| energy(state, body)).sum();
    let parts = [now, ledger.energy_start, ledger.contact_work, ledger.outside_work];
    let largest = parts.iter().fold(0.0f64, |most, part| most.max(part.abs()));
    let missing = now - ledger.energy_start - ledger.contact_work - ledger.outside_work;
    assert!(missing.abs() <= bound * largest, "{missing:e} of {parts:?}");
}

#[test]
fn an_imposed_acceleration_does_its_kinetic_energy_as_work() {
    let mut case = scene(0.0);
    let body = case.block([0.5, 0.25, 0.375], [0.0; 3], AXES);
    // It falls freely along z; the turn about y is imposed, and the others are free.
    impose(&mut case, body, 4, growing());
    let end = case.run(256);
    let rate = growing().value_at(end.meta.time);
    let [_, j, _] = end.bodies.body_inertia[body];
    let work = 0.5 * j * (rate * rate - 0.25);
    equal(end.meta.ledger.outside_work / work, 1.0, 1e-12);
    closes(&end, &[body], 1e-12);
}

#[test]
fn a_roller_slips_until_half_of_the_work_of_its_drive_moves_it() {
    let mut case = scene(0.25);
    case.floor();
    let body = case.sphere(0.5, [0.0, 0.0, 0.5]);
    hold(&mut case, body, &[3, 5]);
    impose(&mut case, body, 4, Evolution::constant(4.0));
    let end = case.run(512); // it slips for v/(μ g) = 1 s
    let m = end.mass(body);
    equal(end.v(body).x, 2.0, 1e-9);
    // μ m g R ω t of work, of which half becomes m v²/2 = 2 m, and half heat.
    let ledger = &end.meta.ledger;
    equal(ledger.outside_work / (4.0 * m), 1.0, 1e-9);
    equal(ledger.friction_work / (-2.0 * m), 1.0, 1e-9);
    closes(&end, &[body], 1e-12);
}

#[test]
fn a_guided_gyroscope_takes_the_work_of_its_guide() {
    let mut case = scene(0.5);
    case.gravity = [0.0; 3];
    let body = case.block([0.5, 0.25, 0.375], [0.0; 3], AXES);
    case.launch(body, [0.0; 3], [0.0, 0.25, 0.0]);
    impose(&mut case, body, 3, Evolution::constant(2.0));
    let states = case.states(512, 64);
    let energies: Vec<f64> = states.iter().map(|state| energy(state, body)).collect();
    assert!(energies.iter().any(|e| (e - energies[0]).abs() > 1e-3 * energies[0]), "{energies:?}");
    states.iter().for_each(|state| closes(state, &[body], 1e-12));
}

#[test]
fn a_plane_problem_closes_its_balance() {
    for theta in [0.5, 0.75] {
        let mut case = scene(0.5);
        case.options.theta = theta;
        case.tub(2.0);
        let mut bodies = Vec::new();
        for (k, z) in [0.6, 1.7, 2.9, 4.2].into_iter().enumerate() {
            let x = 0.2 * k as f64 - 0.3;
            let body = match k % 2 {
                0 => case.sphere(0.5, [x, 0.0, z]),
                _ => case.block([0.5, 0.25, 0.375], [x, 0.0, z], AXES),
            };
            hold(&mut case, body, &OUT_OF_PLANE);
            bodies.push(body);
        }
        case.pull(bodies[0], 0, 0.25);
        let states = case.states(768, 96);
        // Heights change by less than the work of gravity if θ is not 1/2.
        let bound = if theta == 0.5 { 1e-10 } else { 0.02 };
        states.iter().for_each(|state| closes(state, &bodies, bound));
        let ledger = &states.last().unwrap().meta.ledger;
        assert!(ledger.contact_work < -1.0 && ledger.friction_work < -0.1, "{ledger:?}");
        let kinetic = case.column("kinetic_energy");
        assert!(kinetic.iter().all(|k| *k >= 0.0) && kinetic.iter().any(|k| *k > 0.1));
    }
}

#[test]
fn a_grain_pushed_in_part_among_free_ones() {
    let mut case = scene(0.5);
    case.tub(3.0);
    // A screw that turns about two axes of its own, and a free ball and block on it.
    let screw = case.block([0.5, 0.25, 0.375], [0.0, 0.0, 0.6], AXES);
    impose(&mut case, screw, 3, growing());
    impose(&mut case, screw, 5, Evolution::constant(-1.0));
    let ball = case.sphere(0.5, [0.1, 0.0, 1.6]);
    let block = case.block([0.5, 0.25, 0.375], [0.1, 0.2, 2.8], AXES);
    let states = case.states(768, 96);
    states.iter().for_each(|state| closes(state, &[screw, ball, block], 1e-4));
    assert!(states.last().unwrap().meta.ledger.outside_work > 0.1);
    // The momentum of the free bodies alone is known, by the forces of the screw on them.
    let last = states.last().unwrap();
    let expected = Vec3::from(last.meta.ledger.momentum_expected);
    assert!((last.momentum() - expected).norm() <= 1e-12 * last.meta.ledger.momentum_scale);
}
