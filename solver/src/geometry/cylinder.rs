//! A polyhedron against a solid cylinder.
//!
//! s(m) = min_A m·a - max_B m·b for a unit m from the cylinder B to the polyhedron A is a lower bound of their distance,
//! and -s a translation that separates them if they overlap. Its maximum is at one of these directions, which are all
//! tried: the normal of a face of A or of an end of B; the common perpendicular of an edge of A and the axis; from the
//! axis, or the rim, to a vertex; from the rim to an edge. Seen along the edge the rim is an ellipse, and m its normal
//! through the edge.

use smallvec::SmallVec;

use super::manifold::{ContactPoint, ListingRange, Manifold, edge_feature, face_feature, vertex_feature};
use super::pair::{MIN_FACE_COSINE, PatchCorner};
use super::patch::{ContactPatch, ON_SIDE_DISTANCE, Polygon, clipped_to_gap, share_at_tilt};
use super::polyhedron::PosedPolyhedron;
use super::search::{aligned_face, edge_ends, support_face};
use crate::math::simd::Scalar;
use crate::math::{Quat, Vec3};

/// Feature of a cylinder: its round side.
pub const CYLINDER_SIDE: u32 = 0;
/// Feature of a cylinder: the end along its axis.
pub const CYLINDER_END: u32 = 1;
/// Feature of a cylinder: the end against its axis.
pub const CYLINDER_OTHER_END: u32 = 2;
/// Feature of a cylinder: its rims, several of which differ by this number and those after it.
pub const CYLINDER_RIM: u32 = 3;

/// Contact of polyhedron A with a solid cylinder of `[half height, radius]` (m) at `c` = x_B - x_A (m) with the
/// orientation `q`, its axis the third; `None` if they are farther apart than `range` lists.
///
/// A face of A on an end of B gives the corners and the area of their common part; a face or an edge along the round side
/// gives the ends of their common line. The normal is the direction of smallest distance, or of the smallest translation
/// that separates overlapping bodies. The cylinder's feature is 0 for the side, 1 for the end along its axis, 2 for the
/// other end, and more for points on a rim.
///
/// ```
/// # use cd_solve::geometry::{Polyhedron, polyhedron_cylinder};
/// # use cd_solve::math::{Quat, Vec3};
/// let cube = Polyhedron::cuboid(&Vec3::repeat(1.0));
/// let posed = cube.posed_by(&Quat::identity());
/// // The cube stands on the end of a pillar.
/// let c = Vec3::new(0.0, 0.0, -3.5);
/// let found = polyhedron_cylinder(&posed, &c, &Quat::identity(), [2.25, 4.0], 0.5).unwrap();
/// assert_eq!((found.normal, found.gap(), found.points.len(), found.area), (Vec3::z(), 0.25, 4, 4.0));
/// ```
pub fn polyhedron_cylinder(
    a: &PosedPolyhedron,
    c: &Vec3,
    q: &Quat,
    [half_height, radius]: [f64; 2],
    range: impl Into<ListingRange>,
) -> Option<Manifold> {
    let range = range.into();
    let centre = q.inverse_transform_vector(&-c);
    let away = (centre.xy().norm() - radius).max(centre.z.abs() - half_height);
    if away - a.shape.circumradius() > range.alert {
        return None;
    }
    let pair = CylinderPair::new(a, c, q, [half_height, radius]);
    let axis = pair.best_axis();
    if axis.s > range.alert {
        return None;
    }
    let patch = pair.common_part(&axis, range.area);
    if patch.has_axis_gap(axis.s, pair.tie) {
        return pair.manifold(patch, range);
    }
    let point = pair.axis_point(&axis);
    Some(Manifold { normal: q * axis.m, points: [point].into_iter().collect(), area: 0.0 })
}

/// Contact of polyhedron A with the end of a solid cylinder along the given unit normal `n`, from B to A, which is that of
/// the end: the corners of the common part of the end and the face of A that faces it. `None` if there is no common part
/// within the range, or if `n` is not along the axis to 10⁻³ rad. Other arguments as in [`polyhedron_cylinder`].
///
/// No search is made: the caller knows that a plane across `n` separates the two.
pub fn polyhedron_end_along(
    a: &PosedPolyhedron,
    c: &Vec3,
    q: &Quat,
    size: [f64; 2],
    n: &Vec3,
    range: ListingRange,
) -> Option<Manifold> {
    let local_normal = q.inverse_transform_vector(n);
    if local_normal.xy().norm() > MAX_END_DEVIATION {
        return None;
    }
    CylinderPair::new(a, c, q, size).manifold_along(Vec3::z() * 1f64.copysign(local_normal.z), range)
}

/// Contact of polyhedron A with a solid cylinder along the given unit normal `n`, from B to A: the corners of the common
/// part of the face of A and the end or the line of the round side that face each other. `None` if there is no common part
/// within the range. Other arguments as in [`polyhedron_cylinder`].
///
/// No search is made: the caller knows that a plane across `n` separates the two.
///
/// ```
/// # use cd_solve::geometry::{Polyhedron, polyhedron_cylinder, polyhedron_cylinder_along};
/// # use cd_solve::math::{Quat, Vec3};
/// // A cylinder lies on the upper side of a cube, beyond whose edge it reaches by half its length.
/// let cube = Polyhedron::cuboid(&Vec3::repeat(1.0));
/// let posed = cube.posed_by(&Quat::identity());
/// let (c, q) = (Vec3::new(1.0, 0.0, 1.25), Quat::rotation_between(&Vec3::z(), &Vec3::x()).unwrap());
/// let found = polyhedron_cylinder_along(&posed, &c, &q, [0.5, 0.25], &-Vec3::z(), 0.125.into()).unwrap();
/// assert_eq!((found.normal, found.points.len()), (-Vec3::z(), 2));
/// assert!(found.points.iter().all(|point| point.gap.abs() < 1e-15 && point.position.x < 1.0 + 1e-15));
/// ```
pub fn polyhedron_cylinder_along(
    a: &PosedPolyhedron,
    c: &Vec3,
    q: &Quat,
    size: [f64; 2],
    n: &Vec3,
    range: ListingRange,
) -> Option<Manifold> {
    CylinderPair::new(a, c, q, size).manifold_along(q.inverse_transform_vector(n), range)
}

/// Largest sine of the angle between the axis and the normal of a flush surface, as for faces of flush joints.
pub(super) const MAX_END_DEVIATION: f64 = 1e-3;

/// Polyhedron A and cylinder B.
struct CylinderPair<'a> {
    a: &'a PosedPolyhedron<'a>,
    /// Position of B's centre relative to A's, x_B - x_A, world frame, m.
    c: &'a Vec3,
    /// Orientation of B, from its axes to the world.
    q: &'a Quat,
    /// Half height and radius of B, m.
    half_height: f64,
    radius: f64,
    /// Vertices of A relative to the cylinder's centre along its axes, m. All vectors here are in this frame unless
    /// stated otherwise.
    vertices: SmallVec<[Vec3; 32]>,
    /// Smaller of the circumradii of A and B, m.
    smaller_circumradius: f64,
    /// Smallest improvement by which a direction replaces an earlier one, m.
    tie: f64,
}

/// Feature of A that determines a direction.
#[derive(Debug, Clone, Copy)]
enum CylinderFeature {
    Face(u32),
    Edge(u32),
    Vertex,
}

/// Direction with the separation along it.
#[derive(Debug, Clone, Copy)]
struct CylinderSearchAxis {
    /// Unit direction from the cylinder to A, along the cylinder's axes.
    m: Vec3,
    /// Separation s(m), m, < 0 if the two overlap in this direction.
    s: f64,
    /// Feature of A that determines the direction.
    feature: CylinderFeature,
}

impl<'a> CylinderPair<'a> {
    fn new(a: &'a PosedPolyhedron<'a>, c: &'a Vec3, q: &'a Quat, [half_height, radius]: [f64; 2]) -> Self {
        let size = libm::hypot(radius, half_height);
        let circumradius_sum = a.shape.circumradius() + size;
        let smaller_circumradius = a.shape.circumradius().min(size);
        let local = |v: Vec3| q.inverse_transform_vector(&(v - c));
        let vertices = (0..a.shape.vertices().len() as u32).map(|k| local(a.vertex(k))).collect();
        let tie = 4e-12 * smaller_circumradius + 32.0 * f64::EPSILON * circumradius_sum;
        CylinderPair { a, c, q, half_height, radius, vertices, smaller_circumradius, tie }
    }

    /// Corners of the common part along a direction.
    fn common_part(&self, axis: &CylinderSearchAxis, area_within: f64) -> ContactPatch {
        let mut patch = ContactPatch { normal: -(self.q * axis.m), ..ContactPatch::default() };
        let f = self.contact_face(axis);
        if axis.m.z.abs() >= axis.m.xy().norm() {
            self.collect_end_corners(&axis.m, f, area_within, &mut patch);
        } else {
            self.collect_side_corners(&axis.m, f, &mut patch);
        }
        for corner in &mut patch.corners {
            // The gap of the direction itself, if the two differ by rounding only.
            corner.gap = if corner.gap <= axis.s + self.tie { axis.s } else { corner.gap };
        }
        patch
    }

    /// Manifold of a common part; `None` if no point is within the range.
    fn manifold(&self, mut patch: ContactPatch, range: ListingRange) -> Option<Manifold> {
        let mut manifold = Manifold::default();
        patch.write_manifold(range, self.tie, &mut manifold);
        (!manifold.points.is_empty()).then_some(manifold)
    }

    /// Manifold of the common part along the unit direction `m`; `None` if no point is within the range.
    fn manifold_along(&self, m: Vec3, range: ListingRange) -> Option<Manifold> {
        let axis = CylinderSearchAxis { m, s: self.separation(&m), feature: CylinderFeature::Vertex };
        self.manifold(self.common_part(&axis, range.area), range)
    }

    /// Separation of the two along the unit direction `m`, m.
    fn separation(&self, m: &Vec3) -> f64 {
        let reach = self.radius * m.xy().norm() + self.half_height * m.z.abs();
        m.dot(&self.vertices[self.lowest_vertex(m)]) - reach
    }

    /// Returns the best direction.
    fn best_axis(&self) -> CylinderSearchAxis {
        let (shape, posed) = (self.a.shape, self.a);
        let mut best = CylinderSearchAxis { m: Vec3::z(), s: f64::NEG_INFINITY, feature: CylinderFeature::Vertex };
        for f in 0..shape.face_planes().len() as u32 {
            let m = -self.q.inverse_transform_vector(&posed.face_normal(f));
            self.try_axis(&mut best, m, CylinderFeature::Face(f));
        }
        self.try_axis(&mut best, Vec3::z(), CylinderFeature::Vertex);
        self.try_axis(&mut best, -Vec3::z(), CylinderFeature::Vertex);
        for (e, edge) in shape.edges().iter().enumerate() {
            let feature = CylinderFeature::Edge(e as u32);
            // Perpendicular to the axis, between the normals on both sides of the edge: accurate even if the edge is
            // nearly parallel to the axis.
            let [n0, n1] = edge.faces.map(|f| self.q.inverse_transform_vector(&posed.face_normal(f)));
            if n0.z * n1.z < 0.0 {
                let across = n0 * n1.z.abs() + n1 * n0.z.abs();
                self.try_axis(&mut best, -Vec3::new(across.x, across.y, 0.0).normalize(), feature);
            }
            let ends = edge.ends.map(|v| self.vertices[usize::from(v)]);
            let size = [self.half_height, self.radius];
            for m in rim_to_edge(ends, size, best.s + self.tie).into_iter().flatten() {
                self.try_axis(&mut best, m, feature);
            }
        }
        for v in &self.vertices {
            let distance_from_axis = v.xy().norm();
            if distance_from_axis > 0.0 {
                self.try_axis(&mut best, Vec3::new(v.x, v.y, 0.0) / distance_from_axis, CylinderFeature::Vertex);
            }
            let (side_distance, end_distance) = (distance_from_axis - self.radius, v.z.abs() - self.half_height);
            if side_distance > 0.0 && end_distance > 0.0 {
                let from_rim = Vec3::new(
                    v.x * side_distance / distance_from_axis,
                    v.y * side_distance / distance_from_axis,
                    end_distance.copysign(v.z),
                );
                self.try_axis(&mut best, from_rim.normalize(), CylinderFeature::Vertex);
            }
        }
        best
    }

    /// Replaces `best` by a direction that is clearly better.
    fn try_axis(&self, best: &mut CylinderSearchAxis, m: Vec3, feature: CylinderFeature) {
        let s = self.separation(&m);
        if s > best.s + self.tie {
            // An edge on the far side gives the same direction.
            let lowest = m.dot(&self.vertices[self.lowest_vertex(&m)]);
            let is_lowest = |end: u16| m.dot(&self.vertices[usize::from(end)]) <= lowest + self.tie;
            let feature = match feature {
                CylinderFeature::Edge(e) if !self.a.shape.edges()[e as usize].ends.into_iter().any(is_lowest) => {
                    CylinderFeature::Vertex
                }
                feature => feature,
            };
            *best = CylinderSearchAxis { m, s, feature };
        }
    }

    /// Returns the first vertex that is lowest along `m`.
    fn lowest_vertex(&self, m: &Vec3) -> usize {
        let (mut lowest, mut height_of_lowest) = (0, f64::INFINITY);
        for (k, v) in self.vertices.iter().enumerate() {
            let height = m.dot(v);
            if height < height_of_lowest {
                (lowest, height_of_lowest) = (k, height);
            }
        }
        lowest
    }

    /// Returns the face of A that faces the cylinder.
    fn contact_face(&self, axis: &CylinderSearchAxis) -> u32 {
        let towards = -(self.q * axis.m);
        match axis.feature {
            CylinderFeature::Face(f) => f,
            CylinderFeature::Edge(e) => aligned_face(self.a, e, &towards),
            CylinderFeature::Vertex => support_face(Scalar, self.a, &towards, None),
        }
    }

    /// Converts a point to the world's axes, relative to the centre of A.
    fn to_world(&self, x: &Vec3) -> Vec3 {
        self.q * x + self.c
    }

    /// Corner of A opposite a point of the cylinder.
    fn corner_at(&self, on_b: Vec3, m: &Vec3, gap: f64, flat: [f64; 2], features: (u32, u32)) -> PatchCorner {
        PatchCorner { point: self.to_world(&(on_b + m * (0.5 * gap))).into(), flat, gap, features }
    }

    /// Collects the corners of the common part of a face of A and the cylinder's end along `m`, seen along `m` in the
    /// plane of the end.
    fn collect_end_corners(&self, m: &Vec3, f: u32, area_within: f64, patch: &mut ContactPatch) {
        let (shape, posed) = (self.a.shape, self.a);
        let height = self.half_height.copysign(m.z);
        let end = if m.z > 0.0 { CYLINDER_END } else { CYLINDER_OTHER_END };
        let tiny = ON_SIDE_DISTANCE * self.smaller_circumradius;
        let (corners, sides) = (shape.face_corners(f as usize), shape.face_edges(f as usize));
        let corner_over_end = |&v: &u16| {
            let v = self.vertices[v as usize];
            let gap = (v.z - height) / m.z;
            let foot = v - m * gap;
            [foot.x, foot.y, gap]
        };
        let outline: Polygon = corners.iter().map(corner_over_end).collect();
        let next_index = |k: usize| if k + 1 == outline.len() { 0 } else { k + 1 };
        let on_end = |x: f64, y: f64| Vec3::new(x, y, height);
        for (k, [x, y, gap]) in outline.iter().enumerate() {
            if libm::hypot(*x, *y) <= self.radius + tiny {
                patch.corners.push(self.corner_at(
                    on_end(*x, *y),
                    m,
                    *gap,
                    [*x, *y],
                    (vertex_feature(corners[k].into()), end),
                ));
            }
        }
        let vertex_count = patch.corners.len();
        for (k, p) in outline.iter().enumerate() {
            let along = [0, 1, 2].map(|i| outline[next_index(k)][i] - p[i]);
            let square = along[0] * along[0] + along[1] * along[1];
            let half = p[0] * along[0] + p[1] * along[1];
            let root = half * half - square * (p[0] * p[0] + p[1] * p[1] - self.radius * self.radius);
            if root <= 0.0 || square <= tiny * tiny {
                continue;
            }
            for (enters, root) in [(0, -root.sqrt()), (1, root.sqrt())] {
                let share = (root - half) / square;
                if !(0.0..=1.0).contains(&share) {
                    continue;
                }
                let [x, y, gap] = [0, 1, 2].map(|i| p[i] + along[i] * share);
                if !patch.corners[..vertex_count].iter().any(|corner| corner.is_near([x, y], self.smaller_circumradius))
                {
                    patch.corners.push(self.corner_at(
                        on_end(x, y),
                        m,
                        gap,
                        [x, y],
                        (edge_feature(sides[k].into()), CYLINDER_RIM + enters),
                    ));
                }
            }
        }
        let doubled: f64 = (0..outline.len())
            .map(|k| outline[k][0] * outline[next_index(k)][1] - outline[k][1] * outline[next_index(k)][0])
            .sum();
        let normal = self.q.inverse_transform_vector(&posed.face_normal(f));
        let rise = normal.dot(m);
        if rise.abs() < MIN_FACE_COSINE || doubled.abs() <= tiny * self.smaller_circumradius {
            return; // seen as a line
        }
        // Points where the rim extends farthest: four fixed ones, and the one over which the face is lowest.
        let fall = normal.xy() / rise;
        let mut rim: SmallVec<[[f64; 2]; 5]> =
            SmallVec::from_slice(&[[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]);
        if fall.norm() * self.radius > tiny {
            rim.push((fall / fall.norm()).into());
        }
        let offset = normal.dot(&self.vertices[corners[0] as usize]);
        let rim_corner = |k: usize, direction: [f64; 2]| {
            let [x, y] = direction.map(|x| x * self.radius);
            let is_inside_edge = |k: usize| {
                let (p, q) = (outline[k], outline[next_index(k)]);
                ((q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])) * doubled > 0.0
            };
            (0..outline.len()).all(is_inside_edge).then(|| {
                let gap = (offset - normal.dot(&on_end(x, y))) / rise;
                self.corner_at(on_end(x, y), m, gap, [x, y], (face_feature(f), CYLINDER_RIM + 2 + k as u32))
            })
        };
        patch.corners.extend(rim.iter().enumerate().filter_map(|(k, direction)| rim_corner(k, *direction)));
        // If the common part is a segment between these two: adds the middle of its arc, or a face would rest on a line.
        if let [p, q] = patch.corners[..]
            && p.features.0 == q.features.0
        {
            let (x, y) = (p.flat[1] - q.flat[1], q.flat[0] - p.flat[0]);
            let towards = doubled.signum() / libm::hypot(x, y);
            // One fixed number, whether the face is tilted or not.
            patch.corners.extend(rim_corner(5, [x * towards, y * towards]));
        }
        patch.area = area_in_disc(&clipped_to_gap(&outline, area_within), self.radius) * m.z.abs();
        if area_within != f64::INFINITY {
            patch.area *= share_at_tilt(&outline);
        }
    }

    /// Collects the corners of the common part of a face of A and the line of the round side along `m`, seen along `m` in
    /// the tangent plane.
    fn collect_side_corners(&self, m: &Vec3, f: u32, patch: &mut ContactPatch) {
        let shape = self.a.shape;
        let out = Vec3::new(m.x, m.y, 0.0) / m.xy().norm();
        let across = Vec3::z().cross(&out);
        let tiny = ON_SIDE_DISTANCE * self.smaller_circumradius;
        let (corners, sides) = (shape.face_corners(f as usize), shape.face_edges(f as usize));
        let corner_over_side = |v: u16| {
            let v = self.vertices[v as usize];
            let gap = (v.dot(&out) - self.radius) / m.dot(&out);
            let foot = v - m * gap;
            [across.dot(&foot), foot.z, gap]
        };
        // Height along the axis, gap and feature of A at each crossing of the face's outline with the line.
        let mut crossings: SmallVec<[(f64, f64, u32); 4]> = SmallVec::new();
        for (k, &v) in corners.iter().enumerate() {
            let p = corner_over_side(v);
            let q = corner_over_side(corners[if k + 1 == corners.len() { 0 } else { k + 1 }]);
            if p[0].abs() <= tiny {
                crossings.push((p[1], p[2], vertex_feature(v.into())));
            } else if (p[0] > tiny && q[0] < -tiny) || (p[0] < -tiny && q[0] > tiny) {
                let share = p[0] / (p[0] - q[0]);
                crossings.push((
                    p[1] + (q[1] - p[1]) * share,
                    p[2] + (q[2] - p[2]) * share,
                    edge_feature(sides[k].into()),
                ));
            }
        }
        let mut add_corner = |z: f64, gap: f64, features: (u32, u32)| {
            let on_side = out * self.radius + Vec3::z() * z;
            patch.corners.push(self.corner_at(on_side, m, gap, [0.0, z], features));
        };
        let mut ends = [(f64::INFINITY, 0.0), (f64::NEG_INFINITY, 0.0)];
        for &(z, gap, feature) in &crossings {
            if z.abs() <= self.half_height + tiny {
                add_corner(z, gap, (feature, CYLINDER_SIDE));
            }
            ends[0] = if z < ends[0].0 { (z, gap) } else { ends[0] };
            ends[1] = if z > ends[1].0 { (z, gap) } else { ends[1] };
        }
        let [(low, gap_low), (high, gap_high)] = ends;
        for (end, z) in [(CYLINDER_END, self.half_height), (CYLINDER_OTHER_END, -self.half_height)] {
            if low < z - tiny && z + tiny < high {
                add_corner(z, gap_low + (gap_high - gap_low) * ((z - low) / (high - low)), (face_feature(f), end));
            }
        }
    }

    /// Point of the outline of face `f`, seen along `m`, that is nearest to `point`.
    fn nearest_on_outline(&self, f: u32, point: &Vec3, m: &Vec3) -> Vec3 {
        let corners = self.a.shape.face_corners(f as usize);
        let on_side = |k: usize| {
            let [from, to] = [corners[k], corners[(k + 1) % corners.len()]].map(|v| self.vertices[v as usize]);
            let share = (point - from).dot(&(to - from)) / (to - from).norm_squared();
            from + (to - from) * share.clamp(0.0, 1.0)
        };
        let squared_distance = |on_a: &Vec3| (point - on_a - m * m.dot(&(point - on_a))).norm_squared();
        let sides = (0..corners.len()).map(on_side);
        sides.min_by(|a, b| squared_distance(a).total_cmp(&squared_distance(b))).unwrap_or(*point)
    }

    /// Contact point of the direction's own features.
    fn axis_point(&self, axis: &CylinderSearchAxis) -> ContactPoint {
        let m = &axis.m;
        let lowest = self.lowest_vertex(m);
        let mut on_b = Vec3::z() * self.half_height.copysign(m.z);
        if m.xy().norm() > 0.0 {
            on_b += Vec3::new(m.x, m.y, 0.0) * (self.radius / m.xy().norm());
        }
        let (on_a, feature) = match axis.feature {
            CylinderFeature::Edge(e) => {
                let [from, to] = edge_ends(self.a, e).map(|v| self.q.inverse_transform_vector(&(v - self.c)));
                let share = (on_b - from).dot(&(to - from)) / (to - from).norm_squared();
                (from + (to - from) * share.clamp(0.0, 1.0), edge_feature(e))
            }
            CylinderFeature::Face(f) => {
                if m.z == 0.0 {
                    on_b.z = self.vertices[lowest].z.clamp(-self.half_height, self.half_height);
                }
                (self.nearest_on_outline(f, &on_b, m), face_feature(f))
            }
            CylinderFeature::Vertex => (self.vertices[lowest], vertex_feature(lowest as u32)),
        };
        ContactPoint {
            position: self.to_world(&(on_a - m * (0.5 * axis.s))),
            gap: axis.s,
            features: (feature, CYLINDER_RIM),
        }
    }
}

/// Directions from the rim of either end of a cylinder of `[half height, radius]` (m) to the line through two points, relative
/// to its centre along its axes, in which the separation is largest, if larger than `min_separation` (m).
///
/// With u and w across the line, u level, a rim seen along the line is an ellipse with the semi-axes R and R k. On
/// m = x u + y w, f = a x + b y - R sqrt(x^2 + k^2 y^2) has one maximum with y on each side, where x has a's sign.
pub(super) fn rim_to_edge(
    [p, to]: [Vec3; 2],
    [half_height, radius]: [f64; 2],
    min_separation: f64,
) -> [Option<Vec3>; 2] {
    let along = (to - p).normalize();
    let level = libm::hypot(along.x, along.y);
    if level == 0.0 {
        return [None; 2];
    }
    let u = Vec3::new(-along.y, along.x, 0.0) / level;
    let w = along.cross(&u);
    let (a, k) = (u.dot(&p), along.z.abs());
    [1.0, -1.0].map(|side| {
        let b = side * w.dot(&p) - half_height * w.z.abs();
        if libm::hypot(a, b.max(0.0)) - radius * k <= min_separation {
            return None;
        }
        let (x, y) = rim_maximum(a.abs(), b, radius, k)?;
        Some((u * x.copysign(a) + w * (side * y)).normalize())
    })
}

/// Unit vector (x, y) in the first quadrant at which f = a x + b y - r sqrt(x^2 + k^2 y^2) has an inner maximum; a >= 0,
/// k <= 1. `None` if f is largest at an end of the quadrant.
///
/// Newton's method in a bracket, on t = tan(angle / 2).
pub(super) fn rim_maximum(a: f64, b: f64, r: f64, k: f64) -> Option<(f64, f64)> {
    let flatness = 1.0 - k * k;
    let unit_vector = |t: f64| ((1.0 - t * t) / (1.0 + t * t), 2.0 * t / (1.0 + t * t));
    // First and second derivative with respect to the angle.
    let derivatives = |t: f64| {
        let (x, y) = unit_vector(t);
        let g = libm::hypot(x, k * y);
        let (share, curvature) =
            if g > 0.0 { (x / g, (x * x - y * y) / g + flatness * (x * y / g).powi(2) / g) } else { (1.0, 0.0) };
        (b * x - a * y + r * flatness * y * share, r * flatness * curvature - a * x - b * y)
    };
    let (mut low, mut high) = (0.0, 1.0);
    if b <= 0.0 {
        // Past the middle of the ellipse f decreases first. The bracket goes from where it rises to where it falls again,
        // if it rises.
        let rises = |i: &usize| derivatives(*i as f64 / BRACKET_SAMPLES as f64).0 > 0.0;
        let rising = (1..BRACKET_SAMPLES).find(rises)?;
        low = rising as f64 / BRACKET_SAMPLES as f64;
        high = (rising + 1..BRACKET_SAMPLES).find(|i| !rises(i)).map_or(1.0, |i| i as f64 / BRACKET_SAMPLES as f64);
    }
    let mut t = if b > 0.0 { b / (a + libm::hypot(a, b)) } else { low };
    for _ in 0..100 {
        let (slope, bend) = derivatives(t);
        if slope > 0.0 {
            low = t;
        } else {
            high = t;
        }
        let newton = t - slope / bend * (1.0 + t * t) / 2.0;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - t).abs() <= f64::EPSILON {
            break;
        }
        t = next;
    }
    Some(unit_vector(t))
}

/// Number of samples with which a maximum past the middle is bracketed.
const BRACKET_SAMPLES: usize = 32;

/// Area of the common part of a convex polygon and a disc about the origin, m^2.
pub(super) fn area_in_disc(polygon: &[[f64; 3]], radius: f64) -> f64 {
    let cross = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
    let sector = |p: [f64; 2], q: [f64; 2]| radius * radius * libm::atan2(cross(p, q), p[0] * q[0] + p[1] * q[1]);
    let mut doubled = 0.0;
    for (k, &[x, y, _]) in polygon.iter().enumerate() {
        let [u, v, _] = polygon[if k + 1 == polygon.len() { 0 } else { k + 1 }];
        let (p, q, along) = ([x, y], [u, v], [u - x, v - y]);
        let square = along[0] * along[0] + along[1] * along[1];
        let half = x * along[0] + y * along[1];
        let root = half * half - square * (x * x + y * y - radius * radius);
        if root <= 0.0 || square == 0.0 {
            doubled += sector(p, q);
            continue;
        }
        // Fractions of the side at which it enters and leaves the disc.
        let [enter, leave] = [-root.sqrt(), root.sqrt()].map(|root| ((root - half) / square).clamp(0.0, 1.0));
        // The end itself: next to the middle of the disc, its rounding would turn the direction from there by any angle.
        let line_point = |share: f64| if share == 1.0 { q } else { [x + along[0] * share, y + along[1] * share] };
        if enter >= leave {
            doubled += sector(p, q);
        } else {
            doubled += sector(p, line_point(enter))
                + cross(line_point(enter), line_point(leave))
                + sector(line_point(leave), q);
        }
    }
    (0.5 * doubled).abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Polyhedron;

    /// A cube that touches a cylinder with an edge along its axis, for each edge in turn; the far edge has the same
    /// direction.
    #[test]
    fn the_edge_that_is_near_is_the_one_that_touches() {
        let cube = Polyhedron::cuboid(&Vec3::repeat(0.5));
        let tilt = Quat::from_scaled_axis(Vec3::new(0.3, -0.5, 0.7));
        for k in 0..4 {
            let turn = Quat::from_axis_angle(&Vec3::z_axis(), std::f64::consts::FRAC_PI_4 * f64::from(2 * k + 1));
            let axes = tilt * turn;
            let posed = cube.posed_by(&axes);
            let away = 0.5f64.sqrt() + 1.0 + 0.01;
            let c = tilt * Vec3::new(-away, 0.0, 0.0);
            let found = polyhedron_cylinder(&posed, &c, &tilt, [2.0, 1.0], 0.1).unwrap();
            // Halfway between the edge and the round side, at its two ends; roundings of numbers of order 1.
            let expected = [-0.5, 0.5].map(|z| tilt * Vec3::new(-0.5f64.sqrt() - 0.005, 0.0, z));
            assert_eq!(found.points.len(), 2, "{k}: {found:?}");
            for point in &found.points {
                let distance = expected.map(|at| (point.position - at).norm());
                assert!(distance[0].min(distance[1]) < 1e-14 && (point.gap - 0.01).abs() < 1e-14, "{k}: {point:?}");
            }
        }
    }
}
