//! Bodies in blocks with the constraints inside and between them, and the order in which a sweep solves these.
//!
//! All blocks are swept in parallel, then the borders, colour by colour, those of a colour in parallel. A border task copies
//! the bodies that it needs from their blocks, sweeps, and copies them back.

use std::mem;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use bytemuck::Pod;
use rayon::prelude::*;

use crate::math::simd::LaneFloat;
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::solve::gauss_seidel::packed::{BATCH_LANES, LaneRows, NO_INDEX, SweepSums};
use crate::solve::gauss_seidel::partition::BodyPartition;
use crate::solve::gauss_seidel::shares::SweepShare;

/// Packed bodies in blocks, and groups of constraints of type `G`. A line, of type `N`, has the numbers of one body.
pub struct BlockedProblem<N, G, T> {
    blocks: Vec<BodyBlock<N, G, T>>,
    /// Tasks of the borders, colour by colour.
    borders: Vec<BlockBorders<N, G, T>>,
    /// End of each colour in `borders`.
    colours: Vec<usize>,
    /// Group of each row of the system, in the upper half of the number, and its lane among all of the group; [`NO_SLOT`]
    /// for rows that are not swept.
    slots: Vec<AtomicU64>,
    /// Tasks of this rank, if others sweep the rest.
    pub share: Option<SweepShare>,
}

/// Slot of a row that is not swept.
const NO_SLOT: u64 = u64::MAX;

/// A group of constraints in batches.
pub trait ConstraintGroup: Send + Sync {
    /// Rows of the system in the lanes of each batch.
    fn rows(&self) -> &[LaneRows];
}

/// A block of bodies and the constraints inside it.
pub struct BodyBlock<N, G, T> {
    /// Moving bodies, those that do not move, one for each constraint with them, and one for unused lanes. At most one task
    /// of a colour uses a block, so no task waits for the lock.
    lines: Mutex<Vec<N>>,
    /// Lines after the sweep before, from which momentum is computed.
    previous: Vec<N>,
    /// Constraints between bodies of the block, or with bodies that do not move.
    constraints: G,
    /// Sums of the last sweep.
    sums: SweepSums<T>,
}

/// Constraints between blocks that one task sweeps.
pub struct BlockBorders<N, G, T> {
    bodies: BorderBodies,
    /// Copies of the lines of these bodies, and one for unused lanes.
    lines: Vec<N>,
    /// Constraints between bodies of different blocks.
    constraints: G,
    /// Sums of the last sweep.
    sums: SweepSums<T>,
}

/// Bodies of several blocks with constraints between them.
pub struct BorderBodies {
    /// Each block, with the end of its bodies in `bodies`.
    blocks: Vec<(u32, usize)>,
    /// Indices of the bodies in their blocks.
    bodies: Vec<u32>,
}

/// Operations of a sweep on the lines of bodies and on a group of constraints.
pub trait SweepOperations<N, G, T>: Sync {
    /// Replaces `lines`, those before the last sweep, by the lines from which the next sweep starts; `last`: those
    /// after the last sweep.
    fn apply_momentum(&self, lines: &mut [N], last: &[N]);

    /// Sweeps a group of constraints of the bodies in `lines`.
    fn sweep_group(&self, lines: &mut [N], group: &mut G) -> SweepSums<T>;
}

impl<N: Pod + Send + Sync, G: ConstraintGroup, T: LaneFloat> BlockedProblem<N, G, T> {
    /// Blocks and borders, with the end of each colour of these, for a system of `rows` rows. Tasks outside of `share` are
    /// without constraints.
    pub fn new(
        blocks: Vec<BodyBlock<N, G, T>>,
        borders: Vec<BlockBorders<N, G, T>>,
        colours: Vec<usize>,
        rows: usize,
        share: Option<SweepShare>,
    ) -> Self {
        let slots = (0..rows).into_par_iter().with_min_len(PAR_MIN_LEN).map(|_| AtomicU64::new(NO_SLOT)).collect();
        let problem = BlockedProblem { blocks, borders, colours, slots, share };
        let groups: Vec<(u64, &G)> = (0..).zip(problem.groups()).collect();
        groups.into_par_iter().with_max_len(1).for_each(|(group, group_constraints)| {
            for (lane, &row) in (0..).zip(group_constraints.rows().as_flattened()).filter(|(_, row)| **row != NO_INDEX)
            {
                problem.slots[row as usize].store(group << u32::BITS | lane, Ordering::Relaxed);
            }
        });
        problem
    }

    /// Sweeps all constraints once, and returns the sums of the sweep, added block by block, then border by border.
    pub fn sweep_once(&mut self, operations: &impl SweepOperations<N, G, T>) -> SweepSums<T> {
        let BlockedProblem { blocks, borders, colours, share, .. } = self;
        let own_blocks = share.as_ref().map_or(0..blocks.len(), SweepShare::own_blocks);
        blocks[own_blocks].par_iter_mut().with_max_len(1).for_each(|block| {
            let lines = block.lines.get_mut().unwrap_or_else(PoisonError::into_inner);
            mem::swap(lines, &mut block.previous);
            operations.apply_momentum(lines, &block.previous);
            block.sums = operations.sweep_group(lines, &mut block.constraints);
        });
        let mut first = 0;
        for (colour, &end) in colours.iter().enumerate() {
            if let Some(share) = share {
                share.exchange_lines::<N, T>(colour, blocks);
            }
            borders[first..end].par_iter_mut().with_max_len(1).for_each(|border| {
                let BlockBorders { bodies, lines, constraints, sums } = border;
                bodies.copy_lines(blocks, |lines_of_block, indices, range| {
                    for (to, &body) in lines[range].iter_mut().zip(indices) {
                        *to = lines_of_block[body as usize];
                    }
                });
                *sums = operations.sweep_group(lines, constraints);
                bodies.copy_lines(blocks, |lines_of_block, indices, range| {
                    for (from, &body) in lines[range].iter().zip(indices) {
                        lines_of_block[body as usize] = *from;
                    }
                });
            });
            first = end;
        }
        if let Some(share) = share {
            let mut block_sums: Vec<_> = blocks.iter_mut().map(|block| &mut block.sums).collect();
            let mut border_sums: Vec<_> = borders.iter_mut().map(|border| &mut border.sums).collect();
            share.gather_sums(&mut block_sums, &mut border_sums);
        }
        let mut sums = SweepSums::default();
        blocks.iter().for_each(|block| sums.accumulate(&block.sums));
        borders.iter().for_each(|border| sums.accumulate(&border.sums));
        sums
    }

    /// Copies the impulses of the swept rows into `impulses`; `group_impulses` returns those of the batches of a
    /// group, world frame.
    ///
    /// Without a division among ranks, or with one of the contacts, the rows are set in parallel, each from its slot. With one
    /// of the sweeps alone, most groups are empty on this rank, and each rank sends the impulses of the groups that it
    /// reports, with their rows, to all.
    pub fn read_back(
        &self,
        impulses: &mut [Vec3],
        group_impulses: impl Fn(&G) -> Vec<[[f64; BATCH_LANES]; 3]> + Send + Sync,
    ) {
        if let Some(share) = self.share.as_ref().filter(|share| share.gathers_impulses) {
            let groups: Vec<&G> = self.reported_groups(share).collect();
            let group_impulses = |group: &&G| {
                let batch_impulses = group_impulses(group);
                let lanes = group.rows().iter().zip(&batch_impulses).flat_map(|(rows, batch)| {
                    rows.iter().enumerate().map(|(lane, &row)| (row, batch.map(|column| column[lane])))
                });
                lanes.filter(|(row, _)| *row != NO_INDEX).collect::<Vec<_>>()
            };
            let own: Vec<(u32, [f64; 3])> = groups.par_iter().with_max_len(1).flat_map_iter(group_impulses).collect();
            share.gather_vectors(&own, |row, impulse| impulses[row] = Vec3::from(impulse));
            return;
        }
        let groups: Vec<&G> = self.groups().collect();
        let groups: Vec<_> = groups.into_par_iter().with_max_len(1).map(group_impulses).collect();
        let copy = |(impulse, slot): (&mut Vec3, &AtomicU64)| {
            let slot = slot.load(Ordering::Relaxed);
            if slot != NO_SLOT {
                let (group, lane) = ((slot >> u32::BITS) as usize, slot as u32 as usize);
                let [x, y, z]: &[[f64; BATCH_LANES]; 3] = &groups[group][lane / BATCH_LANES];
                let lane = lane % BATCH_LANES;
                *impulse = Vec3::new(x[lane], y[lane], z[lane]);
            }
        };
        impulses.par_iter_mut().zip(&self.slots).with_min_len(PAR_MIN_LEN).for_each(copy);
    }

    /// Copies moments into `moments`; `group_moments` returns the moments of a group with their indices.
    pub fn read_back_moments<'a, I: Iterator<Item = (u32, [f64; 3])>>(
        &'a self,
        moments: &mut [Vec3],
        group_moments: impl Fn(&'a G) -> I,
    ) {
        if moments.is_empty() {
            return;
        }
        let mut set_moment = |index: usize, moment: [f64; 3]| moments[index] = Vec3::from(moment);
        match &self.share {
            Some(share) => {
                let own: Vec<(u32, [f64; 3])> = self.reported_groups(share).flat_map(group_moments).collect();
                share.gather_vectors(&own, set_moment);
            }
            None => {
                self.groups().flat_map(group_moments).for_each(|(index, moment)| set_moment(index as usize, moment))
            }
        }
    }

    /// Groups of constraints whose impulses this rank reports to the others.
    pub fn reported_groups(&self, share: &SweepShare) -> impl Iterator<Item = &G> {
        let inside = self.blocks[share.own_blocks()].iter().map(|block| &block.constraints);
        let borders: Vec<usize> = share.reported_borders(share.rank()).collect();
        inside.chain(borders.into_iter().map(|border| &self.borders[border].constraints))
    }

    /// All groups of constraints.
    pub fn groups(&self) -> impl Iterator<Item = &G> {
        let inside = self.blocks.iter().map(|block| &block.constraints);
        inside.chain(self.borders.iter().map(|border| &border.constraints))
    }
}

impl<N, G, T> AsMut<[N]> for BodyBlock<N, G, T> {
    /// Lines of the bodies.
    fn as_mut(&mut self) -> &mut [N] {
        self.lines.get_mut().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<N: Clone, G, T: LaneFloat> BodyBlock<N, G, T> {
    /// A block with these lines.
    pub fn new(lines: Vec<N>, constraints: G) -> Self {
        BodyBlock { previous: lines.clone(), lines: Mutex::new(lines), constraints, sums: SweepSums::default() }
    }
}

impl<N: Clone, G, T: LaneFloat> BlockBorders<N, G, T> {
    /// A task for the `constraints` of the bodies with these curve indices, ascending; `padding` is the line of
    /// unused lanes.
    pub fn new(partition: &BodyPartition, curve_indices: &[u32], padding: N, constraints: G) -> Self {
        let bodies = BorderBodies::new(partition, curve_indices);
        BlockBorders { bodies, lines: vec![padding; curve_indices.len() + 1], constraints, sums: SweepSums::default() }
    }
}

impl BorderBodies {
    fn new(partition: &BodyPartition, curve_indices: &[u32]) -> Self {
        let (mut blocks, mut bodies) = (Vec::<(u32, usize)>::new(), Vec::with_capacity(curve_indices.len()));
        for &curve_index in curve_indices {
            let (block, body) = partition.position(curve_index);
            bodies.push(body);
            match blocks.last_mut() {
                Some((last, end)) if *last == block => *end = bodies.len(),
                _ => blocks.push((block, bodies.len())),
            }
        }
        BorderBodies { blocks, bodies }
    }

    /// Calls `copy` with the lines of each block, the indices of its bodies, and their range among all of these.
    fn copy_lines<N, G, T>(
        &self,
        blocks: &[BodyBlock<N, G, T>],
        mut copy: impl FnMut(&mut [N], &[u32], std::ops::Range<usize>),
    ) {
        let mut first = 0;
        for &(block, end) in &self.blocks {
            let mut lines: MutexGuard<Vec<N>> =
                blocks[block as usize].lines.lock().unwrap_or_else(PoisonError::into_inner);
            copy(&mut lines, &self.bodies[first..end], first..end);
            first = end;
        }
    }
}
