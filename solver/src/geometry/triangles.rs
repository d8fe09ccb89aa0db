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

/// Ratio of the distance from a side to that up to which two corners count as one, below which `outline` decides.
const MIN_SIDE_CLEARANCE: f64 = 4.0;
/// Number of candidates for corners of the common part: vertices of A, of B, crossings of side i of A with side j of B at
/// 6 + 3 i + j.
const CORNER_SLOTS: usize = 15;

// First rows of the data in the input of a pair; vectors take three rows, x, y and z.

/// Rotation of A and of B, body to world, by columns.
const TURN_ROWS: [usize; 2] = [0, 9];
/// Position of B's centre relative to A's, m.
const CENTRE_ROW: usize = 18;
/// Normal, along which the faces are seen.
const NORMAL_ROW: usize = 21;
/// Three corners of the face of A and of B, in the body's frame (m), counter-clockwise seen along the normal.
const CORNER_ROWS: [usize; 2] = [24, 33];
/// Plane of the face of A and of B in the body's frame: normal, and distance from the centre, m.
const PLANE_ROWS: [usize; 2] = [42, 46];
/// Separation along the normal, m.
const SEPARATION_ROW: usize = 50;
/// Square of the distance within which `outline` decides, m².
const NEAR_ROW: usize = 51;
/// Number of rows.
const INPUT_ROWS: usize = 52;

// First rows of the data of a corner.

/// Point in the middle of the gap, x, y and z, m.
const POINT_ROW: usize = 0;
/// Gap, m.
const GAP_ROW: usize = 3;
/// Coordinates seen along the normal, two rows, m.
const FLAT_ROW: usize = 4;
/// Number of rows.
const OUTPUT_ROWS: usize = 6;

/// Pairs per batch.
pub(super) const BATCH_PAIRS: usize = 8;

/// Pairs whose faces are triangles.
pub(super) struct TriangleBatch {
    /// Rows of the data of the pairs, from [`TURN_ROWS`] to [`INPUT_ROWS`]; lane k of a row is pair k.
    input: [[f64; BATCH_PAIRS]; INPUT_ROWS],
    /// Features of the two faces of each pair.
    features: [FaceFeatures; BATCH_PAIRS],
    /// Rows [`POINT_ROW`] to [`OUTPUT_ROWS`] of each candidate for a corner.
    corners: [[[f64; BATCH_PAIRS]; OUTPUT_ROWS]; CORNER_SLOTS],
    /// Bit k: whether the common part of pair k has this corner.
    has_corner: [u32; CORNER_SLOTS],
    /// Area of the common part, m².
    area: [f64; BATCH_PAIRS],
    /// Bit k: whether all corners of pair k are so far from the sides that rounding does not decide.
    decided: u32,
    /// Number of pairs.
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
            input: [[0.0; BATCH_PAIRS]; INPUT_ROWS],
            features: [FaceFeatures::default(); BATCH_PAIRS],
            corners: [[[0.0; BATCH_PAIRS]; OUTPUT_ROWS]; CORNER_SLOTS],
            has_corner: [0; CORNER_SLOTS],
            area: [0.0; BATCH_PAIRS],
            decided: 0,
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
        let (corners_a, corners_b) =
            (pair.shape_a.face_corners(faces.0 as usize), pair.shape_b.face_corners(faces.1 as usize));
        let (&[a0, a1, a2], &[b0, b1, b2]) = (corners_a, corners_b) else { return None };
        let (&[u0, u1, u2], &[v0, v1, v2]) =
            (pair.shape_a.face_edges(faces.0 as usize), pair.shape_b.face_edges(faces.1 as usize))
        else {
            return None;
        };
        let k = self.count;
        self.count += 1;
        // The normal of B's face is opposite to the viewing normal: reverse order.
        self.features[k] = FaceFeatures {
            vertices: [[a0, a1, a2], [b2, b1, b0]].map(|indices| indices.map(|v| vertex_feature(v.into()))),
            edges: [[u0, u1, u2], [v1, v0, v2]].map(|indices| indices.map(|e| edge_feature(e.into()))),
            faces: [face_feature(faces.0), face_feature(faces.1)],
        };
        let small = MIN_SIDE_CLEARANCE * SAME_CORNER_DISTANCE * pair.smaller_circumradius;
        self.set_vector(k, CENTRE_ROW, &pair.centre_offset);
        self.set_vector(k, NORMAL_ROW, &axis.n);
        self.input[SEPARATION_ROW][k] = axis.s;
        self.input[NEAR_ROW][k] = small * small;
        self.set_face(k, 0, pair.posed_a, [a0, a1, a2].map(usize::from), faces.0);
        self.set_face(k, 1, pair.posed_b, [b2, b1, b0].map(usize::from), faces.1);
        Some(k)
    }

    #[inline(always)]
    fn set_vector(&mut self, k: usize, row: usize, v: &Vec3) {
        self.input[row][k] = v.x;
        self.input[row + 1][k] = v.y;
        self.input[row + 2][k] = v.z;
    }

    #[inline(always)]
    fn set_face(&mut self, k: usize, side: usize, posed: &PosedPolyhedron, corners: [usize; 3], face: u32) {
        for (column, turn) in posed.turn.as_slice().iter().enumerate() {
            self.input[TURN_ROWS[side] + column][k] = *turn;
        }
        for (corner, &v) in corners.iter().enumerate() {
            self.set_vector(k, CORNER_ROWS[side] + 3 * corner, &posed.shape.vertex(v));
        }
        let plane = &posed.shape.face_planes()[face as usize];
        self.set_vector(k, PLANE_ROWS[side], &plane.normal);
        self.input[PLANE_ROWS[side] + 3][k] = plane.offset;
    }

    /// Computes the common parts of the pairs that have been added.
    pub fn clip_faces(&mut self, width: SimdWidth) {
        width.run(ClipKernel { batch: self })
    }

    /// Empties the batch.
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Writes the patch of pair `k` along `axis`, as [`ContactPatch::clip_faces`]; returns false if rounding would decide
    /// about a corner.
    #[inline(always)]
    pub fn write_patch(&self, k: usize, axis: &SearchAxis, area_within: f64, patch: &mut ContactPatch) -> bool {
        if self.decided >> k & 1 == 0 {
            return false;
        }
        patch.corners.clear();
        let mut has_corner = 0;
        for slot in 0..CORNER_SLOTS {
            has_corner |= (self.has_corner[slot] >> k & 1) << slot;
        }
        let own = &self.features[k];
        while has_corner != 0 {
            let slot = has_corner.trailing_zeros() as usize % 16;
            has_corner &= has_corner - 1;
            let rows = &self.corners[slot];
            let point = [rows[POINT_ROW][k], rows[POINT_ROW + 1][k], rows[POINT_ROW + 2][k]];
            let (gap, flat) = (rows[GAP_ROW][k], [rows[FLAT_ROW][k], rows[FLAT_ROW + 1][k]]);
            let features = match slot {
                0..3 => (own.vertices[0][slot], own.faces[1]),
                3..6 => (own.faces[0], own.vertices[1][slot - 3]),
                _ => (own.edges[0][(slot - 6) / 3], own.edges[1][(slot - 6) % 3]),
            };
            patch.corners.push(PatchCorner { point, flat, gap, features });
        }
        patch.set_normal_and_area(axis.n, self.area[k], area_within);
        true
    }
}

/// Operation that clips the triangles of a batch.
struct ClipKernel<'a> {
    batch: &'a mut TriangleBatch,
}

impl LaneOperation for ClipKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn call<L: F64Arithmetic>(self, l: L) {
        let ClipKernel { batch } = self;
        (batch.has_corner, batch.decided) = ([0; CORNER_SLOTS], 0);
        let mut from = 0;
        while from < batch.count {
            clip_faces(l, batch, from);
            from += L::WIDTH;
        }
    }
}

/// Vector in each lane.
type Vec3Lanes<L> = [<L as Arithmetic>::V; 3];

#[inline(always)]
fn load_vector<L: F64Arithmetic>(
    l: L,
    input: &[[f64; BATCH_PAIRS]; INPUT_ROWS],
    row: usize,
    from: usize,
) -> Vec3Lanes<L> {
    [l.load(&input[row][from..]), l.load(&input[row + 1][from..]), l.load(&input[row + 2][from..])]
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

/// Face in the frame t, s, n.
struct ProjectedFace<L: F64Arithmetic> {
    corners: [Vec3Lanes<L>; 3],
    /// Height of its plane at (0, 0), m.
    height: L::V,
    /// Slope of its plane: at (x, y) its height is height - slope·(x, y).
    slope: [L::V; 2],
    /// Cosine between its normal and the viewing direction.
    rise: L::V,
}

#[inline(always)]
fn projected_face<L: F64Arithmetic>(
    l: L,
    input: &[[f64; BATCH_PAIRS]; INPUT_ROWS],
    side: usize,
    frame: &[Vec3Lanes<L>; 3],
    centre: Vec3Lanes<L>,
    from: usize,
) -> ProjectedFace<L> {
    let columns = [
        load_vector(l, input, TURN_ROWS[side], from),
        load_vector(l, input, TURN_ROWS[side] + 3, from),
        load_vector(l, input, TURN_ROWS[side] + 6, from),
    ];
    // The frame's axes in the shape's frame.
    let axes = [
        components_along(l, &columns, frame[0]),
        components_along(l, &columns, frame[1]),
        components_along(l, &columns, frame[2]),
    ];
    let mut corners = [centre; 3];
    let mut k = 0;
    while k < 3 {
        let corner = components_along(l, &axes, load_vector(l, input, CORNER_ROWS[side] + 3 * k, from));
        corners[k] = [l.add(corner[0], centre[0]), l.add(corner[1], centre[1]), l.add(corner[2], centre[2])];
        k += 1;
    }
    let normal = components_along(l, &axes, load_vector(l, input, PLANE_ROWS[side], from));
    let offset = l.add(l.load(&input[PLANE_ROWS[side] + 3][from..]), dot_lanes(l, normal, centre));
    let inverse_rise = l.div(l.splat(1.0), normal[2]);
    let slope = [l.mul(normal[0], inverse_rise), l.mul(normal[1], inverse_rise)];
    ProjectedFace { corners, height: l.mul(offset, inverse_rise), slope, rise: normal[2] }
}

/// Distances of the corners of a triangle from the sides of another one.
struct SideDistances<L: F64Arithmetic> {
    /// Distance of each corner from each side, > 0 inside, times the length of the side: [corner][side], m².
    distances: [[L::V; 3]; 3],
    /// > 0 if no corner is as near to the line of a side as rounding matters, and no side is that short.
    clearance: L::V,
}

/// Distances of the `corners` of a triangle from the sides of the triangle `outline`; `rounding_distance2`: square of the distance
/// within which rounding matters, m².
#[inline(always)]
fn side_distances<L: F64Arithmetic>(
    l: L,
    outline: &[Vec3Lanes<L>; 3],
    corners: &[Vec3Lanes<L>; 3],
    rounding_distance2: L::V,
) -> SideDistances<L> {
    let zero = l.splat(0.0);
    let mut distances = [[zero; 3]; 3];
    let mut clearance = l.splat(f64::INFINITY);
    let mut side = 0;
    while side < 3 {
        let (start, end) = (outline[side], outline[(side + 1) % 3]);
        let (dx, dy) = (l.sub(end[0], start[0]), l.sub(end[1], start[1]));
        let square = l.mul_add(dx, dx, l.mul(dy, dy));
        let bound = l.mul(rounding_distance2, square);
        clearance = l.min(l.sub(square, rounding_distance2), clearance);
        let mut corner = 0;
        while corner < 3 {
            let (x, y) = (l.sub(corners[corner][0], start[0]), l.sub(corners[corner][1], start[1]));
            let distance = l.neg_mul_add(dy, x, l.mul(dx, y));
            clearance = l.min(l.neg_mul_add(l.splat(1.0), bound, l.mul(distance, distance)), clearance);
            distances[corner][side] = distance;
            corner += 1;
        }
        side += 1;
    }
    SideDistances { distances, clearance }
}

/// Fraction of a side that lies inside the other triangle, < 0 for none. `from`, `to`: distances of its ends from the
/// three sides of that triangle; `crossings`: its fractions at which it crosses the lines of these.
#[inline(always)]
fn share_inside<L: F64Arithmetic>(l: L, from: &[L::V; 3], to: &[L::V; 3], crossings: &[L::V; 3]) -> L::V {
    let (mut start, mut end) = (l.splat(0.0), l.splat(1.0));
    let mut side = 0;
    while side < 3 {
        let crossing = crossings[side];
        let later = l.select_greater(crossing, start, crossing, start);
        let sooner = l.min(crossing, end);
        // A side of which the distance grows is entered, any other is left.
        start = l.select_greater(to[side], from[side], later, start);
        end = l.select_greater(to[side], from[side], end, sooner);
        side += 1;
    }
    l.sub(end, start)
}

#[inline(always)]
fn clip_faces<L: F64Arithmetic>(l: L, batch: &mut TriangleBatch, from: usize) {
    let input = &batch.input;
    let (zero, one, half) = (l.splat(0.0), l.splat(1.0), l.splat(0.5));
    // Same frame as `local_frame`.
    let n = load_vector(l, input, NORMAL_ROW, from);
    let sign = l.select_greater(zero, n[2], l.splat(-1.0), one);
    let p = l.div(l.splat(-1.0), l.add(sign, n[2]));
    let (px, q) = (l.mul(n[0], p), l.mul(l.mul(n[0], n[1]), p));
    let t = [l.mul_add(l.mul(sign, px), n[0], one), l.mul(sign, q), l.sub(zero, l.mul(sign, n[0]))];
    let s = [q, l.mul_add(l.mul(n[1], n[1]), p, sign), l.sub(zero, n[1])];
    let frame = [t, s, n];
    let a = projected_face(l, input, 0, &frame, [zero; 3], from);
    let b =
        projected_face(l, input, 1, &frame, components_along(l, &frame, load_vector(l, input, CENTRE_ROW, from)), from);
    let (separation, near) = (l.load(&input[SEPARATION_ROW][from..]), l.load(&input[NEAR_ROW][from..]));
    let SideDistances { distances: distances_a, clearance: clearance_a } =
        side_distances(l, &b.corners, &a.corners, near);
    let SideDistances { distances: distances_b, clearance: clearance_b } =
        side_distances(l, &a.corners, &b.corners, near);
    let edge_on = l.splat(MIN_FACE_COSINE);
    let decided = l.mask_greater(l.min(clearance_a, clearance_b), zero)
        & l.mask_greater(l.abs(a.rise), edge_on)
        & l.mask_greater(l.abs(b.rise), edge_on);
    batch.decided |= decided << from;
    macro_rules! store_corner {
        ($slot:expr, $x:expr, $y:expr, $z:expr, $gap:expr) => {
            let gap = l.select_greater($gap, separation, $gap, separation);
            let rows = &mut batch.corners[$slot];
            let mut axis = 0;
            while axis < 3 {
                let point = l.mul_add(t[axis], $x, l.mul_add(s[axis], $y, l.mul(n[axis], $z)));
                l.store(&mut rows[POINT_ROW + axis][from..], point);
                axis += 1;
            }
            l.store(&mut rows[GAP_ROW][from..], gap);
            l.store(&mut rows[FLAT_ROW][from..], $x);
            l.store(&mut rows[FLAT_ROW + 1][from..], $y);
        };
    }
    // Lanes in which corners lie inside sides, [corner][side].
    let (mut in_b, mut in_a) = ([[0; 3]; 3], [[0; 3]; 3]);
    let mut k = 0;
    while k < 3 {
        let mut side = 0;
        while side < 3 {
            in_b[k][side] = l.mask_greater(distances_a[k][side], zero);
            in_a[k][side] = l.mask_greater(distances_b[k][side], zero);
            side += 1;
        }
        let [x, y, z] = a.corners[k];
        let height = l.neg_mul_add(b.slope[0], x, l.neg_mul_add(b.slope[1], y, b.height));
        let gap = l.sub(height, z);
        store_corner!(k, x, y, l.mul_add(half, gap, z), gap);
        batch.has_corner[k] |= (in_b[k][0] & in_b[k][1] & in_b[k][2]) << from;
        let [x, y, z] = b.corners[k];
        let height = l.neg_mul_add(a.slope[0], x, l.neg_mul_add(a.slope[1], y, a.height));
        let gap = l.sub(z, height);
        store_corner!(3 + k, x, y, l.neg_mul_add(half, gap, z), gap);
        batch.has_corner[3 + k] |= (in_a[k][0] & in_a[k][1] & in_a[k][2]) << from;
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
            let p = l.div(distances_a[i][j], l.sub(distances_a[i][j], distances_a[next_i][j]));
            let q = l.div(distances_b[j][i], l.sub(distances_b[j][i], distances_b[next_j][i]));
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
            store_corner!(slot, middle[0], middle[1], middle[2], gap);
            batch.has_corner[slot] |= ((in_b[i][j] ^ in_b[next_i][j]) & (in_a[j][i] ^ in_a[next_j][i])) << from;
            j += 1;
        }
        i += 1;
    }
    // Twice the area: for each side of either triangle the part inside the other, times its moment about the first corner
    // of A, through which two sides of A pass.
    let [a0, a1, a2] = a.corners;
    let (x1, y1, x2, y2) = (l.sub(a1[0], a0[0]), l.sub(a1[1], a0[1]), l.sub(a2[0], a0[0]), l.sub(a2[1], a0[1]));
    let moment = l.neg_mul_add(y1, x2, l.mul(x1, y2));
    let inside = share_inside(l, &distances_a[1], &distances_a[2], &on_a[1]);
    let mut doubled = l.select_greater(inside, zero, l.mul(inside, moment), zero);
    let mut j = 0;
    while j < 3 {
        let inside = share_inside(l, &distances_b[j], &distances_b[(j + 1) % 3], &on_b[j]);
        let sum = l.mul_add(inside, distances_a[0][j], doubled);
        doubled = l.select_greater(inside, zero, sum, doubled);
        j += 1;
    }
    l.store(&mut batch.area[from..], l.select_greater(doubled, zero, l.mul(half, doubled), zero));
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
        for (shift, decided) in [([0.0, 0.0], false), ([0.3, 0.0], false), ([0.3, 0.2], true)] {
            let turned = below.world_vector(&vertices[2]) - below.world_vector(&middle);
            let c = Vec3::new(shift[0], shift[1] + turned.y - (vertices[0] - middle).y, 2.0 * middle.z - 0.01);
            let pair = PolyhedronPair::new(&below, &above, c, SimdWidth::detect());
            let axis = separating_axis(&pair, SearchStart::Nothing, None, NarrowPhaseMode::Accurate, 0.3.into());
            let (mut triangles, mut patch) = (TriangleBatch::new(), ContactPatch::default());
            assert_eq!(triangles.push_faces(&pair, &axis.axis, axis.faces), Some(0));
            triangles.clip_faces(pair.width);
            assert_eq!(triangles.write_patch(0, &axis.axis, f64::INFINITY, &mut patch), decided, "{shift:?}");
        }
    }
}
