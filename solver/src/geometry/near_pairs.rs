//! Near pairs among spheres of any sizes, by uniform cells on several levels.
//!
//! A sphere is stored on the first level whose cells are at least as wide as the sphere. Its partners are searched in the
//! neighbouring cells of its own level and of all coarser ones. The work is proportional to the number of spheres and
//! pairs for any range of sizes. The pattern of cells repeats in space, so that a few distant spheres cost nothing; a
//! distance test removes pairs that are near only in the repeated pattern.

use std::ops::Range;

use rayon::prelude::*;

use crate::math::{Vec3, concatenated_lists, group_by_key};

/// Half of a cell's neighbours, in columns of three along the last axis: together with the cell itself and the next,
/// they give every pair of neighbouring cells once.
const FORWARD_COLUMNS: [[i64; 2]; 4] = [[1, -1], [1, 0], [1, 1], [0, 1]];

/// Spheres of like size in cells.
struct GridLevel {
    /// Inverse width of a cell, 1/m; the width is twice the greatest reach on this level.
    inverse_width: f64,
    /// Cells along each axis before the pattern repeats: 2^bits, at least 4 so that neighbours differ.
    bits: u32,
    /// Spheres sorted by cell, and within a cell by index; the spheres of cell c are `order[starts[c]..starts[c + 1]]`.
    order: Vec<u32>,
    starts: Vec<u32>,
    /// Centre and reach of each sphere of `order`.
    spheres: Vec<[f64; 4]>,
}

impl GridLevel {
    fn new(x: &[Vec3], reach: &[f64], members: &[u32]) -> Self {
        let reaches = members.par_iter().with_min_len(SPHERES_PER_TASK).map(|&i| reach[i as usize]);
        let width = 2.0 * reaches.reduce(|| 0.0, f64::max);
        // About eight cells per sphere: most cells are empty, and few contain spheres that are far apart.
        let bits = ((8 * members.len()).ilog2() / 3).clamp(2, 8);
        let mut level =
            GridLevel { inverse_width: 1.0 / width, bits, order: Vec::new(), starts: Vec::new(), spheres: Vec::new() };
        let cells: Vec<u32> = members
            .par_iter()
            .with_min_len(SPHERES_PER_TASK)
            .map(|&i| level.cell_slot(level.cell_coordinates(&x[i as usize])))
            .collect();
        (level.order, level.starts) = group_by_key(&cells, 1 << (3 * bits));
        let order = level.order.par_iter_mut().with_min_len(SPHERES_PER_TASK);
        order.for_each(|member| *member = members[*member as usize]);
        let sphere = |i: &u32| [x[*i as usize].x, x[*i as usize].y, x[*i as usize].z, reach[*i as usize]];
        level.spheres = level.order.par_iter().with_min_len(SPHERES_PER_TASK).map(sphere).collect();
        level
    }

    /// Integer coordinates of the cell of a position, in cell widths.
    fn cell_coordinates(&self, x: &Vec3) -> [i64; 3] {
        // For very distant spheres the conversion saturates and they share a cell: slow, but correct.
        [x.x, x.y, x.z].map(|c| {
            let (scaled, whole) = (c * self.inverse_width, (c * self.inverse_width) as i64);
            whole.saturating_sub((scaled < whole as f64) as i64)
        })
    }

    /// Index of a cell in `starts`: its coordinates modulo the pattern.
    fn cell_slot(&self, cell: [i64; 3]) -> u32 {
        let mask = (1 << self.bits) - 1;
        cell.iter().fold(0, |slot, c| slot << self.bits | (c & mask) as u32)
    }

    /// Calls `visit` with the ranges of `order` of the spheres in three cells along the last axis, the middle one
    /// `step` from `cell`.
    fn visit_column(&self, cell: &[i64; 3], step: [i64; 2], visit: &mut impl FnMut(Range<usize>)) {
        let middle = [cell[0].wrapping_add(step[0]), cell[1].wrapping_add(step[1]), cell[2]];
        let last_coordinate = (1 << self.bits) - 1;
        let slot = self.cell_slot(middle) as usize;
        let spheres_of = |from: usize, to: usize| self.starts[from] as usize..self.starts[to] as usize;
        // At the border of the pattern the three cells are not adjacent in memory.
        match middle[2] & last_coordinate {
            0 => {
                visit(spheres_of(slot, slot + 2));
                visit(spheres_of(slot + last_coordinate as usize, slot + last_coordinate as usize + 1));
            }
            z if z == last_coordinate => {
                visit(spheres_of(slot - 1, slot + 1));
                visit(spheres_of(slot - last_coordinate as usize, slot - last_coordinate as usize + 1));
            }
            _ => visit(spheres_of(slot - 1, slot + 2)),
        }
    }
}

/// All pairs i < j with |x_i - x_j| <= reach_i + reach_j, in an order that does not depend on threads.
///
/// Reaches are > 0, m.
pub fn near_pairs(x: &[Vec3], reach: &[f64]) -> Vec<[u32; 2]> {
    near_pairs_from(x, reach, 0..u32::MAX)
}

/// The pairs of [`near_pairs`] with i in `firsts`.
pub fn near_pairs_from(x: &[Vec3], reach: &[f64], firsts: Range<u32>) -> Vec<[u32; 2]> {
    let is_whole = firsts.start == 0 && firsts.end as usize >= x.len();
    let levels = grid_levels(x, reach);
    let mut found = Vec::new();
    for (l, level) in levels.iter().enumerate() {
        let pairs_of_chunk = |chunk: usize| {
            let range = chunk * SPHERES_PER_TASK..level.order.len().min((chunk + 1) * SPHERES_PER_TASK);
            let mut pairs = Vec::with_capacity(8 * range.len());
            for position in range {
                let (i, sphere) = (level.order[position], level.spheres[position]);
                let centre = Vec3::new(sphere[0], sphere[1], sphere[2]);
                let mut add_near = |level: &GridLevel, range: Range<usize>| {
                    for (j, other) in level.order[range.clone()].iter().zip(&level.spheres[range]) {
                        if are_near(&sphere, other) {
                            pairs.push([i.min(*j), i.max(*j)]);
                        }
                    }
                };
                let home = level.cell_coordinates(&centre);
                let slot = level.cell_slot(home) as usize;
                add_near(level, position + 1..level.starts[slot + 1] as usize);
                let next = level.cell_slot([home[0], home[1], home[2].wrapping_add(1)]) as usize;
                add_near(level, level.starts[next] as usize..level.starts[next + 1] as usize);
                FORWARD_COLUMNS
                    .iter()
                    .for_each(|step| level.visit_column(&home, *step, &mut |range| add_near(level, range)));
                for coarser in &levels[l + 1..] {
                    let home = coarser.cell_coordinates(&centre);
                    (0..9).for_each(|k| {
                        coarser.visit_column(&home, [k / 3 - 1, k % 3 - 1], &mut |range| add_near(coarser, range));
                    });
                }
            }
            if !is_whole {
                pairs.retain(|[first, _]| firsts.contains(first));
                pairs.shrink_to_fit();
            }
            pairs
        };
        let chunks = level.order.len().div_ceil(SPHERES_PER_TASK);
        found.extend((0..chunks).into_par_iter().map(pairs_of_chunk).collect::<Vec<_>>());
    }
    concatenated_lists(found)
}

/// Whether two spheres of radius reach overlap.
fn are_near(a: &[f64; 4], b: &[f64; 4]) -> bool {
    let limit = a[3] + b[3];
    (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum::<f64>() <= limit * limit
}

/// Spheres per task.
const SPHERES_PER_TASK: usize = 512;

/// Last level: no finite number is 2^2100 times as large as another.
const MAX_LEVEL: u32 = 2100;

/// Levels of the grid that have spheres, from the finest.
fn grid_levels(x: &[Vec3], reach: &[f64]) -> Vec<GridLevel> {
    let reaches = reach.par_iter().with_min_len(SPHERES_PER_TASK);
    let Some(smallest) = reaches.clone().copied().reduce_with(f64::min) else { return Vec::new() };
    // Cells grow by a factor of two; spheres of up to twice the least reach share the first level.
    let level = |&r: &f64| if r < 2.0 * smallest { 0 } else { (libm::log2(r / smallest) as u32).min(MAX_LEVEL) };
    let level_of_balls: Vec<u32> = reaches.map(level).collect();
    let count = level_of_balls.iter().max().map_or(0, |most| *most as usize + 1);
    let (members, starts) = group_by_key(&level_of_balls, count);
    let levels = starts.windows(2).map(|ends| &members[ends[0] as usize..ends[1] as usize]);
    levels.filter(|members| !members.is_empty()).map(|members| GridLevel::new(x, reach, members)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn brute(x: &[Vec3], reach: &[f64]) -> Vec<[u32; 2]> {
        let mut all = Vec::new();
        for j in 0..x.len() {
            for i in 0..j {
                if (x[i] - x[j]).norm() <= reach[i] + reach[j] {
                    all.push([i as u32, j as u32]);
                }
            }
        }
        all.sort();
        all
    }

    fn sort_pairs(mut pairs: Vec<[u32; 2]>) -> Vec<[u32; 2]> {
        pairs.sort();
        pairs
    }

    proptest! {
        #[test]
        fn finds_the_pairs_of_all_sizes_once(
            points in prop::collection::vec((-10.0..10.0f64, -10.0..10.0f64, -10.0..10.0f64, -6.0..3.0f64), 0..80),
            origin in prop::sample::select(vec![0.0, -3.0e4, 1.0e9]),
        ) {
            let x: Vec<Vec3> = points.iter().map(|p| Vec3::new(p.0 + origin, p.1, p.2)).collect();
            let reach: Vec<f64> = points.iter().map(|p| p.3.exp2()).collect();
            prop_assert_eq!(sort_pairs(near_pairs(&x, &reach)), brute(&x, &reach));
        }
    }

    #[test]
    fn touching_across_cell_borders_and_far_out() {
        let x = [Vec3::zeros(), Vec3::new(-2.0, 0.0, 0.0), Vec3::new(1e300, 0.0, 0.0), Vec3::new(-1e300, 1.0, 0.0)];
        assert_eq!(near_pairs(&x, &[1.0; 4]), vec![[0, 1]]);
        assert_eq!(near_pairs(&[], &[]), Vec::<[u32; 2]>::new());
    }
}
