//! Summary of a run: figures that the loop over steps collects, and the text that `cli` prints at the end.

use std::fmt::Write;
use std::time::Duration;

use cd_formats::compute::ContactSolver;
use cd_formats::names::{count_text, rounded_number};

use crate::detect::NarrowPhaseError;
use crate::gravity::sample::SampledError;
use crate::math::Vec3;
use crate::ranks::RankTraffic;
use crate::scene::Scene;
use crate::state::State;
use crate::step::{BalanceErrors, OVERLAP_WARNING_SHARE, Overlap, StageTimes, StepReport};

use super::errors::{self, ErrorEstimator, ErrorSource, ForceNoise};

/// Figures of this run's steps that are not in the state.
#[derive(Debug, Clone, Default)]
pub struct RunStatistics {
    pub steps: u64,
    /// Condition that has ended the run before its last step.
    pub met_condition: Option<String>,
    /// Numbers of bodies that have left and are still to enter, if the run has sinks or sources.
    pub presence: Option<String>,
    /// Total length of the steps in units of `dt`.
    pub dt_count: u64,
    /// Longest step, s.
    pub longest_step: f64,
    /// Number of sweeps over all steps.
    pub sweeps: u64,
    /// Whether impacts one after the other did not end in some step.
    pub has_unended_impacts: bool,
    /// Number of steps that did not converge.
    pub unconverged: u64,
    /// Last measured error of self-gravity.
    pub gravity: Option<SampledError>,
    /// Last measured error of the fast narrow phase.
    pub narrow_phase_error: Option<NarrowPhaseError>,
    /// Largest number of bonds at a time.
    pub bonds: usize,
    /// Number of steps that a solver on the assembled matrix has solved.
    pub fallback_steps: u64,
    /// Number of steps that were swept in single precision.
    pub single_precision_steps: u64,
    /// Number of unconverged steps without fallback, because it had failed before.
    pub steps_without_fallback: u64,
    /// Deepest overlap of the run, its start and end included, if it is worth a warning.
    pub overlap: Option<Overlap>,
    /// Deepest overlap of two bodies of which neither can move along the normal of their contact.
    pub inert_overlap: Option<Overlap>,
    /// Deepest overlap of the last state, m.
    pub penetration_end: f64,
    pub warnings: Vec<String>,
    /// Whether `dt` is too long even for a draft.
    pub has_long_steps: bool,
    pub threads: usize,
    /// Traffic of each rank; empty if there is one.
    pub traffic: Vec<RankTraffic>,
    /// Division of the contacts among ranks; `None` if there is one rank.
    pub contact_parts: Option<ContactParts>,
    /// Duration of the run.
    pub wall_time: Duration,
    /// Time of all steps by stage.
    pub stage_times: StageTimes,
    /// Estimates of all steps, including those before a resume.
    pub estimator: ErrorEstimator,
}

/// Contacts of the ranks of a run.
#[derive(Debug, Clone, Copy)]
pub struct ContactParts {
    /// Reason why each rank has all contacts; `None` if they are divided.
    pub undivided_reason: Option<&'static str>,
    /// Largest number of contacts that a rank has had at the end of a step.
    pub largest_part: usize,
}

impl ContactParts {
    /// Adds the number of contacts of a rank.
    pub fn add_part(&mut self, contacts: usize) {
        self.largest_part = self.largest_part.max(contacts);
    }
}

impl RunStatistics {
    /// Probable cause of noisy contact forces.
    fn force_noise(&self) -> ForceNoise {
        if self.has_long_steps {
            ForceNoise::LongSteps
        } else if self.unconverged > 0 && 2 * self.unconverged >= self.steps {
            ForceNoise::Unconverged
        } else {
            ForceNoise::Unknown
        }
    }

    /// Adds the step from step `previous_step` to `state`.
    pub fn add_step(&mut self, scene: &Scene, state: &State, report: &StepReport, previous_step: u64) {
        self.steps += 1;
        self.dt_count += state.step - previous_step;
        self.longest_step = self.longest_step.max(report.h);
        self.sweeps += report.sweeps;
        self.unconverged += u64::from(!report.converged);
        self.gravity = report.gravity.sampled.or(self.gravity);
        self.narrow_phase_error = report.narrow_phase_error.or(self.narrow_phase_error);
        if scene.has_bonds() {
            self.bonds = self.bonds.max(state.bond_count());
        }
        self.single_precision_steps += u64::from(report.single_precision);
        self.fallback_steps += u64::from(report.fallback_used && report.converged);
        self.steps_without_fallback += u64::from(report.fallback_suppressed);
    }
}

/// Reason for the overlap of two bodies whose contact does not act, with advice.
pub const INERT_REASON: &str = "along the normal of their contact the motion of both is imposed, so that it does not act; free one of \
     them along it, or remove the row between them";

/// Returns the text of the summary. `balance`: balance of the state; `estimates`: lines about the error of Z and target errors.
pub fn summary_text(
    scene: &Scene,
    state: &State,
    statistics: &RunStatistics,
    balance: &BalanceErrors,
    sources: &[ErrorSource],
    estimates: &[(&'static str, String)],
) -> String {
    let mut summary = SummaryLines::default();
    summary.add("models", scene.model_names().join("; "));
    add_steps(&mut summary, scene, state, statistics);
    add_penetration(&mut summary, scene, state, statistics);
    add_warnings(&mut summary, statistics);
    add_balances(&mut summary, scene, balance);
    add_errors(&mut summary, scene, statistics, sources, estimates);
    add_cost(&mut summary, statistics);
    summary.text
}

/// Lines of a summary, each with a name and a value.
#[derive(Default)]
struct SummaryLines {
    text: String,
}

impl SummaryLines {
    fn add(&mut self, name: &str, value: impl std::fmt::Display) {
        let _ = writeln!(self.text, "  {name:<22} {value}");
    }
}

/// Numbers of steps, contacts and bonds, and how the steps converged.
fn add_steps(summary: &mut SummaryLines, scene: &Scene, state: &State, statistics: &RunStatistics) {
    summary.add(
        "steps",
        format!("{} in this run, to step {}, t = {} s", statistics.steps, state.step, rounded_number(state.time)),
    );
    if let Some(condition) = &statistics.met_condition {
        summary.add("ended by", condition);
    }
    if let Some(presence) = &statistics.presence {
        summary.add("bodies", presence);
    }
    let dt = scene.options.dt;
    if scene.options.adaptive().is_on() {
        let mean = (statistics.dt_count as f64 / statistics.steps.max(1) as f64) * dt;
        summary.add("step length", format!("min {dt:.3e} s, mean {mean:.3e} s, max {:.3e} s", statistics.longest_step));
    }
    let active = state.contacts.iter().filter(|c| c.impulse != Vec3::zeros()).count();
    summary.add("contacts", format!("{} listed, {active} carry force", state.contacts.len()));
    if scene.has_bonds() {
        summary.add(
            "bonds",
            format!("{} at the end, largest number in this run {}", state.bond_count(), statistics.bonds),
        );
    }
    let single_precision = if statistics.single_precision_steps > 0 {
        format!(", in single precision in {} steps", statistics.single_precision_steps)
    } else {
        String::new()
    };
    summary.add(
        "sweeps per step",
        format!("{:.1}{single_precision}", statistics.sweeps as f64 / statistics.steps.max(1) as f64),
    );
    let last = state.ledger.last_unconverged.map_or(String::new(), |step| format!(", the last at step {step}"));
    summary.add(
        "unconverged steps",
        format!("{} in this run, {} in total{last}", statistics.unconverged, state.ledger.steps_unconverged),
    );
    if statistics.fallback_steps > 0 {
        let name = if scene.options.solver == ContactSolver::Auto { "fallback solver" } else { "matrix solver" };
        let steps = count_text(statistics.fallback_steps as usize, "step");
        summary.add(name, format!("converged in {steps}"));
    }
    if statistics.steps_without_fallback > 0 {
        summary.add(
            "fallback skipped",
            format!(
                "{} ended after one round of sweeps, because the fallback had failed before",
                count_text(statistics.steps_without_fallback as usize, "step")
            ),
        );
    }
}

/// Largest and mean penetration.
fn add_penetration(summary: &mut SummaryLines, scene: &Scene, state: &State, statistics: &RunStatistics) {
    let ledger = &state.ledger;
    // Over all steps in which contacts were detected, including those of the start, and the last state.
    let final_penetration = statistics.penetration_end / scene.mean_radius.max(f64::MIN_POSITIVE);
    let largest = ledger.penetration_largest.max(final_penetration);
    summary.add(
        "largest penetration",
        format!(
            "{largest:.2e} of the mean radius, {:.3e} m; mean residual penetration {:.1e} of the mean radius",
            largest * scene.mean_radius,
            ledger.penetration_left
        ),
    );
}

/// Warnings of the run, and bodies that overlap.
fn add_warnings(summary: &mut SummaryLines, statistics: &RunStatistics) {
    for warning in &statistics.warnings {
        summary.add("warning", warning);
    }
    if let Some(overlap) = statistics.overlap {
        let deep = 100.0 * OVERLAP_WARNING_SHARE;
        summary.add(
            "warning",
            format!("{}: more than {deep} %; volumes and stresses have errors of that order", overlap.message_text()),
        );
    }
    if let Some(overlap) = statistics.inert_overlap {
        summary.add("warning", format!("{}: {INERT_REASON}", overlap.message_text()));
    }
}

/// Drifts of energy and momenta.
fn add_balances(summary: &mut SummaryLines, scene: &Scene, balance: &BalanceErrors) {
    if scene.walls.contains(&false) {
        summary.add("energy drift", format!("{:.2e}", balance.energy));
    }
    // Momenta and estimates of errors count the bodies without imposed components.
    if !scene.free.is_empty() {
        summary.add(
            "momentum drift",
            format!("{:.2e} linear, {:.2e} angular", balance.momentum, balance.angular_momentum),
        );
    }
}

/// Errors measured in the run, and estimates of its error by source and of the cost by stage.
fn add_errors(
    summary: &mut SummaryLines,
    scene: &Scene,
    statistics: &RunStatistics,
    sources: &[ErrorSource],
    estimates: &[(&'static str, String)],
) {
    if let Some(SampledError { rms, largest, bodies, .. }) = statistics.gravity {
        let target = scene.options.gravity_error();
        let sample = count_text(bodies, "body");
        summary.add(
            "gravity error",
            format!("RMS {rms:.1e}, largest {largest:.1e} of {sample}; gravity_error {target:.0e}"),
        );
    }
    if let Some(NarrowPhaseError { mean, largest }) = statistics.narrow_phase_error {
        let [mean, largest] = [mean, largest].map(|error| error / scene.mean_radius);
        summary.add(
            "narrow phase error",
            format!("mean {mean:.1e} of the mean radius over touching pairs, largest {largest:.1e}"),
        );
    }
    let [(error, estimate), (cost, stages)] = errors::summary_lines(sources, statistics.force_noise());
    let unknown_text = || "not known: components of the velocities of all bodies are imposed".into();
    summary.add(error, if scene.free.is_empty() { unknown_text() } else { estimate });
    estimates.iter().for_each(|(name, line)| summary.add(name, line));
    summary.add(cost, stages);
}

/// Traffic of the ranks and seconds of the stages.
fn add_cost(summary: &mut SummaryLines, statistics: &RunStatistics) {
    let &StageTimes { gravity, detection, assembly, solve, integration, writing } = &statistics.stage_times;
    let stages = [
        ("gravity", gravity),
        ("detection", detection),
        ("assembly", assembly),
        ("solve", solve),
        ("integration", integration),
        ("writing", writing),
    ];
    let stages: Vec<String> = stages.iter().map(|(name, time)| format!("{name} {:.2}", time.as_secs_f64())).collect();
    if !statistics.traffic.is_empty() {
        summary.add("ranks", traffic_text(&statistics.traffic));
        if let Some(parts) = &statistics.contact_parts {
            summary.add("contacts by rank", contact_parts_text(parts, statistics));
        }
    }
    let threads = count_text(statistics.threads, "thread");
    summary.add("seconds", format!("{:.2} on {threads}: {}", statistics.wall_time.as_secs_f64(), stages.join(", ")));
}

/// Whether contacts were divided, the largest number on a rank, and the data of contacts that a rank sent in a step.
fn contact_parts_text(parts: &ContactParts, statistics: &RunStatistics) -> String {
    if let Some(reason) = parts.undivided_reason {
        return format!("all on each rank, because of {reason}");
    }
    let largest_bytes = statistics.traffic.iter().map(|rank| rank.list_bytes).max().unwrap_or(0) as f64;
    format!(
        "divided; a rank has had at most {}, and sends at most {:.1} kB of them in a step",
        count_text(parts.largest_part, "contact"),
        1e-3 * largest_bytes / statistics.steps.max(1) as f64,
    )
}

/// Number of ranks, of sweeps that they have divided, and the largest traffic of a rank divided by the number of these
/// sweeps.
fn traffic_text(traffic: &[RankTraffic]) -> String {
    let sweeps = traffic.iter().map(|rank| rank.divided_sweeps).max().unwrap_or(0);
    if sweeps == 0 {
        let reason = "the bodies in contact are one block, or their solver has no blocks";
        return format!("{}; no sweep was divided: {reason}", traffic.len());
    }
    let largest_per_sweep =
        |count: fn(&RankTraffic) -> u64| traffic.iter().map(count).max().unwrap_or(0) as f64 / sweeps as f64;
    format!(
        "{}; {sweeps} sweeps divided; for each of these a rank sends at most {:.1} messages with {:.2} kB, and contributes {:.2} kB to gathers, those of self-gravity and residual included",
        traffic.len(),
        largest_per_sweep(|rank| rank.messages),
        1e-3 * largest_per_sweep(|rank| rank.message_bytes),
        1e-3 * largest_per_sweep(|rank| rank.gathered_bytes),
    )
}
