//! Bodies inside a hollow cylinder, as in a drum.

use super::manifold::{ContactPoint, Manifold, vertex_feature};
use super::polyhedron::PosedPolyhedron;
use crate::math::{Quat, Vec3};

/// Contacts of polyhedron A in a hollow cylinder of `[half height, radius]` (m) at `c` = x_B - x_A (m) with the
/// orientation `q`, its axis the third.
///
/// The cylinder is closed at its ends. Its inside is convex, so that only vertices touch it: each touches the side and
/// the nearer end. Returns one manifold of one point for each contact within `alert` (m). A vertex on the axis has no
/// contact with the side, as it has no direction. The cylinder's feature is 0 for the side, 1 for the end along its axis,
/// 2 for the other end.
///
/// ```
/// # use cd_solve::geometry::{Polyhedron, polyhedron_hollow_cylinder};
/// # use cd_solve::math::{Quat, Vec3};
/// let cube = Polyhedron::cuboid(&Vec3::repeat(3.0));
/// let posed = cube.posed_by(&Quat::identity());
/// // The corners at x = 3 are at 5 from the axis.
/// let c = Vec3::new(-1.0, 0.0, 0.0);
/// let found = polyhedron_hollow_cylinder(&posed, &c, &Quat::identity(), [9.0, 5.5], 1.0);
/// assert_eq!(found.len(), 4);
/// assert!(found.iter().all(|manifold| (manifold.gap() - 0.5).abs() < 1e-15));
/// ```
pub fn polyhedron_hollow_cylinder(
    a: &PosedPolyhedron,
    c: &Vec3,
    q: &Quat,
    [half_height, radius]: [f64; 2],
    alert: f64,
) -> Vec<Manifold> {
    let mut found = Vec::new();
    let mut add_contact = |v: Vec3, outward: Vec3, gap: f64, features: (u32, u32)| {
        if gap <= alert {
            let outward = q * outward;
            let points = [ContactPoint { position: v + outward * (0.5 * gap), gap, features }].into_iter().collect();
            found.push(Manifold { normal: -outward, points, area: 0.0 });
        }
    };
    for k in 0..a.shape.vertices().len() as u32 {
        let v = a.vertex(k);
        let local = q.inverse_transform_vector(&(v - c));
        let distance = local.xy().norm();
        if distance > 0.0 {
            add_contact(v, Vec3::new(local.x, local.y, 0.0) / distance, radius - distance, (vertex_feature(k), 0));
        }
        let end = if local.z >= 0.0 { 1 } else { 2 };
        add_contact(v, Vec3::z() * 1f64.copysign(local.z), half_height - local.z.abs(), (vertex_feature(k), end));
    }
    found
}

/// Tangent planes of the side of [`far_walls`]. The polygon of their faces is at most 2 % wider than the cylinder.
const TANGENT_PLANES: u32 = 16;

/// Ratio of the displacement in a step to the smaller of the cylinder's radius and half height, above which the wall
/// ahead of a body differs from the one nearest to it.
const FAR_DISPLACEMENT: f64 = 0.25;

/// First feature of a hollow cylinder that is a tangent plane of its side or the farther end.
pub const FAR_WALL: u32 = 4;

/// Contacts of a ball of `radius` about `centre` (m, candidate) with all walls of a hollow cylinder at `c` with the
/// orientation `q`, as [`polyhedron_hollow_cylinder`] has them, in steps in which the distance closes by more than a
/// quarter of the cylinder's size: tangent planes of its side all around, and the farther end. Empty in shorter steps.
///
/// `feature`: feature of the candidate.
pub fn far_walls(
    centre: &Vec3,
    radius: f64,
    feature: u32,
    (c, q): (&Vec3, &Quat),
    [half_height, cylinder_radius]: [f64; 2],
    displacement: f64,
) -> Vec<Manifold> {
    if displacement < FAR_DISPLACEMENT * half_height.min(cylinder_radius) {
        return Vec::new();
    }
    let local = q.inverse_transform_vector(&(centre - c));
    let side = |k: u32| {
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(k) / f64::from(TANGENT_PLANES));
        (Vec3::new(cos, sin, 0.0), cylinder_radius, FAR_WALL + 1 + k)
    };
    let farther_end = (Vec3::z() * -1f64.copysign(local.z), half_height, FAR_WALL);
    let walls = (0..TANGENT_PLANES).map(side).chain([farther_end]);
    let wall_contact = |(outward, distance, wall): (Vec3, f64, u32)| {
        let gap = distance - outward.dot(&local) - radius;
        let outward = q * outward;
        let point = ContactPoint { position: centre + outward * (radius + 0.5 * gap), gap, features: (feature, wall) };
        Manifold { normal: -outward, points: [point].into_iter().collect(), area: 0.0 }
    };
    walls.map(wall_contact).filter(|manifold| manifold.gap() <= displacement).collect()
}

/// [`far_walls`] of the vertices of polyhedron A.
pub fn vertices_at_far_walls(
    a: &PosedPolyhedron,
    c: &Vec3,
    q: &Quat,
    size: [f64; 2],
    displacement: f64,
) -> impl Iterator<Item = Manifold> {
    let at_vertex = move |k: u32| far_walls(&a.vertex(k), 0.0, vertex_feature(k), (c, q), size, displacement);
    (0..a.shape.vertices().len() as u32).flat_map(at_vertex)
}
