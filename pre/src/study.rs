//! `cd-pre study study.ron`: a folder with a scene for each combination of parameters.
//!
//! `docs/reference/study.md` describes [`Study`] for users.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Component, Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};
use cd_formats::former_names::FormerNameUse;
use cd_formats::names::count_text;
use cd_formats::report::FaultReport;
use cd_formats::ron_file;
use cd_formats::ron_text::known_names;
use cd_formats::settings::{apply_settings, check_paths_once, former_names_of_setting, setting_fault, setting_of_path};
use cd_formats::value_locations::ValueLocations;
use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::datbox::read_scene;
use crate::parse::parse_with_settings;

/// Cases that are run and compared.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Study {
    pub groups: Vec<Group>,
}

/// Cases of one base that differ in the same parameters.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Group {
    /// Folder of a case; `{NAME}` stands for the value of a parameter.
    pub name: String,
    /// File of the scene (with `from`: of the changes), relative to the file of the study.
    pub base: Option<PathBuf>,
    /// Folder of the case that these continue by `from-outbox`; may hold `{NAME}`.
    pub from: Option<String>,
    /// Values that all cases of the group share, each with its path as of `--set`.
    #[serde(default)]
    pub set: Vec<(String, IgnoredAny)>,
    /// Parameters of which every combination is a case; the last varies fastest.
    #[serde(default)]
    pub parameters: Vec<Parameter>,
    /// Seeds; each combination is repeated with every one, as parameter `seed`.
    #[serde(default)]
    pub seeds: Vec<u64>,
}

/// Quantity that differs between cases.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parameter {
    /// Name in folders and in the table; without one it appears in neither.
    #[serde(default)]
    pub name: String,
    /// Paths, as of `--set`, that take the value.
    #[serde(default)]
    pub paths: Vec<String>,
    pub values: Vec<IgnoredAny>,
    /// Parameters that vary together with this one: they have their n-th value where this has its n-th.
    #[serde(default)]
    pub with: Vec<Parameter>,
}

/// One combination of parameter values.
struct Case {
    group: usize,
    name: String,
    from: Option<String>,
    /// Values of the parameters by name.
    values: Vec<(String, String)>,
    settings: Vec<CaseSetting>,
}

/// Setting of a case, made from a path and a value of the study.
#[derive(Clone)]
struct CaseSetting {
    /// `PATH=VALUE`
    text: String,
    /// Path of `PATH` within the study.
    path_at: String,
    /// Path of `VALUE` within the study.
    value_at: String,
}

impl CaseSetting {
    fn new(path: &StudyText, value: &StudyText) -> CaseSetting {
        CaseSetting {
            text: format!("{}={}", path.text, value.text),
            path_at: path.study_path.clone(),
            value_at: value.study_path.clone(),
        }
    }
}

/// Text in the study.
struct StudyText {
    text: String,
    /// Path of the text within the study.
    study_path: String,
}

/// File of a case that starts from a scene.
const SCENE_FILE: &str = "scene.ron";

/// File of a case that continues another.
const CHANGES_FILE: &str = "changes.ron";

/// End of the first line of files that are written here.
const WRITTEN_MARK: &str = " Written by cd-pre study.";

/// Paths in scenes and changes whose values are names of files, in which `N` is any item of a list.
const FILE_VALUE_PATHS: [&str; 6] = [
    "grains.N.shape.file",
    "grains.N.shape.contact_shape.0.N",
    "grains.N.placement.envelope.file",
    "walls.N.file",
    "bodies.N.case",
    "compute.fields.N.surface",
];

/// Writes the scene or the changes of each case of the study `file`, with the overrides `settings`, below `output`. With
/// `replicates`, the groups with seeds have the seeds 1 to this number. Also writes the table `NAME.csv` of the parameters and the rules `NAME.mk` for make, NAME being the name of the file.
///
/// Files with the right content are not rewritten, except the rules. Errors: all faults of the study and of its cases;
/// nothing is written then.
pub fn write(
    file: &Path,
    settings: &[String],
    replicates: Option<u32>,
    output: Option<&Path>,
) -> Result<String, Faults> {
    check_paths_once(settings)?;
    let text = apply_settings(&atomic::read_text(file)?, settings)?;
    let study: Study = parse_with_settings(file, &text, settings, "study")?;
    if let Some(count) = replicates {
        let settings = [settings, &seed_settings(&study, count)?].concat();
        check_paths_once(&settings)?;
        return write(file, &settings, None, output);
    }
    let mut report = FaultReport::with_settings(file, &text, settings);
    let cases = expand_cases(&study, &mut report);
    report.warnings = former_name_warnings(file, &text, settings, &cases);
    let study_folder = file.parent().unwrap_or(Path::new(""));
    let output = output.unwrap_or(study_folder);
    let mut files: Vec<(PathBuf, String)> = Vec::new();
    let mut bases: HashMap<&Path, Option<String>> = HashMap::new();
    for case in &cases {
        let group = &study.groups[case.group];
        let (base, original) = match &group.base {
            Some(base) => {
                let path = study_folder.join(base);
                let read = || report.faults.gather_result(atomic::read_text(&path));
                (path.clone(), bases.entry(base).or_insert_with(read).clone())
            }
            None => (file.to_path_buf(), Some("()".into())),
        };
        let Some(original) = original else { continue };
        for warning in ron_file::former_name_warnings(&base, &original, &[]).0 {
            // Cases share their base.
            if !report.warnings.0.contains(&warning) {
                report.warnings.push(warning);
            }
        }
        let path = output.join(&case.name).join(case.file_name());
        if path.exists() && !is_written_here(&path) {
            let found = "was not written by a study and would be replaced";
            report.faults.push(Fault::new(&path, None, "file", found, "expected another name for the case"));
        }
        match case_text(case, &base, &original, &path) {
            Ok(text) => files.push((path, text)),
            Err(faults) => {
                let located: Vec<Fault> = faults.0.into_iter().map(|fault| case.locate(fault, &report)).collect();
                report.faults.0.extend(located);
            }
        }
    }
    let case_names: Vec<&str> = cases.iter().map(|case| case.name.as_str()).collect();
    for case in &cases {
        let Some(from) = &case.from else { continue };
        if !case_names.contains(&from.as_str()) && !output.join(from).join("DATBOX").is_dir() {
            let path = format!("groups.{}.from", case.group);
            report.add_fault_with_phrase(&path, format!("{from} is not a case"), known_names(from, &case_names));
        }
    }
    if !report.faults.0.is_empty() {
        return Err(report.faults);
    }
    let count = files.len();
    files.push((output.join(file.with_extension("csv").file_name().unwrap_or_default()), table(&cases)));
    files.retain(|(path, text)| !has_text(path, text));
    let written = files.iter().filter(|(path, _)| path.extension().is_some_and(|ending| ending == "ron")).count();
    // Written last, as make compares its time with the time of the study.
    let rules = output.join(file.with_extension("mk").file_name().unwrap_or_default());
    files.push((rules.clone(), rules_for_make(file, &rules, &study, &cases)));
    atomic::write_all(files.iter().map(|(path, text)| (path.clone(), text.as_bytes())))?;
    crate::summary::print_warnings(&report.warnings);
    for case in &cases {
        let other_name = if case.file_name() == SCENE_FILE { CHANGES_FILE } else { SCENE_FILE };
        // File that another study left in the folder.
        let left_over = output.join(&case.name).join(other_name);
        if is_written_here(&left_over) {
            let _ = fs::remove_file(left_over);
        }
    }
    Ok(format!("{}, {written} of them new or changed; wrote {}\n", count_text(count, "case"), rules.display()))
}

/// Settings that give each group with seeds the seeds 1 to `count`. Errors: no group has seeds.
fn seed_settings(study: &Study, count: u32) -> Result<Vec<String>, Faults> {
    let with_seeds = (1..).zip(&study.groups).filter(|(_, group)| !group.seeds.is_empty());
    let seeds: Vec<String> = (1..=count).map(|seed| seed.to_string()).collect();
    let settings: Vec<String> =
        with_seeds.map(|(number, _)| format!("groups.{number}.seeds=[{}]", seeds.join(", "))).collect();
    if settings.is_empty() {
        let expected = "expected a group with seeds: [1], which they replace, and {seed} in its name";
        return Err(Fault::new(Path::new("options"), None, "--replicates", "no group has seeds", expected).into());
    }
    Ok(settings)
}

/// All cases, in the order of the groups; faults of the study itself go to `report`.
fn expand_cases(study: &Study, report: &mut FaultReport) -> Vec<Case> {
    let mut cases: Vec<Case> = Vec::new();
    report.require(!study.groups.is_empty(), "groups", "none", "at least one group");
    for (k, group) in study.groups.iter().enumerate() {
        let group_path = format!("groups.{k}");
        let faults_before = report.faults.0.len();
        report.require(group.base.is_some() || group.from.is_some(), &group_path, "no base", "the file of a scene");
        let shared_settings = settings_of_group(group, &group_path, report);
        let axes = axes_of_group(group, &group_path, report);
        check_parameter_names(group, &group_path, &axes, report);
        if report.faults.0.len() > faults_before {
            continue;
        }
        let total: usize = axes.iter().map(|axis| axis[0].values.len()).product();
        for number in 0..total {
            let mut case =
                Case { group: k, name: String::new(), from: None, values: vec![], settings: shared_settings.clone() };
            case.add_values(&axes, number);
            case.name = case.fill_pattern(&group.name);
            case.from = group.from.as_ref().map(|pattern| case.fill_pattern(pattern));
            check_case_names(&case, &cases, &group_path, report);
            cases.push(case);
        }
    }
    cases
}

/// Settings that all cases of a group share; `group_path` is the path of the group within the study.
fn settings_of_group(group: &Group, group_path: &str, report: &FaultReport) -> Vec<CaseSetting> {
    let settings = group.set.iter().enumerate().map(|(n, (path, _))| {
        let path = StudyText { text: path.clone(), study_path: format!("{group_path}.set.{n}.0") };
        CaseSetting::new(&path, &study_text(report, format!("{group_path}.set.{n}.1")))
    });
    settings.collect()
}

/// Parameters of a group, its seeds last: the columns of each axis vary together.
fn axes_of_group<'a>(group: &'a Group, group_path: &str, report: &mut FaultReport) -> Vec<Vec<StudyColumn<'a>>> {
    let mut axes: Vec<Vec<StudyColumn>> = Vec::new();
    for (n, parameter) in group.parameters.iter().enumerate() {
        let mut axis = Vec::new();
        add_columns(parameter, format!("{group_path}.parameters.{n}"), &mut axis, report);
        axes.push(axis);
    }
    if !group.seeds.is_empty() {
        let values = (0..group.seeds.len()).map(|n| study_text(report, format!("{group_path}.seeds.{n}"))).collect();
        let path = StudyText { text: "seed".into(), study_path: format!("{group_path}.seeds") };
        axes.push(vec![StudyColumn { name: "seed", paths: vec![path], values }]);
    }
    axes.iter().for_each(|axis| check_values_differ(axis, report));
    axes
}

/// Requires that the parameters of an axis, which vary together, have no values twice: two cases would be the same.
fn check_values_differ(axis: &[StudyColumn], report: &mut FaultReport) {
    let mut rows: HashSet<Vec<Option<&str>>> = HashSet::new();
    for (k, value) in axis[0].values.iter().enumerate() {
        let row = axis.iter().map(|column| column.values.get(k).map(|value| value.text.as_str())).collect();
        report.require(rows.insert(row), &value.study_path, format!("{} occurs twice", value.text), "different values");
    }
}

/// Requires that the parameters of a group have different names, and that its patterns name no other.
fn check_parameter_names(group: &Group, group_path: &str, axes: &[Vec<StudyColumn>], report: &mut FaultReport) {
    let mut names: Vec<&str> = Vec::new();
    for column in axes.iter().flatten() {
        let found = format!("two parameters are named '{}'", column.name);
        report.require(!names.contains(&column.name), group_path, found, "different names");
        if !column.name.is_empty() {
            names.push(column.name);
        }
    }
    for (field, pattern) in [("name", Some(&group.name)), ("from", group.from.as_ref())] {
        let Some(pattern) = pattern else { continue };
        for unknown in placeholders(pattern).filter(|name| !names.contains(name)) {
            let path = format!("{group_path}.{field}");
            if unknown == "seed" {
                report.add_fault(&path, "{seed}, in a group without seeds", "seeds in it, such as seeds: [1, 2]");
                continue;
            }
            let found = format!("{{{unknown}}} is not a parameter of the group");
            report.add_fault_with_phrase(&path, found, known_names(unknown, &names));
        }
    }
}

/// Requires that the folders of a case are valid and that none of the `other_cases` has the same folder.
fn check_case_names(case: &Case, other_cases: &[Case], group_path: &str, report: &mut FaultReport) {
    for (field, name) in [("name", Some(&case.name)), ("from", case.from.as_ref())] {
        let Some(name) = name else { continue };
        report.require(
            is_plain_subfolder(name),
            &format!("{group_path}.{field}"),
            format!("'{name}'"),
            "a folder below, of letters, digits and . _ + - /",
        );
    }
    let is_duplicate = other_cases.iter().any(|other| other.name == case.name);
    let found = format!("two cases are named '{}'", case.name);
    report.require(!is_duplicate, &format!("{group_path}.name"), found, "a pattern with every parameter, as {NAME}");
}

/// Text of the value of the study at the path `study_path`.
fn study_text(report: &FaultReport, study_path: String) -> StudyText {
    StudyText { text: report.text(&study_path).to_string(), study_path }
}

/// Parameter with its paths and its values as written in the study.
struct StudyColumn<'a> {
    name: &'a str,
    paths: Vec<StudyText>,
    values: Vec<StudyText>,
}

/// Adds the column of a parameter, whose path in the study is `study_path`, and the columns of those that vary with it.
fn add_columns<'a>(
    parameter: &'a Parameter,
    study_path: String,
    axis: &mut Vec<StudyColumn<'a>>,
    report: &mut FaultReport,
) {
    let count = parameter.values.len();
    let expected = axis.first().map_or(count.max(1), |first: &StudyColumn| first.values.len());
    let values_path = format!("{study_path}.values");
    let expected_text = if axis.is_empty() {
        "at least one".into()
    } else {
        format!("{expected} values, as the parameter it varies with")
    };
    report.require(count == expected, &values_path, format!("{count} values"), &expected_text);
    let values = (0..count).map(|k| study_text(report, format!("{values_path}.{k}"))).collect();
    let path_text =
        |(k, path): (usize, &String)| StudyText { text: path.clone(), study_path: format!("{study_path}.paths.{k}") };
    let paths = parameter.paths.iter().enumerate().map(path_text).collect();
    axis.push(StudyColumn { name: &parameter.name, paths, values });
    for (n, follower) in parameter.with.iter().enumerate() {
        add_columns(follower, format!("{study_path}.with.{n}"), axis, report);
    }
}

/// Warnings about former names in the paths and values of the study itself: one for each name, at its first position.
fn former_name_warnings(file: &Path, text: &str, settings: &[String], cases: &[Case]) -> Faults {
    let locations = ValueLocations::from_text(text);
    let start = |path: &str| locations.value(path).map_or(0, |value| value.span.start);
    let (mut uses, mut setting_warnings): (Vec<FormerNameUse>, _) = (Vec::new(), Faults::default());
    for case_setting in cases.iter().flat_map(|case| &case.settings) {
        let path_length = case_setting.text.find('=').unwrap_or(0);
        for FormerNameUse { name, span } in former_names_of_setting(&case_setting.text) {
            let (at, start) = if span.start < path_length {
                // Bytes of the path as a string in quotes.
                let path = &case_setting.text[..path_length];
                let quote = locations.text(&case_setting.path_at).and_then(|text| text.find(path));
                (&case_setting.path_at, start(&case_setting.path_at) + quote.map_or(0, |quote| quote + span.start))
            } else {
                (&case_setting.value_at, start(&case_setting.value_at) + span.start - path_length - 1)
            };
            let former_use = FormerNameUse { name, span: start..start + name.former.len() };
            match setting_of_path(settings, at).map(|setting| ron_file::setting_warning(setting, name)) {
                Some(warning) if !setting_warnings.0.contains(&warning) => setting_warnings.push(warning),
                None if !uses.contains(&former_use) => uses.push(former_use),
                _ => {}
            }
        }
    }
    uses.sort_by_key(|former_use| former_use.span.start);
    let mut warnings = ron_file::warnings_of_uses(file, text, &uses);
    warnings.0.extend(setting_warnings.0);
    warnings
}

/// Names in braces in a pattern.
fn placeholders(pattern: &str) -> impl Iterator<Item = &str> {
    pattern.split('{').skip(1).map(|rest| rest.split('}').next().unwrap_or(rest))
}

/// Whether a name is the name of a subfolder that make and shells accept unquoted.
fn is_plain_subfolder(name: &str) -> bool {
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "._+-/".contains(letter);
    let is_subfolder = Path::new(name).components().all(|part| matches!(part, Component::Normal(_)));
    !name.is_empty() && is_subfolder && !name.starts_with('-') && !name.ends_with('/') && name.chars().all(is_plain)
}

impl Case {
    /// Adds the values of the combination `number` of the axes, of which the last varies fastest.
    fn add_values(&mut self, axes: &[Vec<StudyColumn>], number: usize) {
        let mut remaining = number;
        let mut picked: Vec<usize> = Vec::new();
        for axis in axes.iter().rev() {
            picked.push(remaining % axis[0].values.len());
            remaining /= axis[0].values.len();
        }
        for (axis, n) in axes.iter().zip(picked.into_iter().rev()) {
            for column in axis {
                let value = &column.values[n];
                if !column.name.is_empty() {
                    self.values.push((column.name.to_string(), value.text.clone()));
                }
                self.settings.extend(column.paths.iter().map(|path| CaseSetting::new(path, value)));
            }
        }
    }

    /// Name of the file in its folder.
    fn file_name(&self) -> &'static str {
        if self.from.is_some() { CHANGES_FILE } else { SCENE_FILE }
    }

    /// Pattern with the values of the parameters filled in.
    fn fill_pattern(&self, pattern: &str) -> String {
        let fill = |text: String, (name, value): &(String, String)| {
            text.replace(&format!("{{{name}}}"), value.trim_matches('"'))
        };
        self.values.iter().fold(pattern.to_string(), fill)
    }

    /// Fault of the case; a fault of a setting gets the position of its value in the study.
    fn locate(&self, fault: Fault, report: &FaultReport) -> Fault {
        let is_at_fault = |setting: &&CaseSetting| fault.object == format!("--set {}", setting.text);
        match self.settings.iter().rfind(is_at_fault).filter(|_| fault.file == Path::new("options")) {
            Some(setting) => {
                let found = format!("{}: {}", setting.text.split_once('=').map_or("", |(path, _)| path), fault.found);
                report.fault_at(&setting.value_at, found, fault.expected)
            }
            None => fault,
        }
    }
}

/// Text of the scene, or of the changes, of a case for the file `path`. It is checked, unless the file already contains
/// it.
fn case_text(case: &Case, base: &Path, original: &str, path: &Path) -> Result<String, Faults> {
    let settings: Vec<String> = case.settings.iter().map(|setting| setting.text.clone()).collect();
    let mut faults = Faults::default();
    if case.from.is_some() && ValueLocations::from_text(original).text("compute").is_none() {
        // New options would start from defaults, whereas `from-outbox --set` changes the options of the continued run.
        for setting in settings.iter().filter(|setting| setting.trim_start().starts_with("compute.")) {
            faults.push(setting_fault(setting, "the base has no options of the run", "expected 'compute' as a whole"));
        }
    }
    faults.into_result(())?;
    let changed = apply_settings(original, &settings)?;
    let current = ron_file::with_current_names(base, &changed)?;
    let values: String =
        case.values.iter().map(|(name, value)| format!("; {name}: {}", value.replace('\n', " "))).collect();
    let head = format!("// Case {} of a study{values}.{WRITTEN_MARK}\n", case.name);
    let text = rebase_file_paths(&current, base, path.parent().unwrap_or(Path::new(""))).map(|text| head + &text);
    if text.as_ref().is_ok_and(|text| has_text(path, text)) {
        return text;
    }
    match case.from {
        None => drop(read_scene(base, &changed, &settings)?),
        Some(_) => drop(crate::from_outbox::read(base, &changed, &settings)?),
    }
    text
}

/// Whether a study wrote the file, according to its first line.
fn is_written_here(path: &Path) -> bool {
    atomic::read_text(path).is_ok_and(|text| text.lines().next().is_some_and(|line| line.ends_with(WRITTEN_MARK)))
}

/// Whether a file contains exactly this text.
fn has_text(path: &Path, text: &str) -> bool {
    atomic::read_bytes(path).is_ok_and(|bytes| bytes == text.as_bytes())
}

/// Scene or changes for another folder than their base; paths of files in it are made relative to that folder.
fn rebase_file_paths(text: &str, base: &Path, folder: &Path) -> Result<String, Faults> {
    let base_folder = base.parent().unwrap_or(Path::new(""));
    let locations = ValueLocations::from_text(text);
    let mut settings = Vec::new();
    for pattern in FILE_VALUE_PATHS {
        for value_path in matching_paths(pattern, &locations) {
            let Some(value) = locations.text(&value_path) else { continue };
            let file = Path::new(value.trim_matches('"'));
            // Path out of the folder of the case, if it lies below the folder of the base.
            let up: Option<PathBuf> =
                folder.strip_prefix(base_folder).ok().map(|below| below.iter().map(|_| "..").collect());
            let path = match up {
                Some(up) => up.join(file),
                None => std::path::absolute(base_folder.join(file)).unwrap_or(base_folder.join(file)),
            };
            // Settings count from 1.
            let word = |word: &str| word.parse().map_or(word.to_string(), |n: usize| (n + 1).to_string());
            let setting_path: Vec<String> = value_path.split('.').map(word).collect();
            settings.push(format!("{}={path:?}", setting_path.join(".")));
        }
    }
    apply_settings(text, &settings)
}

/// Paths of the values in a text that fit a pattern of [`FILE_VALUE_PATHS`].
fn matching_paths(pattern: &str, locations: &ValueLocations) -> Vec<String> {
    let mut paths = vec![String::new()];
    for word in pattern.split('.') {
        let longer_paths = |path: &String| -> Vec<String> {
            let join = |word: &str| if path.is_empty() { word.to_string() } else { format!("{path}.{word}") };
            let is_value = |path: &String| locations.text(path).is_some();
            match word {
                "N" => (0..).map(|n: usize| join(&n.to_string())).take_while(is_value).collect(),
                name => Some(join(name)).filter(is_value).into_iter().collect(),
            }
        };
        paths = paths.iter().flat_map(longer_paths).collect();
    }
    paths
}

/// Table with a row for each case: its folder, the case that it continues, and each parameter, empty where its group has
/// no parameter of that name.
fn table(cases: &[Case]) -> String {
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in cases.iter().flat_map(|case| &case.values) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    let cell = |text: &str| {
        if text.contains([',', '"', '\n']) {
            format!("\"{}\"", text.replace('"', "\"\"").replace('\n', " "))
        } else {
            text.to_string()
        }
    };
    let row = |cells: Vec<&str>| cells.into_iter().map(cell).collect::<Vec<_>>().join(",") + "\n";
    let mut text = row([&["case", "from"], &names[..]].concat());
    for case in cases {
        let value = |name: &&str| case.values.iter().find(|(known, _)| known == name).map_or("", |(_, value)| value);
        let first_cells = [case.name.as_str(), case.from.as_deref().unwrap_or_default()];
        text += &row(first_cells.into_iter().chain(names.iter().map(value)).collect());
    }
    text
}

/// Rules for make: the cases, the files that the study reads, and the order of cases.
fn rules_for_make(file: &Path, rules: &Path, study: &Study, cases: &[Case]) -> String {
    let study_folder = file.parent().unwrap_or(Path::new(""));
    let rules_folder = rules.parent().unwrap_or(Path::new(""));
    // Paths relative to the folder of the rules, where make runs.
    let path_from_rules = |path: &Path| match path.strip_prefix(rules_folder) {
        Ok(below) => below.to_path_buf(),
        Err(_) => std::path::absolute(path).unwrap_or(path.to_path_buf()),
    };
    let mut inputs: Vec<PathBuf> = vec![path_from_rules(file)];
    for base in study.groups.iter().filter_map(|group| group.base.as_ref()) {
        let base = path_from_rules(&study_folder.join(base));
        if !inputs.contains(&base) {
            inputs.push(base);
        }
    }
    let inputs: Vec<String> = inputs.iter().map(|path| path.display().to_string()).collect();
    let names: Vec<&str> = cases.iter().map(|case| case.name.as_str()).collect();
    let mut text = format!("# Cases of {}.{WRITTEN_MARK}\n", inputs[0]);
    text += &format!("CASES := {}\n", names.join(" "));
    text += &format!("{}: {}\n", path_from_rules(rules).display(), inputs.join(" "));
    for case in cases {
        let from = case.from.as_ref().map_or(String::new(), |from| format!(" {from}/OUTBOX/.done"));
        text += &format!("{}/DATBOX/.done: {}/{}{from}\n", case.name, case.name, case.file_name());
    }
    text
}
