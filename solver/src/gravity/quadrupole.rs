//! Effect of the shapes of two near bodies on their attraction, to second order in the ratio of size to distance.

use nalgebra::Matrix3;

use crate::math::Vec3;

/// Mass distribution of a body as its neighbours feel it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyInertia {
    /// Mass, kg.
    pub mass: f64,
    /// Inertia about the centre of mass, along the axes of the world, kg m^2.
    pub inertia: Matrix3<f64>,
}

/// Difference between the attraction of two bodies and that of two points of their masses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuadrupoleCorrection {
    /// Force on the second body, N; the first body gets the opposite.
    pub force: Vec3,
    /// Torques on the first and the second body about their centres, N m.
    pub torques: [Vec3; 2],
    /// Energy, J.
    pub energy: f64,
}

/// Fraction of the reach from which the effect fades, so that nothing jumps when a pair comes within reach. The fading
/// range is long: in a short one the force that conserves energy would be several times that of the quadrupoles.
const FADE_START: f64 = 0.5;

/// Computes the correction for a second body at `r` from the first, |r| > 0. With d = |r| and S = m_2 I_1 + m_1 I_2,
///
/// ```text
/// U = -G (tr S/(2 d^3) - 3 r.S r/(2 d^5)),    F = -dU/dr,    T_1 = 3 G m_2/d^5 r x I_1 r,    T_2 = 3 G m_1/d^5 r x I_2 r,
/// ```
///
/// times a factor of d that decreases from 1 at half of `reach` to 0 at `reach`; it is 1 everywhere if `reach` is
/// infinite. F derives from U with that factor, and T_1 + T_2 + r x F = 0: energy, momentum and angular momentum are
/// conserved. Source: J. MacCullagh (1844), see C.D. Murray and S.F. Dermott, Solar System Dynamics (1999), ch. 5.
pub fn quadrupole_correction(
    r: &Vec3,
    [one, two]: [&BodyInertia; 2],
    reach: f64,
    constant: f64,
) -> QuadrupoleCorrection {
    let d2 = r.norm_squared();
    let d = d2.sqrt();
    // S r, and its two terms.
    let [s_r_one, s_r_two] = [one.inertia * r * two.mass, two.inertia * r * one.mass];
    let trace = two.mass * one.inertia.trace() + one.mass * two.inertia.trace();
    let (along, s_r) = (r.dot(&(s_r_one + s_r_two)) / d2, s_r_one + s_r_two);
    let strength = constant / (d2 * d);
    let energy = -0.5 * strength * (trace - 3.0 * along);
    let fade_share = ((1.0 - d / reach) / (1.0 - FADE_START)).clamp(0.0, 1.0);
    let factor = fade_share * fade_share * (3.0 - 2.0 * fade_share);
    let slope = -6.0 * fade_share * (1.0 - fade_share) / (reach * (1.0 - FADE_START));
    let force = (r * (2.5 * along - 0.5 * trace) - s_r) * (3.0 * strength / d2);
    let torque = 3.0 * strength / d2 * factor;
    QuadrupoleCorrection {
        force: force * factor - r * (energy * slope / d),
        torques: [r.cross(&s_r_one) * torque, r.cross(&s_r_two) * torque],
        energy: energy * factor,
    }
}
