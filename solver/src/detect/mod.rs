//! Room: the contact configuration to contacts.
//!
//! A pair is listed when its gap is at most the alert distance of its row in TACT_BEHAV.DAT, or
//! the range of its cohesion, or what its two bodies can travel in the step at their free
//! velocities, h (|v_a| + |v_b|): so no contact that can close in the step is missed, however
//! short the alert distance.

mod broad;
pub mod narrow;
mod parts;

use rayon::prelude::*;

use crate::math::{Vec3, group, local_frame};
use crate::scene::{Scene, Shape};
use crate::state::{Contact, PairMemory};

use crate::integrate::Configuration;

/// All listed contacts, in the order of [`Contact::key`].
///
/// `v_free`: velocities after the step if nothing touched, m/s; `h`: s.
/// `pairs`: what the last step kept of its pairs; returns what is to be kept of this one's.
pub fn contacts(
    scene: &Scene,
    q_c: &Configuration,
    v_free: &[Vec3],
    h: f64,
    pairs: &[PairMemory],
) -> (Vec<Contact>, Vec<PairMemory>) {
    let travel: Vec<f64> = v_free.iter().map(|v| h * v.norm()).collect();
    if scene.is_general() {
        let (found, pairs) = parts::contacts(scene, q_c, &travel, h, pairs);
        return (in_order(scene, found), pairs);
    }
    let mut found = among_spheres(scene, q_c, &travel);
    found.extend(with_planes(scene, q_c, &travel, h));
    (in_order(scene, found), Vec::new())
}

/// In the order of [`Contact::key`].
fn in_order(scene: &Scene, found: Vec<Contact>) -> Vec<Contact> {
    // By candidate first, so that only the few contacts of one body remain to be sorted.
    let candidates: Vec<u32> = found.iter().map(|contact| contact.candidate).collect();
    let (order, starts) = group(&candidates, scene.bodies.len());
    let mut contacts: Vec<Contact> = order.iter().map(|&k| found[k as usize]).collect();
    for of_one in starts.windows(2) {
        contacts[of_one[0] as usize..of_one[1] as usize].sort_unstable_by_key(Contact::key);
    }
    contacts
}

fn among_spheres(scene: &Scene, q_c: &Configuration, travel: &[f64]) -> Vec<Contact> {
    let radius = |i: u32| match scene.bodies[i as usize].shape {
        Shape::Sphere { radius } => radius,
        _ => unreachable!("spheres lists spheres"),
    };
    let centres: Vec<Vec3> = scene.spheres.iter().map(|&i| q_c.x[i as usize]).collect();
    let reach: Vec<f64> =
        scene.spheres.iter().map(|&i| radius(i) + travel[i as usize] + 0.5 * scene.listing_range).collect();
    broad::pairs(&centres, &reach)
        .into_par_iter()
        .with_min_len(256)
        .filter_map(|[i, j]| {
            let (candidate, antagonist) = (scene.spheres[i as usize], scene.spheres[j as usize]);
            let (a, b) = (candidate as usize, antagonist as usize);
            let found = narrow::sphere_sphere(&q_c.x[a], radius(candidate), &q_c.x[b], radius(antagonist));
            list(scene, candidate, antagonist, found, travel[a] + travel[b])
        })
        .collect()
}

fn with_planes(scene: &Scene, q_c: &Configuration, travel: &[f64], h: f64) -> Vec<Contact> {
    scene
        .planes
        .par_iter()
        .flat_map_iter(|&plane| {
            let p = plane as usize;
            let Shape::Plane { half_lengths } = scene.bodies[p].shape else { unreachable!("planes lists planes") };
            // A wall's travel is that of its farthest corner.
            let swept = travel[p] + h * q_c.w[p].norm() * half_lengths.norm();
            scene.spheres.iter().filter_map(move |&sphere| {
                let s = sphere as usize;
                let Shape::Sphere { radius } = scene.bodies[s].shape else { unreachable!("spheres lists spheres") };
                let found = narrow::sphere_plane(&q_c.x[s], radius, &q_c.x[p], &q_c.q[p], &half_lengths);
                list(scene, sphere, plane, found, travel[s] + swept)
            })
        })
        .collect()
}

/// The contact of a pair, if the two see each other, are near enough, and not both driven.
fn list(scene: &Scene, candidate: u32, antagonist: u32, found: narrow::Found, travel: f64) -> Option<Contact> {
    let (a, b) = (&scene.bodies[candidate as usize], &scene.bodies[antagonist as usize]);
    let see = scene.visibility.see(a.class, b.class)?;
    let range = see.alert.max(travel);
    // The range of a bond needs the radii, which a near pair is not asked for.
    let law = &scene.laws[see.law as usize];
    let range = if found.gap > range && law.cohesion.is_some() {
        law.range(scene.effective_radius(candidate, antagonist))
    } else {
        range
    };
    if found.gap > range || (a.driven && b.driven) {
        return None;
    }
    Some(Contact {
        candidate,
        antagonist,
        ranks: (0, 0),
        features: (0, found.feature),
        point: found.point,
        frame: local_frame(found.normal),
        gap: found.gap,
        area: 0.0,
        law: see.law,
    })
}
