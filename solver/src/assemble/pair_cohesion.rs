//! Cohesive force of laws with one force for each pair of bodies, divided among the contacts of the pair.

use super::context::AssemblyContext;
use crate::scene::{BodyId, BodyShape, LawId};
use crate::state::Contact;

/// Two bodies, the lower index first, the law between them, and the bits of the shift of the image that touches.
type AttractedPair = (BodyId, BodyId, LawId, [u64; 3]);

/// Key under which the contacts of a pair are collected.
fn attracted_pair(contact: &Contact) -> AttractedPair {
    let Contact { candidate: a, antagonist: b, image, law, .. } = *contact;
    // 0.0 + x turns -0 into 0.
    let image = (if a < b { image } else { -image }).map(|x| (0.0 + x).to_bits());
    (a.min(b), a.max(b), law, image.into())
}

impl AssemblyContext<'_> {
    /// Attraction at each contact, N; empty if no law has cohesion per pair.
    ///
    /// Contact i of a pair has its own force F_i, by the effective radius of its two contactors, and the factor s_i of its gap. It
    /// attracts with F_i s_i max(s)/Σ s over the contacts of the pair: together they attract with the force of the nearest,
    /// however many they are.
    pub(super) fn pair_attractions(&self, contacts: &[Contact]) -> Vec<f64> {
        if !self.state.laws.iter().any(|law| law.pair_cohesion().is_some()) {
            return Vec::new();
        }
        let law_of = |k: usize| self.state.laws[contacts[k].law].pair_cohesion();
        let mut factors: Vec<f64> =
            (0..contacts.len()).map(|k| law_of(k).map_or(0.0, |law| law.gap_factor(contacts[k].gap))).collect();
        if self.scene.has_parts() {
            let is_divided = |&k: &usize| factors[k] > 0.0 && self.may_have_other_points(&contacts[k]);
            let mut near: Vec<(AttractedPair, usize)> =
                (0..contacts.len()).filter(is_divided).map(|k| (attracted_pair(&contacts[k]), k)).collect();
            near.sort_unstable();
            for contacts_of_pair in near.chunk_by(|a, b| a.0 == b.0) {
                let largest = contacts_of_pair.iter().map(|&(_, k)| factors[k]).fold(0.0, f64::max);
                let sum: f64 = contacts_of_pair.iter().map(|&(_, k)| factors[k]).sum();
                contacts_of_pair.iter().for_each(|&(_, k)| factors[k] *= largest / sum);
            }
        }
        let attraction = |(k, factor): (usize, f64)| match law_of(k) {
            Some(law) if factor > 0.0 => factor * law.force(self.effective_radius(&contacts[k])),
            _ => 0.0,
        };
        factors.into_iter().enumerate().map(attraction).collect()
    }

    /// Whether the pair of a contact may have several: all pairs but a sphere with another sphere or with a plate.
    fn may_have_other_points(&self, contact: &Contact) -> bool {
        let Contact { candidate, antagonist, .. } = *contact;
        let is_sphere = |body: BodyId| self.scene.sphere_flags[body.index()];
        let is_plate = |body: BodyId| matches!(self.scene.bodies[body.index()].shape, BodyShape::Plane { .. });
        !(is_sphere(candidate) && (is_sphere(antagonist) || is_plate(antagonist)))
    }
}
