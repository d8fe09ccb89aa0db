//! Contacts that imposed motion closes and that no free motion opens, for the report of a step that has not converged.

use std::collections::{HashSet, VecDeque};

use crate::assemble::{ContactProblem, SolverBody};
use crate::scene::BodyId;
use crate::solve::ContactSolution;

/// Smallest ratio, at which a conflict is reported, of the motion that would open its contacts together to the motion
/// that would open each of them alone. In a conflict it grows by up to one a sweep. For a chain of n bodies that can
/// yield it is √n.
const MIN_CONFLICT: f64 = 100.0;

/// Largest number of sweeps in search of a conflict: for four cubes in a row between walls the ratio is 400 to 1300 by
/// then.
const MAX_CONFLICT_SWEEPS: usize = 1000;
/// Number of sweeps between two evaluations of the ratio: an evaluation costs as much as a sweep, so 1 % is added.
const SWEEPS_PER_CHECK: usize = 100;

/// Largest number of rows in which a conflict is sought, nearest to the worst contact: fewer contacts in conflict prove as
/// much, and the search takes less time than the sweeps of a step that does not converge.
const MAX_CONFLICT_ROWS: usize = 1000;

/// Searches for a conflict near the contact with the largest residual: contacts that no motion of bodies opens
/// together, since components of it are imposed. Returns the bodies of the contact with the largest part in it; `None`
/// if none is found.
///
/// With impulses r ≥ 0 along the normals, velocities V and the closing velocities u of the contacts, a motion V + d that opens
/// all contacts has r·u + (H r)·d ≥ 0, so that its kinetic norm is |d| ≥ D = -r·u / √(r·W r). Each contact alone is opened by
/// |d| = |u|/√W_nn; contacts without common bodies have D ≤ S = √(Σ u²/W_nn). In a conflict the impulses r of frictionless
/// sweeps grow from sweep to sweep, but not their effect W r on free components, and D/S has no bound.
pub fn conflicting_bodies(
    contact_problem: &ContactProblem,
    solution: &ContactSolution,
    tol: f64,
) -> Option<[BodyId; 2]> {
    let worst = contact_problem.rows[solution.worst?.index()].bodies;
    let may_conflict = |&k: &usize| can_be_in_conflict(contact_problem, k);
    let pairs = (0..contact_problem.rows.len()).filter(may_conflict).map(|k| (k, contact_problem.rows[k].bodies));
    let rows = nearest_rows(pairs, &contact_problem.bodies, worst);
    conflict_among_rows(contact_problem.clone(), &rows, tol)
}

/// Whether a row can close and act on a body, and is not regularised.
pub fn can_be_in_conflict(contact_problem: &ContactProblem, row: usize) -> bool {
    let constraint = &contact_problem.rows[row];
    constraint.can_close && constraint.w_n > 0.0 && contact_problem.regularised_row(row).is_none()
}

/// Searches for a conflict in these rows, see [`conflicting_bodies`]. Returns the bodies that it names; `None` without one.
pub fn conflict_among_rows(mut problem: ContactProblem, rows: &[usize], tol: f64) -> Option<[BodyId; 2]> {
    let velocity = |problem: &ContactProblem, k: usize| problem.shifted_normal_velocity(k, &problem.bodies);
    let free: Vec<f64> = rows.iter().map(|&k| velocity(&problem, k)).collect();
    // Closing velocities below `tol` times those of the free motion are errors that a converged step may have.
    let scale: f64 = rows.iter().zip(&free).map(|(&k, u)| u.min(0.0).powi(2) / problem.rows[k].w_n).sum();
    let negligible = tol * tol * scale;
    let mut impulses = vec![0.0; rows.len()];
    for sweep in 1..=MAX_CONFLICT_SWEEPS {
        for (&k, r) in rows.iter().zip(&mut impulses) {
            let row = problem.rows[k];
            let change = (-velocity(&problem, k) / row.w_n).max(-*r);
            *r += change;
            problem.apply_impulse(k, &(row.normal * change));
        }
        if !sweep.is_multiple_of(SWEEPS_PER_CHECK) {
            continue;
        }
        // -r·u, r·W r and S², with the symbols above.
        let (mut closing, mut effect, mut sum_alone) = (0.0, 0.0, 0.0);
        let (mut largest, mut worst) = (0.0, None);
        for ((&k, r), free) in rows.iter().zip(&impulses).zip(&free).filter(|((_, r), _)| **r > 0.0) {
            let (row, u) = (&problem.rows[k], velocity(&problem, k));
            closing -= r * u;
            effect += r * (u - free);
            sum_alone += u * u / row.w_n;
            if -r * u > largest {
                (largest, worst) = (-r * u, Some(row.bodies));
            }
        }
        if sum_alone > negligible && closing > MIN_CONFLICT * (effect.max(0.0) * sum_alone).sqrt() {
            return worst;
        }
    }
    None
}

/// Rows on the bodies `worst`, then those on the other bodies of these, and so on, as far as bodies can move. `pairs`: rows
/// that may be in conflict, with their bodies.
pub fn nearest_rows(
    pairs: impl Iterator<Item = (usize, [BodyId; 2])>,
    bodies: &[SolverBody],
    worst: [BodyId; 2],
) -> Vec<usize> {
    let mut rows_of_body = vec![Vec::new(); bodies.len()];
    for (k, pair) in pairs {
        pair.iter().for_each(|body| rows_of_body[body.index()].push((k, pair)));
    }
    let mut rows: Vec<usize> = Vec::new();
    let mut waiting = VecDeque::from(worst);
    let mut is_known = HashSet::new();
    while let Some(body) = waiting.pop_front().filter(|_| rows.len() < MAX_CONFLICT_ROWS) {
        if bodies[body.index()].inverse_mass == 0.0 {
            continue;
        }
        for (k, pair) in std::mem::take(&mut rows_of_body[body.index()]) {
            if is_known.insert(k) {
                rows.push(k);
                waiting.extend(pair);
            }
        }
    }
    rows
}
