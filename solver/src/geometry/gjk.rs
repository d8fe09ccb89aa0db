//! Distance between polyhedra whose nearest features are vertices or edges.
//!
//! Source: E. G. Gilbert, D. W. Johnson, S. S. Keerthi, A fast procedure for computing the distance between complex
//! objects in three-dimensional space, IEEE J. Robot. Autom. 4 (1988) 193-203.

use smallvec::SmallVec;

use super::manifold::{ContactPoint, Manifold, edge_feature, face_feature, vertex_feature};
use super::pair::{PolyhedronPair, lowest_vertex, support_vertex};
use super::patch::SAME_CORNER_DISTANCE;
use super::polyhedron::{FeatureIndex, HalfEdge};
use super::polyhedron::{Polyhedron, PosedPolyhedron};
use super::search::RIDGE_ANGLE;
use crate::math::simd::{F64Arithmetic, LaneOperation};
use crate::math::{Vec3, vector_length};

/// Gap between the bounds, divided by the distance, at which the search ends.
const RELATIVE_TOLERANCE: f64 = 1e-15;
/// Larger than any observed number of steps; every step but the last brings the simplex nearer.
const MAX_STEPS: usize = 64;

/// Point of the Minkowski difference B - A.
#[derive(Clone, Copy)]
struct MinkowskiPoint {
    /// Position, m.
    w: Vec3,
    /// Vertices of A and of B of which it is the difference.
    a: u32,
    b: u32,
}

/// Nearest points of two polyhedra.
pub(super) struct NearestPoints {
    /// Unit normal from A to B.
    pub n: Vec3,
    /// Whether the nearest features are a face or two crossed edges; then there may be more points than this one.
    pub on_faces: bool,
    /// Manifold; `None` beyond the alert distance.
    pub manifold: Option<Manifold>,
}

/// Returns the nearest points of two polyhedra that do not overlap; the search starts from the direction `n` from A to B.
pub(super) fn nearest_points(pair: &PolyhedronPair, n: Vec3, alert: f64) -> NearestPoints {
    pair.width.run(GjkSearch { pair, n, alert })
}

/// Search for the nearest points of two polyhedra.
struct GjkSearch<'a> {
    pair: &'a PolyhedronPair<'a>,
    /// Direction from A to B from which the search starts.
    n: Vec3,
    /// Gap beyond which the search ends, m.
    alert: f64,
}

impl LaneOperation for GjkSearch<'_> {
    type Output = NearestPoints;

    #[inline(always)]
    fn call<L: F64Arithmetic>(self, l: L) -> NearestPoints {
        let GjkSearch { pair, n, alert } = self;
        let mut near = GjkSimplex::new(minkowski_support(l, pair, &n));
        let touching = 1e-15 * pair.circumradius_sum;
        let mut step = 0;
        while step < MAX_STEPS {
            step += 1;
            let distance = vector_length(&near.point);
            if distance <= touching {
                break; // within rounding: n of the axis is as good as any
            }
            let next = minkowski_support(l, pair, &(near.point / distance));
            let bound = next.w.dot(&near.point) / distance;
            if bound > alert {
                return NearestPoints { n: near.point / distance, on_faces: false, manifold: None };
            }
            if distance - bound <= RELATIVE_TOLERANCE * distance || near.has_point(&next) {
                break;
            }
            let nearer = near.nearest_with(next);
            if nearer.point.norm_squared() >= near.point.norm_squared() {
                break;
            }
            near = nearer;
        }
        let distance = vector_length(&near.point);
        let n = if distance > touching { near.point / distance } else { n };
        if distance > alert {
            return NearestPoints { n, on_faces: false, manifold: None };
        }
        near.nearest_contact(pair, n, distance)
    }
}

/// Returns the point of the difference that is lowest along `n`.
#[inline(always)]
fn minkowski_support<L: F64Arithmetic>(l: L, pair: &PolyhedronPair, n: &Vec3) -> MinkowskiPoint {
    let a = lowest_vertex(l, pair.posed_a, &-n).0;
    let b = lowest_vertex(l, pair.posed_b, n).0;
    MinkowskiPoint { w: pair.posed_b.vertex(b) + pair.centre_offset - pair.posed_a.vertex(a), a, b }
}

/// Simplex of up to three points, and its point nearest to the origin.
#[derive(Clone, Copy)]
struct GjkSimplex {
    corners: [MinkowskiPoint; 3],
    /// Shares of the corners in `point`.
    weights: [f64; 3],
    /// Number of corners.
    count: usize,
    /// Point nearest to the origin, m.
    point: Vec3,
}

impl GjkSimplex {
    #[inline(always)]
    fn new(apex: MinkowskiPoint) -> Self {
        GjkSimplex { corners: [apex; 3], weights: [1.0, 0.0, 0.0], count: 1, point: apex.w }
    }

    #[inline(always)]
    fn has_point(&self, apex: &MinkowskiPoint) -> bool {
        self.corners[..self.count].iter().any(|p| p.a == apex.a && p.b == apex.b)
    }

    /// Returns the part of this simplex and `next` that is nearest to the origin.
    ///
    /// Every corner, edge and triangle with `next` is checked, so that degenerate simplices do no harm.
    #[inline(always)]
    fn nearest_with(&self, next: MinkowskiPoint) -> Self {
        let mut best = GjkSimplex::new(next);
        let mut smallest = best.point.norm_squared();
        let p = next.w;
        for i in 0..self.count {
            let first = self.corners[i];
            let u = first.w - p;
            let share = -p.dot(&u) / u.norm_squared();
            if share > 0.0 && share < 1.0 {
                let point = p * (1.0 - share) + first.w * share;
                if point.norm_squared() < smallest {
                    smallest = point.norm_squared();
                    best = GjkSimplex {
                        corners: [next, first, first],
                        weights: [1.0 - share, share, 0.0],
                        count: 2,
                        point,
                    };
                }
            }
            for k in i + 1..self.count {
                let second = self.corners[k];
                let v = second.w - p;
                let normal = u.cross(&v);
                let area = normal.norm_squared();
                let (x, y) = (normal.dot(&v.cross(&p)) / area, normal.dot(&p.cross(&u)) / area);
                if x > 0.0 && y > 0.0 && x + y < 1.0 {
                    let weight_of_next = 1.0 - x - y;
                    let point = p * weight_of_next + first.w * x + second.w * y;
                    if point.norm_squared() < smallest {
                        smallest = point.norm_squared();
                        best = GjkSimplex {
                            corners: [next, first, second],
                            weights: [weight_of_next, x, y],
                            count: 3,
                            point,
                        };
                    }
                }
            }
        }
        best
    }

    fn nearest_contact(&self, pair: &PolyhedronPair, n: Vec3, distance: f64) -> NearestPoints {
        if let Some(ridges) = ridge_manifold(pair, &n, distance) {
            return NearestPoints { n: -ridges.normal, on_faces: false, manifold: Some(ridges) };
        }
        let (mut on_a, mut on_b) = (Vec3::zeros(), Vec3::zeros());
        let corners = &self.corners[..self.count];
        for (p, weight) in corners.iter().zip(&self.weights) {
            on_a += pair.posed_a.vertex(p.a) * *weight;
            on_b += (pair.posed_b.vertex(p.b) + pair.centre_offset) * *weight;
        }
        let features = (
            spanned_feature(pair.shape_a, corners.iter().map(|p| p.a)),
            spanned_feature(pair.shape_b, corners.iter().map(|p| p.b)),
        );
        let kind = |feature: u32| feature >> 30;
        let on_faces =
            kind(features.0) == 2 || kind(features.1) == 2 || (kind(features.0) == 1 && kind(features.1) == 1);
        let point = ContactPoint { position: (on_a + on_b) * 0.5, gap: distance, features };
        let points = [point].into_iter().collect();
        NearestPoints { n, on_faces, manifold: Some(Manifold { normal: -n, points, area: 0.0 }) }
    }
}

/// Returns the vertex, edge or face that has these vertices.
fn spanned_feature(shape: &Polyhedron, vertices: impl Iterator<Item = u32>) -> u32 {
    let mut distinct: SmallVec<[FeatureIndex; 4]> = vertices.map(|v| v as FeatureIndex).collect();
    distinct.sort_unstable();
    distinct.dedup();
    match distinct[..] {
        [v] => vertex_feature(v.into()),
        [v, w] if shape.half_edges(v as usize).iter().any(|half_edge| half_edge.to == w) => {
            let between = shape.half_edges(v as usize).iter().find(|half_edge| half_edge.to == w);
            edge_feature(between.map_or(0, |half_edge| half_edge.edge.into()))
        }
        _ => {
            let has_all = |corners: &[FeatureIndex]| distinct.iter().all(|v| corners.contains(v));
            face_feature(shape.faces().position(has_all).unwrap_or(0) as u32)
        }
    }
}

/// Returns the ends of the common part of two parallel edges across `n`, and the normal between them.
pub(super) fn ridge_manifold(pair: &PolyhedronPair, n: &Vec3, distance: f64) -> Option<Manifold> {
    // Accuracy of the direction between points that are `distance` apart.
    let max_slope = RIDGE_ANGLE + 1e-11 * pair.smaller_circumradius / distance;
    let level_edges = |posed: &PosedPolyhedron, n: &Vec3| -> SmallVec<[(u32, [u32; 2], Vec3); 4]> {
        let shape = posed.shape;
        let top = support_vertex(posed, n).0;
        let mut level_edges = SmallVec::new();
        for &HalfEdge { edge: e, .. } in shape.half_edges(top as usize) {
            let ends = shape.edges()[e as usize].ends.map(u32::from);
            let along = posed.vertex(ends[1]) - posed.vertex(ends[0]);
            let slope = along.dot(n);
            if slope * slope <= max_slope * max_slope * along.norm_squared() {
                level_edges.push((e.into(), ends, along.normalize()));
            }
        }
        level_edges
    };
    for (ea, ends_a, along) in level_edges(pair.posed_a, n) {
        for (eb, ends_b, other) in level_edges(pair.posed_b, &-n) {
            let base = pair.posed_a.vertex(ends_a[0]);
            let between = pair.posed_b.vertex(ends_b[0]) + pair.centre_offset - base;
            let across = between - along * between.dot(&along);
            let gap = across.norm();
            if along.cross(&other).norm() > RIDGE_ANGLE
                || gap <= 1e-15 * pair.circumradius_sum
                || gap > distance + pair.tie_tolerance()
            {
                continue;
            }
            // Positions along the edge, each with the feature that ends there.
            let ends_on_a = ends_a.map(|v| (pair.posed_a.vertex(v).dot(&along), (vertex_feature(v), edge_feature(eb))));
            let mut ends_on_b = ends_b.map(|v| {
                ((pair.posed_b.vertex(v) + pair.centre_offset).dot(&along), (edge_feature(ea), vertex_feature(v)))
            });
            ends_on_b.sort_by(|p, q| p.0.total_cmp(&q.0));
            let inner_end = |k: usize, a_is_inner: bool| {
                if (ends_on_a[k].0 - ends_on_b[k].0).abs() <= SAME_CORNER_DISTANCE * pair.smaller_circumradius {
                    (ends_on_a[k].0, (ends_on_a[k].1.0, ends_on_b[k].1.1))
                } else {
                    if a_is_inner { ends_on_a[k] } else { ends_on_b[k] }
                }
            };
            let (low, high) =
                (inner_end(0, ends_on_a[0].0 > ends_on_b[0].0), inner_end(1, ends_on_a[1].0 < ends_on_b[1].0));
            if high.0 - low.0 <= RIDGE_ANGLE * pair.smaller_circumradius {
                continue;
            }
            let position_at = |height: f64| base + along * (height - base.dot(&along)) + across * 0.5;
            let point = |(height, features)| ContactPoint { position: position_at(height), gap, features };
            let mut ends = [point(low), point(high)];
            ends.sort_by_key(|point| point.features);
            return Some(Manifold { normal: -across / gap, points: ends.into_iter().collect(), area: 0.0 });
        }
    }
    None
}
