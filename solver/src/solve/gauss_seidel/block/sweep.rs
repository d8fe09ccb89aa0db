//! One Gauss-Seidel sweep over the batches of pairs, with momentum.

use pulp::NullaryFnOnce;

use crate::assemble::ContactProblem;
use crate::math::simd::{Arithmetic, DoubleWidth, F64Arithmetic, LaneFloat, LaneOperation, SimdWidth};
use crate::solve::gauss_seidel::block::batches::{
    BlockProblem, BodyNumbers, BodyPairBatch, FrictionalImpulses, FrictionalPoint, FrictionlessPoint, LeverColumns,
    NormalImpulses, PairBatches, PairContacts, PairGroup,
};
use crate::solve::gauss_seidel::block::local::{LocalBlock, signorini_coulomb_block};
use crate::solve::gauss_seidel::blocked::SweepOperations;
use crate::solve::gauss_seidel::packed::{
    ApplyMomentum, BATCH_LANES, L2_BYTES, PackedProblem, SweepStats, SweepSums, load_column, load_vector, store_column,
};
use crate::solve::gauss_seidel::rolling::{RollingConstraintWide, RollingContacts};
use crate::solve::gauss_seidel::vector::{cross_add, dot_product, triple};
use crate::solve::types::ContactReactions;

impl<C: PairSweepKernel> PackedProblem for BlockProblem<C> {
    fn sweep_contacts(&mut self, width: SimdWidth, beta: f64) -> SweepStats {
        width.dispatch(BlockSweep { problem: self, beta })
    }

    fn read_back(&self, width: SimdWidth, contact_problem: &ContactProblem, reactions: &mut ContactReactions) {
        self.read_back_reactions(width, contact_problem, reactions);
    }
}

/// One sweep of a problem with the momentum `beta`.
struct BlockSweep<'a, C: PairContacts> {
    problem: &'a mut BlockProblem<C>,
    beta: f64,
}

impl<C: PairSweepKernel> LaneOperation for BlockSweep<'_, C> {
    type Output = SweepStats;

    fn call<L: F64Arithmetic>(self, l: L) -> SweepStats {
        let l = C::T::lanes(l);
        // At most as many lanes as a batch has.
        if const { <C::T as LaneFloat>::Lanes::<L>::WIDTH < BATCH_LANES } {
            self.sweep_with(DoubleWidth(l))
        } else {
            self.sweep_with(l)
        }
    }
}

impl<C: PairSweepKernel> BlockSweep<'_, C> {
    fn sweep_with<L: Arithmetic<T = C::T>>(self, lanes: L) -> SweepStats {
        let BlockSweep { problem: BlockProblem { units, bodies }, beta } = self;
        let points: usize = bodies.groups().map(|group| group.batches.points.len()).sum();
        let exceeds_l2 = points * size_of::<(C, C::Impulses)>() > L2_BYTES;
        bodies.sweep_once(&BlockOperations { lanes, beta, exceeds_l2 }).reduce(*units)
    }
}

/// Operations of a sweep on blocks and borders.
struct BlockOperations<L> {
    lanes: L,
    /// Momentum, dimensionless.
    beta: f64,
    /// Whether the problem exceeds the L2 cache.
    exceeds_l2: bool,
}

impl<L: Arithmetic, C: PairSweepKernel<T = L::T>> SweepOperations<BodyNumbers<L::T>, PairGroup<C>, L::T>
    for BlockOperations<L>
{
    fn apply_momentum(&self, lines: &mut [BodyNumbers<L::T>], last: &[BodyNumbers<L::T>]) {
        let (l, beta) = (self.lanes, self.beta);
        l.run(ApplyMomentum { l, numbers: lines.as_flattened_mut(), last: last.as_flattened(), beta });
    }

    fn sweep_group(&self, lines: &mut [BodyNumbers<L::T>], group: &mut PairGroup<C>) -> SweepSums<L::T> {
        let &BlockOperations { lanes, beta, exceeds_l2 } = self;
        let PairGroup { inertia, batches } = group;
        let mut sums = SweepSums::default();
        lanes.run(SweepBatches { lanes, lines, inertia, batches, beta, exceeds_l2, sums: &mut sums });
        sums
    }
}

/// Sweep of the pairs of a block or border.
struct SweepBatches<'a, L, C: PairContacts> {
    lanes: L,
    /// Lines of velocities of the bodies, which the batches index; see [`BlockProblem`].
    lines: &'a mut [BodyNumbers<C::T>],
    /// Lines of inverse inertia of the same bodies.
    inertia: &'a [BodyNumbers<C::T>],
    batches: &'a mut PairBatches<C>,
    /// Momentum, dimensionless.
    beta: f64,
    /// Whether the problem exceeds the L2 cache.
    exceeds_l2: bool,
    sums: &'a mut SweepSums<C::T>,
}

impl<L: Arithmetic, C: PairSweepKernel<T = L::T>> NullaryFnOnce for SweepBatches<'_, L, C> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let SweepBatches { lanes, lines, inertia, batches, beta, exceeds_l2, sums } = self;
        let PairBatches { batches, points, impulses, rolls, levers, .. } = batches;
        for batch in batches.iter() {
            let [first, end] = batch.points;
            for from in (0..BATCH_LANES).step_by(L::WIDTH) {
                let (impulses, later) = impulses[first..].split_at_mut(end - first);
                let later = (&points[end..], &*later);
                let points = &points[first..end];
                let rolls = rolls.get_mut(first..end).unwrap_or_default();
                let levers = if batch.has_levers { &levers[first..end] } else { &[] };
                let pairs = PairLanes { batch, points, impulses, later, rolls, levers, from };
                match (batch.has_locked_axes, exceeds_l2) {
                    (true, true) => solve_pairs::<true, true, _, _>(lanes, lines, inertia, pairs, beta, sums),
                    (true, false) => solve_pairs::<true, false, _, _>(lanes, lines, inertia, pairs, beta, sums),
                    (false, true) => solve_pairs::<false, true, _, _>(lanes, lines, inertia, pairs, beta, sums),
                    (false, false) => solve_pairs::<false, false, _, _>(lanes, lines, inertia, pairs, beta, sums),
                }
            }
        }
    }
}

/// Velocities of the two bodies of a pair, candidate a and antagonist b, and their response to impulses.
pub struct PairVelocities<V> {
    /// Velocities, m/s, and angular velocities, rad/s.
    va: [V; 3],
    wa: [V; 3],
    vb: [V; 3],
    wb: [V; 3],
    /// Inverse masses, 1/kg.
    inverse_mass: [V; 2],
    /// 1 for each fixed axis along which impulses move them, else 0.
    free_axes: [[V; 3]; 2],
    /// Inverse inertia xx, xy, xz, yy, yz, zz, 1/(kg m²), in the first six numbers.
    inertia: [[V; 8]; 2],
}

/// Sums over the contacts of each lane, see [`SweepSums`].
pub struct LaneSums<V> {
    restart_product: V,
    change2: V,
}

/// Operations of a sweep on the contacts of a batch.
pub trait PairSweepKernel: PairContacts {
    /// Solves the contacts of the `WIDTH` pairs from lane `from` on, from y = r + beta (r - r_before), and applies the change to
    /// the bodies at once. If `HELD`, impulses move some of the bodies along only some axes.
    #[expect(clippy::too_many_arguments, reason = "constants, values and sums of the contacts of a batch")]
    fn solve_contacts<const HELD: bool, L: Arithmetic<T = Self::T>>(
        &self,
        l: L,
        values: &mut Self::Impulses,
        levers: Option<&LeverColumns<Self::T>>,
        from: usize,
        beta: L::V,
        pair: &mut PairVelocities<L::V>,
        sums_of_lanes: &mut LaneSums<L::V>,
    );

    /// Normals, world frame, and r̂_n and |r_T|, N s, of the contacts from lane `from` on.
    fn impulse_parts<L: Arithmetic<T = Self::T>>(
        &self,
        l: L,
        values: &Self::Impulses,
        from: usize,
    ) -> ([L::V; 3], [L::V; 2]);
}

/// The part of a vector that acts on each of the two bodies.
#[inline(always)]
fn mask_axes<const HELD: bool, L: Arithmetic>(l: L, free_axes: &[[L::V; 3]; 2], x: [L::V; 3]) -> [[L::V; 3]; 2] {
    if HELD { [triple!(k => l.mul(x[k], free_axes[0][k])), triple!(k => l.mul(x[k], free_axes[1][k]))] } else { [x, x] }
}

/// I⁻¹ a + c, with I⁻¹ given by its six numbers.
#[inline(always)]
fn apply_inverse_inertia<L: Arithmetic>(l: L, m: [L::V; 8], a: [L::V; 3], c: [L::V; 3]) -> [L::V; 3] {
    [
        l.mul_add(m[0], a[0], l.mul_add(m[1], a[1], l.mul_add(m[2], a[2], c[0]))),
        l.mul_add(m[1], a[0], l.mul_add(m[3], a[1], l.mul_add(m[4], a[2], c[1]))),
        l.mul_add(m[2], a[0], l.mul_add(m[4], a[1], l.mul_add(m[5], a[2], c[2]))),
    ]
}

impl<T: LaneFloat> PairSweepKernel for FrictionalPoint<T> {
    #[inline(always)]
    fn solve_contacts<const HELD: bool, L: Arithmetic<T = T>>(
        &self,
        l: L,
        values: &mut FrictionalImpulses<T>,
        levers: Option<&LeverColumns<T>>,
        from: usize,
        beta: L::V,
        pair: &mut PairVelocities<L::V>,
        sums_of_lanes: &mut LaneSums<L::V>,
    ) {
        let PairVelocities { va, wa, vb, wb, inverse_mass, free_axes, inertia } = pair;
        let axes = [
            load_vector(l, from, &self.axes[0]),
            load_vector(l, from, &self.axes[1]),
            load_vector(l, from, &self.axes[2]),
        ];
        let (arm_a, arm_b) = (load_vector(l, from, &self.arms[0]), load_vector(l, from, &self.arms[1]));
        let (ua, ub) = (cross_add(l, *wa, arm_a, *va), cross_add(l, *wb, arm_b, *vb));
        let between = triple!(k => l.sub(ua[k], ub[k]));
        let mut u = triple!(k => l.add(dot_product(l, axes[k], between), load_column(l, from, &self.shift[k])));
        let levers = levers.map(|levers| [load_column(l, from, &levers[0]), load_column(l, from, &levers[1])]);
        if let Some([t, s]) = levers {
            let spin = dot_product(l, axes[0], triple!(k => l.sub(wa[k], wb[k])));
            (u[1], u[2]) = (l.mul_add(t, spin, u[1]), l.mul_add(s, spin, u[2]));
        }
        let r = load_vector(l, from, &values.r);
        let before = load_vector(l, from, &values.previous);
        let y = triple!(k => l.mul_add(beta, l.sub(r[k], before[k]), r[k]));
        let block = LocalBlock {
            inverse_nn: load_column(l, from, &self.inverse_nn),
            c: [load_column(l, from, &self.c[0]), load_column(l, from, &self.c[1])],
            s: [load_column(l, from, &self.s[0]), load_column(l, from, &self.s[1])],
            inverse_s: [load_column(l, from, &self.inverse_s[0]), load_column(l, from, &self.inverse_s[1])],
            friction: load_column(l, from, &self.friction),
        };
        let (new, multiplier) = signorini_coulomb_block(l, &block, u, y, load_column(l, from, &values.multiplier));
        for k in 0..3 {
            store_column(l, from, &mut values.previous[k], r[k]);
            store_column(l, from, &mut values.r[k], new[k]);
        }
        store_column(l, from, &mut values.multiplier, multiplier);
        let change = triple!(k => l.sub(new[k], y[k]));
        let world = triple!(k => l.mul_add(axes[0][k], change[0], l.mul_add(axes[1][k], change[1], l.mul(axes[2][k], change[2]))));
        let zero = [l.splat(0.0); 3];
        let (mut couple_a, mut couple_b) = (zero, zero);
        if let Some([t, s]) = levers {
            let couple = l.mul_add(t, change[1], l.mul(s, change[2]));
            couple_a = triple!(k => l.mul(axes[0][k], couple));
            couple_b = triple!(k => l.sub(zero[k], couple_a[k]));
        }
        let [to_a, to_b] = mask_axes::<HELD, L>(l, free_axes, world);
        *va = triple!(k => l.mul_add(to_a[k], inverse_mass[0], va[k]));
        *vb = triple!(k => l.neg_mul_add(to_b[k], inverse_mass[1], vb[k]));
        *wa = apply_inverse_inertia(l, inertia[0], cross_add(l, arm_a, world, couple_a), *wa);
        *wb = apply_inverse_inertia(l, inertia[1], cross_add(l, world, arm_b, couple_b), *wb);
        let change_of_r = triple!(k => l.sub(new[k], r[k]));
        sums_of_lanes.restart_product = l.neg_mul_add(
            load_column(l, from, &self.weight),
            dot_product(l, change, change_of_r),
            sums_of_lanes.restart_product,
        );
        sums_of_lanes.change2 = l.add(dot_product(l, change, change), sums_of_lanes.change2);
    }

    #[inline(always)]
    fn impulse_parts<L: Arithmetic<T = T>>(
        &self,
        l: L,
        values: &FrictionalImpulses<T>,
        from: usize,
    ) -> ([L::V; 3], [L::V; 2]) {
        let [normal, t, s] = load_vector(l, from, &values.r);
        (load_vector(l, from, &self.axes[0]), [normal, l.sqrt(l.mul_add(t, t, l.mul(s, s)))])
    }
}

impl<T: LaneFloat> PairSweepKernel for FrictionlessPoint<T> {
    #[inline(always)]
    fn solve_contacts<const HELD: bool, L: Arithmetic<T = T>>(
        &self,
        l: L,
        values: &mut NormalImpulses<T>,
        _: Option<&LeverColumns<T>>,
        from: usize,
        beta: L::V,
        pair: &mut PairVelocities<L::V>,
        sums_of_lanes: &mut LaneSums<L::V>,
    ) {
        let PairVelocities { va, wa, vb, wb, inverse_mass, free_axes, .. } = pair;
        let n = load_vector(l, from, &self.normal);
        let between = triple!(k => l.sub(va[k], vb[k]));
        let turning_velocity = l.sub(
            dot_product(l, *wa, load_vector(l, from, &self.arms[0])),
            dot_product(l, *wb, load_vector(l, from, &self.arms[1])),
        );
        let u = l.add(l.add(dot_product(l, n, between), turning_velocity), load_column(l, from, &self.shift));
        let (r, before) = (load_column(l, from, &values.r), load_column(l, from, &values.previous));
        let y = l.mul_add(beta, l.sub(r, before), r);
        let (zero, free) = (l.splat(0.0), l.neg_mul_add(u, load_column(l, from, &self.inverse_nn), y));
        // Infinite or NaN impulses are rejected.
        let new = l.select_greater(free, zero, l.select_greater(l.splat(f64::MAX), free, free, zero), zero);
        store_column(l, from, &mut values.previous, r);
        store_column(l, from, &mut values.r, new);
        let change = l.sub(new, y);
        let (push_a, push_b) = (l.mul(change, inverse_mass[0]), l.mul(change, inverse_mass[1]));
        let [to_a, to_b] = mask_axes::<HELD, L>(l, free_axes, n);
        *va = triple!(k => l.mul_add(to_a[k], push_a, va[k]));
        *vb = triple!(k => l.neg_mul_add(to_b[k], push_b, vb[k]));
        *wa = triple!(k => l.mul_add(load_column(l, from, &self.answers[0][k]), change, wa[k]));
        *wb = triple!(k => l.neg_mul_add(load_column(l, from, &self.answers[1][k]), change, wb[k]));
        sums_of_lanes.restart_product = l.neg_mul_add(
            l.mul(load_column(l, from, &self.weight), change),
            l.sub(new, r),
            sums_of_lanes.restart_product,
        );
        sums_of_lanes.change2 = l.mul_add(change, change, sums_of_lanes.change2);
    }

    #[inline(always)]
    fn impulse_parts<L: Arithmetic<T = T>>(
        &self,
        l: L,
        values: &NormalImpulses<T>,
        from: usize,
    ) -> ([L::V; 3], [L::V; 2]) {
        (load_vector(l, from, &self.normal), [load_column(l, from, &values.r), l.splat(0.0)])
    }
}

/// The `WIDTH` pairs of a batch from lane `from` on, with their contacts.
struct PairLanes<'a, C: PairContacts> {
    batch: &'a BodyPairBatch,
    points: &'a [C],
    impulses: &'a mut [C::Impulses],
    /// Points that are swept after them, to prefetch.
    later: (&'a [C], &'a [C::Impulses]),
    /// Rolling constraints by point; empty if there are none.
    rolls: &'a mut [RollingConstraintWide<C::T>],
    /// Friction levers by point; empty if all are 0.
    levers: &'a [LeverColumns<C::T>],
    /// First lane.
    from: usize,
}

/// Solves the contacts of pairs. If `HELD`, impulses move some of the bodies along only some axes.
///
/// If the problem is `FAR`, the next points are prefetched, a little at a time: memory is faster if it need not wait for
/// arithmetic.
#[inline(always)]
fn solve_pairs<const HELD: bool, const FAR: bool, L: Arithmetic, C: PairSweepKernel<T = L::T>>(
    l: L,
    lines: &mut [BodyNumbers<L::T>],
    inertia: &[BodyNumbers<L::T>],
    pairs: PairLanes<C>,
    beta: f64,
    sums: &mut SweepSums<L::T>,
) {
    let PairLanes { batch, points, impulses, later, rolls, levers, from } = pairs;
    let lanes_of_batch = from..from + L::WIDTH;
    let beta = l.splat(beta);
    let line_indices = [&batch.bodies[0][lanes_of_batch.clone()], &batch.bodies[1][lanes_of_batch]];
    let a = l.gather_lines(lines, line_indices[0]);
    let b = l.gather_lines(lines, line_indices[1]);
    let (inertia_a, inertia_b) = (l.gather_lines(inertia, line_indices[0]), l.gather_lines(inertia, line_indices[1]));
    let free_axes = [[a[7], inertia_a[6], inertia_a[7]], [b[7], inertia_b[6], inertia_b[7]]];
    let mut pair = PairVelocities {
        va: [a[0], a[1], a[2]],
        wa: [a[4], a[5], a[6]],
        vb: [b[0], b[1], b[2]],
        wb: [b[4], b[5], b[6]],
        inverse_mass: [a[3], b[3]],
        free_axes,
        inertia: [inertia_a, inertia_b],
    };
    let mut sums_of_lanes = LaneSums {
        restart_product: load_column(l, from, &sums.restart_product),
        change2: load_column(l, from, &sums.change2),
    };
    let mut rolls = rolls.iter_mut();
    for (i, (point, values)) in points.iter().zip(impulses).enumerate() {
        if FAR && from == 0 && i < later.0.len() {
            l.prefetch(&later.0[i]);
            l.prefetch(&later.1[i]);
        }
        point.solve_contacts::<HELD, L>(l, values, levers.get(i), from, beta, &mut pair, &mut sums_of_lanes);
        if let Some(rolls) = rolls.next() {
            let (n, [normal_impulse, tangential_impulse]) = point.impulse_parts(l, values, from);
            let w = triple!(k => l.sub(pair.wa[k], pair.wb[k]));
            let contacts = RollingContacts { n, normal_impulse, tangential_impulse, w };
            let change = rolls.solve_moments(l, from, beta, contacts);
            let zero = l.splat(0.0);
            pair.wa = apply_inverse_inertia(l, pair.inertia[0], change, pair.wa);
            pair.wb = apply_inverse_inertia(l, pair.inertia[1], triple!(k => l.sub(zero, change[k])), pair.wb);
        }
    }
    store_column(l, from, &mut sums.restart_product, sums_of_lanes.restart_product);
    store_column(l, from, &mut sums.change2, sums_of_lanes.change2);
    let PairVelocities { va, wa, vb, wb, .. } = pair;
    l.scatter_lines(lines, line_indices[0], [va[0], va[1], va[2], a[3], wa[0], wa[1], wa[2], a[7]]);
    l.scatter_lines(lines, line_indices[1], [vb[0], vb[1], vb[2], b[3], wb[0], wb[1], wb[2], b[7]]);
}
