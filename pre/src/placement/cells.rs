//! Neighbours of spheres of any mixture of sizes, in a time proportional to their number.

use std::ops::ControlFlow;

use nalgebra::Vector3;
use rustc_hash::FxHashMap;

/// Spheres in cubic cells: one grid for each octave of radii. Its cells are as long as the largest diameter of the
/// octave, so that a cell never contains more than a few spheres that do not overlap.
///
/// Spheres must be added by falling radius: then all spheres before one that it can touch lie in the 27 cells around it of
/// every grid.
pub struct SphereGrid {
    /// Largest radius, m.
    largest: f64,
    /// Number of octaves that have spheres.
    octaves: u32,
    /// Numbers of the spheres in each cell, by octave and position of the cell.
    cells: FxHashMap<(u32, [i64; 3]), Vec<u32>>,
    /// Centre and radius, m, of each sphere in the order of addition.
    spheres: Vec<(Vector3<f64>, f64)>,
}

impl SphereGrid {
    /// Empty grid for spheres up to the radius `largest`, m.
    pub fn new(largest: f64) -> Self {
        SphereGrid { largest, octaves: 0, cells: FxHashMap::default(), spheres: Vec::new() }
    }

    /// Position of the cell of an octave that contains a point.
    fn cell_index(&self, octave: u32, centre: &Vector3<f64>) -> [i64; 3] {
        let edge = 2.0 * self.largest * 0.5f64.powi(octave as i32);
        [0, 1, 2].map(|k| (centre[k] / edge).floor() as i64)
    }

    /// Calls `visit` with the number (in order of addition) and the overlap, m, > 0, of every sphere that overlaps the
    /// ball and is no smaller; of smaller ones, some.
    pub fn for_each_overlap(&self, centre: &Vector3<f64>, radius: f64, mut visit: impl FnMut(usize, f64)) {
        let _ = self.visit_overlaps(centre, radius, |number, overlap| {
            visit(number, overlap);
            ControlFlow::Continue(())
        });
    }

    /// Calls `visit` like [`SphereGrid::for_each_overlap`] until it breaks.
    pub fn visit_overlaps(
        &self,
        centre: &Vector3<f64>,
        radius: f64,
        mut visit: impl FnMut(usize, f64) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        for octave in 0..self.octaves {
            let cell = self.cell_index(octave, centre);
            for offset in (0..27).map(|k| [k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1]) {
                let cell = [0, 1, 2].map(|k| cell[k].saturating_add(offset[k]));
                for &number in self.cells.get(&(octave, cell)).into_iter().flatten() {
                    let (other, other_radius) = &self.spheres[number as usize];
                    let overlap = radius + other_radius - (centre - other).norm();
                    if overlap > 0.0 {
                        visit(number as usize, overlap)?;
                    }
                }
            }
        }
        ControlFlow::Continue(())
    }

    /// Whether the ball overlaps no sphere.
    pub fn is_free(&self, centre: &Vector3<f64>, radius: f64) -> bool {
        self.visit_overlaps(centre, radius, |_, _| ControlFlow::Break(())).is_continue()
    }

    /// Adds a sphere, no larger than those before it.
    pub fn add(&mut self, centre: Vector3<f64>, radius: f64) {
        assert!(self.spheres.last().is_none_or(|(_, last)| radius <= *last), "spheres must fall in radius");
        let octave = libm::floor(libm::log2(self.largest / radius).max(0.0)) as u32;
        self.octaves = self.octaves.max(octave + 1);
        let cell = self.cell_index(octave, &centre);
        self.cells.entry((octave, cell)).or_default().push(self.spheres.len() as u32);
        self.spheres.push((centre, radius));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Compares with a search of all pairs.
        #[test]
        fn finds_every_overlap(mut spheres in prop::collection::vec((prop::array::uniform3(-3.0..3.0f64), 0.01..1.0f64), 1..60)) {
            spheres.sort_by(|a, b| b.1.total_cmp(&a.1));
            let mut cells = SphereGrid::new(spheres[0].1);
            for (k, (centre, radius)) in spheres.iter().enumerate() {
                let centre = Vector3::from(*centre);
                let mut found = Vec::new();
                cells.for_each_overlap(&centre, *radius, |number, overlap| found.push((number, overlap)));
                found.sort_by_key(|pair| pair.0);
                let expected: Vec<_> = (0..k)
                    .map(|j| (j, radius + spheres[j].1 - (centre - Vector3::from(spheres[j].0)).norm()))
                    .filter(|pair| pair.1 > 0.0)
                    .collect();
                prop_assert_eq!(found, expected);
                cells.add(centre, *radius);
            }
        }
    }
}
