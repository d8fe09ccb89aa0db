//! Columns, units and sums that the layouts of all kinds of bodies share.

use pulp::NullaryFnOnce;
use rayon::prelude::*;

use crate::assemble::{ContactConstraint, ContactProblem, SolverBody};
use crate::math::lanes::{Arithmetic, F64Arithmetic, LaneFloat, SimdWidth};
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::solve::gauss_seidel::vector::{dot_product, triple};
use crate::solve::types::ContactReactions;

/// Contacts in a batch.
pub const BATCH_LANES: usize = 16;

/// Approximate number of bytes that stay in the L2 cache from one sweep to the next; larger problems are prefetched.
pub const L2_BYTES: usize = 1 << 20;

/// Index of a row, rank or line that is not there.
pub const NONE: u32 = u32::MAX;

/// Sums over the contacts of a sweep, by lane of the batch, so that their order is the same at all widths.
#[derive(Debug, Clone, Copy, Default)]
pub struct SweepSums<T = f64> {
    pub restart_product: [T; BATCH_LANES],
    pub change2: [T; BATCH_LANES],
}

impl<T: LaneFloat> SweepSums<T> {
    pub fn accumulate(&mut self, other: &Self) {
        for lane in 0..BATCH_LANES {
            self.restart_product[lane] = self.restart_product[lane] + other.restart_product[lane];
            self.change2[lane] = self.change2[lane] + other.change2[lane];
        }
    }

    /// Whether sum of w_n (y - r).(r - r_before) > 0, and the norm of all r - y.
    pub fn reduce(&self) -> (bool, f64) {
        let sum = |x: &[T; BATCH_LANES]| x.iter().map(|x| x.to_f64()).sum::<f64>();
        (sum(&self.restart_product) > 0.0, sum(&self.change2).sqrt())
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
    pub const SI: SweepUnits = SweepUnits { velocity: 1.0, impulse: 1.0 };

    /// Units for the rows `active`, which start from `reactions` and the velocities that result from them.
    pub fn from_problem(
        system: &ContactProblem,
        active: &[u32],
        reactions: &ContactReactions,
        records: &[SolverBody],
    ) -> SweepUnits {
        let of_row = |&k: &u32| {
            let (k, w) = (k as usize, system.rows[k as usize].w_n);
            (w, system.shifted_velocity(k, records).norm() + w * reactions.impulses[k].norm())
        };
        let largest = |a: (f64, f64), b: (f64, f64)| (a.0.max(b.0), a.1.max(b.1));
        let (w, u) = active.par_iter().with_min_len(PAR_MIN_LEN).map(of_row).reduce(|| (0.0, 0.0), largest);
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
    pub n: [[f64; BATCH_LANES]; 3],
    pub friction: [f64; BATCH_LANES],
}

impl FrictionCones {
    pub const NONE: Self = FrictionCones { n: [[0.0; BATCH_LANES]; 3], friction: [0.0; BATCH_LANES] };

    pub fn set_lane(&mut self, lane: usize, row: &ContactConstraint) {
        set_lane(&mut self.n, lane, &row.normal);
        self.friction[lane] = row.friction;
    }
}

/// Rounding of an impulse in single precision over its normal part: some units in the last place of each component.
const F32_ROUNDING: f64 = 1e-6;

/// Converts impulses of single precision: those on the side of their cone to the rounding of single precision are moved onto
/// it to that of double precision.
pub fn snap_to_cones(width: SimdWidth, cones: &FrictionCones, r: &mut [[f64; BATCH_LANES]; 3]) {
    match width {
        SimdWidth::One(l) => l.run(SnapToCones { l, cones, r }),
        #[cfg(target_arch = "x86_64")]
        SimdWidth::Four(l) => l.run(SnapToCones { l, cones, r }),
        #[cfg(target_arch = "x86_64")]
        SimdWidth::Eight(l) => l.run(SnapToCones { l, cones, r }),
    }
}

struct SnapToCones<'a, L> {
    l: L,
    cones: &'a FrictionCones,
    r: &'a mut [[f64; BATCH_LANES]; 3],
}

impl<L: F64Arithmetic> NullaryFnOnce for SnapToCones<'_, L> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let SnapToCones { l, cones, r } = self;
        for from in (0..BATCH_LANES).step_by(L::WIDTH) {
            let n = triple!(k => l.load(&cones.n[k][from..]));
            let whole = triple!(k => l.load(&r[k][from..]));
            let normal = dot_product(l, n, whole);
            let tangential = triple!(k => l.sub(whole[k], l.mul(n[k], normal)));
            let size = l.sqrt(dot_product(l, tangential, tangential));
            let bound = l.mul(l.load(&cones.friction[from..]), normal);
            let least = l.sub(bound, l.mul(l.splat(F32_ROUNDING), l.abs(normal)));
            let (zero, share) = (l.splat(0.0), l.div(bound, size));
            for k in 0..3 {
                let on_side = l.add(l.mul(n[k], normal), l.mul(tangential[k], share));
                let slides = l.select_greater(size, zero, on_side, whole[k]);
                l.store(&mut r[k][from..], l.select_greater(size, least, slides, whole[k]));
            }
        }
    }
}

pub fn set_lane<T: LaneFloat>(columns: &mut [[T; BATCH_LANES]; 3], lane: usize, v: &Vec3) {
    columns[0][lane] = T::from_f64(v.x);
    columns[1][lane] = T::from_f64(v.y);
    columns[2][lane] = T::from_f64(v.z);
}
