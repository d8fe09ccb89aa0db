//! Queries of polyhedra for the flush-joint test: heights along a direction, and contact along a given direction.

use super::manifold::{ListingRange, Manifold};
use super::pair::{PolyhedronPair, SearchAxis, SearchFeature, support_vertex};
use super::patch::ContactPatch;
use super::polyhedron::PosedPolyhedron;
use super::search::support_face;
use crate::math::Vec3;
use crate::math::simd::{Scalar, SimdWidth};

impl PosedPolyhedron<'_> {
    /// Returns the largest n·x over the polyhedron, x from its centre, m.
    ///
    /// ```
    /// # use cd_solve::{geometry::Polyhedron, math::{Quat, Vec3}};
    /// let brick = Polyhedron::cuboid(&Vec3::new(3.0, 2.0, 0.5));
    /// assert_eq!(brick.posed_by(&Quat::identity()).support_height(&Vec3::new(0.0, 0.6, -0.8)), 1.6);
    /// ```
    pub fn support_height(&self, n: &Vec3) -> f64 {
        support_vertex(self, n).1
    }

    /// Returns the unit outward normal of the face closest to `n`, and the distance of its plane from the centre, m.
    pub fn face_along(&self, n: &Vec3) -> (Vec3, f64) {
        let n = self.local_vector(n);
        let planes = self.shape.face_planes();
        let (mut best, mut largest) = (&planes[0], f64::NEG_INFINITY);
        for plane in planes {
            let alignment = plane.normal.dot(&n);
            if alignment > largest {
                (best, largest) = (plane, alignment);
            }
        }
        (self.world_vector(&best.normal), best.offset)
    }
}

/// Contact of polyhedra A and B at `c` = x_B - x_A (m) along the given unit normal `n`, from B to A: the corners of the
/// common part of the faces that face each other. `None` if there is no common part within the range.
///
/// No search is made: the caller knows that a plane across `n` separates the two.
pub fn polyhedra_along(
    a: &PosedPolyhedron,
    b: &PosedPolyhedron,
    c: &Vec3,
    n: &Vec3,
    range: ListingRange,
) -> Option<Manifold> {
    let pair = PolyhedronPair::new(a, b, *c, SimdWidth::detect());
    let from_a = -n;
    let axis = SearchAxis { n: from_a, s: pair.separation_along(&from_a).0, feature: SearchFeature::None };
    let faces = (support_face(Scalar, a, &from_a, None), support_face(Scalar, b, n, None));
    let (mut patch, mut manifold) = (ContactPatch::default(), Manifold::default());
    patch.clip_faces(&pair, &axis, faces, range.area);
    patch.write_manifold(range, pair.tie_tolerance(), &mut manifold);
    (!manifold.points.is_empty()).then_some(manifold)
}
