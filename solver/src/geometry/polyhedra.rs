//! Contact of two polyhedra, one pair at a time or in batches.

use super::cache::CachedFeature;
use super::gjk;
use super::manifold::{ListingRange, Manifold, NarrowPhaseMode, Separated};
use super::pair::{PolyhedronPair, SearchAxis, SearchFeature};
use super::patch::ContactPatch;
use super::polyhedron::PosedPolyhedron;
use super::search::{self, SearchResult, SearchStart};
use super::triangles::{BATCH_PAIRS, TriangleBatch};
use crate::math::Vec3;
use crate::math::simd::{Scalar, SimdWidth};

/// Contact of polyhedron A with polyhedron B at `c` = x_B - x_A, m; `None` if they are farther apart than `range` lists.
///
/// The normal is the direction of smallest distance, or of the smallest translation that separates overlapping bodies. If
/// vertices or edges meet in a point without overlap, or if several directions are equal to 1e-11 of the size, the result
/// is a definite one of those. Source: see the section on polyhedra in docs/explanation/method/contacts.md.
pub fn polyhedron_polyhedron(
    a: &PosedPolyhedron,
    b: &PosedPolyhedron,
    c: &Vec3,
    range: impl Into<ListingRange>,
    narrow: NarrowPhaseMode,
    memory: &mut CachedFeature,
) -> Option<Manifold> {
    let pair = PolyhedronPair::new(a, b, *c, SimdWidth::detect());
    let start = memory.search_start(&pair);
    let (feature, manifold) = pair_manifold(PairQuery { pair, start, hint: None, narrow, range: range.into() });
    *memory = feature;
    manifold
}

/// Contact of one pair with the feature to cache.
fn pair_manifold(query: PairQuery) -> (CachedFeature, Option<Manifold>) {
    let mut found = (CachedFeature::default(), None);
    let mut record = |(), result: PairResult| {
        found = match result {
            Ok((memory, manifold)) => (memory, Some(manifold.clone())),
            Err(Separated { n, s }) => {
                (CachedFeature::from_axis(&SearchAxis { n, s, feature: SearchFeature::None }), None)
            }
        };
    };
    let mut batch = PairBatch::new(query.pair.width);
    batch.push_query((), query, &mut record);
    batch.flush(&mut record);
    found
}

/// Result for a pair: the feature to cache and the contact, or a separating direction.
pub type PairResult<'m> = Result<(CachedFeature, &'m Manifold), Separated>;

/// Batch of pairs of polyhedra: bitwise the same results as one by one, and faster.
///
/// Each pair is identified by a key of type `T`. Results come in the order of the requests.
pub struct PairBatch<'a, T> {
    width: SimdWidth,
    /// Pairs whose points are not computed yet.
    pending: [Option<PendingPair<'a, T>>; MAX_PENDING_PAIRS],
    count: usize,
    triangles: TriangleBatch,
    /// Patch of the current pair.
    patch: ContactPatch,
    manifold: Manifold,
}

/// Request for the contact of polyhedra A and B.
#[derive(Clone, Copy)]
pub struct PairRequest<'a> {
    /// A and B with their orientations.
    pub shapes: [&'a PosedPolyhedron<'a>; 2],
    /// x_B - x_A, m.
    pub centre_offset: Vec3,
    /// Gaps up to which points are listed.
    pub range: ListingRange,
    pub narrow: NarrowPhaseMode,
    /// Feature that is kept from the last step.
    pub memory: CachedFeature,
    /// Direction along which the bodies may be apart.
    pub hint: Option<Vec3>,
}

/// Pair whose direction is known and whose points are still to be computed.
struct PendingPair<'a, T> {
    key: T,
    query: PairQuery<'a>,
    found: SearchResult,
    /// Index in the triangle batch, if its faces are triangles.
    triangles: Option<usize>,
}

/// Largest number of pending pairs; not all of them have triangles.
const MAX_PENDING_PAIRS: usize = 2 * BATCH_PAIRS;

/// Input for one pair.
#[derive(Clone, Copy)]
struct PairQuery<'a> {
    pair: PolyhedronPair<'a>,
    start: SearchStart,
    /// Direction that may show immediately that the bodies are apart; dropped otherwise.
    hint: Option<Vec3>,
    narrow: NarrowPhaseMode,
    range: ListingRange,
}

impl<'a, T: Copy> PairBatch<'a, T> {
    /// Empty batch.
    pub fn new(width: SimdWidth) -> Self {
        PairBatch {
            width,
            pending: [const { None }; MAX_PENDING_PAIRS],
            count: 0,
            triangles: TriangleBatch::new(),
            patch: ContactPatch::default(),
            manifold: Manifold::default(),
        }
    }

    /// Requests the result of [`polyhedron_polyhedron`]; `record` is called with `key` and the result, in this or a
    /// later call.
    pub fn push_pair(&mut self, key: T, request: PairRequest<'a>, record: &mut impl FnMut(T, PairResult)) {
        let PairRequest { shapes: [a, b], centre_offset, range, narrow, memory, hint } = request;
        let pair = PolyhedronPair::new(a, b, centre_offset, self.width);
        let start = memory.search_start(&pair);
        self.push_query(key, PairQuery { pair, start, hint, narrow, range }, record);
    }

    /// Finds the direction of a pair, and adds the pair to those whose points are computed later.
    fn push_query(&mut self, key: T, query: PairQuery<'a>, record: &mut impl FnMut(T, PairResult)) {
        let PairQuery { pair, start, hint, narrow, range } = &query;
        let found = search::separating_axis(pair, *start, *hint, *narrow, *range);
        let SearchResult { axis, faces, .. } = &found;
        if axis.s > range.alert {
            return record(key, Err(axis.as_separated()));
        }
        let patch =
            axis.feature != SearchFeature::None && !found.is_far(range) && !search::is_ridge_pair(pair, axis, range);
        let triangles = if patch { self.triangles.push_faces(pair, axis, *faces) } else { None };
        self.pending[self.count] = Some(PendingPair { key, query, found, triangles });
        self.count += 1;
        if self.triangles.is_full() || self.count == MAX_PENDING_PAIRS {
            self.flush(record);
        }
    }

    /// Computes all pending results.
    pub fn flush(&mut self, record: &mut impl FnMut(T, PairResult)) {
        let PairBatch { width, pending, count, triangles, patch, manifold } = self;
        triangles.clip_faces(*width);
        for PendingPair { key, query, found, triangles: triangle_index } in pending[..*count].iter().flatten() {
            let axis = &found.axis;
            let is_clipped = triangle_index.is_some_and(|k| triangles.write_patch(k, axis, query.range.area, patch));
            if is_clipped && patch.has_axis_gap(axis.s, query.pair.tie_tolerance()) {
                record(*key, patch_result(query, axis, patch, manifold));
            } else {
                manifold_scalar(query, found, patch, manifold, &mut |result: PairResult| record(*key, result));
            }
        }
        *count = 0;
        triangles.clear();
    }
}

/// Returns the points of a patch that are within the range.
fn patch_result<'m>(
    query: &PairQuery,
    axis: &SearchAxis,
    patch: &mut ContactPatch,
    manifold: &'m mut Manifold,
) -> PairResult<'m> {
    patch.write_manifold(query.range, query.pair.tie_tolerance(), manifold);
    // Within rounding there may be no point.
    if manifold.points.is_empty() { Err(axis.as_separated()) } else { Ok((CachedFeature::from_axis(axis), manifold)) }
}

/// Computes the manifold of a single pair whose direction is known.
fn manifold_scalar(
    query: &PairQuery,
    found: &SearchResult,
    patch: &mut ContactPatch,
    manifold: &mut Manifold,
    record: &mut impl FnMut(PairResult),
) {
    let PairQuery { pair, start, narrow, range, .. } = query;
    let SearchResult { axis, faces, touched_vertex, .. } = found;
    let feature = CachedFeature::from_axis(axis);
    let axis_manifold = |area| {
        let points = search::axis_point(pair, axis, *touched_vertex).into_iter().collect();
        Manifold { normal: -axis.n, points, area }
    };
    if found.is_far(range) {
        let nearest = axis_manifold(0.0);
        if !nearest.points.is_empty() {
            return record(Ok((feature, &nearest)));
        }
    }
    if search::is_ridge_pair(pair, axis, range)
        && let Some(ridges) = gjk::ridge_manifold(pair, &axis.n, axis.s)
    {
        return record(Ok((feature, &ridges)));
    }
    if axis.feature != SearchFeature::None && !found.is_far(range) {
        patch.clip_faces(pair, axis, *faces, range.area);
        if patch.has_axis_gap(axis.s, pair.tie_tolerance()) {
            return record(patch_result(query, axis, patch, manifold));
        }
        if axis.s <= 0.0 {
            // The overlap is not proven to be the smallest: the axis's own features give one point.
            return record(Ok((feature, &axis_manifold(patch.area))));
        }
    }
    let nearest = gjk::nearest_points(pair, axis.n, range.alert);
    if nearest.on_faces && matches!(start, SearchStart::Direction(_)) {
        let found = search::separating_axis(pair, SearchStart::Nothing, None, *narrow, *range);
        if found.axis.s > range.alert {
            return record(Err(found.axis.as_separated()));
        }
        let query = PairQuery { start: SearchStart::Nothing, ..*query };
        return manifold_scalar(&query, &found, patch, manifold, record);
    }
    if let Some(at_edges) = nearest.manifold.as_ref().filter(|near| near.gap() <= range.joint) {
        // The sides of a wedge whose edges are nearest carry force, too.
        let axis = SearchAxis { n: nearest.n, s: at_edges.gap(), feature: SearchFeature::None };
        let face = |posed, n| search::support_face(Scalar, posed, &n, None);
        patch.clip_faces(pair, &axis, (face(pair.posed_a, axis.n), face(pair.posed_b, -axis.n)), range.area);
        if patch.corners.len() > at_edges.points.len() && patch.has_axis_gap(axis.s, pair.tie_tolerance()) {
            return record(patch_result(query, &axis, patch, manifold));
        }
    }
    let nearest_axis = SearchAxis { n: nearest.n, s: axis.s, feature: SearchFeature::None };
    match &nearest.manifold {
        Some(manifold) => record(Ok((CachedFeature::from_axis(&nearest_axis), manifold))),
        None => record(Err(nearest_axis.as_separated())),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::geometry::Polyhedron;
    use crate::math::Quat;

    /// A rock: the hull of points on three rings and two poles.
    pub fn rock(seed: f64) -> Polyhedron {
        let point = |k: usize| {
            let (ring, turn) = ((k / 6) as f64 - 1.0, k as f64 * 1.1 + seed);
            let wide = 1.0 - 0.3 * ring.abs() + 0.1 * (7.0 * turn + seed).sin();
            parry3d_f64::math::Vector::new(wide * turn.cos(), wide * turn.sin(), 0.7 * ring)
        };
        let points: Vec<_> = (0..18).map(point).collect();
        let (vertices, triangles) = parry3d_f64::transformation::convex_hull(&points);
        let vertices: Vec<Vec3> = vertices.iter().map(|v| Vec3::new(v.x, v.y, v.z)).collect();
        Polyhedron::new(&vertices, &triangles).unwrap()
    }

    /// Calls `take` with pairs of rocks whose direction is given by a feature and that overlap or are within `range` (m)
    /// of each other, and with the number of each pair.
    pub(in crate::geometry) fn each_pair(
        count: u32,
        range: f64,
        mut take: impl FnMut(u32, &PolyhedronPair, &SearchResult),
    ) {
        let (a, b) = (rock(0.0), rock(1.0));
        for number in 0..count {
            let k = f64::from(number);
            let pa = a.posed_by(&Quat::from_euler_angles(k, 2.0 * k, 0.3 * k));
            let pb = b.posed_by(&Quat::from_euler_angles(0.7 * k, -k, 1.9 * k));
            let c = Vec3::new((1.3 * k).sin(), (2.1 * k).cos(), (0.4 * k).sin()).normalize() * 1.6;
            let pair = PolyhedronPair::new(&pa, &pb, c, SimdWidth::detect());
            let found =
                search::separating_axis(&pair, SearchStart::Nothing, None, NarrowPhaseMode::Accurate, range.into());
            if found.axis.feature != SearchFeature::None && found.axis.s <= range {
                take(number, &pair, &found);
            }
        }
    }

    #[test]
    fn all_widths_give_the_same_bits() {
        let (a, b) = (rock(0.0), rock(1.0));
        let mut contacts = 0;
        for k in 0..500 {
            let k = f64::from(k);
            let pa = a.posed_by(&Quat::from_euler_angles(k, 2.0 * k, 0.3 * k));
            let pb = b.posed_by(&Quat::from_euler_angles(0.7 * k, -k, 1.9 * k));
            let c = Vec3::new((1.3 * k).sin(), (2.1 * k).cos(), (0.4 * k).sin()).normalize() * (1.2 + 0.002 * k);
            for start in [
                SearchStart::Nothing,
                SearchStart::Feature(SearchFeature::FaceOfA(3)),
                SearchStart::Direction(Vec3::x()),
            ] {
                let key = |width| {
                    let pair = PolyhedronPair::new(&pa, &pb, c, width);
                    pair_manifold(PairQuery {
                        pair,
                        start,
                        hint: None,
                        narrow: NarrowPhaseMode::Accurate,
                        range: 0.05.into(),
                    })
                };
                let found: Vec<_> = SimdWidth::all_widths().into_iter().map(key).collect();
                assert!(found.iter().all(|one| *one == found[0]), "{k}: {found:?}");
                contacts += usize::from(found[0].1.is_some());
            }
        }
        assert!((300..1300).contains(&contacts), "both apart and in contact: {contacts}");
    }

    /// Edges that lie on each other: two faces of either cuboid are equally good directions.
    #[test]
    fn the_order_of_faces_does_not_decide_between_equally_good_ones() {
        let (a, b) = (Polyhedron::cuboid(&Vec3::new(0.5, 0.5, 0.5)), Polyhedron::cuboid(&Vec3::new(0.5, 0.5, 1.25)));
        let turns = [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| Quat::from_scaled_axis(axis * PI));
        for (turn_a, turn_b) in turns.iter().flat_map(|a| turns.iter().map(move |b| (a, b))) {
            let (pa, pb) = (a.posed_by(turn_a), b.posed_by(turn_b));
            for (x, z) in [(1.0, 1.75), (-1.0, 1.75), (1.0, -1.75), (-1.0, -1.75)] {
                for noise in [0.0, 1e-12, -1e-12] {
                    let (c, mut memory) = (Vec3::new(x + noise, 0.0, z), CachedFeature::default());
                    let mut normal = |c: &Vec3| {
                        polyhedron_polyhedron(&pa, &pb, c, 0.01, NarrowPhaseMode::Accurate, &mut memory).unwrap().normal
                    };
                    assert!((normal(&c) + Vec3::z() * z.signum()).norm() < 1e-12, "{x} {z} {noise}");
                }
            }
        }
    }

    #[test]
    fn of_a_far_pair_the_nearest_point_is_enough() {
        let (a, b) = (rock(0.0), rock(1.0));
        let (mut far, mut near) = (0, 0);
        for k in 0..1000 {
            let k = f64::from(k);
            let pa = a.posed_by(&Quat::from_euler_angles(k, 2.0 * k, 0.3 * k));
            let pb = b.posed_by(&Quat::from_euler_angles(0.7 * k, -k, 1.9 * k));
            let c = Vec3::new((1.3 * k).sin(), (2.1 * k).cos(), (0.4 * k).sin()).normalize() * 1.8;
            let mut memory = CachedFeature::default();
            let mut run = |range: ListingRange| {
                polyhedron_polyhedron(&pa, &pb, &c, range, NarrowPhaseMode::Accurate, &mut memory)
            };
            let Some(all) = run(0.5.into()) else { continue };
            let found = run(ListingRange { patch: 0.1, ..0.5.into() }).unwrap();
            let is_far = all.gap() > 0.1;
            if !is_far || found.points.len() > 1 {
                assert!(found.points.len() == all.points.len() && found.area == all.area, "{k}");
                near += usize::from(!is_far);
                continue;
            }
            far += usize::from(all.points.len() > 1);
            let same = all.points.iter().find(|point| point.features == found.points[0].features).unwrap();
            // A few roundings of numbers of the size.
            assert!((same.gap - all.gap()).abs() < 1e-14 && (found.gap() - all.gap()).abs() < 1e-14, "{k}");
            assert!((same.position - found.points[0].position).norm() < 1e-13, "{k}: {found:?} {all:?}");
        }
        assert!(far > 50 && near > 500, "{far} {near}");
    }

    #[test]
    fn memory_goes_through_a_snapshot_and_foreign_words_do_no_harm() {
        let (a, b) = (rock(0.0), Polyhedron::cuboid(&Vec3::new(1.0, 0.6, 0.4)));
        let (pa, pb) = (a.posed_by(&Quat::identity()), b.posed_by(&Quat::from_euler_angles(0.1, 0.2, 0.3)));
        let run = |c: Vec3, memory: &mut CachedFeature| {
            polyhedron_polyhedron(&pa, &pb, &c, 0.5, NarrowPhaseMode::Accurate, memory)
        };
        for far in [1.2, 1.6, 2.0, 4.0] {
            let mut memory = CachedFeature::default();
            let first = run(Vec3::new(far, 0.1, 0.2), &mut memory);
            let mut other = CachedFeature::from_words(memory.to_words());
            assert_eq!(memory, other);
            assert_eq!(run(Vec3::new(far, 0.1, 0.2), &mut other).is_some(), first.is_some());
            for words in
                [[u64::MAX; 2], [1 << 32 | 999, 0], [3 << 32 | 2, 999 << 32], [4 << 32, 0], [4 << 32 | 0x7fc0_0000, 0]]
            {
                let again = run(Vec3::new(far, 0.1, 0.2), &mut CachedFeature::from_words(words));
                let gaps = (first.as_ref().map(Manifold::gap), again.as_ref().map(Manifold::gap));
                assert!(gaps.0 == gaps.1 || (gaps.0.unwrap() - gaps.1.unwrap()).abs() < 1e-14, "{words:?}: {gaps:?}");
            }
        }
    }
}
