//! Solid cylinders and capsules on triangulated walls. A capsule is a cylinder of radius 0, its core, and all points up to
//! its radius from it.

use cd_formats::wall_mesh::{TriangleRegion, WallMesh};
use smallvec::SmallVec;

use super::outline::{BodyOutline, FlatDisc, FlatPolygon, OutlineKind};
use super::search::{AxisAttempt, MeshSearch, PosedTriangle, SurfaceBody, TouchAxis, nearest_on_segments};
use crate::geometry::capsule::rounded_manifold;
use crate::geometry::cylinder::{CYLINDER_END, CYLINDER_OTHER_END, CYLINDER_RIM, CYLINDER_SIDE, rim_to_edge};
use crate::geometry::manifold::{ContactPoint, ListingRange, Manifold, WallContacts};
use crate::math::{Quat, Vec3};

/// Sine of the angle between a direction and the axis, or the plane across it, up to which the two agree: far above the
/// rounding of unit vectors, far below a tilt that moves a point.
const MAX_ALIGNED_TILT: f64 = 1e-11;
/// Number of the lowest point of a rim among those of the rim; four fixed ones are before it, crossings with edges after it.
const LOWEST_RIM_POINT: u32 = 4;

/// Contacts of a solid cylinder A of `[half height, radius]` (m), with the orientation `axes`, its axis the third, with the
/// surface of a wall at `c` = x_B - x_A, m, with the orientation `q`: one manifold for each normal, or a lower bound of the
/// distance if all triangles are farther away than `range.alert`.
///
/// The round side touches along a line, of which the ends are points, an end at four fixed points and the lowest one of its rim.
/// The features of A are 0 for the side, 1 for the end along the axis, 2 for the other end, more for points on a rim.
///
/// ```
/// use cd_formats::wall_mesh::{MeshSides, WallMesh};
/// # use cd_solve::geometry::cylinder_mesh;
/// # use cd_solve::math::{Quat, Vec3};
/// let square = [[-2.0, -2.0, 0.0], [2.0, -2.0, 0.0], [2.0, 2.0, 0.0], [-2.0, 2.0, 0.0]];
/// let mesh = WallMesh::new(&square, &[[0, 1, 2], [0, 2, 3]], MeshSides::One).unwrap();
/// let (c, q) = (Vec3::z() * -0.625, Quat::identity());
/// let found = cylinder_mesh(&q, [0.5, 0.25], &mesh, &c, &q, 0.25.into()).into_contacts();
/// assert_eq!((found.len(), found[0].normal, found[0].gap(), found[0].points.len()), (1, Vec3::z(), 0.125, 4));
/// ```
pub fn cylinder_mesh(
    axes: &Quat,
    [half_height, radius]: [f64; 2],
    mesh: &WallMesh,
    c: &Vec3,
    q: &Quat,
    range: ListingRange,
) -> WallContacts<Manifold> {
    MeshSearch::new(CylinderBody { axes, half_height, radius }, mesh, c, q, (range, 0.0)).contacts()
}

/// Contacts of a capsule A of `[half length, radius]` (m), with the other arguments and results of [`cylinder_mesh`].
///
/// ```
/// use cd_formats::wall_mesh::{MeshSides, WallMesh};
/// # use cd_solve::geometry::capsule_mesh;
/// # use cd_solve::math::{Quat, Vec3};
/// let square = [[-2.0, -2.0, 0.0], [2.0, -2.0, 0.0], [2.0, 2.0, 0.0], [-2.0, 2.0, 0.0]];
/// let mesh = WallMesh::new(&square, &[[0, 1, 2], [0, 2, 3]], MeshSides::One).unwrap();
/// let (c, q) = (Vec3::z() * -0.875, Quat::identity());
/// let found = capsule_mesh(&q, [0.5, 0.25], &mesh, &c, &q, 0.25.into()).into_contacts();
/// assert_eq!((found.len(), found[0].normal, found[0].gap(), found[0].points.len()), (1, Vec3::z(), 0.125, 1));
/// assert_eq!(found[0].points[0].position, Vec3::z() * -0.8125);
/// ```
pub fn capsule_mesh(
    axes: &Quat,
    [half_length, radius]: [f64; 2],
    mesh: &WallMesh,
    c: &Vec3,
    q: &Quat,
    range: ListingRange,
) -> WallContacts<Manifold> {
    let core = CylinderBody { axes, half_height: half_length, radius: 0.0 };
    match MeshSearch::new(core, mesh, c, q, (range.widened_by(radius), radius)).contacts() {
        WallContacts::Apart { min_gap } => WallContacts::Apart { min_gap: min_gap - radius },
        WallContacts::Listed(found) => {
            WallContacts::Listed(found.iter().map(|manifold| rounded_manifold(manifold, [radius, 0.0])).collect())
        }
    }
}

/// Solid cylinder about its centre.
struct CylinderBody<'a> {
    axes: &'a Quat,
    half_height: f64,
    radius: f64,
}

impl CylinderBody<'_> {
    /// Unit vector along the axis.
    fn axis(&self) -> Vec3 {
        self.axes * Vec3::z()
    }

    /// Centre of the end that is lower along `n`, m, and its feature.
    fn lower_end(&self, n: &Vec3) -> (Vec3, u32) {
        let along = self.axis() * self.half_height;
        if n.dot(&along) <= 0.0 { (along, CYLINDER_END) } else { (-along, CYLINDER_OTHER_END) }
    }

    /// Vector from the axis to the lowest line of the round side along `n`, m; 0 if n is along the axis.
    fn lowest_radius(&self, n: &Vec3) -> Vec3 {
        let axis = self.axis();
        let across = n - axis * axis.dot(n);
        // Rounding leaves a part along the axis in the first difference, if the tilt is small.
        let across = across - axis * axis.dot(&across);
        across.try_normalize(MAX_ALIGNED_TILT).map_or(Vec3::zeros(), |out| out * -self.radius)
    }

    /// Whether the round side is touched along a line, not at a rim.
    fn is_along_side(&self, n: &Vec3) -> bool {
        self.axis().dot(n).abs() <= MAX_ALIGNED_TILT
    }

    /// Outline of points with these features, and the lines between them.
    fn line_outline(points: &[(Vec3, u32)], frame: &[Vec3; 3]) -> BodyOutline {
        BodyOutline {
            polygon: FlatPolygon::new(points.iter().map(|(point, _)| *point), &frame[1], frame),
            corner_features: points.iter().map(|(_, feature)| *feature).collect(),
            side_features: points.iter().skip(1).map(|_| CYLINDER_SIDE).collect(),
            inside_feature: CYLINDER_SIDE,
            kind: OutlineKind::Line,
        }
    }

    /// Outline of the end that is lower along `n`: the disc, and points of its rim.
    fn end_outline(&self, n: &Vec3, frame: &[Vec3; 3]) -> BodyOutline {
        let (centre, end) = self.lower_end(n);
        let axes = [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| self.axes * axis);
        let [e, f] = [axes[0] * self.radius, axes[1] * self.radius];
        let lowest = self.lowest_radius(n);
        let mut points: SmallVec<[Vec3; 5]> = [e, f, -e, -f].into_iter().collect();
        points.extend((lowest != Vec3::zeros()).then_some(lowest));
        let numbers = 0..points.len() as u32;
        BodyOutline {
            polygon: FlatPolygon::new(points.iter().map(|point| centre + point), &axes[2], frame),
            corner_features: numbers.map(|k| CYLINDER_RIM + k).collect(),
            side_features: SmallVec::new(),
            inside_feature: end,
            kind: OutlineKind::End(
                FlatDisc::new(&centre, &axes, self.radius, frame),
                [1, 2].map(|k| CYLINDER_RIM + LOWEST_RIM_POINT + k),
            ),
        }
    }
}

impl SurfaceBody for CylinderBody<'_> {
    fn circumradius(&self) -> f64 {
        libm::hypot(self.half_height, self.radius)
    }

    fn lowest_height(&self, n: &Vec3) -> f64 {
        let along = self.axis().dot(n);
        -(self.radius * (n - self.axis() * along).norm() + self.half_height * along.abs())
    }

    fn lowest_point(&self, n: &Vec3) -> (Vec3, u32) {
        let out = self.lowest_radius(n);
        if self.is_along_side(n) {
            return (out, CYLINDER_SIDE);
        }
        let (end, feature) = self.lower_end(n);
        (end + out, if out == Vec3::zeros() { feature } else { CYLINDER_RIM + LOWEST_RIM_POINT })
    }

    fn outline(&self, n: &Vec3, frame: &[Vec3; 3]) -> BodyOutline {
        let is_upright = self.axis().dot(n).abs() >= std::f64::consts::FRAC_1_SQRT_2;
        if is_upright && self.radius > 0.0 {
            return self.end_outline(n, frame);
        }
        if is_upright {
            return Self::line_outline(&[self.lower_end(n)], frame);
        }
        let (out, end) = (self.lowest_radius(n), self.axis() * self.half_height);
        Self::line_outline(&[(out + end, CYLINDER_END), (out - end, CYLINDER_OTHER_END)], frame)
    }

    /// Tries the directions along the axis, across the axis and an edge of the triangle, from the axis and from a rim to a vertex,
    /// and from a rim to an edge, as for a [polyhedron and a cylinder](crate::geometry::polyhedron_cylinder).
    fn try_directions(&self, triangle: &PosedTriangle, attempt: &mut AxisAttempt<Self>) {
        let corners = triangle.corners.map(|corner| self.axes.inverse_transform_vector(&corner));
        // Gap along m, which is from the cylinder to the triangle, along the axes of the cylinder.
        let gap_along = |m: &Vec3| {
            let lowest = corners.iter().map(|corner| m.dot(corner)).fold(f64::INFINITY, f64::min);
            lowest - (self.radius * m.xy().norm() + self.half_height * m.z.abs())
        };
        let mut directions: SmallVec<[Vec3; 16]> = [Vec3::z(), -Vec3::z()].into_iter().collect();
        for k in 0..3 {
            let [v, next] = [corners[k], corners[(k + 1) % 3]];
            if let Some(across) = Vec3::z().cross(&(next - v)).try_normalize(0.0) {
                directions.extend([across, -across]);
            }
            let distance_from_axis = v.xy().norm();
            if distance_from_axis > 0.0 {
                let radial = Vec3::new(v.x, v.y, 0.0) / distance_from_axis;
                directions.push(radial);
                let (side_distance, end_distance) = (distance_from_axis - self.radius, v.z.abs() - self.half_height);
                if side_distance > 0.0 && end_distance > 0.0 {
                    directions.push((radial * side_distance + Vec3::z() * end_distance.copysign(v.z)).normalize());
                }
            }
        }
        if directions.into_iter().any(|m| attempt.try_axis(-(self.axes * m), gap_along(&m), None)) {
            return;
        }
        for k in 0..3 {
            let edge = [corners[k], corners[(k + 1) % 3]];
            let found = rim_to_edge(edge, [self.half_height, self.radius], attempt.least_gap());
            if found.into_iter().flatten().any(|m| attempt.try_axis(-(self.axes * m), gap_along(&m), None)) {
                return;
            }
        }
    }

    /// Nearest points along the direction: of the side and an edge or vertex, or of a rim.
    fn nearest_points(
        &self,
        search: &MeshSearch<Self>,
        triangle: &PosedTriangle,
        axis: TouchAxis,
    ) -> Option<(TouchAxis, ContactPoint)> {
        let TouchAxis { normal, gap, region } = axis;
        let (lowest, feature) = self.lowest_point(&normal);
        let middle = normal * (0.5 * gap);
        let position = match region {
            TriangleRegion::Corner(k) => triangle.corners[k] + middle,
            TriangleRegion::Edge(k) if self.is_along_side(&normal) => {
                let side = [triangle.corners[k], triangle.corners[(k + 1) % 3]];
                let end = self.axis() * self.half_height;
                let (_, [_, share]) = nearest_on_segments(&[end, -end], &side);
                side[0] + (side[1] - side[0]) * share + middle
            }
            _ => lowest - middle,
        };
        let features = (feature, search.mesh.feature(triangle.number, region));
        Some((axis, ContactPoint { position, gap, features }))
    }
}
