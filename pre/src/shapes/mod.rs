//! Polyhedra, clumps and cylinders or capsules: converts the shapes of grains in a scene to solids in their principal axes.
//!
//! | module | |
//! |---|---|
//! | [`hull`] | convex hulls |
//! | [`regular`] | regular solids, boxes, prisms |
//! | [`rocks`] | random convex polyhedra |
//! | [`read`], [`model`] | surfaces from files: reading, size, convex pieces |
//! | `principal` | solids in their principal axes |
//! | [`clump`], [`union`] | clumps of balls, and the mass properties of their union |
//! | [`round`] | cylinders and capsules |
//! | [`inscribed`] | balls that represent a surface |
//! | [`overlap`] | penetration of convex solids |

pub mod clump;
pub mod hull;
pub mod inscribed;
pub mod model;
pub mod overlap;
mod principal;
pub mod read;
pub mod regular;
pub mod rocks;
pub mod round;
pub mod union;

use std::path::Path;
use std::sync::Arc;

use cd_formats::error::Faults;
use nalgebra::{Matrix3, Vector3};

use crate::random::{RandomStream, StreamPurpose};
use crate::rotation::rotation_matrix;
use crate::rounding::{round_8_digits, round_14_columns, round_axes};
use crate::scene::{GrainOrientations, GrainShape, Grains, RadiusKind};
use crate::sphere::sphere_volume;
pub use clump::{OrientedClump, PrincipalClump};
use model::ModelSolid;
pub use principal::{CentredFrame, OrientedPolyhedron, PrincipalSolid};
pub use round::{OrientedRoundSolid, RoundSolid};
use union::ClumpBall;

/// Shape of a grain in its orientation.
#[derive(Debug, Clone, PartialEq)]
pub enum OrientedShape {
    Sphere,
    Polyhedron(OrientedPolyhedron),
    Clump(OrientedClump),
    /// Cylinder or capsule.
    RoundSolid(OrientedRoundSolid),
}

impl OrientedShape {
    /// Volume, m^3; `radius`: that of a sphere, m.
    pub fn volume(&self, radius: f64) -> f64 {
        match self {
            OrientedShape::Sphere => sphere_volume(radius),
            OrientedShape::Polyhedron(polyhedron) => polyhedron.volume(),
            OrientedShape::Clump(clump) => clump.volume(),
            OrientedShape::RoundSolid(round_solid) => round_solid.shape.mass_properties().volume,
        }
    }

    /// Turns the shape by a rotation about the fixed axes, with the digits of the files.
    pub fn turn(&mut self, rotation: &Matrix3<f64>) {
        let axes = match self {
            OrientedShape::Sphere => return,
            OrientedShape::Polyhedron(polyhedron) => &mut polyhedron.axes,
            OrientedShape::Clump(clump) => &mut clump.axes,
            OrientedShape::RoundSolid(round_solid) => &mut round_solid.axes,
        };
        *axes = round_axes(&(*axes * rotation.transpose()));
    }

    /// Polyhedron; none for other shapes.
    pub fn polyhedron(&self) -> Option<&OrientedPolyhedron> {
        if let OrientedShape::Polyhedron(polyhedron) = self { Some(polyhedron) } else { None }
    }

    /// Clump; none for other shapes.
    pub fn clump(&self) -> Option<&OrientedClump> {
        if let OrientedShape::Clump(clump) = self { Some(clump) } else { None }
    }

    /// Cylinder or capsule; none for other shapes.
    pub fn round_solid(&self) -> Option<&OrientedRoundSolid> {
        if let OrientedShape::RoundSolid(round_solid) = self { Some(round_solid) } else { None }
    }
}

/// Grain without a position.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledGrain {
    /// Radius of the sphere of equal volume, m.
    pub radius: f64,
    /// Radius of the smallest ball about the centre of mass that contains the grain, m.
    pub reach: f64,
    pub shape: OrientedShape,
}

impl SampledGrain {
    /// Sphere of `radius`, m, rounded to the digits of the files.
    pub fn from_radius(radius: f64) -> SampledGrain {
        let radius = round_8_digits(radius);
        SampledGrain { radius, reach: radius, shape: OrientedShape::Sphere }
    }

    /// Volume, m^3.
    pub fn volume(&self) -> f64 {
        self.shape.volume(self.radius)
    }

    /// Grain with the shape of a polyhedron.
    pub fn from_polyhedron(polyhedron: OrientedPolyhedron) -> SampledGrain {
        let vertices = polyhedron.vertices();
        let reach = vertices.iter().flatten().map(|&v| Vector3::from(v).norm()).fold(0.0, f64::max);
        let radius = round_14_columns(polyhedron.scale * polyhedron.solid.equivalent_radius());
        SampledGrain { radius, reach, shape: OrientedShape::Polyhedron(polyhedron) }
    }

    /// Grain with the shape of a clump.
    pub fn from_clump(clump: OrientedClump) -> SampledGrain {
        let radius = round_8_digits(clump.scale * clump.clump.equivalent_radius());
        SampledGrain { radius, reach: clump.reach(), shape: OrientedShape::Clump(clump) }
    }

    /// Grain with the shape of a cylinder or capsule.
    pub fn from_round_solid(round_solid: OrientedRoundSolid) -> SampledGrain {
        let radius = round_8_digits(round_solid.shape.equivalent_radius());
        let reach = round_solid.shape.reach();
        SampledGrain { radius, reach, shape: OrientedShape::RoundSolid(round_solid) }
    }
}

/// Sampler that returns the grains of one group of grains one after the other.
pub struct GrainSampler {
    source: ShapeSource,
    /// Radius that the sizes give.
    radius: RadiusKind,
    orientations: GrainOrientations,
    random: RandomStream,
    /// Number of grains other than spheres so far.
    count: usize,
}

/// Fault of a shape: of its points, or of its file.
#[derive(Debug, Clone, PartialEq)]
pub enum ShapeError {
    Shape(hull::HullError),
    File(Faults),
}

impl std::fmt::Display for ShapeError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ShapeError::Shape(error) => write!(f, "{error}"),
            ShapeError::File(faults) => write!(f, "{faults}"),
        }
    }
}

impl std::error::Error for ShapeError {}

/// Source of the shapes of grains.
enum ShapeSource {
    Sphere,
    /// One solid for all grains, and notes on its file.
    Same(Arc<PrincipalSolid>, String),
    Rocks(rocks::RockGenerator),
    /// One clump for all grains, and notes on its file.
    Clump(Arc<PrincipalClump>, String),
    /// One cylinder or capsule for all grains.
    RoundSolid(RoundSolid),
}

/// Shape of the next grain.
enum NextShape {
    Polyhedron(Arc<PrincipalSolid>),
    Clump(Arc<PrincipalClump>),
    RoundSolid(RoundSolid),
}

impl GrainSampler {
    /// Sampler for a (checked) group of grains, the `group`-th of the scene; paths of files are relative to `folder`.
    ///
    /// Errors: a fault of the shape or of its file.
    pub fn from_grains(grains: &Grains, folder: &Path, seed: u64, group: usize) -> Result<GrainSampler, ShapeError> {
        let source = match &grains.shape {
            GrainShape::Sphere => ShapeSource::Sphere,
            &GrainShape::Random { vertices, ratios, angularity } => {
                ShapeSource::Rocks(rocks::RockGenerator { vertices, ratios: ratios.into(), angularity })
            }
            GrainShape::Model { file, scale, contact_shape } => {
                let (solid, summary) =
                    model::model_solid(folder, file, *scale, contact_shape).map_err(ShapeError::File)?;
                match solid {
                    ModelSolid::Polyhedron(solid) => ShapeSource::Same(Arc::new(solid), summary),
                    ModelSolid::Clump(clump) => ShapeSource::Clump(Arc::new(clump), summary),
                }
            }
            GrainShape::Clump(balls) => {
                let balls: Vec<ClumpBall> = balls.iter().map(ClumpBall::from).collect();
                ShapeSource::Clump(Arc::new(PrincipalClump::from_union(&balls)), String::new())
            }
            GrainShape::ClumpFile { file, scale } => {
                let (clump, summary) = clump::read_clump(folder, file, *scale).map_err(ShapeError::File)?;
                ShapeSource::Clump(Arc::new(clump), summary)
            }
            &GrainShape::Cylinder { half_height: half_length, radius } => {
                ShapeSource::RoundSolid(RoundSolid { half_length, radius, is_capsule: false })
            }
            &GrainShape::Capsule { half_length, radius } => {
                ShapeSource::RoundSolid(RoundSolid { half_length, radius, is_capsule: true })
            }
            other => {
                let hull = hull::convex_hull(&regular::shape_vertices(other)).map_err(ShapeError::Shape)?;
                ShapeSource::Same(
                    Arc::new(PrincipalSolid::from_convex(&hull).map_err(ShapeError::Shape)?),
                    String::new(),
                )
            }
        };
        let random = RandomStream::new(seed, group, StreamPurpose::Shape);
        Ok(GrainSampler {
            source,
            radius: grains.radius,
            orientations: grains.grain_orientation.clone(),
            random,
            count: 0,
        })
    }

    /// Notes on the shape's file.
    pub fn file_summary(&self) -> &str {
        match &self.source {
            ShapeSource::Same(_, summary) | ShapeSource::Clump(_, summary) => summary,
            ShapeSource::Sphere | ShapeSource::Rocks(_) | ShapeSource::RoundSolid(_) => "",
        }
    }

    /// Next grain, of the radius `size`, m, or of the shape's own size.
    ///
    /// Errors: no sound shape was found.
    pub fn next_grain(&mut self, size: Option<f64>) -> Result<SampledGrain, rocks::DrawError> {
        let shape = match &self.source {
            ShapeSource::Sphere => {
                let radius = size.unwrap_or(1.0);
                return Ok(SampledGrain { radius, reach: radius, shape: OrientedShape::Sphere });
            }
            ShapeSource::Same(solid, _) => NextShape::Polyhedron(solid.clone()),
            ShapeSource::Rocks(rocks) => NextShape::Polyhedron(Arc::new(rocks.draw_rock(&mut self.random)?)),
            ShapeSource::Clump(clump, _) => NextShape::Clump(clump.clone()),
            ShapeSource::RoundSolid(round_solid) => NextShape::RoundSolid(*round_solid),
        };
        let rotation = match &self.orientations {
            GrainOrientations::Random => self.random.uniform_rotation(),
            GrainOrientations::Same(rotation) => rotation_matrix(rotation),
            GrainOrientations::List(rotations) => {
                rotations.get(self.count).map_or(Matrix3::identity(), rotation_matrix)
            }
        };
        self.count += 1;
        let (equivalent_radius, reach) = match &shape {
            NextShape::Polyhedron(solid) => (solid.equivalent_radius(), solid.reach),
            NextShape::Clump(clump) => (clump.equivalent_radius(), clump.reach),
            NextShape::RoundSolid(round_solid) => (round_solid.equivalent_radius(), round_solid.reach()),
        };
        let own_size = match self.radius {
            RadiusKind::EqualVolume => equivalent_radius,
            RadiusKind::Circumscribed => reach,
        };
        let scale = size.map_or(1.0, |size| size / own_size);
        Ok(match shape {
            NextShape::Polyhedron(solid) => {
                SampledGrain::from_polyhedron(OrientedPolyhedron::new(solid, scale, &rotation))
            }
            NextShape::Clump(clump) => SampledGrain::from_clump(OrientedClump::new(clump, scale, &rotation)),
            NextShape::RoundSolid(round_solid) => {
                SampledGrain::from_round_solid(OrientedRoundSolid::new(round_solid, scale, &rotation))
            }
        })
    }
}
