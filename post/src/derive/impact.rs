//! An impact: momentum that the target gains from the projectile, momentum enhancement, and ejecta.

use std::collections::{BTreeMap, BTreeSet};
use std::str::FromStr;

use cd_formats::field::FieldModel;
use cd_formats::geometry::periodic_cell::PeriodicCell;

use crate::derive::crater::{BackMotion, CraterAxis, CraterShape, GrainDisplacement, OldSurface, mean_radius};
use crate::derive::energy::{external_fields, self_gravity_constant};
use crate::derive::fragments::{Fragment, fragments_within};
use crate::derive::motion::AggregateSums;
use crate::derive::orbits::Orbit;
use crate::derive::walls::supported_grains;
use crate::frame::{ContactBody, Frame, Grain};
use crate::math::Vec3;

/// Gap over the smaller radius up to which grains belong to the target's remnant: an impact opens contacts in all of it by
/// some thousandths of the radius, and ejecta are farther from the surface than a tenth after a few radii of their flight.
const REMNANT_GAP: f64 = 0.1;

/// Share of the farthest distance from the axis up to which the surface of a body is measured: farther out, the normal of a
/// ball is more than 60° from the axis.
const BODY_REACH: f64 = 0.866;

/// Share for a bed: the farthest grain of a box is in a corner, and 1/√2 of its distance reaches the middle of a side.
const BED_REACH: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Smallest ratio of the component of the projectile's momentum along an axis to its magnitude for which a ratio along this axis
/// is defined.
const MIN_ALONG_SHARE: f64 = 1e-6;

/// Change of the velocity of a body of a bed, relative to its speed, above which a blow has changed it: rounding of the steps
/// of a flight is far below.
const BLOW_SHARE: f64 = 1e-9;

/// Bodies as the command line gives them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BodyList {
    /// Ranges of numbers in BODIES.DAT, each from the first to the last.
    Numbers(Vec<[u64; 2]>),
    /// Bodies with a first contactor of this colour.
    Colour(String),
}

/// Text that is no list of bodies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BodyListError;

impl std::fmt::Display for BodyListError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("expected numbers of bodies in BODIES.DAT, such as 301 or 301,305-309, or colour:NAME")
    }
}

impl std::error::Error for BodyListError {}

impl FromStr for BodyList {
    type Err = BodyListError;

    fn from_str(text: &str) -> Result<BodyList, BodyListError> {
        if let Some(colour) = text.strip_prefix("colour:") {
            return if colour.trim().is_empty() {
                Err(BodyListError)
            } else {
                Ok(BodyList::Colour(colour.trim().into()))
            };
        }
        let number = |text: &str| text.trim().parse::<u64>().ok().filter(|number| *number > 0);
        let range = |text: &str| {
            let (first, last) = text.split_once('-').unwrap_or((text, text));
            Some([number(first)?, number(last)?]).filter(|[first, last]| first <= last)
        };
        text.split(',').map(range).collect::<Option<_>>().map(BodyList::Numbers).ok_or(BodyListError)
    }
}

impl std::fmt::Display for BodyList {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let range =
            |[first, last]: &[u64; 2]| if first == last { format!("{first}") } else { format!("{first}-{last}") };
        match self {
            BodyList::Numbers(ranges) => f.write_str(&ranges.iter().map(range).collect::<Vec<_>>().join(",")),
            BodyList::Colour(colour) => write!(f, "colour:{colour}"),
        }
    }
}

impl BodyList {
    /// Whether a grain of the frame is one of the bodies.
    fn contains(&self, frame: &Frame, grain: &Grain) -> bool {
        match self {
            BodyList::Numbers(ranges) => ranges.iter().any(|[first, last]| (first..=last).contains(&&grain.id)),
            BodyList::Colour(colour) => frame.meta.colours.get(grain.colour as usize) == Some(colour),
        }
    }
}

/// User's choices about an impact.
#[derive(Debug, Clone, PartialEq)]
pub struct ImpactOptions {
    pub projectile: BodyList,
    /// Bodies of the target; None: all grains but the projectile.
    pub target: Option<BodyList>,
    /// Direction d of `beta`; None: that of the projectile's velocity relative to the target in the
    /// first snapshot.
    pub direction: Option<Vec3>,
    /// Outward normal n of the surface; None: measured.
    pub normal: Option<Vec3>,
    /// Point of the impact, m; None: where a straight trajectory meets the target.
    pub point: Option<Vec3>,
    /// Distance from the remnant's centre of mass up to which grains belong to the target, m. None: the remnant, and fragments
    /// that gravity binds to it; without self-gravity the remnant, and grains within the farthest point of the target in the
    /// first snapshot; of a bed, grains that are not in flight.
    pub target_radius: Option<f64>,
    /// Escape speed, m/s; None: that of the target.
    pub escape_speed: Option<f64>,
}

/// Error of the first snapshot of an impact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImpactError {
    NoProjectile,
    NoTarget,
    /// The projectile is at rest relative to the target.
    NoApproach,
    RotatingAxes,
    /// A target in open space in a periodic cell.
    PeriodicBody,
    /// Flag that has no meaning for a bed.
    BedOption(&'static str),
}

impl ImpactError {
    /// Returns the flag, or the option of the run, that has the fault.
    pub fn option(self) -> &'static str {
        match self {
            ImpactError::NoProjectile | ImpactError::NoApproach => "--projectile",
            ImpactError::NoTarget => "--target",
            ImpactError::RotatingAxes => "fields",
            ImpactError::PeriodicBody => "xperiode",
            ImpactError::BedOption(flag) => flag,
        }
    }

    /// Returns the words for the fault.
    pub fn found(self) -> &'static str {
        match self {
            ImpactError::NoProjectile => "is not in the first snapshot",
            ImpactError::NoTarget => "has no grain in the first snapshot",
            ImpactError::NoApproach => "is at rest relative to the target in the first snapshot",
            ImpactError::RotatingAxes => "has a RotatingFrame",
            ImpactError::PeriodicBody => "is periodic without uniform gravity, or along z",
            ImpactError::BedOption(_) => "is given for a bed",
        }
    }

    /// Returns the words for the valid input.
    pub fn expectation(self) -> &'static str {
        match self {
            ImpactError::NoProjectile => "expected a free body that is in the run from the start",
            ImpactError::NoTarget => "expected free bodies besides the projectile",
            ImpactError::NoApproach => "expected an approaching body",
            ImpactError::RotatingAxes => "expected a run in fixed axes",
            ImpactError::PeriodicBody => "expected a bed, or a target in open space",
            ImpactError::BedOption(_) => "expected a target in open space",
        }
    }
}

impl std::fmt::Display for ImpactError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}; {}", self.option(), self.found(), self.expectation())
    }
}

impl std::error::Error for ImpactError {}

/// Criterion by which a grain belongs to the target after the impact.
#[derive(Debug, Clone, Copy, PartialEq)]
enum TargetCriterion {
    /// It belongs to the remnant, or to a fragment whose two-body orbit about it is an ellipse.
    Bound,
    /// The centre of the grain is nearer to the remnant's centre of mass than this, m.
    Within(f64),
    /// It belongs to the remnant, or its centre is nearer to the remnant's centre of mass than this, m.
    RemnantOrWithin(f64),
    /// The target is a bed, and the grain is not in flight above the old surface.
    Bed {
        /// Level of the old surface along the normal, m.
        level: f64,
        /// Uniform gravity, m/s^2.
        gravity: f64,
    },
}

/// Last known state of a body.
#[derive(Debug, Clone, Copy)]
struct SeenState {
    mass: f64,
    x: Vec3,
    v: Vec3,
}

/// Grain that has left the target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EjectaGrain {
    /// Number of the body in BODIES.DAT.
    pub body: u64,
    /// Mass, kg.
    pub mass: f64,
    /// Velocity at the old surface, relative to the target, m/s.
    pub launch_velocity: Vec3,
    /// Elevation of this velocity above the plane of the old surface at the point of the impact, rad.
    pub elevation: f64,
}

impl EjectaGrain {
    /// Speed at the old surface, m/s.
    pub fn speed(&self) -> f64 {
        self.launch_velocity.norm()
    }
}

/// State of an impact in one snapshot.
#[derive(Debug, Clone, PartialEq)]
pub struct ImpactState {
    /// Time, s.
    pub time: f64,
    /// Mass of the target, kg, with the projectile if this stays.
    pub target_mass: f64,
    /// Momentum that the target has gained, kg m/s.
    pub momentum_gained: Vec3,
    /// Momentum that ejecta and projectile carry away, kg m/s.
    pub momentum_carried: Vec3,
    /// Ejecta, by number.
    pub ejecta: Vec<EjectaGrain>,
    /// Crater; None if there is no surface at the point of the impact.
    pub crater: Option<CraterShape>,
}

/// Momentum enhancement β: ratios of the momentum P that the target gains to the momentum p of the projectile; 1 if all stays
/// in the target, 1 + e for a projectile that rebounds with the restitution e from a target of much larger mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MomentumEnhancement {
    /// (P·d) / (p·d), d the stated direction; NaN if p is across it.
    pub along_direction: f64,
    /// (P·n) / (p·n), n the outward normal; NaN if p is across it. Source: Rivkin et al. (2021).
    pub along_normal: f64,
    /// (P·e) / (p·e), e the direction of the momentum c that ejecta and projectile carry away: 1 - c² / (p·c); 1 if nothing is
    /// carried away. Source: Cheng et al. (2023).
    pub along_ejecta: f64,
    /// P / |p|.
    pub vector: Vec3,
}

/// An impact as the first snapshot defines it, and what the snapshots so far have shown.
pub struct ImpactRun {
    projectile: BTreeSet<u64>,
    target: BTreeSet<u64>,
    criterion: TargetCriterion,
    /// Velocity of the target's centre of mass in the first snapshot, m/s; 0 for a bed.
    target_velocity: Vec3,
    /// Momentum of the projectile relative to the target in the first snapshot, kg m/s; for a bed, as it reaches the surface.
    pub incident: Vec3,
    /// Mass of the projectile, kg.
    pub projectile_mass: f64,
    /// Unit vector d.
    pub direction: Vec3,
    /// Axis of the crater; None if the trajectory misses the target and no point is given.
    pub axis: Option<CraterAxis>,
    /// Escape speed, m/s; NaN if there is none.
    pub escape_speed: f64,
    /// Distance of the point of the impact from the target's centre of mass, m.
    launch_distance: f64,
    /// G, m^3 kg^-1 s^-2; 0 without self-gravity.
    gravity_constant: f64,
    surface: Option<OldSurface>,
    /// Positions of the target's grains in the first snapshot, m.
    first_positions: BTreeMap<u64, Vec3>,
    /// Last known states of the bodies of target and projectile, by number.
    seen: BTreeMap<u64, SeenState>,
    /// Ejecta of a bed so far, which may have fallen back, and the projectile once it rebounds.
    launched: BTreeMap<u64, EjectaGrain>,
    /// Whether another body has touched the projectile so far.
    is_struck: bool,
}

impl ImpactRun {
    /// Reads the target, the projectile and the surface before the impact from the first snapshot.
    ///
    /// Errors if there is no projectile or no target, or in scenes in which momenta or distances are not defined.
    pub fn new(frame: &Frame, options: &ImpactOptions) -> Result<ImpactRun, ImpactError> {
        let is_turning = |field: &FieldModel| matches!(field, FieldModel::RotatingAxes { .. });
        if external_fields(frame).iter().any(is_turning) {
            return Err(ImpactError::RotatingAxes);
        }
        let is_projectile = |grain: &&Grain| options.projectile.contains(frame, grain);
        let projectile: Vec<&Grain> = frame.grains.iter().filter(is_projectile).collect();
        let is_target = |grain: &&Grain| {
            !is_projectile(grain) && options.target.as_ref().is_none_or(|target| target.contains(frame, grain))
        };
        let target: Vec<Grain> = frame.grains.iter().filter(is_target).cloned().collect();
        if projectile.is_empty() {
            return Err(ImpactError::NoProjectile);
        }
        if target.is_empty() {
            return Err(ImpactError::NoTarget);
        }
        let against_gravity = (-Vec3::from(frame.meta.parameters.uniform_gravity)).try_normalize(0.0);
        let cell = frame.cell();
        if against_gravity.is_none() && cell.is_periodic() || cell.periods[2].is_some() {
            return Err(ImpactError::PeriodicBody);
        }
        if against_gravity.is_some() {
            let given = [("--within", options.target_radius.is_some()), ("--normal", options.normal.is_some())];
            if let Some((flag, _)) = given.into_iter().find(|(_, is_given)| *is_given) {
                return Err(ImpactError::BedOption(flag));
            }
        }
        let target_sums = AggregateSums::from_grains(&target);
        let projectile_sums = AggregateSums::from_grains(projectile.iter().copied());
        let target_velocity = if against_gravity.is_some() { Vec3::zeros() } else { target_sums.velocity() };
        let approach = projectile_sums.velocity() - target_velocity;
        let path = approach.try_normalize(0.0).ok_or(ImpactError::NoApproach)?;
        let provisional_normal = |point: Vec3| {
            let outward = (point - target_sums.x).try_normalize(0.0).unwrap_or(-path);
            options.normal.or(against_gravity).unwrap_or(outward)
        };
        let projectile_radius = projectile.iter().map(|grain| grain.radius.powi(3)).sum::<f64>().cbrt();
        let images_about = |point: Vec3| -> Vec<Grain> {
            target.iter().map(|grain| grain.moved_by(-cell.nearest_shift(&(grain.x - point)))).collect()
        };
        let point = options
            .point
            .or_else(|| struck_point(&images_about(projectile_sums.x), projectile_sums.x, path, projectile_radius));
        let axis = point.map(|point| {
            let images = images_about(point);
            let fits_normal = options.normal.is_none() && against_gravity.is_none();
            CraterAxis::fitted_axis(&images, CraterAxis { point, normal: provisional_normal(point) }, fits_normal)
        });
        let surface = axis.and_then(|axis| {
            let images = images_about(axis.point);
            OldSurface::new(&images, axis, measured_reach(&cell, &images, &axis, against_gravity.is_some()))
        });
        let constant = self_gravity_constant(frame);
        let criterion = match (against_gravity, options.target_radius, constant) {
            (Some(up), _, _) => TargetCriterion::Bed {
                level: axis.map_or(f64::NAN, |axis| axis.point.dot(&up)),
                gravity: Vec3::from(frame.meta.parameters.uniform_gravity).norm(),
            },
            (None, Some(distance), _) => TargetCriterion::Within(distance),
            (None, None, Some(constant)) if constant > 0.0 => TargetCriterion::Bound,
            // Nothing binds loose grains: they belong to the target as long as they are where it was.
            (None, None, _) => {
                let farthest_distance = |grain: &Grain| (grain.x - target_sums.x).norm() + grain.bounding_radius();
                TargetCriterion::RemnantOrWithin(target.iter().map(farthest_distance).fold(0.0, f64::max))
            }
        };
        let [a, b, c] = target_sums.semi_axes();
        let target_escape = constant.map_or(f64::NAN, |g| (2.0 * g * target_sums.mass / (a * b * c).cbrt()).sqrt());
        // Velocity with which the projectile reaches the surface under uniform gravity.
        let incident_velocity = match (criterion, axis) {
            (TargetCriterion::Bed { level, gravity }, Some(axis)) => {
                let speed_square_gain = 2.0 * gravity * (projectile_sums.x.dot(&axis.normal) - level).max(0.0);
                let normal_speed = (approach.dot(&axis.normal).powi(2) + speed_square_gain).sqrt();
                with_component(approach, &axis.normal, -normal_speed)
            }
            _ => approach,
        };
        Ok(ImpactRun {
            projectile: projectile.iter().map(|grain| grain.id).collect(),
            target: target.iter().map(|grain| grain.id).collect(),
            criterion,
            target_velocity,
            incident: projectile_sums.mass * incident_velocity,
            projectile_mass: projectile_sums.mass,
            direction: options.direction.unwrap_or(path),
            axis,
            escape_speed: options.escape_speed.unwrap_or(target_escape),
            gravity_constant: constant.unwrap_or(0.0),
            launch_distance: axis.map_or(f64::NAN, |axis| (axis.point - target_sums.x).norm()),
            surface,
            first_positions: target.iter().map(|grain| (grain.id, grain.x)).collect(),
            seen: BTreeMap::new(),
            launched: BTreeMap::new(),
            is_struck: false,
        })
    }

    /// Whether momenta relative to the target depend on more than the impact: on walls, or on fields from outside.
    pub fn has_outside_forces(&self, frame: &Frame) -> bool {
        let on_target = |grain: u64| self.target.contains(&grain);
        let touches_wall = frame
            .active_contacts()
            .filter(|contact| contact.grain_pair().is_none())
            .flat_map(|contact| contact.on_grains())
            .any(|(grain, ..)| on_target(frame.grains[grain].id));
        !self.is_bed() && (touches_wall || !frame.meta.parameters.fields.is_empty())
    }

    /// Whether the target is a bed under uniform gravity.
    pub fn is_bed(&self) -> bool {
        matches!(self.criterion, TargetCriterion::Bed { .. })
    }

    /// Returns the state in a snapshot; snapshots are given in their order, beginning with the first.
    pub fn next_state(&mut self, frame: &Frame) -> ImpactState {
        let fragments = fragments_within(frame, REMNANT_GAP);
        let remnant = self.remnant_index(frame, &fragments);
        let remnant_sums = self.participant_sums(frame, fragments.get(remnant));
        let mut present = BTreeSet::new();
        for grain in &frame.grains {
            if self.is_participant(grain.id) {
                self.seen.insert(grain.id, SeenState { mass: grain.mass, x: grain.x, v: grain.v });
                present.insert(grain.id);
            }
        }
        self.is_struck |= self.is_projectile_struck(frame);
        for grain in &frame.departed {
            if !self.is_participant(grain.id) {
                continue;
            }
            let state = SeenState { mass: grain.mass, x: grain.x, v: grain.v };
            self.is_struck |= self.projectile.contains(&grain.id) && self.has_blow_changed(&state, grain.id);
            self.seen.insert(grain.id, state);
        }
        let outside = match self.criterion {
            TargetCriterion::Bed { level, .. } => self.bodies_in_flight(frame, &fragments, level),
            _ => self.bodies_outside(frame, &fragments, remnant, &remnant_sums),
        };
        let launched = outside.iter().map(|body| self.launched_grain(*body, &remnant_sums)).collect::<Vec<_>>();
        let is_inside = |body: &u64| present.contains(body) && !outside.contains(body);
        let target_states = || self.seen.iter().filter(|(body, _)| is_inside(body)).map(|(_, state)| state);
        let target_mass = target_states().map(|state| state.mass).sum();
        let momentum = |state: &SeenState| state.mass * (state.v - self.target_velocity);
        let crater =
            self.surface.as_ref().map(|surface| surface.crater(&self.surface_grains(frame, &fragments, remnant)));
        let is_projectile = |grain: &EjectaGrain| self.projectile.contains(&grain.body);
        let time = frame.meta.time;
        if !self.is_bed() {
            let (momentum_gained, momentum_carried) =
                (target_states().map(momentum).sum(), outside.iter().map(|body| momentum(&self.seen[body])).sum());
            let ejecta = launched.into_iter().filter(|grain| !is_projectile(grain)).collect();
            return ImpactState { time, target_mass, momentum_gained, momentum_carried, ejecta, crater };
        }
        let thrown = launched.into_iter().filter(|grain| self.is_struck || !is_projectile(grain)).collect::<Vec<_>>();
        self.launched.extend(thrown.into_iter().map(|grain| (grain.body, grain)));
        let leaves = |grain: &&EjectaGrain| self.escape_speed.is_nan() || grain.speed() >= self.escape_speed;
        let mut momentum_carried: Vec3 =
            self.launched.values().filter(leaves).map(|grain| grain.mass * grain.launch_velocity).sum();
        if self.axis.is_none() {
            momentum_carried = Vec3::repeat(f64::NAN);
        } else if !self.is_struck {
            momentum_carried += self.incident;
        }
        let ejecta = self.launched.values().filter(|grain| !self.projectile.contains(&grain.body)).copied().collect();
        ImpactState {
            time,
            target_mass,
            momentum_gained: self.incident - momentum_carried,
            momentum_carried,
            ejecta,
            crater,
        }
    }

    /// Returns the ratios of the momentum that the target has gained to that of the projectile.
    pub fn enhancement(&self, state: &ImpactState) -> MomentumEnhancement {
        let ratio = |axis: &Vec3| {
            let (momentum_gained, incident) = (state.momentum_gained.dot(axis), self.incident.dot(axis));
            if incident.abs() > MIN_ALONG_SHARE * self.incident.norm() { momentum_gained / incident } else { f64::NAN }
        };
        let momentum_carried = state.momentum_carried.norm_squared();
        MomentumEnhancement {
            along_direction: ratio(&self.direction),
            along_normal: self.axis.map_or(f64::NAN, |axis| ratio(&axis.normal)),
            along_ejecta: if momentum_carried == 0.0 {
                1.0
            } else {
                1.0 - momentum_carried / self.incident.dot(&state.momentum_carried)
            },
            vector: state.momentum_gained / self.incident.norm(),
        }
    }

    /// Mass, centre and motion of those grains of a fragment that belong to the target or the projectile.
    fn participant_sums(&self, frame: &Frame, fragment: Option<&Fragment>) -> AggregateSums {
        let grains = fragment.into_iter().flat_map(|fragment| &fragment.grains).map(|&i| &frame.grains[i]);
        AggregateSums::from_grains(grains.filter(|grain| self.is_participant(grain.id)).collect::<Vec<_>>())
    }

    /// Whether a body belongs to the target or to the projectile.
    fn is_participant(&self, body: u64) -> bool {
        self.target.contains(&body) || self.projectile.contains(&body)
    }

    /// Index of the fragment with the largest mass of the target.
    fn remnant_index(&self, frame: &Frame, fragments: &[Fragment]) -> usize {
        let target_mass = |fragment: &Fragment| -> f64 {
            let grains = fragment.grains.iter().map(|&i| &frame.grains[i]);
            grains.filter(|grain| self.target.contains(&grain.id)).map(|grain| grain.mass).sum()
        };
        let masses: Vec<f64> = fragments.iter().map(target_mass).collect();
        (0..masses.len()).reduce(|best, k| if masses[k] > masses[best] { k } else { best }).unwrap_or(0)
    }

    /// Whether another body touches the projectile, or has done so since the snapshot before.
    fn is_projectile_struck(&self, frame: &Frame) -> bool {
        let is_projectile =
            |body: ContactBody| body.grain_id().is_some_and(|grain| self.projectile.contains(&frame.grains[grain].id));
        let is_blow = |bodies: [ContactBody; 2]| is_projectile(bodies[0]) != is_projectile(bodies[1]);
        let mut touching = frame.active_contacts().map(|contact| [contact.candidate, contact.antagonist]);
        touching.any(is_blow) || frame.interval.touched_pairs.iter().any(|pair| is_blow(pair.bodies))
    }

    /// Whether the velocity of a body of a bed has changed by more than gravity since it was last seen: across the normal, or
    /// outwards along it.
    fn has_blow_changed(&self, state: &SeenState, body: u64) -> bool {
        let (Some(CraterAxis { normal, .. }), Some(before)) = (self.axis, self.seen.get(&body)) else { return false };
        let change = state.v - before.v;
        let (outward, rounding) = (change.dot(&normal), BLOW_SHARE * state.v.norm());
        outward > rounding || (change - normal * outward).norm() > rounding
    }

    /// Bodies that are not in the target, in open space: also those that have left the run.
    fn bodies_outside(
        &self,
        frame: &Frame,
        fragments: &[Fragment],
        remnant: usize,
        remnant_sums: &AggregateSums,
    ) -> BTreeSet<u64> {
        let mut inside = BTreeSet::new();
        for (k, fragment) in fragments.iter().enumerate() {
            let participants: Vec<&Grain> = fragment
                .grains
                .iter()
                .map(|&i| &frame.grains[i])
                .filter(|grain| self.is_participant(grain.id))
                .collect();
            let is_bound = || {
                let sums = self.participant_sums(frame, Some(fragment));
                let velocity = sums.velocity() - remnant_sums.velocity();
                let mu = self.gravity_constant * (remnant_sums.mass + sums.mass);
                Orbit::new(sums.x - remnant_sums.x, velocity, mu, Vec3::z()).is_bound()
            };
            let is_nearer = |grain: &Grain, distance: f64| (grain.x - remnant_sums.x).norm() < distance;
            let belongs = |grain: &Grain| match self.criterion {
                TargetCriterion::Within(distance) => is_nearer(grain, distance),
                TargetCriterion::RemnantOrWithin(distance) => k == remnant || is_nearer(grain, distance),
                TargetCriterion::Bound | TargetCriterion::Bed { .. } => true,
            };
            let can_belong =
                !participants.is_empty() && (k == remnant || self.criterion != TargetCriterion::Bound || is_bound());
            if can_belong {
                inside.extend(participants.into_iter().filter(|grain| belongs(grain)).map(|grain| grain.id));
            }
        }
        self.seen.keys().copied().filter(|body| !inside.contains(body)).collect()
    }

    /// Bodies in flight over a bed: no wall supports them, and their centre is a mean diameter above the level of the old
    /// surface or higher.
    fn bodies_in_flight(&self, frame: &Frame, fragments: &[Fragment], level: f64) -> BTreeSet<u64> {
        let mut is_supported = vec![false; frame.grains.len()];
        supported_grains(frame, fragments).into_iter().for_each(|grain| is_supported[grain.index()] = true);
        let Some(CraterAxis { normal, .. }) = self.axis else { return BTreeSet::new() };
        let clearance = 2.0 * mean_radius(&frame.grains);
        let in_flight = frame.grains.iter().zip(&is_supported).filter(|(grain, is_supported)| {
            !**is_supported && self.is_participant(grain.id) && grain.x.dot(&normal) > level + clearance
        });
        let departed = frame
            .departed
            .iter()
            .filter(|grain| self.seen.contains_key(&grain.id) && grain.x.dot(&normal) > level + clearance);
        in_flight.map(|(grain, _)| grain.id).chain(departed.map(|grain| grain.id)).collect()
    }

    /// Last known state of a body in free flight, traced back to the old surface.
    ///
    /// In the uniform gravity g of a bed the vertical component there is √(v_n² + 2 g h) at the height h above the level, and
    /// the horizontal ones are unchanged. About a remnant of mass M the speed is √(v² + 2 G M (1/R - 1/r)), R and r the
    /// distances of the point of the impact and of the body from its centre; the direction is that of the snapshot.
    fn launched_grain(&self, body: u64, remnant: &AggregateSums) -> EjectaGrain {
        let SeenState { mass, x, v } = self.seen[&body];
        let normal = self.axis.map_or(Vec3::repeat(f64::NAN), |axis| axis.normal);
        let launch_velocity = if let TargetCriterion::Bed { level, gravity } = self.criterion {
            let speed_square_gain = 2.0 * gravity * (x.dot(&normal) - level).max(0.0);
            with_component(v, &normal, (v.dot(&normal).powi(2) + speed_square_gain).sqrt())
        } else {
            let relative = v - remnant.velocity();
            let inverse_distance_difference = 1.0 / self.launch_distance - 1.0 / (x - remnant.x).norm();
            let speed_square_gain = if inverse_distance_difference > 0.0 {
                2.0 * self.gravity_constant * remnant.mass * inverse_distance_difference
            } else {
                0.0
            };
            let square = relative.norm_squared();
            if square > 0.0 { relative * ((square + speed_square_gain) / square).sqrt() } else { relative }
        };
        let share = normal.dot(&launch_velocity) / launch_velocity.norm();
        EjectaGrain { body, mass, launch_velocity, elevation: share.clamp(-1.0, 1.0).asin() }
    }

    /// Grains of the target that form its surface, moved back to where the target was.
    fn surface_grains(&self, frame: &Frame, fragments: &[Fragment], remnant: usize) -> Vec<Grain> {
        let Some(axis) = self.axis else { return Vec::new() };
        let mut grains: Vec<&Grain> =
            fragments.get(remnant).into_iter().flat_map(|f| &f.grains).map(|&i| &frame.grains[i]).collect();
        if self.is_bed() {
            let supported = supported_grains(frame, fragments);
            if !supported.is_empty() {
                grains = supported.into_iter().map(|i| &frame.grains[i]).collect();
            }
        }
        grains.retain(|grain| self.target.contains(&grain.id));
        if self.is_bed() {
            let cell = frame.cell();
            return grains.iter().map(|grain| grain.moved_by(-cell.nearest_shift(&(grain.x - axis.point)))).collect();
        }
        let displacement = |grain: &&&Grain| {
            let before = self.first_positions[&grain.id];
            GrainDisplacement { mass: grain.mass, old_position: before, new_position: grain.x }
        };
        // Mean of the first positions: the side beyond it is the far side.
        let middle = self.first_positions.values().sum::<Vec3>() / self.first_positions.len() as f64;
        let is_far = |grain: &&&Grain| (self.first_positions[&grain.id] - middle).dot(&axis.normal) < 0.0;
        let far: Vec<GrainDisplacement> = grains.iter().filter(is_far).map(|grain| displacement(&grain)).collect();
        let back = BackMotion::least_squares(&far);
        grains.iter().map(|grain| back.moved_grain(grain)).collect()
    }
}

/// Vector with another component along a unit vector.
fn with_component(v: Vec3, axis: &Vec3, component: f64) -> Vec3 {
    v + axis * (component - v.dot(axis))
}

/// Point at which a ball that moves from `start` along the unit vector `path` first touches a grain, on the grain's surface;
/// grains count as spheres of equal volume. None if it misses all.
fn struck_point(grains: &[Grain], start: Vec3, path: Vec3, radius: f64) -> Option<Vec3> {
    let travel_to = |grain: &Grain| {
        let (arm, distance) = (grain.x - start, grain.radius + radius);
        let along = arm.dot(&path);
        let half_chord = (distance * distance - (arm.norm_squared() - along * along)).sqrt();
        // The roots of squares below zero, NaN, are misses.
        (along + half_chord >= 0.0).then_some(along - half_chord)
    };
    let touches = grains.iter().filter_map(|grain| Some((travel_to(grain)?, grain)));
    let (travel, grain) = touches.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let outward = (start + path * travel - grain.x).try_normalize(0.0)?;
    Some(grain.x + outward * grain.radius)
}

/// Distance from the axis up to which the surface of a target is measured, m.
fn measured_reach(cell: &PeriodicCell, grains: &[Grain], axis: &CraterAxis, is_bed: bool) -> f64 {
    let distance = |grain: &Grain| {
        let arm = grain.x - axis.point;
        (arm - axis.normal * arm.dot(&axis.normal)).norm()
    };
    let farthest = grains.iter().map(distance).fold(0.0, f64::max);
    let largest = grains.iter().map(Grain::bounding_radius).fold(0.0, f64::max);
    // Grains farther than half a period from the axis are nearer to an image of it.
    let half_period = |period: &f64| 0.5 * period - largest;
    let share = if is_bed { BED_REACH } else { BODY_REACH };
    cell.periods.iter().flatten().map(half_period).fold(share * farthest, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    fn options(projectile: &str) -> ImpactOptions {
        ImpactOptions {
            projectile: projectile.parse().unwrap(),
            target: None,
            direction: None,
            normal: None,
            point: None,
            target_radius: None,
            escape_speed: None,
        }
    }

    fn set_velocity(scene: &mut Scene, row: usize, v: [f64; 3]) {
        scene.snapshot.bodies.body_v[row] = v;
    }

    #[track_caller]
    fn assert_near(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() <= tolerance, "found {found}, expected {expected} within {tolerance:e}");
    }

    /// A block of 5 x 5 x 5 touching balls of radius 1 that moves, and a ball of radius 0.5 above its middle, as the last body.
    fn block(drift: [f64; 3]) -> Scene {
        let mut scene = Scene::default();
        for k in 0..125 {
            let x = [k % 5, k / 5 % 5, k / 25].map(|k| 2.0 * f64::from(k) - 4.0);
            let row = scene.grain(x, 1.0);
            set_velocity(&mut scene, row, drift);
        }
        scene.grain([0.0, 0.0, 5.0 + 0.5 + 3.0], 0.5);
        scene
    }

    /// Momentum enhancement after a blow along -z at speed 8, of a block that moves: velocities of projectile and target in
    /// the end relative to the block before, and the position of the projectile.
    fn beta_after(shot: f64, target: f64, height: f64) -> MomentumEnhancement {
        let drift = [0.3, -0.2, 0.1];
        let mut scene = block(drift);
        set_velocity(&mut scene, 125, [drift[0], drift[1], drift[2] - 8.0]);
        let mut run = ImpactRun::new(&scene.frame(), &options("126")).unwrap();
        let before = run.next_state(&scene.frame());
        assert!(before.momentum_gained.norm() < 1e-12 * run.incident.norm()); // rounding of sums
        (0..125).for_each(|row| set_velocity(&mut scene, row, [drift[0], drift[1], drift[2] + target]));
        set_velocity(&mut scene, 125, [drift[0], drift[1], drift[2] + shot]);
        scene.snapshot.bodies.body_x[125][2] = height;
        let after = run.next_state(&scene.frame());
        let momentum = run.incident - after.momentum_gained - after.momentum_carried;
        // Rounding of sums over a hundred grains.
        assert!(momentum.norm() < 1e-12 * run.incident.norm(), "{momentum:?}");
        run.enhancement(&after)
    }

    #[test]
    fn a_perfectly_inelastic_catch_has_one_and_a_rebound_one_plus_restitution() {
        // Masses: balls of radius 1/2 and 1, the lighter one over 125 of the others.
        let ratio = 0.125 / 125.0;
        let common = -8.0 * ratio / (1.0 + ratio);
        let caught = beta_after(common, common, 5.5);
        for beta in [caught.along_direction, caught.along_normal, -caught.vector.z] {
            assert_near(beta, 1.0, 1e-12); // rounding of sums
        }
        assert_eq!(caught.along_ejecta, 1.0);
        for e in [0.0, 0.3, 1.0] {
            let target = common * (1.0 + e);
            let rebound = beta_after(target + 8.0 * e, target, 60.0);
            // 1 + e of a target of infinite mass.
            for beta in [rebound.along_direction, rebound.along_normal, rebound.along_ejecta, -rebound.vector.z] {
                assert_near(beta, (1.0 + e) / (1.0 + ratio), 1e-12);
            }
            assert_near(rebound.vector.x, 0.0, 1e-12);
        }
    }

    #[test]
    fn an_oblique_impact_has_other_ratios_along_other_axes() {
        // The target takes all of the incident momentum (3, 0, -4), and the recoil of what leaves along z with 8.
        let mut scene = block([0.0; 3]);
        let mass = scene.snapshot.bodies.body_mass[125];
        set_velocity(&mut scene, 125, [3.0, 0.0, -4.0]);
        scene.snapshot.bodies.body_x[125] = [-3.0, 0.0, 9.5];
        let chosen = ImpactOptions { direction: Some(Vec3::x()), ..options("126") };
        let mut run = ImpactRun::new(&scene.frame(), &chosen).unwrap();
        run.next_state(&scene.frame());
        set_velocity(&mut scene, 125, [0.0; 3]);
        let grain = scene.snapshot.bodies.body_mass[0];
        (0..124).for_each(|row| {
            set_velocity(&mut scene, row, [3.0 * mass / grain / 124.0, 0.0, -12.0 * mass / grain / 124.0])
        });
        set_velocity(&mut scene, 124, [0.0, 0.0, 8.0 * mass / grain]);
        scene.snapshot.bodies.body_x[124][2] = 90.0;
        scene.snapshot.bodies.body_x[125] = [0.0, 0.0, 5.5];
        let state = run.next_state(&scene.frame());
        let beta = run.enhancement(&state);
        assert_near(beta.along_direction, 1.0, 1e-12);
        // The surface of a lattice is level to a degree or so at the middle of a face.
        assert!(run.axis.unwrap().normal.z > 0.999, "{:?}", run.axis);
        assert_near(beta.along_normal, 3.0, 0.1);
        assert_near(beta.along_ejecta, 3.0, 1e-12);
        assert!((beta.vector - Vec3::new(0.6, 0.0, -2.4)).norm() < 1e-12, "{:?}", beta.vector);
        assert_eq!(state.ejecta.len(), 1);
        assert_near(state.ejecta[0].speed(), 8.0 * mass / grain, 0.1);
        assert_near(state.ejecta[0].elevation.to_degrees(), 90.0, 3.0);
        // Across the momentum no ratio is defined.
        let across = ImpactOptions { direction: Some(Vec3::y()), ..options("126") };
        let run = ImpactRun::new(&block([0.0, 0.0, 1.0]).frame(), &across).unwrap();
        assert!(run.enhancement(&state).along_direction.is_nan());
    }

    #[test]
    fn bound_ejecta_belong_to_the_target_and_others_have_their_speed_at_the_surface() {
        let mut scene = Scene::self_gravitating(1.0);
        let planet = scene.grain([0.0; 3], 5.0);
        scene.grain([0.0, 0.0, 5.3], 0.3);
        let shot = scene.grain([0.0, 0.0, 20.0], 0.5);
        let [fast, slow] = [30.0, -30.0].map(|x| scene.grain([x, 0.0, 5.0], 0.3));
        set_velocity(&mut scene, shot, [0.0, 0.0, -9.0]);
        let mut run = ImpactRun::new(&scene.frame(), &options("3")).unwrap();
        let escape = (2.0 * scene.snapshot.bodies.body_mass[planet] / 30f64.hypot(5.0)).sqrt();
        for (row, factor, side) in [(fast, 1.01, 1.0), (slow, 0.9, -1.0)] {
            set_velocity(&mut scene, row, [side * factor * escape, 0.0, 0.0]);
        }
        let state = run.next_state(&scene.frame());
        // The projectile is not counted as ejecta.
        assert_eq!(state.ejecta.iter().map(|grain| grain.body as usize - 1).collect::<Vec<_>>(), [fast]);
        let masses = &scene.snapshot.bodies.body_mass;
        assert_near(state.target_mass, masses[0] + masses[1] + masses[slow], 1e-12 * masses[0]);
        // Energy: v^2/2 - M/r is that at the point of the impact, some 5.6 from the centre; the remnant has both grains there.
        let (mass, distance) = (masses[0] + masses[1], (run.axis.unwrap().point).norm());
        let expected = ((1.01 * escape).powi(2) + 2.0 * mass * (1.0 / distance - 1.0 / 30f64.hypot(5.0))).sqrt();
        assert_near(state.ejecta[0].speed() / expected, 1.0, 0.02); // the remnant moves and its centre is not the planet's
        assert!(run.escape_speed > 0.0);
        // Within a stated distance the slow one is outside, too.
        let near = ImpactOptions { target_radius: Some(20.0), ..options("3") };
        let mut run = ImpactRun::new(&scene.frame(), &near).unwrap();
        assert_eq!(run.next_state(&scene.frame()).ejecta.len(), 2);
    }

    /// A bed of touching balls of radius 1 over a floor, with its surface at z = 1, and a ball of radius 0.5 as the last body.
    fn bed() -> (Scene, usize) {
        let mut scene = Scene::default();
        scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -2.0];
        let floor = scene.plate([0.0, 0.0, -1.5], [90.0, 90.0, 0.5]);
        for (i, j) in (-8..=8).flat_map(|i| (-8..=8).map(move |j| (2.0 * f64::from(i), 2.0 * f64::from(j)))) {
            let grain = scene.grain([i, j, 0.0], 1.0);
            scene.contact_at(grain, floor, [i, j, -1.0], Vec3::z());
        }
        let shot = scene.grain([0.0, 0.0, 9.0], 0.5);
        (scene, shot)
    }

    #[test]
    fn ejecta_of_a_bed_have_the_speed_at_which_they_left_it() {
        let (mut scene, shot) = bed();
        set_velocity(&mut scene, shot, [0.0, 0.0, -10.0]);
        let chosen = options(&format!("{}", shot + 1));
        let mut run = ImpactRun::new(&scene.frame(), &chosen).unwrap();
        let level = run.axis.unwrap().point.z;
        assert!((0.5..=1.0).contains(&level), "{level}");
        let mass = scene.snapshot.bodies.body_mass[shot];
        let arrival = (100.0 + 4.0 * (9.0 - level)).sqrt();
        assert_near(run.incident.z, -mass * arrival, 1e-12 * mass * arrival);
        let before = run.next_state(&scene.frame());
        assert!(run.is_bed() && before.ejecta.is_empty());
        assert_eq!(run.enhancement(&before).along_direction, 0.0);
        // The projectile rebounds with half of its speed, and is seen on its way down at a height of 4; a grain flies at 45°.
        let launch = 0.5 * arrival;
        let falling = (launch * launch - 4.0 * 4.0).sqrt();
        scene.snapshot.bodies.body_x[shot][2] = level + 4.0;
        set_velocity(&mut scene, shot, [0.0, 0.0, -falling]);
        scene.snapshot.meta.time = 1.0;
        scene.since(0.0, &[([shot as u32, 140], 1.0)]);
        let grain = 40;
        scene.snapshot.bodies.body_x[grain][2] = level + 4.0;
        set_velocity(&mut scene, grain, [5.0, 0.0, 3.0]);
        scene.snapshot.contacts.contact_impulse[grain - 1] = [0.0; 3];
        let state = run.next_state(&scene.frame());
        assert_eq!(state.ejecta.len(), 1);
        assert_near(state.ejecta[0].speed(), 50f64.sqrt(), 1e-12);
        assert_near(state.ejecta[0].elevation.to_degrees(), 45.0, 1e-10);
        let beta = run.enhancement(&state);
        let recoil = 5.0 * scene.snapshot.bodies.body_mass[grain] / (mass * arrival);
        assert_near(beta.along_normal, 1.5 + recoil, 1e-12);
        assert_near(beta.vector.x, -recoil, 1e-12);
        // Ejecta that have fallen back keep their record; below the escape speed they carry no momentum away.
        scene.snapshot.bodies.body_x[grain][2] = 0.0;
        assert_eq!(run.next_state(&scene.frame()).ejecta, state.ejecta);
        let (mut scene, shot) = bed();
        set_velocity(&mut scene, shot, [0.0, 0.0, -10.0]);
        let mut run = ImpactRun::new(&scene.frame(), &ImpactOptions { escape_speed: Some(9.0), ..chosen }).unwrap();
        scene.snapshot.meta.time = 1.0;
        scene.since(0.0, &[([shot as u32, 140], 1.0)]);
        scene.snapshot.bodies.body_x[shot][2] = 0.0;
        scene.snapshot.bodies.body_x[grain][2] = level + 4.0;
        set_velocity(&mut scene, grain, [5.0, 0.0, 3.0]);
        scene.snapshot.contacts.contact_impulse[grain - 1] = [0.0; 3];
        let state = run.next_state(&scene.frame());
        assert_eq!((state.ejecta.len(), run.enhancement(&state).along_normal), (1, 1.0));
    }

    #[test]
    fn bodies_that_have_left_the_run_keep_their_momentum() {
        let mut scene = block([0.0; 3]);
        set_velocity(&mut scene, 125, [0.0, 0.0, -8.0]);
        let mut run = ImpactRun::new(&scene.frame(), &options("126")).unwrap();
        scene.snapshot.bodies.body_x[3] = [0.0, 0.0, 90.0];
        set_velocity(&mut scene, 3, [0.0, 0.0, 2.0]);
        let seen = run.next_state(&scene.frame());
        let mut presence = vec![1; 126];
        presence[3] = 2;
        scene.snapshot.presence = Some(cd_formats::snapshot::PresenceArrays { body_presence: presence });
        let removed = run.next_state(&scene.frame());
        assert_eq!(
            (removed.momentum_carried, removed.ejecta.len(), removed.target_mass),
            (seen.momentum_carried, 1, seen.target_mass)
        );
        // With the velocity with which it left, also if a blow has changed that since the last snapshot.
        let mut body_exit_v = vec![[0.0; 3]; 126];
        body_exit_v[3] = [0.0, 0.0, 5.0];
        scene.snapshot.departures = Some(cd_formats::snapshot::DepartureArrays { body_exit_v });
        let removed = run.next_state(&scene.frame());
        let gain = removed.momentum_carried - seen.momentum_carried;
        let mass = scene.snapshot.bodies.body_mass[3];
        assert!((gain - Vec3::new(0.0, 0.0, 3.0 * mass)).norm() < 1e-12 * mass, "{gain}"); // rounding of sums
        assert_eq!(removed.ejecta[0].launch_velocity.z, 5.0);
    }

    #[test]
    fn scenes_without_an_impact_are_rejected() {
        let scene = block([0.0; 3]);
        let fault = |scene: &Scene, options: &ImpactOptions| ImpactRun::new(&scene.frame(), options).err();
        assert_eq!(fault(&scene, &options("127")), Some(ImpactError::NoProjectile));
        assert_eq!(fault(&scene, &options("colour:GREEN")), Some(ImpactError::NoProjectile));
        assert_eq!(fault(&scene, &options("1-126")), Some(ImpactError::NoTarget));
        assert_eq!(fault(&scene, &options("126")), Some(ImpactError::NoApproach));
        let mut moving = block([0.0; 3]);
        set_velocity(&mut moving, 125, [0.0, 0.0, -1.0]);
        assert_eq!(fault(&moving, &options("126")), None);
        moving.snapshot.meta.parameters.xperiode = Some(40.0);
        assert_eq!(fault(&moving, &options("126")), Some(ImpactError::PeriodicBody));
        moving.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -1.0];
        assert_eq!(fault(&moving, &options("126")), None);
        let within = ImpactOptions { target_radius: Some(1.0), ..options("126") };
        assert_eq!(fault(&moving, &within), Some(ImpactError::BedOption("--within")));
        moving.snapshot.meta.parameters.fields =
            vec![cd_formats::compute::ExternalField::RotatingFrame { rate: [0.0, 0.0, 1.0], centre: [0.0; 3] }];
        assert_eq!(fault(&moving, &options("126")), Some(ImpactError::RotatingAxes));
        // One that misses has no axis.
        let mut wide = block([0.0; 3]);
        set_velocity(&mut wide, 125, [0.0, 1.0, 0.0]);
        let mut run = ImpactRun::new(&wide.frame(), &options("126")).unwrap();
        assert!(run.axis.is_none() && run.next_state(&wide.frame()).crater.is_none());
    }

    #[test]
    fn lists_of_bodies_are_numbers_ranges_or_a_colour() {
        let list = |text: &str| text.parse::<BodyList>().ok();
        assert_eq!(list("12"), Some(BodyList::Numbers(vec![[12, 12]])));
        assert_eq!(list("12,20-25").unwrap().to_string(), "12,20-25");
        assert_eq!(list("colour:IRONx"), Some(BodyList::Colour("IRONx".into())));
        for wrong in ["", "0", "a", "5-3", "1,,2", "-3", "colour:", "1-2-3"] {
            assert_eq!(list(wrong), None, "{wrong}");
        }
    }
}
