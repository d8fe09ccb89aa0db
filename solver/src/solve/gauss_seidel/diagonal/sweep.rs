//! One Gauss-Seidel sweep over the batches, with momentum.

use bytemuck::{cast_slice, cast_slice_mut};
use pulp::NullaryFnOnce;

use crate::assemble::ContactProblem;
use crate::math::simd::{Arithmetic, F64Arithmetic, LaneFloat, LaneOperation, SimdWidth};
use crate::solve::gauss_seidel::blocked::SweepOperations;
use crate::solve::gauss_seidel::diagonal::batches::{
    BatchVectors, ContactBatch, DiagonalProblem, GroupBatches, PackedBody,
};
use crate::solve::gauss_seidel::diagonal::local::{
    FrozenContact, associated_normal, coulomb, signorini, unprojected_impulse,
};
use crate::solve::gauss_seidel::packed::{
    ApplyMomentum, BATCH_LANES, L2_BYTES, PackedProblem, SweepStats, SweepSums, load_column, load_vector, store_column,
};
use crate::solve::gauss_seidel::rolling::{RollingConstraintWide, RollingContacts};
use crate::solve::gauss_seidel::vector::{LaneVector, cross_add, cross_product, dot_product, triple};
use crate::solve::types::ContactReactions;

/// Batches processed together in each stage of a sweep, so that no stage waits for the one before.
const BATCHES_PER_STAGE: usize = 8;

impl<B: PackedBody> PackedProblem for DiagonalProblem<B> {
    fn sweep_contacts(&mut self, width: SimdWidth, beta: f64) -> SweepStats {
        width.dispatch(DiagonalSweep { problem: self, beta })
    }

    fn read_back(&self, width: SimdWidth, _: &ContactProblem, reactions: &mut ContactReactions) {
        self.read_back_reactions(width, reactions);
    }
}

/// One sweep of a problem with the momentum `beta`.
struct DiagonalSweep<'a, B: PackedBody> {
    problem: &'a mut DiagonalProblem<B>,
    beta: f64,
}

impl<B: PackedBody> LaneOperation for DiagonalSweep<'_, B> {
    type Output = SweepStats;

    fn call<L: F64Arithmetic>(self, l: L) -> SweepStats {
        let DiagonalSweep { problem: DiagonalProblem { units, bodies }, beta } = self;
        let batches: usize = bodies.groups().map(|group| group.batches.len()).sum();
        let exceeds_l2 = batches * size_of::<(ContactBatch<B::T>, [BatchVectors<B::T>; 2])>() > L2_BYTES;
        bodies.sweep_once(&DiagonalOperations { lanes: B::T::lanes(l), beta, exceeds_l2 }).reduce(*units)
    }
}

/// Operations of a sweep on blocks and borders.
struct DiagonalOperations<L> {
    lanes: L,
    /// Momentum, dimensionless.
    beta: f64,
    /// Whether the problem exceeds the L2 cache.
    exceeds_l2: bool,
}

impl<L: Arithmetic, B: PackedBody<T = L::T>> SweepOperations<B, GroupBatches<L::T>, L::T> for DiagonalOperations<L> {
    fn apply_momentum(&self, lines: &mut [B], last: &[B]) {
        let (l, beta) = (self.lanes, self.beta);
        l.run(ApplyMomentum { l, numbers: cast_slice_mut(lines), last: cast_slice(last), beta });
    }

    fn sweep_group(&self, lines: &mut [B], group: &mut GroupBatches<L::T>) -> SweepSums<L::T> {
        let &DiagonalOperations { lanes, beta, exceeds_l2 } = self;
        let mut sums = SweepSums::default();
        lanes.run(SweepGroup { lanes, lines, group, beta, exceeds_l2, sums: &mut sums });
        std::mem::swap(&mut group.r, &mut group.previous);
        sums
    }
}

/// Columns of the bodies' lines for a vector of contacts.
macro_rules! pair {
    ($from:ident, $batch:ident) => {
        (&$batch.bodies[0][$from..$from + L::WIDTH], &$batch.bodies[1][$from..$from + L::WIDTH])
    };
}

/// Sweep of the contacts of a block or border.
struct SweepGroup<'a, L, B: PackedBody> {
    lanes: L,
    /// Bodies, which the contacts index.
    lines: &'a mut [B],
    group: &'a mut GroupBatches<B::T>,
    /// Momentum, dimensionless.
    beta: f64,
    /// Whether the problem exceeds the L2 cache.
    exceeds_l2: bool,
    sums: &'a mut SweepSums<B::T>,
}

impl<L: Arithmetic, B: PackedBody<T = L::T>> NullaryFnOnce for SweepGroup<'_, L, B> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let SweepGroup { lanes: l, lines, group, beta, exceeds_l2, sums } = self;
        let GroupBatches { batches, colours, r, previous, tangential_shift, associated, rolls, curvatures, .. } = group;
        let zero = l.splat(0.0);
        let mut buffers = StageBuffers {
            trials: [TrialImpulse { tangential: [zero; 3], normal: zero, y: [zero; 3], w_n: zero }; BATCHES_PER_STAGE],
            changes: [ImpulseChange { impulse: [zero; 3], turn: [zero; 3] }; BATCHES_PER_STAGE],
        };
        let mut first = 0;
        for &end in &*colours {
            while first < end {
                let next = end.min(first + BATCHES_PER_STAGE);
                let (previous, previous_later) = previous.split_at_mut(next);
                let later = PrefetchWindow {
                    batches: if exceeds_l2 { &batches[next..] } else { &[] },
                    r: &r[next..],
                    previous: previous_later,
                    tangential_shift: tangential_shift.get(next..).unwrap_or_default(),
                };
                let mut chunk = BatchChunk {
                    batches: &batches[first..next],
                    later,
                    r: &r[first..next],
                    previous: &mut previous[first..],
                    tangential_shift: tangential_shift.get(first..next).unwrap_or_default(),
                    associated: associated.get(first..next).unwrap_or_default(),
                    rolls: rolls.get_mut(first..next).unwrap_or_default(),
                    curvatures: curvatures.get(first..next).unwrap_or_default(),
                    beta,
                };
                for from in (0..BATCH_LANES).step_by(L::WIDTH) {
                    solve_contacts(l, lines, &mut chunk, from, &mut buffers, sums);
                    for (batch, change) in chunk.batches.iter().zip(&buffers.changes) {
                        apply_change(l, lines, pair!(from, batch), change);
                    }
                    if B::HAS_FRICTION && !chunk.rolls.is_empty() {
                        solve_rolling(l, cast_slice_mut(lines), &mut chunk, from);
                    }
                }
                first = next;
            }
        }
    }
}

/// Batches processed together in each stage; arrays by batch as in [`GroupBatches`].
pub struct BatchChunk<'a, T> {
    batches: &'a [ContactBatch<T>],
    later: PrefetchWindow<'a, T>,
    r: &'a [BatchVectors<T>],
    previous: &'a mut [BatchVectors<T>],
    tangential_shift: &'a [BatchVectors<T>],
    associated: &'a [[T; BATCH_LANES]],
    rolls: &'a mut [RollingConstraintWide<T>],
    curvatures: &'a [[[T; BATCH_LANES]; 2]],
    beta: f64,
}

/// Next chunk to prefetch: for many contacts it is in far memory, which is faster if it need not wait for arithmetic.
struct PrefetchWindow<'a, T> {
    /// Batches to prefetch; empty if there are none.
    batches: &'a [ContactBatch<T>],
    r: &'a [BatchVectors<T>],
    previous: &'a [BatchVectors<T>],
    tangential_shift: &'a [BatchVectors<T>],
}

/// Prefetches, with each batch, the batch at the same position of the next chunk: most of many requests at once would wait
/// for each other.
impl<T: LaneFloat> PrefetchWindow<'_, T> {
    #[inline(always)]
    fn prefetch_constants<L: Arithmetic<T = T>>(&self, l: L, i: usize) {
        if i < self.batches.len() {
            l.prefetch(&self.batches[i]);
            if i < self.tangential_shift.len() {
                l.prefetch(&self.tangential_shift[i]);
            }
        }
    }

    #[inline(always)]
    fn prefetch_impulses<L: Arithmetic<T = T>>(&self, l: L, i: usize, components: usize) {
        if i < self.batches.len() {
            l.prefetch(&self.r[i].0[..components]);
            l.prefetch(&self.previous[i].0[..components]);
        }
    }
}

/// Intermediate results of one stage for the next, a vector of each batch.
pub struct StageBuffers<V> {
    trials: [TrialImpulse<V>; BATCHES_PER_STAGE],
    changes: [ImpulseChange<V>; BATCHES_PER_STAGE],
}

/// Impulses that would stop the contacts of a vector, N s.
#[derive(Clone, Copy)]
pub struct TrialImpulse<V> {
    /// Tangential impulse, world frame.
    tangential: LaneVector<V>,
    /// Normal impulse, after Signorini's condition.
    normal: V,
    /// Impulses contained in the velocities, world frame.
    y: LaneVector<V>,
    /// W_nn, 1/kg.
    w_n: V,
}

/// Change of a contact's impulse on the bodies, world frame.
#[derive(Clone, Copy)]
pub struct ImpulseChange<V> {
    /// Impulse on the candidate, N s; the antagonist gets the opposite.
    impulse: LaneVector<V>,
    /// Moment divided by the radius, the same for both bodies, N s.
    turn: LaneVector<V>,
}

/// Solves the contacts of the vector from index `from` on of each batch; writes their impulses, and the changes to be given
/// to the bodies.
#[inline(always)]
fn solve_contacts<L: Arithmetic, B: PackedBody<T = L::T>>(
    l: L,
    bodies: &[B],
    chunk: &mut BatchChunk<L::T>,
    from: usize,
    buffers: &mut StageBuffers<L::V>,
    sums: &mut SweepSums<L::T>,
) {
    if B::HAS_FRICTION {
        trial_impulses(l, cast_slice(bodies), chunk, from, &mut buffers.trials);
        project_impulses(l, chunk, from, buffers, sums);
    } else {
        project_normal_impulses(l, cast_slice(bodies), chunk, from, &mut buffers.changes, sums);
    }
}

/// Adds a change to the bodies `a` and subtracts it from `b`.
#[inline(always)]
fn apply_change<L: Arithmetic, B: PackedBody<T = L::T>>(
    l: L,
    bodies: &mut [B],
    (a, b): (&[u32], &[u32]),
    change: &ImpulseChange<L::V>,
) {
    if B::HAS_FRICTION {
        l.apply_impulse(cast_slice_mut(bodies), a, b, change.impulse, change.turn);
    } else {
        l.apply_half_impulse(cast_slice_mut(bodies), a, b, change.impulse);
    }
}

/// Gives the bodies the moments of these contacts that follow from their new impulses.
#[inline(always)]
fn solve_rolling<L: Arithmetic>(l: L, lines: &mut [[L::T; 8]], chunk: &mut BatchChunk<L::T>, from: usize) {
    let BatchChunk { batches, previous, rolls, curvatures, beta, .. } = chunk;
    let beta = l.splat(*beta);
    // The new impulses replace the impulses of the sweep before.
    for (((batch, r), rolls), curvatures) in batches.iter().zip(&**previous).zip(&mut **rolls).zip(*curvatures) {
        let (a, b) = pair!(from, batch);
        let (mut line_a, mut line_b) = (l.gather_lines(lines, a), l.gather_lines(lines, b));
        // Lines contain R w and R^2/I.
        let (curvature_a, curvature_b) = (load_column(l, from, &curvatures[0]), load_column(l, from, &curvatures[1]));
        let w = triple!(k => l.neg_mul_add(line_b[4 + k], curvature_b, l.mul(line_a[4 + k], curvature_a)));
        let n = load_vector(l, from, &batch.n);
        let r = load_vector(l, from, &r.0);
        let normal_impulse = dot_product(l, n, r);
        let tangential = triple!(k => l.neg_mul_add(n[k], normal_impulse, r[k]));
        let tangential_impulse = l.sqrt(dot_product(l, tangential, tangential));
        let contacts = RollingContacts { n, normal_impulse, tangential_impulse, w };
        let change = rolls.solve_moments(l, from, beta, contacts);
        let (response_a, response_b) = (l.mul(line_a[7], curvature_a), l.mul(line_b[7], curvature_b));
        for k in 0..3 {
            line_a[4 + k] = l.mul_add(response_a, change[k], line_a[4 + k]);
            line_b[4 + k] = l.neg_mul_add(response_b, change[k], line_b[4 + k]);
        }
        l.scatter_lines(lines, a, line_a);
        l.scatter_lines(lines, b, line_b);
    }
}

#[inline(always)]
fn trial_impulses<L: Arithmetic>(
    l: L,
    lines: &[<L::T as LaneFloat>::Line],
    chunk: &BatchChunk<L::T>,
    from: usize,
    trials: &mut [TrialImpulse<L::V>; BATCHES_PER_STAGE],
) {
    let beta = l.splat(chunk.beta);
    let columns = chunk.batches.iter().zip(chunk.r).zip(&*chunk.previous).zip(trials);
    for (i, (((batch, r), previous), trial)) in columns.enumerate() {
        if from == 0 {
            chunk.later.prefetch_constants(l, i);
        }
        let (a, b) = pair!(from, batch);
        let [dx, dy, dz, w_n, sx, sy, sz, rotational_w] = l.relative_velocity(lines, a, b);
        let n = load_vector(l, from, &batch.n);
        let r = load_vector(l, from, &r.0);
        let before = load_vector(l, from, &previous.0);
        let y = triple!(i => l.mul_add(beta, l.sub(r[i], before[i]), r[i]));
        let arm = load_column(l, from, &batch.arm);
        let lever = triple!(i => l.mul(n[i], arm));
        // û = v_a - v_b + n x arm (R_a w_a + R_b w_b) + shift; the last number of a pair is the sum of R²/I.
        let mut u = cross_add(l, lever, [sx, sy, sz], [dx, dy, dz]);
        if let Some(tangential_shift) = chunk.tangential_shift.get(i) {
            let tangential_shift = load_vector(l, from, &tangential_shift.0);
            u = triple!(i => l.add(u[i], tangential_shift[i]));
        }
        let u_n = dot_product(l, n, [dx, dy, dz]);
        let w_t = l.mul_add(l.mul(arm, arm), rotational_w, w_n);
        let shift = load_column(l, from, &batch.shift);
        let (mut normal, tangential) = unprojected_impulse(l, FrozenContact { n, u, u_n, shift, r: y, w: [w_n, w_t] });
        if let Some(associated) = chunk.associated.get(i) {
            let stopping = l.sub(dot_product(l, n, y), l.div(l.add(u_n, shift), w_n));
            let (friction, share) = (load_column(l, from, &batch.friction), load_column(l, from, associated));
            normal = associated_normal(l, stopping, tangential, [w_n, w_t], friction, share);
        }
        *trial = TrialImpulse { tangential, normal, y, w_n };
    }
}

#[inline(always)]
fn project_impulses<L: Arithmetic>(
    l: L,
    chunk: &mut BatchChunk<L::T>,
    from: usize,
    buffers: &mut StageBuffers<L::V>,
    sums: &mut SweepSums<L::T>,
) {
    let BatchChunk { batches, later, r, previous, .. } = chunk;
    let StageBuffers { trials, changes } = buffers;
    let mut restart_product = load_column(l, from, &sums.restart_product);
    let mut change2 = load_column(l, from, &sums.change2);
    let columns = batches.iter().zip(*r).zip(&mut **previous).zip(&*trials).zip(changes);
    for (i, ((((batch, r), previous), trial), out)) in columns.enumerate() {
        if from == 0 {
            later.prefetch_impulses(l, i, 3);
        }
        let n = load_vector(l, from, &batch.n);
        let new = coulomb(l, n, trial.normal, trial.tangential, load_column(l, from, &batch.friction));
        let change = triple!(k => l.sub(new[k], trial.y[k]));
        let arm = load_column(l, from, &batch.arm);
        let lever = triple!(k => l.mul(n[k], arm));
        let turn = cross_product(l, change, lever);
        *out = ImpulseChange { impulse: change, turn };
        let r = load_vector(l, from, &r.0);
        for (stored, new) in previous.0.iter_mut().zip(new) {
            store_column(l, from, stored, new);
        }
        let change_of_r = triple!(k => l.sub(new[k], r[k]));
        restart_product = l.neg_mul_add(trial.w_n, dot_product(l, change, change_of_r), restart_product);
        change2 = l.add(dot_product(l, change, change), change2);
    }
    store_column(l, from, &mut sums.restart_product, restart_product);
    store_column(l, from, &mut sums.change2, change2);
}

/// One unknown a contact, r̂_n, kept as the first component; spheres do not turn.
#[inline(always)]
fn project_normal_impulses<L: Arithmetic>(
    l: L,
    halves: &[<L::T as LaneFloat>::Half],
    chunk: &mut BatchChunk<L::T>,
    from: usize,
    changes: &mut [ImpulseChange<L::V>; BATCHES_PER_STAGE],
    sums: &mut SweepSums<L::T>,
) {
    let BatchChunk { batches, later, r, previous, beta, .. } = chunk;
    let beta = l.splat(*beta);
    let mut restart_product = load_column(l, from, &sums.restart_product);
    let mut change2 = load_column(l, from, &sums.change2);
    for (i, (((batch, r), previous), out)) in batches.iter().zip(*r).zip(&mut **previous).zip(changes).enumerate() {
        if from == 0 {
            later.prefetch_constants(l, i);
            later.prefetch_impulses(l, i, 1);
        }
        let (a, b) = pair!(from, batch);
        let [dx, dy, dz, w_n] = l.relative_half_velocity(halves, a, b);
        let n = load_vector(l, from, &batch.n);
        let r = load_column(l, from, &r.0[0]);
        let y = l.mul_add(beta, l.sub(r, load_column(l, from, &previous.0[0])), r);
        let u_n = l.add(dot_product(l, n, [dx, dy, dz]), load_column(l, from, &batch.shift));
        let new = signorini(l, u_n, y, w_n);
        let change = l.sub(new, y);
        out.impulse = triple!(k => l.mul(n[k], change));
        store_column(l, from, &mut previous.0[0], new);
        restart_product = l.neg_mul_add(l.mul(w_n, change), l.sub(new, r), restart_product);
        change2 = l.mul_add(change, change, change2);
    }
    store_column(l, from, &mut sums.restart_product, restart_product);
    store_column(l, from, &mut sums.change2, change2);
}
