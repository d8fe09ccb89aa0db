//! The gap, normal and point of one pair.

use crate::math::{Quat, Vec3};

/// Faces of a plate, as features.
pub const UPPER: u32 = 0;
pub const LOWER: u32 = 1;
pub const RIM: u32 = 2;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// m, < 0 interpenetrating.
    pub gap: f64,
    /// Unit, from the antagonist to the candidate.
    pub normal: Vec3,
    /// Middle of the gap, m: one point for both bodies, so that a contact's impulse conserves angular momentum.
    pub point: Vec3,
    /// Feature of the antagonist.
    pub feature: u32,
}

/// Sphere `a` against sphere `b`. Coincident centres part along x.
///
/// ```
/// # use cd_solve::{detect::narrow::sphere_sphere, math::Vec3};
/// let found = sphere_sphere(&(Vec3::x() * 3.5), 2.0, &Vec3::zeros(), 1.0);
/// assert_eq!((found.gap, found.normal, found.point), (0.5, Vec3::x(), Vec3::x() * 1.25));
/// ```
pub fn sphere_sphere(a: &Vec3, radius_a: f64, b: &Vec3, radius_b: f64) -> Found {
    let between = a - b;
    let distance = between.norm();
    let normal = if distance > 0.0 { between / distance } else { Vec3::x() };
    let gap = distance - (radius_a + radius_b);
    Found { gap, normal, point: b + normal * (radius_b + 0.5 * gap), feature: 0 }
}

/// A sphere against a plate: the nearest point of the plate; from within, the nearer contact face.
pub fn sphere_plane(centre: &Vec3, radius: f64, plate: &Vec3, orientation: &Quat, half_lengths: &Vec3) -> Found {
    let local = orientation.inverse_transform_vector(&(centre - plate));
    let nearest = Vec3::from_fn(|k, _| local[k].clamp(-half_lengths[k], half_lengths[k]));
    let away = local - nearest;
    let (distance, normal, feature) = if away.z != 0.0 && away.x == 0.0 && away.y == 0.0 {
        (away.z.abs(), Vec3::z() * away.z.signum(), if away.z > 0.0 { UPPER } else { LOWER })
    } else if away.norm() > 0.0 {
        (away.norm(), away.normalize(), RIM)
    } else if local.z >= 0.0 {
        (local.z - half_lengths.z, Vec3::z(), UPPER)
    } else {
        (-local.z - half_lengths.z, -Vec3::z(), LOWER)
    };
    let normal = orientation * normal;
    let gap = distance - radius;
    Found { gap, normal, point: centre - normal * (radius + 0.5 * gap), feature }
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
        assert_eq!((above.gap, above.normal, above.feature), (0.25, Vec3::z(), UPPER));
        assert_eq!(above.point, Vec3::new(0.3, 0.2, 0.625));
        let below = at(0.3, 0.2, -1.0);
        assert_eq!((below.gap, below.normal, below.feature), (0.25, -Vec3::z(), LOWER));
        let beside = at(2.3, 0.0, 0.9);
        assert_eq!(beside.feature, RIM);
        // 3-4-5: the rim is 0.5 m away.
        assert!((beside.gap - 0.25).abs() < 1e-15 && (beside.normal - Vec3::new(0.6, 0.0, 0.8)).norm() < 1e-15);
        let inside = at(0.0, 0.0, 0.4);
        assert_eq!((inside.normal, inside.feature), (Vec3::z(), UPPER));
        assert!((inside.gap + 0.35).abs() < 1e-16);
    }

    #[test]
    fn a_turned_plate_turns_the_contact() {
        let turn = Quat::from_scaled_axis(Vec3::y() * std::f64::consts::FRAC_PI_2);
        let found = sphere_plane(&Vec3::new(2.0, 0.0, 0.0), 0.5, &Vec3::x(), &turn, &Vec3::new(3.0, 3.0, 0.25));
        // The third axis points along x; a few roundings of numbers near 1.
        assert!((found.gap - 0.25).abs() < 1e-15 && (found.normal - Vec3::x()).norm() < 1e-15);
    }
}
