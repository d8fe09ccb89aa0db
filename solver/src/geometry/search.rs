//! Search for the direction in which two polyhedra are farthest apart, among the face normals and the cross products of
//! edges.
//!
//! s(n) = min_B n·(b + c) - max_A n·a for a unit n from A to B is a lower bound of the distance of A and B. Its maximum
//! over the facet normals of the Minkowski difference is the distance, unless the nearest features are two vertices, or a
//! vertex and an edge. If A and B overlap, -s is the smallest translation that separates them.
//!
//! Two bounds save most of the work. With the balls in A and B about their centres, s(n) <= n·c - r_A - r_B: a known s
//! leaves only a cone of directions about c. And s(n) <= n·x for every point x of the difference B - A, such as those of
//! the directions tried before.

use smallvec::{Array, SmallVec};

use super::manifold::{ContactPoint, ListingRange, NarrowPhaseMode, edge_feature, face_feature, vertex_feature};
use super::pair::{PatchCorner, PolyhedronPair, SearchAxis, SearchFeature, dot_columns, lowest_vertex, support_vertex};
use super::polyhedron::FeatureIndex;
use super::polyhedron::{Polyhedron, PosedPolyhedron};
use crate::math::simd::{F64Arithmetic, LaneOperation, Scalar};
use crate::math::{Vec3, vector_length};

/// Start of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum SearchStart {
    Nothing,
    Feature(SearchFeature),
    Direction(Vec3),
}

/// Products of the two dots of a Gauss-map test above which edges count as parallel, divided by the squared length of
/// the edge: 4e-12 rad. Skipping such edges changes s by at most [`PolyhedronPair::tie_tolerance`].
const PARALLEL_EDGE_PRODUCT: f64 = 1.6e-23;
/// Angle up to which edges count as parallel ridges, rad.
pub(super) const RIDGE_ANGLE: f64 = 1e-11;
/// Margin by which a face must be better aligned than its neighbour to be preferred.
const ALIGNMENT_MARGIN: f64 = 1e-9;
/// Number of stored points of the difference: the start, four about a face on a face, the best of either body's faces.
const MAX_WITNESSES: usize = 7;
/// Angle up to which faces are taken to lie on each other, rad.
const FACE_ON_FACE_ANGLE: f64 = 1e-3;
/// Edges of B per column block; independent of the vector width, so that the order is, too.
const COLUMN_BLOCK: usize = 8;

/// Returns the best direction, or the first found along which A and B are farther apart than `range`; `hint` may be one.
pub(super) fn separating_axis(
    pair: &PolyhedronPair,
    start: SearchStart,
    hint: Option<Vec3>,
    narrow: NarrowPhaseMode,
    range: ListingRange,
) -> SearchResult {
    let found = pair.width.run(AxisSearch { pair, start, hint, narrow, range });
    if found.axis.feature == SearchFeature::None && found.axis.s <= 0.0 {
        // Rounding has led the search astray.
        let axis = exhaustive_search(pair, range.alert);
        return SearchResult {
            axis,
            touched_vertex: None,
            nearest: false,
            faces: support_faces(Scalar, pair, &axis, None),
        };
    }
    found
}

/// Result of a search: a direction, and the features there.
pub(super) struct SearchResult {
    pub axis: SearchAxis,
    /// Vertex that a face touches, if the axis is the normal of a face and the vertex is known.
    pub touched_vertex: Option<u32>,
    /// Whether the bodies are apart, and the features of the axis contain their nearest points.
    pub nearest: bool,
    /// Faces of A and of B, if the points of both are needed.
    pub faces: (u32, u32),
}

impl SearchResult {
    /// Whether only the nearest point is needed.
    pub fn is_far(&self, range: &ListingRange) -> bool {
        self.nearest && self.axis.s > range.patch
    }
}

/// Search for the axis of a pair; see [`SearchResult`].
struct AxisSearch<'a> {
    pair: &'a PolyhedronPair<'a>,
    start: SearchStart,
    hint: Option<Vec3>,
    narrow: NarrowPhaseMode,
    range: ListingRange,
}

impl LaneOperation for AxisSearch<'_> {
    type Output = SearchResult;

    #[inline(always)]
    fn call<L: F64Arithmetic>(self, l: L) -> SearchResult {
        let FoundAxis { axis, touched_vertex, is_proven } = self.best_axis(l);
        let ListingRange { alert, patch, .. } = self.range;
        let nearest = is_proven && axis.s > 0.0;
        let needs_faces = axis.s <= if nearest { patch } else { alert };
        let faces = if needs_faces { support_faces(l, self.pair, &axis, touched_vertex) } else { (0, 0) };
        SearchResult { axis, touched_vertex, nearest, faces }
    }
}

/// Axis that a search has found.
struct FoundAxis {
    axis: SearchAxis,
    /// Vertex that a face touches, if known.
    touched_vertex: Option<u32>,
    /// Whether the axis is proven to be the best.
    is_proven: bool,
}

impl FoundAxis {
    /// Axis without a touched vertex and without a proof.
    #[inline(always)]
    fn unproven_axis(axis: SearchAxis) -> Self {
        FoundAxis { axis, touched_vertex: None, is_proven: false }
    }
}

impl AxisSearch<'_> {
    /// Returns the best axis, or the first along which A and B are farther apart than the range.
    #[inline(always)]
    fn best_axis<L: F64Arithmetic>(&self, l: L) -> FoundAxis {
        let &AxisSearch { pair, start, hint, narrow, range: ListingRange { alert, .. } } = self;
        if let Some(n) = hint {
            let s = separation_along(l, pair, &n);
            if s > alert {
                return FoundAxis::unproven_axis(SearchAxis { n, s, feature: SearchFeature::None });
            }
        }
        let mut witnesses = WitnessPoints { points: [Vec3::zeros(); MAX_WITNESSES], count: 0 };
        let start_axis = starting_axis(l, pair, start, &mut witnesses);
        let FoundAxis { axis: best, touched_vertex, .. } = start_axis;
        let from_direction = matches!(start, SearchStart::Direction(_)) && best.s > 0.0;
        if best.s > alert || from_direction {
            return start_axis;
        }
        if is_best(l, pair, &best, &witnesses.points[0], narrow) {
            return FoundAxis { is_proven: true, ..start_axis };
        }
        let (from_a, from_b) = (PairView::from_a(pair), PairView::from_b(pair));
        match (best.feature, touched_vertex) {
            (SearchFeature::FaceOfA(f), Some(v)) => add_face_witnesses(l, from_a, f, v, &mut witnesses),
            (SearchFeature::FaceOfB(f), Some(v)) => add_face_witnesses(l, from_b, f, v, &mut witnesses),
            _ => {}
        }
        // Search keeps a known face among equally good ones. Without one, the order of the faces must not decide: it is
        // not mirrored in mirrored pairs.
        let largest = (best.feature == SearchFeature::None).then_some(best.s);
        let mut found = BestFace { axis: best, largest };
        if search_faces(l, from_a, &mut found, &mut witnesses, alert)
            || search_faces(l, from_b, &mut found, &mut witnesses, alert)
        {
            return FoundAxis::unproven_axis(found.axis);
        }
        search_edges(l, pair, &mut found.axis, &witnesses, alert);
        FoundAxis::unproven_axis(found.axis)
    }
}

/// Pair seen from one of its two polyhedra.
#[derive(Clone, Copy)]
struct PairView<'a> {
    pair: &'a PolyhedronPair<'a>,
    own: &'a PosedPolyhedron<'a>,
    other: &'a PosedPolyhedron<'a>,
    /// 1 if `own` is A, -1 if it is B: factor from directions from A to B to directions from `own` to `other`.
    sign: f64,
}

impl<'a> PairView<'a> {
    #[inline(always)]
    fn from_a(pair: &'a PolyhedronPair<'a>) -> Self {
        PairView { pair, own: pair.posed_a, other: pair.posed_b, sign: 1.0 }
    }

    #[inline(always)]
    fn from_b(pair: &'a PolyhedronPair<'a>) -> Self {
        PairView { pair, own: pair.posed_b, other: pair.posed_a, sign: -1.0 }
    }
}

/// Points of the difference B - A, m.
struct WitnessPoints {
    points: [Vec3; MAX_WITNESSES],
    count: usize,
}

impl WitnessPoints {
    #[inline(always)]
    fn add(&mut self, x: Vec3) {
        if self.count < MAX_WITNESSES {
            self.points[self.count] = x;
            self.count += 1;
        }
    }

    /// Points of the difference of the other polyhedron and `own`, in the frame of `own`.
    #[inline(always)]
    fn to_local(&self, PairView { own, sign, .. }: PairView) -> [Vec3; MAX_WITNESSES] {
        let mut points = [Vec3::zeros(); MAX_WITNESSES];
        let mut i = 0;
        while i < self.count {
            points[i] = own.local_vector(&self.points[i]) * sign;
            i += 1;
        }
        points
    }
}

/// Adds corners of the facet that the face `f` of `own` makes with the face of `other` that lies on it at the vertex `v`:
/// the lowest one in each of four directions. If they surround the foot of the origin, they exclude all directions but
/// those near the normal.
#[inline(always)]
fn add_face_witnesses<L: F64Arithmetic>(
    l: L,
    PairView { pair, own, other, sign }: PairView,
    f: u32,
    v: u32,
    witnesses: &mut WitnessPoints,
) {
    let n = own.face_normal(f);
    let g = support_face(l, other, &-n, Some(v));
    if n.cross(&other.face_normal(g)).norm_squared() > FACE_ON_FACE_ANGLE * FACE_ON_FACE_ANGLE {
        return;
    }
    let corners = own.shape.face_corners(f as usize);
    let along = own.vertex(corners[1]) - own.vertex(corners[0]);
    for direction in [along, n.cross(&along), -along, -n.cross(&along)] {
        let (on_own, on_other) = (
            own.vertex(face_support_vertex(own, f, &direction)),
            other.vertex(face_support_vertex(other, g, &-direction)),
        );
        witnesses.add((on_other - on_own) * sign + pair.centre_offset);
    }
}

/// Returns the first corner of a face that is farthest along `n`.
#[inline(always)]
fn face_support_vertex(posed: &PosedPolyhedron, f: u32, n: &Vec3) -> FeatureIndex {
    let (shape, n) = (posed.shape, posed.local_vector(n));
    let corners = shape.face_corners(f as usize);
    let (mut best, mut highest) = (corners[0], f64::NEG_INFINITY);
    for &corner in corners {
        let height = shape.vertex(corner.into()).dot(&n);
        if height > highest {
            (best, highest) = (corner, height);
        }
    }
    best
}

/// Appends the lanes of a mask as indices from `k` on, as far as they are below `count`.
#[inline(always)]
fn push_mask_lanes(kept: &mut SmallVec<impl Array<Item = u32>>, mut mask: u32, k: usize, count: usize) {
    while mask != 0 {
        let index = k + mask.trailing_zeros() as usize;
        mask &= mask - 1;
        if index < count {
            kept.push(index as u32);
        }
    }
}

/// Evaluates the cached feature at the new poses; without one, the direction between the centres.
#[inline(always)]
fn starting_axis<L: F64Arithmetic>(
    l: L,
    pair: &PolyhedronPair,
    start: SearchStart,
    witnesses: &mut WitnessPoints,
) -> FoundAxis {
    let n = match start {
        SearchStart::Feature(SearchFeature::FaceOfA(f)) => {
            let n = pair.posed_a.face_normal(f);
            let (v, low) = lowest_vertex(l, pair.posed_b, &n);
            witnesses.add(
                pair.posed_b.vertex(v) + pair.centre_offset
                    - pair.posed_a.vertex(pair.shape_a.face_corners(f as usize)[0]),
            );
            let s = n.dot(&pair.centre_offset) - pair.shape_a.face_planes()[f as usize].offset + low;
            let axis = SearchAxis { n, s, feature: SearchFeature::FaceOfA(f) };
            return FoundAxis { axis, touched_vertex: Some(v), is_proven: false };
        }
        SearchStart::Feature(SearchFeature::FaceOfB(f)) => {
            let n = pair.posed_b.face_normal(f);
            let (v, low) = lowest_vertex(l, pair.posed_a, &n);
            witnesses.add(
                pair.posed_b.vertex(pair.shape_b.face_corners(f as usize)[0]) + pair.centre_offset
                    - pair.posed_a.vertex(v),
            );
            let s = -n.dot(&pair.centre_offset) - pair.shape_b.face_planes()[f as usize].offset + low;
            let axis = SearchAxis { n: -n, s, feature: SearchFeature::FaceOfB(f) };
            return FoundAxis { axis, touched_vertex: Some(v), is_proven: false };
        }
        SearchStart::Feature(SearchFeature::Edges(ea, eb)) => {
            let EdgeAxis { n, s, arcs_cross } = edge_axis(pair, ea, eb);
            if arcs_cross && true_separation(l, pair, &n, s) == s {
                let [a, b] = [pair.shape_a.edges()[ea as usize].ends[0], pair.shape_b.edges()[eb as usize].ends[0]];
                witnesses.add(pair.posed_b.vertex(b) + pair.centre_offset - pair.posed_a.vertex(a));
                return FoundAxis::unproven_axis(SearchAxis { n, s, feature: SearchFeature::Edges(ea, eb) });
            }
            n
        }
        SearchStart::Direction(n) => n,
        _ => pair.centre_offset,
    };
    let length = vector_length(&n);
    let n = if length > 0.0 && length.is_finite() { n / length } else { Vec3::x() };
    let (b, low) = lowest_vertex(l, pair.posed_b, &n);
    let (a, high) = lowest_vertex(l, pair.posed_a, &-n);
    witnesses.add(pair.posed_b.vertex(b) + pair.centre_offset - pair.posed_a.vertex(a));
    FoundAxis::unproven_axis(SearchAxis { n, s: n.dot(&pair.centre_offset) + low + high, feature: SearchFeature::None })
}

/// Returns s(n).
#[inline(always)]
fn separation_along<L: F64Arithmetic>(l: L, pair: &PolyhedronPair, n: &Vec3) -> f64 {
    let low = lowest_vertex(l, pair.posed_b, n).1;
    n.dot(&pair.centre_offset) + low + lowest_vertex(l, pair.posed_a, &-n).1
}

/// Returns the true separation of two edges whose arcs cross with the separation `s`. Shapes rounded in files are convex
/// up to their digits only, and the ends of short edges nearly parallel to long ones are rounded by more than their
/// distance.
#[inline(always)]
fn true_separation<L: F64Arithmetic>(l: L, pair: &PolyhedronPair, n: &Vec3, s: f64) -> f64 {
    let separation = separation_along(l, pair, n);
    if separation < s - pair.tie_tolerance() { separation } else { s }
}

/// Whether a feature's direction is proven to be the best, by its facet of the Minkowski difference.
///
/// If the facet contains a disc of radius ρ about the foot of the origin, every direction within 2 atan(ρ/|s|) of n is
/// worse. If that angle exceeds the cone of directions that the inner balls leave, n is the best of all. For separated
/// bodies a foot within the facet is enough: there are points at that distance.
#[inline(always)]
fn is_best<L: F64Arithmetic>(
    l: L,
    pair: &PolyhedronPair,
    axis: &SearchAxis,
    x: &Vec3,
    narrow: NarrowPhaseMode,
) -> bool {
    let rho = match axis.feature {
        SearchFeature::FaceOfA(f) => inside_distance(pair.shape_a, f, &pair.posed_a.local_vector(x)),
        SearchFeature::FaceOfB(f) => inside_distance(pair.shape_b, f, &pair.posed_b.local_vector(&-x)),
        SearchFeature::Edges(ea, eb) => {
            let ([a0, a1], [b0, b1]) = (edge_ends(pair.posed_a, ea), edge_ends(pair.posed_b, eb));
            let (u, v, w) = (a1 - a0, b1 - b0, b0 + pair.centre_offset - a0);
            let across = u.cross(&v);
            let square = across.norm_squared();
            let (p, q) = (w.cross(&v).dot(&across) / square, w.cross(&u).dot(&across) / square);
            // Distances from the sides of the parallelogram.
            let (along_u, along_v) = (p.min(1.0 - p) / vector_length(&v), q.min(1.0 - q) / vector_length(&u));
            along_u.min(along_v) * square.sqrt()
        }
        SearchFeature::None => return false,
    };
    if rho.is_nan() || rho < 0.0 {
        return false;
    }
    if axis.s >= 0.0 {
        return true;
    }
    if narrow == NarrowPhaseMode::Fast {
        // Accepts n unless the direction between the centres shows that the bodies have left this side of each other.
        let n = pair.centre_offset / vector_length(&pair.centre_offset);
        return separation_along(l, pair, &n) <= axis.s;
    }
    let r = rho / -axis.s * (1.0 - 1e-9);
    let cos_disc = (1.0 - r * r) / (1.0 + r * r);
    let distance = vector_length(&pair.centre_offset);
    let (cos_cone, cos_n) = ((axis.s + pair.inradius_sum()) / distance, axis.n.dot(&pair.centre_offset) / distance);
    if cos_cone.is_nan() || cos_cone.abs() >= 1.0 {
        return cos_cone >= 1.0;
    }
    let (sin_cone, sin_n) = ((1.0 - cos_cone * cos_cone).sqrt(), (1.0 - cos_n * cos_n).max(0.0).sqrt());
    // The sum of the two angles is below half a turn, and below the angle of the disc.
    sin_n * cos_cone + cos_n * sin_cone > 0.0 && cos_n * cos_cone - sin_n * sin_cone > cos_disc
}

/// Distance of a point, seen along the normal, from the nearest side of a face, m; < 0 outside. In the shape's frame,
/// from the face's first corner.
#[inline(always)]
fn inside_distance(shape: &Polyhedron, f: u32, point: &Vec3) -> f64 {
    let (n, corners) = (shape.face_planes()[f as usize].normal, shape.face_corners(f as usize));
    let point = shape.vertex(corners[0].into()) + point;
    let mut smallest = f64::INFINITY;
    let mut from = shape.vertex(corners[corners.len() - 1].into());
    for &corner in corners {
        let to = shape.vertex(corner.into());
        let along = to - from;
        smallest = smallest.min(n.cross(&along).dot(&(point - from)) / vector_length(&along));
        from = to;
    }
    smallest
}

/// Best axis of the faces tried so far.
struct BestFace {
    axis: SearchAxis,
    /// Largest separation so far, m, if no face is known from before. Of the faces that have it up to the tie tolerance, the
    /// one whose normal is nearest to the direction between the centres is taken.
    largest: Option<f64>,
}

/// Tries the faces of `own` against the vertices of `other`. Returns whether the separation exceeds `alert` (m), which
/// ends the search.
#[inline(always)]
fn search_faces<L: F64Arithmetic>(
    l: L,
    view: PairView,
    BestFace { axis: best, largest }: &mut BestFace,
    witnesses: &mut WitnessPoints,
    alert: f64,
) -> bool {
    let PairView { pair, own, other, sign } = view;
    let tie = pair.tie_tolerance();
    let slack = pair.rounding_bound() + if largest.is_some() { tie } else { 0.0 };
    let mut kept: SmallVec<[u32; 32]> = SmallVec::new();
    collect_faces_in_cone(l, view, largest.unwrap_or(best.s) - slack, witnesses, &mut kept);
    let min_alignment_gain = ALIGNMENT_MARGIN * vector_length(&pair.centre_offset);
    let [vx, vy, vz] = other.shape.vertex_columns();
    let count = other.shape.vertices().len();
    let c = pair.centre_offset * sign;
    let mut changed = false;
    let mut from = 0;
    while from < kept.len() {
        // Columns: the normals in the frame of the other body, offsets and n·c of up to eight faces; unused lanes can
        // never be the best.
        let mut block = [[0.0; COLUMN_BLOCK]; 5];
        block[3] = [f64::INFINITY; COLUMN_BLOCK];
        let mut k = 0;
        while k < COLUMN_BLOCK && from + k < kept.len() {
            let f = kept[from + k];
            let n = own.face_normal(f);
            (block[3][k], block[4][k]) = (own.shape.face_planes()[f as usize].offset, n.dot(&c));
            let n = other.local_vector(&n);
            (block[0][k], block[1][k], block[2][k]) = (n.x, n.y, n.z);
            k += 1;
        }
        let filled = k;
        let mut k = 0;
        while k < filled {
            let (nx, ny, nz) = (l.load(&block[0][k..]), l.load(&block[1][k..]), l.load(&block[2][k..]));
            let along = l.load(&block[4][k..]);
            let (mut even, mut odd) = (l.splat(f64::INFINITY), l.splat(f64::INFINITY));
            let mut v = 0;
            // The last vertex may be read twice: columns are padded by the first.
            while v < count {
                let (px, py, pz) = (l.splat(vx[v]), l.splat(vy[v]), l.splat(vz[v]));
                even = l.min(l.mul_add(nz, pz, l.mul_add(ny, py, l.mul(nx, px))), even);
                let (px, py, pz) = (l.splat(vx[v + 1]), l.splat(vy[v + 1]), l.splat(vz[v + 1]));
                odd = l.min(l.mul_add(nz, pz, l.mul_add(ny, py, l.mul(nx, px))), odd);
                v += 2;
            }
            let s = l.add(l.sub(along, l.load(&block[3][k..])), l.min(even, odd));
            // Neither threshold falls, so that the lanes do not depend on the vector width.
            let mut mask = l.mask_greater(s, l.splat(largest.map_or(best.s + tie, |largest| largest - tie)));
            if mask != 0 {
                let mut values = [0.0; 8];
                l.store(&mut values, s);
                while mask != 0 {
                    let lane = mask.trailing_zeros() as usize;
                    mask &= mask - 1;
                    let wins = values[lane] > separation_to_beat(best, tie)
                        || largest.is_some_and(|largest| values[lane] > largest - tie)
                            && block[4][k + lane] - best.n.dot(&pair.centre_offset) > min_alignment_gain;
                    if wins {
                        let f = kept[from + k + lane];
                        let feature = if sign > 0.0 { SearchFeature::FaceOfA(f) } else { SearchFeature::FaceOfB(f) };
                        *best = SearchAxis { n: own.face_normal(f) * sign, s: values[lane], feature };
                        *largest = largest.map(|largest| largest.max(best.s));
                        changed = true;
                        // Tested at once, so that the end does not depend on the vector width.
                        if best.s > alert {
                            return true;
                        }
                    }
                }
            }
            k += L::WIDTH;
        }
        from += COLUMN_BLOCK;
    }
    if changed {
        let (SearchFeature::FaceOfA(f) | SearchFeature::FaceOfB(f)) = best.feature else { return false };
        let (v, _) = lowest_vertex(l, other, &(best.n * sign));
        let corner = own.vertex(own.shape.face_corners(f as usize)[0]);
        witnesses.add((other.vertex(v) - corner) * sign + pair.centre_offset);
    }
    false
}

/// Indices of the faces of `own` that the bounds leave, if their separation is to be `min_separation` (m) or more.
#[inline(always)]
fn collect_faces_in_cone<L: F64Arithmetic>(
    l: L,
    view: PairView,
    min_separation: f64,
    witnesses: &WitnessPoints,
    kept: &mut SmallVec<[u32; 32]>,
) {
    let PairView { pair, own, sign, .. } = view;
    // In the frame of the body that owns the faces.
    let shape = own.shape;
    let c = own.local_vector(&pair.centre_offset) * sign;
    let witness = witnesses.to_local(view);
    let pad = shape.normals.len() / 3;
    let (x, y, z) = (&shape.normals[..pad], &shape.normals[pad..2 * pad], &shape.normals[2 * pad..]);
    let count = shape.face_planes().len();
    let mut k = 0;
    while k < count {
        let normals = [l.load(&x[k..]), l.load(&y[k..]), l.load(&z[k..])];
        let mut mask = l.mask_greater(dot_columns(l, &c, normals), l.splat(min_separation + pair.inradius_sum()));
        let mut i = 0;
        while i < witnesses.count {
            mask &= l.mask_greater(dot_columns(l, &witness[i], normals), l.splat(min_separation));
            i += 1;
        }
        push_mask_lanes(kept, mask, k, count);
        k += L::WIDTH;
    }
}

/// Threshold that an s must exceed to replace the best; a direction without a feature is replaced by an equally good
/// feature.
#[inline(always)]
fn separation_to_beat(best: &SearchAxis, tie: f64) -> f64 {
    if best.feature == SearchFeature::None { best.s - tie } else { best.s + tie }
}

/// Slack below the best s within which the bounds must not exclude directions, m.
#[inline(always)]
fn bound_slack(pair: &PolyhedronPair, best: &SearchAxis) -> f64 {
    if best.feature == SearchFeature::None {
        pair.tie_tolerance() + pair.rounding_bound()
    } else {
        pair.rounding_bound()
    }
}

/// Pairs of edges whose arcs on the Gauss map cross.
#[inline(always)]
fn search_edges<L: F64Arithmetic>(
    l: L,
    pair: &PolyhedronPair,
    best: &mut SearchAxis,
    witnesses: &WitnessPoints,
    alert: f64,
) {
    let tie = pair.tie_tolerance();
    let (mut arcs_a, mut arcs_b): (SmallVec<[u32; 64]>, SmallVec<[u32; 64]>) = (SmallVec::new(), SmallVec::new());
    collect_arcs(l, PairView::from_a(pair), best, witnesses, &mut arcs_a);
    if arcs_a.is_empty() {
        return;
    }
    collect_arcs(l, PairView::from_b(pair), best, witnesses, &mut arcs_b);
    let mut from = 0;
    while from < arcs_b.len() {
        // Columns: a point, the direction and the two normals of up to eight edges of B; unused lanes cannot cross.
        let mut block = [[0.0; COLUMN_BLOCK]; 13];
        let mut count = 0;
        while count < COLUMN_BLOCK && from + count < arcs_b.len() {
            let e = arcs_b[from + count];
            let edge = &pair.shape_b.edges()[e as usize];
            let [b0, b1] = edge_ends(pair.posed_b, e);
            let (along, n0, n1) =
                (b1 - b0, pair.posed_b.face_normal(edge.faces[0]), pair.posed_b.face_normal(edge.faces[1]));
            let b0 = b0 + pair.centre_offset;
            let row = [b0.x, b0.y, b0.z, along.x, along.y, along.z, n0.x, n0.y, n0.z, n1.x, n1.y, n1.z];
            let mut column = 0;
            while column < 12 {
                block[column][count] = row[column];
                column += 1;
            }
            block[12][count] = PARALLEL_EDGE_PRODUCT * along.norm_squared();
            count += 1;
        }
        let mut i = 0;
        while i < arcs_a.len() {
            let ea = arcs_a[i];
            let edge = &pair.shape_a.edges()[ea as usize];
            let [a0, a1] = edge_ends(pair.posed_a, ea);
            let (along, n0, n1) =
                (a1 - a0, pair.posed_a.face_normal(edge.faces[0]), pair.posed_a.face_normal(edge.faces[1]));
            let mut k = 0;
            while k < count {
                let arc = EdgeArc { start: &a0, span: &along, normals: [&n0, &n1] };
                let (mask, s) = crossing_arcs(l, &block, k, arc);
                let mut mask = mask & l.mask_greater(s, l.splat(separation_to_beat(best, tie)));
                if mask != 0 {
                    let mut values = [0.0; 8];
                    l.store(&mut values, s);
                    while mask != 0 {
                        let lane = mask.trailing_zeros() as usize;
                        mask &= mask - 1;
                        if values[lane] > separation_to_beat(best, tie) {
                            let eb = arcs_b[from + k + lane];
                            let EdgeAxis { n, s, .. } = edge_axis(pair, ea, eb);
                            let s = true_separation(l, pair, &n, s);
                            if s > separation_to_beat(best, tie) {
                                *best = SearchAxis { n, s, feature: SearchFeature::Edges(ea, eb) };
                            }
                            if best.s > alert {
                                return;
                            }
                        }
                    }
                }
                k += L::WIDTH;
            }
            i += 1;
        }
        from += COLUMN_BLOCK;
    }
}

/// Edge whose arc on the Gauss map leads from the normal of one of its faces to that of the other.
struct EdgeArc<'a> {
    start: &'a Vec3,
    /// Vector from the start to the end, m.
    span: &'a Vec3,
    normals: [&'a Vec3; 2],
}

/// Tests an edge of A against edges of B from column `k` on; returns which arcs cross, and the separations.
#[inline(always)]
fn crossing_arcs<L: F64Arithmetic>(
    l: L,
    block: &[[f64; COLUMN_BLOCK]; 13],
    k: usize,
    EdgeArc { start: a0, span: along, normals: [n0, n1] }: EdgeArc,
) -> (u32, L::V) {
    let parallel = PARALLEL_EDGE_PRODUCT * along.norm_squared();
    macro_rules! at {
        ($column:expr) => {
            l.load(&block[$column][k..])
        };
    }
    macro_rules! dot {
        ($v:expr, $column:expr) => {
            dot_columns(l, $v, [at!($column), at!($column + 1), at!($column + 2)])
        };
    }
    let (p0, p1) = (dot!(along, 6), dot!(along, 9));
    let (q0, q1) = (dot!(n0, 3), dot!(n1, 3));
    let zero = l.splat(0.0);
    let first = l.neg_mul_add(p0, p1, l.splat(-parallel));
    let second = l.neg_mul_add(q0, q1, l.sub(zero, at!(12)));
    let mask = l.mask_greater(l.min(l.min(first, second), l.mul(p0, q0)), zero);
    if mask == 0 {
        return (0, zero);
    }
    // |q1| n0 + |q0| n1: q0 and q1 have opposite signs.
    let (w0, w1) = (l.abs(q1), l.abs(q0));
    macro_rules! mix {
        ($axis:ident) => {
            l.mul_add(l.splat(n1.$axis), w1, l.mul(l.splat(n0.$axis), w0))
        };
    }
    let (nx, ny, nz) = (mix!(x), mix!(y), mix!(z));
    let (dx, dy, dz) = (l.sub(at!(0), l.splat(a0.x)), l.sub(at!(1), l.splat(a0.y)), l.sub(at!(2), l.splat(a0.z)));
    let along = l.mul_add(nz, dz, l.mul_add(ny, dy, l.mul(nx, dx)));
    let length = l.sqrt(l.mul_add(nz, nz, l.mul_add(ny, ny, l.mul(nx, nx))));
    (mask, l.div(along, length))
}

/// Indices of the edges of `own` with a direction on their arc of the Gauss map that the bounds leave, and few others.
#[inline(always)]
fn collect_arcs<L: F64Arithmetic>(
    l: L,
    view: PairView,
    best: &SearchAxis,
    witnesses: &WitnessPoints,
    kept: &mut SmallVec<[u32; 64]>,
) {
    let PairView { pair, own, sign, .. } = view;
    let slack = bound_slack(pair, best);
    let shape = own.shape;
    let c = own.local_vector(&pair.centre_offset) * sign;
    let witness = witnesses.to_local(view);
    let cone = l.splat(best.s + pair.inradius_sum() - slack);
    let limit = l.splat(best.s.min(0.0) - slack);
    let count = shape.edges().len();
    let pad = shape.arc_pad;
    let columns = &shape.arcs;
    let zero = l.splat(0.0);
    let mut k = 0;
    while k < count {
        macro_rules! at {
            ($column:expr) => {
                l.load(&columns[$column * pad + k..])
            };
        }
        macro_rules! dot {
            ($v:expr, $column:expr) => {
                dot_columns(l, $v, [at!($column), at!($column + 1), at!($column + 2)])
            };
        }
        // If c lies between the normals, the nearer normal is at most at half the angle between them.
        let (d0, d1) = (dot!(&c, 0), dot!(&c, 3));
        let beyond = l.select_greater(cone, zero, l.mul(cone, at!(6)), cone);
        let mut mask = l.mask_greater(l.select_greater(d0, d1, d0, d1), beyond);
        let mut i = 0;
        while mask != 0 && i < witnesses.count {
            // If both ends are below, the whole arc is: s <= 0 or, for separated bodies, no direction at all.
            let (e0, e1) = (dot!(&witness[i], 0), dot!(&witness[i], 3));
            mask &= l.mask_greater(l.select_greater(e0, e1, e0, e1), limit);
            i += 1;
        }
        push_mask_lanes(kept, mask, k, count);
        k += L::WIDTH;
    }
}

/// Tries every face of A, every face of B and every pair of edges, each by full support; stops at a separation above
/// `alert` (m).
fn exhaustive_search(pair: &PolyhedronPair, alert: f64) -> SearchAxis {
    let gain = pair.tie_tolerance();
    let mut best = SearchAxis { n: Vec3::x(), s: f64::NEG_INFINITY, feature: SearchFeature::None };
    // Returns whether the direction ends the search.
    let mut is_enough = |n: Vec3, feature: SearchFeature| {
        let s = pair.separation_along(&n).0;
        if s > best.s + gain || best.feature == SearchFeature::None {
            best = SearchAxis { n, s, feature };
        }
        best.s > alert
    };
    for f in 0..pair.shape_a.face_planes().len() as u32 {
        if is_enough(pair.posed_a.face_normal(f), SearchFeature::FaceOfA(f)) {
            return best;
        }
    }
    for f in 0..pair.shape_b.face_planes().len() as u32 {
        if is_enough(-pair.posed_b.face_normal(f), SearchFeature::FaceOfB(f)) {
            return best;
        }
    }
    for ea in 0..pair.shape_a.edges().len() as u32 {
        for eb in 0..pair.shape_b.edges().len() as u32 {
            if let EdgeAxis { n, arcs_cross: true, .. } = edge_axis(pair, ea, eb)
                && is_enough(n, SearchFeature::Edges(ea, eb))
            {
                return best;
            }
        }
    }
    best
}

/// Common normal of an edge of A and an edge of B.
struct EdgeAxis {
    /// Unit normal from A to B.
    n: Vec3,
    /// Separation of the two edges along it, m.
    s: f64,
    /// Whether their arcs on the Gauss map cross.
    arcs_cross: bool,
}

/// Returns the common normal of two edges.
///
/// Computed from the normals of the adjacent faces instead of the edges' cross product, which loses its digits if they
/// are nearly parallel. Source of the test: D. Gregorius, The separating axis test between convex polyhedra, GDC (2013).
#[inline(always)]
fn edge_axis(pair: &PolyhedronPair, ea: u32, eb: u32) -> EdgeAxis {
    let (a, b) = (&pair.shape_a.edges()[ea as usize], &pair.shape_b.edges()[eb as usize]);
    let ([a0, a1], [b0, b1]) = (edge_ends(pair.posed_a, ea), edge_ends(pair.posed_b, eb));
    let (along_a, along_b) = (a1 - a0, b1 - b0);
    let (na0, na1) = (pair.posed_a.face_normal(a.faces[0]), pair.posed_a.face_normal(a.faces[1]));
    let (nb0, nb1) = (pair.posed_b.face_normal(b.faces[0]), pair.posed_b.face_normal(b.faces[1]));
    let (p0, p1) = (nb0.dot(&along_a), nb1.dot(&along_a));
    let (q0, q1) = (na0.dot(&along_b), na1.dot(&along_b));
    let arcs_cross = p0 * p1 < -PARALLEL_EDGE_PRODUCT * along_a.norm_squared()
        && q0 * q1 < -PARALLEL_EDGE_PRODUCT * along_b.norm_squared()
        && p0 * q0 > 0.0;
    let n = na0 * q1.abs() + na1 * q0.abs();
    let length = vector_length(&n);
    let n = if length > 0.0 { n / length } else { na0 };
    EdgeAxis { n, s: n.dot(&(b0 + pair.centre_offset - a0)), arcs_cross }
}

/// Whether the nearest features of two separated bodies are parallel edges, and only these are listed.
pub(super) fn is_ridge_pair(pair: &PolyhedronPair, axis: &SearchAxis, range: &ListingRange) -> bool {
    matches!(axis.feature, SearchFeature::Edges(ea, eb) if axis.s > range.joint && are_parallel(pair, ea, eb))
}

/// Whether two edges are parallel up to noise.
pub(super) fn are_parallel(pair: &PolyhedronPair, ea: u32, eb: u32) -> bool {
    let ([a0, a1], [b0, b1]) = (edge_ends(pair.posed_a, ea), edge_ends(pair.posed_b, eb));
    let (along_a, along_b) = (a1 - a0, b1 - b0);
    let squares = along_a.norm_squared() * along_b.norm_squared();
    along_a.cross(&along_b).norm_squared() <= RIDGE_ANGLE * RIDGE_ANGLE * squares
}

/// Positions of the two vertices of an edge, m.
#[inline(always)]
pub(super) fn edge_ends(posed: &PosedPolyhedron, e: u32) -> [Vec3; 2] {
    // Not a closure: it would be compiled without the instruction set.
    let [from, to] = posed.shape.edges()[e as usize].ends;
    [posed.vertex(from), posed.vertex(to)]
}

/// Returns the faces whose common part is computed; `touched_vertex`: the vertex that a face touches, if known.
#[inline(always)]
fn support_faces<L: F64Arithmetic>(
    l: L,
    pair: &PolyhedronPair,
    axis: &SearchAxis,
    touched_vertex: Option<u32>,
) -> (u32, u32) {
    let (a, b) = (pair.posed_a, pair.posed_b);
    match axis.feature {
        SearchFeature::FaceOfA(f) => (f, support_face(l, b, &-axis.n, touched_vertex)),
        SearchFeature::FaceOfB(f) => (support_face(l, a, &axis.n, touched_vertex), f),
        SearchFeature::Edges(ea, eb) => (aligned_face(a, ea, &axis.n), aligned_face(b, eb, &-axis.n)),
        SearchFeature::None => (0, 0),
    }
}

/// Returns the face best aligned with `n` at the body's farthest vertex along `n`, which is `top` if that is known.
#[inline(always)]
pub(super) fn support_face<L: F64Arithmetic>(l: L, posed: &PosedPolyhedron, n: &Vec3, top: Option<u32>) -> u32 {
    let top = match top {
        Some(top) => top,
        None => lowest_vertex(l, posed, &-n).0,
    };
    let (shape, n) = (posed.shape, posed.local_vector(n));
    let from = shape.vertex(top as usize);
    // The edge that descends least from the vertex; a face along it has the next vertex.
    let (mut best, mut smallest) = (0, f64::INFINITY);
    for half_edge in shape.half_edges(top as usize) {
        let along = shape.vertex(half_edge.to.into()) - from;
        let descent = along.dot(&n);
        let squared_slope = descent * descent / along.norm_squared();
        if squared_slope < smallest {
            (best, smallest) = (half_edge.edge, squared_slope);
        }
    }
    aligned_face_local(shape, best.into(), &n)
}

/// Returns the face of an edge that is better aligned with `n`; of two equal ones the first.
#[inline(always)]
pub(super) fn aligned_face(posed: &PosedPolyhedron, e: u32, n: &Vec3) -> u32 {
    aligned_face_local(posed.shape, e, &posed.local_vector(n))
}

/// Returns the better aligned face of an edge, as above, with `n` in the shape's frame.
#[inline(always)]
fn aligned_face_local(shape: &Polyhedron, e: u32, n: &Vec3) -> u32 {
    let [f, g] = shape.edges()[e as usize].faces;
    let (first, second) = (f.min(g), f.max(g));
    let alignment = |f: FeatureIndex| shape.face_planes()[f as usize].normal.dot(n);
    u32::from(if alignment(second) > alignment(first) + ALIGNMENT_MARGIN { second } else { first })
}

/// Contact point of an axis's own features; `touched_vertex` is the vertex that a face touches, if known.
pub(super) fn axis_point(
    pair: &PolyhedronPair,
    axis: &SearchAxis,
    touched_vertex: Option<u32>,
) -> Option<ContactPoint> {
    let vertex_of = |posed: &PosedPolyhedron, n: &Vec3| touched_vertex.unwrap_or_else(|| support_vertex(posed, n).0);
    let on_a = || pair.posed_a.vertex(vertex_of(pair.posed_a, &axis.n));
    let on_b = || pair.posed_b.vertex(vertex_of(pair.posed_b, &-axis.n)) + pair.centre_offset;
    let half = axis.n * (0.5 * axis.s);
    let (position, features) = match axis.feature {
        SearchFeature::FaceOfA(f) => {
            (on_b() - half, (face_feature(f), vertex_feature(vertex_of(pair.posed_b, &-axis.n))))
        }
        SearchFeature::FaceOfB(f) => {
            (on_a() + half, (vertex_feature(vertex_of(pair.posed_a, &axis.n)), face_feature(f)))
        }
        SearchFeature::Edges(ea, eb) => {
            let ([a0, a1], [b0, b1]) = (edge_ends(pair.posed_a, ea), edge_ends(pair.posed_b, eb));
            (
                PatchCorner::line_crossing([a0, a1], [b0 + pair.centre_offset, b1 + pair.centre_offset]),
                (edge_feature(ea), edge_feature(eb)),
            )
        }
        SearchFeature::None => {
            let (_, a, b) = pair.separation_along(&axis.n);
            (
                (pair.posed_a.vertex(a) + pair.posed_b.vertex(b) + pair.centre_offset) * 0.5,
                (vertex_feature(a), vertex_feature(b)),
            )
        }
    };
    position.iter().all(|x| x.is_finite()).then_some(ContactPoint { position, gap: axis.s, features })
}
