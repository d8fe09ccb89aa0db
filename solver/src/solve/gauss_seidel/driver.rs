//! Nonlinear Gauss-Seidel with momentum: sweeps over the contacts, each solved exactly against the bodies' current
//! velocities, which change at once.
//!
//! Source: M. Jean, Comput. Methods Appl. Mech. Engrg. 177 (1999) 235-257; F. Jourdan, P. Alart, M. Jean, Comput. Methods
//! Appl. Mech. Engrg. 155 (1998) 31-47.

use cd_formats::compute::SweepPrecision;
use rayon::prelude::*;

use crate::activity;
use crate::assemble::{ContactConstraint, ContactProblem, SolverBody};
use crate::math::simd::SimdWidth;
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::ranks::communicator;
use crate::ranks::lists::{all_gather_values, any_rank, max_over_ranks, min_over_ranks, sum_over_ranks};
use crate::solve::gauss_seidel::layout::{pack_divided_rows, pack_problem, smallest_block};
use crate::solve::gauss_seidel::momentum::{MOMENTUM_CYCLE, SweepMomentum};
use crate::solve::gauss_seidel::packed::PackSource;
use crate::solve::gauss_seidel::row_division::RowDivision;
use crate::solve::residual::{BodyMotion, Residual, ResidualEvaluator, ResidualScales, keep_body_memory};
use crate::solve::types::{ContactReactions, ContactSolution, StoppingCriteria};
use crate::state::ContactId;

/// Largest ratio of E to `tol` with which a step may keep the impulses of the last one without a sweep: with a larger
/// E, contacts at rest would creep forever. Single precision reaches it.
const REST_TOLERANCE_SHARE: f64 = 1e-2;

/// Smallest number of contacts for which sweeps in single precision pay.
const MIN_F32_CONTACTS: usize = 256;

/// Smallest residual that is sought with sweeps in single precision: they reach 1e-5 and less.
const MIN_F32_RESIDUAL: f64 = 1e-4;

/// Number of sweeps in single precision after which they restart from their result, as rounding accumulates; in double
/// precision if there was no gain.
const F32_REBASE_SWEEPS: u64 = 500;

/// Ratio of E to the best E at which the sweeps return to the best result, in double precision and with a new momentum:
/// where no contact slides, E falls except for rounding.
const F32_DIVERGENCE: f64 = 4.0;

/// Rows per task.
const ROWS_PER_TASK: usize = 1024;
/// Largest ratio of masses for which squares of impulses are finite.
const MAX_MASS_RATIO: f64 = 1e9;

/// Sweeps until the residual E is at most `target_residual`, or all sweeps are spent; a solution with E <= `tol` is converged.
///
/// Only rows that can close within the step are swept. A row left out that the solution would close nevertheless - a body may
/// become faster than its free velocity - is included, and sweeping continues. Returns the impulses of all rows, N s, with
/// the residual and the number of sweeps.
pub fn solve_nlgs(contact_problem: &ContactProblem, criteria: StoppingCriteria, width: SimdWidth) -> ContactSolution {
    let StoppingCriteria { tol, max_sweeps, .. } = criteria;
    let rows = (0..contact_problem.rows.len() as u32).into_par_iter().with_min_len(PAR_MIN_LEN).map(ContactId);
    let mut active: Vec<ContactId> = rows.filter(|k| contact_problem.rows[k.index()].can_close).collect();
    let mut reactions = ContactReactions::warm_start(contact_problem);
    let mut sweeps = 0;
    loop {
        let evaluator = ResidualEvaluator::new(contact_problem, &active, width);
        let single = sweeps_in_f32(contact_problem, &active, criteria, false);
        // Many bodies without a contact, as in a cloud that falls together, take no more than a copy.
        let (residual, solver_bodies) = if active.is_empty() && contact_problem.rolling_constraints.is_empty() {
            (Residual { value: 0.0, worst: None }, evaluator.unmoved_bodies())
        } else {
            let iteration = SweepIteration { contact_problem, evaluator: &evaluator, active: &active, criteria };
            let (residual, motions) = iterate_sweeps(iteration, &mut reactions, single, &mut sweeps);
            (residual, evaluator.solver_bodies(&motions))
        };
        let missed = closing_inactive_rows(contact_problem, &active, &solver_bodies);
        if missed.is_empty() || sweeps >= max_sweeps || activity::is_stopped() {
            let ContactReactions { impulses, moments } = reactions;
            return ContactSolution {
                impulses,
                moments,
                solver_bodies,
                sweeps,
                single_precision: single && sweeps > 0,
                residual: residual.value,
                converged: residual.value <= tol && missed.is_empty(),
                left_out: missed.len(),
                worst: residual.worst.or(missed.first().copied()),
                active_rows: active.len(),
                fallback_used: false,
                stalled_residual: None,
                replacement_reason: None,
            };
        }
        active.extend(missed);
        active.sort_unstable();
    }
}

/// [`solve_nlgs`] for a problem of spheres and plates without attractions of which each rank has a part of the rows, one after
/// the other. The solution has the impulses of the rows of this rank, and all bodies; `worst` is a row of the whole problem.
pub fn solve_divided_nlgs(
    contact_problem: &mut ContactProblem,
    criteria: StoppingCriteria,
    width: SimdWidth,
) -> ContactSolution {
    let StoppingCriteria { tol, max_sweeps, .. } = criteria;
    let first_row = all_gather_values(contact_problem.rows.len() as u64)[..communicator().rank()].iter().sum::<u64>();
    let rows = (0..contact_problem.rows.len() as u32).into_par_iter().with_min_len(PAR_MIN_LEN).map(ContactId);
    let mut active: Vec<ContactId> = rows.filter(|k| contact_problem.rows[k.index()].can_close).collect();
    let ContactReactions { mut impulses, .. } = ContactReactions::warm_start(contact_problem);
    let mut sweeps = 0;
    loop {
        let active_rows = sum_over_ranks(active.len());
        let single = sweeps_in_f32(contact_problem, &active, criteria, true);
        let (residual, solver_bodies) = if active_rows == 0 {
            let evaluator = ResidualEvaluator::new(contact_problem, &[], width);
            (Residual { value: 0.0, worst: None }, evaluator.unmoved_bodies())
        } else {
            let scales = ResidualScales::of_ranks(contact_problem, &active, active_rows);
            let (division, rows) = RowDivision::new(contact_problem, &active, &impulses, smallest_block(false));
            let mut reactions =
                ContactReactions { impulses: rows.iter().map(|row| row.warm_start).collect(), moments: Vec::new() };
            let swept_problem = ContactProblem::of_rows(rows, std::mem::take(&mut contact_problem.bodies));
            let swept: Vec<ContactId> = (0..swept_problem.rows.len()).map(ContactId::new).collect();
            let evaluator = ResidualEvaluator::of_division(&swept_problem, &swept, width, &division, scales);
            let iteration =
                SweepIteration { contact_problem: &swept_problem, evaluator: &evaluator, active: &swept, criteria };
            let (residual, motions) = iterate_sweeps(iteration, &mut reactions, single, &mut sweeps);
            let solver_bodies = evaluator.solver_bodies(&motions);
            let listed = division.listed_values(|row| <[f64; 3]>::from(reactions.impulses[row]));
            active.iter().zip(listed).for_each(|(k, impulse)| impulses[k.index()] = Vec3::from(impulse));
            drop(evaluator);
            contact_problem.bodies = swept_problem.bodies;
            (residual, solver_bodies)
        };
        let missed = closing_inactive_rows(contact_problem, &active, &solver_bodies);
        let left_out = sum_over_ranks(missed.len());
        if left_out == 0 || sweeps >= max_sweeps || activity::is_stopped() {
            let first_missed = missed.first().map_or(u64::MAX, |row| first_row + u64::from(row.0));
            let first_missed = all_gather_values(first_missed).into_iter().min().filter(|row| *row < u64::MAX);
            return ContactSolution {
                impulses,
                moments: Vec::new(),
                solver_bodies,
                sweeps,
                single_precision: single && sweeps > 0,
                residual: residual.value,
                converged: residual.value <= tol && left_out == 0,
                left_out,
                worst: residual.worst.or(first_missed.map(|row| ContactId(row as u32))),
                active_rows,
                fallback_used: false,
                stalled_residual: None,
                replacement_reason: None,
            };
        }
        active.extend(missed);
        active.sort_unstable();
    }
}

/// Point of the iteration at which the problem was packed.
struct PackingPoint {
    /// Number of sweeps until then.
    sweeps: u64,
    /// Smallest residual until then.
    residual: f64,
}

/// Rows of a contact problem that are swept, and the end of the sweeps.
#[derive(Clone, Copy)]
struct SweepIteration<'a> {
    contact_problem: &'a ContactProblem,
    /// Evaluator of the residual of these rows.
    evaluator: &'a ResidualEvaluator<'a>,
    /// Rows that are swept, sorted.
    active: &'a [ContactId],
    criteria: StoppingCriteria,
}

/// Sweeps the rows from `reactions`, in single precision if `single` and as long as that gains, and increments
/// `sweeps`. Returns the residual and the motions that result from the impulses.
fn iterate_sweeps(
    SweepIteration { contact_problem, evaluator, active, criteria }: SweepIteration,
    reactions: &mut ContactReactions,
    mut single: bool,
    sweeps: &mut u64,
) -> (Residual, Vec<BodyMotion>) {
    let StoppingCriteria { tol, target_residual, min_sweeps, max_sweeps, check_every, .. } = criteria;
    let residual_and_motions = |ContactReactions { impulses, moments }: &ContactReactions| {
        let motions = evaluator.motions_with(impulses, moments);
        (evaluator.residual_with(impulses, moments, &motions), motions)
    };
    let mut best = residual_and_motions(reactions);
    let is_enough = |residual: f64, sweeps: u64| {
        residual <= target_residual && (sweeps >= min_sweeps || residual <= REST_TOLERANCE_SHARE * tol)
    };
    let solved = is_enough(best.0.value, *sweeps) && (check_every.is_none() || evaluator.is_empty());
    if solved || *sweeps >= max_sweeps {
        return best;
    }
    let sweep_limit =
        |residual: f64, sweeps: u64| if residual <= tol { max_sweeps.min(sweeps + MOMENTUM_CYCLE) } else { max_sweeps };
    let mut end = sweep_limit(best.0.value, *sweeps);
    let pack = |reactions: &ContactReactions, motions: &[BodyMotion], single| {
        let solver_bodies = evaluator.solver_bodies(motions);
        let source = PackSource {
            problem: contact_problem,
            active,
            reactions,
            solver_bodies: &solver_bodies,
            width: evaluator.width,
            associated: &[],
        };
        let packed = match evaluator.division {
            Some(division) => pack_divided_rows(&source, division, single),
            None => pack_problem(&source, single),
        };
        keep_body_memory(solver_bodies);
        packed
    };
    let mut problem = pack(reactions, &best.1, single);
    let mut packing = PackingPoint { sweeps: *sweeps, residual: best.0.value };
    let has_rolling_friction = contact_problem.rolling_constraints.iter().any(|roll| !roll.is_bond());
    let frictional = match evaluator.division {
        Some(division) => division.has_friction,
        None => contact_problem.has_friction(active),
    };
    let any_slides = |impulses: &[Vec3]| {
        let slides = any_contact_slides(contact_problem, active, impulses);
        if evaluator.division.is_some() { any_rank(slides) } else { slides }
    };
    let mut momentum = SweepMomentum::new(frictional);
    let mut is_capped = false;
    let impulses = reactions.impulses.par_iter().with_min_len(PAR_MIN_LEN).copied().collect();
    let mut trial = ContactReactions { impulses, moments: reactions.moments.clone() };
    // Computing the residual costs several sweeps. The change made by a sweep falls as the residual does and shows when to
    // compute it. `scale` is the ratio of the two at the last check; the number of sweeps since then is limited in case the
    // ratio has changed.
    let mut scale = None;
    let mut sweeps_since_check = 0;
    loop {
        let swept = problem.sweep_contacts(evaluator.width, momentum.beta);
        momentum.update_after_sweep(swept.needs_restart, swept.change);
        activity::count_sweep();
        *sweeps += 1;
        sweeps_since_check += 1;
        if activity::is_stopped() {
            return best; // not used
        }
        let due = match check_every {
            Some(block) => sweeps_since_check >= block,
            None if *sweeps < min_sweeps => false,
            None => {
                scale.is_none_or(|scale| swept.change <= scale * target_residual)
                    || sweeps_since_check > 20 + *sweeps / 10
            }
        };
        if due || *sweeps >= end {
            problem.read_back(evaluator.width, contact_problem, &mut trial);
            let found = residual_and_motions(&trial);
            let residual = found.0;
            momentum.sliding = frictional
                && (has_rolling_friction || any_slides(&trial.impulses) || any_bond_turns(contact_problem, &trial));
            is_capped |= momentum.sliding || frictional && residual.value >= best.0.value;
            momentum.frictional = is_capped;
            scale = Some(swept.change / residual.value);
            sweeps_since_check = 0;
            let diverges = !momentum.sliding && residual.value > F32_DIVERGENCE * best.0.value;
            if single && (diverges || *sweeps >= packing.sweeps + F32_REBASE_SWEEPS) {
                let smallest = residual.value.min(best.0.value);
                single = !diverges && smallest < packing.residual;
                let (from, motions_at) = if diverges { (&*reactions, &best.1) } else { (&trial, &found.1) };
                problem = pack(from, motions_at, single);
                packing = PackingPoint { sweeps: *sweeps, residual: smallest };
                if !single && !momentum.sliding {
                    (momentum, is_capped) = (SweepMomentum::new(frictional), false);
                }
            }
            if residual.value < best.0.value {
                best = found;
                std::mem::swap(reactions, &mut trial);
            }
            end = end.min(sweep_limit(residual.value, *sweeps));
            if is_enough(residual.value, *sweeps) || *sweeps >= end {
                return best;
            }
        }
    }
}

/// Whether the rows `active` are swept in single precision: for masses that do not differ too much, without moments.
/// `is_divided`: whether other ranks have other rows of the problem.
fn sweeps_in_f32(
    contact_problem: &ContactProblem,
    active: &[ContactId],
    criteria: StoppingCriteria,
    is_divided: bool,
) -> bool {
    let count = if is_divided { sum_over_ranks(active.len()) } else { active.len() };
    let is_requested = match criteria.precision {
        SweepPrecision::Auto => count >= MIN_F32_CONTACTS && criteria.target_residual >= MIN_F32_RESIDUAL,
        SweepPrecision::Single => true,
        SweepPrecision::Double => false,
    };
    is_requested && contact_problem.rolling_constraints.is_empty() && {
        let w_n_range = |&k: &ContactId| [contact_problem.delassus_diagonal(k.index()).0; 2];
        let ranges = active.par_iter().with_min_len(PAR_MIN_LEN).map(w_n_range);
        let [mut smallest, mut largest] =
            ranges.reduce(|| [f64::INFINITY, 0.0], |a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        if is_divided {
            (smallest, largest) = (min_over_ranks(smallest), max_over_ranks(largest));
        }
        largest <= smallest * MAX_MASS_RATIO
    }
}

/// Whether a moment of a bond is at its bound, to rounding.
fn any_bond_turns(contact_problem: &ContactProblem, ContactReactions { impulses, moments }: &ContactReactions) -> bool {
    contact_problem.rolling_constraints.iter().zip(moments).any(|(roll, m)| {
        let (k, n) = (roll.row.index(), contact_problem.rows[roll.row.index()].normal);
        let along = n.dot(m);
        let (across_bound, along_bound) = roll.moment_bounds(&impulses[k], &n);
        let is_at = |moment: f64, bound: f64| moment >= roll.radius * bound * (1.0 - 1e-12);
        is_at((m - n * along).norm(), across_bound) || is_at(along.abs(), along_bound)
    })
}

/// Whether a contact is at the bound of its friction.
fn any_contact_slides(contact_problem: &ContactProblem, active: &[ContactId], impulses: &[Vec3]) -> bool {
    active.par_iter().with_min_len(1024).any(|&k| {
        let (row, r) = (&contact_problem.rows[k.index()], &impulses[k.index()]);
        let normal = row.normal.dot(r);
        // On the side of its cone to rounding.
        row.friction > 0.0 && normal > 0.0 && (r - row.normal * normal).norm() >= row.friction * normal * (1.0 - 1e-12)
    })
}

/// Returns the rows outside `active` (sorted) that these velocities close.
pub fn closing_inactive_rows(
    contact_problem: &ContactProblem,
    active: &[ContactId],
    solver_bodies: &[SolverBody],
) -> Vec<ContactId> {
    let is_closing = |k: &ContactId| {
        let row = &contact_problem.rows[k.index()];
        row.acts && contact_problem.shifted_normal_velocity(k.index(), solver_bodies) < 0.0
    };
    let closing_rows_of = |(task, rows): (usize, &[ContactConstraint])| {
        let first = task * ROWS_PER_TASK;
        let mut inside = active[active.partition_point(|k| k.index() < first)..].iter().peekable();
        let all = (first..first + rows.len()).map(ContactId::new);
        all.filter(move |k| inside.next_if_eq(&k).is_none() && is_closing(k))
    };
    contact_problem.rows.par_chunks(ROWS_PER_TASK).enumerate().flat_map_iter(closing_rows_of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assemble::BlockData;

    #[test]
    fn single_precision_is_for_many_contacts() {
        let row = ContactConstraint { w_n: 1.0, can_close: true, ..ContactConstraint::default() };
        let rows = vec![row; MIN_F32_CONTACTS];
        let contact_problem = ContactProblem {
            rows,
            block_data: None,
            rolling_constraints: vec![],
            memories: vec![],
            pair_attractions: vec![],
            regularised: vec![],
            order: vec![],
            bodies: vec![],
        };
        let all: Vec<ContactId> = (0..MIN_F32_CONTACTS).map(ContactId::new).collect();
        let [auto, single, double] = [SweepPrecision::Auto, SweepPrecision::Single, SweepPrecision::Double]
            .map(|precision| StoppingCriteria { precision, ..StoppingCriteria::new(1e-3, 10) });
        assert!(
            sweeps_in_f32(&contact_problem, &all, auto, false) && !sweeps_in_f32(&contact_problem, &all, double, false)
        );
        assert!(
            !sweeps_in_f32(&contact_problem, &all[1..], auto, false)
                && sweeps_in_f32(&contact_problem, &all[1..], single, false)
        );
        assert!(!sweeps_in_f32(&contact_problem, &all, StoppingCriteria { target_residual: 1e-5, ..auto }, false));
        let mut uneven = contact_problem.clone();
        uneven.rows[7].w_n = 1e10;
        assert!(!sweeps_in_f32(&uneven, &all, single, false));
        uneven.rows[7].w_n = 0.0; // between two bodies whose motion is imposed
        assert!(!sweeps_in_f32(&uneven, &all, single, false));
        let block_data =
            BlockData { arms: vec![], friction_offsets: vec![], locked_axes: vec![], inverse_inertia: vec![] };
        let contact_problem = ContactProblem { block_data: Some(block_data), ..contact_problem };
        assert!(
            sweeps_in_f32(&contact_problem, &all, auto, false)
                && !sweeps_in_f32(&contact_problem, &all[1..], auto, false)
        );
    }
}
