//! Contacts that part or slide at a step's end by more than the error of the solution. Their loss is irreversible.
//!
//! A contact that opens or slides in an exact solution has û_n > 0 or û_T ≠ 0. In an approximate solution a contact at its
//! limit may move although another distribution of the same load would keep it at rest: the load of a face is shared by its
//! points as the sweeps happen to find it. Then its neighbours, which stick, move as well, and their velocity is known to be
//! an error. Each body has an error of velocity: the largest |F|/ρ over its contacts, with the natural map F of the contact
//! and its own ρ = 3/trace W. A contact moves if its velocity exceeds [`ERROR_MARGIN`] times the error of its two bodies. No
//! property of the load or the law is in this scale.

use rayon::prelude::*;

use super::context::{SolvedProblem, StepContext};
use super::drift::LARGEST_OPENING;
use crate::assemble::{ContactConstraint, ContactProblem, SolverBody};
use crate::laws::ContactLaw;
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::scene::BodyId;
use crate::solve::{ContactSolution, SolveRequest, StoppingCriteria, solve_by_sweeps};
use crate::state::Contact;

/// Errors of its bodies by which a contact must move. A face at rest has at least one point whose error is its own velocity.
/// A point far from it, as face corners are from each other, moves by up to three times that velocity as the face turns.
const ERROR_MARGIN: f64 = 3.0;

/// Share of the summed velocities at a contact that is rounding: a hundred sweeps of a few units in the last place.
const ROUNDING_SHARE: f64 = 1e-13;

/// Smallest error of velocity that matters, as a share of the velocity change that the strength of a bond gives its two
/// bodies: a load that is off by three times as much, [`ERROR_MARGIN`], is still distinguished from the strength.
const MIN_RESOLVED_SHARE: f64 = 0.01;

/// Largest number of tenfold refinements of a step for its bonds: to 1e-9 of the residual of the unsolved problem.
const MAX_REFINEMENTS: usize = 6;

/// Errors of velocity by body, m/s; 0 for a body without contact impulses.
pub struct VelocityErrors {
    errors: Vec<f64>,
}

impl VelocityErrors {
    pub fn new(system: &ContactProblem, solution: &ContactSolution) -> Self {
        let of_row = |(k, r): (usize, &Vec3)| {
            // The natural map of such rows is another one, and their contacts lose nothing.
            if system.rows[k].can_close && system.regularised_row(k).is_none() {
                velocity_error(system, solution, k, r)
            } else {
                0.0
            }
        };
        let of_rows: Vec<f64> =
            solution.impulses.par_iter().enumerate().with_min_len(PAR_MIN_LEN).map(of_row).collect();
        let mut errors = vec![0.0f64; system.bodies.len()];
        for (row, error) in system.rows.iter().zip(of_rows) {
            // A body that does not move transmits no error.
            for body in row.bodies.into_iter().filter(|&body| system.bodies[body.index()].inverse_mass > 0.0) {
                errors[body.index()] = errors[body.index()].max(error);
            }
        }
        VelocityErrors { errors }
    }

    /// Error of the velocity at a contact between `bodies`, m/s.
    fn contact_error(&self, bodies: [BodyId; 2]) -> f64 {
        let [a, b] = bodies.map(|body| self.errors[body.index()]);
        a.max(b)
    }

    /// Whether the contact of a row opens, and whether it slides, at the velocity `u` = û.
    pub fn opens_or_slides(&self, row: &ContactConstraint, u: &Vec3) -> (bool, bool) {
        let least = ERROR_MARGIN * self.contact_error(row.bodies);
        let opening = row.normal.dot(u);
        (opening > least, (u - row.normal * opening).norm() > least)
    }

    /// Whether the solution leaves open if the bond of row `k` with the impulse `r` breaks. This is so if the bond is at its
    /// limit to within errors that are not small against its strength, and it does not move by more than these errors. It is
    /// also so if the errors open the bond in `h` by more than positions are corrected for, at the effective radius `radius`
    /// (m).
    fn is_undecided(&self, system: &ContactProblem, solution: &ContactSolution, k: usize, h: f64, radius: f64) -> bool {
        let row = &system.rows[k];
        let error = self.contact_error(row.bodies);
        let (opens, slides) = self.opens_or_slides(row, &system.shifted_velocity(k, &solution.solver_bodies));
        if opens || slides {
            return false;
        }
        let r = &solution.impulses[k];
        let normal = row.normal.dot(r);
        let tangential = (r - row.normal * normal).norm();
        let traction = row.w_n * row.impulse_shift.abs();
        // Where all traction is used up, the limit of shear is 0.
        let shear = row.w_t * row.friction * normal.max(MIN_RESOLVED_SHARE * row.impulse_shift.abs());
        let near = |left: f64, w: f64| w * left <= ERROR_MARGIN * error;
        near(normal, row.w_n) && error > MIN_RESOLVED_SHARE * traction
            || near(row.friction * normal - tangential, row.w_t) && error > MIN_RESOLVED_SHARE * shear
            || error * h > LARGEST_OPENING * radius
    }
}

/// Refines a converged solution tenfold as long as it is undecided if some bond breaks, and returns the velocity errors of
/// the result; `None` if no law has irreversible losses. The number of refinements depends only on the loads of the bonds.
pub fn refine_until_decided(
    StepContext { scene, q_c, contacts, .. }: StepContext,
    laws: &[ContactLaw],
    request: SolveRequest,
    SolvedProblem { system, solution, .. }: &mut SolvedProblem,
) -> Option<VelocityErrors> {
    laws.iter().any(ContactLaw::has_irreversible_loss).then(|| {
        let mut motion = VelocityErrors::new(system, solution);
        for _ in 0..MAX_REFINEMENTS {
            let is_open = |(k, contact): (usize, &Contact)| {
                let radius = || {
                    let (a, b) = contact.ranks;
                    scene.effective_radius((contact.candidate, a), (contact.antagonist, b))
                };
                let bonded = system.rows[k].bond.is_some() && system.rows[k].impulse_shift != 0.0;
                bonded
                    && laws[contact.law as usize].has_irreversible_loss()
                    && motion.is_undecided(system, solution, k, q_c.h, radius())
            };
            if !solution.converged || !contacts.par_iter().enumerate().with_min_len(PAR_MIN_LEN).any(is_open) {
                break;
            }
            system.rows.iter_mut().zip(&solution.impulses).for_each(|(row, r)| row.warm_start = *r);
            system.rolling_constraints.iter_mut().zip(&solution.moments).for_each(|(roll, m)| roll.warm_start = *m);
            let target_residual = 0.1 * solution.residual.min(request.criteria.target_residual);
            let further = solve_by_sweeps(
                system,
                StoppingCriteria { target_residual, min_sweeps: 0, ..request.criteria },
                request.width,
            );
            let stalls = further.residual > 0.5 * solution.residual;
            let ContactSolution {
                fallback_used: taken_over,
                stalled_residual: stalled,
                replacement_reason: replaced,
                single_precision: single,
                ..
            } = *solution;
            let sweeps = solution.sweeps + further.sweeps;
            *solution = ContactSolution {
                sweeps,
                fallback_used: taken_over,
                stalled_residual: stalled,
                replacement_reason: replaced,
                single_precision: single || further.single_precision,
                ..further
            };
            motion = VelocityErrors::new(system, solution);
            if stalls {
                break;
            }
        }
        motion
    })
}

/// |F|/ρ of row `k` with the impulse `r`, and the rounding part of its velocity, m/s.
fn velocity_error(system: &ContactProblem, solution: &ContactSolution, k: usize, r: &Vec3) -> f64 {
    let row = &system.rows[k];
    let rho = 3.0 / (row.w_n + 2.0 * row.w_t);
    let speed = |side: usize| {
        let SolverBody { v, w, .. } = &solution.solver_bodies[row.bodies[side].index()];
        v.norm() + w.norm() * system.contact_arm(k, side).norm()
    };
    let rounding =
        ROUNDING_SHARE * (speed(0) + speed(1) + row.shift.norm() + (r.norm() + row.impulse_shift.abs()) / rho);
    natural_map(&row.normal, row.friction, rho, &system.shifted_velocity(k, &solution.solver_bodies), r).norm() / rho
        + rounding
}

/// F = r - P(r - ρ (û + μ |û_T| n)) with the projection P on Coulomb's cone, N s. It is 0 for a contact that obeys Signorini
/// and Coulomb.
fn natural_map(n: &Vec3, friction: f64, rho: f64, u: &Vec3, r: &Vec3) -> Vec3 {
    let sliding = (u - n * n.dot(u)).norm();
    let z = r - (u + n * (friction * sliding)) * rho;
    let along = n.dot(&z);
    let across = z - n * along;
    let size = across.norm();
    let nearest = if size <= friction * along {
        z
    } else if friction * size <= -along {
        Vec3::zeros()
    } else {
        let normal = (along + friction * size) / (1.0 + friction * friction);
        let tangential = if size > 0.0 { across * (friction * normal / size) } else { Vec3::zeros() };
        n * normal + tangential
    };
    r - nearest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_natural_map_is_0_where_the_conditions_hold() {
        let n = Vec3::new(0.6, 0.0, 0.8);
        let (t, s) = (Vec3::new(0.8, 0.0, -0.6), Vec3::y());
        let f = |u: Vec3, r: Vec3| natural_map(&n, 0.5, 2.0, &u, &r).norm();
        let zero = Vec3::zeros();
        for (u, r) in [(zero, n * 3.0 + t), (n * 2.0 + t * 9.0, zero), (t * 4.0, n * 2.0 - t), (s * -4.0, n * 2.0 + s)]
        {
            assert!(f(u, r) < 1e-15 * 10.0, "{u} {r}");
        }
        // The error of a sticking contact that moves is ρ û; that of a parting contact with an impulse is at most this
        // impulse.
        assert!((f(s * 0.1, n * 3.0) - 0.2).abs() < 0.11 && f(s * 0.1, n * 3.0) >= 0.2);
        assert_eq!(f(n * 8.0, n), 1.0);
        assert!(f(zero, t) > 0.4);
    }
}
