//! Stage: reads files into [`Scene`] and [`State`]. Rejects, with file and line, invalid input and features that this
//! program does not support.

mod behaviour;
mod bodies;
mod parts;
pub mod resume;

use std::path::{Path, PathBuf};

use cd_formats::atomic::{path_exists, read_text};
use cd_formats::bodies::Bodies;
use cd_formats::bulk_behav::BulkBehav;
use cd_formats::compute::{Compute, ComputeFlags, Event, EventAction, event_schedule};
use cd_formats::dof::Dof;
use cd_formats::drv_dof::DrvDof;
use cd_formats::error::{Fault, Faults};
use cd_formats::origin::SceneOrigin;
use cd_formats::report::FaultReport;
use cd_formats::snapshot::{FallbackState, Ledger, START_FILE};
use cd_formats::tact_behav::TactBehav;
use cd_formats::vloc_rloc::VlocRloc;

use crate::features::BARE;
use crate::math::Vec3;
use crate::scene::Scene;
use crate::state::{BondingMode, DetectionCache, OutputInterval, State};

/// Name of the options file in DATBOX.
pub const COMPUTE_FILE: &str = "COMPUTE.RON";

/// Reads `case/DATBOX`; `flags` take precedence over COMPUTE.RON. Returns all faults of all files at once.
pub fn read_case(case: &Path, flags: &ComputeFlags) -> Result<(Scene, State), Faults> {
    let datbox = case.join("DATBOX");
    let mut faults = Faults::default();
    let options = faults.gather_result(read_options(&datbox, flags));
    let bulk = faults.gather_result(BulkBehav::read(&datbox.join("BULK_BEHAV.DAT")));
    let tact = faults.gather_result(TactBehav::read(&datbox.join("TACT_BEHAV.DAT")));
    let bodies = faults.gather_result(Bodies::read(&datbox.join("BODIES.DAT")));
    let driven = faults.gather_result(DrvDof::read(&datbox.join("DRV_DOF.DAT")));
    let dof = faults.gather_result(Dof::read(&datbox.join("DOF.INI")));
    let history = datbox.join("Vloc_Rloc.INI");
    let history =
        if path_exists(&history) { faults.gather_result(VlocRloc::read(&history)) } else { Some(VlocRloc::default()) };
    let (Some(options), Some(bulk), Some(tact), Some(bodies), Some(driven), Some(dof), Some(history)) =
        (options, bulk, tact, bodies, driven, dof, history)
    else {
        return Err(faults);
    };

    let mut scene = bodies::scene_without_laws(&datbox, &bodies, &bulk, &driven, options, &mut faults);
    (scene.start, scene.from) = ((dof.step, dof.time), (dof.step, dof.time));
    behaviour::set_laws_and_visibility(&datbox, &tact, &mut scene, &mut faults);
    let (source, text) = faults.gather_result(events_text(&datbox, flags)).unwrap_or_default();
    let mut of_events = FaultReport::new(&source, &text);
    behaviour::check_events(&scene, &mut of_events);
    behaviour::check_text(&mut scene);
    let (x, q, v, w) = bodies::initial_motion(&datbox, &bodies, &dof, &scene, &mut faults);
    scene.notes.extend(bodies::period_gap_notes(&scene, &q));
    bodies::check_level(&datbox, &bodies, &scene, &q, &mut faults);
    bodies::check_within(&datbox, &bodies, &scene, &x, &q, &mut faults);
    let (contacts, memories) = behaviour::initial_contacts(&datbox, &history, &mut scene, &q, &mut faults);
    let spin =
        (scene.turning.iter().map(|&i| i.index())).map(|i| scene.bodies[i].angular_momentum(&q[i], &w[i])).collect();
    let mut state = State {
        step: dof.step,
        time: dof.time,
        h: scene.options.dt,
        x,
        q,
        v,
        w,
        angular_momentum: spin,
        order: Vec::new(),
        detection_cache: DetectionCache::default(),
        contacts,
        memories,
        interval: OutputInterval { start: dof.time, ..OutputInterval::default() },
        gravity: Vec3::from(bulk.gravity),
        quench: scene.options.quench,
        torque: Vec3::zeros(),
        laws: scene.laws.clone(),
        bonding: BondingMode::New,
        events_done: 0,
        attraction: None,
        fallback: FallbackState::default(),
        ledger: Ledger::default(),
    };
    let start = datbox.join(START_FILE);
    let started = path_exists(&start) && faults.0.is_empty();
    if started {
        faults.gather_result(resume::restore_start(&start, &scene, &mut state));
        (scene.start, scene.from) = ((state.step, state.time), (state.step, state.time));
    }
    behaviour::check_event_counts(&scene, &mut of_events);
    if BARE {
        check_bare(&scene, &mut faults);
    }
    faults.0.append(&mut of_events.faults.0);
    if !faults.0.is_empty() {
        return Err(faults);
    }
    scene.notes.extend(behaviour::ineffective_options(&scene));
    behaviour::doubts(&datbox, &tact, &mut scene, &mut of_events);
    scene.warnings.extend(origin_change_warning(case));
    scene.events = event_schedule(&scene.options.events, scene.end_time());
    let dt = scene.options.dt.min(state.h);
    resume::pass_events(&scene, &mut state, dt);
    if !started || flags.events.is_some() {
        scene.notes.extend(passed_events_note(&scene, &state));
    }
    faults.into_result((scene, state))
}

/// Warns if a file that DATBOX was generated from has changed since.
fn origin_change_warning(case: &Path) -> Option<String> {
    let text = std::fs::read_to_string(case.join("DATBOX").join(COMPUTE_FILE)).ok()?;
    SceneOrigin::from_compute_text(&text)?.change_warning(case)
}

/// Reports additive events before the start, which have no effect.
fn passed_events_note(scene: &Scene, state: &State) -> Option<String> {
    let adds = |event: &&Event| {
        matches!(
            event.action,
            EventAction::AddSpin(_) | EventAction::AddVelocity(_) | EventAction::Shake { .. } | EventAction::Bond
        )
    };
    let count = scene.events[..state.events_done].iter().filter(adds).count();
    let events = if count == 1 { "1 event".to_string() } else { format!("{count} events") };
    let time = state.time;
    (count > 0).then(|| format!("events: {events} before the start at {time} s: what they add or bond is not done"))
}

/// Rejects features that the program is built without.
fn check_bare(scene: &Scene, faults: &mut Faults) {
    let has = [
        (!scene.parts.is_empty(), "other shapes than spheres and plates"),
        (scene.options.self_gravity, "self-gravity"),
        (scene.laws.iter().any(|law| law.cohesion.is_some()), "cohesion"),
        (scene.laws.iter().any(|law| law.rolling.is_some()), "resistance to rolling"),
    ];
    for (_, what) in has.into_iter().filter(|(has, _)| *has) {
        faults.push(Fault::new(
            "program".as_ref(),
            None,
            what,
            "not in this build",
            "expected one without the feature `bare`",
        ));
    }
}

/// File and text of the events, unless they come from the command line.
fn events_text(datbox: &Path, flags: &ComputeFlags) -> Result<(PathBuf, String), Faults> {
    let path = datbox.join(COMPUTE_FILE);
    if flags.events.is_some() || !path_exists(&path) {
        return Ok(("options".into(), String::new()));
    }
    let text = read_text(&path)?;
    Ok((path, text))
}

fn read_options(datbox: &Path, flags: &ComputeFlags) -> Result<Compute, Faults> {
    let path = datbox.join(COMPUTE_FILE);
    let options = if path_exists(&path) { Compute::read(&path)? } else { Compute::default() };
    let options = options.with_flags(flags);
    options.check(Path::new("options"))?;
    Ok(options)
}
