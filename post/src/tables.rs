//! Tables of runs: their columns, the names of runs in them, and times up to rounding.

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};
use cd_formats::names::number_text;
use cd_formats::snapshot::SnapshotMeta;

use crate::write::series::name_field;

/// Columns of a table of numbers, by name.
pub type Columns = BTreeMap<String, Vec<f64>>;

/// Names of the cases' folders, each with as many parent folders as distinguish it from the others.
pub fn case_names(cases: &[PathBuf]) -> Vec<String> {
    let full_paths: Vec<PathBuf> =
        cases.iter().map(|case| std::fs::canonicalize(case).unwrap_or(case.to_path_buf())).collect();
    let path_tail = |path: &Path, count: usize| -> PathBuf {
        path.components().skip(path.components().count().saturating_sub(count)).collect()
    };
    let name = |path: &PathBuf| {
        let is_unique = |count: &usize| {
            full_paths.iter().all(|other| other == path || path_tail(other, *count) != path_tail(path, *count))
        };
        let count = (1..path.components().count()).find(is_unique).unwrap_or(usize::MAX);
        path_tail(path, count).display().to_string()
    };
    full_paths.iter().map(name).collect()
}

/// Whether a time (s) equals `from` (s) up to the rounding of sums of steps, or is later.
pub fn is_at_or_after(time: f64, from: f64) -> bool {
    time >= from - 1e-6 * from.abs()
}

/// Whether two times (s) are equal up to the rounding of sums of steps.
pub fn same_time(a: f64, b: f64) -> bool {
    is_at_or_after(a, b) && is_at_or_after(b, a)
}

/// Nearest of the times (s) that equal `time` up to rounding; late in a run snapshots are closer to each other than the
/// tolerance of [`same_time`].
pub fn nearest_time(times: impl IntoIterator<Item = f64>, time: f64) -> Option<f64> {
    let same = times.into_iter().filter(|other| same_time(*other, time));
    same.min_by(|a, b| (a - time).abs().total_cmp(&(b - time).abs()))
}

/// Faults of names; `option`: flag or argument that gives them: as fields of a table a name is blank, equal to that of the axis, or repeated.
pub fn name_faults(option: &str, names: &[String], axis: Option<&str>) -> Vec<Fault> {
    let names: Vec<String> = names.iter().map(|name| name_field(name)).collect();
    let fault = |(k, name): (usize, &String)| {
        let (again, expected) = match name.as_str() {
            blank if blank.trim().is_empty() => ("", "expected a name"),
            name if Some(name) == axis => ("", "expected a name other than that of the horizontal axis"),
            _ if names[..k].contains(name) => (" again", "expected each name once"),
            _ => return None,
        };
        let found = format!("'{name}' is given{again} as number {}", k + 1);
        Some(Fault::new(Path::new("options"), None, option, found, expected))
    };
    names.iter().enumerate().filter_map(fault).collect()
}

/// Faults of blank names of groups.
pub fn blank_group_faults(groups: &[String]) -> Vec<Fault> {
    let blank = groups.iter().enumerate().filter(|(_, name)| name.trim().is_empty());
    let position_text = |k: usize| format!("'{}' is given as number {}", name_field(&groups[k]), k + 1);
    blank
        .map(|(k, _)| Fault::new(Path::new("options"), None, "--groups", position_text(k), "expected a name"))
        .collect()
}

/// Reads the columns of a table of numbers; empty fields are NaN.
///
/// Errors: one of the columns `needed` is missing, a name is repeated, or a field is not a finite number.
pub fn read_columns(path: &Path, needed: &[&str]) -> Result<Columns, Faults> {
    parse_columns(path, &table_file_text(path)?, needed)
}

/// Reads the columns of a table that a run writes row by row. An incomplete last row, of an interrupted run, is left out.
/// Errors: those of [`read_columns`].
pub fn read_log(path: &Path, needed: &[&str]) -> Result<Columns, Faults> {
    let text = table_file_text(path)?;
    parse_columns(path, &text[..text.rfind('\n').map_or(0, |end| end + 1)], needed)
}

/// Text of a table; the faults say who writes it.
fn table_file_text(path: &Path) -> Result<String, Faults> {
    atomic::read_text(path).map_err(|mut faults| {
        let expected = "expected a table of cd-solve, or series.csv of cd-post";
        faults.0.iter_mut().for_each(|fault| fault.expected = expected.into());
        faults
    })
}

/// Columns of the text of a table, also those `needed` that it has under a former name.
fn parse_columns(path: &Path, text: &str, needed: &[&str]) -> Result<Columns, Faults> {
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let mut columns: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    let mut faults = Faults::default();
    if names == [""] {
        return Err(Fault::new(path, Some(1), "table", "is empty", "expected names of columns").into());
    }
    let mut add_fault = |name: &str, found: &str, expected: &str| {
        faults.push(Fault::new(path, Some(1), format!("column '{name}'"), found, expected));
    };
    let mut known = HashSet::new();
    for (k, name) in names.iter().enumerate().filter(|(_, name)| !known.insert(**name)) {
        add_fault(name, &format!("is given again as number {}", k + 1), "expected each name once");
    }
    // Former column with the values of one that the table does not have: a series without regions has means over the ball
    // around all grains.
    let former_column = |name: &str| {
        let (_, old) = FORMER_NAMES.iter().find(|(new, _)| *new == name)?;
        names.iter().position(|known| known == old).filter(|_| !names.contains(&"region"))
    };
    for name in needed.iter().filter(|name| !names.contains(name) && former_column(name).is_none()) {
        add_fault(name, "is missing", "write the table again with this version");
    }
    let finite_number = |field: &str| field.parse().ok().filter(|x: &f64| x.is_finite());
    for (number, line) in (2..).zip(lines) {
        let fields: Vec<Option<f64>> =
            line.split(',').map(|field| if field.is_empty() { Some(f64::NAN) } else { finite_number(field) }).collect();
        match (fields.len() == names.len()).then(|| fields.into_iter().collect::<Option<Vec<f64>>>()).flatten() {
            Some(values) => columns.iter_mut().zip(values).for_each(|(column, value)| column.push(value)),
            None => {
                faults.push(Fault::new(path, Some(number), "row", line, format!("expected {} numbers", names.len())))
            }
        }
    }
    let former: Vec<(String, Vec<f64>)> = needed
        .iter()
        .filter(|name| !names.contains(name))
        .filter_map(|name| Some((name.to_string(), columns.get(former_column(name)?)?.clone())))
        .collect();
    faults.into_result(names.into_iter().map(str::to_string).zip(columns).chain(former).collect())
}

/// Columns and the names that they have in files of earlier versions.
const FORMER_NAMES: [(&str, &str); 3] = [("nu_sphere", "nu"), ("pressure_sphere", "pressure"), ("Z_all", "Z")];

/// Columns of TIMER.csv with the times of the stages of a step, s, except writing.
pub const TIMED_STAGES: [&str; 5] = ["gravity", "detection", "assembly", "solve", "integration"];

/// Errors if the series of a case does not belong to its snapshots but to the snapshots of an earlier run; `end`: the last
/// snapshot.
pub fn check_series_of_run(case: &Path, series: &Columns, end: &SnapshotMeta) -> Result<(), Faults> {
    let last_value = |name: &str| series[name].last().copied().unwrap_or(f64::NAN);
    let (step, time) = (last_value("step"), last_value("time"));
    if step == end.step as f64 && same_time(time, end.time) {
        return Ok(());
    }
    let found = format!("ends at step {step} and {} s", number_text(time));
    let expected = format!(
        "expected step {} and {} s, as the last snapshot of OUTBOX: run cd-post {} again",
        end.step,
        number_text(end.time),
        case.display()
    );
    Err(Fault::new(&case.join("POSTPRO/series.csv"), None, "table", found, expected).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_many_columns_are_compared_once() {
        // It took minutes when each name was compared with all before.
        let names: Vec<String> = (0..200_000).map(|k| format!("c{k}")).collect();
        let text = names.join(",") + ",c7\n";
        let faults = parse_columns(Path::new("t.csv"), &text, &["c0"]).unwrap_err();
        assert_eq!(
            faults.format_report("cd-post"),
            "cd-post: t.csv:1: column 'c7': is given again as number 200001; expected each name once\n"
        );
    }

    #[test]
    fn a_series_from_before_regions_has_the_means_of_the_ball() {
        let path = Path::new("series.csv");
        let needed = ["nu_sphere", "pressure_sphere"];
        let old = parse_columns(path, "time,nu,pressure\n1.0,0.5,3.0\n", &needed).unwrap();
        assert_eq!((old["nu_sphere"][0], old["pressure_sphere"][0], old["nu"][0]), (0.5, 3.0, 0.5));
        let faults = parse_columns(path, "time,region,nu,pressure\n1.0,1,0.5,3.0\n", &needed).unwrap_err().to_string();
        assert!(faults.contains("column 'nu_sphere': is missing"), "{faults}");
    }

    #[test]
    fn times_that_differ_by_rounding_are_equal() {
        // At 1e7 s a second is less than a millionth.
        assert_eq!(nearest_time([1e7, 1e7 + 1.0, 1e7 + 2.0], 1e7 + 1.0 + 1e-8), Some(1e7 + 1.0));
        assert_eq!((nearest_time([0.3, 0.5], 0.1 + 0.2), nearest_time([0.3, 0.5], 0.4)), (Some(0.3), None));
    }

    #[test]
    fn names_of_cases_distinguish_their_folders() {
        let names = |cases: &[&str]| case_names(&cases.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert_eq!(names(&["/no/a/x/run", "/no/b/x/run", "/no/b/other"]), ["a/x/run", "b/x/run", "other"]);
        assert_eq!(names(&["/no/run", "/no/run"]), ["run"; 2]);
    }
}
