//! Stage: reads files into [`Scene`] and [`State`]. Rejects, with file and line, invalid input and features that this
//! program does not support.

mod behaviour;
mod bodies;
mod contactors;
pub mod driver;
mod lenient;
mod links;
mod mirror;
mod parts;
mod radii;
pub mod resume;
mod servo_walls;
mod sinks_and_sources;
pub mod wholeness;

use std::path::{Path, PathBuf};

use cd_formats::atomic::{path_exists, read_text};
use cd_formats::bodies::Bodies;
use cd_formats::bulk_behav::BulkBehav;
use cd_formats::compute::{Compute, ComputeFlags, ContactSolver, Event, EventAction, FaceFriction, event_schedule};
use cd_formats::dof::Dof;
use cd_formats::drv_dof::DrvDof;
use cd_formats::error::{Fault, Faults};
use cd_formats::field::FieldShapes;
use cd_formats::names::rounded_number;
use cd_formats::origin::SceneOrigin;
use cd_formats::postpro::Postpro;
use cd_formats::report::FaultReport;
use cd_formats::ron_file::former_name_warnings;
use cd_formats::snapshot::{FallbackState, Ledger, PostproSums, START_FILE};
use cd_formats::tact_behav::TactBehav;
use cd_formats::vloc_rloc::VlocRloc;

use crate::features::BARE;
use crate::math::Vec3;
use crate::read::bodies::BodyFiles;
use crate::read::contactors::ContactorTable;
use crate::read::lenient::FolderReader;
use crate::scene::{BodyId, Scene, StepTime};
use crate::state::{BondingMode, DetectionCache, LawMemory, OutputInterval, SolvedContact, State};

/// Name of the options file in DATBOX.
pub const COMPUTE_FILE: &str = "COMPUTE.RON";

/// Contents of the files of a DATBOX.
struct DatboxFiles {
    options: Compute,
    bodies: Bodies,
    bulk: BulkBehav,
    tact: TactBehav,
    driven: DrvDof,
    dof: Dof,
    history: VlocRloc,
    /// Notices for the user.
    notices: Vec<String>,
}

impl DatboxFiles {
    /// Reads the files. The second value has faults of single lines, in spite of which the rest of the files can be checked.
    fn read(datbox: &Path, flags: &ComputeFlags) -> Result<(DatboxFiles, Faults), Faults> {
        let mut faults = Faults::default();
        let options = faults.gather_result(read_options(datbox, flags));
        let (mut files, bodies) = FolderReader::new(datbox)?;
        let bulk = files.read("BULK_BEHAV.DAT", BulkBehav::parse_with_notices);
        let tact = files.read("TACT_BEHAV.DAT", TactBehav::parse_with_notices);
        let driven = files.read_optional("DRV_DOF.DAT", DrvDof::parse_with_notices, "no motion or load is imposed");
        let at_rest = Some("all bodies are at rest at step 0, time 0, with the positions and axes of BODIES.DAT");
        let dof = files.read_optional_file("DOF.INI", Dof::read_with_notices, at_rest);
        let history = files.read_optional(
            "Vloc_Rloc.INI",
            VlocRloc::parse_with_notices,
            "no contacts are known from an earlier step",
        );
        faults.0.append(&mut files.faults.0);
        let notices = files.notices;
        match (options, bulk, tact, bodies, driven, dof, history) {
            (Some(options), Some(bulk), Some(tact), Some(bodies), Some(driven), Some(dof), Some(history)) => {
                Ok((DatboxFiles { options, bodies, bulk, tact, driven, dof, history, notices }, faults))
            }
            _ => Err(faults),
        }
    }
}

/// Reads `case/DATBOX`; `flags` take precedence over COMPUTE.RON. Returns all faults of all files at once.
///
/// A DATBOX that is not whole is rejected, see [`wholeness`].
pub fn read_case(case: &Path, flags: &ComputeFlags) -> Result<(Scene, State), Faults> {
    let datbox = case.join("DATBOX");
    let _lock = wholeness::lock_datbox(&datbox)?;
    let changed_files = wholeness::changed_files_warning(&datbox)?;
    let (files, mut faults) = DatboxFiles::read(&datbox, flags)?;
    let DatboxFiles { options, bodies, bulk, tact, driven, dof, history, notices } = files;
    let field_shapes = faults.gather_result(FieldShapes::read(&options.fields, &datbox));
    lenient::check_absent_axes(&datbox, &bodies, &mut faults);

    let body_files = BodyFiles { records: &bodies, bulk: &bulk, driven: &driven, dof: &dof };
    let has_links = links::has_links(&bodies, &tact);
    let mut scene = bodies::scene_without_laws(&datbox, body_files, has_links, options, &mut faults);
    match field_shapes {
        Some(shapes) => scene.field_shapes = shapes,
        // The faults end the run; the other files are checked without the fields.
        None => scene.options.fields.clear(),
    }
    set_requests(&datbox, bodies.0.len(), &mut scene, &mut faults);
    scene.notes.splice(0..0, notices);
    let contactors = ContactorTable::new(&bodies, &scene);
    behaviour::set_laws_and_visibility(&datbox, &tact, &contactors, &mut scene, &mut faults);
    links::set_links(&datbox, &bodies, &tact, &driven, &mut scene, &mut faults);
    let (source, text) = faults.gather_result(events_text(&datbox, flags)).unwrap_or_default();
    let mut event_report = FaultReport::new(&source, &text);
    behaviour::check_events(&scene, &mut event_report);
    behaviour::check_probes(&scene, &bulk.gravity, &mut event_report);
    behaviour::check_text(&datbox, &mut scene, &mut faults);
    behaviour::check_cell(&datbox, &scene, &mut faults);
    behaviour::check_impacts(&datbox, &scene, &mut faults);
    let mut motion = bodies::initial_motion(&datbox, &bodies, &dof, &mut scene, &mut faults);
    radii::set_changing_radii(&datbox.join(COMPUTE_FILE), &mut scene, dof.time, &mut faults);
    servo_walls::set_servo_walls(&datbox, &driven, &mut scene, dof.time, &mut motion, &mut faults);
    scene.notes.extend(bodies::period_gap_notes(&scene, &motion.q));
    bodies::check_plates_are_level(&datbox, &bodies, &scene, &motion.q, &mut faults);
    bodies::check_bodies_are_inside_drums(&datbox, &bodies, &scene, &motion.x, &motion.q, &mut faults);
    behaviour::check_laws_of_contacts(&datbox, &history, &tact, &mut faults);
    let contacts = behaviour::initial_contacts(&datbox, &bodies, &history, &mut scene, &motion, &mut faults);
    let mut state = initial_state(&scene, &dof, motion, contacts, Vec3::from(bulk.gravity));
    if history.step > 0 || !history.contacts.is_empty() {
        state.bonding = BondingMode::No; // continues a run, in which new contacts begin broken and from touch
        if history.contacts.is_empty() && scene.laws.iter().any(|law| law.can_bond() || law.has_law_memory()) {
            scene.notes.push(format!(
                "Vloc_Rloc.INI: no contacts at step {}: the run continues another and begins no bonds, bridges, \
                 interfaces or reference gaps; an event Bond begins them",
                history.step
            ));
        }
    }
    let start = datbox.join(START_FILE);
    let has_start = path_exists(&start) && faults.0.is_empty();
    let cell_of_options = state.cell.take();
    if has_start {
        let origin = faults.gather_result(resume::restore_start(&start, &scene, &mut state)).unwrap_or_default();
        scene.start = StepTime { step: state.step, time: state.time };
        scene.continues_run = origin.continues_run;
        scene.counted_from = resume::counted_from(&scene, &state, origin.counted_from);
        scene.set_wall_circles(&origin.wall_circles);
    }
    if let (None, Some(cell)) = (state.cell, cell_of_options) {
        state.cell = Some(cell);
        // Velocities in files without a cell are those about the affine field.
        scene.free.iter().map(|i| i.index()).for_each(|i| state.v[i] += cell.gradient() * state.x[i]);
    }
    behaviour::check_event_counts(&scene, &mut event_report);
    if BARE {
        check_bare(&scene, &mut faults);
    }
    faults.0.append(&mut event_report.faults.0);
    if !faults.0.is_empty() {
        return Err(faults);
    }
    apply_lmgc90_defaults(&datbox, flags, &mut scene);
    scene.notes.extend(behaviour::ineffective_options(&scene));
    behaviour::doubts(&datbox, &tact, &mut scene, &mut event_report);
    scene.warnings.extend(changed_files);
    scene.warnings.extend(origin_change_warning(case));
    scene.warnings.extend(behaviour::pass_through_warning(&scene));
    scene.warnings.extend(behaviour::tidal_torque_warning(&scene));
    scene.warnings.extend(former_option_names(&datbox));
    scene.events = event_schedule(&scene.options.events, scene.end_time());
    let dt = scene.options.dt.min(state.h);
    resume::pass_events(&scene, &mut state, dt);
    sinks_and_sources::prepare_sinks_and_sources(&datbox.join(COMPUTE_FILE), flags, &mut scene, &mut state)?;
    if !has_start || flags.events.is_some() {
        scene.notes.extend(passed_events_note(&scene, &state));
    }
    faults.into_result((scene, state))
}

/// Sets the requests of POSTPRO.DAT, if there is one; `count` bodies are in BODIES.DAT.
fn set_requests(datbox: &Path, count: usize, scene: &mut Scene, faults: &mut Faults) {
    let requests = datbox.join("POSTPRO.DAT");
    if path_exists(&requests)
        && let Some(postpro) = faults.gather_result(Postpro::read(&requests, count))
    {
        scene.postpro = postpro.commands;
        // Their columns have components along the axes of bodies, which turn in LMGC90.
        scene.oriented.iter_mut().for_each(|oriented| *oriented |= !scene.postpro.is_empty());
        scene.notes.extend(postpro.notices);
    }
}

/// State at the start, at the step and time of DOF.INI, with the uniform gravity (m/s²) of BULK_BEHAV.DAT.
fn initial_state(
    scene: &Scene,
    dof: &Dof,
    bodies::InitialMotion { x, q, v, w }: bodies::InitialMotion,
    (contacts, memories): (Vec<SolvedContact>, Vec<LawMemory>),
    gravity: Vec3,
) -> State {
    let angular_momentum_of = |i: &BodyId| scene.bodies[i.index()].angular_momentum(&q[i.index()], &w[i.index()]);
    let angular_momentum = scene.free_rotors.iter().map(angular_momentum_of).collect();
    let radii = radii::initial_radii(scene, &x);
    State {
        step: dof.step,
        time: dof.time,
        h: scene.options.dt,
        x,
        q,
        v,
        w,
        angular_momentum,
        order: Vec::new(),
        detection_cache: DetectionCache::default(),
        contacts,
        memories,
        pair_attractions: Vec::new(),
        interval: OutputInterval { start: dof.time, ..OutputInterval::default() },
        gravity,
        quench: scene.options.quench,
        torque: Vec3::zeros(),
        laws: scene.laws.clone(),
        primary_response: scene.initial_response(),
        cell: behaviour::initial_cell(scene),
        radii,
        loads: Vec::new(),
        bonding: BondingMode::New,
        events_done: 0,
        attraction: None,
        fallback: FallbackState::default(),
        ledger: Ledger::default(),
        postpro: PostproSums::default(),
        presence: Vec::new(),
        exit_velocities: Vec::new(),
        bodies_entered: false,
        rest_since: None,
        accuracy_control: None,
    }
}

/// Replaces the uniform gravity of BULK_BEHAV.DAT (m/s²), unless an event before the start has set it.
pub fn replace_gravity(gravity: [f64; 3], scene: &Scene, state: &mut State) {
    let mut passed = scene.events[..state.events_done].iter();
    if !passed.any(|event| matches!(event.action, EventAction::SetGravity(_))) {
        state.gravity = Vec3::from(gravity);
    }
}

/// Warns if a file that DATBOX was generated from has changed since.
fn origin_change_warning(case: &Path) -> Option<String> {
    let text = read_text(&case.join("DATBOX").join(COMPUTE_FILE)).ok()?;
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
    let time = rounded_number(state.time);
    (count > 0).then(|| {
        format!("events: {events} before the start at {time} s have no effect (AddSpin, AddVelocity, Shake, Bond)")
    })
}

/// Rejects features that the program is built without.
fn check_bare(scene: &Scene, faults: &mut Faults) {
    let features = [
        (!scene.parts.is_empty(), "other shapes than spheres and plates"),
        (scene.options.self_gravity, "self-gravity"),
        (scene.laws.iter().any(|law| law.cohesion.is_some()), "cohesion"),
        (scene.laws.iter().any(|law| law.rolling.is_some()), "resistance to rolling"),
    ];
    for (_, feature) in features.into_iter().filter(|(is_used, _)| *is_used) {
        faults.push(Fault::new(
            "program".as_ref(),
            None,
            feature,
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

/// Number of sweeps between two checks in the examples of LMGC90. With the contacts of the step before as the start, they
/// bring a structure to rest; a vault would otherwise creep at the speeds that the tolerance allows.
const LMGC90_CHECK_EVERY: u64 = 50;

/// Largest number of sweeps. Masonry walls begin without forces: the first step of LMGC90's example of 105 blocks takes
/// 24 000 sweeps to E = 1e-4, of which the fallback solvers use a part. In LMGC90's examples the limit is 500 blocks of 50.
const LMGC90_MAX_SWEEPS: u64 = 40_000;

/// Tolerance with which the criterion of LMGC90's examples, `QM/16` at 1.666e-4, holds in 85 % to 88 % of the steps of a
/// pile of polyhedra and in all steps of vaults, see docs/reference/lmgc90.md.
const LMGC90_TOL: f64 = 1e-3;

/// Defaults for a DATBOX without COMPUTE.RON, which LMGC90's preprocessor has written. Friction acts at the corners of faces
/// as in LMGC90; in its example of 105 blocks this also keeps blocks ten times as near to the plane of the wall.
fn options_of_lmgc90(flags: &ComputeFlags) -> Compute {
    let corners = Compute { face_friction: FaceFriction::Corners, ..Compute::default() };
    let uses_sweeps = matches!(flags.solver, None | Some(ContactSolver::Auto | ContactSolver::Nlgs));
    if flags.accuracy.is_some() || !uses_sweeps {
        return corners;
    }
    Compute {
        check_every: Some(LMGC90_CHECK_EVERY),
        max_sweeps: Some(LMGC90_MAX_SWEEPS),
        tol: Some(LMGC90_TOL),
        ..corners
    }
}

/// Completes the defaults for a DATBOX without COMPUTE.RON: resets those that are for polyhedra in a scene without any, and
/// adds a note about the others that no flags replace.
fn apply_lmgc90_defaults(datbox: &Path, flags: &ComputeFlags, scene: &mut Scene) {
    if path_exists(&datbox.join(COMPUTE_FILE)) {
        return;
    }
    let is_friction_default = flags.face_friction.is_none();
    if is_friction_default && !scene.has_parts() {
        scene.options.face_friction = FaceFriction::default();
    }
    let options = options_of_lmgc90(flags);
    let tol = options.tol.filter(|_| flags.tol.is_none()).map(|tol| format!("tol = {tol}"));
    let checks = options.check_every.filter(|_| flags.check_every.is_none()).map(|n| format!("check_every = {n}"));
    let max_sweeps = options.max_sweeps.filter(|_| flags.max_sweeps.is_none()).map(|n| format!("max_sweeps = {n}"));
    let corners = (is_friction_default && scene.has_parts())
        .then(|| "face_friction = corners (--face-friction uniform: as a uniform pressure)".to_string());
    let defaults: Vec<String> = tol.into_iter().chain(checks).chain(max_sweeps).chain(corners).collect();
    if !defaults.is_empty() {
        let note =
            format!("DATBOX has no {COMPUTE_FILE}: {}, for the scenes of LMGC90's examples", defaults.join(", "));
        scene.notes.push(note);
    }
}

/// Warnings about former names in COMPUTE.RON.
fn former_option_names(datbox: &Path) -> Vec<String> {
    let path = datbox.join(COMPUTE_FILE);
    let text = if path_exists(&path) { read_text(&path).unwrap_or_default() } else { String::new() };
    former_name_warnings(&path, &text, &[]).0.iter().map(Fault::to_string).collect()
}

/// Options of COMPUTE.RON, or the defaults for a folder of LMGC90, with the flags; checked.
fn read_options(datbox: &Path, flags: &ComputeFlags) -> Result<Compute, Faults> {
    let path = datbox.join(COMPUTE_FILE);
    let options = if path_exists(&path) { Compute::read(&path)? } else { options_of_lmgc90(flags) };
    let options = options.with_flags(flags);
    options.check(Path::new("options"))?;
    Ok(options)
}
