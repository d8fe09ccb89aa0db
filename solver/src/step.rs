//! One time step as the list of its rooms; the equations are numbered as in `docs/method.md`.

use std::ops::Add;
use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::assemble::{self, Free, GravityReport, Record, Row, System, relative_velocity};
use crate::detect::{self, Missed};
use crate::integrate::{self, Configuration};
use crate::laws::Law;
use crate::math::lanes::Width;
use crate::math::{MANY, Quat, Vec3, to_local, to_world};
use crate::scene::Scene;
use crate::solve::norms::{Norms, norms};
use crate::solve::{self, Solution, Task, Until};
use crate::state::{Bonding, Contact, Exchange, Interval, SolvedContact, State, Status};

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

/// What a step did, for the log.
#[derive(Debug, Clone, PartialEq)]
pub struct StepReport {
    /// Length of the step, s.
    pub h: f64,
    pub contacts_listed: usize,
    pub contacts_solved: usize,
    /// Contacts that carry force.
    pub contacts_active: usize,
    pub sweeps: u64,
    /// Whether they began in single precision.
    pub single: bool,
    pub residual: f64,
    pub converged: bool,
    /// Whether a solver of stored problems found the solution where the sweeps had stalled.
    pub taken_over: bool,
    /// Whether `auto` left it unconverged after one round of sweeps, as more was in vain before.
    pub given_up: bool,
    /// Why sweeps took the place of the solver that was asked for.
    pub replaced: Option<&'static str>,
    /// LMGC90's criteria, if asked for.
    pub norms: Option<Norms>,
    /// The contact with the largest part in the residual.
    pub worst: Option<WorstContact>,
    /// Largest penetration in the contact configuration, and the sum of all over `contacts_active`, m.
    pub penetration_largest: f64,
    pub penetration_mean: f64,
    /// What the fast narrow phase missed, where it was looked at.
    pub missed: Option<Missed>,
    /// Σ f·l, forces and branches of the contacts: pressure times three volumes, J.
    pub virial: f64,
    /// Σ ¼ m |h a|² over the bodies on which no contact acts, a the acceleration beyond uniform gravity: what a step that
    /// takes it as constant errs by in their kinetic energy, J.
    pub flight: f64,
    /// Translation and rotation of the free bodies at the step's end, J.
    pub kinetic: f64,
    pub rotational: f64,
    /// In the contact configuration, J.
    pub potential: f64,
    pub gravity: GravityReport,
    /// |momentum - expected| over the largest sum of m |v| so far.
    pub momentum_drift: f64,
}

/// A contact by its two bodies and its place in the contact configuration, m: polyhedra share several.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorstContact {
    pub bodies: [u32; 2],
    pub point: Vec3,
}

/// Advances the state by one step.
pub fn step(scene: &Scene, state: &mut State, clock: &mut Clock) -> StepReport {
    let lap = &mut Lap::start();
    let happened = assemble::events(scene, state);
    let units = integrate::units(scene, state, happened.any);
    assemble::interventions(scene, state, units);
    let q_c = integrate::predict(scene, state, units); // M1  x_c = x + (1-θ) h V
    lap.stop(&mut clock.integration);
    let mut free = assemble::free_velocity(scene, state, &q_c, &happened.shakes); // M2  V_free = V + h M⁻¹ F(x_c)
    state.attraction = free.attraction.take();
    lap.stop(&mut clock.gravity);
    let contacts = detect::contacts(scene, &q_c, &free.v, &mut state.known); // M3  g, (n, t, s)
    let missed = looked_at(scene, state, &q_c, &free.v, &contacts);
    lap.stop(&mut clock.detection);
    let system = assemble::contact_problem(scene, state, &q_c, &contacts, &free.v, &free.w); // M4  W, b
    lap.stop(&mut clock.assembly);
    let task = task(scene, state, units);
    let solution = solve::contact_problem(&system, task, |s| assemble::stored_problem(s, &contacts)); // M5  r
    solve::learn(&mut state.fallback, task, state.step, units, &solution);
    lap.stop(&mut clock.solve);
    let solved = end_of_contacts(scene, state, &q_c, &contacts, &free, &system, &solution);
    let given_up = task.gives_up() && !solution.converged;
    let mut report = StepReport { missed, given_up, ..book(scene, state, &q_c, &free, &system, &solution, &solved) };
    if !happened.shakes.is_empty() {
        report.flight = 0.0; // what shakes is an impulse, and exact
    }
    integrate::advance(scene, state, &q_c, solved.v, solved.w); // M6  V⁺, x⁺ = x_c + θ h V⁺
    (state.contacts, state.order) = (solved.contacts, q_c.order);
    state.bonding = Bonding::No;
    lap.stop(&mut clock.integration);
    report
}

/// What the fast narrow phase has missed of the contacts, in the steps in which that is looked at.
fn looked_at(
    scene: &Scene,
    state: &State,
    q_c: &Configuration,
    v_free: &[Vec3],
    contacts: &[Contact],
) -> Option<Missed> {
    let looks = scene.narrow_phase_is_fast() && state.looks(q_c.units);
    looks.then(|| detect::missed(scene, q_c, v_free, &state.known, contacts))
}

fn task(scene: &Scene, state: &State, units: u64) -> Task {
    let options = &scene.options;
    let tol = options.tol();
    // No later step makes good what a shock has given or taken.
    let shock = if state.laws.iter().any(Law::rebounds) { SHARPEST } else { 1.0 };
    // What a residual leaves in velocities goes with what the step would change them by alone, and that with its length.
    let long = 1.0 / units as f64;
    let aim = tol * shock.min(sharpening(options.penetration_tol(), state.ledger.penetration_left)).min(long);
    let (check_every, precision) = (options.check_every, options.sweep_precision);
    let until = Until { aim, check_every, precision, ..Until::new(tol, options.max_sweeps()) };
    Task { solver: options.solver, until, width: Width::detect(), spared: state.step < state.fallback.due }
}

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
    let q_c = integrate::predict(scene, &state, units);
    let free = assemble::free_velocity(scene, &state, &q_c, &happened.shakes);
    let contacts = detect::contacts(scene, &q_c, &free.v, &mut state.known);
    let system = assemble::contact_problem(scene, &state, &q_c, &contacts, &free.v, &free.w);
    (units, assemble::stored_problem(&system, &contacts))
}

/// Velocities and contacts at the step's end, and what contacts have done.
struct Solved {
    v: Vec<Vec3>,
    w: Vec<Vec3>,
    contacts: Vec<SolvedContact>,
    given: Given,
    exchanges: Vec<Vec<Exchange>>,
}

/// Takes the place that the contacts of the last step have in memory.
fn end_of_contacts(
    scene: &Scene,
    state: &mut State,
    q_c: &Configuration,
    contacts: &[Contact],
    free: &Free,
    system: &System,
    solution: &Solution,
) -> Solved {
    // What is imposed stays as it was.
    let motion = |((record, v), w): ((&Record, &Vec3), &Vec3)| {
        if record.inverse_mass > 0.0 { (record.v, record.w) } else { (*v, *w) }
    };
    let bodies = solution.records.par_iter().zip(&free.v).zip(&free.w);
    let (v, w): (Vec<Vec3>, Vec<Vec3>) = bodies.with_min_len(MANY).map(motion).unzip();
    let mut ends = std::mem::take(&mut state.contacts);
    ends.resize(contacts.len(), SolvedContact::default());
    let driven: Vec<bool> = scene.bodies.iter().map(|body| body.driven).collect();
    let end = End { scene, state, q_c, system, solution, v: &v, w: &w, driven: &driven };
    // In parts that the number of rows alone decides.
    let parts = ends.par_chunks_mut(PART).zip(contacts.par_chunks(PART)).enumerate();
    let parts: Vec<(Given, Vec<Exchange>)> =
        parts.map(|(part, (ends, contacts))| end.of_some(part * PART, contacts, ends)).collect();
    let given = parts.iter().fold(Given::default(), |sum, (given, _)| sum + *given);
    let exchanges = parts.into_iter().map(|(_, exchanges)| exchanges).collect();
    Solved { v, w, contacts: ends, given, exchanges }
}

/// What the ends of contacts are made from.
struct End<'a> {
    scene: &'a Scene,
    state: &'a State,
    q_c: &'a Configuration,
    system: &'a System,
    solution: &'a Solution,
    /// At the step's end, m/s and rad/s.
    v: &'a [Vec3],
    w: &'a [Vec3],
    /// Of each body; together, as contacts ask for it in any order.
    driven: &'a [bool],
}

impl End<'_> {
    /// Fills `ends` with those of contacts of which the first has the number `first`; what they do in the step.
    fn of_some(&self, first: usize, contacts: &[Contact], ends: &mut [SolvedContact]) -> (Given, Vec<Exchange>) {
        let End { q_c, system, solution, .. } = self;
        let (mut given, mut exchanges) = (Given::default(), Vec::with_capacity(contacts.len()));
        let roll = system.rolls.partition_point(|roll| (roll.row as usize) < first);
        let mut rolls = system.rolls[roll..].iter().zip(&solution.moments[roll..]).peekable();
        for ((k, contact), end) in (first..).zip(contacts).zip(ends) {
            let (row, r) = (&system.rows[k], &solution.impulses[k]);
            let moment = rolls.next_if(|(roll, _)| roll.row as usize == k).map(|(_, m)| m);
            *end = self.of_one(k, contact, moment);
            let depth = (-contact.gap).max(0.0);
            given.penetration_largest = given.penetration_largest.max(depth);
            given.penetration_sum += depth;
            if end.impulse != Vec3::zeros() {
                given.contacts_active += 1;
                let may_close = self.state.laws[contact.law as usize].closing(row.u_before.x);
                given.penetration_added += (-contact.gap - q_c.h * (end.velocity.x + may_close) - depth).max(0.0);
                let virial = self.gives(row, r, end, &mut given);
                given.virial += virial;
                exchanges.push(Exchange { bodies: row.bodies, virial });
            }
        }
        (given, exchanges)
    }

    /// Contact `k`, on which a moment (N m s, world frame) acts that resists rolling, if there is one.
    fn of_one(&self, k: usize, contact: &Contact, moment: Option<&Vec3>) -> SolvedContact {
        let &End { scene, state, q_c, system, solution, v, w, .. } = self;
        let (row, r) = (&system.rows[k], &solution.impulses[k]);
        let frame = contact.frame();
        let local = to_local(&frame, r);
        // On the cone's side to rounding.
        let bound = row.friction * local.x * (1.0 - 1e-12);
        let status = match local.x > 0.0 {
            false => Status::NoContact,
            true if local.yz().norm() >= bound => Status::Slide,
            true => Status::Stick,
        };
        let law = &state.laws[contact.law as usize];
        // Points of one face share its load as sweeps happen to find it: one that gives its all where nothing moves holds.
        let moved = || {
            let u = system.velocity(k, &solution.records);
            let opening = row.normal.dot(&u);
            let still = scene.options.tol() * row.w_n * row.impulse_shift.abs();
            (opening > still, (u - row.normal * opening).norm() > still)
        };
        let bond = row.bond.filter(|_| {
            let (opens, slides) = moved();
            law.keeps_bond(contact.gap, status == Status::NoContact && opens, status == Status::Slide && slides)
        });
        SolvedContact {
            contact: *contact,
            impulse: Vec3::new(local.x + row.impulse_shift, local.y, local.z),
            moment: moment.map_or(Vec3::zeros(), |m| to_local(&frame, m)),
            velocity: to_local(&frame, &relative_velocity(contact, &q_c.x, v, w)),
            status,
            bond,
        }
    }

    /// Adds what one contact with the impulse `r` of its row does; returns its impulse times its branch, N m s.
    fn gives(&self, row: &Row, r: &Vec3, contact: &SolvedContact, given: &mut Given) -> f64 {
        let &End { state, q_c, v, w, driven, .. } = self;
        let SolvedContact { contact, impulse, moment, velocity, .. } = contact;
        let mean = 0.5 * (velocity + row.u_before);
        let (candidate, antagonist) = (contact.candidate as usize, contact.antagonist as usize);
        let force = r + contact.normal * row.impulse_shift;
        let arms = assemble::arms(contact, &q_c.x);
        let turned = |body: usize| w[body] + q_c.w[body];
        let rolls = *moment != Vec3::zeros();
        let moment = if rolls { to_world(&contact.frame(), moment) } else { Vec3::zeros() };
        let turning_work = if rolls { 0.5 * moment.dot(&(turned(candidate) - turned(antagonist))) } else { 0.0 };
        // A wall's centre has no meaning for the stress of the grains: there the branch ends at the point.
        let to_point = |body: usize, arm: Vec3| if driven[body] { Vec3::zeros() } else { arm };
        let branch = to_point(antagonist, arms[1]) - to_point(candidate, arms[0]);
        given.contact_work += impulse.dot(&mean) + turning_work;
        given.friction_work += impulse.y * mean.y + impulse.z * mean.z + turning_work;
        if !driven[antagonist] {
            // What it takes acts at its own place, not at that of the image.
            given.angular_momentum += contact.image.cross(&force);
        }
        let sides = [(candidate, 1.0), (antagonist, -1.0)].into_iter().zip(arms);
        for ((body, sign), arm) in sides.filter(|((body, _), _)| driven[*body]) {
            // What a driven body gives the free one: minus the impulse that it takes itself.
            let force = force * -sign;
            let moved = (v[body] + state.v[body]) + turned(body).cross(&arm);
            given.outside_work += 0.5 * (force.dot(&moved) - sign * moment.dot(&turned(body)));
            given.momentum += force;
            given.angular_momentum += contact.point.cross(&force) - moment * sign;
        }
        force.dot(&branch)
    }
}

/// Enters the step in the ledger and reports it; to be called before the state advances.
fn book(
    scene: &Scene,
    state: &mut State,
    q_c: &Configuration,
    free: &Free,
    system: &System,
    solution: &Solution,
    solved: &Solved,
) -> StepReport {
    let h = q_c.h;
    let given = &solved.given;
    if state.step.is_multiple_of(scene.options.output_every) {
        state.interval = Interval { start: state.time, ..Interval::default() };
    }
    state.interval.add(solved.exchanges.iter().flatten());
    let ledger = &mut state.ledger;
    ledger.contact_work += given.contact_work;
    ledger.friction_work += given.friction_work;
    ledger.outside_work += given.outside_work;
    for (i, force, moment) in &free.loads {
        ledger.outside_work +=
            0.5 * h * (force.dot(&(solved.v[*i] + state.v[*i])) + moment.dot(&(solved.w[*i] + q_c.w[*i])));
    }
    for k in 0..3 {
        ledger.momentum_expected[k] += free.impulse[k] + given.momentum[k];
        ledger.angular_momentum_expected[k] += free.angular_impulse[k] + given.angular_momentum[k];
    }

    let flight = |&i: &u32| {
        let (i, mass) = (i as usize, scene.bodies[i as usize].mass);
        let flies = solved.v[i] == free.v[i];
        if flies { 0.25 * mass * (free.v[i] - state.v[i] - state.gravity * h).norm_squared() } else { 0.0 }
    };
    let flights: Vec<f64> = scene.free.par_iter().with_min_len(MANY).map(flight).collect();
    // What rests from the start has no momentum but that which forces give in a step and contacts take.
    let pushed = |&i: &u32| scene.bodies[i as usize].mass * (free.v[i as usize] - state.v[i as usize]).norm();
    let pushed: Vec<f64> = scene.free.par_iter().with_min_len(MANY).map(pushed).collect();
    let motion = Motion::of(scene, &q_c.q, &solved.v, &solved.w);
    ledger.momentum_scale = ledger.momentum_scale.max(motion.scale).max(pushed.iter().sum());
    let drift = (motion.momentum - Vec3::from(ledger.momentum_expected)).norm();
    ledger.penetration_largest = ledger.penetration_largest.max(given.penetration_largest / scene.mean_radius);
    let active = given.contacts_active.max(1) as f64;
    let mean = |sum: f64| sum / active / scene.mean_radius.max(f64::MIN_POSITIVE); // there may be no grains
    // Of what there is now, at the most.
    ledger.penetration_left = ledger.penetration_left.min(mean(given.penetration_sum)) + mean(given.penetration_added);
    ledger.sweeps += solution.sweeps;
    if !solution.converged {
        ledger.steps_unconverged += 1;
        ledger.last_unconverged = Some(state.step + 1);
    }
    let worst = |row: u32| {
        let (bodies, solved) = (system.rows[row as usize].bodies, &solved.contacts[row as usize]);
        WorstContact { bodies, point: solved.contact.point }
    };
    StepReport {
        h,
        contacts_listed: solved.contacts.len(),
        contacts_solved: solution.active,
        contacts_active: given.contacts_active,
        sweeps: solution.sweeps,
        single: solution.single,
        residual: solution.residual,
        converged: solution.converged,
        taken_over: solution.taken_over,
        replaced: solution.replaced,
        norms: scene.options.lmgc90_norms.then(|| norms(system, &solution.impulses, &solution.records)),
        worst: solution.worst.map(worst),
        penetration_largest: given.penetration_largest,
        penetration_mean: given.penetration_sum / active,
        missed: None,
        given_up: false,
        virial: given.virial / h,
        flight: flights.iter().sum(),
        kinetic: motion.kinetic,
        rotational: motion.rotational,
        potential: free.potential,
        gravity: free.gravity,
        momentum_drift: if ledger.momentum_scale > 0.0 { drift / ledger.momentum_scale } else { 0.0 },
    }
}

/// The most by which added overlap makes the residual sought smaller.
const SHARPEST: f64 = 1e-2;

/// Rows, contacts or bodies that one task adds up.
const PART: usize = 1024;

/// What contacts do in a step.
#[derive(Debug, Clone, Copy, Default)]
struct Given {
    contacts_active: usize,
    /// m, of the listed contacts.
    penetration_largest: f64,
    penetration_sum: f64,
    /// By which contacts that carry force overlap more at the end: nothing, had the problem been solved exactly.
    penetration_added: f64,
    /// J
    contact_work: f64,
    friction_work: f64,
    /// Of impulses and branches, N m s.
    virial: f64,
    /// Of driven bodies on free ones: work, impulse and its moment about the origin.
    outside_work: f64,
    momentum: Vec3,
    angular_momentum: Vec3,
}

impl Add for Given {
    type Output = Given;

    fn add(self, other: Given) -> Given {
        Given {
            contacts_active: self.contacts_active + other.contacts_active,
            penetration_largest: self.penetration_largest.max(other.penetration_largest),
            penetration_sum: self.penetration_sum + other.penetration_sum,
            penetration_added: self.penetration_added + other.penetration_added,
            contact_work: self.contact_work + other.contact_work,
            friction_work: self.friction_work + other.friction_work,
            virial: self.virial + other.virial,
            outside_work: self.outside_work + other.outside_work,
            momentum: self.momentum + other.momentum,
            angular_momentum: self.angular_momentum + other.angular_momentum,
        }
    }
}

/// Sums over the free bodies.
#[derive(Debug, Clone, Copy, Default)]
pub struct Motion {
    /// kg m/s
    pub momentum: Vec3,
    /// Sum of m |v|, kg m/s.
    pub scale: f64,
    /// J
    pub kinetic: f64,
    pub rotational: f64,
}

impl Motion {
    pub fn of(scene: &Scene, q: &[Quat], v: &[Vec3], w: &[Vec3]) -> Self {
        let of_some = |bodies: &[u32]| {
            bodies.iter().map(|&i| i as usize).fold(Motion::default(), |sum, i| {
                let body = &scene.bodies[i];
                sum + Motion {
                    momentum: v[i] * body.mass,
                    scale: v[i].norm() * body.mass,
                    kinetic: 0.5 * body.mass * v[i].norm_squared(),
                    rotational: 0.5 * body.angular_momentum(&q[i], &w[i]).dot(&w[i]),
                }
            })
        };
        let parts: Vec<Motion> = scene.free.par_chunks(PART).map(of_some).collect();
        parts.into_iter().fold(Motion::default(), Motion::add)
    }

    /// Angular momentum of the free bodies about the origin, kg m^2/s.
    pub fn angular(scene: &Scene, state: &State) -> Vec3 {
        let of = |&i: &u32| {
            let (i, body) = (i as usize, &scene.bodies[i as usize]);
            state.x[i].cross(&state.v[i]) * body.mass + body.angular_momentum(&state.q[i], &state.w[i])
        };
        scene.free.iter().map(of).sum()
    }
}

impl Add for Motion {
    type Output = Motion;

    fn add(self, other: Motion) -> Motion {
        Motion {
            momentum: self.momentum + other.momentum,
            scale: self.scale + other.scale,
            kinetic: self.kinetic + other.kinetic,
            rotational: self.rotational + other.rotational,
        }
    }
}

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
