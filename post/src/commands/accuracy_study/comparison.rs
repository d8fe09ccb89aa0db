//! Errors of the runs of one scene relative to the finest of them, and their tables and figure.

use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::compute::Accuracy;
use cd_formats::error::{Fault, Faults};
use cd_formats::names::rounded_number;
use cd_formats::snapshot::Snapshot;

use crate::commands::accuracy_study::bias::{MeanPair, OBSERVABLES};
use crate::derive::SeriesValue;
use crate::math::{FittedLine, median};
use crate::snapshots::list_snapshots;
use crate::tables::{
    TIMED_STAGES, blank_group_faults, case_names, check_series_of_run, is_at_or_after, name_faults, nearest_time,
    read_columns, read_log, same_time,
};
use crate::write::figure::{Curve, CurveMarks, Figure, FigureAxis};
use crate::write::series::name_field;

/// Columns of accuracy.csv after `run` and `group`: name, unit, meaning.
pub const COLUMNS: [(&str, &str, &str); 15] = [
    ("value", "-", "value of the option that the group varies"),
    ("seconds", "s", "all stages of all steps, without writing"),
    (
        "Z",
        "1",
        "relative error of the neighbours per grain, each snapshot's over the interval since the one before, mean over the snapshots that count",
    ),
    ("nu", "1", "relative error of the mean solid fraction; in a bed, that of the bed"),
    ("pressure", "1", "relative error of the mean pressure over the intervals; in a bed, that of the bed"),
    ("a", "1", "relative error of the longest semi-axis"),
    ("b", "1", "relative error of the middle semi-axis"),
    ("c", "1", "relative error of the shortest semi-axis"),
    ("energy", "1", "relative error of the energy, kinetic and potential"),
    (
        "positions_early",
        "1",
        "RMS distance of the bodies from their positions in the finest run, over their mean radius: at its first snapshot after the start, or from `--early` on",
    ),
    ("positions", "1", "the same at the end"),
    ("worst", "1", "largest error of Z, nu and pressure"),
    ("pressure_single", "1", "median error of that pressure at single snapshots, over its median in the finest run"),
    ("estimated", "1", "error estimate of the run: sum of ERRORS.csv"),
    ("single_over_estimated", "1", "pressure_single over estimated: more than 1 if the estimate is too small"),
];

/// Positions of the free bodies at one time.
#[derive(Debug, Clone)]
struct BodyPositions {
    /// Time, s.
    time: f64,
    /// Positions, m.
    x: Vec<[f64; 3]>,
}

/// Observables of a snapshot that are compared; NaN where one is not defined.
#[derive(Debug, Clone, Copy)]
struct Observables {
    /// Neighbours per grain, mean over the interval.
    z: f64,
    /// Solid fraction.
    nu: f64,
    /// Pressure, Pa, mean over the interval.
    pressure: f64,
    /// Semi-axes, m.
    semi_axes: [f64; 3],
    /// Kinetic and potential energy, J.
    energy: f64,
    /// Solid fraction of the bed.
    bed_nu: f64,
    /// Pressure of the bed, Pa, mean over the interval.
    bed_pressure: f64,
}

/// Observables of a snapshot at its time.
#[derive(Debug, Clone, Copy)]
struct SnapshotMeans {
    /// Time, s.
    time: f64,
    /// Time since the snapshot before, s; NaN if the snapshot does not contain it.
    interval: f64,
    observables: Observables,
}

impl SnapshotMeans {
    /// Whether means over the interval may be compared: those of a longer interval are larger if contacts open and close. A
    /// snapshot with an unknown interval has no such means, and so passes.
    fn has_same_interval(&self, other: &SnapshotMeans) -> bool {
        [self, other].iter().any(|means| means.interval.is_nan()) || same_time(self.interval, other.interval)
    }
}

/// Measured values of a run, before the comparison.
pub struct MeasuredRun {
    pub case: PathBuf,
    pub name: String,
    group: String,
    /// Value of the option that the group varies.
    value: f64,
    accuracy: Option<Accuracy>,
    /// Time step, s; NaN if the snapshot does not contain it.
    dt: f64,
    /// Time of all stages of all steps, s.
    seconds: f64,
    /// Snapshots, in the order of the series.
    observed: Vec<SnapshotMeans>,
    /// Error estimate of the run.
    estimated: f64,
    /// Positions in the last snapshot.
    end: BodyPositions,
    /// Mean radius of the free bodies, m.
    mean_radius: f64,
}

/// Errors of a run against the finest.
#[derive(Debug, Clone, PartialEq)]
pub struct RunErrors {
    pub name: String,
    pub group: String,
    pub row: ErrorRow,
    /// Means of [`OBSERVABLES`] and their differences from the finest; undefined in a table.
    pub pairs: [MeanPair; OBSERVABLES.len()],
    /// Time step, s; NaN in a table.
    pub dt: f64,
    /// Whether the run has `accuracy: reference`; not known from a table.
    pub is_reference: bool,
}

/// Values of a run, one for each of [`COLUMNS`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorRow {
    pub value: f64,
    pub seconds: f64,
    z: f64,
    nu: f64,
    pressure: f64,
    semi_axes: [f64; 3],
    energy: f64,
    positions_early: f64,
    positions: f64,
    worst: f64,
    pressure_single: f64,
    estimated: f64,
    single_over_estimated: f64,
}

/// One of the values of a run.
type ErrorValue = fn(&ErrorRow) -> f64;

impl ErrorRow {
    /// Values in the order of [`COLUMNS`].
    fn to_columns(self) -> [f64; COLUMNS.len()] {
        let ErrorRow { value, seconds, z, nu, pressure, semi_axes: [a, b, c], energy, .. } = self;
        let ErrorRow { positions_early, positions, worst, pressure_single, estimated, single_over_estimated, .. } =
            self;
        [
            value,
            seconds,
            z,
            nu,
            pressure,
            a,
            b,
            c,
            energy,
            positions_early,
            positions,
            worst,
            pressure_single,
            estimated,
            single_over_estimated,
        ]
    }

    /// Row of values in the order of [`COLUMNS`].
    fn from_columns(columns: [f64; COLUMNS.len()]) -> ErrorRow {
        let [value, seconds, z, nu, pressure, a, b, c, energy, ..] = columns;
        let [.., positions_early, positions, worst, pressure_single, estimated, single_over_estimated] = columns;
        ErrorRow {
            value,
            seconds,
            z,
            nu,
            pressure,
            semi_axes: [a, b, c],
            energy,
            positions_early,
            positions,
            worst,
            pressure_single,
            estimated,
            single_over_estimated,
        }
    }
}

/// Options of the comparison of the runs of a scene.
#[derive(Debug, Default)]
pub struct AccuracyStudyOptions<'a> {
    /// Name of the varied option of each case, in the order of the cases, or empty.
    pub groups: &'a [String],
    /// Value of that option in each case, in the order of the cases, or empty.
    pub values: &'a [f64],
    /// Start of the snapshots over whose means errors are taken, s; without it, the last snapshot alone.
    pub from: Option<f64>,
    /// Positions are compared at the first snapshot from this time on, s; without it, at the first after the start.
    pub early: Option<f64>,
    /// Table of `cd-pre study` with the parameters of the cases.
    pub parameters: Option<&'a Path>,
    /// Relative errors for which settings are recommended; empty for 3 %, 1 % and 0.3 %.
    pub errors: &'a [f64],
    /// Observables that shall have these errors, of `OBSERVABLES`; empty for Z, nu and pressure.
    pub observables: &'a [String],
}

/// Compares cases, or outputs of this command for several realisations of a scene. Also returns a description of the errors.
///
/// Errors: tables or snapshots that are missing or cannot be compared.
pub fn compare_folders(
    folders: &[PathBuf],
    selection: &AccuracyStudyOptions,
) -> Result<(Vec<RunErrors>, String), Faults> {
    let are_realisations = folders.iter().any(|folder| existing_table(folder).exists());
    if are_realisations { compare_realisations(folders, selection) } else { compare_runs(folders, selection) }
}

/// Writes accuracy.csv, orders.csv and accuracy.svg with this title. Returns messages for the user.
pub fn write_errors(compared: &[RunErrors], title: &str, output: &Path) -> Result<Vec<String>, Faults> {
    // The finest has no error.
    let has_error = |run: &&RunErrors| run.row.positions != 0.0 || run.row.worst != 0.0;
    let others: Vec<RunErrors> = compared.iter().filter(has_error).cloned().collect();
    atomic::write(&table_path(output), table_text(compared).as_bytes())?;
    atomic::write(&output.join("orders.csv"), order_table(&others).as_bytes())?;
    let figure = error_figure(&others, title);
    atomic::write(&output.join("accuracy.svg"), figure.to_svg().as_bytes())?;
    Ok(figure.repeated_style_warning().into_iter().collect())
}

fn table_path(folder: &Path) -> PathBuf {
    folder.join("accuracy.csv")
}

/// Table of the runs in a folder, also under the name of earlier versions.
fn existing_table(folder: &Path) -> PathBuf {
    let former = folder.join("trade.csv");
    if !table_path(folder).exists() && former.exists() { former } else { table_path(folder) }
}

/// Compares each case with the finest: the one of `accuracy: reference`, else the last. Also returns a description of the
/// errors.
fn compare_runs(cases: &[PathBuf], selection: &AccuracyStudyOptions) -> Result<(Vec<RunErrors>, String), Faults> {
    let &AccuracyStudyOptions { groups, values, .. } = selection;
    let mut faults = Faults::default();
    for (name, count) in [("--groups", groups.len()), ("--values", values.len())] {
        if count != 0 && count != cases.len() {
            let expected = format!("expected {}, one for each case", cases.len());
            faults.push(Fault::new(Path::new("options"), None, name, format!("{count} of them"), expected));
        }
    }
    let names = case_names(cases);
    faults.0.extend(name_faults("runs", &names, None));
    faults.0.extend(blank_group_faults(groups));
    let measured_run = |(k, case): (usize, &PathBuf)| -> Option<MeasuredRun> {
        let group = groups.get(k).cloned().unwrap_or_else(|| "all runs".into());
        faults.gather_result(measure_run(case, names[k].clone(), group, values.get(k).copied().unwrap_or(f64::NAN)))
    };
    let runs: Vec<MeasuredRun> = cases.iter().enumerate().filter_map(measured_run).collect();
    faults.into_result(())?;
    let finest = reference_index(&runs).unwrap_or(runs.len() - 1);
    Ok((compare_with(&runs, finest, selection)?, format!("errors against {}", runs[finest].name)))
}

/// Index of the run of `accuracy: reference`, if there is one.
pub fn reference_index(runs: &[MeasuredRun]) -> Option<usize> {
    runs.iter().position(|run| run.accuracy == Some(Accuracy::Reference))
}

/// Compares runs with the one at the index `finest`.
pub fn compare_with(
    runs: &[MeasuredRun],
    finest: usize,
    selection: &AccuracyStudyOptions,
) -> Result<Vec<RunErrors>, Faults> {
    let exact = ReferenceRun::new(&runs[finest], selection.from, selection.early)?;
    let mut faults = Faults::default();
    let compared: Vec<RunErrors> = runs.iter().filter_map(|run| faults.gather_result(exact.compare_run(run))).collect();
    faults.into_result(compared)
}

/// Compares realisations with the same runs in each: errors become root mean squares, seconds means.
fn compare_realisations(
    folders: &[PathBuf],
    selection: &AccuracyStudyOptions,
) -> Result<(Vec<RunErrors>, String), Faults> {
    let mut faults = Faults::default();
    let AccuracyStudyOptions { groups, values, from, early, .. } = selection;
    if !groups.is_empty() || !values.is_empty() || from.is_some() || early.is_some() {
        let found = "--groups, --values, --from or --early with folders that this command has written";
        faults.push(Fault::new(Path::new("options"), None, "accuracy-study", found, "expected --title and -o alone"));
    }
    let all: Vec<Vec<RunErrors>> =
        folders.iter().filter_map(|folder| faults.gather_result(read_table(&existing_table(folder)))).collect();
    faults.into_result(())?;
    let compared = average_realisations(folders, &all)?;
    Ok((compared, format!("RMS errors of {} realisations", all.len())))
}

/// Reads the runs from a table made by [`table_text`].
fn read_table(path: &Path) -> Result<Vec<RunErrors>, Faults> {
    let text = atomic::read_text(path)?;
    let mut lines = text.lines();
    // Name of earlier versions.
    let header = lines.next().unwrap_or_default().replace(",over_estimated", ",single_over_estimated");
    if header != table_header().trim_end() {
        let expected = "expected those of cd-post accuracy-study";
        return Err(Fault::new(path, Some(1), "table", "has other columns", expected).into());
    }
    let mut faults = Faults::default();
    let mut runs = Vec::new();
    for (number, line) in (2..).zip(lines) {
        let mut fields = line.split(',');
        let [name, group] = [(); 2].map(|()| fields.next().unwrap_or_default().to_string());
        let value = |field: &str| if field.is_empty() { Some(f64::NAN) } else { field.parse().ok() };
        match fields.map(value).collect::<Option<Vec<f64>>>().and_then(|values| values.try_into().ok()) {
            Some(columns) => {
                let row = ErrorRow::from_columns(columns);
                runs.push(RunErrors {
                    name,
                    group,
                    row,
                    pairs: [MeanPair::UNDEFINED; OBSERVABLES.len()],
                    dt: f64::NAN,
                    is_reference: false,
                });
            }
            None => faults.push(Fault::new(path, Some(number), "row", line, "expected a name, a group and numbers")),
        }
    }
    faults.into_result(runs)
}

/// Root mean square of each error over the realisations, and mean of the seconds; value and order of the runs are taken
/// from the first realisation.
pub fn average_realisations(folders: &[PathBuf], realisations: &[Vec<RunErrors>]) -> Result<Vec<RunErrors>, Faults> {
    let mut faults = Faults::default();
    let mismatch_fault = |folder: &Path, found: String| {
        let expected = format!("expected the runs of {}", folders[0].display());
        Fault::new(&existing_table(folder), None, "run", found, expected)
    };
    let row_of = |runs: &[RunErrors], name: &str| runs.iter().find(|run| run.name == name).map(|run| run.row);
    for (folder, runs) in folders.iter().zip(realisations) {
        for run in runs.iter().filter(|run| row_of(&realisations[0], &run.name).is_none()) {
            faults.push(mismatch_fault(folder, format!("{} as well", run.name)));
        }
    }
    let mut averages = Vec::new();
    for run in &realisations[0] {
        let errors_of = |(folder, runs): (&PathBuf, &Vec<RunErrors>)| {
            row_of(runs, &run.name).ok_or_else(|| Faults::from(mismatch_fault(folder, format!("no {}", run.name))))
        };
        let rows: Vec<ErrorRow> =
            folders.iter().zip(realisations).filter_map(|each| faults.gather_result(errors_of(each))).collect();
        let mean = |figure: fn(ErrorRow) -> f64| rows.iter().map(|row| figure(*row)).sum::<f64>() / rows.len() as f64;
        let columns: Vec<_> = rows.iter().map(|row| row.to_columns()).collect();
        let root_mean_square =
            |k: usize| (columns.iter().map(|column| column[k] * column[k]).sum::<f64>() / columns.len() as f64).sqrt();
        let roots = ErrorRow::from_columns(std::array::from_fn(root_mean_square));
        let row = ErrorRow {
            value: run.row.value,
            seconds: mean(|row| row.seconds),
            worst: [roots.z, roots.nu, roots.pressure].into_iter().fold(f64::NAN, f64::max),
            single_over_estimated: roots.pressure_single / roots.estimated,
            ..roots
        };
        averages.push(RunErrors { row, ..run.clone() });
    }
    faults.into_result(averages)
}

/// Path of the series of a case.
fn series_path(case: &Path) -> PathBuf {
    case.join("POSTPRO/series.csv")
}

/// Measures a case from its series.csv, TIMER.csv, ERRORS.csv and snapshots.
pub fn measure_run(case: &Path, name: String, group: String, value: f64) -> Result<MeasuredRun, Faults> {
    let energies = ["n_grains", "Ec_mean", "E_grav", "E_uniform", "E_fields"];
    let shown = ["Z_interval", "nu", "pressure_interval", "a", "b", "c", "bed_nu", "bed_pressure_interval"];
    let series =
        read_columns(&series_path(case), &[&["step", "time", "interval"], &shown[..], &energies[..]].concat())?;
    let snapshot_means = |k: usize| {
        let [z, nu, pressure, a, b, c, bed_nu, bed_pressure] = shown.map(|name| series[name][k]);
        let [count, kinetic, gravity, uniform, fields] = energies.map(|name| series[name][k]);
        let energy = count * kinetic + (gravity + uniform + fields);
        let observables = Observables { z, nu, pressure, semi_axes: [a, b, c], energy, bed_nu, bed_pressure };
        SnapshotMeans { time: series["time"][k], interval: series["interval"][k], observables }
    };
    let timer = read_log(&case.join("TIMER.csv"), &TIMED_STAGES)?;
    let seconds = TIMED_STAGES.iter().flat_map(|stage| &timer[*stage]).sum();
    let all = list_snapshots(&case.join("OUTBOX"))?;
    let last = Snapshot::read(&all[all.len() - 1].1)?;
    check_series_of_run(case, &series, &last.meta)?;
    let free: Vec<usize> = (0..last.bodies.body_x.len()).filter(|&i| last.bodies.body_driven[i] == 0).collect();
    let mean_radius = free.iter().map(|&i| last.bodies.body_radius[i]).sum::<f64>() / free.len().max(1) as f64;
    Ok(MeasuredRun {
        case: case.to_path_buf(),
        name,
        group,
        value,
        accuracy: last.meta.parameters.accuracy,
        dt: last.meta.options.get("dt").and_then(|dt| dt.parse().ok()).unwrap_or(f64::NAN),
        seconds,
        observed: (0..series["time"].len()).map(snapshot_means).collect(),
        estimated: estimated_error(&case.join("ERRORS.csv"))?,
        end: free_positions(&last),
        mean_radius,
    })
}

/// Sum of the sources of error in ERRORS.csv.
fn estimated_error(path: &Path) -> Result<f64, Faults> {
    let text = atomic::read_text(path)?;
    let mut faults = Faults::default();
    let mut sum = 0.0;
    for (number, line) in (1..).zip(text.lines()).skip(1) {
        match line.split(',').nth(2).and_then(|error| error.parse::<f64>().ok()).filter(|error| error.is_finite()) {
            Some(error) => sum += error,
            None => {
                faults.push(Fault::new(path, Some(number), "row", line, "expected source,option,error,z_error,seconds"))
            }
        }
    }
    faults.into_result(sum)
}

/// Positions of the bodies without imposed components.
fn free_positions(snapshot: &Snapshot) -> BodyPositions {
    let bodies = &snapshot.bodies;
    let free = bodies.body_x.iter().zip(&bodies.body_driven).filter(|(_, driven)| **driven == 0);
    BodyPositions { time: snapshot.meta.time, x: free.map(|(x, _)| *x).collect() }
}

/// Positions of the free bodies in the first snapshot after the start and not before a time (s), if there is one; of
/// snapshots at that time the nearest, as in [`nearest_time`].
fn early_positions(case: &Path, from: f64) -> Result<Option<BodyPositions>, Faults> {
    let time_distance = |positions: &BodyPositions| (positions.time - from).abs();
    let mut best: Option<BodyPositions> = None;
    for (_, path) in &list_snapshots(&case.join("OUTBOX"))?[1..] {
        let found = free_positions(&Snapshot::read(path)?);
        let last = found.time >= from;
        if is_at_or_after(found.time, from)
            && best.as_ref().is_none_or(|best| time_distance(&found) < time_distance(best))
        {
            best = Some(found);
        }
        if last {
            break;
        }
    }
    Ok(best)
}

/// Ratio of the RMS distance to the mean radius; NaN at different times.
fn rms_distance(positions: &BodyPositions, others: &BodyPositions, radius: f64) -> f64 {
    if !same_time(positions.time, others.time) {
        return f64::NAN;
    }
    let (a, b) = (&positions.x, &others.x);
    let square = |(a, b): (&[f64; 3], &[f64; 3])| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>();
    (a.iter().zip(b).map(square).sum::<f64>() / a.len() as f64).sqrt() / radius
}

/// Description of the times (s) of a series, for a message about unexpected times.
fn times_text(times: &[f64]) -> String {
    match times {
        [] => "no snapshot".into(),
        [one] => format!("one at {} s", rounded_number(*one)),
        [first, .., last] => format!("{} from {} to {} s", times.len(), rounded_number(*first), rounded_number(*last)),
    }
}

/// Reference that runs are compared with.
struct ReferenceRun<'a> {
    finest: &'a MeasuredRun,
    /// Elements of [`MeasuredRun::observed`] of the snapshots that count.
    observed: Vec<SnapshotMeans>,
    early: Option<BodyPositions>,
}

impl ReferenceRun<'_> {
    /// Takes the snapshots from `from` (s) on, or the last, and the early positions from `early` (s) on, or the first.
    fn new(finest: &MeasuredRun, from: Option<f64>, early: Option<f64>) -> Result<ReferenceRun<'_>, Faults> {
        let times: Vec<f64> = finest.observed.iter().map(|means| means.time).collect();
        let nearest_snapshot_time = |time: f64| nearest_time(times.iter().copied(), time).unwrap_or(time);
        let from = from.map(nearest_snapshot_time).or(times.last().copied()).unwrap_or(f64::NAN);
        let observed: Vec<_> = finest.observed.iter().copied().filter(|means| means.time >= from).collect();
        if observed.is_empty() {
            let expected = "expected one at the time of --from or later";
            return Err(Fault::new(&series_path(&finest.case), None, "time", times_text(&times), expected).into());
        }
        Ok(ReferenceRun { finest, observed, early: early_positions(&finest.case, early.unwrap_or(0.0))? })
    }

    /// Compares a run with the reference. Errors if it cannot be compared: other bodies, or no snapshot at a time that
    /// counts or none after an equal interval.
    fn compare_run(&self, run: &MeasuredRun) -> Result<RunErrors, Faults> {
        let finest = self.finest;
        let mut faults = Faults::default();
        let [count, expected] = [run, finest].map(|run| run.end.x.len());
        if count != expected {
            let (found, expected) =
                (format!("{count} are free"), format!("expected {expected}, as in {}", finest.name));
            faults.push(Fault::new(&run.case.join("OUTBOX"), None, "bodies", found, expected));
        }
        let means_at = |time: f64| {
            let nearest = nearest_time(run.observed.iter().map(|means| means.time), time)?;
            run.observed.iter().find(|means| means.time == nearest)
        };
        let simultaneous_pairs: Vec<(&SnapshotMeans, &SnapshotMeans)> =
            self.observed.iter().filter_map(|exact| Some((means_at(exact.time)?, exact))).collect();
        let compared_pairs: Vec<(&Observables, &Observables)> = simultaneous_pairs
            .iter()
            .filter(|(found, exact)| found.has_same_interval(exact))
            .map(|(found, exact)| (&found.observables, &exact.observables))
            .collect();
        if let ([(found, exact), ..], []) = (&simultaneous_pairs[..], &compared_pairs[..]) {
            let found = format!("{} s at t = {} s", rounded_number(found.interval), rounded_number(found.time));
            let expected = format!(
                "expected {} s, as in {}: choose output_every so that output_every × dt is equal",
                rounded_number(exact.interval),
                finest.name
            );
            faults.push(Fault::new(&series_path(&run.case), None, "interval", found, expected));
        } else if compared_pairs.is_empty() {
            let times = |rows: &[SnapshotMeans]| times_text(&rows.iter().map(|means| means.time).collect::<Vec<_>>());
            let expected =
                format!("expected a time of the snapshots of {} that count, {}", finest.name, times(&self.observed));
            faults.push(Fault::new(&series_path(&run.case), None, "time", times(&run.observed), expected));
        }
        faults.into_result(())?;
        // Mean over the snapshots in which both have a value.
        let values_of = |value: &dyn Fn(&Observables) -> f64| {
            let values = compared_pairs.iter().map(|(found, exact)| (value(found), value(exact)));
            values.filter(|(found, exact)| found.is_finite() && exact.is_finite()).collect::<Vec<_>>()
        };
        let mean_pair = |value: &dyn Fn(&Observables) -> f64| {
            let values = values_of(value);
            let [error, sum] =
                values.iter().fold([0.0; 2], |[error, sum], (found, exact)| [error + (found - exact), sum + exact]);
            let count = values.len() as f64;
            MeanPair { difference: error / count, exact: sum / count }
        };
        let median_error = |value: &dyn Fn(&Observables) -> f64| {
            let error = median(values_of(value).iter().map(|(found, exact)| (found - exact).abs()));
            error / median(values_of(value).iter().map(|(_, exact)| exact.abs()))
        };
        let bed: [MeanPair; 2] = [mean_pair(&|o| o.bed_nu), mean_pair(&|o| o.bed_pressure)];
        // The ball around a bed depends on its highest grain: use the means of the bed.
        let is_bed = bed.iter().all(|pair| pair.relative_error().is_finite());
        let [nu, pressure] = if is_bed { bed } else { [mean_pair(&|o| o.nu), mean_pair(&|o| o.pressure)] };
        let [a, b, c] = [0, 1, 2].map(|k| mean_pair(&|o| o.semi_axes[k]));
        let pairs = [mean_pair(&|o| o.z), nu, pressure, a, b, c, mean_pair(&|o| o.energy)];
        let [z, nu, pressure, a, b, c, energy] = pairs.map(|pair| pair.relative_error());
        let pressure_single = median_error(&|o| if is_bed { o.bed_pressure } else { o.pressure });
        let positions_early = match &self.early {
            Some(exact) => early_positions(&run.case, exact.time)?
                .map_or(f64::NAN, |found| rms_distance(&found, exact, run.mean_radius)),
            None => f64::NAN,
        };
        let positions = rms_distance(&run.end, &finest.end, run.mean_radius);
        let worst = [z, nu, pressure].into_iter().filter(|error| error.is_finite()).fold(f64::NAN, f64::max);
        let row = ErrorRow {
            value: run.value,
            seconds: run.seconds,
            z,
            nu,
            pressure,
            semi_axes: [a, b, c],
            energy,
            positions_early,
            positions,
            worst,
            pressure_single,
            estimated: run.estimated,
            single_over_estimated: pressure_single / run.estimated,
        };
        let is_reference = run.accuracy == Some(Accuracy::Reference);
        Ok(RunErrors { name: run.name.clone(), group: run.group.clone(), row, pairs, dt: run.dt, is_reference })
    }
}

fn table_header() -> String {
    format!("run,group,{}\n", COLUMNS.map(|column| column.0).join(","))
}

/// Table with a row for each run; an empty field for an undefined value.
fn table_text(runs: &[RunErrors]) -> String {
    let mut text = table_header();
    for run in runs {
        let values: Vec<String> = run.row.to_columns().iter().map(SeriesValue::text).collect();
        text += &format!("{},{},{}\n", name_field(&run.name), name_field(&run.group), values.join(","));
    }
    text
}

/// Groups in the order of their first run, each with its runs.
fn grouped_runs(runs: &[RunErrors]) -> Vec<(&str, Vec<&RunErrors>)> {
    let mut groups: Vec<(&str, Vec<&RunErrors>)> = Vec::new();
    for run in runs {
        match groups.iter_mut().find(|(name, _)| *name == run.group) {
            Some((_, members)) => members.push(run),
            None => groups.push((&run.group, vec![run])),
        }
    }
    groups
}

/// Order table of the groups of three or more values, for the worst error and the error of the early positions: the
/// exponent of the error as a power of the value, and the factor of the time for a tenth of the error.
fn order_table(runs: &[RunErrors]) -> String {
    let mut text = String::from("group,runs,order,r2,digit,order_early,r2_early,digit_early\n");
    for (name, members) in grouped_runs(runs) {
        if members.len() < 3 {
            continue;
        }
        let line = |x: ErrorValue, y: ErrorValue| {
            let points: Vec<(f64, f64)> = members.iter().map(|run| (x(&run.row).ln(), y(&run.row).ln())).collect();
            FittedLine::least_squares(&points)
        };
        text += &format!("{},{}", name_field(name), members.len());
        for error in [(|row| row.worst) as ErrorValue, |row| row.positions_early] {
            let order = line(|row| row.value, error);
            let digit = line(error, |row| row.seconds).map(|cost| 10f64.powf(-cost.slope));
            for value in [order.as_ref().map(|order| order.slope), order.as_ref().map(|order| order.r2), digit] {
                text += &format!(",{}", value.unwrap_or(f64::NAN).text());
            }
        }
        text.push('\n');
    }
    text
}

/// Error against time: a curve for each group, named dots for single runs such as presets, and the runs that no other beats
/// in both.
fn error_figure(runs: &[RunErrors], title: &str) -> Figure {
    let point = |run: &RunErrors| (run.row.seconds, run.row.worst);
    let mut curves: Vec<Curve> = Vec::new();
    let mut front: Vec<(f64, f64)> = runs.iter().map(point).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut best = f64::INFINITY;
    front.retain(|(_, error)| {
        *error < best && {
            best = *error;
            true
        }
    });
    curves.push(Curve { name: "Pareto front".into(), points: front, marks: CurveMarks::Expected });
    for (name, members) in grouped_runs(runs) {
        let mut points: Vec<(f64, f64)> = members.into_iter().map(point).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let marks = if points.len() == 1 { CurveMarks::Named } else { CurveMarks::Line };
        curves.push(Curve { name: name.into(), points, marks });
    }
    // Named dots are drawn on top.
    curves.sort_by_key(|curve| curve.marks == CurveMarks::Named);
    Figure {
        title: title.into(),
        x: FigureAxis::logarithmic("time", "s"),
        y: FigureAxis::logarithmic("largest error of Z, ν, pressure", "1"),
        curves,
    }
}

/// Short table for the terminal; `errors`: description of the errors.
pub fn summary_text(runs: &[RunErrors], errors: &str) -> String {
    let shown: [(&str, ErrorValue); 7] = [
        ("seconds", |row| row.seconds),
        ("Z", |row| row.z),
        ("nu", |row| row.nu),
        ("pressure", |row| row.pressure),
        ("energy", |row| row.energy),
        ("positions", |row| row.positions),
        ("estimated", |row| row.estimated),
    ];
    let width = runs.iter().map(|run| run.name.chars().count()).max().unwrap_or(0).max(4);
    let mut text = format!("  {:width$}", "run");
    text.extend(shown.iter().map(|(name, _)| format!("  {name:>9}")));
    for run in runs {
        text += &format!("\n  {:width$}", run.name);
        text.extend(shown.iter().map(|(_, value)| match value(&run.row) {
            value if value.is_finite() => format!("  {value:>9.2e}"),
            _ => format!("  {:>9}", "-"),
        }));
    }
    let ratios = runs.iter().map(|run| run.row.single_over_estimated);
    let ratios: Vec<f64> = ratios.filter(|ratio| ratio.is_finite() && *ratio > 0.0).collect();
    let close = ratios.iter().filter(|ratio| (1.0 / 3.0..=3.0).contains(*ratio)).count();
    text += &format!("\n  {errors}");
    if !ratios.is_empty() {
        text += &format!("; {close} of {} estimates within a factor of 3", ratios.len());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(group: &str, value: f64, seconds: f64, error: f64) -> RunErrors {
        let undefined = ErrorRow::from_columns([f64::NAN; COLUMNS.len()]);
        let row = ErrorRow { value, seconds, worst: error, positions_early: error * error, ..undefined };
        let pairs = [MeanPair::UNDEFINED; OBSERVABLES.len()];
        RunErrors {
            name: format!("{group}{value}"),
            group: group.into(),
            row,
            pairs,
            dt: f64::NAN,
            is_reference: false,
        }
    }

    #[test]
    fn rows_have_the_order_of_the_columns() {
        let numbers: [f64; COLUMNS.len()] = std::array::from_fn(|k| k as f64);
        let row = ErrorRow::from_columns(numbers);
        assert_eq!(row.to_columns(), numbers);
        let place = |name: &str| COLUMNS.iter().position(|column| column.0 == name).unwrap() as f64;
        assert_eq!(
            (row.z, row.worst, row.single_over_estimated),
            (place("Z"), place("worst"), place("single_over_estimated"))
        );
        assert_eq!((row.semi_axes, row.positions), ([place("a"), place("b"), place("c")], place("positions")));
    }

    #[test]
    fn orders_and_prices_are_found() {
        // Second order, half the step takes twice the time: a digit costs the square root of ten; with fourth order, the
        // fourth root.
        let mut runs: Vec<RunErrors> = [1.0, 0.5, 0.25].map(|h| run("dt", h, 3.0 / h, h * h)).to_vec();
        runs.push(run("draft", f64::NAN, 1.0, 0.1));
        let text = order_table(&runs);
        let row: Vec<&str> = text.lines().nth(1).unwrap().split(',').collect();
        assert_eq!((text.lines().count(), row[0], row[1]), (2, "dt", "3"));
        let number = |k: usize| -> f64 { row[k].parse().unwrap() };
        for (k, expected) in [(2, 2.0), (3, 1.0), (4, 10f64.sqrt()), (5, 4.0), (6, 1.0), (7, 10f64.sqrt().sqrt())] {
            assert!((number(k) - expected).abs() < 1e-12, "{k}: {text}");
        }
    }

    #[test]
    fn estimates_are_judged_where_there_are_some() {
        let mut runs = [run("dt", 1.0, 1.0, 0.1)];
        let printed =
            |runs: &[RunErrors]| summary_text(runs, "errors against fine").lines().last().unwrap().to_string();
        assert_eq!(printed(&runs), "  errors against fine");
        runs[0].row.single_over_estimated = 2.0;
        assert_eq!(printed(&runs), "  errors against fine; 1 of 1 estimates within a factor of 3");
    }

    #[test]
    fn what_another_beats_is_not_on_the_front() {
        let runs = [run("a", 1.0, 1.0, 0.1), run("a", 2.0, 2.0, 0.2), run("b", 1.0, 3.0, 0.01)];
        let figure = error_figure(&runs, "Error against time");
        assert_eq!(figure.curves[0].points, [(1.0, 0.1), (3.0, 0.01)]);
        assert_eq!(
            figure.curves.iter().map(|curve| curve.marks).collect::<Vec<_>>()[1..],
            [CurveMarks::Line, CurveMarks::Named]
        );
        assert!(figure.to_svg().contains("time (s)"));
    }

    #[test]
    fn realisations_are_root_mean_squares() {
        let [mut one, mut other] = [run("dt", 2.0, 1.0, 0.0), run("dt", 2.0, 3.0, 0.0)];
        for (run, errors) in [(&mut one, [0.3, 0.01, 0.02]), (&mut other, [0.4, 0.07, 0.02])] {
            [run.row.z, run.row.nu, run.row.pressure] = errors;
        }
        let folder = tempfile::tempdir().unwrap();
        let folders = ["a", "b"].map(|name| folder.path().join(name));
        for (folder, run) in folders.iter().zip([&one, &other]) {
            atomic::write(&table_path(folder), table_text(std::slice::from_ref(run)).as_bytes()).unwrap();
        }
        let all: Vec<Vec<RunErrors>> = folders.iter().map(|folder| read_table(&table_path(folder)).unwrap()).collect();
        let found = &average_realisations(&folders, &all).unwrap()[0];
        // (0.3² + 0.4²)/2 = 0.125, (0.01² + 0.07²)/2 = 0.05²; rounding of a few operations.
        let row = &found.row;
        for (value, expected) in
            [(row.value, 2.0), (row.seconds, 2.0), (row.z, 0.125f64.sqrt()), (row.nu, 0.05), (row.pressure, 0.02)]
        {
            assert!((value - expected).abs() < 1e-15, "{value} {expected}");
        }
        assert_eq!(found.row.worst, found.row.z);
        // Others than the runs of the first, and what is no table of them.
        let printed =
            average_realisations(&folders, &[vec![one], vec![run("tol", 1.0, 1.0, 1.0)]]).unwrap_err().to_string();
        let printed: Vec<&str> = printed.lines().collect();
        let says = |line: &str, found: &str| {
            line.ends_with(&format!("b/accuracy.csv: run: {found}; expected the runs of {}", folders[0].display()))
        };
        assert!(printed.len() == 2 && says(printed[0], "tol1 as well") && says(printed[1], "no dt2"), "{printed:?}");
        atomic::write(&table_path(&folders[1]), format!("{}x,y,1\n", table_header()).as_bytes()).unwrap();
        assert!(
            read_table(&table_path(&folders[1]))
                .unwrap_err()
                .to_string()
                .contains("accuracy.csv:2: row: x,y,1; expected")
        );
    }

    fn observables(z: f64, pressure: f64) -> Observables {
        let (bed_nu, bed_pressure) = (f64::NAN, f64::NAN);
        Observables { z, nu: 0.5, pressure, semi_axes: [3.0, 2.0, 1.0], energy: -1.0, bed_nu, bed_pressure }
    }

    /// A run of two bodies with one row in its series, at the time at which it ends, s.
    fn measured_run(time: f64, pressure: f64, x: f64) -> MeasuredRun {
        MeasuredRun {
            case: "run".into(),
            name: "run".into(),
            group: String::new(),
            value: f64::NAN,
            accuracy: None,
            dt: f64::NAN,
            seconds: 1.0,
            observed: vec![SnapshotMeans { time, interval: 0.5, observables: observables(4.0, pressure) }],
            estimated: 0.01,
            end: BodyPositions { time, x: vec![[0.0, 0.0, x], [0.0; 3]] },
            mean_radius: 2.0,
        }
    }

    #[test]
    fn errors_are_relative_to_the_finest() {
        let finest = measured_run(1.0, 1.0, 0.0);
        let exact = ReferenceRun { finest: &finest, observed: finest.observed.clone(), early: None };
        let found = exact.compare_run(&measured_run(1.0, 1.02, 0.2)).unwrap();
        // Rounding of a few operations.
        let row = &found.row;
        for (value, expected) in [
            (row.pressure, 0.02),
            (row.worst, 0.02),
            (row.z, 0.0),
            (row.positions, 0.1 / 2f64.sqrt()),
            (row.single_over_estimated, 2.0),
        ] {
            assert!((value - expected).abs() < 1e-12, "{value} {expected}");
        }
        // For a bed its own solid fraction and pressure count.
        let bed = |nu: f64, pressure: f64| {
            let mut run = measured_run(1.0, 1.0, 0.0);
            let observables = &mut run.observed[0].observables;
            (observables.bed_nu, observables.bed_pressure) = (nu, pressure);
            run
        };
        let finest = bed(0.5, 8.0);
        let exact = ReferenceRun { finest: &finest, observed: finest.observed.clone(), early: None };
        let found = exact.compare_run(&bed(0.75, 9.0)).unwrap();
        assert_eq!([found.row.nu, found.row.pressure, found.row.worst], [0.5, 0.125, 0.5]);
    }

    #[test]
    fn means_count_where_intervals_are_equal_and_both_have_a_value() {
        let at = |time: f64, interval: f64, z: f64, pressure: f64| SnapshotMeans {
            time,
            interval,
            observables: observables(z, pressure),
        };
        let of = |rows: &[SnapshotMeans]| MeasuredRun { observed: rows.to_vec(), ..measured_run(3.0, 1.0, 0.0) };
        // The first has no pressure, the second follows another interval; of the rest pressures of 3 against 2.
        let finest = of(&[at(1.0, 1.0, 4.0, f64::NAN), at(2.0, 1.0, 4.0, 9.0), at(3.0, 1.0, 4.0, 2.0)]);
        let exact = ReferenceRun { finest: &finest, observed: finest.observed.clone(), early: None };
        let found = exact.compare_run(&of(&[at(1.0, 1.0, 5.0, 9.0), at(2.0, 0.5, 9.0, 1.0), at(3.0, 1.0, 5.0, 3.0)]));
        let found = found.unwrap();
        assert_eq!(
            [found.row.z, found.row.pressure, found.row.worst, found.row.pressure_single],
            [0.25, 0.5, 0.5, 0.5]
        );
        let faults = exact.compare_run(&of(&[at(3.0, 0.5, 4.0, 2.0)])).unwrap_err().to_string();
        let expected = "run/POSTPRO/series.csv: interval: 0.5 s at t = 3 s; \
                        expected 1 s, as in run: choose output_every so that output_every × dt is equal";
        assert_eq!(faults, expected);
        // A snapshot without its interval has no means over it; the rest is compared.
        let found = exact.compare_run(&of(&[at(3.0, f64::NAN, f64::NAN, f64::NAN)])).unwrap();
        assert!(found.row.z.is_nan() && found.row.nu == 0.0);
    }

    #[test]
    fn late_in_a_run_times_are_the_nearest() {
        let mut run = measured_run(1e7, 1.0, 0.0);
        let row = run.observed[0];
        run.observed.extend((1..4).map(|k| {
            let mut row = row;
            row.time += f64::from(k);
            row.observables.pressure += f64::from(k);
            row
        }));
        let exact = ReferenceRun { finest: &run, observed: run.observed.clone(), early: None };
        let found = exact.compare_run(&run).unwrap();
        assert_eq!((found.row.worst, found.row.pressure_single), (0.0, 0.0));
    }

    #[test]
    fn what_is_not_shared_is_no_agreement() {
        let finest = measured_run(2.0, 1.0, 0.0);
        let exact = ReferenceRun { finest: &finest, observed: finest.observed.clone(), early: None };
        // The run ends earlier but contains the time that counts; its other values are undefined.
        let mut short = measured_run(1.0, 1.0, 0.0);
        let undefined =
            Observables { nu: f64::NAN, semi_axes: [f64::NAN; 3], energy: f64::NAN, ..observables(f64::NAN, f64::NAN) };
        short.observed.push(SnapshotMeans { time: 2.0, interval: 0.5, observables: undefined });
        let found = exact.compare_run(&short).unwrap();
        assert!(found.row.positions.is_nan() && found.row.worst.is_nan());
        let front =
            error_figure(&[found], "").curves.into_iter().find(|curve| curve.marks == CurveMarks::Expected).unwrap();
        assert!(front.points.is_empty());
        // Another time and another number of bodies.
        let mut other = measured_run(1.0, 1.0, 0.0);
        other.end.x.pop();
        let faults = exact.compare_run(&other).unwrap_err().to_string();
        let expected = "run/OUTBOX: bodies: 1 are free; expected 2, as in run\n\
                        run/POSTPRO/series.csv: time: one at 1 s; expected a time of the snapshots of run that count, one at 2 s";
        assert_eq!(faults, expected);
    }
}
