//! One time step as the list of its rooms; the equations are numbered as in `docs/method.md`.

use std::time::{Duration, Instant};

use crate::assemble::{self, Free, GravityReport, System, relative_velocity};
use crate::detect;
use crate::integrate::{self, Configuration};
use crate::math::lanes::Width;
use crate::math::{Quat, Vec3, to_local};
use crate::scene::Scene;
use crate::solve::norms::{Norms, norms};
use crate::solve::{self, Solution, Task};
use crate::state::{Bonding, Contact, SolvedContact, State, Status};

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
    pub contacts_listed: usize,
    pub contacts_solved: usize,
    /// Contacts that carry force.
    pub contacts_active: usize,
    pub sweeps: u64,
    pub residual: f64,
    pub converged: bool,
    /// Whether a solver of stored problems found the solution where the sweeps had stalled.
    pub taken_over: bool,
    /// LMGC90's criteria, if asked for.
    pub norms: Option<Norms>,
    /// Bodies of the contact with the largest part in the residual.
    pub worst_pair: Option<(u32, u32)>,
    /// Largest penetration in the contact configuration, and the sum of all over `contacts_active`, m.
    pub penetration_largest: f64,
    pub penetration_mean: f64,
    /// Translation and rotation of the free bodies at the step's end, J.
    pub kinetic: f64,
    pub rotational: f64,
    /// In the contact configuration, J.
    pub potential: f64,
    pub gravity: GravityReport,
    /// |momentum - expected| over the largest sum of m |v| so far.
    pub momentum_drift: f64,
}

/// Advances the state by one step.
pub fn step(scene: &Scene, state: &mut State, clock: &mut Clock) -> StepReport {
    let lap = &mut Lap::start();
    assemble::interventions(scene, state);
    let q_c = integrate::predict(scene, state); // M1  x_c = x + (1-θ) h V
    lap.stop(&mut clock.integration);
    let mut free = assemble::free_velocity(scene, state, &q_c); // M2  V_free = V + h M⁻¹ F(x_c)
    state.attraction = free.attraction.take();
    lap.stop(&mut clock.gravity);
    let (contacts, pairs) = detect::contacts(scene, &q_c, &free.v, scene.options.dt, &state.pairs); // M3  g, (n, t, s)
    lap.stop(&mut clock.detection);
    let system = assemble::contact_problem(scene, state, &q_c, &contacts, &free.v, &free.w); // M4  W, b
    lap.stop(&mut clock.assembly);
    let solution = solve::contact_problem(&system, task(scene), |s| assemble::stored_problem(s, &contacts)); // M5  r
    lap.stop(&mut clock.solve);
    let solved = end_of_contacts(scene, &q_c, contacts, &free, &system, &solution);
    let report = book(scene, state, &q_c, &free, &system, &solution, &solved);
    integrate::advance(scene, state, &q_c, solved.v, solved.w); // M6  V⁺, x⁺ = x_c + θ h V⁺
    (state.contacts, state.pairs) = (solved.contacts, pairs);
    state.bonding = Bonding::No;
    lap.stop(&mut clock.integration);
    report
}

fn task(scene: &Scene) -> Task {
    let options = &scene.options;
    Task { solver: options.solver, tol: options.tol, max_sweeps: options.max_sweeps, width: Width::detect() }
}

/// The contact problem that the next step would solve, written out.
pub fn next_problem(scene: &Scene, state: &State) -> assemble::StoredProblem {
    let mut state = state.clone();
    assemble::interventions(scene, &mut state);
    let q_c = integrate::predict(scene, &state);
    let free = assemble::free_velocity(scene, &state, &q_c);
    let (contacts, _) = detect::contacts(scene, &q_c, &free.v, scene.options.dt, &state.pairs);
    let system = assemble::contact_problem(scene, &state, &q_c, &contacts, &free.v, &free.w);
    assemble::stored_problem(&system, &contacts)
}

/// Velocities and contacts at the step's end.
struct Solved {
    v: Vec<Vec3>,
    w: Vec<Vec3>,
    contacts: Vec<SolvedContact>,
}

fn end_of_contacts(
    scene: &Scene,
    q_c: &Configuration,
    contacts: Vec<Contact>,
    free: &Free,
    system: &System,
    solution: &Solution,
) -> Solved {
    let (mut v, mut w) = (free.v.clone(), free.w.clone());
    for &i in &scene.free {
        let record = &solution.records[i as usize];
        (v[i as usize], w[i as usize]) = (record.v, record.w);
    }
    let solved = |contact: Contact| SolvedContact {
        contact,
        impulse: Vec3::zeros(),
        moment: Vec3::zeros(),
        velocity: to_local(&contact.frame, &relative_velocity(&contact, &q_c.x, &v, &w)),
        status: Status::NoContact,
        bond: None,
    };
    let mut contacts: Vec<SolvedContact> = contacts.into_iter().map(solved).collect();
    for (row, r) in system.rows.iter().zip(&solution.impulses) {
        let solved = &mut contacts[row.contact as usize];
        let local = to_local(&solved.contact.frame, r);
        solved.impulse = Vec3::new(local.x + row.impulse_shift, local.y, local.z);
        // On the cone's side to rounding; a frictionless contact that carries force slides.
        let bound = row.friction * local.x * (1.0 - 1e-12);
        solved.status = match local.x > 0.0 {
            false => Status::NoContact,
            true if local.y.hypot(local.z) >= bound => Status::Slide,
            true => Status::Stick,
        };
        let law = &scene.laws[solved.contact.law as usize];
        let (parted, slid) = (solved.status == Status::NoContact, solved.status == Status::Slide);
        solved.bond = row.bond.filter(|_| law.keeps_bond(solved.contact.gap, parted, slid));
    }
    for (roll, m) in system.rolls.iter().zip(&solution.moments) {
        let solved = &mut contacts[system.rows[roll.row as usize].contact as usize];
        solved.moment = to_local(&solved.contact.frame, m);
    }
    Solved { v, w, contacts }
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
    let h = scene.options.dt;
    let mut momentum_in = free.impulse;
    let mut angular_in = free.angular_impulse;
    let ledger = &mut state.ledger;
    for row in &system.rows {
        let SolvedContact { contact, impulse, moment, velocity, .. } = &solved.contacts[row.contact as usize];
        if impulse.x == 0.0 && impulse.y == 0.0 && impulse.z == 0.0 {
            continue;
        }
        let mean = 0.5 * (velocity + row.u_before);
        ledger.contact_work += impulse.dot(&mean);
        ledger.friction_work += impulse.y * mean.y + impulse.z * mean.z;
        let (candidate, antagonist) = (contact.candidate as usize, contact.antagonist as usize);
        let moment = crate::math::to_world(&contact.frame, moment);
        let turned = |body: usize| solved.w[body] + q_c.w[body];
        let turning_work = 0.5 * moment.dot(&(turned(candidate) - turned(antagonist)));
        ledger.contact_work += turning_work;
        ledger.friction_work += turning_work;
        let sides = [(candidate, 1.0), (antagonist, -1.0)];
        for (body, sign) in sides.into_iter().filter(|(body, _)| scene.bodies[*body].driven) {
            // What a driven body gives the free one: minus the impulse that it takes itself.
            let given = crate::math::to_world(&contact.frame, impulse) * -sign;
            let arm = contact.point - q_c.x[body];
            let moved = (solved.v[body] + state.v[body]) + turned(body).cross(&arm);
            ledger.outside_work += 0.5 * (given.dot(&moved) - sign * moment.dot(&turned(body)));
            momentum_in += given;
            angular_in += contact.point.cross(&given) - moment * sign;
        }
    }
    for (i, force, moment) in &free.loads {
        ledger.outside_work +=
            0.5 * h * (force.dot(&(solved.v[*i] + state.v[*i])) + moment.dot(&(solved.w[*i] + q_c.w[*i])));
    }
    for k in 0..3 {
        ledger.momentum_expected[k] += momentum_in[k];
        ledger.angular_momentum_expected[k] += angular_in[k];
    }

    let motion = Motion::of(scene, &q_c.q, &solved.v, &solved.w);
    ledger.momentum_scale = ledger.momentum_scale.max(motion.scale);
    let drift = (motion.momentum - Vec3::from(ledger.momentum_expected)).norm();
    let depths = || solved.contacts.iter().map(|s| (-s.contact.gap).max(0.0));
    let contacts_active = solved.contacts.iter().filter(|s| s.impulse != Vec3::zeros()).count();
    let penetration_largest = depths().fold(0.0, f64::max);
    ledger.penetration_largest = ledger.penetration_largest.max(penetration_largest / scene.mean_radius);
    ledger.sweeps += solution.sweeps;
    if !solution.converged {
        ledger.steps_unconverged += 1;
        ledger.last_unconverged = Some(state.step + 1);
    }
    let pair = |row: u32| {
        let [a, b] = system.rows[row as usize].bodies;
        (a, b)
    };
    StepReport {
        contacts_listed: solved.contacts.len(),
        contacts_solved: solution.active,
        contacts_active,
        sweeps: solution.sweeps,
        residual: solution.residual,
        converged: solution.converged,
        taken_over: solution.taken_over,
        norms: scene.options.lmgc90_norms.then(|| norms(system, &solution.impulses, &solution.records)),
        worst_pair: solution.worst.map(pair),
        penetration_largest,
        penetration_mean: depths().sum::<f64>() / contacts_active.max(1) as f64,
        kinetic: motion.kinetic,
        rotational: motion.rotational,
        potential: free.potential,
        gravity: free.gravity,
        momentum_drift: if ledger.momentum_scale > 0.0 { drift / ledger.momentum_scale } else { 0.0 },
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
        scene.free.iter().map(|&i| i as usize).fold(Motion::default(), |sum, i| {
            let body = &scene.bodies[i];
            Motion {
                momentum: sum.momentum + v[i] * body.mass,
                scale: sum.scale + v[i].norm() * body.mass,
                kinetic: sum.kinetic + 0.5 * body.mass * v[i].norm_squared(),
                rotational: sum.rotational + 0.5 * body.angular_momentum(&q[i], &w[i]).dot(&w[i]),
            }
        })
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
