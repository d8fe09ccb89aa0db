//! Contact of two contactors along a given normal, which replaces an inner contact; A and B as in [`super`].

use crate::detect::posed::{CandidatePair, PosedContactor, PosedShape};
use crate::geometry::{
    Manifold, PosedPolyhedron, capsule_end_along, cylinder_end_along, polyhedra_along, polyhedron_capsule_along,
    polyhedron_cylinder_along, polyhedron_end_along, swapped_manifold,
};
use crate::math::Vec3;

/// Polyhedron of a contactor, if it is one; a plate is a cuboid.
pub fn polyhedron<'a>(contactor: &'a PosedContactor<'a>) -> Option<&'a PosedPolyhedron<'a>> {
    match &contactor.shape {
        PosedShape::Polyhedron(posed) | PosedShape::Plane { cuboid: posed, .. } => Some(posed),
        PosedShape::Sphere { .. } | PosedShape::Cylinder { .. } | PosedShape::Capsule { .. } | PosedShape::Mesh(_) => {
            None
        }
    }
}

/// Contact of a pair along the unit normal `n`, from contactor B to contactor A, which is above a plane across `n`, with the
/// common part of the surfaces that face each other. `None` if there is none within the range, or for a sphere.
pub fn contact_along(pair: &CandidatePair, n: &Vec3, a_is_antagonist: bool) -> Option<Manifold> {
    let &CandidatePair { a: candidate, b: antagonist, c, range, .. } = pair;
    let (a, b, b_from_a, n_to_candidate) =
        if a_is_antagonist { (antagonist, candidate, -c, -n) } else { (candidate, antagonist, c, *n) };
    if let (Some(p), Some(q)) = (polyhedron(candidate), polyhedron(antagonist)) {
        return polyhedra_along(p, q, &c, &n_to_candidate, range);
    }
    let found = match &b.shape {
        &PosedShape::Cylinder { half_height, radius, hollow: false } => {
            let size_b = [half_height, radius];
            match a.shape {
                PosedShape::Cylinder { half_height: h, radius: r, hollow: false } => {
                    cylinder_end_along(&a.axes, [h, r], &b_from_a, &b.axes, size_b, n, range)
                }
                PosedShape::Capsule { half_length: h, radius: r } => {
                    capsule_end_along(&a.axes, [h, r], &b_from_a, &b.axes, size_b, n, range)
                }
                _ => polyhedron_end_along(polyhedron(a)?, &b_from_a, &b.axes, size_b, n, range),
            }
        }
        _ => {
            let q = polyhedron(b)?;
            let found = match a.shape {
                PosedShape::Cylinder { half_height, radius, hollow: false } => {
                    polyhedron_cylinder_along(q, &-b_from_a, &a.axes, [half_height, radius], &-n, range)
                }
                PosedShape::Capsule { half_length, radius } => {
                    polyhedron_capsule_along(q, &-b_from_a, &a.axes, [half_length, radius], &-n, range)
                }
                _ => None,
            };
            found.map(|found| swapped_manifold(&found, &b_from_a))
        }
    };
    found.map(|found| if a_is_antagonist { swapped_manifold(&found, &c) } else { found })
}
