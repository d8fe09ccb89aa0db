//! Contact problem of a step, changed and solved until its solution is admissible.
//!
//! A contact problem has the contacts that velocities without contacts could close, and assumes that bodies keep their
//! orientation. Its solution may close other pairs, turn a body through a surface, or, if it is unfinished, throw a body
//! with restitution through one. Then the problem is changed and solved again.

use super::clock::StageClock;
use super::collectives::solve_divided_problem;
use super::context::{PredictedStep, SolvedProblem};
use super::ends::solved_velocities;
use super::overturning::{approach, overturned_bodies, pushed_bodies};
use crate::activity::{self, StepStage};
use crate::assemble;
use crate::detect;
use crate::integrate::ContactConfiguration;
use crate::laws::ContactLaw;
use crate::ranks::lists::any_rank;
use crate::scene::Scene;
use crate::solve::{self, SolveRequest};
use crate::state::{Contact, State, Velocities};

/// Solves the contact problem of the step, and again after each of these changes to `predicted` and to the laws, until
/// none is needed:
///
/// 1. `contacts` gains the pairs that were open and that the solution closes;
/// 2. `q_c.closed_by_others` gains the open contacts that were left out as their bodies miss each other, and that the solution closes;
/// 3. `q_c.orientation_kept` gains the bodies that the solution turns through a surface;
/// 4. `q_c.pushed_at_centre` gains those of them that the free velocities or the solution move into a surface without a rotation;
/// 5. the laws of `state` lose their restitution, once, if an unfinished solution takes a rebounding body through a surface.
///
/// Changes 1 to 4 come to an end, since each adds a pair or a body that it adds only once. Returns `None` if the
/// program was requested to stop.
pub fn solve_until_admissible(
    scene: &Scene,
    state: &mut State,
    predicted: &mut PredictedStep,
    request: SolveRequest,
    clock: &mut StageClock,
) -> Option<SolvedProblem> {
    let PredictedStep { q_c, free, contacts } = predicted;
    let (mut sweeps, mut original_laws) = (0, None);
    // Other ranks may have other contacts.
    let is_divided = state.detection_cache.is_divided();
    let is_any = |found: bool| if is_divided { any_rank(found) } else { found };
    loop {
        let mut contact_problem = assemble::contact_problem(scene, state, q_c, contacts, free.velocities()); // M4  W, b
        clock.add_lap(|times| &mut times.assembly);
        activity::begin_stage(StepStage::Solve, contacts.len());
        let write_out = |contact_problem: &_| assemble::stored_problem(contact_problem, contacts);
        let mut solution = match is_divided {
            true => solve_divided_problem(&mut contact_problem, contacts, request),
            false => solve::solve_contact_problem(&contact_problem, request, write_out),
        }; // M5  r
        sweeps += solution.sweeps;
        clock.add_lap(|times| &mut times.solve);
        let (v, w) = solved_velocities(&solution, free, q_c);
        // Velocities with which the bodies move to the step's end, where some keep their orientation.
        let moving_w = ContactConfiguration::without_spins(&w, &q_c.orientation_kept);
        let moving = Velocities { v: &v, w: &moving_w, ..free.velocities() };
        let late = detect::late_contacts(scene, q_c, free.velocities(), moving, contacts, &state.detection_cache);
        clock.add_lap(|times| &mut times.detection);
        if activity::is_stopped() {
            return None;
        }
        if is_any(!late.is_empty()) {
            contacts.extend(late);
            contacts.sort_unstable_by_key(Contact::key);
            continue;
        }
        let free_w = ContactConfiguration::without_spins(&free.w, &q_c.pushed_at_centre);
        // Free velocities of the contact problem, in which bodies that contacts push at their centres do not rotate.
        let free_of_problem = Velocities { w: &free_w, ..free.velocities() };
        let closed_by_others =
            assemble::contacts_closed_by_others(scene, state, q_c, contacts, free_of_problem, moving);
        if is_any(!closed_by_others.is_empty()) {
            q_c.closed_by_others.extend(closed_by_others);
            continue;
        }
        let overturned = overturned_bodies(scene, q_c, contacts, free.velocities(), moving);
        if !overturned.is_empty() {
            q_c.orientation_kept.extend(overturned);
            // Contacts that stop the motion of a centre do not turn its body; its own rotation is stopped by turning it.
            let free_w = ContactConfiguration::without_spins(&free.w, &q_c.orientation_kept);
            let free_moving = Velocities { w: &free_w, ..free.velocities() };
            q_c.pushed_at_centre.extend(pushed_bodies(scene, q_c, contacts, free_moving));
            continue;
        }
        let pushed = pushed_bodies(scene, q_c, contacts, moving);
        if !pushed.is_empty() {
            q_c.pushed_at_centre.extend(pushed);
            continue;
        }
        let may_drop_restitution = !solution.converged && original_laws.is_none();
        if may_drop_restitution && is_any(rebound_passes(scene, state, q_c, contacts, moving)) {
            original_laws = Some(state.laws.clone());
            state.laws.iter_mut().for_each(ContactLaw::remove_restitution);
            continue;
        }
        solution.sweeps = sweeps;
        return Some(SolvedProblem { request, contact_problem, solution, original_laws });
    }
}

/// Whether bodies with restitution pass through a surface at these velocities of an unfinished solution: a contact closes
/// deeper than the smallest radius.
fn rebound_passes(
    scene: &Scene,
    state: &State,
    q_c: &ContactConfiguration,
    contacts: &[Contact],
    velocities: Velocities,
) -> bool {
    let span = q_c.reach_time(scene);
    let is_passing = |contact: &Contact| approach(q_c, span, contact, velocities) - contact.gap > scene.smallest_radius;
    state.laws.iter().any(ContactLaw::has_restitution) && contacts.iter().any(is_passing)
}
