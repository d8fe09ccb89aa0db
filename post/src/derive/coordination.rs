//! Coordination of grains: pairs that touch with force, neighbours and constraints per grain, rattlers.

use std::collections::{BTreeMap, HashMap, HashSet};

use cd_formats::groups::DisjointSets;
use cd_formats::snapshot::STATUS_NO_CONTACT;

use crate::derive::fragments::TOUCHING_GAP;
use crate::frame::{Contact, ContactBody, Frame, GrainId, TouchedPair};
use crate::math::Vec3;

/// Means over some grains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coordination {
    /// Mean number of neighbours per grain that it touches with force.
    pub z: f64,
    /// Mean number of neighbours per grain without rattlers and their contacts.
    pub z_no_rattlers: f64,
    /// Mean number of constraints per grain, see [`TouchingPair::constraint_count`].
    pub z_constraints: f64,
    /// Ratio of rattlers to grains.
    pub rattler_fraction: f64,
    pub shares: ContactShares,
}

/// Shares of the touching pairs that touch in a face, in an edge and in a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactShares {
    pub face: f64,
    pub edge: f64,
    pub point: f64,
}

/// Whether the bodies of a contact touch with force: it carries force, and the solver has found it closed, sticking or sliding.
///
/// A contact is closed if its reaction exceeds the attraction of its law, r_n > c n, by which it pushes, whatever the net
/// force. A contact that carries force with the status "no contact" only pulls at a distance, by the constant attraction of
/// a cohesion with a range. No tolerance is needed: by Signorini's condition either the gap velocity or the reaction is
/// zero.
pub fn touches_with_force(contact: &Contact) -> bool {
    contact.active && contact.status != STATUS_NO_CONTACT
}

/// The contacts whose bodies touch with force.
pub fn touching_contacts(frame: &Frame) -> impl Iterator<Item = &Contact> {
    frame.contacts.iter().filter(|contact| touches_with_force(contact))
}

/// The gap up to which the bodies of a contact touch, m.
fn touching_distance(frame: &Frame, contact: &Contact) -> f64 {
    TOUCHING_GAP
        * contact
            .bodies()
            .filter_map(ContactBody::grain_id)
            .map(|i| frame.grains[i].radius)
            .fold(f64::INFINITY, f64::min)
}

/// Two bodies that touch with force, in one or more points; at least one is a grain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TouchingPair {
    pub bodies: [ContactBody; 2],
    /// Points of contact that touch with force or whose gap is at most [`TOUCHING_GAP`] of the smaller radius.
    pub points: u32,
}

impl TouchingPair {
    /// Number of constrained directions: 1 for a contact in a point, 2 in an edge, 3 in a face.
    ///
    /// Source: Azema, Radjai & Dubois (2013), "Packings of irregular polyhedral particles".
    pub fn constraint_count(&self) -> u32 {
        self.points.min(3)
    }

    fn grains(&self) -> impl Iterator<Item = GrainId> {
        self.bodies.into_iter().filter_map(ContactBody::grain_id)
    }
}

/// Largest angle, rad, and largest step, in radii of the grain, between walls that are one surface to the grain. Contacts on
/// flush plates of a file with eight digits differ by less, the plates of a drum of a thousand sides by more.
const FLUSH_ANGLE: f64 = 1e-3;
const FLUSH_STEP: f64 = 0.01;

/// Maps each pair of a grain and a wall that lies flush with another wall under this grain to the first such pair, so
/// that flush walls count as one surface.
fn flush_pairs(frame: &Frame) -> HashMap<[ContactBody; 2], [ContactBody; 2]> {
    // Contacts of each grain with walls, with the normal towards the grain.
    let mut with_walls: BTreeMap<GrainId, Vec<(&Contact, Vec3)>> = BTreeMap::new();
    for contact in &frame.contacts {
        let sign = match (contact.candidate, contact.antagonist) {
            (ContactBody::Grain(_), ContactBody::Wall(_)) => 1.0,
            (ContactBody::Wall(_), ContactBody::Grain(_)) => -1.0,
            _ => continue,
        };
        if touches_with_force(contact) || contact.gap <= touching_distance(frame, contact) {
            let grain = contact.bodies().find_map(ContactBody::grain_id);
            grain.into_iter().for_each(|grain| {
                with_walls.entry(grain).or_default().push((contact, sign * contact.normal));
            });
        }
    }
    let mut representative = HashMap::new();
    for (grain, contacts) in with_walls {
        let mut pairs: Vec<[ContactBody; 2]> = contacts.iter().map(|(contact, _)| sorted_bodies(contact)).collect();
        pairs.sort_unstable();
        pairs.dedup();
        if pairs.len() < 2 {
            continue;
        }
        let number = |contact: &Contact| pairs.binary_search(&sorted_bodies(contact)).unwrap_or_default();
        let mut groups = DisjointSets::new(pairs.len());
        for (k, (a, normal)) in contacts.iter().enumerate() {
            for (b, other) in &contacts[..k] {
                let step = (a.point - b.point).dot(normal).abs();
                if (normal - other).norm() <= FLUSH_ANGLE && step <= FLUSH_STEP * frame.grains[grain].radius {
                    groups.union(number(a), number(b));
                }
            }
        }
        let mut first: HashMap<usize, [ContactBody; 2]> = HashMap::new();
        for (k, pair) in pairs.iter().enumerate() {
            let first_pair = *first.entry(groups.find(k)).or_insert(*pair);
            if first_pair != *pair {
                representative.extend([(*pair, first_pair), (first_pair, first_pair)]);
            }
        }
    }
    representative
}

/// Number of independent ones of some points of contact on a flat surface: 1 in one position, 2 along a line, else 3.
/// Points closer than `distance` (m) are one.
fn independent_points(points: &[Vec3], distance: f64) -> u32 {
    let from_first = || points.iter().map(|p| p - points[0]);
    let Some(farthest) = from_first().max_by(|a, b| a.norm().total_cmp(&b.norm())) else { return 0 };
    let length = farthest.norm();
    if length <= distance {
        return 1;
    }
    2 + u32::from(from_first().any(|offset| offset.cross(&farthest).norm() > distance * length))
}

/// The pairs of bodies that touch with force, each once, in the order of their first contact. Walls that lie flush under a
/// grain are one pair with it, the pair of the first of them.
pub fn touching_pairs(frame: &Frame) -> Vec<TouchingPair> {
    let flush = flush_pairs(frame);
    let surface_pair = |contact: &Contact| {
        let pair = sorted_bodies(contact);
        flush.get(&pair).copied().unwrap_or(pair)
    };
    let mut indices: HashMap<[ContactBody; 2], usize> = HashMap::new();
    let mut touches: Vec<TouchingPair> = Vec::new();
    for contact in touching_contacts(frame) {
        let pair = surface_pair(contact);
        indices.entry(pair).or_insert_with(|| {
            touches.push(TouchingPair { bodies: pair, points: 0 });
            touches.len() - 1
        });
    }
    // Points and touching distance of the pairs with several walls: at a joint, each wall has points of its own.
    let mut on_flush: BTreeMap<usize, (Vec<Vec3>, f64)> = BTreeMap::new();
    for contact in &frame.contacts {
        let pair = surface_pair(contact);
        if let Some(&index) = indices.get(&pair)
            && (touches_with_force(contact) || contact.gap <= touching_distance(frame, contact))
        {
            touches[index].points += 1;
            if flush.contains_key(&pair) {
                let (points, distance) = on_flush.entry(index).or_default();
                points.push(contact.point);
                *distance = touching_distance(frame, contact);
            }
        }
    }
    for (index, (points, distance)) in on_flush {
        touches[index].points = independent_points(&points, distance);
    }
    touches
}

/// The bodies of a contact in rising order.
fn sorted_bodies(contact: &Contact) -> [ContactBody; 2] {
    let [a, b] = [contact.candidate, contact.antagonist];
    [a.min(b), a.max(b)]
}

/// Number of pairs of bodies whose contacts carry force, but only pull at a distance ([`touches_with_force`]).
pub fn count_distant_pairs(frame: &Frame) -> usize {
    let touching: HashSet<[ContactBody; 2]> = touching_contacts(frame).map(sorted_bodies).collect();
    frame.active_contacts().map(sorted_bodies).filter(|pair| !touching.contains(pair)).collect::<HashSet<_>>().len()
}

/// Number of neighbours that each grain touches with force; walls count too.
pub fn neighbour_counts(frame: &Frame) -> Vec<u32> {
    let mut counts = vec![0; frame.grains.len()];
    touching_pairs(frame).iter().flat_map(TouchingPair::grains).for_each(|grain| counts[grain.index()] += 1);
    counts
}

/// Number of points of contact that touch with force of each grain; those with walls count too.
pub fn contact_counts(frame: &Frame) -> Vec<u32> {
    let mut counts = vec![0; frame.grains.len()];
    for contact in touching_contacts(frame) {
        for (grain, ..) in contact.on_grains() {
            counts[grain.index()] += 1;
        }
    }
    counts
}

/// Mean number of neighbours that the grains `members` (rising) have touched with force in a step since the previous
/// snapshot.
///
/// Neighbours are counted as in [`mean_coordination`]. Between moving grains, contacts carry force in some steps and none
/// in others, so the number of neighbours in a single step falls with the step length; the number in an interval does not.
/// A pair that pulled in the sum of these steps counts only if it touches in the snapshot. Flush walls count once if the
/// snapshot has the contacts with them. NaN without an interval.
pub fn interval_coordination(frame: &Frame, members: &[GrainId]) -> f64 {
    let touching: HashSet<[ContactBody; 2]> = touching_contacts(frame).map(sorted_bodies).collect();
    let sorted_pair = |pair: &TouchedPair| {
        let [a, b] = pair.bodies;
        [a.min(b), a.max(b)]
    };
    let touched_pairs = frame.interval.touched_pairs.iter();
    let touched = touched_pairs.filter(|pair| pair.virial > 0.0 || touching.contains(&sorted_pair(pair)));
    let flush = flush_pairs(frame);
    let surface = |pair: [ContactBody; 2]| flush.get(&pair).copied().unwrap_or(pair);
    let pairs: HashSet<[ContactBody; 2]> = touched.map(sorted_pair).map(surface).collect();
    let is_member = |body: &&ContactBody| body.grain_id().is_some_and(|grain| members.binary_search(&grain).is_ok());
    let ends = pairs.iter().flatten().filter(is_member).count() as f64;
    if frame.interval.length > 0.0 { ends / members.len() as f64 } else { f64::NAN }
}

/// Least number of constraints of a stable grain; a contact of spheres is one constraint.
///
/// | | free of load | under gravity |
/// |---|---|---|
/// | frictionless | 4 | 3 |
/// | friction | 2 | 2 |
///
/// Frictionless forces on a sphere all pass through its centre: without a load, four are needed to fix it against any push.
/// A load (gravity, uniform or of the grains) replaces one of them. With friction two are enough to balance a force, along
/// the line between them or parallel to it. A snapshot counts as frictional if one of its contacts carries a tangential
/// force that exceeds the rounding of a normal force under a change of frame.
pub fn min_stable_constraints(frame: &Frame) -> u32 {
    let parameters = &frame.meta.parameters;
    let loaded = parameters.self_gravity || parameters.uniform_gravity != [0.0; 3];
    let friction = frame.active_contacts().any(|contact| contact.tangential_force > 1e-12 * contact.normal_force.abs());
    match (friction, loaded) {
        (true, _) => 2,
        (false, true) => 3,
        (false, false) => 4,
    }
}

/// Returns for each grain whether it is a rattler: a grain with fewer than `stable` constraints of `touches`, or with fewer
/// once other rattlers are removed, repeated until none is found.
pub fn find_rattlers(frame: &Frame, touches: &[TouchingPair], stable: u32) -> Vec<bool> {
    let mut counts = vec![0; frame.grains.len()];
    let mut neighbours = vec![Vec::new(); frame.grains.len()];
    for touch in touches {
        touch.grains().for_each(|i| counts[i.index()] += touch.constraint_count());
        if let [ContactBody::Grain(i), ContactBody::Grain(j)] = touch.bodies {
            neighbours[i.index()].push((j.index(), touch.constraint_count()));
            neighbours[j.index()].push((i.index(), touch.constraint_count()));
        }
    }
    let mut is_rattler: Vec<bool> = counts.iter().map(|&count| count < stable).collect();
    let mut removed: Vec<usize> = (0..is_rattler.len()).filter(|&i| is_rattler[i]).collect();
    while let Some(i) = removed.pop() {
        for &(j, constraints) in &neighbours[i] {
            counts[j] -= constraints;
            if counts[j] < stable && !is_rattler[j] {
                is_rattler[j] = true;
                removed.push(j);
            }
        }
    }
    is_rattler
}

/// Mean contact numbers of the grains `members` (rising), with and without rattlers.
///
/// Z is the mean number of neighbours of these grains. If no neighbour is outside `members`, it is (2 N_gg + N_gw) / N with
/// N grains, N_gg touching pairs of grains and N_gw touching pairs of a grain and a wall. Without rattlers, Z is taken over
/// the remaining grains and the pairs whose grains all remain; NaN if none remains. With constraints, each pair counts as
/// often as it has constraints.
///
/// Three equal spheres that push each other: Z = 2.
pub fn mean_coordination(frame: &Frame, members: &[GrainId]) -> Coordination {
    let is_member = |grain: &GrainId| members.binary_search(grain).is_ok();
    let grain_count = members.len() as f64;
    let touches = touching_pairs(frame);
    let is_rattler = find_rattlers(frame, &touches, min_stable_constraints(frame));
    let non_rattlers = members.iter().filter(|&&grain| !is_rattler[grain.index()]).count() as f64;
    let (mut contact_ends, mut contact_ends_without_rattlers, mut constraints) = (0.0, 0.0, 0.0);
    let (mut counts_by_points, mut pairs) = ([0.0; 3], 0.0);
    for touch in &touches {
        let grains = touch.grains().filter(is_member).count() as f64;
        if grains == 0.0 {
            continue;
        }
        pairs += 1.0;
        contact_ends += grains;
        constraints += grains * f64::from(touch.constraint_count());
        counts_by_points[3 - touch.constraint_count() as usize] += 1.0;
        if touch.grains().all(|grain| !is_rattler[grain.index()]) {
            contact_ends_without_rattlers += grains;
        }
    }
    let [face, edge, point] = counts_by_points.map(|count| count / pairs);
    Coordination {
        z: contact_ends / grain_count,
        z_no_rattlers: contact_ends_without_rattlers / non_rattlers,
        z_constraints: constraints / grain_count,
        rattler_fraction: (grain_count - non_rattlers) / grain_count,
        shares: ContactShares { face, edge, point },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::samples::Scene;

    /// Mean over all grains.
    fn coordination(frame: &Frame) -> Coordination {
        super::mean_coordination(frame, &frame.grain_ids().collect::<Vec<_>>())
    }

    fn interval_coordination(frame: &Frame) -> f64 {
        super::interval_coordination(frame, &frame.grain_ids().collect::<Vec<_>>())
    }

    /// A tetrahedron of touching spheres, every pair pushing, and a fifth sphere that hangs on one of them.
    fn tetrahedron_with_tail() -> Scene {
        let mut scene = Scene::default();
        for x in [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0], [3.0, 3.0, 1.0]] {
            scene.grain(x, 2f64.sqrt());
        }
        for i in 0..4 {
            for j in 0..i {
                scene.push(i, j, 1.0);
            }
        }
        scene.push(4, 0, 1.0);
        scene
    }

    #[test]
    fn counts_both_ends_of_contacts_that_carry_force() {
        let mut scene = tetrahedron_with_tail();
        scene.push(4, 1, 0.0);
        let frame = scene.frame();
        assert_eq!(contact_counts(&frame), [4, 3, 3, 3, 1]);
        assert_eq!(coordination(&frame).z, 14.0 / 5.0);
    }

    #[test]
    fn rattlers_are_peeled_off_until_none_is_left() {
        let mut scene = tetrahedron_with_tail();
        // Unloaded and frictionless: four contacts are stable. Only sphere 0 has four, and it loses the one with sphere 4.
        let all = coordination(&scene.frame());
        assert_eq!(all.rattler_fraction, 1.0);
        assert!(all.z_no_rattlers.is_nan());
        // Under gravity three contacts are stable: only the tail rattles.
        scene.snapshot.meta.parameters.self_gravity = true;
        let loaded = coordination(&scene.frame());
        assert_eq!((loaded.z_no_rattlers, loaded.rattler_fraction), (3.0, 0.2));
        // With friction two contacts are stable.
        scene.contact(3, 2, Vec3::new(0.3, 0.1, 0.0));
        assert_eq!(min_stable_constraints(&scene.frame()), 2);
    }

    #[test]
    fn what_only_pulls_at_a_distance_is_no_neighbour() {
        // A chain: 1 touches 0 and pulls in net, as cohesion does; 2 is within the range of 1 and feels its attraction alone.
        let mut scene = Scene::default();
        let law = &mut scene.snapshot.meta.laws[0];
        (law.kind, law.parameters) = ("IQS_WET_DS_CLB".into(), vec![4.0, 0.0, 0.2, 0.4, 0.5]);
        for x in [0.0, 2.0, 4.1] {
            scene.grain([x, 0.0, 0.0], 1.0);
        }
        scene.contact(1, 0, Vec3::new(-3.0, 0.0, 0.25));
        scene.push(2, 1, -4.0);
        scene.snapshot.contacts.contact_status[1] = STATUS_NO_CONTACT;
        let frame = scene.frame();
        assert_eq!(neighbour_counts(&frame), [1, 1, 0]);
        assert_eq!((coordination(&frame).z, count_distant_pairs(&frame)), (2.0 / 3.0, 1));
        // The mobilised share is that of the first: 1/4 divided by 1/2 (4 - 3).
        let mobilisation = crate::derive::fabric::mean_mobilisation(&frame);
        assert_eq!((mobilisation.mobilised_share, mobilisation.sliding_share), (0.5, 1.0));
        let row = crate::derive::Row::from_frame(&frame);
        assert_eq!((row.n_contacts, row.n_pulling, row.Z_all), (1, 1, 2.0 / 3.0));
        // In the values of an interval, a pair that pulled in the sum counts only if it touches in the snapshot.
        scene.snapshot.meta.time = 2.0;
        scene.since(0.0, &[([1, 0], -6.0), ([2, 1], -8.0), ([2, 0], 1.0)]);
        assert_eq!(interval_coordination(&scene.frame()), 4.0 / 3.0);
    }

    #[test]
    fn a_contact_with_a_wall_counts_once() {
        let mut scene = Scene::default();
        let grain = scene.grain([0.0, 0.0, 1.0], 1.0);
        let floor = scene.plate([0.0, 0.0, -0.1], [5.0, 5.0, 0.1]);
        scene.contact_at(grain, floor, [0.0; 3], Vec3::new(0.0, 0.0, 7.0));
        assert_eq!(coordination(&scene.frame()).z, 1.0);
    }

    #[test]
    fn walls_that_lie_flush_are_one_neighbour() {
        // A ball on the joint of four tiles, on two of which it pushes; a cube on all four; the edge of a third over two.
        let mut scene = Scene::default();
        let (ball, cube, edge) =
            (scene.grain([0.0, 0.0, 1.0], 1.0), scene.cube([0.0; 3], 1.0), scene.cube([0.0; 3], 1.0));
        let tiles = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)]
            .map(|(x, y)| (scene.plate([2.0 * x, 2.0 * y, -0.1], [2.0, 2.0, 0.1]), x, y));
        let up = Vec3::z();
        for (tile, x, y) in tiles {
            for (u, v) in [(0.0, 0.0), (x, 0.0), (0.0, y), (x, y)] {
                scene.contact_at(cube, tile, [u, v, 0.0], up);
            }
            if y > 0.0 {
                scene.contact_at(ball, tile, [0.0, 0.0, 0.0], up);
                [0.0, x].iter().for_each(|&u| scene.contact_at(edge, tile, [u, 0.5, 0.0], up));
            }
        }
        // A side that is not flush, and a tile a tenth lower.
        let side = scene.plate([0.0, -2.0, 1.0], [2.0, 1.0, 1.0]);
        scene.contact_at(ball, side, [0.0, -1.0, 1.0], Vec3::y());
        let lower = scene.plate([0.0, 0.0, -0.2], [2.0, 2.0, 0.1]);
        scene.contact_at(ball, lower, [0.0, 0.0, -0.1], up);
        let frame = scene.frame();
        let mut found: Vec<(Vec<GrainId>, u32)> =
            touching_pairs(&frame).iter().map(|touch| (touch.grains().collect(), touch.constraint_count())).collect();
        found.sort();
        let [ball, cube, edge] = [0, 1, 2].map(|k| vec![GrainId::new(k)]);
        assert_eq!(found, [(ball.clone(), 1), (ball.clone(), 1), (ball, 1), (cube, 3), (edge, 2)]);
        assert_eq!(neighbour_counts(&frame), [3, 1, 1]);
    }

    #[test]
    fn an_interval_has_the_neighbours_of_all_its_steps() {
        // Three spheres on a plate that touch one after the other; nothing carries force at the end.
        let mut scene = Scene::default();
        let plate = scene.plate([0.0; 3], [9.0, 9.0, 0.1]) as u32;
        let [a, b, c] = [0.0, 2.0, 4.0].map(|x| scene.grain([x, 0.0, 1.1], 1.0) as u32);
        assert!(interval_coordination(&scene.frame()).is_nan());
        scene.snapshot.meta.time = 5.0;
        scene.since(3.0, &[([a, plate], 1.0), ([a, b], 2.0), ([b, a], 2.0), ([b, c], 2.0)]);
        assert_eq!(interval_coordination(&scene.frame()), 5.0 / 3.0);
        assert_eq!(coordination(&scene.frame()).z, 0.0);
        scene.since(5.0, &[]);
        assert!(interval_coordination(&scene.frame()).is_nan());
    }

    #[test]
    fn polyhedra_are_neighbours_once_and_held_by_every_direction() {
        // A cube on the floor by four points, two of them without force, another on it by an edge, and a
        // sphere at its side; one more point of the edge is far off.
        let mut scene = Scene::default();
        let floor = scene.plate([0.0, 0.0, -1.1], [5.0, 5.0, 0.1]);
        let (low, high) = (scene.cube([0.0; 3], 1.0), scene.cube([0.0, 0.0, 2.4], 1.0));
        let side = scene.grain([1.5, 0.0, 0.0], 0.5);
        let up = Vec3::z();
        for (x, y, force) in [(1.0, 1.0, 2.0), (1.0, -1.0, 0.0), (-1.0, 1.0, 0.0), (-1.0, -1.0, 2.0)] {
            scene.contact_at(low, floor, [x, y, -1.0], up);
            let impulse = &mut scene.snapshot.contacts.contact_impulse;
            *impulse.last_mut().unwrap() = [force, 0.0, 0.0];
        }
        for (y, gap) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 0.4)] {
            scene.contact_at(high, low, [0.0, y, 1.0], up);
            *scene.snapshot.contacts.contact_gap.last_mut().unwrap() = gap;
            let force = if gap == 0.0 { 1.0 } else { 0.0 };
            *scene.snapshot.contacts.contact_impulse.last_mut().unwrap() = [force, 0.0, 0.0];
        }
        scene.contact_at(side, low, [1.0, 0.0, 0.0], Vec3::x());
        let frame = scene.frame();
        assert_eq!(touching_pairs(&frame).iter().map(|touch| touch.points).collect::<Vec<_>>(), [4, 2, 1]);
        assert_eq!(neighbour_counts(&frame), [3, 1, 1]);
        assert_eq!(contact_counts(&frame), [5, 2, 1]);
        let found = coordination(&frame);
        assert_eq!((found.z, found.z_constraints), (5.0 / 3.0, (3.0 + 4.0 + 2.0) / 3.0));
        assert_eq!(found.shares, ContactShares { face: 1.0 / 3.0, edge: 1.0 / 3.0, point: 1.0 / 3.0 });
        // Without friction or load four constraints are stable: first the sphere and the upper cube go, then the lower.
        assert_eq!(found.rattler_fraction, 1.0);
        scene.snapshot.meta.parameters.self_gravity = true;
        assert_eq!(coordination(&scene.frame()).rattler_fraction, 2.0 / 3.0); // three on the floor
    }

    #[test]
    fn nothing_gives_nothing() {
        let none = coordination(&Scene::default().frame());
        assert!(
            none.shares.face.is_nan()
                && none.shares.edge.is_nan()
                && none.shares.point.is_nan()
                && none.z_constraints.is_nan()
        );
        assert!(none.z.is_nan() && none.z_no_rattlers.is_nan() && none.rattler_fraction.is_nan());
    }
}
