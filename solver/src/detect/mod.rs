//! Stage: detects the contacts of the contact configuration.
//!
//! A pair is listed if its gap is at most the alert distance of its row in TACT_BEHAV.DAT or the range of its cohesion,
//! or if the free relative velocity of its bodies closes the gap in the step. Every contact that can close in the step is
//! therefore listed, however short the alert distance. Common or separating motion lists no pair. Contact impulses may
//! turn bodies towards others: `late` detects the pairs that the solved velocities close.

mod candidate_division;
mod joints;
mod late;
mod links;
pub mod narrow;
mod neighbours;
mod parts;
mod periodic;
mod posed;
mod rank_pairs;
mod spheres;
pub mod swept;
mod travel;

pub use candidate_division::{divide_contacts, gather_contacts_to_first, migrate_contacts};
pub use late::late_contacts;

use std::collections::BTreeMap;

use cd_formats::compute::NarrowPhase;
use rayon::prelude::*;

use self::spheres::{sphere_contact, sphere_plate_pairs, sphere_sphere_pairs};
use self::travel::TravelBounds;
use crate::integrate::ContactConfiguration;
use crate::math::sort_runs_by_key;
use crate::scene::Scene;
use crate::state::{Contact, DetectionCache, Velocities};

/// All listed contacts, in the order of [`Contact::key`]; of contacts that are divided among ranks, those of this rank.
///
/// `free`: velocities after the step if nothing touched.
/// `cache`: data of the last step; updated to this step.
pub fn listed_contacts(
    scene: &Scene,
    q_c: &ContactConfiguration,
    free: Velocities,
    cache: &mut DetectionCache,
) -> Vec<Contact> {
    let mut contacts = surface_contacts(scene, q_c, free, cache);
    if !scene.links.is_empty() {
        contacts.extend(links::link_contacts(scene, q_c));
        contacts.sort_unstable_by_key(Contact::key);
    }
    contacts
}

/// Listed contacts of surfaces; arguments and order as in [`listed_contacts`].
fn surface_contacts(
    scene: &Scene,
    q_c: &ContactConfiguration,
    free: Velocities,
    cache: &mut DetectionCache,
) -> Vec<Contact> {
    let bounds = TravelBounds::new(scene, q_c, free, q_c.lookahead);
    if scene.has_parts() {
        return parts::listed_contacts(scene, q_c, &bounds, scene.options.narrow_phase(), cache);
    }
    let mut pairs = sphere_sphere_pairs(scene, q_c, &bounds, cache);
    let own_spheres = cache.own_spheres(scene);
    let spheres = &scene.spheres[own_spheres.start as usize..own_spheres.end as usize];
    let mut plate_pairs =
        joints::without_inner_rims(scene, q_c, &bounds, sphere_plate_pairs(scene, q_c, &bounds, spheres));
    if !plate_pairs.is_empty() {
        pairs.append(&mut plate_pairs);
        sort_runs_by_key(&mut pairs, |pair| *pair);
    }
    pairs.par_iter().with_min_len(256).map(|&(pair, law)| sphere_contact(scene, q_c, pair, law)).collect()
}

/// Error of the fast narrow phase, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NarrowPhaseError {
    /// Difference of a pair's smallest gap between the fast and the accurate narrow phase, mean over the pairs that touch
    /// in either.
    pub mean: f64,
    /// Largest of these differences.
    pub largest: f64,
}

/// Compares `contacts` with the result of the accurate narrow phase; the other arguments are as in [`listed_contacts`]
/// that gave `contacts`. A pair that only one of the two lists counts with its overlap.
pub fn narrow_phase_error(
    scene: &Scene,
    q_c: &ContactConfiguration,
    free: Velocities,
    cache: &DetectionCache,
    contacts: &[Contact],
) -> NarrowPhaseError {
    let exact = parts::listed_contacts(
        scene,
        q_c,
        &TravelBounds::new(scene, q_c, free, q_c.lookahead),
        NarrowPhase::Accurate,
        &mut cache.clone(),
    );
    let pair = |contact: &Contact| (contact.candidate, contact.antagonist, contact.part_numbers);
    let gaps = |contacts: &[Contact]| {
        let mut gaps = BTreeMap::new();
        for contact in contacts {
            let smallest: &mut f64 = gaps.entry(pair(contact)).or_insert(f64::INFINITY);
            *smallest = smallest.min(contact.gap);
        }
        gaps
    };
    let (found, exact) = (gaps(contacts), gaps(&exact));
    let all_pairs = found.keys().chain(exact.keys().filter(|pair| !found.contains_key(pair)));
    let differences = all_pairs.filter_map(|pair| match (found.get(pair), exact.get(pair)) {
        (Some(gap), Some(other)) => (gap.min(*other) <= 0.0).then(|| (gap - other).abs()),
        (gap, other) => gap.or(other).filter(|gap| **gap <= 0.0).map(|gap| -gap),
    });
    let (count, sum, largest) = differences.fold((0, 0.0, 0.0f64), |(count, sum, largest), difference| {
        (count + 1, sum + difference, largest.max(difference))
    });
    NarrowPhaseError { mean: sum / count.max(1) as f64, largest }
}
