//! Probes, whose quantities are computed after every step, and the conditions that end a run; the loop over steps evaluates
//! both after each step.

mod region;

use std::borrow::Cow;
use std::f64::consts::PI;
use std::time::Duration;

use cd_formats::probe::{EndCondition, Probe, ProbeQuantity};
use nalgebra::Matrix3;

use self::region::ProbeRegion;
use crate::activity;
use crate::assemble::self_gravity_energy;
use crate::math::{Vec3, to_world};
use crate::scene::{BodyId, BodyPresence, PressedArea, Scene, WallArea};
use crate::sinks_and_sources::{BodyExchange, BodyFlow};
use crate::state::State;
use crate::step::{StepStart, side_impulse};

/// Probes and end conditions of a run, with their bodies.
pub struct Probes {
    /// Bodies of each probe, rising; none of those that count bodies of sinks and sources.
    probe_bodies: Vec<Vec<BodyId>>,
    /// Whether each of these bodies was beyond the surface of the probe after the last step; empty without a surface.
    was_beyond: Vec<Vec<bool>>,
    /// Region of each probe of means.
    regions: Vec<Option<ProbeRegion>>,
    /// Bodies of the two sides of each condition; empty where it has none.
    condition_bodies: Vec<[Vec<BodyId>; 2]>,
}

/// Values of the columns of each probe after a step.
pub type ProbeValues = Vec<Vec<f64>>;

impl Probes {
    /// Selects the bodies of the options of a scene, with their positions in `state`.
    pub fn new(scene: &Scene, state: &State) -> Self {
        let bodies_of_sides = |condition: &EndCondition| match condition {
            EndCondition::Separation { between: (a, b), .. } => [scene.selected_bodies(a), scene.selected_bodies(b)],
            EndCondition::AtRest { .. }
            | EndCondition::Above { .. }
            | EndCondition::Below { .. }
            | EndCondition::WallTime(_) => [Vec::new(), Vec::new()],
        };
        let probes = &scene.options.probes;
        let bodies_of_probe =
            |probe: &Probe| probe.quantity.bodies().map_or(Vec::new(), |bodies| scene.selected_bodies(bodies));
        let probe_bodies: Vec<Vec<BodyId>> = probes.iter().map(bodies_of_probe).collect();
        let bodies_beyond = |(probe, bodies): (&Probe, &Vec<BodyId>)| match &probe.quantity {
            ProbeQuantity::Crossing { through, .. } => {
                bodies.iter().map(|body| through.is_beyond(&state.x[body.index()].into())).collect()
            }
            _ => Vec::new(),
        };
        let region = |(probe, bodies): (&Probe, &Vec<BodyId>)| match &probe.quantity {
            ProbeQuantity::Region { inside, .. } => ProbeRegion::new(scene, inside, bodies),
            _ => None,
        };
        Probes {
            regions: probes.iter().zip(&probe_bodies).map(region).collect(),
            was_beyond: probes.iter().zip(&probe_bodies).map(bodies_beyond).collect(),
            probe_bodies,
            condition_bodies: scene.options.until.iter().map(bodies_of_sides).collect(),
        }
    }

    /// Values of probes that depend on the whole step, in the state at its end before bodies leave and enter: forces and means
    /// over regions in the step that began with `start`, and bodies that pass through surfaces. Other probes have no values.
    pub fn step_values(&mut self, scene: &Scene, state: &State, start: Option<&StepStart>) -> ProbeValues {
        let mut values = ProbeValues::new();
        for (k, (probe, all)) in scene.options.probes.iter().zip(&self.probe_bodies).enumerate() {
            let probe_values = match &probe.quantity {
                ProbeQuantity::Force { about, .. } => {
                    let bodies = present_bodies(scene, all);
                    start.map_or(Vec::new(), |start| contact_force(scene, state, start, &bodies, *about))
                }
                ProbeQuantity::Pressure { .. } => {
                    start.map_or(Vec::new(), |start| wall_pressure(scene, state, start, all))
                }
                ProbeQuantity::Crossing { through, .. } => {
                    let mut flow = BodyFlow::default();
                    for (&body, beyond) in all.iter().zip(&mut self.was_beyond[k]) {
                        let now = through.is_beyond(&state.x[body.index()].into());
                        if now != *beyond {
                            flow.add_body(scene, state, body, if now { 1.0 } else { -1.0 });
                        }
                        *beyond = now;
                    }
                    flow.columns()
                }
                ProbeQuantity::Region { .. } => {
                    let means = self.regions[k].as_ref().zip(start);
                    means.map_or(Vec::new(), |(region, start)| {
                        region.means(scene, state, start, &present_bodies(scene, all))
                    })
                }
                _ => Vec::new(),
            };
            values.push(probe_values);
        }
        values
    }

    /// Values of all probes in a state, after a step with the values `step_values` and the exchange of bodies after it. Without
    /// a step, at a resume, only probes of a state have values.
    pub fn values(
        &self,
        scene: &Scene,
        state: &State,
        step_values: Option<(ProbeValues, &BodyExchange)>,
    ) -> ProbeValues {
        let (mut step_values, exchange) = step_values.unzip();
        let flow = |flows: &[BodyFlow], position: Option<usize>| {
            position.and_then(|k| flows.get(k)).map_or(Vec::new(), BodyFlow::columns)
        };
        let (sinks, sources) = (&scene.options.sinks, &scene.options.sources);
        let probe_values = |(k, (probe, all)): (usize, (&Probe, &Vec<BodyId>))| match &probe.quantity {
            ProbeQuantity::Force { .. }
            | ProbeQuantity::Pressure { .. }
            | ProbeQuantity::Crossing { .. }
            | ProbeQuantity::Region { .. } => {
                step_values.as_mut().map_or(Vec::new(), |values| std::mem::take(&mut values[k]))
            }
            ProbeQuantity::Motion { .. } => motion(scene, state, &present_bodies(scene, all)),
            ProbeQuantity::Energy { .. } => energy(scene, state, &present_bodies(scene, all)),
            ProbeQuantity::Removed { by } => exchange
                .map_or(Vec::new(), |exchange| flow(&exchange.removed, sinks.iter().position(|sink| sink.name == *by))),
            ProbeQuantity::Entered { from } => exchange.map_or(Vec::new(), |exchange| {
                flow(&exchange.entered, sources.iter().position(|source| source.name == *from))
            }),
        };
        scene.options.probes.iter().zip(&self.probe_bodies).enumerate().map(probe_values).collect()
    }

    /// Text of the first condition that holds in a state with these values, of a run that has taken `elapsed` so far.
    /// Updates the time since when all bodies have been at rest.
    pub fn met_condition(
        &self,
        scene: &Scene,
        state: &mut State,
        values: &ProbeValues,
        elapsed: Duration,
    ) -> Option<String> {
        let mut first_met = None;
        for (condition, [a, b]) in scene.options.until.iter().zip(&self.condition_bodies) {
            let column = |probe: &str, column: &str| {
                let position = scene.options.probes.iter().position(|known| known.name == probe)?;
                let columns = scene.options.probes[position].quantity.columns();
                values[position].get(columns.iter().position(|name| *name == column)?).copied()
            };
            let holds = match condition {
                EndCondition::AtRest { speed, kinetic_over_potential, during } => {
                    let is_any_waiting = state.presence.contains(&BodyPresence::Waiting);
                    let is_slow = || speed.is_none_or(|speed| largest_speed(scene, state, &scene.free) <= speed);
                    let is_low = || kinetic_over_potential.is_none_or(|ratio| is_energy_low(scene, state, ratio));
                    if is_any_waiting || !is_slow() || !is_low() {
                        state.rest_since = None;
                    } else if state.rest_since.is_none() {
                        state.rest_since = Some(state.time - state.h);
                    }
                    // A thousandth of a step of slack, as at the end of a run: sums of steps are rounded.
                    let slack = 1e-3 * scene.options.dt;
                    state.rest_since.is_some_and(|since| state.time - since >= *during - slack)
                }
                EndCondition::Separation { distance, .. } => {
                    let centre = |bodies: &[BodyId]| mean_motion(scene, state, &present_bodies(scene, bodies)).centre;
                    (centre(a) - centre(b)).norm() > *distance
                }
                EndCondition::Above { probe, column: name, value } => column(probe, name).is_some_and(|x| x > *value),
                EndCondition::Below { probe, column: name, value } => column(probe, name).is_some_and(|x| x < *value),
                EndCondition::WallTime(seconds) => {
                    if elapsed.as_secs_f64() > *seconds {
                        activity::request_stop();
                    }
                    false
                }
            };
            if holds && first_met.is_none() {
                first_met = Some(condition.to_text());
            }
        }
        first_met
    }
}

/// Members of `bodies` that are in the run.
fn present_bodies<'a>(scene: &Scene, bodies: &'a [BodyId]) -> Cow<'a, [BodyId]> {
    match scene.roster {
        None => Cow::Borrowed(bodies),
        Some(_) => bodies.iter().copied().filter(|&body| scene.is_present(body)).collect(),
    }
}

/// Mean force of the contacts with other bodies on `bodies` in the step, N, and its torque, N m, about `point` (m), else about
/// their centre of mass in the configuration of the contacts.
fn contact_force(
    scene: &Scene,
    state: &State,
    start: &StepStart,
    bodies: &[BodyId],
    point: Option<[f64; 3]>,
) -> Vec<f64> {
    let is_selected = |body: BodyId| bodies.binary_search(&body).is_ok();
    let mass: f64 = bodies.iter().map(|body| scene.bodies[body.index()].mass).sum();
    let centre = bodies.iter().map(|body| start.x[body.index()] * scene.bodies[body.index()].mass).sum::<Vec3>() / mass;
    let point = point.map_or(centre, Vec3::from);
    let (mut force, mut torque) = (Vec3::zeros(), Vec3::zeros());
    for solved in &state.contacts {
        let [candidate_selected, antagonist_selected] =
            [solved.contact.candidate, solved.contact.antagonist].map(is_selected);
        // Forces between two of these bodies cancel; others do not act on them.
        if candidate_selected == antagonist_selected {
            continue;
        }
        let frame = solved.contact.frame();
        let [contact_force, contact_moment] =
            [solved.impulse, solved.moment].map(|local| to_world(&frame, &local) / state.h);
        for (body, arm, sign) in start.arms(solved).into_iter().filter(|(body, ..)| is_selected(*body)) {
            force += contact_force * sign;
            torque += ((start.x[body.index()] + arm - point).cross(&contact_force) + contact_moment) * sign;
        }
    }
    [force, torque].iter().flat_map(|v| [v.x, v.y, v.z]).collect()
}

/// Area of a wall between its neighbours, or of the inside of a hollow cylinder, m², and size of the normal force of the
/// contacts on it over that, Pa.
fn wall_pressure(scene: &Scene, state: &State, start: &StepStart, wall: &[BodyId]) -> Vec<f64> {
    let Some(WallArea { axis, area, body }) = scene.wall_areas.iter().find(|area| wall == [area.body]) else {
        return Vec::new();
    };
    let size = area.size(*body, &start.x, |drum| state.contact_radius(scene, drum));
    if let PressedArea::Inside(changing) = area {
        let axis = start.q[body.index()] * changing.axis;
        return vec![size, side_impulse(&state.contacts, *body, &axis) / (state.h * size)];
    }
    let force = contact_force(scene, state, start, wall, None)[*axis];
    vec![size, force.abs() / size]
}

/// Motion of several bodies as one rigid body.
struct MeanMotion {
    /// Centre of mass, m.
    centre: Vec3,
    /// Velocity of the centre of mass, m/s.
    velocity: Vec3,
    /// Angular velocity of a rigid body with their angular momentum and inertia, rad/s.
    angular_velocity: Vec3,
}

/// Motion of `bodies` as one rigid body; not a number if there are none.
fn mean_motion(scene: &Scene, state: &State, bodies: &[BodyId]) -> MeanMotion {
    if let [body] = bodies {
        let i = body.index();
        return MeanMotion { centre: state.x[i], velocity: state.v[i], angular_velocity: state.w[i] };
    }
    let mass_of = |body: &BodyId| scene.bodies[body.index()].mass;
    let mass: f64 = bodies.iter().map(mass_of).sum();
    let centre = bodies.iter().map(|body| state.x[body.index()] * mass_of(body)).sum::<Vec3>() / mass;
    let velocity = bodies.iter().map(|body| state.v[body.index()] * mass_of(body)).sum::<Vec3>() / mass;
    let (mut angular_momentum, mut inertia) = (Vec3::zeros(), Matrix3::zeros());
    for body in bodies {
        let (i, rigid_body) = (body.index(), &scene.bodies[body.index()]);
        let arm = state.x[i] - centre;
        angular_momentum += arm.cross(&(state.v[i] - velocity)) * rigid_body.mass
            + rigid_body.angular_momentum(&state.q[i], &state.w[i]);
        let axes = state.q[i].to_rotation_matrix();
        inertia += axes * Matrix3::from_diagonal(&rigid_body.inertia.into()) * axes.transpose()
            + (Matrix3::identity() * arm.norm_squared() - arm * arm.transpose()) * rigid_body.mass;
    }
    let angular_velocity = inertia.try_inverse().map_or(Vec3::zeros(), |inverse| inverse * angular_momentum);
    MeanMotion { centre, velocity, angular_velocity }
}

/// Columns of [`ProbeQuantity::Motion`]; without bodies they are not numbers, and fields of the file are empty.
fn motion(scene: &Scene, state: &State, bodies: &[BodyId]) -> Vec<f64> {
    if bodies.is_empty() {
        return vec![f64::NAN; 9];
    }
    let MeanMotion { centre, velocity, angular_velocity } = mean_motion(scene, state, bodies);
    [centre, velocity, angular_velocity].iter().flat_map(|v| [v.x, v.y, v.z]).collect()
}

/// Columns of [`ProbeQuantity::Energy`].
fn energy(scene: &Scene, state: &State, bodies: &[BodyId]) -> Vec<f64> {
    let mass_of = |body: &BodyId| scene.bodies[body.index()].mass;
    let kinetic_energy = |body: &BodyId| 0.5 * mass_of(body) * state.v[body.index()].norm_squared();
    let rotational =
        |body: &BodyId| scene.bodies[body.index()].rotational_energy(&state.q[body.index()], &state.w[body.index()]);
    vec![
        bodies.iter().map(kinetic_energy).sum(),
        bodies.iter().map(rotational).sum(),
        largest_speed(scene, state, bodies),
        bodies.iter().map(mass_of).sum(),
    ]
}

/// Largest |v| + |w| R of `bodies`, m/s, with the radius R of a sphere of equal volume.
fn largest_speed(scene: &Scene, state: &State, bodies: &[BodyId]) -> f64 {
    let speed = |body: &BodyId| {
        let i = body.index();
        let v = state.cell.map_or(state.v[i], |cell| cell.fluctuation(&state.x[i], &state.v[i]));
        v.norm() + state.w[i].norm() * scene.bodies[i].radius
    };
    bodies.iter().map(speed).fold(0.0, f64::max)
}

/// Whether the kinetic energy of the free bodies is at most `ratio` times their potential energy, which must not be 0.
///
/// The potential energy is the sum of those in self-gravity, -E, and in uniform gravity g, Σ m g h, with the height h of
/// each centre above the lowest point of the balls of equal volume: it does not depend on the origin and is positive.
fn is_energy_low(scene: &Scene, state: &State, ratio: f64) -> bool {
    let kinetic = kinetic_energy(scene, state);
    let (gravity, mut mass, mut density) = (state.gravity.norm(), 0.0, 0.0f64);
    let up = if gravity > 0.0 { -state.gravity / gravity } else { Vec3::zeros() };
    let (mut moment, mut lowest) = (0.0, f64::INFINITY);
    for &body in &scene.free {
        let (rigid_body, height) = (&scene.bodies[body.index()], state.x[body.index()].dot(&up));
        mass += rigid_body.mass;
        moment += rigid_body.mass * height;
        lowest = lowest.min(height - rigid_body.radius);
        density = density.max(rigid_body.mass / (4.0 / 3.0 * PI * rigid_body.radius.powi(3)));
    }
    if mass == 0.0 {
        return true;
    }
    let mut potential = gravity * (moment - mass * lowest);
    if scene.has_self_gravity() && kinetic > ratio * potential {
        // No bodies have more than a ball of all their mass with the largest density, but those that overlap: twice that.
        // A faster motion needs no evaluation.
        let ball_radius = libm::cbrt(0.75 * mass / (PI * density));
        let bound = 2.0 * 0.6 * scene.options.gravity_constant * mass * mass / ball_radius;
        if kinetic <= ratio * (potential + bound) {
            potential += self_gravity_energy(scene, state, &state.x).abs();
        }
    }
    potential > 0.0 && kinetic <= ratio * potential
}

/// Kinetic energy of the free bodies, of translation and rotation, J; in a deforming cell about its flow.
fn kinetic_energy(scene: &Scene, state: &State) -> f64 {
    let energy = |body: &BodyId| {
        let (i, rigid_body) = (body.index(), &scene.bodies[body.index()]);
        let v = state.cell.map_or(state.v[i], |cell| cell.fluctuation(&state.x[i], &state.v[i]));
        0.5 * rigid_body.mass * v.norm_squared() + rigid_body.rotational_energy(&state.q[i], &state.w[i])
    };
    scene.free.iter().map(energy).sum()
}
