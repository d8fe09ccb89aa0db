//! Exact solution of one contact with all other impulses frozen.

use crate::math::simd::Arithmetic;
use crate::solve::gauss_seidel::vector::{LaneVector, dot_product, project_to_ball, triple};

/// r̂ that solves one contact with Signorini's condition and Coulomb's law, N s.
///
/// * `n`: unit normal.
/// * `u`: û with the impulse `r` applied, m/s.
/// * `r`: that impulse, N s.
/// * `w`: w_n and w_t, 1/kg; `friction`: mu.
///
/// With W = diag(w_n, w_t, w_t) the solution is closed: the impulse that would stop the contact,
/// r - û_n/w_n n - û_T/w_t, has its normal part cut at 0 (Signorini) and its tangential part
/// projected on the disc of radius mu r̂_n (Coulomb); sticking where it lies inside.
///
/// Source: F. Jourdan, P. Alart, M. Jean, Comput. Methods Appl. Mech. Engrg. 155 (1998) 31-47.
///
/// ```
/// # use cd_solve::{math::simd::Scalar, solve::gauss_seidel::diagonal::local::signorini_coulomb};
/// // 2 kg (1/w_n) arriving at 2 m/s is stopped by 4 N s; the tangential 7 m/s would need
/// // 4 N s too (1/w_t = 4/7), but friction gives 0.5 * 4.
/// let r = signorini_coulomb(Scalar, [0.0, 0.0, 1.0], [0.0, 7.0, -2.0], [0.0; 3], [0.5, 1.75], 0.5);
/// assert_eq!(r, [0.0, -2.0, 4.0]);
/// ```
#[inline(always)]
pub fn signorini_coulomb<L: Arithmetic>(
    l: L,
    n: LaneVector<L::V>,
    u: LaneVector<L::V>,
    r: LaneVector<L::V>,
    w: [L::V; 2],
    friction: L::V,
) -> LaneVector<L::V> {
    let contact = FrozenContact { n, u, u_n: dot_product(l, n, u), shift: l.splat(0.0), r, w };
    let (normal, tangential) = unprojected_impulse(l, contact);
    coulomb(l, n, normal, tangential, friction)
}

/// Contact with all other impulses frozen; symbols and units as in [`signorini_coulomb`].
pub struct FrozenContact<V> {
    pub n: LaneVector<V>,
    /// û without the normal part of the shift.
    pub u: LaneVector<V>,
    /// n.u.
    pub u_n: V,
    /// Normal part of the shift, m/s: û_n is u_n + shift.
    pub shift: V,
    pub r: LaneVector<V>,
    pub w: [V; 2],
}

/// First half of [`signorini_coulomb`]: the normal part cut at 0, and the tangential part that would stop the contact.
#[inline(always)]
pub fn unprojected_impulse<L: Arithmetic>(
    l: L,
    FrozenContact { n, u, u_n, shift, r, w: [w_n, w_t] }: FrozenContact<L::V>,
) -> (L::V, LaneVector<L::V>) {
    let inverse_t = l.div(l.splat(1.0), w_t);
    let r_n = dot_product(l, n, r);
    let normal = signorini(l, l.add(u_n, shift), r_n, w_n);
    let full = triple!(k => l.neg_mul_add(u[k], inverse_t, r[k]));
    let along = l.neg_mul_add(u_n, inverse_t, r_n);
    (normal, triple!(k => l.neg_mul_add(n[k], along, full[k])))
}

/// Normal impulse max(0, r_n - û_n/w_n).
#[inline(always)]
pub fn signorini<L: Arithmetic>(l: L, u_n: L::V, r_n: L::V, w_n: L::V) -> L::V {
    let zero = l.splat(0.0);
    let stopping = l.sub(r_n, l.div(u_n, w_n));
    l.select_greater(stopping, zero, stopping, zero)
}

/// Second half of [`signorini_coulomb`]: the tangential part projected on the disc of radius mu r̂_n.
#[inline(always)]
pub fn coulomb<L: Arithmetic>(
    l: L,
    n: LaneVector<L::V>,
    normal: L::V,
    tangential: LaneVector<L::V>,
    friction: L::V,
) -> LaneVector<L::V> {
    let tangential = project_to_ball(l, tangential, l.mul(friction, normal));
    triple!(k => l.mul_add(n[k], normal, tangential[k]))
}

/// Normal impulse of the associated law, r̂ in the cone, û in its dual cone, r̂·û = 0: a contact that slides at u_T separates
/// at mu |u_T|.
///
/// * `stopping`: normal impulse r_n - û_n/w_n that would stop the contact, of any sign, N s.
/// * `tangential`: tangential impulse that would stop it.
/// * `w`: w_n and w_t, 1/kg; `friction`: mu; `share`: 1, or 0 for Signorini's condition without separation.
///
/// The tangential part follows by [`coulomb`], as with [`signorini`]. With an excess of mu r_n under the stopping tangential
/// impulse, r_n is raised by mu w_t/(w_n + mu² w_t) of that excess.
///
/// ```
/// # use cd_solve::{math::simd::Scalar, solve::gauss_seidel::diagonal::local::associated_normal};
/// // W = 1: 4 N s would stop the normal motion and 7 N s the tangential one, of which mu = 1 allows 4.
/// // The nearest point of the cone is 5.5, 5.5.
/// assert_eq!(associated_normal(Scalar, 4.0, [7.0, 0.0, 0.0], [1.0, 1.0], 1.0, 1.0), 5.5);
/// ```
#[inline(always)]
pub fn associated_normal<L: Arithmetic>(
    l: L,
    stopping: L::V,
    tangential: LaneVector<L::V>,
    [w_n, w_t]: [L::V; 2],
    friction: L::V,
    share: L::V,
) -> L::V {
    let zero = l.splat(0.0);
    let length = l.sqrt(dot_product(l, tangential, tangential));
    let excess = l.neg_mul_add(friction, stopping, length);
    let excess = l.select_greater(excess, zero, excess, zero);
    let response = l.mul(friction, w_t);
    let raised = l.div(l.mul(l.mul(share, response), excess), l.mul_add(friction, response, w_n));
    let normal = l.add(stopping, raised);
    l.select_greater(normal, zero, normal, zero)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::simd::Scalar;
    use proptest::prelude::*;

    const UP: [f64; 3] = [0.0, 0.0, 1.0];
    /// w of a solid sphere of 2 kg against the ground: w_t = 7/2 w_n.
    const W: [f64; 2] = [0.5, 1.75];

    #[test]
    fn parting_sticking_and_frictionless() {
        let solve = |u, friction| signorini_coulomb(Scalar, UP, u, [0.0; 3], W, friction);
        assert_eq!(solve([3.0, 0.0, 1.0], 0.5), [0.0; 3]);
        assert_eq!(solve([0.0; 3], 0.5), [0.0; 3]);
        // 0.35 m/s is stopped by 0.2 N s, within 0.5 * 4.
        let r = solve([0.35, 0.0, -2.0], 0.5);
        assert!((r[0] + 0.2).abs() < 1e-15 && r[1] == 0.0 && r[2] == 4.0);
        assert_eq!(solve([0.0, 7.0, -2.0], 0.0), [0.0, 0.0, 4.0]);
    }

    /// 1 mm in a step of 1 ms may be closed at 1 m/s: of 2 m/s the other half is stopped.
    #[test]
    fn an_open_gap_leaves_the_velocity_that_closes_it() {
        let contact = FrozenContact { n: UP, u: [0.0, 0.0, -2.0], u_n: -2.0, shift: 1.0, r: [0.0; 3], w: W };
        assert_eq!(unprojected_impulse(Scalar, contact), (2.0, [0.0; 3]));
    }

    proptest! {
        /// The solution of the associated law is the minimum of ½ r·W r + b·r over the cone: no other impulse is lower.
        #[test]
        fn associated_law_is_a_minimum(
            normal in -3.0..3.0f64,
            tangential in prop::array::uniform2(-3.0..3.0f64),
            friction in 0.0..1.5f64,
            others in prop::collection::vec((0.0..4.0f64, 0.0..1.0f64, 0.0..6.3f64), 50),
        ) {
            let stopping_t = [tangential[0], tangential[1], 0.0];
            let r_n = associated_normal(Scalar, normal, stopping_t, W, friction, 1.0);
            let r = coulomb(Scalar, UP, r_n, stopping_t, friction);
            let cost = |r: [f64; 3]| {
                let d = [r[0] - tangential[0], r[1] - tangential[1], r[2] - normal];
                0.5 * (W[1] * (d[0] * d[0] + d[1] * d[1]) + W[0] * d[2] * d[2])
            };
            for (other_n, share, angle) in others {
                let other_t = share * friction * other_n;
                let other = [other_t * libm::cos(angle), other_t * libm::sin(angle), other_n];
                prop_assert!(cost(r) <= cost(other) + 1e-12); // rounding of numbers up to 100
            }
            prop_assert_eq!(
                associated_normal(Scalar, normal, stopping_t, W, friction, 0.0),
                signorini(Scalar, -normal * W[0], 0.0, W[0])
            );
        }

        /// Brute force: no other impulse of the cone satisfies the conditions; the returned one does.
        #[test]
        fn satisfies_signorini_and_coulomb(
            n in prop::array::uniform3(-1.0..1.0f64),
            u in prop::array::uniform3(-3.0..3.0f64),
            r in prop::array::uniform3(-3.0..3.0f64),
            friction in 0.0..1.5f64,
        ) {
            let size = dot_product(Scalar, n, n).sqrt();
            prop_assume!(size > 0.1);
            let n = n.map(|c| c / size);
            let new = signorini_coulomb(Scalar, n, u, r, W, friction);
            // u after the change: W (new - r) + u with W = w_n nn + w_t (1 - nn).
            let change: [f64; 3] = std::array::from_fn(|k| new[k] - r[k]);
            let along = dot_product(Scalar, n, change);
            let after: [f64; 3] = std::array::from_fn(|k| {
                u[k] + n[k] * along * W[0] + (change[k] - n[k] * along) * W[1]
            });
            let (u_n, r_n) = (dot_product(Scalar, n, after), dot_product(Scalar, n, new));
            let u_t: [f64; 3] = std::array::from_fn(|k| after[k] - n[k] * u_n);
            let r_t: [f64; 3] = std::array::from_fn(|k| new[k] - n[k] * r_n);
            let norm = |a: [f64; 3]| dot_product(Scalar, a, a).sqrt();
            let slack = 1e-13; // rounding of numbers up to 10
            prop_assert!(u_n > -slack && r_n > -slack && (u_n * r_n).abs() < slack);
            prop_assert!(norm(r_t) <= friction * r_n + slack);
            if norm(u_t) > 1e-9 && r_n > 1e-9 {
                prop_assert!((norm(r_t) - friction * r_n).abs() < slack);
                prop_assert!(dot_product(Scalar, u_t, r_t) <= -norm(u_t) * norm(r_t) + 1e-12);
            }
        }
    }
}
