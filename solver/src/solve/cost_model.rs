//! Numbers by which `auto` divides its work between sweeps and the solvers of stored problems.
//!
//! Costs are computed from the size of a problem, not measured, so that decisions are the same on every machine. Their unit
//! is that of [`newton_cost`], about 1e-9 s on one core.

use crate::solve::gauss_seidel::momentum::MOMENTUM_CYCLE;
use crate::solve::matrix::newton_cost;

/// Costs, budgets and thresholds. Each comment says how the value was found; measurements are in
/// docs/explanation/performance.md.
pub struct CostModel {
    /// Cost of one contact in one sweep. Measured with `cargo bench --bench sweep`: 2 to 14 ns.
    pub contact_sweep_cost: f64,
    /// Cost of the sweeps before the fallback, in Newton steps. Measured with 1000 spheres of friction 1 in an accretion: no
    /// step of 4500 missed the tolerance, as with fewer sweeps, in a third of the time of 1000 sweeps.
    pub sweep_budget: f64,
    /// Largest cost of the fallback, in sweeps of the problem. Chosen: ten times the default of `max_sweeps`.
    pub max_fallback_cost: f64,
    /// Number of contacts below which the largest cost of the fallback does not decrease. Chosen.
    pub min_fallback_contacts: usize,
    /// Smallest number of Newton steps within [`CostModel::max_fallback_cost`] for which the fallback is started. Chosen:
    /// after a warm start the fallback sequence begins with twenty steps of Newton's method.
    pub min_fallback_steps: f64,
    /// Number of contacts from which factors take gigabytes of memory: sweeps replace the solvers that need them. Chosen.
    pub max_factored_contacts: usize,
    /// Ratio of the tolerance of the stored solvers to that of the step: a little below 1, since the residual of the
    /// step is computed by other sums than theirs.
    pub tolerance_share: f64,
    /// Largest ratio of the rounding of a stored solver's impulses to the bodies' momenta. Impulses that brace bodies
    /// against each other may grow until the momenta are lost in their rounding. Chosen: half of the digits of a
    /// number.
    pub max_rounding_share: f64,
    /// Largest ratio of E after the fallback to that of the sweeps, at which it counts as a success, even if rounding
    /// keeps E above the tolerance. Chosen.
    pub success_residual_share: f64,
    /// Largest exponent k of the back-off: after k failures in a row the fallback is attempted again 2^k steps later. Chosen:
    /// a failed attempt costs as much as hundreds of steps.
    pub max_backoff_failures: u32,
    /// Number of rows that select a stagnating subproblem, those with the largest parts in |F|². Found with 4000 spheres that
    /// come to rest in a box: 64 of 8460 rows had 86 % of |F|².
    pub subproblem_rows: usize,
    /// Smallest share of |F|² of these rows. Below it the residual is spread over all rows, and the
    /// sweeps are only slow. Chosen.
    pub min_subproblem_share: f64,
    /// Factor by which the residual of a subproblem is lowered. Chosen.
    pub subproblem_tolerance: f64,
    /// Number of sweeps after the solution of a subproblem, which propagate the change to its neighbours. Chosen: as
    /// many as the shortest window in which sweeps are found to stagnate.
    pub sweeps_between_subproblems: u64,
}

/// The costs of `auto`.
pub const COSTS: CostModel = CostModel {
    contact_sweep_cost: 6.0,
    sweep_budget: 1.5,
    max_fallback_cost: 200_000.0,
    min_fallback_contacts: 100,
    min_fallback_steps: 20.0,
    max_factored_contacts: 30_000,
    tolerance_share: 0.9,
    max_rounding_share: 1e-8,
    success_residual_share: 0.1,
    max_backoff_failures: 8,
    subproblem_rows: 64,
    min_subproblem_share: 0.1,
    subproblem_tolerance: 0.1,
    sweeps_between_subproblems: 16,
};

/// Reason why sweeps replace a requested solver, see [`CostModel::max_factored_contacts`].
pub const TOO_LARGE_REASON: &str = "the factors of 30 000 contacts and more take gigabytes";

impl CostModel {
    /// Number of sweeps that cost as much as one Newton step. It grows with the number of contacts, as factors fill up; it is
    /// not a number without contacts.
    fn sweeps_per_newton_step(&self, contacts: usize) -> f64 {
        newton_cost(contacts) / (self.contact_sweep_cost * contacts as f64)
    }

    /// Whether the factors of this many contacts fit into memory.
    pub fn factors_fit(&self, contacts: usize) -> bool {
        contacts < self.max_factored_contacts
    }

    /// Whether the fallback can pay on a whole problem: up to about 7700 contacts.
    pub fn fallback_pays(&self, contacts: usize) -> bool {
        let steps_cost = self.min_fallback_steps * self.sweeps_per_newton_step(contacts);
        self.factors_fit(contacts) && self.max_fallback_cost >= steps_cost
    }

    /// Largest cost of the fallback.
    pub fn fallback_budget(&self, contacts: usize) -> f64 {
        self.max_fallback_cost * self.contact_sweep_cost * contacts.max(self.min_fallback_contacts) as f64
    }

    /// Number of sweeps before the fallback: as many as cost [`CostModel::sweep_budget`], rounded down to whole rounds of
    /// their momentum's caps, at most half of `max_sweeps`, at least one round.
    pub fn sweeps_before_fallback(&self, contacts: usize, max_sweeps: u64) -> u64 {
        let sweeps = (self.sweep_budget * self.sweeps_per_newton_step(contacts)) as u64;
        let rounds = sweeps.min(max_sweeps / 2) / MOMENTUM_CYCLE;
        max_sweeps.min(MOMENTUM_CYCLE * rounds.max(1))
    }

    /// Largest cost of a subproblem: the cost of a round of sweeps over all contacts.
    pub fn subproblem_budget(&self, contacts: usize) -> f64 {
        MOMENTUM_CYCLE as f64 * self.contact_sweep_cost * contacts as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_problems_are_left_to_sweeps() {
        let pays: Vec<usize> = (0..40_000).step_by(100).filter(|&contacts| COSTS.fallback_pays(contacts)).collect();
        let last = pays[pays.len() - 1];
        assert!((7_000..8_500).contains(&last), "{last}");
        assert!(!COSTS.factors_fit(30_000) && COSTS.factors_fit(29_999));
    }

    #[test]
    fn sweeps_before_the_fallback_are_whole_rounds() {
        assert_eq!(COSTS.sweeps_before_fallback(10, 600), 600);
        assert_eq!(COSTS.sweeps_before_fallback(10, 10_000) % MOMENTUM_CYCLE, 0);
        assert!(COSTS.sweeps_before_fallback(7_000, 10_000) <= 5_000);
        assert_eq!(COSTS.fallback_budget(1), COSTS.fallback_budget(100));
    }
}
