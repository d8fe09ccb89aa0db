//! `cd-pre scene.ron`: reads a scene, places its grains and walls, and writes DATBOX.
//! `cd-pre from-outbox CASE DIR`: the state of one run becomes the DATBOX of the next.
//! `cd-pre study study.ron`: a folder with a scene for each combination of parameters.
//!
//! | module | |
//! |---|---|
//! | [`scene`] | contents of scene.ron |
//! | [`check`] | faults of a scene |
//! | [`doubts`] | values of a scene that are probably mistakes |
//! | [`attraction`] | warning about an attraction per contact point |
//! | [`sizes`] | radii of grains |
//! | [`shapes`] | polyhedra: hulls, solids at random, mass properties |
//! | [`place`] | positions of grains |
//! | [`motion`] | initial velocities |
//! | [`walls`] | plates and cylinders |
//! | [`population`] | all bodies of a scene, and checks of their overlaps |
//! | [`mod@write`] | the files of DATBOX |
//! | [`reread`] | check that cd-solve can read them |
//! | [`from_outbox`] | a DATBOX from the results of a run |
//! | [`study`] | scenes from a base and parameters |

pub mod attraction;
pub mod check;
pub mod doubts;
pub mod from_outbox;
pub mod motion;
pub mod place;
pub mod population;
pub mod random;
pub mod reread;
pub mod scene;
pub mod shapes;
pub mod sizes;
pub mod study;
pub mod walls;
pub mod write;

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::case::misplaced;
use cd_formats::compute::from_ron;
use cd_formats::error::{Fault, Faults};
use cd_formats::former_names;
use cd_formats::origin::SceneOrigin;
use cd_formats::places;
use cd_formats::report::FaultReport;
use cd_formats::ron_text::nearest_name;
use cd_formats::scan::{format_long14, fortran_real};
use cd_formats::tell::{print_error, print_line, usage};
use clap::{CommandFactory, Parser};
use nalgebra::{Matrix3, Rotation3, Vector3};

use population::Population;
use scene::Scene;
use serde::de::DeserializeOwned;

/// Converts a scene to DATBOX, the input of cd-solve.
///
/// A scene contains materials, contact laws, bodies of grains (sizes, positions, initial motion), walls and
/// the options of the run; docs/scene.md describes all fields. All errors of a scene are reported together,
/// and nothing is written then.
#[derive(Debug, Parser)]
#[command(name = "cd-pre", version, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// Scene, in RON.
    #[arg(value_name = "scene.ron", required = true)]
    scene: Option<PathBuf>,
    /// Folder in which DATBOX is written; default: that of the scene.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Replaces a value of the scene; PATH joins names of fields and positions in lists, counted from 1, by points, as in grains.1.number=2000. May be repeated.
    #[arg(long, value_name = "PATH=VALUE")]
    set: Vec<String>,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Makes DATBOX from a snapshot of another case, with its bodies, laws and contacts, bit for bit.
    ///
    /// A file of changes can select the largest remnant, move and rotate it, add bodies of other runs and new bodies,
    /// and set other laws and options; docs/from-outbox.md describes all fields.
    FromOutbox {
        /// Folder of the case, with DATBOX and OUTBOX.
        case: PathBuf,
        /// Folder in which the new DATBOX is written.
        dir: PathBuf,
        /// File of changes, in RON; default: no changes.
        #[arg(long, value_name = "changes.ron")]
        changes: Option<PathBuf>,
        /// Replaces a value of the changes, as in compute.dt=1. May be repeated.
        #[arg(long, value_name = "PATH=VALUE")]
        set: Vec<String>,
    },
    /// Writes a folder with a scene for each combination of parameters.
    ///
    /// A study contains a base scene, parameters with their paths and values, and a pattern for the names of the folders;
    /// docs/study.md describes all fields. All cases are checked first; if one has an error, nothing is written.
    Study {
        /// Study, in RON.
        #[arg(value_name = "study.ron")]
        study: PathBuf,
        /// Folder in which the folders of the cases are written; default: that of the study.
        #[arg(short, long, value_name = "DIR")]
        output: Option<PathBuf>,
        /// Replaces a value of the study, as in groups.1.seeds=[1,2,3]. May be repeated.
        #[arg(long, value_name = "PATH=VALUE")]
        set: Vec<String>,
    },
}

/// Runs the program; `args` as from [`std::env::args_os`], the program's name first.
///
/// Returns the exit code: 0 done, 2 input rejected (faults on stderr, no file written).
pub fn run(args: impl IntoIterator<Item = OsString>) -> i32 {
    let args: Vec<OsString> = args.into_iter().collect();
    let first = args.get(1).and_then(|first| first.to_str()).unwrap_or_default();
    let commands = Arguments::command();
    let commands: Vec<&str> = commands.get_subcommands().map(|command| command.get_name()).collect();
    let unknown = !commands.contains(&first) && !first.starts_with('-') && !Path::new(first).exists();
    if let Some(near) = nearest_name(first, &commands).filter(|_| unknown) {
        print_error(format_args!("cd-pre: {first}: is neither a file nor a command; did you mean {near}?"));
        return 2;
    }
    let arguments = match Arguments::try_parse_from(&args) {
        Ok(arguments) => arguments,
        Err(error) => {
            let mistake = misplaced(&Arguments::command(), &args).filter(|_| error.use_stderr());
            let Some(mistake) = mistake else { return usage("cd-pre", &error) };
            print_error(format_args!("cd-pre: {mistake}"));
            return error.exit_code();
        }
    };
    let written = match arguments.command {
        Some(Command::FromOutbox { case, dir, changes, set }) => {
            from_outbox::write_datbox(&case, changes.as_deref(), &set, &dir)
        }
        Some(Command::Study { study, output, set }) => study::write(&study, &set, output.as_deref()),
        None => {
            let scene = arguments.scene.unwrap_or_default();
            let folder = arguments.output.unwrap_or_else(|| scene.parent().unwrap_or(Path::new("")).to_path_buf());
            write_datbox(&scene, &arguments.set, &folder.join("DATBOX"))
        }
    };
    match written {
        Ok(summary) => {
            print_line(summary.trim_end());
            0
        }
        Err(faults) => {
            print_error(faults.format_report("cd-pre").trim_end());
            2
        }
    }
}

/// Reads the scene of the file `source`, in which `settings` override values, and writes the files of the folder
/// `datbox`; see [`places::apply_settings`].
///
/// Returns a summary for people. Errors: all faults of the scene (nothing is written then), or a file
/// that cannot be written.
pub fn write_datbox(source: &Path, settings: &[String], datbox: &Path) -> Result<String, Faults> {
    let original = atomic::read_text(source)?;
    let text = places::apply_settings(&original, settings)?;
    let (scene, population) = read_scene(source, &text, settings)?;
    let mut report = FaultReport::with_settings(source, &text, settings);
    report.warnings = former_names::warnings(source, &original, settings);
    doubts::report_doubts(&scene.materials, &scene.laws, &scene.grains, &scene.walls, &mut report);
    cd_formats::doubts::events(&scene.compute.events, "compute.", &mut report);
    attraction::warn_of_attractions(&scene, &population, &mut report);
    let mut files = write::datbox_files(&scene, &population);
    let (driven, _) = write::drv_dof(&scene, &population);
    let bytes = files.iter().map(|(name, text)| (name.as_str(), text.as_bytes()));
    reread::check_files(datbox, bytes, &driven, &scene.compute, |body| population.scene_path(body), &mut report);
    if !report.faults.0.is_empty() {
        return Err(report.faults);
    }
    // The folder must exist before paths of the scene relative to DATBOX can be found.
    std::fs::create_dir_all(datbox).map_err(|error| Fault::from_io(datbox, "written", &error))?;
    let case = datbox.parent().unwrap_or(Path::new(""));
    let mut origin = SceneOrigin::from_scene(source, original.as_bytes(), settings, case);
    if let Some(origin) = &mut origin {
        let folder = source.parent().unwrap_or(Path::new(""));
        models(&scene.grains).for_each(|file| origin.add(&folder.join(file), case));
    }
    for (_, text) in files.iter_mut().filter(|(name, _)| name == write::COMPUTE_FILE) {
        text.insert_str(0, &origin.as_ref().map_or(String::new(), SceneOrigin::lines));
    }
    atomic::write_all(files.iter().map(|(name, text)| (datbox.join(name), text.as_bytes())))?;
    from_outbox::remove_outbox_files(datbox)?;
    print_warnings(&report.warnings);
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    Ok(format!("{}wrote {}: {}\n", scene_summary(&scene, &population), datbox.display(), names.join(" ")))
}

/// Files of the surfaces that grains are made from or placed in, as the scene names them.
pub(crate) fn models(grains: &[scene::Grains]) -> impl Iterator<Item = &str> {
    grains.iter().flat_map(|grains| {
        let (shape, pieces) = match &grains.shape {
            scene::GrainShape::Model { file, contact_shape: scene::ContactSurface::Files(pieces), .. } => {
                (Some(file), pieces.as_slice())
            }
            scene::GrainShape::Model { file, .. } => (Some(file), &[][..]),
            _ => (None, &[][..]),
        };
        let envelope = match grains.placement.envelope() {
            Some(scene::Envelope::Model { file, .. }) => Some(file),
            _ => None,
        };
        shape.into_iter().chain(pieces).chain(envelope).map(String::as_str)
    })
}

/// Prints warnings on stderr.
fn print_warnings(warnings: &Faults) {
    if !warnings.0.is_empty() {
        print_error(warnings.format_report("cd-pre: warning").trim_end());
    }
}

/// Reads the scene in `text` and makes its bodies. Faults name the file `source`, or the setting for values from
/// `settings`.
pub fn read_scene(source: &Path, text: &str, settings: &[String]) -> Result<(Scene, Population), Faults> {
    let scene: Scene = parse_with_settings(source, text, settings, "scene")?;
    let mut report = FaultReport::with_settings(source, text, settings);
    check::check_scene(&scene, &mut report);
    if !report.faults.0.is_empty() {
        return Err(report.faults);
    }
    let population = population::populate(&scene, source.parent().unwrap_or(Path::new("")), &mut report);
    report.faults.into_result((scene, population))
}

/// Reads RON in which [`places::apply_settings`] has replaced values.
fn parse_with_settings<T: DeserializeOwned>(
    file: &Path,
    text: &str,
    settings: &[String],
    object: &str,
) -> Result<T, Faults> {
    from_ron(file, text, object).map_err(|mut faults| {
        for fault in &mut faults.0 {
            let (line, column) = (fault.line.unwrap_or(1), fault.column.unwrap_or(1));
            if let Some(setting) = places::setting_at(settings, text, line, column) {
                *fault = places::setting_fault(setting, fault.found.as_str(), fault.expected.as_str());
            }
        }
        faults
    })
}

/// Counts, sizes and masses: a line for each body of grains and one for all.
fn scene_summary(scene: &Scene, population: &Population) -> String {
    let (all, walls) = (population.grains.iter().collect::<Vec<_>>(), population.walls.len());
    let total = group_line(format!("{} bodies, {walls} of them walls", all.len() + walls), &all);
    group_lines(scene, population) + &total + "\n"
}

fn group_line(name: String, grains: &[&population::Grain]) -> String {
    let radii = || grains.iter().map(|grain| grain.radius);
    let (count, min, max) = (grains.len(), radii().fold(f64::INFINITY, f64::min), radii().fold(0.0, f64::max));
    let mean = radii().sum::<f64>() / count as f64;
    let mass: f64 = grains.iter().map(|grain| grain.mass).sum();
    let polyhedra = grains.iter().filter(|grain| grain.polyhedron.is_some()).count();
    let kind = match polyhedra {
        0 => format!("{count} spheres"),
        _ if polyhedra == count => format!("{count} polyhedra ({})", vertex_count_text(grains)),
        _ => format!("{} spheres and {polyhedra} polyhedra", count - polyhedra),
    };
    // Numbers below 0.01 have five digits.
    let digits = |x: f64| if x < 0.01 { format!("{x:.4e}") } else { format!("{x:.5}") };
    let [min, max, mean] = [min, max, mean].map(digits);
    format!("{name}: {kind}, radius {min} to {max} m (mean {mean} m), mass {mass:.6e} kg")
}

/// A line for each body of grains.
fn group_lines(scene: &Scene, population: &Population) -> String {
    let mut text = String::new();
    for (group, room) in population.regions.iter().enumerate() {
        let grains: Vec<_> = population.grains.iter().filter(|grain| grain.group == group).collect();
        text += &group_line(format!("grains {}", group + 1), &grains);
        if !population.file_summaries[group].is_empty() {
            text += &format!(", {}", population.file_summaries[group]);
        }
        if let Some(polyhedron) = grains.first().and_then(|grain| grain.polyhedron.as_ref())
            && scene.grains[group].shape.has_axes()
        {
            text += &frame_change_text(&polyhedron.solid);
        }
        if let Some(room) = room {
            let filled: f64 = grains.iter().map(|grain| grain.volume()).sum();
            text += &format!(", solid fraction {:.4} of {room}", filled / room.volume());
        }
        text += if scene.grains[group].driven.is_some() { ", driven\n" } else { "\n" };
    }
    text
}

/// Text about the translation and rotation of a shape to its centre of mass and principal axes.
fn frame_change_text(solid: &shapes::PrincipalSolid) -> String {
    let mut text = String::new();
    if solid.shift != Vector3::zeros() {
        let [x, y, z] = solid.shift.into();
        text += &format!(", centre of mass at ({x:.8}, {y:.8}, {z:.8}) m of the given vertices");
    }
    let turn = Rotation3::from_matrix_unchecked(solid.axes.transpose());
    if let Some((axis, angle)) = turn.axis_angle() {
        let [x, y, z] = axis.into_inner().into();
        text +=
            &format!(", principal axes rotated by {angle:.8} rad about ({x:.8}, {y:.8}, {z:.8}) from the given ones");
    }
    text
}

/// Text about the number of vertices of the grains, summed over the pieces of a grain.
fn vertex_count_text(grains: &[&population::Grain]) -> String {
    let solids = grains.iter().filter_map(|grain| grain.polyhedron.as_ref()).map(|polyhedron| &polyhedron.solid.pieces);
    let counts = solids.map(|pieces| pieces.iter().map(|piece| piece.vertices().len()).sum::<usize>());
    let (min, max) = counts.fold((usize::MAX, 0), |(min, max), count| (min.min(count), max.max(count)));
    if min == max { format!("{min} vertices each") } else { format!("{min} to {max} vertices") }
}

/// Nearest number that the files can hold: 8 digits, no negative zero.
///
/// ```
/// assert_eq!(cd_pre::round_8_digits(2.0 / 3.0), 0.66666667);
/// assert_eq!(cd_pre::round_8_digits(-123456789.0), -123456790.0);
/// ```
pub fn round_8_digits(x: f64) -> f64 {
    format!("{x:.7e}").parse().unwrap_or(x) + 0.0
}

/// [`round_8_digits`] of each component.
pub fn round_point(point: &Vector3<f64>) -> Vector3<f64> {
    point.map(round_8_digits)
}

/// Nearest number that the files can hold for a polyhedron: up to 12 digits, no negative zero.
pub fn round_14_columns(x: f64) -> f64 {
    fortran_real(&format_long14(x)).unwrap_or(x) + 0.0
}

/// [`round_14_columns`] of each component of axes.
pub fn round_axes(axes: &Matrix3<f64>) -> Matrix3<f64> {
    axes.map(round_14_columns)
}
