//! Bodies that an impact turns through a surface within one step.
//!
//! Contacts bound the velocities of the points that are listed, at the orientation of the contact configuration. A body that
//! an impact turns by a large angle within the step brings other points to the surface, or beyond it. In such a step the
//! impulses of contacts push the body without turning it: it is brought to touch, and turns in the steps after, which begin
//! at the surface. Mechanical energy does not grow by this.

use std::collections::BTreeSet;

use rayon::prelude::*;

use crate::assemble::contact_arms;
use crate::integrate::ContactConfiguration;
use crate::math::{PAR_MIN_LEN, Vec3, rotate_by_vector};
use crate::scene::{BodyId, BodyPart, Scene};
use crate::state::{Contact, Velocities};

/// Smallest change of a body's rotation by the contacts of a step that is examined, rad. Up to this angle the error of the
/// displacements at constant velocities, half its square times the radius, is below a hundredth of the radius.
const MIN_TURN: f64 = 0.1;

/// Largest change of a body's rotation by the contacts of a step, rad: a body that turns by more between two steps may meet the
/// surface in any orientation.
const MAX_TURN: f64 = 1.0;

/// Bodies that contacts turn in this step by more than [`MAX_TURN`], or until a contactor ends deeper behind a surface that it
/// has met than half its own thickness or that of the other contactor. Deeper overlaps may be resolved to the wrong side.
///
/// `free`, `solved`: velocities in the contact configuration without and with contacts.
pub fn overturned_bodies(
    scene: &Scene,
    q_c: &ContactConfiguration,
    contacts: &[Contact],
    free: Velocities,
    solved: Velocities,
) -> Vec<BodyId> {
    if !scene.is_general() {
        return Vec::new();
    }
    let span = q_c.reach_time(scene);
    let (mut turned, mut through) = (vec![false; scene.bodies.len()], BTreeSet::new());
    // The orientation of a sphere changes no gap.
    let can_turn = |body: &&BodyId| !scene.bodies[body.index()].is_sphere() && !q_c.unturned.contains(body);
    let turn = |body: BodyId| (body, span * (solved.w[body.index()] - free.w[body.index()]).norm());
    let bodies = scene.free.par_iter().with_min_len(PAR_MIN_LEN).filter(can_turn);
    let found: Vec<(BodyId, f64)> = bodies.map(|body| turn(*body)).filter(|(_, turn)| *turn > MIN_TURN).collect();
    if found.is_empty() {
        return Vec::new();
    }
    for (body, turn) in found {
        turned[body.index()] = true;
        if turn > MAX_TURN {
            through.insert(body);
        }
    }
    let passes = |contact: &Contact, own: (BodyId, u16), other: (BodyId, u16)| {
        let [Some(part), Some(surface)] = [own, other].map(|(body, rank)| scene.find_part(body, rank)) else {
            return false;
        };
        let thickness = part.geometry.inner_radius().min(surface.geometry.inner_radius());
        let turns = turned[surface.body.index()];
        depth_behind_surface(q_c, span, contact, (part, surface), turns, solved) > thickness
    };
    for contact in contacts {
        let [a, b] = [(contact.candidate, contact.ranks.0), (contact.antagonist, contact.ranks.1)];
        let pushed_through =
            [(a, b), (b, a)].into_iter().filter(|(own, other)| turned[own.0.index()] && passes(contact, *own, *other));
        through.extend(pushed_through.map(|(own, _)| own.0));
    }
    through.into_iter().collect()
}

/// Largest depth of a point of `part` behind the tangent plane of a contact with `surface`, m, after the time `span` (s) at
/// these velocities, with the full rotation of its body. `turns`: whether contacts turn the other body as well; its surface
/// then counts as not rotated, since its direction at the end is unknown.
fn depth_behind_surface(
    q_c: &ContactConfiguration,
    span: f64,
    contact: &Contact,
    (part, surface): (&BodyPart, &BodyPart),
    turns: bool,
    Velocities { v, w }: Velocities,
) -> f64 {
    let (i, k) = (part.body.index(), surface.body.index());
    let [at_candidate, at_antagonist] = contact_arms(contact, &q_c.x);
    // Arms to the point of the other surface, which lies on the antagonist at the gap from the contact point.
    let (outward, own, other) = if part.body == contact.candidate {
        (contact.normal, at_candidate - contact.normal * contact.gap, at_antagonist)
    } else {
        (-contact.normal, at_antagonist, at_candidate)
    };
    let q = rotate_by_vector(&q_c.q[i], &(w[i] * span));
    let turning = if turns { Vec3::zeros() } else { w[k].cross(&other) };
    let below = own + (v[k] + turning - v[i]) * span - q * part.offset;
    outward.dot(&below) + part.geometry.support_height(&(q * part.axes), &-outward)
}
