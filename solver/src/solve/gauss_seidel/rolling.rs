//! Moments of contacts, by rolling and spinning friction or by bonds: the moment of a contact is bounded by its impulse.
//!
//! With the other impulses frozen, the moment m of two bodies acts on their relative angular velocity w = W_r m + b, with W_r
//! = 1/I_a + 1/I_b for spheres. Its part in the tangent plane resists rolling and is at most mu_r R r̂_n, its part along n
//! resists spinning and is at most mu_s R r̂_n. Below these bounds the contact does not roll or spin; at them the moment is
//! opposite to w_T, or to w_n. It is solved as Coulomb's law of sliding friction, with r̂ of the same contact, just solved. In a
//! bond shear and torsion share one strength: there the second bound is smaller by a share of R |r_T|.
//!
//! This code is not used for scenes without such contacts.

use crate::assemble::ContactProblem;
use crate::math::Vec3;
use crate::math::simd::{Arithmetic, LaneFloat};
use crate::solve::gauss_seidel::packed::{BATCH_LANES, NO_INDEX, load_column, load_vector, set_lane, store_column};
use crate::solve::gauss_seidel::vector::{LaneVector, dot_product, project_to_ball, triple};
use crate::state::ContactId;

/// State of the contacts in the lanes of a vector on which their moments depend.
pub struct RollingContacts<V> {
    /// Normals, world frame.
    pub n: LaneVector<V>,
    /// r̂_n, N s.
    pub normal_impulse: V,
    /// |r_T|, N s.
    pub tangential_impulse: V,
    /// Angular velocity of the candidate relative to the antagonist, world frame, rad/s.
    pub w: LaneVector<V>,
}

/// Resistance of sixteen contacts to rolling and spinning, [`crate::assemble::RollingConstraint`], and their moments.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct RollingConstraintWide<T = f64> {
    /// Shift of the relative angular velocity, rad/s.
    shift: [[T; BATCH_LANES]; 3],
    /// Inverse of W_r, kg m²; 0 for contacts without resistance, as all other data.
    inverse_w: [T; BATCH_LANES],
    /// Largest ratios to the normal impulse of the moments against rolling and against spinning, m.
    rolling: [T; BATCH_LANES],
    spinning: [T; BATCH_LANES],
    /// Loss of the largest moment against spinning over the tangential impulse, m.
    shear: [T; BATCH_LANES],
    /// Moments on the candidates of the last sweep and of the one before, N m s.
    m: [[T; BATCH_LANES]; 3],
    previous: [[T; BATCH_LANES]; 3],
    /// Index of the system's rolling constraint, or [`NO_INDEX`].
    indices: [u32; BATCH_LANES],
}

impl<T: LaneFloat> RollingConstraintWide<T> {
    /// Sixteen contacts without resistance.
    pub const NONE: Self = RollingConstraintWide {
        shift: [[T::ZERO; BATCH_LANES]; 3],
        inverse_w: [T::ZERO; BATCH_LANES],
        rolling: [T::ZERO; BATCH_LANES],
        spinning: [T::ZERO; BATCH_LANES],
        shear: [T::ZERO; BATCH_LANES],
        m: [[T::ZERO; BATCH_LANES]; 3],
        previous: [[T::ZERO; BATCH_LANES]; 3],
        indices: [NO_INDEX; BATCH_LANES],
    };

    /// Sets the resistance of row `k` in a lane, if the row has one, with its initial moment.
    #[inline(never)] // so that its cost in scenes can be counted
    pub fn set_lane(&mut self, lane: usize, problem: &ContactProblem, k: ContactId, moments: &[Vec3]) {
        let Ok(index) = problem.rolling_constraints.binary_search_by_key(&k, |roll| roll.row) else { return };
        let (roll, m) = (&problem.rolling_constraints[index], &moments[index]);
        set_lane(&mut self.shift, lane, &roll.shift);
        self.inverse_w[lane] = T::from_f64(roll.inverse_w);
        self.rolling[lane] = T::from_f64(roll.rolling * roll.radius);
        self.spinning[lane] = T::from_f64(roll.spinning * roll.radius);
        self.shear[lane] = T::from_f64(roll.shear * roll.radius);
        set_lane(&mut self.m, lane, m);
        set_lane(&mut self.previous, lane, m);
        self.indices[lane] = index as u32;
    }

    /// Moments with the indices of their rolling constraints.
    pub fn moments(&self) -> impl Iterator<Item = (u32, [f64; 3])> + '_ {
        let occupied = self.indices.iter().enumerate().filter(|(_, index)| **index != NO_INDEX);
        occupied.map(|(lane, &index)| (index, self.m.map(|m| m[lane].to_f64())))
    }

    /// Solves the moments of the `WIDTH` contacts from lane `from` on, each from y = m + beta (m - m_before); returns
    /// their changes. The angular velocities in `contacts` are those with y applied.
    #[inline(always)]
    pub fn solve_moments<L: Arithmetic<T = T>>(
        &mut self,
        l: L,
        from: usize,
        beta: L::V,
        contacts: RollingContacts<L::V>,
    ) -> LaneVector<L::V> {
        let RollingContacts { n, normal_impulse, tangential_impulse, w } = contacts;
        let (m, previous) = (load_vector(l, from, &self.m), load_vector(l, from, &self.previous));
        let shift = load_vector(l, from, &self.shift);
        let y = triple!(k => l.mul_add(beta, l.sub(m[k], previous[k]), m[k]));
        let inverse_w = load_column(l, from, &self.inverse_w);
        let stopping = triple!(k => l.neg_mul_add(l.add(w[k], shift[k]), inverse_w, y[k]));
        let rolling = l.mul(load_column(l, from, &self.rolling), normal_impulse);
        let spinning = l.mul(load_column(l, from, &self.spinning), normal_impulse);
        let left_by_shear = l.neg_mul_add(load_column(l, from, &self.shear), tangential_impulse, spinning);
        let zero = l.splat(0.0);
        let new = clamp_moment(l, n, stopping, rolling, l.select_greater(left_by_shear, zero, left_by_shear, zero));
        for k in 0..3 {
            store_column(l, from, &mut self.previous[k], m[k]);
            store_column(l, from, &mut self.m[k], new[k]);
        }
        triple!(k => l.sub(new[k], y[k]))
    }
}

/// Nearest moment to `m` whose part along `n` is at most `spinning`, and whose part across is at most `rolling`.
#[inline(always)]
fn clamp_moment<L: Arithmetic>(
    l: L,
    n: LaneVector<L::V>,
    m: LaneVector<L::V>,
    rolling: L::V,
    spinning: L::V,
) -> LaneVector<L::V> {
    let normal_part = dot_product(l, n, m);
    let tangential_part = project_to_ball(l, triple!(k => l.neg_mul_add(n[k], normal_part, m[k])), rolling);
    let lowest = l.sub(l.splat(0.0), spinning);
    let normal_part = l.min(l.select_greater(normal_part, lowest, normal_part, lowest), spinning);
    triple!(k => l.mul_add(n[k], normal_part, tangential_part[k]))
}
