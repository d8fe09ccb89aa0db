//! `cd-post compare`: one figure and table for each observable, over several runs.

use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};
use cd_formats::names::nearest_name;
use cd_formats::probe::{PROBE_COLUMNS, is_probe_file};

use crate::commands::impact;
use crate::commands::state;
use crate::commands::track;
use crate::derive::Row;
use crate::snapshots::list_snapshots;
use crate::tables::{Columns, case_names, name_faults, nearest_time, read_columns, same_time};
use crate::write::figure::{Curve, Figure, FigureAxis};
use crate::write::plots::PLOTS;
use crate::write::series::{Column, csv_text, name_field};

/// Run with its name in the legend and the columns of its series.
struct SeriesRun {
    name: String,
    columns: Columns,
}

/// A kind of table whose columns can be compared. The default horizontal axis is `time`, or without it the first column.
struct TableKind {
    columns: &'static [Column],
    /// Columns drawn by default.
    drawn: Vec<String>,
    /// Name of the probe that has written the table, with which the titles begin.
    probe: Option<String>,
}

impl TableKind {
    /// Returns the kind for the name of the table's file.
    fn from_path(table: &Path) -> Option<TableKind> {
        let table_kind = |columns, names: &[&str]| {
            Some(TableKind { columns, drawn: names.iter().map(|name| name.to_string()).collect(), probe: None })
        };
        match table.file_name()?.to_str()? {
            "series.csv" => {
                let plotted: Vec<&str> =
                    PLOTS.iter().flat_map(|plot| plot.curves.iter().map(|(name, _)| *name)).collect();
                table_kind(Row::COLUMNS, &plotted)
            }
            "track.csv" => table_kind(&track::COLUMNS, &["depth", "force"]),
            "crater.csv" => table_kind(&track::CRATER_COLUMNS, &["before", "after"]),
            "beta.csv" => table_kind(&impact::BETA_COLUMNS, &["beta", "beta_normal", "ejecta_mass"]),
            "crater-size.csv" => table_kind(&impact::SIZE_COLUMNS, &["diameter", "depth", "volume"]),
            "crater-profile.csv" => table_kind(&impact::PROFILE_COLUMNS, &["before", "after"]),
            "ejecta-speeds.csv" => table_kind(&impact::SPEED_COLUMNS, &["mass_faster"]),
            "ejecta-angles.csv" => table_kind(&impact::ANGLE_COLUMNS, &["mass"]),
            "profile.csv" => table_kind(
                &state::profiles::PROFILE_COLUMNS,
                &["nu", "Z", "pressure", "radial_stress", "tangential_stress"],
            ),
            "layers.csv" => table_kind(
                &state::profiles::LAYER_COLUMNS,
                &["nu", "Z", "vertical_stress", "horizontal_stress", "shear_stress", "weight"],
            ),
            "forces.csv" => table_kind(&state::forces::FORCE_COLUMNS, &["P_normal", "P_tangential"]),
            "mobilisation.csv" => table_kind(&state::forces::MOBILISATION_COLUMNS, &["P"]),
            "ejecta.csv" => table_kind(&state::ejecta::EJECTA_COLUMNS, &["mass_share_faster"]),
            "slopes.csv" => table_kind(&state::surfaces::SLOPE_COLUMNS, &["slope"]),
            name if is_probe_file(name) => {
                let probe = table.file_stem()?.to_str()?.strip_prefix("probe-").map(str::to_string);
                Some(TableKind { probe, ..table_kind(&PROBE_COLUMNS, &[])? })
            }
            _ => None,
        }
    }

    fn find_column(&self, name: &str) -> Option<&'static Column> {
        self.columns.iter().find(|(known, _, _)| *known == name)
    }
}

/// Choice of a table and of its columns for a comparison.
pub struct ComparisonOptions<'a> {
    /// Path below the POSTPRO of each case: series.csv, a table of `cd-post state` (in a folder `state-NNNNNN`, or `state`
    /// for the last of each) or of `cd-post track`, or the file of a probe.
    pub table: &'a Path,
    /// Columns to compare; if empty, the columns of the plots.
    pub columns: &'a [String],
    /// Column of the horizontal axis; without it time, or the table's first column.
    pub x_column: Option<&'a str>,
}

/// Reads a table of each case and writes a figure and a table for each of the columns into `output`.
///
/// `labels`: names in the legend, one for each case, or none for the names of the folders. Each column of a table has its
/// own name.
///
/// Returns the number of columns and messages for the user. Errors: another number of labels than of cases, an unknown table or
/// column, and the faults of the tables.
pub fn write(
    cases: &[PathBuf],
    labels: &[String],
    comparison: &ComparisonOptions,
    output: &Path,
) -> Result<(usize, Vec<String>), Faults> {
    let ComparisonOptions { table, columns, x_column } = *comparison;
    let mut faults = Faults::default();
    let option =
        |name: &str, found: String, expected: String| Fault::new(Path::new("options"), None, name, found, expected);
    if !labels.is_empty() && labels.len() != cases.len() {
        faults.push(option(
            "--labels",
            format!("{} names", labels.len()),
            format!("expected {}, one a case", cases.len()),
        ));
    }
    let Some(kind) = TableKind::from_path(table) else {
        let expected = "expected series.csv, a table of cd-post state, such as state/profile.csv, of cd-post track, such as \
                        track-1/track.csv, of cd-post impact, such as impact/beta.csv, or of a probe, such as probe-lid.csv";
        faults.push(option("--table", table.display().to_string(), expected.into()));
        return Err(faults);
    };
    let are_default_columns = columns.is_empty();
    // A probe has the columns of its own quantity, where its file can be read.
    let probe_case = cases.first().filter(|_| is_of_probe(table));
    let quantity_columns =
        probe_case.map(|case| probe_columns(&table_path(case, table))).filter(|columns| !columns.is_empty());
    let columns = if are_default_columns { quantity_columns.as_ref().unwrap_or(&kind.drawn) } else { columns };
    // Plots of columns that no run has, such as the bed of aggregates, are left out.
    let omits_empty_columns = are_default_columns && table == Path::new("series.csv");
    let x_column = x_column.unwrap_or(kind.find_column("time").map_or(kind.columns[0].0, |(time, _, _)| time));
    let requested = columns.iter().map(|name| ("--columns", name.as_str())).chain([("--against", x_column)]);
    let has_column = |name: &str| {
        let is_of_quantity = |columns: &Vec<String>| {
            ["step", "time", "h"].contains(&name) || columns.iter().any(|column| column == name)
        };
        kind.find_column(name).is_some() && quantity_columns.as_ref().is_none_or(is_of_quantity)
    };
    for (option_name, name) in requested.clone().filter(|(_, name)| !has_column(name)) {
        let columns: Vec<&str> = kind.columns.iter().map(|(name, ..)| *name).filter(|name| has_column(name)).collect();
        let expected = match nearest_name(name, &columns) {
            Some(near) => format!("did you mean {near}?"),
            None if quantity_columns.is_some() => format!("expected one of {}", columns.join(", ")),
            None => format!("expected a column of {}, see docs/reference/observables/", table.display()),
        };
        faults.push(option(option_name, format!("'{name}'"), expected));
    }
    let known: Vec<&str> = requested.map(|(_, name)| name).filter(|name| has_column(name)).collect();
    let mut names = case_names(cases);
    names.iter_mut().zip(labels).for_each(|(name, label)| name.clone_from(label));
    faults.0.extend(name_faults(if labels.is_empty() { "runs" } else { "--labels" }, &names, Some(x_column)));
    // A table with a row for each snapshot has one at least; others may be empty, such as forces of grains that do not touch.
    let by_snapshot = kind.find_column("time").is_some();
    let read_table = |case: &PathBuf| {
        let path = table_path(case, table);
        let columns = read_columns(&path, &known).map_err(|mut faults| {
            if !atomic::path_exists(&path) {
                faults.0.iter_mut().for_each(|fault| fault.expected = writing_command(case, table));
            }
            faults
        })?;
        if by_snapshot && columns.values().all(Vec::is_empty) {
            return Err(Fault::new(&path, None, "table", "has no snapshot", "expected at least one").into());
        }
        Ok(columns)
    };
    let named_run = |(case, name)| Some(SeriesRun { name, columns: faults.gather_result(read_table(case))? });
    let runs: Vec<SeriesRun> = cases.iter().zip(names).filter_map(named_run).collect();
    faults.into_result(())?;
    let mut notes = Vec::new();
    let has_values = |name: &&String| runs.iter().any(|run| run.columns[*name].iter().any(|value| value.is_finite()));
    let columns: Vec<&String> = columns.iter().filter(|name| !omits_empty_columns || has_values(name)).collect();
    for name in &columns {
        let (figure, table) = comparison_figure(&runs, &kind, name, x_column);
        notes.extend(figure.repeated_style_warning());
        atomic::write(&output.join(format!("{name}.svg")), figure.to_svg().as_bytes())?;
        atomic::write(&output.join(format!("{name}.csv")), table.as_bytes())?;
    }
    // All figures have the same runs.
    notes.dedup();
    Ok((columns.len(), notes))
}

/// Path of a table of a case; the folder `state` means the last one of `cd-post state`.
fn table_path(case: &Path, table: &Path) -> PathBuf {
    let folder = case.join("POSTPRO");
    let Ok(rest) = table.strip_prefix("state") else { return folder.join(table) };
    let number = |name: &str| name.strip_prefix("state-")?.parse::<u64>().ok();
    let entries = atomic::folder_entries(&folder).unwrap_or_default().into_iter();
    let states = entries.filter_map(|path| Some((number(path.file_name()?.to_str()?)?, path)));
    // Files of an earlier, longer run are ignored. Without its snapshots they cannot be distinguished.
    let steps: Option<Vec<u64>> =
        list_snapshots(&case.join("OUTBOX")).ok().map(|all| all.into_iter().map(|(step, _)| step).collect());
    let is_of_this_run = |step: &u64| steps.as_ref().is_none_or(|steps| steps.contains(step));
    states.filter(|(step, _)| is_of_this_run(step)).max().map_or(folder.join("state"), |(_, path)| path).join(rest)
}

/// Whether cd-solve writes the table, for a probe.
fn is_of_probe(table: &Path) -> bool {
    table.file_name().and_then(|name| name.to_str()).is_some_and(is_probe_file)
}

/// Columns of the quantity in the file of a probe; none if it cannot be read.
fn probe_columns(path: &Path) -> Vec<String> {
    let text = atomic::read_text(path).unwrap_or_default();
    let names = text.lines().next().unwrap_or_default().split(',');
    names.filter(|name| PROBE_COLUMNS[3..].iter().any(|(known, ..)| known == name)).map(str::to_string).collect()
}

/// Advice for a case without such a table: the command that writes it.
fn writing_command(case: &Path, table: &Path) -> String {
    let case = case.display();
    let command = match table.file_name().and_then(|name| name.to_str()) {
        Some("series.csv") => format!("cd-post {case}"),
        Some(name) if is_probe_file(name) => format!("cd-solve {case} with such a probe"),
        Some("track.csv" | "crater.csv") => format!("cd-post track {case} --body N"),
        Some("beta.csv" | "crater-size.csv" | "crater-profile.csv" | "ejecta-speeds.csv" | "ejecta-angles.csv") => {
            format!("cd-post impact {case} --projectile BODIES")
        }
        _ => format!("cd-post state {case}"),
    };
    format!("expected a table that {command} has written: run it first")
}

/// Figure and table of a column: a row for each value of the horizontal axis of any run, with an empty field for runs
/// without that value. Several values of a run at one position are averaged.
fn comparison_figure(runs: &[SeriesRun], kind: &TableKind, name: &str, x_column: &str) -> (Figure, String) {
    let points: Vec<Vec<(f64, f64)>> = runs
        .iter()
        .map(|run| run.columns[x_column].iter().copied().zip(run.columns[name].iter().copied()).collect())
        .collect();
    let axis = |name: &str| {
        let unit = kind.find_column(name).map_or("1", |(_, unit, _)| unit);
        let logarithmic =
            PLOTS.iter().any(|plot| plot.logarithmic && plot.curves.iter().any(|(curve, _)| *curve == name));
        FigureAxis { quantity: name.into(), unit: unit.into(), logarithmic }
    };
    // First words of the meaning of a column, or its name.
    let label = |name: &str| {
        let help = kind.find_column(name).map_or("", |(_, _, help)| help);
        help.split(", ").next().filter(|short| !short.is_empty()).unwrap_or(name).to_string()
    };
    let title = match &kind.probe {
        Some(probe) => format!("{probe}: {}", label(name)),
        None => {
            let mut letters = label(name).chars().collect::<Vec<_>>().into_iter();
            letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
        }
    };
    let curves = runs.iter().zip(&points).map(|(run, points)| Curve::line(&run.name, points.clone())).collect();
    let x = FigureAxis { quantity: label(x_column), logarithmic: false, ..axis(x_column) };
    let figure = Figure { title, x, y: axis(name), curves };
    let is_same = |a: f64, b: f64| a == b || x_column == "time" && same_time(a, b);
    let mut abscissas: Vec<f64> = Vec::new();
    for points in &points {
        let others = abscissas.clone();
        let is_new = |x: &f64| x.is_finite() && !others.iter().any(|other| is_same(*other, *x));
        abscissas.extend(points.iter().map(|p| p.0).filter(is_new));
    }
    abscissas.sort_by(f64::total_cmp);
    abscissas.dedup();
    let run_names: Vec<String> = runs.iter().map(|run| name_field(&run.name)).collect();
    let header: Vec<&str> = std::iter::once(x_column).chain(run_names.iter().map(String::as_str)).collect();
    let rows = abscissas.into_iter().map(|x| {
        let mean_value = |points: &Vec<(f64, f64)>| {
            let abscissa = if x_column == "time" { nearest_time(points.iter().map(|p| p.0), x) } else { Some(x) };
            // A table may contain one position several times: the mean of its values there.
            let finite_points = points.iter().filter(|p| Some(p.0) == abscissa && p.1.is_finite());
            let (count, sum) = finite_points.fold((0.0, 0.0), |(count, sum), p| (count + 1.0, sum + p.1));
            sum / count
        };
        std::iter::once(x).chain(points.iter().map(mean_value)).collect::<Vec<_>>()
    });
    (figure, csv_text(&header, rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_that_differ_by_rounding_are_one() {
        let run = |name: &str, steps: u32, dt: f64| {
            let times: Vec<f64> = (0..=2).map(|k| (0..k * steps).fold(0.0, |time, _| time + dt)).collect();
            SeriesRun { name: name.into(), columns: [("time".into(), times.clone()), ("Z".into(), times)].into() }
        };
        let kind = TableKind::from_path(Path::new("series.csv")).unwrap();
        let (_, table) = comparison_figure(&[run("a", 10, 0.1), run("b", 1000, 0.001)], &kind, "Z", "time");
        assert_eq!(table.lines().count(), 4, "{table}");
        assert!(table.lines().skip(1).all(|line| !line.ends_with(',')), "{table}");
    }

    #[test]
    fn several_rows_at_one_abscissa_give_their_mean() {
        let run = |name: &str, spin: &[f64], z: &[f64]| SeriesRun {
            name: name.into(),
            columns: [("largest_spin".into(), spin.to_vec()), ("Z".into(), z.to_vec())].into(),
        };
        let runs = [
            run("up and down", &[0.0, 1.0, 0.0, 2.0], &[6.0, 4.0, 5.0, f64::NAN]),
            run("up", &[0.0, 2.0], &[3.0, 1.0]),
        ];
        let kind = TableKind::from_path(Path::new("series.csv")).unwrap();
        let (_, table) = comparison_figure(&runs, &kind, "Z", "largest_spin");
        assert_eq!(table, "largest_spin,up and down,up\n0.0,5.5,3.0\n1.0,4.0,\n2.0,,1.0\n");
    }

    #[test]
    fn titles_name_the_probe_and_its_quantity() {
        let columns = [("time".into(), vec![0.0, 1.0]), ("z".into(), vec![0.1, 0.2]), ("step".into(), vec![0.0, 4.0])];
        let run = SeriesRun { name: "earth".into(), columns: columns.into() };
        let kind = TableKind::from_path(Path::new("probe-boulder.csv")).unwrap();
        let figure = |x_column: &str| comparison_figure(std::slice::from_ref(&run), &kind, "z", x_column).0;
        let in_time = figure("time");
        assert_eq!(in_time.title, "boulder: centre of mass along z");
        assert_eq!((in_time.x.quantity.as_str(), in_time.x.unit.as_str()), ("time", "s"));
        assert_eq!(figure("step").x.quantity, "step");
        // Every column of a probe has a meaning, with which its figure is titled.
        assert!(PROBE_COLUMNS.iter().all(|(_, _, help)| !help.is_empty()));
    }

    #[test]
    fn series_of_several_runs_are_aligned_by_their_times() {
        let run = |name: &str, rows: &[(f64, f64)]| SeriesRun {
            name: name.into(),
            columns: [
                ("time".to_string(), rows.iter().map(|r| r.0).collect()),
                ("Z".to_string(), rows.iter().map(|r| r.1).collect()),
            ]
            .into(),
        };
        let runs =
            [run("one", &[(0.0, 1.0), (2.0, 3.0)]), run("two, more", &[(0.0, 5.0), (1.0, f64::NAN), (2.0, 7.0)])];
        let kind = TableKind::from_path(Path::new("series.csv")).unwrap();
        let (figure, table) = comparison_figure(&runs, &kind, "Z", "time");
        assert_eq!(table, "time,one,two; more\n0.0,1.0,5.0\n1.0,,\n2.0,3.0,7.0\n");
        assert_eq!((figure.curves.len(), figure.repeated_style_warning()), (2, None));
        let svg = figure.to_svg();
        assert!(svg.contains("two, more") && svg.contains("time (s)"), "{svg}");
    }
}
