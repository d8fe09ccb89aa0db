//! Search for the contacts of any convex body with a triangulated wall.

use cd_formats::wall_mesh::{MeshSides, TriangleRegion, WallMesh};
use nalgebra::Matrix3;
use smallvec::SmallVec;

use super::outline::{BodyOutline, FlatDisc, FlatPolygon, MIN_POLYGON_COSINE, OutlineKind, side_distance};
use crate::geometry::manifold::{ContactPoint, ListingRange, Manifold, WallContacts};
use crate::geometry::pair::{PatchCorner, PatchCorners};
use crate::geometry::patch::{ContactPatch, ON_SIDE_DISTANCE};
use crate::math::{Quat, Vec3, local_frame};

/// Heights of triangles divided by the circumradius of A, up to which they are flush: vertices from text and single precision.
const FLUSH_HEIGHT: f64 = 1e-6;
/// Smallest gain of separation, divided by the size, by which a direction replaces an earlier one, so that rounding does not
/// decide: some ten thousand roundings of the size.
const MIN_SEPARATION_GAIN: f64 = 4e-12;
/// Ratio of the smallest length that counts as the size to the largest coordinate: their rounding is then below
/// [`ON_SIDE_DISTANCE`] of the size.
const SIZE_PER_COORDINATE: f64 = 64.0 * f64::EPSILON / ON_SIDE_DISTANCE;
/// Roundings of the largest coordinate up to which heights of corners of a triangle are equal.
const SAME_HEIGHT_ROUNDINGS: f64 = 8.0;
/// Largest 1 - cos of the angle between a triangle and a direction that is its normal: 1e-4 rad.
const MAX_NORMAL_DEVIATION: f64 = 5e-9;

/// Convex body A, relative to its centre in the world's axes.
pub(super) trait SurfaceBody: Sized {
    /// Distance of the farthest point from the centre, m.
    fn circumradius(&self) -> f64;

    /// min_A n·a, m.
    fn lowest_height(&self, n: &Vec3) -> f64;

    /// Lowest point along `n`, m, and its feature.
    fn lowest_point(&self, n: &Vec3) -> (Vec3, u32);

    /// Side of A that faces the wall, seen along `n`, the first vector of the frame.
    fn outline(&self, n: &Vec3, frame: &[Vec3; 3]) -> BodyOutline;

    /// Tries all directions that may have the largest gap, except the normals of the triangle.
    fn try_directions(&self, triangle: &PosedTriangle, attempt: &mut AxisAttempt<Self>);

    /// Direction and nearest points of A and a triangle that are apart, where no side of A is along the direction `axis` of the
    /// largest gap; `None` if they have no direction by rounding.
    fn nearest_points(
        &self,
        search: &MeshSearch<Self>,
        triangle: &PosedTriangle,
        axis: TouchAxis,
    ) -> Option<(TouchAxis, ContactPoint)>;
}

/// Triangle of the wall relative to the centre of A, in the world's axes.
#[derive(Clone, Copy)]
pub(super) struct PosedTriangle {
    pub number: u32,
    pub corners: [Vec3; 3],
    /// Unit normal on the side from which the triangle is seen counter-clockwise.
    pub normal: Vec3,
}

/// Direction along which A and a triangle are apart, or overlap.
#[derive(Clone, Copy)]
pub(super) struct TouchAxis {
    /// Unit normal from the wall to A.
    pub normal: Vec3,
    /// s along it, m.
    pub gap: f64,
    /// Part of the triangle that is highest along the normal.
    pub region: TriangleRegion,
}

/// Search for the direction of largest gap among those that pass a test.
pub(super) struct AxisAttempt<'s, 'a, B> {
    search: &'s MeshSearch<'a, B>,
    triangle: &'s PosedTriangle,
    is_accepted: &'s dyn Fn(&TouchAxis) -> bool,
    best: Option<TouchAxis>,
}

impl<B: SurfaceBody> AxisAttempt<'_, '_, B> {
    /// Keeps a direction if it is better and accepted; `region`: part of the triangle that is highest along it, if that is known.
    /// Returns whether the search ends: the gap exceeds the alert distance.
    pub fn try_axis(&mut self, normal: Vec3, gap: f64, region: Option<TriangleRegion>) -> bool {
        if self.best.is_none_or(|best| gap > best.gap + self.search.tie()) {
            let region = region.unwrap_or_else(|| self.search.highest_region(self.triangle, &normal));
            let axis = TouchAxis { normal, gap, region };
            self.best = if (self.is_accepted)(&axis) { Some(axis) } else { self.best };
        }
        self.best.is_some_and(|best| best.gap > self.search.range.alert)
    }

    /// Gap beyond which a direction is better, m.
    pub fn least_gap(&self) -> f64 {
        self.best.map_or(f64::NEG_INFINITY, |best| best.gap + self.search.tie())
    }
}

/// Triangle within range of A.
struct NearTriangle {
    triangle: PosedTriangle,
    /// Largest gap along any direction, m.
    gap: f64,
    /// Direction of the contact with this triangle alone; `None` if the surface does not allow it ([`WallMesh::allows_normal`]).
    own: Option<TouchAxis>,
    /// The nearest points, where vertices or an edge and a vertex are nearest.
    nearest: Option<ContactPoint>,
    /// Whether A is on the side that does not push.
    is_behind: bool,
}

/// Direction that is taken, with the corners along it.
struct TakenDirection {
    axis: TouchAxis,
    /// min_A n·a, m.
    lowest_height: f64,
    /// n, and two tangents.
    frame: [Vec3; 3],
    outline: BodyOutline,
    /// The only point, where vertices or an edge and a vertex are nearest, and no corner is as near.
    nearest: Option<ContactPoint>,
    corners: PatchCorners,
    area: f64,
}

/// Convex body A near a surface.
pub(super) struct MeshSearch<'a, B> {
    pub body: B,
    pub mesh: &'a WallMesh,
    /// x_B - x_A, m.
    c: Vec3,
    /// Rotation from the axes of the surface to those of the world.
    rotation: Matrix3<f64>,
    range: ListingRange,
    /// Distance of the surface of the whole body from A, m: the radius of a capsule.
    rounding: f64,
    /// Length to which tolerances refer, m.
    size: f64,
}

impl<'a, B: SurfaceBody> MeshSearch<'a, B> {
    /// Body with the surface at `c` = x_B - x_A, m, with this orientation; `range` and `rounding` (m) are from A.
    pub fn new(
        body: B,
        mesh: &'a WallMesh,
        c: &Vec3,
        orientation: &Quat,
        (range, rounding): (ListingRange, f64),
    ) -> Self {
        let size = body.circumradius().max(SIZE_PER_COORDINATE * (mesh.radius() + c.norm()));
        let rotation = orientation.to_rotation_matrix().into_inner();
        MeshSearch { body, mesh, c: *c, rotation, range, rounding, size }
    }

    /// Contacts of A: one manifold for each normal, or a lower bound of the distance if all triangles are farther away than
    /// `range.alert`.
    pub fn contacts(&self) -> WallContacts<Manifold> {
        let numbers = self.triangles_in_reach();
        if numbers.is_empty() {
            let radius = self.body.circumradius();
            let centre = self.to_mesh(&-self.c);
            let bound = self.mesh.distance_bound(&centre, 2.0 * radius + self.range.alert) - radius;
            return WallContacts::without_contacts(bound, self.range.alert);
        }
        let mut triangles: SmallVec<[NearTriangle; 16]> =
            numbers.into_iter().filter_map(|number| self.near_triangle(number)).collect();
        let nearest = triangles.iter_mut().min_by(|one, other| one.gap.total_cmp(&other.gap));
        if let Some(near) = nearest.filter(|near| near.is_behind) {
            near.own = self.pushing_axis(&near.triangle);
            return WallContacts::Listed(self.manifolds(std::slice::from_ref(near)));
        }
        WallContacts::Listed(self.manifolds(&triangles))
    }

    /// Gain of separation by which a direction replaces an earlier one, m.
    pub fn tie(&self) -> f64 {
        MIN_SEPARATION_GAIN * self.size
    }

    /// Turns a vector to the axes of the surface.
    fn to_mesh(&self, v: &Vec3) -> Vec3 {
        self.rotation.tr_mul(v)
    }

    /// Triangles whose boxes are at most the alert distance from the box of A, in the axes of the surface.
    fn triangles_in_reach(&self) -> SmallVec<[u32; 16]> {
        let height_of_side = |k: usize, side: f64| {
            let axis = self.rotation.column(k).into_owned();
            side * self.body.lowest_height(&(axis * side)) - axis.dot(&self.c)
        };
        let [lower, upper] = [1.0, -1.0].map(|side| Vec3::from_fn(|k, _| height_of_side(k, side)));
        self.mesh.triangles_in_box(&lower.add_scalar(-self.range.alert), &upper.add_scalar(self.range.alert))
    }

    /// Triangle at its position.
    fn posed_triangle(&self, number: u32) -> PosedTriangle {
        let corners = self.mesh.corners(number).map(|corner| self.rotation * corner + self.c);
        PosedTriangle { number, corners, normal: self.rotation * self.mesh.normal(number) }
    }

    /// Edge or corner of a triangle that is highest along `n`; its inside if all are at one height.
    fn highest_region(&self, triangle: &PosedTriangle, n: &Vec3) -> TriangleRegion {
        let heights = triangle.corners.map(|corner| n.dot(&corner));
        let highest = heights.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let rounding = SAME_HEIGHT_ROUNDINGS * f64::EPSILON * (self.mesh.radius() + self.c.norm());
        match heights.map(|height| height >= highest - rounding) {
            [true, true, true] => TriangleRegion::Face,
            [true, true, false] => TriangleRegion::Edge(0),
            [false, true, true] => TriangleRegion::Edge(1),
            [true, false, true] => TriangleRegion::Edge(2),
            [true, false, false] => TriangleRegion::Corner(0),
            [false, true, false] => TriangleRegion::Corner(1),
            _ => TriangleRegion::Corner(2),
        }
    }

    /// Whether a triangle may be touched along a direction.
    fn is_allowed(&self, triangle: &PosedTriangle, axis: &TouchAxis) -> bool {
        self.mesh.allows_normal(triangle.number, axis.region, &self.to_mesh(&axis.normal))
    }

    /// Direction of largest s among the `normals` of the triangle and those that the body tries, as far as they pass the test.
    /// Stops at a direction with s > alert.
    fn widest_axis(
        &self,
        triangle: &PosedTriangle,
        normals: &[Vec3],
        is_accepted: impl Fn(&TouchAxis) -> bool,
    ) -> Option<TouchAxis> {
        let mut attempt = AxisAttempt { search: self, triangle, is_accepted: &is_accepted, best: None };
        for normal in normals {
            let gap = self.body.lowest_height(normal) - normal.dot(&triangle.corners[0]);
            if attempt.try_axis(*normal, gap, Some(TriangleRegion::Face)) {
                return attempt.best;
            }
        }
        self.body.try_directions(triangle, &mut attempt);
        attempt.best
    }

    /// Allowed direction with the smallest translation that moves A to the side of a triangle that pushes; a surface with two
    /// sides pushes to the side where the centre of A is.
    fn pushing_axis(&self, triangle: &PosedTriangle) -> Option<TouchAxis> {
        let pushes_back = self.mesh.sides() == MeshSides::Both && triangle.normal.dot(&triangle.corners[0]) > 0.0;
        let normal = if pushes_back { -triangle.normal } else { triangle.normal };
        self.widest_axis(triangle, &[normal], |axis| self.is_allowed(triangle, axis))
    }

    /// Triangle within range, with its own direction; `None` if it is farther away, or if the nearest points have no direction
    /// by rounding.
    fn near_triangle(&self, number: u32) -> Option<NearTriangle> {
        let triangle = self.posed_triangle(number);
        let axis = self.widest_axis(&triangle, &[triangle.normal, -triangle.normal], |_| true)?;
        if axis.gap > self.range.alert {
            return None;
        }
        if axis.gap <= 0.0 {
            let own = self.pushing_axis(&triangle);
            return Some(NearTriangle { triangle, gap: axis.gap, own, nearest: None, is_behind: false });
        }
        let direction = self.direction(axis, None);
        let corners = self.common_corners(&direction, &triangle);
        let (axis, nearest) = if corners.iter().any(|(corner, _)| corner.gap <= axis.gap + self.tie()) {
            (axis, None)
        } else {
            let (axis, point) = self.body.nearest_points(self, &triangle, axis)?;
            (axis, Some(point))
        };
        if axis.gap > self.range.alert {
            return None;
        }
        let is_allowed = self.is_allowed(&triangle, &axis);
        let is_behind = !is_allowed
            && axis.gap <= self.rounding
            && !self.mesh.is_pushing_side(number, axis.region, &self.to_mesh(&axis.normal));
        let (own, nearest) = (is_allowed.then_some(axis), nearest.filter(|_| is_allowed));
        Some(NearTriangle { triangle, gap: axis.gap, own, nearest, is_behind })
    }

    /// Direction with the side of A along it, still without corners.
    fn direction(&self, axis: TouchAxis, nearest: Option<ContactPoint>) -> TakenDirection {
        let frame = local_frame(axis.normal);
        let outline = self.body.outline(&axis.normal, &frame);
        let lowest_height = self.body.lowest_height(&axis.normal);
        TakenDirection { axis, lowest_height, frame, outline, nearest, corners: PatchCorners::new(), area: 0.0 }
    }

    /// Separation of A and a triangle along a direction, m.
    fn separation(direction: &TakenDirection, triangle: &PosedTriangle) -> f64 {
        let heights = triangle.corners.iter().map(|corner| direction.axis.normal.dot(corner));
        direction.lowest_height - heights.fold(f64::NEG_INFINITY, f64::max)
    }

    /// Corners of the common part of the side of A and a triangle, seen along a direction, and whether each remains a corner
    /// of the common part with all triangles in one plane.
    fn common_corners(
        &self,
        direction: &TakenDirection,
        triangle: &PosedTriangle,
    ) -> SmallVec<[(PatchCorner, bool); 12]> {
        let TakenDirection { frame, outline, .. } = direction;
        let tiny = ON_SIDE_DISTANCE * self.size;
        let other = FlatPolygon::new(triangle.corners.iter().copied(), &triangle.normal, frame);
        let mut found = CornerList::new(self, direction, triangle);
        for (corner, &own) in outline.polygon.corners.iter().zip(&outline.corner_features) {
            if let Some(height) = other.height_over(corner, tiny) {
                found.add([corner[0], corner[1]], [corner[2], height], own, TriangleRegion::Face);
            }
        }
        for (k, corner) in other.corners.iter().enumerate() {
            if let Some(height) = outline.height_over(corner, tiny) {
                let heights = [height, corner[2]];
                found.add([corner[0], corner[1]], heights, outline.inside_feature, TriangleRegion::Corner(k));
            }
        }
        for (i, &own) in outline.side_features.iter().enumerate() {
            let [p, q] = outline.polygon.side(i);
            for k in 0..3 {
                let [from, to] = other.side(k);
                let crossing_share = |line: [&[f64; 3]; 2], ends: [&[f64; 3]; 2]| {
                    let [one, two] = ends.map(|end| side_distance(line[0], line[1], end));
                    let (one, two) = (one?, two?);
                    (one.min(two) < -tiny && one.max(two) > tiny).then(|| one / (one - two))
                };
                let Some(share) = crossing_share([&from, &to], [&p, &q]) else { continue };
                let Some(other_share) = crossing_share([&p, &q], [&from, &to]) else { continue };
                let [x, y, height] = [0, 1, 2].map(|axis| p[axis] + (q[axis] - p[axis]) * share);
                let other_height = from[2] + (to[2] - from[2]) * other_share;
                found.add([x, y], [height, other_height], own, TriangleRegion::Edge(k));
            }
        }
        if let OutlineKind::End(disc, rim_features) = &outline.kind {
            found.add_rim_crossings(disc, rim_features, &other, tiny);
        }
        found.corners
    }

    /// Index of the direction best aligned with the triangle, among those along which A is at least as far from this triangle
    /// as from the triangle that gave the direction, to [`FLUSH_HEIGHT`].
    fn covering_direction(&self, taken: &[TakenDirection], triangle: &PosedTriangle) -> Option<usize> {
        let slack = FLUSH_HEIGHT * self.body.circumradius();
        let mut best: Option<(usize, f64)> = None;
        for (k, direction) in taken.iter().enumerate() {
            let alignment = self.facing_cosine(triangle, &direction.axis.normal);
            if best.is_none_or(|(_, largest)| alignment > largest)
                && Self::separation(direction, triangle) >= direction.axis.gap - slack
            {
                best = Some((k, alignment));
            }
        }
        best.map(|(k, _)| k)
    }

    /// Cosine between `n` and the side of a triangle that pushes, of two sides the nearer one.
    fn facing_cosine(&self, triangle: &PosedTriangle, n: &Vec3) -> f64 {
        let cosine = triangle.normal.dot(n);
        if self.mesh.sides() == MeshSides::Both { cosine.abs() } else { cosine }
    }

    /// Directions of the triangles, with the corners along each.
    fn taken_directions(&self, triangles: &[NearTriangle]) -> Vec<TakenDirection> {
        let mut order: SmallVec<[(&NearTriangle, TouchAxis); 16]> =
            triangles.iter().filter_map(|near| Some((near, near.own?))).collect();
        order.sort_by(|(_, one), (_, other)| other.gap.total_cmp(&one.gap));
        let mut taken: Vec<TakenDirection> = Vec::new();
        let mut members: SmallVec<[(usize, &PosedTriangle); 16]> = SmallVec::new();
        for (NearTriangle { triangle, nearest, .. }, axis) in order {
            let known = self.covering_direction(&taken, triangle);
            let k = known.unwrap_or_else(|| {
                taken.push(self.direction(axis, *nearest));
                taken.len() - 1
            });
            members.push((k, triangle));
        }
        for NearTriangle { triangle, .. } in triangles.iter().filter(|near| near.own.is_none()) {
            members.extend(self.covering_direction(&taken, triangle).map(|k| (k, triangle)));
        }
        for (k, triangle) in members {
            self.add_corners(&mut taken[k], triangle);
        }
        taken
    }

    /// Adds the corners of a triangle to those along a direction.
    fn add_corners(&self, direction: &mut TakenDirection, triangle: &PosedTriangle) {
        let cosine = self.facing_cosine(triangle, &direction.axis.normal);
        if cosine < -MIN_POLYGON_COSINE {
            return;
        }
        let found = self.common_corners(direction, triangle);
        if cosine >= 1.0 - MAX_NORMAL_DEVIATION || self.range.area.is_finite() {
            let corners: PatchCorners = found.iter().map(|(corner, _)| *corner).collect();
            let other = FlatPolygon::new(triangle.corners.iter().copied(), &triangle.normal, &direction.frame);
            direction.area += direction.outline.common_area(&corners, &other, self.range.area);
        }
        direction.corners.extend(found.into_iter().filter(|(_, is_real)| *is_real).map(|(corner, _)| corner));
    }

    /// Manifolds of the triangles, one for each direction.
    fn manifolds(&self, triangles: &[NearTriangle]) -> SmallVec<[Manifold; 2]> {
        let mut taken = self.taken_directions(triangles);
        let mut found: SmallVec<[Manifold; 2]> = taken
            .iter_mut()
            .map(|direction| self.manifold(direction))
            .filter(|found| !found.points.is_empty())
            .collect();
        if found.is_empty() {
            // One point at least separates bodies that overlap.
            return self.shallowest_overlap(triangles).into_iter().collect();
        }
        if found.len() > 1 {
            drop_repeated_points(&mut found);
        }
        found
    }

    /// Points along a direction within the range.
    fn manifold(&self, direction: &mut TakenDirection) -> Manifold {
        let TakenDirection { axis, nearest, corners, area, .. } = direction;
        // A triangle next to the one that gave the direction may have the nearest corners: at a vertex within a plane, each
        // triangle is as near as the others, but a corner of A is over one of them only.
        let has_axis_gap = corners.iter().any(|corner| corner.gap <= axis.gap + self.tie());
        if let Some(point) = nearest.filter(|_| !has_axis_gap) {
            return Manifold { normal: axis.normal, points: std::iter::once(point).collect(), area: 0.0 };
        }
        // A corner of A over the edge between two triangles is over both.
        let key = |corner: &PatchCorner| {
            let (own, other) = corner.features;
            (own, if TriangleRegion::is_face_feature(other) { 0 } else { other })
        };
        corners.sort_by(|p, q| key(p).cmp(&key(q)).then(p.gap.total_cmp(&q.gap)).then(p.features.cmp(&q.features)));
        corners.dedup_by(|p, q| key(p) == key(q));
        if axis.gap > self.range.patch
            && let Some(nearest) = corners.iter().copied().min_by(|p, q| p.gap.total_cmp(&q.gap))
        {
            *corners = std::iter::once(nearest).collect();
        }
        let mut patch = ContactPatch { corners: std::mem::take(corners), normal: -axis.normal, area: *area };
        let mut manifold = Manifold::default();
        patch.write_manifold(self.range, self.tie(), &mut manifold);
        manifold
    }

    /// Manifold of the overlapping triangle with the smallest overlap: the lowest point of A along its direction.
    fn shallowest_overlap(&self, triangles: &[NearTriangle]) -> Option<Manifold> {
        let overlapping = triangles.iter().filter_map(|near| Some((near, near.own.filter(|axis| axis.gap <= 0.0)?)));
        let (near, TouchAxis { normal, gap, .. }) = overlapping.max_by(|(_, p), (_, q)| p.gap.total_cmp(&q.gap))?;
        let (lowest, feature) = self.body.lowest_point(&normal);
        let features = (feature, self.mesh.feature(near.triangle.number, TriangleRegion::Face));
        let point = ContactPoint { position: lowest - normal * (0.5 * gap), gap, features };
        Some(Manifold { normal, points: std::iter::once(point).collect(), area: 0.0 })
    }
}

/// Corners of the common part of A and a triangle along a direction.
struct CornerList<'s, 'a, B> {
    search: &'s MeshSearch<'a, B>,
    frame: &'s [Vec3; 3],
    triangle: u32,
    /// Separation of the two, m.
    least: f64,
    corners: SmallVec<[(PatchCorner, bool); 12]>,
}

impl<'s, 'a, B: SurfaceBody> CornerList<'s, 'a, B> {
    fn new(search: &'s MeshSearch<'a, B>, direction: &'s TakenDirection, triangle: &PosedTriangle) -> Self {
        let least = MeshSearch::<B>::separation(direction, triangle);
        CornerList { search, frame: &direction.frame, triangle: triangle.number, least, corners: SmallVec::new() }
    }

    /// Adds the crossings of the rim of an end with the sides of the triangle; `features`: those of the rim where a side enters
    /// and leaves it.
    fn add_rim_crossings(&mut self, disc: &FlatDisc, features: &[u32; 2], triangle: &FlatPolygon, tiny: f64) {
        for k in 0..3 {
            let [from, to] = triangle.side(k);
            for (crossing, own) in disc.crossings(&[from, to], tiny).into_iter().zip(features) {
                let Some((share, height)) = crossing else { continue };
                let [x, y, other_height] = [0, 1, 2].map(|axis| from[axis] + (to[axis] - from[axis]) * share);
                self.add([x, y], [height, other_height], *own, TriangleRegion::Edge(k));
            }
        }
    }

    /// Adds the corner at (x, y), m, with the heights of A and the triangle, m, unless it is known already; `own`: feature of A;
    /// `region`: that of the triangle.
    fn add(&mut self, [x, y]: [f64; 2], heights: [f64; 2], own: u32, region: TriangleRegion) {
        let CornerList { search, frame: [n, t, s], triangle, least, corners } = self;
        let features = (own, search.mesh.feature(*triangle, region));
        let point = *t * x + *s * y + *n * (0.5 * (heights[0] + heights[1]));
        // Steep planes reach too far if a vertex on a side is outside by rounding.
        let gap = (heights[0] - heights[1]).max(*least);
        let is_real = region == TriangleRegion::Face || !search.mesh.is_flush(*triangle, region);
        let new = (PatchCorner { point: point.into(), flat: [x, y], gap, features }, is_real);
        match corners.iter_mut().find(|(corner, _)| corner.is_near([x, y], search.size)) {
            None => corners.push(new),
            // The nearer edge of a triangle that is seen as a line touches.
            Some(known) if gap < known.0.gap - search.tie() => *known = new,
            Some(_) => {}
        }
    }
}

/// Keeps only the point with the smallest gap among those with the same features along several directions.
fn drop_repeated_points(manifolds: &mut SmallVec<[Manifold; 2]>) {
    // Points with the numbers of their directions.
    let all: SmallVec<[(usize, ContactPoint); 16]> = (0..)
        .zip(manifolds.iter())
        .flat_map(|(k, manifold)| manifold.points.iter().map(move |point| (k, *point)))
        .collect();
    for (k, manifold) in manifolds.iter_mut().enumerate() {
        manifold.points.retain(|point| {
            let is_nearer = |(other, known): &(usize, ContactPoint)| {
                known.features == point.features && *other != k && (known.gap, *other) < (point.gap, k)
            };
            !all.iter().any(is_nearer)
        });
    }
    manifolds.retain(|manifold| !manifold.points.is_empty());
}

/// Squared distance of two segments, m^2, and the shares of the two at the nearest points.
/// Source: C. Ericson, Real-Time Collision Detection (2005), section 5.1.9.
pub(super) fn nearest_on_segments([p, q]: &[Vec3; 2], [from, to]: &[Vec3; 2]) -> (f64, [f64; 2]) {
    let (u, v, w) = (q - p, to - from, p - from);
    let (uu, vv, uv, uw, vw) = (u.norm_squared(), v.norm_squared(), u.dot(&v), u.dot(&w), v.dot(&w));
    let det = uu * vv - uv * uv;
    let mut share = if det > 0.0 { ((uv * vw - uw * vv) / det).clamp(0.0, 1.0) } else { 0.0 };
    let mut other = (uv * share + vw) / vv;
    if !(0.0..=1.0).contains(&other) {
        other = other.clamp(0.0, 1.0);
        share = ((uv * other - uw) / uu).clamp(0.0, 1.0);
    }
    let square = (w + u * share - v * other).norm_squared();
    (square, [share, other])
}
