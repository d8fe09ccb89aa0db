//! Contacts between contactors of any shapes: balls about them in cells, then the geometry of each pair.

use rayon::prelude::*;

use cd_formats::compute::NarrowPhase;

use crate::detect::{narrow, periodic};
use crate::geometry::{
    Manifold, Memory, Narrow, Point, Posed, Range, polyhedron_cylinder, polyhedron_hollow_cylinder,
    polyhedron_polyhedron, polyhedron_sphere,
};
use crate::integrate::Configuration;
use crate::math::lanes::Width;
use crate::math::{Quat, Vec3, group};
use crate::scene::{Geometry, Part, Scene, See};
use crate::state::{Contact, PairMemory};

/// Where a contactor is, and what of the scene each pair asks for: so that a pair reads little memory.
struct Place<'a> {
    centre: Vec3,
    axes: Quat,
    /// How far a point of it can get in the step, m.
    travel: f64,
    /// As cohesion knows it, 1/m.
    curvature: f64,
    body: u32,
    /// Row and column in the visibility table.
    class: u16,
    driven: bool,
    /// Place among the contactors of its body.
    rank: u16,
    shape: Shape<'a>,
}

/// In the order in which one is the candidate rather than the other, as in LMGC90; of two alike the one that is not driven.
enum Shape<'a> {
    Sphere { radius: f64 },
    Polyhedron(Posed<'a>),
    Cylinder { half_height: f64, radius: f64, hollow: bool },
    Plane { half_lengths: Vec3, cuboid: Posed<'a> },
}

impl Shape<'_> {
    fn precedence(&self) -> u8 {
        match self {
            Shape::Sphere { .. } => 0,
            Shape::Polyhedron(_) => 1,
            Shape::Cylinder { .. } => 2,
            Shape::Plane { .. } => 3,
        }
    }
}

/// All listed contacts in the order of their keys, and what is to be kept of the pairs, in order.
pub fn contacts(
    scene: &Scene,
    q_c: &Configuration,
    travel: &[f64],
    before: &[PairMemory],
    narrow: NarrowPhase,
) -> (Vec<Contact>, Vec<PairMemory>) {
    let h = q_c.ahead;
    let places: Vec<Place> =
        scene.parts.par_iter().with_min_len(64).map(|part| place(scene, part, q_c, travel, h)).collect();
    let centres: Vec<Vec3> = places.iter().map(|place| place.centre).collect();
    let range = 0.5 * scene.listing_range;
    let reach: Vec<f64> =
        scene.parts.iter().zip(&places).map(|(part, place)| part.radius + place.travel + range).collect();
    // Pairs come and are looked at in the order of the cells: what a part is made of stays in the cache meanwhile.
    let pairs: Vec<([u32; 2], See)> = periodic::pairs(&centres, &reach, scene.periods())
        .into_par_iter()
        .with_min_len(1024)
        .filter_map(|ij| meet(scene, &places, ij))
        .collect();
    let order = by_parts(&pairs, scene.parts.len());
    let mut memory = remembered(&pairs, &order, before);
    let narrow = match narrow {
        NarrowPhase::Fast => Narrow::Fast,
        NarrowPhase::Accurate => Narrow::Accurate,
    };
    let width = Width::detect();
    let found: Vec<Listed> = memory
        .par_chunks_mut(CHUNK)
        .enumerate()
        .map(|(chunk, memories)| {
            let mut listed = Listed { contacts: Vec::with_capacity(2 * CHUNK), ends: Vec::with_capacity(CHUNK) };
            let mut ahead = Ahead { pairs: &pairs, places: &places, width, near: [u32::MAX; NEAR] };
            for (k, memory) in (chunk * CHUNK..).zip(memories) {
                ahead.fetch(k);
                let (parts, see) = &pairs[k];
                let [a, b] = parts.map(|k| &places[k as usize]);
                let radius = 1.0 / (a.curvature + b.curvature);
                let law = &scene.laws[see.law as usize];
                let alert = law.range(radius).max(see.alert).max(a.travel + b.travel);
                let range = Range { alert, area: law.range_of_stress(radius) };
                let image = scene.image(&a.centre, &b.centre);
                let c = b.centre + image - a.centre;
                let mut list = |found: &Manifold| list(a, b, image, found, range, see.law, &mut listed.contacts);
                touch(a, b, &c, range, narrow, memory, &mut list);
                listed.ends.push(listed.contacts.len());
            }
            listed
        })
        .collect();
    let kept = |&k: &u32| PairMemory { parts: pairs[k as usize].0, memory: memory[k as usize] };
    let kept = order.iter().filter(|k| memory[**k as usize] != Memory::default()).map(kept).collect();
    (sorted(&found, &order, width), kept)
}

/// What a task has found.
struct Listed {
    contacts: Vec<Contact>,
    /// Of each pair, where its contacts end.
    ends: Vec<usize>,
}

/// The contacts of pairs in this order, which is that of their keys but for bodies of several parts.
fn sorted(found: &[Listed], order: &[u32], width: Width) -> Vec<Contact> {
    let of_pair = |k: u32| {
        let (listed, k) = (&found[k as usize / CHUNK], k as usize % CHUNK);
        let start = if k == 0 { 0 } else { listed.ends[k - 1] };
        &listed.contacts[start..listed.ends[k]]
    };
    let mut contacts = Vec::with_capacity(found.iter().map(|listed| listed.contacts.len()).sum());
    for (place, &k) in order.iter().enumerate() {
        if let Some(&later) = order.get(place + AHEAD) {
            width.fetch(of_pair(later));
        }
        contacts.extend_from_slice(of_pair(k));
    }
    for of_one in contacts.chunk_by_mut(|a, b| a.candidate == b.candidate) {
        if !of_one.is_sorted_by_key(Contact::key) {
            of_one.sort_unstable_by_key(Contact::key);
        }
    }
    contacts
}

/// So many pairs before its turn what a pair reads is asked for: a few microseconds, and less than the nearest cache holds.
const AHEAD: usize = 8;

/// Asks for what pairs will read: of many bodies it comes from far memory in every step, while other pairs are worked on.
struct Ahead<'a> {
    pairs: &'a [([u32; 2], See)],
    places: &'a [Place<'a>],
    width: Width,
    /// Parts that have been asked for of late, each at its number's place.
    near: [u32; NEAR],
}

/// As many shapes as the second cache holds, about.
const NEAR: usize = 256;

impl Ahead<'_> {
    /// Asks for what pairs behind number `k` will read: first for where their parts are, then for the shapes.
    #[inline(always)]
    fn fetch(&mut self, k: usize) {
        if let Some((parts, _)) = self.pairs.get(k + 2 * AHEAD) {
            parts.iter().for_each(|&part| self.width.fetch(&self.places[part as usize]));
        }
        let Some((parts, _)) = self.pairs.get(k + AHEAD) else { return };
        for &part in parts {
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

/// Pairs that one task looks at.
const CHUNK: usize = 128;

fn place<'a>(scene: &Scene, part: &'a Part, q_c: &Configuration, travel: &[f64], h: f64) -> Place<'a> {
    let i = part.body as usize;
    let q = &q_c.q[i];
    let arm = q * part.offset;
    let axes = q * part.axes;
    let turn = h * q_c.w[i].norm() * (arm.norm() + part.radius);
    Place {
        centre: q_c.x[i] + arm,
        axes,
        travel: travel[i] + turn,
        curvature: scene.curvature_of(part),
        body: part.body,
        class: part.class,
        driven: scene.bodies[i].driven,
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
    if a.body == b.body || (a.driven && b.driven) {
        return None;
    }
    let see = scene.visibility.see(a.class, b.class)?;
    let first = (a.shape.precedence(), a.driven, i) <= (b.shape.precedence(), b.driven, j);
    Some((if first { [i, j] } else { [j, i] }, see))
}

/// The places of the pairs in the order of their parts.
fn by_parts(pairs: &[([u32; 2], See)], parts: usize) -> Vec<u32> {
    let first: Vec<u32> = pairs.iter().map(|(parts, _)| parts[0]).collect();
    let (mut order, starts) = group(&first, parts);
    for of_one in starts.windows(2) {
        order[of_one[0] as usize..of_one[1] as usize].sort_unstable_by_key(|&k| pairs[k as usize].0[1]);
    }
    order
}

/// What is remembered of each of the pairs; `order` and `before` are in the order of their parts.
fn remembered(pairs: &[([u32; 2], See)], order: &[u32], before: &[PairMemory]) -> Vec<Memory> {
    let mut memory = vec![Memory::default(); pairs.len()];
    let mut before = before.iter().peekable();
    for &k in order {
        let parts = &pairs[k as usize].0;
        while before.next_if(|old| old.parts < *parts).is_some() {}
        if let Some(old) = before.next_if(|old| old.parts == *parts) {
            memory[k as usize] = old.memory;
        }
    }
    memory
}

/// Calls `take` with the manifolds of candidate `a` and antagonist `b`, its centre at `c` from that of `a` (m), up to
/// `range`, points relative to the candidate's centre.
fn touch(
    a: &Place,
    b: &Place,
    c: &Vec3,
    range: Range,
    narrow: Narrow,
    memory: &mut Memory,
    take: &mut impl FnMut(&Manifold),
) {
    let one = |found: narrow::Found| {
        let point = Point { position: found.point, gap: found.gap, features: (0, found.feature) };
        Manifold { normal: found.normal, points: std::iter::once(point).collect(), area: 0.0 }
    };
    let zero = Vec3::zeros();
    let found = match (&a.shape, &b.shape) {
        // A plate is a cuboid.
        (Shape::Polyhedron(p), Shape::Polyhedron(q) | Shape::Plane { cuboid: q, .. }) => {
            polyhedron_polyhedron(p, q, c, range, narrow, memory)
        }
        (Shape::Sphere { radius: r }, Shape::Sphere { radius: s }) => {
            Some(one(narrow::sphere_sphere(&zero, *r, c, *s)))
        }
        (Shape::Sphere { radius }, Shape::Plane { half_lengths, .. }) => {
            Some(one(narrow::sphere_plane(&zero, *radius, c, &b.axes, half_lengths)))
        }
        (Shape::Sphere { radius }, Shape::Polyhedron(q)) => {
            polyhedron_sphere(q, &-*c, *radius, range.alert).map(|found| seen_from_sphere(&found, c))
        }
        (Shape::Sphere { radius: r }, Shape::Cylinder { half_height, radius, hollow }) => {
            let found = narrow::sphere_cylinder(&zero, *r, c, &b.axes, [*half_height, *radius], *hollow);
            return found.into_iter().flatten().for_each(|found| take(&one(found)));
        }
        (Shape::Polyhedron(p), Shape::Cylinder { half_height, radius, hollow: true }) => {
            let found = polyhedron_hollow_cylinder(p, c, &b.axes, [*half_height, *radius], range.alert);
            return found.iter().for_each(take);
        }
        (Shape::Polyhedron(p), Shape::Cylinder { half_height, radius, hollow: false }) => {
            polyhedron_cylinder(p, c, &b.axes, [*half_height, *radius], range)
        }
        // Cylinders and plates are walls, which do not meet.
        _ => None,
    };
    if let Some(found) = found {
        take(&found);
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

/// Adds the points of a manifold up to `range`; those on its area share it.
fn list(a: &Place, b: &Place, image: Vec3, manifold: &Manifold, range: Range, law: u8, contacts: &mut Vec<Contact>) {
    let on_area = |point: &Point| point.gap <= range.area;
    let share = manifold.area / manifold.points.iter().filter(|point| on_area(point)).count() as f64;
    contacts.extend(manifold.points.iter().filter(|point| point.gap <= range.alert).map(|point| Contact {
        candidate: a.body,
        antagonist: b.body,
        ranks: (a.rank, b.rank),
        features: point.features,
        point: a.centre + point.position,
        image,
        normal: manifold.normal,
        gap: point.gap,
        area: if on_area(point) { share } else { 0.0 },
        law,
    }));
}
