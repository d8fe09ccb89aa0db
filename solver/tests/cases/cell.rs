//! Cells with three periods that deform: kinematics, invariance, balances, servos.

use cd_formats::compute::Compute;
use cd_formats::deforming_cell::{AxisControl, CellControl};
use cd_formats::snapshot::Snapshot;

use crate::case::{Case, Figures, Vec3, equal, near, shaken_lattice, uniform};

/// A cell that closes along x, opens along z and shears.
const MIXED: CellControl = CellControl {
    x: AxisControl::Rate(-0.25),
    y: AxisControl::Rate(0.0),
    z: AxisControl::Rate(0.125),
    shear_xy: 0.0,
    shear_xz: 1.5,
    shear_yz: -0.5,
};

/// A cube with the side `side` that deforms, without bodies.
fn cube(side: f64, control: CellControl) -> Case {
    let mut case = Case::new();
    let side = Some(side);
    (case.options.xperiode, case.options.yperiode, case.options.zperiode) = (side, side, side);
    (case.options.cell, case.options.dt) = (Some(control), 0.00390625);
    case
}

/// A gas of spheres in a cube that deforms, all of it moved by `to`.
fn gas(control: CellControl, law: (&str, &[f64]), to: [f64; 3]) -> Case {
    let mut case = cube(3.75, control);
    case.law(law.0, law.1);
    let mut random = uniform(11);
    for (radius, x) in shaken_lattice(3, 9) {
        let x = x.map(|c| (c * 1024.0).round() / 1024.0);
        let body = case.sphere((radius * 64.0).floor() / 64.0, [0, 1, 2].map(|k| x[k] + to[k]));
        case.launch(body, [0; 3].map(|_| 4.0 * random() - 2.0), [0; 3].map(|_| random()));
    }
    case.options.tol = Some(1e-11);
    case
}

/// Velocities about the affine field.
fn fluctuations(state: &Snapshot) -> Vec<Vec3> {
    let cell = state.meta.cell.unwrap();
    state.free().iter().map(|&i| cell.fluctuation(&state.x(i), &state.v(i))).collect()
}

#[test]
fn the_cell_has_the_strains_of_its_rates() {
    let mut case = cube(4.0, MIXED);
    case.law("IQS_CLB", &[0.0]);
    let [a, b] = [[-1.0, 0.25, 0.5], [1.0, 0.5, -0.5]].map(|x| case.sphere(0.125, x));
    let v = [0.0, 0.03125, -0.0625];
    case.launch(a, v, [0.0; 3]);
    case.launch(b, v, [0.0; 3]);
    let (steps, dt) = (512, case.options.dt);
    let end = case.run(steps);
    let (cell, t) = (end.meta.cell.unwrap(), steps as f64 * dt);
    // H⁺ is the mean of two contact configurations: its strain errs by (rate h)²/8.
    for (strain, rate) in cell.log_strains().into_iter().zip([-0.25, 0.0, 0.125]) {
        equal(strain, rate * t, 1e-6);
    }
    for (strain, rate) in cell.shear_strains.into_iter().zip([0.0, 1.5, -0.5]) {
        equal(strain, rate * t, 1e-12);
    }
    let [l_x, l_y, _] = cell.periods;
    assert!(cell.shears[1].abs() <= 0.5 * l_x && cell.shears[2].abs() <= 0.5 * l_y);
    // Free flight about the affine field: dv'/dt = -L v', components from z to x. Second order in h.
    let [v_y, v_z] = [v[1], v[2]];
    let z = v_z * (-0.125 * t).exp();
    let y = v_y + 0.5 * v_z * (1.0 - (-0.125 * t).exp()) / 0.125;
    for fluctuation in fluctuations(&end) {
        equal(fluctuation.z, z, 1e-5 * v_z.abs());
        equal(fluctuation.y, y, 1e-5 * v_z.abs());
    }
}

/// Bodies have no preferred image: a cell that is moved, by parts of edges or by several, has the same motion about its
/// affine field, also while the rates of the edges change.
#[test]
fn a_deforming_cell_is_the_same_wherever_its_border_is() {
    let law: (&str, &[f64]) = ("RST_CLB", &[0.75, 0.0, 0.25]);
    let expected = fluctuations(&gas(MIXED, law, [0.0; 3]).run(96));
    for to in [[0.0, 0.0, 1.875], [1.0, -1.5, 2.0], [0.0, 7.5, -15.0]] {
        let found = fluctuations(&gas(MIXED, law, to).run(96));
        // Digits of positions up to 16 and solutions to 1e-11, which every impact magnifies.
        found.into_iter().zip(&expected).for_each(|(a, b)| near(a, *b, 1e-6));
    }
    let at_rest = fluctuations(&gas(CellControl::default(), law, [0.0; 3]).run(96));
    assert!(at_rest.iter().zip(&expected).any(|(a, b)| (a - b).norm() > 1e-2));
}

/// A cell at rest is the periodic scene, to the last bit.
#[test]
fn a_cell_at_rest_changes_nothing() {
    let law: (&str, &[f64]) = ("IQS_CLB", &[0.5]);
    let with_cell = gas(CellControl::default(), law, [0.5, 0.0, 1.5]).run(96);
    let mut case = gas(CellControl::default(), law, [0.5, 0.0, 1.5]);
    case.options.cell = None;
    let without = case.run(96);
    assert_eq!(with_cell.bodies.body_x, without.bodies.body_x);
    assert_eq!(with_cell.bodies.body_v, without.bodies.body_v);
    assert!(without.meta.cell.is_none());
}

/// The work of the cell closes the balance of energy, and momentum is that of the ledger.
#[test]
fn the_work_of_the_cell_closes_the_balances() {
    for (control, conserves_momentum) in
        [(MIXED, false), (CellControl { shear_xz: 2.0, ..CellControl::default() }, true)]
    {
        let states = gas(control, ("IQS_CLB", &[0.5]), [0.0; 3]).states(192, 192);
        let (start, end) = (&states[0], &states[1]);
        let ledger = &end.meta.ledger;
        let scale = start.kinetic() + ledger.outside_work.abs();
        assert!(ledger.outside_work.abs() > 1e-2 * start.kinetic(), "the cell works");
        // Solutions to 1e-11.
        equal(end.kinetic(), start.kinetic() + ledger.contact_work + ledger.outside_work, 1e-11 * scale);
        let expected = Vec3::from(ledger.momentum_expected);
        // Rounding of 192 steps.
        assert!((end.momentum() - expected).norm() < 1e-12 * ledger.momentum_scale);
        let is_conserved = (end.momentum() - start.momentum()).norm() < 1e-12 * ledger.momentum_scale;
        assert_eq!(is_conserved, conserves_momentum);
        let expected = Vec3::from(ledger.angular_momentum_expected);
        // Momenta to 1e-11 at arms of less than 10 m.
        assert!((end.angular_momentum() - expected).norm() < 1e-10 * ledger.momentum_scale);
    }
}

/// No pair is missed while the cell deforms: bodies that overlap at the end of a step, in any image, overlap by the errors of
/// solutions only.
#[test]
fn no_image_is_missed() {
    let control = CellControl { shear_xz: 4.0, shear_xy: -1.0, x: AxisControl::Rate(-0.25), ..CellControl::default() };
    let mut case = gas(control, ("IQS_CLB", &[0.25]), [0.0; 3]);
    // Contacts are detected where bodies are.
    (case.options.theta, case.options.dt, case.options.tol) = (1.0, 0.001953125, Some(1e-8));
    let side = Some(3.40625);
    (case.options.xperiode, case.options.yperiode, case.options.zperiode) = (side, side, side);
    let states = case.states(256, 4);
    let mut carrying = 0;
    for state in &states[1..] {
        let (cell, free) = (state.meta.cell.unwrap().cell(), state.free());
        carrying += state.contacts.contact_impulse.iter().filter(|impulse| impulse[0] > 0.0).count();
        for (k, &i) in free.iter().enumerate() {
            for &j in &free[..k] {
                let d = state.x(i) - state.x(j);
                let gap =
                    (d - cell.nearest_shift(&d)).norm() - state.bodies.body_radius[i] - state.bodies.body_radius[j];
                assert!(gap > -1e-4, "step {}: {i} {j}: {gap}", state.meta.step);
            }
        }
    }
    assert!(carrying > 20, "{carrying}");
}

#[test]
fn threads_and_resume_change_nothing_in_a_deforming_cell() {
    let servo = AxisControl::Stress { value: 2.0, gain: 0.5, average: 0.0625, max_rate: None };
    let control = CellControl { x: servo, z: servo, shear_xz: 2.0, ..CellControl::default() };
    let run = |flags: &[&[&str]]| {
        let mut case = gas(control, ("IQS_CLB", &[0.5]), [1.0, -1.0, 1.5]);
        (case.options.steps, case.options.output_every, case.options.tol) = (Some(60), 30, Some(1e-6));
        case.write();
        flags.iter().for_each(|flags| assert_eq!(case.solve(flags), 0));
        case.last().to_bytes()
    };
    let first = run(&[&["--threads", "1"]]);
    assert!(first == run(&[&["--threads", "3"]]));
    assert!(first == run(&[&["--threads", "2", "--steps", "30"], &["--resume", "--steps", "60"]]));
}

/// A servo brings the mean stress to its value: the cell of a gas that collides without losses closes until the pressure of
/// the motion, which grows as it is compressed, balances it.
#[test]
fn a_servo_holds_the_stress() {
    let servo = AxisControl::Stress { value: 20.0, gain: 1.0, average: 0.25, max_rate: None };
    let control = CellControl { x: servo, y: servo, z: servo, ..CellControl::default() };
    let mut case = gas(control, ("RST_CLB", &[1.0, 0.0, 0.0]), [0.0; 3]);
    case.options.tol = Some(1e-8);
    let states = case.states(2048, 32);
    let late = &states[32..];
    let mean = late.iter().map(|state| state.meta.cell.unwrap().mean_stress.iter().sum::<f64>() / 3.0).sum::<f64>()
        / late.len() as f64;
    // 27 spheres: the stress of an interval of 0.25 s scatters by half of its value, the mean over 4 s by less than a tenth.
    equal(mean, 20.0, 2.0);
    let volume = |state: &Snapshot| state.meta.cell.unwrap().periods.iter().product::<f64>();
    assert!(volume(&states[states.len() - 1]) < 0.9 * volume(&states[0]));
}

/// Solid fraction of 125 equal spheres with the coefficient `friction` that a gas leaves when a cell closes on it until 100 Pa
/// hold it, and the mean number of contacts of those with `stable` or more. The springs of the contacts yield by 5·10⁻⁴ of
/// a diameter.
fn compacted_spheres(friction: f64, stable: i32) -> (f64, f64) {
    let servo = AxisControl::Stress { value: 100.0, gain: 0.2, average: 0.0, max_rate: None };
    let mut case = cube(6.25, CellControl { x: servo, y: servo, z: servo, ..CellControl::default() });
    case.law("ELASTIC_REPELL_CLB", &[2e5, friction]);
    let mut random = uniform(3);
    for (_, x) in shaken_lattice(5, 3) {
        // Gaps of the lattice, less what its sites are moved by: spheres of at most 0.5 never overlap.
        let body = case.sphere(0.5, x.map(|c| 1.25 / 1.1 * c));
        case.launch(body, [0; 3].map(|_| 2.0 * random() - 1.0), [0.0; 3]);
    }
    (case.options.dt, case.options.tol) = (0.001, None);
    let end = case.run(6000);
    let volume = end.meta.cell.unwrap().periods.iter().product::<f64>();
    let mut touching = end.contacts.contact_body.clone();
    let carries = |k: usize| end.contacts.contact_impulse[k][0] > 0.0;
    touching = (0..touching.len()).filter(|&k| carries(k)).map(|k| touching[k]).collect();
    loop {
        let mut neighbours = [0; 125];
        touching.iter().flatten().for_each(|&body| neighbours[body as usize] += 1);
        let count = touching.len();
        touching.retain(|pair| pair.iter().all(|&body| neighbours[body as usize] >= stable));
        if touching.len() == count {
            let held = neighbours.iter().filter(|&&contacts| contacts >= stable).count();
            return (125.0 * std::f64::consts::PI / 6.0 / volume, 2.0 * count as f64 / held as f64);
        }
    }
}

/// A closing cell compacts spheres without friction to random close packing, 0.635 to 0.64, where they are isostatic, Z = 6 [C.S.
/// O'Hern et al., Phys. Rev. E 68 (2003) 011306], and spheres with friction less, to some 0.58 and Z = 4.4 [L.E. Silbert, Soft
/// Matter 6 (2010) 2918]. Few spheres scatter by 0.01.
#[test]
fn a_closing_cell_compacts_spheres_to_random_close_packing() {
    let (nu, z) = compacted_spheres(0.0, 4);
    assert!((0.62..0.65).contains(&nu), "ν {nu}");
    // The springs close gaps of some 10⁻⁴ of a diameter besides.
    assert!((5.95..6.3).contains(&z), "Z {z}");
    let (nu, z) = compacted_spheres(0.5, 3);
    assert!((0.555..0.6).contains(&nu), "ν {nu} with friction");
    assert!((4.0..5.2).contains(&z), "Z {z} with friction");
}

/// Values and scenes that a deforming cell cannot have are rejected before the first step.
#[test]
fn unsupported_scenes_with_a_deforming_cell_are_rejected() {
    let exit_status = |change: &dyn Fn(&mut Case)| {
        let mut case = gas(MIXED, ("IQS_CLB", &[0.5]), [0.0; 3]);
        case.options.steps = Some(1);
        change(&mut case);
        case.write();
        case.solve(&[])
    };
    let option = |change: fn(&mut Compute)| exit_status(&|case: &mut Case| change(&mut case.options));
    assert_eq!(option(|_| ()), 0);
    assert_eq!(option(|options| options.zperiode = None), 2);
    assert_eq!(option(|options| options.quench = 0.1), 2);
    assert_eq!(option(|options| options.text = true), 2);
    let with_x = |x: AxisControl| exit_status(&|case: &mut Case| case.options.cell = Some(CellControl { x, ..MIXED }));
    assert_eq!(with_x(AxisControl::Rate(4.0)), 2); // 0.016 in a step
    assert_eq!(with_x(AxisControl::Rate(f64::INFINITY)), 2);
    let servo = |value, gain| AxisControl::Stress { value, gain, average: 0.0, max_rate: None };
    assert_eq!([servo(1.0, 0.5), servo(0.0, 0.5), servo(1.0, -1.0)].map(with_x), [0, 2, 2]);
    assert_eq!(exit_status(&|case: &mut Case| _ = case.floor()), 2);
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    assert_eq!(exit_status(&|case: &mut Case| _ = case.block([0.25; 3], [0.0; 3], axes)), 2);
}

/// A cell that becomes too small for its bodies ends the run.
#[test]
fn a_cell_ends_the_run_before_bodies_touch_two_images() {
    let control = CellControl { x: AxisControl::Rate(-1.0), ..CellControl::default() };
    let mut case = cube(3.0, control);
    case.law("IQS_CLB", &[0.0]);
    case.sphere(0.5, [0.0; 3]);
    case.options.steps = Some(256);
    case.write();
    assert_eq!(case.solve(&[]), 0);
    let end = case.last();
    // ln(3/2) s, up to a step.
    assert!((end.meta.time - 1.5f64.ln()).abs() <= 2.0 * case.options.dt, "{}", end.meta.time);
    assert!(end.meta.cell.unwrap().periods[0] <= 2.0);
}

/// Attraction of two images would begin earlier: at twice the diameter plus the range.
#[test]
fn a_cell_ends_the_run_before_bodies_attract_two_images() {
    let control = CellControl { x: AxisControl::Rate(-1.0), ..CellControl::default() };
    let mut case = cube(3.0, control);
    case.law("IQS_WET_DS_CLB", &[1.0, 0.0, 0.125, 0.0, 0.0]);
    case.sphere(0.5, [0.0; 3]);
    case.options.steps = Some(256);
    case.write();
    assert_eq!(case.solve(&[]), 0);
    let end = case.last();
    assert!((end.meta.time - (3.0f64 / 2.25).ln()).abs() <= 2.0 * case.options.dt, "{}", end.meta.time);
    assert!(end.meta.cell.unwrap().periods[0] <= 2.25);
}
