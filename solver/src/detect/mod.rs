//! Room: the contact configuration to contacts.
//!
//! A pair is listed when its gap is at most the alert distance of its row in TACT_BEHAV.DAT, or
//! the range of its cohesion, or what its two bodies can travel in the step at their free
//! velocities, h (|v_a| + |v_b|): so no contact that can close in the step is missed, however
//! short the alert distance.

pub mod broad;
pub mod narrow;
mod neighbours;
mod parts;
mod periodic;

use std::collections::BTreeMap;

use cd_formats::compute::NarrowPhase;
use rayon::prelude::*;

use crate::math::{MANY, Vec3, group};
use crate::scene::{Scene, Shape};
use crate::state::{Contact, Known};

use crate::integrate::Configuration;

/// All listed contacts, in the order of [`Contact::key`].
///
/// `v_free`: velocities after the step if nothing touched, m/s.
/// `known`: of the last step, then of this one.
pub fn contacts(scene: &Scene, q_c: &Configuration, v_free: &[Vec3], known: &mut Known) -> Vec<Contact> {
    let h = q_c.ahead;
    let travel = travel(q_c, v_free);
    if scene.is_general() {
        return parts::contacts(scene, q_c, &travel, scene.options.narrow_phase(), known);
    }
    let mut pairs = among_spheres(scene, q_c, &travel);
    pairs.extend(with_planes(scene, q_c, &travel, h));
    let of_pair = |&[candidate, antagonist]: &[u32; 2]| contact(scene, q_c, candidate, antagonist);
    sorted(scene, pairs).par_iter().with_min_len(256).map(of_pair).collect()
}

/// How far each body can get in the step beside the others, m.
fn travel(q_c: &Configuration, v_free: &[Vec3]) -> Vec<f64> {
    v_free.par_iter().with_min_len(MANY).map(|v| q_c.ahead * (v - q_c.drift).norm()).collect()
}

/// What the fast narrow phase misses, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Missed {
    /// Difference of a pair's least gap from what the accurate narrow phase finds, mean of the pairs that touch for one of them.
    pub mean: f64,
    pub largest: f64,
}

/// Compares `contacts` with what the accurate narrow phase finds; the other arguments are those of [`contacts`] that made
/// them. A pair that only one of them lists counts with its overlap.
pub fn missed(scene: &Scene, q_c: &Configuration, v_free: &[Vec3], known: &Known, contacts: &[Contact]) -> Missed {
    let exact = parts::contacts(scene, q_c, &travel(q_c, v_free), NarrowPhase::Accurate, &mut known.clone());
    let pair = |contact: &Contact| (contact.candidate, contact.antagonist, contact.ranks);
    let gaps = |contacts: &[Contact]| {
        let mut gaps = BTreeMap::new();
        for contact in contacts {
            let least: &mut f64 = gaps.entry(pair(contact)).or_insert(f64::INFINITY);
            *least = least.min(contact.gap);
        }
        gaps
    };
    let (found, exact) = (gaps(contacts), gaps(&exact));
    let both = found.keys().chain(exact.keys().filter(|pair| !found.contains_key(pair)));
    let away = both.filter_map(|pair| match (found.get(pair), exact.get(pair)) {
        (Some(gap), Some(other)) => (gap.min(*other) <= 0.0).then(|| (gap - other).abs()),
        (gap, other) => gap.or(other).filter(|gap| **gap <= 0.0).map(|gap| -gap),
    });
    let (count, sum, largest) = away.fold((0, 0.0, 0.0f64), |(n, sum, most), x| (n + 1, sum + x, most.max(x)));
    Missed { mean: sum / count.max(1) as f64, largest }
}

/// In the order of candidates, then of antagonists.
fn sorted(scene: &Scene, pairs: Vec<[u32; 2]>) -> Vec<[u32; 2]> {
    // By candidate first, so that only the few of one body remain to be sorted.
    let candidates: Vec<u32> = pairs.iter().map(|pair| pair[0]).collect();
    let (order, _) = group(&candidates, scene.bodies.len());
    let mut sorted: Vec<[u32; 2]> = order.par_iter().with_min_len(2048).map(|&k| pairs[k as usize]).collect();
    sorted.par_chunk_by_mut(|a, b| a[0] == b[0]).for_each(|of_one| of_one.sort_unstable_by_key(|pair| pair[1]));
    sorted
}

/// Candidate and antagonist of the listed pairs.
fn among_spheres(scene: &Scene, q_c: &Configuration, travel: &[f64]) -> Vec<[u32; 2]> {
    let radius = |i: u32| scene.bodies[i as usize].radius;
    let centres: Vec<Vec3> = scene.spheres.iter().map(|&i| q_c.x[i as usize]).collect();
    let reach: Vec<f64> =
        scene.spheres.iter().map(|&i| radius(i) + travel[i as usize] + 0.5 * scene.listing_range).collect();
    periodic::pairs(&centres, &reach, scene.periods())
        .into_par_iter()
        .with_min_len(512)
        .map(|[i, j]| [scene.spheres[i as usize], scene.spheres[j as usize]])
        .filter(|&[a, b]| is_listed(scene, q_c, a, b, travel[a as usize] + travel[b as usize]))
        .collect()
}

fn with_planes(scene: &Scene, q_c: &Configuration, travel: &[f64], h: f64) -> Vec<[u32; 2]> {
    let with = |&plane: &u32| {
        let p = plane as usize;
        let Shape::Plane { half_lengths } = scene.bodies[p].shape else { unreachable!("planes lists planes") };
        // A wall's travel is that of its farthest corner.
        let swept = travel[p] + h * q_c.w[p].norm() * half_lengths.norm();
        let into_axes = q_c.q[p].inverse().to_rotation_matrix();
        let near = move |&sphere: &u32| {
            let s = sphere as usize;
            let travel = travel[s] + swept;
            // Most are far off: that takes no law and no geometry.
            let from = q_c.x[s] - q_c.x[p] - scene.image(&q_c.x[s], &q_c.x[p]);
            let gap = ((into_axes * from).abs() - half_lengths).max() - scene.bodies[s].radius;
            gap <= scene.listing_range + travel && is_listed(scene, q_c, sphere, plane, travel)
        };
        scene.spheres.par_iter().copied().with_min_len(512).filter(near).map(move |sphere| [sphere, plane])
    };
    scene.planes.par_iter().flat_map(with).collect()
}

/// Geometry of a sphere against a sphere or plate.
fn found(scene: &Scene, q_c: &Configuration, candidate: u32, antagonist: u32) -> narrow::Found {
    let [a, b] = [candidate, antagonist].map(|i| (&scene.bodies[i as usize], q_c.x[i as usize]));
    let (a, b) = ((a.0, &a.1), (b.0, &(b.1 + scene.image(&a.1, &b.1))));
    match &b.0.shape {
        Shape::Plane { half_lengths } => {
            narrow::sphere_plane(a.1, a.0.radius, b.1, &q_c.q[antagonist as usize], half_lengths)
        }
        _ => narrow::sphere_sphere(a.1, a.0.radius, b.1, b.0.radius),
    }
}

/// Whether the two see each other, are near enough, and not both driven.
fn is_listed(scene: &Scene, q_c: &Configuration, candidate: u32, antagonist: u32, travel: f64) -> bool {
    let [a, b] = [candidate, antagonist].map(|i| &scene.bodies[i as usize]);
    let Some(see) = scene.visibility.see(a.class, b.class) else { return false };
    if a.driven && b.driven {
        return false;
    }
    let gap = found(scene, q_c, candidate, antagonist).gap;
    // The range of a bond needs the radii, which a near pair is not asked for.
    let law = &scene.laws[see.law as usize];
    let range = || law.range(scene.effective_radius((candidate, 0), (antagonist, 0)));
    gap <= see.alert.max(travel) || (law.cohesion().is_some() && gap <= range())
}

fn contact(scene: &Scene, q_c: &Configuration, candidate: u32, antagonist: u32) -> Contact {
    let found = found(scene, q_c, candidate, antagonist);
    let [a, b] = [candidate, antagonist].map(|i| scene.bodies[i as usize].class);
    Contact {
        candidate,
        antagonist,
        ranks: (0, 0),
        features: (0, found.feature),
        point: found.point,
        image: scene.image(&q_c.x[candidate as usize], &q_c.x[antagonist as usize]),
        normal: found.normal,
        gap: found.gap,
        area: 0.0,
        law: scene.visibility.see(a, b).map_or(0, |see| see.law),
    }
}
