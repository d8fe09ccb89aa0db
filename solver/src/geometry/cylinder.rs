//! A polyhedron inside a hollow cylinder, as in a drum.

use super::search::ends;
use super::{Manifold, Point, Polyhedron, Posed, edge, vertex};
use crate::math::{Quat, Vec3};

/// Polyhedron A in a hollow cylinder at `c` = x_B - x_A (m) with the orientation `q`, its axis the third.
///
/// The cylinder, open at its ends, is touched from inside by vertices, and at its ends by edges, each with its own
/// normal towards the axis: one manifold of one point for each within `alert` (m) of the wall. What is on the axis
/// touches along no direction and is left out. The cylinder's feature is 0, and 1 and 2 at the lower and the upper end.
///
/// ```
/// # use cd_solve::geometry::{Polyhedron, Posed, polyhedron_hollow_cylinder};
/// # use cd_solve::math::{Quat, Vec3};
/// let cube = Polyhedron::cuboid(&Vec3::repeat(3.0));
/// let mut posed = Posed::default();
/// posed.pose(&cube, &Quat::identity());
/// // The corners at x = 3 are at 5 from the axis.
/// let c = Vec3::new(-1.0, 0.0, 0.0);
/// let found = polyhedron_hollow_cylinder((&cube, &posed), &c, &Quat::identity(), 9.0, 5.5, 1.0);
/// assert_eq!(found.len(), 4);
/// assert!(found.iter().all(|manifold| (manifold.gap() - 0.5).abs() < 1e-15));
/// ```
pub fn polyhedron_hollow_cylinder(
    a: (&Polyhedron, &Posed),
    c: &Vec3,
    q: &Quat,
    half_height: f64,
    radius: f64,
    alert: f64,
) -> Vec<Manifold> {
    let (shape, posed) = a;
    let local = |v: Vec3| q.inverse_transform_vector(&(v - c));
    let mut found = Vec::new();
    let mut touch = |at: Vec3, features: (u32, u32)| {
        let distance = at.xy().norm();
        let gap = radius - distance;
        if gap > alert || distance == 0.0 {
            return;
        }
        let outward = q * (Vec3::new(at.x, at.y, 0.0) / distance);
        let position = q * at + c + outward * (0.5 * gap);
        let points = [Point { position, gap, features }].into_iter().collect();
        found.push(Manifold { normal: -outward, points, area: 0.0 });
    };
    for k in 0..shape.vertices().len() as u32 {
        let at = local(posed.vertex(k));
        if at.z.abs() <= half_height {
            touch(at, (vertex(k), 0));
        }
    }
    for k in 0..shape.edges.len() as u32 {
        let [from, to] = ends(shape, posed, k).map(local);
        for (end, z) in [(1, -half_height), (2, half_height)] {
            if (from.z < z) != (to.z < z) && from.z != z && to.z != z {
                touch(from.lerp(&to, (z - from.z) / (to.z - from.z)), (edge(k), end));
            }
        }
    }
    found
}
