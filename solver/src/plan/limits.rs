//! Table of limits: parameters of a scene, each with the range in which tests show that a property holds.
//!
//! The tests in `solver/tests/cases` search for the values at which the property fails, and `make extremes` writes
//! docs/explanation/limits.md with them. A plan, and a run at its start and after events, report values outside of the stated
//! range.

use std::f64::consts::PI;

use cd_formats::compute::EventAction;
use cd_formats::names::{number_text, rounded_number, short_number};

use crate::integrate::{largest_speed, shortest_orbit};
use crate::laws::Cohesion;
use crate::math::Vec3;
use crate::scene::{RigidBody, Scene};
use crate::state::State;

/// Smallest and largest value of a parameter.
pub type ValueRange = [f64; 2];

/// Row of the table of limits.
pub struct ParameterLimit {
    /// Name of the parameter, with its unit.
    pub parameter: &'static str,
    /// Property that holds within the stated range, and the error that the tests measure.
    pub property: &'static str,
    /// Stated range, ends included; a smallest value of 0 and a largest of infinity are no limits.
    pub stated: ValueRange,
    /// Values at which the search for a failure stops, if the property holds there. An end that equals that of the stated
    /// range is not searched beyond.
    pub search: ValueRange,
    /// Values in typical use.
    pub typical: ValueRange,
    /// Values of the parameter in a scene, if it has any and they follow from the scene without a step.
    pub scene_values: Option<fn(&Scene, &State) -> Option<ValueRange>>,
}

/// Smallest and largest values that searches try: numbers of input are at most 1e40, also those that follow from the inverse of a
/// value.
const SMALLEST_NUMBER: f64 = 1e-39;
const LARGEST_NUMBER: f64 = 1e39;

/// Property of scenes of every scale.
const SAME_BOUNCES: &str = "a dozen bounces the same in units of radius and √(radius/g), difference";

pub static RADIUS: ParameterLimit = ParameterLimit {
    parameter: "radius, m",
    property: SAME_BOUNCES,
    stated: [1e-20, 1e20],
    search: [SMALLEST_NUMBER, LARGEST_NUMBER],
    typical: [1e-6, 1e4],
    scene_values: Some(|scene, _| extent(moving_bodies(scene).map(|body| body.radius))),
};

pub static GRAVITY: ParameterLimit = ParameterLimit {
    parameter: "gravity, m/s²",
    property: SAME_BOUNCES,
    stated: [1e-20, 1e20],
    search: [SMALLEST_NUMBER, LARGEST_NUMBER],
    typical: [1e-6, 1e3],
    scene_values: Some(|scene, state| acceleration(scene, state).map(|g| [g, g])),
};

pub static DENSITY: ParameterLimit = ParameterLimit {
    parameter: "density, kg/m³",
    property: SAME_BOUNCES,
    stated: [1e-20, 1e20],
    search: [SMALLEST_NUMBER, LARGEST_NUMBER],
    typical: [1e2, 1e4],
    scene_values: Some(|scene, _| {
        let spheres = moving_bodies(scene).filter(|body| body.is_sphere());
        extent(spheres.map(|body| body.mass / (4.0 / 3.0 * PI * body.radius.powi(3))))
    }),
};

pub static TRAVEL: ParameterLimit = ParameterLimit {
    parameter: "displacement in a step over the radius",
    property: "under `IQS_CLB` a bullet is stopped, error of velocities",
    stated: [0.0, 500.0],
    search: [0.0, LARGEST_NUMBER],
    typical: [1e-3, 0.4],
    scene_values: Some(|scene, state| {
        let [smallest, _] = extent(moving_bodies(scene).map(|body| body.radius))?;
        let travel = largest_speed(scene, state) * scene.options.dt / smallest;
        Some([travel, travel])
    }),
};

pub static TIME_STEP: ParameterLimit = ParameterLimit {
    parameter: "time step over √(radius/g)",
    property: "a column of three is carried, θ ½ and 1, error of its forces",
    stated: [1e-20, 1e5],
    search: [SMALLEST_NUMBER, LARGEST_NUMBER],
    typical: [1e-4, 0.1],
    scene_values: Some(|scene, state| {
        let [smallest, _] = extent(moving_bodies(scene).map(|body| body.radius))?;
        let multiple = scene.options.dt * (acceleration(scene, state)? / smallest).sqrt();
        Some([multiple, multiple])
    }),
};

pub static JAM_TIME_STEP: ParameterLimit = ParameterLimit {
    parameter: "time step of a rod that jams, s",
    property: "friction 0.5 to 10: energy that is gained, over that of the start",
    stated: [1e-4, 0.1],
    search: [1e-5, LARGEST_NUMBER],
    typical: [1e-4, 1e-2],
    scene_values: None,
};

pub static SPIN: ParameterLimit = ParameterLimit {
    parameter: "rotation in a step, rad",
    property: "a ball that spins on a floor rolls at 2/7 of it, error",
    stated: [0.0, 10.0],
    search: [0.0, LARGEST_NUMBER],
    typical: [1e-6, 0.1],
    scene_values: Some(|scene, state| {
        extent(scene.moving_bodies().iter().map(|i| state.w[i.index()].norm() * scene.options.dt))
    }),
};

pub static ORBIT_STEPS: ParameterLimit = ParameterLimit {
    parameter: "steps of an orbit in a period",
    property: "its size over a thousand periods, largest error over (2 pi/steps)²/4",
    stated: [25.0, f64::INFINITY],
    search: [1.0, f64::INFINITY],
    typical: [100.0, 1e4],
    scene_values: Some(|scene, state| {
        let period = shortest_orbit(scene, state);
        period.is_finite().then(|| [period / scene.options.dt; 2])
    }),
};

pub static FRICTION: ParameterLimit = ParameterLimit {
    parameter: "friction",
    property: "energy of spheres never grows without restitution, for steps of 1e-3 to 1e-1 s; by how much of it at most",
    stated: [0.0, 1e3],
    search: [0.0, LARGEST_NUMBER],
    typical: [0.1, 1.0],
    scene_values: Some(|_, state| {
        let with_friction = state.laws.iter().filter(|law| law.has_friction());
        extent(with_friction.map(|law| law.friction_static.max(law.friction_dynamic)))
    }),
};

pub static RESTITUTION: ParameterLimit = ParameterLimit {
    parameter: "restitution",
    property: "energy of spheres never grows without friction, for steps of 1e-3 to 1e-1 s; by how much of it at most",
    stated: [0.0, 1.0],
    search: [0.0, 1.0],
    typical: [0.0, 1.0],
    scene_values: None,
};

pub static COHESION: ParameterLimit = ParameterLimit {
    parameter: "cohesion over weight",
    property: "a chain of ten hangs, E ≤ 1e-12, speed after 200 steps over h, m/s²",
    stated: [0.0, 1e8],
    search: [0.0, LARGEST_NUMBER],
    typical: [0.1, 1e4],
    scene_values: Some(|scene, state| {
        let g = acceleration(scene, state)?;
        let cohesive = state.laws.iter().filter_map(|law| law.cohesion());
        let [_, largest] = extent(cohesive.filter_map(|cohesion| {
            let [_, ratio] = extent(moving_bodies(scene).map(|body| attraction(&cohesion, body) / (body.mass * g)))?;
            Some(ratio)
        }))?;
        Some([largest, largest])
    }),
};

pub static LOOSE_COHESION: ParameterLimit = ParameterLimit {
    parameter: "cohesion over weight, E ≤ 1e-2",
    property: "ten stand or hang for 500 steps, error of the forces",
    stated: [0.0, 1e6],
    search: [0.0, LARGEST_NUMBER],
    typical: [0.1, 1e4],
    scene_values: None,
};

pub static TOP_MASS: ParameterLimit = ParameterLimit {
    parameter: "mass of the top of a stack over the rest",
    property: "it is carried, error of the forces",
    stated: [1e-20, 1e9],
    search: [SMALLEST_NUMBER, LARGEST_NUMBER],
    typical: [1e-3, 1e3],
    scene_values: Some(|scene, _| {
        let [smallest, largest] = extent(moving_bodies(scene).map(|body| body.mass))?;
        Some([1.0, largest / smallest])
    }),
};

pub static CARRIED_SIZE: ParameterLimit = ParameterLimit {
    parameter: "radius of a ball over that of the one that carries it",
    property: "carried, if g h² is less than its radius; error of the forces",
    stated: [1.0, 1e4],
    search: [1.0, LARGEST_NUMBER],
    typical: [1.0, 100.0],
    scene_values: Some(|scene, _| {
        let [smallest, largest] = extent(moving_bodies(scene).map(|body| body.radius))?;
        Some([1.0, largest / smallest])
    }),
};

pub static COLLIDING_MASSES: ParameterLimit = ParameterLimit {
    parameter: "ratio of masses that collide",
    property: "velocities, over the first",
    stated: [1e-20, 1e20],
    search: [SMALLEST_NUMBER, LARGEST_NUMBER],
    typical: [1e-6, 1e6],
    scene_values: None,
};

pub static ATTRACTING_SIZES: ParameterLimit = ParameterLimit {
    parameter: "ratio of radii that attract and touch",
    property: "the pebble rests, error of its weight",
    stated: [1.0, 1e4],
    search: [1.0, LARGEST_NUMBER],
    typical: [1.0, 100.0],
    scene_values: None,
};

pub static ORIGIN_DISTANCE: ParameterLimit = ParameterLimit {
    parameter: "distance from the origin over the radius",
    property: "an elastic blow of balls across all axes, error of velocities",
    stated: [0.0, 1e9],
    search: [0.0, LARGEST_NUMBER],
    typical: [1.0, 1e4],
    scene_values: Some(|scene, state| {
        let moving = scene.moving_bodies();
        extent(moving.iter().map(|i| state.x[i.index()].amax() / scene.bodies[i.index()].radius))
    }),
};

pub static SQUEEZED_OVERLAP: ParameterLimit = ParameterLimit {
    parameter: "overlap of a squeezed ball over its radius",
    property: "between driven walls it stays, speed over theirs",
    stated: [0.0, 0.2],
    search: [0.0, 1.0],
    typical: [1e-4, 1e-2],
    scene_values: None,
};

pub static PARTING_MARGIN: ParameterLimit = ParameterLimit {
    parameter: "x where two touching spheres are spun to (ω/ω_crit)² = 1 ∓ x",
    property: "held below, parted above; error of the force",
    stated: [1e-6, 1e-2],
    search: [1e-20, 1e-2],
    typical: [1e-3, 1e-2],
    scene_values: None,
};

pub static CHAIN_LENGTH: ParameterLimit = ParameterLimit {
    parameter: "length of a chain",
    property: "it is carried at tol 1e-2, error of the force",
    stated: [0.0, 1000.0],
    search: [0.0, 3000.0],
    typical: [10.0, 100.0],
    scene_values: None,
};

pub static SYMMETRIC_STEPS: ParameterLimit = ParameterLimit {
    parameter: "steps of a symmetric pile, in 1 s",
    property: "it stays symmetric while it collapses, m",
    stated: [100.0, 1000.0],
    search: [1.0, 1e5],
    typical: [100.0, 1000.0],
    scene_values: None,
};

/// All rows.
pub static LIMITS: [&ParameterLimit; 21] = [
    &RADIUS,
    &GRAVITY,
    &DENSITY,
    &TRAVEL,
    &TIME_STEP,
    &JAM_TIME_STEP,
    &SPIN,
    &ORBIT_STEPS,
    &FRICTION,
    &RESTITUTION,
    &COHESION,
    &LOOSE_COHESION,
    &TOP_MASS,
    &CARRIED_SIZE,
    &COLLIDING_MASSES,
    &ATTRACTING_SIZES,
    &ORIGIN_DISTANCE,
    &SQUEEZED_OVERLAP,
    &PARTING_MARGIN,
    &CHAIN_LENGTH,
    &SYMMETRIC_STEPS,
];

impl ParameterLimit {
    /// Text of the stated range: `1e-20 to 100000`, `at most 500` or `at least 25`.
    pub fn stated_text(&self) -> String {
        let [smallest, largest] = self.stated.map(number_text);
        match self.stated {
            [0.0, _] => format!("at most {largest}"),
            [_, f64::INFINITY] => format!("at least {smallest}"),
            _ => format!("{smallest} to {largest}"),
        }
    }

    /// Warning about a value of the scene outside of the stated range, if there is one.
    pub fn scene_warning(&self, scene: &Scene, state: &State) -> Option<String> {
        let [smallest, largest] = self.scene_values?(scene, state)?;
        let outside = [(smallest, smallest < self.stated[0]), (largest, largest > self.stated[1])];
        let (value, _) = outside.into_iter().find(|(_, is_outside)| *is_outside)?;
        Some(format!(
            "{}: {}; tested range: {} (\"{}\"), see docs/explanation/limits.md",
            self.parameter,
            short_number(value),
            self.stated_text(),
            self.property
        ))
    }
}

/// Warnings about values of a scene outside of the ranges of the table, now, in its order, and once later events have set
/// gravity, friction or cohesion.
pub fn warnings_with_events(scene: &Scene, state: &State) -> Vec<String> {
    let mut warnings = scene_warnings(scene, state, &[]);
    let mut later: Option<State> = None;
    let mut settings: Vec<&EventAction> = Vec::new();
    for event in scene.events.iter().skip(state.events_done) {
        let action = &event.action;
        let sets_values =
            matches!(action, EventAction::SetGravity(_) | EventAction::SetFriction(..) | EventAction::SetCohesion(..));
        // A repeated event is in the list at each of its times.
        if !sets_values || settings.contains(&action) {
            continue;
        }
        settings.push(action);
        let later = later.get_or_insert_with(|| state.clone());
        later.apply_setting(action, scene);
        let new_warnings = scene_warnings(scene, later, &warnings);
        let when = format!("; from t = {} s on, by an event", rounded_number(event.time));
        warnings.extend(new_warnings.into_iter().map(|warning| warning + &when));
    }
    warnings
}

/// Warnings about values of a scene outside of the ranges of the table, in its order. Parameters of which a warning of `reported`
/// speaks are left out: a repeated event would report each of them again.
pub fn scene_warnings(scene: &Scene, state: &State, reported: &[String]) -> Vec<String> {
    let is_reported = |limit: &ParameterLimit| {
        let text = format!("{}: ", limit.parameter);
        reported.iter().any(|warning| warning.starts_with(&text))
    };
    let limits = LIMITS.iter().filter(|limit| !is_reported(limit));
    limits.filter_map(|limit| limit.scene_warning(scene, state)).collect()
}

/// Smallest and largest of some values; `None` without any.
fn extent(values: impl Iterator<Item = f64>) -> Option<ValueRange> {
    values.fold(None, |range, value| {
        let [smallest, largest] = range.unwrap_or([value; 2]);
        Some([value.min(smallest), value.max(largest)])
    })
}

/// Bodies of which the run computes the motion.
fn moving_bodies(scene: &Scene) -> impl Iterator<Item = &RigidBody> {
    scene.moving_bodies().into_iter().map(|i| &scene.bodies[i.index()])
}

/// Larger one of uniform gravity and surface gravity, m/s²; `None` without gravity.
fn acceleration(scene: &Scene, state: &State) -> Option<f64> {
    let surface = scene.surface_gravity().map_or(0.0, |(_, gravity)| gravity);
    Some(Vec3::norm(&state.gravity).max(surface)).filter(|g| *g > 0.0)
}

/// Attraction between two bodies as this one, N; 0 for bonds, whose area is that of their contact.
fn attraction(cohesion: &Cohesion, body: &RigidBody) -> f64 {
    match cohesion {
        Cohesion::Wet { force, .. } => *force,
        Cohesion::Pair(pair) => pair.force(0.5 * body.radius),
        Cohesion::Bond { .. } => 0.0,
    }
}
