//! Interface of the layouts, and the columns, units and sums that they share.

use pulp::NullaryFnOnce;
use rayon::prelude::*;

use crate::assemble::{ContactConstraint, ContactProblem, SolverBody};
use crate::math::simd::{Arithmetic, F64Arithmetic, LaneFloat, LaneOperation, SimdWidth};
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::ranks::lists::max_over_ranks;
use crate::solve::gauss_seidel::vector::{LaneVector, dot_product, triple};
use crate::solve::types::ContactReactions;
use crate::state::ContactId;

/// Number of contacts in a batch.
pub const BATCH_LANES: usize = 16;

/// Approximate number of bytes that stay in the L2 cache from one sweep to the next; larger problems are prefetched.
pub const L2_BYTES: usize = 1 << 20;

/// Index in place of a row, body or line that does not exist.
pub const NO_INDEX: u32 = u32::MAX;

/// Rows of the system in the lanes of a batch, or [`NO_INDEX`].
pub type LaneRows = [u32; BATCH_LANES];

/// The rows of a step packed for sweeps, with the data that sweeps change. Each layout of bodies and contacts implements it;
/// a call per sweep chooses the layout and the width of its vectors.
pub trait PackedProblem: Send {
    /// Sweeps all contacts once, each from y = r + beta (r - r_before).
    fn sweep_contacts(&mut self, width: SimdWidth, beta: f64) -> SweepStats;

    /// Copies the impulses and moments of the swept rows, which belong to `problem`, into `reactions`.
    fn read_back(&self, width: SimdWidth, problem: &ContactProblem, reactions: &mut ContactReactions);
}

/// Statistics of a sweep.
#[derive(Debug, Clone, Copy)]
pub struct SweepStats {
    /// Whether the last change points against the momentum: sum of w_n (y - r).(r - r_before) > 0.
    pub needs_restart: bool,
    /// Norm of all r - y, N s.
    pub change: f64,
}

/// Input for packing: the rows to sweep, and the state from which the sweeps start.
#[derive(Clone, Copy)]
pub struct PackSource<'a> {
    pub problem: &'a ContactProblem,
    /// Rows to sweep, sorted.
    pub active: &'a [ContactId],
    /// Initial impulses and moments.
    pub reactions: &'a ContactReactions,
    /// Bodies with the velocities that result from them.
    pub solver_bodies: &'a [SolverBody],
    pub width: SimdWidth,
    /// Whether each row of the problem is solved with the associated law; empty if none is. Only for spheres and plates.
    pub associated: &'a [bool],
}

/// Sums over the contacts of a sweep, by lane of the batch, so that their order is the same at all widths.
#[derive(Debug, Clone, Copy, Default)]
pub struct SweepSums<T = f64> {
    /// Sums of w_n (y - r).(r - r_before), see [`SweepStats::needs_restart`].
    pub restart_product: [T; BATCH_LANES],
    /// Sums of |r - y|².
    pub change2: [T; BATCH_LANES],
}

impl<T: LaneFloat> SweepSums<T> {
    /// Adds other sums, lane by lane.
    pub fn accumulate(&mut self, other: &Self) {
        for lane in 0..BATCH_LANES {
            self.restart_product[lane] = self.restart_product[lane] + other.restart_product[lane];
            self.change2[lane] = self.change2[lane] + other.change2[lane];
        }
    }

    /// Statistics of a sweep in these units.
    pub fn reduce(&self, units: SweepUnits) -> SweepStats {
        let sum = |x: &[T; BATCH_LANES]| x.iter().map(|x| x.to_f64()).sum::<f64>();
        let change = sum(&self.change2).sqrt() * units.impulse;
        SweepStats { needs_restart: sum(&self.restart_product) > 0.0, change }
    }
}

/// Beginning of a sweep: velocities are linear in the impulses, so momentum takes one pass over the numbers of the bodies.
pub struct ApplyMomentum<'a, L: Arithmetic> {
    pub l: L,
    /// Numbers of the bodies' lines before the last sweep, replaced by y + beta (y - before) with y after it; masses do not change.
    pub numbers: &'a mut [L::T],
    /// Numbers after the last sweep.
    pub last: &'a [L::T],
    pub beta: f64,
}

impl<L: Arithmetic> NullaryFnOnce for ApplyMomentum<'_, L> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let l = self.l;
        let beta = l.splat(self.beta);
        let mut numbers = self.numbers.chunks_exact_mut(L::WIDTH);
        let mut last = self.last.chunks_exact(L::WIDTH);
        for (numbers, last) in (&mut numbers).zip(&mut last) {
            let (before, now) = (l.load(numbers), l.load(last));
            l.store(numbers, l.mul_add(beta, l.sub(now, before), now));
        }
        for (number, now) in numbers.into_remainder().iter_mut().zip(last.remainder()) {
            *number = L::T::from_f64(self.beta).fused_mul_add(*now - *number, *now);
        }
    }
}

/// Units of the numbers in the sweeps.
///
/// In single precision they are powers of two near the largest numbers, so that squares neither overflow nor vanish and
/// scaling causes no rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweepUnits {
    /// Unit of velocity, m/s.
    pub velocity: f64,
    /// Unit of impulse, N s.
    pub impulse: f64,
}

impl SweepUnits {
    /// SI units, of sweeps in double precision.
    pub const SI: SweepUnits = SweepUnits { velocity: 1.0, impulse: 1.0 };

    /// Units for sweeps in precision `T`; `is_divided`: whether other ranks have other rows of the problem.
    pub fn from_source<T: LaneFloat>(source: &PackSource, is_divided: bool) -> SweepUnits {
        if !T::IS_SINGLE {
            return SweepUnits::SI;
        }
        let PackSource { problem, active, reactions, solver_bodies, .. } = *source;
        let magnitudes = |k: &ContactId| {
            let (k, w) = (k.index(), problem.delassus_diagonal(k.index()).0);
            (w, problem.shifted_velocity(k, solver_bodies).norm() + w * reactions.impulses[k].norm())
        };
        let larger_of_each = |a: (f64, f64), b: (f64, f64)| (a.0.max(b.0), a.1.max(b.1));
        let (mut w, mut u) =
            active.par_iter().with_min_len(PAR_MIN_LEN).map(magnitudes).reduce(|| (0.0, 0.0), larger_of_each);
        if is_divided {
            (w, u) = (max_over_ranks(w), max_over_ranks(u));
        }
        let velocity = power_of_two(u);
        SweepUnits { velocity, impulse: velocity / power_of_two(w) }
    }

    /// Unit of mass, kg.
    pub fn mass_unit(&self) -> f64 {
        self.impulse / self.velocity
    }
}

/// Largest power of two that is not above `x`; 1 if there is none.
fn power_of_two(x: f64) -> f64 {
    let power = f64::from_bits(x.to_bits() & f64::INFINITY.to_bits());
    if power.is_normal() { power } else { 1.0 }
}

/// Normals and friction of the contacts of a batch, in double precision for any precision of the sweeps.
#[derive(Debug, Clone, Copy)]
pub struct FrictionCones {
    /// Unit normals, world frame; 0 in unused lanes.
    pub n: [[f64; BATCH_LANES]; 3],
    /// Coefficients mu.
    pub friction: [f64; BATCH_LANES],
}

impl FrictionCones {
    /// Cones of no contacts.
    pub const NONE: Self = FrictionCones { n: [[0.0; BATCH_LANES]; 3], friction: [0.0; BATCH_LANES] };

    /// Sets the cone of `row` in a lane.
    pub fn set_lane(&mut self, lane: usize, row: &ContactConstraint) {
        set_lane(&mut self.n, lane, &row.normal);
        self.friction[lane] = row.friction;
    }
}

/// Rounding of an impulse in single precision, divided by its normal part: some units in the last place of each
/// component.
const F32_ROUNDING: f64 = 1e-6;

/// Moves the impulses `r` that single precision has put on the surface of their friction cone, to its rounding, onto the
/// surface in double precision.
pub fn snap_to_cones(width: SimdWidth, cones: &FrictionCones, r: &mut [[f64; BATCH_LANES]; 3]) {
    width.run(SnapToCones { cones, r });
}

/// Operation of [`snap_to_cones`].
struct SnapToCones<'a> {
    cones: &'a FrictionCones,
    /// Impulses, world frame: x of all lanes, then y, then z; N s.
    r: &'a mut [[f64; BATCH_LANES]; 3],
}

impl LaneOperation for SnapToCones<'_> {
    type Output = ();

    #[inline(always)]
    fn call<L: F64Arithmetic>(self, l: L) {
        let SnapToCones { cones, r } = self;
        for from in (0..BATCH_LANES).step_by(L::WIDTH) {
            let (n, impulse) = (load_vector(l, from, &cones.n), load_vector(l, from, r));
            let normal = dot_product(l, n, impulse);
            let tangential = triple!(k => l.sub(impulse[k], l.mul(n[k], normal)));
            let tangential_length = l.sqrt(dot_product(l, tangential, tangential));
            let bound = l.mul(load_column(l, from, &cones.friction), normal);
            let lower_bound = l.sub(bound, l.mul(l.splat(F32_ROUNDING), l.abs(normal)));
            let (zero, share) = (l.splat(0.0), l.div(bound, tangential_length));
            for k in 0..3 {
                let on_cone = l.add(l.mul(n[k], normal), l.mul(tangential[k], share));
                let slides = l.select_greater(tangential_length, zero, on_cone, impulse[k]);
                l.store(&mut r[k][from..], l.select_greater(tangential_length, lower_bound, slides, impulse[k]));
            }
        }
    }
}

/// Numbers of a column from lane `from` on.
#[inline(always)]
pub fn load_column<L: Arithmetic>(l: L, from: usize, column: &[L::T; BATCH_LANES]) -> L::V {
    l.load(&column[from..from + L::WIDTH])
}

/// [`load_column`] for the three columns of a vector.
#[inline(always)]
pub fn load_vector<L: Arithmetic>(l: L, from: usize, columns: &[[L::T; BATCH_LANES]; 3]) -> LaneVector<L::V> {
    triple!(k => load_column(l, from, &columns[k]))
}

/// Writes a vector into a column from lane `from` on.
#[inline(always)]
pub fn store_column<L: Arithmetic>(l: L, from: usize, column: &mut [L::T; BATCH_LANES], v: L::V) {
    l.store(&mut column[from..from + L::WIDTH], v);
}

/// Writes one vector into a lane of three columns.
pub fn set_lane<T: LaneFloat>(columns: &mut [[T; BATCH_LANES]; 3], lane: usize, v: &Vec3) {
    columns[0][lane] = T::from_f64(v.x);
    columns[1][lane] = T::from_f64(v.y);
    columns[2][lane] = T::from_f64(v.z);
}
