//! Tests by shape whether polyhedra overlap each other or reach out of a region.

use nalgebra::{Matrix3, Vector3};
use parry3d_f64::math::{Pose, Vector as Point};
use parry3d_f64::query;
use parry3d_f64::shape::ConvexPolyhedron;

use super::region::GrainRegion;
use crate::shapes::OrientedPolyhedron;
use crate::shapes::overlap::{ConvexPiece, overlap_depth};

/// Convex pieces of a polyhedron in the axes of a region.
pub struct GrainHulls {
    pieces: Vec<ConvexPiece>,
    /// Hulls of the pieces about the grain's centre of mass in units of `unit`, for parry's GJK; none if parry makes none.
    hulls: Vec<Option<ConvexPolyhedron>>,
    /// m
    unit: f64,
}

impl GrainHulls {
    /// Pieces of `polyhedron` about the origin. `rotation` turns the axes of the region into the fixed ones. Distances are
    /// computed in units of `unit`, m, the same for all grains.
    pub fn new(polyhedron: &OrientedPolyhedron, rotation: &Matrix3<f64>, unit: f64) -> GrainHulls {
        let to_region_axes = rotation.transpose() * polyhedron.axes.transpose();
        let pieces = polyhedron.vertices().into_iter().zip(&polyhedron.solid.pieces).map(|(vertices, piece)| {
            let vertices = vertices.into_iter().map(|v| to_region_axes * Vector3::from(v)).collect();
            ConvexPiece::new(Vector3::zeros(), vertices, piece.triangles())
        });
        let pieces: Vec<ConvexPiece> = pieces.collect();
        let hulls = pieces.iter().map(|piece| parry_hull(piece, unit)).collect();
        GrainHulls { pieces, hulls, unit }
    }

    /// Moves the centre of mass to `centre`, m.
    pub fn move_to(&mut self, centre: &Vector3<f64>) {
        self.pieces.iter_mut().for_each(|piece| piece.centre = *centre);
    }

    /// Smallest and largest coordinates of the vertices, m.
    pub fn bounds(&self) -> [Vector3<f64>; 2] {
        let vertices = || self.pieces.iter().flat_map(ConvexPiece::vertices);
        [
            vertices().fold(Vector3::repeat(f64::INFINITY), |low, v| low.inf(&v)),
            vertices().fold(Vector3::repeat(f64::NEG_INFINITY), |high, v| high.sup(&v)),
        ]
    }

    /// Whether two grains are at least `margin`, m, apart.
    ///
    /// parry's GJK sorts out the overlapping pairs; a separating axis then confirms the others, so that no error of GJK
    /// leaves an overlap.
    pub fn is_apart_from(&self, other: &GrainHulls, margin: f64) -> bool {
        let pose = |piece: &ConvexPiece| {
            let [x, y, z] = (piece.centre / self.unit).into();
            Pose::translation(x, y, z)
        };
        let gap = |a: usize, b: usize| match (&self.hulls[a], &other.hulls[b]) {
            (Some(first), Some(second)) => {
                query::distance(&pose(&self.pieces[a]), first, &pose(&other.pieces[b]), second)
                    .map_or(0.0, |gap| gap.distance * self.unit)
            }
            _ => f64::INFINITY,
        };
        let are_apart = |a: usize, b: usize| {
            gap(a, b) > margin && overlap_depth(&self.pieces[a], &other.pieces[b], -margin) <= -margin
        };
        (0..self.pieces.len()).all(|a| (0..other.pieces.len()).all(|b| are_apart(a, b)))
    }

    /// Whether the grain lies in the region, at least `margin`, m, from its boundary.
    pub fn lies_in(&self, region: &GrainRegion, margin: f64) -> bool {
        let has_corners_within =
            self.pieces.iter().all(|piece| piece.vertices().all(|vertex| region.contains_ball(&vertex, margin)));
        match region {
            // The others are convex.
            GrainRegion::Inside(inside) => {
                has_corners_within && self.pieces.iter().all(|piece| inside.keeps_clear_of(piece, margin))
            }
            _ => has_corners_within,
        }
    }
}

/// Hull of a piece about its own centre in units of `unit`, m.
fn parry_hull(piece: &ConvexPiece, unit: f64) -> Option<ConvexPolyhedron> {
    let point = |v: Vector3<f64>| Point::new(v.x / unit, v.y / unit, v.z / unit);
    ConvexPolyhedron::from_convex_hull(&piece.vertices().map(|v| point(v - piece.centre)).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::random::{RandomStream, StreamPurpose};
    use crate::scene::GrainShape;
    use crate::shapes::{PrincipalSolid, hull, regular};

    /// Box of these half lengths, turned by `turn`.
    fn brick(halves: [f64; 3], turn: &Matrix3<f64>) -> GrainHulls {
        let shape = GrainShape::Box { lengths: halves.map(|half| 2.0 * half) };
        let solid = PrincipalSolid::from_convex(&hull::convex_hull(&regular::shape_vertices(&shape)).unwrap()).unwrap();
        GrainHulls::new(&OrientedPolyhedron::new(Arc::new(solid), 1.0, turn), &Matrix3::identity(), 1.0)
    }

    #[test]
    fn bricks_side_by_side_are_apart_though_their_balls_overlap() {
        let turn = Matrix3::identity();
        let (a, mut b) = (brick([2.0, 0.5, 0.5], &turn), brick([2.0, 0.5, 0.5], &turn));
        for (y, apart) in [(1.0 + 2e-6, true), (1.0 + 0.5e-6, false), (0.9, false), (-1.1, true)] {
            b.move_to(&Vector3::new(0.3, y, 0.0));
            assert_eq!(a.is_apart_from(&b, 1e-6), apart, "{y}");
            assert_eq!(b.is_apart_from(&a, 1e-6), apart, "{y}");
        }
    }

    #[test]
    fn a_brick_lies_in_a_region_as_long_as_its_corners_do() {
        let mut brick = brick([2.0, 0.5, 0.5], &Matrix3::identity());
        let mut holds = |region: &GrainRegion, x: f64| {
            brick.move_to(&Vector3::new(x, 0.0, 0.0));
            brick.lies_in(region, 1e-6)
        };
        let flat = GrainRegion::Box([3.0, 0.6, 0.6]);
        assert!(holds(&flat, 0.99) && !holds(&flat, 1.01) && !holds(&flat, 1.0 - 0.5e-6));
        // The far corners of the brick lie 2^2 + 0.5^2 + 0.5^2 = 4.5 = 2.1213^2 from its centre.
        assert!(holds(&GrainRegion::Ball(2.122), 0.0) && !holds(&GrainRegion::Ball(2.12), 0.0));
    }

    #[test]
    fn a_ridge_of_a_surface_that_enters_a_brick_between_its_corners_is_found() {
        // A box with a wedge cut into its upper side along y, down to z = 0 at x = 0.
        let low = [[-4.0, -4.0, -2.0], [4.0, -4.0, -2.0], [4.0, 4.0, -2.0], [-4.0, 4.0, -2.0]];
        let high = [[-4.0, -4.0, 2.0], [-1.0, -4.0, 2.0], [0.0, -4.0, 0.0], [1.0, -4.0, 2.0], [4.0, -4.0, 2.0]];
        let back = high.map(|[x, _, z]| [x, 4.0, z]);
        let vertices = [&low[..], &high, &back].concat();
        // Numbers: low 0 to 3, front edge 4 to 8, back edge 9 to 13.
        let mut triangles: Vec<[u32; 3]> = vec![[0, 2, 1], [0, 3, 2], [0, 4, 9], [0, 9, 3], [1, 13, 8], [1, 2, 13]];
        for k in 4..8 {
            triangles.extend([[k, k + 1, k + 6], [k, k + 6, k + 5]]);
        }
        triangles.extend([[0, 1, 6], [0, 6, 5], [0, 5, 4], [1, 8, 7], [1, 7, 6]]);
        triangles.extend([[3, 11, 2], [3, 10, 11], [3, 9, 10], [2, 12, 13], [2, 11, 12]]);
        let surface = cd_formats::surface::Surface::new(&vertices, &triangles).unwrap();
        let centre = Vector3::from(surface.mass_properties().centre);
        let region = GrainRegion::Inside(super::super::inside::SurfaceRegion::new(&surface).unwrap());
        let mut brick = brick([2.0, 0.5, 0.5], &Matrix3::identity());
        let mut lies_at = |z: f64| {
            brick.move_to(&(Vector3::new(0.0, 0.0, z) - centre));
            brick.lies_in(&region, 1e-6)
        };
        // Its upper face at z + 0.5 is below the edge of the wedge, or not.
        assert!(lies_at(-0.6) && !lies_at(-0.4));
        // All corners inside on both sides of the wedge.
        assert!(!lies_at(0.0));
    }

    #[test]
    fn rocks_that_are_apart_have_no_common_point() {
        let mut random = RandomStream::new(4, 0, StreamPurpose::Shape);
        let mut counts = [0, 0];
        for _ in 0..300 {
            let (a, mut b) = (
                brick([1.0, 0.6, 0.3], &random.uniform_rotation()),
                brick([0.8, 0.5, 0.5], &random.uniform_rotation()),
            );
            b.move_to(&(1.5 * random.point_in_cube()));
            let depth = overlap_depth(&a.pieces[0], &b.pieces[0], f64::NEG_INFINITY);
            let is_apart = a.is_apart_from(&b, 1e-6);
            // The separating axes of faces and edges are complete for convex polyhedra.
            assert_eq!(is_apart, depth <= -1e-6, "{depth}");
            counts[usize::from(is_apart)] += 1;
        }
        assert!(counts.iter().all(|count| *count > 30), "{counts:?}");
    }
}
