//! Messages of a run: what is no case, options and scenes that have changed, overlaps, steps that are too long.

use std::fs;
use std::path::Path;
use std::process::Command;

use cd_formats::compute::{Adaptive, EventAction, ExternalField};
use cd_formats::drv_dof::{DrivenComponent, DrivenKind, Evolution};
use cd_formats::origin::SceneOrigin;
use cd_formats::snapshot;
use cd_formats::tact_behav::TactBehav;
use cd_solve::limits::{self, ParameterLimit};

use crate::case::Case;

/// Exit code, stdout and stderr, with CASE for the case's folder.
fn ran(path: &Path, case: &Path, flags: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(path).args(flags).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap().replace(case.to_str().unwrap(), "CASE");
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

fn output_of(case: &Case, flags: &[&str]) -> (i32, String, String) {
    ran(&case.path(), &case.path(), flags)
}

/// A ball that falls on a floor.
fn falling() -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.3]);
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.6]);
    case.gravity = [0.0, 0.0, -1.0];
    case.options.steps = Some(4);
    case
}

#[test]
fn the_version_may_have_a_commit() {
    let folder = tempfile::tempdir().unwrap();
    let (code, version, _) = ran(Path::new("--version"), folder.path(), &[]);
    let commit = version.trim_end().strip_prefix(concat!("cd-solve ", env!("CARGO_PKG_VERSION"))).unwrap();
    assert!(code == 0 && (commit.is_empty() || commit.starts_with(" (") && commit.ends_with(')')), "{version}");
}

#[test]
fn what_is_no_case_says_what_to_run() {
    let folder = tempfile::tempdir().unwrap();
    let case = folder.path();
    let messages = |name: &str| {
        let (code, _, text) = ran(&case.join(name), case, &[]);
        assert_eq!(code, 2, "{text}");
        text
    };
    assert_eq!(
        messages("absent"),
        "cd-solve: CASE/absent: folder: there is no such folder; expected the folder of a case, with DATBOX in it\n"
    );
    fs::write(case.join("scene.ron"), "()").unwrap();
    assert_eq!(
        messages("scene.ron"),
        "cd-solve: CASE/scene.ron: file: is a scene, not a case; run cd-pre CASE/scene.ron first, then cd-solve CASE\n"
    );
    assert_eq!(messages("scene.ron/"), messages("scene.ron"));
    assert_eq!(messages(""), "cd-solve: CASE/: folder: has a scene but no DATBOX; run cd-pre CASE/scene.ron first\n");
    fs::write(case.join("notes.txt"), "").unwrap();
    assert!(messages("notes.txt").starts_with("cd-solve: CASE/notes.txt: file: is not a folder; expected the folder"));
    fs::create_dir(case.join("DATBOX")).unwrap();
    fs::write(case.join("DATBOX/BODIES.DAT"), "").unwrap();
    assert_eq!(
        messages("DATBOX"),
        "cd-solve: CASE/DATBOX: folder: is a DATBOX; expected the case folder, which contains it\n"
    );
    let (code, _, text) = ran(case, case, &["resume"]);
    assert_eq!((code, text.as_str()), (2, "cd-solve: resume: is not expected here; did you mean --resume?\n"));
}

#[test]
fn a_run_shorter_than_its_step_is_one_step() {
    let mut case = falling();
    (case.options.steps, case.options.end_time, case.options.dt) = (None, Some(0.004), 0.01);
    case.write();
    let (code, text, warnings) = output_of(&case, &[]);
    let warning =
        "dt = 0.01 s is longer than the run to end_time = 0.004 s: it is one step, to t = 0.01 s; use a smaller dt";
    assert!(code == 0 && text.contains("1 in this run, to step 1, t = 0.01 s"), "{text}");
    assert!(warnings.contains(&format!("cd-solve: warning: {warning}\n")), "{warnings}");
    // A run of less than a thousandth of a step has none.
    let (code, text, warnings) = output_of(&case, &["--force", "--dt", "1e39"]);
    assert!(code == 0 && text.contains("0 in this run"), "{code} {text}");
    assert!(warnings.contains("end_time = 0.004 s: no step is computed; use a smaller dt"), "{warnings}");
    // To the end of its only step.
    let (_, _, warnings) = output_of(&case, &["--force", "--end-time", "0.01"]);
    assert!(!warnings.contains("end_time"), "{warnings}");
}

/// A block that moves down at 1 m/s and is free along the floor alone.
#[test]
fn what_is_driven_through_a_wall_is_named() {
    let mut case = falling();
    let block = case.block([0.5; 3], [3.0, 0.0, 0.505], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    for component in 2..6 {
        let evolution = Evolution::constant(if component == 2 { -1.0 } else { 0.0 });
        case.driven.push(DrivenComponent { line: 0, body: block, component, kind: DrivenKind::Velocity, evolution });
    }
    case.dof[block].velocity[2] = -1.0;
    (case.options.steps, case.options.dt) = (Some(20), 0.005);
    case.law_of_all("IQS_CLB", &[0.3]);
    case.write();
    let (code, text, warnings) = output_of(&case, &[]);
    let reason = "along the normal of their contact the motion of both is imposed, so that it does not act; free one of them \
                  along it, or remove the row between them";
    assert_eq!((code, warnings.matches(reason).count(), text.matches(reason).count()), (0, 1, 1), "{warnings} {text}");
    assert!(!warnings.contains("smaller dt or tol"), "{warnings}");
}

#[test]
fn options_that_a_resumed_run_has_no_longer_are_named() {
    let case = falling();
    case.write();
    let first = ["--dt", "0.002", "--tol", "1e-6", "--gravity-error", "1e-5", "--steps", "2"];
    assert_eq!(output_of(&case, &first).0, 0);
    let (code, _, text) = output_of(&case, &["--resume", "--steps", "4", "--threads", "2"]);
    let warnings: Vec<&str> = text.lines().filter(|line| line.contains("run so far")).collect();
    assert_eq!(
        warnings,
        [
            "cd-solve: warning: dt was 0.002 in the run so far and is 0.001 from here on; --dt=0.002 keeps it",
            "cd-solve: warning: gravity_error was 1e-5 in the run so far and is not given from here on; --gravity-error=1e-5 keeps it",
            "cd-solve: warning: tol was 1e-6 in the run so far and is 1e-12 from here on; --tol=1e-6 keeps it",
        ],
        "{text}"
    );
    assert_eq!(code, 0);
    // What the flags of the warnings keep is no change, and what flags change is no warning.
    let case = falling();
    case.write();
    assert_eq!(output_of(&case, &first).0, 0);
    let (_, out, text) =
        output_of(&case, &["--resume", "--steps", "4", "--dt=0.002", "--tol=1e-7", "--gravity-error=1e-5"]);
    assert!(!text.contains("run so far"), "{text}");
    assert!(out.contains("cd-solve: tol was 1e-6 in the run so far and is 1e-7 from here on\n"), "{out}");
    assert!(!out.contains("dt was"), "{out}");
}

#[test]
fn a_scene_that_has_changed_since_is_named() {
    let case = falling();
    case.write();
    let scene = case.path().join("scene.ron");
    fs::write(&scene, "(a)").unwrap();
    let origin = SceneOrigin::from_scene(&scene, b"(a)", &["a=1".into()], &case.path()).unwrap();
    let options = case.path().join("DATBOX/COMPUTE.RON");
    let text = fs::read_to_string(&options).unwrap();
    fs::write(&options, origin.lines() + &text).unwrap();
    assert_eq!(output_of(&case, &[]).2, "");
    fs::write(&scene, "(b)").unwrap();
    let warning = "cd-solve: warning: CASE/scene.ron has changed since DATBOX was made from it; to use it, run \
                   cd-pre CASE/scene.ron --set 'a=1'\n";
    for flags in [&["--force"][..], &["--plan"], &["--resume", "--steps", "5"]] {
        let (code, _, text) = output_of(&case, flags);
        assert_eq!((code, text.as_str()), (0, warning), "{flags:?}");
    }
}

#[test]
fn a_truncated_snapshot_is_named_with_the_option_that_continues() {
    let mut case = falling();
    case.options.output_every = 2;
    case.write();
    assert_eq!(output_of(&case, &[]).0, 0);
    let last = snapshot::snapshot_path(&case.path().join("OUTBOX"), 4);
    let bytes = fs::read(&last).unwrap();
    fs::write(&last, &bytes[..bytes.len() / 2]).unwrap();
    let line = "cd-solve: CASE/OUTBOX/snapshot-000004.npz: snapshot: the file is truncated; expected an .npz file of \
                cd-solve; --resume --skip-damaged continues from the last sound snapshot\n";
    let (code, _, text) = output_of(&case, &["--resume"]);
    assert_eq!((code, text.as_str()), (2, line));
    fs::write(&last, "text").unwrap();
    assert!(output_of(&case, &["--resume"]).2.contains("snapshot: the file is no .npz file; "));
    // The first truncated one is behind the sound snapshot of step 0.
    let previous = snapshot::snapshot_path(&case.path().join("OUTBOX"), 2);
    fs::write(&previous, "text").unwrap();
    let (code, _, text) = output_of(&case, &["--resume", "--skip-damaged"]);
    let aside = |step| {
        format!("cd-solve: warning: CASE/OUTBOX/snapshot-{step:06}.npz.damaged: set aside: the snapshot is damaged\n")
    };
    assert_eq!((code, text), (0, aside(2) + &aside(4)));
    assert_eq!(snapshot::Snapshot::read(&last).unwrap().meta.step, 4);
}

#[test]
fn overlaps_and_steps_that_are_too_long_are_in_the_summary() {
    // Falls 5 m in a step: through the floor's upper side, deep into the plate or beyond it.
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.3]);
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.45]);
    case.options.steps = Some(1);
    case.write();
    let (code, out, text) = output_of(&case, &[]);
    assert_eq!(code, 0);
    let start = "cd-solve: warning: 1 pair of bodies overlaps by more than 1 % of the smaller radius from the start, the \
                 deepest: bodies 1-2 overlap by 5.000e-2 m, 10.0 % of the smaller radius; laws other than GAP_SGR_CLB keep \
                 these overlaps\n";
    let start = start.replace("bodies 1-2", if text.contains("bodies 2-1") { "bodies 2-1" } else { "bodies 1-2" });
    assert_eq!(text, start);
    assert!(out.contains("largest penetration    1.00e-1 of the mean radius, 5.000e-2 m; mean residual"), "{out}");
    assert!(out.contains("overlap by 5.000e-2 m, 10.0 % of the smaller radius: more than 1 %"), "{out}");

    let mut case = falling();
    case.options.dt = 5.0;
    case.options.steps = Some(1);
    case.write();
    let (code, out, text) = output_of(&case, &[]);
    assert_eq!(code, 0);
    let too_long = text.lines().find(|line| line.contains("times the largest step")).unwrap();
    assert!(too_long.starts_with("cd-solve: warning: dt = 5 s is "), "{text}");
    assert!(out.contains(&format!("  warning                {}\n", &too_long["cd-solve: warning: ".len()..])), "{out}");
}

/// Two balls on each other on a floor, with a law and material of their own, under self-gravity.
fn pair_on_floor(law: &str, parameters: &[f64], radii: [f64; 2], density: f64) -> Case {
    let mut case = Case::new();
    case.law_of_all(law, parameters);
    case.floor();
    case.gravity = [0.0, 0.0, -8.0];
    (case.options.self_gravity, case.options.steps) = (true, Some(1));
    case.sphere(radii[0], [0.0, 0.0, radii[0]]);
    case.sphere_of(density, radii[1], [0.0, 0.0, 2.0 * radii[0] + radii[1]]);
    case
}

#[test]
fn a_scene_outside_of_tested_ranges_is_reported_with_the_row() {
    let wet = |force: f64| pair_on_floor("IQS_WET_DS_CLB", &[force, 0.0, 0.01, 0.5, 0.5], [0.5, 0.5], 1.0);
    let usual = || pair_on_floor("IQS_CLB", &[0.5], [0.5, 0.5], 1.0);
    let with = |change: fn(&mut Case)| {
        let mut case = usual();
        change(&mut case);
        case
    };
    let sizes = |radii: [f64; 2], density: f64| pair_on_floor("IQS_CLB", &[0.5], radii, density);
    let weight = 8.0 * std::f64::consts::FRAC_PI_6;
    let outside = [
        (&limits::RADIUS, sizes([1e-25, 1e-25], 1.0), "1.00e-25"),
        (&limits::DENSITY, sizes([0.5, 0.5], 1e-30), "1.00e-30"),
        (&limits::TOP_MASS, sizes([0.5, 0.5], 1e30), "1.00e30"),
        (&limits::CARRIED_SIZE, sizes([0.5, 1e6], 1e-20), "2.00e6"),
        (&limits::GRAVITY, with(|case| case.gravity = [0.0, 0.0, -1e25]), "1.00e25"),
        (&limits::TRAVEL, with(|case| case.launch(1, [2e6, 0.0, 0.0], [0.0; 3])), "2000"),
        (&limits::TIME_STEP, with(|case| case.options.dt = 1e6), "4.00e6"),
        (&limits::SPIN, with(|case| case.launch(1, [0.0; 3], [0.0, 1e5, 0.0])), "100"),
        (&limits::ORBIT_STEPS, with(|case| case.options.gravity_constant = 1e9), "0.0"),
        (&limits::FRICTION, pair_on_floor("IQS_CLB", &[1e5], [0.5, 0.5], 1.0), "1.00e5"),
        (&limits::COHESION, wet(weight * 1e12), "1.00e12"),
        (&limits::ORIGIN_DISTANCE, with(|case| case.dof[2].displacement[0] = 1e12), "2.00e12"),
    ];
    let reports = |row: &ParameterLimit, text: &str, value: &str| {
        let [start, end] = [
            format!("{}: {value}", row.parameter),
            format!("; tested range: {} (\"{}\"), see docs/explanation/limits.md", row.stated_text(), row.property),
        ];
        text.lines().any(|line| line.contains(&start) && line.ends_with(&end))
    };
    for (row, case, value) in &outside {
        case.write();
        let (code, plan, _) = output_of(case, &["--plan"]);
        assert!(code == 0 && reports(row, &plan, value), "{}: {plan}", row.parameter);
        let (_, _, run) = output_of(case, &[]);
        assert!(reports(row, &run, value), "{}: {run}", row.parameter);
    }
    let measured = limits::LIMITS.iter().filter(|row| row.scene_values.is_some()).count();
    assert_eq!(outside.len(), measured);
    let case = usual();
    case.write();
    assert!(["--plan", "--force"].iter().all(|flag| {
        let (_, out, err) = output_of(&case, &[flag]);
        !out.contains("limits.md") && !err.contains("limits.md")
    }));
}

/// Events that set a law or gravity are reported by the plan and at the start, and others when they act; each row once.
#[test]
fn events_that_leave_tested_ranges_are_reported() {
    let mut case = pair_on_floor("IQS_CLB", &[0.5], [0.5, 0.5], 1.0);
    case.options.steps = Some(20);
    let dt = case.options.dt;
    let law = case.tact.laws[0].nickname.clone();
    for step in [2.0, 4.0, 6.0] {
        case.event(step * dt, EventAction::SetFriction(law.clone(), 1e5 * step));
    }
    case.event(8.0 * dt, EventAction::SetGravity([0.0, 0.0, -1e25]));
    case.event(8.0 * dt, EventAction::SetGravity([0.0, 0.0, -10.0]));
    for step in [10.0, 12.0] {
        case.event(step * dt, EventAction::AddSpin([0.0, 0.0, 100.0 / dt]));
    }
    case.write();
    let parameters = [&limits::FRICTION, &limits::GRAVITY, &limits::SPIN].map(|row| row.parameter);
    let [friction, gravity, spin] = parameters.map(|parameter| format!("{parameter}: "));
    let texts = [friction.clone() + "2.00e5; tested range", gravity.clone() + "1.00e25", friction, gravity, spin];
    let counts = |text: &str| {
        let count = |start: &String| text.lines().filter(|line| line.contains(start.as_str())).count();
        texts.each_ref().map(count)
    };
    let (code, plan, _) = output_of(&case, &["--plan"]);
    assert_eq!((code, counts(&plan)), (0, [1, 1, 1, 1, 0]), "{plan}");
    assert!(plan.contains(&format!("; from t = {} s on, by an event", 2.0 * dt)), "{plan}");
    let (code, _, run) = output_of(&case, &[]);
    assert_eq!((code, counts(&run)), (0, [1, 1, 1, 1, 1]), "{run}");
}

#[test]
fn pairs_that_are_meant_to_have_no_law_are_no_news() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.3]);
    case.sphere(0.5, [0.0; 3]);
    case.sphere(0.5, [3.0, 0.0, 0.0]);
    case.tact.visibility.clear();
    case.options.steps = Some(1);
    case.write();
    let message = |case: &Case| output_of(case, &["--force"]).1.contains("they pass through each other");
    assert!(message(&case));
    let file = case.path().join("DATBOX/TACT_BEHAV.DAT");
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, text + &TactBehav::no_law_comment("GRAIN", "GRAIN")).unwrap();
    assert!(!message(&case));
}

#[test]
fn a_lone_body_that_a_tide_would_turn_is_reported() {
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let is_reported = |half: [f64; 3], others: usize, has_mass: bool| {
        let mut case = Case::new();
        case.block(half, [0.0; 3], axes);
        for k in 0..others {
            case.block(half, [10.0 * (k + 1) as f64, 0.0, 0.0], axes);
        }
        let position = Some([100.0, 0.0, 0.0]);
        let mass = ExternalField::PointMass { mass: 1.0, position, orbit: None, response: false };
        let turning = ExternalField::RotatingFrame { rate: [0.0, 0.0, 1.0], centre: [0.0; 3] };
        case.options.fields = vec![if has_mass { mass } else { turning }];
        case.options.steps = Some(1);
        case.write();
        let (code, _, text) = output_of(&case, &[]);
        assert_eq!(code, 0, "{text}");
        text.contains("cd-solve: warning: fields act at the centre of body 1, the only one")
    };
    assert!(is_reported([0.5, 0.4, 0.3], 0, true));
    // A cube has no torque, turning axes turn bodies, and of several bodies each is part of the shape.
    assert!(!is_reported([0.5; 3], 0, true));
    assert!(!is_reported([0.5, 0.4, 0.3], 0, false));
    assert!(!is_reported([0.5, 0.4, 0.3], 1, true));
}

#[test]
fn steps_are_long_while_a_table_is_constant() {
    let mut case = Case::new();
    let plate = case.plate([1.0, 1.0, 0.1], [0.0; 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    case.sphere(0.5, [0.0, 0.0, 50.0]);
    let dt = 1.0 / 1024.0;
    // A gate that moves from step 100 to step 120.
    let points = [(0.0, 0.0), (100.0, 0.0), (110.0, 1.0), (120.0, 0.0), (130.0, 0.0)].map(|(t, v)| [t * dt, v]);
    case.drive_along(plate, 2, Evolution::Table { name: "gate.dat".into(), points: points.to_vec() });
    case.options.dt = dt;
    case.options.adaptive = Some(Adaptive { max_multiple: 16, ..Adaptive::default() });
    case.run(400);
    let (steps, lengths) = (case.column("step"), case.column("h"));
    let ends = |k: usize| (steps[k], (lengths[k] / dt).round());
    let all: Vec<(f64, f64)> = (0..steps.len()).map(ends).collect();
    // No step reaches into the motion, in which each is dt; before and after they are longer.
    assert!(all.iter().any(|&(step, _)| step == 100.0), "{all:?}");
    assert!(all.iter().filter(|&&(step, _)| step > 100.0 && step <= 120.0).all(|&(_, units)| units == 1.0), "{all:?}");
    assert!(all.iter().any(|&(step, units)| step <= 100.0 && units == 16.0), "{all:?}");
    assert!(all.iter().any(|&(step, units)| step > 120.0 && units == 16.0), "{all:?}");
    let (_, out, _) = output_of(&case, &["--force", "--steps", "1"]);
    assert!(out.contains("cd-solve: adaptive: steps are dt while an imposed velocity or force changes\n"), "{out}");
}

#[test]
fn former_names_of_options_are_read_with_a_warning() {
    let mut case = falling();
    case.options.adaptive = Some(Adaptive { max_multiple: 16, ..Adaptive::default() });
    case.write();
    let path = case.path().join("DATBOX/COMPUTE.RON");
    let former = fs::read_to_string(&path).unwrap().replace("max_multiple", "most");
    fs::write(&path, former).unwrap();
    let (code, _, text) = output_of(&case, &["--steps", "40", "--adaptive", "(most: 4)"]);
    assert_eq!(code, 0, "{text}");
    let [flag, file] = text.lines().collect::<Vec<_>>()[..] else { panic!("{text}") };
    assert_eq!(flag, "cd-solve: warning: --adaptive: most: renamed; write max_multiple");
    assert!(file.starts_with("cd-solve: warning: CASE/DATBOX/COMPUTE.RON:"), "{text}");
    assert!(file.ends_with(": most: renamed; write max_multiple"), "{text}");
    assert_eq!(case.last().meta.parameters.adaptive.map(|adaptive| adaptive.max_multiple), Some(4));
    let (code, _, text) = output_of(&case, &["--resume", "--steps", "41", "--adaptive=(max_multiple: 4)"]);
    assert!(code == 0 && text.lines().count() == 1, "{text}");
}

#[test]
fn a_model_that_has_changed_since_is_named() {
    let case = falling();
    case.write();
    let (scene, model) = (case.path().join("scene.ron"), case.path().join("stone.stl"));
    fs::write(&scene, "(a)").unwrap();
    fs::write(&model, "solid").unwrap();
    let mut origin = SceneOrigin::from_scene(&scene, b"(a)", &[], &case.path()).unwrap();
    origin.add(&model, &case.path());
    let options = case.path().join("DATBOX/COMPUTE.RON");
    let text = fs::read_to_string(&options).unwrap();
    fs::write(&options, origin.lines() + &text).unwrap();
    assert_eq!(output_of(&case, &[]).2, "");
    fs::write(&model, "other").unwrap();
    let warning = "cd-solve: warning: CASE/stone.stl has changed since DATBOX was made from it; to use it, run cd-pre \
                   CASE/scene.ron\n";
    assert_eq!(output_of(&case, &["--force"]).2, warning);
}

#[test]
fn empty_files_of_datbox_are_named() {
    let messages = |name: &str, bytes: &[u8]| {
        let case = falling();
        case.write();
        fs::write(case.path().join("DATBOX").join(name), bytes).unwrap();
        let (code, _, text) = output_of(&case, &[]);
        assert_eq!(code, 2, "{name}: {text}");
        text
    };
    let expected = "cd-solve: CASE/DATBOX/BODIES.DAT: file: no body; expected a $bdyty for each\n";
    assert_eq!(messages("BODIES.DAT", b""), expected);
    let expected = "cd-solve: CASE/DATBOX/TACT_BEHAV.DAT: file: no contact laws; expected a $behav for each law; \
                    a file without laws says so by a line '! no contact laws'\n";
    assert_eq!(messages("TACT_BEHAV.DAT", b""), expected);
    assert_eq!(messages("TACT_BEHAV.DAT", b"\x8b\x01 random \xff\n bytes"), expected);
    for name in ["BULK_BEHAV.DAT", "DOF.INI", "Vloc_Rloc.INI"] {
        assert!(messages(name, b"").starts_with(&format!("cd-solve: CASE/DATBOX/{name}")), "{name}");
    }
}

#[test]
fn a_misspelt_material_is_placed_in_its_line() {
    let case = falling();
    case.write();
    let file = case.path().join("DATBOX/BODIES.DAT");
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, text.replacen("ROCKx", "ROKCx", 1)).unwrap();
    let line = "cd-solve: CASE/DATBOX/BODIES.DAT:4: body 1: material 'ROKCx' is not defined; did you mean ROCKx?\n";
    assert_eq!(output_of(&case, &[]).2, line);
}

#[test]
fn misspelt_kinds_and_laws_get_the_nearest() {
    let mut case = falling();
    case.sphere(0.5, [4.0, 0.0, 0.6]);
    case.write();
    let file = case.path().join("DATBOX/TACT_BEHAV.DAT");
    let text = fs::read_to_string(&file).unwrap();
    for (from, to, expected) in [
        ("IQS_CLB", "IQS_CBL", "its kind 'IQS_CBL' is not known; did you mean IQS_CLB?"),
        ("PLANx", "PLAMx", "a contactor of type 'PLAMx'; did you mean PLANx?"),
    ] {
        fs::write(&file, text.replacen(from, to, 1)).unwrap();
        let (code, _, said) = output_of(&case, &[]);
        assert!(code == 2 && said.contains(expected), "{said}");
    }
}

#[test]
fn values_of_another_unit_are_questioned() {
    let mut case = falling();
    case.law("IQS_CLB", &[40.0]);
    case.materials[0].density = 2.7;
    case.event(0.002, EventAction::SetFriction("law00".into(), 50.0));
    case.write();
    let (code, _, text) = output_of(&case, &["--steps", "1"]);
    assert_eq!(code, 0, "{text}");
    assert!(
        text.contains(
            "BULK_BEHAV.DAT:4: material ROCKx, density: 2.7; did you mean kg/m^3? 2.7 g/cm^3 are 2700 kg/m^3"
        ),
        "{text}"
    );
    assert!(
        text.contains("COMPUTE.RON:") && text.contains("event 1: SetFriction 50; did you mean an angle?"),
        "{text}"
    );
    let events = "--events=[(time: 0.0, action: SetFriction(\"law00\", 45.0))]";
    let (code, _, text) = output_of(&case, &["--force", "--steps", "1", events]);
    assert!(code == 0 && text.contains("options: event 1: SetFriction 45; did you mean an angle?"), "{text}");
    let mut case = Case::new();
    case.law("IQS_CLB", &[40.0]);
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.6]);
    case.options.steps = Some(1);
    case.write();
    let text = output_of(&case, &[]).2;
    let line = "cd-solve: warning: CASE/DATBOX/TACT_BEHAV.DAT:2: law 'law00', fric: 40; did you mean an angle? 40 \
                degrees are 0.839\n";
    assert!(text.starts_with(line), "{text}");
}

#[test]
fn events_before_time_0_are_errors() {
    let case = falling();
    case.write();
    let events = "--events=[(time: -1.0, action: SetFriction(\"law00\", 0.1))]";
    let (code, _, text) = output_of(&case, &[events]);
    let line = "cd-solve: options: event 1, time: -1 s is before the start of the run; expected at least 0 s\n";
    assert_eq!((code, text.as_str()), (2, line));
    let mut case = falling();
    case.event(-1.0, EventAction::SetQuench(0.1));
    case.write();
    let (code, _, text) = output_of(&case, &[]);
    assert!(code == 2 && text.contains("COMPUTE.RON:") && text.contains("-1.0 s is before the start"), "{text}");
}

#[test]
fn options_that_are_no_numbers_say_what_is_expected() {
    let case = falling();
    case.write();
    for (flags, line) in [
        (&["--dt", "abc"][..], "cd-solve: --dt: abc; expected a number (s)\n"),
        (&["--threads", "-1"], "cd-solve: --threads: -1; expected an integer of 0 or more\n"),
        (&["--dump-problem", "x"], "cd-solve: --dump-problem: x; expected an integer\n"),
    ] {
        let (code, _, text) = output_of(&case, flags);
        assert_eq!((code, text.as_str()), (2, line));
    }
}

#[test]
fn a_snapshot_that_is_a_folder_is_named() {
    let case = falling();
    case.write();
    fs::create_dir_all(case.path().join("OUTBOX/snapshot-000004.npz")).unwrap();
    let line = "cd-solve: CASE/OUTBOX/snapshot-000004.npz: file: cannot be read: it is a folder; move it away \
                and start from DATBOX with --force\n";
    assert_eq!(output_of(&case, &["--resume"]).2, line);
}

#[test]
fn a_resume_without_the_text_of_the_run_so_far_is_reported() {
    let mut case = falling();
    case.options.output_every = 2;
    case.write();
    assert_eq!(output_of(&case, &["--text"]).0, 0);
    let line = "cd-solve: warning: text was true in the run so far and is false from here on; --text=true keeps it\n";
    assert_eq!(output_of(&case, &["--resume", "--steps", "6"]).2, line);
    assert_eq!(output_of(&case, &["--resume", "--steps", "8"]).2, "");
    let (code, out, text) = output_of(&case, &["--resume", "--steps", "10", "--text"]);
    assert_eq!((code, text.as_str()), (0, ""));
    assert!(out.contains("cd-solve: text was false in the run so far and is true from here on\n"), "{out}");
}
