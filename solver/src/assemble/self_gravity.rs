//! Self-gravity in a step: evaluated or extrapolated, with the quadrupoles of near bodies.

use std::sync::Arc;

use cd_formats::snapshot::GravityEvaluations as Record;

use crate::geometry::near_pairs;
use crate::gravity::direct;
use crate::gravity::quadrupole::{BodyInertia, quadrupole_correction};
use crate::gravity::sample::{self, SampledError};
use crate::gravity::{GravityField, GravitySolver, SummationMethod, balance_accelerations};
use crate::integrate::ContactConfiguration;
use crate::math::{Mat3, Quat, Vec3};
use crate::scene::{BodyId, Scene};
use crate::state::{BodyLoad, GravityHistory, State};

/// Accuracy of self-gravity.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GravityReport {
    /// RMS of the correction that makes forces and torques sum to zero, divided by that of the accelerations.
    pub removed: f64,
    /// Error against the direct sum, in steps that sample it.
    pub sampled: Option<SampledError>,
    /// RMS relative error of the extrapolation to the last evaluation.
    pub extrapolation: f64,
}

/// Self-gravity in a step.
pub(super) struct SelfGravity {
    /// Acceleration of each free body, m/s^2; empty without self-gravity.
    pub acceleration: Vec<Vec3>,
    /// Potential energy, J.
    pub energy: f64,
    pub report: GravityReport,
    pub next: Option<GravityHistory>,
}

/// Contribution of the shapes of near bodies to self-gravity.
#[derive(Default)]
pub(super) struct NearField {
    /// Load of each free body.
    pub loads: Vec<BodyLoad>,
    /// Potential energy, J.
    pub energy: f64,
}

/// Relative error required of self-gravity for the energies from which a run's drift is computed, twice a run: with it that
/// of 40 000 bodies in a ball is off by 6e-10 of itself.
const ENERGY_ERROR: f64 = 1e-6;

/// Share of the error allowed for self-gravity that its extrapolation may reach.
const EXTRAPOLATION_ERROR_SHARE: f64 = 0.25;

/// Largest ratio of the time of extrapolation of self-gravity to the time between its last two evaluations.
const MAX_EXTRAPOLATION_RATIO: f64 = 2.0;

/// Largest distance, divided by the sum of the radii, at which bodies feel each other's quadrupoles if attraction is
/// not summed pair by pair.
const QUADRUPOLE_RANGE: f64 = 3.0;

/// Self-gravity at each free body; no accelerations if the scene has none.
pub(super) fn self_gravity(scene: &Scene, state: &State, q_c: &ContactConfiguration) -> SelfGravity {
    if !scene.has_self_gravity() {
        return SelfGravity { acceleration: Vec::new(), energy: 0.0, report: GravityReport::default(), next: None };
    }
    let (positions, masses) = point_masses(scene, &q_c.x);
    let mut gravity = if scene.gravity_refresh() == 1 {
        let GravityEvaluation { acceleration, energy, removed } =
            evaluate_self_gravity(scene, &q_c.order, &positions, &masses);
        let report = GravityReport { removed, ..GravityReport::default() };
        SelfGravity { acceleration, energy, report, next: None }
    } else {
        extrapolate_self_gravity(scene, state, q_c, &positions, &masses)
    };
    let approximate =
        scene.gravity_refresh() > 1 || scene.gravity_solver().method_for(masses.len()) == SummationMethod::Fmm;
    // The sample consists of points.
    let approximate = approximate && scene.attracting_radii().is_none();
    if approximate && state.is_diagnostic_step(q_c.step_multiple) {
        let constant = scene.options.gravity_constant;
        gravity.report.sampled =
            Some(sample::sampled_error(&positions, &masses, constant, &gravity.acceleration, state.step));
    }
    gravity
}

/// Positions (m) and masses (kg) of the free bodies, with all bodies at `x`.
pub(super) fn point_masses(scene: &Scene, x: &[Vec3]) -> (Vec<Vec3>, Vec<f64>) {
    scene.free.iter().map(|&i| (x[i.index()], scene.bodies[i.index()].mass)).unzip()
}

/// Evaluation of self-gravity.
struct GravityEvaluation {
    /// Acceleration of each free body, m/s².
    acceleration: Vec<Vec3>,
    /// Potential energy, J.
    energy: f64,
    /// See [`GravityReport::removed`].
    removed: f64,
}

/// Evaluates self-gravity; `order` is the order of all bodies along Morton's curve.
fn evaluate_self_gravity(scene: &Scene, order: &[u32], positions: &[Vec3], masses: &[f64]) -> GravityEvaluation {
    let constant = scene.options.gravity_constant;
    if let Some(radii) = scene.attracting_radii() {
        let (acceleration, potential) = ball_accelerations(positions, masses, &radii, constant);
        return GravityEvaluation { acceleration, energy: half_potential(&potential, masses), removed: 0.0 };
    }
    let free_index = |&body: &u32| scene.free.binary_search(&BodyId(body)).ok().map(|k| k as u32);
    let free_order: Vec<u32> = order.iter().filter_map(free_index).collect();
    let GravityField { acceleration, potential, removed } =
        scene.gravity_solver().full_field(positions, masses, constant, &free_order);
    GravityEvaluation { acceleration, energy: half_potential(&potential, masses), removed }
}

/// Accelerations (m/s²) and potentials (J/kg) of homogeneous balls.
fn ball_accelerations(positions: &[Vec3], masses: &[f64], radii: &[f64], constant: f64) -> (Vec<Vec3>, Vec<f64>) {
    // By more than rounding, so that no pair that overlaps is missed.
    let reaches: Vec<f64> = radii.iter().map(|radius| radius * (1.0 + 1e-9)).collect();
    direct::ball_accelerations(positions, masses, radii, &near_pairs(positions, &reaches), constant)
}

/// Potential energy, J, of bodies in the potential (J/kg) of each other.
fn half_potential(potential: &[f64], masses: &[f64]) -> f64 {
    0.5 * potential.iter().zip(masses).map(|(p, m)| p * m).sum::<f64>()
}

/// Self-gravity extrapolated from its last two evaluations, or evaluated again. The error of the extrapolation grows with the
/// square of the time since the last evaluation. This time is at most twice the time between the two evaluations, and less if
/// their error requires it. Forces and torques sum to zero in both cases.
fn extrapolate_self_gravity(
    scene: &Scene,
    state: &State,
    q_c: &ContactConfiguration,
    positions: &[Vec3],
    masses: &[f64],
) -> SelfGravity {
    let options = &scene.options;
    let now = state.time + (1.0 - options.theta) * q_c.h;
    let mass: f64 = masses.iter().sum();
    let velocities = || scene.free.iter().map(|&i| state.v[i.index()]);
    let mean_velocity = velocities().zip(masses).map(|(v, m)| v * *m).sum::<Vec3>() / mass;
    let largest_speed = velocities().map(|v| (v - mean_velocity).norm_squared()).fold(0.0, f64::max).sqrt();
    let Some(old) = &state.attraction else {
        let GravityEvaluation { acceleration, energy, removed } =
            evaluate_self_gravity(scene, &q_c.order, positions, masses);
        let record = Record { times: [now; 2], potentials: [energy; 2], removed, ..Record::default() };
        let rows: Arc<[Vec3]> = acceleration.as_slice().into();
        let next = GravityHistory { record, last: rows.clone(), previous: rows };
        let report = GravityReport { removed, ..GravityReport::default() };
        return SelfGravity { acceleration, energy, report, next: Some(next) };
    };
    let record = &old.record;
    let [last, before] = record.times;
    let extrapolation = if last > before { (now - last) / (last - before) } else { 0.0 };
    let mut acceleration: Vec<Vec3> =
        old.last.iter().zip(&*old.previous).map(|(a, b)| a + (a - b) * extrapolation).collect();
    let (age, moved) = (record.age + q_c.step_multiple, record.moved + largest_speed * q_c.h);
    // The error after a time s, extrapolated over an interval t, is proportional to s (s + t).
    let allowed = EXTRAPOLATION_ERROR_SHARE * options.gravity_error() / record.extrapolation_error;
    let max_extrapolation = 0.5 * ((1.0 + 8.0 * allowed).sqrt() - 1.0).min(2.0 * MAX_EXTRAPOLATION_RATIO);
    // Slack of a thousandth of a step, as times are sums.
    let is_in_reach = last > before && now - last <= (last - before) * max_extrapolation + 1e-3 * options.dt;
    let report = |removed, extrapolation| GravityReport { removed, sampled: None, extrapolation };
    if is_in_reach && age < scene.gravity_refresh() && moved < options.gravity_moved * scene.mean_radius {
        let removed = balance_accelerations(positions, masses, &mut acceleration);
        let energy = record.potentials[0] + (record.potentials[0] - record.potentials[1]) * extrapolation;
        let report = report(record.removed.max(removed), record.extrapolation_error);
        let record = Record { age, moved, ..record.clone() };
        return SelfGravity { acceleration, energy, report, next: Some(GravityHistory { record, ..old.clone() }) };
    }
    let GravityEvaluation { acceleration: fresh, energy, removed } =
        evaluate_self_gravity(scene, &q_c.order, positions, masses);
    let sum_of_squares = |v: &mut dyn Iterator<Item = Vec3>| v.map(|v| v.norm_squared()).sum::<f64>();
    let error_sum = sum_of_squares(&mut acceleration.iter().zip(&fresh).map(|(a, b)| a - b));
    let acceleration_sum = sum_of_squares(&mut fresh.iter().copied());
    let extrapolation_error = if acceleration_sum > 0.0 { (error_sum / acceleration_sum).sqrt() } else { 0.0 };
    let times = [now, last];
    let potentials = [energy, record.potentials[0]];
    let record = Record { age: 0, times, potentials, moved: 0.0, removed, extrapolation_error };
    let next = GravityHistory { record, last: fresh.as_slice().into(), previous: old.last.clone() };
    SelfGravity { acceleration: fresh, energy, report: report(removed, extrapolation_error), next: Some(next) }
}

/// Contribution of the quadrupoles, if the option enables it, summed pair by pair in an order that depends only on the
/// positions.
pub(super) fn near_field(scene: &Scene, x: &[Vec3], q: &[Quat]) -> NearField {
    let options = &scene.options;
    if !(scene.has_self_gravity() && options.gravity_quadrupole) {
        return NearField::default();
    }
    let inertia_of = |&i: &BodyId| {
        let (body, turn) = (&scene.bodies[i.index()], q[i.index()].to_rotation_matrix());
        let inertia = turn * Mat3::from_diagonal(&body.inertia.into()) * turn.transpose();
        BodyInertia { mass: body.mass, inertia }
    };
    let inertias: Vec<BodyInertia> = scene.free.iter().map(inertia_of).collect();
    let (positions, reaches): (Vec<Vec3>, Vec<f64>) =
        scene.free.iter().map(|&i| (x[i.index()], QUADRUPOLE_RANGE * scene.bodies[i.index()].radius)).unzip();
    let no_load = |&body: &BodyId| BodyLoad { body, force: Vec3::zeros(), torque: Vec3::zeros() };
    let mut field = NearField { loads: scene.free.iter().map(no_load).collect(), energy: 0.0 };
    let is_round: Vec<bool> = scene.free.iter().map(|&i| scene.bodies[i.index()].is_isotropic()).collect();
    let mut add_pair = |[i, j]: [usize; 2], reach: f64| {
        let r = positions[j] - positions[i];
        if (is_round[i] && is_round[j]) || r == Vec3::zeros() {
            return;
        }
        let correction = quadrupole_correction(&r, [&inertias[i], &inertias[j]], reach, options.gravity_constant);
        field.energy += correction.energy;
        for (k, force, torque) in
            [(i, -correction.force, correction.torques[0]), (j, correction.force, correction.torques[1])]
        {
            field.loads[k].force += force;
            field.loads[k].torque += torque;
        }
    };
    if scene.gravity_solver().method_for(positions.len()) == SummationMethod::Direct {
        (1..positions.len()).for_each(|j| (0..j).for_each(|i| add_pair([i, j], f64::INFINITY)));
    } else {
        for pair in near_pairs(&positions, &reaches) {
            let [i, j] = pair.map(|k| k as usize);
            add_pair([i, j], reaches[i] + reaches[j]);
        }
    }
    field
}

/// Potential energy of the free bodies as points or balls in self-gravity, to the accuracy of [`ENERGY_ERROR`], J.
pub(super) fn mutual_energy(scene: &Scene, positions: &[Vec3], masses: &[f64]) -> f64 {
    let constant = scene.options.gravity_constant;
    if let Some(radii) = scene.attracting_radii() {
        return half_potential(&ball_accelerations(positions, masses, &radii, constant).1, masses);
    }
    let gravity = match scene.gravity_solver() {
        requested if requested.method_for(positions.len()) == SummationMethod::Direct => requested,
        _ => GravitySolver::new(SummationMethod::Auto, ENERGY_ERROR),
    };
    half_potential(&gravity.full_field(positions, masses, constant, &[]).potential, masses)
}
