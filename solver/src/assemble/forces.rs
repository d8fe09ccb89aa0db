//! External forces: uniform gravity, outer fields, imposed and Coriolis forces; and free velocities.

use cd_formats::field::FieldModel;
use rayon::prelude::*;

use super::events::{ShakeEvent, shake_loads};
use super::self_gravity::{GravityReport, mutual_energy, near_field, point_masses, self_gravity};
use crate::integrate::ContactConfiguration;
use crate::math::{Mat3, PAR_MIN_LEN, Quat, Twist, Vec3, to_world};
use crate::scene::{BodyId, Scene, SurfaceMotion};
use crate::state::{BodyLoad, GravityHistory, State, Velocities};

/// Velocities at the step's end without contacts, and the contributions of the forces to the ledger.
pub struct FreeMotion {
    /// Velocities, m/s.
    pub v: Vec<Vec3>,
    /// Angular velocities, rad/s, world frame.
    pub w: Vec<Vec3>,
    /// Velocity gradient of a deforming cell at the step's end, 1/s.
    pub gradient: Option<Mat3>,
    /// Motions of the surfaces of walls at the step's end.
    pub surfaces: Vec<SurfaceMotion>,
    /// Potential energy of the grains in self-gravity, uniform gravity and outer fields, in the contact configuration, J.
    pub potential: f64,
    pub gravity: GravityReport,
    /// Self-gravity for the following steps, see [`GravityHistory`].
    pub attraction: Option<GravityHistory>,
    /// Impulse of uniform gravity, outer fields, imposed forces and a deforming cell on the free bodies, N s.
    pub impulse: Vec3,
    /// Angular impulse of these about the origin, N m s.
    pub angular_impulse: Vec3,
    /// Loads whose work depends on the displacement of the body: imposed ones, Coriolis forces and the pull of moving
    /// primaries. Imposed ones on grains driven in part are without the imposed components.
    pub loads: Vec<BodyLoad>,
    /// Impulse of the moving primaries on the bodies, N s.
    pub primary_impulse: Vec3,
    /// Work of the reactions that impose components of the velocities of grains driven in part, without those to contacts, J.
    pub reaction_work: f64,
}

impl FreeMotion {
    /// Velocities and angular velocities after the step without contact impulses.
    pub fn velocities(&self) -> Velocities<'_> {
        Velocities { v: &self.v, w: &self.w, gradient: self.gradient.as_ref(), surfaces: &self.surfaces }
    }

    /// Adds the change of velocity by a load over the step.
    fn apply_load(&mut self, scene: &Scene, q_c: &ContactConfiguration, load: &BodyLoad) {
        let i = load.body.index();
        let body = &scene.bodies[i];
        self.v[i] += load.force * (q_c.h * body.inverse_mass());
        self.w[i] += body.angular_velocity(&q_c.q[i], &(load.torque * q_c.h));
    }
}

/// Number of bodies whose effects are kept at once, 5 MB: those of a million bodies would be new pages of memory in each
/// step, as glibc does not keep arrays above 32 MB.
const BODIES_AT_ONCE: usize = 1 << 16;

/// Effect of self-gravity, uniform gravity and outer fields on a free body in a step.
struct FieldEffect {
    /// Change of its velocity by all of these, m/s.
    velocity_change: Vec3,
    /// Potential energy in uniform gravity and outer fields, J.
    potential_energy: f64,
    /// Impulse by uniform gravity and outer fields, N s.
    impulse: Vec3,
    /// Angular impulse about the origin by uniform gravity and outer fields, N m s.
    angular_impulse: Vec3,
    /// Force of moving and turning primaries, N.
    moving_force: Vec3,
}

/// Free velocities: V + h F/m with all forces in the contact configuration; imposed velocities at the step's end.
pub fn free_velocity(scene: &Scene, state: &State, q_c: &ContactConfiguration, shakes: &[ShakeEvent]) -> FreeMotion {
    let h = q_c.h;
    let mut self_gravity = self_gravity(scene, state, q_c);
    let near_field = near_field(scene, &q_c.x, &q_c.q);
    self_gravity.energy += near_field.energy;
    let outside = state.external_fields(scene, (1.0 - scene.options.theta) * h);
    let any_is_moving = outside.iter().any(FieldModel::is_moving);
    let mut free = FreeMotion {
        v: state.v.clone(),
        w: q_c.w.clone(),
        gradient: q_c.end_gradient().copied(),
        surfaces: Vec::new(),
        potential: self_gravity.energy,
        gravity: self_gravity.report,
        attraction: self_gravity.next,
        impulse: Vec3::zeros(),
        angular_impulse: Vec3::zeros(),
        loads: Vec::new(),
        primary_impulse: Vec3::zeros(),
        reaction_work: 0.0,
    };
    // `field`: external field at the body, if it is known.
    let field_effect = |k: usize, i: BodyId, field: Option<FieldValue>| {
        let i = i.index();
        let (mass, x) = (scene.bodies[i].mass, q_c.x[i]);
        let field = field.unwrap_or_else(|| external_field(&outside, state.gravity, &x));
        let attraction = self_gravity.acceleration.get(k).copied().unwrap_or_default();
        let impulse = field.acceleration * (mass * h);
        FieldEffect {
            velocity_change: (field.acceleration + attraction) * h,
            potential_energy: mass * field.potential,
            impulse,
            angular_impulse: x.cross(&impulse),
            moving_force: field.moving_acceleration * mass,
        }
    };
    let mut effects: Vec<FieldEffect> = Vec::new();
    for first in (0..scene.free.len()).step_by(BODIES_AT_ONCE) {
        let bodies = &scene.free[first..scene.free.len().min(first + BODIES_AT_ONCE)];
        let fields = polyhedron_fields(&outside, state.gravity, &q_c.x, bodies);
        let numbered_bodies = bodies.par_iter().enumerate().with_min_len(PAR_MIN_LEN);
        let effect = |(k, &i): (usize, &BodyId)| field_effect(first + k, i, fields.get(k).copied());
        numbered_bodies.map(effect).collect_into_vec(&mut effects);
        // Sums in the order of the bodies.
        for (&body, effect) in bodies.iter().zip(&effects) {
            let i = body.index();
            free.v[i] += effect.velocity_change;
            free.potential += effect.potential_energy;
            free.impulse += effect.impulse;
            free.angular_impulse += effect.angular_impulse;
            if any_is_moving {
                free.loads.push(BodyLoad { body, force: effect.moving_force, torque: Vec3::zeros() });
            }
        }
    }
    free.potential += tidal_energy(scene, &outside, &q_c.q);
    for drive in scene.drives.iter().filter(|drive| scene.bodies[drive.body.index()].is_driven_in_part()) {
        let i = drive.body.index();
        if let Some(centre) = &drive.hinged_centre {
            let (body, q) = (&scene.bodies[i], &q_c.q[i]);
            let arm = q * centre;
            let weight = external_field(&outside, state.gravity, &(q_c.x[i] + arm)).acceleration * body.mass;
            free.w[i] += body.angular_velocity(q, &(arm.cross(&weight) * h));
        }
        let field = external_field(&outside, state.gravity, &q_c.x[i]);
        free.v[i] += field.acceleration * h;
        if !scene.walls[i] {
            free.potential += scene.bodies[i].mass * field.potential;
        }
    }
    if any_is_moving {
        free.loads.extend(scene.held_grains.iter().map(|&body| {
            let field = external_field(&outside, state.gravity, &q_c.x[body.index()]);
            let force = field.moving_acceleration * scene.bodies[body.index()].mass;
            BodyLoad { body, force, torque: Vec3::zeros() }
        }));
        free.primary_impulse = free.loads.iter().map(|load| load.force * h).sum();
    }
    let shaking_loads = shakes.iter().flat_map(|shake| shake_loads(scene, q_c, shake));
    let cell_loads = cell_loads(scene, q_c);
    let imposed = imposed_loads(scene, state, q_c).into_iter().chain(state.loads.iter().copied());
    for load in imposed.chain(shaking_loads).chain(cell_loads) {
        free.apply_load(scene, q_c, &load);
        let BodyLoad { body, force, torque } = load;
        if !scene.bodies[body.index()].driven {
            free.impulse += force * h;
            free.angular_impulse += (q_c.x[body.index()].cross(&force) + torque) * h;
            free.loads.push(load);
        } else if !scene.walls[body.index()] {
            let (driven_body, q) = (&scene.bodies[body.index()], &q_c.q[body.index()]);
            let force = force - driven_body.imposed_part(&force);
            let torque = torque - driven_body.imposed_rotation_part(q, &torque);
            free.loads.push(BodyLoad { body, force, torque });
        }
    }
    near_field.loads.iter().for_each(|load| free.apply_load(scene, q_c, load));
    apply_coriolis(scene, state, q_c, &mut free);
    let end = scene.time_at(state.step + q_c.step_multiple);
    for drive in &scene.drives {
        let i = drive.body.index();
        let pushed = Twist { v: free.v[i], w: free.w[i] };
        let Twist { v, w } = scene.imposed_motion(drive, end, &q_c.x, &q_c.q, h, &pushed);
        (free.v[i], free.w[i]) = (v, w);
    }
    free.surfaces = q_c.end_surfaces(scene, end);
    free.reaction_work = scene.held_grains.iter().map(|i| reaction_work(scene, state, q_c, &free, i.index())).sum();
    free
}

/// Loads that accelerate the free bodies with a deforming cell whose edges do not move at constant velocities.
fn cell_loads(scene: &Scene, q_c: &ContactConfiguration) -> Vec<BodyLoad> {
    let Some(gradient) = q_c.cell_step.as_ref().and_then(|cell| cell.acceleration_gradient) else { return Vec::new() };
    let load = |&body: &BodyId| {
        let (i, mass) = (body.index(), scene.bodies[body.index()].mass);
        BodyLoad { body, force: gradient * q_c.x[i] * mass, torque: Vec3::zeros() }
    };
    scene.free.iter().map(load).collect()
}

/// Work (J) in a step of the reactions that impose components of the velocity of body `i`, without those to contacts: the
/// change of the kinetic energy of these components, less the work of the outer fields on them. Their displacement is
/// h ((1-θ) V + θ V⁺), whichever θ the free components take.
fn reaction_work(scene: &Scene, state: &State, q_c: &ContactConfiguration, free: &FreeMotion, i: usize) -> f64 {
    let (body, theta) = (&scene.bodies[i], scene.options.theta);
    let (before, after) = (body.imposed_part(&state.v[i]), body.imposed_part(&free.v[i]));
    let outside = state.external_fields(scene, (1.0 - theta) * q_c.h);
    let field = external_field(&outside, state.gravity, &q_c.x[i]);
    let field_work = field.acceleration.dot(&(before * (1.0 - theta) + after * theta)) * q_c.h;
    let q = &q_c.q[i];
    let rotational = |w: &Vec3| body.rotational_energy(q, &body.imposed_rotation_part(q, w));
    body.mass * (0.5 * (after.norm_squared() - before.norm_squared()) - field_work) + rotational(&free.w[i])
        - rotational(&q_c.w[i])
}

/// Uniform gravity and outer fields at a point, on a body at rest.
#[derive(Clone, Copy)]
struct FieldValue {
    /// m/s²
    acceleration: Vec3,
    /// J/kg
    potential: f64,
    /// Part of the acceleration by moving and turning primaries, m/s².
    moving_acceleration: Vec3,
}

impl FieldValue {
    /// Uniform gravity at `x`.
    fn uniform(gravity: Vec3, x: &Vec3) -> FieldValue {
        FieldValue { acceleration: gravity, potential: -gravity.dot(x), moving_acceleration: Vec3::zeros() }
    }

    /// Adds the acceleration and potential of `field` at the point.
    fn add(&mut self, field: &FieldModel, (acceleration, potential): (Vec3, f64)) {
        self.acceleration += acceleration;
        self.potential += potential;
        if field.is_moving() {
            self.moving_acceleration += acceleration;
        }
    }
}

/// Uniform gravity and outer fields at `x`.
fn external_field(outside: &[FieldModel], gravity: Vec3, x: &Vec3) -> FieldValue {
    let mut value = FieldValue::uniform(gravity, x);
    outside.iter().for_each(|field| value.add(field, field.acceleration_and_potential(x)));
    value
}

/// [`external_field`] at each of the bodies. Empty unless a field is that of a polyhedron, for which many points at a time are
/// faster.
fn polyhedron_fields(outside: &[FieldModel], gravity: Vec3, x: &[Vec3], bodies: &[BodyId]) -> Vec<FieldValue> {
    if !outside.iter().any(FieldModel::is_polyhedron) {
        return Vec::new();
    }
    let points: Vec<Vec3> = bodies.iter().map(|i| x[i.index()]).collect();
    let mut values: Vec<FieldValue> = points.iter().map(|x| FieldValue::uniform(gravity, x)).collect();
    for field in outside {
        for (value, term) in values.iter_mut().zip(field.accelerations_and_potentials(&points)) {
            value.add(field, term);
        }
    }
    values
}

/// Returns u with u + k x u = b.
fn solve_rotation_equation(b: &Vec3, k: &Vec3) -> Vec3 {
    (b + k * k.dot(b) - k.cross(b)) / (1.0 + k.norm_squared())
}

/// Contribution of the free bodies' extent to their potential energy in outer fields, J.
fn tidal_energy(scene: &Scene, outside: &[FieldModel], q: &[Quat]) -> f64 {
    let tidal_energy_of = |i: usize| {
        outside
            .iter()
            .map(|field| field.tidal_energy(|rate| scene.bodies[i].angular_momentum(&q[i], rate)))
            .sum::<f64>()
    };
    scene.free.iter().map(|&i| tidal_energy_of(i.index())).sum()
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
    let contact_changes = contact_velocity_changes(scene, state, h);
    for &body_id in &scene.free {
        let i = body_id.index();
        let body = &scene.bodies[i];
        let known_velocity = state.v[i] * (1.0 - theta) + contact_changes[i] * theta;
        let v = solve_rotation_equation(
            &(free.v[i] - rate.cross(&known_velocity) * (2.0 * h)),
            &(rate * (2.0 * theta * h)),
        );
        let w = match body.is_isotropic() {
            true => solve_rotation_equation(
                &(free.w[i] - rate.cross(&state.w[i]) * ((1.0 - theta) * h)),
                &(rate * (theta * h)),
            ),
            false => free.w[i],
        };
        let (impulse, angular_impulse) = ((v - free.v[i]) * body.mass, (w - free.w[i]) * body.inertia[0]);
        (free.v[i], free.w[i]) = (v, w);
        free.impulse += impulse;
        free.angular_impulse += q_c.x[i].cross(&impulse) + angular_impulse;
        free.loads.push(BodyLoad { body: body_id, force: impulse / h, torque: angular_impulse / h });
    }
}

/// Change of each body's velocity in `h` by the contact forces of the last step, m/s.
fn contact_velocity_changes(scene: &Scene, state: &State, h: f64) -> Vec<Vec3> {
    let mut change = vec![Vec3::zeros(); scene.bodies.len()];
    for solved in &state.contacts {
        let contact = &solved.contact;
        let impulse = to_world(&contact.frame(), &solved.impulse) * (h / state.h);
        for (body, impulse) in [(contact.candidate.index(), impulse), (contact.antagonist.index(), -impulse)] {
            change[body] += impulse * scene.bodies[body].inverse_mass();
        }
    }
    change
}

/// Potential energy of the grains at `x` in self-gravity, uniform gravity (zero at the origin) and outer fields, J.
pub fn potential_energy(scene: &Scene, state: &State, x: &[Vec3]) -> f64 {
    let (positions, masses) = point_masses(scene, x);
    let outside = state.external_fields(scene, 0.0);
    let energy_at = |x: &Vec3, mass: f64| mass * external_field(&outside, state.gravity, x).potential;
    let outer_energy: f64 = positions.iter().zip(&masses).map(|(x, m)| energy_at(x, *m)).sum();
    let held_energy: f64 =
        scene.held_grains.iter().map(|i| energy_at(&x[i.index()], scene.bodies[i.index()].mass)).sum();
    let outer_energy = outer_energy + held_energy + tidal_energy(scene, &outside, &state.q);
    if !scene.has_self_gravity() {
        return outer_energy;
    }
    outer_energy + mutual_energy(scene, &positions, &masses) + near_field(scene, x, &state.q).energy
}

/// Potential energy of self-gravity of the free grains at `x`, J; 0 without self-gravity.
pub fn self_gravity_energy(scene: &Scene, state: &State, x: &[Vec3]) -> f64 {
    if !scene.has_self_gravity() {
        return 0.0;
    }
    let (positions, masses) = point_masses(scene, x);
    mutual_energy(scene, &positions, &masses) + near_field(scene, x, &state.q).energy
}

/// Imposed forces and moments, weighted over the step as (1-theta) f(t) + theta f(t+h), world frame. Pressures act on the areas in
/// the contact configuration.
fn imposed_loads(scene: &Scene, state: &State, q_c: &ContactConfiguration) -> Vec<BodyLoad> {
    let theta = scene.options.theta;
    scene
        .loads
        .iter()
        .map(|load| {
            let value = (1.0 - theta) * load.value.value_at(state.time)
                + theta * load.value.value_at(scene.time_at(state.step + q_c.step_multiple));
            let mut vector = Vec3::zeros();
            vector[load.component % 3] =
                load.load_at(value, &q_c.x, |drum| q_c.changing_radius(drum).unwrap_or_default());
            let (force, torque) = match load.component {
                0..3 => (vector, Vec3::zeros()),
                _ => (Vec3::zeros(), q_c.q[load.body.index()] * vector),
            };
            BodyLoad { body: load.body, force, torque }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotation_equations_are_solved() {
        let (b, k) = (Vec3::new(1.0, -2.0, 3.0), Vec3::new(0.4, 0.1, -2.0));
        let u = solve_rotation_equation(&b, &k);
        assert!((u + k.cross(&u) - b).norm() < 1e-14);
    }
}
