//! Two posed polyhedra: the data that the search for their separation and for their common part share.

use super::manifold::Separated;
use super::polyhedron::{Polyhedron, PosedPolyhedron};
use crate::math::Vec3;
use crate::math::simd::{F64Arithmetic, Scalar, SimdWidth};

/// Two posed polyhedra.
#[derive(Clone, Copy)]
pub(super) struct PolyhedronPair<'a> {
    pub a: &'a Polyhedron,
    pub pa: &'a PosedPolyhedron<'a>,
    pub b: &'a Polyhedron,
    pub pb: &'a PosedPolyhedron<'a>,
    /// Vector x_B - x_A, m.
    pub c: Vec3,
    /// Sum of the circumradii, m.
    pub sum: f64,
    /// The smaller circumradius, m.
    pub small: f64,
    pub width: SimdWidth,
}

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
    /// Separation, m.
    pub s: f64,
    pub feature: SearchFeature,
}

impl SearchAxis {
    pub fn as_separated(&self) -> Separated {
        Separated { n: self.n, s: self.s }
    }
}

/// Corner of the common part of two faces.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PatchCorner {
    pub point: [f64; 3],
    /// Position seen along the normal.
    pub flat: [f64; 2],
    pub gap: f64,
    pub features: (u32, u32),
}

/// Corners found so far.
pub(super) type PatchCorners = smallvec::SmallVec<[PatchCorner; 12]>;

/// Cosine between a face's normal and the direction of view below which it is seen as a line.
pub(super) const MIN_FACE_COSINE: f64 = 1e-9;
/// Index of each lane.
const LANE_INDICES: [f64; 8] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

impl<'a> PolyhedronPair<'a> {
    pub fn new(pa: &'a PosedPolyhedron, pb: &'a PosedPolyhedron, c: Vec3, width: SimdWidth) -> Self {
        let (a, b) = (pa.shape, pb.shape);
        let (ra, rb) = (a.circumradius(), b.circumradius());
        PolyhedronPair { a, pa, b, pb, c, sum: ra + rb, small: ra.min(rb), width }
    }

    /// Improvement (m) by which a direction replaces an earlier one, so that rounding, and noise of 1e-12 of the smaller
    /// body, do not decide between equal directions.
    pub fn tie_tolerance(&self) -> f64 {
        4e-12 * self.small + self.rounding_bound()
    }

    /// Bound of the rounding error of an s with a safety margin, m.
    pub fn rounding_bound(&self) -> f64 {
        32.0 * f64::EPSILON * self.sum
    }

    /// Sum of the inradii, m: s(n) <= n·c minus this.
    pub fn inradius_sum(&self) -> f64 {
        self.a.inradius() + self.b.inradius()
    }

    /// Returns s(n) with the vertices that give it.
    pub fn separation_along(&self, n: &Vec3) -> (f64, u32, u32) {
        let (a, high) = support_vertex(self.pa, n);
        let (b, low) = support_vertex(self.pb, &-n);
        (n.dot(&self.c) - low - high, a, b)
    }
}

/// Returns the first vertex farthest along `n`, and its height.
pub(super) fn support_vertex(posed: &PosedPolyhedron, n: &Vec3) -> (u32, f64) {
    let (k, low) = lowest_vertex(Scalar, posed, &-n);
    (k, -low)
}

/// Returns the first vertex lowest along `n`, and its height.
#[inline(always)]
pub(super) fn lowest_vertex<L: F64Arithmetic>(l: L, posed: &PosedPolyhedron, n: &Vec3) -> (u32, f64) {
    let n = posed.local_vector(n);
    let [x, y, z] = posed.shape.vertex_columns();
    let (nx, ny, nz) = (l.splat(n.x), l.splat(n.y), l.splat(n.z));
    let mut least = l.splat(f64::INFINITY);
    let mut at = l.splat(0.0);
    let mut k = 0;
    while k < x.len() {
        let height = l.mul_add(nz, l.load(&z[k..]), l.mul_add(ny, l.load(&y[k..]), l.mul(nx, l.load(&x[k..]))));
        at = l.select_greater(least, height, l.splat(k as f64), at);
        least = l.min(height, least);
        k += L::WIDTH;
    }
    let mut places = [0.0; 8];
    l.store(&mut places, l.add(at, l.load(&LANE_INDICES)));
    let height = l.min_lane(least);
    // Takes the first of equal vertices.
    let mut equal = !l.mask_greater(least, l.splat(height)) & ((1 << L::WIDTH) - 1);
    let mut place = places[equal.trailing_zeros() as usize & 7];
    equal &= equal.wrapping_sub(1);
    while equal != 0 {
        let other = places[equal.trailing_zeros() as usize];
        place = if other < place { other } else { place };
        equal &= equal - 1;
    }
    (place as u32, height)
}
