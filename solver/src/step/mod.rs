//! One time step as the list of its stages; the equations are numbered as in `docs/explanation/method/`.

mod context;
mod drift;
mod ends;
mod ledger;
mod motion;
mod turning;
mod unforeseen;

use std::time::{Duration, Instant};

pub use self::ends::{OVERLAP_WARNING_SHARE, Overlap, deeper_overlap};
pub use self::ledger::{BalanceErrors, MotionTotals, StepReport, StepStart, WorstContact};

use self::context::{SolvedProblem, StepContext};
use self::ends::finish_contacts;
use self::ledger::update_ledger;
use self::motion::refine_until_decided;
use crate::activity::{self, StepStage};
use crate::assemble;
use crate::detect::{self, NarrowPhaseError};
use crate::integrate::{self, ContactConfiguration};
use crate::laws::ContactLaw;
use crate::math::Vec3;
use crate::math::simd::SimdWidth;
use crate::scene::{RigidBody, Scene};
use crate::solve::{self, SolveRequest, StoppingCriteria};
use crate::state::{BondingMode, Contact, State, StateBackup, Velocities};

/// Time spent in each stage.
#[derive(Debug, Clone, Copy, Default)]
pub struct StageTimes {
    pub gravity: Duration,
    pub detection: Duration,
    pub assembly: Duration,
    pub solve: Duration,
    pub integration: Duration,
    pub writing: Duration,
}

impl StageTimes {
    pub fn accumulate(&mut self, lap: &StageTimes) {
        self.gravity += lap.gravity;
        self.detection += lap.detection;
        self.assembly += lap.assembly;
        self.solve += lap.solve;
        self.integration += lap.integration;
        self.writing += lap.writing;
    }
}

/// Advances the state by one step. Returns `None`, with the state unchanged, if the program was requested to stop within it.
pub fn step(scene: &Scene, state: &mut State, clock: &mut StageTimes) -> Option<StepReport> {
    let lap = &mut Stopwatch::start();
    let before = StateBackup::new(scene, state);
    activity::begin_stage(StepStage::Forces, 0);
    let happened = assemble::apply_events(scene, state);
    let units = integrate::choose_step_multiple(scene, state, happened.any_event);
    assemble::apply_torque_and_damping(scene, state, units);
    let anew = unforeseen::velocities_are_unbounded(scene, state, &happened);
    let mut q_c = contact_configuration(scene, state, units, anew); // M1  x_c = x + (1-θ) h V
    lap.add_lap(&mut clock.integration);
    let mut free = assemble::free_velocity(scene, state, &q_c, &happened.shakes); // M2  V_free = V + h M⁻¹ F(x_c)
    state.attraction = free.attraction.take();
    lap.add_lap(&mut clock.gravity);
    activity::begin_stage(StepStage::Detection, 0);
    let mut contacts = detect::listed_contacts(scene, &q_c, free.velocities(), &mut state.detection_cache); // M3  g, (n, t, s)
    let missed = sample_narrow_phase_error(scene, state, &q_c, free.velocities(), &contacts);
    lap.add_lap(&mut clock.detection);
    let task = solve_request(scene, state, &q_c, &contacts, free.velocities());
    let (mut sweeps, mut with_rebound) = (0, None);
    let mut solved = loop {
        let system = assemble::contact_problem(scene, state, &q_c, &contacts, free.velocities()); // M4  W, b
        lap.add_lap(&mut clock.assembly);
        activity::begin_stage(StepStage::Solve, contacts.len());
        let solution = solve::solve_contact_problem(&system, task, |s| assemble::stored_problem(s, &contacts)); // M5  r
        sweeps += solution.sweeps;
        lap.add_lap(&mut clock.solve);
        // Bodies pushed by contacts may close pairs that were open before: the problem is solved again with these.
        let (v, w) = ends::solved_velocities(&solution, &free);
        let pushed = Velocities { v: &v, w: &w };
        let late = detect::late_contacts(scene, &q_c, free.velocities(), pushed, &contacts);
        lap.add_lap(&mut clock.detection);
        if activity::is_stopped() {
            before.restore_to(state);
            return None;
        }
        if late.is_empty() {
            let turned = turning::turned_through(scene, &q_c, &contacts, free.velocities(), pushed);
            if !turned.is_empty() {
                q_c.unturned.extend(turned);
                continue;
            }
            if solution.converged || with_rebound.is_some() || !rebound_passes(scene, state, &q_c, &contacts, pushed) {
                break SolvedProblem { system, solution };
            }
            // A rebound that ends beyond another surface has no solution.
            with_rebound = Some(state.laws.clone());
            state.laws.iter_mut().for_each(ContactLaw::remove_restitution);
            continue;
        }
        contacts.extend(late);
        contacts.sort_unstable_by_key(Contact::key);
    };
    solved.solution.sweeps = sweeps;
    let context = StepContext { scene, q_c: &q_c, free: &free, contacts: &contacts };
    let motion = refine_until_decided(context, &state.laws, task, &mut solved);
    solve::update_backoff(&mut state.fallback, task, state.step, units, &solved.solution);
    lap.add_lap(&mut clock.solve);
    let outcome = finish_contacts(context, state, &solved, motion.as_ref());
    let given_up = task.skips_fallback() && !solved.solution.converged;
    let mut report = StepReport {
        tol: task.criteria.tol,
        narrow_phase_error: missed,
        fallback_suppressed: given_up,
        ..update_ledger(context, state, &solved, &outcome)
    };
    if !happened.shakes.is_empty() {
        report.flight_error = 0.0; // a shake is an impulse, and exact
    }
    if let Some(laws) = with_rebound {
        state.laws = laws;
    }
    integrate::advance_state(scene, state, &q_c, outcome.v, outcome.w); // M6  V⁺, x⁺ = x_c + θ h V⁺
    (state.contacts, state.order) = (outcome.contacts, q_c.order);
    state.memories = ends::end_memories(&mut solved);
    drift::close_bonds(scene, state, &solved.system);
    state.bonding = BondingMode::No;
    lap.add_lap(&mut clock.integration);
    Some(report)
}

/// Configuration in which contacts are detected, in a step of `units` times `dt`. `anew`: velocities are not bounded by a
/// step.
fn contact_configuration(scene: &Scene, state: &State, units: u64, anew: bool) -> ContactConfiguration {
    let from_start = unforeseen::select_implicit_bodies(scene, state, units, anew);
    let q_c = match from_start.is_empty() {
        true => integrate::predict_configuration(scene, state, units),
        false => integrate::predict_from_start(scene, state, units, from_start),
    };
    ContactConfiguration { changed: anew, ..q_c }
}

/// Contacts that the fast narrow phase missed, in the steps in which this is checked.
fn sample_narrow_phase_error(
    scene: &Scene,
    state: &State,
    q_c: &ContactConfiguration,
    free: Velocities,
    contacts: &[Contact],
) -> Option<NarrowPhaseError> {
    let looks = scene.narrow_phase_is_fast() && state.is_diagnostic_step(q_c.step_multiple);
    looks.then(|| detect::narrow_phase_error(scene, q_c, free, &state.detection_cache, contacts))
}

/// Largest residual with which no pair passes another: velocities are wrong by at most the residual times the largest velocity
/// at which a contact closes, and over the step this may be a small share of the radius. Infinite if any residual will do,
/// as in steps in which bodies move by less than their radius.
///
/// `free`: velocities after the step if nothing touched.
fn travel_tolerance(scene: &Scene, q_c: &ContactConfiguration, contacts: &[Contact], free: Velocities) -> f64 {
    let span = q_c.longest_reach_time(scene);
    let allowed = MAX_TRAVEL_ERROR * scene.smallest_radius;
    // Without fast bodies no contact is evaluated.
    let speed = |((body, v), w): ((&RigidBody, &Vec3), &Vec3)| (v - q_c.mean_velocity).norm() + w.norm() * body.radius;
    let fastest = scene.bodies.iter().zip(free.v).zip(free.w).map(speed).fold(0.0, f64::max);
    if 2.0 * span * fastest * scene.options.tol() <= allowed {
        return f64::INFINITY;
    }
    // Contacts that cannot close depend on the alert distance and must not change a result.
    let approaches = contacts.iter().map(|contact| (approach(q_c, span, contact, free), contact.gap));
    allowed / approaches.filter(|(way, gap)| way > gap).map(|(way, _)| way).fold(0.0, f64::max)
}

/// Displacement in the time `span` (s) by which these velocities close a contact, m.
fn approach(q_c: &ContactConfiguration, span: f64, contact: &Contact, velocities: Velocities) -> f64 {
    -span * contact.normal.dot(&assemble::relative_velocity(contact, &q_c.x, velocities))
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
    let span = q_c.longest_reach_time(scene);
    let passes = |contact: &Contact| approach(q_c, span, contact, velocities) - contact.gap > scene.smallest_radius;
    state.laws.iter().any(ContactLaw::has_restitution) && contacts.iter().any(passes)
}

/// Largest error of a displacement by unfinished solutions, over the smallest radius. The residual is a mean over contacts: a
/// single one may err by several times as much.
const MAX_TRAVEL_ERROR: f64 = 0.01;

fn solve_request(
    scene: &Scene,
    state: &State,
    q_c: &ContactConfiguration,
    contacts: &[Contact],
    free: Velocities,
) -> SolveRequest {
    let (options, units) = (&scene.options, q_c.step_multiple);
    let tol = options.tol().min(travel_tolerance(scene, q_c, contacts, free));
    // Errors of a restitution impulse are not corrected by later steps.
    let shock = if state.laws.iter().any(ContactLaw::has_restitution) { MIN_TOLERANCE_FACTOR } else { 1.0 };
    // Errors in breaking bonds or starting to slide are not corrected either.
    let lost = if state.laws.iter().any(ContactLaw::has_irreversible_loss) {
        LOSS_TOLERANCE_FACTOR.min(MAX_LOSS_RESIDUAL / tol)
    } else {
        1.0
    };
    // Velocity errors scale with the residual times the velocity change of the step, which grows with its length.
    let long = 1.0 / units as f64;
    let aim =
        tol * shock.min(lost).min(tolerance_factor(options.penetration_tol(), state.ledger.penetration_left)).min(long);
    let (check_every, precision) = (options.check_every, options.sweep_precision);
    // One sweep for each `dt`; LMGC90's blocks have a set number of sweeps.
    let least_sweeps = if check_every.is_some() { 0 } else { units };
    let until = StoppingCriteria {
        target_residual: aim,
        min_sweeps: least_sweeps,
        check_every,
        precision,
        ..StoppingCriteria::new(tol, options.max_sweeps())
    };
    SolveRequest {
        solver: options.solver,
        criteria: until,
        width: SimdWidth::detect(),
        fallback_suppressed: state.step < state.fallback.due,
    }
}

/// Smallest factor on the residual sought, reached as overlap accumulates.
const MIN_TOLERANCE_FACTOR: f64 = 1e-2;

/// Factor on the residual sought where contacts have irreversible losses.
const LOSS_TOLERANCE_FACTOR: f64 = 0.1;

/// Largest residual with which irreversible losses are decided: a load of 0.9 or 1.1 of a limit is then on its side of it.
const MAX_LOSS_RESIDUAL: f64 = 1e-3;

/// Factor on `tol` for the residual sought, <= 1.
///
/// The approach velocity that a residual leaves becomes overlap, which laws keep. Where loaded grains move slowly for a long
/// time it accumulates, and a smaller residual is needed.
fn tolerance_factor(penetration_tol: f64, left: f64) -> f64 {
    let factor = penetration_tol / left.max(penetration_tol);
    (factor * factor).max(MIN_TOLERANCE_FACTOR)
}

/// Number of `dt` in the next step, and the contact problem of that step, written out.
pub fn next_problem(scene: &Scene, state: &State) -> (u64, assemble::StoredProblem) {
    let mut state = state.clone();
    let happened = assemble::apply_events(scene, &mut state);
    let units = integrate::choose_step_multiple(scene, &state, happened.any_event);
    assemble::apply_torque_and_damping(scene, &mut state, units);
    let q_c =
        contact_configuration(scene, &state, units, unforeseen::velocities_are_unbounded(scene, &state, &happened));
    let free = assemble::free_velocity(scene, &state, &q_c, &happened.shakes);
    let contacts = detect::listed_contacts(scene, &q_c, free.velocities(), &mut state.detection_cache);
    let system = assemble::contact_problem(scene, &state, &q_c, &contacts, free.velocities());
    (units, assemble::stored_problem(&system, &contacts))
}

/// Stopwatch over consecutive intervals.
struct Stopwatch(Instant);

impl Stopwatch {
    fn start() -> Self {
        Stopwatch(Instant::now())
    }

    fn add_lap(&mut self, total: &mut Duration) {
        let now = Instant::now();
        *total += now - self.0;
        self.0 = now;
    }
}
