//! Division of a sweep among the ranks of a run.
//!
//! A rank sweeps a run of blocks and all border tasks with a body in one of them. A task with bodies of blocks of several
//! ranks is swept by each of these, from the same numbers: before each colour the velocities of its bodies are sent by the
//! ranks that sweep their blocks, so that no result travels back. The sums of a sweep are gathered and added in the order of
//! one rank.
//!
//! A *body* is given here by its curve index, see [`BodyPartition`].

use std::collections::BTreeSet;
use std::ops::Range;

use bytemuck::Pod;

use crate::activity;
use crate::math::simd::LaneFloat;
use crate::ranks::{
    self, Communicator, RankMessage, all_gather_counted, as_bytes, count_divided_sweep, from_bytes,
    send_receive_counted,
};
use crate::solve::gauss_seidel::packed::{BATCH_LANES, SweepSums};
use crate::solve::gauss_seidel::partition::{BodyPartition, BorderTask, SweepTasks};

/// Tasks of this rank, and the messages of a sweep.
pub struct SweepShare {
    communicator: &'static dyn Communicator,
    /// Blocks of each rank.
    blocks: Vec<Range<usize>>,
    /// Participating ranks of each border task, ascending.
    participants: Vec<Vec<u32>>,
    /// Messages before each colour.
    colours: Vec<ColourMessages>,
    /// Whether every rank gets the impulses of all; otherwise it reads those of its own tasks alone.
    pub gathers_impulses: bool,
}

/// Messages between this rank and others before a colour of borders.
#[derive(Default)]
struct ColourMessages {
    outgoing: Vec<LineMessage>,
    incoming: Vec<LineMessage>,
    /// Buffers of both.
    sent: Vec<RankMessage>,
    received: Vec<RankMessage>,
}

/// Lines of bodies that a rank sends to another.
#[derive(Debug, Clone, PartialEq)]
pub struct LineMessage {
    /// The other rank.
    pub rank: u32,
    /// Blocks of the bodies, and their indices there.
    pub lines: Vec<(u32, u32)>,
}

/// Numbers of a quartet that change in a sweep: the velocity or angular velocity.
const CHANGING_NUMBERS: usize = 3;
/// Numbers of a quartet: the line of a body has one or two, each of a velocity and a constant.
const NUMBERS_IN_QUARTET: usize = 4;

impl SweepShare {
    /// Divides tasks among the current ranks: returns them with only the constraints of this rank, and the division;
    /// `None` for one rank or one block, with all constraints. `work`: relative cost of a constraint.
    pub fn divide(
        partition: &BodyPartition,
        mut tasks: SweepTasks,
        work: impl Fn(u32) -> u64,
    ) -> (SweepTasks, Option<Self>) {
        let communicator = ranks::communicator();
        if communicator.size() == 1 || partition.block_count() == 1 {
            return (tasks, None);
        }
        let share = SweepShare::new(communicator, partition, &tasks, work);
        let own_blocks = share.own_blocks();
        let inside = tasks.blocks.iter_mut().enumerate().filter(|(block, _)| !own_blocks.contains(block));
        inside.for_each(|(_, constraints)| constraints.clear());
        let borders = tasks.borders.iter_mut().enumerate().filter(|(border, _)| !share.sweeps_border(*border));
        borders.for_each(|(_, task)| *task = BorderTask { constraints: vec![], curve_indices: vec![] });
        (tasks, Some(share))
    }

    fn new(
        communicator: &'static dyn Communicator,
        partition: &BodyPartition,
        tasks: &SweepTasks,
        work: impl Fn(u32) -> u64,
    ) -> Self {
        let blocks = cut_by_work(&block_work(partition, tasks, work), communicator.size());
        let division = BorderDivision::new(partition, tasks, &blocks);
        SweepShare::from_division(communicator, tasks, division, blocks)
    }

    /// Share of tasks of which this rank has its own alone, if each rank sweeps one of the ranges `blocks` and these
    /// `participants` sweep each border task.
    pub(super) fn of_own_tasks(
        partition: &BodyPartition,
        tasks: &SweepTasks,
        blocks: Vec<Range<usize>>,
        participants: Vec<Vec<u32>>,
    ) -> Self {
        let owners = block_owners(&blocks);
        let division = BorderDivision { partition, tasks: &tasks.borders, owners, participants };
        let share = SweepShare::from_division(ranks::communicator(), tasks, division, blocks);
        SweepShare { gathers_impulses: false, ..share }
    }

    fn from_division(
        communicator: &'static dyn Communicator,
        tasks: &SweepTasks,
        division: BorderDivision,
        blocks: Vec<Range<usize>>,
    ) -> Self {
        let partition = division.partition;
        let own_rank = communicator.rank() as u32;
        let messages_of = |borders: Range<usize>| {
            let mut messages = ColourMessages::default();
            for SentBody { body, owner, receiver } in division.sent_bodies(borders) {
                let line = partition.position(body);
                if receiver == own_rank {
                    add_line(&mut messages.incoming, owner, line);
                } else if owner == own_rank {
                    add_line(&mut messages.outgoing, receiver, line);
                }
            }
            messages
        };
        let colours = tasks.colour_ranges().map(messages_of).collect();
        SweepShare { communicator, participants: division.participants, blocks, colours, gathers_impulses: true }
    }

    /// Blocks of this rank.
    pub fn own_blocks(&self) -> Range<usize> {
        self.blocks[self.communicator.rank()].clone()
    }

    /// Whether this rank sweeps a border task.
    pub fn sweeps_border(&self, border: usize) -> bool {
        self.participants[border].contains(&(self.communicator.rank() as u32))
    }

    /// Replaces, in `blocks`, the velocities of bodies of other ranks that the borders of a colour need. A block is a
    /// list of lines, one a body, each of quartets of numbers `T`.
    pub fn exchange_lines<N: Pod, T: Pod>(&mut self, colour: usize, blocks: &mut [impl AsMut<[N]>]) {
        let ColourMessages { outgoing, incoming, sent, received } = &mut self.colours[colour];
        if outgoing.is_empty() && incoming.is_empty() {
            return;
        }
        let line_bytes = size_of::<N>() / NUMBERS_IN_QUARTET * CHANGING_NUMBERS;
        if sent.len() + received.len() == 0 {
            let buffer = |message: &LineMessage| RankMessage {
                rank: message.rank as usize,
                bytes: vec![0; message.lines.len() * line_bytes],
            };
            (*sent, *received) = (outgoing.iter().map(buffer).collect(), incoming.iter().map(buffer).collect());
        }
        let quartet_bytes = NUMBERS_IN_QUARTET * size_of::<T>();
        let changing_bytes = CHANGING_NUMBERS * size_of::<T>();
        for (message, buffer) in outgoing.iter().zip(&mut *sent) {
            for (&(block, index), to) in message.lines.iter().zip(buffer.bytes.chunks_exact_mut(line_bytes)) {
                let line = bytemuck::bytes_of(&blocks[block as usize].as_mut()[index as usize]);
                for (from, to) in line.chunks_exact(quartet_bytes).zip(to.chunks_exact_mut(changing_bytes)) {
                    to.copy_from_slice(&from[..changing_bytes]);
                }
            }
        }
        send_receive_counted(self.communicator, sent, received);
        for (message, buffer) in incoming.iter().zip(&*received) {
            for (&(block, index), from) in message.lines.iter().zip(buffer.bytes.chunks_exact(line_bytes)) {
                let line = bytemuck::bytes_of_mut(&mut blocks[block as usize].as_mut()[index as usize]);
                for (from, to) in from.chunks_exact(changing_bytes).zip(line.chunks_exact_mut(quartet_bytes)) {
                    to[..changing_bytes].copy_from_slice(from);
                }
            }
        }
    }

    /// Replaces the sums of the tasks that other ranks sweep, and stops all ranks if one of them was requested to stop.
    /// `blocks` and `borders`: sums of all tasks, of which this rank has set its own.
    pub fn gather_sums<T: LaneFloat>(&self, blocks: &mut [&mut SweepSums<T>], borders: &mut [&mut SweepSums<T>]) {
        count_divided_sweep();
        let own_rank = self.communicator.rank();
        let mut bytes = Vec::new();
        let mut add = |sums: &SweepSums<T>| {
            bytes.extend_from_slice(as_bytes(&sums.restart_product));
            bytes.extend_from_slice(as_bytes(&sums.change2));
        };
        blocks[self.blocks[own_rank].clone()].iter().for_each(|sums| add(sums));
        self.reported_borders(own_rank).for_each(|border| add(borders[border]));
        bytes.push(u8::from(activity::is_stop_requested()));
        let task_bytes = 2 * BATCH_LANES * size_of::<T>();
        let tasks = |rank: usize| self.blocks[rank].len() + self.reported_borders(rank).count();
        let lengths: Vec<usize> = (0..self.communicator.size()).map(|rank| tasks(rank) * task_bytes + 1).collect();
        let all = all_gather_counted(self.communicator, &bytes, &lengths);
        let mut unread = &all[..];
        for rank in 0..self.communicator.size() {
            let mut read_sums = |sums: &mut SweepSums<T>| {
                let (first, later) = unread.split_at(task_bytes);
                let numbers: Vec<T> = from_bytes(first);
                sums.restart_product.copy_from_slice(&numbers[..BATCH_LANES]);
                sums.change2.copy_from_slice(&numbers[BATCH_LANES..]);
                unread = later;
            };
            blocks[self.blocks[rank].clone()].iter_mut().for_each(|sums| read_sums(sums));
            self.reported_borders(rank).for_each(|border| read_sums(borders[border]));
            if unread[0] != 0 {
                activity::agree_to_stop();
            }
            unread = &unread[1..];
        }
    }

    /// Border tasks whose sums and impulses a rank reports to the others: the border tasks of which it is the first participant.
    pub fn reported_borders(&self, rank: usize) -> impl Iterator<Item = usize> + '_ {
        let is_first = move |(_, participants): &(usize, &Vec<u32>)| participants.first() == Some(&(rank as u32));
        self.participants.iter().enumerate().filter(is_first).map(|(border, _)| border)
    }

    /// Number of this rank.
    pub fn rank(&self) -> usize {
        self.communicator.rank()
    }

    /// Gathers vectors with their indices from all ranks; calls `set` with each, in the order of the ranks.
    pub fn gather_vectors(&self, own: &[(u32, [f64; 3])], mut set: impl FnMut(usize, [f64; 3])) {
        let indices: Vec<u32> = own.iter().map(|(index, _)| *index).collect();
        let vectors: Vec<[f64; 3]> = own.iter().map(|(_, vector)| *vector).collect();
        let all = ranks::all_gather_unsized(self.communicator, &[as_bytes(&indices), as_bytes(&vectors)].concat());
        for bytes in all {
            // Indices take 4 of the 28 bytes of an item.
            let (indices, vectors) = bytes.split_at(bytes.len() / 7);
            let vectors: Vec<[f64; 3]> = from_bytes(vectors);
            from_bytes::<u32>(indices).into_iter().zip(vectors).for_each(|(index, vector)| set(index as usize, vector));
        }
    }
}

/// Adds a line to the message of a rank.
fn add_line(messages: &mut Vec<LineMessage>, rank: u32, line: (u32, u32)) {
    match messages.iter_mut().find(|message| message.rank == rank) {
        Some(message) => message.lines.push(line),
        None => messages.push(LineMessage { rank, lines: vec![line] }),
    }
}

/// Relative cost of a sweep by block, in halves: a constraint between two blocks counts half in each.
pub fn block_work(partition: &BodyPartition, tasks: &SweepTasks, work: impl Fn(u32) -> u64) -> Vec<u64> {
    let inside_work = |constraints: &Vec<u32>| 2 * constraints.iter().map(|&k| work(k)).sum::<u64>();
    let mut block_work: Vec<u64> = tasks.blocks.iter().map(inside_work).collect();
    for task in &tasks.borders {
        let task_work: u64 = task.constraints.iter().map(|&k| work(k)).sum();
        // Bodies of a border task have about the same number of constraints in it.
        let work_per_body = 2 * task_work / task.curve_indices.len().max(1) as u64;
        task.curve_indices.iter().for_each(|&body| block_work[partition.position(body).0 as usize] += work_per_body);
    }
    block_work
}

/// Cuts a list into at most `parts` runs whose largest sum of `work` is as small as possible; runs at the end may be empty.
///
/// ```
/// # use cd_solve::solve::gauss_seidel::shares::cut_by_work;
/// assert_eq!(cut_by_work(&[3, 1, 1, 4, 2], 3), [0..3, 3..4, 4..5]);
/// assert_eq!(cut_by_work(&[1, 1], 3), [0..1, 1..2, 2..2]);
/// ```
pub fn cut_by_work(work: &[u64], parts: usize) -> Vec<Range<usize>> {
    let runs = |capacity: u64| {
        let (mut runs, mut first, mut sum) = (Vec::new(), 0, 0u64);
        for (k, &item_work) in work.iter().enumerate() {
            if k > first && sum + item_work > capacity {
                runs.push(first..k);
                (first, sum) = (k, 0);
            }
            sum += item_work;
        }
        runs.push(first..work.len());
        runs
    };
    let (mut too_small, mut large_enough) = (0, work.iter().sum::<u64>());
    while too_small + 1 < large_enough {
        let middle = too_small + (large_enough - too_small) / 2;
        let fits = runs(middle).len() <= parts && work.iter().all(|&item_work| item_work <= middle);
        if fits {
            large_enough = middle;
        } else {
            too_small = middle;
        }
    }
    let mut cut = runs(large_enough);
    cut.resize(parts, work.len()..work.len());
    cut
}

/// Rank of each block, if each rank has one of the ranges `blocks`.
pub(super) fn block_owners(blocks: &[Range<usize>]) -> Vec<u32> {
    (0..).zip(blocks).flat_map(|(rank, blocks)| blocks.clone().map(move |_| rank)).collect()
}

/// Ranks that sweep each border task, and the bodies that they send each other.
struct BorderDivision<'a> {
    partition: &'a BodyPartition,
    tasks: &'a [BorderTask],
    /// Rank that sweeps each block.
    owners: Vec<u32>,
    /// Ranks that sweep each task, ascending: those that sweep the blocks of its bodies.
    participants: Vec<Vec<u32>>,
}

/// A body whose velocities one rank sends to another before a colour.
struct SentBody {
    body: u32,
    /// Rank that sweeps the block of the body.
    owner: u32,
    receiver: u32,
}

impl<'a> BorderDivision<'a> {
    /// Division if each rank sweeps one of the ranges `blocks`.
    fn new(partition: &'a BodyPartition, tasks: &'a SweepTasks, blocks: &[Range<usize>]) -> Self {
        let owners = block_owners(blocks);
        let mut division = BorderDivision { partition, tasks: &tasks.borders, owners, participants: Vec::new() };
        let ranks_of = |task: &BorderTask| {
            let mut ranks: Vec<u32> = task.curve_indices.iter().map(|&body| division.owner(body)).collect();
            // Bodies, and so their blocks and the ranks of these, ascend.
            ranks.dedup();
            ranks
        };
        division.participants = tasks.borders.iter().map(ranks_of).collect();
        division
    }

    /// Rank that sweeps the block of a body.
    fn owner(&self, body: u32) -> u32 {
        self.owners[self.partition.position(body).0 as usize]
    }

    /// Bodies that the ranks send each other before they sweep these tasks: the bodies of each task, from the rank that sweeps
    /// the block of the body to the other ranks that sweep the task.
    fn sent_bodies(&self, tasks: Range<usize>) -> impl Iterator<Item = SentBody> {
        let shared = tasks.filter(|&task| self.participants[task].len() > 1);
        let bodies = shared.flat_map(|task| self.tasks[task].curve_indices.iter().map(move |&body| (task, body)));
        bodies.flat_map(|(task, body)| {
            let owner = self.owner(body);
            let receivers = self.participants[task].iter().filter(move |&&rank| rank != owner);
            receivers.map(move |&receiver| SentBody { body, owner, receiver })
        })
    }
}

/// Division of the tasks of a sweep among a number of ranks, by counts.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DivisionCounts {
    pub blocks: usize,
    pub colours: usize,
    /// Number of tasks, whose sums are gathered.
    pub tasks: usize,
    /// Work of a sweep on one rank.
    pub whole_work: u64,
    /// Work of each rank; the sum exceeds `whole_work`, since several ranks sweep the borders between them.
    pub work: Vec<u64>,
    /// Messages that each rank sends in a sweep.
    pub messages: Vec<u64>,
    /// Lines of bodies in the messages of each rank.
    pub lines: Vec<u64>,
    /// Ranks to which each rank sends messages.
    pub neighbours: Vec<u64>,
    /// Bodies of other ranks with which each rank sweeps borders.
    pub ghosts: Vec<u64>,
    /// Number of bodies that are sent to other ranks.
    pub border_bodies: u64,
}

impl DivisionCounts {
    /// Counts of the division of these tasks among `ranks`. `work`: relative cost of a constraint.
    pub fn new(partition: &BodyPartition, tasks: &SweepTasks, work: impl Fn(u32) -> u64, ranks: usize) -> Self {
        let blocks = cut_by_work(&block_work(partition, tasks, &work), ranks);
        let division = BorderDivision::new(partition, tasks, &blocks);
        let task_work = |constraints: &Vec<u32>| constraints.iter().map(|&k| work(k)).sum::<u64>();
        let inside_work = |blocks: &Range<usize>| tasks.blocks[blocks.clone()].iter().map(task_work).sum();
        let mut counts = DivisionCounts {
            blocks: partition.block_count(),
            colours: tasks.colours.len(),
            tasks: tasks.blocks.len() + tasks.borders.len(),
            whole_work: tasks
                .blocks
                .iter()
                .chain(tasks.borders.iter().map(|task| &task.constraints))
                .map(task_work)
                .sum(),
            work: blocks.iter().map(inside_work).collect(),
            messages: vec![0; ranks],
            lines: vec![0; ranks],
            neighbours: vec![0; ranks],
            ghosts: vec![0; ranks],
            border_bodies: 0,
        };
        for (participants, task) in division.participants.iter().zip(&tasks.borders) {
            participants.iter().for_each(|&rank| counts.work[rank as usize] += task_work(&task.constraints));
        }
        let (mut neighbours, mut ghosts, mut sent) = (BTreeSet::new(), BTreeSet::new(), BTreeSet::new());
        for borders in tasks.colour_ranges() {
            let mut pairs = BTreeSet::new();
            for SentBody { body, owner, receiver } in division.sent_bodies(borders) {
                counts.lines[owner as usize] += 1;
                pairs.insert((owner, receiver));
                ghosts.insert((receiver, body));
                sent.insert(body);
            }
            pairs.iter().for_each(|(owner, _)| counts.messages[*owner as usize] += 1);
            neighbours.extend(pairs);
        }
        neighbours.iter().for_each(|(owner, _)| counts.neighbours[*owner as usize] += 1);
        ghosts.iter().for_each(|(rank, _)| counts.ghosts[*rank as usize] += 1);
        counts.border_bodies = sent.len() as u64;
        counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_have_the_smallest_largest_work() {
        let work: Vec<u64> = (0..16).map(|k| 100 + (k * 37) % 50).collect();
        for parts in [1, 2, 3, 5, 16, 20] {
            let cut = cut_by_work(&work, parts);
            let ends: Vec<usize> = cut.iter().map(|run| run.end).collect();
            assert!(cut.len() == parts && cut[0].start == 0 && ends[parts - 1] == work.len());
            assert!(cut.windows(2).all(|pair| pair[0].end == pair[1].start));
            let of_run = |run: &Range<usize>| work[run.clone()].iter().sum::<u64>();
            let largest = cut.iter().map(of_run).max().unwrap();
            // No cut is better than the mean or than the largest block, and blocks are at most 149.
            let mean = work.iter().sum::<u64>().div_ceil(parts as u64);
            assert!(largest >= mean && largest <= mean + 149, "{largest} {mean}");
        }
        assert_eq!(cut_by_work(&[], 2), [0..0, 0..0]);
    }
}
