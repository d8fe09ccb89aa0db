//! The gap, normal and point of one pair.

use cd_formats::wall_mesh::{MeshContact, TriangleList, WallMesh};

use crate::geometry::{CYLINDER_END, CYLINDER_OTHER_END, CYLINDER_RIM, CYLINDER_SIDE, WallContacts};
use crate::math::{Quat, Vec3};

/// Feature of a plate: the face along its third axis.
pub const PLATE_UPPER_FACE: u32 = 0;
/// Feature of a plate: the face against its third axis.
pub const PLATE_LOWER_FACE: u32 = 1;
/// Feature of a plate: its edges and sides.
pub const PLATE_RIM: u32 = 2;

/// Geometry of one point of contact.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ContactGeometry {
    /// Gap, m, < 0 interpenetrating.
    pub gap: f64,
    /// Unit normal from the antagonist to the candidate.
    pub normal: Vec3,
    /// Contact point, m. Both bodies share it, so that a contact's impulse conserves angular momentum. It divides the
    /// distance of two spheres in the ratio of their radii, and is the middle of the gap between sphere and plate.
    pub point: Vec3,
    /// Feature of the antagonist.
    pub feature: u32,
}

/// Contact of sphere `a` (candidate) with sphere `b`: centres in the world frame and radii, m. If the centres coincide, the
/// normal is x.
///
/// ```
/// # use cd_solve::{detect::narrow::sphere_sphere, math::Vec3};
/// let found = sphere_sphere(&(Vec3::x() * 4.5), 3.0, &Vec3::zeros(), 1.0);
/// assert_eq!((found.gap, found.normal, found.point), (0.5, Vec3::x(), Vec3::x() * 1.125));
/// ```
pub fn sphere_sphere(a: &Vec3, radius_a: f64, b: &Vec3, radius_b: f64) -> ContactGeometry {
    let between = a - b;
    let distance = between.norm();
    let normal = if distance > 0.0 { between / distance } else { Vec3::x() };
    let gap = distance - (radius_a + radius_b);
    ContactGeometry { gap, normal, point: b + normal * (distance * (radius_b / (radius_a + radius_b))), feature: 0 }
}

/// Contact of a sphere (candidate) with a plate at its nearest point; for a centre inside the plate, with the nearer face.
///
/// Centres are in the world frame, m; `orientation` rotates the plate's axes to the world; `half_lengths` are along these
/// axes, m.
pub fn sphere_plane(
    centre: &Vec3,
    radius: f64,
    plate: &Vec3,
    orientation: &Quat,
    half_lengths: &Vec3,
) -> ContactGeometry {
    let local = orientation.inverse_transform_vector(&(centre - plate));
    let nearest = Vec3::from_fn(|k, _| local[k].clamp(-half_lengths[k], half_lengths[k]));
    let away = local - nearest;
    let (distance, normal, feature) = if away.z != 0.0 && away.x == 0.0 && away.y == 0.0 {
        (away.z.abs(), Vec3::z() * away.z.signum(), if away.z > 0.0 { PLATE_UPPER_FACE } else { PLATE_LOWER_FACE })
    } else if away.norm() > 0.0 {
        (away.norm(), away.normalize(), PLATE_RIM)
    } else if local.z >= 0.0 {
        (local.z - half_lengths.z, Vec3::z(), PLATE_UPPER_FACE)
    } else {
        (-local.z - half_lengths.z, -Vec3::z(), PLATE_LOWER_FACE)
    };
    let normal = orientation * normal;
    let gap = distance - radius;
    ContactGeometry { gap, normal, point: centre - normal * (radius + 0.5 * gap), feature }
}

/// Contacts of a sphere (candidate) with a cylinder of `[half height, radius]` (m) along its third axis. A solid cylinder has
/// one contact at its nearest point, or at the nearest face for a centre inside it. A hollow cylinder is closed: its side
/// and the nearer end are touched from inside.
pub fn sphere_cylinder(
    centre: &Vec3,
    radius: f64,
    cylinder: &Vec3,
    orientation: &Quat,
    [half_height, cylinder_radius]: [f64; 2],
    hollow: bool,
) -> [Option<ContactGeometry>; 2] {
    let local = orientation.inverse_transform_vector(&(centre - cylinder));
    let rho = libm::hypot(local.x, local.y);
    let outward = if rho > 0.0 { Vec3::new(local.x / rho, local.y / rho, 0.0) } else { Vec3::x() };
    let up = Vec3::z() * 1f64.copysign(local.z);
    let end = if local.z >= 0.0 { CYLINDER_END } else { CYLINDER_OTHER_END };
    let (side_distance, end_distance) = (rho - cylinder_radius, local.z.abs() - half_height);
    let contact = |normal: Vec3, distance: f64, feature: u32| {
        let (normal, gap) = (orientation * normal, distance - radius);
        Some(ContactGeometry { gap, normal, point: centre - normal * (radius + 0.5 * gap), feature })
    };
    if hollow {
        return [contact(-outward, -side_distance, CYLINDER_SIDE), contact(-up, -end_distance, end)];
    }
    let solid = if side_distance > 0.0 && end_distance > 0.0 {
        let distance = libm::hypot(side_distance, end_distance);
        contact((outward * side_distance + up * end_distance) / distance, distance, CYLINDER_RIM)
    } else if side_distance >= end_distance {
        contact(outward, side_distance, CYLINDER_SIDE)
    } else {
        contact(up, end_distance, end)
    };
    [solid, None]
}

/// Contacts of a sphere (candidate) about the origin with the surface of a wall at `wall`, m, with this orientation, up to
/// the gap `range`, m; `nearby_triangles`: those near the sphere in the last step.
pub fn sphere_mesh(
    mesh: &WallMesh,
    nearby_triangles: &mut TriangleList,
    radius: f64,
    (wall, orientation): (&Vec3, &Quat),
    range: f64,
) -> WallContacts<ContactGeometry> {
    let centre = orientation.inverse_transform_vector(&-wall);
    let found = mesh.listed_ball_contacts(nearby_triangles, &centre, radius, range);
    if found.is_empty() {
        // A sphere that moves by less than its radius is not searched again. Behind a surface it may be nearer.
        let bound = mesh.distance_bound(&centre, 2.0 * radius + range) - radius;
        return WallContacts::without_contacts(bound, range);
    }
    let geometry = |contact: &MeshContact| {
        let (normal, gap) = (orientation * contact.normal, contact.distance - radius);
        ContactGeometry { gap, normal, point: -normal * (radius + 0.5 * gap), feature: contact.feature }
    };
    WallContacts::Listed(found.iter().map(geometry).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coincident_spheres_have_a_definite_normal() {
        let found = sphere_sphere(&Vec3::zeros(), 1.0, &Vec3::zeros(), 2.0);
        assert_eq!((found.gap, found.normal), (-3.0, Vec3::x()));
    }

    #[test]
    fn plates_are_met_on_faces_rims_and_from_within() {
        let half = Vec3::new(2.0, 1.0, 0.5);
        let at = |x, y, z| sphere_plane(&Vec3::new(x, y, z), 0.25, &Vec3::zeros(), &Quat::identity(), &half);
        let above = at(0.3, 0.2, 1.0);
        assert_eq!((above.gap, above.normal, above.feature), (0.25, Vec3::z(), PLATE_UPPER_FACE));
        assert_eq!(above.point, Vec3::new(0.3, 0.2, 0.625));
        let below = at(0.3, 0.2, -1.0);
        assert_eq!((below.gap, below.normal, below.feature), (0.25, -Vec3::z(), PLATE_LOWER_FACE));
        let nearest = at(2.3, 0.0, 0.9);
        assert_eq!(nearest.feature, PLATE_RIM);
        // 3-4-5: the rim is 0.5 m away.
        assert!((nearest.gap - 0.25).abs() < 1e-15 && (nearest.normal - Vec3::new(0.6, 0.0, 0.8)).norm() < 1e-15);
        let inside = at(0.0, 0.0, 0.4);
        assert_eq!((inside.normal, inside.feature), (Vec3::z(), PLATE_UPPER_FACE));
        assert!((inside.gap + 0.35).abs() < 1e-16);
    }

    #[test]
    fn cylinders_are_met_outside_at_their_rims_and_inside() {
        // Radius 2, half height 1, its axis along x.
        let turn = Quat::from_scaled_axis(Vec3::y() * std::f64::consts::FRAC_PI_2);
        let at = |x, y, z, hollow| {
            sphere_cylinder(&Vec3::new(x, y, z), 0.25, &Vec3::zeros(), &turn, [1.0, 2.0], hollow)
                .map(Option::unwrap_or_default)
        };
        let check = |found: ContactGeometry, gap: f64, normal: [f64; 3], feature: u32| {
            // Tolerance: a few roundings of numbers up to 3, whose difference is the distance.
            assert!((found.gap - gap).abs() < 1e-14 && (found.normal - Vec3::from(normal)).norm() < 1e-14, "{found:?}");
            assert_eq!(found.feature, feature);
        };
        check(at(0.5, 2.5, 0.0, false)[0], 0.25, [0.0, 1.0, 0.0], CYLINDER_SIDE);
        check(at(1.5, 0.5, 0.0, false)[0], 0.25, [1.0, 0.0, 0.0], CYLINDER_END);
        check(at(-1.3, 0.0, 2.4, false)[0], 0.25, [-0.6, 0.0, 0.8], CYLINDER_RIM);
        check(at(-0.9, 0.0, 0.0, false)[0], -0.35, [-1.0, 0.0, 0.0], CYLINDER_OTHER_END);
        let [side, end] = at(0.5, 0.0, -1.5, true);
        check(side, 0.25, [0.0, 0.0, 1.0], CYLINDER_SIDE);
        check(end, 0.25, [-1.0, 0.0, 0.0], CYLINDER_END);
    }

    #[test]
    fn a_turned_plate_turns_the_contact() {
        let turn = Quat::from_scaled_axis(Vec3::y() * std::f64::consts::FRAC_PI_2);
        let found = sphere_plane(&Vec3::new(2.0, 0.0, 0.0), 0.5, &Vec3::x(), &turn, &Vec3::new(3.0, 3.0, 0.25));
        // The third axis points along x; a few roundings of numbers near 1.
        assert!((found.gap - 0.25).abs() < 1e-15 && (found.normal - Vec3::x()).norm() < 1e-15);
    }
}
