//! Cylinders and capsules on triangulated walls against those on polyhedra.

use cd_formats::wall_mesh::{MeshSides, WallMesh};
use cd_solve::geometry::{
    ContactPoint, ListingRange, Polyhedron, WallContacts, capsule_mesh, cylinder_mesh, polyhedron_capsule,
    polyhedron_cylinder,
};
use cd_solve::math::{Quat, Vec3};

use crate::shapes::{Random, rock};

/// Surface of a polyhedron, its front outside.
fn surface(shape: &Polyhedron) -> WallMesh {
    let vertices: Vec<[f64; 3]> = shape.vertices().iter().map(|v| (*v).into()).collect();
    let fan =
        |face: &[u16]| (2..face.len()).map(|k| [face[0], face[k - 1], face[k]].map(u32::from)).collect::<Vec<_>>();
    WallMesh::new(&vertices, &shape.faces().flat_map(fan).collect::<Vec<_>>(), MeshSides::One).unwrap()
}

/// The surface of a convex body has the one normal and the gap of the body inside, apart and with overlaps.
#[test]
fn a_convex_surface_is_touched_as_the_body_inside() {
    let shape = rock(&mut Random(1), 18, Vec3::new(1.0, 1.0, 0.7)).shape;
    let mesh = surface(&shape);
    for is_capsule in [false, true] {
        let (mut apart, mut overlapping) = (0, 0);
        for number in 0..400 {
            let k = f64::from(number);
            let axes = Quat::from_euler_angles(k, 2.0 * k, 0.3 * k);
            let q = Quat::from_euler_angles(0.7 * k, -k, 1.9 * k);
            let posed = shape.posed_by(&q);
            let c = Vec3::new((1.3 * k).sin(), (2.1 * k).cos(), (0.4 * k).sin()).normalize() * (0.95 + 0.001 * k);
            let size = [0.3, 0.2];
            let (body, found) = if is_capsule {
                (
                    polyhedron_capsule(&posed, &-c, &axes, size, 0.1),
                    capsule_mesh(&axes, size, &mesh, &c, &q, 0.1.into()),
                )
            } else {
                (
                    polyhedron_cylinder(&posed, &-c, &axes, size, 0.1),
                    cylinder_mesh(&axes, size, &mesh, &c, &q, 0.1.into()),
                )
            };
            let Some(body) = body else {
                let is_apart = match found {
                    WallContacts::Apart { min_gap } => min_gap > 0.1,
                    WallContacts::Listed(found) => found.is_empty(),
                };
                assert!(is_apart, "{number}");
                continue;
            };
            let found = found.into_contacts();
            assert_eq!(found.len(), 1, "{number}: {found:?} {body:?}");
            // Tolerance: directions of near points have the rounding of positions divided by their distance.
            let (normal_error, gap_error) = ((found[0].normal + body.normal).norm(), found[0].gap() - body.gap());
            assert!(normal_error < 1e-10 && gap_error.abs() < 1e-11, "{number}: {:?} {body:?}", found[0]);
            (apart, overlapping) = (apart + u32::from(body.gap() > 0.0), overlapping + u32::from(body.gap() < 0.0));
        }
        assert!(apart > 20 && overlapping > 20, "{is_capsule}: {apart} {overlapping}");
    }
}

/// Plane of triangles on squares of 0.25 m, whose corners are moved by up to `noise` of that; about the vertex in the middle.
fn plane(noise: f64) -> WallMesh {
    let mut number = 0.0f64;
    let mut random = || {
        number += 1.0;
        (number * 12.9898).sin() * noise
    };
    let grid = (0..=16).flat_map(|j| (0..=16).map(move |i| (f64::from(i) - 8.0, f64::from(j) - 8.0)));
    let vertices: Vec<[f64; 3]> = grid.map(|(x, y)| [x + random(), y + random(), 0.0].map(|x| x * 0.25)).collect();
    let square = |k: u32| {
        let [a, b, c, d] = [0, 1, 18, 17].map(|step| k / 16 * 17 + k % 16 + step);
        [[a, b, c], [a, c, d]]
    };
    WallMesh::new(&vertices, &(0..256).flat_map(square).collect::<Vec<_>>(), MeshSides::One).unwrap()
}

/// Body over a plane.
#[derive(Debug)]
struct Case {
    /// Orientation of the plane.
    wall: Quat,
    /// Turn of the body about the normal of the plane, and its tilts about two axes in the plane before, rad.
    turn: f64,
    tilts: [f64; 2],
    /// Whether the axis is along the plane, or across it, but for the tilts.
    lies: bool,
    is_capsule: bool,
    /// Position of the body along the plane, and its smallest gap, m.
    position: [f64; 2],
    gap: f64,
}

impl Case {
    /// Checks that the plane of triangles has the points and the area of a plate.
    fn check(&self, mesh: &WallMesh) {
        let Case { wall, turn, tilts, lies, is_capsule, position: [x, y], gap } = self;
        let (is_capsule, size) = (*is_capsule, [0.5, 0.25]);
        let own = Quat::from_euler_angles(if *lies { std::f64::consts::FRAC_PI_2 } else { 0.0 }, 0.0, 0.0);
        let axes = wall * Quat::from_euler_angles(tilts[0], tilts[1], *turn) * own;
        let (up, axis) = (wall * Vec3::z(), axes * Vec3::z());
        let radius = if is_capsule { 0.0 } else { size[1] };
        let lowest = -(size[0] * axis.dot(&up).abs() + radius * axis.cross(&up).norm());
        let height = gap - lowest + if is_capsule { size[1] } else { 0.0 };
        let c = wall * -Vec3::new(*x, *y, height);
        let range = ListingRange { area: 0.05, ..0.05.into() };
        let below = c - up;
        let plate = Polyhedron::cuboid(&Vec3::new(8.0, 8.0, 1.0));
        let posed = plate.posed_by(wall);
        let (expected, found) = if is_capsule {
            (polyhedron_capsule(&posed, &-below, &axes, size, range), capsule_mesh(&axes, size, mesh, &c, wall, range))
        } else {
            (
                polyhedron_cylinder(&posed, &-below, &axes, size, range),
                cylinder_mesh(&axes, size, mesh, &c, wall, range),
            )
        };
        let (expected, found) = (expected.unwrap(), found.into_contacts());
        assert_eq!(found.len(), 1, "{self:?}: {found:?}");
        assert!((found[0].normal - up).norm() < 1e-12, "{self:?}: {found:?} {expected:?}");
        assert!((found[0].area - expected.area).abs() < 1e-12, "{self:?}: {found:?} {expected:?}");
        assert_eq!(found[0].points.len(), expected.points.len(), "{self:?}: {found:?} {expected:?}");
        let tilt = tilts[0].abs();
        for point in &expected.points {
            // Tolerance: a few roundings of coordinates of 2, and of 8 in the plate; those of the direction of the lowest
            // point, divided by the tilt.
            let is_same = |other: &ContactPoint| {
                (other.position - (point.position + below)).norm() < 1e-13 + if tilt > 0.0 { 1e-15 / tilt } else { 0.0 }
                    && (other.gap - point.gap).abs() < 1e-13
            };
            assert!(found[0].points.iter().any(is_same), "{self:?}: {point:?} {found:?} {expected:?}");
        }
    }
}

/// A plane of triangles has the points and the area of a plate, for bodies that lie, stand and are tilted by little or much.
#[test]
fn a_plane_of_triangles_has_the_points_of_a_plate() {
    let mesh = plane(0.3);
    for number in 0..200u32 {
        let k = f64::from(number);
        let tilt = [0.0, 1e-9, 1e-4, 0.1, k][number as usize % 5];
        Case {
            wall: Quat::from_euler_angles(0.2 * k, 0.1 * k, 0.0),
            turn: 0.1 * k,
            tilts: [tilt, -0.7 * tilt],
            lies: number.is_multiple_of(2),
            is_capsule: number.is_multiple_of(3),
            position: [-0.1 * k.sin(), -0.1 * k.cos()],
            gap: [-0.1, -1e-3, -1e-8, 0.0, 1e-3, 0.04][number as usize % 6],
        }
        .check(&mesh);
    }
}

/// A plane of equal squares, each cut along the same diagonal, has the points and the area of a plate where ends are over
/// vertices, lines along edges and the middle or the rim of an end at a vertex, exactly and all but exactly.
#[test]
fn a_grid_of_squares_has_the_points_of_a_plate() {
    let mesh = plane(0.0);
    let walls = [Quat::identity(), Quat::from_euler_angles(0.2, 0.1, 0.0)];
    let positions = [[0.0, 0.0], [0.125, 0.0], [0.0, -0.125], [0.125, 0.125], [0.0625, 0.0], [0.0625, 0.0625]];
    // Every eleventh of all combinations.
    for number in (0..9600).step_by(11) {
        let mut rest = number;
        let mut choice = |count: usize| {
            let k = rest % count;
            rest /= count;
            k
        };
        let tilt = [0.0, 1e-9, 1e-6, 1e-4, 1e-2][choice(5)];
        Case {
            gap: [-0.1, -1e-8, 0.0, 0.04][choice(4)],
            position: positions[choice(6)],
            turn: [0.0, 1.0, 2.0, 3.0, 0.3][choice(5)] * std::f64::consts::FRAC_PI_4,
            wall: walls[choice(2)],
            tilts: [tilt, [0.0, -0.7 * tilt][choice(2)]],
            lies: choice(2) == 0,
            is_capsule: choice(2) == 0,
        }
        .check(&mesh);
    }
}
