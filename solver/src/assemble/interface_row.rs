//! Elastic interface of a row of the contact problem.

use crate::laws::LawInterface;
use crate::laws::interface::{soundness, stiffness_share};
use crate::math::Vec3;

/// Elastic interface of a row in a step. Its impulse on the candidate is -h S f k u at the end of the step, with the opening and
/// the sliding u, their stiffnesses k per unit of area, and the share f that damage has left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InterfaceRow {
    pub law: LawInterface,
    /// Area S, m².
    pub area: f64,
    /// Length of the step, s.
    pub h: f64,
    /// Opening at the start of the step, m.
    pub opening: f64,
    /// Sliding at the start of the step, world frame, m.
    pub sliding: Vec3,
    /// Soundness at the start of the step.
    pub soundness: f64,
    /// Normal shift of the law, m/s, which is not part of the velocity of the interface.
    pub shift: f64,
}

impl InterfaceRow {
    /// Velocity of the interface at û of its row, m/s.
    pub fn velocity(&self, n: &Vec3, shifted_velocity: &Vec3) -> Vec3 {
        shifted_velocity - n * self.shift
    }

    /// Opening and sliding at the end of the step with the velocity `v` of the interface, m.
    pub fn displacement(&self, n: &Vec3, v: &Vec3) -> (f64, Vec3) {
        let v_n = n.dot(v);
        (self.opening + self.h * v_n, self.sliding + (v - n * v_n) * self.h)
    }

    /// Soundness at the end of the step with the velocity `v` of the interface.
    pub fn end_soundness(&self, n: &Vec3, v: &Vec3) -> f64 {
        let (opening, sliding) = self.displacement(n, v);
        soundness(&self.law, self.soundness, opening, sliding.norm(), self.h)
    }

    /// Impulse at rest, N s, and its loss per velocity along n and in the tangent plane, kg, with the damage of the start of the
    /// step.
    pub fn stiffness(&self, n: &Vec3) -> (Vec3, [f64; 2]) {
        let scale = self.h * self.area * stiffness_share(&self.law, self.soundness);
        let [k_n, k_t] = [self.law.normal_stiffness, self.law.tangential_stiffness].map(|k| k * scale);
        (n * (-k_n * self.opening) - self.sliding * k_t, [k_n, k_t].map(|k| k * self.h))
    }
}
