//! Late pairs: pairs that the free velocities do not close, but the velocities after contact do.

use std::collections::HashSet;

use rayon::prelude::*;

use super::spheres::{ListedPair, contact_geometry, sphere_contact, visible_spheres};
use super::swept::{SweptBall, least_distance};
use super::travel::{LISTING_MARGIN, TravelBounds};
use super::{joints, parts, periodic};
use crate::geometry::NarrowPhaseMode;
use crate::integrate::ContactConfiguration;
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::ranks::lists::any_rank;
use crate::scene::{BodyId, BodyShape, ContactSides, Scene};
use crate::state::{Contact, DetectionCache, Velocities};

/// Contacts of pairs that are not in `contacts` and that the velocities `solved` close in the step; both lists are ordered by
/// key.
///
/// `free`, `solved`: velocities in the contact configuration without and with contacts. A pair is not late if contacts have
/// changed the displacements of its bodies by less than the margin of the list. Most steps end with that test. Of contacts
/// that are divided among ranks, `contacts` and the result have those of this rank.
pub fn late_contacts(
    scene: &Scene,
    q_c: &ContactConfiguration,
    free: Velocities,
    solved: Velocities,
    contacts: &[Contact],
    cache: &DetectionCache,
) -> Vec<Contact> {
    let is_empty = if cache.is_divided() { !any_rank(!contacts.is_empty()) } else { contacts.is_empty() };
    let alerts = scene.visibility.table.iter().flatten().map(|rule| rule.alert);
    let Some(smallest_alert) = alerts.reduce(f64::min).filter(|_| !is_empty) else { return Vec::new() };
    // Each of the two bodies gets half of the margin.
    let margin = 0.5 * LISTING_MARGIN * smallest_alert;
    let extents = rotating_extents(scene);
    let rotation_change = |i: usize| {
        let extent = extents.get(i).copied().unwrap_or(0.0);
        if extent > 0.0 { extent * (solved.w[i] - free.w[i]).norm() } else { 0.0 }
    };
    let span = q_c.reach_time(scene);
    let exceeds_margin = |i: usize| span * ((solved.v[i] - free.v[i]).norm() + rotation_change(i)) > margin;
    let searched: Vec<bool> =
        (0..scene.bodies.len()).into_par_iter().with_min_len(PAR_MIN_LEN).map(exceeds_margin).collect();
    if !searched.contains(&true) {
        return Vec::new();
    }
    let is_listed = |contact: &Contact| contacts.binary_search_by_key(&contactor_pair(contact), contactor_pair).is_ok();
    let mut bounds = TravelBounds::new(scene, q_c, solved, span);
    bounds.nearby = 0.0;
    if scene.has_parts() {
        let mut found =
            parts::swept_contacts(scene, q_c, &bounds, NarrowPhaseMode::Accurate, |body| searched[body.index()]);
        // All points of a pair are added if one of them closes.
        let closing: HashSet<_> =
            found.iter().filter(|contact| gap_closes(contact, q_c, solved, span)).map(contactor_pair).collect();
        found.retain(|contact| closing.contains(&contactor_pair(contact)) && !is_listed(contact));
        if found.is_empty() {
            return found;
        }
        // Inner contacts of flush joints can only be recognised together with the contacts that support the body.
        let is_surface = |contact: &&Contact| {
            scene.find_link([contact.candidate, contact.antagonist], contact.part_numbers).is_none()
        };
        let mut all: Vec<Contact> = contacts.iter().filter(is_surface).chain(&found).copied().collect();
        all.sort_unstable_by_key(Contact::key);
        let mut kept = parts::without_inner_edges(scene, q_c, &bounds, all);
        kept.retain(|contact| !is_listed(contact));
        return kept;
    }
    // Distances shrink with a deforming cell.
    let shrinkage = bounds.reach_factor() - 1.0;
    let ball = |&i: &BodyId| {
        let (i, radius, path) = (i.index(), scene.bodies[i.index()].radius, bounds.centre_path(i.index()));
        let radius = radius + (radius + path.norm()) * shrinkage;
        SweptBall { centre: q_c.x[i], path, radius, searched: searched[i] }
    };
    let balls: Vec<SweptBall> = scene.spheres.iter().map(ball).collect();
    let reach: Vec<f64> = balls.iter().map(|ball| ball.radius + ball.path.norm()).collect();
    let near_pairs = periodic::periodic_swept_pairs(&balls, &reach, &q_c.cell);
    let own_spheres = cache.own_spheres(scene);
    let own_pairs = near_pairs.into_iter().filter(|[first, _]| own_spheres.contains(first));
    let spheres = own_pairs.filter_map(|pair| visible_spheres(scene, pair)).filter_map(|([i, j], rule)| {
        let [a, b] = [i, j].map(|k| &balls[k.index()]);
        let between = a.centre - b.centre - q_c.cell.nearest_shift(&(a.centre - b.centre));
        let pair = [i, j].map(|k| scene.spheres[k.index()]);
        let [radius, other_radius] = pair.map(|body| scene.bodies[body.index()].radius);
        let path = a.path - b.path + bounds.affine_path(&between);
        let closes = least_distance(&between, &path) < radius + other_radius;
        closes.then_some((pair, rule.law))
    });
    let mut pairs: Vec<ListedPair> = spheres.collect();
    for &plane in &scene.planes {
        let rule_with_plate = |&sphere: &BodyId| {
            let [s, p] = [sphere, plane].map(|i| &scene.bodies[i.index()]);
            // In a scene without parts, spheres and plates that are driven have their whole motion imposed.
            let rule = scene.visibility.interaction_rule(s.class, p.class).filter(|_| !(s.driven && p.driven))?;
            Some(([sphere, plane], rule.law))
        };
        let spheres = &scene.spheres[own_spheres.start as usize..own_spheres.end as usize];
        let searched_spheres = spheres.iter().filter(|&&sphere| searched[sphere.index()] || searched[plane.index()]);
        pairs.extend(searched_spheres.filter_map(rule_with_plate).filter(|(pair, law)| {
            let BodyShape::Plane { half_lengths } = scene.bodies[plane.index()].shape else { return false };
            let is_near = contact_geometry(scene, q_c, *pair).gap
                <= bounds.travel[pair[0].index()] + bounds.surface_travel(pair[1].index(), half_lengths.norm());
            is_near && gap_closes(&sphere_contact(scene, q_c, *pair, *law), q_c, solved, span)
        }));
    }
    // Inner contacts of flush joints can only be recognised together with the contacts that support the sphere.
    let is_plane = |body: BodyId| matches!(scene.bodies[body.index()].shape, BodyShape::Plane { .. });
    let (mut plate_pairs, others): (Vec<_>, Vec<_>) = pairs.into_iter().partition(|(pair, _)| is_plane(pair[1]));
    if !plate_pairs.is_empty() {
        let listed_on_plates = contacts.iter().filter(|contact| is_plane(contact.antagonist));
        plate_pairs.extend(listed_on_plates.map(|contact| ([contact.candidate, contact.antagonist], contact.law)));
    }
    let mut pairs = joints::without_inner_rims(scene, q_c, &bounds, plate_pairs);
    pairs.extend(others);
    pairs.sort_unstable();
    let found = pairs.into_iter().map(|(pair, law)| sphere_contact(scene, q_c, pair, law));
    found.filter(|contact| !is_listed(contact)).collect()
}

/// Bodies and numbers of parts that identify the pair of contactors.
fn contactor_pair(contact: &Contact) -> (BodyId, BodyId, ContactSides<u16>) {
    (contact.candidate, contact.antagonist, contact.part_numbers)
}

/// Whether a contact's gap closes at these velocities within `span` (s).
fn gap_closes(contact: &Contact, q_c: &ContactConfiguration, velocities: Velocities, span: f64) -> bool {
    let Velocities { v, w, gradient, surfaces } = velocities;
    let [a, b] = [contact.candidate.index(), contact.antagonist.index()];
    let velocity_of_point = |i: usize, centre: Vec3| v[i] + w[i].cross(&(contact.point - centre));
    let image_velocity = gradient.map_or(Vec3::zeros(), |gradient| gradient * contact.image);
    let u = velocity_of_point(a, q_c.x[a]) - velocity_of_point(b, q_c.x[b] + contact.image) - image_velocity;
    // Other surfaces move along themselves.
    let drum = surfaces.iter().find(|surface| surface.body == contact.antagonist);
    let growth = drum.map_or(0.0, |surface| surface.normal_velocity(&contact.normal));
    contact.gap + span * (contact.normal.dot(&u) - growth) < 0.0
}

/// Largest distance from the centre of each body of the points that a rotation moves, m; empty in a scene of spheres and
/// plates.
fn rotating_extents(scene: &Scene) -> Vec<f64> {
    if !scene.has_parts() {
        return Vec::new();
    }
    let mut extents = vec![0.0f64; scene.bodies.len()];
    for part in &scene.parts {
        let extent = &mut extents[part.body.index()];
        *extent = extent.max(part.offset.norm() + part.bounding_radius);
    }
    extents
}
