//! Near pairs among spheres of any sizes, by uniform cells on several levels.
//!
//! A sphere lives on the first level whose cells are as wide as it is; it looks for partners in the
//! neighbouring cells of its own level and of all coarser ones. So the work is in proportion to the
//! number of spheres and pairs, whatever the range of sizes, and spheres far away cost nothing.

use rayon::prelude::*;
use rustc_hash::FxHashMap;

use crate::math::Vec3;

/// Half of a cell's neighbours: with the cell itself, every pair of neighbouring cells once.
const FORWARD: [[i64; 3]; 13] = [
    [1, -1, -1],
    [1, -1, 0],
    [1, -1, 1],
    [1, 0, -1],
    [1, 0, 0],
    [1, 0, 1],
    [1, 1, -1],
    [1, 1, 0],
    [1, 1, 1],
    [0, 1, -1],
    [0, 1, 0],
    [0, 1, 1],
    [0, 0, 1],
];

struct Level {
    /// Width of a cell: twice the greatest reach on this level, m.
    width: f64,
    /// Spheres by cell, and in each cell by index.
    order: Vec<u32>,
    cells: FxHashMap<[i64; 3], (u32, u32)>,
}

impl Level {
    fn cell(&self, x: &Vec3) -> [i64; 3] {
        cell(x, self.width)
    }

    fn members(&self, cell: &[i64; 3]) -> &[u32] {
        self.cells.get(cell).map_or(&[], |&(start, end)| &self.order[start as usize..end as usize])
    }
}

fn cell(x: &Vec3, width: f64) -> [i64; 3] {
    // Saturates far out, where all of a level's spheres then share a cell: slow, but right.
    [x.x, x.y, x.z].map(|c| ((c / width).floor() as i64).clamp(-(1 << 60), 1 << 60))
}

/// All pairs i < j with |x_i - x_j| <= reach_i + reach_j, in no particular order that depends on threads.
///
/// Reaches are > 0, m. Some pairs may be farther apart than that.
pub fn pairs(x: &[Vec3], reach: &[f64]) -> Vec<[u32; 2]> {
    let levels = levels(x, reach);
    let mut found = Vec::new();
    for (l, level) in levels.iter().enumerate() {
        let near = |i: u32, j: u32| (x[i as usize] - x[j as usize]).norm() <= reach[i as usize] + reach[j as usize];
        let per_sphere = level.order.par_iter().with_min_len(64).enumerate().flat_map_iter(|(place, &i)| {
            let mut partners = Vec::new();
            let mut take = |j: u32| {
                if near(i, j) {
                    partners.push([i.min(j), i.max(j)]);
                }
            };
            let home = level.cell(&x[i as usize]);
            let (_, end) = level.cells[&home];
            level.order[place + 1..end as usize].iter().for_each(|&j| take(j));
            for step in FORWARD {
                level.members(&neighbour(&home, &step)).iter().for_each(|&j| take(j));
            }
            for coarser in &levels[l + 1..] {
                let home = coarser.cell(&x[i as usize]);
                for step in cube() {
                    coarser.members(&neighbour(&home, &step)).iter().for_each(|&j| take(j));
                }
            }
            partners
        });
        found.par_extend(per_sphere);
    }
    found
}

fn neighbour(cell: &[i64; 3], step: &[i64; 3]) -> [i64; 3] {
    std::array::from_fn(|k| cell[k] + step[k])
}

fn cube() -> impl Iterator<Item = [i64; 3]> {
    (0..27).map(|k| [k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1])
}

fn levels(x: &[Vec3], reach: &[f64]) -> Vec<Level> {
    let Some(least) = reach.iter().copied().reduce(f64::min) else { return Vec::new() };
    // Cells grow by a factor of two; spheres of up to twice the least reach share the first level.
    let rank = |r: f64| (r / least).log2().floor().max(0.0) as usize;
    let mut by_rank: std::collections::BTreeMap<usize, Vec<u32>> = Default::default();
    for (i, &r) in reach.iter().enumerate() {
        by_rank.entry(rank(r)).or_default().push(i as u32);
    }
    by_rank
        .into_values()
        .map(|mut order| {
            let width = 2.0 * order.iter().map(|&i| reach[i as usize]).fold(0.0, f64::max);
            order.par_sort_by_cached_key(|&i| (cell(&x[i as usize], width), i));
            let mut cells = FxHashMap::with_capacity_and_hasher(order.len(), Default::default());
            for (place, &i) in order.iter().enumerate() {
                let place = place as u32;
                cells.entry(cell(&x[i as usize], width)).or_insert((place, place)).1 = place + 1;
            }
            Level { width, order, cells }
        })
        .collect()
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

    fn sorted(mut pairs: Vec<[u32; 2]>) -> Vec<[u32; 2]> {
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
            prop_assert_eq!(sorted(pairs(&x, &reach)), brute(&x, &reach));
        }
    }

    #[test]
    fn touching_across_cell_borders_and_far_out() {
        let x = [Vec3::zeros(), Vec3::new(-2.0, 0.0, 0.0), Vec3::new(1e300, 0.0, 0.0), Vec3::new(-1e300, 1.0, 0.0)];
        assert_eq!(pairs(&x, &[1.0; 4]), vec![[0, 1]]);
        assert_eq!(pairs(&[], &[]), Vec::<[u32; 2]>::new());
    }
}
