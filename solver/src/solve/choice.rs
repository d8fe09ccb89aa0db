//! Who solves the contact problem of a step, and who comes after where the sweeps stall.

use cd_formats::compute::ContactSolver;
use cd_formats::snapshot::Fallback;

use crate::assemble::{StoredProblem, System};
use crate::math::lanes::Width;
use crate::math::{Vec3, to_local, to_world};
use crate::solve::nlgs::{ROUND, Solution, Until, closing_outside, nlgs};
use crate::solve::residual::Judge;
use crate::solve::rolling;
use crate::solve::stored::{Limits, Problem, Solver, newton_cost, residual, solve};

/// What a step asks of its solver.
#[derive(Debug, Clone, Copy)]
pub struct Task {
    pub solver: ContactSolver,
    pub until: Until,
    pub width: Width,
    /// Whether `auto` is spared all but one round of sweeps.
    pub spared: bool,
}

impl Task {
    /// Whether `auto` may spend more than one round of sweeps on it, unless it is spared.
    fn tries(&self) -> bool {
        self.solver == ContactSolver::Auto && self.until.max_sweeps > ROUND
    }

    /// Whether one round of sweeps is all that it gets, of more that were allowed.
    pub fn gives_up(&self) -> bool {
        self.spared && self.tries()
    }
}

/// `auto` gives the sweeps as many rounds of their momentum's caps as cost so many Newton steps, which are what comes
/// after, but at least one, and then half of what is allowed at most.
const ROUNDS: f64 = 1.5;
/// What comes after the sweeps of `auto` may cost as much as this many sweeps ...
const PATIENCE: f64 = 200_000.0;
/// ... and is not begun if that does not pay for so many Newton steps.
const WORTH: f64 = 20.0;
/// One contact in one sweep, in units of [`newton_cost`].
const SWEPT: f64 = 6.0;
/// From so many contacts on factors take gigabytes: sweeps take the place of the solvers that need them.
const LARGE: usize = 30_000;
const TOO_LARGE: &str = "the factors of 30 000 contacts and more take gigabytes";
/// The stored solvers aim a little below the tolerance, which is judged by other sums than theirs.
const AIM: f64 = 0.9;

/// After k failures in a row `auto` does all that it can 2^k steps later, where this is the largest k: what is in vain
/// costs as much as hundreds of steps.
const MOST_FAILURES: u32 = 8;

/// What the solution of a step, so many units of `dt` long, tells of the next.
pub fn learn(fallback: &mut Fallback, task: Task, step: u64, units: u64, solution: &Solution) {
    if task.spared || !task.tries() {
        return;
    }
    if !solution.converged {
        let failures = (fallback.failures + 1).min(MOST_FAILURES);
        *fallback = Fallback { failures, due: step + (units << failures) };
    } else if solution.sweeps > ROUND {
        *fallback = Fallback::default();
    }
}

/// Solves to E <= `tol`, or as far as the limits allow; the decisions follow from the problem alone.
///
/// `stored` writes the rows that can close as a problem with its Delassus matrix.
pub fn contact_problem(system: &System, task: Task, stored: impl Fn(&System) -> StoredProblem) -> Solution {
    let Until { tol, max_sweeps: limit, .. } = task.until;
    let limit = if task.gives_up() { limit.min(ROUND) } else { limit };
    if !system.rolls.is_empty() {
        return rolling::nlgs(system, Until { max_sweeps: limit, ..task.until }, task.width);
    }
    let contacts = system.rows.iter().filter(|row| row.can_close).count();
    let newton = newton_cost(contacts) / (SWEPT * contacts as f64); // sweeps that cost as much
    let pays = contacts < LARGE && PATIENCE >= WORTH * newton;
    let swept = |max_sweeps| nlgs(system, Until { max_sweeps, ..task.until }, task.width);
    let (solver, max_cost) = match task.solver {
        ContactSolver::Nlgs => return swept(limit),
        ContactSolver::Auto if task.gives_up() || !pays => return swept(limit),
        ContactSolver::Auto => (Solver::Auto, PATIENCE * SWEPT * contacts as f64),
        ContactSolver::NlgsAnderson => (Solver::NlgsAnderson, f64::INFINITY),
        _ if contacts >= LARGE => return Solution { replaced: Some(TOO_LARGE), ..swept(limit) },
        ContactSolver::ProxNewton => (Solver::ProxNewton, f64::INFINITY),
        ContactSolver::Admm => (Solver::Admm, f64::INFINITY),
        ContactSolver::InteriorPoint => (Solver::InteriorPoint, f64::INFINITY),
    };
    // The others go on from the warm start.
    let rounds = ((ROUNDS * newton) as u64).min(limit / 2) / ROUND;
    let sweeps = if solver == Solver::Auto { limit.min(ROUND * rounds.max(1)) } else { 0 };
    let start = swept(sweeps);
    if start.converged || start.sweeps >= limit {
        return start;
    }
    let limits = Limits { tol, max_sweeps: limit - start.sweeps, max_time: None, max_cost };
    by_stored(system, start, solver, limits, task.width, stored)
}

/// Goes on from `start` with a solver of stored problems; the better of the two by E.
fn by_stored(
    system: &System,
    start: Solution,
    solver: Solver,
    limits: Limits,
    width: Width,
    stored: impl Fn(&System) -> StoredProblem,
) -> Solution {
    let mut system = system.clone();
    // What the sweeps have taken in is part of the problem.
    for (row, r) in system.rows.iter_mut().zip(&start.impulses) {
        row.can_close |= *r != Vec3::zeros();
    }
    let mut best = start;
    let mut left = limits;
    loop {
        let problem = stored(&system);
        let rows: Vec<u32> = problem.rows.iter().map(|(row, _)| *row).collect();
        let from: Vec<[f64; 3]> =
            problem.rows.iter().map(|(row, frame)| to_local(frame, &best.impulses[*row as usize]).into()).collect();
        let judge = Judge::new(&system, &rows, width);
        best.residual = judge.residual(&best.impulses).value;
        let Ok(matrix) = Problem::new(problem.mu, problem.q, problem.blocks) else { return best };
        let balance: Vec<[f64; 3]> = rows.iter().map(|row| [system.rows[*row as usize].balance(), 0.0, 0.0]).collect();
        left.tol = AIM * limits.tol.max(judge.least()) * residual(&matrix, &balance);
        let found = solve(&matrix, solver, &from, left);
        let mut impulses = best.impulses.clone();
        for ((row, frame), r) in problem.rows.iter().zip(&found.r) {
            impulses[*row as usize] = to_world(frame, &(*r).into());
        }
        let motions = judge.motions(&impulses);
        let residual = judge.residual_at(&impulses, &motions);
        best.sweeps += found.sweeps;
        left.max_sweeps = left.max_sweeps.saturating_sub(found.sweeps);
        left.max_cost -= found.cost;
        if residual.value < best.residual {
            best = Solution {
                records: judge.records(&motions),
                impulses,
                residual: residual.value,
                worst: residual.worst,
                taken_over: true,
                ..best
            };
        }
        best.active = rows.len();
        let missed = closing_outside(&system, &rows, &best.records);
        best.converged = best.residual <= limits.tol && missed.is_empty();
        if missed.is_empty() || left.max_sweeps == 0 || left.max_cost <= 0.0 {
            best.worst = best.worst.or(missed.first().copied());
            return best;
        }
        missed.into_iter().for_each(|row| system.rows[row as usize].can_close = true);
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;
    use crate::assemble::{Record, Row};

    /// Balls of mass 1 that come down on one floor at 1 m/s.
    fn balls(count: u32) -> System {
        let record = |v: f64, inverse_mass: f64| Record {
            v: Vec3::z() * v,
            inverse_mass,
            w: Vec3::zeros(),
            inverse_inertia: 10.0 * inverse_mass,
            radius: 0.5 * inverse_mass,
        };
        let row = |k: u32| Row {
            bodies: [k, count],
            normal: Vec3::z(),
            arm: 1.0,
            w_n: 1.0,
            w_t: 3.5,
            friction: 0.5,
            acts: true,
            can_close: true,
            ..Row::default()
        };
        let mut records = vec![record(-1.0, 1.0); count as usize];
        records.push(record(0.0, 0.0));
        System { rows: (0..count).map(row).collect(), full: None, rolls: vec![], order: (0..=count).collect(), records }
    }

    /// The rows of such balls that can close, which do not feel each other.
    fn written(system: &System) -> StoredProblem {
        let rows: Vec<u32> = (0..).zip(&system.rows).filter(|(_, row)| row.can_close).map(|(k, _)| k).collect();
        let of = |k: &u32| &system.rows[*k as usize];
        let diagonal = |row: &Row| [[row.w_n, 0.0, 0.0], [0.0, row.w_t, 0.0], [0.0, 0.0, row.w_t]];
        StoredProblem {
            mu: rows.iter().map(|k| of(k).friction).collect(),
            q: rows.iter().map(|k| [system.records[*k as usize].v.z, 0.0, 0.0]).collect(),
            blocks: rows.iter().enumerate().map(|(i, k)| (i, i, diagonal(of(k)))).collect(),
            rows: rows.iter().map(|k| (*k, [Vec3::z(), Vec3::x(), Vec3::y()])).collect(),
        }
    }

    /// Why sweeps stood in, and whether the problem was written out.
    fn solved(system: &System, solver: ContactSolver) -> (Option<&'static str>, bool) {
        let asked = Cell::new(false);
        let stored = |system: &System| {
            asked.set(true);
            written(system)
        };
        let task = Task { solver, until: Until::new(1e-9, 50), width: Width::detect(), spared: false };
        let solution = contact_problem(system, task, stored);
        assert!(solution.converged && solution.residual <= 1e-9, "{solver}");
        (solution.replaced, asked.get())
    }

    #[test]
    fn rows_that_sweeps_took_in_are_solved_again() {
        let mut system = balls(2);
        // The second flies off; the sweeps pushed it further all the same.
        system.records[1].v = Vec3::z();
        system.rows[1].can_close = false;
        let swept = nlgs(&system, Until::new(1e-9, 0), Width::detect());
        let start = Solution { impulses: vec![Vec3::zeros(), Vec3::z()], ..swept };
        let limits = Limits { tol: 1e-9, max_sweeps: 50, max_time: None, max_cost: f64::INFINITY };
        let solution = by_stored(&system, start, Solver::ProxNewton, limits, Width::detect(), written);
        assert!(solution.converged && solution.active == 2);
        for (k, r) in [1.0, 0.0].into_iter().enumerate() {
            assert!((solution.impulses[k] - Vec3::z() * r).norm() < 1e-9, "{k}: {}", solution.impulses[k]);
            assert_eq!(solution.records[k].v, system.records[k].v + solution.impulses[k]); // of mass 1
        }
    }

    #[test]
    fn failures_double_the_wait_and_what_is_found_late_ends_it() {
        let solution = |converged, sweeps| {
            let solved = nlgs(&balls(1), Until::new(1e-9, 50), Width::detect());
            Solution { converged, sweeps, ..solved }
        };
        let until = |max_sweeps| Until::new(1e-9, max_sweeps);
        let task = Task { solver: ContactSolver::Auto, until: until(5000), width: Width::detect(), spared: false };
        let mut fallback = Fallback::default();
        for (step, due) in [(10, 16), (16, 28), (28, 52)] {
            learn(&mut fallback, task, step, 3, &solution(false, 5000)); // steps of three units
            assert_eq!(fallback.due, due);
        }
        // A step that sweeps solve at once says nothing of those that stall.
        learn(&mut fallback, task, 52, 3, &solution(true, ROUND));
        assert_eq!(fallback.failures, 3);
        (0..9).for_each(|_| learn(&mut fallback, task, 55, 1, &solution(false, 5000)));
        assert_eq!(fallback, Fallback { failures: 8, due: 55 + 256 });
        learn(&mut fallback, task, 200, 1, &solution(true, ROUND + 1));
        assert_eq!(fallback, Fallback::default());
        // Where no more than a round is allowed there is nothing to spare, and nothing to learn.
        let short = Task { until: until(ROUND), ..task };
        learn(&mut fallback, short, 300, 1, &solution(false, ROUND));
        assert_eq!(fallback, Fallback::default());
        assert!(Task { spared: true, ..task }.gives_up() && !Task { spared: true, ..short }.gives_up());
    }

    #[test]
    fn only_solvers_with_factors_are_replaced_and_that_is_said() {
        use ContactSolver::{Admm, Auto, InteriorPoint, Nlgs, NlgsAnderson, ProxNewton};
        let (few, many) = (balls(10), balls(LARGE as u32));
        for solver in [NlgsAnderson, ProxNewton, Admm, InteriorPoint] {
            assert_eq!(solved(&few, solver), (None, true), "{solver}");
        }
        for solver in [ProxNewton, Admm, InteriorPoint] {
            assert_eq!(solved(&many, solver), (Some(TOO_LARGE), false), "{solver}");
        }
        assert_eq!(solved(&many, NlgsAnderson), (None, true));
        for solver in [Auto, Nlgs] {
            assert_eq!(solved(&many, solver), (None, false), "{solver}");
        }
    }
}
