//! Convex shapes, with only the data of the flush-joint test of [`super::inner`].

use crate::geometry::PosedPolyhedron;
use crate::math::{Quat, Vec3};

/// Convex shape, with only the data of the flush-joint test.
pub enum ConvexSolid<'a> {
    Sphere {
        radius: f64,
    },
    Cuboid {
        axes: &'a Quat,
        half_lengths: &'a Vec3,
    },
    Polyhedron(&'a PosedPolyhedron<'a>),
    /// Capsule about the third axis.
    Capsule {
        axes: &'a Quat,
        half_length: f64,
        radius: f64,
    },
    /// Cylinder about the third axis.
    Cylinder {
        axes: &'a Quat,
        half_height: f64,
        radius: f64,
    },
}

impl ConvexSolid<'_> {
    /// Largest n·x, x from the centre, m.
    pub fn support_height(&self, n: &Vec3) -> f64 {
        match self {
            ConvexSolid::Sphere { radius } => *radius,
            ConvexSolid::Cuboid { axes, half_lengths } => axes.inverse_transform_vector(n).abs().dot(half_lengths),
            ConvexSolid::Polyhedron(posed) => posed.support_height(n),
            ConvexSolid::Capsule { axes, half_length, radius } => {
                half_length * (*axes * Vec3::z()).dot(n).abs() + radius
            }
            ConvexSolid::Cylinder { axes, half_height, radius } => {
                let local = axes.inverse_transform_vector(n);
                half_height * local.z.abs() + radius * local.xy().norm()
            }
        }
    }

    /// Normal of the face closest to `n`, and the distance of its plane from the centre, m. For a cylinder the faces are
    /// its ends; a sphere and a capsule have none.
    pub fn face_along(&self, n: &Vec3) -> Option<(Vec3, f64)> {
        match self {
            ConvexSolid::Sphere { .. } | ConvexSolid::Capsule { .. } => None,
            ConvexSolid::Cuboid { axes, half_lengths } => {
                let local = axes.inverse_transform_vector(n);
                let axis = local.iamax();
                let mut normal = Vec3::zeros();
                normal[axis] = 1f64.copysign(local[axis]);
                Some((*axes * normal, half_lengths[axis]))
            }
            ConvexSolid::Polyhedron(posed) => Some(posed.face_along(n)),
            ConvexSolid::Cylinder { axes, half_height, .. } => {
                let axis = *axes * Vec3::z();
                Some((axis * 1f64.copysign(axis.dot(n)), *half_height))
            }
        }
    }
}
