//! Polyhedra, and bodies of several polyhedra or spheres, on triangulated walls.

use cd_formats::bodies::{Contactor, ShapeRecord};
use cd_formats::compute::Adaptive;
use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot::Snapshot;
use cd_formats::wall_mesh::{MeshSides, WallMesh};
use nalgebra::Rotation3;

use crate::case::{AXES, BOX, Case, Figures, Vec3, equal, near, shaken_lattice, shaking_velocity, uniform};
use crate::meshes::{Triangles, terrain, turned_axes};
use crate::same_bits::{files, same};

const STEP: f64 = 1.0 / 128.0;

/// Triangles of a plane with corners at random positions: squares of `side` about the origin, `count` along x and y.
pub fn random_plane(count: u32, side: f64) -> Triangles {
    let (mut vertices, triangles) = terrain(count, side, || 0.0);
    let mut random = uniform(7);
    for [x, y, _] in &mut vertices {
        (*x, *y) = (*x + 0.5 * side * (random() - 0.5), *y + 0.5 * side * (random() - 0.5));
    }
    (vertices, triangles)
}

/// Scene in 8 m/s^2 with one law of all contacts with surfaces and plates.
fn scene((kind, parameters): (&str, &[f64])) -> Case {
    let mut case = Case::new();
    for antagonist in ["PLANx", "MESHx"] {
        case.law_with(antagonist, kind, parameters);
        case.law_between("POLYR", antagonist, kind, parameters);
    }
    case.gravity = [0.0, 0.0, -8.0];
    case.options.dt = STEP;
    case
}

/// A wall whose upper face is in the plane across the third axis: a plate of 12 m by 12 m, or triangles.
fn wall(case: &mut Case, is_mesh: bool, axes: [[f64; 3]; 3]) -> usize {
    if is_mesh {
        let (vertices, triangles) = random_plane(32, 0.375);
        return case.mesh(&vertices, &triangles, [0.0; 3], axes);
    }
    case.plate([6.0, 6.0, 0.5], (Vec3::from(axes[2]) * -0.5).into(), axes)
}

/// Makes a wall of triangles push from both sides.
pub fn make_two_sided(case: &mut Case, wall: usize, (vertices, triangles): &Triangles) {
    if let ShapeRecord::Mesh { sides, surface, .. } = &mut case.bodies[wall].contactors[0].shape {
        *sides = MeshSides::Both;
        *surface = Some(WallMesh::new(vertices, triangles, MeshSides::Both).unwrap().into());
    }
}

/// Body on a wall.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Rider {
    Block,
    /// Two blocks that touch each other.
    TwoBlocks,
    /// Two spheres that overlap.
    Clump,
}

/// A rider that slides and spins on a wall, turned about the third axis against the edges of the wall.
fn rider_on_wall(
    rider: Rider,
    is_mesh: bool,
    law: (&str, &[f64]),
    axes: [[f64; 3]; 3],
    drive: &[(usize, Evolution)],
) -> Case {
    let mut case = scene(law);
    let [x, y, z] = axes.map(Vec3::from);
    let turned = Rotation3::from_scaled_axis(z * 0.3);
    let own_axes = [x, y, z].map(|axis| (turned * axis).into());
    let body = match rider {
        Rider::Clump => {
            let pair = case.sphere(0.25, (z * 0.25).into());
            let ball = |x: f64| Contactor {
                colour: "GRAIN".into(),
                shape: ShapeRecord::OffsetSphere { radius: 0.25, offset: [x, 0.0, 0.0] },
                local_frame: None,
            };
            case.bodies[pair].contactors = vec![ball(0.125), ball(-0.125)];
            case.dof[pair].axes = own_axes;
            pair
        }
        _ => case.block([0.5, 0.25, 0.125], (z * 0.125).into(), own_axes),
    };
    if rider == Rider::TwoBlocks {
        let piece = |x: [f64; 2]| {
            let side = |k: u32, bit: u32, half: f64| if k >> bit & 1 == 1 { half } else { -half };
            let vertices = (0..8).map(|k| [x[(k & 1) as usize], side(k, 1, 0.25), side(k, 2, 0.125)]).collect();
            let shape = ShapeRecord::Polyhedron { vertices, triangles: BOX.to_vec() };
            Contactor { colour: "GRAIN".into(), shape, local_frame: None }
        };
        case.bodies[body].contactors = vec![piece([-0.5, 0.125]), piece([0.125, 0.5])];
    }
    case.launch(body, (x * 2.25 + y * 0.75).into(), (z * 2.0).into());
    let wall = wall(&mut case, is_mesh, axes);
    let mut motion = [0.0; 6].map(Evolution::constant);
    drive.iter().for_each(|(component, evolution)| motion[*component] = evolution.clone());
    case.drive(wall, motion);
    case
}

/// Slides, spins and is bonded as on a plate, across the edges of many triangles.
#[test]
fn bodies_ride_on_triangles_as_on_a_plate() {
    let level = turned_axes(0.0, 0.0);
    let slope = turned_axes(0.25, 0.125);
    let friction = ("IQS_CLB", &[0.3][..]);
    let cases = [
        (Rider::Block, friction, level, vec![]),
        (Rider::Block, friction, slope, vec![]),
        (Rider::TwoBlocks, friction, slope, vec![]),
        (Rider::Clump, friction, slope, vec![]),
        (Rider::Block, ("IQS_WET_DS_CLB", &[0.05, 0.0, 0.01, 0.3, 0.3][..]), slope, vec![]),
        (Rider::Block, friction, level, vec![(2, shaking_velocity(0.25)), (0, shaking_velocity(0.5))]),
        (Rider::Block, friction, level, vec![(5, Evolution::constant(0.5))]),
    ];
    for (rider, law, axes, drive) in cases {
        let [plate, mesh] = [false, true].map(|is_mesh| rider_on_wall(rider, is_mesh, law, axes, &drive).run(96));
        // Away from the start, and not beyond the edge of the plate.
        assert!(plate.x(0).norm() > 0.5 && plate.x(0).norm() < 5.0, "{rider:?}: {}", plate.x(0));
        assert_eq!(mesh.contacts.contact_body.len(), plate.contacts.contact_body.len(), "{rider:?}");
        // Tolerance: solutions to 1e-12 of 96 steps, of which each starts from rounded positions. How two blocks share the
        // load is not determined, and it is taken from the step before where a corner has crossed an edge.
        let bound = if rider == Rider::TwoBlocks { 1e-4 } else { 1e-8 };
        let difference = |of: fn(&Snapshot, usize) -> Vec3| (of(&mesh, 0) - of(&plate, 0)).norm();
        let found = [difference(Snapshot::x), difference(Snapshot::v), difference(Snapshot::w)];
        assert!(found.iter().all(|difference| *difference <= bound), "{rider:?} {law:?} {drive:?}: {found:?}");
    }
}

/// A block that slides is slowed down by mu g, and loses no energy at edges: without friction it keeps its velocity.
#[test]
fn a_block_slides_over_flush_edges_without_being_stopped() {
    for mu in [0.0, 0.3] {
        let mut case = scene(("IQS_CLB", &[mu]));
        let block = case.block([0.5, 0.25, 0.125], [-2.0, 0.0, 0.125], AXES);
        case.launch(block, [2.0, 0.0, 0.0], [0.0; 3]);
        wall(&mut case, true, AXES);
        let state = case.run(64);
        // Tolerance: 64 solutions to 1e-12; the height is rounded.
        near(state.v(block), [2.0 - mu * 8.0 * 0.5, 0.0, 0.0], 1e-10);
        near(state.w(block), [0.0; 3], 1e-9);
        equal(state.x(block).z, 0.125, 1e-11);
    }
}

/// Sum of the forces on the free body in contacts that pass a test, N: on the candidate, in the world's axes.
pub fn force_of(state: &Snapshot, is_counted: impl Fn(&Vec3) -> bool) -> Vec3 {
    let contacts = state.contacts.contact_force.iter().zip(&state.contacts.contact_frame);
    contacts
        .map(|(force, frame)| (Vec3::from(*force), frame.map(Vec3::from)))
        .filter(|(_, [n, ..])| is_counted(n))
        .map(|(force, [n, t, s])| n * force.x + t * force.y + s * force.z)
        .sum()
}

/// A cube on a plane of random triangles has four contacts, its weight and its area on them.
#[test]
fn a_cube_rests_on_random_triangles() {
    for is_two_sided in [false, true] {
        let mut case = scene(("IQS_CLB", &[0.5]));
        let turned = Rotation3::from_scaled_axis(Vec3::z() * 0.4);
        let axes = [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| (turned * axis).into());
        let cube = case.block([0.5; 3], [0.1, 0.2, 0.5], axes);
        let floor = wall(&mut case, true, AXES);
        if is_two_sided {
            make_two_sided(&mut case, floor, &random_plane(32, 0.375));
        }
        let state = case.run(32);
        near(state.x(cube), [0.1, 0.2, 0.5], 1e-12);
        near(force_of(&state, |_| true), [0.0, 0.0, 8.0], 1e-9);
        assert_eq!(state.contacts.contact_body.len(), 4);
        equal(state.shapes.unwrap().contacts.contact_area.iter().sum(), 1.0, 1e-12);
    }
}

/// Without friction each side of a groove at right angles carries the weight over the square root of two.
#[test]
fn a_groove_carries_a_cube_on_both_sides() {
    let vertices = [-2.0, 0.0, 2.0].map(|x: f64| [-2.0, 2.0].map(|y| [x, y, x.abs()])).concat();
    let groove = (vertices, vec![[0, 2, 1], [2, 3, 1], [2, 4, 3], [4, 5, 3]]);
    let mut case = scene(("IQS_CLB", &[0.0]));
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let axes = [[half, 0.0, half], [0.0, 1.0, 0.0], [-half, 0.0, half]];
    let cube = case.block([0.5; 3], [0.0, 0.0, half], axes);
    case.mesh(&groove.0, &groove.1, [0.0; 3], AXES);
    let state = case.run(32);
    near(state.v(cube), [0.0; 3], 1e-9);
    assert_eq!(state.contacts.contact_body.len(), 8);
    for side in [-1.0, 1.0] {
        // Tolerance: files with 8 digits of the axes.
        near(force_of(&state, |n| n.x * side > 0.0), [4.0 * side, 0.0, 4.0], 1e-6);
    }
}

/// A cube whose middle is over a ridge stands on two points of it, and one over a tip on one point.
#[test]
fn ridges_and_tips_carry_a_cube() {
    let ridge = [-2.0, 2.0].map(|x| [[x, -1.0, -0.75], [x, 0.0, 0.0], [x, 1.0, -0.75]]).concat();
    let ridge = (ridge, vec![[0, 3, 1], [1, 3, 4], [1, 4, 2], [2, 4, 5]]);
    let tip = vec![[0.0, 0.0, 0.0], [1.0, 0.0, -1.0], [-0.5, 0.75, -1.0], [-0.5, -0.75, -1.0]];
    let tip = (tip, vec![[0, 1, 2], [0, 2, 3], [0, 3, 1]]);
    for (surface, count) in [(ridge, 2), (tip, 1)] {
        let mut case = scene(("IQS_CLB", &[0.5]));
        let cube = case.block([0.5; 3], [0.0, 0.0, 0.5], AXES);
        case.mesh(&surface.0, &surface.1, [0.0; 3], AXES);
        let state = case.run(16);
        assert_eq!(state.contacts.contact_body.len(), count);
        near(force_of(&state, |n| n.z > 1.0 - 1e-12), [0.0, 0.0, 8.0], 1e-9);
        near(state.x(cube), [0.0, 0.0, 0.5], 1e-12);
    }
}

/// A tilted block that is started half inside the surface has the contacts that it has with a plate: all laws keep overlaps
/// that are there at the start.
#[test]
fn deep_overlaps_have_the_contacts_of_a_plate() {
    let [plate, mesh] = [false, true].map(|is_mesh| {
        let mut case = scene(("IQS_CLB", &[0.3]));
        case.block([0.5, 0.25, 0.25], [0.1, 0.2, 0.0625], turned_axes(0.125, 0.0));
        wall(&mut case, is_mesh, AXES);
        case.run(32)
    });
    assert!(plate.contacts.contact_gap.iter().all(|gap| *gap < -0.1));
    let sorted = |state: &Snapshot| {
        let mut gaps = state.contacts.contact_gap.clone();
        gaps.sort_by(f64::total_cmp);
        gaps
    };
    assert_eq!(mesh.contacts.contact_gap.len(), plate.contacts.contact_gap.len());
    sorted(&mesh).into_iter().zip(sorted(&plate)).for_each(|(gap, other)| equal(gap, other, 1e-12));
    near(mesh.x(0), plate.x(0), 1e-12);
    near(force_of(&mesh, |_| true), force_of(&plate, |_| true), 1e-9);
}

/// Fast cubes, on a face and on a corner, stop at a thin surface of small triangles as at a plate.
#[test]
fn fast_cubes_do_not_pass_a_surface() {
    let (a, b, c) = (1.0 / 2f64.sqrt(), 1.0 / 6f64.sqrt(), 1.0 / 3f64.sqrt());
    let on_corner = [[a, b, c], [-a, b, c], [0.0, -2.0 * b, c]];
    for (axes, half_height) in [(AXES, 0.5), (on_corner, 0.5 * 3f64.sqrt())] {
        for (travel, adaptive) in [(0.3, false), (3.0, false), (100.0, false), (3.0, true)] {
            for is_two_sided in [false, true] {
                let mut case = scene(("IQS_CLB", &[0.3]));
                let cube = case.block([0.5; 3], [0.0, 0.0, half_height + 2.2 * travel], axes);
                case.launch(cube, [0.0, 0.0, -travel / STEP], [0.0; 3]);
                let floor = wall(&mut case, true, AXES);
                if is_two_sided {
                    make_two_sided(&mut case, floor, &random_plane(32, 0.375));
                }
                if adaptive {
                    case.options.adaptive = Some(Adaptive { max_multiple: 16, ..Adaptive::default() });
                }
                let state = case.run(8);
                let lowest = state.x(cube).z;
                // As deep as a thousandth of its size: contacts are solved in the configuration of the middle of a step.
                assert!(lowest > 0.5 - 1e-3 && state.v(cube).z.abs() < 1.0, "{travel} {adaptive}: {lowest}");
            }
        }
    }
}

/// Blocks, bodies of two blocks, a clump and spheres that fall on terrain which shakes.
fn rocks_on_terrain() -> Case {
    let mut case = scene(("IQS_WET_DS_CLB", &[0.05, 0.0, 0.02, 0.3, 0.5]));
    case.law_between("SPHER", "SPHER", "IQS_CLB", &[0.4]);
    case.law_between("SPHER", "POLYR", "IQS_CLB", &[0.4]);
    case.law_between("POLYR", "POLYR", "IQS_CLB", &[0.4]);
    case.gravity = [0.1, 0.0, -4.0];
    for (k, (radius, [x, y, z])) in (0..).zip(shaken_lattice(3, 5)) {
        let position = [x, y, z + 2.75];
        if k % 4 == 0 {
            case.sphere(radius, position);
            continue;
        }
        let half = [0.8, 0.55, 0.2].map(|share| share * radius);
        let body = case.block(half, position, turned_axes(0.4 * f64::from(k), 0.7 * f64::from(k)));
        if k % 4 == 2 {
            let shape = case.bodies[body].contactors[0].shape.clone();
            let ShapeRecord::Polyhedron { vertices, triangles } = shape else { continue };
            let piece = |low: f64, high: f64| {
                let moved = |[x, y, z]: &[f64; 3]| [if *x < 0.0 { low } else { high }, *y, *z];
                let vertices = vertices.iter().map(moved).collect();
                let shape = ShapeRecord::Polyhedron { vertices, triangles: triangles.clone() };
                Contactor { colour: "GRAIN".into(), shape, local_frame: None }
            };
            case.bodies[body].contactors = vec![piece(-half[0], 0.0), piece(0.0, half[0])];
        }
    }
    let mut random = uniform(3);
    let (vertices, triangles) = terrain(16, 0.5, || 0.5 * random());
    let wall = case.mesh(&vertices, &triangles, [0.0; 3], AXES);
    let shaking =
        Evolution::Harmonic { constant: 0.0, amplitude: 0.5, omega: 9.0, phase: 0.0, ramp_start: 0.1, ramp_rate: 2.0 };
    case.drive_along(wall, 0, shaking);
    let options = &mut case.options;
    (options.dt, options.tol, options.max_sweeps) = (0.01, Some(1e-5), Some(500));
    (options.steps, options.output_every, options.text) = (Some(120), 30, true);
    case
}

#[test]
fn threads_and_resume_change_nothing_for_rocks_on_terrain() {
    let one = files(&rocks_on_terrain(), &[&["--threads", "1"]]);
    same(&one, &files(&rocks_on_terrain(), &[&["--threads", "4"]]));
    same(&one, &files(&rocks_on_terrain(), &[&["--steps", "60"], &["--resume", "--steps", "120"]]));
    let case = rocks_on_terrain();
    case.write();
    assert_eq!(case.solve(&[]), 0);
    let state = case.last();
    let wall = state.bodies.body_x.len() as u32 - 1;
    let touching = state.contacts.contact_body.iter().zip(&state.contacts.contact_impulse);
    let count = touching.filter(|(bodies, impulse)| bodies[1] == wall && **impulse != [0.0; 3]).count();
    assert!(count > 15, "{count}");
    for body in 0..wall as usize {
        // None has fallen through the terrain, which is between 0 and 0.5 m high.
        assert!(state.x(body).z > 0.0, "body {body}: {}", state.x(body));
    }
}
