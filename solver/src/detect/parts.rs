//! Contacts between contactors of any shape: a broad phase on bounding balls, then the narrow phase of each pair.

use std::sync::Arc;

use rayon::prelude::*;
use smallvec::SmallVec;

use cd_formats::compute::NarrowPhase;

use super::neighbours::BoundingBalls;
use super::posed::{CandidatePair, PosedContactor, PosedShape, posed_contactors};
use super::swept::SweptBall;
use super::travel::TravelBounds;
use super::{joints, narrow, periodic};
use crate::activity;
use crate::geometry::{
    CachedFeature, ContactPoint, Manifold, NarrowPhaseMode, PairBatch, PairResult, Separated, polyhedron_cylinder,
    polyhedron_hollow_cylinder, polyhedron_sphere,
};
use crate::integrate::ContactConfiguration;
use crate::math::simd::SimdWidth;
use crate::math::{Vec3, group_by_key};
use crate::scene::{BodyId, PartId, Scene};
use crate::state::{Contact, DetectionCache, SeparatingAxis, VisiblePair};

impl DetectionCache {
    /// `bodies`: order in which near bodies follow each other.
    fn rebuild_if_stale(&mut self, scene: &Scene, places: &mut [PosedContactor], bodies: &[u32]) {
        if self.last.len() != places.len() {
            *self = DetectionCache {
                accumulated_travel: vec![0.0; places.len()],
                restored_pairs: self.cached_pairs(),
                ..DetectionCache::default()
            };
            self.last = places.iter().map(|place| (place.centre, place.axes)).collect();
        }
        let known = self.last.iter_mut().zip(&mut self.accumulated_travel);
        for ((place, part), ((x, q), moved)) in places.iter_mut().zip(&scene.parts).zip(known) {
            // Twice the sine of half an angle is less than four times that of a quarter.
            let turned = (place.axes.coords - q.coords).norm().min((place.axes.coords + q.coords).norm());
            *moved += (place.centre - *x).norm() + 2.0 * part.radius * turned;
            (*x, *q, place.accumulated_travel) = (place.centre, place.axes, *moved);
        }
        let centres: Vec<Vec3> = places.iter().map(|place| place.centre).collect();
        let reach: Vec<f64> = places.iter().map(|place| place.reach).collect();
        let travel: Vec<f64> = places.iter().map(|place| place.travel).collect();
        let path = |k: usize| places[k].path;
        let things = BoundingBalls { centres: &centres, reach: &reach, path, travel: &travel };
        if !self.neighbours.rebuild_if_stale(&things, scene.periods(), scene.mean_radius) {
            return;
        }
        let before = self.cached_pairs();
        let apart = |&k: &u32| (self.pairs[k as usize].0, self.separations[k as usize]);
        let near = std::mem::take(&mut self.neighbours.pairs);
        let near: Vec<VisiblePair> =
            near.into_par_iter().with_min_len(1024).filter_map(|ij| visible_pair(scene, places, ij)).collect();
        let pairs = pairs_by_candidate(&near, scene, bodies);
        let order = part_order(&pairs, places.len());
        self.separations = previous_values(&pairs, &order, self.order.iter().map(apart));
        self.memories = previous_values(&pairs, &order, before.into_iter().map(|pair| (pair.parts, pair.memory)));
        (self.pairs, self.order, self.restored_pairs) = (Arc::new(pairs), Arc::new(order), Vec::new());
    }
}

impl DetectionCache {
    /// Removes the cached direction of two contactors, so that the next step searches it anew.
    fn forget_feature(&mut self, parts: &[PartId; 2]) {
        if let Ok(place) = self.order.binary_search_by_key(parts, |&k| self.pairs[k as usize].0) {
            self.memories[self.order[place] as usize] = CachedFeature::default();
        }
    }
}

/// Returns the contacts without inner contacts.
pub fn without_inner_edges(
    scene: &Scene,
    q_c: &ContactConfiguration,
    ways: &TravelBounds,
    mut contacts: Vec<Contact>,
) -> Vec<Contact> {
    let places = posed_contactors(scene, q_c, ways);
    joints::remove_inner_edges(scene, q_c, ways, &places, &mut contacts);
    contacts
}

/// All listed contacts, ordered by key.
pub fn listed_contacts(
    scene: &Scene,
    q_c: &ContactConfiguration,
    ways: &TravelBounds,
    narrow: NarrowPhase,
    known: &mut DetectionCache,
) -> Vec<Contact> {
    let mut places = posed_contactors(scene, q_c, ways);
    let nearby = ways.nearby;
    known.rebuild_if_stale(scene, &mut places, &q_c.order);
    let DetectionCache { pairs, memories, separations, .. } = known;
    let narrow = match narrow {
        NarrowPhase::Fast => NarrowPhaseMode::Fast,
        NarrowPhase::Accurate => NarrowPhaseMode::Accurate,
    };
    let width = SimdWidth::detect();
    let chunks = pairs
        .par_chunks(PAIRS_PER_TASK)
        .zip(memories.par_chunks_mut(PAIRS_PER_TASK))
        .zip(separations.par_chunks_mut(PAIRS_PER_TASK));
    let chunks = chunks.map(|((pairs, memories), separations)| PairChunk { pairs, memories, separations });
    let hands = || NarrowPhaseScratch { polyhedra: PairBatch::new(width), prefetcher: Prefetcher::new(&places, width) };
    let found: Vec<ListedContacts> = chunks
        .map_init(hands, |hands, chunk| narrow_phase_chunk(scene, &places, nearby, narrow, hands, chunk))
        .collect();
    let mut contacts = contacts_by_key(&found, scene.bodies.len(), width);
    let inner = joints::remove_inner_edges(scene, q_c, ways, &places, &mut contacts);
    inner.iter().for_each(|parts| known.forget_feature(parts));
    contacts
}

/// Contacts of pairs that these displacements bring near each other; at least one body of each pair is `searched`.
pub fn swept_contacts(
    scene: &Scene,
    q_c: &ContactConfiguration,
    ways: &TravelBounds,
    narrow: NarrowPhaseMode,
    searched: impl Fn(BodyId) -> bool + Sync,
) -> Vec<Contact> {
    let places = posed_contactors(scene, q_c, ways);
    let ball = |place: &PosedContactor| SweptBall {
        centre: place.centre,
        path: place.path,
        reach: place.radius + place.bend,
        searched: searched(place.body),
    };
    let balls: Vec<SweptBall> = places.iter().map(ball).collect();
    let reach: Vec<f64> = places.iter().map(|place| place.reach).collect();
    let near = periodic::periodic_swept_pairs(&balls, &reach, scene.periods());
    let mut pairs: Vec<VisiblePair> = near.into_iter().filter_map(|ij| visible_pair(scene, &places, ij)).collect();
    pairs.sort_unstable_by_key(|(parts, _)| *parts);
    let width = SimdWidth::detect();
    let mut hands =
        NarrowPhaseScratch { polyhedra: PairBatch::new(width), prefetcher: Prefetcher::new(&places, width) };
    let look_at = |pairs: &[VisiblePair]| {
        let (mut memories, mut separations) =
            ([CachedFeature::default(); PAIRS_PER_TASK], [SeparatingAxis::default(); PAIRS_PER_TASK]);
        let (memories, separations) = (&mut memories[..pairs.len()], &mut separations[..pairs.len()]);
        narrow_phase_chunk(scene, &places, ways.nearby, narrow, &mut hands, PairChunk { pairs, memories, separations })
    };
    let found: Vec<ListedContacts> = pairs.chunks(PAIRS_PER_TASK).map(look_at).collect();
    contacts_by_key(&found, scene.bodies.len(), width)
}

/// Pairs of one task with their cached data.
struct PairChunk<'p> {
    pairs: &'p [VisiblePair],
    memories: &'p mut [CachedFeature],
    separations: &'p mut [SeparatingAxis],
}

/// Pairs per task.
const PAIRS_PER_TASK: usize = 256;

/// Scratch memory for the narrow phase, reused from task to task.
struct NarrowPhaseScratch<'a> {
    polyhedra: PairBatch<'a, CandidatePair<'a>>,
    prefetcher: Prefetcher<'a>,
}

/// Applies the narrow phase to the pairs that are not known to be apart.
fn narrow_phase_chunk<'a>(
    scene: &Scene,
    places: &'a [PosedContactor<'a>],
    nearby: f64,
    narrow: NarrowPhaseMode,
    hands: &mut NarrowPhaseScratch<'a>,
    chunk: PairChunk,
) -> ListedContacts {
    let PairChunk { pairs, memories, separations } = chunk;
    if activity::is_stopped() {
        return ListedContacts::new(0, scene.periods());
    }
    let (mut near, mut count) = ([0; PAIRS_PER_TASK], 0);
    for (k, separation) in separations.iter().enumerate() {
        near[count] = k;
        count += usize::from(separation.valid_travel <= CandidatePair::listing_reach(scene, places, nearby, &pairs[k]));
    }
    let near = &near[..count];
    let NarrowPhaseScratch { polyhedra, prefetcher: ahead } = hands;
    near.iter().take(PREFETCH_DISTANCE).for_each(|&k| ahead.prefetch(pairs[k].0));
    let mut listed = ListedContacts::new(count, scene.periods());
    for (place, &k) in near.iter().enumerate() {
        if let Some(&later) = near.get(place + PREFETCH_DISTANCE) {
            ahead.prefetch(pairs[later].0);
        }
        let meeting = CandidatePair::new(scene, places, nearby, k, &pairs[k]);
        // Trajectories that pass each other shorten the range.
        if separations[k].valid_travel > meeting.accumulated_travel() + meeting.range.alert {
            continue;
        }
        let (memory, separation) = (std::mem::take(&mut memories[k]), std::mem::take(&mut separations[k]));
        if meeting.is_near() {
            let hint = separation.n.filter(|_| memory == CachedFeature::default());
            narrow_phase_pair(meeting, narrow, &memory, hint, polyhedra, &mut |meeting, sight| {
                listed.record_result(&meeting, sight, memories, separations);
            });
        }
    }
    polyhedra.flush(&mut |meeting, sight| listed.record_result(&meeting, sight, memories, separations));
    listed
}

/// Contacts that a task has found.
struct ListedContacts {
    contacts: Vec<Contact>,
    /// Candidates of consecutive contacts, and the index where each run begins.
    runs: Vec<(BodyId, usize)>,
    /// Periods of the scene, m.
    periods: [Option<f64>; 2],
}

/// Relative margin on the balls' radii for the rounding of distances.
const ROUNDING_MARGIN: f64 = 1e-9;

impl ListedContacts {
    fn new(pairs: usize, periods: [Option<f64>; 2]) -> Self {
        ListedContacts { contacts: Vec::with_capacity(4 * pairs), runs: Vec::new(), periods }
    }

    /// Adds the contacts of a pair: points up to its range; points on its area share the area. Keeps the pair's cache
    /// entries.
    fn record_result(
        &mut self,
        meeting: &CandidatePair,
        sight: PairResult,
        memories: &mut [CachedFeature],
        separations: &mut [SeparatingAxis],
    ) {
        let CandidatePair { pair, a, b, c, .. } = meeting;
        let manifold = match sight {
            Ok((memory, manifold)) => {
                memories[*pair] = memory;
                manifold
            }
            Err(Separated { n, s }) => {
                // No separation is known of another image; an image is nearest only up to half a period.
                let of_image =
                    self.periods.iter().zip(c.as_slice()).filter_map(|(period, c)| Some((*period)? / 2.0 - c.abs()));
                let until =
                    of_image.fold(s, f64::min) + meeting.accumulated_travel() - ROUNDING_MARGIN * (a.reach + b.reach);
                separations[*pair] = SeparatingAxis { n: Some([n.x, n.y, n.z].map(|x| x as f32)), valid_travel: until };
                return;
            }
        };
        if self.runs.last().is_none_or(|(candidate, _)| *candidate != a.body) {
            self.runs.push((a.body, self.contacts.len()));
        }
        self.contacts.extend(meeting.listed_contacts(manifold));
    }

    /// Contacts from the beginning of a run to that of the next.
    fn run_contacts(&self, k: usize) -> &[Contact] {
        let end = self.runs.get(k + 1).map_or(self.contacts.len(), |(_, start)| *start);
        &self.contacts[self.runs[k].1..end]
    }
}

/// All contacts, ordered by key.
fn contacts_by_key(found: &[ListedContacts], bodies: usize, width: SimdWidth) -> Vec<Contact> {
    let runs: Vec<(&ListedContacts, usize)> =
        found.iter().flat_map(|listed| (0..listed.runs.len()).map(move |k| (listed, k))).collect();
    let candidates: Vec<u32> = runs.iter().map(|(listed, k)| listed.runs[*k].0.0).collect();
    let (order, _) = group_by_key(&candidates, bodies);
    let run = |k: u32| {
        let (listed, k) = runs[k as usize];
        listed.run_contacts(k)
    };
    let mut contacts = Vec::with_capacity(found.iter().map(|listed| listed.contacts.len()).sum());
    for (place, &k) in order.iter().enumerate() {
        if let Some(&later) = order.get(place + 1) {
            width.prefetch(run(later));
        }
        contacts.extend_from_slice(run(k));
    }
    // The contacts of one candidate may come from several tasks or several parts.
    for of_one in contacts.chunk_by_mut(|a, b| a.candidate == b.candidate) {
        if !of_one.is_sorted_by_key(Contact::key) {
            of_one.sort_unstable_by_key(Contact::key);
        }
    }
    contacts
}

/// Number of pairs by which the prefetch is ahead: a few microseconds, and less than the L1 cache contains.
const PREFETCH_DISTANCE: usize = 16;

/// Prefetches the data of pairs: with many bodies it comes from main memory in every step, while other pairs are
/// processed.
struct Prefetcher<'a> {
    places: &'a [PosedContactor<'a>],
    width: SimdWidth,
    /// Parts that were prefetched recently, each at the index of its number modulo the length.
    near: [PartId; SHAPES_IN_L2],
}

/// Approximate number of shapes that fit in the L2 cache.
const SHAPES_IN_L2: usize = 256;

impl<'a> Prefetcher<'a> {
    fn new(places: &'a [PosedContactor<'a>], width: SimdWidth) -> Self {
        Prefetcher { places, width, near: [PartId(u32::MAX); SHAPES_IN_L2] }
    }

    #[inline(always)]
    fn prefetch(&mut self, parts: [PartId; 2]) {
        for part in parts {
            let last = &mut self.near[part.index() % SHAPES_IN_L2];
            if *last != part
                && let PosedShape::Polyhedron(posed) = &self.places[part.index()].shape
            {
                *last = part;
                posed.prefetch(self.width);
            }
        }
    }
}

/// The two contactors with the candidate first, and their visibility rule; `None` if the table has no rule, if
/// both are of one body, or if the motion of both is imposed.
fn visible_pair(scene: &Scene, places: &[PosedContactor], pair: [u32; 2]) -> Option<VisiblePair> {
    let [i, j] = pair.map(PartId);
    let [a, b] = [i, j].map(|part| &places[part.index()]);
    if a.body == b.body || (a.imposed && b.imposed) {
        return None;
    }
    let see = scene.visibility.interaction_rule(a.class, b.class)?;
    let first = scene.candidate_order(a.body, a.rank) <= scene.candidate_order(b.body, b.rank);
    Some((if first { [i, j] } else { [j, i] }, see))
}

/// Pairs ordered by candidate, in the order of the bodies, then by antagonist.
fn pairs_by_candidate(pairs: &[VisiblePair], scene: &Scene, bodies: &[u32]) -> Vec<VisiblePair> {
    let mut place = vec![0; bodies.len()];
    bodies.iter().zip(0..).for_each(|(&i, k)| place[i as usize] = k);
    let of_pairs: Vec<u32> = pairs.iter().map(|(parts, _)| place[scene.parts[parts[0].index()].body.index()]).collect();
    let (order, starts) = group_by_key(&of_pairs, bodies.len());
    let mut grouped: Vec<VisiblePair> = order.iter().map(|&k| pairs[k as usize]).collect();
    for of_one in starts.windows(2) {
        grouped[of_one[0] as usize..of_one[1] as usize].sort_unstable_by_key(|(parts, _)| *parts);
    }
    grouped
}

/// Indices of the pairs, which are ordered by candidate, in the order of their parts.
fn part_order(pairs: &[VisiblePair], parts: usize) -> Vec<u32> {
    let first: Vec<u32> = pairs.iter().map(|(parts, _)| parts[0].0).collect();
    group_by_key(&first, parts).0
}

/// Values of the last step for each of the pairs; `order` and `before` are in the order of the parts.
fn previous_values<T: Clone + Default>(
    pairs: &[VisiblePair],
    order: &[u32],
    before: impl Iterator<Item = ([PartId; 2], T)>,
) -> Vec<T> {
    let mut carried = vec![T::default(); pairs.len()];
    let mut before = before.peekable();
    for &k in order {
        let parts = &pairs[k as usize].0;
        while before.next_if(|(old, _)| old < parts).is_some() {}
        if let Some((_, old)) = before.next_if(|(old, _)| old == parts) {
            carried[k as usize] = old;
        }
    }
    carried
}

/// Calls `take` with the result for a pair, points relative to the candidate's centre; for polyhedra the call may be
/// deferred.
fn narrow_phase_pair<'a>(
    meeting: CandidatePair<'a>,
    narrow: NarrowPhaseMode,
    memory: &CachedFeature,
    hint: Option<[f32; 3]>,
    polyhedra: &mut PairBatch<'a, CandidatePair<'a>>,
    take: &mut impl FnMut(CandidatePair<'a>, PairResult),
) {
    let CandidatePair { a, b, c, range, .. } = meeting;
    let one = |found: narrow::ContactGeometry| {
        let point = ContactPoint { position: found.point, gap: found.gap, features: (0, found.feature) };
        Manifold { normal: found.normal, points: std::iter::once(point).collect(), area: 0.0 }
    };
    let zero = Vec3::zeros();
    let found: SmallVec<[Manifold; 1]> = match (&a.shape, &b.shape) {
        // A plate is a cuboid.
        (PosedShape::Polyhedron(p), PosedShape::Polyhedron(q) | PosedShape::Plane { cuboid: q, .. }) => {
            let hint = hint.map(|n| Vec3::from(n.map(f64::from)));
            return polyhedra.push_pair(meeting, [p, q], &c, range, narrow, memory, hint, take);
        }
        (PosedShape::Sphere { radius: r }, PosedShape::Sphere { radius: s }) => {
            [one(narrow::sphere_sphere(&zero, *r, &c, *s))].into_iter().collect()
        }
        (PosedShape::Sphere { radius }, PosedShape::Plane { half_lengths, .. }) => {
            [one(narrow::sphere_plane(&zero, *radius, &c, &b.axes, half_lengths))].into_iter().collect()
        }
        (PosedShape::Sphere { radius }, PosedShape::Polyhedron(q)) => {
            let found = polyhedron_sphere(q, &-c, *radius, range.alert);
            found.map(|found| swapped_manifold(&found, &c)).into_iter().collect()
        }
        (PosedShape::Sphere { radius: r }, PosedShape::Cylinder { half_height, radius, hollow }) => {
            let found = narrow::sphere_cylinder(&zero, *r, &c, &b.axes, [*half_height, *radius], *hollow);
            found.into_iter().flatten().map(one).collect()
        }
        (PosedShape::Polyhedron(p), PosedShape::Cylinder { half_height, radius, hollow: true }) => {
            polyhedron_hollow_cylinder(p, &c, &b.axes, [*half_height, *radius], range.alert).into_iter().collect()
        }
        (PosedShape::Polyhedron(p), PosedShape::Cylinder { half_height, radius, hollow: false }) => {
            polyhedron_cylinder(p, &c, &b.axes, [*half_height, *radius], range).into_iter().collect()
        }
        // Rows between cylinders and plates of which one moves freely along some axis are rejected on input.
        _ => SmallVec::new(),
    };
    let nearest = found.iter().min_by(|a, b| a.gap().total_cmp(&b.gap()));
    if let Some(nearest) = nearest.filter(|nearest| nearest.gap() > range.alert) {
        return take(meeting, Err(Separated { n: -nearest.normal, s: nearest.gap() }));
    }
    for manifold in &found {
        take(meeting, Ok((CachedFeature::default(), manifold)));
    }
}

/// Manifold of a polyhedron and a sphere at -`c` with the sides exchanged, so that the sphere is the candidate.
fn swapped_manifold(found: &Manifold, c: &Vec3) -> Manifold {
    let turned = |point: &ContactPoint| ContactPoint {
        position: point.position + c,
        gap: point.gap,
        features: (point.features.1, point.features.0),
    };
    Manifold { normal: -found.normal, points: found.points.iter().map(turned).collect(), area: found.area }
}
