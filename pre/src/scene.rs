//! Contents of `scene.ron`: the types, each field with its unit. `docs/reference/scene/` describes them for users.
//!
//! SI units and radians throughout. No meaning is checked here but the shape of the text; see [`crate::check`].

use cd_formats::compute::Compute;
use cd_formats::law_table::LawModel;
use cd_formats::tact_behav::LawRecord;
use serde::{Deserialize, Deserializer};

/// The whole of a `scene.ron`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Seed of all that is drawn at random; same seed, same files.
    #[serde(default)]
    pub seed: u64,
    /// Uniform gravity, m/s^2, fixed axes.
    #[serde(default)]
    pub gravity: [f64; 3],
    pub materials: Vec<Material>,
    pub laws: Vec<Law>,
    pub contacts: Vec<Contact>,
    /// Bodies of grains, in the order of their numbers in the files.
    pub grains: Vec<Grains>,
    /// Walls; their bodies come behind the grains.
    #[serde(default)]
    pub walls: Vec<SceneWall>,
    /// Options of the run, written to COMPUTE.RON.
    #[serde(default)]
    pub compute: Compute,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// One to five characters.
    pub name: String,
    /// kg/m^3
    pub density: f64,
}

/// A contact law under its nickname. The laws and their parameters are those of [`cd_formats::law_table`].
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Law {
    /// One to five characters.
    pub name: String,
    /// One of the laws of the table, by LMGC90's name.
    pub kind: LawModel,
}

/// Which law holds between two colours.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// The two colours, in any order; may be the same.
    pub between: (String, String),
    /// Name of the law; `None` lets the two pass through each other. Must be given.
    #[serde(deserialize_with = "required_option")]
    pub law: Option<String>,
    /// Distance surface to surface within which contacts are listed, m.
    #[serde(default)]
    pub alert: Option<f64>,
}

/// A field that serde may not leave out although it is an `Option`.
fn required_option<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    Option::deserialize(deserializer)
}

/// One body of grains: of one material, one colour and one kind of shape.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grains {
    /// Name of a material.
    pub material: String,
    /// One to five characters.
    pub colour: String,
    /// How many grains; for lists of sizes or positions their length, if left out.
    #[serde(default)]
    pub number: Option<usize>,
    /// Volume of the grains over that of the envelope, 0 to 1.
    #[serde(default)]
    pub solid_fraction: Option<f64>,
    #[serde(default)]
    pub shape: GrainShape,
    /// Left out for grains with a size of their own: `Box`, `Vertices`, `Model`, and `Fragments`.
    #[serde(default)]
    pub sizes: Option<SizeDistribution>,
    /// Radius of a polyhedron that the sizes give.
    #[serde(default)]
    pub radius: RadiusKind,
    /// Orientation of polyhedra.
    #[serde(default)]
    pub grain_orientation: GrainOrientations,
    /// Positions of the grains.
    pub placement: GrainPlacement,
    /// Centre of the envelope, or origin of the listed positions, m.
    #[serde(default)]
    pub centre: [f64; 3],
    /// Turns the envelope, or the listed positions, about `centre`.
    #[serde(default)]
    pub orientation: Rotation,
    /// Velocity of the centre of mass, m/s.
    #[serde(default)]
    pub velocity: [f64; 3],
    /// Rigid rotation about the centre of mass, rad/s, fixed axes.
    #[serde(default)]
    pub spin: [f64; 3],
    /// Root mean square of an additional random velocity without net momentum, m/s.
    #[serde(default)]
    pub thermal_velocity: f64,
    /// Imposes the velocity of every grain, m/s, along the fixed axes but those without a function; the grains do not turn.
    #[serde(default)]
    pub driven: Option<[Option<TimeFunction>; 3]>,
}

/// Shape of the grains.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum GrainShape {
    #[default]
    Sphere,
    /// Random convex polyhedra, a different one for each grain, with vertices on an ellipsoid.
    Random {
        /// The number of vertices, from the first to the second, each equally likely.
        vertices: (usize, usize),
        /// Semi-axes of the ellipsoid to each other.
        #[serde(default = "default_ratios")]
        ratios: [f64; 3],
        /// 0: vertices evenly spread; 1: anywhere on the ellipsoid.
        #[serde(default = "default_angularity")]
        angularity: f64,
    },
    Tetrahedron,
    Cube,
    Octahedron,
    Dodecahedron,
    Icosahedron,
    /// Whole lengths, m.
    Box {
        lengths: [f64; 3],
    },
    /// A regular polygon of so many sides, extruded along the third axis.
    Prism {
        sides: usize,
        /// Height over the diameter of the circle around the polygon.
        slenderness: f64,
    },
    /// The convex hull of these points, m.
    Vertices(Vec<[f64; 3]>),
    /// A surface from a file.
    Model {
        /// .obj, .stl, .vtk or .vtp; relative to the folder of the scene.
        file: String,
        #[serde(default)]
        scale: ModelScale,
        #[serde(default)]
        contact_shape: ContactSurface,
    },
}

fn default_ratios() -> [f64; 3] {
    [1.0; 3]
}

fn default_angularity() -> f64 {
    0.5
}

/// The size of a model.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum ModelScale {
    /// Factor of all lengths of the file; 1000 for a file in km.
    Factor(f64),
    /// m^3
    Volume(f64),
    /// Radius of the sphere of equal volume, m.
    Radius(f64),
    /// The longest side of the box around it, along the axes of the file, m.
    Length(f64),
}

impl Default for ModelScale {
    fn default() -> Self {
        ModelScale::Factor(1.0)
    }
}

/// Contact shape of a model.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum ContactSurface {
    /// Its own surface, which must be convex.
    #[default]
    Surface,
    /// Its convex hull, which is its solid too.
    Hull,
    /// Convex pieces that approximate it; mass and inertia are those of the surface itself.
    Pieces {
        max_pieces: u32,
        /// Largest concavity of the pieces, 0 to 1.
        #[serde(default = "default_concavity")]
        concavity: f64,
        /// Largest number of vertices of a piece.
        #[serde(default = "default_hull_vertices")]
        max_vertices: usize,
    },
    /// Convex pieces in files of their own, in the axes of the model; mass and inertia as for `Pieces`.
    Files(Vec<String>),
}

fn default_concavity() -> f64 {
    0.01
}

fn default_hull_vertices() -> usize {
    64
}

/// Radius of a polyhedron that a size gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum RadiusKind {
    /// Radius of the sphere of equal volume.
    #[default]
    EqualVolume,
    /// The farthest vertex from the centre of mass.
    Circumscribed,
}

/// Rotation of each polyhedron from the axes in which its shape is given.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum GrainOrientations {
    /// Uniformly distributed rotations.
    #[default]
    Random,
    /// All the same.
    Same(Rotation),
    /// One for each grain.
    List(Vec<Rotation>),
}

/// Sizes of the grains: radii, m.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum SizeDistribution {
    /// All the same.
    Single(f64),
    /// Every radius from `min` to `max` equally likely.
    Uniform { min: f64, max: f64 },
    /// The number of grains larger than r falls as r^-exponent, cut at `min` and `max`.
    PowerLaw { min: f64, max: f64, exponent: f64 },
    /// ln r is normal with mean ln `median` and standard deviation `sigma`, cut at `min` and `max`.
    LogNormal { median: f64, sigma: f64, min: f64, max: f64 },
    /// These; in this order for listed positions, else shuffled.
    List(Vec<f64>),
}

/// Where grains are put.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum GrainPlacement {
    /// Sites of a face-centred cubic lattice, each grain moved at random within its site's ball.
    JitteredLattice {
        envelope: Envelope,
        /// Share of a grain's free room that the random move may use, 0 to 1.
        #[serde(default = "default_jitter")]
        jitter: f64,
    },
    /// One after the other, largest first, anywhere in the envelope where there is room.
    RandomSequential { envelope: Envelope },
    /// Convex fragments that fill a solid without gaps: the cells of points at random (Voronoi).
    Fragments {
        envelope: Envelope,
        /// How often each point is moved to the centre of its cell, which makes fragments more alike.
        #[serde(default)]
        relaxation: usize,
    },
    /// Positions relative to `centre`, m.
    List {
        positions: Vec<[f64; 3]>,
        #[serde(default)]
        allow_overlap: bool,
    },
}

fn default_jitter() -> f64 {
    1.0
}

/// Shape and size of the room that whole grains must keep within, centred on `centre`; the size is
/// left out (or the ratios given) where `number` and `solid_fraction` together determine it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum Envelope {
    Ball {
        /// m
        #[serde(default)]
        radius: Option<f64>,
    },
    Ellipsoid {
        /// m
        #[serde(default)]
        semi_axes: Option<[f64; 3]>,
        /// Semi-axes to each other.
        #[serde(default)]
        ratios: Option<[f64; 3]>,
    },
    Box {
        /// Whole lengths, m.
        #[serde(default)]
        lengths: Option<[f64; 3]>,
        /// Lengths to each other.
        #[serde(default)]
        ratios: Option<[f64; 3]>,
    },
    /// Its axis is the third.
    Cylinder {
        /// m
        half_height: f64,
        /// m
        radius: f64,
    },
    /// A closed surface from a file, its centre of mass at `centre`.
    Model {
        /// As in `Shape::Model`.
        file: String,
        #[serde(default)]
        scale: Option<ModelScale>,
    },
}

/// A turn by `angle`, rad, about `axis` (of any length), right-handed.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rotation {
    pub axis: [f64; 3],
    pub angle: f64,
}

impl Default for Rotation {
    fn default() -> Self {
        Rotation { axis: [0.0, 0.0, 1.0], angle: 0.0 }
    }
}

/// Walls are plates and cylinders; their motion is imposed, but for the components along which a force is.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum SceneWall {
    /// One plate with two contact faces, at `centre` +- its half thickness along `normal`.
    Plate {
        material: String,
        colour: String,
        /// m
        centre: [f64; 3],
        /// Of any length.
        #[serde(default = "default_axis")]
        normal: [f64; 3],
        /// Direction of the first half length, need not be quite at right angles to `normal`.
        #[serde(default)]
        first_axis: Option<[f64; 3]>,
        /// Along the first axis, the second (normal x first) and the normal, m.
        half_lengths: [f64; 3],
        /// Velocity, m/s, along the fixed axes.
        #[serde(default)]
        velocity: [TimeFunction; 3],
        /// Force, N, along the fixed axes: where there is one the plate moves as this, its weight and contacts push it.
        #[serde(default)]
        force: Box<[Option<TimeFunction>; 3]>,
        /// Angular velocity, rad/s, about the plate's first axis, second axis and normal.
        #[serde(default)]
        angular_velocity: [TimeFunction; 3],
    },
    /// Five or six plates around a room; their faces are flush with the room.
    Box {
        material: String,
        colour: String,
        /// Centre of the room, m.
        #[serde(default)]
        centre: [f64; 3],
        /// Whole lengths of the room, m.
        lengths: [f64; 3],
        /// Turns the box about `centre`.
        #[serde(default)]
        orientation: Rotation,
        /// Of the plates, m.
        half_thickness: f64,
        /// Whether there is a plate on top (the box's own third axis) too.
        #[serde(default)]
        lid: bool,
        /// Velocity of all plates, m/s, along the fixed axes.
        #[serde(default)]
        velocity: [TimeFunction; 3],
    },
    /// A solid cylinder, or the inside of a closed drum.
    Cylinder {
        material: String,
        colour: String,
        /// m
        centre: [f64; 3],
        /// Of any length.
        #[serde(default = "default_axis")]
        axis: [f64; 3],
        /// m
        half_height: f64,
        /// m
        radius: f64,
        /// Whether grains are within, and not around it.
        #[serde(default)]
        hollow: bool,
        /// As of a plate.
        #[serde(default)]
        velocity: [TimeFunction; 3],
        /// As of a plate.
        #[serde(default)]
        force: Box<[Option<TimeFunction>; 3]>,
        /// Angular velocity, rad/s, about the axis.
        #[serde(default)]
        angular_velocity: TimeFunction,
    },
}

fn default_axis() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

/// A velocity as a function of time t, s.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum TimeFunction {
    Constant(f64),
    /// (constant + amplitude cos(omega t + phase)) min(1, ramp_start + ramp_rate t)
    Harmonic {
        #[serde(default)]
        constant: f64,
        amplitude: f64,
        /// rad/s
        omega: f64,
        /// rad
        #[serde(default)]
        phase: f64,
        /// 1, or with a rising ramp 0.
        #[serde(default)]
        ramp_start: Option<f64>,
        /// 1/s
        #[serde(default)]
        ramp_rate: f64,
    },
    /// Points (time, value), linear between them and beyond both ends.
    Table(Vec<(f64, f64)>),
}

impl Default for TimeFunction {
    fn default() -> Self {
        TimeFunction::Constant(0.0)
    }
}

impl Law {
    /// The law as TACT_BEHAV.DAT has it.
    pub fn to_record(&self) -> LawRecord {
        LawRecord {
            line: 0,
            nickname: self.name.clone(),
            kind: self.kind.label().to_string(),
            parameters: self.kind.values(),
        }
    }
}

impl GrainShape {
    /// Whether it is given in axes of its own, which need not be the principal ones.
    pub fn has_axes(&self) -> bool {
        matches!(self, GrainShape::Vertices(_) | GrainShape::Model { .. })
    }
}

impl GrainPlacement {
    pub fn envelope(&self) -> Option<&Envelope> {
        match self {
            GrainPlacement::JitteredLattice { envelope, .. }
            | GrainPlacement::RandomSequential { envelope }
            | GrainPlacement::Fragments { envelope, .. } => Some(envelope),
            GrainPlacement::List { .. } => None,
        }
    }
}

impl Grains {
    /// Whether it is a single body.
    pub fn is_single_body(&self) -> bool {
        self.number == Some(1)
            || matches!(&self.placement, GrainPlacement::List { positions, .. } if positions.len() == 1)
    }

    /// Whether they are polyhedra and no spheres.
    pub fn is_polyhedral(&self) -> bool {
        self.shape != GrainShape::Sphere || matches!(self.placement, GrainPlacement::Fragments { .. })
    }
}

/// Files of the surfaces that grains are made from or placed in, as the scene names them.
pub fn models(grains: &[Grains]) -> impl Iterator<Item = &str> {
    grains.iter().flat_map(|grains| {
        let (shape, pieces) = match &grains.shape {
            GrainShape::Model { file, contact_shape: ContactSurface::Files(pieces), .. } => {
                (Some(file), pieces.as_slice())
            }
            GrainShape::Model { file, .. } => (Some(file), &[][..]),
            _ => (None, &[][..]),
        };
        let envelope = match grains.placement.envelope() {
            Some(Envelope::Model { file, .. }) => Some(file),
            _ => None,
        };
        shape.into_iter().chain(pieces).chain(envelope).map(String::as_str)
    })
}
