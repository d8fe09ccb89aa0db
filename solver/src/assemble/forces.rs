//! Everything that moves a body besides contacts: gravity, imposed forces and velocities, events.

use cd_formats::compute::Action;

use crate::gravity::{Field, Gravity, Method};
use crate::integrate::Configuration;
use crate::math::Vec3;
use crate::scene::Scene;
use crate::state::{Bonding, State};

/// Velocities at the step's end if nothing touched, and what the forces bring into the ledger.
pub struct Free {
    /// m/s
    pub v: Vec<Vec3>,
    /// rad/s, world frame.
    pub w: Vec<Vec3>,
    /// Potential energy in self-gravity and uniform gravity, in the contact configuration, J.
    pub potential: f64,
    /// See `StepReport`.
    pub gravity_error: f64,
    /// Impulse of uniform gravity and imposed forces on the free bodies, N s.
    pub impulse: Vec3,
    /// Their angular impulse about the origin, N m s.
    pub angular_impulse: Vec3,
    /// Imposed force and moment (N, N m) by loaded body.
    pub loads: Vec<(usize, Vec3, Vec3)>,
}

/// Events whose time has come, and the option `quench`, at a step's start.
pub fn interventions(scene: &Scene, state: &mut State) {
    // A thousandth of a step of slack: the time is a sum of steps, and a little before or after their product.
    let now = state.time + 1e-3 * scene.options.dt;
    while let Some(event) = scene.events.get(state.events_done).filter(|event| event.time <= now) {
        let gravity = state.gravity;
        state.set_by(&event.action, scene);
        book_potential(scene, state, state.gravity - gravity);
        match event.action {
            Action::AddVelocity(velocity) => change_motion(scene, state, |_, v, w| (v + Vec3::from(velocity), w)),
            Action::AddSpin(spin) => {
                let (spin, centre) = (Vec3::from(spin), centre_of_mass(scene, &state.x));
                let x = state.x.clone();
                change_motion(scene, state, |i, v, w| (v + spin.cross(&(x[i] - centre)), w + spin));
            }
            Action::Bond => state.bonding = Bonding::All,
            Action::SetGravity(_) | Action::SetQuench(_) | Action::SetFriction(..) | Action::SetCohesion(..) => {}
        }
        state.events_done += 1;
    }
    if state.quench > 0.0 {
        let keep = 1.0 - state.quench;
        change_motion(scene, state, |_, v, w| (v * keep, w * keep));
    }
}

/// Gives the free bodies new velocities and books the change of momentum and energy as coming from outside.
fn change_motion(scene: &Scene, state: &mut State, new: impl Fn(usize, Vec3, Vec3) -> (Vec3, Vec3)) {
    for &i in &scene.free {
        let i = i as usize;
        let body = &scene.bodies[i];
        let (v, w) = new(i, state.v[i], state.w[i]);
        let momentum = (v - state.v[i]) * body.mass;
        let spin = body.angular_momentum(&state.q[i], &(w - state.w[i]));
        state.ledger.outside_work += 0.5 * (momentum.dot(&(v + state.v[i])) + spin.dot(&(w + state.w[i])));
        add(&mut state.ledger.momentum_expected, &momentum);
        add(&mut state.ledger.angular_momentum_expected, &(state.x[i].cross(&momentum) + spin));
        (state.v[i], state.w[i]) = (v, w);
    }
    for (&i, spin) in scene.turning.iter().zip(&mut state.spin) {
        let i = i as usize;
        *spin = scene.bodies[i].angular_momentum(&state.q[i], &state.w[i]);
    }
}

/// Books the potential energy that a change of uniform gravity gives as coming from outside.
fn book_potential(scene: &Scene, state: &mut State, change: Vec3) {
    let height = |&i: &u32| scene.bodies[i as usize].mass * change.dot(&state.x[i as usize]);
    state.ledger.outside_work -= scene.free.iter().map(height).sum::<f64>();
}

fn add(sum: &mut [f64; 3], term: &Vec3) {
    sum.iter_mut().zip(term.iter()).for_each(|(s, t)| *s += t);
}

fn centre_of_mass(scene: &Scene, x: &[Vec3]) -> Vec3 {
    let (moment, mass) = scene.free.iter().fold((Vec3::zeros(), 0.0), |(moment, mass), &i| {
        let m = scene.bodies[i as usize].mass;
        (moment + x[i as usize] * m, mass + m)
    });
    moment / mass
}

/// Free velocities: V + h F/m with all forces in the contact configuration; imposed velocities at the step's end.
pub fn free_velocity(scene: &Scene, state: &State, q_c: &Configuration) -> Free {
    let h = scene.options.dt;
    let mut free = Free {
        v: state.v.clone(),
        w: q_c.w.clone(),
        potential: 0.0,
        gravity_error: 0.0,
        impulse: Vec3::zeros(),
        angular_impulse: Vec3::zeros(),
        loads: loads(scene, state),
    };
    let Field { acceleration, potential, removed } = self_gravity(scene, scene.gravity(), &q_c.x);
    free.gravity_error = removed;
    for (k, &i) in scene.free.iter().enumerate() {
        let i = i as usize;
        let (mass, x) = (scene.bodies[i].mass, q_c.x[i]);
        free.v[i] += (state.gravity + acceleration[k]) * h;
        free.potential += mass * (0.5 * potential[k] - state.gravity.dot(&x));
        let weight = state.gravity * (mass * h);
        free.impulse += weight;
        free.angular_impulse += x.cross(&weight);
    }
    for (i, force, moment) in &free.loads {
        let body = &scene.bodies[*i];
        free.v[*i] += force * (h * body.inverse_mass());
        free.w[*i] += body.angular_velocity(&q_c.q[*i], &(moment * h));
        free.impulse += force * h;
        free.angular_impulse += (q_c.x[*i].cross(force) + moment) * h;
    }
    let end = state.time + h;
    for drive in &scene.drives {
        let value = Vec3::from_fn(|k, _| drive.velocity[k].at(end));
        let spin = Vec3::from_fn(|k, _| drive.velocity[3 + k].at(end));
        free.v[drive.body] = value;
        free.w[drive.body] = q_c.q[drive.body] * spin;
    }
    free
}

/// Up to this many bodies the energies that a run's drift is taken from are summed directly: twice a
/// run, within a second or two.
const DIRECT_ENERGY: usize = 50_000;

/// Self-gravity at each free body; zeros when the scene has none.
fn self_gravity(scene: &Scene, gravity: Gravity, x: &[Vec3]) -> Field {
    if !scene.options.self_gravity {
        let n = scene.free.len();
        return Field { acceleration: vec![Vec3::zeros(); n], potential: vec![0.0; n], removed: 0.0 };
    }
    let positions: Vec<Vec3> = scene.free.iter().map(|&i| x[i as usize]).collect();
    let masses: Vec<f64> = scene.free.iter().map(|&i| scene.bodies[i as usize].mass).collect();
    gravity.field(&positions, &masses, scene.options.gravity_constant)
}

/// Potential energy of the free bodies at `x` in self-gravity and uniform gravity (zero at the origin), J.
pub fn potential_energy(scene: &Scene, state: &State, x: &[Vec3]) -> f64 {
    let direct = Gravity::new(Method::Direct, scene.options.gravity_error);
    let gravity = if scene.free.len() <= DIRECT_ENERGY { direct } else { scene.gravity() };
    let potential = self_gravity(scene, gravity, x).potential;
    let of = |(k, &i): (usize, &u32)| {
        scene.bodies[i as usize].mass * (0.5 * potential[k] - state.gravity.dot(&x[i as usize]))
    };
    scene.free.iter().enumerate().map(of).sum()
}

/// Imposed forces and moments, weighted over the step as (1-theta) f(t) + theta f(t+h), world frame.
fn loads(scene: &Scene, state: &State) -> Vec<(usize, Vec3, Vec3)> {
    let (h, theta) = (scene.options.dt, scene.options.theta);
    scene
        .loads
        .iter()
        .map(|load| {
            let value = (1.0 - theta) * load.value.at(state.time) + theta * load.value.at(state.time + h);
            let mut vector = Vec3::zeros();
            vector[load.component % 3] = value;
            match load.component {
                0..3 => (load.body, vector, Vec3::zeros()),
                _ => (load.body, Vec3::zeros(), state.q[load.body] * vector),
            }
        })
        .collect()
}
