//! Stage: the theta-scheme of Moreau and Jean, before and after the contact problem.
//!
//! x_c = x + h (1-theta) V,   x⁺ = x_c + h theta V⁺, and the same for rotations.
//!
//! A sphere's rotation needs only the impulses. Its orientation is integrated only if requested, or if a moment or a
//! rotation is imposed in its own axes. Bodies of unequal moments rotate freely before and after the impulses, which
//! change their angular momentum in space.
//! Sources: M. Jean (1999), section 5; J.J. Moreau, CISM 302 (1988); see [`crate::math::rotation`].

mod length;

pub use length::{
    MAX_STEP_GROWTH, choose_step_multiple, fastest_spin, largest_speed, shortest_orbit, shortest_rotation,
};

use std::borrow::Cow;
use std::collections::BTreeSet;

use cd_formats::deforming_cell::CellState;
use cd_formats::geometry::periodic_cell::PeriodicCell;
use cd_formats::hollow_radius::RadiusState;
use rayon::prelude::*;

use crate::math::rotation::{angular_momentum, angular_velocity, constrained_rotation, free_rotation};
use crate::math::{Mat3, PAR_MIN_LEN, Quat, Vec3, morton, rotate_by_vector};
use crate::scene::{BodyId, ChangingRadius, RadialGrowth, RigidBody, Scene, SurfaceMotion};
use crate::state::{ContactKey, State, Velocities};

/// Configuration in which contacts are detected and forces evaluated.
pub struct ContactConfiguration {
    /// Positions, m.
    pub x: Vec<Vec3>,
    /// Orientations; orientations of [`Scene::oriented`] bodies are predicted.
    pub q: Vec<Quat>,
    /// Angular velocities of the step's start, predicted by free rotation, rad/s, world frame.
    pub w: Vec<Vec3>,
    /// Angular momenta of [`State::angular_momentum`], predicted by free rotation.
    pub angular_momentum: Vec<Vec3>,
    /// Cell of the scene.
    pub cell: PeriodicCell,
    /// Motion of the cell, if it deforms.
    pub cell_step: Option<CellStep>,
    /// Motion of the radii of hollow cylinders that change, in the order of [`Scene::radii`].
    pub radii: Vec<RadiusStep>,
    /// Mean velocity of the free bodies at the step's start, in a deforming cell about the affine field, m/s; it changes no
    /// distance between them.
    pub mean_velocity: Vec3,
    /// Bodies ordered along Morton's curve.
    pub order: Vec<u32>,
    /// Number of `dt` in the step.
    pub step_multiple: u64,
    /// Length of the step, s.
    pub h: f64,
    /// Time for which contacts are predicted, s.
    pub lookahead: f64,
    /// Whether the velocities of bodies have changed since the end of the last step.
    pub changed: bool,
    /// Whether the step is taken with θ = 1, x_c = x and x⁺ = x + h V⁺, in place of the scene's θ.
    pub implicit: bool,
    /// Bodies that keep their orientation from this contact configuration to the next.
    pub orientation_kept: BTreeSet<BodyId>,
    /// Bodies of `orientation_kept` that contacts push at their centres, as if these bodies had no rotation.
    pub pushed_at_centre: BTreeSet<BodyId>,
    /// Open contacts that other contacts close in this step although the free velocities do not.
    pub closed_by_others: BTreeSet<ContactKey>,
}

/// Motion of a deforming cell in a step.
///
/// The edges H move as imposed positions do: H_c = H + (1-θ) h Ḣ, H⁺ = H_c + θ h Ḣ⁺, h Ḣ⁺ = (exp(L h) - 1) H_c. An image
/// is the sum H n of whole edges from its body, in every configuration with the same numbers n, and moves by Ḣ n relative
/// to it.
#[derive(Debug, Clone, Copy)]
pub struct CellStep {
    /// Cell in the contact configuration, with the rates of the step's end.
    pub state: CellState,
    /// Velocity gradient in the contact configuration by the rates of the step's start, 1/s.
    pub start_gradient: Mat3,
    /// Velocity gradient in the contact configuration by the rates of the step's end, 1/s.
    pub end_gradient: Mat3,
    /// Acceleration gradient (Ḣ⁺ - Ḣ) H_c⁻¹/h, 1/s²; None if the rates of the edges stay as they are. With the acceleration of
    /// bodies by it times their positions, all images of a body have the same motion about the affine field.
    pub acceleration_gradient: Option<Mat3>,
    /// Shear rates xy, xz and yz, 1/s.
    shear_rates: [f64; 3],
}

impl CellStep {
    /// Motion in a step of the length `h` (s), of which the time `time_before` (s) is before the contact configuration; None if
    /// the cell of the state does not deform.
    fn new(scene: &Scene, state: &State, h: f64, time_before: f64) -> Option<CellStep> {
        let start = state.cell?;
        let moved = start.moved_by(time_before);
        let control = scene.options.cell.unwrap_or_default();
        let rates = control.velocity_gradient(&start.mean_stress);
        let mut gradient = rates;
        if h > 0.0 {
            // From one contact configuration to the next the edges change by exp(L h), in shears up to the third order.
            gradient += rates * rates * (0.5 * h) + rates * rates * rates * (h * h / 6.0);
            (0..3).for_each(|axis| gradient[(axis, axis)] = libm::expm1(rates[(axis, axis)] * h) / h);
        }
        let cell = moved.with_gradient(&gradient);
        let (start_gradient, end_gradient) = (moved.gradient(), cell.gradient());
        let is_same = (cell.period_rates, cell.shear_rates) == (moved.period_rates, moved.shear_rates);
        let acceleration_gradient = (!is_same && h > 0.0).then(|| (end_gradient - start_gradient) / h);
        let shear_rates = [control.shear_xy, control.shear_xz, control.shear_yz];
        Some(CellStep { start_gradient, end_gradient, acceleration_gradient, shear_rates, state: cell })
    }

    /// Cell at the step's end, the time `time_after` (s) after the contact configuration, in a step of the length `h` (s).
    fn end_state(&self, h: f64, time_after: f64) -> CellState {
        let mut cell = self.state.moved_by(time_after).reduced_cell();
        cell.shear_strains.iter_mut().zip(self.shear_rates).for_each(|(strain, rate)| *strain += rate * h);
        cell
    }
}

/// Motion of the radius R of a hollow cylinder in a step.
///
/// It moves as imposed positions do: R_c = R + (1-θ) h Ṙ, R⁺ = R_c + θ h Ṙ⁺, h Ṙ⁺ = (exp(ε̇ h) - 1) R_c with the rate ε̇ of ln R.
#[derive(Debug, Clone, Copy)]
pub struct RadiusStep {
    pub body: BodyId,
    /// Radius in the contact configuration, with the speed of the step's end.
    pub state: RadiusState,
    /// Radial speed of the step's start, m/s.
    start_speed: f64,
}

impl RadiusStep {
    /// Motions in a step of the length `h` (s), of which the time `time_before` (s) is before the contact configuration.
    fn steps(scene: &Scene, state: &State, h: f64, time_before: f64) -> Vec<RadiusStep> {
        let radius_step = |(changing, start): (&ChangingRadius, &RadiusState)| {
            let rate = changing.control.control.strain_rate(start.mean_stress);
            let state = start.moved_by(time_before).with_strain_rate(rate, h);
            RadiusStep { body: changing.body, state, start_speed: start.speed }
        };
        scene.radii.iter().zip(&state.radii).map(radius_step).collect()
    }
}

impl ContactConfiguration {
    /// Motions of the surfaces of walls at the step's start, at the time `start` (s).
    pub fn start_surfaces(&self, scene: &Scene, start: f64) -> Vec<SurfaceMotion> {
        self.surfaces(scene, start, |radius| radius.start_speed)
    }

    /// Motions of the surfaces of walls at the step's end, at the time `end` (s).
    pub fn end_surfaces(&self, scene: &Scene, end: f64) -> Vec<SurfaceMotion> {
        self.surfaces(scene, end, |radius| radius.state.speed)
    }

    /// Motions of the surfaces of walls at a time (s) with these radial speeds, m/s.
    fn surfaces(&self, scene: &Scene, time: f64, radial_speed: impl Fn(&RadiusStep) -> f64) -> Vec<SurfaceMotion> {
        let mut surfaces = scene.surface_motions(time, &self.q);
        for (changing, radius) in scene.radii.iter().zip(&self.radii) {
            let axis = self.q[radius.body.index()] * changing.axis;
            let growth = Some(RadialGrowth { axis, speed: radial_speed(radius) });
            match surfaces.iter_mut().find(|surface| surface.body == radius.body) {
                Some(surface) => surface.growth = growth,
                None => {
                    surfaces.push(SurfaceMotion { body: radius.body, v: Vec3::zeros(), w: Vec3::zeros(), growth });
                }
            }
        }
        surfaces
    }

    /// Radius of a hollow cylinder that changes, m; None for other bodies.
    pub fn changing_radius(&self, body: BodyId) -> Option<f64> {
        self.radii.iter().find(|radius| radius.body == body).map(|radius| radius.state.radius)
    }

    /// Velocity gradient of a deforming cell by the rates of the step's start, 1/s.
    pub fn start_gradient(&self) -> Option<&Mat3> {
        self.cell_step.as_ref().map(|cell| &cell.start_gradient)
    }

    /// Velocity gradient of a deforming cell by the rates of the step's end, 1/s.
    pub fn end_gradient(&self) -> Option<&Mat3> {
        self.cell_step.as_ref().map(|cell| &cell.end_gradient)
    }

    /// Whether contacts push a body at its centre, as if it had no rotation; of most scenes no body.
    #[inline]
    pub fn is_pushed_at_centre(&self, body: BodyId) -> bool {
        !self.pushed_at_centre.is_empty() && self.pushed_at_centre.contains(&body)
    }

    /// Velocity `v` (m/s) of body `i` beyond the mean velocity, in a deforming cell about the affine field, m/s.
    pub fn relative_motion(&self, i: usize, v: &Vec3) -> Vec3 {
        match self.end_gradient() {
            Some(gradient) => v - self.mean_velocity - gradient * self.x[i],
            None => v - self.mean_velocity,
        }
    }

    /// Time in which the step's end velocities take the bodies from this contact configuration to the next if the next step
    /// is as long, s: h, and (2-θ) h if this step is taken with θ = 1.
    pub fn reach_time(&self, scene: &Scene) -> f64 {
        if self.implicit { self.h * (2.0 - scene.options.theta) } else { self.h }
    }

    /// Time from this contact configuration to the step's end for the orientation of a body, s: h θ, h in a step that is taken
    /// with θ = 1, and -(1-θ) h for a body that keeps its orientation to the next contact configuration, since the next step
    /// begins with a rotation in the time (1-θ) h.
    fn turning_time(&self, scene: &Scene, body: BodyId) -> f64 {
        let theta = scene.options.theta;
        match self.implicit {
            _ if self.orientation_kept.contains(&body) => -(1.0 - theta) * self.h,
            true => self.h,
            false => self.h * theta,
        }
    }

    /// Angular velocities `w`, with 0 for `bodies`.
    pub fn without_spins<'a>(w: &'a [Vec3], bodies: &BTreeSet<BodyId>) -> Cow<'a, [Vec3]> {
        let mut w = Cow::Borrowed(w);
        bodies.iter().for_each(|body| w.to_mut()[body.index()] = Vec3::zeros());
        w
    }
}

/// Smallest number of freely rotating bodies per task; each takes half a microsecond.
const MIN_TURNING_PER_TASK: usize = 64;

/// Contact configuration of a step of `step_multiple` times `dt`, from the velocities at the step's start.
pub fn predict_configuration(scene: &Scene, state: &State, step_multiple: u64) -> ContactConfiguration {
    let h = step_multiple as f64 * scene.options.dt;
    let time_before = h * (1.0 - scene.options.theta);
    let x: Vec<Vec3> =
        state.x.par_iter().zip(&state.v).with_min_len(PAR_MIN_LEN).map(|(x, v)| x + v * time_before).collect();
    let predicted_orientation = |((q, oriented), w): ((&Quat, &bool), &Vec3)| {
        if *oriented { rotate_by_vector(q, &(w * time_before)) } else { *q }
    };
    let orientations = state.q.par_iter().zip(&scene.oriented).zip(&state.w);
    let mut q: Vec<Quat> = orientations.with_min_len(PAR_MIN_LEN).map(predicted_orientation).collect();
    let mut w = state.w.clone();
    let (frame_rate, mut momenta) = (scene.frame_angular_velocity(), state.angular_momentum.clone());
    let predict_rotation = |(&i, momentum): (&BodyId, &mut Vec3)| {
        let (i, inertia) = (i.index(), &scene.bodies[i.index()].inertia);
        let q = turn_in_axes(&state.q[i], momentum, inertia, &frame_rate, time_before);
        (q, angular_velocity(&q, inertia, momentum))
    };
    let rotations: Vec<_> = scene
        .free_rotors
        .par_iter()
        .zip(&mut momenta)
        .with_min_len(MIN_TURNING_PER_TASK)
        .map(predict_rotation)
        .collect();
    for (&i, rotation) in scene.free_rotors.iter().zip(rotations) {
        (q[i.index()], w[i.index()]) = rotation;
    }
    for &body in &scene.constrained_rotors {
        let i = body.index();
        (q[i], w[i]) = rotate_constrained(&scene.bodies[i], &state.q[i], &state.w[i], time_before);
    }
    let lookahead = if scene.options.adaptive().is_on() { MAX_STEP_GROWTH as f64 * h } else { h };
    let order = morton::morton_order(&x, &state.order);
    let cell_step = CellStep::new(scene, state, h, time_before);
    let affine_velocity = |i: usize| cell_step.as_ref().map_or(Vec3::zeros(), |cell| cell.start_gradient * x[i]);
    let sum: Vec3 = scene.free.iter().map(|&i| state.v[i.index()]).sum();
    let affine_sum: Vec3 = match cell_step {
        Some(_) => scene.free.iter().map(|&i| affine_velocity(i.index())).sum(),
        None => Vec3::zeros(),
    };
    let mean_velocity = (sum - affine_sum) / scene.free.len().max(1) as f64;
    ContactConfiguration {
        x,
        q,
        w,
        angular_momentum: momenta,
        cell: cell_step.map_or_else(|| scene.periodic_cell(), |cell| cell.state.cell()),
        cell_step,
        radii: RadiusStep::steps(scene, state, h, time_before),
        mean_velocity,
        order,
        step_multiple,
        h,
        lookahead,
        changed: false,
        implicit: false,
        orientation_kept: BTreeSet::new(),
        pushed_at_centre: BTreeSet::new(),
        closed_by_others: BTreeSet::new(),
    }
}

/// Contact configuration of a step of `step_multiple` times `dt` that is taken with θ = 1: the configuration at its start.
pub fn implicit_configuration(scene: &Scene, state: &State, step_multiple: u64) -> ContactConfiguration {
    let predicted = predict_configuration(scene, state, step_multiple);
    let cell_step = CellStep::new(scene, state, predicted.h, 0.0);
    ContactConfiguration {
        cell: cell_step.map_or(predicted.cell, |cell| cell.state.cell()),
        cell_step,
        radii: RadiusStep::steps(scene, state, predicted.h, 0.0),
        x: state.x.clone(),
        q: state.q.clone(),
        w: state.w.clone(),
        angular_momentum: state.angular_momentum.clone(),
        order: morton::morton_order(&state.x, &state.order),
        lookahead: predicted.lookahead * (2.0 - scene.options.theta),
        implicit: true,
        ..predicted
    }
}

/// [`free_rotation`] in axes that rotate at `rate` (rad/s), in which orientation and `momentum` are given before and
/// after. In fixed axes that coincide with these at the start the body has J W more momentum, W the rate of the axes; it
/// rotates freely in these, and the axes then turn by W h.
fn turn_in_axes(q: &Quat, momentum: &mut Vec3, inertia: &[f64; 3], rate: &Vec3, h: f64) -> Quat {
    if *rate == Vec3::zeros() {
        return free_rotation(q, momentum, inertia, h);
    }
    let fixed_momentum = *momentum + angular_momentum(q, inertia, rate);
    let back = rate * -h;
    let q = rotate_by_vector(&free_rotation(q, &fixed_momentum, inertia, h), &back);
    *momentum = Quat::from_scaled_axis(back) * fixed_momentum - angular_momentum(&q, inertia, rate);
    q
}

/// [`constrained_rotation`] of a body.
fn rotate_constrained(body: &RigidBody, q: &Quat, w: &Vec3, h: f64) -> (Quat, Vec3) {
    let [_, _, _, free @ ..] = body.free_components;
    constrained_rotation(q, w, &body.inertia, free, h)
}

/// Advances the state to the step's end with the velocities `v`, `w` of the bodies in the contact configuration after all
/// impulses.
pub fn advance_state(scene: &Scene, state: &mut State, q_c: &ContactConfiguration, v: Vec<Vec3>, mut w: Vec<Vec3>) {
    let h = q_c.h;
    let time_after = if q_c.implicit { h } else { h * scene.options.theta };
    let driven = DrivenBodies::new(scene, state, q_c);
    let energy_before = held_rotational_energy(scene, &q_c.q, &w);
    let advance_position = |((x, x_c), v): ((&mut Vec3, &Vec3), &Vec3)| *x = x_c + v * time_after;
    state.x.par_iter_mut().zip(&q_c.x).zip(&v).with_min_len(PAR_MIN_LEN).for_each(advance_position);
    let advance_orientation = |(i, (q, oriented)): (usize, (&mut Quat, &bool))| {
        if *oriented {
            *q = rotate_by_vector(&q_c.q[i], &(w[i] * q_c.turning_time(scene, BodyId::new(i))));
        }
    };
    state.q.par_iter_mut().zip(&scene.oriented).with_min_len(PAR_MIN_LEN).enumerate().for_each(advance_orientation);
    let frame_rate = scene.frame_angular_velocity();
    let advance_rotation = |((&body, momentum), predicted): ((&BodyId, &mut Vec3), &Vec3)| {
        let (i, inertia) = (body.index(), &scene.bodies[body.index()].inertia);
        // A body without impulses keeps its momentum to the last bit.
        let after_impulses = predicted + angular_momentum(&q_c.q[i], inertia, &(w[i] - q_c.w[i]));
        let mut at_end = after_impulses;
        let q = turn_in_axes(&q_c.q[i], &mut at_end, inertia, &frame_rate, q_c.turning_time(scene, body));
        let change_by_axes = (predicted - *momentum) + (at_end - after_impulses);
        *momentum = at_end;
        (q, angular_velocity(&q, inertia, &at_end), change_by_axes)
    };
    let turning = scene.free_rotors.par_iter().zip(&mut state.angular_momentum).zip(&q_c.angular_momentum);
    let rotations: Vec<_> = turning.with_min_len(MIN_TURNING_PER_TASK).map(advance_rotation).collect();
    let mut change_by_axes = Vec3::zeros();
    for (&i, (q, angular_velocity, term)) in scene.free_rotors.iter().zip(rotations) {
        (state.q[i.index()], w[i.index()]) = (q, angular_velocity);
        change_by_axes += term;
    }
    if frame_rate != Vec3::zeros() {
        state.ledger.angular_momentum_expected.iter_mut().zip(&change_by_axes).for_each(|(sum, term)| *sum += term);
    }
    for &body in &scene.constrained_rotors {
        let i = body.index();
        (state.q[i], w[i]) = rotate_constrained(&scene.bodies[i], &q_c.q[i], &w[i], time_after);
    }
    driven.advance_state(scene, state, q_c, Velocities { v: &v, w: &w, gradient: None, surfaces: &[] });
    if let (Some(step), Some(cell)) = (&q_c.cell_step, &mut state.cell) {
        *cell = CellState { mean_stress: cell.mean_stress, ..step.end_state(h, time_after) };
    }
    for (radius, step) in state.radii.iter_mut().zip(&q_c.radii) {
        *radius =
            RadiusState { mean_stress: radius.mean_stress, height: radius.height, ..step.state.moved_by(time_after) };
    }
    // No impulse acts from the contact configuration to the step's end: only the moments that impose rotations change this
    // energy.
    state.ledger.outside_work += held_rotational_energy(scene, &state.q, &w) - energy_before;
    state.v = v;
    state.w = w;
    state.h = h;
    state.step += q_c.step_multiple;
    state.time = scene.time_at(state.step);
}

/// Advances the primary that responds to the bodies, to which it has given the `impulse` (N s), as a body of its mass.
pub fn advance_response(scene: &Scene, state: &mut State, q_c: &ContactConfiguration, impulse: &Vec3) {
    let Some(response) = &mut state.primary_response else { return };
    let mass = scene.primary_mass();
    let theta = if q_c.implicit { 1.0 } else { scene.options.theta };
    let mut contact_response = response.free_motion((1.0 - theta) * q_c.h);
    contact_response.velocity.iter_mut().zip(impulse.iter()).for_each(|(v, impulse)| *v -= impulse / mass);
    *response = contact_response.free_motion(theta * q_c.h);
}

/// Energy of the rotation of grains that is imposed about some of their axes, J.
pub fn held_rotational_energy(scene: &Scene, q: &[Quat], w: &[Vec3]) -> f64 {
    let in_part = scene.held_grains.iter().map(|i| i.index()).filter(|&i| scene.bodies[i].rotates_in_part());
    in_part.map(|i| scene.bodies[i].rotational_energy(&q[i], &w[i])).sum()
}

/// Driven bodies of a step that is taken with θ = 1; their imposed motion is the same as in any step.
struct DrivenBodies(Vec<DrivenStart>);

/// A driven body of such a step.
struct DrivenStart {
    body: usize,
    /// Position (m) and orientation that it would have in the contact configuration.
    x: Vec3,
    q: Quat,
    /// Angular velocity at the step's start along its own axes, rad/s.
    rate: Vec3,
}

impl DrivenBodies {
    /// Positions and orientations that they would have in the contact configuration with the scene's θ; none if the step
    /// is taken with that.
    fn new(scene: &Scene, state: &State, q_c: &ContactConfiguration) -> Self {
        let time_before = q_c.h * (1.0 - scene.options.theta);
        let driven = (0..scene.bodies.len()).filter(|&i| q_c.implicit && scene.bodies[i].driven);
        let start = |i: usize| DrivenStart {
            body: i,
            x: state.x[i] + state.v[i] * time_before,
            q: rotate_by_vector(&state.q[i], &(state.w[i] * time_before)),
            rate: state.q[i].inverse_transform_vector(&state.w[i]),
        };
        DrivenBodies(driven.map(start).collect())
    }

    /// Advances these bodies from there to the step's end; along and about axes of which the motion is not imposed, from the
    /// start by h V⁺.
    fn advance_state(self, scene: &Scene, state: &mut State, q_c: &ContactConfiguration, end: Velocities) {
        let Velocities { v, w, .. } = end;
        let time_after = q_c.h * scene.options.theta;
        for DrivenStart { body: i, x, q, rate } in self.0 {
            let imposed_x = x + v[i] * time_after;
            let free_x = q_c.x[i] + v[i] * q_c.h;
            let body = &scene.bodies[i];
            state.x[i] = Vec3::from_fn(|k, _| if body.free_components[k] { free_x[k] } else { imposed_x[k] });
            if body.rotates_in_part() {
                // The state has turned by h W⁺; the imposed rates are those of the step's start for the time (1-θ) h.
                let change = rate - state.q[i].inverse_transform_vector(&w[i]);
                let missing_rate = Vec3::from_fn(|k, _| if body.free_components[3 + k] { 0.0 } else { change[k] });
                let turn = state.q[i] * (missing_rate * (q_c.h - time_after));
                state.q[i] = rotate_by_vector(&state.q[i], &turn);
            } else if scene.oriented[i] && !body.rotates_freely() {
                state.q[i] = rotate_by_vector(&q, &(w[i] * time_after));
            }
        }
    }
}
