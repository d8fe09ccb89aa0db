//! Cylinders and capsules as grains, about the third of their principal axes.

use cd_formats::bodies::{Contactor, ShapeRecord};
use cd_formats::surface::MassProperties;
use nalgebra::{Matrix3, Vector3};

use crate::rounding::{round_8_digits, round_axes};
use crate::shapes::hull::convex_hull;
use crate::shapes::overlap::ConvexPiece;
use crate::shapes::union::ClumpBall;

/// Number of sides of the prisms in and around a cylinder, with which its overlaps are checked and it is packed.
pub const PRISM_SIDES: u32 = 32;
/// Spacing of the balls with which overlaps of a capsule are checked, divided by its radius, and their largest number.
const BALL_SPACING: f64 = 0.2;
const MAX_INTERVALS: f64 = 1000.0;

/// Cylinder or capsule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoundSolid {
    /// Half of the height of a cylinder, or of the length of the segment of a capsule, m.
    pub half_length: f64,
    /// m
    pub radius: f64,
    /// Whether it is a capsule.
    pub is_capsule: bool,
}

impl RoundSolid {
    /// Solid of a capsule or solid cylinder; `None` for other contactors.
    pub fn from_record(shape: &ShapeRecord) -> Option<RoundSolid> {
        match *shape {
            ShapeRecord::Capsule { half_length, radius } => Some(RoundSolid { half_length, radius, is_capsule: true }),
            ShapeRecord::Cylinder { half_height, radius, hollow: false } => {
                Some(RoundSolid { half_length: half_height, radius, is_capsule: false })
            }
            _ => None,
        }
    }

    /// Contactor of the solid.
    pub fn to_record(self) -> ShapeRecord {
        let RoundSolid { half_length, radius, is_capsule } = self;
        if is_capsule {
            ShapeRecord::Capsule { half_length, radius }
        } else {
            ShapeRecord::Cylinder { half_height: half_length, radius, hollow: false }
        }
    }

    /// Volume and inertia at density 1.
    pub fn mass_properties(self) -> MassProperties {
        let contactor = Contactor { colour: String::new(), shape: self.to_record(), local_frame: None };
        contactor.mass_properties().unwrap_or_default()
    }

    /// Radius of the sphere of equal volume, m.
    pub fn equivalent_radius(self) -> f64 {
        libm::cbrt(0.75 * self.mass_properties().volume / std::f64::consts::PI)
    }

    /// Distance of the farthest point from the centre, m.
    pub fn reach(self) -> f64 {
        let RoundSolid { half_length, radius, is_capsule } = self;
        if is_capsule { half_length + radius } else { libm::hypot(half_length, radius) }
    }

    /// Balls along the axis of a capsule, the third one, that fill it but for a hundredth of its radius; none of a cylinder.
    fn balls(self) -> impl Iterator<Item = ClumpBall> {
        let RoundSolid { half_length, radius, is_capsule } = self;
        let intervals = libm::ceil(2.0 * half_length / (BALL_SPACING * radius)).clamp(1.0, MAX_INTERVALS) as u32;
        let centre = move |k: u32| half_length * (2.0 * f64::from(k) / f64::from(intervals) - 1.0);
        let balls = (0..=intervals).map(move |k| ClumpBall { centre: Vector3::z() * centre(k), radius });
        balls.filter(move |_| is_capsule)
    }

    /// Vertices of a prism inscribed in a cylinder, m.
    fn prism_vertices(self) -> Vec<[f64; 3]> {
        let RoundSolid { half_length, radius, .. } = self;
        let on_circle = |k: u32| {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(k) / f64::from(PRISM_SIDES));
            [1.0, -1.0].map(|side| [radius * cos, radius * sin, side * half_length])
        };
        (0..PRISM_SIDES).flat_map(on_circle).collect()
    }
}

/// Cylinder or capsule in its orientation; numbers have the digits of the files.
#[derive(Debug, Clone, PartialEq)]
pub struct OrientedRoundSolid {
    pub shape: RoundSolid,
    /// Principal axes along the fixed axes, one a row.
    pub axes: Matrix3<f64>,
}

impl OrientedRoundSolid {
    /// Cylinder or capsule with all lengths times `scale`, rotated by `rotation` from the fixed axes.
    pub fn new(shape: RoundSolid, scale: f64, rotation: &Matrix3<f64>) -> Self {
        let [half_length, radius] = [shape.half_length, shape.radius].map(|length| round_8_digits(scale * length));
        OrientedRoundSolid {
            shape: RoundSolid { half_length, radius, ..shape },
            axes: round_axes(&rotation.transpose()),
        }
    }

    /// Balls of a capsule at `position`, m; none of a cylinder.
    pub fn balls(&self, position: Vector3<f64>) -> impl Iterator<Item = ClumpBall> {
        let to_fixed_axes = self.axes.transpose();
        self.shape.balls().map(move |ball| ClumpBall { centre: position + to_fixed_axes * ball.centre, ..ball })
    }

    /// Prism inscribed in a cylinder at `position`, m; `None` of a capsule, or if it has no hull, as a needle may not.
    pub fn convex_piece(&self, position: Vector3<f64>) -> Option<ConvexPiece> {
        let hull = convex_hull(&self.shape.prism_vertices()).ok().filter(|_| !self.shape.is_capsule)?;
        let to_fixed_axes = self.axes.transpose();
        let vertices = hull.vertices().iter().map(|v| to_fixed_axes * Vector3::from(*v)).collect();
        Some(ConvexPiece::new(position, vertices, hull.triangles()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balls_reach_the_ends_of_a_capsule() {
        let capsule = RoundSolid { half_length: 1.0, radius: 0.5, is_capsule: true };
        let balls: Vec<ClumpBall> = capsule.balls().collect();
        assert_eq!((balls.len(), balls[0].centre.z, balls[20].centre.z), (21, -1.0, 1.0));
        assert_eq!(RoundSolid { is_capsule: false, ..capsule }.balls().count(), 0);
    }
}
