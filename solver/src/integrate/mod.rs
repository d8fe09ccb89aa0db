//! Room: the theta-scheme of Moreau and Jean, before and after the contact problem.
//!
//! x_c = x + h (1-theta) V,   x⁺ = x_c + h theta V⁺, and the same for rotations.
//!
//! Spheres need no equation for their rotation beyond the impulses; their orientation follows for display.
//! Sources: M. Jean (1999), section 5; J.J. Moreau, CISM 302 (1988).

use crate::math::{Quat, Vec3, rotate};
use crate::scene::Scene;
use crate::state::State;

/// Where contacts are looked for and forces evaluated.
pub struct Configuration {
    pub x: Vec<Vec3>,
    /// Orientations; those of spheres are the step's first, since no contact depends on them.
    pub q: Vec<Quat>,
    /// Angle that each driven body turns by in the step, rad.
    pub turn: Vec<f64>,
}

/// The contact configuration from the velocities at the step's start.
pub fn predict(scene: &Scene, state: &State) -> Configuration {
    let h = scene.options.dt;
    let before = h * (1.0 - scene.options.theta);
    let x = state.x.iter().zip(&state.v).map(|(x, v)| x + v * before).collect();
    let mut q = state.q.clone();
    let mut turn = vec![0.0; q.len()];
    for &plane in &scene.planes {
        let i = plane as usize;
        q[i] = rotate(&q[i], &(state.w[i] * before));
        turn[i] = h * state.w[i].norm();
    }
    Configuration { x, q, turn }
}

/// Takes the state to the step's end with its velocities `v`, `w`.
pub fn advance(scene: &Scene, state: &mut State, q_c: &Configuration, v: Vec<Vec3>, w: Vec<Vec3>) {
    let h = scene.options.dt;
    let (before, after) = (h * (1.0 - scene.options.theta), h * scene.options.theta);
    for (i, body) in scene.bodies.iter().enumerate() {
        state.x[i] = q_c.x[i] + v[i] * after;
        state.q[i] = if body.is_sphere() {
            rotate(&state.q[i], &(state.w[i] * before + w[i] * after))
        } else {
            rotate(&q_c.q[i], &(w[i] * after))
        };
    }
    state.v = v;
    state.w = w;
    state.h = h;
    state.step += 1;
    state.time += h;
}
