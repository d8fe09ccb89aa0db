//! Conjugate gradients on the contacts that neither open nor slide, where sweeps are slow: along a chain of n bonds they would
//! need some n⁴ of them.
//!
//! Within its limits a bond is linear: û = 0, and without a relative angular velocity if it carries moments. The same is true
//! for contacts that stick. With all other impulses as they are, the corrections λ of these solve
//!
//! ```text
//! (Hᵀ M⁻¹ H + C) λ = -(û, ω),
//! ```
//!
//! with the compliances C of elastic bonds and springs, here by conjugate gradients with the diagonal of the matrix, which is not
//! stored. Redundant bonds make it singular, but the right side is in its range, as all rows can be at rest; where they cannot, the
//! gradients end at their limit of iterations. Sweeps then find out which contacts reach their limits. Elastic bonds are part of
//! the system until one of their loads has been beyond its limit.
//!
//! Source: M.R. Hestenes, E. Stiefel, J. Res. Natl. Bur. Stand. 49 (1952) 409-436.

use crate::activity;
use crate::assemble::{ContactProblem, RegularisedRow, RollingConstraint, SolverBody};
use crate::math::{Twist, Vec3};
use crate::solve::types::ContactReactions;
use crate::state::ContactId;

/// Three equations of the system, one along each axis.
enum StickingRow<'a> {
    /// û = 0 of this row, with its compliances along the normal and across, 1/kg.
    Impulse(usize, [f64; 2]),
    /// No relative angular velocity; index in the list of moments.
    Moment(usize, &'a RollingConstraint),
}

/// Vector whose part along `n` is multiplied by `along`, and whose part across by `across`.
fn scaled_parts(n: &Vec3, [along, across]: [f64; 2], vector: &Vec3) -> Vec3 {
    vector * across + n * ((along - across) * n.dot(vector))
}

/// Equations of a contact problem.
struct StickingSystem<'a> {
    problem: &'a ContactProblem,
    rows: Vec<StickingRow<'a>>,
}

impl<'a> StickingSystem<'a> {
    /// Equations of the elastic bonds but `yielding` ones, and of the contacts whose reactions are within their limits. A yielding
    /// bond is one of these if the load by its strain is within its limits, too: sweeps put loads that balance each other at limits
    /// that the strain does not reach.
    fn new(
        problem: &'a ContactProblem,
        reactions: &ContactReactions,
        solver_bodies: &[SolverBody],
        yielding: &[ContactId],
    ) -> Self {
        let may_yield = |row: usize| yielding.binary_search(&ContactId::new(row)).is_ok();
        let sticking_row = |k: usize| {
            let row = &problem.rows[k];
            let is_within = row.holds_impulse(&reactions.impulses[k]);
            let (is_within, compliance) = match problem.regularised_row(k) {
                None => (is_within, [0.0; 2]),
                Some(&RegularisedRow::Spring { compliance, .. }) => (is_within, [compliance, 0.0]),
                Some(&RegularisedRow::Bond { opening, sliding, .. }) => {
                    let compliance = [opening, sliding];
                    let by_strain = || {
                        let u = problem.shifted_velocity(k, solver_bodies);
                        row.strain_load(compliance, &u)
                    };
                    (is_within || !may_yield(k) || row.holds_impulse(&by_strain()), compliance)
                }
                // Their impulses stay.
                Some(
                    RegularisedRow::Coupled { .. } | RegularisedRow::Link { .. } | RegularisedRow::Interface { .. },
                ) => return None,
            };
            is_within.then_some(StickingRow::Impulse(k, compliance))
        };
        let impulses = (0..problem.rows.len()).filter_map(sticking_row);
        let moments = problem.rolling_constraints.iter().enumerate().filter_map(|(index, roll)| {
            let k = roll.row.index();
            let (n, r) = (&problem.rows[k].normal, &reactions.impulses[k]);
            let [across, along] = roll.compliance;
            let by_strain = || problem.rows[k].strain_load([along, across], &problem.shifted_spin(roll, solver_bodies));
            let is_within = roll.holds_moment(r, n, &reactions.moments[index])
                || across > 0.0 && (!may_yield(k) || roll.holds_moment(r, n, &by_strain()));
            is_within.then_some(StickingRow::Moment(index, roll))
        });
        let rows = impulses.chain(moments).collect();
        StickingSystem { problem, rows }
    }

    /// Velocities by the compliances of the rows at these reactions.
    fn compliant_velocity(&self, row: &StickingRow, value: &Vec3) -> Vec3 {
        match *row {
            StickingRow::Impulse(k, compliance) => scaled_parts(&self.problem.rows[k].normal, compliance, value),
            StickingRow::Moment(_, roll) => {
                let [across, along] = roll.compliance;
                scaled_parts(&self.problem.rows[roll.row.index()].normal, [along, across], value)
            }
        }
    }

    /// Velocities of the rows at the motions of the bodies, without shifts.
    fn velocities(&self, motions: &[Twist]) -> Vec<Vec3> {
        let velocity = |row: &StickingRow| match *row {
            StickingRow::Impulse(k, _) => {
                let [a, b] = self.problem.rows[k].bodies.map(|body| &motions[body.index()]);
                a.v + self.problem.turning_velocity(k, 0, &a.w) - b.v - self.problem.turning_velocity(k, 1, &b.w)
            }
            StickingRow::Moment(_, roll) => {
                let [a, b] = self.problem.rows[roll.row.index()].bodies.map(|body| &motions[body.index()]);
                a.w - b.w
            }
        };
        self.rows.iter().map(velocity).collect()
    }

    /// Motions that impulses and moments of the rows give the bodies.
    fn motions(&self, values: &[Vec3]) -> Vec<Twist> {
        let mut motions = vec![Twist::default(); self.problem.bodies.len()];
        for (row, value) in self.rows.iter().zip(values) {
            let k = match row {
                StickingRow::Impulse(k, _) => *k,
                StickingRow::Moment(_, roll) => roll.row.index(),
            };
            for (side, body) in self.problem.rows[k].bodies.into_iter().enumerate() {
                let value = if side == 0 { *value } else { -value };
                let motion = &mut motions[body.index()];
                match row {
                    StickingRow::Impulse(..) => {
                        motion.v += self.problem.velocity_change(body, &value);
                        let turn = self.problem.angular_impulse(k, side, &value);
                        motion.w += self.problem.angular_velocity_change(body, &turn);
                    }
                    StickingRow::Moment(..) => motion.w += self.problem.angular_velocity_change(body, &value),
                }
            }
        }
        motions
    }

    /// Divides the values by the diagonal of the matrix.
    fn apply_preconditioner(&self, values: &[Vec3]) -> Vec<Vec3> {
        let divide = |(row, value): (&StickingRow, &Vec3)| match *row {
            StickingRow::Impulse(k, [opening, sliding]) => {
                let (w_n, w_t) = self.problem.delassus_diagonal(k);
                let normal = self.problem.rows[k].normal * self.problem.rows[k].normal.dot(value);
                normal / (w_n + opening) + (value - normal) / (w_t + sliding)
            }
            StickingRow::Moment(_, roll) if roll.compliance == [0.0; 2] => value * roll.inverse_w,
            StickingRow::Moment(_, roll) => {
                let factors = roll.compliance.map(|compliance| 1.0 / (1.0 / roll.inverse_w + compliance));
                let [across, along] = factors;
                scaled_parts(&self.problem.rows[roll.row.index()].normal, [along, across], value)
            }
        };
        self.rows.iter().zip(values).map(divide).collect()
    }
}

/// Scalar product.
fn dot(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

/// Limits at which the iteration ends.
pub struct GradientLimits {
    /// Ratio of the last velocities to the first.
    pub reduction: f64,
    /// Largest number of iterations.
    pub iterations: u64,
}

/// Returns corrected reactions and the number of iterations. `solver_bodies`: bodies with the velocities that the given
/// `reactions` produce. The elastic bonds that are not in the sorted list `yielding` are solved without their limits.
pub fn corrected_reactions(
    problem: &ContactProblem,
    mut reactions: ContactReactions,
    solver_bodies: &[SolverBody],
    yielding: &[ContactId],
    limits: GradientLimits,
) -> (ContactReactions, u64) {
    let system = StickingSystem::new(problem, &reactions, solver_bodies, yielding);
    let motions: Vec<Twist> = solver_bodies.iter().map(|body| Twist { v: body.v, w: body.w }).collect();
    let shift = |row: &StickingRow| match *row {
        StickingRow::Impulse(k, _) => problem.rows[k].shift,
        StickingRow::Moment(_, roll) => roll.shift,
    };
    let shifts = system.rows.iter().map(shift);
    let mut remaining: Vec<Vec3> =
        system.velocities(&motions).iter().zip(shifts).map(|(u, shift)| -(u + shift)).collect();
    for (row, remaining) in system.rows.iter().zip(&mut remaining) {
        *remaining -= match *row {
            StickingRow::Impulse(k, _) => system.compliant_velocity(row, &reactions.impulses[k]),
            StickingRow::Moment(index, _) => system.compliant_velocity(row, &reactions.moments[index]),
        };
    }
    let mut corrections = vec![Vec3::zeros(); remaining.len()];
    let mut preconditioned = system.apply_preconditioner(&remaining);
    let mut direction = preconditioned.clone();
    let mut size = dot(&remaining, &preconditioned);
    let target = size * limits.reduction * limits.reduction;
    let mut iterations = 0;
    while size > target && iterations < limits.iterations && !activity::is_stopped() {
        let mut response = system.velocities(&system.motions(&direction));
        for ((row, response), value) in system.rows.iter().zip(&mut response).zip(&direction) {
            *response += system.compliant_velocity(row, value);
        }
        let curvature = dot(&direction, &response);
        if curvature <= 0.0 {
            break; // rounding
        }
        let length = size / curvature;
        corrections.iter_mut().zip(&direction).for_each(|(x, p)| *x += p * length);
        remaining.iter_mut().zip(&response).for_each(|(r, q)| *r -= q * length);
        preconditioned = system.apply_preconditioner(&remaining);
        let next = dot(&remaining, &preconditioned);
        let share = next / size;
        direction.iter_mut().zip(&preconditioned).for_each(|(p, z)| *p = z + *p * share);
        size = next;
        iterations += 1;
        activity::count_sweep();
    }
    for (row, correction) in system.rows.iter().zip(&corrections) {
        match *row {
            StickingRow::Impulse(k, _) => reactions.impulses[k] += correction,
            StickingRow::Moment(index, _) => reactions.moments[index] += correction,
        }
    }
    (reactions, iterations)
}
