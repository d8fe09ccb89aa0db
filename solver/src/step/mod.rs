//! One time step as the list of its rooms; the equations are numbered as in `docs/method.md`.

mod drift;
mod ends;
mod ledger;
mod motion;
mod unforeseen;

use std::time::{Duration, Instant};

pub use self::ends::{DEEP, Overlap, deeper};
pub use self::ledger::{Motion, StepReport, WorstContact};

use self::ends::end_of_contacts;
use self::ledger::book;
use self::motion::decided;
use crate::activity::{self, Stage};
use crate::assemble;
use crate::detect::{self, Missed};
use crate::integrate::{self, Configuration};
use crate::laws::Law;
use crate::math::Vec3;
use crate::math::lanes::Width;
use crate::scene::Scene;
use crate::solve::{self, Task, Until};
use crate::state::{Before, Bonding, Contact, State};

/// Time spent in each room.
#[derive(Debug, Clone, Copy, Default)]
pub struct Clock {
    pub gravity: Duration,
    pub detection: Duration,
    pub assembly: Duration,
    pub solve: Duration,
    pub integration: Duration,
    pub writing: Duration,
}

impl Clock {
    pub fn add(&mut self, lap: &Clock) {
        self.gravity += lap.gravity;
        self.detection += lap.detection;
        self.assembly += lap.assembly;
        self.solve += lap.solve;
        self.integration += lap.integration;
        self.writing += lap.writing;
    }
}

/// Advances the state by one step; none if the program was requested to stop within it, and the state is as it was.
pub fn step(scene: &Scene, state: &mut State, clock: &mut Clock) -> Option<StepReport> {
    let lap = &mut Lap::start();
    let before = Before::of(scene, state);
    activity::enter(Stage::Forces, 0);
    let happened = assemble::events(scene, state);
    let units = integrate::units(scene, state, happened.any);
    assemble::interventions(scene, state, units);
    let anew = unforeseen::begins_anew(scene, state, &happened);
    let q_c = contact_configuration(scene, state, units, anew); // M1  x_c = x + (1-θ) h V
    lap.stop(&mut clock.integration);
    let mut free = assemble::free_velocity(scene, state, &q_c, &happened.shakes); // M2  V_free = V + h M⁻¹ F(x_c)
    state.attraction = free.attraction.take();
    lap.stop(&mut clock.gravity);
    activity::enter(Stage::Detection, 0);
    let mut contacts = detect::contacts(scene, &q_c, [&free.v, &free.w], &mut state.known); // M3  g, (n, t, s)
    let missed = looked_at(scene, state, &q_c, [&free.v, &free.w], &contacts);
    lap.stop(&mut clock.detection);
    let task = task(scene, state, units);
    let mut sweeps = 0;
    let (mut system, mut solution) = loop {
        let system = assemble::contact_problem(scene, state, &q_c, &contacts, &free.v, &free.w); // M4  W, b
        lap.stop(&mut clock.assembly);
        activity::enter(Stage::Solve, contacts.len());
        let solution = solve::contact_problem(&system, task, |s| assemble::stored_problem(s, &contacts)); // M5  r
        sweeps += solution.sweeps;
        lap.stop(&mut clock.solve);
        // What contacts have pushed may close pairs that nothing closed before: again with these.
        let (v, w) = ends::velocities(&solution, &free);
        let late = detect::late(scene, &q_c, [&free.v, &free.w], [&v, &w], &contacts);
        lap.stop(&mut clock.detection);
        if activity::is_stopped() {
            before.put_back(state);
            return None;
        }
        if late.is_empty() {
            break (system, solution);
        }
        contacts.extend(late);
        contacts.sort_unstable_by_key(Contact::key);
    };
    solution.sweeps = sweeps;
    let motion = decided(scene, &state.laws, &contacts, q_c.h, &mut system, task, &mut solution);
    solve::learn(&mut state.fallback, task, state.step, units, &solution);
    lap.stop(&mut clock.solve);
    let solved = end_of_contacts(scene, state, &q_c, &contacts, &free, &system, &solution, motion.as_ref());
    let given_up = task.gives_up() && !solution.converged;
    let mut report = StepReport { missed, given_up, ..book(scene, state, &q_c, &free, &system, &solution, &solved) };
    if !happened.shakes.is_empty() {
        report.flight = 0.0; // what shakes is an impulse, and exact
    }
    integrate::advance(scene, state, &q_c, solved.v, solved.w); // M6  V⁺, x⁺ = x_c + θ h V⁺
    (state.contacts, state.order) = (solved.contacts, q_c.order);
    drift::close_bonds(scene, state, &system);
    state.bonding = Bonding::No;
    lap.stop(&mut clock.integration);
    Some(report)
}

/// Where contacts are looked for in a step of so many units of `dt`; `anew`: with velocities that no step has bounded.
fn contact_configuration(scene: &Scene, state: &State, units: u64, anew: bool) -> Configuration {
    let from_start = unforeseen::from_start(scene, state, units, anew);
    let q_c = match from_start.is_empty() {
        true => integrate::predict(scene, state, units),
        false => integrate::predict_from_start(scene, state, units, from_start),
    };
    Configuration { changed: anew, ..q_c }
}

/// What the fast narrow phase has missed of the contacts, in the steps in which that is looked at.
fn looked_at(
    scene: &Scene,
    state: &State,
    q_c: &Configuration,
    free: [&[Vec3]; 2],
    contacts: &[Contact],
) -> Option<Missed> {
    let looks = scene.narrow_phase_is_fast() && state.looks(q_c.units);
    looks.then(|| detect::missed(scene, q_c, free, &state.known, contacts))
}

fn task(scene: &Scene, state: &State, units: u64) -> Task {
    let options = &scene.options;
    let tol = options.tol();
    // No later step makes good what a shock has given or taken.
    let shock = if state.laws.iter().any(Law::rebounds) { SHARPEST } else { 1.0 };
    // Nor what it has broken or set off.
    let lost = if state.laws.iter().any(Law::loses) { SHARPER.min(DECISIVE / tol) } else { 1.0 };
    // What a residual leaves in velocities goes with what the step would change them by alone, and that with its length.
    let long = 1.0 / units as f64;
    let aim = tol * shock.min(lost).min(sharpening(options.penetration_tol(), state.ledger.penetration_left)).min(long);
    let (check_every, precision) = (options.check_every, options.sweep_precision);
    // One for each unit; blocks are as many as they are told to be.
    let least_sweeps = if check_every.is_some() { 0 } else { units };
    let until = Until { aim, least_sweeps, check_every, precision, ..Until::new(tol, options.max_sweeps()) };
    Task { solver: options.solver, until, width: Width::detect(), spared: state.step < state.fallback.due }
}

/// The most by which added overlap makes the residual sought smaller.
const SHARPEST: f64 = 1e-2;

/// By how much it is where contacts can lose something for good.
const SHARPER: f64 = 0.1;

/// The largest residual with which anything is lost for good: a load of 0.9 or 1.1 of a limit is then on its side of it.
const DECISIVE: f64 = 1e-3;

/// By how much a step is to be solved further than `tol`, <= 1.
///
/// What a residual leaves of approach becomes overlap, which laws keep: where loaded grains move slowly for long it adds up,
/// and asks for a smaller residual.
fn sharpening(penetration_tol: f64, left: f64) -> f64 {
    let factor = penetration_tol / left.max(penetration_tol);
    (factor * factor).max(SHARPEST)
}

/// Units of `dt` in the next step, and the contact problem that it would solve, written out.
pub fn next_problem(scene: &Scene, state: &State) -> (u64, assemble::StoredProblem) {
    let mut state = state.clone();
    let happened = assemble::events(scene, &mut state);
    let units = integrate::units(scene, &state, happened.any);
    assemble::interventions(scene, &mut state, units);
    let q_c = contact_configuration(scene, &state, units, unforeseen::begins_anew(scene, &state, &happened));
    let free = assemble::free_velocity(scene, &state, &q_c, &happened.shakes);
    let contacts = detect::contacts(scene, &q_c, [&free.v, &free.w], &mut state.known);
    let system = assemble::contact_problem(scene, &state, &q_c, &contacts, &free.v, &free.w);
    (units, assemble::stored_problem(&system, &contacts))
}

/// Rows, contacts or bodies that one task adds up.
const PART: usize = 1024;

/// A stopwatch over consecutive stretches.
struct Lap(Instant);

impl Lap {
    fn start() -> Self {
        Lap(Instant::now())
    }

    fn stop(&mut self, total: &mut Duration) {
        let now = Instant::now();
        *total += now - self.0;
        self.0 = now;
    }
}
