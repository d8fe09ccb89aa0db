//! Nonlinear Gauss-Seidel over stored blocks, plain and with Anderson's acceleration.
//!
//! Source: M. Jean, Comput. Methods Appl. Mech. Engrg. 177 (1999) 235-257.

use super::anderson::AndersonAcceleration;
use super::local::LocalSolver;
use super::problem::MatrixProblem;
use super::run::SolverRun;
use super::types::LocalVector;

/// Number of past sweeps that Anderson's acceleration combines.
pub const ANDERSON_DEPTH: usize = 10;

/// Continues from the best iterate of the run until the run or the budget of `sweeps` is over; `depth` is the number of past
/// sweeps that Anderson's acceleration combines, 0 without it.
pub fn solve_nlgs(run: &mut SolverRun, depth: usize, sweeps: u64) {
    let start = run.sweeps;
    let mut sweeper = MatrixSweeper::new(run.problem);
    let mut anderson = AndersonAcceleration::new(depth, 3 * run.problem.len());
    let mut x = run.best_r.clone();
    let mut g = x.clone();
    let mut sweeps_since_check = 0;
    let mut scale = None;
    while !run.is_over() && run.sweeps - start < sweeps {
        g.copy_from_slice(&x);
        sweeper.sweep_contacts(&mut g);
        run.count_pass(run.problem.sweep_cost());
        sweeps_since_check += 1;
        let change = anderson.next_iterate(&mut x, &g);
        // Computing the residual costs a sweep; the change of a sweep falls as the residual does and shows when to compute
        // it.
        if scale.is_none_or(|scale| change <= scale) || sweeps_since_check > 10 + (run.sweeps - start) / 4 {
            let residual = run.record_iterate(&g);
            scale = Some(0.8 * change * run.limits.tol / residual);
            sweeps_since_check = 0;
        }
    }
}

/// A problem laid out for sweeping.
pub struct MatrixSweeper<'a> {
    problem: &'a MatrixProblem,
    locals: Vec<LocalSolver>,
    /// Index of the diagonal block of each row.
    diagonal: Vec<usize>,
}

impl<'a> MatrixSweeper<'a> {
    /// Sweeps of a problem, with the inverse of each own block.
    pub fn new(problem: &'a MatrixProblem) -> Self {
        let locals = problem.diagonal_blocks().zip(&problem.mu).map(|(w, &mu)| LocalSolver::new(w, mu)).collect();
        let diagonal = (0..problem.len())
            .filter_map(|i| (problem.starts[i]..problem.starts[i + 1]).find(|&k| problem.columns[k] as usize == i))
            .collect();
        MatrixSweeper { problem, locals, diagonal }
    }

    /// Solves each contact in turn against the current impulses of the others.
    pub fn sweep_contacts(&mut self, r: &mut [LocalVector]) {
        let MatrixProblem { q, starts, columns, blocks, .. } = self.problem;
        for (i, local) in self.locals.iter().enumerate() {
            let mut u = q[i];
            for range in [starts[i]..self.diagonal[i], self.diagonal[i] + 1..starts[i + 1]] {
                for (w, &j) in blocks[range.clone()].iter().zip(&columns[range]) {
                    let r = &r[j as usize];
                    for k in 0..3 {
                        u[k] += w[k][0] * r[0] + w[k][1] * r[1] + w[k][2] * r[2];
                    }
                }
            }
            r[i] = local.solve(u);
        }
    }
}
