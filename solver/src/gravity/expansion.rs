//! Cartesian expansions of 1/r to total order p, on the (p+1)^2 independent coefficients of harmonic functions.
//!
//! With x = t + b near a target centre t, sources s + a about a source centre s and d = t - s,
//!
//! ```text
//! sum_j m_j / |x - x_j| = sum_n E_n(b) L_n,    L_n = sum_m D_{n+m}(d) M_m,    M_m = sum_j m_j E_m(-a_j),
//! ```
//!
//! where n = (i, j, c) counts derivatives along x, y, z, D_n = d^n (1/|d|) and E_n(v) = v^n / n!. Since 1/r is harmonic,
//! two derivatives along z are minus two along x minus two along y. Coefficients are therefore classes of polynomials in
//! the derivatives modulo their Laplacian, and c = 0, 1 is enough: 25 numbers instead of 35 for p = 4. Truncation is by
//! total order, |n| + |m| <= p, which makes the forces of two cells on each other opposite.
//!
//! | row of numbers | coefficients (q, c, j), q = i + j + c the degree | length |
//! |---|---|---|
//! | narrow | c = 0, 1 of every degree: what is stored | (p+1)^2 |
//! | wide | c = 0, 1, 2: derivatives of a harmonic function as [`contract_moments`] reads them | 1 + 3 p (p+1)/2 |
//!
//! Sources: J. Applequist, J. Phys. A 22 (1989) 4303; W. Dehnen, J. Comput. Phys. 179 (2002) 27; P.B. Visscher and
//! D.M. Apalkov, J. Magn. Magn. Mater. 322 (2010) 275.

use super::settings::HIGHEST_ORDER;
use crate::math::simd::F64Arithmetic;

/// Numbers in a narrow row.
pub const fn narrow_len(p: usize) -> usize {
    (p + 1) * (p + 1)
}

/// Numbers in a wide row.
pub const fn wide_len(p: usize) -> usize {
    1 + 3 * p * (p + 1) / 2
}

/// Narrow row of moments M_n or of coefficients L_n, ordered by [`narrow_index`], with space for the highest order.
pub type NarrowRow<V> = [V; NARROW_LEN];
/// Wide row of derivatives D_n, ordered by [`wide_index`], with space for the highest order.
pub type WideRow<V> = [V; WIDE_LEN];
/// Length of a [`NarrowRow`], in whole lines.
pub const NARROW_LEN: usize = narrow_len(HIGHEST_ORDER).next_multiple_of(8);
/// Length of a [`WideRow`].
pub const WIDE_LEN: usize = wide_len(HIGHEST_ORDER);

/// Start of the coefficients of degree q with c derivatives along z in a narrow row, ordered by j.
#[inline(always)]
pub const fn narrow_index(q: usize, c: usize) -> usize {
    q * q + c * (q + 1)
}

/// Start of the coefficients of degree q with c derivatives along z in a wide row, ordered by j.
#[inline(always)]
pub const fn wide_index(q: usize, c: usize) -> usize {
    let degree = if q == 0 { 0 } else { 1 + 3 * q * (q - 1) / 2 };
    degree + [0, q + 1, 2 * q + 1][c]
}

/// Sum of eight numbers in one fixed order.
#[inline(always)]
pub fn pairwise_sum(parts: &[f64; 8]) -> f64 {
    let [a, b, c, d, e, f, g, h] = *parts;
    ((a + b) + (c + d)) + ((e + f) + (g + h))
}

/// Repeats `$body` for each degree `$q` up to `$last` as a constant, so that the body unrolls without branches.
macro_rules! for_degrees {
    ($q:ident <= $last:expr, $body:block) => {
        $crate::gravity::expansion::for_degrees!(@ $q $last, $body, 0 1 2 3 4 5 6 7 8)
    };
    (@ $q:ident $last:expr, $body:block, $($degree:literal)+) => {
        $(if $degree < $last + 1 {
            const $q: usize = $degree;
            $body
        })+
    };
}
pub(super) use for_degrees;

/// Repeats a body for each line of a row.
macro_rules! for_lines {
    ($line:ident < $end:expr, $body:block) => {
        $crate::gravity::expansion::for_lines!(@ $line $end, $body, 0 1 2 3 4 5 6 7 8 9 10)
    };
    (@ $line:ident $end:expr, $body:block, $($number:literal)+) => {
        $(if $number < $end {
            const $line: usize = $number;
            $body
        })+
    };
}
pub(super) use for_lines;

/// Writes the numbers of a narrow row to order P into columns of eight, from lane `from` on.
#[inline(always)]
pub fn store_row<L: F64Arithmetic, const P: usize>(l: L, row: &NarrowRow<L::V>, from: usize, columns: &mut [[f64; 8]]) {
    for_degrees!(Q <= P, {
        let mut k = narrow_index(Q, 0);
        while k < narrow_index(Q + 1, 0) {
            l.store(&mut columns[k][from..], row[k]);
            k += 1;
        }
    });
}

/// E(v) to order P, narrow: degree q is (v . derivative) E_{q-1} / q, reduced.
#[inline(always)]
pub fn exponential_terms<L: F64Arithmetic, const P: usize>(l: L, v: [L::V; 3], out: &mut NarrowRow<L::V>) {
    out[0] = l.splat(1.0);
    for_degrees!(Q <= P, {
        if Q != 0 {
            exponential_degree::<L, Q>(l, v, out);
        }
    });
}

#[inline(always)]
fn exponential_degree<L: F64Arithmetic, const Q: usize>(l: L, [x, y, z]: [L::V; 3], out: &mut NarrowRow<L::V>) {
    let share = l.splat(1.0 / Q as f64);
    let (x, y, z) = (l.mul(x, share), l.mul(y, share), l.mul(z, share));
    let (flat, up) = (narrow_index(Q - 1, 0), narrow_index(Q - 1, 1));
    let mut j = 0;
    while j <= Q {
        let mut e = if j < Q { l.mul(x, out[flat + j]) } else { l.mul(y, out[flat + j - 1]) };
        if j >= 1 && j < Q {
            e = l.mul_add(y, out[flat + j - 1], e);
        }
        if j + 2 <= Q {
            e = l.neg_mul_add(z, out[up + j], e);
        }
        if j >= 2 {
            e = l.neg_mul_add(z, out[up + j - 2], e);
        }
        out[narrow_index(Q, 0) + j] = e;
        j += 1;
    }
    let mut j = 0;
    while j < Q {
        let mut e = l.mul(z, out[flat + j]);
        if j + 2 <= Q {
            e = l.mul_add(x, out[up + j], e);
        }
        if j >= 1 {
            e = l.mul_add(y, out[up + j - 1], e);
        }
        out[narrow_index(Q, 1) + j] = e;
        j += 1;
    }
}

/// D(d) to order P, wide, for d other than 0:
/// q d^2 D_n + (2q-1) sum_k n_k d_k D_{n-k} + (q-1) sum_k n_k (n_k - 1) D_{n-2k} = 0.
#[inline(always)]
pub fn kernel_derivatives<L: F64Arithmetic, const P: usize>(l: L, [x, y, z]: [L::V; 3], out: &mut WideRow<L::V>) {
    let d2 = l.mul_add(x, x, l.mul_add(y, y, l.mul(z, z)));
    let inverse = l.div(l.splat(1.0), d2);
    out[0] = l.sqrt(inverse);
    for_degrees!(Q <= P, {
        if Q != 0 {
            let first = l.mul(inverse, l.splat(-((2 * Q - 1) as f64) / Q as f64));
            let second = l.mul(inverse, l.splat(-((Q - 1) as f64) / Q as f64));
            let scaled = [l.mul(x, first), l.mul(y, first), l.mul(z, first)];
            derivatives_degree::<L, Q, 0>(l, scaled, second, out);
            derivatives_degree::<L, Q, 1>(l, scaled, second, out);
            close_degree::<L, Q>(l, out);
        }
    });
}

#[inline(always)]
fn derivatives_degree<L: F64Arithmetic, const Q: usize, const C: usize>(
    l: L,
    [x, y, z]: [L::V; 3],
    second: L::V,
    out: &mut WideRow<L::V>,
) {
    let one = wide_index(Q - 1, C);
    let mut j = 0;
    while j <= Q - C {
        let i = Q - C - j;
        let mut d = l.splat(0.0);
        if C == 1 {
            d = l.mul(z, out[wide_index(Q - 1, 0) + j]);
        }
        if i >= 1 {
            d = l.mul_add(l.mul(x, l.splat(i as f64)), out[one + j], d);
        }
        if j >= 1 {
            d = l.mul_add(l.mul(y, l.splat(j as f64)), out[one + j - 1], d);
        }
        if i >= 2 {
            d = l.mul_add(l.mul(second, l.splat((i * (i - 1)) as f64)), out[wide_index(Q - 2, C) + j], d);
        }
        if j >= 2 {
            d = l.mul_add(l.mul(second, l.splat((j * (j - 1)) as f64)), out[wide_index(Q - 2, C) + j - 2], d);
        }
        out[wide_index(Q, C) + j] = d;
        j += 1;
    }
}

/// Derivatives of degree Q with c = 2 from those with c = 0.
#[inline(always)]
fn close_degree<L: F64Arithmetic, const Q: usize>(l: L, out: &mut WideRow<L::V>) {
    let mut j = 0;
    while j + 2 <= Q {
        out[wide_index(Q, 2) + j] =
            l.sub(l.splat(0.0), l.add(out[wide_index(Q, 0) + j], out[wide_index(Q, 0) + j + 2]));
        j += 1;
    }
}

/// Converts a narrow row of derivatives L to a wide row.
#[inline(always)]
pub fn widen_row<L: F64Arithmetic, const P: usize>(l: L, row: &NarrowRow<L::V>, out: &mut WideRow<L::V>) {
    for_degrees!(Q <= P, {
        let mut k = 0;
        while k < 2 * Q + 1 {
            out[wide_index(Q, 0) + k] = row[narrow_index(Q, 0) + k];
            k += 1;
        }
        close_degree::<L, Q>(l, out);
    });
}

/// Adds sum_m F_{n+m} M_m, |n| + |m| <= P, to each n of `out`; F is wide, the others narrow. Without `dipole` the three M
/// of degree 1 count as zero, as they are about a centre of mass.
#[inline(always)]
pub fn contract_moments<L: F64Arithmetic, const P: usize, const DIPOLE: bool>(
    l: L,
    moments: &NarrowRow<L::V>,
    field: &WideRow<L::V>,
    out: &mut NarrowRow<L::V>,
) {
    for_degrees!(N <= P, {
        for_degrees!(Q <= P, {
            if N + Q < P + 1 && (DIPOLE || Q != 1) {
                contract_degrees::<L, N, 0, Q>(l, moments, field, out);
                contract_degrees::<L, N, 1, Q>(l, moments, field, out);
            }
        });
    });
}

#[inline(always)]
fn contract_degrees<L: F64Arithmetic, const N: usize, const C: usize, const Q: usize>(
    l: L,
    moments: &NarrowRow<L::V>,
    field: &WideRow<L::V>,
    out: &mut NarrowRow<L::V>,
) {
    let mut j = 0;
    while j + C <= N {
        let mut sum = out[narrow_index(N, C) + j];
        let mut k = 0;
        while k <= Q {
            sum = l.mul_add(moments[narrow_index(Q, 0) + k], field[wide_index(N + Q, C) + j + k], sum);
            k += 1;
        }
        let mut k = 0;
        while k < Q {
            sum = l.mul_add(moments[narrow_index(Q, 1) + k], field[wide_index(N + Q, C + 1) + j + k], sum);
            k += 1;
        }
        out[narrow_index(N, C) + j] = sum;
        j += 1;
    }
}

/// Adds the product M E to `out`, all narrow: moments about another centre, M E(old centre - new centre), where the sign
/// of a in E(-a) is reversed once more. M of degree 1 counts as zero.
#[inline(always)]
pub fn shift_moments<L: F64Arithmetic, const P: usize>(
    l: L,
    moments: &NarrowRow<L::V>,
    shift: &NarrowRow<L::V>,
    out: &mut NarrowRow<L::V>,
) {
    for_degrees!(Q <= P, {
        for_degrees!(N <= P, {
            if N + Q < P + 1 && Q != 1 {
                shift_degrees::<L, Q, N>(l, moments, shift, out);
            }
        });
    });
}

#[inline(always)]
fn shift_degrees<L: F64Arithmetic, const Q: usize, const N: usize>(
    l: L,
    moments: &NarrowRow<L::V>,
    shift: &NarrowRow<L::V>,
    out: &mut NarrowRow<L::V>,
) {
    let mut j = 0;
    while j <= Q {
        let m = moments[narrow_index(Q, 0) + j];
        let mut k = 0;
        while k <= N {
            let to = narrow_index(Q + N, 0) + j + k;
            out[to] = l.mul_add(m, shift[narrow_index(N, 0) + k], out[to]);
            k += 1;
        }
        let mut k = 0;
        while k < N {
            let to = narrow_index(Q + N, 1) + j + k;
            out[to] = l.mul_add(m, shift[narrow_index(N, 1) + k], out[to]);
            k += 1;
        }
        j += 1;
    }
    let mut j = 0;
    while j < Q {
        let m = moments[narrow_index(Q, 1) + j];
        let mut k = 0;
        while k <= N {
            let to = narrow_index(Q + N, 1) + j + k;
            out[to] = l.mul_add(m, shift[narrow_index(N, 0) + k], out[to]);
            k += 1;
        }
        let mut k = 0;
        while k < N {
            let s = shift[narrow_index(N, 1) + k];
            let to = narrow_index(Q + N, 0) + j + k;
            out[to] = l.neg_mul_add(m, s, out[to]);
            out[to + 2] = l.neg_mul_add(m, s, out[to + 2]);
            k += 1;
        }
        j += 1;
    }
}

/// Potential and its gradient, signed as attraction, of the wide row L at b: E = E(b).
#[inline(always)]
pub fn evaluate_expansion<L: F64Arithmetic, const P: usize>(
    l: L,
    e: &NarrowRow<L::V>,
    field: &WideRow<L::V>,
) -> [L::V; 4] {
    let mut sums = [l.splat(0.0); 4];
    for_degrees!(Q <= P, {
        evaluate_degree::<L, P, Q, 0>(l, e, field, &mut sums);
        evaluate_degree::<L, P, Q, 1>(l, e, field, &mut sums);
    });
    sums
}

#[inline(always)]
fn evaluate_degree<L: F64Arithmetic, const P: usize, const Q: usize, const C: usize>(
    l: L,
    e: &NarrowRow<L::V>,
    field: &WideRow<L::V>,
    sums: &mut [L::V; 4],
) {
    let mut j = 0;
    while j + C <= Q {
        let value = e[narrow_index(Q, C) + j];
        sums[3] = l.mul_add(value, field[wide_index(Q, C) + j], sums[3]);
        if Q < P {
            sums[0] = l.mul_add(value, field[wide_index(Q + 1, C) + j], sums[0]);
            sums[1] = l.mul_add(value, field[wide_index(Q + 1, C) + j + 1], sums[1]);
            sums[2] = l.mul_add(value, field[wide_index(Q + 1, C + 1) + j], sums[2]);
        }
        j += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::math::simd::Scalar;

    fn narrow_row() -> NarrowRow<f64> {
        [0.0; _]
    }

    fn wide_row() -> WideRow<f64> {
        [0.0; _]
    }

    fn e<const P: usize>(v: Vec3) -> NarrowRow<f64> {
        let mut out = narrow_row();
        exponential_terms::<_, P>(Scalar, [v.x, v.y, v.z], &mut out);
        out
    }

    fn d<const P: usize>(v: Vec3) -> WideRow<f64> {
        let mut out = wide_row();
        kernel_derivatives::<_, P>(Scalar, [v.x, v.y, v.z], &mut out);
        out
    }

    #[test]
    fn derivatives_of_low_degree_in_closed_form() {
        let v = Vec3::new(1.0, 2.0, 2.0); // |v| = 3
        let d = d::<2>(v);
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-15, "{a} {b}");
        close(d[0], 1.0 / 3.0);
        close(d[wide_index(1, 1)], -2.0 / 27.0);
        close(d[wide_index(2, 0)], 3.0 / 243.0 - 1.0 / 27.0);
        close(d[wide_index(2, 1)], 3.0 * 2.0 / 243.0);
        close(d[wide_index(2, 2)], 3.0 * 4.0 / 243.0 - 1.0 / 27.0);
    }

    /// 1/|d + b - a| and its gradient through all operators, with a shift of either centre.
    #[test]
    fn error_falls_with_order() {
        for_degrees!(P <= HIGHEST_ORDER, {
            if P.checked_sub(2).is_some() {
                error_at::<P>();
            }
        });
    }

    fn error_at<const P: usize>() {
        let (far, a, b) = (Vec3::new(4.0, -3.0, 2.0), Vec3::new(0.4, 0.7, -0.3), Vec3::new(-0.5, 0.2, 0.6));
        let (da, db) = (Vec3::new(0.1, -0.3, 0.2), Vec3::new(0.2, 0.1, -0.1));
        // Two masses of a half, opposite about the first centre: their dipole is zero.
        let (one, two) = (e::<P>(-a), e::<P>(a));
        let source = std::array::from_fn(|k| 0.5 * (one[k] + two[k]));
        let mut moments = narrow_row();
        shift_moments::<_, P>(Scalar, &source, &e::<P>(-da), &mut moments);
        let mut local = narrow_row();
        contract_moments::<_, P, true>(Scalar, &moments, &d::<P>(far + da - db), &mut local);
        let mut field = wide_row();
        widen_row::<_, P>(Scalar, &local, &mut field);
        let mut shifted = narrow_row();
        contract_moments::<_, P, true>(Scalar, &e::<P>(db), &field, &mut shifted);
        widen_row::<_, P>(Scalar, &shifted, &mut field);
        let [x, y, z, value] = evaluate_expansion::<_, P>(Scalar, &e::<P>(b), &field);
        let ends = [far + b - a, far + b + a];
        let expected: f64 = ends.iter().map(|d| 0.5 / d.norm()).sum();
        let slope: Vec3 = ends.iter().map(|d| d * (-0.5 / d.norm().powi(3))).sum();
        // The masses reach 1/3 of the distance between the centres.
        let error = ((value - expected) / expected).abs();
        assert!(error < 0.4f64.powi(P as i32 + 1), "order {P}: {error:e}");
        let error = (Vec3::new(x, y, z) - slope).norm() / slope.norm();
        assert!(error < 0.4f64.powi(P as i32), "order {P}: {error:e}");
    }
}
