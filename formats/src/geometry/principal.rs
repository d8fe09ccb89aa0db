//! Principal axes of bodies without an inertia line, as LMGC90 finds them.
//!
//! Files of motion give orientations of these axes, so that both programs must choose the same order and the same signs
//! where mechanics leaves a choice.

use nalgebra::{Matrix3, Vector3};

use super::surface::MassProperties;

/// Ratio of a product of inertia to the moment of its row below which LMGC90 takes it as zero.
const ROUNDING: f64 = 1e-14;
/// Moment, m^5, up to which LMGC90 compares the products of inertia of a row with [`SMALL_PRODUCT`].
const SMALL_MOMENT: f64 = 1e-10;
/// Product of inertia, m^5, below which LMGC90 takes it as zero in a row with a small moment.
const SMALL_PRODUCT: f64 = 1e-17;
/// Largest ratio of products of inertia taken as zero to the largest moment. The axes are then wrong by about as many rad.
const MAX_NEGLECTED: f64 = 1e-5;
/// Relative difference of two moments below which rounding decides about their axes.
const EQUAL_MOMENTS: f64 = 1e-13;
/// Rows and columns of the products of inertia in the tensor.
const OFF_DIAGONAL: [(usize, usize); 6] = [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)];

/// Whether LMGC90 has the same axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxesMatch {
    /// LMGC90 has these axes.
    Same,
    /// Two moments are equal up to rounding, which decides about the axes and their signs.
    Arbitrary,
    /// The last bits of the moments decide about the signs of two axes, as of many bodies with one plane of symmetry.
    ArbitrarySigns,
    /// LMGC90 neglects products of inertia below 1e-17 m^5, which are large for this small body: its axes are the fixed
    /// ones, or others that are not principal.
    TooSmall,
}

/// Principal moments and axes of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PrincipalFrame {
    /// Moments about the axes at density 1, m^5.
    pub moments: [f64; 3],
    /// Unit vectors, one a row, right-handed.
    pub axes: [[f64; 3]; 3],
    pub lmgc90: AxesMatch,
}

impl MassProperties {
    /// Principal axes as LMGC90 finds them.
    ///
    /// If all products of inertia are zero up to rounding, the axes are the fixed ones, whatever the order of the moments.
    /// Otherwise the moments ascend, the first two axes are the eigenvectors with the signs that LAPACK's `dsyevd` gives
    /// them, and the third is their vector product. Found by comparison with the frames that LMGC90 2025 writes; other
    /// versions of LAPACK may turn a pair of axes round.
    ///
    /// ```
    /// # use cd_formats::surface::MassProperties;
    /// let inertia = [[3.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0]];
    /// let frame = MassProperties { volume: 1.0, centre: [0.0; 3], inertia }.lmgc90_frame();
    /// assert_eq!((frame.moments, frame.axes[0]), ([3.0, 1.0, 2.0], [1.0, 0.0, 0.0]));
    /// ```
    pub fn lmgc90_frame(&self) -> PrincipalFrame {
        let inertia = Matrix3::from(self.inertia);
        let largest = inertia.diagonal().amax();
        // The matrix that LMGC90 uses, and the largest product of inertia that it neglects.
        let (mut reduced, mut neglected) = (inertia, 0.0f64);
        for (j, k) in OFF_DIAGONAL {
            let (moment, product) = (inertia[(j, j)].abs(), inertia[(j, k)].abs());
            let bound = if moment > SMALL_MOMENT { ROUNDING * moment } else { SMALL_PRODUCT };
            if product < bound {
                reduced[(j, k)] = 0.0;
                neglected = neglected.max(product);
            }
        }
        let is_too_small = neglected > MAX_NEGLECTED * largest;
        let matrix = if is_too_small { inertia } else { reduced };
        let is_diagonal = OFF_DIAGONAL.iter().all(|&entry| matrix[entry] == 0.0);
        let (moments, axes) =
            if is_diagonal { (matrix.diagonal().into(), Matrix3::identity().into()) } else { eigen_axes(&matrix) };
        let has_equal_moments =
            moments[1] - moments[0] < EQUAL_MOMENTS * largest || moments[2] - moments[1] < EQUAL_MOMENTS * largest;
        let lmgc90 = match (is_too_small, is_diagonal) {
            (true, _) => AxesMatch::TooSmall,
            (false, false) if has_equal_moments => AxesMatch::Arbitrary,
            (false, false) if has_arbitrary_signs(&matrix, &axes) => AxesMatch::ArbitrarySigns,
            _ => AxesMatch::Same,
        };
        PrincipalFrame { moments, axes, lmgc90 }
    }
}

/// Eigenvalues of a symmetric matrix, ascending, and a right-handed triad of unit eigenvectors.
fn eigen_axes(matrix: &Matrix3<f64>) -> ([f64; 3], [[f64; 3]; 3]) {
    let (moments, vectors) = symmetric_eigen(matrix);
    let [first, second] = [0, 1].map(|k| vectors.column(k).normalize());
    (moments, [first, second, first.cross(&second)].map(Into::into))
}

/// Whether changes by roundings reverse two of the eigenvectors `axes`: LMGC90 adds up moments in another order.
fn has_arbitrary_signs(matrix: &Matrix3<f64>, axes: &[[f64; 3]; 3]) -> bool {
    let is_reversed_by = |(j, k): (usize, usize), roundings: f64| {
        let mut changed = *matrix;
        changed[(j, k)] *= 1.0 + roundings * f64::EPSILON;
        changed[(k, j)] = changed[(j, k)];
        let (_, changed_axes) = eigen_axes(&changed);
        (0..3).any(|axis| Vector3::from(changed_axes[axis]).dot(&Vector3::from(axes[axis])) < 0.0)
    };
    let lower_triangle = [(0, 0), (1, 1), (2, 2), (1, 0), (2, 0), (2, 1)];
    // LMGC90's sums of some ten products have differed by up to four roundings.
    let errors = [1.0, 2.0, 4.0, 8.0].into_iter().flat_map(|roundings: f64| [-roundings, roundings]);
    lower_triangle.iter().any(|&entry| errors.clone().any(|roundings| is_reversed_by(entry, roundings)))
}

/// Eigenvalues, ascending, and eigenvectors, as columns, of a symmetric matrix, whose entries above the diagonal are not
/// used.
///
/// Householder's reduction to tridiagonal form, then implicit QL or QR steps, in the order of operations of LAPACK 3.9 that
/// decides about signs: `dsytd2`, `dsteqr`, `dorm2r`. Source: E. Anderson et al., LAPACK Users' Guide, 3rd ed. (1999); B. N.
/// Parlett, The Symmetric Eigenvalue Problem (1980), chapter 8.
fn symmetric_eigen(matrix: &Matrix3<f64>) -> ([f64; 3], Matrix3<f64>) {
    let (reflected, mut t) = Tridiagonal::reduce(matrix);
    t.diagonalize();
    for column in 0..2 {
        let smallest = (column + 1..3).fold(column, |smallest, k| if t.d[k] < t.d[smallest] { k } else { smallest });
        if smallest != column {
            t.d.swap(column, smallest);
            t.z.swap_columns(column, smallest);
        }
    }
    if let Some(Reflection { tau, v }) = reflected {
        for mut column in t.z.column_iter_mut() {
            let w = column[1] + v * column[2];
            column[1] -= tau * w;
            column[2] -= tau * w * v;
        }
    }
    (t.d, t.z)
}

/// Reflection I − τ (0, 1, v)(0, 1, v)'.
struct Reflection {
    tau: f64,
    v: f64,
}

/// Symmetric tridiagonal matrix, and the product of the rotations that were applied to it; letters as in LAPACK.
struct Tridiagonal {
    /// Diagonal.
    d: [f64; 3],
    /// Entries next to the diagonal.
    e: [f64; 2],
    /// Product of the rotations.
    z: Matrix3<f64>,
}

/// Unit round-off, as in LAPACK.
const UNIT_ROUNDOFF: f64 = f64::EPSILON / 2.0;

/// Number of QL or QR steps after which the matrix is taken as it is; each eigenvalue needs two or three.
const MAX_STEPS: usize = 90;

impl Tridiagonal {
    /// Reduces a symmetric matrix, of which the lower triangle is used; returns the reflection, unless the matrix is
    /// tridiagonal already.
    fn reduce(a: &Matrix3<f64>) -> (Option<Reflection>, Tridiagonal) {
        let (alpha, x) = (a[(1, 0)], a[(2, 0)]);
        let (a11, a21, a22) = (a[(1, 1)], a[(2, 1)], a[(2, 2)]);
        let z = Matrix3::identity();
        if x == 0.0 {
            return (None, Tridiagonal { d: [a[(0, 0)], a11, a22], e: [alpha, a21], z });
        }
        let beta = -length(alpha, x).copysign(alpha);
        let (tau, v) = ((beta - alpha) / beta, x / (alpha - beta));
        // A := A − u w' − w u' with u = (1, v), w = τ A u − ½ τ² (u'A u) u.
        let (mut w0, mut w1) = (tau * (a11 + a21 * v), tau * (a21 + a22 * v));
        let shift = -0.5 * tau * (w0 + w1 * v);
        (w0, w1) = (w0 + shift, w1 + shift * v);
        let d = [a[(0, 0)], a11 - w0 - w0, a22 - v * w1 - w1 * v];
        (Some(Reflection { tau, v }), Tridiagonal { d, e: [beta, a21 - v * w0 - w1], z })
    }

    /// Rotates until all off-diagonal entries vanish.
    fn diagonalize(&mut self) {
        let (mut first, mut steps) = (0, 0);
        while first < 3 {
            if first > 0 {
                self.e[first - 1] = 0.0;
            }
            let negligible =
                |k: &usize| self.e[*k].abs() <= self.d[*k].abs().sqrt() * self.d[k + 1].abs().sqrt() * UNIT_ROUNDOFF;
            let last = (first..2).find(negligible).unwrap_or(2);
            if last < 2 {
                self.e[last] = 0.0;
            }
            if self.d[last].abs() < self.d[first].abs() {
                self.chase_up(first, last, &mut steps);
            } else {
                self.chase_down(first, last, &mut steps);
            }
            first = last + 1;
        }
    }

    /// Whether the entry `e` next to the diagonal is negligible between the rows `upper` and `lower`.
    fn splits_between(&self, upper: usize, lower: usize, e: f64) -> bool {
        e * e <= UNIT_ROUNDOFF * UNIT_ROUNDOFF * self.d[upper].abs() * self.d[lower].abs() + f64::MIN_POSITIVE
    }

    /// QL steps on rows `l` to `last`; letters as in LAPACK's `dsteqr`.
    fn chase_down(&mut self, mut l: usize, last: usize, steps: &mut usize) {
        while l <= last {
            let m = (l..last).find(|&k| self.splits_between(k, k + 1, self.e[k])).unwrap_or(last);
            if m < last {
                self.e[m] = 0.0;
            }
            if m == l {
                l += 1;
                continue;
            }
            if m == l + 1 {
                self.split_pair(l);
                l += 2;
                continue;
            }
            *steps += 1;
            if *steps > MAX_STEPS {
                return;
            }
            let start = self.d[l];
            let mut g = (self.d[l + 1] - start) / (2.0 * self.e[l]);
            g = self.d[m] - start + self.e[l] / (g + length(g, 1.0).copysign(g));
            let (mut s, mut c, mut p) = (1.0, 1.0, 0.0);
            for i in (l..m).rev() {
                let (f, b) = (s * self.e[i], c * self.e[i]);
                let r;
                (c, s, r) = plane_rotation(g, f);
                if i + 1 != m {
                    self.e[i + 1] = r;
                }
                g = self.d[i + 1] - p;
                let r = (self.d[i] - g) * s + 2.0 * c * b;
                p = s * r;
                self.d[i + 1] = g + p;
                g = c * r - b;
                self.rotate_columns(i, c, -s);
            }
            self.d[l] -= p;
            self.e[l] = g;
        }
    }

    /// QR steps on rows `l` down to `first`; letters as in LAPACK's `dsteqr`.
    fn chase_up(&mut self, first: usize, l: usize, steps: &mut usize) {
        // One more than the present row.
        let mut rows = l + 1;
        while rows > first {
            let l = rows - 1;
            let m = (first + 1..=l).rev().find(|&k| self.splits_between(k, k - 1, self.e[k - 1])).unwrap_or(first);
            if m > first {
                self.e[m - 1] = 0.0;
            }
            if m == l {
                rows -= 1;
                continue;
            }
            if m + 1 == l {
                self.split_pair(m);
                rows -= 2;
                continue;
            }
            *steps += 1;
            if *steps > MAX_STEPS {
                return;
            }
            let start = self.d[l];
            let mut g = (self.d[l - 1] - start) / (2.0 * self.e[l - 1]);
            g = self.d[m] - start + self.e[l - 1] / (g + length(g, 1.0).copysign(g));
            let (mut s, mut c, mut p) = (1.0, 1.0, 0.0);
            for i in m..l {
                let (f, b) = (s * self.e[i], c * self.e[i]);
                let r;
                (c, s, r) = plane_rotation(g, f);
                if i != m {
                    self.e[i - 1] = r;
                }
                g = self.d[i] - p;
                let r = (self.d[i + 1] - g) * s + 2.0 * c * b;
                p = s * r;
                self.d[i] = g + p;
                g = c * r - b;
                self.rotate_columns(i, c, s);
            }
            self.d[l] -= p;
            self.e[l - 1] = g;
        }
    }

    /// Diagonalizes rows k and k + 1, which nothing else couples to: the larger value of the two in magnitude comes first.
    fn split_pair(&mut self, k: usize) {
        let (a, b, d) = (self.d[k], self.e[k], self.d[k + 1]);
        let (sum, difference, twice) = (a + d, a - d, b + b);
        let root = length(difference, twice);
        let (larger, smaller) = if a.abs() > d.abs() { (a, d) } else { (d, a) };
        let other_moment = |first: f64| (larger / first) * smaller - (b / first) * b;
        let (first, second, positive) = if sum < 0.0 {
            let first = 0.5 * (sum - root);
            (first, other_moment(first), false)
        } else if sum > 0.0 {
            let first = 0.5 * (sum + root);
            (first, other_moment(first), true)
        } else {
            (0.5 * root, -0.5 * root, true)
        };
        let same_sign = (difference >= 0.0) == positive;
        let larger_part = if difference >= 0.0 { difference + root } else { difference - root };
        let (mut c, mut s) = if larger_part.abs() > twice.abs() {
            let cot = -twice / larger_part;
            let s = 1.0 / (1.0 + cot * cot).sqrt();
            (cot * s, s)
        } else if twice == 0.0 {
            (1.0, 0.0)
        } else {
            let tan = -larger_part / twice;
            let c = 1.0 / (1.0 + tan * tan).sqrt();
            (c, tan * c)
        };
        if same_sign {
            (c, s) = (-s, c);
        }
        self.rotate_columns(k, c, s);
        (self.d[k], self.d[k + 1], self.e[k]) = (first, second, 0.0);
    }

    /// Applies a rotation to columns j and j + 1 of the product.
    fn rotate_columns(&mut self, j: usize, c: f64, s: f64) {
        for mut row in self.z.row_iter_mut() {
            let (a, b) = (row[j], row[j + 1]);
            (row[j], row[j + 1]) = (s * b + c * a, c * b - s * a);
        }
    }
}

/// √(x² + y²).
fn length(x: f64, y: f64) -> f64 {
    Vector3::new(x, y, 0.0).norm()
}

/// Cosine, sine and length with c f + s g = r, −s f + c g = 0. The cosine is positive if |f| > |g|, else the length is.
fn plane_rotation(f: f64, g: f64) -> (f64, f64, f64) {
    if g == 0.0 {
        return (1.0, 0.0, f);
    }
    if f == 0.0 {
        return (0.0, 1.0, g);
    }
    let r = length(f, g);
    let (c, s) = (f / r, g / r);
    if f.abs() > g.abs() && c < 0.0 { (-c, -s, -r) } else { (c, s, r) }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::bodies::Bodies;
    use crate::dof::Dof;

    fn frame(inertia: [[f64; 3]; 3]) -> PrincipalFrame {
        MassProperties { volume: 1.0, centre: [0.0; 3], inertia }.lmgc90_frame()
    }

    /// BODIES.DAT has tetrahedra, boxes, cubes, prisms and wedges, turned and along the axes, and clusters of balls and of
    /// boxes. LMGC90 2025.rc1 has read it and written DOF.OUT.1 before the first step.
    #[test]
    fn axes_are_those_that_lmgc90_writes() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/lmgc90_axes");
        let bodies = Bodies::read(&folder.join("BODIES.DAT")).unwrap();
        let theirs = Dof::read(&folder.join("DOF.OUT.1")).unwrap();
        assert_eq!((bodies.0.len(), theirs.bodies.len()), (23, 23));
        for (body, dof) in bodies.0.iter().zip(&theirs.bodies) {
            let frame = body.computed_frame(&body.mass_properties().unwrap()).unwrap();
            let difference = (Matrix3::from(frame.axes) - Matrix3::from(dof.axes)).amax();
            // Seven digits; where two moments differ only by rounding of the vertices, it is enlarged.
            assert!(difference < 1e-5 && frame.lmgc90 == AxesMatch::Same, "body {}: {frame:?} {dof:?}", dof.body + 1);
        }
    }

    #[test]
    fn a_matrix_is_rebuilt_from_its_axes() {
        let mut random = 1u64;
        let mut next = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        for case in 0..2000 {
            let mut root = Matrix3::from_fn(|_, _| next());
            if case % 5 == 0 {
                root[(2, 0)] = 0.0;
                root[(2, 1)] = 0.0;
            }
            let mut inertia = root * root.transpose() + Matrix3::from_diagonal_element(0.1);
            if case % 3 == 0 {
                inertia[(0, 2)] = 0.0;
                inertia[(2, 0)] = 0.0;
            }
            let PrincipalFrame { moments, axes, .. } = frame(inertia.into());
            let axes = Matrix3::from(axes).transpose();
            assert!(moments[0] <= moments[1] && moments[1] <= moments[2], "{moments:?}");
            assert!((axes.transpose() * axes - Matrix3::identity()).amax() < 1e-14 && axes.determinant() > 0.0);
            let rebuilt = axes.transpose() * Matrix3::from_diagonal(&moments.into()) * axes;
            assert!((rebuilt - inertia).amax() < 1e-14, "{inertia} {rebuilt}");
        }
    }

    #[test]
    fn where_lmgc90_cannot_be_followed_it_is_said() {
        let dumbbell =
            Matrix3::identity() * 2.0 - Vector3::new(1.0, 2.0, 2.0) * Vector3::new(1.0, 2.0, 2.0).transpose() / 9.0;
        assert_eq!(frame(dumbbell.into()).lmgc90, AxesMatch::Arbitrary);
        assert_eq!(frame([[2.0, 0.5, 0.0], [0.5, 3.0, 0.0], [0.0, 0.0, 4.0]]).lmgc90, AxesMatch::Same);
        // Two plates in a corner: LMGC90 2025.rc1 writes -0.99913, 0, -0.04179 as the first axis, and with the eight digits of
        // this matrix the opposite one.
        let corner = [[0.27767829, 0.0, -0.01188991], [0.0, 0.3014581, 0.0], [-0.01188991, 0.0, 0.56143315]];
        assert_eq!(frame(corner).lmgc90, AxesMatch::ArbitrarySigns);
        // A prism about y, of which LMGC90 2025.rc1 writes the second axis as 0.99984, 0, -0.01770.
        let prism = [
            [1.921177549906505e-3, -7.962109704190422e-21, -2.1462884322409204e-5],
            [-7.962109704190422e-21, 2.231770714004527e-3, -1.0842021724855045e-20],
            [-2.1462884322409204e-5, -1.0842021724855045e-20, 7.113128974313553e-4],
        ];
        assert_eq!(frame(prism).lmgc90, AxesMatch::ArbitrarySigns);
        // A grain of 0.1 mm: LMGC90 would neglect its products of inertia.
        let small =
            |size: f64| frame([[2.0, 0.5, 0.0], [0.5, 2.0, 0.0], [0.0, 0.0, 2.0]].map(|row| row.map(|x| x * size)));
        // Equal moments on the diagonal: which is larger by rounding decides about signs.
        assert_eq!((small(1.0).lmgc90, small(1e-20).lmgc90), (AxesMatch::ArbitrarySigns, AxesMatch::TooSmall));
        assert!((small(1e-20).moments[0] - 1.5e-20).abs() < 1e-34);
    }
}
