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
//! | wide | c = 0, 1, 2: derivatives of a harmonic function as [`contract`] reads them | 1 + 3 p (p+1)/2 |
//!
//! Sources: J. Applequist, J. Phys. A 22 (1989) 4303; W. Dehnen, J. Comput. Phys. 179 (2002) 27; P.B. Visscher and
//! D.M. Apalkov, J. Magn. Magn. Mater. 322 (2010) 275.

use crate::math::lanes::Lanes;

/// Numbers in a narrow row.
pub const fn narrow_len(p: usize) -> usize {
    (p + 1) * (p + 1)
}

/// Numbers in a wide row.
pub const fn wide_len(p: usize) -> usize {
    1 + 3 * p * (p + 1) / 2
}

/// Where the coefficients with c derivatives along z of degree q start in a narrow row, by j.
#[inline(always)]
pub const fn narrow(q: usize, c: usize) -> usize {
    q * q + c * (q + 1)
}

/// The same in a wide row.
#[inline(always)]
pub const fn wide(q: usize, c: usize) -> usize {
    let degree = if q == 0 { 0 } else { 1 + 3 * q * (q - 1) / 2 };
    degree + [0, q + 1, 2 * q + 1][c]
}

/// E(v), narrow: degree q is (v . derivative) E_{q-1} / q, reduced.
#[inline(always)]
pub fn exponential<L: Lanes>(l: L, p: usize, [x, y, z]: [L::V; 3], out: &mut [L::V]) {
    out[0] = l.splat(1.0);
    for q in 1..=p {
        let share = l.splat(1.0 / q as f64);
        let (x, y, z) = (l.mul(x, share), l.mul(y, share), l.mul(z, share));
        let (flat, up) = (narrow(q - 1, 0), narrow(q - 1, 1));
        for j in 0..=q {
            let i = q - j;
            let mut e = l.splat(0.0);
            if i >= 1 {
                e = l.mul(x, out[flat + j]);
            }
            if j >= 1 {
                e = l.mul_add(y, out[flat + j - 1], e);
            }
            if i >= 2 {
                e = l.neg_mul_add(z, out[up + j], e);
            }
            if j >= 2 {
                e = l.neg_mul_add(z, out[up + j - 2], e);
            }
            out[narrow(q, 0) + j] = e;
        }
        for j in 0..q {
            let i = q - 1 - j;
            let mut e = l.mul(z, out[flat + j]);
            if i >= 1 {
                e = l.mul_add(x, out[up + j], e);
            }
            if j >= 1 {
                e = l.mul_add(y, out[up + j - 1], e);
            }
            out[narrow(q, 1) + j] = e;
        }
    }
}

/// D(d), wide, for d other than 0:
/// q d^2 D_n + (2q-1) sum_k n_k d_k D_{n-k} + (q-1) sum_k n_k (n_k - 1) D_{n-2k} = 0.
#[inline(always)]
pub fn derivatives<L: Lanes>(l: L, p: usize, [x, y, z]: [L::V; 3], out: &mut [L::V]) {
    let d2 = l.mul_add(x, x, l.mul_add(y, y, l.mul(z, z)));
    let inverse = l.div(l.splat(1.0), d2);
    out[0] = l.sqrt(inverse);
    for q in 1..=p {
        let first = l.mul(inverse, l.splat(-((2 * q - 1) as f64) / q as f64));
        let second = l.mul(inverse, l.splat(-((q - 1) as f64) / q as f64));
        let (x, y, z) = (l.mul(x, first), l.mul(y, first), l.mul(z, first));
        for c in 0..q.min(1) + 1 {
            let (to, one) = (wide(q, c), wide(q - 1, c));
            for j in 0..=q - c {
                let i = q - c - j;
                let mut d = l.splat(0.0);
                if c == 1 {
                    d = l.mul(z, out[wide(q - 1, 0) + j]);
                }
                if i >= 1 {
                    d = l.mul_add(l.mul(x, l.splat(i as f64)), out[one + j], d);
                }
                if j >= 1 {
                    d = l.mul_add(l.mul(y, l.splat(j as f64)), out[one + j - 1], d);
                }
                if i >= 2 {
                    d = l.mul_add(l.mul(second, l.splat((i * (i - 1)) as f64)), out[wide(q - 2, c) + j], d);
                }
                if j >= 2 {
                    d = l.mul_add(l.mul(second, l.splat((j * (j - 1)) as f64)), out[wide(q - 2, c) + j - 2], d);
                }
                out[to + j] = d;
            }
        }
        close(l, q, out);
    }
}

/// Derivatives of degree q with c = 2 from those with c = 0.
#[inline(always)]
fn close<L: Lanes>(l: L, q: usize, out: &mut [L::V]) {
    if q >= 2 {
        let (flat, to) = (wide(q, 0), wide(q, 2));
        for j in 0..q - 1 {
            out[to + j] = l.sub(l.splat(0.0), l.add(out[flat + j], out[flat + j + 2]));
        }
    }
}

/// A narrow row of derivatives, L, made wide.
#[inline(always)]
pub fn widen<L: Lanes>(l: L, p: usize, row: &[L::V], out: &mut [L::V]) {
    for q in 0..=p {
        let len = 2 * q + 1;
        out[wide(q, 0)..][..len].copy_from_slice(&row[narrow(q, 0)..][..len]);
        close(l, q, out);
    }
}

/// Adds sum_m F_{n+m} M_m, |n| + |m| <= p, to each n of `out`; F wide, the others narrow.
/// Without `dipole` the three M of degree 1 count as zero, as about a centre of mass.
#[inline(always)]
pub fn contract<L: Lanes>(l: L, p: usize, dipole: bool, moments: &[L::V], field: &[L::V], out: &mut [L::V]) {
    for n in 0..=p {
        for c in 0..=n.min(1) {
            for j in 0..=n - c {
                let mut sum = out[narrow(n, c) + j];
                for q in 0..=p - n {
                    if q == 1 && !dipole {
                        continue;
                    }
                    let (m, f) = (&moments[narrow(q, 0)..][..q + 1], &field[wide(n + q, c) + j..][..q + 1]);
                    for k in 0..=q {
                        sum = l.mul_add(m[k], f[k], sum);
                    }
                    if q > 0 {
                        let (m, f) = (&moments[narrow(q, 1)..][..q], &field[wide(n + q, c + 1) + j..][..q]);
                        for k in 0..q {
                            sum = l.mul_add(m[k], f[k], sum);
                        }
                    }
                }
                out[narrow(n, c) + j] = sum;
            }
        }
    }
}

/// Adds the product M E to `out`, all narrow: moments about another centre, M E(old centre - new centre) with the sign
/// of a in E(-a) reversed once more.
#[inline(always)]
pub fn shift_moments<L: Lanes>(l: L, p: usize, moments: &[L::V], shift: &[L::V], out: &mut [L::V]) {
    for q in (0..=p).filter(|q| *q != 1) {
        for c in 0..=q.min(1) {
            for j in 0..=q - c {
                let m = moments[narrow(q, c) + j];
                for n in 0..=p - q {
                    for k in 0..=n {
                        let to = narrow(q + n, c) + j + k;
                        out[to] = l.mul_add(m, shift[narrow(n, 0) + k], out[to]);
                    }
                    for k in 0..n {
                        let s = shift[narrow(n, 1) + k];
                        if c == 0 {
                            let to = narrow(q + n, 1) + j + k;
                            out[to] = l.mul_add(m, s, out[to]);
                        } else {
                            let to = narrow(q + n, 0) + j + k;
                            out[to] = l.neg_mul_add(m, s, out[to]);
                            out[to + 2] = l.neg_mul_add(m, s, out[to + 2]);
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::math::lanes::Scalar;

    fn row(len: usize) -> Vec<f64> {
        vec![0.0; len]
    }

    fn e(p: usize, v: Vec3) -> Vec<f64> {
        let mut out = row(narrow_len(p));
        exponential(Scalar, p, [v.x, v.y, v.z], &mut out);
        out
    }

    fn d(p: usize, v: Vec3) -> Vec<f64> {
        let mut out = row(wide_len(p));
        derivatives(Scalar, p, [v.x, v.y, v.z], &mut out);
        out
    }

    #[test]
    fn derivatives_of_low_degree_in_closed_form() {
        let v = Vec3::new(1.0, 2.0, 2.0); // |v| = 3
        let d = d(2, v);
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-15, "{a} {b}");
        close(d[0], 1.0 / 3.0);
        close(d[wide(1, 1)], -2.0 / 27.0);
        close(d[wide(2, 0)], 3.0 / 243.0 - 1.0 / 27.0);
        close(d[wide(2, 1)], 3.0 * 2.0 / 243.0);
        close(d[wide(2, 2)], 3.0 * 4.0 / 243.0 - 1.0 / 27.0);
    }

    /// 1/|d + b - a| through all four operators, with a shift of either centre in the way.
    #[test]
    fn error_falls_with_order() {
        let (far, a, b) = (Vec3::new(4.0, -3.0, 2.0), Vec3::new(0.4, 0.7, -0.3), Vec3::new(-0.5, 0.2, 0.6));
        let (da, db) = (Vec3::new(0.1, -0.3, 0.2), Vec3::new(0.2, 0.1, -0.1));
        let exact = 1.0 / (far + b - a).norm();
        for p in 2..=10 {
            // Two masses of a half, opposite about the first centre: no dipole there.
            let source: Vec<f64> = e(p, -a).iter().zip(e(p, a)).map(|(m, n)| 0.5 * (m + n)).collect();
            let mut moments = row(narrow_len(p));
            shift_moments(Scalar, p, &source, &e(p, -da), &mut moments);
            let mut local = row(narrow_len(p));
            contract(Scalar, p, true, &moments, &d(p, far + da - db), &mut local);
            let mut field = row(wide_len(p));
            widen(Scalar, p, &local, &mut field);
            let mut shifted = row(narrow_len(p));
            contract(Scalar, p, true, &e(p, db), &field, &mut shifted);
            let value: f64 = shifted.iter().zip(e(p, b)).map(|(l, e)| l * e).sum();
            let expected = 0.5 * (exact + 1.0 / (far + b + a).norm());
            let error = ((value - expected) / expected).abs();
            // The masses reach 1/3 of the distance between the centres.
            assert!(error < 0.4f64.powi(p as i32 + 1), "order {p}: {error:e}");
        }
    }
}
