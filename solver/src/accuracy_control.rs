//! Choice of options for `target_error`: the run starts with values that were fitted to the scenes which
//! `docs/explanation/accuracy.md` lists under target errors, and adapts them to the errors that it measures.
//!
//! - Now and then a step is also solved to a much smaller residual, from the same state. The differences in the number of
//!   contacts that carry force and in Σ f·l are the errors of Z and pressure by `tol`, which is adapted to them. Comparisons
//!   take a fraction of the sweeps.
//! - `penetration_tol` limits the overlaps that unconverged solutions leave. Their mean depth δ changes ν by 2 δ/r̄, and
//!   lengths and potential energy by a quarter of it.
//! - `adaptive` limits the length of steps; its errors are known from the same scenes only.
//! - `gravity_error` is reduced if the virial of self-gravity errs by a considerable part of the target.
//!
//! Everything follows from the state of the run, so that a resumed run makes the same choices.

use cd_formats::accuracy::{AccuracyControl, ChosenOptions, RunningMean, TargetErrors};
use cd_formats::compute::{Adaptive, Compute, ContactSolver};
use cd_formats::names::{count_text, short_number};

use crate::laws::ContactLaw;
use crate::scene::Scene;
use crate::state::State;
use crate::step::{StageTimes, StepReport, step};
use crate::write::errors::{ErrorSource, percent};

/// Shares of the target for errors by the length of steps and by unconverged solutions.
const STEP_SHARE: f64 = 0.6;
const CONTACT_SHARE: f64 = 0.5;

/// Error of an observable by the length of steps: `error` at a `penetration` of `adaptive` of 1e-2, proportional to
/// `penetration` to the power `exponent`.
struct StepError {
    error: f64,
    exponent: f64,
}

/// Errors by the length of steps of z, nu, pressure, semi_axes and energy, fitted to the larger biases of these scenes; single
/// scenes exceed them.
const STEP_ERRORS: [StepError; 5] = [
    StepError { error: 3.5e-2, exponent: 0.6 },
    StepError { error: 3.5e-2, exponent: 0.8 },
    StepError { error: 2.5e-2, exponent: 0.6 },
    StepError { error: 5e-3, exponent: 0.5 },
    StepError { error: 1e-2, exponent: 0.8 },
];

/// Errors of the observables by overlaps, as multiples of that of ν: volume and, in self-gravity, pressure follow the
/// length to the powers 3 and -4, semi-axes and potential energy to the powers 1 and -1. Z rises twice as much as ν in a
/// triaxial cell.
const OVERLAP_FACTORS: [f64; 5] = [2.0, 1.0, 1.0, 0.25, 0.25];

impl StepError {
    /// Error at a `penetration` of `adaptive`.
    fn error_at(&self, penetration: f64) -> f64 {
        self.error * libm::pow(penetration / 1e-2, self.exponent)
    }

    /// `penetration` of `adaptive` with an error.
    fn penetration_for(&self, error: f64) -> f64 {
        1e-2 * libm::pow(error / self.error, 1.0 / self.exponent)
    }
}

/// Largest number of `dt` in a step: `at_one_percent` for a target of 1 %, proportional to its power `exponent`.
struct MultipleLimit {
    at_one_percent: f64,
    exponent: f64,
}

impl MultipleLimit {
    /// Largest number of `dt` for a target.
    fn multiple_for(&self, target: f64) -> u64 {
        (self.at_one_percent * libm::pow(target / 1e-2, self.exponent)).floor().max(1.0) as u64
    }
}

/// Z counts neighbours over an interval: in longer steps more of them carry force at once, however slowly they move.
const Z_LIMIT: MultipleLimit = MultipleLimit { at_one_percent: 4.0, exponent: 1.26 };

/// Limits of Z and of the other observables in scenes with polyhedra. In a collapse errors hardly depend on `penetration`: in a
/// cloud of 80 rocks those of Z, ν and pressure are -0.7 %, -0.5 % and -0.8 % in steps of up to 8 `dt`, -3.2 %, -1.4 % and
/// -2.1 % in those of up to 16; in longer ones a `penetration` of 3e-4 leaves -2.7 % of Z.
const POLYHEDRON_Z_LIMIT: MultipleLimit = MultipleLimit { at_one_percent: 4.0, exponent: 0.63 };
const POLYHEDRON_LIMIT: MultipleLimit = MultipleLimit { at_one_percent: 6.0, exponent: 0.63 };

/// Ranges of the chosen options. Above, errors were not measured; below, nothing is gained.
const TOL_RANGE: [f64; 2] = [1e-3, 0.2];
const PENETRATION_RANGE: [f64; 2] = [1e-6, 2e-2];
const PENETRATION_TOL_RANGE: [f64; 2] = [5e-5, 1e-2];
const GRAVITY_ERROR_RANGE: [f64; 2] = [1e-5, 3e-2];

/// Residual of the solutions with which steps are compared, and the largest number of their sweeps.
const COMPARISON_TOL: f64 = 3e-4;
const MAX_COMPARISON_SWEEPS: u64 = 1000;
/// Sweeps that the first comparison is expected to take.
const FIRST_COMPARISON_SWEEPS: u64 = 200;
/// Sweeps of steps for each sweep of a comparison: for the first comparisons, and later.
const SWEEPS_PER_COMPARISON_SWEEP: [u64; 2] = [2, 8];
const FIRST_COMPARISONS: u64 = 4;

/// Prepares a run with `target_error`, at its start or from a snapshot; a run without it forgets the choice.
pub fn begin_control(scene: &mut Scene, state: &mut State) {
    state.accuracy_control = scene.options.target_error.map(|targets| {
        let initial = || initial_control(&targets);
        state.accuracy_control.unwrap_or_else(initial)
    });
    scene.options.chosen = chosen_options(scene, state);
}

/// Options at the start of a run.
fn initial_control(targets: &TargetErrors) -> AccuracyControl {
    let smallest_over = |value: fn(usize, f64) -> f64, [low, high]: [f64; 2]| {
        let targets = targets.values().into_iter().enumerate();
        targets.filter_map(|(k, error)| error.map(|error| value(k, error))).fold(high, f64::min).max(low)
    };
    AccuracyControl {
        // Z counts weak contacts, of which loose solutions have more; forces hardly depend on it.
        tol: smallest_over(
            |k, error| match k {
                0 => 0.1 * libm::pow(CONTACT_SHARE * error / 1.2e-2, 5.0),
                _ => 0.1 * libm::pow(error / 1e-2, 0.6),
            },
            TOL_RANGE,
        ),
        penetration: smallest_over(|k, error| STEP_ERRORS[k].penetration_for(STEP_SHARE * error), PENETRATION_RANGE),
        gravity_error: smallest_over(|_, error| 2.0 * error, GRAVITY_ERROR_RANGE),
        ..AccuracyControl::default()
    }
}

/// `penetration_tol` for the targets: the mean depth of overlaps becomes two to three times as large.
fn penetration_tol(targets: &TargetErrors) -> f64 {
    let limits = targets.values().into_iter().zip(OVERLAP_FACTORS);
    let limits = limits.filter_map(|(error, factor)| error.map(|error| error / (10.0 * factor)));
    let [low, high] = PENETRATION_TOL_RANGE;
    limits.fold(high, f64::min).max(low)
}

/// Largest number of `dt` in a step for the targets.
fn max_multiple(scene: &Scene, targets: &TargetErrors) -> u64 {
    let has_polyhedra = scene.has_free_polyhedra();
    let limit = |k: usize, target: f64| match (k, has_polyhedra) {
        (0, true) => POLYHEDRON_Z_LIMIT.multiple_for(target),
        (_, true) => POLYHEDRON_LIMIT.multiple_for(target),
        (0, false) => Z_LIMIT.multiple_for(target),
        (_, false) => Adaptive::MAX_STEP_MULTIPLE,
    };
    let targets = targets.values().into_iter().enumerate();
    let limits = targets.filter_map(|(k, target)| target.map(|target| limit(k, target)));
    limits.fold(Adaptive::MAX_STEP_MULTIPLE, u64::min)
}

/// Options of the present choice; none without `target_error`.
fn chosen_options(scene: &Scene, state: &State) -> ChosenOptions {
    let (Some(targets), Some(control)) = (scene.options.target_error, &state.accuracy_control) else {
        return ChosenOptions::default();
    };
    let AccuracyControl { tol, penetration, gravity_error, .. } = *control;
    let travel = 0.1 * libm::pow(penetration / 1e-3, 0.6);
    ChosenOptions {
        adaptive: Some(Adaptive { max_multiple: max_multiple(scene, &targets), travel, penetration }),
        tol: Some(tol),
        penetration_tol: Some(penetration_tol(&targets)),
        gravity_error: Some(gravity_error),
    }
}

/// Result of the comparison that precedes a step.
pub enum Comparison {
    /// No comparison is due.
    NotDue,
    /// Report of the step with the better solution.
    Done(Box<StepReport>),
    /// The program was requested to stop.
    Stopped,
}

/// Makes the next step with a better solution, on a copy of the state, if a comparison is due.
pub fn compare_next_step(scene: &Scene, state: &State, times: &mut StageTimes) -> Comparison {
    let Some(control) = &state.accuracy_control else { return Comparison::NotDue };
    let is_early = control.comparisons < FIRST_COMPARISONS;
    let expected = if control.comparisons == 0 { FIRST_COMPARISON_SWEEPS } else { control.last_sweeps };
    let ratio = SWEEPS_PER_COMPARISON_SWEEP[usize::from(!is_early)];
    if control.sweeps_since < ratio * expected || scene.options.tol() <= COMPARISON_TOL {
        return Comparison::NotDue;
    }
    let mut better = scene.clone();
    let options = &mut better.options;
    // Laws with restitution or irreversible losses are solved to a small part of `tol` anyway.
    let is_strict = |law: &ContactLaw| law.has_restitution() || law.has_irreversible_loss();
    options.tol = Some(if state.laws.iter().any(is_strict) { 0.1 * scene.options.tol() } else { COMPARISON_TOL });
    options.penetration_tol = Some(f64::MAX);
    options.max_sweeps = Some(MAX_COMPARISON_SWEEPS);
    if options.solver == ContactSolver::Auto {
        options.solver = ContactSolver::Nlgs;
    }
    match step(&better, &mut state.clone(), times) {
        Some(report) => Comparison::Done(Box::new(report)),
        None => Comparison::Stopped,
    }
}

/// Adds a step and its comparison, if there was one, and adapts the choice; returns the options if it has changed.
pub fn adapt_to_step(
    scene: &Scene,
    state: &mut State,
    report: &StepReport,
    better: Option<&StepReport>,
) -> Option<ChosenOptions> {
    let targets = scene.options.target_error?;
    let control = state.accuracy_control.as_mut()?;
    let before = *control;
    control.sweeps_since += report.sweeps;
    control.step_sweeps += report.sweeps;
    control.longest_multiple = control.longest_multiple.max((report.h / scene.options.dt).round() as u64);
    if let Some(sample) = report.gravity.sampled {
        let allowed = 0.1 * targets.values().into_iter().flatten().fold(f64::INFINITY, f64::min);
        if sample.virial.abs() > allowed {
            control.gravity_error = (0.25 * control.gravity_error).max(GRAVITY_ERROR_RANGE[0]);
        }
    }
    if let Some(better) = better {
        add_comparison(control, report, better);
        if before.comparisons > 0 {
            control.tol = adapted_tol(&targets, control);
        }
    }
    let has_changed = (control.tol, control.gravity_error) != (before.tol, before.gravity_error);
    has_changed.then(|| chosen_options(scene, state))
}

/// Adds a comparison to the running means.
fn add_comparison(control: &mut AccuracyControl, report: &StepReport, better: &StepReport) {
    let relative = |value: f64, reference: f64| {
        let error = (value - reference) / reference.abs();
        if error.is_finite() { error } else { 0.0 }
    };
    control.contacts_excess.add(relative(report.contacts_active as f64, better.contacts_active as f64));
    control.virial_error.add(relative(report.virial, better.virial));
    control.comparisons += 1;
    control.last_sweeps = better.sweeps.max(1);
    control.comparison_sweeps += better.sweeps;
    control.sweeps_since = 0;
}

/// `tol` after a comparison: smaller if an error by it is more than its share, larger if it is much less.
fn adapted_tol(targets: &TargetErrors, control: &AccuracyControl) -> f64 {
    let demand = |error: f64, target: Option<f64>| target.map_or(0.0, |target| error / (CONTACT_SHARE * target));
    let demand = demand(control.contacts_excess.significant_size(), targets.z)
        .max(demand(control.virial_error.significant_size(), targets.pressure));
    let factor = match demand {
        demand if demand > 1.0 => (1.0 / (demand * demand)).max(0.25),
        demand if demand < 0.5 => 2.0,
        _ => 1.0,
    };
    (control.tol * factor).clamp(TOL_RANGE[0], TOL_RANGE[1])
}

/// Error by `tol` of the observable `k` of [`TargetErrors::NAMES`], as in comparisons; `None` if they do not measure it.
fn compared_error(k: usize, control: &AccuracyControl) -> Option<&RunningMean> {
    match k {
        0 => Some(&control.contacts_excess),
        2 => Some(&control.virial_error),
        _ => None,
    }
}

/// Error of the source of this name.
fn error_of(sources: &[ErrorSource], name: &str) -> f64 {
    sources.iter().find(|source| source.name == name).map_or(0.0, |source| source.error)
}

/// Errors of an observable by source.
struct EstimatedParts {
    parts: [(&'static str, &'static str, f64); 4],
}

impl EstimatedParts {
    /// Estimates for the observable `k` of [`TargetErrors::NAMES`].
    fn new(k: usize, scene: &Scene, control: &AccuracyControl, sources: &[ErrorSource]) -> Self {
        let contacts = compared_error(k, control).map_or(0.0, RunningMean::significant_size);
        let has_long_steps = control.longest_multiple > 1;
        let overlaps = error_of(sources, "step");
        Self::with_contacts(k, scene, contacts, overlaps, has_long_steps, sources)
    }

    /// Estimates for the observable `k` with the errors by contacts and of ν by overlaps, in steps longer than `dt` or not.
    fn with_contacts(
        k: usize,
        scene: &Scene,
        contacts: f64,
        overlaps: f64,
        has_long_steps: bool,
        sources: &[ErrorSource],
    ) -> EstimatedParts {
        let steps = if has_long_steps { STEP_ERRORS[k].error_at(scene.options.adaptive().penetration) } else { 0.0 };
        let balance = if k == 4 { error_of(sources, "energy") } else { 0.0 };
        let gravity = if k == 2 || k == 4 { error_of(sources, "gravity") } else { 0.0 };
        let is_by_adaptive = scene.options.adaptive.is_some() && steps > balance;
        let step_option = if is_by_adaptive { "travel and penetration of adaptive" } else { "dt" };
        EstimatedParts {
            parts: [
                ("contacts", "tol", contacts),
                ("overlaps", "dt or tol", OVERLAP_FACTORS[k] * overlaps),
                ("length of steps", step_option, steps + balance),
                ("gravity", "gravity_error", gravity),
            ],
        }
    }

    fn total(&self) -> f64 {
        self.parts.iter().map(|(_, _, error)| error).sum()
    }

    /// Total and its parts.
    fn text(&self) -> String {
        let parts = self.parts.iter().filter(|(_, _, error)| *error > 0.0);
        let parts: Vec<String> = parts.map(|(name, _, error)| format!("{name} {}", percent(*error))).collect();
        if parts.is_empty() { "0".into() } else { format!("{} ({})", percent(self.total()), parts.join(", ")) }
    }

    /// Reason for which a total below the target does not show that the observable `k` has reached it: errors by `tol` that
    /// the comparisons cannot distinguish from chance.
    fn doubt_about_comparisons(&self, k: usize, tol: f64, control: &AccuracyControl, target: f64) -> Option<String> {
        if self.total() > target || tol <= COMPARISON_TOL {
            return None;
        }
        let Some(uncertainty) = compared_error(k, control)?.uncertainty() else {
            return Some("fewer than three steps were compared; lower tol, or make a longer run".into());
        };
        let is_beyond = self.total() + uncertainty > target;
        is_beyond.then(|| format!("comparisons do not resolve errors by tol below {}; lower tol", percent(uncertainty)))
    }

    /// Total, its parts, and whether the target is reached, or the `doubt` about it.
    fn verdict_text(&self, target: f64, doubt: Option<&str>) -> String {
        let largest = self.parts.iter().max_by(|a, b| a.2.total_cmp(&b.2));
        let verdict = match (doubt, largest) {
            (Some(doubt), _) => format!("not known: {doubt}"),
            (None, Some((name, option, _))) if self.total() > target => {
                format!("not reached, mainly {name}: lower {option}")
            }
            _ => "reached".into(),
        };
        format!("{}; {verdict}", self.text())
    }
}

/// Error of Z by a `tol` of 0.02 or more, and the power of a smaller `tol` to which it is proportional. In heaps of 120 rocks
/// at rest solutions to 0.02 share the loads among 1.2 ± 0.2 % more contacts than those to 0.001, and half of the excess of 1.3 % with
/// 0.005 arises at rest; aggregates at rest have 1.2 % with 0.1.
const Z_TOL_ERROR: f64 = 1.2e-2;
const Z_TOL_LIMIT: f64 = 2e-2;
const Z_TOL_EXPONENT: f64 = 0.5;

/// Adds the errors of Z of a run with a preset to its sources, and returns a line of the summary with their sum. They are those
/// of `docs/explanation/accuracy.md` for such values of `tol` and `adaptive`, and twice `overlaps`, the error of ν by them.
/// `longest_step`: longest step in which contacts carry force, s. `None` without a preset or such steps.
pub fn add_z_errors(
    scene: &Scene,
    longest_step: Option<f64>,
    overlaps: f64,
    sources: &mut [ErrorSource],
) -> Option<(&'static str, String)> {
    let options = &scene.options;
    options.accuracy?;
    let has_long_steps = longest_step? > 1.5 * options.dt;
    let contacts = Z_TOL_ERROR * libm::pow((options.tol() / Z_TOL_LIMIT).min(1.0), Z_TOL_EXPONENT);
    let estimate = EstimatedParts::with_contacts(0, scene, contacts, overlaps, has_long_steps, sources);
    let [contacts, overlaps, steps, _] = estimate.parts.map(|(_, _, error)| error);
    for source in sources {
        source.z_error = match source.name {
            "contacts" => Some(contacts),
            "step" => Some(overlaps + steps),
            _ => None,
        };
    }
    Some(("estimated error of Z", estimate.text()))
}

/// Largest `dt` for which the errors by the length of steps hold, over the strictest bound on a step, without and with self-gravity:
/// they were measured with 3.5 times it, in a fall of beads into a narrow box, and 0.27 times it, in collapses of spheres. Chosen
/// somewhat larger, because the bound changes during a run.
const DT_OF_KNOWN_ERRORS: [f64; 2] = [4.0, 0.35];

/// Largest number of steps without convergence of runs whose errors can be estimated, over that of `dt`.
const MAX_UNCONVERGED: f64 = 0.05;

/// Reason for which the estimates do not count, whatever they are. `strictest_bound`: on the length of a step, s, if there is one.
fn doubt_about_estimates(
    scene: &Scene,
    state: &State,
    control: &AccuracyControl,
    strictest_bound: Option<f64>,
) -> Option<String> {
    if control.step_sweeps == 0 {
        return Some("no contact has carried force".into());
    }
    let steps = state.step.saturating_sub(scene.start.step);
    let unconverged = state.ledger.steps_unconverged;
    if unconverged as f64 > MAX_UNCONVERGED * steps as f64 {
        return Some(format!("{} did not converge; raise max_sweeps", count_text(unconverged as usize, "step")));
    }
    let longest = DT_OF_KNOWN_ERRORS[usize::from(scene.options.self_gravity)] * strictest_bound?;
    (scene.options.dt > longest).then(|| {
        let longest = short_number(longest);
        format!("errors by dt are known up to a dt of {longest} s in this scene; lower dt")
    })
}

/// Lines of the summary about the targets: what was requested, what is estimated and from what, the options, and the cost of the
/// comparisons. Empty without `target_error`. `strictest_bound`: on the length of a step, s, if there is one.
pub fn target_lines(
    scene: &Scene,
    state: &State,
    sources: &[ErrorSource],
    strictest_bound: Option<f64>,
) -> Vec<(&'static str, String)> {
    let (Some(targets), Some(control)) = (scene.options.target_error, &state.accuracy_control) else {
        return Vec::new();
    };
    let chance = sources.iter().find(|source| source.name == "chance").map_or(0.0, |source| source.error);
    let doubt = doubt_about_estimates(scene, state, control, strictest_bound);
    let mut lines = Vec::new();
    for (k, target) in targets.values().into_iter().enumerate() {
        let Some(target) = target else { continue };
        let estimate = EstimatedParts::new(k, scene, control, sources);
        let doubt = doubt.clone().or_else(|| estimate.doubt_about_comparisons(k, scene.options.tol(), control, target));
        let text = estimate.verdict_text(target, doubt.as_deref());
        // Means over intervals depend on the length of steps least.
        let column = if k == 0 { " of Z_interval" } else { "" };
        lines.push((
            "target error",
            format!("{} {}{column}: estimated {text}", TargetErrors::NAMES[k], percent(target)),
        ));
        if k == 2 && chance > target {
            let runs = (chance / target).powi(2).ceil();
            let text = format!(
                "of the pressure of one run {}, more than the target: {} give a mean with this standard error",
                percent(chance),
                count_text(runs as usize, "realisation")
            );
            lines.push(("chance", text));
        }
    }
    lines.push(("options at the end", chosen_text(&scene.options)));
    let share = control.comparison_sweeps as f64 / (control.comparison_sweeps + control.step_sweeps).max(1) as f64;
    let comparisons = match control.comparisons {
        0 if scene.options.tol() <= COMPARISON_TOL => "none: tol is not larger than theirs".into(),
        0 => "none: the run has too few sweeps for one; the error by tol is in no estimate".into(),
        count => format!("{}, {:.0} % of all sweeps", count_text(count as usize, "step"), 100.0 * share),
    };
    lines.push(("comparisons", comparisons));
    lines
}

/// Options in force at the end.
pub fn chosen_text(options: &Compute) -> String {
    let adaptive = options.adaptive();
    let [tol, penetration_tol, gravity_error, travel, penetration] =
        [options.tol(), options.penetration_tol(), options.gravity_error(), adaptive.travel, adaptive.penetration]
            .map(short_number);
    let gravity = if options.self_gravity { format!(", gravity_error {gravity_error}") } else { String::new() };
    format!(
        "tol {tol}, penetration_tol {penetration_tol}, adaptive with max_multiple {}, travel {travel} and penetration \
         {penetration}{gravity}",
        adaptive.max_multiple
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Control after ten comparisons in which the virial erred by `error`, with a `tol` of 0.01.
    fn control_with_error(error: f64) -> AccuracyControl {
        let mut control = AccuracyControl { tol: 0.01, ..AccuracyControl::default() };
        (0..10).for_each(|_| control.virial_error.add(error));
        control
    }

    #[test]
    fn tol_follows_the_measured_error() {
        let targets = TargetErrors { pressure: Some(0.02), ..TargetErrors::default() };
        // Half of the target is the share of unconverged solutions.
        let cases = [(0.002, 0.02), (0.008, 0.01), (-0.0125, 0.0064), (0.1, 0.0025)];
        for (error, expected) in cases {
            let tol = adapted_tol(&targets, &control_with_error(error));
            assert!((tol - expected).abs() < 1e-12, "{error}: {tol}");
        }
        // Z has no target, so that its error does not count.
        let mut control = control_with_error(0.008);
        (0..10).for_each(|_| control.contacts_excess.add(0.5));
        assert_eq!(adapted_tol(&targets, &control), 0.01);
    }

    /// An estimate counts if it is below its target with twice the standard error of the comparisons as well, of which there are
    /// three at least, unless `tol` is that of comparisons. Here one of ten values differs by 10 % from the others.
    #[test]
    fn no_target_is_reached_by_an_estimate_that_comparisons_do_not_resolve() {
        let estimate = EstimatedParts { parts: [("contacts", "tol", 0.01); 4] };
        let mut control = control_with_error(0.0);
        control.virial_error.add(0.1);
        let uncertainty = control.virial_error.uncertainty().unwrap();
        let doubt = |k, tol, target| estimate.doubt_about_comparisons(k, tol, &control, target);
        let (below, above) = (0.04 + 0.99 * uncertainty, 0.04 + 1.01 * uncertainty);
        let text = format!("comparisons do not resolve errors by tol below {}; lower tol", percent(uncertainty));
        assert_eq!((doubt(2, 0.1, below), doubt(2, 0.1, above)), (Some(text), None));
        // A target that is not reached, a `tol` that needs no comparison, and ν, which they do not measure.
        assert_eq!((doubt(2, 0.1, 0.03), doubt(2, COMPARISON_TOL, below), doubt(1, 0.1, below)), (None, None, None));
        assert!(doubt(0, 0.1, 0.3).unwrap().starts_with("fewer than three steps were compared"));
    }

    #[test]
    fn tol_stays_in_its_range() {
        let targets = TargetErrors { pressure: Some(0.02), ..TargetErrors::default() };
        for (tol, error, expected) in [(1.1e-3, 1.0, TOL_RANGE[0]), (0.15, 0.0, TOL_RANGE[1])] {
            let control = AccuracyControl { tol, ..control_with_error(error) };
            assert_eq!(adapted_tol(&targets, &control), expected);
        }
    }
}
