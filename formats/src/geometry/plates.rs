//! Plates opposite to walls.

use nalgebra::{Matrix3, Vector3};

/// Component of a direction across the normal of a plate up to which it is along that: rounding of files.
const MAX_NORMAL_TILT: f64 = 1e-6;

/// Distance from `start` along the unit vector `direction` to the face of a plate across it, m; `None` if the line misses the
/// plate, begins in or behind it, or is not along its normal to 1e-6.
///
/// * `centre`, `axes` (its axes as rows) and `half_lengths` of the plate, m.
///
/// ```
/// use cd_formats::geometry::plates::opposite_extent;
/// use nalgebra::{Matrix3, Vector3};
/// let plate = (&Vector3::new(0.0, 0.0, 3.0), &Matrix3::identity(), &Vector3::new(1.0, 2.0, 0.25));
/// let extent = |x: f64| opposite_extent(&Vector3::new(x, 0.0, 0.0), &Vector3::z(), plate);
/// assert_eq!([extent(0.5), extent(1.5)], [Some(2.75), None]);
/// ```
pub fn opposite_extent(
    start: &Vector3<f64>,
    direction: &Vector3<f64>,
    (centre, axes, half_lengths): (&Vector3<f64>, &Matrix3<f64>, &Vector3<f64>),
) -> Option<f64> {
    let own_direction = axes * direction;
    let from_start = axes * (centre - start);
    let hits = own_direction.xy().norm() <= MAX_NORMAL_TILT
        && from_start.x.abs() <= half_lengths.x
        && from_start.y.abs() <= half_lengths.y;
    let distance = (centre - start).dot(direction) - half_lengths.z;
    (hits && distance > 0.0).then_some(distance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_hit_plates_across_them() {
        // Its axes are -z, y and x.
        let axes = Matrix3::new(0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0);
        let extent = |start: [f64; 3], direction: Vector3<f64>| {
            opposite_extent(
                &start.into(),
                &direction,
                (&Vector3::new(3.0, 0.0, 0.0), &axes, &Vector3::new(1.0, 2.0, 0.25)),
            )
        };
        let distance = extent([0.0, 1.5, 0.5], Vector3::x()).unwrap();
        assert!((distance - 2.75).abs() < 1e-15);
        // Next to the plate, away from it, along it.
        assert_eq!(extent([0.0, 0.0, 1.5], Vector3::x()), None);
        assert_eq!(extent([0.0, 0.0, 0.0], -Vector3::x()), None);
        assert_eq!(extent([3.0, 0.0, -5.0], Vector3::z()), None);
    }
}
