//! Craters: the surface of a target about the axis of an impact before and after it, and diameter, depth and volume.

use nalgebra::{Rotation3, UnitQuaternion};

use crate::derive::free_surface::ColumnGrid;
use crate::derive::heights::height_range;
use crate::derive::plane_fit::{DEFAULT_FIT_REACH, PlaneFit};
use crate::frame::Grain;
use crate::math::{Mat3, Vec3};

/// Width of the columns over the mean radius of the grains: rings a mean radius wide have two columns across.
const COLUMN_WIDTH: f64 = 0.5;

/// Depth of the edge of a crater below the old surface, and least height of a rim above it, in mean radii: half the roughness
/// of a surface of grains. On a slope of 30° the edge is 0.9 mean radii nearer to the axis than the line at which the slope
/// meets the old surface; at a steep wall it is up to a mean radius farther from the axis than the centres of the removed
/// grains.
const EDGE_DEPTH: f64 = 0.5;

/// Range of the search for the rim, in radii of the edge.
const RIM_RANGE: f64 = 2.0;

/// Iterations of the fit of a surface's normal: each one takes columns along the normal that the one before has found.
const NORMAL_ITERATIONS: usize = 3;

/// Axis about which a crater is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CraterAxis {
    /// Point of the old surface, m.
    pub point: Vec3,
    /// Outward normal of the old surface there, length 1.
    pub normal: Vec3,
}

impl CraterAxis {
    /// Returns the axis through the least-squares plane of the surface of `grains` around `axis`: along the normal of the plane
    /// if `fits_normal`, else along that of `axis`. The plane reaches over [`DEFAULT_FIT_REACH`] mean radii ([`PlaneFit`]).
    /// Returns `axis` where the columns define no plane.
    pub fn fitted_axis(grains: &[Grain], axis: CraterAxis, fits_normal: bool) -> CraterAxis {
        let mean_radius = mean_radius(grains);
        let (reach, references) = (DEFAULT_FIT_REACH * mean_radius, grains.iter().collect::<Vec<&Grain>>());
        let mut fitted = axis;
        for _ in 0..if fits_normal { NORMAL_ITERATIONS } else { 1 } {
            let CraterAxis { point, normal } = fitted;
            let grid = ColumnGrid::about_axis(point, normal, reach, COLUMN_WIDTH * mean_radius);
            let (heights, mut fit) = (grid.column_heights(&references), PlaneFit::new(reach));
            for (k, height) in heights.iter().enumerate().filter(|(_, height)| height.is_finite()) {
                let offset = grid.offset_from(k, &point);
                if offset[0].hypot(offset[1]) < reach {
                    fit.add(offset, height - point.dot(&normal), 1.0);
                }
            }
            let Some(plane) = (fit.weight_sum > 0.0).then(|| fit.fitted_plane()).flatten() else { break };
            let [first, second] = grid.axes();
            let tilted = normal - plane.gradient[0] * first - plane.gradient[1] * second;
            fitted.point = point + plane.height * normal;
            if fits_normal {
                fitted.normal = tilted.normalize();
            }
        }
        fitted
    }
}

/// Mean height of the surface in a ring about the axis, m, relative to the point of the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CraterRing {
    /// Distance of the middle of the ring from the axis.
    pub radius: f64,
    /// Height before the impact.
    pub old_height: f64,
    /// Height after it.
    pub new_height: f64,
}

/// Size of a crater; all but the depth NaN if the crater reaches beyond the measured surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CraterSize {
    /// Diameter at the level of the old surface, m; 0 without a crater.
    pub diameter: f64,
    /// Diameter of the rim, m; NaN without one.
    pub rim_diameter: f64,
    /// Depth below the old surface, m: largest mean over a ring of the crater; 0 without a crater.
    pub depth: f64,
    /// Height of the rim above the old surface, m; NaN without one.
    pub rim_height: f64,
    /// Volume below the old surface, m^3; 0 without a crater.
    pub volume: f64,
}

impl CraterSize {
    const NONE: CraterSize =
        CraterSize { diameter: 0.0, rim_diameter: f64::NAN, depth: 0.0, rim_height: f64::NAN, volume: 0.0 };
}

/// A crater with its profile.
#[derive(Debug, Clone, PartialEq)]
pub struct CraterShape {
    /// Rings, outwards.
    pub rings: Vec<CraterRing>,
    pub size: CraterSize,
}

/// Surface of a target before an impact, in columns along the axis.
pub struct OldSurface {
    axis: CraterAxis,
    grid: ColumnGrid,
    /// Height of each column, m; NaN without grains.
    heights: Vec<f64>,
    /// Distance of the middle of each column from the axis, m.
    distances: Vec<f64>,
    ring_width: f64,
    ring_count: usize,
    /// Height of the lowest point of the grains, m.
    lowest_height: f64,
    mean_radius: f64,
}

/// Numbers of columns in a ring.
#[derive(Clone, Copy, Default)]
struct ColumnCounts {
    /// All columns.
    total: usize,
    /// Columns with grains.
    filled: usize,
}

/// Sums over the columns of a ring.
#[derive(Clone, Copy, Default)]
struct RingSums {
    /// Number of columns.
    count: f64,
    /// Heights before, above the level of the axis, m.
    old_height: f64,
    /// Changes of the heights, m.
    change: f64,
}

impl OldSurface {
    /// Returns the surface of the grains of a target before the impact, in rings a mean radius wide, or two columns if that is
    /// more, up to `reach` (m) from the axis or up to the first ring with grains under less than half of its columns. None
    /// without grains on the axis.
    ///
    /// The height of a column is that of the highest point of a grain on it, seen along the normal of the axis: spheres are
    /// exact, other grains have their faces.
    pub fn new(grains: &[Grain], axis: CraterAxis, reach: f64) -> Option<OldSurface> {
        let mean_radius = mean_radius(grains);
        // The first ring is a mean radius wide.
        if !(mean_radius > 0.0 && reach >= mean_radius) {
            return None;
        }
        let grid = ColumnGrid::about_axis(axis.point, axis.normal, reach, COLUMN_WIDTH * mean_radius);
        let heights = grid.column_heights(&grains.iter().collect::<Vec<_>>());
        let distances: Vec<f64> = (0..heights.len())
            .map(|k| {
                let [x, y] = grid.offset_from(k, &axis.point);
                x.hypot(y)
            })
            .collect();
        // Columns of a wide grid are wider than half a mean radius.
        let ring_width = mean_radius.max(2.0 * grid.column_area().sqrt());
        let mut counts = vec![ColumnCounts::default(); (reach / ring_width) as usize];
        for (distance, height) in distances.iter().zip(&heights) {
            if let Some(count) = counts.get_mut((distance / ring_width) as usize) {
                count.total += 1;
                count.filled += usize::from(height.is_finite());
            }
        }
        let ring_count = counts.iter().take_while(|count| count.filled > 0 && 2 * count.filled >= count.total).count();
        let lowest_height =
            grains.iter().map(|grain| height_range(grain, &axis.normal)[0]).fold(f64::INFINITY, f64::min);
        let surface = OldSurface { axis, grid, heights, distances, ring_width, ring_count, lowest_height, mean_radius };
        (ring_count > 0).then_some(surface)
    }

    /// Crater in the surface of the grains after the impact, which have been moved back with the target ([`BackMotion`]).
    ///
    /// With d(r) = after - before, the mean over a ring at the distance r from the axis, the crater is the range of rings
    /// with d < -0.5 mean radii that contains the largest volume. Its edge is the distance at which d rises above that
    /// value, by linear interpolation. The rim is the highest d up to twice the radius of the edge, if above 0.5 mean
    /// radii. The volume is the sum of before - after over the columns within the edge. Columns without grains afterwards
    /// count down to the lowest point of the grains before. On a curved surface diameters are chords, and depths are from
    /// the old surface.
    pub fn crater(&self, grains: &[Grain]) -> CraterShape {
        let after = self.grid.column_heights(&grains.iter().collect::<Vec<_>>());
        let height_change =
            |k: usize| if after[k].is_finite() { after[k] } else { self.lowest_height } - self.heights[k];
        let (mut sums, level) = (vec![RingSums::default(); self.ring_count], self.axis.point.dot(&self.axis.normal));
        for (k, height) in self.heights.iter().enumerate().filter(|(_, height)| height.is_finite()) {
            if let Some(sum) = sums.get_mut((self.distances[k] / self.ring_width) as usize) {
                sum.count += 1.0;
                sum.old_height = sum.old_height + height - level;
                sum.change += height_change(k);
            }
        }
        let ring = |(k, sum): (usize, &RingSums)| {
            let old_height = sum.old_height / sum.count;
            CraterRing {
                radius: (k as f64 + 0.5) * self.ring_width,
                old_height,
                new_height: old_height + sum.change / sum.count,
            }
        };
        let rings: Vec<CraterRing> = sums.iter().enumerate().map(ring).collect();
        let mean_changes: Vec<f64> = sums.iter().map(|sum| sum.change / sum.count).collect();
        let size = self.crater_size(&rings, &mean_changes, height_change);
        CraterShape { rings, size }
    }

    /// Size of the crater, see [`Self::crater`]. `mean_changes`: d of each ring, m; `height_change`: that of a column, m.
    fn crater_size(
        &self,
        rings: &[CraterRing],
        mean_changes: &[f64],
        height_change: impl Fn(usize) -> f64,
    ) -> CraterSize {
        let edge_change = -EDGE_DEPTH * self.mean_radius;
        // Volume of a range of rings over 2 pi times their width.
        let removed_volume =
            |range: &std::ops::Range<usize>| -range.clone().map(|k| mean_changes[k] * rings[k].radius).sum::<f64>();
        let mut deepest: Option<std::ops::Range<usize>> = None;
        let mut start = 0;
        while let Some(first) = (start..mean_changes.len()).find(|&k| mean_changes[k] < edge_change) {
            let end =
                (first..mean_changes.len()).find(|&k| mean_changes[k] >= edge_change).unwrap_or(mean_changes.len());
            let range = first..end;
            if deepest.as_ref().is_none_or(|best| removed_volume(&range) > removed_volume(best)) {
                deepest = Some(range);
            }
            start = end;
        }
        let Some(range) = deepest else { return CraterSize::NONE };
        let depth = -mean_changes[range.clone()].iter().copied().fold(0.0, f64::min);
        let (inner, outer) = (range.end - 1, range.end);
        if outer == mean_changes.len() {
            return CraterSize { diameter: f64::NAN, volume: f64::NAN, depth, ..CraterSize::NONE };
        }
        let share = (edge_change - mean_changes[inner]) / (mean_changes[outer] - mean_changes[inner]);
        let edge = rings[inner].radius + share * self.ring_width;
        let is_within_edge = |k: &usize| self.heights[*k].is_finite() && self.distances[*k] < edge;
        let change_sum: f64 = (0..self.heights.len()).filter(is_within_edge).map(height_change).sum();
        let outside = (outer..mean_changes.len()).take_while(|&k| rings[k].radius <= RIM_RANGE * edge);
        let rim = outside
            .filter(|&k| mean_changes[k] > -edge_change)
            .max_by(|&a, &b| mean_changes[a].total_cmp(&mean_changes[b]));
        CraterSize {
            diameter: 2.0 * edge,
            rim_diameter: rim.map_or(f64::NAN, |k| 2.0 * rings[k].radius),
            depth,
            rim_height: rim.map_or(f64::NAN, |k| mean_changes[k]),
            volume: -change_sum * self.grid.column_area(),
        }
    }
}

/// Mean radius of some grains, m; NaN without grains.
pub fn mean_radius(grains: &[Grain]) -> f64 {
    grains.iter().map(|grain| grain.radius).sum::<f64>() / grains.len() as f64
}

/// Grain at two times.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GrainDisplacement {
    /// Mass, kg.
    pub mass: f64,
    /// Position before, m.
    pub old_position: Vec3,
    /// Position after, m.
    pub new_position: Vec3,
}

/// Rigid motion from the positions after an impact back to those before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BackMotion {
    rotation: UnitQuaternion<f64>,
    /// Centre of mass after and before, m.
    new_centre: Vec3,
    old_centre: Vec3,
}

impl BackMotion {
    /// No motion.
    pub fn identity() -> BackMotion {
        BackMotion { rotation: UnitQuaternion::identity(), new_centre: Vec3::zeros(), old_centre: Vec3::zeros() }
    }

    /// Least-squares motion, weighted by mass. Without a rotation if the grains are fewer than three or on a line; the
    /// identity without grains.
    ///
    /// Source: W. Kabsch, Acta Cryst. A 32 (1976) 922-923.
    pub fn least_squares(grains: &[GrainDisplacement]) -> BackMotion {
        let mass: f64 = grains.iter().map(|grain| grain.mass).sum();
        if mass <= 0.0 {
            return BackMotion::identity();
        }
        let mean = |position: fn(&GrainDisplacement) -> Vec3| {
            grains.iter().map(|grain| grain.mass * position(grain)).sum::<Vec3>() / mass
        };
        let (old_centre, new_centre) = (mean(|grain| grain.old_position), mean(|grain| grain.new_position));
        let product = |grain: &GrainDisplacement| {
            grain.mass * (grain.old_position - old_centre) * (grain.new_position - new_centre).transpose()
        };
        let decomposition = grains.iter().map(product).sum::<Mat3>().svd(true, true);
        let (Some(u), Some(v_t)) = (decomposition.u, decomposition.v_t) else { unreachable!("both are requested") };
        let mut values: Vec<(f64, usize)> = decomposition.singular_values.iter().copied().zip(0..).collect();
        values.sort_by(|a, b| b.0.total_cmp(&a.0));
        // For points on a line the second singular value is rounding error.
        if values[1].0 <= 1e-9 * values[0].0 {
            return BackMotion { rotation: UnitQuaternion::identity(), new_centre, old_centre };
        }
        let mut signs = Mat3::identity();
        signs[(values[2].1, values[2].1)] = (u.determinant() * v_t.determinant()).signum();
        let rotation = Rotation3::from_matrix_unchecked(u * signs * v_t);
        BackMotion { rotation: UnitQuaternion::from_rotation_matrix(&rotation), new_centre, old_centre }
    }

    /// Returns the grain at the position and with the orientation that the motion leads back to.
    pub fn moved_grain(&self, grain: &Grain) -> Grain {
        let x = self.old_centre + self.rotation * (grain.x - self.new_centre);
        Grain { x, rotation: self.rotation * grain.rotation, ..grain.clone() }
    }

    /// Angle of the rotation, rad.
    pub fn angle(&self) -> f64 {
        self.rotation.angle()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;
    use std::f64::consts::PI;

    /// Grains of radius 0.5 on a cubic lattice of spacing 0.8, where `is_inside` holds.
    fn lattice(half: i32, is_inside: impl Fn(Vec3) -> bool) -> Vec<Grain> {
        let mut scene = Scene::default();
        let steps = || (-half..=half).map(|k| 0.8 * f64::from(k));
        for x in steps().flat_map(|x| steps().flat_map(move |y| steps().map(move |z| Vec3::new(x, y, z)))) {
            if is_inside(x) {
                scene.grain(x.into(), 0.5);
            }
        }
        scene.frame().grains
    }

    fn up_from(height: f64) -> CraterAxis {
        CraterAxis { point: Vec3::z() * height, normal: Vec3::z() }
    }

    #[track_caller]
    fn assert_near(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() <= tolerance, "found {found}, expected {expected} within {tolerance}");
    }

    #[test]
    fn a_hemisphere_in_a_flat_bed_has_its_diameter_depth_and_volume() {
        // The surface of spheres is above the plane of the uppermost centres, as much in the crater as outside.
        let radius = 7.0;
        let before = lattice(18, |x| x.z <= 0.0);
        let after = lattice(18, |x| x.z <= 0.0 && x.norm() >= radius);
        let axis = CraterAxis::fitted_axis(&before, up_from(0.0), false);
        assert_near(axis.point.z, 0.4, 0.1);
        let surface = OldSurface::new(&before, axis, 14.0).unwrap();
        let CraterShape { rings, size } = surface.crater(&after);
        assert_eq!(rings.len(), 28);
        // Grains whose centre is inside are removed, with what stands out of the hemisphere: up to a grain radius at the edge
        // and the floor, and a few percent of the volume.
        assert_near(size.diameter, 2.0 * radius, 1.0);
        assert_near(size.depth, radius, 0.5);
        assert_near(size.volume, 2.0 / 3.0 * PI * radius.powi(3), 0.06 * 2.0 / 3.0 * PI * radius.powi(3));
        assert!(size.rim_diameter.is_nan() && size.rim_height.is_nan());
        assert_eq!(surface.crater(&before).size.volume, 0.0);
    }

    #[test]
    fn a_rim_is_the_highest_ring_outside() {
        let before = lattice(18, |x| x.z <= 0.0);
        // A cone of slope 1/2 and depth 3 below the old surface, and a wall of height 1.6 at distances of 7 to 8.
        let is_after = |x: Vec3| {
            let r = x.x.hypot(x.y);
            x.z <= if (7.0..8.0).contains(&r) { 1.7 } else { (0.5 * r - 3.0).min(0.0) }
        };
        let size = OldSurface::new(&before, up_from(0.5), 14.0).unwrap().crater(&lattice(18, is_after)).size;
        // The first layer is removed up to distances of 6 of its centres: a grain radius outside at most.
        assert_near(size.diameter, 12.0, 1.0);
        assert_near(size.depth, 3.0, 0.8);
        assert_near(size.rim_diameter, 15.0, 1.0);
        assert_near(size.rim_height, 1.6, 0.4);
    }

    #[test]
    fn a_crater_on_a_ball_is_found_where_the_ball_has_moved_and_turned() {
        let (ball, radius, pole) = (14.0, 5.0, Vec3::new(0.48, -0.6, 0.64));
        let before = lattice(18, |x| x.norm() <= ball);
        let axis = CraterAxis { point: pole * ball, normal: Vec3::new(0.6, -0.4, 0.7).normalize() };
        let axis = CraterAxis::fitted_axis(&before, axis, true);
        // Normal of a ball, within the noise of planes over ten grain radii.
        assert!(axis.normal.dot(&axis.point.normalize()) > 2f64.to_radians().cos(), "{axis:?}");
        let surface = OldSurface::new(&before, axis, 0.85 * ball).unwrap();
        let rotation = UnitQuaternion::from_euler_angles(0.3, -1.1, 2.0);
        let (remains, shift) =
            (lattice(18, |x| x.norm() <= ball && (x - pole * ball).norm() >= radius), Vec3::new(9.0, 2.0, -4.0));
        let moved: Vec<Grain> = remains
            .iter()
            .map(|grain| Grain { x: rotation * grain.x + shift, rotation: rotation * grain.rotation, ..grain.clone() })
            .collect();
        let pairs = remains.iter().zip(&moved).filter(|(old, _)| old.x.dot(&pole) < 0.0);
        let displacement = |(old, new): (&Grain, &Grain)| GrainDisplacement {
            mass: old.mass,
            old_position: old.x,
            new_position: new.x,
        };
        let back = BackMotion::least_squares(&pairs.map(displacement).collect::<Vec<_>>());
        assert_near(back.angle(), rotation.angle(), 1e-12);
        let returned: Vec<Grain> = moved.iter().map(|grain| back.moved_grain(grain)).collect();
        // Rounding of sums over ten thousand grains.
        assert!(returned.iter().zip(&remains).all(|(a, b)| (a.x - b.x).norm() < 1e-10));
        let size = surface.crater(&returned).size;
        // Lens of two balls whose centres are a ball's radius apart: chord and volume.
        let chord = 2.0 * radius * (1.0 - (radius / (2.0 * ball)).powi(2)).sqrt();
        let volume = PI * radius.powi(3) * (2.0 / 3.0 - radius / (4.0 * ball));
        assert_near(size.diameter, chord, 1.0);
        assert_near(size.depth, radius, 0.5);
        assert_near(size.volume, volume, 0.1 * volume);
        // Without a crater the turned ball is the old one.
        let whole: Vec<Grain> = before
            .iter()
            .map(|grain| back.moved_grain(&Grain { x: rotation * grain.x + shift, ..grain.clone() }))
            .collect();
        assert_eq!(surface.crater(&whole).size.diameter, 0.0);
    }

    #[test]
    fn a_crater_beyond_the_measured_surface_has_no_diameter() {
        let before = lattice(12, |x| x.z <= 0.0);
        let sunk = lattice(12, |x| x.z <= -4.0);
        let size = OldSurface::new(&before, up_from(0.0), 8.0).unwrap().crater(&sunk).size;
        assert!(size.diameter.is_nan() && size.volume.is_nan() && (size.depth - 4.0).abs() < 1e-12, "{size:?}");
        // Where nothing is left, the crater is as deep as the grains were.
        let size = OldSurface::new(&before, up_from(0.0), 8.0).unwrap().crater(&[]).size;
        assert!(size.depth > 9.6 && size.depth < 10.7, "{size:?}");
        assert!(OldSurface::new(&before, CraterAxis { point: Vec3::x() * 90.0, normal: Vec3::z() }, 8.0).is_none());
        assert!(OldSurface::new(&[], up_from(0.0), 8.0).is_none());
    }

    #[test]
    fn grains_on_a_line_have_no_rotation() {
        let grain = |k: f64| GrainDisplacement {
            mass: 1.0,
            old_position: Vec3::x() * k,
            new_position: Vec3::x() * k + Vec3::y(),
        };
        let back = BackMotion::least_squares(&[grain(0.0), grain(1.0), grain(5.0)]);
        assert_eq!(back.angle(), 0.0);
        assert_eq!(BackMotion::least_squares(&[]), BackMotion::identity());
    }
}
