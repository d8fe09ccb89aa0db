//! Pairs and contacts of spheres with spheres and plates.

use rayon::prelude::*;

use super::neighbours::BoundingBalls;
use super::travel::{LISTING_MARGIN, TravelBounds};
use super::{candidate_division, narrow, swept};
use crate::integrate::ContactConfiguration;
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::scene::{BodyId, BodyShape, ContactSides, InteractionRule, LawId, Scene, SphereId};
use crate::state::{Contact, DetectionCache, VisiblePair};

/// Candidate and antagonist within range of each other, and their law.
pub type ListedPair = ([BodyId; 2], LawId);

/// Listed pairs of spheres, ordered by candidate, then by antagonist.
pub fn sphere_sphere_pairs(
    scene: &Scene,
    q_c: &ContactConfiguration,
    bounds: &TravelBounds,
    cache: &mut DetectionCache,
) -> Vec<ListedPair> {
    let bodies = scene.spheres.par_iter().with_min_len(PAR_MIN_LEN);
    let centres: Vec<Vec3> = bodies.clone().map(|&i| q_c.x[i.index()]).collect();
    let travel: Vec<f64> = bodies.clone().map(|&i| bounds.travel[i.index()]).collect();
    let radii: Vec<f64> = bodies.map(|&i| scene.bodies[i.index()].radius).collect();
    let factor = bounds.reach_factor();
    let reach = |(radius, travel): (&f64, &f64)| (radius + travel + 0.5 * scene.listing_range) * factor;
    let reach: Vec<f64> = radii.iter().zip(&travel).map(reach).collect();
    let path = |k: usize| bounds.centre_path(scene.spheres[k].index());
    let balls = BoundingBalls { centres: &centres, reach: &reach, path, travel: &travel };
    let cell = &q_c.cell;
    if cache.neighbours.rebuild_if_stale(&balls, cell, scene.mean_radius, cache.own_spheres(scene)) {
        if candidate_division::rebalance_cuts(cache) {
            cache.neighbours.search_pairs(cell, cache.own_spheres(scene));
        }
        let near = std::mem::take(&mut cache.neighbours.pairs);
        let visible = near.into_par_iter().with_min_len(1024).filter_map(|pair| visible_spheres(scene, pair));
        let mut pairs: Vec<VisiblePair<SphereId>> = visible.collect();
        pairs.par_sort_unstable_by_key(|(pair, _)| *pair);
        cache.sphere_pairs = pairs;
    }
    let listed_pair = |&([i, j], rule): &VisiblePair<SphereId>| {
        let pair = [i, j].map(|k| scene.spheres[k.index()]);
        let [i, j] = [i.index(), j.index()];
        let (a, b) = (centres[i], centres[j] + cell.nearest_shift(&(centres[i] - centres[j])));
        let gap = narrow::sphere_sphere(&a, radii[i], &b, radii[j]).gap;
        let travel = travel[i] + travel[j] + bounds.affine_travel(&(a - b));
        let approach = ApproachBounds { travel, nearby: bounds.nearby * radii[i].min(radii[j]) };
        let closing_gap = || {
            swept::least_distance(&(a - b), &(path(i) - path(j) + bounds.affine_path(&(a - b)))) - (radii[i] + radii[j])
        };
        is_listed(scene, pair, rule, gap, approach, closing_gap).then_some((pair, rule.law))
    };
    cache.sphere_pairs.par_iter().with_min_len(512).filter_map(listed_pair).collect()
}

/// Pair with the candidate first, and its visibility rule; `None` if the table has no rule for it, or if the
/// motion of both bodies is imposed.
pub fn visible_spheres(scene: &Scene, pair: [u32; 2]) -> Option<VisiblePair<SphereId>> {
    let pair = pair.map(SphereId);
    let [a, b] = pair.map(|k| &scene.bodies[scene.spheres[k.index()].index()]);
    Some((pair, scene.visibility.interaction_rule(a.class, b.class)?)).filter(|_| !(a.is_imposed() && b.is_imposed()))
}

/// Listed pairs of one of `spheres` and a plate, plate by plate.
pub fn sphere_plate_pairs(
    scene: &Scene,
    q_c: &ContactConfiguration,
    bounds: &TravelBounds,
    spheres: &[BodyId],
) -> Vec<ListedPair> {
    let pairs_with_plate = |&plane: &BodyId| {
        let p = plane.index();
        let BodyShape::Plane { half_lengths } = scene.bodies[p].shape else { unreachable!("planes lists planes") };
        // A wall's displacement is that of its farthest corner.
        let plate_travel = bounds.surface_travel(p, half_lengths.norm());
        let (path, turn) = (bounds.centre_path(p), bounds.rotation_vector(p));
        let into_axes = q_c.q[p].inverse().to_rotation_matrix();
        let nearby_pair = move |&sphere: &BodyId| {
            let (s, pair) = (sphere.index(), [sphere, plane]);
            let travel = bounds.travel[s] + plate_travel;
            // Most spheres are far from the plate and need neither law nor geometry.
            let from_plate = q_c.x[s] - q_c.x[p] - q_c.cell.nearest_shift(&(q_c.x[s] - q_c.x[p]));
            let gap = ((into_axes * from_plate).abs() - half_lengths).max() - scene.bodies[s].radius;
            let [sphere, plane] = [s, p].map(|i| &scene.bodies[i]);
            // In a scene without parts, spheres and plates that are driven have their whole motion imposed.
            let is_near = gap <= scene.listing_range + travel && !(sphere.driven && plane.driven);
            let rule = scene.visibility.interaction_rule(sphere.class, plane.class).filter(|_| is_near)?;
            let found = contact_geometry(scene, q_c, pair);
            let approach = ApproachBounds { travel, nearby: bounds.nearby * sphere.radius };
            // A plate is convex: a passing sphere stays beyond the plane through the nearest point. If the plate turns,
            // its surface bends.
            let closing_gap = || {
                let relative_path = bounds.centre_path(s) - path - turn.cross(&from_plate);
                let bend = 0.5 * turn.norm_squared() * from_plate.norm();
                found.gap - ((-found.normal.dot(&relative_path)).max(0.0) + bend).min(travel)
            };
            is_listed(scene, pair, rule, found.gap, approach, closing_gap).then_some((pair, rule.law))
        };
        spheres.par_iter().with_min_len(512).filter_map(nearby_pair)
    };
    scene.planes.par_iter().flat_map(pairs_with_plate).collect()
}

/// Geometry of a sphere against a sphere or plate.
#[inline]
pub fn contact_geometry(
    scene: &Scene,
    q_c: &ContactConfiguration,
    [candidate, antagonist]: [BodyId; 2],
) -> narrow::ContactGeometry {
    let [a, b] = [candidate, antagonist].map(|i| (&scene.bodies[i.index()], q_c.x[i.index()]));
    let (a, b) = ((a.0, &a.1), (b.0, &(b.1 + q_c.cell.nearest_shift(&(a.1 - b.1)))));
    match &b.0.shape {
        BodyShape::Plane { half_lengths } => {
            narrow::sphere_plane(a.1, a.0.radius, b.1, &q_c.q[antagonist.index()], half_lengths)
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

/// Whether a pair with this rule is near enough to be listed; `closing_gap`: smallest gap along the trajectories in the step,
/// m.
fn is_listed(
    scene: &Scene,
    [candidate, antagonist]: [BodyId; 2],
    rule: InteractionRule,
    gap: f64,
    ApproachBounds { travel, nearby }: ApproachBounds,
    closing_gap: impl Fn() -> f64,
) -> bool {
    // The range of a bond depends on the radii, which other pairs do not read.
    let law = &scene.laws[rule.law];
    let range = || law.interaction_range(scene.effective_radius((candidate, 0), (antagonist, 0)));
    gap <= rule.alert.max(travel.min(nearby))
        || (gap <= LISTING_MARGIN * rule.alert + travel && closing_gap() <= LISTING_MARGIN * rule.alert)
        || (law.cohesion().is_some() && gap <= range())
}

/// Contact of a sphere with a sphere or plate under `law`.
#[inline]
pub fn sphere_contact(scene: &Scene, q_c: &ContactConfiguration, pair: [BodyId; 2], law: LawId) -> Contact {
    let found = contact_geometry(scene, q_c, pair);
    let [candidate, antagonist] = pair;
    Contact {
        candidate,
        antagonist,
        part_numbers: ContactSides::default(),
        features: ContactSides { candidate: 0, antagonist: found.feature },
        point: found.point,
        image: q_c.cell.nearest_shift(&(q_c.x[candidate.index()] - q_c.x[antagonist.index()])),
        normal: found.normal,
        gap: found.gap,
        area: 0.0,
        law,
    }
}
