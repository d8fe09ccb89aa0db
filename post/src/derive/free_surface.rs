//! The free surface of grains that uniform gravity holds against walls, a heap or a bed: heights by columns, and slopes.

use nalgebra::Matrix3;
use rayon::prelude::*;

use crate::derive::bed::borne;
use crate::derive::fragments::Fragment;
use crate::derive::surface::SMOOTHING;
use crate::frame::{Cell, Frame, Grain, Vec3};

/// Columns along one direction at most: what lies far off makes them wider.
const MOST: f64 = 500.0;

/// Columns about verticals, a mean radius wide, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeSurface {
    /// Horizontal; x and y where verticals are along z.
    pub axes: [Vec3; 2],
    /// Columns along each of them.
    pub counts: [usize; 2],
    /// Where the first begin along the axes, m.
    pub from: [f64; 2],
    /// Their widths along the axes, m.
    pub widths: [f64; 2],
    /// NaN where no grain is, or too few are around.
    pub columns: Vec<Column>,
}

/// The surface at one vertical.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Column {
    /// m
    pub x: Vec3,
    /// Above the lowest point of the grains, m.
    pub height: f64,
    /// Angle between the normal and the direction against gravity, rad.
    pub slope: f64,
}

impl FreeSurface {
    /// That of all groups that a wall touches with force; none without them, and without uniform gravity.
    ///
    /// The height of a column is that of the highest sphere on its vertical, of polyhedra the sphere of equal volume. Position
    /// and normal are those of the plane of least squares through the heights within three mean radii, of weight
    /// (1 - (d / reach)^2)^2 at the distance d; there is none where less than half of that weight has a height. Verticals
    /// are against gravity; in a scene that repeats along z, as a slope is one on which gravity leans.
    pub fn of(frame: &Frame, fragments: &[Fragment]) -> Option<FreeSurface> {
        let against = (-Vec3::from(frame.meta.parameters.uniform_gravity)).try_normalize(0.0)?;
        let grains: Vec<&Grain> = borne(frame, fragments).into_iter().map(|i| &frame.grains[i]).collect();
        if grains.is_empty() {
            return None;
        }
        let up = if frame.cell().repeats() { Vec3::z() } else { against };
        let grid = Grid::over(&grains, &frame.cell(), up);
        let heights = grid.heights(&grains);
        let lowest = grains.iter().map(|g| g.x.dot(&up) - g.radius).fold(f64::INFINITY, f64::min);
        let reach = SMOOTHING * grid.width;
        let column = |k: usize| {
            let none = Column { x: Vec3::repeat(f64::NAN), height: f64::NAN, slope: f64::NAN };
            let Some([height, along, across]) = grid.plane(&heights, k, reach) else { return none };
            let [a, b] = grid.middle(k);
            let [first, second] = grid.axes;
            let normal = up - along * first - across * second;
            let slope = (normal.dot(&against) / normal.norm()).clamp(-1.0, 1.0).acos();
            Column { x: a * first + b * second + height * up, height: height - lowest, slope }
        };
        let columns = (0..heights.len()).into_par_iter().map(column).collect();
        Some(FreeSurface { axes: grid.axes, counts: grid.counts, from: grid.from, widths: grid.widths, columns })
    }

    /// What the axes are called.
    pub fn names(&self) -> [String; 2] {
        let name = |axis: &Vec3| {
            let along = ["x", "y", "z"].into_iter().zip(axis.iter()).find(|(_, part)| **part == 1.0);
            along
                .map_or_else(|| format!("along ({:.2}, {:.2}, {:.2})", axis.x, axis.y, axis.z), |(name, _)| name.into())
        };
        [name(&self.axes[0]), name(&self.axes[1])]
    }

    /// The slopes (rad) that these shares of the columns are below; none where no slope is known.
    pub fn slopes_below(&self, shares: &[f64]) -> Vec<f64> {
        let mut known: Vec<f64> = self.columns.iter().map(|column| column.slope).filter(|s| s.is_finite()).collect();
        known.sort_by(f64::total_cmp);
        let at = |share: &f64| known.get(((share * known.len() as f64).ceil() as usize).saturating_sub(1)).copied();
        shares.iter().filter_map(at).collect()
    }
}

/// Where the columns stand.
struct Grid {
    up: Vec3,
    axes: [Vec3; 2],
    counts: [usize; 2],
    from: [f64; 2],
    /// m, at most.
    width: f64,
    /// Along a period such that a whole number fits.
    widths: [f64; 2],
    repeats: [bool; 2],
}

impl Grid {
    fn over(grains: &[&Grain], cell: &Cell, up: Vec3) -> Grid {
        let mean_radius = grains.iter().map(|g| g.radius).sum::<f64>() / grains.len() as f64;
        let first = if up.x.abs() < 0.9 { Vec3::x() } else { Vec3::y() };
        let first = (first - up * first.dot(&up)).normalize();
        let axes = [first, up.cross(&first)];
        let span = |k: usize| {
            if let Some(period) = cell.0[k] {
                return [-0.5 * period, 0.5 * period];
            }
            let ends = grains.iter().map(|g| [g.x.dot(&axes[k]) - g.radius, g.x.dot(&axes[k]) + g.radius]);
            ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [l, h]| [low.min(l), high.max(h)])
        };
        let spans = [span(0), span(1)];
        let lengths = spans.map(|[low, high]| high - low);
        let width = mean_radius.max(lengths[0].max(lengths[1]) / MOST);
        let counts = lengths.map(|length| (length / width).ceil().max(1.0) as usize);
        let widths = [0, 1].map(|k| if cell.0[k].is_some() { lengths[k] / counts[k] as f64 } else { width });
        Grid {
            width,
            up,
            axes,
            counts,
            from: spans.map(|[low, _]| low),
            widths,
            repeats: cell.0.map(|period| period.is_some()),
        }
    }

    fn number(&self, [i, j]: [usize; 2]) -> usize {
        j * self.counts[0] + i
    }

    /// Along the axes.
    fn middle(&self, k: usize) -> [f64; 2] {
        let place = [k % self.counts[0], k / self.counts[0]];
        [0, 1].map(|axis| self.from[axis] + (place[axis] as f64 + 0.5) * self.widths[axis])
    }

    /// Columns with their middles within `reach` of a place along the axes, each with the way from there; those beyond the grid
    /// are none.
    fn around(&self, place: [f64; 2], reach: f64) -> impl Iterator<Item = (Option<usize>, [f64; 2])> {
        let ends = move |axis: usize| {
            let at = |x: f64| (x - self.from[axis]) / self.widths[axis] - 0.5;
            let (first, last) = (at(place[axis] - reach).ceil() as isize, at(place[axis] + reach).floor() as isize);
            // Of what repeats each column once.
            let all = self.counts[axis] as isize;
            let once = (at(place[axis]) - 0.5 * all as f64).ceil() as isize;
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
        let way = move |axis: usize, i: isize| self.from[axis] + (i as f64 + 0.5) * self.widths[axis] - place[axis];
        let pairs = ends(1).flat_map(move |j| ends(0).map(move |i| [i, j]));
        let with_ways = pairs.map(move |[i, j]| {
            let number = index(0, i).zip(index(1, j)).map(|(i, j)| self.number([i, j]));
            (number, [way(0, i), way(1, j)])
        });
        with_ways.filter(move |(_, [x, y])| x * x + y * y < reach * reach)
    }

    /// Of each column the height of the highest sphere on its vertical, m; NaN without.
    fn heights(&self, grains: &[&Grain]) -> Vec<f64> {
        let mut heights = vec![f64::NAN; self.counts[0] * self.counts[1]];
        for grain in grains {
            let place = self.axes.map(|axis| grain.x.dot(&axis));
            for (k, [x, y]) in self.around(place, grain.radius) {
                let height = grain.x.dot(&self.up) + (grain.radius.powi(2) - x * x - y * y).sqrt();
                if let Some(k) = k {
                    heights[k] = height.max(heights[k]);
                }
            }
        }
        heights
    }

    /// Height over the middle of column k, and how it rises along the axes.
    fn plane(&self, heights: &[f64], k: usize, reach: f64) -> Option<[f64; 3]> {
        let (mut all, mut matrix, mut sums) = (0.0, Matrix3::zeros(), Vec3::zeros());
        for (k, [x, y]) in self.around(self.middle(k), reach) {
            let weight = (1.0 - (x * x + y * y) / (reach * reach)).powi(2);
            all += weight;
            if let Some(height) = k.map(|k| heights[k]).filter(|height| height.is_finite()) {
                let row = Vec3::new(1.0, x / reach, y / reach);
                matrix += weight * row * row.transpose();
                sums += weight * height * row;
            }
        }
        let plane = (matrix[(0, 0)] >= 0.5 * all).then(|| matrix.cholesky())??.solve(&sums);
        Some([plane.x, plane.y / reach, plane.z / reach])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::derive::fragments::fragments;
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

    fn of(scene: &Scene) -> Option<FreeSurface> {
        let frame = scene.frame();
        FreeSurface::of(&frame, &fragments(&frame))
    }

    fn median(scene: &Scene) -> f64 {
        of(scene).unwrap().slopes_below(&[0.5])[0].to_degrees()
    }

    #[test]
    fn a_plane_and_a_cone_have_their_slopes() {
        let rise = 30f64.to_radians().tan();
        // Of spheres an own radius apart the surface is rough by a seventh of it, over six of them.
        assert!((median(&lattice(12, |x, _| rise * x)) - 30.0).abs() < 0.5);
        assert!((median(&lattice(12, |x, y| 0.6 * rise * x - 0.8 * rise * y)) - 30.0).abs() < 0.5);
        assert!((median(&lattice(16, |x, y| -rise * x.hypot(y))) - 30.0).abs() < 1.0);
        assert!(median(&lattice(12, |_, _| 0.0)) < 0.5);
    }

    #[test]
    fn slopes_are_against_gravity_whatever_its_direction() {
        let mut scene = lattice(12, |_, _| 0.0);
        let (sin, cos) = 20f64.to_radians().sin_cos();
        scene.snapshot.meta.parameters.uniform_gravity = [2.0 * sin, 0.0, -2.0 * cos];
        assert!((median(&scene) - 20.0).abs() < 1.0);
        // The same in a scene that repeats after 25 columns, where nothing ends.
        (scene.snapshot.meta.parameters.xperiode, scene.snapshot.meta.parameters.yperiode) = (Some(25.0), Some(25.0));
        assert!((median(&scene) - 20.0).abs() < 0.5);
        let surface = of(&scene).unwrap();
        assert_eq!(surface.counts, [25, 25]);
        // Highest at the poles of the spheres, on which columns stand.
        assert!(surface.columns.iter().all(|c| (c.height - 2.0).abs() < 1e-12 && (c.x.z - 1.0).abs() < 1e-12));
    }

    #[test]
    fn what_nothing_holds_has_no_surface() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        assert_eq!(of(&scene), None);
        scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -2.0];
        assert_eq!(of(&scene), None);
        // A grain far from the others makes wide columns, and no end of them.
        let mut scene = lattice(2, |_, _| 0.0);
        let floor = 0;
        let far = scene.grain([1e9, 0.0, 0.0], 1.0);
        scene.contact_at(far, floor, [1e9, 0.0, 0.0], Vec3::z());
        assert!(of(&scene).unwrap().columns.len() <= 500 * 500);
    }
}
