//! Cells with three periods that deform: kinematics, invariance, balances, servos.

use cd_formats::bodies::{Body, ShapeRecord};
use cd_formats::compute::Compute;
use cd_formats::deforming_cell::{AxisControl, CellControl};
use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot::Snapshot;

use crate::case::{AXES, Case, Figures, Vec3, equal, expect_same_bytes, near, shaken_lattice, uniform};
use crate::clumps::{clump, dumbbell};

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

/// Adds a body in a ball of that radius about a centre.
type AddBody = fn(&mut Case, f64, [f64; 3]) -> usize;

/// A box with the edges 6 : 5 : 4 whose corners lie on the ball, along the fixed axes.
fn add_block(case: &mut Case, radius: f64, x: [f64; 3]) -> usize {
    let size = radius / 77f64.sqrt();
    case.block([6.0 * size, 5.0 * size, 4.0 * size], x, AXES)
}

/// Two balls that overlap, along y.
fn add_clump(case: &mut Case, radius: f64, x: [f64; 3]) -> usize {
    let (balls, solid) = dumbbell(0.375 * radius, 0.625 * radius);
    clump(case, &balls, &solid, x, AXES)
}

fn add_capsule(case: &mut Case, radius: f64, x: [f64; 3]) -> usize {
    let body = case.sphere(radius, x);
    let contactor = &mut case.bodies[body].contactors[0];
    contactor.shape = ShapeRecord::Capsule { half_length: 0.5 * radius, radius: 0.5 * radius };
    contactor.colour = "WALLx".into();
    body
}

/// A gas of spheres in a cube that deforms, all of it moved by `to`.
fn gas(control: CellControl, law: (&str, &[f64]), to: [f64; 3]) -> Case {
    gas_of(Case::sphere, control, law, to)
}

/// A gas of bodies in a cube that deforms, all of it moved by `to`.
fn gas_of(add_body: AddBody, control: CellControl, law: (&str, &[f64]), to: [f64; 3]) -> Case {
    let mut case = cube(3.75, control);
    case.law_of_all(law.0, law.1);
    let mut random = uniform(11);
    for (radius, x) in shaken_lattice(3, 9) {
        let x = x.map(|c| (c * 1024.0).round() / 1024.0);
        let body = add_body(&mut case, (radius * 64.0).floor() / 64.0, [0, 1, 2].map(|k| x[k] + to[k]));
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

/// Grains of any shape fly as spheres do, and the cell does not turn them: a box that spins about a principal axis keeps its
/// spin, and one that tumbles its angular momentum about its centre.
#[test]
fn bodies_of_any_shape_fly_with_the_affine_field() {
    let flight = |add_body: AddBody, spin: [f64; 3]| {
        let mut case = cube(4.0, MIXED);
        case.law_of_all("IQS_CLB", &[0.0]);
        let body = add_body(&mut case, 0.25, [-1.0, 0.25, 0.5]);
        case.launch(body, [0.0, 0.03125, -0.0625], spin);
        case.run(256)
    };
    let expected = fluctuations(&flight(Case::sphere, [0.0; 3]))[0];
    for add_body in [add_block, add_clump, add_capsule] as [AddBody; 3] {
        let end = flight(add_body, [0.0, 0.0, 2.0]);
        // Rounding of 256 steps.
        near(fluctuations(&end)[0], expected, 1e-13);
        near(end.w(0), [0.0, 0.0, 2.0], 1e-13);
    }
    let spin = Vec3::new(1.0, 2.0, 3.0);
    let end = flight(add_block, spin.into());
    let inertia = Vec3::from(end.bodies.body_inertia[0]);
    // The angular momentum is that of the start as well as without a cell: second order in h.
    near(end.own_angular_momentum(0), inertia.component_mul(&spin), 1e-4 * inertia.max());
}

/// As of spheres, the motion about the affine field does not depend on where the border is, with faces, edges and several
/// contacts of a pair.
#[test]
fn a_cell_of_any_shapes_is_the_same_wherever_its_border_is() {
    for add_body in [add_block, add_clump] as [AddBody; 2] {
        let states = [[0.0; 3], [0.0, 0.0, 1.875], [1.0, -1.5, 2.0], [0.0, 7.5, -15.0]]
            .map(|to| gas_of(add_body, MIXED, ("IQS_CLB", &[0.25]), to).run(96));
        let carrying = states[0].contacts.contact_impulse.iter().filter(|impulse| impulse[0] > 0.0).count();
        assert!(carrying > 0, "no contact at the end");
        let expected = fluctuations(&states[0]);
        for state in &states[1..] {
            // Digits of positions up to 16 and solutions to 1e-11, which impacts magnify.
            fluctuations(state).into_iter().zip(&expected).for_each(|(a, b)| near(a, *b, 1e-6));
        }
    }
}

/// The balances close with grains of any shape.
#[test]
fn the_work_of_the_cell_closes_the_balances_of_any_shapes() {
    for add_body in [add_block, add_clump] as [AddBody; 2] {
        let states = gas_of(add_body, MIXED, ("IQS_CLB", &[0.5]), [0.0; 3]).states(192, 192);
        let (start, end) = (&states[0], &states[1]);
        let ledger = &end.meta.ledger;
        let scale = start.kinetic() + ledger.outside_work.abs();
        assert!(ledger.outside_work.abs() > 1e-2 * start.kinetic(), "the cell works");
        // The θ-scheme of free rotation keeps energy to second order in h: 1e-5 in 192 steps; solutions to 1e-11.
        equal(end.kinetic(), start.kinetic() + ledger.contact_work + ledger.outside_work, 1e-5 * scale);
        // Rounding of 192 steps.
        assert!((end.momentum() - Vec3::from(ledger.momentum_expected)).norm() < 1e-12 * ledger.momentum_scale);
        let expected = Vec3::from(ledger.angular_momentum_expected);
        assert!((end.angular_momentum() - expected).norm() < 1e-5 * ledger.momentum_scale);
    }
}

/// Depth by which two boxes overlap along the direction in which they overlap least, m; < 0 if they are apart.
fn overlap(state: &Snapshot, [i, j]: [usize; 2], half: &[Vec3], between: &Vec3) -> f64 {
    let axes = [i, j].map(|body| {
        let [w, x, y, z] = state.bodies.body_q[body];
        let q = nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
        [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| q * axis)
    });
    let edges = axes[0].iter().flat_map(|a| axes[1].iter().map(|b| a.cross(b)));
    let all = axes.as_flattened().iter().copied().chain(edges).filter(|n| n.norm() > 1e-3);
    let extent = |side: usize, body: usize, n: &Vec3| -> f64 {
        (0..3).map(|k| half[body][k] * axes[side][k].dot(n).abs()).sum()
    };
    let depth = |n: Vec3| {
        let n = n.normalize();
        extent(0, i, &n) + extent(1, j, &n) - between.dot(&n).abs()
    };
    all.map(depth).fold(f64::INFINITY, f64::min)
}

/// No pair of boxes is missed while the cell deforms, in any image.
#[test]
fn no_image_of_a_box_is_missed() {
    let control = CellControl { shear_xz: 4.0, shear_xy: -1.0, x: AxisControl::Rate(-0.25), ..CellControl::default() };
    let mut case = gas_of(add_block, control, ("IQS_CLB", &[0.25]), [0.0; 3]);
    // Contacts are detected where bodies are.
    (case.options.theta, case.options.dt, case.options.tol) = (1.0, 0.001953125, Some(1e-8));
    let side = Some(3.40625);
    (case.options.xperiode, case.options.yperiode, case.options.zperiode) = (side, side, side);
    let half: Vec<Vec3> = case.bodies.iter().map(half_lengths).collect();
    let states = case.states(256, 4);
    let mut carrying = 0;
    for state in &states[1..] {
        let cell = state.meta.cell.unwrap().cell();
        carrying += state.contacts.contact_impulse.iter().filter(|impulse| impulse[0] > 0.0).count();
        for i in 0..half.len() {
            for j in 0..i {
                let d = state.x(i) - state.x(j);
                let depth = overlap(state, [i, j], &half, &(d - cell.nearest_shift(&d)));
                // Boxes that turn on each other overlap by some (w h)² of their size in a step, 1e-3 in all; a missed pair does by
                // 4e-3 in one step and more in the next.
                assert!(depth < 3e-3, "step {}: {i} {j}: {depth}", state.meta.step);
            }
        }
    }
    assert!(carrying > 20, "{carrying}");
}

/// Half lengths of a box along its axes, m.
fn half_lengths(body: &Body) -> Vec3 {
    let ShapeRecord::Polyhedron { vertices, .. } = &body.contactors[0].shape else { panic!("not a box") };
    Vec3::from(vertices[7])
}

/// Four cubes with the edge 1 fill a period that is δ shorter than they are: each of their four joints, one of them across the
/// border, has four springs that are δ/4 shorter. The stress along the period is 4 k δ/4 over the area of the cell, that
/// across it 0, and a servo that holds this stress keeps the cell.
#[test]
fn the_stress_of_a_row_of_cubes_is_that_of_its_springs() {
    let (stiffness, shortened) = (1024.0, 0.0078125);
    let mut case = cube(4.0, CellControl::default());
    case.law_of_all("ELASTIC_REPELL_CLB", &[stiffness, 0.0]);
    (case.options.dt, case.options.xperiode) = (0.00390625, Some(4.0 - shortened));
    for k in 0..4 {
        let x = f64::from(k) * (1.0 - 0.25 * shortened);
        case.block([0.5; 3], [x + 0.25, 0.5, 1.75], AXES);
    }
    let stress = 4.0 * stiffness * 0.25 * shortened / 16.0;
    let servo = AxisControl::Stress { value: stress, gain: 0.5, average: 0.0, max_rate: None };
    // The first step starts with the rate of no stress: the cell closes by some 0.002 and comes back.
    let slow = AxisControl::Stress { value: stress, gain: 1e-12, average: 0.0, max_rate: None };
    for (x, error) in [(slow, 1e-9), (servo, 1e-3)] {
        case.options.cell = Some(CellControl { x, y: slow, ..CellControl::default() });
        let end = case.run(512);
        let cell = end.meta.cell.unwrap();
        equal(cell.mean_stress[0], stress, error * stress);
        equal(cell.mean_stress[1], 0.0, 1e-9 * stress);
        equal(cell.periods[0], 4.0 - shortened, error * shortened);
    }
}

/// Icosahedron of the circumscribed radius 1: vertices and triangles.
fn icosahedron() -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let scale = (1.0 + golden * golden).sqrt().recip();
    let corner = |k: usize| {
        let (axis, signs) = (k / 4, [1.0 - 2.0 * (k & 1) as f64, 1.0 - (k & 2) as f64]);
        let mut x = [0.0; 3];
        (x[axis], x[(axis + 1) % 3]) = (signs[0] * scale, signs[1] * golden * scale);
        x
    };
    let vertices: Vec<[f64; 3]> = (0..12).map(corner).collect();
    let edge = 2.0 * scale;
    let is_edge = |i: usize, j: usize| ((Vec3::from(vertices[i]) - Vec3::from(vertices[j])).norm() - edge).abs() < 1e-9;
    let mut triangles = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                if is_edge(i, j) && is_edge(j, k) && is_edge(i, k) {
                    let [a, b, c] = [i, j, k].map(|n| Vec3::from(vertices[n]));
                    let outward = (b - a).cross(&(c - a)).dot(&a) > 0.0;
                    triangles.push(if outward { [i, j, k] } else { [i, k, j] }.map(|n| n as u32));
                }
            }
        }
    }
    (vertices, triangles)
}

/// A closing cell compacts icosahedra without friction to a jam at some 0.707 [Y. Jiao, S. Torquato, Phys. Rev. E 84 (2011)
/// 041309: maximally random jammed packings]. Few grains scatter by some 0.02.
#[test]
fn a_closing_cell_compacts_polyhedra_to_a_jam() {
    let servo = AxisControl::Stress { value: 100.0, gain: 0.4, average: 0.0, max_rate: None };
    let mut case = cube(3.3, CellControl { x: servo, y: servo, z: servo, ..CellControl::default() });
    case.law_of_all("ELASTIC_REPELL_CLB", &[2.5e4, 0.0]);
    let (vertices, triangles) = icosahedron();
    let vertices: Vec<[f64; 3]> = vertices.iter().map(|x| x.map(|c| 0.5 * c)).collect();
    let mut random = uniform(3);
    for (_, x) in shaken_lattice(3, 3) {
        let body = case.polyhedron(&vertices, &triangles, x);
        case.launch(body, [0; 3].map(|_| 2.0 * random() - 1.0), [0; 3].map(|_| 4.0 * random() - 2.0));
    }
    (case.options.dt, case.options.tol) = (0.001, None);
    let end = case.run(1300);
    let cell = end.meta.cell.unwrap();
    // V = 5/12 (3 + √5) a³, R = a sin(2π/5).
    let edge = 0.5 / (0.4 * std::f64::consts::PI).sin();
    let nu = 27.0 * 5.0 / 12.0 * (3.0 + 5f64.sqrt()) * edge.powi(3) / cell.periods.iter().product::<f64>();
    assert!((0.66..0.73).contains(&nu), "ν {nu}");
    // Springs without friction and dampers still oscillate.
    equal(cell.mean_stress[0], 100.0, 30.0);
}

#[test]
fn threads_and_resume_change_nothing_with_any_shapes() {
    let servo = AxisControl::Stress { value: 2.0, gain: 0.5, average: 0.0625, max_rate: None };
    let control = CellControl { x: servo, z: servo, shear_xz: 2.0, ..CellControl::default() };
    for add_body in [add_block, add_clump, add_capsule] as [AddBody; 3] {
        expect_same_bytes(|| {
            let mut case = gas_of(add_body, control, ("IQS_CLB", &[0.5]), [1.0, -1.0, 1.5]);
            (case.options.steps, case.options.output_every, case.options.tol) = (Some(60), 30, Some(1e-6));
            case.law_between("CAPSx", "CAPSx", "IQS_CLB", &[0.5]);
            case
        });
    }
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
    let add_held_body = |case: &mut Case| {
        let body = case.sphere(0.25, [8.0; 3]);
        case.drive(body, [0.0; 6].map(Evolution::constant));
    };
    assert_eq!(exit_status(&add_held_body), 2);
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
