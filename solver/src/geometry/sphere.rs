//! Polyhedron against a sphere: the point of the polyhedron that is nearest to the centre.

use super::manifold::{ContactPoint, Manifold, edge_feature, face_feature, vertex_feature};
use super::polyhedron::PosedPolyhedron;
use crate::math::Vec3;

/// Contact of polyhedron A with a sphere of `radius` (m) at `c` = x_B - x_A, m; `None` if they are more than `alert`
/// apart.
///
/// For a centre inside, the contact is through the nearest face. The sphere's feature is 0.
///
/// ```
/// # use cd_solve::geometry::{Polyhedron, polyhedron_sphere, face_feature};
/// # use cd_solve::math::{Quat, Vec3};
/// let cube = Polyhedron::cuboid(&Vec3::repeat(1.0));
/// let posed = cube.posed_by(&Quat::identity());
/// let found = polyhedron_sphere(&posed, &Vec3::new(0.2, 0.1, 1.75), 0.5, 1.0).unwrap();
/// assert_eq!((found.normal, found.gap()), (-Vec3::z(), 0.25));
/// assert_eq!(found.points[0].position, Vec3::new(0.2, 0.1, 1.125));
/// ```
pub fn polyhedron_sphere(a: &PosedPolyhedron, c: &Vec3, radius: f64, alert: f64) -> Option<Manifold> {
    let local_centre = a.local_vector(c);
    let (mut nearest, mut height) = (0, f64::NEG_INFINITY);
    for (f, plane) in a.shape.face_planes().iter().enumerate() {
        let face_distance = plane.normal.dot(&local_centre) - plane.offset;
        if face_distance > height {
            (nearest, height) = (f as u32, face_distance);
        }
    }
    if height - radius > alert {
        return None;
    }
    let n = a.face_normal(nearest);
    let (n, distance, on_a, feature) = match nearest_on_edges(a, c) {
        Some((point, feature)) if height > 0.0 => {
            let between = c - point;
            let distance = between.norm();
            (between / distance, distance, point, feature)
        }
        _ => (n, height, c - n * height, face_feature(nearest)),
    };
    let gap = distance - radius;
    let point = ContactPoint { position: on_a + n * (0.5 * gap), gap, features: (feature, 0) };
    (gap <= alert).then(|| Manifold { normal: -n, points: [point].into_iter().collect(), area: 0.0 })
}

/// Returns the nearest point on an edge or vertex, unless the centre is directly above or below a face that it is in
/// front of.
fn nearest_on_edges(posed: &PosedPolyhedron, c: &Vec3) -> Option<(Vec3, u32)> {
    let shape = posed.shape;
    let mut best: Option<(f64, Vec3, u32)> = None;
    for (f, plane) in shape.face_planes().iter().enumerate() {
        let n = posed.face_normal(f as u32);
        if n.dot(c) - plane.offset <= 0.0 {
            continue;
        }
        let (corners, edges) = (shape.face_corners(f), shape.face_edges(f));
        let mut is_above_face = true;
        for (k, &edge) in edges.iter().enumerate() {
            let from = posed.vertex(corners[k]);
            let along = posed.vertex(corners[if k + 1 == corners.len() { 0 } else { k + 1 }]) - from;
            // Where the centre, seen along the normal, is outside of this edge, the nearest point may be on it.
            if n.cross(&along).dot(&(c - from)) >= 0.0 {
                continue;
            }
            is_above_face = false;
            let share = (c - from).dot(&along) / along.norm_squared();
            let (point, feature) = if share <= 0.0 {
                (from, vertex_feature(corners[k].into()))
            } else if share >= 1.0 {
                (from + along, vertex_feature(corners[if k + 1 == corners.len() { 0 } else { k + 1 }].into()))
            } else {
                (from + along * share, edge_feature(edge.into()))
            };
            let squared_distance = (c - point).norm_squared();
            if best.is_none_or(|(least, ..)| squared_distance < least) {
                best = Some((squared_distance, point, feature));
            }
        }
        if is_above_face {
            return None;
        }
    }
    // 0: on the surface, where the direction is undefined.
    best.filter(|(squared_distance, ..)| *squared_distance > 0.0).map(|(_, point, feature)| (point, feature))
}
