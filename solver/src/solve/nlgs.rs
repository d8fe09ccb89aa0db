//! Nonlinear Gauss-Seidel with momentum: sweeps over the contacts, each solved exactly against the bodies' current
//! velocities, which change at once.
//!
//! A sweep starts from y = r + beta (r - r_before). beta grows as Nesterov's up to a cap, and restarts from 0 when the last
//! change points uphill.
//!
//! Sources: M. Jean (1999); F. Jourdan, P. Alart, M. Jean (1998); Y. Nesterov, Soviet Math. Dokl. 27
//! (1983) 372-376; B. O'Donoghue, E. Candes, Found. Comput. Math. 15 (2015) 715-732 (restart);
//! H. Mazhar et al., ACM Trans. Graph. 34 (2015) (in contact dynamics).

use cd_formats::compute::SweepPrecision;
use rayon::prelude::*;

use crate::activity;
use crate::assemble::{ContactProblem, SolverBody};
use crate::math::lanes::SimdWidth;
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::solve::packed_problem::PackedProblem;
use crate::solve::residual::{BodyMotion, Residual, ResidualEvaluator};

/// Largest share of the last change that is carried on with friction, by the index of the sweep in a round of
/// [`MOMENTUM_CYCLE`]. Uncapped momentum bounces on dense frictional packings; caps of 0.7 to 0.85 perform alike. A few
/// problems cycle with any momentum, others converge with it alone. Therefore, if sweeps cycle, or after a while, the
/// momentum is reduced, then set to 0, and then restored. Without friction the problem is convex and needs no cap; with
/// friction no cap is needed as long as no contact slides and E falls.
const FRICTIONAL_CAPS: [(u64, f64); 3] = [(600, 0.8), (800, 0.5), (MOMENTUM_CYCLE, 0.0)];
pub(super) const MOMENTUM_CYCLE: u64 = 1000;

/// Sweeps of the first two windows for the detection of cycling; each next window is half as long as all before: where the
/// change falls slowly, short windows show only its noise. Sweeps cycle if the mean change in a window is not below that in
/// the window before it under the same cap.
const STAGNATION_WINDOW: u64 = 16;

/// Contacts at rest would creep forever with the E of their impulses of the last step, if these were never swept: E is at
/// most this share of `tol`. Single precision reaches it.
const REST_TOLERANCE_SHARE: f64 = 1e-2;

/// Smallest number of contacts for which sweeps in single precision pay, and smallest residual sought with them: they reach
/// 1e-5 and less.
const MIN_F32_CONTACTS: usize = 256;
const MIN_F32_RESIDUAL: f64 = 1e-4;
/// Number of sweeps in single precision after which they restart from their result, as rounding accumulates; in double
/// precision if there was no gain. Where no contact slides, E falls except for rounding: once it is [`F32_DIVERGENCE`] times
/// the best E, the sweeps return to the best result, in double precision and with a new momentum.
const F32_REBASE_SWEEPS: u64 = 500;
const F32_DIVERGENCE: f64 = 4.0;
/// Largest ratio of masses for which squares of impulses are finite.
const MAX_MASS_RATIO: f64 = 1e9;

/// Impulses and moments of the contacts, world frame, on the candidate.
#[derive(Debug, Clone)]
pub struct ContactReactions {
    /// r̂ of each row of the system, N s.
    pub impulses: Vec<Vec3>,
    /// Moment of each rolling constraint, N m s.
    pub moments: Vec<Vec3>,
}

impl ContactReactions {
    pub fn zeros(system: &ContactProblem) -> Self {
        ContactReactions {
            impulses: vec![Vec3::zeros(); system.rows.len()],
            moments: vec![Vec3::zeros(); system.rolling_constraints.len()],
        }
    }

    /// Warm start of the rows `active`: no moment without a normal impulse.
    fn warm_start(system: &ContactProblem, active: &[u32]) -> Self {
        let mut reactions = ContactReactions::zeros(system);
        for &k in active {
            reactions.impulses[k as usize] = system.rows[k as usize].warm_start;
        }
        for (m, roll) in reactions.moments.iter_mut().zip(&system.rolling_constraints) {
            *m = if reactions.impulses[roll.row as usize] == Vec3::zeros() { Vec3::zeros() } else { roll.warm_start };
        }
        reactions
    }
}

/// Impulses r̂ of all rows (world frame, N s), the velocities that result from them, and their accuracy.
#[derive(Clone)]
pub struct ContactSolution {
    pub impulses: Vec<Vec3>,
    /// Moments of all rolling constraints, world frame, N m s.
    pub moments: Vec<Vec3>,
    pub records: Vec<SolverBody>,
    pub sweeps: u64,
    /// Whether the last sweeps began in single precision.
    pub single_precision: bool,
    /// Residual E of [`crate::solve::residual`].
    pub residual: f64,
    pub converged: bool,
    /// Number of rows outside the problem that the solution closes: the solution has not converged if there are any.
    pub left_out: usize,
    /// Row with the largest part in the residual.
    pub worst: Option<u32>,
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

/// Solves until E is reached or all sweeps are spent; a solution that reaches `tol` is converged.
///
/// Only rows that can close within the step are swept. A row left out that the solution would close nevertheless - a body may
/// become faster than its free velocity - is included, and sweeping continues.
pub fn solve_nlgs(system: &ContactProblem, until: StoppingCriteria, width: SimdWidth) -> ContactSolution {
    let StoppingCriteria { tol, max_sweeps, .. } = until;
    let rows = (0..system.rows.len() as u32).into_par_iter().with_min_len(PAR_MIN_LEN);
    let mut active: Vec<u32> = rows.filter(|&k| system.rows[k as usize].can_close).collect();
    let mut reactions = ContactReactions::warm_start(system, &active);
    let mut sweeps = 0;
    loop {
        let judge = ResidualEvaluator::new(system, &active, width);
        let single = sweeps_in_f32(system, &active, until);
        let (residual, motions) = iterate_sweeps(system, &judge, &active, &mut reactions, until, single, &mut sweeps);
        let records = judge.solver_bodies(&motions);
        let missed = closing_inactive_rows(system, &active, &records);
        if missed.is_empty() || sweeps >= max_sweeps || activity::is_stopped() {
            let ContactReactions { impulses, moments } = reactions;
            return ContactSolution {
                impulses,
                moments,
                records,
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

/// Sweeps the rows `active`, in single precision as long as that gains, and increments `sweeps`. Returns the residual and the
/// motions that result from the impulses.
fn iterate_sweeps(
    system: &ContactProblem,
    judge: &ResidualEvaluator,
    active: &[u32],
    reactions: &mut ContactReactions,
    until: StoppingCriteria,
    mut single: bool,
    sweeps: &mut u64,
) -> (Residual, Vec<BodyMotion>) {
    let StoppingCriteria { tol, target_residual: aim, min_sweeps: least_sweeps, max_sweeps, check_every, .. } = until;
    let judged = |ContactReactions { impulses, moments }: &ContactReactions| {
        let motions = judge.motions_with(impulses, moments);
        (judge.residual_with(impulses, moments, &motions), motions)
    };
    let mut best = judged(reactions);
    let enough = |e: f64, sweeps: u64| e <= aim && (sweeps >= least_sweeps || e <= REST_TOLERANCE_SHARE * tol);
    let solved = enough(best.0.value, *sweeps) && (check_every.is_none() || active.is_empty());
    if solved || *sweeps >= max_sweeps {
        return best;
    }
    let end_of =
        |residual: f64, sweeps: u64| if residual <= tol { max_sweeps.min(sweeps + MOMENTUM_CYCLE) } else { max_sweeps };
    let mut end = end_of(best.0.value, *sweeps);
    let mut problem = PackedProblem::new(system, active, reactions, &judge.solver_bodies(&best.1), single, judge.width);
    let mut laid = (*sweeps, best.0.value);
    let turns = !system.rolling_constraints.is_empty();
    let frictional = system.has_friction(active);
    let mut momentum = SweepMomentum::new(frictional);
    let mut capped = false;
    let mut trial = reactions.clone();
    // Computing the residual costs several sweeps. The change made by a sweep falls as the residual does: it shows when a
    // check is worth while. `patience` bounds the wait where it misleads.
    let mut scale = None;
    let mut patience = 0;
    loop {
        let swept = problem.sweep_contacts(judge.width, momentum.beta);
        momentum.update_after_sweep(swept.needs_restart, swept.change);
        activity::count_sweep();
        *sweeps += 1;
        patience += 1;
        if activity::is_stopped() {
            return best; // not used
        }
        let due = match check_every {
            Some(block) => patience >= block,
            None if *sweeps < least_sweeps => false,
            None => scale.is_none_or(|scale| swept.change <= scale * aim) || patience > 20 + *sweeps / 10,
        };
        if due || *sweeps >= end {
            problem.read_back(judge.width, system, &mut trial);
            let found = judged(&trial);
            let residual = found.0;
            momentum.sliding = frictional && (turns || any_contact_slides(system, active, &trial.impulses));
            capped |= momentum.sliding || frictional && residual.value >= best.0.value;
            momentum.frictional = capped;
            scale = Some(swept.change / residual.value);
            patience = 0;
            let lost = !momentum.sliding && residual.value > F32_DIVERGENCE * best.0.value;
            if single && (lost || *sweeps >= laid.0 + F32_REBASE_SWEEPS) {
                let least = residual.value.min(best.0.value);
                single = !lost && least < laid.1;
                let (from, at) = if lost { (&*reactions, &best.1) } else { (&trial, &found.1) };
                problem = PackedProblem::new(system, active, from, &judge.solver_bodies(at), single, judge.width);
                laid = (*sweeps, least);
                if !single && !momentum.sliding {
                    (momentum, capped) = (SweepMomentum::new(frictional), false);
                }
            }
            if residual.value < best.0.value {
                best = found;
                std::mem::swap(reactions, &mut trial);
            }
            end = end.min(end_of(residual.value, *sweeps));
            if enough(residual.value, *sweeps) || *sweeps >= end {
                return best;
            }
        }
    }
}

/// Whether the rows `active` are swept in single precision: for masses that do not differ too much, without moments.
fn sweeps_in_f32(system: &ContactProblem, active: &[u32], until: StoppingCriteria) -> bool {
    let asked = match until.precision {
        SweepPrecision::Auto => active.len() >= MIN_F32_CONTACTS && until.target_residual >= MIN_F32_RESIDUAL,
        SweepPrecision::Single => true,
        SweepPrecision::Double => false,
    };
    asked && system.rolling_constraints.is_empty() && {
        let of_rows = active.iter().map(|&k| system.rows[k as usize].w_n);
        let (least, most) = of_rows.fold((f64::INFINITY, 0.0f64), |(least, most), w| (least.min(w), most.max(w)));
        most <= least * MAX_MASS_RATIO
    }
}

/// Whether a contact is at the bound of its friction.
fn any_contact_slides(system: &ContactProblem, active: &[u32], impulses: &[Vec3]) -> bool {
    active.par_iter().with_min_len(1024).any(|&k| {
        let (row, r) = (&system.rows[k as usize], &impulses[k as usize]);
        let normal = row.normal.dot(r);
        // On the cone's side to rounding.
        row.friction > 0.0 && normal > 0.0 && (r - row.normal * normal).norm() >= row.friction * normal * (1.0 - 1e-12)
    })
}

/// Momentum: share of the last sweep's change with which the next one starts.
pub(super) struct SweepMomentum {
    t: f64,
    pub(super) beta: f64,
    /// Whether the momentum is capped.
    frictional: bool,
    /// Whether any contact slides. Without sliding the sweeps do not cycle, however slow they are.
    sliding: bool,
    /// Index of the sweep in the round and in its part.
    position: u64,
    since: u64,
    /// Begin and end of this window in its part of the round.
    window: [u64; 2],
    /// Sum of the changes in this window, and their mean in the one before it under the same cap.
    changes: f64,
    before: Option<f64>,
}

impl SweepMomentum {
    pub(super) fn new(frictional: bool) -> Self {
        let window = [0, STAGNATION_WINDOW];
        SweepMomentum {
            t: 1.0,
            beta: 0.0,
            frictional,
            sliding: frictional,
            position: 0,
            since: 0,
            window,
            changes: 0.0,
            before: None,
        }
    }

    /// Updates the momentum after a sweep that has made a `change` of this size.
    pub(super) fn update_after_sweep(&mut self, uphill: bool, change: f64) {
        if uphill {
            (self.t, self.beta) = (1.0, 0.0);
        } else {
            let t = 0.5 * (1.0 + (1.0 + 4.0 * self.t * self.t).sqrt());
            self.beta = ((self.t - 1.0) / t).min(self.momentum_cap());
            self.t = t;
        }
        let (end, _) = self.cycle_part();
        self.position += 1;
        self.since += 1;
        self.changes += change;
        let [from, to] = self.window;
        if self.since == to {
            let mean = std::mem::take(&mut self.changes) / (to - from) as f64;
            let circles = self.sliding && self.before.is_some_and(|before| mean >= before);
            self.position = if circles { end } else { self.position };
            (self.window, self.before) = ([to, to + STAGNATION_WINDOW.max(to / 2)], Some(mean));
        }
        if self.position == end {
            (self.position, self.since, self.window, self.changes, self.before) =
                (end % MOMENTUM_CYCLE, 0, [0, STAGNATION_WINDOW], 0.0, None);
        }
    }

    /// End of this part of the round, and its cap.
    fn cycle_part(&self) -> (u64, f64) {
        FRICTIONAL_CAPS.into_iter().find(|(end, _)| self.position < *end).unwrap_or((MOMENTUM_CYCLE, 0.0))
    }

    fn momentum_cap(&self) -> f64 {
        if self.frictional { self.cycle_part().1 } else { 1.0 }
    }
}

/// Returns the rows outside `active` (sorted) that these velocities close.
pub(super) fn closing_inactive_rows(system: &ContactProblem, active: &[u32], records: &[SolverBody]) -> Vec<u32> {
    let mut inside = active.iter().peekable();
    let outside: Vec<u32> = (0..system.rows.len() as u32).filter(|k| inside.next_if_eq(&k).is_none()).collect();
    let closes = |&k: &u32| {
        let row = &system.rows[k as usize];
        row.acts && system.shifted_normal_velocity(k as usize, records) < 0.0
    };
    outside.into_par_iter().with_min_len(1024).filter(closes).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assemble::{BlockData, ContactConstraint};

    /// Momentum of each of `sweeps` sweeps with the given changes.
    fn carried(frictional: bool, sweeps: u64, change: impl Fn(u64) -> f64) -> Vec<f64> {
        let mut momentum = SweepMomentum::new(frictional);
        (0..sweeps)
            .map(|k| {
                momentum.update_after_sweep(false, change(k));
                momentum.beta
            })
            .collect()
    }

    #[test]
    fn single_precision_is_for_many_contacts() {
        let row = ContactConstraint { w_n: 1.0, can_close: true, ..ContactConstraint::default() };
        let rows = vec![row; MIN_F32_CONTACTS];
        let system =
            ContactProblem { rows, block_data: None, rolling_constraints: vec![], order: vec![], bodies: vec![] };
        let all: Vec<u32> = (0..MIN_F32_CONTACTS as u32).collect();
        let [auto, single, double] = [SweepPrecision::Auto, SweepPrecision::Single, SweepPrecision::Double]
            .map(|precision| StoppingCriteria { precision, ..StoppingCriteria::new(1e-3, 10) });
        assert!(sweeps_in_f32(&system, &all, auto) && !sweeps_in_f32(&system, &all, double));
        assert!(!sweeps_in_f32(&system, &all[1..], auto) && sweeps_in_f32(&system, &all[1..], single));
        assert!(!sweeps_in_f32(&system, &all, StoppingCriteria { target_residual: 1e-5, ..auto }));
        let mut uneven = system.clone();
        uneven.rows[7].w_n = 1e10;
        assert!(!sweeps_in_f32(&uneven, &all, single));
        uneven.rows[7].w_n = 0.0; // between two bodies whose motion is imposed
        assert!(!sweeps_in_f32(&uneven, &all, single));
        let full = BlockData { arms: vec![], friction_offsets: vec![], locked_axes: vec![], inverse_inertia: vec![] };
        let system = ContactProblem { block_data: Some(full), ..system };
        assert!(sweeps_in_f32(&system, &all, auto) && !sweeps_in_f32(&system, &all[1..], auto));
    }

    #[test]
    fn sweeps_in_circles_lose_their_momentum_and_others_keep_it() {
        let falls = carried(true, 2000, |k| 0.999f64.powi(k as i32));
        let circles = carried(true, 200, |k| 1.0 + (k % 4) as f64);
        // An oscillation with a period of two windows of 16 sweeps is larger than the decrease from one window to the next.
        let slow = carried(true, 601, |k| 0.999f64.powi(k as i32) * (1.0 + 0.05 * (k as f64 * 0.2).cos()));
        let ends: Vec<usize> = (1..200).filter(|&k| circles[k] != circles[k - 1] && k > 20).collect();
        assert_eq!(falls[599..=600], [0.8, 0.5]);
        assert_eq!(falls[799..=800], [0.5, 0.0]);
        assert_eq!(slow[599..=600], [0.8, 0.5]);
        assert_eq!(falls[999..=1000], [0.0, 0.8]);
        // Two windows detect a cycle; the momentum is then reduced.
        assert_eq!(ends, [32, 64, 96, 128, 160, 192]);
        assert_eq!([32, 64, 96].map(|k| circles[k]), [0.5, 0.0, 0.8]);
        // Without friction there is no cap that could change the momentum.
        assert!(carried(false, 200, |_| 1.0)[199] > 0.98);
    }
}
