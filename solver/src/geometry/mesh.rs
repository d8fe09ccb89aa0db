//! Contact of a polyhedron with a triangulated wall.
//!
//! Along a unit normal n, from the wall to the polyhedron A, a triangle T has the gap s(n) = min_A n·a - max_T n·t. T may be
//! touched along n only if the surface near the touched face, edge or corner is behind the plane across n: along the normal
//! of a face, between the normals at a convex edge, in the cone of those around a convex corner
//! ([`WallMesh::allows_normal`]). Concave edges and edges within a plane have no directions of their own.
//!
//! 1. Each triangle gets its own direction: if it is apart from A, that of the nearest points, if that is allowed; if the two
//!    overlap, the allowed one with the smallest translation that separates them.
//! 2. Triangles are taken in the order of decreasing gap. If a direction that is already taken separates the next one no
//!    worse, that direction is used for it, too: its plane keeps A away from both.
//! 3. Along each direction, the face of A is clipped to the triangles. Corners in flush edges are not corners of the common
//!    part and are left out, so that a plane of triangles has the points of a plate.

use cd_formats::wall_mesh::{MeshSides, TriangleRegion, WallMesh};
use nalgebra::Matrix3;
use smallvec::SmallVec;

use super::manifold::{ContactPoint, ListingRange, Manifold, WallContacts, edge_feature, face_feature, vertex_feature};
use super::pair::{PatchCorner, PatchCorners};
use super::patch::{ContactPatch, ON_SIDE_DISTANCE, polygon_area};
use super::polyhedron::{FeatureIndex, PosedPolyhedron};
use super::search::support_face;
use crate::math::simd::Scalar;
use crate::math::{Quat, Vec3, local_frame};

/// Heights of triangles divided by the circumradius of A, up to which they are flush: vertices from text and single precision.
const FLUSH_HEIGHT: f64 = 1e-6;
/// Cosine between a direction and the normal of a polygon below which the polygon is seen as a line: the heights of steeper
/// ones lose more than three digits.
const MIN_POLYGON_COSINE: f64 = 1e-3;
/// Bound of the product of the cosines between an edge of T and the two normals at an edge of A: the two edges are candidates
/// only if the product is below minus this. (4e-12)², the square of [`MIN_SEPARATION_GAIN`].
const PARALLEL_EDGE_PRODUCT: f64 = 1.6e-23;
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

/// Contacts of polyhedron A with the surface of a wall at `c` = x_B - x_A, m, with this orientation: one manifold for
/// each normal, or a lower bound of the distance if all triangles are farther away than `range.alert`.
///
/// ```
/// use cd_formats::wall_mesh::{MeshSides, WallMesh};
/// # use cd_solve::geometry::{Polyhedron, polyhedron_mesh};
/// # use cd_solve::math::{Quat, Vec3};
/// let square = [[-2.0, -2.0, 0.0], [2.0, -2.0, 0.0], [2.0, 2.0, 0.0], [-2.0, 2.0, 0.0]];
/// let mesh = WallMesh::new(&square, &[[0, 1, 2], [0, 2, 3]], MeshSides::One).unwrap();
/// let cube = Polyhedron::cuboid(&Vec3::repeat(0.5));
/// let posed = cube.posed_by(&Quat::identity());
/// let found = polyhedron_mesh(&posed, &mesh, &(Vec3::z() * -0.625), &Quat::identity(), 0.25.into()).into_contacts();
/// assert_eq!((found.len(), found[0].normal, found[0].gap()), (1, Vec3::z(), 0.125));
/// assert_eq!((found[0].points.len(), found[0].area), (4, 1.0));
/// ```
pub fn polyhedron_mesh(
    a: &PosedPolyhedron,
    mesh: &WallMesh,
    c: &Vec3,
    orientation: &Quat,
    range: ListingRange,
) -> WallContacts<Manifold> {
    let search = MeshSearch::new(a, mesh, c, orientation, range);
    let numbers = search.triangles_in_reach();
    if numbers.is_empty() {
        let radius = a.shape.circumradius();
        let centre = search.to_mesh(&-c);
        let bound = mesh.distance_bound(&centre, 2.0 * radius + range.alert) - radius;
        return WallContacts::without_contacts(bound, range.alert);
    }
    let triangles: SmallVec<[NearTriangle; 16]> =
        numbers.into_iter().filter_map(|number| search.near_triangle(number)).collect();
    WallContacts::Listed(search.manifolds(&triangles))
}

/// Edge of A.
struct BodyEdge {
    ends: [Vec3; 2],
    /// Numbers of the ends.
    vertices: [FeatureIndex; 2],
    /// Normals of its two faces.
    normals: [Vec3; 2],
}

/// Triangle of the wall relative to the centre of A, in the world's axes.
#[derive(Clone, Copy)]
struct PosedTriangle {
    number: u32,
    corners: [Vec3; 3],
    /// Unit normal on the side from which the triangle is seen counter-clockwise.
    normal: Vec3,
}

/// Direction along which A and a triangle are apart, or overlap.
#[derive(Clone, Copy)]
struct TouchAxis {
    /// Unit normal from the wall to A.
    normal: Vec3,
    /// s along it, m.
    gap: f64,
    /// Part of the triangle that is highest along the normal.
    region: TriangleRegion,
}

/// Triangle within range of A.
struct NearTriangle {
    triangle: PosedTriangle,
    /// Its own direction; `None` if the surface does not allow it ([`WallMesh::allows_normal`]).
    own: Option<TouchAxis>,
    /// The nearest points, where vertices or an edge and a vertex are nearest.
    nearest: Option<ContactPoint>,
}

/// Direction that is taken, with the corners along it.
struct TakenDirection {
    axis: TouchAxis,
    /// min_A n·a, m.
    lowest_height: f64,
    /// n, and two tangents.
    frame: [Vec3; 3],
    /// Number of the face of A that faces the wall.
    face: u32,
    outline: FlatPolygon,
    /// The only point, where vertices or an edge and a vertex are nearest.
    nearest: Option<ContactPoint>,
    corners: PatchCorners,
    area: f64,
}

/// Polygon seen along a direction.
struct FlatPolygon {
    /// Coordinates along the tangents, m, and heights along the direction, m.
    corners: SmallVec<[[f64; 3]; 8]>,
    /// 1 if the corners are counter-clockwise as seen, else -1.
    orientation: f64,
    /// Height h and slopes of its plane: h - slope·(x, y); `None` if it is seen as a line.
    plane: Option<[f64; 3]>,
}

impl FlatPolygon {
    fn new(points: impl Iterator<Item = Vec3>, normal: &Vec3, [n, t, s]: &[Vec3; 3]) -> Self {
        let corners: SmallVec<[[f64; 3]; 8]> = points.map(|p| [p.dot(t), p.dot(s), p.dot(n)]).collect();
        let rise = normal.dot(n);
        let [x, y, z] = corners[0];
        let plane = (rise.abs() >= MIN_POLYGON_COSINE).then(|| {
            let slope = [normal.dot(t) / rise, normal.dot(s) / rise];
            [z + slope[0] * x + slope[1] * y, slope[0], slope[1]]
        });
        FlatPolygon { corners, orientation: 1f64.copysign(rise), plane }
    }

    /// Corner k and the next.
    fn side(&self, k: usize) -> [[f64; 3]; 2] {
        [self.corners[k], self.corners[if k + 1 == self.corners.len() { 0 } else { k + 1 }]]
    }

    /// Height of the plane over a point that is inside, or at most `tiny` (m) outside; `None` elsewhere.
    fn height_over(&self, point: &[f64; 3], tiny: f64) -> Option<f64> {
        let [height, slope_x, slope_y] = self.plane?;
        let is_inside = |k: usize| {
            let [from, to] = self.side(k);
            side_distance(&from, &to, point).is_none_or(|distance| self.orientation * distance >= -tiny)
        };
        (0..self.corners.len()).all(is_inside).then(|| height - slope_x * point[0] - slope_y * point[1])
    }
}

/// Distance of a point from the line between two others, seen along the direction, m: > 0 to the left. `None` for a line
/// seen end on.
fn side_distance(from: &[f64; 3], to: &[f64; 3], point: &[f64; 3]) -> Option<f64> {
    let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    let length = (dx * dx + dy * dy).sqrt();
    (length > 0.0).then(|| (dx * (point[1] - from[1]) - dy * (point[0] - from[0])) / length)
}

/// Polyhedron A near a surface.
struct MeshSearch<'a> {
    a: &'a PosedPolyhedron<'a>,
    mesh: &'a WallMesh,
    /// x_B - x_A, m.
    c: Vec3,
    /// Rotation from the axes of the surface to those of the world.
    rotation: Matrix3<f64>,
    range: ListingRange,
    vertices: SmallVec<[Vec3; 16]>,
    /// Outward normals of the faces, and distances of their planes from the centre, m.
    planes: SmallVec<[(Vec3, f64); 16]>,
    edges: SmallVec<[BodyEdge; 24]>,
    /// Length to which tolerances refer, m.
    size: f64,
}

impl<'a> MeshSearch<'a> {
    fn new(a: &'a PosedPolyhedron<'a>, mesh: &'a WallMesh, c: &Vec3, orientation: &Quat, range: ListingRange) -> Self {
        let planes: SmallVec<[(Vec3, f64); 16]> =
            (0..).zip(a.shape.face_planes()).map(|(f, plane)| (a.face_normal(f as u32), plane.offset)).collect();
        let vertices: SmallVec<[Vec3; 16]> = (0..a.shape.vertices().len()).map(|k| a.vertex(k as u32)).collect();
        let edges = a.shape.edges().iter().map(|edge| BodyEdge {
            ends: edge.ends.map(|k| vertices[k as usize]),
            vertices: edge.ends,
            normals: edge.faces.map(|f| planes[f as usize].0),
        });
        let edges = edges.collect();
        let size = a.shape.circumradius().max(SIZE_PER_COORDINATE * (mesh.radius() + c.norm()));
        MeshSearch {
            a,
            mesh,
            c: *c,
            rotation: orientation.to_rotation_matrix().into_inner(),
            range,
            vertices,
            planes,
            edges,
            size,
        }
    }

    /// Gain of separation by which a direction replaces an earlier one, m.
    fn tie(&self) -> f64 {
        MIN_SEPARATION_GAIN * self.size
    }

    /// Turns a vector to the axes of the surface.
    fn to_mesh(&self, v: &Vec3) -> Vec3 {
        self.rotation.tr_mul(v)
    }

    /// Triangles whose boxes are at most the alert distance from the box of A, in the axes of the surface.
    fn triangles_in_reach(&self) -> SmallVec<[u32; 16]> {
        let (mut lower, mut upper) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
        for vertex in &self.vertices {
            let local = self.to_mesh(&(vertex - self.c));
            (lower, upper) = (lower.inf(&local), upper.sup(&local));
        }
        self.mesh.triangles_in_box(&lower.add_scalar(-self.range.alert), &upper.add_scalar(self.range.alert))
    }

    /// Triangle at its position.
    fn posed_triangle(&self, number: u32) -> PosedTriangle {
        let corners = self.mesh.corners(number).map(|corner| self.rotation * corner + self.c);
        PosedTriangle { number, corners, normal: self.rotation * self.mesh.normal(number) }
    }

    /// min_A n·a, m.
    fn lowest_height(&self, n: &Vec3) -> f64 {
        self.vertices.iter().map(|vertex| n.dot(vertex)).fold(f64::INFINITY, f64::min)
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

    /// Direction of largest s among the normals of the triangle and of the faces of A, and those across an edge of each, as
    /// far as they pass the test; `faces`: normals of the triangle. Stops at a direction with s > alert.
    fn widest_axis(
        &self,
        triangle: &PosedTriangle,
        faces: &[Vec3],
        is_accepted: impl Fn(&TouchAxis) -> bool,
    ) -> Option<TouchAxis> {
        let (corners, tie) = (&triangle.corners, self.tie());
        let mut best: Option<TouchAxis> = None;
        // Keeps the axis if it is better and accepted; returns whether the search ends.
        let mut try_axis = |normal: Vec3, gap: f64, region: &dyn Fn() -> TriangleRegion| {
            if best.is_none_or(|best| gap > best.gap + tie) {
                let axis = TouchAxis { normal, gap, region: region() };
                best = if is_accepted(&axis) { Some(axis) } else { best };
            }
            best.is_some_and(|best| best.gap > self.range.alert)
        };
        for normal in faces {
            if try_axis(*normal, self.lowest_height(normal) - normal.dot(&corners[0]), &|| TriangleRegion::Face) {
                return best;
            }
        }
        for (normal, offset) in &self.planes {
            let lowest = corners.iter().map(|corner| normal.dot(corner)).fold(f64::INFINITY, f64::min);
            if try_axis(-normal, lowest - offset, &|| self.highest_region(triangle, &-normal)) {
                return best;
            }
        }
        for k in 0..3 {
            let [from, to, opposite] = [0, 1, 2].map(|i| corners[(k + i) % 3]);
            let along = to - from;
            let parallel = PARALLEL_EDGE_PRODUCT * along.norm_squared();
            for BodyEdge { ends, normals: [n0, n1], .. } in &self.edges {
                let (p0, p1) = (along.dot(n0), along.dot(n1));
                if p0 * p1 >= -parallel {
                    continue;
                }
                // Perpendicular to both edges, and outside of A.
                let outward = n0 * p1.abs() + n1 * p0.abs();
                let length = outward.norm();
                if outward.dot(&(opposite - from)) < 0.0 || length == 0.0 {
                    continue;
                }
                let normal = outward / -length;
                if try_axis(normal, normal.dot(&(ends[0] - from)), &|| TriangleRegion::Edge(k)) {
                    return best;
                }
            }
        }
        best
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
            // A surface with two sides pushes to the side where the centre of A is.
            let pushes_back = self.mesh.sides() == MeshSides::Both && triangle.normal.dot(&triangle.corners[0]) > 0.0;
            let normal = if pushes_back { -triangle.normal } else { triangle.normal };
            let own = self.widest_axis(&triangle, &[normal], |axis| self.is_allowed(&triangle, axis));
            return Some(NearTriangle { triangle, own, nearest: None });
        }
        let direction = self.direction(axis, None);
        if self.common_corners(&direction, &triangle).iter().any(|(corner, _)| corner.gap <= axis.gap + self.tie()) {
            let own = self.is_allowed(&triangle, &axis).then_some(axis);
            return Some(NearTriangle { triangle, own, nearest: None });
        }
        let (axis, point) = self.nearest_edges(&triangle)?;
        if axis.gap > self.range.alert {
            return None;
        }
        let is_allowed = self.is_allowed(&triangle, &axis);
        Some(NearTriangle { triangle, own: is_allowed.then_some(axis), nearest: is_allowed.then_some(point) })
    }

    /// Nearest points of the edges of A and of a triangle, ends included.
    fn nearest_edges(&self, triangle: &PosedTriangle) -> Option<(TouchAxis, ContactPoint)> {
        let mut nearest: Option<(f64, usize, usize, [f64; 2])> = None;
        for k in 0..3 {
            let side = [triangle.corners[k], triangle.corners[(k + 1) % 3]];
            for (e, edge) in self.edges.iter().enumerate() {
                let (square, shares) = nearest_on_segments(&edge.ends, &side);
                if nearest.is_none_or(|(least, ..)| square < least) {
                    nearest = Some((square, e, k, shares));
                }
            }
        }
        let (square, e, k, [share_a, share_t]) = nearest?;
        let BodyEdge { ends: [start, end], vertices, .. } = &self.edges[e];
        let [from, to] = [triangle.corners[k], triangle.corners[(k + 1) % 3]];
        let (on_a, on_t) = (start + (end - start) * share_a, from + (to - from) * share_t);
        let gap = square.sqrt();
        let normal = (on_a - on_t) / gap;
        // Points at rounding distance have no direction.
        if gap <= self.tie() || !normal.iter().all(|x| x.is_finite()) {
            return None;
        }
        let region = match share_t {
            0.0 => TriangleRegion::Corner(k),
            1.0 => TriangleRegion::Corner((k + 1) % 3),
            _ => TriangleRegion::Edge(k),
        };
        let feature = match share_a {
            0.0 => vertex_feature(vertices[0].into()),
            1.0 => vertex_feature(vertices[1].into()),
            _ => edge_feature(e as u32),
        };
        let features = (feature, self.mesh.feature(triangle.number, region));
        Some((TouchAxis { normal, gap, region }, ContactPoint { position: (on_a + on_t) * 0.5, gap, features }))
    }

    /// Direction with the face of A along it, still without corners.
    fn direction(&self, axis: TouchAxis, nearest: Option<ContactPoint>) -> TakenDirection {
        let face = support_face(Scalar, self.a, &-axis.normal, None);
        let frame = local_frame(axis.normal);
        let corners = self.a.shape.face_corners(face as usize).iter().map(|&k| self.vertices[k as usize]);
        let outline = FlatPolygon::new(corners, &self.planes[face as usize].0, &frame);
        let lowest_height = self.lowest_height(&axis.normal);
        TakenDirection { axis, lowest_height, frame, face, outline, nearest, corners: PatchCorners::new(), area: 0.0 }
    }

    /// Separation of A and a triangle along a direction, m.
    fn separation(direction: &TakenDirection, triangle: &PosedTriangle) -> f64 {
        let heights = triangle.corners.iter().map(|corner| direction.axis.normal.dot(corner));
        direction.lowest_height - heights.fold(f64::NEG_INFINITY, f64::max)
    }

    /// Corners of the common part of the face of A and a triangle, seen along a direction, and whether each remains a corner
    /// of the common part with all triangles in one plane.
    fn common_corners(
        &self,
        direction: &TakenDirection,
        triangle: &PosedTriangle,
    ) -> SmallVec<[(PatchCorner, bool); 12]> {
        let TakenDirection { frame, face, outline, .. } = direction;
        let [n, t, s] = frame;
        let tiny = ON_SIDE_DISTANCE * self.size;
        let other = FlatPolygon::new(triangle.corners.iter().copied(), &triangle.normal, frame);
        let least = Self::separation(direction, triangle);
        let shape = self.a.shape;
        let mut found: SmallVec<[(PatchCorner, bool); 12]> = SmallVec::new();
        let mut add = |[x, y]: [f64; 2], heights: [f64; 2], features: (u32, u32), region: TriangleRegion| {
            let point = t * x + s * y + n * (0.5 * (heights[0] + heights[1]));
            // Steep planes reach too far if a vertex on a side is outside by rounding.
            let gap = (heights[0] - heights[1]).max(least);
            let is_real = region == TriangleRegion::Face || !self.mesh.is_flush(triangle.number, region);
            let new = (PatchCorner { point: point.into(), flat: [x, y], gap, features }, is_real);
            match found.iter_mut().find(|(corner, _)| corner.is_near([x, y], self.size)) {
                None => found.push(new),
                // The nearer edge of a triangle that is seen as a line touches.
                Some(known) if gap < known.0.gap - self.tie() => *known = new,
                Some(_) => {}
            }
        };
        for (corner, &vertex) in outline.corners.iter().zip(shape.face_corners(*face as usize)) {
            if let Some(height) = other.height_over(corner, tiny) {
                let features =
                    (vertex_feature(vertex.into()), self.mesh.feature(triangle.number, TriangleRegion::Face));
                add([corner[0], corner[1]], [corner[2], height], features, TriangleRegion::Face);
            }
        }
        for (k, corner) in other.corners.iter().enumerate() {
            if let Some(height) = outline.height_over(corner, tiny) {
                let region = TriangleRegion::Corner(k);
                let features = (face_feature(*face), self.mesh.feature(triangle.number, region));
                add([corner[0], corner[1]], [height, corner[2]], features, region);
            }
        }
        for (i, &edge) in shape.face_edges(*face as usize).iter().enumerate() {
            let [p, q] = outline.side(i);
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
                let region = TriangleRegion::Edge(k);
                let features = (edge_feature(edge.into()), self.mesh.feature(triangle.number, region));
                add([x, y], [height, other_height], features, region);
            }
        }
        found
    }

    /// Index of the direction best aligned with the triangle, among those along which A is at least as far from this triangle
    /// as from the triangle that gave the direction, to [`FLUSH_HEIGHT`].
    fn covering_direction(&self, taken: &[TakenDirection], triangle: &PosedTriangle) -> Option<usize> {
        let slack = FLUSH_HEIGHT * self.a.shape.circumradius();
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
        if direction.nearest.is_some() || cosine < -MIN_POLYGON_COSINE {
            return;
        }
        let found = self.common_corners(direction, triangle);
        if cosine >= 1.0 - MAX_NORMAL_DEVIATION || self.range.area.is_finite() {
            let corners: PatchCorners = found.iter().map(|(corner, _)| *corner).collect();
            direction.area += polygon_area(&corners, self.range.area);
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
        if let Some(point) = nearest {
            return Manifold { normal: axis.normal, points: std::iter::once(*point).collect(), area: 0.0 };
        }
        // A vertex of A over the edge between two triangles is over both.
        let key = |corner: &PatchCorner| {
            let (own, other) = corner.features;
            (own, if own < edge_feature(0) { 0 } else { other })
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

    /// Manifold of the overlapping triangle with the smallest overlap: the lowest vertex of A along its direction.
    fn shallowest_overlap(&self, triangles: &[NearTriangle]) -> Option<Manifold> {
        let overlapping = triangles.iter().filter_map(|near| Some((near, near.own.filter(|axis| axis.gap <= 0.0)?)));
        let (near, TouchAxis { normal, gap, .. }) = overlapping.max_by(|(_, p), (_, q)| p.gap.total_cmp(&q.gap))?;
        let lowest = (0..).zip(&self.vertices).min_by(|(_, p), (_, q)| normal.dot(p).total_cmp(&normal.dot(q)));
        let (k, vertex) = lowest?;
        let features = (vertex_feature(k), self.mesh.feature(near.triangle.number, TriangleRegion::Face));
        let point = ContactPoint { position: vertex - normal * (0.5 * gap), gap, features };
        Some(Manifold { normal, points: std::iter::once(point).collect(), area: 0.0 })
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
fn nearest_on_segments([p, q]: &[Vec3; 2], [from, to]: &[Vec3; 2]) -> (f64, [f64; 2]) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::cache::CachedFeature;
    use crate::geometry::manifold::NarrowPhaseMode;
    use crate::geometry::polyhedra::polyhedron_polyhedron;
    use crate::geometry::polyhedra::tests::rock;
    use crate::geometry::polyhedron::Polyhedron;

    /// Surface of a polyhedron.
    fn surface(shape: &Polyhedron, sides: MeshSides) -> WallMesh {
        let vertices: Vec<[f64; 3]> = shape.vertices().iter().map(|v| (*v).into()).collect();
        let fan =
            |face: &[u16]| (2..face.len()).map(|k| [face[0], face[k - 1], face[k]].map(u32::from)).collect::<Vec<_>>();
        WallMesh::new(&vertices, &shape.faces().flat_map(fan).collect::<Vec<_>>(), sides).unwrap()
    }

    fn turn(k: f64) -> Quat {
        Quat::from_euler_angles(k, 2.0 * k, 0.3 * k)
    }

    /// The surface of a convex body has the one normal and the gap of the body, apart and with overlaps of up to a tenth.
    #[test]
    fn a_convex_surface_is_touched_as_the_body_inside() {
        let (a, b) = (rock(0.0), rock(1.0));
        let mesh = surface(&b, MeshSides::One);
        let (mut apart, mut overlapping) = (0, 0);
        for number in 0..400 {
            let k = f64::from(number);
            let (pa, qb) = (a.posed_by(&turn(k)), Quat::from_euler_angles(0.7 * k, -k, 1.9 * k));
            let pb = b.posed_by(&qb);
            let c = Vec3::new((1.3 * k).sin(), (2.1 * k).cos(), (0.4 * k).sin()).normalize() * (1.3 + 0.0015 * k);
            let mut memory = CachedFeature::default();
            let body = polyhedron_polyhedron(&pa, &pb, &c, 0.2, NarrowPhaseMode::Accurate, &mut memory);
            let found = polyhedron_mesh(&pa, &mesh, &c, &qb, 0.2.into());
            let Some(body) = body else {
                let is_apart = match found {
                    WallContacts::Apart { min_gap } => min_gap > 0.2,
                    WallContacts::Listed(found) => found.is_empty(),
                };
                assert!(is_apart, "{number}");
                continue;
            };
            let found = found.into_contacts();
            assert_eq!(found.len(), 1, "{number}: {found:?} {body:?}");
            // Tolerance: directions of near points have the rounding of positions divided by their distance.
            let (normal_error, gap_error) = ((found[0].normal - body.normal).norm(), found[0].gap() - body.gap());
            assert!(normal_error < 1e-11 && gap_error.abs() < 1e-11, "{number}: {:?} {body:?}", found[0]);
            (apart, overlapping) = (apart + u32::from(body.gap() > 0.0), overlapping + u32::from(body.gap() < 0.0));
        }
        assert!(apart > 50 && overlapping > 50, "{apart} {overlapping}");
    }

    /// A plane of triangles with corners at random positions has the points and the area of a plate, for any overlap, also
    /// of a face that is tilted, and whatever edges and corners are below.
    #[test]
    fn a_plane_of_triangles_has_the_points_of_a_plate() {
        let mut noise = 0.0f64;
        let mut random = || {
            noise += 1.0;
            (noise * 12.9898).sin() * 0.3
        };
        let mut vertices = Vec::new();
        for (i, j) in (0..=12).flat_map(|j| (0..=12).map(move |i| (i, j))) {
            vertices.push([f64::from(i) - 6.0 + random(), f64::from(j) - 6.0 + random(), 0.0].map(|x| x * 0.25));
        }
        let square = |k: u32| {
            let [a, b, c, d] = [0, 1, 14, 13].map(|step| k / 12 * 13 + k % 12 + step);
            [[a, b, c], [a, c, d]]
        };
        let triangles: Vec<[u32; 3]> = (0..144).flat_map(square).collect();
        let plate = Polyhedron::cuboid(&Vec3::new(8.0, 8.0, 1.0));
        for (shape, sides) in
            [(Polyhedron::cuboid(&Vec3::new(0.5, 0.4, 0.3)), MeshSides::One), (rock(0.0), MeshSides::Both)]
        {
            let mesh = WallMesh::new(&vertices, &triangles, sides).unwrap();
            for number in 0..100u32 {
                let k = f64::from(number);
                let wall = Quat::from_euler_angles(0.2 * k, 0.1 * k, 0.0);
                // Flat, tilted by 1e-9 to 0.1, and any.
                let tilt = [0.0, 1e-9, 1e-4, 0.1, k][number as usize % 5];
                let axes = wall * Quat::from_euler_angles(tilt, -0.7 * tilt, k);
                let posed = shape.posed_by(&axes);
                let gap = [-0.1, -1e-3, -1e-8, 0.0, 1e-3, 0.04][number as usize % 6];
                let height = gap + posed.support_height(&-(wall * Vec3::z()));
                let c = wall * Vec3::new(0.3 * k.sin(), 0.2 * k.cos(), -height);
                let range = ListingRange { area: 0.05, ..0.05.into() };
                let mut memory = CachedFeature::default();
                let (posed_plate, below) = (plate.posed_by(&wall), c - wall * Vec3::z());
                let expected =
                    polyhedron_polyhedron(&posed, &posed_plate, &below, range, NarrowPhaseMode::Accurate, &mut memory);
                let expected = expected.unwrap();
                let found = polyhedron_mesh(&posed, &mesh, &c, &wall, range).into_contacts();
                assert_eq!(found.len(), 1, "{number}: {found:?}");
                assert!((found[0].normal - wall * Vec3::z()).norm() < 1e-12, "{number}: {found:?} {expected:?}");
                assert!((found[0].area - expected.area).abs() < 1e-12, "{number}: {found:?} {expected:?}");
                assert_eq!(found[0].points.len(), expected.points.len(), "{number}: {found:?} {expected:?}");
                for point in &expected.points {
                    // Tolerance: a few roundings of coordinates of 2, and of 8 in the plate.
                    let is_same = |other: &ContactPoint| {
                        (other.position - point.position).norm() < 1e-13 && (other.gap - point.gap).abs() < 1e-13
                    };
                    let is_found =
                        found[0].points.iter().any(|other| is_same(other) && other.features.0 == point.features.0);
                    assert!(is_found, "{number}: {point:?} {found:?}");
                }
            }
        }
    }

    /// Cube of side 1 whose centre is at (x, y, z), next to the corner of a box that is open above, of four sides about a
    /// bottom from -1 to 1: the triangles push inwards.
    fn in_tub(x: f64, y: f64, z: f64) -> SmallVec<[Manifold; 2]> {
        let tub = Polyhedron::cuboid(&Vec3::repeat(1.0));
        let mut mesh = surface(&tub, MeshSides::One);
        let triangles: Vec<[u32; 3]> = (0..12)
            .filter(|&k| mesh.normal(k).z < 0.5)
            .map(|k| mesh.triangles()[k as usize])
            .map(|[a, b, c]| [a, c, b])
            .collect();
        let vertices: Vec<[f64; 3]> = mesh.vertices().iter().map(|v| (*v).into()).collect();
        mesh = WallMesh::new(&vertices, &triangles, MeshSides::One).unwrap();
        let cube = Polyhedron::cuboid(&Vec3::repeat(0.5));
        let posed = cube.posed_by(&Quat::identity());
        polyhedron_mesh(&posed, &mesh, &-Vec3::new(x, y, z), &Quat::identity(), 0.02.into()).into_contacts()
    }

    /// A cube in a corner touches each side with a face, apart and with overlaps of any ratio; a cube on the upper edge of a
    /// side is pushed up.
    #[test]
    fn concave_edges_are_touched_on_both_sides() {
        for gaps in [[0.01, 0.01, 0.01], [-0.01, -0.01, -0.01], [-1e-9, 0.01, -0.1], [0.0, -0.2, 1e-12]] {
            let [x, y, z] = gaps.map(|gap| gap - 0.5);
            let found = in_tub(x, y, z);
            assert_eq!(found.len(), 3, "{found:?}");
            for (gap, axis) in gaps.into_iter().zip([Vec3::x(), Vec3::y(), Vec3::z()]) {
                let side = found.iter().find(|manifold| (manifold.normal - axis).norm() < 1e-15).unwrap();
                assert_eq!(side.points.len(), 4);
                // Tolerance: roundings of coordinates of 1.
                assert!(side.points.iter().all(|point| (point.gap - gap).abs() < 1e-15), "{side:?}");
            }
        }
        // On the rim, which pushes in all directions: a line of two points.
        for gap in [0.01, -0.01] {
            let found = in_tub(-1.0, 0.0, 1.5 + gap);
            assert_eq!((found.len(), found[0].points.len()), (1, 2), "{found:?}");
            assert!((found[0].normal - Vec3::z()).norm() < 1e-15 && (found[0].gap() - gap).abs() < 1e-15);
        }
    }

    /// Ridges and tips poke into a face along the normal of the face, whatever the directions of their sides.
    #[test]
    fn ridges_and_tips_touch_faces() {
        let cube = Polyhedron::cuboid(&Vec3::repeat(0.5));
        let tilt = Quat::from_euler_angles(0.1, -0.2, 0.3);
        let posed = cube.posed_by(&tilt);
        let up = tilt * Vec3::z();
        let ridge = [[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, -1.0, -0.8], [0.0, 1.0, -0.8]];
        let tip = [[0.0, 0.0, 0.0], [1.0, 0.0, -1.0], [-0.5, 0.75, -1.0], [-0.5, -0.75, -1.0]];
        for sides in [MeshSides::One, MeshSides::Both] {
            let ridge = WallMesh::new(&ridge, &[[0, 1, 3], [0, 2, 1]], sides).unwrap();
            let tip = WallMesh::new(&tip, &[[0, 1, 2], [0, 2, 3], [0, 3, 1]], sides).unwrap();
            for gap in [0.01, 1e-10, -1e-10, -0.01] {
                let c = up * -(0.5 + gap);
                let found = polyhedron_mesh(&posed, &tip, &c, &Quat::identity(), 0.02.into()).into_contacts();
                assert_eq!(found.len(), 1, "{found:?}");
                // Tolerance: roundings of coordinates of 1.
                assert!((found[0].normal - up).norm() < 1e-15 && (found[0].gap() - gap).abs() < 1e-15, "{found:?}");
                assert_eq!(found[0].points[0].features.1, 4);
                // The ridge lies along the axes of the wall: its own direction across the face.
                let across = Quat::rotation_between(&Vec3::z(), &up).unwrap();
                let found = polyhedron_mesh(&posed, &ridge, &c, &across, 0.02.into()).into_contacts();
                assert_eq!((found.len(), found[0].points.len()), (1, 2), "{found:?}");
                assert!((found[0].normal - up).norm() < 1e-15 && (found[0].gap() - gap).abs() < 1e-15, "{found:?}");
            }
        }
    }

    /// A body behind a surface with one side is left alone, and pushed through the surface as soon as it overlaps.
    #[test]
    fn one_side_pushes_to_the_front() {
        let square = [[-2.0, -2.0, 0.0], [2.0, -2.0, 0.0], [2.0, 2.0, 0.0], [-2.0, 2.0, 0.0]];
        let cube = Polyhedron::cuboid(&Vec3::repeat(0.5));
        let posed = cube.posed_by(&Quat::identity());
        let at = |z: f64, sides: MeshSides| {
            let mesh = WallMesh::new(&square, &[[0, 1, 2], [0, 2, 3]], sides).unwrap();
            polyhedron_mesh(&posed, &mesh, &-Vec3::new(0.1, 0.2, z), &Quat::identity(), 0.05.into()).into_contacts()
        };
        assert!(at(-0.51, MeshSides::One).is_empty());
        for (z, sides, normal, gap) in [
            (0.25, MeshSides::One, Vec3::z(), -0.25),
            (-0.25, MeshSides::One, Vec3::z(), -0.75),
            (-0.25, MeshSides::Both, -Vec3::z(), -0.25),
            (-0.53125, MeshSides::Both, -Vec3::z(), 0.03125),
        ] {
            let found = at(z, sides);
            assert_eq!((found.len(), found[0].normal, found[0].gap()), (1, normal, gap));
            assert_eq!((found[0].points.len(), found[0].area), (4, 1.0));
        }
    }
}
