//! `cd-pre accuracy-study scene.ron`: the study of the options of a scene that trade speed for accuracy.
//!
//! `docs/reference/accuracy-study.md` describes it for users.

use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::compute::{Accuracy, Compute, EventAction, GravityMethod};
use cd_formats::error::{Fault, Faults};
use cd_formats::names::{count_text, rounded_number};
use cd_formats::report::FaultReport;
use cd_formats::ron_text::known_names;

use crate::datbox::read_scene;
use crate::from_outbox;
use crate::grain::Population;
use crate::scene::Scene;
use crate::summary::print_warnings;
use study_text::{StudyGroup, StudyParameter};

mod study_text;

/// Rules for make, with the start of the means in place of `@FROM@`.
const MAKEFILE: &str = include_str!("Makefile.in");

/// End of the first line of files that are written here.
const WRITTEN_MARK: &str = " Written by cd-pre accuracy-study.";

/// Options of a study, in the order of its groups; `accuracy` stands for the presets.
pub const STUDY_OPTIONS: [&str; 9] =
    ["dt", "tol", "adaptive", "penetration_tol", "theta", "gravity_error", "narrow_phase", "target_error", "accuracy"];

/// Values of the options that are plain numbers, which each differ by a factor that shows in the errors.
const PLAIN_VALUES: [(&str, &[&str]); 4] = [
    ("tol", &["1e-1", "3e-2", "1e-2", "1e-3"]),
    ("penetration_tol", &["1", "1e-2", "1e-3", "1e-4"]),
    ("theta", &["0.6", "0.75", "1"]),
    ("gravity_error", &["1e-1", "1e-2", "1e-3", "1e-4"]),
];

/// Observables and errors of the option `target_error`.
const TARGETS: [(&str, &str); 6] =
    [("z", "3e-2"), ("z", "1e-2"), ("nu", "3e-2"), ("nu", "1e-2"), ("pressure", "3e-2"), ("pressure", "1e-2")];

/// Longest steps of the option `adaptive`, in multiples of `dt`.
const MAX_MULTIPLES: [u64; 3] = [4, 16, 64];

/// Ratios of the time steps to that of the scene that are longer or equal, whole numbers.
const LONG_STEPS: [u64; 3] = [4, 2, 1];

/// Least number of time steps, from which an order of convergence can be fitted.
const MIN_TIME_STEPS: usize = 3;

/// Ratio of the finest time step of the study to that of the reference.
const REFERENCE_STEP_RATIO: f64 = 4.0;

/// Least number of grains for which `gravity_error` is varied by default: `auto` sums the attraction of fewer directly.
const MIN_FMM_GRAINS: usize = 1000;

/// Share of the end time from which on snapshots enter the means.
const MEANS_START: f64 = 0.8;

/// Seeds that are tried for each replicate; grains of a random size may not fit with some.
const SEEDS_PER_REPLICATE: usize = 4;

/// Arguments of the command.
#[derive(Debug, Clone, Copy)]
pub struct AccuracyStudyRequest<'a> {
    pub scene: &'a Path,
    /// Options that are varied, of [`STUDY_OPTIONS`]; empty for all that the scene uses.
    pub options: &'a [String],
    /// Number of seeds.
    pub replicates: u32,
    /// Time step of the reference, s; without it, a quarter of the finest of the study.
    pub reference_dt: Option<f64>,
    /// Folder of the study.
    pub output: &'a Path,
}

/// Writes study.ron and a Makefile for the scene into the folder. Returns a summary for people.
///
/// Errors: the faults of the scene, options that have no effect in it, a `reference_dt` without an equal interval of
/// snapshots, and files in the folder that were not written here. Nothing is written then.
pub fn write(request: &AccuracyStudyRequest) -> Result<String, Faults> {
    let text = atomic::read_text(request.scene)?;
    let (scene, population) = read_scene(request.scene, &text, &[])
        .map_err(|faults| changes_fault(request.scene, &text).unwrap_or(faults))?;
    let mut report = FaultReport::new(request.scene, &text);
    let end = scene.compute.steps.map(|steps| steps as f64 * scene.compute.dt).or(scene.compute.end_time);
    report.require(end.is_some(), "compute", "no end of the run", "end_time or steps");
    let used_options = study_options(&scene, &population, request.options, &mut report);
    let steps = time_steps(&scene.compute);
    let finest = steps.last().map_or(scene.compute.dt, |step| step.dt);
    let reference_dt = request.reference_dt.unwrap_or(finest / REFERENCE_STEP_RATIO);
    let reference = TimeStep::new(&scene.compute, reference_dt);
    if reference.is_none() || reference_dt >= finest {
        let found = format!("{} s", rounded_number(reference_dt));
        let expected = format!(
            "expected less than {} s, and a whole number of steps between two snapshots",
            rounded_number(finest)
        );
        report.faults.push(Fault::new(Path::new("options"), None, "--reference-dt", found, expected));
    }
    let seeds = if report.faults.0.is_empty() { replicate_seeds(request, &text, &mut report) } else { Vec::new() };
    let files = ["study.ron", "Makefile"].map(|name| request.output.join(name));
    for path in files.iter().filter(|path| path.exists() && !is_written_here(path)) {
        let found = "was not written by cd-pre accuracy-study and would be replaced";
        report.faults.push(Fault::new(path, None, "file", found, "expected another folder"));
    }
    let (Some(reference), true) = (reference, report.faults.0.is_empty()) else { return Err(report.faults) };
    let study = AccuracyStudy { compute: &scene.compute, steps, reference };
    let groups = study.groups(&used_options);
    let base = base_path(request.scene, request.output);
    let name = request.scene.file_name().unwrap_or_default().to_string_lossy();
    let head = format!(
        "// Settings of {name} that trade speed for accuracy, and a reference for each seed.{WRITTEN_MARK}\n\
         // A row of cd-post's tables is a setting: the options of the scene, and the values of its group in their place.\n"
    );
    let study_ron = head + &study_text::groups_text(&groups, &base, &seeds);
    let from = rounded_number(MEANS_START * end.unwrap_or_default());
    let texts = [study_ron, MAKEFILE.replace("@FROM@", &from)];
    atomic::write_all(files.iter().cloned().zip(texts.iter().map(|text| text.as_bytes())))?;
    print_warnings(&report.warnings);
    let settings: usize = groups.iter().map(StudyGroup::case_count).sum();
    Ok(format!(
        "{} and {}: {} in {}\nreference: steps of {} s, {:.0} in a run\nnext: make -C {}\n",
        count_text(settings, "setting"),
        count_text(seeds.len(), "seed"),
        count_text(settings * seeds.len(), "run"),
        files[0].display(),
        rounded_number(study.reference.dt),
        (end.unwrap_or_default() / study.reference.dt).ceil(),
        request.output.display()
    ))
}

/// Fault of a file that contains no scene but changes of `from-outbox`.
fn changes_fault(file: &Path, text: &str) -> Option<Faults> {
    let changes = from_outbox::read(file, text, &[]).ok()?;
    // Most scenes could be read as changes that add grains.
    (!changes.bodies.is_empty() || changes.grains.is_empty()).then_some(())?;
    let found = "contains changes of from-outbox, whose runs have the chance of the run before";
    let expected =
        "expected a scene; for such runs write a study with from: \"NAME-{seed}\", as examples/accuracy-study does";
    Some(Fault::new(file, None, "file", found, expected).into())
}

/// Whether the first line of a file says that it was written here.
fn is_written_here(path: &Path) -> bool {
    atomic::read_text(path).is_ok_and(|text| text.lines().next().is_some_and(|line| line.ends_with(WRITTEN_MARK)))
}

/// Path of the scene for a study in the folder `output`: relative if the folder is within that of the scene.
fn base_path(scene: &Path, output: &Path) -> PathBuf {
    let [scene, output] = [scene, output].map(|path| std::path::absolute(path).unwrap_or(path.to_path_buf()));
    let folder = scene.parent().unwrap_or(Path::new("")).to_path_buf();
    match output.strip_prefix(&folder) {
        Ok(below) => below.iter().map(|_| "..").collect::<PathBuf>().join(scene.file_name().unwrap_or_default()),
        Err(_) => scene,
    }
}

/// Reason for which an option has no effect in a scene, if there is one.
fn missing_effect(option: &str, scene: &Scene, population: &Population) -> Option<&'static str> {
    let Compute { self_gravity, gravity, gravity_softening, .. } = &scene.compute;
    match option {
        "gravity_error" if !self_gravity => Some("it has no self_gravity"),
        "gravity_error" if *gravity == GravityMethod::Direct || gravity_softening.is_some() => {
            Some("its self-gravity is summed directly")
        }
        "narrow_phase" if population.grains.iter().all(|grain| grain.shape.polyhedron().is_none()) => {
            Some("it has no polyhedra")
        }
        _ => None,
    }
}

/// Options that are varied: those requested, else those that have an effect in the scene.
fn study_options<'a>(
    scene: &Scene,
    population: &Population,
    requested: &'a [String],
    report: &mut FaultReport,
) -> Vec<&'a str> {
    let has_effect = |option: &str| missing_effect(option, scene, population).is_none();
    if requested.is_empty() {
        let is_summed = scene.compute.gravity == GravityMethod::Auto && population.grains.len() < MIN_FMM_GRAINS;
        let is_varied = |option: &&str| has_effect(option) && !(*option == "gravity_error" && is_summed);
        return STUDY_OPTIONS.into_iter().filter(is_varied).collect();
    }
    for option in requested {
        let (found, expected) = match missing_effect(option, scene, population) {
            _ if !STUDY_OPTIONS.contains(&option.as_str()) => {
                (format!("{option} is no option of the study"), known_names(option, &STUDY_OPTIONS))
            }
            Some(reason) => {
                let others: Vec<&str> = STUDY_OPTIONS.into_iter().filter(|option| has_effect(option)).collect();
                let expected = format!("expected one of {}", others.join(", "));
                (format!("{option} has no effect in this scene: {reason}"), expected)
            }
            None => continue,
        };
        report.faults.push(Fault::new(Path::new("options"), None, "--options", found, expected));
    }
    STUDY_OPTIONS.into_iter().filter(|option| requested.iter().any(|name| name == option)).collect()
}

/// Seeds of the replicates, from that of the scene on: those with which all grains can be placed. One alone if another seed
/// changes nothing.
fn replicate_seeds(request: &AccuracyStudyRequest, text: &str, report: &mut FaultReport) -> Vec<u64> {
    let count = request.replicates as usize;
    let mut seeds = Vec::new();
    let mut first_start = None;
    let scene_seed = report.text("seed").parse().unwrap_or(0u64);
    for seed in (scene_seed..=u64::MAX).take(SEEDS_PER_REPLICATE * count) {
        let setting = [format!("seed={seed}")];
        let seeded = cd_formats::settings::apply_settings(text, &setting);
        let start = seeded.and_then(|text| read_scene(request.scene, &text, &setting));
        let Ok(start) = start.map(|(scene, population)| (scene.compute.sources, population)) else { continue };
        if seeds.len() == 1 && first_start.as_ref() == Some(&start) {
            let found = "another seed changes nothing: sizes, positions, shapes and motion of the grains are given";
            report.add_warning("seed", found, "one run of each setting, so that errors have no bars");
            return seeds;
        }
        first_start = first_start.or(Some(start));
        seeds.push(seed);
        if seeds.len() == count {
            return seeds;
        }
    }
    let found = format!("with {} of {} seeds all grains fit", seeds.len(), SEEDS_PER_REPLICATE * count);
    report.add_fault("seed", found, "a larger envelope, or a smaller --replicates");
    seeds
}

/// Time step with the values of options that count steps, so that snapshots and damping are those of the scene.
#[derive(Debug, Clone, PartialEq)]
struct TimeStep {
    /// s
    dt: f64,
    /// Paths and values of these options.
    values: Vec<(String, String)>,
}

impl TimeStep {
    /// Values of the options for the time step `dt` (s); `None` if there are no whole numbers, or no run could use them.
    fn new(compute: &Compute, dt: f64) -> Option<TimeStep> {
        let ratio = dt / compute.dt;
        let mut changed = Compute { dt, ..compute.clone() };
        let count_of_steps = |count: u64| {
            let exact = count as f64 / ratio;
            let whole = exact.round();
            (whole >= 1.0 && (exact - whole).abs() < 1e-9 * whole).then_some(whole as u64)
        };
        changed.output_every = count_of_steps(compute.output_every)?;
        let mut values = vec![("compute.output_every".to_string(), changed.output_every.to_string())];
        if let Some(steps) = compute.steps {
            changed.steps = Some(count_of_steps(steps)?);
            values.push(("compute.steps".into(), count_of_steps(steps)?.to_string()));
        }
        // A share that is removed in each step.
        let damping = |share: f64| rounded_number(1.0 - libm::pow(1.0 - share, ratio));
        if compute.quench > 0.0 {
            values.push(("compute.quench".into(), damping(compute.quench)));
        }
        for (number, event) in (1..).zip(&compute.events) {
            if let EventAction::SetQuench(share) = event.action {
                let action = format!("SetQuench({})", damping(share));
                values.push((format!("compute.events.{number}.action"), action));
            }
        }
        changed.check(Path::new("options")).is_ok().then_some(TimeStep { dt, values })
    }
}

/// Time steps of the study, the longest first: those of [`LONG_STEPS`] that the interval of the snapshots allows, half that
/// of the scene, and shorter ones if these are few.
fn time_steps(compute: &Compute) -> Vec<TimeStep> {
    let longer = LONG_STEPS.iter().map(|ratio| compute.dt * *ratio as f64);
    let mut steps: Vec<TimeStep> = longer.filter_map(|dt| TimeStep::new(compute, dt)).collect();
    let mut dt = 0.5 * compute.dt;
    loop {
        steps.extend(TimeStep::new(compute, dt));
        dt *= 0.5;
        if steps.len() >= MIN_TIME_STEPS || dt < 0.01 * compute.dt {
            return steps;
        }
    }
}

/// Groups of the study of a scene.
struct AccuracyStudy<'a> {
    /// Options of the scene.
    compute: &'a Compute,
    steps: Vec<TimeStep>,
    reference: TimeStep,
}

impl AccuracyStudy<'_> {
    /// Groups of all settings; the reference is the last.
    fn groups(&self, options: &[&str]) -> Vec<StudyGroup> {
        let has_steps = options.contains(&"dt");
        let mut groups: Vec<StudyGroup> = options.iter().map(|option| self.option_group(option, has_steps)).collect();
        groups.push(self.reference_group());
        groups
    }

    /// Group in which one option varies; presets vary with each time step, if these do.
    fn option_group(&self, option: &str, has_steps: bool) -> StudyGroup {
        let name = format!("{option}-{{{option}}}");
        let path = vec![format!("compute.{option}")];
        match option {
            "dt" => StudyGroup {
                comment: "The time step, with snapshots at the same times.".into(),
                name,
                set: Vec::new(),
                parameters: vec![step_parameter(&self.steps)],
            },
            "accuracy" => StudyGroup {
                comment: "The presets, with all that they decide.".into(),
                name: if has_steps { "{accuracy}-dt-{dt}".into() } else { "{accuracy}".into() },
                set: Vec::new(),
                parameters: [Some(self.preset_parameter()), has_steps.then(|| step_parameter(&self.steps))]
                    .into_iter()
                    .flatten()
                    .collect(),
            },
            "adaptive" => {
                let limits = self.compute.adaptive();
                let (travel, penetration) = (rounded_number(limits.travel), rounded_number(limits.penetration));
                let record =
                    |most: &u64| format!("(max_multiple: {most}, travel: {travel}, penetration: {penetration})");
                let values = MAX_MULTIPLES.iter().map(record).collect();
                let companions =
                    vec![StudyParameter { name: String::new(), paths: path, values, companions: Vec::new() }];
                let values = MAX_MULTIPLES.iter().map(u64::to_string).collect();
                StudyGroup {
                    comment: "Steps of up to so many times dt.".into(),
                    name,
                    set: Vec::new(),
                    parameters: vec![StudyParameter { name: option.into(), paths: Vec::new(), values, companions }],
                }
            }
            "target_error" => {
                let records = TARGETS.map(|(observable, error)| format!("({observable}: {error})"));
                let companions = vec![StudyParameter {
                    name: String::new(),
                    paths: path,
                    values: records.into(),
                    companions: Vec::new(),
                }];
                let values = TARGETS.map(|(observable, error)| format!("\"{observable}-{error}\""));
                StudyGroup {
                    comment: "Target errors, for which the run chooses the other options.".into(),
                    name,
                    set: self.unset_values(),
                    parameters: vec![StudyParameter {
                        name: option.into(),
                        paths: Vec::new(),
                        values: values.into(),
                        companions,
                    }],
                }
            }
            _ => {
                let known = PLAIN_VALUES.iter().find(|(name, _)| *name == option).map_or(&["fast"][..], |(_, all)| all);
                let values = known.iter().map(|value| value.to_string()).collect();
                StudyGroup {
                    comment: String::new(),
                    name,
                    set: Vec::new(),
                    parameters: vec![StudyParameter {
                        name: option.into(),
                        paths: path,
                        values,
                        companions: Vec::new(),
                    }],
                }
            }
        }
    }

    /// Presets; options that they decide and the scene sets have the values of the preset.
    fn preset_parameter(&self) -> StudyParameter {
        let presets = [Accuracy::Draft, Accuracy::Standard, Accuracy::Fine];
        let columns = presets.map(|preset| self.preset_values(preset));
        let companions = (0..columns[0].len()).map(|k| StudyParameter {
            name: String::new(),
            paths: vec![columns[0][k].0.clone()],
            values: columns.iter().map(|column| column[k].1.clone()).collect(),
            companions: Vec::new(),
        });
        StudyParameter {
            name: "accuracy".into(),
            paths: vec!["compute.accuracy".into()],
            values: presets.iter().map(Accuracy::to_string).collect(),
            companions: companions.collect(),
        }
    }

    /// Paths of the options that the scene sets and a preset or target decides, without a value.
    fn unset_values(&self) -> Vec<(String, String)> {
        let options =
            self.compute.accuracy_options().into_iter().filter(|option| option.is_set).map(|option| option.name);
        let preset = self.compute.accuracy.map(|_| "accuracy");
        options.chain(preset).map(|name| (format!("compute.{name}"), "None".into())).collect()
    }

    /// Paths of the options that the scene sets and a preset decides, with the values of this preset.
    fn preset_values(&self, preset: Accuracy) -> Vec<(String, String)> {
        let decided = Compute { accuracy: Some(preset), ..Compute::default() }.accuracy_options();
        let is_set = self.compute.accuracy_options().into_iter().map(|option| option.is_set);
        let set_options = decided.into_iter().zip(is_set).filter(|(_, is_set)| *is_set);
        set_options.map(|(option, _)| (format!("compute.{}", option.name), option.value)).collect()
    }

    /// Group of the reference, which has the preset of that name in the shortest steps.
    fn reference_group(&self) -> StudyGroup {
        let mut set = self.preset_values(Accuracy::Reference);
        if self.compute.theta != Compute::default().theta {
            set.push(("compute.theta".into(), rounded_number(Compute::default().theta)));
        }
        let preset = StudyParameter {
            name: "accuracy".into(),
            paths: vec!["compute.accuracy".into()],
            values: vec![Accuracy::Reference.to_string()],
            companions: Vec::new(),
        };
        StudyGroup {
            comment: "The reference, with which all are compared.".into(),
            name: "reference".into(),
            set,
            parameters: vec![preset, step_parameter(std::slice::from_ref(&self.reference))],
        }
    }
}

/// Parameter `dt` with its companions.
fn step_parameter(steps: &[TimeStep]) -> StudyParameter {
    let paths = steps.first().map_or(&[][..], |step| &step.values);
    let companions = (0..paths.len()).map(|k| StudyParameter {
        name: String::new(),
        paths: vec![paths[k].0.clone()],
        values: steps.iter().map(|step| step.values[k].1.clone()).collect(),
        companions: Vec::new(),
    });
    StudyParameter {
        name: "dt".into(),
        paths: vec!["compute.dt".into()],
        values: steps.iter().map(|step| rounded_number(step.dt)).collect(),
        companions: companions.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_faulty_scene_is_not_taken_for_changes() {
        let fault = |text: &str| changes_fault(Path::new("scene.ron"), text).map(|faults| faults.to_string());
        let grains = "grains: [(material: \"ROCKx\", number: 3, sizes: Single(1.0), placement: JitteredLattice(envelope: Ball()))]";
        assert_eq!(
            fault(&format!("(materials: [], laws: [], contacts: [], {grains}, compute: (dt: 1.0, steps: 5))")),
            None
        );
        for changes in ["(compute: (dt: 1.0, steps: 5))", "(bodies: [(select: Largest)], compute: (dt: 1.0, steps: 5))"]
        {
            assert!(fault(changes).is_some_and(|text| text.contains("contains changes of from-outbox")), "{changes}");
        }
    }
}
