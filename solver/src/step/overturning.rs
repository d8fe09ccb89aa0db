//! Bodies that an impact turns through a surface within one step.
//!
//! Contacts bound the velocities of the points that are listed, at the orientation of the contact configuration. A body that
//! an impact turns by a large angle within the step brings other points to the surface, or beyond it. In such a step the
//! body keeps its orientation, and turns in the steps after. If its centre moves into a surface, contacts act at its centre, as
//! if it had no rotation, and its angular velocity stays: it is brought to touch, or thrown back, as a body that only moves.
//! Otherwise its own rotation brings it to the surface, and impulses change its velocities as in any step. Either way an
//! impulse works on the velocities that it changes, and mechanical energy does not grow.

use std::collections::BTreeSet;

use rayon::prelude::*;

use crate::assemble::{contact_arms, relative_velocity};
use crate::integrate::ContactConfiguration;
use crate::math::{PAR_MIN_LEN, Vec3, rotate_by_vector};
use crate::scene::{BodyId, BodyPart, Scene};
use crate::state::{Contact, Velocities};

/// Displacement in the time `span` (s) by which these velocities close a contact, m.
pub fn approach(q_c: &ContactConfiguration, span: f64, contact: &Contact, velocities: Velocities) -> f64 {
    -span * contact.normal.dot(&relative_velocity(contact, &q_c.x, velocities))
}

/// Change of a body's rotation by the contacts of a step from which on overlaps are examined, rad. Up to this angle the
/// error of displacements at constant velocities, half its square times the radius, is below a hundredth of the radius.
const MIN_TURN: f64 = 0.1;

/// Largest change of a body's rotation by the contacts of a step, rad: a body that turns by more between two steps may meet the
/// surface in any orientation.
const MAX_TURN: f64 = 1.0;

/// Largest depth to which the centre of a body that keeps its orientation may take it into a surface in a step, divided
/// by half the thickness of the thinner one: overlaps above a hundredth of the radius are worth a warning.
const MAX_PUSHED_DEPTH: f64 = 0.01;

/// Bodies that contacts turn in this step by more than [`MAX_TURN`], or so far that a contactor ends behind the surface
/// of another, deeper than half the thickness of the thinner one. Deeper overlaps may be resolved to the wrong side.
///
/// `free`, `solved`: velocities in the contact configuration without and with contacts.
pub fn overturned_bodies(
    scene: &Scene,
    q_c: &ContactConfiguration,
    contacts: &[Contact],
    free: Velocities,
    solved: Velocities,
) -> Vec<BodyId> {
    if !scene.has_parts() {
        return Vec::new();
    }
    let span = q_c.reach_time(scene);
    let (mut is_turned, mut through) = (vec![false; scene.bodies.len()], BTreeSet::new());
    // The orientation of a sphere changes no gap.
    let can_turn = |body: &&BodyId| !scene.bodies[body.index()].is_sphere() && !q_c.orientation_kept.contains(body);
    let turn = |body: BodyId| (body, span * (solved.w[body.index()] - free.w[body.index()]).norm());
    let bodies = scene.free.par_iter().with_min_len(PAR_MIN_LEN).filter(can_turn);
    let turns: Vec<(BodyId, f64)> = bodies.map(|body| turn(*body)).filter(|(_, turn)| *turn > MIN_TURN).collect();
    if turns.is_empty() {
        return Vec::new();
    }
    for (body, turn) in turns {
        is_turned[body.index()] = true;
        if turn > MAX_TURN {
            through.insert(body);
        }
    }
    let motion = StepMotion { scene, q_c, span, velocities: solved };
    for contact in contacts {
        let pushed_through = both_sides(contact).into_iter().filter(|&(own, other)| {
            let rotation =
                if is_turned[other.0.index()] { SurfaceRotation::Ignored } else { SurfaceRotation::Included };
            is_turned[own.0.index()] && motion.is_deeper(contact, [own, other], rotation, 1.0)
        });
        through.extend(pushed_through.map(|(own, _)| own.0));
    }
    through.into_iter().collect()
}

/// Bodies that keep their orientation in this step, not yet pushed at their centres, that take themselves or another body
/// deeper than [`MAX_PUSHED_DEPTH`] behind a surface.
///
/// `velocities`: velocities in the contact configuration, without rotation for bodies that keep their orientation.
pub fn pushed_bodies(
    scene: &Scene,
    q_c: &ContactConfiguration,
    contacts: &[Contact],
    velocities: Velocities,
) -> BTreeSet<BodyId> {
    let mut pushed = BTreeSet::new();
    if q_c.orientation_kept.len() == q_c.pushed_at_centre.len() {
        return pushed;
    }
    let span = q_c.reach_time(scene);
    let motion = StepMotion { scene, q_c, span, velocities };
    let is_pushable = |body: &BodyId| q_c.orientation_kept.contains(body) && !q_c.is_pushed_at_centre(*body);
    for contact in contacts {
        let bodies = [contact.candidate, contact.antagonist];
        if !bodies.iter().any(is_pushable) || approach(q_c, span, contact, velocities) <= 0.0 {
            continue;
        }
        let is_deep =
            |(own, other)| motion.is_deeper(contact, [own, other], SurfaceRotation::Included, MAX_PUSHED_DEPTH);
        if both_sides(contact).into_iter().any(is_deep) {
            pushed.extend(bodies.into_iter().filter(is_pushable));
        }
    }
    pushed
}

/// Contactor: a body, and the number of its part.
type ContactorKey = (BodyId, u16);

/// The two contactors of a contact in both orders.
fn both_sides(contact: &Contact) -> [(ContactorKey, ContactorKey); 2] {
    let [a, b] =
        [(contact.candidate, contact.part_numbers.candidate), (contact.antagonist, contact.part_numbers.antagonist)];
    [(a, b), (b, a)]
}

/// Rotation of the surface behind which a point ends.
#[derive(Clone, Copy)]
enum SurfaceRotation {
    Included,
    /// Contacts turn its body as well, so that its direction at the end is unknown.
    Ignored,
}

/// Displacement of the bodies from the contact configuration in the time `span` (s), at constant velocities.
struct StepMotion<'a> {
    scene: &'a Scene,
    q_c: &'a ContactConfiguration,
    span: f64,
    velocities: Velocities<'a>,
}

impl StepMotion<'_> {
    /// Whether the contactor `own` ends behind the surface of `other` deeper than `share` of half the thickness of the
    /// thinner one; false for bodies without parts, and for a triangulated wall, which rises over planes that touch it.
    /// `rotation`: rotation of the surface.
    fn is_deeper(
        &self,
        contact: &Contact,
        [own, other]: [ContactorKey; 2],
        rotation: SurfaceRotation,
        share: f64,
    ) -> bool {
        let find = |(body, part_number): ContactorKey| self.scene.find_part(body, part_number);
        let (Some(part), Some(surface)) = (find(own), find(other)) else { return false };
        if self.scene.is_mesh(part.body) {
            return false;
        }
        let thickness = part.geometry.inner_radius().min(surface.geometry.inner_radius());
        self.depth_behind_surface(contact, part, surface, rotation) > share * thickness
    }

    /// Largest depth of a point of `part` behind the tangent plane of a contact with `surface`, m, after the full rotation of
    /// its body. `rotation`: rotation of the surface.
    fn depth_behind_surface(
        &self,
        contact: &Contact,
        part: &BodyPart,
        surface: &BodyPart,
        rotation: SurfaceRotation,
    ) -> f64 {
        let &StepMotion { q_c, span, velocities: Velocities { v, w, .. }, .. } = self;
        let (i, k) = (part.body.index(), surface.body.index());
        let [at_candidate, at_antagonist] = contact_arms(contact, &q_c.x);
        // Arms to the point of the other surface, which lies on the antagonist at the gap from the contact point.
        let (outward, own, other) = if part.body == contact.candidate {
            (contact.normal, at_candidate - contact.normal * contact.gap, at_antagonist)
        } else {
            (-contact.normal, at_antagonist, at_candidate)
        };
        let q = rotate_by_vector(&q_c.q[i], &(w[i] * span));
        let surface_turning = match rotation {
            SurfaceRotation::Ignored => Vec3::zeros(),
            SurfaceRotation::Included => w[k].cross(&other),
        };
        let centre_from_surface = own + (v[k] + surface_turning - v[i]) * span - q * part.offset;
        outward.dot(&centre_from_surface) + part.geometry.support_height(&(q * part.axes), &-outward)
    }
}
