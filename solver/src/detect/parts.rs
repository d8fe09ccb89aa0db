//! Contacts between contactors of any shapes: balls about them in cells, then the geometry of each pair.

use rayon::prelude::*;

use cd_formats::compute::NarrowPhase;

use crate::detect::{narrow, periodic};
use crate::geometry::{
    Manifold, Memory, Narrow, Point, Posed, Range, polyhedron_cylinder, polyhedron_hollow_cylinder,
    polyhedron_polyhedron, polyhedron_sphere,
};
use crate::integrate::Configuration;
use crate::math::{Quat, Vec3, group};
use crate::scene::{Geometry, Part, Scene, See};
use crate::state::{Contact, PairMemory};

/// Where a contactor is.
struct Place {
    centre: Vec3,
    axes: Quat,
    /// How far a point of it can get in the step, m.
    travel: f64,
    /// Of a polyhedron or plate alone.
    posed: Posed,
}

/// All listed contacts in no order, and what is to be kept of the pairs, in order.
pub fn contacts(
    scene: &Scene,
    q_c: &Configuration,
    travel: &[f64],
    h: f64,
    before: &[PairMemory],
) -> (Vec<Contact>, Vec<PairMemory>) {
    let places: Vec<Place> = scene.parts.par_iter().with_min_len(64).map(|part| place(part, q_c, travel, h)).collect();
    let centres: Vec<Vec3> = places.iter().map(|place| place.centre).collect();
    let range = 0.5 * scene.listing_range;
    let reach: Vec<f64> =
        scene.parts.iter().zip(&places).map(|(part, place)| part.radius + place.travel + range).collect();
    // Pairs come and are looked at in the order of the cells: what a part is made of stays in the cache meanwhile.
    let pairs: Vec<([u32; 2], See)> =
        periodic::pairs(&centres, &reach, scene.periods()).into_iter().filter_map(|[i, j]| meet(scene, i, j)).collect();
    let order = by_parts(&pairs, scene.parts.len());
    let mut memory = remembered(&pairs, &order, before);
    let narrow = match scene.options.narrow_phase() {
        NarrowPhase::Fast => Narrow::Fast,
        NarrowPhase::Accurate => Narrow::Accurate,
    };
    let found: Vec<Vec<Contact>> = pairs
        .par_chunks(CHUNK)
        .zip(memory.par_chunks_mut(CHUNK))
        .map(|(pairs, memories)| {
            let mut contacts = Vec::with_capacity(2 * CHUNK);
            for ((parts, see), memory) in pairs.iter().zip(memories) {
                let [a, b] = parts.map(|k| (&scene.parts[k as usize], &places[k as usize]));
                let radius = scene.effective_radius(a.0.body, b.0.body);
                let law = &scene.laws[see.law as usize];
                let alert = law.range(radius).max(see.alert).max(a.1.travel + b.1.travel);
                let range = Range { alert, area: law.range_of_stress(radius) };
                let image = scene.image(&a.1.centre, &b.1.centre);
                let c = b.1.centre + image - a.1.centre;
                let mut list = |found: &Manifold| list(a, b.0, image, found, alert, see.law, &mut contacts);
                touch(a, b, &c, range, narrow, memory, &mut list);
            }
            contacts
        })
        .collect();
    let kept = |&k: &u32| PairMemory { parts: pairs[k as usize].0, memory: memory[k as usize] };
    let kept = order.iter().filter(|k| memory[**k as usize] != Memory::default()).map(kept).collect();
    (found.concat(), kept)
}

/// Pairs that one task looks at.
const CHUNK: usize = 64;

fn place(part: &Part, q_c: &Configuration, travel: &[f64], h: f64) -> Place {
    let i = part.body as usize;
    let q = &q_c.q[i];
    let arm = q * part.offset;
    let mut posed = Posed::default();
    if let Geometry::Polyhedron(shape) | Geometry::Plane { cuboid: shape, .. } = &part.geometry {
        posed.pose(shape, &(q * part.axes));
    }
    let turn = h * q_c.w[i].norm() * (arm.norm() + part.radius);
    Place { centre: q_c.x[i] + arm, axes: q * part.axes, travel: travel[i] + turn, posed }
}

/// The two contactors, the candidate first, and how they see each other; none if they do not, or cannot push.
fn meet(scene: &Scene, i: u32, j: u32) -> Option<([u32; 2], See)> {
    let [a, b] = [i, j].map(|k| &scene.parts[k as usize]);
    let driven = [a, b].map(|part| scene.bodies[part.body as usize].driven);
    if a.body == b.body || driven == [true, true] {
        return None;
    }
    let see = scene.visibility.see(a.class, b.class)?;
    // Spheres before polyhedra before cylinders before plates, then by number, as in LMGC90.
    let rank = |part: &Part| match part.geometry {
        Geometry::Sphere { .. } => 0,
        Geometry::Polyhedron(_) => 1,
        Geometry::Cylinder { .. } => 2,
        Geometry::Plane { .. } => 3,
    };
    let first = (rank(a), i) <= (rank(b), j);
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
    (a, at_a): (&Part, &Place),
    (b, at_b): (&Part, &Place),
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
    let found = match (&a.geometry, &b.geometry) {
        // A plate is a cuboid.
        (Geometry::Polyhedron(p), Geometry::Polyhedron(q) | Geometry::Plane { cuboid: q, .. }) => {
            polyhedron_polyhedron((p, &at_a.posed), (q, &at_b.posed), c, range, narrow, memory)
        }
        (Geometry::Sphere { radius: r }, Geometry::Sphere { radius: s }) => {
            Some(one(narrow::sphere_sphere(&zero, *r, c, *s)))
        }
        (Geometry::Sphere { radius }, Geometry::Plane { half_lengths, .. }) => {
            Some(one(narrow::sphere_plane(&zero, *radius, c, &at_b.axes, half_lengths)))
        }
        (Geometry::Sphere { radius }, Geometry::Polyhedron(q)) => {
            let found = polyhedron_sphere((q, &at_b.posed), &-*c, *radius, range.alert);
            found.map(|found| seen_from_sphere(&found, c))
        }
        (Geometry::Sphere { radius: r }, Geometry::Cylinder { half_height, radius, hollow }) => {
            let size = [*half_height, *radius];
            let found = narrow::sphere_cylinder(&zero, *r, c, &at_b.axes, size, *hollow);
            return found.into_iter().flatten().for_each(|found| take(&one(found)));
        }
        (Geometry::Polyhedron(p), Geometry::Cylinder { half_height, radius, hollow: true }) => {
            let size = [*half_height, *radius];
            let found = polyhedron_hollow_cylinder((p, &at_a.posed), c, &at_b.axes, size, range.alert);
            return found.iter().for_each(take);
        }
        (Geometry::Polyhedron(p), Geometry::Cylinder { half_height, radius, hollow: false }) => {
            polyhedron_cylinder((p, &at_a.posed), c, &at_b.axes, [*half_height, *radius], range)
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

/// Adds the points of a manifold up to `range`.
fn list(
    (a, at_a): (&Part, &Place),
    b: &Part,
    image: Vec3,
    manifold: &Manifold,
    range: f64,
    law: u8,
    contacts: &mut Vec<Contact>,
) {
    let area = manifold.area / manifold.points.len() as f64;
    contacts.extend(manifold.points.iter().filter(|point| point.gap <= range).map(|point| Contact {
        candidate: a.body,
        antagonist: b.body,
        ranks: (a.rank, b.rank),
        features: point.features,
        point: at_a.centre + point.position,
        image,
        normal: manifold.normal,
        gap: point.gap,
        area,
        law,
    }));
}
