//! `cd-pre from-outbox CASE DIR`: converts the state of one run to the DATBOX of the next.
//!
//! | module | |
//! |---|---|
//! | [`mod@changes`] | contents of the file of changes |
//! | [`digits`] | numbers with more digits than DATBOX can hold |
//! | `overlaps` | overlaps of bodies of different origin |
//! | `packing` | measured packing for strengths of the bulk |
//! | [`options`] | options of a run, as recorded in its snapshot |
//! | [`source`] | a case with one of its snapshots; selection and motion of its bodies |
//! | [`tables`] | merged materials, laws and visibility of several cases |
//!
//! `docs/reference/from-outbox.md` describes [`Changes`] for users.

pub mod changes;
pub mod digits;
pub mod options;
mod overlaps;
mod packing;
pub mod source;
pub mod tables;

use std::fs;
use std::path::Path;

use cd_formats::atomic;
use cd_formats::bodies::Bodies;
use cd_formats::compute::{Compute, ExternalField, PERIOD_NAMES, ROTATION_ABOUT_PERIOD};
use cd_formats::deforming_cell::CellState;
use cd_formats::dof::{BodyDof, Dof};
use cd_formats::drv_dof::{DrivenComponent, DrvDof, Evolution, table_text};
use cd_formats::error::{Fault, Faults};
use cd_formats::ids::BodyId;
use cd_formats::names::{count_text, number_text, rounded_number, short_number, vector_text};
use cd_formats::origin::SceneOrigin;
use cd_formats::report::FaultReport;
use cd_formats::ron_file;
use cd_formats::settings::{apply_settings, check_paths_once};
use cd_formats::sinks_and_sources::set_random_orders;
use cd_formats::snapshot::{self, BodyArrays, DRIVEN_ALL, Ledger, START_FILE, Snapshot, SnapshotMeta};
use cd_formats::vloc_rloc::VlocRloc;

use crate::check::check_vector;
use crate::datbox_folder::{ORIGIN_FILE, lock_datbox, write_files};
use crate::field_surfaces;
use crate::grain::Population;
use crate::parse::parse_with_settings;
use crate::population::populate;
use crate::reread;
use crate::scene::{self, Law, Material, Scene, SceneWall};
use crate::summary::{contact_radii, group_lines, pair_law_lines, print_warnings};
use crate::write;
pub use changes::{BodyFilter, Changes, MotionRemoval, Selection, WallSelector};
use source::{SourceCase, SourcePart, scene_path};
use tables::BehaviourTables;

/// A file of DATBOX: name and bytes.
type File = (String, Vec<u8>);

/// Makes `dir/DATBOX` from a snapshot of `case` and the file `changes`, whose values `settings` override, see
/// [`apply_settings`]. Returns a summary for people.
///
/// Errors: all faults of the file and of the cases that it names; nothing is written then.
pub fn write_datbox(case: &Path, changes: Option<&Path>, settings: &[String], dir: &Path) -> Result<String, Faults> {
    check_paths_once(settings)?;
    let (file, text) = match changes {
        Some(file) => (file, atomic::read_text(file)?),
        None => (Path::new("changes"), "()".to_string()),
    };
    let mut request = ChangeRequest::read(file, &text, settings)?;
    let mut report = FaultReport::with_settings(file, &request.text, settings);
    report.warnings = ron_file::former_name_warnings(file, &text, settings);
    check_changes(&request.changes, &mut report);
    let folder = file.parent().unwrap_or(Path::new(""));
    let mut sources = read_sources(&request, case, folder, dir, &mut report);
    reject_faults(&mut report)?;
    let packing_lines = packing::complete_bulk_strengths(&mut request.changes.laws, &sources[0], &mut report);
    reject_faults(&mut report)?;
    request.changes.laws.iter_mut().for_each(Law::apply_bulk_strength);
    let mut options = request.next_options(file, &sources[0], &mut report)?;
    let cell = request.continue_cells(&options, &mut sources, &mut report);
    reject_faults(&mut report)?;
    let parts = select_parts(&request.changes, &sources, &mut report);
    let keeps_numbers = parts.first().is_some_and(|part| part.source_bodies.len() == part.source.bodies.0.len());
    report.require(
        options.radii.is_empty() || keeps_numbers,
        "compute.radii",
        "hollow cylinders of which the changes take some bodies only",
        "all bodies of the first case, or no radii",
    );
    reject_faults(&mut report)?;
    set_random_orders(&mut options.sources, request.changes.seed);
    // The options of the changes name files in the folder of the changes; the options of the case name files in its DATBOX.
    let surfaces = match request.changes.compute {
        Some(_) => field_surfaces::take_surfaces(&mut options, folder, false),
        None => field_surfaces::take_surfaces(&mut options, &sources[0].case.join("DATBOX"), true),
    };
    let surface_files = report.faults.gather_result(surfaces).unwrap_or_default();
    reject_faults(&mut report)?;
    check_rotations(&request.changes, &options, &mut report);
    check_end(&request, &sources[0].snapshot.meta, &options, &mut report);
    let new = NewBodies::from_changes(&request.changes, &parts, &options, folder, &mut report);
    let mut records = body_records(&parts, &new);
    let mesh_files = records.name_mesh_files();
    let driven = driven_components(&parts, &new);
    let placed = overlaps::PlacedBodies::new(&parts, &new.population, &records, &driven);
    placed.check_overlaps(&request.changes, &options, &mut report);
    let tables = behaviour_tables(&request, &parts, &new, &records, &options, &mut report);
    reject_faults(&mut report)?;

    let datbox = dir.join("DATBOX");
    overlaps::check_drums(&parts, &new.population, &records, &tables.tact, &driven, &mut report);
    let source_options = &sources[0].options;
    let same_walls = options.cell == source_options.cell && options.radii == source_options.radii;
    let keeps_motion = options.theta == source_options.theta && same_walls;
    let keeps_steps = request.changes.contacts.is_empty() && keeps_motion;
    let content =
        DatboxContent { records: &records, tables: &tables, driven: &driven, options: &options, keeps_steps, cell };
    let mut files = datbox_files(request.changes.keep_time, &parts, &new, content);
    files.extend(surface_files.into_iter().chain(mesh_files).map(|(name, text)| (name, text.into_bytes())));
    let body_path = |body: usize| scene_path(&parts, &new.population, body);
    let bytes = files.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice()));
    reread::check_files(&datbox, bytes, &driven, &options, body_path, &mut report);
    reject_faults(&mut report)?;
    let _lock = lock_datbox(&datbox)?;
    let mut origin = SceneOrigin::from_outbox(case, changes, settings, dir);
    changes.into_iter().for_each(|file| origin.add(file, dir));
    scene::models(&request.changes.grains, &request.changes.walls)
        .for_each(|model| origin.add(&folder.join(model), dir));
    for SourcePart { source: SourceCase { case, snapshot, .. }, .. } in &parts {
        origin.add(&snapshot::snapshot_path(&case.join("OUTBOX"), snapshot.meta.step), dir);
    }
    for (_, bytes) in files.iter_mut().filter(|(name, _)| name == write::COMPUTE_FILE) {
        bytes.splice(..0, origin.lines().into_bytes());
    }
    write_files(&datbox, files.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())), &[])?;
    print_warnings(&report.warnings);
    let mut summary: String = parts.iter().map(part_summary).collect();
    summary += &sources[0].run_notes(Some(&options).filter(|_| request.changes.compute.is_none()));
    summary += &orbit_note(request.changes.keep_time, &sources[0], &options);
    summary += &response_note(request.changes.keep_time, &parts[0], &records, &options);
    let selected_count: usize = parts.iter().map(|part| part.source_bodies.len()).sum();
    summary += &digits::lost_digits(&records.0[..selected_count], &tables, &driven);
    summary += &group_lines(&new.scene, &new.population);
    let radii = parts.iter().flat_map(SourcePart::contact_radii).chain(contact_radii(&new.population));
    summary += &packing_lines;
    summary += &pair_law_lines(&request.changes.laws, radii);
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    summary += &format!("{}; wrote {}: {}\n", count_text(records.0.len(), "body"), datbox.display(), names.join(" "));
    Ok(summary)
}

/// Line that masses on orbits of the case are at their positions of time 0 again, if the next run has them and begins there;
/// empty if not.
fn orbit_note(keep_time: bool, source: &SourceCase, options: &Compute) -> String {
    let (time, fields) = (source.snapshot.meta.time, &source.options.fields);
    let continues = |field: &ExternalField| field.orbit().is_some() && fields.contains(field);
    if keep_time || time == 0.0 || !options.fields.iter().any(continues) {
        return String::new();
    }
    format!(
        "fields: the orbits begin at time 0 again, not at the {} s of the snapshot; keep_time: true continues them\n",
        rounded_number(time)
    )
}

/// Whether a primary that responds has its orbit of the run: that about the same mass.
fn keeps_orbit(part: &SourcePart, records: &Bodies, options: &Compute) -> bool {
    part.is_whole_run(records.0.len()) && options.fields == part.source.options.fields
}

/// Line that a primary that responds begins on its orbit, not where it was in the run; empty if it continues, or time does not.
fn response_note(keep_time: bool, part: &SourcePart, records: &Bodies, options: &Compute) -> String {
    let response = part.source.snapshot.meta.primary_response;
    let responds = options.fields.iter().any(ExternalField::has_response);
    let (Some(response), true) = (response, keep_time && responds && !keeps_orbit(part, records, options)) else {
        return String::new();
    };
    let distance = response.displacement.iter().map(|x| x * x).sum::<f64>().sqrt();
    format!(
        "fields: the primary that responds begins on its orbit, {} m from its position in the run; it continues with the \
         same bodies, densities and fields\n",
        short_number(distance)
    )
}

/// Errors with the faults found so far, if there are any.
fn reject_faults(report: &mut FaultReport) -> Result<(), Faults> {
    std::mem::take(&mut report.faults).into_result(())
}

/// Changes and the settings of the command line.
struct ChangeRequest {
    changes: Changes,
    /// Text of the file with the settings applied.
    text: String,
    /// Settings of options, which apply to the options of the first case if the changes have no options.
    option_settings: Vec<String>,
}

impl ChangeRequest {
    /// Reads the text of `file`. Without `bodies` all bodies of the case are selected.
    fn read(file: &Path, text: &str, settings: &[String]) -> Result<ChangeRequest, Faults> {
        let (option_settings, others): (Vec<String>, Vec<String>) =
            settings.iter().cloned().partition(|setting| setting.trim_start().starts_with("compute."));
        let (mut changes, mut text) = parse_changes(file, text, &others)?;
        if changes.compute.is_some() {
            (changes, text) = parse_changes(file, &text, &option_settings)?;
        }
        if changes.bodies.is_empty() {
            changes.bodies.push(Selection::default());
        }
        Ok(ChangeRequest { changes, text, option_settings })
    }

    /// Whether options differ from the options of the first case.
    fn sets_options(&self) -> bool {
        self.changes.compute.is_some() || !self.option_settings.is_empty()
    }

    /// Whether the events of the first case that are still to come stay in the next run.
    fn keeps_events(&self) -> bool {
        self.changes.keep_time && self.changes.compute.is_none()
    }

    /// Options of the next run: the options of the changes, or of the first case with the settings. A deforming cell has the
    /// lengths of that of the case, unless the options have others, which is an error.
    fn next_options(&self, file: &Path, case: &SourceCase, report: &mut FaultReport) -> Result<Compute, Faults> {
        let mut options = self.options_without_cell(file, &case.options, report)?;
        if let Some(cell) = &case.cell {
            fit_periods(&mut options, cell, report);
        }
        // Not checked before: its periods may have been those of the case.
        if self.changes.compute.as_ref().is_some_and(has_open_cell) {
            options.check_in(report, "compute.");
        }
        Ok(options)
    }

    /// Deforming cell of the only case, if its bodies stay as they are in a cell of the next run; the bodies of other cells leave
    /// these.
    fn continue_cells(
        &self,
        options: &Compute,
        sources: &mut [SourceCase],
        report: &mut FaultReport,
    ) -> Option<CellState> {
        let Changes { bodies, grains, walls, keep_time, .. } = &self.changes;
        let is_whole = bodies.len() == 1 && bodies[0].keeps_motion() && grains.is_empty() && walls.is_empty();
        if let (true, Some(control), [source]) = (is_whole, &options.cell, &mut *sources) {
            return source.continue_cell(control, *keep_time);
        }
        for source in sources.iter_mut() {
            report.faults.gather_result(source.leave_cell());
        }
        None
    }

    /// Options of the next run without regard to the cell of the case.
    fn options_without_cell(
        &self,
        file: &Path,
        case_options: &Compute,
        report: &mut FaultReport,
    ) -> Result<Compute, Faults> {
        if let Some(options) = &self.changes.compute {
            return Ok(options.clone());
        }
        let end_time = case_options.end_time.filter(|_| self.keeps_events());
        let options = Compute { steps: None, end_time, ..case_options.clone() };
        if self.option_settings.is_empty() {
            return Ok(options);
        }
        let (set, _) = parse_changes(file, &format!("(compute: {})", options.to_text()), &self.option_settings)?;
        let options = set.compute.unwrap_or(options);
        options.check_in(report, "compute.");
        Ok(options)
    }
}

/// Whether options have a cell that deforms without a period along some axis.
fn has_open_cell(options: &Compute) -> bool {
    options.cell.is_some() && options.periods().contains(&None)
}

/// Largest relative difference of a period from the length of a cell that counts as rounding of files.
const PERIOD_ROUNDING: f64 = 1e-6;

/// Gives the options the current lengths of the `cell` of the case. A deforming cell with a period of another length is an error;
/// without a deforming cell, a period of another length, or none along all axes, causes a warning.
fn fit_periods(options: &mut Compute, cell: &CellState, report: &mut FaultReport) {
    let deforms = options.cell.is_some();
    let periods = [&mut options.xperiode, &mut options.yperiode, &mut options.zperiode];
    if !deforms && periods.iter().all(|period| period.is_none()) {
        let advice = "write xperiode, yperiode or zperiode if grains still have images there";
        report.add_warning("compute", "no periods, of a run with a deforming cell", advice);
    }
    for ((name, period), length) in PERIOD_NAMES.into_iter().zip(periods).zip(cell.periods) {
        match *period {
            None if deforms => *period = Some(length),
            Some(given) if (given / length - 1.0).abs() <= PERIOD_ROUNDING => *period = Some(length),
            Some(given) => {
                let path = format!("compute.{name}");
                let found = format!("{} m; the cell of the case is {} m long", number_text(given), number_text(length));
                match deforms {
                    true => report.add_fault(&path, found, "none, for the present length of the cell"),
                    false => report.add_warning(&path, found, "are gaps or overlaps at the border meant?"),
                }
            }
            None => {}
        }
    }
}

/// Parses changes with settings applied; returns them with their text.
fn parse_changes(file: &Path, text: &str, settings: &[String]) -> Result<(Changes, String), Faults> {
    let text = apply_settings(text, settings)?;
    Ok((parse_with_settings(file, &text, settings, "changes")?, text))
}

/// Reads the cases from which bodies are selected, with the densities of the changes. `folder`: folder of the
/// changes; `dir`: folder of the next run.
fn read_sources(
    request: &ChangeRequest,
    case: &Path,
    folder: &Path,
    dir: &Path,
    report: &mut FaultReport,
) -> Vec<SourceCase> {
    let mut sources = Vec::new();
    for selection in &request.changes.bodies {
        let case = selection.case.as_ref().map_or(case.to_path_buf(), |case| folder.join(case));
        if let Ok(true) = fs::canonicalize(&case).and_then(|source| Ok(source == fs::canonicalize(dir)?)) {
            let expected = "expected a folder other than those of the cases that are read";
            report.faults.push(Fault::new(dir, None, "folder", "is the case itself", expected));
        }
        sources.extend(report.faults.gather_result(SourceCase::read(&case, selection.snapshot)));
    }
    if !request.keeps_events() {
        sources.iter_mut().for_each(SourceCase::end_events);
    }
    sources.iter_mut().for_each(|source| source.set_densities(&request.changes.materials));
    sources
}

/// Selects and moves the bodies of each case.
fn select_parts<'a>(changes: &Changes, sources: &'a [SourceCase], report: &mut FaultReport) -> Vec<SourcePart<'a>> {
    let mut parts = Vec::new();
    for (k, (source, selection)) in sources.iter().zip(&changes.bodies).enumerate() {
        match source.select_bodies(selection) {
            Ok(part) => parts.push(part),
            Err(faults) => {
                for (path, fault) in faults {
                    let path = format!("bodies.{k}.{path}");
                    report.add_fault_with_phrase(path.trim_end_matches('.'), fault.found, fault.expected);
                }
            }
        }
    }
    parts
}

/// Rejects rotations of whole parts that periods do not allow.
fn check_rotations(changes: &Changes, options: &Compute, report: &mut FaultReport) {
    for (k, selection) in changes.bodies.iter().enumerate() {
        let may_rotate =
            selection.remove_motion != MotionRemoval::RigidMotion || options.allows_rotation_about(&[1.0; 3]);
        report.require(may_rotate, &format!("bodies.{k}.remove_motion"), "RigidMotion", ROTATION_ABOUT_PERIOD);
        report.require(
            options.allows_rotation_about(&selection.spin),
            &format!("bodies.{k}.spin"),
            vector_text(&selection.spin),
            ROTATION_ABOUT_PERIOD,
        );
    }
}

/// Rejects an end before the time of the state from which the run continues, as cd-solve does.
fn check_end(request: &ChangeRequest, state: &SnapshotMeta, options: &Compute, report: &mut FaultReport) {
    let end = options.end_time.filter(|_| request.changes.keep_time && options.steps.is_none());
    // A run passes its end by less than a step, with the tolerance of `Compute::last_step`.
    if let Some(end) = end.filter(|end| state.time - end > (1.0 - 1e-3) * options.dt.max(state.h)) {
        let found = format!("{} s is before the state, which keep_time continues", number_text(end));
        report.add_fault("compute.end_time", found, format!("at least {} s", number_text(state.time)));
    }
}

/// Merges the materials, laws and visibility of the cases and the changes; reports faults and doubts about them, and options
/// that do not suit them.
fn behaviour_tables(
    request: &ChangeRequest,
    parts: &[SourcePart],
    new: &NewBodies,
    records: &Bodies,
    options: &Compute,
    report: &mut FaultReport,
) -> BehaviourTables {
    let changes = &request.changes;
    if request.sets_options() {
        cd_formats::doubts::events(&options.events, "compute.", report);
        let state = &parts[0].source.snapshot.meta;
        let start = if changes.keep_time { (state.step, state.time) } else { (0, 0.0) };
        cd_formats::doubts::late_events(options, start, "compute.", report);
    }
    crate::doubts::report_doubts(&changes.materials, &changes.laws, &changes.grains, &changes.walls, report);
    for (k, selection) in changes.bodies.iter().enumerate() {
        crate::doubts::check_angle(report, &format!("bodies.{k}.rotate"), &selection.rotate);
    }
    let source_records = records.0.iter().take(parts.iter().map(|part| part.records.len()).sum());
    let source_contactors = source_records.flat_map(|body| &body.contactors);
    let source_plates = source_contactors.filter(|contactor| contactor.shape.type_name() == "PLANx");
    let plate_colours = source_plates.map(|plate| plate.colour.as_str());
    crate::doubts::report_plate_presses(&changes.walls, plate_colours, &changes.contacts, report);
    let tables = BehaviourTables::from_parts(changes, parts, &new.population.grains, records, report);
    let is_used = |name: &str| tables.tact.visibility.iter().any(|row| row.law == name);
    crate::doubts::report_unused_laws(&changes.laws, is_used, report);
    if request.sets_options() {
        tables.check_events(&options.events, report);
    }
    tables.check_solver(options.solver, report);
    let has_partly_driven = |(_, part): &(usize, &SourcePart)| {
        part.state.bodies.body_driven.iter().any(|imposed| (1..DRIVEN_ALL).contains(imposed))
    };
    let source_paths = (0..).zip(parts).filter(has_partly_driven).map(|(k, _)| format!("bodies.{k}"));
    let new_paths = crate::check::partly_driven_paths(&changes.grains, &changes.walls);
    crate::check::check_rotating_frame(report, options, source_paths.chain(new_paths));
    tables
}

/// Line of the summary about the bodies of a case.
fn part_summary(part: &SourcePart) -> String {
    let SourceCase { case, snapshot, bodies, .. } = part.source;
    format!(
        "{}: step {}, t = {} s, {} of {} bodies, {} contacts\n",
        case.display(),
        snapshot.meta.step,
        rounded_number(snapshot.meta.time),
        part.source_bodies.len(),
        bodies.0.len(),
        part.state.contacts.contact_body.len()
    )
}

/// Checks all of a file of changes that needs no run. Errors: as of [`read`].
pub fn check_file(file: &Path) -> Result<(), Faults> {
    read(file, &atomic::read_text(file)?, &[]).map(drop)
}

/// Reads the changes in `text` and checks all that needs no run.
///
/// Errors: texts and values that are no changes. Faults name the file `source`, or the setting for values from `settings`.
pub fn read(source: &Path, text: &str, settings: &[String]) -> Result<Changes, Faults> {
    let changes: Changes = parse_with_settings(source, text, settings, "changes")?;
    let mut report = FaultReport::with_settings(source, text, settings);
    check_changes(&changes, &mut report);
    report.faults.into_result(changes)
}

/// Checks the values of the changes that need no run.
fn check_changes(changes: &Changes, report: &mut FaultReport) {
    for (k, selection) in changes.bodies.iter().enumerate() {
        let path = format!("bodies.{k}");
        check_vector(report, &format!("{path}.velocity"), &selection.velocity, "m/s");
        check_vector(report, &format!("{path}.spin"), &selection.spin, "rad/s");
        check_vector(report, &format!("{path}.centre"), &selection.centre.unwrap_or_default(), "m");
        crate::check::check_rotation(report, &format!("{path}.rotate"), &selection.rotate);
        if let Some(colour) = &selection.colour {
            crate::check::check_name_length(report, &format!("{path}.colour"), colour);
        }
    }
    for (k, grains) in changes.grains.iter().enumerate() {
        let path = format!("grains.{k}");
        crate::check::check_name_length(report, &format!("{path}.colour"), &grains.colour);
        crate::check::check_grains(report, &path, grains);
    }
    for (k, wall) in changes.walls.iter().enumerate() {
        let path = format!("walls.{k}");
        crate::check::check_name_length(report, &format!("{path}.colour"), wall.colour());
        crate::check::check_wall(report, &path, wall);
        let has_radial = matches!(wall, SceneWall::Cylinder { radial: Some(_), .. });
        report.require(!has_radial, &format!("{path}.radial"), "of a new wall", "a row of compute.radii");
    }
    crate::check::check_names(report, "materials", changes.materials.iter().map(|material| &material.name));
    for (k, material) in changes.materials.iter().enumerate() {
        let path = format!("materials.{k}.density");
        crate::check::check_positive(report, &path, material.density, "a density > 0 kg/m^3");
    }
    crate::check::check_names(report, "laws", changes.laws.iter().map(|law| &law.name));
    for (k, law) in changes.laws.iter().enumerate() {
        crate::check::check_law(report, &format!("laws.{k}"), law);
    }
    if let Some(compute) = changes.compute.as_ref().filter(|compute| !has_open_cell(compute)) {
        compute.check_in(report, "compute.");
    }
}

/// Bodies that come from no run, such as an impactor, as a scene of their own.
struct NewBodies {
    scene: Scene,
    population: Population,
}

impl NewBodies {
    /// Places the new bodies and reports those that cannot be placed.
    fn from_changes(
        changes: &Changes,
        parts: &[SourcePart],
        options: &Compute,
        folder: &Path,
        report: &mut FaultReport,
    ) -> NewBodies {
        let source_materials = parts.iter().flat_map(|part| &part.source.bulk.materials);
        let source_materials =
            source_materials.map(|material| Material { name: material.name.clone(), density: material.density });
        let scene = Scene {
            seed: changes.seed,
            gravity: [0.0; 3],
            // The first material of a name counts.
            materials: changes.materials.iter().cloned().chain(source_materials).collect(),
            laws: Vec::new(),
            contacts: Vec::new(),
            grains: changes.grains.clone(),
            walls: changes.walls.clone(),
            compute: options.clone(),
        };
        let population = populate(&scene, folder, report);
        NewBodies { scene, population }
    }
}

/// Bodies in the order of their new numbers: the bodies of each part, then the new ones.
fn body_records(parts: &[SourcePart], new: &NewBodies) -> Bodies {
    let new = write::bodies_file(&new.scene, &new.population).0;
    Bodies(parts.iter().flat_map(|part| part.records.iter().cloned()).chain(new).collect())
}

/// Content of DATBOX as far as it is computed for all bodies together.
struct DatboxContent<'a> {
    records: &'a Bodies,
    tables: &'a BehaviourTables,
    driven: &'a DrvDof,
    options: &'a Compute,
    /// Whether steps are those of the source: with its `theta` and `cell`, and between bodies that touched each other there.
    keeps_steps: bool,
    /// Deforming cell of the run that is continued, if the bodies keep it.
    cell: Option<CellState>,
}

/// Whether bodies have the positions, orientations and velocities of others, in all bits.
fn has_motion_of(bodies: &BodyArrays, others: &BodyArrays) -> bool {
    bodies.body_x == others.body_x
        && bodies.body_q == others.body_q
        && bodies.body_v == others.body_v
        && bodies.body_w_world == others.body_w_world
}

/// Files of DATBOX. `keep_time`: whether step and time continue from the first part.
fn datbox_files(keep_time: bool, parts: &[SourcePart], new: &NewBodies, content: DatboxContent) -> Vec<File> {
    let DatboxContent { records, tables, driven, options, keeps_steps, cell } = content;
    let mut start = Snapshot { meta: parts[0].source.snapshot.meta.clone(), ..Snapshot::default() };
    start.meta.cell = cell;
    start.meta.counted_from = keep_time.then_some(parts[0].source.counted_from);
    if !keep_time {
        (start.meta.step, start.meta.time) = (0, 0.0);
    }
    start.meta.program = format!("cd-pre {}", env!("CARGO_PKG_VERSION"));
    // The remaining penetration is the only running sum that time steps need.
    let penetration_left =
        parts.iter().map(|part| part.source.snapshot.meta.ledger.penetration_left).fold(0.0, f64::max);
    start.meta.ledger = Ledger { penetration_left, ..Ledger::default() };
    start.meta.interval_start = None;
    start.meta.parameters.events_done = 0;
    start.meta.attraction = None;
    start.meta.revolutions = Vec::new();
    let source = parts[0].source;
    let keeps_bodies = parts[0].is_whole_run(records.0.len());
    if !(keep_time && keeps_orbit(&parts[0], records, options)) {
        start.meta.primary_response = None;
    }
    let mut origin = String::from("body,case,step,number\n");
    let mut bodies = Vec::new();
    for part in parts {
        let first = bodies.len();
        part.append_to(&mut start, first);
        for (k, source_body) in part.source_bodies.iter().enumerate() {
            let (body, step) = (first + k, part.source.snapshot.meta.step);
            origin += &format!("{},{},{step},{}\n", body + 1, csv_quoted(&part.source.case), source_body.index() + 1);
            bodies.push(part.dof_record(k, body));
        }
    }
    for state in write::dof_file(&new.population).bodies {
        let body = bodies.len();
        origin += &format!("{},,,\n", body + 1);
        bodies.push(BodyDof { body, ..state });
    }
    start.meta.continues_run =
        keeps_bodies && keeps_steps && !source.is_first && has_motion_of(&start.bodies, &source.snapshot.bodies);
    let dof = Dof { step: start.meta.step, time: start.meta.time, bodies };
    let mut files: Vec<File> = [
        ("BODIES.DAT", records.to_long_text()),
        ("BULK_BEHAV.DAT", tables.bulk.to_long_text()),
        ("TACT_BEHAV.DAT", tables.tact.to_long_text()),
        ("DRV_DOF.DAT", driven.to_long_text()),
        ("DOF.INI", dof.to_text()),
        ("Vloc_Rloc.INI", VlocRloc { step: dof.step, time: dof.time, contacts: Vec::new() }.to_text()),
        ("COMPUTE.RON", options.to_text()),
        (ORIGIN_FILE, origin),
    ]
    .map(|(name, text)| (name.to_string(), text.into_bytes()))
    .into();
    let mut table_names: Vec<&str> = Vec::new();
    for row in &driven.0 {
        if let Evolution::Table { name, points } = &row.evolution
            && !table_names.contains(&name.as_str())
        {
            table_names.push(name);
            files.push((name.clone(), table_text(points).into_bytes()));
        }
    }
    files.push((START_FILE.to_string(), start.to_bytes()));
    files
}

/// A path as a field of a CSV file.
fn csv_quoted(path: &Path) -> String {
    let text = path.display().to_string();
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}

/// Imposed motion of the bodies, under their new numbers; equal tables share a file.
fn driven_components(parts: &[SourcePart], new: &NewBodies) -> DrvDof {
    let (mut rows, mut first_body) = (Vec::new(), 0);
    for part in parts {
        for row in &part.source.driven.0 {
            let Ok(k) = part.source_bodies.binary_search(&BodyId::new(row.body)) else { continue };
            rows.push(DrivenComponent { body: first_body + k, ..row.clone() });
        }
        first_body += part.source_bodies.len();
    }
    let (new_rows, _) = write::drv_dof(&new.scene, &new.population);
    rows.extend(new_rows.0.into_iter().map(|row| DrivenComponent { body: first_body + row.body, ..row }));
    let mut tables = Vec::<Vec<[f64; 2]>>::new();
    for row in &mut rows {
        if let Evolution::Table { name, points } = &mut row.evolution {
            let index = tables.iter().position(|known| known == points).unwrap_or_else(|| {
                tables.push(points.clone());
                tables.len() - 1
            });
            *name = format!("evolution-{}.dat", index + 1);
        }
    }
    rows.sort_by_key(|row| row.body);
    DrvDof(rows)
}
