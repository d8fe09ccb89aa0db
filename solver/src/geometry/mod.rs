//! Kernel: contact geometry of convex polyhedra - with each other, with spheres, plates and cylinders.
//!
//! All lengths are relative to the centre of body A, so that precision does not depend on the distance from the origin:
//! `c` is x_B - x_A. Normals point from B, the antagonist, to A, the candidate.
//!
//! | file | what |
//! |---|---|
//! | `polyhedron` | shape: polygon faces, edges, neighbours; posed by its body's orientation |
//! | `pair` | two posed polyhedra, an axis, the corners of their common part |
//! | `search` | the direction in which two polyhedra are farthest apart, or least overlap |
//! | `gjk` | distance and direction where vertices or edges are nearest to each other |
//! | `sphere`, `plate`, `cylinder`, `hollow_cylinder` | contact of a polyhedron with other shapes |
//! | `flush` | heights and contact along a given direction |
//! | `outline` | the corners of the common part of two faces seen along the normal |
//! | `triangles` | corners of the common part of two triangles, for several pairs at once |
//! | `patch` | contact points and area from these corners |

mod cylinder;
mod flush;
mod gjk;
mod hollow_cylinder;
mod outline;
mod pair;
mod patch;
mod plate;
mod polyhedron;
mod search;
mod sphere;
mod triangles;

pub use cylinder::polyhedron_cylinder;
pub use flush::polyhedra_along;
pub use hollow_cylinder::polyhedron_hollow_cylinder;
pub use plate::polyhedron_plane;
pub use polyhedron::{Polyhedron, PosedPolyhedron};
pub use sphere::polyhedron_sphere;

use smallvec::SmallVec;

use crate::math::Vec3;
use crate::math::simd::SimdWidth;
use pair::{PolyhedronPair, SearchAxis, SearchFeature};
use patch::ContactPatch;
use search::{SearchResult, SearchStart};
use triangles::{BATCH_PAIRS, TriangleBatch};

/// Contact point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactPoint {
    /// Middle of the gap, relative to the centre of body A, m.
    pub position: Vec3,
    /// Gap along the normal, m, < 0 overlapping.
    pub gap: f64,
    /// Touching features of A and of B, see [`vertex_feature`], [`edge_feature`], [`face_feature`]; unique within a pair.
    pub features: (u32, u32),
}

/// Kind and number of a vertex as one number.
pub const fn vertex_feature(k: u32) -> u32 {
    k
}

/// Kind and number of an edge as one number.
pub const fn edge_feature(k: u32) -> u32 {
    1 << 30 | k
}

/// Kind and number of a face as one number.
pub const fn face_feature(k: u32) -> u32 {
    2 << 30 | k
}

/// Contact points, at least one.
pub type ContactPoints = SmallVec<[ContactPoint; 6]>;

/// Contact of two bodies: one normal, and points.
///
/// One point where a vertex or crossed edges touch, two where an edge lies on a face, more where faces touch: the corners
/// of their common part.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Manifold {
    /// Unit normal from B (antagonist) to A (candidate).
    pub normal: Vec3,
    /// Points with gaps up to the alert distance, ordered by their features.
    pub points: ContactPoints,
    /// Area of the two faces' overlap seen along the normal, where its gap is within [`ListingRange::area`], m^2; 0 if
    /// the nearest features are vertices or edges.
    pub area: f64,
}

impl Manifold {
    /// Returns the smallest gap, m.
    pub fn gap(&self) -> f64 {
        self.points.iter().map(|point| point.gap).fold(f64::INFINITY, f64::min)
    }
}

/// Gaps up to which points and areas are listed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ListingRange {
    /// Largest gap of a listed contact point, m.
    pub alert: f64,
    /// Largest gap of a pair for which all points are listed, m; of a pair farther apart only the nearest point is.
    pub patch: f64,
    /// Largest gap of the part of a patch that counts for its area, m: the range of a cohesion that is a stress.
    pub area: f64,
}

impl From<f64> for ListingRange {
    /// Range that lists all points up to `alert` and the area of the whole patch.
    fn from(alert: f64) -> Self {
        ListingRange { alert, patch: f64::INFINITY, area: f64::INFINITY }
    }
}

/// Cached feature of a pair, kept from one step to the next.
///
/// In [`NarrowPhaseMode::Accurate`] it saves time, and decides between directions that are equal to 1e-11 of the size. In
/// [`NarrowPhaseMode::Fast`] the search starts from it and usually ends there. A bitwise identical resume needs it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CachedFeature {
    kind: u32,
    data: [u32; 3],
}

impl CachedFeature {
    fn from_axis(axis: &SearchAxis) -> Self {
        let (kind, data) = match axis.feature {
            SearchFeature::FaceOfA(f) => (1, [f, 0, 0]),
            SearchFeature::FaceOfB(f) => (2, [f, 0, 0]),
            SearchFeature::Edges(ea, eb) => (3, [ea, eb, 0]),
            SearchFeature::None => (4, [axis.n.x, axis.n.y, axis.n.z].map(|x| (x as f32).to_bits())),
        };
        CachedFeature { kind, data }
    }

    fn search_start(&self, pair: &PolyhedronPair) -> SearchStart {
        let (a, b) = (pair.a, pair.b);
        let [first, second, _] = self.data.map(|k| k as usize);
        match self.kind {
            1 if first < a.face_planes().len() => SearchStart::Feature(SearchFeature::FaceOfA(self.data[0])),
            2 if first < b.face_planes().len() => SearchStart::Feature(SearchFeature::FaceOfB(self.data[0])),
            3 if first < a.edges().len() && second < b.edges().len() => {
                SearchStart::Feature(SearchFeature::Edges(self.data[0], self.data[1]))
            }
            4 => SearchStart::Direction(Vec3::from(self.data.map(|bits| f64::from(f32::from_bits(bits))))),
            _ => SearchStart::Nothing,
        }
    }

    /// Converts to the words of a snapshot.
    pub fn to_words(&self) -> [u64; 2] {
        let [a, b, c] = self.data.map(u64::from);
        [u64::from(self.kind) << 32 | a, b << 32 | c]
    }

    /// Converts from the words of a snapshot; any words are safe.
    pub fn from_words([first, second]: [u64; 2]) -> Self {
        CachedFeature { kind: (first >> 32) as u32, data: [first as u32, (second >> 32) as u32, second as u32] }
    }
}

/// Search method for the direction of a contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NarrowPhaseMode {
    /// Follows the cached feature to its best neighbour, without a proof that no better direction exists elsewhere.
    Fast,
    /// Proves that the direction is the best of all, or searches all.
    Accurate,
}

/// Contact of polyhedron A with polyhedron B at `c` = x_B - x_A, m; `None` if they are farther apart than `range` lists.
///
/// The normal is the direction of smallest distance, or of the smallest translation that separates overlapping bodies. If
/// vertices or edges meet in a point without overlap, or if several directions are equal to 1e-11 of the size, the result
/// is a definite one of those. Source: see the section on polyhedra in docs/method.md.
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
    let (kept, manifold) = pair_manifold(PairQuery { pair, start, hint: None, narrow, range: range.into() });
    *memory = kept;
    manifold
}

fn pair_manifold(asked: PairQuery) -> (CachedFeature, Option<Manifold>) {
    let mut found = (CachedFeature::default(), None);
    let mut take = |(), sight: PairResult| {
        found = match sight {
            Ok((memory, manifold)) => (memory, Some(manifold.clone())),
            Err(Separated { n, s }) => {
                (CachedFeature::from_axis(&SearchAxis { n, s, feature: SearchFeature::None }), None)
            }
        };
    };
    let mut together = PairBatch::new(asked.pair.width);
    together.push_query((), asked, &mut take);
    together.flush(&mut take);
    found
}

/// Direction along which two bodies are farther apart than the requested range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Separated {
    /// Unit direction from A to B.
    pub n: Vec3,
    /// Lower bound of their distance, m.
    pub s: f64,
}

/// Result for a pair: the feature to cache and the contact, or a separating direction.
pub type PairResult<'m> = Result<(CachedFeature, &'m Manifold), Separated>;

/// Batch of pairs of polyhedra: bitwise the same results as one by one, and faster.
///
/// Each pair is identified by a `T`. Results come in the order of the requests.
pub struct PairBatch<'a, T> {
    width: SimdWidth,
    /// Pairs whose points are not computed yet.
    waiting: [Option<PendingPair<'a, T>>; MAX_PENDING_PAIRS],
    count: usize,
    triangles: TriangleBatch,
    /// Patch of the current pair.
    patch: ContactPatch,
    manifold: Manifold,
}

struct PendingPair<'a, T> {
    of: T,
    asked: PairQuery<'a>,
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
    pub fn new(width: SimdWidth) -> Self {
        PairBatch {
            width,
            waiting: [const { None }; MAX_PENDING_PAIRS],
            count: 0,
            triangles: TriangleBatch::new(),
            patch: ContactPatch::default(),
            manifold: Manifold::default(),
        }
    }

    /// Requests the result of [`polyhedron_polyhedron`]; `take` is called with `of` and the result, in this or a later
    /// call.
    ///
    /// `hint`: direction along which the bodies may be apart.
    #[expect(clippy::too_many_arguments, reason = "those of one pair, and who takes what is found")]
    pub fn push_pair(
        &mut self,
        of: T,
        [a, b]: [&'a PosedPolyhedron; 2],
        c: &Vec3,
        range: ListingRange,
        narrow: NarrowPhaseMode,
        memory: &CachedFeature,
        hint: Option<Vec3>,
        take: &mut impl FnMut(T, PairResult),
    ) {
        let pair = PolyhedronPair::new(a, b, *c, self.width);
        let start = memory.search_start(&pair);
        self.push_query(of, PairQuery { pair, start, hint, narrow, range }, take);
    }

    fn push_query(&mut self, of: T, asked: PairQuery<'a>, take: &mut impl FnMut(T, PairResult)) {
        let PairQuery { pair, start, hint, narrow, range } = &asked;
        let found = search::separating_axis(pair, *start, *hint, *narrow, *range);
        let SearchResult { axis, faces, .. } = &found;
        if axis.s > range.alert {
            return take(of, Err(axis.as_separated()));
        }
        let patch = axis.feature != SearchFeature::None && !found.is_far(range) && !search::is_ridge_pair(pair, axis);
        let triangles = if patch { self.triangles.push_faces(pair, axis, *faces) } else { None };
        self.waiting[self.count] = Some(PendingPair { of, asked, found, triangles });
        self.count += 1;
        if self.triangles.is_full() || self.count == MAX_PENDING_PAIRS {
            self.flush(take);
        }
    }

    /// Computes all pending results.
    pub fn flush(&mut self, take: &mut impl FnMut(T, PairResult)) {
        let PairBatch { width, waiting, count, triangles, patch, manifold } = self;
        triangles.clip_faces(*width);
        for PendingPair { of, asked, found, triangles: place } in waiting[..*count].iter().flatten() {
            let axis = &found.axis;
            let seen = place.is_some_and(|k| triangles.write_patch(k, axis, asked.range.area, patch));
            if seen && patch.has_axis_gap(axis.s, asked.pair.tie_tolerance()) {
                take(*of, patch_result(asked, axis, patch, manifold));
            } else {
                manifold_scalar(asked, found, patch, manifold, &mut |sight: PairResult| take(*of, sight));
            }
        }
        *count = 0;
        triangles.clear();
    }
}

/// Returns the points of a patch that are within the range.
fn patch_result<'m>(
    asked: &PairQuery,
    axis: &SearchAxis,
    patch: &mut ContactPatch,
    manifold: &'m mut Manifold,
) -> PairResult<'m> {
    patch.write_manifold(asked.range, asked.pair.tie_tolerance(), manifold);
    // Within rounding there may be no point.
    if manifold.points.is_empty() { Err(axis.as_separated()) } else { Ok((CachedFeature::from_axis(axis), manifold)) }
}

/// Computes the manifold of a single pair whose direction is known.
fn manifold_scalar(
    asked: &PairQuery,
    found: &SearchResult,
    patch: &mut ContactPatch,
    manifold: &mut Manifold,
    take: &mut impl FnMut(PairResult),
) {
    let PairQuery { pair, start, narrow, range, .. } = asked;
    let SearchResult { axis, faces, met, .. } = found;
    let kept = CachedFeature::from_axis(axis);
    let own_point = |area| {
        let points = search::axis_point(pair, axis, *met).into_iter().collect();
        Manifold { normal: -axis.n, points, area }
    };
    if found.is_far(range) {
        let nearest = own_point(0.0);
        if !nearest.points.is_empty() {
            return take(Ok((kept, &nearest)));
        }
    }
    if search::is_ridge_pair(pair, axis)
        && let Some(ridges) = gjk::ridge_manifold(pair, &axis.n, axis.s)
    {
        return take(Ok((kept, &ridges)));
    }
    if axis.feature != SearchFeature::None && !found.is_far(range) {
        patch.clip_faces(pair, axis, *faces, range.area);
        if patch.has_axis_gap(axis.s, pair.tie_tolerance()) {
            return take(patch_result(asked, axis, patch, manifold));
        }
        if axis.s <= 0.0 {
            // The overlap is not proven to be the smallest: the axis's own features give one point.
            return take(Ok((kept, &own_point(patch.area))));
        }
    }
    let nearest = gjk::nearest_points(pair, axis.n, range.alert);
    if nearest.on_faces && matches!(start, SearchStart::Direction(_)) {
        let found = search::separating_axis(pair, SearchStart::Nothing, None, *narrow, *range);
        if found.axis.s > range.alert {
            return take(Err(found.axis.as_separated()));
        }
        let asked = PairQuery { start: SearchStart::Nothing, ..*asked };
        return manifold_scalar(&asked, &found, patch, manifold, take);
    }
    let along = SearchAxis { n: nearest.n, s: axis.s, feature: SearchFeature::None };
    match &nearest.manifold {
        Some(manifold) => take(Ok((CachedFeature::from_axis(&along), manifold))),
        None => take(Err(along.as_separated())),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
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
                let of = |width| {
                    let pair = PolyhedronPair::new(&pa, &pb, c, width);
                    pair_manifold(PairQuery {
                        pair,
                        start,
                        hint: None,
                        narrow: NarrowPhaseMode::Accurate,
                        range: 0.05.into(),
                    })
                };
                let found: Vec<_> = SimdWidth::all_widths().into_iter().map(of).collect();
                assert!(found.iter().all(|one| *one == found[0]), "{k}: {found:?}");
                contacts += usize::from(found[0].1.is_some());
            }
        }
        assert!((300..1300).contains(&contacts), "both apart and in contact: {contacts}");
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
