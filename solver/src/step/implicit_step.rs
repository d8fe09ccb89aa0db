//! Implicit steps, taken with θ = 1 so that velocities which no step has bounded close no gap unnoticed.
//!
//! A step bounds its end velocities V⁺ by the gaps on the path to the next contact configuration, x_c + h V⁺. Velocities at
//! the start of a run, after events, and of bodies that enter have no such bound: the path (1-θ) h V from x to the contact
//! configuration of their step may pass through another body. With θ = 1 this path has no length.

use crate::assemble::{AppliedEvents, FreeMotion, relative_velocity};
use crate::detect;
use crate::integrate::{ContactConfiguration, MAX_STEP_GROWTH, predict_configuration};
use crate::math::{Vec3, to_world};
use crate::ranks::lists::any_rank;
use crate::scene::{BodyId, Scene};
use crate::state::{Contact, SolvedContact, State, UNKNOWN_FEATURE, Velocities};

/// Closing beyond a gap that counts as rounding, divided by the effective radius: that of laws that act on touching
/// contacts.
const CLOSING_ROUNDING: f64 = 1e-9;

/// Relative change of an approach speed since the last step that is attributed to the digits of text files.
const SPEED_DIGITS: f64 = 1e-6;

/// Error of a relative velocity that LMGC90's solution leaves, divided by the largest relative velocity in the file:
/// its usual tolerance is 1.666e-4, and velocities of its files differ from those of the bodies by up to 4e-5.
const FILE_RESIDUAL: f64 = 2e-4;

/// Whether velocities differ from those at the end of the last step and are not bounded by it.
pub fn velocities_are_unbounded(scene: &Scene, state: &State, applied: &AppliedEvents) -> bool {
    is_start(scene, state) || applied.velocities_changed || state.bodies_entered
}

/// Whether the next step is the first of a run that does not continue another one.
fn is_start(scene: &Scene, state: &State) -> bool {
    state.step == scene.start.step && !scene.continues_run
}

/// Whether velocities differ from those at the end of the last step, or no last step is known.
pub fn velocities_have_changed(scene: &Scene, state: &State, applied: &AppliedEvents) -> bool {
    let continues_file = || {
        FileStep::new(scene, state).is_some_and(|file| state.contacts.iter().all(|old| file.has_all_velocities(old)))
    };
    let is_new = || is_start(scene, state) && !continues_file();
    applied.velocities_changed || state.bodies_entered || is_new()
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
    // A step of zero length: the positions at its start.
    let start = predict_configuration(scene, state, 0);
    let start = ContactConfiguration { lookahead: h + time_before, ..start };
    let mut cache = state.detection_cache.clone();
    // Contacts of the last step are compared: they stay with their ranks.
    cache.division.iter_mut().for_each(|division| division.can_move_cuts = false);
    let surfaces = start.start_surfaces(scene, state.time);
    let velocities = Velocities { gradient: start.start_gradient(), surfaces: &surfaces, ..state.velocities() };
    let contacts = detect::listed_contacts(scene, &start, velocities, &mut cache);
    let file = FileStep::new(scene, state);
    let is_closing = |contact: &Contact| {
        let u = contact.normal.dot(&relative_velocity(contact, &start.x, Velocities { w: &start.w, ..velocities }));
        let radius = scene.effective_radius(
            (contact.candidate, contact.part_numbers.candidate),
            (contact.antagonist, contact.part_numbers.antagonist),
        );
        let find_old = || state.contacts.binary_search_by_key(&contact.key(), |old| old.contact.key());
        let is_bounded = || match find_old() {
            _ if longer => false,
            Ok(k) if !is_start(scene, state) => u >= state.contacts[k].velocity.x - SPEED_DIGITS * u.abs(),
            _ => file.as_ref().is_some_and(|file| file.bounds(contact)),
        };
        -time_before * u - contact.gap.max(0.0) > CLOSING_ROUNDING * radius && !is_bounded()
    };
    let closes = contacts.iter().any(is_closing);
    if state.detection_cache.is_divided() { any_rank(closes) } else { closes }
}

/// Contacts of a file, and the bodies in the contact configuration of its last step.
struct FileStep<'a> {
    scene: &'a Scene,
    state: &'a State,
    /// Positions in that contact configuration, x - θ h V, m.
    x: Vec<Vec3>,
    /// Time from that contact configuration to the end of the step, θ h, s.
    time_after: f64,
    /// Error of velocities that the solution of the step has left, m/s.
    residual: f64,
}

impl<'a> FileStep<'a> {
    /// Step of the file from which the run starts; `None` if the file lists no contact.
    fn new(scene: &'a Scene, state: &'a State) -> Option<Self> {
        let fastest = state.contacts.iter().map(|old| old.velocity.norm()).reduce(f64::max)?;
        let time_after = scene.options.theta * state.h;
        let x = state.x.iter().zip(&state.v).map(|(x, v)| x - v * time_after).collect();
        Some(FileStep { scene, state, x, time_after, residual: FILE_RESIDUAL * fastest })
    }

    /// Whether the step has bounded the approach of a pair: the file lists contacts of it, and the velocities of the bodies
    /// are those with which the step ended. Points of polyhedra that the file does not list, since the bodies have turned or
    /// since LMGC90 chooses others, move with the same bodies.
    fn bounds(&self, contact: &Contact) -> bool {
        let pair = |c: &Contact| (c.candidate, c.antagonist, c.part_numbers);
        let contacts = &self.state.contacts;
        let first = contacts.partition_point(|old| pair(&old.contact) < pair(contact));
        let of_pair = contacts[first..].iter().take_while(|old| pair(&old.contact) == pair(contact));
        let is_of_file = |old: &&SolvedContact| {
            is_start(self.scene, self.state) || old.contact.features.candidate == UNKNOWN_FEATURE
        };
        let mut of_file = of_pair.filter(is_of_file).peekable();
        of_file.peek().is_some() && of_file.all(|old| self.has_velocity(old))
    }

    /// Whether the bodies have the normal velocity that the file lists for a contact, in its frame and at its point.
    fn has_velocity(&self, old: &SolvedContact) -> bool {
        let (difference, limit) = self.velocity_difference(old);
        old.contact.normal.dot(&difference).abs() <= limit
    }

    /// Whether the bodies have the velocity that the file lists for a contact, also along the surfaces.
    fn has_all_velocities(&self, old: &SolvedContact) -> bool {
        let (difference, limit) = self.velocity_difference(old);
        difference.norm() <= limit
    }

    /// Difference of the relative velocity at a contact from that of the file, and its limit, m/s.
    ///
    /// Differences are the rounding of velocities, positions and points, the residual of the solution, and, for the rotation
    /// of a free body from there to the end of the step, at most ω² `time_after`: |J₂ - J₁| ≤ J₃ for all bodies.
    fn velocity_difference(&self, old: &SolvedContact) -> (Vec3, f64) {
        let FileStep { scene, state, ref x, time_after, residual } = *self;
        let Contact { candidate, antagonist, point, .. } = old.contact;
        let image = scene.periodic_cell().nearest_shift(&(point - x[antagonist.index()]));
        let velocities = state.velocities();
        let u = relative_velocity(&Contact { image, ..old.contact }, x, velocities);
        let difference_limit = |body: BodyId| {
            let (v, w, x) = (&state.v[body.index()], state.w[body.index()].norm(), &x[body.index()]);
            SPEED_DIGITS * (v.norm() + w * (x.norm() + point.norm())) + w * w * (point - x).norm() * time_after
        };
        let limit = residual + difference_limit(candidate) + difference_limit(antagonist);
        (u - to_world(&old.contact.frame(), &old.velocity), limit)
    }
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
