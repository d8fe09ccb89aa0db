//! Open contacts that the contact problem omits because the free velocities do not close them, and that the impulses of
//! other contacts close.

use std::collections::BTreeSet;

use super::kinematics::relative_velocity;
use crate::integrate::ContactConfiguration;
use crate::laws::{ContactLaw, MAX_STEP_OVERLAP};
use crate::math::Vec3;
use crate::scene::Scene;
use crate::state::{Contact, ContactKey, State, Velocities};

/// Keys of the open contacts that the contact problem of a step omits, since the `free` velocities do not close them,
/// and that the velocities `solved` close deeper than their law allows. The problem that is solved next includes them
/// ([`ContactConfiguration::closed_by_others`]).
pub fn contacts_closed_by_others(
    scene: &Scene,
    state: &State,
    q_c: &ContactConfiguration,
    contacts: &[Contact],
    free: Velocities,
    solved: Velocities,
) -> BTreeSet<ContactKey> {
    let may_be_omitted = |law: &ContactLaw| law.acts_on_touch() || law.is_damped_spring();
    if !state.laws.iter().any(may_be_omitted) {
        return BTreeSet::new();
    }
    let is_closed_by_others = |contact: &&Contact| {
        let law = &state.laws[contact.law];
        if contact.gap <= 0.0 || !may_be_omitted(law) || q_c.closed_by_others.contains(&contact.key()) {
            return false;
        }
        let pair = OpenPair { scene, q_c, contact };
        let depth = pair.allowed_overlap(law);
        // Pairs that the problem omits: see `GapForecast`.
        let was_omitted = if law.is_damped_spring() {
            !pair.closes_deeper_along_normal(free, depth) || pair.misses(free, 0.0)
        } else {
            pair.closes_deeper_along_normal(free, 0.0) && pair.misses(free, 0.0)
        };
        was_omitted && pair.closes_deeper_along_normal(solved, depth) && !pair.misses(solved, depth)
    };
    contacts.iter().filter(is_closed_by_others).map(Contact::key).collect()
}

/// Open contact whose bodies may close it by the next contact configuration.
pub(super) struct OpenPair<'a> {
    pub scene: &'a Scene,
    pub q_c: &'a ContactConfiguration,
    pub contact: &'a Contact,
}

impl OpenPair<'_> {
    /// Overlap, m, to which other contacts may push the pair in a step. A law that throws back or has a damper acts on
    /// contacts that are closed at the start of the next step, and must find one; others bring a pair to touch.
    pub fn allowed_overlap(&self, law: &ContactLaw) -> f64 {
        if !law.has_restitution() && !law.is_damped_spring() {
            return 0.0;
        }
        let Contact { candidate, antagonist, part_numbers, .. } = *self.contact;
        MAX_STEP_OVERLAP
            * self.scene.pair_size((candidate, part_numbers.candidate), (antagonist, part_numbers.antagonist))
    }

    /// Whether these velocities close the contact by more than its gap and `depth` (m), whatever the motion across its normal.
    pub fn closes_deeper_along_normal(&self, velocities: Velocities, depth: f64) -> bool {
        let OpenPair { scene, q_c, contact } = self;
        let u = relative_velocity(contact, &q_c.x, velocities);
        contact.gap + q_c.reach_time(scene) * contact.normal.dot(&u) < -depth
    }

    /// Whether two spheres pass each other on the straight paths of their centres with an overlap of less than `depth` (m);
    /// false for other bodies.
    pub fn misses(&self, Velocities { v, gradient, .. }: Velocities, depth: f64) -> bool {
        let OpenPair { scene, q_c, contact } = self;
        let [a, b] = [contact.candidate, contact.antagonist].map(|i| i.index());
        if !(scene.bodies[a].is_sphere() && scene.bodies[b].is_sphere()) {
            return false;
        }
        let radius_sum = scene.bodies[a].radius + scene.bodies[b].radius;
        let image_velocity = gradient.map_or(Vec3::zeros(), |gradient| gradient * contact.image);
        let between: Vec3 = contact.normal * (radius_sum + contact.gap);
        let relative_velocity: Vec3 = v[a] - v[b] - image_velocity;
        let time = (-between.dot(&relative_velocity) / relative_velocity.norm_squared()).min(q_c.reach_time(scene));
        (between + relative_velocity * time).norm() >= radius_sum - depth
    }
}
