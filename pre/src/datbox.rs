//! DATBOX of a scene.

use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};
use cd_formats::origin::SceneOrigin;
use cd_formats::report::FaultReport;
use cd_formats::ron_file;
use cd_formats::settings::{apply_settings, check_paths_once};
use cd_formats::sinks_and_sources::set_random_orders;

use crate::datbox_folder::{FROM_OUTBOX_FILES, lock_datbox, write_files};
use crate::grain::Population;
use crate::parse::parse_with_settings;
use crate::radial::check_radial_rates;
use crate::scene::{Law, Scene, models};
use crate::summary::{print_warnings, scene_summary};
use crate::{attraction, check, doubts, field_surfaces, population, reread, write};

/// Reads the scene of the file `source`, in which `settings` override values, and writes the files of the folder
/// `datbox`; see [`apply_settings`].
///
/// Returns a summary for people. Errors: all faults of the scene (nothing is written then), or a file
/// that cannot be written.
pub fn write_datbox(source: &Path, settings: &[String], datbox: &Path) -> Result<String, Faults> {
    check_paths_once(settings)?;
    if source.is_dir() {
        let (scene, found) = (source.join("scene.ron"), "is a folder");
        let expected =
            if scene.is_file() { format!("did you mean {}?", scene.display()) } else { "expected a scene".into() };
        return Err(Fault::new(source, None, "file", found, expected).into());
    }
    let original = atomic::read_text(source)?;
    let text = apply_settings(&original, settings)?;
    let (mut scene, population, warnings) = scene_with_warnings(source, &text, settings)?;
    let mut report = FaultReport::with_settings(source, &text, settings);
    report.warnings = ron_file::former_name_warnings(source, &original, settings);
    report.warnings.0.extend(warnings.0);
    doubts::report_doubts(&scene.materials, &scene.laws, &scene.grains, &scene.walls, &mut report);
    doubts::report_orbit_doubts(&scene.grains, &scene.compute.fields, &mut report);
    doubts::report_plate_presses(&scene.walls, std::iter::empty(), &scene.contacts, &mut report);
    let is_used = |name: &str| scene.contacts.iter().any(|contact| contact.law.as_deref() == Some(name));
    // A scene has at least one law, also if no bodies touch each other.
    if scene.laws.len() > 1 {
        doubts::report_unused_laws(&scene.laws, is_used, &mut report);
    }
    cd_formats::doubts::events(&scene.compute.events, "compute.", &mut report);
    cd_formats::doubts::late_events(&scene.compute, (0, 0.0), "compute.", &mut report);
    attraction::warn_of_attractions(&scene, &population, &mut report);
    let folder = source.parent().unwrap_or(Path::new(""));
    let surfaces: Vec<PathBuf> = field_surfaces::surface_names(&scene.compute).map(|name| folder.join(name)).collect();
    let surface_files = report.faults.gather_result(field_surfaces::take_surfaces(&mut scene.compute, folder, false));
    let mut files = write::datbox_files(&scene, &population);
    files.extend(surface_files.unwrap_or_default());
    let (driven, _) = write::drv_dof(&scene, &population);
    let bytes = files.iter().map(|(name, text)| (name.as_str(), text.as_bytes()));
    reread::check_files(datbox, bytes, &driven, &scene.compute, |body| population.scene_path(body), &mut report);
    if !report.faults.0.is_empty() {
        return Err(report.faults);
    }
    // The folder must exist before paths of the scene relative to DATBOX can be found.
    let _lock = lock_datbox(datbox)?;
    let case = datbox.parent().unwrap_or(Path::new(""));
    let mut origin = SceneOrigin::from_scene(source, original.as_bytes(), settings, case);
    if let Some(origin) = &mut origin {
        models(&scene.grains, &scene.walls).for_each(|file| origin.add(&folder.join(file), case));
        surfaces.iter().for_each(|file| origin.add(file, case));
    }
    for (_, text) in files.iter_mut().filter(|(name, _)| name == write::COMPUTE_FILE) {
        text.insert_str(0, &origin.as_ref().map_or(String::new(), SceneOrigin::lines));
    }
    write_files(datbox, files.iter().map(|(name, text)| (name.as_str(), text.as_bytes())), &FROM_OUTBOX_FILES)?;
    print_warnings(&report.warnings);
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    Ok(format!("{}wrote {}: {}\n", scene_summary(&scene, &population), datbox.display(), names.join(" ")))
}

/// Reads the scene in `text` and makes its bodies.
///
/// Errors: texts and values that make no scene, and bodies that cannot be placed. Faults name the file `source`, or the
/// setting for values from `settings`.
pub fn read_scene(source: &Path, text: &str, settings: &[String]) -> Result<(Scene, Population), Faults> {
    scene_with_warnings(source, text, settings).map(|(scene, population, _)| (scene, population))
}

/// Scene and bodies as in [`read_scene`], and warnings of repairs of its files.
fn scene_with_warnings(source: &Path, text: &str, settings: &[String]) -> Result<(Scene, Population, Faults), Faults> {
    let mut scene: Scene = parse_with_settings(source, text, settings, "scene")?;
    let mut report = FaultReport::with_settings(source, text, settings);
    check::check_scene(&scene, &mut report);
    if !report.faults.0.is_empty() {
        return Err(report.faults);
    }
    scene.laws.iter_mut().for_each(Law::apply_bulk_strength);
    set_random_orders(&mut scene.compute.sources, scene.seed);
    let population = population::populate(&scene, source.parent().unwrap_or(Path::new("")), &mut report);
    population::check_strain_rates(&population.walls, &mut report);
    check_radial_rates(&scene, &population, &mut report);
    let warnings = std::mem::take(&mut report.warnings);
    report.faults.into_result((scene, population, warnings))
}
