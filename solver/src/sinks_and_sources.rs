//! Bodies that leave by sinks and enter from sources, between two steps.

use std::borrow::Cow;

use crate::assemble::potential_energy;
use crate::math::{Twist, Vec3};
use crate::scene::{BodyId, BodyPresence, BodyRoster, EVENT_SLACK, Scene};
use crate::state::State;
use crate::step::MotionTotals;

/// Sums over bodies that pass through a surface, leave or enter.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BodyFlow {
    pub number: f64,
    /// kg
    pub mass: f64,
    /// kg m/s
    pub momentum: Vec3,
    /// Kinetic energy of translation and rotation, J.
    pub energy: f64,
}

impl BodyFlow {
    /// Adds a body with its present motion `sign` times.
    pub fn add_body(&mut self, scene: &Scene, state: &State, body: BodyId, sign: f64) {
        let (i, rigid_body) = (body.index(), &scene.bodies[body.index()]);
        let (v, w) = (state.v[i], state.w[i]);
        let energy = 0.5 * rigid_body.mass * v.norm_squared() + rigid_body.rotational_energy(&state.q[i], &w);
        self.number += sign;
        self.mass += sign * rigid_body.mass;
        self.momentum += v * (sign * rigid_body.mass);
        self.energy += sign * energy;
    }

    /// Values in the order of the columns of probes.
    pub fn columns(&self) -> Vec<f64> {
        let BodyFlow { number, mass, momentum, energy } = *self;
        vec![number, mass, momentum.x, momentum.y, momentum.z, energy]
    }
}

/// Bodies that leave by each sink and enter from each source after a step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BodyExchange {
    pub removed: Vec<BodyFlow>,
    pub entered: Vec<BodyFlow>,
}

/// Removes the free bodies that are in sinks, and adds those whose time has come and whose position is free. Energy and
/// momentum that they take and bring are entered in the ledger. Returns the bodies, mass and motion that each sink and source
/// has removed and added.
pub fn exchange_bodies(scene: &mut Cow<Scene>, state: &mut State) -> BodyExchange {
    let Some(roster) = scene.roster.clone() else { return BodyExchange::default() };
    let sinks = &scene.options.sinks;
    let mut exchange = BodyExchange {
        removed: vec![BodyFlow::default(); sinks.len()],
        entered: vec![BodyFlow::default(); scene.options.sources.len()],
    };
    let mut leaving = Vec::new();
    for &body in &scene.free {
        let x = state.x[body.index()].into();
        if let Some(k) = sinks.iter().position(|sink| sink.region.contains(&x)) {
            exchange.removed[k].add_body(scene, state, body, 1.0);
            leaving.push(body);
        }
    }
    let entering = entering_bodies(scene, &roster, state, &leaving);
    state.bodies_entered = !entering.is_empty();
    if leaving.is_empty() && entering.is_empty() {
        return exchange;
    }
    let before = Totals::new(scene, state);
    for body in leaving {
        let i = body.index();
        state.presence[i] = BodyPresence::Gone;
        state.exit_velocities[i] = state.v[i];
        (state.v[i], state.w[i]) = (Vec3::zeros(), Vec3::zeros());
    }
    for &(_, body, Twist { v, w }) in &entering {
        let i = body.index();
        state.presence[i] = BodyPresence::Present;
        (state.v[i], state.w[i]) = (v, w);
    }
    state.apply_presence(scene.to_mut());
    entering.iter().for_each(|&(source, body, _)| exchange.entered[source].add_body(scene, state, body, 1.0));
    let after = Totals::new(scene, state);
    let ledger = &mut state.ledger;
    ledger.outside_work += after.energy - before.energy;
    for k in 0..3 {
        ledger.momentum_expected[k] += after.momentum[k] - before.momentum[k];
        ledger.angular_momentum_expected[k] += after.angular_momentum[k] - before.angular_momentum[k];
    }
    exchange
}

/// Energy (J), momentum and angular momentum of the bodies in the run.
struct Totals {
    energy: f64,
    momentum: Vec3,
    angular_momentum: Vec3,
}

impl Totals {
    fn new(scene: &Scene, state: &State) -> Self {
        let motion = MotionTotals::from_bodies(scene, &state.q, state.velocities());
        Totals {
            energy: motion.kinetic + motion.rotational + potential_energy(scene, state, &state.x),
            momentum: motion.momentum,
            angular_momentum: MotionTotals::total_angular_momentum(scene, state),
        }
    }
}

/// Bodies that enter now, with the index of their source and their velocities: of each source those whose time has come,
/// up to the first whose position is not free.
fn entering_bodies(
    scene: &Scene,
    roster: &BodyRoster,
    state: &State,
    leaving: &[BodyId],
) -> Vec<(usize, BodyId, Twist)> {
    let now = state.time + EVENT_SLACK * scene.options.dt;
    let mut entering: Vec<(usize, BodyId, Twist)> = Vec::new();
    for (source, (schedule, entries)) in scene.options.sources.iter().zip(&roster.entries).enumerate() {
        let waiting = entries.iter().enumerate().filter(|(_, (body, _))| is_waiting(state, *body));
        for (_, &(body, motion)) in waiting.take_while(|(k, _)| schedule.entry_time(*k) <= now) {
            let is_near =
                |other: BodyId, velocity: Vec3| are_near(scene, roster, state, [body, other], motion.v - velocity);
            let present =
                scene.free.iter().chain(&scene.held_grains).filter(|other| leaving.binary_search(other).is_err());
            let is_free = !present.into_iter().any(|&other| is_near(other, state.v[other.index()]))
                && !entering.iter().any(|&(_, other, twist)| is_near(other, twist.v));
            if !is_free {
                break;
            }
            entering.push((source, body, motion));
        }
    }
    entering
}

fn is_waiting(state: &State, body: BodyId) -> bool {
    state.presence[body.index()] == BodyPresence::Waiting
}

/// Whether the bounding balls of two bodies overlap, or may do so within two steps as long as the last at this relative
/// velocity (m/s): the next step may be twice as long, and its contacts are detected within it.
fn are_near(scene: &Scene, roster: &BodyRoster, state: &State, bodies: [BodyId; 2], velocity: Vec3) -> bool {
    let [x, other] = bodies.map(|body| state.x[body.index()]);
    let arm = x - other - scene.periodic_cell().nearest_shift(&(x - other));
    let reach: f64 = bodies.iter().map(|body| roster.bounding_radii[body.index()]).sum();
    arm.norm() < reach + 2.0 * state.h * velocity.norm()
}

/// Numbers of bodies that have left, wait for their time, and wait for their position to be free; `None` if the run has
/// neither sinks nor sources.
pub fn presence_text(scene: &Scene, state: &State) -> Option<String> {
    let roster = scene.roster.as_ref()?;
    let count = |presence: BodyPresence| state.presence.iter().filter(|of_body| **of_body == presence).count();
    let gone = (0..scene.bodies.len()).filter(|&i| state.presence[i] == BodyPresence::Gone);
    // The sum of no numbers is -0.
    let mass = gone.map(|i| scene.bodies[i].mass).sum::<f64>() + 0.0;
    let overdue = scene.options.sources.iter().zip(&roster.entries).flat_map(|(schedule, entries)| {
        let waiting = entries.iter().enumerate().filter(|(_, (body, _))| is_waiting(state, *body));
        waiting.filter(|(k, _)| schedule.entry_time(*k) <= state.time + EVENT_SLACK * scene.options.dt)
    });
    let (left, waiting, overdue) = (count(BodyPresence::Gone), count(BodyPresence::Waiting), overdue.count());
    let blocked =
        if overdue > 0 { format!(", {overdue} of them since their position is not free") } else { String::new() };
    Some(format!("{} free, {left} left with {mass:.6e} kg, {waiting} still to enter{blocked}", scene.free.len()))
}
