//! The contact problem of one step in stored form: u = W r + q with W in 3x3 blocks.
//!
//! For problems given as a matrix: small hyperstatic ones for which sweeps converge slowly, and those of other programs.
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
//! | `scaled` | the problem in units in which diagonal blocks have trace 3 |
//! | `residual` | residual of a solution |

mod admm;
mod anderson;
mod factors;
mod gauss_seidel;
mod interior_point;
mod local;
mod newton;
mod residual;
mod scaled;

use std::time::{Duration, Instant};

use crate::activity;

pub use local::LocalSolver;
pub use residual::residual;

/// Components along n, t1, t2.
pub type LocalVector = [f64; 3];
/// A 3x3 block, row by row.
pub type MatrixBlock = [LocalVector; 3];

/// Problem u = W r + q with Signorini's condition and Coulomb's law at each contact.
#[derive(Debug, Clone)]
pub struct MatrixProblem {
    /// Friction of each contact.
    pub mu: Vec<f64>,
    /// Relative velocity of each contact without impulses, m/s.
    pub q: Vec<LocalVector>,
    /// Start of the blocks of each row, and the end of the last.
    starts: Vec<usize>,
    columns: Vec<u32>,
    /// Blocks of W, 1/kg.
    blocks: Vec<MatrixBlock>,
}

/// Largest magnitude of a number: squares of larger ones, and of their products, are not finite.
const MAX_MAGNITUDE: f64 = 1e100;

impl MatrixProblem {
    /// Builds the problem from the blocks (row, column, block) of W in any order; blocks at the same position are added up.
    /// Numbers that are not finite or as large as 1e100, a negative friction and a contact out of range are rejected.
    pub fn new(
        mu: Vec<f64>,
        q: Vec<LocalVector>,
        blocks: impl IntoIterator<Item = (usize, usize, MatrixBlock)>,
    ) -> Result<Self, String> {
        let n = q.len();
        if mu.len() != n {
            return Err(format!("{} frictions for {n} contacts", mu.len()));
        }
        let mut blocks: Vec<_> = blocks.into_iter().collect();
        // One block on every diagonal, as solvers require.
        blocks.extend((0..n).map(|k| (k, k, [[0.0; 3]; 3])));
        blocks.sort_by_key(|&(i, j, _)| (i, j));
        let mut problem = MatrixProblem { mu, q, starts: vec![0; n + 1], columns: Vec::new(), blocks: Vec::new() };
        let mut last = None;
        for (i, j, w) in blocks {
            if i >= n || j >= n || !w.as_flattened().iter().all(|x| x.abs() < MAX_MAGNITUDE) {
                return Err(format!("block ({i}, {j}) of {n} contacts is {w:?}"));
            }
            if last == Some((i, j)) {
                let sum = problem.blocks.last_mut().into_iter().flat_map(|sum| sum.as_flattened_mut());
                sum.zip(w.as_flattened()).for_each(|(sum, x)| *sum += x);
            } else {
                problem.columns.push(j as u32);
                problem.blocks.push(w);
                problem.starts[i + 1] = problem.blocks.len();
                last = Some((i, j));
            }
        }
        for (k, (mu, q)) in problem.mu.iter().zip(&problem.q).enumerate() {
            if !(mu.abs() < MAX_MAGNITUDE && *mu >= 0.0 && q.iter().all(|x| x.abs() < MAX_MAGNITUDE)) {
                return Err(format!("contact {k} has friction {mu:?} and q = {q:?}"));
            }
        }
        Ok(problem)
    }

    /// Number of contacts.
    pub fn len(&self) -> usize {
        self.q.len()
    }

    pub fn is_empty(&self) -> bool {
        self.q.is_empty()
    }

    /// Columns and blocks of row `i`.
    pub fn row_blocks(&self, i: usize) -> impl Iterator<Item = (usize, &MatrixBlock)> {
        let place = self.starts[i]..self.starts[i + 1];
        self.columns[place.clone()].iter().map(|&j| j as usize).zip(&self.blocks[place])
    }

    /// Relative velocities u = W r + q.
    pub fn relative_velocities(&self, r: &[LocalVector]) -> Vec<LocalVector> {
        let add = |mut u: LocalVector, (j, w): (usize, &MatrixBlock)| {
            for k in 0..3 {
                u[k] += w[k][0] * r[j][0] + w[k][1] * r[j][1] + w[k][2] * r[j][2];
            }
            u
        };
        (0..self.len()).map(|i| self.row_blocks(i).fold(self.q[i], add)).collect()
    }

    /// Cost of one Newton step, see [`newton_cost`].
    fn newton_cost(&self) -> f64 {
        step_cost(self.len(), self.blocks.len())
    }

    /// Cost of one accelerated sweep, see [`newton_cost`].
    fn sweep_cost(&self) -> f64 {
        1e3 + 2.5 * self.blocks.len() as f64 + 25.0 * self.len() as f64
    }

    /// Diagonal blocks W_ii.
    pub fn diagonal_blocks(&self) -> impl Iterator<Item = &MatrixBlock> {
        (0..self.len()).filter_map(|i| self.row_blocks(i).find(|(j, _)| *j == i).map(|(_, w)| w))
    }
}

/// Assumed blocks of W per contact: those of itself and of the other contacts of two grains with five each.
const BLOCKS_PER_CONTACT: usize = 9;

/// Cost of one Newton step of a problem with this number of contacts of grains: about 1e-9 s on one core. It is computed, not
/// measured, so that decisions based on it are the same on every machine.
pub fn newton_cost(contacts: usize) -> f64 {
    step_cost(contacts, BLOCKS_PER_CONTACT * contacts)
}

fn step_cost(contacts: usize, blocks: usize) -> f64 {
    5e4 + factors::factor_cost(3 * contacts, 9 * blocks)
}

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

/// Limits of a solver.
#[derive(Debug, Clone, Copy)]
pub struct SolverLimits {
    /// Residual to reach.
    pub tol: f64,
    pub max_sweeps: u64,
    pub max_time: Option<Duration>,
    /// Largest total cost, see [`newton_cost`].
    pub max_cost: f64,
}

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
    let from_zero = run.best.1;
    let warm = start.len() == problem.len() && run.record_iterate(start) < from_zero;
    match solver {
        MatrixSolver::Auto => run_fallback_sequence(&mut run, warm),
        MatrixSolver::Nlgs => gauss_seidel::solve_nlgs(&mut run, 0, u64::MAX),
        MatrixSolver::NlgsAnderson => gauss_seidel::solve_nlgs(&mut run, gauss_seidel::ANDERSON_DEPTH, u64::MAX),
        MatrixSolver::ProxNewton => newton::prox_newton(&mut run, &vec![[0.0; 3]; problem.len()], u64::MAX),
        MatrixSolver::Admm => admm::solve_admm(&mut run, u64::MAX),
        MatrixSolver::InteriorPoint => interior_point::interior_point(&mut run, u64::MAX),
    }
    let converged = run.best.1 <= limits.tol;
    MatrixSolution {
        residual: residual(problem, &run.best.0),
        r: run.best.0,
        sweeps: run.sweeps,
        cost: run.cost,
        converged,
    }
}

/// Runs the solvers in turn. First accelerated sweeps, as many as cost ten Newton steps, 100 to 1000. If they stall, the
/// interior-point method once; it makes no use of earlier results, and so after a `warm` start a few steps of Newton's method
/// come before it. Then ADMM and Newton from the best so far, and Newton from 0, which at times converges where the others
/// fail; then all again with four times the budget.
fn run_fallback_sequence(run: &mut SolverRun, warm: bool) {
    let problem = run.problem;
    let (sweep, newton) = (problem.sweep_cost(), problem.newton_cost());
    for round in 0.. {
        let more = 4u64.saturating_pow(round);
        let steps = more.saturating_mul(20);
        let sweeps = (0.5 * steps as f64 * newton / sweep) as u64;
        gauss_seidel::solve_nlgs(run, gauss_seidel::ANDERSON_DEPTH, sweeps.clamp(100, more.saturating_mul(1000)));
        if round == 0 && warm {
            newton::prox_newton(run, &run.best.0.clone(), steps);
        }
        if round == 0 {
            interior_point::interior_point(run, steps.saturating_mul(3));
        }
        admm::solve_admm(run, steps.saturating_mul(5));
        newton::prox_newton(run, &run.best.0.clone(), steps.saturating_mul(5));
        newton::prox_newton(run, &vec![[0.0; 3]; problem.len()], steps.saturating_mul(20));
        if run.is_over() {
            return;
        }
    }
}

/// A run of one or more solvers, with its costs and its best iterate.
struct SolverRun<'a> {
    problem: &'a MatrixProblem,
    limits: SolverLimits,
    start: Instant,
    sweeps: u64,
    cost: f64,
    best: (Vec<LocalVector>, f64),
}

impl<'a> SolverRun<'a> {
    fn new(problem: &'a MatrixProblem, limits: SolverLimits) -> Self {
        let r = vec![[0.0; 3]; problem.len()];
        let residual = residual(problem, &r);
        SolverRun { problem, limits, start: Instant::now(), sweeps: 0, cost: 0.0, best: (r, residual) }
    }

    /// Returns the residual of `r`, at least its rounding; keeps `r` if it is the best.
    fn record_iterate(&mut self, r: &[LocalVector]) -> f64 {
        let value = residual(self.problem, r).max(residual::rounding_residual(self.problem, r));
        if value < self.best.1 {
            self.best.0.copy_from_slice(r);
            self.best.1 = value;
        }
        value
    }

    /// Counts a pass over the contacts and its cost.
    fn count_pass(&mut self, cost: f64) {
        activity::count_sweep();
        self.sweeps += 1;
        self.cost += cost;
    }

    fn is_over(&self) -> bool {
        activity::is_stopped()
            || self.best.1 <= self.limits.tol
            || self.sweeps >= self.limits.max_sweeps
            || self.cost >= self.limits.max_cost
            || self.limits.max_time.is_some_and(|time| self.start.elapsed() >= time)
    }
}
