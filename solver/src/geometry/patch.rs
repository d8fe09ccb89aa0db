//! The common part of two faces seen along a normal: points of contact and area.
//!
//! One algorithm for face on face, edge on face, vertex on face and crossed edges, and the same for A and B.

use smallvec::SmallVec;

use super::manifold::{ContactPoint, ListingRange, Manifold};
use super::outline::collect_common_corners;
use super::pair::{PatchCorner, PatchCorners, PolyhedronPair, SearchAxis};
use crate::math::Vec3;

/// Distance from a side, divided by the smaller circumradius, up to which a vertex is on the side, so that aligned
/// faces keep their vertices and have no crossings next to them.
pub(super) const ON_SIDE_DISTANCE: f64 = 1e-11;
/// Distance, divided by the smaller circumradius, up to which two corners count as one.
pub(super) const SAME_CORNER_DISTANCE: f64 = 1e-9;
/// Distance of a corner from the line between its neighbours, divided by the size of the patch, up to which it may be
/// left out.
const FLAT_CORNER_HEIGHT: f64 = 1e-2;
/// Number of ties by which a corner must be deeper than its neighbours to be kept always.
const DEEPER_TIES: f64 = 4.0;
/// Number of corners up to which none is left out.
const MAX_CORNERS_UNREDUCED: usize = 4;
/// Number of keys up to which they are sorted by counting.
const MAX_COUNTING_SORT: usize = 16;

/// Common part of two faces seen along a normal.
#[derive(Default)]
pub(super) struct ContactPatch {
    /// Corners in the order in which they were found.
    pub corners: PatchCorners,
    /// Normal from A to B.
    pub normal: Vec3,
    /// Area of the common part within the range of areas, m^2.
    pub area: f64,
}

impl ContactPatch {
    /// Computes the common part of faces of A and of B seen along an axis; area counts up to the gap `area_within`, m.
    pub fn clip_faces(&mut self, pair: &PolyhedronPair, axis: &SearchAxis, faces: (u32, u32), area_within: f64) {
        self.normal = axis.n;
        self.corners.clear();
        collect_common_corners(pair, &axis.n, faces, ON_SIDE_DISTANCE * pair.smaller_circumradius, &mut self.corners);
        self.area = polygon_area(&self.corners, area_within);
        for corner in &mut self.corners {
            // Steep planes reach too far if a vertex on a side is outside by rounding.
            corner.gap = corner.gap.max(axis.s);
        }
    }

    /// Sets normal and area for corners that are known already; `area_of_all`: area of the whole common part.
    pub fn set_normal_and_area(&mut self, normal: Vec3, area_of_all: f64, area_within: f64) {
        // With a limited range the tilt of the faces counts, too.
        let is_unlimited = area_within == f64::INFINITY;
        (self.normal, self.area) =
            (normal, if is_unlimited { area_of_all } else { polygon_area(&self.corners, area_within) });
    }

    /// Whether a corner has the gap of the axis: then two points of A and B are as near as the axis allows.
    pub fn has_axis_gap(&self, s: f64, tie: f64) -> bool {
        self.corners.iter().any(|corner| corner.gap <= s + tie)
    }

    /// Writes the listed corners into `to`; gaps are equal up to `tie`, m.
    pub fn write_manifold(&mut self, range: ListingRange, tie: f64, to: &mut Manifold) {
        if self.corners.iter().any(|corner| corner.gap > range.alert) {
            self.corners.retain(|corner| corner.gap <= range.alert);
        }
        let key = |corner: &PatchCorner| u64::from(corner.features.0) << 32 | u64::from(corner.features.1);
        let point = |corner: &PatchCorner| ContactPoint {
            position: corner.point.into(),
            gap: corner.gap,
            features: corner.features,
        };
        (to.normal, to.area) = (-self.normal, self.area);
        to.points.clear();
        let count = self.corners.len();
        if count <= MAX_CORNERS_UNREDUCED {
            // The usual case, without heap or branches.
            let mut keys = [0; MAX_CORNERS_UNREDUCED];
            keys.iter_mut().zip(&self.corners).for_each(|(k, corner)| *k = key(corner));
            let order: [usize; MAX_CORNERS_UNREDUCED] = counting_sort_order(&keys[..count]);
            to.points.extend(order[..count].iter().map(|&k| point(&self.corners[k])));
            return;
        }
        let keys: SmallVec<[u64; 12]> = self.corners.iter().map(key).collect();
        let mut order = sorted_order(&keys);
        self.drop_flat_corners(&mut order, tie);
        to.points.extend(order.iter().map(|&k| point(&self.corners[k as usize])));
    }

    /// Removes, in the order of `order`, corners whose removal leaves the same outline: sides that nearly coincide cross
    /// in the middle, and a corner that is hardly cut off appears twice. The deepest corner is kept.
    fn drop_flat_corners(&self, order: &mut SmallVec<[u32; 12]>, tie: f64) {
        let flat_position = |k: u32| self.corners[k as usize].flat;
        let side_vector =
            |a: u32, b: u32| [flat_position(b)[0] - flat_position(a)[0], flat_position(b)[1] - flat_position(a)[1]];
        let length = |[x, y]: [f64; 2]| (x * x + y * y).sqrt();
        let size = order.iter().map(|&k| length(side_vector(order[0], k))).fold(0.0, f64::max);
        let gap = |k: u32| self.corners[k as usize].gap;
        let outline = convex_order(&self.corners);
        let (corner_count, mut count) = (outline.len(), outline.len());
        let mut position = SmallVec::<[usize; 12]>::from_elem(0, corner_count);
        (0..corner_count).for_each(|index| position[outline[index] as usize] = index);
        let mut is_kept = SmallVec::<[bool; 12]>::from_elem(true, corner_count);
        let previous_index = |index: usize| if index == 0 { corner_count - 1 } else { index - 1 };
        let next_index = |index: usize| if index + 1 == corner_count { 0 } else { index + 1 };
        order.retain(|k| {
            let index = position[*k as usize];
            // All removed corners between the present neighbours must lie on the line between these, too.
            let (mut previous, mut next) = (previous_index(index), next_index(index));
            while previous != index && !is_kept[previous] {
                previous = previous_index(previous);
            }
            while next != index && !is_kept[next] {
                next = next_index(next);
            }
            let (previous_corner, next_corner) = (outline[previous], outline[next]);
            let side = side_vector(previous_corner, next_corner);
            let stands_out = |k: u32| {
                let next = side_vector(previous_corner, k);
                (side[0] * next[1] - side[1] * next[0]).abs() > FLAT_CORNER_HEIGHT * size * length(side)
            };
            let mut within = std::iter::successors(Some(next_index(previous)), |&index| Some(next_index(index)))
                .take_while(|&index| index != next);
            let is_deeper = gap(*k) < gap(previous_corner).min(gap(next_corner)) - DEEPER_TIES * tie;
            let stays = count <= 3 || is_deeper || within.any(|index| stands_out(outline[index]));
            is_kept[index] = stays;
            count -= usize::from(!stays);
            stays
        });
    }
}

impl PatchCorner {
    /// Whether the corner and the point (x, y), m, coincide seen along the normal; `radius`: the smaller circumradius, m.
    #[inline(always)]
    pub fn is_near(&self, [x, y]: [f64; 2], radius: f64) -> bool {
        let same = SAME_CORNER_DISTANCE * radius;
        (self.flat[0] - x).abs() <= same && (self.flat[1] - y).abs() <= same
    }

    /// Middle of the shortest segment between two lines that are not parallel.
    pub fn line_crossing([a0, a1]: [Vec3; 2], [b0, b1]: [Vec3; 2]) -> Vec3 {
        let (u, v, w) = (a1 - a0, b1 - b0, a0 - b0);
        let (uu, uv, vv, uw, vw) = (u.dot(&u), u.dot(&v), v.dot(&v), u.dot(&w), v.dot(&w));
        let d = uu * vv - uv * uv;
        let (x, y) = ((uv * vw - vv * uw) / d, (uu * vw - uv * uw) / d);
        ((a0 + u * x) + (b0 + v * y)) * 0.5
    }
}

/// Indices of the keys in increasing order; equal keys keep their order.
fn sorted_order(keys: &[u64]) -> SmallVec<[u32; 12]> {
    if keys.len() > MAX_COUNTING_SORT {
        let mut order: SmallVec<[u32; 12]> = (0..keys.len() as u32).collect();
        order.sort_by_key(|&k| keys[k as usize]);
        return order;
    }
    counting_sort_order::<MAX_COUNTING_SORT>(keys)[..keys.len()].iter().map(|&k| k as u32).collect()
}

/// Order of up to `N` keys as [`sorted_order`], by counting the keys before each: without branches, which noise would
/// make unpredictable.
fn counting_sort_order<const N: usize>(keys: &[u64]) -> [usize; N] {
    let (mut before, mut order) = ([0; N], [0; N]);
    for k in 1..keys.len() {
        for earlier in 0..k {
            let first = usize::from(keys[earlier] <= keys[k]);
            before[k] += first;
            before[earlier] += 1 - first;
        }
    }
    for k in 0..keys.len() {
        order[before[k] % N] = k;
    }
    order
}

/// Middle of the corners, m.
fn corner_centre(corners: &[PatchCorner]) -> [f64; 2] {
    let count = corners.len() as f64;
    corners.iter().fold([0.0; 2], |m, c| [m[0] + c.flat[0] / count, m[1] + c.flat[1] / count])
}

/// Corners of a convex polygon, counter-clockwise.
fn convex_order(corners: &[PatchCorner]) -> SmallVec<[u32; 12]> {
    let mean = corner_centre(corners);
    // Sorts by a number that increases with the angle.
    let turn = |corner: &PatchCorner| {
        let (x, y) = (corner.flat[0] - mean[0], corner.flat[1] - mean[1]);
        let reach = x.abs() + y.abs();
        let turn = if reach == 0.0 { 0.0 } else { (1.0 - x / reach).copysign(y) };
        // Converts to integers of the same order.
        let bits = turn.to_bits() as i64;
        (bits ^ (bits >> 63 | i64::MIN)) as u64
    };
    let turns: SmallVec<[u64; 12]> = corners.iter().map(turn).collect();
    sorted_order(&turns)
}

/// Tilt of two faces, rad, from which on they have no common area if a range counts: an edge on a face. The part of a
/// tilted face that is within the range of a bond, a thousandth of the size divided by the tilt, is 1 % of the face
/// there.
pub(super) const MAX_AREA_TILT: f64 = 0.1;

/// Fraction of the area of a convex polygon of corners x, y and gap that counts at the tilt θ of its gap: 1 - (θ/0.1)²,
/// at least 0.
pub(super) fn share_at_tilt(polygon: &[[f64; 3]]) -> f64 {
    let mut normal = [0.0; 3];
    for (k, p) in polygon.iter().enumerate() {
        let q = &polygon[if k + 1 == polygon.len() { 0 } else { k + 1 }];
        for (i, sum) in normal.iter_mut().enumerate() {
            let (j, l) = ((i + 1) % 3, (i + 2) % 3);
            *sum += p[j] * q[l] - p[l] * q[j];
        }
    }
    let [x, y, z] = normal;
    let tilt2 = (x * x + y * y) / (z * z);
    // A polygon without area has a tilt that is not a number.
    (1.0 - tilt2 / (MAX_AREA_TILT * MAX_AREA_TILT)).max(0.0)
}

/// Area of the part of a convex polygon where its gap, which is linear on it, is at most `max_gap` (m), m^2; for a finite
/// `max_gap` multiplied by [`share_at_tilt`].
pub(super) fn polygon_area(corners: &[PatchCorner], max_gap: f64) -> f64 {
    if corners.len() < 3 {
        return 0.0;
    }
    let mean = corner_centre(corners);
    let corner = |&k: &u32| {
        let PatchCorner { flat, gap, .. } = corners[k as usize];
        [flat[0] - mean[0], flat[1] - mean[1], gap]
    };
    let mut polygon: Polygon = convex_order(corners).iter().map(corner).collect();
    if polygon.iter().any(|corner| corner[2] > max_gap) {
        polygon = clipped_to_gap(&polygon, max_gap);
    }
    let mut doubled = 0.0;
    for (k, &[x, y, _]) in polygon.iter().enumerate() {
        let [next_x, next_y, _] = polygon[if k + 1 == polygon.len() { 0 } else { k + 1 }];
        doubled += x * next_y - y * next_x;
    }
    let share = if max_gap == f64::INFINITY { 1.0 } else { share_at_tilt(&polygon) };
    (0.5 * doubled).max(0.0) * share
}

/// Corners x, y and gap, m.
pub(super) type Polygon = SmallVec<[[f64; 3]; 12]>;

/// Part of a convex polygon with gaps up to `max_gap`, m: one side of a straight line.
pub(super) fn clipped_to_gap(polygon: &[[f64; 3]], max_gap: f64) -> Polygon {
    let mut nearer = Polygon::new();
    for (k, p) in polygon.iter().enumerate() {
        let q = &polygon[if k + 1 == polygon.len() { 0 } else { k + 1 }];
        if p[2] <= max_gap {
            nearer.push(*p);
        }
        if (p[2] <= max_gap) != (q[2] <= max_gap) {
            let share = (max_gap - p[2]) / (q[2] - p[2]);
            nearer.push([0, 1, 2].map(|i| p[i] + (q[i] - p[i]) * share));
        }
    }
    nearer
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::PosedPolyhedron;
    use crate::geometry::polyhedra::tests::each_pair;
    use crate::math::local_frame;

    /// Sutherland-Hodgman clipping: each side of `by` cuts the remaining polygon.
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

    /// Corners of regular polygons, in circular or any other order: the remaining corners span all of them to
    /// [`FLAT_CORNER_HEIGHT`].
    #[test]
    fn many_corners_that_are_hardly_bent_are_not_left_out_one_after_the_other() {
        for (count, stride) in [(5, 1), (12, 1), (64, 1), (400, 1), (400, 37), (1000, 1)] {
            let at = |k: usize| {
                let angle = k as f64 * std::f64::consts::TAU / count as f64;
                [angle.cos(), angle.sin()]
            };
            let corner = |k: usize| {
                let [x, y] = at(k);
                PatchCorner { point: [x, y, 0.0], flat: [x, y], gap: 0.0, features: ((k * stride % count) as u32, 0) }
            };
            let mut patch = ContactPatch { corners: (0..count).map(corner).collect(), normal: Vec3::z(), area: 0.0 };
            let mut manifold = Manifold::default();
            patch.write_manifold(ListingRange::from(1.0), 1e-12, &mut manifold);
            let mut left: Vec<f64> = manifold.points.iter().map(|p| p.position.y.atan2(p.position.x)).collect();
            left.sort_by(f64::total_cmp);
            let gap = |k: usize| (left[(k + 1) % left.len()] - left[k]).rem_euclid(std::f64::consts::TAU);
            let widest = (0..left.len()).map(gap).fold(0.0, f64::max);
            // A chord under an angle α is 1 - cos α/2 from its arc; the size of the patch is 2.
            assert!(
                1.0 - (widest / 2.0).cos() <= 2.0 * FLAT_CORNER_HEIGHT || left.len() == count,
                "{count}: {}",
                left.len()
            );
            assert!(left.len() <= 24, "{count}: {}", left.len());
        }
    }

    #[test]
    fn patches_are_those_of_clipping() {
        let mut many = [0; 12];
        each_pair(3000, 0.5, |k, pair, found| {
            let mut patch = ContactPatch::default();
            patch.clip_faces(pair, &found.axis, found.faces, f64::INFINITY);
            let frame = local_frame(found.axis.n);
            let outline = |posed: &PosedPolyhedron, f: u32, moved: Vec3, turned: bool| -> Vec<[f64; 2]> {
                let at = |&v: &u16| posed.vertex(v) + moved;
                let corners =
                    posed.shape.face_corners(f as usize).iter().map(at).map(|p| [p.dot(&frame[1]), p.dot(&frame[2])]);
                if turned { corners.rev().collect() } else { corners.collect() }
            };
            let expected = clipped(
                outline(pair.posed_a, found.faces.0, Vec3::zeros(), false),
                &outline(pair.posed_b, found.faces.1, pair.centre_offset, true),
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
        });
        assert!(many[3..7].iter().all(|&count| count > 20), "{many:?}");
    }
}
