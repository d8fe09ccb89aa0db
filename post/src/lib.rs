//! cd-post: from the snapshots of cd-solve to tables, plots and pictures.
//!
//! `read` ([`frame`]) -> `derive` ([`mod@derive`]) -> `write` ([`mod@write`]): each snapshot of `DIR/OUTBOX` becomes a
//! [`Frame`], a [`Row`] of `POSTPRO/series.csv` and the files of `DISPLAY/`; the rows together become plots, the last frame
//! a picture. [`mod@state`] measures one snapshot in depth, [`compare`] compares several runs, [`study`] many, [`trade`]
//! measures error against cost, [`track`] follows one body, [`report`] makes a page of a run.

use std::collections::HashSet;
use std::ffi::OsString;
use std::fs::{self, File, TryLockError};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use cd_formats::case::{CaseFolder, misplaced, no_case};
use cd_formats::error::{Fault, Faults};
use cd_formats::ron_text::nearest_name;
use cd_formats::tell::{print_error, print_line, usage};
use cd_formats::{atomic, snapshot};
use clap::builder::RangedU64ValueParser;
use clap::{CommandFactory, Parser};
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;

pub mod compare;
pub mod derive;
pub mod frame;
pub mod report;
pub mod shapes;
pub mod state;
pub mod study;
pub mod track;
pub mod trade;
pub mod write;

use derive::energy::PairSummation;
use derive::free_surface::REACH;
use derive::probe::Probe;
use derive::{MeasurementOptions, Row};
use frame::Frame;
use shapes::ShapeCache;
use write::display;
use write::picture::PictureColouring;

/// Measures the snapshots of a case and draws them.
///
/// Reads DIR/OUTBOX/snapshot-*.npz; writes DIR/POSTPRO (series.csv, plots, a picture) and DIR/DISPLAY
/// (ParaView files, which paraview --script=DIR/DISPLAY/view.py shows). The shapes of polyhedra are
/// read from DIR/DATBOX/BODIES.DAT. A folder whose name is that of a command below is given as
/// ./NAME.
#[derive(Debug, Clone, Parser)]
#[command(name = "cd-post", version, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    options: Options,
}

#[derive(Debug, Clone, clap::Subcommand)]
enum Command {
    /// One snapshot in depth: profiles, forces, fabric, fragments with orbits, ejecta, surface.
    ///
    /// Writes DIR/POSTPRO/state-NNNNNN.
    State {
        /// The case directory
        #[arg(default_value = ".")]
        dir: PathBuf,
        /// Step of the snapshot; without it the last
        #[arg(long, value_name = "STEP")]
        snapshot: Option<u64>,
        /// Layers of a bed are means over so many snapshots up to that one
        #[arg(long, value_name = "COUNT", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
        mean: u32,
        #[command(flatten)]
        slope: SlopeReach,
    },
    /// The same observable of several runs in one figure, and their values in one table.
    ///
    /// Reads the POSTPRO/series.csv of each, which cd-post writes.
    Compare {
        /// The case directories
        #[arg(required = true, num_args = 1..)]
        dirs: Vec<PathBuf>,
        /// Folder in which NAME.svg and NAME.csv are written
        #[arg(short, long, default_value = "compare")]
        output: PathBuf,
        /// Names of the runs, in their order; without them those of their folders
        #[arg(long, value_delimiter = ',')]
        labels: Vec<String>,
        /// Table below POSTPRO of each case: series.csv, one of `cd-post state`, such as state/profile.csv for the last
        /// state of each, or of `cd-post track`, such as track-1/track.csv
        #[arg(long, default_value = "series.csv", value_name = "FILE")]
        table: PathBuf,
        /// Columns of the table; without them those of the plots
        #[arg(long, value_delimiter = ',')]
        columns: Vec<String>,
        /// Column of the horizontal axis; without it time, or the first of the table
        #[arg(long)]
        against: Option<String>,
    },
    /// Many runs, each by its means over the end, and how they go with the number of grains; fitted lines and cost.
    ///
    /// Reads of each POSTPRO/series.csv, OUTBOX/steps.csv, TIMER.csv and the last snapshot.
    Study {
        /// The case directories
        #[arg(required = true, num_args = 1..)]
        dirs: Vec<PathBuf>,
        /// Folder in which runs.csv, fits.csv and the figures are written
        #[arg(short, long, default_value = "study")]
        output: PathBuf,
        /// One name a run, the same for those that the figures show as one; without them all are one
        #[arg(long, value_delimiter = ',')]
        groups: Vec<String>,
        /// Time from which snapshots count for the means, s; without it the last alone
        #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = parse_finite)]
        from: Option<f64>,
        /// Time up to which they count, s; without it the end
        #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = parse_finite)]
        until: Option<f64>,
    },
    /// Runs of one scene against the finest: errors of what is observed, and the time that they took.
    ///
    /// Reads of each POSTPRO/series.csv, TIMER.csv, ERRORS.csv and snapshots.
    Trade {
        /// The case directories; errors are against that of `accuracy: reference`, else against the last. Or folders that this
        /// command has written, of several realisations of a scene
        #[arg(required = true, num_args = 2..)]
        dirs: Vec<PathBuf>,
        /// Folder in which trade.csv, orders.csv and trade.svg are written
        #[arg(short, long, default_value = "trade")]
        output: PathBuf,
        /// One name a run, of the option that it is about
        #[arg(long, value_delimiter = ',')]
        groups: Vec<String>,
        /// One number a run, the value of that option; nan where it is none
        #[arg(long, value_delimiter = ',')]
        values: Vec<f64>,
        /// Time from which snapshots count, s; without it the last alone
        #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = parse_finite)]
        from: Option<f64>,
        /// Time from which on positions are compared at the first snapshot, s; without it, at the first after the start
        #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = parse_finite)]
        early: Option<f64>,
        /// Title of the figure
        #[arg(long, value_name = "TEXT", default_value = "Error against time")]
        title: String,
    },
    /// One body in a bed of grains, such as a lander: its way, depth, force, bounce and crater.
    ///
    /// Writes DIR/POSTPRO/track-N.
    Track {
        /// The case directory
        #[arg(default_value = ".")]
        dir: PathBuf,
        /// Number of the body in BODIES.DAT
        #[arg(long, value_name = "N")]
        body: u64,
    },
    /// The run on one page that needs nothing else: figures, numbers, options, the grains to turn and zoom.
    ///
    /// Writes DIR/POSTPRO/report.html.
    Report {
        /// The case directory
        #[arg(default_value = ".")]
        dir: PathBuf,
        /// Take every Nth snapshot, counted from the first, and the last
        #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
        every: u32,
        #[command(flatten)]
        measures: Measures,
    },
}

impl Arguments {
    /// Folder of the case to which the command writes.
    fn case_dir(&self) -> Option<&Path> {
        match &self.command {
            None => Some(&self.options.dir),
            Some(Command::State { dir, .. } | Command::Track { dir, .. } | Command::Report { dir, .. }) => Some(dir),
            Some(Command::Compare { .. } | Command::Study { .. } | Command::Trade { .. }) => None,
        }
    }

    /// Errors if folders are not those of cases.
    fn folders(&self) -> Result<(), Faults> {
        let (dirs, part) = match &self.command {
            Some(Command::Compare { dirs, .. } | Command::Study { dirs, .. } | Command::Trade { dirs, .. }) => {
                (dirs.iter().map(PathBuf::as_path).collect(), CaseFolder::Any)
            }
            _ => (Vec::from_iter(self.case_dir()), CaseFolder::Outbox),
        };
        Faults(dirs.into_iter().filter_map(|dir| no_case(dir, part, "cd-post")).collect()).into_result(())
    }
}

/// Message about a first argument that is neither a folder nor a command, but resembles a command.
fn misspelt_command(args: &[OsString]) -> Option<String> {
    let first = args.get(1)?.to_str().filter(|first| !first.starts_with('-') && !Path::new(first).exists())?;
    let command = Arguments::command();
    let names: Vec<&str> = command.get_subcommands().map(|command| command.get_name()).chain(["help"]).collect();
    if names.contains(&first) {
        return None;
    }
    Some(format!("{first}: is no folder and no command; did you mean {}?", nearest_name(first, &names)?))
}

/// Locks a case for this run until the file is dropped; waits for another run that works in it. Two runs would write the
/// same files, and each would remove files of the other.
///
/// If files cannot be locked, every run proceeds.
fn lock_case(case: &Path) -> Option<File> {
    let folder = File::open(case).ok()?;
    if matches!(folder.try_lock(), Err(TryLockError::WouldBlock)) {
        print_error(format_args!("cd-post: {}: another cd-post is at work in it; waiting for its end", case.display()));
        folder.lock().ok()?;
    }
    Some(folder)
}

/// A number of the command line.
fn parse_finite(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "expected a number".to_string())?;
    if number.is_finite() { Ok(number) } else { Err("expected a finite number".into()) }
}

/// A number of the command line that is positive.
fn parse_positive(text: &str) -> Result<f64, String> {
    parse_finite(text).ok().filter(|number| *number > 0.0).ok_or_else(|| "expected a number > 0".to_string())
}

/// Reach of the planes whose angle is the slope of a surface.
#[derive(Debug, Clone, clap::Args)]
pub struct SlopeReach {
    /// Mean radii over which planes are fitted to a surface for its slope: fewer show more of its shape, and of its grains
    /// [default: 12 of a heap or bed, 10 of an aggregate]
    #[arg(long, value_name = "RADII", value_parser = parse_positive)]
    pub slope_reach: Option<f64>,
}

/// Where the observables of a series are measured.
#[derive(Debug, Clone, clap::Args)]
pub struct Measures {
    /// Region of Z, nu, pressure and stress: ball:RADIUS, box:X,Y,Z, cylinder:RADIUS,LENGTH or
    /// cylinder:RADIUS,LENGTH,AXIS_X,AXIS_Y,AXIS_Z with its centre at @X,Y,Z, @com or @largest, or layer:FROM,TO above the floor (m); without it the one that fits the scene
    #[arg(long, value_name = "SHAPE")]
    pub region: Option<Probe>,
    #[command(flatten)]
    pub slope: SlopeReach,
}

impl Default for Measures {
    /// Returns the values of a command line without flags.
    fn default() -> Measures {
        Measures { region: None, slope: SlopeReach { slope_reach: None } }
    }
}

/// Options of the measurement of a case and of its files.
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// The case directory
    #[arg(default_value = ".")]
    pub dir: PathBuf,
    /// Take every Nth snapshot, counted from the first, and the last
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
    /// Write no plots and no picture
    #[arg(long)]
    pub no_plots: bool,
    /// Write no ParaView files
    #[arg(long)]
    pub no_vtk: bool,
    /// Sum potential energies over every pair at any number of grains
    #[arg(long)]
    pub direct_gravity: bool,
    #[command(flatten)]
    pub measures: Measures,
    /// Threads; 0 takes all cores. Results do not depend on it
    #[arg(long, default_value_t = 0, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(..=1024))]
    pub threads: usize,
}

impl Default for Options {
    /// Returns the options of a command line without flags.
    fn default() -> Options {
        let dir = PathBuf::new();
        let (every, no_plots, no_vtk, direct_gravity, threads) = (1, false, false, false, 0);
        Options { dir, every, no_plots, no_vtk, direct_gravity, measures: Measures::default(), threads }
    }
}

impl Options {
    fn to_choices(&self) -> MeasurementOptions {
        let summation = if self.direct_gravity { PairSummation::Direct } else { PairSummation::Fast };
        let Measures { region, slope } = self.measures.clone();
        MeasurementOptions { summation, region, slope_reach: slope.slope_reach.unwrap_or(REACH) }
    }
}

/// Runs the program: reads the command line, does the work, prints messages.
///
/// Returns the exit status: 0 success; 1 success with messages; 2 input rejected, each fault on a line of stderr as
/// `cd-post: file: object: found; expected`.
pub fn run(args: impl IntoIterator<Item = OsString>) -> i32 {
    let args: Vec<OsString> = args.into_iter().collect();
    if let Some(message) = misspelt_command(&args) {
        print_error(format_args!("cd-post: {message}"));
        return 2;
    }
    let arguments = match Arguments::try_parse_from(&args) {
        Ok(arguments) => arguments,
        Err(error) => {
            let mistake = misplaced(&Arguments::command(), &args).filter(|_| error.use_stderr());
            let Some(mistake) = mistake else { return usage("cd-post", &error) };
            print_error(format_args!("cd-post: {mistake}"));
            return error.exit_code();
        }
    };
    if let Err(faults) = arguments.folders() {
        print_error(faults.format_report("cd-post").trim_end());
        return 2;
    }
    let Arguments { command, options } = &arguments;
    let pool = match rayon::ThreadPoolBuilder::new().num_threads(options.threads).build() {
        Ok(pool) => pool,
        Err(_) => {
            print_error(format_args!(
                "cd-post: options: threads: {} cannot be started; expected a number that the system allows",
                options.threads
            ));
            return 2;
        }
    };
    let _alone = arguments.case_dir().and_then(lock_case);
    let done = pool.install(|| match command {
        None => process_case(options),
        Some(Command::State { dir, snapshot, mean, slope }) => state::write(dir, *snapshot, *mean, slope.slope_reach)
            .map(|(folder, notes)| {
                print_line(format_args!("cd-post: {}", folder.display()));
                notes
            }),
        Some(Command::Compare { dirs, output, labels, table, columns, against }) => {
            let compared = compare::ComparisonOptions { table, columns, against: against.as_deref() };
            compare::write(dirs, labels, &compared, output).map(|(count, notes)| {
                print_line(format_args!("cd-post: {count} figures in {}", output.display()));
                notes
            })
        }
        Some(Command::Study { dirs, output, groups, from, until }) => study::write(dirs, groups, *from, *until, output)
            .map(|(count, notes)| {
                print_line(format_args!("cd-post: {} runs, {count} figures in {}", dirs.len(), output.display()));
                notes
            }),
        Some(Command::Trade { dirs, output, groups, values, from, early, title }) => {
            let asked = trade::TradeOptions { groups, values, from: *from, early: *early };
            trade::write(dirs, &asked, title, output).map(|(table, notes)| {
                print_line(format_args!("cd-post: {} runs in {}\n{table}", dirs.len(), output.display()));
                notes
            })
        }
        Some(Command::Track { dir, body }) => track::write(dir, *body).map(|(folder, notes)| {
            print_line(format_args!("cd-post: {}", folder.display()));
            notes
        }),
        Some(Command::Report { dir, every, measures }) => report::write(dir, *every, measures).map(|(page, notes)| {
            print_line(format_args!("cd-post: {}", page.display()));
            notes
        }),
    });
    match done {
        Ok(notes) => {
            notes.iter().for_each(|note| print_error(format_args!("cd-post: {note}")));
            i32::from(!notes.is_empty())
        }
        Err(faults) => {
            print_error(faults.format_report("cd-post").trim_end());
            2
        }
    }
}

/// Measures a case and writes the files selected by the options; returns messages for the user.
///
/// The files that name others (`series.csv`, `*.pvd`) are written last: if a snapshot is rejected, the earlier ones remain.
pub fn process_case(options: &Options) -> Result<Vec<String>, Faults> {
    let (rows, frames) =
        measure_series(options, |k, count, frame| is_evenly_chosen(k, count, PICTURE_COUNT).then_some(frame))?;
    let last = frames.last().expect("the last snapshot is taken");
    let postpro = options.dir.join("POSTPRO");
    atomic::write(&postpro.join("series.csv"), write::series::series_text(&rows).as_bytes())?;
    print_line(format_args!("cd-post: {} snapshots of {}", rows.len(), options.dir.join("OUTBOX").display()));
    print_line(format_args!("  series   {}", postpro.join("series.csv").display()));
    let regions = write::plots::region_names(&rows);
    if !regions.is_empty() {
        print_line(format_args!("  region   {regions}: Z, ν, pressure, stress"));
    }
    if !options.no_plots {
        for plot in &write::plots::PLOTS {
            atomic::write(&postpro.join(plot.file), plot.to_figure(&rows).to_svg().as_bytes())?;
        }
        let picture = |shade| write::picture::svg(last, shade);
        atomic::write(&postpro.join("aggregate.svg"), picture(PictureColouring::Neighbours).as_bytes())?;
        atomic::write(&postpro.join("aggregate_energy.svg"), picture(PictureColouring::KineticEnergy).as_bytes())?;
        let frames: Vec<&Frame> = frames.iter().collect();
        atomic::write(&postpro.join("snapshots.svg"), write::picture::snapshots_svg(&frames).as_bytes())?;
        print_line(format_args!("  plots    {}", postpro.join("*.svg").display()));
    }
    let mut notes = result_notes(&rows);
    notes.extend(outside_of_layers(&rows));
    notes.extend(empty_region(options, &rows, last));
    if !options.no_vtk {
        notes.extend(finish_display(&options.dir, &rows, last)?);
        print_line(format_args!("  ParaView {}", options.dir.join("DISPLAY").join("view.py").display()));
    }
    Ok(notes)
}

/// Note on snapshots in which the user's region has no volume.
fn outside_of_layers(rows: &[Row]) -> Option<String> {
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
fn measure_series<T: Send>(
    options: &Options,
    keep: impl Fn(usize, usize, Frame) -> Option<T> + Sync,
) -> Result<(Vec<Row>, Vec<T>), Faults> {
    let outbox = options.dir.join("OUTBOX");
    let selected = select_snapshots(&outbox, options.every)?;
    let bar = progress_bar(selected.len());
    let choices = options.to_choices();
    let mut rows = Vec::with_capacity(selected.len());
    let mut kept = Vec::new();
    let mut masses: Option<Vec<f64>> = None;
    let shapes = ShapeCache::default();
    for batch in selected.chunks(rayon::current_num_threads()) {
        let first = rows.len();
        let measured: Vec<Result<_, Faults>> = batch
            .par_iter()
            .enumerate()
            .map(|(k, (_, path))| {
                let frame = Frame::read(path, &shapes)?;
                let row = Row::with_options(&frame, &choices);
                if !options.no_vtk {
                    write_display(&options.dir, &frame)?;
                }
                let own: Vec<f64> = frame.grains.iter().map(|grain| grain.mass).collect();
                Ok((row, own, keep(first + k, selected.len(), frame)))
            })
            .collect();
        let mut faults = Faults::default();
        for (result, (_, path)) in measured.into_iter().zip(batch) {
            match result {
                Ok((row, own, for_later)) => {
                    if *masses.get_or_insert_with(|| own.clone()) != own {
                        let expected = format!("expected those of {}, of the same run", selected[0].1.display());
                        faults.push(Fault::new(path, None, "snapshot", "other bodies", expected));
                    }
                    kept.extend(for_later);
                    rows.push(row);
                }
                Err(Faults(found)) => {
                    // A fault of the one BODIES.DAT of several snapshots is reported once.
                    let told: HashSet<PathBuf> = faults.0.iter().map(|fault| fault.file.clone()).collect();
                    faults.0.extend(found.into_iter().filter(|fault| !told.contains(&fault.file)));
                }
            }
        }
        faults.into_result(())?;
        bar.inc(batch.len() as u64);
    }
    bar.finish_and_clear();
    Ok((rows, kept))
}

/// Snapshots in one picture: the first, the last and two between.
const PICTURE_COUNT: usize = 4;

/// Whether snapshot `k` of `count` is one of `some` spread evenly from the first to the last; if `some` is one, the first.
fn is_evenly_chosen(k: usize, count: usize, some: usize) -> bool {
    let parts = some.max(2) - 1;
    (0..some).any(|part| (count - 1) * part / parts == k)
}

/// Lists the snapshots of a folder by step; errors if there are none.
fn list_snapshots(outbox: &Path) -> Result<Vec<(u64, PathBuf)>, Faults> {
    let expected = "expected snapshot-*.npz, the results of cd-solve";
    let refuse = |found: &str| Err(Fault::new(outbox, None, "folder", found, expected).into());
    match snapshot::list_snapshots(outbox)? {
        _ if !atomic::path_exists(outbox) => refuse("is not there"),
        all if all.is_empty() => refuse("holds no snapshot"),
        all => Ok(all),
    }
}

/// Selects every `every`th snapshot, and the last.
fn select_snapshots(outbox: &Path, every: u32) -> Result<Vec<(u64, PathBuf)>, Faults> {
    let all = list_snapshots(outbox)?;
    let last = all.len() - 1;
    let taken = |k: usize| k == last || k.is_multiple_of(every as usize);
    Ok(all.into_iter().enumerate().filter(|(k, _)| taken(*k)).map(|(_, found)| found).collect())
}

/// Progress bar on a terminal, hidden otherwise.
fn progress_bar(count: usize) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("cd-post {bar:40} {pos}/{len} snapshots, {eta} left");
    ProgressBar::new(count as u64).with_style(style.expect("a fixed template"))
}

/// Whether the frame has anything of this kind to draw.
fn has_kind(frame: &Frame, kind: &str) -> bool {
    match kind {
        "walls" => !frame.walls.is_empty(),
        "polyhedra" => frame.grains.iter().any(|grain| grain.solid.is_some()),
        _ => true,
    }
}

/// Writes the ParaView files of one frame.
fn write_display(dir: &Path, frame: &Frame) -> Result<(), Faults> {
    let path = |kind| dir.join("DISPLAY").join(display::file_name(kind, frame.meta.step));
    atomic::write(&path("grains"), &display::grains_vtp(frame))?;
    atomic::write(&path("contacts"), &display::contacts_vtp(frame))?;
    if has_kind(frame, "polyhedra") {
        atomic::write(&path("polyhedra"), &display::polyhedra_vtp(frame))?;
    }
    if has_kind(frame, "walls") {
        atomic::write(&path("walls"), &display::walls_vtp(frame))?;
    }
    Ok(())
}

/// Writes the collections, and removes the files of an earlier run that they do not name; returns messages for the user.
fn finish_display(dir: &Path, rows: &[Row], last: &Frame) -> Result<Option<String>, Faults> {
    let display = dir.join("DISPLAY");
    let times: Vec<(u64, f64)> = rows.iter().map(|row| (row.step, row.time)).collect();
    let mut current = HashSet::new();
    let folder = fs::canonicalize(&display).map_err(|error| Fault::from_io(&display, "read", &error))?;
    atomic::write(&display.join("view.py"), display::view_script(&folder).as_bytes())?;
    for kind in display::FILE_KINDS.into_iter().filter(|kind| has_kind(last, kind)) {
        let name = format!("{kind}.pvd");
        atomic::write(&display.join(&name), display::pvd_collection(kind, &times).as_bytes())?;
        current.insert(name);
        current.extend(times.iter().map(|(step, _)| display::file_name(kind, *step)));
    }
    for path in atomic::folder_entries(&display)? {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if display::is_display_file(&name) && !current.contains(&name) {
            fs::remove_file(&path).map_err(|error| Fault::from_io(&path, "removed", &error))?;
        }
    }
    let nameless = folder.to_str().is_none();
    Ok(nameless.then(|| {
        format!(
            "{}: the folder has a name that is not UTF-8: a window that view.py is to fill is started in it",
            display.display()
        )
    }))
}

/// Warning if the user's region contains no part of a grain.
fn empty_region(options: &Options, rows: &[Row], last: &Frame) -> Option<String> {
    options.measures.region.as_ref()?;
    let empty = rows.iter().filter(|row| row.n_grains > 0 && row.region != 0 && row.nu == 0.0).count();
    if empty == 0 {
        return None;
    }
    let ends = |axis: usize| {
        let places = || last.grains.iter().map(|grain| grain.x[axis]);
        let (low, high) = (places().fold(f64::INFINITY, f64::min), places().fold(f64::NEG_INFINITY, f64::max));
        let name = ["x", "y", "z"][axis];
        if low > high { format!("{name} anywhere") } else { format!("{name} = {low:.4} to {high:.4}") }
    };
    Some(format!(
        "--region: no grain is in it in {empty} of {} snapshots; expected a region where grains are: in the last {}, {} and {} m",
        rows.len(),
        ends(0),
        ends(1),
        ends(2)
    ))
}

/// Prints notes for the user about finished work.
fn result_notes(rows: &[Row]) -> Vec<String> {
    let empty = rows.iter().filter(|row| row.n_grains == 0).count();
    if empty == 0 {
        vec![]
    } else {
        vec![format!("{empty} of {} snapshots hold no grain: their fields are empty", rows.len())]
    }
}

#[cfg(test)]
#[path = "../tests/samples/mod.rs"]
mod samples;

#[cfg(test)]
impl samples::Scene {
    fn frame(&self) -> Frame {
        let solid = |body| shapes::body_solid(body).expect("a cube").map(std::sync::Arc::new);
        let laws = self.snapshot.meta.laws.iter().map(|law| law.model().expect("a law of the table")).collect();
        Frame::with_solids(self.snapshot.clone(), self.records().0.iter().map(solid).collect(), laws)
    }
}
