//! Grains and walls of a scene as bodies: the result of placing and moving them, from which the files are written.

use nalgebra::{Matrix3, Vector3};

use crate::placement::region::GrainRegion;
use crate::shapes::overlap::ConvexPiece;
use crate::shapes::union::ClumpBall;
use crate::shapes::{OrientedClump, OrientedPolyhedron, OrientedRoundSolid};
use crate::sphere::sphere_volume;
use crate::walls::WallBody;

/// Bodies in the order of their numbers: grains, then walls.
#[derive(Debug, Clone, PartialEq)]
pub struct Population {
    pub grains: Vec<Grain>,
    pub walls: Vec<WallBody>,
    /// Envelope of each group of grains, an entry of `grains` in the scene; none for some placements.
    pub regions: Vec<Option<GrainRegion>>,
    /// Notes on the file of the shape of each group, empty without one.
    pub file_summaries: Vec<String>,
}

impl Population {
    /// Path in the scene of the entry that makes the body of this index.
    pub fn scene_path(&self, body: usize) -> String {
        match self.grains.get(body) {
            Some(grain) => format!("grains.{}", grain.group),
            None => format!("walls.{}", self.walls[body - self.grains.len()].wall),
        }
    }
}

/// One sphere, polyhedron, clump or round solid; numbers have the digits of the files.
#[derive(Debug, Clone, PartialEq)]
pub struct Grain {
    /// Index of its group, an entry of `grains` in the scene.
    pub group: usize,
    /// Radius of the sphere of equal volume, m.
    pub radius: f64,
    /// Radius of the bounding ball about the centre of mass, m.
    pub reach: f64,
    /// Polyhedron; none for others.
    pub polyhedron: Option<OrientedPolyhedron>,
    /// Clump; none for others.
    pub clump: Option<OrientedClump>,
    /// Cylinder or capsule; none for others.
    pub round_solid: Option<OrientedRoundSolid>,
    /// Mass, kg.
    pub mass: f64,
    /// Position, m.
    pub position: Vector3<f64>,
    /// Velocity, m/s, fixed axes.
    pub velocity: Vector3<f64>,
    /// Angular velocity, rad/s, fixed axes.
    pub spin: Vector3<f64>,
}

impl Grain {
    /// Volume, m^3.
    pub fn volume(&self) -> f64 {
        match (&self.polyhedron, &self.clump, &self.round_solid) {
            (Some(polyhedron), ..) => polyhedron.volume(),
            (_, Some(clump), _) => clump.volume(),
            (.., Some(round_solid)) => round_solid.shape.mass_properties().volume,
            (None, None, None) => sphere_volume(self.radius),
        }
    }

    /// Principal axes in the fixed frame, one a row; for a sphere, the fixed axes.
    pub fn axes(&self) -> Matrix3<f64> {
        match (&self.polyhedron, &self.clump, &self.round_solid) {
            (Some(polyhedron), ..) => polyhedron.axes,
            (_, Some(clump), _) => clump.axes,
            (.., Some(round_solid)) => round_solid.axes,
            (None, None, None) => Matrix3::identity(),
        }
    }

    /// Whether the grain is a sphere.
    pub fn is_sphere(&self) -> bool {
        self.polyhedron.is_none() && self.clump.is_none() && self.round_solid.is_none()
    }

    /// Whether the grain is a solid of convex pieces: a polyhedron or cylinder.
    pub(crate) fn has_pieces(&self) -> bool {
        self.polyhedron.is_some() || self.round_solid.as_ref().is_some_and(|solid| !solid.shape.is_capsule)
    }

    /// Balls of a sphere, clump or capsule at its position; none for others.
    pub(crate) fn balls(&self) -> Vec<ClumpBall> {
        match &self.clump {
            _ if self.has_pieces() => Vec::new(),
            None if self.round_solid.is_some() => {
                self.round_solid.iter().flat_map(|solid| solid.balls(self.position)).collect()
            }
            Some(clump) => {
                let to_fixed_axes = clump.axes.transpose();
                let placed_ball =
                    |ball: ClumpBall| ClumpBall { centre: self.position + to_fixed_axes * ball.centre, ..ball };
                clump.balls().map(placed_ball).collect()
            }
            None => vec![ClumpBall { centre: self.position, radius: self.radius }],
        }
    }

    /// Convex pieces of a polyhedron, or the prism inscribed in a cylinder, in its orientation, at its position.
    pub(crate) fn convex_pieces(&self) -> Vec<ConvexPiece> {
        if let Some(round_solid) = &self.round_solid {
            return round_solid.convex_piece(self.position).into_iter().collect();
        }
        let Some(polyhedron) = &self.polyhedron else { return Vec::new() };
        let to_fixed_axes = polyhedron.axes.transpose();
        let pieces = polyhedron.vertices().into_iter().zip(&polyhedron.solid.pieces);
        pieces
            .map(|(vertices, piece)| {
                let vertices = vertices.into_iter().map(|v| to_fixed_axes * Vector3::from(v)).collect();
                ConvexPiece::new(self.position, vertices, piece.triangles())
            })
            .collect()
    }
}
