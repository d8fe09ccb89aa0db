//! Ledger of the step: expected momentum and energy, and the report for the log.

use std::ops::Add;

use rayon::prelude::*;

use super::cell_stress::mean_normal_stresses;
use super::collectives::{conflicting_bodies_of_ranks, contact_of_ranks};
use super::conflict::conflicting_bodies;
use super::context::{SolvedProblem, StepContext};
use super::ends::StepOutcome;
use super::implicit_step::implicit_step_work;
use super::radius_stress::update_mean_pressures;
use super::totals::{ITEMS_PER_TASK, Overlap};
use crate::assemble::{GravityReport, potential_energy};
use crate::detect::NarrowPhaseError;
use crate::integrate::held_rotational_energy;
use crate::math::{PAR_MIN_LEN, Quat, Vec3};
use crate::ranks::lists::sum_over_ranks;
use crate::scene::{BodyId, Scene};
use crate::solve::lmgc90_criteria::{Lmgc90Norms, lmgc90_norms};
use crate::state::{BodyLoad, ContactId, OutputInterval, SolvedContact, State, Velocities};

/// Report of a step for the log.
#[derive(Debug, Clone, PartialEq)]
pub struct StepReport {
    /// Length of the step, s.
    pub h: f64,
    /// Contacts that detection lists.
    pub contacts_listed: usize,
    /// Contacts of the solved problem.
    pub contacts_solved: usize,
    /// Contacts that carry force.
    pub contacts_active: usize,
    /// Sweeps of the contact solver.
    pub sweeps: u64,
    /// Whether the sweeps began in single precision.
    pub single_precision: bool,
    /// Residual of the solution.
    pub residual: f64,
    /// Residual up to which the step counts as converged: `tol`, less in steps of many radii.
    pub tol: f64,
    /// Whether the residual is at most `tol`.
    pub converged: bool,
    /// Rows outside the solved problem that the solution closes.
    pub left_out: usize,
    /// Whether a solver of stored problems found the solution where the sweeps had stalled.
    pub fallback_used: bool,
    /// Whether `auto` left the step unconverged after one round of sweeps, because further attempts failed in earlier steps.
    pub fallback_suppressed: bool,
    /// Reason why sweeps replaced the requested solver.
    pub replacement_reason: Option<&'static str>,
    /// LMGC90's criteria, if requested.
    pub norms: Option<Lmgc90Norms>,
    /// The contact with the largest part in the residual.
    pub worst: Option<WorstContact>,
    /// Bodies of a contact that imposed motion closes and no free motion opens, in a step that has not converged.
    pub conflict: Option<[BodyId; 2]>,
    /// Deepest overlap in the contact configuration, if it is worth a warning.
    pub overlap: Option<Overlap>,
    /// Deepest overlap of two bodies of which neither can move along the normal, if it is worth a warning.
    pub inert_overlap: Option<Overlap>,
    /// Largest penetration in the contact configuration, and the sum of all over `contacts_active`, m.
    pub penetration_largest: f64,
    pub penetration_mean: f64,
    /// Contacts that the fast narrow phase missed, in steps in which this is checked.
    pub narrow_phase_error: Option<NarrowPhaseError>,
    /// Σ f·l, forces and branches of the contacts: pressure times three volumes, J.
    pub virial: f64,
    /// Σ ¼ m |h a|² over the bodies on which no contact acts, J; a is the acceleration beyond uniform gravity. It is the error
    /// of their kinetic energy in a step that takes a as constant.
    pub flight_error: f64,
    /// Translational and rotational kinetic energy of the grains at the step's end, J.
    pub kinetic: f64,
    pub rotational: f64,
    /// Potential energy in the contact configuration, J.
    pub potential: f64,
    pub gravity: GravityReport,
    /// |momentum - expected| divided by the largest sum of m |v| so far.
    pub momentum_drift: f64,
    /// Bodies at the start of the step, if commands of POSTPRO.DAT need them.
    pub start: Option<StepStart>,
}

/// Bodies in the contact configuration, with their velocities at the start of the step.
#[derive(Debug, Clone, PartialEq)]
pub struct StepStart {
    /// Centres, m, and orientations.
    pub x: Vec<Vec3>,
    pub q: Vec<Quat>,
    /// Velocities, m/s, and angular velocities, rad/s, fixed axes.
    pub v: Vec<Vec3>,
    pub w: Vec<Vec3>,
}

impl StepStart {
    /// Body, arm from its centre (m, fixed axes) and sign of the force of a contact on it, for candidate and antagonist.
    pub fn arms(&self, SolvedContact { contact, .. }: &SolvedContact) -> [(BodyId, Vec3, f64); 2] {
        let [a, b] = [contact.candidate, contact.antagonist];
        let other = self.x[b.index()] + contact.image;
        [(a, contact.point - self.x[a.index()], 1.0), (b, contact.point - other, -1.0)]
    }
}

/// Contact given by its two bodies and its position in the contact configuration, m: polyhedra share several contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorstContact {
    pub bodies: [BodyId; 2],
    pub point: Vec3,
}

/// Enters the step in the ledger and reports it; to be called before the state advances.
pub fn update_ledger(
    StepContext { scene, q_c, free, .. }: StepContext,
    state: &mut State,
    SolvedProblem { request, contact_problem, solution, .. }: &SolvedProblem,
    outcome: &StepOutcome,
) -> StepReport {
    let h = q_c.h;
    let contact_totals = &outcome.totals;
    if let (Some(step), Some(cell)) = (&q_c.cell_step, &mut state.cell) {
        cell.mean_stress = mean_normal_stresses(scene, q_c, step, outcome, cell.mean_stress);
    }
    update_mean_pressures(scene, q_c, &outcome.contacts, state);
    if state.step.is_multiple_of(scene.options.output_every) {
        state.interval = OutputInterval { start: state.time, ..OutputInterval::default() };
    }
    state.interval.add_pair_virials(&outcome.pair_virials);
    let implicit_work = implicit_step_work(scene, state, q_c, free, &outcome.v);
    let predicted_work =
        held_rotational_energy(scene, &q_c.q, &q_c.w) - held_rotational_energy(scene, &state.q, &state.w);
    let ledger = &mut state.ledger;
    ledger.contact_work += contact_totals.contact_work;
    ledger.friction_work += contact_totals.friction_work;
    ledger.outside_work += contact_totals.outside_work + implicit_work + free.reaction_work + predicted_work;
    for BodyLoad { body, force, torque } in &free.loads {
        let i = body.index();
        ledger.outside_work +=
            0.5 * h * (force.dot(&(outcome.v[i] + state.v[i])) + torque.dot(&(outcome.w[i] + q_c.w[i])));
    }
    for k in 0..3 {
        ledger.momentum_expected[k] += free.impulse[k] + contact_totals.driven_impulse[k];
        ledger.angular_momentum_expected[k] += free.angular_impulse[k] + contact_totals.angular_momentum_change[k];
    }

    let flight_error = |&i: &BodyId| {
        let (i, mass) = (i.index(), scene.bodies[i.index()].mass);
        let is_in_flight = outcome.v[i] == free.v[i];
        if is_in_flight { 0.25 * mass * (free.v[i] - state.v[i] - state.gravity * h).norm_squared() } else { 0.0 }
    };
    let flight_errors: Vec<f64> = scene.free.par_iter().with_min_len(PAR_MIN_LEN).map(flight_error).collect();
    // Bodies that rest from the start have only the momentum that forces give and contacts take in a step.
    let impulse_of_forces =
        |&i: &BodyId| scene.bodies[i.index()].mass * (free.v[i.index()] - state.v[i.index()]).norm();
    let impulses: Vec<f64> = scene.free.par_iter().with_min_len(PAR_MIN_LEN).map(impulse_of_forces).collect();
    let motion = MotionTotals::from_bodies(scene, &q_c.q, outcome.velocities());
    ledger.momentum_scale = ledger.momentum_scale.max(motion.scale).max(impulses.iter().sum());
    let momentum_error = (motion.momentum - Vec3::from(ledger.momentum_expected)).norm();
    ledger.penetration_largest = ledger.penetration_largest.max(contact_totals.penetration_largest / scene.mean_radius);
    let active_count = contact_totals.contacts_active.max(1) as f64;
    let mean_over_radius = |sum: f64| sum / active_count / scene.mean_radius.max(f64::MIN_POSITIVE); // there may be no grains
    // At most the penetration that exists now.
    ledger.penetration_left = ledger.penetration_left.min(mean_over_radius(contact_totals.penetration_sum))
        + mean_over_radius(contact_totals.penetration_added);
    ledger.sweeps += solution.sweeps;
    if !solution.converged {
        ledger.steps_unconverged += 1;
        ledger.last_unconverged = Some(state.step + 1);
    }
    let is_divided = state.detection_cache.is_divided();
    let row_contact = |row: ContactId| match is_divided {
        true => contact_of_ranks(row, &outcome.contacts),
        false => outcome.contacts.get(row.index()).map(|solved| solved.contact),
    };
    let worst = solution
        .worst
        .and_then(row_contact)
        .map(|contact| WorstContact { bodies: [contact.candidate, contact.antagonist], point: contact.point });
    StepReport {
        h,
        contacts_listed: if is_divided { sum_over_ranks(outcome.contacts.len()) } else { outcome.contacts.len() },
        contacts_solved: solution.active_rows,
        contacts_active: contact_totals.contacts_active,
        sweeps: solution.sweeps,
        single_precision: solution.single_precision,
        residual: solution.residual,
        tol: request.criteria.tol,
        converged: solution.converged,
        left_out: solution.left_out,
        fallback_used: solution.fallback_used,
        replacement_reason: solution.replacement_reason,
        norms: (scene.options.lmgc90_norms || scene.has_solver_file())
            .then(|| lmgc90_norms(contact_problem, &solution.impulses, &solution.solver_bodies)),
        worst,
        conflict: match solution.converged {
            true => None,
            false if is_divided => {
                worst.and_then(|worst| conflicting_bodies_of_ranks(contact_problem, worst.bodies, request.criteria.tol))
            }
            false => conflicting_bodies(contact_problem, solution, request.criteria.tol),
        },
        overlap: contact_totals.overlap,
        inert_overlap: contact_totals.inert_overlap,
        penetration_largest: contact_totals.penetration_largest,
        penetration_mean: contact_totals.penetration_sum / active_count,
        narrow_phase_error: None,
        fallback_suppressed: request.skips_fallback() && !solution.converged,
        virial: contact_totals.virial / h,
        flight_error: flight_errors.iter().sum(),
        kinetic: motion.kinetic,
        rotational: motion.rotational,
        potential: free.potential,
        gravity: free.gravity,
        start: scene.keeps_step_start().then(|| StepStart {
            x: q_c.x.clone(),
            q: q_c.q.clone(),
            v: state.v.clone(),
            w: q_c.w.clone(),
        }),
        momentum_drift: if ledger.momentum_scale > 0.0 { momentum_error / ledger.momentum_scale } else { 0.0 },
    }
}

/// Sums over the bodies: momenta of the free ones, energies of the grains, which are these and [`Scene::held_grains`].
#[derive(Debug, Clone, Copy, Default)]
pub struct MotionTotals {
    /// Momentum, kg m/s.
    pub momentum: Vec3,
    /// Sum of m |v|, kg m/s.
    pub scale: f64,
    /// Translational and rotational kinetic energy, J.
    pub kinetic: f64,
    pub rotational: f64,
}

impl MotionTotals {
    /// Sums over the free bodies with the orientations `q` and these velocities.
    pub fn from_bodies(scene: &Scene, q: &[Quat], Velocities { v, w, .. }: Velocities) -> Self {
        let sum_of_chunk = |bodies: &[BodyId]| {
            bodies.iter().map(|&i| i.index()).fold(MotionTotals::default(), |sum, i| {
                let body = &scene.bodies[i];
                sum + MotionTotals {
                    momentum: v[i] * body.mass,
                    scale: v[i].norm() * body.mass,
                    kinetic: 0.5 * body.mass * v[i].norm_squared(),
                    rotational: body.rotational_energy(&q[i], &w[i]),
                }
            })
        };
        let parts: Vec<MotionTotals> = scene.free.par_chunks(ITEMS_PER_TASK).map(sum_of_chunk).collect();
        let held = MotionTotals { momentum: Vec3::zeros(), scale: 0.0, ..sum_of_chunk(&scene.held_grains) };
        parts.into_iter().fold(MotionTotals::default(), MotionTotals::add) + held
    }

    /// Angular momentum of the free bodies about the origin, kg m^2/s.
    pub fn total_angular_momentum(scene: &Scene, state: &State) -> Vec3 {
        let body_angular_momentum = |&i: &BodyId| {
            let (i, body) = (i.index(), &scene.bodies[i.index()]);
            state.x[i].cross(&state.v[i]) * body.mass + body.angular_momentum(&state.q[i], &state.w[i])
        };
        scene.free.iter().map(body_angular_momentum).sum()
    }
}

impl Add for MotionTotals {
    type Output = MotionTotals;

    fn add(self, other: MotionTotals) -> MotionTotals {
        MotionTotals {
            momentum: self.momentum + other.momentum,
            scale: self.scale + other.scale,
            kinetic: self.kinetic + other.kinetic,
            rotational: self.rotational + other.rotational,
        }
    }
}

/// Errors of the balances at the end of a step.
#[derive(Debug, Clone, Copy)]
pub struct BalanceErrors {
    /// Unaccounted energy, E - E_start - work of contacts - work from outside, divided by `energy_scale`.
    pub energy: f64,
    /// Largest of kinetic and potential energy, |E_start| and the works, J.
    pub energy_scale: f64,
    /// Change of momentum that no wall, field or event explains, divided by the largest sum so far of m |v|, or of the
    /// impulses in a step.
    pub momentum: f64,
    /// Unexplained change of angular momentum, divided by the sum of `momentum` times the largest distance from the
    /// origin.
    pub angular_momentum: f64,
}

impl BalanceErrors {
    /// Compares the bodies with the ledger.
    pub fn new(scene: &Scene, state: &State) -> Self {
        let ledger = &state.ledger;
        let motion = MotionTotals::from_bodies(scene, &state.q, state.velocities());
        let ratio = |error: f64, scale: f64| if scale > 0.0 { error / scale } else { 0.0 };
        let (kinetic, potential) = (motion.kinetic + motion.rotational, potential_energy(scene, state, &state.x));
        let energies = [kinetic, potential, ledger.energy_start, ledger.contact_work, ledger.outside_work];
        let energy_scale = energies.iter().fold(0.0, |largest: f64, energy| largest.max(energy.abs()));
        let unaccounted = kinetic + potential - ledger.energy_start - ledger.contact_work - ledger.outside_work;
        let largest_distance = scene.free.iter().map(|&i| state.x[i.index()].norm()).fold(0.0, f64::max);
        let momentum_error = (motion.momentum - Vec3::from(ledger.momentum_expected)).norm();
        let angular_momentum = MotionTotals::total_angular_momentum(scene, state);
        let angular_momentum_error = (angular_momentum - Vec3::from(ledger.angular_momentum_expected)).norm();
        BalanceErrors {
            energy: ratio(unaccounted, energy_scale),
            energy_scale,
            momentum: ratio(momentum_error, ledger.momentum_scale),
            angular_momentum: ratio(angular_momentum_error, ledger.momentum_scale * largest_distance),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::LawId;
    use crate::state::{Contact, ContactStatus};

    #[test]
    fn arms_of_a_contact_across_a_periodic_boundary_are_from_the_touched_image() {
        // Balls of 1 m at x = 1 m and 9 m, with a period of 10 m: the second touches the first at x = 0.
        let x = vec![Vec3::new(9.0, 2.0, 3.0), Vec3::new(1.0, 2.0, 3.0)];
        let zeros = vec![Vec3::zeros(); 2];
        let start = StepStart { x, q: vec![Quat::identity(); 2], v: zeros.clone(), w: zeros };
        let contact = Contact {
            candidate: BodyId(1),
            antagonist: BodyId(0),
            part_numbers: [0, 0].into(),
            features: [0, 0].into(),
            point: Vec3::new(0.0, 2.0, 3.0),
            image: Vec3::new(-10.0, 0.0, 0.0),
            normal: Vec3::x(),
            gap: 0.0,
            area: 0.0,
            law: LawId(0),
        };
        let solved = SolvedContact {
            contact,
            impulse: Vec3::zeros(),
            moment: Vec3::zeros(),
            velocity: Vec3::zeros(),
            status: ContactStatus::Stick,
            bond: None,
        };
        assert_eq!(start.arms(&solved), [(BodyId(1), -Vec3::x(), 1.0), (BodyId(0), Vec3::x(), -1.0)]);
    }
}
