//! `cd-post DIR`: the series of a case, its plots, and the ParaView files of its snapshots.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};
use cd_formats::field::primary_motions;
use cd_formats::messages::print_line;
use cd_formats::names::count_text;
use rayon::prelude::*;
use vtkio::model::PolyDataPiece;

use crate::derive::Row;
use crate::derive::fragments::{Fragment, find_fragments};
use crate::frame::Frame;
use crate::math::Vec3;
use crate::options::{SeriesOptions, VtkFormat};
use crate::shapes::ShapeCache;
use crate::snapshots::{is_evenly_chosen, progress_bar, select_snapshots};
use crate::write;
use crate::write::colours::GrainQuantity;
use crate::write::display;
use crate::write::fields::IndexNames;
use crate::write::pieces::{pvtp_text, split_piece};
use crate::write::series::{Column, csv_with_counts};
use crate::write::vtkhdf::VtkhdfFile;

/// Measures a case and writes the files selected by the options; returns messages for the user.
///
/// The files that name others (`series.csv`, `*.pvd`) are written last: if a snapshot is rejected, the earlier ones remain.
pub fn process_case(options: &SeriesOptions) -> Result<Vec<String>, Faults> {
    if options.piece_cells.is_some() && options.vtk_format == VtkFormat::Vtkhdf {
        let (found, expected) = ("is given with --vtk-format vtkhdf", "expected one of the two");
        return Err(Fault::new("options".as_ref(), None, "--piece-cells", found, expected).into());
    }
    let primaries = Mutex::new(BTreeMap::new());
    let keep = |k: usize, count: usize, frame: Frame| {
        primaries.lock().expect("no thread panics with it").insert(k, primary_rows(&frame));
        is_evenly_chosen(k, count, PICTURE_COUNT).then_some(frame)
    };
    let (rows, frames) = measure_series(options, keep)?;
    let primaries: Vec<PrimaryRow> =
        primaries.into_inner().expect("no thread panics with it").into_values().flatten().collect();
    let last = frames.last().expect("the last snapshot is taken");
    let postpro = options.dir.join("POSTPRO");
    atomic::write(&postpro.join("series.csv"), write::series::series_text(&rows).as_bytes())?;
    print_line(format_args!(
        "cd-post: {} of {}",
        count_text(rows.len(), "snapshot"),
        options.dir.join("OUTBOX").display()
    ));
    print_line(format_args!("  series   {}", postpro.join("series.csv").display()));
    if !primaries.is_empty() {
        let text = csv_with_counts(&PRIMARY_COLUMNS.map(|column| column.0), &["primary"], primaries);
        let path = postpro.join("primaries.csv");
        atomic::write(&path, text.as_bytes())?;
        print_line(format_args!("  orbits   {}", path.display()));
    }
    options.axes.axes.record(&postpro)?;
    let regions = write::plots::region_names(&rows);
    if !regions.is_empty() {
        print_line(format_args!("  region   {regions}: Z, ν, pressure, stress"));
    }
    if !options.no_plots {
        for plot in &write::plots::PLOTS {
            atomic::write(&postpro.join(plot.file), plot.to_figure(&rows).to_svg().as_bytes())?;
        }
        let frames: Vec<&Frame> = frames.iter().collect();
        let ([neighbours, energy], snapshots) = rayon::join(
            || write::picture::svgs(last, [GrainQuantity::Neighbours, GrainQuantity::KineticEnergy]),
            || write::picture::snapshots_svg(&frames),
        );
        for (name, text) in
            [("aggregate.svg", neighbours), ("aggregate_energy.svg", energy), ("snapshots.svg", snapshots)]
        {
            atomic::write(&postpro.join(name), text.as_bytes())?;
        }
        print_line(format_args!("  plots    {}", postpro.join("*.svg").display()));
    }
    let mut notes = result_notes(&rows);
    notes.extend(undefined_region_note(&rows));
    notes.extend(empty_region_note(options, &rows, last));
    if !options.no_vtk {
        notes.extend(finish_display(options, &rows, last)?);
        options.axes.axes.record(&options.dir.join("DISPLAY"))?;
        print_line(format_args!("  ParaView {}", options.dir.join("DISPLAY").join("view.py").display()));
    }
    Ok(notes)
}

/// Columns of primaries.csv.
pub const PRIMARY_COLUMNS: [Column; 9] = [
    ("time", "s", ""),
    ("primary", "1", "position in the option `fields`, from 1"),
    ("x", "m", "position of the primary"),
    ("y", "m", ""),
    ("z", "m", ""),
    ("v_x", "m/s", "velocity of the primary"),
    ("v_y", "m/s", ""),
    ("v_z", "m/s", ""),
    ("distance", "m", "distance from the origin of the computation"),
];

/// Row of primaries.csv.
type PrimaryRow = [f64; PRIMARY_COLUMNS.len()];

/// Rows of the motion of the primaries on orbits at the time of a frame; none if no field has an orbit.
fn primary_rows(frame: &Frame) -> Vec<PrimaryRow> {
    let (meta, parameters, origin) = (&frame.meta, &frame.meta.parameters, frame.origin);
    if parameters.fields.iter().all(|field| field.orbit().is_none()) {
        return Vec::new();
    }
    let (fields, response) = (&parameters.fields, meta.primary_response.as_ref());
    let motions = primary_motions(fields, &frame.field_shapes, parameters.gravity_constant, meta.time, response);
    let row = |(number, motion): (u32, Option<(Vec3, Vec3)>)| {
        let (x, v) = motion?;
        let (written, v, distance) = (origin.written_position(x), origin.written_velocity(v), x.norm());
        Some([meta.time, f64::from(number), written.x, written.y, written.z, v.x, v.y, v.z, distance])
    };
    (1..).zip(motions).filter_map(row).collect()
}

/// Note about snapshots in which the user's region has no volume.
pub fn undefined_region_note(rows: &[Row]) -> Option<String> {
    let outside = rows.iter().filter(|row| row.n_grains > 0 && row.region == 0).count();
    (outside > 0).then(|| {
        format!(
            "--region: a layer without walls or periods on all sides, or a shape over ten thousand periods, in {outside} of {} snapshots: Z, ν, pressure and stress are empty; expected ball, box or cylinder",
            rows.len()
        )
    })
}

/// Returns a row for each selected snapshot, and the results of `keep` for the k-th of all selected ones; also writes the
/// ParaView files.
///
/// Snapshots are processed in batches of one for each thread, so that memory contains only these and the kept results.
/// Errors: no snapshot, or faults of one.
pub fn measure_series<T: Send>(
    options: &SeriesOptions,
    keep: impl Fn(usize, usize, Frame) -> Option<T> + Sync,
) -> Result<(Vec<Row>, Vec<T>), Faults> {
    let outbox = options.dir.join("OUTBOX");
    let selected = select_snapshots(&outbox, options.every)?;
    let bar = progress_bar(selected.len());
    let measurement = options.measurement_options();
    let mut rows = Vec::with_capacity(selected.len());
    let mut kept = Vec::new();
    // Mass of each grain by its number, as grains may enter and leave.
    let mut masses: HashMap<u64, f64> = HashMap::new();
    let mut count: Option<usize> = None;
    let shapes = ShapeCache::default();
    let mut open_files: Vec<(&str, VtkhdfFile)> = Vec::new();
    for batch in selected.chunks(rayon::current_num_threads()) {
        let first = rows.len();
        let measured: Vec<Result<_, Faults>> = batch
            .par_iter()
            .enumerate()
            .map(|(k, (_, path))| {
                let frame = Frame::read_for_axes(path, &shapes, options.axes.axes)?;
                let fragments = find_fragments(&frame);
                let row = Row::with_fragments(&frame, &fragments, &measurement);
                let pieces = if options.no_vtk { vec![] } else { display_pieces(options, &frame, &fragments)? };
                drop(fragments);
                let grain_masses: Vec<(u64, f64)> = frame.grains.iter().map(|grain| (grain.id, grain.mass)).collect();
                let body_count = frame.grains.len() + frame.walls.len() + frame.absent.len();
                Ok((row, (body_count, grain_masses), pieces, keep(first + k, selected.len(), frame)))
            })
            .collect();
        let mut faults = Faults::default();
        for (measured, (_, path)) in measured.into_iter().zip(batch) {
            match measured {
                Ok((row, (body_count, grain_masses), pieces, result)) => {
                    let is_same = |(id, mass): (u64, f64)| *masses.entry(id).or_insert(mass) == mass;
                    let all_same = grain_masses.into_iter().map(is_same).fold(true, |all, same| all & same);
                    if !all_same || *count.get_or_insert(body_count) != body_count {
                        let expected = format!("expected those of {}, of the same run", selected[0].1.display());
                        faults.push(Fault::new(path, None, "snapshot", "other bodies", expected));
                    }
                    append_pieces(&options.dir, &mut open_files, row.time, pieces)?;
                    kept.extend(result);
                    rows.push(row);
                }
                Err(Faults(found)) => {
                    // A fault of the one BODIES.DAT of several snapshots is reported once.
                    let reported_files: HashSet<PathBuf> = faults.0.iter().map(|fault| fault.file.clone()).collect();
                    faults.0.extend(found.into_iter().filter(|fault| !reported_files.contains(&fault.file)));
                }
            }
        }
        faults.into_result(())?;
        bar.inc(batch.len() as u64);
    }
    open_files.into_iter().try_for_each(|(_, file)| file.finish())?;
    bar.finish_and_clear();
    Ok((rows, kept))
}

/// Snapshots in one picture: the first, the last and two between.
const PICTURE_COUNT: usize = 4;

/// Data of one kind, by its name.
type NamedPiece = (&'static str, PolyDataPiece);

/// Writes the ParaView files of one frame, or returns their data if files contain several frames.
fn display_pieces(options: &SeriesOptions, frame: &Frame, fragments: &[Fragment]) -> Result<Vec<NamedPiece>, Faults> {
    let kinds = display::FILE_KINDS.into_iter();
    let mut pieces = kinds.filter_map(|kind| Some((kind, display::display_piece(frame, fragments, kind)?)));
    match options.vtk_format {
        VtkFormat::Vtkhdf => Ok(pieces.collect()),
        VtkFormat::Vtp => pieces
            .try_for_each(|(kind, piece)| match options.piece_cells {
                Some(max_cells) => write_in_pieces(&options.dir.join("DISPLAY"), kind, frame, &piece, max_cells),
                None => {
                    let name = display::file_name(kind, frame.meta.step);
                    atomic::write(&options.dir.join("DISPLAY").join(name), &display::display_bytes(piece, frame))
                }
            })
            .map(|()| vec![]),
    }
}

/// Writes data in pieces of at most `max_cells` cells, then the file that names them, and removes further pieces of an
/// earlier run.
fn write_in_pieces(
    folder: &Path,
    kind: &str,
    frame: &Frame,
    piece: &PolyDataPiece,
    max_cells: usize,
) -> Result<(), Faults> {
    let (step, mut names) = (frame.meta.step, Vec::new());
    for (number, part) in split_piece(piece, max_cells).enumerate() {
        names.push(display::part_name(kind, step, number));
        atomic::write(&folder.join(&names[number]), &display::display_bytes(part, frame))?;
    }
    atomic::write(&folder.join(display::index_name(kind, step)), pvtp_text(piece, &names).as_bytes())?;
    let further = (names.len()..).map(|number| folder.join(display::part_name(kind, step, number)));
    for path in further.take_while(|path| atomic::path_exists(path)) {
        fs::remove_file(&path).map_err(|error| Fault::from_io(&path, "removed", &error))?;
    }
    Ok(())
}

/// Appends the data at `time`, s, to the file of each kind, which the first data start.
fn append_pieces(
    dir: &Path,
    open_files: &mut Vec<(&str, VtkhdfFile)>,
    time: f64,
    pieces: Vec<NamedPiece>,
) -> Result<(), Faults> {
    for (kind, piece) in pieces {
        let k = match open_files.iter().position(|(name, _)| *name == kind) {
            Some(k) => k,
            None => {
                open_files.push((kind, VtkhdfFile::create(&dir.join("DISPLAY").join(display::vtkhdf_name(kind)))?));
                open_files.len() - 1
            }
        };
        open_files[k].1.append(time, piece)?;
    }
    Ok(())
}

/// Writes view.py and the collections of `.vtp` files, and removes the files of an earlier run; returns a note for the user.
fn finish_display(options: &SeriesOptions, rows: &[Row], last: &Frame) -> Result<Option<String>, Faults> {
    let display = options.dir.join("DISPLAY");
    let times: Vec<(u64, f64)> = rows.iter().map(|row| (row.step, row.time)).collect();
    let mut current = HashSet::new();
    let folder = fs::canonicalize(&display).map_err(|error| Fault::from_io(&display, "read", &error))?;
    let names = IndexNames::from_frame(last);
    atomic::write(&display.join("view.py"), display::view_script(&folder, &names).as_bytes())?;
    for kind in display::FILE_KINDS.into_iter().filter(|kind| display::has_piece(last, kind)) {
        if options.vtk_format == VtkFormat::Vtkhdf {
            current.insert(display::vtkhdf_name(kind));
            continue;
        }
        let name = format!("{kind}.pvd");
        let file_name = if options.piece_cells.is_some() { display::index_name } else { display::file_name };
        let files: Vec<(String, f64)> = times.iter().map(|&(step, time)| (file_name(kind, step), time)).collect();
        atomic::write(&display.join(&name), display::pvd_collection(&files).as_bytes())?;
        current.insert(name);
        current.extend(files.into_iter().map(|(name, _)| name));
    }
    for path in atomic::folder_entries(&display)? {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        // A piece is current if the file that names it is.
        let naming_file =
            name.split_once("-part-").map_or_else(|| name.clone(), |(prefix, _)| format!("{prefix}.pvtp"));
        if display::is_display_file(&name) && !current.contains(&naming_file) {
            fs::remove_file(&path).map_err(|error| Fault::from_io(&path, "removed", &error))?;
        }
    }
    let has_no_text = folder.to_str().is_none();
    Ok(has_no_text.then(|| {
        format!(
            "{}: the name of the folder is not UTF-8: start ParaView inside the folder to use view.py",
            display.display()
        )
    }))
}

/// Warning if the user's region contains no part of a grain.
fn empty_region_note(options: &SeriesOptions, rows: &[Row], last: &Frame) -> Option<String> {
    options.measures.region.as_ref()?;
    let empty = rows.iter().filter(|row| row.n_grains > 0 && row.region != 0 && row.nu == 0.0).count();
    if empty == 0 {
        return None;
    }
    let ends = |axis: usize| {
        let coordinates = || last.grains.iter().map(|grain| grain.x[axis]);
        let (low, high) =
            (coordinates().fold(f64::INFINITY, f64::min), coordinates().fold(f64::NEG_INFINITY, f64::max));
        let name = ["x", "y", "z"][axis];
        if low > high { format!("{name}: any") } else { format!("{name} = {low:.4} to {high:.4}") }
    };
    Some(format!(
        "--region: contains no grain in {empty} of {} snapshots; expected a region where grains are: in the last {}, {} and {} m",
        rows.len(),
        ends(0),
        ends(1),
        ends(2)
    ))
}

/// Notes about snapshots without grains.
fn result_notes(rows: &[Row]) -> Vec<String> {
    let empty = rows.iter().filter(|row| row.n_grains == 0).count();
    if empty == 0 {
        vec![]
    } else {
        vec![format!("{empty} of {} snapshots have no grains: their fields are empty", rows.len())]
    }
}
