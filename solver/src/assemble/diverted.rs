//! Pairs that a law leaves to themselves because their free velocities do not bring them together, and that other contacts
//! divert into each other.

use std::collections::BTreeSet;

use super::kinematics::relative_velocity;
use crate::integrate::ContactConfiguration;
use crate::laws::{ContactLaw, MAX_STEP_OVERLAP};
use crate::math::Vec3;
use crate::scene::Scene;
use crate::state::{Contact, ContactKey, State, Velocities};

/// Open contacts that have no part in the contact problem of a step, as the `free` velocities do not close them, and that
/// the velocities `solved` close deeper than their law allows. The next problem has them ([`ContactConfiguration::diverted`]).
pub fn diverted_contacts(
    scene: &Scene,
    state: &State,
    q_c: &ContactConfiguration,
    contacts: &[Contact],
    free: Velocities,
    solved: Velocities,
) -> BTreeSet<ContactKey> {
    let waits = |law: &ContactLaw| law.acts_on_touch() || law.is_damped_spring();
    if !state.laws.iter().any(waits) {
        return BTreeSet::new();
    }
    let is_diverted = |contact: &&Contact| {
        let law = &state.laws[contact.law as usize];
        if contact.gap <= 0.0 || !waits(law) || q_c.diverted.contains(&contact.key()) {
            return false;
        }
        let depth = allowed_overlap(scene, contact, law);
        let was_open = if law.is_damped_spring() {
            !closes_deeper(scene, q_c, contact, free, depth)
        } else {
            closes_deeper_along_normal(scene, q_c, contact, free, 0.0) && misses(scene, q_c, contact, free, 0.0)
        };
        was_open && closes_deeper(scene, q_c, contact, solved, depth)
    };
    contacts.iter().filter(is_diverted).map(Contact::key).collect()
}

/// Overlap, m, to which other contacts may push an open pair in a step. A law that throws back or has a damper acts on
/// contacts that are closed at the start of the next step, and must find one; others bring a pair to touch.
pub(super) fn allowed_overlap(scene: &Scene, contact: &Contact, law: &ContactLaw) -> f64 {
    if !law.has_restitution() && !law.is_damped_spring() {
        return 0.0;
    }
    MAX_STEP_OVERLAP * scene.pair_size((contact.candidate, contact.ranks.0), (contact.antagonist, contact.ranks.1))
}

/// Whether these velocities bring a pair to an overlap of more than `depth` (m) by the next contact configuration.
pub(super) fn closes_deeper(
    scene: &Scene,
    q_c: &ContactConfiguration,
    contact: &Contact,
    velocities: Velocities,
    depth: f64,
) -> bool {
    closes_deeper_along_normal(scene, q_c, contact, velocities, depth)
        && !misses(scene, q_c, contact, velocities, depth)
}

/// Whether these velocities close a contact by more than its gap and `depth` (m), whatever the motion across its normal.
pub(super) fn closes_deeper_along_normal(
    scene: &Scene,
    q_c: &ContactConfiguration,
    contact: &Contact,
    velocities: Velocities,
    depth: f64,
) -> bool {
    let u = relative_velocity(contact, &q_c.x, velocities);
    contact.gap + q_c.reach_time(scene) * contact.normal.dot(&u) < -depth
}

/// Whether two spheres pass each other on the straight paths of their centres with an overlap of less than `depth` (m);
/// false for other bodies.
pub(super) fn misses(
    scene: &Scene,
    q_c: &ContactConfiguration,
    contact: &Contact,
    Velocities { v, .. }: Velocities,
    depth: f64,
) -> bool {
    let [a, b] = [contact.candidate, contact.antagonist].map(|i| i.index());
    if !(scene.bodies[a].is_sphere() && scene.bodies[b].is_sphere()) {
        return false;
    }
    let radii = scene.bodies[a].radius + scene.bodies[b].radius;
    let (from, along): (Vec3, Vec3) = (contact.normal * (radii + contact.gap), v[a] - v[b]);
    let time = (-from.dot(&along) / along.norm_squared()).min(q_c.reach_time(scene));
    (from + along * time).norm() >= radii - depth
}
