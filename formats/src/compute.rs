//! `DATBOX/COMPUTE.RON`: values that LMGC90 keeps in the user's command script - the time step, the solver's settings,
//! self-gravity, output and scheduled events.
//!
//! One table below gives each option's name, type, default, unit and help text. The file's reader, the flags of cd-solve
//! and the documentation are made from it.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::accuracy::ChosenOptions;
pub use crate::accuracy::{Accuracy, Adaptive, TargetErrors};
use crate::deforming_cell::CellControl;
use crate::error::Faults;
use crate::hollow_radius::{RadiusControl, check_radii};
use crate::messages::parse_number;
use crate::names::{number_text, rounded_number};
use crate::orbit::OrbitSpec;
use crate::probe::{EndCondition, FlowNames, Probe, ProbeQuantity, check_probes};
use crate::report::{FaultReport, MAX_MAGNITUDE};
pub use crate::ron_file::from_ron;
use crate::ron_text;
use crate::sinks_and_sources::{Sink, Source, check_sinks_and_sources};

/// Newtonian constant of gravitation, m^3 kg^-1 s^-2 (CODATA 2018 and 2022).
pub const GRAVITATIONAL_CONSTANT: f64 = 6.67430e-11;

/// Largest number of threads; a larger one is probably a mistake, since a machine would spend its time starting them.
pub const MAX_THREADS: usize = 1024;

/// Event at the start of the first step whose time is not before `time`; occurs once or repeatedly.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// s
    pub time: f64,
    /// Interval between repetitions, s, at least a step; without it the event occurs once.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub every: Option<f64>,
    /// Latest time of a repetition, s; default: the end of the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<f64>,
    pub action: EventAction,
}

impl Event {
    /// Event that occurs once, at `time` (s).
    pub fn at_time(time: f64, action: EventAction) -> Event {
        Event { time, every: None, until: None, action }
    }

    /// Number of repetitions up to `end` (s); the first occurrence does not count.
    fn repeat_count(&self, end: f64) -> f64 {
        let every = self.every.unwrap_or(f64::INFINITY);
        let until = self.until.unwrap_or(f64::INFINITY).min(end);
        // The rounding of a time is proportional to it: far from time 0 it is a larger share of an interval.
        let rounding = RELATIVE_ROUNDING.max(SAME_TIME_TOLERANCE * until.abs() / every);
        ((until - self.time) / every + rounding).floor().max(0.0)
    }
}

/// Relative rounding error of decimal numbers and their products, over an interval.
const RELATIVE_ROUNDING: f64 = 1e-9;

/// Largest relative difference of equal times: the rounding of a sum and a product.
const SAME_TIME_TOLERANCE: f64 = 4.0 * f64::EPSILON;

/// Largest number of steps of a run. Times are computed from the number as an f64, which holds integers up to
/// 2^53 = 9.007e15 exactly.
const MAX_STEPS: f64 = 9e15;

/// Largest number of occurrences of an event, since each is stored; a larger one is probably a mistake.
pub const MAX_EVENTS: f64 = 1e6;

/// Events that repeat more than [`MAX_EVENTS`] times up to `end` (s): index in the list, and number of repetitions.
pub fn too_frequent_events(events: &[Event], end: f64) -> impl Iterator<Item = (usize, f64)> {
    events.iter().map(move |event| event.repeat_count(end)).enumerate().filter(|(_, repeats)| *repeats > MAX_EVENTS)
}

/// All occurrences as single events, repetitions up to `end`, s. They are in the order of their times and, at equal times
/// to rounding, in the order of the list. A later end only appends events.
pub fn event_schedule(events: &[Event], end: f64) -> Vec<Event> {
    // Each occurrence with the index of its event in the list.
    let mut occurrences = Vec::new();
    for (index, event) in events.iter().enumerate() {
        let time = |repeat: u64| event.time + event.every.map_or(0.0, |every| every * repeat as f64);
        let repeats = 0..=event.repeat_count(end) as u64;
        occurrences.extend(repeats.map(|repeat| (index, Event::at_time(time(repeat), event.action.clone()))));
    }
    occurrences.sort_by(|(_, a), (_, b)| a.time.total_cmp(&b.time));
    let is_same_time =
        |(_, a): &(usize, Event), (_, b): &(usize, Event)| b.time - a.time <= SAME_TIME_TOLERANCE * b.time.abs();
    occurrences.chunk_by_mut(is_same_time).for_each(|simultaneous| simultaneous.sort_by_key(|(index, _)| *index));
    occurrences.into_iter().map(|(_, event)| event).collect()
}

/// Change that an event makes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum EventAction {
    /// Adds a rigid rotation of all free bodies about their common centre of mass, rad/s.
    AddSpin([f64; 3]),
    /// Sets a constant torque on all free bodies as one rigid body, about their centre of mass, N m.
    SetTorque([f64; 3]),
    /// Adds a velocity to all free bodies, m/s.
    AddVelocity([f64; 3]),
    /// Adds to each free body a random velocity of this RMS, m/s, uniformly distributed in a ball, minus the rigid motion
    /// with their total momentum and angular momentum. Another seed gives other velocities.
    Shake {
        speed: f64,
        #[serde(default)]
        seed: u64,
    },
    /// Sets the uniform gravity, m/s^2.
    SetGravity([f64; 3]),
    /// Sets the option `quench`.
    SetQuench(f64),
    /// Forms bonds at all touching contacts whose law has bonds.
    Bond,
    /// Sets static and dynamic friction of the law of this nickname.
    SetFriction(String, f64),
    /// Sets the cohesion of the law of this nickname, N, Pa or J.
    SetCohesion(String, f64),
}

/// External field that acts on all free bodies, in addition to uniform gravity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum ExternalField {
    /// Attraction by a mass (kg), at rest at a position (m) or on an orbit.
    PointMass {
        mass: f64,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        position: Option<[f64; 3]>,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        orbit: Option<OrbitSpec>,
        /// Whether the mass is attracted by the bodies in turn.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        response: bool,
    },
    /// Attraction by a mass that is oblate about an axis: equatorial radius (m) and zonal harmonic J2.
    Oblate {
        mass: f64,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        position: Option<[f64; 3]>,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        orbit: Option<OrbitSpec>,
        /// Whether the mass is attracted by the bodies in turn.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        response: bool,
        radius: f64,
        j2: f64,
        axis: [f64; 3],
    },
    /// Attraction by the homogeneous body inside a closed surface, at rest or on an orbit.
    Polyhedron {
        /// Name of the OBJ file in DATBOX with the surface, its triangles in any orientation.
        surface: String,
        /// Factor from the lengths of the file to m.
        #[serde(default = "unit_scale")]
        scale: f64,
        /// Density, kg/m^3.
        density: f64,
        /// Position of the origin of the file, m; 0 with an orbit.
        #[serde(default)]
        position: [f64; 3],
        /// Angular velocity about the origin of the file, on an orbit about the centre of mass, rad/s; at time 0 the axes of
        /// the file are those of the scene.
        #[serde(default)]
        rate: [f64; 3],
        /// Orbit of the centre of mass.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        orbit: Option<OrbitSpec>,
        /// Whether the centre of mass is attracted by the bodies in turn.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        response: bool,
    },
    /// Frame that rotates (rad/s) about a point (m): centrifugal and Coriolis force.
    RotatingFrame { rate: [f64; 3], centre: [f64; 3] },
}

fn unit_scale() -> f64 {
    1.0
}

impl ExternalField {
    /// Values that are expected in place of those of the field, if these cannot be used; `gravity_constant`: G in
    /// m^3 kg^-1 s^-2.
    fn invalid_value(&self, gravity_constant: f64) -> Option<&'static str> {
        let are_finite = |vectors: &[&[f64; 3]]| vectors.iter().all(|v| v.iter().all(|x| x.is_finite()));
        let is_positive = |x: f64| x.is_finite() && x > 0.0;
        let expected = "finite values, mass and radius > 0, an axis other than 0";
        let path_fault = |mass: f64, position: &Option<[f64; 3]>, orbit: &Option<OrbitSpec>| match (position, orbit) {
            (Some(position), None) => (!are_finite(&[position])).then_some(expected),
            (None, Some(orbit)) => orbit.invalid_value(gravity_constant * mass),
            _ => Some("either position or orbit"),
        };
        match self {
            ExternalField::PointMass { mass, position, orbit, .. } => {
                if is_positive(*mass) {
                    path_fault(*mass, position, orbit)
                } else {
                    Some(expected)
                }
            }
            ExternalField::Oblate { mass, position, orbit, radius, j2, axis, .. } => {
                let squared_length = axis.iter().map(|x| x * x).sum::<f64>();
                let sound = is_positive(*mass) && is_positive(*radius) && j2.is_finite() && is_positive(squared_length);
                if sound { path_fault(*mass, position, orbit) } else { Some(expected) }
            }
            ExternalField::Polyhedron { surface, scale, density, position, rate, orbit, response: _ } => {
                let sound = is_positive(*scale)
                    && is_positive(*density)
                    && are_finite(&[position, rate])
                    && !surface.is_empty();
                match orbit {
                    _ if !sound => Some("the name of a file, scale and density > 0, finite position and rate"),
                    Some(_) if *position != [0.0; 3] => Some("either position or orbit"),
                    // The mass is known with the surface only; its sign is that of the density.
                    Some(orbit) => orbit.invalid_value(gravity_constant * density),
                    None => None,
                }
            }
            ExternalField::RotatingFrame { rate, centre } => (!are_finite(&[rate, centre])).then_some(expected),
        }
    }

    /// Angular velocity of the axes, rad/s.
    pub fn rotation_rate(&self) -> [f64; 3] {
        if let ExternalField::RotatingFrame { rate, .. } = self { *rate } else { [0.0; 3] }
    }

    /// Period of the rotation of the axes or of a polyhedron, s; infinite if they do not turn.
    pub fn rotation_period(&self) -> f64 {
        match self {
            ExternalField::RotatingFrame { rate, .. } | ExternalField::Polyhedron { rate, .. } => {
                TAU / rate.iter().map(|x| x * x).sum::<f64>().sqrt()
            }
            ExternalField::PointMass { .. } | ExternalField::Oblate { .. } => f64::INFINITY,
        }
    }

    /// Whether the mass of the field is attracted by the bodies in turn.
    pub fn has_response(&self) -> bool {
        match self {
            ExternalField::PointMass { response, .. }
            | ExternalField::Oblate { response, .. }
            | ExternalField::Polyhedron { response, .. } => *response,
            ExternalField::RotatingFrame { .. } => false,
        }
    }

    /// Orbit of a mass that moves.
    pub fn orbit(&self) -> Option<&OrbitSpec> {
        match self {
            ExternalField::PointMass { orbit, .. }
            | ExternalField::Oblate { orbit, .. }
            | ExternalField::Polyhedron { orbit, .. } => orbit.as_ref(),
            ExternalField::RotatingFrame { .. } => None,
        }
    }
}

/// Summation of self-gravity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum GravityMethod {
    /// Every pair.
    Direct,
    /// Fast multipole method.
    Fmm,
    /// The faster of the two for the number of bodies and gravity_error.
    #[default]
    Auto,
}

/// Search for the direction of contact of two polyhedra.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum NarrowPhase {
    /// Starts from the feature of the last step and follows its best neighbours.
    Fast,
    /// Proves that the direction is the best of all, or searches all.
    #[default]
    Accurate,
}

/// Points at which the friction of a face that two polyhedra share acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum FaceFriction {
    /// Points that resist spinning as the pressure under the face does, uniform for a central load.
    #[default]
    Uniform,
    /// Friction at the corners, as in LMGC90.
    Corners,
}

/// Order of impacts of bodies that touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum ImpactOrder {
    /// All at one instant, by Newton's law at each contact.
    #[default]
    Simultaneous,
    /// One after the other, as contacts close.
    InOrder,
}

impl ImpactOrder {
    /// Whether impacts are simultaneous.
    pub fn is_simultaneous(&self) -> bool {
        *self == ImpactOrder::Simultaneous
    }
}

/// Solver of the contact problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum ContactSolver {
    /// Gauss-Seidel sweeps, and the other solvers in turn if a small problem stagnates.
    #[default]
    Auto,
    /// Nonlinear Gauss-Seidel with momentum.
    Nlgs,
    /// Gauss-Seidel on the stored Delassus matrix with Anderson's acceleration.
    NlgsAnderson,
    /// Proximal-point method with semismooth Newton steps.
    ProxNewton,
    /// Alternating direction method of multipliers.
    Admm,
    /// Interior-point method.
    InteriorPoint,
}

/// Floating-point precision of the sweeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum SweepPrecision {
    /// Single precision for 256 contacts or more, if it reaches the tolerance.
    #[default]
    Auto,
    /// Single precision.
    Single,
    /// Double precision.
    Double,
}

impl std::fmt::Display for ContactSolver {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(clap::ValueEnum::to_possible_value(self).as_ref().map_or("", |value| value.get_name()))
    }
}

/// Smallest RMS relative error that the fast multipole method supports.
pub const MIN_FMM_ERROR: f64 = 1e-6;

/// Smallest `gravity_error`: sums over all pairs in f64 are not more accurate.
const MIN_GRAVITY_ERROR: f64 = 1e-14;

macro_rules! options {
    ($($(#[doc = $help:literal])+ $(#[serde($($rule:tt)+)])? $name:ident : $type:ty = $default:expr, $flag:ty, [$($arg:tt)*];)+) => {
        /// The options of a run; see `docs/reference/options.md`.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct Compute {
            $($(#[doc = $help])+ $(#[serde($($rule)+)])? pub $name: $type,)+
            /// Values that the run has chosen for `target_error`; in no file.
            #[serde(skip)]
            pub chosen: ChosenOptions,
        }

        impl Default for Compute {
            fn default() -> Self { Compute { $($name: $default,)+ chosen: ChosenOptions::default() } }
        }

        /// Options as flags; a given flag overrides the file.
        #[derive(Debug, Clone, Default, clap::Args)]
        #[command(next_help_heading = "Options of the run, in place of those in DATBOX/COMPUTE.RON")]
        pub struct ComputeFlags { $($(#[doc = $help])+ #[arg(long, allow_hyphen_values = true, $($arg)*)] pub $name: Option<$flag>,)+ }

        impl ComputeFlags {
            /// Names of the options that are given.
            pub fn given_names(&self) -> Vec<&'static str> {
                let mut names = Vec::new();
                $(if self.$name.is_some() { names.push(stringify!($name)); })+
                names
            }

            /// Options that are given here, and the options of `other` for the rest.
            pub fn or(&self, other: &ComputeFlags) -> ComputeFlags {
                ComputeFlags { $($name: self.$name.clone().or_else(|| other.$name.clone()),)+ }
            }
        }

        impl Compute {
            /// Options with the values of the given flags.
            pub fn with_flags(mut self, flags: &ComputeFlags) -> Self {
                // The end given on the command line overrides that of the file.
                if flags.end_time.is_some() {
                    self.steps = None;
                }
                $(if let Some(value) = &flags.$name { self.$name = value.clone().into(); })+
                self
            }

            /// Name and value of every option, as in the file.
            pub fn option_values(&self) -> Vec<(&'static str, String)> {
                vec![$((stringify!($name), to_ron(&self.$name)),)+]
            }

            /// Name, default and help text of every option, in the order of the file.
            pub fn option_table() -> Vec<(&'static str, String, String)> {
                let default = Compute::default();
                vec![$((
                    stringify!($name),
                    ron::to_string(&default.$name).unwrap_or_default(),
                    [$($help),+].concat().trim().to_string(),
                ),)+]
            }
        }
    };
}

options! {
    /// Time step h, s.
    dt: f64 = 1.0e-3, f64, [value_parser = parse_number, value_name = "S"];
    /// Number of steps to make, counted from the state of DATBOX; takes precedence over end_time.
    steps: Option<u64> = None, u64, [value_name = "N"];
    /// Time at which the run ends, s.
    end_time: Option<f64> = None, f64, [value_parser = parse_number, value_name = "S"];
    /// Weight of the end of the step in the theta scheme, 0.5 to 1: 0.5 conserves the energy of smooth motion, larger values damp it.
    theta: f64 = 0.5, f64, [value_parser = parse_number, value_name = "X"];
    /// Preset for the options that trade speed for accuracy and are not set explicitly: draft, standard, fine or reference. Without a preset these options are those of standard, except that all steps are dt and tol is 1e-2.
    accuracy: Option<Accuracy> = None, Accuracy, [value_enum, value_name = "PRESET"];
    /// Largest relative errors of means over time, such as (pressure: 1e-2), of z, nu, pressure, semi_axes or energy: the run chooses the options that trade speed for accuracy and are not set explicitly. z and pressure are those of `Z_interval` and `pressure_interval`. Not with accuracy.
    #[serde(skip_serializing_if = "Option::is_none")]
    target_error: Option<TargetErrors> = None, TargetErrors, [value_name = "RON"];
    /// Adaptive steps: at most `max_multiple` times dt, as long as bodies move past their neighbours by at most `travel` and into each other by at most `penetration`, in radii: (max_multiple: 16, travel: 0.1, penetration: 1e-3). Default: set by accuracy.
    adaptive: Option<Adaptive> = None, Adaptive, [value_name = "RON"];
    /// Relative tolerance of the contact solver: violation of the contact laws over that without contact impulses, |F(r)|/|F(r_0)|; divided by n in steps of n times dt. Default: set by accuracy.
    tol: Option<f64> = None, f64, [value_parser = parse_number, value_name = "X"];
    /// Largest mean penetration, over the mean radius, that unconverged solutions may leave. If it is p, larger than this, the tolerance is reduced to tol times (penetration_tol/p)², but not below tol/100. Default: set by accuracy.
    penetration_tol: Option<f64> = None, f64, [value_parser = parse_number, value_name = "X"];
    /// Contact solver. nlgs: nonlinear Gauss-Seidel. nlgs-anderson, prox-newton, admm, interior-point: on the stored matrix, for small scenes. auto: nlgs, with the others as fallback if a small problem, or a cluster of contacts in a large one, stagnates.
    solver: ContactSolver = ContactSolver::Auto, ContactSolver, [value_enum, value_name = "SOLVER"];
    /// Largest number of sweeps or iterations for one contact problem; a step that needs more is reported as not converged, and the run continues. A step that solves its problem again, as when contacts begin to close late, reports the sum, which may be larger. Default: set by accuracy.
    max_sweeps: Option<u64> = None, u64, [value_name = "N"];
    /// Number of sweeps between two checks of convergence. Default: chosen from the changes that sweeps make. LMGC90's examples check every 50.
    check_every: Option<u64> = None, u64, [value_name = "N"];
    /// Floating-point precision of the sweeps: single, about twice as fast, or double; auto: single from 256 contacts on if the tolerance is 1e-4 or more. Velocities and residuals are always in double precision.
    sweep_precision: SweepPrecision = SweepPrecision::Auto, SweepPrecision, [value_enum, value_name = "PRECISION"];
    /// Also writes LMGC90's convergence criteria of each step to steps.csv.
    lmgc90_norms: bool = false, bool, [num_args = 0..=1, require_equals = true, default_missing_value = "true", value_name = "BOOL"];
    /// Distance within which contacts are listed, m. Default: that of each row of TACT_BEHAV.DAT.
    alert: Option<f64> = None, f64, [value_parser = parse_number, value_name = "M"];
    /// Search for the direction of contact of two polyhedra. accurate: proves that the direction is the best of all; fast: searches near the direction of the last step. Default: set by accuracy.
    narrow_phase: Option<NarrowPhase> = None, NarrowPhase, [value_enum, value_name = "METHOD"];
    /// Points of faces and edges of polyhedra at which friction resists spinning. uniform: as under a uniform pressure; corners: at their corners, as in LMGC90, where a square resists spinning 1.85 times as much; the default for polyhedra without COMPUTE.RON.
    face_friction: FaceFriction = FaceFriction::Uniform, FaceFriction, [value_enum, value_name = "POINTS"];
    /// Order of impacts of spheres that touch, with laws that have restitution. simultaneous: at one instant, by Newton's law at each contact; in_order: one after the other, so that an impulse passes on through touching spheres.
    #[serde(skip_serializing_if = "ImpactOrder::is_simultaneous")]
    impacts: ImpactOrder = ImpactOrder::Simultaneous, ImpactOrder, [value_enum, value_name = "ORDER"];
    /// Period along x, m (periodic boundary); cannot be combined with self-gravity or fields. Positions are not wrapped.
    xperiode: Option<f64> = None, f64, [value_parser = parse_number, value_name = "M"];
    /// Period along y, m.
    yperiode: Option<f64> = None, f64, [value_parser = parse_number, value_name = "M"];
    /// Period along z, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    zperiode: Option<f64> = None, f64, [value_parser = parse_number, value_name = "M"];
    /// Deformation of a cell with three periods, such as (z: Stress(value: 1e3, gain: 0.1), shear_xz: 1.0): rates of the logarithmic strain or stresses that are held along x, y and z, and shear rates. Default: the cell keeps its shape.
    #[serde(skip_serializing_if = "Option::is_none")]
    cell: Option<CellControl> = None, CellControl, [value_name = "RON"];
    /// Radii of hollow cylinders that change, such as [(body: 7, control: Stress(value: 1e3, gain: 0.1))]: rates of the logarithm of the radius, or pressures on the inside that are held. Default: they are constant.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    radii: Vec<RadiusControl> = Vec::new(), RadiusControls, [value_name = "RON"];
    /// Newtonian attraction between all free bodies.
    self_gravity: bool = false, bool, [num_args = 0..=1, require_equals = true, default_missing_value = "true", value_name = "BOOL"];
    /// Summation of self-gravity. direct: every pair; fmm: fast multipole method; auto: the faster of the two.
    gravity: GravityMethod = GravityMethod::Auto, GravityMethod, [value_enum, value_name = "METHOD"];
    /// Newtonian constant of gravitation, m^3 kg^-1 s^-2.
    gravity_constant: f64 = GRAVITATIONAL_CONSTANT, f64, [value_parser = parse_number, value_name = "X"];
    /// Largest RMS relative error of self-gravity. At least 1e-14; below 1e-6 auto sums every pair. Default: set by accuracy.
    gravity_error: Option<f64> = None, f64, [value_parser = parse_number, value_name = "X"];
    /// Order of the expansions of fmm, 2 to 8. Default: set by gravity_error.
    gravity_order: Option<usize> = None, usize, [value_name = "N"];
    /// Opening angle of fmm, 0 to 1: two cells are far from each other if the sum of their radii is less than this times their distance. Default: set by gravity_error.
    gravity_opening: Option<f64> = None, f64, [value_parser = parse_number, value_name = "X"];
    /// Largest number of steps between two evaluations of self-gravity; it is extrapolated in between. It is evaluated earlier if the extrapolation would err by more than a quarter of gravity_error, or if a body may have moved by gravity_moved. Default: set by accuracy; 1 for fewer than 100 bodies and for direct summation.
    gravity_refresh: Option<u64> = None, u64, [value_name = "N"];
    /// Distance, over the mean radius, that a body may move relative to the mean motion between two evaluations of self-gravity.
    gravity_moved: f64 = 0.25, f64, [value_parser = parse_number, value_name = "X"];
    /// Adds the quadrupole terms of elongated bodies to self-gravity, with forces and torques: of all pairs with direct summation, otherwise of pairs closer than three times the sum of their radii.
    gravity_quadrupole: bool = false, bool, [num_args = 0..=1, require_equals = true, default_missing_value = "true", value_name = "BOOL"];
    /// Self-gravity of all free bodies is that of homogeneous balls of at least this radius, m, by direct summation. Bodies that overlap as balls attract each other less than points. Default: bodies attract as points, except those that may pass through each other.
    gravity_softening: Option<f64> = None, f64, [value_parser = parse_number, value_name = "M"];
    /// Integrates the orientation of spheres, for pictures of rolling. No contact depends on it.
    sphere_orientation: bool = false, bool, [num_args = 0..=1, require_equals = true, default_missing_value = "true", value_name = "BOOL"];
    /// External fields, such as [PointMass(mass: 6e24, position: (1e7, 0.0, 0.0))].
    fields: Vec<ExternalField> = Vec::new(), Fields, [value_name = "RON"];
    /// Damping: fraction of the velocity of every free body that is removed at the start of each step; brings an aggregate to rest. 0: none; --quench without a value: 0.01.
    quench: f64 = 0.0, f64, [value_parser = parse_number, num_args = 0..=1, require_equals = true, default_missing_value = "0.01", value_name = "X"];
    /// Steps between two snapshots.
    output_every: u64 = 100, u64, [value_name = "N"];
    /// Steps between two rows of steps.csv and TIMER.csv. A row sums up the steps since the row before; each snapshot has a row, too.
    log_every: u64 = 1, u64, [value_name = "N"];
    /// Number of threads; 0: all processors. Results do not depend on it.
    threads: usize = 0, usize, [value_name = "N"];
    /// Also writes DOF.OUT.k and Vloc_Rloc.OUT.k in the format of LMGC90.
    text: bool = false, bool, [num_args = 0..=1, require_equals = true, default_missing_value = "true", value_name = "BOOL"];
    /// Scheduled events, as in COMPUTE.RON: [(time: 100.0, action: AddSpin((0.0, 0.0, 1e-5)))].
    events: Vec<Event> = Vec::new(), Events, [value_name = "RON"];
    /// Regions from which free bodies leave the run: [(name: "lost", region: Beyond(centre: (0.0, 0.0, 0.0), radius: 1.0e4))].
    sinks: Vec<Sink> = Vec::new(), Sinks, [value_name = "RON"];
    /// Bodies of DATBOX that enter the run one after the other: [(name: "rain", bodies: Colour("RAINx"), from: 0.0, rate: 0.5)].
    sources: Vec<Source> = Vec::new(), Sources, [value_name = "RON"];
    /// Quantities that are written to POSTPRO/probe-NAME.csv step by step: [(name: "lid", quantity: Force(on: Colour("LIDxx")))].
    probes: Vec<Probe> = Vec::new(), Probes, [value_name = "RON"];
    /// Conditions that end the run before end_time: [AtRest(speed: 1e-4, during: 0.1)].
    until: Vec<EndCondition> = Vec::new(), EndConditions, [value_name = "RON"];
}

/// List given on the command line.
#[derive(Debug, Clone)]
pub struct FlagList<T>(Vec<T>);
/// Events of a run.
pub type Events = FlagList<Event>;
/// External fields of a run.
pub type Fields = FlagList<ExternalField>;
/// Probes of a run.
pub type Probes = FlagList<Probe>;
/// Controls of the radii of hollow cylinders.
pub type RadiusControls = FlagList<RadiusControl>;
/// Sinks of a run.
pub type Sinks = FlagList<Sink>;
/// Sources of a run.
pub type Sources = FlagList<Source>;
/// Conditions that end a run.
pub type EndConditions = FlagList<EndCondition>;

impl<T: serde::de::DeserializeOwned> std::str::FromStr for FlagList<T> {
    type Err = ron_text::FlagError;
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        ron_text::from_flag(text).map(FlagList)
    }
}

impl<T> From<FlagList<T>> for Vec<T> {
    fn from(list: FlagList<T>) -> Self {
        list.0
    }
}

impl Compute {
    /// Reads a file; unknown fields and values out of range are faults.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        let text = crate::atomic::read_text(path)?;
        let compute: Compute = from_ron(path, &text, "options")?;
        let mut report = FaultReport::new(path, &text);
        compute.check_in(&mut report, "");
        report.faults.into_result(compute)
    }

    /// Whether frames of spheres turn: for pictures, or because LMGC90 reads them.
    pub fn orients_spheres(&self) -> bool {
        self.sphere_orientation || self.text
    }

    /// Name and value of every option that the motion of bodies depends on: all except `steps`, `end_time`, `until`,
    /// `probes`, `threads` and `text`. Options of [`OPTIONS_WRITTEN_IF_GIVEN`] are included only if they are given.
    pub fn result_options(&self) -> BTreeMap<String, String> {
        const OPTIONS_OUTSIDE_RESULTS: [&str; 6] = ["steps", "end_time", "until", "probes", "threads", "text"];
        let is_written =
            |name: &str, value: &str| ![NO_VALUE, "[]"].contains(&value) || !OPTIONS_WRITTEN_IF_GIVEN.contains(&name);
        let values = self
            .option_values()
            .into_iter()
            .filter(|(name, value)| !OPTIONS_OUTSIDE_RESULTS.contains(name) && is_written(name, value));
        values.map(|(name, value)| (name.to_string(), value)).collect()
    }

    /// Text of the file: all options.
    pub fn to_text(&self) -> String {
        let pretty = ron::ser::PrettyConfig::new().new_line("\n").depth_limit(2);
        let mut text = String::from("// Options of cd-solve; a flag of the same name takes precedence.\n");
        text += &ron::ser::to_string_pretty(self, pretty).unwrap_or_default();
        text.push('\n');
        text
    }

    /// Checks options that are not read from a text, of the file `source`. Errors: all values that no run could use.
    pub fn check(&self, source: &Path) -> Result<(), Faults> {
        let mut report = FaultReport::new(source, "");
        self.check_in(&mut report, "");
        report.faults.into_result(())
    }

    /// Reports all values that no run could use; `prefix` begins their paths.
    pub fn check_in(&self, report: &mut FaultReport, prefix: &str) {
        if let Ok(options) = serde_json::to_value(self) {
            report_large_numbers(&options, prefix, report);
        }
        let is_positive = |x: f64| x.is_finite() && x > 0.0;
        let mut number = |holds: bool, name: &str, x: f64, expected: &str| {
            report.require_number(holds, &format!("{prefix}{name}"), x, expected);
        };
        number(is_positive(self.dt), "dt", self.dt, "a finite time step > 0 s");
        if let Some(end) = self.end_time {
            number(end.is_finite() && end >= 0.0, "end_time", end, "a finite time >= 0 s");
        }
        number((0.5..=1.0).contains(&self.theta), "theta", self.theta, "0.5 to 1");
        let tol = self.tol();
        number(is_positive(tol) && tol < 1.0, "tol", tol, "more than 0 and less than 1");
        number(is_positive(self.penetration_tol()), "penetration_tol", self.penetration_tol(), "a finite number > 0");
        if let Some(alert) = self.alert {
            number(alert.is_finite() && alert >= 0.0, "alert", alert, "a finite distance >= 0 m");
        }
        for (name, period) in PERIOD_NAMES.into_iter().zip(self.periods()) {
            let Some(period) = period else { continue };
            number(is_positive(period), name, period, "a finite length > 0 m");
            let is_alone = !self.self_gravity && self.fields.is_empty();
            number(is_alone, name, period, "no self-gravity and no fields with it: they are not periodic");
        }
        let constant = self.gravity_constant;
        number(constant.is_finite() && constant >= 0.0, "gravity_constant", constant, "a finite number >= 0");
        let gravity_error = self.gravity_error();
        let holds = is_positive(gravity_error) && gravity_error >= MIN_GRAVITY_ERROR;
        number(holds, "gravity_error", gravity_error, "at least 1e-14");
        if let Some(opening) = self.gravity_opening {
            number(opening > 0.0 && opening < 1.0, "gravity_opening", opening, "more than 0 and less than 1");
        }
        if let Some(softening) = self.gravity_softening {
            number(is_positive(softening), "gravity_softening", softening, "a finite length > 0 m");
            let is_summed = self.gravity != GravityMethod::Fmm;
            number(is_summed, "gravity_softening", softening, "gravity: direct or auto with it, not fmm");
            let is_alone = !self.gravity_quadrupole;
            number(is_alone, "gravity_softening", softening, "no gravity_quadrupole with it: balls have none");
        }
        number(is_positive(self.gravity_moved), "gravity_moved", self.gravity_moved, "a finite number > 0");
        number((0.0..=1.0).contains(&self.quench), "quench", self.quench, "0 to 1");
        let has_orbits = self.fields.iter().any(|field| field.orbit().is_some());
        for (k, field) in self.fields.iter().enumerate() {
            let path = format!("{prefix}fields.{k}");
            let found = report.shown_text_or(&path, || to_ron(field));
            if let Some(expected) = field.invalid_value(self.gravity_constant) {
                report.add_fault(&path, found, expected);
            } else if has_orbits && field.orbit().is_none() {
                // The origin falls on its orbit: a mass at rest would attract it, and rotating axes would move the orbit.
                report.add_fault(&path, found, "fields that all have an orbit, or none");
            } else if field.has_response() && (field.orbit().is_none() || self.fields.len() > 1) {
                report.add_fault(&path, found, "a response of a single field with an orbit");
            } else if field.has_response() && !(self.sinks.is_empty() && self.sources.is_empty()) {
                report.add_fault(&path, found, "no response with sinks or sources, which change the attracting mass");
            } else if matches!(field, ExternalField::RotatingFrame { .. })
                && self.fields[..k].iter().any(|other| matches!(other, ExternalField::RotatingFrame { .. }))
            {
                report.add_fault(&path, found, "one RotatingFrame");
            }
        }
        if let Some(cell) = &self.cell {
            self.check_cell(cell, &format!("{prefix}cell"), report);
        }
        check_radii(&self.radii, self.dt, &format!("{prefix}radii"), report);
        if !self.radii.is_empty() {
            self.check_options_of_radii(&format!("{prefix}radii"), report);
        }
        let mut expect = |holds: bool, name: &str, found: String, expected: &str| {
            report.require(holds, &format!("{prefix}{name}"), found, expected);
        };
        let sound = self.adaptive().is_sound();
        expect(
            sound,
            "adaptive",
            to_ron(&self.adaptive()),
            "max_multiple from 1 to 1000000, travel and penetration > 0",
        );
        if let Some(targets) = self.target_error {
            let [smallest, largest] = TargetErrors::RANGE;
            let values = || targets.values().into_iter().flatten();
            expect(
                values().next().is_some() && values().all(|error| (smallest..=largest).contains(&error)),
                "target_error",
                to_ron(&targets),
                "z, nu, pressure, semi_axes or energy, each from 1e-4 to 0.3",
            );
            expect(
                self.accuracy.is_none(),
                "target_error",
                to_ron(&targets),
                "either target_error or accuracy, which both choose other options",
            );
        }
        expect(self.max_sweeps() > 0, "max_sweeps", format!("{}", self.max_sweeps()), "at least 1");
        expect(self.check_every != Some(0), "check_every", to_ron(&self.check_every), "at least 1");
        let is_reported = gravity_error.is_nan() || gravity_error < MIN_GRAVITY_ERROR;
        expect(
            self.gravity != GravityMethod::Fmm || gravity_error >= MIN_FMM_ERROR || is_reported,
            "gravity_error",
            format!("{} with gravity: fmm", number_text(gravity_error)),
            "at least 1e-6, or gravity: direct",
        );
        let order = self.gravity_order;
        expect(order.is_none_or(|p| (2..=8).contains(&p)), "gravity_order", to_ron(&order), "2 to 8");
        expect(self.gravity_refresh() > 0, "gravity_refresh", format!("{}", self.gravity_refresh()), "at least 1");
        if let (None, Some(end)) = (self.steps, self.end_time) {
            let count = end / self.dt;
            expect(
                !is_positive(self.dt) || !end.is_finite() || count <= MAX_STEPS,
                "end_time",
                format!(
                    "{} s with dt {} s are {} steps",
                    number_text(end),
                    number_text(self.dt),
                    rounded_number(count)
                ),
                &format!("at most {MAX_STEPS:e} steps: a larger dt or a smaller end_time"),
            );
        }
        expect(
            self.steps.is_none_or(|steps| steps as f64 <= MAX_STEPS),
            "steps",
            to_ron(&self.steps),
            &format!("at most {MAX_STEPS:e}"),
        );
        expect(self.output_every > 0, "output_every", format!("{}", self.output_every), "at least 1");
        expect(self.log_every > 0, "log_every", format!("{}", self.log_every), "at least 1");
        expect(self.threads <= MAX_THREADS, "threads", format!("{}", self.threads), "0 to 1024");
        for (k, event) in self.events.iter().enumerate() {
            self.check_event(event, &format!("{prefix}events.{k}"), report);
        }
        check_sinks_and_sources(&self.sinks, &self.sources, prefix, report);
        let sinks: Vec<&str> = self.sinks.iter().map(|sink| sink.name.as_str()).collect();
        let sources: Vec<&str> = self.sources.iter().map(|source| source.name.as_str()).collect();
        check_probes(&self.probes, &self.until, FlowNames { sinks: &sinks, sources: &sources }, prefix, report);
    }

    /// Whether free bodies, `free_count` of them, have a potential energy at some time: under uniform gravity, which is
    /// `gravity` (m/s^2) until an event sets it, or by self-gravity.
    pub fn has_potential(&self, gravity: &[f64; 3], free_count: usize) -> bool {
        let is_gravity_set =
            self.events.iter().any(|event| matches!(event.action, EventAction::SetGravity(g) if g != [0.0; 3]));
        *gravity != [0.0; 3] || is_gravity_set || self.self_gravity && free_count > 1
    }

    /// Reports values of the option `cell`, at `path`, that no run could use with the other options.
    fn check_cell(&self, cell: &CellControl, path: &str, report: &mut FaultReport) {
        let damps = self.quench > 0.0 || self.events.iter().any(|e| matches!(e.action, EventAction::SetQuench(_)));
        let has_regions = self.probes.iter().any(|probe| matches!(probe.quantity, ProbeQuantity::Region { .. }));
        let requirements = [
            (self.periods().iter().all(Option::is_some), "xperiode, yperiode and zperiode with it"),
            (!damps, "no quench with it: it would damp the flow of the cell"),
            (self.sinks.is_empty() && self.sources.is_empty(), "no sinks and no sources with it: they are at rest"),
            (!has_regions, "no probe of a region with it: regions are at rest"),
            (!self.text, "text: false with it: LMGC90 has no such cell"),
        ];
        for (holds, expected) in requirements {
            let found = report.shown_text_or(path, || to_ron(cell));
            report.require(holds, path, found, expected);
        }
        cell.check_in(self.dt, path, report);
    }

    /// Reports at `path` the options with which no radius of a hollow cylinder can change.
    pub fn check_options_of_radii(&self, path: &str, report: &mut FaultReport) {
        let requirements = [
            (!self.text, "given with text: true", "text: false with it: LMGC90 has no such cylinder"),
            (
                self.impacts.is_simultaneous(),
                "given with impacts: in_order",
                "impacts: simultaneous: the order of impacts is not computed at a surface that grows or shrinks",
            ),
            (
                self.periods().iter().all(Option::is_none),
                "given with a period",
                "no period: the pressure is that on the whole height, and a closed cylinder has no images",
            ),
        ];
        for (holds, found, expected) in requirements {
            report.require(holds, path, found, expected);
        }
    }

    /// Reports the values of the event at `path` that no run could use.
    fn check_event(&self, event: &Event, path: &str, report: &mut FaultReport) {
        let [time, every, until, action] = ["time", "every", "until", "action"].map(|name| format!("{path}.{name}"));
        if event.time < 0.0 && event.time.is_finite() {
            // Time begins at 0.
            let found = format!("{} s is before the start of the run", report.number_text(&time, event.time));
            report.add_fault(&time, found, "at least 0 s");
        } else {
            report.require_number(event.time.is_finite(), &time, event.time, "a finite time (s)");
        }
        let (values, expected): (&[f64], &str) = match &event.action {
            EventAction::AddSpin(v)
            | EventAction::SetTorque(v)
            | EventAction::AddVelocity(v)
            | EventAction::SetGravity(v) => (v, "finite values"),
            EventAction::SetQuench(x) => (std::slice::from_ref(x), "0 to 1"),
            EventAction::SetFriction(_, x) => (std::slice::from_ref(x), "a finite friction >= 0"),
            EventAction::SetCohesion(_, x) => (std::slice::from_ref(x), "a finite cohesion >= 0"),
            EventAction::Shake { speed: x, .. } => (std::slice::from_ref(x), "a finite speed >= 0 m/s"),
            EventAction::Bond => (&[], ""),
        };
        let in_range = match event.action {
            EventAction::SetQuench(q) => (0.0..=1.0).contains(&q),
            EventAction::SetFriction(_, x) | EventAction::SetCohesion(_, x) | EventAction::Shake { speed: x, .. } => {
                x >= 0.0
            }
            _ => true,
        };
        let found = report.shown_text_or(&action, || to_ron(&event.action));
        report.require(values.iter().all(|v| v.is_finite()) && in_range, &action, found.as_str(), expected);
        if let EventAction::AddSpin(turn) | EventAction::SetTorque(turn) = &event.action {
            report.require(self.allows_rotation_about(turn), &action, found, ROTATION_ABOUT_PERIOD);
        }
        if let Some(interval) = event.every {
            let holds = interval.is_finite() && interval >= self.dt;
            report.require_number(holds, &every, interval, "a finite time of at least dt");
        }
        if let Some(end) = event.until {
            let holds = end.is_finite() && end >= event.time && event.every.is_some();
            report.require_number(holds, &until, end, "a finite time not before `time`, and only with `every`");
        }
    }

    /// Whether a rotation about `axis` leaves the periodic scene invariant: it has no period, or a period along this axis
    /// only.
    pub fn allows_rotation_about(&self, axis: &[f64; 3]) -> bool {
        let is_along = |k: usize| (0..3).all(|other| other == k || axis[other] == 0.0);
        (0..3).all(|k| self.periods()[k].is_none() || is_along(k))
    }

    /// Periods along x, y and z, m.
    pub fn periods(&self) -> [Option<f64>; 3] {
        [self.xperiode, self.yperiode, self.zperiode]
    }

    /// Number of the last step: `steps` after `first`, the step of DATBOX, or the first step not before `end_time` if all
    /// steps from `step` at `time` (s) on are dt; `None` without either option.
    pub fn last_step(&self, first: u64, (step, time): (u64, f64)) -> Option<u64> {
        // A thousandth of a step of slack: end_time / dt seldom divides exactly.
        let step_at = |end: f64| step.saturating_add(((end - time) / self.dt - 1e-3).ceil().max(0.0) as u64);
        self.steps.map(|steps| first.saturating_add(steps)).or(self.end_time.map(step_at))
    }
}

/// Names of the periods along x, y and z.
pub const PERIOD_NAMES: [&str; 3] = ["xperiode", "yperiode", "zperiode"];

/// Text of an option without a value.
pub const NO_VALUE: &str = "None";

/// Options without a default that files and snapshots contain only if they are given: files of scenes without them equal
/// those of earlier versions. `impacts` has a default, and is left out of COMPUTE.RON alone.
pub const OPTIONS_WRITTEN_IF_GIVEN: [&str; 4] = ["zperiode", "cell", "target_error", "radii"];

/// Requirement on a rotation in a periodic scene, since neighbours across its boundary would be separated.
pub const ROTATION_ABOUT_PERIOD: &str =
    "a rotation about the only axis along which the scene repeats, or a scene that does not repeat";

/// Reports the numbers of a value at `path` that are too large to compute with.
fn report_large_numbers(value: &serde_json::Value, path: &str, report: &mut FaultReport) {
    let path_of = |name: &str| {
        // The name of a variant is no part of a path.
        let is_variant = name.starts_with(|letter: char| letter.is_ascii_uppercase());
        if is_variant { path.to_string() } else { format!("{}.{name}", path.trim_end_matches('.')) }
    };
    match value {
        serde_json::Value::Number(number) => {
            let number = number.as_f64().unwrap_or_default();
            let holds = number.abs() < MAX_MAGNITUDE;
            let expected = format!("less than {MAX_MAGNITUDE:e} in magnitude");
            report.require_number(holds, path.trim_matches('.'), number, &expected);
        }
        serde_json::Value::Array(values) => {
            (0..).zip(values).for_each(|(k, value)| report_large_numbers(value, &path_of(&k.to_string()), report));
        }
        serde_json::Value::Object(fields) => {
            fields.iter().for_each(|(name, value)| report_large_numbers(value, &path_of(name), report));
        }
        _ => {}
    }
}

/// Value in the syntax of the file and of flags.
fn to_ron<T: Serialize>(value: &T) -> String {
    ron_text::ron_options().to_string(value).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_that_repeat_turn_about_their_period_alone() {
        let faults = |xperiode, yperiode, axis| {
            let events = vec![Event::at_time(0.0, EventAction::AddSpin(axis))];
            Compute { xperiode, yperiode, events, ..Compute::default() }.check(Path::new("options")).is_err()
        };
        let (x, z, period) = ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], Some(4.0));
        assert_eq!([x, z].map(|axis| faults(None, None, axis)), [false, false]);
        assert_eq!([x, z].map(|axis| faults(period, None, axis)), [false, true]);
        assert_eq!([x, z].map(|axis| faults(period, period, axis)), [true, true]);
        let along_z = Compute { zperiode: period, ..Compute::default() };
        assert_eq!([x, z].map(|axis| along_z.allows_rotation_about(&axis)), [false, true]);
    }

    #[test]
    fn options_written_if_given_are_in_no_other_file() {
        let given = Compute { zperiode: Some(4.0), ..Compute::default() };
        for (compute, is_written) in [(Compute::default(), false), (given.clone(), true)] {
            assert_eq!(compute.to_text().contains("zperiode"), is_written);
            assert_eq!(compute.result_options().contains_key("zperiode"), is_written);
        }
        assert_eq!(from_ron::<Compute>(Path::new("COMPUTE.RON"), &given.to_text(), "options").unwrap(), given);
    }

    #[test]
    fn text_round_trips_and_flags_win() {
        let compute = Compute {
            dt: 0.1 + 0.2,
            steps: Some(7),
            events: vec![Event::at_time(3.0, EventAction::AddSpin([0.0, 0.0, 1e-5]))],
            ..Compute::default()
        };
        let path = Path::new("COMPUTE.RON");
        let read: Compute = from_ron(path, &compute.to_text(), "options").unwrap();
        assert_eq!(read, compute);
        let flags = ComputeFlags { theta: Some(1.0), ..ComputeFlags::default() };
        assert_eq!(read.with_flags(&flags), Compute { theta: 1.0, ..compute });
    }

    #[test]
    fn an_option_set_alone_wins_over_the_preset() {
        let path = Path::new("COMPUTE.RON");
        let file: Compute =
            from_ron(path, "(accuracy: draft, tol: 0.5, adaptive: (max_multiple: 3))", "options").unwrap();
        let flags =
            ComputeFlags { accuracy: Some(Accuracy::Fine), gravity_refresh: Some(7), ..ComputeFlags::default() };
        let [read, flagged] = [file.clone(), file.with_flags(&flags)];
        assert_eq!((read.tol(), read.max_sweeps(), read.gravity_refresh()), (0.5, 500, 16));
        assert_eq!((flagged.tol(), flagged.max_sweeps(), flagged.gravity_refresh()), (0.5, 20_000, 7));
        assert_eq!(flagged.adaptive(), Adaptive { max_multiple: 3, ..Adaptive::default() });
        let again: Compute = from_ron(path, &flagged.to_text(), "options").unwrap();
        assert_eq!(again, flagged);
        let options = flagged.accuracy_options();
        let set_names: Vec<&str> = options.iter().filter(|option| option.is_set).map(|option| option.name).collect();
        assert_eq!(set_names, ["adaptive", "tol", "gravity_refresh"]);
        for max_multiple in [0, u64::MAX] {
            let adaptive = Some(Adaptive { max_multiple, ..Adaptive::default() });
            assert_eq!(Compute { adaptive, ..Compute::default() }.check(path).unwrap_err().0.len(), 1);
        }
    }

    #[test]
    fn faults_name_line_and_column_or_the_option() {
        let path = Path::new("COMPUTE.RON");
        let faults = from_ron::<Compute>(path, "(\n  dt: 1.0,\n  speed: 3,\n)", "options").unwrap_err();
        assert!(faults.to_string().starts_with("COMPUTE.RON:3:"), "{faults}");
        let wrong = Compute { dt: f64::NAN, theta: 0.4, ..Compute::default() };
        assert_eq!(wrong.check(path).unwrap_err().0.len(), 2);
    }

    #[test]
    fn repeated_events_are_laid_out_in_time() {
        let spin = |every, until| Event { time: 10.0, every, until, action: EventAction::AddSpin([0.0, 0.0, 1e-5]) };
        let once = Event::at_time(15.0, EventAction::SetQuench(0.1));
        let times =
            |events: &[Event], end| event_schedule(events, end).iter().map(|event| event.time).collect::<Vec<_>>();
        assert_eq!(times(&[spin(Some(5.0), None), once.clone()], 25.0), [10.0, 15.0, 15.0, 20.0, 25.0]);
        assert_eq!(times(&[spin(Some(5.0), Some(19.0)), once.clone()], 25.0), [10.0, 15.0, 15.0]);
        assert_eq!(times(&[spin(Some(0.1), Some(10.3)), once], 25.0).len(), 5); // 0.3 / 0.1 is 2.9999999999999996
        let late = Event { every: Some(100.0), until: Some(209.91), ..spin(None, None) };
        assert_eq!(times(&[late], 250.0), [10.0, 110.0]);
        assert_eq!(times(&[spin(None, None)], 0.0), [10.0]); // a later end of the run may reach it
        assert_eq!(event_schedule(&[spin(Some(5.0), None)], 25.0)[2], Event::at_time(20.0, spin(None, None).action));
        for wrong in [spin(Some(0.0), None), spin(None, Some(20.0)), spin(Some(5.0), Some(9.0)), spin(Some(1e-4), None)]
        {
            let compute = Compute { events: vec![wrong.clone()], ..Compute::default() };
            assert_eq!(compute.check(Path::new("COMPUTE.RON")).unwrap_err().0.len(), 1, "{wrong:?}");
        }
    }

    #[test]
    fn events_at_one_time_are_in_the_order_of_the_list() {
        let often = Event { every: Some(0.1), ..Event::at_time(0.0, EventAction::SetQuench(0.1)) };
        for tenths in 1..=20 {
            let once = Event::at_time(f64::from(tenths) / 10.0, EventAction::SetQuench(0.2)); // 0.3 is less than 3 times 0.1
            for events in [[often.clone(), once.clone()], [once, often.clone()]] {
                let times = event_schedule(&events, 2.0);
                let place = tenths as usize;
                assert_eq!(
                    times[place..place + 2].iter().map(|e| &e.action).collect::<Vec<_>>(),
                    [&events[0].action, &events[1].action]
                );
            }
        }
    }

    #[test]
    fn end_time_gives_whole_steps() {
        let compute = Compute { dt: 0.1, end_time: Some(0.3), ..Compute::default() };
        assert_eq!(compute.last_step(0, (0, 0.0)), Some(3)); // 0.3 / 0.1 is 2.9999999999999996
        assert_eq!(compute.last_step(10, (10, 0.1)), Some(12));
        // The result does not depend on the steps before.
        assert_eq!(compute.last_step(10, (1000, 0.1)), Some(1002));
        assert_eq!(Compute { steps: Some(5), ..compute }.last_step(10, (1000, 0.1)), Some(15));
    }
}
