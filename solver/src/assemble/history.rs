//! Data that contacts inherit from the contacts of the last step: initial impulses, friction history, bonds.

use std::cmp::Ordering;
use std::ops::Range;

use cd_formats::groups::DisjointSets;
use rayon::prelude::*;

use super::context::AssemblyContext;
use super::faces::LastLoad;
use super::kinematics::{contact_arms, velocity_at_arms};
use crate::laws::{ContactLaw, LawShift, MAX_TOUCHING_GAP};
use crate::math::{Quat, Vec3, rotate_by_vector};
use crate::scene::{BodyId, ContactSides, Scene};
use crate::state::{BondingMode, Contact, ContactId, LawMemory, SolvedContact, UNKNOWN_FEATURE};

/// Contacts per task.
const CONTACTS_PER_TASK: usize = 1024;

/// Index of the contact with the same key in the list of the last step, for each contact. Both lists are sorted by key.
fn previous_by_key(old_contacts: &[SolvedContact], contacts: &[Contact]) -> Vec<Option<ContactId>> {
    // Each task searches the position of its first contact.
    let find_old = |position: &mut Option<usize>, contact: &Contact| {
        let k = position.get_or_insert_with(|| {
            old_contacts.partition_point(|old| old.contact.cmp_by_key(contact) == Ordering::Less)
        });
        loop {
            match old_contacts.get(*k)?.contact.cmp_by_key(contact) {
                Ordering::Less => *k += 1,
                Ordering::Equal => return Some(ContactId::new(*k)),
                Ordering::Greater => return None,
            }
        }
    };
    contacts.par_iter().with_min_len(CONTACTS_PER_TASK).map_init(|| None, find_old).collect()
}

/// Two contactors given by their bodies and numbers of parts.
type ContactorPair = (BodyId, BodyId, ContactSides<u16>);

fn contactor_pair(contact: &Contact) -> ContactorPair {
    (contact.candidate, contact.antagonist, contact.part_numbers)
}

/// Range of the contacts of two contactors in a list sorted by key.
fn pair_range<T>(list: &[T], pair: ContactorPair, contact: impl Fn(&T) -> &Contact) -> Range<usize> {
    let start = list.partition_point(|item| contactor_pair(contact(item)) < pair);
    start..start + list[start..].iter().take_while(|item| contactor_pair(contact(item)) == pair).count()
}

/// Bond between the bodies of a contact.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct BondState {
    /// Gap at which the contact is bonded, m.
    pub bond: Option<f64>,
    /// Whether bonds join its bodies, directly or through other bodies.
    pub in_aggregate: bool,
}

/// Whether each body is in one of the contacts `roots`, or is connected to one of these through others. `contacts` are
/// all that can close. Bodies that never move are not counted.
pub fn connected_bodies(scene: &Scene, contacts: &[Contact], roots: &[&Contact]) -> Vec<bool> {
    let mut rests: Vec<bool> = scene.bodies.iter().map(|body| body.driven && !body.is_driven_in_part()).collect();
    scene.drives.iter().filter(|drive| drive.ever_moves()).for_each(|drive| rests[drive.body.index()] = false);
    let bodies = |contact: &Contact| [contact.candidate, contact.antagonist].map(|i| i.index());
    let mut groups = DisjointSets::new(scene.bodies.len());
    for [a, b] in contacts.iter().map(bodies).filter(|pair| pair.iter().all(|&i| !rests[i])) {
        groups.union(a, b);
    }
    let mut has_chosen = vec![false; scene.bodies.len()];
    for i in roots.iter().flat_map(|contact| bodies(contact)).filter(|&i| !rests[i]) {
        has_chosen[groups.find(i)] = true;
    }
    (0..scene.bodies.len()).map(|i| has_chosen[groups.find(i)]).collect()
}

/// New contact that may inherit the history of a contact of the last step; indices in the two lists.
struct PossibleHeir {
    /// Displacement between the two, m.
    displacement: f64,
    old: usize,
    new: usize,
}

impl AssemblyContext<'_> {
    /// Index of the contact of the last step whose history each contact inherits: the one with its key, or one of the same
    /// contactors whose key is gone. Where corners coincide, rounding decides which features meet; if there are more than
    /// four, rounding may also choose other ones.
    ///
    /// Only contacts that can act, now or before, count: the other listed contacts depend on the alert distance.
    pub(super) fn previous_contacts(&self, contacts: &[Contact]) -> Vec<Option<ContactId>> {
        let mut found = previous_by_key(&self.state.contacts, contacts);
        self.find_previous_by_position(contacts, &mut found);
        if !self.scene.sphere_flags.contains(&false) {
            return found; // no contact changes its key
        }
        let gone = self.lost_contacts(contacts, &found);
        let new = self.new_contacts(contacts, &found, &gone);
        for new in new.chunk_by(|&i, &k| contactor_pair(&contacts[i]) == contactor_pair(&contacts[k])) {
            self.transfer_history(new, &gone, contacts, &mut found);
        }
        found
    }

    /// Finds contacts of the last step that a text file has without features, so that their keys are unknown, by their
    /// points: each is the history of one contact of the same two contactors, the nearest pairs first.
    fn find_previous_by_position(&self, contacts: &[Contact], found: &mut [Option<ContactId>]) {
        let before = &self.state.contacts;
        let is_unknown = |old: &SolvedContact| old.contact.features.candidate == UNKNOWN_FEATURE;
        if !before.par_iter().with_min_len(CONTACTS_PER_TASK).any(is_unknown) {
            return; // always, but in the first step
        }
        for old in before.chunk_by(|a, b| contactor_pair(&a.contact) == contactor_pair(&b.contact)) {
            if !old.iter().any(is_unknown) {
                continue;
            }
            let pair = contactor_pair(&old[0].contact);
            let range = pair_range(before, pair, |old| &old.contact);
            let heirs_of = |old: usize| {
                let now = pair_range(contacts, pair, |contact| contact);
                now.map(move |new| {
                    let displacement = self.displacement_from(&before[old].contact, &contacts[new]);
                    PossibleHeir { displacement, old, new }
                })
            };
            let mut heirs: Vec<PossibleHeir> = range.filter(|&k| is_unknown(&before[k])).flat_map(heirs_of).collect();
            heirs.sort_by(|a, b| a.displacement.total_cmp(&b.displacement));
            let mut untaken: Vec<usize> = heirs.iter().map(|heir| heir.old).collect();
            for PossibleHeir { displacement, old, new } in heirs {
                let is_near = displacement <= self.max_displacement(&before[old]);
                if is_near && found[new].is_none() && untaken.contains(&old) {
                    found[new] = Some(ContactId::new(old));
                    untaken.retain(|other| *other != old);
                }
            }
        }
    }

    /// Whether a contact of the last step, by its index, had a bond, an impulse or another state that its law remembers.
    fn has_history(&self, k: usize) -> bool {
        self.state.contacts[k].impulse != Vec3::zeros() || self.has_shared_history(k)
    }

    /// Whether a contact of the last step, by its index, has a state that the contacts of a face share.
    fn has_shared_history(&self, k: usize) -> bool {
        let has_law_memory = || self.state.memories.get(k).is_some_and(|memory| *memory != LawMemory::default());
        self.state.contacts[k].bond.is_some() || has_law_memory()
    }

    /// Whether a contact can change its key: two spheres have one contact, always with the same key.
    fn has_features(&self, contact: &Contact) -> bool {
        !self.scene.sphere_flags[contact.antagonist.index()]
    }

    /// Whether each contact of the last step carried an impulse and no longer acts under its key. Nearly always empty.
    fn lost_contacts(&self, contacts: &[Contact], found: &[Option<ContactId>]) -> Vec<bool> {
        let before = &self.state.contacts;
        let may_go = |(k, old): (usize, &SolvedContact)| self.has_features(&old.contact) && self.has_history(k);
        let mut gone: Vec<bool> = before.par_iter().enumerate().with_min_len(CONTACTS_PER_TASK).map(may_go).collect();
        if !gone.contains(&true) {
            return gone;
        }
        let acting_old =
            |(k, contact): (usize, &Contact)| found[k].filter(|&old| gone[old.index()] && self.can_act(contact));
        let still_acting: Vec<ContactId> =
            contacts.par_iter().enumerate().with_min_len(256).filter_map(acting_old).collect();
        still_acting.into_iter().for_each(|old| gone[old.index()] = false);
        gone
    }

    /// Contacts that act and have no history, between contactors with a lost or bonded contact, in their order.
    fn new_contacts(&self, contacts: &[Contact], found: &[Option<ContactId>], gone: &[bool]) -> Vec<usize> {
        let before = &self.state.contacts;
        let has_history_to_share = |k: usize| self.has_shared_history(k) && self.has_features(&before[k].contact);
        let all = (0..before.len()).into_par_iter().with_min_len(CONTACTS_PER_TASK);
        let pairs_with_history = all.filter(|&k| gone[k] || has_history_to_share(k));
        let pairs_with_history: Vec<ContactorPair> =
            pairs_with_history.map(|k| contactor_pair(&before[k].contact)).collect();
        if pairs_with_history.is_empty() {
            return Vec::new();
        }
        let was_in_range = |k: ContactId| {
            let old = &before[k.index()];
            let law = &self.state.laws[old.contact.law];
            self.has_history(k.index()) || old.contact.gap <= law.interaction_range(self.effective_radius(&old.contact))
        };
        let is_new = |&k: &usize| {
            self.has_features(&contacts[k])
                && pairs_with_history.binary_search(&contactor_pair(&contacts[k])).is_ok()
                && !found[k].is_some_and(was_in_range)
                && self.can_act(&contacts[k])
        };
        (0..contacts.len()).into_par_iter().with_min_len(256).filter(is_new).collect()
    }

    /// Gives `new` contacts the lost histories of the same two contactors, the nearest first and each once. In a bonded face
    /// that is no larger than before, the remaining contacts share the history of the nearest.
    fn transfer_history(&self, new: &[usize], gone: &[bool], contacts: &[Contact], found: &mut [Option<ContactId>]) {
        let before = &self.state.contacts;
        let pair = contactor_pair(&contacts[new[0]]);
        let now = &contacts[pair_range(contacts, pair, |contact| contact)];
        let old = pair_range(before, pair, |old| &old.contact);
        let heirs_of = |old: usize| {
            new.iter().map(move |&new| {
                let displacement = self.displacement_from(&before[old].contact, &contacts[new]);
                PossibleHeir { displacement, old, new }
            })
        };
        let mut heirs: Vec<PossibleHeir> = old.clone().filter(|&k| self.has_history(k)).flat_map(heirs_of).collect();
        heirs.sort_by(|a, b| a.displacement.total_cmp(&b.displacement));
        let mut untransferred: Vec<usize> = old.clone().filter(|&k| gone[k]).collect();
        let mut without_history = new.to_vec();
        for &PossibleHeir { old, new, .. } in &heirs {
            if without_history.contains(&new) && untransferred.contains(&old) {
                found[new] = Some(ContactId::new(old));
                untransferred.retain(|other| *other != old);
                without_history.retain(|other| *other != new);
            }
        }
        let old_area = before[old].iter().map(|old| old.contact.area).sum::<f64>();
        let area = now.iter().map(|contact| contact.area).sum::<f64>();
        let is_same_face = old_area > 0.0 && area <= old_area * (1.0 + MAX_TOUCHING_GAP);
        let shares_history = |heir: &PossibleHeir| is_same_face && self.has_shared_history(heir.old);
        for PossibleHeir { old, new, .. } in heirs.into_iter().filter(shares_history) {
            if without_history.contains(&new) {
                found[new] = Some(ContactId::new(old));
                without_history.retain(|other| *other != new);
            }
        }
    }

    /// Displacement from the position to which the candidate has carried a contact of the last step, to this one of the same
    /// contactors, m.
    fn displacement_from(&self, old: &Contact, contact: &Contact) -> f64 {
        (contact.point - self.q_c.x[old.candidate.index()] - self.carried_arm(old)).norm()
    }

    /// Largest displacement of a contact, m: the slip since the last step, the gap, as points of files may lie on either body,
    /// and some for digits of files and accelerations.
    fn max_displacement(&self, old: &SolvedContact) -> f64 {
        // Corners are farther apart than this part of the radius, and acceleration and digits move points by much less.
        const NEAR_POSITION: f64 = 0.1;
        let slip = old.velocity.norm() * self.configuration_interval();
        slip + old.contact.gap.max(0.0) + NEAR_POSITION * self.effective_radius(&old.contact)
    }

    /// Vector from the centre of the candidate to the point to which it has carried a contact of the last step, m.
    fn carried_arm(&self, old: &Contact) -> Vec3 {
        let (state, a) = (self.state, old.candidate.index());
        let centre = state.x[a] - state.v[a] * (self.scene.options.theta * state.h); // at the last contact configuration
        let turn = rotate_by_vector(&Quat::identity(), &(state.w[a] * self.configuration_interval()));
        turn * (old.point - centre)
    }

    /// Contacts of the last step that pushed, in their order. `history`: contact of the last step of each contact.
    pub(super) fn last_loads(&self, contacts: &[Contact], history: &[Option<ContactId>]) -> Vec<LastLoad> {
        let before = &self.state.contacts;
        let mut stays = vec![false; before.len()];
        for (contact, old) in contacts.iter().zip(history) {
            if let Some(old) = old {
                stays[old.index()] |= before[old.index()].contact.key() == contact.key();
            }
        }
        let pushed = before.iter().zip(stays).filter(|(old, _)| old.impulse.x > 0.0);
        let scale = self.q_c.h / self.state.h;
        pushed
            .map(|(old, stays)| LastLoad {
                bodies: [old.contact.candidate, old.contact.antagonist],
                normal: old.contact.normal,
                point: self.q_c.x[old.contact.candidate.index()] + self.carried_arm(&old.contact),
                load: old.impulse.x * scale,
                stays,
            })
            .collect()
    }

    /// Time from the last contact configuration to this one, s.
    fn configuration_interval(&self) -> f64 {
        let theta = self.scene.options.theta;
        theta * self.state.h + (1.0 - theta) * self.q_c.h
    }

    /// Vector of the last contact configuration turned with two bodies to this one, world frame.
    pub(super) fn turned_with_pair(&self, contact: &Contact, vector: &Vec3) -> Vec3 {
        let [a, b] = [contact.candidate, contact.antagonist].map(|body| self.state.w[body.index()]);
        rotate_by_vector(&Quat::identity(), &((a + b) * (0.5 * self.configuration_interval()))) * vector
    }

    /// Gap at which a new elastic bond carries the normal force of its contact in the last step, less the gap now, m.
    fn gap_under_load(&self, old: Option<&SolvedContact>, contact: &Contact, law: &ContactLaw) -> f64 {
        let (Some(stiffness), Some(old)) = (law.bond_stiffness(), old) else { return 0.0 };
        let area = std::f64::consts::PI * self.contact_radius(contact).powi(2);
        let is_loaded = old.impulse.x > 0.0 && area > 0.0;
        if is_loaded { old.impulse.x / (self.state.h * stiffness.normal * area) } else { 0.0 }
    }

    /// Whether a contact with the history `old` is bonded, or has its law's other memory set, in this step.
    fn begins_history(&self, old: Option<ContactId>) -> bool {
        match self.state.bonding {
            BondingMode::All => true,
            BondingMode::New => old.is_none(),
            BondingMode::No => false,
        }
    }

    /// Memory of the law of each contact in this step; empty if no law has one. Contacts within the alert distance have a
    /// reference gap, as in LMGC90.
    pub(super) fn law_memories(&self, contacts: &[Contact], history: &[Option<ContactId>]) -> Vec<LawMemory> {
        if !self.state.laws.iter().any(ContactLaw::has_law_memory) {
            return Vec::new();
        }
        let memory_of = |(contact, old): (&Contact, &Option<ContactId>)| {
            let law = &self.state.laws[contact.law];
            if !law.has_law_memory() {
                return LawMemory::default();
            }
            let is_within = || self.alert_distance(contact).is_some_and(|alert| contact.gap <= alert);
            if self.begins_history(*old) && is_within() {
                let soundness = if law.interface.is_some() { 1.0 } else { 0.0 };
                return LawMemory { reference_gap: law.reference_gap(contact.gap), soundness, sliding: Vec3::zeros() };
            }
            let old = old.or_else(|| self.nearest_before(contact));
            old.map_or(LawMemory::default(), |k| {
                let memory = self.state.law_memory(k);
                if law.interface.is_none() {
                    return memory;
                }
                // The sliding turns with the normal; rotation of the bodies about the normal is neglected.
                let turn = Quat::rotation_between(&self.state.contacts[k.index()].contact.normal, &contact.normal);
                LawMemory { sliding: turn.map_or(memory.sliding, |turn| turn * memory.sliding), ..memory }
            })
        };
        contacts.par_iter().zip(history).with_min_len(256).map(memory_of).collect()
    }

    /// Contact of the last step of the same two contactors nearest to a new one; faces may touch at other corners in each step.
    fn nearest_before(&self, contact: &Contact) -> Option<ContactId> {
        let before = &self.state.contacts;
        let of_pair = pair_range(before, contactor_pair(contact), |old| &old.contact);
        let distance = |k: &usize| self.displacement_from(&before[*k].contact, contact);
        of_pair.min_by(|a, b| distance(a).total_cmp(&distance(b))).map(ContactId::new)
    }

    /// Alert distance of the visibility table for a contact, m.
    pub(super) fn alert_distance(&self, contact: &Contact) -> Option<f64> {
        let Contact { candidate, antagonist, part_numbers, .. } = *contact;
        let a = self.scene.contactor_class(candidate, part_numbers.candidate)?;
        let b = self.scene.contactor_class(antagonist, part_numbers.antagonist)?;
        self.scene.visibility.interaction_rule(a, b).map(|rule| rule.alert)
    }

    /// Bond of each contact's bodies, from the bonds of the last step; empty if no law bonds.
    pub(super) fn bond_states(&self, contacts: &[Contact], history: &[Option<ContactId>]) -> Vec<BondState> {
        if !self.state.laws.iter().any(ContactLaw::can_bond) {
            return Vec::new();
        }
        let bond = |(contact, old): (&Contact, &Option<ContactId>)| {
            let law = &self.state.laws[contact.law];
            let inherited = old.and_then(|k| self.inherited_bond(&self.state.contacts[k.index()], contact, law));
            let is_bonded_now = self.begins_history(*old);
            let new_gap = || {
                let old = old.map(|k| &self.state.contacts[k.index()]);
                law.bonded_at(contact.gap) + self.gap_under_load(old, contact, law)
            };
            let bond = inherited.or_else(|| (is_bonded_now && self.can_bond(contact, law)).then(new_gap));
            bond.filter(|_| self.carries_stress(contact))
        };
        let bonds: Vec<Option<f64>> = contacts.par_iter().zip(history).with_min_len(256).map(bond).collect();
        let mut aggregates = DisjointSets::new(self.scene.bodies.len());
        let bodies = |contact: &Contact| [contact.candidate, contact.antagonist].map(|body| body.index());
        let is_rigid = |contact: &Contact| self.state.laws[contact.law].bonds_are_rigid();
        let rigid = contacts.iter().zip(&bonds).filter(|(contact, bond)| bond.is_some() && is_rigid(contact));
        for (contact, _) in rigid {
            let [a, b] = bodies(contact);
            aggregates.union(a, b);
        }
        let mut is_in_aggregate = |contact: &Contact| {
            let [a, b] = bodies(contact).map(|body| aggregates.find(body));
            a == b
        };
        contacts
            .iter()
            .zip(bonds)
            .map(|(contact, bond)| BondState { bond, in_aggregate: is_in_aggregate(contact) })
            .collect()
    }

    /// Whether a contact may be bonded, now or where the step began: rotation opens the gap before the contact configuration.
    fn can_bond(&self, contact: &Contact, law: &ContactLaw) -> bool {
        let AssemblyContext { scene, q_c, .. } = self;
        let arms = contact_arms(contact, &q_c.x);
        let u = velocity_at_arms(contact, &arms, self.start) - self.arm_turning_velocity(contact, &arms, false) * 0.5;
        let at_start = contact.gap - (1.0 - scene.options.theta) * q_c.h * contact.normal.dot(&u);
        law.bond_gap(contact.gap.min(at_start), self.effective_radius(contact)).is_some()
    }

    /// Gap of the bond that a contact inherits from the last step, m. It is the old gap if the contact is at the same
    /// position. Elsewhere it is the current gap, if the contact touches and the old one would still be in reach, less the
    /// opening of an elastic bond.
    pub(super) fn inherited_bond(&self, old: &SolvedContact, contact: &Contact, law: &ContactLaw) -> Option<f64> {
        let (bond, radius) = (old.bond?, self.effective_radius(contact));
        let is_same_position = old.contact.key() == contact.key() || old.contact.features.candidate == UNKNOWN_FEATURE;
        // Smaller distances are within the gap that counts as touching.
        let tolerance = MAX_TOUCHING_GAP * radius;
        if is_same_position || self.displacement_from(&old.contact, contact) <= tolerance {
            return Some(bond);
        }
        let foreseen_gap = old.contact.gap + old.velocity.x * self.configuration_interval();
        let opening = if law.bond_stiffness().is_some() { old.contact.gap - bond } else { 0.0 };
        let new_gap = law.bond_gap(contact.gap, radius).filter(|_| foreseen_gap <= law.interaction_range(radius));
        new_gap.map(|gap| gap - opening)
    }
}

/// r̂ of the same contact in the last step, scaled to the new step length. With friction its tangential part is rotated into
/// the new tangent plane.
pub(super) fn warm_start(old: &SolvedContact, contact: &Contact, shift: &LawShift, scale: f64) -> Vec3 {
    let n = contact.normal;
    let normal = n * (old.impulse.x * scale - shift.impulse).max(0.0);
    if shift.friction == 0.0 {
        return normal;
    }
    if old.impulse == Vec3::zeros() && shift.impulse == 0.0 {
        return Vec3::zeros(); // most contacts are open
    }
    let [_, t_old, s_old] = old.contact.frame();
    let tangential = t_old * old.impulse.y + s_old * old.impulse.z;
    normal + (tangential - n * n.dot(&tangential)) * scale
}
