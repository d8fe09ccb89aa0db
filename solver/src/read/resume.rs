//! Restores a state from a snapshot: the last of OUTBOX, or the start in DATBOX.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cd_formats::compute::{NO_VALUE, OPTIONS_WRITTEN_IF_GIVEN, event_schedule};
use cd_formats::error::{Fault, Faults};
use cd_formats::names::{count_text, number_text};
use cd_formats::report::MAX_MAGNITUDE;
use cd_formats::ron_file::value_with_current_names;
use cd_formats::snapshot::{
    self, LawName, PRESENCE_PRESENT, PRESENCE_WAITING, RunParameters, STATUS_NO_CONTACT, STATUS_SLIDE, ShapeArrays,
    Snapshot, SnapshotMeta, WallCircle,
};
use nalgebra::{Quaternion, UnitQuaternion};

use crate::geometry::CachedFeature;
use crate::laws::ContactLaw;
use crate::math::{Vec3, to_local, to_world};
use crate::scene::{BodyId, BodyPresence, EVENT_SLACK, LawId, Scene, StepTime};
use crate::state::{
    BondingMode, CachedPair, Contact, ContactStatus, DetectionCache, GravityHistory, LawMemory, OutputInterval,
    PairVirial, SolvedContact, State, UNKNOWN_FEATURE,
};

/// Restores the last snapshot of `outbox` into `state`, if there is one, and sets the step and time in `scene` from which
/// steps are counted and its schedule of events. A snapshot with other bodies or laws than the scene's is rejected. Returns the
/// parameters and options of the run's last step.
pub fn restore_last(outbox: &Path, scene: &mut Scene, state: &mut State) -> Result<Option<PreviousRun>, Faults> {
    let snapshots = snapshot::list_snapshots(outbox)?;
    let Some((_, path)) = snapshots.last() else { return Ok(None) };
    if let Some((step, first)) = snapshots.first().filter(|(step, _)| *step < scene.start.step) {
        let expected = format!("expected none before step {}, with which DATBOX begins", scene.start.step);
        return Err(Fault::new(first, None, "snapshot", format!("step {step}"), expected).into());
    }
    let snapshot = Snapshot::read(path).map_err(|faults| unreadable_snapshot_faults(faults, &snapshots))?;
    check_resumable(path, scene, &snapshot)?;
    restore_presence(path, scene, state, &snapshot)?;
    let current_option = |(name, value): (&String, &String)| (name.clone(), value_with_current_names(name, value));
    let options = snapshot.meta.options.iter().map(current_option).collect();
    state.attraction = restored_attraction(scene, &snapshot);
    let parameters = snapshot.meta.parameters.clone();
    let cached_pairs = snapshot.shapes.as_ref().map_or(Vec::new(), |shapes| restored_pairs(scene, shapes, BodyId));
    let has_same_parts = snapshot.shapes.as_ref().is_none_or(|shapes| {
        cached_pairs.len() == shapes.pairs.pair_memory.len()
            && shapes.turning.turning_body.iter().copied().map(BodyId).eq(scene.free_rotors.iter().copied())
    });
    if !has_same_parts || snapshot.shapes.is_some() != scene.has_parts() {
        let found = "other contactors or moments of inertia";
        return Err(Fault::new(path, None, "snapshot", found, "expected those of DATBOX").into());
    }
    let counted_before = snapshot.meta.counted_from;
    restore_state(snapshot, state);
    state.detection_cache = DetectionCache { restored_pairs: cached_pairs, ..DetectionCache::default() };
    scene.counted_from = counted_from(scene, state, counted_before);
    scene.events = event_schedule(&scene.options.events, scene.end_time());
    if state.step > scene.start.step {
        state.bonding = BondingMode::No;
        // `dt` of the last step: its length, unless it was a multiple; then the present `dt`, if it is not longer.
        let dt = if parameters.adaptive.is_none() { state.h } else { scene.options.dt.min(state.h) };
        pass_events(scene, state, dt);
    }
    Ok(Some(PreviousRun { parameters, options }))
}

/// Restores which bodies are in the run. Errors: the snapshot has absent bodies but the scene neither sinks nor sources; or the
/// scene has sources and the snapshot is of a run without sinks and sources.
fn restore_presence(path: &Path, scene: &mut Scene, state: &mut State, snapshot: &Snapshot) -> Result<(), Faults> {
    let count = scene.bodies.len();
    let absent = (0..count).filter(|&row| !snapshot.is_present(row)).count();
    let reject = |found: String, expected: &str| Err(Fault::new(path, None, "snapshot", found, expected).into());
    match &snapshot.presence {
        _ if scene.roster.is_none() && absent > 0 => {
            let expected = "expected the options sinks and sources of the run so far";
            return reject(format!("{} not in the run", count_text(absent, "body")), expected);
        }
        None if !scene.options.sources.is_empty() => {
            return reject("of a run without sinks and sources".into(), "expected a run with sources from its start");
        }
        Some(presence) => {
            let body_presence = |value: &u8| match *value {
                PRESENCE_WAITING => BodyPresence::Waiting,
                PRESENCE_PRESENT => BodyPresence::Present,
                _ => BodyPresence::Gone,
            };
            state.presence = presence.body_presence.iter().map(body_presence).collect();
        }
        None => {}
    }
    // Without sinks, or in a snapshot of a run without them, no body has left.
    if let (false, Some(departures)) = (state.exit_velocities.is_empty(), &snapshot.departures) {
        state.exit_velocities = departures.body_exit_v.iter().map(|v| Vec3::from(*v)).collect();
    }
    if scene.roster.is_some() {
        state.apply_presence(scene);
    } else {
        state.presence.clear();
    }
    Ok(())
}

/// Parameters and options of a run's last step.
pub struct PreviousRun {
    pub parameters: RunParameters,
    /// Options as from [`cd_formats::compute::Compute::result_options`], under current names.
    pub options: BTreeMap<String, String>,
}

impl PreviousRun {
    /// Messages for each changed option: warnings, and those about options that flags have `given`.
    ///
    /// `text_option`: value of the option `text` in the run so far, if its files show it.
    pub fn option_changes(
        &self,
        scene: &Scene,
        text_option: Option<bool>,
        given: &[&str],
    ) -> (Vec<String>, Vec<String>) {
        const MAX_SHOWN_CHARS: usize = 100;
        let (mut now, mut before) = (scene.options.result_options(), self.options.clone());
        if let Some(text_option) = text_option {
            now.insert("text".into(), scene.options.text.to_string());
            before.insert("text".into(), text_option.to_string());
        }
        if !before.is_empty() {
            for name in OPTIONS_WRITTEN_IF_GIVEN {
                for options in [&mut now, &mut before] {
                    options.entry(name.into()).or_insert_with(|| NO_VALUE.into());
                }
            }
        }
        let (mut warnings, mut notes) = (Vec::new(), Vec::new());
        for (name, now) in now.iter().filter(|(name, now)| before.get(*name).is_some_and(|then| then != *now)) {
            let then = &before[name];
            let shortened_text = |value: &str| {
                let cut = value.chars().count() > MAX_SHOWN_CHARS;
                value.chars().take(MAX_SHOWN_CHARS).collect::<String>() + if cut { "..." } else { "" }
            };
            // An option without a value follows from others, such as `tol` from `accuracy`.
            let value_phrase = |verb: &str, value: &str| match value {
                NO_VALUE => format!("{verb} not given"),
                value => format!("{verb} {}", shortened_text(value)),
            };
            let (before, after) = (value_phrase("was", then), value_phrase("is", now));
            let change = format!("{name} {before} in the run so far and {after} from here on");
            if given.contains(&name.as_str()) {
                notes.push(change);
                continue;
            }
            let flag = format!("--{}", name.replace('_', "-"));
            let keep = match then.as_str() {
                NO_VALUE => format!("COMPUTE.RON without {name} keeps it"),
                value if value.chars().all(|c| c.is_alphanumeric() || "._+-".contains(c)) => {
                    format!("{flag}={value} keeps it")
                }
                value => format!("{flag}='{value}' keeps it"),
            };
            warnings.push(format!("{change}; {keep}"));
        }
        (warnings, notes)
    }
}

/// Advice about a damaged last snapshot.
pub fn snapshot_advice(snapshots: &[(u64, PathBuf)]) -> &'static str {
    if snapshots.len() > 1 {
        "--resume --skip-damaged continues from the last sound snapshot"
    } else {
        "move it away and start from DATBOX with --force"
    }
}

/// Faults of the last snapshot, with advice.
fn unreadable_snapshot_faults(faults: Faults, snapshots: &[(u64, PathBuf)]) -> Faults {
    let advice = snapshot_advice(snapshots);
    let advised_fault = |fault: Fault| {
        let parts = [fault.expected.as_str(), advice].into_iter().filter(|part| !part.is_empty());
        Fault { expected: parts.collect::<Vec<_>>().join("; "), ..fault }
    };
    Faults(faults.0.into_iter().map(advised_fault).collect())
}

/// Step and time (s) from which steps are counted: those of the run before, or the start if that run had steps of another
/// length.
pub fn counted_from(scene: &Scene, state: &State, previous_start: Option<(u64, f64)>) -> StepTime {
    let agrees = |StepTime { step, time }: &StepTime| {
        let steps = state.step.saturating_sub(*step) as f64;
        let deviation = (state.time - (time + steps * scene.options.dt)).abs();
        deviation <= 4.0 * f64::EPSILON * state.time.abs().max(time.abs())
    };
    let previous_start = previous_start.map(|(step, time)| StepTime { step, time });
    let now = StepTime { step: state.step, time: state.time };
    previous_start.into_iter().chain([scene.start]).find(agrees).unwrap_or(now)
}

/// Applies the settings of past events to the laws of the scene. They are not restored from the snapshot, so that flags may
/// change those that no event has set.
fn apply_event_settings(scene: &Scene, state: &mut State) {
    state.laws.clone_from(&scene.laws);
    for event in scene.events.iter().take(state.events_done) {
        state.apply_setting(&event.action, scene);
    }
}

/// Marks events before the last step as done, whether that run had them or not: their settings apply, and their additions
/// are not repeated. `dt` is that of the last step.
pub fn pass_events(scene: &Scene, state: &mut State, dt: f64) {
    // Time at which the last step began; at time 0 no event has happened.
    let last = state.time - state.h + EVENT_SLACK * dt;
    state.events_done = scene.events.partition_point(|event| event.time <= last);
    apply_event_settings(scene, state);
}

/// Rejects a snapshot from which no run of the scene can continue: with other bodies or laws than DATBOX, without arrays that its
/// laws and options need, or with values that no run has.
pub fn check_resumable(path: &Path, scene: &Scene, snapshot: &Snapshot) -> Result<(), Faults> {
    check_snapshot(path, scene, snapshot)?;
    check_completeness(path, scene, snapshot)
}

/// Rejects a snapshot with other bodies or laws than DATBOX.
fn check_snapshot(path: &Path, scene: &Scene, snapshot: &Snapshot) -> Result<(), Faults> {
    let bodies = &snapshot.bodies;
    let mut faults = Faults::default();
    let mut add_fault = |object: String, found: String, expected: String| {
        faults.push(Fault::new(path, None, object, found, expected));
    };
    if bodies.body_mass.len() != scene.bodies.len() {
        let found = format!("{} bodies", bodies.body_mass.len());
        add_fault("snapshot".into(), found, format!("expected the {} of DATBOX", scene.bodies.len()));
    } else {
        let snapshot_values =
            |i: usize| (bodies.body_mass[i], bodies.body_radius[i], bodies.body_inertia[i], bodies.body_driven[i]);
        let datbox_values = |i: usize| {
            let body = &scene.bodies[i];
            (body.mass, body.radius, body.inertia, body.imposed_components())
        };
        let text = |(mass, radius, inertia, imposed): (f64, f64, [f64; 3], u8)| {
            let [mass, radius] = [mass, radius].map(number_text);
            let inertia = inertia.map(number_text).join(", ");
            format!("mass {mass} kg, radius {radius} m, moments {inertia} kg m², imposed components {imposed:06b}")
        };
        if let Some(i) = (0..scene.bodies.len()).find(|&i| snapshot_values(i) != datbox_values(i)) {
            add_fault(
                format!("body {}", i + 1),
                text(snapshot_values(i)),
                format!("expected as in DATBOX: {}", text(datbox_values(i))),
            );
        }
    }
    let laws = snapshot.meta.laws_of_file();
    if laws != scene.law_names {
        let names = |laws: &[LawName]| -> Vec<String> {
            laws.iter().map(|law| format!("{} {} {:?}", law.nickname, law.kind, law.parameters)).collect()
        };
        let found = format!("laws {}", names(laws).join(", "));
        add_fault(
            "snapshot".into(),
            found,
            format!("expected those of DATBOX: {}", names(&scene.law_names).join(", ")),
        );
    }
    faults.into_result(())
}

/// Fault of a snapshot without one array or several, with names as "a", "a, b" or "a to c", that are needed because of `reason`.
fn missing_arrays_fault(path: &Path, names: &str, reason: &str) -> Fault {
    let (noun, found, pronoun) =
        if names.contains(' ') { ("arrays", "are missing", "them") } else { ("array", "is missing", "it") };
    let advice = "move the file away to resume from the snapshot before, or start from DATBOX with --force";
    let expected = format!("expected {pronoun}, because {reason}; {advice}");
    Fault::new(path, None, format!("{noun} {names}"), found, expected)
}

/// Rejects a snapshot without arrays that its laws and options need, with a step or time that no run reaches, or with numbers
/// that are too large to compute with, as a program that copies or edits its arrays may leave it.
fn check_completeness(path: &Path, scene: &Scene, snapshot: &Snapshot) -> Result<(), Faults> {
    let Snapshot { meta, memory, laws, attractions, gravity, presence, interval, .. } = snapshot;
    let mut faults = Faults::default();
    let mut expect_arrays = |are_needed: bool, are_there: bool, names: &str, reason: &str| {
        if are_needed && !are_there {
            faults.push(missing_arrays_fault(path, names, reason));
        }
    };
    let needs_memory = scene.laws.iter().any(ContactLaw::has_memory);
    expect_arrays(needs_memory, memory.is_some(), "contact_bonded to contact_moment", "a law has bonds or moments");
    let needs_law_memory = scene.laws.iter().any(ContactLaw::has_law_memory);
    expect_arrays(
        needs_law_memory,
        laws.is_some(),
        "contact_reference_gap to contact_sliding",
        "a law has reference gaps or interfaces",
    );
    let has_pair_cohesion = scene.laws.iter().any(|law| law.pair_cohesion().is_some());
    expect_arrays(has_pair_cohesion, attractions.is_some(), "contact_attraction", "a law has cohesion of pairs");
    let keeps_gravity = meta.attraction.is_some();
    expect_arrays(keeps_gravity, gravity.is_some(), "gravity_last, gravity_before", "meta has attraction");
    let exchanges_bodies =
        ["sinks", "sources"].iter().any(|name| meta.options.get(*name).is_some_and(|list| list != "[]"));
    expect_arrays(exchanges_bodies, presence.is_some(), "body_presence", "the run has sinks or sources");
    let has_interval = meta.interval_start.is_some();
    expect_arrays(has_interval, interval.is_some(), "interval_body, interval_virial", "meta has interval_start");
    let (bodies, contacts) = (&snapshot.bodies, &snapshot.contacts);
    let arrays = [
        ("body_x", &bodies.body_x),
        ("body_v", &bodies.body_v),
        ("body_w_world", &bodies.body_w_world),
        ("contact_impulse", &contacts.contact_impulse),
        ("contact_velocity", &contacts.contact_velocity),
    ];
    for (name, rows) in arrays {
        let too_large = (1..).zip(rows).find(|(_, row)| row.iter().any(|x| x.abs() >= MAX_MAGNITUDE));
        if let Some((number, row)) = too_large {
            let object = format!("array {name}, row {number}");
            faults.push(Fault::new(
                path,
                None,
                object,
                format!("{row:?}"),
                format!("expected numbers below {MAX_MAGNITUDE:e} in magnitude"),
            ));
        }
    }
    let mut expect_meta = |holds: bool, name: &str, value: f64, expected: String| {
        if !holds {
            faults.push(Fault::new(path, None, format!("meta, {name}"), number_text(value), expected));
        }
    };
    expect_meta(meta.h.is_finite() && meta.h > 0.0, "h", meta.h, "expected more than 0 s".into());
    if meta.step > scene.start.step {
        let elapsed = meta.time - scene.start.time;
        let expected = format!("expected at most the {} s since the start", number_text(elapsed));
        expect_meta(meta.h <= elapsed * (1.0 + META_ROUNDING), "h", meta.h, expected);
    }
    let unconverged = meta.ledger.steps_unconverged;
    let expected = format!("expected at most the {} so far", count_text(meta.step as usize, "step"));
    expect_meta(unconverged <= meta.step, "ledger, steps_unconverged", unconverged as f64, expected);
    if let Some(dt) = meta.options.get("dt").and_then(|dt| dt.parse::<f64>().ok()) {
        // A step is a whole number of dt.
        let multiple = meta.h / dt;
        let largest = meta.parameters.adaptive.as_ref().map_or(1, |adaptive| adaptive.max_multiple) as f64;
        let is_multiple = (multiple - multiple.round()).abs() <= META_ROUNDING * multiple && multiple <= 1.5 * largest;
        let expected = format!("expected dt = {} s of meta, or a multiple of an adaptive run", number_text(dt));
        expect_meta(meta.h <= 0.0 || is_multiple, "h", meta.h, expected);
        let (first_step, first_time) = meta.counted_from.unwrap_or((scene.start.step, scene.start.time));
        let time = first_time + meta.step.saturating_sub(first_step) as f64 * dt;
        let is_reached = (meta.time - time).abs() <= META_ROUNDING * time.abs().max(dt);
        let expected = format!("expected {} s, which step {} reaches", number_text(time), meta.step);
        expect_meta(is_reached, "time", meta.time, expected);
    }
    if let Some(control) = &meta.accuracy_control {
        for (name, value) in
            [("tol", control.tol), ("penetration", control.penetration), ("gravity_error", control.gravity_error)]
        {
            let name = format!("accuracy_control, {name}");
            expect_meta(value > 0.0 && value < 1.0, &name, value, "expected more than 0 and less than 1".into());
        }
    }
    faults.into_result(())
}

/// Largest relative difference of times in a snapshot from those of its step; rounding of their sums is smaller.
const META_ROUNDING: f64 = 1e-9;

/// Largest difference of START.npz from DOF.INI, relative to the farthest and the fastest body: digits of that file.
const FILE_ROUNDING: f64 = 1e-6;
/// Largest difference of axes, rad; their drift between writings is smaller.
const MAX_AXES_ROTATION: f64 = 1e-5;

/// Relation of a run to the one whose state it starts from.
#[derive(Debug, Clone, Default)]
pub struct StartOrigin {
    /// Step and time (s) from which that run counted, if it is continued in time.
    pub counted_from: Option<(u64, f64)>,
    /// See [`SnapshotMeta::continues_run`](cd_formats::snapshot::SnapshotMeta::continues_run).
    pub continues_run: bool,
    /// Circles of walls in that run.
    pub wall_circles: Vec<WallCircle>,
}

/// Restores time, motion and contacts of `DATBOX/START.npz` into `state`, which is initialised from the text files. Body
/// k has the row with `body_id` k; a body without a row keeps its state.
///
/// The law of a contact is that of TACT_BEHAV.DAT for its two bodies; without one the contact is dropped. Rejects bodies
/// that are not in DATBOX, and positions, axes and velocities other than those of the text files, which have then been
/// edited. Velocities imposed by DRV_DOF.DAT are not compared.
pub fn restore_start(path: &Path, scene: &Scene, state: &mut State) -> Result<StartOrigin, Faults> {
    let snapshot = Snapshot::read(path)?;
    check_start(path, &snapshot, scene, state)?;
    let SnapshotMeta { counted_from, continues_run, ref revolutions, .. } = snapshot.meta;
    let origin = StartOrigin { counted_from, continues_run, wall_circles: revolutions.clone() };
    let bodies_of_rows: Vec<BodyId> = snapshot.bodies.body_id.iter().map(|&id| BodyId(id as u32 - 1)).collect();
    let mut restored = state.clone();
    let inertia = snapshot.bodies.body_inertia.clone();
    let (cached_pairs, turning) = match &snapshot.shapes {
        Some(shapes) => {
            (restored_pairs(scene, shapes, |row| bodies_of_rows[row as usize]), shapes.turning.turning_body.clone())
        }
        None => (Vec::new(), Vec::new()),
    };
    let snapshot_laws = snapshot.meta.laws.clone();
    restore_state(snapshot, &mut restored);
    (state.step, state.time, state.h) = (restored.step, restored.time, restored.h);
    state.interval.start = restored.time;
    state.ledger.penetration_left = restored.ledger.penetration_left;
    state.primary_response = restored.primary_response;
    state.cell = restored.cell;
    state.radii = restored.radii;
    for (row, &i) in bodies_of_rows.iter().enumerate() {
        let i = i.index();
        (state.x[i], state.q[i]) = (restored.x[row], restored.q[row]);
        (state.v[i], state.w[i]) = (restored.v[row], restored.w[row]);
    }
    for (&i, angular_momentum) in scene.free_rotors.iter().zip(&mut state.angular_momentum) {
        *angular_momentum = scene.bodies[i.index()].angular_momentum(&state.q[i.index()], &state.w[i.index()]);
    }
    // A body whose density has changed keeps its angular velocity.
    for (angular_momentum, row) in restored.angular_momentum.into_iter().zip(turning) {
        let (i, body_inertia) = (bodies_of_rows[row as usize], inertia[row as usize]);
        if let (Ok(index), true) =
            (scene.free_rotors.binary_search(&i), scene.bodies[i.index()].inertia == body_inertia)
        {
            state.angular_momentum[index] = angular_momentum;
        }
    }
    state.detection_cache = DetectionCache { restored_pairs: cached_pairs, ..DetectionCache::default() };
    let memories = restored.memories.into_iter().chain(std::iter::repeat(LawMemory::default()));
    let attractions = restored.pair_attractions.into_iter().chain(std::iter::repeat(0.0));
    let contacts = restored.contacts.into_iter().zip(memories.zip(attractions));
    let contacts = contacts_of_start(scene, &snapshot_laws, &bodies_of_rows, contacts);
    (state.contacts, (state.memories, state.pair_attractions)) = contacts.into_iter().unzip();
    if !scene.laws.iter().any(ContactLaw::has_law_memory) {
        state.memories.clear();
    }
    if !scene.laws.iter().any(|law| law.pair_cohesion().is_some()) {
        state.pair_attractions.clear();
    }
    state.bonding = BondingMode::No;
    Ok(origin)
}

/// Checks that the bodies of START.npz are those of DATBOX, each once, with the motion of the text files.
fn check_start(path: &Path, snapshot: &Snapshot, scene: &Scene, state: &State) -> Result<(), Faults> {
    let mut faults = Faults::default();
    let mut add_fault = |object: String, found: String, expected: String| {
        faults.push(Fault::new(path, None, object, found, expected));
    };
    // The text files cannot represent smaller numbers.
    let largest_norm = |vectors: &[Vec3]| vectors.iter().map(|x| x.norm()).fold(1e-90, f64::max);
    let (extent, speed, spin) = (largest_norm(&state.x), largest_norm(&state.v), largest_norm(&state.w));
    let mut known = vec![false; scene.bodies.len()];
    for (row, &id) in snapshot.bodies.body_id.iter().enumerate() {
        let object = format!("body {id}");
        let Some(known) = known.get_mut((id as usize).wrapping_sub(1)) else {
            add_fault(object, "is not in DATBOX".into(), format!("expected 1 to {}", scene.bodies.len()));
            continue;
        };
        if std::mem::replace(known, true) {
            add_fault(object, "occurs twice".into(), "expected once".into());
            continue;
        }
        let (i, bodies) = (id as usize - 1, &snapshot.bodies);
        let mut agree = |quantity: &str, found: [f64; 3], datbox: Vec3, unit: &str, scale: f64| {
            let agrees = (Vec3::from(found) - datbox).norm() <= FILE_ROUNDING * scale;
            if !agrees {
                let expected =
                    format!("expected {:?} as in BODIES.DAT and DOF.INI, or no START.npz", datbox.as_slice());
                add_fault(object.clone(), format!("{quantity} {found:?} {unit}"), expected);
            }
            agrees
        };
        let is_in_position = agree("at", bodies.body_x[row], state.x[i], "m", extent);
        if is_in_position && !scene.bodies[i].driven {
            agree("velocity", bodies.body_v[row], state.v[i], "m/s", speed);
            agree("angular velocity", bodies.body_w_world[row], state.w[i], "rad/s", spin);
        }
        if is_in_position && scene.oriented[i] {
            let [w, x, y, z] = bodies.body_q[row];
            let turned = state.q[i].angle_to(&UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z)));
            if turned > MAX_AXES_ROTATION {
                let expected = "expected axes a, b, g as in DOF.INI, or no START.npz".into();
                add_fault(object, format!("turned by {turned:.1e} rad"), expected);
            }
        }
    }
    faults.into_result(())
}

/// The contacts of a snapshot and their memories in the order of a step, with the laws of `scene`; contacts of bodies without
/// a rule are dropped. `bodies_of_rows`: body of each row of the snapshot.
fn contacts_of_start<M: Default>(
    scene: &Scene,
    snapshot_laws: &[LawName],
    bodies_of_rows: &[BodyId],
    contacts: impl Iterator<Item = (SolvedContact, M)>,
) -> Vec<(SolvedContact, M)> {
    let mut contacts: Vec<(SolvedContact, M)> = contacts.collect();
    for (solved, _) in &mut contacts {
        let contact = &mut solved.contact;
        (contact.candidate, contact.antagonist) =
            (bodies_of_rows[contact.candidate.index()], bodies_of_rows[contact.antagonist.index()]);
    }
    let rule_of = |contact: &Contact| {
        let a = scene.contactor_class(contact.candidate, contact.part_numbers.candidate)?;
        let b = scene.contactor_class(contact.antagonist, contact.part_numbers.antagonist)?;
        scene.visibility.interaction_rule(a, b)
    };
    contacts.retain_mut(|(solved, memory)| {
        let Some(rule) = rule_of(&solved.contact) else { return false };
        let kinds = [&snapshot_laws[solved.contact.law.index()], &scene.law_names[rule.law]].map(|law| &law.kind);
        // The memory of another kind of law has no meaning for this one: a liquid bridge is not a solid bond.
        if kinds[0] != kinds[1] {
            (solved.bond, *memory) = (None, M::default());
        }
        solved.contact.law = rule.law;
        true
    });
    // Bodies may have other numbers, or be combined with other shapes.
    for (number, (solved, _)) in (0..).zip(&mut contacts) {
        let Contact { candidate, antagonist, part_numbers, .. } = solved.contact;
        let sides = [
            scene.candidate_order(candidate, part_numbers.candidate),
            scene.candidate_order(antagonist, part_numbers.antagonist),
        ];
        if sides[0] > sides[1] {
            swap_sides(solved);
            // Two spheres touch at one point; other contacts are identified by their position.
            let spheres = sides.iter().all(|side| side.0 == 0);
            let features = if spheres { [0, 0] } else { [UNKNOWN_FEATURE, number] };
            solved.contact.features = features.into();
        }
    }
    for (solved, _) in &mut contacts {
        let law = &scene.laws[solved.contact.law];
        solved.moment = if law.has_moments() { solved.moment } else { Vec3::zeros() };
    }
    contacts.sort_by_key(|(solved, _)| solved.contact.key());
    contacts
}

/// Exchanges candidate and antagonist.
fn swap_sides(solved: &mut SolvedContact) {
    let old = solved.contact.frame();
    let contact = &mut solved.contact;
    (contact.candidate, contact.antagonist) = (contact.antagonist, contact.candidate);
    contact.part_numbers = contact.part_numbers.swapped_sides();
    contact.normal = -contact.normal;
    let new = contact.frame();
    for vector in [&mut solved.impulse, &mut solved.moment, &mut solved.velocity] {
        *vector = to_local(&new, &-to_world(&old, vector));
    }
}

/// Last two evaluations of self-gravity; `None` if the snapshot has none, or another gravitational constant.
fn restored_attraction(scene: &Scene, snapshot: &Snapshot) -> Option<GravityHistory> {
    if snapshot.meta.parameters.gravity_constant != scene.options.gravity_constant {
        return None; // another constant: cannot be extrapolated
    }
    let (record, gravity) = (snapshot.meta.attraction.clone()?, snapshot.gravity.as_ref()?);
    let free_rows = |rows: &[[f64; 3]]| scene.free.iter().map(|&i| Vec3::from(rows[i.index()])).collect();
    Some(GravityHistory {
        record,
        last: free_rows(&gravity.gravity_last),
        previous: free_rows(&gravity.gravity_before),
    })
}

/// Cached data of pairs of contactors that this scene has; `body` returns the body of each row of the snapshot.
fn restored_pairs(scene: &Scene, shapes: &ShapeArrays, body: impl Fn(u32) -> BodyId) -> Vec<CachedPair> {
    let part = |row: u32, part_number: u32| scene.part_index(body(row), part_number.try_into().ok()?);
    let rows = shapes.pairs.pair_body.iter().zip(&shapes.pairs.pair_rank).zip(&shapes.pairs.pair_memory);
    let mut pairs: Vec<CachedPair> = rows
        .filter_map(|((&[a, b], &[r, s]), &words)| {
            Some(CachedPair { parts: [part(a, r)?, part(b, s)?], memory: CachedFeature::from_words(words) })
        })
        .collect();
    pairs.sort_by_key(|pair| pair.parts);
    pairs
}

/// Moves the state of a snapshot into `state`, with bodies numbered as in the snapshot.
fn restore_state(snapshot: Snapshot, state: &mut State) {
    let Snapshot { meta, bodies, contacts, memory, laws, attractions, shapes, interval, .. } = snapshot;
    let shapes = shapes.unwrap_or_default();
    let interval = interval.unwrap_or_default();
    let part_numbers =
        |k: usize| shapes.contacts.contact_rank.get(k).copied().unwrap_or_default().map(|number| number as u16).into();
    let vectors = |rows: Vec<[f64; 3]>| rows.into_iter().map(Vec3::from).collect::<Vec<_>>();
    state.step = meta.step;
    state.time = meta.time;
    state.h = meta.h;
    state.x = vectors(bodies.body_x);
    // The norm is already 1; normalising again could change the last bit.
    state.q =
        bodies.body_q.iter().map(|&[w, x, y, z]| UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z))).collect();
    state.v = vectors(bodies.body_v);
    state.w = vectors(bodies.body_w_world);
    state.angular_momentum = vectors(shapes.turning.turning_momentum);
    state.events_done = meta.parameters.events_done as usize;
    state.ledger = meta.ledger;
    state.postpro = meta.postpro;
    state.rest_since = meta.rest_since;
    state.accuracy_control = meta.accuracy_control;
    state.primary_response = state.primary_response.map(|initial| meta.primary_response.unwrap_or(initial));
    state.bodies_entered = meta.bodies_entered;
    state.cell = meta.cell.or(state.cell);
    for radius in &mut state.radii {
        *radius = meta.radii.iter().copied().find(|known| known.body == radius.body).unwrap_or(*radius);
    }
    state.fallback = meta.fallback;
    let pair_virials = interval.interval_body.into_iter().zip(interval.interval_virial);
    state.interval = OutputInterval {
        start: meta.interval_start.unwrap_or(meta.time),
        pair_virials: pair_virials.map(|(bodies, virial)| PairVirial { bodies: bodies.map(BodyId), virial }).collect(),
    };
    state.contacts = (0..contacts.contact_body.len())
        .map(|k| SolvedContact {
            contact: Contact {
                candidate: BodyId(contacts.contact_body[k][0]),
                antagonist: BodyId(contacts.contact_body[k][1]),
                part_numbers: part_numbers(k),
                features: contacts.contact_feature[k].into(),
                point: Vec3::from(contacts.contact_point[k]),
                image: Vec3::zeros(),
                normal: Vec3::from(contacts.contact_frame[k][0]),
                gap: contacts.contact_gap[k],
                area: shapes.contacts.contact_area.get(k).copied().unwrap_or_default(),
                law: LawId(contacts.contact_law[k]),
            },
            impulse: Vec3::from(contacts.contact_impulse[k]),
            moment: memory.as_ref().map_or(Vec3::zeros(), |m| m.contact_moment[k].into()),
            velocity: Vec3::from(contacts.contact_velocity[k]),
            status: match contacts.contact_status[k] {
                STATUS_NO_CONTACT => ContactStatus::NoContact,
                STATUS_SLIDE => ContactStatus::Slide,
                _ => ContactStatus::Stick,
            },
            bond: memory.as_ref().filter(|m| m.contact_bonded[k] != 0).map(|m| m.contact_bond_gap[k]),
        })
        .collect();
    state.pair_attractions = attractions.map_or(Vec::new(), |attractions| attractions.contact_attraction);
    state.memories = laws.map_or(Vec::new(), |laws| {
        let law_memory = |k: usize| LawMemory {
            reference_gap: laws.contact_reference_gap[k],
            soundness: laws.contact_soundness[k],
            sliding: laws.contact_sliding[k].into(),
        };
        (0..laws.contact_reference_gap.len()).map(law_memory).collect()
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exchanged_sides_have_the_opposite_loads() {
        let contact = Contact {
            candidate: BodyId(3),
            antagonist: BodyId(5),
            part_numbers: [1, 2].into(),
            features: [0, 0].into(),
            point: Vec3::zeros(),
            image: Vec3::zeros(),
            normal: Vec3::new(2.0, -1.0, 2.0) / 3.0,
            gap: 0.0,
            area: 0.0,
            law: LawId(0),
        };
        let loads = [[1.0, 2.0, 3.0], [4.0, -5.0, 6.0], [-7.0, 8.0, 9.0]].map(Vec3::from);
        let before = SolvedContact {
            contact,
            impulse: loads[0],
            moment: loads[1],
            velocity: loads[2],
            status: ContactStatus::Stick,
            bond: None,
        };
        let mut after = before;
        swap_sides(&mut after);
        let sides = (after.contact.candidate, after.contact.antagonist, after.contact.part_numbers);
        assert_eq!(sides, (BodyId(5), BodyId(3), [2, 1].into()));
        assert_eq!(after.contact.normal, -contact.normal);
        let in_world = |solved: &SolvedContact| {
            let frame = solved.contact.frame();
            [solved.impulse, solved.moment, solved.velocity].map(|vector| to_world(&frame, &vector))
        };
        for (before, after) in in_world(&before).into_iter().zip(in_world(&after)) {
            // Rounding of numbers up to 10.
            assert!((before + after).norm() < 1e-14, "{before:?} {after:?}");
        }
        // The normal component, a pressure, is that of both sides.
        assert!((after.impulse.x - 1.0).abs() < 1e-14);
    }
}
