//! Options of a run as its snapshot records them: flags of cd-solve override COMPUTE.RON, and only the snapshot has them.

use cd_formats::compute::{Compute, Event, EventAction, GravityMethod, NO_VALUE, event_schedule};
use cd_formats::doubts::EVENT_SLACK;
use cd_formats::names::number_text;
use cd_formats::snapshot::{RunParameters, SnapshotMeta};

/// Events of COMPUTE.RON that happened before a snapshot.
pub fn past_events(events: &[Event], meta: &SnapshotMeta) -> Vec<Event> {
    let mut schedule = event_schedule(events, meta.time);
    schedule.truncate(meta.parameters.events_done as usize);
    schedule
}

/// Options of the run as far as the snapshot determines them, others as in the file; and for the options that it leaves
/// open, name and reason. `is_first`: the snapshot is the first of the run; `has_start`: the case has START.npz.
///
/// A value in force, set by an option or by `accuracy`, is recorded as an option only where the file would give another
/// value.
pub fn run_options(
    file: &Compute,
    meta: &SnapshotMeta,
    is_first: bool,
    has_start: bool,
) -> (Compute, Vec<(&'static str, String)>) {
    let RunParameters {
        theta,
        accuracy,
        target_error,
        adaptive,
        tol,
        penetration_tol,
        solver,
        sweep_precision,
        max_sweeps,
        check_every,
        alert,
        self_gravity,
        gravity,
        xperiode,
        yperiode,
        zperiode,
        narrow_phase,
        face_friction,
        gravity_constant,
        gravity_error,
        gravity_order,
        gravity_opening,
        gravity_refresh,
        gravity_moved,
        gravity_quadrupole,
        gravity_softening,
        fields,
        uniform_gravity: _,
        quench,
        events_done,
    } = meta.parameters.clone();
    // A cell that has deformed has the periods of the snapshot.
    let [xperiode, yperiode, zperiode] =
        meta.cell.map_or([xperiode, yperiode, zperiode], |cell| cell.periods.map(Some));
    let mut options = Compute {
        theta,
        accuracy,
        target_error,
        solver,
        sweep_precision: sweep_precision.unwrap_or_default(),
        check_every: check_every.or(file.check_every),
        alert,
        self_gravity,
        gravity,
        xperiode,
        yperiode,
        zperiode,
        face_friction: face_friction.unwrap_or(file.face_friction),
        gravity_constant,
        gravity_order,
        gravity_opening,
        gravity_moved: gravity_moved.unwrap_or(file.gravity_moved),
        gravity_quadrupole,
        gravity_softening,
        fields,
        ..file.clone()
    };
    // With `target_error` the run has chosen the values of options that are not given.
    let is_given = |name: &str| meta.options.get(name).is_some_and(|value| value != NO_VALUE);
    let is_fixed = |name: &str| target_error.is_none() || is_given(name);
    let (adaptive, file_adaptive) = (adaptive.unwrap_or_default(), options.adaptive());
    if is_fixed("adaptive") && adaptive != file_adaptive && (adaptive.is_on() || file_adaptive.is_on()) {
        options.adaptive = Some(adaptive);
    }
    if is_fixed("tol") && tol != options.tol() {
        options.tol = Some(tol);
    }
    if is_fixed("penetration_tol") && penetration_tol > 0.0 && penetration_tol != options.penetration_tol() {
        options.penetration_tol = Some(penetration_tol);
    }
    if max_sweeps != options.max_sweeps() {
        options.max_sweeps = Some(max_sweeps);
    }
    if narrow_phase.is_some_and(|method| method != options.narrow_phase()) {
        options.narrow_phase = narrow_phase;
    }
    if is_fixed("gravity_error") && gravity_error != options.gravity_error() {
        options.gravity_error = Some(gravity_error);
    }
    // A snapshot has no `gravity_refresh` where it is 1, as it is by default for the direct sum, chosen for few bodies.
    let refresh = match gravity_refresh {
        None if self_gravity && (gravity == GravityMethod::Fmm || options.gravity_refresh.is_some()) => Some(1),
        recorded => recorded,
    };
    if refresh.is_some_and(|refresh| gravity == GravityMethod::Direct || refresh != options.gravity_refresh()) {
        options.gravity_refresh = refresh;
    }
    if !past_events(&file.events, meta).iter().any(|event| matches!(event.action, EventAction::SetQuench(_))) {
        options.quench = quench;
    }
    let mut undetermined = Vec::new();
    if adaptive.is_on() {
        if (meta.h / file.dt).round() * file.dt != meta.h {
            let text = format!(
                "{} as in DATBOX; the last step of the run, {} s, is no multiple of it",
                number_text(file.dt),
                number_text(meta.h)
            );
            undetermined.push(("dt", text));
        }
    } else if !(is_first && has_start) {
        // A run from START.npz keeps the step length of the run before until its first step.
        options.dt = meta.h;
    }
    // Events happen at the start of a step, the last one with the tolerance of event times.
    let last_step_start = meta.time - meta.h + EVENT_SLACK * options.dt.min(meta.h);
    let events_of_file = event_schedule(&file.events, last_step_start);
    let known = events_of_file.iter().filter(|event| event.time <= last_step_start).count() as u64;
    if !is_first && known != events_done {
        let text = format!("{events_done} had happened in the run, {known} of DATBOX; others than these are not known");
        undetermined.push(("events", text));
    }
    (options, undetermined)
}
