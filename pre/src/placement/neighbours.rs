//! Cells of dense packings, and the neighbours of their grains.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::cells::SphereGrid;
use super::region::GrainRegion;

/// Least number of balls per task: the neighbours of one take some microseconds.
const BALL_LISTS_PER_TASK: usize = 256;

/// Region with the periods of the scene that it fills.
pub struct PackingCell<'a> {
    pub region: &'a GrainRegion,
    /// Periods along the axes of a box, m; none along an axis on which the region has walls.
    pub periods: [Option<f64>; 3],
}

impl PackingCell<'_> {
    /// Vector from the nearest image of one centre to another, m, from their difference.
    pub fn nearest_separation(&self, mut difference: Vector3<f64>) -> Vector3<f64> {
        for (k, period) in self.periods.iter().enumerate() {
            if let Some(period) = period
                && difference[k].abs() > 0.5 * period
            {
                difference[k] -= period.copysign(difference[k]);
            }
        }
        difference
    }

    /// Calls `visit` with the distance of a point from each wall that is not across a period, m, negative beyond it, and
    /// the unit normal inward.
    pub fn for_each_wall(&self, point: &Vector3<f64>, mut visit: impl FnMut(f64, Vector3<f64>)) {
        self.region.for_each_wall(point, |distance, inward| {
            if (0..3).all(|k| self.periods[k].is_none() || inward[k] == 0.0) {
                visit(distance, inward);
            }
        });
    }

    /// Moves centres beyond the ends of a period to their images in the cell.
    pub fn move_inside(&self, centres: &mut [Vector3<f64>]) {
        for centre in centres {
            for (k, period) in self.periods.iter().enumerate() {
                period.iter().for_each(|period| centre[k] -= period * (centre[k] / period).round());
            }
        }
    }
}

/// Balls near each ball, by increasing index.
#[derive(Default)]
pub struct NeighbourLists {
    /// First entry of each ball in `entries`, and the end of the last.
    starts: Vec<usize>,
    entries: Vec<u32>,
    /// Whether a wall is near, for each ball.
    pub near_walls: Vec<bool>,
    /// Centres for which the lists were made, m.
    pub centres: Vec<Vector3<f64>>,
}

impl NeighbourLists {
    /// Indices of the balls near the `k`-th one.
    pub fn entries_near(&self, k: usize) -> &[u32] {
        &self.entries[self.starts[k]..self.starts[k + 1]]
    }

    /// Lists the pairs of balls that overlap, with centres in the cell.
    pub fn list_overlaps(&mut self, cell: &PackingCell, centres: &[Vector3<f64>], radii: &[f64]) {
        let mut order: Vec<usize> = (0..radii.len()).collect();
        order.sort_unstable_by(|&a, &b| radii[b].total_cmp(&radii[a]).then(a.cmp(&b)));
        let largest = order.first().map_or(1.0, |&k| radii[k]);
        let mut cells = SphereGrid::new(largest);
        let mut numbers = vec![0; radii.len()];
        for (number, &k) in order.iter().enumerate() {
            cells.add(centres[k], radii[k]);
            numbers[k] = number;
        }
        // Neighbours that are no smaller, or as large and of a smaller index: each pair once.
        let larger_neighbours = |k: usize| {
            let mut found = Vec::new();
            for shift in image_shifts(&cell.periods, &centres[k], radii[k] + largest) {
                cells.for_each_overlap(&(centres[k] + shift), radii[k], |number, _| {
                    if number < numbers[k] {
                        found.push(order[number] as u32);
                    }
                });
            }
            // A body that is longer than half a period is near by several of its images.
            found.sort_unstable();
            found.dedup();
            found
        };
        let pairs: Vec<Vec<u32>> =
            (0..radii.len()).into_par_iter().with_min_len(BALL_LISTS_PER_TASK).map(larger_neighbours).collect();
        self.join_pairs(&pairs);
        self.centres.clear();
        self.centres.extend_from_slice(centres);
        let near_wall = |k: usize| {
            let mut is_near = false;
            cell.for_each_wall(&centres[k], |distance, _| is_near |= distance < radii[k]);
            is_near
        };
        self.near_walls = (0..radii.len()).into_par_iter().with_min_len(BALL_LISTS_PER_TASK).map(near_wall).collect();
    }

    /// Makes the lists from the neighbours of each ball, each pair once.
    fn join_pairs(&mut self, pairs: &[Vec<u32>]) {
        let mut counts: Vec<usize> = pairs.iter().map(Vec::len).collect();
        pairs.iter().flatten().for_each(|&other| counts[other as usize] += 1);
        self.starts.clear();
        self.starts.push(0);
        for count in counts {
            self.starts.push(self.starts[self.starts.len() - 1] + count);
        }
        self.entries.clear();
        self.entries.resize(self.starts[pairs.len()], 0);
        let mut ends = self.starts.clone();
        let mut append = |k: usize, other: u32| {
            self.entries[ends[k]] = other;
            ends[k] += 1;
        };
        for (k, found) in pairs.iter().enumerate() {
            for &other in found {
                append(k, other);
                append(other as usize, k as u32);
            }
        }
        for ends in self.starts.windows(2) {
            self.entries[ends[0]..ends[1]].sort_unstable();
        }
    }
}

/// Shifts, m, to those images of a point of the cell that are within `reach`, m, of the cell: none first.
fn image_shifts(periods: &[Option<f64>; 3], point: &Vector3<f64>, reach: f64) -> Vec<Vector3<f64>> {
    let mut shifts = vec![Vector3::zeros()];
    for (k, period) in periods.iter().enumerate() {
        let Some(period) = period.filter(|period| point[k].abs() > 0.5 * period - reach) else { continue };
        let image = |shift: &Vector3<f64>| {
            let mut shift = *shift;
            shift[k] -= period.copysign(point[k]);
            shift
        };
        let images: Vec<Vector3<f64>> = shifts.iter().map(image).collect();
        shifts.extend(images);
    }
    shifts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_those_near_the_cell() {
        let periods = [Some(10.0), None, Some(10.0)];
        assert_eq!(image_shifts(&periods, &Vector3::new(1.0, 9.0, -1.0), 2.0), [Vector3::zeros()]);
        let shifts = image_shifts(&periods, &Vector3::new(4.0, 9.0, -4.0), 2.0);
        let expected = [[0.0, 0.0, 0.0], [-10.0, 0.0, 0.0], [0.0, 0.0, 10.0], [-10.0, 0.0, 10.0]];
        assert_eq!(shifts, expected.map(Vector3::from));
    }
}
