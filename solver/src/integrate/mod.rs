//! Room: the theta-scheme of Moreau and Jean, before and after the contact problem.
//!
//! x_c = x + h (1-theta) V,   x⁺ = x_c + h theta V⁺, and the same for rotations.
//!
//! Spheres need no equation for their rotation beyond the impulses; an orientation they have only where asked for. Bodies of
//! unequal moments turn freely before and after the impulses, which change their angular momentum in space.
//! Sources: M. Jean (1999), section 5; J.J. Moreau, CISM 302 (1988); see [`crate::math::rotation`].

mod length;

pub use length::{fastest_turn, shortest_orbit, units};

use rayon::prelude::*;

use crate::math::rotation::{angular_momentum, angular_velocity, turn_freely};
use crate::math::{Quat, Vec3, morton, rotate};
use crate::scene::{Body, Scene};
use crate::state::State;

/// Where contacts are looked for and forces evaluated.
pub struct Configuration {
    pub x: Vec<Vec3>,
    /// Orientations; those of spheres are the step's first, as no contact depends on them.
    pub q: Vec<Quat>,
    /// Angular velocities of the step's start, carried here by free rotation, rad/s, world frame.
    pub w: Vec<Vec3>,
    /// Mean velocity of the free bodies at the step's start, m/s: what they share moves no two past each other.
    pub drift: Vec3,
    /// Bodies along Morton's curve.
    pub order: Vec<u32>,
    /// Length of the step in units of `dt`, and in s.
    pub units: u64,
    pub h: f64,
    /// How far ahead contacts are looked for, s.
    pub ahead: f64,
}

/// The contact configuration of a step of so many units of `dt`, from the velocities at the step's start.
pub fn predict(scene: &Scene, state: &State, units: u64) -> Configuration {
    let h = units as f64 * scene.options.dt;
    let before = h * (1.0 - scene.options.theta);
    let x: Vec<Vec3> = state.x.iter().zip(&state.v).map(|(x, v)| x + v * before).collect();
    let (mut q, mut w) = (state.q.clone(), state.w.clone());
    for (i, _) in scene.bodies.iter().enumerate().filter(|(_, body)| !body.is_sphere()) {
        q[i] = rotate(&q[i], &(state.w[i] * before));
    }
    for (&i, momentum) in scene.turning.iter().zip(&state.spin) {
        let (i, inertia) = (i as usize, &scene.bodies[i as usize].inertia);
        q[i] = turn_freely(&state.q[i], momentum, inertia, before);
        w[i] = angular_velocity(&q[i], inertia, momentum);
    }
    let ahead = if scene.options.adaptive().is_on() { length::GROWTH as f64 * h } else { h };
    let order = morton::order(&x, &state.order);
    let sum: Vec3 = scene.free.iter().map(|&i| state.v[i as usize]).sum();
    let drift = sum / scene.free.len().max(1) as f64;
    Configuration { x, q, w, drift, order, units, h, ahead }
}

/// Takes the state to the step's end with the velocities `v`, `w` that the bodies have in the contact configuration
/// after all impulses.
pub fn advance(scene: &Scene, state: &mut State, q_c: &Configuration, v: Vec<Vec3>, mut w: Vec<Vec3>) {
    let h = q_c.h;
    let (before, after) = (h * (1.0 - scene.options.theta), h * scene.options.theta);
    state.x.iter_mut().zip(&q_c.x).zip(&v).for_each(|((x, x_c), v)| *x = x_c + v * after);
    let oriented = scene.options.sphere_orientation;
    let turned = |(i, (q, body)): (usize, (&mut Quat, &Body))| match body.is_sphere() {
        true if oriented => *q = rotate(q, &(state.w[i] * before + w[i] * after)),
        true => {}
        false => *q = rotate(&q_c.q[i], &(w[i] * after)),
    };
    state.q.par_iter_mut().zip(&scene.bodies).with_min_len(512).enumerate().for_each(turned);
    for (&i, momentum) in scene.turning.iter().zip(&mut state.spin) {
        let (i, inertia) = (i as usize, &scene.bodies[i as usize].inertia);
        // What nothing has pushed keeps its momentum to the last bit.
        *momentum += angular_momentum(&q_c.q[i], inertia, &(w[i] - q_c.w[i]));
        state.q[i] = turn_freely(&q_c.q[i], momentum, inertia, after);
        w[i] = angular_velocity(&state.q[i], inertia, momentum);
    }
    state.v = v;
    state.w = w;
    state.h = h;
    state.step += q_c.units;
    state.time += h;
}
