//! The common part of two faces seen along a normal: corners with their gaps, and the area.
//!
//! The same for face on face, edge on face, vertex on face and crossed edges, and the same for A and B: a corner is a
//! vertex of either polygon that lies in the other, or a crossing of two sides.

use smallvec::SmallVec;

use super::search::{Axis, Pair};
use super::{Manifold, Point, Polyhedron, Posed, Range, edge, face, vertex};
use crate::math::{Vec3, local_frame};

/// Distance from a side, over the smaller circumradius, up to which a vertex is on it: so that aligned faces keep
/// their vertices and have no crossings beside them.
pub(super) const ON_SIDE: f64 = 1e-11;
/// Distance up to which two corners are one.
pub(super) const SAME: f64 = 1e-9;
/// Cosine between a face's normal and the direction of view below which it is seen as a line.
pub(super) const EDGE_ON: f64 = 1e-9;
/// A corner must be deeper, farther or span more by this, to be preferred to one before it.
const CLEARLY: f64 = 1e-9;

#[derive(Default)]
pub(super) struct Patch {
    pub corners: SmallVec<[Corner; 12]>,
    /// From A to B.
    pub normal: Vec3,
    /// Of the common part as far as area counts, m^2.
    pub area: f64,
}

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Corner {
    pub point: [f64; 3],
    /// Seen along the normal.
    pub flat: [f64; 2],
    pub gap: f64,
    pub features: (u32, u32),
}

/// A face seen along the normal, counter-clockwise.
#[derive(Default)]
struct Outline {
    corners: SmallVec<[Seen; 8]>,
    /// Height above the plane's height at 0: h = height - slope·(x, y).
    height: f64,
    slope: [f64; 2],
}

/// A corner and the side from it to the next.
#[derive(Clone, Copy, Default)]
struct Seen {
    vertex: u32,
    edge: u32,
    at: [f64; 3],
    x: f64,
    y: f64,
    z: f64,
    /// Unit direction of the side; zero where it is seen end on.
    dx: f64,
    dy: f64,
}

impl Outline {
    /// `moved`: where the body is; `turned`: whether the face looks against the normal.
    #[inline(always)]
    fn fill(&mut self, (shape, posed): (&Polyhedron, &Posed), of: u32, moved: &Vec3, view: &View, turned: bool) {
        let [n, t, s] = &view.frame;
        let (vertices, edges) = (shape.corners(of as usize), shape.sides(of as usize));
        let count = vertices.len();
        for k in 0..count {
            // Against the normal corners and sides go the other way round.
            let (v, e) = match turned {
                true => (count - 1 - k, if k + 1 == count { k } else { count - 2 - k }),
                false => (k, k),
            };
            let at = posed.vertex(vertices[v]) + moved;
            let (x, y, z) = (at.dot(t), at.dot(s), at.dot(n));
            self.corners.push(Seen { vertex: vertices[v], edge: edges[e], at: at.into(), x, y, z, dx: 0.0, dy: 0.0 });
        }
        let corners = &mut self.corners[..];
        for k in 0..count {
            let next = if k + 1 == count { 0 } else { k + 1 };
            let (dx, dy) = (corners[next].x - corners[k].x, corners[next].y - corners[k].y);
            let length = (dx * dx + dy * dy).sqrt();
            if length > view.tiny {
                (corners[k].dx, corners[k].dy) = (dx / length, dy / length);
            }
        }
        let normal = posed.normal(of);
        let rise = normal.dot(n);
        if rise.abs() < EDGE_ON {
            // A line: level, at the height that comes nearest to the other body.
            let sign = if turned { -1.0 } else { 1.0 };
            self.height = sign * corners.iter().map(|corner| sign * corner.z).fold(f64::NEG_INFINITY, f64::max);
            return;
        }
        self.slope = [normal.dot(t) / rise, normal.dot(s) / rise];
        self.height = (shape.planes[of as usize].offset + normal.dot(moved)) / rise;
    }

    /// Height of the plane at a place.
    fn height(&self, x: f64, y: f64) -> f64 {
        self.height - (self.slope[0] * x + self.slope[1] * y)
    }

    /// Height of side `k` beside a place.
    fn side_height(&self, k: usize, x: f64, y: f64) -> f64 {
        let (from, to) = (self.corners[k], self.corners[if k + 1 == self.corners.len() { 0 } else { k + 1 }]);
        let length = (to.x - from.x) * from.dx + (to.y - from.y) * from.dy;
        let share = ((x - from.x) * from.dx + (y - from.y) * from.dy) / length;
        from.z + (to.z - from.z) * share.clamp(0.0, 1.0)
    }
}

/// How a patch is seen.
struct View {
    frame: [Vec3; 3],
    /// Distance up to which something is on a side, m.
    tiny: f64,
}

impl Patch {
    /// Faces of A and of B seen along an axis; area counts up to the gap `area_within`, m.
    pub fn see(&mut self, pair: &Pair, axis: &Axis, (face_a, face_b): (u32, u32), area_within: f64) {
        let n = &axis.n;
        let tiny = ON_SIDE * pair.small;
        let view = View { frame: local_frame(*n), tiny };
        let frame = &view.frame;
        let (mut a, mut b) = (Outline::default(), Outline::default());
        a.fill((pair.a, pair.pa), face_a, &Vec3::zeros(), &view, false);
        b.fill((pair.b, pair.pb), face_b, &pair.c, &view, true);
        let (na, nb) = (a.corners.len(), b.corners.len());
        // On the stack for all but faces of many corners.
        let (mut few, mut many) = ([f64::INFINITY; 72], Vec::new());
        let all = if 2 * na * nb <= few.len() {
            &mut few[..2 * na * nb]
        } else {
            many.resize(2 * na * nb, f64::INFINITY);
            &mut many[..]
        };
        let (of_a, of_b) = all.split_at_mut(na * nb);
        distances(&a, &b, of_a);
        distances(&b, &a, of_b);
        let (of_a, of_b) = (&*of_a, &*of_b);
        self.normal = *n;
        let patch = self;
        let inside = |distances: &[f64], sides: usize, stride: usize, k: usize| {
            (0..sides).all(|side| distances[side * stride + k] >= -tiny)
        };
        // On a side, the side itself counts: beside a ridge as sharp as a knife its plane falls away within rounding.
        let on_side = |distances: &[f64], stride: usize, side: usize, k: usize| distances[side * stride + k] <= tiny;
        for (k, v) in a.corners.iter().enumerate() {
            if inside(of_b, nb, na, k) {
                let mut gap = b.height(v.x, v.y) - v.z;
                for side in 0..nb {
                    if on_side(of_b, na, side, k) {
                        gap = gap.min(b.side_height(side, v.x, v.y) - v.z);
                    }
                }
                let point = Vec3::from(v.at) + n * (0.5 * gap);
                let features = (vertex(v.vertex), face(face_b));
                patch.corners.push(Corner { point: point.into(), flat: [v.x, v.y], gap, features });
            }
        }
        let of_vertices_of_a = patch.corners.len();
        for (k, v) in b.corners.iter().enumerate() {
            if !inside(of_a, na, nb, k) {
                continue;
            }
            let near = |corner: &&mut Corner| corner.is_near([v.x, v.y], pair.small);
            if let Some(same) = patch.corners[..of_vertices_of_a].iter_mut().find(near) {
                // Two vertices meet: their own heights.
                let n_height = Vec3::from(same.point).dot(n) - 0.5 * same.gap;
                let gap = v.z - n_height;
                let point = Vec3::from(same.point) + n * (0.5 * (gap - same.gap));
                (same.gap, same.point, same.features.1) = (gap, point.into(), vertex(v.vertex));
                continue;
            }
            let mut gap = v.z - a.height(v.x, v.y);
            for side in 0..na {
                if on_side(of_a, nb, side, k) {
                    gap = gap.min(v.z - a.side_height(side, v.x, v.y));
                }
            }
            let point = Vec3::from(v.at) - n * (0.5 * gap);
            let features = (face(face_a), vertex(v.vertex));
            patch.corners.push(Corner { point: point.into(), flat: [v.x, v.y], gap, features });
        }
        let of_vertices = patch.corners.len();
        for (i, v) in a.corners.iter().enumerate() {
            let next_i = if i + 1 == na { 0 } else { i + 1 };
            for (j, w) in b.corners.iter().enumerate() {
                let next_j = if j + 1 == nb { 0 } else { j + 1 };
                let (w0, w1) = (of_a[i * nb + j], of_a[i * nb + next_j]);
                let (v0, v1) = (of_b[j * na + i], of_b[j * na + next_i]);
                let apart = |x: f64, y: f64| (x > tiny && y < -tiny) || (x < -tiny && y > tiny);
                if !apart(w0, w1) || !apart(v0, v1) {
                    continue;
                }
                let on = |from: [f64; 3], to: [f64; 3], share: f64| Vec3::from(from).lerp(&Vec3::from(to), share);
                let (on_a, on_b) =
                    (on(v.at, a.corners[next_i].at, v0 / (v0 - v1)), on(w.at, b.corners[next_j].at, w0 / (w0 - w1)));
                let point = (on_a + on_b) * 0.5;
                let flat = [point.dot(&frame[1]), point.dot(&frame[2])];
                let gap = n.dot(&(on_b - on_a));
                let near = |corner: &&mut Corner| corner.is_near(flat, pair.small);
                if let Some(same) = patch.corners[..of_vertices].iter_mut().find(near) {
                    same.gap = same.gap.min(gap);
                    continue;
                }
                let features = (edge(v.edge), edge(w.edge));
                patch.corners.push(Corner { point: point.into(), flat, gap, features });
            }
        }
        patch.area = area(&patch.corners, area_within);
        for corner in &mut patch.corners {
            // Steep planes reach too far where a vertex on a side is outside by rounding.
            corner.gap = corner.gap.max(axis.s);
        }
    }

    /// Whether a corner has the gap of the axis: then two points of A and B are as near as the axis allows.
    pub fn holds(&self, s: f64, tie: f64) -> bool {
        self.corners.iter().any(|corner| corner.gap <= s + tie)
    }

    /// The corners that are listed, at most four of them; `small` is the smaller body's circumradius, m.
    pub fn manifold(&mut self, small: f64, range: Range) -> Option<Manifold> {
        self.corners.retain(|corner| corner.gap <= range.alert);
        self.corners.sort_unstable_by_key(|corner| corner.features);
        if self.corners.len() > 4 {
            let mut kept = reduce(&self.corners, small);
            kept.sort_unstable();
            self.corners = kept.iter().map(|&k| self.corners[k]).collect();
        }
        let point = |c: &Corner| Point { position: c.point.into(), gap: c.gap, features: c.features };
        let points: super::Points = self.corners.iter().map(point).collect();
        (!points.is_empty()).then_some(Manifold { normal: -self.normal, points, area: self.area })
    }
}

impl Corner {
    pub fn is_near(&self, [x, y]: [f64; 2], small: f64) -> bool {
        let same = SAME * small;
        (self.flat[0] - x).abs() <= same && (self.flat[1] - y).abs() <= same
    }

    /// Middle of the shortest way between two lines that are not parallel.
    pub fn crossing([a0, a1]: [Vec3; 2], [b0, b1]: [Vec3; 2]) -> Vec3 {
        let (u, v, w) = (a1 - a0, b1 - b0, a0 - b0);
        let (uu, uv, vv, uw, vw) = (u.dot(&u), u.dot(&v), v.dot(&v), u.dot(&w), v.dot(&w));
        let d = uu * vv - uv * uv;
        let (x, y) = ((uv * vw - vv * uw) / d, (uu * vw - uv * uw) / d);
        ((a0 + u * x) + (b0 + v * y)) * 0.5
    }
}

/// Distance of each corner of `other` to the inside of each side of `of`; side by side. Infinite for a side seen end
/// on, which bounds nothing.
#[inline(always)]
fn distances(of: &Outline, other: &Outline, all: &mut [f64]) {
    for (row, side) in all.chunks_exact_mut(other.corners.len()).zip(&of.corners) {
        if side.dx != 0.0 || side.dy != 0.0 {
            for (distance, p) in row.iter_mut().zip(&other.corners) {
                *distance = side.dx * (p.y - side.y) - side.dy * (p.x - side.x);
            }
        }
    }
}

/// Of the convex polygon of the corners as far as its gap, which is linear on it, is at most `within` (m), m^2.
fn area(corners: &[Corner], within: f64) -> f64 {
    if corners.len() < 3 {
        return 0.0;
    }
    let count = corners.len() as f64;
    let mean = corners.iter().fold([0.0; 2], |m, c| [m[0] + c.flat[0] / count, m[1] + c.flat[1] / count]);
    // By a number that grows with the angle.
    let mut around: SmallVec<[(f64, [f64; 3]); 12]> = SmallVec::new();
    for corner in corners {
        let (x, y) = (corner.flat[0] - mean[0], corner.flat[1] - mean[1]);
        let reach = x.abs() + y.abs();
        let turn = if reach == 0.0 { 0.0 } else { (1.0 - x / reach).copysign(y) };
        around.push((turn, [x, y, corner.gap]));
    }
    around.sort_unstable_by(|p, q| p.0.total_cmp(&q.0));
    let mut polygon: Polygon = around.into_iter().map(|(_, corner)| corner).collect();
    if polygon.iter().any(|corner| corner[2] > within) {
        polygon = nearer_than(&polygon, within);
    }
    let mut doubled = 0.0;
    for (k, &[x, y, _]) in polygon.iter().enumerate() {
        let [next_x, next_y, _] = polygon[if k + 1 == polygon.len() { 0 } else { k + 1 }];
        doubled += x * next_y - y * next_x;
    }
    (0.5 * doubled).max(0.0)
}

/// Corners x, y and gap, m.
pub(super) type Polygon = SmallVec<[[f64; 3]; 12]>;

/// What of a convex polygon has gaps up to `within`, m: one side of a straight line.
pub(super) fn nearer_than(polygon: &[[f64; 3]], within: f64) -> Polygon {
    let mut nearer = Polygon::new();
    for (k, p) in polygon.iter().enumerate() {
        let q = &polygon[if k + 1 == polygon.len() { 0 } else { k + 1 }];
        if p[2] <= within {
            nearer.push(*p);
        }
        if (p[2] <= within) != (q[2] <= within) {
            let share = (within - p[2]) / (q[2] - p[2]);
            nearer.push([0, 1, 2].map(|i| p[i] + (q[i] - p[i]) * share));
        }
    }
    nearer
}

/// Four of many corners: the deepest, the farthest from it, and on each side of their line the one that spans most.
///
/// Earlier corners are preferred to others that are not clearly better, so that noise does not change the choice.
fn reduce(corners: &[Corner], small: f64) -> SmallVec<[usize; 4]> {
    let best = |value: &dyn Fn(&Corner) -> f64, least: f64| {
        let (mut best, mut most) = (None, 0.0);
        for (k, corner) in corners.iter().enumerate() {
            let value = value(corner);
            if best.is_none() && value > least || best.is_some() && value > most + least {
                (best, most) = (Some(k), value);
            }
        }
        best
    };
    let (near, span) = (CLEARLY * small, CLEARLY * small * small);
    let mut kept = SmallVec::new();
    // Gaps count from the first, so that any number may be the deepest.
    let deepest = best(&|c| corners[0].gap - c.gap, near).unwrap_or(0);
    kept.push(deepest);
    let [x, y] = corners[deepest].flat;
    let Some(far) = best(&|c| (c.flat[0] - x).powi(2) + (c.flat[1] - y).powi(2), span) else { return kept };
    kept.push(far);
    let [u, v] = [corners[far].flat[0] - x, corners[far].flat[1] - y];
    let spanned = |c: &Corner| u * (c.flat[1] - y) - v * (c.flat[0] - x);
    kept.extend(best(&spanned, span));
    kept.extend(best(&|c| -spanned(c), span));
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::search::{Feature, Start, search};
    use crate::geometry::{Narrow, tests::rock};
    use crate::math::Quat;
    use crate::math::lanes::Width;

    /// Sutherland and Hodgman's: each side of `by` cuts what is left.
    fn clipped(mut of: Vec<[f64; 2]>, by: &[[f64; 2]]) -> Vec<[f64; 2]> {
        for k in 0..by.len() {
            let (a, b) = (by[k], by[(k + 1) % by.len()]);
            let side = |p: &[f64; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
            let mut left = Vec::new();
            for i in 0..of.len() {
                let (u, v) = (of[i], of[(i + 1) % of.len()]);
                let (du, dv) = (side(&u), side(&v));
                if du >= 0.0 {
                    left.push(u);
                }
                if (du > 0.0 && dv < 0.0) || (du < 0.0 && dv > 0.0) {
                    let share = du / (du - dv);
                    left.push([u[0] + (v[0] - u[0]) * share, u[1] + (v[1] - u[1]) * share]);
                }
            }
            of = left;
        }
        of
    }

    #[test]
    fn patches_are_those_of_clipping() {
        let (a, b) = (rock(0.0), rock(1.0));
        let (mut pa, mut pb) = (Posed::default(), Posed::default());
        let mut many = [0; 12];
        for k in 0..3000 {
            let k = f64::from(k);
            pa.pose(&a, &Quat::from_euler_angles(k, 2.0 * k, 0.3 * k));
            pb.pose(&b, &Quat::from_euler_angles(0.7 * k, -k, 1.9 * k));
            let c = Vec3::new((1.3 * k).sin(), (2.1 * k).cos(), (0.4 * k).sin()).normalize() * 1.6;
            let pair = Pair::new((&a, &pa), (&b, &pb), c, Width::detect());
            let found = search(&pair, Start::Nothing, Narrow::Accurate, 0.5);
            if found.axis.feature == Feature::None || found.axis.s > 0.5 {
                continue;
            }
            let mut patch = Patch::default();
            patch.see(&pair, &found.axis, found.faces, f64::INFINITY);
            let frame = local_frame(found.axis.n);
            let outline = |shape: &Polyhedron, posed: &Posed, f: u32, moved: Vec3, turned: bool| -> Vec<[f64; 2]> {
                let at = |&v: &u32| posed.vertex(v) + moved;
                let corners = shape.corners(f as usize).iter().map(at).map(|p| [p.dot(&frame[1]), p.dot(&frame[2])]);
                if turned { corners.rev().collect() } else { corners.collect() }
            };
            let expected = clipped(
                outline(&a, &pa, found.faces.0, Vec3::zeros(), false),
                &outline(&b, &pb, found.faces.1, c, true),
            );
            let doubled: f64 = (0..expected.len())
                .map(|k| {
                    let (u, v) = (expected[k], expected[(k + 1) % expected.len()]);
                    u[0] * v[1] - u[1] * v[0]
                })
                .sum();
            assert!((patch.area - 0.5 * doubled).abs() < 1e-14, "{k}: {} {doubled}", patch.area);
            assert!(patch.corners.len() == expected.len() || doubled < 1e-6, "{k}: {:?} {expected:?}", patch.corners);
            many[expected.len()] += 1;
        }
        assert!(many[3..7].iter().all(|&count| count > 20), "{many:?}");
    }
}
