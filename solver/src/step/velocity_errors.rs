//! Contacts that part or slide at a step's end by more than the error of the solution. Their loss is irreversible.
//!
//! A contact that opens or slides in an exact solution has û_n > 0 or û_T ≠ 0. In an approximate solution a contact at its
//! limit may move although another distribution of the same load would keep it at rest: the load of a face is shared by its
//! points as the sweeps happen to find it. Then its neighbours, which stick, move as well, and their velocity is known to be
//! an error. Each body has an error of velocity: the largest |F|/ρ over its contacts, with the natural map F of the contact
//! and its own ρ = 3/trace W. A contact moves if its velocity exceeds [`ERROR_MARGIN`] times the error of its two bodies. No
//! property of the load or the law is in this scale.
//!
//! Errors of a step are also loads of the next one, in which bonds stop them ([`super::error_loads`]). A load that is at work
//! cannot be undone in the step in which it breaks a bond, so each step with bonds is refined until its errors are small
//! loads.

use rayon::prelude::*;

use super::bond_closing::LARGEST_OPENING;
use super::context::{SolvedProblem, StepContext};
use super::error_loads::largest_error_load;
use crate::activity;
use crate::assemble::{ContactConstraint, ContactProblem, RollingConstraint, SolverBody, stored_problem};
use crate::laws::{ContactLaw, ContactMotion};
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::scene::{BodyId, ContactSides};
use crate::solve::{ContactSolution, MOMENTUM_CYCLE, SolveRequest, StoppingCriteria, solve_contact_problem};
use crate::state::{Contact, ContactId};

/// Smallest velocity of a contact that counts as motion, divided by the velocity error of its bodies. A face at rest
/// has at least one point whose error is its own velocity. A point far from it, as face corners are from each other,
/// moves by up to three times that velocity as the face turns.
const ERROR_MARGIN: f64 = 3.0;

/// Share of the summed velocities at a contact that is rounding: a hundred sweeps of a few units in the last place.
const ROUNDING_SHARE: f64 = 1e-13;

/// Smallest error of velocity that matters, as a share of the velocity change that the strength of a bond gives its two
/// bodies: a load that is off by three times as much, [`ERROR_MARGIN`], is still distinguished from the strength.
const MIN_RESOLVED_SHARE: f64 = 0.01;

/// Largest load of a bond in the next step by velocity errors, divided by its strength: bonds that are loaded by 0.95
/// or 1.05 of their strength are then still on their side of it.
const MAX_ERROR_LOAD: f64 = 0.02;

/// Largest number of tenfold refinements of a step for its bonds: to 1e-9 of the residual of the unsolved problem.
const MAX_REFINEMENTS: usize = 6;

/// Largest cost of the refinements of a step, in contacts times sweeps, unless a round of sweeps costs more. Bonds of some
/// bodies on small areas are decided within it; of a hundred bonded cubes that come apart, a few bonds may need ten times as
/// much, and are decided by what is known then.
const MAX_REFINEMENT_COST: u64 = 1_000_000;

/// Velocity errors of the bodies and rows of a solution.
pub struct VelocityErrors {
    /// Error by body, m/s; 0 for a body without contact impulses.
    errors: Vec<f64>,
    /// Ratio of the error of the tangential velocity at each row to that of the velocity; empty if no face is bonded.
    leverages: Vec<f64>,
    /// Rows of bonds whose velocity fell with the residual: it is an error, however large against the others. Sorted.
    unsettled: Vec<usize>,
}

impl VelocityErrors {
    /// Errors of a solution.
    pub fn new(contact_problem: &ContactProblem, solution: &ContactSolution) -> Self {
        let row_error = |(k, r): (usize, &Vec3)| {
            // The natural map of such rows is another one, and their contacts lose nothing.
            if contact_problem.rows[k].can_close && contact_problem.regularised_row(k).is_none() {
                velocity_error(contact_problem, solution, k, r)
            } else {
                0.0
            }
        };
        let row_errors: Vec<f64> =
            solution.impulses.par_iter().enumerate().with_min_len(PAR_MIN_LEN).map(row_error).collect();
        let mut errors = vec![0.0f64; contact_problem.bodies.len()];
        let mut add_error = |row: &ContactConstraint, error: f64| {
            // A body that does not move transmits no error.
            for body in row.bodies.into_iter().filter(|&body| contact_problem.bodies[body.index()].inverse_mass > 0.0) {
                errors[body.index()] = errors[body.index()].max(error);
            }
        };
        contact_problem.rows.iter().zip(row_errors).for_each(|(row, error)| add_error(row, error));
        let bonds = contact_problem.rolling_constraints.iter().zip(&solution.moments);
        for (roll, moment) in bonds.filter(|(roll, _)| roll.is_bond() && roll.compliance == [0.0; 2]) {
            add_error(&contact_problem.rows[roll.row.index()], turning_error(contact_problem, solution, roll, moment));
        }
        VelocityErrors { errors, leverages: tangential_leverages(contact_problem), unsettled: Vec::new() }
    }

    /// Error of the tangential velocity at row `k`, m/s.
    fn tangential_error(&self, k: usize, row: &ContactConstraint) -> f64 {
        self.contact_error(row.bodies) * self.leverages.get(k).copied().unwrap_or(1.0)
    }

    /// Error of the velocity at a contact between `bodies`, m/s.
    fn contact_error(&self, bodies: [BodyId; 2]) -> f64 {
        let [a, b] = bodies.map(|body| self.errors[body.index()]);
        a.max(b)
    }

    /// Motion of the contact of row `k`, none where the row is unsettled.
    pub fn contact_motion(
        &self,
        contact_problem: &ContactProblem,
        solution: &ContactSolution,
        k: usize,
    ) -> ContactMotion {
        if self.unsettled.binary_search(&k).is_ok() {
            return ContactMotion::default();
        }
        let row = &contact_problem.rows[k];
        let u = contact_problem.shifted_velocity(k, &solution.solver_bodies);
        let opening = row.normal.dot(&u);
        let sliding = (u - row.normal * opening).norm();
        let turning =
            bond_moments(contact_problem, k).map_or(0.0, |roll| turning_speed(contact_problem, solution, roll));
        let (error, sliding_error) = (self.contact_error(row.bodies), self.tangential_error(k, row));
        ContactMotion {
            opens: opening > ERROR_MARGIN * error,
            slides: sliding > ERROR_MARGIN * sliding_error,
            turns: turning > ERROR_MARGIN * error,
        }
    }

    /// Whether the solution leaves open whether the bond of row `k` breaks. This is so if the bond is at its limit to
    /// within errors that are not small against its strength, and it does not move by more than these errors. It is
    /// also so if the errors open the bond in the step `h` (s) by more than positions are corrected for, at the
    /// effective radius `radius` (m).
    fn is_undecided(
        &self,
        contact_problem: &ContactProblem,
        solution: &ContactSolution,
        k: usize,
        h: f64,
        radius: f64,
    ) -> bool {
        let row = &contact_problem.rows[k];
        let error = self.contact_error(row.bodies);
        if self.contact_motion(contact_problem, solution, k).is_any() {
            return false;
        }
        let sliding_error = self.tangential_error(k, row);
        let r = &solution.impulses[k];
        let normal = row.normal.dot(r);
        let tangential = (r - row.normal * normal).norm();
        let traction_speed = row.w_n * row.impulse_shift.abs();
        // Where all traction is used up, the limit of shear is 0.
        let shear_speed = row.w_t * row.friction * normal.max(MIN_RESOLVED_SHARE * row.impulse_shift.abs());
        // Strengths times W are changes of velocity, which are compared with the errors.
        let is_at_limit = |margin: f64, error: f64| margin <= ERROR_MARGIN * error;
        is_at_limit(row.w_n * normal, error) && error > MIN_RESOLVED_SHARE * traction_speed
            || is_at_limit(row.w_t * (row.friction * normal - tangential), sliding_error)
                && sliding_error > MIN_RESOLVED_SHARE * shear_speed
            || error * h > LARGEST_OPENING * radius
            || position(contact_problem, k).is_some_and(|index| {
                let (roll, moment) = (&contact_problem.rolling_constraints[index], &solution.moments[index]);
                let along = row.normal.dot(moment);
                let (across_bound, along_bound) = roll.moment_bounds(r, &row.normal);
                // The velocity at the distance R by an impulse M/R, as that of the impulses above.
                let w = roll.radius * roll.radius / roll.inverse_w;
                let across = (moment - row.normal * along).norm();
                [(across_bound, across), (along_bound, along.abs())].into_iter().any(|(bound, moment)| {
                    is_at_limit(w * (bound - moment / roll.radius), error)
                        && error > MIN_RESOLVED_SHARE * w * bound.max(MIN_RESOLVED_SHARE * row.impulse_shift.abs())
                })
            })
    }
}

/// Contacts of a step and the laws of their bonds.
struct StepBonds<'a> {
    context: StepContext<'a>,
    laws: &'a [ContactLaw],
}

impl StepBonds<'_> {
    /// Rows with a bond that is lost if it moves in any direction.
    fn rigid_rows(&self, contact_problem: &ContactProblem) -> Vec<usize> {
        let is_rigid = |&k: &usize| {
            let law = &self.laws[self.context.contacts[k].law.index()];
            has_active_bond(&contact_problem.rows[k])
                && law.has_stress()
                && law.bonds_are_rigid()
                && law.bond_stiffness().is_none()
        };
        (0..contact_problem.rows.len()).into_par_iter().with_min_len(PAR_MIN_LEN).filter(is_rigid).collect()
    }

    /// Rows of `rigid` that open or slide.
    fn moving_rows(
        &self,
        SolvedProblem { contact_problem, solution, .. }: &SolvedProblem,
        errors: &VelocityErrors,
        rigid: &[usize],
    ) -> Vec<usize> {
        let is_moving = |&k: &usize| errors.contact_motion(contact_problem, solution, k).is_any();
        rigid.iter().copied().filter(is_moving).collect()
    }

    /// Whether the solution leaves open which bonds break, in this step or, by its errors, in the next. `rigid` and `broken_rows`:
    /// rows with rigid bonds, and those of them that break.
    fn are_undecided(
        &self,
        SolvedProblem { contact_problem, solution, .. }: &SolvedProblem,
        errors: &VelocityErrors,
        rigid: &[usize],
        broken_rows: &[usize],
    ) -> bool {
        let StepContext { scene, q_c, contacts, .. } = self.context;
        let is_undecided = |(k, contact): (usize, &Contact)| {
            let radius = || {
                let ContactSides { candidate: a, antagonist: b } = contact.part_numbers;
                scene.effective_radius((contact.candidate, a), (contact.antagonist, b))
            };
            has_active_bond(&contact_problem.rows[k])
                && self.laws[contact.law.index()].has_irreversible_loss()
                && errors.is_undecided(contact_problem, solution, k, q_c.h, radius())
        };
        contacts.par_iter().enumerate().with_min_len(PAR_MIN_LEN).any(is_undecided)
            || largest_error_load(contact_problem, solution, rigid, broken_rows) > MAX_ERROR_LOAD
    }
}

/// Whether a row has a bond that carries traction.
fn has_active_bond(row: &ContactConstraint) -> bool {
    row.bond.is_some() && row.impulse_shift != 0.0
}

/// Refines a converged solution tenfold as long as it is undecided which bonds break, and returns the velocity errors of the
/// result; `None` if no law has irreversible losses. The velocity of bonds that break must stay in a refinement. The number
/// of refinements depends only on the loads of the bonds, unless the program is requested to stop: the step is then to be
/// abandoned.
pub fn refine_until_decided(
    context: StepContext,
    laws: &[ContactLaw],
    request: SolveRequest,
    solved: &mut SolvedProblem,
) -> Option<VelocityErrors> {
    if !laws.iter().any(ContactLaw::has_irreversible_loss) {
        return None;
    }
    let bonds = StepBonds { context, laws };
    let mut errors = VelocityErrors::new(&solved.contact_problem, &solved.solution);
    let rigid = bonds.rigid_rows(&solved.contact_problem);
    let mut moving = bonds.moving_rows(solved, &errors, &rigid);
    // Until there are two solutions, no bond is known to break.
    let mut is_settled = moving.is_empty();
    let mut sweeps_left = MOMENTUM_CYCLE.max(MAX_REFINEMENT_COST / (solved.contact_problem.rows.len() as u64).max(1));
    for refinement in 0..MAX_REFINEMENTS {
        let is_decided = is_settled && !bonds.are_undecided(solved, &errors, &rigid, &moving);
        if !solved.solution.converged || is_decided || sweeps_left == 0 || activity::is_stopped() {
            break;
        }
        let speed = |SolvedProblem { contact_problem, solution, .. }: &SolvedProblem, k: usize| {
            let sliding = contact_problem.shifted_velocity(k, &solution.solver_bodies).norm();
            let turning = |roll| turning_speed(contact_problem, solution, roll);
            bond_moments(contact_problem, k).map_or(sliding, |roll| sliding.max(turning(roll)))
        };
        let speeds: Vec<f64> = rigid.iter().map(|&k| speed(solved, k)).collect();
        let ContactSolution { residual, sweeps, .. } = solved.solution;
        refine(context, request, sweeps_left, solved);
        sweeps_left = sweeps_left.saturating_sub(solved.solution.sweeps - sweeps);
        errors = VelocityErrors::new(&solved.contact_problem, &solved.solution);
        // An error falls like the residual, the velocity of a bond that breaks stays: the root of the ratio divides them.
        let dividing_ratio = (solved.solution.residual / residual).sqrt();
        let is_stuck = solved.solution.residual > 0.5 * residual;
        let is_error = |k: &usize| {
            if is_stuck {
                // Nothing new is known of the bonds that moved before.
                return refinement > 0 && moving.binary_search(k).is_err();
            }
            let speed_before = rigid.binary_search(k).map_or(0.0, |position| speeds[position]);
            speed(solved, *k) < dividing_ratio * speed_before
        };
        (errors.unsettled, moving) = bonds.moving_rows(solved, &errors, &rigid).into_iter().partition(is_error);
        is_settled = errors.unsettled.is_empty();
        if is_stuck {
            break;
        }
    }
    Some(errors)
}

/// Continues from a converged solution to a tenth of its residual, with at most `max_sweeps`. Where a body turns about
/// a short arm this would need thousands of sweeps, so the fallback continues from them, as in any step that stalls.
fn refine(
    context: StepContext,
    request: SolveRequest,
    max_sweeps: u64,
    SolvedProblem { contact_problem, solution, .. }: &mut SolvedProblem,
) {
    contact_problem.rows.iter_mut().zip(&solution.impulses).for_each(|(row, r)| row.warm_start = *r);
    contact_problem.rolling_constraints.iter_mut().zip(&solution.moments).for_each(|(roll, m)| roll.warm_start = *m);
    let target_residual = 0.1 * solution.residual.min(request.criteria.target_residual);
    let max_sweeps = max_sweeps.min(request.criteria.max_sweeps);
    let criteria =
        StoppingCriteria { tol: target_residual, target_residual, min_sweeps: 0, max_sweeps, ..request.criteria };
    let stored_data = |problem: &ContactProblem| stored_problem(problem, context.contacts);
    let further = solve_contact_problem(contact_problem, SolveRequest { criteria, ..request }, stored_data);
    *solution = ContactSolution {
        sweeps: solution.sweeps + further.sweeps,
        converged: further.residual <= request.criteria.tol && further.left_out == 0,
        fallback_used: solution.fallback_used,
        stalled_residual: solution.stalled_residual,
        replacement_reason: solution.replacement_reason,
        single_precision: solution.single_precision || further.single_precision,
        ..further
    };
}

/// Ratio of the error of the tangential velocity at each row to that of the velocity; empty if no face is bonded.
///
/// Errors of the normal velocity at the bonds of a face, at distances s from its centre, turn a body by as much divided
/// by s. About its centre of mass, at a distance l, this is a tangential velocity of l/s times the error.
fn tangential_leverages(contact_problem: &ContactProblem) -> Vec<f64> {
    if contact_problem.block_data.is_none() || !contact_problem.rows.iter().any(has_active_bond) {
        return Vec::new();
    }
    let mut leverages = vec![1.0; contact_problem.rows.len()];
    let mut first = 0;
    for rows in contact_problem.rows.chunk_by(|a, b| a.bodies == b.bodies) {
        let bonded: Vec<usize> =
            (first..first + rows.len()).filter(|&k| has_active_bond(&contact_problem.rows[k])).collect();
        first += rows.len();
        if bonded.len() < 3 {
            continue;
        }
        let is_movable = |side: &usize| contact_problem.bodies[rows[0].bodies[*side].index()].inverse_mass > 0.0;
        for side in [0, 1].into_iter().filter(is_movable) {
            let arms = bonded.iter().map(|&k| contact_problem.contact_arm(k, side));
            let centre = arms.clone().sum::<Vec3>() / bonded.len() as f64;
            let spread = arms.map(|arm| (arm - centre).norm_squared()).sum::<f64>() / bonded.len() as f64;
            let leverage = centre.norm() / spread.sqrt();
            bonded.iter().for_each(|&k| leverages[k] = leverage.max(leverages[k]));
        }
    }
    leverages
}

/// |F|/ρ of row `k` with the impulse `r`, and the rounding part of its velocity, m/s.
fn velocity_error(contact_problem: &ContactProblem, solution: &ContactSolution, k: usize, r: &Vec3) -> f64 {
    let row = &contact_problem.rows[k];
    let rho = 3.0 / (row.w_n + 2.0 * row.w_t);
    let speed = |side: usize| {
        let SolverBody { v, w, .. } = &solution.solver_bodies[row.bodies[side].index()];
        v.norm() + w.norm() * contact_problem.contact_arm(k, side).norm()
    };
    let rounding =
        ROUNDING_SHARE * (speed(0) + speed(1) + row.shift.norm() + (r.norm() + row.impulse_shift.abs()) / rho);
    natural_map(&row.normal, row.friction, rho, &contact_problem.shifted_velocity(k, &solution.solver_bodies), r).norm()
        / rho
        + rounding
}

/// Index of the rolling constraint of row `k`, if a bond carries moments there.
fn position(contact_problem: &ContactProblem, k: usize) -> Option<usize> {
    let rolls = &contact_problem.rolling_constraints;
    let index = rolls.binary_search_by_key(&ContactId::new(k), |roll| roll.row).ok()?;
    rolls[index].is_bond().then_some(index)
}

/// Moments of the bond of row `k`, if it carries any.
fn bond_moments(contact_problem: &ContactProblem, k: usize) -> Option<&RollingConstraint> {
    position(contact_problem, k).map(|index| &contact_problem.rolling_constraints[index])
}

/// Relative angular velocity of the two bodies of a bond times the radius of the bond, m/s.
fn turning_speed(contact_problem: &ContactProblem, solution: &ContactSolution, roll: &RollingConstraint) -> f64 {
    roll.radius * contact_problem.shifted_spin(roll, &solution.solver_bodies).norm()
}

/// |F| R/ρ of the moment of a bond, with F = m - P(m - ρ w), the projection P on its bounds and ρ the inverse of W, and the
/// rounding part of the velocity, m/s.
fn turning_error(
    contact_problem: &ContactProblem,
    solution: &ContactSolution,
    roll: &RollingConstraint,
    moment: &Vec3,
) -> f64 {
    let (k, n) = (roll.row.index(), contact_problem.rows[roll.row.index()].normal);
    let z = moment - contact_problem.shifted_spin(roll, &solution.solver_bodies) * roll.inverse_w;
    let nearest = roll.limited_moment(&solution.impulses[k], &n, &z);
    let rounding = roll.shift.norm() + moment.norm() / roll.inverse_w;
    ((moment - nearest).norm() / roll.inverse_w + ROUNDING_SHARE * rounding) * roll.radius
}

/// F = r - P(r - ρ (û + μ |û_T| n)) with the projection P on Coulomb's cone, N s. It is 0 for a contact that obeys Signorini
/// and Coulomb.
fn natural_map(n: &Vec3, friction: f64, rho: f64, u: &Vec3, r: &Vec3) -> Vec3 {
    let sliding = (u - n * n.dot(u)).norm();
    let z = r - (u + n * (friction * sliding)) * rho;
    let z_n = n.dot(&z);
    let z_t = z - n * z_n;
    let z_t_length = z_t.norm();
    let nearest = if z_t_length <= friction * z_n {
        z
    } else if friction * z_t_length <= -z_n {
        Vec3::zeros()
    } else {
        let normal = (z_n + friction * z_t_length) / (1.0 + friction * friction);
        let tangential = if z_t_length > 0.0 { z_t * (friction * normal / z_t_length) } else { Vec3::zeros() };
        n * normal + tangential
    };
    r - nearest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_natural_map_is_0_where_the_conditions_hold() {
        let n = Vec3::new(0.6, 0.0, 0.8);
        let (t, s) = (Vec3::new(0.8, 0.0, -0.6), Vec3::y());
        let f = |u: Vec3, r: Vec3| natural_map(&n, 0.5, 2.0, &u, &r).norm();
        let zero = Vec3::zeros();
        for (u, r) in [(zero, n * 3.0 + t), (n * 2.0 + t * 9.0, zero), (t * 4.0, n * 2.0 - t), (s * -4.0, n * 2.0 + s)]
        {
            assert!(f(u, r) < 1e-15 * 10.0, "{u} {r}");
        }
        // The error of a sticking contact that moves is ρ û; that of a parting contact with an impulse is at most this
        // impulse.
        assert!((f(s * 0.1, n * 3.0) - 0.2).abs() < 0.11 && f(s * 0.1, n * 3.0) >= 0.2);
        assert_eq!(f(n * 8.0, n), 1.0);
        assert!(f(zero, t) > 0.4);
    }
}
