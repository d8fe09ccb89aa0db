//! Types of the solve stage: impulses, solution and stopping criteria.

use cd_formats::compute::SweepPrecision;
use rayon::prelude::*;

use crate::assemble::{ContactConstraint, ContactProblem, RollingConstraint, SolverBody};
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::state::ContactId;

/// Impulses and moments of the contacts, world frame, on the candidate.
#[derive(Debug, Clone)]
pub struct ContactReactions {
    /// r̂ of each row of the contact problem, N s.
    pub impulses: Vec<Vec3>,
    /// Moment of each rolling constraint, N m s.
    pub moments: Vec<Vec3>,
}

impl ContactReactions {
    /// No impulses and no moments.
    pub fn zeros(problem: &ContactProblem) -> Self {
        ContactReactions {
            impulses: vec![Vec3::zeros(); problem.rows.len()],
            moments: vec![Vec3::zeros(); problem.rolling_constraints.len()],
        }
    }

    /// Warm start of the rows that can close: no moment without a normal impulse.
    pub(super) fn warm_start(problem: &ContactProblem) -> Self {
        let impulse_of = |row: &ContactConstraint| if row.can_close { row.warm_start } else { Vec3::zeros() };
        let impulses: Vec<Vec3> = problem.rows.par_iter().with_min_len(PAR_MIN_LEN).map(impulse_of).collect();
        let moment_of = |roll: &RollingConstraint| {
            if impulses[roll.row.index()] == Vec3::zeros() { Vec3::zeros() } else { roll.warm_start }
        };
        let moments = problem.rolling_constraints.iter().map(moment_of).collect();
        ContactReactions { impulses, moments }
    }
}

/// Impulses r̂ of all rows (world frame, N s), the velocities that result from them, and their accuracy.
#[derive(Clone)]
pub struct ContactSolution {
    pub impulses: Vec<Vec3>,
    /// Moments of all rolling constraints, world frame, N m s.
    pub moments: Vec<Vec3>,
    /// Bodies with the velocities after these impulses.
    pub solver_bodies: Vec<SolverBody>,
    /// Number of sweeps.
    pub sweeps: u64,
    /// Whether the last sweeps began in single precision.
    pub single_precision: bool,
    /// Residual E of [`crate::solve::residual`].
    pub residual: f64,
    /// Whether the residual is at most `tol` and no row is left out.
    pub converged: bool,
    /// Number of rows outside the problem that the solution closes: the solution has not converged if there are any.
    pub left_out: usize,
    /// Row with the largest part in the residual.
    pub worst: Option<ContactId>,
    /// Number of rows in the problem.
    pub active_rows: usize,
    /// Whether a solver of stored problems found the solution where the sweeps had stalled.
    pub fallback_used: bool,
    /// E at which the sweeps had stalled, if solvers of stored problems continued from there.
    pub stalled_residual: Option<f64>,
    /// Reason why sweeps replaced the requested solver.
    pub replacement_reason: Option<&'static str>,
}

/// Stopping criteria of the sweeps.
#[derive(Debug, Clone, Copy)]
pub struct StoppingCriteria {
    /// E to reach.
    pub tol: f64,
    /// E sought after `tol` is reached, for at most one round of sweeps.
    pub target_residual: f64,
    /// Smallest number of sweeps, unless E is already a hundredth of `tol`.
    pub min_sweeps: u64,
    pub max_sweeps: u64,
    /// Number of sweeps between checks of E and before the first check, as LMGC90's blocks; if `None`, checks are made when
    /// the changes of the sweeps suggest it.
    pub check_every: Option<u64>,
    pub precision: SweepPrecision,
}

impl StoppingCriteria {
    /// Criteria to sweep to E <= `tol`, or `max_sweeps`.
    pub fn new(tol: f64, max_sweeps: u64) -> Self {
        StoppingCriteria {
            tol,
            target_residual: tol,
            min_sweeps: 0,
            max_sweeps,
            check_every: None,
            precision: SweepPrecision::Auto,
        }
    }
}
