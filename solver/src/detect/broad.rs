//! Near pairs among spheres of any sizes, by uniform cells on several levels.
//!
//! A sphere lives on the first level whose cells are as wide as it is; it looks for partners in the
//! neighbouring cells of its own level and of all coarser ones. So the work is in proportion to the
//! number of spheres and pairs, whatever the range of sizes. Cells repeat in space like the pattern
//! of a wallpaper, so that a few far spheres cost nothing; what meets only on the pattern is told
//! apart by its distance.

use rayon::prelude::*;

use crate::math::{Vec3, group};

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

/// Spheres of like size in cells.
struct Level {
    /// Inverse width of a cell, 1/m; the width is twice the greatest reach on this level.
    inverse_width: f64,
    /// Cells along each axis before the pattern repeats: 2^bits, at least 4 so that neighbours differ.
    bits: u32,
    /// Spheres by cell, and in each cell by index; cell c holds `order[starts[c]..starts[c + 1]]`.
    order: Vec<u32>,
    starts: Vec<u32>,
}

impl Level {
    fn new(x: &[Vec3], reach: &[f64], members: &[u32]) -> Self {
        let width = 2.0 * members.iter().map(|&i| reach[i as usize]).fold(0.0, f64::max);
        // About eight cells a sphere: most are empty, and few hold what is far apart.
        let bits = (members.len().ilog2() / 3 + 2).min(8);
        let mut level = Level { inverse_width: 1.0 / width, bits, order: Vec::new(), starts: Vec::new() };
        let cells: Vec<u32> = members.iter().map(|&i| level.slot(level.cell(&x[i as usize]))).collect();
        (level.order, level.starts) = group(&cells, 1 << (3 * bits));
        level.order.iter_mut().for_each(|place| *place = members[*place as usize]);
        level
    }

    fn cell(&self, x: &Vec3) -> [i64; 3] {
        // Far out the conversion saturates, and spheres share a cell: slow, but right.
        [x.x, x.y, x.z].map(|c| (c * self.inverse_width).floor() as i64)
    }

    fn slot(&self, cell: [i64; 3]) -> u32 {
        let mask = (1 << self.bits) - 1;
        cell.iter().fold(0, |slot, c| slot << self.bits | (c & mask) as u32)
    }

    fn members(&self, cell: &[i64; 3], step: &[i64; 3]) -> &[u32] {
        let slot = self.slot(std::array::from_fn(|k| cell[k].wrapping_add(step[k]))) as usize;
        &self.order[self.starts[slot] as usize..self.starts[slot + 1] as usize]
    }
}

/// All pairs i < j with |x_i - x_j| <= reach_i + reach_j, in an order that does not depend on threads.
///
/// Reaches are > 0, m.
pub fn pairs(x: &[Vec3], reach: &[f64]) -> Vec<[u32; 2]> {
    let levels = levels(x, reach);
    let near = |i: u32, j: u32| {
        let (i, j) = (i as usize, j as usize);
        let limit = reach[i] + reach[j];
        (x[i] - x[j]).norm_squared() <= limit * limit
    };
    let mut found = Vec::new();
    for (l, level) in levels.iter().enumerate() {
        let of_chunk = |(chunk, members): (usize, &[u32])| {
            let mut pairs = Vec::with_capacity(8 * members.len());
            for (k, &i) in members.iter().enumerate() {
                let mut take = |partners: &[u32]| {
                    pairs.extend(partners.iter().filter(|&&j| near(i, j)).map(|&j| [i.min(j), i.max(j)]));
                };
                let home = level.cell(&x[i as usize]);
                let place = chunk * CHUNK + k + 1;
                take(&level.order[place..level.starts[level.slot(home) as usize + 1] as usize]);
                FORWARD.iter().for_each(|step| take(level.members(&home, step)));
                for coarser in &levels[l + 1..] {
                    let home = coarser.cell(&x[i as usize]);
                    (0..27).for_each(|k| take(coarser.members(&home, &[k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1])));
                }
            }
            pairs
        };
        found.extend(level.order.par_chunks(CHUNK).enumerate().map(of_chunk).collect::<Vec<_>>());
    }
    found.concat()
}

/// Spheres that one task looks at.
const CHUNK: usize = 512;

fn levels(x: &[Vec3], reach: &[f64]) -> Vec<Level> {
    let Some(least) = reach.iter().copied().reduce(f64::min) else { return Vec::new() };
    // Cells grow by a factor of two; spheres of up to twice the least reach share the first level.
    let mut by_rank: std::collections::BTreeMap<u32, Vec<u32>> = Default::default();
    for (i, &r) in reach.iter().enumerate() {
        let rank = if r < 2.0 * least { 0 } else { (r / least).log2() as u32 };
        by_rank.entry(rank).or_default().push(i as u32);
    }
    by_rank.into_values().map(|members| Level::new(x, reach, &members)).collect()
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
