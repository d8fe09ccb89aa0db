//! Flush joints: removes contacts with edges and sides that are inside a common surface of two contactors.
//!
//! The direction of a contact is computed pair by pair. If a contactor A slides over two contactors B and C with flush
//! surfaces, such as two adjacent plates, the side or edge of B that C covers would stop A. A contact of A and B is such
//! an **inner contact** if A has a contact with a face of another contactor C, and the plane of that face separates A
//! from B: A is above it, and B below. The contact with C keeps A above the plane during the whole step, so that A can
//! touch only those parts of B that are in the plane. A step up, or a wall on a floor, rises above the plane and remains
//! a contact.
//!
//! An inner contact of polyhedra is replaced by the contact of A and B along the normal of the plane if A is over B, and
//! removed otherwise. An inner contact with a sphere is always removed: a sphere over B has a contact with B's face. An
//! inner contact with the rim of a cylinder is also removed: a polyhedron whose extent over the end exceeds its overlap
//! has a contact with the end.
//!
//! Known as ghost collisions or internal edges in game physics; see E. Catto, Box2D: ghost collisions (2020).

use rayon::prelude::*;
use smallvec::SmallVec;

use super::posed::{CandidatePair, PosedContactor, PosedShape};
use super::spheres::{ListedPair, contact_geometry};
use super::travel::TravelBounds;
use crate::geometry::{PosedPolyhedron, polyhedra_along};
use crate::integrate::ContactConfiguration;
use crate::math::{Quat, Vec3, group_by_key};
use crate::scene::{BodyShape, Scene};
use crate::state::Contact;

/// Height over the radius of A's ball up to which surfaces are flush: above the overlaps that a sound solution leaves, and
/// less than a third of the smallest step that must stop a body, 1e-4 of its size.
const FLUSH_TOLERANCE: f64 = 3e-5;
/// Relative error of numbers in files, which have eight digits.
const FILE_ROUNDING: f64 = 5e-8;
/// 1 - cos of the angle between a contact's direction and a face's normal up to which the contact keeps A above that
/// face: 1e-3 rad, more than the tilt that overlaps cause for a body on a face.
const ON_FACE_TOLERANCE: f64 = 5e-7;
/// 1 - cos of the angle up to which two contacts count as parallel, 1e-4 rad: the side of a joint reduces the speed of A
/// by at most 1e-8.
const SAME_DIRECTION_TOLERANCE: f64 = 5e-9;
/// Sine of the angle between two faces beyond which they form no common surface.
const MAX_FACE_BEND: f64 = 1e-2;
/// Largest free displacement of B relative to C along the normal in the step, over the radius of the ball about A.
const MAX_RELATIVE_RISE: f64 = 1e-2;
/// Largest number of contacts of one contactor for which all pairs are tested; beyond it only pairs near each other are.
const MAX_CONTACTS_ALL_PAIRS: usize = 64;
/// Contactors per task.
const CONTACTORS_PER_TASK: usize = 256;

/// Convex shape, reduced to what the flush-joint test needs.
enum ConvexSolid<'a> {
    Sphere {
        radius: f64,
    },
    Cuboid {
        axes: &'a Quat,
        half_lengths: &'a Vec3,
    },
    Polyhedron(&'a PosedPolyhedron<'a>),
    /// Cylinder about the third axis.
    Cylinder {
        axes: &'a Quat,
        half_height: f64,
        radius: f64,
    },
}

impl ConvexSolid<'_> {
    /// Largest n·x, x from the centre, m.
    fn support_height(&self, n: &Vec3) -> f64 {
        match self {
            ConvexSolid::Sphere { radius } => *radius,
            ConvexSolid::Cuboid { axes, half_lengths } => axes.inverse_transform_vector(n).abs().dot(half_lengths),
            ConvexSolid::Polyhedron(posed) => posed.support_height(n),
            ConvexSolid::Cylinder { axes, half_height, radius } => {
                let local = axes.inverse_transform_vector(n);
                half_height * local.z.abs() + radius * local.xy().norm()
            }
        }
    }

    /// Normal of the face closest to `n`, and the distance of its plane from the centre, m. For a cylinder the faces are
    /// its ends; a sphere has none.
    fn face_along(&self, n: &Vec3) -> Option<(Vec3, f64)> {
        match self {
            ConvexSolid::Sphere { .. } => None,
            ConvexSolid::Cuboid { axes, half_lengths } => {
                let local = axes.inverse_transform_vector(n);
                let axis = local.iamax();
                let mut normal = Vec3::zeros();
                normal[axis] = 1f64.copysign(local[axis]);
                Some((*axes * normal, half_lengths[axis]))
            }
            ConvexSolid::Polyhedron(posed) => Some(posed.face_along(n)),
            ConvexSolid::Cylinder { axes, half_height, .. } => {
                let axis = *axes * Vec3::z();
                Some((axis * 1f64.copysign(axis.dot(n)), *half_height))
            }
        }
    }
}

/// Contactor near A.
struct NearbyContactor<'a> {
    solid: ConvexSolid<'a>,
    /// Centre relative to the centre of A, m.
    centre: Vec3,
    /// Free velocity and angular velocity of its body at the step's end, and the body's centre relative to the centre of
    /// A.
    v: Vec3,
    w: Vec3,
    body: Vec3,
}

impl NearbyContactor<'_> {
    fn velocity_at(&self, at: &Vec3) -> Vec3 {
        self.v + self.w.cross(&(at - self.body))
    }
}

/// Contactor A; lengths in m.
struct UpperContactor<'a> {
    solid: ConvexSolid<'a>,
    centre: Vec3,
    radius: f64,
    /// Largest displacement in the step, m.
    travel: f64,
    /// Time for which contacts are predicted, s.
    lookahead: f64,
}

/// Contact of A with one contactor; positions are relative to the centre of A.
#[derive(Clone, Copy)]
struct SurfaceContact {
    /// Index of the contact or pair.
    of: u32,
    /// Whether A is the antagonist.
    turned: bool,
    /// Normal from the other contactor to A.
    normal: Vec3,
    /// Contact point on the other contactor's surface, m.
    at: Vec3,
    /// Centre of the other contactor, m.
    centre: Vec3,
    /// Radius of a ball about `at` that contains the other contactor, m.
    reach: f64,
}

/// Plane of a face of C, below A.
#[derive(Clone, Copy)]
struct FacePlane {
    n: Vec3,
    /// Height n·x of the plane, x from the centre of A, m.
    height: f64,
    /// Uncertainty of `height` due to the rounding of numbers in files, m.
    digits: f64,
}

impl UpperContactor<'_> {
    /// Plane of the face of C above which a contact with C keeps A. `gap`: smallest gap of that contact, m.
    fn supporting_plane(&self, touch: &SurfaceContact, c: &NearbyContactor, gap: f64) -> Option<FacePlane> {
        let (n, face) = c.solid.face_along(&touch.normal)?;
        if n.dot(&touch.normal) < 1.0 - ON_FACE_TOLERANCE {
            return None;
        }
        let height = n.dot(&c.centre) + face;
        let digits = self.height_uncertainty(&n, c, face);
        let below = height + self.solid.support_height(&-n);
        (below <= (-gap).max(0.0) + 2.0 * (FLUSH_TOLERANCE * self.radius + digits)).then_some(FacePlane {
            n,
            height,
            digits,
        })
    }

    /// Whether a contact with B in direction `normal`, at points `at`, is an inner contact below the plane of C.
    fn is_inner(
        &self,
        plane: &FacePlane,
        c: &NearbyContactor,
        b: &NearbyContactor,
        normal: &Vec3,
        at: impl Iterator<Item = Vec3>,
    ) -> bool {
        let FacePlane { n, height, digits } = plane;
        if normal.dot(n) >= 1.0 - SAME_DIRECTION_TOLERANCE {
            return false;
        }
        // Bounds of B's height where A can meet it: the height of all of B, and the plane of its face, which bounds B
        // from above.
        let whole = b.solid.support_height(n);
        let mut top = n.dot(&b.centre) + whole;
        let tolerance = FLUSH_TOLERANCE * self.radius + digits + self.height_uncertainty(n, b, whole);
        let at: SmallVec<[Vec3; 6]> = at.collect();
        if top > height + tolerance
            && let Some((face, offset)) = b.solid.face_along(n)
        {
            let bent = face.cross(n).norm();
            if bent > MAX_FACE_BEND {
                return false;
            }
            let above = |at: &Vec3| n.dot(at) + (offset - face.dot(&(at - b.centre))) / face.dot(n);
            top = at.iter().map(above).fold(f64::NEG_INFINITY, f64::max) + bent * self.travel;
        }
        let rise = |at: &Vec3| self.lookahead * (b.velocity_at(at) - c.velocity_at(at)).dot(n);
        top <= height + tolerance && at.iter().all(|at| rise(at) <= MAX_RELATIVE_RISE * self.radius)
    }

    /// Uncertainty of the height of a face at `distance` from a contactor's centre due to the rounding of numbers in
    /// files, m.
    fn height_uncertainty(&self, n: &Vec3, near: &NearbyContactor, distance: f64) -> f64 {
        FILE_ROUNDING * (n.dot(&(self.centre + near.centre)).abs() + distance.abs())
    }
}

/// Whether the point of a contact and the centre of the other contactor are low enough, relative to the surface of
/// another contact, that the contact may be an inner one.
#[inline(always)]
fn may_be_inner(of: &SurfaceContact, by: &SurfaceContact) -> bool {
    // Tolerance: the largest angle between the contact's direction and the face's normal, and the largest deviation from
    // flush surfaces.
    let is_low = |point: &Vec3| {
        let between = point - by.at;
        let above = by.normal.dot(&between) - FLUSH_TOLERANCE * (of.reach + by.reach);
        above <= 0.0 || above * above <= 4.0 * ON_FACE_TOLERANCE * between.norm_squared()
    };
    is_low(&of.at) && is_low(&of.centre) && of.normal.dot(&by.normal) < 1.0 - SAME_DIRECTION_TOLERANCE
}

/// Position of a contact of A, for a necessary condition of [`may_be_inner`] that takes three products per pair; nearly all
/// contacts of rough bodies fail it. 64 bytes, one cache line.
struct ContactHeight {
    normal: Vec3,
    /// Contact point on the other contactor's surface, relative to the centre of A, m.
    at: Vec3,
    /// normal·at, m.
    height: f64,
    /// Largest height of an inner contact above the plane of another contact, m; the tolerances of both add up.
    tolerance: f64,
}

impl ContactHeight {
    /// `reach`: as in [`SurfaceContact`], m.
    #[inline(always)]
    fn new(normal: Vec3, at: Vec3, reach: f64) -> Self {
        // Two points are no farther from each other than both are from A's centre.
        let angle = 2.0 * ON_FACE_TOLERANCE.sqrt() * (1.0 + 1e-9);
        let tolerance = angle * at.norm() + FLUSH_TOLERANCE * reach;
        ContactHeight { normal, at, height: normal.dot(&at), tolerance }
    }

    /// Whether this contact is low enough for an inner contact relative to the surface of contact `by`.
    #[inline(always)]
    fn is_low(&self, by: &ContactHeight) -> bool {
        by.normal.dot(&self.at) - by.height <= self.tolerance + by.tolerance
    }
}

/// Whether some contact is low relative to another one with another direction.
fn any_is_low(heights: &[ContactHeight]) -> bool {
    let differs = |of: &ContactHeight, by: &ContactHeight| of.normal.dot(&by.normal) < 1.0 - SAME_DIRECTION_TOLERANCE;
    heights.iter().any(|by| heights.iter().any(|of| of.is_low(by) && differs(of, by)))
}

/// Scratch memory, reused from contactor to contactor.
struct JointScratch {
    /// Contacts that may act in the step.
    near: Vec<u32>,
    heights: Vec<ContactHeight>,
    /// Supporting plane of each contact, computed on first use.
    planes: Vec<Option<Option<FacePlane>>>,
    /// Inner contacts, the contacts that hide them, and the normals of the hiding planes.
    found: Vec<(usize, usize, Vec3)>,
}

impl JointScratch {
    const fn new() -> Self {
        JointScratch { near: Vec::new(), heights: Vec::new(), planes: Vec::new(), found: Vec::new() }
    }

    /// Appends to `inner` the inner contacts among `count` contacts of A, each with the normal of a plane that hides it.
    ///
    /// `touch` returns a contact by its number. `plane` returns the plane of the face that supports A in a contact.
    /// `test` returns whether one contact is an inner contact below the plane of another.
    fn find_inner_contacts(
        &mut self,
        count: usize,
        touch: impl Fn(usize) -> SurfaceContact,
        plane: impl Fn(&SurfaceContact) -> Option<FacePlane>,
        test: impl Fn(&SurfaceContact, &SurfaceContact, &FacePlane) -> bool,
        inner: &mut Vec<(SurfaceContact, Vec3)>,
    ) {
        let JointScratch { heights, planes, found, .. } = self;
        heights.clear();
        heights.extend((0..count).map(&touch).map(|touch| ContactHeight::new(touch.normal, touch.at, touch.reach)));
        planes.clear();
        planes.resize(count, None);
        found.clear();
        let mut try_pair = |of: usize, by: usize| {
            if !heights[of].is_low(&heights[by]) {
                return;
            }
            let (inner, outer) = (touch(of), touch(by));
            if may_be_inner(&inner, &outer)
                && let Some(plane) = *planes[by].get_or_insert_with(|| plane(&outer))
                && test(&inner, &outer, &plane)
            {
                found.push((of, by, plane.n));
            }
        };
        if count <= MAX_CONTACTS_ALL_PAIRS {
            for by in 0..count {
                (0..count).filter(|of| *of != by).for_each(|of| try_pair(of, by));
            }
        } else {
            let bounds = |k: usize| [touch(k).at.x - touch(k).reach, touch(k).at.x + touch(k).reach];
            let bounds: Vec<[f64; 2]> = (0..count).map(bounds).collect();
            let mut order: Vec<usize> = (0..count).collect();
            order.sort_by(|&a, &b| bounds[a][0].total_cmp(&bounds[b][0]));
            for (place, &i) in order.iter().enumerate() {
                for &j in order[place + 1..].iter().take_while(|&&j| bounds[j][0] <= bounds[i][1]) {
                    try_pair(i, j);
                    try_pair(j, i);
                }
            }
        }
        // An inner contact supports nothing.
        let stays = |by: usize| found.iter().all(|(of, ..)| *of != by);
        let first = inner.len();
        for &(of, by, n) in found.iter() {
            let hidden = touch(of);
            if stays(by) && inner[first..].iter().all(|(touch, _)| touch.of != hidden.of) {
                inner.push((hidden, n));
            }
        }
    }
}

/// Returns the contacts of spheres with plates without those with rims between flush plates.
pub(super) fn without_inner_rims(
    scene: &Scene,
    q_c: &ContactConfiguration,
    ways: &TravelBounds,
    listed: Vec<ListedPair>,
) -> Vec<ListedPair> {
    if scene.planes.len() < 2 {
        return listed;
    }
    let mut counts = vec![0u32; scene.bodies.len()];
    listed.iter().for_each(|([sphere, _], _)| counts[*sphere as usize] += 1);
    let is_alone = |([sphere, _], _): &ListedPair| counts[*sphere as usize] == 1;
    let (mut left, mut listed): (Vec<ListedPair>, Vec<ListedPair>) = listed.into_iter().partition(is_alone);
    listed.sort_unstable_by_key(|(pair, _)| *pair);
    let (mut scratch, mut inner) = (JointScratch::new(), Vec::new());
    for of_one in listed.chunk_by(|(a, _), (b, _)| a[0] == b[0]) {
        let sphere = of_one[0].0[0] as usize;
        let (x, radius) = (q_c.x[sphere], scene.bodies[sphere].radius);
        let over = UpperContactor {
            solid: ConvexSolid::Sphere { radius },
            centre: x,
            radius,
            travel: ways.travel[sphere],
            lookahead: ways.lookahead,
        };
        let seen: SmallVec<[_; 8]> = of_one.iter().map(|(pair, _)| contact_geometry(scene, q_c, *pair)).collect();
        let touch = |k: usize| {
            let found = &seen[k];
            let BodyShape::Plane { half_lengths } = &scene.bodies[of_one[k].0[1] as usize].shape else {
                unreachable!("these are plates")
            };
            let at = found.point - x - found.normal * (0.5 * found.gap);
            let plate = of_one[k].0[1] as usize;
            let centre = q_c.x[plate] + scene.nearest_image_shift(&x, &q_c.x[plate]) - x;
            SurfaceContact {
                of: k as u32,
                turned: false,
                normal: found.normal,
                at,
                centre,
                reach: 2.0 * half_lengths.norm(),
            }
        };
        let near = |touch: &SurfaceContact| {
            let plate = of_one[touch.of as usize].0[1] as usize;
            let BodyShape::Plane { half_lengths } = &scene.bodies[plate].shape else {
                unreachable!("these are plates")
            };
            let solid = ConvexSolid::Cuboid { axes: &q_c.q[plate], half_lengths };
            let (v, w) = (ways.v_free[plate], ways.w_free[plate]);
            NearbyContactor { solid, centre: touch.centre, v, w, body: touch.centre }
        };
        let plane = |by: &SurfaceContact| over.supporting_plane(by, &near(by), seen[by.of as usize].gap);
        let test = |of: &SurfaceContact, by: &SurfaceContact, plane: &FacePlane| {
            over.is_inner(plane, &near(by), &near(of), &of.normal, std::iter::once(of.at))
        };
        inner.clear();
        scratch.find_inner_contacts(seen.len(), touch, plane, test, &mut inner);
        let is_inner = |k: usize| inner.iter().any(|(touch, _)| touch.of as usize == k);
        left.extend((0..of_one.len()).filter(|&k| !is_inner(k)).map(|k| of_one[k]));
    }
    left
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

/// Removes the inner contacts from contacts that are ordered by key; returns their candidates and antagonists.
pub(super) fn remove_inner_edges(
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
