//! Exact solution of one contact of a full 3x3 block with all other impulses frozen.

use super::types::{LocalVector, MatrixBlock};

/// A contact's own block prepared for solving: the normal unknown is eliminated, the tangents are the axes of the remaining
/// block.
///
/// With c = W_nT/W_nn and d = W_Tn/W_nn the conditions u_n = 0 and u_T = -s r_T read
///
/// ```text
/// (S + s 1) r_T = -p,   S = W_TT - d W_nT,   p = q_T - d q_n,   r_n = -q_n/W_nn - c . r_T.
/// ```
///
/// s = 0 for sticking; a sliding contact has the s > 0 at which |r_T| = mu r_n. On the axes of its symmetric part, S = [[a,
/// k], [-k, b]] with a >= b: there is no cancellation if b is 0.
#[derive(Debug, Clone, Copy)]
pub struct LocalSolver {
    /// 1/W_nn, kg.
    inverse_nn: f64,
    /// c and d along the axes of S, dimensionless.
    c: [f64; 2],
    d: [f64; 2],
    /// First axis, cosine and sine of its angle to t1.
    axis: [f64; 2],
    /// Numbers of S on its axes, 1/kg.
    a: f64,
    b: f64,
    k: f64,
    /// Start of the search for s: 0, or just above the value at which S + s 1 is singular.
    low: f64,
    /// Value of s for sticking.
    stick: f64,
    /// Coefficient of friction.
    mu: f64,
}

/// Share of the trace of W_TT below which an eigenvalue of S is rounding.
const SINGULAR_SHARE: f64 = 1e-14;

impl LocalSolver {
    /// Prepares the block `w` for solving.
    ///
    /// * `w`: the diagonal block in the order n, t1, t2, 1/kg; symmetric positive semi-definite, or nearly.
    /// * `mu`: friction, 0 or more.
    pub fn new(w: &MatrixBlock, mu: f64) -> Self {
        let inverse_nn = if w[0][0] > 0.0 { 1.0 / w[0][0] } else { 0.0 };
        let d = [w[1][0] * inverse_nn, w[2][0] * inverse_nn];
        let s = [0, 1].map(|i| [0, 1].map(|j| w[i + 1][j + 1] - d[i] * w[0][j + 1]));
        let (mean, half_difference) = (0.5 * (s[0][0] + s[1][1]), 0.5 * (s[0][0] - s[1][1]));
        let (symmetric_part, k) = (0.5 * (s[0][1] + s[1][0]), 0.5 * (s[0][1] - s[1][0]));
        let radius = libm::hypot(half_difference, symmetric_part);
        let (a, b) = (mean + radius, mean - radius);
        let axis = first_axis(half_difference, symmetric_part);
        let rounding = SINGULAR_SHARE * (w[1][1] + w[2][2]);
        let low = if b > rounding { 0.0 } else { rounding - b.min(0.0) };
        // If an eigenvalue is rounding, sticking is only satisfied to rounding, too.
        let stick = if b.abs() > rounding { 0.0 } else { low };
        let c = rotate_to_axis(axis, [w[0][1] * inverse_nn, w[0][2] * inverse_nn]);
        LocalSolver { inverse_nn, c, d: rotate_to_axis(axis, d), axis, a, b, k, low, stick, mu }
    }

    /// Impulse r in N s for the velocity `q` in m/s that the contact has without it: u = W r + q with
    /// 0 <= u_n, r_n, u_n r_n = 0, |r_T| <= mu r_n, and r_T = -mu r_n u_T/|u_T| where u_T is not 0.
    ///
    /// Parting (q_n >= 0) needs no impulse; a contact that can stick does; otherwise psi(s) = mu r_n/|r_T| - 1,
    /// nearly linear, goes from below 0 to infinity over s, and Newton's method in a bracket finds its root.
    /// With strong coupling of n and T there may be more solutions than the one returned. Never
    /// returns a number that is not finite.
    ///
    /// Source for the form in s: P. Alart, A. Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991) 353-375;
    /// psi as in J. Moré, D. Sorensen, SIAM J. Sci. Stat. Comput. 4 (1983) 553-572.
    ///
    /// ```
    /// # use cd_solve::solve::matrix::LocalSolver;
    /// let block = LocalSolver::new(&[[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]], 0.5);
    /// assert_eq!(block.solve([1.0, 3.0, 0.0]), [0.0, 0.0, 0.0]); // parts
    /// assert_eq!(block.solve([-4.0, 2.0, 0.0]), [4.0, -1.0, 0.0]); // sticks
    /// assert_eq!(block.solve([-4.0, 9.0, 0.0]), [4.0, -2.0, 0.0]); // slides
    /// ```
    #[inline(always)]
    pub fn solve(&self, q: LocalVector) -> LocalVector {
        let free_impulse = -q[0] * self.inverse_nn;
        if !(free_impulse > 0.0 && free_impulse < f64::INFINITY) {
            return [0.0; 3];
        }
        if self.mu == 0.0 {
            return [free_impulse, 0.0, 0.0];
        }
        let q_t = rotate_to_axis(self.axis, [q[1], q[2]]);
        let p = [q_t[0] - self.d[0] * q[0], q_t[1] - self.d[1] * q[0]];
        let [n, t1, t2] =
            self.sticking_impulse(free_impulse, p).unwrap_or_else(|| self.sliding_impulse(free_impulse, p));
        let [t1, t2] = rotate_to_axis([self.axis[0], -self.axis[1]], [t1, t2]);
        if [n, t1, t2].iter().all(|x| x.is_finite()) { [n, t1, t2] } else { [free_impulse, 0.0, 0.0] }
    }

    /// Impulse of u = 0 if it is in the cone.
    #[inline(always)]
    fn sticking_impulse(&self, free_impulse: f64, p: [f64; 2]) -> Option<LocalVector> {
        let t = self.tangential_impulse(p, self.stick);
        let n = self.normal_impulse(free_impulse, t);
        (n > 0.0 && t[0] * t[0] + t[1] * t[1] <= (self.mu * n) * (self.mu * n)).then_some([n, t[0], t[1]])
    }

    /// Tangential impulse r_T = -(S + s 1)^-1 p.
    #[inline(always)]
    fn tangential_impulse(&self, p: [f64; 2], s: f64) -> [f64; 2] {
        let (a, b, k) = (self.a + s, self.b + s, self.k);
        let scale = -1.0 / (a * b + k * k);
        [(b * p[0] - k * p[1]) * scale, (a * p[1] + k * p[0]) * scale]
    }

    #[inline(always)]
    fn normal_impulse(&self, free_impulse: f64, t: [f64; 2]) -> f64 {
        free_impulse - self.c[0] * t[0] - self.c[1] * t[1]
    }

    /// Impulse on the edge of the cone.
    fn sliding_impulse(&self, free_impulse: f64, p: [f64; 2]) -> LocalVector {
        let length_of_p = libm::hypot(p[0], p[1]);
        if length_of_p == 0.0 {
            return [free_impulse, 0.0, 0.0];
        }
        let mut low = self.low;
        // |r_T| <= |p|/(s + b) and r_n >= free_impulse - |c| |r_T|; doubled because of rounding.
        let mut high = 2.0 * length_of_p * (1.0 / self.mu + libm::hypot(self.c[0], self.c[1])) / free_impulse + low;
        let mut s = low;
        let mut t = self.tangential_impulse(p, s);
        let mut n = self.normal_impulse(free_impulse, t);
        for _ in 0..100 {
            let length = libm::hypot(t[0], t[1]);
            let psi = self.mu * n / length - 1.0;
            if psi.abs() <= 4.0 * f64::EPSILON {
                break;
            }
            if psi < 0.0 {
                low = s;
            } else {
                high = s;
            }
            let dt = self.tangential_impulse(t, s); // d r_T/ds = -(S + s 1)^-1 r_T
            let dn = -self.c[0] * dt[0] - self.c[1] * dt[1];
            let slope = self.mu * (dn - n * (t[0] * dt[0] + t[1] * dt[1]) / (length * length)) / length;
            let newton_s = s - psi / slope;
            s = if newton_s > low && newton_s < high { newton_s } else { 0.5 * (low + high) };
            if !(s > low && s < high) {
                break; // no number is left in the bracket
            }
            t = self.tangential_impulse(p, s);
            n = self.normal_impulse(free_impulse, t);
        }
        // On the edge of the cone, for any remaining psi.
        let n = n.max(0.0);
        let edge = self.mu * n / libm::hypot(t[0], t[1]);
        [n, t[0] * edge, t[1] * edge]
    }
}

/// Cosine and sine of half the angle of (x, y), or of 0.
fn first_axis(x: f64, y: f64) -> [f64; 2] {
    let size = libm::hypot(x, y);
    if size == 0.0 {
        return [1.0, 0.0];
    }
    let larger = (0.5 * (1.0 + x.abs() / size)).sqrt();
    let smaller = 0.5 * y / (size * larger);
    if x >= 0.0 { [larger, smaller] } else { [smaller.abs(), larger.copysign(y)] }
}

/// Components of `v` along `axis` and across it.
#[inline(always)]
fn rotate_to_axis(axis: [f64; 2], v: [f64; 2]) -> [f64; 2] {
    [axis[0] * v[0] + axis[1] * v[1], axis[0] * v[1] - axis[1] * v[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// W = L L' of numbers of one size, rank 3 or less.
    fn block(l: [f64; 6]) -> MatrixBlock {
        let l = [[l[0], 0.0, 0.0], [l[1], l[2], 0.0], [l[3], l[4], l[5]]];
        std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| l[i][k] * l[j][k]).sum()))
    }

    fn velocity(w: &MatrixBlock, r: LocalVector, q: LocalVector) -> LocalVector {
        std::array::from_fn(|i| q[i] + (0..3).map(|j| w[i][j] * r[j]).sum::<f64>())
    }

    /// Violation of the conditions by r, in velocities and impulses of size 1.
    fn violation(w: &MatrixBlock, q: LocalVector, mu: f64, r: LocalVector) -> f64 {
        let u = velocity(w, r, q);
        let (slip, force) = (u[1].hypot(u[2]), r[1].hypot(r[2]));
        let maximal_dissipation = u[1] * r[1] + u[2] * r[2] + mu * r[0] * slip;
        [-u[0], -r[0], (u[0] * r[0]).abs(), force - mu * r[0], maximal_dissipation.abs() / mu.max(1.0)]
            .into_iter()
            .fold(0.0, f64::max)
    }

    #[test]
    fn what_has_no_answer_gives_a_finite_one() {
        let one = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let zero = [[0.0; 3]; 3];
        let values = [0.0, -0.0, 1.0, -1.0, 1e-310, -1e-310, 1e200, -1e200, f64::NAN, f64::INFINITY, -f64::INFINITY];
        for w in [one, zero, [[1.0; 3]; 3], [[1.0, 9.0, 9.0], [9.0, 1.0, 9.0], [9.0, 9.0, 1.0]], [[1e-300; 3]; 3]] {
            for mu in [0.0, 1e-12, 0.5, 1e12, 1e300] {
                let local = LocalSolver::new(&w, mu);
                for n in values {
                    for t in values {
                        let r = local.solve([n, t, 0.3]);
                        assert!(r.iter().all(|x| x.is_finite()), "{w:?} {mu} {n} {t}: {r:?}");
                    }
                }
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn satisfies_every_condition(
            l in prop::array::uniform6(-1.0..1.0f64),
            rank in 1..4usize,
            q in prop::array::uniform3(-1.0..1.0f64),
            mu in prop_oneof![Just(0.0), 0.0..2.0f64, Just(1e3)],
        ) {
            let mut l = l;
            l[0] += 0.2f64.copysign(l[0]);
            if rank < 3 { l[5] = 0.0; }
            if rank < 2 { l[2] = 0.0; l[4] = 0.0; }
            let w = block(l);
            let q = if rank == 3 {
                prop_assume!(l[2].abs() > 0.05 && l[5].abs() > 0.05);
                q
            } else {
                // A velocity that impulses can cancel: W times a vector.
                velocity(&w, q.map(|x| -x), [0.0; 3])
            };
            let r = LocalSolver::new(&w, mu).solve(q);
            let size = 1.0 + r.iter().fold(0.0f64, |a, x| a.max(x.abs()));
            prop_assert!(violation(&w, q, mu, r) <= 1e-11 * size * size, "{r:?}");
        }

        /// Brute force: no point of a fine grid of the cone is better.
        #[test]
        fn nothing_nearby_is_better(
            l in prop::array::uniform6(0.3..1.0f64),
            q in prop::array::uniform3(-1.0..1.0f64),
            mu in 0.05..1.0f64,
        ) {
            let w = block(l);
            let r = LocalSolver::new(&w, mu).solve(q);
            let here = violation(&w, q, mu, r);
            for n in 0..=20 {
                for ring in 0..=4 {
                    for angle in 0..24 {
                        let n = f64::from(n) / 20.0 * (2.0 * r[0] + 1.0);
                        let (sin, cos) = (f64::from(angle) * std::f64::consts::TAU / 24.0).sin_cos();
                        let t = mu * n * f64::from(ring) / 4.0;
                        prop_assert!(here <= violation(&w, q, mu, [n, t * cos, t * sin]) + 1e-10);
                    }
                }
            }
        }
    }
}
