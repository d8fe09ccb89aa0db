//! Torque-free rotation of a rigid body, by a rule that conserves its energy and its angular momentum.
//!
//! In the body's frame dL/dt = L x J⁻¹ L. The implicit midpoint rule conserves every quadratic invariant, and so |L| and
//! L.J⁻¹L/2, for any step; with the corresponding Cayley rotation the angular momentum in space is conserved, too. With W the
//! angular velocity of the midpoint, body frame,
//!
//! ```text
//! J W + h/2 W x J W = L,   R⁺ = R cay(h W),   L⁺ = cay(-h W) L,   cay(a) = (1 - [a]/2)⁻¹ (1 + [a]/2).
//! ```
//!
//! Sources: J.C. Simo, K.K. Wong, Int. J. Numer. Meth. Engng. 31 (1991) 19-52; M. Austin, P.S.
//! Krishnaprasad, L.S. Wang, J. Comput. Phys. 107 (1993) 105-117.

use nalgebra::{Matrix3, Quaternion};

use super::{Quat, Vec3, rotate_by_vector};

/// Largest angle by which one application of the rule turns a body, rad; longer steps are divided.
const MAX_TURN_ANGLE: f64 = 1.0;
/// Largest number of divisions: a body that turns a hundred times in a step is not resolved anyway. It keeps its angular
/// momentum, but not its energy.
const MAX_DIVISIONS: f64 = 1000.0;
/// Largest number of iterations: Newton's method doubles the number of correct digits and needs about five steps at
/// [`MAX_TURN_ANGLE`].
const MAX_ITERATIONS: usize = 20;

/// Orientation after the time `h` (s, of either sign) of a body that turns freely.
///
/// * `q`: orientation before, body to world.
/// * `momentum`: angular momentum about the centre of mass, world frame, kg m²/s, constant.
/// * `inertia`: principal moments J, kg m².
///
/// The phase is of second order in h; energy and angular momentum are conserved to rounding. With three equal moments the
/// motion is a rotation about a fixed axis, and exact.
pub fn free_rotation(q: &Quat, momentum: &Vec3, inertia: &[f64; 3], h: f64) -> Quat {
    let [a, b, c] = *inertia;
    if a == b && b == c {
        return rotate_by_vector(q, &(momentum * (h / a)));
    }
    let fastest = momentum.norm() / a.min(b).min(c) * h.abs();
    let divisions = (fastest / MAX_TURN_ANGLE).ceil().clamp(1.0, MAX_DIVISIONS);
    let part = h / divisions;
    (0..divisions as usize).fold(*q, |q, _| free_rotation_step(&q, momentum, inertia, part))
}

/// One application of the rule, see [`free_rotation`].
fn free_rotation_step(q: &Quat, momentum: &Vec3, inertia: &[f64; 3], h: f64) -> Quat {
    let j = Vec3::from(*inertia);
    let l = q.inverse_transform_vector(momentum);
    cayley_rotation(q, &midpoint_velocity(&l, &j, h), h)
}

/// Orientation and angular velocity (rad/s, world frame) after the time `h` (s) of a body that turns at imposed, constant
/// rates about some of its own axes, and without a moment about the others.
///
/// * `q`, `w`: orientation, body to world, and angular velocity before, world frame, rad/s.
/// * `inertia`: principal moments J, kg m².
/// * `free`: about which axes its rotation is not imposed.
///
/// Euler's equations J dΩ/dt = J Ω x Ω of the free components, by the implicit midpoint rule: they are linear in these if one
/// component is imposed, and of constant right-hand side if two are. A free component next to a rate that is imposed at 0
/// keeps its value.
pub fn constrained_rotation(q: &Quat, w: &Vec3, inertia: &[f64; 3], free: [bool; 3], h: f64) -> (Quat, Vec3) {
    let slope = |i: usize| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        if free[i] { (inertia[j] - inertia[k]) / inertia[i] } else { 0.0 }
    };
    let slopes = Vec3::from_fn(|i, _| slope(i));
    let mut own = q.inverse_transform_vector(w);
    // At most one half as the product of a slope, a rate and half a step, so that the rule has one solution.
    let fastest = own.norm() * slopes.amax().max(1.0) * h.abs();
    let divisions = (fastest / MAX_TURN_ANGLE).ceil().clamp(1.0, MAX_DIVISIONS);
    let part = h / divisions;
    let mut q = *q;
    for _ in 0..divisions as usize {
        let middle = constrained_midpoint(&own, &slopes, free, 0.5 * part);
        own = Vec3::from_fn(|i, _| if free[i] { 2.0 * middle[i] - own[i] } else { own[i] });
        q = cayley_rotation(&q, &middle, part);
    }
    (q, q * own)
}

/// Ω of the midpoint after half a step `half` (s): W_i = Ω_i + half s_i W_j W_k for free i, with s = `slopes` and i, j, k cyclic;
/// at least one component is imposed.
fn constrained_midpoint(own: &Vec3, slopes: &Vec3, free: [bool; 3], half: f64) -> Vec3 {
    let mut middle = *own;
    match (0..3).find(|&k| !free[k] && free[(k + 1) % 3] && free[(k + 2) % 3]) {
        Some(k) => {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            let [p, s] = [slopes[i], slopes[j]].map(|slope| half * slope * own[k]);
            middle[i] = (own[i] + p * own[j]) / (1.0 - p * s);
            middle[j] = own[j] + s * middle[i];
        }
        None => {
            if let Some(i) = (0..3).find(|&i| free[i]) {
                middle[i] += half * slopes[i] * own[(i + 1) % 3] * own[(i + 2) % 3];
            }
        }
    }
    middle
}

/// R cay(h W) with W = `rate` (rad/s) in the body's frame.
fn cayley_rotation(q: &Quat, rate: &Vec3, h: f64) -> Quat {
    // The quaternion of cay(h W) is (1, h W/2), normalised; the small part is added to q, not the large one.
    let small = q.quaternion() * Quaternion::from_imag(rate * (0.5 * h));
    Quat::new_normalize(q.quaternion() + small)
}

/// W of the midpoint by Newton's method from J⁻¹ L.
fn midpoint_velocity(l: &Vec3, j: &Vec3, h: f64) -> Vec3 {
    let start = l.component_div(j);
    let mut w = start;
    for _ in 0..MAX_ITERATIONS {
        let jw = j.component_mul(&w);
        let defect = jw + w.cross(&jw) * (0.5 * h) - l;
        if defect.norm_squared() <= 1e-32 * l.norm_squared() {
            break; // to rounding; slow bodies after one iteration
        }
        let slope = midpoint_slope(&w, j, &jw, 0.5 * h);
        let Some(change) = slope.try_inverse().map(|inverse| inverse * defect) else { break };
        w -= change;
        if change.norm_squared() <= 1e-32 * w.norm_squared() {
            break;
        }
    }
    if w.iter().all(|x| x.is_finite()) { w } else { start }
}

/// J + h/2 ([W] J - [J W]), the derivative of J W + h/2 W x J W, with `half` = h/2. Written out, without the products with
/// the zeros of the matrices; a zero has no sign, as in their sum.
fn midpoint_slope(w: &Vec3, j: &Vec3, jw: &Vec3, half: f64) -> Matrix3<f64> {
    let off_diagonal = |wj: f64, jw: f64| 0.0 + (wj - jw) * half;
    Matrix3::new(
        j.x,
        off_diagonal(-w.z * j.y, -jw.z),
        off_diagonal(w.y * j.z, jw.y),
        off_diagonal(w.z * j.x, jw.z),
        j.y,
        off_diagonal(-w.x * j.z, -jw.x),
        off_diagonal(-w.y * j.x, -jw.y),
        off_diagonal(w.x * j.y, jw.x),
        j.z,
    )
}

/// Angular momentum of the body turned by `q` with angular velocity `w`, world frame; `inertia` are the principal moments J.
pub fn angular_momentum(q: &Quat, inertia: &[f64; 3], w: &Vec3) -> Vec3 {
    q * q.inverse_transform_vector(w).component_mul(&Vec3::from(*inertia))
}

/// Angular velocity for a given angular momentum, the inverse of [`angular_momentum`].
pub fn angular_velocity(q: &Quat, inertia: &[f64; 3], momentum: &Vec3) -> Vec3 {
    q * q.inverse_transform_vector(momentum).component_div(&Vec3::from(*inertia))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn size() -> impl Strategy<Value = f64> {
        (-12.0..12.0f64).prop_map(|e| 10f64.powf(e))
    }

    proptest! {
        /// The energy in the body's frame is conserved, and the reverse step leads back, up to some turns a step.
        #[test]
        fn energy_is_kept_and_time_can_be_reversed(
            inertia in prop::array::uniform3(0.2..3.0f64),
            turned in prop::array::uniform3(-3.0..3.0f64),
            momentum in prop::array::uniform3(-1.0..1.0f64),
            h in 1e-6..20.0f64,
            unit in size(),
        ) {
            let inertia = inertia.map(|j| j * unit);
            let (q, l) = (Quat::from_scaled_axis(Vec3::from(turned)), Vec3::from(momentum) * unit);
            prop_assume!(l.norm() > 1e-3 * unit);
            let energy = |q: &Quat| l.dot(&angular_velocity(q, &inertia, &l));
            let after = free_rotation(&q, &l, &inertia, h);
            // A few roundings in each of up to a hundred divisions.
            prop_assert!((energy(&after) / energy(&q) - 1.0).abs() < 1e-13);
            let back = free_rotation(&after, &l, &inertia, -h);
            prop_assert!(back.angle_to(&q) < 1e-11, "{}", back.angle_to(&q));
        }

        /// The slope of the midpoint rule is its expression in matrices, to the bit.
        #[test]
        fn the_slope_is_that_of_the_matrices(
            w in prop::array::uniform3(-3.0..3.0f64),
            j in prop::array::uniform3(size()),
            half in -1.0..1.0f64,
        ) {
            let (w, j) = (Vec3::from(w), Vec3::from(j));
            let jw = j.component_mul(&w);
            let expected = Matrix3::from_diagonal(&j)
                + (w.cross_matrix() * Matrix3::from_diagonal(&j) - jw.cross_matrix()) * half;
            prop_assert_eq!(midpoint_slope(&w, &j, &jw, half), expected);
        }

        /// Any input gives a valid orientation.
        #[test]
        fn always_a_unit_quaternion(
            inertia in prop::array::uniform3(size()),
            momentum in prop::array::uniform3(size()),
            h in size(),
        ) {
            let q = free_rotation(&Quat::identity(), &Vec3::from(momentum), &inertia, h);
            prop_assert!((q.into_inner().norm() - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn a_guided_body_obeys_eulers_equations() {
        // The rate c about the third axis is imposed: the two others oscillate with the frequency c sqrt(-p s) of their slopes
        // p and s, as the equations are linear.
        let (inertia, c) = ([2.0, 3.0, 4.0], 0.5);
        let (p, s) = ((3.0 - 4.0) / 2.0, (4.0 - 2.0) / 3.0);
        let rate = c * f64::sqrt(-p * s);
        let (mut q, mut w) = (Quat::identity(), Vec3::new(0.25, 0.0, c));
        let steps = 4000;
        for _ in 0..steps {
            (q, w) = constrained_rotation(&q, &w, &inertia, [true, true, false], 1e-3);
        }
        let own = q.inverse_transform_vector(&w);
        let angle = rate * f64::from(steps) * 1e-3;
        let expected = Vec3::new(0.25 * angle.cos(), 0.25 * (s / -p).sqrt() * angle.sin(), c);
        // The error of the phase is (h rate)²/12 of it; with rounding.
        assert!((own - expected).norm() < 1e-7, "{own} {expected}");
        // Two imposed rates: a constant acceleration (J_2 - J_3)/J_1 Ω_2 Ω_3 about the first axis.
        let (q, w) =
            constrained_rotation(&Quat::identity(), &Vec3::new(0.0, 1.0, 0.5), &inertia, [true, false, false], 0.25);
        let own = q.inverse_transform_vector(&w);
        assert!((own - Vec3::new(-0.5 * 0.5 * 0.25, 1.0, 0.5)).norm() < 1e-15, "{own}");
    }

    #[test]
    fn momentum_and_velocity_are_each_others_reverse() {
        let (q, inertia, w) =
            (Quat::from_scaled_axis(Vec3::new(0.3, 1.0, -2.0)), [1.0, 2.0, 4.0], Vec3::new(1.0, 2.0, 3.0));
        let l = angular_momentum(&q, &inertia, &w);
        assert!((angular_velocity(&q, &inertia, &l) - w).norm() < 1e-14);
        let about_axis = q * Vec3::z();
        assert!((angular_momentum(&q, &inertia, &about_axis) - about_axis * 4.0).norm() < 1e-14);
    }
}
