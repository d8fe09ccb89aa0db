//! The side of a convex body that faces a wall, and triangles, seen along a direction.

use smallvec::SmallVec;

use crate::geometry::cylinder::area_in_disc;
use crate::geometry::pair::PatchCorner;
use crate::geometry::patch::{clipped_to_gap, polygon_area, share_at_tilt};
use crate::math::Vec3;

/// Cosine between a direction and the normal of a polygon below which the polygon is seen as a line: the heights of steeper
/// ones lose more than three digits.
pub(super) const MIN_POLYGON_COSINE: f64 = 1e-3;

/// Polygon seen along a direction.
pub(super) struct FlatPolygon {
    /// Coordinates along the tangents, m, and heights along the direction, m.
    pub corners: SmallVec<[[f64; 3]; 8]>,
    /// 1 if the corners are counter-clockwise as seen, else -1.
    orientation: f64,
    /// Height h and slopes of its plane: h - slope·(x, y); `None` if it is seen as a line.
    plane: Option<[f64; 3]>,
}

impl FlatPolygon {
    /// Polygon in the frame of the direction n and two tangents; `normal`: its own unit normal.
    pub fn new(points: impl Iterator<Item = Vec3>, normal: &Vec3, frame: &[Vec3; 3]) -> Self {
        let corners: SmallVec<[[f64; 3]; 8]> = points.map(|p| flat_point(&p, frame)).collect();
        let [n, t, s] = frame;
        let rise = normal.dot(n);
        let [x, y, z] = corners[0];
        let plane = (rise.abs() >= MIN_POLYGON_COSINE).then(|| {
            let slope = [normal.dot(t) / rise, normal.dot(s) / rise];
            [z + slope[0] * x + slope[1] * y, slope[0], slope[1]]
        });
        FlatPolygon { corners, orientation: 1f64.copysign(rise), plane }
    }

    /// Corner k and the next.
    pub fn side(&self, k: usize) -> [[f64; 3]; 2] {
        [self.corners[k], self.corners[if k + 1 == self.corners.len() { 0 } else { k + 1 }]]
    }

    /// Height of the plane over a point that is inside, or at most `tiny` (m) outside; `None` elsewhere.
    pub fn height_over(&self, point: &[f64; 3], tiny: f64) -> Option<f64> {
        let [height, slope_x, slope_y] = self.plane?;
        let is_inside = |k: usize| {
            let [from, to] = self.side(k);
            side_distance(&from, &to, point).is_none_or(|distance| self.orientation * distance >= -tiny)
        };
        (0..self.corners.len()).all(is_inside).then(|| height - slope_x * point[0] - slope_y * point[1])
    }
}

/// Coordinates of a point along the two tangents of a frame, and its height along the direction, m.
fn flat_point(p: &Vec3, [n, t, s]: &[Vec3; 3]) -> [f64; 3] {
    [p.dot(t), p.dot(s), p.dot(n)]
}

/// Distance of a point from the line between two others, seen along the direction, m: > 0 to the left. `None` for a line
/// seen end on.
pub(super) fn side_distance(from: &[f64; 3], to: &[f64; 3], point: &[f64; 3]) -> Option<f64> {
    let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    let length = (dx * dx + dy * dy).sqrt();
    (length > 0.0).then(|| (dx * (point[1] - from[1]) - dy * (point[0] - from[0])) / length)
}

/// End of a cylinder seen along a direction.
pub(super) struct FlatDisc {
    /// Centre, m.
    centre: [f64; 3],
    /// Unit vectors along the first two axes of the cylinder, and along the third, in the frame.
    axes: [Vec3; 3],
    radius: f64,
}

impl FlatDisc {
    /// Disc of a cylinder with these axes about `centre` (m), in the frame.
    pub fn new(centre: &Vec3, axes: &[Vec3; 3], radius: f64, frame: &[Vec3; 3]) -> Self {
        FlatDisc {
            centre: flat_point(centre, frame),
            axes: [0, 1, 2].map(|k| Vec3::from(flat_point(&axes[k], frame))),
            radius,
        }
    }

    /// Point of the disc's plane over or under a point, relative to the centre along the cylinder's first two axes, m, and the
    /// height of the plane there, m.
    fn foot(&self, point: &[f64; 3]) -> [f64; 3] {
        let [e, f, u] = &self.axes;
        let [x, y] = [point[0] - self.centre[0], point[1] - self.centre[1]];
        let rise = -(u.x * x + u.y * y) / u.z;
        let from_centre = Vec3::new(x, y, rise);
        [e.dot(&from_centre), f.dot(&from_centre), self.centre[2] + rise]
    }

    /// Height of the disc over a point that is inside, or at most `tiny` (m) outside; `None` elsewhere.
    fn height_over(&self, point: &[f64; 3], tiny: f64) -> Option<f64> {
        let [x, y, height] = self.foot(point);
        ((x * x + y * y).sqrt() <= self.radius + tiny).then_some(height)
    }

    /// Shares of the line from a point to another at which it enters and leaves the disc, as far as they are between 0 and 1, with
    /// the heights of the disc there; `tiny`: distance from the rim up to which a point is on it, m.
    pub fn crossings(&self, ends: &[[f64; 3]; 2], tiny: f64) -> [Option<(f64, f64)>; 2] {
        let [from, to] = ends.map(|end| self.foot(&end));
        let along = [0, 1, 2].map(|k| to[k] - from[k]);
        let square = along[0] * along[0] + along[1] * along[1];
        let half = from[0] * along[0] + from[1] * along[1];
        let root = half * half - square * (from[0] * from[0] + from[1] * from[1] - self.radius * self.radius);
        if root <= 0.0 || square <= tiny * tiny {
            return [None; 2];
        }
        [-root.sqrt(), root.sqrt()].map(|root| {
            let share = (root - half) / square;
            (0.0..=1.0).contains(&share).then(|| (share, from[2] + along[2] * share))
        })
    }

    /// Area of the common part with a polygon where its gap is at most `max_gap`, m².
    fn common_area(&self, polygon: &FlatPolygon, max_gap: f64) -> f64 {
        let foot_and_gap = |corner: &[f64; 3]| {
            let [x, y, height] = self.foot(corner);
            [x, y, height - corner[2]]
        };
        let feet: SmallVec<[[f64; 3]; 8]> = polygon.corners.iter().map(foot_and_gap).collect();
        let share = if max_gap == f64::INFINITY { 1.0 } else { share_at_tilt(&feet) };
        area_in_disc(&clipped_to_gap(&feet, max_gap), self.radius) * self.axes[2].z.abs() * share
    }
}

/// Side of body A that faces the wall, seen along a direction.
pub(super) struct BodyOutline {
    /// Corners: of a face, the ends of a line, or points of the rim of an end.
    pub polygon: FlatPolygon,
    /// Features of the corners, and of the lines from each to the next that bound it.
    pub corner_features: SmallVec<[u32; 8]>,
    pub side_features: SmallVec<[u32; 8]>,
    /// Feature of its inside.
    pub inside_feature: u32,
    pub kind: OutlineKind,
}

/// Kind of the side of a body.
pub(super) enum OutlineKind {
    /// Face of a polyhedron.
    Face,
    /// Line or point.
    Line,
    /// End of a cylinder; features of points at which a line enters and leaves its rim.
    End(FlatDisc, [u32; 2]),
}

impl BodyOutline {
    /// Height of A over a point that is inside, or at most `tiny` (m) outside; `None` elsewhere.
    pub fn height_over(&self, point: &[f64; 3], tiny: f64) -> Option<f64> {
        match &self.kind {
            OutlineKind::Face => self.polygon.height_over(point, tiny),
            OutlineKind::End(disc, _) => disc.height_over(point, tiny),
            OutlineKind::Line => {
                let [from, to] = self.polygon.side(0);
                let along = [0, 1, 2].map(|k| to[k] - from[k]);
                let square = along[0] * along[0] + along[1] * along[1];
                let share = ((point[0] - from[0]) * along[0] + (point[1] - from[1]) * along[1]) / square;
                let is_on_line = side_distance(&from, &to, point).is_some_and(|distance| distance.abs() <= tiny);
                (is_on_line && (0.0..=1.0).contains(&share)).then(|| from[2] + along[2] * share)
            }
        }
    }

    /// Area of the common part with a triangle where its gap is at most `max_gap`, m²; `corners`: those of the common part.
    pub fn common_area(&self, corners: &[PatchCorner], triangle: &FlatPolygon, max_gap: f64) -> f64 {
        match &self.kind {
            OutlineKind::Face => polygon_area(corners, max_gap),
            OutlineKind::Line => 0.0,
            OutlineKind::End(disc, _) => disc.common_area(triangle, max_gap),
        }
    }
}
