//! Sweeps with the associated law of friction, in which a contact that slides at û_T separates at mu |û_T|.
//!
//! The associated law, r̂ in the cone K, û in its dual cone and r̂·û = 0, makes the problem of all contacts convex, so that the
//! momentum of the sweeps (Nesterov's, see `momentum`) needs no cap. A contact at rest, û = 0, obeys it as it obeys Coulomb's
//! law: where all rest, the impulses solve both. Contacts that slide, found when the convex problem is solved, return to
//! Coulomb's law. The result is the impulses with the smallest E, the residual by Coulomb's law of `residual`.
//!
//! Source: V. Acary, F. Cadoux, C. Lemaréchal, J. Malick, ZAMM 91 (2011) 155-175 (convex problem next to Coulomb's).

use rayon::prelude::*;

use crate::activity;
use crate::assemble::ContactProblem;
use crate::math::simd::SimdWidth;
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::solve::gauss_seidel::layout::pack_problem;
use crate::solve::gauss_seidel::momentum::{MOMENTUM_CYCLE, SweepMomentum};
use crate::solve::gauss_seidel::packed::PackSource;
use crate::solve::residual::ResidualEvaluator;
use crate::solve::types::{ContactReactions, StoppingCriteria};
use crate::state::ContactId;

/// Smallest number of sweeps between two evaluations of E, which cost about ten sweeps; later an eighth of the sweeps so far.
/// Chosen.
const MIN_CHECK_INTERVAL: u64 = 32;
/// Ratio of a residual to the one before, or to the smallest, that counts as progress. Chosen.
const PROGRESS_RATIO: f64 = 0.8;
/// Number of sweeps without progress after which the sweeps end. Chosen: in piles at rest E falls by [`PROGRESS_RATIO`] in
/// 100 sweeps.
const MAX_STALLED_SWEEPS: u64 = 256;
/// Largest share of the contacts that may slide. Columns and boxes of spheres that come to rest converge with up to 3.5 % of
/// sliding contacts; with 5 % and more, Coulomb's law on all contacts takes fewer sweeps.
const MAX_SLIDING_SHARE: f64 = 0.05;
/// Residual of the convex problem, divided by `tol`, at which its sliding contacts return to Coulomb's law, and
/// residual that the separation of the remaining ones may add to E, divided by `tol`. Chosen: both are below `tol`
/// together.
const SHARE_OF_TOLERANCE: f64 = 0.5;

/// Impulses found by sweeps with the associated law.
pub struct AssociatedSolution {
    /// Impulses with the smallest E, one per row; `None` if no E is smaller than that of the start.
    pub impulses: Option<Vec<Vec3>>,
    /// Number of sweeps.
    pub sweeps: u64,
}

/// Progress of the sweeps.
struct Progress {
    /// Sweep of the last fall of E or of the residual of the convex problem.
    last_sweep: u64,
    /// Smallest residual of the convex problem so far.
    smallest_residual: f64,
}

/// Whether the sweeps apply: to spheres and plates with friction, without moments.
pub fn associated_law_applies(contact_problem: &ContactProblem) -> bool {
    contact_problem.block_data.is_none()
        && contact_problem.rolling_constraints.is_empty()
        && contact_problem.rows.par_iter().with_min_len(PAR_MIN_LEN).any(|row| row.can_close && row.friction > 0.0)
}

/// Sweeps from these impulses, whose residual is `residual`, to E <= `tol` of Coulomb's law, for at most two rounds of
/// sweeps, or until many contacts slide.
pub fn solve_associated(
    contact_problem: &ContactProblem,
    impulses: &[Vec3],
    residual: f64,
    criteria: StoppingCriteria,
    width: SimdWidth,
) -> AssociatedSolution {
    let max_sweeps = criteria.max_sweeps.min(2 * MOMENTUM_CYCLE);
    let acts = |k: &ContactId| contact_problem.rows[k.index()].can_close || impulses[k.index()] != Vec3::zeros();
    let active: Vec<ContactId> = (0..contact_problem.rows.len()).map(ContactId::new).filter(acts).collect();
    let evaluator = ResidualEvaluator::new(contact_problem, &active, width);
    let share_of_tol = SHARE_OF_TOLERANCE * criteria.tol;
    let mut associated = vec![true; contact_problem.rows.len()];
    let mut sliding = 0;
    let mut reactions = ContactReactions { impulses: impulses.to_vec(), moments: Vec::new() };
    let mut motions = evaluator.body_motions(impulses);
    let mut best = (residual, None);
    let mut sweeps = 0;
    let mut progress = Progress { last_sweep: 0, smallest_residual: f64::INFINITY };
    loop {
        let solver_bodies = &evaluator.solver_bodies(&motions);
        let source = PackSource {
            problem: contact_problem,
            active: &active,
            reactions: &reactions,
            solver_bodies,
            width,
            associated: &associated,
        };
        // In single precision momentum without a cap adds up rounding: 1600 sweeps in place of 520 in a column of 10 000.
        let is_single_precision = false;
        let mut packed = pack_problem(&source, is_single_precision);
        let has_cap = false;
        let mut momentum = SweepMomentum::new(has_cap);
        let mut last = f64::INFINITY;
        loop {
            let end = max_sweeps.min(sweeps + MIN_CHECK_INTERVAL.max(sweeps / 8));
            while sweeps < end && !activity::is_stopped() {
                let swept = packed.sweep_contacts(width, momentum.beta);
                momentum.update_after_sweep(swept.needs_restart, swept.change);
                activity::count_sweep();
                sweeps += 1;
            }
            packed.read_back(width, contact_problem, &mut reactions);
            motions = evaluator.body_motions(&reactions.impulses);
            let residual = evaluator.residual_at(&reactions.impulses, &motions).value;
            if residual < best.0 {
                best = (residual, Some(reactions.impulses.clone()));
            }
            if residual <= criteria.tol || sweeps >= max_sweeps || activity::is_stopped() {
                return AssociatedSolution { impulses: best.1, sweeps };
            }
            let falls = residual <= PROGRESS_RATIO * last;
            last = residual;
            if falls {
                progress.last_sweep = sweeps;
                continue;
            }
            let convex = evaluator.associated_residual(&reactions.impulses, &motions, &associated);
            if convex.residual <= PROGRESS_RATIO * progress.smallest_residual {
                progress = Progress { last_sweep: sweeps, smallest_residual: convex.residual };
            }
            let separating = largest_separations(convex.separations, share_of_tol.max(2.0 * convex.residual));
            if (sliding + separating.len()) as f64 > MAX_SLIDING_SHARE * active.len() as f64
                || sweeps > progress.last_sweep + MAX_STALLED_SWEEPS
            {
                return AssociatedSolution { impulses: best.1, sweeps };
            }
            if convex.residual <= share_of_tol && !separating.is_empty() {
                sliding += separating.len();
                separating.iter().for_each(|&position| associated[active[position].index()] = false);
                progress = Progress { last_sweep: sweeps, smallest_residual: f64::INFINITY };
                break;
            }
        }
    }
}

/// Positions of the contacts with the largest separations, without which the norm of the others is at most `limit`.
fn largest_separations(separations: Vec<f64>, limit: f64) -> Vec<usize> {
    let mut ordered: Vec<(usize, f64)> = separations.into_iter().enumerate().filter(|(_, size)| *size > 0.0).collect();
    ordered.sort_by(|(_, a), (_, b)| a.total_cmp(b));
    let mut sum = 0.0;
    let small = ordered.iter().take_while(|(_, size)| {
        sum += size * size;
        sum <= limit * limit
    });
    let small_count = small.count();
    ordered.drain(small_count..).map(|(position, _)| position).collect()
}
