//! Grains and walls of a scene as bodies: the result of placing and moving them, from which the files are written.

use nalgebra::{Matrix3, Vector3};

use crate::placement::region::GrainRegion;
use crate::placement::rounded_hulls::RoundedHull;
use crate::shapes::OrientedShape;
use crate::shapes::overlap::ConvexPiece;
use crate::shapes::union::ClumpBall;
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
    pub shape: OrientedShape,
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
        self.shape.volume(self.radius)
    }

    /// Principal axes in the fixed frame, one a row; for a sphere, the fixed axes.
    pub fn axes(&self) -> Matrix3<f64> {
        match &self.shape {
            OrientedShape::Sphere => Matrix3::identity(),
            OrientedShape::Polyhedron(polyhedron) => polyhedron.axes,
            OrientedShape::Clump(clump) => clump.axes,
            OrientedShape::RoundSolid(round_solid) => round_solid.axes,
        }
    }

    /// Extent of its shape along a fixed axis, m; of a cylinder, that of the prism around it.
    pub fn extent_along(&self, axis: usize) -> f64 {
        let hulls = RoundedHull::from_shape(&self.shape, self.radius, &Matrix3::identity());
        let ends = hulls.iter().map(|hull| hull.bounds().map(|end| (end[axis], hull.radius)));
        let [low, high] = ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [(start, radius), (end, _)]| {
            [low.min(start - radius), high.max(end + radius)]
        });
        high - low
    }

    /// Whether the grain is a sphere.
    pub fn is_sphere(&self) -> bool {
        matches!(self.shape, OrientedShape::Sphere)
    }

    /// Whether the grain is a solid of convex pieces: a polyhedron or cylinder.
    pub(crate) fn has_pieces(&self) -> bool {
        self.shape.polyhedron().is_some() || self.shape.round_solid().is_some_and(|solid| !solid.shape.is_capsule)
    }

    /// Balls of a sphere, clump or capsule at its position; none for others.
    pub(crate) fn balls(&self) -> Vec<ClumpBall> {
        match &self.shape {
            OrientedShape::Sphere => vec![ClumpBall { centre: self.position, radius: self.radius }],
            OrientedShape::Polyhedron(_) => Vec::new(),
            OrientedShape::RoundSolid(round_solid) => round_solid.balls(self.position).collect(),
            OrientedShape::Clump(clump) => {
                let to_fixed_axes = clump.axes.transpose();
                let placed_ball =
                    |ball: ClumpBall| ClumpBall { centre: self.position + to_fixed_axes * ball.centre, ..ball };
                clump.balls().map(placed_ball).collect()
            }
        }
    }

    /// Convex pieces of a polyhedron, or the prism inscribed in a cylinder, in its orientation, at its position.
    pub(crate) fn convex_pieces(&self) -> Vec<ConvexPiece> {
        if let OrientedShape::RoundSolid(round_solid) = &self.shape {
            return round_solid.convex_piece(self.position).into_iter().collect();
        }
        let Some(polyhedron) = self.shape.polyhedron() else { return Vec::new() };
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
