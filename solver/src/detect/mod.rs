//! Stage: detects the contacts of the contact configuration.
//!
//! A pair is listed if its gap is at most the alert distance of its row in TACT_BEHAV.DAT or the range of its cohesion,
//! or if the free relative velocity of its bodies closes the gap in the step. Every contact that can close in the step is
//! therefore listed, however short the alert distance. Common or separating motion lists no pair. Contact impulses may
//! turn bodies towards others: `late` detects the pairs that the solved velocities close.

pub mod broad;
mod joints;
mod late;
pub mod narrow;
mod neighbours;
mod parts;
mod periodic;
pub mod swept;

pub use late::late_contacts;

use std::collections::BTreeMap;
use std::sync::Arc;

use cd_formats::compute::NarrowPhase;
use rayon::prelude::*;

use crate::math::{PAR_MIN_LEN, Vec3};
use crate::scene::{BodyShape, InteractionRule, NEARBY_GAP, Scene};
use crate::state::{Contact, DetectionCache};

use self::neighbours::BoundingBalls;

use crate::integrate::ContactConfiguration;

/// All listed contacts, in the order of [`Contact::key`].
///
/// `free`: velocities (m/s) and angular velocities (rad/s) after the step if nothing touched.
/// `known`: cache of the last step; updated to this step.
pub fn listed_contacts(
    scene: &Scene,
    q_c: &ContactConfiguration,
    free: [&[Vec3]; 2],
    known: &mut DetectionCache,
) -> Vec<Contact> {
    let ways = TravelBounds::new(scene, q_c, free, q_c.lookahead);
    if scene.is_general() {
        return parts::listed_contacts(scene, q_c, &ways, scene.options.narrow_phase(), known);
    }
    let mut pairs = sphere_sphere_pairs(scene, q_c, &ways, known);
    let mut of_planes = joints::without_inner_rims(scene, q_c, &ways, sphere_plate_pairs(scene, q_c, &ways));
    if !of_planes.is_empty() {
        pairs.append(&mut of_planes);
        pairs.sort(); // fast: merges sorted runs
    }
    pairs.par_iter().with_min_len(256).map(|&(pair, law)| sphere_contact(scene, q_c, pair, law)).collect()
}

/// Displacements of bodies in the step.
struct TravelBounds<'a> {
    /// Length of each body's displacement relative to the mean motion, m.
    travel: Vec<f64>,
    /// Mean free velocity of the free bodies, m/s; it changes no distance.
    mean_velocity: Vec3,
    v_free: &'a [Vec3],
    w_free: &'a [Vec3],
    /// Time for which contacts are predicted, s.
    lookahead: f64,
    /// [`NEARBY_GAP`] scaled to the lookahead.
    nearby: f64,
}

impl<'a> TravelBounds<'a> {
    fn new(scene: &Scene, q_c: &ContactConfiguration, [v_free, w_free]: [&'a [Vec3]; 2], ahead: f64) -> Self {
        let sum: Vec3 = scene.free.iter().map(|&i| v_free[i as usize]).sum();
        let drift = sum / scene.free.len().max(1) as f64;
        let travel = v_free.par_iter().with_min_len(PAR_MIN_LEN).map(|v| ahead * (v - drift).norm()).collect();
        let steps = if q_c.h > 0.0 { ahead / q_c.h } else { 1.0 };
        TravelBounds { travel, mean_velocity: drift, v_free, w_free, lookahead: ahead, nearby: NEARBY_GAP * steps }
    }

    /// Displacement of the centre of body `i` relative to the mean motion, m.
    fn centre_path(&self, i: usize) -> Vec3 {
        (self.v_free[i] - self.mean_velocity) * self.lookahead
    }

    /// Rotation of body `i`, rad.
    fn rotation_vector(&self, i: usize) -> Vec3 {
        self.w_free[i] * self.lookahead
    }

    /// Largest displacement by rotation of points of body `i` at most `arm` (m) from its centre, m.
    fn surface_travel(&self, i: usize, arm: f64) -> f64 {
        self.travel[i] + self.lookahead * self.w_free[i].norm() * arm
    }
}

/// Error of the fast narrow phase, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NarrowPhaseError {
    /// Difference of a pair's smallest gap between the fast and the accurate narrow phase, mean over the pairs that touch
    /// in either.
    pub mean: f64,
    pub largest: f64,
}

/// Compares `contacts` with the result of the accurate narrow phase; the other arguments are those of [`listed_contacts`]
/// that gave `contacts`. A pair that only one of the two lists counts with its overlap.
pub fn narrow_phase_error(
    scene: &Scene,
    q_c: &ContactConfiguration,
    free: [&[Vec3]; 2],
    known: &DetectionCache,
    contacts: &[Contact],
) -> NarrowPhaseError {
    let exact = parts::listed_contacts(
        scene,
        q_c,
        &TravelBounds::new(scene, q_c, free, q_c.lookahead),
        NarrowPhase::Accurate,
        &mut known.clone(),
    );
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
    NarrowPhaseError { mean: sum / count.max(1) as f64, largest }
}

/// Candidate and antagonist within range of each other, and their law.
type ListedPair = ([u32; 2], u8);

/// Contacts of spheres with spheres, ordered by candidate, then by antagonist.
fn sphere_sphere_pairs(
    scene: &Scene,
    q_c: &ContactConfiguration,
    ways: &TravelBounds,
    known: &mut DetectionCache,
) -> Vec<ListedPair> {
    let bodies = scene.spheres.par_iter().with_min_len(PAR_MIN_LEN);
    let centres: Vec<Vec3> = bodies.clone().map(|&i| q_c.x[i as usize]).collect();
    let travel: Vec<f64> = bodies.clone().map(|&i| ways.travel[i as usize]).collect();
    let radii: Vec<f64> = bodies.map(|&i| scene.bodies[i as usize].radius).collect();
    let reach = |(radius, travel): (&f64, &f64)| radius + travel + 0.5 * scene.listing_range;
    let reach: Vec<f64> = radii.iter().zip(&travel).map(reach).collect();
    let path = |k: usize| ways.centre_path(scene.spheres[k] as usize);
    let things = BoundingBalls { centres: &centres, reach: &reach, path, travel: &travel };
    if known.neighbours.rebuild_if_stale(&things, scene.periods(), scene.mean_radius) {
        let near = std::mem::take(&mut known.neighbours.pairs);
        let visible = near.into_par_iter().with_min_len(1024).filter_map(|pair| visible_pair(scene, pair));
        let mut pairs: Vec<([u32; 2], InteractionRule)> = visible.collect();
        pairs.par_sort_unstable_by_key(|(pair, _)| *pair);
        known.pairs = Arc::new(pairs);
    }
    let listed = |&([i, j], see): &([u32; 2], InteractionRule)| {
        let pair = [i, j].map(|k| scene.spheres[k as usize]);
        let [i, j] = [i as usize, j as usize];
        let (a, b) = (centres[i], centres[j] + scene.nearest_image_shift(&centres[i], &centres[j]));
        let gap = narrow::sphere_sphere(&a, radii[i], &b, radii[j]).gap;
        let approach = ApproachBounds { travel: travel[i] + travel[j], nearby: ways.nearby * radii[i].min(radii[j]) };
        let closing = || swept::least_distance(&(a - b), &(path(i) - path(j))) - (radii[i] + radii[j]);
        is_listed(scene, pair, see, gap, approach, closing).then_some((pair, see.law))
    };
    known.pairs.par_iter().with_min_len(512).filter_map(listed).collect()
}

/// Pair with the candidate first, and its visibility rule; `None` if the table has no rule for it, or if the
/// motion of both bodies is imposed.
fn visible_pair(scene: &Scene, pair: [u32; 2]) -> Option<([u32; 2], InteractionRule)> {
    let [a, b] = pair.map(|k| &scene.bodies[scene.spheres[k as usize] as usize]);
    Some((pair, scene.visibility.interaction_rule(a.class, b.class)?)).filter(|_| !(a.is_imposed() && b.is_imposed()))
}

fn sphere_plate_pairs(scene: &Scene, q_c: &ContactConfiguration, ways: &TravelBounds) -> Vec<ListedPair> {
    let with = |&plane: &u32| {
        let p = plane as usize;
        let BodyShape::Plane { half_lengths } = scene.bodies[p].shape else { unreachable!("planes lists planes") };
        // A wall's displacement is that of its farthest corner.
        let swept = ways.surface_travel(p, half_lengths.norm());
        let (path, turn) = (ways.centre_path(p), ways.rotation_vector(p));
        let into_axes = q_c.q[p].inverse().to_rotation_matrix();
        let near = move |&sphere: &u32| {
            let (s, pair) = (sphere as usize, [sphere, plane]);
            let travel = ways.travel[s] + swept;
            // Most spheres are far from the plate and need neither law nor geometry.
            let from = q_c.x[s] - q_c.x[p] - scene.nearest_image_shift(&q_c.x[s], &q_c.x[p]);
            let gap = ((into_axes * from).abs() - half_lengths).max() - scene.bodies[s].radius;
            let [sphere, plane] = [s, p].map(|i| &scene.bodies[i]);
            let near = gap <= scene.listing_range + travel && !(sphere.driven && plane.driven);
            let see = scene.visibility.interaction_rule(sphere.class, plane.class).filter(|_| near)?;
            let found = contact_geometry(scene, q_c, pair);
            let approach = ApproachBounds { travel, nearby: ways.nearby * sphere.radius };
            // A plate is convex: a passing sphere stays beyond the plane through the nearest point. If the plate turns,
            // its surface bends.
            let closing = || {
                let against = ways.centre_path(s) - path - turn.cross(&from);
                let bend = 0.5 * turn.norm_squared() * from.norm();
                found.gap - ((-found.normal.dot(&against)).max(0.0) + bend).min(travel)
            };
            is_listed(scene, pair, see, found.gap, approach, closing).then_some((pair, see.law))
        };
        scene.spheres.par_iter().with_min_len(512).filter_map(near)
    };
    scene.planes.par_iter().flat_map(with).collect()
}

/// Geometry of a sphere against a sphere or plate.
#[inline]
fn contact_geometry(
    scene: &Scene,
    q_c: &ContactConfiguration,
    [candidate, antagonist]: [u32; 2],
) -> narrow::ContactGeometry {
    let [a, b] = [candidate, antagonist].map(|i| (&scene.bodies[i as usize], q_c.x[i as usize]));
    let (a, b) = ((a.0, &a.1), (b.0, &(b.1 + scene.nearest_image_shift(&a.1, &b.1))));
    match &b.0.shape {
        BodyShape::Plane { half_lengths } => {
            narrow::sphere_plane(a.1, a.0.radius, b.1, &q_c.q[antagonist as usize], half_lengths)
        }
        _ => narrow::sphere_sphere(a.1, a.0.radius, b.1, b.0.radius),
    }
}

/// Bounds on the approach of two bodies in the step.
#[derive(Clone, Copy)]
struct ApproachBounds {
    /// Largest approach by their speeds relative to the mean motion, m.
    travel: f64,
    /// Gap up to which the pair is listed whatever its motion, m.
    nearby: f64,
}

/// Whether a pair with this rule is near enough to be listed; `closing`: smallest gap along the trajectories in the step,
/// m.
fn is_listed(
    scene: &Scene,
    [candidate, antagonist]: [u32; 2],
    see: InteractionRule,
    gap: f64,
    ApproachBounds { travel, nearby }: ApproachBounds,
    closing: impl Fn() -> f64,
) -> bool {
    // The range of a bond depends on the radii, which other pairs do not read.
    let law = &scene.laws[see.law as usize];
    let range = || law.interaction_range(scene.effective_radius((candidate, 0), (antagonist, 0)));
    gap <= see.alert.max(travel.min(nearby))
        || (gap <= LISTING_MARGIN * see.alert + travel && closing() <= LISTING_MARGIN * see.alert)
        || (law.cohesion().is_some() && gap <= range())
}

/// Part of the alert distance within which passing bodies are still listed, so that small changes of velocity by contacts
/// close no pair that is not listed.
const LISTING_MARGIN: f64 = 0.5;

#[inline]
fn sphere_contact(scene: &Scene, q_c: &ContactConfiguration, pair: [u32; 2], law: u8) -> Contact {
    let found = contact_geometry(scene, q_c, pair);
    let [candidate, antagonist] = pair;
    Contact {
        candidate,
        antagonist,
        ranks: (0, 0),
        features: (0, found.feature),
        point: found.point,
        image: scene.nearest_image_shift(&q_c.x[candidate as usize], &q_c.x[antagonist as usize]),
        normal: found.normal,
        gap: found.gap,
        area: 0.0,
        law,
    }
}
