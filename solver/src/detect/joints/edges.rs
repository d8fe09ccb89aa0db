//! Contactors on flush contactors: contacts with the edges and sides between these.

use rayon::prelude::*;

use super::inner::{
    ContactHeight, FLUSH_TOLERANCE, FacePlane, JointScratch, MAX_CONTACTS_ALL_PAIRS, NearbyContactor, SurfaceContact,
    UpperContactor, any_is_low,
};
use super::solid::ConvexSolid;
use crate::detect::posed::{CandidatePair, PosedContactor, PosedShape};
use crate::detect::travel::TravelBounds;
use crate::geometry::polyhedra_along;
use crate::integrate::ContactConfiguration;
use crate::math::{Vec3, group_by_key};
use crate::scene::Scene;
use crate::state::Contact;

/// Contactors per task.
const CONTACTORS_PER_TASK: usize = 256;

/// Removes the inner contacts from contacts that are ordered by key; returns their candidates and antagonists.
pub fn remove_inner_edges(
    scene: &Scene,
    q_c: &ContactConfiguration,
    ways: &TravelBounds,
    places: &[PosedContactor],
    contacts: &mut Vec<Contact>,
) -> Vec<[u32; 2]> {
    let posed = |part: u32| match &places[part as usize].shape {
        PosedShape::Polyhedron(posed) | PosedShape::Plane { cuboid: posed, .. } => Some(posed),
        PosedShape::Sphere { .. } | PosedShape::Cylinder { .. } => None,
    };
    let solid = |part: u32| match &places[part as usize].shape {
        PosedShape::Cylinder { half_height, radius, hollow: false } => Some(ConvexSolid::Cylinder {
            axes: &places[part as usize].axes,
            half_height: *half_height,
            radius: *radius,
        }),
        _ => posed(part).map(ConvexSolid::Polyhedron),
    };
    let all = 0..places.len() as u32;
    // Ends of cylinders alone form no common surface.
    if all.clone().all(|k| posed(k).is_none()) || all.filter(|&k| solid(k).is_some()).nth(1).is_none() {
        return Vec::new();
    }
    let attracts = scene.laws.iter().any(|law| law.cohesion().is_some());
    let runs = closing_runs(scene, places, contacts, attracts);
    let nobody = places.len() as u32;
    // Contact k has the number 2k seen from its candidate and 2k + 1 from its antagonist; only polyhedra and solid
    // cylinders count.
    let keys: Vec<u32> = runs
        .iter()
        .flat_map(|ContactRun { parts: [a, b], .. }| [(a, b), (b, a)])
        .map(|(own, other)| if solid(*other).is_some() { *own } else { nobody })
        .collect();
    let (order, starts) = group_by_key(&keys, places.len() + 1);
    let of_part = |part: usize, scratch: &mut JointScratch, inner: &mut Vec<(SurfaceContact, Vec3)>| {
        let a = &places[part];
        let keys = &order[starts[part] as usize..starts[part + 1] as usize];
        let run = |key: u32| &runs[key as usize / 2];
        let other = |key: u32| run(key).parts[usize::from(key.is_multiple_of(2))];
        // B cannot be nearer than C. A contact that cannot close in this step is not an inner contact and hides none.
        let travel = keys.iter().map(|&key| run(key).travel[key as usize % 2]).fold(0.0, f64::max);
        let reach = a.travel + travel + 2.0 * FLUSH_TOLERANCE * a.radius;
        let JointScratch { near, heights, .. } = &mut *scratch;
        near.clear();
        near.extend(keys.iter().filter(|&&key| attracts || run(key).gap <= reach));
        let height = |key: &u32| {
            let (run, turned) = (run(*key), key % 2 == 1);
            let (normal, at, _) = run.seen_from(turned);
            ContactHeight::new(normal, at - a.centre, run.reach[usize::from(turned)])
        };
        heights.clear();
        heights.extend(near.iter().map(height));
        if heights.len() <= MAX_CONTACTS_ALL_PAIRS && !any_is_low(heights) {
            return;
        }
        let near = std::mem::take(near);
        let touch = |k: usize| {
            let key = near[k];
            let (of, turned) = (key / 2, key % 2 == 1);
            let (normal, at, image) = run(key).seen_from(turned);
            let other = &places[other(key) as usize];
            SurfaceContact {
                of,
                turned,
                normal,
                at: at - a.centre,
                centre: other.centre + image - a.centre,
                reach: 2.0 * other.radius,
            }
        };
        let own = match &a.shape {
            PosedShape::Sphere { radius } => ConvexSolid::Sphere { radius: *radius },
            PosedShape::Polyhedron(posed) | PosedShape::Plane { cuboid: posed, .. } => ConvexSolid::Polyhedron(posed),
            PosedShape::Cylinder { .. } => return scratch.near = near,
        };
        let over = UpperContactor {
            solid: own,
            centre: a.centre,
            radius: a.radius,
            travel: a.travel,
            lookahead: ways.lookahead,
        };
        let contactor = |touch: &SurfaceContact| {
            let other = runs[touch.of as usize].parts[usize::from(!touch.turned)];
            let (b, centre) = (&places[other as usize], touch.centre);
            let i = b.body as usize;
            let solid = solid(other)?;
            Some(NearbyContactor {
                solid,
                centre,
                v: ways.v_free[i],
                w: ways.w_free[i],
                body: centre + q_c.x[i] - b.centre,
            })
        };
        let points = |touch: &SurfaceContact| {
            let run = &runs[touch.of as usize];
            &contacts[run.start as usize..run.end as usize]
        };
        let plane = |by: &SurfaceContact| over.supporting_plane(by, &contactor(by)?, runs[by.of as usize].gap);
        let test = |of: &SurfaceContact, by: &SurfaceContact, plane: &FacePlane| {
            let first = points(of)[0];
            let at = |contact: &Contact| {
                of.at + (contact.point - first.point) - of.normal * (0.5 * (contact.gap - first.gap))
            };
            let (Some(b), Some(c)) = (contactor(of), contactor(by)) else { return false };
            over.is_inner(plane, &c, &b, &of.normal, points(of).iter().map(at))
        };
        if near.len() > 1 {
            scratch.find_inner_contacts(near.len(), touch, plane, test, inner);
        }
        scratch.near = near;
    };
    let several = |part: &usize| starts[part + 1] - starts[*part] > 1;
    let of_some = |scratch: &mut JointScratch, chunk: usize| {
        let mut inner = Vec::new();
        let parts = chunk * CONTACTORS_PER_TASK..places.len().min((chunk + 1) * CONTACTORS_PER_TASK);
        parts.filter(several).for_each(|part| of_part(part, scratch, &mut inner));
        inner
    };
    let chunks = (0..places.len().div_ceil(CONTACTORS_PER_TASK)).into_par_iter();
    let mut inner = chunks.map_init(JointScratch::new, of_some).collect::<Vec<_>>().concat();
    if inner.is_empty() {
        return Vec::new();
    }
    // Both contactors of a contact may find it.
    inner.sort_by_key(|(touch, _)| touch.of);
    inner.dedup_by_key(|(touch, _)| touch.of);
    let mut pairs = Vec::with_capacity(inner.len());
    // Contacts before `to` are final; those from `from` on move up into the gaps that inner contacts leave.
    let (mut to, mut from, mut shift) = (0, 0, 0);
    for (touch, n) in inner {
        let ContactRun { start, end, parts, .. } = runs[touch.of as usize];
        let (start, end) = (start as usize + shift, end as usize + shift);
        contacts.copy_within(from..start, to);
        to += start - from;
        from = end;
        pairs.push(parts);
        let [Some(p), Some(q)] = parts.map(posed) else { continue };
        let [a, b] = parts.map(|k| places[k as usize].class);
        let Some(see) = scene.visibility.interaction_rule(a, b) else { continue };
        let meeting = CandidatePair::new(scene, places, ways.nearby, 0, &(parts, see));
        let n = if touch.turned { -n } else { n };
        if let Some(manifold) = polyhedra_along(p, q, &meeting.c, &n, meeting.range) {
            let count = meeting.listed_contacts(&manifold).count();
            let room = from - to;
            if count > room {
                contacts.splice(from..from, std::iter::repeat_n(contacts[start], count - room));
                shift += count - room;
                from += count - room;
            }
            contacts[to..to + count].iter_mut().zip(meeting.listed_contacts(&manifold)).for_each(|(to, of)| *to = of);
            to += count;
        }
    }
    let all = contacts.len();
    contacts.copy_within(from..all, to);
    contacts.truncate(to + all - from);
    pairs
}

/// Consecutive contacts of the same two contactors.
struct ContactRun {
    start: u32,
    end: u32,
    /// Candidate and antagonist.
    parts: [u32; 2],
    /// Smallest gap, m.
    gap: f64,
    /// Normal, point and image of the first contact, and half of its gap, m.
    normal: Vec3,
    point: Vec3,
    image: Vec3,
    half_gap: f64,
    /// Diameters of the bounding balls of antagonist and candidate, and their largest displacements in the step, m.
    reach: [f64; 2],
    travel: [f64; 2],
}

impl ContactRun {
    /// Normal towards the candidate, or the antagonist if `turned`, the point on the surface of the other contactor, and
    /// the shift from the image of the contact that touches the former, m.
    #[inline(always)]
    fn seen_from(&self, turned: bool) -> (Vec3, Vec3, Vec3) {
        if turned {
            (-self.normal, self.point - self.image + self.normal * self.half_gap, -self.image)
        } else {
            (self.normal, self.point - self.normal * self.half_gap, self.image)
        }
    }
}

/// Runs of contacts without those that cannot close in the step whatever other contactors do. With laws that attract, all
/// can act.
fn closing_runs(scene: &Scene, places: &[PosedContactor], contacts: &[Contact], attracts: bool) -> Vec<ContactRun> {
    let fastest = places.iter().map(|place| place.travel).fold(0.0, f64::max);
    let mut runs = Vec::with_capacity(contacts.len() / 2);
    let pair = |contact: &Contact| (contact.candidate, contact.antagonist, contact.ranks);
    let mut start = 0;
    for of_one in contacts.chunk_by(|a, b| pair(a) == pair(b)) {
        let end = start + of_one.len() as u32;
        let first = &of_one[0];
        let part = |body: u32, rank: u16| scene.part_starts[body as usize] + u32::from(rank);
        let parts = [part(first.candidate, first.ranks.0), part(first.antagonist, first.ranks.1)];
        let [a, b] = parts.map(|part| &places[part as usize]);
        let gap = of_one.iter().map(|contact| contact.gap).fold(f64::INFINITY, f64::min);
        if attracts || gap <= a.travel.max(b.travel) + fastest + 2.0 * FLUSH_TOLERANCE * a.radius.max(b.radius) {
            runs.push(ContactRun {
                start,
                end,
                parts,
                gap,
                normal: first.normal,
                point: first.point,
                image: first.image,
                half_gap: 0.5 * first.gap,
                reach: [2.0 * b.radius, 2.0 * a.radius],
                travel: [b.travel, a.travel],
            });
        }
        start = end;
    }
    runs
}
