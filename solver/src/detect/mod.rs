//! Room: the contact configuration to contacts.
//!
//! A pair is listed when its gap is at most the alert distance of its row in TACT_BEHAV.DAT, or
//! the range of its cohesion, or what its two bodies can travel in the step at their free
//! velocities, h (|v_a| + |v_b|), and what surfaces that turn add: so no contact that can close in the step
//! is missed, however short the alert distance.

pub mod broad;
pub mod narrow;
mod neighbours;
mod parts;
mod periodic;

use std::collections::BTreeMap;

use cd_formats::compute::NarrowPhase;
use rayon::prelude::*;

use crate::math::{MANY, Vec3};
use crate::scene::{Scene, See, Shape};
use crate::state::{Contact, Known};

use crate::integrate::Configuration;

/// All listed contacts, in the order of [`Contact::key`].
///
/// `free`: velocities (m/s) and angular velocities (rad/s) after the step if nothing touched.
/// `known`: of the last step, then of this one.
pub fn contacts(scene: &Scene, q_c: &Configuration, free: [&[Vec3]; 2], known: &mut Known) -> Vec<Contact> {
    let ways = Ways::new(q_c, free);
    if scene.is_general() {
        return parts::contacts(scene, q_c, &ways, scene.options.narrow_phase(), known);
    }
    let mut pairs = among_spheres(scene, q_c, &ways.travel, known);
    let mut of_planes = with_planes(scene, q_c, &ways);
    if !of_planes.is_empty() {
        pairs.append(&mut of_planes);
        pairs.sort(); // runs in order, which it finds
    }
    pairs.par_iter().with_min_len(256).map(|&(pair, law)| contact(scene, q_c, pair, law)).collect()
}

/// How far bodies can get in the step.
struct Ways<'a> {
    /// Each beside the others, m.
    travel: Vec<f64>,
    w_free: &'a [Vec3],
    /// s
    ahead: f64,
}

impl<'a> Ways<'a> {
    fn new(q_c: &Configuration, [v_free, w_free]: [&'a [Vec3]; 2]) -> Self {
        let ahead = q_c.ahead;
        let travel = v_free.par_iter().with_min_len(MANY).map(|v| ahead * (v - q_c.drift).norm()).collect();
        Ways { travel, w_free, ahead }
    }

    /// The way of what turns with body `i`, at most `arm` (m) from its centre, m.
    fn of_rim(&self, i: usize, arm: f64) -> f64 {
        self.travel[i] + self.ahead * self.w_free[i].norm() * arm
    }
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
pub fn missed(scene: &Scene, q_c: &Configuration, free: [&[Vec3]; 2], known: &Known, contacts: &[Contact]) -> Missed {
    let exact = parts::contacts(scene, q_c, &Ways::new(q_c, free), NarrowPhase::Accurate, &mut known.clone());
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

/// Candidate and antagonist within range of each other, and their law.
type Listed = ([u32; 2], u8);

/// In the order of candidates, then of antagonists.
fn among_spheres(scene: &Scene, q_c: &Configuration, travel: &[f64], known: &mut Known) -> Vec<Listed> {
    let bodies = scene.spheres.par_iter().with_min_len(MANY);
    let centres: Vec<Vec3> = bodies.clone().map(|&i| q_c.x[i as usize]).collect();
    let radii: Vec<f64> = bodies.map(|&i| scene.bodies[i as usize].radius).collect();
    let reach = |(k, radius): (usize, &f64)| radius + travel[scene.spheres[k] as usize] + 0.5 * scene.listing_range;
    let reach: Vec<f64> = radii.iter().enumerate().map(reach).collect();
    let of_sphere = |k: usize| travel[scene.spheres[k] as usize];
    if known.neighbours.renew(&centres, &reach, of_sphere, scene.periods(), scene.mean_radius) {
        let near = std::mem::take(&mut known.neighbours.pairs);
        known.pairs = near.into_par_iter().with_min_len(1024).filter_map(|pair| meet(scene, pair)).collect();
        known.pairs.par_sort_unstable_by_key(|(pair, _)| *pair);
    }
    let listed = |&([i, j], see): &([u32; 2], See)| {
        let pair = [i, j].map(|k| scene.spheres[k as usize]);
        let [a, b] = [i, j].map(|k| (&centres[k as usize], radii[k as usize]));
        let gap = narrow::sphere_sphere(a.0, a.1, &(b.0 + scene.image(a.0, b.0)), b.1).gap;
        let travel = travel[pair[0] as usize] + travel[pair[1] as usize];
        is_listed(scene, pair, see, gap, travel).then_some((pair, see.law))
    };
    known.pairs.par_iter().with_min_len(512).filter_map(listed).collect()
}

/// Two of the spheres and how they see each other; none if they do not, or cannot push.
fn meet(scene: &Scene, pair: [u32; 2]) -> Option<([u32; 2], See)> {
    let [a, b] = pair.map(|k| &scene.bodies[scene.spheres[k as usize] as usize]);
    Some((pair, scene.visibility.see(a.class, b.class)?)).filter(|_| !(a.driven && b.driven))
}

fn with_planes(scene: &Scene, q_c: &Configuration, ways: &Ways) -> Vec<Listed> {
    let with = |&plane: &u32| {
        let p = plane as usize;
        let Shape::Plane { half_lengths } = scene.bodies[p].shape else { unreachable!("planes lists planes") };
        // A wall's travel is that of its farthest corner.
        let swept = ways.of_rim(p, half_lengths.norm());
        let into_axes = q_c.q[p].inverse().to_rotation_matrix();
        let near = move |&sphere: &u32| {
            let (s, pair) = (sphere as usize, [sphere, plane]);
            let travel = ways.travel[s] + swept;
            // Most are far off: that takes no law and no geometry.
            let from = q_c.x[s] - q_c.x[p] - scene.image(&q_c.x[s], &q_c.x[p]);
            let gap = ((into_axes * from).abs() - half_lengths).max() - scene.bodies[s].radius;
            let [sphere, plane] = [s, p].map(|i| &scene.bodies[i]);
            let near = gap <= scene.listing_range + travel && !(sphere.driven && plane.driven);
            let see = scene.visibility.see(sphere.class, plane.class).filter(|_| near)?;
            is_listed(scene, pair, see, found(scene, q_c, pair).gap, travel).then_some((pair, see.law))
        };
        scene.spheres.par_iter().with_min_len(512).filter_map(near)
    };
    scene.planes.par_iter().flat_map(with).collect()
}

/// Geometry of a sphere against a sphere or plate.
fn found(scene: &Scene, q_c: &Configuration, [candidate, antagonist]: [u32; 2]) -> narrow::Found {
    let [a, b] = [candidate, antagonist].map(|i| (&scene.bodies[i as usize], q_c.x[i as usize]));
    let (a, b) = ((a.0, &a.1), (b.0, &(b.1 + scene.image(&a.1, &b.1))));
    match &b.0.shape {
        Shape::Plane { half_lengths } => {
            narrow::sphere_plane(a.1, a.0.radius, b.1, &q_c.q[antagonist as usize], half_lengths)
        }
        _ => narrow::sphere_sphere(a.1, a.0.radius, b.1, b.0.radius),
    }
}

/// Whether two that see each other so are near enough.
fn is_listed(scene: &Scene, [candidate, antagonist]: [u32; 2], see: See, gap: f64, travel: f64) -> bool {
    // The range of a bond needs the radii, which a near pair is not asked for.
    let law = &scene.laws[see.law as usize];
    let range = || law.range(scene.effective_radius((candidate, 0), (antagonist, 0)));
    gap <= see.alert.max(travel) || (law.cohesion().is_some() && gap <= range())
}

fn contact(scene: &Scene, q_c: &Configuration, pair: [u32; 2], law: u8) -> Contact {
    let found = found(scene, q_c, pair);
    let [candidate, antagonist] = pair;
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
        law,
    }
}
