//! The contact problem of general bodies laid out for sweeping: sixteen pairs of bodies at once. The contacts of a pair
//! follow each other, while the velocities of its bodies stay loaded.

use std::array;
use std::marker::PhantomData;
use std::ops::Range;

use rayon::prelude::*;

use crate::assemble::{BlockData, ContactProblem, SolverBody};
use crate::math::simd::{F64Arithmetic, LaneFloat, LaneOperation, SimdWidth};
use crate::math::{PAR_MIN_LEN, Vec3, run_ranges};
use crate::scene::BodyId;
use crate::solve::gauss_seidel::block::local::{BlockAxes, BodySide, block_axes, delassus_block, lever_block};
use crate::solve::gauss_seidel::blocked::{BlockBorders, BlockedProblem, BodyBlock, ConstraintGroup};
use crate::solve::gauss_seidel::packed::{
    BATCH_LANES, FrictionCones, LaneRows, NO_INDEX, PackSource, SweepUnits, load_column, load_vector, set_lane,
    snap_to_cones,
};
use crate::solve::gauss_seidel::partition::{
    BodyPartition, BorderTask, GroupBodies, MAX_COLOURS, SweepTasks, colour_pairs,
};
use crate::solve::gauss_seidel::rolling::RollingConstraintWide;
use crate::solve::gauss_seidel::shares::{DivisionCounts, SweepShare};
use crate::solve::gauss_seidel::vector::{dot_product, triple};
use crate::solve::types::ContactReactions;
use crate::state::ContactId;

/// Largest number of contacts of a pair that are solved in one batch; further ones form another batch.
const MAX_PAIR_CONTACTS: usize = 4;

/// Smallest number of points (of sixteen pairs) that a task packs.
const MIN_POINTS_PER_TASK: usize = 32;

/// Line of eight numbers of a body: its velocities or its inverse inertia, see [`BlockProblem`].
pub type BodyNumbers<T> = [T; 8];

/// Numbers of the pairs of a batch.
pub type BatchColumn<T> = [T; BATCH_LANES];

/// Batch of sixteen pairs of bodies.
#[derive(Debug, Clone)]
pub struct BodyPairBatch {
    /// Lines of candidate and antagonist in their block, or in the border of their blocks.
    pub bodies: [[u32; BATCH_LANES]; 2],
    /// First and last + 1 of its points.
    pub points: [usize; 2],
    /// Whether impulses move some of its bodies along only some of the fixed axes.
    pub has_locked_axes: bool,
    /// Whether the friction of some of its contacts has a lever.
    pub has_levers: bool,
}

/// Friction levers n×d of the contacts of a point along its two tangents, m.
pub type LeverColumns<T> = [BatchColumn<T>; 2];

/// Constant data of one contact of each pair of a batch. Unused lanes get no impulse and stay at rest.
pub trait PairContacts: Clone + Send + Sync {
    type T: LaneFloat;
    /// Data that sweeps change.
    type Impulses: Clone + Default + Send + Sync;

    /// Packs rows of the system into their lanes, with their initial impulses.
    fn pack_rows(from: &BlockSource, rows: &LaneRows) -> (Self, Self::Impulses);

    /// Friction levers of the rows in these lanes.
    fn friction_levers(&self, from: &BlockSource, rows: &LaneRows) -> LeverColumns<Self::T>;

    /// r̂ of all lanes, world frame, N s.
    fn world_impulses(&self, from: &UnpackContext, rows: &LaneRows, values: &Self::Impulses) -> [BatchColumn<f64>; 3];
}

/// Lanes that are occupied, with their rows.
fn occupied_lanes(rows: &LaneRows) -> impl Iterator<Item = (usize, usize)> + '_ {
    rows.iter().enumerate().filter(|(_, row)| **row != NO_INDEX).map(|(lane, &row)| (lane, row as usize))
}

/// Input for packing the batches.
pub struct BlockSource<'a> {
    start: PackSource<'a>,
    block_data: &'a BlockData,
    units: SweepUnits,
}

/// Context for reading back the impulses of the batches.
pub struct UnpackContext<'a> {
    problem: &'a ContactProblem,
    units: SweepUnits,
    width: SimdWidth,
}

impl BlockSource<'_> {
    /// Lines of a body, see [`BlockProblem`].
    fn body_lines<T: LaneFloat>(&self, body: BodyId) -> (BodyNumbers<T>, BodyNumbers<T>) {
        let BlockSource { start: PackSource { solver_bodies, .. }, block_data, units } = self;
        let &SolverBody { v, inverse_mass, w, .. } = &solver_bodies[body.index()];
        let (v, w) = if T::IS_SINGLE { (Vec3::zeros(), Vec3::zeros()) } else { (v, w) };
        let (free_axes, mass_unit) = (block_data.free_axes(body.index()), units.mass_unit());
        let line = [v.x, v.y, v.z, inverse_mass * mass_unit, w.x, w.y, w.z, free_axes.x];
        let m = block_data.inverse_inertia[body.index()] * mass_unit;
        let inertia = [m[(0, 0)], m[(0, 1)], m[(0, 2)], m[(1, 1)], m[(1, 2)], m[(2, 2)], free_axes.y, free_axes.z];
        (line.map(T::from_f64), inertia.map(T::from_f64))
    }

    /// û at the start of row `k`, without the changes of the velocities by sweeps, m/s.
    ///
    /// Lines in single precision contain only these changes, as those of a
    /// [`PackedBody`](crate::solve::gauss_seidel::diagonal::batches::PackedBody).
    fn starting_velocity<T: LaneFloat>(&self, k: usize) -> Vec3 {
        let PackSource { problem, solver_bodies, .. } = self.start;
        if T::IS_SINGLE { problem.shifted_velocity(k, solver_bodies) } else { problem.rows[k].shift }
    }
}

/// Contacts with friction: three unknowns.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub struct FrictionalPoint<T> {
    /// The normal and the axes of the local block, world frame.
    pub axes: [[BatchColumn<T>; 3]; 3],
    /// Vectors from the centres of candidate and antagonist to the contact point, m.
    pub arms: [[BatchColumn<T>; 3]; 2],
    /// û = u + shift, along the axes, m/s.
    pub shift: [BatchColumn<T>; 3],
    /// Numbers of [`LocalBlock`](crate::solve::gauss_seidel::block::local::LocalBlock), as the four after it.
    pub inverse_nn: BatchColumn<T>,
    pub c: [BatchColumn<T>; 2],
    pub s: [BatchColumn<T>; 2],
    pub inverse_s: [BatchColumn<T>; 2],
    /// Coefficient μ.
    pub friction: BatchColumn<T>,
    /// A third of the trace of W, 1/kg.
    pub weight: BatchColumn<T>,
}

/// r̂ of a point along its axes in this sweep and in the one before, N s, and the multiplier of its sliding divided by W_nn.
#[derive(Debug, Clone, Default)]
#[repr(align(64))]
pub struct FrictionalImpulses<T> {
    pub r: [BatchColumn<T>; 3],
    pub previous: [BatchColumn<T>; 3],
    pub multiplier: BatchColumn<T>,
}

/// Contacts without friction: one unknown. A unit impulse applies the angular impulses `arms` to the bodies and so changes
/// their angular velocities by `answers`.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub struct FrictionlessPoint<T> {
    /// Normal, world frame.
    pub normal: [BatchColumn<T>; 3],
    /// Arm of candidate and antagonist times the normal, m.
    pub arms: [[BatchColumn<T>; 3]; 2],
    /// Inverse inertia times `arms`, 1/(kg m).
    pub answers: [[BatchColumn<T>; 3]; 2],
    /// û = u + shift, along the normal, m/s.
    pub shift: BatchColumn<T>,
    /// 1/W_nn, kg.
    pub inverse_nn: BatchColumn<T>,
    /// W_nn, 1/kg.
    pub weight: BatchColumn<T>,
}

/// r̂ of a point along its normal in this sweep and in the one before, N s.
#[derive(Debug, Clone, Default)]
#[repr(align(64))]
pub struct NormalImpulses<T> {
    pub r: BatchColumn<T>,
    pub previous: BatchColumn<T>,
}

/// Batches in the order in which they are swept, with their impulses.
pub struct PairBatches<C: PairContacts> {
    pub batches: Vec<BodyPairBatch>,
    pub points: Vec<C>,
    pub impulses: Vec<C::Impulses>,
    /// Rolling constraints by point; empty if no contact of the scene has moments.
    pub rolls: Vec<RollingConstraintWide<C::T>>,
    /// Friction levers by point; empty if no friction of a batch has a lever.
    pub levers: Vec<LeverColumns<C::T>>,
    /// Rows of the system, or [`NO_INDEX`], by point.
    rows: Vec<LaneRows>,
}

/// Pairs of bodies inside a block or between blocks, with constants of the bodies' lines.
pub struct PairGroup<C: PairContacts> {
    /// Lines of inverse inertia, by the bodies' index in the block or border.
    pub inertia: Vec<BodyNumbers<C::T>>,
    pub batches: PairBatches<C>,
}

/// Contact problem of a step in the form used by the sweeps.
///
/// A body has two lines of [`BodyNumbers`], world frame:
///
/// | line | 0 to 2 | 3 | 4 to 6 | 7 |
/// |---|---|---|---|---|
/// | velocities | velocity v, m/s | 1/m, 1/kg | angular velocity w, rad/s | free axis x |
/// | inverse inertia, 1/(kg m²) | xx, xy, xz | yy | yz, zz, then free axis y | free axis z |
///
/// The free axes are 1 for an axis along which impulses move the body, else 0; they are used where bodies have
/// [locked axes](BlockData::locked_axes). In single precision v and w are the changes by the sweeps, in [`SweepUnits`].
pub struct BlockProblem<C: PairContacts> {
    pub units: SweepUnits,
    pub bodies: BlockedProblem<BodyNumbers<C::T>, PairGroup<C>, C::T>,
}

/// Contacts of two bodies: at most [`MAX_PAIR_CONTACTS`] consecutive rows.
struct PairConstraints<'a> {
    bodies: [BodyId; 2],
    rows: &'a [ContactId],
}

impl<C: PairContacts> BlockProblem<C> {
    /// Packs the rows of `source`, whose block data are `block_data`, in blocks of `min_bodies` bodies or more.
    pub fn new(source: &PackSource, block_data: &BlockData, min_bodies: usize) -> Self {
        let units = SweepUnits::from_source::<C::T>(source, false);
        let fill = BlockSource { start: *source, block_data, units };
        let partition = BodyPartition::new(source.problem, source.active, min_bodies);
        let (pairs, pair_bodies) = group_into_pairs(source.problem, source.active, &partition);
        let work = |pair: u32| pairs[pair as usize].rows.len() as u64;
        let tasks = partition.sweep_tasks(&pair_bodies);
        let (SweepTasks { blocks, borders, colours }, share) = SweepShare::divide(&partition, tasks, work);
        let blocks = blocks.par_iter().enumerate().with_max_len(1).map(|(block, members)| {
            let bodies = GroupBodies::Block(partition.curve_range(block));
            let mut lines: Vec<_> =
                partition.bodies_of(block).iter().map(|&body| fill.body_lines::<C::T>(body)).collect();
            // A body that does not move has a line of its own in every pair.
            let mut line_of = |&k: &u32| {
                let (pair, curve_indices) = (&pairs[k as usize], pair_bodies[k as usize]);
                [0, 1].map(|side| {
                    if curve_indices[side] == NO_INDEX {
                        lines.push(fill.body_lines::<C::T>(pair.bodies[side]));
                        lines.len() as u32 - 1
                    } else {
                        bodies.index_of(curve_indices[side])
                    }
                })
            };
            let indices: Vec<[u32; 2]> = members.iter().map(&mut line_of).collect();
            lines.push(([C::T::ZERO; 8], [C::T::ZERO; 8]));
            let (lines, inertia): (Vec<_>, _) = lines.into_iter().unzip();
            let batches = PairBatches::new(&fill, &pairs, members, &indices, (bodies.count(), lines.len() - 1));
            BodyBlock::new(lines, PairGroup { inertia, batches })
        });
        let borders = borders.par_iter().with_max_len(1).map(|BorderTask { constraints, curve_indices }| {
            let bodies = GroupBodies::Border(curve_indices);
            let indices =
                constraints.iter().map(|&k| pair_bodies[k as usize].map(|curve_index| bodies.index_of(curve_index)));
            let lines = curve_indices
                .iter()
                .map(|&curve_index| fill.body_lines::<C::T>(partition.bodies[curve_index as usize]).1);
            let inertia = lines.chain([[C::T::ZERO; 8]]).collect();
            let indices: Vec<[u32; 2]> = indices.collect();
            let batches = PairBatches::new(&fill, &pairs, constraints, &indices, (bodies.count(), bodies.count()));
            BlockBorders::new(&partition, curve_indices, [C::T::ZERO; 8], PairGroup { inertia, batches })
        });
        let rows = source.problem.rows.len();
        let bodies = BlockedProblem::new(blocks.collect(), borders.collect(), colours, rows, share);
        BlockProblem { units, bodies }
    }

    /// Copies the impulses and moments of the swept rows, which belong to this system, into `reactions`.
    pub fn read_back_reactions(&self, width: SimdWidth, problem: &ContactProblem, reactions: &mut ContactReactions) {
        let ContactReactions { impulses, moments } = reactions;
        let back = UnpackContext { problem, units: self.units, width };
        self.bodies
            .read_back_moments(moments, |group| group.batches.rolls.iter().flat_map(RollingConstraintWide::moments));
        self.bodies.read_back(impulses, |PairGroup { batches: PairBatches { points, impulses, rows, .. }, .. }| {
            let columns = points.iter().zip(impulses).zip(rows);
            columns.map(|((point, values), rows)| point.world_impulses(&back, rows, values)).collect()
        });
    }
}

impl<C: PairContacts> ConstraintGroup for PairGroup<C> {
    fn rows(&self) -> &[LaneRows] {
        &self.batches.rows
    }
}

/// Counts of the division of the sweeps of a problem among `ranks`.
pub fn division_counts(
    problem: &ContactProblem,
    active: &[ContactId],
    partition: &BodyPartition,
    ranks: usize,
) -> DivisionCounts {
    let (pairs, pair_bodies) = group_into_pairs(problem, active, partition);
    let work = |pair: u32| pairs[pair as usize].rows.len() as u64;
    DivisionCounts::new(partition, &partition.sweep_tasks(&pair_bodies), work, ranks)
}

/// Groups consecutive rows of the same two bodies, at most [`MAX_PAIR_CONTACTS`] in a group, and returns the curve
/// indices of the bodies of each.
fn group_into_pairs<'a>(
    problem: &ContactProblem,
    active: &'a [ContactId],
    partition: &BodyPartition,
) -> (Vec<PairConstraints<'a>>, Vec<[u32; 2]>) {
    let bodies = |k: &ContactId| problem.rows[k.index()].bodies;
    let are_same = |a: &ContactId, b: &ContactId| bodies(a) == bodies(b);
    let pairs_of_task = |task: Range<usize>| {
        let mut first = task.start;
        active[task].chunk_by(are_same).flat_map(move |rows| {
            let curve_indices = partition.pairs[first];
            first += rows.len();
            let bodies = bodies(&rows[0]);
            rows.chunks(MAX_PAIR_CONTACTS).map(move |rows| (PairConstraints { bodies, rows }, curve_indices))
        })
    };
    run_ranges(active, PAR_MIN_LEN, are_same).into_par_iter().flat_map_iter(pairs_of_task).unzip()
}

impl<C: PairContacts> PairBatches<C> {
    /// Packs the pairs `members`, between lines with the given indices, those below `moving` of moving bodies; `unused` is the
    /// line of unused lanes.
    fn new(
        from: &BlockSource,
        pairs: &[PairConstraints],
        members: &[u32],
        indices: &[[u32; 2]],
        (moving, unused): (usize, usize),
    ) -> Self {
        let mut batches = PairBatches {
            batches: vec![],
            points: vec![],
            impulses: vec![],
            rolls: vec![],
            levers: vec![],
            rows: vec![],
        };
        // Pairs by colour; those without a colour form batches of one.
        let mut by_colour = vec![Vec::new(); MAX_COLOURS + 1];
        for (k, colour) in colour_pairs(indices.iter().copied(), moving).into_iter().enumerate() {
            by_colour[colour as usize].push((&pairs[members[k] as usize], indices[k]));
        }
        for (colour, mut members) in by_colour.into_iter().enumerate() {
            members.sort_by_key(|(pair, _)| std::cmp::Reverse(pair.rows.len()));
            for chunk in members.chunks(if colour < MAX_COLOURS { BATCH_LANES } else { 1 }) {
                batches.push_batch(from.block_data, chunk, unused as u32);
            }
        }
        batches.pack_batches(from);
        batches
    }

    /// Adds a batch of the pairs `members` with their lines: assigns rows to lanes.
    fn push_batch(&mut self, block_data: &BlockData, members: &[(&PairConstraints, [u32; 2])], unused: u32) {
        let first = self.rows.len();
        let mut bodies = members.iter().flat_map(|(pair, _)| pair.bodies);
        let has_locked_axes = bodies.any(|body| block_data.has_locked_axes(body.index()));
        let most_contacts = members.iter().map(|(pair, _)| pair.rows.len()).max().unwrap_or(0);
        self.rows.resize(first + most_contacts, [NO_INDEX; BATCH_LANES]);
        let has_lever = |row: &ContactId| {
            block_data.friction_offsets.get(row.index()).is_some_and(|offset| *offset != Vec3::zeros())
        };
        let has_levers = members.iter().any(|(pair, _)| pair.rows.iter().any(has_lever));
        let mut batch = BodyPairBatch {
            bodies: [[unused; BATCH_LANES]; 2],
            points: [first, first + most_contacts],
            has_locked_axes,
            has_levers,
        };
        for (lane, (pair, lines)) in members.iter().enumerate() {
            for (bodies, line) in batch.bodies.iter_mut().zip(lines) {
                bodies[lane] = *line;
            }
            for (rows, &row) in self.rows[first..].iter_mut().zip(pair.rows) {
                rows[lane] = row.0;
            }
        }
        self.batches.push(batch);
    }

    /// Packs all rows into their lanes.
    fn pack_batches(&mut self, from: &BlockSource) {
        let count = self.rows.len();
        let points = self.rows.par_iter().with_min_len(MIN_POINTS_PER_TASK).map(|rows| C::pack_rows(from, rows));
        points.unzip_into_vecs(&mut self.points, &mut self.impulses);
        if self.batches.iter().any(|batch| batch.has_levers) {
            let points = self.points.par_iter().zip(&self.rows).with_min_len(MIN_POINTS_PER_TASK);
            self.levers = points.map(|(point, rows)| point.friction_levers(from, rows)).collect();
        }
        if !from.start.problem.rolling_constraints.is_empty() {
            self.rolls = vec![RollingConstraintWide::NONE; count];
            for (rolls, rows) in self.rolls.iter_mut().zip(&self.rows) {
                for (lane, row) in occupied_lanes(rows) {
                    rolls.set_lane(lane, from.start.problem, ContactId(row as u32), &from.start.reactions.moments);
                }
            }
        }
    }
}

impl<T: LaneFloat> PairContacts for FrictionalPoint<T> {
    type T = T;
    type Impulses = FrictionalImpulses<T>;

    fn pack_rows(from: &BlockSource, rows: &LaneRows) -> (Self, FrictionalImpulses<T>) {
        let columns = &RowColumns::new::<T>(from, rows);
        let units = from.units;
        from.start.width.run(PackRows { columns, units, number: PhantomData })
    }

    fn friction_levers(&self, from: &BlockSource, rows: &LaneRows) -> LeverColumns<T> {
        let mut levers = [[T::ZERO; BATCH_LANES]; 2];
        for (lane, k) in occupied_lanes(rows) {
            let lever = from.block_data.friction_lever(k, &from.start.problem.rows[k].normal);
            for (axis, to) in self.axes[1..].iter().zip(&mut levers) {
                to[lane] = T::from_f64((0..3).map(|k| axis[k][lane].to_f64() * lever[k]).sum());
            }
        }
        levers
    }

    fn world_impulses(
        &self,
        from: &UnpackContext,
        rows: &LaneRows,
        values: &FrictionalImpulses<T>,
    ) -> [BatchColumn<f64>; 3] {
        let part =
            |axis: usize, k: usize, lane: usize| self.axes[axis][k][lane].to_f64() * values.r[axis][lane].to_f64();
        let impulse_component = |k: usize| {
            array::from_fn(|lane| (part(0, k, lane) + part(1, k, lane) + part(2, k, lane)) * from.units.impulse)
        };
        let mut r = [0, 1, 2].map(impulse_component);
        if T::IS_SINGLE {
            let mut cones = FrictionCones::NONE;
            for (lane, row) in occupied_lanes(rows) {
                cones.set_lane(lane, &from.problem.rows[row]);
            }
            snap_to_cones(from.width, &cones, &mut r);
        }
        r
    }
}

/// Data of a batch of rows, consecutive in double precision. In unused lanes two bodies of unit mass meet without an impulse,
/// and nothing changes that.
struct RowColumns {
    normal: [BatchColumn<f64>; 3],
    sides: [BodySide<BatchColumn<f64>>; 2],
    /// û at the start of the sweeps, m/s.
    u: [BatchColumn<f64>; 3],
    /// r̂, N s.
    r: [BatchColumn<f64>; 3],
    inverse_nn: BatchColumn<f64>,
    friction: BatchColumn<f64>,
    /// Friction levers n×d, m; `None` if all are 0.
    levers: Option<[BatchColumn<f64>; 3]>,
}

impl RowColumns {
    fn new<T: LaneFloat>(from: &BlockSource, rows: &LaneRows) -> Self {
        let (zero, one) = ([0.0; BATCH_LANES], [1.0; BATCH_LANES]);
        let unit = [1.0 / from.units.mass_unit(); BATCH_LANES];
        let side = BodySide { arm: [zero; 3], inverse_mass: [unit; 3], inverse_inertia: [zero; 6] };
        let normal = [zero, zero, one];
        let levers = (!from.block_data.friction_offsets.is_empty()).then_some([zero; 3]);
        let (u, r) = ([zero; 3], [zero; 3]);
        let mut columns = RowColumns { normal, sides: [side; 2], u, r, inverse_nn: zero, friction: zero, levers };
        let PackSource { problem, reactions, .. } = from.start;
        for (lane, k) in occupied_lanes(rows) {
            let row = &problem.rows[k];
            set_lane(&mut columns.normal, lane, &row.normal);
            if let Some(levers) = &mut columns.levers {
                set_lane(levers, lane, &from.block_data.friction_lever(k, &row.normal));
            }
            set_lane(&mut columns.u, lane, &from.starting_velocity::<T>(k));
            set_lane(&mut columns.r, lane, &reactions.impulses[k]);
            for (side, to) in columns.sides.iter_mut().enumerate() {
                let BodySide { arm, inverse_mass, inverse_inertia } =
                    BodySide::from_row(problem, from.block_data, k, side);
                (0..3).for_each(|k| (to.arm[k][lane], to.inverse_mass[k][lane]) = (arm[k], inverse_mass[k]));
                (0..6).for_each(|k| to.inverse_inertia[k][lane] = inverse_inertia[k]);
            }
            (columns.inverse_nn[lane], columns.friction[lane]) = (1.0 / problem.delassus_diagonal(k).0, row.friction);
        }
        columns
    }
}

/// Packs a batch on the axes of its contacts' own blocks.
struct PackRows<'a, T> {
    columns: &'a RowColumns,
    units: SweepUnits,
    number: PhantomData<T>,
}

impl<T: LaneFloat> LaneOperation for PackRows<'_, T> {
    type Output = (FrictionalPoint<T>, FrictionalImpulses<T>);

    #[inline(always)]
    fn call<L: F64Arithmetic>(self, l: L) -> Self::Output {
        let PackRows { columns, units, .. } = self;
        let (mut point, mut impulses) = (FrictionalPoint::zero(), FrictionalImpulses::default());
        let (mass, one) = (l.splat(units.mass_unit()), l.splat(1.0));
        for from in (0..BATCH_LANES).step_by(L::WIDTH) {
            let normal = load_vector(l, from, &columns.normal);
            let sides = [load_side(l, &columns.sides[0], from), load_side(l, &columns.sides[1], from)];
            let mut w = delassus_block(l, sides);
            if let Some(levers) = &columns.levers {
                let lever_part = lever_block(l, &sides, normal, load_vector(l, from, levers));
                (0..6).for_each(|k| w[k] = l.add(w[k], lever_part[k]));
            }
            let BlockAxes { axes, c, s } = block_axes(l, w, normal);
            let u = triple!(k => l.div(load_column(l, from, &columns.u[k]), l.splat(units.velocity)));
            let r = triple!(k => l.div(load_column(l, from, &columns.r[k]), l.splat(units.impulse)));
            for (k, axis) in axes.into_iter().enumerate() {
                for (to, component) in point.axes[k].iter_mut().zip(axis) {
                    store_lanes(l, &mut to[from..], component);
                }
                store_lanes(l, &mut point.shift[k][from..], dot_product(l, axis, u));
                store_lanes(l, &mut impulses.r[k][from..], dot_product(l, axis, r));
            }
            for side in 0..2 {
                for k in 0..3 {
                    store_lanes(l, &mut point.arms[side][k][from..], sides[side].arm[k]);
                }
                let s = l.mul(s[side], mass);
                store_lanes(l, &mut point.c[side][from..], c[side]);
                store_lanes(l, &mut point.s[side][from..], s);
                store_lanes(l, &mut point.inverse_s[side][from..], l.div(one, s));
            }
            store_lanes(l, &mut point.inverse_nn[from..], l.div(load_column(l, from, &columns.inverse_nn), mass));
            store_lanes(l, &mut point.friction[from..], load_column(l, from, &columns.friction));
            let trace = l.add(w[0], l.add(w[3], w[5]));
            store_lanes(l, &mut point.weight[from..], l.mul(l.mul(trace, l.splat(1.0 / 3.0)), mass));
        }
        impulses.previous = impulses.r;
        (point, impulses)
    }
}

#[inline(always)]
fn load_side<L: F64Arithmetic>(l: L, side: &BodySide<BatchColumn<f64>>, from: usize) -> BodySide<L::V> {
    let BodySide { arm, inverse_mass, inverse_inertia: [xx, xy, xz, yy, yz, zz] } = side;
    BodySide {
        arm: load_vector(l, from, arm),
        inverse_mass: load_vector(l, from, inverse_mass),
        inverse_inertia: [
            load_column(l, from, xx),
            load_column(l, from, xy),
            load_column(l, from, xz),
            load_column(l, from, yy),
            load_column(l, from, yz),
            load_column(l, from, zz),
        ],
    }
}

/// Writes one number per lane into `to`, from its first index on.
#[inline(always)]
fn store_lanes<L: F64Arithmetic, T: LaneFloat>(l: L, to: &mut [T], v: L::V) {
    let mut all_lanes = [0.0; BATCH_LANES];
    l.store(&mut all_lanes, v);
    for (to, x) in to.iter_mut().zip(&all_lanes[..L::WIDTH]) {
        *to = T::from_f64(*x);
    }
}

impl<T: LaneFloat> FrictionalPoint<T> {
    fn zero() -> Self {
        let zero = [T::ZERO; BATCH_LANES];
        FrictionalPoint {
            axes: [[zero; 3]; 3],
            arms: [[zero; 3]; 2],
            shift: [zero; 3],
            inverse_nn: zero,
            c: [zero; 2],
            s: [zero; 2],
            inverse_s: [zero; 2],
            friction: zero,
            weight: zero,
        }
    }
}

impl<T: LaneFloat> PairContacts for FrictionlessPoint<T> {
    type T = T;
    type Impulses = NormalImpulses<T>;

    fn pack_rows(from: &BlockSource, rows: &LaneRows) -> (Self, NormalImpulses<T>) {
        let zero = [T::ZERO; BATCH_LANES];
        let mut point = FrictionlessPoint {
            normal: [zero; 3],
            arms: [[zero; 3]; 2],
            answers: [[zero; 3]; 2],
            shift: zero,
            inverse_nn: zero,
            weight: zero,
        };
        let mut values = NormalImpulses::default();
        let BlockSource { start: PackSource { problem, reactions, .. }, block_data, units } = from;
        for (lane, k) in occupied_lanes(rows) {
            let row = &problem.rows[k];
            let (n, mass) = (row.normal, units.mass_unit());
            set_lane(&mut point.normal, lane, &n);
            for side in 0..2 {
                let arm = block_data.arms[k][side].cross(&n);
                set_lane(&mut point.arms[side], lane, &arm);
                let answer = block_data.inverse_inertia[row.bodies[side].index()] * arm * mass;
                set_lane(&mut point.answers[side], lane, &answer);
            }
            point.shift[lane] = T::from_f64(n.dot(&from.starting_velocity::<T>(k)) / units.velocity);
            values.r[lane] = T::from_f64(n.dot(&reactions.impulses[k]) / units.impulse);
            values.previous[lane] = values.r[lane];
            let w_n = problem.delassus_diagonal(k).0;
            (point.inverse_nn[lane], point.weight[lane]) = (T::from_f64(1.0 / w_n / mass), T::from_f64(w_n * mass));
        }
        (point, values)
    }

    fn friction_levers(&self, _: &BlockSource, _: &LaneRows) -> LeverColumns<T> {
        [[T::ZERO; BATCH_LANES]; 2] // without friction
    }

    fn world_impulses(
        &self,
        from: &UnpackContext,
        rows: &LaneRows,
        values: &NormalImpulses<T>,
    ) -> [BatchColumn<f64>; 3] {
        let mut r = [[0.0; BATCH_LANES]; 3];
        for (lane, row) in occupied_lanes(rows) {
            let size = values.r[lane].to_f64() * from.units.impulse;
            set_lane(&mut r, lane, &(from.problem.rows[row].normal * size));
        }
        r
    }
}
