//! `cd-post study`: many runs, each by its mean values over the end, and their dependence on the number of grains.

use std::path::{Path, PathBuf};

use cd_formats::atomic::{self, path_exists};
use cd_formats::error::{Fault, Faults};
use cd_formats::names::{count_text, number_text, rounded_number};
use cd_formats::ron_text::known_names;
use cd_formats::snapshot::Snapshot;

use crate::commands::replicates::{Replicate, ReplicateTables};
use crate::derive::{Row, SeriesValue};
use crate::math::FittedLine;
use crate::snapshots::list_snapshots;
use crate::tables::{
    Columns, TIMED_STAGES, blank_group_faults, case_names, check_series_of_run, name_faults, nearest_time,
    read_columns, read_log,
};
use crate::write::figure::{Curve, CurveMarks, Figure, FigureAxis};
use crate::write::series::{csv_text, name_field};

/// Stages of a step in TIMER.csv, as the figure of the cost has them.
const STEP_STAGES: [(&str, &[&str]); 3] =
    [("gravity", &["gravity"]), ("detection", &["detection"]), ("contacts", &["assembly", "solve"])];

/// Columns of runs.csv in addition to the columns of series.csv: name, unit, meaning.
pub const COLUMNS: [(&str, &str, &str); 10] = [
    (
        "pressure_homogeneous",
        "Pa",
        "mean pressure 3 G M² / (20 π R⁴) of a homogeneous ball of the mass and of R_enclosing",
    ),
    (
        "pressure_by_inertia",
        "1",
        "5 p V R_i / (G M²), V the enclosing ball, R_i = (a b c)^(1/3): pressure over that of a homogeneous ball of the same mass and moments of inertia, both over V",
    ),
    (
        "Z_isostatic",
        "1",
        "6 - 12 / N: of rigid frictionless spheres at rest, all of them held, without a force from outside; empty of fewer than three",
    ),
    ("sweeps", "1", "sweeps of the contact solver per step, over the whole run"),
    ("contacts", "1", "contacts that carry force per step, over the whole run"),
    ("unconverged", "1", "share of the steps that end above their tolerance, over the whole run"),
    ("seconds_gravity", "s", "per step, over the whole run"),
    ("seconds_detection", "s", ""),
    ("seconds_contacts", "s", "assembly and solution of the contact problem"),
    ("seconds", "s", "all stages"),
];

/// Selection of the runs and of the snapshots over which their means are taken.
#[derive(Debug, Default)]
pub struct StudyOptions<'a> {
    /// Group of each case, which the figures distinguish; empty for a single group.
    pub groups: &'a [String],
    /// Parameters whose values are the groups, in place of `groups`.
    pub grouping: &'a [String],
    /// Table of `cd-pre study` with the parameters of the cases.
    pub parameters: Option<&'a Path>,
    /// Start of the snapshots over which means are taken, s; without it, the last snapshot alone.
    pub from: Option<f64>,
    /// End of these snapshots, s.
    pub to: Option<f64>,
    /// Half the width of the 95 % confidence interval of a mean that is requested, over the mean.
    pub error: f64,
}

/// Parameter of a study that numbers the replicates.
pub const SEED: &str = "seed";

/// Quantities of which the summary says how many replicates they need.
const SUMMARY_QUANTITIES: [&str; 3] = ["Z", "nu", "pressure"];

/// Cases, with the values of their parameters as in the table of a study.
#[derive(Debug, Default, PartialEq)]
pub struct StudyCases {
    pub folders: Vec<PathBuf>,
    /// Names of the parameters, in the order of the tables.
    pub names: Vec<String>,
    /// Values of the parameters of each case, empty where it has none of that name.
    pub values: Vec<Vec<String>>,
}

/// Whether a path is that of a table of `cd-pre study`, there or not, and not of a case.
pub fn is_study_table(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == "csv") && !path.is_dir()
}

impl StudyCases {
    /// Cases of the folders and tables of a command line; `parameters`: table with the parameters of the folders.
    ///
    /// Errors: tables that cannot be read, and folders that are not in the table of the parameters.
    pub fn new(paths: &[PathBuf], parameters: Option<&Path>) -> Result<StudyCases, Faults> {
        let mut faults = Faults::default();
        let mut all = StudyCases::default();
        let known = parameters.and_then(|path| faults.gather_result(StudyCases::read(path)));
        for path in paths {
            if is_study_table(path) {
                faults.gather_result(StudyCases::read(path)).into_iter().for_each(|cases| all.append(cases));
                continue;
            }
            let full_path = |folder: &Path| std::fs::canonicalize(folder).ok();
            let found = known.as_ref().and_then(|known| {
                let row = known
                    .folders
                    .iter()
                    .position(|folder| full_path(folder).is_some_and(|full| full_path(path) == Some(full)));
                Some((known, row?))
            });
            match (found, parameters) {
                (Some((known, row)), _) => all.append(StudyCases {
                    folders: vec![path.clone()],
                    names: known.names.clone(),
                    values: vec![known.values[row].clone()],
                }),
                (None, Some(table)) if known.is_some() => {
                    let found = format!("{} is not one of its cases", path.display());
                    faults.push(Fault::new(table, None, "table", found, "expected its folder in the column case"));
                }
                _ => all.append(StudyCases { folders: vec![path.clone()], names: vec![], values: vec![vec![]] }),
            }
        }
        faults.into_result(all)
    }

    /// Reads a table of `cd-pre study`: the columns `case` and `from`, then one for each parameter. Folders of cases are
    /// relative to the folder of the table.
    fn read(path: &Path) -> Result<StudyCases, Faults> {
        let text = atomic::read_text(path)?;
        let mut lines = text.lines();
        let header = csv_cells(lines.next().unwrap_or_default());
        if header.len() < 2 || header[..2] != ["case", "from"] {
            let expected = "expected a table that cd-pre study has written, with the columns case and from";
            return Err(Fault::new(path, Some(1), "table", "has other columns", expected).into());
        }
        let table_folder = path.parent().unwrap_or(Path::new(""));
        let mut cases = StudyCases { names: header[2..].to_vec(), ..StudyCases::default() };
        let mut faults = Faults::default();
        for (number, line) in (2..).zip(lines) {
            let cells = csv_cells(line);
            if cells.len() != header.len() {
                faults.push(Fault::new(path, Some(number), "row", line, format!("expected {} fields", header.len())));
                continue;
            }
            cases.folders.push(table_folder.join(&cells[0]));
            cases.values.push(cells[2..].to_vec());
        }
        if cases.folders.is_empty() && faults.0.is_empty() {
            faults.push(Fault::new(path, None, "table", "has no cases", "expected at least one"));
        }
        faults.into_result(cases)
    }

    /// Adds cases; parameters of equal names share a column.
    fn append(&mut self, other: StudyCases) {
        for name in &other.names {
            if !self.names.contains(name) {
                self.names.push(name.clone());
            }
        }
        self.values.iter_mut().for_each(|values| values.resize(self.names.len(), String::new()));
        for values in &other.values {
            let value = |name: &String| other.names.iter().position(|known| known == name).map(|k| values[k].clone());
            self.values.push(self.names.iter().map(|name| value(name).unwrap_or_default()).collect());
        }
        self.folders.extend(other.folders);
    }

    /// Group of each case: the values of these `parameters`.
    fn groups_by(&self, parameters: &[String]) -> Result<Vec<String>, Faults> {
        let mut faults = Faults::default();
        let known: Vec<&str> = self.names.iter().map(String::as_str).collect();
        let mut columns = Vec::new();
        for name in parameters {
            match self.names.iter().position(|known| known == name) {
                Some(column) => columns.push(column),
                None => {
                    let found = format!("{name} is not a parameter of the study");
                    faults.push(Fault::new(Path::new("options"), None, "--by", found, known_names(name, &known)));
                }
            }
        }
        let group = |values: &Vec<String>| {
            let part = |column: &usize| format!("{} {}", self.names[*column], values[*column]).trim_end().to_string();
            columns.iter().map(part).collect::<Vec<_>>().join(", ")
        };
        faults.into_result(self.values.iter().map(group).collect())
    }

    /// Names of the columns of the parameters in runs.csv: with a prefix if another column has the name.
    fn column_names(&self) -> Vec<String> {
        let known = ["run", "group"].into_iter().chain(Row::COLUMNS.iter().chain(&COLUMNS).map(|(name, _, _)| *name));
        let known: Vec<&str> = known.collect();
        let column =
            |name: &String| if known.contains(&name.as_str()) { format!("study_{name}") } else { name.clone() };
        self.names.iter().map(column).collect()
    }
}

/// Cells of a line of CSV; a cell in quotes may contain commas, and quotes twice.
fn csv_cells(line: &str) -> Vec<String> {
    let mut cells = vec![String::new()];
    let mut quoted = false;
    let mut letters = line.chars().peekable();
    while let Some(letter) = letters.next() {
        let cell = cells.last_mut().expect("a cell");
        match letter {
            '"' if quoted && letters.peek() == Some(&'"') => {
                cell.push('"');
                letters.next();
            }
            '"' => quoted = !quoted,
            ',' if !quoted => cells.push(String::new()),
            other => cell.push(other),
        }
    }
    cells
}

/// Mean values of a run.
struct StudyRun {
    name: String,
    group: String,
    /// Values of the parameters of the study.
    parameters: Vec<String>,
    /// Values, in the order of [`Row::COLUMNS`], then of [`COLUMNS`].
    values: Vec<f64>,
}

impl StudyRun {
    fn value_of(&self, name: &str) -> f64 {
        let names = Row::COLUMNS.iter().chain(&COLUMNS).map(|(name, _, _)| *name);
        names.zip(&self.values).find(|(known, _)| *known == name).map_or(f64::NAN, |(_, value)| *value)
    }
}

/// Summary of a study, as [`write()`] has written it.
pub struct StudySummary {
    /// Number of runs.
    pub runs: usize,
    /// Number of figures.
    pub figures: usize,
    /// Line about the means over replicates, if there are any.
    pub replicates: Option<String>,
    /// Messages for the user.
    pub notes: Vec<String>,
}

/// Measures each case from its series.csv, steps.csv, TIMER.csv and last snapshot, and writes the table of the runs, the
/// table of the fitted lines, and the figures. `paths`: case folders, and tables of `cd-pre study` for all of their cases.
///
/// Errors: another number of groups than of cases, names
/// that are repeated or blank, and the faults of the cases' files.
pub fn write(paths: &[PathBuf], options: &StudyOptions, output: &Path) -> Result<StudySummary, Faults> {
    let study = StudyCases::new(paths, options.parameters)?;
    let cases = &study.folders;
    let groups = study.groups_by(options.grouping)?;
    let groups = if options.grouping.is_empty() { options.groups } else { &groups };
    let mut faults = Faults::default();
    if !groups.is_empty() && groups.len() != cases.len() {
        let expected = format!("expected {}, one for each case", cases.len());
        faults.push(Fault::new(Path::new("options"), None, "--groups", format!("{} names", groups.len()), expected));
    }
    let names = case_names(cases);
    faults.0.extend(name_faults("runs", &names, None));
    faults.0.extend(blank_group_faults(groups));
    let mut runs = Vec::new();
    for (k, case) in cases.iter().enumerate() {
        let group = groups.get(k).cloned().unwrap_or_else(|| "all runs".into());
        let name = names[k].clone();
        let parameters = study.values[k].clone();
        runs.extend(faults.gather_result(measure_run(case, options.from, options.to)).map(|values| StudyRun {
            name,
            group,
            parameters,
            values,
        }));
    }
    faults.into_result(())?;
    let mut group_names: Vec<&str> = Vec::new();
    for run in &runs {
        if !group_names.contains(&run.group.as_str()) {
            group_names.push(&run.group);
        }
    }
    let StudyPlots { figures, fits, .. } = StudyPlots::new(&runs, &group_names);
    atomic::write(&output.join("runs.csv"), table_text(&runs, &study.column_names()).as_bytes())?;
    atomic::write(&output.join("fits.csv"), fits.as_bytes())?;
    let replicates = replicate_tables(&study, &runs, options);
    let [means, differences] = ["means.csv", "differences.csv"].map(|name| output.join(name));
    if let Some(tables) = &replicates {
        atomic::write(&means, tables.means.as_bytes())?;
        atomic::write(&differences, tables.differences.as_bytes())?;
    } else {
        // Those of other runs would not belong to runs.csv.
        for path in [means, differences].iter().filter(|path| path_exists(path)) {
            std::fs::remove_file(path).map_err(|error| Fault::from_io(path, "removed", &error))?;
        }
    }
    for (name, figure) in &figures {
        atomic::write(&output.join(format!("{name}.svg")), figure.to_svg().as_bytes())?;
    }
    // Most figures have the same groups.
    let mut notes: Vec<String> = figures.iter().filter_map(|(_, figure)| figure.repeated_style_warning()).collect();
    notes.sort();
    notes.dedup();
    let summary = replicates.map(|tables| needed_text(&tables, options.error));
    Ok(StudySummary { runs: runs.len(), figures: figures.len(), replicates: summary, notes })
}

/// Columns of runs.csv with the values of runs.
fn quantity_names() -> Vec<&'static str> {
    Row::COLUMNS.iter().chain(&COLUMNS).map(|(name, _, _)| *name).collect()
}

/// Means and differences of the sets of parameters, if the study has seeds or its runs have groups; `None` if no set has two
/// runs.
fn replicate_tables(study: &StudyCases, runs: &[StudyRun], options: &StudyOptions) -> Option<ReplicateTables> {
    let has_groups = !options.groups.is_empty();
    if !study.names.iter().any(|name| name == SEED) && !has_groups {
        return None;
    }
    let columns = study.column_names();
    let replicate = |run: &'_ StudyRun| -> (Vec<(String, String)>, String) {
        let columns_and_values = || columns.iter().zip(&study.names).zip(&run.parameters);
        let group = has_groups.then(|| ("group".to_string(), run.group.clone()));
        let others = columns_and_values()
            .filter(|((_, name), _)| *name != SEED)
            .map(|((column, _), value)| (column.clone(), value.clone()));
        let seed =
            columns_and_values().find(|((_, name), _)| *name == SEED).map_or(String::new(), |(_, seed)| seed.clone());
        (group.into_iter().chain(others).collect(), seed)
    };
    let texts: Vec<_> = runs.iter().map(replicate).collect();
    let replicates: Vec<Replicate> = texts
        .iter()
        .zip(runs)
        .map(|((parameters, seed), run)| Replicate {
            parameters: parameters.iter().map(|(name, value)| (name.as_str(), value.as_str())).collect(),
            seed,
            values: &run.values,
        })
        .collect();
    ReplicateTables::new(&replicates, &quantity_names(), options.error)
}

/// Line of the summary: how many replicates the means of [`SUMMARY_QUANTITIES`] need.
fn needed_text(tables: &ReplicateTables, error: f64) -> String {
    let names = quantity_names();
    let needed = |name: &str| {
        let needed = tables.needed[names.iter().position(|known| *known == name)?];
        let number = needed.map_or("more than can be run".to_string(), |needed| needed.to_string());
        (needed != Some(0)).then(|| format!("{name} {number}"))
    };
    let needed: Vec<String> = SUMMARY_QUANTITIES.into_iter().filter_map(needed).collect();
    let sets = count_text(tables.sets, "parameter set");
    let percent = rounded_number(100.0 * error);
    format!("means of {sets}; replicates of each for 95 % within {percent} % of the mean: {}", needed.join(", "))
}

/// Values of a run.
fn measure_run(case: &Path, from: Option<f64>, to: Option<f64>) -> Result<Vec<f64>, Faults> {
    let path = case.join("POSTPRO/series.csv");
    let needed = ["step", "time", "n_grains", "mass", "R_enclosing", "a", "b", "c", "pressure_sphere"];
    let series = read_columns(&path, &needed)?;
    let times = &series["time"];
    let nearest_snapshot_time = |time: f64| nearest_time(times.iter().copied(), time).unwrap_or(time);
    let to = to.map_or(f64::INFINITY, nearest_snapshot_time);
    let last = times.iter().copied().filter(|time| *time <= to).fold(f64::NAN, f64::max);
    let counted_times = from.map_or(last, nearest_snapshot_time)..=to;
    let counted: Vec<usize> = (0..times.len()).filter(|&k| counted_times.contains(&times[k])).collect();
    if counted.is_empty() {
        let found = times.last().map_or("has no snapshot".into(), |time| format!("ends at {} s", number_text(*time)));
        let end = if to.is_finite() { format!(" to --until {} s", number_text(to)) } else { String::new() };
        let expected = match from {
            Some(from) => format!("expected a snapshot from --from {} s{end}", number_text(from)),
            None => format!("expected a snapshot{end}"),
        };
        return Err(Fault::new(&path, None, "time", found, expected).into());
    }
    let mean = |name: &str| {
        let column = series.get(name).map_or(&[][..], |column| column);
        if name == "region" {
            return counted.last().and_then(|&k| column.get(k)).copied().unwrap_or(f64::NAN); // a number without means
        }
        let known: Vec<f64> =
            counted.iter().filter_map(|&k| column.get(k).copied()).filter(|x| x.is_finite()).collect();
        known.iter().sum::<f64>() / known.len() as f64
    };
    let mut values: Vec<f64> = Row::COLUMNS.iter().map(|(name, _, _)| mean(name)).collect();

    let outbox = case.join("OUTBOX");
    let steps = read_log(&outbox.join("steps.csv"), &["sweeps", "contacts_active", "converged"])?;
    let timed = [&TIMED_STAGES[..], &["writing"]].concat();
    let timer = read_log(&case.join("TIMER.csv"), &timed)?;
    // A row is a step, or as many as it says: sums over these, but for the contacts of the last of them.
    let steps_of = |table: &Columns, k: usize| table.get("steps").map_or(1.0, |steps| steps[k]).max(1.0);
    let number = |table: &Columns, rows: usize| (0..rows).map(|k| steps_of(table, k)).sum::<f64>();
    let per_step = |table: &Columns, name: &str| table[name].iter().sum::<f64>() / number(table, table[name].len());
    let weighted_mean = |table: &Columns, name: &str| {
        let column = table[name].iter().enumerate().map(|(k, x)| x * steps_of(table, k));
        column.sum::<f64>() / number(table, table[name].len())
    };
    let all = list_snapshots(&outbox)?;
    let end = Snapshot::read(&all[all.len() - 1].1)?.meta;
    check_series_of_run(case, &series, &end)?;
    let parameters = end.parameters;
    let constant = if parameters.self_gravity { parameters.gravity_constant } else { f64::NAN };
    let homogeneous: f64 = counted
        .iter()
        .map(|&k| {
            3.0 * constant * series["mass"][k].powi(2)
                / (20.0 * std::f64::consts::PI * series["R_enclosing"][k].powi(4))
        })
        .sum::<f64>()
        / counted.len() as f64;
    let by_inertia: f64 = counted
        .iter()
        .map(|&k| {
            let value = |name: &str| series[name][k];
            let volume = 4.0 / 3.0 * std::f64::consts::PI * value("R_enclosing").powi(3);
            let radius = (value("a") * value("b") * value("c")).cbrt();
            5.0 * value("pressure_sphere") * volume * radius / (constant * value("mass").powi(2))
        })
        .sum::<f64>()
        / counted.len() as f64;
    let stage = |names: &[&str]| names.iter().map(|name| per_step(&timer, name)).sum::<f64>();
    values.push(homogeneous);
    values.push(by_inertia);
    values.push(isostatic_number(mean("n_grains")));
    values.push(per_step(&steps, "sweeps"));
    values.push(weighted_mean(&steps, "contacts_active"));
    values.push(1.0 - per_step(&steps, "converged"));
    values.extend(STEP_STAGES.iter().map(|(_, names)| stage(names)));
    values.push(stage(&timed));
    Ok(values)
}

/// Neighbours per grain if 3 N - 6 contacts fix N spheres; NaN for two, which one contact fixes, and for one.
fn isostatic_number(grains: f64) -> f64 {
    if grains >= 3.0 { 6.0 - 12.0 / grains } else { f64::NAN }
}

/// Table with a row for each run: its name, its group, its parameters of these names, then all values; an empty field for
/// an undefined value.
fn table_text(runs: &[StudyRun], parameters: &[String]) -> String {
    let names = ["run", "group"].map(String::from).into_iter().chain(parameters.iter().map(|name| name_field(name)));
    let names: Vec<String> =
        names.chain(Row::COLUMNS.iter().chain(&COLUMNS).map(|(name, _, _)| name.to_string())).collect();
    let mut text = names.join(",") + "\n";
    for run in runs {
        let texts = [&run.name, &run.group].into_iter().chain(&run.parameters).map(|value| name_field(value));
        let fields: Vec<String> = texts.chain(run.values.iter().map(SeriesValue::text)).collect();
        text += &(fields.join(",") + "\n");
    }
    text
}

/// Figures of a study, and the table of the lines that are fitted in them.
struct StudyPlots<'a> {
    runs: &'a [StudyRun],
    groups: &'a [&'a str],
    /// Figures by name.
    figures: Vec<(String, Figure)>,
    /// Text of fits.csv.
    fits: String,
}

impl<'a> StudyPlots<'a> {
    fn new(runs: &'a [StudyRun], groups: &'a [&'a str]) -> Self {
        let fits = String::from("figure,group,law,slope,intercept,r2\n");
        let mut plots = StudyPlots { runs, groups, figures: Vec::new(), fits };
        plots.add_surface_effects();
        plots.add_pressure();
        plots.add_costs();
        plots.add_sweeps();
        plots
    }

    /// Neighbours and solid fractions against N^(-1/3), with which the effect of a surface on the whole scales.
    fn add_surface_effects(&mut self) {
        let surface = |run: &StudyRun| run.value_of("n_grains").powf(-1.0 / 3.0);
        for (name, title, quantity) in [
            ("Z", "Neighbours per grain, at the end", "Z"),
            ("nu", "Solid fraction, at the end", "ν"),
            ("nu_sphere", "Solid fraction of the ball around all grains, at the end", "ν"),
        ] {
            let mut curves = Vec::new();
            for group in self.groups {
                let points = self.points(group, surface, |run| run.value_of(name));
                curves.push(marked_curve(group, points.clone(), CurveMarks::Dots));
                let Some(line) = FittedLine::least_squares(&points) else { continue };
                self.add_fit(name, group, &format!("{name} = intercept + slope N^(-1/3)"), line);
                let sign = if line.slope < 0.0 { "−" } else { "+" };
                let [intercept, slope] = [line.intercept, line.slope.abs()].map(three_digits);
                let largest = points.iter().map(|p| p.0).fold(0.0, f64::max);
                let ends = [0.0, largest].map(|x| (x, line.intercept + line.slope * x)).to_vec();
                curves.push(marked_curve(&format!("{intercept} {sign} {slope} N^(-1/3)"), ends, CurveMarks::Fit));
            }
            let axes = [FigureAxis::linear("N^(-1/3)", "1"), FigureAxis::linear(quantity, "1")];
            self.add_figure(name.into(), title.into(), axes, curves);
        }
    }

    /// Ratio of the mean pressure to that of a homogeneous ball of the same mass and radius.
    fn add_pressure(&mut self) {
        let homogeneous_pressure = |run: &StudyRun| run.value_of("pressure_homogeneous");
        let measured_pressure = |run: &StudyRun| run.value_of("pressure_sphere");
        let dots = |group: &&str| {
            marked_curve(group, self.points(group, homogeneous_pressure, measured_pressure), CurveMarks::Dots)
        };
        let mut curves: Vec<Curve> = self.groups.iter().map(dots).collect();
        let all = positive_points(self.runs.iter().map(|run| (homogeneous_pressure(run), measured_pressure(run))));
        if let Some(line) = FittedLine::least_squares(&logarithms(&all)) {
            self.add_fit("pressure", "all", "ln(pressure_sphere) = intercept + slope ln(pressure_homogeneous)", line);
        }
        let (low, high) = all.iter().fold((f64::INFINITY, 0f64), |(low, high), p| (low.min(p.0), high.max(p.0)));
        if low < high {
            curves.push(marked_curve("equal", vec![(low, low), (high, high)], CurveMarks::Expected));
        }
        let axes = [FigureAxis::logarithmic("3 G M² / (20 π R⁴)", "Pa"), FigureAxis::logarithmic("pressure", "Pa")];
        self.add_figure(
            "pressure".into(),
            "Mean pressure in the ball around all grains, at the end".into(),
            axes,
            curves,
        );
    }

    /// Time per step of each stage against the number of grains, in a figure for each group.
    fn add_costs(&mut self) {
        for group in self.groups {
            let name = if self.groups.len() == 1 { "cost".to_string() } else { self.group_figure("cost", group) };
            let mut curves = Vec::new();
            for (stage, _) in STEP_STAGES {
                let seconds = |run: &StudyRun| run.value_of(&format!("seconds_{stage}"));
                let points = positive_points(self.points(group, grain_count, seconds).into_iter());
                curves.push(marked_curve(stage, points.clone(), CurveMarks::Dots));
                let Some(line) = FittedLine::least_squares(&logarithms(&points)) else { continue };
                self.add_fit(&name, group, &format!("ln(seconds_{stage}) = intercept + slope ln(N)"), line);
                let fitted = points.iter().map(|&(n, _)| (n, (line.intercept + line.slope * n.ln()).exp())).collect();
                let text = format!("{stage}, N^{}", three_digits(line.slope));
                curves.push(marked_curve(&text, fitted, CurveMarks::Fit));
            }
            let axes = [FigureAxis::logarithmic("N", "1"), FigureAxis::logarithmic("time per step", "s")];
            self.add_figure(name, format!("Seconds per step by stage: {group}"), axes, curves);
        }
    }

    /// Name of the figure of one of several groups; the first free number if its own is too long, empty or another's, too.
    fn group_figure(&self, quantity: &str, group: &str) -> String {
        let words = group.split(|c: char| !c.is_alphanumeric() && !"._+-".contains(c)).filter(|word| !word.is_empty());
        let own_name = words.collect::<Vec<_>>().join("_");
        let is_free = |name: &String| self.figures.iter().all(|(other, _)| other.to_lowercase() != name.to_lowercase());
        std::iter::once(own_name)
            .filter(|name| (1..=100).contains(&name.len()))
            .chain((1..).map(|number: usize| number.to_string()))
            .map(|name| format!("{quantity}-{name}"))
            .find(is_free)
            .unwrap_or_default()
    }

    /// Sweeps of the contact solver against the number of grains.
    fn add_sweeps(&mut self) {
        let sweeps = |group: &&str| {
            let mut points = self.points(group, grain_count, |run| run.value_of("sweeps"));
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            Curve::line(group, points)
        };
        let curves = self.groups.iter().map(sweeps).collect();
        let axes = [FigureAxis::logarithmic("N", "1"), FigureAxis::logarithmic("sweeps per step", "1")];
        self.add_figure("sweeps".into(), "Sweeps of the contact solver per step".into(), axes, curves);
    }

    /// Two values of each run of a group.
    fn points(&self, group: &str, x: impl Fn(&StudyRun) -> f64, y: impl Fn(&StudyRun) -> f64) -> Vec<(f64, f64)> {
        self.runs.iter().filter(|run| run.group == group).map(|run| (x(run), y(run))).collect()
    }

    /// Adds a row to the table of fitted lines; `law`: equation of the line.
    fn add_fit(&mut self, figure: &str, group: &str, law: &str, line: FittedLine) {
        let numbers = csv_text(&[], [vec![line.slope, line.intercept, line.r2]]);
        self.fits += &format!("{figure},{},{law},{}", name_field(group), numbers.trim_start());
    }

    fn add_figure(&mut self, name: String, title: String, [x, y]: [FigureAxis; 2], curves: Vec<Curve>) {
        self.figures.push((name, Figure { title, x, y, curves }));
    }
}

fn grain_count(run: &StudyRun) -> f64 {
    run.value_of("n_grains")
}

fn marked_curve(name: &str, points: Vec<(f64, f64)>, marks: CurveMarks) -> Curve {
    Curve { name: name.into(), points, marks }
}

/// Points that a figure with logarithmic axes can show.
fn positive_points(points: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
    points.filter(|p| p.0 > 0.0 && p.1 > 0.0).collect()
}

fn logarithms(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    points.iter().map(|p| (p.0.ln(), p.1.ln())).collect()
}

/// Formats a value with three significant digits.
fn three_digits(value: f64) -> String {
    let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    format!("{rounded}").replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(group: &str, n: f64) -> StudyRun {
        let mut values = vec![f64::NAN; Row::COLUMNS.len() + COLUMNS.len()];
        let names: Vec<&str> = Row::COLUMNS.iter().chain(&COLUMNS).map(|(name, _, _)| *name).collect();
        let mut set = |name: &str, value: f64| values[names.iter().position(|known| *known == name).unwrap()] = value;
        set("n_grains", n);
        set("Z", 6.0 - 9.0 * n.powf(-1.0 / 3.0));
        set("nu", 0.6 - 0.5 * n.powf(-1.0 / 3.0));
        set("nu_sphere", 0.6 - 0.7 * n.powf(-1.0 / 3.0));
        set("pressure_sphere", 1.1 * n.powf(2.0 / 3.0));
        set("pressure_homogeneous", n.powf(2.0 / 3.0));
        set("sweeps", 10.0);
        set("seconds_gravity", 1e-6 * n.powi(2));
        set("seconds_detection", 1e-5 * n);
        set("seconds_contacts", 1e-5 * n.powf(1.5));
        StudyRun { name: format!("{group}-{n}"), group: group.into(), parameters: vec![n.to_string()], values }
    }

    #[test]
    fn cases_have_the_parameters_of_their_study() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let text = "case,from,mu,shape,step\na/x,,0.2,\"Box(lengths: (1, 2, 3), \"\"b\"\")\",1\ny,a/x,0.4,,\n";
        std::fs::write(path("study.csv"), text).unwrap();
        std::fs::create_dir_all(path("a/x")).unwrap();
        std::fs::create_dir(path("z")).unwrap();
        let all = StudyCases::new(&[path("study.csv")], None).unwrap();
        assert_eq!(all.folders, [path("a/x"), path("y")]);
        assert_eq!(all.values, [["0.2", "Box(lengths: (1, 2, 3), \"b\")", "1"], ["0.4", "", ""]]);
        // A column of series.csv has the name `step`.
        assert_eq!(all.column_names(), ["mu", "shape", "study_step"]);
        assert_eq!(all.groups_by(&["mu".into(), "step".into()]).unwrap(), ["mu 0.2, step 1", "mu 0.4, step"]);
        let unknown = all.groups_by(&["mU".into()]).unwrap_err().to_string();
        assert_eq!(unknown, "options: --by: mU is not a parameter of the study; did you mean mu?");
        // A folder by itself, and folders with their row of a table.
        assert_eq!(StudyCases::new(&[path("z")], None).unwrap().values, [[""; 0]]);
        let one = StudyCases::new(&[path("a/../a/x")], Some(&path("study.csv"))).unwrap();
        assert_eq!((one.values.len(), &one.values[0]), (1, &all.values[0]));
        let other = StudyCases::new(&[path("z")], Some(&path("study.csv"))).unwrap_err().to_string();
        assert!(other.contains("z is not one of its cases"), "{other}");
        std::fs::write(path("other.csv"), "run,group\n").unwrap();
        assert!(StudyCases::new(&[path("other.csv")], None).unwrap_err().to_string().contains("has other columns"));
        std::fs::write(path("short.csv"), "case,from,mu\na\n").unwrap();
        let short = StudyCases::new(&[path("short.csv")], None).unwrap_err().to_string();
        assert!(short.ends_with("short.csv:2: row: a; expected 3 fields"), "{short}");
    }

    #[test]
    fn fewer_than_three_spheres_are_not_isostatic() {
        assert_eq!((isostatic_number(3.0), isostatic_number(12.0)), (2.0, 5.0)); // a triangle has two neighbours each
        assert!([0.0, 1.0, 2.0, f64::NAN].iter().all(|&grains| isostatic_number(grains).is_nan()));
    }

    #[test]
    fn the_laws_that_runs_follow_are_found() {
        let runs: Vec<StudyRun> =
            ["a", "b, c"].into_iter().flat_map(|g| [250.0, 1000.0, 4000.0].map(|n| run(g, n))).collect();
        let StudyPlots { figures, fits, .. } = StudyPlots::new(&runs, &["a", "b, c"]);
        let names: Vec<&str> = figures.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["Z", "nu", "nu_sphere", "pressure", "cost-a", "cost-b_c", "sweeps"]);
        let long = "c".repeat(101);
        let groups = ["1", "b c", "b, c", "B_c", "µ", long.as_str(), ", "];
        let figures = StudyPlots::new(&runs, &groups).figures;
        let costs: Vec<&str> = figures.iter().filter_map(|(name, _)| name.strip_prefix("cost-")).collect();
        assert_eq!(costs, ["1", "b_c", "2", "3", "µ", "4", "5"]);
        let slope = |start: &str| -> f64 {
            let line = fits.lines().find(|line| line.starts_with(start)).unwrap_or_else(|| panic!("{start}: {fits}"));
            line.split(',').nth(3).unwrap().parse().unwrap()
        };
        // Round-off of sums of a few terms.
        for (start, exact) in [
            ("Z,a", -9.0),
            ("nu,b; c", -0.5),
            ("pressure,all", 1.0),
            ("cost-a,a,ln(seconds_gravity)", 2.0),
            ("cost-b_c,b; c,ln(seconds_detection)", 1.0),
            ("cost-b_c,b; c,ln(seconds_contacts)", 1.5),
        ] {
            assert!((slope(start) / exact - 1.0).abs() < 1e-10, "{start}: {fits}");
        }
        // A line runs from the fewest grains to the most, independent of the order of the runs.
        let backwards: Vec<StudyRun> = [4000.0, 250.0, 1000.0].map(|n| run("a", n)).into();
        let sorted = StudyPlots::new(&backwards, &["a"]).figures;
        let line = &sorted.last().unwrap().1.curves[0];
        assert!(line.points.is_sorted_by(|a, b| a.0 < b.0), "{line:?}");
        let svg = figures[0].1.to_svg();
        assert!(svg.contains("6 − 9 N^(-1/3)") && !svg.contains("NaN"), "{svg}");
        let table = table_text(&runs, &["N".to_string()]);
        assert!(
            table.starts_with("run,group,N,step,") && table.contains("\nb; c-250,b; c,250,") && !table.contains("NaN"),
            "{table}"
        );
    }
}
