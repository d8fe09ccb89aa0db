//! Length of the next step with the option `adaptive`: `dt`, or a multiple of it while bodies move little.
//!
//! Steps, snapshots and the end of a run are counted in multiples of `dt`. A step of several `dt` ends at the same time
//! as that many steps of one `dt`. The length follows from the result of the last step, so that it is the same in a
//! resumed run:
//!
//! - neighbours pass each other by at most `travel` radii plus half of their gap;
//! - approaching bodies overlap, in the contact configuration, by at most `penetration` radii;
//! - a body that is not a sphere turns by at most `travel` radians;
//! - the shortest orbit, and the fastest rotation of a field, take at least fifty steps;
//! - a step is at most twice as long as the one before, and ends at snapshots, events and the end of the run.
//!
//! Detection covers twice the length of a step ([`MAX_STEP_GROWTH`]), so that a pair that the next step could bring into
//! contact is known when its length is chosen. At the start of a run no pair is known, and the first step is `dt`. While
//! an imposed velocity or force changes, steps are `dt`, and no longer step reaches into such a time. In a deforming cell
//! all steps are `dt`.

use std::f64::consts::{PI, TAU};

use cd_formats::compute::ExternalField;
use cd_formats::field::FieldModel;
use rayon::prelude::*;

use crate::math::Vec3;
use crate::ranks::lists::min_over_ranks;
use crate::scene::{BodyId, BodyShape, EVENT_SLACK, ImposedVelocity, RigidBody, Scene};
use crate::state::{SolvedContact, State};

/// Steps in the shortest orbit or rotation of a field: a phase error of 1e-3 per orbit.
const STEPS_PER_ORBIT: f64 = 50.0;

/// Largest ratio of a step to the one before; detection covers this multiple of the step.
pub const MAX_STEP_GROWTH: u64 = 2;

/// Number of `dt` in the next step. `velocities_changed`: whether velocities have been changed since the last step,
/// so that those of the contacts are not known.
pub fn choose_step_multiple(scene: &Scene, state: &State, velocities_changed: bool) -> u64 {
    let adaptive = scene.options.adaptive();
    let knows_neighbours = state.step > scene.start.step && !velocities_changed;
    if !adaptive.is_on() || !knows_neighbours || state.cell.is_some() || !state.radii.is_empty() {
        return 1;
    }
    let constant_time = scene.constant_until(state.time) - state.time;
    if constant_time <= 0.0 {
        return 1;
    }
    let dt = scene.options.dt;
    let last_multiple = (state.h / dt).round().max(1.0);
    let largest = (MAX_STEP_GROWTH as f64 * last_multiple).min(adaptive.max_multiple as f64);
    let time_limit = |contact: &SolvedContact| contact_time_limit(scene, state, contact);
    let own_limit = state.contacts.par_iter().with_min_len(1024).map(time_limit).reduce(|| f64::INFINITY, f64::min);
    let contact_limit = if state.detection_cache.is_divided() { min_over_ranks(own_limit) } else { own_limit };
    let turn_limit = adaptive.travel / fastest_spin(scene, state);
    let orbit_limit = shortest_orbit(scene, state).min(shortest_rotation(scene)) / STEPS_PER_ORBIT;
    let multiple = contact_limit.min(turn_limit).min(orbit_limit).min(constant_time) / dt;
    // A quotient that is whole up to rounding counts as whole.
    let multiple = (multiple.min(largest) * (1.0 + 1e-12)).floor().max(1.0) as u64;
    // Equal steps up to the next stop.
    let remaining = steps_to_next_stop(scene, state).max(1);
    remaining.div_ceil(remaining.div_ceil(multiple))
}

/// Longest step that a pair of near bodies allows, s.
fn contact_time_limit(scene: &Scene, state: &State, solved: &SolvedContact) -> f64 {
    let SolvedContact { contact, velocity, .. } = solved;
    let adaptive = scene.options.adaptive();
    let theta = scene.options.theta;
    let bodies = [contact.candidate, contact.antagonist].map(|i| &scene.bodies[i.index()]);
    let smallest = |is_meant: fn(&RigidBody) -> bool| {
        bodies.iter().filter(|body| is_meant(body)).map(|body| body.radius).fold(f64::INFINITY, f64::min)
    };
    // Walls with a force, which are driven in part, count only against each other.
    let free_radius = smallest(|body| !body.driven);
    let radius = if free_radius.is_finite() { free_radius } else { smallest(RigidBody::is_driven_in_part) };
    let gap = (contact.gap + theta * state.h * velocity.x).max(0.0);
    let travel = (adaptive.travel * radius + 0.5 * gap) / velocity.norm();
    // Velocities of the step's start move bodies for (1-θ) h to the contact configuration; at least 0.1, so that
    // θ = 1 keeps a limit. `f64::max` of -0 and 0 may be either, and a distance over -0 is -∞.
    let closing_velocity = if velocity.x < 0.0 { -velocity.x } else { 0.0 };
    let approach_speed = closing_velocity * (1.0 - theta).max(0.1);
    travel.min((adaptive.penetration * radius + gap) / approach_speed)
}

/// Largest angular speed of a body that is not a sphere, rad/s; independent of its moments of inertia, as its contacts
/// turn with it.
pub fn fastest_spin(scene: &Scene, state: &State) -> f64 {
    let turning = scene.bodies.iter().zip(&state.w).filter(|(body, _)| !body.is_sphere());
    turning.map(|(_, w)| w.norm()).fold(0.0, f64::max)
}

/// Largest speed of a moving body and of a point of a driven one relative to the centre of mass of the moving bodies, m/s.
pub fn largest_speed(scene: &Scene, state: &State) -> f64 {
    let moving_ids = scene.moving_bodies();
    let body_mass = |i: &BodyId| scene.bodies[i.index()].mass;
    let mass: f64 = moving_ids.iter().map(body_mass).sum();
    let mean_velocity = moving_ids.iter().map(|i| state.v[i.index()] * body_mass(i)).sum::<Vec3>() / mass;
    let speeds = moving_ids.iter().map(|i| (state.v[i.index()] - mean_velocity).norm());
    let times = [state.time, scene.end_time().max(state.time)];
    let driven_speeds = scene.drives.iter().map(|drive| max_drive_speed(scene, drive, &mean_velocity, times));
    speeds.chain(driven_speeds).fold(0.0, f64::max)
}

/// Largest speed of a point of a driven body relative to the velocity `mean_velocity` (m/s) between two times (s), m/s;
/// the rotation of a sphere does not count.
fn max_drive_speed(scene: &Scene, drive: &ImposedVelocity, mean_velocity: &Vec3, times: [f64; 2]) -> f64 {
    let reach = match scene.bodies[drive.body.index()].shape {
        BodyShape::Sphere { .. } => 0.0,
        BodyShape::Plane { half_lengths } => half_lengths.norm(),
        BodyShape::Parts => {
            let parts = scene.parts_of(drive.body).iter();
            parts.map(|part| part.offset.norm() + part.bounding_radius).fold(0.0, f64::max)
        }
    };
    let velocity_change =
        |k: usize, from: f64| drive.velocity[k].as_ref().map_or(0.0, |value| value.max_difference(from, times));
    let speed = Vec3::from_fn(|k, _| velocity_change(k, mean_velocity[k])).norm();
    let spin = Vec3::from_fn(|k, _| velocity_change(3 + k, 0.0)).norm();
    let reach = reach + drive.pivot.map_or(0.0, |pivot| pivot.offset.norm());
    speed + spin * reach + drive.radial_speed
}

/// Period of the fastest rotation of a field, s: of rotating axes, of a polyhedron that turns.
pub fn shortest_rotation(scene: &Scene) -> f64 {
    scene.options.fields.iter().map(ExternalField::rotation_period).fold(f64::INFINITY, f64::min)
}

/// Period of the fastest possible orbit outside of bodies, s: in self-gravity and about primaries.
pub fn shortest_orbit(scene: &Scene, state: &State) -> f64 {
    let nearest_to =
        |centre: &Vec3| scene.free.iter().map(|&i| (state.x[i.index()] - centre).norm()).fold(f64::INFINITY, f64::min);
    let period_in = |field: FieldModel| match field {
        FieldModel::RotatingAxes { .. } => f64::INFINITY,
        FieldModel::Primary { strength, centre, .. } => TAU * (nearest_to(&centre).powi(3) / strength).sqrt(),
        FieldModel::Polyhedron { strength, shape, position, rotation, falling_point, .. } => {
            let from_position = rotation.map_or(shape.centre(), |rotation| rotation * shape.centre());
            let centre = if falling_point.is_some() { position } else { position + from_position };
            // Inside of the body the attraction is at most about that at the surface of the ball of equal volume.
            let distance = nearest_to(&centre).max(libm::cbrt(shape.volume() * 0.75 / PI));
            TAU * (distance.powi(3) / (strength * shape.volume())).sqrt()
        }
    };
    let surface_period =
        scene.surface_gravity().map_or(f64::INFINITY, |(radius, gravity)| TAU * (radius / gravity).sqrt());
    state.external_fields(scene, 0.0).into_iter().map(period_in).fold(surface_period, f64::min)
}

/// Units of `dt` up to the next snapshot, event or the end.
fn steps_to_next_stop(scene: &Scene, state: &State) -> u64 {
    let every = scene.options.output_every;
    let snapshot = every - state.step % every;
    let end = scene.last_step().saturating_sub(state.step);
    let time_to_event = scene.events.get(state.events_done).map_or(f64::INFINITY, |event| event.time - state.time);
    let event = (time_to_event / scene.options.dt - EVENT_SLACK).ceil().max(1.0) as u64;
    snapshot.min(end).min(event)
}
