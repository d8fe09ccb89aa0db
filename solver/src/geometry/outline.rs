//! Common part of two faces seen along a normal: its corners with their gaps.
//!
//! A corner is a vertex of either polygon that lies in the other, or a crossing of two sides. Several candidates are
//! tested at once, so that the program branches only at corners.

use super::manifold::{edge_feature, face_feature, vertex_feature};
use super::pair::{MIN_FACE_COSINE, PatchCorner, PatchCorners, PolyhedronPair};
use super::polyhedron::PosedPolyhedron;
use super::polyhedron::{COLUMN_PAD, FeatureIndex};
use crate::math::simd::{F64Arithmetic, LaneOperation};
use crate::math::{Vec3, local_frame};

/// Columns of an outline: x, y and height of the corners, and the unit direction of the side from each to the next.
const OUTLINE_COLUMNS: usize = 5;

/// Adds the corners of the common part of the two `faces`, seen along `n` from A to B.
///
/// `tiny`: distance up to which a corner is on a side, m.
pub(super) fn collect_common_corners(
    pair: &PolyhedronPair,
    n: &Vec3,
    faces: (u32, u32),
    tiny: f64,
    found: &mut PatchCorners,
) {
    let counts = [pair.shape_a.face_corners(faces.0 as usize).len(), pair.shape_b.face_corners(faces.1 as usize).len()];
    // The first corner is repeated after the last; vectors that start at the last may read beyond it.
    let strides = counts.map(|count| count.next_multiple_of(COLUMN_PAD) + COLUMN_PAD);
    // On the stack, except for faces with many corners.
    let (mut stack_storage, mut heap_storage) = ([0.0; 4 * OUTLINE_COLUMNS * COLUMN_PAD], Vec::new());
    let storage_len = OUTLINE_COLUMNS * (strides[0] + strides[1]);
    let storage = if storage_len <= stack_storage.len() {
        &mut stack_storage[..]
    } else {
        heap_storage.resize(storage_len, 0.0);
        &mut heap_storage[..]
    };
    pair.width.run(CommonCorners { pair, n, faces, counts, strides, tiny, storage, found })
}

/// Outline of a face seen along the normal, counter-clockwise.
struct FaceOutline<'a> {
    posed: &'a PosedPolyhedron<'a>,
    /// Vertices and edges of the face, in the shape's order.
    corners: &'a [FeatureIndex],
    sides: &'a [FeatureIndex],
    /// Position of the body's centre relative to A's centre, m.
    centre: Vec3,
    /// Whether the face's normal is opposite to the viewing normal; then corners and sides are in reverse order.
    is_reversed: bool,
    /// Coordinates of the corners across the viewing normal, and their heights along it, m; the first corner follows the
    /// last.
    x: &'a mut [f64],
    y: &'a mut [f64],
    z: &'a mut [f64],
    /// Directions of the sides; zero for a side seen end on.
    dx: &'a mut [f64],
    dy: &'a mut [f64],
    /// Height of the face's plane at (0, 0), m, and its slope: at (x, y) the height is height - slope·(x, y).
    height: f64,
    slope: [f64; 2],
}

impl<'a> FaceOutline<'a> {
    /// Outline of a face of a body whose centre is at `centre`, in `storage` of [`OUTLINE_COLUMNS`] columns of `stride`
    /// numbers.
    #[inline(always)]
    fn new(
        posed: &'a PosedPolyhedron,
        face: u32,
        centre: Vec3,
        is_reversed: bool,
        stride: usize,
        storage: &'a mut [f64],
    ) -> Self {
        let (corners, sides) = (posed.shape.face_corners(face as usize), posed.shape.face_edges(face as usize));
        let (x, rest) = storage.split_at_mut(stride);
        let (y, rest) = rest.split_at_mut(stride);
        let (z, rest) = rest.split_at_mut(stride);
        let (dx, dy) = rest.split_at_mut(stride);
        FaceOutline { posed, corners, sides, centre, is_reversed, x, y, z, dx, dy, height: 0.0, slope: [0.0; 2] }
    }

    /// Vertex of corner `k`, counter-clockwise as seen.
    #[inline(always)]
    fn vertex(&self, k: usize) -> u32 {
        self.corners[if self.is_reversed { self.corners.len() - 1 - k } else { k }].into()
    }

    /// Edge from corner `k` to the next.
    #[inline(always)]
    fn edge(&self, k: usize) -> u32 {
        let count = self.sides.len();
        let k = match self.is_reversed {
            true if k + 1 == count => k,
            true => count - 2 - k,
            false => k,
        };
        self.sides[k].into()
    }

    #[inline(always)]
    fn next_corner(&self, k: usize) -> usize {
        if k + 1 == self.corners.len() { 0 } else { k + 1 }
    }

    /// Position of corner `k` relative to A's centre, world frame, m.
    #[inline(always)]
    fn corner_position(&self, k: usize) -> Vec3 {
        self.posed.vertex(self.vertex(k)) + self.centre
    }

    /// Projects the corners, and computes the plane through them.
    #[inline(always)]
    fn project_corners(&mut self, face: u32, [n, t, s]: &[Vec3; 3]) {
        let count = self.corners.len();
        let mut k = 0;
        while k < count {
            let at = self.corner_position(k);
            (self.x[k], self.y[k], self.z[k]) = (at.dot(t), at.dot(s), at.dot(n));
            k += 1;
        }
        (self.x[count], self.y[count], self.z[count]) = (self.x[0], self.y[0], self.z[0]);
        let normal = self.posed.face_normal(face);
        let rise = normal.dot(n);
        if rise.abs() < MIN_FACE_COSINE {
            // A face seen as a line: level, at the height that is nearest to the other body.
            let mut height = self.z[0];
            for &z in &self.z[1..count] {
                height = if self.is_reversed { height.min(z) } else { height.max(z) };
            }
            self.height = height;
            return;
        }
        self.slope = [normal.dot(t) / rise, normal.dot(s) / rise];
        self.height = (self.posed.shape.face_planes()[face as usize].offset + normal.dot(&self.centre)) / rise;
    }

    /// Computes the directions of the sides. Not called directly after [`Self::project_corners`]: vector loads would wait
    /// for the scalar stores.
    #[inline(always)]
    fn compute_side_directions<L: F64Arithmetic>(&mut self, l: L, tiny: f64) {
        let count = self.corners.len();
        let mut k = 0;
        while k < count {
            let dx = l.sub(l.load(&self.x[k + 1..]), l.load(&self.x[k..]));
            let dy = l.sub(l.load(&self.y[k + 1..]), l.load(&self.y[k..]));
            let length = l.sqrt(l.add(l.mul(dx, dx), l.mul(dy, dy)));
            let (tiny, zero) = (l.splat(tiny), l.splat(0.0));
            l.store(&mut self.dx[k..], l.select_greater(length, tiny, l.div(dx, length), zero));
            l.store(&mut self.dy[k..], l.select_greater(length, tiny, l.div(dy, length), zero));
            k += L::WIDTH;
        }
    }

    /// Height of the plane at a point.
    #[inline(always)]
    fn plane_height(&self, x: f64, y: f64) -> f64 {
        self.height - (self.slope[0] * x + self.slope[1] * y)
    }

    /// Distance of points from side `k`, positive inside.
    #[inline(always)]
    fn side_distance<L: F64Arithmetic>(&self, l: L, k: usize, x: L::V, y: L::V) -> L::V {
        let along = l.mul(l.splat(self.dx[k]), l.sub(y, l.splat(self.y[k])));
        l.sub(along, l.mul(l.splat(self.dy[k]), l.sub(x, l.splat(self.x[k]))))
    }

    /// Lanes of the corners of `other` from `k` on that lie in this outline, and of those that are on a side of it.
    #[inline(always)]
    fn corners_inside<L: F64Arithmetic>(&self, l: L, other: &FaceOutline, k: usize, tiny: f64) -> (u32, u32) {
        let (x, y) = (l.load(&other.x[k..]), l.load(&other.y[k..]));
        let (mut inside, mut on_side) = (lane_mask::<L>(k, other.corners.len()), 0);
        let mut side = 0;
        while side < self.sides.len() {
            // A side seen end on bounds nothing.
            if self.dx[side] != 0.0 || self.dy[side] != 0.0 {
                let distance = self.side_distance(l, side, x, y);
                inside &= l.mask_greater(distance, l.splat(-tiny));
                on_side |= !l.mask_greater(distance, l.splat(tiny));
            }
            side += 1;
        }
        (inside, on_side & inside)
    }

    /// Height at a corner of `other` that is on a side, limited by the height of the side: next to a very sharp ridge the
    /// plane falls away within rounding. `sign`: 1 for the smallest height, -1 for the largest.
    #[inline(always)]
    fn side_height(&self, x: f64, y: f64, sign: f64, plane: f64, tiny: f64) -> f64 {
        let mut height = plane;
        let mut k = 0;
        while k < self.sides.len() {
            let (dx, dy) = (self.dx[k], self.dy[k]);
            let distance = dx * (y - self.y[k]) - dy * (x - self.x[k]);
            if (dx != 0.0 || dy != 0.0) && distance <= tiny {
                let length = (self.x[k + 1] - self.x[k]) * dx + (self.y[k + 1] - self.y[k]) * dy;
                let share = ((x - self.x[k]) * dx + (y - self.y[k]) * dy) / length;
                let height_of_side = self.z[k] + (self.z[k + 1] - self.z[k]) * share.clamp(0.0, 1.0);
                height = if sign * height_of_side < sign * height { height_of_side } else { height };
            }
            k += 1;
        }
        height
    }
}

/// Mask of the lanes from `k` on that are below `count`.
#[inline(always)]
fn lane_mask<L: F64Arithmetic>(k: usize, count: usize) -> u32 {
    (1 << L::WIDTH.min(count - k)) - 1
}

/// Search for the corners of the common part of two faces seen along `n`.
struct CommonCorners<'a> {
    pair: &'a PolyhedronPair<'a>,
    n: &'a Vec3,
    faces: (u32, u32),
    counts: [usize; 2],
    strides: [usize; 2],
    tiny: f64,
    storage: &'a mut [f64],
    found: &'a mut PatchCorners,
}

impl LaneOperation for CommonCorners<'_> {
    type Output = ();

    #[inline(always)]
    fn call<L: F64Arithmetic>(self, l: L) {
        let CommonCorners { pair, n, faces, counts: [count_a, count_b], strides, tiny, storage, found } = self;
        let frame = local_frame(*n);
        let (storage_a, storage_b) = storage.split_at_mut(OUTLINE_COLUMNS * strides[0]);
        let mut a = FaceOutline::new(pair.posed_a, faces.0, Vec3::zeros(), false, strides[0], storage_a);
        let mut b = FaceOutline::new(
            pair.posed_b,
            faces.1,
            pair.centre_offset,
            true,
            strides[1],
            &mut storage_b[..OUTLINE_COLUMNS * strides[1]],
        );
        a.project_corners(faces.0, &frame);
        b.project_corners(faces.1, &frame);
        a.compute_side_directions(l, tiny);
        b.compute_side_directions(l, tiny);
        let first = found.len();
        let mut from = 0;
        while from < count_a {
            let (mut inside, on_side) = b.corners_inside(l, &a, from, tiny);
            while inside != 0 {
                let lane = inside.trailing_zeros() as usize;
                inside &= inside - 1;
                let k = from + lane;
                let (x, y, z) = (a.x[k], a.y[k], a.z[k]);
                let mut height = b.plane_height(x, y);
                if on_side >> lane & 1 != 0 {
                    height = b.side_height(x, y, 1.0, height, tiny);
                }
                let gap = height - z;
                let point = a.corner_position(k) + n * (0.5 * gap);
                let features = (vertex_feature(a.vertex(k)), face_feature(faces.1));
                found.push(PatchCorner { point: point.into(), flat: [x, y], gap, features });
            }
            from += L::WIDTH;
        }
        let end_of_a = found.len();
        let mut from = 0;
        while from < count_b {
            let (mut inside, on_side) = a.corners_inside(l, &b, from, tiny);
            while inside != 0 {
                let lane = inside.trailing_zeros() as usize;
                inside &= inside - 1;
                let k = from + lane;
                let (x, y, z) = (b.x[k], b.y[k], b.z[k]);
                let mut same = first;
                while same < end_of_a && !found[same].is_near([x, y], pair.smaller_circumradius) {
                    same += 1;
                }
                if same < end_of_a {
                    // Two vertices coincide: each keeps its own height.
                    let same = &mut found[same];
                    let gap = z - (Vec3::from(same.point).dot(n) - 0.5 * same.gap);
                    same.point = (Vec3::from(same.point) + n * (0.5 * (gap - same.gap))).into();
                    (same.gap, same.features.1) = (gap, vertex_feature(b.vertex(k)));
                    continue;
                }
                let mut height = a.plane_height(x, y);
                if on_side >> lane & 1 != 0 {
                    height = a.side_height(x, y, -1.0, height, tiny);
                }
                let gap = z - height;
                let point = b.corner_position(k) - n * (0.5 * gap);
                let features = (face_feature(faces.0), vertex_feature(b.vertex(k)));
                found.push(PatchCorner { point: point.into(), flat: [x, y], gap, features });
            }
            from += L::WIDTH;
        }
        let end_of_vertices = found.len();
        let mut i = 0;
        while i < count_a {
            let mut from = 0;
            while from < count_b {
                // Distances of the corners of B from this side of A, and of the ends of this side from the sides of B.
                let (x, y) = (l.load(&b.x[from..]), l.load(&b.y[from..]));
                let (next_x, next_y) = (l.load(&b.x[from + 1..]), l.load(&b.y[from + 1..]));
                let (w0, w1) = (a.side_distance(l, i, x, y), a.side_distance(l, i, next_x, next_y));
                let (dx, dy) = (l.load(&b.dx[from..]), l.load(&b.dy[from..]));
                macro_rules! from_sides {
                    ($k:expr) => {
                        l.sub(l.mul(dx, l.sub(l.splat(a.y[$k]), y)), l.mul(dy, l.sub(l.splat(a.x[$k]), x)))
                    };
                }
                let (v0, v1) = (from_sides!(i), from_sides!(i + 1));
                macro_rules! separates {
                    ($p:expr, $q:expr) => {
                        (l.mask_greater($p, l.splat(tiny)) & l.mask_greater(l.splat(-tiny), $q))
                            | (l.mask_greater(l.splat(-tiny), $p) & l.mask_greater($q, l.splat(tiny)))
                    };
                }
                let mut crossing = separates!(w0, w1) & separates!(v0, v1) & lane_mask::<L>(from, count_b);
                if crossing != 0 {
                    let mut distances = [[0.0; 8]; 4];
                    l.store(&mut distances[0], v0);
                    l.store(&mut distances[1], v1);
                    l.store(&mut distances[2], w0);
                    l.store(&mut distances[3], w1);
                    while crossing != 0 {
                        let lane = crossing.trailing_zeros() as usize;
                        crossing &= crossing - 1;
                        let j = from + lane;
                        let [v0, v1, w0, w1] =
                            [distances[0][lane], distances[1][lane], distances[2][lane], distances[3][lane]];
                        let (p, q) = (v0 / (v0 - v1), w0 / (w0 - w1));
                        let on_a = a.corner_position(i) * (1.0 - p) + a.corner_position(a.next_corner(i)) * p;
                        let on_b = b.corner_position(j) * (1.0 - q) + b.corner_position(b.next_corner(j)) * q;
                        let point = (on_a + on_b) * 0.5;
                        let flat = [point.dot(&frame[1]), point.dot(&frame[2])];
                        let gap = n.dot(&(on_b - on_a));
                        let mut same = first;
                        while same < end_of_vertices && !found[same].is_near(flat, pair.smaller_circumradius) {
                            same += 1;
                        }
                        if same < end_of_vertices {
                            found[same].gap = found[same].gap.min(gap);
                            continue;
                        }
                        let features = (edge_feature(a.edge(i)), edge_feature(b.edge(j)));
                        found.push(PatchCorner { point: point.into(), flat, gap, features });
                    }
                }
                from += L::WIDTH;
            }
            i += 1;
        }
    }
}
