//! Plan of a run, for `--plan`: its models and unused models, memory, time, and lengths h of a step that suit the scene.
//!
//! Nothing is written; a few steps are made with a copy of the state, and timed.

mod division;
pub mod limits;

use std::time::{Duration, Instant};

use cd_formats::compute::Accuracy;
use cd_formats::names::{count_text, ratio_text, rounded_number, short_number};
use cd_formats::presets::PresetOption;

use crate::accuracy_control::chosen_text;
use crate::integrate::{fastest_spin, largest_speed, shortest_orbit, shortest_rotation};
use crate::math::Vec3;
use crate::scene::{BodyId, BodyPart, BodyShape, ContactorShape, ImposedVelocity, RigidBody, Scene};
use crate::solve::gauss_seidel::diagonal::batches::ContactBatch;
use crate::state::{Contact, PairVirial, SolvedContact, State};
use crate::step::{StageTimes, StepReport, step};
use crate::write;

/// Limits of a trial: number of steps and time, whichever is reached first. The first step, from a cold start, is not
/// timed.
const MAX_TRIAL_STEPS: u64 = 20;
const MAX_TRIAL_TIME: Duration = Duration::from_secs(2);
/// Multiple of the strictest bound on h beyond which no step is tried.
const MAX_TRIAL_DT_FACTOR: f64 = 100.0;

/// Largest displacement and largest free fall in a step, in radii: they determine penetrations and missed bounces.
const MAX_TRAVEL_RADII: f64 = 0.1;
const MAX_FALL_RADII: f64 = 1e-3;
/// Steps in the shortest orbit or rotation of a field, and in a radian of the fastest rotation: phase errors of 2e-4 per orbit and 1e-3 per radian.
const STEPS_PER_ORBIT: f64 = 100.0;
const STEPS_PER_RADIAN: f64 = 10.0;

/// Position error of a body by rounding in a run, as a fraction of its radius, from which on a warning is printed.
const ROUNDOFF_WARNING_SHARE: f64 = 1e-2;

/// Bound on the length of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct StepBound {
    /// Largest h, s.
    pub h: f64,
    /// Process that sets the bound, as text.
    pub reason: String,
}

/// Bounds on h, the smallest first.
pub fn step_bounds(scene: &Scene, state: &State) -> Vec<StepBound> {
    let moving_ids = scene.moving_bodies();
    let moving_bodies: Vec<(usize, &RigidBody)> =
        moving_ids.iter().map(|&i| (i.index(), &scene.bodies[i.index()])).collect();
    let smallest = moving_bodies.iter().map(|(_, body)| body.radius).fold(f64::INFINITY, f64::min);
    let fastest = largest_speed(scene, state);
    let travel = MAX_TRAVEL_RADII * smallest;
    // A fall limits travel by its impact speed (m/s), and its first step by its acceleration (m/s²).
    let fall_bounds = |impact: String, speed: f64, acceleration: f64| {
        [
            StepBound {
                h: travel / speed,
                reason: format!(
                    "{impact}, {} m/s: {MAX_TRAVEL_RADII} of the smallest radius per step",
                    short_number(speed)
                ),
            },
            StepBound {
                h: (MAX_FALL_RADII * scene.mean_radius / acceleration).sqrt(),
                reason: format!(
                    "free fall at {} m/s²: {MAX_FALL_RADII} of the mean radius per step",
                    short_number(acceleration)
                ),
            },
        ]
    };
    let mut bounds = vec![StepBound {
        h: travel / fastest,
        reason: format!(
            "largest speed {} m/s: {MAX_TRAVEL_RADII} of the smallest radius per step",
            short_number(fastest)
        ),
    }];
    if let Some((radius, surface_gravity)) = scene.surface_gravity() {
        let speed = (2.0 * surface_gravity * radius).sqrt();
        bounds.extend(fall_bounds("impact speed of a gravitational collapse".into(), speed, surface_gravity));
    }
    let period = shortest_orbit(scene, state);
    bounds.push(StepBound {
        h: period / STEPS_PER_ORBIT,
        reason: format!("shortest orbital period {} s: {STEPS_PER_ORBIT} steps per orbit", short_number(period)),
    });
    let period = shortest_rotation(scene);
    bounds.push(StepBound {
        h: period / STEPS_PER_ORBIT,
        reason: format!("rotation of a field in {} s: {STEPS_PER_ORBIT} steps per rotation", short_number(period)),
    });
    let g = state.gravity.norm();
    if g > 0.0 {
        let heights = || moving_bodies.iter().map(|(i, _)| -state.x[*i].dot(&state.gravity) / g);
        let lowest = heights().fold(floor_height(scene, state) + smallest, f64::min);
        let height = heights().fold(f64::NEG_INFINITY, f64::max) - lowest;
        let speed = (2.0 * g * height).sqrt();
        bounds.extend(fall_bounds(format!("impact speed of a fall through {} m", short_number(height)), speed, g));
    }
    let spin = fastest_spin(scene, state);
    bounds.push(StepBound {
        h: 1.0 / (STEPS_PER_RADIAN * spin),
        reason: format!("fastest rotation {} rad/s: {STEPS_PER_RADIAN} steps per radian", short_number(spin)),
    });
    bounds.retain(|bound| bound.h.is_finite() && bound.h > 0.0);
    bounds.sort_by(|a, b| a.h.total_cmp(&b.h));
    bounds
}

/// Height of the lowest wall against gravity, m: the height of its upper side, of the centre of polyhedra and solid cylinders,
/// or of the lowest point of a surface; infinite without walls.
fn floor_height(scene: &Scene, state: &State) -> f64 {
    let up = -state.gravity.normalize();
    let top = |i: usize| {
        let along = state.q[i].inverse_transform_vector(&up);
        let reach = match scene.bodies[i].shape {
            BodyShape::Sphere { .. } => scene.bodies[i].radius,
            BodyShape::Plane { half_lengths } => half_lengths.dot(&along.abs()),
            BodyShape::Parts => {
                let parts = scene.parts_of(BodyId::new(i)).iter();
                // Grains lie inside a hollow cylinder, down to its lower side.
                let side = |part: &BodyPart| match part.geometry {
                    ContactorShape::Sphere { radius } => radius,
                    ContactorShape::Cylinder { hollow: true, radius, .. } => -radius,
                    ContactorShape::Mesh(_) => -part.geometry.support_height(&part.axes, &-along),
                    _ => 0.0,
                };
                parts.map(|part| part.offset.dot(&along) + side(part)).fold(f64::INFINITY, f64::min)
            }
        };
        state.x[i].dot(&up) + reach
    };
    let walls = (0..scene.bodies.len()).filter(|&i| scene.walls[i] && !scene.bodies[i].absent);
    walls.map(top).fold(f64::INFINITY, f64::min)
}

/// Warning about positions with too few digits: a step rounds them twice, by up to half the spacing of numbers.
///
/// This is a warning, not an error: leading digits that bodies have in common do no harm, for example if all are far out
/// along an axis along which none moves.
pub fn roundoff_warning(scene: &Scene, state: &State) -> Option<String> {
    let steps = scene.last_step().saturating_sub(state.step).max(1);
    let spacing = |i: BodyId| f64::EPSILON * state.x[i.index()].amax();
    let error_share = |i: BodyId| steps as f64 * spacing(i) / scene.bodies[i.index()].radius;
    let worst = scene.free.iter().copied().max_by(|a, b| error_share(*a).total_cmp(&error_share(*b)))?;
    (error_share(worst) > ROUNDOFF_WARNING_SHARE).then(|| {
        format!(
            "body {} is {:.3e} m from the origin, where positions are rounded to {:.1e} m: in {steps} steps round-off may displace it by {:.1e} of its radius",
            worst.number(),
            state.x[worst.index()].norm(),
            spacing(worst),
            error_share(worst)
        )
    })
}

/// Models that are inactive because the scene does not use them, with the simpler form of the equations that follows.
pub fn unused_models(scene: &Scene) -> Vec<&'static str> {
    let laws = &scene.laws;
    let rolling = laws.iter().any(crate::laws::ContactLaw::has_moments);
    let absent = [
        (!scene.walls.contains(&true), "walls"),
        (!scene.needs_blocks(), "full 3x3 contact blocks of polyhedra (the diagonal suffices)"),
        (!scene.options.orients_spheres() && scene.postpro.is_empty(), "orientation of spheres"),
        (scene.free_rotors.is_empty(), "change of angular velocity without torque (moments of inertia are equal)"),
        (
            laws.iter().all(|law| law.friction_static == 0.0 && law.friction_dynamic == 0.0),
            // Sweeps with moments keep all three components.
            if rolling { "friction" } else { "friction (one unknown per contact, not three)" },
        ),
        (laws.iter().all(|law| law.cohesion.is_none()), "cohesion"),
        (!rolling, "rolling friction"),
        (!scene.options.self_gravity, "self-gravity"),
        (scene.options.fields.is_empty(), "external fields"),
        (!scene.drives.iter().any(ImposedVelocity::ever_moves), "imposed motion"),
        (scene.events.is_empty(), "events"),
    ];
    absent.into_iter().filter(|(is_absent, _)| *is_absent).map(|(_, model)| model).collect()
}

/// Number of instants at which a plan tests whether imposed motion is constant.
const MOTION_SAMPLES: u32 = 1000;

/// Fraction of the time from `start` (s) to the end of the run in which no imposed velocity or force changes, so that
/// steps may be longer than dt; accurate to a thousandth.
fn share_of_constant_motion(scene: &Scene, start: f64) -> f64 {
    let sample_time = |k: u32| start + (f64::from(k) + 0.5) / f64::from(MOTION_SAMPLES) * (scene.end_time() - start);
    let constant = (0..MOTION_SAMPLES).map(sample_time).filter(|time| scene.constant_until(*time) > *time).count();
    constant as f64 / f64::from(MOTION_SAMPLES)
}

/// Largest memory use of this program so far, bytes; known on Linux.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(1024 * peak.trim().strip_suffix(" kB")?.parse::<u64>().ok()?)
}

/// Approximate number of bytes per contact: its stored data and its data in a step.
fn contact_size() -> usize {
    let row = size_of::<crate::assemble::ContactConstraint>()
        + size_of::<ContactBatch<f64>>() / crate::solve::gauss_seidel::packed::BATCH_LANES;
    size_of::<Contact>() + 2 * size_of::<SolvedContact>() + row + 8 * size_of::<Vec3>()
}

/// A line of the plan: its title, empty if it continues the line before, and its text.
type PlanLine = (&'static str, String);

/// Returns the plan as text, with the division of the sweeps among `ranks` if requested.
pub fn plan_text(scene: &Scene, state: &State, ranks: Option<usize>) -> String {
    let bounds = step_bounds(scene, state);
    let mut lines: Vec<PlanLine> = vec![("models", scene.model_names().join("; "))];
    lines.push(("inactive", unused_models(scene).join("; ")));
    // Steps that are far too long may take hours.
    let is_tried = bounds.first().is_none_or(|strictest| scene.options.dt <= MAX_TRIAL_DT_FACTOR * strictest.h);
    let trial = if is_tried { trial_run(scene, state) } else { None };
    if let Some(TrialRun { report, .. }) = &trial {
        let (listed, active) = (report.contacts_listed, report.contacts_active);
        lines.push(("contacts", format!("{listed} listed, {active} carry force at present")));
    }
    lines.push(("memory", memory_estimate()));
    lines.push((
        "time",
        trial.as_ref().map_or(
            format!("no trial step: dt is more than {MAX_TRIAL_DT_FACTOR} times the strictest bound"),
            TrialRun::timing_text,
        ),
    ));
    if let (Some(ranks), true) = (ranks, trial.is_some()) {
        lines.extend(division::division_lines(scene, state, ranks, contact_size()));
    }
    lines.push(("accuracy", accuracy_text(scene)));
    let constant_share = share_of_constant_motion(scene, state.time);
    let max_multiple = if constant_share > 0.0 { scene.options.adaptive().max_multiple } else { 1 };
    let dt_left = scene.last_step().saturating_sub(state.step);
    if let Some(trial) = &trial {
        lines.push(("disk", disk_estimate(scene, dt_left, trial)));
    }
    let longest = LongestSteps { max_multiple, constant_share };
    lines.push(("run", run_estimate(scene, dt_left, longest, trial.as_ref())));
    lines.extend(step_lines(scene, &bounds, max_multiple));
    lines.extend(preset_lines(&bounds));
    let warnings = roundoff_warning(scene, state).into_iter().chain(limits::warnings_with_events(scene, state));
    lines.extend(warnings.map(|message| ("warning", message)));
    lines
        .into_iter()
        .filter(|(_, value)| !value.is_empty())
        .map(|(name, value)| format!("  {name:<22} {value}\n"))
        .collect()
}

/// Memory of the program until now, and of each further contact.
fn memory_estimate() -> String {
    let until_now = peak_memory().map_or(String::new(), |peak| format!("peak so far {:.1} MB; ", peak as f64 / 1e6));
    format!(
        "{until_now}about {:.1} kB for each further contact and {} bytes for each pair that touches between two snapshots",
        contact_size() as f64 / 1e3,
        size_of::<PairVirial>()
    )
}

/// Options of accuracy that target errors choose, whose values are rounded in text.
const CHOSEN_OPTIONS: [&str; 4] = ["adaptive", "tol", "penetration_tol", "gravity_error"];

/// Preset of the run, and the options that it or the target errors set.
fn accuracy_text(scene: &Scene) -> String {
    let options = &scene.options;
    let has_targets = options.target_error.is_some();
    let option_text = |PresetOption { name, value, is_set }: PresetOption| {
        let value = if name == "gravity_refresh" { scene.gravity_refresh().to_string() } else { value };
        format!("{name} {value}{}", if is_set { " (set)" } else { "" })
    };
    let others = options.accuracy_options().into_iter();
    let others = others.filter(|option| !(has_targets && CHOSEN_OPTIONS.contains(&option.name))).map(option_text);
    let chosen = has_targets.then(|| chosen_text(options));
    let texts: Vec<String> = chosen.into_iter().chain(others).collect();
    let preset = match options.accuracy {
        Some(accuracy) => accuracy.to_string(),
        None if has_targets => {
            "chosen at the start by the target errors; comparisons take an eighth of the sweeps, in short runs a third"
                .into()
        }
        None => "no preset".into(),
    };
    format!("{preset}: {}", texts.join(", "))
}

/// Largest number of `dt` in a step, and the share of the time in which imposed motion is constant and steps may be so long.
struct LongestSteps {
    max_multiple: u64,
    constant_share: f64,
}

/// Number of steps of the `dt_left` `dt` of a run, and their time at the rate of the trial.
fn run_estimate(scene: &Scene, dt_left: u64, longest: LongestSteps, trial: Option<&TrialRun>) -> String {
    let steps = match (longest.max_multiple, trial) {
        (1, _) if scene.options.adaptive().is_on() => {
            format!("{} of one dt, because imposed motion changes at all times", count_text(dt_left as usize, "step"))
        }
        (1, _) | (_, None) => count_text(dt_left as usize, "step"),
        (max_multiple, Some(trial)) => {
            let when = if longest.constant_share < 1.0 {
                format!(
                    " in the {:.3} % of the time in which imposed motion is constant",
                    100.0 * longest.constant_share
                )
            } else {
                String::new()
            };
            format!(
                "{dt_left} dt, up to {max_multiple} dt per step{when}, {:.1} dt per step in the trial",
                trial.mean_multiple()
            )
        }
    };
    let seconds = |trial: &TrialRun| {
        let seconds = dt_left as f64 * trial.seconds_per_step() / trial.mean_multiple();
        format!(" {} s at the rate of the trial;", short_number(seconds))
    };
    let seconds = trial.map_or(String::new(), seconds);
    format!("{steps};{seconds} to t = {} s", rounded_number(scene.end_time()))
}

/// `dt` against the strictest of the `bounds`, and all of these.
fn step_lines(scene: &Scene, bounds: &[StepBound], max_multiple: u64) -> Vec<PlanLine> {
    let h = scene.options.dt;
    let dt_text = rounded_number(h);
    let verdict = match bounds.first() {
        Some(strictest) if h > strictest.h => {
            format!("{dt_text} s is {} times the strictest bound", ratio_text(h / strictest.h))
        }
        Some(_) if max_multiple > 1 => {
            format!(
                "{dt_text} s is within all bounds on a step; longer steps are limited by adaptive's travel and penetration"
            )
        }
        Some(_) => format!("{dt_text} s is within all bounds on a step"),
        None => format!("{dt_text} s; no bound: nothing moves and no force acts"),
    };
    let bound_lines = bounds.iter().map(|bound| ("", format!("up to {} s: {}", short_number(bound.h), bound.reason)));
    [("dt", verdict)].into_iter().chain(bound_lines).collect()
}

/// The presets, each with its `dt` by the strictest of the `bounds`, cost and errors.
fn preset_lines(bounds: &[StepBound]) -> [PlanLine; Accuracy::ALL.len()] {
    let suited_dt = |accuracy: Accuracy| {
        let dt = bounds.first().map(|strictest| short_number(accuracy.step_factor() * strictest.h));
        dt.map_or(String::new(), |dt| format!("dt up to {dt} s; "))
    };
    Accuracy::ALL.map(|accuracy| {
        let text = format!("{accuracy}: {}{}", suited_dt(accuracy), accuracy.measured_cost_and_error());
        (if accuracy == Accuracy::Draft { "presets" } else { "" }, text)
    })
}

/// Disk space of the files that a run of `dt_left` `dt` still writes, if its steps are like the steps of the trial.
fn disk_estimate(scene: &Scene, dt_left: u64, trial: &TrialRun) -> String {
    let options = &scene.options;
    let [row, snapshot] = trial.sizes;
    let snapshots = dt_left.div_ceil(options.output_every) + 1;
    let rows = dt_left as f64 / trial.mean_multiple().max(options.log_every as f64);
    let rows = rows.max(snapshots.min(dt_left) as f64).ceil();
    let megabytes = |count: f64, bytes: usize| count * bytes as f64 / 1e6;
    format!(
        "{} MB: {} of {} MB, {} of {row} bytes in steps.csv and TIMER.csv",
        short_number(megabytes(snapshots as f64, snapshot) + megabytes(rows, row)),
        count_text(snapshots as usize, "snapshot"),
        short_number(megabytes(1.0, snapshot)),
        count_text(rows as usize, "row")
    )
}

/// Trial steps made with a copy of the state.
struct TrialRun {
    clock: StageTimes,
    /// Number of timed steps.
    steps: u64,
    /// Total number of `dt` in the timed steps.
    dt_count: u64,
    /// Report of the last step.
    report: StepReport,
    /// Sizes of a row of the logs and of a snapshot, bytes.
    sizes: [usize; 2],
}

impl TrialRun {
    /// Mean number of `dt` in a timed step.
    fn mean_multiple(&self) -> f64 {
        self.dt_count.max(1) as f64 / self.steps.max(1) as f64
    }

    /// Time per step, s.
    fn seconds_per_step(&self) -> f64 {
        let StageTimes { gravity, detection, assembly, solve, integration, .. } = self.clock;
        (gravity + detection + assembly + solve + integration).as_secs_f64() / self.steps.max(1) as f64
    }

    /// Time of a step and of its stages, as text.
    fn timing_text(&self) -> String {
        let StageTimes { gravity, detection, assembly, solve, integration, .. } = self.clock;
        let steps = self.steps;
        let ms = |time: Duration| 1e3 * time.as_secs_f64() / steps.max(1) as f64;
        format!(
            "{:.3} ms per step ({}): gravity {:.3}, detection {:.3}, assembly {:.3}, solve {:.3}, integration {:.3}",
            1e3 * self.seconds_per_step(),
            count_text(steps as usize, "trial step"),
            ms(gravity),
            ms(detection),
            ms(assembly),
            ms(solve),
            ms(integration)
        )
    }
}

/// Makes the trial steps; returns `None` if the program was requested to stop.
fn trial_run(scene: &Scene, state: &State) -> Option<TrialRun> {
    let mut state = state.clone();
    let mut report = step(scene, &mut state, &mut StageTimes::default())?;
    let (start, first_step) = (Instant::now(), state.step);
    let (mut clock, mut steps) = (StageTimes::default(), 0);
    while steps < MAX_TRIAL_STEPS && start.elapsed() < MAX_TRIAL_TIME && state.is_finite() {
        report = step(scene, &mut state, &mut clock)?;
        steps += 1;
    }
    let sizes = write::output_sizes(scene, &state, &report);
    Some(TrialRun { clock, steps, dt_count: state.step - first_step, report, sizes })
}
