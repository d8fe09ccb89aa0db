//! Relative motion of two bodies at their contact point.

use crate::math::Vec3;
use crate::state::{Contact, Velocities};

/// Velocity of the candidate relative to the antagonist at the contact point, world frame, m/s.
pub fn relative_velocity(contact: &Contact, x: &[Vec3], velocities: Velocities) -> Vec3 {
    velocity_at_arms(contact, &contact_arms(contact, x), velocities)
}

/// [`relative_velocity`] of a contact with these arms from the two centres to the contact point, m.
#[inline(always)]
pub fn velocity_at_arms(
    contact: &Contact,
    [at_a, at_b]: &[Vec3; 2],
    Velocities { v, w, gradient }: Velocities,
) -> Vec3 {
    let [a, b] = [contact.candidate, contact.antagonist].map(|i| i.index());
    let u = v[a] + w[a].cross(at_a) - (v[b] + w[b].cross(at_b));
    match gradient {
        Some(gradient) => u - gradient * contact.image,
        None => u,
    }
}

/// Vectors from the centres of the candidate and of the antagonist's image to the contact point, m.
pub fn contact_arms(contact: &Contact, x: &[Vec3]) -> [Vec3; 2] {
    [contact.point - x[contact.candidate.index()], contact.point - (x[contact.antagonist.index()] + contact.image)]
}
