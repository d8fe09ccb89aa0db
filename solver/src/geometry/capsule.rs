//! Capsules: all points up to a radius from a segment, which is a cylinder of radius 0. Contacts are those of the segment
//! with the radius taken off.

use super::cylinder::{
    CYLINDER_END, CYLINDER_OTHER_END, CYLINDER_SIDE, polyhedron_cylinder, polyhedron_cylinder_along,
};
use super::manifold::{ContactPoint, ContactPoints, ListingRange, Manifold};
use super::polyhedron::PosedPolyhedron;
use crate::math::{Quat, Vec3};

/// Distance of two points of a segment's contact, divided by the radius, up to which they are one.
const SAME_POINT_DISTANCE: f64 = 1e-9;

/// Point of the segment of half length `half_length` (m) through `c` along the third axis of `q` that is nearest to the
/// origin, m, and its feature: 0 between the ends, 1 at the end along the axis, 2 at the other end.
///
/// ```
/// # use cd_solve::geometry::nearest_of_segment;
/// # use cd_solve::math::{Quat, Vec3};
/// let found = nearest_of_segment(&Vec3::new(3.0, 0.0, 5.0), &Quat::identity(), 1.0);
/// assert_eq!(found, (Vec3::new(3.0, 0.0, 4.0), 2));
/// ```
pub fn nearest_of_segment(c: &Vec3, q: &Quat, half_length: f64) -> (Vec3, u32) {
    let axis = q * Vec3::z();
    let along = -axis.dot(c);
    let feature = match along {
        _ if along >= half_length => CYLINDER_END,
        _ if along <= -half_length => CYLINDER_OTHER_END,
        _ => CYLINDER_SIDE,
    };
    (c + axis * along.clamp(-half_length, half_length), feature)
}

/// Ends of the segment of half length `half_length` (m) through the origin along the third axis of `q`, m, with their
/// features.
pub fn segment_ends(q: &Quat, half_length: f64) -> [(Vec3, u32); 2] {
    let end = q * Vec3::z() * half_length;
    [(end, CYLINDER_END), (-end, CYLINDER_OTHER_END)]
}

/// Contact of polyhedron A with a capsule of `[half length, radius]` (m) at `c` = x_B - x_A (m) with the orientation `q`, its
/// axis the third; `None` if they are farther apart than `range` lists.
///
/// A face or an edge along the capsule gives the ends of their common line, others one point. Features of the capsule are
/// those of a cylinder.
///
/// ```
/// # use cd_solve::geometry::{Polyhedron, polyhedron_capsule};
/// # use cd_solve::math::{Quat, Vec3};
/// let cube = Polyhedron::cuboid(&Vec3::repeat(1.0));
/// // The capsule lies below the cube, along its third axis.
/// let c = Vec3::new(0.0, -1.75, 0.0);
/// let posed = cube.posed_by(&Quat::identity());
/// let found = polyhedron_capsule(&posed, &c, &Quat::identity(), [2.0, 0.5], 0.5).unwrap();
/// assert_eq!((found.normal, found.gap(), found.points.len()), (Vec3::y(), 0.25, 2));
/// assert!(found.points.iter().all(|point| point.position.y == -1.125 && point.position.z.abs() == 1.0));
/// ```
pub fn polyhedron_capsule(
    a: &PosedPolyhedron,
    c: &Vec3,
    q: &Quat,
    [half_length, radius]: [f64; 2],
    range: impl Into<ListingRange>,
) -> Option<Manifold> {
    let found = polyhedron_cylinder(a, c, q, [half_length, 0.0], range.into().widened_by(radius))?;
    Some(rounded_manifold(&found, [0.0, radius]))
}

/// Contact of polyhedron A with a capsule along the given unit normal `n`, from B to A; as [`polyhedron_cylinder_along`].
pub fn polyhedron_capsule_along(
    a: &PosedPolyhedron,
    c: &Vec3,
    q: &Quat,
    [half_length, radius]: [f64; 2],
    n: &Vec3,
    range: ListingRange,
) -> Option<Manifold> {
    let found = polyhedron_cylinder_along(a, c, q, [half_length, 0.0], n, range.widened_by(radius))?;
    Some(rounded_manifold(&found, [0.0, radius]))
}

/// Contact of two bodies whose surfaces are at the distances `rounding` (m, of A and B) from those of `found`. Points that
/// coincide are one.
pub(super) fn rounded_manifold(found: &Manifold, [of_a, of_b]: [f64; 2]) -> Manifold {
    let same = SAME_POINT_DISTANCE * of_a.max(of_b);
    let mut points = ContactPoints::new();
    for ContactPoint { position, gap, features } in &found.points {
        let position = position + found.normal * (0.5 * (of_b - of_a));
        let is_known = points.iter().any(|known: &ContactPoint| (known.position - position).norm() <= same);
        if !is_known {
            points.push(ContactPoint { position, gap: gap - of_a - of_b, features: *features });
        }
    }
    Manifold { normal: found.normal, points, area: 0.0 }
}
