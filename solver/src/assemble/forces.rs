//! Loads on bodies besides contacts: gravity, imposed forces and velocities, events.

use std::sync::Arc;

use cd_formats::compute::EventAction;
use cd_formats::field::FieldModel;
use cd_formats::snapshot::GravityEvaluations as Record;

use crate::detect::broad::near_pairs;
use crate::gravity::quadrupole::{BodyInertia, quadrupole_correction};
use crate::gravity::sample::{self, SampledError};
use crate::gravity::{GravityField, GravitySolver, SummationMethod, balance_accelerations};
use crate::integrate::ContactConfiguration;
use crate::math::random::{point_in_ball, splitmix64};
use crate::math::{Mat3, Quat, Vec3, to_world};
use crate::scene::{EVENT_SLACK, Scene};
use crate::state::{BondingMode, GravityHistory, State};

/// Velocities at the step's end without contacts, and the contributions of the forces to the ledger.
pub struct FreeMotion {
    /// Velocities, m/s.
    pub v: Vec<Vec3>,
    /// Angular velocities, rad/s, world frame.
    pub w: Vec<Vec3>,
    /// Potential energy in self-gravity, uniform gravity and outer fields, in the contact configuration, J.
    pub potential: f64,
    pub gravity: GravityReport,
    /// Self-gravity for the following steps, see [`GravityHistory`].
    pub attraction: Option<GravityHistory>,
    /// Impulse of uniform gravity, outer fields and imposed forces on the free bodies, N s.
    pub impulse: Vec3,
    /// Angular impulse of these about the origin, N m s.
    pub angular_impulse: Vec3,
    /// Forces and moments (N, N m) by body whose work depends on the displacement of the body: imposed ones and Coriolis
    /// forces.
    pub loads: Vec<(usize, Vec3, Vec3)>,
}

/// Accuracy of self-gravity.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GravityReport {
    /// RMS of the correction that makes forces and torques sum to zero, over that of the accelerations.
    pub removed: f64,
    /// Error against the direct sum, in steps that sample it.
    pub sampled: Option<SampledError>,
    /// RMS relative error of the extrapolation to the last evaluation.
    pub extrapolation: f64,
}

/// Effects of the events at a step's start.
#[derive(Default)]
pub struct AppliedEvents {
    /// Whether there were any events.
    pub any_event: bool,
    /// Whether events have changed velocities at the step's start.
    pub velocities_changed: bool,
    pub shakes: Vec<ShakeEvent>,
}

/// Random velocities to be added within a step.
pub struct ShakeEvent {
    /// Root mean square of the speed, m/s.
    speed: f64,
    seed: u64,
}

/// Applies the events that are due at a step's start.
pub fn apply_events(scene: &Scene, state: &mut State) -> AppliedEvents {
    let now = state.time + EVENT_SLACK * scene.options.dt;
    let mut happened = AppliedEvents::default();
    while let Some(event) = scene.events.get(state.events_done).filter(|event| event.time <= now) {
        let gravity = state.gravity;
        state.apply_setting(&event.action, scene);
        account_potential(scene, state, state.gravity - gravity);
        happened.velocities_changed |= matches!(event.action, EventAction::AddVelocity(_) | EventAction::AddSpin(_));
        match event.action {
            EventAction::AddVelocity(velocity) => change_motion(scene, state, |_, v, w| (v + Vec3::from(velocity), w)),
            EventAction::AddSpin(spin) => {
                add_spin(scene, state, Vec3::from(spin));
                state.attraction = None; // the history of self-gravity is no longer valid
            }
            EventAction::Shake { speed, seed } => {
                state.attraction = None;
                let seed = splitmix64(splitmix64(seed) ^ state.events_done as u64);
                happened.shakes.push(ShakeEvent { speed, seed });
            }
            EventAction::Bond => state.bonding = BondingMode::All,
            EventAction::SetTorque(_)
            | EventAction::SetGravity(_)
            | EventAction::SetQuench(_)
            | EventAction::SetFriction(..)
            | EventAction::SetCohesion(..) => {}
        }
        happened.any_event = true;
        state.events_done += 1;
    }
    happened
}

/// Applies the torque that events have set, and the option `quench`, at the start of a step of `units` times `dt`.
pub fn apply_torque_and_damping(scene: &Scene, state: &mut State, units: u64) {
    if state.torque != Vec3::zeros() {
        let impulse = state.torque * (units as f64 * scene.options.dt);
        add_spin(scene, state, rigid_spin(scene, &state.x, &state.q, impulse));
    }
    if state.quench > 0.0 {
        let keep = (1.0 - state.quench).powi(units as i32);
        change_motion(scene, state, |_, v, w| (v * keep, w * keep));
    }
}

/// Adds a rigid rotation (rad/s) of the free bodies about their centre of mass.
fn add_spin(scene: &Scene, state: &mut State, spin: Vec3) {
    let centre = centre_of_mass(scene, &state.x);
    let x = state.x.clone();
    change_motion(scene, state, |i, v, w| (v + spin.cross(&(x[i] - centre)), w + spin));
}

/// Forces and moments (N, N m) by body that give the free bodies random velocities in the step, minus the rigid motion that
/// has their momentum and angular momentum. In a periodic scene the angular momentum is not conserved and is not removed.
///
/// They act in the contact configuration, as all forces do: a change of velocity before it would carry grains into their
/// neighbours.
fn shake_loads(
    scene: &Scene,
    q_c: &ContactConfiguration,
    &ShakeEvent { speed, seed }: &ShakeEvent,
) -> Vec<(usize, Vec3, Vec3)> {
    // The mean square of the distance from the centre of a ball is 3/5 of its radius squared.
    let radius = speed * (5.0f64 / 3.0).sqrt();
    let added: Vec<Vec3> =
        (0..scene.bodies.len() as u64).map(|i| point_in_ball(splitmix64(seed ^ i)) * radius).collect();
    let shared = centre_of_mass(scene, &added);
    let (x, centre) = (&q_c.x, centre_of_mass(scene, &q_c.x));
    let turn = if scene.options.xperiode.is_some() || scene.options.yperiode.is_some() {
        Vec3::zeros()
    } else {
        let about = |&i: &u32| (x[i as usize] - centre).cross(&added[i as usize]) * scene.bodies[i as usize].mass;
        rigid_spin(scene, x, &q_c.q, scene.free.iter().map(about).sum())
    };
    let of_body = |&i: &u32| {
        let (i, body) = (i as usize, &scene.bodies[i as usize]);
        let v = added[i] - shared - turn.cross(&(x[i] - centre));
        (i, v * (body.mass / q_c.h), body.angular_momentum(&q_c.q[i], &turn) / -q_c.h)
    };
    scene.free.iter().map(of_body).collect()
}

/// Rigid rotation (rad/s) of the free bodies that has the angular momentum `impulse` (N m s) about their centre of mass; 0 if
/// they lie on a line and have no inertia about it. In a scene that is periodic along one axis, which `impulse` is then
/// parallel to, the rotation is about this axis alone: the position of a body along it is arbitrary.
fn rigid_spin(scene: &Scene, x: &[Vec3], q: &[Quat], impulse: Vec3) -> Vec3 {
    let centre = centre_of_mass(scene, x);
    let momentum = |spin: Vec3| -> Vec3 {
        scene.free.iter().map(|&i| i as usize).fold(Vec3::zeros(), |sum, i| {
            let (body, arm) = (&scene.bodies[i], x[i] - centre);
            sum + arm.cross(&spin.cross(&arm)) * body.mass + body.angular_momentum(&q[i], &spin)
        })
    };
    let inertia = Mat3::from_columns(&[Vec3::x(), Vec3::y(), Vec3::z()].map(momentum));
    if let Some(k) = scene.periods().iter().position(Option::is_some) {
        let moment = inertia[(k, k)];
        return Vec3::ith(k, if moment > 0.0 { impulse[k] / moment } else { 0.0 });
    }
    inertia.try_inverse().map_or(Vec3::zeros(), |inverse| inverse * impulse)
}

/// Gives the free bodies new velocities and records the change of momentum and energy as external in the ledger.
fn change_motion(scene: &Scene, state: &mut State, new: impl Fn(usize, Vec3, Vec3) -> (Vec3, Vec3)) {
    for &i in &scene.free {
        let i = i as usize;
        let body = &scene.bodies[i];
        let (v, w) = new(i, state.v[i], state.w[i]);
        let momentum = (v - state.v[i]) * body.mass;
        let spin = body.angular_momentum(&state.q[i], &(w - state.w[i]));
        state.ledger.outside_work += 0.5 * (momentum.dot(&(v + state.v[i])) + spin.dot(&(w + state.w[i])));
        add_vector(&mut state.ledger.momentum_expected, &momentum);
        add_vector(&mut state.ledger.angular_momentum_expected, &(state.x[i].cross(&momentum) + spin));
        (state.v[i], state.w[i]) = (v, w);
    }
    for (&i, spin) in scene.turning.iter().zip(&mut state.angular_momentum) {
        let i = i as usize;
        *spin = scene.bodies[i].angular_momentum(&state.q[i], &state.w[i]);
    }
}

/// Records the change of potential energy by a change of uniform gravity as external in the ledger.
fn account_potential(scene: &Scene, state: &mut State, change: Vec3) {
    let height = |&i: &u32| scene.bodies[i as usize].mass * change.dot(&state.x[i as usize]);
    state.ledger.outside_work -= scene.free.iter().map(height).sum::<f64>();
}

fn add_vector(sum: &mut [f64; 3], term: &Vec3) {
    sum.iter_mut().zip(term.iter()).for_each(|(s, t)| *s += t);
}

/// Mean over the free bodies, weighted by mass, of positions or velocities.
fn centre_of_mass(scene: &Scene, x: &[Vec3]) -> Vec3 {
    let (moment, mass) = scene.free.iter().fold((Vec3::zeros(), 0.0), |(moment, mass), &i| {
        let m = scene.bodies[i as usize].mass;
        (moment + x[i as usize] * m, mass + m)
    });
    moment / mass
}

/// Free velocities: V + h F/m with all forces in the contact configuration; imposed velocities at the step's end.
pub fn free_velocity(scene: &Scene, state: &State, q_c: &ContactConfiguration, shakes: &[ShakeEvent]) -> FreeMotion {
    let h = q_c.h;
    let mut pull = self_gravity(scene, state, q_c);
    let near = near_field(scene, &q_c.x, &q_c.q);
    pull.energy += near.energy;
    let outside = scene.external_fields();
    let mut free = FreeMotion {
        v: state.v.clone(),
        w: q_c.w.clone(),
        potential: pull.energy,
        gravity: pull.report,
        attraction: pull.next,
        impulse: Vec3::zeros(),
        angular_impulse: Vec3::zeros(),
        loads: Vec::new(),
    };
    for (k, &i) in scene.free.iter().enumerate() {
        let i = i as usize;
        let (mass, x) = (scene.bodies[i].mass, q_c.x[i]);
        let (push, potential) = external_field(&outside, state.gravity, &x);
        free.v[i] += (push + pull.acceleration[k]) * h;
        free.potential += mass * potential;
        let weight = push * (mass * h);
        free.impulse += weight;
        free.angular_impulse += x.cross(&weight);
    }
    free.potential += tidal_energy(scene, &outside, &q_c.q);
    for body in scene.drives.iter().map(|drive| drive.body).filter(|&i| scene.bodies[i].is_driven_in_part()) {
        free.v[body] += external_field(&outside, state.gravity, &q_c.x[body]).0 * h;
    }
    let shaking = shakes.iter().flat_map(|shake| shake_loads(scene, q_c, shake));
    for (i, force, moment) in imposed_loads(scene, state, q_c).into_iter().chain(shaking) {
        let body = &scene.bodies[i];
        free.v[i] += force * (h * body.inverse_mass());
        free.w[i] += body.angular_velocity(&q_c.q[i], &(moment * h));
        if !body.driven {
            free.impulse += force * h;
            free.angular_impulse += (q_c.x[i].cross(&force) + moment) * h;
            free.loads.push((i, force, moment));
        }
    }
    for (i, force, torque) in near.loads {
        let body = &scene.bodies[i];
        free.v[i] += force * (h * body.inverse_mass());
        free.w[i] += body.angular_velocity(&q_c.q[i], &(torque * h));
    }
    apply_coriolis(scene, state, q_c, &mut free);
    let end = scene.time_at(state.step + q_c.step_multiple);
    for drive in &scene.drives {
        let i = drive.body;
        (free.v[i], free.w[i]) = drive.velocity_at(end, &q_c.q[i], &free.v[i]);
    }
    free
}

/// Acceleration and potential by uniform gravity and outer fields on a body at rest.
fn external_field(outside: &[FieldModel], gravity: Vec3, x: &Vec3) -> (Vec3, f64) {
    let uniform = (gravity, -gravity.dot(x));
    outside
        .iter()
        .map(|field| field.acceleration_and_potential(x))
        .fold(uniform, |sum, term| (sum.0 + term.0, sum.1 + term.1))
}

/// Vector u with u + k x u = b.
fn solve_rotation_equation(b: &Vec3, k: &Vec3) -> Vec3 {
    (b + k * k.dot(b) - k.cross(b)) / (1.0 + k.norm_squared())
}

/// Contribution of the free bodies' extent to their potential energy in outer fields, J.
fn tidal_energy(scene: &Scene, outside: &[FieldModel], q: &[Quat]) -> f64 {
    let of = |i: usize| {
        outside
            .iter()
            .map(|field| field.tidal_energy(|rate| scene.bodies[i].angular_momentum(&q[i], rate)))
            .sum::<f64>()
    };
    scene.free.iter().map(|&i| of(i as usize)).sum()
}

/// Applies the Coriolis force in turning axes, on the velocity weighted over the step as (1-theta) V + theta V+. V+ includes
/// the contact forces of the last step: a body at rest is not pushed aside by a fall that does not happen, and the error
/// after an impact is corrected in the next step. Also applies the spin of turning bodies against the axes, unless the bodies
/// [turn freely](crate::integrate). Without contacts and for theta = 1/2 the force does no work, exactly.
fn apply_coriolis(scene: &Scene, state: &State, q_c: &ContactConfiguration, free: &mut FreeMotion) {
    let rate = scene.frame_angular_velocity();
    if rate == Vec3::zeros() {
        return;
    }
    let (h, theta) = (q_c.h, scene.options.theta);
    let pushed = contact_velocity_changes(scene, state, h);
    for &i in &scene.free {
        let i = i as usize;
        let body = &scene.bodies[i];
        let known = state.v[i] * (1.0 - theta) + pushed[i] * theta;
        let v = solve_rotation_equation(&(free.v[i] - rate.cross(&known) * (2.0 * h)), &(rate * (2.0 * theta * h)));
        let w = match body.is_isotropic() {
            true => solve_rotation_equation(
                &(free.w[i] - rate.cross(&state.w[i]) * ((1.0 - theta) * h)),
                &(rate * (theta * h)),
            ),
            false => free.w[i],
        };
        let (impulse, turn) = ((v - free.v[i]) * body.mass, (w - free.w[i]) * body.inertia[0]);
        (free.v[i], free.w[i]) = (v, w);
        free.impulse += impulse;
        free.angular_impulse += q_c.x[i].cross(&impulse) + turn;
        free.loads.push((i, impulse / h, turn / h));
    }
}

/// Change of each body's velocity in `h` by the contact forces of the last step, m/s.
fn contact_velocity_changes(scene: &Scene, state: &State, h: f64) -> Vec<Vec3> {
    let mut change = vec![Vec3::zeros(); scene.bodies.len()];
    for solved in &state.contacts {
        let contact = &solved.contact;
        let impulse = to_world(&contact.frame(), &solved.impulse) * (h / state.h);
        for (body, impulse) in [(contact.candidate as usize, impulse), (contact.antagonist as usize, -impulse)] {
            change[body] += impulse * scene.bodies[body].inverse_mass();
        }
    }
    change
}

/// Relative error required of self-gravity for the energies from which a run's drift is computed, twice a run: with it that
/// of 40 000 bodies in a ball is off by 6e-10 of itself.
const ENERGY_ERROR: f64 = 1e-6;

/// Share of the error allowed for self-gravity that its extrapolation may reach.
const EXTRAPOLATION_ERROR_SHARE: f64 = 0.25;

/// Largest time of extrapolation of self-gravity over the time between its last two evaluations.
const MAX_EXTRAPOLATION_RATIO: f64 = 2.0;

/// Largest distance, over the sum of the radii, at which bodies feel each other's quadrupoles if attraction is not summed
/// pair by pair.
const QUADRUPOLE_RANGE: f64 = 3.0;

/// Self-gravity in a step.
struct SelfGravity {
    /// Acceleration of each free body, m/s^2.
    acceleration: Vec<Vec3>,
    /// Potential energy, J.
    energy: f64,
    report: GravityReport,
    next: Option<GravityHistory>,
}

/// Self-gravity at each free body; zeros if the scene has none.
fn self_gravity(scene: &Scene, state: &State, q_c: &ContactConfiguration) -> SelfGravity {
    if !scene.has_self_gravity() {
        let acceleration = vec![Vec3::zeros(); scene.free.len()];
        return SelfGravity { acceleration, energy: 0.0, report: GravityReport::default(), next: None };
    }
    let (positions, masses) = point_masses(scene, &q_c.x);
    let mut pull = if scene.gravity_refresh() == 1 {
        let (acceleration, energy, removed) = evaluate_self_gravity(scene, &q_c.order, &positions, &masses);
        let report = GravityReport { removed, ..GravityReport::default() };
        SelfGravity { acceleration, energy, report, next: None }
    } else {
        extrapolate_self_gravity(scene, state, q_c, &positions, &masses)
    };
    let approximate =
        scene.gravity_refresh() > 1 || scene.gravity_solver().method_for(masses.len()) == SummationMethod::Fmm;
    if approximate && state.is_diagnostic_step(q_c.step_multiple) {
        let constant = scene.options.gravity_constant;
        pull.report.sampled =
            Some(sample::sampled_error(&positions, &masses, constant, &pull.acceleration, state.step));
    }
    pull
}

/// Contribution of the shapes of near bodies to self-gravity.
#[derive(Default)]
struct NearField {
    /// Forces and torques about the centre by free body, N, N m.
    loads: Vec<(usize, Vec3, Vec3)>,
    /// Potential energy, J.
    energy: f64,
}

/// Contribution of the quadrupoles, if the option enables it, summed pair by pair in an order that depends only on the
/// positions.
fn near_field(scene: &Scene, x: &[Vec3], q: &[Quat]) -> NearField {
    let options = &scene.options;
    if !(scene.has_self_gravity() && options.gravity_quadrupole) {
        return NearField::default();
    }
    let rigid = |&i: &u32| {
        let (body, turn) = (&scene.bodies[i as usize], q[i as usize].to_rotation_matrix());
        let inertia = turn * Mat3::from_diagonal(&body.inertia.into()) * turn.transpose();
        BodyInertia { mass: body.mass, inertia }
    };
    let rigids: Vec<BodyInertia> = scene.free.iter().map(rigid).collect();
    let (places, reaches): (Vec<Vec3>, Vec<f64>) =
        scene.free.iter().map(|&i| (x[i as usize], QUADRUPOLE_RANGE * scene.bodies[i as usize].radius)).unzip();
    let none = |&i: &u32| (i as usize, Vec3::zeros(), Vec3::zeros());
    let mut field = NearField { loads: scene.free.iter().map(none).collect(), energy: 0.0 };
    let round: Vec<bool> = scene.free.iter().map(|&i| scene.bodies[i as usize].is_isotropic()).collect();
    let mut add = |[i, j]: [usize; 2], reach: f64| {
        let r = places[j] - places[i];
        if (round[i] && round[j]) || r == Vec3::zeros() {
            return;
        }
        let found = quadrupole_correction(&r, [&rigids[i], &rigids[j]], reach, options.gravity_constant);
        field.energy += found.energy;
        for (k, force, torque) in [(i, -found.force, found.torques[0]), (j, found.force, found.torques[1])] {
            field.loads[k].1 += force;
            field.loads[k].2 += torque;
        }
    };
    if scene.gravity_solver().method_for(places.len()) == SummationMethod::Direct {
        (1..places.len()).for_each(|j| (0..j).for_each(|i| add([i, j], f64::INFINITY)));
    } else {
        for pair in near_pairs(&places, &reaches) {
            let [i, j] = pair.map(|k| k as usize);
            add([i, j], reaches[i] + reaches[j]);
        }
    }
    field
}

fn point_masses(scene: &Scene, x: &[Vec3]) -> (Vec<Vec3>, Vec<f64>) {
    scene.free.iter().map(|&i| (x[i as usize], scene.bodies[i as usize].mass)).unzip()
}

/// Accelerations, energy and removed part, see [`GravityField`]; `order` is the order of all bodies.
fn evaluate_self_gravity(scene: &Scene, order: &[u32], positions: &[Vec3], masses: &[f64]) -> (Vec<Vec3>, f64, f64) {
    let place = |body| scene.free.binary_search(body).ok().map(|k| k as u32);
    let of_free: Vec<u32> = order.iter().filter_map(place).collect();
    let GravityField { acceleration, potential, removed } =
        scene.gravity_solver().full_field(positions, masses, scene.options.gravity_constant, &of_free);
    (acceleration, 0.5 * potential.iter().zip(masses).map(|(p, m)| p * m).sum::<f64>(), removed)
}

/// Self-gravity extrapolated from its last two evaluations, or evaluated again. The error of the extrapolation grows with the
/// square of the time since the last evaluation. This time is at most twice the time between the two evaluations, and less if
/// their error requires it. Forces and torques sum to zero in both cases.
fn extrapolate_self_gravity(
    scene: &Scene,
    state: &State,
    q_c: &ContactConfiguration,
    positions: &[Vec3],
    masses: &[f64],
) -> SelfGravity {
    let options = &scene.options;
    let now = state.time + (1.0 - options.theta) * q_c.h;
    let mass: f64 = masses.iter().sum();
    let velocities = || scene.free.iter().map(|&i| state.v[i as usize]);
    let mean = velocities().zip(masses).map(|(v, m)| v * *m).sum::<Vec3>() / mass;
    let fastest = velocities().map(|v| (v - mean).norm_squared()).fold(0.0, f64::max).sqrt();
    let Some(old) = &state.attraction else {
        let (acceleration, energy, removed) = evaluate_self_gravity(scene, &q_c.order, positions, masses);
        let record = Record { times: [now; 2], potentials: [energy; 2], removed, ..Record::default() };
        let rows: Arc<[Vec3]> = acceleration.as_slice().into();
        let next = GravityHistory { record, last: rows.clone(), before: rows };
        let report = GravityReport { removed, ..GravityReport::default() };
        return SelfGravity { acceleration, energy, report, next: Some(next) };
    };
    let record = &old.record;
    let [last, before] = record.times;
    let part = if last > before { (now - last) / (last - before) } else { 0.0 };
    let mut acceleration: Vec<Vec3> = old.last.iter().zip(&*old.before).map(|(a, b)| a + (a - b) * part).collect();
    let (age, moved) = (record.age + q_c.step_multiple, record.moved + fastest * q_c.h);
    // The error after a time s, extrapolated over an interval t, is proportional to s (s + t).
    let allowed = EXTRAPOLATION_ERROR_SHARE * options.gravity_error() / record.extrapolation_error;
    let stretch = 0.5 * ((1.0 + 8.0 * allowed).sqrt() - 1.0).min(2.0 * MAX_EXTRAPOLATION_RATIO);
    // Slack of a thousandth of a step, as times are sums.
    let reached = last > before && now - last <= (last - before) * stretch + 1e-3 * options.dt;
    let report = |removed, extrapolation| GravityReport { removed, sampled: None, extrapolation };
    if reached && age < scene.gravity_refresh() && moved < options.gravity_moved * scene.mean_radius {
        let removed = balance_accelerations(positions, masses, &mut acceleration);
        let energy = record.potentials[0] + (record.potentials[0] - record.potentials[1]) * part;
        let report = report(record.removed.max(removed), record.extrapolation_error);
        let record = Record { age, moved, ..record.clone() };
        return SelfGravity { acceleration, energy, report, next: Some(GravityHistory { record, ..old.clone() }) };
    }
    let (fresh, energy, removed) = evaluate_self_gravity(scene, &q_c.order, positions, masses);
    let square = |v: &mut dyn Iterator<Item = Vec3>| v.map(|v| v.norm_squared()).sum::<f64>();
    let away = square(&mut acceleration.iter().zip(&fresh).map(|(a, b)| a - b));
    let scale = square(&mut fresh.iter().copied());
    let extrapolation_error = if scale > 0.0 { (away / scale).sqrt() } else { 0.0 };
    let times = [now, last];
    let potentials = [energy, record.potentials[0]];
    let record = Record { age: 0, times, potentials, moved: 0.0, removed, extrapolation_error };
    let next = GravityHistory { record, last: fresh.as_slice().into(), before: old.last.clone() };
    SelfGravity { acceleration: fresh, energy, report: report(removed, extrapolation_error), next: Some(next) }
}

/// Potential energy of the free bodies at `x` in self-gravity, uniform gravity (zero at the origin) and outer fields, J.
pub fn potential_energy(scene: &Scene, state: &State, x: &[Vec3]) -> f64 {
    let (positions, masses) = point_masses(scene, x);
    let outside = scene.external_fields();
    let outer: f64 = positions.iter().zip(&masses).map(|(x, m)| m * external_field(&outside, state.gravity, x).1).sum();
    let outer = outer + tidal_energy(scene, &outside, &state.q);
    if !scene.has_self_gravity() {
        return outer;
    }
    let gravity = match scene.gravity_solver() {
        asked if asked.method_for(positions.len()) == SummationMethod::Direct => asked,
        _ => GravitySolver::new(SummationMethod::Auto, ENERGY_ERROR),
    };
    let potential = gravity.full_field(&positions, &masses, scene.options.gravity_constant, &[]).potential;
    let points = 0.5 * potential.iter().zip(&masses).map(|(p, m)| p * m).sum::<f64>();
    outer + points + near_field(scene, x, &state.q).energy
}

/// Imposed forces and moments, weighted over the step as (1-theta) f(t) + theta f(t+h), world frame.
fn imposed_loads(scene: &Scene, state: &State, q_c: &ContactConfiguration) -> Vec<(usize, Vec3, Vec3)> {
    let theta = scene.options.theta;
    scene
        .loads
        .iter()
        .map(|load| {
            let value = (1.0 - theta) * load.value.value_at(state.time)
                + theta * load.value.value_at(scene.time_at(state.step + q_c.step_multiple));
            let mut vector = Vec3::zeros();
            vector[load.component % 3] = value;
            match load.component {
                0..3 => (load.body, vector, Vec3::zeros()),
                _ => (load.body, Vec3::zeros(), q_c.q[load.body] * vector),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turned_solves_its_equation() {
        let (b, k) = (Vec3::new(1.0, -2.0, 3.0), Vec3::new(0.4, 0.1, -2.0));
        let u = solve_rotation_equation(&b, &k);
        assert!((u + k.cross(&u) - b).norm() < 1e-14);
    }
}
