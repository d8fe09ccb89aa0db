//! Division of a contact problem for parallel sweeps: bodies into blocks, constraints into tasks.
//!
//! A block is a run of bodies along Morton's curve. The constraints inside a block are one task; those between two blocks
//! are their border. Borders are coloured so that those of one colour share no block: a colour is swept in parallel, after
//! the blocks and the colours before it. Constraints of a body that touches many blocks are swept last. All depends on the
//! problem alone, so that no number of threads changes a result.

use std::mem;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

use rayon::prelude::*;

use crate::assemble::ContactProblem;
use crate::math::{PAR_MIN_LEN, group_by_key};
use crate::scene::BodyId;
use crate::solve::gauss_seidel::packed::NO_INDEX;
use crate::state::ContactId;

/// Number of blocks up to which these may be small: as many threads have work then. Larger blocks have fewer constraints
/// between them, which leave lanes of vectors empty: 20 000 rocks have 9 % fewer batches in 16 blocks than in 32.
pub const SMALL_BLOCKS: usize = 16;

/// Largest number of blocks that the constraints of a body may reach from its own. Eight blocks meet at a corner. A body that
/// reaches more, such as a plate, would give its block as many borders, which would be swept one after the other.
const MAX_REACHED_BLOCKS: u32 = 8;

/// Borders of a colour are put together until a task has this number of constraints: tasks with fewer would leave lanes of
/// their vectors empty and wait for each other more than they work.
const MIN_TASK_CONSTRAINTS: usize = 64;

/// Position of a moving body along the curve, its index in [`BodyPartition::bodies`]; [`NO_INDEX`] for a body that does not
/// move.
pub type CurveIndex = u32;

/// Number of a block of bodies; [`NO_INDEX`] for a body that does not move.
pub type BlockNumber = u32;

/// Index of a constraint among those of a sweep.
pub type ConstraintIndex = u32;

/// Moving bodies of some rows in spatial order, divided into blocks of almost equal size. The number of blocks is a power of
/// two.
#[derive(Debug, Clone)]
pub struct BodyPartition {
    /// Moving bodies; the index of a body here is its curve index.
    pub bodies: Vec<BodyId>,
    /// Curve indices of the bodies of each row, [`NO_INDEX`] for a body that does not move.
    pub pairs: Vec<[CurveIndex; 2]>,
    /// First curve index of each block, and the number of bodies.
    cuts: Vec<CurveIndex>,
    /// Block of each curve index.
    blocks: Vec<BlockNumber>,
}

/// Constraints of a sweep by task.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepTasks {
    /// Indices of the constraints inside each block, ascending.
    pub blocks: Vec<Vec<ConstraintIndex>>,
    /// Constraints between blocks, colour by colour.
    pub borders: Vec<BorderTask>,
    /// End of each colour in `borders`. The tasks of a colour share no block.
    pub colours: Vec<usize>,
}

/// Constraints between blocks that one task sweeps.
#[derive(Debug, Clone, PartialEq)]
pub struct BorderTask {
    /// Indices of the constraints, border by border.
    pub constraints: Vec<ConstraintIndex>,
    /// Curve indices of their bodies, ascending.
    pub curve_indices: Vec<CurveIndex>,
}

/// Moving bodies of a group of constraints, which index them.
#[derive(Debug, Clone)]
pub enum GroupBodies<'a> {
    /// Curve indices of a block.
    Block(Range<CurveIndex>),
    /// Curve indices of a [`BorderTask`].
    Border(&'a [CurveIndex]),
}

/// The constraints between two blocks.
struct BlockBorder {
    blocks: [BlockNumber; 2],
    constraints: Vec<ConstraintIndex>,
}

impl BodyPartition {
    /// Divides the moving bodies of the rows `active` into blocks of `min_bodies` or more, twice as many in more than
    /// [`SMALL_BLOCKS`] blocks; fewer bodies are one block.
    pub fn new(problem: &ContactProblem, active: &[ContactId], min_bodies: usize) -> Self {
        let bodies_of = |&k: &ContactId| problem.rows[k.index()].bodies.map(|body| body.0);
        let pairs: Vec<[u32; 2]> = active.par_iter().with_min_len(PAR_MIN_LEN).map(bodies_of).collect();
        let touched: Vec<AtomicBool> = problem.bodies.iter().map(|_| AtomicBool::new(false)).collect();
        pairs.as_flattened().par_iter().with_min_len(PAR_MIN_LEN).for_each(|&body| {
            touched[body as usize].store(true, Ordering::Relaxed);
        });
        Self::of_touched_bodies(problem, pairs, |body| touched[body.index()].load(Ordering::Relaxed), min_bodies)
    }

    /// Division of the moving bodies for which `is_touched` holds; `pairs`: bodies of rows.
    pub(super) fn of_touched_bodies(
        problem: &ContactProblem,
        mut pairs: Vec<[u32; 2]>,
        is_touched: impl Fn(&BodyId) -> bool + Sync,
        min_bodies: usize,
    ) -> Self {
        let is_moving = |body: &BodyId| is_touched(body) && problem.bodies[body.index()].inverse_mass > 0.0;
        let bodies: Vec<BodyId> =
            problem.order.par_iter().copied().map(BodyId).with_min_len(PAR_MIN_LEN).filter(is_moving).collect();
        set_curve_indices(&bodies, problem.bodies.len(), &mut pairs);

        let blocks_of = |bodies_in_block: usize| bodies.len() / bodies_in_block;
        let count = blocks_of(min_bodies).min(SMALL_BLOCKS).max(blocks_of(min_bodies.saturating_mul(2)));
        let count = 1 << count.max(1).ilog2();
        let cuts: Vec<u32> = (0..=count).map(|block| (block * bodies.len() / count) as u32).collect();
        let mut blocks = vec![0; bodies.len()];
        for block in 0..count {
            blocks[cuts[block] as usize..cuts[block + 1] as usize].fill(block as u32);
        }
        BodyPartition { bodies, pairs, cuts, blocks }
    }

    /// Number of blocks.
    pub fn block_count(&self) -> usize {
        self.cuts.len() - 1
    }

    /// Curve indices of the bodies in a block.
    pub fn curve_range(&self, block: usize) -> Range<CurveIndex> {
        self.cuts[block]..self.cuts[block + 1]
    }

    /// Bodies of a block.
    pub fn bodies_of(&self, block: usize) -> &[BodyId] {
        &self.bodies[self.cuts[block] as usize..self.cuts[block + 1] as usize]
    }

    /// Block of the body with this curve index, and its index in the block.
    pub fn position(&self, curve_index: CurveIndex) -> (BlockNumber, u32) {
        let block = self.blocks[curve_index as usize];
        (block, curve_index - self.cuts[block as usize])
    }

    /// Indices into the rows, in the order of the first of their bodies, without rows of two bodies that do not move.
    pub fn spatial_order(&self) -> Vec<u32> {
        let BodyPartition { bodies, pairs, .. } = self;
        let lower_body = |[a, b]: &[u32; 2]| *a.min(b).min(&(bodies.len() as u32));
        let first: Vec<u32> = pairs.par_iter().with_min_len(PAR_MIN_LEN).map(lower_body).collect();
        let (mut order, starts) = group_by_key(&first, bodies.len() + 1);
        order.truncate(starts[bodies.len()] as usize);
        order
    }

    /// Returns the tasks over which constraints are distributed; `pairs`: curve indices of the bodies of each. Constraints of
    /// two bodies that do not move are left out: they have no solution to find.
    pub fn sweep_tasks(&self, pairs: &[[CurveIndex; 2]]) -> SweepTasks {
        let count = self.block_count();
        let blocks = self.block_pairs(pairs);
        let reached = self.reached_blocks(pairs, &blocks);
        let is_large =
            |&curve_index: &CurveIndex| reaches_many_blocks(reached[curve_index as usize].load(Ordering::Relaxed));
        // Constraints inside a block, then constraints of its borders with later blocks, then constraints that are swept last.
        let group = |(pair, &[a, b]): (&[CurveIndex; 2], &[BlockNumber; 2])| match a.min(b) {
            NO_INDEX => 2 * count as u32 + 1,
            block if a == b => block,
            _ if pair.iter().any(is_large) => 2 * count as u32,
            block => count as u32 + block,
        };
        let groups: Vec<u32> = pairs.par_iter().zip(&blocks).with_min_len(PAR_MIN_LEN).map(group).collect();
        let (order, starts) = group_by_key(&groups, 2 * count + 2);
        let members = |group: usize| &order[starts[group] as usize..starts[group + 1] as usize];
        let borders = (0..count).into_par_iter().with_max_len(1).flat_map_iter(|block| {
            let mut later = members(count + block).to_vec();
            let key = |&k: &u32| blocks[k as usize].into_iter().max();
            later.sort_by_key(key);
            let border = |constraints: &[ConstraintIndex]| {
                let [a, b] = blocks[constraints[0] as usize];
                BlockBorder { blocks: [a.min(b), a.max(b)], constraints: constraints.to_vec() }
            };
            later.chunk_by(|a, b| key(a) == key(b)).map(border).collect::<Vec<_>>()
        });
        let borders: Vec<BlockBorder> = borders.collect();
        let large = members(2 * count);
        let sizes: Vec<BorderSize> = borders
            .iter()
            .map(|border| BorderSize { blocks: border.blocks, constraints: border.constraints.len() })
            .collect();
        let BorderPlan { tasks, colours } = BorderPlan::new(&sizes, large.len(), count);
        let task_count = tasks.len();
        let constraints_of = |(task, borders_of_task): (usize, Vec<u32>)| {
            let borders = borders_of_task.iter().map(|&border| &borders[border as usize].constraints[..]);
            borders.chain((task + 1 == task_count).then_some(large)).collect::<Vec<_>>().concat()
        };
        let constraints: Vec<Vec<ConstraintIndex>> = tasks.into_iter().enumerate().map(constraints_of).collect();
        SweepTasks {
            blocks: (0..count).into_par_iter().map(|block| members(block).to_vec()).collect(),
            borders: constraints.into_par_iter().map(|constraints| BorderTask::new(constraints, pairs)).collect(),
            colours,
        }
    }

    /// Blocks of the bodies of each pair of curve indices; a body that does not move is in the block of the other.
    pub(super) fn block_pairs(&self, pairs: &[[CurveIndex; 2]]) -> Vec<[BlockNumber; 2]> {
        let block_of = |curve_index: CurveIndex| self.blocks.get(curve_index as usize).map_or(NO_INDEX, |&block| block);
        let blocks_of = |&[a, b]: &[CurveIndex; 2]| {
            [a, b].map(|curve_index| block_of(if curve_index == NO_INDEX { a.min(b) } else { curve_index }))
        };
        pairs.par_iter().with_min_len(PAR_MIN_LEN).map(blocks_of).collect()
    }

    /// Blocks, by bits for their number modulo 64, that each body reaches by the pairs with these `blocks`; empty for one
    /// block.
    pub(super) fn reached_blocks(&self, pairs: &[[CurveIndex; 2]], blocks: &[[BlockNumber; 2]]) -> Vec<AtomicU64> {
        let moving = 0..if self.block_count() > 1 { self.bodies.len() } else { 0 };
        let reached: Vec<AtomicU64> = moving.map(|_| AtomicU64::new(0)).collect();
        pairs.par_iter().zip(blocks).with_min_len(PAR_MIN_LEN).filter(|(_, [a, b])| a != b).for_each(
            |(pair, blocks)| {
                for side in 0..2 {
                    reached[pair[side] as usize].fetch_or(1 << (blocks[1 - side] % u64::BITS), Ordering::Relaxed);
                }
            },
        );
        reached
    }
}

/// Whether these are so many blocks that the body is swept last.
pub(super) fn reaches_many_blocks(reached: u64) -> bool {
    reached.count_ones() > MAX_REACHED_BLOCKS
}

/// Replaces the bodies of pairs by their curve indices, [`NO_INDEX`] for bodies that are not in `bodies`; `count`: number of
/// all bodies.
pub(super) fn set_curve_indices(bodies: &[BodyId], count: usize, pairs: &mut [[u32; 2]]) {
    let curve_indices: Vec<AtomicU32> = (0..count).map(|_| AtomicU32::new(NO_INDEX)).collect();
    bodies.par_iter().enumerate().with_min_len(PAR_MIN_LEN).for_each(|(curve_index, body)| {
        curve_indices[body.index()].store(curve_index as u32, Ordering::Relaxed);
    });
    let curve_index_of = |body: u32| curve_indices[body as usize].load(Ordering::Relaxed);
    pairs.par_iter_mut().with_min_len(PAR_MIN_LEN).for_each(|pair| *pair = pair.map(curve_index_of));
}

/// Two blocks with constraints between them.
pub(super) struct BorderSize {
    pub blocks: [u32; 2],
    /// Number of constraints.
    pub constraints: usize,
}

/// Borders of each task, and the colours of these.
pub(super) struct BorderPlan {
    /// Indices of the borders of each task, in the order in which they are swept. Constraints of large bodies, if there are
    /// any, follow those of the last task.
    pub tasks: Vec<Vec<u32>>,
    /// End of each colour in `tasks`.
    pub colours: Vec<usize>,
}

impl BorderPlan {
    /// Tasks of `borders`, ordered by their blocks, and of `large` constraints of large bodies; `blocks`: number of blocks.
    pub(super) fn new(borders: &[BorderSize], large: usize, blocks: usize) -> Self {
        let (mut by_colour, mut last) = colour_borders(borders, blocks);
        let size = |border: u32| borders[border as usize].constraints;
        // A colour of one task is swept last with others of this kind: nothing is swept in parallel with it.
        let is_small =
            |colour: &Vec<u32>| colour.iter().map(|&border| size(border)).sum::<usize>() < 2 * MIN_TASK_CONSTRAINTS;
        last.extend(by_colour.extract_if(.., |colour| is_small(colour)).flatten());
        let (mut tasks, mut colours) = (Vec::new(), Vec::new());
        for colour in by_colour {
            let (mut task, mut constraints) = (Vec::new(), 0);
            for border in colour {
                task.push(border);
                constraints += size(border);
                if constraints >= MIN_TASK_CONSTRAINTS {
                    tasks.push(mem::take(&mut task));
                    constraints = 0;
                }
            }
            tasks.extend((!task.is_empty()).then_some(task));
            colours.push(tasks.len());
        }
        if !last.is_empty() || large > 0 {
            tasks.push(last);
            colours.push(tasks.len());
        }
        BorderPlan { tasks, colours }
    }
}

impl SweepTasks {
    /// Tasks of each colour, as a range of `borders`.
    pub fn colour_ranges(&self) -> impl Iterator<Item = Range<usize>> {
        let starts = [0].into_iter().chain(self.colours.iter().copied());
        starts.zip(&self.colours).map(|(start, &end)| start..end)
    }
}

impl GroupBodies<'_> {
    /// Number of bodies.
    pub fn count(&self) -> usize {
        match self {
            GroupBodies::Block(curve_indices) => curve_indices.len(),
            GroupBodies::Border(curve_indices) => curve_indices.len(),
        }
    }

    /// Index in the group of its body with this curve index; [`NO_INDEX`] for a body that does not move.
    pub fn index_of(&self, curve_index: CurveIndex) -> u32 {
        match self {
            _ if curve_index == NO_INDEX => NO_INDEX,
            GroupBodies::Block(curve_indices) => curve_index - curve_indices.start,
            GroupBodies::Border(curve_indices) => {
                curve_indices.binary_search(&curve_index).map_or(NO_INDEX, |index| index as u32)
            }
        }
    }
}

impl BorderTask {
    pub(super) fn new(constraints: Vec<ConstraintIndex>, pairs: &[[CurveIndex; 2]]) -> Self {
        let mut curve_indices: Vec<CurveIndex> = constraints.iter().flat_map(|&k| pairs[k as usize]).collect();
        curve_indices.sort_unstable();
        curve_indices.dedup();
        BorderTask { constraints, curve_indices }
    }
}

/// Number of colours; pairs for which none is free are swept one at a time.
pub const MAX_COLOURS: usize = 64;

/// Colours borders, those with the most constraints first, by the first colour that no earlier border of their blocks has,
/// and returns their indices by colour, with those for which no colour is free.
fn colour_borders(borders: &[BorderSize], blocks: usize) -> (Vec<Vec<u32>>, Vec<u32>) {
    let mut order: Vec<u32> = (0..borders.len() as u32).collect();
    order.sort_by_key(|&border| std::cmp::Reverse(borders[border as usize].constraints));
    let colours = colour_pairs(order.iter().map(|&border| borders[border as usize].blocks), blocks);
    let mut by_colour: Vec<Vec<u32>> = Vec::new();
    let mut rest = Vec::new();
    for (border, colour) in order.into_iter().zip(colours) {
        let colour = colour as usize;
        if colour == MAX_COLOURS {
            rest.push(border);
            continue;
        }
        if colour == by_colour.len() {
            by_colour.push(Vec::new());
        }
        by_colour[colour].push(border);
    }
    (by_colour, rest)
}

/// Returns the colour of each pair of indices below `count`, the first that no earlier pair of its members has, or
/// [`MAX_COLOURS`] if none is free. An index of `count` or more is a body that does not move and takes no colour.
pub fn colour_pairs(pairs: impl Iterator<Item = [u32; 2]>, count: usize) -> Vec<u8> {
    let mut masks = vec![0u64; count + 1];
    let colour = |pair: [u32; 2]| {
        let [a, b] = pair.map(|index| (index as usize).min(count));
        let free = (masks[a] | masks[b]).trailing_ones() as usize;
        if free < MAX_COLOURS {
            masks[a] |= 1 << free;
            masks[b] |= 1 << free;
            masks[count] = 0;
        }
        free as u8
    };
    pairs.map(colour).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;
    use crate::assemble::{ContactConstraint, SolverBody};
    use crate::math::Vec3;

    /// A problem of bodies of mass 1, or without limit if `is_fixed`, in this order along Morton's curve.
    fn problem(order: Vec<u32>, is_fixed: impl Fn(u32) -> bool, pairs: &[[u32; 2]]) -> ContactProblem {
        let body = |k: u32| SolverBody {
            v: Vec3::zeros(),
            inverse_mass: if is_fixed(k) { 0.0 } else { 1.0 },
            w: Vec3::zeros(),
            inverse_inertia: 0.0,
            radius: 1.0,
        };
        let row = |bodies: &[u32; 2]| ContactConstraint { bodies: bodies.map(BodyId), ..ContactConstraint::default() };
        ContactProblem {
            rows: pairs.iter().map(row).collect(),
            block_data: None,
            rolling_constraints: vec![],
            memories: vec![],
            pair_attractions: vec![],
            regularised: vec![],
            bodies: (0..order.len() as u32).map(body).collect(),
            order,
        }
    }

    /// Seven bodies, of which 3 does not move and no row touches 5, in blocks of at least two.
    #[test]
    fn blocks_have_all_moving_bodies_in_order() {
        let problem = problem(vec![6, 5, 4, 3, 2, 1, 0], |k| k == 3, &[[0, 3], [1, 6], [2, 4], [4, 5]]);
        let partition = BodyPartition::new(&problem, &[0, 1, 2].map(ContactId), 2);
        assert_eq!(partition.bodies, [6, 4, 2, 1, 0].map(BodyId));
        assert_eq!(partition.pairs, [[4, NO_INDEX], [3, 0], [2, 1]]);
        assert_eq!([partition.curve_range(0), partition.curve_range(1)], [0..2, 2..5]);
        assert_eq!([0, 2, 4].map(|curve_index| partition.position(curve_index)), [(0, 0), (1, 0), (1, 2)]);
        let tasks = partition.sweep_tasks(&partition.pairs);
        let last = BorderTask { constraints: vec![1, 2], curve_indices: vec![0, 1, 2, 3] };
        assert_eq!(tasks, SweepTasks { blocks: vec![vec![], vec![0]], borders: vec![last], colours: vec![1] });
        assert_eq!(GroupBodies::Border(&[3, 5, 8]).index_of(8), 2);
        assert_eq!(GroupBodies::Block(3..9).index_of(8), 5);
    }

    /// A cube of 24³ bodies that touch their neighbours along the axes and diagonals of faces, a ground below and a plate on
    /// top, which is free; in 64 blocks of 216 bodies.
    #[test]
    fn each_constraint_is_in_one_task_and_borders_of_a_colour_share_no_block() {
        const SIDE: u32 = 24;
        let at = |x: [u32; 3]| x[0] + SIDE * (x[1] + SIDE * x[2]);
        let (ground, plate) = (SIDE.pow(3), SIDE.pow(3) + 1);
        let mut pairs = vec![[ground, ground], [ground, plate]];
        let steps = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1]];
        let sites = || (0..SIDE.pow(3)).map(|k| [k % SIDE, k / SIDE % SIDE, k / SIDE / SIDE]);
        for x in sites() {
            for step in steps {
                let to: [u32; 3] = std::array::from_fn(|k| x[k] + step[k]);
                if to.iter().all(|&k| k < SIDE) {
                    pairs.push([at(x), at(to)]);
                }
            }
            match x[2] {
                0 => pairs.push([at(x), ground]),
                k if k == SIDE - 1 => pairs.push([plate, at(x)]),
                _ => (),
            }
        }
        let mut positions: Vec<Vec3> = sites().map(|x| Vec3::from(x.map(f64::from))).collect();
        positions.extend([Vec3::new(12.0, 12.0, -1.0), Vec3::new(12.0, 12.0, 24.0)]);
        let problem = problem(crate::math::morton::morton_order(&positions, &[]), |k| k == ground, &pairs);
        let active: Vec<ContactId> = (0..pairs.len()).map(ContactId::new).collect();
        let partition = BodyPartition::new(&problem, &active, 108);
        let curve_pairs = &partition.pairs;
        let SweepTasks { blocks, borders, colours } = partition.sweep_tasks(curve_pairs);
        assert_eq!((partition.block_count(), blocks.len()), (64, 64));

        let all = blocks.iter().flatten().chain(borders.iter().flat_map(|task| &task.constraints));
        let mut all: Vec<u32> = all.copied().collect();
        all.sort_unstable();
        assert_eq!(all, (1..pairs.len() as u32).collect::<Vec<_>>());

        let block_of = |curve_index: u32| partition.position(curve_index).0;
        for (block, constraints) in blocks.iter().enumerate() {
            let moving = constraints
                .iter()
                .flat_map(|&k| curve_pairs[k as usize])
                .filter(|&curve_index| curve_index != NO_INDEX);
            assert!(moving.map(block_of).all(|of_body| of_body == block as u32));
        }
        for task in &borders {
            assert!(task.curve_indices.is_sorted_by(|a, b| a < b));
            let members: HashSet<u32> = task.constraints.iter().flat_map(|&k| curve_pairs[k as usize]).collect();
            assert_eq!(members, task.curve_indices.iter().copied().collect());
        }
        let plate = partition.bodies.iter().position(|&body| body == BodyId(plate)).unwrap() as u32;
        let (mut first, mut widest) = (0, 0);
        for &end in &colours {
            let of_task = |task: &BorderTask| {
                task.curve_indices.iter().map(|&curve_index| block_of(curve_index)).collect::<HashSet<u32>>()
            };
            let blocks: Vec<HashSet<u32>> = borders[first..end].iter().map(of_task).collect();
            let distinct: HashSet<u32> = blocks.iter().flatten().copied().collect();
            assert_eq!(distinct.len(), blocks.iter().map(HashSet::len).sum::<usize>());
            // The plate touches sixteen blocks and is swept last.
            assert!(
                first == borders.len() - 1
                    || borders[first..end].iter().all(|task| !task.curve_indices.contains(&plate))
            );
            (first, widest) = (end, widest.max(blocks.len()));
        }
        assert_eq!(first, borders.len());
        // Half of the blocks with the other half.
        assert!(widest >= 16 && colours.len() <= 18, "{widest} {}", colours.len());
    }

    #[test]
    fn pairs_of_a_colour_share_no_moving_body() {
        let pairs = [[0, 1], [1, 2], [0, NO_INDEX], [2, NO_INDEX], [1, NO_INDEX], [0, 2]];
        assert_eq!(colour_pairs(pairs.into_iter(), 3), [0, 1, 1, 0, 2, 2]);
        // Bodies that do not move have any number of pairs, others one a colour.
        let many = colour_pairs([[0, NO_INDEX]; 70].into_iter(), 1);
        assert_eq!(many[..64], std::array::from_fn::<u8, 64, _>(|k| k as u8));
        assert_eq!(many[64..], [64; 6]);
    }
}
