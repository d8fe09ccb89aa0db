//! The contact problem of one step in stored form: u = W r + q with W in 3x3 blocks.
//!
//! For problems given as a matrix: small hyperstatic ones for which sweeps converge slowly, and problems of other programs.
//! Local order: normal, two tangents.
//!
//! | module | contents |
//! |---|---|
//! | `admm` | alternating directions of multipliers |
//! | `anderson` | acceleration of a fixed point iteration |
//! | `factors` | full or sparse factors of a matrix |
//! | `interior_point` | an interior-point method |
//! | `local` | one contact with a full block, exactly |
//! | `gauss_seidel` | nonlinear Gauss-Seidel, plain and with Anderson's acceleration |
//! | `newton` | proximal point with a semismooth Newton method inside |
//! | `problem` | the problem, and the costs of its solvers |
//! | `run` | a run of solvers, and its limits |
//! | `scaled` | the problem in units in which diagonal blocks have trace 3 |
//! | `residual` | residual of a solution |
//! | `types` | vectors and blocks of the local order |

mod admm;
mod anderson;
mod factors;
mod gauss_seidel;
mod interior_point;
mod local;
mod newton;
mod problem;
mod residual;
mod run;
mod scaled;
mod types;

pub use local::LocalSolver;
pub use problem::{MatrixProblem, MatrixProblemError, newton_cost};
pub use residual::residual;
pub use run::SolverLimits;
use run::SolverRun;
pub use types::{LocalVector, MatrixBlock};

/// Solvers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MatrixSolver {
    /// All others in turn, as long as the cost allows.
    Auto,
    /// Nonlinear Gauss-Seidel.
    Nlgs,
    /// Nonlinear Gauss-Seidel with Anderson's acceleration.
    NlgsAnderson,
    /// Proximal point with Newton's method inside.
    ProxNewton,
    /// Alternating directions of multipliers.
    Admm,
    /// Interior-point method, and Newton's if rounding stops it.
    InteriorPoint,
}

impl MatrixSolver {
    /// All solvers with their names.
    pub const ALL: [(&'static str, MatrixSolver); 6] = [
        ("auto", MatrixSolver::Auto),
        ("nlgs", MatrixSolver::Nlgs),
        ("nlgs-anderson", MatrixSolver::NlgsAnderson),
        ("prox-newton", MatrixSolver::ProxNewton),
        ("admm", MatrixSolver::Admm),
        ("interior-point", MatrixSolver::InteriorPoint),
    ];
}

/// Number of Newton steps after which the method starts again: as many as `auto` gives it from 0.
const STEPS_BEFORE_RESTART: u64 = 400;
/// Number of accelerated sweeps between two such starts: the smallest number that `auto` makes before its other solvers.
const SWEEPS_BEFORE_RESTART: u64 = 100;

/// Result of a solver: its best iterate.
#[derive(Debug, Clone)]
pub struct MatrixSolution {
    /// Impulses, N s.
    pub r: Vec<LocalVector>,
    /// Passes over the contacts.
    pub sweeps: u64,
    /// Total cost, see [`newton_cost`].
    pub cost: f64,
    /// Residual, see `residual`.
    pub residual: f64,
    pub converged: bool,
}

/// Solves to a residual of at most `limits.tol`, or returns the best iterate. Starts from the impulses `start`, or from 0 if
/// these are better.
pub fn solve(
    problem: &MatrixProblem,
    solver: MatrixSolver,
    start: &[LocalVector],
    limits: SolverLimits,
) -> MatrixSolution {
    let mut run = SolverRun::new(problem, limits);
    let zero_residual = run.best_residual;
    let is_warm_start = start.len() == problem.len() && run.record_iterate(start) < zero_residual;
    match solver {
        MatrixSolver::Auto => run_fallback_sequence(&mut run, is_warm_start),
        MatrixSolver::Nlgs => gauss_seidel::solve_nlgs(&mut run, 0, u64::MAX),
        MatrixSolver::NlgsAnderson => gauss_seidel::solve_nlgs(&mut run, gauss_seidel::ANDERSON_DEPTH, u64::MAX),
        MatrixSolver::ProxNewton => run_newton_with_restarts(&mut run),
        MatrixSolver::Admm => admm::solve_admm(&mut run, u64::MAX),
        MatrixSolver::InteriorPoint => interior_point::interior_point(&mut run, u64::MAX),
    }
    let converged = run.best_residual <= limits.tol;
    MatrixSolution {
        residual: residual(problem, &run.best_r),
        r: run.best_r,
        sweeps: run.sweeps,
        cost: run.cost,
        converged,
    }
}

/// Runs Newton's method from 0. Where it stagnates, accelerated sweeps from the best iterate leave the region in which it does,
/// and it continues from there; each time with twice the budget.
fn run_newton_with_restarts(run: &mut SolverRun) {
    let mut start = vec![[0.0; 3]; run.problem.len()];
    for round in 0.. {
        let factor = 2u64.saturating_pow(round);
        newton::prox_newton(run, &start, factor.saturating_mul(STEPS_BEFORE_RESTART));
        if run.is_over() {
            return;
        }
        gauss_seidel::solve_nlgs(run, gauss_seidel::ANDERSON_DEPTH, factor.saturating_mul(SWEEPS_BEFORE_RESTART));
        start.copy_from_slice(&run.best_r);
    }
}

/// Runs the solvers in turn. First accelerated sweeps, as many as cost ten Newton steps, 100 to 1000. If they stall, the
/// interior-point method once; it makes no use of earlier results, and so after a warm start a few steps of Newton's method
/// come before it. Then ADMM and Newton from the best so far, and Newton from 0, which at times converges where the others
/// fail; then all again with four times the budget.
fn run_fallback_sequence(run: &mut SolverRun, is_warm_start: bool) {
    let problem = run.problem;
    let (sweep, newton) = (problem.sweep_cost(), problem.newton_cost());
    for round in 0.. {
        let factor = 4u64.saturating_pow(round);
        let steps = factor.saturating_mul(20);
        let sweeps = (0.5 * steps as f64 * newton / sweep) as u64;
        gauss_seidel::solve_nlgs(run, gauss_seidel::ANDERSON_DEPTH, sweeps.clamp(100, factor.saturating_mul(1000)));
        if round == 0 && is_warm_start {
            newton::prox_newton(run, &run.best_r.clone(), steps);
        }
        if round == 0 {
            interior_point::interior_point(run, steps.saturating_mul(3));
        }
        admm::solve_admm(run, steps.saturating_mul(5));
        newton::prox_newton(run, &run.best_r.clone(), steps.saturating_mul(5));
        newton::prox_newton(run, &vec![[0.0; 3]; problem.len()], steps.saturating_mul(20));
        if run.is_over() {
            return;
        }
    }
}
