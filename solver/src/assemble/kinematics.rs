//! Relative motion of two bodies at their contact point.

use crate::math::Vec3;
use crate::scene::{BodyId, SurfaceMotion};
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
    Velocities { v, w, gradient, surfaces }: Velocities,
) -> Vec3 {
    let [a, b] = [contact.candidate, contact.antagonist].map(|i| i.index());
    let u = v[a] + w[a].cross(at_a) - (v[b] + w[b].cross(at_b));
    let u = match gradient {
        Some(gradient) => u - gradient * contact.image,
        None => u,
    };
    if surfaces.is_empty() { u } else { u + relative_surface_velocity(contact, [at_a, at_b], surfaces) }
}

/// Velocity of the surface of the candidate relative to that of the antagonist, beyond those of the bodies, at a contact with
/// these arms, world frame, m/s; across the normal but for the growth of a hollow cylinder.
#[cold]
pub fn relative_surface_velocity(contact: &Contact, [at_a, at_b]: [&Vec3; 2], surfaces: &[SurfaceMotion]) -> Vec3 {
    let n = &contact.normal;
    surface_velocity(contact.candidate, at_a, n, surfaces) - surface_velocity(contact.antagonist, at_b, n, surfaces)
}

/// Velocity of the surface of a body beyond that of the body, at the distance `arm` (m) from its centre at a contact with the
/// normal `n`, m/s.
pub fn surface_velocity(body: BodyId, arm: &Vec3, n: &Vec3, surfaces: &[SurfaceMotion]) -> Vec3 {
    let own = surfaces.iter().find(|surface| surface.body == body);
    own.map_or(Vec3::zeros(), |surface| surface.velocity(arm, n))
}

/// Vectors from the centres of the candidate and of the antagonist's image to the contact point, m.
pub fn contact_arms(contact: &Contact, x: &[Vec3]) -> [Vec3; 2] {
    [contact.point - x[contact.candidate.index()], contact.point - (x[contact.antagonist.index()] + contact.image)]
}
