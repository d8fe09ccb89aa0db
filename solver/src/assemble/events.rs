//! Events at the start of a step, with the torque and the damping that they set.

use cd_formats::compute::EventAction;

use super::rigid_motion::{centre_of_mass, rigid_spin};
use crate::integrate::ContactConfiguration;
use crate::math::random::{point_in_ball, splitmix64};
use crate::math::{Twist, Vec3};
use crate::scene::{BodyId, EVENT_SLACK, Scene};
use crate::state::{BodyLoad, BondingMode, State};

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

/// Applies the events that are due at a step's start, and returns their effects.
pub fn apply_events(scene: &Scene, state: &mut State) -> AppliedEvents {
    let now = state.time + EVENT_SLACK * scene.options.dt;
    let mut applied = AppliedEvents::default();
    while let Some(event) = scene.events.get(state.events_done).filter(|event| event.time <= now) {
        let gravity = state.gravity;
        state.apply_setting(&event.action, scene);
        account_potential(scene, state, state.gravity - gravity);
        applied.velocities_changed |= matches!(event.action, EventAction::AddVelocity(_) | EventAction::AddSpin(_));
        match event.action {
            EventAction::AddVelocity(velocity) => {
                change_motion(scene, state, |_, old| Twist { v: old.v + Vec3::from(velocity), ..old });
            }
            EventAction::AddSpin(spin) => {
                add_spin(scene, state, Vec3::from(spin));
                state.attraction = None; // the history of self-gravity is no longer valid
            }
            EventAction::Shake { speed, seed } => {
                state.attraction = None;
                let seed = splitmix64(splitmix64(seed) ^ state.events_done as u64);
                applied.shakes.push(ShakeEvent { speed, seed });
            }
            EventAction::Bond => state.bonding = BondingMode::All,
            EventAction::SetTorque(_)
            | EventAction::SetGravity(_)
            | EventAction::SetQuench(_)
            | EventAction::SetFriction(..)
            | EventAction::SetCohesion(..) => {}
        }
        applied.any_event = true;
        state.events_done += 1;
    }
    applied
}

/// Applies the torque that events have set, and the option `quench`, at the start of a step of `step_multiple` times `dt`.
///
/// Steps with such a change need a backup of the velocities, see [`StateBackup::new`](crate::state::StateBackup::new), and with
/// imposed motion are taken with θ = 1, see `needs_implicit_step`.
pub fn apply_torque_and_damping(scene: &Scene, state: &mut State, step_multiple: u64) {
    if state.torque != Vec3::zeros() {
        let impulse = state.torque * (step_multiple as f64 * scene.options.dt);
        add_spin(scene, state, rigid_spin(scene, &state.x, &state.q, impulse));
    }
    if state.quench > 0.0 {
        let kept_share = (1.0 - state.quench).powi(step_multiple as i32);
        change_motion(scene, state, |_, old| Twist { v: old.v * kept_share, w: old.w * kept_share });
    }
}

/// Adds a rigid rotation (rad/s) of the free bodies about their centre of mass.
fn add_spin(scene: &Scene, state: &mut State, spin: Vec3) {
    let centre = centre_of_mass(scene, &state.x);
    let x = state.x.clone();
    change_motion(scene, state, |i, old| Twist { v: old.v + spin.cross(&(x[i] - centre)), w: old.w + spin });
}

/// Loads that give the free bodies random velocities in the step, minus the rigid motion that has their momentum and
/// angular momentum. In a periodic scene the angular momentum is not conserved and is not removed.
///
/// The loads act in the contact configuration, as all forces do: a change of velocity before it would carry grains into their
/// neighbours.
pub(super) fn shake_loads(
    scene: &Scene,
    q_c: &ContactConfiguration,
    &ShakeEvent { speed, seed }: &ShakeEvent,
) -> Vec<BodyLoad> {
    // The mean square of the distance from the centre of a ball is 3/5 of its radius squared.
    let radius = speed * (5.0f64 / 3.0).sqrt();
    let random_velocities: Vec<Vec3> =
        (0..scene.bodies.len() as u64).map(|i| point_in_ball(splitmix64(seed ^ i)) * radius).collect();
    let mean_velocity = centre_of_mass(scene, &random_velocities);
    let (x, centre) = (&q_c.x, centre_of_mass(scene, &q_c.x));
    let mean_spin = if scene.periodic_cell().is_periodic() {
        Vec3::zeros()
    } else {
        let angular_momentum_of =
            |&i: &BodyId| (x[i.index()] - centre).cross(&random_velocities[i.index()]) * scene.bodies[i.index()].mass;
        rigid_spin(scene, x, &q_c.q, scene.free.iter().map(angular_momentum_of).sum())
    };
    let load_of = |&body: &BodyId| {
        let (i, rigid_body) = (body.index(), &scene.bodies[body.index()]);
        let v = random_velocities[i] - mean_velocity - mean_spin.cross(&(x[i] - centre));
        let torque = rigid_body.angular_momentum(&q_c.q[i], &mean_spin) / -q_c.h;
        BodyLoad { body, force: v * (rigid_body.mass / q_c.h), torque }
    };
    scene.free.iter().map(load_of).collect()
}

/// Gives the free bodies new velocities and records the change of momentum and energy as external in the ledger.
fn change_motion(scene: &Scene, state: &mut State, new_motion: impl Fn(usize, Twist) -> Twist) {
    for &i in &scene.free {
        let i = i.index();
        let body = &scene.bodies[i];
        let Twist { v, w } = new_motion(i, Twist { v: state.v[i], w: state.w[i] });
        let momentum = (v - state.v[i]) * body.mass;
        let own_angular_momentum = body.angular_momentum(&state.q[i], &(w - state.w[i]));
        state.ledger.outside_work +=
            0.5 * (momentum.dot(&(v + state.v[i])) + own_angular_momentum.dot(&(w + state.w[i])));
        add_vector(&mut state.ledger.momentum_expected, &momentum);
        add_vector(&mut state.ledger.angular_momentum_expected, &(state.x[i].cross(&momentum) + own_angular_momentum));
        (state.v[i], state.w[i]) = (v, w);
    }
    for (&i, angular_momentum) in scene.free_rotors.iter().zip(&mut state.angular_momentum) {
        let i = i.index();
        *angular_momentum = scene.bodies[i].angular_momentum(&state.q[i], &state.w[i]);
    }
}

/// Records the change of potential energy by a change of uniform gravity as external in the ledger.
fn account_potential(scene: &Scene, state: &mut State, change: Vec3) {
    let potential_loss = |&i: &BodyId| scene.bodies[i.index()].mass * change.dot(&state.x[i.index()]);
    state.ledger.outside_work -= scene.free.iter().chain(&scene.held_grains).map(potential_loss).sum::<f64>();
}

fn add_vector(sum: &mut [f64; 3], term: &Vec3) {
    sum.iter_mut().zip(term.iter()).for_each(|(s, t)| *s += t);
}
