//! Friction of faces: points at which the friction of the corner points of a face or an edge acts.
//!
//! The corner points p_i of the area that two bodies share carry its normal impulses: this is exact for their sum and for
//! their moments in the tangent plane, and so for tilting and bending. Friction at the corners would resist spinning about
//! the normal more than a pressed face does: a square 1.85 times, a disc 1.50 times as much. Therefore friction acts about
//! the normal at
//! ```text
//! q_i = p_i + d_i,   d_i = (λ - 1)(p_i - p̄),   λ = τ / Σ W_i |p_i - p̄|,   p̄ = Σ W_i p_i
//! ```
//!
//! with the shares W_i of the load of the last step; λ makes the couple against spinning μ N τ for any distribution of the
//! load over the corners. A face that slides in the direction e must not be turned by the friction: Σ (q_i - p_i)·e⊥ r_i is 0
//! only for the load that gives p̄, and corners share a load anew in each step. In a face that slides and spins, the
//! component of d_i across e is therefore multiplied by
//!
//! ```text
//! (ω τ)² / (|u|² + (ω τ)²),
//! ```
//!
//! with the relative velocity u of the face at p̄ and its relative angular velocity ω about the normal at the step's start. τ
//! is the mean distance of the pressure from p̄: that of uniform pressure if p̄ is the centroid, that of uniform pressure
//! along an edge if p̄ lies on this edge, and linear between these along the ray from the centroid.
//!
//! Contacts with adjacent flush contactors of one body, or of imposed bodies, form one face: its corners are those of all
//! parts, its outline is their convex hull, if the parts fill it ([`Joints`]). How its parts share the load is not
//! determined. A face that is new, or spins faster than it slides and than friction can stop in the step, therefore starts
//! from the load of a uniform pressure with the same sum and centre, and the sweeps find a solution near it; in a face that
//! spins all q_i are at the distance τ from p̄. Where a corner reaches a joint, its contact is replaced by others: in the step
//! in which a loaded contact of such a face is lost, p̄ is that of all contacts of the last step, carried with the candidate.
//!
//! Values of τ: 0.3826 a for a square of side a, 2/3 of the radius for a disc, a quarter of the length for an edge.

use std::ops::Range;

use cd_formats::compute::FaceFriction;
use rayon::prelude::*;
use smallvec::SmallVec;

use super::problem::{BlockData, ContactConstraint, SolverBody};
use crate::math::{PAR_MIN_LEN, Vec3, run_ranges, to_world};
use crate::scene::{BodyId, BodyPart, ContactorShape, Scene};
use crate::state::Contact;

/// Ratio of the gap to the size of a face, up to which corners without load belong to the pressed area: vertices read
/// from text have 7 digits.
const FLUSH_GAP: f64 = 1e-6;
/// Ratio of the area to the square of the size of a face, below which it is an edge: its corners are rounded to about
/// 1e-9 of the size.
const MIN_FACE_AREA: f64 = 1e-6;
/// Largest λ: a few corners near the centroid that carry all the load would move the friction far outside the face.
const MAX_OFFSET_SCALE: f64 = 2.0;
/// Ratio of the distance of the load from p̄ to the size of the face, below which one corner carries the whole load.
const SINGLE_CORNER_DISTANCE: f64 = 1e-9;
/// Largest ratio of the area of a common part to that of the polygon of its acting points, for which the part counts as
/// round: a disc has π/2 times the area of its inscribed square. The ratio is larger if some corners are apart.
const LARGEST_AREA_RATIO: f64 = 1.6;
/// Iterations for the centre of a bonded face: the sum of distances in a triangle whose best centre is a corner is then
/// within 1 %.
const WEISZFELD_ITERATIONS: usize = 30;
/// Largest 1 - cos of the angle between the normals of contacts of one face: 1e-4 rad.
const MAX_NORMAL_DEVIATION: f64 = 5e-9;
/// Ratio of height to distance, up to which points are in one plane: larger than the overlaps of solutions.
const MAX_HEIGHT_RATIO: f64 = 1e-4;
/// Relative difference of velocities up to which imposed bodies move as one.
const MAX_SPEED_DIFFERENCE: f64 = 1e-9;
/// Twice the area of a triangle, divided by the square of its size, up to which its corners are collinear.
const MAX_COLLINEAR_AREA: f64 = 1e-9;
/// Smallest ratio of the area of the contacts of a face to that of their hull, below which the contactors under it
/// leave gaps.
const MIN_FILLED_SHARE: f64 = 0.99;
/// Rows per task.
const ROWS_PER_TASK: usize = 256;

/// Input for the friction of faces.
///
/// * `load`: normal impulse of each row in the last step plus the part due to its attraction, N s; only ratios count.
/// * `is_sticking`: whether each row stuck in the last step.
pub(super) struct FaceRows<'a, L, S> {
    pub contacts: &'a [Contact],
    pub rows: &'a [ContactConstraint],
    pub solver_bodies: &'a [SolverBody],
    pub block_data: &'a BlockData,
    pub load: L,
    pub is_sticking: S,
}

/// Point of a load in the plane of a face, and the load.
#[derive(Clone, Copy)]
struct PointLoad {
    /// World frame, m.
    point: Vec3,
    /// Normal impulse, N s.
    load: f64,
}

/// Load of a contact of the last step.
pub(super) struct LastLoad {
    pub bodies: [BodyId; 2],
    pub normal: Vec3,
    /// Point to which the candidate has carried the contact, m.
    pub point: Vec3,
    /// Normal impulse, N s.
    pub load: f64,
    /// Whether a contact of this step has the same features.
    pub stays: bool,
}

/// Face of which the friction is computed.
#[derive(Clone, Copy)]
enum FaceKind<'a> {
    /// Contacts of the same two contactors along one normal.
    Single,
    /// Contacts that may belong to several adjacent contactors. `last_loads`: loads of the last step, if it
    /// had other contacts than this step, else empty.
    Joined { last_loads: &'a [PointLoad] },
}

/// Friction of one face.
#[derive(Default)]
struct FaceFrictionPoints {
    /// Friction offset d of its rows, m; empty if all are 0.
    offsets: SmallVec<[Vec3; 4]>,
    /// Shares of the load with which its acting rows start, if they do not start from the impulses of the last step.
    start_shares: Option<SmallVec<[f64; 8]>>,
}

impl<L: Fn(usize) -> f64 + Sync, S: Fn(usize) -> bool + Sync> FaceRows<'_, L, S> {
    /// Friction offset d of each row, world frame, m; empty if all are 0.
    pub fn friction_offsets(&self) -> Vec<Vec3> {
        let tasks = run_ranges(self.contacts, ROWS_PER_TASK, is_same_face);
        let faces = tasks.par_iter().map(|task| self.face_ranges(task));
        let faces: Vec<Vec<Range<usize>>> = faces.collect();
        if faces.iter().all(Vec::is_empty) {
            return Vec::new();
        }
        let rows = self.rows.par_iter().with_min_len(PAR_MIN_LEN);
        let mut offsets: Vec<Vec3> = rows.map(|_| Vec3::zeros()).collect();
        let mut unassigned = &mut offsets[..];
        let take_offsets =
            |task: &Range<usize>| (task.start, unassigned.split_off_mut(..task.len()).unwrap_or_default());
        let parts: Vec<(usize, &mut [Vec3])> = tasks.iter().map(take_offsets).collect();
        let set_offsets = |((start, offsets), faces): ((usize, &mut [Vec3]), &Vec<Range<usize>>)| {
            let mut has_offsets = false;
            for face in faces {
                let face_rows: SmallVec<[usize; 8]> = face.clone().collect();
                let found = self.friction_points(&face_rows, FaceKind::Single).unwrap_or_default().offsets;
                if !found.is_empty() {
                    offsets[face.start - start..face.end - start].copy_from_slice(&found);
                    has_offsets = true;
                }
            }
            has_offsets
        };
        let has_offsets = parts.into_par_iter().zip(&faces).map(set_offsets).reduce(|| false, |a, b| a || b);
        if has_offsets { offsets } else { Vec::new() }
    }

    /// Ranges of two or more of the rows `task` of the same two contactors along one normal, of which two or more act with
    /// friction.
    fn face_ranges(&self, task: &Range<usize>) -> Vec<Range<usize>> {
        let (rows, mut ranges, mut start) = (self.rows, Vec::new(), task.start);
        for face in self.contacts[task.clone()].chunk_by(is_same_face) {
            let range = start..start + face.len();
            start = range.end;
            let active_count = || rows[range.clone()].iter().filter(|row| row.can_close && row.friction > 0.0).count();
            if face.len() >= 2 && active_count() >= 2 {
                ranges.push(range);
            }
        }
        ranges
    }
}

/// Whether a scene may have faces that lie on several contactors of one body or of imposed bodies.
pub(super) fn has_joints(scene: &Scene) -> bool {
    let is_imposed = |part: &&BodyPart| scene.bodies[part.body.index()].is_imposed();
    let is_piece = |part: &BodyPart| part.number > 0 && matches!(part.geometry, ContactorShape::Polyhedron(_));
    let parts = scene.parts.par_iter().with_min_len(PAR_MIN_LEN);
    scene.options.face_friction == FaceFriction::Uniform
        && (parts.clone().any(is_piece) || parts.filter(is_imposed).count() > 1)
}

/// Faces that flush joints cross. The friction of a face that lies on several adjacent contactors, of one body or of bodies
/// with the same imposed motion, acts as that of one face, since the distribution of the load over the contactors is not
/// determined. On separate bodies that move freely each part has its own friction.
///
/// * `last_loads`: lists the loads of the last step; called if there are such faces.
pub(super) struct Joints<'a, L, S, C> {
    pub faces: &'a FaceRows<'a, L, S>,
    pub scene: &'a Scene,
    pub last_loads: C,
}

/// Friction offsets of [`BlockData`], including those of joined faces, and the initial impulses (world frame, N s) of
/// rows in such faces that do not start from those of the last step.
pub(super) struct JoinedFaces {
    pub offsets: Vec<Vec3>,
    pub warm_starts: Vec<(usize, Vec3)>,
}

/// Rows of two contactors along one normal.
struct ContactorRows {
    /// The two bodies, in order; [`IMPOSED`] represents all imposed bodies.
    bodies: [BodyId; 2],
    rows: Range<usize>,
    /// Normal towards the first of `bodies`.
    normal: Vec3,
}

/// Number in [`ContactorRows::bodies`] for all imposed bodies: they may move, but not by contacts.
const IMPOSED: BodyId = BodyId(u32::MAX);

impl<L, S, C> Joints<'_, L, S, C>
where
    L: Fn(usize) -> f64 + Sync,
    S: Fn(usize) -> bool + Sync,
    C: Fn() -> Vec<LastLoad>,
{
    /// Friction offsets of the rows, and the initial impulses of those in joined faces that are new or spin. The
    /// distribution of the load over a joined face is not determined: sweeps from a uniform pressure stay near it.
    pub fn joined_faces(&self) -> JoinedFaces {
        let FaceRows { rows, block_data, .. } = self.faces;
        let (mut offsets, mut warm_starts) = (block_data.friction_offsets.clone(), Vec::new());
        let faces = self.joined_face_rows();
        let last_loads = if faces.is_empty() { Vec::new() } else { (self.last_loads)() };
        for face in faces {
            let last = self.loads_of_changed_face(&face, &last_loads);
            let Some(found) = self.faces.friction_points(&face, FaceKind::Joined { last_loads: &last }) else {
                continue;
            };
            if offsets.is_empty() && !found.offsets.is_empty() {
                offsets = vec![Vec3::zeros(); rows.len()];
            }
            if let Some(shares) = found.start_shares {
                let acting: SmallVec<[usize; 8]> = face.iter().copied().filter(|&k| rows[k].can_close).collect();
                let carried: Vec3 = acting.iter().map(|&k| rows[k].warm_start).sum();
                let total = match carried == Vec3::zeros() {
                    true => rows[acting[0]].normal * self.stopping_impulse(&acting, &shares),
                    false => carried,
                };
                warm_starts.extend(acting.into_iter().zip(shares).map(|(k, share)| (k, total * share)));
            }
            if !offsets.is_empty() {
                let found = found.offsets.into_iter().chain(std::iter::repeat(Vec3::zeros()));
                face.into_iter().zip(found).for_each(|(k, offset)| offsets[k] = offset);
            }
        }
        JoinedFaces { offsets, warm_starts }
    }

    /// Points and loads of the last step in the plane of a face of which a loaded contact is lost; empty if all remain.
    fn loads_of_changed_face(&self, face: &[usize], last_loads: &[LastLoad]) -> Vec<PointLoad> {
        let contacts = self.faces.contacts;
        let Contact { candidate, antagonist, normal, point: origin, .. } = contacts[face[0]];
        let (bodies, normal) = self.ordered_pair([candidate, antagonist], normal);
        let size = face.iter().map(|&k| (contacts[k].point - origin).norm()).fold(0.0, f64::max);
        let is_in_face = |last: &&LastLoad| {
            let (last_bodies, last_normal) = self.ordered_pair(last.bodies, last.normal);
            last_bodies == bodies
                && normal.dot(&last_normal) >= 1.0 - MAX_NORMAL_DEVIATION
                && normal.dot(&(last.point - origin)).abs() <= MAX_HEIGHT_RATIO * size
        };
        let loads_in_face: Vec<&LastLoad> = last_loads.iter().filter(is_in_face).collect();
        match loads_in_face.iter().all(|last| last.stays) {
            true => Vec::new(),
            false => loads_in_face.into_iter().map(|last| PointLoad { point: last.point, load: last.load }).collect(),
        }
    }

    /// The two bodies of a contact as in [`ContactorRows`], and its normal towards the first of these.
    fn ordered_pair(&self, pair: [BodyId; 2], normal: Vec3) -> ([BodyId; 2], Vec3) {
        let [a, b] = pair.map(|body| if self.scene.bodies[body.index()].is_imposed() { IMPOSED } else { body });
        if a <= b { ([a, b], normal) } else { ([b, a], -normal) }
    }

    /// Normal impulse that stops the approach of the two bodies of a face, at the mean of its rows by these shares of the
    /// load, N s; 0 if they do not approach.
    fn stopping_impulse(&self, acting: &[usize], shares: &[f64]) -> f64 {
        let FaceRows { rows, solver_bodies, block_data, .. } = self.faces;
        let approach = |k: usize| {
            let (row, arms) = (&rows[k], &block_data.arms[k]);
            let [a, b] = [0, 1].map(|body_side| {
                let solver_body = &solver_bodies[row.bodies[body_side].index()];
                solver_body.v + solver_body.w.cross(&arms[body_side])
            });
            -row.normal.dot(&(a - b + row.shift))
        };
        let speed: f64 = acting.iter().zip(shares).map(|(&k, share)| share * approach(k)).sum();
        let inverse_mass: f64 =
            rows[acting[0]].bodies.map(|body| solver_bodies[body.index()].inverse_mass).iter().sum();
        if inverse_mass > 0.0 { speed.max(0.0) / inverse_mass } else { 0.0 }
    }

    /// Rows of each face that lies on several contactors in one plane.
    fn joined_face_rows(&self) -> Vec<Vec<usize>> {
        let mut contactor_rows = self.contactor_rows();
        contactor_rows.sort_by_key(|contactors| (contactors.bodies, contactors.rows.start));
        let mut faces = Vec::new();
        for rows_of_pair in contactor_rows.chunk_by(|a, b| a.bodies == b.bodies).filter(|found| found.len() > 1) {
            let mut planes: Vec<Vec<&ContactorRows>> = Vec::new();
            for contactors in rows_of_pair {
                match planes.iter_mut().find(|plane| self.is_flush(plane[0], contactors)) {
                    Some(plane) => plane.push(contactors),
                    None => planes.push(vec![contactors]),
                }
            }
            let rows = |plane: Vec<&ContactorRows>| {
                plane.iter().flat_map(|contactors| contactors.rows.clone()).collect::<Vec<_>>()
            };
            let rows_of_faces = self.faces.rows;
            let acts = |k: &&usize| rows_of_faces[**k].can_close && rows_of_faces[**k].friction > 0.0;
            let several = planes.into_iter().filter(|plane| plane.len() > 1).map(rows);
            faces.extend(several.filter(|face| face.iter().filter(acts).nth(1).is_some()));
        }
        faces
    }

    /// Contacts of two contactors that may have adjacent contacts in the same plane.
    fn contactor_rows(&self) -> Vec<ContactorRows> {
        let Joints { faces: FaceRows { contacts, rows, .. }, scene, .. } = self;
        let is_imposed = |body: BodyId| scene.bodies[body.index()].is_imposed();
        let has_several = |body: BodyId| scene.parts_of(body).len() > 1;
        let (mut found, mut start) = (Vec::new(), 0);
        for face in contacts.chunk_by(is_same_face) {
            let range = start..start + face.len();
            start = range.end;
            let Contact { candidate, antagonist, normal, .. } = face[0];
            let pair = [candidate, antagonist];
            let stands_alone = !pair.into_iter().any(|body| is_imposed(body) || has_several(body));
            if stands_alone || face.len() < 2 || !rows[range.clone()].iter().any(|row| row.can_close) {
                continue;
            }
            let (bodies, normal) = self.ordered_pair(pair, normal);
            found.push(ContactorRows { bodies, rows: range, normal });
        }
        found
    }

    /// Whether contacts of two pairs of contactors of the same bodies lie in one plane, on bodies that move as one.
    fn is_flush(&self, one: &ContactorRows, other: &ContactorRows) -> bool {
        let FaceRows { contacts, solver_bodies, block_data, .. } = self.faces;
        if one.normal.dot(&other.normal) < 1.0 - MAX_NORMAL_DEVIATION {
            return false;
        }
        let [first, second] = [one, other].map(|contactors| contactors.rows.start);
        let origin = contacts[first].point;
        let from_origin = |k: usize| contacts[k].point - origin;
        let size = other.rows.clone().map(|k| from_origin(k).norm()).fold(0.0, f64::max);
        if other.rows.clone().any(|k| one.normal.dot(&from_origin(k)).abs() > MAX_HEIGHT_RATIO * size) {
            return false;
        }
        if one.bodies[1] != IMPOSED {
            return true;
        }
        // Velocity of the imposed body at the first contact.
        let imposed_motion = |k: usize| {
            let pair = [contacts[k].candidate, contacts[k].antagonist];
            let body_side = usize::from(!self.scene.bodies[pair[0].index()].is_imposed());
            let solver_body = &solver_bodies[pair[body_side].index()];
            (solver_body.v + solver_body.w.cross(&(block_data.arms[k][body_side] - from_origin(k))), solver_body.w)
        };
        let [(v, w), (other_v, other_w)] = [first, second].map(imposed_motion);
        w == other_w && (v - other_v).norm() <= MAX_SPEED_DIFFERENCE * (v.norm() + other_v.norm())
    }
}

/// Whether two contacts are of the same contactors along one normal.
fn is_same_face(a: &Contact, b: &Contact) -> bool {
    (a.antagonist, a.candidate, a.part_numbers) == (b.antagonist, b.candidate, b.part_numbers) && a.normal == b.normal
}

impl<L: Fn(usize) -> f64 + Sync, S: Fn(usize) -> bool + Sync> FaceRows<'_, L, S> {
    /// Friction of the face of the rows `face_rows`; `None` if it is joined and its contactors leave gaps.
    fn friction_points(&self, face_rows: &[usize], kind: FaceKind) -> Option<FaceFrictionPoints> {
        let FaceRows { contacts, rows, block_data, .. } = self;
        // Other listed contacts depend on the alert distance and must not change a bit of the result.
        let acting: SmallVec<[usize; 8]> = face_rows.iter().copied().filter(|&k| rows[k].can_close).collect();
        let first = acting[0];
        let frame = contacts[first].frame();
        let [_, t, s] = frame;
        let origin = contacts[first].point;
        let position = |point: &Vec3| tangent_components(&(point - origin), &frame);
        let points: SmallVec<[[f64; 2]; 8]> = acting.iter().map(|&k| position(&contacts[k].point)).collect();
        let size = points.iter().map(|p| vector_length(difference_of(*p, points[0]))).fold(0.0, f64::max);
        let mut loads: SmallVec<[f64; 8]> = acting.iter().map(|&k| (self.load)(k).max(0.0)).collect();
        let gap = |k: &usize| contacts[*k].gap;
        let area = face_rows.iter().map(|&k| contacts[k].area).sum();
        let is_joined = matches!(kind, FaceKind::Joined { .. });
        let outline = if is_joined {
            FrictionFace::of_hull(&points, size, area)?
        } else {
            FrictionFace::new(&points, size, area)
        };
        let deepest = acting.iter().map(gap).fold(f64::INFINITY, f64::min);
        let mut pressed_gap = deepest + FLUSH_GAP * size;
        let is_new = loads.iter().all(|load| *load == 0.0);
        if is_new {
            // The load of a face that is not flush is unknown.
            if !acting.iter().all(|k| gap(k) <= pressed_gap) {
                return Some(FaceFrictionPoints::default());
            }
            let from_origin = block_data.arms[first].map(|arm| tangent_components(&-arm, &frame));
            let steady = steady_centre(&rows[first], block_data, from_origin, &frame);
            loads = outline
                .load_shares(steady.filter(|p| outline.ray_intersection(*p).ratio < 1.0).unwrap_or(outline.centroid));
        } else {
            let loaded = acting.iter().zip(&loads).filter(|(_, load)| **load > 0.0).map(|(k, _)| gap(k));
            pressed_gap = loaded.fold(pressed_gap, f64::max);
        }
        let total_load: f64 = loads.iter().sum();
        // The rows do not know the loads of lost contacts, and those that inherit from one lie elsewhere. Attraction and
        // bonds are loads of the rows only.
        let loads_are_known = |k: &usize| rows[*k].impulse_shift == 0.0 && rows[*k].bond.is_none();
        let (centre, carried_load) = match kind {
            FaceKind::Joined { last_loads }
                if !is_new && !last_loads.is_empty() && acting.iter().all(loads_are_known) =>
            {
                centre_of_load(|| last_loads.iter().map(|PointLoad { point, load }| (position(point), *load)))
            }
            _ => centre_of_load(|| points.iter().copied().zip(loads.iter().copied())),
        };
        let tau = outline.mean_distance(centre);
        let motion = match acting.iter().all(|k| (self.is_sticking)(*k)) {
            true => FaceMotion::default(),
            false => {
                let velocity = |k: &usize| {
                    let (n, u) = (contacts[*k].normal, &rows[*k].u_before);
                    if n == contacts[first].normal {
                        return u.yz().into();
                    }
                    // Velocity of the other body relative to this one if they have changed sides.
                    let sign = 1f64.copysign(n.dot(&contacts[first].normal));
                    tangent_components(&(to_world(&contacts[*k].frame(), u) * sign), &frame)
                };
                let velocities: SmallVec<[TangentVector; 8]> = acting.iter().map(velocity).collect();
                FaceMotion::new(&points, &velocities, centre, tau)
            }
        };
        let across_sliding = motion.across_sliding();
        let mobility: f64 = rows[first].bodies.map(|body| self.solver_bodies[body.index()].inverse_mass).iter().sum();
        let stoppable_speed = if is_new { 0.0 } else { rows[first].friction * carried_load * mobility };
        let spins = motion.spin_slip_speed > vector_length(motion.u).max(stoppable_speed);
        let starts_uniform = is_joined
            && (is_new || spins)
            && outline.corners.len() > 2
            && acting.iter().all(|&k| rows[k].impulse_shift == 0.0 && gap(&k) <= deepest + FLUSH_GAP * size);
        let (loads, total_load) = if starts_uniform { (outline.load_shares(centre), 1.0) } else { (loads, total_load) };
        let distance = points
            .iter()
            .zip(&loads)
            .map(|(p, w)| vector_length(difference_of(*p, centre)) * w / total_load)
            .sum::<f64>();
        if distance.is_nan() || distance <= SINGLE_CORNER_DISTANCE * size {
            return Some(FaceFrictionPoints::default());
        }
        // A bond yields about the point with the least sum of distances; a sliding face turns about any point.
        let is_bonded = acting.iter().all(|k| rows[*k].bond.is_some());
        let distance = if is_bonded { least_distance(&points, &loads, centre) / total_load } else { distance };
        let scale = (tau / distance).min(MAX_OFFSET_SCALE);
        let middles = match starts_uniform && spins {
            true => part_middles(&acting, &points, contacts),
            false => SmallVec::new(),
        };
        let mut offsets = SmallVec::from_elem(Vec3::zeros(), face_rows.len());
        let rows_of_points = face_rows.iter().enumerate().filter(|(_, k)| rows[**k].can_close);
        for (i, (row_position, _)) in rows_of_points.enumerate().filter(|(_, (_, k))| gap(k) <= pressed_gap) {
            let arm = difference_of(points[i], centre);
            let (vector, factor) = match middles.get(i) {
                Some(middle) => (offset_to_distance(tau, arm, difference_of(*middle, centre)), 1.0),
                None => (arm, scale - 1.0),
            };
            let across_part = vector[0] * across_sliding[0] + vector[1] * across_sliding[1];
            let [x, y] = difference_of(vector, across_sliding.map(|e| e * across_part));
            offsets[row_position] = (t * x + s * y) * factor;
        }
        Some(FaceFrictionPoints { offsets, start_shares: starts_uniform.then_some(loads) })
    }
}

/// Centre of loads at points, and their sum.
fn centre_of_load<I: Iterator<Item = (TangentVector, f64)>>(loads: impl Fn() -> I) -> (TangentVector, f64) {
    let total: f64 = loads().map(|(_, load)| load).sum();
    (loads().fold([0.0; 2], |c, (p, w)| [c[0] + p[0] * w / total, c[1] + p[1] * w / total]), total)
}

/// Middle of the points on the same contactors as each point of a joined face.
fn part_middles(acting: &[usize], points: &[TangentVector], contacts: &[Contact]) -> SmallVec<[TangentVector; 8]> {
    let (mut middles, mut start) = (SmallVec::new(), 0);
    for part in acting.chunk_by(|&a, &b| is_same_face(&contacts[a], &contacts[b])) {
        let part_points = &points[start..start + part.len()];
        start += part.len();
        let sum = part_points.iter().fold([0.0; 2], |sum, p| [sum[0] + p[0], sum[1] + p[1]]);
        middles.extend(part.iter().map(|_| sum.map(|x| x / part.len() as f64)));
    }
    middles
}

/// Offset from the end of `arm` to the point at `distance` from its start, in the direction halfway between `arm` and
/// `middle`: corners of parts may lie at the centre of the face, where their own direction is undetermined.
fn offset_to_distance(distance: f64, arm: TangentVector, middle: TangentVector) -> TangentVector {
    let direction = [arm[0] + middle[0], arm[1] + middle[1]];
    let length = vector_length(direction);
    if length == 0.0 { [0.0; 2] } else { difference_of(direction.map(|x| x / length * distance), arm) }
}

/// Relative motion of a face in its plane.
#[derive(Debug, Clone, Copy, Default)]
struct FaceMotion {
    /// Velocity at the centre of pressure, m/s.
    u: TangentVector,
    /// Mean speed of slip by the relative rotation about the normal, |ω| τ, m/s.
    spin_slip_speed: f64,
}

impl FaceMotion {
    /// * `velocities`: velocities of the points, m/s; `centre`: point at which u is taken; `tau`: τ, m.
    fn new(points: &[TangentVector], velocities: &[TangentVector], centre: TangentVector, tau: f64) -> Self {
        let mean = |values: &[TangentVector]| {
            let sum = values.iter().fold([0.0; 2], |sum, v| [sum[0] + v[0], sum[1] + v[1]]);
            sum.map(|sum| sum / values.len() as f64)
        };
        let (middle, u) = (mean(points), mean(velocities));
        let (mut turning_sum, mut inertia) = (0.0, 0.0);
        for (p, v) in points.iter().zip(velocities) {
            let arm = difference_of(*p, middle);
            turning_sum += cross_product(arm, *v);
            inertia += arm[0] * arm[0] + arm[1] * arm[1];
        }
        let spin = turning_sum / inertia;
        let arm = difference_of(centre, middle);
        FaceMotion { u: [u[0] - spin * arm[1], u[1] + spin * arm[0]], spin_slip_speed: (spin * tau).abs() }
    }

    /// Unit vector across the direction of sliding, times the square root of the sliding share |u|²/(|u|² + (ω τ)²).
    fn across_sliding(&self) -> TangentVector {
        let total_speed = vector_length([vector_length(self.u), self.spin_slip_speed]);
        // A face at rest has no direction of sliding.
        if total_speed > 0.0 { [-self.u[1] / total_speed, self.u[0] / total_speed] } else { [0.0; 2] }
    }
}

/// Centre of pressure, along t and s, of a face that closes without turning: the point at which a normal impulse turns the
/// bodies least. For a body on a wall it is the foot of its centre of mass. `None` if no body turns.
///
/// * `centres`: centres of candidate and antagonist.
fn steady_centre(
    row: &ContactConstraint,
    block_data: &BlockData,
    centres: [TangentVector; 2],
    [_, t, s]: &[Vec3; 3],
) -> Option<TangentVector> {
    // For both bodies: the moment x×n of a unit impulse along n at x turns the point back by -C (x - centre), C the compliance.
    let (mut compliance, mut right_side) = ([0.0; 3], [0.0; 2]);
    for (body, [x, y]) in row.bodies.into_iter().zip(centres) {
        let inverse = &block_data.inverse_inertia[body.index()];
        let [xx, xy, yy] = [s.dot(&(inverse * s)), -s.dot(&(inverse * t)), t.dot(&(inverse * t))];
        compliance = [compliance[0] + xx, compliance[1] + xy, compliance[2] + yy];
        right_side = [right_side[0] + xx * x + xy * y, right_side[1] + xy * x + yy * y];
    }
    let [xx, xy, yy] = compliance;
    let det = xx * yy - xy * xy;
    let centre = [(yy * right_side[0] - xy * right_side[1]) / det, (xx * right_side[1] - xy * right_side[0]) / det];
    centre.iter().all(|x| x.is_finite()).then_some(centre)
}

/// Components of a vector along the tangents t and s of a face.
type TangentVector = [f64; 2];

/// Components along t and s.
fn tangent_components(v: &Vec3, [_, t, s]: &[Vec3; 3]) -> TangentVector {
    [v.dot(t), v.dot(s)]
}

fn difference_of(a: TangentVector, b: TangentVector) -> TangentVector {
    [a[0] - b[0], a[1] - b[1]]
}

fn cross_product(a: TangentVector, b: TangentVector) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn vector_length(a: TangentVector) -> f64 {
    (a[0] * a[0] + a[1] * a[1]).sqrt()
}

/// Least sum of the weighted distances of points from one point, by Weiszfeld's iteration from `start`.
fn least_distance(points: &[TangentVector], weights: &[f64], start: TangentVector) -> f64 {
    let distance_sum = |c: TangentVector| {
        points.iter().zip(weights).map(|(p, w)| vector_length(difference_of(*p, c)) * w).sum::<f64>()
    };
    let (mut centre, mut least) = (start, distance_sum(start));
    for _ in 0..WEISZFELD_ITERATIONS {
        let (mut weighted_sum, mut weight_sum) = ([0.0; 2], 0.0);
        for (p, w) in points.iter().zip(weights) {
            let weight = w / vector_length(difference_of(*p, centre));
            weighted_sum = [weighted_sum[0] + p[0] * weight, weighted_sum[1] + p[1] * weight];
            weight_sum += weight;
        }
        let next = weighted_sum.map(|x| x / weight_sum);
        let next_sum = distance_sum(next);
        // NaN, which occurs if the centre is at one of the points, is rejected.
        if next_sum.is_nan() || next_sum >= least {
            break;
        }
        (centre, least) = (next, next_sum);
    }
    least
}

/// Intersection of the ray from a face's centroid through a point with its outline.
struct RayIntersection {
    /// Ratio of the distance of the point from the centroid to that of the intersection, at most 1.
    ratio: f64,
    /// Index of the first corner of the side that the ray meets.
    side: usize,
    /// Share of the second corner of this side at the intersection, 0 at the first.
    share: f64,
}

/// The convex polygon of a face, or the segment of an edge.
struct FrictionFace {
    /// Corners, counter-clockwise; the ends of an edge.
    corners: SmallVec<[TangentVector; 8]>,
    /// Indices of the corners in the list of points.
    order: SmallVec<[usize; 8]>,
    /// Shares of a uniform pressure, in the order of the points; its centre is the centroid.
    weights: SmallVec<[f64; 8]>,
    centroid: TangentVector,
    /// Mean distance of the area from its centroid, m; not used for an edge.
    uniform_mean_distance: f64,
}

impl FrictionFace {
    /// `size`: largest distance from the first point, m; `area`: area of the common part, m², 0 if unknown.
    fn new(points: &[TangentVector], size: f64, area: f64) -> Self {
        let mut order: SmallVec<[usize; 8]> = (0..points.len()).collect();
        let count = points.len() as f64;
        let mean = points.iter().fold([0.0; 2], |m, p| [m[0] + p[0] / count, m[1] + p[1] / count]);
        let around: SmallVec<[f64; 8]> = points.iter().map(|p| pseudo_angle(difference_of(*p, mean))).collect();
        order.sort_by(|&a, &b| around[a].total_cmp(&around[b]));
        let corners: SmallVec<[TangentVector; 8]> = order.iter().map(|&k| points[k]).collect();
        // Twice the areas of the triangles between a point and the sides.
        let triangles = |tip: TangentVector| -> SmallVec<[f64; 8]> {
            polygon_sides(&corners)
                .map(|[a, b]| cross_product(difference_of(a, tip), difference_of(b, tip)).max(0.0))
                .collect()
        };
        let doubled = triangles(mean);
        let whole: f64 = doubled.iter().sum();
        if points.len() < 3 || whole < MIN_FACE_AREA * size * size {
            return FrictionFace::from_edge(points, corners[0]);
        }
        let mut centroid = [0.0; 2];
        for ([a, b], doubled) in polygon_sides(&corners).zip(&doubled) {
            (0..2).for_each(|i| centroid[i] += (mean[i] + a[i] + b[i]) / 3.0 * doubled / whole);
        }
        let doubled = triangles(centroid);
        // Half of the two triangles next to a corner: Σ w_i p_i is the centroid.
        let mut weights = SmallVec::from_elem(0.0, points.len());
        for (at, &k) in order.iter().enumerate() {
            let before = if at == 0 { order.len() - 1 } else { at - 1 };
            weights[k] = 0.5 * (doubled[before] + doubled[at]) / whole;
        }
        let sum: f64 =
            polygon_sides(&corners).zip(&doubled).map(|([a, b], d)| d * mean_side_distance(a, b, centroid)).sum();
        // Corners that protrude very little are omitted, and round outlines have corners of the enclosed polygon. Shares of
        // the area are rounded to single precision, which gives the same result for any number of them.
        let ratio = f64::from((2.0 * area / whole) as f32);
        let larger = if (1.0..=LARGEST_AREA_RATIO).contains(&ratio) { ratio.sqrt() } else { 1.0 };
        FrictionFace { corners, order, weights, centroid, uniform_mean_distance: larger * 2.0 / 3.0 * sum / whole }
    }

    /// Outline of the convex hull of the points, if the contacts fill its area.
    fn of_hull(points: &[TangentVector], size: f64, area: f64) -> Option<Self> {
        let mut order: SmallVec<[usize; 16]> = (0..points.len()).collect();
        order.sort_by(|&a, &b| points[a][0].total_cmp(&points[b][0]).then(points[a][1].total_cmp(&points[b][1])));
        let half_hull = |order: &mut dyn Iterator<Item = usize>| {
            let mut chain: SmallVec<[usize; 16]> = SmallVec::new();
            for k in order {
                while let [.., a, b] = chain[..]
                    && cross_product(difference_of(points[b], points[a]), difference_of(points[k], points[a]))
                        <= MAX_COLLINEAR_AREA * size * size
                {
                    chain.pop();
                }
                chain.push(k);
            }
            chain.pop();
            chain
        };
        let mut hull = half_hull(&mut order.iter().copied());
        hull.extend(half_hull(&mut order.iter().rev().copied()));
        let corners: SmallVec<[TangentVector; 16]> = hull.iter().map(|&k| points[k]).collect();
        let hull_area = 0.5
            * polygon_sides(&corners)
                .map(|[a, b]| cross_product(difference_of(a, corners[0]), difference_of(b, corners[0])))
                .sum::<f64>();
        if corners.len() < 3 || area < MIN_FILLED_SHARE * hull_area {
            return None;
        }
        let outline = FrictionFace::new(&corners, size, area);
        let mut weights = SmallVec::from_elem(0.0, points.len());
        hull.iter().zip(&outline.weights).for_each(|(&k, weight)| weights[k] = *weight);
        let order = outline.order.iter().map(|&k| hull[k]).collect();
        Some(FrictionFace { order, weights, ..outline })
    }

    /// The edge between the two points that are farthest apart.
    fn from_edge(points: &[TangentVector], first: TangentVector) -> Self {
        let farthest_point = |from: TangentVector| {
            let farther_point = |a: &TangentVector, b: &TangentVector| {
                if vector_length(difference_of(*b, from)) > vector_length(difference_of(*a, from)) { *b } else { *a }
            };
            points.iter().fold(from, |a, b| farther_point(&a, b))
        };
        let one = farthest_point(first);
        let other = farthest_point(one);
        let weights = SmallVec::from_elem(1.0 / points.len() as f64, points.len());
        let centroid = [0, 1].map(|i| 0.5 * (one[i] + other[i]));
        let order = SmallVec::new(); // not used for an edge
        FrictionFace {
            corners: SmallVec::from_slice(&[one, other]),
            order,
            weights,
            centroid,
            uniform_mean_distance: 0.0,
        }
    }

    /// Intersection of the ray from the centroid through `p` with the outline.
    fn ray_intersection(&self, p: TangentVector) -> RayIntersection {
        let ray = difference_of(p, self.centroid);
        let (mut ratio, mut side) = (0.0, 0);
        for (k, [a, b]) in polygon_sides(&self.corners).enumerate() {
            let side_vector = difference_of(b, a);
            let side_ratio =
                cross_product(ray, side_vector) / cross_product(difference_of(a, self.centroid), side_vector);
            if side_ratio.is_finite() && side_ratio > ratio {
                (ratio, side) = (side_ratio, k);
            }
        }
        let [a, b] = [side, (side + 1) % self.corners.len()].map(|k| self.corners[k]);
        let side_vector = difference_of(b, a);
        let end = [0, 1].map(|i| self.centroid[i] + if ratio > 0.0 { ray[i] / ratio } else { 0.0 });
        let from_corner = difference_of(end, a);
        let share = (from_corner[0] * side_vector[0] + from_corner[1] * side_vector[1])
            / (side_vector[0] * side_vector[0] + side_vector[1] * side_vector[1]);
        RayIntersection { ratio: ratio.min(1.0), side, share: share.clamp(0.0, 1.0) }
    }

    /// τ of a pressure with its centre at `p`, m.
    fn mean_distance(&self, p: TangentVector) -> f64 {
        // For an edge of length L, at the distances x and L - x from its ends: uniform on both sides of the point.
        let edge_mean_distance =
            |[a, b]: [TangentVector; 2], share: f64| share * (1.0 - share) * vector_length(difference_of(b, a));
        if let &[a, b] = self.corners.as_slice() {
            let (edge, from_end) = (difference_of(b, a), difference_of(p, a));
            let share = (from_end[0] * edge[0] + from_end[1] * edge[1]) / (edge[0] * edge[0] + edge[1] * edge[1]);
            return edge_mean_distance([a, b], share.clamp(0.0, 1.0));
        }
        let RayIntersection { ratio, side, share } = self.ray_intersection(p);
        let ends = [side, (side + 1) % self.corners.len()].map(|k| self.corners[k]);
        (1.0 - ratio) * self.uniform_mean_distance + ratio * edge_mean_distance(ends, share)
    }

    /// Shares of the points in a pressure with centre `p`: a combination of a uniform pressure and that of an edge, as for τ.
    fn load_shares(&self, p: TangentVector) -> SmallVec<[f64; 8]> {
        if self.corners.len() == 2 {
            return self.weights.clone();
        }
        let RayIntersection { ratio, side, share } = self.ray_intersection(p);
        let mut shares: SmallVec<[f64; 8]> = self.weights.iter().map(|w| w * (1.0 - ratio)).collect();
        shares[self.order[side]] += ratio * (1.0 - share);
        shares[self.order[(side + 1) % self.order.len()]] += ratio * share;
        shares
    }
}

/// The sides of a polygon.
fn polygon_sides(corners: &[TangentVector]) -> impl Iterator<Item = [TangentVector; 2]> + '_ {
    (0..corners.len()).map(|k| [corners[k], corners[if k + 1 == corners.len() { 0 } else { k + 1 }]])
}

/// Monotonic function of the angle of a direction, from -2 to 2.
fn pseudo_angle([x, y]: TangentVector) -> f64 {
    let norm = x.abs() + y.abs();
    if norm == 0.0 { 0.0 } else { (1.0 - x / norm).copysign(y) }
}

/// Mean distance of the points of the side from `a` to `b` from a point `c`, m:
/// ∫ √(u² + h²) du / (u_b - u_a) = [u r + h² asinh(u/h)]/2 / (u_b - u_a).
fn mean_side_distance(a: TangentVector, b: TangentVector, c: TangentVector) -> f64 {
    let side = difference_of(b, a);
    let l = vector_length(side);
    if l == 0.0 {
        return vector_length(difference_of(a, c));
    }
    let (from_a, from_b) = (difference_of(a, c), difference_of(b, c));
    let h = cross_product(from_a, side).abs() / l;
    let integral = |p: TangentVector| {
        let u = (p[0] * side[0] + p[1] * side[1]) / l;
        let curved_part = if h > 0.0 { h * h * libm::asinh(u / h) } else { 0.0 };
        0.5 * (u * vector_length(p) + curved_part)
    };
    (integral(from_b) - integral(from_a)) / l
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outline(points: &[TangentVector]) -> FrictionFace {
        let size = points.iter().map(|p| vector_length(difference_of(*p, points[0]))).fold(0.0, f64::max);
        FrictionFace::new(points, size, 0.0)
    }

    fn ring(count: usize) -> Vec<TangentVector> {
        let angle = |k: usize| k as f64 * std::f64::consts::TAU / count as f64;
        (0..count).map(|k| [3.0 + angle(k).cos(), angle(k).sin() - 1.0]).collect()
    }

    /// Mean distance from the centroid of a fine grid of points in the polygon.
    fn by_grid(corners: &[TangentVector]) -> f64 {
        let (mut sum, mut count, mut points_of_face) = ([0.0; 2], 0.0, Vec::new());
        let n = 400;
        for i in 0..n {
            for j in 0..n {
                let p = [i, j].map(|k| -5.0 + 10.0 * (k as f64 + 0.5) / n as f64);
                if polygon_sides(corners).all(|[a, b]| cross_product(difference_of(b, a), difference_of(p, a)) > 0.0) {
                    (0..2).for_each(|i| sum[i] += p[i]);
                    count += 1.0;
                    points_of_face.push(p);
                }
            }
        }
        let centroid = sum.map(|x| x / count);
        points_of_face.iter().map(|p| vector_length(difference_of(*p, centroid))).sum::<f64>() / count
    }

    #[test]
    fn mean_distances_are_those_of_the_area() {
        let square = outline(&[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]);
        let closed = (2f64.sqrt() + 1f64.asinh()) / 6.0;
        assert!((square.mean_distance([0.5, 0.5]) - closed).abs() < 1e-15 && (closed - 0.3826).abs() < 1e-4);
        // A 400-gon is 8e-5 smaller than its disc.
        let disc = outline(&ring(400));
        assert!((disc.mean_distance([3.0, -1.0]) - 2.0 / 3.0).abs() < 1e-4);
        let polygons: [&[TangentVector]; 4] = [
            &[[-4.0, 0.0], [3.0, -1.0], [0.0, 4.0]],
            &[[-4.0, -1.0], [4.0, -1.0], [4.0, 1.0], [-4.0, 1.0]],
            &[[-4.0, -1.0], [4.0, -1.0], [1.0, 1.0], [0.0, 1.0]],
            &[[-4.0, -4.0], [0.0, -4.5], [4.0, -2.0], [1.0, 1.0], [-3.0, 2.0]],
        ];
        for corners in polygons {
            let found = outline(corners);
            let expected = by_grid(corners);
            // The grid has 400 points across 10 m.
            assert!(
                (found.mean_distance(found.centroid) - expected).abs() < 5e-3,
                "{expected} {}",
                found.uniform_mean_distance
            );
            let centre =
                corners.iter().zip(&found.weights).fold([0.0; 2], |c, (p, w)| [c[0] + p[0] * w, c[1] + p[1] * w]);
            assert!(
                vector_length(difference_of(centre, found.centroid)) < 1e-14 && found.weights.iter().all(|w| *w > 0.0)
            );
            for p in [[0.0, 0.3], [-1.0, 0.1], [0.5, -0.2]] {
                let shares = found.load_shares(p);
                let centre = corners.iter().zip(&shares).fold([0.0; 2], |c, (p, w)| [c[0] + p[0] * w, c[1] + p[1] * w]);
                assert!(
                    vector_length(difference_of(centre, p)) < 1e-14 && shares.iter().all(|w| *w > 0.0),
                    "{centre:?}"
                );
            }
        }
    }

    #[test]
    fn the_least_distance_is_that_from_the_point_of_fermat() {
        let weights = [1.0; 3];
        // For a right isosceles triangle with legs of 1 it is (√2 + √6)/2.
        let least = least_distance(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], &weights, [1.0 / 3.0; 2]);
        assert!((least - (2f64.sqrt() + 6f64.sqrt()) / 2.0).abs() < 1e-9, "{least}");
        // For an angle of more than 120 degrees it is the sum of the adjacent sides.
        let flat = [[0.0, 0.0], [3.0, 0.0], [0.3, 0.1]];
        let least = least_distance(&flat, &weights, [1.1, 0.1 / 3.0]);
        let expected = vector_length(flat[2]) + vector_length(difference_of(flat[2], flat[1]));
        assert!(least >= expected && least < 1.01 * expected, "{least} {expected}");
    }

    #[test]
    fn a_pressure_at_the_rim_is_that_of_an_edge() {
        let square = outline(&[[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]]);
        assert!((square.mean_distance([1.0, 0.5]) - 0.25).abs() < 1e-15);
        assert!((square.mean_distance([1.0, 0.25]) - 0.1875).abs() < 1e-15);
        assert!(square.mean_distance([0.0, 0.0]).abs() < 1e-15);
        let edge = outline(&[[0.0, 0.0], [3.0, 4.0]]);
        assert!((edge.mean_distance(edge.centroid) - 1.25).abs() < 1e-15);
        // Three points in one line, and rounding.
        let edge = outline(&[[0.0, 0.0], [1.5, 2.0 + 1e-12], [3.0, 4.0]]);
        assert!((edge.mean_distance(edge.centroid) - 1.25).abs() < 1e-15);
    }
}
