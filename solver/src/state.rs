//! Data: `State`, which each step changes: motion, contacts with their impulses, settings and sums. Snapshots hold it, and
//! `scene` has the data that are constant.

pub mod messages;
mod presence;

use std::cmp::Ordering;
use std::ops::Range;
use std::sync::Arc;

use cd_formats::accuracy::AccuracyControl;
use cd_formats::compute::EventAction;
use cd_formats::deforming_cell::CellState;
use cd_formats::field::{FieldModel, PrimaryResponse};
use cd_formats::geometry::periodic_cell::PeriodicCell;
use cd_formats::hollow_radius::RadiusState;
use cd_formats::snapshot::{FallbackState, Ledger, PostproSums};
use cd_formats::wall_mesh::TriangleList;
use rayon::prelude::*;

use crate::geometry::CachedFeature;
use crate::laws::ContactLaw;
use crate::math::{Mat3, PAR_MIN_LEN, Quat, Vec3, local_frame, sort_runs_by_key};
use crate::ranks;
use crate::scene::{
    BodyId, BodyPresence, ContactSides, InteractionRule, LawId, PartId, Scene, SphereId, SurfaceMotion,
};

/// First feature of a contact of polyhedra that was read from a text file without features; the second is a running
/// number. In the next step it is identified with the nearest contact of the same contactors.
pub const UNKNOWN_FEATURE: u32 = u32::MAX;

/// Velocities of all bodies.
#[derive(Debug, Clone, Copy)]
pub struct Velocities<'a> {
    /// Velocities of the centres of mass, m/s.
    pub v: &'a [Vec3],
    /// Angular velocities, rad/s, world frame.
    pub w: &'a [Vec3],
    /// Velocity gradient L of a deforming cell, 1/s: an image at the distance s from its body moves by L s relative to it.
    /// None if images move with their bodies.
    pub gradient: Option<&'a Mat3>,
    /// Motions of the surfaces of walls beyond those of the walls.
    pub surfaces: &'a [SurfaceMotion],
}

cd_formats::index_types! {
    /// Index of a contact in the list of a step, and of its row in the contact problem.
    ContactId(u32);
}

/// A contact found in the contact configuration.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Contact {
    /// Body indices; n points from the antagonist to the candidate.
    pub candidate: BodyId,
    pub antagonist: BodyId,
    /// Numbers of the parts of the two bodies that touch.
    pub part_numbers: ContactSides<u16>,
    /// Touching features; a contact with the same contactors and features in the next step is the same contact.
    pub features: ContactSides<u32>,
    /// Contact point at the candidate, world frame, m.
    pub point: Vec3,
    /// Shift from the antagonist's position to its touched image, m; 0 if the scene is not periodic, and in contacts that
    /// were read from files.
    pub image: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Gap, m, < 0 interpenetrating.
    pub gap: f64,
    /// Share of this contact in the area of its faces, m^2; 0 if the contact has no area.
    pub area: f64,
    pub law: LawId,
}

/// Bodies, numbers of their parts, and features that identify a contact.
pub type ContactKey = (BodyId, BodyId, ContactSides<u16>, ContactSides<u32>);

/// Two contactors that the visibility table lists, the candidate first, and their rule. `I`: type of their indices.
pub type VisiblePair<I = PartId> = ([I; 2], InteractionRule);

/// Cached data of two contactors that were in contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CachedPair {
    /// The candidate first.
    pub parts: [PartId; 2],
    pub memory: CachedFeature,
}

/// Division of the contacts of spheres and plates among ranks: each rank detects, assembles and keeps the contacts whose
/// candidates are in its run of the spheres. The lists of the ranks, one after the other, are the list of one rank.
#[derive(Debug, Clone)]
pub struct CandidateDivision {
    /// First sphere of each rank, and the number of spheres.
    pub cuts: Vec<u32>,
    /// Whether detection may move the cuts, so that ranks have about as many pairs.
    pub can_move_cuts: bool,
    /// Whether cuts have moved, and contacts of the last step are still with the rank that had them.
    pub has_moved_cuts: bool,
}

impl CandidateDivision {
    /// Runs of almost the same number of spheres on each rank.
    pub fn of_equal_runs(spheres: usize) -> Self {
        let size = ranks::communicator().size();
        let cuts = (0..=size).map(|rank| (rank * spheres / size) as u32).collect();
        CandidateDivision { cuts, can_move_cuts: true, has_moved_cuts: false }
    }

    /// Spheres of this rank.
    pub fn own_spheres(&self) -> Range<u32> {
        let rank = ranks::communicator().rank();
        self.cuts[rank]..self.cuts[rank + 1]
    }

    /// Rank that has each of these candidates, which are in order.
    pub fn owners<'a>(
        &'a self,
        scene: &'a Scene,
        candidates: impl Iterator<Item = BodyId> + 'a,
    ) -> impl Iterator<Item = usize> + 'a {
        let first_candidate = |&cut: &u32| scene.spheres.get(cut as usize).copied();
        let is_before = move |cut: &u32, candidate| first_candidate(cut).is_some_and(|first| first <= candidate);
        let later = &self.cuts[1..self.cuts.len() - 1];
        candidates.map(move |candidate| later.partition_point(|cut| is_before(cut, candidate)))
    }
}

/// Cached data of detection about near contactors.
#[derive(Debug, Clone, Default)]
pub struct DetectionCache {
    /// Division of the contacts among ranks; `None` if each rank has all contacts.
    pub division: Option<CandidateDivision>,
    pub neighbours: NeighbourList,
    /// Neighbour pairs of a scene of spheres and plates alone, in the order of their indices.
    pub sphere_pairs: Vec<VisiblePair<SphereId>>,
    /// Neighbour pairs that the visibility table lists, ordered by candidates along Morton's curve, so that the data of
    /// contactors stay in the cache, then by antagonists. Shared with the backup of a step.
    pub pairs: Arc<Vec<VisiblePair>>,
    /// Indices into `pairs`, ordered by the contactors of the pair.
    pub order_by_parts: Arc<Vec<u32>>,
    /// Cached feature of each of these pairs that was in contact.
    pub memories: Vec<CachedFeature>,
    /// Cached features before there are pairs, ordered by contactors.
    pub restored_pairs: Vec<CachedPair>,
    /// Separating axis of each pair; it affects only time.
    pub separations: Vec<SeparatingAxis>,
    /// Triangles of surfaces near spheres, by tasks of pairs; they affect only time.
    pub near_surfaces: Vec<NearSurfaces>,
    /// Positions of the contactors in the last step, and accumulated displacements of their surfaces, m.
    pub last: Vec<(Vec3, Quat)>,
    pub accumulated_travel: Vec<f64>,
}

impl DetectionCache {
    /// Copy of the cached features, without the data that only save time.
    fn features_only(&self) -> Self {
        let DetectionCache { pairs, order_by_parts, memories, restored_pairs, .. } = self;
        DetectionCache {
            pairs: Arc::clone(pairs),
            order_by_parts: Arc::clone(order_by_parts),
            memories: memories.clone(),
            restored_pairs: restored_pairs.clone(),
            ..DetectionCache::default()
        }
    }

    /// Whether the contacts are divided among ranks.
    pub fn is_divided(&self) -> bool {
        self.division.is_some()
    }

    /// Spheres that are candidates of the contacts of this rank.
    pub fn own_spheres(&self, scene: &Scene) -> Range<u32> {
        self.division.as_ref().map_or(0..scene.spheres.len() as u32, CandidateDivision::own_spheres)
    }

    /// Cached features of the pairs that were in contact, ordered by contactors.
    pub fn cached_pairs(&self) -> Vec<CachedPair> {
        let cached_pair = |&k: &u32| CachedPair { parts: self.pairs[k as usize].0, memory: self.memories[k as usize] };
        let touching =
            self.order_by_parts.iter().map(cached_pair).filter(|pair| pair.memory != CachedFeature::default());
        self.restored_pairs.iter().copied().chain(touching).collect()
    }
}

impl PartialEq for DetectionCache {
    fn eq(&self, other: &Self) -> bool {
        self.cached_pairs() == other.cached_pairs()
    }
}

/// Triangles of surfaces near the spheres of one task, ordered by contactors.
#[derive(Debug, Clone, Default)]
pub struct NearSurfaces(Vec<([PartId; 2], TriangleList)>);

impl NearSurfaces {
    /// Triangles near a sphere, of a sphere and a surface; none before the first search.
    pub fn triangles_of(&mut self, parts: &[PartId; 2]) -> &mut TriangleList {
        let index = self.0.binary_search_by_key(parts, |(known, _)| *known).unwrap_or_else(|index| {
            self.0.insert(index, (*parts, TriangleList::default()));
            index
        });
        &mut self.0[index].1
    }

    /// Drops the triangles near a sphere that is far from the surface.
    pub fn remove_triangles(&mut self, parts: &[PartId; 2]) {
        if let Ok(index) = self.0.binary_search_by_key(parts, |(known, _)| *known) {
            self.0.remove(index);
        }
    }
}

/// List of near pairs (Verlet list), valid as long as no body has moved by more than its skin.
#[derive(Debug, Clone, Default)]
pub struct NeighbourList {
    /// All pairs i < j within the distance of [`crate::geometry::near_pairs`], and others.
    pub pairs: Vec<[u32; 2]>,
    /// Centres and reaches at the last rebuild, and the skin of each ball, m.
    pub centres: Vec<Vec3>,
    pub reach: Vec<f64>,
    pub skin: Vec<f64>,
    /// Centres in the last step, m.
    pub last: Vec<Vec3>,
    /// Cells at the last rebuild and in the last step.
    pub cell: PeriodicCell,
    pub last_cell: PeriodicCell,
}

/// Direction along which two contactors were apart, if known.
#[derive(Debug, Clone, Copy)]
pub struct SeparatingAxis {
    /// Direction from the candidate to the antagonist, unit up to rounding.
    pub n: Option<[f32; 3]>,
    /// Distance of the contactors plus the accumulated displacements of their surfaces at that time, m. The present
    /// accumulated displacement reduces the known distance.
    pub valid_travel: f64,
}

impl Default for SeparatingAxis {
    fn default() -> Self {
        SeparatingAxis { n: None, valid_travel: f64::NEG_INFINITY }
    }
}

impl Contact {
    /// Local frame with rows n, t, s; n x t = s.
    pub fn frame(&self) -> [Vec3; 3] {
        local_frame(self.normal)
    }

    /// Key that identifies the contact in another step; contacts are sorted by it.
    pub fn key(&self) -> ContactKey {
        (self.candidate, self.antagonist, self.part_numbers, self.features)
    }

    /// Order of the keys of two contacts, compared in three words.
    #[inline]
    pub fn cmp_by_key(&self, other: &Contact) -> Ordering {
        let words = |contact: &Contact| {
            let &Contact { candidate, antagonist, part_numbers, features, .. } = contact;
            let bodies = u64::from(candidate.0) << 32 | u64::from(antagonist.0);
            let part_numbers = u32::from(part_numbers.candidate) << 16 | u32::from(part_numbers.antagonist);
            (bodies, part_numbers, u64::from(features.candidate) << 32 | u64::from(features.antagonist))
        };
        words(self).cmp(&words(other))
    }
}

/// Status of a contact after the solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ContactStatus {
    #[default]
    NoContact,
    Stick,
    Slide,
}

/// Contacts that a step bonds if they touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BondingMode {
    No,
    /// Contacts without a history: the first step.
    New,
    All,
}

/// Contact with its solution.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SolvedContact {
    pub contact: Contact,
    /// Impulse on the candidate along n, t, s, N s.
    pub impulse: Vec3,
    /// Moment on the candidate of rolling and spinning friction or of a bond along n, t, s, N m s.
    pub moment: Vec3,
    /// Relative velocity along n, t, s at the step's end, m/s.
    pub velocity: Vec3,
    pub status: ContactStatus,
    /// Gap at which the contact was bonded, m; none without a bond.
    pub bond: Option<f64>,
}

/// State of the law of a contact, besides its bond, that a step hands to the next.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LawMemory {
    /// Gap from which the law counts, m.
    pub reference_gap: f64,
    /// Soundness of the interface, 1 without damage; 0 if it is broken or there is none.
    pub soundness: f64,
    /// Sliding of the candidate on the interface, world frame, m.
    pub sliding: Vec3,
}

/// Virials of contacts, summed since the last step after which a snapshot was due.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OutputInterval {
    /// Time at the end of the last step after which a snapshot was due, s.
    pub start: f64,
    /// Pairs of bodies with their virials, ordered by bodies.
    pub pair_virials: Vec<PairVirial>,
}

/// Virial of the contacts of two bodies, summed over a step or an output interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairVirial {
    /// Bodies: candidate and antagonist.
    pub bodies: [BodyId; 2],
    /// Σ r·l, impulses and branches, J s.
    pub virial: f64,
}

impl OutputInterval {
    /// Adds the virials of a step: `lists`, one after the other, ordered by bodies; a pair of bodies may occur several times.
    pub fn add_pair_virials(&mut self, lists: &[Vec<PairVirial>]) {
        let lists: Vec<&[PairVirial]> = lists.iter().filter(|list| !list.is_empty()).map(Vec::as_slice).collect();
        // A task adds to one chunk of the known pairs; its bodies end before the bodies of the next chunk.
        let mut chunk_ends: Vec<[BodyId; 2]> =
            self.pair_virials.chunks(PAIRS_PER_TASK).skip(1).map(|chunk| chunk[0].bodies).collect();
        chunk_ends.push([BodyId(u32::MAX); 2]);
        let add_to_chunk = |(task, chunk): (usize, &mut [PairVirial])| {
            let start = task.checked_sub(1).map(|previous| chunk_ends[previous]);
            let first = start.map_or(0, |start| lists.partition_point(|list| list[list.len() - 1].bodies < start));
            let step_pairs = lists[first..].iter().flat_map(|list| *list);
            let step_pairs = step_pairs.skip_while(|pair| start.is_some_and(|start| pair.bodies < start));
            add_to_pairs(chunk, step_pairs.take_while(|pair| pair.bodies < chunk_ends[task]))
        };
        let new_pairs: Vec<Vec<PairVirial>> = if self.pair_virials.is_empty() {
            vec![add_to_pairs(&mut [], lists.iter().flat_map(|list| *list))]
        } else {
            self.pair_virials.par_chunks_mut(PAIRS_PER_TASK).enumerate().map(add_to_chunk).collect()
        };
        let known_count = self.pair_virials.len();
        new_pairs.into_iter().for_each(|mut pairs| self.pair_virials.append(&mut pairs));
        if self.pair_virials.len() > known_count {
            sort_runs_by_key(&mut self.pair_virials, |pair| pair.bodies);
        }
    }
}

/// Pairs of bodies per task.
const PAIRS_PER_TASK: usize = 1024;

/// Adds the virials of a step to those of known pairs, both ordered by bodies; returns the sums of pairs that are not known.
fn add_to_pairs<'a>(
    known_pairs: &mut [PairVirial],
    step_pairs: impl Iterator<Item = &'a PairVirial>,
) -> Vec<PairVirial> {
    let (mut k, mut new) = (0, Vec::<PairVirial>::new());
    for step_pair in step_pairs {
        while known_pairs.get(k).is_some_and(|pair| pair.bodies < step_pair.bodies) {
            k += 1;
        }
        let known_pair = known_pairs.get_mut(k).filter(|pair| pair.bodies == step_pair.bodies);
        match known_pair.or(new.last_mut().filter(|last| last.bodies == step_pair.bodies)) {
            Some(pair) => pair.virial += step_pair.virial,
            None => new.push(*step_pair),
        }
    }
    new
}

/// Last two evaluations of self-gravity, if it is not evaluated at every step; rows are free bodies.
#[derive(Debug, Clone, PartialEq)]
pub struct GravityHistory {
    /// Steps and times of the evaluations.
    pub record: cd_formats::snapshot::GravityEvaluations,
    /// Acceleration, m/s^2; shared by the states that extrapolate from the same evaluations.
    pub last: Arc<[Vec3]>,
    pub previous: Arc<[Vec3]>,
}

/// Force and torque on a body in a step, world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyLoad {
    pub body: BodyId,
    /// Force at the centre of mass, N.
    pub force: Vec3,
    /// Torque about the centre of mass, N m.
    pub torque: Vec3,
}

/// Data that change during a run. A snapshot holds all of them except `loads` and caches that affect only time.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Number of the last step.
    pub step: u64,
    /// Time at its end, s.
    pub time: f64,
    /// Length of the last step, s; at the start, of the first. The impulses of `contacts` belong to it.
    pub h: f64,
    /// Positions, m.
    pub x: Vec<Vec3>,
    /// Orientations, body to world.
    pub q: Vec<Quat>,
    /// Velocities, m/s.
    pub v: Vec<Vec3>,
    /// Angular velocities, world frame, rad/s.
    pub w: Vec<Vec3>,
    /// Angular momenta about the centres of mass, world frame, kg m²/s, of the bodies of `Scene::turning`. Without torque
    /// they remain bitwise constant; `w` follows from them.
    pub angular_momentum: Vec<Vec3>,
    /// Indices of the bodies along Morton's curve in the last step, from which the next step sorts them; empty at the start.
    /// It affects only time.
    pub order: Vec<u32>,
    /// Contacts of the last step ordered by key; warm start of the next step.
    pub contacts: Vec<SolvedContact>,
    /// Memory of the laws of these contacts; empty if no law of the scene has one.
    pub memories: Vec<LawMemory>,
    /// Attraction at these contacts by laws with cohesion per pair, N; empty if no law has it.
    pub pair_attractions: Vec<f64>,
    pub detection_cache: DetectionCache,
    pub interval: OutputInterval,
    /// Present uniform gravity, m/s^2.
    pub gravity: Vec3,
    /// Fraction of the velocity that is removed at each step's start.
    pub quench: f64,
    /// Present torque on all free bodies together, N m.
    pub torque: Vec3,
    /// Present laws, as `Scene::laws`.
    pub laws: Vec<ContactLaw>,
    /// Response of the primary on an orbit, if its field has one.
    pub primary_response: Option<PrimaryResponse>,
    /// Deforming cell at the end of the last step, if the run has one.
    pub cell: Option<CellState>,
    /// Radii of the hollow cylinders of `Scene::radii` at the end of the last step.
    pub radii: Vec<RadiusState>,
    /// Loads in the next step, set before each step of a step loop; not in snapshots.
    pub loads: Vec<BodyLoad>,
    /// Whether the next step bonds touching contacts: all, as an event requests, or those that no file knows at the
    /// start.
    pub bonding: BondingMode,
    /// Number of events that have happened.
    pub events_done: usize,
    pub attraction: Option<GravityHistory>,
    pub fallback: FallbackState,
    pub ledger: Ledger,
    /// Sums for the files of POSTPRO.DAT.
    pub postpro: PostproSums,
    /// Whether each body is in the run; empty if the run has neither sinks nor sources.
    pub presence: Vec<BodyPresence>,
    /// Velocity of each body that has left, as it left, m/s, 0 of others; empty if the run has no sinks.
    pub exit_velocities: Vec<Vec3>,
    /// Whether bodies have entered after the last step, of which no contacts are known.
    pub bodies_entered: bool,
    /// Time since when all bodies have been at rest, s, if a condition at rest ends the run.
    pub rest_since: Option<f64>,
    /// Choice of options for `target_error`, if the run has it.
    pub accuracy_control: Option<AccuracyControl>,
}

/// Steps between two measurements of the errors of shortcuts.
const DIAGNOSTIC_INTERVAL: u64 = 100;

impl State {
    /// External fields after `span` (s), in which the primary moves without forces.
    pub fn external_fields(&self, scene: &Scene, span: f64) -> Vec<FieldModel> {
        let response = self.primary_response.as_ref().map(|response| response.free_motion(span));
        scene.external_fields(self.time + span, response.as_ref())
    }

    /// Radius of a hollow cylinder that changes, m; 0 of other bodies.
    pub fn radius_of(&self, body: BodyId) -> f64 {
        let own = self.radii.iter().find(|radius| radius.body == body.number());
        own.map_or(0.0, |radius| radius.radius)
    }

    /// [`Self::radius_of`] in the contact configuration of the last step.
    pub fn contact_radius(&self, scene: &Scene, body: BodyId) -> f64 {
        let own = self.radii.iter().find(|radius| radius.body == body.number());
        own.map_or(0.0, |radius| radius.moved_by(-scene.options.theta * self.h).radius)
    }

    /// Velocities of all bodies, without the motion of images and surfaces.
    pub fn velocities(&self) -> Velocities<'_> {
        Velocities { v: &self.v, w: &self.w, gradient: None, surfaces: &[] }
    }

    /// Whether the errors of self-gravity and of the narrow phase are measured in the next step, which is `step_multiple` of `dt`
    /// long.
    pub fn is_diagnostic_step(&self, step_multiple: u64) -> bool {
        self.step.next_multiple_of(DIAGNOSTIC_INTERVAL) < self.step + step_multiple
    }

    /// Memory of the law of a contact of the last step.
    pub fn law_memory(&self, contact: ContactId) -> LawMemory {
        self.memories.get(contact.index()).copied().unwrap_or_default()
    }

    /// Number of contacts with a bond or a liquid bridge.
    pub fn bond_count(&self) -> usize {
        self.contacts.iter().filter(|contact| contact.bond.is_some()).count()
    }

    /// Applies a setting that an event changes; the motion is unchanged.
    pub fn apply_setting(&mut self, action: &EventAction, scene: &Scene) {
        let law_index = |name: &String| scene.law_names.iter().position(|law| law.nickname == *name);
        match action {
            EventAction::SetGravity(gravity) => self.gravity = Vec3::from(*gravity),
            EventAction::SetQuench(quench) => self.quench = *quench,
            EventAction::SetTorque(torque) => self.torque = Vec3::from(*torque),
            EventAction::SetFriction(name, friction) => {
                law_index(name).into_iter().for_each(|k| self.laws[k].set_friction(*friction));
            }
            EventAction::SetCohesion(name, value) => {
                law_index(name).into_iter().for_each(|k| _ = self.laws[k].set_cohesion(*value));
            }
            EventAction::AddSpin(_) | EventAction::AddVelocity(_) | EventAction::Shake { .. } | EventAction::Bond => {}
        }
    }

    /// Whether every number of the contacts is finite; numbers of contacts without force change nothing, but are written.
    pub fn contacts_are_finite(&self) -> bool {
        self.contacts.iter().all(|solved| {
            let SolvedContact { contact, impulse, moment, velocity, .. } = solved;
            let vectors = [&contact.point, &contact.normal, impulse, moment, velocity];
            contact.gap.is_finite() && vectors.iter().all(|v| v.iter().all(|x| x.is_finite()))
        })
    }

    /// Whether every number of the bodies and of the ledger is finite.
    pub fn is_finite(&self) -> bool {
        let are_finite =
            |vectors: &[Vec3]| vectors.par_iter().with_min_len(PAR_MIN_LEN).all(|v| v.iter().all(|x| x.is_finite()));
        let Ledger { energy_start, contact_work, friction_work, outside_work, momentum_scale, .. } = self.ledger;
        let sums = [energy_start, contact_work, friction_work, outside_work, momentum_scale];
        let momenta = [self.ledger.momentum_expected, self.ledger.angular_momentum_expected];
        self.cell.is_none_or(|cell| cell.is_sound())
            && self.radii.iter().all(RadiusState::is_sound)
            && are_finite(&self.x)
            && are_finite(&self.v)
            && are_finite(&self.w)
            && are_finite(&self.angular_momentum)
            && self.q.par_iter().with_min_len(PAR_MIN_LEN).all(|q| q.coords.iter().all(|x| x.is_finite()))
            && sums.iter().chain(momenta.iter().flatten()).all(|x| x.is_finite())
    }
}

/// Backup of the motion of all bodies.
struct MotionBackup {
    v: Vec<Vec3>,
    w: Vec<Vec3>,
    angular_momentum: Vec<Vec3>,
}

/// Backup of the settings that events change.
struct SettingsBackup {
    gravity: Vec3,
    quench: f64,
    torque: Vec3,
    laws: Vec<ContactLaw>,
    bonding: BondingMode,
    events_done: usize,
}

/// Backup of the parts of the state that a step changes before its contacts are solved.
pub struct StateBackup {
    /// Motion, if events or options change it.
    motion: Option<MotionBackup>,
    settings: SettingsBackup,
    attraction: Option<GravityHistory>,
    ledger: Ledger,
    features: DetectionCache,
}

impl StateBackup {
    /// Copies of these parts, as far as events and options change them.
    pub fn new(scene: &Scene, state: &State) -> Self {
        let State { gravity, quench, torque, bonding, events_done, .. } = *state;
        let intervenes = events_done < scene.events.len() || quench > 0.0 || torque != Vec3::zeros();
        StateBackup {
            motion: intervenes.then(|| MotionBackup {
                v: state.v.clone(),
                w: state.w.clone(),
                angular_momentum: state.angular_momentum.clone(),
            }),
            settings: SettingsBackup { gravity, quench, torque, laws: state.laws.clone(), bonding, events_done },
            attraction: state.attraction.clone(),
            ledger: state.ledger.clone(),
            features: state.detection_cache.features_only(),
        }
    }

    /// Restores the state, except for data that only save time.
    pub fn restore_to(self, state: &mut State) {
        if let Some(motion) = self.motion {
            (state.v, state.w, state.angular_momentum) = (motion.v, motion.w, motion.angular_momentum);
        }
        let SettingsBackup { gravity, quench, torque, laws, bonding, events_done } = self.settings;
        (state.gravity, state.quench, state.torque, state.laws) = (gravity, quench, torque, laws);
        (state.bonding, state.events_done) = (bonding, events_done);
        (state.attraction, state.ledger) = (self.attraction, self.ledger);
        state.detection_cache = DetectionCache {
            restored_pairs: self.features.cached_pairs(),
            division: state.detection_cache.division.take(),
            ..DetectionCache::default()
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contacts_are_ordered_by_their_keys() {
        let digit = |k: u32, place: u32| [0, 1, u32::from(u16::MAX)][(k / 3u32.pow(place) % 3) as usize];
        let contact = |k: u32| Contact {
            candidate: BodyId(digit(k, 0) * 65_537),
            antagonist: BodyId(digit(k, 1) * 65_537),
            part_numbers: [digit(k, 2) as u16, digit(k, 3) as u16].into(),
            features: [digit(k, 4) * 65_537, digit(k, 5) * 65_537].into(),
            ..Contact::default()
        };
        let contacts: Vec<Contact> = (0..729).map(contact).collect();
        for (a, b) in contacts.iter().flat_map(|a| contacts.iter().map(move |b| (a, b))) {
            assert_eq!(a.cmp_by_key(b), a.key().cmp(&b.key()));
        }
    }

    #[test]
    fn an_interval_has_each_pair_of_its_steps_once() {
        let of = |rows: &[([u32; 2], f64)]| -> Vec<PairVirial> {
            rows.iter().map(|&(bodies, virial)| PairVirial { bodies: bodies.map(BodyId), virial }).collect()
        };
        let mut interval = OutputInterval::default();
        interval.add_pair_virials(&[of(&[([0, 2], 1.0), ([1, 2], 2.0)]), of(&[]), of(&[([1, 2], 4.0)])]);
        interval.add_pair_virials(&[of(&[])]);
        interval.add_pair_virials(&[of(&[([0, 1], 8.0)]), of(&[([1, 2], 16.0), ([3, 4], 32.0)])]);
        let expected = of(&[([0, 1], 8.0), ([0, 2], 1.0), ([1, 2], 22.0), ([3, 4], 32.0)]);
        assert_eq!(interval.pair_virials, expected);
    }

    #[test]
    fn tasks_add_to_the_pairs_of_an_interval_alike() {
        // Pairs of bodies by number; two contacts a pair, in lists that end between them.
        let pair_virial =
            |pair: u32| PairVirial { bodies: [BodyId(pair / 100), BodyId(pair)], virial: f64::from(pair) };
        let step = |pairs: &[u32]| -> Vec<Vec<PairVirial>> {
            let all: Vec<PairVirial> = pairs.iter().flat_map(|&pair| [pair_virial(pair); 2]).collect();
            all.chunks(3).map(<[_]>::to_vec).collect()
        };
        let (even, thirds): (Vec<u32>, Vec<u32>) =
            ((0..5000).map(|k| 2 * k).collect(), (0..5000).map(|k| 3 * k).collect());
        let mut interval = OutputInterval::default();
        interval.add_pair_virials(&step(&even));
        interval.add_pair_virials(&step(&thirds));
        let pairs = (0..15_000).filter(|k| k % 3 == 0 || k % 2 == 0 && *k < 10_000);
        let count =
            |k: u32| 2.0 * f64::from(u32::from(k.is_multiple_of(3)) + u32::from(k.is_multiple_of(2) && k < 10_000));
        let expected = pairs.map(|k| PairVirial { virial: count(k) * f64::from(k), ..pair_virial(k) });
        assert_eq!(interval.pair_virials, expected.collect::<Vec<_>>());
    }
}
