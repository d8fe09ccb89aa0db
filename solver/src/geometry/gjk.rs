//! Distance where no face or pair of crossed edges decides it: vertices and edges nearest to each other.
//!
//! Source: E. G. Gilbert, D. W. Johnson, S. S. Keerthi, A fast procedure for computing the distance between complex
//! objects in three-dimensional space, IEEE J. Robot. Autom. 4 (1988) 193-203.

use super::patch::SAME;
use super::search::{Pair, support};
use super::{Manifold, Point, Polyhedron, Posed, edge, face, vertex};
use crate::math::Vec3;

/// Gap between the bounds, over the distance, at which the search ends.
const ENOUGH: f64 = 1e-15;
/// Slope and angle up to which edges count as parallel, rad.
const PARALLEL: f64 = 1e-11;
/// More than any pair has needed; every step but the last brings the simplex nearer.
const MOST_STEPS: usize = 64;

/// A point of the difference B - A.
#[derive(Clone, Copy)]
struct Apex {
    w: Vec3,
    a: u32,
    b: u32,
}

pub(super) struct Nearest {
    /// Unit, from A to B.
    pub n: Vec3,
    /// Whether a face, or two edges that cross, is nearest: then there may be more points than this one.
    pub on_faces: bool,
    /// `None` beyond the alert distance.
    pub manifold: Option<Manifold>,
}

/// The nearest points of two polyhedra that do not overlap, beginning with the direction `n` from A to B.
pub(super) fn nearest(pair: &Pair, n: Vec3, alert: f64) -> Nearest {
    let mut simplex = vec![apex(pair, &n)];
    let mut weights = vec![1.0];
    let mut v = simplex[0].w;
    for _ in 0..MOST_STEPS {
        let distance = v.norm();
        if distance <= 1e-15 * pair.sum {
            break; // touching to rounding: n of the axis is as good as any
        }
        let next = apex(pair, &(v / distance));
        let bound = next.w.dot(&v) / distance;
        if bound > alert {
            return Nearest { n: v / distance, on_faces: false, manifold: None };
        }
        if distance - bound <= ENOUGH * distance || simplex.iter().any(|p| p.a == next.a && p.b == next.b) {
            break;
        }
        let (kept, shares, nearer) = closest(&simplex, next);
        if nearer.norm() >= distance {
            break;
        }
        (simplex, weights, v) = (kept, shares, nearer);
    }
    let distance = v.norm();
    if distance > alert {
        return Nearest { n: v / distance, on_faces: false, manifold: None };
    }
    let n = if distance > 1e-15 * pair.sum { v / distance } else { n };
    if let Some(ridges) = ridges(pair, &n, distance) {
        return Nearest { n: -ridges.normal, on_faces: false, manifold: Some(ridges) };
    }
    let on_a: Vec3 = simplex.iter().zip(&weights).map(|(p, w)| pair.pa.vertex(p.a) * *w).sum();
    let on_b: Vec3 = simplex.iter().zip(&weights).map(|(p, w)| (pair.pb.vertex(p.b) + pair.c) * *w).sum();
    let features = (spanned(pair.a, simplex.iter().map(|p| p.a)), spanned(pair.b, simplex.iter().map(|p| p.b)));
    let point = Point { position: (on_a + on_b) * 0.5, gap: distance, features };
    let points = [point].into_iter().collect();
    let kind = |feature: u32| feature >> 30;
    let on_faces = kind(features.0) == 2 || kind(features.1) == 2 || (kind(features.0) == 1 && kind(features.1) == 1);
    Nearest { n, on_faces, manifold: Some(Manifold { normal: -n, points, area: 0.0 }) }
}

/// The point of the difference that is least along `n`.
fn apex(pair: &Pair, n: &Vec3) -> Apex {
    let (a, b) = (support(pair.a, pair.pa, n).0, support(pair.b, pair.pb, &-n).0);
    Apex { w: pair.pb.vertex(b) + pair.c - pair.pa.vertex(a), a, b }
}

/// The part of simplex and `next` that is nearest to the origin: corners, weights, point.
///
/// Every corner, edge and triangle with `next` is looked at; so flat simplices do no harm.
fn closest(simplex: &[Apex], next: Apex) -> (Vec<Apex>, Vec<f64>, Vec3) {
    let mut best = (vec![next], vec![1.0], next.w);
    let mut take = |corners: &[Apex], weights: &[f64]| {
        let point: Vec3 = corners.iter().zip(weights).map(|(p, w)| p.w * *w).sum();
        if point.norm_squared() < best.2.norm_squared() {
            best = (corners.to_vec(), weights.to_vec(), point);
        }
    };
    let p = next.w;
    for (i, &first) in simplex.iter().enumerate() {
        let u = first.w - p;
        let share = -p.dot(&u) / u.norm_squared();
        if share > 0.0 && share < 1.0 {
            take(&[next, first], &[1.0 - share, share]);
        }
        for &second in &simplex[i + 1..] {
            let v = second.w - p;
            let normal = u.cross(&v);
            let area = normal.norm_squared();
            let (x, y) = (normal.dot(&v.cross(&p)) / area, normal.dot(&p.cross(&u)) / area);
            if x > 0.0 && y > 0.0 && x + y < 1.0 {
                take(&[next, first, second], &[1.0 - x - y, x, y]);
            }
        }
    }
    best
}

/// The vertex, edge or face that has these vertices.
fn spanned(shape: &Polyhedron, vertices: impl Iterator<Item = u32>) -> u32 {
    let mut all: Vec<u32> = vertices.collect();
    all.sort_unstable();
    all.dedup();
    let ends = |e: &&u32| all.iter().all(|v| shape.edges[**e as usize].ends.contains(v));
    match all[..] {
        [v] => vertex(v),
        [v, _] if shape.spokes(v as usize).iter().any(|e| ends(&e)) => {
            edge(*shape.spokes(v as usize).iter().find(ends).unwrap_or(&0))
        }
        _ => {
            let has_all = |corners: &[u32]| all.iter().all(|v| corners.contains(v));
            face(shape.faces().position(has_all).unwrap_or(0) as u32)
        }
    }
}

/// The ends of the common part of two parallel edges across `n`, and the normal between them.
pub(super) fn ridges(pair: &Pair, n: &Vec3, distance: f64) -> Option<Manifold> {
    // As far as the direction between points that are `distance` apart is known.
    let steep = PARALLEL + 1e-11 * pair.small / distance;
    let level = |shape: &Polyhedron, posed: &Posed, n: &Vec3| -> Vec<(u32, [u32; 2], Vec3)> {
        let top = support(shape, posed, n).0;
        let edges = shape.spokes(top as usize).iter().map(|&e| {
            let ends = shape.edges[e as usize].ends;
            (e, ends, (posed.vertex(ends[1]) - posed.vertex(ends[0])).normalize())
        });
        edges.filter(|(_, _, along)| along.dot(n).abs() <= steep).collect()
    };
    for (ea, ends_a, along) in level(pair.a, pair.pa, n) {
        for (eb, ends_b, other) in level(pair.b, pair.pb, &-n) {
            let base = pair.pa.vertex(ends_a[0]);
            let between = pair.pb.vertex(ends_b[0]) + pair.c - base;
            let across = between - along * between.dot(&along);
            let gap = across.norm();
            if along.cross(&other).norm() > PARALLEL || gap <= 1e-15 * pair.sum || gap > distance + pair.tie() {
                continue;
            }
            // Places along the edge, each with the feature that ends there.
            let of_a = ends_a.map(|v| (pair.pa.vertex(v).dot(&along), (vertex(v), edge(eb))));
            let mut of_b = ends_b.map(|v| ((pair.pb.vertex(v) + pair.c).dot(&along), (edge(ea), vertex(v))));
            of_b.sort_by(|p, q| p.0.total_cmp(&q.0));
            let inner = |k: usize, of_a_is_inner: bool| {
                if (of_a[k].0 - of_b[k].0).abs() <= SAME * pair.small {
                    (of_a[k].0, (of_a[k].1.0, of_b[k].1.1))
                } else {
                    if of_a_is_inner { of_a[k] } else { of_b[k] }
                }
            };
            let (low, high) = (inner(0, of_a[0].0 > of_b[0].0), inner(1, of_a[1].0 < of_b[1].0));
            if high.0 - low.0 <= PARALLEL * pair.small {
                continue;
            }
            let at = |place: f64| base + along * (place - base.dot(&along)) + across * 0.5;
            let point = |(place, features)| Point { position: at(place), gap, features };
            let mut ends = [point(low), point(high)];
            ends.sort_by_key(|point| point.features);
            return Some(Manifold { normal: -across / gap, points: ends.into_iter().collect(), area: 0.0 });
        }
    }
    None
}
