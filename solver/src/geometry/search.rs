//! The direction in which two polyhedra are farthest apart: of the face normals and the cross products of edges.
//!
//! s(n) = min_B n·(b + c) - max_A n·a for a unit n from A to B is a lower bound of the distance of A and B. Its
//! maximum over the normals of the Minkowski difference's facets is the distance, unless two vertices, or a vertex and
//! an edge, are nearest; where A and B overlap, -s is the least translation that parts them.

use super::patch::Corner;
use super::{Point, Polyhedron, Posed, edge, face, vertex};
use crate::math::Vec3;

/// Two posed polyhedra.
pub(super) struct Pair<'a> {
    pub a: &'a Polyhedron,
    pub pa: &'a Posed,
    pub b: &'a Polyhedron,
    pub pb: &'a Posed,
    /// x_B - x_A, m.
    pub c: Vec3,
    /// Sum of the circumradii, m.
    pub sum: f64,
    /// The smaller circumradius, m.
    pub small: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Feature {
    FaceOfA(u32),
    FaceOfB(u32),
    Edges(u32, u32),
}

/// A direction with the separation along it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axis {
    /// Unit, from A to B.
    pub n: Vec3,
    /// m
    pub s: f64,
    pub feature: Feature,
}

/// A direction must be better by this share of the size to be preferred to an earlier one: so rounding, and noise of
/// 1e-12, do not decide between equals.
pub(super) const GAIN: f64 = 5e-12;
/// Products of the two dots of a Gauss-map test above which edges count as parallel: 1e-13 rad.
const PARALLEL: f64 = -1e-26;
/// A face must be better aligned by this to be preferred to its neighbour.
const ALIGNED: f64 = 1e-9;

impl<'a> Pair<'a> {
    pub fn new(a: (&'a Polyhedron, &'a Posed), b: (&'a Polyhedron, &'a Posed), c: Vec3) -> Self {
        let (ra, rb) = (a.0.circumradius(), b.0.circumradius());
        Pair { a: a.0, pa: a.1, b: b.0, pb: b.1, c, sum: ra + rb, small: ra.min(rb) }
    }

    /// s(n) with the vertices that give it.
    pub fn separation(&self, n: &Vec3) -> (f64, u32, u32) {
        let (a, high) = support(self.a, self.pa, n);
        let (b, low) = support(self.b, self.pb, &-n);
        (n.dot(&self.c) - low - high, a, b)
    }
}

/// The first vertex farthest along `n`, and how far.
pub(super) fn support(shape: &Polyhedron, posed: &Posed, n: &Vec3) -> (u32, f64) {
    let mut best = (0, f64::NEG_INFINITY);
    for k in 0..shape.vertices().len() as u32 {
        let height = n.dot(&posed.vertex(k));
        if height > best.1 {
            best = (k, height);
        }
    }
    best
}

/// Every face of A, every face of B, every pair of edges whose arcs on the Gauss map cross; stops above `enough`.
pub(super) fn all(pair: &Pair, enough: f64) -> Axis {
    let gain = GAIN * pair.sum;
    let mut best = Axis { n: Vec3::x(), s: f64::NEG_INFINITY, feature: Feature::FaceOfA(0) };
    let mut take = |n: Vec3, s: f64, feature: Feature| {
        if s > best.s + gain || best.s == f64::NEG_INFINITY {
            best = Axis { n, s, feature };
        }
        best.s > enough
    };
    for (f, plane) in pair.a.planes.iter().enumerate() {
        let n = pair.pa.normal(f as u32);
        let s = n.dot(&pair.c) - plane.offset - support(pair.b, pair.pb, &-n).1;
        if take(n, s, Feature::FaceOfA(f as u32)) {
            return best;
        }
    }
    for (f, plane) in pair.b.planes.iter().enumerate() {
        let n = -pair.pb.normal(f as u32);
        let s = n.dot(&pair.c) - plane.offset - support(pair.a, pair.pa, &n).1;
        if take(n, s, Feature::FaceOfB(f as u32)) {
            return best;
        }
    }
    for ea in 0..pair.a.edges.len() as u32 {
        for eb in 0..pair.b.edges.len() as u32 {
            if let Some((n, s)) = edge_axis(pair, ea, eb)
                && take(n, s, Feature::Edges(ea, eb))
            {
                return best;
            }
        }
    }
    best
}

/// The common normal of two edges, from A to B, and the separation along it, if their arcs on the Gauss map cross.
///
/// From the normals beside the edges, not from the edges' cross product, which is lost where they are nearly parallel.
/// Source of the test: D. Gregorius, The separating axis test between convex polyhedra, GDC (2013).
pub(super) fn edge_axis(pair: &Pair, ea: u32, eb: u32) -> Option<(Vec3, f64)> {
    let (a, b) = (&pair.a.edges[ea as usize], &pair.b.edges[eb as usize]);
    let (a0, a1) = (pair.pa.vertex(a.ends[0]), pair.pa.vertex(a.ends[1]));
    let (b0, b1) = (pair.pb.vertex(b.ends[0]), pair.pb.vertex(b.ends[1]));
    let (along_a, along_b) = ((a1 - a0).normalize(), (b1 - b0).normalize());
    let [na0, na1] = a.faces.map(|f| pair.pa.normal(f));
    let [nb0, nb1] = b.faces.map(|f| pair.pb.normal(f));
    let (p0, p1) = (nb0.dot(&along_a), nb1.dot(&along_a));
    let (q0, q1) = (na0.dot(&along_b), na1.dot(&along_b));
    if p0 * p1 > PARALLEL || q0 * q1 > PARALLEL || p0 * q0 <= 0.0 {
        return None;
    }
    let n = (na0 * q1.abs() + na1 * q0.abs()).normalize();
    Some((n, n.dot(&(b0 + pair.c - a0))))
}

/// The faces whose common part is looked at.
pub(super) fn support_faces(pair: &Pair, axis: &Axis) -> (u32, u32) {
    let better = |shape: &Polyhedron, posed: &Posed, e: u32, n: &Vec3| {
        let [f, g] = shape.edges[e as usize].faces;
        let (first, second) = (f.min(g), f.max(g));
        if posed.normal(second).dot(n) > posed.normal(first).dot(n) + ALIGNED { second } else { first }
    };
    let seen = |shape: &Polyhedron, posed: &Posed, n: &Vec3| {
        let top = support(shape, posed, n).0;
        // The edge that falls least from there; a face along it has the next vertex.
        let (mut best, mut least) = (0, f64::INFINITY);
        for &e in shape.spokes(top as usize) {
            let [v, w] = shape.edges[e as usize].ends.map(|v| posed.vertex(v));
            let fall = ((v - w).dot(n) / (v - w).norm()).abs();
            if fall < least {
                (best, least) = (e, fall);
            }
        }
        better(shape, posed, best, n)
    };
    match axis.feature {
        Feature::FaceOfA(f) => (f, seen(pair.b, pair.pb, &-axis.n)),
        Feature::FaceOfB(f) => (seen(pair.a, pair.pa, &axis.n), f),
        Feature::Edges(ea, eb) => (better(pair.a, pair.pa, ea, &axis.n), better(pair.b, pair.pb, eb, &-axis.n)),
    }
}

/// The point of an axis's own features.
pub(super) fn own_point(pair: &Pair, axis: &Axis) -> Option<Point> {
    let (_, va, vb) = pair.separation(&axis.n);
    let (a, b) = (pair.pa.vertex(va), pair.pb.vertex(vb) + pair.c);
    let half = axis.n * (0.5 * axis.s);
    let (position, features) = match axis.feature {
        Feature::FaceOfA(f) => (b - half, (face(f), vertex(vb))),
        Feature::FaceOfB(f) => (a + half, (vertex(va), face(f))),
        Feature::Edges(ea, eb) => {
            let ends =
                |shape: &Polyhedron, posed: &Posed, e: u32| shape.edges[e as usize].ends.map(|v| posed.vertex(v));
            let ([a0, a1], [b0, b1]) = (ends(pair.a, pair.pa, ea), ends(pair.b, pair.pb, eb));
            (Corner::crossing([a0, a1], [b0 + pair.c, b1 + pair.c]), (edge(ea), edge(eb)))
        }
    };
    position.iter().all(|x| x.is_finite()).then_some(Point { position, gap: axis.s, features })
}
