//! Matrices of the rotations that a scene gives by axis and angle.

use nalgebra::{Matrix3, Vector3};

use crate::scene::Rotation;

/// Rotation matrix (Rodrigues' formula); the identity for an angle of 0. The axis must not be 0.
pub fn rotation_matrix(rotation: &Rotation) -> Matrix3<f64> {
    let Rotation { axis, angle } = *rotation;
    let axis = Vector3::from(axis).normalize();
    let (sin, cos) = libm::sincos(angle);
    Matrix3::identity() * cos + axis.cross_matrix() * sin + axis * axis.transpose() * (1.0 - cos)
}
