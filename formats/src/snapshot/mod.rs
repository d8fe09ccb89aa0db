//! `OUTBOX/snapshot-NNNNNN.npz`: the complete state at one instant for a restart, bit for bit.
//!
//! An uncompressed zip archive of npy arrays, little-endian, and `meta.npy`, the bytes of a JSON text. `numpy.load(file)`
//! opens it. NNNNNN is the number of the step. The same state gives the same bytes: the file has no date, host, thread
//! count or duration.
//!
//! A large snapshot may be in parts: further files have ranges of the rows, and `snapshot-NNNNNN.npz` is their index.

mod npz;
mod parts;

use std::collections::BTreeMap;
use std::fmt;
use std::io::{BufWriter, Cursor, Seek, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use zip::result::ZipError;

use crate::atomic;
use crate::deforming_cell::CellState;
use crate::error::{Fault, Faults};
use crate::field::PrimaryResponse;
use crate::geometry::periodic_cell::PeriodicCell;
use crate::hollow_radius::RadiusState;
use crate::law_table::{LawError, LawModel};
use npz::{ArrayElement, NpzReader, NpzWriter};
use parts::{FirstBodies, PartRows, other_part, step_of};
pub use parts::{SnapshotPart, part_path, remove_orphan_parts, step_of_file};

#[cfg(target_endian = "big")]
compile_error!("snapshots are written from memory as little-endian arrays");

/// Version of the file format; a reader rejects a later one.
pub const FORMAT_VERSION: u32 = 1;

/// Value of [`BodyArrays::body_shape`] of a sphere.
pub const SHAPE_SPHERE: u8 = 0;
/// Value of [`BodyArrays::body_shape`] of a plate.
pub const SHAPE_PLANE: u8 = 1;
/// Value of [`BodyArrays::body_shape`] of any other shape or of several contactors, which BODIES.DAT has.
pub const SHAPE_PARTS: u8 = 2;

/// [`BodyArrays::body_driven`] of a body with all six components of its velocity imposed.
pub const DRIVEN_ALL: u8 = 0b11_1111;
/// Components of the translation in [`BodyArrays::body_driven`].
pub const DRIVEN_TRANSLATION: u8 = 0b00_0111;

/// Properties of a body that decide whether it is a wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WallCriteria {
    /// Imposed components of its velocity, as in [`BodyArrays::body_driven`].
    pub driven: u8,
    pub is_plane: bool,
}

/// Whether each body is a wall.
///
/// A wall has some imposed translation; a plane is also a wall if any component is imposed. All other bodies are grains.
/// Where this leaves no grain, as in a plane problem of grains that cannot leave their plane, bodies other than planes
/// are grains if they are free along two axes at least.
pub fn are_walls(bodies: &[WallCriteria]) -> Vec<bool> {
    let walls_if_grains_have = |min_free_axes: u32| -> Vec<bool> {
        let is_wall = |body: &WallCriteria| {
            let free_axes = 3 - (body.driven & DRIVEN_TRANSLATION).count_ones();
            free_axes < min_free_axes || body.is_plane && body.driven != 0
        };
        bodies.iter().map(is_wall).collect()
    };
    let walls = walls_if_grains_have(3);
    if walls.contains(&false) { walls } else { walls_if_grains_have(2) }
}

/// Value of [`ContactArrays::contact_status`] of a contact that carries no force.
pub const STATUS_NO_CONTACT: u8 = 0;
/// Value of [`ContactArrays::contact_status`] of a contact that sticks.
pub const STATUS_STICK: u8 = 1;
/// Value of [`ContactArrays::contact_status`] of a contact that slides.
pub const STATUS_SLIDE: u8 = 2;

/// Content of a snapshot: the state of a run at the end of a step, and its parameters.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Snapshot {
    pub meta: SnapshotMeta,
    pub bodies: BodyArrays,
    pub contacts: ContactArrays,
    /// Memory of contacts; only if a law needs it.
    pub memory: Option<MemoryArrays>,
    /// Other state of the laws of contacts; only if a law has it.
    pub laws: Option<LawArrays>,
    /// Attractions of contacts; only if a law has cohesion per pair.
    pub attractions: Option<AttractionArrays>,
    /// Evaluations of self-gravity; only where it is not evaluated at every step.
    pub gravity: Option<GravityArrays>,
    /// Bodies that are in the run; only if bodies may enter or leave.
    pub presence: Option<PresenceArrays>,
    /// Velocities with which bodies have left; only if the run has sinks.
    pub departures: Option<DepartureArrays>,
    /// Additional arrays for bodies of any shape; only in scenes with other bodies than spheres and plates.
    pub shapes: Option<ShapeArrays>,
    /// Sums over the steps since the snapshot before.
    pub interval: Option<IntervalArrays>,
}

/// Additional arrays for bodies of any shape.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ShapeArrays {
    pub turning: TurningArrays,
    pub contacts: ContactPartArrays,
    pub pairs: PairArrays,
}

/// Content of the JSON text `meta`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SnapshotMeta {
    /// Number of the format, [`FORMAT_VERSION`].
    pub format: u32,
    /// Program and version that wrote the file.
    pub program: String,
    pub step: u64,
    /// Time, s.
    pub time: f64,
    /// Length of the last step, s; before the first step, the length of the first.
    pub h: f64,
    /// Step and time (s) from which steps of one length lead to `time`, unless they are step and time of DATBOX.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub counted_from: Option<(u64, f64)>,
    /// Time of the snapshot before or of the start, from which the arrays of the interval count, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interval_start: Option<f64>,
    pub parameters: RunParameters,
    /// Colours, which `body_colour` indexes.
    pub colours: Vec<String>,
    /// Materials, which `body_material` indexes.
    pub materials: Vec<MaterialName>,
    /// Laws in force, as events have set them, which `contact_law` indexes.
    pub laws: Vec<LawName>,
    /// Laws of TACT_BEHAV.DAT, if events have changed them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub laws_at_start: Vec<LawName>,
    pub ledger: Ledger,
    /// Last evaluations of self-gravity; only if it is not evaluated at every step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attraction: Option<GravityEvaluations>,
    /// State of the fallback of the solver; only if it has failed in a step.
    #[serde(default, skip_serializing_if = "FallbackState::is_new")]
    pub fallback: FallbackState,
    /// Sums for the files of POSTPRO.DAT; only if it requests some.
    #[serde(default, skip_serializing_if = "PostproSums::is_zero")]
    pub postpro: PostproSums,
    /// Time since when all bodies have been at rest, s; only if a condition `AtRest` ends the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rest_since: Option<f64>,
    /// Choice of options for `target_error`; only in runs with this option.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accuracy_control: Option<crate::accuracy::AccuracyControl>,
    /// Response of the primary on an orbit; only if its field has `response`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub primary_response: Option<PrimaryResponse>,
    /// Circles of the walls with a revolution at a rate.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub revolutions: Vec<WallCircle>,
    /// Deforming cell; only if the run has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell: Option<CellState>,
    /// Radii of hollow cylinders that change.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub radii: Vec<RadiusState>,
    /// Whether bodies have entered after the last step.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub bodies_entered: bool,
    /// Whether all bodies have the motion with which the last step of another run ended; only in START.npz.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub continues_run: bool,
    /// Options of the run as in COMPUTE.RON, flags included; see [`crate::compute::Compute::result_options`]. Empty in
    /// snapshots of versions without this field.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub options: BTreeMap<String, String>,
    /// Parts of the snapshot, in the order of their rows; only in the index of a snapshot in parts.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<SnapshotPart>,
}

/// Circle on which the centre of a wall moves that turns about a point.
///
/// At the end of a step the centre is on a chord of the circle, so that its position does not give the radius.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct WallCircle {
    /// Number of the body in BODIES.DAT, from 1.
    pub body: u64,
    /// Point about which the wall turns, m.
    pub point: [f64; 3],
    /// Position of the centre from the point in the axes of the body, m.
    pub offset: [f64; 3],
}

/// The last two evaluations of self-gravity, from which it is extrapolated; the accelerations are in [`GravityArrays`].
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct GravityEvaluations {
    /// Steps since the last evaluation.
    pub age: u64,
    /// Times of the last evaluation and of the one before, s; equal if there was none.
    pub times: [f64; 2],
    /// Potential energies at `times`, J.
    pub potentials: [f64; 2],
    /// Upper bound of the displacement of a body since the last evaluation, relative to the centre of mass, m.
    pub moved: f64,
    /// Column `gravity_removed` of steps.csv at the last evaluation.
    pub removed: f64,
    /// RMS relative error of the extrapolation to the last evaluation.
    pub extrapolation_error: f64,
}

/// State of the fallback of the solver `auto`: after failures it is suspended for some steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct FallbackState {
    /// Number of consecutive steps in which the fallback has failed.
    pub failures: u32,
    /// First step in which the fallback is tried again.
    pub due: u64,
}

impl FallbackState {
    fn is_new(&self) -> bool {
        *self == FallbackState::default()
    }
}

/// Sums over the steps of a run for the files of POSTPRO.DAT.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PostproSums {
    /// Energy that contacts have taken, J.
    pub dissipated: f64,
    /// Work of all forces at the end velocities of the steps, J.
    pub outside_work: f64,
}

impl PostproSums {
    fn is_zero(&self) -> bool {
        *self == PostproSums::default()
    }
}

/// Material of bodies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MaterialName {
    pub name: String,
    /// Density, kg/m^3.
    pub density: f64,
}

/// Contact law with its parameters in the order of TACT_BEHAV.DAT.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LawName {
    pub nickname: String,
    pub kind: String,
    pub parameters: Vec<f64>,
}

impl LawName {
    /// Law of the table with these parameters; an error if the programs do not compute with it.
    pub fn model(&self) -> Result<LawModel, LawError> {
        LawModel::from_values(&self.kind, &self.parameters)
    }
}

/// [`Adaptive`](crate::compute::Adaptive) under the names that it has in snapshots.
mod adaptive_fields {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use crate::compute::Adaptive;

    #[derive(Serialize, Deserialize)]
    struct AdaptiveFields {
        most: u64,
        travel: f64,
        penetration: f64,
    }

    /// Writes the option with the names of fields that snapshots have.
    pub fn serialize<S: Serializer>(adaptive: &Option<Adaptive>, serializer: S) -> Result<S::Ok, S::Error> {
        let fields =
            |Adaptive { max_multiple, travel, penetration }| AdaptiveFields { most: max_multiple, travel, penetration };
        adaptive.map(fields).serialize(serializer)
    }

    /// Reads the option with the names of fields that snapshots have. Errors: other or missing fields, as derived readers.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Adaptive>, D::Error> {
        let adaptive =
            |AdaptiveFields { most, travel, penetration }| Adaptive { max_multiple: most, travel, penetration };
        Ok(Option::deserialize(deserializer)?.map(adaptive))
    }
}

/// Options that determine the result.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct RunParameters {
    pub theta: f64,
    /// Preset; only if it is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accuracy: Option<crate::compute::Accuracy>,
    /// Target errors; only if they are given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_error: Option<crate::compute::TargetErrors>,
    /// Limits of adaptive steps; only if steps can differ.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "adaptive_fields")]
    pub adaptive: Option<crate::compute::Adaptive>,
    pub tol: f64,
    /// Limit of the mean penetration; 0 in snapshots of versions without this limit.
    #[serde(default)]
    pub penetration_tol: f64,
    #[serde(default)]
    pub solver: crate::compute::ContactSolver,
    /// Precision of the sweeps; only if it is set explicitly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sweep_precision: Option<crate::compute::SweepPrecision>,
    pub max_sweeps: u64,
    /// Number of sweeps between checks of the residual; only if it is set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub check_every: Option<u64>,
    pub alert: Option<f64>,
    pub self_gravity: bool,
    #[serde(default)]
    pub gravity: crate::compute::GravityMethod,
    /// Period along x, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub xperiode: Option<f64>,
    /// Period along y, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub yperiode: Option<f64>,
    /// Period along z, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zperiode: Option<f64>,
    /// Narrow phase; only in scenes with other bodies than spheres and plates.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub narrow_phase: Option<crate::compute::NarrowPhase>,
    /// Friction of faces; only in scenes with other bodies than spheres and plates.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub face_friction: Option<crate::compute::FaceFriction>,
    /// G, m^3 kg^-1 s^-2.
    pub gravity_constant: f64,
    pub gravity_error: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity_order: Option<usize>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity_opening: Option<f64>,
    /// Largest number of steps between evaluations of self-gravity; only if it is more than 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity_refresh: Option<u64>,
    /// Largest displacement between evaluations of self-gravity, as a share of the mean radius; only with `gravity_refresh`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity_moved: Option<f64>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub gravity_quadrupole: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity_softening: Option<f64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fields: Vec<crate::compute::ExternalField>,
    /// Uniform gravity now in force, m/s^2.
    pub uniform_gravity: [f64; 3],
    pub quench: f64,
    /// Events of COMPUTE.RON that have happened.
    pub events_done: u64,
}

/// Running sums over the steps since step 0, and the expected momenta.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Ledger {
    /// Kinetic and potential energy at step 0, J.
    pub energy_start: f64,
    /// Work of the contacts, J: the sum of r.(u+ + u-)/2, negative when they dissipate.
    pub contact_work: f64,
    /// Part of `contact_work` by the tangential forces, J; the rest is by shocks, and by attraction.
    #[serde(default)]
    pub friction_work: f64,
    /// Work of events, imposed forces and walls, and of `quench`, which is negative, J.
    pub outside_work: f64,
    /// Linear momentum of the free bodies at step 0 plus the impulses of walls, uniform gravity, forces and events, kg m/s.
    pub momentum_expected: [f64; 3],
    /// Expected angular momentum about the origin, kg m^2/s.
    pub angular_momentum_expected: [f64; 3],
    /// Largest sum so far over the free bodies of m |v|, or of the impulses of forces in a step, kg m/s.
    pub momentum_scale: f64,
    /// Largest ratio of a penetration to the mean radius so far.
    pub penetration_largest: f64,
    /// Part of the mean penetration left by unconverged solutions, divided by the mean radius.
    #[serde(default)]
    pub penetration_left: f64,
    pub steps_unconverged: u64,
    /// The last step that was not converged.
    pub last_unconverged: Option<u64>,
    pub sweeps: u64,
}

impl SnapshotMeta {
    /// Cell of the scene at the time of the snapshot.
    pub fn periodic_cell(&self) -> PeriodicCell {
        let RunParameters { xperiode, yperiode, zperiode, .. } = self.parameters;
        let at_start = || PeriodicCell::with_periods([xperiode, yperiode, zperiode]);
        self.cell.as_ref().map_or_else(at_start, CellState::cell)
    }

    /// Laws of TACT_BEHAV.DAT.
    pub fn laws_of_file(&self) -> &[LawName] {
        if self.laws_at_start.is_empty() { &self.laws } else { &self.laws_at_start }
    }
}

impl Default for SnapshotMeta {
    fn default() -> Self {
        SnapshotMeta {
            format: FORMAT_VERSION,
            program: String::new(),
            step: 0,
            time: 0.0,
            h: 0.0,
            counted_from: None,
            interval_start: None,
            parameters: RunParameters::default(),
            colours: Vec::new(),
            materials: Vec::new(),
            laws: Vec::new(),
            laws_at_start: Vec::new(),
            ledger: Ledger::default(),
            attraction: None,
            fallback: FallbackState::default(),
            postpro: PostproSums::default(),
            rest_since: None,
            accuracy_control: None,
            primary_response: None,
            revolutions: Vec::new(),
            cell: None,
            radii: Vec::new(),
            bodies_entered: false,
            continues_run: false,
            options: BTreeMap::new(),
            parts: Vec::new(),
        }
    }
}

macro_rules! arrays {
    ($(#[$outer:meta])* $group:ident { $($(#[doc = $help:literal])+ $name:ident : $type:ty,)+ }) => {
        $(#[$outer])*
        #[derive(Debug, Clone, PartialEq, Default)]
        pub struct $group { $($(#[doc = $help])+ pub $name: Vec<$type>,)+ }

        impl $group {
            /// Name, element type, shape of a row and meaning of every array.
            pub fn array_table() -> Vec<(&'static str, &'static str, &'static [usize], &'static str)> {
                vec![$((stringify!($name), <$type as ArrayElement>::DESCR, <$type as ArrayElement>::ROW, concat!($($help),+)),)+]
            }

            /// Rows with these numbers, in their order.
            pub fn select_rows(&self, numbers: &[usize]) -> Self {
                $group { $($name: numbers.iter().map(|&row| self.$name[row]).collect(),)+ }
            }

            /// Appends the rows of another.
            pub fn append(&mut self, mut other: Self) {
                $(self.$name.append(&mut other.$name);)+
            }

            /// Adds the arrays to an archive; `rows`: the rows of a part, else all.
            fn write(&self, archive: &mut NpzWriter<impl Write + Seek>, rows: Option<&Range<usize>>) -> zip::result::ZipResult<()> {
                $({
                    let selected = rows.map_or(&self.$name[..], |rows| &self.$name[rows.clone()]);
                    archive.add_array(stringify!($name), selected)?;
                })+
                Ok(())
            }

            /// Reads the arrays; the first one fixes the number of rows of the others.
            fn read(entries: &mut NpzReader) -> Self {
                let rows = None;
                $(let $name = entries.read_array(stringify!($name), rows); let rows = rows.or($name.as_ref().map(Vec::len));)+
                let _ = rows;
                $group { $($name: $name.unwrap_or_default(),)+ }
            }
        }
    };
}

arrays! {
    /// One row for each body; walls are bodies.
    BodyArrays {
        /// Number of the body in BODIES.DAT, from 1
        body_id: u64,
        /// Position of the centre of mass, m
        body_x: [f64; 3],
        /// Unit quaternion w, x, y, z from the body's frame to the world
        body_q: [f64; 4],
        /// Velocity of the centre of mass, m/s
        body_v: [f64; 3],
        /// Angular velocity in the body's frame, rad/s
        body_w: [f64; 3],
        /// Angular velocity in the world's frame, rad/s; a sphere is restarted with it
        body_w_world: [f64; 3],
        /// Mass, kg
        body_mass: f64,
        /// Principal moments of inertia, kg m^2
        body_inertia: [f64; 3],
        /// Radius of the sphere of equal volume, m
        body_radius: f64,
        /// Half lengths of a plane along its axes, m; of others, the radius three times
        body_half_lengths: [f64; 3],
        /// 0 sphere, 1 plane, 2 any other shape, or several contactors; BODIES.DAT has it
        body_shape: u8,
        /// Bit k set: velocity component k is imposed; see [`are_walls`]
        body_driven: u8,
        /// Index into the colours of meta
        body_colour: u16,
        /// Index into the materials of meta
        body_material: u16,
    }
}

arrays! {
    /// One row for each contact listed in the last step, in the configuration where it was detected.
    ContactArrays {
        /// Row of the candidate and of the antagonist in the body arrays
        contact_body: [u32; 2],
        /// Feature of the candidate and of the antagonist that touch: a sphere 0; a plane 0 its upper, 1 its lower face, 2 its rim; a surface MESHx 8 times the triangle plus its region
        contact_feature: [u32; 2],
        /// Point of contact, m
        contact_point: [f64; 3],
        /// Rows n, t, s; n points from the antagonist to the candidate, n x t = s
        contact_frame: [[f64; 3]; 3],
        /// Gap, m, > 0 apart
        contact_gap: f64,
        /// Force on the candidate along n, t, s, N: impulse / h
        contact_force: [f64; 3],
        /// Impulse on the candidate along n, t, s, N s
        contact_impulse: [f64; 3],
        /// Velocity of the candidate relative to the antagonist along n, t, s at the step's end, m/s
        contact_velocity: [f64; 3],
        /// 0 no contact, 1 stick, 2 slide
        contact_status: u8,
        /// Index into the laws of meta
        contact_law: u8,
    }
}

arrays! {
    /// Memory of the contact laws, one row for each contact.
    MemoryArrays {
        /// 1 where a bond or a liquid bridge holds, else 0
        contact_bonded: u8,
        /// Gap at which the contact was bonded, m; 0 without a bond
        contact_bond_gap: f64,
        /// Angular impulse of rolling and spinning friction or of a bond on the candidate along n, t, s, N m s
        contact_moment: [f64; 3],
    }
}

arrays! {
    /// Other state of the contact laws, one row for each contact; there only if a law has it.
    LawArrays {
        /// Gap from which the law counts, m; 0 for laws that count from 0
        contact_reference_gap: f64,
        /// Soundness of the interface, 1 without damage, 0 broken or without an interface
        contact_soundness: f64,
        /// Sliding of the candidate on the interface, world frame, m
        contact_sliding: [f64; 3],
    }
}

arrays! {
    /// One row for each contact; there only if a law has cohesion per pair.
    AttractionArrays {
        /// Attraction at the contact, N, of a law with cohesion per pair, else 0
        contact_attraction: f64,
    }
}

arrays! {
    /// One row for each body; there only where self-gravity is not evaluated at every step.
    GravityArrays {
        /// Acceleration by self-gravity when it was last evaluated, m/s^2
        gravity_last: [f64; 3],
        /// Acceleration by self-gravity at the evaluation before that, m/s^2
        gravity_before: [f64; 3],
    }
}

arrays! {
    /// One row for each body; there only if the run has sinks or sources.
    PresenceArrays {
        /// 0 not yet entered, 1 in the run, 2 left
        body_presence: u8,
    }
}

arrays! {
    /// One row for each body; there only if the run has sinks.
    DepartureArrays {
        /// Velocity of the centre of mass with which a body has left, m/s; 0 of others
        body_exit_v: [f64; 3],
    }
}

/// Value of [`PresenceArrays::body_presence`] of a body that has not yet entered.
pub const PRESENCE_WAITING: u8 = 0;
/// Value of [`PresenceArrays::body_presence`] of a body that is in the run.
pub const PRESENCE_PRESENT: u8 = 1;
/// Value of [`PresenceArrays::body_presence`] of a body that has left.
pub const PRESENCE_GONE: u8 = 2;

arrays! {
    /// One row for each free body of unequal moments of inertia.
    TurningArrays {
        /// Row in the body arrays
        turning_body: u32,
        /// Angular momentum about the centre of mass, world frame, kg m^2/s
        turning_momentum: [f64; 3],
    }
}

arrays! {
    /// One row for each contact, as in the contact arrays.
    ContactPartArrays {
        /// Position of the contactor among those of the candidate, and of the antagonist, from 0
        contact_rank: [u32; 2],
        /// Share of the contact in the area in which faces meet, m^2
        contact_area: f64,
    }
}

arrays! {
    /// Start of the next narrow-phase search, one row for each pair of contactors that were in contact.
    PairArrays {
        /// Rows of the two bodies in the body arrays, the candidate first
        pair_body: [u32; 2],
        /// Positions of the contactors among those of their bodies, from 0
        pair_rank: [u32; 2],
        /// Feature in which they were nearest, and direction; used by cd-solve only
        pair_memory: [u64; 2],
    }
}

arrays! {
    /// One row for each pair of bodies of which a contact has carried force in a step since the snapshot before.
    IntervalArrays {
        /// Rows of the two bodies in the body arrays, the candidate first
        interval_body: [u32; 2],
        /// Sum of impulses times branches r.l, J s; of a pair with a driven body l ends at the point of contact
        interval_virial: f64,
    }
}

impl ShapeArrays {
    /// Appends the rows of another.
    pub fn append(&mut self, other: Self) {
        self.turning.append(other.turning);
        self.contacts.append(other.contacts);
        self.pairs.append(other.pairs);
    }

    fn write(&self, archive: &mut NpzWriter<impl Write + Seek>, rows: Option<&PartRows>) -> zip::result::ZipResult<()> {
        self.turning.write(archive, rows.map(|rows| &rows.turning))?;
        self.contacts.write(archive, rows.map(|rows| &rows.contacts))?;
        self.pairs.write(archive, rows.map(|rows| &rows.pairs))
    }

    fn read(entries: &mut NpzReader) -> Self {
        ShapeArrays {
            turning: TurningArrays::read(entries),
            contacts: ContactPartArrays::read(entries),
            pairs: PairArrays::read(entries),
        }
    }

    /// Whether all body indices are below `body_count`, and the contact arrays have `contact_count` rows.
    fn are_in_range(&self, body_count: usize, contact_count: usize) -> bool {
        let body_indices = [&self.turning.turning_body[..], self.pairs.pair_body.as_flattened()];
        body_indices.into_iter().flatten().all(|&body| (body as usize) < body_count)
            && self.contacts.contact_rank.len() == contact_count
    }
}

impl Snapshot {
    /// Bytes of the file.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.archive_bytes(None)
    }

    /// Bytes of the file, or of a part with these rows.
    fn archive_bytes(&self, rows: Option<&PartRows>) -> Vec<u8> {
        self.write_archive(Cursor::new(Vec::new()), rows).expect("writing to memory").into_inner()
    }

    /// Writes the file, or a part with these rows, to an empty target.
    fn write_archive<W: Write + Seek>(&self, target: W, rows: Option<&PartRows>) -> zip::result::ZipResult<W> {
        let mut archive = NpzWriter::new(target);
        let body_rows = rows.map(|rows| &rows.bodies);
        let contact_rows = rows.map(|rows| &rows.contacts);
        let interval_rows = rows.map(|rows| &rows.interval);
        if rows.is_none() {
            self.write_meta(&mut archive)?;
        }
        self.bodies.write(&mut archive, body_rows)?;
        self.contacts.write(&mut archive, contact_rows)?;
        if let Some(memory) = &self.memory {
            memory.write(&mut archive, contact_rows)?;
        }
        if let Some(laws) = &self.laws {
            laws.write(&mut archive, contact_rows)?;
        }
        if let Some(attractions) = &self.attractions {
            attractions.write(&mut archive, contact_rows)?;
        }
        if let Some(gravity) = &self.gravity {
            gravity.write(&mut archive, body_rows)?;
        }
        if let Some(presence) = &self.presence {
            presence.write(&mut archive, body_rows)?;
        }
        if let Some(departures) = &self.departures {
            departures.write(&mut archive, body_rows)?;
        }
        if let Some(shapes) = &self.shapes {
            shapes.write(&mut archive, rows)?;
        }
        if let Some(interval) = &self.interval {
            interval.write(&mut archive, interval_rows)?;
        }
        archive.finish()
    }

    /// Bytes of the index of a snapshot in parts: `meta` alone.
    fn index_bytes(&self) -> Vec<u8> {
        let mut archive = NpzWriter::new(Cursor::new(Vec::new()));
        self.write_meta(&mut archive).and_then(|()| archive.finish()).expect("writing to memory").into_inner()
    }

    fn write_meta(&self, archive: &mut NpzWriter<impl Write + Seek>) -> zip::result::ZipResult<()> {
        let meta = serde_json::to_vec(&self.meta).expect("meta holds nothing that JSON lacks");
        archive.add_array("meta", &meta)
    }

    /// Writes the file, whole or not at all. Creates a missing folder.
    pub fn write(&self, path: &Path) -> Result<(), Faults> {
        atomic::create_folder_of(path)?;
        self.write_to_folder(path)
    }

    /// Writes the file like [`Snapshot::write`] to a folder that must exist, see [`atomic::write_file`].
    pub fn write_to_folder(&self, path: &Path) -> Result<(), Faults> {
        atomic::write_file(path, |file| {
            let archive = self.write_archive(BufWriter::new(file), None).map_err(|error| match error {
                ZipError::Io(error) => error,
                other => other.into(),
            });
            archive?.flush()
        })
    }

    /// Writes the snapshot in parts of `bodies_per_part` bodies, and the index last; in one file if one part holds all
    /// bodies.
    ///
    /// The bytes depend on the snapshot and `bodies_per_part` alone. If the program ends meanwhile, parts remain, but no
    /// index. The folder must exist, see [`atomic::write_file`].
    pub fn write_in_parts(&self, path: &Path, bodies_per_part: usize) -> Result<(), Faults> {
        let bodies = self.bodies.body_id.len();
        if bodies <= bodies_per_part {
            return self.write_to_folder(path);
        }
        let (shapes, interval) = (self.shapes.as_ref(), self.interval.as_ref());
        let first_bodies = FirstBodies {
            contacts: &self.contacts.contact_body,
            turning: shapes.map_or(&[], |shapes| &shapes.turning.turning_body),
            pairs: shapes.map_or(&[], |shapes| &shapes.pairs.pair_body),
            interval: interval.map_or(&[], |interval| &interval.interval_body),
        };
        let (mut parts, mut rows) = (Vec::new(), PartRows::default());
        for (number, first) in (0..bodies).step_by(bodies_per_part).enumerate() {
            let end = bodies.min(first.saturating_add(bodies_per_part));
            rows = rows.next_part(first..end, end == bodies, first_bodies);
            let bytes = self.archive_bytes(Some(&rows));
            atomic::write_file(&part_path(path, number), |file| file.write_all(&bytes))?;
            parts.push(SnapshotPart::new(rows.bodies.len(), &bytes));
        }
        let index = Snapshot { meta: SnapshotMeta { parts, ..self.meta.clone() }, ..Snapshot::default() };
        atomic::write_file(path, |file| file.write_all(&index.index_bytes()))
    }

    /// Reads the rows of all parts that `meta` names. Errors: parts that are missing, damaged, or not those of the index
    /// at `path`.
    fn read_parts(path: &Path, meta: &SnapshotMeta) -> Result<Self, Faults> {
        let (mut all, mut faults) = (Snapshot::default(), Faults::default());
        for (number, part) in meta.parts.iter().enumerate() {
            let part_rows = Snapshot::read_part(path, &part_path(path, number), part);
            faults.gather_result(part_rows).into_iter().for_each(|rows| all.append(rows));
        }
        faults.into_result(all)
    }

    /// Reads the rows of a part of the index at `index`.
    fn read_part(index: &Path, path: &Path, part: &SnapshotPart) -> Result<Self, Faults> {
        let mut entries = NpzReader::new(path, part.read_bytes(path, index)?)
            .map_err(|error| other_part(path, index, error.to_string()))?;
        let rows = Snapshot::read_arrays(SnapshotMeta::default(), &mut entries);
        entries.faults.into_result(())?;
        let bodies = rows.bodies.body_id.len() as u64;
        let other_part_fault = || other_part(path, index, format!("{bodies} bodies, not {}", part.bodies));
        if bodies == part.bodies { Ok(rows) } else { Err(other_part_fault()) }
    }

    /// Appends the rows of a later part.
    fn append(&mut self, part: Snapshot) {
        fn append_group<T>(own: &mut Option<T>, other: Option<T>, append: impl FnOnce(&mut T, T)) {
            match (own, other) {
                (Some(own), Some(other)) => append(own, other),
                (own @ None, other) => *own = other,
                (Some(_), None) => {}
            }
        }
        let Snapshot { bodies, contacts, memory, laws, attractions, gravity, shapes, interval, .. } = part;
        self.bodies.append(bodies);
        self.contacts.append(contacts);
        append_group(&mut self.memory, memory, |own, other| own.append(other));
        append_group(&mut self.laws, laws, |own, other| own.append(other));
        append_group(&mut self.attractions, attractions, |own, other| own.append(other));
        append_group(&mut self.gravity, gravity, |own, other| own.append(other));
        append_group(&mut self.presence, part.presence, |own, other| own.append(other));
        append_group(&mut self.departures, part.departures, |own, other| own.append(other));
        append_group(&mut self.shapes, shapes, |own, other| own.append(other));
        append_group(&mut self.interval, interval, |own, other| own.append(other));
    }

    /// Reads a file, with its parts if it is an index. Errors: no .npz file of this format, another step than its name says,
    /// wrong checksums, shapes or numbers of rows, numbers that are not finite, indices out of range.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        let bytes = atomic::read_bytes(path)?;
        let snapshot_fault = |found: String| {
            Faults::from(Fault::new(path, None, "snapshot", found, "expected an .npz file of cd-solve"))
        };
        let mut entries = NpzReader::new(path, bytes).map_err(|error| snapshot_fault(error.to_string()))?;
        let Some(meta_text): Option<Vec<u8>> = entries.read_array("meta", None) else { return Err(entries.faults) };
        let version: serde_json::Value =
            serde_json::from_slice(&meta_text).map_err(|error| snapshot_fault(describe_json_error(&error)))?;
        if version["format"].as_u64() != Some(FORMAT_VERSION.into()) {
            return Err(snapshot_fault(format!(
                "meta: format {}; this program reads {FORMAT_VERSION}",
                version["format"]
            )));
        }
        let meta: SnapshotMeta =
            serde_json::from_slice(&meta_text).map_err(|error| snapshot_fault(describe_json_error(&error)))?;
        if let Some(step) = step_of(path).filter(|step| *step != meta.step) {
            let (found, expected) = (format!("of step {}", meta.step), format!("expected {step}, as its name says"));
            return Err(Fault::new(path, None, "snapshot", found, expected).into());
        }
        let snapshot = if meta.parts.is_empty() {
            let snapshot = Snapshot::read_arrays(meta, &mut entries);
            entries.faults.into_result(())?;
            snapshot
        } else {
            let rows = Snapshot::read_parts(path, &meta)?;
            Snapshot { meta: SnapshotMeta { parts: Vec::new(), ..meta }, ..rows }
        };
        snapshot.check_indices().map_err(|error| snapshot_fault(error.to_string()))?;
        snapshot.check_quaternions(path)?;
        Ok(snapshot)
    }

    /// Reads all arrays but `meta`; their faults are those of `entries`.
    fn read_arrays(meta: SnapshotMeta, entries: &mut NpzReader) -> Self {
        Snapshot {
            meta,
            bodies: BodyArrays::read(entries),
            contacts: ContactArrays::read(entries),
            memory: entries.has_array("contact_bonded").then(|| MemoryArrays::read(entries)),
            laws: entries.has_array("contact_reference_gap").then(|| LawArrays::read(entries)),
            attractions: entries.has_array("contact_attraction").then(|| AttractionArrays::read(entries)),
            gravity: entries.has_array("gravity_last").then(|| GravityArrays::read(entries)),
            presence: entries.has_array("body_presence").then(|| PresenceArrays::read(entries)),
            departures: entries.has_array("body_exit_v").then(|| DepartureArrays::read(entries)),
            shapes: entries.has_array("turning_body").then(|| ShapeArrays::read(entries)),
            interval: entries.has_array("interval_body").then(|| IntervalArrays::read(entries)),
        }
    }

    /// Whether the body of a row is in the run: it has entered and has not left.
    pub fn is_present(&self, row: usize) -> bool {
        self.presence.as_ref().is_none_or(|presence| presence.body_presence[row] == PRESENCE_PRESENT)
    }

    /// Checks that quaternions have unit length, to the digits of the files.
    fn check_quaternions(&self, path: &Path) -> Result<(), Faults> {
        let mut faults = Faults::default();
        for (number, q) in (1..).zip(&self.bodies.body_q) {
            let square: f64 = q.iter().map(|x| x * x).sum();
            if (square - 1.0).abs() > 1e-6 {
                let object = format!("array body_q, row {number}");
                faults.push(Fault::new(path, None, object, format!("{q:?}"), "expected a quaternion of length 1"));
            }
        }
        faults.into_result(())
    }

    /// Checks that arrays of the same rows have equal lengths and that indices are those of existing rows.
    fn check_indices(&self) -> Result<(), IndexError> {
        let Snapshot { meta, bodies, contacts, memory, laws, attractions, gravity, shapes, interval, .. } = self;
        let (body_count, contact_count) = (bodies.body_id.len(), contacts.contact_body.len());
        let contact_rows = [
            memory.as_ref().map(|memory| memory.contact_bonded.len()),
            laws.as_ref().map(|laws| laws.contact_reference_gap.len()),
            attractions.as_ref().map(|attractions| attractions.contact_attraction.len()),
        ];
        if contact_rows.into_iter().flatten().any(|rows| rows != contact_count) {
            return Err(IndexError::ContactRows);
        }
        let interval_bodies = interval.iter().flat_map(|interval| &interval.interval_body);
        let in_range = shapes.as_ref().is_none_or(|shapes| shapes.are_in_range(body_count, contact_count))
            && contacts.contact_body.iter().chain(interval_bodies).flatten().all(|&body| (body as usize) < body_count)
            && contacts.contact_law.iter().all(|&law| (law as usize) < meta.laws.len())
            && bodies.body_colour.iter().all(|&colour| (colour as usize) < meta.colours.len())
            && bodies.body_material.iter().all(|&material| (material as usize) < meta.materials.len())
            && gravity.as_ref().is_none_or(|gravity| gravity.gravity_last.len() == body_count)
            && self.presence.as_ref().is_none_or(|presence| presence.body_presence.len() == body_count)
            && self.departures.as_ref().is_none_or(|departures| departures.body_exit_v.len() == body_count);
        let interval_bodies = interval.iter().flat_map(|interval| &interval.interval_body);
        let named = contacts.contact_body.iter().chain(interval_bodies).flatten();
        if in_range && named.into_iter().any(|&body| !self.is_present(body as usize)) {
            return Err(IndexError::AbsentBody);
        }
        if contacts.contact_status.iter().any(|status| *status > STATUS_SLIDE) {
            return Err(IndexError::UnknownStatus);
        }
        if in_range { Ok(()) } else { Err(IndexError::OutOfRange) }
    }
}

/// Arrays of a snapshot that do not fit together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum IndexError {
    ContactRows,
    OutOfRange,
    AbsentBody,
    UnknownStatus,
}

impl fmt::Display for IndexError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            IndexError::ContactRows => "the arrays of contacts have different numbers of rows",
            IndexError::OutOfRange => "an index points outside its table",
            IndexError::AbsentBody => "a contact of a body that is not in the run",
            IndexError::UnknownStatus => "a contact with a status other than 0, 1 and 2",
        })
    }
}

impl std::error::Error for IndexError {}

/// Fault of the JSON of `meta`.
fn describe_json_error(error: &serde_json::Error) -> String {
    let quoted = error.to_string().split('`').nth(1).map(str::to_string);
    match (error.classify(), quoted) {
        (serde_json::error::Category::Data, Some(field)) => {
            format!("meta: '{field}' is missing or not as this program writes it")
        }
        (serde_json::error::Category::Data, None) => {
            format!("meta: a value at byte {} is not as this program writes it", error.column())
        }
        _ => "meta: its text is no JSON".into(),
    }
}

/// `DATBOX/START.npz`: exact initial state, if present. See `docs/reference/files/snapshots.md`.
pub const START_FILE: &str = "START.npz";

/// Path of `OUTBOX/snapshot-NNNNNN.npz` for a step.
pub fn snapshot_path(outbox: &Path, step: u64) -> PathBuf {
    outbox.join(format!("snapshot-{step:06}.npz"))
}

/// Files of the snapshot of a step: its parts, if it has such, then the index or the only file.
pub fn snapshot_files(outbox: &Path, step: u64) -> Vec<PathBuf> {
    let path = snapshot_path(outbox, step);
    let parts = (0..).map(|number| part_path(&path, number)).take_while(|part| atomic::path_exists(part));
    parts.chain([path.clone()]).collect()
}

/// Snapshots of a folder by step; an absent folder has none. Errors: it cannot be read, or has two files of one step.
pub fn list_snapshots(outbox: &Path) -> Result<Vec<(u64, PathBuf)>, Faults> {
    let paths = atomic::folder_entries(outbox)?.into_iter();
    let mut found: Vec<(u64, PathBuf)> = paths.filter_map(|path| Some((step_of(&path)?, path))).collect();
    found.sort();
    let mut faults = Faults::default();
    for pair in found.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        let [first, second] = [&pair[0].1, &pair[1].1].map(|path| path.file_name().unwrap_or_default().display());
        let found = format!("{first} and {second} are both of step {}", pair[0].0);
        faults.push(Fault::new(outbox, None, "snapshots", found, "expected one; move the other out of the folder"));
    }
    faults.into_result(found)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn sample() -> Snapshot {
        let mut s = Snapshot::default();
        s.meta.time = 0.1 + 0.2;
        s.meta.colours = vec!["BLUEx".into()];
        s.meta.materials = vec![MaterialName { name: "ROCKx".into(), density: 2700.0 }];
        s.bodies.body_id = vec![1, 2];
        s.bodies.body_x = vec![[-0.0, 5e-324, 1.0 / 3.0], [1e300, -1.0, 0.0]];
        s.bodies.body_q = vec![[1.0, 0.0, 0.0, 0.0]; 2];
        s.bodies.body_v = vec![[0.0; 3]; 2];
        s.bodies.body_w = vec![[0.0; 3]; 2];
        s.bodies.body_w_world = vec![[0.0; 3]; 2];
        s.bodies.body_mass = vec![1.0; 2];
        s.bodies.body_inertia = vec![[1.0; 3]; 2];
        s.bodies.body_radius = vec![1.0; 2];
        s.bodies.body_half_lengths = vec![[1.0; 3]; 2];
        s.bodies.body_shape = vec![SHAPE_SPHERE; 2];
        s.bodies.body_driven = vec![0; 2];
        s.bodies.body_colour = vec![0; 2];
        s.bodies.body_material = vec![0; 2];
        s
    }

    #[test]
    fn round_trips_every_bit_with_and_without_contacts() {
        let folder = tempfile::tempdir().unwrap();
        let path = snapshot_path(folder.path(), 12);
        let sample = || {
            let mut sample = sample();
            sample.meta.step = 12;
            sample
        };
        let snapshot = sample();
        snapshot.write(&path).unwrap();
        let read = Snapshot::read(&path).unwrap();
        assert_eq!(read, snapshot);
        assert_eq!(read.to_bytes(), snapshot.to_bytes()); // -0.0 == 0.0, so compare bytes too
        assert_eq!(list_snapshots(folder.path()), Ok(vec![(12, path.clone())]));
        let mut timed = sample();
        timed.meta.interval_start = Some(-0.5);
        timed.interval = Some(IntervalArrays { interval_body: vec![[0, 1]], interval_virial: vec![0.1] });
        timed.write(&path).unwrap();
        assert_eq!(Snapshot::read(&path).unwrap(), timed);
        timed.interval = Some(IntervalArrays { interval_body: vec![[0, 2]], interval_virial: vec![0.1] });
        timed.write(&path).unwrap();
        assert!(Snapshot::read(&path).unwrap_err().to_string().contains("outside its table"));
        let mut remembering = sample();
        remembering.memory = Some(MemoryArrays::default());
        remembering.write(&path).unwrap();
        assert_eq!(Snapshot::read(&path).unwrap(), remembering);
        remembering.memory =
            Some(MemoryArrays { contact_bonded: vec![1], contact_bond_gap: vec![0.1], contact_moment: vec![[0.0; 3]] });
        remembering.write(&path).unwrap();
        Snapshot::read(&path).unwrap_err();
    }

    /// Three bodies, of which the last has no contact as the candidate, in parts of two and of one.
    fn sample_in_parts() -> Snapshot {
        let mut all = sample();
        all.bodies.append(sample().bodies.select_rows(&[0]));
        all.meta.laws = vec![LawName { nickname: "law00".into(), kind: "IQS_CLB".into(), parameters: vec![0.4] }];
        all.contacts = ContactArrays {
            contact_body: vec![[0, 1], [0, 2], [1, 2]],
            contact_feature: vec![[0, 0]; 3],
            contact_point: vec![[0.5; 3]; 3],
            contact_frame: vec![[[1.0; 3]; 3]; 3],
            contact_gap: vec![0.1, 0.2, 0.3],
            contact_force: vec![[1.0; 3]; 3],
            contact_impulse: vec![[2.0; 3]; 3],
            contact_velocity: vec![[0.0; 3]; 3],
            contact_status: vec![STATUS_STICK; 3],
            contact_law: vec![0; 3],
        };
        let gravity_last = vec![[1.0; 3], [2.0; 3], [3.0; 3]];
        all.gravity = Some(GravityArrays { gravity_before: gravity_last.clone(), gravity_last });
        all.shapes = Some(ShapeArrays {
            turning: TurningArrays { turning_body: vec![1, 2], turning_momentum: vec![[1.0; 3], [2.0; 3]] },
            contacts: ContactPartArrays { contact_rank: vec![[0, 1]; 3], contact_area: vec![1.0, 2.0, 3.0] },
            pairs: PairArrays {
                pair_body: vec![[0, 1], [1, 2]],
                pair_rank: vec![[0, 0]; 2],
                pair_memory: vec![[7, 8]; 2],
            },
        });
        all.interval = Some(IntervalArrays { interval_body: vec![[0, 1], [1, 2]], interval_virial: vec![0.1, 0.2] });
        all
    }

    #[test]
    fn parts_have_the_rows_of_their_bodies_and_make_the_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = snapshot_path(folder.path(), 0);
        let whole = sample_in_parts();
        for (bodies_per_part, gaps) in
            [(2, vec![vec![0.1, 0.2, 0.3], vec![]]), (1, vec![vec![0.1, 0.2], vec![0.3], vec![]])]
        {
            whole.write_in_parts(&path, bodies_per_part).unwrap();
            assert_eq!(Snapshot::read(&path).unwrap().to_bytes(), whole.to_bytes());
            for (number, expected) in gaps.iter().enumerate() {
                let part = part_path(&path, number);
                let mut entries = NpzReader::new(&part, fs::read(&part).unwrap()).unwrap();
                assert_eq!(entries.read_array::<f64>("contact_gap", None).as_ref(), Some(expected));
                assert!(!entries.has_array("meta"));
            }
            assert_eq!(list_snapshots(folder.path()), Ok(vec![(0, path.clone())]));
        }
        whole.write_in_parts(&path, 3).unwrap();
        assert_eq!(fs::read(&path).unwrap(), whole.to_bytes());
    }

    #[test]
    fn parts_are_those_of_their_index() {
        let folder = tempfile::tempdir().unwrap();
        let path = snapshot_path(folder.path(), 0);
        sample_in_parts().write_in_parts(&path, 1).unwrap();
        let mut other = sample_in_parts();
        other.bodies.body_x[1][0] = 2.0;
        let other_folder = folder.path().join("other");
        fs::create_dir(&other_folder).unwrap();
        other.write_in_parts(&snapshot_path(&other_folder, 0), 1).unwrap();
        fs::copy(part_path(&snapshot_path(&other_folder, 0), 1), part_path(&path, 1)).unwrap();
        fs::remove_file(part_path(&path, 2)).unwrap();
        let faults = Snapshot::read(&path).unwrap_err().to_string();
        let lines: Vec<&str> = faults.lines().collect();
        assert!(lines.len() == 2 && lines[0].contains("part-000001.npz: part of a snapshot: CRC-32 "), "{faults}");
        assert!(lines[1].contains("part-000002.npz"), "{faults}");
        // Without the index the parts are no snapshot, and are removed.
        remove_orphan_parts(folder.path()).unwrap();
        assert!(part_path(&path, 0).exists());
        fs::remove_file(&path).unwrap();
        remove_orphan_parts(folder.path()).unwrap();
        assert!(!part_path(&path, 0).exists() && !part_path(&path, 1).exists());
    }

    #[test]
    fn rejects_what_is_renamed_and_folders_that_cannot_be_read() {
        let folder = tempfile::tempdir().unwrap();
        sample().write(&snapshot_path(folder.path(), 3)).unwrap();
        let refused = Snapshot::read(&snapshot_path(folder.path(), 3)).unwrap_err().to_string();
        assert!(refused.ends_with("snapshot: of step 0; expected 3, as its name says"), "{refused}");
        assert_eq!(list_snapshots(&folder.path().join("absent")), Ok(Vec::new()));
        list_snapshots(&snapshot_path(folder.path(), 3)).unwrap_err();
    }

    #[test]
    fn rejects_what_is_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("snapshot-000000.npz");
        let bytes = sample().to_bytes();
        for cut in [0, 10, bytes.len() / 2, bytes.len() - 1] {
            fs::write(&path, &bytes[..cut]).unwrap();
            Snapshot::read(&path).unwrap_err();
        }
        let place = bytes.windows(8).position(|w| w == 1e300f64.to_le_bytes()).unwrap();
        let mut flipped = bytes.clone();
        flipped[place] ^= 1;
        fs::write(&path, &flipped).unwrap();
        assert!(Snapshot::read(&path).unwrap_err().to_string().contains("body_x"));
    }

    #[test]
    fn rejects_what_is_not_finite_row_by_row() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("snapshot-000000.npz");
        let mut wrong = sample();
        wrong.bodies.body_q[1][2] = f64::NAN;
        wrong.bodies.body_mass[0] = f64::INFINITY;
        wrong.write(&path).unwrap();
        let text = Snapshot::read(&path).unwrap_err().to_string();
        assert_eq!(text.lines().count(), 2, "{text}");
        assert!(text.contains("array body_q, row 2: [") && text.contains("array body_mass, row 1: [inf]"), "{text}");
    }

    #[test]
    fn rejects_indices_and_rows_that_do_not_fit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("snapshot-000000.npz");
        let mut wrong = sample();
        wrong.bodies.body_material[1] = 3;
        wrong.write(&path).unwrap();
        assert!(Snapshot::read(&path).unwrap_err().to_string().contains("outside its table"));
        let mut short = sample();
        short.bodies.body_mass.pop();
        short.write(&path).unwrap();
        assert!(Snapshot::read(&path).unwrap_err().to_string().contains("array body_mass: has 1 rows"));
    }
}
