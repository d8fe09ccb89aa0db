//! The contact problem laid out for sweeping: bodies in spatial order, one cache line each, half a line in scenes without
//! friction; contacts in batches that share no moving body.

use std::borrow::Cow;

use bytemuck::Pod;
use rayon::prelude::*;

use crate::assemble::SolverBody;
use crate::math::PAR_MIN_LEN;
use crate::math::simd::{BodyHalfLine, BodyHalfLineF32, BodyLine, BodyLineF32, LaneFloat, SimdWidth};
use crate::scene::BodyId;
use crate::solve::gauss_seidel::blocked::{BlockBorders, BlockedProblem, BodyBlock, ConstraintGroup};
use crate::solve::gauss_seidel::packed::{
    BATCH_LANES, FrictionCones, LaneRows, NO_INDEX, PackSource, SweepUnits, set_lane, snap_to_cones,
};
use crate::solve::gauss_seidel::partition::{
    BodyPartition, BorderTask, GroupBodies, MAX_COLOURS, SweepTasks, colour_pairs,
};
use crate::solve::gauss_seidel::rolling::RollingConstraintWide;
use crate::solve::gauss_seidel::row_division::RowDivision;
use crate::solve::gauss_seidel::shares::SweepShare;
use crate::solve::types::ContactReactions;

/// Constant data of sixteen contacts. Unused lanes have no normal and no friction, and stay at rest.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct ContactBatch<T> {
    /// Unit normals from the antagonists to the candidates, world frame: x of all lanes, then y, then z.
    pub n: [[T; BATCH_LANES]; 3],
    /// Shift along n, m/s.
    pub shift: [T; BATCH_LANES],
    /// Arm, see [`crate::assemble::ContactConstraint`], dimensionless.
    pub arm: [T; BATCH_LANES],
    /// Coefficient μ.
    pub friction: [T; BATCH_LANES],
    /// Lines of candidate and antagonist in their block, or in the border of their blocks.
    pub bodies: [[u32; BATCH_LANES]; 2],
}

/// One vector for each of sixteen contacts: first components of all lanes, then second, then third.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
pub struct BatchVectors<T>(pub [[T; BATCH_LANES]; 3]);

/// Contacts in the order in which they are swept: those inside a block of bodies, or between blocks.
#[derive(Debug, Clone, Default)]
pub struct GroupBatches<T> {
    pub batches: Vec<ContactBatch<T>>,
    /// Index of the end of the batches of each colour.
    pub colours: Vec<usize>,
    /// r̂ of the last sweep and of the one before, N s, as world vectors. In scenes without friction the first component is
    /// r̂_n and the others are not used.
    pub r: Vec<BatchVectors<T>>,
    pub previous: Vec<BatchVectors<T>>,
    /// Shift in the tangent plane, m/s; empty if there is none.
    pub tangential_shift: Vec<BatchVectors<T>>,
    /// 1 for a contact with the associated law, else 0; empty if none has it.
    pub associated: Vec<[T; BATCH_LANES]>,
    /// Rolling constraints; empty if no contact of the scene has moments, as is `curvatures`.
    pub rolls: Vec<RollingConstraintWide<T>>,
    /// 1/radius of candidate and antagonist, 1/m; 0 for a plate, whose rotation is in the shift.
    pub curvatures: Vec<[[T; BATCH_LANES]; 2]>,
    /// Rows of the system.
    pub rows: Vec<LaneRows>,
    /// Friction cones to which the impulses are snapped when read back, if needed; else empty.
    pub cones: Vec<FrictionCones>,
}

/// Data of a body in the sweeps.
///
/// In single precision small changes of large velocities would be lost: there the stored velocity is only the change by the
/// sweeps, and each contact has the initial one.
pub trait PackedBody: Pod + Send + Sync {
    /// Type of its numbers.
    type T: LaneFloat;
    /// Whether it has the surface speed R ω, which friction changes.
    const HAS_FRICTION: bool;
    /// Body of unused lanes: no impulse acts on it, and no division by zero occurs.
    const PADDING: Self;

    /// Packs a body of the contact problem in these units.
    fn new(solver_body: &SolverBody, units: &SweepUnits) -> Self;
}

/// Line (v, 1/m, R ω, R²/J).
impl PackedBody for BodyLine {
    type T = f64;
    const HAS_FRICTION: bool = true;
    const PADDING: Self = BodyLine([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);

    fn new(&SolverBody { v, inverse_mass, w, inverse_inertia, radius }: &SolverBody, _: &SweepUnits) -> Self {
        let w = w * radius;
        BodyLine([v.x, v.y, v.z, inverse_mass, w.x, w.y, w.z, radius * radius * inverse_inertia])
    }
}

/// Half line (v, 1/m): spheres without friction do not turn.
impl PackedBody for BodyHalfLine {
    type T = f64;
    const HAS_FRICTION: bool = false;
    const PADDING: Self = BodyHalfLine([0.0, 0.0, 0.0, 1.0]);

    fn new(solver_body: &SolverBody, _: &SweepUnits) -> Self {
        let SolverBody { v, inverse_mass, .. } = solver_body;
        BodyHalfLine([v.x, v.y, v.z, *inverse_mass])
    }
}

/// Line as [`BodyLine`], with changes of the velocities.
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

/// Half line as [`BodyHalfLine`], with changes of the velocities.
impl PackedBody for BodyHalfLineF32 {
    type T = f32;
    const HAS_FRICTION: bool = false;
    const PADDING: Self = BodyHalfLineF32([0.0, 0.0, 0.0, 1.0]);

    fn new(solver_body: &SolverBody, units: &SweepUnits) -> Self {
        BodyHalfLineF32([0.0, 0.0, 0.0, (solver_body.inverse_mass * units.mass_unit()) as f32])
    }
}

/// Contact problem of a step in the form used by the sweeps.
pub struct DiagonalProblem<B: PackedBody> {
    pub units: SweepUnits,
    pub bodies: BlockedProblem<B, GroupBatches<B::T>, B::T>,
}

impl<B: PackedBody> DiagonalProblem<B> {
    /// Packs the rows of `source` in blocks of `min_bodies` bodies or more, or by a division of rows among ranks.
    pub fn new(source: &PackSource, min_bodies: usize, division: Option<&RowDivision>) -> Self {
        let units = SweepUnits::from_source::<B::T>(source, division.is_some());
        let PackedTasks { partition, order, tasks: SweepTasks { blocks, borders, colours }, share } =
            PackedTasks::new(source, min_bodies, division);
        let partition = &*partition;
        let pack = |constraints: &[u32], bodies: &GroupBodies| {
            let rows: Vec<u32> = constraints.iter().map(|&k| order[k as usize]).collect();
            pack_group::<B>(&rows, &partition.pairs, bodies, source, units)
        };
        let blocks = blocks.par_iter().enumerate().with_max_len(1).map(|(block, constraints)| {
            let (batches, fixed) = pack(constraints, &GroupBodies::Block(partition.curve_range(block)));
            let packed_body = |body: &BodyId| B::new(&source.solver_bodies[body.index()], &units);
            let moving = partition.bodies_of(block).iter().map(packed_body);
            BodyBlock::new(moving.chain(fixed).chain([B::PADDING]).collect(), batches)
        });
        let borders = borders.par_iter().with_max_len(1).map(|BorderTask { constraints, curve_indices }| {
            let (batches, _) = pack(constraints, &GroupBodies::Border(curve_indices));
            BlockBorders::new(partition, curve_indices, B::PADDING, batches)
        });
        let rows = source.problem.rows.len();
        let bodies = BlockedProblem::new(blocks.collect(), borders.collect(), colours, rows, share);
        DiagonalProblem { units, bodies }
    }

    /// Copies the impulses and moments of the swept rows into `reactions`.
    pub fn read_back_reactions(&self, width: SimdWidth, reactions: &mut ContactReactions) {
        let ContactReactions { impulses, moments } = reactions;
        let unit = self.units.impulse;
        self.bodies.read_back_moments(moments, |group| group.rolls.iter().flat_map(RollingConstraintWide::moments));
        self.bodies.read_back(impulses, |group| {
            let batch_impulses = |(batch, r): (usize, &BatchVectors<B::T>)| {
                let mut r = r.0.map(|column| column.map(|r| r.to_f64() * unit));
                match (B::HAS_FRICTION, B::T::IS_SINGLE) {
                    (true, false) => r,
                    (true, true) => {
                        snap_to_cones(width, &group.cones[batch], &mut r);
                        r
                    }
                    (false, _) => group.cones[batch].n.map(|n| std::array::from_fn(|lane| n[lane] * r[0][lane])),
                }
            };
            group.r.iter().enumerate().map(batch_impulses).collect()
        });
    }
}

impl<T: LaneFloat> ConstraintGroup for GroupBatches<T> {
    fn rows(&self) -> &[LaneRows] {
        &self.rows
    }
}

/// Constraints of a problem by task, and the tasks of this rank.
struct PackedTasks<'a> {
    partition: Cow<'a, BodyPartition>,
    /// Indices into the active rows in the order in which they are constraints.
    order: Cow<'a, [u32]>,
    tasks: SweepTasks,
    share: Option<SweepShare>,
}

impl<'a> PackedTasks<'a> {
    /// Tasks of the rows of `source` in blocks of `min_bodies` bodies or more, or by a division of rows among ranks.
    fn new(source: &PackSource, min_bodies: usize, division: Option<&'a RowDivision>) -> Self {
        if let Some(division) = division {
            let (partition, order) = (Cow::Borrowed(&division.partition), Cow::Borrowed(&division.order[..]));
            return PackedTasks {
                partition,
                order,
                tasks: division.tasks.clone(),
                share: Some(division.sweep_share()),
            };
        }
        let partition = BodyPartition::new(source.problem, source.active, min_bodies);
        let (order, tasks) = contact_tasks(&partition);
        let (tasks, share) = SweepShare::divide(&partition, tasks, |_| 1);
        PackedTasks { partition: Cow::Owned(partition), order: Cow::Owned(order), tasks, share }
    }
}

/// Indices into the active rows in the order in which they are constraints, and tasks of these.
pub fn contact_tasks(partition: &BodyPartition) -> (Vec<u32>, SweepTasks) {
    let order = partition.spatial_order();
    let pair = |&row: &u32| partition.pairs[row as usize];
    let pairs: Vec<[u32; 2]> = order.par_iter().with_min_len(PAR_MIN_LEN).map(pair).collect();
    let tasks = partition.sweep_tasks(&pairs);
    (order, tasks)
}

/// Packs the active rows `rows`, and the lines of the bodies in them that do not move: every contact with such a body has a
/// line of its own for that body, so that lines shared by many contacts do not exist.
fn pack_group<B: PackedBody>(
    rows: &[u32],
    pairs: &[[u32; 2]],
    bodies: &GroupBodies,
    source: &PackSource,
    units: SweepUnits,
) -> (GroupBatches<B::T>, Vec<B>) {
    let pair_indices: Vec<[u32; 2]> =
        rows.iter().map(|&row| pairs[row as usize].map(|curve_index| bodies.index_of(curve_index))).collect();
    let moving = bodies.count() as u32;
    let fixed_count = pair_indices.as_flattened().iter().filter(|&&index| index == NO_INDEX).count() as u32;
    let (slots, colours) = batches_by_colour(&pair_indices, bodies.count());
    let zero = B::T::default();
    let empty = ContactBatch {
        n: [[zero; BATCH_LANES]; 3],
        shift: [zero; BATCH_LANES],
        arm: [zero; BATCH_LANES],
        friction: [zero; BATCH_LANES],
        bodies: [[moving + fixed_count; BATCH_LANES]; 2],
    };
    let mut batches = vec![empty; slots.len()];
    let mut r = vec![BatchVectors::default(); slots.len()];
    let mut tangential_shift = Vec::new();
    let mut associated = vec![[zero; BATCH_LANES]; if source.associated.is_empty() { 0 } else { slots.len() }];
    let rolling_count = if source.problem.rolling_constraints.is_empty() { 0 } else { slots.len() };
    let (mut rolls, mut curvatures) =
        (vec![RollingConstraintWide::NONE; rolling_count], vec![[[zero; BATCH_LANES]; 2]; rolling_count]);
    let mut cones = vec![FrictionCones::NONE; if B::T::IS_SINGLE || !B::HAS_FRICTION { slots.len() } else { 0 }];
    let mut fixed = Vec::new();
    let mut rows_of_lanes = vec![[NO_INDEX; BATCH_LANES]; slots.len()];
    for (i, ((batch, r), slots)) in batches.iter_mut().zip(&mut r).zip(&slots).enumerate() {
        for (lane, &slot) in slots.iter().enumerate().filter(|(_, slot)| **slot != NO_INDEX) {
            let pair = pair_indices[slot as usize];
            let k = source.active[rows[slot as usize] as usize];
            rows_of_lanes[i][lane] = k.0;
            let row = &source.problem.rows[k.index()];
            let n = row.normal;
            set_lane(&mut batch.n, lane, &n);
            if let Some(cones) = cones.get_mut(i) {
                cones.set_lane(lane, row);
            }
            batch.arm[lane] = B::T::from_f64(row.arm);
            batch.friction[lane] = B::T::from_f64(row.friction);
            if let Some(associated) = associated.get_mut(i)
                && source.associated[k.index()]
            {
                associated[lane] = B::T::from_f64(1.0);
            }
            for (side, index) in pair.into_iter().enumerate() {
                if index != NO_INDEX {
                    batch.bodies[side][lane] = index;
                    continue;
                }
                // The shift of a contact with a body that does not move is a velocity of that body.
                let sign = if side == 0 { 1.0 } else { -1.0 };
                let solver_body = &source.solver_bodies[row.bodies[side].index()];
                batch.bodies[side][lane] = moving + fixed.len() as u32;
                fixed.push(B::new(&SolverBody { v: solver_body.v + row.shift * sign, ..*solver_body }, &units));
            }
            let both_move = !pair.contains(&NO_INDEX);
            if B::T::IS_SINGLE || both_move {
                let shift = if B::T::IS_SINGLE {
                    row.shifted_velocity(source.solver_bodies) / units.velocity
                } else {
                    row.shift
                };
                let normal_shift = n.dot(&shift);
                batch.shift[lane] = B::T::from_f64(normal_shift);
                let tangential = shift - n * normal_shift;
                // Larger than rounding.
                if B::HAS_FRICTION && tangential.norm_squared() > 1e-30 * shift.norm_squared() {
                    tangential_shift.resize(colours[colours.len() - 1], BatchVectors::default());
                    set_lane(&mut tangential_shift[i].0, lane, &tangential);
                }
            }
            if let (Some(rolls), Some(curvatures)) = (rolls.get_mut(i), curvatures.get_mut(i)) {
                rolls.set_lane(lane, source.problem, k, &source.reactions.moments);
                for (curvature, body) in curvatures.iter_mut().zip(row.bodies) {
                    let radius = source.solver_bodies[body.index()].radius;
                    curvature[lane] = B::T::from_f64(if radius > 0.0 { 1.0 / radius } else { 0.0 });
                }
            }
            let impulse = &source.reactions.impulses[k.index()];
            if B::HAS_FRICTION {
                set_lane(&mut r.0, lane, &(impulse / units.impulse));
            } else {
                r.0[0][lane] = B::T::from_f64(n.dot(impulse) / units.impulse);
            }
        }
    }
    let previous = r.clone();
    let rows = rows_of_lanes;
    let group =
        GroupBatches { batches, colours, r, previous, tangential_shift, associated, rolls, curvatures, rows, cones };
    (group, fixed)
}

/// Batches of `pairs` of `bodies` moving bodies that share none of these, by colour, and the end of each colour. Pairs without
/// a colour form batches of one.
fn batches_by_colour(pairs: &[[u32; 2]], bodies: usize) -> (Vec<[u32; BATCH_LANES]>, Vec<usize>) {
    let colours = colour_pairs(pairs.iter().copied(), bodies);
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
    for (pair, &colour) in colours.iter().enumerate() {
        let slot = &mut next[colour as usize];
        batched[*slot / BATCH_LANES][*slot % BATCH_LANES] = pair as u32;
        *slot += if (colour as usize) < MAX_COLOURS { 1 } else { BATCH_LANES };
    }
    (batched, ends)
}
