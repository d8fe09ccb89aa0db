//! The contact problem laid out for sweeping: bodies in spatial order, one cache line each, half a line in scenes without
//! friction; contacts in batches that share no moving body.
//!
//! Ranges of bodies are joined two by two up to the whole: a tree. Each range has a block of the contacts inside it, each
//! joint a block of those across it, which is swept after both its sides. So the sides can be swept in parallel, and contacts
//! swept together are stored together.

use std::ops::Range;

use bytemuck::Pod;
use rayon::prelude::*;

use crate::assemble::{ContactProblem, SolverBody};
use crate::math::simd::{BodyHalfLine, BodyHalfLineF32, BodyLine, BodyLineF32, LaneFloat, SimdWidth};
use crate::math::{PAR_MIN_LEN, group_by_key};
use crate::scene::BodyId;
use crate::solve::gauss_seidel::packed::{
    BATCH_LANES, FrictionCones, NO_INDEX, PackSource, SweepSums, SweepUnits, set_lane, snap_to_cones,
};
use crate::solve::gauss_seidel::partition::{BodyPartition, MAX_COLOURS, PartitionRule, colour_pairs};
use crate::solve::gauss_seidel::rolling::RollingConstraintWide;
use crate::solve::types::ContactReactions;
use crate::state::ContactId;

const PARTITION_RULE: PartitionRule = PartitionRule { min_bodies: 1024, rounds_up: false };

/// Constant data of sixteen contacts. Unused lanes have no normal and no friction, and stay at rest.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct ContactBatch<T> {
    /// Unit normals from the antagonists to the candidates, world frame.
    pub n: [[T; BATCH_LANES]; 3],
    /// Shift along n, m/s.
    pub shift: [T; BATCH_LANES],
    /// Arm, see [`crate::assemble::ContactConstraint`].
    pub arm: [T; BATCH_LANES],
    pub friction: [T; BATCH_LANES],
    /// Lines of candidate and antagonist, counted from the first of the block.
    pub bodies: [[u32; BATCH_LANES]; 2],
}

/// One vector for each of sixteen contacts.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
pub struct BatchVectors<T>(pub [[T; BATCH_LANES]; 3]);

/// Contacts in the order in which they are swept: those inside a range of bodies, or between two groups of ranges.
#[derive(Debug, Clone, Default)]
pub struct RangeBatches<T> {
    /// Number of lines. A range has its moving bodies, then those that do not move, one for each contact with them, then one
    /// for unused lanes. Two groups have all of their lines.
    pub lines: usize,
    pub batches: Vec<ContactBatch<T>>,
    /// Index of the end of the batches of each colour.
    pub colours: Vec<usize>,
    /// r̂ of the last sweep and of the one before, N s, as world vectors. In scenes without friction the first component is
    /// r̂_n and the others are not used.
    pub r: Vec<BatchVectors<T>>,
    pub previous: Vec<BatchVectors<T>>,
    /// Shift in the tangent plane, m/s; empty if there is none.
    pub tangential_shift: Vec<BatchVectors<T>>,
    /// Rolling constraints; empty if no contact of the scene has moments, as is `curvatures`.
    pub rolls: Vec<RollingConstraintWide<T>>,
    /// 1/radius of candidate and antagonist, 1/m; 0 for a plate, whose rotation is in the shift.
    pub curvatures: Vec<[[T; BATCH_LANES]; 2]>,
    /// Row of the system, or [`NO_INDEX`].
    pub rows: Vec<[u32; BATCH_LANES]>,
    /// Friction cones to which the impulses are snapped when read back, if needed; else empty.
    pub cones: Vec<FrictionCones>,
    /// Sums of the last sweep.
    pub sums: SweepSums<T>,
}

/// Data of a body in the sweeps.
///
/// In single precision small changes of large velocities would be lost: there the stored velocity is only the change by the
/// sweeps, and each contact has the initial one.
pub trait PackedBody: Pod + Send + Sync {
    /// Type of its numbers.
    type T: LaneFloat;
    /// Whether it has the angular velocity that friction changes.
    const HAS_FRICTION: bool;
    /// Body of unused lanes: no impulse acts on it, and no division by zero occurs.
    const PADDING: Self;

    /// Packs a body of the contact problem in these units.
    fn new(record: &SolverBody, units: &SweepUnits) -> Self;
}

/// Velocity, 1/mass, R x angular velocity, R^2/inertia.
impl PackedBody for BodyLine {
    type T = f64;
    const HAS_FRICTION: bool = true;
    const PADDING: Self = BodyLine([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);

    fn new(&SolverBody { v, inverse_mass, w, inverse_inertia, radius }: &SolverBody, _: &SweepUnits) -> Self {
        let w = w * radius;
        BodyLine([v.x, v.y, v.z, inverse_mass, w.x, w.y, w.z, radius * radius * inverse_inertia])
    }
}

/// Velocity and 1/mass: spheres without friction do not turn.
impl PackedBody for BodyHalfLine {
    type T = f64;
    const HAS_FRICTION: bool = false;
    const PADDING: Self = BodyHalfLine([0.0, 0.0, 0.0, 1.0]);

    fn new(record: &SolverBody, _: &SweepUnits) -> Self {
        let SolverBody { v, inverse_mass, .. } = record;
        BodyHalfLine([v.x, v.y, v.z, *inverse_mass])
    }
}

/// As [`BodyLine`], with changes of the velocities.
impl PackedBody for BodyLineF32 {
    type T = f32;
    const HAS_FRICTION: bool = true;
    const PADDING: Self = BodyLineF32([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);

    fn new(&SolverBody { inverse_mass, inverse_inertia, radius, .. }: &SolverBody, units: &SweepUnits) -> Self {
        let mass = units.mass_unit();
        let (p, q) = ((inverse_mass * mass) as f32, (radius * radius * inverse_inertia * mass) as f32);
        BodyLineF32([0.0, 0.0, 0.0, p, 0.0, 0.0, 0.0, q])
    }
}

/// As [`BodyHalfLine`], with changes of the velocities.
impl PackedBody for BodyHalfLineF32 {
    type T = f32;
    const HAS_FRICTION: bool = false;
    const PADDING: Self = BodyHalfLineF32([0.0, 0.0, 0.0, 1.0]);

    fn new(record: &SolverBody, units: &SweepUnits) -> Self {
        BodyHalfLineF32([0.0, 0.0, 0.0, (record.inverse_mass * units.mass_unit()) as f32])
    }
}

/// Contact problem of a step in the form used by the sweeps.
pub struct DiagonalProblem<B: PackedBody> {
    pub units: SweepUnits,
    /// Every touched body, range by range.
    pub lines: Vec<B>,
    /// Bodies of the sweep before.
    pub previous: Vec<B>,
    /// Nodes of the tree in order: the block of a range, the joint to the next, the block of the next, ...
    pub blocks: Vec<RangeBatches<B::T>>,
}

impl<B: PackedBody> DiagonalProblem<B> {
    /// Packs the rows of `source`.
    pub fn new(source: &PackSource) -> Self {
        let layout = BatchLayout::new(source.problem, source.active);
        let units = SweepUnits::from_source::<B::T>(source);
        let of_body = |&body: &BodyId| B::new(&source.solver_bodies[body.index()], &units);
        let bodies = &layout.partition.bodies;
        let moving: Vec<B> = bodies.par_iter().with_min_len(PAR_MIN_LEN).map(of_body).collect();
        let mut lines = vec![B::PADDING; layout.starts[layout.starts.len() - 1] as usize];
        for (range, &start) in (0..layout.partition.range_count()).zip(&layout.starts) {
            let moving = &moving[layout.partition.ranks(range)];
            lines[start as usize..start as usize + moving.len()].copy_from_slice(moving);
        }
        let blocks: Vec<(RangeBatches<B::T>, Vec<B>)> =
            (0..layout.blocks.len() - 1).into_par_iter().map(|b| layout.pack_block(b, source, units)).collect();
        let blocks = blocks.into_iter().enumerate().map(|(b, (block, fixed))| {
            let end = layout.starts[b / 2 + 1] as usize - 1;
            lines[end - fixed.len()..end].copy_from_slice(&fixed);
            block
        });
        let blocks = blocks.collect();
        DiagonalProblem { units, previous: lines.clone(), lines, blocks }
    }

    /// Copies the impulses and moments of the swept rows into `reactions`.
    pub fn read_back_reactions(&self, width: SimdWidth, reactions: &mut ContactReactions) {
        let ContactReactions { impulses, moments } = reactions;
        let unit = self.units.impulse;
        for block in &self.blocks {
            block.rolls.iter().for_each(|rolls| rolls.read_back(moments));
            for (batch, (r, rows)) in block.r.iter().zip(&block.rows).enumerate() {
                // The order of rows differs from that in which contacts are swept.
                let later = block
                    .rows
                    .get(batch + PREFETCH_BATCHES)
                    .into_iter()
                    .flatten()
                    .filter_map(|&row| impulses.get(row as usize));
                later.for_each(|r| width.prefetch(r));
                let mut r = r.0.map(|column| column.map(|r| r.to_f64() * unit));
                match (B::HAS_FRICTION, B::T::IS_SINGLE) {
                    (true, false) => (),
                    (true, true) => snap_to_cones(width, &block.cones[batch], &mut r),
                    (false, _) => r = block.cones[batch].n.map(|n| std::array::from_fn(|lane| n[lane] * r[0][lane])),
                }
                for (lane, &row) in rows.iter().enumerate().filter(|(_, row)| **row != NO_INDEX) {
                    impulses[row as usize] = r.map(|column| column[lane]).into();
                }
            }
        }
    }
}

/// Number of batches ahead for which the rows to write are prefetched.
const PREFETCH_BATCHES: usize = 2;

/// Layout of contacts and bodies.
struct BatchLayout {
    partition: BodyPartition,
    /// Line of each rank.
    lines: Vec<u32>,
    /// First line of each range, and the number of lines.
    starts: Vec<u32>,
    /// Indices into the active rows, by block, and in spatial order within a block.
    order: Vec<u32>,
    /// Start of each block in `order`, and the end of the last.
    blocks: Vec<u32>,
}

impl BatchLayout {
    /// Divides the bodies of the rows `active` into ranges and these rows into blocks.
    fn new(problem: &ContactProblem, active: &[ContactId]) -> Self {
        let partition = BodyPartition::new(problem, active, PARTITION_RULE);
        let BodyPartition { bodies, pairs, .. } = &partition;
        let ranges = partition.range_count();
        let first: Vec<u32> = pairs.iter().map(|[a, b]| *a.min(b).min(&(bodies.len() as u32))).collect();
        let (by_rank, starts) = group_by_key(&first, bodies.len() + 1);
        // Contacts between two bodies whose motion is imposed have no solution to find.
        let by_rank = &by_rank[..starts[bodies.len()] as usize];
        // Every contact with a body that does not move has a line of its own for that body, so that
        // lines shared by many contacts do not exist.
        let mut fixed = vec![0; ranges];
        let block = |&active_index: &u32| {
            let [a, b] = pairs[active_index as usize];
            let near = partition.range_of(a.min(b));
            let far = a.max(b);
            if far == NO_INDEX {
                fixed[near as usize] += 1;
                return 2 * near;
            }
            block_index(near, partition.range_of(far))
        };
        let blocks_of: Vec<u32> = by_rank.iter().map(block).collect();
        let (mut order, blocks) = group_by_key(&blocks_of, 2 * ranges - 1);
        order.iter_mut().for_each(|index| *index = by_rank[*index as usize]);

        let mut starts = vec![0];
        let mut lines = Vec::with_capacity(bodies.len());
        for (r, fixed) in fixed.into_iter().enumerate() {
            let moving = partition.ranks(r).len() as u32;
            lines.extend(starts[r]..starts[r] + moving);
            starts.push(starts[r] + moving + fixed + 1);
        }
        BatchLayout { partition, lines, starts, order, blocks }
    }

    /// Packs a block, and the lines of the bodies in it that do not move.
    fn pack_block<B: PackedBody>(
        &self,
        block: usize,
        from: &PackSource,
        units: SweepUnits,
    ) -> (RangeBatches<B::T>, Vec<B>) {
        let (first, last) = block_ranges(block);
        let BodyPartition { pairs, cuts, .. } = &self.partition;
        let start = self.starts[first];
        let lines = self.starts[last + 1] - start;
        let of_block = &self.order[self.blocks[block] as usize..self.blocks[block + 1] as usize];
        let (mut rows, colours) = batches_by_colour(of_block, pairs, cuts[first] as usize..cuts[last + 1] as usize);
        let zero = B::T::default();
        let empty = ContactBatch {
            n: [[zero; BATCH_LANES]; 3],
            shift: [zero; BATCH_LANES],
            arm: [zero; BATCH_LANES],
            friction: [zero; BATCH_LANES],
            bodies: [[lines - 1; BATCH_LANES]; 2],
        };
        let mut batches = vec![empty; rows.len()];
        let mut r = vec![BatchVectors::default(); rows.len()];
        let mut tangential_shift = Vec::new();
        let turning = if from.problem.rolling_constraints.is_empty() { 0 } else { rows.len() };
        let (mut rolls, mut curvatures) =
            (vec![RollingConstraintWide::NONE; turning], vec![[[zero; BATCH_LANES]; 2]; turning]);
        let mut cones = vec![FrictionCones::NONE; if B::T::IS_SINGLE || !B::HAS_FRICTION { rows.len() } else { 0 }];
        let mut fixed = Vec::new();
        let first_fixed = self.starts[first] + cuts[first + 1] - cuts[first] - start;
        for (i, ((batch, r), rows)) in batches.iter_mut().zip(&mut r).zip(&mut rows).enumerate() {
            for (lane, slot) in rows.iter_mut().enumerate().filter(|(_, slot)| **slot != NO_INDEX) {
                let active_index = *slot as usize;
                let k = from.active[active_index];
                *slot = k.0;
                let row = &from.problem.rows[k.index()];
                let n = row.normal;
                set_lane(&mut batch.n, lane, &n);
                if let Some(cones) = cones.get_mut(i) {
                    cones.set_lane(lane, row);
                }
                batch.arm[lane] = B::T::from_f64(row.arm);
                batch.friction[lane] = B::T::from_f64(row.friction);
                for (side, rank) in pairs[active_index].into_iter().enumerate() {
                    if rank != NO_INDEX {
                        batch.bodies[side][lane] = self.lines[rank as usize] - start;
                        continue;
                    }
                    // The shift of a contact with a body that does not move is a velocity of that body.
                    let sign = if side == 0 { 1.0 } else { -1.0 };
                    let record = &from.solver_bodies[row.bodies[side].index()];
                    batch.bodies[side][lane] = first_fixed + fixed.len() as u32;
                    fixed.push(B::new(&SolverBody { v: record.v + row.shift * sign, ..*record }, &units));
                }
                let moves = pairs[active_index].iter().all(|rank| *rank != NO_INDEX);
                if B::T::IS_SINGLE || moves {
                    let shift = if B::T::IS_SINGLE {
                        row.shifted_velocity(from.solver_bodies) / units.velocity
                    } else {
                        row.shift
                    };
                    let along = n.dot(&shift);
                    batch.shift[lane] = B::T::from_f64(along);
                    let tangential = shift - n * along;
                    // Larger than rounding.
                    if B::HAS_FRICTION && tangential.norm_squared() > 1e-30 * shift.norm_squared() {
                        tangential_shift.resize(colours[colours.len() - 1], BatchVectors::default());
                        set_lane(&mut tangential_shift[i].0, lane, &tangential);
                    }
                }
                if let (Some(rolls), Some(curvatures)) = (rolls.get_mut(i), curvatures.get_mut(i)) {
                    rolls.set_lane(lane, from.problem, k, &from.reactions.moments);
                    for (curvature, body) in curvatures.iter_mut().zip(row.bodies) {
                        let radius = from.solver_bodies[body.index()].radius;
                        curvature[lane] = B::T::from_f64(if radius > 0.0 { 1.0 / radius } else { 0.0 });
                    }
                }
                let impulse = &from.reactions.impulses[k.index()];
                if B::HAS_FRICTION {
                    set_lane(&mut r.0, lane, &(impulse / units.impulse));
                } else {
                    r.0[0][lane] = B::T::from_f64(n.dot(impulse) / units.impulse);
                }
            }
        }
        let previous = r.clone();
        let lines = lines as usize;
        let sums = SweepSums::default();
        (
            RangeBatches {
                lines,
                batches,
                colours,
                r,
                previous,
                tangential_shift,
                rolls,
                curvatures,
                rows,
                cones,
                sums,
            },
            fixed,
        )
    }
}

/// Block of contacts between two ranges: that of the range, or of the joint above both.
fn block_index(a: u32, b: u32) -> u32 {
    match (a ^ b).checked_ilog2() {
        None => 2 * a,
        Some(level) => (a.max(b) >> level << (level + 1)) - 1,
    }
}

/// First and last range of a block.
fn block_ranges(block: usize) -> (usize, usize) {
    let side = (1 << block.trailing_ones()) - 1; // blocks before it, and behind it
    ((block - side) / 2, (block + side) / 2)
}

/// Batches of rows that share no moving body, by colour, and the end of each colour. Rows without a colour form batches of
/// one.
fn batches_by_colour(rows: &[u32], pairs: &[[u32; 2]], ranks: Range<usize>) -> (Vec<[u32; BATCH_LANES]>, Vec<usize>) {
    let colours = colour_pairs(rows.iter().map(|&row| pairs[row as usize]), ranks);
    let mut counts = [0; MAX_COLOURS + 1];
    colours.iter().for_each(|&colour| counts[colour as usize] += 1);
    let mut next = [0; MAX_COLOURS + 1];
    let mut ends = Vec::new();
    let mut batches = 0;
    for (colour, &count) in counts.iter().enumerate() {
        next[colour] = batches * BATCH_LANES;
        if colour < MAX_COLOURS {
            batches += usize::div_ceil(count, BATCH_LANES);
            ends.push(batches);
        } else {
            ends.extend(batches + 1..=batches + count);
            batches += count;
        }
    }
    let mut batched = vec![[NO_INDEX; BATCH_LANES]; batches];
    for (&row, &colour) in rows.iter().zip(&colours) {
        let slot = &mut next[colour as usize];
        batched[*slot / BATCH_LANES][*slot % BATCH_LANES] = row;
        *slot += if (colour as usize) < MAX_COLOURS { 1 } else { BATCH_LANES };
    }
    (batched, ends)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// For four ranges: blocks 0, 2, 4, 6 are theirs, 1 joins the first two, 5 the last two, 3 all.
    #[test]
    fn blocks_and_their_spans() {
        assert_eq!([0, 1, 2, 3].map(|r| block_index(r, r)), [0, 2, 4, 6]);
        assert_eq!([block_index(0, 1), block_index(3, 2), block_index(1, 2), block_index(3, 0)], [1, 5, 3, 3]);
        assert_eq!([0, 1, 2, 3, 4, 5].map(block_ranges), [(0, 0), (0, 1), (1, 1), (0, 3), (2, 2), (2, 3)]);
    }
}
