//! `cd-pre from-outbox CASE DIR`: converts the state of one run to the DATBOX of the next.
//!
//! | module | |
//! |---|---|
//! | [`mod@changes`] | contents of the file of changes |
//! | [`digits`] | numbers with more digits than DATBOX can hold |
//! | `overlaps` | overlaps of bodies of different origin |
//! | [`options`] | options of a run, as recorded in its snapshot |
//! | [`source`] | a case with one of its snapshots; selection and motion of its bodies |
//! | [`tables`] | merged materials, laws and visibility of several cases |
//!
//! `docs/reference/from-outbox.md` describes [`Changes`] for users.

pub mod changes;
pub mod digits;
pub mod options;
mod overlaps;
pub mod source;
pub mod tables;

use std::fs;
use std::path::{Path, PathBuf};

use cd_formats::atomic::{self, path_exists};
use cd_formats::bodies::Bodies;
use cd_formats::compute::{Compute, ROTATION_ABOUT_PERIOD};
use cd_formats::dof::{BodyDof, Dof};
use cd_formats::drv_dof::{DrivenComponent, DrvDof, Evolution, table_text};
use cd_formats::error::{Fault, Faults};
use cd_formats::ids::BodyId;
use cd_formats::names::count_text;
use cd_formats::origin::SceneOrigin;
use cd_formats::report::FaultReport;
use cd_formats::ron_file;
use cd_formats::settings::apply_settings;
use cd_formats::snapshot::{self, Ledger, START_FILE, Snapshot};
use cd_formats::vloc_rloc::VlocRloc;

use crate::check::check_vector;
use crate::grain::Population;
use crate::parse::parse_with_settings;
use crate::population::populate;
use crate::reread;
use crate::scene::{self, Material, Scene};
use crate::summary::{group_lines, print_warnings};
use crate::write;
pub use changes::{BodyFilter, Changes, MotionRemoval, Selection, WallSelector};
use source::{SourceCase, SourcePart};
use tables::BehaviourTables;

/// File in DATBOX that records the origin of each body.
pub const ORIGIN_FILE: &str = "ORIGIN.csv";

/// A file of DATBOX: name and bytes.
type File = (String, Vec<u8>);

/// Makes `dir/DATBOX` from a snapshot of `case` and the file `changes`, whose values `settings` override, see
/// [`apply_settings`]. Returns a summary for people.
///
/// Errors: all faults of the file and of the cases that it names; nothing is written then.
pub fn write_datbox(case: &Path, changes: Option<&Path>, settings: &[String], dir: &Path) -> Result<String, Faults> {
    let changes_file = changes;
    let (file, text) = match changes_file {
        Some(file) => (file, atomic::read_text(file)?),
        None => (Path::new("changes"), "()".to_string()),
    };
    let former_names = ron_file::former_name_warnings(file, &text, settings);
    let parsed = |text: &str, settings: &[String]| -> Result<(Changes, String), Faults> {
        let text = apply_settings(text, settings)?;
        Ok((parse_with_settings(file, &text, settings, "changes")?, text))
    };
    // `--set` of options that the file does not have changes those of the first case.
    let (of_run, others): (Vec<String>, Vec<String>) =
        settings.iter().cloned().partition(|setting| setting.trim_start().starts_with("compute."));
    let (mut changes, mut text) = parsed(&text, &others)?;
    if changes.compute.is_some() {
        (changes, text) = parsed(&text, &of_run)?;
    }
    if changes.bodies.is_empty() {
        changes.bodies.push(Selection::default());
    }
    let mut report = FaultReport::with_settings(file, &text, settings);
    report.warnings = former_names;
    check_changes(&changes, &mut report);
    let folder = file.parent().unwrap_or(Path::new(""));
    let cases: Vec<PathBuf> =
        changes.bodies.iter().map(|t| t.case.as_ref().map_or(case.to_path_buf(), |c| folder.join(c))).collect();
    let mut sources = Vec::new();
    let events_go_on = changes.keep_time && changes.compute.is_none();
    for (taken, case) in changes.bodies.iter().zip(&cases) {
        if let Ok(true) = fs::canonicalize(case).and_then(|from| Ok(from == fs::canonicalize(dir)?)) {
            let expected = "expected a folder other than those of the cases that are read";
            report.faults.push(Fault::new(dir, None, "folder", "is the case itself", expected));
        }
        sources.extend(report.faults.gather_result(SourceCase::read(case, taken.snapshot)));
    }
    if !events_go_on {
        sources.iter_mut().for_each(SourceCase::end_events);
    }
    sources.iter_mut().for_each(|source| source.set_densities(&changes.materials));
    if !report.faults.0.is_empty() {
        return Err(report.faults);
    }
    let mut parts = Vec::new();
    for (k, (source, taken)) in sources.iter().zip(&changes.bodies).enumerate() {
        match source.select_bodies(taken) {
            Ok(part) => parts.push(part),
            Err(fault) => report.fault_as(&format!("bodies.{k}"), fault.found, fault.expected),
        }
    }
    if !report.faults.0.is_empty() {
        return Err(report.faults);
    }
    let mut options = changes.compute.clone().unwrap_or_else(|| {
        let known = &sources[0].options;
        Compute { steps: None, end_time: known.end_time.filter(|_| events_go_on), ..known.clone() }
    });
    if let (None, false) = (&changes.compute, of_run.is_empty()) {
        let (set, _) = parsed(&format!("(compute: {})", options.to_text()), &of_run)?;
        options = set.compute.unwrap_or(options);
        options.check_in(&mut report, "compute.");
        if !report.faults.0.is_empty() {
            return Err(report.faults);
        }
    }
    for (k, taken) in changes.bodies.iter().enumerate() {
        let turns = taken.remove_motion != MotionRemoval::RigidMotion || options.allows_rotation_about(&[1.0; 3]);
        report.require(turns, &format!("bodies.{k}.remove_motion"), "RigidMotion", ROTATION_ABOUT_PERIOD);
        report.require(
            options.allows_rotation_about(&taken.spin),
            &format!("bodies.{k}.spin"),
            format!("{:?}", taken.spin),
            ROTATION_ABOUT_PERIOD,
        );
    }
    let new = NewBodies::from_changes(&changes, &parts, &options, folder, &mut report);
    let records = body_records(&parts, &new);
    overlaps::check_overlaps(&changes, &parts, &new.population, &records, &options, &mut report);
    if changes.compute.is_some() || !of_run.is_empty() {
        cd_formats::doubts::events(&options.events, "compute.", &mut report);
    }
    crate::doubts::report_doubts(&changes.materials, &changes.laws, &changes.grains, &changes.walls, &mut report);
    let tables = BehaviourTables::from_parts(&changes, &parts, &new.population.grains, &records, &mut report);
    let is_used = |name: &str| tables.tact.visibility.iter().any(|row| row.law == name);
    crate::doubts::report_unused_laws(&changes.laws, is_used, &mut report);
    if changes.compute.is_some() || !of_run.is_empty() {
        tables.check_events(&options.events, &mut report);
    }
    tables.check_solver(options.solver, &mut report);
    // Bits of the imposed components; 63 is all.
    let in_part = |part: &SourcePart| part.state.bodies.body_driven.iter().any(|imposed| (1..63).contains(imposed));
    let of_parts = (0..).zip(&parts).filter(|(_, part)| in_part(part)).map(|(k, _)| format!("bodies.{k}"));
    let of_new = crate::check::driven_in_part(&changes.grains, &changes.walls);
    crate::check::check_turning(&mut report, &options, of_parts.chain(of_new));
    if !report.faults.0.is_empty() {
        return Err(report.faults);
    }

    let datbox = dir.join("DATBOX");
    let driven = driven_components(&parts, &new);
    overlaps::check_drums(&parts, &new.population, &records, &tables.tact, &driven, &mut report);
    let mut files = datbox_files(&changes, &parts, &new, &records, &tables, &driven, &options);
    let mut owner: Vec<usize> = Vec::new();
    parts.iter().enumerate().for_each(|(k, part)| owner.extend(std::iter::repeat_n(k, part.source_bodies.len())));
    let name = |body: usize| match owner.get(body) {
        Some(part) => format!("bodies.{part}"),
        None => new.population.scene_path(body - owner.len()),
    };
    let bytes = files.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice()));
    reread::check_files(&datbox, bytes, &driven, &options, name, &mut report);
    if !report.faults.0.is_empty() {
        return Err(report.faults);
    }
    fs::create_dir_all(&datbox).map_err(|error| Fault::from_io(&datbox, "written", &error))?;
    let mut origin = SceneOrigin::from_outbox(case, changes_file, settings, dir);
    changes_file.into_iter().for_each(|file| origin.add(file, dir));
    scene::models(&changes.grains).for_each(|model| origin.add(&folder.join(model), dir));
    for part in &parts {
        origin.add(&snapshot::snapshot_path(&part.source.case.join("OUTBOX"), part.source.snapshot.meta.step), dir);
    }
    for (_, bytes) in files.iter_mut().filter(|(name, _)| name == write::COMPUTE_FILE) {
        bytes.splice(..0, origin.lines().into_bytes());
    }
    atomic::write_all(files.iter().map(|(name, bytes)| (datbox.join(name), bytes.as_slice())))?;
    print_warnings(&report.warnings);
    let mut summary = String::new();
    for part in &parts {
        let (step, time) = (part.source.snapshot.meta.step, part.source.snapshot.meta.time);
        summary += &format!(
            "{}: step {step}, t = {time} s, {} of {} bodies, {} contacts\n",
            part.source.case.display(),
            part.source_bodies.len(),
            part.source.bodies.0.len(),
            part.state.contacts.contact_body.len()
        );
    }
    summary += &sources[0].run_notes(Some(&options).filter(|_| changes.compute.is_none()));
    let taken: usize = parts.iter().map(|part| part.source_bodies.len()).sum();
    summary += &digits::lost_digits(&records.0[..taken], &tables, &driven);
    summary += &group_lines(&new.scene, &new.population);
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    summary += &format!("{}; wrote {}: {}\n", count_text(records.0.len(), "body"), datbox.display(), names.join(" "));
    Ok(summary)
}

/// Reads the changes in `text` and checks all that needs no run. Faults name the file `source`, or the setting for values
/// from `settings`.
pub fn read(source: &Path, text: &str, settings: &[String]) -> Result<Changes, Faults> {
    let changes: Changes = parse_with_settings(source, text, settings, "changes")?;
    let mut report = FaultReport::with_settings(source, text, settings);
    check_changes(&changes, &mut report);
    report.faults.into_result(changes)
}

/// Removes the files that only `from-outbox` writes and that would be misread with another scene.
pub fn remove_outbox_files(datbox: &Path) -> Result<(), Faults> {
    for path in [datbox.join(START_FILE), datbox.join(ORIGIN_FILE)].iter().filter(|path| path_exists(path)) {
        fs::remove_file(path).map_err(|error| Fault::from_io(path, "removed", &error))?;
    }
    Ok(())
}

fn check_changes(changes: &Changes, report: &mut FaultReport) {
    for (k, taken) in changes.bodies.iter().enumerate() {
        let path = format!("bodies.{k}");
        check_vector(report, &format!("{path}.velocity"), &taken.velocity, "m/s");
        check_vector(report, &format!("{path}.spin"), &taken.spin, "rad/s");
        check_vector(report, &format!("{path}.centre"), &taken.centre.unwrap_or_default(), "m");
        crate::check::check_rotation(report, &format!("{path}.rotate"), &taken.rotate);
        if let Some(colour) = &taken.colour {
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
    }
    crate::check::check_names(report, "materials", changes.materials.iter().map(|material| &material.name));
    for (k, material) in changes.materials.iter().enumerate() {
        let found = format!("{:?}", material.density);
        let path = format!("materials.{k}.density");
        report.require(crate::check::is_positive(material.density), &path, found, "a density > 0 kg/m^3");
    }
    crate::check::check_names(report, "laws", changes.laws.iter().map(|law| &law.name));
    for (k, law) in changes.laws.iter().enumerate() {
        crate::check::check_law(report, &format!("laws.{k}.kind"), &law.kind);
    }
    if let Some(compute) = &changes.compute {
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
        let known = parts.iter().flat_map(|part| &part.source.bulk.materials);
        let known = known.map(|known| Material { name: known.name.clone(), density: known.density });
        let scene = Scene {
            seed: changes.seed,
            gravity: [0.0; 3],
            // The first material of a name counts.
            materials: changes.materials.iter().cloned().chain(known).collect(),
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

/// Bodies in the order of their new numbers: those of each part, then the new ones.
fn body_records(parts: &[SourcePart], new: &NewBodies) -> Bodies {
    let new = write::bodies_file(&new.scene, &new.population).0;
    Bodies(parts.iter().flat_map(|part| part.records.iter().cloned()).chain(new).collect())
}

fn datbox_files(
    changes: &Changes,
    parts: &[SourcePart],
    new: &NewBodies,
    records: &Bodies,
    tables: &BehaviourTables,
    driven: &DrvDof,
    options: &Compute,
) -> Vec<File> {
    let mut start = Snapshot { meta: parts[0].source.snapshot.meta.clone(), ..Snapshot::default() };
    if !changes.keep_time {
        (start.meta.step, start.meta.time) = (0, 0.0);
    }
    start.meta.program = format!("cd-pre {}", env!("CARGO_PKG_VERSION"));
    // The remaining penetration is the only running sum that time steps need.
    let left = parts.iter().map(|part| part.source.snapshot.meta.ledger.penetration_left).fold(0.0, f64::max);
    start.meta.ledger = Ledger { penetration_left: left, ..Ledger::default() };
    start.meta.interval_start = None;
    start.meta.parameters.events_done = 0;
    start.meta.attraction = None;
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
    let mut written: Vec<&str> = Vec::new();
    for row in &driven.0 {
        if let Evolution::Table { name, points } = &row.evolution
            && !written.contains(&name.as_str())
        {
            written.push(name);
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
    let (mut all, mut first) = (Vec::new(), 0);
    for part in parts {
        for row in &part.source.driven.0 {
            let Ok(k) = part.source_bodies.binary_search(&BodyId::new(row.body)) else { continue };
            all.push(DrivenComponent { body: first + k, ..row.clone() });
        }
        first += part.source_bodies.len();
    }
    let (rows, _) = write::drv_dof(&new.scene, &new.population);
    all.extend(rows.0.into_iter().map(|row| DrivenComponent { body: first + row.body, ..row }));
    let mut tables = Vec::<Vec<[f64; 2]>>::new();
    for row in &mut all {
        if let Evolution::Table { name, points } = &mut row.evolution {
            let place = tables.iter().position(|known| known == points).unwrap_or_else(|| {
                tables.push(points.clone());
                tables.len() - 1
            });
            *name = format!("evolution-{}.dat", place + 1);
        }
    }
    all.sort_by_key(|row| row.body);
    DrvDof(all)
}
