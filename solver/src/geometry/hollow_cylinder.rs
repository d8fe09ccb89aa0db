//! A polyhedron inside a hollow cylinder, as in a drum.

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
    let mut touch = |v: Vec3, outward: Vec3, gap: f64, features: (u32, u32)| {
        if gap <= alert {
            let outward = q * outward;
            let points = [ContactPoint { position: v + outward * (0.5 * gap), gap, features }].into_iter().collect();
            found.push(Manifold { normal: -outward, points, area: 0.0 });
        }
    };
    for k in 0..a.shape.vertices().len() as u32 {
        let v = a.vertex(k);
        let at = q.inverse_transform_vector(&(v - c));
        let distance = at.xy().norm();
        if distance > 0.0 {
            touch(v, Vec3::new(at.x, at.y, 0.0) / distance, radius - distance, (vertex_feature(k), 0));
        }
        let end = if at.z >= 0.0 { 1 } else { 2 };
        touch(v, Vec3::z() * 1f64.copysign(at.z), half_height - at.z.abs(), (vertex_feature(k), end));
    }
    found
}
