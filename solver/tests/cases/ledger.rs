//! Figures of a step in `steps.csv` and in the ledger, as closed forms.

use cd_formats::compute::ContactSolver;
use cd_formats::drv_dof::Evolution;

use crate::case::{AXES, Case, Figures, equal, near, uniform};
use crate::constrained_rotation::impose;

/// Length of a step, s.
const H: f64 = 1.0 / 64.0;

/// Uniform gravity, m/s².
const G: f64 = 8.0;

fn scene(gravity: f64) -> Case {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -gravity];
    case.options.dt = H;
    case
}

#[test]
fn forces_do_work_and_count_in_the_error_of_flight() {
    let mut case = scene(G);
    case.floor();
    // The second is in contact and not in flight.
    let [flying, resting] = [[0.0, 0.0, 64.0], [8.0, 0.0, 0.5]].map(|x| case.sphere(0.5, x));
    case.pull(flying, 0, 3.0);
    case.pull(flying, 4, 0.25);
    case.pull(resting, 2, -2.0);
    let end = case.run(16);
    let (m, i) = (end.mass(flying), end.bodies.body_inertia[flying][0]);
    let energy = 0.5 * (m * end.v(flying).x.powi(2) + i * end.w(flying).y.powi(2));
    equal(end.meta.ledger.outside_work / energy, 1.0, 1e-12);
    let errors = case.column("flight_error");
    assert_eq!(errors.len(), 16);
    errors.iter().for_each(|found| equal(found / (0.25 * m * (H * 3.0 / m).powi(2)), 1.0, 1e-12));
}

#[test]
fn drift_of_the_momentum_is_relative_to_that_of_free_bodies() {
    let mut case = scene(0.0);
    let free = case.sphere(0.5, [0.0; 3]);
    case.launch(free, [3.0, 0.0, 0.0], [0.0; 3]);
    let guided = case.sphere(0.5, [0.0, 8.0, 0.0]);
    case.launch(guided, [16.0, 0.0, 0.0], [0.0; 3]);
    impose(&mut case, guided, 4, Evolution::constant(0.0));
    case.pull(guided, 1, 2.0);
    let end = case.run(4);
    let m = end.mass(free);
    equal(end.meta.ledger.momentum_scale / (3.0 * m), 1.0, 1e-15);
    let speed = 4.0 * H * 2.0 / m;
    equal(case.column("kinetic_energy")[3] / (0.5 * m * (9.0 + 256.0 + speed * speed)), 1.0, 1e-14);
    assert_eq!(case.column("momentum_drift"), [0.0; 4]);
    // Bodies at rest: the impulse of gravity in a step.
    let mut case = scene(G);
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.5]);
    let end = case.run(4);
    equal(end.meta.ledger.momentum_scale / (m * G * H), 1.0, 1e-15);
    // Without momentum there is no drift.
    let mut case = scene(0.0);
    case.sphere(0.5, [0.0; 3]);
    case.run(1);
    assert_eq!(case.column("momentum_drift"), [0.0]);
    // Collisions of heavy bodies: rounding, and no more.
    let mut case = scene(G);
    case.materials[0].density = 1e9;
    case.tub(1.5);
    let mut random = uniform(1);
    for k in 0..8 {
        let [x, y, z] = [0, 1, 2].map(|axis| 1.25 * f64::from(k >> axis & 1));
        let body = case.sphere(0.5, [x - 0.625, y - 0.625, z + 1.0]);
        case.launch(body, [0; 3].map(|_| random() - 0.5), [0.0; 3]);
    }
    case.run(64);
    let drift = case.column("momentum_drift");
    assert!(drift.iter().any(|x| *x > 0.0) && drift.iter().all(|x| *x < 1e-13), "{drift:?}");
}

#[test]
fn penetrations_are_relative_to_the_mean_radius() {
    let mut case = scene(G);
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.5 - 1.0 / 128.0]);
    case.sphere(0.5, [2.0, 0.0, 0.5 - 1.0 / 64.0]);
    let end = case.run(1);
    equal(end.meta.ledger.penetration_largest, 1.0 / 32.0, 1e-14);
    equal(case.column("penetration_largest")[0], 1.0 / 32.0, 1e-14);
    equal(case.column("penetration_mean")[0], 3.0 / 128.0, 1e-14);
}

/// Stacks of four spheres of this radius on a floor, solved by one sweep in each step.
fn unsolved_stacks(count: usize, radius: f64) -> Case {
    let mut case = scene(G * radius);
    case.floor();
    let positions =
        (0..count).flat_map(|k| (0..4).map(move |level| [8.0 * k as f64, 0.0, 1.0 + 2.0 * f64::from(level)]));
    positions.for_each(|x| _ = case.sphere(radius, x.map(|c| c * radius)));
    (case.options.solver, case.options.max_sweeps) = (ContactSolver::Nlgs, Some(1));
    case
}

#[test]
fn unconverged_steps_are_counted_with_what_they_leave() {
    let mut case = unsolved_stacks(1, 1.0);
    let one = case.run(4).meta.ledger;
    assert_eq!((one.steps_unconverged, one.last_unconverged, one.sweeps), (4, Some(4), 4));
    assert!(one.penetration_left > 0.0, "{}", one.penetration_left);
    // The mean over the contacts, divided by the radius.
    for (count, radius) in [(2, 1.0), (1, 0.5)] {
        let other = unsolved_stacks(count, radius).run(4).meta.ledger;
        equal(other.penetration_left / one.penetration_left, 1.0, 1e-12);
    }
}

/// A ball that is thrown at the floor closes its gap before the middle of the first step, which is taken with θ = 1.
#[test]
fn energy_closes_in_a_step_with_another_theta() {
    let mut case = scene(G);
    case.floor();
    let body = case.sphere(0.5, [0.0, 0.0, 0.5625]);
    case.launch(body, [0.0, 0.0, -16.0], [0.0; 3]);
    let end = case.run(1);
    let ledger = &end.meta.ledger;
    // The longer displacement, (1 - θ) h (V⁺ - V), times the weight.
    let expected = 0.5 * H * (end.v(body).z + 16.0) * end.mass(body) * G;
    equal(ledger.outside_work / expected, 1.0, 1e-12);
    let missing = end.kinetic() + end.potential() - ledger.energy_start - ledger.contact_work - ledger.outside_work;
    equal(missing / ledger.energy_start, 0.0, 1e-14);
}

/// A plate that comes down on a ball on the floor, which no impulse can open: `auto` tries other solvers after its sweeps, and
/// for a while no more once these have failed.
#[test]
fn steps_in_which_other_solvers_are_not_tried_again_are_counted() {
    let skipped = |solver: ContactSolver, speed: f64| {
        let mut case = scene(G);
        case.floor();
        case.sphere(0.5, [0.0, 0.0, 0.5]);
        let plate = case.plate([4.0, 4.0, 0.5], [0.0, 0.0, 1.5], AXES);
        case.drive_along(plate, 2, Evolution::constant(-speed));
        (case.options.solver, case.options.tol, case.options.max_sweeps) = (solver, Some(1e-9), Some(1100));
        case.options.steps = Some(4);
        case.write();
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        text.lines()
            .find_map(|line| line.trim_start().strip_prefix("fallback skipped"))
            .map(|line| line.trim().to_string())
    };
    let found = skipped(ContactSolver::Auto, 0.0625);
    assert!(found.as_ref().is_some_and(|line| line.contains("ended after one round of sweeps")), "{found:?}");
    assert_eq!(skipped(ContactSolver::Nlgs, 0.0625), None);
    assert_eq!(skipped(ContactSolver::Auto, 0.0), None);
}

#[test]
fn two_spheres_that_are_pressed_together_have_the_virial_of_their_force() {
    let mut case = scene(0.0);
    for (x, force) in [(-0.5, 3.0), (0.5, -3.0)] {
        let body = case.sphere(0.5, [x, 0.0, 0.0]);
        case.pull(body, 0, force);
    }
    case.run(2);
    // 3 N over a distance of 1 m.
    let virials = case.column("virial");
    assert_eq!(virials.len(), 2);
    virials.iter().for_each(|virial| equal(*virial, 3.0, 1e-9));
}

#[test]
fn torques_of_gravity_and_of_the_floor_cancel() {
    let mut case = scene(G);
    case.floor();
    let body = case.sphere(0.5, [8.0, 4.0, 0.5]);
    let end = case.run(4);
    let torque = end.mass(body) * G * 8.0;
    near(end.meta.ledger.angular_momentum_expected, [0.0; 3], 1e-12 * torque * 4.0 * H);
}

#[test]
fn a_snapshot_between_outputs_has_the_start_of_its_interval() {
    let mut case = scene(0.0);
    case.sphere(0.5, [0.0; 3]);
    let states = case.states(6, 4);
    let starts: Vec<Option<f64>> = states.iter().map(|state| state.meta.interval_start).collect();
    assert_eq!(states.last().unwrap().meta.step, 6);
    assert_eq!(starts.last(), Some(&Some(4.0 * H)), "{starts:?}");
}

#[test]
fn norms_of_lmgc90_are_written_only_with_their_option() {
    for lmgc90_norms in [false, true] {
        let mut case = scene(G);
        case.floor();
        case.sphere(0.5, [0.0, 0.0, 0.5]);
        case.options.lmgc90_norms = lmgc90_norms;
        case.run(2);
        let header = std::fs::read_to_string(case.path().join("OUTBOX/steps.csv")).unwrap();
        assert_eq!(header.lines().next().unwrap().contains("quad_dv,"), lmgc90_norms);
        if lmgc90_norms {
            // Solved to a tolerance of 1e-12.
            let norms = case.column("quad_dv");
            assert!(norms.len() == 2 && norms.iter().all(|norm| *norm < 1e-9), "{norms:?}");
        }
    }
}
