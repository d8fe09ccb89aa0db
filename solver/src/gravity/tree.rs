//! Binary tree of cells over point masses, along a Morton curve, with moments about centres of mass.

use rayon::prelude::*;

use super::cell::{CellLine, CellSummary, TreeCell};
use super::expansion::narrow_len;
use super::upward::{SubtreeOutput, UpwardPass, axis_derivatives};
use crate::math::Vec3;
use crate::math::morton::{self, MortonKey, POINTS_PER_TASK};
use crate::math::simd::F64Arithmetic;

/// Depth beyond which cells are leaves: positions differ there by less than the last digit of the cloud's size.
const MAX_TREE_DEPTH: usize = 192;

/// Summary of a cell without mass and size, far from all others.
const FAR_AWAY: CellSummary = CellSummary { centre: [64.0; 3], radius: 0.0, mass: 0.0, uneven: 0.0 };

/// Cells in the order of a depth-first walk from the root, first half before second. Lengths are divided by `length` and
/// relative to `origin`, masses divided by `mass`: numbers of order 1 in any units.
pub struct MassTree {
    /// Cells, the root first.
    pub cells: Vec<TreeCell>,
    /// [`CellSummary`] of each cell; one more, far away, pads batches.
    pub summaries: Vec<CellLine>,
    /// Narrow moments of each cell in whole lines, with its centre instead of the dipole; one cell more, as in
    /// `summaries`.
    pub moments: Vec<CellLine>,
    /// Index of the body in the input, by position in the tree.
    pub index: Vec<u32>,
    /// x, y, z, m by position in the tree, in its units.
    pub bodies: [Vec<f64>; 4],
    /// x, y, z, m in single precision, relative to the leaf's centre, with 16 more.
    pub offsets: [Vec<f32>; 4],
    /// Unit of length, m.
    pub length: f64,
    /// Unit of mass, kg.
    pub mass: f64,
}

/// Smallest power of two that is not below a positive number; 1 for other numbers.
fn power_of_two(x: f64) -> f64 {
    if x.is_normal() { 2f64.powi(libm::log2(x).ceil().clamp(-1000.0, 1000.0) as i32) } else { 1.0 }
}

/// Adds the cell of the bodies `keys` and, down to leaves of at most `leaf_size` bodies, its halves: keys are split at the
/// first bit in which they differ. `first`: position of the first of the bodies in the tree.
fn divide_cell(
    cells: &mut Vec<TreeCell>,
    keys: &mut [MortonKey],
    positions: &[Vec3],
    leaf_size: usize,
    first: usize,
    depth: usize,
) {
    let own_index = cells.len();
    cells.push(TreeCell { first: first as u32, count: keys.len() as u32, second: 0 });
    let ends = |keys: &[MortonKey]| (keys[0].key, keys[keys.len() - 1].key);
    let is_leaf = keys.len() <= leaf_size || depth == MAX_TREE_DEPTH;
    if is_leaf || (keys[0].key == ends(keys).1 && !morton::sort_keys(keys, positions)) {
        return;
    }
    let (low, high) = ends(keys);
    let bit = (low ^ high).ilog2();
    let middle = keys.partition_point(|k| k.key >> bit == low >> bit);
    let (first_half, second_half) = keys.split_at_mut(middle);
    divide_cell(cells, first_half, positions, leaf_size, first, depth + 1);
    cells[own_index].second = (cells.len() - own_index) as u32;
    divide_cell(cells, second_half, positions, leaf_size, first + middle, depth + 1);
}

impl MassTree {
    /// Builds the tree over at least one body, with leaves of at most `leaf_size` bodies (more if they coincide) and
    /// moments to order P. `known_order`: an order of the bodies that is nearly sorted, see [`morton::unsorted_keys`].
    pub fn new<L: F64Arithmetic, const P: usize>(
        lanes: L,
        positions: &[Vec3],
        masses: &[f64],
        leaf_size: usize,
        known_order: &[u32],
    ) -> Self {
        let mut keys = morton::unsorted_keys(positions.len(), known_order);
        let mut cells = Vec::new();
        divide_cell(&mut cells, &mut keys, positions, leaf_size, 0, 0);

        let (mut low, mut high) = (positions[0], positions[0]);
        for x in positions {
            low = low.inf(x);
            high = high.sup(x);
        }
        // The origin is zero if that is within the cloud: then lengths are exact, and bodies near zero remain distinct.
        let origin = low.sup(&Vec3::zeros().inf(&high));
        let (length, mass) = (power_of_two((high - low).max()), power_of_two(masses.iter().sum()));
        let (per_length, per_mass) = (1.0 / length, 1.0 / mass);
        let mut bodies = [0, 1, 2, 3].map(|_: usize| vec![0.0; positions.len()]);
        let [x, y, z, m] = &mut bodies;
        let columns = x.par_chunks_mut(POINTS_PER_TASK).zip(y.par_chunks_mut(POINTS_PER_TASK));
        let columns = columns.zip(z.par_chunks_mut(POINTS_PER_TASK).zip(m.par_chunks_mut(POINTS_PER_TASK)));
        keys.par_chunks(POINTS_PER_TASK).zip(columns).for_each(|(keys, ((x, y), (z, m)))| {
            for (k, key) in keys.iter().enumerate() {
                let point = (positions[key.index as usize] - origin) * per_length;
                (x[k], y[k], z[k], m[k]) = (point.x, point.y, point.z, masses[key.index as usize] * per_mass);
            }
        });
        let index = keys.iter().map(|key| key.index).collect();
        drop(keys);
        let lines = narrow_len(P).div_ceil(8);
        let mut moments = vec![[0.0; 8]; (cells.len() + 1) * lines];
        let mut summaries = vec![[0.0; 8]; cells.len() + 1];
        let mut offsets = [0, 1, 2, 3].map(|_: usize| vec![0.0; positions.len() + 16]);
        let padding = cells.len() * lines;
        moments[padding][1..4].copy_from_slice(&FAR_AWAY.centre);
        summaries[cells.len()] = FAR_AWAY.cell_line();
        let [x, y, z, m] = &mut offsets;
        let out = SubtreeOutput {
            summaries: &mut summaries[..cells.len()],
            moments: &mut moments[..padding],
            offsets: [x, y, z, m].map(|column: &mut Vec<f32>| &mut column[..positions.len()]),
        };
        UpwardPass::<_, P> { lanes, lines, bodies: &bodies, axes: &axis_derivatives::<P>() }.visit_subtree(&cells, out);
        MassTree { cells, summaries, moments, index, bodies, offsets, length, mass }
    }
}
