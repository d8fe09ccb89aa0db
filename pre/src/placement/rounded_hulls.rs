//! Shapes as convex hulls of points inflated by a radius, and the distances between them.

use nalgebra::{Matrix3, Vector3};
use parry3d_f64::math::{Pose, Vector as Point};
use parry3d_f64::query::details::contact_support_map_support_map_with_params;
use parry3d_f64::query::gjk::{GJKResult, VoronoiSimplex};
use parry3d_f64::shape::SupportMap;

use crate::shapes::OrientedShape;
use crate::shapes::round::PRISM_SIDES;

/// Convex hull of points, inflated by a radius: a ball of one point, a capsule of two, a polyhedron with the radius 0.
#[derive(Debug, Clone, PartialEq)]
pub struct RoundedHull {
    /// Points about the position of the body, m.
    pub points: Vec<Vector3<f64>>,
    /// m
    pub radius: f64,
    /// Centre of a ball that contains the points, m.
    centre: Vector3<f64>,
    /// Radius of this ball, m.
    reach: f64,
}

/// Nearest or deepest points of two hulls of points, without their radii.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HullGap {
    /// Distance of the hulls along `normal`, m: a lower bound of their distance; negative when they overlap along it.
    pub distance: f64,
    /// Unit vector from the first hull to the second.
    pub normal: Vector3<f64>,
    /// Points of the first and of the second hull, m, about the position of the first body.
    pub points: [Vector3<f64>; 2],
}

impl RoundedHull {
    /// Hull of `points`, m, inflated by `radius`, m.
    pub fn new(points: Vec<Vector3<f64>>, radius: f64) -> RoundedHull {
        let centre = points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64;
        let reach = points.iter().map(|point| (point - centre).norm()).fold(0.0, f64::max);
        RoundedHull { points, radius, centre, reach }
    }

    /// Box of half lengths (m) along `axes` (rows).
    pub fn from_box(axes: &Matrix3<f64>, half_lengths: &Vector3<f64>) -> RoundedHull {
        let corner = |k: usize| {
            Vector3::from_fn(|axis, _| if k >> axis & 1 == 0 { -half_lengths[axis] } else { half_lengths[axis] })
        };
        RoundedHull::new((0..8).map(|k| axes.transpose() * corner(k)).collect(), 0.0)
    }

    /// Prism around a cylinder of these lengths, m, along the third of `axes` (rows).
    pub fn around_cylinder(axes: &Matrix3<f64>, half_height: f64, radius: f64) -> RoundedHull {
        let sector = std::f64::consts::TAU / f64::from(PRISM_SIDES);
        let corner_radius = radius / libm::cos(0.5 * sector);
        let corners = |k: u32| {
            let (sin, cos) = libm::sincos(sector * f64::from(k));
            [1.0, -1.0].map(|side| {
                axes.transpose() * Vector3::new(corner_radius * cos, corner_radius * sin, side * half_height)
            })
        };
        RoundedHull::new((0..PRISM_SIDES).flat_map(corners).collect(), 0.0)
    }

    /// Hulls of a grain: of the pieces of a polyhedron, the balls of a clump, a capsule, the prism around a cylinder.
    /// `radius`: that of a sphere, m; `rotation` turns the fixed axes into those of the hulls.
    pub fn from_shape(shape: &OrientedShape, radius: f64, rotation: &Matrix3<f64>) -> Vec<RoundedHull> {
        match shape {
            OrientedShape::Sphere => vec![RoundedHull::new(vec![Vector3::zeros()], radius)],
            OrientedShape::Polyhedron(polyhedron) => {
                let to_hull_axes = rotation * polyhedron.axes.transpose();
                let hull = |vertices: Vec<[f64; 3]>| {
                    RoundedHull::new(vertices.into_iter().map(|v| to_hull_axes * Vector3::from(v)).collect(), 0.0)
                };
                polyhedron.vertices().into_iter().map(hull).collect()
            }
            OrientedShape::Clump(clump) => {
                let to_hull_axes = rotation * clump.axes.transpose();
                clump.balls().map(|ball| RoundedHull::new(vec![to_hull_axes * ball.centre], ball.radius)).collect()
            }
            OrientedShape::RoundSolid(solid) => {
                let axes = solid.axes * rotation.transpose();
                let end = axes.row(2).transpose() * solid.shape.half_length;
                vec![if solid.shape.is_capsule {
                    RoundedHull::new(vec![end, -end], solid.shape.radius)
                } else {
                    RoundedHull::around_cylinder(&axes, solid.shape.half_length, solid.shape.radius)
                }]
            }
        }
    }

    /// Hull with another radius, m.
    pub fn with_radius(self, radius: f64) -> RoundedHull {
        RoundedHull { radius, ..self }
    }

    /// Hull with all lengths times `factor`.
    pub fn with_scale(&self, factor: f64) -> RoundedHull {
        RoundedHull {
            points: self.points.iter().map(|point| factor * point).collect(),
            radius: factor * self.radius,
            centre: factor * self.centre,
            reach: factor * self.reach,
        }
    }

    /// Sets the hull to `original` after a rotation.
    pub fn set_rotated(&mut self, original: &RoundedHull, rotation: &Matrix3<f64>) {
        for (point, first) in self.points.iter_mut().zip(&original.points) {
            *point = rotation * first;
        }
        self.centre = rotation * original.centre;
    }

    /// Smallest and largest coordinates of the points, m.
    pub fn bounds(&self) -> [Vector3<f64>; 2] {
        let first = [Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)];
        self.points.iter().fold(first, |[low, high], point| [low.inf(point), high.sup(point)])
    }

    /// Point that is farthest along a direction, m.
    fn support_point(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        let higher_point = |best: (f64, Vector3<f64>), point: &Vector3<f64>| {
            let height = point.dot(direction);
            if height > best.0 { (height, *point) } else { best }
        };
        self.points.iter().fold((f64::NEG_INFINITY, Vector3::zeros()), higher_point).1
    }
}

/// Hull in units of a length, m.
struct UnitHull<'a> {
    hull: &'a RoundedHull,
    unit: f64,
}

impl SupportMap for UnitHull<'_> {
    fn local_support_point(&self, direction: Point) -> Point {
        let point = self.hull.support_point(&Vector3::new(direction.x, direction.y, direction.z)) / self.unit;
        Point::new(point.x, point.y, point.z)
    }
}

/// Gap of the hulls of points of `first` and of `second`, whose body is at `separation`, m, from that of `first`; none if they
/// are at least `limit`, m, apart. `unit`: a length of about their size, m.
///
/// The direction is that of parry's GJK and EPA, or along the centres if these find none. The distance is that of the two
/// hulls along it: whatever the direction, they are at least so far apart.
pub fn hull_gap(
    first: &RoundedHull,
    second: &RoundedHull,
    separation: &Vector3<f64>,
    limit: f64,
    unit: f64,
) -> Option<HullGap> {
    let between_centres = separation + second.centre - first.centre;
    let centre_distance = between_centres.norm();
    if centre_distance - first.reach - second.reach >= limit {
        return None;
    }
    let along_centres = if centre_distance > 0.0 { between_centres / centre_distance } else { Vector3::x() };
    let supports = |normal: &Vector3<f64>| [first.support_point(normal), separation + second.support_point(&-normal)];
    let gap = |normal: Vector3<f64>, points: [Vector3<f64>; 2]| {
        let [a, b] = supports(&normal);
        HullGap { distance: (b - a).dot(&normal), normal, points }
    };
    let central_gap = || gap(along_centres, supports(&along_centres));
    let found = if first.points.len() == 1 && second.points.len() == 1 {
        central_gap()
    } else {
        let vector = |v: Point| Vector3::new(v.x, v.y, v.z);
        let pose = Pose::translation(separation.x / unit, separation.y / unit, separation.z / unit);
        let [first_unit, second_unit] = [first, second].map(|hull| UnitHull { hull, unit });
        let mut simplex = VoronoiSimplex::new();
        match contact_support_map_support_map_with_params(
            &pose,
            &first_unit,
            &second_unit,
            limit / unit,
            &mut simplex,
            None,
        ) {
            GJKResult::ClosestPoints(a, b, normal) if normal.length() > 0.5 => {
                gap(vector(normal).normalize(), [a, b].map(|p| unit * vector(p)))
            }
            GJKResult::NoIntersection(direction) if direction.length() > 0.5 => {
                let normal = vector(direction).normalize();
                let apart = gap(normal, supports(&normal));
                // Rounding of the limit.
                if apart.distance >= (1.0 - 1e-9) * limit {
                    return None;
                }
                let central = central_gap();
                if central.distance > apart.distance { central } else { apart }
            }
            _ => central_gap(),
        }
    };
    (found.distance < limit).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{RandomStream, StreamPurpose};
    use crate::scene::GrainShape;
    use crate::shapes::overlap::{ConvexPiece, overlap_depth};
    use crate::shapes::{hull, regular};

    /// Distance and normal of two hulls, the second at `separation`.
    fn gap(first: &RoundedHull, second: &RoundedHull, separation: [f64; 3]) -> Option<(f64, Vector3<f64>)> {
        hull_gap(first, second, &separation.into(), 100.0, 1.0).map(|gap| (gap.distance, gap.normal))
    }

    #[test]
    fn gaps_known_by_hand() {
        let cube = RoundedHull::from_box(&Matrix3::identity(), &Vector3::repeat(1.0));
        let point = RoundedHull::new(vec![Vector3::zeros()], 0.5);
        let rod = RoundedHull::new(vec![Vector3::z(), -Vector3::z()], 0.25);
        for (first, second, separation, distance, normal) in [
            (&cube, &cube, [2.5, 0.3, -0.2], 0.5, [1.0, 0.0, 0.0]),
            (&cube, &cube, [0.3, -1.75, 0.2], -0.25, [0.0, -1.0, 0.0]),
            (&cube, &cube, [3.0, 4.0, 0.0], 5f64.sqrt(), [1.0 / 5f64.sqrt(), 2.0 / 5f64.sqrt(), 0.0]),
            (&cube, &point, [0.2, 0.1, 1.5], 0.5, [0.0, 0.0, 1.0]),
            (&cube, &point, [0.2, 0.1, 0.75], -0.25, [0.0, 0.0, 1.0]),
            (&point, &point, [0.0, 3.0, 4.0], 5.0, [0.0, 0.6, 0.8]),
            (&rod, &point, [3.0, 0.0, 0.5], 3.0, [1.0, 0.0, 0.0]),
            (&rod, &rod, [0.0, 2.0, 0.5], 2.0, [0.0, 1.0, 0.0]),
            (&rod, &cube, [1.75, 0.0, 0.5], 0.75, [1.0, 0.0, 0.0]),
        ] {
            let found = gap(first, second, separation).unwrap();
            // The tolerance of GJK is 1e-7 of the distance, here of the direction.
            assert!((found.0 - distance).abs() < 1e-12, "{separation:?}: {found:?} {distance}");
            assert!((found.1 - Vector3::from(normal)).norm() < 1e-6, "{separation:?}: {found:?}");
        }
        assert_eq!(hull_gap(&cube, &cube, &Vector3::new(2.5, 0.0, 0.0), 0.499, 1.0), None);
        // Rods that cross have no volume in common, but a way out of each other.
        let across = RoundedHull::new(vec![Vector3::x(), -Vector3::x()], 0.25);
        assert!(gap(&rod, &across, [0.1, 0.0, 0.2]).unwrap().0 <= 0.0);
    }

    /// The prism around a cylinder reaches out of it by 1/cos(pi/32) - 1 of the radius.
    #[test]
    fn prisms_contain_their_cylinders() {
        let prism = RoundedHull::around_cylinder(&Matrix3::identity(), 2.0, 1.0);
        for k in 0..100 {
            let (sin, cos) = libm::sincos(0.0628 * f64::from(k));
            let along = prism.support_point(&Vector3::new(cos, sin, 0.0)).dot(&Vector3::new(cos, sin, 0.0));
            assert!((1.0..1.005).contains(&(along + 1e-15)), "{along}");
        }
        assert_eq!(prism.bounds()[1].z, 2.0);
    }

    /// The direction need not be the best one, but the hulls are at least `distance` apart along it. The separating axes of faces
    /// and edges are complete for overlaps.
    #[test]
    fn depths_are_those_of_the_separating_axes() {
        let mut random = RandomStream::new(3, 0, StreamPurpose::Shape);
        let surface = hull::convex_hull(&regular::shape_vertices(&GrainShape::Icosahedron)).unwrap();
        let mut counts = [0, 0];
        for _ in 0..300 {
            let stretch = Matrix3::from_diagonal(&Vector3::new(1.0, 0.6, 0.4));
            let mut shape = || {
                let rotation = random.uniform_rotation() * stretch;
                surface.vertices().iter().map(|&v| rotation * Vector3::from(v)).collect::<Vec<_>>()
            };
            let (first, second) = (shape(), shape());
            let separation = 2.5 * random.point_in_cube();
            let piece =
                |points: &[Vector3<f64>], centre| ConvexPiece::new(centre, points.to_vec(), surface.triangles());
            let depth = overlap_depth(&piece(&first, Vector3::zeros()), &piece(&second, separation), f64::NEG_INFINITY);
            let [first, second] = [first, second].map(|points| RoundedHull::new(points, 0.0));
            let found = hull_gap(&first, &second, &separation, 100.0, 1.0).unwrap();
            if depth > 0.0 {
                assert!((found.distance + depth).abs() < 1e-9, "{} {depth}", found.distance);
            } else {
                assert!(found.distance >= -depth - 1e-12, "{} {depth}", found.distance);
            }
            counts[usize::from(depth > 0.0)] += 1;
        }
        assert!(counts.iter().all(|count| *count > 50), "{counts:?}");
    }
}
