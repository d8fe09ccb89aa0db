//! Exact solution of one contact of a full symmetric 3x3 block, in all lanes at once.

use nalgebra::Matrix3;

use crate::assemble::{BlockData, ContactProblem};
use crate::math::Vec3;
use crate::math::simd::{Arithmetic, LaneFloat, Scalar};
use crate::solve::gauss_seidel::vector::{cross_add, dot_product, triple};

/// Axes and numbers of a contact's own block W. The normal unknown is eliminated, and the tangents are the principal axes of
/// the remaining block, so that with c = W_nT/W_nn
///
/// ```text
/// W = [ w_nn,  w_nn c' ; w_nn c,  diag(s1, s2) + w_nn c c' ].
/// ```
#[derive(Debug, Clone, Copy)]
pub struct LocalBlock<V> {
    /// Inverse of W_nn, kg.
    pub inverse_nn: V,
    /// c = W_nT/W_nn, dimensionless.
    pub c: [V; 2],
    /// s1, s2, 1/kg, at least `MIN_TANGENT_SHARE` of w_nn; and their inverses, kg.
    pub s: [V; 2],
    pub inverse_s: [V; 2],
    /// Coefficient of friction mu.
    pub friction: V,
}

/// Components xx, xy, xz, yy, yz and zz of a symmetric matrix.
pub type Symmetric<V> = [V; 6];

/// Arm and inertia of a body at one of its contacts, world frame.
#[derive(Debug, Clone, Copy)]
pub struct BodySide<V> {
    /// Vector from its centre to the contact point, m.
    pub arm: [V; 3],
    /// Inverse mass along each axis, 1/kg.
    pub inverse_mass: [V; 3],
    /// Inverse inertia about its centre, 1/(kg m^2).
    pub inverse_inertia: Symmetric<V>,
}

impl BodySide<f64> {
    /// Data of a body of row `k`, with `side` 0 for the candidate and 1 for the antagonist.
    pub fn from_row(problem: &ContactProblem, block_data: &BlockData, k: usize, side: usize) -> Self {
        let body = problem.rows[k].bodies[side].index();
        let inverse_mass = block_data.free_axes(body) * problem.bodies[body].inverse_mass;
        BodySide {
            arm: block_data.arms[k][side].into(),
            inverse_mass: inverse_mass.into(),
            inverse_inertia: symmetric_components(&block_data.inverse_inertia[body]),
        }
    }
}

/// Components of a symmetric matrix, from its upper triangle.
pub fn symmetric_components(m: &Matrix3<f64>) -> Symmetric<f64> {
    [m.m11, m.m12, m.m13, m.m22, m.m23, m.m33]
}

/// Block W, 1/kg: the sum over both bodies of 1/m + A' J^-1 A, where A x is the arm times x.
#[inline(always)]
pub fn delassus_block<L: Arithmetic>(l: L, [a, b]: [BodySide<L::V>; 2]) -> Symmetric<L::V> {
    let (a, b) = (side_block(l, a), side_block(l, b));
    [l.add(a[0], b[0]), l.add(a[1], b[1]), l.add(a[2], b[2]), l.add(a[3], b[3]), l.add(a[4], b[4]), l.add(a[5], b[5])]
}

/// Part of one body in [`delassus_block`].
#[inline(always)]
fn side_block<L: Arithmetic>(l: L, side: BodySide<L::V>) -> Symmetric<L::V> {
    let BodySide { arm: [x, y, z], inverse_mass, inverse_inertia: [xx, xy, xz, yy, yz, zz] } = side;
    // Columns of J^-1 A that are needed.
    let column_x = [difference_of_products(l, [yy, z], [yz, y]), difference_of_products(l, [yz, z], [zz, y])];
    let column_y = [
        difference_of_products(l, [xz, x], [xx, z]),
        difference_of_products(l, [yz, x], [xy, z]),
        difference_of_products(l, [zz, x], [xz, z]),
    ];
    let column_z = [
        difference_of_products(l, [xx, y], [xy, x]),
        difference_of_products(l, [xy, y], [yy, x]),
        difference_of_products(l, [xz, y], [yz, x]),
    ];
    [
        l.add(inverse_mass[0], difference_of_products(l, [z, column_x[0]], [y, column_x[1]])),
        difference_of_products(l, [z, column_y[1]], [y, column_y[2]]),
        difference_of_products(l, [z, column_z[1]], [y, column_z[2]]),
        l.add(inverse_mass[1], difference_of_products(l, [x, column_y[2]], [z, column_y[0]])),
        difference_of_products(l, [x, column_z[2]], [z, column_z[0]]),
        l.add(inverse_mass[2], difference_of_products(l, [y, column_z[0]], [x, column_z[1]])),
    ]
}

/// Contribution of the friction lever e = n×d of a contact to W, 1/kg: with z = (J⁻¹ n)×arm, e z' + z e' + n'J⁻¹n e e' of
/// both bodies.
#[inline(always)]
pub fn lever_block<L: Arithmetic>(l: L, sides: &[BodySide<L::V>; 2], n: [L::V; 3], e: [L::V; 3]) -> Symmetric<L::V> {
    let zero = l.splat(0.0);
    let mut z = [zero; 3];
    let mut normal_response = zero;
    for side in sides {
        let j = symmetric_product(l, side.inverse_inertia, n);
        z = cross_add(l, j, side.arm, z);
        normal_response = l.add(normal_response, dot_product(l, n, j));
    }
    let half = l.mul(l.splat(0.5), normal_response);
    let z = triple!(k => l.mul_add(half, e[k], z[k]));
    let pair = |i: usize, k: usize| l.mul_add(e[i], z[k], l.mul(z[i], e[k]));
    [pair(0, 0), pair(0, 1), pair(0, 2), pair(1, 1), pair(1, 2), pair(2, 2)]
}

/// Block W of row `k`.
pub fn delassus_block_of_row(problem: &ContactProblem, block_data: &BlockData, k: usize) -> Symmetric<f64> {
    let sides = [0, 1].map(|side| BodySide::from_row(problem, block_data, k, side));
    let n = problem.rows[k].normal;
    let w = delassus_block(Scalar, sides);
    if block_data.friction_offsets.is_empty() {
        return w;
    }
    let lever_part = lever_block(Scalar, &sides, n.into(), block_data.friction_lever(k, &n).into());
    [0, 1, 2, 3, 4, 5].map(|k| w[k] + lever_part[k])
}

/// Product of two numbers minus the product of two others.
#[inline(always)]
fn difference_of_products<L: Arithmetic>(l: L, a: [L::V; 2], b: [L::V; 2]) -> L::V {
    l.neg_mul_add(b[0], b[1], l.mul(a[0], a[1]))
}

/// Product of a symmetric matrix with a vector.
#[inline(always)]
fn symmetric_product<L: Arithmetic>(l: L, [xx, xy, xz, yy, yz, zz]: Symmetric<L::V>, v: [L::V; 3]) -> [L::V; 3] {
    [dot_product(l, [xx, xy, xz], v), dot_product(l, [xy, yy, yz], v), dot_product(l, [xz, yz, zz], v)]
}

/// The axes of [`LocalBlock`], normal and tangents, in the world frame, with c and s.
#[derive(Debug, Clone, Copy)]
pub struct BlockAxes<V> {
    /// Unit vectors n, t1 and t2.
    pub axes: [[V; 3]; 3],
    /// c and s as in [`LocalBlock`].
    pub c: [V; 2],
    pub s: [V; 2],
}

/// Smallest s1 and s2, as a share of w_nn. With this value rounding of imposed velocities, 1e-16 of them, causes no friction.
/// Contacts with a movable body have more, whatever its shape: 1/m of (1 + m l²/J)/m.
const MIN_TANGENT_SHARE: f64 = 1e-10;

/// Axes of a block with the given normal.
#[inline(always)]
pub fn block_axes<L: Arithmetic>(l: L, w: Symmetric<L::V>, normal: [L::V; 3]) -> BlockAxes<L::V> {
    let (zero, half, one) = (l.splat(0.0), l.splat(0.5), l.splat(1.0));
    let [n, t1, t2] = lane_frame(l, normal);
    let (wn, w1, w2) = (symmetric_product(l, w, n), symmetric_product(l, w, t1), symmetric_product(l, w, t2));
    let w_nn = dot_product(l, n, wn);
    let w_nt = [dot_product(l, t1, wn), dot_product(l, t2, wn)];
    let c = [l.div(w_nt[0], w_nn), l.div(w_nt[1], w_nn)];
    // The block of the tangents after the elimination.
    let off_diagonal = l.neg_mul_add(c[0], w_nt[1], dot_product(l, t1, w2));
    let first = l.neg_mul_add(c[0], w_nt[0], dot_product(l, t1, w1));
    let second = l.neg_mul_add(c[1], w_nt[1], dot_product(l, t2, w2));
    let (mean, half_difference) = (l.mul(half, l.add(first, second)), l.mul(half, l.sub(first, second)));
    let radius = l.sqrt(l.mul_add(half_difference, half_difference, l.mul(off_diagonal, off_diagonal)));
    // Half the angle of (half_difference, off_diagonal) turns t1 to the larger axis. Of its two parts, the larger is
    // computed without cancellation.
    let larger_part = l.sqrt(l.mul(half, l.add(one, l.div(l.abs(half_difference), radius))));
    let smaller_part = l.div(l.mul(half, off_diagonal), l.mul(radius, larger_part));
    let signed_larger_part = l.select_greater(zero, off_diagonal, l.sub(zero, larger_part), larger_part);
    let cos = l.select_greater(zero, half_difference, l.abs(smaller_part), larger_part);
    let sin = l.select_greater(zero, half_difference, signed_larger_part, smaller_part);
    let (cos, sin) = (l.select_greater(radius, zero, cos, one), l.select_greater(radius, zero, sin, zero));
    // The smaller one without cancellation. No eigenvalue is below the inverse masses that W has along every axis, except
    // where both bodies are driven in part: along a direction in which neither can move, W is 0.
    let min_s = l.mul(l.splat(MIN_TANGENT_SHARE), w_nn);
    let larger = l.add(mean, radius);
    let larger = l.select_greater(larger, min_s, larger, min_s);
    let smaller = l.div(difference_of_products(l, [first, second], [off_diagonal, off_diagonal]), larger);
    let smaller = l.select_greater(smaller, min_s, smaller, min_s);
    let larger_axis = triple!(k => l.mul_add(t1[k], cos, l.mul(t2[k], sin)));
    let smaller_axis = triple!(k => difference_of_products(l, [t2[k], cos], [t1[k], sin]));
    let c = [l.mul_add(c[0], cos, l.mul(c[1], sin)), difference_of_products(l, [c[1], cos], [c[0], sin])];
    BlockAxes { axes: [n, larger_axis, smaller_axis], c, s: [larger, smaller] }
}

/// [`local_frame`](crate::math::local_frame) in lanes.
#[inline(always)]
fn lane_frame<L: Arithmetic>(l: L, n: [L::V; 3]) -> [[L::V; 3]; 3] {
    let (zero, one) = (l.splat(0.0), l.splat(1.0));
    let sign = l.select_greater(zero, n[2], l.splat(-1.0), one);
    let a = l.div(l.splat(-1.0), l.add(sign, n[2]));
    let b = l.mul(l.mul(n[0], n[1]), a);
    let signed = l.mul(sign, n[0]);
    let t = [l.mul_add(l.mul(signed, n[0]), a, one), l.mul(sign, b), l.sub(zero, signed)];
    let s = [b, l.mul_add(l.mul(n[1], n[1]), a, sign), l.sub(zero, n[1])];
    [n, t, s]
}

/// r̂ that solves one contact of the block `w`, where û is `u` with the impulse `r` applied; world frame.
pub fn solve_contact_block(w: Symmetric<f64>, normal: Vec3, friction: f64, u: &Vec3, r: &Vec3) -> Vec3 {
    let BlockAxes { axes, c, s } = block_axes(Scalar, w, normal.into());
    let axes = axes.map(Vec3::from);
    let components = |v: &Vec3| [0, 1, 2].map(|k| axes[k].dot(v));
    let inverse_nn = 1.0 / normal.dot(&(full_matrix(w) * normal));
    let block = LocalBlock { inverse_nn, c, s, inverse_s: s.map(f64::recip), friction };
    let (new, _) = signorini_coulomb_block(Scalar, &block, components(u), components(r), 0.0);
    axes[0] * new[0] + axes[1] * new[1] + axes[2] * new[2]
}

/// Matrix of the six components of a symmetric one.
pub fn full_matrix([xx, xy, xz, yy, yz, zz]: Symmetric<f64>) -> Matrix3<f64> {
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

/// Largest number of iterations: Newton's method takes two or three, sixty bisections of the bracket would suffice as well.
const MAX_ITERATIONS: usize = 60;

/// Impulse r that solves one contact with Signorini's condition and Coulomb's law, and the multiplier of its sliding.
///
/// * `u`: û with the impulse `y` applied, m/s; `y`, N s; components along n and the block's two axes.
/// * `guess`: the multiplier found before, divided by w_nn; 0 if there is none.
///
/// A contact that would part without an impulse gets none; one that can stick does, u = 0; else it slides, u_n = 0 and u_T =
/// -w_nn s r_T, where s > 0 is the root of psi(s) = mu r_n/|r_T| - 1. psi increases from below 0 to infinity and is nearly
/// linear: Newton's method in a bracket. Lanes that have converged wait for the others unchanged, so that the result is the
/// same at all widths, bit for bit. It is always finite.
///
/// Sources: P. Alart, A. Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991) 353-375; psi as in J. Moré, D. Sorensen,
/// SIAM J. Sci. Stat. Comput. 4 (1983) 553-572.
#[inline(always)]
pub fn signorini_coulomb_block<L: Arithmetic>(
    l: L,
    block: &LocalBlock<L::V>,
    u: [L::V; 3],
    y: [L::V; 3],
    guess: L::V,
) -> ([L::V; 3], L::V) {
    let LocalBlock { inverse_nn, c, s: principal, inverse_s, friction } = *block;
    let (zero, one) = (l.splat(0.0), l.splat(1.0));
    // s1 and s2 are `principal`. `free` is the normal impulse of u_n = 0 without the contact's own impulse, and p the
    // tangential velocity that remains to be stopped.
    let free = l.neg_mul_add(u[0], inverse_nn, l.mul_add(c[0], y[1], l.mul_add(c[1], y[2], y[0])));
    let p = [
        l.neg_mul_add(principal[0], y[1], l.neg_mul_add(c[0], u[0], u[1])),
        l.neg_mul_add(principal[1], y[2], l.neg_mul_add(c[1], u[0], u[2])),
    ];
    let stick = [l.neg_mul_add(p[0], inverse_s[0], zero), l.neg_mul_add(p[1], inverse_s[1], zero)];
    let stick_n = l.neg_mul_add(c[0], stick[0], l.neg_mul_add(c[1], stick[1], free));
    let bound = l.mul(friction, stick_n);
    let outside = l.neg_mul_add(bound, bound, l.mul_add(stick[0], stick[0], l.mul(stick[1], stick[1])));
    let outside = l.select_greater(stick_n, zero, outside, one);
    // 1 where the contact slides with friction.
    let slides = l.select_greater(outside, zero, l.select_greater(friction, zero, one, zero), zero);
    let slides = l.select_greater(free, zero, slides, zero);

    let mut t = stick;
    let mut n = stick_n;
    let mut multiplier = zero;
    if l.mask_greater(slides, zero) != 0 {
        // Divided by w_nn, so that all are impulses and pure numbers.
        let p = [l.mul(p[0], inverse_nn), l.mul(p[1], inverse_nn)];
        let principal = [l.mul(principal[0], inverse_nn), l.mul(principal[1], inverse_nn)];
        let inverse_friction = l.div(one, friction);
        let size = l.sqrt(l.mul_add(p[0], p[0], l.mul(p[1], p[1])));
        let coupling = l.add(l.abs(c[0]), l.abs(c[1]));
        // |r_T| <= |p|/s and r_n >= free - |c| |r_T|; doubled because of rounding.
        let ratio = l.div(l.add(size, size), free);
        let mut high = l.mul(ratio, l.add(coupling, inverse_friction));
        let mut low = zero;
        // Exact if s1 = s2 and there is no coupling.
        let mean = l.mul(l.splat(0.5), l.add(principal[0], principal[1]));
        let uncoupled = l.sub(l.mul(l.mul(l.splat(0.5), ratio), inverse_friction), mean);
        let start = l.select_greater(guess, zero, guess, uncoupled);
        let inside = l.select_greater(start, low, start, l.mul(l.splat(0.5), high));
        let mut s = l.select_greater(high, inside, inside, l.mul(l.splat(0.5), high));
        let mut waits = slides;
        // At so small a |psi| one more step of Newton's method is the last: the remaining error is its square.
        let near = L::T::SQRT_EPSILON;
        let near2 = l.splat(near * near);
        for _ in 0..MAX_ITERATIONS {
            let SlidingState { e, d, r, n, square, length } = sliding_state(l, principal, p, c, free, s);
            let miss = l.sub(l.mul(friction, n), length); // psi |r|
            // psi / slope with one division.
            let f = [l.mul(r[0], e[1]), l.mul(r[1], e[0])];
            let along = l.mul_add(r[0], f[0], l.mul(r[1], f[1]));
            let across = l.mul_add(c[0], f[0], l.mul(c[1], f[1]));
            let slope = l.neg_mul_add(across, square, l.mul(n, along));
            let fall = l.mul(l.mul(square, miss), l.mul(d, inverse_friction));
            low = l.select_greater(zero, miss, s, low);
            high = l.select_greater(zero, miss, high, s);
            let newton = l.sub(s, l.div(fall, slope));
            let middle = l.mul(l.splat(0.5), l.add(low, high));
            let next = l.select_greater(newton, low, l.select_greater(high, newton, newton, middle), middle);
            // A bracket without numbers inside also ends the search.
            let open = l.select_greater(next, low, l.select_greater(high, next, waits, zero), zero);
            let (far, near) = (l.mul(miss, miss), l.mul(near2, square));
            s = l.select_greater(waits, zero, l.select_greater(far, near, next, newton), s);
            waits = l.select_greater(far, near, open, zero);
            if l.mask_greater(waits, zero) == 0 {
                break;
            }
        }
        let SlidingState { d, r, n: push, length, .. } = sliding_state(l, principal, p, c, free, s);
        let push = l.div(push, d);
        let push = l.select_greater(push, zero, push, zero);
        // On the edge of the cone, for any remaining psi.
        let edge = l.div(l.mul(friction, push), length);
        n = l.select_greater(slides, zero, push, n);
        for k in 0..2 {
            t[k] = l.select_greater(slides, zero, l.neg_mul_add(r[k], edge, zero), t[k]);
        }
        multiplier = l.select_greater(slides, zero, s, zero);
    }
    // Neither stick nor slide: no friction, or no normal impulse; infinite or NaN impulses are rejected.
    let push = l.select_greater(free, zero, l.select_greater(l.splat(f64::MAX), free, free, zero), zero);
    let sum = l.mul(l.add(n, l.add(t[0], t[1])), zero);
    let sound = l.select_greater(one, sum, l.select_greater(friction, zero, push, zero), zero);
    let r = [
        l.select_greater(sound, zero, n, push),
        l.select_greater(sound, zero, t[0], zero),
        l.select_greater(sound, zero, t[1], zero),
    ];
    (r, multiplier)
}

/// State of a sliding contact with the multiplier s: with e = s_T + s and d = e1 e2, -r_T = `r`/d and r_n = `n`/d.
struct SlidingState<V> {
    e: [V; 2],
    d: V,
    r: [V; 2],
    n: V,
    /// |r|² and |r|, of `r` above.
    square: V,
    length: V,
}

/// State with the multiplier `s`; the other arguments as in [`signorini_coulomb_block`], divided by w_nn.
#[inline(always)]
fn sliding_state<L: Arithmetic>(
    l: L,
    principal: [L::V; 2],
    p: [L::V; 2],
    c: [L::V; 2],
    free: L::V,
    s: L::V,
) -> SlidingState<L::V> {
    let e = [l.add(principal[0], s), l.add(principal[1], s)];
    let d = l.mul(e[0], e[1]);
    let r = [l.mul(p[0], e[1]), l.mul(p[1], e[0])];
    let n = l.mul_add(c[0], r[0], l.mul_add(c[1], r[1], l.mul(free, d)));
    let square = l.mul_add(r[0], r[0], l.mul(r[1], r[1]));
    SlidingState { e, d, r, n, square, length: l.sqrt(square) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::simd::{Scalar, ScalarF32};
    use crate::solve::matrix::LocalSolver;
    use proptest::prelude::*;

    type Triple = [f64; 3];

    fn matrix(w_nn: f64, c: [f64; 2], s: [f64; 2]) -> [Triple; 3] {
        let (x, y) = (w_nn * c[0], w_nn * c[1]);
        [[w_nn, x, y], [x, s[0] + x * c[0], x * c[1]], [y, x * c[1], s[1] + y * c[1]]]
    }

    fn velocity(w: &[Triple; 3], r: Triple, q: Triple) -> Triple {
        std::array::from_fn(|i| q[i] + (0..3).map(|j| w[i][j] * r[j]).sum::<f64>())
    }

    fn solve(w_nn: f64, c: [f64; 2], s: [f64; 2], mu: f64, q: Triple, y: Triple, guess: f64) -> (Triple, f64) {
        let w = matrix(w_nn, c, s);
        let block = LocalBlock { inverse_nn: 1.0 / w_nn, c, s, inverse_s: s.map(|s| 1.0 / s), friction: mu };
        signorini_coulomb_block(Scalar, &block, velocity(&w, y, q), y, guess)
    }

    /// Solution in single precision, for blocks whose numbers are exact in it; without an impulse before.
    fn solve_single(w_nn: f64, c: [f64; 2], s: [f64; 2], mu: f64, q: Triple, guess: f64) -> Triple {
        let short = |x: [f64; 2]| x.map(|x| x as f32);
        let inverse_s = short(s.map(|s| 1.0 / s));
        let block =
            LocalBlock { inverse_nn: (1.0 / w_nn) as f32, c: short(c), s: short(s), inverse_s, friction: mu as f32 };
        let (r, _) = signorini_coulomb_block(ScalarF32, &block, q.map(|q| q as f32), [0.0; 3], guess as f32);
        r.map(f64::from)
    }

    /// Violation of the conditions by r, in velocities and impulses of size 1.
    fn violation(w: &[Triple; 3], q: Triple, mu: f64, r: Triple) -> f64 {
        let u = velocity(w, r, q);
        let (slip, force) = (u[1].hypot(u[2]), r[1].hypot(r[2]));
        let dissipation = u[1] * r[1] + u[2] * r[2] + mu * r[0] * slip;
        [-u[0], -r[0], (u[0] * r[0]).abs(), force - mu * r[0], dissipation.abs() / mu.max(1.0)]
            .into_iter()
            .fold(0.0, f64::max)
    }

    #[test]
    fn every_branch_by_hand() {
        let alone = |mu, q| solve(1.0, [0.0; 2], [2.0, 2.0], mu, q, [0.0; 3], 0.0).0;
        assert_eq!(alone(0.5, [1.0, 3.0, 0.0]), [0.0; 3]); // parts
        assert_eq!(alone(0.5, [-4.0, 2.0, 0.0]), [4.0, -1.0, 0.0]); // sticks
        assert_eq!(alone(0.5, [-4.0, 9.0, 0.0]), [4.0, -2.0, 0.0]); // slides
        assert_eq!(alone(0.0, [-4.0, 9.0, 0.0]), [4.0, 0.0, 0.0]); // has no friction
        assert_eq!(alone(0.5, [-4.0, 0.0, 0.0]), [4.0, 0.0, 0.0]); // impact along the normal
    }

    #[test]
    fn what_has_no_answer_gives_a_finite_one() {
        let values = [0.0, -0.0, 1.0, -1.0, 1e-310, -1e-310, 1e200, -1e200, f64::NAN, f64::INFINITY, -f64::INFINITY];
        for c in [[0.0; 2], [9.0, -9.0], [1e150, 0.0]] {
            for s in [[1.0, 1.0], [1e300, 1e-300], [f64::MIN_POSITIVE; 2]] {
                for mu in [0.0, 1e-300, 0.5, 1e12, 1e300] {
                    for (n, t) in values.into_iter().flat_map(|n| values.map(|t| (n, t))) {
                        for guess in [0.0, 1.0, 1e300, f64::INFINITY, f64::NAN] {
                            let block =
                                LocalBlock { inverse_nn: 1.0, c, s, inverse_s: s.map(|s| 1.0 / s), friction: mu };
                            let (r, _) = signorini_coulomb_block(Scalar, &block, [n, t, 0.3], [0.0; 3], guess);
                            assert!(r.iter().all(|x| x.is_finite()), "{c:?} {s:?} {mu} {n} {t} {guess}: {r:?}");
                            let r = solve_single(1.0, c, s, mu, [n, t, 0.3], guess);
                            assert!(r.iter().all(|x| x.is_finite()), "{c:?} {s:?} {mu} {n} {t} {guess}: {r:?}");
                        }
                    }
                }
            }
        }
    }

    /// Masses and velocities of any size: impulses scale with velocity / W.
    #[test]
    fn no_unit_matters() {
        let (w_nn, c, s, q) = (0.7, [0.4, -0.3], [0.9, 0.2], [-1.0, 0.8, -0.5]);
        let (expected, _) = solve(w_nn, c, s, 0.3, q, [0.0; 3], 0.0);
        assert!((expected[1].hypot(expected[2]) - 0.3 * expected[0]).abs() < 1e-15, "slides: {expected:?}");
        for mass in [1e-60, 1e-20, 1e20, 1e60] {
            for speed in [1e-12, 1e6] {
                let q = q.map(|q| q * speed);
                let (r, _) = solve(w_nn / mass, c, s.map(|s| s / mass), 0.3, q, [0.0; 3], 0.0);
                // The multiplier is known to 1e-16.
                assert!((0..3).all(|k| (r[k] / (mass * speed) - expected[k]).abs() < 1e-14), "{mass} {speed}: {r:?}");
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3000))]

        /// The block is the response of one body after the other, and its axes transform it into the form of [`LocalBlock`].
        #[test]
        fn a_block_has_its_form_on_its_axes(
            arms in prop::array::uniform2(prop::array::uniform3(-1.0..1.0f64)),
            roots in prop::array::uniform2(prop::array::uniform9(-1.0..1.0f64)),
            inverse_mass in prop::array::uniform2(prop::array::uniform3(0.1..1.0f64)),
            normal in prop::array::uniform3(-1.0..1.0f64).prop_filter("has a direction", |n| Vec3::from(*n).norm() > 0.1),
        ) {
            let inertia = roots.map(|root| Matrix3::from_column_slice(&root));
            let inertia = inertia.map(|root| root * root.transpose());
            let side = |k: usize| {
                BodySide { arm: arms[k], inverse_mass: inverse_mass[k], inverse_inertia: symmetric_components(&inertia[k]) }
            };
            let w = super::full_matrix(delassus_block(Scalar, [side(0), side(1)]));
            let n = Vec3::from(normal).normalize();
            for r in [Vec3::x(), Vec3::y(), Vec3::z()] {
                let of = |k: usize| {
                    let arm = Vec3::from(arms[k]);
                    Vec3::from(inverse_mass[k]).component_mul(&r) + (inertia[k] * arm.cross(&r)).cross(&arm)
                };
                // A handful of products of numbers up to a few.
                prop_assert!((w * r - of(0) - of(1)).norm() < 1e-13);
            }
            let BlockAxes { axes, c, s } = block_axes(Scalar, symmetric_components(&w), n.into());
            let frame = Matrix3::from_columns(&axes.map(Vec3::from));
            let w_nn = n.dot(&(w * n));
            let c = Vec3::new(1.0, c[0], c[1]);
            let form = w_nn * c * c.transpose() + Matrix3::from_diagonal(&Vec3::new(0.0, s[0], s[1]));
            prop_assert!((frame.transpose() * frame - Matrix3::identity()).norm() < 1e-14);
            prop_assert!((frame.transpose() * w * frame - form).norm() < 1e-13 * w.norm().max(1.0), "{form}");
            prop_assert!(s[0] >= s[1] && s[1] >= 0.1, "no less than the inverse masses: {s:?}");
        }

        /// All conditions are satisfied, for any impulse before and any guess. If the coupling is weak enough for a unique
        /// solution, it is that of the solver of stored problems.
        #[test]
        fn satisfies_every_condition(
            w_nn in 0.1..2.0f64,
            c in prop::array::uniform2(-1.5..1.5f64),
            s in prop::array::uniform2(0.05..2.0f64),
            q in prop::array::uniform3(-1.0..1.0f64),
            y in prop::array::uniform3(-1.0..1.0f64),
            mu in prop_oneof![Just(0.0), 0.0..2.0f64, Just(1e3)],
            guess in prop_oneof![Just(0.0), 1e-3..1e3f64],
        ) {
            let w = matrix(w_nn, c, s);
            let (r, multiplier) = solve(w_nn, c, s, mu, q, y, guess);
            let size = 1.0 + r.iter().fold(0.0f64, |a, x| a.max(x.abs()));
            // Rounding of products of numbers up to `size`, divided by axes down to 0.05.
            prop_assert!(violation(&w, q, mu, r) <= 1e-11 * size * size, "{r:?}");
            if mu * c[0].hypot(c[1]) < 0.5 {
                let other = LocalSolver::new(&w, mu).solve(q);
                prop_assert!((0..3).all(|k| (r[k] - other[k]).abs() < 1e-10 * size), "{r:?} {other:?}");
            }
            // Its own multiplier as a guess changes only the last digits.
            let (again, _) = solve(w_nn, c, s, mu, q, y, multiplier);
            prop_assert!((0..3).all(|k| (r[k] - again[k]).abs() < 1e-11 * size));
        }

        /// If the solution is unique, single precision finds it to its rounding.
        #[test]
        fn single_precision_finds_the_same(
            w_nn in 0.1..2.0f64,
            c in prop::array::uniform2(-1.0..1.0f64),
            s in prop::array::uniform2(0.1..2.0f64),
            q in prop::array::uniform3(-1.0..1.0f64),
            mu in prop_oneof![Just(0.0), 0.0..0.3f64],
            guess in prop_oneof![Just(0.0), 1e-3..1e3f64],
        ) {
            let (expected, _) = solve(w_nn, c, s, mu, q, [0.0; 3], 0.0);
            let r = solve_single(w_nn, c, s, mu, q, guess);
            let size = 1.0 + expected.iter().fold(0.0f64, |a, x| a.max(x.abs()));
            // 6e-8 of numbers up to `size`, divided by w and axes down to 0.1.
            prop_assert!((0..3).all(|k| (r[k] - expected[k]).abs() < 1e-5 * size), "{r:?} {expected:?}");
        }

        /// Brute force: no point of a grid of the cone is better.
        #[test]
        fn nothing_nearby_is_better(
            w_nn in 0.1..2.0f64,
            c in prop::array::uniform2(-1.0..1.0f64),
            s in prop::array::uniform2(0.1..2.0f64),
            q in prop::array::uniform3(-1.0..1.0f64),
            mu in 0.05..1.0f64,
        ) {
            let w = matrix(w_nn, c, s);
            let (r, _) = solve(w_nn, c, s, mu, q, [0.0; 3], 0.0);
            let here = violation(&w, q, mu, r);
            for (n, ring, angle) in (0..=12).flat_map(|n| (0..=3).flat_map(move |r| (0..16).map(move |a| (n, r, a)))) {
                let n = f64::from(n) / 12.0 * (2.0 * r[0] + 1.0);
                let (sin, cos) = (f64::from(angle) * std::f64::consts::TAU / 16.0).sin_cos();
                let t = mu * n * f64::from(ring) / 3.0;
                prop_assert!(here <= violation(&w, q, mu, [n, t * cos, t * sin]) + 1e-10);
            }
        }
    }
}
