//! Regions of space in COMPUTE.RON: those of sinks, and those of means.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::geometry::convex_region::ConvexRegion;

/// Part of space that contains bodies by their centres of mass.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum SpaceRegion {
    /// Farther than `radius` (m) from `centre` (m).
    Beyond { centre: [f64; 3], radius: f64 },
    /// Half space on the side of the plane through `point` (m) from which `normal` points away.
    Below { point: [f64; 3], normal: [f64; 3] },
    /// Nearer than `radius` (m) to `centre` (m).
    Ball { centre: [f64; 3], radius: f64 },
    /// Between two opposite corners (m), along the fixed axes.
    Box { lower: [f64; 3], upper: [f64; 3] },
    /// Within `radius` (m) of the segment from `start` to `end` (m), and between the planes through its ends.
    Cylinder { start: [f64; 3], end: [f64; 3], radius: f64 },
}

impl SpaceRegion {
    /// Whether the region contains the position `x` (m).
    pub fn contains(&self, x: &[f64; 3]) -> bool {
        let offset_from = |origin: &[f64; 3]| difference(x, origin);
        match self {
            SpaceRegion::Beyond { centre, radius } => square(&offset_from(centre)) > radius * radius,
            SpaceRegion::Below { point, normal } => dot(&offset_from(point), normal) < 0.0,
            SpaceRegion::Ball { centre, radius } => square(&offset_from(centre)) < radius * radius,
            SpaceRegion::Box { lower, upper } => (0..3).all(|k| lower[k] < x[k] && x[k] < upper[k]),
            SpaceRegion::Cylinder { start, end, radius } => {
                let (axis, arm) = (difference(end, start), offset_from(start));
                let (length_squared, along) = (square(&axis), dot(&arm, &axis));
                let off_axis: [f64; 3] = std::array::from_fn(|k| arm[k] - axis[k] * (along / length_squared));
                0.0 < along && along < length_squared && square(&off_axis) < radius * radius
            }
        }
    }

    /// The same region with a volume, for means; `None` if the volume is infinite.
    pub fn convex_region(&self) -> Option<ConvexRegion> {
        match self {
            SpaceRegion::Beyond { .. } | SpaceRegion::Below { .. } => None,
            SpaceRegion::Ball { centre, radius } => {
                Some(ConvexRegion::Ball { centre: (*centre).into(), radius: *radius })
            }
            SpaceRegion::Box { lower, upper } => {
                let [lower, upper] = [lower, upper].map(|corner| Vector3::from(*corner));
                Some(ConvexRegion::Box { centre: 0.5 * (lower + upper), half: 0.5 * (upper - lower) })
            }
            SpaceRegion::Cylinder { start, end, radius } => {
                let [start, end] = [start, end].map(|end| Vector3::from(*end));
                let (centre, axis) = (0.5 * (start + end), end - start);
                let length = axis.norm();
                Some(ConvexRegion::Cylinder { centre, axis: axis / length, radius: *radius, half: 0.5 * length })
            }
        }
    }

    /// Requirement that the numbers do not meet.
    pub(crate) fn invalid_value(&self) -> Option<&'static str> {
        let are_finite = |vectors: &[&[f64; 3]]| vectors.iter().all(|v| v.iter().all(|x| x.is_finite()));
        let is_positive = |x: f64| x.is_finite() && x > 0.0;
        match self {
            SpaceRegion::Beyond { centre, radius } | SpaceRegion::Ball { centre, radius } => {
                (!(are_finite(&[centre]) && is_positive(*radius))).then_some("a finite centre and a radius > 0 m")
            }
            SpaceRegion::Below { point, normal } => {
                let sound = are_finite(&[point, normal]) && is_positive(square(normal));
                (!sound).then_some("a finite point and a normal other than 0")
            }
            SpaceRegion::Box { lower, upper } => {
                let sound = are_finite(&[lower, upper]) && (0..3).all(|k| lower[k] < upper[k]);
                (!sound).then_some("finite corners, each coordinate of lower less than that of upper")
            }
            SpaceRegion::Cylinder { start, end, radius } => {
                let sound =
                    are_finite(&[start, end]) && is_positive(square(&difference(end, start))) && is_positive(*radius);
                (!sound).then_some("two finite ends that differ, and a radius > 0 m")
            }
        }
    }
}

fn difference(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn square(v: &[f64; 3]) -> f64 {
    dot(v, v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_are_open_sets() {
        let origin = [0.0; 3];
        let beyond = SpaceRegion::Beyond { centre: [1.0, 0.0, 0.0], radius: 2.0 };
        assert_eq!([-1.0, -1.5, 3.0, 3.5].map(|x| beyond.contains(&[x, 0.0, 0.0])), [false, true, false, true]);
        let ball = SpaceRegion::Ball { centre: origin, radius: 2.0 };
        assert_eq!([0.0, 1.5, 2.0, 2.5].map(|x| ball.contains(&[x, 0.0, 0.0])), [true, true, false, false]);
        let below = SpaceRegion::Below { point: [0.0, 0.0, 1.0], normal: [0.0, 0.0, 3.0] };
        assert_eq!([0.5, 1.0, 1.5].map(|z| below.contains(&[9.0, 9.0, z])), [true, false, false]);
        let cuboid = SpaceRegion::Box { lower: origin, upper: [1.0, 2.0, 3.0] };
        assert!(cuboid.contains(&[0.5, 1.5, 2.5]) && !cuboid.contains(&[0.5, 1.5, 3.0]));
        let cylinder = SpaceRegion::Cylinder { start: origin, end: [0.0, 4.0, 0.0], radius: 1.0 };
        let at = |x: f64, y: f64| cylinder.contains(&[x, y, 0.0]);
        assert!(at(0.5, 1.0) && at(-0.9, 3.9) && !at(1.0, 1.0) && !at(0.5, 4.0) && !at(0.5, 0.0));
    }
}
