//! Velocities that no contact problem has bounded: those at the start of a run, after events, and of bodies that enter.
//!
//! A step bounds its end velocities V⁺ by the gaps on the path to the next contact configuration, x_c + h V⁺. If velocities
//! are changed when a step begins, the path (1-θ) h V to its contact configuration is not bounded.

use crate::assemble::{AppliedEvents, FreeMotion, relative_velocity};
use crate::detect;
use crate::integrate::{ContactConfiguration, MAX_STEP_GROWTH, predict_configuration};
use crate::math::Vec3;
use crate::scene::{BodyId, Scene};
use crate::state::{Contact, SolvedContact, State, UNKNOWN_FEATURE, Velocities};

/// Closing beyond a gap that counts as rounding, over the effective radius: that of laws that act on touching contacts.
const CLOSING_ROUNDING: f64 = 1e-9;

/// Relative change of an approach speed since the last step that is attributed to the digits of text files.
const SPEED_DIGITS: f64 = 1e-6;

/// Whether velocities differ from those at the end of the last step and are not bounded by it.
pub fn velocities_are_unbounded(scene: &Scene, state: &State, applied: &AppliedEvents) -> bool {
    state.step == scene.start.step || applied.velocities_changed || state.bodies_entered
}

/// Whether the next step, of `step_multiple` times `dt`, is taken with θ = 1: with x_c = x + (1-θ) h V some bodies would close
/// a gap before the contact configuration.
///
/// All bodies take such a step, or none: between a body at x and one at x + (1-θ) h V, gaps would be wrong by (1-θ) h V, and
/// bodies at rest relative to each other would be pushed apart. `unbounded`: see [`velocities_are_unbounded`].
pub fn needs_implicit_step(scene: &Scene, state: &State, step_multiple: u64, unbounded: bool) -> bool {
    let h = step_multiple as f64 * scene.options.dt;
    let max_growth = if scene.options.adaptive().is_on() { MAX_STEP_GROWTH as f64 } else { 1.0 };
    let longer = h > max_growth * state.h * (1.0 + SPEED_DIGITS);
    let has_moving_walls = || scene.drives.iter().any(|drive| drive.ever_moves());
    // A torque or damping in every step changes all free bodies equally, but not walls.
    let pushed = state.torque != Vec3::zeros() && !scene.drives.is_empty() || state.quench > 0.0 && has_moving_walls();
    let time_before = (1.0 - scene.options.theta) * h;
    if time_before == 0.0 || !(unbounded || longer || pushed) {
        return false;
    }
    let start = predict_configuration(scene, state, 0);
    let start = ContactConfiguration { lookahead: h + time_before, ..start };
    let contacts = detect::listed_contacts(scene, &start, state.velocities(), &mut state.detection_cache.clone());
    let is_closing = |contact: &Contact| {
        let u = contact.normal.dot(&relative_velocity(contact, &start.x, Velocities { v: &state.v, w: &start.w }));
        let radius = scene.effective_radius(
            (contact.candidate, contact.part_numbers.0),
            (contact.antagonist, contact.part_numbers.1),
        );
        let find_old = || state.contacts.binary_search_by_key(&contact.key(), |old| old.contact.key());
        let bounded = || {
            !longer
                && match find_old() {
                    Ok(k) => u >= state.contacts[k].velocity.x - SPEED_DIGITS * u.abs(),
                    Err(_) => bounded_by_file(state, &start, contact, u, time_before),
                }
        };
        -time_before * u - contact.gap.max(0.0) > CLOSING_ROUNDING * radius && !bounded()
    };
    contacts.iter().any(is_closing)
}

/// Whether a contact between polyhedra, cylinders or plates that a file lists, without their features, bounds the approach
/// speed u (m/s, < 0) of a contact: the nearest in the file between the two contactors does not close more slowly.
///
/// The file has velocities in the contact configuration of its last step, from which the bodies have turned by up to
/// ω `time_before`, so that points at the distance r move by ω² r `time_before` faster.
fn bounded_by_file(state: &State, start: &ContactConfiguration, contact: &Contact, u: f64, time_before: f64) -> bool {
    let pair = |c: &Contact| (c.candidate, c.antagonist, c.part_numbers);
    let first = state.contacts.partition_point(|old| pair(&old.contact) < pair(contact));
    let of_same_pair = state.contacts[first..].iter().take_while(|old| pair(&old.contact) == pair(contact));
    let without_features = of_same_pair.filter(|old| old.contact.features.0 == UNKNOWN_FEATURE);
    let distance = |old: &SolvedContact| (old.contact.point - contact.point).norm_squared();
    let Some(nearest) = without_features.min_by(|a, b| distance(a).total_cmp(&distance(b))) else { return false };
    let centripetal_acceleration = |body: BodyId| {
        let i = body.index();
        start.w[i].norm_squared() * (contact.point - start.x[i]).norm()
    };
    let velocities = Velocities { v: &state.v, w: &start.w };
    let rounding = SPEED_DIGITS * relative_velocity(contact, &start.x, velocities).norm();
    u >= nearest.velocity.x
        - rounding
        - time_before * (centripetal_acceleration(contact.candidate) + centripetal_acceleration(contact.antagonist))
}

/// Work that the choice of θ = 1 adds in a step that is taken with it, compared with the scene's θ, J: the bodies'
/// displacement is longer by (1-θ) h (V⁺ - V), on which the forces that have a potential work.
pub fn implicit_step_work(
    scene: &Scene,
    state: &State,
    q_c: &ContactConfiguration,
    free: &FreeMotion,
    v: &[Vec3],
) -> f64 {
    if !q_c.implicit {
        return 0.0;
    }
    let mut imposed = vec![Vec3::zeros(); scene.bodies.len()];
    free.loads.iter().for_each(|load| imposed[load.body.index()] += load.force * q_c.h);
    let work = |i: usize| {
        let impulse = (free.v[i] - state.v[i]) * scene.bodies[i].mass - imposed[i];
        let impulse = impulse - scene.bodies[i].imposed_part(&impulse);
        -(1.0 - scene.options.theta) * impulse.dot(&(v[i] - state.v[i]))
    };
    scene.free.iter().chain(&scene.held_grains).map(|&i| i.index()).map(work).sum()
}
