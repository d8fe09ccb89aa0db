//! Contacts between contactors of any shapes: balls about them in cells, then the geometry of each pair.

use rayon::prelude::*;
use smallvec::SmallVec;

use cd_formats::compute::NarrowPhase;

use crate::activity;
use crate::detect::neighbours::Things;
use crate::detect::swept::Moving;
use crate::detect::{MARGIN, Ways, joints, narrow, periodic, swept};
use crate::geometry::{
    Apart, Manifold, Memory, Narrow, Point, Posed, Range, Sight, Together, polyhedron_cylinder,
    polyhedron_hollow_cylinder, polyhedron_sphere,
};
use crate::integrate::Configuration;
use crate::math::lanes::SimdWidth;
use crate::math::{Quat, Vec3, group_by_key};
use crate::scene::{Geometry, Part, Scene, See};
use crate::state::{Contact, Known, Separation};

/// Where a contactor is, and what of the scene each pair asks for: so that a pair reads little memory.
pub(super) struct Place<'a> {
    pub centre: Vec3,
    pub axes: Quat,
    /// How far a point of it can get in the step, m.
    pub travel: f64,
    /// Of the ball about it, with what it can travel and half of what is listed, m.
    reach: f64,
    /// Displacement of the centre in the step, m, and rotation, rad.
    path: Vec3,
    turn: Vec3,
    /// Largest distance from the centre of what a rotation moves, m: 0 for a sphere.
    rim: f64,
    /// Of the ball about it, m.
    pub radius: f64,
    /// By how much the way of the centre, as the body turns, is not straight, m.
    bend: f64,
    /// How far its surface has moved in all, m.
    moved: f64,
    /// As cohesion knows it, 1/m.
    curvature: f64,
    pub body: u32,
    /// Row and column in the visibility table.
    pub class: u16,
    /// Whether all of its body's motion is imposed.
    imposed: bool,
    /// Place among the contactors of its body.
    rank: u16,
    pub shape: Shape<'a>,
}

pub(super) enum Shape<'a> {
    Sphere { radius: f64 },
    Polyhedron(Posed<'a>),
    Cylinder { half_height: f64, radius: f64, hollow: bool },
    Plane { half_lengths: Vec3, cuboid: Posed<'a> },
}

impl Known {
    /// `bodies`: in an order in which near ones follow each other.
    fn renew(&mut self, scene: &Scene, places: &mut [Place], bodies: &[u32]) {
        if self.last.len() != places.len() {
            *self = Known { moved: vec![0.0; places.len()], read: self.kept(), ..Known::default() };
            self.last = places.iter().map(|place| (place.centre, place.axes)).collect();
        }
        let known = self.last.iter_mut().zip(&mut self.moved);
        for ((place, part), ((x, q), moved)) in places.iter_mut().zip(&scene.parts).zip(known) {
            // Twice the sine of half an angle is less than four times that of a quarter.
            let turned = (place.axes.coords - q.coords).norm().min((place.axes.coords + q.coords).norm());
            *moved += (place.centre - *x).norm() + 2.0 * part.radius * turned;
            (*x, *q, place.moved) = (place.centre, place.axes, *moved);
        }
        let centres: Vec<Vec3> = places.iter().map(|place| place.centre).collect();
        let reach: Vec<f64> = places.iter().map(|place| place.reach).collect();
        let travel: Vec<f64> = places.iter().map(|place| place.travel).collect();
        let path = |k: usize| places[k].path;
        let things = Things { centres: &centres, reach: &reach, path, travel: &travel };
        if !self.neighbours.renew(&things, scene.periods(), scene.mean_radius) {
            return;
        }
        let before = self.kept();
        let apart = |&k: &u32| (self.pairs[k as usize].0, self.separations[k as usize]);
        let near = std::mem::take(&mut self.neighbours.pairs);
        let near: Vec<([u32; 2], See)> =
            near.into_par_iter().with_min_len(1024).filter_map(|ij| meet(scene, places, ij)).collect();
        let pairs = by_candidates(&near, scene, bodies);
        let order = by_parts(&pairs, places.len());
        self.separations = carried(&pairs, &order, self.order.iter().map(apart));
        self.memories = carried(&pairs, &order, before.into_iter().map(|pair| (pair.parts, pair.memory)));
        (self.pairs, self.order, self.read) = (pairs, order, Vec::new());
    }
}

impl Known {
    /// Forgets the direction in which two contactors met, so that the next step searches for it anew.
    fn forget(&mut self, parts: &[u32; 2]) {
        if let Ok(place) = self.order.binary_search_by_key(parts, |&k| self.pairs[k as usize].0) {
            self.memories[self.order[place] as usize] = Memory::default();
        }
    }
}

/// Those of the contacts that are no inner ones.
pub fn without_inner_edges(
    scene: &Scene,
    q_c: &Configuration,
    ways: &Ways,
    mut contacts: Vec<Contact>,
) -> Vec<Contact> {
    let places: Vec<Place> =
        scene.parts.par_iter().with_min_len(64).map(|part| place(scene, part, q_c, ways)).collect();
    joints::remove_inner_edges(scene, q_c, ways, &places, &mut contacts);
    contacts
}

/// All listed contacts in the order of their keys.
pub fn contacts(
    scene: &Scene,
    q_c: &Configuration,
    ways: &Ways,
    narrow: NarrowPhase,
    known: &mut Known,
) -> Vec<Contact> {
    let mut places: Vec<Place> =
        scene.parts.par_iter().with_min_len(64).map(|part| place(scene, part, q_c, ways)).collect();
    let nearby = ways.nearby;
    known.renew(scene, &mut places, &q_c.order);
    let Known { pairs, memories, separations, .. } = known;
    let narrow = match narrow {
        NarrowPhase::Fast => Narrow::Fast,
        NarrowPhase::Accurate => Narrow::Accurate,
    };
    let width = SimdWidth::detect();
    let chunks = pairs.par_chunks(CHUNK).zip(memories.par_chunks_mut(CHUNK)).zip(separations.par_chunks_mut(CHUNK));
    let chunks = chunks.map(|((pairs, memories), separations)| Chunk { pairs, memories, separations });
    let hands = || Hands { polyhedra: Together::new(width), ahead: Ahead::new(&places, width) };
    let found: Vec<Listed> =
        chunks.map_init(hands, |hands, chunk| look(scene, &places, nearby, narrow, hands, chunk)).collect();
    let mut contacts = sorted(&found, scene.bodies.len(), width);
    let inner = joints::remove_inner_edges(scene, q_c, ways, &places, &mut contacts);
    inner.iter().for_each(|parts| known.forget(parts));
    contacts
}

/// Contacts of pairs that come near each other by these displacements, of bodies of which at least one is `searched`.
pub fn near_paths(
    scene: &Scene,
    q_c: &Configuration,
    ways: &Ways,
    narrow: Narrow,
    searched: impl Fn(u32) -> bool + Sync,
) -> Vec<Contact> {
    let places: Vec<Place> =
        scene.parts.par_iter().with_min_len(64).map(|part| place(scene, part, q_c, ways)).collect();
    let ball = |place: &Place| Moving {
        centre: place.centre,
        path: place.path,
        reach: place.radius + place.bend,
        searched: searched(place.body),
    };
    let balls: Vec<Moving> = places.iter().map(ball).collect();
    let reach: Vec<f64> = places.iter().map(|place| place.reach).collect();
    let near = periodic::pairs_swept(&balls, &reach, scene.periods());
    let mut pairs: Vec<([u32; 2], See)> = near.into_iter().filter_map(|ij| meet(scene, &places, ij)).collect();
    pairs.sort_unstable_by_key(|(parts, _)| *parts);
    let width = SimdWidth::detect();
    let mut hands = Hands { polyhedra: Together::new(width), ahead: Ahead::new(&places, width) };
    let look_at = |pairs: &[([u32; 2], See)]| {
        let (mut memories, mut separations) = ([Memory::default(); CHUNK], [Separation::default(); CHUNK]);
        let (memories, separations) = (&mut memories[..pairs.len()], &mut separations[..pairs.len()]);
        look(scene, &places, ways.nearby, narrow, &mut hands, Chunk { pairs, memories, separations })
    };
    let found: Vec<Listed> = pairs.chunks(CHUNK).map(look_at).collect();
    sorted(&found, scene.bodies.len(), width)
}

/// Pairs that one task looks at, and what is known of them.
struct Chunk<'p> {
    pairs: &'p [([u32; 2], See)],
    memories: &'p mut [Memory],
    separations: &'p mut [Separation],
}

/// So many.
const CHUNK: usize = 256;

/// With what pairs are looked at, one task after the other.
struct Hands<'a> {
    polyhedra: Together<'a, Meeting<'a>>,
    ahead: Ahead<'a>,
}

/// Looks at those pairs that are not known to be apart.
fn look<'a>(
    scene: &Scene,
    places: &'a [Place<'a>],
    nearby: f64,
    narrow: Narrow,
    hands: &mut Hands<'a>,
    chunk: Chunk,
) -> Listed {
    let Chunk { pairs, memories, separations } = chunk;
    if activity::is_stopped() {
        return Listed::new(0, scene.periods());
    }
    let (mut near, mut count) = ([0; CHUNK], 0);
    for (k, separation) in separations.iter().enumerate() {
        near[count] = k;
        count += usize::from(separation.until <= Meeting::reach(scene, places, nearby, &pairs[k]));
    }
    let near = &near[..count];
    let Hands { polyhedra, ahead } = hands;
    near.iter().take(AHEAD).for_each(|&k| ahead.fetch(pairs[k].0));
    let mut listed = Listed::new(count, scene.periods());
    for (place, &k) in near.iter().enumerate() {
        if let Some(&later) = near.get(place + AHEAD) {
            ahead.fetch(pairs[later].0);
        }
        let meeting = Meeting::new(scene, places, nearby, k, &pairs[k]);
        // Ways that lead past each other shorten the range.
        if separations[k].until > meeting.moved() + meeting.range.alert {
            continue;
        }
        let (memory, separation) = (std::mem::take(&mut memories[k]), std::mem::take(&mut separations[k]));
        if meeting.is_near() {
            let hint = separation.n.filter(|_| memory == Memory::default());
            touch(meeting, narrow, &memory, hint, polyhedra, &mut |meeting, sight| {
                listed.add(&meeting, sight, memories, separations);
            });
        }
    }
    polyhedra.finish(&mut |meeting, sight| listed.add(&meeting, sight, memories, separations));
    listed
}

/// Gap over the smaller radius up to which a pair has all its points, though it does not close: faces that lie on each other in a
/// common fall are pushed together in all of them once something is in the way.
const FLUSH: f64 = 1e-3;

/// Two contactors that may be near each other.
#[derive(Clone, Copy)]
pub(super) struct Meeting<'a> {
    /// Number of the pair in its chunk.
    pair: usize,
    pub a: &'a Place<'a>,
    pub b: &'a Place<'a>,
    /// From the centre of `a` to that of `b`, m, and what of that is from `b` to its image.
    pub c: Vec3,
    image: Vec3,
    pub range: Range,
    law: u8,
    /// Gap up to which points are listed however the two move, m; infinite where all that are found are.
    always: f64,
    /// Part of the alert distance by which ways may pass each other, m.
    margin: f64,
}

impl<'a> Meeting<'a> {
    /// How far the surfaces of two contactors have moved together, and the largest range that they may have, m: less than a
    /// meeting takes to make.
    #[inline(always)]
    fn reach(scene: &Scene, places: &[Place], nearby: f64, (parts, see): &([u32; 2], See)) -> f64 {
        let [a, b] = parts.map(|k| &places[k as usize]);
        let held = scene.laws[see.law as usize].interaction_range(1.0 / (a.curvature + b.curvature));
        let smaller = a.radius.min(b.radius);
        let range = held.max(a.travel + b.travel).max(nearby.max(FLUSH) * smaller).max(see.alert);
        a.moved + b.moved + range
    }

    #[inline]
    pub fn new(
        scene: &Scene,
        places: &'a [Place<'a>],
        nearby: f64,
        pair: usize,
        (parts, see): &([u32; 2], See),
    ) -> Self {
        let [a, b] = parts.map(|k| &places[k as usize]);
        let radius = 1.0 / (a.curvature + b.curvature);
        let law = &scene.laws[see.law as usize];
        let image = scene.image(&a.centre, &b.centre);
        let c = b.centre + image - a.centre;
        let held = law.interaction_range(radius);
        // Farther apart than that they do not touch in this step, unless something pushes them.
        let (mut travel, mut always) = (a.travel + b.travel, f64::INFINITY);
        let nearby = nearby * a.radius.min(b.radius);
        let margin = MARGIN * see.alert;
        if travel > nearby.max(margin) {
            travel = travel.min(approach(a, b, &c, Vec3::norm) + margin).max(nearby);
            always = held.max(see.alert).max(nearby);
        }
        let patch = held.max(travel).max(FLUSH * a.radius.min(b.radius));
        let range = Range { alert: patch.max(see.alert), patch, area: law.range_of_stress(radius) };
        Meeting { pair, a, b, c, image, range, law: see.law, always, margin }
    }

    /// Whether the balls about them come within the range in the step.
    fn is_near(&self) -> bool {
        let Meeting { a, b, c, .. } = self;
        let reach = a.reach + b.reach;
        let near = c.norm_squared() <= reach * reach;
        let rest = reach - (a.travel + b.travel);
        near && (self.always == f64::INFINITY || swept::least_distance(c, &(b.path - a.path)) <= rest + a.bend + b.bend)
    }

    /// Gap up to which points with this normal, from the antagonist to the candidate, are listed, m.
    fn listed_up_to(&self, normal: &Vec3) -> f64 {
        // The inside of a cylinder curves towards what moves along it.
        let curves = matches!(self.b.shape, Shape::Cylinder { hollow: true, .. });
        if self.always == f64::INFINITY || curves {
            return self.range.alert;
        }
        let closing = approach(self.a, self.b, &self.c, |against| (-normal.dot(against)).max(0.0));
        self.always.max(closing + self.margin).min(self.range.alert)
    }

    /// How far their surfaces have moved together, m.
    fn moved(&self) -> f64 {
        self.a.moved + self.b.moved
    }

    /// The points of a manifold up to the range, of which those on its area share it.
    pub fn contacts<'m>(&'m self, manifold: &'m Manifold) -> impl Iterator<Item = Contact> + 'm {
        let Meeting { a, b, range, .. } = self;
        let up_to = self.listed_up_to(&manifold.normal);
        let on_area = |point: &Point| point.gap <= range.area;
        let share = manifold.area / manifold.points.iter().filter(|point| on_area(point)).count() as f64;
        manifold.points.iter().filter(move |point| point.gap <= up_to).map(move |point| Contact {
            candidate: a.body,
            antagonist: b.body,
            ranks: (a.rank, b.rank),
            features: point.features,
            point: a.centre + point.position,
            image: self.image,
            normal: manifold.normal,
            gap: point.gap,
            area: if on_area(point) { share } else { 0.0 },
            law: self.law,
        })
    }
}

/// How far the surfaces of `a` and `b`, at `c` from it, come nearer in the step, m: `along` of their displacement against each
/// other, and what turning adds. As seen by an observer who turns with one of them or not at all: what turns as one body does
/// not move.
fn approach(a: &Place, b: &Place, c: &Vec3, along: impl Fn(&Vec3) -> f64) -> f64 {
    let path = a.path - b.path;
    let turn = (a.turn - b.turn).norm();
    let at_rest = along(&path) + a.turn.norm() * a.rim + b.turn.norm() * b.rim;
    let with_a = along(&(path + a.turn.cross(c))) + turn * b.rim;
    let with_b = along(&(path + b.turn.cross(c))) + turn * a.rim;
    at_rest.min(with_a).min(with_b)
}

/// What a task has found.
struct Listed {
    contacts: Vec<Contact>,
    /// Candidates of contacts that follow each other, and where these begin.
    runs: Vec<(u32, usize)>,
    /// Of the scene, m.
    periods: [Option<f64>; 2],
}

/// Part of the balls' radii within which rounding may make something of a distance.
const ROUNDING: f64 = 1e-9;

impl Listed {
    fn new(pairs: usize, periods: [Option<f64>; 2]) -> Self {
        Listed { contacts: Vec::with_capacity(4 * pairs), runs: Vec::new(), periods }
    }

    /// Adds what is seen of a pair: points up to its range, of which those on its area share it; keeps what is known of it.
    fn add(&mut self, meeting: &Meeting, sight: Sight, memories: &mut [Memory], separations: &mut [Separation]) {
        let Meeting { pair, a, b, c, .. } = meeting;
        let manifold = match sight {
            Ok((memory, manifold)) => {
                memories[*pair] = memory;
                manifold
            }
            Err(Apart { n, s }) => {
                // Of another image, nearest from half a period on, nothing is known.
                let of_image =
                    self.periods.iter().zip(c.as_slice()).filter_map(|(period, c)| Some((*period)? / 2.0 - c.abs()));
                let until = of_image.fold(s, f64::min) + meeting.moved() - ROUNDING * (a.reach + b.reach);
                separations[*pair] = Separation { n: Some([n.x, n.y, n.z].map(|x| x as f32)), until };
                return;
            }
        };
        if self.runs.last().is_none_or(|(candidate, _)| *candidate != a.body) {
            self.runs.push((a.body, self.contacts.len()));
        }
        self.contacts.extend(meeting.contacts(manifold));
    }

    /// The contacts from the beginning of a run to that of the next.
    fn run(&self, k: usize) -> &[Contact] {
        let end = self.runs.get(k + 1).map_or(self.contacts.len(), |(_, start)| *start);
        &self.contacts[self.runs[k].1..end]
    }
}

/// All contacts in the order of their keys.
fn sorted(found: &[Listed], bodies: usize, width: SimdWidth) -> Vec<Contact> {
    let runs: Vec<(&Listed, usize)> =
        found.iter().flat_map(|listed| (0..listed.runs.len()).map(move |k| (listed, k))).collect();
    let candidates: Vec<u32> = runs.iter().map(|(listed, k)| listed.runs[*k].0).collect();
    let (order, _) = group_by_key(&candidates, bodies);
    let run = |k: u32| {
        let (listed, k) = runs[k as usize];
        listed.run(k)
    };
    let mut contacts = Vec::with_capacity(found.iter().map(|listed| listed.contacts.len()).sum());
    for (place, &k) in order.iter().enumerate() {
        if let Some(&later) = order.get(place + 1) {
            width.prefetch(run(later));
        }
        contacts.extend_from_slice(run(k));
    }
    // Of one candidate they may come from several tasks, or of several parts.
    for of_one in contacts.chunk_by_mut(|a, b| a.candidate == b.candidate) {
        if !of_one.is_sorted_by_key(Contact::key) {
            of_one.sort_unstable_by_key(Contact::key);
        }
    }
    contacts
}

/// So many pairs before its turn what a pair reads is asked for: a few microseconds, and less than the nearest cache holds.
const AHEAD: usize = 16;

/// Asks for what pairs will read: of many bodies it comes from far memory in every step, while other pairs are worked on.
struct Ahead<'a> {
    places: &'a [Place<'a>],
    width: SimdWidth,
    /// Parts that have been asked for of late, each at its number's place.
    near: [u32; NEAR],
}

/// As many shapes as the second cache holds, about.
const NEAR: usize = 256;

impl<'a> Ahead<'a> {
    fn new(places: &'a [Place<'a>], width: SimdWidth) -> Self {
        Ahead { places, width, near: [u32::MAX; NEAR] }
    }

    #[inline(always)]
    fn fetch(&mut self, parts: [u32; 2]) {
        for part in parts {
            let last = &mut self.near[part as usize % NEAR];
            if *last != part
                && let Shape::Polyhedron(posed) = &self.places[part as usize].shape
            {
                *last = part;
                posed.fetch(self.width);
            }
        }
    }
}

fn place<'a>(scene: &Scene, part: &'a Part, q_c: &Configuration, ways: &Ways) -> Place<'a> {
    let i = part.body as usize;
    let q = &q_c.q[i];
    let arm = q * part.offset;
    let axes = q * part.axes;
    let travel = ways.of_rim(i, arm.norm() + part.radius);
    let turn = ways.turn(i);
    Place {
        centre: q_c.x[i] + arm,
        axes,
        travel,
        reach: part.radius + travel + 0.5 * scene.listing_range,
        path: ways.path(i) + turn.cross(&arm),
        turn,
        rim: if matches!(part.geometry, Geometry::Sphere { .. }) { 0.0 } else { part.radius },
        radius: part.radius,
        bend: (0.5 * turn.norm_squared() * arm.norm()).min(travel),
        moved: 0.0,
        curvature: scene.curvature_of(part),
        body: part.body,
        class: part.class,
        imposed: scene.bodies[i].is_imposed(),
        rank: part.rank,
        shape: match &part.geometry {
            Geometry::Sphere { radius } => Shape::Sphere { radius: *radius },
            Geometry::Polyhedron(shape) => Shape::Polyhedron(shape.posed(&axes)),
            Geometry::Cylinder { half_height, radius, hollow } => {
                Shape::Cylinder { half_height: *half_height, radius: *radius, hollow: *hollow }
            }
            Geometry::Plane { half_lengths, cuboid } => {
                Shape::Plane { half_lengths: *half_lengths, cuboid: cuboid.posed(&axes) }
            }
        },
    }
}

/// The two contactors, the candidate first, and how they see each other; none if they do not, or cannot push.
fn meet(scene: &Scene, places: &[Place], [i, j]: [u32; 2]) -> Option<([u32; 2], See)> {
    let [a, b] = [i, j].map(|k| &places[k as usize]);
    if a.body == b.body || (a.imposed && b.imposed) {
        return None;
    }
    let see = scene.visibility.see(a.class, b.class)?;
    let first = scene.candidacy(a.body, a.rank) <= scene.candidacy(b.body, b.rank);
    Some((if first { [i, j] } else { [j, i] }, see))
}

/// The pairs by candidates, in the order of the bodies, then by antagonists.
fn by_candidates(pairs: &[([u32; 2], See)], scene: &Scene, bodies: &[u32]) -> Vec<([u32; 2], See)> {
    let mut place = vec![0; bodies.len()];
    bodies.iter().zip(0..).for_each(|(&i, k)| place[i as usize] = k);
    let of_pairs: Vec<u32> =
        pairs.iter().map(|(parts, _)| place[scene.parts[parts[0] as usize].body as usize]).collect();
    let (order, starts) = group_by_key(&of_pairs, bodies.len());
    let mut grouped: Vec<([u32; 2], See)> = order.iter().map(|&k| pairs[k as usize]).collect();
    for of_one in starts.windows(2) {
        grouped[of_one[0] as usize..of_one[1] as usize].sort_unstable_by_key(|(parts, _)| *parts);
    }
    grouped
}

/// The places of the pairs, which come by candidates, in the order of their parts.
fn by_parts(pairs: &[([u32; 2], See)], parts: usize) -> Vec<u32> {
    let first: Vec<u32> = pairs.iter().map(|(parts, _)| parts[0]).collect();
    group_by_key(&first, parts).0
}

/// What is known already of each of the pairs; `order` and `before` are in the order of their parts.
fn carried<T: Clone + Default>(
    pairs: &[([u32; 2], See)],
    order: &[u32],
    before: impl Iterator<Item = ([u32; 2], T)>,
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

/// Calls `take` with what is seen of a pair, points relative to the candidate's centre; that of polyhedra may come later.
fn touch<'a>(
    meeting: Meeting<'a>,
    narrow: Narrow,
    memory: &Memory,
    hint: Option<[f32; 3]>,
    polyhedra: &mut Together<'a, Meeting<'a>>,
    take: &mut impl FnMut(Meeting<'a>, Sight),
) {
    let Meeting { a, b, c, range, .. } = meeting;
    let one = |found: narrow::Found| {
        let point = Point { position: found.point, gap: found.gap, features: (0, found.feature) };
        Manifold { normal: found.normal, points: std::iter::once(point).collect(), area: 0.0 }
    };
    let zero = Vec3::zeros();
    let found: SmallVec<[Manifold; 1]> = match (&a.shape, &b.shape) {
        // A plate is a cuboid.
        (Shape::Polyhedron(p), Shape::Polyhedron(q) | Shape::Plane { cuboid: q, .. }) => {
            let hint = hint.map(|n| Vec3::from(n.map(f64::from)));
            return polyhedra.pair(meeting, [p, q], &c, range, narrow, memory, hint, take);
        }
        (Shape::Sphere { radius: r }, Shape::Sphere { radius: s }) => {
            [one(narrow::sphere_sphere(&zero, *r, &c, *s))].into_iter().collect()
        }
        (Shape::Sphere { radius }, Shape::Plane { half_lengths, .. }) => {
            [one(narrow::sphere_plane(&zero, *radius, &c, &b.axes, half_lengths))].into_iter().collect()
        }
        (Shape::Sphere { radius }, Shape::Polyhedron(q)) => {
            let found = polyhedron_sphere(q, &-c, *radius, range.alert);
            found.map(|found| seen_from_sphere(&found, &c)).into_iter().collect()
        }
        (Shape::Sphere { radius: r }, Shape::Cylinder { half_height, radius, hollow }) => {
            let found = narrow::sphere_cylinder(&zero, *r, &c, &b.axes, [*half_height, *radius], *hollow);
            found.into_iter().flatten().map(one).collect()
        }
        (Shape::Polyhedron(p), Shape::Cylinder { half_height, radius, hollow: true }) => {
            polyhedron_hollow_cylinder(p, &c, &b.axes, [*half_height, *radius], range.alert).into_iter().collect()
        }
        (Shape::Polyhedron(p), Shape::Cylinder { half_height, radius, hollow: false }) => {
            polyhedron_cylinder(p, &c, &b.axes, [*half_height, *radius], range).into_iter().collect()
        }
        // Rows between cylinders and plates of which one moves freely along some axis are rejected.
        _ => SmallVec::new(),
    };
    let nearest = found.iter().min_by(|a, b| a.gap().total_cmp(&b.gap()));
    if let Some(nearest) = nearest.filter(|nearest| nearest.gap() > range.alert) {
        return take(meeting, Err(Apart { n: -nearest.normal, s: nearest.gap() }));
    }
    for manifold in &found {
        take(meeting, Ok((Memory::default(), manifold)));
    }
}

/// What a polyhedron finds of a sphere at -`c`, with the sphere as the candidate.
fn seen_from_sphere(found: &Manifold, c: &Vec3) -> Manifold {
    let turned = |point: &Point| Point {
        position: point.position + c,
        gap: point.gap,
        features: (point.features.1, point.features.0),
    };
    Manifold { normal: -found.normal, points: found.points.iter().map(turned).collect(), area: found.area }
}
