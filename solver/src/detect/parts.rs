//! Contacts between contactors of any shape: a broad phase on bounding balls, then the narrow phase of each pair.

use std::cmp::Ordering;
use std::sync::Arc;

use rayon::prelude::*;
use smallvec::SmallVec;

use cd_formats::compute::NarrowPhase;
use cd_formats::geometry::periodic_cell::PeriodicCell;
use cd_formats::wall_mesh::WallMesh;

use super::neighbours::BoundingBalls;
use super::posed::{CandidatePair, PairSettings, PosedContactor, PosedShape, posed_contactors};
use super::swept::SweptBall;
use super::travel::TravelBounds;
use super::{joints, narrow, periodic, rank_pairs};
use crate::activity;
use crate::geometry::{
    CachedFeature, ContactPoint, Manifold, NarrowPhaseMode, PairBatch, PairRequest, PairResult, Separated,
    WallContacts, capsule_capsule, capsule_cylinder, capsule_mesh, cylinder_cylinder, cylinder_hollow_cylinder,
    cylinder_mesh, far_walls, nearest_of_segment, polyhedron_capsule, polyhedron_cylinder, polyhedron_hollow_cylinder,
    polyhedron_mesh, polyhedron_sphere, rims_at_far_walls, segment_ends, swapped_manifold, vertices_at_far_walls,
};
use crate::integrate::ContactConfiguration;
use crate::math::simd::SimdWidth;
use crate::math::{PAR_MIN_LEN, Vec3, group_by_key};
use crate::scene::{BodyId, PartId, Scene};
use crate::state::{Contact, DetectionCache, NearSurfaces, SeparatingAxis, VisiblePair};

impl DetectionCache {
    /// Updates positions and accumulated displacements of the contactors, and the list of pairs with the cached data of each
    /// if the neighbour list is rebuilt. `bodies`: all bodies in spatial order.
    fn rebuild_if_stale(
        &mut self,
        scene: &Scene,
        contactors: &mut [PosedContactor],
        cell: &PeriodicCell,
        bodies: &[u32],
    ) {
        if self.last.len() != contactors.len() {
            *self = DetectionCache {
                accumulated_travel: vec![0.0; contactors.len()],
                restored_pairs: self.cached_pairs(),
                ..DetectionCache::default()
            };
            self.last = contactors.iter().map(|contactor| (contactor.centre, contactor.axes)).collect();
        }
        let last = self.last.par_iter_mut().zip(&mut self.accumulated_travel);
        let moved = contactors.par_iter_mut().zip(&scene.parts).zip(last).with_min_len(CONTACTORS_PER_TASK);
        moved.for_each(|((now, part), ((x, q), travel))| {
            // |q - q'| = 2 sin(θ/4), and a surface point moves by 2 R sin(θ/2) <= 2 R |q - q'|.
            let rotation = (now.axes.coords - q.coords).norm().min((now.axes.coords + q.coords).norm());
            *travel += (now.centre - *x).norm() + 2.0 * part.bounding_radius * rotation;
            (*x, *q, now.accumulated_travel) = (now.centre, now.axes, *travel);
            *travel += now.growth; // up to the next step
        });
        let all = contactors.par_iter().with_min_len(CONTACTORS_PER_TASK);
        let centres: Vec<Vec3> = all.clone().map(|contactor| contactor.centre).collect();
        let listing_radius: Vec<f64> = all.clone().map(|contactor| contactor.listing_radius).collect();
        let travel: Vec<f64> = all.map(|contactor| contactor.travel - contactor.affine_travel).collect();
        let path = |k: usize| contactors[k].path;
        let balls = BoundingBalls { centres: &centres, reach: &listing_radius, path, travel: &travel };
        if !self.neighbours.rebuild_if_stale(&balls, cell, scene.mean_radius, 0..u32::MAX) {
            return;
        }
        let cached_features = self.cached_pairs();
        let separation_of = |&k: &u32| (self.pairs[k as usize].0, self.separations[k as usize]);
        let near = std::mem::take(&mut self.neighbours.pairs);
        let near: Vec<VisiblePair> =
            near.into_par_iter().with_min_len(1024).filter_map(|ij| visible_parts(scene, contactors, ij)).collect();
        let pairs = pairs_by_candidate(&near, scene, bodies);
        let order = part_order(&pairs, contactors.len());
        self.separations = previous_values(&pairs, &order, self.order_by_parts.iter().map(separation_of));
        let features = cached_features.into_iter().map(|cached| (cached.parts, cached.memory));
        self.memories = previous_values(&pairs, &order, features);
        (self.pairs, self.order_by_parts, self.restored_pairs) = (Arc::new(pairs), Arc::new(order), Vec::new());
        self.near_surfaces.clear();
    }
}

impl DetectionCache {
    /// Removes the cached direction of two contactors, so that the next step searches it anew.
    fn forget_feature(&mut self, parts: &[PartId; 2]) {
        if let Ok(position) = self.order_by_parts.binary_search_by_key(parts, |&k| self.pairs[k as usize].0) {
            self.memories[self.order_by_parts[position] as usize] = CachedFeature::default();
        }
    }
}

/// Returns a list ordered by key without the inner contacts of joints.
pub fn without_inner_edges(
    scene: &Scene,
    q_c: &ContactConfiguration,
    bounds: &TravelBounds,
    mut contacts: Vec<Contact>,
) -> Vec<Contact> {
    let contactors = posed_contactors(scene, q_c, bounds);
    joints::remove_inner_edges(scene, q_c, bounds, &contactors, &mut contacts);
    contacts
}

/// All listed contacts, ordered by key.
pub fn listed_contacts(
    scene: &Scene,
    q_c: &ContactConfiguration,
    bounds: &TravelBounds,
    narrow: NarrowPhase,
    cache: &mut DetectionCache,
) -> Vec<Contact> {
    let mut contactors = posed_contactors(scene, q_c, bounds);
    let settings = PairSettings { bounds, cell: &q_c.cell };
    cache.rebuild_if_stale(scene, &mut contactors, &q_c.cell, &q_c.order);
    let DetectionCache { pairs, memories, separations, near_surfaces, .. } = cache;
    let narrow = match narrow {
        NarrowPhase::Fast => NarrowPhaseMode::Fast,
        NarrowPhase::Accurate => NarrowPhaseMode::Accurate,
    };
    let width = SimdWidth::detect();
    let own_pairs = rank_pairs::own_pairs(scene, pairs.len());
    let own = own_pairs.clone().unwrap_or(0..pairs.len());
    near_surfaces.resize_with(own.len().div_ceil(PAIRS_PER_TASK), NearSurfaces::default);
    let chunks = pairs[own.clone()]
        .par_chunks(PAIRS_PER_TASK)
        .zip(memories[own.clone()].par_chunks_mut(PAIRS_PER_TASK))
        .zip(separations[own].par_chunks_mut(PAIRS_PER_TASK))
        .zip(near_surfaces);
    let chunks = chunks.map(|(((pairs, memories), separations), near_surfaces)| PairChunk {
        pairs,
        memories,
        separations,
        near_surfaces,
    });
    let scratch =
        || NarrowPhaseScratch { polyhedra: PairBatch::new(width), prefetcher: Prefetcher::new(&contactors, width) };
    let mut found: Vec<ListedContacts> = chunks
        .map_init(scratch, |scratch, chunk| narrow_phase_chunk(scene, &contactors, settings, narrow, scratch, chunk))
        .collect();
    if own_pairs.is_some() {
        let by_rank = rank_pairs::gather_contacts(found.iter().flat_map(|listed| &listed.contacts), memories);
        found = by_rank.into_iter().map(|contacts| ListedContacts::from_contacts(contacts, settings)).collect();
    }
    let mut contacts = contacts_by_key(&found, scene.bodies.len(), width);
    let inner = joints::remove_inner_edges(scene, q_c, bounds, &contactors, &mut contacts);
    inner.iter().for_each(|parts| cache.forget_feature(parts));
    contacts
}

/// Contacts of pairs that the displacements of `bounds` bring near each other, ordered by key; at least one body of each
/// pair is `searched`.
pub fn swept_contacts(
    scene: &Scene,
    q_c: &ContactConfiguration,
    bounds: &TravelBounds,
    narrow: NarrowPhaseMode,
    searched: impl Fn(BodyId) -> bool + Sync,
) -> Vec<Contact> {
    let contactors = posed_contactors(scene, q_c, bounds);
    let ball = |contactor: &PosedContactor| SweptBall {
        centre: contactor.centre,
        path: contactor.path,
        radius: contactor.radius + contactor.bend + contactor.affine_travel,
        searched: searched(contactor.body),
    };
    let balls: Vec<SweptBall> = contactors.iter().map(ball).collect();
    let listing_radius: Vec<f64> = contactors.iter().map(|contactor| contactor.listing_radius).collect();
    let near = periodic::periodic_swept_pairs(&balls, &listing_radius, &q_c.cell);
    let mut pairs: Vec<VisiblePair> = near.into_iter().filter_map(|ij| visible_parts(scene, &contactors, ij)).collect();
    pairs.sort_unstable_by_key(|(parts, _)| *parts);
    let width = SimdWidth::detect();
    let mut scratch =
        NarrowPhaseScratch { polyhedra: PairBatch::new(width), prefetcher: Prefetcher::new(&contactors, width) };
    let narrow_phase_of = |pairs: &[VisiblePair]| {
        let (mut memories, mut separations) =
            ([CachedFeature::default(); PAIRS_PER_TASK], [SeparatingAxis::default(); PAIRS_PER_TASK]);
        let (memories, separations) = (&mut memories[..pairs.len()], &mut separations[..pairs.len()]);
        let near_surfaces = &mut NearSurfaces::default();
        narrow_phase_chunk(
            scene,
            &contactors,
            PairSettings { bounds, cell: &q_c.cell },
            narrow,
            &mut scratch,
            PairChunk { pairs, memories, separations, near_surfaces },
        )
    };
    let found: Vec<ListedContacts> = pairs.chunks(PAIRS_PER_TASK).map(narrow_phase_of).collect();
    contacts_by_key(&found, scene.bodies.len(), width)
}

/// Pairs of one task with their cached data.
struct PairChunk<'p> {
    pairs: &'p [VisiblePair],
    memories: &'p mut [CachedFeature],
    separations: &'p mut [SeparatingAxis],
    near_surfaces: &'p mut NearSurfaces,
}

/// Pairs per task.
const PAIRS_PER_TASK: usize = 256;
/// Smallest number of contactors per task.
const CONTACTORS_PER_TASK: usize = 256;
/// Runs of contacts per task.
const RUNS_PER_TASK: usize = 512;

/// Scratch memory for the narrow phase, reused from task to task.
struct NarrowPhaseScratch<'a> {
    polyhedra: PairBatch<'a, CandidatePair<'a>>,
    prefetcher: Prefetcher<'a>,
}

/// Applies the narrow phase to the pairs that are not known to be apart.
fn narrow_phase_chunk<'a>(
    scene: &Scene,
    contactors: &'a [PosedContactor<'a>],
    settings: PairSettings<'a>,
    narrow: NarrowPhaseMode,
    scratch: &mut NarrowPhaseScratch<'a>,
    chunk: PairChunk,
) -> ListedContacts<'a> {
    let PairChunk { pairs, memories, separations, near_surfaces } = chunk;
    if activity::is_stopped() {
        return ListedContacts::new(0, settings);
    }
    let (mut near, mut count) = ([0; PAIRS_PER_TASK], 0);
    for (k, separation) in separations.iter().enumerate() {
        near[count] = k;
        count += usize::from(
            separation.valid_travel
                <= CandidatePair::listing_reach(scene, contactors, settings.bounds.nearby, &pairs[k]),
        );
    }
    let near = &near[..count];
    let NarrowPhaseScratch { polyhedra, prefetcher } = scratch;
    near.iter().take(PREFETCH_DISTANCE).for_each(|&k| prefetcher.prefetch(pairs[k].0));
    let mut listed = ListedContacts::new(count, settings);
    for (at, &k) in near.iter().enumerate() {
        if let Some(&later) = near.get(at + PREFETCH_DISTANCE) {
            prefetcher.prefetch(pairs[later].0);
        }
        let pair = CandidatePair::new(scene, contactors, settings, k, &pairs[k]);
        // `new` may find a shorter listing range than `listing_reach`, so test again.
        if separations[k].valid_travel > pair.accumulated_travel() + pair.range.alert {
            continue;
        }
        let (memory, separation) = (std::mem::take(&mut memories[k]), std::mem::take(&mut separations[k]));
        if pair.is_near() {
            let record = &mut |pair: CandidatePair<'a>, result: PairResult| {
                listed.record_result(&pair, result, memories, separations);
            };
            if let (PosedShape::Sphere { radius }, PosedShape::Mesh(mesh)) = (&pair.a.shape, &pair.b.shape) {
                sphere_on_surface(pair, *radius, mesh, (near_surfaces, &pairs[k].0), record);
            } else {
                let hint = separation.n.filter(|_| memory == CachedFeature::default());
                narrow_phase_pair(pair, narrow, &memory, hint, polyhedra, record);
            }
        }
    }
    polyhedra.flush(&mut |pair, result| listed.record_result(&pair, result, memories, separations));
    listed
}

/// Contacts that a task has found.
struct ListedContacts<'a> {
    contacts: Vec<Contact>,
    /// Candidates of consecutive contacts, and the index where each run begins.
    runs: Vec<(BodyId, usize)>,
    settings: PairSettings<'a>,
}

/// Relative margin on the balls' radii for the rounding of distances.
const ROUNDING_MARGIN: f64 = 1e-9;

impl<'a> ListedContacts<'a> {
    fn new(pairs: usize, settings: PairSettings<'a>) -> Self {
        ListedContacts { contacts: Vec::with_capacity(4 * pairs), runs: Vec::new(), settings }
    }

    /// Contacts in the order of their pairs.
    fn from_contacts(contacts: Vec<Contact>, settings: PairSettings<'a>) -> Self {
        let begins_run = |&k: &usize| k == 0 || contacts[k - 1].candidate != contacts[k].candidate;
        let runs = (0..contacts.len()).filter(begins_run).map(|k| (contacts[k].candidate, k)).collect();
        ListedContacts { contacts, runs, settings }
    }

    /// Adds the contacts of a pair: points up to its range; points on its area share the area. Keeps the pair's cache
    /// entries.
    fn record_result(
        &mut self,
        pair: &CandidatePair,
        result: PairResult,
        memories: &mut [CachedFeature],
        separations: &mut [SeparatingAxis],
    ) {
        let CandidatePair { index, a, b, c, .. } = pair;
        let manifold = match result {
            Ok((memory, manifold)) => {
                memories[*index] = memory;
                manifold
            }
            Err(Separated { n, s }) => {
                let n = Some([n.x, n.y, n.z].map(|x| x as f32));
                if self.settings.bounds.is_deforming() {
                    // The cell moves images, by a distance that no contactor has accumulated.
                    separations[*index] = SeparatingAxis { n, ..SeparatingAxis::default() };
                    return;
                }
                // No separation is known of another image; an image is nearest only up to half a period.
                let periods = self.settings.cell.periods.iter().zip(c.as_slice());
                let image_margins = periods.filter_map(|(period, c)| Some((*period)? / 2.0 - c.abs()));
                let valid_travel = image_margins.fold(s, f64::min) + pair.accumulated_travel()
                    - ROUNDING_MARGIN * (a.listing_radius + b.listing_radius);
                separations[*index] = SeparatingAxis { n, valid_travel };
                return;
            }
        };
        if self.runs.last().is_none_or(|(candidate, _)| *candidate != a.body) {
            self.runs.push((a.body, self.contacts.len()));
        }
        self.contacts.extend(pair.listed_contacts(manifold));
    }

    /// Candidate and contacts of each run.
    fn runs(&self) -> impl Iterator<Item = (BodyId, &[Contact])> {
        let ends = self.runs.iter().skip(1).map(|(_, start)| *start).chain([self.contacts.len()]);
        self.runs.iter().zip(ends).map(|(&(candidate, start), end)| (candidate, &self.contacts[start..end]))
    }
}

/// All contacts, ordered by key.
fn contacts_by_key(found: &[ListedContacts], bodies: usize, width: SimdWidth) -> Vec<Contact> {
    let (candidates, runs): (Vec<u32>, Vec<&[Contact]>) =
        found.iter().flat_map(ListedContacts::runs).map(|(candidate, run)| (candidate.0, run)).unzip();
    let (order, _) = group_by_key(&candidates, bodies);
    let run = |&k: &u32| runs[k as usize];
    let mut contacts = vec![Contact::default(); runs.iter().map(|run| run.len()).sum()];
    let mut left = &mut contacts[..];
    let task_slice = |order: &'_ [u32]| {
        let length = order.iter().map(|k| run(k).len()).sum();
        left.split_off_mut(..length).unwrap_or_default()
    };
    let parts: Vec<&mut [Contact]> = order.chunks(RUNS_PER_TASK).map(task_slice).collect();
    parts.into_par_iter().zip(order.par_chunks(RUNS_PER_TASK)).for_each(|(mut part, order)| {
        for (at, k) in order.iter().enumerate() {
            order.get(at + 1).into_iter().for_each(|later| width.prefetch(run(later)));
            part.split_off_mut(..run(k).len()).unwrap_or_default().copy_from_slice(run(k));
        }
    });
    // The contacts of one candidate may come from several tasks or several parts.
    contacts.par_chunk_by_mut(|a, b| a.candidate == b.candidate).for_each(|of_candidate| {
        if !of_candidate.is_sorted_by(|a, b| a.cmp_by_key(b) != Ordering::Greater) {
            of_candidate.sort_unstable_by_key(Contact::key);
        }
    });
    contacts
}

/// Number of pairs by which the prefetch is ahead: a few microseconds, and less than the L1 cache contains.
const PREFETCH_DISTANCE: usize = 16;

/// Prefetches the data of pairs: with many bodies it comes from main memory in every step, while other pairs are
/// processed.
struct Prefetcher<'a> {
    contactors: &'a [PosedContactor<'a>],
    width: SimdWidth,
    /// Parts that were prefetched recently, each at the index of its number modulo the length.
    recent: [PartId; SHAPES_IN_L2],
}

/// Approximate number of shapes that fit in the L2 cache.
const SHAPES_IN_L2: usize = 256;

impl<'a> Prefetcher<'a> {
    fn new(contactors: &'a [PosedContactor<'a>], width: SimdWidth) -> Self {
        Prefetcher { contactors, width, recent: [PartId(u32::MAX); SHAPES_IN_L2] }
    }

    #[inline(always)]
    fn prefetch(&mut self, parts: [PartId; 2]) {
        for part in parts {
            let last = &mut self.recent[part.index() % SHAPES_IN_L2];
            if *last != part
                && let PosedShape::Polyhedron(posed) = &self.contactors[part.index()].shape
            {
                *last = part;
                posed.prefetch(self.width);
            }
        }
    }
}

/// The two contactors with the candidate first, and their visibility rule; `None` if the table has no rule, if
/// both are of one body, or if the motion of both is imposed.
fn visible_parts(scene: &Scene, contactors: &[PosedContactor], pair: [u32; 2]) -> Option<VisiblePair> {
    let [i, j] = pair.map(PartId);
    let [a, b] = [i, j].map(|part| &contactors[part.index()]);
    if a.body == b.body || (a.is_imposed && b.is_imposed) {
        return None;
    }
    let rule = scene.visibility.interaction_rule(a.class, b.class)?;
    let first = scene.candidate_order(a.body, a.number) <= scene.candidate_order(b.body, b.number);
    Some((if first { [i, j] } else { [j, i] }, rule))
}

/// Pairs ordered by candidate, in the order of the bodies, then by antagonist.
fn pairs_by_candidate(pairs: &[VisiblePair], scene: &Scene, bodies: &[u32]) -> Vec<VisiblePair> {
    let mut positions = vec![0; bodies.len()];
    bodies.iter().zip(0..).for_each(|(&body, position)| positions[body as usize] = position);
    let position_of_candidate = |(parts, _): &VisiblePair| positions[scene.parts[parts[0].index()].body.index()];
    let keys: Vec<u32> = pairs.par_iter().with_min_len(PAR_MIN_LEN).map(position_of_candidate).collect();
    let (order, _) = group_by_key(&keys, bodies.len());
    let pair = |&k: &u32| pairs[k as usize];
    let mut grouped: Vec<VisiblePair> = order.par_iter().with_min_len(PAR_MIN_LEN).map(pair).collect();
    let candidate = |(parts, _): &VisiblePair| scene.parts[parts[0].index()].body;
    let by_candidate = grouped.par_chunk_by_mut(|a, b| candidate(a) == candidate(b));
    by_candidate.for_each(|of_candidate| of_candidate.sort_unstable_by_key(|(parts, _)| *parts));
    grouped
}

/// Indices of the pairs in the order of their parts. The pairs are ordered by candidate, and pairs of one candidate by parts.
fn part_order(pairs: &[VisiblePair], parts: usize) -> Vec<u32> {
    let first_part = |(parts, _): &VisiblePair| parts[0].0;
    let first: Vec<u32> = pairs.par_iter().with_min_len(PAR_MIN_LEN).map(first_part).collect();
    group_by_key(&first, parts).0
}

/// Values of the last step for each of the pairs; `order` and `old_values` are in the order of the parts.
fn previous_values<T: Clone + Default>(
    pairs: &[VisiblePair],
    order: &[u32],
    old_values: impl Iterator<Item = ([PartId; 2], T)>,
) -> Vec<T> {
    let mut values = vec![T::default(); pairs.len()];
    let mut old_values = old_values.peekable();
    for &k in order {
        let parts = &pairs[k as usize].0;
        while old_values.next_if(|(old, _)| old < parts).is_some() {}
        if let Some((_, old)) = old_values.next_if(|(old, _)| old == parts) {
            values[k as usize] = old;
        }
    }
    values
}

/// Calls `record` with the result for a pair, points relative to the candidate's centre; for polyhedra the call may be
/// deferred.
fn narrow_phase_pair<'a>(
    pair: CandidatePair<'a>,
    narrow: NarrowPhaseMode,
    memory: &CachedFeature,
    hint: Option<[f32; 3]>,
    polyhedra: &mut PairBatch<'a, CandidatePair<'a>>,
    record: &mut impl FnMut(CandidatePair<'a>, PairResult),
) {
    let CandidatePair { a, b, c, range, .. } = pair;
    let one_point = |found: narrow::ContactGeometry| point_manifold(&found, 0);
    let zero = Vec3::zeros();
    if let PosedShape::Mesh(mesh) = &b.shape {
        match surface_manifolds(&pair, mesh) {
            WallContacts::Listed(found) => {
                found.iter().for_each(|manifold| record(pair, Ok((CachedFeature::default(), manifold))));
            }
            WallContacts::Apart { min_gap } => record(pair, Err(Separated { n: Vec3::z(), s: min_gap })),
        }
        return;
    }
    let found: SmallVec<[Manifold; 1]> = match (&a.shape, &b.shape) {
        // A plate is a cuboid.
        (PosedShape::Polyhedron(p), PosedShape::Polyhedron(q) | PosedShape::Plane { cuboid: q, .. }) => {
            let hint = hint.map(|n| Vec3::from(n.map(f64::from)));
            let request = PairRequest { shapes: [p, q], centre_offset: c, range, narrow, memory: *memory, hint };
            return polyhedra.push_pair(pair, request, record);
        }
        (PosedShape::Sphere { radius: r }, PosedShape::Sphere { radius: s }) => {
            [one_point(narrow::sphere_sphere(&zero, *r, &c, *s))].into_iter().collect()
        }
        (PosedShape::Sphere { radius }, PosedShape::Plane { half_lengths, .. }) => {
            [one_point(narrow::sphere_plane(&zero, *radius, &c, &b.axes, half_lengths))].into_iter().collect()
        }
        (PosedShape::Sphere { radius }, PosedShape::Polyhedron(q)) => {
            let found = polyhedron_sphere(q, &-c, *radius, range.alert);
            found.map(|found| swapped_manifold(&found, &c)).into_iter().collect()
        }
        (PosedShape::Sphere { radius: r }, PosedShape::Cylinder { half_height, radius, hollow }) => {
            let found = narrow::sphere_cylinder(&zero, *r, &c, &b.axes, [*half_height, *radius], *hollow);
            let near = found.into_iter().flatten().map(one_point);
            let displacement = if *hollow { a.travel + b.travel } else { 0.0 };
            let far = far_walls(&zero, *r, 0, (&c, &b.axes), [*half_height, *radius], displacement);
            near.chain(far).collect()
        }
        (PosedShape::Polyhedron(p), PosedShape::Cylinder { half_height, radius, hollow: true }) => {
            let mut found = polyhedron_hollow_cylinder(p, &c, &b.axes, [*half_height, *radius], range.alert);
            let travel = a.travel + b.travel;
            found.extend(vertices_at_far_walls(p, &c, &b.axes, [*half_height, *radius], travel));
            found.into_iter().collect()
        }
        (PosedShape::Polyhedron(p), PosedShape::Cylinder { half_height, radius, hollow: false }) => {
            polyhedron_cylinder(p, &c, &b.axes, [*half_height, *radius], range).into_iter().collect()
        }
        (PosedShape::Cylinder { half_height, radius, hollow: false }, PosedShape::Plane { cuboid: q, .. }) => {
            let found = polyhedron_cylinder(q, &-c, &a.axes, [*half_height, *radius], range);
            found.map(|found| swapped_manifold(&found, &c)).into_iter().collect()
        }
        (
            PosedShape::Cylinder { half_height: h, radius: r, hollow: false },
            PosedShape::Cylinder { half_height, radius, hollow: false },
        ) => cylinder_cylinder(&a.axes, [*h, *r], &c, &b.axes, [*half_height, *radius], range).into_iter().collect(),
        (
            PosedShape::Cylinder { half_height: h, radius: r, hollow: false },
            PosedShape::Cylinder { half_height, radius, hollow: true },
        ) => {
            let (size, hollow_size, travel) = ([*h, *r], [*half_height, *radius], a.travel + b.travel);
            let mut found = cylinder_hollow_cylinder(&a.axes, size, &c, &b.axes, hollow_size, range.alert);
            found.extend(rims_at_far_walls(&a.axes, size, (&c, &b.axes), hollow_size, travel));
            found.into_iter().collect()
        }
        (PosedShape::Sphere { radius: r }, PosedShape::Capsule { half_length, radius }) => {
            let (nearest, feature) = nearest_of_segment(&c, &b.axes, *half_length);
            let found = narrow::sphere_sphere(&zero, *r, &nearest, *radius);
            [one_point(narrow::ContactGeometry { feature, ..found })].into_iter().collect()
        }
        (PosedShape::Capsule { half_length, radius }, _) => capsule_manifolds(pair, [*half_length, *radius]),
        // Not computed, and rejected on input if one can move: two plates, and a hollow cylinder with a plate or another
        // one.
        _ => SmallVec::new(),
    };
    let nearest = found.iter().min_by(|a, b| a.gap().total_cmp(&b.gap()));
    if let Some(nearest) = nearest.filter(|nearest| nearest.gap() > range.alert) {
        return record(pair, Err(Separated { n: -nearest.normal, s: nearest.gap() }));
    }
    for manifold in &found {
        record(pair, Ok((CachedFeature::default(), manifold)));
    }
}

/// Calls `record` with the contacts of a sphere with a surface, the `parts`.
fn sphere_on_surface<'a>(
    pair: CandidatePair<'a>,
    radius: f64,
    mesh: &WallMesh,
    (near, parts): (&mut NearSurfaces, &[PartId; 2]),
    record: &mut impl FnMut(CandidatePair<'a>, PairResult),
) {
    let CandidatePair { b, c, range, .. } = pair;
    match narrow::sphere_mesh(mesh, near.triangles_of(parts), radius, (&c, &b.axes), range.alert) {
        WallContacts::Listed(found) => found.iter().for_each(|point| {
            record(pair, Ok((CachedFeature::default(), &point_manifold(point, 0))));
        }),
        WallContacts::Apart { min_gap } => {
            near.remove_triangles(parts);
            record(pair, Err(Separated { n: Vec3::z(), s: min_gap }));
        }
    }
}

/// Contacts of a contactor that is no sphere with a surface.
fn surface_manifolds(pair: &CandidatePair, mesh: &WallMesh) -> WallContacts<Manifold> {
    let &CandidatePair { a, b, c, range, .. } = pair;
    match &a.shape {
        PosedShape::Polyhedron(p) => polyhedron_mesh(p, mesh, &c, &b.axes, range),
        PosedShape::Cylinder { half_height, radius, hollow: false } => {
            cylinder_mesh(&a.axes, [*half_height, *radius], mesh, &c, &b.axes, range)
        }
        PosedShape::Capsule { half_length, radius } => {
            capsule_mesh(&a.axes, [*half_length, *radius], mesh, &c, &b.axes, range)
        }
        // Pairs with plates, hollow cylinders and other surfaces are rejected on input if one can move.
        _ => WallContacts::Listed(SmallVec::new()),
    }
}

/// Manifold of one point; `feature`: that of the candidate.
fn point_manifold(found: &narrow::ContactGeometry, feature: u32) -> Manifold {
    let point = ContactPoint { position: found.point, gap: found.gap, features: (feature, found.feature) };
    Manifold { normal: found.normal, points: std::iter::once(point).collect(), area: 0.0 }
}

/// Manifolds of a capsule of `[half length, radius]` (m) and another contactor that is no sphere.
fn capsule_manifolds(pair: CandidatePair, size: [f64; 2]) -> SmallVec<[Manifold; 1]> {
    let CandidatePair { a, b, c, range, .. } = pair;
    match &b.shape {
        PosedShape::Capsule { half_length, radius } => {
            capsule_capsule(&a.axes, size, &c, &b.axes, [*half_length, *radius], range).into_iter().collect()
        }
        PosedShape::Polyhedron(q) | PosedShape::Plane { cuboid: q, .. } => {
            let found = polyhedron_capsule(q, &-c, &a.axes, size, range);
            found.map(|found| swapped_manifold(&found, &c)).into_iter().collect()
        }
        PosedShape::Cylinder { half_height, radius, hollow: false } => {
            capsule_cylinder(&a.axes, size, &c, &b.axes, [*half_height, *radius], range).into_iter().collect()
        }
        // The inside is convex: only the ends touch it.
        PosedShape::Cylinder { half_height, radius, hollow: true } => {
            let hollow_size = [*half_height, *radius];
            let end_manifolds = |(end, feature): (Vec3, u32)| {
                let found = narrow::sphere_cylinder(&end, size[1], &c, &b.axes, hollow_size, true);
                let near = found.into_iter().flatten().map(move |found| point_manifold(&found, feature));
                near.chain(far_walls(&end, size[1], feature, (&c, &b.axes), hollow_size, a.travel + b.travel))
            };
            segment_ends(&a.axes, size[0]).into_iter().flat_map(end_manifolds).collect()
        }
        // Spheres are candidates; surfaces have contacts of their own.
        PosedShape::Mesh(_) | PosedShape::Sphere { .. } => SmallVec::new(),
    }
}
