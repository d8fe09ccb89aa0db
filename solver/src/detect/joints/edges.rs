//! Contactors on flush contactors: finds contacts with the edges and sides between these; A, B, C and inner contacts as in
//! [`super`].

use std::ops::Range;

use rayon::prelude::*;

use super::along::{contact_along, polyhedron};
use super::inner::{
    ContactHeight, FLUSH_TOLERANCE, FacePlane, InnerContact, JointScratch, MAX_CONTACTS_ALL_PAIRS, NearbyContactor,
    SurfaceContact, UpperContactor, any_is_low,
};
use super::solid::ConvexSolid;
use crate::detect::posed::{CandidatePair, PairSettings, PosedContactor, PosedShape};
use crate::detect::travel::TravelBounds;
use crate::integrate::ContactConfiguration;
use crate::math::{Vec3, concatenated_lists, group_by_key, run_ranges};
use crate::scene::{BodyId, PartId, Scene};
use crate::state::Contact;

/// Contactors per task.
const CONTACTORS_PER_TASK: usize = 256;
/// Contacts per task.
const CONTACTS_PER_TASK: usize = 1024;

/// Removes the inner contacts from contacts that are ordered by key; returns their candidates and antagonists.
pub fn remove_inner_edges(
    scene: &Scene,
    q_c: &ContactConfiguration,
    travel_bounds: &TravelBounds,
    contactors: &[PosedContactor],
    contacts: &mut Vec<Contact>,
) -> Vec<[PartId; 2]> {
    if !has_common_surfaces(contactors) {
        return Vec::new();
    }
    let search = InnerEdgeSearch::new(scene, q_c, travel_bounds, contactors, contacts);
    let inner = search.inner_contacts();
    if inner.is_empty() {
        return Vec::new();
    }
    let runs = search.runs;
    replace_inner_contacts(
        scene,
        PairSettings { bounds: travel_bounds, cell: &q_c.cell },
        contactors,
        &runs,
        &inner,
        contacts,
    );
    inner.iter().map(|inner| runs[inner.contact.index as usize].parts).collect()
}

/// Whether two contactors may have a common surface. Ends of cylinders alone form none.
fn has_common_surfaces(contactors: &[PosedContactor]) -> bool {
    contactors.iter().any(|contactor| polyhedron(contactor).is_some())
        && contactors.iter().filter(|contactor| covering_solid(contactor).is_some()).nth(1).is_some()
}

/// Shape of a contactor whose faces may be part of a common surface: of a polyhedron or a solid cylinder.
fn covering_solid<'a>(contactor: &'a PosedContactor<'a>) -> Option<ConvexSolid<'a>> {
    match &contactor.shape {
        PosedShape::Cylinder { half_height, radius, hollow: false } => {
            Some(ConvexSolid::Cylinder { axes: &contactor.axes, half_height: *half_height, radius: *radius })
        }
        _ => polyhedron(contactor).map(ConvexSolid::Polyhedron),
    }
}

/// Run of contacts seen from one of its contactors: run k has the number 2k seen from its candidate, and 2k + 1 seen from
/// its antagonist.
#[derive(Clone, Copy)]
struct RunView(u32);

impl RunView {
    /// Index of the run.
    fn run(self) -> u32 {
        self.0 / 2
    }

    /// Whether the run is seen from its antagonist.
    fn a_is_antagonist(self) -> bool {
        self.0 % 2 == 1
    }
}

/// Contacts of a step among which inner ones are searched.
struct InnerEdgeSearch<'a> {
    q_c: &'a ContactConfiguration,
    travel_bounds: &'a TravelBounds<'a>,
    contactors: &'a [PosedContactor<'a>],
    contacts: &'a [Contact],
    runs: Vec<ContactRun>,
    /// Whether some law attracts, so that contacts may act without closing.
    attracts: bool,
    /// Numbers of [`RunView`] by the contactor that sees, and the start of each contactor; only runs against polyhedra and
    /// solid cylinders.
    views: Vec<u32>,
    starts: Vec<u32>,
}

impl<'a> InnerEdgeSearch<'a> {
    fn new(
        scene: &Scene,
        q_c: &'a ContactConfiguration,
        travel_bounds: &'a TravelBounds<'a>,
        contactors: &'a [PosedContactor<'a>],
        contacts: &'a [Contact],
    ) -> Self {
        let attracts = scene.laws.iter().any(|law| law.cohesion().is_some());
        let runs = closing_runs(scene, contactors, contacts, attracts);
        let no_contactor = contactors.len() as u32;
        // Number of the own contactor if the other one is a solid that may hide edges.
        let view = |own: PartId, other: PartId| {
            if covering_solid(&contactors[other.index()]).is_some() { own.0 } else { no_contactor }
        };
        let run_views = |&ContactRun { parts: [a, b], .. }: &ContactRun| [view(a, b), view(b, a)];
        let all_views: Vec<[u32; 2]> = runs.par_iter().with_min_len(CONTACTS_PER_TASK).map(run_views).collect();
        let (views, starts) = group_by_key(all_views.as_flattened(), contactors.len() + 1);
        InnerEdgeSearch { q_c, travel_bounds, contactors, contacts, runs, attracts, views, starts }
    }

    /// All inner contacts in the order of their runs, each with the normal of a plane that hides it.
    fn inner_contacts(&self) -> Vec<InnerContact> {
        let count = self.contactors.len();
        let inner_in_chunk = |scratch: &mut JointScratch, chunk: usize| {
            let mut inner = Vec::new();
            let parts = chunk * CONTACTORS_PER_TASK..count.min((chunk + 1) * CONTACTORS_PER_TASK);
            let several = parts.filter(|&part| self.starts[part + 1] - self.starts[part] > 1);
            several.for_each(|part| self.collect_inner_contacts(part, scratch, &mut inner));
            inner
        };
        let chunks = (0..count.div_ceil(CONTACTORS_PER_TASK)).into_par_iter();
        let mut inner = chunks.map_init(JointScratch::new, inner_in_chunk).collect::<Vec<_>>().concat();
        // Both contactors of a contact may find it.
        inner.sort_by_key(|inner| inner.contact.index);
        inner.dedup_by_key(|inner| inner.contact.index);
        inner
    }

    /// Appends the inner contacts of contactor A, the one with the number `part`.
    fn collect_inner_contacts(&self, part: usize, scratch: &mut JointScratch, inner: &mut Vec<InnerContact>) {
        let a = &self.contactors[part];
        self.list_near_contacts(part, scratch);
        let JointScratch { nearby: near, heights, .. } = &mut *scratch;
        if heights.len() <= MAX_CONTACTS_ALL_PAIRS && !any_is_low(heights) {
            return;
        }
        let Some(upper) = self.upper_contactor(a) else { return };
        let near = std::mem::take(near);
        if near.len() > 1 {
            let contact_at = |k: usize| self.surface_contact(a, RunView(near[k]));
            let supporting_plane = |covering: &SurfaceContact| {
                upper.supporting_plane(
                    covering,
                    &self.nearby_contactor(covering)?,
                    self.runs[covering.index as usize].gap,
                )
            };
            let is_inner = |hidden: &SurfaceContact, covering: &SurfaceContact, plane: &FacePlane| {
                let (Some(b), Some(c)) = (self.nearby_contactor(hidden), self.nearby_contactor(covering)) else {
                    return false;
                };
                upper.is_inner(plane, &c, &b, &hidden.normal, self.surface_points(hidden))
            };
            scratch.find_inner_contacts(near.len(), contact_at, supporting_plane, is_inner, inner);
        }
        scratch.nearby = near;
    }

    /// Lists in `scratch` the contacts of a contactor that can act in this step, and their heights: a contact that cannot
    /// is not an inner contact and hides none.
    fn list_near_contacts(&self, part: usize, scratch: &mut JointScratch) {
        let a = &self.contactors[part];
        let views = &self.views[self.starts[part] as usize..self.starts[part + 1] as usize];
        let run = |view: RunView| &self.runs[view.run() as usize];
        let other_contactor =
            |view: RunView| &self.contactors[run(view).parts[usize::from(!view.a_is_antagonist())].index()];
        // B cannot be nearer than C.
        let travel = views.iter().map(|&view| other_contactor(RunView(view)).travel).fold(0.0, f64::max);
        let reach = a.travel + travel + 2.0 * FLUSH_TOLERANCE * a.radius;
        let JointScratch { nearby: near, heights, .. } = scratch;
        near.clear();
        near.extend(views.iter().filter(|&&view| self.attracts || run(RunView(view)).gap <= reach));
        let height = |&view: &u32| {
            let view = RunView(view);
            let SidedContact { normal, point, .. } =
                SidedContact::new(&self.contacts[run(view).start as usize], view.a_is_antagonist());
            ContactHeight::new(normal, point - a.centre, 2.0 * other_contactor(view).radius)
        };
        heights.clear();
        heights.extend(near.iter().map(height));
    }

    /// Contactor A for the flush-joint test; `None` for a hollow cylinder or a triangulated wall.
    fn upper_contactor(&self, a: &'a PosedContactor<'a>) -> Option<UpperContactor<'a>> {
        let solid = match &a.shape {
            PosedShape::Sphere { radius } => ConvexSolid::Sphere { radius: *radius },
            PosedShape::Capsule { half_length, radius } => {
                ConvexSolid::Capsule { axes: &a.axes, half_length: *half_length, radius: *radius }
            }
            _ => covering_solid(a)?,
        };
        let lookahead = self.travel_bounds.lookahead;
        Some(UpperContactor { solid, centre: a.centre, radius: a.radius, travel: a.travel, lookahead })
    }

    /// Contact of A in a run.
    fn surface_contact(&self, a: &PosedContactor, view: RunView) -> SurfaceContact {
        let (index, a_is_antagonist) = (view.run(), view.a_is_antagonist());
        let run = &self.runs[index as usize];
        let SidedContact { normal, point, image } =
            SidedContact::new(&self.contacts[run.start as usize], a_is_antagonist);
        let other = &self.contactors[run.parts[usize::from(!a_is_antagonist)].index()];
        SurfaceContact {
            index,
            a_is_antagonist,
            normal,
            point: point - a.centre,
            centre: other.centre + image - a.centre,
            reach: 2.0 * other.radius,
        }
    }

    /// Contactor that A touches in a contact.
    fn nearby_contactor(&self, touch: &SurfaceContact) -> Option<NearbyContactor<'a>> {
        let other = self.runs[touch.index as usize].parts[usize::from(!touch.a_is_antagonist)];
        let (b, centre) = (&self.contactors[other.index()], touch.centre);
        let i = b.body.index();
        let body_centre = centre + self.q_c.x[i] - b.centre;
        Some(NearbyContactor {
            solid: covering_solid(b)?,
            centre,
            // Less the velocity of the affine field at A, which is common to all contactors near A.
            v: self.travel_bounds.image_velocity(i, &(body_centre - self.q_c.x[i])),
            w: self.travel_bounds.velocities.w[i],
            body_centre,
        })
    }

    /// Points of a contact on the surface of the other contactor, relative to the centre of A, m.
    fn surface_points(&self, touch: &SurfaceContact) -> impl Iterator<Item = Vec3> {
        let ContactRun { start, end, .. } = self.runs[touch.index as usize];
        let points = &self.contacts[start as usize..end as usize];
        let (first, SurfaceContact { point: surface_point, normal, .. }) = (points[0], *touch);
        points
            .iter()
            .map(move |point| surface_point + (point.point - first.point) - normal * (0.5 * (point.gap - first.gap)))
    }
}

/// Replaces each inner contact by the contact along the normal of the plane that hides it, and removes those of spheres.
/// `inner` is in the order of the runs.
fn replace_inner_contacts(
    scene: &Scene,
    settings: PairSettings,
    contactors: &[PosedContactor],
    runs: &[ContactRun],
    inner: &[InnerContact],
    contacts: &mut Vec<Contact>,
) {
    let mut list = RewrittenList { contacts, written: 0, unread: 0, inserted: 0 };
    for InnerContact { contact: touch, plane_normal: n } in inner {
        let ContactRun { start, end, parts, .. } = runs[touch.index as usize];
        list.drop_range(start as usize..end as usize);
        let [a, b] = parts.map(|part| &contactors[part.index()]);
        let Some(rule) = scene.visibility.interaction_rule(a.class, b.class) else { continue };
        let pair = CandidatePair::new(scene, contactors, settings, 0, &(parts, rule));
        if let Some(manifold) = contact_along(&pair, n, touch.a_is_antagonist) {
            list.insert(&pair.listed_contacts(&manifold).collect::<Vec<_>>());
        }
    }
    list.finish();
}

/// List that is rewritten in place, from its start to its end.
struct RewrittenList<'a> {
    contacts: &'a mut Vec<Contact>,
    /// Items before this index are final.
    written: usize,
    /// Items from this index on are still to be read.
    unread: usize,
    /// Number of items by which the unread ones have moved up.
    inserted: usize,
}

impl RewrittenList<'_> {
    /// Keeps the unread items before a range of the original list, and drops the items of the range.
    fn drop_range(&mut self, range: Range<usize>) {
        let start = range.start + self.inserted;
        self.contacts.copy_within(self.unread..start, self.written);
        self.written += start - self.unread;
        self.unread = range.end + self.inserted;
    }

    /// Adds items after those that are final.
    fn insert(&mut self, items: &[Contact]) {
        let missing = items.len().saturating_sub(self.unread - self.written);
        self.contacts.splice(self.unread..self.unread, std::iter::repeat_n(Contact::default(), missing));
        self.inserted += missing;
        self.unread += missing;
        self.contacts[self.written..self.written + items.len()].copy_from_slice(items);
        self.written += items.len();
    }

    /// Keeps the items that are still unread.
    fn finish(self) {
        let all = self.contacts.len();
        self.contacts.copy_within(self.unread..all, self.written);
        self.contacts.truncate(self.written + all - self.unread);
    }
}

/// Consecutive contacts of the same two contactors.
#[derive(Clone, Copy, Default)]
struct ContactRun {
    start: u32,
    end: u32,
    /// Candidate and antagonist.
    parts: [PartId; 2],
    /// Smallest gap, m.
    gap: f64,
}

/// Contact seen from one of its two contactors.
struct SidedContact {
    /// Normal towards this contactor.
    normal: Vec3,
    /// Point on the surface of the other contactor's image that touches this one, m.
    point: Vec3,
    /// Shift from the other contactor to this image, m.
    image: Vec3,
}

impl SidedContact {
    /// Contact seen from its candidate, or from its antagonist if `a_is_antagonist`.
    #[inline(always)]
    fn new(contact: &Contact, a_is_antagonist: bool) -> SidedContact {
        let &Contact { normal, point, image, gap, .. } = contact;
        let to_surface = normal * (0.5 * gap);
        if a_is_antagonist {
            SidedContact { normal: -normal, point: point - image + to_surface, image: -image }
        } else {
            SidedContact { normal, point: point - to_surface, image }
        }
    }
}

/// Runs of contacts without those that cannot close in the step whatever other contactors do. With laws that attract, all
/// can act.
fn closing_runs(scene: &Scene, contactors: &[PosedContactor], contacts: &[Contact], attracts: bool) -> Vec<ContactRun> {
    let travel = contactors.par_iter().with_min_len(CONTACTORS_PER_TASK).map(|contactor| contactor.travel);
    let largest_travel = travel.reduce(|| 0.0, f64::max);
    let is_same_pair = |a: &Contact, b: &Contact| {
        let pair = |contact: &Contact| (contact.candidate, contact.antagonist, contact.part_numbers);
        pair(a) == pair(b)
    };
    let can_close = |[a, b]: [&PosedContactor; 2], gap: f64| {
        gap <= a.travel.max(b.travel) + largest_travel + 2.0 * FLUSH_TOLERANCE * a.radius.max(b.radius)
    };
    let task_runs = |task: Range<usize>| {
        let (mut runs, mut start) = (Vec::new(), task.start);
        for of_pair in contacts[task].chunk_by(is_same_pair) {
            let (first, end) = (&of_pair[0], start + of_pair.len());
            let part =
                |body: BodyId, part_number: u16| PartId(scene.part_starts[body.index()].0 + u32::from(part_number));
            let parts = [
                part(first.candidate, first.part_numbers.candidate),
                part(first.antagonist, first.part_numbers.antagonist),
            ];
            let gap = of_pair.iter().map(|contact| contact.gap).fold(f64::INFINITY, f64::min);
            if attracts || can_close(parts.map(|part| &contactors[part.index()]), gap) {
                runs.push(ContactRun { start: start as u32, end: end as u32, parts, gap });
            }
            start = end;
        }
        runs
    };
    let tasks = run_ranges(contacts, CONTACTS_PER_TASK, is_same_pair);
    concatenated_lists(tasks.into_par_iter().map(task_runs).collect())
}
