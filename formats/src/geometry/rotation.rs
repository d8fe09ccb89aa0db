//! Rotations from axes in files, which are orthonormal up to the rounding of their digits.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

/// Largest difference of axes in a file, which are orthonormal to 1e-4, from their nearest rotation, with a margin.
const MAX_AXES_ERROR: f64 = 0.01;

/// Rotation that is nearest to right-handed axes, the columns of `axes`, which are orthonormal to about 1e-4.
///
/// ```
/// use cd_formats::rotation::nearest_rotation;
/// use nalgebra::Matrix3;
/// let axes = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
/// assert!((nearest_rotation(&axes).matrix() - axes).norm() < 1e-14); // some roundings
/// ```
pub fn nearest_rotation(axes: &Matrix3<f64>) -> Rotation3<f64> {
    let refined_rotation = |guess| Rotation3::from_matrix_eps(axes, 1e-15, 100, guess);
    let rotation = refined_rotation(Rotation3::identity());
    if (rotation.matrix() - axes).norm() < MAX_AXES_ERROR {
        return rotation;
    }
    // The iteration does not leave a rotation that is half a turn away: its direction is not determined there.
    refined_rotation(
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*axes)).to_rotation_matrix(),
    )
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use nalgebra::{Unit, Vector3};

    #[test]
    fn turns_by_any_angle_are_found_also_half_turns() {
        for axis in [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 0.0], [0.3, -0.4, 0.5], [-1.0, 2.0, 3.0]] {
            let axis = Unit::new_normalize(Vector3::from(axis));
            for angle in [0.0, 0.1, 1.0, 3.0, PI - 3e-6, PI, -PI, PI + 1e-5, 6.0] {
                let turn = Rotation3::from_axis_angle(&axis, angle);
                // Also with the seven digits of the files.
                let written = turn.matrix().map(|x| (x * 1e7).round() / 1e7);
                for (axes, rounding) in [(*turn.matrix(), 1e-14), (written, 2e-7)] {
                    let found = nearest_rotation(&axes);
                    assert!((found.matrix() - turn.matrix()).norm() < rounding, "{axis:?} {angle}: {found}");
                }
            }
        }
    }
}
