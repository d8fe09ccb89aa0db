//! A run of solvers on a problem, and its limits.

use std::time::{Duration, Instant};

use super::problem::MatrixProblem;
use super::residual::{residual, rounding_residual};
use super::types::LocalVector;
use crate::activity;

/// Limits of a solver.
#[derive(Debug, Clone, Copy)]
pub struct SolverLimits {
    /// Residual to reach.
    pub tol: f64,
    pub max_sweeps: u64,
    pub max_time: Option<Duration>,
    /// Largest total cost, see [`super::newton_cost`].
    pub max_cost: f64,
}

/// A run of one or more solvers, with its costs and its best iterate.
pub(super) struct SolverRun<'a> {
    pub problem: &'a MatrixProblem,
    pub limits: SolverLimits,
    pub start: Instant,
    /// Number of passes over the contacts.
    pub sweeps: u64,
    /// Total cost, see [`super::newton_cost`].
    pub cost: f64,
    /// Impulses with the smallest residual so far.
    pub best_r: Vec<LocalVector>,
    pub best_residual: f64,
}

impl<'a> SolverRun<'a> {
    /// Run from zero impulses.
    pub fn new(problem: &'a MatrixProblem, limits: SolverLimits) -> Self {
        let r = vec![[0.0; 3]; problem.len()];
        let residual = residual(problem, &r);
        SolverRun { problem, limits, start: Instant::now(), sweeps: 0, cost: 0.0, best_r: r, best_residual: residual }
    }

    /// Returns the residual of `r`, at least its rounding; keeps `r` if it is the best.
    pub fn record_iterate(&mut self, r: &[LocalVector]) -> f64 {
        let value = residual(self.problem, r).max(rounding_residual(self.problem, r));
        if value < self.best_residual {
            self.best_r.copy_from_slice(r);
            self.best_residual = value;
        }
        value
    }

    /// Counts a pass over the contacts and its cost.
    pub fn count_pass(&mut self, cost: f64) {
        activity::count_sweep();
        self.sweeps += 1;
        self.cost += cost;
    }

    /// Whether the tolerance or a limit is reached, or the program was requested to stop.
    pub fn is_over(&self) -> bool {
        activity::is_stopped()
            || self.best_residual <= self.limits.tol
            || self.sweeps >= self.limits.max_sweeps
            || self.cost >= self.limits.max_cost
            || self.limits.max_time.is_some_and(|time| self.start.elapsed() >= time)
    }
}
