//! Common part of two triangles seen along the normal, as [`super::outline`] computes it, for several pairs at once.
//!
//! Most faces of rocks are triangles. The corners of the common part of two triangles have fifteen candidates: three
//! vertices of A, three of B, and nine crossings of their sides. All are computed without branches, and the valid ones
//! are taken. If a corner is so near a side that rounding would decide, `outline` decides.

use super::manifold::{edge_feature, face_feature, vertex_feature};
use super::pair::{MIN_FACE_COSINE, PatchCorner, PolyhedronPair, SearchAxis};
use super::patch::{ContactPatch, SAME_CORNER_DISTANCE};
use super::polyhedron::PosedPolyhedron;
use crate::math::Vec3;
use crate::math::simd::{Arithmetic, F64Arithmetic, LaneOperation, SimdWidth};

/// Distance from a side, over the distance up to which two corners count as one, below which `outline` decides.
const MIN_SIDE_CLEARANCE: f64 = 4.0;
/// Number of candidates for corners of the common part: vertices of A, of B, crossings of side i of A with side j of B at
/// 6 + 3 i + j.
const CORNER_SLOTS: usize = 15;

/// First rows of the input of a pair: rotations by columns; c; the normal; for each face the corners, counter-clockwise
/// seen along the normal, and the plane; s; the square of the distance within which `outline` decides.
const TURN_ROWS: [usize; 2] = [0, 9];
const CENTRE_ROW: usize = 18;
const NORMAL_ROW: usize = 21;
const CORNER_ROWS: [usize; 2] = [24, 33];
const PLANE_ROWS: [usize; 2] = [42, 46];
const SEPARATION_ROW: usize = 50;
const NEAR_ROW: usize = 51;
const INPUT_ROWS: usize = 52;

/// Pairs per batch.
pub(super) const BATCH_PAIRS: usize = 8;

/// Pairs whose faces are triangles.
pub(super) struct TriangleBatch {
    given: [[f64; BATCH_PAIRS]; INPUT_ROWS],
    names: [FaceFeatures; BATCH_PAIRS],
    /// For each candidate the point in the middle of the gap, the gap, and x and y seen along the normal.
    corners: [[[f64; BATCH_PAIRS]; 6]; CORNER_SLOTS],
    /// Bit k: whether the common part of pair k has this corner.
    has: [u32; CORNER_SLOTS],
    area: [f64; BATCH_PAIRS],
    /// Bit k: whether all corners of pair k are so far from the sides that rounding does not decide.
    clear: u32,
    count: usize,
}

/// Numbers of the vertices and sides of a face of A and of one of B, as features, and of the faces.
#[derive(Debug, Clone, Copy, Default)]
struct FaceFeatures {
    vertices: [[u32; 3]; 2],
    edges: [[u32; 3]; 2],
    faces: [u32; 2],
}

impl TriangleBatch {
    /// A batch without pairs.
    pub fn new() -> Self {
        TriangleBatch {
            given: [[0.0; BATCH_PAIRS]; INPUT_ROWS],
            names: [FaceFeatures::default(); BATCH_PAIRS],
            corners: [[[0.0; BATCH_PAIRS]; 6]; CORNER_SLOTS],
            has: [0; CORNER_SLOTS],
            area: [0.0; BATCH_PAIRS],
            clear: 0,
            count: 0,
        }
    }

    /// Whether the batch is full.
    pub fn is_full(&self) -> bool {
        self.count == BATCH_PAIRS
    }

    /// Adds the faces of a pair, if they are triangles; returns its number.
    #[inline(always)]
    pub fn push_faces(&mut self, pair: &PolyhedronPair, axis: &SearchAxis, faces: (u32, u32)) -> Option<usize> {
        let (of_a, of_b) = (pair.shape_a.face_corners(faces.0 as usize), pair.shape_b.face_corners(faces.1 as usize));
        let (&[a0, a1, a2], &[b0, b1, b2]) = (of_a, of_b) else { return None };
        let (&[u0, u1, u2], &[v0, v1, v2]) =
            (pair.shape_a.face_edges(faces.0 as usize), pair.shape_b.face_edges(faces.1 as usize))
        else {
            return None;
        };
        let k = self.count;
        self.count += 1;
        // The normal of B's face is opposite to the viewing normal: reverse order.
        self.names[k] = FaceFeatures {
            vertices: [[a0, a1, a2], [b2, b1, b0]].map(|of| of.map(|v| vertex_feature(v.into()))),
            edges: [[u0, u1, u2], [v1, v0, v2]].map(|of| of.map(|e| edge_feature(e.into()))),
            faces: [face_feature(faces.0), face_feature(faces.1)],
        };
        let small = MIN_SIDE_CLEARANCE * SAME_CORNER_DISTANCE * pair.smaller_circumradius;
        self.set_vector(k, CENTRE_ROW, &pair.centre_offset);
        self.set_vector(k, NORMAL_ROW, &axis.n);
        self.given[SEPARATION_ROW][k] = axis.s;
        self.given[NEAR_ROW][k] = small * small;
        self.set_face(k, 0, pair.posed_a, [a0, a1, a2].map(usize::from), faces.0);
        self.set_face(k, 1, pair.posed_b, [b2, b1, b0].map(usize::from), faces.1);
        Some(k)
    }

    #[inline(always)]
    fn set_vector(&mut self, k: usize, at: usize, v: &Vec3) {
        self.given[at][k] = v.x;
        self.given[at + 1][k] = v.y;
        self.given[at + 2][k] = v.z;
    }

    #[inline(always)]
    fn set_face(&mut self, k: usize, side: usize, posed: &PosedPolyhedron, corners: [usize; 3], of: u32) {
        for (column, turn) in posed.turn.as_slice().iter().enumerate() {
            self.given[TURN_ROWS[side] + column][k] = *turn;
        }
        for (corner, &v) in corners.iter().enumerate() {
            self.set_vector(k, CORNER_ROWS[side] + 3 * corner, &posed.shape.vertex(v));
        }
        let plane = &posed.shape.face_planes()[of as usize];
        self.set_vector(k, PLANE_ROWS[side], &plane.normal);
        self.given[PLANE_ROWS[side] + 3][k] = plane.offset;
    }

    /// Computes the common parts of the pairs that have been added.
    pub fn clip_faces(&mut self, width: SimdWidth) {
        width.run(ClipKernel { of: self })
    }

    /// Empties the batch.
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Writes the patch of pair `k` along `axis`, as [`ContactPatch::clip_faces`]; returns false if rounding would decide
    /// about a corner.
    #[inline(always)]
    pub fn write_patch(&self, k: usize, axis: &SearchAxis, area_within: f64, patch: &mut ContactPatch) -> bool {
        if self.clear >> k & 1 == 0 {
            return false;
        }
        patch.corners.clear();
        let mut has = 0;
        for slot in 0..CORNER_SLOTS {
            has |= (self.has[slot] >> k & 1) << slot;
        }
        let names = &self.names[k];
        while has != 0 {
            let slot = has.trailing_zeros() as usize % 16;
            has &= has - 1;
            let at = &self.corners[slot];
            let (point, gap, flat) = ([at[0][k], at[1][k], at[2][k]], at[3][k], [at[4][k], at[5][k]]);
            let features = match slot {
                0..3 => (names.vertices[0][slot], names.faces[1]),
                3..6 => (names.faces[0], names.vertices[1][slot - 3]),
                _ => (names.edges[0][(slot - 6) / 3], names.edges[1][(slot - 6) % 3]),
            };
            patch.corners.push(PatchCorner { point, flat, gap, features });
        }
        patch.set_normal_and_area(axis.n, self.area[k], area_within);
        true
    }
}

struct ClipKernel<'a> {
    of: &'a mut TriangleBatch,
}

impl LaneOperation for ClipKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn call<L: F64Arithmetic>(self, l: L) {
        let ClipKernel { of } = self;
        (of.has, of.clear) = ([0; CORNER_SLOTS], 0);
        let mut from = 0;
        while from < of.count {
            clip_faces(l, of, from);
            from += L::WIDTH;
        }
    }
}

/// Vector in each lane.
type Vec3Lanes<L> = [<L as Arithmetic>::V; 3];

#[inline(always)]
fn load_vector<L: F64Arithmetic>(
    l: L,
    given: &[[f64; BATCH_PAIRS]; INPUT_ROWS],
    at: usize,
    from: usize,
) -> Vec3Lanes<L> {
    [l.load(&given[at][from..]), l.load(&given[at + 1][from..]), l.load(&given[at + 2][from..])]
}

#[inline(always)]
fn dot_lanes<L: F64Arithmetic>(l: L, a: Vec3Lanes<L>, b: Vec3Lanes<L>) -> L::V {
    l.mul_add(a[2], b[2], l.mul_add(a[1], b[1], l.mul(a[0], b[0])))
}

/// Components along three axes.
#[inline(always)]
fn components_along<L: F64Arithmetic>(l: L, axes: &[Vec3Lanes<L>; 3], v: Vec3Lanes<L>) -> Vec3Lanes<L> {
    [dot_lanes(l, axes[0], v), dot_lanes(l, axes[1], v), dot_lanes(l, axes[2], v)]
}

/// Face in the frame t, s, n: three corners, and its plane as height at 0 and slope.
struct ProjectedFace<L: F64Arithmetic> {
    corners: [Vec3Lanes<L>; 3],
    height: L::V,
    slope: [L::V; 2],
    /// Cosine between its normal and the viewing direction.
    rise: L::V,
}

#[inline(always)]
fn projected_face<L: F64Arithmetic>(
    l: L,
    given: &[[f64; BATCH_PAIRS]; INPUT_ROWS],
    side: usize,
    frame: &[Vec3Lanes<L>; 3],
    moved: Vec3Lanes<L>,
    from: usize,
) -> ProjectedFace<L> {
    let turn = [0, 3, 6];
    let columns = [
        load_vector(l, given, TURN_ROWS[side] + turn[0], from),
        load_vector(l, given, TURN_ROWS[side] + turn[1], from),
        load_vector(l, given, TURN_ROWS[side] + turn[2], from),
    ];
    // The frame's axes in the shape's frame.
    let axes = [
        components_along(l, &columns, frame[0]),
        components_along(l, &columns, frame[1]),
        components_along(l, &columns, frame[2]),
    ];
    let mut corners = [moved; 3];
    let mut k = 0;
    while k < 3 {
        let corner = components_along(l, &axes, load_vector(l, given, CORNER_ROWS[side] + 3 * k, from));
        corners[k] = [l.add(corner[0], moved[0]), l.add(corner[1], moved[1]), l.add(corner[2], moved[2])];
        k += 1;
    }
    let normal = components_along(l, &axes, load_vector(l, given, PLANE_ROWS[side], from));
    let offset = l.add(l.load(&given[PLANE_ROWS[side] + 3][from..]), dot_lanes(l, normal, moved));
    let inverse = l.div(l.splat(1.0), normal[2]);
    let slope = [l.mul(normal[0], inverse), l.mul(normal[1], inverse)];
    ProjectedFace { corners, height: l.mul(offset, inverse), slope, rise: normal[2] }
}

/// Distances of the corners of `of` from the sides of `by`, > 0 inside, times the lengths of the sides: [corner][side].
#[inline(always)]
fn side_distances<L: F64Arithmetic>(
    l: L,
    by: &[Vec3Lanes<L>; 3],
    of: &[Vec3Lanes<L>; 3],
    near: L::V,
) -> ([[L::V; 3]; 3], L::V) {
    let zero = l.splat(0.0);
    let mut found = [[zero; 3]; 3];
    // Smallest difference of a squared distance and `near`; a side that is no longer than that counts, too.
    let mut least = l.splat(f64::INFINITY);
    let mut side = 0;
    while side < 3 {
        let (start, end) = (by[side], by[(side + 1) % 3]);
        let (dx, dy) = (l.sub(end[0], start[0]), l.sub(end[1], start[1]));
        let square = l.mul_add(dx, dx, l.mul(dy, dy));
        let bound = l.mul(near, square);
        least = l.min(l.sub(square, near), least);
        let mut corner = 0;
        while corner < 3 {
            let (x, y) = (l.sub(of[corner][0], start[0]), l.sub(of[corner][1], start[1]));
            let distance = l.neg_mul_add(dy, x, l.mul(dx, y));
            least = l.min(l.neg_mul_add(l.splat(1.0), bound, l.mul(distance, distance)), least);
            found[corner][side] = distance;
            corner += 1;
        }
        side += 1;
    }
    (found, least)
}

/// Fraction of the side from corner `from` to corner `to` that lies inside, < 0 for none. `from`, `to`: distances of its
/// ends from three sides; `crossings`: where it crosses these.
#[inline(always)]
fn part_inside<L: F64Arithmetic>(l: L, from: &[L::V; 3], to: &[L::V; 3], crossings: &[L::V; 3]) -> L::V {
    let (mut start, mut end) = (l.splat(0.0), l.splat(1.0));
    let mut side = 0;
    while side < 3 {
        let at = crossings[side];
        let later = l.select_greater(at, start, at, start);
        let sooner = l.min(at, end);
        let enters = (to[side], from[side]);
        start = l.select_greater(enters.0, enters.1, later, start);
        end = l.select_greater(enters.0, enters.1, end, sooner);
        side += 1;
    }
    l.sub(end, start)
}

#[inline(always)]
fn clip_faces<L: F64Arithmetic>(l: L, of: &mut TriangleBatch, from: usize) {
    let given = &of.given;
    let (zero, one, half) = (l.splat(0.0), l.splat(1.0), l.splat(0.5));
    // Same frame as `local_frame`.
    let n = load_vector(l, given, NORMAL_ROW, from);
    let sign = l.select_greater(zero, n[2], l.splat(-1.0), one);
    let p = l.div(l.splat(-1.0), l.add(sign, n[2]));
    let (px, q) = (l.mul(n[0], p), l.mul(l.mul(n[0], n[1]), p));
    let t = [l.mul_add(l.mul(sign, px), n[0], one), l.mul(sign, q), l.sub(zero, l.mul(sign, n[0]))];
    let s = [q, l.mul_add(l.mul(n[1], n[1]), p, sign), l.sub(zero, n[1])];
    let frame = [t, s, n];
    let a = projected_face(l, given, 0, &frame, [zero; 3], from);
    let b =
        projected_face(l, given, 1, &frame, components_along(l, &frame, load_vector(l, given, CENTRE_ROW, from)), from);
    let (separation, near) = (l.load(&given[SEPARATION_ROW][from..]), l.load(&given[NEAR_ROW][from..]));
    let (of_a, least_a) = side_distances(l, &b.corners, &a.corners, near);
    let (of_b, least_b) = side_distances(l, &a.corners, &b.corners, near);
    let edge_on = l.splat(MIN_FACE_COSINE);
    let clear = l.mask_greater(l.min(least_a, least_b), zero)
        & l.mask_greater(l.abs(a.rise), edge_on)
        & l.mask_greater(l.abs(b.rise), edge_on);
    of.clear |= clear << from;
    macro_rules! put {
        ($slot:expr, $x:expr, $y:expr, $z:expr, $gap:expr) => {
            let gap = l.select_greater($gap, separation, $gap, separation);
            let at = &mut of.corners[$slot];
            let mut axis = 0;
            while axis < 3 {
                let point = l.mul_add(t[axis], $x, l.mul_add(s[axis], $y, l.mul(n[axis], $z)));
                l.store(&mut at[axis][from..], point);
                axis += 1;
            }
            l.store(&mut at[3][from..], gap);
            l.store(&mut at[4][from..], $x);
            l.store(&mut at[5][from..], $y);
        };
    }
    // Lanes in which corners lie inside sides, [corner][side].
    let (mut in_b, mut in_a) = ([[0; 3]; 3], [[0; 3]; 3]);
    let mut k = 0;
    while k < 3 {
        let mut side = 0;
        while side < 3 {
            in_b[k][side] = l.mask_greater(of_a[k][side], zero);
            in_a[k][side] = l.mask_greater(of_b[k][side], zero);
            side += 1;
        }
        let [x, y, z] = a.corners[k];
        let height = l.neg_mul_add(b.slope[0], x, l.neg_mul_add(b.slope[1], y, b.height));
        let gap = l.sub(height, z);
        put!(k, x, y, l.mul_add(half, gap, z), gap);
        of.has[k] |= (in_b[k][0] & in_b[k][1] & in_b[k][2]) << from;
        let [x, y, z] = b.corners[k];
        let height = l.neg_mul_add(a.slope[0], x, l.neg_mul_add(a.slope[1], y, a.height));
        let gap = l.sub(z, height);
        put!(3 + k, x, y, l.neg_mul_add(half, gap, z), gap);
        of.has[3 + k] |= (in_a[k][0] & in_a[k][1] & in_a[k][2]) << from;
        k += 1;
    }
    // Positions of the crossings of side i of A with side j of B, along each: [i][j], [j][i].
    let (mut on_a, mut on_b) = ([[zero; 3]; 3], [[zero; 3]; 3]);
    let mut i = 0;
    while i < 3 {
        let next_i = (i + 1) % 3;
        let mut j = 0;
        while j < 3 {
            let next_j = (j + 1) % 3;
            let p = l.div(of_a[i][j], l.sub(of_a[i][j], of_a[next_i][j]));
            let q = l.div(of_b[j][i], l.sub(of_b[j][i], of_b[next_j][i]));
            (on_a[i][j], on_b[j][i]) = (p, q);
            let mut middle = [zero; 3];
            let mut gap = zero;
            let mut axis = 0;
            while axis < 3 {
                let u = l.mul_add(p, l.sub(a.corners[next_i][axis], a.corners[i][axis]), a.corners[i][axis]);
                let v = l.mul_add(q, l.sub(b.corners[next_j][axis], b.corners[j][axis]), b.corners[j][axis]);
                middle[axis] = l.mul(half, l.add(u, v));
                gap = l.sub(v, u);
                axis += 1;
            }
            let slot = 6 + 3 * i + j;
            put!(slot, middle[0], middle[1], middle[2], gap);
            of.has[slot] |= ((in_b[i][j] ^ in_b[next_i][j]) & (in_a[j][i] ^ in_a[next_j][i])) << from;
            j += 1;
        }
        i += 1;
    }
    // Twice the area: for each side of either triangle the part inside the other, times its moment about the first corner
    // of A, through which two sides of A pass.
    let [a0, a1, a2] = a.corners;
    let (x1, y1, x2, y2) = (l.sub(a1[0], a0[0]), l.sub(a1[1], a0[1]), l.sub(a2[0], a0[0]), l.sub(a2[1], a0[1]));
    let moment = l.neg_mul_add(y1, x2, l.mul(x1, y2));
    let inside = part_inside(l, &of_a[1], &of_a[2], &on_a[1]);
    let mut doubled = l.select_greater(inside, zero, l.mul(inside, moment), zero);
    let mut j = 0;
    while j < 3 {
        let inside = part_inside(l, &of_b[j], &of_b[(j + 1) % 3], &on_b[j]);
        let more = l.mul_add(inside, of_a[0][j], doubled);
        doubled = l.select_greater(inside, zero, more, doubled);
        j += 1;
    }
    l.store(&mut of.area[from..], l.select_greater(doubled, zero, l.mul(half, doubled), zero));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::polyhedra::tests::each_pair;
    use crate::geometry::search::{SearchResult, SearchStart, separating_axis};
    use crate::geometry::{ContactPoint, ListingRange, NarrowPhaseMode};
    use crate::math::Quat;

    fn points(patch: &mut ContactPatch, tie: f64) -> (Vec<ContactPoint>, f64) {
        let mut manifold = crate::geometry::Manifold::default();
        patch.write_manifold(ListingRange::from(f64::INFINITY), tie, &mut manifold);
        (manifold.points.to_vec(), manifold.area)
    }

    #[test]
    fn patches_are_those_of_outlines() {
        let (mut compared, mut many, mut triangles) = (0, [0; 7], TriangleBatch::new());
        each_pair(1500, 0.3, |_, pair, &SearchResult { ref axis, faces, .. }| {
            if triangles.push_faces(pair, axis, faces).is_none() {
                return;
            }
            triangles.clip_faces(pair.width);
            let (mut found, mut expected) = (ContactPatch::default(), ContactPatch::default());
            for within in [f64::INFINITY, axis.s + 0.05] {
                assert!(triangles.write_patch(0, axis, within, &mut found), "no corner is near a side");
                expected.clip_faces(pair, axis, faces, within);
                let ((found, area), (expected, area_expected)) =
                    (points(&mut found, pair.tie_tolerance()), points(&mut expected, pair.tie_tolerance()));
                assert!((area - area_expected).abs() < 1e-14, "{area} {area_expected}");
                assert_eq!(found.len(), expected.len());
                for (found, expected) in found.iter().zip(&expected) {
                    assert_eq!(found.features, expected.features);
                    // The crossing of sides that nearly coincide is less accurate.
                    assert!((found.position - expected.position).norm() < 1e-11, "{found:?} {expected:?}");
                    assert!((found.gap - expected.gap).abs() < 1e-12, "{found:?} {expected:?}");
                }
                many[found.len()] += 1;
                compared += 1;
            }
            triangles.clear();
        });
        assert!(compared > 500 && many[3..].iter().all(|&count| count > 100), "{compared} {many:?}");
    }

    #[test]
    fn pairs_do_not_depend_on_their_places_or_the_width() {
        let mut alone = Vec::new();
        each_pair(1500, 0.3, |_, pair, &SearchResult { ref axis, faces, .. }| {
            let mut triangles = TriangleBatch::new();
            if triangles.push_faces(pair, axis, faces).is_some() {
                triangles.clip_faces(SimdWidth::One(crate::math::simd::Scalar));
                let mut patch = ContactPatch::default();
                assert!(triangles.write_patch(0, axis, f64::INFINITY, &mut patch));
                alone.push(points(&mut patch, pair.tie_tolerance()));
            }
        });
        for width in SimdWidth::all_widths() {
            let (mut triangles, mut axes, mut next) = (TriangleBatch::new(), Vec::new(), 0);
            each_pair(1500, 0.3, |_, pair, &SearchResult { ref axis, faces, .. }| {
                if triangles.push_faces(pair, axis, faces).is_none() {
                    return;
                }
                axes.push((*axis, pair.tie_tolerance()));
                if triangles.is_full() {
                    triangles.clip_faces(width);
                    for (k, (axis, tie)) in axes.drain(..).enumerate() {
                        let mut patch = ContactPatch::default();
                        triangles.write_patch(k, &axis, f64::INFINITY, &mut patch);
                        assert_eq!(points(&mut patch, tie), alone[next], "{next}");
                        next += 1;
                    }
                    triangles.clear();
                }
            });
            assert!(next > 400, "{next}");
        }
    }

    #[test]
    fn corners_on_sides_are_left_to_outlines() {
        let vertices = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.5]].map(Vec3::from);
        let middle = vertices.iter().sum::<Vec3>() / 4.0;
        let tetrahedron = crate::geometry::Polyhedron::new(
            &vertices.map(|v| v - middle),
            &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
        )
        .unwrap();
        let below = tetrahedron.posed_by(&Quat::from_scaled_axis(Vec3::x() * std::f64::consts::PI));
        let above = tetrahedron.posed_by(&Quat::identity());
        // First corner on corner, then shifted along a side, then clear of all.
        for (shift, clear) in [([0.0, 0.0], false), ([0.3, 0.0], false), ([0.3, 0.2], true)] {
            let turned = below.world_vector(&vertices[2]) - below.world_vector(&middle);
            let c = Vec3::new(shift[0], shift[1] + turned.y - (vertices[0] - middle).y, 2.0 * middle.z - 0.01);
            let pair = PolyhedronPair::new(&below, &above, c, SimdWidth::detect());
            let axis = separating_axis(&pair, SearchStart::Nothing, None, NarrowPhaseMode::Accurate, 0.3.into());
            let (mut triangles, mut patch) = (TriangleBatch::new(), ContactPatch::default());
            assert_eq!(triangles.push_faces(&pair, &axis.axis, axis.faces), Some(0));
            triangles.clip_faces(pair.width);
            assert_eq!(triangles.write_patch(0, &axis.axis, f64::INFINITY, &mut patch), clear, "{shift:?}");
        }
    }
}
