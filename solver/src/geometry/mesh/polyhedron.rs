//! Polyhedra on triangulated walls.

use cd_formats::wall_mesh::{TriangleRegion, WallMesh};
use smallvec::SmallVec;

use super::outline::{BodyOutline, FlatPolygon, OutlineKind};
use super::search::{AxisAttempt, MeshSearch, PosedTriangle, SurfaceBody, TouchAxis, nearest_on_segments};
use crate::geometry::manifold::{
    ContactPoint, ListingRange, Manifold, WallContacts, edge_feature, face_feature, vertex_feature,
};
use crate::geometry::polyhedron::{FeatureIndex, PosedPolyhedron};
use crate::geometry::search::support_face;
use crate::math::simd::Scalar;
use crate::math::{Quat, Vec3};

/// Bound of the product of the cosines between an edge of T and the two normals at an edge of A: the two edges are candidates
/// only if the product is below minus this. (4e-12)², the square of the smallest gain of separation, divided by the size.
const PARALLEL_EDGE_PRODUCT: f64 = 1.6e-23;

/// Contacts of polyhedron A with the surface of a wall at `c` = x_B - x_A, m, with this orientation: one manifold for
/// each normal, or a lower bound of the distance if all triangles are farther away than `range.alert`.
///
/// ```
/// use cd_formats::wall_mesh::{MeshSides, WallMesh};
/// # use cd_solve::geometry::{Polyhedron, polyhedron_mesh};
/// # use cd_solve::math::{Quat, Vec3};
/// let square = [[-2.0, -2.0, 0.0], [2.0, -2.0, 0.0], [2.0, 2.0, 0.0], [-2.0, 2.0, 0.0]];
/// let mesh = WallMesh::new(&square, &[[0, 1, 2], [0, 2, 3]], MeshSides::One).unwrap();
/// let cube = Polyhedron::cuboid(&Vec3::repeat(0.5));
/// let posed = cube.posed_by(&Quat::identity());
/// let found = polyhedron_mesh(&posed, &mesh, &(Vec3::z() * -0.625), &Quat::identity(), 0.25.into()).into_contacts();
/// assert_eq!((found.len(), found[0].normal, found[0].gap()), (1, Vec3::z(), 0.125));
/// assert_eq!((found[0].points.len(), found[0].area), (4, 1.0));
/// ```
pub fn polyhedron_mesh(
    a: &PosedPolyhedron,
    mesh: &WallMesh,
    c: &Vec3,
    orientation: &Quat,
    range: ListingRange,
) -> WallContacts<Manifold> {
    MeshSearch::new(PolyhedronBody::new(a), mesh, c, orientation, (range, 0.0)).contacts()
}

/// Edge of A.
struct BodyEdge {
    ends: [Vec3; 2],
    /// Numbers of the ends.
    vertices: [FeatureIndex; 2],
    /// Normals of its two faces.
    normals: [Vec3; 2],
}

/// Polyhedron with its vertices, faces and edges in the world's axes.
struct PolyhedronBody<'a> {
    posed: &'a PosedPolyhedron<'a>,
    vertices: SmallVec<[Vec3; 16]>,
    /// Outward normals of the faces, and distances of their planes from the centre, m.
    planes: SmallVec<[(Vec3, f64); 16]>,
    edges: SmallVec<[BodyEdge; 24]>,
}

impl<'a> PolyhedronBody<'a> {
    fn new(posed: &'a PosedPolyhedron<'a>) -> Self {
        let planes: SmallVec<[(Vec3, f64); 16]> = (0..)
            .zip(posed.shape.face_planes())
            .map(|(f, plane)| (posed.face_normal(f as u32), plane.offset))
            .collect();
        let vertices: SmallVec<[Vec3; 16]> =
            (0..posed.shape.vertices().len()).map(|k| posed.vertex(k as u32)).collect();
        let edges = posed.shape.edges().iter().map(|edge| BodyEdge {
            ends: edge.ends.map(|k| vertices[k as usize]),
            vertices: edge.ends,
            normals: edge.faces.map(|f| planes[f as usize].0),
        });
        let edges = edges.collect();
        PolyhedronBody { posed, vertices, planes, edges }
    }
}

impl SurfaceBody for PolyhedronBody<'_> {
    fn circumradius(&self) -> f64 {
        self.posed.shape.circumradius()
    }

    fn lowest_height(&self, n: &Vec3) -> f64 {
        self.vertices.iter().map(|vertex| n.dot(vertex)).fold(f64::INFINITY, f64::min)
    }

    fn lowest_point(&self, n: &Vec3) -> (Vec3, u32) {
        let mut lowest = 0;
        for (k, vertex) in self.vertices.iter().enumerate() {
            if n.dot(vertex) < n.dot(&self.vertices[lowest]) {
                lowest = k;
            }
        }
        (self.vertices[lowest], vertex_feature(lowest as u32))
    }

    fn outline(&self, n: &Vec3, frame: &[Vec3; 3]) -> BodyOutline {
        let face = support_face(Scalar, self.posed, &-n, None);
        let shape = self.posed.shape;
        let corners = shape.face_corners(face as usize);
        let points = corners.iter().map(|&k| self.vertices[k as usize]);
        BodyOutline {
            polygon: FlatPolygon::new(points, &self.planes[face as usize].0, frame),
            corner_features: corners.iter().map(|&k| vertex_feature(k.into())).collect(),
            side_features: shape.face_edges(face as usize).iter().map(|&e| edge_feature(e.into())).collect(),
            inside_feature: face_feature(face),
            kind: OutlineKind::Face,
        }
    }

    /// Tries the normals of the faces of A, and the directions across an edge of each of the two.
    fn try_directions(&self, triangle: &PosedTriangle, attempt: &mut AxisAttempt<Self>) {
        let corners = &triangle.corners;
        for (normal, offset) in &self.planes {
            let lowest = corners.iter().map(|corner| normal.dot(corner)).fold(f64::INFINITY, f64::min);
            if attempt.try_axis(-normal, lowest - offset, None) {
                return;
            }
        }
        for k in 0..3 {
            let [from, to, opposite] = [0, 1, 2].map(|i| corners[(k + i) % 3]);
            let along = to - from;
            let parallel = PARALLEL_EDGE_PRODUCT * along.norm_squared();
            for BodyEdge { ends, normals: [n0, n1], .. } in &self.edges {
                let (p0, p1) = (along.dot(n0), along.dot(n1));
                if p0 * p1 >= -parallel {
                    continue;
                }
                // Perpendicular to both edges, and outside of A.
                let outward = n0 * p1.abs() + n1 * p0.abs();
                let length = outward.norm();
                if outward.dot(&(opposite - from)) < 0.0 || length == 0.0 {
                    continue;
                }
                let normal = outward / -length;
                if attempt.try_axis(normal, normal.dot(&(ends[0] - from)), Some(TriangleRegion::Edge(k))) {
                    return;
                }
            }
        }
    }

    /// Nearest points of the edges of A and of a triangle, ends included.
    fn nearest_points(
        &self,
        search: &MeshSearch<Self>,
        triangle: &PosedTriangle,
        _: TouchAxis,
    ) -> Option<(TouchAxis, ContactPoint)> {
        let mut nearest: Option<(f64, usize, usize, [f64; 2])> = None;
        for k in 0..3 {
            let side = [triangle.corners[k], triangle.corners[(k + 1) % 3]];
            for (e, edge) in self.edges.iter().enumerate() {
                let (square, shares) = nearest_on_segments(&edge.ends, &side);
                if nearest.is_none_or(|(least, ..)| square < least) {
                    nearest = Some((square, e, k, shares));
                }
            }
        }
        let (square, e, k, [share_a, share_t]) = nearest?;
        let BodyEdge { ends: [start, end], vertices, .. } = &self.edges[e];
        let [from, to] = [triangle.corners[k], triangle.corners[(k + 1) % 3]];
        let (on_a, on_t) = (start + (end - start) * share_a, from + (to - from) * share_t);
        let gap = square.sqrt();
        let normal = (on_a - on_t) / gap;
        // Points at rounding distance have no direction.
        if gap <= search.tie() || !normal.iter().all(|x| x.is_finite()) {
            return None;
        }
        let region = match share_t {
            0.0 => TriangleRegion::Corner(k),
            1.0 => TriangleRegion::Corner((k + 1) % 3),
            _ => TriangleRegion::Edge(k),
        };
        let feature = match share_a {
            0.0 => vertex_feature(vertices[0].into()),
            1.0 => vertex_feature(vertices[1].into()),
            _ => edge_feature(e as u32),
        };
        let features = (feature, search.mesh.feature(triangle.number, region));
        Some((TouchAxis { normal, gap, region }, ContactPoint { position: (on_a + on_t) * 0.5, gap, features }))
    }
}

#[cfg(test)]
mod tests {
    use cd_formats::wall_mesh::MeshSides;

    use super::*;
    use crate::geometry::cache::CachedFeature;
    use crate::geometry::manifold::{ContactPoint, NarrowPhaseMode};
    use crate::geometry::polyhedra::polyhedron_polyhedron;
    use crate::geometry::polyhedra::tests::rock;
    use crate::geometry::polyhedron::Polyhedron;

    /// Surface of a polyhedron.
    fn surface(shape: &Polyhedron, sides: MeshSides) -> WallMesh {
        let vertices: Vec<[f64; 3]> = shape.vertices().iter().map(|v| (*v).into()).collect();
        let fan =
            |face: &[u16]| (2..face.len()).map(|k| [face[0], face[k - 1], face[k]].map(u32::from)).collect::<Vec<_>>();
        WallMesh::new(&vertices, &shape.faces().flat_map(fan).collect::<Vec<_>>(), sides).unwrap()
    }

    fn turn(k: f64) -> Quat {
        Quat::from_euler_angles(k, 2.0 * k, 0.3 * k)
    }

    /// The surface of a convex body has the one normal and the gap of the body, apart and with overlaps of up to a tenth.
    #[test]
    fn a_convex_surface_is_touched_as_the_body_inside() {
        let (a, b) = (rock(0.0), rock(1.0));
        let mesh = surface(&b, MeshSides::One);
        let (mut apart, mut overlapping) = (0, 0);
        for number in 0..400 {
            let k = f64::from(number);
            let (pa, qb) = (a.posed_by(&turn(k)), Quat::from_euler_angles(0.7 * k, -k, 1.9 * k));
            let pb = b.posed_by(&qb);
            let c = Vec3::new((1.3 * k).sin(), (2.1 * k).cos(), (0.4 * k).sin()).normalize() * (1.3 + 0.0015 * k);
            let mut memory = CachedFeature::default();
            let body = polyhedron_polyhedron(&pa, &pb, &c, 0.2, NarrowPhaseMode::Accurate, &mut memory);
            let found = polyhedron_mesh(&pa, &mesh, &c, &qb, 0.2.into());
            let Some(body) = body else {
                let is_apart = match found {
                    WallContacts::Apart { min_gap } => min_gap > 0.2,
                    WallContacts::Listed(found) => found.is_empty(),
                };
                assert!(is_apart, "{number}");
                continue;
            };
            let found = found.into_contacts();
            assert_eq!(found.len(), 1, "{number}: {found:?} {body:?}");
            // Tolerance: directions of near points have the rounding of positions divided by their distance.
            let (normal_error, gap_error) = ((found[0].normal - body.normal).norm(), found[0].gap() - body.gap());
            assert!(normal_error < 1e-11 && gap_error.abs() < 1e-11, "{number}: {:?} {body:?}", found[0]);
            (apart, overlapping) = (apart + u32::from(body.gap() > 0.0), overlapping + u32::from(body.gap() < 0.0));
        }
        assert!(apart > 50 && overlapping > 50, "{apart} {overlapping}");
    }

    /// A plane of triangles with corners at random positions has the points and the area of a plate, for any overlap, also
    /// of a face that is tilted, and whatever edges and corners are below.
    #[test]
    fn a_plane_of_triangles_has_the_points_of_a_plate() {
        let mut noise = 0.0f64;
        let mut random = || {
            noise += 1.0;
            (noise * 12.9898).sin() * 0.3
        };
        let mut vertices = Vec::new();
        for (i, j) in (0..=12).flat_map(|j| (0..=12).map(move |i| (i, j))) {
            vertices.push([f64::from(i) - 6.0 + random(), f64::from(j) - 6.0 + random(), 0.0].map(|x| x * 0.25));
        }
        let square = |k: u32| {
            let [a, b, c, d] = [0, 1, 14, 13].map(|step| k / 12 * 13 + k % 12 + step);
            [[a, b, c], [a, c, d]]
        };
        let triangles: Vec<[u32; 3]> = (0..144).flat_map(square).collect();
        let plate = Polyhedron::cuboid(&Vec3::new(8.0, 8.0, 1.0));
        for (shape, sides) in
            [(Polyhedron::cuboid(&Vec3::new(0.5, 0.4, 0.3)), MeshSides::One), (rock(0.0), MeshSides::Both)]
        {
            let mesh = WallMesh::new(&vertices, &triangles, sides).unwrap();
            for number in 0..100u32 {
                let k = f64::from(number);
                let wall = Quat::from_euler_angles(0.2 * k, 0.1 * k, 0.0);
                // Flat, tilted by 1e-9 to 0.1, and any.
                let tilt = [0.0, 1e-9, 1e-4, 0.1, k][number as usize % 5];
                let axes = wall * Quat::from_euler_angles(tilt, -0.7 * tilt, k);
                let posed = shape.posed_by(&axes);
                let gap = [-0.1, -1e-3, -1e-8, 0.0, 1e-3, 0.04][number as usize % 6];
                let height = gap + posed.support_height(&-(wall * Vec3::z()));
                let c = wall * Vec3::new(0.3 * k.sin(), 0.2 * k.cos(), -height);
                let range = ListingRange { area: 0.05, ..0.05.into() };
                let mut memory = CachedFeature::default();
                let (posed_plate, below) = (plate.posed_by(&wall), c - wall * Vec3::z());
                let expected =
                    polyhedron_polyhedron(&posed, &posed_plate, &below, range, NarrowPhaseMode::Accurate, &mut memory);
                let expected = expected.unwrap();
                let found = polyhedron_mesh(&posed, &mesh, &c, &wall, range).into_contacts();
                assert_eq!(found.len(), 1, "{number}: {found:?}");
                assert!((found[0].normal - wall * Vec3::z()).norm() < 1e-12, "{number}: {found:?} {expected:?}");
                assert!((found[0].area - expected.area).abs() < 1e-12, "{number}: {found:?} {expected:?}");
                assert_eq!(found[0].points.len(), expected.points.len(), "{number}: {found:?} {expected:?}");
                for point in &expected.points {
                    // Tolerance: a few roundings of coordinates of 2, and of 8 in the plate.
                    let is_same = |other: &ContactPoint| {
                        (other.position - point.position).norm() < 1e-13 && (other.gap - point.gap).abs() < 1e-13
                    };
                    let is_found =
                        found[0].points.iter().any(|other| is_same(other) && other.features.0 == point.features.0);
                    assert!(is_found, "{number}: {point:?} {found:?}");
                }
            }
        }
    }

    /// Cube of side 1 whose centre is at (x, y, z), next to the corner of a box that is open above, of four sides about a
    /// bottom from -1 to 1: the triangles push inwards.
    fn in_tub(x: f64, y: f64, z: f64) -> SmallVec<[Manifold; 2]> {
        let tub = Polyhedron::cuboid(&Vec3::repeat(1.0));
        let mut mesh = surface(&tub, MeshSides::One);
        let triangles: Vec<[u32; 3]> = (0..12)
            .filter(|&k| mesh.normal(k).z < 0.5)
            .map(|k| mesh.triangles()[k as usize])
            .map(|[a, b, c]| [a, c, b])
            .collect();
        let vertices: Vec<[f64; 3]> = mesh.vertices().iter().map(|v| (*v).into()).collect();
        mesh = WallMesh::new(&vertices, &triangles, MeshSides::One).unwrap();
        let cube = Polyhedron::cuboid(&Vec3::repeat(0.5));
        let posed = cube.posed_by(&Quat::identity());
        polyhedron_mesh(&posed, &mesh, &-Vec3::new(x, y, z), &Quat::identity(), 0.02.into()).into_contacts()
    }

    /// A cube in a corner touches each side with a face, apart and with overlaps of any ratio; a cube on the upper edge of a
    /// side is pushed up.
    #[test]
    fn concave_edges_are_touched_on_both_sides() {
        for gaps in [[0.01, 0.01, 0.01], [-0.01, -0.01, -0.01], [-1e-9, 0.01, -0.1], [0.0, -0.2, 1e-12]] {
            let [x, y, z] = gaps.map(|gap| gap - 0.5);
            let found = in_tub(x, y, z);
            assert_eq!(found.len(), 3, "{found:?}");
            for (gap, axis) in gaps.into_iter().zip([Vec3::x(), Vec3::y(), Vec3::z()]) {
                let side = found.iter().find(|manifold| (manifold.normal - axis).norm() < 1e-15).unwrap();
                assert_eq!(side.points.len(), 4);
                // Tolerance: roundings of coordinates of 1.
                assert!(side.points.iter().all(|point| (point.gap - gap).abs() < 1e-15), "{side:?}");
            }
        }
        // On the rim, which pushes in all directions: a line of two points.
        for gap in [0.01, -0.01] {
            let found = in_tub(-1.0, 0.0, 1.5 + gap);
            assert_eq!((found.len(), found[0].points.len()), (1, 2), "{found:?}");
            assert!((found[0].normal - Vec3::z()).norm() < 1e-15 && (found[0].gap() - gap).abs() < 1e-15);
        }
    }

    /// Ridges and tips poke into a face along the normal of the face, whatever the directions of their sides.
    #[test]
    fn ridges_and_tips_touch_faces() {
        let cube = Polyhedron::cuboid(&Vec3::repeat(0.5));
        let tilt = Quat::from_euler_angles(0.1, -0.2, 0.3);
        let posed = cube.posed_by(&tilt);
        let up = tilt * Vec3::z();
        let ridge = [[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, -1.0, -0.8], [0.0, 1.0, -0.8]];
        let tip = [[0.0, 0.0, 0.0], [1.0, 0.0, -1.0], [-0.5, 0.75, -1.0], [-0.5, -0.75, -1.0]];
        for sides in [MeshSides::One, MeshSides::Both] {
            let ridge = WallMesh::new(&ridge, &[[0, 1, 3], [0, 2, 1]], sides).unwrap();
            let tip = WallMesh::new(&tip, &[[0, 1, 2], [0, 2, 3], [0, 3, 1]], sides).unwrap();
            for gap in [0.01, 1e-10, -1e-10, -0.01] {
                let c = up * -(0.5 + gap);
                let found = polyhedron_mesh(&posed, &tip, &c, &Quat::identity(), 0.02.into()).into_contacts();
                assert_eq!(found.len(), 1, "{found:?}");
                // Tolerance: roundings of coordinates of 1.
                assert!((found[0].normal - up).norm() < 1e-15 && (found[0].gap() - gap).abs() < 1e-15, "{found:?}");
                assert_eq!(found[0].points[0].features.1, 4);
                // The ridge lies along the axes of the wall: its own direction across the face.
                let across = Quat::rotation_between(&Vec3::z(), &up).unwrap();
                let found = polyhedron_mesh(&posed, &ridge, &c, &across, 0.02.into()).into_contacts();
                assert_eq!((found.len(), found[0].points.len()), (1, 2), "{found:?}");
                assert!((found[0].normal - up).norm() < 1e-15 && (found[0].gap() - gap).abs() < 1e-15, "{found:?}");
            }
        }
    }

    /// A body behind a surface with one side is left alone, and pushed through the surface as soon as it overlaps.
    #[test]
    fn one_side_pushes_to_the_front() {
        let square = [[-2.0, -2.0, 0.0], [2.0, -2.0, 0.0], [2.0, 2.0, 0.0], [-2.0, 2.0, 0.0]];
        let cube = Polyhedron::cuboid(&Vec3::repeat(0.5));
        let posed = cube.posed_by(&Quat::identity());
        let at = |z: f64, sides: MeshSides| {
            let mesh = WallMesh::new(&square, &[[0, 1, 2], [0, 2, 3]], sides).unwrap();
            polyhedron_mesh(&posed, &mesh, &-Vec3::new(0.1, 0.2, z), &Quat::identity(), 0.05.into()).into_contacts()
        };
        assert!(at(-0.51, MeshSides::One).is_empty());
        for (z, sides, normal, gap) in [
            (0.25, MeshSides::One, Vec3::z(), -0.25),
            (-0.25, MeshSides::One, Vec3::z(), -0.75),
            (-0.25, MeshSides::Both, -Vec3::z(), -0.25),
            (-0.53125, MeshSides::Both, -Vec3::z(), 0.03125),
        ] {
            let found = at(z, sides);
            assert_eq!((found.len(), found[0].normal, found[0].gap()), (1, normal, gap));
            assert_eq!((found[0].points.len(), found[0].area), (4, 1.0));
        }
    }
}
