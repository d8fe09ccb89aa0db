//! Data: what changes during a run.

use std::sync::Arc;

use cd_formats::compute::EventAction;
use cd_formats::snapshot::{FallbackState, Ledger};
use rayon::prelude::*;

use crate::geometry::CachedFeature;
use crate::laws::ContactLaw;
use crate::math::{PAR_MIN_LEN, Quat, Vec3, local_frame};
use crate::scene::{InteractionRule, Scene};

/// First feature of a contact of polyhedra that a text file tells without its features; the second is a running number.
/// In the next step it is the nearest contact of the same contactors.
pub const UNKNOWN_FEATURE: u32 = u32::MAX;

/// A contact found in the contact configuration.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Contact {
    /// Body indices; n points from the antagonist to the candidate.
    pub candidate: u32,
    pub antagonist: u32,
    /// Which contactors of the two bodies.
    pub ranks: (u16, u16),
    /// Features that touch; the same contactors and features next step are the same contact.
    pub features: (u32, u32),
    /// World frame, m; at the candidate.
    pub point: Vec3,
    /// What to add to the antagonist's position for the image of it that is met, m; 0 where the scene does not repeat, and
    /// in contacts that were read.
    pub image: Vec3,
    /// Unit.
    pub normal: Vec3,
    /// m, < 0 interpenetrating.
    pub gap: f64,
    /// Its share of the area in which faces meet, m^2; 0 where none do.
    pub area: f64,
    /// Index into `Scene::laws`.
    pub law: u8,
}

/// What detection keeps of two contactors that were in contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CachedPair {
    /// Indices into `Scene::parts`, the candidate first.
    pub parts: [u32; 2],
    pub memory: CachedFeature,
}

/// What detection knows of near contactors from the last step.
#[derive(Debug, Clone, Default)]
pub struct DetectionCache {
    pub neighbours: NeighbourList,
    /// Those of the neighbours that see each other: by candidates along Morton's curve, so that what contactors are made of
    /// stays in the cache, then by antagonists.
    pub pairs: Vec<([u32; 2], InteractionRule)>,
    /// Their places in the order of candidates.
    pub order: Vec<u32>,
    /// Of each of these pairs that was in contact, what is to be kept of it.
    pub memories: Vec<CachedFeature>,
    /// The same before there are pairs, in the order of their contactors.
    pub restored_pairs: Vec<CachedPair>,
    /// Of each of the pairs; nothing but time depends on it.
    pub separations: Vec<SeparatingAxis>,
    /// Where the contactors were last, and how far their surfaces have moved in all, m.
    pub last: Vec<(Vec3, Quat)>,
    pub accumulated_travel: Vec<f64>,
}

impl DetectionCache {
    /// What is to be kept of pairs that were in contact, in the order of their contactors.
    pub fn cached_pairs(&self) -> Vec<CachedPair> {
        let of_pair = |&k: &u32| CachedPair { parts: self.pairs[k as usize].0, memory: self.memories[k as usize] };
        let kept = self.order.iter().map(of_pair).filter(|kept| kept.memory != CachedFeature::default());
        self.restored_pairs.iter().copied().chain(kept).collect()
    }
}

impl PartialEq for DetectionCache {
    fn eq(&self, other: &Self) -> bool {
        self.cached_pairs() == other.cached_pairs()
    }
}

/// List of near pairs (Verlet list), valid as long as nothing has moved by more than its skin.
#[derive(Debug, Clone, Default)]
pub struct NeighbourList {
    /// All pairs i < j that are as near as [`crate::detect::broad::near_pairs`] asks, and others.
    pub pairs: Vec<[u32; 2]>,
    /// Where things were when they were looked for, how far they reached then, and the skin of each, m.
    pub centres: Vec<Vec3>,
    pub reach: Vec<f64>,
    pub skin: Vec<f64>,
    /// Where they were in the last step, m.
    pub last: Vec<Vec3>,
}

/// A direction along which two contactors were apart, if that is known.
#[derive(Debug, Clone, Copy)]
pub struct SeparatingAxis {
    /// Unit to rounding, from the candidate to the antagonist.
    pub n: Option<[f32; 3]>,
    /// How far they were apart, and the surfaces of both had moved in all: what that is more since, they may be nearer, m.
    pub valid_travel: f64,
}

impl Default for SeparatingAxis {
    fn default() -> Self {
        SeparatingAxis { n: None, valid_travel: f64::NEG_INFINITY }
    }
}

impl Contact {
    /// Rows n, t, s; n x t = s.
    pub fn frame(&self) -> [Vec3; 3] {
        local_frame(self.normal)
    }

    /// What makes it the same contact in another step; contacts are kept in this order.
    pub fn key(&self) -> (u32, u32, (u16, u16), (u32, u32)) {
        (self.candidate, self.antagonist, self.ranks, self.features)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ContactStatus {
    #[default]
    NoContact,
    Stick,
    Slide,
}

/// Which contacts a step bonds if they touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BondingMode {
    No,
    /// Those without a history: the first step.
    New,
    All,
}

/// A contact with what the solver found for it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SolvedContact {
    pub contact: Contact,
    /// Impulse on the candidate along n, t, s, N s.
    pub impulse: Vec3,
    /// Moment on the candidate of rolling and spinning friction along n, t, s, N m s.
    pub moment: Vec3,
    /// Relative velocity along n, t, s at the step's end, m/s.
    pub velocity: Vec3,
    pub status: ContactStatus,
    /// Gap at which the contact was bonded, m; none without a bond.
    pub bond: Option<f64>,
}

/// What contacts have done since the last step that a snapshot is due after.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OutputInterval {
    /// When that step ended, s.
    pub start: f64,
    /// In the order of the bodies.
    pub exchanges: Vec<ContactExchange>,
}

/// What the contacts of two bodies have exchanged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactExchange {
    /// Candidate and antagonist.
    pub bodies: [u32; 2],
    /// Σ r·l, impulses and branches, J s.
    pub virial: f64,
}

impl OutputInterval {
    /// Adds what contacts have exchanged in a step, in the order of their bodies; two bodies may have several contacts.
    pub fn add_exchanges<'a>(&mut self, step: impl Iterator<Item = &'a ContactExchange>) {
        let (mut k, mut new) = (0, Vec::<ContactExchange>::new());
        for exchange in step {
            while self.exchanges.get(k).is_some_and(|known| known.bodies < exchange.bodies) {
                k += 1;
            }
            let known = self.exchanges.get_mut(k).filter(|known| known.bodies == exchange.bodies);
            match known.or(new.last_mut().filter(|last| last.bodies == exchange.bodies)) {
                Some(known) => known.virial += exchange.virial,
                None => new.push(*exchange),
            }
        }
        if !new.is_empty() {
            self.exchanges.append(&mut new);
            self.exchanges.sort_by_key(|exchange| exchange.bodies);
        }
    }
}

/// The last two evaluations of self-gravity, where it is not evaluated at every step; rows are free bodies.
#[derive(Debug, Clone, PartialEq)]
pub struct GravityHistory {
    pub record: cd_formats::snapshot::GravityEvaluations,
    /// m/s^2; shared by the states that extrapolate from the same evaluations.
    pub last: Arc<[Vec3]>,
    pub before: Arc<[Vec3]>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct State {
    pub step: u64,
    /// s
    pub time: f64,
    /// Length of the step that led here, s; at the start, of the first. The impulses of `contacts` belong to it.
    pub h: f64,
    /// Positions, m.
    pub x: Vec<Vec3>,
    /// Orientations, body to world.
    pub q: Vec<Quat>,
    /// Velocities, m/s.
    pub v: Vec<Vec3>,
    /// Angular velocities, world frame, rad/s.
    pub w: Vec<Vec3>,
    /// Angular momenta about the centres of mass, world frame, kg m²/s, of the bodies of `Scene::turning`: while nothing
    /// acts on them they keep every bit, and `w` follows from them.
    pub angular_momentum: Vec<Vec3>,
    /// Bodies along Morton's curve in the last step, from which the next sorts them; empty at the start. Nothing but time
    /// depends on it.
    pub order: Vec<u32>,
    /// The contacts of the last step by key, from which the next step starts.
    pub contacts: Vec<SolvedContact>,
    pub detection_cache: DetectionCache,
    pub interval: OutputInterval,
    /// Uniform gravity now in force, m/s^2.
    pub gravity: Vec3,
    /// Share of velocity taken away at each step's start.
    pub quench: f64,
    /// Torque now in force on all free bodies as one, N m.
    pub torque: Vec3,
    /// Laws now in force, as `Scene::laws`.
    pub laws: Vec<ContactLaw>,
    /// Whether the next step makes bonds of what touches: of everything as an event asks, or of contacts that no
    /// file knows at the start.
    pub bonding: BondingMode,
    /// Events that have happened.
    pub events_done: usize,
    pub attraction: Option<GravityHistory>,
    pub fallback: FallbackState,
    pub ledger: Ledger,
}

/// Steps between two looks at what shortcuts cost in accuracy.
const DIAGNOSTIC_INTERVAL: u64 = 100;

impl State {
    /// Whether the errors of self-gravity and of the narrow phase are looked at in the next step, so many units of `dt` long.
    pub fn is_diagnostic_step(&self, units: u64) -> bool {
        self.step.next_multiple_of(DIAGNOSTIC_INTERVAL) < self.step + units
    }

    /// Contacts that a bond or a liquid bridge holds.
    pub fn bond_count(&self) -> usize {
        self.contacts.iter().filter(|contact| contact.bond.is_some()).count()
    }

    /// Takes over a setting that an event changes; motion is left alone.
    pub fn apply_setting(&mut self, action: &EventAction, scene: &Scene) {
        let law = |name: &String| scene.law_names.iter().position(|law| law.nickname == *name);
        match action {
            EventAction::SetGravity(gravity) => self.gravity = Vec3::from(*gravity),
            EventAction::SetQuench(quench) => self.quench = *quench,
            EventAction::SetTorque(torque) => self.torque = Vec3::from(*torque),
            EventAction::SetFriction(name, friction) => {
                law(name).into_iter().for_each(|k| self.laws[k].set_friction(*friction));
            }
            EventAction::SetCohesion(name, value) => {
                law(name).into_iter().for_each(|k| _ = self.laws[k].set_cohesion(*value));
            }
            EventAction::AddSpin(_) | EventAction::AddVelocity(_) | EventAction::Shake { .. } | EventAction::Bond => {}
        }
    }

    /// Whether every number of the contacts is finite: those of contacts without force decide nothing, but are written.
    pub fn contacts_are_finite(&self) -> bool {
        self.contacts.iter().all(|solved| {
            let SolvedContact { contact, impulse, moment, velocity, .. } = solved;
            let vectors = [&contact.point, &contact.normal, impulse, moment, velocity];
            contact.gap.is_finite() && vectors.iter().all(|v| v.iter().all(|x| x.is_finite()))
        })
    }

    /// Whether every number of the bodies and of the ledger is finite.
    pub fn is_finite(&self) -> bool {
        let finite =
            |vectors: &[Vec3]| vectors.par_iter().with_min_len(PAR_MIN_LEN).all(|v| v.iter().all(|x| x.is_finite()));
        let Ledger { energy_start, contact_work, friction_work, outside_work, momentum_scale, .. } = self.ledger;
        let sums = [energy_start, contact_work, friction_work, outside_work, momentum_scale];
        let momenta = [self.ledger.momentum_expected, self.ledger.angular_momentum_expected];
        finite(&self.x)
            && finite(&self.v)
            && finite(&self.w)
            && finite(&self.angular_momentum)
            && self.q.par_iter().with_min_len(PAR_MIN_LEN).all(|q| q.coords.iter().all(|x| x.is_finite()))
            && sums.iter().chain(momenta.iter().flatten()).all(|x| x.is_finite())
    }
}

/// The parts of the state that a step changes before its contacts are solved, as they were.
pub struct StateBackup {
    /// Velocities, angular velocities and momenta, where events or options change them.
    motion: Option<[Vec<Vec3>; 3]>,
    settings: (Vec3, f64, Vec3, Vec<ContactLaw>, BondingMode, usize),
    attraction: Option<GravityHistory>,
    ledger: Ledger,
    kept: Vec<CachedPair>,
}

impl StateBackup {
    pub fn new(scene: &Scene, state: &State) -> Self {
        let State { gravity, quench, torque, bonding, events_done, .. } = *state;
        let intervenes = events_done < scene.events.len() || quench > 0.0 || torque != Vec3::zeros();
        StateBackup {
            motion: intervenes.then(|| [state.v.clone(), state.w.clone(), state.angular_momentum.clone()]),
            settings: (gravity, quench, torque, state.laws.clone(), bonding, events_done),
            attraction: state.attraction.clone(),
            ledger: state.ledger.clone(),
            kept: state.detection_cache.cached_pairs(),
        }
    }

    /// Makes the state what it was; what only saves time is lost.
    pub fn restore_to(self, state: &mut State) {
        if let Some(motion) = self.motion {
            [state.v, state.w, state.angular_momentum] = motion;
        }
        (state.gravity, state.quench, state.torque, state.laws, state.bonding, state.events_done) = self.settings;
        (state.attraction, state.ledger) = (self.attraction, self.ledger);
        state.detection_cache = DetectionCache { restored_pairs: self.kept, ..DetectionCache::default() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_has_each_pair_of_its_steps_once() {
        let of = |rows: &[([u32; 2], f64)]| -> Vec<ContactExchange> {
            rows.iter().map(|&(bodies, virial)| ContactExchange { bodies, virial }).collect()
        };
        let mut interval = OutputInterval::default();
        interval.add_exchanges(of(&[([0, 2], 1.0), ([1, 2], 2.0), ([1, 2], 4.0)]).iter());
        interval.add_exchanges(of(&[]).iter());
        interval.add_exchanges(of(&[([0, 1], 8.0), ([1, 2], 16.0), ([3, 4], 32.0)]).iter());
        let expected = of(&[([0, 1], 8.0), ([0, 2], 1.0), ([1, 2], 22.0), ([3, 4], 32.0)]);
        assert_eq!(interval.exchanges, expected);
    }
}
