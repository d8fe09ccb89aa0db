//! Division of the rows of a contact problem of spheres and plates among ranks that each have a part of the list of contacts.
//!
//! A row is a contact of the problem; packed for sweeps it is a constraint. [`partition`](super::partition) describes blocks
//! (runs of moving bodies along Morton's curve), borders (constraints between two blocks), colours, and curve indices of
//! bodies.
//!
//! The parts of the ranks, one after the other, are the list of one rank; a rank *lists* the rows of its part. For the sweeps
//! each row is sent to the ranks that sweep it: the rank of its block, or all ranks with a block of its border task. They
//! sweep and evaluate the rows as one rank would, in the order of the list, and the first of them returns the result of a row
//! to the rank that lists it. Blocks, borders and colours are those of all rows: ranks gather which bodies are touched, which
//! blocks the bodies at borders reach, and the number of constraints of each border.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::atomic::Ordering;

use bytemuck::Pod;

use crate::assemble::{ConstraintMessage, ContactConstraint, ContactProblem};
use crate::math::Vec3;
use crate::ranks::lists::{all_gather_lists, all_gather_values, any_rank, exchange_known_lists, exchange_lists};
use crate::ranks::{all_gather_counted, as_bytes, communicator, from_bytes};
use crate::scene::BodyId;
use crate::solve::gauss_seidel::packed::NO_INDEX;
use crate::solve::gauss_seidel::partition::{
    BlockNumber, BodyPartition, BorderPlan, BorderSize, BorderTask, ConstraintIndex, CurveIndex, SweepTasks,
    reaches_many_blocks, set_curve_indices,
};
use crate::solve::gauss_seidel::shares::{SweepShare, block_owners, cut_by_work};
use crate::state::ContactId;

/// Rows that this rank sweeps, and those that it lists.
pub struct RowDivision {
    /// Blocks of the bodies of all ranks, with the curve indices of the rows that this rank sweeps.
    pub partition: BodyPartition,
    /// Indices of the rows that this rank sweeps, in the order of their constraints in the packed problem.
    pub order: Vec<u32>,
    /// Tasks of all ranks, of which this rank has the constraints of its own.
    pub tasks: SweepTasks,
    /// Whether any row of any rank has friction.
    pub has_friction: bool,
    /// Number of active rows of all ranks.
    pub active_count: usize,
    /// Index, among the active rows of all ranks, of each row that this rank sweeps, ascending.
    pub active_indices: Vec<u32>,
    /// Index, in the contact problem of all ranks, of each active row that this rank lists.
    pub listed_rows: Vec<u32>,
    /// Blocks of each rank.
    blocks: Vec<Range<usize>>,
    /// Ranks that sweep each border task, ascending.
    participants: Vec<Vec<u32>>,
    /// Rows that this rank sweeps and whose results it returns, by the rank that lists them.
    returned: Vec<Vec<u32>>,
    /// Positions of the active rows that this rank lists, by the rank that returns their results.
    list_positions: Vec<Vec<u32>>,
}

/// Task that sweeps a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum RowTask {
    /// No body of the row moves: the row is evaluated but not swept.
    Fixed,
    /// Inside this block.
    Inside(BlockNumber),
    /// Between these blocks, in order.
    Border([BlockNumber; 2]),
    /// Between these blocks, with a large body, which reaches many blocks: swept in the last task.
    Large([BlockNumber; 2]),
}

impl RowTask {
    /// Kind of the task, its two blocks, and `count`, as ranks exchange them.
    fn to_words(self, count: u32) -> [u32; 4] {
        match self {
            RowTask::Fixed => [0, 0, 0, count],
            RowTask::Inside(block) => [1, block, block, count],
            RowTask::Border([a, b]) => [2, a, b, count],
            RowTask::Large([a, b]) => [3, a, b, count],
        }
    }

    /// Inverse of [`Self::to_words`].
    fn from_words([kind, a, b, count]: [u32; 4]) -> (Self, u32) {
        let task = match kind {
            0 => RowTask::Fixed,
            1 => RowTask::Inside(a),
            2 => RowTask::Border([a, b]),
            _ => RowTask::Large([a, b]),
        };
        (task, count)
    }
}

/// Ranks that sweep each task.
struct TaskRanks {
    /// Rank of each block.
    owners: Vec<u32>,
    /// Index of the task of each border.
    task_of_border: BTreeMap<[BlockNumber; 2], usize>,
    /// Ranks that sweep each border task, ascending.
    participants: Vec<Vec<u32>>,
}

impl TaskRanks {
    /// Ranks that sweep a row, ascending. Rows without a moving body are evaluated by rank 0.
    fn of_row(&self, task: RowTask) -> &[u32] {
        match task {
            RowTask::Fixed => &[0],
            RowTask::Inside(block) => std::slice::from_ref(&self.owners[block as usize]),
            RowTask::Border(blocks) => &self.participants[self.task_of_border[&blocks]],
            RowTask::Large(_) => &self.participants[self.participants.len() - 1],
        }
    }

    /// Whether `rank` sweeps each border task.
    fn swept_border_tasks(&self, rank: usize) -> Vec<bool> {
        self.participants.iter().map(|ranks| ranks.contains(&(rank as u32))).collect()
    }
}

impl RowDivision {
    /// Division of the rows `active` of all ranks, with the rows that this rank sweeps; these start from the impulses
    /// (world frame, N s) in their `warm_start`.
    ///
    /// * `active`: rows of `problem`, which this rank lists, sorted.
    /// * `impulses`: impulses of the rows of `problem`.
    /// * `min_bodies`: smallest number of bodies in a block.
    pub fn new(
        problem: &ContactProblem,
        active: &[ContactId],
        impulses: &[Vec3],
        min_bodies: usize,
    ) -> (Self, Vec<ContactConstraint>) {
        let (rank, size) = (communicator().rank(), communicator().size());
        let count_before = |own: usize| all_gather_values(own as u64)[..rank].iter().sum::<u64>() as u32;
        let (first_row, first_active) = (count_before(problem.rows.len()), count_before(active.len()));
        let mut partition = common_partition(problem, active, min_bodies);
        let classify_row = row_classifier(&partition);
        let tasks_of_rows = |partition: &BodyPartition| -> Vec<RowTask> {
            let blocks = partition.block_pairs(&partition.pairs);
            partition.pairs.iter().zip(&blocks).map(|(pair, blocks)| classify_row(pair, *blocks)).collect()
        };
        let listed_tasks = tasks_of_rows(&partition);
        let counts = task_counts(&listed_tasks);
        let borders: Vec<BorderSize> = counts
            .iter()
            .filter_map(|(task, &count)| match *task {
                RowTask::Border(blocks) => Some(BorderSize { blocks, constraints: count as usize }),
                _ => None,
            })
            .collect();
        let large: usize = counts
            .iter()
            .filter_map(|(task, &count)| matches!(task, RowTask::Large(_)).then_some(count as usize))
            .sum();
        let plan = BorderPlan::new(&borders, large, partition.block_count());
        let blocks = cut_by_work(&block_work(&counts, partition.block_count()), size);
        let ranks = task_ranks(&plan, &borders, &counts, block_owners(&blocks));

        let (mut outgoing, mut list_positions) = (vec![Vec::new(); size], vec![Vec::new(); size]);
        for ((position, &k), &task) in (0u32..).zip(active).zip(&listed_tasks) {
            let row = ContactConstraint { warm_start: impulses[k.index()], ..problem.rows[k.index()] };
            let message = ConstraintMessage::new(&row, first_active + position);
            let sweeping = ranks.of_row(task);
            sweeping.iter().for_each(|&to| outgoing[to as usize].push(message));
            list_positions[sweeping[0] as usize].push(position);
        }
        let incoming = exchange_lists(outgoing);
        let source_ranks: Vec<usize> =
            incoming.iter().enumerate().flat_map(|(from, list)| std::iter::repeat_n(from, list.len())).collect();
        let active_indices: Vec<u32> = incoming.iter().flatten().map(|message| message.index).collect();
        let rows: Vec<ContactConstraint> = incoming.into_iter().flatten().map(ContactConstraint::from).collect();

        let mut pairs: Vec<[u32; 2]> = rows.iter().map(|row| row.bodies.map(|body| body.0)).collect();
        set_curve_indices(&partition.bodies, problem.bodies.len(), &mut pairs);
        partition.pairs = pairs;
        let swept_tasks = tasks_of_rows(&partition);
        let mut returned = vec![Vec::new(); size];
        for (row, (&task, &from)) in (0..).zip(swept_tasks.iter().zip(&source_ranks)) {
            if ranks.of_row(task)[0] as usize == rank {
                returned[from].push(row);
            }
        }
        let order = partition.spatial_order();
        let tasks = sweep_tasks(&partition, &order, &swept_tasks, plan, &borders, ranks.swept_border_tasks(rank));
        let has_friction = any_rank(active.iter().any(|&k| problem.rows[k.index()].friction > 0.0));
        let active_count = all_gather_values(active.len() as u64).iter().sum::<u64>() as usize;
        let listed_rows = active.iter().map(|k| first_row + k.0).collect();
        let participants = ranks.participants;
        let division = RowDivision {
            partition,
            order,
            tasks,
            has_friction,
            active_count,
            active_indices,
            listed_rows,
            blocks,
            participants,
            returned,
            list_positions,
        };
        (division, rows)
    }

    /// Tasks of this rank and the messages between them, for a problem that has been packed again.
    pub fn sweep_share(&self) -> SweepShare {
        SweepShare::of_own_tasks(&self.partition, &self.tasks, self.blocks.clone(), self.participants.clone())
    }

    /// Values of the active rows that this rank lists, in their order; `value`: value of a row that this rank sweeps.
    pub fn listed_values<T: Pod>(&self, value: impl Fn(usize) -> T) -> Vec<T> {
        let values = |rows: &Vec<u32>| rows.iter().map(|&row| value(row as usize)).collect();
        let counts: Vec<usize> = self.list_positions.iter().map(Vec::len).collect();
        let lists = exchange_known_lists(self.returned.iter().map(values).collect(), &counts);
        let mut listed_values = vec![T::zeroed(); self.listed_rows.len()];
        for (positions, list) in self.list_positions.iter().zip(lists) {
            positions.iter().zip(list).for_each(|(&position, value)| listed_values[position as usize] = value);
        }
        listed_values
    }

    /// Values of all bodies of the partition, in its order; `value`: value of a body in a block of this rank.
    pub fn body_values<T: Pod>(&self, value: impl Fn(BodyId) -> T) -> Vec<T> {
        let bodies = |blocks: &Range<usize>| -> Range<usize> {
            if blocks.is_empty() {
                return 0..0;
            }
            let [first, last] = [blocks.start, blocks.end - 1].map(|block| self.partition.curve_range(block));
            first.start as usize..last.end as usize
        };
        let own = &self.partition.bodies[bodies(&self.blocks[communicator().rank()])];
        let own: Vec<T> = own.iter().map(|&body| value(body)).collect();
        let lengths: Vec<usize> = self.blocks.iter().map(|blocks| bodies(blocks).len() * size_of::<T>()).collect();
        from_bytes(&all_gather_counted(communicator(), as_bytes(&own), &lengths))
    }
}

/// Blocks of the moving bodies that the active rows of any rank touch, with the curve indices of those of this rank.
fn common_partition(problem: &ContactProblem, active: &[ContactId], min_bodies: usize) -> BodyPartition {
    let pairs: Vec<[u32; 2]> = active.iter().map(|k| problem.rows[k.index()].bodies.map(|body| body.0)).collect();
    let mut own_bits = vec![0u64; problem.bodies.len().div_ceil(u64::BITS as usize)];
    let bit_position = |body: u32| ((body / u64::BITS) as usize, 1u64 << (body % u64::BITS));
    for &body in pairs.as_flattened() {
        let (word, bit) = bit_position(body);
        own_bits[word] |= bit;
    }
    let mut bits = vec![0u64; own_bits.len()];
    for list in all_gather_lists(&own_bits) {
        bits.iter_mut().zip(list).for_each(|(bits, others)| *bits |= others);
    }
    let is_touched = |body: &BodyId| {
        let (word, bit) = bit_position(body.0);
        bits[word] & bit != 0
    };
    BodyPartition::of_touched_bodies(problem, pairs, is_touched, min_bodies)
}

/// Returns a function that returns the task of a row, from the curve indices of its bodies and their blocks. Gathers the
/// blocks that the bodies reach by the rows of all ranks.
fn row_classifier(partition: &BodyPartition) -> impl Fn(&[CurveIndex; 2], [BlockNumber; 2]) -> RowTask + use<> {
    let blocks = partition.block_pairs(&partition.pairs);
    let own_reached = partition.reached_blocks(&partition.pairs, &blocks);
    let mut reached: Vec<u64> = own_reached.into_iter().map(|blocks| blocks.load(Ordering::Relaxed)).collect();
    let at_borders: Vec<[u64; 2]> =
        (0..).zip(&reached).filter(|(_, blocks)| **blocks > 0).map(|(body, blocks)| [body, *blocks]).collect();
    for [body, blocks] in all_gather_lists(&at_borders).into_iter().flatten() {
        reached[body as usize] |= blocks;
    }
    move |curve_indices: &[CurveIndex; 2], [a, b]: [BlockNumber; 2]| match a.min(b) {
        NO_INDEX => RowTask::Fixed,
        block if a == b => RowTask::Inside(block),
        _ if curve_indices.iter().any(|&body| reaches_many_blocks(reached[body as usize])) => {
            RowTask::Large([a.min(b), a.max(b)])
        }
        _ => RowTask::Border([a.min(b), a.max(b)]),
    }
}

/// Number of rows of all ranks with each task.
fn task_counts(own_tasks: &[RowTask]) -> BTreeMap<RowTask, u32> {
    let mut own_counts = BTreeMap::new();
    own_tasks.iter().for_each(|&task| *own_counts.entry(task).or_insert(0) += 1);
    let words: Vec<[u32; 4]> = own_counts.into_iter().map(|(task, count)| task.to_words(count)).collect();
    let mut counts = BTreeMap::new();
    for (task, count) in all_gather_lists(&words).into_iter().flatten().map(RowTask::from_words) {
        *counts.entry(task).or_insert(0) += count;
    }
    counts
}

/// Relative cost of a sweep by block, in halves: a constraint between two blocks counts half in each.
fn block_work(counts: &BTreeMap<RowTask, u32>, blocks: usize) -> Vec<u64> {
    let mut work = vec![0; blocks];
    for (task, &count) in counts {
        match *task {
            RowTask::Fixed => {}
            RowTask::Inside(block) => work[block as usize] += 2 * u64::from(count),
            RowTask::Border(pair) | RowTask::Large(pair) => {
                pair.iter().for_each(|&block| work[block as usize] += u64::from(count));
            }
        }
    }
    work
}

/// Ranks of the tasks of a plan; `owners`: rank of each block.
fn task_ranks(
    plan: &BorderPlan,
    borders: &[BorderSize],
    counts: &BTreeMap<RowTask, u32>,
    owners: Vec<u32>,
) -> TaskRanks {
    let mut task_of_border = BTreeMap::new();
    let mut ranks = vec![BTreeSet::new(); plan.tasks.len()];
    for (task, borders_of_task) in plan.tasks.iter().enumerate() {
        for &border in borders_of_task {
            let blocks = borders[border as usize].blocks;
            task_of_border.insert(blocks, task);
            ranks[task].extend(blocks.map(|block| owners[block as usize]));
        }
    }
    for task in counts.keys() {
        if let (RowTask::Large(blocks), Some(last)) = (task, ranks.last_mut()) {
            last.extend(blocks.map(|block| owners[block as usize]));
        }
    }
    let participants = ranks.into_iter().map(|ranks| ranks.into_iter().collect()).collect();
    TaskRanks { owners, task_of_border, participants }
}

/// Tasks of all ranks, with the constraints of those that this rank sweeps.
///
/// * `order`: rows that this rank sweeps, in the order of their constraints; `swept_tasks`: task of each of these rows.
/// * `sweeps_border`: whether this rank sweeps each border task of `plan`.
fn sweep_tasks(
    partition: &BodyPartition,
    order: &[u32],
    swept_tasks: &[RowTask],
    plan: BorderPlan,
    borders: &[BorderSize],
    sweeps_border: Vec<bool>,
) -> SweepTasks {
    let pairs: Vec<[u32; 2]> = order.iter().map(|&row| partition.pairs[row as usize]).collect();
    let mut blocks = vec![Vec::new(); partition.block_count()];
    let (mut border_constraints, mut large) = (BTreeMap::<[BlockNumber; 2], Vec<ConstraintIndex>>::new(), Vec::new());
    for (constraint, &row) in (0..).zip(order) {
        match swept_tasks[row as usize] {
            RowTask::Fixed => {}
            RowTask::Inside(block) => blocks[block as usize].push(constraint),
            RowTask::Border(blocks) => border_constraints.entry(blocks).or_default().push(constraint),
            RowTask::Large(_) => large.push(constraint),
        }
    }
    let task_count = plan.tasks.len();
    let border_task = |(task, borders_of_task): (usize, &Vec<u32>)| {
        if !sweeps_border[task] {
            return BorderTask { constraints: Vec::new(), curve_indices: Vec::new() };
        }
        let constraints_of = |&border: &u32| border_constraints.get(&borders[border as usize].blocks);
        let mut constraints: Vec<ConstraintIndex> =
            borders_of_task.iter().filter_map(constraints_of).flatten().copied().collect();
        if task + 1 == task_count {
            constraints.extend_from_slice(&large);
        }
        BorderTask::new(constraints, &pairs)
    };
    let borders = plan.tasks.iter().enumerate().map(border_task).collect();
    SweepTasks { blocks, borders, colours: plan.colours }
}
