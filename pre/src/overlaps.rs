//! Overlaps of grains with each other and with walls, as the files hold them.

use std::cell::OnceCell;

use cd_formats::bodies::ShapeRecord;
use cd_formats::compute::Compute;
use nalgebra::{Matrix3, Vector3};

use crate::grain::Grain;
use crate::placement::cells::SphereGrid;
use crate::placement::packed_shapes::FixedBody;
use crate::placement::rounded_hulls::RoundedHull;
use crate::shapes::overlap::{ConvexPiece, deepest_overlap};
use crate::shapes::union::ClumpBall;
use crate::walls::WallBody;

/// Largest overlap of touching bodies, divided by the smaller radius: rounding to 8 digits of a contact that the user
/// has computed by hand.
pub(crate) const TOUCHING_TOLERANCE: f64 = 1e-6;

/// Grain with the convex pieces of its shape, which are made once, and only for grains that are near another body.
#[derive(Debug, Clone)]
pub(crate) struct ShapedGrain<'a> {
    pub grain: &'a Grain,
    pieces: OnceCell<Vec<ConvexPiece>>,
}

impl<'a> ShapedGrain<'a> {
    /// Grain whose pieces are not made yet.
    pub fn new(grain: &'a Grain) -> Self {
        ShapedGrain { grain, pieces: OnceCell::new() }
    }

    /// Convex pieces of the grain at its position, see [`Grain::convex_pieces`].
    fn pieces(&self) -> &[ConvexPiece] {
        self.pieces.get_or_init(|| self.grain.convex_pieces())
    }

    /// Penetration of the balls of `other`, moved by `shift`, into the convex pieces of this grain, m.
    fn overlap_with_balls(&self, other: &Grain, shift: Vector3<f64>) -> f64 {
        let overlap = |ball: ClumpBall, piece: &ConvexPiece| piece.overlap_of_ball(&(ball.centre + shift), ball.radius);
        let ball_overlap = |ball| self.pieces().iter().map(|piece| overlap(ball, piece)).fold(0.0, f64::max);
        other.balls().into_iter().map(ball_overlap).fold(0.0, f64::max)
    }

    /// Penetration, m, of this grain, moved by `shift`, and another one whose bounding ball it overlaps by `ball_overlap`; if it
    /// is at most that of touching grains, any such value may be returned.
    pub fn overlap_with(&self, other: &ShapedGrain, shift: Vector3<f64>, ball_overlap: f64) -> f64 {
        let (a, b) = (self.grain, other.grain);
        match [a, b].map(|grain| grain.has_pieces()) {
            [false, false] if a.is_sphere() && b.is_sphere() => ball_overlap,
            [false, false] => {
                let (first, second) = (a.balls(), b.balls());
                let pairs = first.iter().flat_map(|one| second.iter().map(move |other| (one, other)));
                let overlap = |(one, other): (&ClumpBall, &ClumpBall)| {
                    one.radius + other.radius - (one.centre + shift - other.centre).norm()
                };
                pairs.map(overlap).fold(0.0, f64::max)
            }
            [true, false] => self.overlap_with_balls(b, -shift),
            [false, true] => other.overlap_with_balls(a, shift),
            [true, true] => {
                let allowed = TOUCHING_TOLERANCE * a.radius.min(b.radius);
                if shift == Vector3::zeros() {
                    return deepest_overlap(self.pieces(), other.pieces(), allowed);
                }
                let mut moved = self.pieces().to_vec();
                moved.iter_mut().for_each(|piece| piece.centre += shift);
                deepest_overlap(&moved, other.pieces(), allowed)
            }
        }
    }

    /// Penetration of the grain into a wall and its periodic images, m; negative when apart.
    pub fn overlap_with_wall(&self, wall: &WallBody, options: &Compute) -> f64 {
        let grain = self.grain;
        let allowed = TOUCHING_TOLERANCE * grain.radius;
        let image_overlap = |shift: Vector3<f64>| {
            let centre = grain.position - shift;
            if grain.has_pieces() {
                let is_near = wall.may_overlap_ball(&centre, grain.reach);
                return if is_near { wall.pieces_overlap(self.pieces(), &shift, allowed) } else { f64::NEG_INFINITY };
            }
            let overlap = wall.ball_overlap(&centre, grain.reach);
            if overlap <= allowed || grain.is_sphere() {
                return overlap;
            }
            let balls = grain.balls().into_iter();
            let overlaps = balls.map(|ball| wall.ball_overlap(&(ball.centre - shift), ball.radius));
            overlaps.fold(f64::NEG_INFINITY, f64::max)
        };
        let shifts = nearest_images(options, &(grain.position - wall.centre));
        shifts.into_iter().map(image_overlap).fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Shifts, m, by which an object at the start of the vector `separation` comes nearest to its end in a periodic scene, with
/// those of the neighbouring cells.
pub(crate) fn nearest_images(options: &Compute, separation: &Vector3<f64>) -> Vec<Vector3<f64>> {
    let mut shifts = vec![Vector3::zeros()];
    for (axis, period) in options.periods().into_iter().enumerate() {
        let Some(period) = period else { continue };
        let axis_shift = |shift: &Vector3<f64>, cells: f64| {
            let mut shift = *shift;
            shift[axis] = (libm::round(separation[axis] / period) + cells) * period;
            shift
        };
        shifts = shifts.iter().flat_map(|shift| [0.0, 1.0, -1.0].map(|cells| axis_shift(shift, cells))).collect();
    }
    shifts
}

/// Bodies around which grains are placed.
#[derive(Debug, Clone)]
pub struct Obstacles<'a> {
    grains: Vec<&'a Grain>,
    walls: &'a [WallBody],
    options: &'a Compute,
    /// Shifts to the nearest periodic images, none first.
    shifts: &'a [Vector3<f64>],
}

impl<'a> Obstacles<'a> {
    pub(crate) fn new(
        grains: Vec<&'a Grain>,
        walls: &'a [WallBody],
        options: &'a Compute,
        shifts: &'a [Vector3<f64>],
    ) -> Self {
        Obstacles { grains, walls, options, shifts }
    }

    /// Whether there are none.
    pub(crate) fn is_empty(&self) -> bool {
        self.grains.is_empty() && self.walls.is_empty()
    }

    /// Whether the bounding ball of one of them overlaps the ball of `radius`, m, about `centre`, m; that of a surface counts
    /// always.
    pub(crate) fn are_near(&self, centre: &Vector3<f64>, radius: f64) -> bool {
        let is_near = |position: &Vector3<f64>, reach: f64| (position - centre).norm() <= radius + reach;
        let is_grain_near =
            |grain: &&Grain| self.shifts.iter().any(|shift| is_near(&(grain.position + shift), grain.reach));
        let is_wall_near = |wall: &WallBody| {
            let Some(reach) = wall.bounding_radius() else { return true };
            let shifts = nearest_images(self.options, &(centre - wall.centre));
            shifts.iter().any(|shift| is_near(&(wall.centre + shift), reach))
        };
        self.grains.iter().any(is_grain_near) || self.walls.iter().any(is_wall_near)
    }

    /// Bodies at rest, with their images, whose bounding balls overlap the ball of `radius`, m, about `centre`, m: about
    /// this centre along the axes into which `rotation` turns the fixed ones. A body has one image along an axis of
    /// `periods`. A surface is a body for each triangle. Hollow cylinders are left out.
    pub(crate) fn to_fixed_bodies(
        &self,
        centre: &Vector3<f64>,
        rotation: &Matrix3<f64>,
        radius: f64,
        periods: &[Option<f64>; 3],
    ) -> Vec<FixedBody> {
        let mut bodies = Vec::new();
        let mut add_images = |position: &Vector3<f64>, reach: f64, hulls: &[RoundedHull], shifts: &[Vector3<f64>]| {
            for shift in shifts {
                let position = rotation * (position + shift - centre);
                let is_first = (0..3).all(|k| periods[k].is_none() || shift[k] == shifts[0][k]);
                if is_first && position.norm() <= radius + reach {
                    bodies.push(FixedBody { position, hulls: hulls.to_vec(), reach });
                }
            }
        };
        for grain in &self.grains {
            let hulls = RoundedHull::from_shape(&grain.shape, grain.radius, rotation);
            add_images(&grain.position, grain.reach, &hulls, self.shifts);
        }
        for wall in self.walls {
            let axes = wall.axes * rotation.transpose();
            for triangle in wall.triangles() {
                let middle = triangle.iter().sum::<Vector3<f64>>() / 3.0;
                let points: Vec<Vector3<f64>> = triangle.iter().map(|point| axes.tr_mul(&(point - middle))).collect();
                let reach = points.iter().map(|point| point.norm()).fold(0.0, f64::max);
                let position = wall.centre + wall.axes.tr_mul(&middle);
                let shifts = nearest_images(self.options, &(centre - position));
                add_images(&position, reach, &[RoundedHull::new(points, 0.0)], &shifts);
            }
            let hull = match wall.shape {
                ShapeRecord::Plane { half_lengths } => RoundedHull::from_box(&axes, &half_lengths.into()),
                ShapeRecord::Cylinder { half_height, radius, hollow: false } => {
                    RoundedHull::around_cylinder(&axes, half_height, radius)
                }
                _ => continue,
            };
            let reach = hull.points.iter().map(|point| point.norm()).fold(0.0, f64::max);
            let shifts = nearest_images(self.options, &(centre - wall.centre));
            add_images(&wall.centre, reach, &[hull], &shifts);
        }
        bodies
    }

    /// Whether a point, m, is behind a surface that is solid there.
    pub(crate) fn is_in_solid(&self, point: &Vector3<f64>) -> bool {
        self.walls.iter().filter(|wall| matches!(wall.shape, ShapeRecord::Mesh { .. })).any(|wall| {
            let shifts = nearest_images(self.options, &(point - wall.centre));
            shifts.iter().any(|shift| wall.ball_overlap(&(point - shift), 0.0) > 0.0)
        })
    }

    /// Search for overlaps of grains whose bounding balls have the radius `largest`, m, at most.
    pub(crate) fn into_search(self, largest: f64) -> ObstacleSearch<'a> {
        // The grid finds balls that are no smaller than that of a trial.
        let padded_reach = |k: usize| self.grains[k].reach.max(largest);
        let mut order: Vec<usize> = (0..self.grains.len()).collect();
        order.sort_by(|&a, &b| padded_reach(b).total_cmp(&padded_reach(a)));
        let mut cells = SphereGrid::new(order.first().map_or(1.0, |&k| padded_reach(k)));
        order.iter().for_each(|&k| cells.add(self.grains[k].position, padded_reach(k)));
        let shaped = order.iter().map(|&k| ShapedGrain::new(self.grains[k])).collect();
        let corners = |sign: f64| self.grains.iter().map(move |grain| grain.position.add_scalar(sign * grain.reach));
        let low = corners(-1.0).fold(Vector3::repeat(f64::INFINITY), |low, corner| low.inf(&corner));
        let high = corners(1.0).fold(Vector3::repeat(f64::NEG_INFINITY), |high, corner| high.sup(&corner));
        ObstacleSearch { shaped, cells, bounds: [low, high], obstacles: self }
    }
}

/// Obstacles, ordered for a search of those near a grain.
pub(crate) struct ObstacleSearch<'a> {
    obstacles: Obstacles<'a>,
    /// Grains by their numbers in `cells`.
    shaped: Vec<ShapedGrain<'a>>,
    cells: SphereGrid,
    /// Corners of the box around the balls of all grains, m.
    bounds: [Vector3<f64>; 2],
}

impl ObstacleSearch<'_> {
    /// Whether a grain overlaps none of the obstacles; it may touch them.
    pub fn is_clear(&self, grain: &Grain) -> bool {
        let own = ShapedGrain::new(grain);
        let is_apart_from = |other: &ShapedGrain, shift: Vector3<f64>| {
            let between = grain.position + shift - other.grain.position;
            let ball_overlap = grain.reach + other.grain.reach - between.norm();
            let allowed = TOUCHING_TOLERANCE * grain.radius.min(other.grain.radius);
            ball_overlap <= allowed || own.overlap_with(other, shift, ball_overlap) <= allowed
        };
        let mut is_free = true;
        let [low, high] = self.bounds.map(|corner| corner - grain.position);
        let is_near =
            |shift: &&Vector3<f64>| (0..3).all(|k| low[k] - grain.reach < shift[k] && shift[k] < high[k] + grain.reach);
        for shift in self.obstacles.shifts.iter().filter(is_near) {
            self.cells.for_each_overlap(&(grain.position + shift), grain.reach, |number, _| {
                is_free = is_free && is_apart_from(&self.shaped[number], *shift);
            });
        }
        let Obstacles { walls, options, .. } = self.obstacles;
        let allowed = TOUCHING_TOLERANCE * grain.radius;
        is_free && walls.iter().all(|wall| own.overlap_with_wall(wall, options) <= allowed)
    }
}
