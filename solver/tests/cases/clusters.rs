//! Bodies of several contactors, spheres against polyhedra and cylinders.

use cd_formats::bodies::{Contactor, LocalFrame, ShapeRecord};
use cd_formats::drv_dof::Evolution;

use crate::case::{BOX, Case, Figures, Vec3, equal, near};

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];

fn cuboid(half: [f64; 3], centre: [f64; 3]) -> Contactor {
    let vertices =
        (0..8u32).map(|k| [0, 1, 2].map(|i| centre[i] + if k >> i & 1 == 1 { half[i] } else { -half[i] })).collect();
    let shape = ShapeRecord::Polyhedron { vertices, triangles: BOX.to_vec() };
    Contactor { colour: "GRAIN".into(), shape, local_frame: None }
}

/// An L of a leg and a foot, not convex: volume, centre and moments by Huygens' theorem, and it rests on both.
#[test]
fn an_l_of_two_cuboids() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -9.81];
    case.floor();
    let body = case.block([0.5; 3], [0.0, 0.0, 1.0], [X, Y, Z]);
    case.bodies[body].contactors = vec![cuboid([0.5, 0.5, 1.0], [0.0; 3]), cuboid([0.5; 3], [1.0, 0.0, -0.5])];
    case.dof.retain(|dof| dof.body != body);
    case.bodies[body].inertia = None;
    case.options.dt = 0.01;
    let state = case.run(100);
    equal(state.mass(body), 3.0, 1e-12);
    near(state.x(body), [1.0 / 3.0, 0.0, 1.0 - 1.0 / 6.0], 1e-9);
    assert!(state.v(body).norm() < 1e-10 && state.w(body).norm() < 1e-10);
    let mut inertia = state.bodies.body_inertia[body];
    inertia.sort_by(f64::total_cmp);
    // About y: 2 (1 + 4)/12 + 1 (1 + 1)/12 + 2 (1/9 + 1/36) + 1 (4/9 + 1/9) = 11/6.
    assert!(inertia.iter().any(|j| (j - 11.0 / 6.0).abs() < 1e-9), "{inertia:?}");
    let parts = state.shapes.unwrap().contacts.contact_rank;
    assert!(parts.contains(&[0, 0]) && parts.contains(&[1, 0]));
}

/// A sphere rolls off the edge of a block that does not move, and stays on a wide one.
#[test]
fn a_sphere_on_a_block() {
    let drop = |x: f64| {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        case.gravity = [0.0, 0.0, -10.0];
        let block = case.block([1.0, 1.0, 0.5], [0.0, 0.0, -0.5], [X, Y, Z]);
        case.drive(block, [0.0; 6].map(Evolution::constant));
        let sphere = case.sphere(0.25, [x, 0.0, 0.25]);
        case.options.dt = 0.01;
        let state = case.run(100);
        (state.x(sphere), state.force(sphere, block))
    };
    let (x, force) = drop(0.5);
    near(x, [0.5, 0.0, 0.25], 1e-12);
    equal(force.unwrap().x, 10.0 * 4.0 / 3.0 * std::f64::consts::PI * 0.25f64.powi(3), 1e-10);
    assert!(drop(1.1).0.z < -0.5);
}

/// A sphere at rest in the lowest line of a hollow cylinder, and one on top of a solid one.
#[test]
fn spheres_and_cylinders() {
    for hollow in [true, false] {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        case.gravity = [0.0, 0.0, -10.0];
        let wall = case.plate([1.0; 3], [0.0; 3], [X, Y, Z]);
        // Its axis along y.
        let shape = ShapeRecord::Cylinder { half_height: 2.0, radius: 1.0, hollow };
        case.bodies[wall].contactors[0] = Contactor { colour: "WALLx".into(), shape, local_frame: None };
        case.dof[wall].axes = [Z, X, Y];
        let z = if hollow { -0.75 } else { 1.25 };
        let sphere = case.sphere(0.25, [0.0, 0.5, z]);
        case.options.dt = 0.01;
        let state = case.run(50);
        near(state.x(sphere), [0.0, 0.5, z], 1e-12);
        let weight = 10.0 * state.mass(sphere);
        equal(state.force(sphere, wall).unwrap().x, weight, 1e-12);
    }
}

/// A cube in a drum that lies: it rests on the two lines that its lower edges touch, and each carries half of it.
#[test]
fn a_cube_in_a_drum() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -10.0];
    let drum = case.plate([1.0; 3], [0.0; 3], [X, Y, Z]);
    // Its axis along y.
    let shape = ShapeRecord::Cylinder { half_height: 2.0, radius: 1.25, hollow: true };
    case.bodies[drum].contactors[0] = Contactor { colour: "WALLx".into(), shape, local_frame: None };
    case.dof[drum].axes = [Z, X, Y];
    // 3-4-5: the lower edges are at x = ±1, z = -0.75; the cube touches one end.
    let cube = case.block([1.0, 0.5, 0.5], [0.0, 1.5, -0.25], [X, Y, Z]);
    case.options.dt = 0.01;
    let state = case.run(50);
    near(state.x(cube), [0.0, 1.5, -0.25], 1e-9);
    let contacts = &state.contacts;
    let total = on_candidates(&state);
    near(total, [0.0, 0.0, 10.0 * state.mass(cube)], 1e-8);
    // Four corners on the side, two upper ones at the end and two lower ones that touch both.
    assert_eq!(contacts.contact_body.len(), 8);
}

/// A body that slides round a drum without friction keeps its distance from the axis and its speed, as on a polygon of
/// chords of equal length; one with restitution is not thrown off.
#[test]
fn round_a_drum() {
    let laws: [(&str, &[f64]); 3] = [("IQS_CLB", &[0.0]), ("GAP_SGR_CLB", &[0.0]), ("RST_CLB", &[0.8, 0.0, 0.0])];
    for (kind, parameters) in laws {
        let mut case = Case::new();
        case.law_of_all(kind, parameters);
        let drum = case.plate([1.0; 3], [0.0; 3], [X, Y, Z]);
        let shape = ShapeRecord::Cylinder { half_height: 2.0, radius: 1.0, hollow: true };
        case.bodies[drum].contactors[0] = Contactor { colour: "WALLx".into(), shape, local_frame: None };
        case.dof[drum].axes = [Z, X, Y];
        // The drum flies along; as fast the sphere, and round it.
        case.drive_along(drum, 0, Evolution::constant(0.5));
        case.dof[drum].velocity[0] = 0.5;
        let sphere = case.sphere(0.25, [0.0, 0.5, -0.75]);
        case.launch(sphere, [1.5, 0.25, 0.0], [0.0; 3]);
        case.options.dt = 0.03125;
        // Ten times round.
        for state in case.states(1536, 96) {
            let (x, v) = (state.x(sphere) - state.x(drum), state.v(sphere));
            // At the end of a step it is in the middle of a chord: 0.75 (1 - (h v / 2 r)²/2).
            let sagitta = 0.75 - (0.75f64.powi(2) - 0.015625f64.powi(2)).sqrt();
            let distance = x.x.hypot(x.z);
            assert!(distance < 0.75 + 2.0 * sagitta && distance > 0.75 - 2.0 * sagitta, "{kind} {distance}");
            equal((v.x - 0.5).hypot(v.z), 1.0, 1e-3);
        }
    }
}

/// A cube that rough walls carry round turns with the drum.
#[test]
fn a_cube_round_a_drum() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    let drum = case.plate([1.0; 3], [0.0; 3], [X, Y, Z]);
    let shape = ShapeRecord::Cylinder { half_height: 2.0, radius: 1.25, hollow: true };
    case.bodies[drum].contactors[0] = Contactor { colour: "WALLx".into(), shape, local_frame: None };
    case.dof[drum].axes = [Z, X, Y];
    // About its own third axis, which is y.
    case.drive_along(drum, 5, Evolution::constant(1.0));
    case.dof[drum].velocity[5] = 1.0;
    let cube = case.block([1.0, 0.5, 0.5], [0.0, 0.0, -0.25], [X, Y, Z]);
    case.launch(cube, [-0.25, 0.0, 0.0], [0.0, 1.0, 0.0]);
    case.options.dt = 0.03125;
    for state in case.states(1536, 192).into_iter().skip(1) {
        let (x, q) = (state.x(cube), state.meta.time);
        // Of second order: some (h ω)² = 1e-3 of a way of 48 × 0.25 m. Kept along the tangent in each step it would be at 0.44 m.
        near(x, [-0.25 * q.sin(), 0.0, -0.25 * q.cos()], 0.03);
        assert!((x.norm() - 0.25).abs() < 0.01, "{x:?}");
    }
}

/// Spheres that tumble in a turning drum, over a block and a ball that do not move, by rows alone and, for a cube that meets
/// nothing, by full blocks.
#[test]
fn spheres_among_walls_need_no_blocks() {
    let tumbled = |with_cube: bool| {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        case.gravity = [0.0, 0.0, -10.0];
        // Before the spheres in the files; a body of two contactors is none of them.
        let ball = case.sphere(0.25, [-0.125, 0.5, -1.0]);
        let shape = ShapeRecord::OffsetSphere { radius: 0.25, offset: [0.0, -0.75, 0.0] };
        let second = Contactor { shape, ..case.bodies[ball].contactors[0].clone() };
        case.bodies[ball].contactors.push(second);
        let block = case.block([0.125; 3], [0.5, 0.5, -0.75], [X, Y, Z]);
        for wall in [ball, block] {
            case.drive(wall, [0.0; 6].map(Evolution::constant));
        }
        let drum = case.plate([1.0; 3], [0.0; 3], [X, Y, Z]);
        let shape = ShapeRecord::Cylinder { half_height: 2.0, radius: 1.0, hollow: true };
        case.bodies[drum].contactors[0] = Contactor { colour: "WALLx".into(), shape, local_frame: None };
        case.dof[drum].axes = [Z, X, Y];
        case.drive_along(drum, 5, Evolution::constant(2.0));
        case.dof[drum].velocity[5] = 2.0;
        for k in 0..12 {
            let (a, b) = (f64::from(k % 4), f64::from(k / 4));
            case.sphere(0.125, [0.27 * a - 0.4, 0.3 * b - 0.11 * a, 0.3125 * b - 0.05 * a]);
        }
        if with_cube {
            let cube = case.block([0.5; 3], [64.0, 0.0, 0.0], [X, Y, Z]);
            case.bodies[cube].contactors[0].colour = "ALONE".into();
        }
        case.options.dt = 0.01;
        let spheres = drum + 1..drum + 13;
        let state = case.run(46);
        let touched = [ball, block, drum].map(|wall| spheres.clone().any(|k| state.force(k, wall).is_some()));
        (spheres.flat_map(|k| [state.x(k), state.v(k), state.w(k)]).collect::<Vec<_>>(), touched)
    };
    let (by_rows, touched) = tumbled(false);
    assert_eq!(touched, [true; 3]);
    // Both solve each step to 1e-12, and shocks let grow what differs.
    for (a, b) in by_rows.iter().zip(&tumbled(true).0) {
        assert!((a - b).norm() < 1e-9, "{a} {b}");
    }
}

/// The sum of the forces on candidates, world frame.
fn on_candidates(state: &cd_formats::snapshot::Snapshot) -> Vec3 {
    let contacts = &state.contacts;
    let of = |k: usize| {
        let force = Vec3::from(contacts.contact_force[k]);
        let frame = contacts.contact_frame[k].map(Vec3::from);
        frame[0] * force.x + frame[1] * force.y + frame[2] * force.z
    };
    (0..contacts.contact_body.len()).map(of).sum()
}

/// A slab on the end of a pillar and one across a roller: the wall carries the weight, on four points and on two.
#[test]
fn slabs_on_a_pillar_and_on_a_roller() {
    for (axes, top, points) in [([X, Y, Z], 2.0, 4), ([Z, X, Y], 0.5, 2)] {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        case.gravity = [0.0, 0.0, -10.0];
        let wall = case.plate([1.0; 3], [0.0; 3], [X, Y, Z]);
        let shape = ShapeRecord::Cylinder { half_height: 2.0, radius: 0.5, hollow: false };
        case.bodies[wall].contactors[0] = Contactor { colour: "WALLx".into(), shape, local_frame: None };
        case.dof[wall].axes = axes;
        let slab = case.block([1.0, 1.5, 0.25], [0.0, 0.0, top + 0.25], [X, Y, Z]);
        case.options.dt = 0.01;
        let state = case.run(50);
        near(state.x(slab), [0.0, 0.0, top + 0.25], 1e-9);
        // Sums of a few forces, each solved to 1e-12 of the whole.
        near(on_candidates(&state), [0.0, 0.0, 10.0 * state.mass(slab)], 1e-8);
        assert_eq!(state.contacts.contact_body.len(), points);
    }
}

/// A plate with a frame of its own stands where the frame says.
#[test]
fn a_local_frame_moves_a_plate() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -10.0];
    let plate = case.plate([4.0, 4.0, 0.5], [0.0; 3], [X, Y, Z]);
    let frame = LocalFrame { axes: [Y, [-1.0, 0.0, 0.0], Z], offset: [0.0, 0.0, 1.5] };
    case.bodies[plate].contactors[0].local_frame = Some(frame.into());
    case.dof.clear();
    let block = case.block([0.5; 3], [0.0, 0.0, 2.5], [X, Y, Z]);
    case.options.dt = 0.01;
    let state = case.run(20);
    near(state.x(plate), [0.0, 0.0, 1.5], 1e-12);
    near(state.x(block), Vec3::new(0.0, 0.0, 2.5), 1e-12);
}
