//! The free surface of grains that rest on walls under uniform gravity, a heap or a bed: heights by columns, and slopes.

use nalgebra::Matrix3;
use rayon::prelude::*;

use cd_formats::geometry::periodic_cell::PeriodicCell;

use crate::derive::fragments::Fragment;
use crate::derive::heights::height_range;
use crate::derive::plane_fit::{FittedPlane, NoiseDensity, PlaneFit, without_noise};
use crate::derive::walls::{CylinderBore, WallPlane, bounding_bore, bounding_planes, supported_grains};
use crate::frame::{Frame, Grain};
use crate::math::Vec3;

/// Largest number of columns along one direction; distant grains make the columns wider.
const MAX_COLUMNS: f64 = 500.0;

/// Default reach of the fitted planes, in mean radii.
///
/// Surfaces of settled beds undulate over several grains: planes over 12 radii have slopes of 1.6 to 3.5 degrees (root mean
/// square) on eight level beds of 1000 and 3000 grains, over 10 radii of 2.1 to 4.1.
pub const DEFAULT_SLOPE_REACH: f64 = 12.0;

/// Diameters of the patches over which noise is correlated, in mean diameters: least, largest, and as a share of the reach.
/// Residuals from planes do not contain long waves. On a curved surface they contain its curvature; the least patch is used
/// there.
const MIN_PATCH: f64 = 1.0;
const MAX_PATCH: f64 = 2.0;
const PATCH_SHARE: f64 = 1.0 / 3.0;

/// Ratio of the root mean square of the gradients' deviations from their mean to noise, above which a surface may be no plane.
const SIGNIFICANCE_FACTOR: f64 = 1.5;

/// Threshold of the root mean square of the gradients' deviations from their mean, times the ratio of reach to mean
/// radius, above which a surface may not be a plane: at 12 radii tan 6°, 1.7 times the largest value from undulations
/// of eight level beds of 1000 and 3000 grains.
const MAX_UNDULATION: f64 = 12.0 * 0.105;

/// Distance from a leaning wall, in mean radii, up to which a column may stand on the flank of the grains along it: between
/// the grains at the wall those of the second layer are seen, whose centres are 1 + √3 radii from it.
const FLANK_DEPTH: f64 = 3.0;

/// Free surface of a bed, sampled by vertical columns a mean radius wide, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeSurface {
    /// Horizontal unit vectors; x and y if verticals are along z.
    pub axes: [Vec3; 2],
    /// Number of columns along each axis.
    pub counts: [usize; 2],
    /// Positions of the lower edges of the first columns along the axes, m.
    pub from: [f64; 2],
    /// Widths of the columns along the axes, m.
    pub widths: [f64; 2],
    /// Points of the surface by column; NaN if the column has no grain, or too few are around it.
    pub columns: Vec<SurfaceColumn>,
    /// Slope of the surface, rad.
    pub slope: f64,
    /// Standard error of its gradient, as an angle, rad.
    pub slope_error: f64,
    /// Root mean square of the errors of the columns, as an angle, rad; NaN without columns.
    pub noise: f64,
}

/// Point of the surface on one vertical.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceColumn {
    /// Position, m.
    pub x: Vec3,
    /// Height above the lowest point of the grains, m.
    pub height: f64,
    /// Angle between the normal and the direction against gravity, corrected for noise ([`without_noise`]), rad.
    pub slope: f64,
    /// Standard error of the gradient due to single grains, as an angle, rad.
    pub error: f64,
}

impl SurfaceColumn {
    const NONE: SurfaceColumn = SurfaceColumn {
        x: Vec3::new(f64::NAN, f64::NAN, f64::NAN),
        height: f64::NAN,
        slope: f64::NAN,
        error: f64::NAN,
    };
}

impl FreeSurface {
    /// Returns the surface of all fragments that a wall touches with force; None without such fragments or without uniform
    /// gravity.
    ///
    /// The height of a column is the height of the highest point of a grain on its vertical. Columns under a wall that
    /// leans over the grains next to it have none: in a tilted box they stand on the flank of the bed along the wall,
    /// not on its free surface. Position and normal are those of the least-squares plane through the heights within
    /// `reach` mean radii ([`PlaneFit`]); both are NaN if less than half of the weight has a height. Verticals are
    /// against gravity. In a periodic scene verticals are along z, as a slope is modelled there by inclined gravity.
    ///
    /// The slope of the surface is the slope of one plane through all heights. If the gradients of the columns differ by
    /// more than 1.5 times noise and more than undulations of a level bed, as on a heap, it is the median of the columns'
    /// slopes. Both are corrected for the contribution of noise to the square of a gradient.
    pub fn from_frame(frame: &Frame, fragments: &[Fragment], reach: f64) -> Option<FreeSurface> {
        let against_gravity = (-Vec3::from(frame.meta.parameters.uniform_gravity)).try_normalize(0.0)?;
        let members = supported_grains(frame, fragments);
        let grains: Vec<&Grain> = members.iter().map(|&i| &frame.grains[i]).collect();
        if grains.is_empty() {
            return None;
        }
        if frame.cell().periods[2].is_some() {
            return None; // a scene that repeats along the vertical has no surface
        }
        let up = if frame.cell().is_periodic() { Vec3::z() } else { against_gravity };
        let grid = ColumnGrid::from_grains(&grains, &frame.cell(), up);
        let mut heights = grid.column_heights(&grains);
        let lowest = grains.iter().map(|g| height_range(g, &up)[0]).fold(f64::INFINITY, f64::min);
        let planes = bounding_planes(frame, &members);
        let bores: Vec<CylinderBore> = frame.wall_ids().filter_map(|k| bounding_bore(frame, k, &members)).collect();
        grid.remove_flanks(&mut heights, lowest, &LeaningWall::among(&planes, &bores, &up));
        let mean_plane = grid.plane_through_all(&heights)?;
        let fits: Vec<Option<FittedPlane>> =
            (0..heights.len()).into_par_iter().map(|k| grid.plane_at(&heights, k, reach * grid.width)).collect();
        let planes: Vec<&FittedPlane> = fits.iter().flatten().collect();
        let count = planes.len() as f64;
        let mean = |value: &dyn Fn(&FittedPlane) -> f64| planes.iter().map(|plane| value(plane)).sum::<f64>() / count;
        let mean_gradient = [0, 1].map(|k| mean(&|p| p.gradient[k]));
        let spread = mean(&|p| (p.gradient[0] - mean_gradient[0]).powi(2) + (p.gradient[1] - mean_gradient[1]).powi(2));
        let grain_noise = grid.noise_density(&heights, &fits, &mean_plane, MIN_PATCH);
        let min_variance = (SIGNIFICANCE_FACTOR * SIGNIFICANCE_FACTOR * grain_noise * mean(&|p| p.variance))
            .max((MAX_UNDULATION / reach).powi(2));
        let is_plane = planes.is_empty() || spread <= min_variance;
        let density = if is_plane {
            grid.noise_density(&heights, &fits, &mean_plane, (0.5 * PATCH_SHARE * reach).clamp(MIN_PATCH, MAX_PATCH))
        } else {
            grain_noise
        };
        let angle = |gradient: [f64; 2]| {
            let normal = up - gradient[0] * grid.axes[0] - gradient[1] * grid.axes[1];
            (normal.dot(&against_gravity) / normal.norm()).clamp(-1.0, 1.0).acos()
        };
        let noise_of = |plane: &FittedPlane| (density * plane.variance).sqrt();
        let column = |(k, fit): (usize, &Option<FittedPlane>)| {
            let Some(plane) = fit else { return SurfaceColumn::NONE };
            let [a, b] = grid.column_middle(k);
            let x = a * grid.axes[0] + b * grid.axes[1] + plane.height * up;
            let noise = noise_of(plane);
            let slope = without_noise(angle(plane.gradient), noise);
            SurfaceColumn { x, height: plane.height - lowest, slope, error: noise.atan() }
        };
        let columns: Vec<SurfaceColumn> = fits.iter().enumerate().map(column).collect();
        let noise = noise_of(&mean_plane.plane);
        let mut surface = FreeSurface {
            axes: grid.axes,
            counts: grid.counts,
            from: grid.from,
            widths: grid.widths,
            columns,
            slope: without_noise(angle(mean_plane.plane.gradient), noise),
            slope_error: noise.atan(),
            noise: f64::NAN,
        };
        if !planes.is_empty() {
            let noise = density * mean(&|p| p.variance);
            // Planes of columns nearer than about the reach are fitted to the same heights and have the same error. The
            // surface has as many planes with errors of their own as effective areas of a plane fit into it.
            let independent_planes = (count / mean(&|p| p.effective_area)).max(1.0);
            surface.noise = noise.sqrt().atan();
            if !is_plane && let [median] = surface.slope_quantiles(&[0.5])[..] {
                (surface.slope, surface.slope_error) = (median, (noise / independent_planes).sqrt().atan());
            }
        }
        Some(surface)
    }

    /// Names of the axes.
    pub fn axis_names(&self) -> [String; 2] {
        let name = |axis: &Vec3| {
            let along = ["x", "y", "z"].into_iter().zip(axis.iter()).find(|(_, part)| **part == 1.0);
            along
                .map_or_else(|| format!("along ({:.2}, {:.2}, {:.2})", axis.x, axis.y, axis.z), |(name, _)| name.into())
        };
        [name(&self.axes[0]), name(&self.axes[1])]
    }

    /// Quantiles of the columns' slopes at these shares, rad; empty if no slope is known.
    pub fn slope_quantiles(&self, shares: &[f64]) -> Vec<f64> {
        let mut known: Vec<f64> = self.columns.iter().map(|column| column.slope).filter(|s| s.is_finite()).collect();
        known.sort_by(f64::total_cmp);
        let quantile =
            |share: &f64| known.get(((share * known.len() as f64).ceil() as usize).saturating_sub(1)).copied();
        shares.iter().filter_map(quantile).collect()
    }
}

/// Wall that bounds the grains and leans over them, at least in part.
enum LeaningWall<'a> {
    Plane(&'a WallPlane),
    Bore(&'a CylinderBore),
}

impl<'a> LeaningWall<'a> {
    /// Walls that lean over the grains, among these planes and bores.
    fn among(planes: &'a [WallPlane], bores: &'a [CylinderBore], up: &Vec3) -> Vec<LeaningWall<'a>> {
        let leaning = planes.iter().filter(|plane| plane.normal.dot(up) < 0.0).map(LeaningWall::Plane);
        leaning.chain(bores.iter().map(LeaningWall::Bore)).collect()
    }

    /// Distance of a point from the wall, m, and the sine of the angle from the vertical by which the wall there leans over
    /// the point; negative if it leans away.
    fn distance_and_lean(&self, x: &Vec3, up: &Vec3) -> (f64, f64) {
        match self {
            LeaningWall::Plane(plane) => (x.dot(&plane.normal) - plane.offset, -plane.normal.dot(up)),
            LeaningWall::Bore(bore) => {
                let outwards = bore.offset_from_axis(x);
                let reach = outwards.norm();
                (bore.radius - reach, if reach > 0.0 { outwards.dot(up) / reach } else { 0.0 })
            }
        }
    }
}

/// One plane through all heights.
struct MeanPlane {
    /// Mean position of the heights along the axes, m, at which the plane has the height of `plane`.
    middle: [f64; 2],
    /// Plane in coordinates (m) along the axes from `middle`.
    plane: FittedPlane,
}

impl MeanPlane {
    fn height(&self, [x, y]: [f64; 2]) -> f64 {
        let [a, b] = self.plane.gradient;
        self.plane.height + a * (x - self.middle[0]) + b * (y - self.middle[1])
    }
}

/// Mean plane of the surface of some grains.
pub struct SurfacePlane {
    /// Point of the plane, m.
    pub point: Vec3,
    /// Normal of length 1, upwards.
    pub normal: Vec3,
    /// Area of the columns that have a grain, seen from above, m^2.
    pub area: f64,
}

/// Least-squares plane through the heights of the columns over some grains between walls; None without grains. The plane is
/// level along a period, and leaves out columns on the flank of the grains along a wall that leans over them.
pub fn mean_plane(
    grains: &[&Grain],
    planes: &[WallPlane],
    bores: &[CylinderBore],
    cell: &PeriodicCell,
    up: &Vec3,
) -> Option<SurfacePlane> {
    if grains.is_empty() {
        return None;
    }
    let grid = ColumnGrid::from_grains(grains, cell, *up);
    let heights = grid.column_heights(grains);
    let mut surface_heights = heights.clone();
    let lowest = grains.iter().map(|g| height_range(g, up)[0]).fold(f64::INFINITY, f64::min);
    grid.remove_flanks(&mut surface_heights, lowest, &LeaningWall::among(planes, bores, up));
    let plane = grid.plane_through_all(&surface_heights)?;
    let ([first, second], [x, y], [along, across]) = (grid.axes, plane.middle, plane.plane.gradient);
    Some(SurfacePlane {
        point: first * x + second * y + up * plane.plane.height,
        normal: (up - first * along - second * across).normalize(),
        area: heights.iter().filter(|height| height.is_finite()).count() as f64 * grid.widths[0] * grid.widths[1],
    })
}

/// Face of a polyhedron that is seen from above.
struct UpperFace {
    /// Corners along the axes, from the centre of the grain, counter-clockwise, m.
    corners: Vec<[f64; 2]>,
    /// Height of the plane above the centre of the grain, m.
    height: f64,
    /// Gradient of this height along the axes.
    gradient: [f64; 2],
    /// Height of the centre of the grain, m.
    centre_height: f64,
    /// Rounding of a position, m.
    rounding: f64,
}

impl UpperFace {
    fn of_grain(grain: &Grain, axes: &[Vec3; 2], up: &Vec3) -> Vec<UpperFace> {
        let Some(solid) = grain.solid.as_deref() else { return Vec::new() };
        let corners: Vec<Vec3> = grain.vertices().map(|v| v - grain.x).collect();
        let rounding = 1e-9 * grain.bounding_radius();
        let face = |face_corners: &Vec<u32>| {
            let position = |k: usize| corners[face_corners[k] as usize];
            let normal: Vec3 = (2..face_corners.len())
                .map(|k| (position(k - 1) - position(0)).cross(&(position(k) - position(0))))
                .sum();
            let rise = normal.dot(up);
            // A face on edge is below the rim of its neighbours.
            (rise > 1e-9 * normal.norm()).then(|| UpperFace {
                corners: face_corners.iter().map(|&k| axes.map(|axis| corners[k as usize].dot(&axis))).collect(),
                height: normal.dot(&position(0)) / rise,
                gradient: axes.map(|axis| -normal.dot(&axis) / rise),
                centre_height: grain.x.dot(up),
                rounding,
            })
        };
        solid.faces.iter().filter_map(face).collect()
    }

    /// Height of the face on a vertical, m; None if the vertical misses the face.
    fn height_at(&self, [x, y]: [f64; 2]) -> Option<f64> {
        let edges = self.corners.iter().zip(self.corners.iter().cycle().skip(1));
        let within = edges.into_iter().all(|([a, b], [c, d])| {
            let (along, across) = (c - a, d - b);
            along * (y - b) - across * (x - a) >= -self.rounding * along.hypot(across)
        });
        within.then(|| self.centre_height + self.height + self.gradient[0] * x + self.gradient[1] * y)
    }
}

/// Two horizontal unit vectors, perpendicular to each other; x and y if `up` is z.
fn horizontal_axes(up: &Vec3) -> [Vec3; 2] {
    let first = if up.x.abs() < 0.9 { Vec3::x() } else { Vec3::y() };
    let first = (first - up * first.dot(up)).normalize();
    [first, up.cross(&first)]
}

/// Layout of the columns.
pub(crate) struct ColumnGrid {
    up: Vec3,
    axes: [Vec3; 2],
    /// Number of columns along each axis.
    counts: [usize; 2],
    /// Positions of the lower edges of the first columns along the axes, m.
    from: [f64; 2],
    /// Largest width, m.
    width: f64,
    /// Widths of the columns, m; along a period a whole number of columns fits.
    widths: [f64; 2],
    /// Whether the columns repeat along each axis.
    repeats: [bool; 2],
}

impl ColumnGrid {
    /// Square grid about the vertical through `centre` (m) that extends by `reach` (m) along both axes, in columns at most
    /// `width` (m) wide; wider if there would be more than [`MAX_COLUMNS`] along an axis.
    pub(crate) fn about_axis(centre: Vec3, up: Vec3, reach: f64, width: f64) -> ColumnGrid {
        let axes = horizontal_axes(&up);
        let count = (2.0 * reach / width).ceil().clamp(1.0, MAX_COLUMNS);
        let width = 2.0 * reach / count;
        ColumnGrid {
            up,
            axes,
            counts: [count as usize; 2],
            from: axes.map(|axis| centre.dot(&axis) - reach),
            width,
            widths: [width; 2],
            repeats: [false; 2],
        }
    }

    /// Grid over all grains, along axes with a period over the cell.
    fn from_grains(grains: &[&Grain], cell: &PeriodicCell, up: Vec3) -> ColumnGrid {
        let mean_radius = grains.iter().map(|g| g.radius).sum::<f64>() / grains.len() as f64;
        let axes = horizontal_axes(&up);
        let span = |k: usize| {
            if let Some(period) = cell.periods[k] {
                return [-0.5 * period, 0.5 * period];
            }
            let ends = grains.iter().map(|g| height_range(g, &axes[k]));
            ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [l, h]| [low.min(l), high.max(h)])
        };
        let spans = [span(0), span(1)];
        let lengths = spans.map(|[low, high]| high - low);
        let width = mean_radius.max(lengths[0].max(lengths[1]) / MAX_COLUMNS);
        let counts = lengths.map(|length| (length / width).ceil().max(1.0) as usize);
        let widths = [0, 1].map(|k| if cell.periods[k].is_some() { lengths[k] / counts[k] as f64 } else { width });
        ColumnGrid {
            width,
            up,
            axes,
            counts,
            from: spans.map(|[low, _]| low),
            widths,
            repeats: [0, 1].map(|axis| cell.periods[axis].is_some()),
        }
    }

    fn column_index(&self, [i, j]: [usize; 2]) -> usize {
        j * self.counts[0] + i
    }

    /// Horizontal unit vectors along which the columns are counted.
    pub(crate) fn axes(&self) -> [Vec3; 2] {
        self.axes
    }

    /// Area of each column seen from above, m^2.
    pub(crate) fn column_area(&self) -> f64 {
        self.widths[0] * self.widths[1]
    }

    /// Position of the middle of a column along the axes, m.
    fn column_middle(&self, k: usize) -> [f64; 2] {
        let cell = [k % self.counts[0], k / self.counts[0]];
        [0, 1].map(|axis| self.from[axis] + (cell[axis] as f64 + 0.5) * self.widths[axis])
    }

    /// Position of the middle of a column relative to a point (m), along the axes, m.
    pub(crate) fn offset_from(&self, k: usize, point: &Vec3) -> [f64; 2] {
        let middle = self.column_middle(k);
        [0, 1].map(|axis| middle[axis] - point.dot(&self.axes[axis]))
    }

    /// Columns whose middles are within `reach` of a position along the axes, each with its displacement from there; None
    /// for columns outside the grid.
    fn columns_around(&self, point: [f64; 2], reach: f64) -> impl Iterator<Item = (Option<usize>, [f64; 2])> {
        let ends = move |axis: usize| {
            let grid_coordinate = |x: f64| (x - self.from[axis]) / self.widths[axis] - 0.5;
            let (first, last) = (
                grid_coordinate(point[axis] - reach).ceil() as isize,
                grid_coordinate(point[axis] + reach).floor() as isize,
            );
            // Along a period each column is counted once.
            let all = self.counts[axis] as isize;
            let once = (grid_coordinate(point[axis]) - 0.5 * all as f64).ceil() as isize;
            if self.repeats[axis] && last - first >= all { once..=once + all - 1 } else { first..=last }
        };
        let index = |axis: usize, i: isize| {
            let count = self.counts[axis] as isize;
            if self.repeats[axis] {
                Some(i.rem_euclid(count) as usize)
            } else {
                (0..count).contains(&i).then_some(i as usize)
            }
        };
        let offset = move |axis: usize, i: isize| self.from[axis] + (i as f64 + 0.5) * self.widths[axis] - point[axis];
        let pairs = ends(1).flat_map(move |j| ends(0).map(move |i| [i, j]));
        let with_offsets = pairs.map(move |[i, j]| {
            let number = index(0, i).zip(index(1, j)).map(|(i, j)| self.column_index([i, j]));
            (number, [offset(0, i), offset(1, j)])
        });
        with_offsets.filter(move |(_, [x, y])| x * x + y * y < reach * reach)
    }

    /// Height of the highest point of a grain on the vertical of each column, m; NaN without grains.
    pub(crate) fn column_heights(&self, grains: &[&Grain]) -> Vec<f64> {
        let mut heights = vec![f64::NAN; self.counts[0] * self.counts[1]];
        let on_plane = |x: &Vec3| self.axes.map(|axis| x.dot(&axis));
        for grain in grains {
            for (x, radius) in grain.balls() {
                for (k, [u, v]) in self.columns_around(on_plane(&x), radius) {
                    let height = x.dot(&self.up) + (radius.powi(2) - u * u - v * v).sqrt();
                    if let Some(k) = k {
                        heights[k] = height.max(heights[k]);
                    }
                }
            }
            let faces = UpperFace::of_grain(grain, &self.axes, &self.up);
            if faces.is_empty() {
                continue;
            }
            for (k, at) in self.columns_around(on_plane(&grain.x), grain.bounding_radius()) {
                if let Some(k) = k {
                    let highest = faces.iter().filter_map(|face| face.height_at(at)).fold(heights[k], f64::max);
                    heights[k] = highest;
                }
            }
        }
        heights
    }

    /// Removes the heights of columns that stand on the flank of the grains along a leaning wall, with `lowest_height` the lowest
    /// point of the grains. A wall over most of the columns is a lid, under which all is surface.
    ///
    /// The flank of grains of depth H has the width H sin(lean) seen from above.
    fn remove_flanks(&self, heights: &mut [f64], lowest_height: f64, walls: &[LeaningWall]) {
        let depth = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max) - lowest_height;
        let known: Vec<usize> = (0..heights.len()).filter(|&k| heights[k].is_finite()).collect();
        let point = |k: usize, height: f64| {
            let [a, b] = self.column_middle(k);
            a * self.axes[0] + b * self.axes[1] + height * self.up
        };
        let is_on_flank = |wall: &LeaningWall, x: Vec3| {
            let (distance, lean) = wall.distance_and_lean(&x, &self.up);
            lean > 0.0 && distance <= (FLANK_DEPTH * self.width).min(depth * lean)
        };
        let mut hidden: Vec<usize> = Vec::new();
        for wall in walls {
            let flank_columns = || known.iter().copied().filter(|&k| is_on_flank(wall, point(k, heights[k])));
            if 2 * flank_columns().count() <= known.len() {
                hidden.extend(flank_columns());
            }
        }
        hidden.into_iter().for_each(|k| heights[k] = f64::NAN);
    }

    /// Plane about the middle of column k through the heights within `reach`.
    fn plane_at(&self, heights: &[f64], k: usize, reach: f64) -> Option<FittedPlane> {
        let (mut all, mut fit) = (0.0, PlaneFit::new(reach));
        for (k, at) in self.columns_around(self.column_middle(k), reach) {
            all += fit.weight_at(at);
            if let Some(height) = k.map(|k| heights[k]).filter(|height| height.is_finite()) {
                fit.add(at, height, 1.0);
            }
        }
        (fit.weight_sum >= 0.5 * all).then(|| fit.fitted_plane())?
    }

    /// Plane through all heights, level along a period, and level if these lie on a line. None without heights.
    fn plane_through_all(&self, heights: &[f64]) -> Option<MeanPlane> {
        let surface_point = |k: usize| {
            let [x, y] = self.column_middle(k);
            Vec3::new(x, y, heights[k])
        };
        let known: Vec<Vec3> = (0..heights.len()).filter(|&k| heights[k].is_finite()).map(surface_point).collect();
        let count = known.len() as f64;
        let mean = known.iter().sum::<Vec3>() / count;
        let (middle, height) = ([mean.x, mean.y], mean.z);
        // Along a period nothing is fitted.
        let fitted_axes = Vec3::new(f64::from(u8::from(!self.repeats[0])), f64::from(u8::from(!self.repeats[1])), 1.0);
        let offset = |p: &Vec3| (p - mean).component_mul(&fitted_axes);
        let spread = known.iter().map(|p| offset(p) * offset(p).transpose()).sum::<Matrix3<f64>>() / count;
        let (xx, yy, xy) = (spread[(0, 0)], spread[(1, 1)], spread[(0, 1)]);
        let (xz, yz) = (spread[(0, 2)], spread[(1, 2)]);
        let quotient_or_zero = |value: f64, divisor: f64| if divisor > 0.0 { value / divisor } else { 0.0 };
        let determinant = xx * yy - xy * xy;
        let (gradient, variance) = if determinant > 1e-9 * xx * yy {
            ([(xz * yy - yz * xy) / determinant, (yz * xx - xz * xy) / determinant], (xx + yy) / determinant)
        } else if xx * yy > 0.0 {
            ([0.0; 2], 0.0)
        } else {
            (
                [quotient_or_zero(xz, xx), quotient_or_zero(yz, yy)],
                quotient_or_zero(1.0, xx) + quotient_or_zero(1.0, yy),
            )
        };
        let plane = FittedPlane::through_all(height, gradient, variance / count, count);
        (!known.is_empty()).then_some(MeanPlane { middle, plane })
    }

    /// Density of the noise of single grains, m^2 times a column, from residuals within `patch` mean diameters. Residuals
    /// are from the columns' planes, or from the mean plane if a column has none.
    fn noise_density(&self, heights: &[f64], fits: &[Option<FittedPlane>], mean_plane: &MeanPlane, patch: f64) -> f64 {
        let patch_width = 2.0 * self.width * patch * (1.0 + 1e-9);
        let residual = |k: usize| {
            heights[k] - fits[k].map_or_else(|| mean_plane.height(self.column_middle(k)), |plane| plane.height)
        };
        let mut density = NoiseDensity::default();
        for k in (0..heights.len()).filter(|&k| heights[k].is_finite()) {
            let near = self.columns_around(self.column_middle(k), patch_width).filter_map(|(j, _)| j);
            let near: Vec<f64> = near.map(residual).filter(|e| e.is_finite()).collect();
            let plane = fits[k].as_ref().unwrap_or(&mean_plane.plane);
            let residual_k = residual(k);
            density.add(1.0, residual_k, residual_k * near.iter().sum::<f64>(), near.len() as f64, plane);
        }
        density.mean_density()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::derive::fragments::find_fragments;
    use crate::samples::Scene;

    /// Grains of a plate that all carry force, with their surface at these heights over a square lattice.
    fn lattice(half: i32, height: impl Fn(f64, f64) -> f64) -> Scene {
        let mut scene = Scene::default();
        scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -2.0];
        let floor = scene.plate([0.0, 0.0, -100.5], [90.0, 90.0, 0.5]);
        for (i, j) in (-half..=half).flat_map(|i| (-half..=half).map(move |j| (f64::from(i), f64::from(j)))) {
            let grain = scene.grain([i, j, height(i, j)], 1.0);
            scene.contact_at(grain, floor, [i, j, 0.0], Vec3::z());
        }
        scene
    }

    fn surface_of(scene: &Scene) -> Option<FreeSurface> {
        let frame = scene.frame();
        FreeSurface::from_frame(&frame, &find_fragments(&frame), 6.0)
    }

    fn median(scene: &Scene) -> f64 {
        surface_of(scene).unwrap().slope_quantiles(&[0.5])[0].to_degrees()
    }

    #[test]
    fn a_plane_and_a_cone_have_their_slopes() {
        let rise = 30f64.to_radians().tan();
        // The surface of spheres with the spacing of their radius is rough by a seventh of it, over twelve of them. On the
        // cone, at a median distance of 11 from its axis, planes lose the share 6^2 / (20 11^2) of the slope, and more
        // about its top.
        assert!((median(&lattice(12, |x, _| rise * x)) - 30.0).abs() < 0.5);
        assert!((median(&lattice(12, |x, y| 0.6 * rise * x - 0.8 * rise * y)) - 30.0).abs() < 0.5);
        assert!((median(&lattice(16, |x, y| -rise * x.hypot(y))) - 30.0).abs() < 1.5);
        assert!(median(&lattice(12, |_, _| 0.0)) < 0.5);
    }

    /// Pseudo-random heights, from 0 to 2, by the positions of grains.
    fn rough(x: f64, y: f64) -> f64 {
        let mut z = ((x + 500.0) as u64 * 1000 + (y + 500.0) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        2.0 * ((z ^ (z >> 31)) >> 11) as f64 / 2f64.powi(53)
    }

    #[test]
    fn a_rough_bed_of_a_thousand_grains_is_level_and_a_tilted_one_is_not() {
        let reach = DEFAULT_SLOPE_REACH;
        let surface = |scene: &Scene| {
            let frame = scene.frame();
            FreeSurface::from_frame(&frame, &find_fragments(&frame), reach).unwrap()
        };
        let slope = |tilt: f64| surface(&lattice(15, |x, y| tilt * x + rough(x, y)));
        let level = slope(0.0);
        assert!(level.slope < 1f64.to_radians() && level.slope_error < 1f64.to_radians(), "{}", level.slope);
        let known: Vec<f64> = level.columns.iter().map(|c| c.slope).filter(|s| s.is_finite()).collect();
        let mean = known.iter().sum::<f64>() / known.len() as f64;
        assert!(mean < 2f64.to_radians() && level.noise < 2f64.to_radians(), "{mean} {}", level.noise);
        let tilted = slope(20f64.to_radians().tan());
        assert!((tilted.slope - 20f64.to_radians()).abs() < 1f64.to_radians(), "{}", tilted.slope);
        // A heap has the median of its parts, as its mean plane is level.
        let heap = surface(&lattice(22, |x, y| rough(x, y) - 0.5 * x.hypot(y)));
        assert!((heap.slope - 0.5f64.atan()).abs() < 2f64.to_radians(), "{}", heap.slope);
    }

    #[test]
    fn a_bed_that_undulates_by_less_than_a_grain_is_level_and_heaps_are_not() {
        for seed in 0..8 {
            // Undulations over some six grains, of a standard deviation of 0.4 radii.
            let swell = |x: f64, y: f64| {
                let near = (-3..=3).flat_map(|i| (-3..=3).map(move |j| (f64::from(i), f64::from(j))));
                let at = |(i, j)| rough(x + i + 61.0 * f64::from(seed), y + j + 200.0) - 1.0;
                near.map(at).sum::<f64>() / 7.0 * 0.4 * 3f64.sqrt() + 0.8 * rough(x, y - 200.0)
            };
            let surface = |half: i32, shape: &dyn Fn(f64, f64) -> f64| {
                let frame = lattice(half, |x, y| shape(x, y) + swell(x, y)).frame();
                FreeSurface::from_frame(&frame, &find_fragments(&frame), DEFAULT_SLOPE_REACH).unwrap()
            };
            let level = surface(16, &|_, _| 0.0);
            let slope = level.slope.to_degrees();
            assert!(slope < 2.0 && level.slope_error < 2f64.to_radians(), "{slope} {}", level.slope_error);
            let known: Vec<f64> = level.columns.iter().map(|c| c.slope).filter(|s| s.is_finite()).collect();
            let mean = (known.iter().sum::<f64>() / known.len() as f64).to_degrees();
            assert!(mean < 2.0, "{mean}");
            for (angle, shape) in [
                (15.0f64, &(|x: f64, y: f64| -x.hypot(y)) as &dyn Fn(f64, f64) -> f64),
                (25.0, &|x, y| -x.hypot(y)),
                (20.0, &|x, _| x),
                (20.0, &|x, _| -x.abs()),
            ] {
                let found = surface(22, &|x, y| angle.to_radians().tan() * shape(x, y)).slope.to_degrees();
                assert!((found - angle).abs() < 2.5, "{angle}: {found}");
            }
        }
    }

    /// A box of grains cut by an inclined plane: rougher than a settled bed, as grains stand out of holes.
    #[test]
    fn a_cut_bed_has_the_slope_of_the_cut() {
        let (half, angle) = (9, 20f64);
        for seed in 0..2 {
            let mut scene = Scene::default();
            scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -2.0];
            let (floor, wall) = (scene.plate([0.0, 0.0, -20.5], [90.0, 90.0, 0.5]), 1.8 * f64::from(half) + 2.4);
            for (x, y) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
                let along = |part: f64| if part == 0.0 { 90.0 } else { 0.5 };
                scene.plate([x * wall, y * wall, 0.0], [along(x), along(y), 90.0]);
            }
            let columns = (-half..=half).flat_map(|i| (-half..=half).map(move |j| (f64::from(i), f64::from(j))));
            for (i, j, k) in columns.flat_map(|(i, j)| (-8..=4).map(move |k| (i, j, f64::from(k)))) {
                let shift = |axis: f64| rough(i + 40.0 * k + 7000.0 * axis, j + 50.0 * f64::from(seed)) - 1.0;
                let [x, y, z] = [(i, 0.0), (j, 1.0), (k, 2.0)].map(|(at, axis)| 1.8 * at + 0.9 * shift(axis));
                if z < x * angle.to_radians().tan() {
                    let grain = scene.grain([x, y, z], 1.0);
                    scene.contact_at(grain, floor, [x, y, -20.0], Vec3::z());
                }
            }
            let frame = scene.frame();
            let surface = FreeSurface::from_frame(&frame, &find_fragments(&frame), DEFAULT_SLOPE_REACH).unwrap();
            let [found, error] = [surface.slope, surface.slope_error].map(f64::to_degrees);
            // The deviation is 0.42 degrees over sixteen such beds (root mean square), at most 0.8.
            assert!((found - angle).abs() < 1.0 && error < 2.5, "{found} {error}");
        }
    }

    /// A level bed in a tilted box: seen along gravity, the flank of the bed along the upper wall is part of its outline.
    #[test]
    fn the_flank_of_a_bed_along_a_wall_is_no_free_surface() {
        let (half, layers) = (12, 8);
        for (angle, about) in [(0.0f64, 0.0f64), (10.0, 0.0), (20.0, 0.7), (35.0, 0.0), (35.0, 0.7)] {
            let mut scene = Scene::default();
            let (sin, cos) = angle.to_radians().sin_cos();
            scene.snapshot.meta.parameters.uniform_gravity = [sin * about.cos(), sin * about.sin(), -cos];
            let (floor, wall) = (scene.plate([0.0, 0.0, -16.5], [90.0, 90.0, 0.5]), f64::from(half) + 1.5);
            for (x, y) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
                let along = |part: f64| if part == 0.0 { 90.0 } else { 0.5 };
                scene.plate([x * wall, y * wall, 0.0], [along(x), along(y), 90.0]);
            }
            for (i, j) in (-half..=half).flat_map(|i| (-half..=half).map(move |j| (f64::from(i), f64::from(j)))) {
                for k in 0..layers {
                    let z = -2.0 * f64::from(k) + if k == 0 { rough(i, j) - 1.0 } else { 0.0 };
                    let grain = scene.grain([i, j, z], 1.0);
                    scene.contact_at(grain, floor, [i, j, -16.0], Vec3::z());
                }
            }
            let frame = scene.frame();
            let surface = FreeSurface::from_frame(&frame, &find_fragments(&frame), DEFAULT_SLOPE_REACH).unwrap();
            let [found, error] = [surface.slope, surface.slope_error].map(f64::to_degrees);
            assert!((found - angle).abs() < 1f64.max(2.0 * error) && error < 2.0, "{angle} {about}: {found} {error}");
        }
    }

    #[test]
    fn slopes_are_against_gravity_whatever_its_direction() {
        let mut scene = lattice(12, |_, _| 0.0);
        let (sin, cos) = 20f64.to_radians().sin_cos();
        scene.snapshot.meta.parameters.uniform_gravity = [2.0 * sin, 0.0, -2.0 * cos];
        assert!((median(&scene) - 20.0).abs() < 1.0);
        // The same surface in a scene with a period of 25 columns, without edges.
        (scene.snapshot.meta.parameters.xperiode, scene.snapshot.meta.parameters.yperiode) = (Some(25.0), Some(25.0));
        assert!((median(&scene) - 20.0).abs() < 0.5);
        let surface = surface_of(&scene).unwrap();
        assert_eq!(surface.counts, [25, 25]);
        // Highest at the poles of the spheres, on which columns stand.
        assert!(surface.columns.iter().all(|c| (c.height - 2.0).abs() < 1e-12 && (c.x.z - 1.0).abs() < 1e-12));
    }

    #[test]
    fn what_nothing_holds_has_no_surface() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        assert_eq!(surface_of(&scene), None);
        scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -2.0];
        assert_eq!(surface_of(&scene), None);
        // A grain far from the others makes wide columns, and no end of them.
        let mut scene = lattice(2, |_, _| 0.0);
        let floor = 0;
        let far = scene.grain([1e9, 0.0, 0.0], 1.0);
        scene.contact_at(far, floor, [1e9, 0.0, 0.0], Vec3::z());
        assert!(surface_of(&scene).is_none_or(|surface| surface.columns.len() <= 500 * 500));
    }
}
