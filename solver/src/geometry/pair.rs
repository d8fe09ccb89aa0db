//! Two posed polyhedra: data shared by the search for their separation and by the construction of their common face.

use super::manifold::Separated;
use super::polyhedron::{Polyhedron, PosedPolyhedron};
use crate::math::Vec3;
use crate::math::simd::{F64Arithmetic, Scalar, SimdWidth};

/// Two posed polyhedra A and B, and lengths of both.
#[derive(Clone, Copy)]
pub(super) struct PolyhedronPair<'a> {
    /// A in its own frame.
    pub shape_a: &'a Polyhedron,
    /// A with its orientation.
    pub posed_a: &'a PosedPolyhedron<'a>,
    /// B in its own frame.
    pub shape_b: &'a Polyhedron,
    /// B with its orientation.
    pub posed_b: &'a PosedPolyhedron<'a>,
    /// Position of B's centre relative to A's, c = x_B - x_A, world frame, m.
    pub centre_offset: Vec3,
    /// Sum of the two circumradii, m.
    pub circumradius_sum: f64,
    /// Smaller of the two circumradii, m.
    pub smaller_circumradius: f64,
    /// Width of the vectors of the search.
    pub width: SimdWidth,
}

/// Features of the two polyhedra that determine a direction: the index of a face, or of an edge of each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum SearchFeature {
    FaceOfA(u32),
    FaceOfB(u32),
    Edges(u32, u32),
    /// Arbitrary direction.
    None,
}

/// Direction with the separation along it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SearchAxis {
    /// Unit direction from A to B.
    pub n: Vec3,
    /// Separation s(n) along it, m, < 0 if the polyhedra overlap in this direction.
    pub s: f64,
    pub feature: SearchFeature,
}

impl SearchAxis {
    /// Direction and separation without the features.
    pub fn as_separated(&self) -> Separated {
        Separated { n: self.n, s: self.s }
    }
}

/// Corner of the common part of two faces, seen along the normal.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PatchCorner {
    /// Point halfway between the two faces, relative to A's centre, m.
    pub point: [f64; 3],
    /// Coordinates in the plane across the normal, m.
    pub flat: [f64; 2],
    /// Distance of the two faces along the normal, m, < 0 overlapping.
    pub gap: f64,
    /// Features of A and of B that meet in the corner.
    pub features: (u32, u32),
}

/// Corners of a common part; twelve of them without an allocation.
pub(super) type PatchCorners = smallvec::SmallVec<[PatchCorner; 12]>;

/// Cosine between a face's normal and the direction of view below which it is seen as a line.
pub(super) const MIN_FACE_COSINE: f64 = 1e-9;
/// Index of each lane.
const LANE_INDICES: [f64; 8] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

impl<'a> PolyhedronPair<'a> {
    /// Pairs `posed_a` with `posed_b`, whose centre is at `centre_offset` (m) from that of `posed_a`.
    pub fn new(
        posed_a: &'a PosedPolyhedron,
        posed_b: &'a PosedPolyhedron,
        centre_offset: Vec3,
        width: SimdWidth,
    ) -> Self {
        let (shape_a, shape_b) = (posed_a.shape, posed_b.shape);
        let (radius_a, radius_b) = (shape_a.circumradius(), shape_b.circumradius());
        PolyhedronPair {
            shape_a,
            posed_a,
            shape_b,
            posed_b,
            centre_offset,
            circumradius_sum: radius_a + radius_b,
            smaller_circumradius: radius_a.min(radius_b),
            width,
        }
    }

    /// Improvement (m) by which a direction replaces an earlier one, so that rounding, and noise of 1e-12 of the smaller
    /// body, do not decide between equal directions.
    pub fn tie_tolerance(&self) -> f64 {
        4e-12 * self.smaller_circumradius + self.rounding_bound()
    }

    /// Bound of the rounding error of a separation, with a safety margin, m.
    pub fn rounding_bound(&self) -> f64 {
        32.0 * f64::EPSILON * self.circumradius_sum
    }

    /// Sum of the inradii, m: s(n) <= n·c minus this.
    pub fn inradius_sum(&self) -> f64 {
        self.shape_a.inradius() + self.shape_b.inradius()
    }

    /// Returns s(n), the separation along the unit vector `n` (m), and the vertices of A and of B that determine it.
    pub fn separation_along(&self, n: &Vec3) -> (f64, u32, u32) {
        let (a, high) = support_vertex(self.posed_a, n);
        let (b, low) = support_vertex(self.posed_b, &-n);
        (n.dot(&self.centre_offset) - low - high, a, b)
    }
}

/// Scalar product of `v` with vectors given by their three components in lanes.
#[inline(always)]
pub(super) fn dot_columns<L: F64Arithmetic>(l: L, v: &Vec3, [x, y, z]: [L::V; 3]) -> L::V {
    l.mul_add(l.splat(v.z), z, l.mul_add(l.splat(v.y), y, l.mul(l.splat(v.x), x)))
}

/// Returns the first vertex farthest along the unit vector `n` (world frame), and its height above the centre, m.
pub(super) fn support_vertex(posed: &PosedPolyhedron, n: &Vec3) -> (u32, f64) {
    let (vertex, height) = lowest_vertex(Scalar, posed, &-n);
    (vertex, -height)
}

/// Returns the first vertex lowest along the unit vector `n` (world frame), and its height above the centre, m.
#[inline(always)]
pub(super) fn lowest_vertex<L: F64Arithmetic>(l: L, posed: &PosedPolyhedron, n: &Vec3) -> (u32, f64) {
    let n = posed.local_vector(n);
    let [x, y, z] = posed.shape.vertex_columns();
    // Lowest height so far in each lane, and the index of the first vertex of its block.
    let mut lowest = l.splat(f64::INFINITY);
    let mut block = l.splat(0.0);
    let mut first = 0;
    while first < x.len() {
        let height = dot_columns(l, &n, [l.load(&x[first..]), l.load(&y[first..]), l.load(&z[first..])]);
        block = l.select_greater(lowest, height, l.splat(first as f64), block);
        lowest = l.min(height, lowest);
        first += L::WIDTH;
    }
    let mut vertices = [0.0; 8];
    l.store(&mut vertices, l.add(block, l.load(&LANE_INDICES)));
    let height = l.min_lane(lowest);
    // Takes the first of equal vertices.
    let mut equal_lanes = !l.mask_greater(lowest, l.splat(height)) & ((1 << L::WIDTH) - 1);
    let mut vertex = vertices[equal_lanes.trailing_zeros() as usize & 7];
    equal_lanes &= equal_lanes.wrapping_sub(1);
    while equal_lanes != 0 {
        let other = vertices[equal_lanes.trailing_zeros() as usize];
        vertex = if other < vertex { other } else { vertex };
        equal_lanes &= equal_lanes - 1;
    }
    (vertex as u32, height)
}
