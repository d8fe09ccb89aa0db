//! Comparison of the cases of a table of `cd-pre study`: settings with several seeds, each with a reference.

use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::compute::Accuracy;
use cd_formats::error::{Fault, Faults};
use cd_formats::names::count_text;
use cd_formats::ron_text::known_names;
use cd_formats::value_locations::ValueLocations;

use crate::commands::accuracy_study::bias::{
    BiasStudy, ConvergenceOrder, DEFAULT_OBSERVABLES, OBSERVABLES, SeedRun, SettingBias, SettingRuns,
};
use crate::commands::accuracy_study::comparison::{
    AccuracyStudyOptions, MeasuredRun, RunErrors, average_realisations, compare_with, measure_run, reference_index,
    write_errors,
};
use crate::commands::accuracy_study::recommendation::{Recommendation, percent_text, signed_text};
use crate::commands::replicates::parameter_label;
use crate::commands::study::{SEED, StudyCases};
use crate::derive::SeriesValue;
use crate::write::figure::{Curve, CurveMarks, Figure, FigureAxis};
use crate::write::series::{Column, name_field};

/// Relative errors for which settings are recommended.
const DEFAULT_ERRORS: [f64; 3] = [0.03, 0.01, 0.003];

/// Columns of bias.csv: name, unit, meaning.
pub const BIAS_COLUMNS: [Column; 12] = [
    ("setting", "-", "values of the parameters"),
    ("observable", "-", "column of accuracy.csv"),
    ("runs", "1", "number of seeds"),
    (
        "bias",
        "1",
        "mean over the seeds of the difference from the reference with the same seed, over the mean of the reference",
    ),
    ("standard_error", "1", "s/√n of the bias, s the standard deviation of the differences"),
    ("low", "1", "lower end of the 95 % confidence interval of the bias, by Student's t"),
    ("high", "1", "upper end of this interval"),
    (
        "without_chance",
        "1",
        "√(bias² - standard_error²): magnitude of the bias without the part of chance; 0 if chance explains all",
    ),
    ("rms", "1", "RMS difference of one run"),
    ("chance", "1", "standard deviation s of the difference of one run"),
    ("reference", "1", "estimated error of the reference, with that by chance"),
    ("bound", "1", "magnitude of the bias, plus standard error and error of the reference, added as squares"),
];

/// Columns of bias_orders.csv.
pub const BIAS_ORDER_COLUMNS: [Column; 6] = [
    ("group", "-", "parameter that varies, and the values of the others"),
    ("observable", "-", "column of accuracy.csv"),
    ("settings", "1", "number of settings with a bias"),
    ("resolved", "1", "number of these whose bias is more than twice its standard error"),
    (
        "order",
        "1",
        "exponent of the parameter in the bias, of the resolved settings; empty if they are fewer than three: not determined",
    ),
    ("order_error", "1", "standard error of the order"),
];

/// Columns of settings.csv.
pub const SETTING_COLUMNS: [Column; 7] = [
    ("setting", "-", "values of the parameters"),
    ("seconds", "s", "median over the seeds of all stages of all steps, without writing"),
    ("observable", "-", "wanted observable with the largest bound"),
    ("bias", "1", "its bias"),
    ("uncertainty", "1", "standard error of the bias and error of the reference, added as squares"),
    ("bound", "1", "magnitude of the bias plus this uncertainty"),
    ("pareto", "1", "1 if no other setting has less of both seconds and bound, else 0"),
];

/// Columns of recommended.csv.
pub const RECOMMENDED_COLUMNS: [Column; 5] = [
    ("error", "1", "wanted error"),
    ("setting", "-", "fastest setting whose bounds are below it; empty for none"),
    ("seconds", "s", "median of its runs"),
    ("bound", "1", "its largest bound"),
    ("needed", "1", "number of replicates that could show another or faster setting; empty if more would not help"),
];

/// Compares the cases of a study for each seed, and writes accuracy.csv, orders.csv and accuracy.svg of the RMS errors over
/// the seeds, bias.csv, bias_orders.csv, settings.csv, recommended.csv and bias.svg. Returns a summary with the recommended
/// settings, and messages for the user.
///
/// Errors: options of single runs, unknown observables, settings without a run of some seed, seeds without a reference, and
/// the faults of the files of the cases.
pub fn write(
    paths: &[PathBuf],
    selection: &AccuracyStudyOptions,
    title: &str,
    output: &Path,
) -> Result<(String, Vec<String>), Faults> {
    check_options(selection)?;
    let cases = StudyCases::new(paths, selection.parameters)?;
    let source = selection.parameters.unwrap_or(&paths[0]);
    let grid = SettingGrid::new(&cases, source)?;
    let errors_of_seeds = grid.compare_seeds(selection)?;
    let average = average_realisations(&vec![PathBuf::new(); grid.seeds.len()], &errors_of_seeds)?;
    let settings = grid.setting_runs(&errors_of_seeds);
    let study = BiasStudy::new(&settings);
    let observables = wanted_observables(&study, selection.observables)?;
    let mut messages = write_errors(&average, title, output)?;
    let errors = if selection.errors.is_empty() { &DEFAULT_ERRORS } else { selection.errors };
    let recommendations: Vec<Recommendation> =
        errors.iter().map(|error| Recommendation::new(&study, &observables, *error)).collect();
    let figure = bias_figure(&study, &observables, title);
    for (name, text) in [
        ("bias.csv", bias_table(&study)),
        ("bias_orders.csv", order_table(&study)),
        ("settings.csv", setting_table(&study, &observables)),
        ("recommended.csv", recommended_table(errors, &recommendations, &observables)),
        ("bias.svg", figure.to_svg()),
    ] {
        atomic::write(&output.join(name), text.as_bytes())?;
    }
    messages.extend(figure.repeated_style_warning().filter(|warning| !messages.contains(warning)));
    if grid.seeds.len() < 2 {
        messages
            .push("one seed: the biases have no errors, and no setting is recommended; expected two or more".into());
    }
    let runs = grid.settings.len() * grid.seeds.len();
    let mut text = format!("{} in {}\n", count_text(runs, "run"), output.display());
    text += &summary_text(&study, &observables);
    for (error, recommendation) in errors.iter().zip(&recommendations) {
        let block = |setting: &SettingBias| grid.compute_block(&setting.runs.name);
        text += &format!("\n  {}", recommendation.text(&observables, *error, block));
    }
    Ok((text, messages))
}

/// Errors if options of single runs are given, which follow from the study.
fn check_options(selection: &AccuracyStudyOptions) -> Result<(), Faults> {
    let mut faults = Faults::default();
    for (name, is_given) in [("--groups", !selection.groups.is_empty()), ("--values", !selection.values.is_empty())] {
        if is_given {
            let expected = "expected case folders alone with it; groups follow from the parameters of a study";
            faults.push(Fault::new(Path::new("options"), None, name, "is given with a study", expected));
        }
    }
    faults.into_result(())
}

/// Indices of the wanted observables, by default those of [`DEFAULT_OBSERVABLES`] that have values.
fn wanted_observables(study: &BiasStudy, names: &[String]) -> Result<Vec<usize>, Faults> {
    let has_values = |k: usize| study.compared_settings().any(|setting| setting.biases[k].estimate.value.is_finite());
    let index = |name: &str| OBSERVABLES.iter().position(|known| *known == name);
    if names.is_empty() {
        return Ok(DEFAULT_OBSERVABLES.into_iter().filter_map(index).filter(|&k| has_values(k)).collect());
    }
    let mut faults = Faults::default();
    let mut wanted = Vec::new();
    for name in names {
        let (found, expected) = match index(name) {
            None => (format!("{name} is not compared"), known_names(name, &OBSERVABLES)),
            Some(k) if !has_values(k) => {
                let defined: Vec<&str> =
                    (0..OBSERVABLES.len()).filter(|&k| has_values(k)).map(|k| OBSERVABLES[k]).collect();
                (format!("{name} has no value in these runs"), format!("expected one of {}", defined.join(", ")))
            }
            Some(k) => {
                wanted.push(k);
                continue;
            }
        };
        faults.push(Fault::new(Path::new("options"), None, "--observables", found, expected));
    }
    faults.into_result(wanted)
}

/// Settings of a study and their cases.
struct SettingGrid {
    settings: Vec<GridSetting>,
    /// Seeds, in the order of the study.
    seeds: Vec<String>,
}

/// Setting of a study.
struct GridSetting {
    name: String,
    /// Name of the settings that differ in one number.
    group: String,
    /// Value of this number; NaN for none.
    value: f64,
    /// Folders of the cases, in the order of the seeds.
    cases: Vec<PathBuf>,
}

impl SettingGrid {
    /// Settings of the cases of the table `source`. Errors: two cases of one setting and seed, and settings without a case of
    /// some seed.
    fn new(cases: &StudyCases, source: &Path) -> Result<SettingGrid, Faults> {
        let mut faults = Faults::default();
        let mut seeds: Vec<String> = Vec::new();
        // Folder of each setting and seed.
        let mut found: Vec<(GridSetting, Vec<Option<PathBuf>>)> = Vec::new();
        for (folder, values) in cases.folders.iter().zip(&cases.values) {
            let pairs = || cases.names.iter().map(String::as_str).zip(values.iter().map(String::as_str));
            let parameters: Vec<(&str, &str)> =
                pairs().filter(|(name, value)| *name != SEED && !value.is_empty()).collect();
            let seed = pairs().find(|(name, _)| *name == SEED).map_or("", |(_, seed)| seed);
            let column = seeds.iter().position(|known| known == seed).unwrap_or(seeds.len());
            if column == seeds.len() {
                seeds.push(seed.into());
            }
            let (name, group, value) = setting_names(&parameters, folder);
            let row = found.iter().position(|(setting, _)| setting.name == name).unwrap_or(found.len());
            if row == found.len() {
                found.push((GridSetting { name, group, value, cases: Vec::new() }, Vec::new()));
            }
            let (setting, folders) = &mut found[row];
            folders.resize(folders.len().max(column + 1), None);
            if let Some(other) = folders[column].replace(folder.clone()) {
                let what = format!("{} has {} and seed {seed}, as {}", folder.display(), setting.name, other.display());
                let expected = "expected the cases of one scene: give their folders and --parameters study.csv";
                faults.push(Fault::new(source, None, "case", what, expected));
            }
        }
        let settings = found.into_iter().map(|(setting, mut folders)| {
            folders.resize(seeds.len(), None);
            for (seed, _) in seeds.iter().zip(&folders).filter(|(_, folder)| folder.is_none()) {
                let what = format!("{} has no run with seed {seed}", setting.name);
                let expected = format!("expected all settings with the same seeds, {}", seeds.join(", "));
                faults.push(Fault::new(source, None, "seed", what, expected));
            }
            GridSetting { cases: folders.into_iter().flatten().collect(), ..setting }
        });
        let settings = settings.collect();
        faults.into_result(SettingGrid { settings, seeds })
    }

    /// Errors of all settings against the reference, for each seed.
    fn compare_seeds(&self, selection: &AccuracyStudyOptions) -> Result<Vec<Vec<RunErrors>>, Faults> {
        let mut faults = Faults::default();
        let mut compared = Vec::new();
        for (k, seed) in self.seeds.iter().enumerate() {
            let measure = |setting: &GridSetting| {
                measure_run(&setting.cases[k], setting.name.clone(), setting.group.clone(), setting.value)
            };
            let runs: Vec<MeasuredRun> =
                self.settings.iter().filter_map(|setting| faults.gather_result(measure(setting))).collect();
            if runs.len() < self.settings.len() {
                continue;
            }
            match reference_index(&runs) {
                Some(reference) => compared.extend(faults.gather_result(compare_with(&runs, reference, selection))),
                None => {
                    let found = format!("seed {seed} has no run with accuracy: {}", Accuracy::Reference);
                    let expected = "expected one to compare with";
                    faults.push(Fault::new(&self.settings[0].cases[k], None, "reference", found, expected));
                }
            }
        }
        faults.into_result(compared)
    }

    /// Runs of each setting.
    fn setting_runs(&self, errors_of_seeds: &[Vec<RunErrors>]) -> Vec<SettingRuns> {
        let runs_of = |k: usize| errors_of_seeds.iter().map(move |runs| &runs[k]);
        let setting_runs = |(k, setting): (usize, &GridSetting)| SettingRuns {
            name: setting.name.clone(),
            group: setting.group.clone(),
            value: setting.value,
            dt: errors_of_seeds[0][k].dt,
            is_reference: runs_of(k).any(|run| run.is_reference),
            runs: runs_of(k).map(|run| SeedRun { seconds: run.row.seconds, pairs: run.pairs }).collect(),
        };
        self.settings.iter().enumerate().map(setting_runs).collect()
    }

    /// Options of the run of a setting as its scene, or its changes, have them.
    fn compute_block(&self, name: &str) -> Option<String> {
        let case = self.settings.iter().find(|setting| setting.name == name)?.cases.first()?;
        let files = ["scene.ron", "changes.ron"].map(|file| case.join(file));
        let text = files.iter().find_map(|file| atomic::read_text(file).ok())?;
        let block = ValueLocations::from_text(&text).text("compute").map(str::to_string)?;
        // Inserted values leave a blank at the end of their line.
        Some(block.lines().map(str::trim_end).collect::<Vec<_>>().join("\n"))
    }
}

/// Name of a setting, and name and value of its group: the first parameter that is a number varies in it. Without parameters
/// a setting has the name of its folder.
fn setting_names(parameters: &[(&str, &str)], folder: &Path) -> (String, String, f64) {
    let name = match parameters {
        [] => folder.file_name().map_or(String::new(), |name| name_field(&name.to_string_lossy())),
        _ => parameter_label(parameters),
    };
    let number = |value: &str| value.parse::<f64>().ok().filter(|x| x.is_finite());
    let Some(varied) = parameters.iter().position(|(_, value)| number(value).is_some()) else {
        return (name.clone(), name, f64::NAN);
    };
    let (parameter, value) = parameters[varied];
    let others: Vec<(&str, &str)> = [&parameters[..varied], &parameters[varied + 1..]].concat();
    let group = parameter_label(&[&[(parameter, " ")], &others[..]].concat());
    // Errors are proportional to the distance of theta from 1/2.
    let offset = if parameter == "theta" { 0.5 } else { 0.0 };
    (name, group, number(value).unwrap_or(f64::NAN) - offset)
}

/// Text of bias.csv.
fn bias_table(study: &BiasStudy) -> String {
    let mut text = header_line(&BIAS_COLUMNS);
    for setting in &study.settings {
        for (observable, bias) in OBSERVABLES.iter().zip(&setting.biases) {
            let estimate = bias.estimate;
            let [low, high] = [-1.0, 1.0].map(|sign| estimate.value + sign * estimate.half_width());
            let numbers = [estimate.value, estimate.standard_error, low, high];
            let more = [bias.without_chance(), bias.rms, bias.chance, bias.reference_error(), bias.bound()];
            let is_defined = estimate.value.is_finite();
            let fields = numbers.iter().chain(&more).map(|x| if is_defined { x.text() } else { String::new() });
            let fields: Vec<String> = fields.collect();
            let runs = setting.runs.runs.len();
            text += &format!("{},{observable},{runs},{}\n", name_field(&setting.runs.name), fields.join(","));
        }
    }
    text
}

/// Text of bias_orders.csv.
fn order_table(study: &BiasStudy) -> String {
    let mut text = header_line(&BIAS_ORDER_COLUMNS);
    for (group, orders) in &study.orders {
        for (observable, order) in OBSERVABLES.iter().zip(orders) {
            let ConvergenceOrder { settings, resolved, order, standard_error } = order;
            let numbers = format!("{},{}", order.text(), standard_error.text());
            text += &format!("{},{observable},{settings},{resolved},{numbers}\n", name_field(group));
        }
    }
    text
}

/// Text of settings.csv.
fn setting_table(study: &BiasStudy, observables: &[usize]) -> String {
    let front = study.pareto_front(observables);
    let mut text = header_line(&SETTING_COLUMNS);
    for setting in &study.settings {
        let is_in_front = front.iter().any(|other| other.runs.name == setting.runs.name);
        let worst = setting.worst(observables);
        let observable = worst.map_or("", |(k, _)| OBSERVABLES[k]);
        let numbers = worst.map_or([f64::NAN; 3], |(_, bias)| [bias.estimate.value, bias.uncertainty(), bias.bound()]);
        let numbers: Vec<String> = numbers.iter().map(SeriesValue::text).collect();
        let seconds = setting.seconds.text();
        let name = name_field(&setting.runs.name);
        text += &format!("{name},{seconds},{observable},{},{}\n", numbers.join(","), u8::from(is_in_front));
    }
    text
}

/// Text of recommended.csv.
fn recommended_table(errors: &[f64], recommendations: &[Recommendation], observables: &[usize]) -> String {
    let mut text = header_line(&RECOMMENDED_COLUMNS);
    for (error, recommendation) in errors.iter().zip(recommendations) {
        let (best, needed) = match recommendation {
            Recommendation::Setting { best, candidate } => (Some(best), candidate.map(|(_, number)| number)),
            Recommendation::Chance { replicates, .. } => (None, Some(*replicates)),
            Recommendation::Bias { .. } | Recommendation::NoErrors => (None, None),
        };
        let name = best.map_or(String::new(), |best| name_field(&best.runs.name));
        let seconds = best.map_or(f64::NAN, |best| best.seconds);
        let bound = best.and_then(|best| best.worst(observables)).map_or(f64::NAN, |(_, bias)| bias.bound());
        let needed = needed.map_or(String::new(), |number| number.to_string());
        text += &format!("{},{name},{},{},{needed}\n", error.text(), seconds.text(), bound.text());
    }
    text
}

fn header_line(columns: &[Column]) -> String {
    columns.iter().map(|(name, _, _)| *name).collect::<Vec<_>>().join(",") + "\n"
}

/// Magnitude of the bias against time, of the wanted observable with the largest bound, with bars of its uncertainty, and the
/// Pareto front of the bounds.
fn bias_figure(study: &BiasStudy, observables: &[usize], title: &str) -> Figure {
    let front = study.pareto_front(observables);
    let bound = |setting: &SettingBias| setting.worst(observables).map_or(f64::NAN, |(_, bias)| bias.bound());
    let magnitude =
        |setting: &SettingBias| setting.worst(observables).map_or(f64::NAN, |(_, bias)| bias.estimate.value.abs());
    // Bars that reach zero end at the lower end of the axis.
    let magnitudes = study.compared_settings().map(magnitude).filter(|bias| *bias > 0.0);
    let lowest = 0.5 * magnitudes.fold(f64::INFINITY, f64::min);
    let bar = |setting: &SettingBias| {
        let (bias, uncertainty) = (magnitude(setting), bound(setting) - magnitude(setting));
        [(bias - uncertainty).max(lowest), bias + uncertainty, f64::NAN].map(|y| (setting.seconds, y))
    };
    let points = front.iter().map(|setting| (setting.seconds, bound(setting))).collect();
    let mut curves = vec![Curve { name: "Pareto front of |bias| + error".into(), points, marks: CurveMarks::Expected }];
    let mut groups: Vec<&str> = Vec::new();
    for setting in study.compared_settings() {
        if !groups.contains(&setting.runs.group.as_str()) {
            groups.push(&setting.runs.group);
        }
    }
    let members = |group: &str| study.compared_settings().filter(move |setting| setting.runs.group == group).collect();
    let mut members: Vec<(&str, Vec<&SettingBias>)> = groups.iter().map(|group| (*group, members(group))).collect();
    // Named dots are drawn on top.
    members.sort_by_key(|(_, settings)| settings.len() == 1);
    for (group, mut settings) in members {
        settings.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        let marks = if settings.len() == 1 { CurveMarks::Named } else { CurveMarks::Line };
        let points = settings.iter().map(|setting| (setting.seconds, magnitude(setting))).collect();
        curves.push(Curve { name: group.into(), points, marks });
        let points = settings.iter().flat_map(|setting| bar(setting)).collect();
        curves.push(Curve { name: group.into(), points, marks: CurveMarks::ErrorBars });
    }
    let names: Vec<&str> = observables.iter().map(|&k| OBSERVABLES[k]).collect();
    Figure {
        title: title.into(),
        x: FigureAxis::logarithmic("time", "s"),
        y: FigureAxis::logarithmic(&format!("largest |bias| of {}", names.join(", ")), "1"),
        curves,
    }
}

/// Table of the settings for the terminal: seconds and biases of the wanted observables, with a star on the Pareto front.
fn summary_text(study: &BiasStudy, observables: &[usize]) -> String {
    let front = study.pareto_front(observables);
    let width = study.settings.iter().map(|one| one.runs.name.chars().count()).max().unwrap_or(0).max(7);
    let mut text = format!("    {:width$}  {:>9}", "setting", "seconds");
    text.extend(observables.iter().map(|&k| format!("  {:>19}", OBSERVABLES[k])));
    for setting in study.compared_settings() {
        let star = if front.iter().any(|other| other.runs.name == setting.runs.name) { '*' } else { ' ' };
        text += &format!("\n  {star} {:width$}  {:>9.2e}", setting.runs.name, setting.seconds);
        let biases = observables.iter().map(|&k| setting.biases[k].estimate);
        text.extend(biases.map(|bias| format!("  {:>19}", signed_text(bias.value, bias.standard_error))));
    }
    for (group, orders) in &study.orders {
        let known = observables.iter().filter(|&&k| orders[k].order.is_finite());
        let known: Vec<String> = known
            .map(|&k| format!("{} {:.2} ± {:.2}", OBSERVABLES[k], orders[k].order, orders[k].standard_error))
            .collect();
        let orders = if known.is_empty() { "not determined".into() } else { known.join(", ") };
        text += &format!("\n  order in {group}: {orders}");
    }
    if let Some(reference) = study.settings.iter().find(|setting| setting.runs.is_reference) {
        let errors: Vec<String> = observables
            .iter()
            .map(|&k| format!("{} {}", OBSERVABLES[k], percent_text(reference.biases[k].reference_error())))
            .collect();
        let seeds = count_text(reference.runs.runs.len(), "seed");
        text += &format!("\n  {seeds}; reference: {:.2e} s, its own error: {}", reference.seconds, errors.join(", "));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn study_cases(rows: &[[&str; 4]]) -> StudyCases {
        StudyCases {
            folders: rows.iter().map(|row| PathBuf::from(row[0])).collect(),
            names: ["dt", "seed", "accuracy"].map(String::from).to_vec(),
            values: rows.iter().map(|row| row[1..].iter().map(|value| value.to_string()).collect()).collect(),
        }
    }

    #[test]
    fn settings_are_the_parameters_without_the_seed() {
        let rows = [
            ["s1/dt-0.1", "0.1", "1", ""],
            ["s1/fine-dt-0.1", "0.1", "1", "fine"],
            ["s1/fine", "", "1", "fine"],
            ["s1/lmgc90", "", "1", ""],
        ];
        let grid = SettingGrid::new(&study_cases(&rows), Path::new("study.csv")).unwrap();
        let found: Vec<(&str, &str, f64)> = grid
            .settings
            .iter()
            .map(|setting| {
                (
                    setting.name.as_str(),
                    setting.group.as_str(),
                    if setting.value.is_nan() { 0.0 } else { setting.value },
                )
            })
            .collect();
        let expected = [
            ("dt 0.1", "dt", 0.1),
            ("dt 0.1; accuracy fine", "dt; accuracy fine", 0.1),
            ("accuracy fine", "accuracy fine", 0.0),
            ("lmgc90", "lmgc90", 0.0),
        ];
        assert_eq!((&found[..], &grid.seeds[..]), (&expected[..], &["1".to_string()][..]));
        assert_eq!(setting_names(&[("theta", "0.75")], Path::new("")).2, 0.25);
    }

    #[test]
    fn every_setting_has_all_seeds_once() {
        let rows =
            [["s1/a", "0.1", "1", ""], ["s2/a", "0.1", "2", ""], ["s1/b", "0.2", "1", ""], ["c", "0.1", "1", ""]];
        let faults = SettingGrid::new(&study_cases(&rows), Path::new("study.csv")).err().unwrap().to_string();
        let expected = "study.csv: case: c has dt 0.1 and seed 1, as s1/a; expected the cases of one scene: give their folders \
                        and --parameters study.csv\n\
                        study.csv: seed: dt 0.2 has no run with seed 2; expected all settings with the same seeds, 1, 2";
        assert_eq!(faults, expected);
    }
}
