//! Chooses the solver for the contact problem of a step, and the fallback if the sweeps stall: `step` calls
//! [`solve_contact_problem`], which calls the sweeps of `gauss_seidel` and the solvers of `matrix`.

use cd_formats::compute::ContactSolver;
use cd_formats::snapshot::FallbackState;
use rayon::prelude::*;

use crate::activity;
use crate::assemble::{ContactProblem, StoredProblem};
use crate::math::simd::SimdWidth;
use crate::math::{PAR_MIN_LEN, Vec3, to_local, to_world};
use crate::ranks::lists::{any_rank, sum_over_ranks};
use crate::solve::bond_gradients::{GradientLimits, corrected_reactions};
use crate::solve::cost_model::{COSTS, TOO_LARGE_REASON};
use crate::solve::gauss_seidel::associated::{associated_law_applies, solve_associated};
use crate::solve::gauss_seidel::driver::{closing_inactive_rows, solve_divided_nlgs, solve_nlgs};
use crate::solve::gauss_seidel::momentum::MOMENTUM_CYCLE;
use crate::solve::matrix::{self, MatrixProblem, MatrixSolver, SolverLimits, residual, solve};
use crate::solve::regularised::solve_regularised;
use crate::solve::residual::ResidualEvaluator;
use crate::solve::types::{ContactReactions, ContactSolution, StoppingCriteria};
use crate::state::ContactId;

/// Requirements of a step for its solver.
#[derive(Debug, Clone, Copy)]
pub struct SolveRequest {
    /// Solver that the options select.
    pub solver: ContactSolver,
    pub criteria: StoppingCriteria,
    /// Width of the vectors of the sweeps.
    pub width: SimdWidth,
    /// Whether `auto` is limited to one round of sweeps.
    pub fallback_suppressed: bool,
}

impl SolveRequest {
    /// Whether `auto` may spend more than one round of sweeps on the step, unless the fallback is suppressed.
    fn may_use_fallback(&self) -> bool {
        self.solver == ContactSolver::Auto && self.criteria.max_sweeps > MOMENTUM_CYCLE
    }

    /// Whether the step is limited to one round of sweeps although more are allowed.
    pub fn skips_fallback(&self) -> bool {
        self.fallback_suppressed && self.may_use_fallback()
    }
}

/// Updates the back-off of the fallback from the solution of a step that is `step_multiple` times `dt` long.
pub fn update_backoff(
    fallback: &mut FallbackState,
    request: SolveRequest,
    step: u64,
    step_multiple: u64,
    solution: &ContactSolution,
) {
    if request.fallback_suppressed || !request.may_use_fallback() {
        return;
    }
    let has_gained =
        solution.stalled_residual.is_some_and(|stalled| solution.residual <= COSTS.success_residual_share * stalled);
    if !solution.converged && !has_gained {
        let failures = (fallback.failures + 1).min(COSTS.max_backoff_failures);
        *fallback = FallbackState { failures, due: step + (step_multiple << failures) };
    } else if solution.sweeps > MOMENTUM_CYCLE && request.criteria.target_residual == request.criteria.tol {
        // Below `tol` even the easiest step needs many sweeps.
        *fallback = FallbackState::default();
    }
}

/// Solves by sweeps alone, and returns the solution: by the sweeps for problems with regularised rows, or by [`solve_nlgs`].
pub fn solve_by_sweeps(
    contact_problem: &ContactProblem,
    criteria: StoppingCriteria,
    width: SimdWidth,
) -> ContactSolution {
    if contact_problem.regularised.is_empty() {
        solve_nlgs(contact_problem, criteria, width)
    } else {
        solve_regularised(contact_problem, criteria)
    }
}

/// Solves the contact problem of a step to E <= `tol`, or as far as the limits allow; the decisions depend only on the
/// problem. Sweeps then continue towards `target_residual`, as does a requested solver of stored problems; the fallback
/// after sweeps stops at `tol`, because a smaller residual is not worth its cost.
///
/// `to_stored` converts the rows that can close to a problem with its Delassus matrix. A result worse than zero impulses is
/// replaced by that of a round of sweeps from these. Returns the impulses of all rows, N s; `converged` says whether E <= `tol`.
pub fn solve_contact_problem(
    contact_problem: &ContactProblem,
    request: SolveRequest,
    to_stored: impl Fn(&ContactProblem) -> StoredProblem,
) -> ContactSolution {
    if !contact_problem.regularised.is_empty() {
        return solve_by_sweeps(contact_problem, request.criteria, request.width);
    }
    let solution = solve_from_warm_start(contact_problem, request, to_stored);
    if solution.residual < 1.0 {
        return solution;
    }
    // E of zero impulses is 1; they are kept if no result is better.
    let mut contact_problem = contact_problem.clone();
    contact_problem.rows.iter_mut().for_each(|row| row.warm_start = row.normal * row.balancing_impulse());
    contact_problem.rolling_constraints.iter_mut().for_each(|roll| roll.warm_start = Vec3::zeros());
    let restarted = solve_nlgs(
        &contact_problem,
        StoppingCriteria { max_sweeps: request.criteria.max_sweeps.min(MOMENTUM_CYCLE), ..request.criteria },
        request.width,
    );
    ContactSolution {
        sweeps: solution.sweeps + restarted.sweeps,
        stalled_residual: solution.stalled_residual,
        replacement_reason: solution.replacement_reason,
        ..restarted
    }
}

/// Solves a contact problem of spheres and plates without attractions of which each rank has a part of the rows, one after the
/// other, as [`solve_contact_problem`] solves the whole. Returns the impulses of the rows of this rank; `None` if the problem
/// needs other solvers than sweeps by Coulomb's law, for which ranks must have all rows.
pub fn solve_in_parts(contact_problem: &mut ContactProblem, request: SolveRequest) -> Option<ContactSolution> {
    let max_sweeps = request.criteria.max_sweeps;
    let can_close = contact_problem.rows.par_iter().with_min_len(PAR_MIN_LEN).filter(|row| row.can_close);
    let contacts = sum_over_ranks(can_close.count());
    let sweeps_alone = request.solver == ContactSolver::Nlgs || request.skips_fallback();
    let sweeps = match request.solver {
        ContactSolver::Nlgs => max_sweeps,
        ContactSolver::Auto if request.skips_fallback() || !COSTS.fallback_pays(contacts) => {
            max_sweeps.min(MOMENTUM_CYCLE)
        }
        ContactSolver::Auto => {
            let sweeps = COSTS.sweeps_before_fallback(contacts, max_sweeps);
            let has_friction = any_rank(associated_law_applies(contact_problem));
            if max_sweeps > MOMENTUM_CYCLE && has_friction { sweeps.min(MOMENTUM_CYCLE) } else { sweeps }
        }
        _ => return None,
    };
    let criteria = StoppingCriteria { max_sweeps: sweeps, ..request.criteria };
    let solution = solve_divided_nlgs(contact_problem, criteria, request.width);
    let is_last = sweeps_alone || solution.converged || solution.sweeps >= max_sweeps;
    (is_last && solution.residual < 1.0 || activity::is_stopped()).then_some(solution)
}

/// Solves with the solver of the request, from the warm start of the rows.
fn solve_from_warm_start(
    contact_problem: &ContactProblem,
    request: SolveRequest,
    to_stored: impl Fn(&ContactProblem) -> StoredProblem,
) -> ContactSolution {
    let StoppingCriteria { tol, target_residual, max_sweeps, .. } = request.criteria;
    let max_sweeps = if request.skips_fallback() { max_sweeps.min(MOMENTUM_CYCLE) } else { max_sweeps };
    let contacts = contact_problem.rows.par_iter().with_min_len(PAR_MIN_LEN).filter(|row| row.can_close).count();
    let sweep =
        |max_sweeps| solve_nlgs(contact_problem, StoppingCriteria { max_sweeps, ..request.criteria }, request.width);
    let (solver, max_cost) = match request.solver {
        ContactSolver::Nlgs => return sweep(max_sweeps),
        ContactSolver::Auto if contact_problem.has_bond_moments() && request.criteria.check_every.is_none() => {
            return solve_with_bond_corrections(contact_problem, request, max_sweeps);
        }
        // The stored problem does not include moments.
        ContactSolver::Auto if request.skips_fallback() || !contact_problem.rolling_constraints.is_empty() => {
            return sweep(max_sweeps);
        }
        ContactSolver::Auto if !COSTS.fallback_pays(contacts) => {
            return solve_with_subproblem_corrections(contact_problem, request, max_sweeps, to_stored);
        }
        ContactSolver::Auto => (MatrixSolver::Auto, COSTS.fallback_budget(contacts)),
        ContactSolver::NlgsAnderson => (MatrixSolver::NlgsAnderson, f64::INFINITY),
        _ if !COSTS.factors_fit(contacts) => {
            return ContactSolution { replacement_reason: Some(TOO_LARGE_REASON), ..sweep(max_sweeps) };
        }
        ContactSolver::ProxNewton => (MatrixSolver::ProxNewton, f64::INFINITY),
        ContactSolver::Admm => (MatrixSolver::Admm, f64::INFINITY),
        ContactSolver::InteriorPoint => (MatrixSolver::InteriorPoint, f64::INFINITY),
    };
    // The solvers that the options request continue from the warm start without sweeps.
    let sweeps = if solver == MatrixSolver::Auto { COSTS.sweeps_before_fallback(contacts, max_sweeps) } else { 0 };
    let start = if solver == MatrixSolver::Auto {
        sweep_with_associated_law(contact_problem, request, sweeps, max_sweeps)
    } else {
        sweep(sweeps)
    };
    let target = if solver == MatrixSolver::Auto { tol } else { target_residual };
    if start.converged && start.residual <= target || start.sweeps >= max_sweeps {
        return start;
    }
    let limits = SolverLimits { tol: target, max_sweeps: max_sweeps - start.sweeps, max_time: None, max_cost };
    let found = solve_by_fallback(contact_problem, start, solver, limits, request, to_stored);
    if solver == MatrixSolver::Auto { continue_sweeps(contact_problem, found, max_sweeps, request) } else { found }
}

/// Solves by `sweeps` sweeps, as long as they do not converge. Where the associated law applies, the sweeps after the first
/// round start from the result of its sweeps, if that has a smaller E; these count, up to `max_sweeps` in all.
fn sweep_with_associated_law(
    contact_problem: &ContactProblem,
    request: SolveRequest,
    sweeps: u64,
    max_sweeps: u64,
) -> ContactSolution {
    let sweep = |contact_problem: &ContactProblem, criteria| solve_nlgs(contact_problem, criteria, request.width);
    if max_sweeps <= MOMENTUM_CYCLE || !associated_law_applies(contact_problem) {
        return sweep(contact_problem, StoppingCriteria { max_sweeps: sweeps, ..request.criteria });
    }
    let first_round = sweeps.min(MOMENTUM_CYCLE);
    let start = sweep(contact_problem, StoppingCriteria { max_sweeps: first_round, ..request.criteria });
    if start.converged || activity::is_stopped() {
        return start;
    }
    let criteria = |done| StoppingCriteria { max_sweeps: max_sweeps - done, min_sweeps: 0, ..request.criteria };
    let found =
        solve_associated(contact_problem, &start.impulses, start.residual, criteria(start.sweeps), request.width);
    let done = start.sweeps + found.sweeps;
    let later_sweeps =
        if found.impulses.is_some() { MOMENTUM_CYCLE.max(sweeps - first_round) } else { sweeps - first_round };
    let later_sweeps = later_sweeps.min(max_sweeps - done);
    if later_sweeps == 0 && found.impulses.is_none() || activity::is_stopped() {
        return ContactSolution { sweeps: done, ..start };
    }
    let mut contact_problem = contact_problem.clone();
    start_from(&mut contact_problem, found.impulses.as_ref().unwrap_or(&start.impulses));
    let swept = sweep(&contact_problem, StoppingCriteria { max_sweeps: later_sweeps, ..criteria(done) });
    ContactSolution { sweeps: done + swept.sweeps, ..swept }
}

/// Continues with sweeps from a solution that the fallback has left above `tol`, up to `max_sweeps` in all; returns that
/// solution if these do not converge either.
///
/// Sweeps of a hyperstatic wall with friction are slow without stagnating, and its stored problem is hard for all solvers.
/// The default of `max_sweeps` is a tenth of the cost of the fallback that failed.
fn continue_sweeps(
    contact_problem: &ContactProblem,
    found: ContactSolution,
    max_sweeps: u64,
    request: SolveRequest,
) -> ContactSolution {
    if found.converged || found.sweeps >= max_sweeps || activity::is_stopped() {
        return found;
    }
    let mut contact_problem = contact_problem.clone();
    start_from(&mut contact_problem, &found.impulses);
    let criteria = StoppingCriteria { max_sweeps: max_sweeps - found.sweeps, ..request.criteria };
    let swept = solve_nlgs(&contact_problem, criteria, request.width);
    let sweeps = found.sweeps + swept.sweeps;
    if swept.converged {
        ContactSolution { sweeps, stalled_residual: found.stalled_residual, ..swept }
    } else {
        ContactSolution { sweeps, ..found }
    }
}

/// Makes these impulses the warm start, and the rows that have one part of the problem.
fn start_from(contact_problem: &mut ContactProblem, impulses: &[Vec3]) {
    for (row, r) in contact_problem.rows.iter_mut().zip(impulses) {
        row.warm_start = *r;
        row.can_close |= *r != Vec3::zeros();
    }
}

/// Sweeps before the first correction of the bonds, and between two: enough for a warm start, and to find the contacts that open
/// or slide.
const SWEEPS_BETWEEN_CORRECTIONS: u64 = 50;

/// Share of the reduction to the sought residual to which the gradients reduce the velocities: the two are measured differently.
const REDUCTION_MARGIN: f64 = 0.1;

/// Share of the residual below which a correction of the bonds must bring it, so that another one is made.
const MIN_CORRECTION_GAIN: f64 = 0.5;

/// Alternates sweeps with the solution of all bonds and sticking contacts at once, by conjugate gradients whose iterations count as
/// sweeps; continues with sweeps alone where that does not gain.
fn solve_with_bond_corrections(
    contact_problem: &ContactProblem,
    request: SolveRequest,
    max_sweeps: u64,
) -> ContactSolution {
    let StoppingCriteria { target_residual, .. } = request.criteria;
    let sweep = |contact_problem: &ContactProblem, criteria| solve_nlgs(contact_problem, criteria, request.width);
    let first = max_sweeps.min(SWEEPS_BETWEEN_CORRECTIONS.max(request.criteria.min_sweeps));
    let mut best = sweep(contact_problem, StoppingCriteria { max_sweeps: first, ..request.criteria });
    let is_reached = |solution: &ContactSolution| solution.residual <= target_residual && solution.left_out == 0;
    let mut contact_problem = contact_problem.clone();
    let mut gains = true;
    while !is_reached(&best) && best.sweeps < max_sweeps && !activity::is_stopped() {
        let left = max_sweeps - best.sweeps;
        let start = ContactReactions { impulses: best.impulses.clone(), moments: best.moments.clone() };
        let (start, iterations) = if gains {
            let reduction = REDUCTION_MARGIN * target_residual / best.residual;
            corrected_reactions(
                &contact_problem,
                start,
                &best.solver_bodies,
                &[],
                GradientLimits { reduction, iterations: left },
            )
        } else {
            (start, 0)
        };
        start_from(&mut contact_problem, &start.impulses);
        contact_problem.rolling_constraints.iter_mut().zip(&start.moments).for_each(|(roll, m)| roll.warm_start = *m);
        let left = left - iterations;
        let round = if gains { left.min(SWEEPS_BETWEEN_CORRECTIONS) } else { left };
        let last = sweep(&contact_problem, StoppingCriteria { max_sweeps: round, min_sweeps: 0, ..request.criteria });
        let sweeps = best.sweeps + iterations + last.sweeps;
        let is_last = !gains;
        gains = last.residual <= MIN_CORRECTION_GAIN * best.residual;
        best = if last.converged || last.residual < best.residual { last } else { best };
        best.sweeps = sweeps;
        if is_last || best.converged && !gains {
            break;
        }
    }
    best
}

/// Alternates sweeps with the direct solution of stagnating subproblems: the contacts in which the sweeps of a large scene
/// cycle, against the impulses of all others. If there is no such subproblem, the sweeps are just slow, and continue.
fn solve_with_subproblem_corrections(
    contact_problem: &ContactProblem,
    request: SolveRequest,
    max_sweeps: u64,
    to_stored: impl Fn(&ContactProblem) -> StoredProblem,
) -> ContactSolution {
    let sweep = |contact_problem: &ContactProblem, max_sweeps| {
        solve_nlgs(contact_problem, StoppingCriteria { max_sweeps, ..request.criteria }, request.width)
    };
    let mut last = sweep_with_associated_law(contact_problem, request, max_sweeps.min(MOMENTUM_CYCLE), max_sweeps);
    if last.converged || last.sweeps >= max_sweeps {
        return last;
    }
    let mut contact_problem = contact_problem.clone();
    let mut best = last.clone();
    while !best.converged && best.sweeps < max_sweeps && !activity::is_stopped() {
        let solved = solve_stalled_subproblem(&contact_problem, &last.impulses, request.width, &to_stored);
        let fallback_used = last.fallback_used || solved.is_some();
        let round = if solved.is_some() { COSTS.sweeps_between_subproblems } else { MOMENTUM_CYCLE };
        let sweeps = round.min(max_sweeps - best.sweeps);
        start_from(&mut contact_problem, &solved.unwrap_or(last.impulses));
        last = ContactSolution { fallback_used, ..sweep(&contact_problem, sweeps) };
        let sweeps = best.sweeps + last.sweeps;
        // A converged solution takes no more sweeps and ends the loop.
        best = if last.converged || last.residual < best.residual { last.clone() } else { best };
        best.sweeps = sweeps;
    }
    best
}

/// Impulses after a stagnating subproblem has been solved on the stored matrix; `None` if the residual is spread over all
/// rows.
fn solve_stalled_subproblem(
    contact_problem: &ContactProblem,
    impulses: &[Vec3],
    width: SimdWidth,
    to_stored: impl Fn(&ContactProblem) -> StoredProblem,
) -> Option<Vec<Vec3>> {
    let can_act = |k: &ContactId| contact_problem.rows[k.index()].can_close || impulses[k.index()] != Vec3::zeros();
    let rows: Vec<ContactId> = (0..contact_problem.rows.len()).map(ContactId::new).filter(can_act).collect();
    let evaluator = ResidualEvaluator::new(contact_problem, &rows, width);
    // Rows with their contributions to |F|², the largest first.
    let contributions = evaluator.contributions(impulses, &evaluator.body_motions(impulses));
    let total = contributions.iter().sum::<f64>();
    let mut worst: Vec<(ContactId, f64)> = rows.iter().copied().zip(contributions).collect();
    worst.sort_by(|(_, a), (_, b)| b.total_cmp(a));
    worst.truncate(COSTS.subproblem_rows);
    if worst.iter().map(|(_, contribution)| contribution).sum::<f64>() < COSTS.min_subproblem_share * total {
        return None;
    }
    // The subproblem is all rows of the moving bodies of these.
    let bodies = |row: ContactId| contact_problem.rows[row.index()].bodies.map(|body| body.index());
    let mut is_touched = vec![false; contact_problem.bodies.len()];
    let moving_bodies =
        worst.iter().flat_map(|(row, _)| bodies(*row)).filter(|body| contact_problem.bodies[*body].inverse_mass > 0.0);
    moving_bodies.for_each(|body| is_touched[body] = true);
    let mut is_inside = vec![false; contact_problem.rows.len()];
    rows.iter().for_each(|row| is_inside[row.index()] = bodies(*row).iter().any(|body| is_touched[*body]));
    let outer_impulse = |(r, is_inside): (&Vec3, &bool)| if *is_inside { Vec3::zeros() } else { *r };
    let outer_impulses: Vec<Vec3> = impulses.iter().zip(&is_inside).map(outer_impulse).collect();
    let mut subproblem = ContactProblem {
        bodies: evaluator.solver_bodies(&evaluator.body_motions(&outer_impulses)),
        ..contact_problem.clone()
    };
    subproblem.rows.iter_mut().zip(&is_inside).for_each(|(row, is_inside)| row.can_close = *is_inside);
    let max_cost = COSTS.subproblem_budget(rows.len());
    let limits = |matrix: &MatrixProblem, from: &[[f64; 3]]| SolverLimits {
        tol: COSTS.subproblem_tolerance * residual(matrix, from),
        max_sweeps: u64::MAX,
        max_time: None,
        max_cost,
    };
    Some(solve_on_matrix(&subproblem, impulses, MatrixSolver::Auto, limits, to_stored)?.0)
}

/// Solves the rows that can close by a solver of stored problems, from `impulses`. Returns all impulses, with those of these
/// rows replaced, and the solver's result; `None` if the stored problem is rejected.
fn solve_on_matrix(
    contact_problem: &ContactProblem,
    impulses: &[Vec3],
    solver: MatrixSolver,
    limits: impl FnOnce(&MatrixProblem, &[[f64; 3]]) -> SolverLimits,
    to_stored: impl Fn(&ContactProblem) -> StoredProblem,
) -> Option<(Vec<Vec3>, matrix::MatrixSolution)> {
    let problem = to_stored(contact_problem);
    let local = |(row, frame): &(ContactId, [Vec3; 3])| to_local(frame, &impulses[row.index()]).into();
    let from: Vec<[f64; 3]> = problem.rows.iter().map(local).collect();
    let matrix = MatrixProblem::new(problem.mu, problem.q, problem.blocks).ok()?;
    let found = solve(&matrix, solver, &from, limits(&matrix, &from));
    let mut impulses = impulses.to_vec();
    for ((row, frame), r) in problem.rows.iter().zip(&found.r) {
        impulses[row.index()] = to_world(frame, &(*r).into());
    }
    Some((impulses, found))
}

/// Continues from `start` with a solver of stored problems. Returns the better of the two by E; it has converged if it
/// reaches the `tol` of the request.
fn solve_by_fallback(
    contact_problem: &ContactProblem,
    start: ContactSolution,
    solver: MatrixSolver,
    limits: SolverLimits,
    request: SolveRequest,
    to_stored: impl Fn(&ContactProblem) -> StoredProblem,
) -> ContactSolution {
    let mut contact_problem = contact_problem.clone();
    // Rows that the sweeps have included are part of the problem.
    for (row, r) in contact_problem.rows.iter_mut().zip(&start.impulses) {
        row.can_close |= *r != Vec3::zeros();
    }
    let mut best = ContactSolution { stalled_residual: Some(start.residual), ..start };
    let mut remaining = limits;
    loop {
        let rows: Vec<ContactId> =
            (0..).zip(&contact_problem.rows).filter(|(_, row)| row.can_close).map(|(k, _)| ContactId(k)).collect();
        let evaluator = ResidualEvaluator::new(&contact_problem, &rows, request.width);
        best.residual = evaluator.residual(&best.impulses).value;
        let balance: Vec<[f64; 3]> =
            rows.iter().map(|row| [contact_problem.rows[row.index()].balancing_impulse(), 0.0, 0.0]).collect();
        let limits_of = |matrix: &MatrixProblem, _: &[[f64; 3]]| SolverLimits {
            tol: COSTS.tolerance_share * limits.tol.max(evaluator.relative_floor()) * residual(matrix, &balance),
            ..remaining
        };
        let Some((impulses, found)) = solve_on_matrix(&contact_problem, &best.impulses, solver, limits_of, &to_stored)
        else {
            return best;
        };
        let motions = evaluator.body_motions(&impulses);
        let residual = evaluator.residual_at(&impulses, &motions);
        best.sweeps += found.sweeps;
        remaining.max_sweeps = remaining.max_sweeps.saturating_sub(found.sweeps);
        remaining.max_cost -= found.cost;
        if residual.value < best.residual && evaluator.rounding_share(&impulses) <= COSTS.max_rounding_share {
            best = ContactSolution {
                solver_bodies: evaluator.solver_bodies(&motions),
                impulses,
                residual: residual.value,
                worst: residual.worst,
                fallback_used: true,
                ..best
            };
        }
        best.active_rows = rows.len();
        let missed = closing_inactive_rows(&contact_problem, &rows, &best.solver_bodies);
        best.converged = best.residual <= request.criteria.tol && missed.is_empty();
        best.left_out = missed.len();
        if missed.is_empty() || activity::is_stopped() || remaining.max_sweeps == 0 || remaining.max_cost <= 0.0 {
            best.worst = best.worst.or(missed.first().copied());
            return best;
        }
        missed.into_iter().for_each(|row| contact_problem.rows[row.index()].can_close = true);
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;
    use crate::assemble::{ContactConstraint, SolverBody};
    use crate::scene::BodyId;

    /// Balls of mass 1 that come down on one floor at 1 m/s.
    fn balls(count: u32) -> ContactProblem {
        let record = |v: f64, inverse_mass: f64| SolverBody {
            v: Vec3::z() * v,
            inverse_mass,
            w: Vec3::zeros(),
            inverse_inertia: 10.0 * inverse_mass,
            radius: 0.5 * inverse_mass,
        };
        let row = |k: u32| ContactConstraint {
            bodies: [BodyId(k), BodyId(count)],
            normal: Vec3::z(),
            arm: 1.0,
            w_n: 1.0,
            w_t: 3.5,
            friction: 0.5,
            acts: true,
            can_close: true,
            ..ContactConstraint::default()
        };
        let mut solver_bodies = vec![record(-1.0, 1.0); count as usize];
        solver_bodies.push(record(0.0, 0.0));
        ContactProblem {
            rows: (0..count).map(row).collect(),
            block_data: None,
            rolling_constraints: vec![],
            memories: vec![],
            pair_attractions: vec![],
            regularised: vec![],
            order: (0..=count).collect(),
            bodies: solver_bodies,
        }
    }

    /// Stored problem of the rows of such balls that can close; they are not coupled.
    fn diagonal_problem(contact_problem: &ContactProblem) -> StoredProblem {
        let rows: Vec<ContactId> =
            (0..).zip(&contact_problem.rows).filter(|(_, row)| row.can_close).map(|(k, _)| ContactId(k)).collect();
        let of = |k: &ContactId| &contact_problem.rows[k.index()];
        let diagonal = |row: &ContactConstraint| [[row.w_n, 0.0, 0.0], [0.0, row.w_t, 0.0], [0.0, 0.0, row.w_t]];
        StoredProblem {
            mu: rows.iter().map(|k| of(k).friction).collect(),
            q: rows.iter().map(|k| [contact_problem.bodies[k.index()].v.z, 0.0, 0.0]).collect(),
            blocks: rows.iter().enumerate().map(|(i, k)| (i, i, diagonal(of(k)))).collect(),
            rows: rows.iter().map(|k| (*k, [Vec3::z(), Vec3::x(), Vec3::y()])).collect(),
        }
    }

    /// Reason why sweeps replaced the requested solver, and whether the problem was written out.
    fn solved(contact_problem: &ContactProblem, solver: ContactSolver) -> (Option<&'static str>, bool) {
        let is_written = Cell::new(false);
        let stored = |contact_problem: &ContactProblem| {
            is_written.set(true);
            diagonal_problem(contact_problem)
        };
        let request = SolveRequest {
            solver,
            criteria: StoppingCriteria::new(1e-9, 50),
            width: SimdWidth::detect(),
            fallback_suppressed: false,
        };
        let solution = solve_contact_problem(contact_problem, request, stored);
        assert!(solution.converged && solution.residual <= 1e-9, "{solver}");
        (solution.replacement_reason, is_written.get())
    }

    #[test]
    fn rows_that_sweeps_included_are_solved_again() {
        let mut contact_problem = balls(2);
        // The second ball flies off; the sweeps nevertheless gave it an impulse.
        contact_problem.bodies[1].v = Vec3::z();
        contact_problem.rows[1].can_close = false;
        let swept = solve_nlgs(&contact_problem, StoppingCriteria::new(1e-9, 0), SimdWidth::detect());
        let start = ContactSolution { impulses: vec![Vec3::zeros(), Vec3::z()], ..swept };
        let limits = SolverLimits { tol: 1e-9, max_sweeps: 50, max_time: None, max_cost: f64::INFINITY };
        let until = StoppingCriteria::new(1e-9, 50);
        let request = SolveRequest {
            solver: ContactSolver::ProxNewton,
            criteria: until,
            width: SimdWidth::detect(),
            fallback_suppressed: false,
        };
        let solution =
            solve_by_fallback(&contact_problem, start, MatrixSolver::ProxNewton, limits, request, diagonal_problem);
        assert!(solution.converged && solution.active_rows == 2);
        for (k, r) in [1.0, 0.0].into_iter().enumerate() {
            assert!((solution.impulses[k] - Vec3::z() * r).norm() < 1e-9, "{k}: {}", solution.impulses[k]);
            assert_eq!(solution.solver_bodies[k].v, contact_problem.bodies[k].v + solution.impulses[k]); // of mass 1
        }
    }

    #[test]
    fn sweeps_continue_where_the_fallback_has_failed() {
        let contact_problem = balls(3);
        let request = SolveRequest {
            solver: ContactSolver::Auto,
            criteria: StoppingCriteria::new(1e-9, 50),
            width: SimdWidth::detect(),
            fallback_suppressed: false,
        };
        let start = solve_nlgs(&contact_problem, StoppingCriteria::new(1e-9, 0), request.width);
        let failed = ContactSolution { sweeps: 40, stalled_residual: Some(0.5), fallback_used: true, ..start };
        let solution = continue_sweeps(&contact_problem, failed.clone(), 50, request);
        assert!(solution.converged && !solution.fallback_used && solution.stalled_residual == Some(0.5));
        assert!((41..=50).contains(&solution.sweeps), "{}", solution.sweeps);
        // Without sweeps left the result of the fallback is kept.
        let kept = continue_sweeps(&contact_problem, failed, 40, request);
        assert!(!kept.converged && kept.fallback_used && kept.sweeps == 40);
    }

    #[test]
    fn a_stagnating_subproblem_is_solved_and_a_spread_residual_is_left_to_sweeps() {
        let contact_problem = balls(1000);
        let solved = |impulses: &[Vec3]| {
            solve_stalled_subproblem(&contact_problem, impulses, SimdWidth::detect(), diagonal_problem)
        };
        // Each of mass 1 must lose 1 m/s.
        let mut impulses = vec![Vec3::z(); 1000];
        impulses[7] *= 0.5;
        let found = solved(&impulses).unwrap();
        // The residual without them falls from 0.5 to a tenth.
        assert!(
            (found[7] - Vec3::z()).norm() <= COSTS.subproblem_tolerance * 0.5 && found[999] == impulses[999],
            "{}",
            found[7]
        );
        impulses.fill(Vec3::z() * 0.5);
        assert_eq!(solved(&impulses), None);
        // Too large for the stored solvers as a whole, and solved in one check of the sweeps.
        let request = SolveRequest {
            solver: ContactSolver::Auto,
            criteria: StoppingCriteria::new(1e-9, 5000),
            width: SimdWidth::detect(),
            fallback_suppressed: false,
        };
        let solution = solve_with_subproblem_corrections(&contact_problem, request, 5000, diagonal_problem);
        assert!(solution.converged && !solution.fallback_used);
    }

    #[test]
    fn failures_double_the_backoff_and_a_late_solution_ends_it() {
        let solution = |converged, sweeps| {
            let solved = solve_nlgs(&balls(1), StoppingCriteria::new(1e-9, 50), SimdWidth::detect());
            ContactSolution { converged, sweeps, ..solved }
        };
        let until = |max_sweeps| StoppingCriteria::new(1e-9, max_sweeps);
        let request = SolveRequest {
            solver: ContactSolver::Auto,
            criteria: until(5000),
            width: SimdWidth::detect(),
            fallback_suppressed: false,
        };
        let mut fallback = FallbackState::default();
        for (step, due) in [(10, 16), (16, 28), (28, 52)] {
            update_backoff(&mut fallback, request, step, 3, &solution(false, 5000)); // steps of three units
            assert_eq!(fallback.due, due);
        }
        // A step that sweeps solve at once gives no information on steps that stall.
        update_backoff(&mut fallback, request, 52, 3, &solution(true, MOMENTUM_CYCLE));
        assert_eq!(fallback.failures, 3);
        (0..9).for_each(|_| update_backoff(&mut fallback, request, 55, 1, &solution(false, 5000)));
        assert_eq!(fallback, FallbackState { failures: 8, due: 55 + 256 });
        let onwards = SolveRequest { criteria: StoppingCriteria { target_residual: 1e-10, ..until(5000) }, ..request };
        update_backoff(&mut fallback, onwards, 199, 1, &solution(true, MOMENTUM_CYCLE + 1));
        assert_eq!(fallback.failures, 8);
        update_backoff(&mut fallback, request, 200, 1, &solution(true, MOMENTUM_CYCLE + 1));
        assert_eq!(fallback, FallbackState::default());
        // A tenfold reduction of E counts as a success.
        let solved =
            |stalled, residual| ContactSolution { stalled_residual: Some(stalled), residual, ..solution(false, 5000) };
        update_backoff(&mut fallback, request, 250, 1, &solved(1e-2, 9e-4));
        assert_eq!(fallback, FallbackState::default());
        update_backoff(&mut fallback, request, 260, 1, &solved(1e-2, 2e-3));
        assert_eq!(fallback, FallbackState { failures: 1, due: 262 });
        fallback = FallbackState::default();
        // With at most one round allowed there is no fallback to suppress and no failure to record.
        let short = SolveRequest { criteria: until(MOMENTUM_CYCLE), ..request };
        update_backoff(&mut fallback, short, 300, 1, &solution(false, MOMENTUM_CYCLE));
        assert_eq!(fallback, FallbackState::default());
        assert!(
            SolveRequest { fallback_suppressed: true, ..request }.skips_fallback()
                && !SolveRequest { fallback_suppressed: true, ..short }.skips_fallback()
        );
    }

    #[test]
    fn no_result_worse_than_zero_impulses_is_kept() {
        let mut contact_problem = balls(3);
        // Warm start of a step without a solution.
        contact_problem.rows.iter_mut().for_each(|row| row.warm_start = Vec3::z() * 1e17);
        for (solver, sweeps) in [(ContactSolver::Auto, 0), (ContactSolver::Nlgs, 0), (ContactSolver::Nlgs, 100)] {
            let request = SolveRequest {
                solver,
                criteria: StoppingCriteria::new(1e-9, sweeps),
                width: SimdWidth::detect(),
                fallback_suppressed: false,
            };
            let solution = solve_contact_problem(&contact_problem, request, diagonal_problem);
            // Each must lose 1 m/s.
            let expected = if sweeps == 0 { 1.0 } else { 0.0 };
            assert!(solution.residual <= expected + 1e-9, "{solver}: {}", solution.residual);
            assert!(solution.impulses.iter().all(|r| (r.z - (1.0 - expected)).abs() < 1e-9), "{:?}", solution.impulses);
        }
    }

    #[test]
    fn impulses_that_round_the_momenta_away_are_rejected() {
        let contact_problem = balls(2);
        let rows = [0, 1].map(ContactId);
        let evaluator = ResidualEvaluator::new(&contact_problem, &rows, SimdWidth::detect());
        // Two balls of mass 1 at 1 m/s have the momentum √2 N s, more than |F(0)|.
        let rounding = evaluator.rounding_share(&[Vec3::z() * 1e12, Vec3::zeros()]);
        assert!((rounding / (f64::EPSILON * 1e12 / 2f64.sqrt()) - 1.0).abs() < 1e-12, "{rounding}");
        assert!(
            rounding > COSTS.max_rounding_share && evaluator.rounding_share(&[Vec3::z(); 2]) < COSTS.max_rounding_share
        );
    }

    #[test]
    fn only_solvers_with_factors_are_replaced_and_report_it() {
        use ContactSolver::{Admm, Auto, InteriorPoint, Nlgs, NlgsAnderson, ProxNewton};
        let (few, many) = (balls(10), balls(COSTS.max_factored_contacts as u32));
        for solver in [NlgsAnderson, ProxNewton, Admm, InteriorPoint] {
            assert_eq!(solved(&few, solver), (None, true), "{solver}");
        }
        for solver in [ProxNewton, Admm, InteriorPoint] {
            assert_eq!(solved(&many, solver), (Some(TOO_LARGE_REASON), false), "{solver}");
        }
        assert_eq!(solved(&many, NlgsAnderson), (None, true));
        for solver in [Auto, Nlgs] {
            assert_eq!(solved(&many, solver), (None, false), "{solver}");
        }
    }
}
