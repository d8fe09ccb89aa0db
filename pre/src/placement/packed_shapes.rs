//! Overlaps of grains of any shape in a dense packing, with each other, with bodies at rest and with the walls of the region.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::neighbours::{NeighbourLists, PackingCell};
use super::region::GrainRegion;
use super::rounded_hulls::{RoundedHull, hull_gap};

/// Least number of grains per task: the overlaps of one take some tens of microseconds.
const GRAINS_PER_TASK: usize = 16;

/// Moment of inertia divided by mass and square of the bounding radius. Rotations then are about as stiff as translations.
const INERTIA_RATIO: f64 = 0.5;

/// Shapes of grains that are to be packed.
#[derive(Debug, Clone, Default)]
pub struct PackingShapes {
    /// Hulls of each grain about its centre of mass.
    pub hulls: Vec<Vec<RoundedHull>>,
    /// Radius of the sphere of equal volume of each, m.
    pub sizes: Vec<f64>,
    /// Whether the grains may turn.
    pub can_turn: bool,
    /// Bodies at rest around which they are packed.
    pub obstacles: Vec<FixedBody>,
}

/// Body at rest.
#[derive(Debug, Clone, PartialEq)]
pub struct FixedBody {
    /// m
    pub position: Vector3<f64>,
    /// Hulls about its position.
    pub hulls: Vec<RoundedHull>,
    /// Radius of its bounding ball, m.
    pub reach: f64,
}

impl FixedBody {
    /// Whether a hull at a point, m, does not overlap the body.
    pub fn is_clear_of(&self, cell: &PackingCell, hull: &RoundedHull, point: &Vector3<f64>) -> bool {
        let separation = cell.nearest_separation(self.position - point);
        let gap = |own: &RoundedHull| hull_gap(hull, own, &separation, hull.radius + own.radius, hull.radius);
        self.hulls.iter().all(|own| gap(own).is_none())
    }
}

/// Force on a grain, and its contributions to sums over all grains.
#[derive(Clone, Copy, Default)]
pub struct GrainLoad {
    /// Force, in metres of overlap.
    pub force: Vector3<f64>,
    /// Energy, m^2; half of that of each contact of two grains that move.
    pub energy: f64,
    /// Largest overlap, divided by the sum of the padded radii, or by the padded radius at a wall.
    pub deepest: f64,
    /// Sum of these ratios, and number of contacts.
    pub sum: f64,
    pub contacts: u32,
}

impl GrainLoad {
    /// Adds an overlap, m, of padded radii with the sum `length`, m, that pushes the grain along `direction`; `share` is
    /// that of the energy of the contact.
    pub fn add_overlap(&mut self, direction: Vector3<f64>, overlap: f64, length: f64, share: f64) {
        self.force += direction * overlap;
        self.energy += share * 0.5 * overlap * overlap;
        self.deepest = self.deepest.max(overlap / length);
        self.sum += overlap / length;
        self.contacts += 1;
    }
}

/// Forces on all grains.
pub struct GrainForces {
    pub loads: Vec<GrainLoad>,
    /// Moments of the forces about the centres, m^2; none of grains that do not turn.
    pub torques: Vec<Vector3<f64>>,
}

/// Size of a grain and the padding of its hulls; 0 for bodies at rest.
#[derive(Clone, Copy, Default)]
pub struct PaddedSize {
    /// Radius to which overlaps are relative, m.
    pub size: f64,
    /// m
    pub padding: f64,
}

/// Overlap of a grain with another body or a wall.
struct ShapeOverlap {
    /// Index of the other body, if it moves.
    other: Option<u32>,
    /// Unit vector along which the grain is pushed.
    direction: Vector3<f64>,
    /// m
    overlap: f64,
    /// Sum of the padded radii, m.
    length: f64,
    /// Point of contact about the centre of the grain and about that of the other, m.
    arms: [Vector3<f64>; 2],
}

/// Shapes of grains that move and of bodies at rest, in their present orientations.
pub struct MovingShapes {
    /// Hulls in the first orientations, those of grains at the present scale.
    originals: Vec<Vec<RoundedHull>>,
    /// Hulls in the present orientations.
    hulls: Vec<Vec<RoundedHull>>,
    /// Rotations of the grains from their first orientations.
    pub rotations: Vec<UnitQuaternion<f64>>,
    /// Moments of inertia, m^2.
    pub inertias: Vec<f64>,
    can_turn: bool,
    /// Length in whose units distances are computed, m.
    unit: f64,
}

impl MovingShapes {
    /// Shapes of grains of these masses and bounding radii, m.
    pub fn new(shapes: &PackingShapes, masses: &[f64], radii: &[f64], unit: f64) -> MovingShapes {
        let originals: Vec<Vec<RoundedHull>> =
            shapes.hulls.iter().cloned().chain(shapes.obstacles.iter().map(|body| body.hulls.clone())).collect();
        let rotations = vec![UnitQuaternion::identity(); shapes.hulls.len()];
        let inertias = masses.iter().zip(radii).map(|(mass, radius)| INERTIA_RATIO * mass * radius * radius).collect();
        MovingShapes { hulls: originals.clone(), originals, rotations, inertias, can_turn: shapes.can_turn, unit }
    }

    /// Multiplies the lengths of all grains by `factor`.
    pub fn rescale(&mut self, factor: f64) {
        for grain in &mut self.originals[..self.rotations.len()] {
            grain.iter_mut().for_each(|hull| *hull = hull.with_scale(factor));
        }
        self.hulls.clone_from(&self.originals);
        self.turn_hulls();
    }

    /// Turns the grains with the angular velocities `spins`, 1/s, for a time, s.
    pub fn turn(&mut self, spins: &[Vector3<f64>], time: f64) {
        for (rotation, spin) in self.rotations.iter_mut().zip(spins) {
            let half = spin * (0.5 * time);
            *rotation = UnitQuaternion::new_normalize(Quaternion::from_parts(1.0, half)) * *rotation;
        }
        if self.can_turn {
            self.turn_hulls();
        }
    }

    /// Sets the hulls to the present orientations.
    fn turn_hulls(&mut self) {
        for ((hulls, originals), rotation) in self.hulls.iter_mut().zip(&self.originals).zip(&self.rotations) {
            let matrix = rotation.to_rotation_matrix().into_inner();
            hulls.iter_mut().zip(originals).for_each(|(hull, original)| hull.set_rotated(original, &matrix));
        }
    }

    /// Forces on all grains at `centres`, m.
    pub fn forces(
        &self,
        cell: &PackingCell,
        lists: &NeighbourLists,
        centres: &[Vector3<f64>],
        sizes: &[PaddedSize],
    ) -> GrainForces {
        let number = self.rotations.len();
        let overlaps = |k: usize| {
            let mut found = Vec::new();
            self.add_pairs(cell, lists, centres, sizes, k, &mut found);
            if lists.near_walls[k] {
                self.add_walls(cell, &centres[k], sizes[k], &self.hulls[k], &mut found);
            }
            found
        };
        let found: Vec<Vec<ShapeOverlap>> =
            (0..number).into_par_iter().with_min_len(GRAINS_PER_TASK).map(overlaps).collect();
        let mut loads = vec![GrainLoad::default(); number];
        let mut torques = vec![Vector3::zeros(); if self.can_turn { number } else { 0 }];
        for (k, overlaps) in found.iter().enumerate() {
            for ShapeOverlap { other, direction, overlap, length, arms } in overlaps {
                let share = if other.is_some() { 0.5 } else { 1.0 };
                let sides = [(Some(k), *direction), (other.map(|other| other as usize), -direction)];
                for ((grain, direction), arm) in sides.into_iter().zip(arms) {
                    let Some(grain) = grain else { continue };
                    loads[grain].add_overlap(direction, *overlap, *length, share);
                    if let Some(torque) = torques.get_mut(grain) {
                        *torque += arm.cross(&direction) * *overlap;
                    }
                }
            }
        }
        GrainForces { loads, torques }
    }

    /// Adds the overlaps of grain `k` with grains of larger index and with bodies at rest.
    fn add_pairs(
        &self,
        cell: &PackingCell,
        lists: &NeighbourLists,
        centres: &[Vector3<f64>],
        sizes: &[PaddedSize],
        k: usize,
        found: &mut Vec<ShapeOverlap>,
    ) {
        for &other in lists.entries_near(k).iter().filter(|other| **other as usize > k) {
            let j = other as usize;
            let separation = cell.nearest_separation(centres[j] - centres[k]);
            let (own, partner) = (sizes[k], sizes.get(j).copied().unwrap_or_default());
            let [size, padding] = [own.size + partner.size, own.padding + partner.padding];
            for (a, b) in self.hulls[k].iter().flat_map(|a| self.hulls[j].iter().map(move |b| (a, b))) {
                let limit = a.radius + b.radius + padding;
                let Some(gap) = hull_gap(a, b, &separation, limit, self.unit) else { continue };
                let middle = 0.5 * (gap.points[0] + gap.points[1] + (a.radius - b.radius) * gap.normal);
                found.push(ShapeOverlap {
                    other: (j < self.rotations.len()).then_some(other),
                    direction: -gap.normal,
                    overlap: limit - gap.distance,
                    length: size + padding,
                    arms: [middle, middle - separation],
                });
            }
        }
    }

    /// Adds the overlaps of the hulls of a grain with the walls of the region.
    fn add_walls(
        &self,
        cell: &PackingCell,
        centre: &Vector3<f64>,
        PaddedSize { size, padding }: PaddedSize,
        hulls: &[RoundedHull],
        found: &mut Vec<ShapeOverlap>,
    ) {
        let mut add = |direction: Vector3<f64>, overlap: f64, arm: Vector3<f64>| {
            if overlap > 0.0 {
                found.push(ShapeOverlap { other: None, direction, overlap, length: size + padding, arms: [arm; 2] });
            }
        };
        for hull in hulls {
            let reach = hull.radius + padding;
            for point in &hull.points {
                cell.for_each_wall(&(centre + point), |distance, inward| {
                    add(inward, reach - distance, point - hull.radius * inward);
                });
            }
            // Edges of a surface may enter a hull between its corners.
            if let GrainRegion::Inside(surface) = cell.region
                && hull.points.len() > 1
            {
                let [low, high] = hull.bounds().map(|corner| centre + corner);
                let margin = Vector3::repeat(reach);
                surface.for_each_triangle(&(low - margin), &(high + margin), |corners| {
                    let triangle = RoundedHull::new(corners.map(|corner| corner - centre).to_vec(), 0.0);
                    if let Some(gap) = hull_gap(hull, &triangle, &Vector3::zeros(), reach, self.unit) {
                        add(-gap.normal, reach - gap.distance, gap.points[0]);
                    }
                });
            }
        }
    }
}
