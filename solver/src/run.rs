//! Loop over the steps of a case that `cli` has read: advances the state by `step`, has results written by `write`, warns,
//! and ends at the last step, at a condition or at a request to stop.

use std::borrow::Cow;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

use cd_formats::compute::{Accuracy, EventAction};
use cd_formats::error::{Fault, Faults};
use cd_formats::field::FieldShapes;
use cd_formats::messages::{print_line, print_warning};
use cd_formats::names::{number_text, ratio_text, rounded_number, short_number};
use cd_formats::snapshot::RunParameters;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use crate::accuracy_control::{Comparison, adapt_to_step, add_z_errors, compare_next_step, target_lines};
use crate::assemble::{potential_energy, take_unended_impacts};
use crate::contact_division::undivided_reason;
use crate::detect;
use crate::integrate::{ContactConfiguration, predict_configuration};
use crate::math::Vec3;
use crate::plan::{StepBound, limits, roundoff_warning, step_bounds};
use crate::probe::Probes;
use crate::progress::ProgressDisplay;
use crate::ranks::lists::{all_gather_values, any_rank, sum_over_ranks};
use crate::ranks::{self, Communicator, RankTraffic};
use crate::scene::{BodyId, Scene};
use crate::sinks_and_sources::{exchange_bodies, presence_text};
use crate::state::{Contact, DetectionCache, State, Velocities};
use crate::step::{
    BalanceErrors, MotionTotals, OVERLAP_WARNING_SHARE, Overlap, StageTimes, StepReport, deeper_overlap,
    deepest_overlap_of_ranks, next_problem, step,
};
use crate::write::exchange::{ExchangeEnd, StepExchange};
use crate::write::summary::{ContactParts, INERT_REASON, RunStatistics, summary_text};
use crate::write::{OpeningNotes, ResultFiles, RunOutput, errors};
use crate::{activity, agreement};

/// Number of unconverged steps that are reported individually; the summary counts them all.
const MAX_REPORTED_STEPS: u64 = 5;

/// Reason why a run ended early.
#[derive(Debug)]
pub enum RunFailure {
    /// Nothing was computed, because input was rejected or OUTBOX cannot be written.
    Files(Faults),
    /// Files could not be written any more.
    Unwritten(Faults),
    /// The user has stopped the run, after the state was written.
    Stopped(String),
    /// Internal error: the state is no longer finite, or ranks have different states.
    Broken(String),
}

impl std::fmt::Display for RunFailure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            RunFailure::Files(faults) | RunFailure::Unwritten(faults) => write!(f, "{faults}"),
            RunFailure::Stopped(message) => f.write_str(message),
            RunFailure::Broken(message) => write!(f, "internal: {message}"),
        }
    }
}

impl std::error::Error for RunFailure {}

impl From<Faults> for RunFailure {
    fn from(faults: Faults) -> Self {
        RunFailure::Files(faults)
    }
}

/// Start of a run, and its output and input besides the results.
#[derive(Debug, Clone, Copy)]
pub struct RunMode {
    /// Whether the run continues from a snapshot.
    pub resumed: bool,
    /// Step whose contact problem is written, too.
    pub dump_step: Option<u64>,
    /// Whether forces of each step are exchanged on standard input and output.
    pub step_loop: bool,
    /// Number of bodies in a part of a snapshot; `None` for snapshots in one file.
    pub part_bodies: Option<usize>,
}

/// Advances the state to the last step and writes the results; returns the summary. Errors: a file cannot be written, the
/// answer of a program that exchanges forces is rejected, the user stops the run, or the state is not finite or differs
/// between ranks.
pub fn run_case(case: &Path, scene: &Scene, mut state: State, mode: RunMode) -> Result<String, RunFailure> {
    let start = Instant::now();
    // Copied only if bodies enter or leave.
    let mut present = Cow::Borrowed(scene);
    let mut last = scene.last_step();
    let communicator = ranks::communicator();
    let is_writer = communicator.rank() == 0;
    let (mut results, estimator, notes) = RunOutput::open(is_writer, case, scene, &state, mode.part_bodies)?;
    print_opening_notes(&notes);
    let mut statistics = RunStatistics {
        threads: rayon::current_num_threads(),
        bonds: state.bond_count(),
        estimator,
        ..RunStatistics::default()
    };
    LazyLock::force(&STOP_FLAG);
    if communicator.size() > 1 {
        let reason = undivided_reason(scene, &state).or(mode.dump_step.map(|_| "a contact problem that is written"));
        if reason.is_none() {
            detect::divide_contacts(scene, &mut state);
        }
        statistics.contact_parts = Some(ContactParts { undivided_reason: reason, largest_part: state.contacts.len() });
    }
    // Time that the last output took, which is logged with the step after it.
    let mut writing = Duration::ZERO;
    if !mode.resumed {
        open_ledger(scene, &mut state);
        expect_finite(&state)?;
        writing = write_output(&mut results, scene, &mut state)?;
    }

    let progress = ProgressDisplay::new(state.step, last.max(state.step));
    let reported_share = warn_at_start(&mut statistics, scene, &mut state, mode.resumed, &progress);
    let mut probes = Probes::new(scene, &state);
    if mode.resumed {
        // A run that a condition has ended has no further steps.
        let values = probes.values(scene, &state, None);
        statistics.met_condition = probes.met_condition(scene, &mut state, &values, Duration::ZERO);
        last = if statistics.met_condition.is_some() { state.step } else { last };
    }
    let mut exchange = None;
    if mode.step_loop {
        let opened = StepExchange::open(std::io::stdin().lock(), std::io::stdout().lock(), state.x.len());
        exchange = Some(opened.map_err(|end| exchange_failure(end, &state, last, &progress))?);
    }
    while state.step < last {
        let scene = &*present;
        if let Some(exchange) = &mut exchange
            && let Err(end) = exchange.read_loads(scene, &mut state)
        {
            state.loads.clear();
            write_end(&mut results, &mut statistics, scene, &mut state)?;
            return Err(exchange_failure(end, &state, last, &progress));
        }
        if let Some(dump_step) = mode.dump_step {
            dump_problem(communicator, case, scene, &state, dump_step)?;
        }
        let mut times = StageTimes { writing: std::mem::take(&mut writing), ..StageTimes::default() };
        let (previous_step, previous_events) = (state.step, state.events_done);
        progress.begin_step(state.step);
        let comparison = compare_next_step(scene, &state, &mut times);
        let is_stopped = matches!(comparison, Comparison::Stopped);
        let report = if is_stopped { None } else { step(scene, &mut state, &mut times) };
        let Some(report) = report else {
            write_end(&mut results, &mut statistics, scene, &mut state)?;
            write_last(&mut results, scene, &mut state)?;
            return Err(stopped_failure(&state, last, &progress));
        };
        expect_finite(&state).inspect_err(|_| progress.finish())?;
        let mut warnings = overlap_warnings(&mut statistics, &state, &report, reported_share);
        warnings.extend(impact_warning(&mut statistics));
        if state.events_done > previous_events {
            let beyond_ranges = limits::scene_warnings(scene, &state, &statistics.warnings);
            statistics.warnings.extend(beyond_ranges.iter().cloned());
            warnings.extend(beyond_ranges);
        }
        warnings.iter().for_each(|message| progress.warn(message));
        statistics.add_step(scene, &state, &report, previous_step);
        statistics.contact_parts.iter_mut().for_each(|parts| parts.add_part(state.contacts.len()));
        if !report.converged && statistics.unconverged <= MAX_REPORTED_STEPS {
            progress.report_unconverged(&state, &report, &scene.options);
        }
        progress.show_step(&state, &report);
        if state.accuracy_control.is_some() {
            let better = if let Comparison::Done(report) = &comparison { Some(&**report) } else { None };
            if let Some(chosen) = adapt_to_step(scene, &mut state, &report, better) {
                present.to_mut().options.chosen = chosen;
            }
        }
        let scene = &*present;
        results
            .write(|files| files.add_postpro(scene, &mut state, &report, previous_step))
            .map_err(RunFailure::Unwritten)?;
        let step_values = probes.step_values(scene, &state, report.start.as_ref());
        let estimator = &mut statistics.estimator;
        results
            .write(|files| files.add_step(scene, &state, &report, &times, estimator))
            .map_err(RunFailure::Unwritten)?;
        statistics.stage_times.accumulate(&times);
        let exchange = exchange_bodies(&mut present, &mut state);
        let scene = &*present;
        let values = probes.values(scene, &state, Some((step_values, &exchange)));
        results.write(|files| files.add_probes(&state, &values)).map_err(RunFailure::Unwritten)?;
        agreement::agree_on_step(communicator, &state).map_err(|mismatch| RunFailure::Broken(mismatch.to_string()))?;
        let condition = probes.met_condition(scene, &mut state, &values, start.elapsed());
        if let Some(condition) =
            condition.or_else(|| small_cell_text(scene, &state)).or_else(|| narrow_cylinder_text(scene, &state))
        {
            statistics.met_condition = Some(condition);
            last = state.step;
        }
        let stopped = activity::is_stopped() && state.step < last;
        if state.step.is_multiple_of(scene.options.output_every) || state.step == last || stopped {
            if state.step == last || stopped {
                writing = write_end(&mut results, &mut statistics, scene, &mut state)?;
                write_last(&mut results, scene, &mut state)?;
            } else {
                writing = write_output(&mut results, scene, &mut state).map_err(as_unwritten)?;
            }
            progress.print_status(&state, &report);
        } else if progress.is_silent() {
            results.write(ResultFiles::flush_to_file).map_err(RunFailure::Unwritten)?;
            progress.print_status(&state, &report);
        }
        if stopped {
            return Err(stopped_failure(&state, last, &progress));
        }
    }
    let scene = &*present;
    if mode.resumed && statistics.steps == 0 {
        // A run that was killed after its last snapshot lacks these rows and files.
        let estimator = &mut statistics.estimator;
        results.write(|files| files.complete_ended_run(scene, &state, estimator)).map_err(RunFailure::Unwritten)?;
        write_last(&mut results, scene, &mut state)?;
    }
    statistics.presence = presence_text(scene, &state);
    let last_output = StageTimes { writing, ..StageTimes::default() };
    statistics.estimator.add_writing_time(&last_output);
    statistics.stage_times.accumulate(&last_output);
    progress.finish();
    let is_divided = state.detection_cache.is_divided();
    if statistics.steps > 0
        && let Some(message) = last_overlap_warning(&mut statistics, scene, &mut state, reported_share)
    {
        print_warning("cd-solve", message);
    }
    statistics.overlap = statistics.overlap.filter(|overlap| overlap.share > OVERLAP_WARNING_SHARE);
    if communicator.size() > 1 {
        statistics.traffic = RankTraffic::gather_all(communicator);
        if let Some(parts) = &mut statistics.contact_parts {
            all_gather_values(parts.largest_part as u64)
                .into_iter()
                .for_each(|contacts| parts.add_part(contacts as usize));
        }
    }
    // The last warning has taken the cache.
    if is_divided {
        (state.contacts, state.interval.pair_virials) = detect::gather_contacts_to_first(&state);
    }
    if communicator.rank() > 0 {
        return Ok(String::new());
    }
    statistics.wall_time = start.elapsed();
    summarise_run(case, scene, &state, &statistics)
}

/// Prints the messages about the files that the run has opened.
fn print_opening_notes(notes: &OpeningNotes) {
    notes.missing_rows.iter().for_each(|note| print_line(format_args!("cd-solve: {note}")));
    notes.changed_inputs.iter().for_each(|warning| print_warning("cd-solve", warning));
}

/// Text about a deforming cell that has become too small for its bodies: they would touch or attract several images. None as
/// long as each period is more than twice the sum of the diameter of the largest body and the range of its attraction.
fn small_cell_text(scene: &Scene, state: &State) -> Option<String> {
    let cell = state.cell.as_ref()?;
    let shortest = cell.periods.into_iter().fold(f64::INFINITY, f64::min);
    let largest = scene.free.iter().map(|&body| scene.bounding_radius(body)).fold(0.0, f64::max);
    let range = scene.laws.iter().map(|law| law.interaction_range(largest)).fold(0.0, f64::max);
    let reach = 2.0 * largest + range;
    (shortest <= 2.0 * reach).then(|| {
        let with_range = if range > 0.0 { " plus the range of attraction" } else { "" };
        let [shortest, reach] = [shortest, reach].map(rounded_number);
        format!(
            "the shortest period has become {shortest} m; it must exceed twice {reach} m, the largest \
             diameter{with_range}; use a larger cell or less strain"
        )
    })
}

/// Text about a hollow cylinder whose radius has become too small for the bodies inside; None for others.
fn narrow_cylinder_text(scene: &Scene, state: &State) -> Option<String> {
    let mut radii = scene.radii.iter().zip(&state.radii);
    let (changing, current) = radii.find(|(changing, current)| current.radius <= changing.least)?;
    let [radius, least] = [current.radius, changing.least].map(rounded_number);
    Some(format!(
        "the radius of body {} has become {radius} m; the bodies inside need more than {least} m; use stiffer laws, a lower \
         pressure or a slower rate",
        changing.body.number()
    ))
}

/// Warns of the step, of rounding, of values outside of tested ranges and of overlaps at the start of a run. Returns the ratio
/// of overlap to smaller radius from which on overlaps are attributed to the steps.
fn warn_at_start(
    statistics: &mut RunStatistics,
    scene: &Scene,
    state: &mut State,
    resumed: bool,
    progress: &ProgressDisplay,
) -> f64 {
    let long_step = long_step_warning(scene, state);
    statistics.has_long_steps = long_step.is_some();
    statistics.warnings.extend(long_step);
    statistics.warnings.extend(single_step_warning(scene, state).filter(|_| !resumed));
    statistics.warnings.extend(roundoff_warning(scene, state));
    statistics.warnings.extend(limits::warnings_with_events(scene, state));
    statistics.warnings.iter().for_each(|message| progress.warn(message));
    let division = state.detection_cache.division.clone();
    let mut cache = DetectionCache { division, ..DetectionCache::default() };
    let (initial_overlap, message) = initial_overlap_warning(scene, state, &mut cache).unzip();
    message.filter(|_| !resumed).into_iter().for_each(|message| progress.warn(&message));
    let reported_share = initial_overlap.map_or(OVERLAP_WARNING_SHARE, |overlap: Overlap| {
        OVERLAP_WARNING_SHARE.max(DEEPER_OVERLAP_FACTOR * overlap.share)
    });
    statistics.overlap = initial_overlap;
    // A resumed run has its cache, which decides between equal directions; at the start of a run the cache is empty.
    if state.step == scene.start.step && state.detection_cache == DetectionCache::default() {
        state.detection_cache = cache;
        detect::migrate_contacts(scene, state);
    }
    reported_share
}

/// Writes the error sources of a run, and returns its summary.
fn summarise_run(case: &Path, scene: &Scene, state: &State, statistics: &RunStatistics) -> Result<String, RunFailure> {
    ranks::compute_alone(|| {
        let balance = BalanceErrors::new(scene, state);
        let mut sources = statistics.estimator.error_sources(scene, state, &balance);
        let estimator = &statistics.estimator;
        let z_line = add_z_errors(scene, estimator.longest_loaded_step(), estimator.overlap_error(), &mut sources);
        // A resumed run without steps writes them if the earlier run was killed before it did.
        if statistics.steps > 0 || state.step > scene.start.step && !errors::has_errors_file(case) {
            errors::write_errors(case, &sources).map_err(RunFailure::Unwritten)?;
        }
        let strictest_bound = step_bounds(scene, state).first().map(|bound| bound.h);
        let mut lines = target_lines(scene, state, &sources, strictest_bound);
        lines.extend(z_line);
        Ok(summary_text(scene, state, statistics, &balance, &sources, &lines))
    })
}

/// Writes the contact problem of the step `dump_step`, if that is the next step or within it.
fn dump_problem(
    communicator: &dyn Communicator,
    case: &Path,
    scene: &Scene,
    state: &State,
    dump_step: u64,
) -> Result<(), RunFailure> {
    if state.step >= dump_step || dump_step - state.step > scene.options.adaptive().max_multiple {
        return Ok(());
    }
    let (step_multiple, problem) = next_problem(scene, state);
    let end = state.step + step_multiple;
    if dump_step <= end && communicator.rank() == 0 {
        let path = crate::write::write_problem(case, end, problem).map_err(RunFailure::Unwritten)?;
        print_line(format_args!("cd-solve: contact problem of step {end} in {}", path.display()));
    }
    Ok(())
}

/// Writes the remaining rows and the state at the end of a run; returns the time that the state took.
fn write_end(
    results: &mut RunOutput,
    statistics: &mut RunStatistics,
    scene: &Scene,
    state: &mut State,
) -> Result<Duration, RunFailure> {
    results.write(|files| files.finish_rows(&mut statistics.estimator)).map_err(RunFailure::Unwritten)?;
    let duration = write_output(results, scene, state).map_err(as_unwritten)?;
    results.write(ResultFiles::finish_checksums).map_err(RunFailure::Unwritten)?;
    Ok(duration)
}

/// Failure of a run that was requested to stop.
fn stopped_failure(state: &State, last: u64, progress: &ProgressDisplay) -> RunFailure {
    progress.finish();
    let (step, time) = (state.step, rounded_number(state.time));
    RunFailure::Stopped(format!("stopped after step {step}, t = {time} s, of {last}; --resume continues"))
}

/// Failure of a run whose exchange of forces has ended.
fn exchange_failure(end: ExchangeEnd, state: &State, last: u64, progress: &ProgressDisplay) -> RunFailure {
    match end {
        ExchangeEnd::Closed => stopped_failure(state, last, progress),
        ExchangeEnd::Rejected(faults) => {
            progress.finish();
            RunFailure::Unwritten(faults)
        }
    }
}

/// The flag that is set when the user or the system requests the program to stop. At a second request it ends at once.
static STOP_FLAG: LazyLock<&Arc<AtomicBool>> = LazyLock::new(|| {
    let stop = activity::stop_flag();
    for signal in [SIGINT, SIGTERM] {
        // A signal that cannot be caught ends the program in the usual way.
        let _ = flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(stop));
        let _ = flag::register(signal, Arc::clone(stop));
    }
    stop
});

/// Converts rejected files to files that could not be written any more: the files of completed steps remain.
fn as_unwritten(failure: RunFailure) -> RunFailure {
    if let RunFailure::Files(faults) = failure { RunFailure::Unwritten(faults) } else { failure }
}

/// Records in the ledger, and reports, the change of the potential energy by forces that differ from those with which the
/// snapshot of a resumed run was computed.
///
/// Errors: the surface of an attracting body before the resume cannot be read from the folder `datbox` any more.
pub fn record_changed_forces(
    scene: &Scene,
    earlier: &RunParameters,
    datbox: &Path,
    state: &mut State,
) -> Result<(), Faults> {
    let options = &scene.options;
    // Without `..`, so that the compiler requires a decision for each parameter.
    let &RunParameters {
        self_gravity,
        gravity_constant,
        gravity_quadrupole,
        gravity_softening,
        ref fields,
        uniform_gravity,
        theta: _,
        accuracy: _,
        target_error: _,
        adaptive: _,
        tol: _,
        penetration_tol: _,
        solver: _,
        sweep_precision: _,
        max_sweeps: _,
        check_every: _,
        alert: _,
        gravity: _,
        xperiode: _,
        yperiode: _,
        zperiode: _,
        narrow_phase: _,
        face_friction: _,
        gravity_error: _,
        gravity_order: _,
        gravity_opening: _,
        gravity_refresh: _,
        gravity_moved: _,
        quench: _,
        events_done: _,
    } = earlier;
    let unchanged = [
        ("gravity", state.gravity == Vec3::from(uniform_gravity)),
        ("self_gravity", options.self_gravity == self_gravity),
        ("gravity_constant", options.gravity_constant == gravity_constant),
        ("gravity_quadrupole", options.gravity_quadrupole == gravity_quadrupole),
        ("gravity_softening", options.gravity_softening == gravity_softening),
        ("fields", options.fields == *fields),
    ];
    let changed: Vec<&str> =
        unchanged.into_iter().filter_map(|(name, unchanged)| (!unchanged).then_some(name)).collect();
    if changed.is_empty() {
        return Ok(());
    }
    let (mut old_scene, mut old_state) = (scene.clone(), state.clone());
    old_state.gravity = uniform_gravity.into();
    old_scene.options.self_gravity = self_gravity;
    old_scene.options.gravity_constant = gravity_constant;
    old_scene.options.gravity_quadrupole = gravity_quadrupole;
    old_scene.options.gravity_softening = gravity_softening;
    old_scene.options.fields.clone_from(fields);
    old_scene.field_shapes = FieldShapes::read(fields, datbox)?;
    let work = potential_energy(scene, state, &state.x) - potential_energy(&old_scene, &old_state, &old_state.x);
    state.ledger.outside_work += work;
    let changed = changed.join(", ");
    print_line(format_args!(
        "cd-solve: changed since the last snapshot: {changed}; the change of potential energy, {work:.3e} J, counts as external work"
    ));
    Ok(())
}

/// Ratio of the overlaps to the deepest one at the start above which they are attributed to the steps, and a run warns.
const DEEPER_OVERLAP_FACTOR: f64 = 1.1;

/// Warning about a step that is too long even for a draft.
fn long_step_warning(scene: &Scene, state: &State) -> Option<String> {
    let strictest = step_bounds(scene, state).into_iter().next()?;
    let (h, recommended) = (scene.options.dt, Accuracy::Draft.step_factor() * strictest.h);
    let StepBound { reason, .. } = strictest;
    (h > recommended).then(|| {
        format!(
            "dt = {} s is {} times the largest step for the preset draft, {} s ({reason}); see --plan",
            rounded_number(h),
            ratio_text(h / recommended),
            short_number(recommended)
        )
    })
}

/// Slack of `end_time` in steps, as in `Compute::last_step`: it is seldom an exact multiple of `dt`.
const LAST_STEP_SLACK: f64 = 1e-3;

/// Warning about a run that is shorter than its step.
fn single_step_warning(scene: &Scene, state: &State) -> Option<String> {
    let (dt, end) = (scene.options.dt, scene.options.end_time.filter(|_| scene.options.steps.is_none())?);
    let time_left = end - state.time;
    (time_left > 0.0 && (1.0 - LAST_STEP_SLACK) * dt > time_left).then(|| {
        let past = rounded_number(scene.end_time());
        let [dt, end] = [dt, end].map(rounded_number);
        let steps = match scene.last_step() > state.step {
            true => format!("it is one step, to t = {past} s"),
            // The rest is within the slack of the last step.
            false => "no step is computed".into(),
        };
        format!("dt = {dt} s is longer than the run to end_time = {end} s: {steps}; use a smaller dt")
    })
}

/// Contacts of the present state; `cache`: cache that detection updates.
fn current_contacts(scene: &Scene, state: &State, cache: &mut DetectionCache) -> Vec<Contact> {
    // Same lookahead as the first step, so that the cache is valid for it.
    let now = ContactConfiguration { lookahead: scene.options.dt, ..predict_configuration(scene, state, 0) };
    let velocities = Velocities { gradient: now.start_gradient(), ..state.velocities() };
    detect::listed_contacts(scene, &now, velocities, cache)
}

/// Whether two bodies overlap against the law of their contact: springs overlap by law.
fn is_overlap(contact: &Contact, scene: &Scene) -> bool {
    contact.gap < 0.0 && !scene.laws[contact.law].is_regularised()
}

/// Returns the deepest overlap relative to the smaller radius; of contacts that are divided, of those of all ranks.
fn deepest_overlap(contacts: &[Contact], scene: &Scene, cache: &DetectionCache) -> Option<Overlap> {
    let overlaps = contacts
        .iter()
        .filter(|contact| is_overlap(contact, scene))
        .map(|contact| Overlap::from_contact(scene, contact));
    let deepest = overlaps.fold(None, deeper_overlap);
    if cache.is_divided() { deepest_overlap_of_ranks(deepest) } else { deepest }
}

/// Deepest overlap at the start, before any step, and a warning about all deep overlaps.
fn initial_overlap_warning(scene: &Scene, state: &State, cache: &mut DetectionCache) -> Option<(Overlap, String)> {
    let contacts = current_contacts(scene, state, cache);
    let deepest = deepest_overlap(&contacts, scene, cache).filter(|overlap| overlap.share > OVERLAP_WARNING_SHARE)?;
    let deep_contacts = contacts.iter().filter(|contact| {
        is_overlap(contact, scene) && Overlap::from_contact(scene, contact).share > OVERLAP_WARNING_SHARE
    });
    let mut pairs: Vec<[BodyId; 2]> = deep_contacts.map(|contact| [contact.candidate, contact.antagonist]).collect();
    pairs.dedup();
    let pairs = if cache.is_divided() { sum_over_ranks(pairs.len()) } else { pairs.len() };
    let count = match pairs {
        1 => "1 pair of bodies overlaps".to_string(),
        count => format!("{count} pairs of bodies overlap"),
    };
    let message = format!(
        "{count} by more than {} % of the smaller radius from the start, the deepest: {}; laws other than GAP_SGR_CLB keep these overlaps",
        100.0 * OVERLAP_WARNING_SHARE,
        deepest.message_text(),
    );
    Some((deepest, message))
}

/// Adds the overlaps of a step to the statistics; returns warnings about the first deep ones.
fn overlap_warnings(
    statistics: &mut RunStatistics,
    state: &State,
    report: &StepReport,
    reported_share: f64,
) -> Vec<String> {
    let mut warnings = Vec::new();
    if let Some(overlap) = report.overlap {
        let remedy = if report.converged { "use a smaller dt or tol" } else { UNCONVERGED_REMEDY };
        warnings.extend(add_overlap(statistics, state, overlap, reported_share, remedy));
    }
    if let Some(overlap) = report.inert_overlap {
        if statistics.inert_overlap.is_none() {
            warnings.push(format!("{}: {INERT_REASON}", overlap_text(state, overlap)));
        }
        statistics.inert_overlap = deeper_overlap(statistics.inert_overlap, overlap);
    }
    warnings
}

/// Returns a warning about the first impacts one after the other that do not end.
fn impact_warning(statistics: &mut RunStatistics) -> Option<String> {
    let contacts = take_unended_impacts();
    let is_first = contacts > 0 && !std::mem::replace(&mut statistics.has_unended_impacts, true);
    is_first.then(|| {
        format!(
            "impacts: in_order: the impacts of a cluster of {contacts} contacts do not end, as those of a ball between two \
             walls that it touches; Newton's law at one instant applies to such clusters; leave a gap between such \
             bodies, or use impacts: simultaneous"
        )
    })
}

/// Adds the overlaps that the last step made, which no step has measured, to the statistics; returns a warning if they are
/// the first deep ones.
fn last_overlap_warning(
    statistics: &mut RunStatistics,
    scene: &Scene,
    state: &mut State,
    reported_share: f64,
) -> Option<String> {
    // No step needs the cache any more.
    let mut cache = std::mem::take(&mut state.detection_cache);
    let contacts = current_contacts(scene, state, &mut cache);
    let is_inert = |overlap: &Overlap| statistics.inert_overlap.is_some_and(|inert| inert.bodies == overlap.bodies);
    let overlap = deepest_overlap(&contacts, scene, &cache).filter(|overlap| !is_inert(overlap))?;
    statistics.penetration_end = overlap.depth;
    add_overlap(statistics, state, overlap, reported_share, "use a smaller dt or tol")
}

/// Advice for overlaps at the end of a step that did not converge, whose `tol` was not reached.
const UNCONVERGED_REMEDY: &str = "the step did not converge; raise max_sweeps or use a smaller dt";

/// Adds an overlap to the statistics; returns a warning with this remedy if it is the first whose share exceeds
/// `reported_share`.
fn add_overlap(
    statistics: &mut RunStatistics,
    state: &State,
    overlap: Overlap,
    reported_share: f64,
    remedy: &str,
) -> Option<String> {
    let is_first = statistics.overlap.is_none_or(|before| before.share <= reported_share);
    statistics.overlap = deeper_overlap(statistics.overlap, overlap);
    (is_first && overlap.share > reported_share).then(|| format!("{}; {remedy}", overlap_text(state, overlap)))
}

/// Text of an overlap with the step.
fn overlap_text(state: &State, overlap: Overlap) -> String {
    let (step, time) = (state.step, rounded_number(state.time));
    format!("step {step}, t = {time} s: {}", overlap.message_text())
}

/// Writes the state; returns the time that it took.
fn write_output(results: &mut RunOutput, scene: &Scene, state: &mut State) -> Result<Duration, RunFailure> {
    let start = Instant::now();
    let own_are_finite = state.contacts_are_finite();
    let is_divided = state.detection_cache.is_divided();
    let are_finite = if is_divided { !any_rank(!own_are_finite) } else { own_are_finite };
    check_finite(are_finite, state, "a number of a contact")?;
    with_all_contacts(state, |state| results.write(|files| files.write_state(scene, state)))?;
    Ok(start.elapsed())
}

/// Writes the text files of the end of a run.
fn write_last(results: &mut RunOutput, scene: &Scene, state: &mut State) -> Result<(), RunFailure> {
    if !scene.options.text {
        return Ok(());
    }
    let write = |state: &State| results.write(|files| files.write_last(scene, state));
    with_all_contacts(state, write).map_err(RunFailure::Unwritten)
}

/// Calls `write` with a state that has the contacts of all ranks on rank 0; on others, of divided contacts, none.
fn with_all_contacts<T>(state: &mut State, write: impl FnOnce(&State) -> T) -> T {
    if !state.detection_cache.is_divided() {
        return write(state);
    }
    let (contacts, virials) = detect::gather_contacts_to_first(state);
    let own_contacts = std::mem::replace(&mut state.contacts, contacts);
    let own_virials = std::mem::replace(&mut state.interval.pair_virials, virials);
    let result = write(state);
    (state.contacts, state.interval.pair_virials) = (own_contacts, own_virials);
    result
}

/// Initialises the energy and momentum relative to which the run's drift is measured.
fn open_ledger(scene: &Scene, state: &mut State) {
    let motion = MotionTotals::from_bodies(scene, &state.q, state.velocities());
    let angular = MotionTotals::total_angular_momentum(scene, state);
    let potential = potential_energy(scene, state, &state.x);
    state.ledger.energy_start = motion.kinetic + motion.rotational + potential;
    state.ledger.momentum_expected = motion.momentum.into();
    state.ledger.angular_momentum_expected = Vec3::into(angular);
    state.ledger.momentum_scale = motion.scale;
}

/// Returns an error if the state is not finite, so that it is never written.
fn expect_finite(state: &State) -> Result<(), RunFailure> {
    check_finite(state.is_finite(), state, "a position, velocity, momentum or energy")
}

/// Returns an error that names the quantity unless it is finite.
fn check_finite(is_finite: bool, state: &State, quantity: &str) -> Result<(), RunFailure> {
    let State { step, time, .. } = state;
    let fault_text = || {
        format!(
            "step {step}, t = {} s: {quantity} is not finite; snapshots written before are valid",
            rounded_number(*time)
        )
    };
    if is_finite { Ok(()) } else { Err(RunFailure::Broken(fault_text())) }
}

/// Largest travel of a body in a run, m: the cube of a distance, as in the attraction of two bodies, must remain a number.
const MAX_TRAVEL: f64 = 1e100;

/// Largest travel of a body until the end of the run, m, by its present velocity and in free fall by present gravity or that of
/// a later event; forces between bodies, torques and imposed motion do not count.
fn largest_travel(scene: &Scene, state: &State) -> f64 {
    let duration = scene.last_step().saturating_sub(state.step) as f64 * scene.options.dt;
    let later = scene.events.iter().filter_map(|event| match event.action {
        EventAction::SetGravity(gravity) => Some(Vec3::from(gravity)),
        _ => None,
    });
    let largest = |vectors: &mut dyn Iterator<Item = Vec3>| vectors.map(|vector| vector.norm()).fold(0.0, f64::max);
    let gravity = largest(&mut later.chain([state.gravity]));
    let speed = largest(&mut state.v.iter().copied());
    (speed + gravity * duration) * duration
}

/// Rejects options that do not allow a run from this state.
pub fn check_run(scene: &Scene, state: &State) -> Result<(), Faults> {
    let mut faults = Faults::default();
    let end = scene.options.end_time.filter(|_| scene.options.steps.is_none());
    // A run passes its end by less than a step.
    if let Some(end) = end.filter(|end| state.time - end > (1.0 - LAST_STEP_SLACK) * scene.options.dt.max(state.h)) {
        let from = if state.step > scene.start.step { "from which the run continues" } else { "the time of DATBOX" };
        let (found, expected) = (number_text(end), format!("expected at least {} s, {from}", number_text(state.time)));
        faults.push(Fault::new(Path::new("options"), None, "end_time", found, expected));
    }
    let dt = scene.options.dt;
    if state.time + dt == state.time {
        let found = format!("{} s is lost in the rounding of the time {} s", number_text(dt), number_text(state.time));
        let time_rounding = rounded_number(f64::EPSILON * state.time.abs());
        let expected = format!("expected more than {time_rounding} s, or an earlier time of the start");
        faults.push(Fault::new(Path::new("options"), None, "dt", found, expected));
    }
    let last = scene.last_step();
    let travel = largest_travel(scene, state);
    if travel > MAX_TRAVEL {
        let found =
            format!("{} s lets bodies travel by up to {} m until the end", number_text(dt), short_number(travel));
        let expected = format!("expected at most {MAX_TRAVEL:e} m; lower dt, steps, gravity or the speeds");
        faults.push(Fault::new(Path::new("options"), None, "dt", found, expected));
    }
    if scene.options.steps.is_some() && last < state.step {
        let found = format!("{last} is before step {}, from which the run continues", state.step);
        faults.push(Fault::new(Path::new("options"), None, "steps", found, "expected a later step"));
    }
    faults.into_result(())
}
