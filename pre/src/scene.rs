//! Contents of `scene.ron`: the types, each field with its unit. `docs/reference/scene/` describes them for users.
//!
//! SI units and radians throughout. Only names and types are checked here, values in [`crate::check`].

use cd_formats::compute::Compute;
use cd_formats::deforming_cell::AxisControl;
use cd_formats::law_table::{LawModel, SpherePacking};
use cd_formats::orbit::OrbitSpec;
use cd_formats::tact_behav::LawRecord;
use nalgebra::Vector3;
use serde::{Deserialize, Deserializer};

/// The whole of a `scene.ron`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Seed of all random numbers; the same seed gives the same files.
    #[serde(default)]
    pub seed: u64,
    /// Uniform gravity, m/s^2, fixed axes.
    #[serde(default)]
    pub gravity: [f64; 3],
    pub materials: Vec<Material>,
    pub laws: Vec<Law>,
    pub contacts: Vec<ColourPairLaw>,
    /// Groups of grains, numbered in this order in the files.
    pub grains: Vec<Grains>,
    /// Walls, numbered after the grains.
    #[serde(default, deserialize_with = "deserialize_walls")]
    pub walls: Vec<SceneWall>,
    /// Options of the run, written to COMPUTE.RON.
    #[serde(default)]
    pub compute: Compute,
}

/// Material of grains and walls.
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
    /// Strength of the bulk from which the first parameter of a law with cohesion of pairs follows.
    #[serde(default)]
    pub bulk_strength: Option<BulkStrength>,
}

/// Tensile strength of a packing, and the packing to which Rumpf's formula is applied.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BulkStrength {
    /// Pa
    pub tension: f64,
    /// Solid fraction; left out, that of the snapshot from which the next run begins.
    #[serde(default)]
    pub nu: Option<f64>,
    /// Coordination number; left out, that of the snapshot from which the next run begins.
    #[serde(default)]
    pub z: Option<f64>,
    /// Diameter of the grains, m; only where the strength depends on it, under van der Waals forces.
    #[serde(default)]
    pub diameter: Option<f64>,
}

/// Contact law between two colours.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColourPairLaw {
    /// The two colours, in any order; may be the same.
    pub between: (String, String),
    /// Name of the law; required. `None`: bodies of these colours pass through each other.
    #[serde(deserialize_with = "required_option")]
    pub law: Option<String>,
    /// Gap up to which contacts are listed, m.
    #[serde(default)]
    pub alert: Option<f64>,
}

/// Reads an `Option` that must be given: by default serde reads a missing field as `None`.
fn required_option<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    Option::deserialize(deserializer)
}

/// One group of grains: of one material, one colour and one kind of shape.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grains {
    /// Name of a material.
    pub material: String,
    /// One to five characters.
    pub colour: String,
    /// Number of grains; default: the length of the list of sizes or positions.
    #[serde(default)]
    pub number: Option<usize>,
    /// Ratio of the volume of the grains to that of the envelope, 0 to 1.
    #[serde(default)]
    pub solid_fraction: Option<f64>,
    #[serde(default)]
    pub shape: GrainShape,
    /// None for grains with a size of their own: `Box`, `Cylinder`, `Capsule`, `Vertices`, `Model`, `Clump`, `ClumpFile`, and `Fragments`.
    #[serde(default)]
    pub sizes: Option<SizeDistribution>,
    /// Radius of a polyhedron, clump or round solid that the sizes give.
    #[serde(default)]
    pub radius: RadiusKind,
    /// Orientation of polyhedra, clumps and cylinders or capsules.
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
    /// Orbit on which the centre of mass starts, in place of `centre` and `velocity`.
    #[serde(default)]
    pub orbit: Option<GroupOrbit>,
    /// Rigid rotation about the centre of mass, rad/s, fixed axes.
    #[serde(default)]
    pub spin: [f64; 3],
    /// Root mean square of an additional random velocity without net momentum, m/s.
    #[serde(default)]
    pub thermal_velocity: f64,
    /// Imposed velocity of every grain, m/s, along the fixed axes; free along an axis without a function. Without
    /// `driven_spin` the grains do not rotate.
    #[serde(default)]
    pub driven: Option<[Option<TimeFunction>; 3]>,
    /// Imposed angular velocity of every grain, rad/s, about its principal axes; free about an axis without a function.
    #[serde(default)]
    pub driven_spin: Option<[Option<TimeFunction>; 3]>,
}

/// Orbit of the centre of mass of a group of grains.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GroupOrbit {
    /// Mass about which it moves.
    pub about: OrbitCentre,
    /// Position and velocity relative to that mass, as functions of the time of the run.
    pub path: OrbitSpec,
}

/// Mass about which a group of grains moves.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub enum OrbitCentre {
    /// Primary at rest, by its number in the option `fields`, from 1.
    Primary(usize),
    /// Grains of this colour in the groups before.
    Colour(String),
}

/// Shape of the grains.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum GrainShape {
    #[default]
    Sphere,
    /// Random convex polyhedra, a different one for each grain, with vertices on an ellipsoid.
    Random {
        /// Smallest and largest number of vertices, uniformly distributed.
        vertices: (usize, usize),
        /// Ratios of the semi-axes of the ellipsoid.
        #[serde(default = "default_ratios")]
        ratios: [f64; 3],
        /// 0: evenly spread vertices; 1: independent random vertices on the ellipsoid.
        #[serde(default = "default_angularity")]
        angularity: f64,
    },
    Tetrahedron,
    Cube,
    Octahedron,
    Dodecahedron,
    Icosahedron,
    /// Full edge lengths, m.
    Box {
        lengths: [f64; 3],
    },
    /// Regular polygon, extruded along the third axis.
    Prism {
        sides: usize,
        /// Ratio of the height to the diameter of the circle around the polygon.
        slenderness: f64,
    },
    /// Cylinder along the third axis.
    Cylinder {
        /// m
        half_height: f64,
        /// m
        radius: f64,
    },
    /// All points up to `radius` from a segment along the third axis.
    Capsule {
        /// Half length of the segment, m.
        half_length: f64,
        /// m
        radius: f64,
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
    /// Balls as one body: centre x, y, z and radius of each, m.
    Clump(Vec<[f64; 4]>),
    /// Balls of a file as one body.
    ClumpFile {
        /// Table of x, y, z, r, or another file of particles; relative to the folder of the scene.
        file: String,
        #[serde(default)]
        scale: ModelScale,
    },
}

fn default_ratios() -> [f64; 3] {
    [1.0; 3]
}

fn default_angularity() -> f64 {
    0.5
}

/// Size of a model.
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
    /// The model's own surface, which must be convex.
    #[default]
    Surface,
    /// The model's convex hull, which also gives volume and mass.
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
    /// Balls inscribed in the model; mass and inertia as for `Pieces`.
    Balls {
        max_balls: usize,
        /// Distance up to which the surface counts as covered, divided by the radius of the sphere of equal volume.
        #[serde(default = "default_ball_error")]
        max_error: f64,
    },
}

fn default_concavity() -> f64 {
    0.01
}

fn default_hull_vertices() -> usize {
    64
}

fn default_ball_error() -> f64 {
    0.05
}

/// Radius of a polyhedron or clump that a size gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum RadiusKind {
    /// Radius of the sphere of equal volume.
    #[default]
    EqualVolume,
    /// Distance of the farthest point from the centre of mass.
    Circumscribed,
}

/// Rotation of each polyhedron or clump from the axes in which its shape is given.
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
    /// Radii uniformly distributed from `min` to `max`.
    Uniform { min: f64, max: f64 },
    /// The number of grains larger than r falls as r^-exponent, cut at `min` and `max`.
    PowerLaw { min: f64, max: f64, exponent: f64 },
    /// ln r is normal with mean ln `median` and standard deviation `sigma`, cut at `min` and `max`.
    LogNormal { median: f64, sigma: f64, min: f64, max: f64 },
    /// Listed radii, in this order for listed positions, else shuffled.
    List(Vec<f64>),
}

/// Positions of grains.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum GrainPlacement {
    /// Sites of a face-centred cubic lattice, each grain moved at random within its site's ball.
    JitteredLattice {
        envelope: Envelope,
        /// Fraction of a grain's free distance that the random displacement may use, 0 to 1.
        #[serde(default = "default_jitter")]
        jitter: f64,
    },
    /// One after the other, largest first, at random free positions in the envelope.
    RandomSequential { envelope: Envelope },
    /// Up to random close packing: overlaps of grains at random positions are removed by minimisation of their energy.
    DensePacking { envelope: Envelope },
    /// Convex fragments that fill a solid without gaps: the cells of points at random (Voronoi).
    Fragments {
        envelope: Envelope,
        /// Number of times that each point is moved to the centre of its cell, which makes fragments more alike.
        #[serde(default)]
        relaxation: usize,
    },
    /// Positions relative to `centre`, m.
    List {
        positions: Vec<[f64; 3]>,
        #[serde(default)]
        allow_overlap: bool,
    },
    /// Spheres of a file, with their motion, relative to `centre`.
    File {
        /// Relative to the folder of the scene.
        path: String,
        /// Default: given by the ending.
        #[serde(default)]
        format: Option<ParticleFormat>,
        #[serde(default)]
        allow_overlap: bool,
    },
}

/// Format of a file of particles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum ParticleFormat {
    /// Table with a header.
    Csv,
    /// XYZ or extended XYZ.
    Xyz,
    /// Text dump of LAMMPS or LIGGGHTS.
    Lammps,
    /// Balls of a template of LIGGGHTS: x, y, z and radius, without a header.
    Multisphere,
    /// Binary `ss` file of pkdgrav.
    Pkdgrav,
}

fn default_jitter() -> f64 {
    1.0
}

/// Shape and size of the region in which whole grains are placed, centred on `centre`; the size is
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
        /// Ratios of the semi-axes.
        #[serde(default)]
        ratios: Option<[f64; 3]>,
    },
    Box {
        /// Full edge lengths, m.
        #[serde(default)]
        lengths: Option<[f64; 3]>,
        /// Ratios of the lengths.
        #[serde(default)]
        ratios: Option<[f64; 3]>,
    },
    /// Cylinder about the third axis.
    Cylinder {
        /// m
        half_height: f64,
        /// m
        radius: f64,
    },
    /// A closed surface from a file, its centre of mass at `centre`.
    Model {
        /// File of the surface, as in `GrainShape::Model`.
        file: String,
        #[serde(default)]
        scale: Option<ModelScale>,
    },
}

/// Right-handed rotation by `angle`, rad, about `axis`, of any length.
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

/// Plate, box of plates, cylinder or triangulated surface. Its motion is imposed, except along axes with a force and about axes with a moment.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum SceneWall {
    /// One plate with two contact faces, at `centre` +- its half thickness along `normal`.
    Plate {
        material: String,
        colour: String,
        /// m
        centre: [f64; 3],
        /// Normal of the plate, of any length.
        #[serde(default = "default_axis")]
        normal: [f64; 3],
        /// Direction of the first half length; its part along `normal` is dropped.
        #[serde(default)]
        first_axis: Option<[f64; 3]>,
        /// Half lengths along the first axis, the second (normal x first) and the normal, m.
        half_lengths: [f64; 3],
        /// Velocity, m/s, along the fixed axes.
        #[serde(default)]
        velocity: [TimeFunction; 3],
        /// Force, N, along the fixed axes; along an axis with a force the plate moves freely under it, its weight and contacts.
        #[serde(default)]
        force: Box<[Option<TimeFunction>; 3]>,
        /// Angular velocity, rad/s, about the plate's first axis, second axis and normal.
        #[serde(default)]
        spin: [TimeFunction; 3],
        /// Moment, N m, about the same axes; about an axis with a moment the plate turns freely under it and its contacts.
        #[serde(default)]
        moment: Box<[Option<TimeFunction>; 3]>,
        /// Pressure, Pa, on the current area, in the direction of the normal, along which the plate moves freely.
        #[serde(default)]
        pressure: Option<Box<TimeFunction>>,
        /// Rate, 1/s, of the logarithm of the distance to the plate opposite to it.
        #[serde(default)]
        strain_rate: Option<Box<TimeFunction>>,
        /// Rotation about an axis anywhere in space, in place of `velocity` and `spin`.
        #[serde(default)]
        revolution: Option<Box<Revolution>>,
        /// Velocity of the surface beyond that of the wall, m/s, along the fixed axes, as of a conveyor belt.
        #[serde(default)]
        surface_velocity: Box<[TimeFunction; 3]>,
    },
    /// Five or six plates around an interior, with faces flush with it.
    Box {
        material: String,
        colour: String,
        /// Centre of the interior, m.
        #[serde(default)]
        centre: [f64; 3],
        /// Full edge lengths of the interior, m.
        lengths: [f64; 3],
        /// Turns the box about `centre`.
        #[serde(default)]
        orientation: Rotation,
        /// Half thickness of the plates, m.
        half_thickness: f64,
        /// Whether a sixth plate closes the top, along the box's own third axis.
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
        /// Axis of the cylinder, of any length.
        #[serde(default = "default_axis")]
        axis: [f64; 3],
        /// m
        half_height: f64,
        /// m
        radius: f64,
        /// Whether the grains are inside.
        #[serde(default)]
        hollow: bool,
        /// Velocity, as of a plate.
        #[serde(default)]
        velocity: [TimeFunction; 3],
        /// Force, as of a plate.
        #[serde(default)]
        force: Box<[Option<TimeFunction>; 3]>,
        /// Angular velocity, rad/s, about the axis.
        #[serde(default)]
        spin: TimeFunction,
        /// Moment, N m, about the axis, under which and its contacts the cylinder turns freely.
        #[serde(default)]
        moment: Option<TimeFunction>,
        /// Pressure, Pa, on the end of a solid cylinder, in the direction of the axis, along which it moves freely.
        #[serde(default)]
        pressure: Option<Box<TimeFunction>>,
        /// Rate, 1/s, of the logarithm of the distance from the end of a solid cylinder to the plate opposite to it.
        #[serde(default)]
        strain_rate: Option<Box<TimeFunction>>,
        /// Rotation about an axis anywhere in space, in place of `velocity` and `spin`.
        #[serde(default)]
        revolution: Option<Box<Revolution>>,
        /// Angular velocity of the surface beyond that of the cylinder, rad/s, about the axis.
        #[serde(default)]
        surface_spin: TimeFunction,
        /// Control of the radius of a hollow cylinder: a rate of its logarithm, 1/s, or a pressure on the inside that is held.
        #[serde(default)]
        radial: Option<AxisControl>,
        /// Ends of a hollow cylinder as plates of their own.
        #[serde(default)]
        ends: Option<Box<DrumEnds>>,
    },
    /// A triangulated surface, open or closed; its whole motion is imposed.
    Mesh {
        material: String,
        colour: String,
        /// OBJ, STL or VTK file, in the folder of the scene.
        file: String,
        /// Factor from the unit of the file to m.
        #[serde(default = "default_scale")]
        scale: f64,
        /// Position of the origin of the file, about which the surface turns, m.
        #[serde(default)]
        position: [f64; 3],
        /// Turns the surface about `position`.
        #[serde(default)]
        orientation: Rotation,
        /// Side that pushes; default: `Front` of a closed surface, `Both` of an open one.
        #[serde(default)]
        side: Option<WallSide>,
        /// Velocity, m/s, along the fixed axes.
        #[serde(default)]
        velocity: [TimeFunction; 3],
        /// Angular velocity, rad/s, about the axes of the file.
        #[serde(default)]
        spin: [TimeFunction; 3],
        /// Rotation about an axis anywhere in space, in place of `velocity` and `spin`.
        #[serde(default)]
        revolution: Option<Box<Revolution>>,
        /// Velocity of the surface beyond that of the wall, m/s, along the fixed axes, as of a conveyor belt.
        #[serde(default)]
        surface_velocity: Box<[TimeFunction; 3]>,
    },
}

/// Rotation of a wall about an axis anywhere in space, imposed by `rate` or free under a `moment`; one of the two is given.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Revolution {
    /// Direction of the axis, of any length.
    pub axis: [f64; 3],
    /// Point on the axis, m.
    #[serde(default)]
    pub point: [f64; 3],
    /// Angular velocity, rad/s.
    #[serde(default)]
    pub rate: Option<TimeFunction>,
    /// Moment about the axis, N m, under which, its weight and contacts a plate or solid cylinder turns freely.
    #[serde(default)]
    pub moment: Option<TimeFunction>,
}

/// The two ends of a hollow cylinder.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DrumEnds {
    pub material: String,
    pub colour: String,
    /// Angular velocity, rad/s, about the axis of the cylinder.
    #[serde(default)]
    pub spin: TimeFunction,
}

/// Side of a triangulated surface that pushes bodies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum WallSide {
    /// Outside of a closed surface; of an open one the side from which triangles are seen counter-clockwise.
    Front,
    /// Inside of a closed surface; of an open one the side from which triangles are seen clockwise.
    Back,
    Both,
}

fn default_scale() -> f64 {
    1.0
}

fn default_axis() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

/// Velocity, force or moment as a function of time t, s, in the unit of the field.
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
        /// Default: 1, or 0 with a rising ramp.
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
    /// Replaces the cohesive stress or Hamaker constant by the value from the bulk strength, if there is one with its packing. Both
    /// are checked.
    pub fn apply_bulk_strength(&mut self) {
        let (Some(bulk), Some(pair)) = (self.bulk_strength, self.kind.pair_cohesion()) else { return };
        let (Some(solid_fraction), Some(coordination)) = (bulk.nu, bulk.z) else { return };
        let packing = SpherePacking { solid_fraction, coordination, diameter: bulk.diameter.unwrap_or(1.0) };
        let strength_of_unit = pair.with_strength_parameter(1.0).bulk_strength(packing);
        if let Some(kind) = self.kind.with_pair_value(bulk.tension / strength_of_unit) {
            self.kind = kind;
        }
    }

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
    /// Whether the shape is given in axes that need not be the principal ones.
    pub fn has_axes(&self) -> bool {
        self.has_own_size() && !self.is_round_solid() && !matches!(self, GrainShape::Box { .. })
    }

    /// Whether the shape has a size, which grains without `sizes` keep.
    pub fn has_own_size(&self) -> bool {
        matches!(
            self,
            GrainShape::Box { .. }
                | GrainShape::Cylinder { .. }
                | GrainShape::Capsule { .. }
                | GrainShape::Vertices(_)
                | GrainShape::Model { .. }
                | GrainShape::Clump(_)
                | GrainShape::ClumpFile { .. }
        )
    }

    /// Whether the shape is a cylinder or capsule.
    pub fn is_round_solid(&self) -> bool {
        matches!(self, GrainShape::Cylinder { .. } | GrainShape::Capsule { .. })
    }

    /// Whether the contacts of the shape are those of several balls.
    pub fn is_clump(&self) -> bool {
        matches!(
            self,
            GrainShape::Clump(_)
                | GrainShape::ClumpFile { .. }
                | GrainShape::Model { contact_shape: ContactSurface::Balls { .. }, .. }
        )
    }
}

impl GrainPlacement {
    /// Region that the grains fill, if the placement has one.
    pub fn envelope(&self) -> Option<&Envelope> {
        match self {
            GrainPlacement::JitteredLattice { envelope, .. }
            | GrainPlacement::RandomSequential { envelope }
            | GrainPlacement::DensePacking { envelope }
            | GrainPlacement::Fragments { envelope, .. } => Some(envelope),
            GrainPlacement::List { .. } | GrainPlacement::File { .. } => None,
        }
    }

    /// Whether its grains may overlap others.
    pub fn allows_overlap(&self) -> bool {
        matches!(
            self,
            GrainPlacement::List { allow_overlap: true, .. } | GrainPlacement::File { allow_overlap: true, .. }
        )
    }
}

impl Grains {
    /// Imposed components: velocity along the fixed axes, angular velocity about the principal axes.
    pub fn imposed_components(&self) -> [Option<&TimeFunction>; 6] {
        const ZERO: &TimeFunction = &TimeFunction::Constant(0.0);
        let velocity = |axis: usize| self.driven.as_ref().and_then(|velocity| velocity[axis].as_ref());
        let spin = |axis: usize| match &self.driven_spin {
            Some(spin) => spin[axis].as_ref(),
            // With an imposed velocity alone the grains do not rotate.
            None => self.driven.as_ref().map(|_| ZERO),
        };
        [velocity(0), velocity(1), velocity(2), spin(0), spin(1), spin(2)]
    }

    /// Whether all of the motion is imposed.
    pub fn is_imposed(&self) -> bool {
        self.imposed_components().iter().all(Option::is_some)
    }

    /// Whether normal forces can move the grains: some of their motion is not imposed, and of spheres some of the translation,
    /// as normals pass through their centres.
    pub fn can_be_pushed(&self) -> bool {
        let components = self.imposed_components();
        let relevant = if self.are_spheres() { &components[..3] } else { &components[..] };
        relevant.iter().any(Option::is_none)
    }

    /// Whether there is a single grain.
    pub fn is_single_body(&self) -> bool {
        self.number == Some(1)
            || matches!(&self.placement, GrainPlacement::List { positions, .. } if positions.len() == 1)
    }

    /// Whether the grains are spheres.
    pub fn are_spheres(&self) -> bool {
        self.shape == GrainShape::Sphere && !matches!(self.placement, GrainPlacement::Fragments { .. })
    }

    /// Whether the grains are polyhedra.
    pub fn is_polyhedral(&self) -> bool {
        !self.are_spheres() && !self.shape.is_clump() && !self.shape.is_round_solid()
    }

    /// Name of the contactors in the files.
    pub fn contactor(&self) -> &'static str {
        match self.shape {
            GrainShape::Cylinder { .. } => "CYLND",
            GrainShape::Capsule { .. } => "CAPSx",
            _ if self.is_polyhedral() => "POLYR",
            _ => "SPHER",
        }
    }
}

/// Half thickness of the ends of a hollow cylinder, divided by its radius: chosen, large against the travel of grains
/// in a step, and small in pictures.
const END_HALF_THICKNESS: f64 = 0.05;

/// Reads the walls of a scene; the plates that are ends of hollow cylinders follow after all others. Errors: those of the
/// deserializer.
pub fn deserialize_walls<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<SceneWall>, D::Error> {
    let mut walls = Vec::<SceneWall>::deserialize(deserializer)?;
    let ends: Vec<SceneWall> = walls.iter_mut().flat_map(SceneWall::split_ends).collect();
    walls.extend(ends);
    Ok(walls)
}

impl SceneWall {
    /// Returns the ends of a hollow cylinder, and lengthens it so that its own ends are behind them.
    fn split_ends(&mut self) -> Vec<SceneWall> {
        let SceneWall::Cylinder { centre, axis, half_height, radius, hollow: true, velocity, ends: Some(ends), .. } =
            self
        else {
            return Vec::new();
        };
        let (thickness, unit) = (END_HALF_THICKNESS * *radius, Vector3::from(*axis).normalize());
        let end = |sign: f64| SceneWall::Plate {
            material: ends.material.clone(),
            colour: ends.colour.clone(),
            centre: (Vector3::from(*centre) + unit * (sign * (*half_height + thickness))).into(),
            normal: *axis,
            first_axis: None,
            half_lengths: [*radius, *radius, thickness],
            velocity: velocity.clone(),
            force: Box::default(),
            spin: [TimeFunction::default(), TimeFunction::default(), ends.spin.clone()],
            moment: Box::default(),
            pressure: None,
            strain_rate: None,
            revolution: None,
            surface_velocity: Box::default(),
        };
        let plates = [1.0, -1.0].map(end).into();
        *half_height += 2.0 * thickness;
        plates
    }
}

/// Files of the surfaces that grains are made from or placed in, of those that are walls, and of particles, as the
/// scene names them.
pub fn models<'a>(grains: &'a [Grains], walls: &'a [SceneWall]) -> impl Iterator<Item = &'a str> {
    let walls = walls.iter().filter_map(|wall| match wall {
        SceneWall::Mesh { file, .. } => Some(file.as_str()),
        _ => None,
    });
    let grains = grains.iter().flat_map(|grains| {
        let (shape, pieces) = match &grains.shape {
            GrainShape::Model { file, contact_shape: ContactSurface::Files(pieces), .. } => {
                (Some(file), pieces.as_slice())
            }
            GrainShape::Model { file, .. } | GrainShape::ClumpFile { file, .. } => (Some(file), &[][..]),
            _ => (None, &[][..]),
        };
        let envelope = match grains.placement.envelope() {
            Some(Envelope::Model { file, .. }) => Some(file),
            _ => None,
        };
        let particles = match &grains.placement {
            GrainPlacement::File { path, .. } => Some(path),
            _ => None,
        };
        shape.into_iter().chain(pieces).chain(envelope).chain(particles).map(String::as_str)
    });
    grains.chain(walls)
}
